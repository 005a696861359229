"""From the one-shot program on a simplicial cone to a certified gain, a proof that there is none, or neither.

The order: the smallest gain; then, with one per cent more gain, decay rate and margins, so that a rounded F is
safely inside; then proof.  If the program has no solution, Farkas multipliers in exact arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...exact.budget import OutOfBudgetError, affords
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ..accept import Accepted, accept, margins_of, proven_rate, succeed, undecided
from ..controllability import controllability_notes
from ..limits import REACHED, gain_limit, rate_limit
from ..plant import Floats, Plant
from ..refusal import decide
from ..result import LARGEST_RATE, DesignResult, Nearest, changed
from ..running import Programs
from .program import Failure, SimplicialProgram

SMALLEST_GAIN = "smallest gain max |F x_k| at the generators of X (leading entries 1)"
FIRST_GAIN = "nothing; max |F x_k| at the generators of X (leading entries 1)"
# Where the decay rate is to be large, the gain may exceed the smallest one by this much, for margins.
_GAIN_EXTRA = 0.05
# Of the decay rate that this excess allows, the part that is used; and of the largest rate, the parts asked for.
_RATE_PART, RATE_PARTS = 0.8, (0.9993, 0.999, 0.99, 0.9)
UNLIMITED = "no limit of the decay rate was found; give gain_bound, or the rate you need."
_UNPROVEN = (
    "the linear program has no solution that could be proven, and exact arithmetic would take too long, or longer than "
    "the limit leaves."
)
# Refusals are about decay rates this much smaller than the one asked for, so that a boundary stays undecided.
BELOW = 1 - 1e-9


def design_on_simplicial(plant: Plant, rate: Any, lp: Programs) -> DesignResult:
    """The one-shot design; the plant's pattern must follow the blocks of X."""
    trivial = without_feedback(plant, rate)
    if trivial is not None:
        return trivial
    program = SimplicialProgram(plant, lp)
    if rate == "max":
        return _fastest(plant, program, lp)
    target = rate
    start = program.start(target)
    if isinstance(start, Failure):
        return _refuse(plant, target, start, program, lp)
    return _smallest(plant, program, target, start, SMALLEST_GAIN, lp)


def without_feedback(plant: Plant, rate: Any) -> DesignResult | None:
    """The result with gain 0, if that does what is asked."""
    nothing = np.zeros(plant.shape)
    if rate == "max" or not (margins_of(plant, nothing) > -1e-9).all():
        return None
    found = accept(plant, nothing, rate=rate)
    return None if found is None else succeed(plant, found, SMALLEST_GAIN, 0.0, 0.0)


def first_gain(plant: Plant, rate: float, lp: Programs) -> DesignResult:
    """Any certified gain: by columns if that works, by the one-shot program otherwise."""
    program = SimplicialProgram(plant, lp)
    point = program.by_columns(rate)

    def points() -> Iterator[Any]:
        if point is not None:
            yield program.centred(rate, None, point)
            yield point

    found = first_proven(points(), partial(_prove, plant, program, rate))
    if found is None:
        return design_on_simplicial(plant, rate, lp)
    return succeed(plant, found, FIRST_GAIN, found.size)


def _smallest(
    plant: Plant, program: SimplicialProgram, rate: float, start: Any, objective: str, lp: Programs
) -> DesignResult:
    if not affords():
        return exact_design(plant, rate, lp)
    x, infimum = program.smallest_gain(rate, start)
    gap = plant.gap if objective == SMALLEST_GAIN else _GAIN_EXTRA
    allowed = infimum * (1 + gap / 2)
    fast, reachable = program.largest_rate(x, allowed, tolerance=0.25)
    reachable = min(reachable, rate + plant.scale)
    target = rate + _RATE_PART * max(reachable - rate, 0.0)

    def points() -> Iterator[Any]:
        """The first meets the target with room to spare; the others are fallbacks, each closer to the boundary."""
        yield program.centred(target, allowed, fast)
        yield program.centred(rate, allowed, x)
        yield start

    found = first_proven(points(), partial(_prove, plant, program, rate, gain=infimum * (1 + REACHED * gap)))
    if found is None:
        return exact_design(plant, rate, lp, infimum)
    value = found.size if objective == SMALLEST_GAIN else proven_rate(found.certificate, found.rate)
    return succeed(plant, found, objective, value, gain_limit(plant, rate * BELOW, infimum))


def _prove(
    plant: Plant, program: SimplicialProgram, rate: float, point: Floats, gain: float = np.inf
) -> Accepted | None:
    """The gain of a point, proven."""
    F, inside = program.read(point)
    return accept(plant, F, rate=rate, x=inside, gain=gain)


def exact_design(plant: Plant, rate: float, lp: Programs, infimum: float = float("nan")) -> DesignResult:
    """Decide by exact arithmetic: a proof that there is no gain, or a rational one rounded to doubles."""
    lp.stage("deciding in exact arithmetic")
    proof, F = decide(plant, rate * BELOW)
    if proof is not None:
        message = "the demands contradict each other."
        return DesignResult(status=Status.REFUTED, certificate=proof, message=message)
    if F is None:
        return undecided(_UNPROVEN)
    found = accept(plant, F, rate=rate)
    if found is None:
        return undecided(
            "gains in fractions exist up to a billionth of the demands, but none in doubles was proven; relax them."
        )
    limit = gain_limit(plant, rate * BELOW, infimum)
    return succeed(plant, found, SMALLEST_GAIN, found.size, limit)


def _fastest(plant: Plant, program: SimplicialProgram, lp: Programs) -> DesignResult:
    best = program.supremum_of_rates()
    if isinstance(best, Failure):
        return _refuse(plant, 0.0, best, program, lp)
    x, limit = best
    if np.isinf(limit):
        return undecided(UNLIMITED, objective=LARGEST_RATE, limit=limit)
    if limit <= 0:
        return exact_design(plant, 0.0, lp)

    def design(part: float) -> DesignResult:
        again = program.start(limit * part)
        point = x if isinstance(again, Failure) else again
        return _smallest(plant, program, limit * part, point, LARGEST_RATE, lp)

    found = first_proven((part for part in RATE_PARTS if affords()), design)
    return undecided(_UNPROVEN) if found is None else changed(found, limit=rate_limit(plant, limit))


def _refuse(plant: Plant, rate: float, failure: Failure, program: SimplicialProgram, lp: Programs) -> DesignResult:
    with suppress(OutOfBudgetError):
        points, infimum = program.at_the_edge(rate, plant.gap)
        found = first_proven(points, partial(_prove, plant, program, rate))
        if found is not None:
            return succeed(plant, found, SMALLEST_GAIN, found.size, gain_limit(plant, rate * BELOW, infimum))
    result = exact_design(plant, rate, lp)  # also if the solver failed: that must not hide a proof either way
    if result:
        return result
    if failure.solver and result.status is not Status.REFUTED:
        return undecided(f"the solver failed: {failure.reason}.")
    return replace(result, nearest=_nearest(plant, rate, program), notes=controllability_notes(plant))


def _nearest(plant: Plant, rate: float, program: SimplicialProgram) -> Nearest | None:
    slowest = bound = None
    with suppress(OutOfBudgetError):
        if rate > 0:
            best = program.supremum_of_rates()
            if not isinstance(best, Failure):
                limit = best[1]
                slowest = limit if np.isfinite(limit) and limit > 0 else None
        if plant.gain_bound is not None:
            unbounded = SimplicialProgram(replace(plant, gain_bound=None), program.lp)
            start = unbounded.start(rate)
            if not isinstance(start, Failure):
                bound = unbounded.smallest_gain(rate, start)[1]
    return None if slowest is None and bound is None else Nearest(slowest, bound)
