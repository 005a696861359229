"""Orbits of rays into a core: the points that an invariant cone through a given vector needs.

    g_0 = b,   g_(k+1) = g_k + h_k (A - lam I) g_k      (discrete time: g_(k+1) = A g_k / lam)

The cone of all g_k and of a core that the orbit ends in is invariant, since A g_k is a combination of
g_k and g_(k+1) (Ohta, Maeda and Kodama, 1984, for h_k of any size).  All of it happens in modal
coordinates (1, y), with the gaps between lam and the other eigenvalues reduced by `slack`: then

    A g_k = (combination of g_k and g_(k+1)) + slack (l'g_k) e,

and e, which is inside the cone, makes every multiplier positive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .core import Core
from .modes import Modes

Array = NDArray[np.float64]

_STEPS = 4500
_TIMES = 500
# Lengths of the first step that are tried side by side, as parts of the longest sensible one.
_FIRST = 1.25 ** -np.arange(42.0)


@dataclass(frozen=True, eq=False)
class Flow:
    """(A - lam I) in modal coordinates (discrete time: A / (lam - slack) on the other modes), gaps reduced.

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


def flow(m: Modes, part: float, *, discrete: bool) -> Flow:
    """The dynamics relative to the dominant mode, with gaps reduced by `part` of the smallest one."""
    n = len(m.right)
    S = np.zeros((n, n))
    start = 1
    for value, V in zip(m.others, m.bases, strict=True):
        at = slice(start, start + V.shape[1])
        S[at, at] = np.array([[value.real, -value.imag], [value.imag, value.real]])[: V.shape[1], : V.shape[1]]
        start += V.shape[1]
    gap = m.dominant - (np.abs(m.others) if discrete else m.others.real)
    slack = part * float(gap.min(initial=1.0))
    if discrete:
        S[1:, 1:] /= m.dominant - slack
        S[0, 0] = 1.0
    else:
        S[1:, 1:] += (slack - m.dominant) * np.eye(n - 1)
    return Flow(S, m.dominant, slack, discrete)


def follow(f: Flow, start: Array, normals: Array, core: Core) -> Orbit | None:
    """The shortest of several orbits from `start` into the core on the right side of all normals.

    Returns
    -------
    Orbit or None
        None if every orbit leaves the half-spaces, or takes too many steps.
    """
    if start[0] <= 0 or not _inside(start[None], normals)[0]:
        return None
    return _powers(f, start, normals, core) if f.discrete else _steps(f, start, normals, core)


def _inside(points: Array, normals: Array) -> NDArray[np.bool_]:
    return (points @ normals.T >= -1e-13 * (np.abs(points) @ np.abs(normals).T)).all(axis=1)


def _powers(f: Flow, start: Array, normals: Array, core: Core) -> Orbit | None:
    points = [start]
    while len(points) <= _STEPS:
        if core.holds(points[-1][None])[0]:
            return Orbit(np.array(points), np.ones(len(points) - 1))
        points.append(f.S @ points[-1])
        if not _inside(points[-1][None], normals)[0]:
            return None
    return None


def _steps(f: Flow, start: Array, normals: Array, core: Core) -> Orbit | None:
    """Orbits with several first step lengths, side by side.

    The margin of a point g is min_t c'e^(tS) g / limit.  Steps of length h bend the orbit outwards by
    about h per unit of time, so h grows with the margin, which is free again once the closest
    approach to the boundary has passed.
    """
    future = _future(f, normals)
    longest = 0.95 / max(float(np.abs(np.linalg.eigvals(f.S)).max()), 1e-300)
    lengths = longest * _FIRST
    states = np.repeat(start[None], len(lengths), axis=0)
    owner = np.arange(len(lengths))
    history, sizes = [states], []
    first = max(float((future @ start).min() / start[0]), 1e-9) if len(future) else 1.0
    for k in range(_STEPS):
        there = core.holds(states)
        if there.any():
            who = int(owner[np.argmax(there)])
            return Orbit(np.array([h[who] for h in history]), np.array([h[who] for h in sizes[:k]]))
        margin = (states @ future.T).min(axis=1, initial=np.inf) / states[:, 0]
        size = np.minimum(longest, lengths[owner] * np.clip(margin / first, 1.0, 1e12) ** 0.75)
        states = states + size[:, None] * (states @ f.S.T)
        alive = _inside(states, normals)
        states, owner, size = states[alive], owner[alive], size[alive]
        if not owner.size:
            return None
        history.append(_scattered(states, owner, len(lengths)))
        sizes.append(_scattered(size, owner, len(lengths)))
    return None


def _scattered(values: Array, owner: NDArray[np.intp], count: int) -> Array:
    out = np.zeros((count, *values.shape[1:]))
    out[owner] = values
    return out


def _future(f: Flow, normals: Array) -> Array:
    """c'e^(tS) for all normals c and a grid of times t, divided by its limit for each c; shape (k, n)."""
    rates, vectors = (np.asarray(a, dtype=np.complex128) for a in np.linalg.eig(f.S))
    gaps = np.sort(-rates.real)[1:]
    horizon = 8.0 / max(float(gaps.min(initial=1.0)), 1e-12)
    fastest = float(np.abs(rates).max(initial=0.0)) or 1.0
    count = int(min(_TIMES, max(60, 12 * horizon * fastest / (2 * np.pi))))
    grid = [[0.0], np.geomspace(0.02 / fastest, max(horizon, 0.1 / fastest), count), np.linspace(0, horizon, count)]
    times = np.unique(np.concatenate(grid))
    modal = np.linalg.solve(vectors, np.eye(len(f.S)))
    parts = [((c @ vectors) * np.exp(np.outer(times, rates)) @ modal).real / c[0] for c in normals]
    return np.concatenate(parts) if parts else np.zeros((0, len(f.S)))


def assemble(f: Flow, orbits: list[Orbit], core: Core) -> tuple[Array, Array, list[int]]:
    """Generators of all orbits and of the core, with multipliers in closed form.

    Returns
    -------
    points : ndarray, shape (N, n)
        Modal coordinates, one a row.
    P : ndarray, shape (N, N)
    starts : list of int
        Row of g_0 of each orbit; -1 if it lies inside the core.
    """
    kept = [orbit.points[:-1] for orbit in orbits]
    points = np.concatenate([*kept, core.points])
    count = len(points) - len(core.points)
    P = np.zeros((len(points), len(points)))
    P[count:, count:] = core.P
    weights = _interior(points, count, core)
    starts, row = [], 0
    for orbit in orbits:
        starts.append(row if len(orbit.points) > 1 else -1)
        for k in range(len(orbit.points) - 1):
            going = f.dominant - f.slack if f.discrete else 1 / orbit.steps[k]
            if not f.discrete:
                P[row, row] += f.dominant - f.slack - going
            if k + 2 < len(orbit.points):
                P[row + 1, row] += going
            else:
                P[count:, row] += going * core.combination(orbit.points[k + 1])
            P[:, row] += f.slack * orbit.points[k, 0] * weights
            row += 1
    # The core's own columns have room for a little of e as well.
    free = core.P + np.diag(np.full(len(core.P), 0.0 if f.discrete else np.inf))
    part = 0.5 * float((free.min(axis=0) / core.weights.max()).min())
    if np.isfinite(part):
        P[count:, count:] -= part * core.weights[:, None]
        P[:, count:] += part * weights[:, None]
    return points, P, starts


def _interior(points: Array, count: int, core: Core) -> Array:
    """e as a combination of all generators with positive coefficients."""
    if not count:
        return core.weights
    mean = (points[:count] / points[:count, :1]).mean(axis=0)
    # e = part * mean + (e - part * mean), the latter well inside the core.
    part = 0.5
    rest = np.zeros_like(mean)
    for _ in range(60):
        rest = -part * mean
        rest[0] += 1.0
        outwards = sum(float((functionals @ rest[at]).max()) for _, at, functionals in core.blocks)
        if outwards < 0.5 * rest[0]:
            break
        part /= 2
    return np.concatenate([part / (count * points[:count, 0]), core.combination(rest)])
