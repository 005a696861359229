"""From the alternation on any polyhedral cone (`program`) to a certified gain.

Finds gains of any linear shape: all of F, a pattern of F, or u = K y.  The answer is UNDECIDED if none is found, and
REFUTED only if no gain makes the cone invariant: h_i'(A + B F) x_k >= 0 is linear in the gain and decided exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...cards import floored
from ...exact.budget import OutOfBudgetError, affords, reason
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ..accept import Accepted, accept, succeed, undecided
from ..controllability import controllability_notes
from ..plant import Floats, Plant
from ..refusal import no_invariance
from ..result import LARGEST_RATE, DesignResult, Nearest, changed
from ..running import Programs
from ..simplicial.search import (
    RATE_PARTS,
    SMALLEST_GAIN,
    UNLIMITED,
    exact_design,
    without_feedback,
)
from .program import GainProgram, Iterate

FIRST_FOUND = "sum of h_i'(A + B F)x_k, in the first step; max |F x_k| at the generators of X (leading entries 1)"
# Bound on |F x_k| in the two-step method if none is given, relative to the sizes of A and B.
_BOX = 20.0
# Starting vectors for any gain, and for the largest rate, which is a local optimum.
_STARTS, _MANY_STARTS = 6, 12


def design_by_alternation(plant: Plant, rate: Any, lp: Programs) -> DesignResult:
    """Alternate from several vectors inside X*; the rate is a number or "max"."""
    trivial = without_feedback(plant, rate)
    if trivial is not None:
        return trivial
    program = GainProgram(plant, lp)
    if program.any_invariant() is False:
        proof = no_invariance(plant)
        if proof is not None:
            notes, message = controllability_notes(plant), "invariance alone is impossible."
            return DesignResult(status=Status.REFUTED, certificate=proof, message=message, notes=notes)
    if rate == "max":
        return _fastest(plant, program, lp)
    found, fastest = _any_rate(plant, program, lp, rate)
    return _given_up(plant, rate, fastest, lp) if found is None else found


def by_common_v(plant: Plant, rate: Any, lp: Programs) -> DesignResult | None:
    """A gain with one v inside X* for all vertices, where there is none with one x inside X; None if none is found."""
    if rate == "max" or not affords():
        return None
    return _any_rate(plant, GainProgram(plant, lp), lp, rate)[0]


def _any_rate(
    plant: Plant, program: GainProgram, lp: Programs, rate: float, *hints: Floats
) -> tuple[DesignResult | None, float]:
    """The smallest gain found, or None; and the fastest decay rate found."""
    goal = rate + program.strict
    ceiling = 2 * rate + plant.scale
    best: tuple[Accepted, float] | None = None
    fastest = -np.inf
    with suppress(OutOfBudgetError):
        for number, v in enumerate(program.starts(_STARTS, hints)):
            lp.stage(f"vector {number + 1} of {_STARTS + len(hints)}")
            found = program.speed_up(v, ceiling, goal)
            if found is None:
                continue
            fastest = max(fastest, found.rate)
            level = goal if found.rate > goal else rate - program.strict  # for a rate that no gain exceeds
            if found.rate <= level:
                continue
            accepted = first_proven(
                _candidates(program, found, rate, level),
                partial(accept, plant, rate=rate),
            )
            if accepted is not None:
                size = accepted.size
                if best is None or size < best[1]:
                    best = accepted, size
            if best is not None and number >= 1 + len(hints):
                break
    return None if best is None else succeed(plant, best[0], SMALLEST_GAIN, best[1]), fastest


def _given_up(plant: Plant, rate: float, fastest: float, lp: Programs) -> DesignResult:
    """What is said where no gain was found: a proof that there is none, on a simplicial cone, or UNDECIDED."""
    proof = _unstructured_refutation(plant, rate, lp)
    if proof is not None:
        return proof
    nearest = Nearest(decay_rate=float(fastest)) if rate > 0 and 0 < fastest < np.inf else None
    reached = (
        "no invariant gain was found" if fastest == -np.inf else f"the fastest decay rate found is {floored(fastest)}"
    )
    ended = "the alternation gave up" if affords() else f"{reason()} ended the alternation"
    return undecided(f"{ended}; {reached}.", plant, nearest=nearest)


def _unstructured_refutation(plant: Plant, rate: float, lp: Programs) -> DesignResult | None:
    """On a simplicial cone: a proof that not even an unrestricted F = (all of F, all states) does it."""
    if not plant.X.is_simplicial:
        return None
    result = exact_design(replace(plant, pattern=None, reads=None), rate, lp)
    return None if result.status is not Status.REFUTED else replace(result, notes=controllability_notes(plant))


def _candidates(program: GainProgram, found: Iterate, rate: float, goal: float) -> Iterator[Floats]:
    slim, size = program.slim(found, goal)
    allowed = size * (1 + program.plant.gap)
    fast = program.speed_up(slim.v, 2 * rate + program.plant.scale, most=allowed)
    fast = fast or slim
    centred = program.centred(fast.v, rate + 0.9 * max(fast.rate - rate, goal - rate), allowed)
    yield from (gain for gain in (centred, fast.gain, slim.gain, found.gain) if gain is not None)


def _fastest(plant: Plant, program: GainProgram, lp: Programs) -> DesignResult:
    ceiling = 1e5 * plant.scale
    best: Iterate | None = None
    with suppress(OutOfBudgetError):
        for number, v in enumerate(program.starts(_MANY_STARTS)):
            lp.stage(f"vector {number + 1} of {_MANY_STARTS}")
            found = program.speed_up(v, ceiling)
            if found is not None and (best is None or found.rate > best.rate):
                best = found
    if best is None or best.rate <= 0:
        message = "the alternation gave up: it found no gain that is invariant and stable."
        proof = _unstructured_refutation(plant, 0.0, lp)
        return undecided(message, plant, objective=LARGEST_RATE) if proof is None else proof
    if best.rate >= ceiling * (1 - 1e-6):
        return undecided(UNLIMITED, objective=LARGEST_RATE, limit=np.inf)
    limit, v = best.rate, best.v
    # a common vector of several vertices may be much slower than each of them
    parts = RATE_PARTS if len(plant.vertices) == 1 else (*RATE_PARTS, 0.5, 0.2)
    result = first_proven(parts, lambda part: _any_rate(plant, program, lp, limit * part, v)[0])
    if result is None:
        return undecided(f"gains with a decay rate up to {floored(limit)} were found, but none was proven.", plant)
    return changed(result, objective=LARGEST_RATE, value=result.decay_rate)


def design_in_two_steps(plant: Plant, rate: float, lp: Programs) -> DesignResult:
    """The two programs of the paper, section V.A, for reference: they fail where the one-shot program succeeds.

    First F with h_i'(A + B F) x_k >= 0 for incident pairs and -h_i'(A + B F) x_k > 0 for the others; then v = sum a_i
    h_i, a > 0, with v'(A + B F) x_k < 0.  The first step does not know of the second: which F it returns decides
    whether there is such a v.
    """
    program = GainProgram(plant, lp)
    inside = ~np.asarray(plant.X.incidence, dtype=bool)[plant.facet_order]
    drifts = [(M, B) for M, (_, B) in zip(program.drifts, plant.pairs, strict=True)]
    inner, constant = program.forms(plant.facets, drifts, inside)
    need = np.tile((rate + program.strict) * (plant.facets @ plant.rays.T)[inside], len(plant.pairs))
    total = program.forms(plant.facets, drifts)[0].sum(axis=0)
    first = program.invariant(_BOX * program.unit, cost=np.asarray(total, dtype=float))
    first.below(-constant - need, gain=inner)
    answer = first.solve(lp)
    if not answer:
        return undecided("the first program of the two-step method has no solution.", plant)
    found = accept(plant, program.fill(answer["gain"]), rate=rate)
    if found is None:
        return undecided(
            "the first program gave a gain for which stability was not proven; the one-shot method may still succeed.",
            plant,
        )
    size = found.size
    return succeed(plant, found, FIRST_FOUND, size)
