"""Constraints and objectives that the user writes in cvxpy.

They are linear (or convex) in F, so F itself must be the variable.  For a fixed vector v inside X* the conditions
h_i'(A + B F) x_k >= 0 and v'(A + B F) x_k < 0 are linear in F; F and v are improved in turns, as in
`polyhedral.program`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..exact.budget import OutOfBudgetError
from .accept import Accepted, accept, succeed, undecided
from .demands import Demands
from .plant import Floats, Plant
from .polyhedral.program import GainProgram
from .polyhedral.rejection import Better, Rejection, Rows, rejected
from .result import DesignResult
from .running import Programs

USER = "objective given"
_BROKEN = "the gain found breaks the constraints given."
_STARTS, _ROUNDS = 4, 6
_MARGINS = (1e-6, 1e-9, 0.0)


def design_with_constraints(
    plant: Plant,
    rate: float,
    constraints: Callable[[Any], Sequence[Any]] | None,
    objective: Callable[[Any], Any] | None,
    lp: Programs,
) -> DesignResult:
    """The best certified gain found under the user's own constraints.

    Raises
    ------
    DataError
        If the callables do not return what cvxpy can use.
    """
    program = GainProgram(plant, lp.on_highs())
    own = _OwnProgram(program, rate, constraints, objective, lp)
    best: tuple[Accepted, float] | None = None
    hints = _hints(plant, rate, program)
    with suppress(OutOfBudgetError):
        for number, start in enumerate(program.starts(_STARTS, hints)):
            vectors = [start]
            for step in range(_ROUNDS):
                lp.stage(f"vector {number + 1} of {_STARTS + len(hints)}, step {step + 1}")
                found = min(filter(None, map(own.certified, vectors)), key=lambda pair: pair[1], default=None)
                if found is None or (best is not None and found[1] >= best[1] - 1e-6 * max(1.0, abs(best[1]))):
                    break
                best = found
                vectors = list(program.vectors(found[0].F))
    if best is None:
        return undecided(f"no certified gain meets the constraints given; {own.message}.", plant)
    accepted, value = best
    if objective is None:
        value = accepted.size
    name = USER if objective is not None else "gain max |F x_k| under the constraints given"
    return succeed(plant, accepted, name, value)


def reject_with_constraints(
    plant: Plant,
    rate: float,
    constraints: Callable[[Any], Sequence[Any]],
    lp: Programs,
    name: str,
    without: Callable[[], DesignResult],
) -> DesignResult:
    """The gain of smallest L-infinity gain from w to z that is found under the user's own constraints.

    Parameters
    ----------
    without : callable
        The design without these constraints.
    """
    name = f"{name}, under the constraints given"
    stable = design_with_constraints(replace(plant, disturbance=None), rate, constraints, None, lp)
    if not stable:
        return stable
    program = GainProgram(plant, lp.on_highs())
    own, rejection = _OwnProgram(program, rate, constraints, None, lp), Rejection(program, rate)

    def better(rows: Rows, slope: Floats) -> Floats | None:
        own.message = "no step improves it"
        return next(own.gains(rows, slope @ own.entries, rejection.outputs, margins=(0.0,)), None)

    def small(x: Floats, gamma: float) -> Iterator[Floats]:
        yield from filter(own.is_met, own.gains(rejection.kept(x, gamma), own.cost, rejection.outputs))

    gain = np.asarray(stable.F)
    if rejection.point(gain) is None:  # its vertices share no x; those of a gain without the constraints may
        free = without()
        gain = _with_its_point(rejection, free, better) if free else gain
    result = rejected(rejection, gain, name, better, small)
    return result if not result or own.is_met(result.F) else undecided(_BROKEN, plant, objective=name)


def _with_its_point(rejection: Rejection, free: DesignResult, better: Better) -> Floats:
    """A gain that meets the constraints at an x of a gain that need not; that gain itself if none is found."""
    gain = np.asarray(free.F)
    found = rejection.point(gain, 1.0)
    if found is None:
        return gain
    rows = rejection.kept(found[0], 1e3 * abs(found[1]) + 1.0)
    step = better(rows, rejection.slope(gain, found[0]))
    return gain if step is None else step


def _hints(plant: Plant, rate: float, program: GainProgram) -> tuple[Floats, ...]:
    """Lyapunov vectors of gains without the user's constraints."""
    found = program.speed_up(program.facet_sum(), 2 * rate + plant.scale, rate + program.strict)
    return () if found is None else (found.v, *program.vectors(found.gain))


class _OwnProgram(Demands):
    """What the user wrote on a cvxpy variable F, beside invariance and, for a given v, stability."""

    def __init__(self, program: GainProgram, rate: float, constraints: Any, objective: Any, lp: Programs) -> None:
        self.program, self.rate = program, rate
        super().__init__(program.shape, constraints, objective, lp)
        self.entries = self.cp.reshape(self.F, (self.F.size,), order="C")[program.free]
        self.message = "no vector v admits a gain"

    def usual(self) -> Any:
        """The largest input at a generator."""
        return self.cp.max(self.cp.abs(self.F @ (self.program.seen.T / self.program.plant.sizes)))

    def certified(self, v: Floats) -> tuple[Accepted, float] | None:
        """A certified rounding of the best gain for v that meets the user's constraints to 1e-6, and what it costs."""
        S, s, w = self.program.stability(v)
        gain = next(self.gains((S, -(self.rate + self.program.strict) * w - s), self.cost), None)
        found = None if gain is None else accept(self.program.plant, gain, rate=self.rate)
        if found is None or not self.is_met(found.F):
            return None
        value = float(np.asarray(self.cost.value).item())
        return (found, value) if np.isfinite(value) else None

    def gains(
        self, rows: Rows, cost: Any, outputs: Any = None, margins: tuple[float, ...] = _MARGINS
    ) -> Iterator[Floats]:
        """The cheapest gains with S l <= b for rows (S, b), with smaller and smaller margins of positivity.

        The outputs are (P, p) with P l + p >= 0, or None.
        """
        cp, program, F = self.cp, self.program, self.F
        (G, g), bound, (S, b) = program.invariance, program.plant.gain_bound, rows
        always = [S @ self.entries <= b]
        # a bound of 0 is an equality, which leaves an interior point method no interior as two inequalities
        used = np.full(F.shape[0], True) if bound is None else bound > 0
        held = np.union1d(np.setdiff1d(np.arange(F.size), program.free), np.flatnonzero(~np.repeat(used, F.shape[1])))
        if held.size:
            always.append(cp.reshape(F, (F.size,), order="C")[held] == 0)
        for margin in margins:
            asked = [*always, G @ self.entries + g >= margin * program.sizes]
            if outputs is not None:
                size = abs(outputs[0]) @ np.full(outputs[0].shape[1], program.unit) + np.abs(outputs[1])
                asked.append(outputs[0] @ self.entries + outputs[1] >= margin * size)
            if bound is not None and used.any():
                most = bound[used, None] * (1 - margin) * program.plant.sizes
                asked.append(cp.abs(F[used] @ program.seen.T) <= most)
            gain = self.cheapest(cost, asked, (len(g) + len(b), len(program.free)))
            if gain is not None:
                yield np.where(used[:, None], gain, 0.0)
