"""Arguments of observers: bounds, times and signals."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..design.plant import Floats
from ..errors import DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix, items
from ..exact.matrix import Matrix
from ..networks.simulate import sample_times


def read_times(T: Any, dt: Any) -> Floats:
    """Two times at least, evenly spaced; in discrete time dt apart."""
    times = sample_times(exact_matrix(T, "T", ndim=1).dense().values, dt)
    if len(times) < 2:
        raise ShapeError(f"T has {len(times)} times; an observer needs two at least.")
    return times


def read_signal(values: Any, name: str, count: int, length: int) -> Floats:
    """Signals over time, one a row; one signal may stand alone.

    Parameters
    ----------
    values : array_like, shape (count, length), or (length,) for one signal
    name : str
        In messages.
    count, length : int
    """
    many = dimensions(values) != 1
    array = np.atleast_2d(np.asarray(exact_matrix(values, name, ndim=2 if many else 1).dense().values, dtype=float))
    if array.shape != (count, length):
        raise ShapeError(
            f"{name} has shape {array.shape}; it must be ({count}, {length}), one row per signal and one column "
            "per time in T."
        )
    return array


def read_pair(given: Any, name: str, size: int) -> tuple[Matrix, Matrix]:
    """Bounds (lo, hi) of vectors of this size."""
    try:
        pair = items(given, name)
    except DataError:
        pair = []
    if len(pair) != 2:
        raise ShapeError(f"{name} must be a pair (lo, hi) of vectors of {size} numbers, one for each state of sys.")
    lo, hi = (exact_matrix(part, f"{name}[{k}]", ndim=1) for k, part in enumerate(pair))
    for k, part in enumerate((lo, hi)):
        if part.shape != (size,):
            raise ShapeError(
                f"{name}[{k}] has {part.shape[0]} entries; it must have {size}, one for each state of sys."
            )
    for i in np.flatnonzero(lo.fractions() > hi.fractions()):
        raise DataError(f"{name} has its lower bound above the upper one in entry {i}; exchange them.")
    return lo, hi


def read_noise(given: Any, q: int) -> Matrix:
    """Bounds on the noise of q outputs, from one number for all or one for each."""
    scalar = dimensions(given) == 0
    noise = exact_matrix([given] * q if scalar else given, "noise", ndim=1)
    if noise.shape != (q,):
        raise ShapeError(f"noise has {noise.shape[0]} entries; give one number, or one for each of {q} outputs.")
    if any(x < 0 for x in noise.fractions()):
        raise DataError("noise holds bounds on |n|; a number in it is negative.")
    return noise


def finite(lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """The bounds, if they are numbers."""
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        raise DataError("the bounds leave the range of doubles; scale T, y, u or x0.")
    return lower, upper


def distinct(labels: list[str]) -> list[str]:
    """The labels; those that stand before get an underscore."""
    out: list[str] = []
    for label in labels:
        while label in out:
            label += "_"
        out.append(label)
    return out
