"""Networks to files, shard by shard: from nodes and a coupling, or from an object that makes a part when asked."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..errors import ConeMismatchError, DataError, TimebaseError
from ..exact.intake import exact_matrix, file_path, found, sparse_matrix, whole_number
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.coupling import read_coupling
from ..networks.model import BLOCKS, NetworkModel, gather, same_timebase
from ..networks.nodes import NodeStack, Timebase
from ..progress import Reporter, Target
from .folders import MANIFEST, write_arrays, write_manifest
from .network import FORMAT, ConeTable, ShardedNetwork

# Nodes of a shard, where the number of shards is not given.
_NODES = 250_000
# The most shards.
_PARTS = 10**5

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


@dataclass(frozen=True)
class _Given:
    """A network that is there as a whole."""

    model: NetworkModel

    @property
    def n_nodes(self) -> int:
        return self.model.n_nodes

    def nodes(self, first: int, last: int) -> Nodes:
        stacks, members = [], []
        for s, index in zip(self.model.stacks, self.model.members, strict=True):
            chosen = np.flatnonzero((index >= first) & (index < last))
            if chosen.size:
                stacks.append(s.take(chosen))
                members.append(index[chosen] - first)
        return tuple(stacks), tuple(members), self.model.dt

    def links(self, first: int, last: int) -> sp.csr_array:
        y = self.model.offsets[2]
        return self.model.WT[int(y[first]) : int(y[last])]


@dataclass(frozen=True)
class _Asked:
    """A network that an object makes part by part."""

    source: Source
    n_nodes: int

    def nodes(self, first: int, last: int) -> Nodes:
        what = f"source.nodes({first}, {last})"
        stacks, members, dt = gather(self.source.nodes(first, last), what)
        count = sum(map(len, stacks))
        if count != last - first:
            raise ConeMismatchError(f"{what} gives {count} nodes; {last - first} are asked for.")
        return stacks, members, dt

    def links(self, first: int, last: int) -> sp.csr_array:
        what, W = f"source.links({first}, {last})", self.source.links(first, last)
        if sp.issparse(W):
            return sparse_matrix(W.T, what)
        exact = exact_matrix(W, what)
        _require_doubles(exact, what)
        return sp.csr_array(exact.values.T)


def write(
    source: Any,
    folder: str | PathLike[str],
    parts: int | None = None,
    *,
    progress: Target = None,
) -> Path:
    """Write a network to files, in shards that are certified one at a time.

    Shard s holds nodes that follow each other and the columns of W that leave them.

    Parameters
    ----------
    source : tuple (nodes, coupling), or an object
        Nodes and coupling as `feedback_interconnect` takes them; for what no memory holds, an object with ``n_nodes``,
        ``nodes(first, last)`` and ``links(first, last)``.  ``nodes`` gives nodes first, ..., last - 1 as a stack or a
        list of systems; ``links`` the columns of W that leave them, a matrix of shape (all inputs, their outputs),
        best a ``scipy.sparse.csc_array``.  Both are asked for one shard at a time, first all nodes.
    folder : path-like
        Where the files go; made if it is not there.
    parts : int, optional
        How many shards.  Default: one for every 250 000 nodes.
    progress : callable or bool, optional
        As for `feedback_interconnect`.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    DataError
        A folder that holds a network already; numbers that no double is equal to.
    ConeMismatchError, ShapeError, TimebaseError
        Parts of other sizes than asked for, or that do not fit together.
    OSError
        Files cannot be written; the file is named.

    Notes
    -----
    Raw ``.npy`` arrays of doubles and one ``manifest.json`` with their sizes, types and SHA-256 digests.  Every file
    is written under another name and renamed, the manifest last, so that a folder is complete or is not read.
    8 (n n + n m + q n) bytes a node and 12 a link.  Names of nodes and signals are not kept.

    Examples
    --------
    >>> import control_kpos as kp, tempfile
    >>> A, B, C, D = kp.examples.mass_spring_nodes(100)
    >>> nodes = kp.stack(A, B, C, D, X=kp.examples.paper_cone())
    >>> folder = kp.shards.write((nodes, kp.examples.ring(100)), tempfile.mkdtemp(), parts=4)
    >>> kp.shards.certify(folder, folder / "proof").status.name
    'PROVED'
    """
    path, whole = file_path(folder, "folder"), _read_source(source)
    count = -(-whole.n_nodes // _NODES) if parts is None else whole_number(parts, "parts", least=1, most=_PARTS)
    if (path / MANIFEST).exists():
        raise DataError(f"folder: {path} holds a network already; give another folder, or remove it first.")
    cuts = np.linspace(0, whole.n_nodes, count + 1).astype(np.int64).tolist()
    cones, shards, dt = ConeTable(), [], None
    with Reporter(progress) as report:
        for p, (first, last) in enumerate(pairwise(cuts)):
            report(f"nodes of shard {p + 1} of {count}")
            stacks, members, own = whole.nodes(first, last) if last > first else ((), (), None)
            if not same_timebase(dt, own):
                raise TimebaseError(f"nodes {first} to {last - 1} have dt = {own}, but the first has dt = {dt}.")
            dt = own if dt is None or dt is True else dt
            shards.append(_write_nodes(path, p, stacks, members, cones))
        data = {"dt": _stated(0 if dt is None else dt), "cones": cones.encoded, "shards": shards}
        network = ShardedNetwork.of(path, data)
        for p, (first, last) in enumerate(pairwise(cuts)):
            report(f"links of shard {p + 1} of {count}")
            if last > first:
                shards[p]["files"] |= _write_links(network, p, whole.links(first, last))
        write_manifest(path, FORMAT, data)
    return path


def _read_source(source: Any) -> _Given | _Asked:
    if isinstance(source, (tuple, list)):
        if len(source) != 2:
            raise DataError(f"source has {len(source)} items; give two, nodes and coupling.")
        stacks, members, dt = gather(source[0], "source[0]")
        model = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), 0 if dt is None else dt)
        W = read_coupling(source[1], model)
        _require_doubles(W, "source[1]")
        return _Given(model.with_coupling(Matrix(sp.csr_array(W.values))))
    if not _is_source(source):
        raise DataError(
            f"source is {found(source)}; give (nodes, coupling), or an object with n_nodes, nodes(first, last) and "
            "links(first, last)."
        )
    return _Asked(source, whole_number(source.n_nodes, "source.n_nodes", least=1))


def _is_source(source: Any) -> bool:
    try:
        return callable(source.nodes) and callable(source.links) and source.n_nodes is not None
    except Exception:  # noqa: BLE001  (attributes run code of the object, which may raise anything)
        return False


def _require_doubles(M: Matrix, name: str) -> None:
    if not M.is_double:
        raise DataError(f"{name} holds a number that no double is equal to; shards hold doubles. Round it yourself.")


def _stated(dt: Timebase) -> Any:
    return dt if dt is None or isinstance(dt, bool) else float(dt).hex()


def _write_nodes(
    path: Path, p: int, stacks: tuple[NodeStack, ...], members: tuple[Index, ...], cones: ConeTable
) -> dict[str, Any]:
    arrays = {}
    for g, (s, index) in enumerate(zip(stacks, members, strict=True)):
        for name in BLOCKS:
            M: Matrix = getattr(s, name)
            _require_doubles(M, f"{name} of nodes in shard {p}")
            if not M.is_zero:
                alike = bool((M.values == M.values[0]).all())  # equal matrices need one proof
                arrays[f"{name}{g}"] = M.values[:1] if alike else M.values
        if len(stacks) > 1:
            arrays[f"members{g}"] = index
    entries = [{"nodes": len(s), "X": cones.place(s.X), "U": cones.place(s.U), "Y": cones.place(s.Y)} for s in stacks]
    return {"nodes": sum(map(len, stacks)), "stacks": entries, "files": write_arrays(path, p, arrays)}


def _write_links(network: ShardedNetwork, p: int, WT: sp.csr_array) -> dict[str, Any]:
    """The links of a shard, and the nodes elsewhere that they lead to."""
    own, outputs, total = network.own(p, 2), network.own(p, 3), int(network.starts[2][-1])
    shape = total, outputs.stop - outputs.start
    if WT.shape != shape[::-1]:
        nodes = network.own(p, 0)
        raise ConeMismatchError(
            f"the links of nodes {nodes.start} to {nodes.stop - 1} are {WT.shape[1]} x {WT.shape[0]}, but there are "
            f"{shape[0]} inputs in all, and these nodes have {shape[1]} outputs."
        )
    targets = WT.indices.astype(np.int64)
    inside = (targets >= own.start) & (targets < own.stop)
    away, where = np.unique(targets[~inside], return_inverse=True)
    nodes = network.nodes_of(away)
    halo = np.unique(nodes)
    _, first, sizes = network.receivers(halo)
    at = np.searchsorted(halo, nodes)
    local = np.where(inside, targets - own.start, 0)
    begin = (own.stop - own.start) + np.cumsum(sizes) - sizes
    local[~inside] = (begin[at] + away - first[at])[where]
    width = (own.stop - own.start) + int(sizes.sum())
    kind = np.int32 if max(width, WT.nnz) < 2**31 else np.int64
    out = sp.csr_array((WT.data, local.astype(kind), WT.indptr.astype(kind)), shape=(shape[1], width))
    out.sort_indices()
    arrays = {"weights": out.data, "targets": out.indices, "indptr": out.indptr, "halo": halo}
    return write_arrays(network.folder, p, arrays)
