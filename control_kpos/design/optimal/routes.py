"""From a plant to candidates and back to a gain: one system in exact dense matrices, or a network in sparse ones."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...exact.matrix import Matrix
from ...exact.rounding import HALF_ULP
from ...networks.network import ConeNetwork
from ...systems.statespace import ConeStateSpace
from ...systems.system import System
from ..plant import closed_loop, read_system, refuse_cone
from .arguments import Question, closed_loop_of, controlled
from .loops import as_network
from .network_policies import NetworkPolicies
from .network_problem import NetworkCost
from .policies import Found, Policies, by_linear_program, growing_vector
from .problem import DISTURBANCE, Floats, Index, LinearCost

# What the bounds of the cost of a network are apart, relative to the residual that is left.
_SAFETY = 4.0
# Operations of a proof, for each entry of A, B and the limits.
_PROOF = 250.0


@dataclass(frozen=True, eq=False)
class Route(ABC):
    """A problem, and how it is solved.

    Attributes
    ----------
    problem : LinearCost
    policies : Policies
    effort : str
        What a design of this kind may spend, a key of `EFFORT`.
    proof : float
        Operations of a proof.
    """

    problem: Any
    policies: Any
    effort: str = "one system"
    proof: float = 0.0

    @abstractmethod
    def candidates(self, lp: Any) -> Iterator[Found]:
        """Policies with their costs."""

    @abstractmethod
    def growing_vectors(self, lp: Any) -> Iterator[Floats]:
        """Vectors d for a refutation."""

    @abstractmethod
    def gain(self, policy: Index) -> Matrix:
        """F of u = F x."""

    @abstractmethod
    def loop(self, gain: Matrix, policy: Index) -> Any:
        """The closed loop."""

    def apart(self, found: Found) -> float:
        """How far apart the bounds of the cost have to be, relative to it."""
        return 0.0

    @cached_property
    def _chosen(self) -> Index:
        """The columns that are not a disturbance."""
        return np.flatnonzero(self.problem.kinds[self.problem.owner] != DISTURBANCE)


# -- one system


@dataclass(frozen=True, eq=False)
class SystemRoute(Route):
    """One system.

    Attributes
    ----------
    plant : System
    """

    plant: Any = None

    def candidates(self, lp: Any) -> Iterator[Found]:
        """See `Route`."""
        problem, policies = self.problem, self.policies
        found = policies.optimal()
        if found is not None:
            yield found
            return
        p = by_linear_program(problem, lp)
        if p is not None:
            y = problem.r.values[0] + p @ np.asarray(problem.discounted[1].values)
            policy = problem.policy(y)
            cost = policies.cost(policy)
            yield Found(policy, p if cost is None else cost, policies.steps)

    def growing_vectors(self, lp: Any) -> Iterator[Floats]:
        """See `Route`: d by a linear program, and the facets of X, on the edge of X* where doubles fail."""
        d = growing_vector(self.problem, lp)
        if d is not None:
            yield d
            yield np.round(d, 9)
        for facet in self.problem.X.exact_facets.plain().fractions():
            if all(abs(a) < 2**53 for a in facet):
                yield np.array([float(a) for a in facet])

    def gain(self, policy: Index) -> Matrix:
        """See `Route`."""
        signs, limits = policy[self._chosen, None], self.problem.limits[self.problem.owner[self._chosen]]
        if limits.is_double:
            return Matrix(signs * limits.values + 0.0)
        return Matrix.from_fractions(signs.astype(object) * limits.fractions())

    def loop(self, gain: Matrix, policy: Index) -> ConeStateSpace:
        """From further inputs to y, with A + B F exact."""
        plant: System = self.plant
        A, C = closed_loop(plant.A, plant.B, gain), closed_loop(plant.C, plant.D, gain)
        cones = {"X": plant.X, "U": plant.U, "Y": plant.Y}
        return ConeStateSpace(A, plant.B, C, plant.D, plant.dt, **cones, remove_useless_states=False)


def system_route(question: Question, sys: Any, X: Any, controls: Any) -> SystemRoute:
    """Read a system, or a network of moderate size."""
    plant = controlled(read_system(sys, X), controls)
    nodes = sys.model.n_nodes if isinstance(sys, ConeNetwork) else 0
    problem = question.of(LinearCost, plant.A, plant.B, plant.X, plant.discrete, nodes)
    return SystemRoute(problem, Policies(problem), plant=plant)


# -- networks


@dataclass(frozen=True, eq=False)
class NetworkRoute(Route):
    """A network.

    Attributes
    ----------
    net : ConeNetwork
    """

    net: Any = None

    def candidates(self, lp: Any) -> Iterator[Found]:
        """See `Route`."""
        found = self.policies.optimal()
        if found is not None:
            yield found

    def growing_vectors(self, lp: Any) -> Iterator[Floats]:
        """See `Route`."""
        yield from self.policies.growing()

    def apart(self, found: Found) -> float:
        """See `Route`: residuals and their rounding, relative to the cost of a stage."""
        policies, problem, p = self.policies, self.problem, found.p
        rays, L, y = policies.rays, problem.limits.values, policies.r + policies.pushed(p)
        gone, reach = problem.own * np.abs(p), np.bincount(problem.owner, abs(policies.acted) @ np.abs(p))
        moved = policies.s + float(problem.factor) * (p @ problem.resting) - problem.own * p
        best, paid = problem.best(y[None])[0], problem.under(found.policy, y[None])[0]
        # what stands beside each other in the sums is no larger than what comes in, and what goes
        size = abs(rays) @ (np.abs(policies.s) + np.abs(moved) + 2 * gone + 2 * reach @ abs(L))
        stage = rays @ (policies.s + problem.best(policies.r[None])[0] @ L)
        missed = np.maximum(-(rays @ (moved + best @ L)), rays @ (moved + paid @ L))
        return float(((_SAFETY * missed + 256 * HALF_ULP * size) / stage).max())

    def gain(self, policy: Index) -> Matrix:
        """See `Route`."""
        signs, rows = policy, self.policies.limits
        if len(self._chosen) < len(policy):
            signs, rows = policy[self._chosen], rows[self._chosen]
        data = rows.data * np.repeat(signs, np.diff(rows.indptr))
        out = sp.csr_array((data, rows.indices, rows.indptr), shape=rows.shape, copy=True)
        out.eliminate_zeros()
        return Matrix(out)

    def loop(self, gain: Matrix, policy: Index) -> ConeNetwork:
        """The nodes of A + B F, every state an input and an output, linked by the blocks between them."""
        free = np.isin(np.arange(len(policy)), self._chosen)
        if self.problem.factor == 1:
            A = sp.csr_array(self.policies.loops.matrix(np.where(free, policy, 0)).T)
        else:
            A = sp.csr_array(self.problem.resting + self.problem.acting[:, self._chosen] @ gain.values)
        return ConeNetwork(as_network(A, self.net.model))


def network_route(question: Question, sys: Any, X: Any, controls: Any) -> NetworkRoute:
    """Read a large network."""
    refuse_cone(X)
    A, B = closed_loop_of(sys, controls)
    problem = question.of(NetworkCost, A, B, sys.X, sys.model.discrete, sys.model.n_nodes)
    entries = sum(M.values.nnz for M in (problem.A, problem.B, problem.limits))
    return NetworkRoute(problem, NetworkPolicies(problem, sys.model), "network", _PROOF * entries, net=sys)
