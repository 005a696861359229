"""Policy iteration for networks: every linear system by node-local factors and a Krylov method.

For fixed coefficients c of the columns -(A_c - I)'p = s + L'(c r) is solved like the closed loop of a network whose
links are the blocks of (A_c - I)' between different nodes (`networks.spectrum.port_solves`).  Nothing here is trusted.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ...exact.budget import spend
from ...networks.model import NetworkModel
from ...networks.spectrum.port_solves import PortSystem, same_graph
from .loops import Loops
from .network_problem import NetworkCost
from .policies import Found, Policies
from .problem import Floats, Index

# Sizes of r + B'p that count as ties, and errors of the linear systems, at first and at the end.
_COARSE, _FINE = (1e-6, 1e-7), (1e-12, 1e-12)
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
        self.B, self.reach = problem.acting, problem.reach[0]
        if factor != 1:
            self.B, self.reach = self.B * factor, self.reach * factor
        self.limits = problem.limits.values if problem.apart else sp.csr_array(problem.limits.values[problem.owner])
        self._solved: tuple[NetworkModel, Floats] | None = None
        self.ties, self._tolerance = _COARSE

    @cached_property
    def drift(self) -> sp.csr_array:  # type: ignore[override]
        """A - I, or A - rho I, with the discount in A."""
        return self.problem.drift

    @cached_property
    def loops(self) -> Loops:
        """The closed loops of all policies."""
        resting = self.problem.resting * float(self.problem.factor)
        return Loops(resting, self.B, self.limits, self._places)

    def optimal(self) -> Found | None:
        """See `Policies`: first roughly, which takes fewer steps of every solve."""
        found = super().optimal()
        self.ties, self._tolerance = _FINE
        p = None if found is None else self.cost(found.policy)
        return found if found is None or p is None else self._improved(found.policy, p, 0.0)

    def cost(self, policy: Index, brake: float = 0.0) -> Floats | None:
        """See `Policies`."""
        spend(_EFFORT * (self.problem.A.values.nnz + self.B.nnz) + 1e5)
        loop = self.loops.matrix(policy, brake + self.problem.own)
        self.steps += 1
        model = self.loops.network(loop)
        paid = self.s + (policy * self.r) @ self.limits
        missed, p = paid, np.zeros(len(paid))
        if self._solved is not None:
            before, p = self._solved
            same_graph(before, model)
            missed = paid + loop @ p
        part = np.abs(missed).max() / np.abs(paid).max()
        if not part < 1:
            missed, p, part = paid, 0.0, 1.0
        p = p + PortSystem(model, 0.0).primal(missed, min(self._tolerance / max(part, 1e-300), 0.1))[0]
        # an iteration that gave up has not found the cost
        missed = np.abs(self.rays @ (paid + loop @ p))
        if not ((self.rays @ p > 0).all() and (missed <= 1e-3 * (self.rays @ paid)).all()):
            return None
        self._solved = model, p
        return p

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
        return d @ self.drift + self.problem.best((d @ self.B)[None])[0] @ self.problem.limits.values

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
