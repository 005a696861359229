"""Intake of arguments: matrices and vectors, whole and real numbers, seconds, words, yes or no.

Users give doubles, integers, fractions, decimal text such as "1/3" or sparse matrices; what they typed is kept
exactly.

Each function returns the value as a plain Python object, or says which argument is wrong, what was found
and what to give instead.  Truth values are not guessed: ``discrete="no"`` is a mistake, not a yes.
"""

from __future__ import annotations

import numbers
import re
import reprlib
from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import isfinite
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError, KposError, ShapeError
from .matrix import Matrix

_NUMBER = re.compile(r"[+-]?(\d+/\d+|(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,4})?)")


def exact_matrix(data: ArrayLike | Matrix | Any, name: str, *, ndim: int = 2) -> Matrix:
    """Read user data as an `Matrix`, or say which argument is wrong and how.

    Parameters
    ----------
    data : array_like, sparse matrix or Matrix
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
    if isinstance(data, Matrix):
        return data
    if sp.issparse(data):
        if ndim != 2:
            what = f"it must have {ndim} dimension{'s' * (ndim > 1)}" if ndim else "give one number"
            raise ShapeError(f"{name} is a sparse matrix; {what}.")
        return Matrix(sparse_matrix(data, name))
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
        what = f"it must have {ndim} dimension{'s' * (ndim > 1)}" if ndim else "give one number"
        raise ShapeError(f"{name} has shape {arr.shape}; {what}.")
    if arr.ndim < ndim:
        arr = arr.reshape((1,) * (ndim - arr.ndim) + arr.shape)
    return _exact_array(arr, name)


def _exact_array(arr: NDArray[Any], name: str) -> Matrix:
    kind = arr.dtype.kind
    if kind == "c":
        raise DataError(f"{name} is complex; control_kpos takes real numbers only.")
    if kind == "b" or (kind == "f" and arr.dtype.itemsize <= 8) or (kind in "iu" and _fits_doubles(arr)):
        values = arr.astype(np.float64)
        _require_finite(values, name)
        values.flags.writeable = False
        return Matrix(values)
    if kind in "iuUSOf":
        if kind == "S":
            arr = np.char.decode(arr)
        out = np.empty(arr.shape, dtype=object)
        for i in np.ndindex(arr.shape):
            out[i] = _fraction(arr[i], name, i)
        try:
            return Matrix.from_fractions(out)
        except DataError:
            raise DataError(f"{name} holds a number that does not fit into a double; rescale the data.") from None
    raise DataError(f"{name} holds {arr.dtype.name} data; give real numbers.")


def _fits_doubles(integers: NDArray[Any]) -> bool:
    """Whether doubles hold integers of these sizes without rounding."""
    small = integers.dtype.itemsize < 8 or not integers.size
    return small or bool(integers.min() >= -(2**53) and integers.max() <= 2**53)


def _fraction(x: Any, name: str, index: tuple[int, ...]) -> Fraction:
    where = f"{name}[{', '.join(map(str, index))}]" if index else name
    if isinstance(x, str):
        x = str(x)  # numpy's own text type shows in messages
        if not is_number(x):
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
        remedy = getattr(type(x), "remedy", "give real numbers")  # ranges have places of their own
        raise DataError(f"{where} is {reprlib.repr(x)} of type {type(x).__name__}; {remedy}.") from None
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
    out = _short_indices(sp.csr_array(data, dtype=np.float64, copy=True))
    out.sum_duplicates()
    out.eliminate_zeros()
    _require_finite(out.data, f"{name}.data")
    return out


def vector(data: ArrayLike, name: str, size: int | None = None) -> NDArray[np.float64]:
    """A finite real vector of doubles of the given size."""
    values = exact_matrix(data, name, ndim=1).values
    values = np.asarray(values)
    if size is not None and values.shape != (size,):
        raise ShapeError(f"{name} has {values.size} entries; it must have {size}.")
    return values


def require_shape(M: Matrix, name: str, shape: tuple[int | None, ...], meaning: str = "") -> Matrix:
    """Raise `ShapeError` with both shapes unless M has the given shape (None: any size)."""
    if len(M.shape) != len(shape) or any(s is not None and s != m for s, m in zip(shape, M.shape, strict=True)):
        want = " x ".join("any" if s is None else str(s) for s in shape)
        have, why = " x ".join(map(str, M.shape)), f" ({meaning})" if meaning else ""
        if len(shape) == len(M.shape) == 1:
            raise ShapeError(f"{name} has {have} entries; it must have {want}{why}.")
        raise ShapeError(f"{name} is {have}, but must be {want}{why}.")
    return M


def flag(value: Any, name: str) -> bool:
    """True or False; 1 and 0 will do.

    >>> flag(np.True_, "discrete"), flag(0, "discrete")
    (True, False)
    """
    if isinstance(value, (bool, np.bool_, int, np.integer)) and value in (0, 1):
        return bool(value)
    raise DataError(f"{name} is {found(value)}; give True or False.")


def whole_number(
    value: Any,
    name: str,
    *,
    least: int | None = 0,
    most: int | None = None,
    outside: type[KposError] = DataError,
) -> int:
    """An integer, of at least `least` and at most `most`; the error `outside` says that it is not.

    >>> whole_number(np.int64(3), "n", least=1)
    3
    """
    limits = "" if least is None else f", at least {least}" if most is None else f", from {least} to {most}"
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        what = repr(value) if isinstance(value, float) else found(value)  # 2.0 is no 2
        raise DataError(f"{name} is {what}; it must be a whole number{limits}.")
    if (least is not None and value < least) or (most is not None and value > most):
        raise outside(f"{name} is {found(value)}; it must be a whole number{limits}.")
    return int(value)


def is_number(text: str) -> bool:
    """True for text that stands for a number.

    >>> is_number("1/3"), is_number("max")
    (True, False)
    """
    return bool(_NUMBER.fullmatch(text.strip()))


def exact_number(value: Any, name: str, *, positive: bool = False, nonnegative: bool = False) -> Fraction:
    """A finite real number in any of the formats of the data, and positive or not negative if asked for.

    >>> exact_number("1/3", "weight")
    Fraction(1, 3)
    """
    kind = "positive number" if positive else "number that is not negative" if nonnegative else "number"
    if value is None or isinstance(value, (bool, np.bool_)):
        raise DataError(f"{name} is {value}; give a {kind}.")
    plain = (type(value) is int and abs(value) < 2**53) or (type(value) is float and isfinite(value))
    number = Fraction(value) if plain else exact_matrix(value, name, ndim=0)[None].fractions()[0]
    if (positive and not number > 0) or (nonnegative and not number >= 0):
        raise DataError(f"{name} is {float(number):g}; give a {kind}.")
    return number


def real_number(value: Any, name: str, *, positive: bool = False, nonnegative: bool = False) -> float:
    """An `exact_number` as the double closest to it, for what nothing is proven about: times, sizes of steps.

    >>> real_number("1/4", "Ts")
    0.25
    """
    number = float(exact_number(value, name, positive=positive, nonnegative=nonnegative))
    if positive and not number:
        raise DataError(f"{name} is 0 when rounded to a double; give a larger number.")
    return number


def seconds(value: Any, name: str = "time_limit") -> float | None:
    """A positive number of seconds; inf for no limit; None if operations are to be counted instead.

    >>> seconds(2), seconds(float("inf")), seconds(None)
    (2.0, inf, None)
    """
    if value is None:
        return None
    if isinstance(value, (float, np.floating)) and value == np.inf:
        return float(value)
    return real_number(value, name, positive=True)


def choice(value: Any, name: str, allowed: Sequence[str | None]) -> Any:
    """One of the words allowed.

    >>> choice("max", "rate", ["max", None])
    'max'
    """
    if value is None or isinstance(value, str):
        for word in allowed:
            if value == word:
                return word
    words = " or ".join(repr(word) if word is None else f'"{word}"' for word in allowed)
    raise DataError(f"{name} is {found(value)}; give {words}.")


def words(value: Any, name: str) -> str | None:
    """Text, or None for a default.

    >>> words("Poles", "title")
    'Poles'
    """
    if value is None or (isinstance(value, str) and (value.isprintable() or "\n" in value)):
        return value
    raise DataError(f"{name} is {found(value)}; give text that can be printed.")


def dimensions(value: Any) -> int | None:
    """Number of dimensions of a number or array_like; None if it is ragged or no array at all.

    >>> dimensions([[1, 2], [3, 4]]), dimensions([[1, 2], [3]])
    (2, None)
    """
    try:
        return int(np.ndim(value))
    except Exception:  # noqa: BLE001  (conversion runs code of the object, which may raise anything)
        return None


def places(value: Any, name: str) -> list[str | int]:
    """Places or names of signals, given one by one or in a list.

    >>> places("y", "outputs"), places([0, "u"], "inputs")
    (['y'], [0, 'u'])
    """
    chosen = [value] if isinstance(value, (str, int, np.integer)) else items(value, name)
    for item in chosen:
        if isinstance(item, (bool, np.bool_)) or not isinstance(item, (str, int, np.integer)):
            raise DataError(f"{name} holds {found(item)}; give places (0, 1, ...) or names.")
    return [item if isinstance(item, str) else int(item) for item in chosen]


def file_path(value: Any, name: str = "path") -> Path:
    """A path; never a number, which would be a file that the caller has open for something else.

    >>> file_path("stable.json").suffix
    '.json'
    """
    if isinstance(value, (str, PathLike)):
        path = fspath(value)
        if isinstance(path, str) and "\0" not in path and Path(path).name:
            return Path(path)
    raise DataError(f"{name} is {found(value)}; give the path of a file.")


def folder_path(value: Any, name: str) -> Path:
    """A path of a folder, "." too.

    >>> folder_path(".", "folder").is_dir()
    True
    """
    if isinstance(value, (str, PathLike)):
        path = fspath(value)
        if isinstance(path, str) and "\0" not in path and path:
            return Path(path)
    raise DataError(f"{name} is {found(value)}; give the path of a folder.")


def items(value: Any, name: str) -> list[Any]:
    """The items of a list, tuple or other iterable that is no text and no table.

    >>> items(range(3), "nodes")
    [0, 1, 2]
    """
    try:
        if not isinstance(value, (str, bytes, Mapping)):
            return list(value)
    except Exception:  # noqa: BLE001  (iteration runs code of the object, which may raise anything)
        pass
    raise DataError(f"{name} is {found(value)}; give a list.")


def found(value: Any) -> str:
    """What an argument is, short, for messages.

    >>> found("fast"), found([1, 2]), found(10**40)
    ("'fast'", 'a list', 'an integer of 133 bits')
    """
    if isinstance(value, str):
        return repr(str(value[:40]))
    if isinstance(value, (bool, np.bool_)) or value is None:
        return str(value)
    if isinstance(value, (int, np.integer)):
        size = int(value).bit_length()
        return str(value) if size < 100 else f"an integer of {size} bits"
    if isinstance(value, numbers.Real):
        return f"{float(value):g}" if isinstance(value, (float, np.floating)) else f"a {type(value).__name__}"
    name = type(value).__name__
    return f"a{'n' * (name[:1].lower() in 'aeio')} {name}"


def _short_indices(M: sp.csr_array) -> sp.csr_array:
    """The same matrix with indices of 32 bits where these suffice: products read half as much; scipy keeps them so."""
    if max(*M.shape, M.nnz) >= 2**31:
        return M
    parts = (part.astype(np.int32, copy=False) for part in (M.indices, M.indptr))
    return sp.csr_array((M.data, *parts), shape=M.shape)
