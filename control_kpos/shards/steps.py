"""What is done with one shard on the way to a certificate; each step may run in any process, and again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import CertificateFileError
from ..exact.condition import all_hold
from ..exact.matrix import Matrix
from ..networks.blocks import Floats
from ..networks.certify import provable_rate
from ..networks.conditions import loop_gain
from ..networks.inwards import lower_outputs, moved
from ..networks.model import NetworkModel
from ..networks.spectrum.descent import interior, is_inside, mix
from ..networks.spectrum.port_solves import Loop, PortSystem
from .certificate import VECTORS, WEIGHTS, SavedCertificate, is_proven, positive_form
from .folders import keep_array, write_arrays
from .ports import keep_rows
from .teams import Shard

PORTS, DIRECT = "ports", "direct"


@dataclass(frozen=True, eq=False)
class Reading:
    """What the data of a shard show.

    Attributes
    ----------
    witness : object or None
        What breaks Theorem 4.
    proven : bool
        True if the witness is proven or, without one, the shard positive.
    finite : bool
        False if mu is an eigenvalue of a node.
    b : ndarray
        The right-hand side of the port equations at own inputs.
    direct : ndarray or None
        That of the algebraic loops.
    """

    witness: Any
    proven: bool
    finite: bool
    b: Floats
    direct: Floats | None


def read(shard: Shard, shift: float) -> Reading:
    """Compare the files of a shard with their digests, prove it positive, and keep its port equations."""
    shard.forget()
    model, witness, proven = positive_form(shard.network, shard.p, shard.network.model(shard.p, verify=True))
    if witness is not None and proven:
        return Reading(witness, True, True, np.zeros(0), None)
    shard.close_own_links(model.origin is not None)
    shard.keep_places()
    system = PortSystem(model, shift)
    keep_rows(shard, PORTS, system.loop.TT)
    b, direct = model.apply(system.KB, interior(model, dual=True), 0, 1, transposed=True), None
    if model.has_feedthrough:
        keep_rows(shard, DIRECT, Loop(model, [s.D.values for s in model.stacks]).TT)
        direct = model.times("D", _outward(model), transposed=True)
    return Reading(None, proven and witness is None, system.is_finite, b, direct)


# -- algebraic loops


def weigh_loop(shard: Shard, sums: Floats) -> Floats:
    """t, and p in a file, that may prove the algebraic loops to contract."""
    model = shard.model()
    weight = _outward(model) + model.WT @ sums[shard.places]
    keep_array(shard.file("p"), weight)
    return moved(model, "U", [("D", weight)], dual=True)


def prove_loop(shard: Shard, t: Floats) -> bool:
    """True if they do, in this shard."""
    p, t = np.load(shard.file("p")), t[shard.places]
    finite = bool(np.isfinite(p).all() and np.isfinite(t).all())
    return finite and all_hold(list(loop_gain(shard.model(), Matrix(p), Matrix(t))))


# -- candidates


def even_out(shard: Shard, shift: float, peak: float) -> Floats:
    """b for c close to v itself, which evens out relative margins where v spans many orders of magnitude."""
    model, v = shard.model(), np.load(shard.file("v"))
    c = mix(model, v, 0.0, dual=True) * (float(np.abs(v).max()) / peak)
    keep_array(shard.file("c"), c)
    return model.apply(PortSystem(model, shift).KB, c, 0, 1, transposed=True)


@dataclass(frozen=True, eq=False)
class Storage:
    """v of a shard, in a file, and what it is like.

    Attributes
    ----------
    inside : bool
        v is in the interior of the dual cones.
    reached : bool
        So is what the solve is exact for.
    peak : float
        The largest absolute value in v.
    raised : ndarray
        r >= B'v at own inputs.
    """

    inside: bool
    reached: bool
    peak: float
    raised: Floats


def store(shard: Shard, r: Floats, missed: Floats, shift: float) -> Storage:
    """v = K'(c + C'h), h = W'r, and r >= B'v."""
    model, aside = shard.model(), shard.file("c")
    system, places = PortSystem(model, shift), shard.places
    c = np.load(aside) if aside.exists() else interior(model, dual=True)
    heard = model.apply(system.CK, model.WT @ r[places], 2, 0, transposed=True)
    v = model.apply(system.K, c, 0, 0, transposed=True) + heard
    back = c + model.times("C", model.WT @ missed[places], transposed=True)
    keep_array(shard.file("v"), v)
    inside = bool(np.isfinite(v).all()) and is_inside(model, v, dual=True)
    raised = moved(model, "U", [("B", v)], dual=True)
    return Storage(inside, is_inside(model, back, dual=True), float(np.abs(v).max()), raised)


def settle_direct(shard: Shard, r: Floats) -> Floats:
    """r >= B'v - D'q for q <= -W'r, in the orders of U* and Y*."""
    model, v = shard.model(), np.load(shard.file("v"))
    q = lower_outputs(model, r[shard.places])
    return moved(model, "U", [("B", v), ("D", -q)], dual=True)


# -- the proof


def prove(shard: Shard, r: Floats, t: Floats | None = None) -> dict[str, Any] | None:
    """The rate that v and r prove in a shard, and the entries of their files in the manifest; None if they do not.

    With feedthrough also p and t are proven.
    """
    model, places, v = shard.model(), shard.places, np.load(shard.file("v"))
    q = lower_outputs(model, r[places])
    rate = max(provable_rate(model, Matrix(v), Matrix(q), discrete=model.discrete), 0.0)
    loop = None if t is None else (np.load(shard.file("p")), t[places])
    if not is_proven(model, (v, r[places], q), rate, loop):
        return None
    arrays: dict[str, Any] = dict(zip(VECTORS, (v, r[shard.inputs], q), strict=True))
    if t is not None and loop is not None:
        arrays |= dict(zip(WEIGHTS, (loop[0], t[shard.inputs]), strict=True))
    return {"rate": rate.hex(), "files": write_arrays(shard.out, shard.p, arrays)}


def confirm(shard: Shard, vector: Floats, name: str) -> None:
    """Compare r, or t, at the inputs that the shard feeds with the files of the shards that have these inputs.

    Raises
    ------
    CertificateFileError
        They differ: the proof was about numbers that came from another process, and files are what others will check.
    """
    sizes = np.diff(shard.network.starts[2]).tolist()  # whose digests are those of the manifest is for checks to say
    entries = [{"files": {name: {"dtype": "<f8", "shape": [size], "sha256": ""}}} for size in sizes]
    saved = SavedCertificate(shard.out, {"shards": entries}, shard.network)
    if not np.array_equal(saved.at_fed(shard.p, name), vector[shard.places]):
        raise CertificateFileError(
            f"the files {name}.npy in {shard.out} are not what shard {shard.p} was proven with; all processes have to "
            "see the same folders, and no others may write there."
        )


def _outward(model: NetworkModel) -> Floats:
    """Interior points of the Y_k*."""
    return model.at_all([s.Y.dual.interior_point for s in model.stacks], 2)
