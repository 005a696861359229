"""Linear cost for a network: the problem of `problem` in sparse matrices, and its inequalities without any product.

A and B are towers (see `exact.layers`): layers below each other whose sum is the matrix, so that the closed loop of any
network of doubles is held exactly.  In the place of m_g(y), y = r + B'p, stand prices z_g, doubles on the safe side of
what the kernel encloses y in, so that

    z_g <= m_g(y)   for  s + (A - I)'p + sum_g z_g l_g   in X*       (a bound from below),
    z_g >= c_g'y_g  for  the opposite of the same sum    in X*       (the cost of a policy c from above).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.condition import Condition
from ...exact.distinct import distinct
from ...exact.layers import height, repeated, sparse_product, tower
from ...exact.matrix import Matrix
from ...exact.rounding import HALF_ULP, error_factor, underflow
from ...exact.signs import BilinearForms
from .node_cones import NodeCones
from .problem import (
    ABOVE,
    BELOW,
    CONTROL,
    COSTS,
    DISTURBANCE,
    GROUP,
    KEPT,
    LIMITS,
    SHARED,
    Floats,
    Index,
    LinearCost,
    over,
)

# What holds with no more than rounding to spare.
PUSHES = ["z <= m(B'h) (1)", "z <= m(B'h) (2)"]


@dataclass(frozen=True, eq=False)
class NetworkCost(LinearCost):
    """The same problem with sparse data; A and B are towers, shapes (k n, n) and (k n, m), `limits` is sparse."""

    @cached_property
    def cones(self) -> NodeCones:
        """X by nodes."""
        return NodeCones(self.X)

    @cached_property
    def rays(self) -> Matrix:
        """See `LinearCost`."""
        return self.cones.rays

    @cached_property
    def acting(self) -> sp.csr_array:
        """B in floating point."""
        return _collapsed(self.B, self.limits.shape[1])

    @cached_property
    def acted(self) -> sp.csr_array:
        """B' in floating point, for products with columns."""
        return sp.csr_array(self.acting.T)

    @cached_property
    def resting(self) -> sp.csr_array:
        """A in floating point."""
        return _collapsed(self.A, self.limits.shape[1])

    @cached_property
    def drift(self) -> sp.csr_array:
        """A - I and A - rho I in floating point, with the discount in A."""
        own = sp.eye_array(self.limits.shape[1], format="csr") * self.own
        return sp.csr_array(self.resting * float(self.factor) - own)

    @cached_property
    def own(self) -> float:
        """What is subtracted from the diagonal of A."""
        return float(1 if self.discrete else self.discount)

    @cached_property
    def factor(self) -> Fraction:
        """What A and B are multiplied by."""
        return self.discount if self.discrete else Fraction(1)

    @cached_property
    def _middle(self) -> Matrix:
        """What a left factor (s, z, p, ..., -p) of a Bellman residual multiplies."""
        eye = Matrix.identity(self.limits.shape[1], sparse=True)
        return Matrix.join([eye, self.limits, self.A, eye], -2)

    def _part(self, first: int, last: int) -> Matrix:
        """Rows of it, in the same memory."""
        M = self._middle.values
        at = slice(M.indptr[first], M.indptr[last])
        parts = M.data[at], M.indices[at], M.indptr[first : last + 1] - M.indptr[first]
        return Matrix(sp.csr_array(parts, shape=(last - first, M.shape[1])))

    def fits(self) -> bool:
        """See `LinearCost`."""
        n, m = self.X.dim, len(self.owner)
        towers = all(M.is_sparse and M.is_double for M in (self.A, self.B, self.limits))
        whole = self.A.shape[0] % n == self.B.shape[0] % n == 0 < min(self.A.shape[0], self.B.shape[0])
        return towers and whole and (self.A.shape[1], self.B.shape[1]) == (n, m)

    def near(self, facet: int, generator: int) -> tuple[Any, Any, LinearCost, Index]:
        """See `LinearCost`."""
        n = self.X.dim
        h, x = (sp.csr_array(M.values[[k]]) for M, k in ((self.cones.facets, facet), (self.cones.rays, generator)))
        rows = np.concatenate([k * n + h.indices for k in range(height(self.A, n))])
        acting = np.concatenate([k * n + h.indices for k in range(height(self.B, n))])
        blocks = distinct(self.owner[distinct(sp.csr_array(self.B.values[acting]).indices)])
        columns = np.flatnonzero(np.isin(self.owner, blocks))
        A, B, limits = (
            Matrix(np.asarray(sp.csr_array(M.values[i])[:, j].toarray()))
            for M, i, j in ((self.A, rows, x.indices), (self.B, acting, columns), (self.limits, blocks, x.indices))
        )
        layered = (M.fractions().reshape(M.shape[0] // h.nnz, h.nnz, M.shape[1]) for M in (A, B))
        A, B = (Matrix.from_fractions(M.sum(axis=0)) for M in layered)
        owner = np.searchsorted(blocks, self.owner[columns])
        given = self.X, self.discrete, self.s, self.r, limits, owner, self.kinds[blocks], self.discount
        normal, ray = (Matrix(v.data).fractions() for v in (h, x))
        return normal, ray, LinearCost(A, B, *given), columns

    # -- prices

    def _below(self, p: Matrix, *, costs: bool = True) -> Matrix:
        """z <= m(r + B'p) for a row p, proven; with r = 0 without costs."""
        kind, (low, high) = self.kinds[self.owner], self._inputs(p, costs=costs)
        least = np.where(kind == CONTROL, np.minimum(low, -high), low)
        least = np.where(kind == DISTURBANCE, np.maximum(low, -high), least)
        z = self._by_block(np.minimum, least[None])[0]
        z[self.kinds == GROUP] = np.minimum(z[self.kinds == GROUP], 0)
        return Matrix(z[None])

    def _above(self, p: Matrix, policy: Index) -> Matrix:
        """z >= what a policy pays for r + B'p, against any disturbance, proven; it uses one column of a group."""
        free, (low, high) = self.kinds[self.owner] == DISTURBANCE, self._inputs(p)
        paid = np.where(policy == 0, 0.0, np.where(policy > 0, high, -low))
        paid = np.where(free, np.maximum(high, -low), paid)
        return Matrix(np.bincount(self.owner, paid, minlength=len(self.kinds)).astype(float)[None])

    def _inputs(self, p: Matrix, *, costs: bool = True) -> tuple[Floats, Floats]:
        """Proven bounds of r + B'p for a row p; without costs of B'p, equal where nothing is rounded."""
        forms = BilinearForms(self._columns, None, repeated(_scaled(p, self.factor), self.B))
        low, high = (bound[:, 0] for bound in forms.enclosure(exactly=not costs))
        if not costs:
            return low, high
        least = most = np.asarray(self.r.values[0])
        if self.r.radius is not None:
            radius = np.asarray(self.r.radius[0])
            least, most = np.nextafter(least - radius, -np.inf), np.nextafter(most + radius, np.inf)
        return np.nextafter(low + least, -np.inf), np.nextafter(high + most, np.inf)

    @cached_property
    def _columns(self) -> Matrix:
        """The columns of the layers of B as rows."""
        return Matrix(self.acted if height(self.B, self.X.dim) == 1 else sp.csr_array(self.B.values.T))

    # -- exact forms

    def _moved(self, s: Matrix, z: Matrix, p: Matrix, before: Matrix | None = None) -> BilinearForms:
        """(s + (A - I)'p + sum_g z_g l_g)'x on the generators x; with `before` in the place of I'p."""
        own = _scaled(p, -self.discount) if not self.discrete else -p if before is None else -before
        left = Matrix.join([s, z, repeated(_scaled(p, self.factor), self.A), own], -1)
        return BilinearForms(left, self._middle, self.rays)

    def above(self, upper: Matrix, policy: Index, before: Matrix | None = None, step: str = "") -> list[Condition]:
        """See `LinearCost`."""
        paid = self._above(upper, policy)
        return [Condition(ABOVE + step, self._moved(self.s, paid, upper, before), "<=")]

    def below(self, lower: Matrix, before: Matrix | None = None, step: str = "") -> list[Condition]:
        """See `LinearCost`."""
        least = self._below(lower)
        return [Condition(BELOW + step, self._moved(self.s, least, lower, before), ">=")]

    def assumptions(self) -> list[Condition]:
        """See `LinearCost`."""
        rays, facets = self.rays, self.cones.facets
        worst, proof = self._worst_pushes()
        left, n = Matrix.join([worst, *[facets] * height(self.A, facets.shape[1])], -1), rays.shape[1]
        kept = BilinearForms(left, self._part(n, n + left.shape[1]), rays)
        stage = Matrix.join([self.s, self._best_of(self.r)], -1)
        return [
            Condition(LIMITS, BilinearForms(self.limits, None, rays), ">="),
            *proof,
            Condition(KEPT, kept, ">=", None if self.discrete else self.cones.apart(*_entries(kept.pattern))),
            Condition(COSTS, BilinearForms(stage, self._part(0, stage.shape[1]), rays), ">"),
        ]

    def gap(self, lower: Floats, upper: Floats) -> float:
        """No less than the largest (upper - lower)'x / upper'x on X."""
        rays = self.rays.values
        size = abs(rays) @ (np.abs(lower) + np.abs(upper))
        error = error_factor(int(np.diff(rays.indptr).max(initial=1)) + 2) * size + underflow(rays.shape[1])
        low, high = rays @ lower - error, rays @ upper + error
        if not (high > 4 * error).all():
            return float("inf")
        return float(((high - low) / (high - 2 * error)).max(initial=0.0) * (1 + 8 * HALF_ULP))

    # -- one step more, in discrete time

    def earlier(self, p: Matrix) -> tuple[Matrix, Index, Floats | None]:
        """See `LinearCost`; in floating point."""
        row, factor, s, L = p.values[0], float(self.factor), np.asarray(self.s.values[0]), self.limits.values
        y = np.asarray(self.r.values[0]) + factor * (self.acted @ row)
        moved = s + factor * (row @ self.resting) + self.best(y[None])[0] @ L
        coming = np.abs(s) + factor * (np.abs(row) @ abs(self.resting)) + np.abs(moved)
        paid = np.abs(np.asarray(self.r.values[0])) + factor * (abs(self.acted) @ np.abs(row))
        sizes = abs(self.rays.values) @ (coming + 2 * np.bincount(self.owner, paid, minlength=len(self.kinds)) @ abs(L))
        return Matrix(moved[None]), self.policy(y), sizes

    @cached_property
    def heights(self) -> sp.csr_array:
        """See `LinearCost`."""
        products = sp.csr_array(self.normals @ self.rays.values.T)
        products.data[self.cones.apart(*_entries(products))] = 0.0
        products.eliminate_zeros()
        return products

    @cached_property
    def normals(self) -> Any:
        """See `LinearCost`."""
        return self.cones.facets.values

    def growing(self, d: Matrix) -> list[Condition]:
        """See `LinearCost`."""
        rays, least = self.rays, self._below(d, costs=False)
        everywhere = Matrix(np.ones((1, rays.shape[0])))
        return [
            Condition("d'x >= 0", BilinearForms(d, None, rays), ">="),
            Condition("d'x > 0 inside X", BilinearForms(d, rays.T, everywhere), ">"),
            Condition("d'x does not fall", self._moved(Matrix.zeros(*self.s.shape), least, d), ">="),
        ]

    def _best_of(self, y: Matrix) -> Matrix:
        """m(y) for a row y, exactly."""
        if y.is_double:
            return Matrix(self.best(np.asarray(y.values)))
        integers, unit = y.as_integers()
        return over(self.best(integers), unit)

    def _worst_pushes(self) -> tuple[Matrix, list[Condition]]:
        """m_g(B'h) for all facets h, disturbances as controls, or less and the proof of it; sparse, facets x blocks."""
        n = self.limits.shape[1]
        parts = [sp.csr_array(self.B.values[k * n : (k + 1) * n]) for k in range(height(self.B, n))]
        if not self.cones.is_orthant:
            H = self.cones.facets.values
            parts = [term for part in parts for term in sparse_product(H, part)]
        pushed = tower(parts)
        F = self.cones.facets.shape[0]
        total = _collapsed(pushed, F)
        if pushed.shape[0] > F:
            return self._rounded_pushes(total, _collapsed(Matrix(abs(pushed.values)), F))
        single = self._is_single[total.indices]
        data = np.where(single, -np.abs(total.data), total.data)
        return self._least_by_block(sp.csr_array((data, total.indices, total.indptr), shape=total.shape)), []

    @cached_property
    def _is_single(self) -> NDArray[np.bool_]:
        """True for columns that may be used either way."""
        return np.isin(self.kinds[self.owner], (CONTROL, DISTURBANCE))

    def _rounded_pushes(self, total: sp.csr_array, size: sp.csr_array) -> tuple[Matrix, list[Condition]]:
        """Less than m_g(B'h) where that is no double, from B'h in floating point and the size of its terms."""
        eye, single = Matrix.identity(len(self.owner), sparse=True), self._is_single.astype(float)
        error = 8 * (height(self.B, total.shape[1]) + 64) * HALF_ULP * size
        either = _columns_times(sp.csr_array(abs(total) + error), single)
        worst = self._least_by_block(sp.csr_array(_columns_times(sp.csr_array(total - error), 1 - single) - either))
        F, H = total.shape[0], self.cones.facets
        left = Matrix.join([*[H] * height(self.B, H.shape[1]), Matrix.identity(F, sparse=True)], -1)
        z, out = sp.csr_array(worst.values[:, self.owner]), []
        for k, f in enumerate((np.ones(len(single)), -single)):
            parts = [_columns_times(self.B.values, f), -_columns_times(z, np.abs(f))]
            middle = Matrix(sp.csr_array(sp.vstack(parts, format="csr")))
            out.append(Condition(PUSHES[k], BilinearForms(left, middle, eye), ">="))
        return worst, out

    def _least_by_block(self, y: sp.csr_array) -> Matrix:
        """The least y of every block (row of limits), at most 0 where it need not act, for every row of y."""
        if self.apart and self._is_single.all():
            return Matrix(y)
        rows, columns = _entries(y)
        width = max(len(self.kinds), 1)
        keys = rows.astype(np.int64) * width + self.owner[columns]
        order = np.argsort(keys, kind="stable")
        first = np.flatnonzero(np.diff(keys[order], prepend=-1))
        at = keys[order][first]
        least = np.minimum.reduceat(y.data[order], first) if first.size else y.data[:0]
        # columns without an entry push nothing
        whole = np.diff(first, append=len(keys)) == np.bincount(self.owner, minlength=width)[at % width]
        least = np.where((self.kinds[at % width] == SHARED) & whole, least, np.minimum(least, 0.0))
        return Matrix(sp.csr_array((least, (at // width, at % width)), shape=(y.shape[0], len(self.kinds))))


def _collapsed(layers: Matrix, rows: int) -> sp.csr_array:
    """The sum of the layers of a tower, in floating point."""
    count = height(layers, rows)
    if count == 1:
        return layers.values
    return sp.csr_array(sum(sp.csr_array(layers.values[k * rows : (k + 1) * rows]) for k in range(count)))


def _columns_times(M: sp.csr_array, f: Floats) -> sp.csr_array:
    """M diag(f) for factors 0, 1 and -1, without rounding."""
    out = sp.csr_array((M.data * f[M.indices], M.indices, M.indptr), shape=M.shape, copy=True)
    if not f.all():
        out.eliminate_zeros()
    return out


def _entries(M: sp.csr_array) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows and columns of the entries."""
    return np.repeat(np.arange(M.shape[0]), np.diff(M.indptr)), M.indices


def _scaled(row: Matrix, factor: Fraction) -> Matrix:
    """A row times a number, exactly."""
    if factor in (0, 1):
        return row if factor else Matrix.zeros(*row.shape)
    integers, unit = row.as_integers()
    return over(integers, unit * factor)
