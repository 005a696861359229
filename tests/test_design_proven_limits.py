"""Limits of designs: proven bounds that no gain beats, or none; what was only found is called the best found."""

import pickle

import control as ct
import cvxpy as cp
import numpy as np
import planted
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp

PAPER = [[0, 1], [1, -2]]
PLANT = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
PYRAMID = kp.PolyhedralCone([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]])


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([(1, 1), (2, 1), (3, 2), (4, 2)]), st.booleans())
def test_no_gain_is_smaller_than_the_limit(seed, size, discrete):
    A, B, rays, F = (planted.discrete if discrete else planted.simplicial)(np.random.default_rng(seed), *size)
    sys = ct.ss(A, B, np.eye(size[0]), 0, *([1] if discrete else []))
    d = kp.state_feedback(sys, X=rays)
    assert d and 0 <= d.limit <= d.value
    assert d.limit <= np.abs(F @ planted.unit(rays).T).max()  # the planted gain does it
    if d.limit > 0:
        below = kp.state_feedback(sys, X=rays, gain_bound=d.limit * (1 - 1e-9))
        assert below.status is kp.Status.REFUTED and below.check()
        assert "which is proven" in d.explain() and "best found" not in d.explain()


def test_limits_are_proven_on_the_other_side_of_a_pickle():
    plant = kp.ConeStateSpace([[1]], [[1]], [[1]], 0)
    asked = {}, {"rate": "max", "gain_bound": 3}, {"disturbance": ([[1]], [[1]]), "gain_bound": 3}
    designs = [kp.state_feedback(plant, **keywords) for keywords in asked]
    designs.append(kp.network_feedback([plant] * 2, np.zeros((2, 2))))
    for d in designs:
        again = pickle.loads(pickle.dumps(d))
        assert again.check() and np.isfinite(again.limit) and again.limit == d.limit
        assert np.array_equal(again.certified_fraction, d.certified_fraction)


def test_no_gain_is_faster_than_the_limit():
    d = kp.state_feedback(PLANT, X=PAPER, rate="max")
    assert 2 <= d.limit < 2.0001 and d.decay_rate <= d.limit and "has more than" in d.explain()
    assert kp.state_feedback(PLANT, X=PAPER, rate=d.limit).status is kp.Status.REFUTED


def test_bounds_that_are_given_count_for_the_limit():
    d = kp.state_feedback(PLANT, X=PAPER, rate="max", gain_bound=5.5)
    assert d and d.decay_rate <= d.limit <= 2.0001
    narrow = kp.state_feedback(PLANT, X=PAPER, gain_bound=5)
    assert narrow and 4.99 < narrow.limit <= 5


@pytest.mark.parametrize("bound", [2.0, 8.0])
def test_no_gain_rejects_disturbances_better_than_the_limit(bound):
    plant = kp.ConeStateSpace([[-1.0]], [[1.0]], [[1.0]], 0)
    d = kp.state_feedback(plant, disturbance=([[1]], [[1]]), gain_bound=bound)
    best = 1 / (1 + bound)  # x' = (-1 + F) x + w with F = -bound
    assert d and d.limit <= best <= d.value and d.limit == pytest.approx(best, rel=1e-3)
    assert kp.state_feedback(PLANT, X=PAPER, disturbance=([[0], [1]], [[1, 0]]), gain_bound=8).limit <= 1 / 12


def test_what_a_local_search_found_is_no_limit():
    still = kp.ConeStateSpace(np.zeros((3, 3)), np.eye(3), np.eye(3), np.zeros((3, 3)), X=PYRAMID)
    d, better = kp.state_feedback(still, rate=1), kp.state_feedback(still, rate=1, gain_bound=1.00001)
    assert d and better and d.value > 1.00001 and np.isnan(d.limit) and "the best found" in d.explain()
    fast = kp.state_feedback(still, rate="max", gain_bound=2)
    own = kp.state_feedback(PLANT, X=PAPER, objective=lambda F: cp.norm(F), rate=1)
    two = kp.state_feedback(PLANT, X=PAPER, method="two-step", gain_bound=13)
    output = kp.output_feedback(ct.ss([[-3, 1], [2, 1]], [[0], [1]], [[0, 1]], 0))
    patterned = kp.state_feedback(PLANT, X=PAPER, structure=[[True, True]], method="alternation")
    for found in (fast, own, two, output, patterned):
        assert found and np.isnan(found.limit) and "the best found" in found.explain()


def test_limits_of_vertices_are_about_a_common_vector():
    A, B = PLANT.A, PLANT.B
    d = kp.state_feedback(PLANT, X=PAPER, vertices=[(A, B), (A, 0.8 * B)])
    assert d and np.isfinite(d.limit) and "no gain with a common vector x inside X" in d.explain()


def test_limits_of_networks():
    node = kp.ConeStateSpace(PLANT, X=PAPER)
    ring = np.roll(np.eye(3), 1, axis=1)
    with pytest.warns(kp.ActuatorLossWarning):
        d = kp.network_feedback([node] * 3, 20 * ring)
    assert d and 11.8 < d.limit <= 12 and d.limit <= d.value
    assert kp.network_feedback([node] * 3, 20 * ring, gain_bound=0.999 * d.limit).status is kp.Status.REFUTED
    with pytest.warns(kp.ActuatorLossWarning):
        bounded = kp.network_feedback([node] * 3, ring, gain_bound=9)
    assert bounded and np.isnan(bounded.limit) and "the best found" in bounded.explain()


@pytest.mark.filterwarnings("ignore::control_kpos.ActuatorLossWarning")
@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-4])
@pytest.mark.parametrize("rate", [0, 0.5])
def test_local_gains_are_within_the_gap_of_the_smallest(gap, rate):
    """The paper's plants in a ring of light links need |F_j x_k| >= 5."""
    node, ring = kp.ConeStateSpace(PLANT, X=PAPER), np.roll(np.eye(3), 1, axis=1)
    d = kp.network_feedback([node] * 3, ring, rate=rate, gap=gap)
    assert d and d.check() and d.decay_rate >= rate
    assert 4.999 < d.limit <= 5 <= d.value <= 5 * (1 + gap)


@pytest.mark.filterwarnings("ignore::control_kpos.ActuatorLossWarning")
@settings(max_examples=15)
@given(st.integers(0, 10**6))
def test_random_networks_are_within_the_gap_of_their_limit(seed):
    rng = np.random.default_rng(seed)
    nodes = [kp.ConeStateSpace([[0, 1], [-k, d]], [[0], [1]], [[1, 0]], 0, X=PAPER) for k, d in rng.normal(size=(3, 2))]
    d = kp.network_feedback(nodes, rng.uniform(0, 9, (3, 3)) * (rng.random((3, 3)) < 0.5), rate=rng.choice([0, 0.3]))
    assert d and 0 < d.limit <= d.value <= d.limit * 1.0015


def random_demands(rng, A, B, rays, discrete):
    """What may be asked of a gain: nothing, a rate, two vertices, little gain from w, other gaps."""
    n = len(A)
    E, G = rays.T @ rng.uniform(0.2, 1, (n, 1)), rng.uniform(0.2, 1, (1, n)) @ np.linalg.inv(rays.T)
    pushed = {"disturbance": (E, G), "gain_bound": 20}
    return [{}, {"rate": 0.05}, {"vertices": [(A, B), (0.98 * A, B)]}, pushed, {"gap": 0.1}, {"gap": 1e-4}]


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.booleans(), st.booleans())
def test_what_is_reached_is_within_the_gap_of_the_limit(seed, discrete, skew):
    rng = np.random.default_rng(seed)
    A, B, rays, _ = (planted.discrete if discrete else planted.simplicial)(rng, int(rng.integers(1, 4)), 2)
    if not skew:
        A, B, rays = np.linalg.solve(rays.T, A @ rays.T), np.linalg.solve(rays.T, B), np.eye(len(A))
    sys = ct.ss(A, B, np.eye(len(A)), 0, *([1] if discrete else []))
    for asked in random_demands(rng, A, B, rays, discrete):
        d = kp.state_feedback(sys, X=rays, **asked)
        gap = asked.get("gap", 1e-3)
        # programs in doubles find a gain to about 1e-5 of itself, whatever the gap
        assert not d or d.limit <= d.value <= d.limit * (1 + gap + (2e-5 if gap < 1e-3 else 0)) + 1e-9
        assert not d or d.check()


def test_a_gain_that_is_not_needed_has_the_limit_zero():
    d = kp.state_feedback(ct.ss([[-1.0]], [[1.0]], [[1.0]], 0))
    assert d and not d.F.any() and d.limit == 0


def test_pictures_of_trade_offs_say_what_was_computed():
    lines = kp.plot_tradeoff(kp.gain_rate_tradeoff(PLANT, [0.5, 1.9], X=PAPER)).lines[0, 0]
    assert [line.get_label() for line in lines][1] == "largest decay rate (computed)"


def test_what_is_possible_instead_is_computed():
    d = kp.state_feedback(PLANT, X=PAPER, gain_bound=4.9)
    assert "Possible instead, as computed and not proven" in d.explain()


def test_the_smallest_gain_within_the_bounds_is_proven():
    """x' = x + u + w on [0, 1]: u = -x without w, -3/2 x for w <= 1/2; the paper's plant needs 5, the square 1/5."""
    growing = kp.ConeStateSpace([[1]], [[1]], [[1]], 0)
    half = {"state_bounds": [1], "disturbance_bounds": ["1/2"]}
    seed = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=PAPER)
    square = kp.ConeStateSpace(np.diag([-0.5, -0.5, 0.2]), [[0], [0], [1]], np.eye(3), 0, X=PYRAMID)
    for plant, asked, least in (
        (growing, {"state_bounds": [1]}, 1),
        (growing, half, 1.5),
        (growing, {**half, "input_bounds": 2}, 1.5),
        (growing, {"state_bounds": [1], "rate": 1}, 2),  # by the rate, not by the interval
        (seed, {"state_bounds": [1, -1], "input_bounds": 10, "disturbance_bounds": [0, "1/10"]}, 5),
        (square, {"state_bounds": [0, 0, 1], "input_bounds": 3}, 0.2),
    ):
        d = kp.state_feedback(plant, **asked)
        assert d and least * 0.997 <= d.limit <= least * (1 + 1e-12) and d.value <= least * 1.0011
    assert np.isnan(kp.state_feedback(growing, input_bounds=2, disturbance_bounds=["1/2"]).limit)  # other intervals
