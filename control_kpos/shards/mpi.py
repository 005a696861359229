"""Processes of MPI that share out the shards of a network.

Each has shards that follow each other, the parts of vectors that belong to them, and where its links lead into others,
the entries there, which are exchanged before every step that needs them.  None has anything of the length of the whole.
Nothing here imports mpi4py but `world`, which the command line asks for: who has a communicator has imported it.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np

from ..errors import DataError, KposError
from ..exact.intake import found
from ..networks.blocks import Floats, Index
from .network import ShardedNetwork
from .teams import Seen, Team, exact_sum

T = TypeVar("T")

# Variables by which launchers tell a process how many there are, and which one it is.
_LAUNCHERS = {
    "PMI_SIZE": "PMI_RANK",
    "OMPI_COMM_WORLD_SIZE": "OMPI_COMM_WORLD_RANK",
    "MV2_COMM_WORLD_SIZE": "MV2_COMM_WORLD_RANK",
}
# Later than any shard.
_NEVER = 2**62
# Exit status of a job that an unexpected error has ended.
_ABORTED = 3
# Numbers of inputs that are waited for before they are merged with those known.
_MERGED = 2**20


class Ranks:
    """The processes of a communicator, and what they agree on.

    Parameters
    ----------
    comm : mpi4py.MPI.Intracomm

    Raises
    ------
    DataError
        Something else.
    """

    def __init__(self, comm: Any) -> None:
        mpi: Any = sys.modules.get("mpi4py.MPI")
        if mpi is None or not isinstance(comm, mpi.Intracomm) or comm == mpi.COMM_NULL:
            raise DataError(f"comm is {found(comm)}; give a communicator of mpi4py, such as MPI.COMM_WORLD.")
        self.comm, self.mpi = comm, mpi
        self.rank, self.size = int(comm.rank), int(comm.size)

    def reduced(self, values: Sequence[float], kind: type, name: str) -> list[Any]:
        """The smallest or largest ("MIN", "MAX") of each of a few numbers of all ranks."""
        mine = np.array(values, dtype=kind)
        out = np.empty_like(mine)
        self.comm.Allreduce(mine, out, op=getattr(self.mpi, name))
        return out.tolist()

    def agree(self, at: int | None = None, error: Exception | None = None) -> None:
        """Raise the error at the first place on all ranks, unless the work of one has ended without before it."""
        mine = _NEVER if at is None else 2 * at + (error is not None)
        first = self.reduced([mine], np.int64, "MIN")[0]
        if first == _NEVER or first % 2 == 0:
            return
        errors = self.comm.allgather(error if mine == first else None)
        raise error if error is not None and mine == first else next(e for e in errors if e is not None)

    def require_alike(self, mine: str) -> None:
        """Raise, on all ranks, if they were called with different arguments."""
        others = self.comm.allgather(mine)
        other = next((k for k, text in enumerate(others) if text != others[0]), None)
        if other is not None:
            raise DataError(
                f"ranks 0 and {other} are given different arguments, {others[0]} and {others[other]}; give the same."
            )

    def same(self, work: Callable[[], T]) -> T:
        """Do something on all ranks; if it fails on some, all raise the error of the first."""
        out, error = None, None
        try:
            out = work()
        except (KposError, OSError) as caught:
            error = caught
        self.agree(None if error is None else self.rank, error)
        return cast(T, out)


@dataclass(frozen=True, eq=False)
class Plan:
    """Which entries go where in an exchange.

    Attributes
    ----------
    ours : ndarray
        Places of own inputs that others see, rank by rank.
    given, wanted : ndarray
        How many go to every rank, and come from it.
    """

    ours: Index
    given: Index
    wanted: Index

    @classmethod
    def made(cls, ranks: Ranks, seen: Seen, cuts: Index) -> Plan:
        """From what every rank sees; `cuts` are the first inputs of all ranks, and the number of inputs."""
        wanted = np.diff(np.searchsorted(seen.away, cuts)).astype(np.int64)
        given = np.empty_like(wanted)
        ranks.comm.Alltoall(wanted, given)
        asked = np.empty(int(given.sum()), dtype=np.int64)
        ranks.comm.Alltoallv([seen.away, wanted], [asked, given])
        asked -= seen.own.start
        small = seen.own.stop - seen.own.start < 2**31
        return cls(asked.astype(np.int32) if small else asked, given, wanted)


@dataclass(eq=False, kw_only=True)
class MpiTeam(Team):
    """Ranks of MPI, which have shards that follow each other; all make it, and call its methods, together.

    Attributes
    ----------
    ranks : Ranks
    """

    ranks: Ranks

    def __post_init__(self) -> None:
        if self.ranks.size > 1:
            say, whose = self.report, f"rank {self.ranks.rank} of {self.ranks.size}"
            self.report = lambda line: say(f"{line} ({whose})")
            self.seen = self.ranks.same(self._sees)
            self._plan = Plan.made(self.ranks, self.seen, self._cuts)

    @cached_property
    def _shares(self) -> list[list[int]]:
        return shared_out(self.network, self.ranks.size)

    @cached_property
    def shards(self) -> list[int]:
        return self._shares[self.ranks.rank]

    @cached_property
    def _cuts(self) -> Index:
        """Where the inputs of every rank begin, and their number."""
        starts = self.network.starts[2]
        out = np.full(self.ranks.size + 1, starts[-1], dtype=np.int64)
        for rank in reversed(range(self.ranks.size)):
            share = self._shares[rank]
            out[rank] = starts[share[0]] if share else out[rank + 1]
        return out

    def _sees(self) -> Seen:
        first, last = map(int, self._cuts[self.ranks.rank : self.ranks.rank + 2])
        fed = (self.network.fed(p, verify=True) for p in self.shards)
        return Seen(slice(first, last), distinct(x[(x < first) | (x >= last)] for x in fed))

    def shown(self, vector: Floats) -> Floats:
        if self.seen is None:
            return vector
        own, plan = len(vector), self._plan
        out = np.empty(own + len(self.seen.away))
        out[:own] = vector
        self.ranks.comm.Alltoallv([vector[plan.ours], plan.given], [out[own:], plan.wanted])
        return out

    def home(self, vector: Floats) -> Floats:
        if self.seen is None:
            return vector
        own, plan = self.seen.own.stop - self.seen.own.start, self._plan
        out, received = vector[:own].copy(), np.empty(int(plan.given.sum()))
        self.ranks.comm.Alltoallv([vector[own:], plan.wanted], [received, plan.given])
        np.add.at(out, plan.ours, received)
        return out

    def agree(self, at: int | None = None, error: Exception | None = None) -> None:
        self.ranks.agree(at, error)

    def lead(self, work: Callable[[], object]) -> None:
        self.ranks.same(work if self.ranks.rank == 0 else lambda: None)

    def all(self, mine: bool) -> bool:
        return bool(self.ranks.reduced([mine], np.int64, "MIN")[0])

    def most(self, mine: float) -> float:
        none = bool(np.isnan(mine))
        some, largest = self.ranks.reduced([none, 0.0 if none else mine], np.float64, "MAX")
        return np.nan if some else largest

    def first(self, mine: tuple[int, Any] | None) -> tuple[int, Any] | None:
        return min((x for x in self.ranks.comm.allgather(mine) if x is not None), key=lambda x: x[0], default=None)

    def together(self, mine: Mapping[int, T]) -> dict[int, T]:
        out: dict[int, T] = {}
        for part in self.ranks.comm.allgather(dict(mine)):
            out |= part
        return out

    def _sum(self, parts: list[float]) -> float:
        counts = [len(share) for share in self._shares]
        out = np.empty(sum(counts))
        self.ranks.comm.Allgatherv(np.array(parts, dtype=np.float64), [out, counts])
        return exact_sum(out.tolist())


def shared_out(network: ShardedNetwork, size: int) -> list[list[int]]:
    """The shards with nodes for every rank: groups that follow each other, with about as many nodes each."""
    starts, out = network.starts[0], [list[int]() for _ in range(size)]
    for p in network.filled:
        middle = int(starts[p]) + int(starts[p + 1])
        out[middle * size // (2 * network.n_nodes)].append(p)
    return out


def distinct(parts: Iterable[Index]) -> Index:
    """The numbers that occur, in their order; takes memory for some twice of them, however often they occur."""
    known, waiting, count = np.zeros(0, dtype=np.int64), list[Index](), 0
    for part in parts:
        waiting.append(part)
        count += len(part)
        if count > len(known) + _MERGED:
            known, waiting, count = _merged(known, waiting), [], 0
    return _merged(known, waiting)


def _merged(known: Index, waiting: list[Index]) -> Index:
    both = np.concatenate([known, *waiting])
    both.sort()  # np.unique of integers hashes, which takes far longer
    return both[np.diff(both, prepend=-1) > 0]


# -- the command line


def launched() -> tuple[int, int]:
    """The number of this process among those that a launcher of MPI has started, and how many; (0, 1) if none has."""
    for size, rank in _LAUNCHERS.items():
        numbers = os.environ.get(rank, ""), os.environ.get(size, "")
        if all(map(str.isdecimal, numbers)):
            return int(numbers[0]), int(numbers[1])
    return 0, 1


def world() -> Any:
    """The communicator of all processes.

    Raises
    ------
    DataError
        mpi4py is not installed, or finds no MPI.
    """
    try:
        from mpi4py import MPI  # noqa: PLC0415  (starts MPI)
    except (ImportError, RuntimeError) as error:
        raise DataError(
            f'MPI needs mpi4py, which cannot be used here ({error}): pip install "control_kpos[mpi]".'
        ) from None
    return MPI.COMM_WORLD


@contextmanager
def aborting(comm: Any) -> Iterator[None]:
    """Within, an error that is none of the package ends the processes of all ranks at once, with its message."""
    try:
        yield
    except Exception:
        if comm is None or comm.size == 1:
            raise
        sys.stdout.flush()
        sys.stderr.write(f"rank {comm.rank} of {comm.size} ends the job:\n{traceback.format_exc()}")
        sys.stderr.flush()
        comm.Abort(_ABORTED)
