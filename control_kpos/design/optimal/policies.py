"""Policies for linear cost, in floating point: policy iteration, and the linear program.

For fixed coefficients c of the columns the closed loop is A_c = A + B diag(c) L with L the limits of their blocks, and
p solves s + L'(c r) + (A_c - I)'p = 0.  The next c are those that reach m_g(r + B'p).  From a stable policy every next
one is stable, p decreases, and a p that comes back is optimal; p lies in int X* if and only if A_c is stable, so that
every solve checks itself.  Where no stable policy is known, value iteration from 0 leads to one: its policy is stable
as soon as p'x falls under it.  A problem with a strong discount has a stable policy always: where values take long, the
discount is taken back step by step.  Against disturbances every step of the controls is followed by steps of the
disturbance, in which p rises (Hoffman and Karp 1966).  Nothing here is trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...exact.budget import spend
from ...exact.matrix import Matrix
from ...exact.program import Block, Program, Solver
from .problem import CONTROL, DISTURBANCE, GROUP, Floats, Index, LinearCost

# Policies tried for one discount, and discounts; sizes of r + B'p below which both signs are as good.
_STEPS, _DISCOUNTS, _TIES = 100, 60, 1e-14
# Steps of value iteration.
_VALUES = 500


@dataclass(frozen=True, eq=False)
class Found:
    """A policy and its cost.

    Attributes
    ----------
    policy : ndarray of int, shape (m,)
    p : ndarray, shape (n,)
    steps : int
        Linear systems solved.
    """

    policy: Index
    p: Floats
    steps: int


class Policies:
    """Policy iteration for a problem.

    Parameters
    ----------
    problem : LinearCost
    """

    ties = _TIES

    def __init__(self, problem: Any) -> None:
        self.problem, self.steps = problem, 0
        self.s, self.r = problem.s.values[0], problem.r.values[0]
        kind = problem.kinds[problem.owner]
        self.disturbed, self.free = kind == DISTURBANCE, kind == CONTROL
        self._read()

    def _read(self) -> None:
        """The matrices, with the discount, in floating point; limits of the columns."""
        problem = self.problem
        self.rays, self.facets = np.asarray(problem.X.rays, dtype=float), np.asarray(problem.X.facets, dtype=float)
        drift, B = problem.discounted
        self.drift, self.B = np.asarray(drift.values), np.asarray(B.values)
        self.reach = np.abs(self.B)
        self.limits = np.asarray(problem.limits.values)[problem.owner]

    def pushed(self, p: Floats) -> Floats:
        """B'p for a row p."""
        return p @ self.B

    def optimal(self) -> Found | None:
        """A policy that no other one betters, as computed; None if none with a finite cost was found."""
        start = self._stable_policy()
        return None if start is None else self._improved(*start, 0.0)

    def cost(self, policy: Index, brake: float = 0.0) -> Floats | None:
        """p of a policy for x' = (A - brake I) x + ...; None if its closed loop is not stable."""
        n = len(self.s)
        spend(n**3 / 10 + 1e4)
        self.steps += 1
        loop = self.drift + self.B @ (policy[:, None] * self.limits) - brake * np.eye(n)
        try:
            p = np.linalg.solve(loop.T, -(self.s + (policy * self.r) @ self.limits))
        except np.linalg.LinAlgError:
            return None
        return p if np.isfinite(p).all() and (self.rays @ p > 0).all() else None

    def worst(self, policy: Index, brake: float = 0.0) -> tuple[Index, Floats] | None:
        """The policy against the disturbance that costs most, and its p, which rises from one to the next."""
        p = self.cost(policy, brake)
        for _ in range(_STEPS if self.disturbed.any() else 0):
            if p is None:
                return None
            wanted = np.where(self.disturbed, self._wanted(p), policy)
            # what is as bad as before stays
            wanted = np.where(self.disturbed & (wanted == 0), policy, wanted)
            if (wanted == policy).all():
                break
            policy, p = wanted, self.cost(wanted, brake)
        return None if p is None else (policy, p)

    def _wanted(self, p: Floats) -> Index:
        """What reaches m_g(r + B'p), with 0 for ties."""
        y = self.r + self.pushed(p)
        y[self._ties(y, p)] = 0.0
        return self.problem.policy(y)

    def _ties(self, y: Floats, p: Floats) -> Any:
        """Where y = r + B'p is as good as 0."""
        return ~(np.abs(y) > self.ties * (np.abs(self.r) + np.abs(p) @ self.reach))

    def _better(self, policy: Index, p: Floats) -> Index:
        """What reaches m_g(r + B'p), and as before where that is as good; disturbances as before."""
        wanted = self._wanted(p)
        return np.where(self.disturbed | (self.free & (wanted == 0)), policy, wanted)

    def _improved(self, policy: Index, p: Floats, brake: float) -> Found:
        """Policy iteration from a stable policy."""
        for _ in range(_STEPS):
            better = self._better(policy, p)
            if (better == policy).all():
                break
            found = self.worst(better, brake)
            # a step that wins no more than rounding, or no more than it loses, would be taken back by the next one
            if found is None or not self._won(p, found[1]) > 0:
                break
            policy, p = found
        return Found(policy, p, self.steps)

    def _won(self, p: Floats, later: Floats) -> float:
        """By how much p is larger on the generators, in all, ties not counted."""
        won = self.rays @ (p - later)
        won[np.abs(won) <= self.ties * (abs(self.rays) @ np.abs(p))] = 0.0
        return float(won.sum())

    def _stable_policy(self) -> tuple[Index, Floats] | None:
        """A policy of finite cost: one of two simple ones, of value iteration, or by discounts that are taken back."""
        greedy = self.problem.policy(self.pushed(np.asarray(self.facets.sum(axis=0)).ravel()))
        for start in (self.problem.policy(np.zeros(len(self.r))), greedy):
            found = self.worst(start)
            if found is not None:
                return found
        acting = np.asarray(abs(self.limits).sum(axis=1)) @ self.reach.T
        size = float((abs(self.drift).sum(axis=1) + acting).max())
        reached = self._by_values(1.0 if self.problem.discrete else 1 / size)
        found = None if reached is None else self.worst(reached)
        if found is not None:
            return found
        brake = 2 * size
        found = self.worst(greedy, brake)
        for _ in range(_DISCOUNTS):
            if found is None:
                return None
            here = self._improved(*found, brake)
            free = self.worst(here.policy)
            if free is not None:
                return free
            brake, found = self._weaker(here.policy, brake)
        return None

    def _by_values(self, step: float) -> Index | None:
        """The first policy under which the p of value iteration from 0 falls on X; None if that takes too long."""
        p = np.zeros(len(self.s))
        for _ in range(_VALUES):
            spend(10.0 * (np.size(self.drift) if isinstance(self.drift, np.ndarray) else self.drift.nnz) + 1e4)
            policy = self._wanted(p)
            moved = p @ self.drift + (policy * self.pushed(p)) @ self.limits
            if (self.rays @ p > 0).all() and (self.rays @ moved < 0).all():
                return policy
            p = p + step * (moved + self.s + (policy * self.r) @ self.limits)
        return None

    def _weaker(self, policy: Index, brake: float) -> tuple[float, tuple[Index, Floats] | None]:
        """The weakest of several brakes under which the policy is stable."""
        for part in (0.5, 0.8, 0.95, 0.99):
            found = self.worst(policy, part * brake)
            if found is not None:
                return part * brake, found
        return brake, None


def by_linear_program(problem: LinearCost, lp: Solver) -> Floats | None:
    """p of max p'x0 subject to D(p) in X*, x0 in int X; None if it has no finite optimum."""
    program, inside = _program(problem, "p", 0.0), np.asarray(problem.X.rays, dtype=float).sum(axis=0)
    if program is None:
        return None
    program.below(0.0, p=-inside[None, :], value=-np.ones((1, 1)))  # value is at least -p'x0
    answer = program.solve(lp)
    return answer["p"] if answer else None


def growing_vector(problem: LinearCost, lp: Solver) -> Floats | None:
    """d in X* with d'x on average 1 that does not fall, as far as possible; None if there seems to be none."""
    zeros = {name: Matrix.zeros(*getattr(problem, name).shape) for name in ("s", "r")}
    program, rays = _program(replace(problem, **zeros), "d", -1.0), np.asarray(problem.X.rays, dtype=float)
    if program is None:
        return None
    program.below(0.0, d=-rays)
    program.equal(1.0, d=rays.mean(axis=0)[None, :])
    answer = program.solve(lp)
    return answer["d"] if answer else None


def _program(problem: LinearCost, name: str, spared: float) -> Program | None:
    """D(p)'x + spared value >= 0 on the generators x with m_g(r + B'p) as variables, and the value to be minimised.

    None with disturbances, for which D is not concave.
    """
    if (problem.kinds == DISTURBANCE).any():
        return None
    rays, (drift, B) = np.asarray(problem.X.rays, dtype=float), problem.discounted
    blocks, kind = len(problem.kinds), problem.kinds[problem.owner]
    free = {"low": -np.inf}
    program = Program(
        **{name: Block(rays.shape[1], **free)}, best=Block(blocks, **free), value=Block(1, cost=1.0, **free)
    )
    seen = rays @ np.asarray(problem.limits.values).T
    program.below(
        rays @ problem.s.values[0],
        **{name: -rays @ np.asarray(drift.values).T},
        best=-seen,
        value=np.full(len(rays), spared),
    )
    owned = np.eye(blocks)[problem.owner]
    columns, r, both = np.asarray(B.values).T, problem.r.values[0], kind == CONTROL
    program.below(r, **{name: -columns}, best=owned)
    program.below(-r[both], **{name: columns[both]}, best=owned[both])
    program.below(0.0, best=np.eye(blocks)[problem.kinds == GROUP])
    return program
