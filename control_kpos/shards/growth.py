"""The search for a state of a network in shards that grows; untrusted, the proof checks what it gives.

At a shift above the poles of the nodes T = W G is a nonnegative operator on U, and the network has a pole at the shift
or beyond it if the spectral radius of T is 1 or more.  With T u = rho u, rho > 1, a shift a little higher leaves
T u >= u, and x = K B u has A_cl x - shift x = B (T u - u) in X.  Power iterations find u, and where they are slow
inverse iterations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cones import Orthant
from ..networks.blocks import Floats
from ..networks.spectrum.port_solves import krylov, sweep
from . import growth_steps as steps
from . import ports
from .growth_proof import Growth, Part, senders, together
from .teams import Team

# Power iterations, inverse iterations, the first of these with the whole network, and steps of BiCGSTAB in each.
_POWERS, _INVERSES, _ROUGH, _ITERATIONS = 40, 12, 3, 100
# Accuracy of their solves, first and later.
_ACCURACIES = (1e-3, 1e-6)
# What is not tiny, as a part of the largest, and how much of |rho - 1| may be missing at inputs where u is not.
_CORE, _LOOSE = 1e-6, 0.1
# Parts of the distance to the shift at which T u falls to u where the state is sought, and of that where it is proven.
_SHIFTS = (0.5, 0.1)
_RATES = 0.5
# Rounds of cutting down.
_CUTS = 12


@dataclass(frozen=True, eq=False)
class Shown:
    """A proof of growth: what is proven, and the entries of the files of all shards in the manifest."""

    growth: Growth
    shards: list[dict[str, Any]]


class _Sent:
    """T of all shards, from the rows of T' that they keep."""

    def __init__(self, team: Team, name: str, scale: float = 1.0, core: NDArray[np.bool_] | None = None) -> None:
        self.team, self.name, self.scale, self.core = team, name, scale, core

    def __matmul__(self, u: Floats) -> Floats:
        (out,), _ = self.team.collect("", ports.sent, self.name, sees=[u])
        out *= self.scale
        return out if self.core is None else np.where(self.core, out, 0.0)


class Search:
    """The search for growth beyond a shift that the rows of T' are kept for.

    Parameters
    ----------
    team : Team
    name, direct : str
        Of the rows, and of those of the algebraic loops.
    least : float
        The shift.
    t : ndarray or None
        With feedthrough: the weights that prove the algebraic loops to contract, p in files.
    """

    def __init__(self, team: Team, name: str, direct: str, least: float, t: Floats | None) -> None:
        self.team, self.name, self.direct, self.least, self.t = team, name, direct, least, t
        self._feeding: dict[int, list[int]] | None = None

    def found(self, *, brief: bool = False) -> Shown | None:
        """A state that grows, proven and written; None if none was found.  `brief`: by power iterations alone."""
        lone = self._alone()
        if lone is not None:
            return self._proven(*lone)
        for u, radius in self._candidates(brief):
            if radius > 1:
                shown = self._tried(u, radius)
                if shown is not None:
                    return shown
        return None

    def _tried(self, u: Floats, radius: float) -> Shown | None:
        """x = K B u at shifts up to that where T u falls to u."""
        (fall,), _ = self.team.collect("slopes", steps.slopes, self.least, sees=[u])
        reach = (radius - 1) / self._quotient(u, fall)
        for part in _SHIFTS if 0 < reach < np.inf else ():
            rate = self.least + _RATES * part * reach
            heard = self._state(u, self.least + part * reach, rate)
            shown = None if heard is None else self._proven(rate, heard)
            if shown is not None:
                return shown
        return None

    def _alone(self) -> tuple[float, Floats] | None:
        """A node that grows by itself: its rate, and nothing that it receives."""
        team = self.team
        rates = team.each("nodes alone", steps.alone, self.least, until=lambda rate: rate is not None)
        chosen = team.first(next((found for found in rates if found[1] is not None), None))
        if chosen is None:
            return None
        team.each("", steps.nothing_but, chosen[0])
        (sent,), _ = team.collect("outputs", steps.outputs)
        return chosen[1], self._received(sent)

    # -- u

    def _quotient(self, u: Floats, ahead: Floats) -> float:
        return float(self.team.dot(self.dual, ahead) / self.team.dot(self.dual, u))

    def _candidates(self, brief: bool) -> Iterator[tuple[Floats, float]]:
        """u with T u about rho u, and rho, better and better."""
        team = self.team
        u, self.dual = team.zeros(2), team.zeros(2)
        for p, (point, dual) in team.each("start", steps.begin):
            own = team.own(p, 2)
            u[own], self.dual[own] = point, dual
        T, radius = _Sent(team, self.name), 0.0
        for count in range(_POWERS):
            u, ahead, radius, settled = self._looked_at(T, u)
            if settled or not team.in_time():
                yield u, radius
                return
            team.report(f"growth, iteration {count + 1}: spectral radius about {radius:.6g}")
            u = ahead / radius + 1e-3 * u if radius > 0 else u
        if brief:
            yield u, radius
        else:
            yield from self._inverted(T, u)

    def _inverted(self, T: _Sent, u: Floats) -> Iterator[tuple[Floats, float]]:
        """The same by inverse iterations, from above; later on the inputs alone where u is not tiny.

        What T sends from there to others only adds to T u, so that a vector that grows there does so in the network.
        """
        team = self.team
        u, ahead, radius, _ = self._looked_at(T, u)
        for count in range(_INVERSES):
            if not (radius > 0 and team.in_time()):
                return
            if count == _ROUGH and self._orthants:
                T = _Sent(team, self.name, core=u > _CORE)
                u, ahead, radius, _ = self._looked_at(T, np.where(u > _CORE, u, 0.0))
            error = ahead - radius * u
            shift = radius + max(np.sqrt(float(team.dot(error, error) / team.dot(u, u))), 1e-12 * radius)
            scaled = _Sent(team, self.name, 1 / shift, T.core)
            tolerance = _ACCURACIES[count >= _ROUGH]
            better, _ = krylov(scaled, u, u / (1 - radius / shift), tolerance, _ITERATIONS, dot=team.dot)
            if not 0 < team.size(better) < np.inf:
                return
            better = better if team.dot(self.dual, better) > 0 else -better
            u, ahead, radius, settled = self._looked_at(T, np.maximum(better, 0.0) if self._orthants else better)
            team.report(f"growth, inverse iteration {count + 1}: spectral radius about {radius:.6g}")
            yield u, radius
            if settled:
                return

    @cached_property
    def _orthants(self) -> bool:
        """True if all input cones are orthants."""
        network = self.team.network
        kinds = {t["U"] for shard in network.data["shards"] for t in shard["stacks"]}
        return all(isinstance(network.cones[k], Orthant) for k in kinds)

    def _looked_at(self, T: _Sent, u: Floats) -> tuple[Floats, Floats, float, bool]:
        """u scaled, T u, a quotient, and whether this tells growth from decay wherever u is not tiny."""
        team = self.team
        size = team.size(u)
        if not 0 < size < np.inf:
            return u, u, 0.0, True
        u = u / size
        ahead = T @ u
        radius = self._quotient(u, ahead)
        loose = np.abs(ahead - radius * u) > _LOOSE * abs(radius - 1) * np.abs(u)
        return u, ahead, radius, team.all(not (loose & (np.abs(u) > _CORE)).any())

    # -- x

    def _state(self, u: Floats, shift: float, rate: float) -> Floats | None:
        """x of every shard in files, cut down to where it grows at the rate, and u; None if nothing is."""
        team = self.team
        (sent,), _ = team.collect(f"states at {shift:.3g}", steps.state, shift, sees=[u])
        for count in range(_CUTS):
            if not team.in_time():
                return None
            heard = self._received(sent)
            (sent,), told = team.collect(f"growing part, round {count + 1},", steps.cut, rate, sees=[heard])
            if team.all(not any(told.values())):
                return heard
        return None

    def _received(self, sent: Floats) -> Floats:
        """u = W (C x + D u), from W C x."""
        if self.t is None:
            return sent
        T, team = _Sent(self.team, self.direct), self.team
        u, converged, _ = sweep(T, sent, 1e-15, size=team.size)
        return u if converged else krylov(T, sent, u, 1e-15, _ITERATIONS, dot=team.dot)[0]

    # -- the proof

    def _proven(self, rate: float, heard: Floats) -> Shown | None:
        team, network = self.team, self.team.network
        (value, size), written = team.collect("outputs", steps.emit, sees=[heard], count=2)
        if self._feeding is None:
            self._feeding = senders(network)
        sees = [value, size, value if self.t is None else self.t]
        given = rate, self._feeding, self.t is not None
        found: dict[int, tuple[Part, dict[str, Any]]] = {}
        for p, part in team.each("proof of growth", steps.prove, *given, sees=sees, until=lambda part: part is None):
            if part is not None:
                found[p] = part[0], {"files": written[p] | part[1]}
        if not team.all(len(found) == len(team.shards)):
            return None
        shards = team.together(found)
        parts, mine = {p: part for p, (part, _) in shards.items()}, list[Growth | None]()
        team.lead(lambda: mine.append(together(parts, rate, network)))  # reads a file
        growth = (team.first((0, mine[0]) if mine else None) or (0, None))[1]
        entries = [shards[p][1] if p in shards else {} for p in range(network.n_shards)]
        return None if growth is None else Shown(growth, entries)
