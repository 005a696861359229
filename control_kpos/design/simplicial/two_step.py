"""The two linear programs of the paper, section V.A, for reference.

First F with  h_i'(A + B F) x_k >= 0 for incident pairs and  -h_i'(A + B F) x_k > 0 for the others (on a
simplicial cone: i = k); then v = sum a_i h_i, a > 0, with v'(A + B F) x_k < 0.  The first step does not know of
the second: which F it returns decides whether there is such a v.
"""

from __future__ import annotations

import numpy as np

from ...proof.certificate import Status
from ..accept import accept
from ..modes import controllability_notes
from ..plant import Plant
from ..polyhedral.program import GainProgram
from ..result import DesignResult
from .program import gain_of
from .ratio import Solver
from .rows import stacked
from .search import succeed

FIRST_FOUND = "sum of h_i'(A + B F)x_k, in the first step; max |F x_k| at the generators of X"
# Bound on |F x_k| if none is given, relative to the sizes of A and B.
_BOX = 20.0


def design_in_two_steps(plant: Plant, rate: float, lp: Solver) -> DesignResult:
    """The reference method: fails where the one-shot program succeeds."""
    program = GainProgram(plant, lp)
    G, g = program.invariance
    bounds, right = program._bounds()
    i, k = np.nonzero(~np.asarray(plant.X.incidence, dtype=bool)[plant.facet_order])
    rows, constants = [], []
    for drift, (_, B) in zip(program.drifts, plant.pairs, strict=True):
        rows.append(program._coefficients((plant.facets @ B)[i], k))
        constants.append((plant.facets @ drift @ plant.rays.T)[i, k])
    inner, constant = stacked(*rows), np.concatenate(constants)
    height = (plant.facets @ plant.rays.T)[i, k]
    need = np.tile((rate + program.strict) * height, len(plant.pairs))
    right = np.minimum(right, _BOX * program.unit)
    every, at = (index.ravel() for index in np.indices((len(plant.facets), len(plant.rays))))
    total = sum(program._coefficients((plant.facets @ B)[every], at).sum(axis=0) for _, B in plant.pairs)
    answer = lp(
        np.asarray(total, dtype=float),
        stacked(-G, bounds, inner),
        np.concatenate([g, right, -constant - need]),
        bounds=(-np.inf, np.inf),
    )
    notes = tuple(controllability_notes(plant))
    if not answer:
        return DesignResult(
            Status.UNDECIDED, message="the first program of the two-step method has no solution.", notes=notes
        )
    F = program._fill(answer.x)
    found = accept(plant, F, rate=rate)
    if found is None:
        return DesignResult(
            Status.UNDECIDED,
            message="the first program gave a gain for which the second has no solution; "
            "the one-shot method may still succeed.",
            notes=notes,
        )
    size = gain_of(found.F, plant.rays)
    return succeed(plant, found, FIRST_FOUND, size, size)
