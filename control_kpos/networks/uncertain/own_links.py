"""Links of nodes to themselves, closed at every vertex, where this keeps mixtures what they are.

The closed node of `networks.own_links` is linear in (A, B) for given C, D, and in (A, C) for given B, D.  If both B and
C have vertices and D = 0, the mixture of (A, B, C)^s with weights w_s has, once its link W is closed,

    A + B W C = sum_{s,t} w_s w_t (A^s + B^s W C^t),    B = sum_{s,t} w_s w_t B^s,    C = sum_{s,t} w_s w_t C^t,

and is a mixture of the vertices (A^s + B^s W C^t, B^s, C^t) of all pairs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..conditions import same_numbers
from ..model import NetworkModel
from ..nodes import NodeStack
from ..own_links import own_links, own_links_closed
from .members import Vertices, counts

# Vertices of pairs that are made.
_MOST = 64


def closed_at_all(models: Vertices, lower: NetworkModel | None) -> tuple[Vertices, NetworkModel | None] | None:
    """The networks with links of nodes to themselves closed; None if there are none, or mixtures would change."""
    first = models[0]
    nodes = own_links(first)[0]
    touched = [bool(np.isin(index, nodes).any()) for index in first.members]
    if not nodes.size or not (lower is None or _same_links(first, lower, touched)):
        return None
    whole = models
    for g, s in enumerate(first.stacks):
        own = [m.stacks[g] for m in models]
        inputs, outputs, direct = (all(same_numbers(getattr(k, x), getattr(s, x)) for k in own) for x in "BCD")
        if not touched[g] or (direct and (inputs or outputs)):
            continue
        if not all(k.D.is_zero for k in own) or len(models) ** 2 > _MOST:
            return None
        whole = _pairs(models, touched)
        break
    closed = [_closed(m) for m in whole]
    low = None if lower is None else _closed(lower)
    if any(m is None for m in closed) or (lower is not None and low is None):
        return None
    return tuple(m for m in closed if m is not None), low


def _closed(model: NetworkModel) -> NetworkModel | None:
    """The network with own links closed, which remembers nothing of them."""
    found = own_links_closed(model)
    return None if found is None else NetworkModel(found.stacks, found.members, found.coupling, found.dt)


def _same_links(high: NetworkModel, low: NetworkModel, touched: list[bool]) -> bool:
    """True if own links, and B, C and D of nodes that have them, are in no range."""
    for a, b, known in zip(high.stacks, low.stacks, touched, strict=True):
        if known and not all(same_numbers(getattr(a, name), getattr(b, name)) for name in "BCD"):
            return False
    (i, k, values), (j, m, others) = own_links(high)[1], own_links(low)[1]
    return np.array_equal(i, j) and np.array_equal(k, m) and same_numbers(values, others)


def _pairs(models: Vertices, touched: list[bool]) -> Vertices:
    """The vertices of all pairs."""
    several, first = counts(models), models[0]
    known = dict[tuple[int, int, int], NodeStack]()

    def pair(g: int, s: int, t: int) -> NodeStack:
        s, t = min(s, several[g] - 1), min(t, several[g] - 1)
        own = models[s].stacks[g]
        key = (g, s, t) if touched[g] else (g, s, s)
        if key not in known:
            known[key] = replace(own, C=models[t].stacks[g].C) if touched[g] and t != s else own
        return known[key]

    size = range(len(models))
    stacks = (tuple(pair(g, s, t) for g in range(len(first.stacks))) for s in size for t in size)
    return tuple(NetworkModel(k, first.members, first.coupling, first.dt) for k in stacks)
