"""Witnesses against a network: a link, a node, a growing direction, an algebraic loop, or its supply rates."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeAlias

import numpy as np

from ..cards import about, floored
from ..exact.condition import Condition
from ..exact.distinct import distinct
from ..exact.matrix import Matrix
from ..exact.products import exact_product
from ..exact.signs import BilinearForms
from ..proof.certificate import Fractions, Status, Vector, exactly
from ..proof.encoding import LATER, register_record
from ..proof.inclusion import PositivityViolation, row_of, worst_facet
from ..theorems.dissipativity import DissipativityCertificate, SupplyViolation
from ..theorems.positivity import PositivityCertificate
from . import conditions as on
from .blocks import Index, take_blocks
from .model import NetworkModel

LoopWeights: TypeAlias = "tuple[Matrix, Matrix] | None"

# Where `kept_parts` keeps conditions.
_KEPT = "_kept_parts"


@register_record
@dataclass(frozen=True, eq=False)
class CouplingViolation:
    """(I) fails: W_jk maps a generator of Y_k out of U_j.

    Attributes
    ----------
    target, source : int
        Node numbers j and k.
    facet, ray : int
        Row numbers in `U_j.facets` and `Y_k.rays`.
    value : float
        h'W_jk y < 0, correctly rounded.
    """

    computed: ClassVar[tuple[str, ...]] = ("facet", "value")

    target: int
    source: int
    facet: int = LATER
    ray: int = LATER
    value: float = LATER

    def __str__(self) -> str:
        product = about(self.value, digits=3)
        return (
            f"W does not map Y into U: the link from node {self.source} to node {self.target} takes generator "
            f"{self.ray} of its output cone across facet {self.facet} of its input cone (product {product} < 0)"
        )


@register_record
@dataclass(frozen=True, eq=False)
class NodeViolation:
    """Node `node` is not positive on its own cones.

    Attributes
    ----------
    node : int
    violation : PositivityViolation
    """

    node: int
    violation: PositivityViolation

    def __str__(self) -> str:
        return f"node {self.node} is not positive: {self.violation}"


@register_record
@dataclass(frozen=True, eq=False)
class NodeNotDissipative:
    """Node `node` is not exponentially dissipative for the supply rate given to it.

    Attributes
    ----------
    node : int
    q, r : ndarray
        The supply rate r'u + q'y, as the network has it.
    violation : SupplyViolation
        x and u that no storage v'x survives.
    q_exact, r_exact : tuple of Fraction, or None
        The supply rate where doubles do not suffice; q and r are its rounding.
    """

    computed: ClassVar[tuple[str, ...]] = ("q", "r", "q_exact", "r_exact")

    node: int
    q: Vector = Vector()
    r: Vector = Vector()
    violation: SupplyViolation | None = None
    q_exact: Fractions = Fractions("q")
    r_exact: Fractions = Fractions("r")

    def __str__(self) -> str:
        return f"node {self.node} is not exponentially dissipative for its supply rate: {self.violation}"


@register_record
@dataclass(frozen=True, eq=False)
class NetworkInstability:
    """x in X, x != 0, with A_cl x - rate x in X: the network has an eigenvalue of real part >= rate.

    Attributes
    ----------
    x, u, y : ndarray, shapes (sum n_j,), (sum m_j,), (sum q_k,)
        State, and lower bounds in the orders of U and Y on the inputs and outputs that belong to it.
    rate : float
        0 or more in continuous time, 1 or more in discrete time.
    exact : tuple of three tuples of Fraction, or None
        x, u and y where doubles do not suffice; those above are their rounding.
    """

    x: Vector = Vector(required=True)
    u: Vector = Vector(required=True)
    y: Vector = Vector(required=True)
    rate: float = 0.0
    exact: Fractions = Fractions("x", "u", "y")

    @property
    def vectors(self) -> tuple[Matrix, Matrix, Matrix]:
        """x, u and y as the proof takes them."""
        return exactly(self, "x"), exactly(self, "u"), exactly(self, "y")

    def __str__(self) -> str:
        alive = int(np.count_nonzero(self.x))
        return (
            f"the network does not decay along a state x in X with {alive} nonzero entries "
            f"(growth rate at least {floored(self.rate, 3)})"
        )


@register_record
@dataclass(frozen=True, eq=False)
class AlgebraicLoop:
    """y in Y, y != 0, with D W y - y in Y: instantaneous loop gain 1 or more.

    Attributes
    ----------
    y, u : ndarray, shapes (sum q_k,), (sum m_j,)
        u is a lower bound on W y in the order of U.
    nodes : ndarray of int
        The nodes in the loop: those where y is not 0.
    exact : tuple of two tuples of Fraction, or None
        y and u where doubles do not suffice; those above are their rounding.
    """

    computed: ClassVar[tuple[str, ...]] = ("nodes",)

    y: Vector = Vector(required=True)
    u: Vector = Vector(required=True)
    nodes: Any = None
    exact: Fractions = Fractions("y", "u")

    @property
    def vectors(self) -> tuple[Matrix, Matrix]:
        """y and u as the proof takes them."""
        return exactly(self, "y"), exactly(self, "u")

    def __str__(self) -> str:
        return f"the feedthrough terms D close an algebraic loop of gain 1 or more through {list_nodes(self.nodes)}"


@register_record
@dataclass(frozen=True, eq=False)
class NoWeights:
    """No sigma > 0 satisfies (III') for the supply rates.

    Attributes
    ----------
    y : ndarray, shape (sum q_k,)
        Outputs y in Y with q_j'y_j + r_j'(W y)_j >= 0 for every node j, and > 0 for one.
    """

    y: Vector = Vector(required=True)

    def __str__(self) -> str:
        return (
            "no weights sigma > 0 satisfy (III') for these supply rates: there are outputs for which no node's supply "
            f"q'y + r'W y is negative ({int(np.count_nonzero(self.y))} outputs involved)"
        )


def list_nodes(nodes: Any, most: int = 6) -> str:
    """Node numbers in words."""
    numbers = [str(int(j)) for j in np.asarray(nodes)[:most]]
    return "nodes " + ", ".join(numbers) + (", ..." if len(nodes) > most else "")


def node_positivity(model: NetworkModel, node: int) -> PositivityCertificate:
    """Theorem 1 for one node, as a certificate without a witness."""
    return PositivityCertificate.settle(**model.data_of(node))


def refute(model: NetworkModel, w: Any, loop: LoopWeights) -> list[Condition] | None:
    """The inequalities that prove a witness, or None if it makes no sense."""
    if isinstance(w, CouplingViolation):
        return _coupling(model, w)
    if isinstance(w, NodeViolation):
        part = node_positivity(model, w.node)
        found = replace(part, witness=w.violation, status=Status.UNDECIDED).refutation()
        return None if found is None else list(found)
    if isinstance(w, NodeNotDissipative):
        part = node_positivity(model, w.node)
        q, r = exactly(w, "q"), exactly(w, "r")
        found = DissipativityCertificate.settle(positivity=part, q=q, r=r, witness=w.violation)
        if found.status is not Status.REFUTED:
            return None
        return [*positive_parts(model), *found._own_conditions]
    if isinstance(w, NetworkInstability):
        return growth(model, w, loop)
    if isinstance(w, AlgebraicLoop):
        all_y, all_u = w.vectors
        if not np.any(w.y) or not np.array_equal(w.nodes, nodes_in_loop(model, all_y)):
            return None
        out = positive_parts(model) + on.emitted(model, all_y)
        for g, (y, u) in enumerate(zip(model.split(all_y, 2), model.split(all_u, 1), strict=True)):
            s = model.stacks[g]
            middle = Matrix.join([s.D, Matrix(-np.eye(s.sizes[2])[None])], -1)
            forms = on.stacked(on.facets(s.Y), middle, on.beside(u, y))
            out.append(Condition(on.titled("h'(D u - y) >= 0", model, g), forms, ">="))
        return [*out, on.received(model, all_u, all_y)]
    return None


def positive_parts(model: NetworkModel) -> list[Condition]:
    """All nodes positive, and (I)."""
    kept = vars(model).get(_KEPT, [])
    if not kept:
        kept += [c for g in range(len(model.stacks)) for c in on.positivity(model, g)] + on.coupling(model)
    return list(kept)


@contextmanager
def kept_parts(model: NetworkModel) -> Iterator[None]:
    """Within, `positive_parts` of this network are the same conditions each time, and evaluated once."""
    vars(model)[_KEPT] = []
    try:
        yield
    finally:
        vars(model).pop(_KEPT, None)  # they are large


def growth(model: NetworkModel, w: NetworkInstability, loop: LoopWeights) -> list[Condition] | None:
    """A_cl x - rate x in X with a rate that excludes stability, for a positive network."""
    least = 1.0 if model.discrete else 0.0
    if not np.any(w.x) or not w.rate >= least:
        return None
    return below_abscissa(model, w, loop)


def below_abscissa(model: NetworkModel, w: NetworkInstability, loop: LoopWeights) -> list[Condition] | None:
    """A_cl x - rate x in X for a positive network: its spectral abscissa is at least the rate."""
    if any(part.shape != (total,) for part, total in zip(w.vectors, model.totals, strict=True)):
        return None
    out = positive_parts(model)
    if model.has_feedthrough:
        if loop is None:
            return None
        out += on.loop_gain(model, *loop)
    return out + list(on.motion(model, *w.vectors, w.rate))


def coupling_violation(model: NetworkModel, target: int, source: int, facet: int, ray: int) -> CouplingViolation:
    """The violation of (I) by this facet and generator, with their product."""
    h, block, y = _pair(model, target, source, facet, ray)
    value = exact_product(exact_product(h, block.T), y).values.item()
    return CouplingViolation(target, source, facet, ray, value)


def nodes_in_loop(model: NetworkModel, y: Matrix) -> Index:
    """The nodes with outputs that are not 0."""
    return distinct(model.owners(2)[y.values != 0])


def node_supply(model: NetworkModel, certificate: Any, node: int) -> tuple[Matrix, Matrix]:
    """q and r that a certificate has for a node."""
    ranges = (np.arange(*model.offsets[kind][node : node + 2]) for kind in (2, 1))
    q, r = (exactly(certificate, name)[places] for name, places in zip("qr", ranges, strict=True))
    return q, r


def restated(certificate: Any) -> Any:
    """The witness of a certificate from a file, with what files leave out.

    Raises
    ------
    KposError, IndexError
        It names things that are not there.
    """
    model, w = certificate.model, certificate.witness
    if isinstance(w, CouplingViolation):
        y, block, facets = _parts(model, w.target, w.source, w.ray)
        facet = worst_facet(y, block, facets, flow=False)
        return coupling_violation(model, w.target, w.source, facet, w.ray)
    if isinstance(w, NodeViolation):
        part = replace(node_positivity(model, w.node), witness=w.violation)
        return replace(w, violation=part.restated())
    if isinstance(w, NodeNotDissipative):
        return NodeNotDissipative(w.node, *node_supply(model, certificate, w.node), w.violation)
    return replace(w, nodes=nodes_in_loop(model, exactly(w, "y"))) if isinstance(w, AlgebraicLoop) else w


def _coupling(model: NetworkModel, w: CouplingViolation) -> list[Condition] | None:
    if coupling_violation(model, w.target, w.source, w.facet, w.ray).value != w.value:
        return None
    return [Condition("h'W y < 0", BilinearForms(*_pair(model, w.target, w.source, w.facet, w.ray)), "<")]


def _pair(model: NetworkModel, target: int, source: int, facet: int, ray: int) -> tuple[Matrix, Matrix, Matrix]:
    """A facet of U_j, W_jk and a generator of Y_k."""
    y, block, facets = _parts(model, target, source, ray)
    return row_of(facets, facet), block, y


def _parts(model: NetworkModel, target: int, source: int, ray: int) -> tuple[Matrix, Matrix, Matrix]:
    """A generator of Y_k, W_jk and the facets of U_j."""
    to, (gk, _) = model.receivers, model.locate(source)
    if not 0 <= target < len(to.kinds):
        model.locate(target)  # which says that there is no such node
    rows = np.arange(to.starts[target], to.starts[target + 1])[None]
    columns = np.arange(model.offsets[2][source], model.offsets[2][source + 1])[None]
    block = take_blocks(model.coupling, rows, columns)[0]
    return row_of(model.stacks[gk].rays[2], ray), block, on.facets(to.cones[to.kinds[target]])
