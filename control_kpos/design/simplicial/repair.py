"""A Farkas combination from floating point made exact, without elimination of large integers.

Wanted are exact weights l >= 0 with G'l = 0 for rows G over (xi, z), some of them the rows xi > 0 themselves.  A linear
program gives l up to rounding.  Most weights are kept as they are.  For each generator, as many weights as z_k has
entries are recomputed from a small exact system, and the weights of xi > 0 absorb the remainder.  If the program made
those large enough, they stay nonnegative.
"""

from __future__ import annotations

from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import DataError
from ...exact.budget import affords
from ...exact.linalg import solve_exactly
from ...exact.matrix import Matrix
from ...exact.program import Block, Program
from ...exact.programs import balance

Rationals = NDArray[np.object_]

# Least weights of xi > 0 asked for, tried in turn; what counts as zero; weight of rows that are not in use.
_MARGINS, _TINY, _FAINT = (1e-2, 1e-1, 1e-3, 1e-5), 1e-10, 1e-6


def repaired_multipliers(
    rows: Rationals, owner: NDArray[np.intp], n: int, strict: NDArray[np.bool_]
) -> Rationals | None:
    """Exact l >= 0 with rows' l = 0 and a positive sum over `strict`, or None.

    Parameters
    ----------
    rows : ndarray of int and Fraction, shape (K, v)
        The last n rows are xi > 0.
    owner : ndarray of int, shape (v,)
        The generator of each variable; the first n are xi.
    n : int
    strict : ndarray of bool, shape (K,)
    """
    try:
        sizes, exact = _balanced(rows)
        values = exact.astype(float)
    except (DataError, OverflowError):  # numbers beyond the range of doubles
        return None
    for margin in _MARGINS:
        chosen = _exact(exact, values, owner, n, strict, margin)
        if chosen is not None:
            return np.array([x * size for x, size in zip(chosen, sizes, strict=True)], dtype=object)
    return None


def _exact(
    exact: Rationals,
    values: NDArray[np.float64],
    owner: NDArray[Any],
    n: int,
    strict: NDArray[np.bool_],
    margin: float,
) -> Rationals | None:
    found = _proposal(values, n, strict, margin) if affords() else None
    if found is None:
        return None
    chosen = np.array([Fraction(x) for x in found.tolist()], dtype=object)
    chosen[-n:] = Fraction(0)
    for k in range(n):
        if not affords():
            return None
        own = np.flatnonzero(owner[n:] == k) + n
        if own.size and not _settle(exact, values, chosen, found, own, len(exact) - n):
            return None
    # the row of xi_k > 0 holds one entry
    rest = chosen @ exact
    chosen[-n:] = [-rest[k] / exact[len(exact) - n + k, k] for k in range(n)]
    if not (chosen >= 0).all() or not (chosen @ exact == 0).all() or not chosen[strict].sum() > 0:
        return None
    return chosen


def _balanced(rows: Rationals) -> tuple[list[Fraction], Rationals]:
    """Rows and columns multiplied by powers of two that bring entries close to 1; the factors of the rows."""
    r, c = balance(sp.csr_array(Matrix.from_fractions(rows).values))
    left, right = ([Fraction(2) ** int(e) for e in exponents] for exponents in (r, c))
    return left, rows * np.array(left, dtype=object)[:, None] * np.array(right, dtype=object)


def _proposal(
    values: NDArray[np.float64], n: int, strict: NDArray[np.bool_], most: float
) -> NDArray[np.float64] | None:
    """Weights in doubles, those of xi > 0 as large as possible, since they absorb the remainder."""
    count = len(values)
    program = Program(multipliers=Block(count, low=0.0), margin=Block(n, low=0.0, high=most, cost=-1.0))
    program.below(0.0, multipliers=np.hstack([np.zeros((n, count - n)), -np.eye(n)]), margin=np.eye(n))
    program.equal(0.0, multipliers=values.T)
    program.equal(1.0, multipliers=strict[None, :])
    answer = program.solve()
    if not answer:
        return None
    out = answer["multipliers"]
    return np.where(out > _TINY * out.max(), out, 0.0)


def _settle(
    exact: Rationals,
    values: NDArray[np.float64],
    chosen: Rationals,
    found: NDArray[np.float64],
    own: NDArray[Any],
    last: int,
) -> bool:
    """Recompute the multipliers of a few rows so that the equations of the variables `own` hold exactly."""
    others = [c for c in range(len(exact[0])) if c not in set(own.tolist())]
    n = len(exact) - last
    local = np.flatnonzero((values[:last, own] != 0).any(axis=1) & (values[:last, others][:, n:] == 0).all(axis=1))
    if not len(local):
        return bool((chosen @ exact[:, own] == 0).all())
    # rows that are not in use help only if they are bounds, which hold from both sides
    single = (values[local][:, own] != 0).sum(axis=1) == 1
    weight = found[local] + _FAINT * found.max() * single
    _, triangle, order = sl.qr((values[local][:, own] * weight[:, None]).T, pivoting=True, mode="economic")
    if len(order) < len(own) or abs(triangle[len(own) - 1, len(own) - 1]) <= 1e-12 * abs(triangle[0, 0]):
        return False
    basic = local[order[: len(own)]]
    chosen[basic] = Fraction(0)
    right = -(chosen @ exact[:, own])
    square = exact[np.ix_(basic, own)].T
    ints = _integers(np.concatenate([square, right[:, None]], axis=1))
    solution = solve_exactly(ints[:, :-1], ints[:, -1:])
    if solution is None:
        return False
    for row, x in zip(basic.tolist(), solution[0][:, 0], strict=True):
        value = Fraction(int(x), solution[1])
        if value < 0:  # the bound from the other side, if the row is a bound
            opposite = [r for r in local.tolist() if (exact[r, own] == -exact[row, own]).all()]
            if not opposite:
                return False
            row, value = opposite[0], -value
        chosen[row] += value
    return True


def _integers(rows: Rationals) -> Rationals:
    """Each row times the common denominator of its entries."""
    factors = [lcm(*(x.denominator for x in row)) for row in rows]
    return np.array([[int(x * factor) for x in row] for row, factor in zip(rows, factors, strict=True)], dtype=object)
