"""Ranges that change sign: bounds of what is in them, and members that have these bounds in other coordinates.

On orthants everything in a range [L, H] is at most the bound max(|L|, |H|) in absolute value, entry by entry; in
continuous time the diagonal of A is at most that of H.  If s_j = 1 or -1, the states, inputs and outputs of node j
times s_j turn W_jk into s_j W_jk s_k and leave the nodes as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...cones import Orthant
from ...exact.matrix import Matrix
from ..blocks import Floats
from ..conditions import same_numbers
from ..coupling import entries_of, from_entries
from ..model import BLOCKS, NetworkModel
from ..nodes import NodeStack
from .members import Vertices


def bounds_of(models: Vertices, lower: NetworkModel) -> Vertices:
    """The networks of the bounds, vertex by vertex; what is not on orthants keeps its upper ends."""
    first, known = models[0], dict[int, NodeStack]()

    def bounded(g: int, s: NodeStack) -> NodeStack:
        if id(s) not in known:
            high, low = first.stacks[g], lower.stacks[g]
            parts = {name: (getattr(high, name), getattr(low, name)) for name in BLOCKS}
            given = {name: _bound(*ends) for name, ends in parts.items() if not same_numbers(*ends)}
            if "A" in given and not first.discrete:
                given["A"] = _with_diagonal(given["A"], high.A)
            known[id(s)] = replace(s, **given) if given else s
        return known[id(s)]

    W = _of_links(first, lower)
    return tuple(NetworkModel(tuple(bounded(g, s) for g, s in enumerate(m.stacks)), m.members, W, m.dt) for m in models)


def _bound(high: Matrix, low: Matrix) -> Matrix:
    """max(|low|, |high|), entry by entry, exactly."""
    if high.is_sparse and high.is_double and low.is_double:
        return Matrix(sp.csr_array(abs(high.values).maximum(abs(sp.csr_array(low.values)))))
    if high.is_double and low.is_double:
        return Matrix(np.maximum(np.abs(high.values), np.abs(low.values)))
    a, b = (M.dense().fractions() for M in (high, low))
    return Matrix.from_fractions(np.maximum(np.abs(a), np.abs(b)))


def _with_diagonal(bound: Matrix, high: Matrix) -> Matrix:
    """A stack of bounds of A with the diagonals of the upper ends."""
    on = np.broadcast_to(np.eye(high.shape[-1], dtype=bool), high.shape)
    if bound.is_double and high.is_double:
        return Matrix(np.where(on, high.values, bound.values))
    return Matrix.from_fractions(np.where(on, high.fractions(), bound.fractions()))


def _of_links(high: NetworkModel, low: NetworkModel) -> Matrix:
    """The bound of W between orthants, and its upper end elsewhere."""
    if same_numbers(high.coupling, low.coupling):
        return high.coupling
    bound = _bound(high.coupling, low.coupling)
    plain = [np.zeros(high.n_nodes, dtype=bool) for _ in range(2)]
    for s, index in zip(high.stacks, high.members, strict=True):
        plain[0][index], plain[1][index] = isinstance(s.U, Orthant), isinstance(s.Y, Orthant)
    to, of = plain[0][high.owners(1)], plain[1][high.owners(2)]
    if to.all() and of.all():
        return bound
    parts = [entries_of(M) for M in (bound, high.coupling)]
    inside = [to[rows] & of[columns] for rows, columns, _ in parts]
    kept = zip((inside[0], ~inside[1]), parts, strict=True)
    rows, columns, values = zip(*((r[k], c[k], v[k]) for k, (r, c, v) in kept), strict=True)
    return from_entries(list(rows), list(columns), list(values), high.totals[1:])


def turned_signs(high: NetworkModel, low: NetworkModel, signs: Floats) -> NetworkModel:
    """The member with upper ends between nodes of one sign and lower ends between others, with its nodes turned."""
    to, of = signs[high.owners(1)], signs[high.owners(2)]
    (i, k, up), (a, b, down) = entries_of(high.coupling), entries_of(low.coupling)
    alike, apart = to[i] == of[k], to[a] != of[b]
    values = [up[alike], -down[apart]]
    return high.with_coupling(from_entries([i[alike], a[apart]], [k[alike], b[apart]], values, high.totals[1:]))


def largest_signs(high: NetworkModel, low: NetworkModel) -> Floats | None:
    """Signs with which `turned_signs` has the largest links, or None if there are none for all of them at once.

    Nodes of a link that is larger at its upper (lower) end have one sign (two signs): a graph of both signs of nodes.
    """
    n = high.n_nodes
    apart = sp.coo_array(high.W + low.W)  # > 0 where the upper end is the larger one
    j, k = high.owners(1)[apart.coords[0]], high.owners(2)[apart.coords[1]]
    turned = apart.data < 0
    chosen = apart.data != 0
    j, k, turned = j[chosen], k[chosen], turned[chosen]
    rows = np.concatenate([j, j + n])
    columns = np.concatenate([k + n * turned, k + n * ~turned])
    graph = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n))
    label = connected_components(graph, directed=False)[1]
    return None if (label[:n] == label[n:]).any() else np.where(label[:n] < label[n:], 1.0, -1.0)
