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
    A, B, L : csr_array, shapes (n, n), (m, n), (m, n)
        B transposed.
    places : NetworkModel
        The sizes and cones of the nodes.
    """

    def __init__(self, A: sp.csr_array, B: sp.csr_array, L: sp.csr_array, places: NetworkModel) -> None:
        self.places, n, m = places, *B.shape[::-1]
        rows, columns, weights, factors = _terms(A, B, L)
        order, columns, begins = _sorted(rows, columns, n)
        # entries of the pattern: where other terms of its row or column begin
        first = np.ones(len(columns), dtype=bool)
        np.not_equal(columns[1:], columns[:-1], out=first[1:])
        first[begins[:-1][np.diff(begins) > 0]] = True
        first = np.flatnonzero(first)
        sums = np.append(first, len(columns)).astype(order.dtype)
        self._sums = sp.csr_array((weights[order], factors[order], sums), shape=(len(first), m + 2))
        self._indices = columns[first]
        self._indptr = np.searchsorted(first, begins).astype(order.dtype)
        rows, owner = np.repeat(np.arange(n, dtype=order.dtype), np.diff(self._indptr)), places.owners(0)
        own = owner[rows] == owner[self._indices]
        self._links = np.flatnonzero(~own)
        self._link_ends = self._indices[self._links], _pointers(rows[self._links], n)
        self._blocks = [_targets(places, g, rows, self._indices, own) for g in range(len(places.stacks))]

    def matrix(self, policy: Index, brake: float = 0.0) -> sp.csr_array:
        """The transposed closed loop."""
        data = self._sums @ np.concatenate([policy, [1.0, -brake]])
        return sp.csr_array((data, self._indices, self._indptr), shape=(len(self._indptr) - 1,) * 2)

    def network(self, transposed: sp.csr_array) -> NetworkModel:
        """A matrix of this pattern as a network."""
        links = transposed.data[self._links], *self._link_ends
        blocks = []
        for (entries, where), s in zip(self._blocks, self.places.stacks, strict=True):
            blocks.append(np.zeros((len(s), s.X.dim, s.X.dim)))
            blocks[-1][where] = transposed.data[entries]
        return of_states(blocks, sp.csr_array(links, shape=transposed.shape), self.places)


def _terms(A: sp.csr_array, B: sp.csr_array, L: sp.csr_array) -> tuple[Any, Any, Floats, Any]:
    """Places (row, column) of the terms of the transposed closed loop, their weights, and the factors of these.

    Factors 0, ..., m - 1 are the coefficients of the policy, m is 1, and m + 1 the brake.
    """
    (m, n), kind = B.shape, A.indices.dtype
    inputs, acting, gains = np.repeat(np.arange(m, dtype=kind), np.diff(B.indptr)), B.indices, B.data
    at, count, states = L.indptr[inputs], np.diff(L.indptr), np.arange(n, dtype=kind)
    if not (count == 1).all():
        count = count[inputs]
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        at, acting, inputs, gains = (np.repeat(part, count) for part in (at, acting, inputs, gains))
        at = at + within
    return (
        np.concatenate([A.indices, L.indices[at], states]),
        np.concatenate([np.repeat(states, np.diff(A.indptr)), acting, states]),
        np.concatenate([A.data, gains * L.data[at], np.ones(n)]),
        np.concatenate([np.full(A.nnz, m, dtype=inputs.dtype), inputs, np.full(n, m + 1, dtype=inputs.dtype)]),
    )


def _sorted(rows: Any, columns: Any, n: int) -> tuple[Any, Any, Any]:
    """The order of places by rows, then columns, the columns in it, and where every row begins.

    By counting, as in the transposition of a sparse matrix, and by sorting within the rows.
    """
    every = np.arange(len(rows) + 1, dtype=np.int32 if len(rows) < 2**31 - 1 else np.int64)
    counted = sp.csr_array((columns, rows, every), shape=(len(rows), n)).tocsc()
    places = sp.csr_array((counted.indices, counted.data, counted.indptr), shape=(n, n))
    places.sort_indices()
    return places.data, places.indices, places.indptr


def _pointers(rows: Any, n: int) -> Any:
    """Where the entries of every row begin, for entries in the order of their rows."""
    return np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))]).astype(rows.dtype)


def as_network(A: sp.csr_array, places: NetworkModel) -> NetworkModel:
    """x' = A x as a network of nodes with these sizes and cones, whose every state is an input and an output."""
    rows = np.repeat(np.arange(A.shape[0], dtype=A.indices.dtype), np.diff(A.indptr))
    owner = places.owners(0)
    own = owner[rows] == owner[A.indices]
    blocks = []
    for g, s in enumerate(places.stacks):
        entries, where = _targets(places, g, rows, A.indices, own)
        blocks.append(np.zeros((len(s), s.X.dim, s.X.dim)))
        blocks[-1][where] = A.data[entries]
    links = ~own & (A.data != 0)
    kept = A.data[links], A.indices[links], _pointers(rows[links], A.shape[0])
    return of_states(blocks, sp.csr_array(kept, shape=A.shape), places)


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
