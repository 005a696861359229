"""Static output feedback and positive observers."""

import control as ct
import numpy as np
import planted
import pytest

import control_kpos as kp


@pytest.mark.parametrize(("n", "m", "q"), [(2, 1, 1), (3, 2, 2), (4, 2, 3)])
def test_planted_output_gains_are_found(n, m, q):
    rng = np.random.default_rng(n)
    found = 0
    for _ in range(10):
        A, B, C, rays, _ = planted.output(rng, n, m, q)
        d = kp.output_feedback(ct.ss(A, B, C, 0), X=rays)
        found += bool(d)
        if d:
            assert d.check() and d.F.shape == (m, q)
            assert np.linalg.eigvals(A + B @ d.F @ C).real.max() < 0
            np.testing.assert_allclose(d.closed_loop.A, A + B @ d.F @ C, rtol=1e-12, atol=1e-12)
    assert found >= 9


def test_structure_of_an_output_gain():
    rng = np.random.default_rng(0)
    A, B, C, rays, K = planted.output(rng, 3, 2, 2)
    mask = np.array([[True, False], [False, True]])
    A = A + B @ (K * ~mask) @ C  # what is left for the gain to do keeps the pattern
    d = kp.output_feedback(ct.ss(A, B, C, 0), X=rays, structure=mask)
    assert d and not d.F[~mask].any()


def test_impossible_output_feedback_is_refuted():
    d = kp.output_feedback(ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0))
    assert d.status is kp.Status.REFUTED and d.check()


def test_feedthrough_is_refused():
    with pytest.raises(kp.DataError, match="D = 0"):
        kp.output_feedback(ct.ss([[-1.0]], [[1.0]], [[1.0]], [[1.0]]))


@pytest.mark.parametrize(("n", "q"), [(2, 1), (3, 2), (5, 3)])
def test_planted_observers_are_found(n, q):
    rng = np.random.default_rng(q)
    for _ in range(10):
        # the dual of a planted state feedback
        At, Ct, facets, _ = planted.simplicial(rng, n, q)
        X = kp.PolyhedralCone.from_facets(facets)
        sys = ct.ss(At.T, np.ones((n, 1)), Ct.T, 0)
        d = kp.observer_gain(sys, X=X)
        assert d and d.check() and d.F.shape == (n, q)
        error = At.T + d.F @ Ct.T
        assert kp.linear_lyapunov(error, X)
        np.testing.assert_allclose(d.closed_loop.A, error, rtol=1e-12, atol=1e-12)


def test_observer_bounds_the_state_from_above():
    plant = ct.ss([[-1, 1], [0.5, -2]], [[1], [0]], [[1, 0]], 0)
    d = kp.observer_gain(plant, rate=1)
    assert d and d.decay_rate >= 1
    time = np.linspace(0, 8, 200)
    u = np.abs(np.sin(time))
    truth = ct.forced_response(plant, time, u, [1, 1])
    seen = ct.forced_response(d.closed_loop, time, np.vstack([u, truth.outputs]), [3, 2])
    gap = seen.states - truth.states
    assert (gap >= -1e-3).all() and gap[:, -1].max() < 1e-2


def test_hopeless_observer_is_refuted():
    d = kp.observer_gain(ct.ss([[1, 0], [0, -1]], [[1], [1]], [[0, 1]], 0))
    assert d.status is kp.Status.REFUTED and d.check()


def test_results_speak_of_the_law_they_are_for():
    plant = kp.ConeStateSpace([[1, 0], [1, -1]], [[1], [0]], [[1, 0]], 0)
    design = kp.output_feedback(plant)
    assert "u = F y" in design.explain() and "|F C x_k|" in design.objective
    A, B, C, _ = ct.ssdata(plant)
    assert np.linalg.eigvals(A - B @ design.K @ C).real.max() < 0  # K is for u = -K y
    observer = kp.observer_gain(plant)
    assert "C z - y" in observer.explain() and "sensors" in observer.explain()
    assert "controllable" not in observer.explain() and "actuator" not in observer.explain()
    blind = kp.observer_gain(kp.ConeStateSpace([[-1, 0], [1, 1]], [[1], [0]], [[1, 0]], 0))
    assert blind.status is kp.Status.REFUTED and "mode 1 is not observable" in blind.explain()


def test_an_observer_has_l():
    seen, hidden = ([[1, 1], [0.5, -2]], [[1, 0]]), ([[0, 1], [-1, 0]], [[0, 1]])
    found, refused = (kp.observer_gain(ct.ss(A, [[1], [0]], C, 0)) for A, C in (seen, hidden))
    np.testing.assert_array_equal(found.L, found.F)
    assert "L (C z - y)" in found.explain() and kp.state_feedback(ct.ss([[-1]], [[1]], [[1]], 0)).L is None
    assert refused.status == "REFUTED" and "any L" in refused.explain() and "any F" not in refused.explain()
