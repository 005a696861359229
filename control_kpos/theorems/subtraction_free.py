"""Solutions for compartments with nearly all digits, however small the outflows: elimination without subtraction.

Let N >= 0 off the diagonal, w >= 0, and M = diag(N 1 + w) - N, so that M 1 = w.  Elimination of M x = b >= 0 on N and
w in the place of the diagonal adds, multiplies and divides nonnegative numbers only (Alfa, Xue and Ye, Mathematics of
Computation 71 (2002)):

    p_i = w_i + sum_{j>i} N_ij,   N_kj += N_ki N_ij / p_i,   w_k += N_ki w_i / p_i,   b_k += N_ki b_i / p_i   (k > i),
    x_i = (b_i + sum_{j>i} N_ij x_j) / p_i    (backwards).

*The error.*  Let u = 2^-53 and E = 1 / (1 - u): a rounding changes a nonnegative number by a factor between 1/E and E.
With k = n - 1 - i numbers left behind i, p_i takes k roundings, and each of N_kj, w_k, b_k at most k + 3 in step i.  An
entry of the solution of k equations is a quotient of two polynomials in the entries of N and w with positive
coefficients, homogeneous of the degrees k - 1 and k, times b (the matrix-tree theorem; Kirchhoff).  So factors within
E^(k+3) of all entries move the solution by a factor within E^(2k(k+3)); going back adds 2k + 2 roundings.  In all

    sum_{k=0}^{n-1} (2 k (k + 3) + 2 k + 2) = n (n - 1)(2n - 1) / 3 + 4 n (n - 1) + 2 n

roundings, and 2n more where the rates themselves were rounded: the relative error is below (2/3 n^3 + 4 n^2 + 4 n) u,
up to 1 %, as long as nothing overflows or underflows, which is watched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import TooLargeError, UndecidedError

Floats = NDArray[np.float64]
# Compartments whose elimination takes seconds.
LARGEST = 2000
_UNIT = 2.0**-53


def relative_error(n: int, more: int = 0) -> float:
    """A bound of the relative error of every entry of `solve_without_subtraction`, and of `more` roundings after it.

    Parameters
    ----------
    n : int
    more : int
        Roundings in sums and products of nonnegative numbers.
    """
    count = n * (n - 1) * (2 * n - 1) // 3 + 4 * n * (n - 1) + 4 * n + more
    return 1.01 * count * _UNIT


def solve_without_subtraction(N: Floats, w: Floats, b: Floats) -> Floats:
    """x with (diag(N 1 + w) - N) x = b, every entry within `relative_error(n)` of its size.

    Parameters
    ----------
    N : ndarray, shape (n, n)
        Nonnegative; its diagonal is not read.
    w : ndarray, shape (n,)
        Nonnegative; every row reaches one that is positive through positive entries of N.
    b : ndarray, shape (n, r)
        Nonnegative.

    Raises
    ------
    TooLargeError
        n is above 2000.
    UndecidedError
        A number left the range of doubles.
    """
    n = len(w)
    if n > LARGEST:
        raise TooLargeError(f"{n} compartments are eliminated as a dense matrix; the limit is {LARGEST}.")
    N, w, b = np.array(N, dtype=float), np.array(w, dtype=float), np.array(b, dtype=float)
    np.fill_diagonal(N, 0.0)
    try:
        with np.errstate(all="raise"):
            return _eliminated(N, w, b)
    except FloatingPointError:
        raise UndecidedError(
            "the rates differ by so much that a product of them leaves the range of doubles; scale the time, or leave "
            "out what is negligible."
        ) from None


def _eliminated(N: Floats, w: Floats, b: Floats) -> Floats:
    n, p = len(w), np.empty(len(w))
    for i in range(n):
        ahead = slice(i + 1, None)
        p[i] = w[i] + N[i, ahead].sum()
        into = np.flatnonzero(N[ahead, i]) + i + 1
        if not into.size:
            continue
        share = N[into, i] / p[i]
        out = np.flatnonzero(N[i, ahead]) + i + 1
        N[np.ix_(into, out)] += share[:, None] * N[i, out]
        w[into] += share * w[i]
        b[into] += share[:, None] * b[i]
    x = np.zeros_like(b)
    for i in range(n - 1, -1, -1):
        x[i] = (b[i] + (N[i, i + 1 :, None] * x[i + 1 :]).sum(axis=0)) / p[i]
    return x
