"""The search for what `no_smaller_gains` checks: numbers that refute local gains within a bound.

Gains at different generators do not depend on each other, nor does what they do to a vector d in X*.  So the gains
within the bound that make the network fastest are found by policy iteration: d is the left Perron vector of the loop,
and at every generator t the F t is taken that makes d'(A + B F) t least under invariance (`columns`).  A few vectors
do; each costs the solves of a bracket of the spectral abscissa, where the programs of the design couple all variables.
One gain for all nodes is refuted by the multipliers of one program.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ...exact.budget import spend
from ...exact.matrix import Matrix
from ...networks.model import NetworkModel
from ...networks.spectrum.descent import Approach, cone_coordinates, descend
from ...networks.spectrum.port_solves import same_graph
from ...networks.spectrum.strong_parts import strong_parts
from ...theorems.decay_rates import Rate
from ..limits import proven_limit
from ..simplicial.search import BELOW
from .columns import Columns, Floats, Parts
from .no_smaller_gains import NodeRows, NoSmallerGains
from .program import Task

# Vectors after which the search ends, and how often it cuts away what does not grow.
_POLICIES, _CUTS = 12, 40
# Part of the distance from the rate up to which an abscissa is found.
_NEAR = 0.1
# Operations for each entry of A: of a program with its proof, for each input, and of a vector.
_EFFORT_OF_PROGRAM, _EFFORT_OF_VECTOR = 4e3, 2.5e4


def network_limit(task: Task, found: float) -> Callable[[], float]:
    """A bound on max |F_j x_k| below which no local gains do it; NaN if none is proven."""
    search = Refutation(task.model, task.rate * BELOW, task.uniform)
    return partial(proven_limit, search.refuses, found, -1, "a limit of a network", task.gap)


@dataclass(eq=False)
class Refutation:
    """The search, bound after bound; vectors that were found serve again.

    Attributes
    ----------
    model : NetworkModel
        Simplicial state cones, D = 0.
    rate : float or Fraction
    uniform : bool
        One gain and one x for all nodes are refuted.
    """

    model: NetworkModel
    rate: Rate
    uniform: bool = False

    def __post_init__(self) -> None:
        self.theta = float(self.model.discrete - self.rate)
        self.d: Parts | None = None

    def refuses(self, size: float) -> bool:
        """Proven: no local gains whose max |F_j t| is at most this size do it."""
        return self.proves([np.full((len(s), s.sizes[1]), size) for s in self.model.stacks]) is not None

    @cached_property
    def rows(self) -> tuple[NodeRows, ...]:
        """Exact data of the inequalities."""
        return tuple(map(NodeRows, self.model.stacks))

    @cached_property
    def inner(self) -> NetworkModel:
        """The network without links from one strongly connected part to another: those only add to d'A_cl."""
        parts = strong_parts(self.model)
        return self.model if parts is None else parts.inner

    def proves(self, bound: Sequence[Floats]) -> NoSmallerGains | None:
        """The proof that no local gains within the bound do it, (N, m) for each stack; None if none is found."""
        spend(_EFFORT_OF_PROGRAM * sum(s.A.values.size * (1 + s.sizes[1]) for s in self.model.stacks))
        columns = Columns(self.model, self.rows, self.theta, bound, uniform=self.uniform)
        needed, w = columns.narrowest()
        if not w:
            return None
        if max(float(part.max()) for part in needed) > 1:
            return self._proven(columns, [np.zeros_like(rows.B.values[:, :, 0]) for rows in self.rows], w)
        return self._of_one_gain(columns) if self.uniform else self._of_policies(columns)

    def _of_one_gain(self, columns: Columns) -> NoSmallerGains | None:
        d, w = columns.of_one_gain()
        return self._proven(columns, d, w) if d else None

    def _of_policies(self, columns: Columns) -> NoSmallerGains | None:
        d = self.d or [np.ones(rows.B.shape[:2]) / columns.levels[g] for g, rows in enumerate(self.rows)]
        before, start = np.inf, self.theta
        for _ in range(_POLICIES):
            spend(_EFFORT_OF_VECTOR * sum(s.A.values.size for s in self.model.stacks))
            gains = columns.fastest(d)[0]
            at = None if gains is None else self._slowest(columns, gains, start)
            if at is None or not at.theta > self.theta:
                return None
            d = self.d = self._weights(at, columns)
            settled = before - at.theta < 0.1 * (at.theta - self.theta)
            found = self._cut(columns, d, _CUTS if settled else 1)
            if found is not None or settled:
                return found
            before, start = at.theta, at.shift
        return None

    def _slowest(self, columns: Columns, gains: Parts, start: float) -> Approach | None:
        """About the left Perron vector of the network with these gains, which are fast enough if its theta is below."""
        loops = [
            replace(s, A=Matrix(np.asarray(s.A.values) + np.asarray(s.B.values) @ F))
            for s, F in zip(self.inner.stacks, gains, strict=True)
        ]
        closed = replace(self.inner, stacks=tuple(loops), origin=None)
        same_graph(self.inner, closed)

        def stop(at: Approach) -> bool:
            return at.shift <= self.theta or at.shift - at.theta < _NEAR * (at.theta - self.theta)

        return descend(closed, start, stop=stop)

    def _weights(self, at: Approach, columns: Columns) -> Parts:
        """A vector in X* as weights of facets."""
        parts = cone_coordinates(self.model, at.v / np.abs(at.v).max(), dual=True)
        # those of X.rays, which may have other lengths than exact ones
        lengths = [
            np.abs(rows.rays.values).max(axis=1) / np.abs(s.X.rays).max(axis=1)
            for rows, s in zip(self.rows, self.model.stacks, strict=True)
        ]
        return [np.maximum(z * l / level, 0.0) for z, l, level in zip(parts, lengths, columns.levels, strict=True)]

    def _cut(self, columns: Columns, d: Parts, times: int) -> NoSmallerGains | None:
        """The proof by d, where it does not grow set to 0, as often as it takes."""
        for _ in range(times):
            w = columns.fastest(d)[1]
            if not w:
                return None
            slack = columns.slack(d, w)
            bad = [(part > 0) & ~(s > 0) for part, s in zip(d, slack, strict=True)]
            if not any(part.any() for part in bad):
                return self._proven(columns, d, w)
            d = [np.where(cut, 0.0, part) for part, cut in zip(d, bad, strict=True)]
            if not any(part.any() for part in d):
                return None
        return None

    def _proven(self, columns: Columns, d: Parts, w: Parts) -> NoSmallerGains | None:
        r, q = columns.ports(d)
        most = [np.abs(b) + room for b, room in columns.of_gains(w)]
        bound = tuple(columns.bound)
        found = NoSmallerGains(
            self.model, self.rows, self.rate, bound, self.uniform, tuple(d), tuple(w), tuple(most), r, q
        )
        return found if found.holds() else None
