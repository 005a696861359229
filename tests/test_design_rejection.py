"""Disturbance rejection: exact on simplicial cones, by alternation elsewhere; structure, vertices, constraints."""

import cvxpy as cp
import numpy as np
import pytest

import control_kpos as kp
from control_kpos import checker

PAPER = [[0, 1], [1, -2]]
PYRAMID = [[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]]
PUSHED = {"disturbance": ([[0], [1]], [[1, 0]])}
BOTH = {"disturbance": ([[1], [1]], [[1, 0]])}


@pytest.fixture
def plant():
    return kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)


def linf_gain(A, E, G, D=0.0):
    """Of a stable system that is positive from w to z: the largest row sum of the DC gain."""
    return float((np.asarray(D) - np.asarray(G) @ np.linalg.solve(A, np.asarray(E, dtype=float))).sum(axis=1).max())


def test_disturbance_gain_is_the_one_of_the_closed_loop(plant):
    E, G = PUSHED["disturbance"]
    d = kp.state_feedback(plant, X=PAPER, disturbance=(E, G), gain_bound=8)
    assert d and d.check()
    closed = d.closed_loop.A
    true = float((-np.array(G) @ np.linalg.solve(closed, np.array(E)))[0, 0])
    assert true <= d.value and d.value == pytest.approx(true, rel=2e-2)
    assert d.limit == pytest.approx(1 / 12, rel=1e-3)  # |F x_1| <= 8 allows F = (-11, -8): 1 / (1 + 11)


def test_disturbance_without_bound_says_so(plant):
    d = kp.state_feedback(plant, X=PAPER, disturbance=([[0], [1]], [[1, 0]]))
    assert d.status is kp.Status.UNDECIDED and "gain_bound" in d.message


def test_gain_bounds_of_zero_beside_constraints_of_the_users_own():
    sys = kp.ConeStateSpace([[-2, 1], [1, -2]], np.eye(2), np.eye(2), np.zeros((2, 2)))
    for asked in {}, PUSHED, {"vertices": [(sys.A, sys.B), (0.9 * sys.A, sys.B)]}:
        d = kp.state_feedback(sys, constraints=lambda F: [F[0, 0] <= -0.5], gain_bound=[1, 0], **asked)
        assert d and d.check() and d.F[0, 0] <= -0.5 + 1e-6 and not d.F[1].any()
        none = kp.state_feedback(sys, constraints=lambda F: [F[0, 0] <= 1], gain_bound=0, **asked)
        assert none and not none.F.any()


def test_disturbance_that_leaves_the_cone_is_refuted(plant):
    d = kp.state_feedback(plant, X=PAPER, disturbance=([[-1], [0]], [[1, 0]]), gain_bound=8)
    assert d.status is kp.Status.REFUTED and d.check()


@pytest.mark.parametrize("method", ["auto", "alternation"])
def test_patterns_that_follow_the_blocks(method):
    """x1' = x1 (1 + f) + x2 + w without the second entry of F: gain 1 / (f - 1 - 1/3) (1 + 1/3)."""
    sys = kp.ConeStateSpace([[1, 1], [1, -3]], [[1], [0]], np.eye(2), np.zeros((2, 1)))
    d = kp.state_feedback(sys, structure=[[True, False]], gain_bound=8, method=method, **BOTH)
    assert d and d.check() and d.F[0, 1] == 0
    best = linf_gain([[-7, 1], [1, -3]], *BOTH["disturbance"])
    assert best <= d.value <= 1.002 * best
    assert np.isnan(d.limit) if method == "alternation" else 0.999 * best <= d.limit <= best


def test_patterns_within_a_block():
    """The cone mixes x1 and x2, so that F = (f, 0) is no pattern of F T."""
    A, B, X = np.array([[-1.0, 0], [1, -2]]), np.eye(2), [[1, 0], [1, 1]]
    sys = kp.ConeStateSpace(A, B, np.eye(2), np.zeros((2, 2)), X=X)
    d = kp.state_feedback(sys, structure=[[1, 0], [0, 1]], gain_bound=2, disturbance=([[1], [0]], [[1, -1]]))
    assert d and d.check() and d.F[0, 1] == d.F[1, 0] == 0 and np.isnan(d.limit)
    assert linf_gain(A + B @ d.F, [[1], [0]], [[1, -1]]) <= d.value
    assert d.value < linf_gain(A, [[1], [0]], [[1, -1]])


@pytest.mark.parametrize("method", ["auto", "alternation"])
def test_vertices_share_one_bound(method):
    vertices = [([[1, 1], [1, -3]], [[1], [0]]), ([[0.5, 1], [1, -4]], [[1], [0]])]
    sys = kp.ConeStateSpace(*vertices[0], np.eye(2), np.zeros((2, 1)))
    d = kp.state_feedback(sys, vertices=vertices, gain_bound=8, method=method, **BOTH)
    true = [linf_gain(np.array(A) + np.array(B) @ d.F, *BOTH["disturbance"]) for A, B in vertices]
    assert d and d.check() and max(true) <= d.value <= 1 / 7 * 1.002
    assert "by one x for all vertices" in d.objective
    bounds = [part for part in d.certificate.others if hasattr(part, "gamma")]
    assert len(bounds) == 2 and (bounds[0].x == bounds[1].x).all()
    assert d.explain().count("the L-infinity gain from w to z is below") == 1
    if method == "auto":
        assert 1 / 7 * 0.999 <= d.limit <= 1 / 7


def test_vertices_in_discrete_time():
    vertices = [([[0.5, 0.2], [0.3, 0.9]], [[0], [1]]), ([[0.4, 0.2], [0.3, 0.8]], [[0], [1]])]
    sys = kp.ConeStateSpace(*vertices[0], np.eye(2), np.zeros((2, 1)), 1)
    d = kp.state_feedback(sys, vertices=vertices, gain_bound=0.5, **BOTH)
    for A, B in vertices:
        loop = np.array(A) + np.array(B) @ d.F
        assert (loop >= 0).all() and linf_gain(loop - np.eye(2), *BOTH["disturbance"]) <= d.value


@pytest.mark.parametrize("seed", range(12))
def test_the_alternation_reaches_the_optimum_where_that_is_known(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.uniform(0, 1, (3, 3)) - 2 * np.eye(3) * rng.uniform(), rng.uniform(0, 1, (3, 1))
    sys = kp.ConeStateSpace(A, B, np.eye(3), np.zeros((3, 1)))
    asked = {"disturbance": (np.ones((3, 1)), rng.uniform(0, 1, (1, 3))), "gain_bound": 3}
    d, e = kp.state_feedback(sys, **asked), kp.state_feedback(sys, method="alternation", **asked)
    assert d.status is e.status
    if d:
        assert e.check() and d.limit <= e.value <= 1.01 * d.value
        assert linf_gain(e.closed_loop.A, *asked["disturbance"]) <= e.value


@pytest.mark.parametrize("seed", range(40))
def test_the_alternation_reaches_the_optimum_where_inputs_act_on_outputs(seed):
    """H != 0, one output or two: next to the optimum of the one-shot program (0 in some cases, without a limit)."""
    rng = np.random.default_rng(seed)
    (n, m, q), discrete = rng.integers(1, [4, 3, 3]), bool(seed % 2)
    A = rng.integers(0, 4, size=(n, n)) / (8.0 if discrete else 2.0)
    B, E = rng.integers(-1, 3, size=(n, m)), rng.integers(0, 3, size=(n, 1))
    asked = {"disturbance": (E, rng.integers(0, 3, size=(q, n)), rng.integers(-2, 2, size=(q, m))), "gain_bound": 3}
    sys = kp.ConeStateSpace(A, B, np.eye(n), 0, discrete)
    d, e = kp.state_feedback(sys, **asked), kp.state_feedback(sys, method="alternation", **asked)
    if d and e:
        assert e.check() and not e.value < d.limit and e.value <= 1.0005 * d.value + 1e-5


@pytest.mark.parametrize("discrete", [False, True])
def test_inputs_that_act_on_the_output_against_its_closed_form(discrete):
    """x' = (1 + f) x + w, z = (1 - f) x: gain (1 - f) / -(1 + f), or (1 - f) / -f, falls as f does."""
    sys = kp.ConeStateSpace([[1]], [[1]], [[1]], 0, discrete)
    asked = {"disturbance": ([[1]], [[1]], [[-1]]), "method": "alternation"}
    best = 2.0  # at f = -3, and at f = -1 in discrete time, where positivity asks 1 + f >= 0
    d = kp.state_feedback(sys, gain_bound=3, **asked)
    assert d and d.check() and best <= d.value <= 1.0015 * best
    least = -0.75 if discrete else -2.5
    d = kp.state_feedback(sys, constraints=lambda F: [least <= F], **asked)
    best = (1 - least) / -(least + (not discrete))
    assert d and d.check() and d.F.item() >= least - 1e-6 and 0.9999 * best <= d.value <= 1.002 * best


@pytest.mark.parametrize("method", ["auto", "alternation"])
@pytest.mark.parametrize("rate", [0, 0.5, 1, "5/2"])
def test_a_decay_rate_leaves_the_gain_as_it_is(method, rate):
    """x' = (f - 1) x + w with f = -2: gain 1/3 at any rate below 3, which the gain of (A + rate I, E, G) is not."""
    sys = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)
    d = kp.state_feedback(sys, gain_bound=2, rate=rate, method=method, disturbance=([[1]], [[1]]))
    assert d and d.check() and 1 / 3 <= d.value <= 1.002 / 3 and d.decay_rate >= 2.5
    assert np.isnan(d.limit) if method == "alternation" else 0.999 / 3 <= d.limit <= 1 / 3


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 3e-4])
def test_the_gain_is_within_the_gap_of_the_smallest_also_with_a_rate(gap):
    """Published: 3.7416 (Miller et al., CDC 2023); the smallest is 3.7366548, and its loop decays faster than 0.1."""
    sys = kp.ConeStateSpace(
        [[-0.2, 0.2, 0.2], [0.4, -0.7, 0.2], [0, 0.8, -3]], [[-0.4, 0.5], [0.2, -0.8], [-1, 2]], np.eye(3), 0
    )
    z = np.vstack([np.eye(3), np.zeros((2, 3))]), np.vstack([np.zeros((3, 2)), np.eye(2)])
    for rate in (0, 0.1):
        d = kp.state_feedback(sys, rate=rate, gap=gap, disturbance=(np.eye(3, 2), *z))
        assert d and d.check() and d.decay_rate >= rate and 3.7366 < d.value < 3.7366548 * (1 + gap)
        assert d.limit > 3.7366548 * (1 - 1.1e-4)


def test_a_family_decays_as_fast_as_its_best_common_vector():
    A = np.array([[-1, 0.5, 0], [0, 0.2, 0.3], [0.1, 0, -0.5]])
    sys = kp.ConeStateSpace(A, np.eye(3, 2), np.eye(3), 0)
    pair = [(A, sys.B), (1.01 * A, sys.B)]
    d = kp.state_feedback(sys, gain_bound=2, vertices=pair, disturbance=([[1], [0], [1]], [[0, 1, 0]]))
    assert d and d.check() and d.decay_rate > 0.1


@pytest.mark.parametrize("method", ["auto", "alternation"])
def test_limits_hold_where_the_rate_asks_for_more(method):
    """x1' = -3 x1 - f x2, x2' = (f - 1) x2 + w, z = x1 + w: f = 0 has gain 1; rate 2 takes f = -1."""
    A, B = np.diag([-3.0, -1]), [[-1], [1]]
    sys = kp.ConeStateSpace(A, B, np.eye(2), np.zeros((2, 1)))
    asked = {"disturbance": ([[0], [1]], [[1, 0]], [[0]], [[1]]), "gain_bound": 4, "structure": [[0, 1]]}
    slow = kp.state_feedback(sys, method=method, **asked)
    fast = kp.state_feedback(sys, method=method, rate=2, **asked)
    assert slow and slow.check() and 1 <= slow.value <= 1.002 and not slow.limit > 1
    assert fast and fast.check() and fast.decay_rate >= 2 and not fast.limit > 1
    assert linf_gain(A + B @ fast.F, [[0], [1]], [[1, 0]], 1) <= fast.value <= 1.002 * 1.5  # x1 >= x2 for the rate


@pytest.mark.parametrize("method", ["auto", "alternation"])
@pytest.mark.parametrize("unit", [2.0**-100, 1e-9, 2.0**20, 2.0**100])
@pytest.mark.parametrize("of", ["w", "z", "t"])
def test_units_leave_the_gain_as_it_is(unit, of, method):
    """x' = t (1 + f) x + w, z = x with f = -3, times the unit."""
    w, z, t = (unit if of == name else 1.0 for name in "wzt")
    sys = kp.ConeStateSpace([[t]], [[t]], [[1]], 0)
    d = kp.state_feedback(sys, gain_bound=3, method=method, disturbance=([[w]], [[z]]))
    best = w * z / (2 * t)
    assert d and d.check() and best <= d.value <= 1.003 * best
    assert method == "alternation" or 0.999 * best <= d.limit <= best


def test_a_cone_of_four_generators(tmp_path):
    """x3' = (1 + f) x3 + w is all that F moves, and f = -1.5 is all it may: gain 2."""
    A, B = np.diag([-1.0, -1, 1]), [[0], [0], [1]]
    sys = kp.ConeStateSpace(A, B, np.eye(3), np.zeros((3, 1)), X=PYRAMID)
    d = kp.state_feedback(sys, disturbance=([[0], [0], [1]], [[0, 0, 1]]), gain_bound=1.5)
    assert d and d.check() and 2 <= d.value <= 2.01 and np.isnan(d.limit) and "the best found" in d.explain()
    d.certificate.save(tmp_path / "d.json")
    assert kp.load_certificate(tmp_path / "d.json") == d.certificate
    wild = kp.state_feedback(sys, disturbance=([[1], [0], [0]], [[0, 0, 1]]), gain_bound=1.5)
    assert wild.status is kp.Status.REFUTED and "E must map into X" in wild.message


def test_constraints_of_the_user(plant):
    free = kp.state_feedback(plant, X=PAPER, gain_bound=8, constraints=lambda F: [], **PUSHED)
    assert free and free.value <= 1.002 / 12
    d = kp.state_feedback(plant, X=PAPER, gain_bound=8, constraints=lambda F: [F[0, 0] >= -9], **PUSHED)
    best = 1 / 10  # the DC gain is 1 / (1 - f1)
    assert d and d.check() and d.F[0, 0] >= -9 - 1e-5 and best * 0.999 <= d.value <= 1.003 * best
    assert "the L-infinity gain" in d.explain() and np.isnan(d.limit)
    assert "every other demand but your own constraints are proven" in d.explain()
    none = kp.state_feedback(plant, X=PAPER, gain_bound=8, constraints=lambda F: [F[0, 0] >= 5], **PUSHED)
    assert none.status is kp.Status.UNDECIDED and "constraints given" in none.message


def test_modes_with_disturbance_and_constraints():
    modes = [([[1, 1], [1, -3]], [[1], [0]]), ([[-3, 1], [1, 1]], [[0], [1]])]
    sys = kp.ConeStateSpace(*modes[0], np.eye(2), np.zeros((2, 1)))
    asked = {"vertices": modes, "per_mode": True, "gain_bound": 8, **BOTH}
    d = kp.state_feedback(sys, **asked)
    own = kp.state_feedback(sys, constraints=lambda F: [cp.sum(F[:, 0]) >= -5], **asked)
    for found in (d, own):
        assert found and found.check() and found.F.shape == (2, 1, 2)
        assert all(linf_gain(loop.A, *BOTH["disturbance"]) <= found.value for loop in found.closed_loop)
    assert own.F[:, 0, 0].sum() >= -5 - 1e-5


def test_outputs_that_no_stabilising_gain_keeps_positive_are_refuted(plant, tmp_path):
    """z = x1 + u >= 0 on the cone asks for F (0, 1)' >= 0, and stability for less."""
    d = kp.state_feedback(plant, X=PAPER, disturbance=([[0], [1]], [[1, 0]], [[1]]))
    assert d.status is kp.Status.REFUTED and d.check() and "outputs in Y" in d.explain()
    assert d.message.startswith("z must not be negative")
    d.save(tmp_path / "no.json")
    assert kp.load_certificate(tmp_path / "no.json") == d.certificate and checker.main(tmp_path / "no.json") == 1
    free = kp.state_feedback(plant, X=PAPER, gain_bound=13, disturbance=([[0], [1]], [[10, 0]], [[-1]]))
    assert free and free.check()


def test_refusals_and_wrong_arguments(plant):
    unstable = kp.ConeStateSpace([[1, 0], [0, -1]], [[0], [1]], np.eye(2), np.zeros((2, 1)))
    for method in ("auto", "alternation"):
        d = kp.state_feedback(unstable, gain_bound=2, method=method, disturbance=([[0], [1]], [[0, 1]]))
        assert d.status is kp.Status.REFUTED and d.check()
    with pytest.raises(kp.DataError, match="objective not with disturbance"):
        kp.state_feedback(plant, X=PAPER, objective=lambda F: cp.norm(F), **PUSHED)
    for wrong in (5, iter([[[0], [1]], [[1, 0]]])):
        with pytest.raises(kp.ShapeError, match="disturbance must be"):
            kp.state_feedback(plant, X=PAPER, vertices=[plant, plant], per_mode=True, disturbance=wrong)
    with pytest.raises(kp.DataError, match="fixed rate"):
        kp.state_feedback(plant, X=PAPER, rate="max", **PUSHED)


@pytest.mark.parametrize("G", [[[1]], [[0]]])
def test_gains_that_run_away_are_told_and_a_bound_ends_them(G):
    plant = kp.ConeStateSpace([[1]], [[1]], [[1]], 0)
    away = kp.state_feedback(plant, disturbance=([[1]], G))
    assert away.status is kp.Status.UNDECIDED and away.message.endswith("give gain_bound.")
    bounded = kp.state_feedback(plant, disturbance=([[1]], G), gain_bound=3)
    assert bounded and abs(bounded.F[0, 0]) <= 3
    assert bounded.value <= G[0][0] / 2 * (1 + 2e-3) + 1e-5
