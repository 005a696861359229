"""Disturbance rejection on any polyhedral cone, and for gains of any linear shape, by alternation.

With x' = (A + B F) x + E w, z = (G + H F) x + D w, positive from w to z, the L-infinity gain is below gamma if some x
inside X has

    (A + B F) x + E 1 < 0 (in the order of X),   (G + H F) x + D 1 < gamma 1,

at every vertex; a decay rate is demanded by the same x, (A + B F) x + rate x < 0.  For fixed x this is linear in F, for
fixed F in x and gamma; they are improved in turn, from a gain that is stable.  Where x is the best for F it leaves F no
smaller gamma, but faster decay: with p' = -c'(A + B F)^{-1} for the sum c of the worst outputs, gamma falls as fast as
p'(A + B F) x does, so that this is minimised.  To leave F more freedom x is taken for a larger disturbance.

Where F works on the outputs, H != 0, such an x may leave no better F at all.  The gain is bounded from the other side
as well: of output i it is p_i'E 1 + D_i 1 at most if p_i in X* has, on every generator,

    p_i'(A + B F) + (G + H F)_i <= 0.

With the p_i of one gain this is linear in the next, whose p_i are no larger, with one vertex: steps of a policy
iteration.  Both kinds of steps are tried.  What is found is a local optimum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Any, TypeAlias

import numpy as np

from ...exact.budget import affords
from ...exact.program import Block, Program
from ...proof.answer import first_proven
from ..accept import Accepted, accept, proven_gamma, succeed, undecided
from ..disturbance import allowances, in_own_units
from ..plant import Floats, Plant
from ..result import DesignResult
from ..running import Programs
from ..simplicial.inequalities import solved
from ..simplicial.program import stacked
from .program import GainProgram, products

# Rows S l <= b for the entries l of a gain; from these and costs of l to a gain; from x and a gamma that it proves to
# gains.
Rows: TypeAlias = tuple[Any, Floats]
Better: TypeAlias = Callable[[Rows, Floats], Floats | None]
Small: TypeAlias = Callable[[Floats, float], Iterable[Floats]]
# Steps of the alternation, and the relative decrease of gamma at which it stops.
_ROUNDS, _ENOUGH = 20, 1e-4
# Of the size of the plant, what (A + B F) x + E 1 is below 0, for 1 in the units of x.
_STRICT = 1e-6
# Parts by which the disturbance is enlarged for the x that the gain is improved at.
_LARGER = (1.0, 0.1, 0.01, 0.0)
# Parts of the way to the worst output that better ones may go in a step.
_TOWARDS = (0.0, 0.5, 0.9)
# Parts of such a step, which may lead beyond a better gain.
_SHARES = (0.5, 0.1)
# Entries of A + B F below this part of the largest in their row count as rounding.
_NOISE = 1e-13
# Margins of positivity that are tried with a small gain, relative to its rows.
_MARGINS = (1e-7, 1e-9, 0.0)


class Rejection:
    """The inequalities of the module's head, over the free entries of the gain or over x.

    Parameters
    ----------
    program : GainProgram
        Of a plant with a disturbance; x and gamma are in units of their own.
    rate : float
    """

    def __init__(self, program: GainProgram, rate: float) -> None:
        plant = program.plant
        self.program, self.plant, self.rate = program, plant, rate
        E, self.G, self.H, D, self.units = in_own_units(plant)
        self.push_by, self.through = E.sum(axis=1), D.sum(axis=1)
        self.push = plant.facets @ self.push_by
        self.outputs = program.forms(np.eye(len(self.G)), [(self.G, self.H)])
        heights = np.abs(plant.facets) @ np.abs(plant.rays).max(axis=0)
        self.strict = _STRICT * np.maximum(plant.scale * heights, np.abs(self.push))
        # (M, B) for (M + B F) x < 0: against the disturbance at every vertex, then for the decay rate
        shifts = (0.0, float(rate)) if rate else (0.0,)
        pairs = [(M, B) for M, (_, B) in zip(program.drifts, plant.pairs, strict=True)]
        self.falls = [(M + shift * np.eye(plant.n), B) for shift in shifts for M, B in pairs]

    def for_gain(self, x: Floats) -> tuple[Any, Floats, Floats]:
        """(S, s, t): all inequalities but positivity are S l + s <= gamma t, for a fixed x."""
        facets, seen = self.plant.facets, (self.program.read @ x)[None]
        blocks = [(facets, M, B) for M, B in self.falls]
        blocks.append((np.eye(len(self.G)), self.G, self.H))
        rows = [products(H @ B, seen, np.zeros(len(H), dtype=np.intp), self.program.free) for H, _, B in blocks]
        constants = np.concatenate([H @ M @ x for H, M, _ in blocks])
        added, count = self._added(), len(self.falls) * len(facets)
        return stacked(*rows), constants + added, (np.arange(len(constants)) >= count).astype(float)

    def _added(self, faster: float = 1.0) -> Floats:
        """What is added to (M + B F) x and to the outputs; `faster` 0: the decay rate may be met with equality."""
        vertices = len(self.plant.pairs)
        rates = [faster * self.strict] * (len(self.falls) - vertices)
        return np.concatenate([*[self.push + self.strict] * vertices, *rates, self.through])

    def better(self, rows: Rows, slope: Floats) -> Floats | None:
        """The gain within these rows for which gamma falls fastest."""
        P, p = self.outputs
        program = self.program.invariant(cost=slope)
        program.above(-p, gain=P)
        program.below(rows[1], gain=rows[0])
        answer = program.solve(self.program.lp)
        return self.program.fill(answer["gain"]) if answer else None

    def kept(self, x: Floats, gamma: float) -> Rows:
        """For which gains x proves gamma."""
        S, s, t = self.for_gain(x)
        return S, gamma * t - s

    def no_worse(self, gain: Floats, part: float) -> Rows | None:
        """For which gains the vectors p_i of this one prove no more than they do for it; None if it has none.

        To those of better outputs is added what falls along every trajectory, until they prove more, by this part of
        what is missing to the worst.
        """
        plant, used = self.plant, gain @ self.program.read
        inner, seen = self.program.facet_sum(), self.G + self.H @ used
        more = _STRICT * inner * np.abs(seen).max(axis=1, keepdims=True)  # so that every such gain is stable
        rows, right, k = [], [], np.arange(len(plant.rays))
        for M, (_, B) in zip(self.program.drifts, plant.pairs, strict=True):
            *vectors, fall = -solved((M + B @ used).T, np.concatenate([seen + more, inner[None]]).T).T
            reached, pushed = vectors @ self.push_by + self.through, fall @ self.push_by
            if not np.isfinite([*reached, pushed]).all():
                return None
            vectors = vectors + np.outer(part * (reached.max() - reached) / max(pushed, 1e-300), fall)
            for p, G, H in zip(vectors, self.G + more, self.H, strict=True):
                rows.append(self.program.coefficients(np.tile(p @ B + H, (len(k), 1)), k))
                right.append(-plant.rays @ (p @ M + G))
        return stacked(*rows), np.concatenate(right)

    def slope(self, gain: Floats, x: Floats) -> Floats:
        """The slopes of gamma in the free entries of the gain."""
        used, total = gain @ self.program.read, np.zeros(len(self.program.free))
        outputs = self.G + self.H @ used
        reached = outputs @ x + self.through
        worst = (reached >= reached.max() - 1e-6 * abs(reached.max())).astype(float)
        where = np.zeros(1, dtype=np.intp)
        for M, (_, B) in zip(self.program.drifts, self.plant.pairs, strict=True):
            p = -solved((M + B @ used).T, worst @ outputs)
            left = (p @ B if np.isfinite(p).all() else np.zeros(B.shape[1])) + worst @ self.H
            rows = products(left[None], (self.program.read @ x)[None], where, self.program.free)
            total += np.asarray(stacked(rows).sum(axis=0)).ravel()
        return total / max(np.abs(total).max(initial=0.0), 1e-300)

    def small(self, x: Floats, gamma: float) -> Iterator[Floats]:
        """Smallest gains for which x proves gamma, with less and less margin of positivity."""
        (S, s, t), (P, p) = self.for_gain(x), self.outputs
        (G, g), sizes = self.program.invariance, self.program.sizes
        outer = abs(P) @ np.full(P.shape[1], self.program.unit) + np.abs(p)
        for margin in _MARGINS:
            program = self.program.bounded()
            program.above(margin * np.concatenate([sizes, outer]) - np.concatenate([g, p]), gain=stacked(G, P))
            self.program.charge(program)
            program.below(gamma * t - s, gain=S)
            answer = program.solve(self.program.lp)
            if answer:
                yield self.program.fill(answer["gain"])

    def point(self, gain: Floats, larger: float = 0.0) -> tuple[Floats, float] | None:
        """The x of smallest gamma for this gain, and gamma; for a disturbance that is larger by this part."""
        facets, n = self.plant.facets, self.plant.n
        used = gain @ self.program.read
        falls = [facets @ (M + B @ used) for M, B in self.falls]
        rows, outer = np.concatenate([*falls, self.G + self.H @ used]), len(self.falls) * len(facets)
        # what rounding left of entries that cancel would spoil the scaling of the program
        rows = np.where(np.abs(rows) > _NOISE * np.abs(rows).max(axis=1, keepdims=True), rows, 0.0)
        program = Program(x=Block(n), gamma=Block(1, cost=1.0))
        added = (1 + larger) * self._added(faster=0.0)
        program.below(-added, x=rows, gamma=-(np.arange(len(rows)) >= outer).astype(float))
        program.above(self.strict / max(self.plant.scale, 1e-300), x=facets)
        answer = program.solve(self.program.lp)
        return (answer["x"], float(answer["gamma"][0])) if answer else None

    def improved(self, gain: Floats, better: Better | None = None) -> tuple[Floats, Floats, float] | None:
        """Gain, x and gamma at which the alternation from a stable gain stops; `better` replaces the method."""
        best: tuple[Floats, Floats, float] | None = None
        for _ in range(_ROUNDS):
            found = self.point(gain) if affords() else None
            if found is None or (best is not None and found[1] > best[2] - _ENOUGH * abs(best[2])):
                break
            best = gain, *found
            tried = self._steps(gain, found[0], better or self.better)
            steps = [step for step in tried if step is not None]
            if not steps:
                break
            gain = min(steps, key=lambda pair: pair[1])[0]
        return best

    def _steps(self, gain: Floats, x: Floats, better: Better) -> Iterator[tuple[Floats, float] | None]:
        """Gains after one step, and their gammas."""
        for part in (_TOWARDS if len(self.G) > 1 else _TOWARDS[:1]) if self.H.any() else ():
            yield from self._downward(gain, x, better, part)
        for larger in _LARGER:
            start = self.point(gain, larger)
            if start is not None:
                yield self._reached(better(self.kept(*start), self.slope(gain, start[0])))

    def _downward(self, gain: Floats, x: Floats, better: Better, part: float) -> Iterator[tuple[Floats, float]]:
        """By the vectors p_i; once more where one of several worst outputs stayed as it was."""
        for _ in range(min(2, len(self.G))):
            below = self.no_worse(gain, part)
            end = None if below is None else better(below, self.slope(gain, x))
            found = None if end is None else self.point(end)
            if end is None or found is None:
                return
            yield end, found[1]
            between = (self._reached(gain + share * (end - gain)) for share in _SHARES)
            yield from filter(None, between)
            gain, x = end, found[0]

    def _reached(self, gain: Floats | None) -> tuple[Floats, float] | None:
        end = None if gain is None else self.point(gain)
        return None if gain is None or end is None else (gain, end[1])

    def accepted(self, gain: Floats, x: Floats, gamma: float, small: Small | None = None) -> Accepted | None:
        """The gain, or a smaller one that does nearly as well, proven; `small` replaces the method."""
        for extra in allowances(self.plant):
            most = gamma + extra * max(abs(gamma), 1e-6)
            inside = self.point(gain, extra / 2)  # where x is tight, no gain has a margin
            gains = chain((small or self.small)(x if inside is None else inside[0], most), (gain,))
            found = first_proven(gains, lambda F, most=most: self._proven(F, most))
            if found is not None:
                return found
        return None

    def _proven(self, gain: Floats, most: float) -> Accepted | None:
        found = self.point(gain)
        if found is None:
            return None
        x, gamma = found[0] * self.units[0], most * self.units[1]
        return accept(self.plant, gain, rate=self.rate, x=x, gamma=gamma)


def reject_by_alternation(plant: Plant, rate: float, lp: Programs, stable: DesignResult, name: str) -> DesignResult:
    """The best gain found from one that is stable; `stable` itself, without it, if that is no gain."""
    if not stable:
        return stable
    return rejected(Rejection(GainProgram(plant, lp), rate), np.asarray(stable.F), name)


def rejected(
    rejection: Rejection, gain: Floats, name: str, better: Better | None = None, small: Small | None = None
) -> DesignResult:
    """The best gain found from one that is stable, proven; `better` and `small` replace methods of the rejection."""
    best = rejection.improved(gain, better)
    if best is None:
        return undecided("no x was found that bounds the gain from w to z; a common one may not exist.", objective=name)
    found = rejection.accepted(*best, small)
    if found is None:
        return undecided("a gain was found, but could not be proven.", objective=name)
    return succeed(rejection.plant, found, name, proven_gamma(found))
