"""The modes of a matrix, as building blocks of an invariant cone.

With A e = lam e for the dominant real eigenvalue lam and a real basis V of the other invariant
subspaces, A = [e V] blkdiag(lam, blocks) [e V]^-1, one 1 x 1 block for a real eigenvalue and one
2 x 2 block [[re, -im], [im, re]] for a complex pair.  In continuous time *dominant* means rightmost,
in discrete time of largest modulus.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import affords, spend
from ...exact.matrix import Matrix
from ...exact.products import as_doubles, summed_products

Array = NDArray[np.float64]

# Eigenvalues, eigenvectors and their condition number: operations for an n x n matrix, divided by n^3.
PER_CUBE = 3.0
# Beyond this, a neighbouring matrix with better eigenvectors is tried, and then A in coordinates close to its own.
WELL_CONDITIONED = 1e4
# Rounds of iterative refinement, and operations of an exact product divided by n^3.
_ROUNDS, _PER_EXACT_PRODUCT = 6, 100.0
# Relative distance to which rounding may move copies of a repeated eigenvalue.
_SPLIT = 1e-4


@dataclass(frozen=True, eq=False)
class Modes:
    """A real modal form of A.

    Attributes
    ----------
    dominant : float
        The dominant eigenvalue lam, real.
    right, left : ndarray, shape (n,)
        A right = lam right, left A = lam left, left right = 1, right of length 1.
    others : ndarray of complex, shape (k,)
        The other eigenvalues, one of each complex pair (positive imaginary part).
    bases : list of ndarray, shape (n, 1) or (n, 2)
        Real basis of the invariant subspace of each.
    conditioning : float
        Condition number of [right, bases], columns of length about 1.
    """

    dominant: float
    right: Array
    left: Array
    others: NDArray[np.complex128]
    bases: list[Array]
    conditioning: float


def dominant_index(values: NDArray[np.complex128], *, discrete: bool) -> int:
    """Index of the dominant eigenvalue; among near ties a real (discrete: nonnegative) one."""
    size = np.abs(values) if discrete else values.real
    top = size.max()
    tolerance = 1e-13 * (np.abs(values).max() + np.finfo(float).tiny)
    near = np.flatnonzero(size >= top - tolerance)
    good = near[(np.abs(values[near].imag) == 0) & ((values[near].real >= 0) | (not discrete))]
    return int(good[0] if good.size else near[0])


def modes(A: Array, *, discrete: bool = False) -> Modes | None:
    """Modal form of A, or None if the computed dominant eigenvalue is not real or A looks defective.

    Costs one dense eigenvalue decomposition.
    """
    spend(PER_CUBE * len(A) ** 3)
    values, vectors = (np.asarray(a, dtype=np.complex128) for a in np.linalg.eig(A))
    first = dominant_index(values, discrete=discrete)
    if values[first].imag != 0 or (discrete and values[first].real < 0):
        return None
    right = np.real(vectors[:, first])
    right = right / np.linalg.norm(right)
    rest = [i for i in range(len(values)) if i != first and values[i].imag >= 0]
    bases = _real_bases(values[rest], vectors[:, rest])
    basis = np.column_stack([right, *bases])
    conditioning = float(np.linalg.cond(basis)) if basis.shape[0] == basis.shape[1] else np.inf
    if not conditioning < 1e14:
        return None
    left = sl.solve(basis.T, np.eye(len(values))[0])
    return Modes(float(values[first].real), right, left, values[rest], bases, conditioning)


def _eigenbasis(A: Array) -> Array:
    """Real and imaginary parts of the eigenvectors, columns of length about 1; shape (n, n)."""
    spend(PER_CUBE * len(A) ** 3)
    values, vectors = (np.asarray(a, dtype=np.complex128) for a in np.linalg.eig(A))
    some = values.imag >= 0
    return np.column_stack(_real_bases(values[some], vectors[:, some]))


def _real_bases(values: NDArray[np.complex128], vectors: NDArray[np.complex128]) -> list[Array]:
    """[Re, -Im] of each eigenvector turned in the complex plane until both are orthogonal; a real one alone."""
    turned = vectors * np.exp(-0.5j * np.angle((vectors * vectors).sum(axis=0)))
    pairs = [np.column_stack([v.real, -v.imag])[:, : 1 + (z.imag > 0)] for z, v in zip(values, turned.T, strict=True)]
    return [pair / np.linalg.norm(pair, axis=0).max() for pair in pairs]


def balanced(A: Matrix) -> tuple[Array, Array]:
    """A in units where its rows and columns have similar size, and the units (powers of two).

    Returns
    -------
    matrix : ndarray, shape (n, n)
        diag(units)^-1 A diag(units).
    units : ndarray, shape (n,)
    """
    values = np.asarray(A.values)
    units = balancing_units(values)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        matrix = values * units / units[:, None]
    return (matrix, units) if np.isfinite(matrix).all() else (values, np.ones(len(values)))


def balancing_units(size: Array) -> Array:
    """Powers of two u that make row and column sizes of diag(u)^-1 A diag(u) similar (Osborne)."""
    with np.errstate(divide="ignore"):
        level = np.log2(np.abs(size))
    np.fill_diagonal(level, -np.inf)
    exponent = np.zeros(len(level))
    for _ in range(20):
        before = exponent.copy()
        for i in range(len(level)):
            row = (level[i] + exponent).max(initial=-np.inf) - exponent[i]
            column = (level[:, i] - exponent).max(initial=-np.inf) + exponent[i]
            if np.isfinite(row) and np.isfinite(column):
                exponent[i] = np.clip(exponent[i] + np.rint((row - column) / 2), -500, 500)
        if np.array_equal(before, exponent):
            break
    return np.exp2(exponent)


def _least_rays(others: NDArray[np.complex128], dominant: float, n: int) -> int:
    """Lower bound max(n, p_i) on the number of generators of any invariant polyhedral cone.

    P is an N x N matrix with nonnegative off-diagonal entries whose spectrum holds that of A, hence
    N >= pi / atan(gap / frequency) for every complex pair (Dmitriev and Dynkin; for a discrete-time
    cone the same holds for P minus a multiple of the identity).
    """
    pairs = others[others.imag > 0]
    if not pairs.size:
        return n
    angle = np.arctan2(dominant - pairs.real, pairs.imag)
    angle = angle[angle > 0]  # the others exclude any polyhedral cone
    if not angle.size:
        return n
    # A pair exactly at tan(pi/p) must not be pushed to p + 1 by the rounding of its eigenvalue.
    return max(n, int(np.ceil(np.pi / angle * (1 - 1e-9)).max()))


@dataclass(frozen=True, eq=False)
class Analysis:
    """A in balanced units, with its modes.

    Attributes
    ----------
    A : Matrix, shape (n, n)
    matrix : ndarray, shape (n, n)
        diag(units)^-1 A diag(units), up to rounding.
    units : ndarray, shape (n,)
    discrete : bool
    modes : Modes or None
        Of `matrix`.
    """

    A: Matrix
    matrix: Array
    units: Array
    discrete: bool
    modes: Modes | None

    @cached_property
    def near_modes(self) -> tuple[Array, Array] | None:
        """A basis V close to eigenvectors of A, and T = V^-1 A V accurately.

        None if V is numerically singular, or the effort left is too little for exact products.
        """
        effort = _ROUNDS * _PER_EXACT_PRODUCT * len(self.matrix) ** 3
        basis = _eigenbasis(self.matrix)
        if not np.linalg.cond(basis) < 1e12 or not affords(effort):
            return None
        spend(effort)
        V = basis * self.units[:, None]
        exact, inverse = Matrix(V), np.linalg.inv(basis) / self.units
        T, last = np.zeros_like(V), np.inf
        for _ in range(_ROUNDS):
            rest = as_doubles(*summed_products([(self.A, Matrix(V.T)), (exact, Matrix(-T.T))]))
            with np.errstate(over="ignore", invalid="ignore"):
                change = inverse @ rest
                size = float(np.abs(change).max())
            if not size < last:
                break
            T, last = T + change, size
        return (V, T) if np.isfinite(T).all() else None

    @cached_property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues, accurate as long as the condition number of the eigenvectors is below 1e12."""
        m = self.modes
        if m is not None and m.conditioning < WELL_CONDITIONED:
            return np.concatenate([[m.dominant], m.others, m.others[m.others.imag > 0].conj()])
        simple = m is None and np.linalg.cond(_eigenbasis(self.matrix)) < WELL_CONDITIONED
        near = None if simple else self.near_modes
        return np.linalg.eigvals(self.matrix if near is None else near[1]).astype(np.complex128)

    @cached_property
    def fewest_rays(self) -> int:
        """Least number of rays (and of facets) of an invariant polyhedral cone, from the spectrum."""
        values = self.eigenvalues
        first = dominant_index(values, discrete=self.discrete)
        rest = values[np.arange(len(values)) != first]
        # Rounding turns a repeated eigenvalue into pairs close to it, which bound nothing.
        rest = rest[np.abs(rest - values[first]) > _SPLIT * np.abs(values).max()]
        size = float(abs(values[first])) if self.discrete else float(values[first].real)
        return _least_rays(rest[rest.imag > 0], size, len(values))


def analysis(A: Matrix, *, discrete: bool) -> Analysis:
    """Units and modes of a matrix: one dense eigenvalue decomposition."""
    matrix, units = balanced(A)
    return Analysis(A, matrix, units, discrete, modes(matrix, discrete=discrete))
