"""`optimal_feedback`: the policy of least linear cost, with its cost proven from both sides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from control import StateSpace
from numpy.typing import ArrayLike

from ...cones import Cone
from ...errors import DataError
from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.intake import exact_number
from ...networks.closed_loop import EXACT_STATES
from ...progress import Target
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ...systems.signals import signals_of
from ..plant import read_system
from ..running import Programs, within
from .answer import OptimalFeedback
from .arguments import Question, goes_sparse
from .certificate import GrowingCost, OptimalCostCertificate, settled
from .horizon import planned, read_horizon
from .messages import obstacle
from .own import OwnGains, admissible
from .policies import Found
from .routes import NetworkRoute, Route, network_route, system_route

# How far apart the proven bounds are from the cost that was computed, relative to it, tried in turn.
_APART = (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4)


def optimal_feedback(
    sys: Any,
    s: ArrayLike,
    r: ArrayLike,
    limits: ArrayLike,
    *,
    X: Cone | ArrayLike | None = None,
    controls: ArrayLike | None = None,
    groups: Sequence[Sequence[int]] | ArrayLike | None = None,
    use_all: bool = False,
    disturbance: tuple[ArrayLike, ArrayLike] | None = None,
    discount: Any = None,
    horizon: int | None = None,
    terminal_cost: ArrayLike | None = None,
    constraints: Callable[[Any], Sequence[Any]] | None = None,
    objective: Callable[[Any], Any] | None = None,
    gap: float = 1e-3,
    time_limit: float | None = None,
    progress: Target = None,
) -> OptimalFeedback:
    """Minimise the sum (integral) of s'x + r'u over all u with |u_i| <= l_i'x, from every state of X at once.

    Parameters
    ----------
    sys : ConeStateSpace, control.StateSpace or network
        The plant x' = A x + B u; discrete time if its timebase says so.  A network is taken as its closed loop; with
        sparse limits, or above 300 states, in sparse matrices, at any size, for nodes and links of doubles without
        feedthrough.
    s : array_like, shape (n,)
        Cost of the states, per unit of time or per step.  For a network of nodes of one size also (nodes, states).
    r : array_like, shape (m,)
        Cost of the inputs.
    limits : array_like or sparse matrix, shape (m, n)
        Rows l_i, nonnegative on X: |u_i| <= l_i'x.  With `groups` one row for each group, in their order.
    X : Cone or array_like of rays, optional
        Default: the cone of `sys` (the orthant for a plain system).  Not for networks of more than 300 states.
    controls : array_like or sparse matrix, shape (inputs, m), optional
        u = controls mu, and mu takes the place of u in everything above: a control may act on several inputs, as one
        that moves something from one node of a network to another, with -1 and 1.
    groups : sequence of lists of inputs, or ndarray of int, shape (m,), optional
        Inputs that share a limit: u_i >= 0 for i in group g, and their sum at most l_g'x.  Every input is in one group;
        an array holds the number of the group of every input.
    use_all : bool
        The inputs of a group use up its limit: their sum is l_g'x, as in routing and shortest paths.
    disturbance : (G, M), optional
        x' = A x + B u + G w with |w_j| <= m_j'x, rows m_j of M, chosen by an adversary who maximises the cost.
    discount : number, optional
        Continuous time: the rate rho >= 0 of the weight exp(-rho t); discrete time: the factor beta of beta^k.
    horizon : int, optional
        Discrete time: minimise the cost of so many steps, with a gain for every one of them.  Default: of all steps.
    terminal_cost : array_like, shape (n,), optional
        With `horizon` the state x after the last step costs terminal_cost'x, of either sign.  Default: nothing.  The
        upper bound of the cost of all steps makes a predictive controller stable; see the guide.
    constraints : callable, optional
        Of a cvxpy variable F, shape (m, n): a list of further linear constraints, as in `state_feedback`.  The gain is
        the cheapest that is found; `cost_bounds` bound its cost from above, and that of all inputs within the limits
        from below.  Not with disturbance or horizon, nor for networks in sparse matrices.
    objective : callable, optional
        Of the same variable: a convex expression to minimise among the gains next to the cheapest one.
    gap : float
        With an objective the gain may cost more than the cheapest one that is found by this part of it.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.  None: operations are counted.
    progress : callable or bool, optional
        As in `state_feedback`.

    Returns
    -------
    OptimalFeedback
        PROVED with the gain, and bounds of the optimal cost; REFUTED, with proof, if no policy has a finite cost from
        inside X; UNDECIDED otherwise, also where some admissible input leaves X (the message says which facet,
        generator and inputs, and the limits that would do) or where some stage costs nothing.  With `horizon` costs may
        have either sign; the bounds are equal where the fractions stay short.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Arguments that do not fit together; limits that are negative somewhere on X; a cost that is, without `horizon`;
        a horizon in continuous time.

    Notes
    -----
    The optimal cost is linear, p'x, with p = s + A'p - sum_i |r_i + B_i'p| l_i in discrete time, and the input
    u_i = -sign(r_i + B_i'p) l_i'x is optimal (Rantzer 2022; Li and Rantzer, arXiv:2306.02072, on the orthant; the proof
    for cones is in the guide).  Policy iteration finds p by a handful of linear solves with n^3 operations each, or
    by sparse ones: then all of it is linear in the number of nodes, links and controls.

    Examples
    --------
    >>> import control_kpos as kp, numpy as np
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> plant = kp.ConeStateSpace([["0.7", "0.1"], ["-0.2", "0.3"]], [[0], ["0.2"]], np.eye(2), 0, True, X=X)
    >>> a = kp.optimal_feedback(plant, s=[3, 1], r=["0.1"], limits=[[2, 1]])
    >>> bool(a), a.F, a.cost.round(6)
    (True, array([[-2., -1.]]), array([6.      , 1.666667]))
    """
    question = Question(s, r, limits, groups, use_all, disturbance, discount)
    route = (network_route if goes_sparse(sys, limits, X) else system_route)(question, sys, X, controls)
    if horizon is None and terminal_cost is not None:
        raise DataError(
            "terminal_cost is what the state after the last step costs; give horizon=, the number of steps."
        )
    own = constraints is not None or objective is not None
    if own and (horizon is not None or disturbance is not None or isinstance(route, NetworkRoute)):
        raise DataError(
            "constraints and objective are for one system, or a network with dense limits of up to "
            f"{EXACT_STATES} states, and go neither with disturbance nor with horizon."
        )
    spare = float(exact_number(gap, "gap", nonnegative=True))
    plan = None if horizon is None else read_horizon(route, horizon, terminal_cost, sys)
    design = partial(solved, route) if plan is None else partial(planned, route, plan)
    if own:
        design = partial(_constrained, route, constraints, objective, spare)
    found = within(time_limit, design, route.effort, answer=OptimalFeedback, progress=progress)
    return found if found or not isinstance(sys, StateSpace) else _by_name(found, sys, X, controls is None)


def _by_name(answer: OptimalFeedback, sys: StateSpace, X: Any, own_inputs: bool) -> OptimalFeedback:
    """The answer with the names of the states and inputs that its message numbers; controls have none."""
    system = read_system(sys, X)
    signals = signals_of(sys, system.X, system.U, system.Y)
    signals = signals if own_inputs else signals.of_states()
    return replace(answer, message=answer.message + signals.legend(answer.message))


def solved(route: Route, lp: Programs) -> OptimalFeedback:
    """The answer by a route."""
    problem = route.problem
    lp.stage("assumptions")
    spend(route.proof)
    assumptions = problem.assumptions()
    stands = obstacle(problem, assumptions)
    if stands:
        return OptimalFeedback(status=Status.UNDECIDED, message=stands)
    lp.stage("policies")
    found = first_proven(route.candidates(lp), lambda candidate: _proven(route, candidate, assumptions))
    if found is not None:
        return found
    for vector in route.growing_vectors(lp):
        spend(route.proof)
        refuted = settled(OptimalCostCertificate, assumptions, problem=problem, witness=GrowingCost(vector))
        if refuted.status is Status.REFUTED:
            return OptimalFeedback(status=Status.REFUTED, certificate=refuted, iterations=route.policies.steps)
    return OptimalFeedback(
        status=Status.UNDECIDED,
        message="no policy of finite cost was proven, and none was excluded. Try exact data, or a discount.",
        iterations=route.policies.steps,
    )


def _proven(route: Route, found: Found, assumptions: Sequence[Condition]) -> OptimalFeedback | None:
    def prove(part: float) -> OptimalCostCertificate | None:
        spend(route.proof)
        bounds = {"lower": found.p * (1 - part), "upper": found.p * (1 + part)}
        return (
            settled(OptimalCostCertificate, assumptions, problem=route.problem, policy=found.policy, **bounds) or None
        )

    least = route.apart(found)
    proof = first_proven((part for part in _APART if part >= least), prove)
    if proof is None:
        return None
    gain = route.gain(found.policy)
    return OptimalFeedback(
        status=Status.PROVED,
        certificate=proof,
        F=gain.values,
        cost=found.p,
        cost_bounds=(np.asarray(proof.lower), np.asarray(proof.upper)),
        closed_loop=route.loop(gain, found.policy),
        iterations=found.steps,
    )


def _constrained(route: Route, constraints: Any, objective: Any, gap: float, lp: Programs) -> OptimalFeedback:
    """The answer under the user's own constraints; that without them if it is no gain."""
    problem = route.problem
    own = OwnGains(problem, route.policies, constraints, objective, lp)
    free = solved(route, lp)
    if not free:
        return free
    lp.stage("gains under the constraints given")
    found = own.found(np.asarray(free.cost), gap, chosen=objective is not None)
    if found is None:
        message = f"no gain of finite cost that meets the constraints given was found; {own.message}."
        return OptimalFeedback(status=Status.UNDECIDED, message=message, iterations=free.iterations)
    gain, steps, lower = admissible(problem, found.F), free.iterations + found.steps, vars(free.certificate)["lower"]
    (_, p), assumptions = own.costed(np.asarray(gain.values)) or (None, found.p), problem.assumptions()
    proof = first_proven(
        (
            settled(OptimalCostCertificate, assumptions, problem=problem, gain=gain, lower=lower, upper=p * (1 + part))
            for part in _APART
        ),
        lambda proof: proof,
    )
    if proof is None or not own.is_met(gain.values):
        message = "a gain was found, but it could not be proven to keep to the limits, or breaks the constraints given."
        return OptimalFeedback(status=Status.UNDECIDED, message=message, iterations=steps)
    return OptimalFeedback(
        status=Status.PROVED,
        certificate=proof,
        F=gain.values,
        cost=p,
        cost_bounds=(np.asarray(proof.lower), np.asarray(proof.upper)),
        closed_loop=route.loop(gain, np.zeros(0, dtype=np.intp)),
        iterations=steps,
    )
