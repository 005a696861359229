"""Jacobians at the ends of a box: a derivative that grows in one direction all over a box is least at one end.

Bounds of the second derivatives tell which derivative grows with which quantity.  The function is then called on faces
and corners of the box, where intervals are narrower or points; one face serves all derivatives that agree on it.  A
derivative with a kink inside the box has no bounds there, and nothing is said of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .unreadable import UnboundedError

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]

# Calls of the function at the ends of one box.
FACES = 8
# What a derivative wants of a quantity: its lower end, its upper end, its whole range, or anything.
_LOW, _HIGH, _WHOLE, _ANY = 0, 1, 2, 3


def sharper(
    jacobian: Callable[[Array], Bounds], second: Callable[[Array], tuple[Bounds, Bounds]], box: Array, found: Bounds
) -> Bounds:
    """Bounds of the Jacobian on a box that are at least as good as those found.

    Parameters
    ----------
    jacobian, second : callable
        Bounds on a box of the first derivatives, shape (k, n), and of them and the second ones, shape (k, n, m).
    box : ndarray, shape (m, 2)
    found : pair of ndarray, shape (k, n)
    """
    low, high = found
    if not (low < high).any():
        return found
    try:
        (least, most), bends = second(box)
    except UnboundedError:
        return found
    low, high = np.maximum(low, least), np.minimum(high, most)
    sides = _wanted(*bends, box)
    served = [(low < high) & ((ends == _LOW) | (ends == _HIGH)).any(axis=-1) for ends in sides]
    for face, (least, most) in _faces(sides, served, (low < 0) & (high > 0)):
        ends = np.where(face == _HIGH, box[:, 1], box[:, 0]), np.where(face == _LOW, box[:, 0], box[:, 1])
        ends = ends[0], np.where(face == _ANY, box[:, 0], ends[1])
        try:
            a, b = jacobian(np.column_stack(ends))
        except UnboundedError:
            continue
        low, high = np.where(least, np.maximum(low, a), low), np.where(most, np.minimum(high, b), high)
    return low, high


def _wanted(fall: Array, rise: Array, box: Array) -> tuple[Any, Any]:
    """Where each derivative is least, and where it is largest: for each quantity one of the four."""
    free = (box[:, 0] == box[:, 1]) | ((fall == 0) & (rise == 0))
    cases = [free, fall >= 0, rise <= 0]
    return np.select(cases, [_ANY, _LOW, _HIGH], _WHOLE), np.select(cases, [_ANY, _HIGH, _LOW], _WHOLE)


def _faces(sides: tuple[Any, Any], served: list[Any], doubtful: Any) -> Iterator[tuple[Any, list[Any]]]:
    """What faces want of each quantity, and which least and largest derivatives they serve; those in doubt first."""
    places = [(side, i, j) for side in (0, 1) for i, j in np.argwhere(served[side])]
    waiting = sorted(places, key=lambda place: not doubtful[place[1:]])
    for _ in range(FACES):
        if not waiting:
            return
        face, here = sides[waiting[0][0]][waiting[0][1:]], set()
        for place in waiting:
            wants = sides[place[0]][place[1:]]
            if ((face == wants) | (face == _ANY) | (wants == _ANY)).all():
                face = np.where(face == _ANY, wants, face)
                here.add(place)
        waiting = [place for place in waiting if place not in here]
        masks = [np.zeros_like(mask) for mask in served]
        for side, i, j in here:
            masks[side][i, j] = True
        yield face, masks
