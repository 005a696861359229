"""Disturbance rejection: the L-infinity gain from w to z minimised, exactly on simplicial cones.

For x' = (A + B F) x + E w, z = (G + H F) x + D w, positive from w in the orthant to z in the orthant, the L-infinity
gain is the largest row sum of the DC gain.  It is below gamma if and only if some xi > 0 has

    (A + B F) x + E 1 < 0 (in the order of X),   (G + H F) x + D 1 < gamma 1,   x = sum xi_k x_k,

which is linear in xi, z_k = xi_k F x_k and gamma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..cones import orthant
from ..errors import DataError, ShapeError
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix
from ..exact.program import Block, Program, Solver
from ..proof.answer import first_proven
from ..theorems.positivity import cone_positivity
from .accept import Accepted, accept, beyond_feedback, closed_loop, succeed, undecided
from .certificates import DisturbanceCertificate
from .plant import Floats, Plant
from .result import DesignResult
from .simplicial.inequalities import column_rows
from .simplicial.program import SimplicialProgram, scaled_rows

LINF_GAIN = "L-infinity gain from w to z"
# Relative increase of gamma that is spent on a small gain and on margins.
_SLACK = 1e-3
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


def reject_disturbance(plant: Plant, rate: float, data: Sequence[ArrayLike], lp: Solver) -> DesignResult:
    """The gain of smallest L-infinity gain from w to z (within 0.1 %), then of small size."""
    if len(plant.vertices) > 1:
        raise DataError("disturbance rejection takes one plant; leave vertices out.")
    E, G, H, D = read_disturbance(data, plant)
    W, Z = orthant(E.shape[1]), orthant(G.shape[0])
    message = "w in the orthant must not leave X or z's orthant directly: E must map into X and D be nonnegative."
    blocked = beyond_feedback(plant, message, B=E, D=D, U=W, Y=Z)
    if blocked is not None:
        return blocked
    program = SimplicialProgram(plant, lp)
    rows = _Rows(program, rate, tuple(np.asarray(M.values) for M in (E, G, H, D)))
    least = rows.program()
    least.add(gamma=Block(1, cost=1.0))
    least.below(-rows.through, x=rows.total, gamma=-np.ones(len(rows.total)))
    first = least.solve(lp)
    if not first or not (first["x"][: plant.n] > 0).all():
        reason = (first.message or first.outcome) if not first else "the solver returned a point that violates it"
        message = (
            f"the program has no solution ({reason}): no gain keeps x in X, z in its orthant, and the loop stable."
        )
        return undecided(message, plant, objective=LINF_GAIN)
    x, best = first["x"], float(first["gamma"][0])
    if plant.gain_of(program.read(x)[0]) > _HUGE * max(plant.scale, 1.0):
        message = "the larger the gain, the better, without end; give gain_bound."
        return undecided(message, objective=LINF_GAIN, limit=best)

    def points() -> Iterator[tuple[float, Floats]]:
        """Of each gamma, the point of smallest |F x_k|, then the first one."""
        for slack in (_SLACK, 1e-2):
            gamma = best + slack * max(abs(best), 1e-6)
            second = rows.small(gamma, x, lp)
            yield from ((gamma, point) for point in (second, x) if point is not None)

    def prove(candidate: tuple[float, Floats]) -> Accepted | None:
        gamma, (F, inside) = candidate[0], program.read(candidate[1])

        def bounded(gain: Floats, loop: Matrix) -> DisturbanceCertificate:
            out = closed_loop(G, H, Matrix(gain))
            positivity = cone_positivity(loop, E, out, D, plant.X, W, Z, discrete=plant.discrete)
            return DisturbanceCertificate.settle(positivity=positivity, x=inside, gamma=gamma)

        return accept(plant, F, rate=rate, also=bounded)

    found = first_proven(points(), prove)
    if found is None:
        return undecided("a gain was found, but could not be proven.", objective=LINF_GAIN, limit=best)
    return succeed(plant, found, LINF_GAIN, found.certificate.others[-1].gamma, best)  # type: ignore[attr-defined]


class _Rows:
    """The inequalities of the module's head over x = (xi, z), for E, G, H, D in doubles."""

    def __init__(self, design: SimplicialProgram, rate: float, data: tuple[Floats, ...]) -> None:
        E, G, H, D = data
        plant, n = design.plant, design.n
        self.design, self.n = design, n
        self.push = (plant.facets @ E).sum(axis=1) / np.einsum("ij,ij->i", plant.facets, plant.rays)
        i, k = (index.ravel() for index in np.indices((len(G), n)))
        self.outputs = column_rows((G @ plant.rays.T)[i, k], H[i], k, n)
        self.total = np.hstack([G @ plant.rays.T, np.tile(H, (1, n))])
        self.through = D.sum(axis=1)
        self.fixed, self.drift = design.fixed(None), design.decreasing(rate)

    def program(self, shift: Floats | float = 0.0) -> Program:
        """Invariance (by -shift), z in its orthant, and (A + B F) x + E 1 < 0."""
        low = np.full(self.fixed.shape[1], -np.inf)
        low[: self.n] = 1e-6
        program = Program(x=Block(len(low), low=low))
        program.below(shift, x=self.fixed)
        program.above(0.0, x=self.outputs)
        program.below(-self.push, x=self.drift)
        return program

    def small(self, gamma: float, x: Floats, lp: Solver) -> Floats | None:
        """The smallest largest entry of |F x_k| at this gamma, with the weights xi of x and a little margin."""
        closed, slope = self.design.closed, self.design.slope
        scaled = scaled_rows(slope, 1 / np.tile(np.repeat(x[: self.n], self.design.m), 2))
        margin = np.zeros(self.fixed.shape[0])
        margin[: closed.shape[0]] = 1e-7 * (abs(closed) @ np.abs(x))

        def solve(strength: float) -> Floats | None:
            program = self.program(-strength * margin)
            program.add(largest=Block(1, low=0.0, cost=1.0))
            program.below(gamma - self.through - 1e-6 * abs(gamma), x=self.total)
            program.below(0.0, x=scaled, largest=-np.ones(scaled.shape[0]))
            answer = program.solve(lp)
            return answer["x"] if answer and (answer["x"][: self.n] > 0).all() else None

        return next((point for strength in (1.0, 1e-2, 0.0) if (point := solve(strength)) is not None), None)
