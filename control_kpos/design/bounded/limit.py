"""The smallest gain within hard bounds: that none is smaller is proven by exact multipliers, or it is not said."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import spend
from ...exact.program import alternative
from ..exact_rows import exact_geometry
from ..limits import no_smaller, proven_limit
from ..plant import Plant, leading_sizes
from ..refusal import EFFORT_PER_ENTRY

Rationals = NDArray[np.object_]


def limit_within(plant: Plant, rate: float, found: float) -> Callable[[], float]:
    """A bound on max |F x_k| below which no gain keeps the bounds of the plant; NaN if none is proven."""
    return partial(proven_limit, partial(_none_within, plant, rate), found, -1)


def _none_within(plant: Plant, rate: float, bound: float) -> bool:
    """Proven: no F with |F x_k| <= bound at the generators keeps the bounds, or none without them has the rate."""
    return _contradicted(plant, bound) or no_smaller(replace(plant, interval=None), rate, bound)


def _contradicted(plant: Plant, bound: float) -> bool:
    """Proven: no F with |F x_k| <= bound at the generators keeps X, [0, x_max] and |F x| <= u_max on it.

    The rows are those of `gains` over F, a_i and 1, on every cone.
    """
    bounds = plant.interval
    if bounds is None or bounds.x_max is None:
        return False
    x, w = bounds.x_max.fractions(), bounds.w_max.fractions()
    u = [] if bounds.u_max is None else bounds.u_max.fractions()
    blocks = [*_kept(plant, x, w), *_small(plant, bound), *_covered(plant, x, u)]
    covers = max(cover.shape[1] for _, cover, _ in blocks)
    rows = np.concatenate([_beside(gain, cover, constant, covers) for gain, cover, constant in blocks])
    free = np.ones(plant.n * plant.m, dtype=bool) if plant.pattern is None else plant.pattern.ravel()
    rows = rows[:, np.append(free, np.ones(covers + 1, dtype=bool))]
    one = np.zeros((1, rows.shape[1]), dtype=object)
    one[0, -1] = 1
    spend(EFFORT_PER_ENTRY * rows.size)
    return alternative(np.concatenate([rows, one]), np.arange(len(rows) + 1) == len(rows))[0] is not None


def _beside(gain: Rationals, cover: Rationals, constant: Rationals, covers: int) -> Rationals:
    none = np.zeros((len(gain), covers - cover.shape[1]), dtype=object)
    return np.concatenate([gain, cover, none, constant[:, None]], axis=1)


def _kept(plant: Plant, x: Rationals, w: Rationals) -> Iterator[tuple[Rationals, Rationals, Rationals]]:
    """h'(A + B F) x_k >= 0, and -h'((A + B F) x_max + w_max) >= 0 (A - I in discrete time)."""
    facets, rays = exact_geometry(plant)
    j, k = np.nonzero(plant.incidence)
    for A, B in plant.vertices:
        left, pushed = facets @ A.fractions(), facets @ B.fractions()
        yield _of_gain(pushed[j], rays[k]), _none(len(j)), (left[j] * rays[k]).sum(axis=1)
        moved = left @ x - int(plant.discrete) * (facets @ x) + facets @ w
        yield -_of_gain(pushed, np.tile(x, (len(facets), 1))), _none(len(facets)), -moved


def _small(plant: Plant, bound: float) -> Iterator[tuple[Rationals, Rationals, Rationals]]:
    """|F_i x_k| <= bound times the size of the leading entry."""
    _, rays = exact_geometry(plant)
    units, most = np.eye(plant.m, dtype=int).astype(object), leading_sizes(rays) * Fraction(bound)
    rows = np.concatenate([_of_gain(np.tile(unit, (len(rays), 1)), rays) for unit in units])
    for side in (1, -1):
        yield side * rows, _none(len(rows)), np.tile(most, plant.m)


def _covered(plant: Plant, x: Rationals, u_max: Any) -> Iterator[tuple[Rationals, Rationals, Rationals]]:
    """a_i and a_i - F_i in X*, and at most u_i at x_max."""
    _, rays = exact_geometry(plant)
    for unit, u in zip(np.eye(plant.m, dtype=int).astype(object), u_max, strict=False):
        for points, side, constant in ((rays, 1, 0), (x[None], -1, u)):
            rows = side * _of_gain(np.tile(unit, (len(points), 1)), points)
            for taken in (0, 1):
                yield -taken * rows, rows, np.full(len(rows), constant, dtype=object)


def _of_gain(left: Rationals, right: Rationals) -> Rationals:
    """Coefficients of l'F x over the entries of F, a row for each pair."""
    return (left[:, :, None] * right[:, None, :]).reshape(len(left), left.shape[1] * right.shape[1])


def _none(rows: int) -> Any:
    return np.zeros((rows, 0), dtype=object)
