"""Nonnegative solutions of R Q = T, proven in floating point.

Given a float Q, the exact residual E = T - R Q is enclosed with an a-priori rounding bound, and so
is D = I - R Y for an approximate right inverse Y of R.  If |D| < 1 in the row-sum norm, then R has
full row rank and

    Q* = Q + Y (I - D)^-1 E      solves      R Q* = T      exactly,

with |Q* - Q|_ij <= |row i of Y|_1 |column j of E|_max / (1 - |D|).  Entries of Q above that are
positive in Q*.  Where that is not enough E is computed in integers: a column whose residual is exactly
zero needs only Q >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import DataError
from .condition import Condition
from .matrix import Matrix
from .products import as_doubles, summed_products
from .rounding import (
    HALF_ULP,
    RADIUS_FACTOR,
    SMALLEST_NORMAL,
    error_factor,
    rounding_radius,
    sum_constants,
    sum_factor,
    underflow,
)
from .signs import BilinearForms

Array = NDArray[np.float64]

_BLOCK = 64
# Multiplications of integers spent on columns whose residual may be exactly zero.
_EXACT = 3 * 10**6


@dataclass(frozen=True, eq=False)
class Bounds(Condition):
    """Numbers proven to be at least `lower`, required to be positive (or proven nonnegative by `exact`).

    Attributes
    ----------
    lower, size : ndarray
        Proven lower bounds, and the sizes they are to be judged against.
    exact : ndarray of bool
        Entries known to be nonnegative in exact arithmetic, whatever `lower` says.
    """

    no_forms: ClassVar[BilinearForms] = BilinearForms(Matrix.zeros(0, 1), None, Matrix.zeros(0, 1))

    # always set by `of`; a parent with defaults forces defaults here
    lower: Array = None  # type: ignore[assignment]
    size: Array = None  # type: ignore[assignment]
    exact: NDArray[np.bool_] | bool = False

    @classmethod
    def of(cls, name: str, lower: Array, size: Array, exact: NDArray[np.bool_] | bool = False) -> Bounds:
        """A condition for given bounds."""
        return cls(name, cls.no_forms, ">", None, lower, size, exact)

    def verdict(self) -> bool | None:
        """True if proven; None otherwise, for a bound refutes nothing."""
        return True if bool(((self.lower > 0) | self.exact).all()) else None

    def worst_violation(self) -> None:
        """None: a bound that is not met is no proven violation."""
        return

    @property
    def residual(self) -> Array:
        """The lower bounds."""
        return self.lower

    @property
    def scale(self) -> Array:
        """Sizes against which the bounds are to be judged."""
        return self.size

    @property
    def margin(self) -> float:
        """Smallest bound relative to its size, at most 1."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(self.size > 0, self.lower / self.size, 0.0)
        ratio = np.where(np.isnan(ratio), -np.inf, ratio)
        ratio = np.where(self.exact, np.maximum(ratio, 0.0), ratio)
        return float(min(1.0, ratio.min(initial=1.0)))


def enclosed_product(left: Matrix, right: Matrix) -> tuple[Array, Array]:
    """left @ right' in floating point, and a bound on its distance from the exact product (see `rounding`)."""
    a, b = np.asarray(left.values), np.asarray(right.values)
    width = a.shape[1]
    blocks = range(0, max(width, 1), _BLOCK)
    g, lost = sum_constants(min(width, _BLOCK) + len(blocks), width)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        size = np.abs(a) @ np.abs(b).T
        # Sums in blocks: each term passes through fewer roundings than the width has entries.
        product = sum((a[:, k : k + _BLOCK] @ b[:, k : k + _BLOCK].T for k in blocks), np.zeros(size.shape))
        bound = g * size + lost
        if left.radius is not None:
            bound = bound + RADIUS_FACTOR * (left.radius @ np.abs(b).T)
        if right.radius is not None:
            reach = np.abs(a) if left.radius is None else np.abs(a) + left.radius
            bound = bound + RADIUS_FACTOR * (reach @ right.radius.T)
        return product, bound


def enclosed_sparse_product(left: Matrix, P: sp.csr_array) -> tuple[Array, Array]:
    """left @ P in floating point, and a bound on its distance from the exact product (see `rounding`)."""
    values, columns = np.asarray(left.values).T, sp.csr_array(P.T)
    terms = int(np.diff(columns.indptr).max(initial=0))
    g, lost = sum_constants(terms, terms)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        product = np.asarray(columns @ values).T
        bound = g * np.asarray(abs(columns) @ np.abs(values)).T + lost
        if left.radius is not None:
            bound = bound + RADIUS_FACTOR * np.asarray(abs(columns) @ np.asarray(left.radius).T).T
    return product, bound


class Generators:
    """Generators with an approximate right inverse, in coordinates equilibrated by powers of two.

    Parameters
    ----------
    rays : Matrix, shape (N, n)
    right_inverse : ndarray, shape (N, n)
        Y with rays' Y close to the identity.
    """

    def __init__(self, rays: Matrix, right_inverse: Array) -> None:
        self.rays = rays
        top = np.abs(rays.values).max(axis=0, initial=0.0)
        self.exponent = np.where(top > 0, -np.frexp(np.where(top > 0, top, 1.0))[1], 0)
        # What is scaled by powers of two stays exact unless it underflows, which `_scaled` rules out.
        self.columns = _scaled(rays, self.exponent).T
        self.inverse = np.ldexp(right_inverse, -self.exponent)
        product, bound = enclosed_product(self.columns, Matrix(self.inverse.T))
        with np.errstate(over="ignore", invalid="ignore"):
            defect = np.abs(np.eye(len(product)) - product) * (1 + 4 * HALF_ULP) + bound + 2 * HALF_ULP
            self.defect = defect.sum(axis=1) * (1 + error_factor(len(product)))

    def solid(self) -> Bounds:
        """The generators span the whole space."""
        return Bounds.of("R Y = I", 1 - self.defect - 2.0**-50, np.ones_like(self.defect))

    def pointed(self, w: Array) -> Condition:
        """w is positive on all generators."""
        return Condition("w'x > 0", BilinearForms(Matrix(np.asarray(w, dtype=float)[None, :]), None, self.rays), ">")

    def images(self, name: str, M: Matrix, vectors: Matrix, weights: Matrix, *, diagonal: bool = True) -> Bounds:
        """M x_j = R Q_j with Q >= 0, not on the diagonal unless `diagonal`.

        Parameters
        ----------
        name : str
        M : Matrix, shape (n, k)
        vectors : Matrix, shape (c, k)
        weights : Matrix, shape (N, c)
            Q up to an error that the proof takes up; sparse only for a square Q.
        diagonal : bool
        """
        shape = self.rays.shape[0], vectors.shape[0]
        if weights.shape != shape:
            raise DataError(f"{name}: {weights.shape} weights do not fit {shape} columns.")
        if weights.is_sparse:
            return self.sparse_combination(name, (M, vectors), weights, diagonal=diagonal)
        required = np.ones(shape, dtype=bool) if diagonal else ~np.eye(*shape, dtype=bool)
        return self.combination(name, [(M, vectors)], weights, required)

    def combination(
        self,
        name: str,
        targets: list[tuple[Matrix, Matrix]],
        multipliers: Matrix,
        required: NDArray[np.bool_],
    ) -> Bounds:
        """Sum of the products M x' over `targets` = R Q with Q >= 0 where `required`.

        Parameters
        ----------
        targets : list of (M, x)
            The columns T = sum of M x', M of shape (n, k), x of shape (c, k).
        multipliers : Matrix, shape (N, c)
        required : ndarray of bool, shape (N, c)
        """
        Q = np.asarray(multipliers.values)
        parts = [(_scaled(M, self.exponent[:, None]), x) for M, x in targets]
        parts.append((-self.columns, multipliers.T))
        residual = np.zeros((self.rays.shape[1], Q.shape[1]))
        error = np.zeros_like(residual)
        for M, x in parts:
            value, bound = enclosed_product(M, x)
            residual, error = residual + value, error + bound + (np.abs(residual) + np.abs(value)) * (4 * HALF_ULP)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            worst = (np.abs(residual) + error).max(axis=0, initial=0.0)
        lower = np.where(required, self._reduced(Q, worst), np.inf)
        # Where Y has a zero row, Q* is Q.
        exact = (self.inverse == 0).all(axis=1)[:, None] & (Q >= 0)
        open_ = np.flatnonzero((~(lower > 0) & ~exact & required).any(axis=0))
        good = open_[((Q[:, open_] >= 0) | ~required[:, open_]).all(axis=0)]
        if good.size and good.size * self.rays.shape[1] * sum(self.rays.shape) <= _EXACT:
            vanishing, residual = self._exact_residual(targets, multipliers, good)
            exact[:, good[vanishing]] = True
            lower[:, good] = np.where(required[:, good], self._corrected(Q[:, good], residual), np.inf)
        lower = np.where(required, lower, 1.0)
        return Bounds.of(name, lower, _size(self.rays, Q, lower), exact)

    def sparse_combination(
        self, name: str, target: tuple[Matrix, Matrix], multipliers: Matrix, *, diagonal: bool
    ) -> Bounds:
        """M x' = R Q with Q >= 0 (`diagonal`: also there) for a square sparse Q, generators having zero rows in Y.

        Q* = Q outside the support of Y, so that nothing has to be bounded there.
        """
        P = sp.csr_array(multipliers.values)
        support = np.flatnonzero((self.inverse != 0).any(axis=1))
        value, bound = enclosed_product(_scaled(target[0], self.exponent[:, None]), target[1])
        product, error = enclosed_sparse_product(self.columns, P)
        residual = value - product
        error = error + bound + (np.abs(value) + np.abs(product)) * (4 * HALF_ULP)
        Q = P[support].toarray()
        required = np.ones(Q.shape, dtype=bool)
        if not diagonal:
            required[np.arange(len(support)), support] = False
        with np.errstate(over="ignore", invalid="ignore"):
            worst = (np.abs(residual) + error).max(axis=0, initial=0.0)
        lower = np.where(required, self._reduced(Q, worst, support), np.inf)
        exact = np.zeros(Q.shape, dtype=bool)
        open_ = np.flatnonzero((~(lower > 0)).any(axis=0))
        good = open_[((Q[:, open_] >= 0) | ~required[:, open_]).all(axis=0)]
        if good.size and good.size * self.rays.shape[1] * sum(self.rays.shape) <= _EXACT:
            columns = Matrix(P[:, good].toarray())
            vanishing, _ = self._exact_residual([(target[0], target[1][good])], columns, slice(None))
            exact[:, good[vanishing]] = True
        lower = np.where(required, lower, 1.0)
        entries = P.tocoo()
        bad = ~(entries.data >= 0) & (diagonal | (entries.coords[0] != entries.coords[1]))
        bad &= ~np.isin(entries.coords[0], support)
        wrong = np.append(entries.coords[1][bad], np.flatnonzero(~np.isfinite(worst)))
        lower[:, wrong], exact[:, wrong] = -1.0, False  # also where no entry of the column is required
        size = np.maximum(np.abs(Q).sum(axis=0), np.finfo(float).tiny)
        return Bounds.of(name, lower, np.broadcast_to(size, Q.shape), exact)

    def _reduced(self, Q: Array, worst: Array, support: NDArray[np.intp] | slice = slice(None)) -> Array:
        """Lower bounds on Q* where no entry of column j of the residual is above worst[j]."""
        defect = self.defect.max(initial=0.0)
        if not defect < 0.9:
            return np.full_like(Q, -np.inf)
        with np.errstate(over="ignore", invalid="ignore"):
            spread = np.abs(self.inverse[support]).sum(axis=1) / (1 - defect)
            error = np.outer(spread, worst) * sum_factor(self.inverse.shape[1]) + underflow(1)
            return Q - error - np.abs(Q) * (4 * HALF_ULP)

    def _corrected(self, Q: Array, residual: Matrix) -> Array:
        """Lower bounds on Q* for a residual known to full precision: Q* = Q + Y E + Y D (I - D)^-1 E."""
        defect = self.defect.max(initial=0.0)
        if not defect < 0.9:
            return np.full_like(Q, -np.inf)
        step, error = enclosed_product(Matrix(self.inverse), residual.T)
        with np.errstate(over="ignore", invalid="ignore"):
            worst = (np.abs(residual.values) + residual.radius).max(axis=0, initial=0.0)
            spread = np.abs(self.inverse).sum(axis=1) * defect / (1 - defect)
            error = (error + np.outer(spread, worst)) * sum_factor(self.inverse.shape[1]) + underflow(1)
            return Q + step - error - (np.abs(Q) + np.abs(step)) * (8 * HALF_ULP)

    def _exact_residual(
        self,
        targets: list[tuple[Matrix, Matrix]],
        multipliers: Matrix,
        columns: NDArray[np.intp] | slice,
    ) -> tuple[NDArray[np.bool_], Matrix]:
        """Some columns of T - R Q from exact arithmetic: which of them vanish, and all correctly rounded."""
        terms = [(M, x[columns]) for M, x in targets]
        terms.append((-self.rays.T, multipliers.T[columns]))
        integers, factor = summed_products(terms)
        with np.errstate(over="ignore"):
            rounded = as_doubles(integers, factor)
            values = np.ldexp(rounded, self.exponent[:, None])
            radius = np.ldexp(rounding_radius(rounded), self.exponent[:, None]) + SMALLEST_NORMAL
            radius = np.where(integers == 0, 0.0, radius)
        return (integers == 0).all(axis=0), Matrix(values, radius)


def _size(rays: Matrix, Q: Array, lower: Array) -> Array:
    """Sizes of the entries of Q that do not depend on the lengths of the generators."""
    length = np.linalg.norm(rays.values, axis=1)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        size = (length[:, None] * np.abs(Q)).sum(axis=0)[None, :] / length[:, None]
    return np.where(np.isfinite(size) & (size > 0), size, np.maximum(np.abs(lower), 1.0))


def _scaled(m: Matrix, exponent: NDArray[np.intp]) -> Matrix:
    """Columns, or rows, times powers of two, with a radius where bits were lost."""
    values = np.ldexp(np.asarray(m.values), exponent)
    radius = None if m.radius is None else np.ldexp(m.radius, exponent) + SMALLEST_NORMAL
    if not np.array_equal(np.ldexp(values, -exponent), m.values):
        radius = (np.zeros_like(values) if radius is None else radius) + SMALLEST_NORMAL
    return Matrix(values, radius)
