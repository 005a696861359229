"""Dropping generators that a cone does not need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..exact.budget import require_seconds
from ..exact.programs import solve
from ..proof.multipliers import Frame

Array = NDArray[np.float64]


def extreme_generators(
    rays: Array, pointing: Array, keep: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.intp], Array]:
    """Generators that are no combination of the others, with functionals that single them out.

    Parameters
    ----------
    rays : ndarray, shape (N, n)
    pointing : ndarray, shape (n,)
        Positive on every generator.
    keep : ndarray of bool, shape (N,), optional
        Generators that are never dropped, extreme or not.

    Returns
    -------
    index : ndarray of int, shape (p,)
    separators : ndarray, shape (p, n)
        Row i is negative on generator index[i] and positive on the others; zero if none was found.

    Notes
    -----
    One linear program in n variables for each generator, with about 10 n rows.
    """
    frame = Frame.of(rays, pointing)
    if frame is None:
        return np.arange(len(rays)), np.zeros_like(rays)
    points = frame.R.T
    n = points.shape[1]
    left = list(range(len(rays)))
    separators: dict[int, Array] = {}
    order = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1))  # inner ones first
    for i in order.tolist():
        require_seconds()
        is_extreme, separator = _separator(points, i, np.array([j for j in left if j != i], dtype=np.intp))
        if separator is not None:
            separators[i] = frame.to.T @ separator
        if not is_extreme and (keep is None or not keep[i]):
            left.remove(i)
    index = np.array(left)
    return index, np.array([separators.get(i, np.zeros(n)) for i in left])


def _separator(points: Array, i: int, others: NDArray[np.intp]) -> tuple[bool, Array | None]:
    """Whether x_i may be extreme, and g with g'x_i < 0 < g'x_j for the others if one was found.

    It maximises d subject to g'x_j >= d, g'x_i = -d, |g| <= 1.

    Most of the others are far away: the program starts from the nearest ones, and those it forgets join.
    """
    n = points.shape[1]
    near = np.argsort(np.linalg.norm(points[others] - points[i], axis=1))
    active = np.zeros(len(others), dtype=bool)
    active[near[: 10 * n]] = True
    while True:
        count = int(active.sum())
        matrix = np.block([[-points[others[active]], np.ones((count, 1))], [points[[i]], np.ones((1, 1))]])
        answer = solve(
            [0.0] * n + [-1.0],
            A_ub=matrix,
            b_ub=np.zeros(count + 1),
            bounds=(np.full(n + 1, -1.0), np.full(n + 1, 1.0)),
        )
        if not answer:
            return True, None
        if answer.x[-1] <= 1e-9:
            return False, None
        g = answer.x[:-1]
        room = np.where(active, np.inf, points[others] @ g)
        forgotten = np.argsort(room)[: 4 * n]
        forgotten = forgotten[room[forgotten] < 0.5 * answer.x[-1]]
        if not forgotten.size:
            return True, g
        active[forgotten] = True
