"""Intake of single arguments: whole numbers, real numbers, seconds, one of several words, yes or no.

Each function returns the value as a plain Python object, or says which argument is wrong, what was found
and what to give instead.  Truth values are not guessed: ``discrete="no"`` is a mistake, not a yes.
"""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError, KposError
from .matrix import exact_matrix


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
        raise DataError(f"{name} is {found(value)}; it must be a whole number{limits}.")
    if (least is not None and value < least) or (most is not None and value > most):
        raise outside(f"{name} is {found(value)}; it must be a whole number{limits}.")
    return int(value)


def real_number(value: Any, name: str, *, positive: bool = False, nonnegative: bool = False) -> float:
    """A finite real number in any of the formats of the data, and positive or not negative if asked for.

    >>> real_number("1/4", "rate")
    0.25
    """
    kind = "positive number" if positive else "number that is not negative" if nonnegative else "number"
    if value is None or isinstance(value, (bool, np.bool_)):
        raise DataError(f"{name} is {value}; give a {kind}.")
    number = float(exact_matrix(value, name, ndim=0).values)
    if (positive and not number > 0) or (nonnegative and not number >= 0):
        raise DataError(f"{name} is {number:g}; give a {kind}.")
    return number


def seconds(value: Any, name: str = "time_limit") -> float:
    """A positive number of seconds; inf for no limit.

    >>> seconds(2), seconds(float("inf"))
    (2.0, inf)
    """
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
    """A path; never a number, which would be an open file of somebody else.

    >>> file_path("stable.json").suffix
    '.json'
    """
    if isinstance(value, (str, PathLike)):
        path = fspath(value)
        if isinstance(path, str) and "\0" not in path and Path(path).name:
            return Path(path)
    raise DataError(f"{name} is {found(value)}; give the path of a file.")


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
