"""Exact linear algebra on integers: rank, null space, and normals of many hyperplanes at once.

Bareiss' fraction-free Gauss-Jordan elimination: after step k every entry is a minor of order k or
k + 1 of the matrix, so entries stay as small as exact answers allow and every division is exact.
Entries are int64 while products fit, Python integers afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .budget import require_seconds
from .matrix import Integers

# (a b - c d) stays below 2**63 if all entries do not exceed this.
_INT64_FACTOR = 2**31 - 1


@dataclass(frozen=True)
class Echelon:
    """Reduced row echelon form of an integer matrix, up to the common factor `pivot`.

    Attributes
    ----------
    rows : ndarray of int (object), shape (rank, n)
        `pivot` times the identity in the columns `pivot_columns`.
    pivot : int
        Not zero; its sign is that of no importance to callers, who divide by it.
    pivot_rows, pivot_columns : ndarray of int, shape (rank,)
        The first rows of the matrix that are independent, and where their pivots are.
    """

    rows: Integers
    pivot: int
    pivot_rows: NDArray[np.intp]
    pivot_columns: NDArray[np.intp]

    @property
    def rank(self) -> int:
        return len(self.pivot_rows)

    def null_space(self) -> Integers:
        """Integer basis of {x : rows @ x = 0}, one vector a row."""
        n = self.rows.shape[1]
        free = np.setdiff1d(np.arange(n), self.pivot_columns)
        basis = np.zeros((len(free), n), dtype=object)
        basis[np.arange(len(free)), free] = self.pivot
        basis[:, self.pivot_columns] = -self.rows[:, free].T
        return divide_by_content(basis)


def divide_by_content(rows: Integers) -> Integers:
    """Each row divided by the greatest common divisor of its entries; zero rows stay."""
    if not rows.size:
        return rows
    content = np.abs(np.gcd.reduce(rows, axis=-1, keepdims=True))  # of a single entry, reduce keeps the sign
    return rows // np.where(content == 0, 1, content)


def as_small_integers(matrix: NDArray[Any]) -> NDArray[Any]:
    """As int64 if products of two entries fit into it."""
    if matrix.dtype == np.int64 or not matrix.size:
        return matrix
    small = int(max(matrix.max(), -matrix.min())) <= _INT64_FACTOR
    return matrix.astype(np.int64) if small else matrix


def _room(matrix: NDArray[Any]) -> NDArray[Any]:
    """As Python integers if products of two entries would overflow int64."""
    if matrix.dtype != np.int64 or not matrix.size or max(matrix.max(), -matrix.min()) <= _INT64_FACTOR:
        return matrix
    return matrix.astype(object)


def echelon(matrix: Integers) -> Echelon:
    """Exact reduced row echelon form of an integer matrix, shape (p, n).

    Costs about p n^2 multiplications of integers.
    """
    work = as_small_integers(np.array(matrix))
    p, n = work.shape
    open_rows = np.ones(p, dtype=bool)
    rows: list[int] = []
    columns: list[int] = []
    last = 1
    while True:
        require_seconds()
        # the first row that is not yet zero is independent of the rows before it
        alive = open_rows & (work != 0).any(axis=1)
        if not alive.any():
            break
        row = int(np.argmax(alive))
        column = int(np.argmax(work[row] != 0))
        work = _room(work)
        pivot = work[row, column]
        factor = work[:, column].copy()
        factor[row] = 0
        kept = work[row].copy()
        work = (work * pivot - factor[:, None] * kept) // last
        work[row] = kept
        last = int(pivot)
        open_rows[row] = False
        rows.append(row)
        columns.append(column)
        if len(rows) == n:
            break
    pivot_rows, pivot_columns = np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)
    return Echelon(work[pivot_rows].astype(object), last, pivot_rows, pivot_columns)


def inverse_rows(matrix: Integers) -> Integers | None:
    """Rows h_k with h_k'x_i = 0 for k != i and h_k'x_k > 0, for the rows x_i of a square integer matrix.

    None if the matrix is singular.  These are the rows of the transposed inverse, up to positive factors.
    """
    n = len(matrix)
    if not n:
        return np.zeros((0, 0), dtype=object)
    wide = np.concatenate([np.asarray(matrix, dtype=object), np.eye(n, dtype=int).astype(object)], axis=1)
    form = echelon(wide)
    if not (form.pivot_columns < n).all():
        return None
    inverse = np.empty((n, n), dtype=object)
    inverse[form.pivot_columns] = form.rows[:, n:]
    return divide_by_content(inverse.T * (1 if form.pivot > 0 else -1))


def normals(stack: Integers) -> Integers:
    """Vectors orthogonal to all rows of each matrix of a stack.

    Parameters
    ----------
    stack : ndarray of int (object), shape (k, n - 1, n)

    Returns
    -------
    ndarray of int (object), shape (k, n)
        The vector of maximal minors, without common factor and of either sign; zero where the n - 1
        rows are dependent.  Costs about k n^3 / 2 multiplications of integers.
    """
    count, rows, n = stack.shape
    work: NDArray[Any] = np.array(as_small_integers(stack))
    order = np.tile(np.arange(n), (count, 1))
    each = np.arange(count)
    last: NDArray[Any] = np.ones(count, dtype=work.dtype)
    singular = np.zeros(count, dtype=bool)
    for k in range(rows):
        require_seconds()
        # row k of an independent set has a nonzero entry left; swap it into column k
        pivot_at = k + np.argmax(work[:, k, k:] != 0, axis=1)
        swap = np.flatnonzero(pivot_at != k)
        at = pivot_at[swap]
        order[swap, k], order[swap, at] = order[swap, at], order[swap, k]
        work[swap, :, k], work[swap, :, at] = work[swap, :, at], work[swap, :, k]
        work = _room(work)
        pivot = work[:, k, k].copy()
        singular |= pivot == 0
        pivot[pivot == 0] = 1
        below = pivot[:, None, None] * work[:, k + 1 :, k + 1 :]
        below -= work[:, k + 1 :, k, None] * work[:, None, k, k + 1 :]
        work[:, k + 1 :, k + 1 :] = below // last[:, None, None] if k else below
        work[:, k, k] = last = pivot

    # back substitution; minors of the whole matrix, so that every division is exact
    h = np.zeros((count, n), dtype=object)
    h[:, rows] = last
    for k in range(rows - 1, -1, -1):
        h[:, k] = -(work[:, k, k + 1 :] * h[:, k + 1 :]).sum(axis=1) // work[:, k, k]
    out = np.zeros_like(h)
    out[each[:, None], order] = h
    out[singular] = 0
    return divide_by_content(out)
