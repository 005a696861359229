"""Orbits of rays into a core: the points that an invariant cone through a given vector needs.

    g_0 = b,   g_(k+1) = g_k + h_k (A - lam I) g_k      (discrete time: g_(k+1) = A g_k / lam)

The cone of all g_k and of a core that the orbit ends in is invariant, since A g_k is a combination of
g_k and g_(k+1) (Ohta, Maeda and Kodama, 1984, for h_k of any size).  All of it happens in the coordinates
(1, y) of a split, with the gaps between lam and the other eigenvalues reduced by `reduction`: then

    A g_k = (combination of g_k and g_(k+1)) + reduction (l'g_k) e,

and e, which is inside the cone, makes multipliers positive.

Step lengths.  Euler steps h_1, h_2, .. of a total time t lead from g not to e^(tS) g but, to second order, to

    e^(tS) g - (s/2) S^2 e^(tS) g,     s = sum of h_k^2,

so with f(t) = c'e^(tS) g the point stays in c'x >= 0 as long as s <= 2 f(t) / f''(t) wherever f'' > 0.  Steps
of one length h have s = h t: the fewest steps are those of the largest h with h t <= 2 f(t) / f''(t) for all t >= h.

First steps.  If c'b = c'A b = .. = c'A^(r-2) b = 0 < c'A^(r-1) b (relative degree r), every orbit from b starts on
the boundary c'x = 0, and its next points lie there too; rounded, they would leave the half-space.  They are kept
exactly, until c'A g_k > 0:

    g_(k+1) = (A + s_k I) g_k     so that     A g_k = g_(k+1) - s_k g_k     without any residual.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import spend
from ...exact.matrix import Matrix
from .core import Core, Split

Array = NDArray[np.float64]

# More rays than that are of no use, and their multipliers would not fit into memory.
_STEPS = 40_000
# Parts of the step that the bound allows, tried side by side: it is right to second order only.
_PARTS = (1.0, 0.95, 0.9, 0.75, 0.5, 0.25, 0.1)
# Largest steps at all: as parts of the longest sensible one, or of the one that settles oscillations.
_LARGEST = ((1.0, 0.0), (0.0, 1.5), (0.0, 0.75))
# Points stay this far inside the half-spaces, so that rounding does not matter.
_INSIDE = 1e-13
# Operations of one step with one point, besides n^2.
_PER_STEP = 2e4
# Times at which the response is known, in all and for each turn of the fastest mode.
_TIMES, _FOR_EACH_TURN = 6000, 48
_WELL_CONDITIONED = 1e6


@dataclass(frozen=True, eq=False)
class Flow:
    """(A - lam I) in the coordinates of a split (discrete time: A / (lam - reduction) on the others), gaps reduced.

    Attributes
    ----------
    S : ndarray, shape (n, n)
    dominant, reduction : float
    discrete : bool
    """

    S: Array
    dominant: float
    reduction: float
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
    reduction = part * s.gap
    if discrete:
        S[1:, 1:] /= s.dominant - reduction
        S[0, 0] = 1.0
    else:
        S[1:, 1:] += (reduction - s.dominant) * np.eye(n - 1)
    return Flow(S, s.dominant, reduction, discrete)


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
    return _steps(f, start, normals, core, step_bounds(f.S, normals))


def _inside(points: Array, normals: Array) -> NDArray[np.bool_]:
    return np.asarray((points @ normals.T >= _INSIDE * (np.abs(points) @ np.abs(normals).T)).all(axis=1))


def _powers(f: Flow, start: Array, normals: Array, core: Core) -> Orbit | None:
    points = [start]
    while len(points) <= _STEPS:
        spend(_PER_STEP)
        if core.holds(points[-1][None])[0]:
            return Orbit(np.array(points), np.ones(len(points) - 1))
        points.append(f.S @ points[-1])
        if not _inside(points[-1][None], normals)[0]:
            return None
    return None


def _steps(f: Flow, start: Array, normals: Array, core: Core, bounds: StepBounds) -> Orbit | None:
    """Orbits with several parts of the largest steps, side by side; the first to arrive has the fewest."""
    lanes = list(product(_PARTS, _LARGEST))
    part = np.array([p for p, _ in lanes])
    most = np.array([a * bounds.longest + b * min(bounds.settling, bounds.longest) for _, (a, b) in lanes])
    states = np.repeat(start[None], len(lanes), axis=0)
    owner = np.arange(len(lanes))
    history, lengths = [states], []
    size, planned = np.zeros(len(lanes)), 0
    for k in range(_STEPS):
        spend(_PER_STEP + len(states) * states.shape[1] ** 2)
        there = core.holds(states)
        if there.any():
            who = int(owner[np.argmax(there)])
            return Orbit(np.array([h[who] for h in history]), np.array([h[who] for h in lengths]))
        if k >= planned:  # small steps change little
            size[owner] = np.minimum(part[owner] * bounds.steps(states), most[owner])
            planned = k + 1 + k // 20
        states = states + size[owner, None] * (states @ f.S.T)
        alive = _inside(states, normals) & (size[owner] * _STEPS > bounds.longest)
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


@dataclass(frozen=True, eq=False)
class StepBounds:
    """c'e^(tS) and its first two derivatives on a grid of times.

    Attributes
    ----------
    times, widths : ndarray, shape (T,)
        The grid, from 0 on, and the distance to its neighbours.
    responses : ndarray, shape (3, r, T, n)
        c'e^(tS) / c_0, c'S e^(tS) / c_0, c'S^2 e^(tS) / c_0 for the r normals c.
    longest : float
        Steps above this make the fastest mode grow.
    settling : float
        The step that makes the most persistent mode decay fastest; twice that, and it does not decay.
    """

    times: Array
    widths: Array
    responses: Array
    longest: float
    settling: float

    def steps(self, states: Array) -> Array:
        """Largest step from each row of `states`."""
        spend(10.0 * states.shape[0] * self.responses.size)
        allowed = np.full((len(states), len(self.times)), np.inf)
        once = np.full(len(states), np.inf)
        for c in range(self.responses.shape[1]):
            value, slope, bend = (states @ self.responses[k, c].T for k in range(3))
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                # One step g + h S g must leave half of the margin.
                margin = 0.5 * np.maximum(value.min(axis=1, keepdims=True), 0)
                once = np.minimum(once, np.where(slope < 0, (margin - value) / slope, np.inf).min(axis=1))
                # A minimum between two times of the grid is that of a parabola.
                near = (bend > 0) & (np.abs(slope) < bend * self.widths)
                value = np.where(near, value - slope**2 / (2 * bend), value)
                allowed = np.minimum(allowed, np.where(bend > 0, 2 * np.maximum(value, 0) / bend, np.inf))
        least = np.minimum.accumulate((allowed[:, 1:] / self.times[1:])[:, ::-1], axis=1)[:, ::-1]
        crossed = self.times[1:] >= least
        first = least[np.arange(len(states)), crossed.argmax(axis=1)]
        return np.minimum(np.where(crossed.any(axis=1), first, np.inf), once)


def step_bounds(S: Array, normals: Array) -> StepBounds:
    """Responses from any point, and the steps that they allow.

    Parameters
    ----------
    S : ndarray, shape (n, n)
        First coordinate constant, the others decaying.
    normals : ndarray, shape (r, n)
        With a positive first coordinate.
    """
    rates, vectors = (np.asarray(a, dtype=np.complex128) for a in np.linalg.eig(S))
    gaps = np.sort(-rates.real)[1:]
    horizon = 8.0 / max(float(gaps.min(initial=1.0)), 1e-12)
    fastest = float(np.abs(rates).max(initial=0.0)) or 1.0
    count = int(np.clip(_FOR_EACH_TURN * horizon * fastest / (2 * np.pi), 100, _TIMES))
    early = np.geomspace(0.02 / fastest, max(horizon, 0.1 / fastest), count // 4)
    times = np.unique(np.concatenate([early, np.linspace(0, horizon, count)]))
    scaled = normals / normals[:, :1]
    if np.linalg.cond(vectors) < _WELL_CONDITIONED:
        modal = np.linalg.inv(vectors)
        growth = np.exp(np.outer(times, rates))
        flows = np.array([((c @ vectors) * growth @ modal).real for c in scaled])
    else:
        flows = np.einsum("rn,tnm->rtm", scaled, sl.expm(times[:, None, None] * S))
    flows = flows.reshape(len(scaled), len(times), len(S))
    responses = np.array([flows, flows @ S, flows @ S @ S])
    moving = rates[np.abs(rates) > 1e-13 * fastest]
    settling = float((-moving.real / np.abs(moving) ** 2).min(initial=1 / fastest))
    return StepBounds(times, np.gradient(times), responses, 0.95 / fastest, settling)


@dataclass(frozen=True, eq=False)
class FirstSteps:
    """Points on the boundary, known exactly.

    Attributes
    ----------
    points : Matrix, shape (k + 1, n)
        The first one is the vector itself.
    stays, moves : ndarray, shape (k,)
        A g_j = moves_j g_(j+1) + stays_j g_j, exactly.
    """

    points: Matrix
    stays: NDArray[np.float64]
    moves: NDArray[np.float64]


def steps_on_boundary(A: Matrix, vector: Matrix, normals: Matrix) -> int:
    """How many steps from a vector stay on the boundary of some half-space, in exact arithmetic."""
    M, x = A.as_integers()[0], vector.as_integers()[0][0]
    C = normals.rows_as_integers(np.arange(normals.shape[0]))
    still = np.ones(len(C), dtype=bool)
    for k in range(A.shape[0]):
        still &= C @ x == 0 if len(C) else still
        if not still.any():
            return max(k - 1, 0)
        x = M @ x
    return 0  # c'A^k b vanishes for all k: another half-space decides


def first_steps(A: Matrix, vector: Matrix, count: int, length: float, dominant: float, *, discrete: bool) -> FirstSteps:
    """`count` steps of length about `length` (which has no meaning in discrete time)."""
    M, g = A.fractions(), vector.fractions()[0]
    mantissa, exponent = np.frexp(0.0 if discrete else 1 / length - dominant)
    shift = Fraction(float(np.ldexp(np.round(mantissa * 256) / 256, exponent)))  # few digits: exact and short
    points, moves = [g], []
    for _ in range(count):
        moved = M @ points[-1] + shift * points[-1]
        size = float(np.abs(moved.astype(float)).max())
        scale = Fraction(2) ** int(np.frexp(size)[1])
        points.append(moved / scale)
        moves.append(float(scale))
    rows = Matrix.from_fractions(np.array(points, dtype=object))
    return FirstSteps(rows, np.full(count, -float(shift)), np.array(moves))
