"""Numbers that no double is equal to, such as 1/3, beside the arrays of doubles that hold all others.

An array of a shard holds the double closest to every number; a file of text beside it has the place and the exact
value of those that are none: ``{"A0": [[place, "1/3"], ...]}``, places counted in the order of the file, rows first.
"""

from __future__ import annotations

from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CertificateFileError, DataError, TooLargeError
from ..exact.matrix import Matrix, integers_of_doubles, nearest_double
from ..exact.rounding import rounding_radius
from ..proof.numerals import number, number_text

# Entries up to which the links of a shard with fractions are kept, in dense form.
_ENTRIES = 10**7

Entries = list[list[Any]]


def entries_beside(M: Matrix) -> Entries:
    """Places and text of the numbers of a dense matrix or stack that are no doubles."""
    if M.radius is None:
        return []
    places = np.flatnonzero(M.radius)
    flat = M.fractions().ravel()
    return [[place, str(number_text(flat[place]))] for place in places.tolist()]


def are_equal(M: Matrix) -> bool:
    """True if all matrices of a stack are the same, to the last digit."""
    if not (M.values == M.values[0]).all():
        return False
    return M.is_double or bool((M.fractions() == M[0].fractions()).all())


def _read(values: NDArray[np.float64], entries: Any) -> tuple[NDArray[np.int64], list[Fraction]]:
    """Places, ascending, and exact values of entries that fit to the doubles in their places."""
    places, exact = np.zeros(0, dtype=np.int64), []
    try:
        places = np.array([place for place, _ in entries], dtype=np.int64)
        exact = [number(text) for _, text in entries]
        sensible = all(type(place) is int for place, _ in entries) and bool((np.diff(places) > 0).all())
        sensible &= bool(len(entries)) and places[0] >= 0 and places[-1] < values.size
        doubles = values.reshape(-1)[places].tolist() if sensible else []
        sensible &= all(nearest_double(x) == d != x for x, d in zip(exact, doubles, strict=bool(sensible)))
    except (TypeError, ValueError, IndexError, OverflowError, ZeroDivisionError, DataError):
        sensible = False
    if not sensible:
        raise CertificateFileError("its exact numbers do not belong to the doubles that they stand for.")
    return places, exact


def with_entries(values: NDArray[np.float64], entries: Entries) -> Matrix:
    """A stack of matrices, of which some numbers are no doubles.

    Raises
    ------
    CertificateFileError
        They do not fit to the doubles in their places.
    """
    places, exact = _read(values, entries)
    flat = values.reshape(len(values), -1)
    integers, exponent = integers_of_doubles(flat, by_row=True)
    numerators = np.array([1 << max(e, 0) for e in exponent.ravel().tolist()], dtype=object)[:, None] * integers
    below = np.array([1 << max(-e, 0) for e in exponent.ravel().tolist()], dtype=object)
    owner = places // flat.shape[1]
    for j in np.flatnonzero(np.bincount(owner)).tolist():
        here = np.flatnonzero(owner == j)
        row: list[Any] = [Fraction(x, below[j]) for x in numerators[j].tolist()]
        for k in here.tolist():
            row[places[k] - j * flat.shape[1]] = exact[k]
        common = lcm(*(x.denominator for x in row))
        numerators[j], below[j] = [x.numerator * (common // x.denominator) for x in row], common
    rounded = np.zeros(values.size, dtype=bool)
    rounded[places] = True
    radius = np.where(rounded.reshape(values.shape), rounding_radius(values), 0.0)
    under = int(below[0]) if len(values) == 1 else below.reshape(-1, 1, 1)
    return Matrix(values, radius, numerators.reshape(values.shape), under)


def with_weights(WT: Any, entries: Entries) -> Matrix:
    """W of a shard, dense, from W' in doubles and the weights that are none.

    Raises
    ------
    TooLargeError
        More than 10^7 entries, zeros counted.
    CertificateFileError
        The exact numbers do not fit to the doubles in their places.
    """
    if WT.shape[0] * WT.shape[1] > _ENTRIES:
        raise TooLargeError(
            f"links of a shard with decimals or fractions are refused for {WT.shape[1]} x {WT.shape[0]} (limit "
            f"{_ENTRIES} entries, zeros counted); write more shards, or weights in doubles."
        )
    places, exact = _read(WT.data, entries)
    weights = np.array([Fraction(x) for x in WT.data.tolist()], dtype=object)
    weights[places] = exact
    out = np.full(WT.shape, Fraction(0), dtype=object)
    out[np.repeat(np.arange(WT.shape[0]), np.diff(WT.indptr)), WT.indices] = weights
    return Matrix.from_fractions(out.T)
