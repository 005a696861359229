"""Which shard every node goes to: blocks of nodes that follow each other, numbers of the user, or METIS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import DataError, KposError, ShapeError, SolverError, TooLargeError
from ..exact.intake import exact_matrix, found, whole_number
from ..networks.blocks import Index
from .sources import Asked, Given, Pieces

# Nodes of a shard, where the number of shards is not given.
_NODES = 250_000
# The most shards.
_PARTS = 10**5
# The most links that METIS counts, in both directions.
_LINKS = 2**31 - 1

_WORDS = ("blocks", "metis")


@dataclass(frozen=True, eq=False)
class Parts:
    """Where the nodes of every shard begin, once nodes are in their order.

    Attributes
    ----------
    cuts : list of int
        One more than shards.
    order : ndarray of int or None
        The number of every node in the source; None if nodes stay in their order.
    """

    cuts: list[int]
    order: Index | None = None

    def __len__(self) -> int:
        return len(self.cuts) - 1

    @property
    def ends(self) -> list[tuple[int, int]]:
        """Where the nodes of every shard begin and end."""
        return list(pairwise(self.cuts))


def share_out(source: Given | Asked | Pieces, parts: int | None, partition: Any) -> Parts:
    """The shards of all nodes.

    Raises
    ------
    DataError, ShapeError
        Numbers of shards that are none, or not one for every node.
    """
    n = source.n_nodes
    count = None if parts is None else whole_number(parts, "parts", least=1, most=_PARTS)
    if partition is None or isinstance(partition, str):
        if partition not in (None, *_WORDS):
            raise DataError(f'partition is {found(partition)}; give "blocks", "metis" or a shard for every node.')
        count = -(-n // _NODES) if count is None else count
        if partition == "metis":
            return _sorted(n, by_metis(n, source.pairs, count), count)
        return Parts(np.linspace(0, n, count + 1).astype(np.int64).tolist())
    labels = _labels(partition, n)
    most = int(labels.max())
    if count is not None and most >= count:
        node = int(labels.argmax())
        raise DataError(f"partition[{node}] is {most}, but there are {count} shards, numbered from 0.")
    return _sorted(n, labels, most + 1 if count is None else count)


def _sorted(n: int, labels: NDArray[Any], count: int) -> Parts:
    cuts = np.concatenate([[0], np.cumsum(np.bincount(labels, minlength=count))]).tolist()
    if (labels[1:] >= labels[:-1]).all():
        return Parts(cuts)
    return Parts(cuts, np.argsort(labels, kind="stable"))


def _labels(partition: Any, n: int) -> NDArray[Any]:
    """A shard for every node, from what the user gave."""
    labels = partition
    if not (isinstance(labels, np.ndarray) and type(labels) is np.ndarray and labels.dtype.kind in "iu"):
        try:
            labels = exact_matrix(partition, "partition", ndim=1).values
        except KposError as error:
            raise type(error)(f'{error} A partition is "blocks", "metis" or a shard for every node.') from None
        labels = labels.toarray() if sp.issparse(labels) else labels
    if labels.shape != (n,):
        raise ShapeError(f"partition has shape {labels.shape}; it must have a shard for each of {n} nodes.")
    wrong = np.flatnonzero((labels < 0) | (labels >= _PARTS) | (labels != np.trunc(labels)))
    if wrong.size:
        node = int(wrong[0])
        raise DataError(f"partition[{node}] is {labels[node]}; shards are numbered 0 to {_PARTS - 1} at most.")
    return labels.astype(np.int32)


def by_metis(n: int, pairs: Any, count: int) -> NDArray[Any]:
    """A shard for every node, such that few links lead from one to another; the same at every call."""
    try:
        import pymetis  # type: ignore[import-not-found]  # noqa: PLC0415  (an extra)
    except ImportError:
        raise SolverError(
            'partition="metis" needs pymetis: pip install "control_kpos[metis]". Or give a shard for every node.'
        ) from None
    even = (np.arange(n) * count // n).astype(np.int32)
    if count == 1 or count >= n:
        return even
    graph = _neighbours(n, pairs())
    if not graph.nnz:
        return even
    adjacency = pymetis.CSRAdjacency(graph.indptr.astype(np.int32), graph.indices.astype(np.int32, copy=False))
    _, labels = pymetis.part_graph(count, adjacency, options=pymetis.Options(seed=0))
    return np.asarray(labels, dtype=np.int32)


def _neighbours(n: int, pairs: Iterable[tuple[Index, Index]]) -> sp.csr_array:
    """The pattern of links between different nodes, either way."""
    tails, heads = [np.zeros(0, dtype=np.int32)], [np.zeros(0, dtype=np.int32)]
    links = 0
    for source, target in pairs:
        other = source != target
        tails.append(source[other].astype(np.int32))
        heads.append(target[other].astype(np.int32))
        links += len(tails[-1])
        if 2 * links > _LINKS or n > _LINKS:
            raise TooLargeError(
                f'partition="metis" takes {_LINKS // 2} links at most; give a shard for every node, or blocks.'
            )
    at = np.concatenate(tails), np.concatenate(heads)
    graph = sp.csr_array((np.ones(links, dtype=bool), at), shape=(n, n))
    return sp.csr_array(graph + graph.T)
