"""A finite horizon: the optimal gains of N steps, backwards, with their cost proven from both sides.

With p_N the terminal cost and p_k = D(p_{k+1}) + p_{k+1} (see `problem`) the optimal cost of the steps k, ..., N - 1 is
p_k'x, and the inputs that reach m_g(r + B'p_{k+1}) are optimal in step k.  Exact where the fractions stay short; else
p_k is rounded, down for a bound from below and up for one from above: by a little of X*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import DataError
from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.intake import whole_number
from ...exact.matrix import Matrix
from ...networks.network import ConeNetwork
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ..running import Programs
from .answer import OptimalFeedback
from .arguments import of_states
from .certificate import settled
from .finite import FiniteCostCertificate, premises
from .messages import obstacle
from .problem import Index, LinearCost
from .routes import Route

# How far rounded costs are moved to the safe side, relative to their size, tried in turn.
_SLACK = (2.0**-45, 2.0**-38, 2.0**-30)


@dataclass(frozen=True, eq=False)
class Horizon:
    """Steps of a finite horizon, and what the state after the last one costs.

    Attributes
    ----------
    steps : int
    terminal : Matrix, shape (1, n)
    """

    steps: int
    terminal: Matrix


def read_horizon(route: Route, horizon: Any, terminal_cost: Any, sys: Any) -> Horizon:
    """The arguments `horizon` and `terminal_cost`, for a plant or network."""
    if not route.problem.discrete:
        raise DataError("horizon counts steps of discrete time, and sys is in continuous time; sample it first.")
    steps, n = whole_number(horizon, "horizon", least=1), route.problem.X.dim
    nodes = sys.model.n_nodes if isinstance(sys, ConeNetwork) else 0
    given = np.zeros(n) if terminal_cost is None else terminal_cost
    return Horizon(steps, of_states(given, "terminal_cost", n, nodes))


def planned(route: Route, horizon: Horizon, lp: Programs) -> OptimalFeedback:
    """The answer for a finite horizon."""
    problem = route.problem
    lp.stage("assumptions")
    spend(route.proof)
    assumptions = premises(problem)
    stands = obstacle(problem, assumptions)
    if stands:
        return OptimalFeedback(status=Status.UNDECIDED, message=stands)
    lp.stage("steps backwards")
    proof = first_proven(_SLACK, lambda slack: _proven(route, horizon, assumptions, slack))
    if proof is None:
        message = (
            "the costs of the steps were not proven. Try fewer steps, or units in which they are of ordinary size."
        )
        return OptimalFeedback(status=Status.UNDECIDED, message=message)
    return _answer(route, proof)


def _proven(
    route: Route, horizon: Horizon, assumptions: Sequence[Condition], slack: float
) -> FiniteCostCertificate | None:
    try:
        lower, _, exact = _backwards(route, horizon, -slack)
        upper, policies, _ = (lower, _, exact) if exact else _backwards(route, horizon, slack)
    except DataError:  # costs beyond the range of doubles
        return None
    spend(horizon.steps * route.proof)
    bounds = {"lower": lower, "upper": upper, "policies": policies, "terminal": horizon.terminal}
    return settled(FiniteCostCertificate, assumptions, problem=route.problem, **bounds) or None


def _backwards(route: Route, horizon: Horizon, slack: float) -> tuple[Matrix, Index, bool]:
    """The costs of all steps, rounded to the side of the slack, their policies, and whether all of them are exact."""
    problem: LinearCost = route.problem
    p, exact, rows, policies = horizon.terminal, True, [], []
    for _ in range(horizon.steps):
        spend(route.proof + 100.0 * problem.X.dim**2 * (not route.proof) + 1e4)
        p, policy, sizes = problem.earlier(p)
        if sizes is not None:
            p, exact = Matrix(p.values + slack * problem.covering(sizes)), False
        rows.append(p)
        policies.append(policy)
    return Matrix.join(rows[::-1], -2), np.array(policies[::-1]), exact


def _answer(route: Route, proof: FiniteCostCertificate) -> OptimalFeedback:
    """Gains and costs of a proven plan."""
    gains = [route.gain(policy) for policy in proof.policies]
    each = [gain.values for gain in gains]
    lower, upper = (np.asarray(bound.values[0]) for bound in (proof.lower, proof.upper))
    return OptimalFeedback(
        status=Status.PROVED,
        certificate=proof,
        F=np.array(each) if isinstance(each[0], np.ndarray) else tuple(each),
        cost=lower / 2 + upper / 2,
        cost_bounds=(lower, upper),
        closed_loop=route.loop(gains[0], proof.policies[0]),
        iterations=0,
    )
