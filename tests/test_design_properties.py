"""What holds for every design: planted gains are found, certificates stand on their data alone, units do not matter."""

from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import planted
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from statements import fractions_of

import control_kpos as kp
from control_kpos.exact.intake import exact_matrix

SIZES = st.sampled_from([(1, 1), (2, 1), (3, 1), (3, 2), (4, 2), (5, 3)])
SEEDS = st.integers(0, 10**6)
POWERS = st.integers(-30, 30)


def fractions(M):
    """What the doubles stand for: on the edge of a cone the rounding of a product would count."""
    return np.vectorize(Fraction, otypes=[object])(M)


def design(A, B, rays, **demands):
    """The design; in discrete time with dt=1 among the demands."""
    dt = demands.pop("dt", 0)
    return kp.state_feedback(ct.ss(A, B, np.eye(len(A)), 0, dt), X=rays, **demands)


def require_sound(d, A, B):
    """A certified gain, as python-control and the certificate see it."""
    assert d and d.check() and d.certificate.check()
    np.testing.assert_array_equal(d.K, -d.F)
    np.testing.assert_allclose(d.closed_loop.A, A + B @ d.F, rtol=1e-12, atol=1e-12 * np.abs(A).max())
    assert d.closed_loop.linear_lyapunov() and d.margin > 0


@settings(max_examples=40)
@given(SEEDS, SIZES)
def test_planted_gains_are_found(seed, size):
    A, B, rays, _ = planted.simplicial(np.random.default_rng(seed), *size)
    d = design(A, B, rays)
    require_sound(d, A, B)
    assert d.value <= 1.11 * d.limit + 1e-12
    assert np.abs(d.F @ planted.unit(rays).T).max() == pytest.approx(d.value, rel=1e-12)


@settings(max_examples=20)
@given(SEEDS, SIZES)
def test_planted_gains_are_found_in_discrete_time(seed, size):
    A, B, rays, _ = planted.discrete(np.random.default_rng(seed), *size)
    require_sound(design(A, B, rays, dt=1), A, B)


@settings(max_examples=15)
@given(SEEDS, st.sampled_from([(3, 1), (3, 2), (4, 2)]))
def test_planted_gains_on_other_cones_carry_their_proof(seed, size):
    A, B, X, _ = planted.polyhedral(np.random.default_rng(seed), *size, 2)
    d = design(A, B, X)
    assert d.status is not kp.Status.REFUTED
    if d:
        require_sound(d, A, B)


@settings(max_examples=20)
@given(SEEDS, SIZES, st.floats(1e-6, 10.0))
def test_the_planted_gain_is_no_smaller_than_the_limit(seed, size, slack):
    """The planted gain is one of those the program chooses from; a bound of its size is met."""
    A, B, rays, F = planted.simplicial(np.random.default_rng(seed), *size)
    bound = np.abs(F @ planted.unit(rays).T).max() * (1 + slack)
    d = design(A, B, rays, gain_bound=bound)
    require_sound(d, A, B)
    assert d.limit <= bound and np.abs(d.F @ planted.unit(rays).T).max() <= bound * (1 + 1e-14)


# -- certificates


@settings(max_examples=20)
@given(SEEDS, SIZES, st.data())
def test_a_changed_certificate_proves_nothing(seed, size, data):
    A, B, rays, _ = planted.simplicial(np.random.default_rng(seed), *size)
    d = design(A, B, rays)
    assume(d.value > 0)
    c = d.certificate
    k = data.draw(st.integers(0, size[0] - 1), label="entry of v")
    v = np.array(c.v)
    v[k] = -v[k] - 1e6 * np.abs(v).max() * np.sign(v[k])
    assert not replace(c, v=-c.v).check()
    assert not replace(c, v=v).check() or size[0] == 1
    open_loop = exact_matrix(A, "A")
    assert not replace(c, positivity=replace(c.positivity, A=open_loop)).check()


@settings(max_examples=20)
@given(SEEDS, SIZES)
def test_a_gain_outside_its_margins_is_not_certified(seed, size):
    A, B, rays, _ = planted.simplicial(np.random.default_rng(seed), *size)
    d = design(A, B, rays)
    s = d.certified_fraction
    assume(s > 0.01)
    X = kp.PolyhedralCone(rays)
    for weak in (1.0, (1 + s) / 2, s):
        assert kp.linear_lyapunov(fractions(A) + Fraction(weak) * (fractions(B) @ fractions(d.F)), X)
    assert not kp.linear_lyapunov(A, X)  # without the gain


@settings(max_examples=25)
@given(SEEDS, SIZES)
def test_refusals_stand_on_their_data_alone(seed, size):
    A, B, rays, _ = planted.simplicial(np.random.default_rng(seed), *size)
    limit = design(A, B, rays).limit
    assume(limit > 1e-3)
    d = design(A, B, rays, gain_bound=0.9 * limit)
    assert d.status is kp.Status.REFUTED and d.check() and d.F is None and d.K is None
    c = d.certificate
    assert not replace(c, gain_bound=1.1 * limit * np.ones(size[1])).check()
    assert not replace(c, witness=None).check()


# -- units


@settings(max_examples=25)
@given(SEEDS, SIZES, st.data())
def test_units_change_no_verdict_and_those_of_inputs_and_time_only_scale_the_gain(seed, size, data):
    n, m = size
    A, B, rays, _ = planted.simplicial(np.random.default_rng(seed), n, m)
    S = 2.0 ** np.array(data.draw(st.lists(POWERS, min_size=n, max_size=n), label="states"))
    time, inputs = (2.0 ** data.draw(POWERS, label=name) for name in ("time", "inputs"))
    d = design(A, B, rays)
    scaled = time * S[:, None] * A / S, time * S[:, None] * B / inputs
    e = design(*scaled, rays * S)
    assert e and e.check()
    slow = design(time * A, time * B / inputs, rays)
    assert abs(slow.limit / inputs - d.limit) <= 0.01 * d.limit + 1e-12
    F = fractions_of(e.F * S / inputs)  # by powers of two
    assert kp.linear_lyapunov(fractions_of(A) + fractions_of(B) @ F, kp.PolyhedralCone(rays))


@settings(max_examples=20)
@given(SEEDS, SIZES)
def test_observers_are_feedback_of_the_dual(seed, size):
    n, q = size
    At, Ct, facets, _ = planted.simplicial(np.random.default_rng(seed), n, q)
    X = kp.PolyhedralCone.from_facets(facets)
    d = kp.observer_gain(ct.ss(At.T, np.ones((n, 1)), Ct.T, 0), X=X)
    assert d and d.check() and d.F.shape == (n, q)
    assert kp.linear_lyapunov(At.T + d.F @ Ct.T, X)


def test_a_solution_with_a_zero_does_no_harm():
    # HiGHS leaves one of the xi_k at zero here, and z_k / xi_k is no number
    A, B, rays, _ = planted.simplicial(np.random.default_rng(25), 5, 3)
    require_sound(design(A, B, rays), A, B)
