"""One cone from the orbits of several vectors and a core, with multipliers in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .core import LARGEST_DENSE, Core
from .orbit import FirstSteps, Flow, Orbit

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Path:
    """From a vector into the core.

    Attributes
    ----------
    points : ndarray, shape (k + 1, n)
        The first steps and the orbit that continues them; the last one is inside the core.
    first : FirstSteps
    orbit : Orbit
    """

    points: Array
    first: FirstSteps
    orbit: Orbit

    @property
    def count(self) -> int:
        """Number of exact steps."""
        return len(self.first.moves)


@dataclass(frozen=True, eq=False)
class Assembly:
    """Generators in the coordinates of a split, with multipliers.

    Attributes
    ----------
    points : ndarray, shape (N, n)
    P : ndarray or csr_array, shape (N, N)
    combinations : ndarray, shape (k, N)
        The vector that each path starts from as a combination of the generators.
    starts : list of int
        Its row; -1 if it lies inside the core.
    exact : ndarray of bool, shape (N,)
        Columns of P that leave no residual.
    support : ndarray of int
        Rows of generators that take up rounding errors.
    """

    points: Array
    P: Any
    combinations: Array
    starts: list[int]
    exact: NDArray[np.bool_]
    support: NDArray[np.intp]


def assemble(f: Flow, paths: list[Path], core: Core) -> Assembly:
    """Generators of all paths and of the core, with multipliers."""
    points = np.concatenate([*(path.points[:-1] for path in paths), core.points])
    count, N = len(points) - len(core.points), len(points)
    large = N > LARGEST_DENSE
    weights = np.concatenate([np.zeros(count), core.weights]) if large else _interior(points, count, core)
    inflow = np.zeros((N - count, count))  # to rows of the core
    diagonal, below = np.zeros(count), np.zeros(count)
    exact = np.zeros(N, dtype=bool)
    combinations = np.zeros((len(paths), N))
    starts, row = [], 0
    for j, path in enumerate(paths):
        steps = len(path.points) - 1
        starts.append(row if steps else -1)
        if steps:
            combinations[j, row] = 1.0
        else:  # inside the core: a part of it is e, in which all generators have a weight
            y = path.points[0].copy()
            part = 0.5 * float(y[0] - core.gauge(y[None])[0])
            y[0] -= part
            combinations[j] = part * weights
            combinations[j, count:] += core.combination(y)
        at = np.arange(row, row + steps)
        head, tail = at[: path.count], at[path.count :]
        exact[head] = True
        diagonal[head], below[head] = path.first.stays, path.first.moves
        if f.discrete:
            below[tail] = f.dominant - f.reduction
        else:
            below[tail] = 1 / path.orbit.steps
            diagonal[tail] = f.dominant - f.reduction - below[tail]
        if steps:
            inflow[:, at[-1]] += below[at[-1]] * core.combination(path.points[-1])
            below[at[-1]] = 0.0
        row += steps
    spread = np.where(exact[:count], 0.0, f.reduction * points[:count, 0])
    support = np.flatnonzero(weights)
    if large:
        inflow += np.outer(core.weights, spread)
        at = np.arange(count)
        places = np.concatenate([at, at[1:]]), np.concatenate([at, at[:-1]])
        chain = sp.coo_array((np.concatenate([diagonal, below[:-1]]), places), shape=(count, count))
        P = sp.block_array([[chain, None], [sp.csr_array(inflow), sp.csr_array(core.P)]], format="csr")
        return Assembly(points, sp.csr_array(P), combinations, starts, exact, support)
    P = np.zeros((N, N))
    P[count:, :count], P[count:, count:] = inflow, core.P
    P[np.arange(count), np.arange(count)] = diagonal
    P[np.arange(1, count), np.arange(count - 1)] += below[:-1]
    P[:, :count] += np.outer(weights, spread)
    # The core's own columns take up a little of e as well.
    free = core.P + np.diag(np.full(len(core.P), 0.0 if f.discrete else np.inf))
    part = 0.5 * float((free.min(axis=0) / core.weights.max()).min())
    if np.isfinite(part):
        P[count:, count:] -= part * core.weights[:, None]
        P[:, count:] += part * weights[:, None]
    return Assembly(points, P, combinations, starts, exact, support)


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
        if core.gauge(rest[None])[0] < 0.5 * rest[0]:
            break
        part /= 2
    return np.concatenate([part / (count * points[:count, 0]), core.combination(rest)])
