"""Smallest theta for which a homogeneous system has a solution: generalised fractional programming.

    minimise theta   subject to   fixed x <= 0,   N x <= theta D x,   x = (xi, z), xi > 0,   D x > 0,

where D picks positive multiples of entries of xi.  The smallest gain and the largest decay rate on a
simplicial cone are of this form.  For fixed theta it is a linear program; Dinkelbach's iteration, with
the denominators of the last point as weights (Crouzeix, Ferland and Schaible 1985), needs a handful of
them where bisection needs dozens, and every iterate is feasible.  Matrices are dense or sparse.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exact.program import Block, Program, Solver
from ...exact.programs import Solution
from .rows import scaled, scaled_rows

Floats = NDArray[np.float64]
Owners = NDArray[np.intp]

# How far one step may shrink an entry of xi, and how far all steps may.
# Where the infimum is only reached as an entry of xi vanishes, the gain would lose all its margins.
_SHRINK, _FLOOR = 1e-3, 1e-5
_STEPS = 40


def first_point(fixed: Any, N: Any, owner: Owners, lp: Solver) -> Solution:
    """Some x with fixed x <= 0, xi >= 1 and max N x small: the block "x" of the answer.

    Parameters
    ----------
    fixed, N : ndarray or csr_array, shapes (R, v), (Q, v)
    owner : ndarray of int, shape (v,)
        The xi that each variable is proportional to; the first n are xi themselves.
    lp : callable
        As `control_kpos.exact.programs.solve`.
    """
    # no upper bound: the solver's tolerance is relative to the largest one
    program = Program(x=_over(owner, 1.0, np.inf), largest=Block(1, low=0.0, cost=1.0))
    program.below(0.0, x=fixed)
    program.below(0.0, x=N, largest=-np.ones(N.shape[0]))
    return program.solve(lp)


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
        if not theta > stop:
            break
        x = x / x[:n].max()
        scale = x[owner]
        near = _over(owner, np.clip(floor / x[:n], _SHRINK, 1.0), 1.0)
        program = Program(x=near, decrease=Block(1, cost=1.0))
        program.below(0.0, x=scaled(fixed, scale))
        program.below(0.0, x=scaled(N - theta * D, scale), decrease=-(D @ x))
        answer = program.solve(lp)
        if answer.outcome in ("unbounded", "infeasible"):  # x itself is feasible
            return x, -np.inf
        if not answer:
            break
        candidate = answer["x"] * scale
        value = _worst(N, D, candidate)
        if not value < theta or not (candidate[:n] > 0).all() or not satisfies(fixed, candidate):
            break
        small = tolerance * max(abs(theta), abs(value))
        finished = theta - value <= small and -answer["decrease"][0] <= small
        x, theta = candidate, value
        if finished:
            break
    return x, theta


def spread_margins(fixed: Any, rows: Any, x: Floats, owner: Owners, lp: Solver) -> Floats:
    """A point near x where every row that can be positive is so; x itself if there is none within reach.

    Parameters
    ----------
    fixed, rows : ndarray or csr_array
        fixed x <= 0 stays; `rows`, now >= 0, are moved, each relative to its size; see `Program.spread`.
    x : ndarray, shape (v,)
    owner : ndarray of int, shape (v,)
    lp : callable
    """
    scale = x[owner]
    size = abs(rows) @ np.abs(x)
    program = Program(x=_over(owner, 0.5, 2.0))
    program.below(0.0, x=scaled(fixed, scale))
    relative = scaled_rows(scaled(rows, scale), 1 / np.where(size > 0, size, 1.0))
    program.spread(0.0, np.ones(rows.shape[0]), x=relative)
    answer = program.solve(lp)
    return answer["x"] * scale if answer else x


def satisfies(fixed: Any, x: Floats) -> bool:
    """True if fixed x <= 0 up to rounding, relative to the size of each row at x."""
    return bool((fixed @ x <= 1e-7 * (abs(fixed) @ np.abs(x))).all())


def _over(owner: Owners, low: Any, high: Any) -> Block:
    """The variables x = (xi, z) with bounds on xi."""
    n = int(owner.max()) + 1
    free = np.full(len(owner) - n, np.inf)
    ends = [np.concatenate([np.broadcast_to(side, n), end]) for side, end in ((low, -free), (high, free))]
    return Block(len(owner), *ends)


def _worst(N: Any, D: Any, x: Floats) -> float:
    return float(np.max((N @ x) / (D @ x), initial=-np.inf))
