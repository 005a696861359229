"""The dominant direction e and a complement that A keeps: A [e Q] = [e Q] blkdiag(lam, S).

Where eigenvectors are well conditioned Q holds the modes, and S is block-diagonal.  Where other eigenvalues
than the dominant one are (nearly) defective, Q is any orthonormal basis of {x : l'x = 0}.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from .modes import Modes, dominant_index, modes

Array = NDArray[np.float64]

_WELL_CONDITIONED = 1e6
# Below this, relative to the largest eigenvalue, a gap is not told from rounding.
_SMALLEST_GAP = 1e-9


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


def split(A: Array, *, discrete: bool) -> Split | None:
    """The coordinates, or None if the dominant eigenvalue is not real and simple."""
    m = modes(A, discrete=discrete)
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
