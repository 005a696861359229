"""Links of nodes to themselves, closed exactly, so that W_jj belongs to node j.

With u_j = W_jj y_j + v_j and S = (I - W_jj D_j)^{-1} the node that is left between v_j and y_j is

    A + B S W_jj C,   B S,   (I + D S W_jj) C,   D S,

and v = (W without its diagonal blocks) y + w.  State, outputs, external inputs and cones are those of the network
before, and so is the closed loop; but (I) of Theorem 4 is asked of links between different nodes only, and positivity
of the nodes as they are now.  Under (I) and contracting algebraic loops W_jj and S map cones into cones, so that
whatever Theorem 4 proves of the network as it was given it proves of this one too.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..exact.distinct import distinct
from ..exact.matrix import Integers, Matrix
from .blocks import Index, take_blocks
from .coupling import entries_of, from_entries
from .model import BLOCKS, NetworkModel
from .nodes import NodeStack


def own_links(model: NetworkModel) -> tuple[Index, tuple[Index, Index, Matrix], tuple[Index, Index, Matrix]]:
    """The nodes that have links to themselves, the entries of W in these links, and those in the others."""
    rows, columns, values = entries_of(model.coupling)
    own = model.receivers.owners[rows] == model.owners(2)[columns]
    if values.is_double:
        own &= values.values != 0
    parts = [(rows[chosen], columns[chosen], values[chosen]) for chosen in (own, ~own)]
    return distinct(model.receivers.owners[rows[own]]), parts[0], parts[1]


def has_own_links(model: NetworkModel) -> bool:
    """True if some W_jj is not 0."""
    if not model.coupling.is_double:
        return bool(own_links(model)[0].size)
    W = model.W
    if model.is_ordered and model.stacks[0].sizes[1:] == (1, 1):
        return bool(W.diagonal().any())
    own = np.repeat(model.receivers.owners, np.diff(W.indptr)) == model.owners(2)[W.indices]
    return bool(W.data[own].any())


def own_links_closed(model: NetworkModel) -> NetworkModel | None:
    """The same network with W_jj as a part of every node j; None if no node has one, or I - W_jj D_j is singular.

    Exact: a node of doubles may become one of fractions.  Found once for a model; linear in its data.
    """
    if "_own_links_closed" not in model.__dict__:
        model.__dict__["_own_links_closed"] = _closed(model)
    return model.__dict__["_own_links_closed"]


def rightly_closed(model: NetworkModel) -> bool:
    """True if links of nodes to themselves were closed rightly, should they have been."""
    closed = model if model.origin is None else own_links_closed(replace(model.origin))
    return closed is not None and same_network(closed, model)


def _closed(model: NetworkModel) -> NetworkModel | None:
    nodes, _, (rows, columns, values) = own_links(model)
    if not nodes.size:
        return None
    stacks = []
    for s, index, (_, inputs, outputs) in zip(model.stacks, model.members, model.places, strict=True):
        touched = bool(np.isin(index, nodes).any())
        closed = _with_own_links(s, take_blocks(model.coupling, inputs, outputs)) if touched else s
        if closed is None:
            return None
        stacks.append(closed)
    rest = from_entries([rows], [columns], [values], (model.coupling.shape[0], model.totals[2]))
    W = Matrix(sp.csr_array(rest.values)) if rest.is_double else rest
    return NetworkModel(tuple(stacks), model.members, W, model.dt, model, model.halo)


def same_network(a: NetworkModel, b: NetworkModel) -> bool:
    """True if two networks with the same cones hold the same numbers."""
    pairs = [(a.coupling, b.coupling)]
    pairs += [(getattr(s, name), getattr(t, name)) for s, t in zip(a.stacks, b.stacks, strict=True) for name in BLOCKS]
    return all(map(_same, *zip(*pairs, strict=True)))


def _same(a: Matrix, b: Matrix) -> bool:
    if a.is_sparse or b.is_sparse:
        return a.shape == b.shape and not (sp.csr_array(a.values) != sp.csr_array(b.values)).nnz
    if a.is_double or b.is_double:
        return a.is_double and b.is_double and np.array_equal(a.values, b.values)
    p, q = a.numerators, b.numerators
    if p is None or q is None:
        return a.shape == b.shape and bool((a.fractions() == b.fractions()).all())
    return a.shape == b.shape and bool((p * b.denominator == q * a.denominator).all())


def _with_own_links(s: NodeStack, W: Matrix) -> NodeStack | None:
    """Nodes with these links (N, m, q) closed, or None if one of them is singular."""
    a, b, c, d, w = (_integers(M) for M in (s.A, s.B, s.C, s.D, W))
    around, unit = _times(w, d), np.eye(s.sizes[1], dtype=int).astype(object)
    adjugate, determinant = _inverse(unit * around[1] - around[0])
    if (determinant == 0).any():
        return None
    alike = bool((determinant == determinant[0]).all())
    S = adjugate * around[1], int(determinant[0].item()) if alike else determinant
    closed = {"A": _plus(a, _times(b, S, w, c))}
    if not s.D.is_zero:
        closed.update(B=_times(b, S), C=_plus(c, _times(d, S, w, c)), D=_times(d, S))
    return replace(s, **{name: Matrix.over(*part) for name, part in closed.items()})


def _integers(M: Matrix) -> tuple[Integers, Any]:
    """Numerators, and their denominator."""
    numerators, factor = M.as_integers()
    return numerators * Fraction(factor).numerator, Fraction(factor).denominator


def _times(*factors: tuple[Integers, Any]) -> tuple[Integers, Any]:
    out, below = factors[0]
    for numerators, denominator in factors[1:]:
        out, below = out @ numerators, below * denominator
    return out, below


def _plus(x: tuple[Integers, Any], y: tuple[Integers, Any]) -> tuple[Integers, Any]:
    return x[0] * y[1] + y[0] * x[1], x[1] * y[1]


def _inverse(P: Integers) -> tuple[Integers, Integers]:
    """Adjugates and determinants, not negative, of a stack of integer matrices (Faddeev and LeVerrier)."""
    m = P.shape[-1]
    unit = np.eye(m, dtype=int).astype(object)
    adjugate, determinant = np.broadcast_to(unit, P.shape), np.ones((len(P), 1, 1), dtype=object)
    for k in range(1, m + 1):
        image = P @ adjugate
        determinant = np.trace(image, axis1=-2, axis2=-1)[:, None, None] // k
        if k < m:
            adjugate = image * -1 + unit * determinant
    sign = np.where(determinant < 0, -1, 1).astype(object)
    return adjugate * sign, determinant * sign
