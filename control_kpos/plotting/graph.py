"""Places in the plane for the nodes of a graph, so that distances resemble numbers of links."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import shortest_path

from .figure import Points

_ROUNDS = 150


def graph_layout(links: sp.csr_array) -> Points:
    """Coordinates of the nodes, shape (N, 2), by stress majorisation from classical scaling.

    Minimises the sum over pairs of (distance - number of links between)^2; every round is one step of
    SMACOF with unit weights.  Dense in the number of nodes: for graphs that a person can look at.
    """
    n_nodes = links.shape[0]
    if n_nodes == 1:
        return np.zeros((1, 2))
    hops = shortest_path(abs(links), directed=False, unweighted=True)
    near = np.isfinite(hops)
    hops[~near] = hops[near].max(initial=1.0) + 2  # parts without links between them stand apart
    centred = hops**2 - (hops**2).mean(axis=0) - (hops**2).mean(axis=1)[:, None] + (hops**2).mean()
    values, vectors = np.linalg.eigh(-centred / 2)
    xy = vectors[:, -1:-3:-1] * np.sqrt(np.maximum(values[-1:-3:-1], 1e-3))
    # nodes with the same neighbours would stay on top of each other
    xy = xy + 1e-3 * np.random.default_rng(0).standard_normal(xy.shape)
    for _ in range(_ROUNDS):
        far = np.linalg.norm(xy[:, None, :] - xy[None, :, :], axis=2)
        ratio = np.where(far > 1e-9, hops / np.maximum(far, 1e-9), 0.0)
        xy = (ratio.sum(axis=1)[:, None] * xy - ratio @ xy) / n_nodes
    return xy
