"""Theorem 4 for a network in shards: a solve for r over all shards, then the proof, one shard after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..exact.condition import all_hold
from ..exact.intake import file_path
from ..exact.matrix import Matrix
from ..exact.rounding import HALF_ULP
from ..networks.blocks import Floats
from ..networks.certify import lower_outputs, moved, provable_rate
from ..networks.conditions import loop_gain
from ..networks.model import NetworkModel
from ..networks.own_links import own_links_closed
from ..networks.spectrum.descent import interior, is_inside, mix
from ..networks.spectrum.port_solves import Loop, PortSystem
from ..progress import Reporter, Target
from ..proof.certificate import Status
from .certificate import VECTORS, WEIGHTS, ShardedCertificate, is_proven, positive_form, state
from .folders import MANIFEST, write_arrays
from .network import ShardedNetwork
from .ports import SolvePorts, scratch

# Accuracies of the solve that are tried in turn.
_TOLERANCES = (1e-7, 1e-11, 1e-13)
# Rounds in which r and q settle where inputs act on outputs at once.
_ROUNDS = 60

Say = Callable[[str], None]


def certify(folder: str | PathLike[str], out: str | PathLike[str], *, progress: Target = None) -> ShardedCertificate:
    """Decide Theorem 4 for a network in shards, and write the certificate in shards too.

    Parameters
    ----------
    folder : path-like
        A network that `write` has written.
    out : path-like
        A folder for the certificate: v, r and q of every shard, and a manifest.  An older one in it is replaced.
    progress : callable or bool, optional
        As for `feedback_interconnect`.

    Returns
    -------
    ShardedCertificate
        PROVED with a decay rate; REFUTED with a node that is not positive or a link that leaves the cones;
        otherwise UNDECIDED.

    Raises
    ------
    CertificateFileError
        A file is missing, damaged or not the one that the manifest is about; it is named.
    DataError
        `out` is the folder of the network.
    OSError
        Files cannot be written; the file is named.

    Notes
    -----
    h = W'r, r = G'h + b, and v, q and every inequality of Theorem 4 (see `NetworkCertificate`) read the data of one
    shard, and r at the inputs that its outputs feed.  No sum is divided between shards: the network is proven if every
    shard is, and its decay rate is the smallest of theirs.
    In memory at a time: one shard, and about ten vectors of 8 bytes for every input of the network.  The port equations
    are kept in files inside `out` until the end, 12 bytes a link.

    Examples
    --------
    >>> import control_kpos as kp, tempfile
    >>> nodes = kp.stack([[[-3]]] * 4, B=[[1]], C=[[1]])
    >>> folder = kp.shards.write((nodes, kp.examples.ring(4)), tempfile.mkdtemp(), parts=2)
    >>> proof = kp.shards.certify(folder, folder / "proof")
    >>> proof.status.name, bool(proof.decay_rate == proof.rates.min())
    ('PROVED', True)
    """
    source, place = file_path(folder, "folder"), file_path(out, "out")
    network = ShardedNetwork.open(source)
    if place.resolve() == source.resolve():
        raise DataError(f"out is {place}, the folder of the network; give another folder, such as one inside it.")
    place.mkdir(parents=True, exist_ok=True)
    (place / MANIFEST).unlink(missing_ok=True)
    with Reporter(progress) as report, scratch(place) as aside, np.errstate(all="ignore"):
        return _Run(network, place, aside, report).certificate()


@dataclass(eq=False)
class _Run:
    """One certification: what is known of all shards, and vectors of all inputs."""

    network: ShardedNetwork
    out: Path
    aside: Path
    report: Say
    closed: set[int] = field(default_factory=set)
    unproven: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        inputs, outputs = (int(self.network.starts[kind][-1]) for kind in (2, 3))
        self.b, self.direct, self.p, self.t = np.zeros(inputs), np.zeros(inputs), np.zeros(outputs), np.zeros(inputs)
        self.ports = SolvePorts(self.network, self.aside, "ports")
        self.direct_loop = SolvePorts(self.network, self.aside, "direct")
        self.feedthrough, self.finite, self.peak = False, True, 0.0
        self.least = float(self.network.discrete)

    def certificate(self) -> ShardedCertificate:
        """Read every shard once; then solve and prove."""
        for p in self.network.filled:
            self.report(f"reading shard {p + 1} of {self.network.n_shards}")
            witness = self._read(p)
            if witness is not None:
                return self._settled(Status.REFUTED, witness=witness, refuted=p)
        if self.unproven:
            return self._undecided(f"shard {self.unproven[0]} is not proven positive on its cones")
        if not self.finite:
            return self._undecided("a node alone has an eigenvalue on the margin of stability, or overflows")
        if self.feedthrough and not self._loop_contracts():
            return self._undecided("the algebraic loops of the feedthrough terms are not proven to contract")
        for tolerance in _TOLERANCES:
            may_prove = self._candidate(tolerance)
            if may_prove is None:
                break
            rates = self._proof() if may_prove else None
            if rates is not None:
                return self._settled(Status.PROVED, rates=rates)
        return self._undecided(
            "no vectors that prove it were found, as is to be expected beyond the margin or close to it"
        )

    def _each(self, what: str, step: Callable[[int], Any]) -> None:
        """One step for every shard; what it holds of a shard is gone before the next one."""
        for p in self.network.filled:
            self.report(f"{what} of shard {p + 1} of {self.network.n_shards}")
            step(p)

    # -- what a shard has

    def _model(self, p: int) -> NetworkModel:
        model = self.network.model(p)
        closed = own_links_closed(model) if p in self.closed else None
        return model if closed is None else closed

    def _read(self, p: int) -> Any:
        """Keep the port equations of a shard; or what breaks it."""
        model, witness, proven = positive_form(self.network, p, self.network.model(p, verify=True))
        if witness is not None and proven:
            return witness
        if not proven:
            self.unproven.append(p)
        if model.origin is not None:
            self.closed.add(p)
        system, own = PortSystem(model, self.least), self.network.own(p, 2)
        self.finite &= system.is_finite
        self.ports.keep(p, system.loop.TT)
        self.b[own] = model.apply(system.KB, interior(model, dual=True), 0, 1, transposed=True)
        if model.has_feedthrough:
            self.feedthrough = True
            self.direct_loop.keep(p, Loop(model, [s.D.values for s in model.stacks]).TT)
            self.direct[own] = model.times("D", _outward(model), transposed=True)
        return None

    # -- algebraic loops

    def _loop_contracts(self) -> bool:
        """True with p and t that prove the algebraic loops to contract."""
        sums, fine = self.direct_loop.solve(self.direct, 1e-13), []

        def weigh(p: int) -> None:
            model = self._model(p)
            weight = _outward(model) + model.WT @ sums[self.network.fed(p)]
            self.p[self.network.own(p, 3)] = weight
            self.t[self.network.own(p, 2)] = moved(model, "U", [("D", weight)], dual=True)

        def prove(p: int) -> None:
            weights = Matrix(self.p[self.network.own(p, 3)]), Matrix(self.t[self.network.fed(p)])
            fine.append(all_hold(list(loop_gain(self._model(p), *weights))))

        self._each("algebraic loops", weigh)
        if np.isfinite(self.p).all() and np.isfinite(self.t).all():
            self._each("proof of algebraic loops", prove)
        return bool(fine) and all(fine)

    # -- candidates

    def _aside(self, name: str, p: int) -> Path:
        return self.aside / f"{name}-{p}.npy"

    def _candidate(self, tolerance: float) -> bool | None:
        """v of every shard aside, and r; False if they prove nothing, None if more accuracy will not help."""
        if self.peak > 0:
            peak, self.peak = self.peak, 0.0
            self._each("right side", partial(self._even_out, peak))
        self.report(f"solving, accuracy {tolerance:g}")
        self.r = self.ports.solve(self.b, tolerance)
        self.missed = self.r - (self.ports @ self.r + self.b)
        self.raised, self.inside, self.reached = self.r.copy(), True, True
        self._each("storage", self._store)
        if not self.inside:
            return None
        if not self.feedthrough:
            self.r = self.raised
        elif self.reached:
            self._settle_direct()
        return self.reached

    def _even_out(self, peak: float, p: int) -> None:
        """c close to v itself, which evens out relative margins where v spans many orders of magnitude."""
        model, v = self._model(p), np.load(self._aside("v", p))
        c = mix(model, v, 0.0, dual=True) * (float(np.abs(v).max()) / peak)
        np.save(self._aside("c", p), c)
        self.b[self.network.own(p, 2)] = model.apply(PortSystem(model, self.least).KB, c, 0, 1, transposed=True)

    def _store(self, p: int) -> None:
        """v = K'(c + C'h), and r >= B'v."""
        if not self.inside:
            return
        model, fed = self._model(p), self.network.fed(p)
        system, aside = PortSystem(model, self.least), self._aside("c", p)
        c = np.load(aside) if aside.exists() else interior(model, dual=True)
        heard = model.apply(system.CK, model.WT @ self.r[fed], 2, 0, transposed=True)
        v = model.apply(system.K, c, 0, 0, transposed=True) + heard
        back = c + model.times("C", model.WT @ self.missed[fed], transposed=True)
        self.inside &= bool(np.isfinite(v).all()) and is_inside(model, v, dual=True)
        self.reached &= is_inside(model, back, dual=True)
        self.peak = max(self.peak, float(np.abs(v).max()))
        np.save(self._aside("v", p), v)
        self.raised[self.network.own(p, 2)] = moved(model, "U", [("B", v)], dual=True)

    def _settle_direct(self) -> None:
        """r >= B'v - D'q and q <= -W'r in the orders of U* and Y*, round by round."""

        def step(p: int) -> None:
            model, v = self._model(p), np.load(self._aside("v", p))
            q = lower_outputs(model, self.r[self.network.fed(p)])
            self.raised[self.network.own(p, 2)] = moved(model, "U", [("B", v), ("D", -q)], dual=True)

        for count in range(_ROUNDS):
            self._each(f"supply rates, round {count + 1},", step)
            settled = (np.abs(self.raised - self.r) <= 4 * HALF_ULP * np.abs(self.raised)).all()
            self.r = self.raised.copy()
            if settled:
                return

    # -- the proof

    def _proof(self) -> list[dict[str, Any]] | None:
        """The rates and files of all shards, or None as soon as one is not proven."""
        shards: list[dict[str, Any]] = [{} for _ in range(self.network.n_shards)]
        for p in self.network.filled:
            self.report(f"proof of shard {p + 1} of {self.network.n_shards}")
            found = self._prove(p)
            if found is None:
                return None
            shards[p] = found
        return shards

    def _prove(self, p: int) -> dict[str, Any] | None:
        model, fed, v = self._model(p), self.network.fed(p), np.load(self._aside("v", p))
        q = lower_outputs(model, self.r[fed])
        rate = max(provable_rate(model, Matrix(v), Matrix(q), discrete=model.discrete), 0.0)
        own, outputs = self.network.own(p, 2), self.network.own(p, 3)
        loop = (self.p[outputs], self.t[fed]) if self.feedthrough else None
        if not is_proven(model, (v, self.r[fed], q), rate, loop):
            return None
        arrays: dict[str, Any] = dict(zip(VECTORS, (v, self.r[own], q), strict=True))
        if loop is not None:
            arrays |= dict(zip(WEIGHTS, (loop[0], self.t[own]), strict=True))
        return {"rate": rate.hex(), "files": write_arrays(self.out, p, arrays)}

    def _undecided(self, reason: str) -> ShardedCertificate:
        return self._settled(Status.UNDECIDED, reason=reason)

    def _settled(
        self,
        status: Status,
        *,
        rates: list[dict[str, Any]] | None = None,
        witness: Any = None,
        refuted: int | None = None,
        reason: str = "",
    ) -> ShardedCertificate:
        """The certificate, with its manifest written last."""
        shards = [] if rates is None else rates
        state(self.network, self.out, status=status.name, refuted=refuted, reason=reason, shards=shards)
        proven = np.array([float.fromhex(s["rate"]) if s else np.inf for s in shards])
        least = float(proven.min()) if shards else 0.0
        about = self.network.n_nodes, self.network.n_shards, self.network.discrete, self.out
        return ShardedCertificate(status, least, proven, witness, refuted, reason, *about)


def _outward(model: NetworkModel) -> Floats:
    """Interior points of the Y_k*."""
    return model.at_all([s.Y.dual.interior_point for s in model.stacks], 2)
