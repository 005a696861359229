"""Sparse matrices of integers of any length: products, parts, and their entries in floating point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .matrix import Index, Integers, Matrix, integers_of_doubles

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SparseIntegers:
    """A matrix of integers by rows.

    Attributes
    ----------
    data : ndarray of int (object), shape (nnz,)
    indices, indptr : ndarray of int
        As in a csr_array: columns of the entries, and where each row begins.
    width : int
        Number of columns.
    """

    data: Integers
    indices: Index
    indptr: Index
    width: int

    @classmethod
    def of(cls, rows: Index, columns: Index, data: Integers, shape: tuple[int, int]) -> SparseIntegers:
        """From entries at given places; those at the same place are added."""
        key = np.asarray(rows, dtype=np.int64) * shape[1] + columns
        if (np.diff(key) <= 0).any():
            order = np.argsort(key, kind="stable")
            key, data = key[order], data[order]
            first = np.flatnonzero(np.diff(key, prepend=-1))
            if first.size < key.size:
                key, data = key[first], np.add.reduceat(data, first)
        rows, columns = np.divmod(key, max(shape[1], 1))
        indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=shape[0]))])
        return cls(data, columns.astype(np.intp), indptr.astype(np.intp), shape[1])

    @classmethod
    def dense(cls, rows: Integers) -> SparseIntegers:
        """From a matrix, without its zeros."""
        at = np.nonzero(rows)
        return cls.of(at[0], at[1], rows[at], (rows.shape[0], rows.shape[1]))

    @classmethod
    def diagonal(cls, values: Integers) -> SparseIntegers:
        """A diagonal matrix."""
        at = np.arange(len(values))
        return cls(values, at, np.arange(len(values) + 1), len(values))

    @property
    def height(self) -> int:
        """Number of rows."""
        return len(self.indptr) - 1

    @cached_property
    def rows(self) -> Index:
        """Row of every entry."""
        return np.repeat(np.arange(self.height), np.diff(self.indptr))

    @property
    def T(self) -> SparseIntegers:
        """The transpose."""
        at = np.arange(len(self.data))
        places = sp.csr_array((at, self.indices, self.indptr), shape=(self.height, self.width)).tocsc()
        indices, indptr = places.indices.astype(np.intp), places.indptr.astype(np.intp)
        return SparseIntegers(self.data[places.data], indices, indptr, self.height)

    @cached_property
    def mantissas(self) -> tuple[Floats, NDArray[np.int64]]:
        """The entries in floating point; see the function."""
        return mantissas(self.data)

    @cached_property
    def sizes(self) -> Integers:
        """|N_ii|, or the largest of these where N_ii = 0: the same for the transpose."""
        diagonal = np.zeros(self.height, dtype=object)
        own = self.rows == self.indices
        diagonal[self.rows[own]] = np.abs(self.data[own])
        diagonal[diagonal == 0] = max(1, diagonal.max(initial=0))
        return diagonal

    def take(self, rows: Index) -> SparseIntegers:
        """Some rows."""
        count = np.diff(self.indptr)[rows]
        indptr = np.concatenate([[0], np.cumsum(count)])
        at = np.repeat(self.indptr[rows] - indptr[:-1], count) + np.arange(indptr[-1])
        return SparseIntegers(self.data[at], self.indices[at], indptr, self.width)

    def apply(self, x: Integers) -> Integers:
        """The product with a vector."""
        return _row_sums(self.data * x[self.indices], self.indptr)

    def paired(self, other: SparseIntegers, rows: Index, others: Index) -> Integers:
        """Products of rows of this matrix with rows of another, pair by pair."""
        theirs = other.take(others)
        places = self.rows * self.width + self.indices
        wanted = rows[theirs.rows] * self.width + theirs.indices
        at = np.minimum(np.searchsorted(places, wanted), max(len(places) - 1, 0))
        values = np.zeros(len(wanted), dtype=object)
        met = np.flatnonzero(places[at] == wanted) if len(places) else at[:0]
        values[met] = self.data[at[met]] * theirs.data[met]
        return _row_sums(values, theirs.indptr)

    def __matmul__(self, other: SparseIntegers) -> SparseIntegers:
        count = np.diff(other.indptr)[self.indices]
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        at = np.repeat(other.indptr[self.indices], count) + within
        data = np.repeat(self.data, count) * other.data[at]
        return SparseIntegers.of(np.repeat(self.rows, count), other.indices[at], data, (self.height, other.width))

    def __add__(self, other: SparseIntegers) -> SparseIntegers:
        return SparseIntegers.of(
            np.concatenate([self.rows, other.rows]),
            np.concatenate([self.indices, other.indices]),
            np.concatenate([self.data, other.data]),
            (self.height, self.width),
        )

    def times(self, factor: int) -> SparseIntegers:
        """All entries times an integer."""
        return self if factor == 1 else SparseIntegers(self.data * factor, self.indices, self.indptr, self.width)

    def without_zeros(self) -> SparseIntegers:
        """The same without entries that are zero."""
        kept = self.data != 0
        return SparseIntegers.of(self.rows[kept], self.indices[kept], self.data[kept], (self.height, self.width))

    def in_units(self, exponents: NDArray[np.int64], diagonal: Integers) -> tuple[SparseIntegers, Integers]:
        """A square matrix and a diagonal one, columns times 2**exponents, rows times a power of two for integers."""
        if not exponents.any():
            return self, diagonal
        own, lowest = exponents[self.indices], exponents.copy()
        filled = np.flatnonzero(np.diff(self.indptr))
        lowest[filled] = np.minimum(lowest[filled], np.minimum.reduceat(own, self.indptr[filled]))
        shift = (own - lowest[self.rows]).astype(object)
        scaled = SparseIntegers(self.data << shift, self.indices, self.indptr, self.width)
        return scaled, diagonal << (exponents - lowest).astype(object)

    def toarray(self) -> Integers:
        """All entries."""
        out = np.zeros((self.height, self.width), dtype=object)
        out[self.rows, self.indices] = self.data
        return out

    def pattern(self) -> sp.csr_array:
        """Ones where the entries are."""
        shape = (self.height, self.width)
        return sp.csr_array((np.ones(len(self.data)), self.indices, self.indptr), shape=shape)


def _row_sums(data: Integers, indptr: Index) -> Integers:
    """Sums of the entries of every row."""
    out = np.zeros(len(indptr) - 1, dtype=object)
    filled = np.flatnonzero(np.diff(indptr))
    if filled.size:
        out[filled] = np.add.reduceat(data, indptr[filled])
    return out


def mantissas(values: Integers) -> tuple[Floats, NDArray[np.int64]]:
    """Integers of any length as m * 2**e with m between 1/2 and 1 in size, correct to 52 bits."""
    if not values.size:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    try:
        m, e = np.frexp(values.astype(float))
        return m, e.astype(np.int64)
    except OverflowError:
        length = np.array([abs(v).bit_length() for v in values.tolist()], dtype=np.int64)
    cut = np.maximum(length - 62, 0)
    m, e = np.frexp((values >> cut.astype(object)).astype(np.int64).astype(float))
    return m, e + cut


def csr_integers(m: Matrix, rows: NDArray[np.intp]) -> SparseIntegers:
    """Rows as integers, each up to a positive factor."""
    if m.is_sparse and m.integer_rows is None and m.numerators is None:
        part = sp.csr_array(m.values)[rows]
        counts = np.diff(part.indptr)
        padded = np.zeros((len(rows), int(counts.max(initial=1))))
        slot = np.arange(part.nnz) - np.repeat(part.indptr[:-1], counts)
        owner = np.repeat(np.arange(len(rows)), counts)
        padded[owner, slot] = part.data
        ints = integers_of_doubles(padded, by_row=True)[0][owner, slot]
        return SparseIntegers.of(owner, part.indices, ints, part.shape)
    return SparseIntegers.dense(m.rows_as_integers(rows))


def columns_as_integers(m: Matrix, columns: NDArray[np.intp]) -> SparseIntegers:
    """The matrix as integers with one factor; zero outside these columns."""
    if m.numerators is not None:
        at = np.nonzero(m.numerators[:, columns])
        data = m.numerators[at[0], columns[at[1]]]
    else:
        part = sp.csr_array(m.values)
        part = (part if len(columns) == m.shape[1] else part[:, columns]).tocoo()  # columns are in ascending order
        at, data = part.coords, integers_of_doubles(part.data)[0]
    return SparseIntegers.of(at[0], columns[at[1]], data, (m.shape[0], m.shape[1]))
