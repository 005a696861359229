"""Arguments of `optimal_feedback`: the plant with its controls, costs, limits and blocks, for systems and networks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp

from ...cones import Cone, orthant
from ...errors import DataError, ShapeError
from ...exact.intake import dimensions, exact_matrix, exact_number, flag, items, require_shape, whole_number
from ...exact.layers import sparse_product, tower
from ...exact.matrix import Matrix
from ...networks.closed_loop import EXACT_STATES
from ...networks.model import NetworkModel
from ...networks.network import ConeNetwork
from ...systems.system import System
from ..plant import in_sparse_form, times
from .network_problem import NetworkCost
from .node_cones import NodeCones
from .problem import CONTROL, DISTURBANCE, GROUP, SHARED, Index, LinearCost

P = TypeVar("P", bound=LinearCost)


@dataclass(frozen=True)
class Question:
    """What is asked of a plant, as it was given; see `optimal_feedback`."""

    s: Any
    r: Any
    limits: Any
    groups: Any
    use_all: Any
    disturbance: Any
    discount: Any

    def of(self, kind: type[P], A: Matrix, B: Matrix, X: Cone, discrete: bool, nodes: int = 0) -> P:
        """The problem, for a network (of so many nodes) in sparse matrices."""
        n, m = X.dim, B.shape[1]
        sparse = issubclass(kind, NetworkCost)
        form = in_sparse_form if sparse else _dense
        states = of_states(self.s, "s", n, nodes)
        inputs = _row(self.r, "r", m, "input of sys (or column of controls)")
        owner, kinds = _blocks(self.groups, m, flag(self.use_all, "use_all"))
        L = exact_matrix(self.limits, "limits")
        require_shape(L, "limits", (len(kinds), n), "one row per input (per group), one column per state")
        L = form(L, "limits")
        if self.disturbance is not None:
            G, sizes = (form(part, name) for part, name in zip(*_disturbance(self.disturbance, n), strict=True))
            owner = np.concatenate([owner, len(kinds) + np.arange(G.shape[1])])
            kinds = np.concatenate([kinds, np.full(G.shape[1], DISTURBANCE)])
            if sparse:  # as part of the first layer
                G = Matrix(
                    sp.csr_array(
                        (G.values.data, G.values.indices, _longer(G.values.indptr, B.shape[0])),
                        shape=(B.shape[0], G.shape[1]),
                    )
                )
            B, L = Matrix.join([B, G], -1), Matrix.join([L, sizes], -2)
            inputs = Matrix.join([inputs, Matrix.zeros(1, G.shape[1])], -1)
        return kind(A, B, X, discrete, states, inputs, L, owner, kinds, _discount(self.discount, discrete))


def of_states(values: Any, name: str, n: int, nodes: int) -> Matrix:
    """Costs of the states as a row; of a network of so many nodes also one row a node."""
    return _row(_flat(values, name, nodes), name, n, "state of sys")


def _longer(indptr: Index, rows: int) -> Index:
    """Row pointers of a sparse matrix with empty rows at its end."""
    return np.concatenate([indptr, np.full(rows + 1 - len(indptr), indptr[-1])])


def _disturbance(disturbance: Any, n: int) -> tuple[tuple[Matrix, Matrix], tuple[str, str]]:
    """How it enters and its limits, and what these are called."""
    pair, names = items(disturbance, "disturbance"), ("disturbance G", "disturbance M")
    if len(pair) != 2:
        raise ShapeError("disturbance must be a pair (G, M): how it enters, and its limits.")
    G, sizes = (exact_matrix(part, name) for part, name in zip(pair, names, strict=True))
    require_shape(G, names[0], (n, None), "one row per state")
    require_shape(sizes, names[1], (G.shape[1], n), "one row per column of G, one column per state")
    return (G, sizes), names


def _dense(M: Matrix, name: str) -> Matrix:
    return M.dense()


def controlled(plant: System, controls: Any) -> System:
    """The plant with mu in the place of u = controls mu, on the orthant."""
    plant.X.require_proper("X")
    if controls is None:
        return plant
    mix = _mix(controls, plant.sizes[1])
    mixed = {name: times(getattr(plant, name), mix.dense()) for name in "BD"}
    return replace(plant, **mixed, U=orthant(mix.shape[1]))


def _mix(controls: Any, inputs: int) -> Matrix:
    mix = exact_matrix(controls, "controls")
    require_shape(mix, "controls", (inputs, None), "one row per input of sys, one column per control")
    if not mix.shape[1]:
        raise ShapeError("controls has no columns; give one column per control.")
    return mix


def goes_sparse(sys: Any, limits: Any, X: Any) -> bool:
    """True for networks of more than 300 states, and for smaller ones with sparse limits unless they hold fractions."""
    if not isinstance(sys, ConeNetwork):
        return False
    sys.require_certain()
    if sys.nstates > EXACT_STATES or X is not None or not sp.issparse(limits):
        return sys.nstates > EXACT_STATES
    return _holds_doubles(sys.model) and not sys.model.has_feedthrough and NodeCones(sys.X).are_doubles


def _holds_doubles(model: NetworkModel) -> bool:
    given = [getattr(s, name) for s in model.stacks for name in "ABC"]
    return all(M.is_double for M in [*given, model.coupling])


def closed_loop_of(net: ConeNetwork, controls: Any) -> tuple[Matrix, Matrix]:
    """A + B W C, and B from the external inputs or the controls, as towers that are exact."""
    model = net.model
    if model.has_feedthrough:
        raise DataError(
            f"networks with feedthrough D are taken up to {EXACT_STATES} states; this one has more. Close the direct "
            "paths first: link states by the entries of sparse_A, which are rounded, and let controls act by sparse_B."
        )
    if not _holds_doubles(model):
        raise DataError(
            f"nodes and links of a network with more than {EXACT_STATES} states must hold doubles. Round the fractions "
            "yourself: what is proven is then about the rounded numbers."
        )
    a, b, c = (sp.csr_array(M, copy=True) for M in model.block_matrices[:3])
    for M in (a, b, c):
        M.eliminate_zeros()
    linked = [term for heard in sparse_product(model.W, c) for term in sparse_product(b, heard)]
    b = sp.csr_array(b[:, net.external[0]])
    if controls is None:
        return tower([a, *linked]), Matrix(b)
    return tower([a, *linked]), tower(sparse_product(b, in_sparse_form(_mix(controls, b.shape[1]), "controls").values))


def _flat(values: Any, name: str, nodes: int) -> Any:
    """Numbers of the states of nodes of one size, one row a node, as one row."""
    rows = _read(values, name)
    if not nodes or rows.shape[0] != nodes or rows.shape[0] == 1:
        return rows
    return (
        Matrix(rows.dense().values.reshape(1, -1))
        if rows.is_double
        else Matrix.from_fractions(rows.fractions().reshape(1, -1))
    )


def _read(values: Any, name: str) -> Matrix:
    """Numbers as a row, or as the rows they were given in; errors call those of a list by their one place."""
    return exact_matrix(values, name, ndim=1)[None] if dimensions(values) == 1 else exact_matrix(values, name)


def _row(values: Any, name: str, size: int, of: str) -> Matrix:
    row = values if isinstance(values, Matrix) else _read(values, name)
    if row.shape != (1, size):
        shape = row.shape[1:] if row.shape[0] == 1 else row.shape
        raise ShapeError(f"{name} has shape {shape}; it must be ({size},), one number per {of}.")
    return row.dense()


def _blocks(groups: Any, m: int, use_all: bool) -> tuple[Index, Index]:
    if groups is None:
        if use_all:
            raise DataError("use_all is about groups; give groups=, such as one group of all inputs.")
        return np.arange(m), np.full(m, CONTROL)
    if isinstance(groups, np.ndarray) and groups.ndim == 1 and groups.dtype.kind in "iu":
        owner = _labelled(groups, m)
        return owner, np.full(owner.max() + 1, SHARED if use_all else GROUP)
    listed = items(groups, "groups")
    if any(isinstance(group, (int, np.integer)) for group in listed):
        raise DataError("groups holds numbers; give a list of inputs for each group, or an array of the group of each.")
    given = [[whole_number(i, "groups") for i in items(group, "groups")] for group in listed]
    flat = [i for group in given for i in group]
    if not all(given) or sorted(flat) != list(range(m)):
        raise DataError(f"groups must hold each of the {m} inputs, 0 to {m - 1}, once, and none may be empty.")
    owner = np.empty(m, dtype=np.intp)
    for g, group in enumerate(given):
        owner[group] = g
    return owner, np.full(len(given), SHARED if use_all else GROUP)


def _labelled(groups: Any, m: int) -> Index:
    """The group of every input, from an array of them."""
    inside = groups.shape == (m,) and m > 0 and groups.min() >= 0 and groups.max() < m
    if not inside or not np.bincount(groups).all():
        raise DataError(f"groups must hold the group of each of the {m} inputs: 0, 1, ..., and none may be empty.")
    return groups.astype(np.intp)


def _discount(discount: Any, discrete: bool) -> Fraction:
    if discount is None:
        return Fraction(int(discrete))
    rate = exact_number(discount, "discount", positive=discrete, nonnegative=not discrete)
    if discrete and rate > 1:
        raise DataError(f"discount is {discount}; in discrete time it must be at most 1.")
    return rate
