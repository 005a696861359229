"""Growth of a network in shards, proven shard by shard.

A_cl x - rate x in X for a state x in X, x != 0, of a positive network means an eigenvalue of real part rate or more.
It is proven through lower bounds u <= W y and y <= C x + D u in the orders of U and Y.  What an input receives comes
from several shards.  So shard s also states z_s <= W_s y_s at the inputs that it feeds in other shards, and who has an
input proves that u there is at most what its own shard sends plus all z_s, by one form with a term for each of them:
nothing is added up beforehand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..cards import floored
from ..errors import CertificateFileError, UndecidedError
from ..exact.condition import all_hold
from ..exact.matrix import Matrix
from ..networks import conditions as on
from ..networks.blocks import Floats, Index
from ..networks.model import NetworkModel
from .network import ShardedNetwork, ranges, stated_double

VECTORS = ("x", "u", "y", "z")


@dataclass(frozen=True)
class Growth:
    """A state x in X, x != 0, with A_cl x - rate x in X, in the files of a certificate.

    Attributes
    ----------
    rate : float
        0 or more in continuous time, 1 or more in discrete time.
    alive : int
        How many entries of x are not 0.
    node : int
        Where x is largest, by its number in the source.
    discrete : bool
    """

    rate: float
    alive: int
    node: int
    discrete: bool

    def __str__(self) -> str:
        unit = "factor per step" if self.discrete else "rate"
        return (
            f"the network does not decay along a state x in X with {self.alive} nonzero entries "
            f"(growth {unit} at least {floored(self.rate, 3)}), which is largest at node {self.node}"
        )


@dataclass(frozen=True)
class Part:
    """What a shard has of a state: how many entries are not 0, the largest, and the place of the node that has it."""

    alive: int
    peak: float
    node: int

    @classmethod
    def of(cls, network: ShardedNetwork, p: int, model: NetworkModel, x: Floats) -> Part:
        """The part of a shard."""
        peaks = model.peaks(x)
        node = int(np.argmax(peaks))
        return cls(int(np.count_nonzero(x)), float(peaks[node]), network.own(p, 0).start + node)


def together(parts: Mapping[int, Part], rate: float, network: ShardedNetwork) -> Growth | None:
    """The growth that all shards show, if x is not 0."""
    alive = sum(part.alive for part in parts.values())
    if not alive:
        return None
    place = max(parts.values(), key=lambda part: part.peak).node
    return Growth(rate, alive, network.number(place), network.discrete)


def stated_rate(text: Any, network: ShardedNetwork, out: Path) -> float:
    """The rate of a state that grows, as the manifest of a certificate states it."""
    try:
        rate = stated_double(text)
    except (TypeError, ValueError, OverflowError):
        rate = np.nan
    if not float(network.discrete) <= rate < np.inf:
        raise CertificateFileError(f"the manifest of {out} states no rate of growth.")
    return rate


def senders(network: ShardedNetwork, *, verify: bool = False) -> dict[int, list[int]]:
    """For every shard with nodes, the others that feed it.  Costs one look at all halos."""
    out: dict[int, list[int]] = {p: [] for p in network.filled}
    for s in network.filled:
        for p in np.flatnonzero(np.diff(np.searchsorted(network.halo(s, verify=verify), network.starts[0]))).tolist():
            out[p].append(s)
    return out


def heard(network: ShardedNetwork, p: int, feeding: Sequence[int], z: Callable[[int], Floats]) -> tuple[Floats, Index]:
    """What the z of other shards are at inputs of a shard, and the places of these, shard after shard."""
    nodes, first_input = network.own(p, 0), network.own(p, 2).start
    values, places = [np.zeros(0)], [np.zeros(0, dtype=np.intp)]
    for s in feeding:
        halo = network.halo(s)
        begin, end = np.searchsorted(halo, [nodes.start, nodes.stop])
        _, first, sizes = network.receivers(halo[begin:end])
        skipped = int(network.receivers(halo[:begin])[2].sum())
        values.append(z(s)[skipped : skipped + int(sizes.sum())])
        places.append(ranges(first, sizes) - first_input)
    return np.concatenate(values), np.concatenate(places)


def is_growing(
    model: NetworkModel,
    vectors: Sequence[Floats],
    rate: float,
    received: tuple[Floats, Index],
    loop: Sequence[Floats] | None,
) -> bool:
    """The part of a positive shard by the kernel, from x, u, y and z; and of p and t, where t includes the halo."""
    x, u, y, z = vectors
    if not all(np.isfinite(part).all() for part in (*vectors, received[0], *(loop or ()))):
        return False
    values, places = received
    inputs, sent = Matrix(np.concatenate([u, z])), (Matrix(values), places)
    conditions = list(on.motion(model, Matrix(x), inputs, Matrix(y), rate, sent))
    if loop is not None:
        conditions += on.loop_gain(model, Matrix(loop[0]), Matrix(loop[1]))
    try:
        return all_hold(conditions)
    except UndecidedError:  # cones whose facets are no doubles, and too many of them
        return False
