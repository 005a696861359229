"""The port equations r = T'r + b of a network in shards; untrusted, the proof checks what they give.

A shard has the rows of T' that belong to its own inputs, G'W' with its transfer matrices G.  They are kept in files
and mapped; in memory are vectors with an entry for every input that is seen, and nothing else of all shards.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..exact.budget import OutOfBudgetError
from ..networks.blocks import Floats
from ..networks.spectrum.port_solves import Keep, krylov, sweep
from .folders import keep_array, mapped
from .teams import Shard, Team

# Steps of BiCGSTAB where sweeps are slow, and where they grow.
_ITERATIONS = 400
_DOOMED = 50


def keep_rows(shard: Shard, name: str, rows: sp.csr_array) -> None:
    """Keep the rows of a shard, with columns in two ways: inputs that it feeds, and their places in vectors."""
    places = shard.places
    kind = np.int32 if places.dtype == np.int32 and rows.nnz < 2**31 else np.int64
    arrays = rows.data, places.astype(kind)[rows.indices], rows.indptr.astype(kind)
    for path, array in zip(_files(shard, name), arrays, strict=True):
        keep_array(path, array)
    keep_array(shard.file(f"{name}-columns"), rows.indices.astype(kind))


def _files(shard: Shard, name: str, columns: str = "indices") -> list[Path]:
    return [shard.file(f"{name}-{part}") for part in ("data", columns, "indptr")]


def product(shard: Shard, r: Floats, name: str) -> Floats:
    """The rows of a shard times a vector; zeros if none are kept."""
    own = shard.inputs
    rows = _kept(shard, _files(shard, name), len(r))
    return np.zeros(own.stop - own.start) if rows is None else rows @ r


def sent(shard: Shard, u: Floats, name: str) -> tuple[tuple[Floats], None]:
    """What the columns that a shard has of the transposed operator send, for `Team.collect`."""
    width = len(shard.places)
    rows = _kept(shard, _files(shard, name, "columns"), width)
    return (np.zeros(width) if rows is None else rows.T @ u[shard.inputs],), None


def _kept(shard: Shard, files: list[Path], width: int) -> sp.csr_array | None:
    """The rows of a shard, mapped; None if none are kept."""
    own = shard.inputs
    if not files[0].exists():
        return None
    arrays = tuple(map(mapped, files))  # anew each time, for the number of open files is limited
    return sp.csr_array(arrays, shape=(own.stop - own.start, width), copy=False)


class SolvePorts:
    """A square operator on vectors of inputs, from the rows that every shard keeps.

    Parameters
    ----------
    team : Team
    name : str
        Of the rows.
    """

    def __init__(self, team: Team, name: str) -> None:
        self.team, self.name = team, name

    def __matmul__(self, r: Floats) -> Floats:
        if not self.team.in_time():
            raise OutOfBudgetError
        out = np.empty_like(r)
        for p, part in self.team.each("", product, self.name, sees=[r]):
            out[self.team.own(p, 2)] = part
        return out

    def solve(self, b: Floats, tolerance: float, start: Floats | None = None, keep: Keep = None) -> Floats:
        """r with r = T'r + b: sweeps over the shards, then BiCGSTAB where these are slow.

        Parameters
        ----------
        start : ndarray, optional
            A guess of r; not used if it is worse than 0.
        keep : callable, optional
            Is given r now and then, to be started from again.
        """
        team = self.team
        if not team.size(b) > 0:
            return b.copy()
        watched = _Watched(self, tolerance)
        if start is not None and not team.size(b - (start - watched @ start)) <= team.size(b):
            start = None
        r, converged, grows = sweep(watched, b, tolerance, size=watched.size, start=start, keep=keep)
        if converged:
            return r
        limit = _DOOMED if grows else _ITERATIONS
        return krylov(watched, b, b if start is None else r, tolerance, limit, dot=watched.dot, keep=keep)[0]


class _Watched:
    """The operator of a solve, which reports how far it is."""

    def __init__(self, ports: SolvePorts, tolerance: float) -> None:
        self.ports, self.team, self.count = ports, ports.team, 0
        self.what = f"solving, accuracy {tolerance:g}"

    def __matmul__(self, r: Floats) -> Floats:
        self.count += 1
        return self.ports @ r

    def size(self, a: Floats) -> float:
        """Of b, and of what a sweep adds."""
        return self._told(self.team.size(a))

    def dot(self, a: Floats, b: Floats) -> np.float64:
        """Of a residual with itself, among others."""
        value = self.team.dot(a, b)
        if a is b:
            self._told(float(np.sqrt(value)))
        return value

    def _told(self, residual: float) -> float:
        self.team.report(f"{self.what}: {self.count} products, residual {residual:.1e}")
        return residual
