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
from ...exact.matrix import Matrix
from ...networks.model import NetworkModel
from ...networks.nodes import NodeStack
from ...networks.spectrum.port_solves import PortSystem, same_graph
from .network_problem import NetworkCost
from .policies import Policies
from .problem import Floats, Index

# Error of the linear systems relative to their right-hand side, and operations for each entry of one.
_TOLERANCE, _EFFORT = 1e-12, 300.0
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

    ties = 1e-12
    problem: NetworkCost

    def __init__(self, problem: NetworkCost, model: NetworkModel) -> None:
        self._places = model
        super().__init__(problem)

    def _read(self, problem: NetworkCost) -> None:
        self.rays, self.facets = problem.cones.rays.values, problem.cones.facets.values
        self.drift, self.B = problem.drift, problem.acting * float(problem.factor)
        self.limits = sp.csr_array(problem.limits.values[problem.owner])
        self._solved: tuple[NetworkModel, Floats] | None = None

    @cached_property
    def _transposed(self) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
        """Of the drift, B and the limits."""
        return tuple(sp.csr_array(M.T) for M in (self.drift, self.B, self.limits))  # type: ignore[return-value]

    def loop(self, policy: Index, brake: float = 0.0) -> sp.csr_array:
        """(A_c - I)' less the brake, with all entries of the diagonal blocks of the nodes."""
        drift, B, limits = self._transposed
        acting = sp.csr_array((B.data * np.repeat(policy, np.diff(B.indptr)), B.indices, B.indptr), shape=B.shape)
        out = drift + limits @ acting
        return sp.csr_array(out - brake * sp.eye_array(out.shape[0], format="csr") if brake else out)

    def cost(self, policy: Index, brake: float = 0.0) -> Floats | None:
        """See `Policies`."""
        loop = self.loop(policy, brake)
        spend(_EFFORT * loop.nnz + 1e5)
        self.steps += 1
        model = as_network(loop, self._places)
        if self._solved is not None:
            same_graph(self._solved[0], model)
        guess = None if self._solved is None else self._solved[1]
        paid = self.s + (policy * self.r) @ self.limits
        p, _ = PortSystem(model, 0.0).primal(paid, _TOLERANCE, guess=guess)
        if not (np.isfinite(p).all() and (self.rays @ p > 0).all()):
            return None
        # an iteration that gave up has not found the cost
        missed = np.abs(self.rays @ (paid + loop @ p))
        if not (missed <= 1e-3 * (self.rays @ paid)).all():
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


def as_network(loop: sp.csr_array, places: NetworkModel) -> NetworkModel:
    """x' = loop x as a network of nodes with these sizes and cones: every state is an input and an output."""
    rows = np.repeat(np.arange(loop.shape[0]), np.diff(loop.indptr))
    owner, stacks = places.owners(0), []
    own = owner[rows] == owner[loop.indices]
    group, place = places.home
    for g, s in enumerate(places.stacks):
        n, mine = s.X.dim, np.flatnonzero(own & (group[owner[rows]] == g))
        node = owner[rows[mine]]
        first = places.offsets[0][node]
        blocks = np.zeros((len(s), n, n))
        blocks[place[node], rows[mine] - first, loop.indices[mine] - first] = loop.data[mine]
        eye, zero = (Matrix(np.broadcast_to(M, blocks.shape)) for M in (np.eye(n), np.zeros((n, n))))
        stacks.append(NodeStack(Matrix(blocks), eye, eye, zero, s.X, s.X, s.X, s.dt, s.names))
    links = sp.csr_array((np.where(own, 0.0, loop.data), loop.indices, loop.indptr), shape=loop.shape, copy=True)
    links.eliminate_zeros()
    return NetworkModel(tuple(stacks), places.members, Matrix(links), places.dt)
