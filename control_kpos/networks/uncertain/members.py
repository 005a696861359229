"""Members of an uncertain network, and mixtures: columns of the vertices, in coordinates of the generators.

A network with vertices is a tuple of networks that share cones, numbers of nodes and links: network s has vertex s of
every node.  A member takes one vertex for each node.  A mixture takes one vertex for each generator x_i of X_j, for the
column (A x_i, C x_i), and for each generator u_i of U_j, for (B u_i, D u_i); it need not be a member.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from ...cones import Cone, Orthant
from ...exact.matrix import Matrix
from ..blocks import Floats, Index
from ..model import BLOCKS, NetworkModel
from ..nodes import NodeStack, UncertainStack, vertices_of

Vertices: TypeAlias = "tuple[NetworkModel, ...]"


def spread(model: NetworkModel) -> Vertices:
    """The networks of the vertices of all nodes; a node with fewer of them than another has its last one again."""
    count = max(len(vertices_of(s)) for s in model.stacks)
    return tuple(_at(model, s) for s in range(count))


def _at(model: NetworkModel, vertex: int) -> NetworkModel:
    stacks = []
    for s in model.stacks:
        own = vertices_of(s)
        plain = own[min(vertex, len(own) - 1)]
        stacks.append(plain if plain is s or vertex else replace(plain, names=s.names, labels=s.labels))
    return NetworkModel(tuple(stacks), model.members, model.coupling, model.dt)


def lower_ends(model: NetworkModel, coupling: Matrix) -> NetworkModel | None:
    """The network of the lower ends of all ranges, with the first vertices elsewhere; None if there are none."""
    own = [s.lower if isinstance(s, UncertainStack) else None for s in model.stacks]
    if coupling is model.coupling and not any(own):
        return None
    stacks = (vertices_of(s)[0] if low is None else low for s, low in zip(model.stacks, own, strict=True))
    return NetworkModel(tuple(stacks), model.members, coupling, model.dt)


def transposed(models: Sequence[NetworkModel]) -> Vertices:
    """The networks (A', C', B', D')_j, W' on X*, Y*, U*: Theorem 4 for them is a proof by e = v, y = r and u = -q."""
    stacks: dict[int, NodeStack] = {}
    links: dict[int, Matrix] = {}

    def turned(s: NodeStack) -> NodeStack:  # the same object for the same vertex, see `counts`
        if id(s) not in stacks:
            stacks[id(s)] = s.transposed
        return stacks[id(s)]

    out = []
    for m in models:
        W = links.setdefault(id(m.coupling), m.coupling.T)
        out.append(NetworkModel(tuple(map(turned, m.stacks)), m.members, W, m.dt))
    return tuple(out)


def counts(models: Sequence[NetworkModel]) -> list[int]:
    """How many vertices the nodes of every stack have: after these, stacks repeat."""
    own = [[model.stacks[g] for model in models] for g in range(len(models[0].stacks))]
    return [1 + max((s for s in range(1, len(k)) if k[s] is not k[s - 1]), default=0) for k in own]


def member(models: Sequence[NetworkModel], choice: Index) -> NetworkModel:
    """The network in which node j has vertex choice[j]."""
    first = models[0]
    stacks = []
    for g, index in enumerate(first.members):
        chosen = choice[index]
        if chosen.size and (chosen == chosen[0]).all():
            own = models[chosen[0]].stacks[g]
            stacks.append(replace(own, names=first.stacks[g].names, labels=first.stacks[g].labels))
            continue
        data = {name: _picked([getattr(m.stacks[g], name) for m in models], chosen) for name in BLOCKS}
        stacks.append(replace(first.stacks[g], **data))
    return NetworkModel(tuple(stacks), first.members, first.coupling, first.dt)


def _picked(parts: list[Matrix], chosen: Index) -> Matrix:
    """Matrix chosen[j] of node j."""
    if all(part is parts[0] for part in parts):
        return parts[0]
    if all(part.is_double for part in parts):
        out = np.array(parts[0].values)
        for s, part in enumerate(parts[1:], 1):
            out[chosen == s] = part.values[chosen == s]
        return Matrix(out)
    return Matrix.join(parts, 0)[chosen * parts[0].shape[0] + np.arange(len(chosen))]


@dataclass(frozen=True, eq=False)
class Mixture:
    """One vertex for every generator.

    Attributes
    ----------
    states, inputs : list of ndarray of int, shapes (N, p)
        For each stack, those of the generators of X and of U.
    """

    states: list[Index]
    inputs: list[Index]

    @classmethod
    def of_vertex(cls, model: NetworkModel, vertex: int = 0) -> Mixture:
        """A vertex as it is."""
        kinds = ([np.full((len(s), cone.n_rays), vertex) for s, cone in _with(model, k)] for k in ("X", "U"))
        return cls(*kinds)

    def majority(self, model: NetworkModel, count: int) -> Index:
        """The vertex that most generators of X of every node take."""
        out = np.zeros(model.n_nodes, dtype=np.intp)
        for index, chosen in zip(model.members, self.states, strict=True):
            out[index] = np.argmax([(chosen == s).sum(axis=1) for s in range(count)], axis=0)
        return out

    def network(self, models: Sequence[NetworkModel]) -> NetworkModel:
        """The mixture as a network, in floating point; exact for orthants."""
        first, stacks = models[0], []
        for g, s in enumerate(first.stacks):
            data: dict[str, Any] = {}
            for names, cone, chosen in (("AC", s.X, self.states[g]), ("BD", s.U, self.inputs[g])):
                for name in names:
                    data[name] = _columns([getattr(m.stacks[g], name) for m in models], cone, chosen)
            stacks.append(NodeStack(**data, X=s.X, U=s.U, Y=s.Y, dt=s.dt))
        return NetworkModel(tuple(stacks), first.members, first.coupling, first.dt)


def _with(model: NetworkModel, kind: str) -> list[tuple[NodeStack, Cone]]:
    return [(s, getattr(s, kind)) for s in model.stacks]


def _columns(parts: list[Matrix], cone: Cone, chosen: Index) -> Matrix:
    """The matrices that map generator i to what matrix chosen[j, i] of node j maps it to."""
    values: list[Floats] = [part.values for part in parts]
    if all(v is values[0] for v in values):
        return Matrix(values[0])
    rays = None if isinstance(cone, Orthant) else np.asarray(cone.rays)
    if rays is not None:
        values = [v @ rays.T for v in values]
    out = np.array(values[0])
    for s, v in enumerate(values[1:], 1):
        np.copyto(out, v, where=(chosen == s)[:, None, :])
    return Matrix(out if rays is None else out @ np.linalg.inv(rays.T))
