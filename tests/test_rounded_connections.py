"""Connections are rounded towards their cones, by units in the last place."""

import control as ct
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from strategies import cone_of, frame, inverse

import control_kpos as kp
from control_kpos.exact.intake import exact_matrix
from control_kpos.systems.rounding import maps_into, rounded_into

# Many operations, each with a property of its own.


# -- rounding towards cones


def test_connections_touching_the_boundary_are_rounded_to_the_right_side():
    # B on the ray (1, -3) of X; fl(3 * 0.1) > 3 * fl(0.1) moves B C out of X
    X = kp.PolyhedralCone([[0, 1], [1, -3]])
    outer = kp.ConeStateSpace([[-1, 0], [0, -1]], [[1], [-3]], [[1, 0]], 0, X=X)
    inner = kp.ConeStateSpace([[-1]], [[1]], [[0.1]], 0)
    python_control = ct.StateSpace(outer) * ct.StateSpace(inner)
    assert not kp.ConeStateSpace(python_control, X=kp.orthant(1) * X).is_cone_positive()
    for result in (outer * inner, outer * np.array([[0.1]]), 0.1 * outer, outer.feedback(inner, 1)):
        assert result.is_cone_positive()
    np.testing.assert_allclose((outer * inner).A, python_control.A, atol=1e-15)
    outward = kp.ConeStateSpace(outer.A, [[1], [-3 - 2.0**-51]], outer.C, 0, X=X)
    assert not outward.is_cone_positive()
    np.testing.assert_array_equal((outward * 0.1).B, outward.B * 0.1)  # nothing to restore


def test_powers_of_systems_on_thin_cones_stay_positive():
    # where a cone is thin, last digits may not suffice; then fractions take over
    rng = np.random.default_rng(1)
    for _ in range(60):
        T, V = np.eye(3), np.eye(3)
        while min(abs(np.linalg.det(T)), abs(np.linalg.det(V))) < 1.5:
            T, V = rng.integers(-7, 8, (2, 3, 3)).astype(float)
        X, U = kp.PolyhedralCone(T.T), kp.PolyhedralCone(V.T)
        P, Q, R, S = rng.random((4, 3, 3)) * (rng.random((4, 3, 3)) < 0.5)
        A = rounded_into(T @ (P - 2 * np.eye(3)) @ np.linalg.inv(T), X, X, flow=True)
        B = rounded_into(T @ Q @ np.linalg.inv(V), U, X)
        C = rounded_into(V @ R @ np.linalg.inv(T), X, U)
        D = rounded_into(V @ S @ np.linalg.inv(V), U, U)
        assert not any(M is None for M in (A, B, C, D))
        s = kp.ConeStateSpace(A, B, C, D, X=X, U=U, Y=U)
        assert s.is_cone_positive()
        assert (s**3).is_cone_positive()


def test_loops_of_direct_terms_are_rounded_to_the_right_side():
    rng = np.random.default_rng(1)
    for _ in range(100):
        D1, D2 = (rng.random((3, 3)) * (rng.random((3, 3)) < 0.6) * 0.6 for _ in range(2))
        one, other = kp.ConeStateSpace([], [], [], D1), kp.ConeStateSpace([], [], [], D2)
        loop = one.feedback(other, 1)
        radius = np.abs(np.linalg.eigvals(D2 @ D1)).max()
        assert isinstance(loop, kp.ConeStateSpace) == (radius < 1)
        assert radius >= 1 or loop.is_cone_positive()


@given(st.data())
def test_rounding_moves_by_units_in_the_last_place(data):
    n = data.draw(st.integers(1, 3))
    T = data.draw(frame(n))
    P = np.array(data.draw(st.lists(st.floats(0, 1), min_size=n * n, max_size=n * n))).reshape(n, n)
    M = expm(T @ (P - np.eye(n)) @ inverse(T))
    X = cone_of(T)
    rounded = rounded_into(M, X, X)
    assert rounded is not None
    assert maps_into(exact_matrix(rounded, "M"), X, X)
    assert np.abs(rounded - M).max() <= 1e-11 * np.abs(M).max()


def test_rounding_gives_up_on_what_is_really_outside():
    X = kp.PolyhedralCone([[0, 1], [1, -2]])
    assert rounded_into(np.array([[0.0, -1.0], [1.0, 0.0]]), X, X) is None
    assert rounded_into(np.array([[1.0, -1.0], [1.0, 0.0]]), kp.orthant(2), kp.orthant(2)) is None
    assert rounded_into(np.array([[-1.0, -1.0], [1.0, -2.0]]), kp.orthant(2), kp.orthant(2), flow=True) is None


def test_rounding_keeps_zeros_between_orthants():
    M = np.array([[1.0, -1e-18], [0.0, 2.0]])
    np.testing.assert_array_equal(rounded_into(M, kp.orthant(2), kp.orthant(2)), [[1, 0], [0, 2]])
    flow = rounded_into(M - 3 * np.eye(2), kp.orthant(2), kp.orthant(2), flow=True)
    np.testing.assert_array_equal(flow, [[-2, 0], [0, -1]])


def test_a_direct_term_that_is_rounding_alone_is_zero():
    s = kp.ConeStateSpace([[-3.0, 0], [3, 0]], [[1], [-1]], [[1, 1]], 0, X=[[1, -1], [0, 1]])
    for method in ("zoh", "foh"):
        d = s.sample(0.01, method)
        assert d.is_cone_positive() and abs(d.D).max() == 0
    assert rounded_into(np.array([[-1e-18]]), kp.orthant(1), kp.orthant(1)) is None
    assert rounded_into(np.array([[-1e-18]]), kp.orthant(1), kp.orthant(1), size=1.0) == 0


def test_thin_cones_move_no_digit_that_fractions_know():
    s = kp.ConeStateSpace(
        [[0, 0, 0], [-1, 0, 1], [1, 0, -1]], np.zeros((3, 1)), np.zeros((1, 3)), 0, X=[[1, 0, 1], [0, 1, 0], [0, -1, 1]]
    )
    z = s.similarity_transform([[1, 2, 1], [0, 1, -2], [0, -2, 5]], 2)
    np.testing.assert_array_equal(z.A, [[-0.5, 7, 3], [-1.5, 21, 9], [3.5, -49, -21]])
    assert z.is_cone_positive()
