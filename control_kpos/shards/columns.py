"""Columns of Arrow tables as arrays, or an error that names file, column and row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..networks.blocks import Index

# File, and the row where a batch begins.
Where = tuple[Path, int]


def _refuse(name: str, where: Where, row: int, what: str) -> None:
    raise DataError(f"{where[0]}, column {name!r}, row {where[1] + row}: {what}")


def _kind(column: Any) -> str:
    """The type of a column in a word: int, float, list, text, or as Arrow calls it."""
    text = str(column.type)
    if text.startswith("dictionary"):
        return _kind_of(str(column.type.value_type))
    return _kind_of(text)


def _kind_of(text: str) -> str:
    if text.startswith(("list<", "large_list<", "fixed_size_list<")):
        return "list"
    if text in ("string", "large_string", "string_view"):
        return "text"
    if text.startswith(("int", "uint")):
        return "int"
    return "float" if text in ("halffloat", "float", "double") else text


def _require_full(column: Any, name: str, where: Where) -> None:
    if column.null_count:
        row = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
        _refuse(name, where, row, "the field is empty.")


def doubles(column: Any, name: str, where: Where) -> NDArray[np.float64]:
    """A column of finite numbers."""
    if _kind(column) not in ("int", "float"):
        raise DataError(f"{where[0]}, column {name!r} holds {column.type}; give floating-point numbers or integers.")
    _require_full(column, name, where)
    values, wrong = _finite(column)
    if wrong is not None:
        _refuse(name, where, *wrong)
    return values


def _finite(column: Any) -> tuple[NDArray[np.float64], tuple[int, str] | None]:
    """Numbers of a column without empty fields, and the place of one that is no double."""
    given = column.to_numpy(zero_copy_only=False)
    if given.dtype.kind in "iu":
        large = (given > 2**53) | ((given < -(2**53)) if given.dtype.kind == "i" else False)
        wrong = "an integer beyond 2**53, which a double would round."
    else:
        large, wrong = ~np.isfinite(given), "{}; every entry must be finite."
    values = given.astype(np.float64)
    if not large.any():
        return values, None
    place = int(np.argmax(large))
    return values, (place, wrong.format(given[place]))


def integers(column: Any, name: str, where: Where, most: Any) -> Index:
    """A column of integers from 0 to below `most`, a number or one for every row."""
    if _kind(column) != "int":
        raise DataError(f"{where[0]}, column {name!r} holds {column.type}; give integers.")
    _require_full(column, name, where)
    given = column.to_numpy(zero_copy_only=False)
    outside = (given < 0) | (given >= most)
    if outside.any():
        row = int(np.argmax(outside))
        limit = int(most[row]) if np.ndim(most) else most
        _refuse(name, where, row, f"{int(given[row])} is no number from 0 to {limit - 1}.")
    return given.astype(np.int64)


def entries_of_rows(column: Any, name: str, where: Where) -> tuple[NDArray[np.float64], Index]:
    """A column of lists of finite numbers: all of them behind each other, and how many are in every row."""
    if _kind(column) != "list":
        raise DataError(f"{where[0]}, column {name!r} holds {column.type}; give lists of the entries, row by row.")
    _require_full(column, name, where)
    flat = column.flatten()
    fixed = getattr(column.type, "list_size", None)
    sizes = np.full(len(column), fixed) if fixed is not None else np.diff(column.offsets.to_numpy())
    sizes = sizes.astype(np.int64)
    if _kind(flat) not in ("int", "float"):
        raise DataError(f"{where[0]}, column {name!r} holds lists of {flat.type}; give numbers.")
    if flat.null_count:
        empty = int(np.argmax(flat.is_null().to_numpy(zero_copy_only=False)))
        values, wrong = np.zeros(0), (empty, "an entry is empty.")
    else:
        values, wrong = _finite(flat)
    if wrong is not None:
        _refuse(name, where, int(np.searchsorted(np.cumsum(sizes), wrong[0], side="right")), wrong[1])
    return values, sizes


def kinds_of(column: Any, where: Where) -> tuple[list[Any], Index]:
    """The different entries of a column of text or integers, and the place among them of every row."""
    if _kind(column) not in ("int", "text"):
        raise DataError(f"{where[0]}, column 'kind' holds {column.type}; give text or integers.")
    _require_full(column, "kind", where)
    encoded = column if str(column.type).startswith("dictionary") else column.dictionary_encode()
    return encoded.dictionary.to_pylist(), encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64)


def texts(column: Any, name: str, where: Where) -> list[str]:
    """A column of text."""
    if _kind(column) != "text":
        raise DataError(f"{where[0]}, column {name!r} holds {column.type}; give text.")
    _require_full(column, name, where)
    return column.to_pylist()
