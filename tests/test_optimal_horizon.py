"""Optimal control over finitely many steps: recursions in fractions, linear programs, brute force, planning anew."""

import itertools
import tracemalloc
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog
from test_optimal import random_problem, seed_plant, system
from test_optimal_networks import random_network, transport

import control_kpos as kp
from control_kpos import checker
from control_kpos.design.optimal.answer import OptimalFeedback
from control_kpos.design.optimal.arguments import Question
from control_kpos.design.optimal.horizon import planned, read_horizon
from control_kpos.design.optimal.routes import network_route, system_route
from control_kpos.design.running import within
from control_kpos.errors import DataError, ShapeError
from control_kpos.exact.matrix import Matrix

SEED_COST = {"s": [3, 1], "r": ["0.1"], "limits": [[2, 1]]}


def recursion(A, B, s, r, L, steps, last=None):
    """p_0, ..., p_N of p_k = s + A'p - sum_i |r_i + B_i'p| l_i in fractions, each input a block."""
    A, B, s, r, L = (np.vectorize(Fraction, otypes=[object])(np.asarray(M, dtype=object)) for M in (A, B, s, r, L))
    costs = [np.array([Fraction(0)] * len(s)) if last is None else last]
    for _ in range(steps):
        p = costs[0]
        costs.insert(0, s + p @ A - np.abs(r + p @ B) @ L)
    return costs


# -- worked examples


def test_the_example_on_a_skewed_cone_is_exact():
    costs = recursion([["0.7", "0.1"], ["-0.2", "0.3"]], [[0], ["0.2"]], [3, 1], ["0.1"], [[2, 1]], 7)
    a = kp.optimal_feedback(seed_plant(), **SEED_COST, horizon=7)
    assert a and a.check() and a.F.shape == (7, 1, 2) and np.array_equal(a.K, -a.F) and a.iterations == 0
    for bound in (a.certificate.lower, a.certificate.upper):
        assert (bound.fractions() == np.array(costs[:-1])).all()
    assert a.certificate.gap == 0 and "the two are equal" in a.explain() and a.margin == 0
    np.testing.assert_array_equal(a.closed_loop.A, a.closed_loop.A.astype(float))
    np.testing.assert_allclose(a.closed_loop.A, seed_plant().A + seed_plant().B @ a.F[0])
    one = kp.optimal_feedback(seed_plant(), **SEED_COST, horizon=1)
    np.testing.assert_allclose(one.cost, [2.8, 0.9])  # s - |r| l


def test_terminal_costs_are_those_of_the_last_state():
    last = [Fraction(1, 3), Fraction(-1, 7)]
    costs = recursion([["0.7", "0.1"], ["-0.2", "0.3"]], [[0], ["0.2"]], [3, 1], ["0.1"], [[2, 1]], 3, np.array(last))
    a = kp.optimal_feedback(seed_plant(), **SEED_COST, horizon=3, terminal_cost=["1/3", "-1/7"])
    assert a and (a.certificate.lower.fractions() == np.array(costs[:-1])).all()


def test_shortest_paths_need_no_cost_of_states():
    """Edges 1-2 (1), 1-3 (5), 2-3 (2), 3-target (1): in two steps 3, by the long edge and the last one, costs 6."""
    B = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 1, 0]])
    roads = system(np.zeros((3, 3)), B)
    given = {"s": [0, 0, 0], "r": [1, 5, 2, 1], "limits": np.eye(3), "groups": [[0, 1], [2], [3]], "use_all": True}
    far = kp.optimal_feedback(roads, **given, horizon=2, terminal_cost=[100, 100, 100])
    np.testing.assert_array_equal(far.cost, [6, 3, 1])
    a = kp.optimal_feedback(roads, **given, horizon=3, terminal_cost=[100, 100, 100])
    np.testing.assert_array_equal(a.cost, [4, 3, 1])
    assert a.certificate.gap == 0 and a.F[0, 0, 0] == 1 and far.F[0, 1, 0] == 1


def test_profits_are_costs_below_zero():
    """x+ = x / 2 + ..., s = -1: both steps earn x."""
    a = kp.optimal_feedback(system([["1/2"]], [[0]]), [-1], [0], [[0]], horizon=2)
    assert a and a.cost == [-1.5] and a.check() and a.certificate.gap == 0
    wide = replace(a.certificate, lower=Matrix(a.certificate.lower.values - 1))
    wide = type(wide).settle(**wide.data())
    assert wide and wide.gap == np.inf and "no relative measure" in wide.explain()


def test_an_unstable_system_has_finite_costs():
    plant = system([[2]], [[0]])
    assert kp.optimal_feedback(plant, [1], [0], [[0]]).status is kp.Status.REFUTED
    a = kp.optimal_feedback(plant, [1], [0], [[0]], horizon=5)
    assert a and a.cost == [31] and "not claimed" in a.explain()
    beyond = kp.optimal_feedback(plant, [1], [0], [[0]], horizon=1100)
    assert beyond.status is kp.Status.UNDECIDED and "fewer steps" in beyond.message and beyond.F is None


def test_groups_disturbances_and_discounts():
    """By the recursion in fractions: m_g = min(0, min y), |G'p| of the adversary, beta in A, B and G."""
    A, B, G = [["1/2", "1/4"], [0, "1/4"]], [[0, "-1/8"], ["1/4", 0]], [["1/8"], [0]]
    s, r, l, m, beta = [1, 2], [Fraction(1), Fraction(-1, 3)], [1, 1], [1, 0], Fraction(1, 2)
    exact = [np.vectorize(Fraction, otypes=[object])(np.array(M, dtype=object)) for M in (A, B, G, s, l, m)]
    p = np.array([Fraction(0)] * 2)
    for _ in range(4):
        y = np.array(r) + beta * p @ exact[1]
        p = exact[3] + beta * p @ exact[0] + min(0, *y) * exact[4] + abs(beta * p @ exact[2])[0] * exact[5]
    a = kp.optimal_feedback(
        system(A, B), s, ["1", "-1/3"], [l], groups=[[0, 1]], disturbance=(G, [m]), discount="1/2", horizon=4
    )
    assert a and (a.certificate.upper.fractions()[0] == p).all() and (a.certificate.lower.fractions()[0] == p).all()
    assert "against every admissible disturbance" in a.explain()


# -- random systems against brute force and the linear program


def discrete_problem(rng):
    while True:
        sys, s, r, L = random_problem(rng)
        if sys.dt:
            return sys, s, r, L


def cheapest_sequence(sys, s, r, L, steps, last, x):
    """The least cost from x over all sequences of policies u_i = -l_i'x or l_i'x."""
    if steps == 0:
        return last @ x
    return min(
        s @ x + r @ u + cheapest_sequence(sys, s, r, L, steps - 1, last, sys.A @ x + sys.B @ u)
        for u in (np.array(signs) * (L @ x) for signs in itertools.product((1, -1), repeat=sys.ninputs))
    )


def least_cost_by_program(sys, s, r, L, steps, last, x):
    """The least cost from x over all sequences of inputs with |u_i| <= l_i'x."""
    n, m = sys.B.shape
    width = n + m  # x_k, u_k for k < N, then x_N
    size, eye = steps * width + n, np.eye(n)
    cost, equal, below = np.concatenate([np.tile(np.concatenate([s, r]), steps), last]), [], []
    for k in range(steps):
        row = np.zeros((n, size))
        row[:, k * width : (k + 1) * width] = np.hstack([sys.A, sys.B])
        row[:, (k + 1) * width : (k + 1) * width + n] -= eye
        equal.append(row)
        for sign in (1, -1):
            side = np.zeros((m, size))
            side[:, k * width : (k + 1) * width] = np.hstack([-L, sign * np.eye(m)])
            below.append(side)
    first = np.zeros((n, size))
    first[:, :n] = eye
    A_eq, b_eq = np.vstack([first, *equal]), np.concatenate([x, np.zeros(steps * n)])
    out = linprog(cost, np.vstack(below), np.zeros(2 * m * steps), A_eq, b_eq, (None, None))
    assert out.status == 0
    return out.fun


@pytest.mark.parametrize("seed", range(40))
def test_no_inputs_are_cheaper(seed):
    rng = np.random.default_rng(seed)
    sys, s, r, L = discrete_problem(rng)
    steps = int(rng.integers(1, 4 if sys.ninputs < 3 else 3))
    last = None if seed % 3 == 0 else rng.normal(size=sys.nstates)
    a = kp.optimal_feedback(sys, s, r, L, horizon=steps, terminal_cost=last)
    assert a and a.check()
    last = np.zeros(sys.nstates) if last is None else last
    for weights in rng.random((3, sys.X.n_rays)):
        x = weights @ np.asarray(sys.X.rays)
        size = np.abs(a.cost) @ np.abs(x)
        low, high = (b @ x for b in a.cost_bounds)
        assert high - low <= 1e-12 * size
        assert cheapest_sequence(sys, s, r, L, steps, last, x) == pytest.approx(low, abs=1e-9 * size)
        assert least_cost_by_program(sys, s, r, L, steps, last, x) == pytest.approx(low, abs=1e-6 * size)
        # and the gains reach it
        spent, state = 0.0, x
        for F in a.F:
            spent, state = spent + s @ state + r @ F @ state, (sys.A + sys.B @ F) @ state
        assert spent + last @ state == pytest.approx(high, abs=1e-9 * size)


@pytest.mark.parametrize("seed", range(10))
def test_many_steps_cost_as_much_as_all(seed):
    """Without a terminal cost the cost rises with the steps, to that of all of them."""
    rng = np.random.default_rng(seed)
    while not (a := kp.optimal_feedback(*(problem := discrete_problem(rng)))):
        pass
    R, before = np.asarray(problem[0].X.rays), 0.0
    for steps in (1, 4, 16, 64, 256):
        b = kp.optimal_feedback(*problem, horizon=steps)
        low, high = (R @ bound for bound in b.cost_bounds)
        assert b and (high >= before * (1 - 1e-12)).all() and (low <= R @ a.cost_bounds[1]).all()
        before = low
    pace = np.abs(np.linalg.eigvals(a.closed_loop.A)).max()
    np.testing.assert_allclose(before, R @ a.cost, rtol=max(1e-9, 1e3 * pace**256))


def test_long_fractions_are_rounded_to_the_safe_side():
    A, B, L = [["1/3", "1/7"], ["1/11", "2/9"]], [["1/13"], ["-1/17"]], [["1/19", "1/23"]]
    costs = recursion(A, B, [1, "1/29"], ["1/31"], L, 150)
    a = kp.optimal_feedback(system(A, B), [1, "1/29"], ["1/31"], L, horizon=150)
    assert a and a.check() and 0 < a.certificate.gap < 1e-11 and "at most" in a.explain()
    lower, upper = (M.fractions() for M in (a.certificate.lower, a.certificate.upper))
    exact = np.array(costs[:-1])
    assert (lower <= exact).all() and (exact <= upper).all()
    assert (lower[-1] == exact[-1]).all() and (lower[0] < upper[0]).any()


def test_scales_change_no_bound():
    """States in units of 2^-300 and 2^300: the bounds stay as close."""
    A, B, L = [["1/3", "1/7"], ["1/11", "2/9"]], [["1/13"], ["-1/17"]], [["1/19", "1/23"]]
    unit = [Fraction(2) ** 300, Fraction(1, 2**300)]

    def scaled(M, left, right):
        return [[Fraction(a) * left[i] * right[j] for j, a in enumerate(row)] for i, row in enumerate(M)]

    inverse = [1 / c for c in unit]
    plant = system(scaled(A, unit, inverse), scaled(B, unit, [1]))
    s = [Fraction(1) / unit[0], Fraction(1, 29) / unit[1]]
    a = kp.optimal_feedback(plant, s, ["1/31"], scaled(L, [1], inverse), horizon=150)
    b = kp.optimal_feedback(system(A, B), [1, "1/29"], ["1/31"], L, horizon=150)
    assert a and a.certificate.gap < 1e-10
    np.testing.assert_allclose([float(c * Fraction(p)) for c, p in zip(unit, a.cost, strict=True)], b.cost, rtol=1e-10)


# -- predictive control


@pytest.mark.parametrize("seed", range(20))
def test_a_terminal_cost_that_falls_makes_every_horizon_stable(seed):
    """q - T_c(q) in X* for some policy c: costs fall with the horizon, and the first gain for ever at most q'x."""
    rng = np.random.default_rng(seed)
    while not (a := kp.optimal_feedback(*(problem := discrete_problem(rng)))):
        pass
    sys, s, r, L = problem
    R, n = np.asarray(sys.X.rays), sys.nstates
    q = a.cost_bounds[1]
    for signs in itertools.product((1, -1), repeat=sys.ninputs):  # the dearest stable policy
        loop = sys.A + sys.B @ (F := np.array(signs)[:, None] * L)
        if np.abs(np.linalg.eigvals(loop)).max() < 0.999:
            other = np.linalg.solve((np.eye(n) - loop).T, s + F.T @ r) * (1 + 1e-9)
            q = other if (R @ (other - q) >= 0).all() else q
    before = R @ q
    for steps in (1, 2, 5):
        b = kp.optimal_feedback(*problem, horizon=steps, terminal_cost=q)
        assert b and (R @ b.cost <= before * (1 + 1e-12)).all()
        before = R @ b.cost
        F = b.F[0]
        assert np.abs(np.linalg.eigvals(b.closed_loop.A)).max() < 1
        forever = np.linalg.solve((np.eye(n) - b.closed_loop.A).T, s + F.T @ r)
        assert (R @ forever <= R @ q * (1 + 1e-9)).all() and (R @ forever >= R @ a.cost * (1 - 1e-9)).all()


def test_the_optimal_cost_as_terminal_cost_gives_the_optimal_gain_at_every_step():
    a = kp.optimal_feedback(seed_plant(), **SEED_COST)
    b = kp.optimal_feedback(seed_plant(), **SEED_COST, horizon=4, terminal_cost=a.cost_bounds[1])
    assert (b.F == a.F).all()
    np.testing.assert_allclose(b.cost, a.cost, rtol=1e-9)


def test_predictive_control_with_a_limit_of_its_own():
    """u <= 1 as well, by a linear program at every step: each is feasible, and the planned cost falls by each stage."""
    plant, s, r, L = system([[1.1, 0.2], [0, 1.05]], [[-0.5, 0], [0, -0.5]]), [1.0, 1.0], [0.1, 0.1], 0.8 * np.eye(2)
    groups = [[0], [1]]  # inputs that are not negative
    a = kp.optimal_feedback(plant, s, r, L, groups=groups)
    assert a and (a.F >= 0).all()
    q, x, steps, paid = a.cost_bounds[1], np.array([1.8, 1.5]), 6, []
    A, B = plant.A, plant.B

    def plan(x):
        """x_k = A^k x + ..., in terms of u; u_k <= 0.8 x_k, u_k <= 1, and at the end F x_N <= 1."""
        states, inputs = [(x, np.zeros((2, 2 * steps)))], np.eye(2 * steps).reshape(steps, 2, 2 * steps)
        for k in range(steps):
            here, by = states[-1]
            states.append((A @ here, A @ by + B @ inputs[k]))
        cost = q @ states[-1][1] + sum(s @ by + r @ inputs[k] for k, (_, by) in enumerate(states[:-1]))
        fixed = q @ states[-1][0] + sum(np.dot(s, here) for here, _ in states[:-1])
        rows = [inputs[k] - L @ by for k, (_, by) in enumerate(states[:-1])] + [a.F @ states[-1][1]]
        bounds = [L @ here for here, _ in states[:-1]] + [np.ones(2) - a.F @ states[-1][0]]
        out = linprog(cost, np.vstack(rows), np.concatenate(bounds), bounds=(0, 1))
        assert out.status == 0
        return out.fun + fixed, out.x[:2]

    for _ in range(30):
        value, u = plan(x)
        paid.append((value, np.dot(s, x) + np.dot(r, u)))
        x = A @ x + B @ u
    assert all(after <= value - stage + 1e-6 for (value, stage), (after, _) in itertools.pairwise(paid))
    assert np.abs(x).max() < 1e-2 and sum(stage for _, stage in paid) <= paid[0][0] + 1e-6


# -- networks


def by_route(route, sys, s, r, limits, controls, steps, last, **more):
    given = {"groups": None, "use_all": False, "disturbance": None, "discount": None} | more
    found = route(Question(s, r, limits, **given), sys, None, controls)
    return within(None, lambda lp: planned(found, read_horizon(found, steps, last, sys), lp), answer=OptimalFeedback)


@pytest.mark.parametrize("seed", range(20))
def test_the_sparse_and_the_dense_route_agree(seed):
    rng = np.random.default_rng(seed)
    while not (problem := random_network(rng))[0].isdtime(strict=True):
        pass
    net, s, r, L, controls = problem
    n, more, last = net.nstates, {}, None
    if seed % 4 == 1:
        last = rng.normal(size=n)
    if seed % 4 == 2:
        more = {"disturbance": (1e-3 * rng.normal(size=(n, 1)), 1e-3 * np.asarray(net.X.facets).sum(axis=0)[None])}
    if seed % 4 == 3:
        more = {"discount": 0.5}
    a = by_route(system_route, net, s, r, L, controls, 4, last, **more)
    b = by_route(network_route, net, s, r, sp.csr_array(L), sp.csr_array(controls), 4, last, **more)
    assert a.status is b.status and a.message == b.message
    if a:
        assert b.check() and len(b.F) == 4 and all(sp.issparse(F) for F in (*b.F, *b.K))
        R = np.asarray(net.X.rays)
        np.testing.assert_allclose(R @ b.cost, R @ a.cost, atol=1e-9 * np.abs(R @ a.cost).max())
        for low, high in ((a.cost_bounds[0], b.cost_bounds[1]), (b.cost_bounds[0], a.cost_bounds[1])):
            assert (R @ low <= R @ high + 1e-15 * np.abs(R) @ np.abs(high)).all()
        loop = net.A + net.B @ controls @ b.F[0].toarray()
        np.testing.assert_allclose(b.closed_loop.A, loop, atol=1e-12 * np.abs(loop).max())


def test_a_large_network_goes_step_by_step():
    problem = transport(2000)
    a, b = kp.optimal_feedback(**problem), kp.optimal_feedback(**problem, horizon=200)
    assert b and b.certificate.gap < 1e-9 and len(b.F) == 200
    np.testing.assert_allclose(b.cost, a.cost, rtol=1e-3)
    assert (b.cost_bounds[0] <= a.cost_bounds[1]).all()
    c = kp.optimal_feedback(**problem, horizon=2, terminal_cost=a.cost_bounds[1])
    np.testing.assert_allclose(c.cost, a.cost, rtol=1e-9)
    continuous = transport(500, discrete=False)
    with pytest.raises(DataError, match="discrete time"):
        kp.optimal_feedback(**continuous, horizon=2)


@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_certificates_of_networks_are_files(suffix, tmp_path):
    a = kp.optimal_feedback(**transport(30), horizon=3)
    assert a and isinstance(a.F, tuple)
    a.save(tmp_path / f"plan.{suffix}")
    assert kp.load_certificate(tmp_path / f"plan.{suffix}") == a.certificate
    if suffix == "json":
        assert checker.main(tmp_path / "plan.json") == 0


def test_forged_certificates_of_networks_prove_nothing():
    c = kp.optimal_feedback(**transport(30), horizon=3).certificate
    assert c.check()
    wrong = np.where(np.arange(90) == 7, -c.policies[1], c.policies[1])
    for change in (
        {"lower": Matrix(c.lower.values * (1 + 1e-6))},
        {"upper": Matrix(c.upper.values * (1 - 1e-6))},
        {"policies": np.array([c.policies[0], wrong, c.policies[2]])},
        {"terminal": Matrix(np.ones((1, 30)))},
    ):
        assert not replace(c, **change).check(), change.keys()


def test_a_step_is_let_go_of_before_the_next_one():
    """What a step adds to a proof of 2000 nodes: its numbers and their sizes, not its matrices."""
    peaks = []
    for steps in (4, 16):
        c = kp.optimal_feedback(**transport(2000), horizon=steps).certificate
        tracemalloc.start()
        assert c.check()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 12 * 6 * 2000 * 8


def test_the_first_step_that_is_not_proven_ends_a_proof():
    c = kp.optimal_feedback(**transport(30), horizon=3).certificate
    low = c.lower.values.copy()
    low[1] *= 1.001
    forged = replace(c, lower=Matrix(low))
    assert not forged.check() and 0 < len(forged.conditions()) < len(c.conditions())
    assert forged.conditions()[-1].verdict() is not True and forged.conditions()[-1].margin < 0
    assert all(condition.verdict() for condition in c.conditions()) and abs(c.conditions()[-1].margin) < 1e-9


# -- certificates that fail, refusals, wrong arguments


def test_forged_certificates_prove_nothing():
    c = kp.optimal_feedback(seed_plant(), **SEED_COST, horizon=3).certificate
    assert c.check() and c.refutation() is None
    tiny = Fraction(1, 10**30)
    lower, upper = c.lower.fractions(), c.upper.fractions()
    for change in (
        {"lower": Matrix.from_fractions(lower + tiny)},
        {"upper": Matrix.from_fractions(upper - tiny)},
        {"lower": c.lower[:2]},
        {"policies": c.policies[:2]},
        {"policies": -c.policies},
        {"policies": 2 * c.policies},
        {"policies": c.policies[0]},
        {"policies": c.policies.astype(float)},
        {"terminal": Matrix(np.array([[0.0, 1e-9]]))},
        {"terminal": Matrix(np.array([[0.0, np.nan]]))},
        {"problem": replace(c.problem, s=Matrix(np.array([[3.0, 1.1]])))},
        {"problem": replace(c.problem, discrete=False, discount=Fraction(0))},
        {"witness": "none"},
    ):
        assert not replace(c, **change).check(), change.keys()
    assert "Undecided" in type(c).settle(**{**c.data(), "policies": -c.policies}).explain()


def test_inputs_that_leave_the_cone_are_named():
    a = kp.optimal_feedback(system([[0.2]], [[0.5]]), [1], [0], [[1]], horizon=2)
    assert a.status is kp.Status.UNDECIDED and "inputs 0 may push x out of X" in a.message


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"horizon": 0}, DataError, "at least 1"),
        ({"horizon": 2.5}, DataError, "whole number"),
        ({"terminal_cost": [1, 2]}, ShapeError, r"terminal_cost has shape \(2,\); it must be \(1,\)"),
        ({"terminal_cost": [np.nan]}, DataError, "terminal_cost"),
        ({"horizon": None, "terminal_cost": [1]}, DataError, "give horizon="),
        ({"limits": [[-1]]}, DataError, r"limits\[0\] is negative at generator 0"),
        ({"sys": system([[-1]], [[0.25]], False)}, DataError, "sample it first"),
    ],
)
def test_wrong_arguments(changes, error, message):
    data = {"sys": system([["3/4"]], [["1/4"]]), "s": [1], "r": [0], "limits": [[0.5]], "horizon": 2} | changes
    with pytest.raises(error, match=message):
        kp.optimal_feedback(**data)


def test_a_time_limit_ends_it():
    a = kp.optimal_feedback(seed_plant(), **SEED_COST, horizon=3, time_limit=1e-9)
    assert a.status is kp.Status.UNDECIDED and a.F is None
