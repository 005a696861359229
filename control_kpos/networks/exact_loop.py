"""The closed loop of a network in exact arithmetic, for networks of moderate size.

    A + B L C,    B R,    C + D L C,    D R,    with R = (I - W D)^{-1} and L = R W,

multiplied out in integers on the entries that are not zero.  R is the finite sum of powers of W D where no
feedthrough closes a loop, and otherwise the solution of a small system of equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import lcm

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..exact.linalg import solve_exactly
from ..exact.matrix import Integers, Matrix, nearest_double
from ..exact.rounding import rounding_radius
from .blocks import Index
from .model import NetworkModel

# States up to which a closed loop is multiplied out exactly; above, its doubles are what there is.
EXACT_STATES = 300
# Products of entries up to which this is done, and inputs if feedthrough terms close a loop.
_MOST_PRODUCTS = 500_000
_MOST_LOOPING = 40


class TooManyProductsError(Exception):
    """The exact closed loop would take too long."""


@dataclass(frozen=True, eq=False)
class Entries:
    """A sparse exact matrix: integers, each once and none of them zero, times a common factor."""

    rows: Index
    columns: Index
    integers: Integers
    factor: Fraction
    shape: tuple[int, int]

    @classmethod
    def of(cls, m: Matrix) -> Entries:
        """The entries of a matrix."""
        integers, factor = m.as_integers()
        rows, columns = np.nonzero(integers)
        return cls(rows, columns, integers[rows, columns], Fraction(factor), (m.shape[0], m.shape[1]))

    def __matmul__(self, other: Entries) -> Entries:
        order = np.argsort(other.rows, kind="stable")
        start = np.searchsorted(other.rows[order], np.arange(other.shape[0] + 1))
        count = (start[1:] - start[:-1])[self.columns]
        if count.sum() > _MOST_PRODUCTS:
            raise TooManyProductsError
        mine = np.repeat(np.arange(len(self.rows)), count)
        theirs = order[np.arange(len(mine)) - np.repeat(np.cumsum(count) - count, count) + start[self.columns[mine]]]
        values = self.integers[mine] * other.integers[theirs]
        shape = self.shape[0], other.shape[1]
        return _gathered(self.rows[mine], other.columns[theirs], values, self.factor * other.factor, shape)

    def __add__(self, other: Entries) -> Entries:
        unit = Fraction(1, lcm(self.factor.denominator, other.factor.denominator))
        values = [part.integers * int(part.factor / unit) for part in (self, other)]
        rows, columns = (np.concatenate(pair) for pair in ((self.rows, other.rows), (self.columns, other.columns)))
        return _gathered(rows, columns, np.concatenate(values), unit, self.shape)

    def matrix(self) -> Matrix:
        """The same as a dense matrix."""
        exact = [int(x) * self.factor for x in self.integers]
        doubles = np.array([nearest_double(x) for x in exact], dtype=np.float64)
        rounded = np.array([Fraction(d) != x for d, x in zip(doubles.tolist(), exact, strict=True)], dtype=bool)
        values, radius = np.zeros(self.shape), np.zeros(self.shape)
        values[self.rows, self.columns] = doubles
        if not rounded.any():
            return Matrix(values)
        radius[self.rows, self.columns] = np.where(rounded, rounding_radius(doubles), 0.0)
        numerators = np.zeros(self.shape, dtype=object)
        numerators[self.rows, self.columns] = self.integers * self.factor.numerator
        return Matrix(values, radius, numerators, self.factor.denominator)


def _gathered(rows: Index, columns: Index, values: Integers, factor: Fraction, shape: tuple[int, int]) -> Entries:
    """Entries in the same place added up, zeros left out."""
    key = rows * shape[1] + columns
    order = np.argsort(key, kind="stable")
    key, values = key[order], values[order]
    if len(key):
        first = np.flatnonzero(np.concatenate([[True], np.diff(key) > 0]))
        key, values = key[first], np.add.reduceat(values, first)
    alive = values != 0
    key, values = key[alive], values[alive]
    return Entries(key // shape[1], key % shape[1], values, factor, shape)


def exact_loop(model: NetworkModel) -> tuple[Matrix, Matrix, Matrix, Matrix] | None:
    """A, B, C, D of the closed loop from all external inputs to all outputs, or None where it takes too long."""
    if model.totals[0] > EXACT_STATES:
        return None
    try:
        a, b, c, d = (_side_by_side(model, name, *kinds) for name, kinds in _KINDS.items())
        W = Entries.of(model.coupling.dense())
        R = _resolvent(W, d, model.totals[1])
        heard = R @ (W @ c)
        A, B, C, D = a + b @ heard, b @ R, c + d @ heard, d @ R
        return A.matrix(), B.matrix(), C.matrix(), D.matrix()
    except TooManyProductsError:
        return None


_KINDS = {"A": (0, 0), "B": (0, 1), "C": (2, 0), "D": (2, 1)}


def _side_by_side(model: NetworkModel, name: str, rows: int, columns: int) -> Entries:
    shape = model.totals[rows], model.totals[columns]
    none = np.zeros(0, dtype=np.intp)
    out = Entries(none, none, none.astype(object), Fraction(1), shape)
    for s, places in zip(model.stacks, model.places, strict=True):
        integers, factor = getattr(s, name).as_integers()
        node, i, k = np.nonzero(integers)
        at_rows, at_columns = places[rows][node, i], places[columns][node, k]
        out = out + Entries(at_rows, at_columns, integers[node, i, k], Fraction(factor), shape)
    return out


def _resolvent(W: Entries, D: Entries, size: int) -> Entries:
    """R = (I - W D)^{-1}."""
    every = np.arange(size)
    unit = Entries(every, every, np.ones(size, dtype=object), Fraction(1), (size, size))
    loop = W @ D
    pattern = sp.csr_array((np.ones(len(loop.rows)), (loop.rows, loop.columns)), shape=loop.shape)
    parts, _ = connected_components(pattern, directed=True, connection="strong")
    if parts == size and not pattern.diagonal().any():  # no loops: a power of W D vanishes
        out = term = unit
        while len(term.rows):
            term = term @ loop
            out = out + term
        return out
    if size > _MOST_LOOPING:
        raise TooManyProductsError
    scale = loop.factor.denominator
    integers = np.zeros(loop.shape, dtype=object)
    integers[loop.rows, loop.columns] = -loop.integers * loop.factor.numerator
    integers[every, every] += scale
    solution = solve_exactly(integers, np.eye(size, dtype=int).astype(object) * scale)
    if solution is None:  # so close to singular that the test in doubles did not notice
        raise TooManyProductsError
    return Entries.of(Matrix.from_fractions(solution[0] * Fraction(1, solution[1])))
