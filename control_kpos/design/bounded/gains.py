"""Gains under hard bounds: |F x| <= u_max and A x + B F x + w in [0, x_max] for all x in [0, x_max], w in [0, w_max].

For a given x_max everything is linear in F, on every cone, with a vector a_i for each input and generators x_k of X:

    (A + B F) X in X,    -(A + B F) x_max - w_max in X,    -(A + B F) x_max - rate x_max in int X,
    a_i'x_k >= 0,   (a_i - F_i)'x_k >= 0,   a_i'x_max <= u_i,   (a_i - F_i)'x_max <= u_i,

for a_i and a_i - F_i bound F_i'x and -F_i'x on the interval: one program.  Where x_max is free, F and x_max are found
in turns: x_max is the smallest interval of the last F, and the next F uses the smallest part of u_max on it; this part
never grows, because the last F remains feasible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...cones import Cone
from ...errors import DataError, ShapeError
from ...exact.condition import Condition
from ...exact.intake import exact_matrix
from ...exact.matrix import Matrix
from ...exact.program import Block, Program
from ...exact.programs import Solution
from ...exact.signs import BilinearForms
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ..accept import accept, succeed, undecided
from ..plant import Floats, Interval, Plant
from ..polyhedral.program import GainProgram, products
from ..result import DesignResult
from ..running import Programs
from ..simplicial.program import stacked
from .contradiction import no_bounded_feedback
from .limit import limit_within

SMALLEST_INSIDE = "smallest gain max |F x_k| within the bounds"
# Parts of u_max, and of the sizes of inequalities that have to be strict, that are left to rounding.
_SPARED, _STRICT = 1e-9, 1e-7
_NOT_KEPT = (
    "no gain was proven to keep [0, state_bounds] within these bounds. Raise input_bounds, or give other state_bounds: "
    "small in the directions that decay slowly."
)
# Disturbances inside X beside those given, relative to these, so that the interval has interior.
_PUSHED = 1e-6
# More of u_max than the smallest part, which makes the next interval smaller.
_MORE = 0.1
# Turns of F and x_max, and the improvement below which they end.
_TURNS, _ENOUGH = 30, 1e-4


def read_interval(
    plant: Plant, state_bounds: ArrayLike | None, input_bounds: ArrayLike | None, disturbance_bounds: ArrayLike | None
) -> Interval:
    """The bounds, of which one at least is given.

    Raises
    ------
    ShapeError, DataError
        Sizes that do not fit; x_max not inside X, w_max not in X, u_max not positive; bounds that say nothing.
    """
    x = None if state_bounds is None else _inside(state_bounds, "state_bounds", plant.X, ">")
    pushed = np.zeros(plant.n) if disturbance_bounds is None else disturbance_bounds
    w = _inside(pushed, "disturbance_bounds", plant.X, ">=")
    if x is None and w.is_zero:
        raise DataError("input_bounds alone say nothing: give state_bounds (initial states) or disturbance_bounds > 0.")
    return Interval(x, None if input_bounds is None else _inputs(input_bounds, plant.m), w)


def _inside(values: Any, name: str, X: Cone, relation: Any) -> Matrix:
    row = exact_matrix(values, name, ndim=1)
    if row.shape != (X.dim,):
        raise ShapeError(f"{name} has shape {np.shape(values)}; it must be ({X.dim},), one number per state.")
    at = Condition("h'x", BilinearForms(X.exact_facets, None, row[None]), relation).worst_violation()
    if at is not None:
        where = "inside X" if relation == ">" else "in X"
        raise DataError(f"{name} is not {where}: see facet {at[0]}, {X.facets[at[0]]}.")
    return row


def _inputs(values: Any, m: int) -> Matrix:
    row = exact_matrix(values, "input_bounds", ndim=1)
    if row.shape == (1,) and m > 1:
        row = Matrix.join([row] * m, 0)
    if row.shape != (m,):
        raise ShapeError(f"input_bounds has {row.shape[0]} entries; give one number, or one for each of {m} inputs.")
    if not all(x > 0 for x in row.fractions()):
        raise DataError("input_bounds must be positive; leave inputs out with structure.")
    return row


def design_in_interval(plant: Plant, rate: Any, lp: Programs, without: Callable[[Plant], DesignResult]) -> DesignResult:
    """The smallest gain within the bounds of the plant; `without` designs one for a plant that has none."""
    bounds = plant.interval
    if bounds is None or rate == "max":
        raise DataError("state_bounds, input_bounds and disturbance_bounds go with a number as rate.")
    program, free = GainProgram(plant, lp), replace(plant, interval=None)
    if bounds.x_max is not None:
        found = _within(plant, bounds, bounds.x_max, program, rate)
        if found is not None:
            return found
        first = without(free)
        return first if first.status is Status.REFUTED else _refused(plant)
    first = without(free)
    if not first:
        return first
    for x in _shrinking(plant, bounds, program, float(rate), np.asarray(first.F)):
        found = _within(replace(plant, interval=replace(bounds, x_max=x)), bounds, x, program, rate)
        if found:
            return found
    return undecided(
        "no interval and gain were proven to keep these bounds, and others may exist. Raise input_bounds, lower "
        "disturbance_bounds, or give state_bounds.",
        plant,
    )


def _refused(plant: Plant) -> DesignResult:
    """REFUTED with the proof that no gain keeps these bounds, if there is one."""
    proof = no_bounded_feedback(plant)
    if proof is None:
        return undecided(_NOT_KEPT, plant)
    return DesignResult(status=Status.REFUTED, certificate=proof)


def _within(plant: Plant, bounds: Interval, x_max: Matrix, program: GainProgram, rate: float) -> DesignResult | None:
    """The smallest gain that is proven for this x_max, which is that of the plant."""
    rows = _Rows(plant, bounds, program, float(rate), np.asarray(x_max.values))
    accepted = first_proven(rows.small_gains(), lambda gain: accept(plant, gain, rate=rate))
    if accepted is None:
        return None
    limit = limit_within(plant, rate, accepted.size / (1 + plant.gap)) if bounds.x_max is not None else np.nan
    return succeed(plant, accepted, SMALLEST_INSIDE, accepted.size, limit)


def _shrinking(plant: Plant, bounds: Interval, program: GainProgram, rate: float, gain: Floats) -> Iterator[Matrix]:
    """x_max of ever better gains, as soon as some gain keeps the bounds of the inputs on it."""
    used = np.inf
    for _ in range(_TURNS):
        x = _smallest_interval(plant, bounds, gain, rate)
        found = None if x is None else _Rows(plant, bounds, program, rate, x).least_use()
        if x is None or found is None:
            return
        gain, part = found
        if part <= 1:
            yield Matrix(x)
        if part > used - _ENOUGH * max(1.0, part):
            return
        used = part


def _smallest_interval(plant: Plant, bounds: Interval, gain: Floats, rate: float) -> Floats | None:
    """The x_max inside X, all but the smallest, for which every vertex keeps the interval; None if it grows."""
    inner, w = np.asarray(plant.X.interior_point, dtype=float), np.asarray(bounds.w_max.values)
    pushed = w + _PUSHED * max(np.abs(w).max(initial=0.0), 1e-300) * inner
    H = plant.facets / (plant.facets @ plant.rays.T).max(axis=1)[:, None]
    program = Program(x=Block(plant.n, cost=H.sum(axis=0)))
    program.above(0.0, x=H)
    for A, B in plant.pairs:
        program.below(-H @ pushed, x=H @ (A + B @ gain + (rate - plant.discrete) * np.eye(plant.n)))
    answer = program.solve()
    return answer["x"] if answer and (H @ answer["x"] > 0).all() else None


@dataclass(frozen=True, eq=False)
class _Rows:
    """The linear programs above for one x_max, in floating point."""

    plant: Plant
    bounds: Interval
    program: GainProgram
    rate: float
    x: Floats

    def small_gains(self) -> Iterator[Floats]:
        """Gains within the gap of the smallest, first as far inside all bounds as possible."""
        lp = self.program.charged()
        self._add(lp, spread=False)
        answer = lp.solve(self.program.lp, method="primal")
        if not answer:
            return
        most = float(answer["largest"][0]) * (1 + self.plant.gap)
        for spread in (True, False):
            lp = self.program.bounded(most)
            self._add(lp, spread=spread)
            centred = lp.solve(self.program.lp, presolve=False)
            if centred:
                yield self.program.fill(centred["gain"])

    def least_use(self) -> tuple[Floats, float] | None:
        """The smallest part of u_max that some F uses, and an F that uses little more and makes x fall fast."""
        least = self._solved(self.program.invariant(), part=Block(1, low=0.0, cost=1.0))
        if least is None:
            return None
        part, program = float(least["part"][0]), self.program.invariant()
        program.add(margin=Block(1, low=0.0, cost=-1.0))
        found = self._solved(program, part=Block(1, high=part * (1 + _MORE)), margin=1.0) or least
        return self.program.fill(found["gain"]), part

    def _solved(self, lp: Program, **more: Any) -> Solution | None:
        self._add(lp, spread=False, **more)
        return lp.solve(self.program.lp) or None

    def _add(self, lp: Program, *, spread: bool, part: Block | None = None, margin: float = 0.0) -> None:
        """Rows of the interval and of the inputs; with `spread` those of the interval and of X have slack."""
        lp.add(part=part or Block(1, low=1.0, high=1.0))
        groups = [*self._kept, *self._invariant()] if spread else self._kept
        right, size = (np.concatenate([group[k] for group in groups]) for k in (0, 1))
        rows = stacked(*(group[2] for group in groups))
        if spread:
            lp.spread(right, size, gain=rows)
        else:
            lp.above(right, margin * size if margin else 0.0, gain=rows)
        if self.bounds.u_max is not None:
            self._cover(lp, np.asarray(self.bounds.u_max.values) * (1 - _SPARED))

    def _invariant(self) -> Iterator[tuple[Floats, Floats, Any]]:
        """(right, size, rows) of rows gain >= right: invariance, where F takes part in it."""
        G, g = self.program.invariance
        taking = np.flatnonzero(np.asarray(abs(G).sum(axis=1)).ravel())
        yield -g[taking], self.program.sizes[taking], G[taking]

    @cached_property
    def _kept(self) -> list[tuple[Floats, Floats, Any]]:
        """(A + B F) x + w and (A + B F) x + rate x in -X, for every vertex; strictly for the second if rate is 0."""
        H, x, k = self.plant.facets, self.x, np.zeros(len(self.plant.facets), dtype=np.intp)
        pushed, drawn, out = np.asarray(self.bounds.w_max.values), self.rate * x, []
        for A, B in self.plant.pairs:
            rows, moved = -products(H @ B, x[None], k, self.program.free), A @ x - self.plant.discrete * x
            for more, strict in ((pushed, 0.0), (drawn, float(not self.rate))):
                size = np.abs(H) @ (np.abs(A) @ np.abs(x) + np.abs(x) + np.abs(more))
                out.append((H @ (moved + more) + strict * _STRICT * size, size, rows))
        return out

    def _cover(self, lp: Program, most: Floats) -> None:
        """a_i and a_i - F_i in X*, and at most part u_i at x."""
        above, seen, end, moved = self._used
        lp.add(cover=Block(above.shape[1]))
        lp.above(0.0, cover=above)
        lp.above(0.0, cover=above, gain=-seen)
        lp.below(0.0, cover=end, part=-most)
        lp.below(0.0, cover=end, gain=-moved, part=-most)

    @cached_property
    def _used(self) -> tuple[Any, Any, Any, Any]:
        """(a_i'x_k, F_i'x_k) for all inputs i and generators, and (a_i'x, F_i'x)."""
        m, free = self.plant.m, self.program.free
        rays = self.plant.rays / np.abs(self.plant.rays).max(axis=1)[:, None]
        unit = np.eye(m)
        i, k = (index.ravel() for index in np.indices((m, len(rays))))
        seen, moved = products(unit[i], rays, k, free), products(unit, self.x[None], np.zeros(m, dtype=np.intp), free)
        return np.kron(unit, rays), seen, np.kron(unit, self.x), moved
