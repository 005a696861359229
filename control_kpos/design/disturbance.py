"""Disturbance rejection: the L-infinity gain from w to z minimised, exactly on simplicial cones.

For x' = (A + B F) x + E w, z = (G + H F) x + D w, positive from w in the orthant to z in the orthant, the L-infinity
gain is the largest row sum of the DC gain.  It is below gamma if and only if some xi > 0 has

    (A + B F) x + E 1 < 0 (in the order of X),   (G + H F) x + D 1 < gamma 1,   x = sum xi_k x_k,

which is linear in xi, z_k = xi_k F x_k and gamma.  If the gain of smallest gamma is too slow for a decay rate, the rate
is demanded by the same x as well, which a gain need not have it by: the limit is proven without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..cones import orthant
from ..errors import ShapeError
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix
from ..exact.program import Block, Program, Solver
from ..proof.answer import first_proven
from ..proof.certificate import Status
from .accept import Accepted, accept, beyond_feedback, proven_gamma, succeed, undecided
from .contradiction import NoFeedback
from .limits import REACHED, disturbance_limit
from .plant import Floats, Plant
from .result import DesignResult, changed
from .running import Programs
from .simplicial.inequalities import output_rows
from .simplicial.program import SimplicialProgram, scaled_rows, stacked
from .simplicial.search import exact_design

LINF_GAIN = "L-infinity gain from w to z"
# Larger relative increases of gamma, tried where the gap proves nothing.
_EXTRA = (1e-3, 1e-2)
# Margins of invariance that are tried with a small gain, relative to its rows.
_MARGINS = (1e-7, 1e-9, 0.0)
_AWAY = "the best gains found are ten thousand times the size of the plant; give gain_bound."
_ALSO_Z = "z must not be negative where x is in X; it is called the output, and its orthant Y."
# Gains this many times the size of the plant count as unbounded.
_HUGE = 1e4


def read_disturbance(data: Sequence[ArrayLike], plant: Plant) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """(E, G, H, D) with zeros for what was left out."""
    if not isinstance(data, (tuple, list)) or not 2 <= len(data) <= 4:
        raise ShapeError("disturbance must be (E, G), (E, G, H) or (E, G, H, D), a tuple of matrices.")
    E, G = exact_matrix(data[0], "disturbance E"), exact_matrix(data[1], "disturbance G")
    require_shape(E, "disturbance E", (plant.n, None), "one row per state")
    require_shape(G, "disturbance G", (None, plant.n), "one column per state")
    zeros = Matrix.zeros(G.shape[0], plant.m), Matrix.zeros(G.shape[0], E.shape[1])
    H = exact_matrix(data[2], "disturbance H") if len(data) > 2 else zeros[0]
    D = exact_matrix(data[3], "disturbance D") if len(data) > 3 else zeros[1]
    require_shape(H, "disturbance H", (G.shape[0], plant.m), "one row per row of G, one column per input")
    require_shape(D, "disturbance D", (G.shape[0], E.shape[1]), "one row per row of G, one column per column of E")
    return E, G, H, D


def allowances(plant: Plant) -> list[float]:
    """Parts by which gamma may exceed the smallest one, tried in turn; what is left of the gap is for the limit."""
    least = REACHED * plant.gap
    return [least, *(extra for extra in _EXTRA if extra > least)]


def in_own_units(plant: Plant) -> tuple[Floats, Floats, Floats, Floats, tuple[float, float]]:
    """(E, G, H, D) in doubles, in units in which x and z are of ordinary size, and these units of x and of gamma."""
    E, G, H, D = (np.asarray(M.values) for M in plant.disturbance)  # type: ignore[union-attr]
    heights = np.maximum((plant.facets @ plant.rays.T).max(axis=1), np.finfo(float).tiny)
    pushed = np.abs(plant.facets @ E.sum(axis=1) / heights).max() / plant.scale
    of_x = _power_of_two(pushed)
    of_z = of_x * _power_of_two(np.abs(G @ plant.rays.T).max())
    return E / of_x, G * (of_x / of_z), H * (of_x / of_z), D / of_z, (of_x, of_z)


def _power_of_two(size: float) -> float:
    """Next to a size; 1 for sizes that are 0 or out of range."""
    return float(np.ldexp(1.0, int(np.frexp(size)[1]))) if 1e-200 < size < 1e200 else 1.0


def leaves_at_once(plant: Plant) -> DesignResult | None:
    """REFUTED if the disturbance leaves X, or z its orthant, whatever the feedback is."""
    E, G, _, D = plant.disturbance  # type: ignore[misc]
    W, Z = orthant(E.shape[1]), orthant(G.shape[0])
    message = "w in the orthant must not leave X or z's orthant directly: E must map into X and D be nonnegative."
    return beyond_feedback(plant, message, B=E, D=D, U=W, Y=Z)


def objective_of(plant: Plant) -> str:
    """What is minimised, in words."""
    return f"{LINF_GAIN}, by one x for all vertices" if len(plant.vertices) > 1 else LINF_GAIN


def reject_disturbance(plant: Plant, rate: float, lp: Programs) -> DesignResult:
    """The gain of smallest L-infinity gain from w to z (within 0.1 %), then of small size."""
    name = objective_of(plant)
    loose = DisturbanceProgram(plant, 0.0, lp)
    free = loose.least()
    if rate:  # the gain of the smallest bound at any rate may be fast enough
        found = first_proven(loose.points(free, rate), partial(_accepted, plant, loose, rate))
        if found is not None:
            return _succeeded(plant, found, name, free, loose)
    program = DisturbanceProgram(plant, rate, lp) if rate else loose
    first = program.least() if rate else free
    if not first or not (first["x"][: plant.n] > 0).all():
        reason = (first.message or first.outcome) if not first else "the solver returned a point that violates it"
        message = f"the linear program has no solution ({reason}); whether there is a gain is not proven."
        plain = exact_design(_without_disturbance(plant), rate, lp)
        if plain.status is not Status.REFUTED:
            return undecided(message, plant, objective=name)
        also = isinstance(plain.certificate, NoFeedback) and plain.certificate.ports is not None
        return changed(plain, message=_ALSO_Z) if also else plain
    found = first_proven(program.points(first), partial(_accepted, plant, program, rate))
    if found is None:
        away = program.runs_away(first["x"])
        return undecided(_AWAY if away else "a gain was found, but could not be proven.", objective=name)
    return _succeeded(plant, found, name, free, loose)


def _without_disturbance(plant: Plant) -> Plant:
    """The plant with z as its outputs, in their orthant, where the feedback moves them: no gain here, none there."""
    _, G, H, _ = plant.disturbance  # type: ignore[misc]
    if H.is_zero:
        return replace(plant, disturbance=None)
    seen = replace(plant.system, C=G, D=H, Y=orthant(G.shape[0]))
    return replace(plant, disturbance=None, system=seen, ports=True)


def _accepted(
    plant: Plant, program: DisturbanceProgram, rate: float, candidate: tuple[float, Floats]
) -> Accepted | None:
    (gamma, point), (of_x, of_z) = candidate, program.units
    F, inside = program.read(point)
    return accept(plant, F, rate=rate, x=inside * of_x, gamma=gamma * of_z)


def _succeeded(plant: Plant, found: Accepted, name: str, free: Any, program: DisturbanceProgram) -> DesignResult:
    """With the limit, from the point of smallest gamma at any rate."""
    limit = disturbance_limit(plant, float(free["gamma"][0]) * program.units[1]) if free else np.nan
    return succeed(plant, found, name, proven_gamma(found), limit)


class DisturbanceProgram(SimplicialProgram):
    """The inequalities of the module's head over x = (xi, z), for E, G, H, D of the plant, in units of their own."""

    def __init__(self, plant: Plant, rate: float, lp: Solver) -> None:
        super().__init__(plant, lp)
        E, G, H, D, self.units = in_own_units(plant)
        self.rate, self.through = rate, D.sum(axis=1)
        push = (plant.facets @ E).sum(axis=1) / np.einsum("ij,ij->i", plant.facets, plant.rays)
        self.push = np.tile(push, len(plant.vertices))
        self.closed = stacked(self.closed, output_rows(G, H, np.eye(len(G)), plant.rays)[0][:, self.kept])
        self.total = np.hstack([G @ plant.rays.T, np.tile(H, (1, plant.n))])[:, self.kept]

    def program(self, margin: float = 0.0, x: Floats | None = None) -> Program:
        """Invariance, with a margin relative to its rows at x, z in its orthant, and (A + B F) x + E 1 < 0."""
        program = Program(x=self._over(1e-6, np.inf))
        program.above(0.0 if x is None else margin * (abs(self.closed) @ np.abs(x)), x=self.closed)
        program.below(0.0, x=self.bounds)
        program.below(-self.push, x=self.decreasing(0.0))
        if self.rate:
            program.below(0.0, x=self.decreasing(self.rate))
        return program

    def least(self) -> Any:
        """The point of smallest gamma, which is a variable of its own."""
        program = self.program()
        program.add(gamma=Block(1, cost=1.0))
        program.below(-self.through, x=self.total, gamma=-np.ones(len(self.total)))
        return program.solve(self.lp)

    def runs_away(self, x: Floats) -> bool:
        """True for gains that count as unbounded."""
        return self.plant.gain_of(self.read(x)[0]) > _HUGE * max(self.plant.scale, 1.0)

    def points(self, first: Any, rate: float = 0.0) -> Iterator[tuple[float, Floats]]:
        """Of each gamma, the point of smallest |F x_k|, then the first one; those that decay at a rate, as computed."""
        if not first or not (first["x"][: self.plant.n] > 0).all():
            return
        x, best = first["x"], float(first["gamma"][0])
        for extra in allowances(self.plant):
            gamma = best + extra * max(abs(best), 1e-6)
            for point in (self.small(gamma, x), x):
                if point is None or self.runs_away(point):
                    continue
                if not rate or self._decays(point, float(rate)):
                    yield gamma, point

    def _decays(self, point: Floats, rate: float) -> bool:
        """Whether every vertex decays at this rate, in floating point."""
        F = self.read(point)[0]
        poles = [np.linalg.eigvals(A + B @ F) for A, B in self.plant.pairs]
        rates = [1 - np.abs(p).max() if self.plant.discrete else -p.real.max() for p in poles]
        return min(rates) >= rate

    def small(self, gamma: float, x: Floats) -> Floats | None:
        """The smallest largest entry of |F x_k| at this gamma, with the weights xi of x and a little margin."""
        scaled = scaled_rows(self.slope, 1 / (self.level @ x))

        def solve(margin: float) -> Floats | None:
            program = self.program(margin, x)
            program.add(largest=Block(1, low=0.0, cost=1.0))
            program.below(gamma - self.through - min(1e-6, self.plant.gap / 10) * abs(gamma), x=self.total)
            program.below(0.0, x=scaled, largest=-np.ones(scaled.shape[0]))
            answer = program.solve(self.lp)
            return answer["x"] if answer and (answer["x"][: self.n] > 0).all() else None

        return next((point for margin in _MARGINS if (point := solve(margin)) is not None), None)
