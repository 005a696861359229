"""Functions of intervals, one and many at a time: ranges of values and slopes against values of hundreds of digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from control_kpos.exact import elementary_arrays
from control_kpos.exact.functions import NAMED, logaddexp, real_power
from control_kpos.exact.interval_arithmetic import hull
from control_kpos.exact.unreadable import UnboundedError

ONE = arb(1)


def half(x):
    return x / 2


# Value and slope, and the numbers between which the slope is bounded.
BALLS = {
    "exp": (arb.exp, arb.exp, -math.inf, math.inf),
    "expm1": (arb.expm1, arb.exp, -math.inf, math.inf),
    "exp2": (
        lambda x: (x * arb(2).log()).exp(),
        lambda x: (x * arb(2).log()).exp() * arb(2).log(),
        -math.inf,
        math.inf,
    ),
    "log": (arb.log, lambda x: 1 / x, 0, math.inf),
    "log1p": (arb.log1p, lambda x: 1 / (1 + x), -1, math.inf),
    "log2": (lambda x: x.log() / arb(2).log(), lambda x: 1 / (x * arb(2).log()), 0, math.inf),
    "log10": (lambda x: x.log() / arb(10).log(), lambda x: 1 / (x * arb(10).log()), 0, math.inf),
    "sqrt": (arb.sqrt, lambda x: 1 / (2 * x.sqrt()), 0, math.inf),
    "cbrt": (
        lambda x: x.root(3) if x > 0 else -(-x).root(3),
        lambda x: 1 / (3 * (x if x > 0 else -x).root(3) ** 2),
        None,
        math.inf,
    ),
    "sin": (arb.sin, arb.cos, -math.inf, math.inf),
    "cos": (arb.cos, lambda x: -x.sin(), -math.inf, math.inf),
    "tan": (arb.tan, lambda x: x.sec() ** 2, None, math.inf),
    "tanh": (arb.tanh, lambda x: x.sech() ** 2, -math.inf, math.inf),
    "arctan": (arb.atan, lambda x: 1 / (1 + x * x), -math.inf, math.inf),
    "arcsin": (arb.asin, lambda x: 1 / (1 - x * x).sqrt(), -1, 1),
    "arccos": (arb.acos, lambda x: -1 / (1 - x * x).sqrt(), -1, 1),
    "sinh": (arb.sinh, arb.cosh, -math.inf, math.inf),
    "cosh": (arb.cosh, arb.sinh, -math.inf, math.inf),
    "arcsinh": (arb.asinh, lambda x: 1 / (1 + x * x).sqrt(), -math.inf, math.inf),
    "arctanh": (arb.atanh, lambda x: 1 / (1 - x * x), -1, 1),
    "arccosh": (arb.acosh, lambda x: 1 / (x * x - 1).sqrt(), 1, math.inf),
    "expit": (lambda x: 1 / (1 + (-x).exp()), lambda x: (half(x)).sech() ** 2 / 4, -math.inf, math.inf),
    "deg2rad": (lambda x: x * arb.pi() / 180, lambda x: arb.pi() / 180, -math.inf, math.inf),
    "radians": (lambda x: x * arb.pi() / 180, lambda x: arb.pi() / 180, -math.inf, math.inf),
    "rad2deg": (lambda x: x * 180 / arb.pi(), lambda x: 180 / arb.pi(), -math.inf, math.inf),
    "degrees": (lambda x: x * 180 / arb.pi(), lambda x: 180 / arb.pi(), -math.inf, math.inf),
}
# Magnitudes of all sizes, subnormal numbers and neighbours of places where functions turn.
HARD = [
    0.0,
    5e-324,
    1e-310,
    2.0**-1022,
    1e-200,
    1e-16,
    1e-9,
    0.35,
    0.5,
    0.7071067811865476,
    1 - 2**-53,
    1.0,
    1 + 2**-52,
]
HARD += [math.pi / 2, math.pi, 2.0, 355.0, 700.0, 709.7, 745.2, 65536.5, 1e5, 1e22, 1e300]
SIZES = st.one_of(st.sampled_from(HARD), st.floats(1e-3, 30.0), st.floats(0.9, 1.1))
ALL = SIZES.flatmap(lambda x: st.sampled_from([x, -x]))
WIDTHS = st.sampled_from([0.0, 1e-12, 1e-9, 0.3, 2.0, 1e3])


def precisely(function, x):
    with ctx.workprec(1200):
        return function(arb(x))


def holds(low, high, value):
    with ctx.workprec(1200):
        return not (arb(float(low)) > value or value > arb(float(high)))


def ranges(name, low, high, many):
    """For one interval, or for it and others that do not matter."""
    with np.errstate(all="ignore"):
        if not many:
            return NAMED[name]((low, high))
        return NAMED[name]((np.array([low, low, low]), np.array([high, low, high])))


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("name", NAMED)
@settings(max_examples=15)
@given(low=ALL, width=WIDTHS, share=st.floats(0, 1))
def test_values_and_slopes_on_intervals(name, many, low, width, share):
    value, slope, lowest, highest = BALLS[name]
    high, found = low + width, ()
    try:
        found = ranges(name, low, high, many)
        finite = all(np.isfinite(end).all() for part in found for end in part)
    except UnboundedError:
        finite = False
    if not finite:
        outside = (lowest is None and (low <= 0 or name == "tan")) or (lowest is not None and low <= lowest)
        assert outside or high >= highest or max(abs(low), abs(high)) > 100 or min(abs(low), abs(high)) < 1e-290
        return
    for share_ in (share, 0.0, 1.0):
        x = min(max(low + share_ * width, low), high)
        for (a, b), exact in zip(found, (precisely(value, x), precisely(slope, x)), strict=True):
            assert all(holds(c, d, exact) for c, d in zip(np.atleast_1d(a)[::2], np.atleast_1d(b)[::2], strict=True))


@pytest.mark.parametrize("name", NAMED)
def test_many_at_a_time_are_enclosed_nearly_as_tightly_as_one(name):
    x = np.linspace(1.05, 3.0, 40) if BALLS[name][3] > 1 else np.linspace(-0.9, 0.9, 40)
    for width in (0.0, 1e-3):
        many = NAMED[name]((x, x + width))
        for k, point in enumerate(x):
            if name == "tan" and abs(point - math.pi / 2) < 0.2:
                continue
            for (low, high), (a, b) in zip(NAMED[name]((point, point + width)), many, strict=True):
                low, high, a, b = (
                    float(np.broadcast_to(end, x.shape)[k]) if np.ndim(end) else end for end in (low, high, a, b)
                )
                room = 1e-12 * max(abs(low), abs(high), 1.0)
                assert low - room <= a <= high + room and low - room <= b <= high + room


@pytest.mark.parametrize(
    "name", ["exp", "log", "arctan", "expm1", "log1p", "tanh", "sinh", "cosh", "logistic", "sech2"]
)
def test_errors_are_far_below_their_bounds(name):
    """The bound is proven; that rounding takes up a small part of it shows that nothing was left out."""
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(0.01, 3, 300), rng.uniform(3, 300, 100), 1 + rng.uniform(-1e-3, 1e-3, 50)])
    low, high = getattr(elementary_arrays, name)(x)
    ball = {
        "arctan": arb.atan,
        "logistic": BALLS["expit"][0],
        "sech2": lambda y: y.sech() ** 2,
    }.get(name, getattr(arb, name, None))
    for k, point in enumerate(x):
        exact = precisely(ball, point)
        with ctx.workprec(300):
            middle, radius = (arb(low[k]) + arb(high[k])) / 2, (arb(high[k]) - arb(low[k])) / 2
            assert holds(low[k], high[k], exact)
            if name in ("exp", "log", "arctan"):
                assert abs(exact - middle) <= radius / 4


@settings(max_examples=25)
@given(st.floats(-1e5, 1e5), st.sampled_from([0.0, 1e-9, 0.3, 1.5, 3.0, 7.0]), st.integers(-40000, 40000))
def test_sine_and_cosine_of_many(x, width, quarter):
    lows = np.array([x, quarter * math.pi / 2, math.nextafter(quarter * math.pi / 2, 0)])
    sine, cosine = elementary_arrays.sine_and_cosine((lows, lows + width))
    for k, low in enumerate(lows):
        for t in np.linspace(0, 1, 5):
            point = min(low + t * width, low + width)
            assert holds(sine[0][k], sine[1][k], precisely(arb.sin, point))
            assert holds(cosine[0][k], cosine[1][k], precisely(arb.cos, point))


@pytest.mark.parametrize("many", [False, True])
@settings(max_examples=15)
@given(st.floats(0, 50), WIDTHS, st.floats(-4, 4).filter(lambda p: p and p != int(p)), st.floats(0, 1))
def test_real_powers(many, low, width, power, share):
    high = low + width
    x = (np.array([low, low]), np.array([high, high])) if many else (low, high)
    exponent = np.array([power, power]) if many else power
    try:
        found = real_power(x, exponent)
    except UnboundedError:
        assert low < 1e-200 or power < 0
        return
    for s in (0.0, share, 1.0):
        point = min(low + s * width, high)
        with ctx.workprec(1200):
            exact = [
                (arb(point).log() * p).exp() * c if point else arb(0)
                for p, c in ((arb(power), 1), (arb(power) - 1, arb(power)))
            ]
        for (a, b), value in zip(found, exact, strict=True):
            assert holds(np.ravel(a)[0], np.ravel(b)[0], value)


@settings(max_examples=15)
@given(st.floats(-800, 800), st.floats(-800, 800), WIDTHS, st.floats(0, 1))
def test_logarithms_of_sums_of_exponentials(x, y, width, share):
    value, slope = logaddexp((np.array([x]), np.array([x + width])), (np.array([y]), np.array([y + width])))
    a, b = min(x + share * width, x + width), min(y + (1 - share) * width, y + width)
    with ctx.workprec(1200):
        exact = (arb(a).exp() + arb(b).exp()).log()
        assert holds(value[0][0], value[1][0], exact)
        assert holds(slope[0][0], slope[1][0], 1 / (1 + (arb(b) - arb(a)).exp()))
    single = logaddexp((x, x + width), (y, y + width))[0]
    assert holds(*single, exact) and hull(single, (float(value[0][0]), float(value[1][0])))


def test_domains_end():
    for name, bad in (
        ("log", 0.0),
        ("sqrt", -1e-320),
        ("log1p", -1.0),
        ("arcsin", 1.0),
        ("arctanh", -1.0),
        ("arccosh", 1.0),
    ):
        for x in (bad, np.array([2.0, bad])):
            with pytest.raises(UnboundedError, match=r"may (be|reach)"):
                NAMED[name]((x, x))
    with pytest.raises(UnboundedError, match="cube root"):
        NAMED["cbrt"]((-1.0, 1.0))
    with np.errstate(all="ignore"):
        assert NAMED["exp"]((np.array([0.0]), np.array([710.0])))[0][1] == np.inf
    assert NAMED["exp"]((-1e300, 0.0))[0] == (0.0, 1.0)
    assert NAMED["tanh"]((-1e300, 1e300))[0] == (-1.0, 1.0)
    for zero in (0.0, np.zeros(2)):
        for name in ("sin", "tanh", "arctan", "sinh", "expm1", "log1p", "arcsinh"):
            low, high = NAMED[name]((zero, zero))[0]
            assert (np.asarray(low) == 0).all() and (np.asarray(high) == 0).all(), name
