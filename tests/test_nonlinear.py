"""Differential positivity: enclosures hold, verdicts say what they rest on."""

from __future__ import annotations

import math
from dataclasses import replace

import control as ct
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.errors import ConeMismatchError, DataError, ShapeError
from control_kpos.exact.intervals import jacobian_enclosure
from control_kpos.nonlinear import differential_positivity

DAMPED = kp.PolyhedralCone([[1, 0], [1, -2]])


def pendulum(damping: float):
    return ct.nlsys(lambda t, x, u, p: [x[1], -np.sin(x[0]) - damping * x[1]], inputs=0, states=2)


def switch():
    """Bistable: two genes that repress each other."""
    return ct.nlsys(lambda t, x, u, p: [-x[0] + 4 / (1 + x[1] ** 2), -x[1] + 4 / (1 + x[0] ** 2)], inputs=0, states=2)


FUNCTIONS = [
    lambda x: [np.sin(x[0]) * x[1], np.cos(x[0] - x[1])],
    lambda x: [np.exp(x[0]) / (2 + x[1] ** 2), x[0] ** 3 - 2 * x[1]],
    lambda x: [np.tanh(x[0] * x[1]), np.arctan(x[0]) + 1.5 - x[1]],
    lambda x: [np.sqrt(10 + x[0]) ** 3, np.log(10 + x[1]) * x[0] ** -2.0 if False else x[0]],
    lambda x: [np.cosh(x[0]) - np.sinh(x[1]), abs(x[0] + 7) * x[1]],
    lambda x: np.array([[1, 2], [3, 4]]) @ np.sin(x),
]


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, len(FUNCTIONS) - 1),
    st.lists(st.floats(-3, 3), min_size=2, max_size=2),
    st.floats(0, 2),
    st.integers(0, 9),
)
def test_enclosures_hold_difference_quotients(which, lower, width, seed):
    function = FUNCTIONS[which]
    low, high = np.array(lower), np.array(lower) + width
    inner, outer = jacobian_enclosure(function, low, high)
    rng = np.random.default_rng(seed)
    x = low + rng.random(2) * width
    for i in range(2):
        step = np.zeros(2)
        step[i] = 1e-6
        slope = (np.asarray(function(x + step)) - np.asarray(function(x - step))) / 2e-6
        assert (inner[:, i] <= slope + 1e-4).all() and (slope - 1e-4 <= outer[:, i]).all()


def test_damped_pendulum_contracts_on_a_range_of_angles():
    cert = differential_positivity(pendulum(3.0), DAMPED, [[-1.5, 1.5], [-9, 9]])
    assert cert and cert.source == "enclosed" and cert.v is not None and cert.check()
    assert "monotone" in cert.explain() and "contracts" in cert.explain()
    whole = differential_positivity(pendulum(3.0), DAMPED, [[-3.2, 3.2], [-9, 9]])
    assert whole.status is kp.Status.REFUTED and whole.check()
    assert "at x = (" in whole.explain()


def test_duffing_oscillator_with_damping_is_strictly_monotone():
    duffing = ct.nlsys(lambda t, x, u, p: [x[1], x[0] - x[0] ** 3 - 6 * x[1]], inputs=0, states=2)
    cert = differential_positivity(duffing, kp.PolyhedralCone([[1, 0.5], [1, -3]]), [[-1.4, 1.4], [-2, 2]])
    assert cert and cert.is_strict and cert.v is None  # two stable equilibria: it cannot contract
    assert "almost every bounded trajectory" in cert.explain()


def test_consensus_with_repulsive_links():
    # second-order consensus in the coordinates of kp's damped cone, a weak repulsive link 0-2
    L = np.array([[1, -1, 0.05], [-1, 2, -1], [0.05, -1, 1.0]])
    L = L - np.diag(L.sum(axis=1))
    vertices = []
    for strength in (0.8, 1.2):
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [-strength * L - 0.1 * np.eye(3), -6 * np.eye(3)]])
        vertices.append(A)
    found = kp.find_cone(vertices, time_limit=30)
    assert found
    cert = differential_positivity(vertices, found.cone)
    assert cert and cert.source == "vertices"


def test_bistable_switch_is_monotone_in_a_mixed_order():
    order = kp.PolyhedralCone([[1, 0], [0, -1]])
    closed = differential_positivity(switch(), order, [[0, 5], [0, 5]])
    assert closed and not closed.is_strict and closed.margin == 0
    inner = differential_positivity(switch(), order, [[0.1, 5], [0.1, 5]])
    assert inner and inner.is_strict and inner.v is None
    assert not differential_positivity(switch(), kp.orthant(2), [[0.1, 5], [0.1, 5]])


def test_swing_equations_with_small_angle_differences():
    def swing(t, x, u, p):
        angle, speed = x[:2], x[2:]
        pull = np.sin(angle[1] - angle[0])
        return [speed[0], speed[1], pull - 8 * speed[0], -pull - 8 * speed[1]]

    machine = ct.nlsys(swing, inputs=0, states=4)
    step = np.kron([[0, 1], [1, -4]], np.eye(2))
    cert = differential_positivity(machine, kp.PolyhedralCone(step), [[-0.7, 0.7], [-0.7, 0.7], [-3, 3], [-3, 3]])
    assert cert and cert.source == "enclosed"
    wide = differential_positivity(machine, kp.PolyhedralCone(step), [[-1.5, 1.5], [-1.5, 1.5], [-3, 3], [-3, 3]])
    assert wide.status is kp.Status.REFUTED


def test_sampling_is_never_a_proof():
    opaque = ct.nlsys(lambda t, x, u, p: [x[1], -math.sin(x[0]) - 3 * x[1]], inputs=0, states=2)
    cert = differential_positivity(opaque, DAMPED, [[-1.5, 1.5], [-9, 9]])
    assert cert.source == "sampled" and cert.status is kp.Status.UNDECIDED
    assert "201 of 201" in cert.explain() or "200 of 200" in cert.explain()
    assert not replace(cert, status=kp.Status.PROVED).check()


def test_inputs_are_held_or_enclosed():
    pushed = ct.nlsys(lambda t, x, u, p: [-x[0] + u[0] * x[1], -x[1] + x[0]], inputs=1, states=2)
    box = [[-1, 1], [-1, 1]]
    assert differential_positivity(pushed, kp.orthant(2), box)
    assert differential_positivity(pushed, kp.orthant(2), box, inputs=[[0, 2]])
    assert not differential_positivity(pushed, kp.orthant(2), box, inputs=[[-1, 2]])


@pytest.mark.parametrize(
    "rate", [lambda t: t, lambda t: 1 + np.sin(t), lambda t: -t / 2, lambda t: 1.0 if t < 1 else 2.0, math.sqrt]
)
def test_systems_that_depend_on_time_are_refused(rate):
    driven = ct.nlsys(lambda t, x, u, p: [x[1] - rate(t) * x[0], x[0] - 3 * x[1]], inputs=0, states=2)
    with pytest.raises(DataError, match="depends on time"):
        differential_positivity(driven, kp.orthant(2), [[0, 1], [0, 1]])
    as_input = ct.nlsys(lambda t, x, u, p: [x[1] - u[0] * x[0], x[0] - 3 * x[1]], inputs=1, states=2)
    assert differential_positivity(as_input, kp.orthant(2), [[0, 1], [0, 1]], inputs=[[0, 2]])


def test_consequences_in_words():
    # strictly monotone, not contracting: one equilibrium for the flow, cycles for the map
    growth = [[1.5, 0.5], [0.5, 1.5]]
    flow = differential_positivity([[0.5, 1], [1, 0.5]], kp.orthant(2))
    assert flow.is_strict and "converges to an equilibrium" in flow.explain()
    step = differential_positivity(growth, kp.orthant(2), discrete=True)
    assert step.is_strict and "cycle" in step.explain() and "equilibrium" not in step.explain()
    weak = differential_positivity([[0.5, 0], [1, 0.5]], kp.orthant(2))
    assert weak and not weak.is_strict and weak.explain().endswith("in the region.")
    slow = differential_positivity([[-2, 1], [1, -2]], kp.orthant(2))
    assert "contracts" in slow.explain() and slow.v is not None


def test_linear_and_discrete_systems():
    assert differential_positivity(ct.ss([[-1, 1], [1, -3]], [[1], [0]], [[1, 0]], 0), kp.orthant(2))
    assert differential_positivity([[0.5, 0.1], [0.2, 0.3]], kp.orthant(2), discrete=True)
    assert not differential_positivity([[-0.5, 0.1], [0.2, 0.3]], kp.orthant(2), discrete=True)


def test_perturbed_certificates_fail(tmp_path):
    cert = differential_positivity(pendulum(3.0), DAMPED, [[-1.5, 1.5], [-9, 9]])
    assert not replace(cert, v=-cert.v).check()
    assert not replace(cert, radii=cert.radii + 5.0).check()
    cert.save(tmp_path / "pendulum.json")
    assert kp.load_certificate(tmp_path / "pendulum.json").status is kp.Status.PROVED


def test_bad_input_is_named():
    with pytest.raises(ConeMismatchError, match="2 states, but X has dimension 3"):
        differential_positivity(pendulum(1.0), kp.orthant(3), [[0, 1]] * 2)
    with pytest.raises(DataError, match="region is missing"):
        differential_positivity(pendulum(1.0), kp.orthant(2))
    with pytest.raises(ShapeError, match=r"region has shape \(1, 2\)"):
        differential_positivity(pendulum(1.0), kp.orthant(2), [[0, 1]])
    with pytest.raises(DataError, match="lower bound exceeds"):
        differential_positivity(pendulum(1.0), kp.orthant(2), [[1, 0], [0, 1]])
    singular = ct.nlsys(lambda t, x, u, p: [1 / x[0], -x[1]], inputs=0, states=2)
    with pytest.raises(DataError, match="unbounded"):
        differential_positivity(singular, kp.orthant(2), [[-1, 1], [0, 1]])
    with pytest.raises(ShapeError, match="empty"):
        differential_positivity([], kp.orthant(2))
