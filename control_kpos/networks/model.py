"""A network: nodes x_j' = A_j x_j + B_j u_j, y_j = C_j x_j + D_j u_j and the coupling u = W y + w.

         w_j --->(+)---> [ node j ] ---> y_j
                  ^                       |
                  |      coupling W       |
                  +-----------------------+

Nodes of one size and with the same cones stand in stacked arrays, so that nothing here loops over nodes.
The closed loop is x' = (A + B L C) x + ..., with L = (I - W D)^{-1} W.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from control import StateSpace
from numpy.typing import NDArray

from ..cones import Cone
from ..errors import DataError, KposError, ShapeError, TimebaseError
from ..exact.intake import items
from ..exact.matrix import Matrix
from ..exact.rows import frozen
from ..proof.encoding import register_record
from ..systems.statespace import ConeStateSpace
from .blocks import Floats, Index, apply, block_diagonal, read_only
from .nodes import NodeStack, Timebase, UncertainStack

# Doubles, or fractions.
Number = TypeVar("Number", bound=np.generic)

# Which signals the rows and columns of the matrices of a node belong to: states (0), inputs (1) or outputs (2).
BLOCKS = {"A": (0, 0), "B": (0, 1), "C": (2, 0), "D": (2, 1)}
# Signals of networks with at most this many nodes carry names.
READABLE = 10_000


@dataclass(frozen=True, eq=False)
class Halo:
    """Nodes elsewhere in a larger network that links of these nodes lead to; nothing else is known of them here.

    Attributes
    ----------
    cones : tuple of Cone
        The input cones that occur among them.
    kinds : ndarray of int
        The place in `cones` of the input cone of every such node.
    """

    cones: tuple[Cone, ...]
    kinds: Index


@dataclass(frozen=True, eq=False)
class Receivers:
    """Whom the rows of the coupling belong to: these nodes, then those of the halo.

    Attributes
    ----------
    starts : ndarray of int
        The row where the inputs of each of them begin, and the number of rows.
    cones : tuple of Cone
        Input cones: those of the stacks, then those of the halo.
    kinds : ndarray of int
        The place of each of them in `cones`.
    """

    starts: Index
    cones: tuple[Cone, ...]
    kinds: Index

    @cached_property
    def owners(self) -> Index:
        """The receiver that every row of the coupling belongs to."""
        return frozen(np.repeat(np.arange(len(self.kinds)), np.diff(self.starts)))


@register_record
@dataclass(frozen=True, eq=False)
class NetworkModel:
    """Nodes in stacks, their numbers, and the coupling.

    The general form is a shard of a larger network: nodes, and the columns of W that leave them.  What Theorem 4 asks
    of these nodes needs nothing else but r at the inputs that they feed, which may be inputs of other nodes, the halo.
    A network in one piece has none.

    Attributes
    ----------
    stacks : tuple of NodeStack
    members : tuple of ndarray of int
        Node numbers, one array per stack; together 0, ..., N-1.
    coupling : Matrix, shape (sum m_j, sum q_k)
        W in u = W y + w; csr_array, or dense if the data are fractions.  The inputs of the halo are further rows.
    dt : float, bool or None
    origin : NetworkModel or None
        The network before the links of nodes to themselves were closed; see `own_links`.
    halo : Halo or None
        Receivers of links that are no nodes of this network.
    """

    stacks: tuple[NodeStack, ...]
    members: tuple[Index, ...]
    coupling: Matrix
    dt: Timebase = 0
    origin: NetworkModel | None = None
    halo: Halo | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(frozen(np.array(k, dtype=np.intp)) for k in self.members))
        if self.coupling.is_sparse:
            read_only(self.coupling.values)

    @cached_property
    def discrete(self) -> bool:
        return bool(self.dt)

    @cached_property
    def n_nodes(self) -> int:
        return sum(len(s) for s in self.stacks)

    @cached_property
    def has_feedthrough(self) -> bool:
        """True unless every D is exactly zero."""
        return not all(s.D.is_zero for s in self.stacks)

    @cached_property
    def offsets(self) -> tuple[Index, Index, Index]:
        """Places where the states, inputs and outputs of node j begin; N + 1 entries each."""
        out, count = [], self.n_nodes
        if self.is_ordered:
            x, u, y = (frozen(size * np.arange(count + 1)) for size in self.stacks[0].sizes)
            return x, u, y
        for kind in range(3):
            size = np.zeros(count, dtype=np.intp)
            for s, index in zip(self.stacks, self.members, strict=True):
                size[index] = s.sizes[kind]
            out.append(frozen(np.concatenate([[0], np.cumsum(size)])))
        return out[0], out[1], out[2]

    @cached_property
    def totals(self) -> tuple[int, int, int]:
        """All states, inputs and outputs."""
        x, u, y = (sum(len(s) * s.sizes[kind] for s in self.stacks) for kind in range(3))
        return x, u, y

    @cached_property
    def receiving(self) -> tuple[Cone, ...]:
        """Input cones: those of the stacks, then those of the halo."""
        return tuple(s.U for s in self.stacks) + (() if self.halo is None else self.halo.cones)

    @cached_property
    def receivers(self) -> Receivers:
        """Whom the rows of the coupling belong to."""
        if self.halo is None:
            return Receivers(self.offsets[1], self.receiving, self.home[0])
        sizes = np.array([cone.dim for cone in self.halo.cones], dtype=np.intp)[self.halo.kinds]
        starts = np.concatenate([self.offsets[1], self.totals[1] + np.cumsum(sizes)])
        kinds = np.concatenate([self.home[0], len(self.stacks) + self.halo.kinds])
        return Receivers(starts, self.receiving, kinds)

    @cached_property
    def received(self) -> tuple[Index, ...]:
        """Per cone of the receivers: places (N, m) of their inputs among the rows of the coupling."""
        to = self.receivers
        if self.halo is None:
            return tuple(places[1] for places in self.places)
        at = [to.starts[:-1][to.kinds == k][:, None] + np.arange(cone.dim) for k, cone in enumerate(to.cones)]
        return tuple(map(frozen, at))

    @cached_property
    def places(self) -> tuple[tuple[Index, Index, Index], ...]:
        """Per stack: places (N, n), (N, m), (N, q) of its signals in the vectors x, u, y."""
        return tuple(
            tuple(  # type: ignore[misc]
                frozen(self.offsets[kind][index][:, None] + np.arange(s.sizes[kind])) for kind in range(3)
            )
            for s, index in zip(self.stacks, self.members, strict=True)
        )

    @cached_property
    def is_ordered(self) -> bool:
        """True if one stack holds all nodes in their order."""
        return len(self.stacks) == 1 and bool((self.members[0] == np.arange(self.n_nodes)).all())

    def split(self, vector: Any, kind: int) -> list[Any]:
        """A vector of states (kind 0), inputs (1) or outputs (2), ndarray or Matrix, as (N, size), one per stack.

        Of inputs, those of the halo are left out.
        """
        if kind == 1 and self.halo is not None:
            vector = vector[: self.totals[1]]
        if self.is_ordered and isinstance(vector, np.ndarray):
            return [vector.reshape(self.n_nodes, -1)]
        if self.is_ordered and vector.is_double:
            return [Matrix(vector.values.reshape(self.n_nodes, -1))]
        return [vector[p[kind]] for p in self.places]

    def join(self, parts: Sequence[NDArray[Number]], kind: int) -> NDArray[Number]:
        """Inverse of `split`."""
        if self.is_ordered:
            return parts[0].reshape(-1)
        out: Any = np.zeros(self.totals[kind], dtype=parts[0].dtype)
        for part, p in zip(parts, self.places, strict=True):
            out[p[kind]] = part
        return out

    def times(self, name: str, x: Floats, *, transposed: bool = False, absolute: bool = False) -> Floats:
        """A x, B u, C x or D u of all nodes (transposed: A'v and so on; absolute: |A| x), without forming matrices."""
        stacks = [getattr(s, name).values for s in self.stacks]
        return self.apply(stacks, x, *BLOCKS[name], transposed=transposed, absolute=absolute)

    def apply(
        self,
        stacks: Sequence[Floats],
        x: Floats,
        rows: int,
        columns: int,
        *,
        transposed: bool = False,
        absolute: bool = False,
    ) -> Floats:
        """M_j x_j of every node, or |M_j| x_j, for matrices from signals of one kind to those of another."""
        if transposed:
            rows, columns = columns, rows
        parts = zip(stacks, self.split(x, columns), strict=True)
        return self.join([apply(m, part, transposed=transposed, absolute=absolute) for m, part in parts], rows)

    def at_all(self, vectors: Sequence[Floats], kind: int) -> Floats:
        """One vector of every stack, repeated for all of its nodes."""
        return self.join([np.tile(x, (len(s), 1)) for s, x in zip(self.stacks, vectors, strict=True)], kind)

    def peaks(self, x: Floats) -> Floats:
        """The largest absolute value of the states of every node."""
        out = np.zeros(self.n_nodes)
        for index, part in zip(self.members, self.split(x, 0), strict=True):
            out[index] = np.abs(part).max(axis=1, initial=0.0)
        return out

    def owners(self, kind: int) -> Index:
        """Node number of every state (kind 0), input (1) or output (2)."""
        return np.repeat(np.arange(self.n_nodes), np.diff(self.offsets[kind]))

    @cached_property
    def home(self) -> tuple[Index, Index]:
        """The stack of every node, and its place in it."""
        if self.is_ordered:
            return frozen(np.zeros(self.n_nodes, dtype=np.intp)), self.members[0]
        group, place = np.empty(self.n_nodes, dtype=np.intp), np.empty(self.n_nodes, dtype=np.intp)
        for g, index in enumerate(self.members):
            group[index], place[index] = g, np.arange(len(index))
        return frozen(group), frozen(place)

    def locate(self, node: int) -> tuple[int, int]:
        """Stack and place in it of a node."""
        if not 0 <= node < self.n_nodes:
            raise ShapeError(f"node {node} does not exist; the nodes are numbered 0 to {self.n_nodes - 1}.")
        return int(self.home[0][node]), int(self.home[1][node])

    def data_of(self, node: int) -> dict[str, Any]:
        """A, B, C, D, X, U, Y of a node, and whether time is discrete, by name."""
        g, place = self.locate(node)
        s = self.stacks[g]
        data = {name: getattr(s, name)[place] for name in BLOCKS}
        return {**data, "X": s.X, "U": s.U, "Y": s.Y, "discrete": self.discrete}

    def lifted(self, mask: NDArray[np.bool_], x: Floats) -> Floats:
        """States of the nodes of a mask, with zeros at the others."""
        out = np.zeros(self.totals[0])
        out[mask[self.owners(0)]] = x
        return out

    def blocks(self, blocks: Sequence[Floats], rows: int, columns: int) -> sp.csr_array:
        """Block-diagonal matrix from one stack of blocks per node stack."""
        parts = [(b, p[rows], p[columns]) for b, p in zip(blocks, self.places, strict=True)]
        return block_diagonal(parts, (self.totals[rows], self.totals[columns]))

    @cached_property
    def W(self) -> sp.csr_array:
        """The coupling in floating point."""
        return self.coupling.values if self.coupling.is_sparse else read_only(sp.csr_array(self.coupling.values))

    @cached_property
    def WT(self) -> sp.csr_array:
        return read_only(sp.csr_array(self.W.T))

    @cached_property
    def block_matrices(self) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array, sp.csr_array]:
        """Block-diagonal A, B, C, D of all nodes, sparse."""
        a, b, c, d = (
            read_only(self.blocks([getattr(s, name).values for s in self.stacks], *kinds))
            for name, kinds in BLOCKS.items()
        )
        return a, b, c, d

    def name_of(self, node: int) -> str:
        """The name of a node, or "node" and its number."""
        g, place = self.locate(node)
        names = self.stacks[g].names
        return f'node {node} ("{names[place]}")' if names else f"node {node}"

    @cached_property
    def names(self) -> list[str]:
        """Names of all nodes, made up as node[j] where none was given."""
        out = [""] * self.n_nodes
        for s, index in zip(self.stacks, self.members, strict=True):
            for place, j in enumerate(index.tolist()):
                out[j] = s.names[place] if s.names else f"node[{j}]"
        return out

    def signal_names(self, kind: int) -> list[str]:
        """Names of all states (kind 0), inputs (1) or outputs (2): node, underscore, signal."""
        prefix = "xuy"[kind]
        out = [""] * self.totals[kind]
        for s, index, places in zip(self.stacks, self.members, self.places, strict=True):
            for row, j in enumerate(index.tolist()):
                node = s.names[row] if s.names else f"node[{j}]"
                for i, place in enumerate(places[kind][row].tolist()):
                    label = s.labels[row][kind][i] if s.labels else f"{prefix}[{i}]"
                    out[place] = f"{node}_{label}"
        return out

    def restrict(self, keep: NDArray[np.bool_]) -> NetworkModel:
        """The nodes where `keep` is True and the links among them."""
        stacks, members = self.kept(keep, np.cumsum(keep) - 1)
        rows, columns = np.flatnonzero(keep[self.owners(1)]), np.flatnonzero(keep[self.owners(2)])
        if self.coupling.is_double:
            W = Matrix(sp.csr_array(self.W[rows][:, columns]))
        else:
            W = self.coupling[np.ix_(rows, columns)]
        return NetworkModel(tuple(stacks), tuple(members), W, self.dt)

    def kept(self, keep: NDArray[np.bool_], position: Index) -> tuple[list[NodeStack], list[Index]]:
        """Stacks of the nodes where `keep` is True, and their new numbers."""
        stacks, members = [], []
        for s, index in zip(self.stacks, self.members, strict=True):
            chosen = np.flatnonzero(keep[index])
            if chosen.size:
                stacks.append(s if chosen.size == len(s) else s.take(chosen))
                members.append(position[index[chosen]])
        return stacks, members

    def with_coupling(self, coupling: Matrix) -> NetworkModel:
        """The same nodes under another coupling."""
        return NetworkModel(self.stacks, self.members, coupling, self.dt)


def gather(
    systems: NodeStack | StateSpace | Iterable[NodeStack | StateSpace],
    name: str = "systems",
    *,
    uncertain: bool = False,
) -> tuple[tuple[NodeStack, ...], tuple[Index, ...], Timebase]:
    """Sort nodes into stacks of one size and equal cones; return stacks, node numbers and timebase.

    A plain StateSpace gets the nonnegative orthants as its cones.

    Raises
    ------
    ShapeError
        An empty network, or something that is not a node.
    DataError
        Nodes with vertices, unless `uncertain`.
    TimebaseError
        Nodes with different timebases.
    """
    given: list[Any] = [systems] if isinstance(systems, (NodeStack, StateSpace)) else items(systems, name)
    if not given:
        raise ShapeError(f"{name} is empty; a network needs at least one node.")
    dt: Timebase = None
    first: str | None = None
    groups: dict[Any, list[tuple[int, ConeStateSpace]]] = {}
    stacks: list[NodeStack] = []
    members: list[Index] = []
    count = 0
    for position, item in enumerate(given):
        if isinstance(item, UncertainStack) and not uncertain:
            place = name if item is systems else f"{name}[{position}]"
            raise DataError(
                f"{place} has vertices, but nodes have to be known exactly here. Give one of its vertices; "
                "feedback_interconnect takes all of them."
            )
        if isinstance(item, NodeStack):
            stacks.append(item)
            members.append(np.arange(count, count + len(item)))
        elif isinstance(item, StateSpace):
            item = _with_cones(item, f"{name}[{position}]")
            sizes, cones = (item.nstates, item.ninputs, item.noutputs), item.cones
            key = (*sizes, *map(id, cones), item._generic_name_check())
            groups.setdefault(key, []).append((count, item))
        else:
            raise ShapeError(
                f"{name}[{position}] is a {type(item).__name__}; give ConeStateSpace objects or the result of kp.stack."
            )
        if item.dt is not None:
            if first is not None and not same_timebase(dt, item.dt):
                raise TimebaseError(
                    f"{name}[{position}] has dt = {item.dt}, but {first} has dt = {dt}; bring all nodes to one "
                    "sampling time."
                )
            dt, first = (item.dt if first is None or dt is True else dt), first or f"{name}[{position}]"
        count += len(item) if isinstance(item, NodeStack) else 1
    for nodes in _merge_equal_cones(groups):
        stacks.append(_stacked([s for _, s in nodes], [j for j, _ in nodes]))
        members.append(np.array([j for j, _ in nodes], dtype=np.intp))
    return tuple(stacks), tuple(members), dt


def _with_cones(system: StateSpace, name: str) -> ConeStateSpace:
    """A system with cones; the nonnegative orthants for a plain one."""
    if isinstance(system, ConeStateSpace):
        return system
    try:
        return ConeStateSpace(system)
    except KposError as error:
        raise type(error)(f"{name}: {error}") from None


def _merge_equal_cones(groups: dict[Any, list[tuple[int, ConeStateSpace]]]) -> list[list[tuple[int, ConeStateSpace]]]:
    """Join groups whose cones are different objects but equal sets, without comparing all pairs."""
    merged: dict[Any, list[tuple[int, ConeStateSpace]]] = {}
    for key, nodes in groups.items():
        merged.setdefault((key[:3], *nodes[0][1].cones, key[-1]), []).extend(nodes)
    return list(merged.values())


def _stacked(systems: list[ConeStateSpace], numbers: list[int]) -> NodeStack:
    first = systems[0]
    read = {key: s.exact for key, s in {id(s): s for s in systems}.items()}  # often many times the same object
    exact = [read[id(s)] for s in systems]
    data = {name: Matrix.stack([getattr(s, name) for s in exact]) for name in "ABCD"}
    names = () if first._generic_name_check() else tuple(s.name for s in systems)
    labels = ()
    if len(systems) <= READABLE:
        labels = tuple((tuple(s.state_labels), tuple(s.input_labels), tuple(s.output_labels)) for s in systems)
    X, U, Y = first.cones
    return NodeStack(**data, X=X, U=U, Y=Y, dt=first.dt, names=names, labels=labels)


def same_timebase(a: Timebase, b: Timebase) -> bool:
    """True if systems with these timebases can be combined."""
    if a is None or b is None:
        return True
    if a is True or b is True:
        return bool(a) and bool(b)
    return a == b
