"""Policy iteration for networks: every linear system by node-local factors and a Krylov method.

For fixed coefficients c of the columns -(A_c - I)'p = s + L'(c r) is solved like the closed loop of a network whose
links are the blocks of (A_c - I)' between different nodes (`networks.spectrum.port_solves`).  Nothing here is trusted.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...exact.budget import spend
from ...networks.model import NetworkModel
from ...networks.spectrum.port_solves import PortSystem, same_graph
from .loops import Loops
from .network_problem import NetworkCost
from .policies import Found, Policies
from .problem import Floats, Index

# Sizes of r + B'p that count as ties, on the way and at the end.
_COARSE, _FINE = 1e-6, 1e-12
# Errors of the linear systems relative to the costs, and, on the way, to the residual they start from: a cost is good
# enough there if it shows the next policy.
_ERROR, _ROUGH = 1e-12, 1e-2
# Part of the cost of a stage that the residual of a cost may be; any below 1 shows that the policy is stable.
_MISSED = 0.1
# Operations for each entry of a linear system.
_EFFORT = 100.0
# Steps of the power iteration, and how often the nodes are tried where nothing falls.
_POWERS, _EVERY = 2000, 25


class NetworkPolicies(Policies):
    """Policy iteration for a network.

    Parameters
    ----------
    problem : NetworkCost
    model : NetworkModel
        The network, for the sizes of its nodes.
    """

    problem: NetworkCost

    def __init__(self, problem: NetworkCost, model: NetworkModel) -> None:
        self._places = model
        super().__init__(problem)

    def _read(self) -> None:
        problem = self.problem
        self.rays, self.facets = problem.cones.rays.values, problem.cones.facets.values
        factor = float(problem.factor)
        self.acted = problem.acted if factor == 1 else problem.acted * factor
        self._reach = float(abs(self.acted).sum(axis=1).max(initial=0.0))
        self.limits = problem.limits.values if problem.apart else sp.csr_array(problem.limits.values[problem.owner])
        self._solved: tuple[NetworkModel, Floats] | None = None
        self.ties, self._errors = _COARSE, (_ROUGH, 0.0)

    @cached_property
    def drift(self) -> sp.csr_array:  # type: ignore[override]
        """A - I, or A - rho I, with the discount in A."""
        return self.problem.drift

    @cached_property
    def loops(self) -> Loops:
        """The closed loops of all policies."""
        resting = self.problem.resting * float(self.problem.factor)
        return Loops(resting, self.acted, self.limits, self._places)

    @cached_property
    def reach(self) -> sp.csr_array:  # type: ignore[override]
        """|B|."""
        return sp.csr_array(abs(self.acted).T)

    def pushed(self, p: Floats) -> Floats:
        """See `Policies`."""
        return self.acted @ p

    def _ties(self, y: Floats, p: Floats) -> Any:
        """See `Policies`; sizes are only found where none is excluded by the largest one."""
        most = np.abs(self.r).max(initial=0.0) + self._reach * np.abs(p).max()
        near = np.flatnonzero(~(np.abs(y) > self.ties * most))
        size = np.abs(self.r[near]) + abs(self.acted[near]) @ np.abs(p)
        return near[~(np.abs(y[near]) > self.ties * size)]

    def optimal(self) -> Found | None:
        """See `Policies`: first roughly, then from the best policy that this shows."""
        found = super().optimal()
        if found is None:
            return None
        self.ties, self._errors = _FINE, (0.0,)
        start = self.worst(self._better(found.policy, found.p)) or self.worst(found.policy)
        return None if start is None else self._improved(*start, 0.0)

    def cost(self, policy: Index, brake: float = 0.0) -> Floats | None:
        """See `Policies`; on the way roughly, and better where that does not show that the policy is stable.

        That -(A_c - I)'p is positive on X proves it, so that a residual below the cost of a stage does.
        """
        spend(_EFFORT * (self.problem.A.values.nnz + self.acted.nnz) + 1e5)
        self.steps += 1
        loop = self.loops.matrix(policy, brake + self.problem.own)
        model = self.loops.network(loop)
        paid, p = self.s + (policy * self.r) @ self.limits, None
        if self._solved is not None:
            before, p = self._solved
            same_graph(before, model)
        system, stage = PortSystem(model, 0.0), _MISSED * (self.rays @ paid)
        missed = paid if p is None else paid + loop @ p
        for error in self._errors:
            p, missed = _nearer(system, loop, paid, p, missed, error)
            # an iteration that gave up has not found the cost
            if (self.rays @ p > 0).all() and (np.abs(self.rays @ missed) <= stage).all():
                self._solved = model, p
                return p
        return None

    # -- no finite cost

    def growing(self) -> Iterator[Floats]:
        """Vectors d in X* for which d'x may not fall: from powers of d -> A'd + sum_g m_g(B'd) l_g, cut down."""
        diagonal = self.drift.diagonal()
        step = 1.0 if self.problem.discrete else 0.5 / max(np.abs(diagonal).max(initial=0.0), 1e-300)
        d = self.facets.T @ np.ones(self.facets.shape[0])
        for k in range(_POWERS):
            spend(10 * self.drift.nnz + 1e4)
            d = d + step * self._moved(d)
            size = np.abs(d).max()
            if not (np.isfinite(size) and size > 0):
                return
            d = d / size
            if k % _EVERY == _EVERY - 1:
                kept = self._cut(d)
                if kept is not None:
                    yield kept

    def _moved(self, d: Floats) -> Floats:
        """D(d) without costs."""
        return d @ self.drift + self.problem.best(self.pushed(d)[None])[0] @ self.problem.limits.values

    def _cut(self, d: Floats) -> Floats | None:
        """d without the nodes where it falls; None if nothing is left."""
        cones = self.problem.cones
        d = np.round(d * 2.0**40) * 2.0**-40
        owner = cones.owners[self.rays.indices[self.rays.indptr[:-1]]]
        while d.any():
            falls = (self.rays @ self._moved(d) < 0) | (self.rays @ d < 0)
            falls &= (np.add.reduceat(d != 0, cones.starts[:-1]) > 0)[owner]
            if not falls.any():
                return d
            d = np.where(np.isin(cones.owners, owner[falls]), 0.0, d)
        return None


def _nearer(
    system: PortSystem, loop: sp.csr_array, paid: Floats, p: Floats | None, missed: Floats, error: float
) -> tuple[Floats, Floats]:
    """A better solution p of paid + loop p = 0 with its residual, from one with the residual given or from none."""
    part = np.abs(missed).max() / np.abs(paid).max()
    if p is None or not part < 1:
        p, missed, part = np.zeros(len(paid)), paid, 1.0
    p = p + system.primal(missed, min(max(error, _ERROR / max(part, 1e-300)), 0.1))[0]
    return p, paid + loop @ p
