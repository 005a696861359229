"""Gains on a simplicial cone: one linear program is necessary and sufficient.

See `inequalities` for the rows.  The smallest gain and the largest decay rate are ratios, found by a
handful of programs (`ratio`).  What is returned here is in doubles and proves nothing.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.program import Solver
from ..plant import Floats, Plant
from .inequalities import feedback_inequalities, gain_from_columns, gain_rows, output_rows, split
from .ratio import RatioProgram, compact, scaled_rows, solved, spend_on_entries, stacked

# Policy iteration by columns: gains looked at, relative to the sizes of A and B; steps.
_WIDE, _POLICIES = 10.0, 5


class SimplicialProgram(RatioProgram):
    """The rows of one design in doubles, over xi and those z that may differ from zero.

    Parameters
    ----------
    plant : Plant
        On a simplicial cone.
    free : ndarray of bool, shape (n, m)
        Which F t_k may differ from zero.
    lp : callable
        As `control_kpos.exact.programs.solve`.
    """

    def __init__(self, plant: Plant, free: NDArray[np.bool_], lp: Solver) -> None:
        super().__init__(lp, plant.discrete)
        n, m = plant.n, plant.m
        self.plant, self.n, self.m, self.free, self.scale = plant, n, m, free, plant.scale
        spend_on_entries(2.0 * len(plant.vertices) * n * n * (1 + m))
        facets = plant.facets / np.einsum("ij,ij->i", plant.facets, plant.rays)[:, None]
        coupled = None
        if plant.coupling is not None:
            coupled = [(A + np.asarray(plant.coupling.values), B) for A, B in plant.pairs]
        q = feedback_inequalities(facets, plant.rays, plant.pairs, discrete=plant.discrete, drift_plants=coupled)
        if plant.ports:
            C, D = (np.asarray(M.values) for M in plant.system.matrices[2:])
            q = q.with_closed(*output_rows(C, D, np.asarray(plant.system.Y.facets), plant.rays))
        self.kept = np.concatenate([np.arange(n), n + np.flatnonzero(free.ravel())])
        self.owner = np.concatenate([np.arange(n), np.repeat(np.arange(n), m)])[self.kept]
        self.closed, self.drift = compact(q.closed[:, self.kept]), compact(q.drift[:, self.kept])
        place = np.arange(len(q.owner)), q.owner
        self.weights = compact(sp.csr_array((q.weight, place), shape=self.drift.shape))
        slope, level, _ = gain_rows(n, m, np.ones(n), None)
        held = np.flatnonzero(np.tile(free.ravel(), 2))
        self.slope, self.level = compact(slope[held][:, self.kept]), compact(level[held][:, self.kept])
        bound = np.full(m, np.inf) if plant.gain_bound is None else plant.gain_bound
        limits = np.tile(bound, 2 * n)[held]
        limited = np.flatnonzero(np.isfinite(limits))
        self.bounds = self.slope[limited] - scaled_rows(self.level[limited], limits[limited])

    def by_columns(self, rate: float) -> Floats | None:
        """A solution by policy iteration, or None: quick where it works, complete nowhere.

        For a fixed vector v the columns F t_k are independent: one block-diagonal program minimises
        v'(A + B F)t_k under invariance.  Then v becomes the left Perron vector of the closed loop.
        """
        n, free = self.n, self.owner[self.n :]
        if self.drift.shape[0] != n or not free.size:
            return None
        box = _WIDE * abs(self.drift[:, :n]).max() / max(abs(self.drift[:, n:]).max(), 1e-300)
        shift = (1.0 if self.plant.discrete else 0.0) - rate
        rows = stacked(-self.closed[:, n:], self.bounds[:, n:])
        limits = np.concatenate([self.closed[:, :n].sum(axis=1), -self.bounds[:, :n].sum(axis=1)])
        v = np.ones(n)
        for _ in range(_POLICIES):
            answer = self.lp(v @ self.drift[:, n:], rows, limits, bounds=(-box, box), presolve=False)
            if not answer:
                return None
            z = sp.csr_array((answer.x, (np.arange(len(free)), free)), shape=(len(free), n))
            M = self.drift[:, :n] + self.drift[:, n:] @ z - shift * np.eye(n)
            xi = -solved(M, np.ones(n))
            if (xi > 0).all():  # M is Metzler up to rounding, so this says that it is stable
                return np.asarray(np.concatenate([xi, answer.x * xi[free]]), dtype=float)
            rightmost = np.linalg.eigvals(M).real.max()
            v = -solved((M - 1.1 * max(rightmost, 0.0) * np.eye(n)).T, np.ones(n))
            if not (np.isfinite(v).all() and (v > 0).all()):
                return None
            v = v / v.max()
        return None

    def read(self, x: Floats) -> tuple[Floats, Floats]:
        """F, and a vector inside X that A + B F maps inwards."""
        full = np.zeros(self.n * (1 + self.m))
        full[self.kept] = x
        xi, G = split(full, self.n, self.m)
        return gain_from_columns(G, self.plant.rays), xi @ self.plant.rays
