"""Limits of designs: that no gain does better is proven by exact multipliers, or it is not said.

A smallest gain g or a largest rate is found in floating point; a little below g, or above the rate, the inequalities of
`exact_rows` are contradicted by Farkas' lemma.  Limits are proven when they are first read, with little effort.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from ..exact.budget import OutOfBudgetError, affords, budget, spend
from ..exact.program import alternative
from ..proof.certificate import Status
from .exact_rows import exact_geometry, exact_inequalities, homogeneous_rows
from .plant import Plant
from .refusal import EFFORT_PER_ENTRY, decide
from .running import EFFORT
from .simplicial.inequalities import output_rows

# Part of the gap by which a gain exceeds the smallest one found; the rest is for the distance to a proven limit.
REACHED = 0.7
# How far from the limit in floating point a proven one may be, relative to it, tried in turn; and, for gaps below
# a thousandth, relative to the gap.
_APART, _APART_IN_GAP = (1e-5, 1e-4, 2.9e-4, 1e-3, 3e-3, 1e-2), (0.01, 0.1, 0.29)


def gain_limit(plant: Plant, rate: float, found: float) -> Callable[[], float]:
    """A bound on max |F x_k| below which no gain meets the demands; NaN if none is proven."""
    return partial(proven_limit, partial(no_smaller, plant, rate), found, -1, gap=plant.gap)


def rate_limit(plant: Plant, found: float) -> Callable[[], float]:
    """A decay rate above which no gain gets; NaN if none is proven."""
    return partial(proven_limit, partial(refused_at, plant), found, 1)


def disturbance_limit(plant: Plant, found: float) -> Callable[[], float]:
    """An L-infinity gain from w to z below which no gain gets; NaN if none is proven."""
    return partial(proven_limit, partial(_no_smaller_gain, plant), found, -1, gap=plant.gap)


def proven_limit(
    refused: Callable[[float], bool], found: float, side: int, effort: str = "a limit", gap: float = 1e-3
) -> float:
    """The number closest to the one found that `refused` proves to be a limit, from below (side -1) or above (1)."""
    if not np.isfinite(found):
        return found
    if side < 0 and found <= 0:
        return 0.0  # no size is smaller
    with suppress(OutOfBudgetError), budget(EFFORT[effort]), np.errstate(all="ignore"):
        for apart in sorted({*_APART, *(min(gap, 1e-3) * part for part in _APART_IN_GAP)}):
            if not affords():
                break
            if refused(found * (1 + side * apart)):
                return found * (1 + side * apart)
    return float("nan")


def refused_at(plant: Plant, rate: float) -> bool:
    """Proven: no gain has a decay rate above this one."""
    proof = decide(plant, rate)[0]
    return proof is not None and proof.status is Status.REFUTED


def no_smaller(plant: Plant, rate: float, bound: float) -> bool:
    """Proven: no gain whose max |F x_k| is at most the bound meets the demands."""
    own = np.inf if plant.gain_bound is None else plant.gain_bound
    return refused_at(replace(plant, gain_bound=np.minimum(own, np.full(plant.m, bound))), rate)


def _no_smaller_gain(plant: Plant, gamma: float) -> bool:
    """Proven: no F and x in int X have (A + B F) x + E 1 < 0, (G + H F) x + D 1 < gamma 1, (G + H F) X in the orthant.

    The rows are those of `disturbance.DisturbanceProgram`, over (xi, z, w) with 1 w, w > 0 for 1: homogeneous.  A decay
    rate is left out: a gain may have it by another vector than this x.
    """
    E, G, H, D = (M.fractions() for M in plant.disturbance)  # type: ignore[union-attr]
    facets, rays = exact_geometry(plant)
    q = exact_inequalities(plant)
    inside = output_rows(G, H, np.eye(len(G), dtype=int).astype(object), rays)[0]
    rows, kept = homogeneous_rows(q.with_closed(inside, ()), 0.0, plant.discrete, plant.free)  # type: ignore[arg-type]
    spend(EFFORT_PER_ENTRY * (len(rows) + len(G)) * (len(kept) + 1))
    total = np.concatenate([G @ rays.T, np.tile(H, (1, plant.n))], axis=1)[:, kept]
    closed, falls, positive = np.split(rows, np.cumsum([len(q.closed) + len(inside), len(q.drift)]))
    strict = [
        _beside(falls, np.tile(-(facets @ E).sum(axis=1), len(plant.vertices))),
        _beside(-total, Fraction(gamma) - D.sum(axis=1)),
        _beside(positive, np.zeros(len(positive), dtype=int)),
        np.append(np.zeros(len(kept), dtype=int), 1).astype(object)[None],
    ]
    rows = np.concatenate([_beside(closed, np.zeros(len(closed), dtype=int)), *strict])
    return alternative(rows, np.arange(len(rows)) >= len(closed))[0] is not None


def _beside(rows: Any, column: Any) -> Any:
    return np.concatenate([rows, np.asarray(column, dtype=object)[:, None]], axis=1)
