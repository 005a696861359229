"""Who works on the shards of a network: here one process on all of them, elsewhere several that share them out.

A member of a team has shards that follow each other, and of every vector over all inputs the part that belongs to
them.  Steps are functions of one shard, of small data, and of vectors at the inputs that the shard feeds; what a step
leaves behind is in files of its shard.  So it may run in any process, and again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import KposError
from ..networks.blocks import Floats, Index
from ..networks.model import NetworkModel
from ..networks.own_links import own_links_closed
from .folders import keep_array, mapped
from .network import ShardedNetwork

Say = Callable[[str], None]
T = TypeVar("T")


@dataclass(frozen=True)
class Seen:
    """The inputs that a member sees: its own, which follow each other, and those of others that its shards feed.

    Attributes
    ----------
    own : slice
        Own inputs among all.
    away : ndarray
        The others, in their order.
    """

    own: slice
    away: Index

    def places(self, inputs: Index) -> Index:
        """Places of inputs, by their numbers among all, in a vector of those that are seen."""
        inside = (inputs >= self.own.start) & (inputs < self.own.stop)
        beyond = self.own.stop - self.own.start + np.searchsorted(self.away, inputs)
        return np.where(inside, inputs - self.own.start, beyond)


@dataclass(frozen=True, eq=False)
class Shard:
    """A shard as a step sees it.

    Attributes
    ----------
    network : ShardedNetwork
    out : Path
        Where the certificate goes.
    aside : Path
        Where files go that are needed until it is written.
    p : int
        The number of the shard.
    seen : Seen or None
        What vectors have entries for; None for all inputs.
    """

    network: ShardedNetwork
    out: Path
    aside: Path
    p: int
    seen: Seen | None = None

    @cached_property
    def places(self) -> Index:
        """Places in vectors of the inputs that the shard feeds: its own, then the halo; as `keep_places` left them."""
        return mapped(self.file("places"))

    def keep_places(self) -> None:
        """Find the places, for all steps that follow."""
        fed = self.network.fed(self.p)
        places = fed if self.seen is None else self.seen.places(fed)
        small = places.max(initial=0) < 2**31
        keep_array(self.file("places"), places.astype(np.int32) if small else places)

    @property
    def inputs(self) -> slice:
        """Places of its own inputs in vectors."""
        own = self.network.own(self.p, 2)
        first = 0 if self.seen is None else self.seen.own.start
        return slice(own.start - first, own.stop - first)

    def forget(self) -> None:
        """Remove what a run that did not end has kept of the shard, but for guesses of r."""
        for file in self.aside.glob(f"*-{self.p:05d}.npy"):
            if not file.name.startswith("guess-"):
                file.unlink(missing_ok=True)

    def file(self, name: str) -> Path:
        """Where an array of the shard is kept until the certificate is written."""
        return self.aside / f"{name}-{self.p:05d}.npy"

    @property
    def _closed(self) -> Path:
        return self.aside / f"closed-{self.p:05d}"

    def close_own_links(self, really: bool) -> None:
        """Remember whether links of nodes to themselves are a part of these nodes."""
        if really:
            self._closed.touch()
        else:
            self._closed.unlink(missing_ok=True)

    def model(self) -> NetworkModel:
        """The shard in the form that is positive."""
        model = self.network.model(self.p)
        closed = own_links_closed(model) if self._closed.exists() else None
        return model if closed is None else closed


@dataclass(eq=False)
class Team:
    """One process with all shards.

    Attributes
    ----------
    network : ShardedNetwork
    out, aside : Path
    report : callable
        Is told what is being done.
    deadline : float
        When to end the search, on the clock of `time.monotonic`.
    """

    network: ShardedNetwork
    out: Path
    aside: Path
    report: Say
    seen: Seen | None = field(init=False, default=None)
    deadline: float = field(init=False, default=math.inf)

    @cached_property
    def shards(self) -> list[int]:
        """The shards with nodes that this member has."""
        return list(self.network.filled)

    def own(self, p: int, kind: int) -> slice:
        """The inputs (kind 2) or outputs (3) of a shard among those of this member."""
        of, first = self.network.own(p, kind), self.network.own(self.shards[0], kind).start
        return slice(of.start - first, of.stop - first)

    def zeros(self, kind: int) -> Floats:
        """A vector with an entry for every input (kind 2) or output (3) of this member."""
        return np.zeros(self.own(self.shards[-1], kind).stop if self.shards else 0)

    # -- steps

    def each(
        self,
        what: str,
        step: Callable[..., T],
        *given: Any,
        sees: Sequence[Floats] = (),
        until: Callable[[T], bool] | None = None,
    ) -> list[tuple[int, T]]:
        """`step` for every shard of this member, one after the other, with the numbers of the shards.

        All members are in it together: where a step ends with an error of the package, or of the files, all of them
        raise the one of the first shard.

        Parameters
        ----------
        what : str
            For the progress report; "" says nothing.
        step : function
            Of a `Shard`, the vectors and what is given.
        sees : sequence of ndarray
            Vectors of this member's inputs; the step has them for all inputs that are seen.
        until : function, optional
            Of what a step returns: True if later shards of this member need no step.
        """
        vectors = [self.shown(vector) for vector in sees]
        out: list[tuple[int, T]] = []
        ended, error, begun = None, None, time.monotonic()
        for p in self.shards:
            if what:
                self.report(f"{what} of shard {p + 1} of {self.network.n_shards}{_pace(len(out), begun)}")
            try:
                found = step(Shard(self.network, self.out, self.aside, p, self.seen), *vectors, *given)
            except (KposError, OSError) as caught:
                ended, error = p, caught
                break
            out.append((p, found))
            if until is not None and until(found):
                ended = p
                break
        self.agree(ended, error)
        return out

    def agree(self, at: int | None = None, error: Exception | None = None) -> None:
        """Raise the error of the first shard where the work has ended, on all members; nothing if it has none."""
        if error is not None:
            raise error

    def lead(self, work: Callable[[], object]) -> None:
        """Something that one member does for all, such as the manifest; all go on when it is done."""
        work()

    def shown(self, vector: Floats) -> Floats:
        """A vector of this member's inputs, with the entries of others that are seen."""
        return vector

    def collect(
        self,
        what: str,
        step: Callable[..., tuple[Sequence[Floats], T]],
        *given: Any,
        sees: Sequence[Floats] = (),
        count: int = 1,
    ) -> tuple[list[Floats], dict[int, T]]:
        """What all shards together send to every input of this member, and what the steps of its own tell besides.

        Parameters
        ----------
        what, step, given, sees
            As for `each`.  The step answers with vectors at the inputs that its shard feeds, its own and then the halo,
            and with anything else.
        count : int
            How many vectors these are.
        """
        beyond = 0 if self.seen is None else len(self.seen.away)
        totals = [np.concatenate([self.zeros(2), np.zeros(beyond)]) for _ in range(count)]
        told: dict[int, T] = {}
        for p, (sent, told[p]) in self.each(what, step, *given, sees=sees):
            places = Shard(self.network, self.out, self.aside, p, self.seen).places
            for total, part in zip(totals, sent, strict=True):
                total[places] += part
        return [self.home(total) for total in totals], told

    def home(self, vector: Floats) -> Floats:
        """The other way round: at this member's inputs, the sum of what all members have for them."""
        return vector

    # -- what all members agree on

    def all(self, mine: bool) -> bool:
        """True if it is true for every member."""
        return mine

    def in_time(self) -> bool:
        """True before the deadline, of all members."""
        return self.deadline == math.inf or self.all(time.monotonic() < self.deadline)

    def most(self, mine: float) -> float:
        """The largest of the numbers of all members; not a number if one is."""
        return mine

    def first(self, mine: tuple[int, Any] | None) -> tuple[int, Any] | None:
        """Of what the members have found, if anything, that of the first shard."""
        return mine

    def together(self, mine: Mapping[int, T]) -> dict[int, T]:
        """What every member knows of its shards, by their numbers."""
        return dict(mine)

    def dot(self, a: Floats, b: Floats) -> np.float64:
        """The product of two vectors; the same however many members there are."""
        parts = [float(np.einsum("i,i->", a[own], b[own])) for own in (self.own(p, 2) for p in self.shards)]
        return np.float64(self._sum(parts))

    def _sum(self, parts: list[float]) -> float:
        return exact_sum(parts)

    def size(self, a: Floats) -> float:
        """The largest absolute value of the entries of a vector."""
        return self.most(float(np.abs(a).max(initial=0.0)))


def _pace(count: int, begun: float) -> str:
    """How fast it goes, once that can be told."""
    seconds = time.monotonic() - begun
    return f", {count / seconds:.2g} shards a second" if count and seconds > 1 else ""


def exact_sum(parts: Sequence[float]) -> float:
    """The sum of numbers, rounded once, so that their order does not matter; not a number where there is none."""
    if not all(map(math.isfinite, parts)):
        return math.nan
    try:
        return math.fsum(parts)
    except OverflowError:
        return math.inf
