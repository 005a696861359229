"""Networks to files, shard by shard: from nodes and a coupling, from tables, or from an object that makes a part."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from shutil import rmtree
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import DataError, TimebaseError
from ..exact.intake import flag, folder_path
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.coupling import entries_of
from ..networks.model import BLOCKS, same_timebase
from ..networks.nodes import NodeStack, Timebase
from ..progress import Reporter, Target
from ..proof.files import digest
from ..proof.portable_cones import decode_cone
from .exact_numbers import Entries, are_equal, entries_beside
from .folders import MANIFEST, format_of, shard_folder, write_arrays, write_manifest, write_text
from .network import FORMAT, MOST, NAMES, ConeTable, ShardedNetwork, exact_file, read_time
from .partition import Parts, share_out
from .sorting import Sorted
from .sources import Asked, Given, Nodes, Pieces, read_source, require_size
from .unfinished import Unfinished, plan_of

Say = Callable[[str], None]

# Where pieces of a source are sorted, inside the folder.
_ASIDE = ".sorting"


class Shards(Protocol):
    """A network by shards."""

    def take_nodes(self, kept: set[int]) -> None:
        """Make nodes ready, but those of some shards."""
        ...

    def take_links(self, kept: set[int]) -> None:
        """Make links ready, but those of some shards."""
        ...

    def nodes(self, p: int) -> Nodes:
        """The nodes of a shard."""
        ...

    def links(self, p: int) -> Matrix:
        """Rows of W' of their outputs."""
        ...


class _InOrder:
    """A network of which nodes follow each other as in the source: nothing has to be sorted."""

    def __init__(self, source: Given | Asked, parts: Parts) -> None:
        self.source, self.ends = source, parts.ends

    def take_nodes(self, kept: set[int]) -> None: ...

    def take_links(self, kept: set[int]) -> None: ...

    def nodes(self, p: int) -> Nodes:
        return self.source.nodes(*self.ends[p])

    def links(self, p: int) -> Matrix:
        return self.source.links(*self.ends[p])


@contextmanager
def _by_shards(source: Given | Asked | Pieces, parts: Parts, path: Path, report: Say) -> Iterator[Shards]:
    if isinstance(source, Given):
        yield _InOrder(source if parts.order is None else source.reordered(parts.order), parts)
    elif isinstance(source, Asked) and parts.order is None:
        yield _InOrder(source, parts)
    else:
        aside = path / _ASIDE
        rmtree(aside, ignore_errors=True)  # of a write that was killed
        try:
            yield Sorted(source, parts, aside, report)
        finally:
            rmtree(aside, ignore_errors=True)


def write(
    source: Any,
    folder: str | PathLike[str],
    parts: int | None = None,
    *,
    partition: Any = None,
    resume: bool = False,
    progress: Target = None,
) -> Path:
    """Write a network to files, in shards that are certified one at a time.

    Shard s holds some of the nodes and the columns of W that leave them.

    Parameters
    ----------
    source : tuple (nodes, coupling), or an object
        Nodes and coupling as `feedback_interconnect` takes them.  For what no memory holds: tables in files, see
        `parquet`, or an object with ``n_nodes``, ``nodes(first, last)`` and ``links(first, last)``.  ``nodes`` gives
        nodes first, ..., last - 1 as a stack or a list of systems; ``links`` the columns of W that leave them, a
        matrix of shape (all inputs, their outputs), best a ``scipy.sparse.csc_array``.  Both are asked for one shard
        at a time, first all nodes.
    folder : path-like
        Where the files go; made if it is not there.
    parts : int, optional
        How many shards.  Default: one for every 250 000 nodes.
    partition : "blocks", "metis", or array_like of int, shape (N,), optional
        Which nodes stand together.  Default: blocks of nodes that follow each other.  "metis" lets few links lead from
        one shard to another; it needs pymetis and the graph of all links in memory, about 130 bytes a link.  An array
        has the number of the shard of every node, from 0.
    resume : bool
        True: continue a write that was interrupted.  Shards that it had finished are kept if their files are whole,
        and are not asked for again; you vouch for that the source is the same.
    progress : callable or bool, optional
        As for `feedback_interconnect`.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    DataError
        A folder that holds a network or a certificate already; with `resume`, the beginning of another one.
    ConeMismatchError, ShapeError, TimebaseError
        Parts of other sizes than asked for, or that do not fit together; not one shard for every node.
    SolverError
        "metis" without pymetis.
    TooLargeError
        More links than METIS takes, 10^9.
    OSError
        Files cannot be written; the file is named.

    Notes
    -----
    Raw ``.npy`` arrays of doubles and one ``manifest.json`` with their sizes, types and SHA-256 digests.  Every file
    is written under another name and renamed, the manifest last, so that a folder is complete or is not read.
    8 (n n + n m + q n) bytes a node and 12 a link.  Numbers such as 1/3 are kept exactly, beside the doubles closest
    to them, and so are names of nodes, for witnesses; those of signals are not.

    With `partition` nodes are moved, and the certificate names them by their numbers in the source.  Tables, and parts
    of an object with `partition`, are sorted in files inside the folder first, which takes as much again on the disk
    until the end, and 30 to 60 bytes a node in memory; only doubles can be sorted so.

    Examples
    --------
    >>> import control_kpos as kp, tempfile
    >>> A, B, C, D = kp.examples.mass_spring_nodes(100)
    >>> nodes = kp.stack(A, B, C, D, X=kp.examples.paper_cone())
    >>> folder = kp.shards.write((nodes, kp.examples.ring(100)), tempfile.mkdtemp(), parts=4)
    >>> kp.shards.certify(folder, folder / "proof").status.name
    'PROVED'
    """
    path, whole, resume = folder_path(folder, "folder"), read_source(source), flag(resume, "resume")
    if (path / MANIFEST).exists():
        what = "a network" if format_of(path) == FORMAT else "a certificate, or a manifest of something else,"
        raise DataError(f"folder: {path} holds {what} already; give another folder, or remove it first.")
    shares = share_out(whole, parts, partition)
    plan = plan_of(whole, shares)
    notes = Unfinished.begin(path, plan, resume=resume)
    with Reporter(progress) as report, _by_shards(whole, shares, path, report) as ordered:
        run = _Write(path, shares, ordered, notes, report)
        data = run.nodes(digest(plan))
        run.links(data)
        write_manifest(path, FORMAT, data)
    notes.end()
    return path


class _Write:
    """One write: nodes of all shards, then links, which lead to nodes of any."""

    def __init__(self, path: Path, parts: Parts, ordered: Shards, notes: Unfinished, report: Say) -> None:
        self.path, self.parts, self.ordered, self.notes, self.report = path, parts, ordered, notes, report
        self.cones = ConeTable()

    def nodes(self, about: str) -> dict[str, Any]:
        """Write the nodes of every shard that is not kept; what the manifest states of all."""
        kept = self._kept("nodes", about)
        self.ordered.take_nodes(set(kept))
        shards, dt = [], None
        for p, (first, last) in enumerate(self.parts.ends):
            self.report(f"nodes of shard {p + 1} of {len(self.parts)}")
            if p in kept:
                own, shard = self._again(kept[p])
            else:
                stacks, members, own = self.ordered.nodes(p) if last > first else ((), (), None)
                shard = _write_nodes(self.path, p, stacks, members, self.cones)
                if self.parts.order is not None and last > first:
                    shard["files"] |= write_arrays(self.path, p, {"numbers": self.parts.order[first:last]})
                note = {"dt": _stated(own), "cones": list(self.cones.encoded), **shard}
                self.notes.keep("nodes", p, about, note)
            if not same_timebase(dt, own):
                raise TimebaseError(f"nodes {first} to {last - 1} have dt = {own}, but the first has dt = {dt}.")
            dt = own if own is not None and (dt is None or dt is True) else dt
            shards.append(shard)
        return {"dt": _stated(0 if dt is None else dt), "cones": self.cones.encoded, "shards": shards}

    def links(self, data: dict[str, Any]) -> None:
        """Write the links of every shard that is not kept."""
        network, about = ShardedNetwork.of(self.path, data), digest(data)
        kept = self._kept("links", about)
        self.ordered.take_links(set(kept))
        for p, (first, last) in enumerate(self.parts.ends):
            self.report(f"links of shard {p + 1} of {len(self.parts)}")
            if last == first:
                continue
            if p not in kept:
                kept[p] = _write_links(network, p, self.ordered.links(p))
                self.notes.keep("links", p, about, kept[p])
        for p, found in kept.items():  # not before, for the notes are about the nodes alone
            shard = data["shards"][p]
            shard["files"] |= found["files"]
            if "exact" in found:
                shard["exact"] = shard.get("exact", {}) | found["exact"]

    def _kept(self, kind: str, about: str) -> dict[int, dict[str, Any]]:
        notes = {p: self.notes.kept(kind, p, about) for p in range(len(self.parts))}
        return {p: note for p, note in notes.items() if note is not None}

    def _again(self, note: dict[str, Any]) -> tuple[Timebase, dict[str, Any]]:
        """The time and the entry of a shard that was written before, with the cones in the table of now."""
        places = [self.cones.place(decode_cone(runs, MOST)) for runs in note.pop("cones")]
        for stack in note["stacks"]:
            stack.update({key: places[stack[key]] for key in "XUY"})
        return read_time(note.pop("dt")), note


def _stated(dt: Timebase) -> Any:
    return dt if dt is None or isinstance(dt, bool) else float(dt).hex()


def _write_nodes(
    path: Path, p: int, stacks: tuple[NodeStack, ...], members: tuple[Index, ...], cones: ConeTable
) -> dict[str, Any]:
    arrays, exact = {}, {}
    for g, (s, index) in enumerate(zip(stacks, members, strict=True)):
        for name in BLOCKS:
            M: Matrix = getattr(s, name)
            if not M.is_zero:
                M = M[:1] if are_equal(M) else M  # equal matrices need one proof
                arrays[f"{name}{g}"], exact[f"{name}{g}"] = M.values, entries_beside(M)
        if len(stacks) > 1:
            arrays[f"members{g}"] = index
    entries = [{"nodes": len(s), "X": cones.place(s.X), "U": cones.place(s.U), "Y": cones.place(s.Y)} for s in stacks]
    files = _write_files(path, p, arrays, "nodes", exact)
    if any(s.names for s in stacks):
        names = _names(stacks, members)
        files["files"]["names"] = write_text(shard_folder(path, p) / NAMES, names)
    return {"nodes": sum(map(len, stacks)), "stacks": entries, **files}


def _names(stacks: tuple[NodeStack, ...], members: tuple[Index, ...]) -> list[str]:
    """Names of the nodes of a shard, empty where they have none."""
    out = [""] * sum(map(len, stacks))
    for s, index in zip(stacks, members, strict=True):
        for place, name in zip(index.tolist(), s.names, strict=False):
            out[place] = name.encode(errors="replace").decode()  # half of a pair of characters is no text
    return out


def _write_files(path: Path, p: int, arrays: dict[str, Any], kind: str, exact: dict[str, Entries]) -> dict[str, Any]:
    """The arrays of a shard, and the numbers in them that are no doubles."""
    out: dict[str, Any] = {"files": write_arrays(path, p, arrays)}
    beside = {name: entries for name, entries in exact.items() if entries}
    if beside:
        out["exact"] = {kind: write_text(shard_folder(path, p) / exact_file(kind), beside)}
    return out


def _write_links(network: ShardedNetwork, p: int, WT: Matrix) -> dict[str, Any]:
    """The links of a shard, and the nodes elsewhere that they lead to."""
    own, outputs, total = network.own(p, 2), network.own(p, 3), int(network.starts[2][-1])
    nodes = network.own(p, 0)
    require_size(WT, nodes.start, nodes.stop, total, outputs.stop - outputs.start)
    values, indptr, targets = _entries(WT)
    inside = (targets >= own.start) & (targets < own.stop)
    away, where = np.unique(targets[~inside], return_inverse=True)
    fed = network.nodes_of(away)
    halo = fed[np.diff(fed, prepend=-1) > 0]
    _, first, sizes = network.receivers(halo)
    at = np.searchsorted(halo, fed)
    local = np.where(inside, targets - own.start, 0)
    begin = (own.stop - own.start) + np.cumsum(sizes) - sizes
    local[~inside] = (begin[at] + away - first[at])[where]
    width = (own.stop - own.start) + int(sizes.sum())
    kind = np.int32 if max(width, len(targets)) < 2**31 else np.int64
    places = np.arange(len(targets))
    out = sp.csr_array((places, local.astype(kind), indptr.astype(kind)), shape=(len(indptr) - 1, width))
    out.sort_indices()
    values = values[out.data]
    arrays = {"weights": values.values, "targets": out.indices, "indptr": out.indptr, "halo": halo}
    return _write_files(network.folder, p, arrays, "links", {"weights": entries_beside(values)})


def _entries(WT: Matrix) -> tuple[Matrix, Index, Index]:
    """The entries of W' row by row, where rows begin, and columns."""
    if WT.is_sparse:
        return Matrix(WT.values.data), WT.values.indptr, WT.values.indices.astype(np.int64)
    rows, columns, values = entries_of(WT)
    return values, np.searchsorted(rows, np.arange(WT.shape[0] + 1)), columns
