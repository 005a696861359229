"""Linear cost under limits that grow with the state: the data, and the Bellman operator on vectors.

x' = A x + B mu (x[k+1] in discrete time), x in X, and every column of B belongs to one block g with a row l_g of the
limits, l_g in X*:

    a control          |mu_i| <= l_i'x,
    a group            mu_g >= 0,  1'mu_g <= l_g'x   (or = l_g'x),
    a disturbance      |w_j| <= l_j'x, chosen by somebody who maximises.

The cost is the sum (integral) of s'x + r'mu.  With y = r + B'p let m_g(y) be the least of y_g'mu_g over mu_g with
l_g'x = 1, for disturbances the largest: -|y_i|, min(0, min y_g), min y_g, |y_j|.  The Bellman residual is

    D(p) = s + (A - I)'p + sum_g m_g(r + B'p) l_g      (continuous time: A in place of A - I),

and the optimal cost of x is p'x, where p in X* has D(p) = 0 (Rantzer 2022; Li and Rantzer, arXiv:2306.02072, for the
orthant; docs/guide/optimal.md for cones).  A discount multiplies A and B by beta, or subtracts rho I from A.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...cones import Cone
from ...exact.condition import Condition
from ...exact.matrix import Matrix, bit_length
from ...exact.signs import BilinearForms
from ..plant import shifted, times

Floats = NDArray[np.float64]
Index = NDArray[np.intp]

CONTROL, GROUP, SHARED, DISTURBANCE = range(4)
# Names of the conditions.
LIMITS, KEPT, COSTS = "l'x >= 0", "h'(A x + B mu) >= 0", "s'x + r'mu > 0"
INSIDE, ABOVE, BELOW = "upper'x >= 0", "D(upper)'x <= 0", "D(lower)'x >= 0"
ADMITTED = "l'x +- F x >= 0"
# Binary digits after which costs of steps are rounded, safely.
LONGEST = 2000
# The fields that say which columns of B go together.
BLOCKS = ("owner", "kinds")


@dataclass(frozen=True, eq=False)
class LinearCost:
    """An optimal control problem with linear cost.

    Attributes
    ----------
    A, B : Matrix, shapes (n, n), (n, m)
        Columns of B: controls, then disturbances.
    X : Cone
    discrete : bool
    s, r : Matrix, shapes (1, n), (1, m)
        Costs of states and inputs; 0 for disturbances.
    limits : Matrix, shape (G, n)
    owner : ndarray of int, shape (m,)
        The block of each column: a row of `limits`.
    kinds : ndarray of int, shape (G,)
        CONTROL, GROUP, SHARED (a group that uses up its limit) or DISTURBANCE.
    discount : Fraction
        Continuous time: rho >= 0.  Discrete time: beta in (0, 1].
    """

    A: Matrix
    B: Matrix
    X: Cone
    discrete: bool
    s: Matrix
    r: Matrix
    limits: Matrix
    owner: Index
    kinds: Index
    discount: Fraction

    @cached_property
    def discounted(self) -> tuple[Matrix, Matrix]:
        """A - I and B with the discount in them (A - rho I in continuous time)."""
        if not self.discrete:
            return shifted(self.A, -self.discount), self.B
        if self.discount == 1:
            return shifted(self.A, -1), self.B
        scaled = [times(M, shifted(Matrix.zeros(M.shape[1], M.shape[1]), self.discount)) for M in (self.A, self.B)]
        return shifted(scaled[0], -1), scaled[1]

    @cached_property
    def rows(self) -> Matrix:
        """s, the limits, and A - I below each other: what a left factor (1, m, p) of a Bellman residual multiplies."""
        return Matrix.join([self.s, self.limits, self.discounted[0]], -2)

    @cached_property
    def rows_and_states(self) -> Matrix:
        """The same with I below, for costs of one step more."""
        return Matrix.join([self.rows, Matrix.identity(self.X.dim)], -2)

    @cached_property
    def rays(self) -> Matrix:
        """The generators of X."""
        return self.X.exact_rays

    def fits(self) -> bool:
        """True if A and B have the sizes of X and of the columns."""
        n = self.X.dim
        return self.A.shape == (n, n) and self.B.shape == (n, len(self.owner))

    # -- what the blocks make of a row y

    def best(self, y: Any) -> Any:
        """m_g(y) for every row of y; shape (k, G)."""
        out = self._by_block(np.minimum, y)
        out[:, self.kinds == GROUP] = np.minimum(out[:, self.kinds == GROUP], 0)
        return self._with_sizes(out, y, CONTROL, -1)

    def worst(self, y: Any) -> Any:
        """The least of y_g'mu_g for disturbances too, for every row of y; shape (k, G)."""
        out = self.best(y)
        out[:, self.kinds == DISTURBANCE] *= -1
        return out

    def under(self, policy: Index, y: Any) -> Any:
        """What a policy of the controls makes of y, against the best disturbance; shape (k, G)."""
        return self._with_sizes(self._by_block(np.add, y * policy), y, DISTURBANCE, 1)

    def policy(self, y: Floats) -> Index:
        """The coefficients of the columns that reach m_g(y) for one row y: mu_i = coefficient l_g'x; 0 for ties."""
        kind, sign = self.kinds[self.owner], np.sign(y).astype(np.intp)
        if (kind == CONTROL).all():
            return -sign
        least = self._by_block(np.minimum, y[None])[0][self.owner]
        first = np.zeros(len(y), dtype=np.intp)
        candidates = np.flatnonzero((y <= least) & ((kind == SHARED) | (least < 0)))
        first[candidates[np.unique(self.owner[candidates], return_index=True)[1]]] = 1
        return np.where(kind == CONTROL, -sign, np.where(kind == DISTURBANCE, sign, first))

    def is_policy(self, policy: Any) -> bool:
        """True if the coefficients respect the limits of the controls, whatever they are for disturbances."""
        c, kind = np.asarray(policy), self.kinds[self.owner]
        if c.shape != kind.shape or c.dtype.kind != "i" or (np.abs(c) > 1).any():
            return False
        used = np.bincount(self.owner, c, minlength=len(self.kinds))
        groups, shared = self.kinds == GROUP, self.kinds == SHARED
        grouped = (kind == GROUP) | (kind == SHARED)
        return bool((c[grouped] >= 0).all() and (used[groups] <= 1).all() and (used[shared] == 1).all())

    @cached_property
    def apart(self) -> bool:
        """True if every column is a block of its own, in their order."""
        return np.array_equal(self.owner, np.arange(len(self.kinds)))

    def _by_block(self, ufunc: np.ufunc, y: Any) -> Any:
        if self.apart:
            return y.copy()
        order = np.argsort(self.owner, kind="stable")
        starts = np.searchsorted(self.owner[order], np.arange(len(self.kinds)))
        return ufunc.reduceat(y[:, order], starts, axis=1) if len(starts) else y[:, :0]

    def _with_sizes(self, out: Any, y: Any, kind: int, sign: int) -> Any:
        """Blocks of one column that are chosen by size: of disturbances always, of controls if asked for."""
        column = np.empty(len(self.kinds), dtype=np.intp)
        column[self.owner] = np.arange(len(self.owner))
        for some, factor in {(kind, sign), (DISTURBANCE, 1)}:
            at = self.kinds == some
            out[:, at] = np.abs(y[:, column[at]]) * factor
        return out

    # -- exact forms

    def inputs_of(self, p: Matrix) -> Matrix:
        """r + B'p for a row p, with the discount."""
        return _sum(self.r, times(p, self.discounted[1]))

    def residual(self, p: Matrix, policy: Index | None = None, before: Matrix | None = None) -> BilinearForms:
        """D(p)'x on the generators x; with a policy, what it makes of p instead of the best one.

        With a row `before`, (D(p) + p - before)'x: zero where `before` is p one step earlier.
        """
        y, unit = self.inputs_of(p).as_integers()
        parts = self.best(y) if policy is None else self.under(policy.astype(object), y)
        left = [Matrix.identity(1), over(parts, unit), p]
        if before is None:
            return BilinearForms(Matrix.join(left, -1), self.rows, self.rays)
        return BilinearForms(Matrix.join([*left, _sum(p, -before)], -1), self.rows_and_states, self.rays)

    # -- any gain

    def paid(self, p: Matrix, gain: Matrix) -> BilinearForms:
        """What D(p)'x becomes for mu = gain x, without disturbances."""
        left = Matrix.join([Matrix.identity(1), p, Matrix.identity(1)], -1)
        middle = Matrix.join([self.s, self.discounted[0], times(self.inputs_of(p), gain)], -2)
        return BilinearForms(left, middle, self.rays)

    def admits(self, gain: Matrix) -> Condition:
        """mu = gain x is admissible for all x in X: a row of signs of limits and of inputs for every inequality."""
        kind, (m, G) = self.kinds[self.owner], (len(self.owner), len(self.kinds))
        single, limited, shared = (
            np.flatnonzero(at) for at in (kind == CONTROL, self.kinds != CONTROL, self.kinds == SHARED)
        )
        grouped = np.flatnonzero(kind != CONTROL)
        owned, inputs, blocks = np.eye(G)[self.owner], np.eye(m), np.eye(G)
        rows = [
            *(np.hstack([owned[single], sign * inputs[single]]) for sign in (1, -1)),
            np.hstack([0 * owned[grouped], inputs[grouped]]),
            np.hstack([blocks[limited], -owned.T[limited]]),
            np.hstack([-blocks[shared], owned.T[shared]]),
        ]
        middle = Matrix.join([self.limits, gain], -2)
        return Condition(ADMITTED, BilinearForms(Matrix(np.vstack(rows)), middle, self.rays), ">=")

    # -- one step more, in discrete time

    def earlier(self, p: Matrix) -> tuple[Matrix, Index, Floats | None]:
        """D(p) + p for a row p, the optimal cost of one step more, with the policy of that step.

        The third is None if the row is exact; else it is rounded, and its error on the generators is less than 2^-45
        of these sizes.
        """
        y, unit = self.inputs_of(p).as_integers()
        left = Matrix.join([Matrix.identity(1), over(self.best(y), unit), p, p], -1)
        moved = Matrix.from_fractions(times(left, self.rows_and_states).fractions())
        numbers, unit = moved.as_integers()
        if bit_length(np.append(numbers, Fraction(unit).denominator)) < LONGEST:
            return moved, self.policy(y[0]), None
        sizes = np.abs(np.asarray(self.rays.values)) @ np.abs(moved.values[0])
        return Matrix(moved.values), self.policy(y[0]), sizes

    @cached_property
    def heights(self) -> sp.csr_array:
        """h'x in floating point for facets h and generators x where it is positive."""
        products = np.asarray(self.X.facets) @ np.asarray(self.X.rays).T
        return sp.csr_array(np.where(self.X.incidence, 0.0, products))

    @cached_property
    def normals(self) -> Any:
        """Facet normals in floating point, one a row."""
        return np.asarray(self.X.facets)

    def covering(self, sizes: Floats) -> Floats:
        """A row e with e'x >= size on every generator x, as computed: sum_h h max_x (size / h'x) over h'x > 0."""
        G = self.heights
        return np.maximum.reduceat(sizes[G.indices] / G.data, G.indptr[:-1]) @ self.normals

    def near(self, facet: int, generator: int) -> tuple[Any, Any, LinearCost, Index]:
        """A facet h and a generator x in fractions, the part of the problem that h'A x, B'h and l'x are about, and
        the numbers of its columns.
        """
        sides = (self.X.exact_facets, facet), (self.X.exact_rays, generator)
        h, x = (rows.plain().fractions()[k] for rows, k in sides)
        return h, x, self, np.arange(len(self.owner))

    def bracket(self, lower: Matrix, upper: Matrix, policy: Index) -> list[Condition]:
        """What proves that lower'x is below the optimal cost, and upper'x above that of a policy; rows lower, upper."""
        inside = Condition(INSIDE, BilinearForms(upper, None, self.rays), ">=")
        return [inside, *self.above(upper, policy), *self.below(lower)]

    def above(self, upper: Matrix, policy: Index, before: Matrix | None = None, step: str = "") -> list[Condition]:
        """What proves that a policy costs at most upper'x; for one step, at most before'x with the rest."""
        return [Condition(ABOVE + step, self.residual(upper, policy, before), "<=")]

    def below(self, lower: Matrix, before: Matrix | None = None, step: str = "") -> list[Condition]:
        """What proves that every policy costs at least lower'x; for one step, as `above`."""
        return [Condition(BELOW + step, self.residual(lower, None, before), ">=")]

    def assumptions(self) -> list[Condition]:
        """Limits in X*; every admissible input keeps X; every stage costs something but at x = 0."""
        rays, facets = self.X.exact_rays, self.X.exact_facets.plain()
        pushed, unit = times(facets, self.B).as_integers()
        worst = over(self.worst(pushed), unit)
        left, middle = Matrix.join([facets, worst], -1), Matrix.join([self.A, self.limits], -2)
        spent, unit = self.r.as_integers()
        stage = Matrix.join([Matrix.identity(1), over(self.best(spent), unit)], -1)
        where = None if self.discrete else self.X.incidence
        return [
            Condition(LIMITS, BilinearForms(self.limits, None, rays), ">="),
            Condition(KEPT, BilinearForms(left, middle, rays), ">=", where),
            Condition(COSTS, BilinearForms(stage, Matrix.join([self.s, self.limits], -2), rays), ">"),
        ]

    def growing(self, d: Matrix) -> list[Condition]:
        """d in X*, not 0, and no policy makes d'x smaller, unless disturbances do."""
        y, unit = times(d, self.discounted[1]).as_integers()
        left = Matrix.join([over(self.best(y), unit), d], -1)
        rays, middle = self.X.exact_rays, Matrix.join([self.limits, self.discounted[0]], -2)
        total = Matrix.from_fractions(self.X.exact_rays.plain().fractions().sum(axis=0, keepdims=True))
        return [
            Condition("d'x >= 0", BilinearForms(d, None, rays), ">="),
            Condition("d'x > 0 inside X", BilinearForms(d, None, total), ">"),
            Condition("d'x does not fall", BilinearForms(left, middle, rays), ">="),
        ]


def over(integers: Any, unit: Any) -> Matrix:
    """Integers times a factor."""
    factor = Fraction(unit)
    return Matrix.over(np.asarray(integers, dtype=object) * factor.numerator, factor.denominator)


def _sum(left: Matrix, right: Matrix) -> Matrix:
    eye = Matrix.identity(left.shape[1])
    return times(Matrix.join([left, right], -1), Matrix.join([eye, eye], -2))
