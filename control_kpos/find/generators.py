"""Extreme generators: how to find them.

A generator x_i is extreme if some g has g'x_i < 0 < g'x_j for all other generators x_j.  That needs no facets, which
in high dimensions are too many to list.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..cones.extreme import SEPARATES, separator
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
        g, margin = separator(points, i, np.array([j for j in left if j != i], dtype=np.intp))
        if margin > SEPARATES:
            separators[i] = frame.to.T @ g
        elif keep is None or not keep[i]:
            left.remove(i)
    index = np.array(left)
    return index, np.array([separators.get(i, np.zeros(n)) for i in left])
