"""Plants that agree with the data and that no gain serves together.

The multipliers of a program of a gain are rows of plants, those that attain each bound.  A few plants made of them
exclude all gains as far as all plants do, if there is room; `decide` or `no_invariance` of `design.refusal` prove it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..design.plant import Plant
from ..design.refusal import decide, no_invariance
from ..exact.matrix import Matrix
from ..proof.certificate import Status
from ..systems.system import System
from .certificate import DataCertificate, ExcludingPlants, Place
from .plants import Search
from .program import Floats, Found, Unknowns, extreme

# Plants at most: each makes the exact program larger.
_PLANTS = 64
# How much larger or smaller an input is made, relative to the state.
_NEAR = 1e-4


def excluded(search: Search) -> DataCertificate | None:
    """The proof that no gain serves all plants that agree with the data, if it is found.

    On simplicial cones of positivity and a common e, on others of positivity alone.

    Parameters
    ----------
    search : Search
        With a plant in the middle.
    """
    simplicial, unknowns = search.data.X.is_simplicial, search.start()
    if simplicial:  # xi >= 1, so that the margin is negative where it cannot be positive
        states = np.arange(len(unknowns.low)) < len(search.x)
        unknowns = replace(unknowns, low=np.where(states, 1.0, -np.inf), high=np.full(len(states), np.inf))
    named = search.named(simplicial)
    free = replace(unknowns, price=0 * unknowns.price)
    found = search.joint(free, named, search.pairs, stable=simplicial, room=1.0)
    if found is None or found.rows is None or not found.margin < 0:
        return None
    worst, X = _worst(search, named, found.rows), search.data.X
    for more in (False, True):
        for rows in _nearby(search, unknowns, named, found) if more else ():
            worst += _worst(search, named, rows)
        plants = [search.inside(plant) for plant in worst[:_PLANTS]]
        pairs = tuple((M.T[: X.dim].T, M.T[X.dim :].T) for M in plants)
        plant = Plant(System.read(pairs[0], X=X, dt=search.data.discrete), pairs)
        refused = decide(plant, 0.0)[0] if simplicial else no_invariance(plant)
        if refused is not None:
            proof = DataCertificate.settle(**search.data.data(), witness=_used(pairs, refused.witness))
            return proof if proof.status is Status.REFUTED else None
    return None


def _nearby(search: Search, unknowns: Unknowns, named: list[Place], found: Found) -> Iterator[Floats]:
    """Rows of plants that attain the bounds where an input is a little larger, or smaller.

    What inputs do has to cancel exactly.  A row where it does is a mixture of vertices, and these are the vertices.
    """
    z = unknowns.fixed + unknowns.moved @ found.theta
    for j in range(search.data.X.dim, z.shape[1]):
        for step in (-_NEAR, _NEAR):
            moved = z.copy()
            moved[:, j] += step * np.abs(z).max(axis=1)
            rows = [extreme(search.samples, i, side, moved[k], search.lp)[2] for k, i, side in named]
            yield np.array([np.full(z.shape[1], np.nan) if row is None else row for row in rows])


def _worst(search: Search, named: list[Place], rows: Floats) -> list[Floats]:
    """For every generator, and e, as few plants as have the rows that attain the bounds of all facets."""
    place, central = {name: r for r, name in enumerate(named)}, search.central
    out: list[Floats] = []
    for k in range(len(search.x) + 1):
        started: list[dict[int, int]] = []
        for h in search.h:
            sides = {int(i): int((h[i] < 0) == (k < len(search.x))) for i in np.flatnonzero(h)}
            wanted = {i: place.get((k, i, side), -1) for i, side in sides.items()}
            wanted = {i: r for i, r in wanted.items() if r >= 0 and not np.isnan(rows[r]).any()}
            fits = (part for part in started if all(part.get(i, r) == r for i, r in wanted.items()))
            target = next(fits, None)
            if target is None:
                started.append(wanted)
            else:
                target |= wanted
        for part in started:
            plant = central.copy()
            for i, r in part.items():
                plant[i] = rows[r]
            out.append(plant)
    return out


def _used(pairs: tuple[tuple[Matrix, Matrix], ...], functionals: Any) -> ExcludingPlants:
    """Without the plants that the contradiction does not need."""
    d = functionals.d
    falls = np.zeros(len(pairs), bool) if d is None else (d.fractions() != 0).astype(bool).any(axis=0)
    kept = [s for s, L in enumerate(functionals.L) if falls[s] or not L.is_zero]
    own = replace(
        functionals,
        L=tuple(functionals.L[s] for s in kept),
        d=None if d is None else Matrix.from_fractions(d.fractions()[:, kept]),
    )
    return ExcludingPlants(tuple(pairs[s][0] for s in kept), tuple(pairs[s][1] for s in kept), own)
