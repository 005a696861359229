"""The modes of a matrix, as building blocks of an invariant cone.

With A e = lam e for the dominant real eigenvalue lam and a real basis V of the other invariant
subspaces, A = [e V] blkdiag(lam, blocks) [e V]^-1, one 1 x 1 block for a real eigenvalue and one
2 x 2 block [[re, -im], [im, re]] for a complex pair.  In continuous time *dominant* means rightmost,
in discrete time of largest modulus.  Where other eigenvalues than the dominant one are (nearly) defective, V is
an orthonormal basis of {x : l'x = 0}, l being the dominant left eigenvector (`split`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import spend
from ...exact.matrix import Matrix

Array = NDArray[np.float64]

# Eigenvalues, eigenvectors and their condition number: operations for an n x n matrix, divided by n^3.
PER_CUBE = 3.0
# Eigenvectors of a larger condition number are not used as a basis of the complement.
_WELL_CONDITIONED = 1e6
# Below this, relative to the largest eigenvalue, a gap is not told from rounding.
_SMALLEST_GAP = 1e-9


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
    slack = 1e-13 * (np.abs(values).max() + np.finfo(float).tiny)
    near = np.flatnonzero(size >= top - slack)
    good = near[(np.abs(values[near].imag) == 0) & ((values[near].real >= 0) | (not discrete))]
    return int(good[0] if good.size else near[0])


def modes(A: Array, *, discrete: bool = False) -> Modes | None:
    """Modal form of A, or None if the computed dominant eigenvalue is not real or A looks defective.

    Costs one dense eigenvalue decomposition.
    """
    spend(PER_CUBE * len(A) ** 3)
    values, vectors = np.linalg.eig(A)
    values, vectors = values.astype(complex), vectors.astype(complex)
    first = dominant_index(values, discrete=discrete)
    if values[first].imag != 0 or (discrete and values[first].real < 0):
        return None
    right = np.real(vectors[:, first])
    right = right / np.linalg.norm(right)
    others, bases = [], []
    for i in range(len(values)):
        if i == first or values[i].imag < 0:
            continue
        if values[i].imag == 0:
            column = np.real(vectors[:, [i]])
            bases.append(column / np.linalg.norm(column))
        else:
            bases.append(_orthogonal_pair(vectors[:, i]))
        others.append(values[i])
    basis = np.column_stack([right, *bases])
    conditioning = float(np.linalg.cond(basis)) if basis.shape[0] == basis.shape[1] else np.inf
    if not conditioning < 1e14:
        return None
    left = sl.solve(basis.T, np.eye(len(values))[0])
    return Modes(float(values[first].real), right, left, np.array(others, dtype=complex), bases, conditioning)


def eigenbasis(A: Array) -> Array:
    """Real and imaginary parts of the eigenvectors, columns of length about 1; shape (n, n)."""
    spend(PER_CUBE * len(A) ** 3)
    values, vectors = np.linalg.eig(A)
    columns = [
        np.real(vectors[:, [i]]) / np.linalg.norm(np.real(vectors[:, i]))
        if values[i].imag == 0
        else _orthogonal_pair(vectors[:, i])
        for i in range(len(values))
        if values[i].imag >= 0
    ]
    return np.column_stack(columns)


def _orthogonal_pair(v: NDArray[np.complex128]) -> Array:
    """[Re, -Im] of v turned in the complex plane until both parts are orthogonal: flattest ellipse axes."""
    v = v * np.exp(-0.5j * np.angle((v * v).sum()))
    pair = np.column_stack([v.real, -v.imag])
    return pair / np.linalg.norm(pair, axis=0).max()


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


@dataclass(frozen=True, eq=False)
class Split:
    """Coordinates (1, y) with the dominant direction first.

    Attributes
    ----------
    dominant : float
    right, left : ndarray, shape (n,)
        A right = dominant right, left A = dominant left, left right = 1.
    complement : ndarray, shape (n, n - 1)
        Q.
    S : ndarray, shape (n - 1, n - 1)
        A Q = Q S.
    gap : float
        Distance from the dominant eigenvalue to the real part (discrete time: modulus) of the next one.
    modes : Modes or None
        If Q holds the modes.
    """

    dominant: float
    right: Array
    left: Array
    complement: Array
    S: Array
    gap: float
    modes: Modes | None

    @property
    def basis(self) -> Array:
        """[e Q]."""
        return np.column_stack([self.right, self.complement])

    def turned(self) -> Split:
        """The same with -e."""
        return replace(self, right=-self.right, left=-self.left)


def split(A: Array, m: Modes | None, *, discrete: bool) -> Split | None:
    """A [e Q] = [e Q] blkdiag(lam, S), or None if the dominant eigenvalue is not real and simple.

    Q holds the modes m of A where they are well conditioned, else any orthonormal basis of {x : l'x = 0}.
    """
    if m is not None and m.conditioning < _WELL_CONDITIONED:
        blocks = [
            np.array([[z.real, -z.imag], [z.imag, z.real]])[: V.shape[1], : V.shape[1]]
            for z, V in zip(m.others, m.bases, strict=True)
        ]
        size = len(A) - 1
        S = sl.block_diag(*blocks) if blocks else np.zeros((size, size))
        Q = np.column_stack(m.bases) if blocks else np.zeros((len(A), size))
        gap = m.dominant - (np.abs(m.others) if discrete else m.others.real)
        return Split(m.dominant, m.right, m.left, Q, S, float(gap.min(initial=1.0)), m)
    return _by_functional(A, discrete)


def _by_functional(A: Array, discrete: bool) -> Split | None:
    values, left, right = (np.asarray(a, dtype=np.complex128) for a in sl.eig(A, left=True, right=True))
    first = dominant_index(values, discrete=discrete)
    if values[first].imag != 0 or (discrete and values[first].real < 0):
        return None
    e, functional = right[:, first].real, left[:, first].real
    rest = np.delete(values, first)
    gap = float((values[first].real - (np.abs(rest) if discrete else rest.real)).min(initial=1.0))
    height = float(functional @ e)
    if gap <= _SMALLEST_GAP * float(np.abs(values).max()) or abs(height) < 1e-8:
        return None
    Q = sl.null_space(functional[None, :])
    return Split(float(values[first].real), e, functional / height, Q, Q.T @ A @ Q, gap, None)
