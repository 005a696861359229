"""The two linear programs of the paper, section V.A, for reference.

First F with  h_i'(A + B F) x_k >= 0 for incident pairs and  -h_i'(A + B F) x_k > 0 for the others (on a
simplicial cone: i = k); then v = sum a_i h_i, a > 0, with v'(A + B F) x_k < 0.  The first step does not know of
the second: which F it returns decides whether there is such a v.
"""

from __future__ import annotations

import numpy as np

from ...exact.program import Solver
from ..accept import accept, succeed, undecided
from ..plant import Plant
from ..polyhedral.program import GainProgram
from ..result import DesignResult
from .ratio import stacked

FIRST_FOUND = "sum of h_i'(A + B F)x_k, in the first step; max |F x_k| at the generators of X"
# Bound on |F x_k| if none is given, relative to the sizes of A and B.
_BOX = 20.0


def design_in_two_steps(plant: Plant, rate: float, lp: Solver) -> DesignResult:
    """The reference method: fails where the one-shot program succeeds."""
    program = GainProgram(plant, lp)
    i, k = np.nonzero(~np.asarray(plant.X.incidence, dtype=bool)[plant.facet_order])
    rows, constants = [], []
    for drift, (_, B) in zip(program.drifts, plant.pairs, strict=True):
        rows.append(program.coefficients((plant.facets @ B)[i], k))
        constants.append((plant.facets @ drift @ plant.rays.T)[i, k])
    inner, constant = stacked(*rows), np.concatenate(constants)
    height = (plant.facets @ plant.rays.T)[i, k]
    need = np.tile((rate + program.strict) * height, len(plant.pairs))
    every, at = (index.ravel() for index in np.indices((len(plant.facets), len(plant.rays))))
    total = sum(program.coefficients((plant.facets @ B)[every], at).sum(axis=0) for _, B in plant.pairs)
    first = program.invariant(_BOX * program.unit, cost=np.asarray(total, dtype=float))
    first.below(-constant - need, gain=inner)
    answer = first.solve(lp)
    if not answer:
        return undecided("the first program of the two-step method has no solution.", plant)
    found = accept(plant, program.fill(answer["gain"]), rate=rate)
    if found is None:
        return undecided(
            "the first program gave a gain for which the second has no solution; the one-shot method may still "
            "succeed.",
            plant,
        )
    size = plant.gain_of(found.F)
    return succeed(plant, found, FIRST_FOUND, size, size)
