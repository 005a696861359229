"""Several vertices under one gain, with a common vector of either kind; modes with a gain each."""

from dataclasses import replace
from fractions import Fraction

import control as ct
import cvxpy as cp
import numpy as np
import pytest

import control_kpos as kp

# x = (1, 1.1) is mapped inwards by both; a common v would need v1 > 3 v2 and v1 < 1.25 v2.
WITH_X = [[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]]
# Their transposes: v = (1, 1.1), and no common x.
WITH_V = [np.transpose(A).tolist() for A in WITH_X]
# Each of these modes needs another gain: one F for both leaves X.
MODES = [([[1, 1], [1, -3]], [[1], [0]]), ([[-3, 1], [1, 1]], [[0], [1]])]
PLANT = kp.ConeStateSpace(*MODES[0], np.eye(2), np.zeros((2, 1)))


def idle(family, inputs=(0, 0)):
    """A plant whose vertices are these matrices, with inputs that need not be used."""
    B = np.array(inputs, dtype=float)[:, None]
    plant = kp.ConeStateSpace(family[0], B, np.eye(2), np.zeros((2, 1)))
    return plant, [(A, B) for A in family]


@pytest.mark.parametrize("inputs", [(0, 0), (1, 0)])
@pytest.mark.parametrize("method", ["auto", "first", "alternation"])
def test_a_family_with_x_and_without_v(method, inputs):
    plant, vertices = idle(WITH_X, inputs)
    d = kp.state_feedback(plant, vertices=vertices, rate="1/3", method=method)
    common = d.certificate.others[-1]
    assert d and d.check() and not common.is_dual(d.certificate.loops)
    for A, B in vertices:
        assert ((np.array(A) + B @ d.F + np.eye(2) / 3) @ common.x <= 0).all()
    assert "one vector x inside X" in d.explain()


@pytest.mark.parametrize("inputs", [(0, 0), (1, 0)])
@pytest.mark.parametrize("method", ["auto", "first", "alternation"])
def test_a_family_with_v_and_without_x(method, inputs):
    plant, vertices = idle(WITH_V, inputs)
    d = kp.state_feedback(plant, vertices=vertices, rate="1/3", method=method)
    common = d.certificate.others[-1]
    assert d and d.check() and common.is_dual(d.certificate.loops)
    for A, B in vertices:
        assert (common.x @ (np.array(A) + B @ d.F + np.eye(2) / 3) <= 0).all()
    assert "one v inside X*" in d.explain() and "one vector x" not in d.explain()
    slower = replace(common, x=common.x[::-1] * [1, 4])
    assert not slower.check() and not replace(d.certificate, others=(slower,)).check()


def test_weak_actuators_keep_a_common_v():
    plant, vertices = idle(WITH_V, (1, 0))
    d = kp.state_feedback(plant, vertices=vertices, rate=0.9, gain_bound=50)
    assert d and 0 < d.certified_fraction < 1
    v = d.certificate.others[-1].x
    for A, B in vertices:
        assert (v @ (np.array(A) + d.certified_fraction * B @ d.F + 0.9 * np.eye(2)) <= 1e-12).all()


def test_what_is_refuted_is_a_common_x():
    """F = 0 keeps the hull Metzler and Hurwitz; there is neither a common x nor a common v."""
    plant, vertices = idle([[[-1, 1.5], [0.1, -1]], [[-1, 0.1], [1.5, -1]]])
    d = kp.state_feedback(plant, vertices=vertices)
    assert d.status is kp.Status.REFUTED and d.check()
    assert "No gain with a common vector x inside X for all vertices" in d.explain()
    assert "common v in X*" in d.explain() and "is not excluded" in d.explain()


# -- modes


def test_each_mode_has_its_gain():
    assert kp.state_feedback(PLANT, vertices=MODES).status is kp.Status.REFUTED
    d = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, rate="1/3")
    assert d and d.check() and d.F.shape == (2, 1, 2) and (d.K == -d.F).all() and d.law == "u = F_s x"
    assert d.value <= (1 + 1e-3) * 4 / 3 and 1.333 < d.limit <= 4 / 3  # 1 - f <= -1/3 at the first generator
    x = d.certificate.others[-1].x
    for (A, B), F, loop in zip(MODES, d.F, d.closed_loop, strict=True):
        M = np.array(A) + np.array(B) @ F
        np.testing.assert_allclose(loop.A, M, atol=1e-12)
        assert loop.is_cone_positive() and ((M + np.eye(2) / 3) @ x <= 1e-12).all()
        np.testing.assert_array_equal(loop.B, B)


def test_switching_among_closed_loops_decays():
    d = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, rate=0.5)
    x, level = d.certificate.others[-1].x, []
    state = np.array(x)
    for s in np.random.default_rng(0).integers(0, 2, 40):
        response = ct.initial_response(ct.ss(d.closed_loop[s]), [0, 0.1], state)
        state = response.states[:, -1]
        level.append((state / x).max())
    assert (np.array(level) <= np.exp(-0.5 * 0.1 * np.arange(1, 41)) + 1e-9).all()


def test_demands_are_about_every_mode():
    bounded = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, gain_bound=1.5, ports=True)
    assert bounded and (np.abs(bounded.F) <= 1.5).all() and bounded.check()
    tight = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, gain_bound=0.9)
    assert tight.status is kp.Status.REFUTED and tight.check()
    own = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, constraints=lambda F: [F[0, 0] == 2 * F[1, 1]])
    assert own and own.F[0, 0, 0] == pytest.approx(2 * own.F[1, 0, 1])
    first = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, structure=[[True, False]])
    assert first.status is kp.Status.REFUTED
    inside = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, state_bounds=[1, 1], input_bounds=2.5)
    assert inside and inside.check()
    assert (np.abs(inside.F).sum(axis=-1) <= 2.5).all()
    norm = kp.state_feedback(PLANT, vertices=MODES, per_mode=True, objective=lambda F: cp.sum_squares(F))
    assert norm and norm.F.shape == (2, 1, 2)


def test_inputs_of_modes_are_told_by_mode():
    modes = [([[1, 1], [1, -3]], [[1, 0], [0, 1]]), ([[-3, 1], [1, 1]], [[0, 1], [1, 0]])]
    for names, told in (({"inputs": ["left", "right"]}, "left of mode 1"), ({}, "input 0 of mode 1")):
        plant = kp.ConeStateSpace(*modes[0], np.eye(2), np.zeros((2, 2)), **names)
        d = kp.state_feedback(plant, vertices=modes, per_mode=True, gain_bound=[2, 0.5])
        assert d and d.check()
        tight = kp.state_feedback(plant, vertices=modes, per_mode=True, gain_bound=0.5)
        assert tight.status is kp.Status.REFUTED and f"input 2 is {told}." in tight.explain()


def test_modes_by_a_common_v():
    """Inputs that act nowhere: the family with a common v alone."""
    plant, vertices = idle(WITH_V)
    d = kp.state_feedback(plant, vertices=vertices, per_mode=True)
    assert d and d.check() and d.certificate.others[-1].is_dual(d.certificate.loops)


def test_exact_modes():
    vertices = [([["-1/3"]], [[0]]), ([[-1]], [[0]])]
    plant = kp.ConeStateSpace([["-1/3"]], [[0]], [[1]], 0)
    d = kp.state_feedback(plant, vertices=vertices, per_mode=True, rate="1/3")
    assert d and d.closed_loop[0].exact.A.fractions()[0, 0] == Fraction(-1, 3)
    assert d.certificate.others[-1].required_rate == Fraction(1, 3)


def test_names_and_discrete_time():
    plant = kp.ConeStateSpace([[1.2]], [[1]], [[1]], 0, 0.1, inputs=["pump"], states=["level"])
    d = kp.state_feedback(plant, vertices=[([[1.2]], [[1]]), ([[0.5]], [[-1]])], per_mode=True, rate=0.25)
    assert d and all(loop.input_labels == ["pump"] and loop.state_labels == ["level"] for loop in d.closed_loop)
    assert all(abs(loop.A[0, 0]) <= 0.75 for loop in d.closed_loop)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({}, "per_mode needs vertices"),
        ({"vertices": MODES[:1]}, "per_mode needs vertices"),
        ({"vertices": MODES, "disturbance": ([[1], [1]], [[1, 0]], [[1]])}, "without H"),
        ({"vertices": MODES, "per_mode": "yes"}, "per_mode"),
    ],
)
def test_wrong_arguments(keywords, message):
    with pytest.raises(kp.DataError, match=message):
        kp.state_feedback(PLANT, **{"per_mode": True, **keywords})


def test_outputs_that_depend_on_the_mode_are_refused():
    through = kp.ConeStateSpace(*MODES[0], np.eye(2), [[1], [0]])
    with pytest.raises(kp.DataError, match="needs D = 0"):
        kp.state_feedback(through, vertices=MODES, per_mode=True, ports=True)
    d = kp.state_feedback(through, vertices=MODES, per_mode=True)
    np.testing.assert_allclose(d.closed_loop[1].C, np.eye(2) + np.array([[1], [0]]) @ d.F[1])
