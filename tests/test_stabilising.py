"""Rules of `switched` that stabilise by the state, dwell times in whole steps, and decay rates of every order."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

import control_kpos as kp

SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
BOTH_GROW = [[[1, 0], [1, -3]], [[-3, 1], [0, 1]]]
STEPS = [[["1/2", "5/3"], [0, "1/2"]], [["1/2", 0], [2, "1/2"]]]


def dwelling(s):
    """The certificates about dwell times, by status."""
    return {p.status.name: p for p in (s.certificate, *s.others) if isinstance(p, kp.DwellCertificate)}


def test_members_that_grow_are_stabilised():
    s = kp.switched(BOTH_GROW)
    rule = s.stabilising
    assert s.status == "REFUTED" and rule and rule.check() and rule in s.others
    assert sum(rule.weights) == 1 and (rule.v > 0).all()
    mixed = sum(float(a) * np.array(A) for a, A in zip(rule.weights, BOTH_GROW, strict=True))
    assert (rule.v @ mixed + rule.decay_rate * rule.v <= 1e-12).all() and "exp(-0.5 t)" in rule.explain()


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("discrete", [False, True])
def test_the_rule_makes_v_fall_from_every_state(seed, discrete):
    rng = np.random.default_rng(seed)
    n = 3
    family = [rng.random((n, n)) * (rng.random((n, n)) < 0.6) / 2 for _ in range(3)]
    family = [A + np.diag(rng.uniform(0, 1, n) if discrete else rng.uniform(-3, 0.5, n)) for A in family]
    family[0][0, 0] = 1.1 if discrete else 0.1
    rule = kp.switched(family, discrete=discrete).stabilising
    if rule is None:
        return
    x = rng.random((200, n))
    chosen = rule.rule(x)
    after = np.einsum("kij,kj->ki", np.array(family)[chosen], x) - (x if discrete else 0)
    assert (after @ rule.v <= -rule.decay_rate * (x @ rule.v) + 1e-9).all()
    every = np.array([x @ A.T @ rule.v for A in family])
    assert (every[chosen, np.arange(200)] == every.min(axis=0)).all()


def test_a_trajectory_under_the_rule_decays():
    rule, x, step = kp.switched(BOTH_GROW).stabilising, np.array([1.0, 2.0]), 1e-3
    start = rule.v @ x
    for _ in range(4000):
        x = x + step * np.array(BOTH_GROW, dtype=float)[rule.rule(x)] @ x
    assert 0 < rule.v @ x < start * np.exp(-rule.decay_rate * 4) * 1.01


def test_on_a_cone_of_four_generators_and_exactly():
    family = [np.diag([-1, -1, 0.25]), np.diag([-2, -1, -0.125])]
    rule = kp.switched(family, X=SQUARE).stabilising
    assert rule and (SQUARE.rays @ rule.v > 0).all()
    rule = kp.switched([[["1/3"]], [["-1/3"]]]).stabilising
    assert rule.loops[0].A.fractions()[0, 0] == Fraction(1, 3) and rule.weights == (0, 1)


def test_no_rule_where_nothing_stabilises_and_none_where_none_is_needed():
    assert kp.switched([[[1, 0], [0, -1]], [[2, 0], [0, -1]]]).stabilising is None
    assert kp.switched([[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]]).stabilising is None
    assert kp.switched([np.diag([0.1, 0.2])] * 20 + [np.diag([0.3, -0.2])]).stabilising is None


def test_rules_refuse_states_of_other_sizes():
    rule = kp.switched(BOTH_GROW).stabilising
    assert rule.rule([1, 5]) == 0 and isinstance(rule.rule([1, 5]), int) and rule.rule([[1, 5], [5, 1]]).shape == (2,)
    for x, error in (([1, 2, 3], kp.ShapeError), ([[1], [2]], kp.ShapeError), ([np.nan, 1], kp.DataError)):
        with pytest.raises(error, match=r"^x"):
            rule.rule(x)


def test_changed_rules_are_not_proven():
    rule = kp.switched(BOTH_GROW).stabilising
    for change in ({"v": -rule.v}, {"v": np.array([1.0, 9.0])}, {"decay_rate": 2.0}, {"loops": rule.loops[:1] * 2}):
        assert not type(rule).settle(**rule.data() | change) and not replace(rule, **change).check()
    for change in ({"weights": (Fraction(1),)}, {"weights": (Fraction(2), Fraction(-1))}, {"decay_rate": -1.0}):
        with pytest.raises(kp.DataError):
            type(rule).settle(**rule.data() | change)


# -- dwell times in steps


def test_a_dwell_time_in_steps():
    s = kp.switched(STEPS, discrete=True)
    low, high = s.dwell_bounds
    assert (low, high) == (3, 4) and s.dwell_time == 4 and all(p.check() for p in s.others)
    A, B = (np.array([[Fraction(x) for x in row] for row in M], dtype=float) for M in STEPS)
    powers = np.linalg.matrix_power
    assert np.abs(np.linalg.eigvals(powers(A, 3) @ powers(B, 3))).max() >= 1
    assert np.abs(np.linalg.eigvals(powers(A, 4) @ powers(B, 4))).max() < 1
    assert "4 steps or longer" in dwelling(s)["PROVED"].explain()
    assert "members 0 for 3, 1 for 3" in dwelling(s)["REFUTED"].explain()


@pytest.mark.parametrize("seed", range(6))
def test_random_pairs_in_steps(seed):
    rng = np.random.default_rng(seed)
    family = [rng.random((3, 3)) * 3 * (rng.random((3, 3)) < 0.5) for _ in range(2)]
    family = [np.triu(A, 1) if s else np.tril(A, -1) for s, A in enumerate(family)]
    family = [A + np.diag(rng.uniform(0.3, 0.8, 3)) for A in family]
    s = kp.switched(family, discrete=True)
    low, high = s.dwell_bounds
    assert low <= high < np.inf and all(p.check() for p in s.others)
    for more in product(range(2), repeat=4):
        P = np.eye(3)
        for k, extra in enumerate(more):
            P = np.linalg.matrix_power(family[k % 2], int(max(high, 1)) + extra) @ P
        assert np.abs(np.linalg.eigvals(P)).max() < 1
    if low:
        w = dwelling(s)["REFUTED"].witness
        P = np.eye(3)
        for k, t in zip(w.modes, w.times, strict=True):
            P = np.linalg.matrix_power(family[k], int(t)) @ P
        assert np.abs(np.linalg.eigvals(P)).max() >= 1 - 1e-12 and min(w.times) == low


def test_a_cycle_on_the_margin_is_found_exactly():
    s = kp.switched([[[0, 2], [0, 0]], [[0, 0], ["1/2", 0]]], discrete=True)
    assert s.dwell_bounds == (1, 2)
    assert kp.switched([[["1/2"]], [["1/4"]]], discrete=True).dwell_bounds == (0, 0)
    assert kp.switched([[["1/2"]], [[1]]], discrete=True).dwell_bounds == (np.inf, np.inf)


def test_on_four_generators_in_steps():
    T = np.array([[1, 1, 0], [1, -1, 0], [0, 0, 1.0]])
    family = [np.array([[float(Fraction(x)) for x in row] + [0] for row in M] + [[0, 0, 0.5]]) for M in STEPS]
    turned = [np.linalg.inv(T) @ A @ T for A in family]
    s = kp.switched(turned, X=kp.PolyhedralCone(np.linalg.inv(T).T), discrete=True)
    assert s.dwell_bounds == (3, 4)


def test_shorter_times_in_steps_are_not_proven():
    s = kp.switched(STEPS, discrete=True)
    enough, short = (dwelling(s)[name] for name in ("PROVED", "REFUTED"))
    assert not type(enough).settle(**enough.data() | {"dwell_time": Fraction(3)})
    assert not type(enough).settle(**enough.data() | {"vs": -enough.vs})
    assert type(short).settle(**short.data() | {"dwell_time": Fraction(4)}).status == "UNDECIDED"
    for times in ((Fraction(4), Fraction(4)), (Fraction(3), Fraction(6))):
        other = replace(short.witness, times=times)
        assert type(short).settle(**short.data() | {"witness": other}).status == "UNDECIDED"
    for T in (Fraction(9, 2), Fraction(1001)):
        with pytest.raises(kp.DataError, match="whole numbers of steps"):
            type(enough).settle(**enough.data() | {"dwell_time": T})


# -- decay rates


@pytest.mark.parametrize("discrete", [False, True])
def test_a_rate_of_every_order(discrete):
    family = [np.diag([0.25, 0.5]), [[0.5, 0.125], [0, 0.25]]]
    family = family if discrete else [np.asarray(A) - np.eye(2) for A in family]
    s = kp.switched(family, discrete=discrete, rate="0.4")
    assert s and s.decay_rate >= 0.4 and s.certificate.check()
    s = kp.switched(family, discrete=discrete, rate="0.6")
    assert s.status == "UNDECIDED" and s.others[0] and "not at the rate" in s.explain()
    for rate, message in ((0, "rate"), (-1, "rate"), ("max", "rate")):
        with pytest.raises(kp.DataError, match=message):
            kp.switched(family, discrete=discrete, rate=rate)


def test_a_rate_by_growth():
    turns = [[["1/2", "1/2"], [0, "1/2"]], [["1/2", 0], ["1/2", "1/2"]]]
    assert kp.switched(turns, discrete=True, rate="0.19")
    assert kp.switched(turns, discrete=True, rate="0.2").status == "UNDECIDED"
