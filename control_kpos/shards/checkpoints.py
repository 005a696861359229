"""Guesses of r in files, from which a solve that was interrupted goes on, with any number of processes.

They are named after the network and the accuracy, so that those of another network are not seen.  Nothing in them is
trusted: a guess that is worse than none is not used, and whatever a solve gives has to be proven.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.lib import format as npy

from ..networks.blocks import Floats
from ..proof.files import digest
from .folders import HEADER, keep_array
from .teams import Shard, Team

# Seconds between guesses that are kept while a solve goes on.
_EVERY = 30.0


class Checkpoints:
    """What is kept of r while a network is solved.

    Parameters
    ----------
    team : Team
    """

    def __init__(self, team: Team) -> None:
        self.team, self.last = team, time.monotonic()
        self.about = digest(team.network.data).partition(":")[2][:16]

    def _name(self, tolerance: float) -> str:
        return f"guess-{self.about}-{tolerance:g}"

    def start(self, tolerance: float) -> Floats | None:
        """What was kept for this accuracy; None if it is not whole."""
        out, whole = self.team.zeros(2), True
        for p, part in self.team.each("", kept, self._name(tolerance)):
            whole &= part is not None
            if part is not None:
                out[self.team.own(p, 2)] = part
        return out if self.team.all(whole) else None

    def offer(self, tolerance: float, r: Floats) -> None:
        """Keep r, if it is time to."""
        if self.team.most(time.monotonic() - self.last) > _EVERY:
            self.write(tolerance, r)

    def write(self, tolerance: float, r: Floats) -> None:
        """Keep r."""
        self.team.each("", keep, self._name(tolerance), sees=[r])
        self.last = time.monotonic()


def keep(shard: Shard, r: Floats, name: str) -> None:
    """Keep r at own inputs."""
    keep_array(shard.file(name), r[shard.inputs])


def kept(shard: Shard, name: str) -> Floats | None:
    """What was kept of it, or None if there is nothing, or nothing of use."""
    own, path = shard.inputs, shard.file(name)
    size = own.stop - own.start
    try:
        with open(path, "rb") as stream:
            if path.stat().st_size != HEADER + 8 * size:
                return None
            part = npy.read_array(stream, allow_pickle=False)
    except (OSError, ValueError, EOFError, SyntaxError):
        return None
    fits = part.shape == (size,) and part.dtype == np.float64 and np.isfinite(part).all()
    return part if fits else None
