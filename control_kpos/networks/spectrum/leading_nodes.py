"""The rightmost eigenvalue of a large network, from the few nodes its eigenvector lives on.

In a network of different nodes the rightmost eigenvectors are localised.  Two solves with the whole network
show where; the abscissa theta of a neighbourhood of these nodes is a lower bound (a principal part of a positive
network has no larger abscissa) that approaches the abscissa as the neighbourhood grows.  One more solve with the
whole network, at a shift a little above theta, shows that no other place has a larger one.  The result
is only a proposal for `bracket`, which proves both sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.distinct import distinct
from ..blocks import Floats, Index
from ..model import NetworkModel
from .descent import (
    Approach,
    Progress,
    descend,
    interior,
    is_inside,
    slow_state,
)
from .port_solves import PortSystem

# Smaller networks are better served by `descend` alone.
LEAST_NODES = 50_000
_TRIES = 3
# Steps along links to the edge of a neighbourhood; an eigenvector that reaches farther is not localised.
_STEPS = 1000


@dataclass
class Peak:
    """Both sides of a bracket, as vectors on the whole network: v in int X* falls, and A_cl x - rate x is in X."""

    v: Floats
    x: Floats
    rate: float


def localised_peak(model: NetworkModel, start: float, relative: float, progress: Progress | None = None) -> Peak | None:
    """Look for the abscissa near the largest entries of an early iterate.

    None if the network is small or its eigenvector not localised.
    """
    if model.n_nodes < LEAST_NODES:
        return None
    near = _first_steps(model, start, progress)
    if near is None:
        return None
    size = model.peaks(near.x)
    if size.max() <= 1.001 * np.median(size):  # equal nodes, equally connected
        return None
    links = _links(model)
    count = max(50, model.n_nodes // 2000)
    reach, seeds = model.n_nodes // 20, np.argpartition(size, -count)[-count:]
    mask = neighbourhood(links, seeds, reach)
    near = descend(model.restrict(mask), near.shift, relative=0.5 * relative)
    for _ in range(_TRIES):
        before = -np.inf
        while near is not None and near.theta - before > 0.1 * relative * abs(near.theta):
            before = near.theta
            if progress is not None:
                progress(f"spectral abscissa about {before:.9g}, from {np.count_nonzero(mask)} nodes")
            size = model.peaks(model.lifted(mask, near.x))
            mask = neighbourhood(links, np.flatnonzero(size >= 0.1 * size.max()), reach)
            near = descend(model.restrict(mask), before + 1e-4 * abs(before), relative=0.5 * relative)
            reach *= 2
        if near is None or reach > model.n_nodes:
            return None
        v = _falling(model, near.theta + 0.45 * relative * abs(near.theta))
        slow = None if v is None else slow_state(model.restrict(mask), near, relative)
        if v is not None and slow is not None:
            return Peak(v, model.lifted(mask, slow[0]), slow[1])
    return None


def _first_steps(model: NetworkModel, start: float, progress: Progress | None) -> Approach | None:
    """The second iterate of the descent, or None if it agrees with the first: then nothing is localised."""
    seen: list[Approach] = []

    def second(at: Approach) -> bool:
        seen.append(at)
        return len(seen) == 2

    found = descend(model, start, stop=second, progress=progress)
    if found is None or len(seen) < 2 or abs(seen[1].theta - seen[0].theta) <= 1e-4 * abs(found.theta):
        return None
    return found


def neighbourhood(links: sp.csr_array, seeds: Index, reach: int) -> NDArray[np.bool_]:
    """The nodes around the seeds, breadth first, up to `reach` nodes and `_STEPS` links away, as a mask."""
    mask = np.zeros(links.shape[0], dtype=bool)
    mask[seeds] = True
    front, count = seeds, len(seeds)
    for _ in range(_STEPS):
        reached = distinct(links[front].indices)
        front = reached[~mask[reached]]
        count += front.size
        if not front.size or count > reach:
            break
        mask[front] = True
    return mask


def _links(model: NetworkModel) -> sp.csr_array:
    """Which nodes hear or are heard by which, symmetric."""
    W = model.W.tocoo()
    j, k = model.owners(1)[W.row], model.owners(2)[W.col]
    n = model.n_nodes
    one_way = sp.csr_array((np.ones(len(j), dtype=bool), (j, k)), shape=(n, n))
    return sp.csr_array(one_way + one_way.T)


def _falling(model: NetworkModel, shift: float) -> Floats | None:
    """v in the interior of X* with (A_cl - shift I)'v in minus that interior, or None."""
    v, _, reached = PortSystem(model, shift).dual(interior(model, dual=True), 1e-6, near=True)
    return v if is_inside(model, v, dual=True) and is_inside(model, reached, dual=True) else None
