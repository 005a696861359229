"""Rows of one entry as bounds of their variable: the part of a presolve that costs no more than it saves."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rows_to_bounds(
    matrix: sp.csr_array, lower: Floats, upper: Floats, box: list[Floats]
) -> tuple[sp.csr_array, Floats, Floats, list[Floats]]:
    """lower <= matrix x <= upper without its rows of one entry, and the box that these make narrower.

    Parameters
    ----------
    matrix : csr_array, shape (m, n)
        No entry stands twice.
    lower, upper : ndarray, shape (m,)
    box : list of two ndarray, shape (n,)

    Examples
    --------
    >>> rows = sp.csr_array([[-2.0, 0.0], [1.0, 1.0]])
    >>> rest, lower, upper, (low, high) = rows_to_bounds(
    ...     rows, np.array([-np.inf, 0.0]), np.array([4.0, 1.0]), [np.full(2, -9.0), np.full(2, 9.0)]
    ... )
    >>> rest.toarray().tolist(), upper.tolist(), low.tolist(), high.tolist()
    ([[1.0, 1.0]], [1.0], [-2.0, -9.0], [9.0, 9.0])
    """
    single = np.diff(matrix.indptr) == 1
    at = matrix.indptr[:-1][single]
    single[single] = matrix.data[at] != 0
    if not single.any():
        return matrix, lower, upper, box
    at = matrix.indptr[:-1][single]
    column, factor = matrix.indices[at], matrix.data[at]
    with np.errstate(all="ignore"):
        ends = np.sort(np.stack([lower[single], upper[single]]) / factor, axis=0)
    low, high = (side.copy() for side in box)
    np.maximum.at(low, column, ends[0])
    np.minimum.at(high, column, ends[1])
    return sp.csr_array(matrix[~single]), lower[~single], upper[~single], [low, high]
