"""Functions of nonlinear networks that change what they are given, or do otherwise at another call."""

from typing import Any

import numpy as np
import pytest

import control_kpos as kp
from control_kpos.errors import DataError, ShapeError
from control_kpos.exact.jacobians import jacobian_enclosure

COUPLING = [[0, 0.1], [0.1, 0]]


def decided(f, g=None, coupling=COUPLING, region=(-1, 1), **how) -> Any:
    net = kp.nonlinear_interconnect(kp.nonlinear_nodes(f, g, n_nodes=2, **how), coupling)
    return kp.differential_positivity(net, region=[region])


def state_in_place(x, u, p):
    a = x[0]
    a *= -3  # arrays are changed, intervals are not
    return [u[0] - x[0]]


def input_in_place(x, u, p):
    a = u[0]
    a *= 30
    return [u[0] - x[0]]


def output_in_place(x, p):
    a = x[0]
    a *= 30
    return [x[0]]


def link_in_place(d):
    a = d
    a *= 30
    return d


def decay(x, u, p):
    return [u[0] - x[0]]


@pytest.mark.parametrize("how", ["state", "input", "output", "link"])
def test_what_functions_are_given_is_not_changed(how):
    f = {"state": state_in_place, "input": input_in_place}.get(how, decay)
    links = kp.nonlinear_links(link_in_place, [0, 1], [1, 0], weights=0.1)
    with pytest.raises(DataError, match="fails with numbers"):
        decided(f, output_in_place if how == "output" else None, links if how == "link" else COUPLING)


def test_params_are_not_changed():
    def f(x, u, p):
        p["k"] = -p["k"]
        return [u[0] - p["k"] * x[0]]

    with pytest.raises(DataError, match="cannot be enclosed"):
        decided(f, params={"k": 2.0})


@pytest.mark.parametrize("where", ["f", "g", "link"])
@pytest.mark.parametrize("region", [(-1, 1), (0, 1)])
@pytest.mark.parametrize("last", [1, 2, 3, 4])
def test_every_call_takes_the_same_steps(where, region, last):
    calls = []

    def slope(x):
        calls.append(1)
        return x if len(calls) > last else 0.5 * x

    f = (lambda x, u, p: [u[0] - 2 * slope(x[0])]) if where == "f" else lambda x, u, p: [u[0] - 2 * x[0]]
    g = (lambda x, p: [slope(x[0])]) if where == "g" else None
    links = kp.nonlinear_links(slope, [0, 1], [1, 0], weights=0.1) if where == "link" else COUPLING
    with pytest.raises(DataError, match=r"not in their enclosure|something else than at an earlier call"):
        decided(f, g, links, region)


def test_functions_that_differ_at_random_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match=r"not in their enclosure|something else than at an earlier call"):
        decided(lambda x, u, p: [u[0] - rng.uniform(1, 2) * x[0]])


def test_steady_functions_are_compared_at_no_cost_to_others():
    many = {"k": np.array([1.0, 2.0])}
    assert decided(lambda x, u, p: np.array([u[0] - p["k"] * x[0]]), lambda x, p: (x[0],), params=many).contracts
    assert decided(lambda x, u, p: [u[0] - 3 * x[0]], lambda x, p: np.stack([x[0]])).contracts


def test_a_link_returns_one_value():
    with pytest.raises(ShapeError, match="returned 2 values"):
        decided(decay, None, kp.nonlinear_links(lambda d: [d, 3 * d], [0, 1], [1, 0], weights=0.1))


def test_growth_decides_where_the_first_enclosure_does_not():
    """x^3 / (1 + x + x^3) rises from zero: its slope vanishes there together with its relative growth times it."""
    nodes = kp.nonlinear_nodes(
        lambda x, u, p: [u[0] - 2 * x[0]], lambda x, p: [x[0] ** 3 / (1 + x[0] + x[0] ** 3)], n_nodes=2
    )
    net = kp.nonlinear_interconnect(nodes, COUPLING)
    found: Any = kp.differential_positivity(net, region=[[0, 1]], pieces=1)
    assert found.contracts


def test_angles_of_quantities_that_are_never_zero():
    low, high = jacobian_enclosure(lambda x: [np.arctan2(x[0], np.exp2(x[0]))], [0.3], [0.9])
    x = np.linspace(0.3, 0.9, 50)
    slope = 2**x * (1 - x * np.log(2)) / (x**2 + 4**x)
    assert low[0, 0] <= slope.min() and slope.max() <= high[0, 0]


def test_a_no_is_about_a_node_or_link():
    """x_j' = -2 x_j + x_k / 2, written with two signs that cancel: the flow keeps the order, the parts do not."""
    found = decided(lambda x, u, p: [-u[0] - 2 * x[0]], lambda x, p: [-x[0]], [[0, 0.5], [0.5, 0]])
    assert found.status.name == "REFUTED" and "a node or link does not keep the order" in found.explain()
    assert "judged one by one" in found.explain()
    turned = decided(lambda x, u, p: [u[0] - 2 * x[0]], None, [[0, 0.5], [0.5, 0]])
    assert turned.contracts and "links that do not change in time" in turned.explain()
