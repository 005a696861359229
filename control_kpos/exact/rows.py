"""Rows that matter only up to positive factors: generators and facet normals as `Matrix`.

The exact integers behind rounded rows are reached through small callable objects rather than closures,
so that cones can be pickled.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from .matrix import Integers, Matrix, dense, divide_by_content
from .rounding import error_factor, rounding_radius, sum_factor, underflow

# Integer rows up to this size are shown as they are; larger ones are scaled into [1/2, 1).
_READABLE = 2**20
# Multiplications of integers up to which images are computed exactly at once.
_EXACT_IMAGE = 3_000_000


def equilibrate(size: NDArray[np.int64], nonzero: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Exponents r, c such that entries of binary size `size` times 2**-(r_i + c_j) have size about 1.

    Parameters
    ----------
    size : ndarray of int, shape (p, n)
        Binary exponents of the entries.
    nonzero : ndarray of bool, shape (p, n)
        Entries that count.

    Returns
    -------
    rows, columns : ndarray of int, shapes (p, 1), (n,)
    """
    far = np.int64(-(2**60))
    rows, columns = np.zeros((len(size), 1), dtype=np.int64), np.zeros(size.shape[1], dtype=np.int64)
    for _ in range(3):
        columns = np.where(nonzero, size - rows, far).max(axis=0, initial=far)
        columns = np.where(nonzero.any(axis=0), columns, 0)
        rows = np.where(nonzero, size - columns, far).max(axis=1, keepdims=True, initial=far)
        rows = np.where(nonzero.any(axis=1, keepdims=True), rows, 0)
    return rows, columns


def unit_rows(rows: Integers) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Integer rows as doubles, correctly rounded, times 2**-length so that entries are below 1."""
    lengths = np.array([max((int(x).bit_length() for x in row), default=0) for row in rows], dtype=np.int64)
    flat = [int(x) / (1 << int(length)) for row, length in zip(rows, lengths, strict=True) for x in row]
    return np.array(flat, dtype=float).reshape(rows.shape), lengths


def exact_rows(rows: Integers) -> Matrix:
    """Integer rows, without common factors, as doubles: as they are if readable, else scaled and rounded.

    Each row that does not fit into doubles is multiplied by the power of two that brings its largest
    entry into [1/2, 1), and correctly rounded.
    """
    largest = np.array([max((abs(int(x)) for x in row), default=0) for row in rows], dtype=object)
    if not len(rows) or largest.max() <= _READABLE:
        return Matrix(rows.astype(np.float64))
    values, lengths = unit_rows(rows)
    readable = (largest <= _READABLE).astype(bool)
    values[readable] = rows[readable].astype(np.float64)
    exact = readable | (lengths <= 53)
    if exact.all():
        return Matrix(values)
    radius = rounding_radius(values)
    radius[exact[:, None] | (rows == 0)] = 0
    return Matrix(values, radius, integer_rows=rows.__getitem__)


def nonzero(matrix: Matrix) -> NDArray[np.bool_]:
    """Entries of a dense matrix that are not zero; those too small for a double are not."""
    if matrix.integer_rows is not None:
        return matrix.rows_as_integers(np.arange(matrix.shape[0])) != 0
    return (matrix.values if matrix.numerators is None else matrix.numerators) != 0


def image_rows(matrix: Matrix, T: Matrix) -> Matrix:
    """Rows T x for the rows x of a dense matrix, without those that are zero."""
    work = matrix.shape[0] * matrix.shape[1] * T.shape[0]
    if work > _EXACT_IMAGE:
        return _without_zero_rows(_rounded_image(matrix, T))
    ints, factor = T.as_integers()
    if matrix.integer_rows is not None:
        images = matrix.rows_as_integers(np.arange(matrix.shape[0])) @ ints.T
        return exact_rows(divide_by_content(images[(images != 0).any(axis=1)]))
    rows, scale = matrix.as_integers()
    images = rows @ ints.T
    return Matrix.from_fractions(images[(images != 0).any(axis=1)] * Fraction(factor * scale))


@dataclass(frozen=True, eq=False)
class ImageRows:
    """Rows T x, exactly, one by one."""

    matrix: Matrix
    T: Matrix

    def __call__(self, index: NDArray[np.intp]) -> Integers:
        return divide_by_content(self.matrix.rows_as_integers(index) @ self.T.as_integers()[0].T)


def _rounded_image(matrix: Matrix, T: Matrix) -> Matrix:
    """Rows T x in floating point with an error bound (see `rounding`), shape (p, m)."""
    left, right = dense(matrix.values), dense(T.values).T
    left_radius = np.zeros_like(left) if matrix.radius is None else np.asarray(matrix.radius)
    right_radius = np.zeros_like(right) if T.radius is None else dense(T.radius).T
    with np.errstate(all="ignore"):
        values = left @ right
        terms = left.shape[1]
        radius = error_factor(terms) * (np.abs(left) @ np.abs(right))
        if T.radius is not None:
            radius += np.abs(left) @ right_radius
        if matrix.radius is not None:
            radius += left_radius @ (np.abs(right) + right_radius)
        radius = radius * sum_factor(terms) + underflow(terms)
    if not (np.isfinite(values).all() and np.isfinite(radius).all()):
        raise DataError("the image of the cone overflows; rescale T.")
    return Matrix(values, radius, integer_rows=ImageRows(matrix, T))


def _without_zero_rows(matrix: Matrix) -> Matrix:
    open_ = np.flatnonzero(~(np.abs(matrix.values) > matrix.radius).any(axis=1))
    zero = open_[~(matrix.rows_as_integers(open_) != 0).any(axis=1)] if len(open_) else open_
    return matrix[np.setdiff1d(np.arange(matrix.shape[0]), zero)]


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array, made read-only."""
    array.flags.writeable = False
    return array
