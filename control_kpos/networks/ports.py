"""Networks made of networks: their models side by side, with links between them, and the cones of what is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from control import common_timebase

from ..cones import Cone, Orthant
from ..cones.orthant import nonnegative
from ..cones.product import product
from ..errors import NotProperConeError, TooLargeError
from ..exact.matrix import Matrix
from ..systems.cones_of_connections import image, preimage
from ..systems.statespace import ConeStateSpace
from .blocks import Index
from .coupling import entries_of, from_entries
from .files import product_cone
from .model import NetworkModel, gather

# Signals up to which a selection that tears the cone of a node apart is made.
_MOST_TORN = 200


@dataclass(frozen=True, eq=False)
class Ports:
    """A network and those of its inputs and outputs that are seen from outside."""

    model: NetworkModel
    inputs: Index
    outputs: Index

    @classmethod
    def of(cls, system: Any) -> Ports:
        """Of a network, or of a system as a network of one node."""
        if hasattr(system, "model"):
            return cls(system.model, *system.external)
        stacks, members, dt = gather(system)
        model = NetworkModel(stacks, members, Matrix(sp.csr_array((system.ninputs, system.noutputs))), dt)
        return cls(model, np.arange(system.ninputs), np.arange(system.noutputs))


def with_gain(plant: Ports, K: Matrix) -> Ports:
    """The plant with u = r + K y."""
    rows, columns, values = entries_of(plant.model.coupling)
    i, k, links = entries_of(K)
    _, m, q = plant.model.totals
    W = from_entries([rows, plant.inputs[i]], [columns, plant.outputs[k]], [values, links], (m, q))
    return replace(plant, model=plant.model.with_coupling(W))


def beside(first: Ports, second: Ports, *links: tuple[bool, bool, Matrix]) -> tuple[NetworkModel, Ports]:
    """One model of both, and the second seen in it; `links` (from second, to second, weights) join their ports."""
    a, b = first.model, second.model
    _, m, q = a.totals
    moved = replace(second, inputs=second.inputs + m, outputs=second.outputs + q)
    parts = (first, moved)
    stacks = (*a.stacks, *b.stacks)
    names = [*a.names, *b.names]
    if not all(s.names for s in stacks) or len(set(names)) < len(names):
        stacks = tuple(replace(s, names=()) for s in stacks)
    members = (*a.members, *(index + a.n_nodes for index in b.members))
    entries = [entries_of(a.coupling), entries_of(b.coupling)]
    rows, columns = [entries[0][0], entries[1][0] + m], [entries[0][1], entries[1][1] + q]
    values = [entries[0][2], entries[1][2]]
    for source, target, weights in links:
        rows.append(parts[target].inputs)
        columns.append(parts[source].outputs)
        values.append(weights)
    W = from_entries(rows, columns, values, (m + b.totals[1], q + b.totals[2]))
    return NetworkModel(stacks, members, W, common_timebase(a.dt, b.dt)), moved


def port_cone(ports: Ports, kind: int) -> Cone:
    """The cone of the external inputs (kind 1) or outputs (2).

    For a part of the inputs of a node those that lie in its input cone with the others zero; for a part of its
    outputs what can be seen of its output cone.

    Raises
    ------
    NotProperConeError
        Of the cone of a node nothing proper is left.
    TooLargeError
        Signals of one node apart from each other, in a network with many.
    """
    model, chosen = ports.model, ports.inputs if kind == 1 else ports.outputs
    if all(isinstance((s.U, s.Y)[kind - 1], Orthant) for s in model.stacks):
        return nonnegative(len(chosen))
    whole = product_cone(model, kind)
    if np.array_equal(chosen, np.arange(whole.dim)):
        return whole
    owner = model.owners(kind)[chosen]
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    if len(set(owner[starts].tolist())) < len(starts):
        if whole.dim > _MOST_TORN:
            raise TooLargeError("signals of one node stand apart from each other; choose them next to each other.")
        return _part(whole, chosen, kind)
    runs = np.split(chosen, starts[1:])
    nodes = owner[starts].tolist()
    cones = [(model.stacks[model.locate(j)[0]].U, model.stacks[model.locate(j)[0]].Y)[kind - 1] for j in nodes]
    return product(
        [_part(C, run - int(model.offsets[kind][j]), kind) for C, run, j in zip(cones, runs, nodes, strict=True)]
    )


def _part(cone: Cone, chosen: Index, kind: int) -> Cone:
    if np.array_equal(chosen, np.arange(cone.dim)):
        return cone
    axes = np.eye(cone.dim)
    part = preimage(Matrix(axes[:, chosen]), cone) if kind == 1 else image(Matrix(axes[chosen]), cone)
    if part is None:
        what, name = ("inputs", "U") if kind == 1 else ("outputs", "Y")
        raise NotProperConeError(
            f"{name}: what is left of the cone of a node with {cone.dim} {what} is not proper; keep all {what} of it."
        )
    return part


def is_system_with_states(other: Any) -> bool:
    """True for what can be a node: a system with cones and at least one state."""
    return isinstance(other, ConeStateSpace) and other.nstates > 0
