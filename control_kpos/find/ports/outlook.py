"""How far an orbit may step: the room that the future leaves between a point and half-spaces.

Euler steps h_1, h_2, .. of a total time t lead from g not to e^(tS) g but, to second order, to

    e^(tS) g - (s/2) S^2 e^(tS) g,     s = sum of h_k^2,

so with f(t) = c'e^(tS) g the point stays in c'x >= 0 as long as s <= 2 f(t) / f''(t) wherever f'' > 0.  Steps
of one length h have s = h t: the fewest steps are those of the largest h with h t <= 2 f(t) / f''(t) for all t >= h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TIMES = 6000
_FOR_EACH_TURN = 48
_WELL_CONDITIONED = 1e6


@dataclass(frozen=True, eq=False)
class Outlook:
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
        room = np.full((len(states), len(self.times)), np.inf)
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
                room = np.minimum(room, np.where(bend > 0, 2 * np.maximum(value, 0) / bend, np.inf))
        least = np.minimum.accumulate((room[:, 1:] / self.times[1:])[:, ::-1], axis=1)[:, ::-1]
        crossed = self.times[1:] >= least
        first = least[np.arange(len(states)), crossed.argmax(axis=1)]
        return np.minimum(np.where(crossed.any(axis=1), first, np.inf), once)


def outlook(S: Array, normals: Array) -> Outlook:
    """The future seen from any point.

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
    return Outlook(times, np.gradient(times), responses, 0.95 / fastest, settling)
