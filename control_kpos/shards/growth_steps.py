"""What is done with one shard on the way to a witness of growth; each step may run in any process, and again."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..networks.blocks import Floats, inverse
from ..networks.certify import certify
from ..networks.inwards import moved, shifted
from ..networks.model import NetworkModel
from ..networks.spectrum.descent import combined, cut_down, interior, is_inside, weigh
from ..networks.spectrum.port_solves import PortSystem
from ..networks.witnesses import NetworkInstability
from ..proof.certificate import Status
from .folders import keep_array, mapped, shard_folder, write_arrays
from .growth_proof import Part, heard, is_growing
from .teams import Shard

# What u is lowered by before outputs are computed from it, so that it may rise again: a part of itself.
_BELOW = 2.0**-36


def begin(shard: Shard) -> tuple[Floats, Floats]:
    """Interior points of all U_j, and of their duals."""
    stacks = shard.model().stacks
    points = ([s.U.interior_point for s in stacks], [s.U.dual.interior_point for s in stacks])
    primal, dual = (shard.model().at_all(part, 1) for part in points)
    return primal, dual


def alone(shard: Shard, least: float) -> float | None:
    """A state of one node that grows by itself, in a file, and its rate; None if no node is seen to.

    A node whose abscissa is below `least` has its inverse at it in the cones.
    """
    model = shard.model()
    ahead = model.apply(PortSystem(model, least).K, interior(model, dual=True), 0, 0, transposed=True)
    worst, node = -np.inf, -1
    for s, index, v in zip(model.stacks, model.members, model.split(ahead, 0), strict=True):
        inside = np.einsum("jn,kn->jk", v, s.X.rays)
        bad = np.flatnonzero(~((inside > 0) & (inside < np.inf)).all(axis=1))
        if bad.size:
            poles = np.linalg.eigvals(np.nan_to_num(s.A.values[bad])).real.max(axis=1)
            if poles.max() > worst:
                worst, node = float(poles.max()), int(index[bad[np.argmax(poles)]])
    if node < 0:
        return None
    found = certify(model.restrict(np.arange(model.n_nodes) == node))
    if found.status is not Status.REFUTED or not isinstance(found.witness, NetworkInstability):
        return None
    x = model.lifted(np.arange(model.n_nodes) == node, found.witness.x)
    keep_array(shard.file("x"), x)
    return found.witness.rate


def nothing_but(shard: Shard, chosen: int) -> None:
    """The state 0, in a file, unless the shard is the chosen one."""
    if shard.p != chosen:
        keep_array(shard.file("x"), np.zeros(shard.model().totals[0]))


def outputs(shard: Shard) -> tuple[tuple[Floats], None]:
    """What the outputs C x of the state in a file send."""
    return (_sent(shard.model(), np.load(shard.file("x"))),), None


# -- a state at a shift


def slopes(shard: Shard, u: Floats, shift: float) -> tuple[tuple[Floats], None]:
    """W C K K B u: how fast what inputs receive falls with the shift."""
    model = shard.model()
    K = PortSystem(model, shift).K
    x = model.times("B", u[shard.inputs])
    for _ in range(2):
        x = model.apply(K, x, 0, 0)
    return (model.W @ model.times("C", x),), None


def state(shard: Shard, u: Floats, shift: float) -> tuple[tuple[Floats], None]:
    """x = K B u at a shift, in a file, and what C x sends."""
    model, own = shard.model(), u[shard.inputs]
    K = [inverse(shift * np.eye(s.sizes[0]) - s.A.values) for s in model.stacks]
    x = model.apply(K, model.times("B", own), 0, 0)
    keep_array(shard.file("x"), x)
    return (_sent(model, x),), None


def cut(shard: Shard, u: Floats, rate: float) -> tuple[tuple[Floats], bool]:
    """x cut down to where A x + B u - rate x is in X and x is too, what C x sends, and whether anything was cut."""
    model, own, x = shard.model(), u[shard.inputs], np.load(shard.file("x"))
    ahead = model.times("A", x) + model.times("B", own) - rate * x
    changed = not all(is_inside(model, part, dual=False, strict=False) for part in (x, ahead))
    if changed:
        weights = weigh(model, np.where(np.isfinite(x), x, 0.0))
        cut_down(model, weights, ahead)
        x = combined(model, weights)
        if not is_inside(model, x, dual=False, strict=False):  # of a cone that is not simplicial
            cut_down(model, weights, x)
            x = combined(model, weights)
        keep_array(shard.file("x"), x)
    return (_sent(model, x),), changed


def _sent(model: NetworkModel, x: Floats) -> Floats:
    return model.W @ model.times("C", x)


# -- the proof


def emit(shard: Shard, u: Floats) -> tuple[tuple[Floats, Floats], dict[str, Any]]:
    """y <= C x + D u and z <= W y, written; what inputs receive at least, and the size of the numbers in it."""
    model, x, own = shard.model(), np.load(shard.file("x")), u[shard.inputs]
    y = moved(model, "Y", [("C", x), ("D", own * (1 - _BELOW))], dual=False)
    value, size, m = model.W @ y, abs(model.W) @ np.abs(y), model.totals[1]
    value[m:] = _lowered_away(model, value, size)
    entries = write_arrays(shard.out, shard.p, {"x": x, "y": y, "z": value[m:]})
    size[m:] = np.abs(value[m:])
    return (value, size), entries


def _lowered_away(model: NetworkModel, value: Floats, size: Floats) -> Floats:
    """The part of values that the halo receives, lowered in the orders of its input cones."""
    first, out = len(model.stacks), value.copy()
    for cone, places in zip(model.receivers.cones[first:], model.received[first:], strict=True):
        out[places] = shifted(cone, value[places], size[places], _longest(model), dual=False)
    return out[model.totals[1] :]


def _longest(model: NetworkModel) -> int:
    return int(np.diff(model.W.indptr).max(initial=0))


def prove(
    shard: Shard, value: Floats, size: Floats, t: Floats, rate: float, feeding: dict[int, list[int]], loops: bool
) -> tuple[Part, dict[str, Any]] | None:
    """u below what inputs receive, and the proof of the shard; None if there is none.

    `feeding` has the shards that feed each one; t and p in a file are for algebraic loops, if there are any.
    """
    model, own, p = shard.model(), shard.inputs, shard.p
    count = _longest(model) + len(feeding[p])
    pairs = zip(model.stacks, model.split(value[own], 1), model.split(size[own], 1), strict=True)
    u = model.join([shifted(s.U, a, b, count, dual=False) for s, a, b in pairs], 1)
    x, y, z = (np.load(shard_folder(shard.out, p) / f"{name}.npy") for name in ("x", "y", "z"))
    received = heard(shard.network, p, feeding[p], lambda s: mapped(shard_folder(shard.out, s) / "z.npy"))
    loop, arrays = None, {"u": u}
    if loops:
        loop = np.load(shard.file("p")), t[shard.places]
        arrays |= {"p": loop[0], "t": t[own]}
    if not is_growing(model, (x, u, y, z), rate, received, loop):
        return None
    return Part.of(shard.network, p, model, x), write_arrays(shard.out, p, arrays)
