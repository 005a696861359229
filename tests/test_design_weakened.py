"""Actuators that lose effect: what `certified_fraction` promises, seen in fractions at every corner of [f, 1]^m."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import control as ct
import numpy as np
import planted
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.design.actuator_loss import Demand, least_fractions, lifted
from control_kpos.exact.matrix import Matrix

PAPER = [[0, 1], [1, -2]]
UNIT = Fraction(1, 10**4)


def fractions(M):
    M = np.asarray(M)
    return np.array([Fraction(x) for x in M.ravel().tolist()], dtype=object).reshape(M.shape)


def corners(f, m):
    return [np.array(s, dtype=object) for s in product((Fraction(f), Fraction(1)), repeat=m)]


def keeps(X, M, v, rate, discrete):
    """Invariance of X under M, and v'x falling at this rate, in fractions."""
    rays, facets, v = fractions(X.rays), fractions(X.facets), fractions(v)
    where = np.ones(X.incidence.shape, dtype=bool) if discrete else X.incidence
    drift = M - int(discrete) * np.eye(len(M), dtype=int)
    falls, heights = rays @ drift.T @ v, rays @ v
    return bool(((facets @ M @ rays.T)[where] >= 0).all() and (falls < 0).all() and (falls + rate * heights <= 0).all())


def weaker(A, B, F, s):
    return fractions(A) + fractions(B) @ (s[:, None] * fractions(F))


def require_kept(f, m, holds):
    """Kept at every corner and in between, but not at every corner for an f smaller by two units of its last digit."""
    assert 0 <= f <= 1 and all(map(holds, corners(f, m)))
    rng = np.random.default_rng(0)
    for _ in range(3):
        assert holds(Fraction(f) + (1 - Fraction(f)) * fractions(rng.uniform(size=m)))
    if 3 * UNIT < f < Fraction(9998, 10**4):
        assert not all(map(holds, corners(Fraction(f) - 2 * UNIT, m)))


@settings(max_examples=25)
@given(
    st.integers(0, 10**6),
    st.sampled_from([(2, 1), (2, 2), (3, 2), (4, 3)]),
    st.sampled_from([0.0, 0.05]),
    st.booleans(),
)
def test_all_that_was_asked_for_is_kept_down_to_the_fraction(seed, size, rate, discrete):
    A, B, rays, _ = (planted.discrete if discrete else planted.simplicial)(np.random.default_rng(seed), *size)
    sys = ct.ss(A, B, np.eye(size[0]), 0, *([1] if discrete else []))
    d = kp.state_feedback(sys, X=rays, rate=rate)
    if not d:  # the rate is too much
        return
    assert d.weakened_rate == rate
    X, v = kp.PolyhedralCone(rays), d.certificate.v

    def holds(s):
        return keeps(X, weaker(A, B, d.F, s), v, Fraction(rate), discrete)

    require_kept(d.certified_fraction, size[1], holds)
    assert (d.certified_fraction < 1) == ("% to 100 %" in d.explain() or "even all" in d.explain())


def test_one_common_factor_is_not_all_that_is_covered():
    A, B = [[1.0, 0], [0, 1]], np.eye(2)
    d = kp.state_feedback(ct.ss(A, B, np.eye(2), 0), X=[[3, 1], [1, 3]], rate=1, gap=0.05)
    X, v, f = kp.PolyhedralCone([[3, 1], [1, 3]]), d.certificate.v, d.certified_fraction
    alone = np.array([Fraction(f) - Fraction(1, 100), Fraction(1)], dtype=object)
    assert d and 0.1 < f < 1 and not keeps(X, weaker(A, B, d.F, alone), v, 1, False)


def test_strict_inequalities_stay_strict():
    """Without the actuator the eigenvalue is 0, and everything else holds with equality."""
    A, B = np.array([[-3.0, 0], [4, 0]]), np.array([[0.0], [-1]])
    d = kp.state_feedback(kp.ConeStateSpace(A, B, np.eye(2), np.zeros((2, 1))))
    assert d and d.F.any() and d.certified_fraction == pytest.approx(1e-4)
    weak = weaker(A, B, d.F, np.array([Fraction(d.certified_fraction)]))
    assert kp.linear_lyapunov(weak, kp.orthant(2)) and not kp.linear_lyapunov(A, kp.orthant(2))


@pytest.mark.parametrize("entry", [1e-14, 2.0**-60, 1e-300])
def test_entries_next_to_zero_count(entry):
    """Without the actuator the cone is left, however slowly."""
    A = np.array([[-1.0, 0], [-entry, -1]])
    d = kp.state_feedback(ct.ss(A, [[0], [1]], np.eye(2), 0), X=kp.orthant(2))
    assert d and d.certified_fraction > 0
    assert kp.state_positivity(weaker(A, [[0], [1]], d.F, fractions([d.certified_fraction])), kp.orthant(2))


def test_the_gain_from_disturbances_is_kept():
    A, B, E = [[-0.2, 0.2, 0.2], [0.4, -0.7, 0.2], [0, 0.8, -3]], [[-0.4, 0.5], [0.2, -0.8], [-1, 2]], np.eye(3)[:, :2]
    G, H = np.vstack([np.eye(3), np.zeros((2, 3))]), np.vstack([np.zeros((3, 2)), np.eye(2)])
    d = kp.state_feedback(kp.ConeStateSpace(A, B, np.eye(3), np.zeros((3, 2))), disturbance=(E, G, H))
    bound, gamma = d.certificate.others[-1], Fraction(d.value)

    def holds(s):
        M = weaker(A, B, d.F, s)
        out, x = fractions(G) + fractions(H) @ (s[:, None] * fractions(d.F)), fractions(bound.x)
        below = (M @ x + fractions(E).sum(axis=1) < 0).all() and (out @ x < gamma).all() and (out >= 0).all()
        return bool(below) and keeps(kp.orthant(3), M, d.certificate.v, 0, False)

    require_kept(d.certified_fraction, 2, holds)
    scalar = kp.state_feedback(
        kp.ConeStateSpace([[-1.0]], [[1.0]], [[1.0]], 0), disturbance=([[1.0]], [[1.0]]), gain_bound=3
    )
    assert 0.99 < scalar.certified_fraction < 1
    weak = -1 + Fraction(scalar.certified_fraction) * Fraction(scalar.F[0, 0])
    assert -1 / weak < scalar.value < -1 / (weak + Fraction(1, 100))


def test_outputs_in_their_cone_are_kept():
    sys = kp.ConeStateSpace([[-3.0]], [[1.0]], [[-1.0]], [[1.0]])
    d = kp.state_feedback(sys, ports=True)
    assert d and 0 < d.certified_fraction <= 1
    assert -1 + Fraction(d.certified_fraction) * Fraction(d.F[0, 0]) >= 0  # C + D s F


def test_every_vertex_and_the_common_vector_are_kept():
    A, B, rays, _ = planted.simplicial(np.random.default_rng(3), 3, 2)
    pairs = [(A, B), (A + 0.01, B), (A, 0.95 * B)]
    d = kp.state_feedback(ct.ss(A, B, np.eye(3), 0), X=rays, vertices=pairs)
    X, x = kp.PolyhedralCone(rays), fractions(d.certificate.others[-1].x)
    facets = fractions(X.facets)

    def holds(s):
        return all(
            keeps(X, weaker(a, b, d.F, s), loop.v, 0, False) and (facets @ weaker(a, b, d.F, s) @ x < 0).all()
            for (a, b), loop in zip(pairs, d.certificate.loops, strict=True)
        )

    require_kept(d.certified_fraction, 2, holds)


def test_output_feedback_and_observers():
    A, B, C = [[-3, 1], [2, 1]], [[0], [1]], [[0, 1]]
    d = kp.output_feedback(ct.ss(A, B, C, 0), rate=0.5)
    gain = fractions(d.F) @ fractions(C)
    require_kept(
        d.certified_fraction,
        1,
        lambda s: keeps(kp.orthant(2), weaker(A, B, gain, s), d.certificate.v, Fraction(1, 2), 0),
    )
    o = kp.observer_gain(ct.ss([[1, 1], [0.5, -2]], [[1], [0]], [[1, 0]], 0), rate=1)
    assert "of sensors that lose effect" in o.explain() or "sensors at" in o.explain()
    L = fractions(o.F) * Fraction(o.certified_fraction)
    assert kp.linear_lyapunov(fractions([[1, 1], [0.5, -2]]) + L @ fractions([[1, 0]]), kp.orthant(2))


def test_one_gain_for_any_number_of_nodes_is_kept():
    node = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=PAPER)
    d = kp.scale_free_feedback(node, weight=1, rate="1/4")
    M = weaker(node.A, node.B, d.F, fractions([d.certified_fraction]))
    weak = kp.scale_free_certificate(kp.ConeStateSpace(M, node.B, node.C, 0, X=PAPER), weight=1)
    assert 0 < d.certified_fraction < 1 and weak
    loop = M + fractions(node.B) @ fractions(node.C)
    assert kp.linear_lyapunov(loop, PAPER, rate="max").decay_rate >= 0.25


def test_local_actuators_of_networks_are_weakened_each_on_its_own():
    rng = np.random.default_rng(5)
    A = np.array([[-1.0, 1], [1, -1]]) + 0.1 * rng.uniform(size=(4, 2, 2))
    nodes = [kp.ConeStateSpace(a, np.eye(2), [[1, 0], [0, 1]], np.zeros((2, 2))) for a in A]
    ring = np.kron(np.roll(np.eye(4), 1, axis=1), 0.2 * np.eye(2))
    d = kp.network_feedback(nodes, ring, rate=0.3)
    c = d.certificate
    assert d and d.weakened_rate == 0.3 and (d.certified_fraction > 0).all()
    for _ in range(4):
        f = d.certified_fraction[:, None] + (1 - d.certified_fraction[:, None]) * rng.integers(0, 2, size=(4, 2))
        weak = [
            kp.ConeStateSpace(weaker(a, np.eye(2), F, fractions(s)), np.eye(2), np.eye(2), 0 * np.eye(2))
            for a, F, s in zip(A, d.F, f, strict=True)
        ]
        net = kp.feedback_interconnect(weak, ring)
        assert replace(c, model=net.model, decay_rate=d.weakened_rate)._evaluate()[0] is kp.Status.PROVED


def test_the_rate_that_is_promised_is_that_of_the_vector():
    node = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=PAPER)
    with pytest.warns(kp.ActuatorLossWarning):
        d = kp.network_feedback([node] * 3, 0.1 * np.roll(np.eye(3), 1, axis=1), rate=0.5)
    assert d.weakened_rate == 0.5 == d.certificate.required_rate and d.certificate.check()
    assert (
        kp.network_feedback([kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)] * 2, [[0, 0.5], [0.5, 0]]).weakened_rate == 0
    )


def test_demands_that_weaker_gains_break_are_told_from_those_not_proven():
    one = Matrix(np.ones((1, 1)))

    def ask(base, effect, **more):
        return least_fractions(
            [Demand(one, Matrix(np.array([[base]])), Matrix(np.array([[effect]])), lifted(one, one), **more)]
        )

    for base, effect, strict, least, broken in (
        (1.0, 1.0, True, 0.0, False),
        (0.0, 1.0, False, 0.0, False),
        (0.0, 1.0, True, 1e-4, False),
        (-1.0, 2.0, False, 0.5, True),
        (-1.0, 2.0, True, 0.5001, True),
        (2.0, -1.0, True, 0.0, False),
        (-1.0, 1.0, False, 1.0, True),
        (-1.0, 1 + 1e-5, False, 0.999991, True),
    ):
        f, fragile = ask(base, effect, strict=strict)
        assert (float(f), bool(fragile)) == (pytest.approx(least, abs=1e-12), broken)
    nowhere = ask(-1.0, 0.5, where=np.zeros((1, 1), dtype=bool))
    assert nowhere[0] == 0 and not nowhere[1]


def test_constraints_of_the_user_are_about_the_gain_alone():
    plant = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
    d = kp.state_feedback(plant, X=PAPER, constraints=lambda F: [F[0, 1] <= -6])
    assert d and 0 < d.certified_fraction < 1 and d.F[0, 1] * d.certified_fraction > -6 * 1.05
    assert "every other demand but your own constraints" in d.explain()
    assert "but your own" not in kp.state_feedback(plant, X=PAPER).explain()
