"""Optimal control under constraints that the user writes: against grids of gains, the free optimum, forged gains."""

from dataclasses import replace
from fractions import Fraction

import cvxpy as cp
import numpy as np
import pytest
from test_optimal import random_problem, seed_plant, system
from test_optimal_networks import transport

import control_kpos as kp
from control_kpos.design.optimal.own import OwnGains, admissible
from control_kpos.design.optimal.policies import Policies
from control_kpos.design.running import Programs
from control_kpos.errors import DataError
from control_kpos.exact.matrix import Matrix

SEED_COST = {"s": [3, 1], "r": ["0.1"], "limits": [[2, 1]]}


def cost_of(sys, s, r, F):
    """p of the gain F, from its closed loop; None if that is not stable."""
    loop = sys.A + sys.B @ F
    poles = np.linalg.eigvals(loop)
    if (np.abs(poles).max() >= 1) if sys.dt else (poles.real.max() >= 0):
        return None
    return np.linalg.solve((np.eye(len(s)) * bool(sys.dt) - loop).T, s + F.T @ r)


def exactly_within(sys, L, F):
    """|F x| <= L x at all generators, in fractions."""
    R = sys.X.exact_rays.plain().fractions().tolist()
    F, L = (np.vectorize(Fraction, otypes=[object])(np.asarray(M)) for M in (F, L))
    return all((abs(F @ x) <= L @ x).all() for x in map(np.array, R))


# -- what is found


@pytest.mark.parametrize("seed", range(4))
def test_without_constraints_it_is_the_optimum(seed):
    rng, proved = np.random.default_rng(seed), 0
    for _ in range(15):
        sys, s, r, L = random_problem(rng)
        free, own = kp.optimal_feedback(sys, s, r, L), kp.optimal_feedback(sys, s, r, L, constraints=lambda F: [])
        assert own.status is free.status
        if free:
            R = np.asarray(sys.X.rays)
            np.testing.assert_allclose(R @ own.cost, R @ free.cost, rtol=1e-5)
            assert own.check() and (own.certificate.lower == free.certificate.lower).all()
            assert own.certificate.gain is not None and own.certificate.policy is None
            proved += 1
    assert proved > 8


@pytest.mark.parametrize("discrete", [True, False])
def test_one_number_for_two_inputs_is_the_best_of_a_grid(discrete):
    """u = f (x_1, x_2): one f for both, although one input should go up and the other down."""
    A = np.array([[0.6, 0.3], [0.1, 0.6]]) - (not discrete) * np.eye(2)
    plant, s, r, L = system(A, [[0.3, 0], [0, -0.3]], discrete), np.ones(2), np.array([0.05, 0.05]), np.eye(2)
    grid = [(f, cost_of(plant, s, r, f * np.eye(2))) for f in np.linspace(-1, 1, 2001)]
    free = kp.optimal_feedback(plant, s, r, L)
    best = min(((p / free.cost).sum(), f) for f, p in grid if p is not None)
    same = kp.optimal_feedback(plant, s, r, L, constraints=lambda F: [F[0, 0] == F[1, 1], F[0, 1] == 0, F[1, 0] == 0])
    assert same and abs(same.F[0, 0] - same.F[1, 1]) < 1e-6 and same.F[0, 0] == pytest.approx(best[1], abs=2e-3)
    assert 2 < (same.cost / free.cost).sum() <= best[0] * (1 + 1e-5)
    assert (same.cost_bounds[0] <= free.cost).all() and (same.cost_bounds[1] >= same.cost).all()
    assert same.certificate.gap > 0.01 and "nothing else is proven" in same.explain()
    np.testing.assert_allclose(same.cost, cost_of(plant, s, r, same.F))


def test_an_objective_chooses_among_gains_of_nearly_the_same_cost():
    rng = np.random.default_rng(5)
    A = 0.02 + 0.1 * rng.random((4, 4)) + 0.3 * np.eye(4)
    plant, s, r = system(A, 0.1 * np.eye(4)), np.ones(4), np.full(4, 0.01)
    L = 0.1 * np.ones((4, 4))
    free = kp.optimal_feedback(plant, s, r, L)
    sizes = [np.abs(free.F).sum()]
    for gap in (0.0, 0.01, 0.1):
        a = kp.optimal_feedback(plant, s, r, L, objective=cp.norm1, gap=gap)
        assert a and (a.cost <= (1 + gap) * free.cost * (1 + 1e-6)).all()
        sizes.append(np.abs(a.F).sum())
    assert all(np.diff(sizes) <= 1e-6) and sizes[-1] < 0.8 * sizes[0]


@pytest.mark.parametrize("seed", range(30))
def test_gains_meet_constraints_and_keep_to_the_limits(seed):
    rng = np.random.default_rng(seed)
    while not (free := kp.optimal_feedback(*(problem := random_problem(rng)))):
        pass
    sys, s, r, L = problem
    R, row = np.asarray(sys.X.rays), rng.normal(size=sys.nstates)
    most = 0.5 * row @ free.F.T @ np.ones(sys.ninputs)
    demand = (lambda F: [cp.sum(F @ row) <= most]) if most > 0 else (lambda F: [cp.sum(F @ row) >= most])
    a = kp.optimal_feedback(*problem, constraints=demand)
    if not a:
        assert a.status is kp.Status.UNDECIDED and a.message
        return
    sign = 1 if most > 0 else -1
    assert sign * (a.F @ row).sum() <= sign * most + 1e-6 * (1 + np.abs(a.F).max())
    assert a.check() and exactly_within(sys, L, a.certificate.gain.fractions())
    assert (R @ a.cost >= R @ a.cost_bounds[0]).all() and (R @ a.cost <= R @ a.cost_bounds[1]).all()
    np.testing.assert_allclose(R @ a.cost, R @ cost_of(sys, s, r, a.F), rtol=1e-6)
    assert a.closed_loop.linear_lyapunov()
    np.testing.assert_allclose(a.closed_loop.A, sys.A + sys.B @ a.F, atol=1e-12)


def test_groups_and_discounts():
    given = {"s": [3, 3], "r": [1, "-1/3"], "limits": [[1, 1]], "groups": [[0, 1]]}
    plant = system([["1/2", "1/4"], [0, "1/4"]], [[0, -0.125], [0.25, 0]])
    for more in ({}, {"use_all": True}, {"discount": "1/2"}):
        free = kp.optimal_feedback(plant, **given, **more)
        a = kp.optimal_feedback(plant, **given, **more, constraints=lambda F: [F[1, 0] <= 0.5])
        gain = a.certificate.gain.fractions()
        assert a and a.check() and a.F[1, 0] <= 0.5 + 1e-6 and free.F[1, 0] == 1
        assert (gain >= 0).all() and (gain.sum(axis=0) <= 1).all() and (a.cost >= free.cost - 1e-9).all()
        assert not more.get("use_all") or (gain.sum(axis=0) == 1).all()
        assert ("exponentially stable" in a.explain()) is ("discount" not in more)


def test_a_first_gain_is_sought_by_value_iteration():
    """At the free optimum of this plant the gain that is best for one step, of those allowed, is not stable."""
    plant, s, r, L = (
        system([[1.1, 0.0], [0.5, 0.9]], [[-0.5, 0], [0, -0.5]]),
        np.ones(2),
        np.array([1.2, 0.0]),
        np.eye(2),
    )
    asked = {"groups": [[0], [1]], "constraints": lambda F: [F[0, 0] + F[1, 1] <= 1]}
    a = kp.optimal_feedback(plant, s, r, L, **asked)
    assert a and a.F[0, 0] + a.F[1, 1] <= 1 + 1e-6 and np.abs(a.closed_loop.poles()).max() < 1


# -- what is not found, and what is refused


def test_constraints_that_nothing_meets():
    a = kp.optimal_feedback(seed_plant(), **SEED_COST, constraints=lambda F: [F[0, 0] >= 5])
    assert a.status is kp.Status.UNDECIDED and a.F is None and "infeasible" in a.message
    unstable = system([[1.2]], [[-0.4]])
    a = kp.optimal_feedback(unstable, [1], [0], [[1]], groups=[[0]], constraints=lambda F: [F <= 0.1])
    assert a.status is kp.Status.UNDECIDED and "no gain of finite cost" in a.message


def test_what_stands_in_the_way_without_constraints_does_so_with_them():
    refuted = kp.optimal_feedback(system([[2]], [[0.5]]), [1], [0], [[1]], constraints=lambda F: [])
    assert refuted.status is kp.Status.REFUTED and refuted.check()
    out = kp.optimal_feedback(system([[0.2]], [[0.5]]), [1], [0], [[1]], objective=cp.norm1)
    assert out.status is kp.Status.UNDECIDED and "may push x out of X" in out.message


def test_forged_gains_prove_nothing():
    c = kp.optimal_feedback(seed_plant(), **SEED_COST, constraints=lambda F: [F[0, 0] >= -1]).certificate
    assert c.check()
    for change in (
        {"lower": c.lower * 1.2},
        {"upper": c.upper * 0.999},
        {"gain": Matrix(3.0 * np.asarray(c.gain.values))},
        {"gain": Matrix(np.array([[-1.0, 0.0]]))},
        {"gain": Matrix(np.zeros((1, 2)))},
        {"gain": Matrix(np.array([[-1.0, np.nan]]))},
        {"gain": Matrix(np.ones((2, 2)))},
        {"policy": np.array([-1])},
        {"gain": None},
    ):
        assert not replace(c, **change).check(), change.keys()


def test_inputs_are_clipped_exactly():
    """A third is no double: the gain is the fraction, where the input is at its limit."""
    limits = [["2/3", "1/3"]]
    a = kp.optimal_feedback(seed_plant(), [3, 1], ["0.1"], limits, constraints=lambda F: [])
    gain = a.certificate.gain.fractions()
    assert a and exactly_within(seed_plant(), limits, gain) and gain.tolist() == [[Fraction(-2, 3), Fraction(-1, 3)]]
    far = admissible(a.certificate.problem, np.array([[0.0, 9.0]])).fractions()
    assert far.tolist() == [[Fraction(2, 3), Fraction(1, 3)]]
    near = admissible(a.certificate.problem, np.array([[1e-12, 0.1]])).fractions()
    assert near.tolist() == [[2 * Fraction(0.1), Fraction(0.1)]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"constraints": lambda F: F[5, 5] >= 0}, "failed on a cvxpy variable of shape"),
        ({"constraints": lambda F: [1]}, "list of cvxpy constraints"),
        ({"objective": lambda F: -cp.norm1(F)}, "convex"),
        ({"constraints": lambda F: [], "horizon": 2}, "neither with disturbance nor with horizon"),
        ({"objective": cp.norm1, "disturbance": ([[1]], [[0]])}, "neither with disturbance nor with horizon"),
        ({"objective": cp.norm1, "gap": -1}, "gap"),
    ],
)
def test_wrong_arguments(changes, message):
    data = {"sys": system([["3/4"]], [["1/4"]]), "s": [1], "r": [0], "limits": [[0.5]]} | changes
    with pytest.raises(DataError, match=message):
        kp.optimal_feedback(**data)


def test_networks_in_sparse_matrices_are_refused():
    with pytest.raises(DataError, match="dense limits"):
        kp.optimal_feedback(**transport(20), constraints=lambda F: [])


def test_solvers_that_are_functions_are_refused():
    problem = kp.optimal_feedback(seed_plant(), **SEED_COST).certificate.problem
    with pytest.raises(DataError, match="go through cvxpy"):
        OwnGains(problem, Policies(problem), None, None, Programs(lambda *_: None, lambda *_: None))


def test_a_time_limit_ends_it():
    a = kp.optimal_feedback(seed_plant(), **SEED_COST, constraints=lambda F: [], time_limit=1e-9)
    assert a.status is kp.Status.UNDECIDED and a.F is None
