"""Orbits of rays into a core: the points that an invariant cone through a given vector needs.

    g_0 = b,   g_(k+1) = g_k + h_k (A - lam I) g_k      (discrete time: g_(k+1) = A g_k / lam)

The cone of all g_k and of a core that the orbit ends in is invariant, since A g_k is a combination of
g_k and g_(k+1) (Ohta, Maeda and Kodama, 1984, for h_k of any size).  All of it happens in the coordinates
(1, y) of a split, with the gaps between lam and the other eigenvalues reduced by `slack`: then

    A g_k = (combination of g_k and g_(k+1)) + slack (l'g_k) e,

and e, which is inside the cone, makes multipliers positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import require_seconds
from ..one_matrix.split import Split
from .core import Core
from .outlook import Outlook, outlook

Array = NDArray[np.float64]

# More rays than that are of no use, and their multipliers would not fit into memory.
_STEPS = 40_000
# Parts of the step that the outlook allows, tried side by side: it is right to second order only.
_PARTS = (1.0, 0.95, 0.9, 0.75, 0.5, 0.25, 0.1)
# Largest steps at all: as parts of the longest sensible one, or of the one that settles oscillations.
_LARGEST = ((1.0, 0.0), (0.0, 1.5), (0.0, 0.75))
# Points stay this far inside the half-spaces, so that rounding does not matter.
_INSIDE = 1e-13


@dataclass(frozen=True, eq=False)
class Flow:
    """(A - lam I) in the coordinates of a split (discrete time: A / (lam - slack) on the others), gaps reduced.

    Attributes
    ----------
    S : ndarray, shape (n, n)
    dominant, slack : float
    discrete : bool
    """

    S: Array
    dominant: float
    slack: float
    discrete: bool


@dataclass(frozen=True, eq=False)
class Orbit:
    """Points on the way into the core, and how far each step went.

    Attributes
    ----------
    points : ndarray, shape (k + 1, n)
        The last one is inside the core.
    steps : ndarray, shape (k,)
        h_k; not used in discrete time.
    """

    points: Array
    steps: Array


def flow(s: Split, part: float, *, discrete: bool) -> Flow:
    """The dynamics relative to the dominant direction, with gaps reduced by `part` of the smallest one."""
    n = len(s.right)
    S = np.zeros((n, n))
    S[1:, 1:] = s.S
    slack = part * s.gap
    if discrete:
        S[1:, 1:] /= s.dominant - slack
        S[0, 0] = 1.0
    else:
        S[1:, 1:] += (slack - s.dominant) * np.eye(n - 1)
    return Flow(S, s.dominant, slack, discrete)


def follow(f: Flow, start: Array, normals: Array, core: Core) -> Orbit | None:
    """The shortest of several orbits from `start` into the core on the right side of all normals.

    Returns
    -------
    Orbit or None
        None if every orbit leaves the half-spaces, or takes too many steps.
    """
    if start[0] <= 0:
        return None
    if f.discrete:
        return _powers(f, start, normals, core)
    return _steps(f, start, normals, core, outlook(f.S, normals))


def _inside(points: Array, normals: Array) -> NDArray[np.bool_]:
    return np.asarray((points @ normals.T >= _INSIDE * (np.abs(points) @ np.abs(normals).T)).all(axis=1))


def _powers(f: Flow, start: Array, normals: Array, core: Core) -> Orbit | None:
    points = [start]
    while len(points) <= _STEPS:
        require_seconds()
        if core.holds(points[-1][None])[0]:
            return Orbit(np.array(points), np.ones(len(points) - 1))
        points.append(f.S @ points[-1])
        if not _inside(points[-1][None], normals)[0]:
            return None
    return None


def _steps(f: Flow, start: Array, normals: Array, core: Core, ahead: Outlook) -> Orbit | None:
    """Orbits with several parts of the largest steps, side by side; the first to arrive has the fewest."""
    lanes = list(product(_PARTS, _LARGEST))
    part = np.array([p for p, _ in lanes])
    most = np.array([a * ahead.longest + b * min(ahead.settling, ahead.longest) for _, (a, b) in lanes])
    states = np.repeat(start[None], len(lanes), axis=0)
    owner = np.arange(len(lanes))
    history, lengths = [states], []
    size, planned = np.zeros(len(lanes)), 0
    for k in range(_STEPS):
        require_seconds()
        there = core.holds(states)
        if there.any():
            who = int(owner[np.argmax(there)])
            return Orbit(np.array([h[who] for h in history]), np.array([h[who] for h in lengths]))
        if k >= planned:  # small steps change little
            size[owner] = np.minimum(part[owner] * ahead.steps(states), most[owner])
            planned = k + 1 + k // 20
        states = states + size[owner, None] * (states @ f.S.T)
        alive = _inside(states, normals) & (size[owner] * _STEPS > ahead.longest)
        states, owner = states[alive], owner[alive]
        if not owner.size:
            return None
        history.append(_scattered(states, owner, len(lanes)))
        lengths.append(size.copy())
    return None


def _scattered(values: Array, owner: NDArray[np.intp], count: int) -> Array:
    out = np.zeros((count, *values.shape[1:]))
    out[owner] = values
    return out
