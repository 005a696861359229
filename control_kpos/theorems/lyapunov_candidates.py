"""Candidates for Lyapunov vectors, dominant directions and directions of growth.

Candidates solve v'x_i > 0, v'A x_i < 0 (or A x in X) of Theorem 2 up to rounding.  Nothing here is trusted: a
proposal counts only after the kernel has proven the inequalities.  Units are removed first: states are scaled by
powers of two until the generators of the cone have entries of similar size, and A by a power of two, both without
rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray
from scipy.linalg import lapack

from ..cones import Cone
from ..cones.polyhedral import has_open_facets
from ..exact.budget import require_time
from ..exact.matrix import Matrix, dense
from ..exact.program import Block, Program

Vector = NDArray[np.float64]
_NODA_STEPS = 60
# How far from the bound the shift stays, relative to the size of A, so that the matrix is not singular.
_NODA_GAP = 2.0**-50
# Growth rate, relative to the size of A, from which floating point proves growth.
_CLEARLY = 1e-6
# Dense matrices larger than this with so few entries in a row are factored as sparse ones.
_SMALL, _THIN = 48, 4
# Dimensions up to which directions are moved onto a face exactly.
_FACE_ROWS = 80


class SingularMatrixError(ArithmeticError):
    """The matrix is singular to working precision."""


class ScaledProblem:
    """S = A (A - I in discrete time) on X, in units where generators and S have size about one.

    Parameters
    ----------
    A : Matrix, shape (n, n)
    X : Cone
    discrete : bool
    balanced : bool
        Also balance the rows and columns of S against each other.
    """

    def __init__(self, A: Matrix, X: Cone, discrete: bool, *, balanced: bool = False) -> None:
        self.A, self.X, self.discrete = A, X, discrete
        self.n = A.shape[0]
        self.rays = _dense_if_small(X.exact_rays.values)
        units = _column_units(self.rays)
        if balanced:
            units = units * _balancing_units(A, units)
        with np.errstate(all="ignore"):
            if A.is_sparse:
                S = A.values - sp.eye_array(self.n) if discrete else A.values
                S = sp.csc_array(sp.diags_array(1 / units) @ S @ sp.diags_array(units))
                top = np.abs(S.data).max(initial=0.0)
            else:
                S = np.asarray(A.values) - np.eye(self.n) if discrete else np.asarray(A.values)
                S = S / units[:, None] * units
                top = np.abs(S).max(initial=0.0)
                if self.n > _SMALL and np.count_nonzero(S) <= _THIN * self.n:
                    S = sp.csc_array(S)
        self.scale = float(2.0 ** np.floor(np.log2(top))) if 0 < top < np.inf else 1.0
        self.S: Any = S / self.scale
        self.units = units

    @classmethod
    def both(cls, A: Matrix, X: Cone, discrete: bool) -> Iterator[ScaledProblem]:
        """As it is, then balanced if that is different."""
        plain = cls(A, X, discrete)
        yield plain
        balanced = cls(A, X, discrete, balanced=True)
        if (balanced.units != plain.units).any():
            yield balanced

    @cached_property
    def facets(self) -> Any:
        """Facet normals, in the units of the user."""
        return _dense_if_small(self.X.exact_facets.values)

    @cached_property
    def interior(self) -> Vector:
        """A vector in int X: the sum of the normalised generators, in scaled units."""
        return _row_sum(self.rays, 1 / self.units)

    @cached_property
    def dual_interior(self) -> Vector:
        """A vector in int X*, in scaled units: the sum of the normalised facets, if these can be listed."""
        if has_open_facets(self.X):
            return self.X.dual.interior_point * self.units
        return _row_sum(self.facets, self.units)

    def _solver(self, shift: float) -> Callable[[Vector, bool], Vector]:
        """Solves with S - shift I, or its transpose."""
        require_time(0.0 if sp.issparse(self.S) else self.n**3 / 10)
        if sp.issparse(self.S):
            M = sp.csc_array(self.S - shift * sp.eye_array(self.n))
            try:
                lu = spla.splu(M)
            except (RuntimeError, ValueError):
                raise SingularMatrixError from None

            def solve(b: Vector, transposed: bool) -> Vector:
                return lu.solve(b, "T" if transposed else "N")

        else:
            M = self.S - shift * np.eye(self.n) if shift else self.S
            if not np.isfinite(M).all():
                raise SingularMatrixError
            factors, pivots, info = lapack.dgetrf(M)
            if info:
                raise SingularMatrixError

            def solve(b: Vector, transposed: bool) -> Vector:
                return lapack.dgetrs(factors, pivots, b, trans=int(transposed))[0]

        def refined(b: Vector, transposed: bool) -> Vector:
            try:
                with np.errstate(all="ignore"):
                    x = solve(b, transposed)
                    x = x + solve(b - (M.T if transposed else M) @ x, transposed)
            except (RuntimeError, ValueError):
                raise SingularMatrixError from None
            if not np.isfinite(x).all():
                raise SingularMatrixError
            return x

        return refined

    def left_vector(self, shift: float) -> Vector:
        """v = (shift I - S')^{-1} c for c in int X*, in the units of the user.

        Raises
        ------
        SingularMatrixError
            If the matrix is singular.
        """
        return self._unscaled_left(-self._solver(shift)(self.dual_interior, True))

    def _unscaled_left(self, v: Vector) -> Vector:
        return _normalised(v) / self.units

    def _unscaled_right(self, x: Vector) -> Vector:
        return _normalised(x) * self.units

    @cached_property
    def _noda(self) -> list[tuple[float, Vector, Vector]]:
        """Shifts falling to the dominant eigenvalue, with vectors rising to its left and right eigenvectors.

        If v'S x_i <= s v'x_i on all generators, with v in int X*, then s bounds the spectrum from the
        right, and v <- (s I - S')^{-1} v stays in int X* and lowers the bound: Noda's inverse iteration
        (Numerische Mathematik 17, 1971), quadratically convergent for irreducible nonnegative matrices.
        """
        rays = self.rays * self._columns if not sp.issparse(self.rays) else self.rays @ self._columns
        v, x = self.dual_interior, self.interior
        found: list[tuple[float, Vector, Vector]] = []
        shift = np.inf
        for _ in range(_NODA_STEPS):
            with np.errstate(all="ignore"):
                value = rays @ v
                bound = float(np.max((rays @ (self.S.T @ v)) / value)) if (value > 0).all() else np.nan
            if not bound < shift:
                break
            shift = bound
            found.append((shift, v, x))
            try:
                solve = self._solver(shift + _NODA_GAP * max(1.0, abs(shift)))
                v, x = _normalised(-solve(v, True)), _normalised(-solve(x, False))
            except SingularMatrixError:
                break
        return found

    @property
    def _columns(self) -> Any:
        """Right factor that turns generators in the units of the user into scaled ones."""
        return sp.diags_array(1 / self.units) if sp.issparse(self.rays) else 1 / self.units

    def left_perron_vectors(self) -> Iterator[Vector]:
        """Vectors in int X*, at first close to the left dominant eigenvector."""
        for _, v, _ in reversed(self._noda):
            yield self._unscaled_left(v)

    def right_perron_vectors(self) -> Iterator[Matrix]:
        """Vectors in X, at first close to the dominant eigenvector."""
        for _, _, x in reversed(self._noda):
            yield Matrix(self._unscaled_right(x))
        if not self._noda:
            return
        shift, _, x = self._noda[-1]
        try:
            x = _normalised(-self._solver(shift + _NODA_GAP * max(1.0, abs(shift)))(x, False))
        except SingularMatrixError:
            pass
        else:
            yield Matrix(self._unscaled_right(x))
        if self.n <= _FACE_ROWS and not has_open_facets(self.X):
            yield from self._on_face(x)

    def growing_directions(self) -> Iterator[Matrix]:
        """Candidates x in X with S x in X when S is not stable.

        Of simplicial cones only where that is clear and A is dense: otherwise exact arithmetic takes less than trying.
        """
        if not self.X.is_simplicial:
            if self._noda and self._noda[-1][0] >= -1e-6:
                yield from self.right_perron_vectors()
        elif not self.A.is_sparse and self._noda and self._noda[-1][0] > _CLEARLY:
            yield Matrix(self._unscaled_right(self._noda[-1][2]))

    def _on_face(self, x: Vector) -> Iterator[Matrix]:
        """x as an exact nonnegative combination of the generators of its smallest face."""
        scaled_facets, scaled_rays = dense(self.facets) * self.units, dense(self.rays) / self.units
        height = scaled_facets @ x / np.abs(scaled_facets).max(axis=1)
        tight = height <= 1e-7 * np.abs(x).max()
        rays = np.flatnonzero(self.X.incidence[tight].all(axis=0))
        if not rays.size:
            return
        rows = scaled_rays[rays] / np.abs(scaled_rays[rays]).max(axis=1, keepdims=True)
        weights, *_ = np.linalg.lstsq(rows.T, x, rcond=None)
        # an interior point of the face close to x needs no small or negative weight
        weights = np.maximum(weights, 0) + 1e-3 * np.abs(weights).max()
        exact = self.X.exact_rays.rows_as_integers(rays)
        size = np.array([max(abs(int(t)) for t in row) for row in exact], dtype=object)
        parts = np.array([Fraction(float(w)) for w in weights], dtype=object)
        parts = np.array([w / int(s) for w, s in zip(parts, size, strict=True)], dtype=object)
        units = np.array([Fraction(float(u)) for u in self.units[np.abs(rows).argmax(axis=1)]], dtype=object)
        yield Matrix.from_fractions((exact * (parts * units)[:, None]).sum(axis=0))


def _dense_if_small(m: Any) -> Any:
    return m.toarray() if sp.issparse(m) and m.shape[0] * m.shape[1] <= 4096 else m


def _normalised(x: Vector) -> Vector:
    top = np.abs(x).max(initial=0.0)
    return x / 2.0 ** np.floor(np.log2(top)) if 0 < top < np.inf else x


def _powers_of_two(sizes: Vector) -> Vector:
    with np.errstate(divide="ignore"):
        exponent = np.where(sizes > 0, np.round(np.log2(np.where(sizes > 0, sizes, 1.0))), 0.0)
    return np.ldexp(1.0, np.clip(exponent, -1000, 1000).astype(int))


def _balancing_units(A: Matrix, units: Vector) -> Vector:
    """Powers of two that balance the matrix; ones for sparse matrices."""
    scaled = dense(A.values) / units[:, None] * units if not A.is_sparse else np.array([[np.inf]])
    if not np.isfinite(scaled).all():
        return np.ones_like(units)
    return np.asarray(lapack.dgebal(scaled, scale=1, permute=0)[3])


def _column_units(rays: Any) -> Vector:
    """Powers of two u such that the generators divided by u have columns and rows of similar size."""
    size = abs(rays)
    units = np.ones(size.shape[1])
    for _ in range(2):
        scaled = size @ sp.diags_array(1 / units) if sp.issparse(size) else size / units
        rows = _maximum(scaled, 1)
        scaled = sp.diags_array(1 / rows) @ size if sp.issparse(size) else size / rows[:, None]
        units = _powers_of_two(_maximum(scaled, 0))
    return units


def _maximum(m: Any, axis: int) -> Vector:
    out = m.max(axis=axis)
    out = out.toarray().ravel() if sp.issparse(out) else np.asarray(out)
    return np.where(out > 0, out, 1.0)


def _row_sum(rows: Any, units: Vector) -> Vector:
    """Sum of the rows in scaled units, each divided by its largest entry."""
    if sp.issparse(rows):
        scaled = rows @ sp.diags_array(units)
        return np.asarray(scaled.T @ (1 / _maximum(abs(scaled), 1)))
    scaled = rows * units
    return (scaled / _maximum(np.abs(scaled), 1)[:, None]).sum(axis=0)


def common_vector(centres: Vector, rays: Vector, radii: Vector, *, discrete: bool) -> Vector | None:
    """v with v'x > 0 and v'A x < 0 (discrete time: < v'x) on every generator, for all A within the radii of a centre.

    A linear program in v and sizes w >= |v|.
    """
    unit, n = rays / np.linalg.norm(rays, axis=1, keepdims=True), rays.shape[1]
    moved = np.concatenate([unit @ A.T - (unit if discrete else 0) for A in centres])
    scale = max(float(np.abs(moved).max()), 1e-300)
    program = Program(v=Block(n, -1.0, 1.0), w=Block(n, 0.0, 1.0), margin=Block(1, 0.0, 1.0, -1.0))
    program.above(0.0, np.ones(len(unit)), v=unit)
    spread = np.concatenate([np.abs(unit) @ R.T for R in radii])
    program.above(0.0, np.ones(len(moved)), v=-moved / scale, w=-spread / scale)
    program.below(0.0, v=np.vstack([np.eye(n), -np.eye(n)]), w=-np.vstack([np.eye(n), np.eye(n)]))
    answer = program.solve()
    return answer["v"] if answer and answer["margin"][0] > 1e-12 else None
