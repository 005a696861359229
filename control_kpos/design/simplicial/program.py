"""Gains on a simplicial cone: one linear program is necessary and sufficient, see `inequalities` for its rows.

The smallest gain and the largest decay rate are ratios, found by fractional programming over x = (xi, z), xi > 0:

    minimise theta   subject to   fixed x <= 0,   N x <= theta D x,   D x > 0,

where D picks positive multiples of entries of xi.  For fixed theta it is a linear program; Dinkelbach's iteration, with
the denominators of the last point as weights (Crouzeix, Ferland and Schaible 1985), needs a handful of
them where bisection needs dozens, and every iterate is feasible.  Rows are dense or sparse.  What is returned is in
doubles and proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import DataError
from ...exact.budget import affords, spend
from ...exact.program import SMALL, Block, Program, Solver
from ...exact.programs import Solution
from ...theorems.decay_rates import Rate
from ..plant import Floats, Plant
from .inequalities import feedback_inequalities, gain_from_columns, output_rows, solved, split

# Decay demanded beyond the required one, relative to the size of the plant on the cone; a cone that is nearly
# flat makes that size large, so smaller ones are tried as well.
_STRICT = (1e-6, 1e-9, 1e-12)
# Relative to the rate, the last step of the search for the largest one.
_STEP = 2e-5
# Gains that differ by less are the same for what is sought near them.
_SAME = 1e-4
# A decay rate this many times the size of the plant counts as "any rate is possible".
_UNBOUNDED = 1e5
# How far one step may shrink an entry of xi, and how far all steps may.
# Where the infimum is only reached as an entry of xi vanishes, the gain would lose all its margins.
_SHRINK, _FLOOR = 1e-3, 1e-5
_STEPS = 40
# Policy iteration by columns: gains looked at, relative to the sizes of A and B; steps.
_WIDE, _POLICIES = 10.0, 5
# Operations that it takes to assemble and to scale a program, for each entry that is not zero, in all its copies.
_EFFORT = 150.0
# Entries of a program beyond which memory ends before patience does.
_MOST_ENTRIES = 10**8


@dataclass(frozen=True)
class Failure:
    """Why a program has no answer.

    Attributes
    ----------
    reason : str
    solver : bool
        True if the solver failed; False if it calls the program infeasible.
    """

    reason: str
    solver: bool = False


class RatioProgram:
    """Rows over x, of which a design knows all that it asks of gain and decay rate.

    Attributes
    ----------
    closed : ndarray or csr_array
        closed x >= 0.
    bounds : ndarray or csr_array
        bounds x <= 0.
    drift, weights : ndarray or csr_array
        drift x < theta weights x, with theta = -rate (continuous) or 1 - rate (discrete).
    slope, level : ndarray or csr_array
        slope x <= gain level x.
    owner : ndarray of int, shape (v,)
        The xi that each variable is proportional to; the first ones are the xi themselves.
    scale : float
        Size of the plant.
    """

    closed: Any
    bounds: Any
    drift: Any
    weights: Any
    slope: Any
    level: Any
    owner: NDArray[np.intp]
    scale: float
    # relative decrease at which iterations stop
    tolerance = 1e-4

    def __init__(self, lp: Solver, discrete: bool) -> None:
        self.lp, self.still, self.strict = lp, 1.0 if discrete else 0.0, _STRICT[0]

    @property
    def count(self) -> int:
        """Number of the xi."""
        return int(self.owner.max()) + 1

    def decreasing(self, rate: Rate) -> Any:
        """Rows that must be negative for the decay rate."""
        return self.drift - (self.still - rate - self.strict * self.scale) * self.weights

    def fixed(self, rate: Rate | None, gain: float | None = None) -> Any:
        """Rows that must not be positive; `rate` None leaves stability out."""
        parts = [-self.closed, self.bounds]
        if rate is not None:
            parts.append(self.decreasing(rate))
        if gain is not None:
            parts.append(self.slope - gain * self.level)
        return stacked(*parts)

    def start(self, rate: Rate | None, gain: float | None = None) -> Floats | Failure:
        """Any solution, or why there is none.

        Parameters
        ----------
        rate : float, Fraction or None
            Decay rate; None: invariance and bounds alone.
        gain : float or None
            Bound on the gain.
        """
        failure = Failure("no linear program was tried")
        for self.strict in _STRICT if rate is not None else _STRICT[:1]:
            fixed = self.fixed(rate, gain)
            answer = self._first(fixed)
            if answer.outcome != "optimal":
                failure = Failure(answer.message or answer.outcome, solver=answer.outcome != "infeasible")
                continue
            x = answer.x[: len(self.owner)]
            if (x[self.owner] > 0).all() and satisfies(fixed, x):
                return x
            failure = Failure("the solver returned a point that violates the program", solver=True)
        return failure

    def _first(self, fixed: Any) -> Solution:
        """Some x with fixed x <= 0, xi >= 1 and max slope x small."""
        # no upper bound on xi: the solver's tolerance is relative to the largest one
        program = Program(x=self._over(1.0, np.inf), largest=Block(1, low=0.0, cost=1.0))
        rows = stacked(fixed, self.slope)
        program.below(0.0, x=rows, largest=-(np.arange(rows.shape[0]) >= fixed.shape[0]).astype(float))
        return program.solve(self.lp)

    def smallest_gain(self, rate: Rate, start: Floats) -> tuple[Floats, float]:
        """Point of smallest gain at this rate, and that gain."""
        x, gain = self._minimised(self.fixed(rate), self.slope, self.level, start)
        return x, max(gain, 0.0)

    def largest_rate(
        self, start: Floats, gain: float | None = None, tolerance: float | None = None
    ) -> tuple[Floats, float]:
        """Point of largest decay rate, within the gain if one is given; the rate is inf if nothing limits it."""
        stop = self.still - _UNBOUNDED * self.scale
        x, theta = self._minimised(self.fixed(None, gain), self.drift, self.weights, start, stop, tolerance)
        return x, np.inf if theta <= stop else self.still - theta

    def supremum_of_rates(self) -> tuple[Floats, float] | Failure:
        """Point of largest decay rate over all gains, and that rate (inf if nothing limits it).

        Near the supremum entries of xi may have to vanish, where `largest_rate` can stall; programs at higher
        rates find another start, or show that there is none.
        """
        start = self.start(0.0)
        if isinstance(start, Failure):
            start = self.start(None)
        if isinstance(start, Failure):
            return start
        x, rate = self.largest_rate(start)
        step = max(abs(rate), 0.1 * self.scale)
        while np.isfinite(rate) and step > _STEP * max(abs(rate), 1e-3 * self.scale) and affords():
            higher = self.start(rate + step)
            if isinstance(higher, Failure):
                step /= 4
            else:
                x, rate = max((self.largest_rate(higher), (higher, rate + step)), key=lambda pair: pair[1])
        return x, rate

    def centred(self, rate: Rate, gain: float | None, x: Floats, *, inside: bool = True) -> Floats:
        """A point near x where every row that can be positive is so; x itself if there is none within reach.

        Rows of invariance count only if the point is to be `inside`.
        """
        rows, scale = -self.decreasing(rate), x[self.owner]
        rows = stacked(self.closed, rows) if inside else rows
        size = abs(rows) @ np.abs(x)
        program = Program(x=self._over(0.5, 2.0))
        program.below(0.0, x=scaled(self.fixed(rate, gain), scale))
        relative = scaled_rows(scaled(rows, scale), 1 / np.where(size > 0, size, 1.0))
        program.spread(0.0, np.ones(rows.shape[0]), x=relative)
        answer = program.solve(self.lp)
        return answer["x"] * scale if answer else x

    def at_the_edge(self, rate: Rate, extra: float | None) -> tuple[list[Floats], float]:
        """Points for a decay rate that no gain exceeds, made for one a little lower, and the smallest gain.

        The first decays as fast as it can: where it can, faster than at the rate.

        Parameters
        ----------
        rate : float or Fraction
        extra : float or None
            Part by which gains may exceed the smallest one; None: that is not asked for.
        """
        lower, smallest = max(float(rate) - 2 * _STRICT[0] * self.scale, 0.0), float("nan")
        start = self.start(lower) if rate else Failure("any decay will do")
        if isinstance(start, Failure):
            return [], smallest
        points, most = [start], None
        if extra is not None:
            slim, smallest = self.smallest_gain(lower, start)
            points, most = [slim, start], smallest * (1 + extra)
        return [self.centred(lower, most, points[0], inside=False), *points], smallest

    def _minimised(
        self, fixed: Any, N: Any, D: Any, x: Floats, stop: float = -np.inf, tolerance: float | None = None
    ) -> tuple[Floats, float]:
        """Decrease theta = max N x / D x from a feasible point until no linear program improves it.

        Parameters
        ----------
        fixed, N, D : ndarray or csr_array, shapes (R, v), (Q, v), (Q, v)
            Rows of fixed x <= 0 and N x <= theta D x.
        x : ndarray, shape (v,)
            Feasible, xi > 0.
        stop : float
            Value below which theta counts as unbounded.
        tolerance : float, optional
            Relative decrease at which to stop.

        Returns
        -------
        x : ndarray, shape (v,)
        theta : float
            -inf if the solver finds that nothing limits it.
        """
        n, theta = self.count, float(np.max((N @ x) / (D @ x), initial=-np.inf))
        floor = _FLOOR * x[:n] / x[:n].max()
        for _ in range(_STEPS):
            if not theta > stop:
                break
            x = x / x[:n].max()
            scale = x[self.owner]
            program = Program(x=self._over(np.clip(floor / x[:n], _SHRINK, 1.0), 1.0), decrease=Block(1, cost=1.0))
            rows = scaled(stacked(fixed, N - theta * D), scale)
            program.below(0.0, x=rows, decrease=np.concatenate([np.zeros(fixed.shape[0]), -(D @ x)]))
            answer = program.solve(self.lp)
            if answer.outcome in ("unbounded", "infeasible"):  # x itself is feasible
                return x, -np.inf
            if answer.outcome != "optimal":
                break
            candidate = answer.x[:-1] * scale
            value = float(np.max((N @ candidate) / (D @ candidate), initial=-np.inf))
            if not value < theta or not (candidate[:n] > 0).all() or not satisfies(fixed, candidate):
                break
            small = (tolerance or self.tolerance) * max(abs(theta), abs(value))
            finished = theta - value <= small and -answer.x[-1] <= small
            x, theta = candidate, value
            if finished:
                break
        return x, theta

    def _over(self, low: Any, high: Any) -> Block:
        """The variables x = (xi, z) with bounds on xi."""
        n, size = self.count, len(self.owner)
        ends = [np.full(size, -np.inf), np.full(size, np.inf)]
        ends[0][:n], ends[1][:n] = low, high
        return Block(size, *ends)


class SimplicialProgram(RatioProgram):
    """The rows of one design in doubles, over xi and those z that may differ from zero.

    Parameters
    ----------
    plant : Plant
        On a simplicial cone.
    lp : callable
        As `control_kpos.exact.programs.solve`.

    Raises
    ------
    DataError
        The pattern of the gain does not follow the blocks of X.
    """

    def __init__(self, plant: Plant, lp: Solver) -> None:
        super().__init__(lp, plant.discrete)
        n, m, free = plant.n, plant.m, plant.free
        if free is None:
            raise DataError(
                'structure does not follow the blocks of X; state_feedback has method="alternation" for it.'
            )
        self.plant, self.n, self.m, self.scale = plant, n, m, plant.scale
        self.tolerance = min(self.tolerance, plant.gap / 8)
        spend_on_entries(2.0 * len(plant.vertices) * n * n * (1 + m))
        facets = plant.facets / np.einsum("ij,ij->i", plant.facets, plant.rays)[:, None]
        coupled = None
        if plant.coupling is not None:
            coupled = [(A + np.asarray(plant.coupling.values), B) for A, B in plant.pairs]
        q = feedback_inequalities(facets, plant.rays, plant.pairs, discrete=plant.discrete, drift_plants=coupled)
        if plant.ports:
            C, D = (np.asarray(M.values) for M in plant.system.matrices[2:])
            q = q.with_closed(*output_rows(C, D, np.asarray(plant.system.Y.facets), plant.rays))
        self.kept = np.concatenate([np.arange(n), n + np.flatnonzero(free.ravel())])
        self.owner = np.concatenate([np.arange(n), np.repeat(np.arange(n), m)])[self.kept]
        self.closed, self.drift = compact(q.closed[:, self.kept]), compact(q.drift[:, self.kept])
        place = np.arange(len(q.owner)), q.owner
        self.weights = compact(sp.csr_array((q.weight, place), shape=self.drift.shape))
        z, place = np.arange(n, len(self.kept)), np.arange(len(self.kept) - n)
        entries, shape = np.ones(len(z)), (len(z), len(self.kept))
        half = compact(sp.csr_array((entries, (place, z)), shape=shape))
        owned = compact(sp.csr_array((plant.sizes[self.owner[z]], (place, self.owner[z])), shape=shape))
        self.slope, self.level = stacked(half, -half), stacked(owned, owned)
        self.bounds = np.zeros((0, len(self.kept)))
        if plant.gain_bound is not None:
            limits = np.tile(plant.gain_bound, 2 * n)[np.flatnonzero(np.tile(free.ravel(), 2))]
            self.bounds = self.slope - scaled_rows(self.level, limits)

    def smallest_gain(self, rate: Rate, start: Floats) -> tuple[Floats, float]:
        """See `RatioProgram`; then once more with hardly any decrease beyond the rate: gains may be small beside A."""
        x, gain = super().smallest_gain(rate, start)
        used, self.strict = self.strict, min(self.strict, _STRICT[1])
        finer, less = super().smallest_gain(rate, x) if gain > 0 and self.strict < used else (x, gain)
        self.strict = used
        return (x, less) if gain <= less * (1 + _SAME) else (finer, less)

    def by_columns(self, rate: float) -> Floats | None:
        """A solution by policy iteration, or None: quick where it works, complete nowhere.

        For a fixed vector v the columns F t_k are independent: one block-diagonal program minimises
        v'(A + B F)t_k under invariance.  Then v becomes the left Perron vector of the closed loop.
        """
        n, free = self.n, self.owner[self.n :]
        if self.drift.shape[0] != n or not free.size:
            return None
        box = _WIDE * abs(self.drift[:, :n]).max() / max(abs(self.drift[:, n:]).max(), 1e-300)
        shift = (1.0 if self.plant.discrete else 0.0) - rate
        rows = stacked(-self.closed[:, n:], self.bounds[:, n:])
        limits = np.concatenate([self.closed[:, :n].sum(axis=1), -self.bounds[:, :n].sum(axis=1)])
        v = np.ones(n)
        for _ in range(_POLICIES):
            answer = self.lp(v @ self.drift[:, n:], rows, limits, bounds=(-box, box), presolve=False)
            if not answer:
                return None
            z = sp.csr_array((answer.x, (np.arange(len(free)), free)), shape=(len(free), n))
            M = self.drift[:, :n] + self.drift[:, n:] @ z - shift * np.eye(n)
            xi = -solved(M, np.ones(n))
            if (xi > 0).all():  # M is Metzler up to rounding, so this says that it is stable
                return np.asarray(np.concatenate([xi, answer.x * xi[free]]), dtype=float)
            rightmost = np.linalg.eigvals(M).real.max()
            v = -solved((M - 1.1 * max(rightmost, 0.0) * np.eye(n)).T, np.ones(n))
            if not (np.isfinite(v).all() and (v > 0).all()):
                return None
            v = v / v.max()
        return None

    def read(self, x: Floats) -> tuple[Floats, Floats]:
        """F, and a vector inside X that A + B F maps inwards."""
        full = np.zeros(self.n * (1 + self.m))
        full[self.kept] = x
        xi, G = split(full, self.n, self.m)
        return gain_from_columns(G, self.plant.rays), xi @ self.plant.rays


def satisfies(fixed: Any, x: Floats) -> bool:
    """True if fixed x <= 0 up to rounding, relative to the size of each row at x."""
    return bool((fixed @ x <= 1e-7 * (abs(fixed) @ np.abs(x))).all())


# -- rows: dense while they are small, sparse where most entries are zero and there are many


def spend_on_entries(entries: float) -> None:
    """Count the operations that it takes to set up a program with so many entries that are not zero.

    Raises
    ------
    OutOfBudgetError
        If they are not left, or memory would not hold it.
    """
    spend(entries * _EFFORT if entries <= _MOST_ENTRIES else np.inf)


def compact(rows: Any) -> Any:
    """Small sparse matrices as dense ones."""
    return rows.toarray() if sp.issparse(rows) and rows.shape[0] * rows.shape[1] <= SMALL else rows


def scaled(M: Any, scale: Floats) -> Any:
    """M with its columns multiplied."""
    return M @ sp.diags_array(scale, format="csr") if sp.issparse(M) else M * scale


def scaled_rows(M: Any, scale: Floats) -> Any:
    """M with its rows multiplied."""
    return sp.diags_array(scale, format="csr") @ M if sp.issparse(M) else M * scale[:, None]


def stacked(*parts: Any) -> Any:
    """One below the other."""
    if any(sp.issparse(part) for part in parts):
        return sp.csr_array(sp.vstack([sp.csr_array(part) for part in parts], format="csr"))
    return np.concatenate(parts)
