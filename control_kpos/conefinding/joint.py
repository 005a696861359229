"""A simplicial cone and a gain for several plants, moved together.

With R = rays' invertible and P_s = R^-1 (A_s + B_s F) R, moving the rays and the gain, R (I + E) and F + G,
changes P_s to first order by

    P_s E - E P_s + R^-1 B_s G R,

so one linear program with n^2 + m n + 1 unknowns improves invariance and stability of all loops at once:

    maximise t   subject to   (P_s)_ij >= t (i != j),   P_s 1 <= -t,   |E_ij| <= radius,   |G_ij| <= size of F radius

(discrete time: P_s >= t, P_s 1 <= 1 - t).  P_s 1 < 0 says that the sum of the rays, which is inside the cone, moves
inwards along every A_s + B_s F: that is a common certificate of stability.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ..linear_programs import solve
from .commutator import commutator_rows, required_entries

Array = NDArray[np.float64]

_ROUNDS = 80


def joint_descent(
    matrices: Array,
    inputs: Array,
    R: Array,
    F: Array,
    *,
    discrete: bool,
    remaining: Callable[[], float],
    goal: float = 1e-3,
) -> tuple[Array, Array, float]:
    """Move n rays and a gain until every loop is invariant and stable, or no further.

    Parameters
    ----------
    matrices, inputs : ndarray, shapes (M, n, n), (M, n, m)
    R : ndarray, shape (n, n)
        Generators to start from, one a column.
    F : ndarray, shape (m, n)
        Gain to start from, u = F x.
    remaining : callable
        Seconds left.
    goal : float
        Margin at which to stop.

    Returns
    -------
    R, F : ndarray
    margin : float
        t, relative to the largest entry of P in continuous time.
    """
    radius = 0.3
    P = _loops(matrices, inputs, R, F)
    margin = _margin(P, discrete)
    for _ in range(_ROUNDS):
        if margin >= goal or radius < 1e-4 or remaining() <= 0:
            break
        reach = np.asarray(np.linalg.solve(R, inputs), dtype=np.float64)
        found = _step(P, reach, R, radius, discrete, remaining())
        if found is None:
            break
        E, G = found
        moved, gain = R @ expm(E), F + G  # invertible, whatever the step
        if not np.isfinite(moved).all() or not np.linalg.cond(moved / np.linalg.norm(moved, axis=0)) < 1e6:
            radius /= 4
            continue
        images = _loops(matrices, inputs, moved, gain)
        value = _margin(images, discrete)
        if value > margin + 1e-9:
            radius = min(1.0, 1.7 * radius) if value > margin + 0.1 * abs(margin) else radius
            R, F, P, margin = moved, gain, images, value
        else:
            radius /= 3
    return R, F, margin


def _loops(matrices: Array, inputs: Array, R: Array, F: Array) -> Array:
    return np.asarray(np.linalg.solve(R, (matrices + inputs @ F) @ R), dtype=np.float64)


def _margin(P: Array, discrete: bool) -> float:
    entries = float(P[:, required_entries(P.shape[1], discrete)].min(initial=np.inf))
    room = float((discrete - P.sum(axis=2)).min())
    return min(entries, room) / (1.0 if discrete else float(np.abs(P).max()) or 1.0)


def _step(P: Array, reach: Array, R: Array, radius: float, discrete: bool, limit: float) -> tuple[Array, Array] | None:
    """E and G of one program; `reach` is R^-1 B_s."""
    count, n, m = reach.shape
    by_gain = np.einsum("sik,lj->sijkl", reach, R).reshape(count, n, n, m * n)
    rows = np.concatenate([commutator_rows(P), by_gain], axis=3)
    required = required_entries(n, discrete)
    entries, sums = rows[:, required].reshape(-1, rows.shape[3]), rows.sum(axis=2).reshape(-1, rows.shape[3])
    size = float(np.abs(P).max() / max(float(np.abs(by_gain).max(initial=0.0)), 1e-300))
    most = np.concatenate([np.full(n * n, radius), np.full(m * n, radius * min(size, 1e100))])
    cost = np.zeros(len(most) + 1)
    cost[-1] = -1.0
    answer = solve(
        cost,
        A_ub=np.column_stack([np.concatenate([-entries, sums]), np.ones(len(entries) + len(sums))]),
        b_ub=np.concatenate([P[:, required].ravel(), (discrete - P.sum(axis=2)).ravel()]),
        bounds=(np.append(-most, -1e3), np.append(most, 10.0)),
        time_limit=max(limit, 0.01),
    )
    if not answer:
        return None
    return answer.x[: n * n].reshape(n, n), answer.x[n * n : -1].reshape(m, n)
