"""Networks to be written: in memory, or made by an object part by part; in their order, or in pieces to be sorted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import ConeMismatchError, DataError
from ..exact.intake import exact_matrix, found, sparse_matrix, whole_number
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.coupling import entries_of, named_by_graph, read_coupling
from ..networks.model import NetworkModel, gather
from ..networks.nodes import NodeStack, Timebase
from .network import ranges

# Nodes that are asked for at a time, where those of a shard do not follow each other.
_PIECE = 250_000

Nodes = tuple[tuple[NodeStack, ...], tuple[Index, ...], Timebase]


class Source(Protocol):
    """A network of which nodes and links are asked for part by part.

    Attributes
    ----------
    n_nodes : int
    """

    n_nodes: int

    def nodes(self, first: int, last: int) -> Any:
        """Nodes first, ..., last - 1, as `feedback_interconnect` takes systems."""
        ...

    def links(self, first: int, last: int) -> Any:
        """Columns of W that leave them: a matrix with a row for every input of the network, dense or sparse."""
        ...


class Links(NamedTuple):
    """Links in any order: y of `output` of node `source`, times `weight`, feeds `input` of node `target`."""

    source: Index
    output: Index
    target: Index
    input: Index
    weight: NDArray[np.float64]


@dataclass
class Sizes:
    """How many inputs and outputs every node has, in the order of the source."""

    inputs: NDArray[np.int32]
    outputs: NDArray[np.int32]

    @classmethod
    def unknown(cls, n_nodes: int) -> Sizes:
        """Room for those of so many nodes."""
        return cls(np.zeros(n_nodes, dtype=np.int32), np.zeros(n_nodes, dtype=np.int32))

    def put(self, numbers: Index, stack: NodeStack) -> None:
        """Note the sizes of the nodes of a stack."""
        self.inputs[numbers], self.outputs[numbers] = stack.sizes[1:]


class Pieces(Protocol):
    """A network of which nodes and links come in pieces, in any order.

    Attributes
    ----------
    n_nodes : int
    """

    @property
    def n_nodes(self) -> int:
        """All nodes."""
        ...

    def node_pieces(self) -> Iterator[tuple[Index, NodeStack, Timebase]]:
        """Node numbers and these nodes, each node once."""
        ...

    def link_pieces(self, sizes: Sizes) -> Iterator[Links]:
        """Links between nodes of these sizes."""
        ...

    def pairs(self) -> Iterator[tuple[Index, Index]]:
        """Sources and targets of links."""
        ...


@dataclass(frozen=True)
class Given:
    """A network that is there as a whole."""

    model: NetworkModel

    @property
    def n_nodes(self) -> int:
        """All nodes."""
        return self.model.n_nodes

    def nodes(self, first: int, last: int) -> Nodes:
        """Nodes first, ..., last - 1, in their order in every stack."""
        stacks, members = [], []
        for s, index in zip(self.model.stacks, self.model.members, strict=True):
            chosen = np.flatnonzero((index >= first) & (index < last))
            if chosen.size:
                chosen = chosen[np.argsort(index[chosen], kind="stable")]
                stacks.append(s.take(chosen))
                members.append(index[chosen] - first)
        return tuple(stacks), tuple(members), self.model.dt

    def links(self, first: int, last: int) -> Matrix:
        """Rows of W' of their outputs."""
        y, W = self.model.offsets[2], self.model.coupling
        if W.is_sparse:
            return Matrix(self.model.WT[int(y[first]) : int(y[last])])
        return W.T[int(y[first]) : int(y[last])]

    def pairs(self) -> Iterator[tuple[Index, Index]]:
        """Sources and targets of links."""
        rows, columns, _ = entries_of(self.model.coupling)
        yield self.model.owners(2)[columns], self.model.owners(1)[rows]

    def reordered(self, order: Index) -> Given:
        """The same network with its nodes in this order."""
        position = np.argsort(order)
        rows, columns = (ranges(at[order], np.diff(at)[order]) for at in self.model.offsets[1:])
        W = self.model.coupling
        W = Matrix(sp.csr_array(W.values[rows][:, columns])) if W.is_sparse else W[np.ix_(rows, columns)]
        members = tuple(position[index] for index in self.model.members)
        return Given(NetworkModel(self.model.stacks, members, W, self.model.dt))


@dataclass(frozen=True)
class Asked:
    """A network that an object makes part by part."""

    source: Source
    n_nodes: int

    def nodes(self, first: int, last: int) -> Nodes:
        """Nodes first, ..., last - 1."""
        what = f"source.nodes({first}, {last})"
        stacks, members, dt = gather(self.source.nodes(first, last), what)
        count = sum(map(len, stacks))
        if count != last - first:
            raise ConeMismatchError(f"{what} gives {count} nodes; {last - first} are asked for.")
        return stacks, members, dt

    def links(self, first: int, last: int) -> Matrix:
        """Rows of W' of their outputs."""
        what, W = f"source.links({first}, {last})", self.source.links(first, last)
        if sp.issparse(W):
            return Matrix(sparse_matrix(W.T, what))
        exact = exact_matrix(W, what).T
        return Matrix(sp.csr_array(exact.values)) if exact.is_double else exact

    def _pieces(self) -> Iterator[tuple[int, int]]:
        for first in range(0, self.n_nodes, _PIECE):
            yield first, min(first + _PIECE, self.n_nodes)

    def node_pieces(self) -> Iterator[tuple[Index, NodeStack, Timebase]]:
        """Node numbers and these nodes."""
        for first, last in self._pieces():
            stacks, members, dt = self.nodes(first, last)
            for s, index in zip(stacks, members, strict=True):
                yield first + index, s, dt

    def link_pieces(self, sizes: Sizes) -> Iterator[Links]:
        """Links between nodes of these sizes."""
        inputs, outputs = (np.concatenate([[0], np.cumsum(n, dtype=np.int64)]) for n in (sizes.inputs, sizes.outputs))
        for first, last in self._pieces():
            WT = self.links(first, last)
            require_doubles(WT, f"source.links({first}, {last})")
            own = outputs[first : last + 1]
            require_size(WT, first, last, int(inputs[-1]), int(own[-1] - own[0]))
            rows = own[0] + np.repeat(np.arange(WT.shape[0]), np.diff(WT.values.indptr))
            columns = WT.values.indices.astype(np.int64)
            source = first + np.searchsorted(own, rows, side="right") - 1
            target = np.searchsorted(inputs, columns, side="right") - 1
            yield Links(source, rows - outputs[source], target, columns - inputs[target], WT.values.data)

    def pairs(self) -> Iterator[tuple[Index, Index]]:
        """Sources and targets of links; all nodes are asked for first, for their sizes."""
        sizes = Sizes.unknown(self.n_nodes)
        for numbers, stack, _ in self.node_pieces():
            sizes.put(numbers, stack)
        for links in self.link_pieces(sizes):
            yield links.source, links.target


def read_source(source: Any) -> Given | Asked | Pieces:
    """What `write` was given.

    Raises
    ------
    DataError
        It is none of what can be written.
    """
    if isinstance(source, (tuple, list)):
        if len(source) != 2:
            raise DataError(f"source has {len(source)} items; give two, nodes and coupling.")
        stacks, members, dt = gather(source[0], "source[0]")
        model = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), 0 if dt is None else dt)
        return Given(named_by_graph(model, source[1]).with_coupling(read_coupling(source[1], model)))
    if _has(source, "node_pieces", "link_pieces", "pairs"):
        return source
    if not _has(source, "nodes", "links"):
        raise DataError(
            f"source is {found(source)}; give (nodes, coupling), what kp.shards.parquet returns, or an object with "
            "n_nodes, nodes(first, last) and links(first, last)."
        )
    return Asked(source, whole_number(source.n_nodes, "source.n_nodes", least=1))


def _has(source: Any, *names: str) -> bool:
    try:
        return all(callable(getattr(source, name)) for name in names) and source.n_nodes is not None
    except Exception:  # noqa: BLE001  (attributes run code of the object, which may raise anything)
        return False


def require_doubles(M: Matrix, name: str) -> None:
    """Refuse numbers that no double is equal to, where nodes and links are sorted in files."""
    if not M.is_double:
        raise DataError(
            f"{name} holds a number that no double is equal to, and parts of a source that are sorted into shards are "
            "kept in doubles. Write nodes that follow each other (partition=None), or round it yourself."
        )


def require_size(WT: Matrix, first: int, last: int, inputs: int, outputs: int) -> None:
    """Raise `ConeMismatchError` with both sizes unless W' has a row for every output and a column for every input."""
    if WT.shape != (outputs, inputs):
        raise ConeMismatchError(
            f"the links of nodes {first} to {last - 1} are {WT.shape[1]} x {WT.shape[0]}, but there are {inputs} "
            f"inputs in all, and these nodes have {outputs} outputs."
        )
