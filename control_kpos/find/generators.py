"""Extreme generators: how to find them.

A generator x_i is extreme if some g has g'x_i < 0 < g'x_j for all other generators x_j.  That needs no facets, which
in high dimensions are too many to list.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..exact.budget import spend
from ..exact.program import widest
from ..exact.programs import program_effort
from ..proof.proposed_weights import Frame

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
        is_extreme, separator = _separator(points, i, np.array([j for j in left if j != i], dtype=np.intp))
        if separator is not None:
            separators[i] = frame.to.T @ separator
        if not is_extreme and (keep is None or not keep[i]):
            left.remove(i)
    index = np.array(left)
    return index, np.array([separators.get(i, np.zeros(n)) for i in left])


def _separator(points: Array, i: int, others: NDArray[np.intp]) -> tuple[bool, Array | None]:
    """Whether x_i may be extreme, and g with g'x_i < 0 < g'x_j for the others if one was found.

    Most of the others are far away: the program starts from the nearest ones, and those it forgets join.
    """
    n = points.shape[1]
    near = np.argsort(np.linalg.norm(points[others] - points[i], axis=1))
    active = np.zeros(len(others), dtype=bool)
    active[near[: 10 * n]] = True
    while True:
        spend(program_effort(int(active.sum()) + 1, n + 1))
        g, margin = widest(np.concatenate([points[others[active]], -points[[i]]]))
        if margin <= 1e-9:
            return False, None
        height = np.where(active, np.inf, points[others] @ g)
        forgotten = np.argsort(height)[: 4 * n]
        forgotten = forgotten[height[forgotten] < 0.5 * margin]
        if not forgotten.size:
            return True, g
        active[forgotten] = True
