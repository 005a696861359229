"""Nodes and links that come in any order, sorted into files by shard, out of memory.

One pass over the nodes and one over the links append records to a file for every shard; a shard is then put together
from its own files.  In memory are one piece of the source, one shard, and some numbers for every node.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import DataError, TimebaseError
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.model import BLOCKS, same_timebase
from ..networks.nodes import NodeStack, Timebase
from .folders import append
from .network import ConeTable
from .partition import Parts
from .sources import Nodes, Pieces, Sizes, require_doubles

_LINK = np.dtype([("output", "<i8"), ("input", "<i8"), ("weight", "<f8")])


class Sorted:
    """A network in pieces, by shards.

    Parameters
    ----------
    source : Pieces
    parts : Parts
    place : Path
        A folder for the files, which are of no use afterwards.
    report : callable
    """

    def __init__(self, source: Pieces, parts: Parts, place: Path, report: Callable[[str], None]) -> None:
        self.source, self.parts, self.place, self.report = source, parts, place, report
        self.sizes = Sizes.unknown(source.n_nodes)
        self.kinds: dict[tuple[int, int, int], NodeStack] = {}
        self.cones = ConeTable()
        self.dt: Timebase = None
        place.mkdir(parents=True, exist_ok=True)

    @cached_property
    def position(self) -> Index | None:
        """Where every node of the source is among those of all shards; None if where it was."""
        if self.parts.order is None:
            return None
        out = np.empty_like(self.parts.order)
        out[self.parts.order] = np.arange(len(out))
        return out

    def _moved(self, numbers: Index) -> Index:
        return numbers if self.position is None else self.position[numbers]

    def _starts(self, sizes: NDArray[np.int32]) -> Index:
        """Where the inputs or outputs of every node begin, in the order of the shards."""
        sizes = sizes if self.parts.order is None else sizes[self.parts.order]
        return np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])

    # -- taking

    def take_nodes(self, kept: set[int]) -> None:
        """Sort all nodes; those of the shards in `kept` are not needed, but their sizes are."""
        count = 0
        for numbers, stack, dt in self.source.node_pieces():
            self._require_time(dt, int(numbers[0]))
            self.sizes.put(numbers, stack)
            at = self._moved(numbers)
            order = np.argsort(at, kind="stable")
            at, shards = at[order], self._shards(at[order])
            kind = self._kind(stack)
            records = np.empty(len(at), dtype=_of_nodes(stack))
            records["place"] = at - np.asarray(self.parts.cuts)[shards]
            records["data"] = self._flat(stack, order)
            self._append(f"nodes-{kind}", shards, records, kept)
            if stack.names:
                self._append_names(shards, records["place"], [stack.names[k] for k in order.tolist()], kept)
            count += len(numbers)
            self.report(f"sorting nodes: {count} of {self.source.n_nodes}")

    def _shards(self, at: Index) -> Index:
        return np.searchsorted(self.parts.cuts, at, side="right") - 1

    def _require_time(self, dt: Timebase, node: int) -> None:
        if not same_timebase(self.dt, dt):
            raise TimebaseError(f"node {node} has dt = {dt}, but the first has dt = {self.dt}.")
        self.dt = dt if dt is not None and (self.dt is None or self.dt is True) else self.dt

    def _kind(self, stack: NodeStack) -> int:
        """The number of the nodes with these cones, and so of these sizes."""
        x, u, y = (self.cones.place(cone) for cone in (stack.X, stack.U, stack.Y))
        if (x, u, y) not in self.kinds:
            self.kinds[x, u, y] = stack.take([0])
        return list(self.kinds).index((x, u, y))

    def _flat(self, stack: NodeStack, order: Index) -> NDArray[np.float64]:
        parts = []
        for name in BLOCKS:
            M: Matrix = getattr(stack, name)
            require_doubles(M, name)
            parts.append(M.values.reshape(len(stack), -1)[order])
        return np.concatenate(parts, axis=1)

    def take_links(self, kept: set[int]) -> None:
        """Sort all links, but those of the shards in `kept`."""
        inputs, outputs, count = self._starts(self.sizes.inputs), self._starts(self.sizes.outputs), 0
        cuts = np.asarray(self.parts.cuts)
        for links in self.source.link_pieces(self.sizes):
            source, target = self._moved(links.source), self._moved(links.target)
            order = np.argsort(source, kind="stable")
            shards = self._shards(source[order])
            records = np.empty(len(order), dtype=_LINK)
            records["output"] = (outputs[source] + links.output)[order] - outputs[cuts[shards]]
            records["input"] = (inputs[target] + links.input)[order]
            records["weight"] = links.weight[order]
            self._append("links", shards, records, kept)
            count += len(order)
            self.report(f"sorting links: {count}")

    def _append(self, name: str, shards: Index, records: NDArray[Any], kept: set[int]) -> None:
        """Records in the order of their shards, to the file of each."""
        begin = np.flatnonzero(np.diff(shards, prepend=-1)) if len(shards) else shards
        for first, last in zip(begin.tolist(), [*begin[1:].tolist(), len(shards)], strict=False):
            p = int(shards[first])
            if p not in kept:
                append(self._file(name, p), records[first:last])

    def _append_names(self, shards: Index, places: Index, names: list[str], kept: set[int]) -> None:
        lines = [json.dumps(line) for line in zip(places.tolist(), names, strict=True)]
        cuts = np.searchsorted(shards, [0, *(shards[np.diff(shards, append=-1) != 0] + 1)]).tolist()
        for first, last in pairwise(cuts):
            if int(shards[first]) not in kept:
                text = "".join(f"{line}\n" for line in lines[first:last])
                append(self._file("names", int(shards[first])), text.encode())

    def _file(self, name: str, p: int) -> Path:
        return self.place / f"{p:05d}-{name}"

    # -- putting together

    def nodes(self, p: int) -> Nodes:
        """The nodes of a shard."""
        stacks, members, names = [], [], self._names(p)
        for kind, like in enumerate(self.kinds.values()):
            path = self._file(f"nodes-{kind}", p)
            if path.exists():
                records = np.fromfile(path, dtype=_of_nodes(like))
                records = records[np.argsort(records["place"], kind="stable")]
                stack = _stack_of(records["data"], like, self.dt)
                own = tuple(names.get(place, "") for place in records["place"].tolist()) if names else ()
                stacks.append(replace(stack, names=own))
                members.append(records["place"].copy())
                path.unlink()
        return tuple(stacks), tuple(members), self.dt

    def _names(self, p: int) -> dict[int, str]:
        path = self._file("names", p)
        return dict(map(json.loads, path.read_text().splitlines())) if path.exists() else {}

    def links(self, p: int) -> Matrix:
        """Rows of W' of the outputs of a shard."""
        first, last = self.parts.ends[p]
        shape = self._total(self.sizes.outputs, first, last), int(self.sizes.inputs.sum(dtype=np.int64))
        path = self._file("links", p)
        if not path.exists():
            return Matrix(sp.csr_array(shape))
        records = np.fromfile(path, dtype=_LINK)
        records = records[np.lexsort((records["input"], records["output"]))]
        twice = (np.diff(records["output"]) == 0) & (np.diff(records["input"]) == 0)
        if twice.any():
            self._refuse_twice(p, records[int(np.argmax(twice))])
        indptr = np.searchsorted(records["output"], np.arange(shape[0] + 1))
        out = sp.csr_array((records["weight"].copy(), records["input"].copy(), indptr), shape=shape)
        out.eliminate_zeros()
        path.unlink()
        return Matrix(out)

    def _total(self, sizes: NDArray[np.int32], first: int, last: int) -> int:
        own = sizes[first:last] if self.parts.order is None else sizes[self.parts.order[first:last]]
        return int(own.sum(dtype=np.int64))

    def _refuse_twice(self, p: int, record: Any) -> None:
        outputs, inputs = self._starts(self.sizes.outputs), self._starts(self.sizes.inputs)
        ends = []
        for starts, at in ((outputs, outputs[self.parts.cuts[p]] + record["output"]), (inputs, record["input"])):
            node = int(np.searchsorted(starts, at, side="right")) - 1
            ends.append((node if self.parts.order is None else int(self.parts.order[node]), int(at - starts[node])))
        (source, output), (target, put) = ends
        raise DataError(
            f"{self.source} has two links from output {output} of node {source} to input {put} of node {target}; add "
            "their weights up."
        )


def _of_nodes(stack: NodeStack) -> np.dtype[Any]:
    n, m, q = stack.sizes
    return np.dtype([("place", "<i8"), ("data", "<f8", (n * n + n * m + q * n + q * m,))])


def _stack_of(data: NDArray[np.float64], like: NodeStack, dt: Timebase) -> NodeStack:
    parts: dict[str, Any] = dict(_blocks(data, like))
    return NodeStack(**parts, X=like.X, U=like.U, Y=like.Y, dt=dt)


def _blocks(data: NDArray[np.float64], like: NodeStack) -> Iterator[tuple[str, Matrix]]:
    """A, B, C, D of nodes whose entries stand in a row each."""
    begin = 0
    for name, (rows, columns) in BLOCKS.items():
        shape = like.sizes[rows], like.sizes[columns]
        end = begin + shape[0] * shape[1]
        yield name, Matrix(np.ascontiguousarray(data[:, begin:end]).reshape(-1, *shape))
        begin = end
