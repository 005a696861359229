"""Gains on a simplicial cone: one linear program is necessary and sufficient.

See `inequalities` for the rows.  The smallest gain and the largest decay rate are ratios, found by a
handful of programs (`ratio`).  What is returned here is in doubles and proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import affords, reason
from ...exact.program import Solver
from ..plant import Floats, Plant
from .inequalities import (
    feedback_inequalities,
    gain_from_columns,
    gain_rows,
    split,
)
from .ratio import first_point, minimise_ratio, satisfies, spread_margins
from .refusal import output_rows
from .rows import compact, scaled_rows, solved, spend_on_entries, stacked

# Decay demanded beyond the required one, relative to the size of the plant on the cone; a cone that is nearly
# flat makes that size large, so smaller ones are tried as well.
_STRICT = (1e-6, 1e-9, 1e-12)
# A decay rate this many times the size of the plant counts as "any rate is possible".
_UNBOUNDED = 1e5
# Policy iteration by columns: gains looked at, relative to the sizes of A and B; steps.
_WIDE, _POLICIES = 10.0, 5


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


class SimplicialProgram:
    """The rows of one design in doubles, over xi and those z that may differ from zero.

    Parameters
    ----------
    plant : Plant
        On a simplicial cone.
    free : ndarray of bool, shape (n, m)
        Which F t_k may differ from zero.
    lp : callable
        As `control_kpos.exact.programs.solve`.
    """

    def __init__(self, plant: Plant, free: NDArray[np.bool_], lp: Solver) -> None:
        self.plant, self.lp, self.n, self.m = plant, lp, plant.n, plant.m
        self.strict, self.free = _STRICT[0], free
        n, m = self.n, self.m
        spend_on_entries(2.0 * len(plant.A) * n * n * (1 + m))
        facets = plant.facets / np.einsum("ij,ij->i", plant.facets, plant.rays)[:, None]
        coupled = None
        if plant.coupling is not None:
            coupled = [(A + np.asarray(plant.coupling.values), B) for A, B in plant.pairs]
        q = feedback_inequalities(facets, plant.rays, plant.pairs, discrete=plant.discrete, drift_plants=coupled)
        if plant.ports:
            C, D = (np.asarray(M.values) for M in plant.system.exact.matrices[2:])
            q = q.with_closed(*output_rows(C, D, np.asarray(plant.system.Y.facets), plant.rays))
        self.kept = np.concatenate([np.arange(n), n + np.flatnonzero(free.ravel())])
        self.owner = np.concatenate([np.arange(n), np.repeat(np.arange(n), m)])[self.kept]
        self.closed, self.drift = compact(q.closed[:, self.kept]), compact(q.drift[:, self.kept])
        place = np.arange(len(q.owner)), q.owner
        self.weights = compact(sp.csr_array((q.weight, place), shape=self.drift.shape))

    @cached_property
    def _gains(self) -> tuple[Any, Any, NDArray[np.intp]]:
        slope, level, _ = gain_rows(self.n, self.m, np.ones(self.n), None)
        held = np.flatnonzero(np.tile(self.free.ravel(), 2))
        inputs = np.tile(np.arange(self.m), 2 * self.n)[held]
        return compact(slope[held][:, self.kept]), compact(level[held][:, self.kept]), inputs

    @property
    def slope(self) -> Any:
        """z and -z, entry by entry."""
        return self._gains[0]

    @property
    def level(self) -> Any:
        """xi, row by row of `slope`."""
        return self._gains[1]

    @cached_property
    def bounds(self) -> Any:
        """Rows of the gain bound: must not be positive."""
        bound = self.plant.gain_bound
        if bound is None:
            return np.zeros((0, len(self.kept)))
        return self.slope - scaled_rows(self.level, bound[self._gains[2]])

    def _theta(self, rate: float) -> float:
        return (1.0 if self.plant.discrete else 0.0) - rate - self.strict * self.plant.scale

    def decreasing(self, rate: float) -> Any:
        """Rows that must be negative for the decay rate."""
        return self.drift - self._theta(rate) * self.weights

    def fixed(self, rate: float | None, gain: float | None = None) -> Any:
        """Rows that must not be positive; `rate` None leaves stability out."""
        parts = [-self.closed, self.bounds]
        if rate is not None:
            parts.append(self.decreasing(rate))
        if gain is not None:
            parts.append(self.slope - gain * self.level)
        return stacked(*parts)

    def start(self, rate: float | None) -> Floats | Failure:
        """Any solution, or why there is none.

        Parameters
        ----------
        rate : float or None
            Decay rate; None: invariance and bounds alone.
        """
        failure = Failure("no linear program was tried")
        for self.strict in _STRICT if rate is not None else _STRICT[:1]:
            if not affords():
                return Failure(f"{reason()} was reached", solver=True)
            fixed = self.fixed(rate)
            answer = first_point(fixed, self.slope, self.owner, self.lp)
            if not answer:
                failure = Failure(answer.message or answer.outcome, solver=answer.outcome != "infeasible")
                continue
            x = answer["x"]
            if (x[: self.n] > 0).all() and satisfies(fixed, x):
                return x
            failure = Failure("the solver returned a point that violates the program", solver=True)
        return failure

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

    def smallest_gain(self, rate: float, start: Floats) -> tuple[Floats, float]:
        """Point of smallest max |F t_k| at this rate, and that gain."""
        x, gain = minimise_ratio(self.fixed(rate), self.slope, self.level, self.owner, self.lp, start=start)
        return x, max(gain, 0.0)

    def largest_rate(
        self, start: Floats, gain: float | None = None, *, tolerance: float = 1e-4
    ) -> tuple[Floats, float]:
        """Point of largest decay rate, with |F t_k| <= gain if given; the rate is inf if nothing limits it."""
        stop = -np.inf if self.plant.discrete else -_UNBOUNDED * self.plant.scale
        fixed = self.fixed(None, gain)
        x, theta = minimise_ratio(
            fixed, self.drift, self.weights, self.owner, self.lp, start=start, stop=stop, tolerance=tolerance
        )
        return x, np.inf if theta <= stop else (1.0 if self.plant.discrete else 0.0) - theta

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
        step = max(abs(rate), 0.1 * self.plant.scale)
        while np.isfinite(rate) and step > 1e-4 * max(abs(rate), 1e-3 * self.plant.scale) and affords():
            higher = self.start(rate + step)
            if isinstance(higher, Failure):
                step /= 4
            else:
                x, rate = max((self.largest_rate(higher), (higher, rate + step)), key=lambda pair: pair[1])
        return x, rate

    def centred(self, rate: float, gain: float | None, x: Floats) -> Floats:
        """A point near x with margins wherever they are free."""
        rows = stacked(self.closed, -self.decreasing(rate))
        return spread_margins(self.fixed(rate, gain), rows, x, self.owner, self.lp)

    def read(self, x: Floats) -> tuple[Floats, Floats]:
        """F, and a vector inside X that A + B F maps inwards."""
        full = np.zeros(self.n * (1 + self.m))
        full[self.kept] = x
        xi, G = split(full, self.n, self.m)
        return gain_from_columns(G, self.plant.rays), xi @ self.plant.rays
