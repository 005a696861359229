"""Named plants and networks have the properties they are named for."""

import control as ct
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos import examples


def test_mass_spring_is_an_undamped_oscillator():
    plant = ct.ss(*examples.mass_spring(k=8, m=2))
    np.testing.assert_allclose(sorted(plant.poles().imag), [-2, 2])
    np.testing.assert_allclose(plant.poles().real, 0)


@given(k=st.floats(0.1, 10), m=st.floats(0.1, 10), F1=st.floats(-50, 5), F2=st.floats(-50, 5))
def test_node_is_positive_where_the_paper_says(k, m, F1, F2):
    node = examples.mass_spring_node([F1, F2], k=k, m=m)
    slack = -4 - k / m + F1 - 2 * F2  # section II
    if abs(slack) > 1e-9:
        assert node.is_cone_positive() == (slack > 0)


def test_node_takes_names():
    node = examples.mass_spring_node(name="spring", inputs=["push"])
    assert (node.name, node.input_labels, node.state_labels) == ("spring", ["push"], ["position", "velocity"])


def test_different_nodes_are_positive_and_stable():
    A, B, C, D = examples.mass_spring_nodes(200, seed=3)
    X = examples.paper_cone()
    for Aj, Bj, Cj, Dj in zip(A, B, C, D, strict=True):
        node = kp.ConeStateSpace(Aj, Bj, Cj, Dj, X=X)
        assert node.is_cone_positive()
        assert node.linear_lyapunov()
    assert len(np.unique(A[:, 1, 0])) == len(np.unique(A[:, 1, 1])) == 200
    np.testing.assert_array_equal(A, examples.mass_spring_nodes(200, seed=3)[0])


@pytest.mark.parametrize("n_nodes", [1, 2, 3, 50])
def test_ring_feeds_every_node_the_next_output(n_nodes):
    y = np.arange(n_nodes)
    np.testing.assert_array_equal(examples.ring(n_nodes) @ y, [*y[1:], y[0]])


@given(degree=st.integers(1, 6), extra=st.integers(1, 30), seed=st.integers(0, 10**6))
def test_random_graph_is_simple_and_regular(degree, extra, seed):
    n_nodes = 2 * degree + extra
    n_nodes += n_nodes * degree % 2
    W = examples.random_regular(n_nodes, degree, seed=seed).toarray()
    np.testing.assert_array_equal(W, W.T)
    assert set(np.unique(W)) <= {0, 1}
    assert not W.diagonal().any()
    assert (W.sum(axis=1) == degree).all()


@pytest.mark.parametrize(
    ("function", "arguments", "name"),
    [
        (examples.mass_spring, {"k": 0}, "k"),
        (examples.mass_spring, {"m": -1}, "m"),
        (examples.mass_spring, {"k": np.nan}, "k"),
        (examples.mass_spring, {"k": "soft"}, "k"),
        (examples.mass_spring, {"m": 1j}, "m"),
        (examples.mass_spring_node, {"F": [1, 2, 3]}, "F"),
        (examples.mass_spring_node, {"F": [1, np.inf]}, "F"),
        (examples.mass_spring_nodes, {"n_nodes": 0}, "n_nodes"),
        (examples.ring, {"n_nodes": 2.5}, "n_nodes"),
        (examples.ring, {"n_nodes": True}, "n_nodes"),
        (examples.random_regular, {"n_nodes": 6, "degree": 3}, "n_nodes"),
        (examples.random_regular, {"n_nodes": 9, "degree": 3}, "n_nodes"),
        (examples.random_regular, {"n_nodes": 9, "degree": "3"}, "degree"),
    ],
)
def test_bad_input_is_refused(function, arguments, name):
    with pytest.raises(kp.KposError, match=name):
        function(**arguments)
