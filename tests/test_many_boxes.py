"""Jacobians of one function at many nodes at once: as at each node alone, and nothing that mixes nodes is taken."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control_kpos.exact.jacobians import jacobian_blocks, jacobian_enclosure
from control_kpos.exact.unreadable import UnboundedError, UnsupportedError

GAINS = np.array([0.5, 1.0, 2.0])
POWERS = np.array([2.0, 2.5, 4.0])
# Functions of one node, for all nodes; p are numbers of the node.
FUNCTIONS = [
    lambda x, p: [p * x[0] / (1 + x[0]) - x[1], np.sin(x[0] * x[1]) + p],
    lambda x, p: np.array([x[1] ** 2 / (p + x[1] ** 2) - x[0], np.exp(-p * x[0]) * x[1]]),
    lambda x, p: (np.tanh(x[0] - p * x[1]), np.arctan(x[1] / p) + np.maximum(x[0], p)),
    lambda x, p: [np.hypot(x[0], 1.0) * p, np.log1p(x[0]) + np.sqrt(1 + x[1]) - np.cbrt(2 + x[1])],
    lambda x, p: np.stack([x[0] * (1 - x[0] / p) - x[0] * x[1], x[1] ** 1.5 - np.clip(x[1], p / 2, 2 * p)]),
    lambda x, p: [np.logaddexp(x[0], p * x[1]), np.minimum(2.0 ** x[0], 3) + abs(x[1] - p) + np.cos(p * x[0])],
    lambda x, p: [np.power(x[0], p + 1) - x[1], np.reciprocal(1 + x[0]) + np.expm1(-x[1]) - 3 * (x[0] - x[0])],
    lambda x, p: [sum(row * p for row in x), -np.square(x[0]) / p + np.log2(1 + x[1]) * np.float64(2) - 1],
    lambda x, p: [
        np.where(x[0] > p, p, x[0]),
        np.where((x[1] > p / 2) | (x[1] < 0.25), 0, x[1] - x[1]) + (x[1] > p) * 0.0,
    ],
    lambda x, p: [
        np.select([x[0] < p / 2, x[0] < p], [p / 2, x[0]], p),
        (x[1] - p) * (x[1] > p),
    ],
    lambda x, p: [x[0] ** (p + 1) / (1 + x[0] ** (p + 1)), np.arcsinh(x[1]) * np.cosh(p) + 0 * x[0]],
]


@pytest.mark.parametrize("function", FUNCTIONS)
@settings(max_examples=8)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 1e-6, 0.4]))
def test_blocks_hold_exact_slopes_and_are_those_of_each_node(function, seed, width):
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 1.5, (2, 3)).round(3)
    high = low + width
    below, above = jacobian_blocks(lambda x: function(x, GAINS), low, high, 2)
    assert below.shape == above.shape == (3, 2, 2)
    for node, gain in enumerate(GAINS):
        a, b = jacobian_enclosure(lambda x, g=float(gain): function(x, g), low[:, node], high[:, node])
        room = 1e-9 * (1 + np.abs(a) + np.abs(b))
        assert (np.abs(below[node] - a) <= room).all() and (np.abs(above[node] - b) <= room).all()
        x = low[:, node] + rng.random(2) * (high - low)[:, node]
        for i in range(2):
            step = 1e-6 * np.eye(2)[i]
            with np.errstate(all="ignore"):
                slope = (np.asarray(function(x + step, gain)) - np.asarray(function(x - step, gain))) / 2e-6
            off = np.maximum(below[node][:, i] - slope, slope - above[node][:, i])
            assert (off[~np.isnan(off)] <= 1e-4 * (1 + abs(slope[~np.isnan(off)]))).all()


def test_a_hundred_thousand_nodes():
    N = 10**5
    rng = np.random.default_rng(0)
    rate, low = rng.uniform(0.5, 2, N), rng.uniform(0, 1, (3, N))

    def node(x):
        """A state with saturation, one with a Hill function, and an input."""
        hill = x[0] ** 4 / (rate + x[0] ** 4)
        return [-rate * x[0] + np.tanh(x[1]) + x[2], hill - np.exp(-x[1]) - np.sin(x[0] - x[1])]

    below, above = jacobian_blocks(node, low, low + 0.1, 3)
    assert below.shape == (N, 2, 3) and (below <= above).all()
    assert (below[:, 0, 0] == -rate).all() and (above[:, 0, 0] == -rate).all()  # what is typed is exact
    assert (below[:, 0, 2] == 1).all() and (above[:, 1, 2] == 0).all()
    x = low + 0.05
    power = x[0] ** 4
    slopes = {
        (0, 1): 1 / np.cosh(x[1]) ** 2,
        (1, 0): 4 * x[0] ** 3 * rate / (rate + power) ** 2 - np.cos(x[0] - x[1]),
        (1, 1): np.exp(-x[1]) + np.cos(x[0] - x[1]),
    }
    for (i, j), slope in slopes.items():
        assert (below[:, i, j] < slope).all() and (slope < above[:, i, j]).all()
        assert np.median(above[:, i, j] - below[:, i, j]) < 0.7


def test_values_that_do_not_depend_on_the_node_or_on_anything():
    below, above = jacobian_blocks(lambda x: [x[0], 3.0, 2 * x[1] - 0 * x[0]], np.zeros((2, 4)), np.ones((2, 4)), 1)
    assert (below == above).all() and below[0].tolist() == [[1.0], [0.0], [0.0]] and below.shape == (4, 3, 1)


MIXED = {
    "sum of all": lambda x: [np.sum(x), x[1]],
    "sum of a row": lambda x: [np.sum(x[0]), x[1]],
    "sum by reduce": lambda x: [np.add.reduce(x[0]), x[1]],
    "mean": lambda x: [np.mean(x[0]) - x[0], x[1]],
    "method": lambda x: [x[0].sum(), x[1]],
    "neighbour": lambda x: [np.roll(x[0], 1), x[1]],
    "index": lambda x: [x[0][0] + x[0], x[1]],
    "two indices": lambda x: [x[0, 1] + x[0], x[1]],
    "matrix": lambda x: np.ones((2, 2)) @ x,
    "row by matrix": lambda x: [x[0] @ np.ones((2, 2)), x[1]],
    "whole array": lambda x: 2 * x,
    "function of the whole array": lambda x: np.sin(x),
    "array of rows times an array": lambda x: np.array([x[0], x[1]]) * np.array([1.0, 2.0]),
    "array of rows": lambda x: np.array([x[0], x[1]]).sum() * np.ones(2),
    "stack of rows": lambda x: np.stack([x[0], x[1]])[::-1] + 0 * x[0],
    "a number for each state": lambda x: [x[0] * np.ones((2, 1)), x[1]],
    "numbers of another shape": lambda x: [x[0] * np.ones(3), x[1]],
    "one number in an array": lambda x: [x[0] * np.ones(1), x[1]],
    "shape": lambda x: [x[0] * x.shape[1], x[1]],
    "cumsum": lambda x: [np.cumsum(x[0]), x[1]],
    "outer": lambda x: [np.add.outer(x[0], x[0]), x[1]],
    "comparison": lambda x: [x[0] if x[0] > 0 else -x[0], x[1]],
    "where with a matrix": lambda x: [np.where(x[0] > 0, x[0], np.zeros((2, 1))), x[1]],
    "where of the whole array": lambda x: np.where(x > 0, x, 0),
    "piecewise": lambda x: [np.piecewise(x[0], [x[0] > 0], [x[0], 0]), x[1]],
    "not finite": lambda x: [x[0] * np.array([1.0, np.nan]), x[1]],
    "in place": lambda x: [np.add(x[0], 1, out=np.zeros(2)), x[1]],
    "only some": lambda x: [np.add(x[0], 1, where=np.array([True, False])), x[1]],
    "text": lambda x: [x[0], str(x[1])],
}


@pytest.mark.parametrize("name", MIXED)
def test_what_mixes_nodes_or_states_is_refused(name):
    """With as many nodes as states: shapes do not tell that something is wrong."""
    with pytest.raises(UnsupportedError):
        jacobian_blocks(MIXED[name], np.full((2, 2), 0.1), np.ones((2, 2)), 2)


def test_refusals_that_the_function_catches():
    def quietly(x):
        with contextlib.suppress(Exception):
            return [x[0].sum(), x[1]]
        return [x[0], x[1]]

    with pytest.raises(UnsupportedError):
        jacobian_blocks(quietly, np.zeros((2, 2)), np.ones((2, 2)), 2)
    with pytest.raises(UnboundedError, match="may be zero"):
        jacobian_blocks(lambda x: [1 / (x[0] - 1), x[1]], np.zeros((2, 2)), np.array([[0.5, 1.0], [1, 1]]), 2)


@pytest.mark.parametrize(
    "name", ["value", "gradient", "line", "known", "_held", "_packed", "_rows", "__slots__", "real"]
)
def test_nothing_can_be_read(name):
    def read(x, how):
        return [how(x[0] if x[0] is not None else x, name), x[1]]

    for how in (object.__getattribute__, lambda y, n: y.__getattribute__(n), lambda y, n: y.__class__):
        for call in (jacobian_blocks, lambda f, a, b, _: jacobian_enclosure(f, a[:, 0], b[:, 0])):
            with pytest.raises(UnsupportedError):
                call(lambda x, how=how: read(x, how), np.zeros((2, 2)), np.ones((2, 2)), 2)
