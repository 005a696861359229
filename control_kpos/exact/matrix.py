"""Intake of numbers: finite, real, of the right shape, and exactly known.

Users give doubles, integers, fractions, decimal strings or sparse matrices.  An `ExactMatrix` holds
doubles to compute with and, where doubles cannot represent the data, the integers behind them, so
that a sign can be proven about the numbers the user meant.
"""

from __future__ import annotations

import numbers
import re
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd, lcm
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError, ShapeError, TooLargeError

Integers: TypeAlias = NDArray[np.object_]
# ndarray of doubles, or csr_array
Matrix: TypeAlias = Any

HALF_ULP = 2.0**-53
SMALLEST_NORMAL = 2.0**-1022
# Above this many entries a dense array is refused (2e8 doubles are 1.6 GB).
DENSE_LIMIT = 200_000_000

_NUMBER = re.compile(r"[+-]?(\d+/\d+|(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,4})?)")


@dataclass(frozen=True, eq=False)
class ExactMatrix:
    """A real matrix, or a stack of matrices, known exactly.

    Attributes
    ----------
    values : ndarray, shape (..., r, c), or csr_array, shape (r, c)
        Doubles.  They are the exact data when `radius` is None.
    radius : ndarray or csr_array like `values`, or None
        |values - exact| <= radius entrywise, where each exact row may carry a positive factor of its
        own if `integer_rows` is set.
    numerators, denominator : ndarray of int (object), int
        Exact data numerators / denominator, for fractions, decimals and large integers.
    integer_rows : callable or None
        Exact rows on demand: index array -> integers, each row up to a positive factor.  For
        generators and facets of a cone, whose length has no meaning.
    """

    values: Matrix
    radius: Matrix | None = None
    numerators: Integers | None = None
    denominator: int = 1
    integer_rows: Callable[[NDArray[np.intp]], Integers] | None = None

    @property
    def is_sparse(self) -> bool:
        """True if `values` is a csr_array."""
        return sp.issparse(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of `values`."""
        return self.values.shape

    @property
    def is_double(self) -> bool:
        """True if the doubles in `values` are the exact data."""
        return self.radius is None

    def rows_as_integers(self, index: NDArray[np.intp]) -> Integers:
        """Rows of a two-dimensional dense matrix as integers, each up to a positive factor."""
        if self.integer_rows is not None:
            return self.integer_rows(index)
        if self.numerators is not None:
            return self.numerators[index]
        return integers_of_doubles(dense(self.values[index]), by_row=True)[0]

    def as_integers(self) -> tuple[Integers, int | Fraction]:
        """All entries as integers N with a common positive factor f: exact = N * f."""
        if self.numerators is not None:
            return self.numerators, Fraction(1, self.denominator)
        if self.integer_rows is not None:
            raise TypeError("rows with factors of their own have no common factor")
        ints, exponent = integers_of_doubles(dense(self.values))
        return ints, Fraction(2) ** int(exponent.item())

    @classmethod
    def from_fractions(cls, rows: NDArray[np.object_]) -> ExactMatrix:
        """From an object array of int and Fraction, any shape."""
        if rows.size == 0:
            return cls(np.zeros(rows.shape))
        flat = [Fraction(x) for x in rows.ravel()]
        den = lcm(*(x.denominator for x in flat))
        values = np.array([nearest_double(x) for x in flat])
        exact = np.array([Fraction(v) == x for v, x in zip(values.tolist(), flat, strict=True)])
        values, exact = values.reshape(rows.shape), exact.reshape(rows.shape)
        if exact.all():
            return cls(values)
        nums = np.array([x.numerator * (den // x.denominator) for x in flat], dtype=object).reshape(rows.shape)
        return cls(values, np.where(exact, 0.0, rounding_radius(values)), nums, den)

    def fractions(self) -> NDArray[np.object_]:
        """All entries as Fraction (object array); only for matrices with a common factor."""
        ints, factor = self.as_integers()
        return np.array([Fraction(x) * factor for x in ints.ravel()], dtype=object).reshape(ints.shape)

    def __neg__(self) -> ExactMatrix:
        rows = self.integer_rows
        return ExactMatrix(
            -self.values,
            self.radius,
            None if self.numerators is None else -self.numerators,
            self.denominator,
            None if rows is None else _Negated(rows),
        )


@dataclass(frozen=True)
class _Negated:
    """Negated exact rows; a class rather than a closure so that cones pickle."""

    rows: Callable[[NDArray[np.intp]], Integers]

    def __call__(self, index: NDArray[np.intp]) -> Integers:
        return -self.rows(index)


def nearest_double(x: Fraction) -> float:
    """x correctly rounded; DataError if it overflows."""
    try:
        return x.numerator / x.denominator
    except OverflowError:
        raise DataError(f"the number {x} does not fit into a double; rescale the data.") from None


def rounding_radius(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bound on the rounding error of correctly rounded doubles."""
    return np.abs(values) * (2 * HALF_ULP) + 2.0**-1074


def integers_of_doubles(values: NDArray[np.float64], *, by_row: bool = False) -> tuple[Integers, NDArray[np.int64]]:
    """Finite doubles as integers times a power of two: values = ints * 2**exponent.

    One exponent for the whole array, or with `by_row` one for each row (last axis).
    """
    mantissa, exponent = np.frexp(values)
    mantissa = (mantissa * 2.0**53).astype(np.int64)
    exponent = exponent.astype(np.int64) - 53
    nonzero = mantissa != 0
    lowest = np.where(nonzero, mantissa & -mantissa, 1)
    zeros = np.log2(lowest).astype(np.int64)  # exact: powers of two
    mantissa >>= zeros
    exponent += zeros
    far = np.iinfo(np.int64).max
    axis = -1 if by_row else None
    common = np.where(nonzero, exponent, far).min(axis=axis, keepdims=True, initial=far)
    common = np.where(common == far, 0, common)
    shift = np.where(nonzero, exponent - common, 0)
    if not shift.size or shift.max() <= 9:  # 53 + 9 bits stay within 64
        return (mantissa << shift).astype(object), common
    wide: Any = mantissa.astype(object)
    return wide << shift.astype(object), common


def granularity(values: NDArray[np.float64]) -> int:
    """Largest e such that every (finite) value is a multiple of 2**e; 0 for all zeros."""
    mantissa, exponent = np.frexp(values[values != 0])
    if mantissa.size == 0:
        return 0
    mantissa = (mantissa * 2.0**53).astype(np.int64)
    return int((np.log2(mantissa & -mantissa) + exponent).min()) - 53


def primitive(row: Sequence[int] | Integers) -> Integers:
    """An integer vector divided by the greatest common divisor of its entries."""
    g = gcd(*(int(x) for x in row))
    return np.array([int(x) // g for x in row] if g > 1 else list(row), dtype=object)


def dense(M: Any) -> NDArray[Any]:
    """M as a dense array, refused above `DENSE_LIMIT` entries."""
    if not sp.issparse(M):
        return np.asarray(M)
    if M.shape[0] * M.shape[1] > DENSE_LIMIT:
        raise TooLargeError(
            f"a dense {M.shape[0]} x {M.shape[1]} array is refused (limit {DENSE_LIMIT} entries); "
            "use the sparse attribute instead."
        )
    return M.toarray()


def exact_matrix(data: ArrayLike | ExactMatrix | Any, name: str, *, ndim: int = 2) -> ExactMatrix:
    """Read user data as an `ExactMatrix`, or say which argument is wrong and how.

    Parameters
    ----------
    data : array_like, sparse matrix or ExactMatrix
        Finite real numbers: doubles, integers of any size, `Fraction`, `Decimal`, or strings such as
        "1/3" and "-21.3".
    name : str
        What the user calls it, for messages.
    ndim : int
        Number of dimensions required.  A one-dimensional array is read as one row when ndim is 2,
        a number as a 1 x 1 matrix.

    Raises
    ------
    DataError
        NaN, inf, complex numbers, text that is not a number, masked entries.
    ShapeError
        Ragged lists, too many dimensions.
    """
    if isinstance(data, ExactMatrix):
        return data
    if sp.issparse(data):
        if ndim != 2:
            raise ShapeError(f"{name} is a sparse matrix; it must have {ndim} dimension{'s' * (ndim != 1)}.")
        return ExactMatrix(sparse_matrix(data, name))
    if np.ma.isMaskedArray(data) and np.ma.is_masked(data):
        raise DataError(f"{name} has masked entries; fill them in first.")
    try:
        arr = np.asarray(data)
    except (ValueError, TypeError):
        raise ShapeError(f"{name} is ragged: its rows differ in length; give rows of equal length.") from None
    except Exception as error:  # noqa: BLE001  (conversion runs code of the object, which may raise anything)
        raise DataError(f"{name} of type {type(data).__name__} is no array ({type(error).__name__}).") from None
    if arr.dtype.kind == "O" and any(isinstance(x, (list, tuple, np.ndarray)) for x in arr.ravel()):
        raise ShapeError(f"{name} is ragged: its rows differ in length; give rows of equal length.")
    if isinstance(data, (list, tuple)) and arr.dtype.kind in "US":
        # numpy turns ["1/3", 0.1] into text and shortens nothing, but a float's repr is its exact value
        arr = np.array(data, dtype=object)
    if arr.ndim > ndim:
        raise ShapeError(f"{name} has shape {arr.shape}; it must have {ndim} dimension{'s' * (ndim > 1)}.")
    if arr.ndim < ndim:
        arr = arr.reshape((1,) * (ndim - arr.ndim) + arr.shape)
    return _exact_array(arr, name)


def _exact_array(arr: NDArray[Any], name: str) -> ExactMatrix:
    kind = arr.dtype.kind
    if kind == "c":
        raise DataError(f"{name} is complex; control_kpos takes real numbers only.")
    if kind == "b" or (kind == "f" and arr.dtype.itemsize <= 8) or (kind in "iu" and arr.dtype.itemsize < 8):
        values = arr.astype(np.float64)
        _require_finite(values, name)
        values.flags.writeable = False
        return ExactMatrix(values)
    if kind in "iuUSOf":
        if kind == "S":
            arr = np.char.decode(arr)
        out = np.empty(arr.shape, dtype=object)
        for i in np.ndindex(arr.shape):
            out[i] = _fraction(arr[i], name, i)
        try:
            return ExactMatrix.from_fractions(out)
        except DataError:
            raise DataError(f"{name} holds a number that does not fit into a double; rescale the data.") from None
    raise DataError(f"{name} holds {arr.dtype.name} data; give real numbers.")


def _fraction(x: Any, name: str, index: tuple[int, ...]) -> Fraction:
    where = f"{name}[{', '.join(map(str, index))}]" if index else name
    if isinstance(x, str):
        x = str(x)  # numpy's own text type shows in messages
        if not _NUMBER.fullmatch(x.strip()):
            raise DataError(f'{where} is the text {reprlib.repr(x)}; give a number, or text such as "1/3" or "-21.3".')
        try:
            return Fraction(x.strip())
        except ZeroDivisionError:
            raise DataError(f"{where} is {reprlib.repr(x)}, which divides by zero.") from None
    if isinstance(x, (complex, np.complexfloating)):
        raise DataError(f"{where} is complex; control_kpos takes real numbers only.")
    if isinstance(x, numbers.Rational):
        return Fraction(int(x.numerator), int(x.denominator))
    try:
        return Fraction(*x.as_integer_ratio())
    except (AttributeError, TypeError):
        raise DataError(f"{where} is {reprlib.repr(x)} of type {type(x).__name__}; give real numbers.") from None
    except (OverflowError, ValueError):
        raise DataError(f"{where} is {x!r}; every entry must be finite.") from None


def _require_finite(values: NDArray[np.float64], name: str) -> None:
    if not np.isfinite(values).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(values))[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise DataError(f"{where} is {values[index]}; every entry must be finite.")


def sparse_matrix(data: Any, name: str) -> sp.csr_array:
    """A sparse matrix in canonical CSR form: indices in range, duplicates summed, zeros removed."""
    if data.dtype.kind == "c":
        raise DataError(f"{name} is complex; control_kpos takes real numbers only.")
    if data.dtype.kind not in "fiub":
        raise DataError(f"{name} holds {data.dtype.name} data; give real numbers.")
    if data.ndim != 2:
        raise ShapeError(f"{name} has {data.ndim} dimension(s); it must have 2.")
    if data.format in ("dok", "lil", "dia"):  # whose data are no plain array of the entries
        data = data.tocoo()
    if data.dtype.kind in "iu" and data.nnz and np.abs(data.data).max() > 2**53:
        raise DataError(f"{name} holds integers above 2**53, which doubles cannot represent; rescale.")
    if data.format in ("csr", "csc", "bsr"):
        try:
            data.check_format(full_check=True)
        except ValueError as error:
            raise ShapeError(f"{name} is not a valid sparse matrix: {error}.") from None
    elif data.format == "coo" and data.nnz:
        for axis, (index, size) in enumerate(zip(data.coords, data.shape, strict=True)):
            if index.min() < 0 or index.max() >= size:
                raise ShapeError(f"{name} has an entry outside its {data.shape} shape along axis {axis}.")
    _require_finite(np.asarray(data.data, dtype=np.float64).ravel(), f"{name}.data")
    out = sp.csr_array(data, dtype=np.float64, copy=True)
    out.sum_duplicates()
    out.eliminate_zeros()
    _require_finite(out.data, f"{name}.data")
    return out


def concatenate(parts: Sequence[ExactMatrix], axis: int) -> ExactMatrix:
    """Exact matrices side by side (axis -1) or one above the other (axis -2)."""
    if all(part.is_double for part in parts):
        if any(part.is_sparse for part in parts):
            stack = sp.vstack if axis == -2 else sp.hstack
            return ExactMatrix(sp.csr_array(stack([part.values for part in parts], format="csr")))
        return ExactMatrix(np.concatenate([part.values for part in parts], axis=axis))
    exact = [part.as_integers() for part in parts]
    common = lcm(*(Fraction(factor).denominator for _, factor in exact))
    numerators = np.concatenate([ints * int(factor * common) for ints, factor in exact], axis=axis)
    values = [dense(part.values) for part in parts]
    radii = [np.zeros(v.shape) if m.radius is None else dense(m.radius) for m, v in zip(parts, values, strict=True)]
    return ExactMatrix(np.concatenate(values, axis=axis), np.concatenate(radii, axis=axis), numerators, common)


def as_stack(matrices: Sequence[ExactMatrix]) -> ExactMatrix:
    """Dense matrices of one shape as a stack."""
    if all(m.is_double for m in matrices):
        return ExactMatrix(np.array([np.asarray(m.values) for m in matrices]))
    return ExactMatrix.from_fractions(np.array([m.fractions() for m in matrices], dtype=object))


def pick(m: ExactMatrix, index: Any) -> ExactMatrix:
    """Some rows of a dense matrix (an array of indices), or one matrix of a stack (an integer)."""
    return ExactMatrix(
        np.asarray(m.values)[index],
        None if m.radius is None else m.radius[index],
        None if m.numerators is None else m.numerators[index],
        m.denominator,
    )


def transposed(m: ExactMatrix) -> ExactMatrix:
    """The transpose of a dense matrix, or of every matrix of a stack."""

    def swap(a: Any) -> Any:
        return None if a is None else np.swapaxes(a, -1, -2)

    return ExactMatrix(swap(m.values), swap(m.radius), swap(m.numerators), m.denominator)


def plain(m: ExactMatrix) -> ExactMatrix:
    """Dense, with one factor for all rows: rows with factors of their own become integers."""
    if m.is_sparse:
        return ExactMatrix(m.values.toarray())
    if m.integer_rows is not None:
        return ExactMatrix.from_fractions(m.rows_as_integers(np.arange(m.shape[0])))
    return m


def identity(n: int, *, sparse: bool = False) -> ExactMatrix:
    """The n x n identity."""
    return ExactMatrix(sp.eye_array(n, format="csr") if sparse else np.eye(n))


def vector(data: ArrayLike, name: str, size: int | None = None) -> NDArray[np.float64]:
    """A finite real vector of doubles of the given size."""
    values = exact_matrix(data, name, ndim=1).values
    values = np.asarray(values)
    if size is not None and values.shape != (size,):
        raise ShapeError(f"{name} has {values.size} entries; it must have {size}.")
    return values


def require_shape(M: ExactMatrix, name: str, shape: tuple[int | None, ...], meaning: str = "") -> ExactMatrix:
    """Raise `ShapeError` with both shapes unless M has the given shape (None: any size)."""
    if len(M.shape) != len(shape) or any(s is not None and s != m for s, m in zip(shape, M.shape, strict=True)):
        want = " x ".join("any" if s is None else str(s) for s in shape)
        have = " x ".join(map(str, M.shape))
        raise ShapeError(f"{name} is {have}, but must be {want}{f' ({meaning})' if meaning else ''}.")
    return M


def shown(x: NDArray[np.float64]) -> str:
    """The first entries of a vector, for messages."""
    return f"({', '.join(f'{v:.4g}' for v in x[:6])}{', ...' if len(x) > 6 else ''})"
