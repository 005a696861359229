"""Smallest theta for which a homogeneous system has a solution: generalised fractional programming.

    minimise theta   subject to   fixed x <= 0,   N x <= theta D x,   x = (xi, z), xi > 0,   D x > 0,

where D picks positive multiples of entries of xi.  The smallest gain and the largest decay rate on a
simplicial cone are of this form.  For fixed theta it is a linear program; Dinkelbach's iteration, with
the denominators of the last point as weights (Crouzeix, Ferland and Schaible 1985), needs a handful of
them where bisection needs dozens, and every iterate is feasible.  Matrices are dense or sparse.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import seconds_left
from ...exact.programs import Solution
from .rows import (
    assembled,
    bordered,
    diagonals,
    scaled,
    scaled_rows,
)

Floats = NDArray[np.float64]
Owners = NDArray[np.intp]
Solver = Callable[..., Solution]

# How far one step may shrink an entry of xi, how far all steps may, and how far apart the first entries may be.
# Where the infimum is only reached as an entry of xi vanishes, the gain would lose all its margins.
_SHRINK, _FLOOR, _SPREAD = 1e-3, 1e-5, 1e4
_STEPS = 40
TIERS = (1e-7, 1e-5, 1e-3)


def first_point(fixed: Any, N: Any, owner: Owners, lp: Solver) -> Solution:
    """Some x with fixed x <= 0, xi >= 1 and max N x small; the last entry of the answer is that maximum.

    Parameters
    ----------
    fixed, N : ndarray or csr_array, shapes (R, v), (Q, v)
    owner : ndarray of int, shape (v,)
        The xi that each variable is proportional to; the first n are xi themselves.
    lp : callable
        As `control_kpos.linear_programs.solve`.
    """
    n, v = int(owner.max()) + 1, len(owner)
    cost = np.append(np.zeros(v), 1.0)
    rows = bordered(fixed, N, -np.ones(N.shape[0]))
    low = np.concatenate([np.ones(n), np.full(v - n, -np.inf), [0.0]])
    best = Solution("failed", np.empty(0))
    for spread in (_SPREAD, np.inf):
        high = np.concatenate([np.full(n, spread), np.full(v - n + 1, np.inf)])
        answer = lp(cost, rows, np.zeros(rows.shape[0]), bounds=(low, high))
        if answer and satisfies(fixed, answer.x[:-1]):
            return answer
        # the solver's tolerance is relative to the largest bound: without one it is sharper
        best = answer if answer or not best else best
        if answer.outcome not in ("optimal", "infeasible"):
            break
    return best


def minimise_ratio(
    fixed: Any,
    N: Any,
    D: Any,
    owner: Owners,
    lp: Solver,
    *,
    start: Floats,
    stop: float = -np.inf,
    tolerance: float = 1e-4,
) -> tuple[Floats, float]:
    """Decrease theta from a feasible point until no linear program improves it.

    Parameters
    ----------
    fixed, N, D : ndarray or csr_array, shapes (R, v), (Q, v), (Q, v)
        Rows of fixed x <= 0 and N x <= theta D x.
    owner : ndarray of int, shape (v,)
    lp : callable
    start : ndarray, shape (v,)
        Feasible, xi > 0.
    stop : float
        Value below which theta counts as unbounded.
    tolerance : float
        Relative decrease at which to stop.

    Returns
    -------
    x : ndarray, shape (v,)
    theta : float
        Largest of N x / D x; -inf if the solver finds that nothing limits it.
    """
    n = int(owner.max()) + 1
    x, theta = start, _worst(N, D, start)
    floor = _FLOOR * start[:n] / start[:n].max()
    for _ in range(_STEPS):
        if not theta > stop or seconds_left() <= 0:
            break
        x = x / x[:n].max()
        scale = x[owner]
        block = bordered(scaled(fixed, scale), scaled(N - theta * D, scale), -(D @ x))
        answer = _nearby(block, np.clip(floor / x[:n], _SHRINK, 1.0), lp)
        if answer.outcome in ("unbounded", "infeasible"):  # x itself is feasible
            return x, -np.inf
        if not answer:
            break
        candidate = answer.x[:-1] * scale
        value = _worst(N, D, candidate)
        if not value < theta or not (candidate[:n] > 0).all() or not satisfies(fixed, candidate):
            break
        small = tolerance * max(abs(theta), abs(value))
        finished = theta - value <= small and -answer.x[-1] <= small
        x, theta = candidate, value
        if finished:
            break
    return x, theta


def spread_margins(fixed: Any, rows: Any, x: Floats, owner: Owners, lp: Solver) -> Floats:
    """A point near x where every row that can be positive is so.

    Each row, relative to its size, earns for its slack what `TIERS` say: the first 1e-7 as much as the next
    1e-5 and the next 1e-3 (a concave utility), so that no row takes all and rows that must be 0 do no harm.

    Parameters
    ----------
    fixed, rows : ndarray or csr_array
        fixed x <= 0 stays; `rows`, now >= 0, are moved.
    x : ndarray, shape (v,)
    owner : ndarray of int, shape (v,)
    lp : callable

    Returns
    -------
    ndarray, shape (v,)
        x itself if the program fails, or time is over.
    """
    if seconds_left() <= 0:
        return x
    n, v, count = int(owner.max()) + 1, len(x), rows.shape[0]
    scale = x[owner]
    size = abs(rows) @ np.abs(x)
    size = np.where(size > 0, size, 1.0)
    relative = scaled_rows(scaled(rows, scale), 1 / size)
    slack = diagonals([np.full(count, tier) for tier in TIERS])
    block = assembled([[scaled(fixed, scale), None], [-relative, slack]])
    cost = np.concatenate([np.zeros(v), -np.ones(slack.shape[1])])
    low = np.concatenate([np.full(n, 0.5), np.full(v - n, -np.inf), np.zeros(slack.shape[1])])
    high = np.concatenate([np.full(n, 2.0), np.full(v - n, np.inf), np.ones(slack.shape[1])])
    answer = lp(cost, block, np.zeros(block.shape[0]), bounds=(low, high))
    return answer.x[:v] * scale if answer else x


def satisfies(fixed: Any, x: Floats) -> bool:
    """True if fixed x <= 0 up to rounding, relative to the size of each row at x."""
    return bool((fixed @ x <= 1e-7 * (abs(fixed) @ np.abs(x))).all())


def _worst(N: Any, D: Any, x: Floats) -> float:
    with np.errstate(all="ignore"):
        return float(np.max((N @ x) / (D @ x), initial=-np.inf))


def _nearby(block: Any, low: Floats, lp: Solver) -> Solution:
    """Minimise the last variable over block (u, z, last) <= 0 with u in [low, 1]."""
    n, free = len(low), block.shape[1] - len(low)
    cost = np.append(np.zeros(block.shape[1] - 1), 1.0)
    low = np.concatenate([low, np.full(free, -np.inf)])
    high = np.concatenate([np.ones(n), np.full(free, np.inf)])
    return lp(cost, block, np.zeros(block.shape[0]), bounds=(low, high))
