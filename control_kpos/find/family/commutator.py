"""A common simplicial cone for a family, by turning n rays at once.

With R = rays' invertible, P_s = R^-1 A_s R must be nonnegative off the diagonal for every s.  Moving the
rays, R (I + E), changes P_s by the commutator P_s E - E P_s to first order, so one linear program with
n^2 + 1 unknowns improves the smallest entry:

    maximise t   subject to   (P_s + P_s E - E P_s)_ij >= t s_ij  (i != j),   1'E = 0,   |E_ij| <= radius.

R stays invertible, so the cone stays pointed and solid; 1'E = 0 keeps the rays in a hyperplane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ...exact.budget import affords, spend
from ...exact.programs import program_effort, solve

Array = NDArray[np.float64]

_ROUNDS = 60
# Dense rows of the program for all matrices: what fits into memory, and operations to build and solve each entry.
_MOST_ENTRIES = 10**8
_PER_ENTRY = 50.0


def simplicial_descent(matrices: Array, R: Array, *, discrete: bool, goal: float = 1e-3) -> tuple[Array, float]:
    """Move n rays until every P_s has the right signs, or no further.

    Parameters
    ----------
    matrices : ndarray, shape (M, n, n)
        Of size about one.
    R : ndarray, shape (n, n)
        Generators to start from, one a column.
    goal : float
        Margin at which to stop.

    Returns
    -------
    R : ndarray, shape (n, n)
    margin : float
        Smallest entry that should be nonnegative.
    """
    radius = 0.3
    margin = _margin(matrices, R, discrete)
    for _ in range(_ROUNDS):
        if margin >= goal or radius < 1e-5 or not affords():
            break
        step = _step(matrices, R, radius, discrete)
        if step is None:
            break
        moved = R @ expm(step)  # invertible, whatever the step
        moved = moved / np.linalg.norm(moved, axis=0)
        if not np.isfinite(moved).all() or not np.linalg.cond(moved) < 1e6:
            radius /= 4
            continue
        value = _margin(matrices, moved, discrete)
        if value > margin + 1e-9:
            radius = min(1.0, 1.7 * radius) if value > margin + 0.1 * abs(margin) else radius
            R, margin = moved, value
        else:
            radius /= 3
    return R, margin


def _images(matrices: Array, R: Array) -> Array:
    return np.asarray(np.linalg.solve(R, matrices @ R), dtype=np.float64)


def _margin(matrices: Array, R: Array, discrete: bool) -> float:
    P = _images(matrices, R)
    return float(P[:, required_entries(len(R), discrete)].min(initial=np.inf))


def required_entries(n: int, discrete: bool) -> NDArray[np.bool_]:
    """Entries of P that must be nonnegative."""
    return np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool)


def commutator_rows(P: Array) -> Array:
    """P E - E P as a linear function of E; shape (M, n, n, n^2)."""
    count, n, _ = P.shape
    eye = np.eye(n)
    # Row (s, i, j), column (a, b): d(P E - E P)_ij / dE_ab = P_ia [j = b] - [i = a] P_bj.
    rows = np.einsum("sia,jb->sijab", P, eye) - np.einsum("ia,sbj->sijab", eye, P)
    return rows.reshape(count, n, n, n * n)


def _step(matrices: Array, R: Array, radius: float, discrete: bool) -> Array | None:
    P = _images(matrices, R)
    n = len(R)
    if P.size * n**2 > _MOST_ENTRIES:
        return None
    spend(_PER_ENTRY * P.size * n**2)
    rows = commutator_rows(P)
    required = required_entries(n, discrete)
    rows = rows[:, required].reshape(-1, n * n)
    values = P[:, required].reshape(-1)
    # Entries that are safe whatever E does within the radius need no row.
    near = values - radius * np.abs(rows).sum(axis=1) < max(1.0, float(np.abs(values).max())) * 0.05
    rows, values = rows[near], values[near]
    cost = np.zeros(n * n + 1)
    cost[-1] = -1.0
    heights = np.concatenate([np.kron(np.ones((1, n)), np.eye(n)), np.zeros((n, 1))], axis=1)
    upper = np.full(n * n + 1, radius)
    upper[-1] = 1.0
    spend(program_effort(len(rows) + n, n * n + 1))
    answer = solve(
        cost,
        A_ub=np.column_stack([-rows, np.ones(len(rows))]),
        b_ub=values,
        A_eq=heights,
        b_eq=np.zeros(n),
        bounds=(np.append(-upper[:-1], -1e3), upper),
    )
    return answer.x[:-1].reshape(n, n) if answer else None
