"""The search for proofs that no gain exists, in rational arithmetic; see `contradiction`."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ..exact.budget import affords, spend
from ..exact.matrix import Matrix
from ..exact.program import alternative
from .contradiction import Multipliers, NoFeedback, NoInvariance, PairMultipliers
from .exact_rows import exact_geometry, exact_inequalities, homogeneous_rows
from .plant import Plant
from .simplicial.inequalities import Inequalities, gain_from_columns
from .simplicial.repair import repaired_multipliers

Rationals = NDArray[np.object_]


# Operations of a decision in rational arithmetic, for each entry of its rows, and of the check of its multipliers.
EFFORT_PER_ENTRY, _EFFORT_TO_CHECK = 3e4, 1e4
# Operations of a product of fractions, of data as they are given and with facets that have thousands of digits.
_EFFORT_PER_PRODUCT = 1e4, 9e4


def _entries(plant: Plant) -> int:
    """About as many as `exact_inequalities` has."""
    n, m = plant.n, plant.m
    rows = n * n * len(plant.vertices) + (0 if plant.gain_bound is None else 2 * n * m)
    return (rows + (plant.system.Y.n_facets * n if plant.ports else 0)) * n * (1 + m)


def decide(plant: Plant, rate: float) -> tuple[NoFeedback | None, NDArray[np.float64] | None]:
    """Exactly one of a proof that no gain exists and a gain, rounded to doubles; neither if that takes too long.

    A gain beyond the range of doubles is infinite.
    """
    free = plant.free
    entries, long = _entries(plant), plant.X.exact_facets.integer_rows is not None
    products = len(plant.vertices) * plant.n**3 * _EFFORT_PER_PRODUCT[long]
    if free is None or not affords(entries * EFFORT_PER_ENTRY + products):
        return None, None
    spend(entries * EFFORT_PER_ENTRY + products)
    q = exact_inequalities(plant)
    rows, kept = homogeneous_rows(q, rate, plant.discrete, free)
    strict = np.arange(len(rows)) >= len(q.closed)
    owner = np.concatenate([np.arange(q.n), np.repeat(np.arange(q.n), q.m)])[kept]
    multipliers, solution = repaired_multipliers(rows, owner, q.n, strict), None
    if multipliers is None:
        multipliers, solution = alternative(rows, strict)
    if multipliers is None:
        return None, None if solution is None else _gain(plant, q, solution, kept)
    if not affords(entries * _EFFORT_TO_CHECK + products):
        return None, None
    groups = np.split(multipliers, np.cumsum([len(q.closed), len(q.drift)]))
    certificate = NoFeedback.refuted(
        A=tuple(A for A, _ in plant.vertices),
        B=tuple(B for _, B in plant.vertices),
        X=plant.X,
        discrete=plant.discrete,
        rate=rate,
        gain_bound=plant.gain_bound,
        free=free.astype(float),
        coupling=plant.coupling,
        ports=(*plant.system.matrices[2:], plant.system.Y) if plant.ports else None,
        leading=True,
        witness=Multipliers(*(tuple(group) for group in groups)),
    )
    return certificate, None


def _gain(plant: Plant, q: Inequalities, solution: Rationals, kept: NDArray[np.intp]) -> NDArray[np.float64]:
    """F of an exact solution (xi, z) over integer generators."""
    x = np.full(q.size, Fraction(0), dtype=object)
    x[kept] = solution
    try:
        G = (x[q.n :].reshape(q.n, q.m) / x[: q.n, None]).T.astype(float)
        return gain_from_columns(G, exact_geometry(plant)[1].astype(float))
    except OverflowError:
        return np.full((q.m, q.n), np.inf)


def no_invariance(plant: Plant) -> NoInvariance | None:
    """The proof, if there is one within reach of exact arithmetic within the time limit."""
    pattern = np.ones(plant.shape) if plant.pattern is None else plant.pattern.astype(float)
    data = {
        "A": tuple(A for A, _ in plant.vertices),
        "B": tuple(B for _, B in plant.vertices),
        "R": Matrix.identity(plant.n) if plant.reads is None else plant.reads,
        "pattern": pattern,
        "X": plant.X,
        "discrete": plant.discrete,
    }
    entries = np.prod(plant.X.incidence.shape) * len(plant.vertices) * (1 + pattern.sum())
    if not affords(entries * EFFORT_PER_ENTRY):
        return None
    spend(entries * EFFORT_PER_ENTRY)
    rows = NoInvariance(**data).rows()
    weights, _ = alternative(rows, np.arange(len(rows)) == len(rows) - 1)
    if weights is None or not affords(entries * _EFFORT_TO_CHECK):
        return None
    return NoInvariance.refuted(**data, witness=PairMultipliers(tuple(weights[:-1])))
