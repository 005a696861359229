"""Cones for a matrix with ill-conditioned eigenvectors, found in coordinates close to its modes.

Computed in floating point, eigenvectors of condition number k are wrong by about |A| k / gap units in the
last place, which for k = 1e7 can be all of them.  Rounded, they are still a basis V, known exactly, and

    T = V^-1 A V

is nearly diagonal: its eigenvectors are well conditioned.  Iterative refinement with the residual
A V - V T in exact arithmetic gives every entry of T to almost full precision.  A cone R for T becomes
the cone V R for A, with the same P.  V R is kept exactly, since rounding it would move it by k units in
the last place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import seconds_left
from ...exact.matrix import Matrix
from ...exact.products import as_doubles, summed_products
from .modes import eigenbasis

Array = NDArray[np.float64]

_ROUNDS = 6
_SECONDS_PER_PRODUCT = 1e-7


def modal_coordinates(A: Matrix, matrix: Array, units: Array) -> tuple[Array, Array] | None:
    """A basis V close to eigenvectors of A, and T = V^-1 A V accurately.

    Parameters
    ----------
    A : Matrix, shape (n, n)
    matrix : ndarray, shape (n, n)
        diag(units)^-1 A diag(units), up to rounding.
    units : ndarray, shape (n,)

    Returns
    -------
    V, T : ndarray, shape (n, n)
        None if V is numerically singular, or time is too short for exact products.
    """
    if seconds_left() < _ROUNDS * _SECONDS_PER_PRODUCT * len(matrix) ** 3:
        return None
    basis = eigenbasis(matrix)
    if not np.linalg.cond(basis) < 1e12:
        return None
    V = basis * units[:, None]
    exact, inverse = Matrix(V), np.linalg.inv(basis) / units
    T, last = np.zeros_like(V), np.inf
    for _ in range(_ROUNDS):
        rest = as_doubles(*summed_products([(A, Matrix(V.T)), (exact, Matrix(-T.T))]))
        with np.errstate(over="ignore", invalid="ignore"):
            change = inverse @ rest
            size = float(np.abs(change).max())
        if not size < last:
            break
        T, last = T + change, size
    return (V, T) if np.isfinite(T).all() else None
