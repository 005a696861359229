"""Rows of linear programs: dense while they are small, sparse where most entries are zero and there are many.

Functions here take either kind and return the kind they were given.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import spend
from ...exact.program import SMALL

Floats = NDArray[np.float64]

# Operations that it takes to assemble and to scale a program, for each entry that is not zero, in all its copies.
_EFFORT = 150.0
# Entries of a program beyond which memory ends before patience does.
_MOST_ENTRIES = 10**8


def spend_on_entries(entries: float) -> None:
    """Count the operations that it takes to set up a program with so many entries that are not zero.

    Raises
    ------
    OutOfBudgetError
        If they are not left, or memory would not hold it.
    """
    spend(entries * _EFFORT if entries <= _MOST_ENTRIES else np.inf)


def compact(rows: Any) -> Any:
    """Small sparse matrices as dense ones."""
    return rows.toarray() if sp.issparse(rows) and rows.shape[0] * rows.shape[1] <= SMALL else rows


def entry_rows(data: Floats, columns: NDArray[np.intp], width: int) -> sp.csr_array:
    """Rows with entries data[r, e] in the columns columns[r, e], which differ within a row; zeros are left out."""
    held = data != 0
    indptr = np.concatenate([[0], np.cumsum(held.sum(axis=1))])
    return sp.csr_array((data[held], columns[held], indptr), shape=(len(data), width))


def products(left: Floats, right: Floats, k: NDArray[np.intp], free: NDArray[np.intp]) -> Any:
    """Rows of left_r' L right_k(r) over the entries `free` of L in row-major order.

    Parameters
    ----------
    left, right : ndarray, shapes (R, m), (p, q)
    k : ndarray of int, shape (R,)
    free : ndarray of int, shape (f,)
    """
    count, m = left.shape
    width = right.shape[1]
    if count * m * width <= SMALL:
        return (left[:, :, None] * right[k][:, None, :]).reshape(count, m * width)[:, free]
    # only pairs of entries that are not zero
    held = np.count_nonzero(right, axis=1)
    spend_on_entries(float(np.count_nonzero(left, axis=1) @ held[k]))
    r, j = np.nonzero(left)
    l = np.nonzero(right)[1]
    starts = np.cumsum(held) - held
    each = held[k[r]]
    first = np.repeat(np.arange(len(r)), each)
    second = np.arange(len(first)) - np.repeat(np.cumsum(each) - each - starts[k[r]], each)
    place = np.full(m * width, -1)
    place[free] = np.arange(len(free))
    row, column = r[first], place[j[first] * width + l[second]]
    kept = column >= 0
    row, column = row[kept], column[kept]
    values = left[r, j][first[kept]] * right[right != 0][second[kept]]
    return sp.csr_array((values, column, np.searchsorted(row, np.arange(count + 1))), shape=(count, len(free)))


def solved(M: Floats, right: Floats) -> Floats:
    """x with M x = right; not a number if floating point finds M singular."""
    try:
        return np.asarray(np.linalg.solve(M, right), dtype=float)
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.nan)


def stacked(*parts: Any) -> Any:
    """One below the other."""
    if any(sp.issparse(part) for part in parts):
        return sp.csr_array(sp.vstack([sp.csr_array(part) for part in parts], format="csr"))
    return np.concatenate(parts)


def scaled(M: Any, scale: Floats) -> Any:
    """M with its columns multiplied."""
    return M @ sp.diags_array(scale, format="csr") if sp.issparse(M) else M * scale


def scaled_rows(M: Any, scale: Floats) -> Any:
    """M with its rows multiplied."""
    return sp.diags_array(scale, format="csr") @ M if sp.issparse(M) else M * scale[:, None]
