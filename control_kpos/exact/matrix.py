"""Exact numbers: matrices of doubles, integers or fractions, with all their digits.

A `Matrix` holds doubles to compute with and, where doubles cannot represent the data, the integers behind
them, so that a sign can be proven about the numbers the user meant.  Three forms occur:

- doubles that are the data themselves;
- integers over one common denominator, rounded to doubles with a bound of the error;
- rows known up to positive factors of their own (generators and facets of a cone, whose length has no
  meaning), whose integers are computed when they are asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, partial, reduce
from math import gcd, lcm
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import DataError, TooLargeError
from .rounding import SMALLEST_NORMAL, rounding_radius

Integers: TypeAlias = NDArray[np.object_]
Index: TypeAlias = NDArray[np.intp]
# ndarray of doubles, or csr_array
Doubles: TypeAlias = Any

# Above this many entries a dense array is refused (2e8 doubles are 1.6 GB).
DENSE_LIMIT = 200_000_000
# An exponent that no number has.
_FAR = 2**63 - 1
# Binary digits of the numerators of a stack, brought to one denominator, above which that is refused.
_LONGEST = 10**9


@dataclass(frozen=True, eq=False)
class Matrix:
    """A real matrix, or a stack of matrices, known exactly.

    Attributes
    ----------
    values : ndarray, shape (..., r, c), or csr_array, shape (r, c)
        Doubles.  They are the exact data when `radius` is None.  Arrays are read-only.
    radius : ndarray or csr_array like `values`, or None
        |values - exact| <= radius entrywise, where each exact row may carry a positive factor of its
        own if `integer_rows` is set.
    shape : tuple of int
        Shape of `values`.
    is_sparse : bool
        True if `values` is a csr_array.
    is_double : bool
        True if the doubles in `values` are the exact data.
    numerators, denominator : ndarray of int (object), int or ndarray of int (object), shape (N, 1, 1)
        Exact data numerators / denominator, for fractions, decimals and large integers.  Every matrix of a stack
        may have a denominator of its own, all positive.
    integer_rows : callable or None
        Exact rows on demand: index array -> integers, each row up to a positive factor.  For
        generators and facets of a cone, whose length has no meaning.
    """

    values: Doubles
    radius: Doubles | None = None
    numerators: Integers | None = None
    denominator: int | Integers = 1
    integer_rows: Callable[[Index], Integers] | None = None
    shape: tuple[int, ...] = field(init=False, repr=False)
    is_sparse: bool = field(init=False, repr=False)
    is_double: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        own = vars(self)
        own.update(shape=self.values.shape, is_sparse=is_sparse(self.values), is_double=self.radius is None)
        for name in ("values", "radius", "numerators"):
            array = own[name]
            if isinstance(array, np.ndarray) and array.flags.writeable:
                view = array.view()
                view.flags.writeable = False
                own[name] = view

    @cached_property
    def column_length(self) -> int:
        """The most entries of a column."""
        if sp.issparse(self.values):
            return int(np.bincount(self.values.indices, minlength=1).max(initial=0))
        return self.shape[-2]

    # -- making one

    @classmethod
    def from_fractions(cls, rows: NDArray[np.object_]) -> Matrix:
        """From an object array of int and Fraction, any shape."""
        if rows.size == 0:
            return cls(np.zeros(rows.shape))
        flat = [(x if type(x) in (int, Fraction) else Fraction(x)).as_integer_ratio() for x in rows.ravel().tolist()]
        den = lcm(*{d for _, d in flat})
        try:
            values = np.array([n / d for n, d in flat])
        except OverflowError:
            values = np.array([nearest_double(Fraction(n, d)) for n, d in flat])  # names the number
        exact = np.array([v.as_integer_ratio() == x for v, x in zip(values.tolist(), flat, strict=True)])
        values, exact = values.reshape(rows.shape), exact.reshape(rows.shape)
        if exact.all():
            return cls(values)
        nums = np.array([n * (den // d) for n, d in flat], dtype=object).reshape(rows.shape)
        return cls(values, np.where(exact, 0.0, rounding_radius(values)), nums, den)

    @classmethod
    def over(cls, integers: Integers, denominator: int | Integers) -> Matrix:
        """integers / denominator, any shape; nothing is reduced."""
        short = _over_power_of_two(integers, denominator)
        values, exact = _quotients(integers, denominator) if short is None else short
        if exact.all():
            return cls(values)
        return cls(values, np.where(exact, 0.0, rounding_radius(values)), integers, denominator)

    @classmethod
    def identity(cls, n: int, *, sparse: bool = False) -> Matrix:
        """The n x n identity."""
        return cls(sp.eye_array(n, format="csr") if sparse else np.eye(n))

    @classmethod
    def zeros(cls, *shape: int) -> Matrix:
        """Zeros, dense."""
        return cls(np.zeros(shape))

    @classmethod
    def join(cls, parts: Sequence[Matrix], axis: int) -> Matrix:
        """Matrices beside each other (axis -1), below each other (-2), or stacks behind each other (0).

        Leading dimensions of dense stacks broadcast; sparse if some part is.
        """
        if len(parts) == 1:
            return parts[0]
        if any(part.integer_rows is not None for part in parts):
            return _rows_below(parts)
        if any(part.is_sparse for part in parts):
            if not all(part.is_double for part in parts):
                parts = [part.dense() for part in parts]
            else:
                stack = sp.vstack if axis == -2 else sp.hstack
                return cls(sp.csr_array(stack([part.values for part in parts], format="csr")))
        lead = np.broadcast_shapes(*(m.shape[:-2] for m in parts)) if axis < 0 else None

        def beside(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
            if lead:
                arrays = [np.broadcast_to(a, lead + a.shape[-2:]) for a in arrays]
            return np.concatenate(arrays, axis=axis)

        values = beside([part.values for part in parts])
        if all(part.is_double for part in parts):
            return cls(values)
        exact = [part._quotient(each=axis < 0) for part in parts]
        common = reduce(_common_multiple, (below for _, below in exact))
        numerators = beside([_times(ints, common // below) for ints, below in exact])
        return cls(values, beside([part._error() for part in parts]), numerators, common)

    @classmethod
    def stack(cls, matrices: Sequence[Matrix]) -> Matrix:
        """Dense matrices of one shape, of one factor for all rows, as a stack (N, r, c)."""
        if all(m.is_double for m in matrices):
            return cls(np.array([np.asarray(m.values) for m in matrices]))
        return cls.join([m[None] for m in matrices], 0)

    # -- what it is

    @property
    def is_zero(self) -> bool:
        """True if every entry is exactly zero."""
        return self.is_double and not np.any(self.values.data if self.is_sparse else self.values)

    def rows_as_integers(self, index: Index) -> Integers:
        """Rows of a two-dimensional matrix as integers, each up to a positive factor."""
        if self.integer_rows is not None:
            return self.integer_rows(index)
        if self.numerators is not None:
            return self.numerators[index]
        return integers_of_doubles(dense(self.values[index]), by_row=True)[0]

    def as_integers(self) -> tuple[Integers, int | Fraction]:
        """All entries as integers N with a common positive factor f: exact = N * f."""
        if self.numerators is not None:
            numerators, common = self._quotient(each=False)
            return numerators, Fraction(1, common)
        if self.integer_rows is not None:
            raise TypeError("rows with factors of their own have no common factor")
        ints, exponent = integers_of_doubles(dense(self.values))
        return ints, Fraction(2) ** int(exponent.item())

    def fractions(self) -> NDArray[np.object_]:
        """All entries as Fraction (object array); rows with factors of their own are integers without a common one."""
        if self.integer_rows is not None:
            return self.plain().fractions()
        if self.numerators is not None and not isinstance(self.denominator, int):
            return self.numerators * np.vectorize(partial(Fraction, 1), otypes=[object])(self.denominator)
        if self.is_double:
            doubles = dense(self.values)
            return np.array(list(map(Fraction, doubles.ravel().tolist())), dtype=object).reshape(doubles.shape)
        ints, factor = self.as_integers()
        return np.array([Fraction(x) * factor for x in ints.ravel()], dtype=object).reshape(ints.shape)

    def _quotient(self, *, each: bool) -> tuple[Integers, Any]:
        """Numerators and their denominator; one for all matrices of a stack unless `each` may have its own."""
        if self.numerators is None:
            ints, factor = self.as_integers()
            return ints * Fraction(factor).numerator, Fraction(factor).denominator
        if each or isinstance(self.denominator, int):
            return self.numerators, self.denominator
        common = 1
        for below in set(self.denominator.ravel().tolist()):
            common = lcm(common, below)
            if common.bit_length() * self.numerators.size > _LONGEST:
                raise TooLargeError(
                    f"{len(self.numerators)} matrices with denominators of their own have one in common of more than "
                    f"{common.bit_length()} binary digits."
                )
        return self.numerators * (common // self.denominator), common

    def rounded(self, *, up: bool) -> NDArray[np.float64]:
        """Doubles that are nowhere below the exact numbers (`up`), or nowhere above them; dense."""
        values = np.array(dense(self.values), dtype=float)
        if self.is_double:
            return values
        exact: list[Any] = self.fractions().ravel().tolist()
        pairs = zip(map(Fraction, values.ravel().tolist()), exact, strict=True)
        beyond = np.array([v < x if up else v > x for v, x in pairs], dtype=bool)
        return np.where(beyond.reshape(values.shape), np.nextafter(values, np.inf if up else -np.inf), values)

    # -- parts and other forms, as exact as the matrix itself

    def __getitem__(self, index: Any) -> Matrix:
        """Rows (an array of indices or a slice), one matrix of a stack (an integer), or a new leading axis (None)."""
        values = self.values[index]
        if self.is_double:
            return Matrix(values)
        radius = self.radius[index]  # type: ignore[index]
        if self.integer_rows is not None:
            return Matrix(values, radius, integer_rows=_Rows(self.integer_rows, np.arange(self.shape[0])[index]))
        if self.numerators is None:
            return Matrix(values, radius)
        below = self.denominator
        if not isinstance(below, int):
            below = below[index]
            below = int(below.item()) if below.ndim < 3 else below
        return Matrix(values, radius, self.numerators[index], below)

    @property
    def T(self) -> Matrix:
        """The transpose, of every matrix of a stack; not for rows with factors of their own."""
        if self.integer_rows is not None:
            raise TypeError("rows with factors of their own have no transpose")
        if self.is_sparse:
            radius = None if self.radius is None else self.radius.T.tocsr()
            return Matrix(
                self.values.T.tocsr(), radius, None if self.numerators is None else self.numerators.T, self.denominator
            )

        def swap(a: Any) -> Any:
            return None if a is None else np.swapaxes(a, -1, -2)

        return Matrix(swap(self.values), swap(self.radius), swap(self.numerators), self.denominator)

    def __neg__(self) -> Matrix:
        values = -self.values if self.is_sparse else 0.0 - self.values
        rows = self.integer_rows
        return Matrix(
            values,
            self.radius,
            None if self.numerators is None else -self.numerators,
            self.denominator,
            None if rows is None else _Rows(rows, np.arange(self.shape[0]), -1),
        )

    @cached_property
    def kept_dense(self) -> Matrix:
        """The same in dense form, made once: for small matrices that are asked for it often."""
        return self.dense()

    def dense(self) -> Matrix:
        """The same in dense form."""
        if not self.is_sparse:
            return self
        radius = None if self.radius is None else dense(self.radius)
        return Matrix(dense(self.values), radius, self.numerators, self.denominator, self.integer_rows)

    def plain(self) -> Matrix:
        """Dense, with one factor for all rows: rows with factors of their own become integers."""
        if self.integer_rows is not None:
            return Matrix.from_fractions(self.rows_as_integers(np.arange(self.shape[0])))
        return self.dense()

    def _error(self) -> NDArray[np.float64]:
        return np.zeros(self.shape) if self.radius is None else dense(self.radius)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Some of the exact rows, or their opposites; a class rather than a closure so that cones pickle."""

    source: Callable[[Index], Integers]
    index: Index
    sign: int = 1

    def __call__(self, index: Index) -> Integers:
        rows = self.source(self.index[index])
        return rows if self.sign > 0 else -rows


@dataclass(frozen=True, eq=False)
class _RowsBelow:
    """Exact rows of several matrices below each other."""

    parts: Sequence[Matrix]

    def __call__(self, index: Index) -> Integers:
        ends = np.cumsum([part.shape[0] for part in self.parts])
        owner = np.searchsorted(ends, index, side="right")
        out = np.zeros((len(index), self.parts[0].shape[1]), dtype=object)
        for k in np.unique(owner):
            at = np.flatnonzero(owner == k)
            out[at] = self.parts[k].rows_as_integers(index[at] - (ends[k] - self.parts[k].shape[0]))
        return out


def _rows_below(parts: Sequence[Matrix]) -> Matrix:
    """Rows with factors of their own, below each other."""
    parts = [part for part in parts if part.shape[0]] or parts[:1]
    values = np.concatenate([dense(part.values) for part in parts])
    return Matrix(values, np.concatenate([part._error() for part in parts]), integer_rows=_RowsBelow(parts))


def _common_multiple(a: Any, b: Any) -> Any:
    """The least, entry by entry where one of them is an array."""
    return (
        lcm(a, b) if isinstance(a, int) and isinstance(b, int) else np.lcm(np.asarray(a, object), np.asarray(b, object))
    )


def _times(ints: Integers, factor: Any) -> Integers:
    return ints if isinstance(factor, int) and factor == 1 else ints * factor


def _over_power_of_two(integers: Integers, denominator: int | Integers) -> tuple[Any, Any] | None:
    """`_quotients` where the denominator is a power of two and no double leaves the range of normal ones, else None."""
    if not isinstance(denominator, int) or denominator & (denominator - 1):
        return None
    power = denominator.bit_length() - 1
    try:
        values = integers.astype(float)
    except OverflowError:
        return None
    if (np.abs(values[values != 0]) < np.ldexp(SMALLEST_NORMAL, power)).any():
        return None
    return np.ldexp(values, -power), (integers == values).astype(bool)


def _quotients(integers: Integers, denominator: int | Integers) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """integers / denominator, correctly rounded, and which of these are exact."""
    below = np.broadcast_to(np.asarray(denominator, dtype=object), integers.shape).ravel().tolist()
    pairs = list(zip(integers.ravel().tolist(), below, strict=True))
    try:
        values = np.array([x / d for x, d in pairs], dtype=float)
    except OverflowError:
        values = np.array([nearest_double(Fraction(x, d)) for x, d in pairs])  # names the number
    values = values.reshape(integers.shape)
    mantissa, exponent = np.frexp(values)
    whole, shift = np.ldexp(mantissa, 53).astype(np.int64).astype(object), exponent.astype(np.int64) - 53
    left, right = (np.maximum(s, 0).astype(object) for s in (shift, -shift))
    return values, ((whole * denominator << left) == (integers << right)).astype(bool)


def bit_length(integers: Integers) -> int:
    """Binary digits of the longest."""
    return max(int(integers.max(initial=0)), -int(integers.min(initial=0))).bit_length()


def nearest_double(x: Fraction) -> float:
    """x correctly rounded; DataError if it overflows."""
    try:
        return x.numerator / x.denominator
    except OverflowError:
        raise DataError(f"the number {x} does not fit into a double; rescale the data.") from None


def integers_of_doubles(values: NDArray[np.float64], *, by_row: bool = False) -> tuple[Integers, NDArray[np.int64]]:
    """Finite doubles as integers times a power of two: values = ints * 2**exponent.

    One exponent for the whole array, or with `by_row` one for each row (last axis).
    """
    mantissa, exponent = np.frexp(values)
    mantissa = (mantissa * 2.0**53).astype(np.int64)
    exponent = exponent.astype(np.int64) - 53
    nonzero = mantissa != 0
    lowest = np.where(nonzero, mantissa & -mantissa, 1)
    zeros = np.frexp(lowest)[1] - 1  # k of lowest = 2**k, read off the bits
    mantissa >>= zeros
    exponent += zeros
    axis = -1 if by_row else None
    common = np.where(nonzero, exponent, _FAR).min(axis=axis, keepdims=True, initial=_FAR)
    common = np.where(common == _FAR, 0, common)
    shift = np.where(nonzero, exponent - common, 0)
    if not shift.size or shift.max() <= 9:  # 53 + 9 bits stay within 64
        return (mantissa << shift).astype(object), common
    wide: Any = mantissa.astype(object)
    return wide << shift.astype(object), common


def granularity(*arrays: NDArray[np.float64]) -> list[int]:
    """For each array the largest e such that every (finite) value is a multiple of 2**e; 0 for all zeros."""
    units = []
    for values in arrays:
        mantissa, exponent = np.frexp(values[values != 0])
        mantissa = (mantissa * 2.0**53).astype(np.int64)
        units.append(int((np.frexp(mantissa & -mantissa)[1] + exponent).min()) - 54 if mantissa.size else 0)
    return units


def divide_by_content(rows: Integers) -> Integers:
    """Each row divided by the greatest common divisor of its entries; zero rows stay."""
    if not rows.size:
        return rows
    content = np.abs(np.gcd.reduce(rows, axis=-1, keepdims=True))  # of a single entry, reduce keeps the sign
    return rows // np.where(content == 0, 1, content)


def primitive(row: Sequence[int] | Integers) -> Integers:
    """An integer vector divided by the greatest common divisor of its entries."""
    g = gcd(*(int(x) for x in row))
    return np.array([int(x) // g for x in row] if g > 1 else list(row), dtype=object)


def is_sparse(M: Any) -> bool:
    """As `scipy.sparse.issparse`, in a tenth of the time for an ndarray."""
    return not isinstance(M, np.ndarray) and sp.issparse(M)


def dense(M: Any) -> NDArray[Any]:
    """M as a dense array, refused above `DENSE_LIMIT` entries."""
    if not is_sparse(M):
        return np.asarray(M)
    if M.shape[0] * M.shape[1] > DENSE_LIMIT:
        raise TooLargeError(
            f"a dense {M.shape[0]} x {M.shape[1]} array is refused (limit {DENSE_LIMIT} entries); "
            "use the sparse attribute instead."
        )
    return M.toarray()
