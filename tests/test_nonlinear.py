"""Differential positivity: enclosures hold, verdicts say what they rest on."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.errors import ConeMismatchError, DataError, ShapeError
from control_kpos.exact.jacobians import jacobian_enclosure
from control_kpos.exact.unreadable import UnboundedError
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
    lambda x: [x[0] ** 2 / (1 + x[0] ** 2) - (2 * x[1] + 1) / (7 + x[1]), (3 - 0.1 * x[0]) / (x[0] / 3 + 7) * x[1]],
    lambda x: [np.exp(x[0]) / (1 + np.exp(x[0])), x[0] * x[1] / (100 - x[1] * x[0]) - 1 / (2 * (x[1] - 9))],
    lambda x: [(x[0] - x[0] + 1) / (2 + x[1] - x[1]) * x[1], (1 - np.tanh(x[1])) / (3 + 2 * np.tanh(x[1])) / -7],
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


BOX = [[-1, 1], [-1, 1]]


def mode(f, region=None, X=None, **keywords):
    inputs = len(keywords.get("inputs", []))
    system = ct.nlsys(lambda t, x, u, p: f(x) if not inputs else f(x, u), inputs=inputs, states=2)
    return differential_positivity(
        system, kp.orthant(2) if X is None else X, BOX if region is None else region, **keywords
    )


def swallowed(look):
    """True if what is looked at is so; False if not, or if looking fails."""

    def function(x):
        try:
            return bool(look(x))
        except Exception:  # noqa: BLE001 -- as people write it
            return False

    return function


LOOKS = {
    "equal": lambda x: x[1] == 0.3,
    "unequal": lambda x: x[1] != 0.3,
    "all equal": lambda x: (x == 0.3).all(),
    "less": lambda x: x[1] < 0,
    "in": lambda x: x[1] in [0.3, 0.4],
    "dict": lambda x: {0.3: True}[x[1]],
    "hash": lambda x: hash(x[1]) % 2,
    "str": lambda x: str(x[1]).startswith("-"),
    "repr": lambda x: repr(x[1]).startswith("-"),
    "format": lambda x: f"{x[1]:.2f}".startswith("-"),
    "float": lambda x: float(x[1]) < 0,
    "int": lambda x: int(x[1]) < 0,
    "floor": lambda x: math.floor(x[1]) < 0,
    "round": lambda x: round(x[1]) < 0,
    "bool": lambda x: not x[1],
    "isinstance": lambda x: isinstance(x[1], float),
    "class": lambda x: x[1].__class__ is np.float64,
    "type": lambda x: type(x[1]) is np.float64,
    "attribute": lambda x: x[1].real < 0,
    "hasattr": lambda x: hasattr(x[1], "dtype"),
    "coercion": lambda x: np.asarray(x, dtype=float)[1] < 0,
    "sign": lambda x: np.sign(x)[1] < 0,
    "isnan": lambda x: not np.isnan(x[1]),
    "sort": lambda x: np.argsort(x)[0],
    "quotient": lambda x: 1 / x[1] and False,
    "modulo": lambda x: x[1] % 1 > 0.5,
}


@pytest.mark.parametrize("look", LOOKS)
def test_a_function_that_looks_at_its_argument_is_not_enclosed(look):
    branch = swallowed(LOOKS[look])
    for wanted in (True, False):
        cert = mode(lambda x, w=wanted: [-x[0] + (-x[1] if branch(x) is w else x[1]), -x[1]])
        assert cert.status is kp.Status.UNDECIDED and cert.source == "sampled"
        assert "looks at its arguments" in cert.explain()


def test_a_function_that_looks_at_inputs_or_time_is_not_enclosed():
    cert = mode(lambda x, u: [-x[0] - x[1], -x[1]] if u[0] == 0 else [-x[0] + x[1], -x[1]], inputs=[[0, 1]])
    assert cert.source == "sampled" and cert.status is kp.Status.UNDECIDED

    def quietly(t, x, u, p):
        try:
            late = t > 5
        except TypeError:
            late = False
        return [-x[0] - x[1] if late else -x[0] + x[1], -x[1]]

    with pytest.raises(DataError, match="depends on time"):
        differential_positivity(ct.nlsys(quietly, inputs=0, states=2), kp.orthant(2), BOX)


@pytest.mark.parametrize("value", [math.nan, math.inf, None, "a", 1j])
def test_what_is_no_number_is_not_proven(value):
    with pytest.raises(DataError, match=r"x = \(0, 0\)"):
        mode(lambda x: [value, -x[1]])
    with pytest.raises(DataError, match="may be negative"):
        mode(lambda x: [-x[0] + 0 * np.log(x[1] - 7), -x[1]])


@pytest.mark.parametrize(("low", "high", "slope"), [(-1, 0, -1), (0, 1, 1), (-1, 1, 0)])
def test_the_slope_inside_counts_at_a_kink(low, high, slope):
    region = [[0, 1], [low, high]]
    for f, sign in ((lambda x: [-x[0] + abs(x[1]), -x[1]], slope), (lambda x: [-x[0] - abs(x[1]), -x[1]], -slope)):
        cert = mode(f, region)
        assert cert.status is (kp.Status.PROVED if sign > 0 else kp.Status.REFUTED) and cert.check()
        if not cert and cert.witness.point is not None:
            assert cert.witness.point[1] != 0
    # both slopes will do
    for f in (abs, lambda y: np.maximum(y, 0), lambda y: np.minimum(0.0, y), lambda y: np.clip(y, -0.5, 0.2)):
        assert mode(lambda x, f=f: [-x[0] + 2 * x[1] + f(x[1]), -x[1]], region)
    wide = mode(lambda x: [-x[0] - abs(x[1]) + 1000 * (x[1] ** 2 - (x[1] + 0) * x[1]), -x[1]], region)
    assert wide.status is not kp.Status.REFUTED or (high == 1 and wide.witness.point[1] > 0)


def test_there_is_no_slope_at_a_kink_in_a_region_without_width():
    edge = [[0, 1], [0, 0]]
    for sign in (-1, 1):
        assert mode(lambda x, s=sign: [-x[0] + s * abs(x[1]), -x[1]], edge).status is kp.Status.UNDECIDED
        assert mode(lambda x, s=sign: [-x[0] + s * np.maximum(x[1], 0), -x[1]], edge).status is not kp.Status.REFUTED
    assert mode(lambda x: [-x[0] + np.maximum(x[1], 2 * x[1]), -x[1]], edge)
    fixed = mode(lambda x, u: [-x[0] - x[1] + abs(u[0]), -x[1] + np.maximum(u[0], 0)], inputs=[[0, 0]])
    assert fixed.status is kp.Status.REFUTED  # the kink is not in the states
    assert mode(lambda x: [-x[0] - x[1], -x[1]], edge).status is kp.Status.REFUTED


def test_maximum_minimum_and_clip_of_whole_arrays():
    for f in (
        lambda x: np.array([[-2, 1], [1, -2]]) @ np.maximum(x, 0.1),
        lambda x: np.minimum(x, 0.5)[::-1] - 3 * x,
        lambda x: np.clip(x, -0.5, None)[::-1] - 3 * x,
        lambda x: np.mean(copy.deepcopy(x)) - 3 * x,
        lambda x: np.clip(x, -0.5, 0.5)[::-1] - 3 * x,
    ):
        cert = mode(f)
        assert cert and cert.source == "enclosed"
    assert mode(lambda x: -np.minimum(x, 0.5)[::-1] - 3 * x).status is kp.Status.REFUTED


@pytest.mark.parametrize(
    ("f", "reach"),
    [
        (lambda y: y**1.5, 3),
        (lambda y: y**2.5 + y**1.25, 3),
        (lambda y: 2 * y / (1 + y), 100),
        (lambda y: 3 * y**2 / (0.5 + y**2) + y**2.5 / (2 + y**2.5), 50),
        (lambda y: np.minimum(y, 1.0), 2),
        (lambda y: np.sqrt(1 + y), 9),
    ],
)
def test_functions_are_called_inside_the_region_only(f, reach):
    def guarded(x):
        if isinstance(x, np.ndarray) and x.dtype == float:
            assert (x >= 0).all() and (x <= reach).all()
        return [-x[0] + f(x[1]), f(x[0]) - 3 * x[1]]

    region = [[0, reach]] * 2
    cert = mode(lambda x: [-x[0] + f(x[1]), f(x[0]) - 3 * x[1]], region)
    assert cert and cert.source == "enclosed"
    assert mode(lambda x: [-x[0] - f(x[1]), -x[1]], region).status is kp.Status.REFUTED
    assert mode(guarded, region).source == "sampled"  # it tells arrays of numbers from others
    opaque = mode(lambda x: [-math.sqrt(x[0]), math.sqrt(x[0]) - x[1]], region)
    assert opaque.source == "sampled" and opaque.status is kp.Status.UNDECIDED


@pytest.mark.parametrize("f", [np.sqrt, lambda y: y**0.5, lambda y: y**0.75, lambda y: 1 / y, np.log])
def test_unbounded_slopes_are_named(f):
    for region in ([[0, 1]] * 2, [[-1, 1]] * 2):
        with pytest.raises(DataError, match=r"bounded|not finite at x"):
            mode(lambda x: [-x[0], f(x[0]) - x[1]], region)
    assert mode(lambda x: [-x[0], x[0] + 0.01 * f(x[0]) - x[1]], [[0.2, 1]] * 2)


def test_errors_of_the_function_name_the_point():
    def fails(x):
        raise KeyError("speed")

    with pytest.raises(DataError, match=r"fails at x = \(0, 0\): KeyError: 'speed'") as info:
        mode(fails)
    assert isinstance(info.value.__cause__, KeyError)
    with pytest.raises(DataError, match=r"fails at x = \(0, 0\): ZeroDivisionError"):
        mode(lambda x: [1 / float(x[0]) if x[0] else 1 / 0, x[1]])
    with pytest.raises(DataError, match="ValueError: math domain error"):
        mode(lambda x: [math.log(x[0] - 5), x[1]])
    with pytest.raises(ShapeError, match="3 values for 2 states"):
        mode(lambda x: [math.sin(x[0]), x[1], 1])
    with pytest.raises(DataError, match=r"u = \(1\)"):
        mode(lambda x, u: [1 / (1 - int(u[0])), x[1]], inputs=[[1, 1]])


def test_warnings_as_errors_change_nothing():
    functions = [
        lambda x: [-x[0] + np.exp(-1e3 * (2 + x[1])) + x[1] ** 9, -x[1]],
        lambda x: [-x[0] + 1e-320 * x[1] ** 3, -x[1]],
        lambda x: [-x[0] + math.sin(x[1]), -x[1]],
    ]
    for f in functions:
        usual = mode(f)
        with np.errstate(all="raise"):
            strict = mode(f)
        assert usual.status is strict.status and usual.explain() == strict.explain()

    def strictly(x):
        with np.errstate(all="raise"):
            return [-x[0] + 1e-300 * x[1] ** 3, -x[1]]

    assert mode(strictly, [[0, 1], [0.5, 1]])


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10**6))
def test_random_expressions_against_exact_quotients(seed):
    rng = np.random.default_rng(seed)

    def expression(x, depth):
        """A random expression and its value; the same draws for any x."""
        kind = draws.integers(0, 7) if depth else 0
        if kind <= 1:
            return x[draws.integers(0, 2)] * int(draws.integers(1, 4)) + int(draws.integers(0, 3))
        a = expression(x, depth - 1)
        if kind == 2:
            return a**2
        if kind == 3:
            return a / (1 + a * int(draws.integers(1, 4)))
        b = expression(x, depth - 1)
        return [a + b, a * b, a / (b + 1), a - b * 3][kind - 4] if kind < 7 else a

    low = [Fraction(int(k), 8) for k in rng.integers(0, 16, 2)]
    high = [a + Fraction(int(k), 16) for a, k in zip(low, rng.integers(0, 9, 2), strict=True)]
    inside = [a + (b - a) * Fraction(int(k), 8) for a, b, k in zip(low, high, rng.integers(0, 9, 2), strict=True)]
    draws = np.random.default_rng(seed)
    try:
        bottom, top = jacobian_enclosure(
            lambda x: [expression(x, 3)], [float(a) for a in low], [float(b) for b in high]
        )
    except UnboundedError:
        return
    step = Fraction(1, 10**30)
    for i in range(2):
        ends = []
        for sign in (1, -1):
            draws = np.random.default_rng(seed)
            ends.append(expression([x + sign * step * (j == i) for j, x in enumerate(inside)], 3))
        slope = float((ends[0] - ends[1]) / (2 * step))
        assert bottom[0, i] - 1e-12 * (1 + abs(slope)) <= slope <= top[0, i] + 1e-12 * (1 + abs(slope))
