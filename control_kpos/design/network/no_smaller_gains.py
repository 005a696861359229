"""Proofs for networks of any size that no local gains within a bound are fast enough.

Local gains F_j with |F_j t| <= f at the generators t of X_j are refuted by d_j in X_j*, not all zero, and, for every
generator t of every X_j, weights l >= 0 of the facets h_i of X_j that are 0 on t (discrete time: of all facets) with

    sum_i (l_i - d_i) h_i'A_j t - q_j'C_j t + theta d_j't + f'|sum_i (l_i - d_i) h_i'B_j| <= 0,   d_j = sum_i d_i h_i,

theta being minus the decay rate (plus 1 in discrete time), r_j <= B_j'd_j in the order of U_j* and q_k <= (W'r)_k in
that of Y_k*.  Gains that keep all X_j have l_i h_i'(A_j + B_j F_j) t >= 0, so that d'A_cl x >= theta d'x on the product
of the X_j: the network is not faster than that.  (A combination of the rows of `NetworkProgram` that contradicts
itself, by Farkas.)  With d = 0 one < among the inequalities shows that no gain keeps one X_j.  A gain F for all nodes,
with one x for all of them, is refuted by the sums over all nodes.

Numbers are stored in the coordinates of facets, so that what must be 0 is 0; every inequality is left to the kernel,
whose work is linear in the data.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...exact.condition import Condition, all_hold
from ...exact.matrix import Matrix
from ...networks import conditions as on
from ...networks.model import NetworkModel
from ...networks.nodes import NodeStack
from ...theorems.decay_rates import Rate
from ..exact_rows import short_rows
from ..plant import leading_sizes, times

Floats = NDArray[np.float64]


class NodeRows:
    """What gains of a stack of nodes act on, exactly, in the coordinates of the facets of X.

    Attributes
    ----------
    facets, rays : Matrix, shape (n, n)
        Facet i is positive on generator i and 0 on the others.
    A, B : Matrix, shapes (N, n, n), (N, n, m)
        h_i'A and h_i'B.
    sizes : Matrix, shape (n, 1)
        Of the leading entries of the generators: |F t| <= f sizes.
    """

    def __init__(self, s: NodeStack) -> None:
        rays = short_rows(s.X.exact_rays)
        order = np.argmin(np.asarray(s.X.incidence), axis=0)
        self.facets = Matrix.from_fractions(short_rows(s.X.exact_facets, order))
        self.rays = Matrix.from_fractions(rays)
        self.sizes = Matrix.from_fractions(leading_sizes(rays)[:, None])
        self.A, self.B = times(self.facets, s.A), times(self.facets, s.B)


@dataclass(frozen=True, eq=False)
class NoSmallerGains:
    """Numbers that refute local gains within a bound; they count as far as `holds` says.

    Attributes
    ----------
    model : NetworkModel
        Simplicial state cones, D = 0.
    rows : tuple of NodeRows
        One for each stack.
    rate : float or Fraction
        Decay rate that was to be exceeded.
    bound : tuple of ndarray, shape (N, m) for each stack
        |F_j t| <= bound at generators with leading entries of 1.
    uniform : bool
        One gain, with one x for all nodes, is refuted.
    d : tuple of ndarray, shape (N, n)
        Weights of facets, >= 0.
    w : tuple of ndarray, shape (N, n, n)
        l_i - d_i, a row for each generator t.
    most : tuple of ndarray, shape (N, n, m); (1, n, m) if uniform
        No smaller than |sum_i (l_i - d_i) h_i'B|.
    r, q : ndarray, shapes (sum m_j,), (sum q_k,)
    """

    model: NetworkModel
    rows: tuple[NodeRows, ...]
    rate: Rate
    bound: tuple[Floats, ...]
    uniform: bool
    d: tuple[Floats, ...]
    w: tuple[Floats, ...]
    most: tuple[Floats, ...]
    r: Floats
    q: Floats

    def holds(self) -> bool:
        """Whether every inequality is proven, a strict one among them."""
        weights = all(map(self._is_weight, self.d, self.w))
        strict = any(part.any() for part in self.d) or any(_somewhere_negative(c) for c in self._columns)
        return weights and strict and all_hold(self.conditions())

    def conditions(self) -> list[Condition]:
        """The inequalities that the kernel has to prove."""
        return [*self._ports(), *self._sizes(), *self._columns]

    def _is_weight(self, d: Floats, w: Floats) -> bool:
        """d >= 0, and l >= 0, which is 0 at the facet opposite t in continuous time: comparisons of doubles."""
        own = np.eye(d.shape[1], dtype=bool)
        fits = (w >= -d[:, None]) if self.model.discrete else np.where(own, w == -d[:, None], w >= -d[:, None])
        return bool((d >= 0).all() and fits.all())

    def _ports(self) -> Iterator[Condition]:
        """r_j <= B_j'd_j and q_k <= (W'r)_k."""
        for g, (rows, s, d, r) in enumerate(
            zip(self.rows, self.model.stacks, self.d, self.model.split(self.r, 1), strict=True)
        ):
            middle = Matrix.join([rows.B, Matrix(-np.eye(s.sizes[1])[None])], -2)
            forms = on.stacked(on.beside(Matrix(d), Matrix(r)), middle, s.rays[1])
            yield Condition(on.titled("(d'B - r') u >= 0", self.model, g), forms, ">=")
        q, r = Matrix(-self.q), Matrix(self.r)
        yield Condition("(r'W - q') y >= 0", on.balance_forms(self.model, q, r, None), ">=")

    def _sizes(self) -> Iterator[Condition]:
        """most >= |sum_i (l_i - d_i) h_i'B|."""
        for g, (most, (w, rows)) in enumerate(zip(self.most, self._of_gains(), strict=True)):
            m = most.shape[-1]
            middle = Matrix.join([Matrix(np.eye(m)[None]), rows], -2)
            for sign in (1, -1):
                left = Matrix(np.concatenate([most, sign * w], axis=-1))
                forms = on.stacked(left, middle, Matrix.identity(m))
                yield Condition(on.titled("most >= |(l - d)'B|", self.model, g), forms, ">=")

    def _of_gains(self) -> list[tuple[Floats, Matrix]]:
        """w and h'B: of every stack, or of all nodes beside each other."""
        parts = [(w, rows.B) for w, rows in zip(self.w, self.rows, strict=True)]
        return [_beside(parts)] if self.uniform else parts

    @cached_property
    def _columns(self) -> list[Condition]:
        """The inequalities for every generator t of every X_j, or their sums over all nodes."""
        parts = []
        model, levels = self.model, [b[:1] for b in self.bound] if self.uniform else self.bound
        theta = Fraction(int(model.discrete)) - Fraction(self.rate)
        for s, rows, d, w, q in zip(model.stacks, self.rows, self.d, self.w, model.split(self.q, 2), strict=True):
            n = s.sizes[0]
            slow = Matrix.from_fractions(rows.facets.fractions() * theta)[None]
            both = [np.repeat(part[:, None], n, axis=1) for part in (-q, d)]
            parts.append((np.concatenate([w, *both], axis=-1), Matrix.join([rows.A, s.C, slow], -2)))
        parts = [_beside(parts)] if self.uniform else parts
        stacks = enumerate(zip(parts, self.most, levels, self.rows, strict=False))
        return [self._column(g, *part, most, bound, rows) for g, (part, most, bound, rows) in stacks]

    def _column(self, g: int, left: Floats, middle: Matrix, most: Floats, bound: Floats, rows: NodeRows) -> Condition:
        (height, n), m = middle.shape[-2:], most.shape[-1]
        above = Matrix.join([middle, Matrix.zeros(height, 1)], -1)
        below = Matrix.join([Matrix.zeros(1, m, n), Matrix(bound[:, :, None])], -1)
        forms = on.stacked(
            Matrix(np.concatenate([left, most], axis=-1)),
            Matrix.join([above, below], -2),
            Matrix.join([rows.rays, rows.sizes], -1),
        )
        where = np.broadcast_to(np.eye(n, dtype=bool), (len(left), n, n))
        name = "(l - d)'A t - q'C t + theta d't + f'|(l - d)'B| <= 0"
        return Condition(on.titled(name, self.model, g), forms, "<=", where)


def _beside(parts: list[tuple[Floats, Matrix]]) -> tuple[Floats, Matrix]:
    """Stacks of rows and of matrices as one product: rows beside each other, matrices below each other."""
    rows = [np.swapaxes(w, 0, 1).reshape(1, w.shape[1], -1) for w, _ in parts]
    return np.concatenate(rows, axis=-1), Matrix.join([below(M) for _, M in parts], -2)


def below(M: Matrix) -> Matrix:
    """The matrices of a stack below each other, as a stack of one."""
    if M.is_double:
        return Matrix(M.values.reshape(1, -1, M.shape[-1]))
    ints, unit = M.as_integers()
    return Matrix.over(ints.reshape(1, -1, M.shape[-1]) * unit.numerator, unit.denominator)  # type: ignore[union-attr]


def _somewhere_negative(condition: Condition) -> bool:
    return Condition("", condition.forms, ">=", condition.where).worst_violation() is not None
