"""Gains of least linear cost under further constraints, which the user writes in cvxpy.

For a gain F within the limits let D_F(p) = s + (A + B F - I)'p + F'r (continuous time: without I); the cost p of F has
D_F(p) = 0, and D_F(q) in -X* means that F costs at most q.  Under constraints no gain is the cheapest from every x:
what is minimised is the mean cost p'w, w a sum of generators, each scaled to cost as much as the others without the
constraints.  Another gain G costs D_G(p)'z more, where z is the sum (integral) of all states from w under G.  With the
z of F this is linear in G: sequential linear programs with steps that are bounded, and halved where they fail.  Nothing
here is trusted; that no other gain is cheaper under the constraints is not claimed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...exact.matrix import Matrix
from ..demands import Demands
from ..running import Programs
from .policies import Policies
from .problem import CONTROL, SHARED, Floats, LinearCost

# Programs for a first gain of finite cost, and for better ones; the smallest step, as a part of the limits; an
# improvement too small to be one.
_FIRST, _ROUNDS, _SHORT, _ENOUGH = 30, 60, 1e-5, 1e-10
# Inputs as near to 0 or to their limits are taken as 0 and as their limits; room that other gains leave to rounding.
_NEAR = 1e-7


@dataclass(frozen=True)
class OwnGain:
    """A gain, its cost, and the number of programs.

    Attributes
    ----------
    F, p : ndarray, shapes (m, n), (n,)
    steps : int
    """

    F: Floats
    p: Floats
    steps: int


class OwnGains(Demands):
    """Gains within the limits of a problem that meet what the user wrote.

    Parameters
    ----------
    problem : LinearCost
    policies : Policies
        Of the problem, for its matrices in floating point.
    constraints, objective, lp
        As in `Demands`.
    """

    def __init__(self, problem: LinearCost, policies: Policies, constraints: Any, objective: Any, lp: Programs) -> None:
        self.problem, self.data, self.steps = problem, policies, 0
        super().__init__(problem.B.shape[::-1], constraints, objective, lp)
        self.inputs = self.F @ policies.rays.T
        self.seen = np.asarray(problem.limits.values) @ policies.rays.T
        self.rows = self._within(self.seen)

    def _within(self, seen: Floats) -> list[Any]:
        """The limits at all generators."""
        owner, kinds, cp = self.problem.owner, self.problem.kinds, self.cp
        single, grouped = (np.flatnonzero(at) for at in (kinds[owner] == CONTROL, kinds[owner] != CONTROL))
        out = []
        if single.size:
            out.append(cp.abs(self.inputs[single]) <= seen[owner[single]])
        if grouped.size:
            groups = np.flatnonzero(kinds != CONTROL)
            used = np.eye(len(kinds))[owner].T[groups] @ self.inputs
            shared = np.flatnonzero(kinds[groups] == SHARED)
            out += [self.inputs[grouped] >= 0, used <= seen[groups]]
            out += [used[shared] == seen[groups[shared]]] if shared.size else []
        return out

    def found(self, p: Floats, gap: float, *, chosen: bool) -> OwnGain | None:
        """The cheapest gain found, for the optimal cost p without constraints; if `chosen`, one of about its cost."""
        best, w = self._first(p), (self.data.rays / (self.data.rays @ p)[:, None]).mean(axis=0)
        step = 2.0
        for _ in range(_ROUNDS):
            if best is None or step < _SHORT:
                break
            F = self._improved(*best, w, step)
            if F is None or self._expected(F, *best, w) > -_ENOUGH * (best[1] @ w):
                break
            better = self.costed(F)
            if better is not None and better[1] @ w < best[1] @ w * (1 - _ENOUGH):
                best, step = better, min(2 * step, 2.0)
            else:
                step /= 4
        if best is not None and chosen:
            falls = self._residual((1 + gap) * best[1])[0]
            best = self.costed(self._cheapest(self.cost, [falls <= 0])) or best
        return None if best is None else OwnGain(*best, self.steps)

    def _residual(self, p: Floats) -> tuple[Any, Floats]:
        """D_F(p)'x at the generators in terms of F, and p'x."""
        data = self.data
        rests = data.rays @ (data.s + p @ data.drift)
        return (data.r + p @ data.B) @ self.inputs + rests, data.rays @ p

    def _cheapest(self, cost: Any, rows: list[Any]) -> Floats | None:
        self.steps += 1
        return self.cheapest(cost, [*self.rows, *rows], (2 * self.inputs.size, self.F.size))

    def _improved(self, F: Floats, p: Floats, w: Floats, step: float) -> Floats | None:
        """A gain next to F that costs less from w, as far as the states of F tell."""
        near = self.cp.abs(self.inputs - F @ self.data.rays.T) <= step * self.seen[self.problem.owner]
        return self._cheapest(self._expected(self.F, F, p, w), [near] if step < 2 else [])

    def _expected(self, G: Any, F: Floats, p: Floats, w: Floats) -> Any:
        """What G costs more than F from w, with the states of F."""
        data = self.data
        z = np.linalg.solve(data.drift + data.B @ F, -w)
        return (data.r + p @ data.B) @ (G - F) @ z

    def costed(self, F: Floats | None) -> tuple[Floats, Floats] | None:
        """A gain with its cost; None if that is not finite."""
        if F is None:
            return None
        data = self.data
        try:
            p = np.linalg.solve((data.drift + data.B @ F).T, -(data.s + data.r @ F))
        except np.linalg.LinAlgError:
            return None
        return (F, p) if np.isfinite(p).all() and (data.rays @ p > 0).all() else None

    def _first(self, p: Floats) -> tuple[Floats, Floats] | None:
        """A gain of finite cost: value iteration with gains for which the worst generator grows least."""
        data = self.data
        step = 1.0 if self.problem.discrete else 0.5 / max(np.abs(np.diag(data.drift)).max(), 1e-300)
        for _ in range(_FIRST):
            residual, size = self._residual(p)
            F = self._cheapest(self.cp.max(residual / size), [])
            found = self.costed(F)
            if F is None or found is not None:
                return found
            p = p + step * (data.s + data.r @ F + p @ (data.drift + data.B @ F))
        return None


def admissible(problem: LinearCost, F: Floats) -> Matrix:
    """A gain next to F that keeps to the limits exactly on a simplicial cone; on others with a little room."""
    if not problem.X.is_simplicial:
        return Matrix(F * (1 - _NEAR))
    rays, facets = (getattr(problem.X, name).plain().fractions() for name in ("exact_rays", "exact_facets"))
    order = np.argmin(problem.X.incidence, axis=1)  # the generator that is not on a facet
    duals = [h / (h @ rays[k]) for h, k in zip(facets, order, strict=True)]
    seen = (problem.limits.fractions() @ rays.T)[:, order]
    used = Matrix(F).fractions() @ rays.T
    return Matrix.from_fractions(_clipped(problem, used[:, order], seen) @ np.array(duals))


def _clipped(problem: LinearCost, used: Any, seen: Any) -> Any:
    """Inputs at the generators within the limits there, exactly; those next to 0 or to a limit are there."""
    near, out = _NEAR, used.copy()
    for i, g in enumerate(problem.owner):
        least = -seen[g] if problem.kinds[g] == CONTROL else 0 * seen[g]
        out[i] = [_rounded(u, low, top, near) for u, low, top in zip(used[i], least, seen[g], strict=True)]
    for g in np.flatnonzero(problem.kinds != CONTROL):
        mine = np.flatnonzero(problem.owner == g)
        for k, total in enumerate(out[mine].sum(axis=0)):
            if total > seen[g, k] or (problem.kinds[g] == SHARED and total > 0):
                out[mine, k] *= seen[g, k] / total
    return out


def _rounded(u: Any, low: Any, top: Any, near: float) -> Any:
    return next((end for end in (low, 0 * top, top) if abs(u - end) <= near * top), min(max(u, low), top))
