"""The modes of a matrix, as building blocks of an invariant cone.

With A e = lam e for the dominant real eigenvalue lam and a real basis V of the other invariant
subspaces, A = [e V] blkdiag(lam, blocks) [e V]^-1, one 1 x 1 block for a real eigenvalue and one
2 x 2 block [[re, -im], [im, re]] for a complex pair.  In continuous time *dominant* means rightmost,
in discrete time of largest modulus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import require_seconds

# Eigenvalues, eigenvectors and their condition number take that long for an n x n matrix, divided by n^3.
SECONDS_PER_CUBE = 3e-9


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
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    others: NDArray[np.complex128]
    bases: list[NDArray[np.float64]]
    conditioning: float


def dominant_index(values: NDArray[np.complex128], *, discrete: bool) -> int:
    """Index of the dominant eigenvalue; among near ties a real (discrete: nonnegative) one."""
    size = np.abs(values) if discrete else values.real
    top = size.max()
    slack = 1e-13 * (np.abs(values).max() + np.finfo(float).tiny)
    near = np.flatnonzero(size >= top - slack)
    good = near[(np.abs(values[near].imag) == 0) & ((values[near].real >= 0) | (not discrete))]
    return int(good[0] if good.size else near[0])


def modes(A: NDArray[np.float64], *, discrete: bool = False) -> Modes | None:
    """Modal form of A, or None if the computed dominant eigenvalue is not real or A looks defective.

    Costs one dense eigenvalue decomposition.
    """
    require_seconds(SECONDS_PER_CUBE * len(A) ** 3)
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


def eigenbasis(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Real and imaginary parts of the eigenvectors, columns of length about 1; shape (n, n)."""
    require_seconds(SECONDS_PER_CUBE * len(A) ** 3)
    values, vectors = np.linalg.eig(A)
    columns = [
        np.real(vectors[:, [i]]) / np.linalg.norm(np.real(vectors[:, i]))
        if values[i].imag == 0
        else _orthogonal_pair(vectors[:, i])
        for i in range(len(values))
        if values[i].imag >= 0
    ]
    return np.column_stack(columns)


def _orthogonal_pair(v: NDArray[np.complex128]) -> NDArray[np.float64]:
    """[Re, -Im] of v turned in the complex plane until both parts are orthogonal: flattest ellipse axes."""
    v = v * np.exp(-0.5j * np.angle((v * v).sum()))
    pair = np.column_stack([v.real, -v.imag])
    return pair / np.linalg.norm(pair, axis=0).max()
