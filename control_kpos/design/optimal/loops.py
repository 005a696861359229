"""The closed loops of all policies of a network: one pattern, whose entries are linear in the policy."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...exact.matrix import Matrix
from ...networks.model import NetworkModel
from ...networks.nodes import NodeStack
from .problem import Floats, Index


class Loops:
    """(A + B diag(c) L - brake I)' for coefficients c, as networks of nodes whose every state is a port.

    Parameters
    ----------
    A, B, L : csr_array, shapes (n, n), (n, m), (m, n)
    places : NetworkModel
        The sizes and cones of the nodes.
    """

    def __init__(self, A: sp.csr_array, B: sp.csr_array, L: sp.csr_array, places: NetworkModel) -> None:
        self.places, n, m = places, A.shape[0], B.shape[1]
        count, states = np.diff(L.indptr)[B.indices], np.arange(n, dtype=np.int32)
        at, acting, inputs, gains = L.indptr[B.indices], np.repeat(states, np.diff(B.indptr)), B.indices, B.data
        if not (count == 1).all():
            within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            at, acting, inputs, gains = (np.repeat(part, count) for part in (at, acting, inputs, gains))
            at = at + within
        rows = np.concatenate([A.indices, L.indices[at], states])
        columns = np.concatenate([np.repeat(states, np.diff(A.indptr)), acting, states])
        order = _sorted(rows, columns, n)
        rows, columns = rows[order], columns[order]
        # entries of the pattern, and what they are sums of
        begins = np.ones(len(rows), dtype=bool)
        begins[1:] = (rows[1:] != rows[:-1]) | (columns[1:] != columns[:-1])
        self._first = np.flatnonzero(begins)
        self._weights = np.concatenate([A.data, gains * L.data[at], np.ones(n)])[order]
        kind = inputs.dtype
        factors = np.concatenate([np.full(A.nnz, m, dtype=kind), inputs, np.full(n, m + 1, dtype=kind)])
        self._factors = factors[order].astype(np.intp)
        rows, self._indices = rows[self._first], columns[self._first]
        self._indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
        owner = places.owners(0)
        own = owner[rows] == owner[self._indices]
        self._links = np.flatnonzero(~own)
        self._link_indptr = np.concatenate([[0], np.cumsum(np.bincount(rows[self._links], minlength=n))])
        self._blocks = [_targets(places, g, rows, self._indices, own) for g in range(len(places.stacks))]

    def matrix(self, policy: Index, brake: float = 0.0) -> sp.csr_array:
        """The transposed closed loop."""
        factors = np.concatenate([policy, [1.0, -brake]])
        data = np.add.reduceat(self._weights * factors[self._factors], self._first)
        return sp.csr_array((data, self._indices, self._indptr), shape=(len(self._indptr) - 1,) * 2)

    def network(self, transposed: sp.csr_array) -> NetworkModel:
        """A matrix of this pattern as a network."""
        links = transposed.data[self._links], self._indices[self._links], self._link_indptr
        blocks = []
        for (entries, where), s in zip(self._blocks, self.places.stacks, strict=True):
            blocks.append(np.zeros((len(s), s.X.dim, s.X.dim)))
            blocks[-1][where] = transposed.data[entries]
        return of_states(blocks, sp.csr_array(links, shape=transposed.shape), self.places)


def _sorted(rows: Any, columns: Any, n: int) -> Index:
    """The order of places by rows, then columns: two passes of counting, by the transposition of sparse matrices."""

    def counted(keys: Any) -> Index:
        every = np.arange(len(keys) + 1, dtype=np.int32 if len(keys) < 2**31 - 1 else np.int64)
        return sp.csr_array((np.ones(len(keys), dtype=np.int8), keys, every), shape=(len(keys), n)).tocsc().indices

    order = counted(columns)
    return order[counted(rows[order])]


def as_network(A: sp.csr_array, places: NetworkModel) -> NetworkModel:
    """x' = A x as a network of nodes with these sizes and cones, whose every state is an input and an output."""
    rows = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    owner = places.owners(0)
    own = owner[rows] == owner[A.indices]
    blocks = []
    for g, s in enumerate(places.stacks):
        entries, where = _targets(places, g, rows, A.indices, own)
        blocks.append(np.zeros((len(s), s.X.dim, s.X.dim)))
        blocks[-1][where] = A.data[entries]
    links = ~own & (A.data != 0)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows[links], minlength=A.shape[0]))])
    return of_states(blocks, sp.csr_array((A.data[links], A.indices[links], indptr), shape=A.shape), places)


def of_states(blocks: list[Floats], links: sp.csr_array, places: NetworkModel) -> NetworkModel:
    """Nodes x_j' = A_j x_j + u_j, y_j = x_j and their links."""
    stacks = []
    for A, s in zip(blocks, places.stacks, strict=True):
        n = s.X.dim
        eye, zero = (Matrix(np.broadcast_to(M, A.shape)) for M in (np.eye(n), np.zeros((n, n))))
        stacks.append(NodeStack(Matrix(A), eye, eye, zero, s.X, s.X, s.X, s.dt, s.names))
    return NetworkModel(tuple(stacks), places.members, Matrix(links), places.dt)


def _targets(places: NetworkModel, g: int, rows: Any, columns: Any, own: Any) -> tuple[Index, tuple[Index, ...]]:
    """Which entries of a matrix are in the nodes of a stack, and where in their blocks."""
    group, place = places.home
    owner = places.owners(0)
    mine = np.flatnonzero(own) if len(places.stacks) == 1 else np.flatnonzero(own & (group[owner[rows]] == g))
    node = owner[rows[mine]]
    first = places.offsets[0][node]
    return mine, (place[node], rows[mine] - first, columns[mine] - first)
