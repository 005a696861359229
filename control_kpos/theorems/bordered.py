"""Stability of a matrix that is cross-positive on a cone with any facets, by refinement of its bordered equations.

With c the sum of the facets h_i and d that of the generators x_i, both inside their cones,

    [ N   d ] [x]   [0]            [ N'  c ] [v]   [0]
    [ c'  0 ] [t] = [1]    and     [ d'  0 ] [t] = [1]

are well conditioned even where N is singular, and have one t.  If t < 0 and x is in the cone, N x = -t d is too; if
t > 0 and v is inside the dual cone, v'N = -t c falls on all generators.  As in `refinement`, unknowns are integers,
residuals are formed without rounding, and corrections come from one factorisation in floating point; nothing is
trusted but the signs of what is found, in integers.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ..exact.budget import spend
from ..exact.matrix import Integers
from ..exact.sparse_integers import Floats, SparseIntegers, mantissas
from .refinement import rational_multiple

# Rows up to which one dense factorisation is a matter of a second.
_ROWS = 1500
# Bits that a step adds, and how many steps are tried: exact solutions take over.
_BITS, _STEPS = 40, 6
# Bits at which a direction that stands still is sought among small integers, and those that are left to errors.
_STILL, _LOST = 110, 24


def decide_bordered(N: SparseIntegers, facets: Integers, rays: Integers) -> tuple[bool, Integers] | None:
    """Whether N is stable, with v'N < 0 or with N x in the cone; None where a few steps do not show it.

    Parameters
    ----------
    N : SparseIntegers, shape (n, n)
        Irreducible and cross-positive on the cone.
    facets, rays : ndarray of int (object), shapes (., n)
        Of the cone.
    """
    if N.height > _ROWS:
        return None
    H, R = SparseIntegers.dense(facets), SparseIntegers.dense(rays)
    solver = _Bordered(N, rays.sum(axis=0), facets.sum(axis=0))
    lefts = solver.solutions(transposed=True)
    for x, t, digits in islice(solver.solutions(), _STEPS):
        v = next(lefts, None) if t > 0 else None
        if v is not None and (R.apply(v[0]) > 0).all() and (R.apply(N.T.apply(v[0])) < 0).all():
            return True, v[0]
        still = rational_multiple(x, _LOST) if digits > _STILL else None
        for z in (x, still):
            if z is not None and z.any() and (H.apply(z) >= 0).all() and (H.apply(N.apply(z)) >= 0).all():
                return False, z
    return None


class _Bordered:
    """K = [[N, d], [c', 0]] in integers, and factors of 2^-i K 2^-j in floating point, in units i and j."""

    def __init__(self, N: SparseIntegers, d: Integers, c: Integers) -> None:
        n = N.height
        spend(float(n) ** 3 / 10)
        last = np.full(n, n)
        rows = np.concatenate([N.rows, np.arange(n), last])
        columns = np.concatenate([N.indices, last, np.arange(n)])
        self.K = SparseIntegers.of(rows, columns, np.concatenate([N.data, d, c]), (n + 1, n + 1))
        mantissa, exponent = self.K.mantissas
        low = -(2**20)  # of rows and columns of zeros
        self.units = [np.full(n + 1, low), np.full(n + 1, low)]
        np.maximum.at(self.units[0], self.K.rows, exponent)
        rest = exponent - self.units[0][self.K.rows]
        np.maximum.at(self.units[1], self.K.indices, rest)
        M = np.zeros((n + 1, n + 1))
        M[self.K.rows, self.K.indices] = np.ldexp(mantissa, np.maximum(rest - self.units[1][self.K.indices], -1100))
        factors, pivots, failed = scipy.linalg.lapack.dgetrf(M)
        self._factors: Any = None if failed else (factors, pivots)

    def _solve(self, b: Floats, transposed: bool) -> Floats:
        return scipy.linalg.lapack.dgetrs(*self._factors, b, trans=int(transposed))[0]

    def solutions(self, *, transposed: bool = False) -> Iterator[tuple[Integers, int, int]]:
        """x (v if transposed) and t, all times one power of two, with more and more bits, and how many."""
        if self._factors is None:
            return
        K, (rows, columns) = (self.K.T, self.units[::-1]) if transposed else (self.K, self.units)
        rows, lift = rows.astype(np.int64), (columns.max() - columns).astype(object)
        Z: Integers = np.zeros(len(lift), dtype=object)
        one = np.zeros(len(lift), dtype=object)
        one[-1] = 1
        P = 0
        while True:
            rest = (one << (P + int(columns.max()))) - K.apply(Z << lift)
            added = self._correction(rest, rows, int(columns.max()), transposed)
            if added is None:
                return
            change, step = added
            Z, P = np.left_shift(Z, step) + change, P + step
            solution = Z << lift
            yield solution[:-1], int(solution[-1]), P

    def _correction(
        self, rest: Integers, rows: NDArray[np.int64], unit: int, transposed: bool
    ) -> tuple[Integers, int] | None:
        """What is added to the unknowns, shifted by so many bits first; None where floating point adds nothing."""
        mantissa, exponent = mantissas(rest)
        exponent = exponent - rows
        filled = mantissa != 0
        if not filled.any():
            return None
        top = int(exponent[filled].max())
        z = self._solve(np.ldexp(mantissa, np.maximum(exponent - top, -1100)), transposed)
        if not np.isfinite(z).all() or not z.any():
            return None
        size = int(np.frexp(np.abs(z).max())[1])
        whole = np.rint(np.ldexp(z, 62 - size)).astype(np.int64).astype(object)  # z = whole 2^(size - 62)
        step = max(_BITS - (top - unit) - size, 0)
        back = 62 - size - (top - unit) - step
        added: Integers = np.right_shift(whole, back) if back >= 0 else np.left_shift(whole, -back)
        return added, step
