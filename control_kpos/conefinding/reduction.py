"""Dropping generators that a cone does not need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import ExactMatrix
from ..linear_programs import solve
from .multipliers import Frame

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
    One linear program of N rows in n variables for each generator.
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
        others = np.array([j for j in left if j != i])
        # max d subject to g'x_j >= d for the others, g'x_i = -d, |g| <= 1
        matrix = np.block([[-points[others], np.ones((len(others), 1))], [points[[i]], np.ones((1, 1))]])
        answer = solve(
            [0.0] * n + [-1.0],
            A_ub=matrix,
            b_ub=np.zeros(len(others) + 1),
            bounds=(np.full(n + 1, -1.0), np.full(n + 1, 1.0)),
        )
        if answer and answer.x[-1] > 1e-9:
            separators[i] = frame.to.T @ answer.x[:-1]
        elif keep is None or not keep[i]:
            left.remove(i)
    index = np.array(left)
    return index, np.array([separators.get(i, np.zeros(n)) for i in left])


def select(rays: ExactMatrix, index: NDArray[np.intp]) -> ExactMatrix:
    """Some rows of exact data."""
    return ExactMatrix(
        np.asarray(rays.values)[index],
        None if rays.radius is None else rays.radius[index],
        None if rays.numerators is None else rays.numerators[index],
        rays.denominator,
    )
