"""Networks in Parquet tables: one of nodes, one of links, read a batch of rows at a time.

Columns are read as they are meant or not at all: no text that looks like a number, no empty field taken for zero, no
integer that a double would round.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import isqrt
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from control.config import defaults
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone, as_cone, orthant
from ..errors import ConeMismatchError, DataError, SolverError
from ..exact.intake import file_path, found, items
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.nodes import NodeStack, Timebase
from ..systems.reading import require_timebase
from .columns import doubles, entries_of_rows, integers, kinds_of, texts
from .sources import Links, Sizes

# Rows that are read at a time.
_ROWS = 2**17
_ENTRY = re.compile(r"([ABCD])_([0-9]{1,4})_([0-9]{1,4})")

Cones = Cone | ArrayLike | Mapping[Any, Any] | None


def parquet(
    nodes: Any,
    links: Any,
    *,
    X: Cones = None,
    U: Cones = None,
    Y: Cones = None,
    dt: Timebase = None,
) -> Tables:
    """A network in Parquet files, as a source for `write`.

    Parameters
    ----------
    nodes : path-like, or a list of them
        Files with a row for every node.  Columns ``A``, ``B``, ``C`` and, if there is feedthrough, ``D`` are lists of
        the entries row by row; or there is a column for every entry, ``A_0_0``, ``A_0_1``, ...  An integer column
        ``node`` numbers the nodes from 0, in any order; without it they are numbered as they come.  A column ``kind``,
        text or integers, tells nodes with different cones apart; ``name``, text, is for witnesses.
    links : path-like, or a list of them
        Files with a row for every link: ``source`` and ``target``, node numbers, and ``weight``; ``output`` and
        ``input``, places from 0, where nodes have several.
    X, U, Y : Cone, array_like of its generators, or dict, optional
        As for `stack`; a dict gives a cone for every kind.
    dt : float, bool or None
        As for `stack`.

    Returns
    -------
    Tables
        Nothing but the columns and the numbers of rows is read before `write` asks.

    Raises
    ------
    DataError
        Columns that are missing or not understood; and, when it is written: empty fields, NaN, integers beyond 2^53,
        numbers of nodes that occur twice, not at all, or are those of no node, two links between the same places.
        File, column and row are named.
    ConeMismatchError
        Lists that are no matrices of one node, or that do not fit to its cones.
    SolverError
        pyarrow is not installed.

    Notes
    -----
    Columns hold floating-point numbers or integers; nothing is converted that would lose digits.  Rows are read in
    batches of 131 072 and sorted into files by shard; some 30 bytes a node are kept in memory, 60 where nodes are
    moved.

    Examples
    --------
    >>> import control_kpos as kp, pathlib, tempfile
    >>> import pyarrow as pa, pyarrow.parquet as pq
    >>> place = pathlib.Path(tempfile.mkdtemp())
    >>> pq.write_table(pa.table({"A": [[-3.0]] * 4, "B": [[1.0]] * 4, "C": [[1.0]] * 4}), place / "nodes.parquet")
    >>> ring = {"source": [0, 1, 2, 3], "target": [1, 2, 3, 0], "weight": [1.0] * 4}
    >>> pq.write_table(pa.table(ring), place / "links.parquet")
    >>> source = kp.shards.parquet(place / "nodes.parquet", place / "links.parquet")
    >>> folder = kp.shards.write(source, place / "network", parts=2)
    >>> kp.shards.certify(folder, folder / "proof").status.name
    'PROVED'
    """
    if _read() is None:
        raise SolverError('Parquet files need pyarrow: pip install "control_kpos[parquet]".')
    require_timebase(dt)
    cones = {"X": _cones(X, "X"), "U": _cones(U, "U"), "Y": _cones(Y, "Y")}
    time = defaults["control.default_dt"] if dt is None else dt
    return Tables(_files(nodes, "nodes"), _files(links, "links"), cones, time)


def _read() -> Any:
    """The module that reads Parquet, or None."""
    try:
        import pyarrow.parquet  # type: ignore[import-not-found]  # noqa: PLC0415  (an extra)
    except ImportError:
        return None
    return pyarrow.parquet


def _cones(given: Cones, name: str) -> Any:
    if given is None:
        return None
    if isinstance(given, Mapping):
        return {kind: _cones(cone, f"{name}[{kind!r}]") for kind, cone in given.items()}
    cone = as_cone(given, name)
    cone.require_proper(name)
    return cone


def _files(given: Any, name: str) -> tuple[File, ...]:
    if isinstance(given, (str, PathLike)):
        return (File.open(file_path(given, name)),)
    files = tuple(File.open(file_path(path, f"{name}[{k}]")) for k, path in enumerate(items(given, name)))
    if not files:
        raise DataError(f"{name} is an empty list; give at least one file.")
    for file in files[1:]:
        if file.columns != files[0].columns:
            raise DataError(f"{file} has the columns {sorted(file.columns)}, but {files[0]} has others.")
    return files


@dataclass(frozen=True, eq=False)
class File:
    """A Parquet file.

    Attributes
    ----------
    path : Path
    columns : frozenset of str
    n_rows : int
    size : int
        In bytes.
    """

    path: Path
    columns: frozenset[str]
    n_rows: int
    size: int

    @classmethod
    def open(cls, path: Path) -> File:
        """The file at a path.

        Raises
        ------
        DataError
            It is no Parquet file.
        """
        size = path.stat().st_size
        file = _guarded(path, lambda: _read().ParquetFile(path))
        with file:
            names = file.schema_arrow.names
            if len(set(names)) < len(names):
                raise DataError(f"{path} has a column twice.")
            return cls(path, frozenset(names), file.metadata.num_rows, size)

    def __str__(self) -> str:
        return str(self.path)

    def batches(self, columns: list[str]) -> Iterator[tuple[int, dict[str, Any]]]:
        """The row where it begins and the columns of every batch of rows."""
        row = 0
        # buffers that are read ahead would be kept to the end
        with _guarded(self.path, lambda: _read().ParquetFile(self.path, pre_buffer=False)) as file:
            rest = file.iter_batches(_ROWS, columns=columns, use_threads=False)
            while (batch := _guarded(self.path, lambda: next(rest, None))) is not None:
                yield row, {name: batch.column(name) for name in columns}
                row += batch.num_rows


def _guarded(path: Path, read: Callable[[], Any]) -> Any:
    """What pyarrow reads; it has errors of its own for files that are damaged."""
    try:
        return read()
    except (FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except (ValueError, OSError, NotImplementedError, KeyError, MemoryError, RuntimeError, TypeError) as error:
        raise DataError(f"{path} cannot be read as a Parquet file: {str(error)[:200]}") from None


@dataclass(frozen=True, eq=False)
class Tables:
    """A network in Parquet files, made by `parquet`.

    Attributes
    ----------
    node_files, link_files : tuple of File
    cones : dict
    dt : float, bool or None
    """

    node_files: tuple[File, ...]
    link_files: tuple[File, ...]
    cones: dict[str, Any]
    dt: Timebase

    def __post_init__(self) -> None:
        _ = self.layout
        for name in ("source", "target", "weight"):
            if name not in self.link_files[0].columns:
                raise DataError(f"links: {self.link_files[0]} has no column {name!r}; it needs source, target, weight.")
        if not self.n_nodes:
            raise DataError(f"nodes: {self.node_files[0]} has no rows; a network needs at least one node.")
        by_kind = [name for name, cone in self.cones.items() if isinstance(cone, dict)]
        if by_kind and "kind" not in self.node_files[0].columns:
            raise DataError(f"{by_kind[0]} has a cone for every kind, but {self.node_files[0]} has no column 'kind'.")

    def __str__(self) -> str:
        others = len(self.link_files) - 1
        more = f" and {others} more" if others else ""
        return f"{self.link_files[0]}{more}"

    def __repr__(self) -> str:
        return f"<network in Parquet tables: {self.n_nodes} nodes, {self.n_links} links>"

    @cached_property
    def n_nodes(self) -> int:
        """Rows of the tables of nodes."""
        return sum(file.n_rows for file in self.node_files)

    @cached_property
    def n_links(self) -> int:
        """Rows of the tables of links."""
        return sum(file.n_rows for file in self.link_files)

    def about(self) -> list[list[Any]]:
        """What the files are told by from others: names, rows and lengths."""
        return [[str(f), f.n_rows, f.size] for f in (*self.node_files, *self.link_files)]

    @cached_property
    def layout(self) -> dict[str, tuple[tuple[int, int] | None, list[str]]]:
        """For A, B, C and D the columns: one of lists, with no shape, or one for every entry."""
        file, columns = self.node_files[0], self.node_files[0].columns
        found_entries = {name: _ENTRY.fullmatch(name) for name in sorted(columns)}
        out: dict[str, tuple[tuple[int, int] | None, list[str]]] = {}
        for letter in "ABCD":
            places = {(int(m[2]), int(m[3])): name for name, m in found_entries.items() if m and m[1] == letter}
            if letter in columns and not places:
                out[letter] = None, [letter]
            elif places and letter not in columns:
                shape = 1 + max(i for i, _ in places), 1 + max(j for _, j in places)
                wanted = [(i, j) for i in range(shape[0]) for j in range(shape[1])]
                missing = next((f"{letter}_{i}_{j}" for i, j in wanted if (i, j) not in places), None)
                if missing is not None:
                    raise DataError(f"nodes: {file} has no column {missing!r}, although others of {letter} go beyond.")
                out[letter] = shape, [places[at] for at in wanted]
            elif letter != "D" or places:
                raise DataError(
                    f"nodes: {file} needs a column {letter!r} of lists, or a column for every entry, {letter}_0_0 and "
                    "so on, and not both."
                )
        return out

    # -- nodes

    def node_pieces(self) -> Iterator[tuple[Index, NodeStack, Timebase]]:
        """Node numbers and these nodes."""
        given = self.node_files[0].columns
        columns = [
            *(name for _, names in self.layout.values() for name in names),
            *sorted({"node", "kind", "name"} & given),
        ]
        seen = np.zeros(self.n_nodes if "node" in given else 0, dtype=bool)
        first = 0
        for file in self.node_files:
            for row, batch in file.batches(columns):
                where = file.path, row
                count = len(batch[columns[0]])
                numbers = np.arange(first, first + count)
                if "node" in batch:
                    numbers = integers(batch["node"], "node", where, self.n_nodes)
                    _require_new(numbers, seen, where)
                names = texts(batch["name"], "name", where) if "name" in batch else []
                for rows, stack in self._stacks(batch, count, where):
                    own = tuple(names[k] for k in rows.tolist()) if names else ()
                    yield numbers[rows], replace(stack, names=own), self.dt
                first += count

    def _stacks(self, batch: dict[str, Any], count: int, where: Any) -> Iterator[tuple[Index, NodeStack]]:
        """The rows of a batch with nodes of the same sizes and kind."""
        kinds, kind = kinds_of(batch["kind"], where) if "kind" in batch else ([None], np.zeros(count, dtype=np.int64))
        read, lengths = {}, [kind]
        for letter, (shape, names) in self.layout.items():
            if shape is None:
                values, sizes = entries_of_rows(batch[letter], letter, where)
            else:
                values = np.column_stack([doubles(batch[name], name, where) for name in names]).ravel()
                sizes = np.full(count, len(names))
            read[letter] = values, np.concatenate([[0], np.cumsum(sizes)])
            lengths.append(sizes)
        table = np.column_stack(lengths)
        alike, group = np.unique(table, axis=0, return_inverse=True) if count else (table, kind)
        for g, (k, *sizes) in enumerate(alike.tolist()):
            rows = np.flatnonzero(group.ravel() == g)
            place = f"{where[0]}, row {where[1] + int(rows[0])}"
            shapes = self._shapes(dict(zip(self.layout, sizes, strict=True)), place)
            parts: dict[str, Any] = {}
            for letter, shape in shapes.items():
                if letter in read:
                    values, starts = read[letter]
                    flat = values[starts[rows][:, None] + np.arange(shape[0] * shape[1])]
                    parts[letter] = Matrix(flat.reshape(-1, *shape))
                else:
                    parts[letter] = Matrix.zeros(len(rows), *shape)
            dims = dict(zip("XUY", (shapes["A"][0], shapes["B"][1], shapes["C"][0]), strict=True))
            cones: dict[str, Any] = {name: self._cone(name, kinds[k], size, place) for name, size in dims.items()}
            yield rows, NodeStack(**parts, **cones, dt=self.dt)

    def _shapes(self, sizes: dict[str, int], place: str) -> dict[str, tuple[int, int]]:
        """Shapes of A, B, C and D from their numbers of entries."""
        n = isqrt(sizes["A"])
        if n * n != sizes["A"] or n == 0:
            raise ConeMismatchError(f"{place}: A has {sizes['A']} entries, which are no square matrix.")
        for letter in "BC":
            if sizes[letter] % n or not sizes[letter]:
                raise ConeMismatchError(
                    f"{place}: {letter} has {sizes[letter]} entries, but A is {n} x {n}; give a multiple of {n}."
                )
        m, q = sizes["B"] // n, sizes["C"] // n
        if sizes.get("D", q * m) != q * m:
            raise ConeMismatchError(
                f"{place}: D has {sizes['D']} entries, but the node has {m} inputs and {q} outputs; give {q * m}."
            )
        shapes = {"A": (n, n), "B": (n, m), "C": (q, n), "D": (q, m)}
        for letter, (shape, _) in self.layout.items():
            if shape is not None and shape != shapes[letter]:
                have, want = (f"{r} x {c}" for r, c in (shape, shapes[letter]))
                raise ConeMismatchError(f"{place}: the columns of {letter} are {have}, but must be {want}.")
        return shapes

    @cached_property
    def _orthants(self) -> dict[int, Cone]:
        return {}

    def _cone(self, name: str, kind: Any, size: int, place: str) -> Cone:
        cone = self.cones[name]
        if isinstance(cone, dict):
            if kind not in cone:
                raise DataError(f"{place}: nodes of kind {found(kind)} have no cone {name}; give {name}[{kind!r}].")
            cone = cone[kind]
        if cone is None:
            if size not in self._orthants:
                self._orthants[size] = orthant(size)
            return self._orthants[size]
        if cone.dim != size:
            signals = {"X": "states", "U": "inputs", "Y": "outputs"}[name]
            raise ConeMismatchError(
                f"{place}: the node has {size} {signals}, but {name} is a cone in dimension {cone.dim}."
            )
        return cone

    # -- links

    def _ends(self, columns: list[str]) -> Iterator[tuple[Any, dict[str, Any], Index, Index]]:
        for file in self.link_files:
            for row, batch in file.batches(columns):
                where = file.path, row
                source, target = (integers(batch[name], name, where, self.n_nodes) for name in ("source", "target"))
                yield where, batch, source, target

    def link_pieces(self, sizes: Sizes) -> Iterator[Links]:
        """Links between nodes of these sizes."""
        ports = {"output", "input"} & self.link_files[0].columns
        for where, batch, source, target in self._ends(["source", "target", "weight", *sorted(ports)]):
            ends = {}
            for name, node, most in (("output", source, sizes.outputs), ("input", target, sizes.inputs)):
                if name in ports:
                    ends[name] = integers(batch[name], name, where, most[node])
                elif (most[node] > 1).any():
                    k = int(np.argmax(most[node] > 1))
                    raise DataError(
                        f"{where[0]}, row {where[1] + k}: node {int(node[k])} has {int(most[node[k]])} {name}s; add a "
                        f"column {name!r} that says which."
                    )
                else:
                    ends[name] = np.zeros(len(node), dtype=np.int64)
            weight = doubles(batch["weight"], "weight", where)
            yield Links(source, ends["output"], target, ends["input"], weight)

    def pairs(self) -> Iterator[tuple[Index, Index]]:
        """Sources and targets of links."""
        for _, _, source, target in self._ends(["source", "target"]):
            yield source, target


def _require_new(numbers: Index, seen: NDArray[np.bool_], where: Any) -> None:
    """Raise `DataError` for a number that occurred before."""
    order = np.argsort(numbers, kind="stable")
    again = np.zeros(len(numbers), dtype=bool)
    again[order[1:]] = np.diff(numbers[order]) == 0
    again |= seen[numbers]
    if again.any():
        k = int(np.argmax(again))
        raise DataError(f"{where[0]}, column 'node', row {where[1] + k}: {int(numbers[k])} occurred before.")
    seen[numbers] = True
