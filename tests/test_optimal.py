"""Optimal control with linear cost: the published equation, linear programs, brute force, forged certificates."""

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import control_kpos as kp
from control_kpos import checker
from control_kpos.design.optimal import policies
from control_kpos.design.optimal.certificate import GrowingCost
from control_kpos.design.optimal.policies import by_linear_program
from control_kpos.errors import DataError, ShapeError
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.programs import solve

SEED = kp.PolyhedralCone([[0, 1], [1, -2]])


def system(A, B, discrete=True, X=None):
    n, m = np.shape(B)
    return kp.ConeStateSpace(A, B, np.eye(n), np.zeros((n, m)), discrete, X=X)


def seed_plant():
    return system([["0.7", "0.1"], ["-0.2", "0.3"]], [[0], ["0.2"]], X=SEED)


# -- worked examples


def test_the_example_on_a_skewed_cone():
    """p = (6, 5/3) solves p = s + A'p - |r + B'p| l, and u = -(2, 1) x."""
    a = kp.optimal_feedback(seed_plant(), s=[3, 1], r=["0.1"], limits=[[2, 1]])
    assert a and a.check() and a.iterations <= 10
    np.testing.assert_array_equal(a.F, [[-2, -1]])
    np.testing.assert_array_equal(a.K, [[2, 1]])
    p, rays = [6, Fraction(5, 3)], [[0, 1], [1, -2]]
    for ray in rays:
        exact = sum(Fraction(c) * x for c, x in zip(p, ray, strict=True))
        low, high = (sum(Fraction(c) * x for c, x in zip(b, ray, strict=True)) for b in a.cost_bounds)
        assert low <= exact <= high and high - low <= exact / 10**9
    assert np.abs(a.closed_loop.poles()).max() == pytest.approx(0.573, abs=1e-3)
    assert a.closed_loop.X == SEED


def test_shortest_paths():
    """Edges 1-2 (1), 1-3 (5), 2-3 (2), 3-target (1): the distances are 4, 3, 1."""
    edges = [(0, 1, 1), (0, 2, 5), (1, 2, 2), (2, None, 1)]
    B = np.zeros((3, 4))
    for k, (_, to, _) in enumerate(edges):
        if to is not None:
            B[to, k] = 1
    groups = [[k for k, edge in enumerate(edges) if edge[0] == j] for j in range(3)]
    lengths = [edge[2] for edge in edges]
    a = kp.optimal_feedback(system(np.zeros((3, 3)), B), [0] * 3, lengths, np.eye(3), groups=groups, use_all=True)
    assert a and np.allclose(a.cost, [4, 3, 1], rtol=1e-9)
    np.testing.assert_array_equal(a.F, [[1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1]])


def test_a_group_may_do_nothing():
    """x+ = x / 2 + ...: costs 2 without input, and the dearer column is left alone."""
    a = kp.optimal_feedback(system([["1/2"]], [[0, "-1/4"]]), [1], [1, "1/4"], [[1]], groups=[[0, 1]])
    assert a and not a.F[0].any() and a.F[1] == 1  # s + r = 5/4 over 3/4 is 5/3, less than 2
    assert a.cost == pytest.approx(5 / 3)
    dear = kp.optimal_feedback(system([["1/2"]], [[0, "-1/4"]]), [1], [1, "3/4"], [[1]], groups=[[0, 1]])
    assert dear and not dear.F.any() and dear.cost == pytest.approx(2)


def test_a_disturbance_that_maximises():
    """x+ = 3/4 x + u / 4 + w / 8: p = 1 + (3/4 - 1/4 + 1/8) p."""
    plant = system([["3/4"]], [["1/4"]])
    a = kp.optimal_feedback(plant, [1], [0], [[1]], disturbance=([["1/8"]], [[1]]))
    assert a and a.cost == pytest.approx(8 / 3) and "against every admissible disturbance" in a.explain()
    assert not replace(a.certificate, upper=0.99 * a.certificate.upper).check()


@pytest.mark.parametrize(("discrete", "discount", "cost"), [(True, "1/2", 4 / 3), (False, "1/2", 2 / 3)])
def test_discounts(discrete, discount, cost):
    """p = s + beta a p in discrete time, 0 = s + (a - rho) p in continuous time; a = 1/2 and -1."""
    a = kp.optimal_feedback(
        system([["1/2"]] if discrete else [[-1]], [[0]], discrete), [1], [0], [[1]], discount=discount
    )
    assert a and a.cost == pytest.approx(cost) and "exponentially stable" not in a.explain()


def test_a_control_that_moves_between_nodes_of_a_network():
    """Two tanks that leak at 1/2 and 1/4; what is moved from the second to the first leaks sooner."""
    tanks = [kp.ConeStateSpace([[leak]], [[1]], [[1]], 0) for leak in (-0.5, -0.25)]
    net = kp.feedback_interconnect(tanks, np.zeros((2, 2)))
    a = kp.optimal_feedback(net, s=[1, 1], r=[0], limits=[[0, 0.5]], controls=[[1], [-1]], groups=[[0]])
    assert a and np.array_equal(a.F, [[0, 0.5]])
    np.testing.assert_allclose(a.cost, [2, 1 / 0.75 + 2 * 0.5 / 0.75])  # (1 + p_1 / 2) / (1/4 + 1/2)
    assert a.closed_loop.ninputs == 1 and a.closed_loop.A[0, 1] == 0.5 and a.closed_loop.A[1, 1] == -0.75


# -- random systems against brute force and the linear program


def random_cone(rng, n):
    kind = int(rng.integers(3))
    if kind == 0 or n == 1:
        return kp.orthant(n)
    if kind == 1 or n == 2:
        while np.linalg.cond(T := rng.normal(size=(n, n))) > 30:
            pass
        return kp.PolyhedralCone(T)
    sides = rng.normal(size=(n + 3, n - 1))
    sides = np.vstack([sides, -sides[:2]]) / np.linalg.norm(np.vstack([sides, sides[:2]]), axis=1)[:, None]
    return kp.PolyhedralCone(np.hstack([sides, np.full((len(sides), 1), 1.2)]))


def random_problem(rng):
    """A system for which every admissible input keeps X and every stage costs something, most with a finite cost."""
    n, m, discrete = int(rng.integers(1, 5)), int(rng.integers(1, 4)), bool(rng.integers(2))
    X = random_cone(rng, n)
    R, H = np.asarray(X.rays), np.asarray(X.facets)
    M = sum(rng.random() * np.outer(R[rng.integers(len(R))], H[rng.integers(len(H))]) for _ in range(6))
    M = M + 0.3 * np.outer(R.sum(axis=0), H.sum(axis=0))
    M /= np.abs(np.linalg.eigvals(M)).max()
    A = M * rng.uniform(0.5, 1.15) if discrete else M - np.eye(n) * rng.uniform(0.7, 1.5)
    B, L = rng.normal(size=(n, m)), np.abs(rng.normal(size=(m, len(H)))) @ H
    pushed, free = np.einsum("hm,km->hk", np.abs(H @ B), R @ L.T), H @ A @ R.T
    where = (pushed > 1e-12) & (np.ones(free.shape, dtype=bool) if discrete else X.incidence.astype(bool))
    L = L * min(2, 0.999 * (free[where] / pushed[where]).min(initial=2))
    s, r = np.abs(rng.normal(size=len(H))) @ H, 0.2 * rng.normal(size=m)
    return system(A, B, discrete, X), s, r * min(1, 0.9 * (R @ s / ((R @ L.T) @ np.abs(r))).min()), L


def cheapest_policy(sys, s, r, L):
    """The least cost, from the sum of the generators, over all 2^m policies whose loop is stable; inf if none is."""
    out, x, n = np.inf, np.asarray(sys.X.rays).sum(axis=0), sys.nstates
    for signs in itertools.product((1, -1), repeat=sys.ninputs):
        F = np.array(signs)[:, None] * L
        loop = sys.A + sys.B @ F
        poles = np.linalg.eigvals(loop)
        if (np.abs(poles).max() < 1) if sys.dt else (poles.real.max() < 0):
            out = min(out, x @ np.linalg.solve((np.eye(n) * bool(sys.dt) - loop).T, s + F.T @ r))
    return out


@pytest.mark.parametrize("seed", range(4))
def test_no_policy_is_cheaper_and_the_program_agrees(seed):
    rng, proved = np.random.default_rng(seed), 0
    for _ in range(50):
        sys, s, r, L = random_problem(rng)
        a, best = kp.optimal_feedback(sys, s, r, L), cheapest_policy(sys, s, r, L)
        x = np.asarray(sys.X.rays).sum(axis=0)
        if a.status is kp.Status.REFUTED:
            assert best == np.inf and a.check()
            continue
        assert a and a.check() and a.iterations <= 10
        low, high = (b @ x for b in a.cost_bounds)
        assert low * (1 - 1e-9) <= best <= high * (1 + 1e-9) and high - low <= 1e-6 * high
        assert by_linear_program(a.certificate.problem, solve) @ x == pytest.approx(best, rel=1e-6)
        proved += 1
    assert proved > 35


# -- certificates that fail, refusals, wrong arguments


def test_forged_certificates_prove_nothing():
    c = kp.optimal_feedback(seed_plant(), s=[3, 1], r=["0.1"], limits=[[2, 1]]).certificate
    assert c.check()
    forged = [
        {"lower": c.lower * 1.001},
        {"upper": c.upper * 0.999},
        {"policy": np.array([1])},
        {"policy": np.array([2])},
        {"policy": np.array([-1, 0])},
        {"policy": None},
        {"policy": np.array([-0.5])},
        {"problem": replace(c.problem, s=Matrix(np.array([[0.1, 0.1]])))},
    ]
    for change in forged:
        assert not replace(c, **change).check(), change


@pytest.mark.parametrize(
    "change",
    [
        {"discount": Fraction(2)},
        {"discount": True},
        {"discrete": 2},
        {"kinds": np.array([3])},
        {"owner": np.array([1])},
        {"s": Matrix(np.ones((1, 3)))},
    ],
)
def test_certificates_about_no_problem_are_refused(change):
    c = kp.optimal_feedback(seed_plant(), s=[3, 1], r=["0.1"], limits=[[2, 1]]).certificate
    with pytest.raises(DataError):
        replace(c, problem=replace(c.problem, **change))


def test_files_of_cones_with_many_facets_leave_out_the_proof(tmp_path):
    turns = 2 * np.pi * np.arange(400) / 400
    X = kp.PolyhedralCone(np.stack([np.cos(turns), np.sin(turns), np.full(400, 1.5)], axis=1))
    a = kp.optimal_feedback(system(0.5 * np.eye(3), np.zeros((3, 1)), X=X), [0, 0, 1], [0], [[0, 0, 1]])
    assert a and "fractions" in a.certificate.proof()["omitted"]
    a.save(tmp_path / "many.json")
    assert kp.load_certificate(tmp_path / "many.json") and checker.main(tmp_path / "many.json") == 2


def test_infinite_cost_is_refuted_by_a_vector():
    a = kp.optimal_feedback(system([[2, 0], [0, 0.5]], [[0.5], [0]]), [1, 1], [0], [[1, 0]])
    assert a.status is kp.Status.REFUTED and a.check() and "finite cost" in a.explain()
    c = a.certificate
    assert not replace(c, witness=GrowingCost(np.array([0.0, 1.0]))).check()
    assert not replace(c, witness=GrowingCost(np.zeros(2))).check()
    # a discount makes it finite
    assert kp.optimal_feedback(system([[2, 0], [0, 0.5]], [[0.5], [0]]), [1, 1], [0], [[1, 0]], discount="0.6")


@pytest.mark.parametrize("discrete", [False, True])
def test_modes_that_no_input_moves(discrete):
    """Uncontrollable: stable, and the cost is that of the plant; not stable, and no cost is finite."""
    stable, unstable = (0.5, 1.5) if discrete else (-1, 1)
    finite = kp.optimal_feedback(system([[stable]], [[0]], discrete), [1], [0], [[0.5]])
    assert finite and finite.cost == pytest.approx(2 if discrete else 1)
    assert kp.optimal_feedback(system([[unstable]], [[0]], discrete), [1], [0], [[1]]).status is kp.Status.REFUTED


def test_limits_of_zero_leave_the_plant_alone():
    a = kp.optimal_feedback(system([[0.5, 0.1], [0, 0.5]], np.eye(2)), [1, 1], [5, -5], np.zeros((2, 2)))
    assert a and not a.F.any()
    np.testing.assert_allclose(a.cost, np.linalg.solve(np.eye(2) - a.closed_loop.A.T, [1, 1]))


def test_a_start_far_from_any_stable_policy():
    """Neither u = 0 nor the first guess is stable; value iteration leads to a policy that is."""
    rng = np.random.default_rng(0)
    A = np.diag(np.full(6, 0.9)) + 0.05 * rng.random((6, 6))
    B = np.eye(6) * 0.3
    a = kp.optimal_feedback(system(A, B), np.ones(6), np.zeros(6), np.eye(6))
    assert a and np.array_equal(a.F, -np.eye(6)) and np.abs(np.linalg.eigvals(A)).max() > 1


@pytest.mark.parametrize("discrete", [True, False])
def test_the_two_ways_to_a_stable_policy_lead_to_one_optimum(monkeypatch, discrete):
    """Plants that only some policies stabilise: value iteration, and discounts where it takes too long."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        L = rng.uniform(0, 1, (3, 4))
        B = rng.normal(size=(4, 3)) * 0.5
        A = np.abs(B) @ L * 1.05 - (0 if discrete else 1) * np.diag(rng.uniform(0, 1, 4))
        plant = system(A, B, discrete)
        first = kp.optimal_feedback(plant, np.ones(4), np.zeros(3), L)
        with monkeypatch.context() as patch:
            patch.setattr(policies, "_VALUES", 0)
            second = kp.optimal_feedback(plant, np.ones(4), np.zeros(3), L)
        assert first.status is second.status
        if first:
            np.testing.assert_allclose(first.cost, second.cost, rtol=1e-9)


def test_inputs_that_leave_the_cone_are_named():
    a = kp.optimal_feedback(system([[0.2]], [[0.5]]), [1], [0], [[1]])
    assert a.status is kp.Status.UNDECIDED and a.F is None
    assert "inputs 0 may push x out of X, through facet 0 at generator 0. Limits 0.4 times as large" in a.message
    assert kp.optimal_feedback(system([[0.2]], [[0.5]]), [1], [0], [[0.4]])
    assert "without any input" in kp.optimal_feedback(system([[-0.2]], [[0.5]]), [1], [0], [[1]]).message


def test_advice_about_inputs_that_leave_the_cone_is_exact():
    """The limits that are named do; a disturbance is not called an input; inputs that push inwards are not blamed."""
    a = kp.optimal_feedback(system([["1/3"]], [["1/2"]]), [1], [0], [[1]])
    assert "Limits 0.666 times" in a.message
    assert kp.optimal_feedback(system([["1/3"]], [["1/2"]]), [1], [0], [["0.666"]])
    mixed = kp.optimal_feedback(system([["1/2"]], [[0.8, -0.9]]), [1], [0, 0], [[1]], groups=[[0, 1]])
    assert "inputs 1 may push" in mixed.message and "Limits 0.555 times" in mixed.message
    assert "groups" not in mixed.message
    one_way = {"s": [1, 1], "r": [0], "limits": [["0.3", 0]], "controls": [[-1], [1]]}
    both = kp.optimal_feedback(system(np.diag([0.9, 0.5]), np.eye(2)), **one_way)
    assert "give groups= if they are never negative" in both.message
    assert kp.optimal_feedback(system(np.diag([0.9, 0.5]), np.eye(2)), **one_way, groups=[[0]])
    disturbed = kp.optimal_feedback(system([["1/2"]], [["1/4"]]), [1], [0], [[1]], disturbance=([[1]], [[1]]))
    assert "a disturbance may push x out of X" in disturbed.message
    still = kp.optimal_feedback(system([[1, 0], [0, 1]], [[1], [0]]), [1, 1], [0], [[0, 1]])
    assert "set their limits to 0 there" in still.message
    huge = kp.optimal_feedback(system([["1/2", "-1/1" + "0" * 399], [0, "1/2"]], [[0], [0]]), [1, 1], [0], [[0, 0]])
    assert huge.status is kp.Status.UNDECIDED and "without any input" in huge.message


def test_gaps_are_exact():
    X = kp.PolyhedralCone([[1, 1], [1, 1 + 2.0**-40]])
    s = [Fraction(-8, 7), Fraction(8, 7) * (1 + Fraction(1, 2**50))]
    a = kp.optimal_feedback(system([["1/2", 0], [0, "1/2"]], [[0], [0]], X=X), s, [0], [[0, 0]])
    if a:  # the two bounds nearly cancel
        low, high = (
            [sum(map(Fraction.__mul__, map(Fraction, v), map(Fraction, x))) for x in X.rays] for v in a.cost_bounds
        )
        exact = max((b - c) / b for b, c in zip(high, low, strict=True))
        assert Fraction(a.certificate.gap) >= exact
    wide = kp.optimal_feedback(seed_plant(), s=[3, 1], r=["0.1"], limits=[[2, 1]]).certificate
    wide = replace(wide, lower=wide.lower * 0)
    assert wide.gap == 1 and "at most 1 of the upper" in wide.explain()
    assert np.isnan(kp.optimal_feedback(system([[2]], [[0]]), [1], [0], [[0]]).certificate.gap)


def value(plant, s, r, L, w, M, rounds=4000):
    """p by value iteration of the game, discrete time and the orthant."""
    p = np.zeros(len(s))
    for _ in range(rounds):
        p = s + plant.A.T @ p - np.abs(r + plant.B.T @ p) @ L + np.abs(w.T @ p) @ M
    return p


@pytest.mark.parametrize("seed", range(30))
def test_games_are_solved_whichever_player_is_stronger(seed):
    rng = np.random.default_rng(seed)
    n, m, k = rng.integers(1, 5), rng.integers(1, 4), rng.integers(1, 4)
    B, W = rng.normal(size=(n, m)), rng.normal(size=(n, k))
    L, M = rng.random((m, n)), rng.random((k, n)) * rng.choice([0.1, 1, 5])
    A = np.abs(B) @ L + np.abs(W) @ M + 0.1 * rng.random((n, n))
    size = rng.uniform(0.6, 0.95) / np.abs(np.linalg.eigvals(A + np.abs(W) @ M)).max()
    A, L, M = A * size, L * size * 0.999, M * size * 0.999
    s, r = 1 + rng.random(n), np.zeros(m)
    plant = system(A, B)
    a = kp.optimal_feedback(plant, s, r, L, disturbance=(W, M))
    assert a and a.check()
    np.testing.assert_allclose(a.cost, value(plant, s, r, L, W, M), rtol=1e-6)


def test_infinite_cost_against_the_worst_disturbance_only():
    """x+ = 0.9 x + u / 10 + w / 5: without w the cost is finite."""
    a = kp.optimal_feedback(system([["0.9"]], [["0.05"]]), [1], [0], [[1]], disturbance=([["0.2"]], [[1]]))
    assert a.status is kp.Status.REFUTED and a.check() and "against the worst disturbance" in a.explain()


def test_a_vector_on_the_edge_of_the_dual_cone():
    X = kp.PolyhedralCone([[-5, 4], [-4, 5]])
    plant = system([["59/18", "20/9"], ["-20/9", "-23/18"]], [[0], [0]], X=X)
    a = kp.optimal_feedback(plant, ["-1/9", "1/9"], [0], [[0, 0]])
    assert a.status is kp.Status.REFUTED and a.check()


def test_a_stage_that_costs_nothing_bounds_nothing_from_below():
    a = kp.optimal_feedback(system([["3/4"]], [["1/4"]]), [1], [-1], [[1]])  # every p in [0, 4] solves the equation
    assert a.status is kp.Status.UNDECIDED and "raise s" in a.message


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"limits": [[-1]]}, DataError, r"limits\[0\] is negative at generator 0"),
        ({"s": [0.1], "r": [1]}, DataError, r"generator 0 .* inputs 0\. .* less than 0\.2 times"),
        ({"s": [-1]}, DataError, "the cost is negative at generator 0 of X for some admissible input; raise s"),
        ({"s": [1, 2]}, ShapeError, r"must be \(1,\), one number per state of sys"),
        ({"r": [1, 2]}, ShapeError, "one number per input"),
        ({"limits": [[1, 2]]}, ShapeError, "limits"),
        ({"s": [np.nan]}, DataError, r"s\[0\] is nan"),
        ({"r": [[np.nan]]}, DataError, r"r\[0, 0\] is nan"),
        ({"groups": [0]}, DataError, "a list of inputs for each group, or an array"),
        ({"groups": [[0], [0]]}, DataError, "each of the 1 inputs"),
        ({"groups": [[]]}, DataError, "none may be empty"),
        ({"use_all": True}, DataError, "use_all is about groups"),
        ({"controls": [[1], [1]]}, ShapeError, "controls"),
        ({"discount": 1.5}, DataError, "at most 1"),
        ({"discount": 0}, DataError, "discount"),
        ({"disturbance": [[1]]}, ShapeError, "pair"),
        ({"disturbance": ([[1], [2]], [[1]])}, ShapeError, "disturbance G"),
        ({"disturbance": ([[1]], [[-1]])}, DataError, r"disturbance M\[0\] is negative"),
    ],
)
def test_wrong_arguments(changes, error, message):
    data = {"s": [1], "r": [0], "limits": [[0.5]]} | changes
    with pytest.raises(error, match=message):
        kp.optimal_feedback(system([["3/4"]], [["1/4"]]), **data)


def test_a_time_limit_ends_it():
    a = kp.optimal_feedback(seed_plant(), s=[3, 1], r=["0.1"], limits=[[2, 1]], time_limit=1e-9)
    assert a.status is kp.Status.UNDECIDED and a.F is None
