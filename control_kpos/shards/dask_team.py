"""A team of Dask workers: the client keeps the vectors, workers do the steps, files carry what steps leave behind.

Workers and client see the same folders.  A step reads files that earlier steps have written and writes those of its
own shard, so that Dask may run it again when a worker is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

import numpy as np

from ..errors import DataError, KposError, SolverError
from ..exact.intake import found
from ..networks.blocks import Floats
from .folders import keep_array
from .network import ShardedNetwork
from .teams import Say, Shard, Team

T = TypeVar("T")


class DaskTeam(Team):
    """The workers of a Dask cluster.

    Parameters
    ----------
    network : ShardedNetwork
    out, aside : Path
    report : callable
    client : distributed.Client
    """

    def __init__(self, network: ShardedNetwork, out: Path, aside: Path, report: Say, client: Any) -> None:
        super().__init__(network, out, aside, report)
        self.client, self._numbers = client, count()
        self._job = uuid4().hex[:12]  # the scheduler gives what it remembers of a key, also of an error

    def each(
        self,
        what: str,
        step: Callable[..., T],
        *given: Any,
        sees: Sequence[Floats] = (),
        until: Callable[[T], bool] | None = None,
    ) -> list[tuple[int, T]]:
        """See `Team`; all shards at a time, as many as there are workers.

        Raises
        ------
        SolverError
            The cluster gave up: no workers are left, or several have died with the same shard.
        """
        number, out = next(self._numbers), []
        files = [self._published(vector, f"{number}-{k}") for k, vector in enumerate(sees)]
        folders = tuple(str(place.resolve()) for place in (self.network.folder, self.out, self.aside))
        futures = self.client.map(  # those that are let go of are cancelled
            _do,
            self.shards,
            step=step,
            folders=folders,
            files=files,
            given=given,
            key=[f"{step.__name__}-{self._job}-{number}-{p}" for p in self.shards],
            pure=False,
        )
        for p, future in zip(self.shards, futures, strict=True):
            if what:
                self.report(f"{what} of shard {p + 1} of {self.network.n_shards}")
            out.append((p, _result(future, p)))
            if until is not None and until(out[-1][1]):
                break
        for file in files:
            Path(file).unlink(missing_ok=True)
        return out

    def _published(self, vector: Floats, name: str) -> str:
        """A file with the vector, for the workers."""
        path = self.aside.resolve() / f"seen-{name}.npy"
        keep_array(path, vector)
        return str(path)


def _result(future: Any, p: int) -> Any:
    try:
        return future.result()
    except (KposError, OSError):
        raise
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in ("distributed", "dask", "concurrent", "asyncio"):
            raise
        raise SolverError(
            f"the Dask cluster gave up shard {p} ({type(error).__name__}); see its log for workers that ran out of "
            "memory, give it more of it, or write the network in more parts."
        ) from None


@np.errstate(all="ignore")
def _do(p: int, step: Callable[..., T], folders: tuple[str, str, str], files: list[str], given: Sequence[Any]) -> T:
    """A step in a worker."""
    folder, out, aside = map(Path, folders)
    manifest = folder / "manifest.json"
    stamp = manifest.stat().st_mtime_ns if manifest.exists() else 0
    vectors = [np.load(file, mmap_mode="r") for file in files]
    return step(Shard(_network(folder, stamp), out, aside, p), *vectors, *given)


@lru_cache(maxsize=1)
def _network(folder: Path, stamp: int) -> ShardedNetwork:
    """The network in a folder; read once by every worker."""
    return ShardedNetwork.open(folder)


def read_client(client: Any) -> Any:
    """A Dask client.

    Raises
    ------
    DataError
        It is not one, is asynchronous, or is closed.
    """
    kind = type(client)
    if not any(c.__module__.partition(".")[0] == "distributed" and c.__name__ == "Client" for c in kind.__mro__):
        raise DataError(f"client is {found(client)}; give a distributed.Client, or None.")
    if getattr(client, "asynchronous", False):
        raise DataError("client is asynchronous; give one that is not: distributed.Client(..., asynchronous=False).")
    if getattr(client, "status", "running") == "closed":
        raise DataError("client is closed; give one that is connected: distributed.Client(...).")
    return client
