"""`optimal_feedback`: the policy of least linear cost, with its cost proven from both sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...cards import floored
from ...cones import Cone, orthant
from ...errors import DataError, ShapeError
from ...exact.condition import Condition
from ...exact.intake import exact_matrix, exact_number, flag, items, require_shape, whole_number
from ...exact.matrix import Matrix
from ...progress import Target
from ...proof.answer import Answer, first_proven
from ...proof.certificate import Status
from ...systems.statespace import ConeStateSpace
from ...systems.system import System
from ..plant import closed_loop, read_system, times
from ..running import within
from .certificate import GrowingCost, OptimalCostCertificate
from .policies import Found, Policies, by_linear_program, growing_vector
from .problem import CONTROL, COSTS, DISTURBANCE, GROUP, KEPT, LIMITS, SHARED, Floats, Index, LinearCost

# How far apart the proven bounds are from the cost that was computed, relative to it, tried in turn.
_APART = (1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalFeedback(Answer):
    """Outcome of `optimal_feedback`.  `bool(answer)` is True only for PROVED.

    Attributes
    ----------
    F : ndarray, shape (m, n), or None
        u = F x: a row is minus or plus its limit, or 0.  With `controls` mu = F x, and u = controls mu.
    cost : ndarray, shape (n,), or None
        p of the optimal cost p'x, as computed; `cost_bounds` has what is proven.
    cost_bounds : tuple of ndarray, shapes (n,), or None
        Proven: lower'x <= optimal cost from x <= cost of F <= upper'x, for every x in X.
    closed_loop : ConeStateSpace or None
        From further inputs to y, with A + B F exact.
    iterations : int
        Linear systems solved.
    """

    F: Floats | None = None
    cost: Floats | None = None
    cost_bounds: tuple[Floats, Floats] | None = None
    closed_loop: ConeStateSpace | None = None
    iterations: int = 0

    @property
    def K(self) -> Floats | None:
        """-F, for u = -K x as python-control writes it."""
        return None if self.F is None else -self.F

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        return [("policies tried", str(self.iterations))] if self else []


def optimal_feedback(
    sys: Any,
    s: ArrayLike,
    r: ArrayLike,
    limits: ArrayLike,
    *,
    X: Cone | ArrayLike | None = None,
    controls: ArrayLike | None = None,
    groups: Sequence[Sequence[int]] | None = None,
    use_all: bool = False,
    disturbance: tuple[ArrayLike, ArrayLike] | None = None,
    discount: Any = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> OptimalFeedback:
    """Minimise the sum (integral) of s'x + r'u over all u with |u_i| <= l_i'x, from every state of X at once.

    Parameters
    ----------
    sys : ConeStateSpace, control.StateSpace or network
        The plant x' = A x + B u; discrete time if its timebase says so.  A network is taken as its closed loop.
    s : array_like, shape (n,)
        Cost of the states, per unit of time or per step.
    r : array_like, shape (m,)
        Cost of the inputs.
    limits : array_like, shape (m, n)
        Rows l_i, nonnegative on X: |u_i| <= l_i'x.  With `groups` one row for each group, in their order.
    X : Cone or array_like of rays, optional
        Default: the cone of `sys` (the orthant for a plain system).
    controls : array_like, shape (inputs, m), optional
        u = controls mu, and mu takes the place of u in everything above: a control may act on several inputs, as one
        that moves something from one node of a network to another, with -1 and 1.
    groups : sequence of lists of inputs, optional
        Inputs that share a limit: u_i >= 0 for i in group g, and their sum at most l_g'x.  Every input is in one group.
    use_all : bool
        The inputs of a group use up its limit: their sum is l_g'x, as in routing and shortest paths.
    disturbance : (G, M), optional
        x' = A x + B u + G w with |w_j| <= m_j'x, rows m_j of M, chosen by an adversary who maximises the cost.
    discount : number, optional
        Continuous time: the rate rho >= 0 of the weight exp(-rho t); discrete time: the factor beta of beta^k.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.  None: operations are counted.
    progress : callable or bool, optional
        As in `state_feedback`.

    Returns
    -------
    OptimalFeedback
        PROVED with the gain, and bounds of the optimal cost; REFUTED, with proof, if no policy has a finite cost from
        inside X; UNDECIDED otherwise, also where some admissible input leaves X (the message says which facet,
        generator and inputs, and the limits that would do) or where some stage costs nothing.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Arguments that do not fit together; limits that are negative somewhere on X; a cost that is.

    Notes
    -----
    The optimal cost is linear, p'x, with p = s + A'p - sum_i |r_i + B_i'p| l_i in discrete time, and the input
    u_i = -sign(r_i + B_i'p) l_i'x is optimal (Rantzer 2022; Li and Rantzer, arXiv:2306.02072, on the orthant; the proof
    for cones is in the guide).  Policy iteration finds p by a handful of linear solves with n^3 operations each.

    Examples
    --------
    >>> import control_kpos as kp, numpy as np
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> plant = kp.ConeStateSpace([["0.7", "0.1"], ["-0.2", "0.3"]], [[0], ["0.2"]], np.eye(2), 0, True, X=X)
    >>> a = kp.optimal_feedback(plant, s=[3, 1], r=["0.1"], limits=[[2, 1]])
    >>> bool(a), a.F, a.cost.round(6)
    (True, array([[-2., -1.]]), array([6.      , 1.666667]))
    """
    plant = _controlled(read_system(sys, X), controls)
    problem = _read(plant, s, r, limits, groups, use_all, disturbance, discount)
    return within(time_limit, lambda lp: _found(problem, plant, lp), answer=OptimalFeedback, progress=progress)


def _found(problem: LinearCost, plant: System, lp: Any) -> OptimalFeedback:
    stands = _message(problem, problem.assumptions())
    if stands:
        return OptimalFeedback(status=Status.UNDECIDED, message=stands)
    policies = Policies(problem)
    found = first_proven(_candidates(problem, policies, lp), lambda candidate: _proven(problem, plant, candidate))
    if found is not None:
        return found
    for vector in _growing_candidates(problem, lp):
        refuted = OptimalCostCertificate.settle(problem=problem, witness=GrowingCost(vector))
        if refuted.status is Status.REFUTED:
            return OptimalFeedback(status=Status.REFUTED, certificate=refuted, iterations=policies.steps)
    return OptimalFeedback(
        status=Status.UNDECIDED,
        message="no policy of finite cost was proven, and none was excluded. Try exact data, or a discount.",
        iterations=policies.steps,
    )


def _growing_candidates(problem: LinearCost, lp: Any) -> Any:
    """d by a linear program, and the facets of X, on the edge of X* where doubles fail."""
    d = growing_vector(problem, lp)
    if d is not None:
        yield d
        yield np.round(d, 9)
    for facet in problem.X.exact_facets.plain().fractions():
        if all(abs(a) < 2**53 for a in facet):
            yield np.array([float(a) for a in facet])


def _candidates(problem: LinearCost, policies: Policies, lp: Any) -> Any:
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


def _proven(problem: LinearCost, plant: System, found: Found) -> OptimalFeedback | None:
    policy = tuple(found.policy.tolist())

    def prove(part: float) -> OptimalCostCertificate | None:
        bounds = {"lower": found.p * (1 - part), "upper": found.p * (1 + part)}
        return OptimalCostCertificate.settle(problem=problem, policy=policy, **bounds) or None

    proof = first_proven(_APART, prove)
    if proof is None:
        return None
    chosen = problem.kinds[problem.owner] != DISTURBANCE
    signs, owner = found.policy[chosen, None], problem.owner[chosen]
    gain = Matrix.from_fractions(signs.astype(object) * problem.limits.fractions()[owner])
    return OptimalFeedback(
        status=Status.PROVED,
        certificate=proof,
        F=np.asarray(gain.values),
        cost=found.p,
        cost_bounds=(np.asarray(proof.lower), np.asarray(proof.upper)),
        closed_loop=_loop(plant, gain),
        iterations=found.steps,
    )


def _loop(plant: System, gain: Matrix) -> ConeStateSpace:
    """From further inputs to y, with A + B F exact."""
    A, C = closed_loop(plant.A, plant.B, gain), closed_loop(plant.C, plant.D, gain)
    cones = {"X": plant.X, "U": plant.U, "Y": plant.Y}
    return ConeStateSpace(A, plant.B, C, plant.D, plant.dt, **cones, remove_useless_states=False)


# -- arguments


def _controlled(plant: System, controls: Any) -> System:
    """The plant with mu in the place of u = controls mu, on the orthant."""
    plant.X.require_proper("X")
    if controls is None:
        return plant
    mix = exact_matrix(controls, "controls")
    require_shape(mix, "controls", (plant.sizes[1], None), "one row per input of sys, one column per control")
    if not mix.shape[1]:
        raise ShapeError("controls has no columns; give one column per control.")
    mixed = {name: times(getattr(plant, name), mix.dense()) for name in "BD"}
    return replace(plant, **mixed, U=orthant(mix.shape[1]))


def _read(
    plant: System, s: Any, r: Any, limits: Any, groups: Any, use_all: bool, disturbance: Any, discount: Any
) -> LinearCost:
    n, m, _ = plant.sizes
    states, inputs = _row(s, "s", n, "state of sys"), _row(r, "r", m, "input of sys (or column of controls)")
    owner, kinds = _blocks(groups, m, flag(use_all, "use_all"))
    L = exact_matrix(limits, "limits")
    require_shape(L, "limits", (len(kinds), n), "one row per input (per group), one column per state")
    B = plant.B
    if disturbance is not None:
        pair = items(disturbance, "disturbance")
        if len(pair) != 2:
            raise ShapeError("disturbance must be a pair (G, M): how it enters, and its limits.")
        G, sizes = (exact_matrix(part, f"disturbance {name}") for part, name in zip(pair, "GM", strict=True))
        require_shape(G, "disturbance G", (n, None), "one row per state")
        require_shape(sizes, "disturbance M", (G.shape[1], n), "one row per column of G, one column per state")
        owner = np.concatenate([owner, len(kinds) + np.arange(G.shape[1])])
        kinds = np.concatenate([kinds, np.full(G.shape[1], DISTURBANCE)])
        B, L = Matrix.join([B, G], -1), Matrix.join([L, sizes], -2)
        inputs = Matrix.join([inputs, Matrix.zeros(1, G.shape[1])], -1)
    rate = _discount(discount, plant.discrete)
    return LinearCost(plant.A, B, plant.X, plant.discrete, states, inputs, L, owner, kinds, rate)


def _row(values: Any, name: str, size: int, of: str) -> Matrix:
    row = exact_matrix(values, name)
    if row.shape != (1, size):
        raise ShapeError(f"{name} has shape {np.shape(values)}; it must be ({size},), one number per {of}.")
    return row


def _blocks(groups: Any, m: int, use_all: bool) -> tuple[Index, Index]:
    if groups is None:
        if use_all:
            raise DataError("use_all is about groups; give groups=, such as one group of all inputs.")
        return np.arange(m), np.full(m, CONTROL)
    given = [[whole_number(i, "groups") for i in items(group, "groups")] for group in items(groups, "groups")]
    flat = [i for group in given for i in group]
    if not all(given) or sorted(flat) != list(range(m)):
        raise DataError(f"groups must hold each of the {m} inputs, 0 to {m - 1}, once, and none may be empty.")
    owner = np.empty(m, dtype=np.intp)
    for g, group in enumerate(given):
        owner[group] = g
    return owner, np.full(len(given), SHARED if use_all else GROUP)


def _discount(discount: Any, discrete: bool) -> Fraction:
    if discount is None:
        return Fraction(int(discrete))
    rate = exact_number(discount, "discount", positive=discrete, nonnegative=not discrete)
    if discrete and rate > 1:
        raise DataError(f"discount is {discount}; in discrete time it must be at most 1.")
    return rate


def _message(problem: LinearCost, conditions: Sequence[Condition]) -> str:
    """What does not hold of the assumptions; an error for data that mean nothing."""
    found = {condition.name: condition for condition in conditions}
    at = found[LIMITS].worst_violation()
    if at is not None:
        first = int(np.count_nonzero(problem.kinds != DISTURBANCE))
        name = f"limits[{at[0]}]" if at[0] < first else f"disturbance M[{at[0] - first}]"
        raise DataError(f"{name} is negative at generator {at[1]} of X; |u| <= l'x needs l'x >= 0 on X.")
    costs = found[COSTS]
    at = costs.worst_violation()
    if at is not None and float(costs.forms.values[at]) < 0:
        raise DataError(
            f"the cost is negative at generator {at[1]} of X for some admissible input; raise s, or lower |r|."
        )
    if found[KEPT].verdict() is not True:
        return _leaves(problem, found[KEPT])
    if costs.verdict() is not True:
        where = "some state" if at is None else f"generator {at[1]} of X"
        return f"the cost of some admissible input at {where} is 0; bounds from below need s'x + r'u > 0, so raise s."
    return ""


def _leaves(problem: LinearCost, kept: Condition) -> str:
    """Which facet, generator and inputs, and the limits that would do."""
    at = kept.worst_violation()
    if at is None:
        return "whether every admissible input keeps X could not be proven at this size."
    h, x = (
        getattr(problem.X, f"exact_{name}").plain().fractions()[k]
        for name, k in zip(("facets", "rays"), at, strict=True)
    )
    place = f"facet {at[0]} at generator {at[1]}"
    rests, y = h @ problem.A.fractions() @ x, h @ problem.B.fractions()
    worst = problem.worst(y[None])[0] * (problem.limits.fractions() @ x)
    disturbed = problem.kinds == DISTURBANCE
    left, pushed = rests + worst[disturbed].sum(), -worst[~disturbed].sum()
    if rests < 0:
        return f"x leaves X through {place} without any input; choose another cone, or a first feedback."
    if left < 0:
        return f"a disturbance may push x out of X, through {place}; choose smaller limits M, or another cone."
    acting = ((worst < 0) & ~disturbed)[problem.owner] & ((y < 0) | (problem.kinds[problem.owner] == CONTROL))
    names = ", ".join(str(i) for i in np.flatnonzero(acting))
    if left == 0:
        return (
            f"inputs {names} may push x out of X, through {place}; set their limits to 0 there, or choose another cone."
        )
    return (
        f"inputs {names} may push x out of X, through {place}. Limits {floored(left / pushed, 3)} times as large there "
        "would do; or choose another cone."
    )
