"""Functions of several branches are enclosed where the branches meet, and never proven where they jump."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.exact.jacobians import jacobian_blocks, jacobian_enclosure
from control_kpos.exact.unreadable import UnboundedError, UnsupportedError


def scaled(s):
    return np.where(s > 1, 3 * s, 2 * s + 1)


# Continuous functions of two numbers, with branches that meet.
MEETING = {
    "ramp": lambda x, y: np.where(x > 0, x, 0.0),
    "ramp, turned round": lambda x, y: np.where(x <= 0, 0, x),
    "leaky": lambda x, y: np.where(x < 0, 0.1 * x, x),
    "square": lambda x, y: np.where(x > 0, x * x * y, 0.0),
    "saturation": lambda x, y: np.where(x > 0.3, 0.3, x),
    "two-sided": lambda x, y: np.select([x < -0.25, x > 0.25], [x + 0.25, x - 0.25], 0.0),
    "pieces": lambda x, y: np.piecewise(x, [x < 0, x >= 0], [lambda z: 0.5 * z, lambda z: z]),
    "pieces with a rest": lambda x, y: np.piecewise(x, [x < 0], [lambda z, k: k * z, lambda z, k: z], 0.25),
    "one constant piece": lambda x, y: np.piecewise(x, [x > 0.5], [0.5, lambda z: z]),
    "factor": lambda x, y: (x > 0) * x + y * (y <= 0),
    "exponential": lambda x, y: np.where(x < 0, np.exp(x) - 1, np.sin(x)),
    "two variables": lambda x, y: np.where(x > y, x, y),
    "two variables, scaled": lambda x, y: scaled(2 * x - y),
    "joined": lambda x, y: np.where((x > 0) & (y > -9), x * y, 0.0),
    "either": lambda x, y: np.where((x < -9) | ~(x < 0), x, 2 * x),
    "equality": lambda x, y: np.where(x == 0, 0.0, x + 3 * x * y),
    "inequality": lambda x, y: np.where(x != 0, x * y, 0.0),
    "decided": lambda x, y: np.where(x > 7, 5.0, x) + np.where(y < 7, y, 3.0) + np.sign(x + 8) + np.heaviside(y - 9, 1),
    "nested": lambda x, y: np.where(x > 0.5, 0.5, np.where(x > 0, x, 0)),
    "tie": lambda x, y: np.where(x > 1 / 3, y, y),
}
JUMPING = {
    "step": lambda x, y: np.where(x > 0, 1.0, 0.0),
    "step that rises": lambda x, y: np.where(x > 0, x + 1, x),
    "step that is small": lambda x, y: np.where(x > 0, x, x + 5e-324),
    "missed by rounding": lambda x, y: np.where(x > 0.1, 7 * x, x + 0.6),
    "step at a place that is no double": lambda x, y: np.where(3 * x > 1, 0.0, 3 * x - 1 + 1e-17),
    "factor": lambda x, y: (x > 0) * (1 + x),
    "other variable": lambda x, y: np.where(x > 0, y, 2 * y),
    "two variables": lambda x, y: np.where(x > y, x, 2 * y),
    "curve": lambda x, y: np.where(x * y > 0.1, x, 2 * x),
    "select": lambda x, y: np.select([x < 0, x < 0.5], [0.0, x], 1.0),
    "pieces": lambda x, y: np.piecewise(x, [x < 0, x > 0.5], [lambda z: 0.5 * z, lambda z: z]),
    "sign": lambda x, y: np.sign(x),
    "heaviside": lambda x, y: np.heaviside(x, 0.5),
    "joined": lambda x, y: np.where((x > 0) & (y > 0), x, 0.0),
    "equality": lambda x, y: np.where(x == 0, 1.0, 2 * x),
    "negated": lambda x, y: np.where(~(x > 0), x, x + 1),
    "among others that meet": lambda x, y: np.where(x > -1, x, -1) + np.where(x > -0.5, x, -1) + np.where(x > 0, x, 0),
    "on an edge": lambda x, y: np.where(x > -1, x, 5.0),
}


def answer(f, region=((-1, 1), (-1, 1))):
    system = ct.nlsys(lambda t, x, u, p: [-x[0] + f(x[1], x[0]), -x[1]], inputs=0, states=2)
    return kp.differential_positivity(system, kp.orthant(2), [list(side) for side in region])


@pytest.mark.parametrize("name", MEETING)
@settings(max_examples=20)
@given(
    st.lists(st.sampled_from([-1.0, -0.3, 0.0, 0.2, 0.5]), min_size=2, max_size=2),
    st.floats(0.01, 1),
    st.integers(0, 99),
)
def test_branches_that_meet_are_enclosed(name, lower, width, seed):
    f = MEETING[name]
    low = np.array(lower)
    a, b = jacobian_enclosure(lambda x: [f(x[0], x[1])], low, low + width)
    below, above = jacobian_blocks(
        lambda x: [f(x[0], x[1])] if "piece" not in name else [x[0]],
        np.column_stack([low, low]),
        np.column_stack([low, low + width]),
        2,
    )
    assert "piece" in name or ((below[1] <= b).all() and (a <= above[1]).all())
    rng = np.random.default_rng(seed)
    x, y = low + rng.random((2, 2)) * width
    # the mean value theorem for functions that are continuous and piecewise smooth: f(y) - f(x) is in J (y - x)
    step = y - x
    ends = np.sort([a[0] * step, b[0] * step], axis=0).sum(axis=1)
    moved = float(f(*y)) - float(f(*x))
    assert ends[0] - 1e-9 <= moved <= ends[1] + 1e-9


@pytest.mark.parametrize("name", JUMPING)
def test_branches_that_do_not_meet_are_never_proven(name):
    cert = answer(JUMPING[name])
    assert cert.status is not kp.Status.PROVED and cert.source == "sampled"
    with pytest.raises(UnsupportedError, match=r"meet|sign|jump"):
        jacobian_enclosure(lambda x: [JUMPING[name](x[0], x[1])], [-1, -1], [1, 1])
    if name not in ("pieces",):
        with pytest.raises(UnsupportedError, match=r"meet|sign|jump"):
            jacobian_blocks(lambda x: [JUMPING[name](x[0], x[1])], np.full((2, 3), -1.0), np.ones((2, 3)), 2)


def test_a_jump_at_some_nodes_only_is_seen():
    place = np.array([5.0, 0.25, -7.0])

    def node(x):
        return [np.where(x[0] > place, x[0] + 1, x[0]), x[1]]

    with pytest.raises(UnsupportedError, match="meet"):
        jacobian_blocks(node, np.zeros((2, 3)), np.ones((2, 3)), 2)
    jacobian_blocks(node, np.zeros((2, 3)), np.array([[1, 0.2, 1], [1, 1, 1]]), 2)
    low, high = jacobian_blocks(
        lambda x: [np.where(x[0] > place, 3 * x[0], 2 * x[0] + place)], np.zeros((1, 3)), np.ones((1, 3)), 1
    )
    assert low[:, 0, 0].tolist() == [2, 2, 3] and high[:, 0, 0].tolist() == [2, 3, 3]


def test_each_box_takes_its_branch_only():
    f = MEETING["leaky"]
    assert answer(lambda x, y: -f(x, y), [[-1, 1], [-1, 0]]).status is kp.Status.REFUTED
    for low, slope in ((-1.0, 0.1), (0.0, 1.0)):
        a, b = jacobian_enclosure(lambda x: [f(x[0], x[1])], [low, 0], [low + 1, 0])
        assert abs(a[0, 0] - slope) < 1e-12 and abs(b[0, 0] - slope) < 1e-12
    cert = answer(lambda x, y: np.where(x > 0, x, -0.5 * x))
    assert cert.status is kp.Status.REFUTED and cert.witness.point[1] < 0
    assert answer(MEETING["square"], [[0, 1], [-1, 1]]) and answer(MEETING["saturation"])


def test_whole_arrays():
    for f in (
        lambda x: np.where(x > 0, x, 0.5 * x)[::-1] - 3 * x,
        lambda x: np.where(x > 0.25, 0.25, x)[::-1] - 3 * x,
        lambda x: np.where(x[0] > 0, x, x)[::-1] - 3 * x,
        lambda x: np.where((x > -0.5) & (x < 0.5), x, x)[::-1] - 3 * x,
        lambda x: ((x > 0) * x)[::-1] - 3 * x,
        lambda x: np.select([x > 0.5, x < 0], [0.5, 0.5 * x], x)[::-1] - 3 * x,
    ):
        system = ct.nlsys(lambda t, x, u, p, f=f: f(x), inputs=0, states=2)
        cert = kp.differential_positivity(system, kp.orthant(2), [[-1, 1], [-1, 1]])
        assert cert and cert.source == "enclosed"


OTHER = {
    "one argument": lambda x: np.where(x[0] > 0)[0].size * x[0],
    "joined with a number": lambda x: np.where((x[0] > 0) & True, x[0], 0),
    "exclusive or": lambda x: np.where((x[0] > 0) ^ (x[1] > 0), x[0], x[0]),
    "mask": lambda x: x[x > 0].sum(),
    "assignment by mask": lambda x: np.putmask(x, x > 0, 0) or x[0],
    "ufunc where": lambda x: np.add(x, 1, where=x > 0)[0],
    "sum where": lambda x: np.sum(x, where=x > 0),
    "copyto": lambda x: np.copyto(x, 0, where=x > 0) or x[0],
    "extract": lambda x: np.extract(x > 0, x).sum(),
    "choose": lambda x: np.choose(x > 0, [x, 2 * x])[0],
    "condition minus": lambda x: (1 - (x[0] > 0)) * x[0],
    "condition in arithmetic": lambda x: x[0] + (x[0] > 0),
    "lengths": lambda x: np.select([x[0] > 0], [x[0], x[1]], 0),
    "piecewise of an array": lambda x: np.piecewise(x, [x < 0, x >= 0], [lambda z: z, lambda z: z])[0],
    "another function": lambda x: np.concatenate([[x[0] > 0], [True]])[0] * x[0],
    "type of result": lambda x: np.stack([x[0] > 0, x[1] > 0]).astype(float)[0] * x[0],
}


@pytest.mark.parametrize("name", OTHER)
def test_conditions_in_other_places_are_refused(name):
    with pytest.raises((UnsupportedError, UnboundedError)):
        jacobian_enclosure(lambda x: [OTHER[name](x), x[1]], [-1, -1], [1, 1])


def test_a_function_that_is_called_like_one_of_numpy_is_not_taken_for_it():
    imposter = np.frompyfunc(lambda y: -y, 1, 1)

    class Named:
        __name__ = "sin"
        nin = 1

        def __call__(self, *items):
            return imposter(*items)

    with pytest.raises(UnsupportedError, match="none of numpy's"):
        jacobian_enclosure(lambda x: [x[0].__array_ufunc__(Named(), "__call__", x[0])], [0], [1])


# Functions of numpy whose results tell something about numbers, or jump.
REFUSED = [
    "bitwise_and",
    "bitwise_count",
    "bitwise_or",
    "bitwise_xor",
    "ceil",
    "copysign",
    "divmod",
    "floor",
    "floor_divide",
    "fmod",
    "frexp",
    "gcd",
    "invert",
    "isfinite",
    "isinf",
    "isnan",
    "isnat",
    "lcm",
    "ldexp",
    "left_shift",
    "logical_and",
    "logical_not",
    "logical_or",
    "logical_xor",
    "matmul",
    "matvec",
    "modf",
    "nextafter",
    "remainder",
    "right_shift",
    "rint",
    "signbit",
    "spacing",
    "trunc",
    "vecdot",
    "vecmat",
]
# Those that give conditions.
COMPARISONS = ("less", "less_equal", "greater", "greater_equal", "equal", "not_equal")


def test_every_function_of_numpy_is_enclosed_or_refused():
    names = {getattr(np, name).__name__ for name in dir(np) if isinstance(getattr(np, name), np.ufunc)}
    for name in names:
        ufunc, low = getattr(np, name), 1.1 if name == "arccosh" else 0.3

        def f(x, u=ufunc):
            return [u(*(list(x) * 2)[: u.nin]) if u.nout == 1 else u(*(list(x) * 2)[: u.nin])[0]]

        box = np.array([low, 0.5]), np.array([low + 0.1, 0.6])
        calls = [lambda b=box, g=f: jacobian_enclosure(g, *b)]
        calls.append(lambda b=box, g=f: jacobian_blocks(g, b[0][:, None], b[1][:, None], 2))
        for call in calls:
            if name in REFUSED or name in COMPARISONS:
                with pytest.raises(UnsupportedError):
                    call()
            else:
                a, b = call()
                step = 1e-6 * np.eye(2)
                x = (box[0] + box[1]) / 2
                slope = [(ufunc(*(x + h)[: ufunc.nin]) - ufunc(*(x - h)[: ufunc.nin])) / 2e-6 for h in step]
                assert (np.ravel(a) - 1e-6 <= slope).all() and (slope <= np.ravel(b) + 1e-6).all(), name


def test_functions_of_scipy():
    for name in ("expit", "logit", "log_expit", "log1p", "expm1", "cbrt", "exp2"):
        function = getattr(scipy.special, name)
        a, b = jacobian_enclosure(lambda x, f=function: [f(x[0])], [0.3], [0.4])
        slope = (function(0.35 + 1e-6) - function(0.35 - 1e-6)) / 2e-6
        assert a[0, 0] - 1e-6 <= slope <= b[0, 0] + 1e-6 and b[0, 0] - a[0, 0] < 2
    for function in (scipy.special.erf, scipy.special.gamma, scipy.special.j0, scipy.special.exprel):
        with pytest.raises(UnsupportedError):
            jacobian_enclosure(lambda x, f=function: [f(x[0])], [0.3], [0.4])


def test_arrays_by_conditions_on_numbers_and_numbers_by_conditions_on_arrays():
    gains = np.array([1.0, 2.0])
    for f in (
        lambda x: np.where(x[0] > 5, gains, 2 * gains) * x,
        lambda x: ((x[0] < 5) * gains) * x + gains * (x[0] < 5) * x,
        lambda x: np.where(gains > 1.5, x, 2 * x),
        lambda x: np.where(x > 5, 1.0, x) * gains,
    ):
        a, b = jacobian_enclosure(f, [0, 0], [1, 1])
        for i in range(2):
            step = 1e-6 * np.eye(2)[i]
            slope = (f(np.full(2, 0.5) + step) - f(np.full(2, 0.5) - step)) / 2e-6
            assert (a[:, i] - 1e-6 <= slope).all() and (slope <= b[:, i] + 1e-6).all()
