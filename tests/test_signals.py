"""States, inputs and outputs are called by their names where a text numbers facets, generators and inputs."""

import control as ct
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.cards import Signals

NAMES = {"states": ["plasma", "fast", "slow"], "inputs": ["pump"], "outputs": ["level"]}
A = np.array([[-1.0, 1, 0], [1, -4, 0], [0, 0, -1]])
B, C = np.ones((3, 1)), np.array([[1.0, 0, 0]])


def changed(matrix, place, value):
    out = matrix.copy()
    out[place] = value
    return out


@pytest.mark.parametrize(
    ("matrices", "named"),
    [
        ((changed(A, (1, 0), -3), B, C, 0), "facet 1 is fast, generator 0 is plasma"),
        ((A, changed(B, (2, 0), -1), C, 0), "facet 2 is slow, generator 0 is pump"),
        ((A, B, changed(C, (0, 1), -1), 0), "facet 0 is level, generator 1 is fast"),
        ((A, B, C, [[-1]]), "facet 0 is level, generator 0 is pump"),
    ],
)
def test_broken_positivity_is_told_by_name(matrices, named):
    s = kp.ConeStateSpace(*matrices, **NAMES)
    assert f"By name: {named}." in s.cone_positivity().explain()
    assert f"By name: {named}." in s.dissipativity(q=[-1], r=[1]).explain()
    assert "By name" not in kp.ConeStateSpace(*matrices).cone_positivity().explain()
    other = kp.ConeStateSpace(*matrices, X=[[1, 0, 0], [1, 1, 0], [0, 0, 1]], **NAMES).cone_positivity().explain()
    assert "is plasma" not in other and "is fast" not in other  # no facet of this cone is a state


def test_directions_of_growth_are_told_by_name():
    growing = kp.ConeStateSpace(changed(A, (2, 2), 1.0), B, C, 0, **NAMES)
    assert "By name: x is not 0 at slow." in growing.linear_lyapunov().explain()
    assert Signals(("a",), orthants=frozenset({"states"})).support(np.ones(1)) == ""
    many = Signals(tuple(map(str, range(20))), orthants=frozenset({"states"}))
    assert many.support(np.arange(20.0)).endswith("at 1, 2, 3, 4, 5, 6, 7, 8 and 11 others.")


def test_designs_call_states_and_inputs_by_name():
    plant = kp.ConeStateSpace([[1, 1], [1, -3]], [[1], [-5]], np.eye(2), 0, states=["a", "b"], inputs=["pump"])
    text = kp.state_feedback(plant, gain_bound=1.2).explain()
    assert "By name: facet 1 is b, generator 0 is a, input 0 is pump." in text
    assert "By name" not in kp.state_feedback(kp.ConeStateSpace(plant.A, plant.B, plant.C, 0), gain_bound=1.2).explain()
    sensor = kp.ConeStateSpace(plant.A.T, np.eye(2), plant.B.T, 0, states=["a", "b"], outputs=["meter"])
    observed = kp.observer_gain(sensor, gain_bound=1.2).explain()
    assert "the gain bound on output 0" in observed and "output 0 is meter" in observed and "input" not in observed
    assert "generator 0 is a" in kp.output_feedback(ct.ss(plant), gain_bound=1.2).explain()


def test_optimal_control_calls_them_by_name():
    names = {"states": ["a", "b"], "inputs": ["pump"]}
    plant = kp.ConeStateSpace([[0.5, 0.2], [0.1, 0.5]], [[1], [0]], np.eye(2), 0, True, **names)
    ask = {"s": [1, 1], "r": [0.1], "limits": [[1, 0]]}
    assert "By name: input 0 is pump, facet 0 is a, generator 0 is a." in kp.optimal_feedback(plant, **ask).message
    mixed = kp.optimal_feedback(plant, **ask, controls=[[1]])
    assert "generator 0 is a" in mixed.message and "pump" not in mixed.message  # numbers are of the controls


def test_names_belong_to_the_cone_and_the_inputs_that_are_asked_about():
    names = {"states": ["a", "b"], "inputs": ["pump"]}
    plant = kp.ConeStateSpace([[-1, 0], [0, -1]], [[1], [1]], np.eye(2), 0, **names)
    w = kp.state_feedback(plant, disturbance=([[0], [-1]], [[1, 0]])).explain()
    assert "facet 1 is b." in w and "pump" not in w
    ports = kp.ConeStateSpace(plant.A, -plant.B, plant.C, 0, **names)
    assert "generator 0 is pump" in kp.state_feedback(ports, ports=True).explain()
    ask = {"s": [1, 1], "r": [0.1], "limits": [[1, 0]]}
    other = kp.optimal_feedback(plant, **ask, X=[[1, 0], [1, 1]])
    assert "facet" in other.message and "is a" not in other.message  # no facet of this cone is a state
    assert "generator 0 is a" in kp.optimal_feedback(ct.ss(plant), **ask).message
    turns = ct.ss([[-1, -1], [0, -1]], [[0], [1]], np.eye(2), 0, states=["a", "b"])
    assert "facet 0 is a, generator 1 is b" in kp.order_interval(turns, [1, 1]).explain()


def test_names_are_no_part_of_a_claim(tmp_path):
    s = kp.ConeStateSpace(changed(A, (1, 0), -3), B, C, 0, **NAMES)
    certificate, plain = s.cone_positivity(), kp.ConeStateSpace(s.A, s.B, s.C, 0).cone_positivity()
    assert certificate == plain and certificate.check()
    certificate.save(tmp_path / "c.json")
    loaded = kp.load_certificate(tmp_path / "c.json")
    assert loaded == certificate and "By name" not in loaded.explain()
    assert "plasma" not in (tmp_path / "c.json").read_text()
