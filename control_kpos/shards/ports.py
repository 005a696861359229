"""The port equations r = T'r + b of a network in shards; untrusted, the proof checks what they give.

A shard has the rows of T' that belong to its own inputs, G'W' with its transfer matrices G.  They are kept in files
and mapped; in memory are vectors with an entry for every input of the network, and nothing else of all shards.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..networks.blocks import Floats
from ..networks.spectrum.port_solves import krylov, sweep
from .network import ShardedNetwork

# Steps of BiCGSTAB where sweeps are slow, and where they grow.
_ITERATIONS = 400
_DOOMED = 50
# Bytes of a file without numbers, which cannot be mapped.
_HEADER = 128


@contextmanager
def scratch(out: Path) -> Iterator[Path]:
    """A folder for what is needed until a certificate is written."""
    out.mkdir(parents=True, exist_ok=True)
    place = Path(mkdtemp(prefix=".scratch-", dir=out))
    try:
        yield place
    finally:
        rmtree(place, ignore_errors=True)


class SolvePorts:
    """A square operator on vectors of all inputs, from the rows that every shard has, kept in files.

    Parameters
    ----------
    network : ShardedNetwork
    folder : Path
        Where the rows are kept.
    name : str
        Of the files.
    """

    def __init__(self, network: ShardedNetwork, folder: Path, name: str) -> None:
        self.network, self.folder, self.name = network, folder, name
        self._kept: list[int] = []

    def keep(self, p: int, rows: sp.csr_array) -> None:
        """Keep the rows of a shard, whose columns are the inputs that it feeds."""
        fed, size = self.network.fed(p), int(self.network.starts[2][-1])
        kind = np.int32 if max(size, rows.nnz) < 2**31 else np.int64
        arrays = rows.data, fed.astype(kind)[rows.indices], rows.indptr.astype(kind)
        for path, array in zip(self._files(p), arrays, strict=True):
            np.save(path, array)
        self._kept.append(p)

    def _files(self, p: int) -> list[Path]:
        return [self.folder / f"{self.name}-{p}-{part}.npy" for part in ("data", "indices", "indptr")]

    def __matmul__(self, r: Floats) -> Floats:
        out = np.zeros(len(r))
        for p in self._kept:  # mapped anew each time, for the number of open files is limited
            arrays = tuple(map(_mapped, self._files(p)))
            own = self.network.own(p, 2)
            out[own] = sp.csr_array(arrays, shape=(own.stop - own.start, len(r)), copy=False) @ r
        return out

    def solve(self, b: Floats, tolerance: float) -> Floats:
        """r with r = T'r + b: sweeps over the shards, then BiCGSTAB where these are slow."""
        if not np.any(b):
            return b.copy()
        r, converged, grows = sweep(self, b, tolerance)
        return r if converged else krylov(self, b, b, tolerance, _DOOMED if grows else _ITERATIONS)[0]


def _mapped(path: Path) -> NDArray[Any]:
    return np.load(path, mmap_mode="r" if path.stat().st_size > _HEADER else None)
