"""Enclosures of elementary functions against values of fifty digits and more."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from control_kpos.exact.elementary import enclosed, integer_power, quarter_turns, real_power, sine_and_cosine
from control_kpos.exact.interval_arithmetic import integer_power as whole_power
from control_kpos.exact.interval_arithmetic import inverse, product, root, sum_of
from control_kpos.exact.unreadable import UnboundedError

# Magnitudes of all sizes, subnormal numbers and neighbours of places where functions turn.
HARD = [0.0, 5e-324, 1e-310, 2.0**-1022, 1e-200, 1e-9, 0.5, 1.0, math.pi / 2, math.pi, 355.0, 710.0, 1e5, 1e22, 1e300]
ALL = st.one_of(st.sampled_from(HARD), st.floats(1e-3, 30.0)).flatmap(lambda x: st.sampled_from([x, -x]))
SMALL = st.floats(-30, 30).filter(lambda x: x == 0 or abs(x) > 1e-3)
FUNCTIONS = [arb.sin, arb.cos, arb.exp, arb.log, arb.sqrt, arb.tanh, arb.atan, arb.sinh, arb.cosh, arb.sech]


def precisely(function, x):
    """The value to hundreds of digits."""
    with ctx.workprec(3000):
        return function(arb(x))


def holds(interval, value):
    with ctx.workprec(3000):
        return not (arb(interval[0]) > value or value > arb(interval[1]))


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
@given(x=ALL)
def test_values_lie_between_doubles_at_most_two_apart(function, x):
    if function in (arb.log, arb.sqrt):
        x = abs(x)
    low, high = enclosed(function, x)
    if function is arb.log and x == 0:
        assert (low, high) == (-math.inf, math.inf)
        return
    if function in (arb.exp, arb.sinh, arb.cosh) and abs(x) > 1e5:
        assert high == math.inf or low == -math.inf or (low, high) == (0.0, 5e-324)
        return
    if function is arb.sech and abs(x) > 1e5:
        assert (low, high) == (0.0, 5e-324)
        return
    assert holds((low, high), precisely(function, x))
    assert high <= math.nextafter(math.nextafter(low, math.inf), math.inf)


@given(SMALL, st.integers(1, 12))
def test_integer_powers(x, power):
    low, high = integer_power(x, power)
    assert low <= high and Fraction(low) <= Fraction(x) ** power <= Fraction(high)


@given(st.floats(1e-3, 1e3), st.floats(-5, 5).filter(lambda p: abs(p) > 1e-3), st.sampled_from([0, 1]))
def test_real_powers(x, power, less):
    with ctx.workprec(3000):
        value = (arb(x).log() * (arb(power) - less)).exp()
    assert holds(real_power(x, power, less), value)


@given(ALL, st.floats(0, 8))
def test_ranges_of_sine_and_cosine(low, width):
    high = low + width
    sine, cosine = sine_and_cosine((low, high))
    for t in np.linspace(0, 1, 7):
        x = min(max(low + t * width, low), high)
        assert holds(sine, precisely(arb.sin, x)) and holds(cosine, precisely(arb.cos, x))
    if high - low >= 2 * math.pi and abs(low) < 1e10:
        assert sine == cosine == (-1.0, 1.0)


def test_extrema_are_reached_where_they_are_and_nowhere_else():
    assert sine_and_cosine((0.1, 1.5))[0][1] < 1 and sine_and_cosine((0.1, 1.6))[0][1] == 1
    sine, cosine = sine_and_cosine((-1.6, 1.5))
    assert sine == (-1.0, enclosed(arb.sin, 1.5)[1]) and cosine == (enclosed(arb.cos, -1.6)[0], 1.0)
    assert quarter_turns(0.0, 0.0) == (0, 0)
    assert sine_and_cosine((1e22, 1e22))[0][1] < -0.85
    assert sine_and_cosine((1e22, math.nextafter(1e22, math.inf))) == ((-1.0, 1.0), (-1.0, 1.0))
    assert sine_and_cosine((1e300, math.nextafter(1e300, math.inf))) == ((-1.0, 1.0), (-1.0, 1.0))


def test_a_wide_precision_set_by_others_changes_nothing():
    expected = enclosed(arb.exp, 1.0)
    with ctx.workprec(20):
        assert enclosed(arb.exp, 1.0) == expected


# -- sums and products, against fractions

ENDS = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.1, 5e-324, -5e-324, 2.0**-540, 1e300, -1e300, 2.0**53, 2.0**-53]),
    st.floats(allow_nan=False, allow_infinity=False),
)
INTERVALS = st.tuples(ENDS, ENDS).map(lambda ends: (min(ends), max(ends)))


def hull(numbers):
    return min(numbers), max(numbers)


@given(INTERVALS, INTERVALS)
def test_sums_and_products_are_enclosed_and_tight(a, b):
    exact_sum = tuple(Fraction(x) + Fraction(y) for x, y in zip(a, b, strict=True))
    exact_product = hull([Fraction(x) * Fraction(y) for x in a for y in b])
    for operation, exact in ((sum_of, exact_sum), (product, exact_product)):
        many = [(np.array([low, low]), np.array([high, high])) for low, high in (a, b)]
        try:
            low, high = operation(a, b)
        except UnboundedError:
            assert max(abs(x) for x in exact) > 2.0**1022
            with pytest.raises(UnboundedError):
                operation(*many)
            continue
        assert low <= exact[0] <= exact[1] <= high
        assert math.nextafter(math.nextafter(low, math.inf), math.inf) >= exact[0]
        assert math.nextafter(math.nextafter(high, -math.inf), -math.inf) <= exact[1]
        bounds = operation(*many)
        assert (bounds[0] == low).all() and (bounds[1] == high).all()


@given(INTERVALS)
def test_products_with_zero_are_exact(a):
    assert product(a, (0.0, 0.0)) == (0.0, 0.0)
    assert [x.tolist() for x in product((np.array([a[0]]), np.array([a[1]])), (0.0, 0.0))] == [[0.0], [0.0]]


@given(INTERVALS, st.sampled_from([1.0, -1.0, 2.0, -0.25, 2.0**60]))
def test_products_with_powers_of_two_are_exact(a, power):
    exact = hull([x * power for x in a])
    if max(map(abs, exact)) <= np.finfo(float).max and all(x == 0 or abs(x * power) >= 2.0**-1022 for x in a):
        assert product(a, (power, power)) == exact


@pytest.mark.parametrize(
    "x", [1 - 2.0**-53, 1 + 2.0**-52, 3.0, 2.0**1023, 1.7976931348623153e308, 2.0**-1021, -0.5, -0.75]
)
def test_inverses_that_round_to_a_power_of_two(x):
    least, most = inverse((x, x))
    assert Fraction(float(least)) <= 1 / Fraction(x) <= Fraction(float(most))
    assert (least == most) == (abs(x) in (0.5, 2.0**-1021))


@given(INTERVALS)
def test_quotients_roots_and_powers(a):
    low, high = (Fraction(x) for x in a)
    if a[0] <= 0 <= a[1]:
        with pytest.raises(UnboundedError, match="may be zero"):
            inverse(a)
    elif min(map(abs, a)) > 1e-300:
        least, most = inverse(a)
        assert Fraction(float(least)) <= 1 / high <= 1 / low <= Fraction(float(most))
    if a[0] >= 0:
        least, most = root(a)
        assert Fraction(float(least)) ** 2 <= low and high <= Fraction(float(most)) ** 2
    for power in (0, 1, 2, 3, 6, 7):
        if max(map(abs, a)) ** power < 1e300 if max(map(abs, a)) < 1e40 else power < 2:
            least, most = whole_power(a, power)
            exact = hull([low**power, high**power, *([Fraction(0)] if low < 0 < high and power > 0 else [])])
            assert Fraction(float(least)) <= exact[0] and exact[1] <= Fraction(float(most))
            assert power % 2 or least >= 0
