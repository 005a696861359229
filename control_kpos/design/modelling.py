"""Constraints and objectives that the user writes in cvxpy.

They are linear (or convex) in F, so F itself must be the variable.  For a fixed vector v inside X* the conditions
h_i'(A + B F) x_k >= 0 and v'(A + B F) x_k < 0 are linear in F; F and v are improved in turns, as in
`polyhedral.program`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ..errors import DataError
from ..exact.budget import OutOfBudgetError, begin, reason, seconds_left
from ..exact.programs import guarded, program_effort
from .accept import Accepted, accept, succeed, undecided
from .plant import Floats, Plant
from .polyhedral.program import GainProgram
from .result import DesignResult
from .running import Programs

USER = "objective given"
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
    import cvxpy as cp  # noqa: PLC0415  (heavy, and needed by few)

    if callable(lp.solver):
        raise DataError("constraints and objective go through cvxpy: give solver as a name, or leave it out.")
    program = GainProgram(plant, lp.on_highs())
    F = cp.Variable(program.shape)
    own, cost = _users_part(cp, F, constraints, objective, plant)
    best: tuple[Any, float] | None = None
    last = "no vector v admits a gain"
    hints = _hints(plant, rate, program)
    with suppress(OutOfBudgetError):
        for number, start in enumerate(program.starts(_STARTS, hints)):
            vectors = [start]
            for step in range(_ROUNDS):
                lp.stage(f"vector {number + 1} of {_STARTS + len(hints)}, step {step + 1}")
                found = None
                for v in vectors:
                    gain, message = _solve(cp, program, F, own, cost, v, rate, lp)
                    if gain is None:
                        last = message
                        continue
                    accepted = _accept(plant, gain, rate, F, own, cost, lp)
                    if accepted is not None and (found is None or accepted[1] < found[1]):
                        found = accepted
                if found is None or (best is not None and found[1] >= best[1] - 1e-6 * max(1.0, abs(best[1]))):
                    break
                best = found
                vectors = list(program.vectors(found[0].F))
    if best is None:
        return undecided(f"no certified gain meets the constraints given; {last}.", plant)
    accepted, value = best
    if objective is None:
        value = plant.gain_of(accepted.F)
    return succeed(
        plant,
        accepted,
        USER if objective is not None else "gain max |F x_k| under the constraints given",
        float(value),
        float(value),
    )


def _users_part(cp: Any, F: Any, constraints: Any, objective: Any, plant: Plant) -> tuple[list[Any], Any]:
    try:
        own = list(constraints(F)) if constraints is not None else []
        cost = (
            objective(F)
            if objective is not None
            else cp.max(cp.abs(F @ plant.on_states(np.eye(plant.shape[1])) @ plant.rays.T))
        )
    except (TypeError, ValueError, AttributeError, IndexError) as error:
        raise DataError(f"constraints or objective failed on a cvxpy variable of shape {F.shape}: {error}.") from None
    if not all(isinstance(c, cp.constraints.constraint.Constraint) for c in own):
        raise DataError("constraints must return a list of cvxpy constraints on its argument.")
    cost = cp.expressions.expression.Expression.cast_to_const(cost)
    problem = cp.Problem(cp.Minimize(cost), own)
    if not problem.is_dcp():
        raise DataError("constraints and objective must be convex in F by cvxpy's rules.")
    return own, cost


def _hints(plant: Plant, rate: float, program: GainProgram) -> tuple[Floats, ...]:
    """Lyapunov vectors of gains without the user's constraints."""
    found = program.speed_up(program.facet_sum(), 2 * rate + plant.scale, rate + program.strict)
    return () if found is None else (found.v, *program.vectors(found.gain))


def _solve(
    cp: Any,
    program: GainProgram,
    F: Any,
    own: list[Any],
    cost: Any,
    v: Floats,
    rate: float,
    lp: Programs,
) -> tuple[Floats | None, str]:
    plant = program.plant
    message = f"{reason()} was reached"
    G, g = program.invariance
    S, s, w = program.stability(v)
    size = _sizes(plant, len(g))
    entries = cp.reshape(F, (program.shape[0] * program.shape[1],), order="C")[program.free]
    for margin in _MARGINS:
        rows = [*own, G @ entries + g >= margin * size, S @ entries + s <= -(rate + program.strict) * w]
        if plant.gain_bound is not None:
            rows.append(
                cp.abs(F @ program.seen.T) <= np.tile(plant.gain_bound[:, None] * (1 - margin), (1, len(plant.rays)))
            )
        if plant.pattern is not None:
            rows.append(cp.multiply((~plant.pattern).astype(float), F) == 0)
        problem = cp.Problem(cp.Minimize(cost), rows)
        if not begin(program_effort(len(g) + len(s), len(program.free))):
            break
        message = guarded(lambda problem=problem: _status(problem, lp.solver), seconds_left())
        if message in ("optimal", "optimal_inaccurate"):
            if np.shape(F.value) == program.shape and np.isfinite(F.value).all():
                return np.array(F.value, dtype=float), message
            message = "the solver called a gain optimal that is no finite matrix"
    return None, message


def _sizes(plant: Plant, count: int) -> Floats:
    """What margins of invariance are relative to; 0 for the rows of ports, which come last."""
    sizes = [np.abs(plant.facets) @ np.abs(A) @ np.abs(plant.rays.T) for A, _ in plant.pairs]
    own = np.concatenate([size[plant.incidence] for size in sizes])
    return np.append(own, np.zeros(count - len(own)))


def _status(problem: Any, solver: Any) -> str:
    problem.solve(**({} if solver is None else {"solver": solver}))
    return str(problem.status)


def _accept(
    plant: Plant, gain: Floats, rate: float, F: Any, own: list[Any], cost: Any, lp: Programs
) -> tuple[Accepted, float] | None:
    """A certified rounding of the gain that also meets the user's constraints to 1e-6, and what it costs."""
    found = accept(plant, gain, rate=rate)
    if found is None:
        return None
    F.value = found.F
    value = float(np.asarray(cost.value).item())
    if not np.isfinite(value):
        return None
    if all(np.max(c.violation(), initial=0.0) <= 1e-6 * (1 + np.abs(found.F).max()) for c in own):
        return found, value
    return None
