"""L2 gains and margins of large networks: candidates by solves with the network itself, for proofs with sparse data.

G is the DC gain between the external signals.  H = [[0, G'], [G, 0]] for one block of all signals, H = G (outputs in
the order of the inputs of their blocks) for blocks of single signals.  For sigma > rho(H) and c > 0,

    z = c + H z / sigma

has a solution z > 0, and every such z proves rho(H) <= sigma max_i (1 - c_i / z_i) (Collatz and Wielandt).  With z in
the place of c, again and again, these bounds fall to rho(H) quadratically (Noda, Numer. Math. 17 (1971)).  The equation
is that of a network: outputs are fed back to inputs with the weight 1 / sigma, for the first H through a second copy in
which all matrices and links are transposed.  So each step costs one solve of `port_solves`.

Nothing here is trusted: `theorems.structured_gain` proves what is proposed, or drops it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import KposError, UndecidedError
from ..exact.matrix import Matrix
from ..proof.certificate import Status
from ..proof.inclusion import PositivityViolation
from ..systems.system import System
from ..theorems.blocks import Blocks
from ..theorems.gain_candidates import Fields, Plant, from_below, upper_fields
from ..theorems.positivity import PositivityCertificate
from ..theorems.robust_margin import between, without_gain
from ..theorems.stability import LyapunovCertificate
from ..theorems.structured_gain import StructuredGainCertificate, require_orthants
from .blocks import Floats, Index
from .model import NetworkModel
from .spectrum.port_solves import PortSystem, same_graph

# Relative distances from the value found at which bounds are tried: smaller ones would be left to integers.
_APART = (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0)
# Parts of the largest state that nodes have in proofs from below.
_REACHED = (1e-6, 1e-3, 0.0)
# Products with G that find where to begin; then steps towards the largest gain, and how close ends them.
_PRODUCTS, _STEPS, _CLOSE = 8, 20, 1e-13
# Multiples of a first guess that are tried as a bound where the guess for the vector gives a bad one.
_BEYOND = (1.01, 1.5, 4.0, 64.0, 2.0**20)
# Relative distance from a bound at which equations are solved: at rho(H) itself they have no solution.
_BESIDE = 2.0**-36
# Accuracy of solves.  Parts of the largest entry that others are raised to, so that none vanishes.
_ACCURACY, _LEAST = 1e-13, 1e-200


@dataclass(frozen=True)
class NetworkPlant(Plant):
    """The closed loop of a network, whose solves are those of its nodes and links.

    Attributes
    ----------
    system : PortSystem
        With the shift 0, in discrete time 1.
    external : tuple of two ndarrays of int
        Places of the external inputs and outputs.
    kept : tuple of (ndarray of bool, PortSystem), or None
        With some nodes only: which, and their network.
    """

    system: PortSystem
    external: tuple[Index, Index]
    kept: tuple[NDArray[np.bool_], PortSystem] | None = None
    room: ClassVar[float] = 2.0**-45

    @classmethod
    def of(cls, p: System, blocks: Blocks, model: NetworkModel, external: tuple[Index, Index]) -> NetworkPlant:
        """The plant of a network with the closed loop p."""
        system = PortSystem(model, float(model.discrete))
        B, C, D = (sp.csr_array(M.values) for M in (p.B, p.C, p.D))
        points = (np.asarray(X.interior_point, dtype=float) for X in (p.X, p.X.dual))
        up, down = (find(system, point) for find, point in zip((_primal, _dual), points, strict=True))
        return cls(blocks, B, C, D, up, down, system, external)

    def after(self, x: Floats) -> Floats:
        """-A^{-1} x; if only some nodes are kept, in the network of these, which is below the whole one."""
        if self.kept is None:
            return _primal(self.system, x)
        whole, (mask, part) = self.system.model, self.kept
        return whole.lifted(mask, _primal(part, x[mask[whole.owners(0)]]))

    def around(self, w: Floats, least: float) -> tuple[NetworkPlant, Floats]:
        """The plant of the nodes that inputs reach, with this part of the largest state or more, and inputs there.

        The others are far from all that matters, where rounding is larger than the states.
        """
        model = self.system.model
        peaks = model.peaks(self.state(w))
        mask = peaks >= least * peaks.max(initial=0.0)
        part = PortSystem(model.restrict(mask), self.system.shift)
        return replace(self, kept=(mask, part)), np.where(mask[model.owners(1)[self.external[0]]], w, 0.0)

    def before(self, p: Floats) -> Floats:
        """-A^{-T} p."""
        return _dual(self.system, p)

    def gather(self, z: Floats) -> Floats:
        """G'z."""
        return np.maximum(self.B.T @ self.costate(z) + self.D.T @ z, 0.0)


def _primal(system: PortSystem, x: Floats) -> Floats:
    return system.primal(x, _ACCURACY)[0]


def _dual(system: PortSystem, p: Floats) -> Floats:
    return system.dual(p, _ACCURACY)[0]


@np.errstate(all="ignore")
def network_gain(
    positivity: PositivityCertificate,
    stable: LyapunovCertificate | None,
    blocks: Blocks,
    model: NetworkModel,
    external: tuple[Index, Index],
) -> StructuredGainCertificate:
    """Bound the structured gain of a network for one block, or for blocks of one input and one output.

    Parameters
    ----------
    positivity : PositivityCertificate
        Of the closed loop from the external inputs to the external outputs, in sparse matrices.
    stable : LyapunovCertificate or None
        About the same states; None if they are known to be stable.
    blocks : Blocks
    model : NetworkModel
    external : tuple of two ndarrays of int
        Places of the external inputs and outputs.

    Returns
    -------
    StructuredGainCertificate
    """
    p = positivity.system()
    require_orthants(p.U, p.Y)
    ins, outs = (tuple(members.tolist()) for members in (blocks.inputs, blocks.outputs))
    data: Fields = {"positivity": positivity, "input_blocks": ins, "output_blocks": outs}
    witness = positivity.witness if stable is None else positivity.witness or stable.witness
    if witness is not None:
        return StructuredGainCertificate.settle(**data, witness=witness)
    plant = NetworkPlant.of(p, blocks, model, external)
    if not all(np.isfinite(x).all() for x in (plant.up, plant.down)):
        return StructuredGainCertificate.settle(**data)
    nothing = without_gain(data, p, blocks, plant.down)
    if nothing is not None:
        return nothing
    loops = _Loops.of(plant)
    value, z = loops.largest()
    return between(data, p, _from_above(loops, value), _from_below(plant, loops.inputs(z)))


def upper_gain(cert: StructuredGainCertificate | None) -> float:
    """The bound that a certificate proves; inf if the system is not stable.

    Raises
    ------
    KposError
        The system is not positive.
    UndecidedError
        Nothing was proven.
    """
    if cert is None or cert.status is Status.UNDECIDED:
        raise UndecidedError("the gain is not known: neither a bound of it nor instability was proven.")
    if isinstance(cert.witness, PositivityViolation):
        raise KposError(f"the gain formula holds for positive systems only. {cert.positivity.explain()}")
    return cert.upper if cert else float("inf")


def _from_above(loops: _Loops, value: float) -> Iterator[Fields]:
    """Fields of proofs of an upper bound, the lowest first."""
    for part in _APART:
        upper = value * (1 + part) if value > 0 else part
        pair = loops.pair(upper)
        if all((x > 0).all() and np.isfinite(x).all() for x in pair):
            yield upper_fields(loops.plant, pair, upper)


def _from_below(plant: NetworkPlant, w: Floats) -> Iterator[Fields]:
    """Fields of proofs of a lower bound, from inputs that are amplified."""
    for least in _REACHED:
        yield from from_below(*plant.around(w, least), parts=_APART)


@dataclass(frozen=True)
class _Loops:
    """H and the equations z = c + H z / sigma."""

    plant: NetworkPlant
    known: dict[str, NetworkModel] = field(default_factory=dict)

    @classmethod
    def of(cls, plant: NetworkPlant) -> _Loops:
        return (_SingleLoops if plant.blocks.is_diagonal else _FullBlock)(plant)

    def start(self) -> Floats:
        """Some z > 0, nearly the Perron vector of H."""
        raise NotImplementedError

    def times(self, z: Floats) -> Floats:
        """H z."""
        raise NotImplementedError

    def solve(self, sigma: float, c: Floats) -> Floats:
        """z = c + H z / sigma."""
        raise NotImplementedError

    def inputs(self, z: Floats) -> Floats:
        """The inputs that belong to the Perron vector z."""
        raise NotImplementedError

    def pair(self, upper: float) -> tuple[Floats, Floats, Floats]:
        """w, u, d that prove an upper bound if they are positive."""
        raise NotImplementedError

    def largest(self) -> tuple[float, Floats]:
        """rho(H) from above, and nearly the Perron vector; 0 if H is."""
        best, z = self._from_ones(self.start())
        for _ in range(_STEPS if 0 < best < np.inf else 0):
            sigma = best * (1 + _BESIDE)
            ahead = self.solve(sigma, z)
            if not (np.isfinite(ahead).all() and (ahead > 0).all()):
                break
            now = sigma * (1 - float((z / ahead).min()))
            z = _raised(ahead)
            if not 0 < now < best * (1 - _CLOSE):
                break
            best = now
        return best, z

    def _from_ones(self, z: Floats) -> tuple[float, Floats]:
        """A bound of rho(H) and its z; where parts that H does not connect spoil the given one, from c = 1."""
        ahead = self.times(z)
        best, size = float((ahead / z).max(initial=0.0)), float(np.linalg.norm(ahead) / np.linalg.norm(z))
        for factor in _BEYOND:
            if not 2 * factor * size < best:
                break
            ahead = self.solve(factor * size, np.ones(len(z)))
            if np.isfinite(ahead).all() and (ahead > 0).all():
                return factor * size * (1 - 1 / float(ahead.max())), _raised(ahead)
        return best, z

    def _solve(self, model: NetworkModel, c: Floats, kind: str = "") -> tuple[Floats, Floats]:
        """Inputs of all nodes for the external ones c, and outputs; networks of one kind differ in weights only."""
        same_graph(self.known.setdefault(kind, model), model)
        loop = PortSystem(model, float(model.discrete)).loop
        inputs = loop.solve(c, False, _ACCURACY)
        return inputs, loop.model.apply(loop.G, inputs, 1, 2)


def _raised(z: Floats) -> Floats:
    z = z / z.max()
    return np.maximum(z, _LEAST)


class _SingleLoops(_Loops):
    """H = G, with the outputs in the order of the inputs in their blocks."""

    def start(self) -> Floats:
        z = np.ones(len(self.plant.blocks.inputs))
        for _ in range(_PRODUCTS):
            ahead = self.times(z)
            z = _raised(ahead + z * ahead.max(initial=0.0)) if ahead.any() else z
        return z

    def times(self, z: Floats) -> Floats:
        return self.plant.respond(z)[self.plant.blocks.partner]

    def inputs(self, z: Floats) -> Floats:
        return z

    def solve(self, sigma: float, c: Floats) -> Floats:
        return self._fed_back(self.plant.system.model, self.plant.external, self.plant.blocks.partner, sigma, c)

    def _fed_back(
        self, model: NetworkModel, external: Any, partner: Index, sigma: float, c: Floats, kind: str = ""
    ) -> Floats:
        """External inputs, for outputs that come back to them with the weight 1 / sigma."""
        ins, outs = external[0], external[1][partner]
        links = sp.csr_array((np.full(len(ins), 1 / sigma), (ins, outs)), shape=model.coupling.shape)
        given = np.zeros(model.totals[1])
        given[ins] = c
        closed = model.with_coupling(Matrix(sp.csr_array(model.W + links)))
        _, outputs = self._solve(closed, given, kind)
        return c + outputs[outs] / sigma

    def pair(self, upper: float) -> tuple[Floats, Floats, Floats]:
        plant, blocks, ones = self.plant, self.plant.blocks, np.ones(len(self.plant.blocks.inputs))
        w, u = self.solve(upper, ones), np.empty(len(ones))
        back = np.argsort(blocks.partner)  # the input in the block of every output
        left = self._fed_back(transposed(plant.system.model), plant.external[::-1], back, upper, ones, "transposed")
        u[blocks.partner] = w
        d = np.empty(len(ones))
        d[blocks.inputs] = left[blocks.partner] / w
        return w, u, d


class _FullBlock(_Loops):
    """H = [[0, G'], [G, 0]] on inputs and outputs, z = (w, u)."""

    @property
    def _width(self) -> int:
        return len(self.plant.blocks.inputs)

    def start(self) -> Floats:
        w = np.ones(self._width)
        for _ in range(_PRODUCTS):
            u = self.plant.respond(w)
            ahead = self.plant.gather(u)
            w = _raised(ahead) if ahead.any() else w
        u = self.plant.respond(w)
        size = np.sqrt((u**2).sum() / (w**2).sum()) or 1.0
        return np.concatenate([_raised(w) * w.max(), np.maximum(u / size, 1e-12 * w.max())])

    def times(self, z: Floats) -> Floats:
        return np.concatenate([self.plant.gather(z[self._width :]), self.plant.respond(z[: self._width])])

    def inputs(self, z: Floats) -> Floats:
        return z[: self._width]

    def solve(self, sigma: float, c: Floats) -> Floats:
        model, (ins, outs) = self.plant.system.model, self.plant.external
        both, m = beside_its_transpose(model, self.plant.external, 1 / sigma), model.totals[1]
        given = np.zeros(both.totals[1])
        given[ins], given[m + outs] = c[: self._width], c[self._width :]
        _, outputs = self._solve(both, given)
        q = model.totals[2]
        return c + np.concatenate([outputs[q + ins], outputs[outs]]) / sigma

    def pair(self, upper: float) -> tuple[Floats, Floats, Floats]:
        z = self.solve(upper, np.ones(self._width + len(self.plant.blocks.outputs)))
        return z[: self._width], z[self._width :], np.ones(1)


def transposed(model: NetworkModel) -> NetworkModel:
    """The network with all nodes and links transposed, whose DC gain is the transposed one."""
    return NetworkModel(tuple(s.transposed for s in model.stacks), model.members, Matrix(model.WT), model.dt)


def beside_its_transpose(model: NetworkModel, external: tuple[Index, Index], weight: float) -> NetworkModel:
    """A network and its transpose that feed each other: outputs with this weight to inputs of the other."""
    other, (ins, outs) = transposed(model), external
    members = (*model.members, *(index + model.n_nodes for index in other.members))
    _, m, q = model.totals
    there = sp.csr_array((np.full(len(outs), weight), (outs, outs)), shape=(q, q))
    back = sp.csr_array((np.full(len(ins), weight), (ins, ins)), shape=(m, m))
    W = sp.csr_array(sp.block_array([[model.W, back], [there, model.WT]]))
    return NetworkModel((*model.stacks, *other.stacks), members, Matrix(W), model.dt)
