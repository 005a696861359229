"""Ranges of elementary functions and of their slopes on intervals: monotone functions at the ends.

Single intervals are enclosed by `elementary`, arrays of them by `elementary_arrays`.  A function that has no value, or
no bounded slope, somewhere on an interval is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from flint import arb

from . import elementary, elementary_arrays
from . import interval_arithmetic as ia
from .interval_arithmetic import HALF, ONE, Interval
from .unreadable import UnboundedError

Ranges = tuple[Interval, Interval]


def _sech2(ball: Any) -> Any:
    return ball.sech() ** 2


def _logistic(ball: Any) -> Any:
    return 1 / (1 + (-ball).exp())


_BALLS: dict[str, Callable[[Any], Any]] = {
    "exp": arb.exp,
    "expm1": arb.expm1,
    "log": arb.log,
    "log1p": arb.log1p,
    "tanh": arb.tanh,
    "sech2": _sech2,
    "arctan": arb.atan,
    "sinh": arb.sinh,
    "cosh": arb.cosh,
    "logistic": _logistic,
}


def _at(name: str, x: Any) -> Interval:
    """The value at numbers."""
    if np.ndim(x) == 0:
        return elementary.enclosed(_BALLS[name], float(x))
    return getattr(elementary_arrays, name)(x)


def rising(name: str, x: Interval) -> Interval:
    """Range of an increasing function."""
    return _at(name, x[0])[0], _at(name, x[1])[1]


def even(name: str, x: Interval) -> Interval:
    """Range of an even function that is monotone in |x|."""
    least, most = ia.sizes(x)
    return ia.hull(_at(name, least), _at(name, most))


def constant(name: str) -> Interval:
    """A number that is no double."""
    ball = {"ln 2": arb(2).log(), "ln 10": arb(10).log(), "degree": arb.pi() / 180, "radian": 180 / arb.pi()}[name]
    return elementary.enclosed(lambda _: ball, 0.0)


def require(allowed: Any, text: str) -> None:
    """Refuse intervals that leave the domain of a function."""
    if not np.all(allowed):
        raise UnboundedError(text)


def require_positive(what: str, x: Interval, or_zero: Any = False) -> None:
    """Refuse a domain with negative numbers, or zero."""
    require(x[0] >= 0, f"the {what} of a quantity that may be negative")
    require((x[0] > 0) | or_zero, f"the slope of the {what} is unbounded at zero, which the quantity may be")


def exp(x: Interval) -> Ranges:
    """e^x."""
    value = rising("exp", x)
    return value, value


def expm1(x: Interval) -> Ranges:
    """e^x - 1."""
    return rising("expm1", x), rising("exp", x)


def exp2(x: Interval) -> Ranges:
    """2^x."""
    value = rising("exp", ia.product(x, constant("ln 2")))
    return value, ia.product(ia.bounded(value), constant("ln 2"))


def log(x: Interval) -> Ranges:
    """Natural logarithm."""
    require_positive("logarithm", x)
    return rising("log", x), ia.inverse(x)


def log1p(x: Interval) -> Ranges:
    """ln(1 + x)."""
    shifted = ia.sum_of(x, ONE)
    require_positive("logarithm", shifted)
    return rising("log1p", x), ia.inverse(shifted)


def _logarithm(base: str) -> Callable[[Interval], Ranges]:
    def function(x: Interval) -> Ranges:
        per = ia.inverse(constant(base))
        value, slope = log(x)
        return ia.product(ia.bounded(value), per), ia.product(slope, per)

    return function


def sqrt(x: Interval) -> Ranges:
    """Square root."""
    require_positive("square root", x)
    value = ia.root(x)
    return value, ia.product(HALF, ia.inverse(value))


def cbrt(x: Interval) -> Ranges:
    """Cube root."""
    require((x[0] > 0) | (x[1] < 0), "the slope of the cube root is unbounded at zero, which the quantity may be")
    third = ia.inverse((3.0, 3.0))
    negative = np.asarray(x[1] < 0)
    roots = _power(ia.sizes(x), third)
    value = np.where(negative, -roots[1], roots[0]), np.where(negative, -roots[0], roots[1])
    return value, ia.product(third, ia.inverse(ia.product(roots, roots)))


def _power(x: Interval, power: Interval) -> Interval:
    """x^p for x > 0."""
    return rising("exp", ia.product(ia.bounded(rising("log", x)), power))


def real_power(x: Interval, power: Any) -> Ranges:
    """x^p for x >= 0; one p, or one for each interval."""
    require_positive(f"power {np.min(power):g}", (x[0] + 0.0 * power, x[1]), or_zero=power > 1)
    if np.ndim(x[0]) == 0:
        value, slope = (_power_of_number(x, power, less) for less in (0, 1))
    else:
        less = ia.sum_of((power, power), (-1.0, -1.0))
        value, slope = _power_with_zero(x, (power, power)), _power_with_zero(x, less)
    return value, ia.product((power, power), ia.bounded(slope))


def _power_of_number(x: Interval, power: float, less: int) -> Interval:
    return ia.hull(*(elementary.real_power(float(end), power, less) if end else (0.0, 0.0) for end in x))


def power_or_infinite(x: Interval, power: Interval) -> Interval:
    """x^p, where 0^p is infinite for p < 0."""
    with np.errstate(all="ignore"):
        ends = [_power((end + (end == 0), end + (end == 0)), power) for end in x]
    at_zero = np.where(power[1] < 0, np.inf, np.where(power[0] > 0, 0.0, 1.0))
    low, high = (
        [np.where(end == 0, at_zero, part[side]) for end, part in zip(x, ends, strict=True)] for side in (0, 1)
    )
    return np.minimum(*low), np.maximum(*high)


def _power_with_zero(x: Interval, power: Interval) -> Interval:
    """x^p, where 0^p = 0; x is positive if p is negative."""
    return ia.hull(*(_power_at(end, power) for end in x))


def _power_at(x: Any, power: Interval) -> Interval:
    positive = x + (x == 0)
    low, high = _power((positive, positive), power)
    return np.where(x == 0, 0.0, low), np.where(x == 0, 0.0, high)


def sin(x: Interval) -> Ranges:
    """Sine."""
    return _sine_and_cosine(x)


def cos(x: Interval) -> Ranges:
    """Cosine."""
    sine, cosine = _sine_and_cosine(x)
    return cosine, ia.negative(sine)


def _sine_and_cosine(x: Interval) -> Ranges:
    return (elementary if np.ndim(x[0]) == 0 else elementary_arrays).sine_and_cosine(x)


def tan(x: Interval) -> Ranges:
    """Tangent, by t' = 1 / cos^2; monotone where the cosine has one sign."""
    sine, cosine = _sine_and_cosine(x)
    per = ia.inverse(cosine)
    ends = [ia.quotient(*_sine_and_cosine((end, end))) for end in x]
    return ia.common(ia.hull(*ends), ia.product(sine, per)), ia.integer_power(per, 2)


def tanh(x: Interval) -> Ranges:
    """Hyperbolic tangent."""
    low, high = rising("tanh", x)
    return (np.maximum(low, -1.0), np.minimum(high, 1.0)), even("sech2", x)


def arctan(x: Interval) -> Ranges:
    """Arc tangent."""
    return rising("arctan", x), ia.inverse(ia.sum_of(ONE, ia.integer_power(x, 2)))


def arcsin(x: Interval) -> Ranges:
    """Arc sine, as the arc tangent of x / sqrt(1 - x^2)."""
    leg, slope = _leg(x, "arc sine")
    ends = [ia.quotient((end, end), ia.root(part)) for end, part in zip(x, leg, strict=True)]
    return ia.hull(*(rising("arctan", end) for end in ends)), slope


def _leg(x: Interval, what: str) -> tuple[list[Interval], Interval]:
    """1 - t^2 at both ends, and 1 / sqrt(1 - x^2)."""
    require(ia.sizes(x)[1] < 1, f"the slope of the {what} is unbounded at 1, which the quantity may reach")
    ends = [ia.product(ia.difference(ONE, (end, end)), ia.sum_of(ONE, (end, end))) for end in x]
    far, near = (ia.product(ia.difference(ONE, (s, s)), ia.sum_of(ONE, (s, s))) for s in reversed(ia.sizes(x)))
    return ends, ia.inverse(ia.root((far[0], near[1])))


def arccos(x: Interval) -> Ranges:
    """Arc cosine."""
    value, slope = arcsin(x)
    quarter = ia.product((90.0, 90.0), constant("degree"))
    return ia.difference(quarter, value), ia.negative(slope)


def sinh(x: Interval) -> Ranges:
    """Hyperbolic sine."""
    return rising("sinh", x), even("cosh", x)


def cosh(x: Interval) -> Ranges:
    """Hyperbolic cosine."""
    return even("cosh", x), rising("sinh", x)


def arcsinh(x: Interval) -> Ranges:
    """ln(|x| + sqrt(x^2 + 1)), with the sign of x."""
    ends = [_arcsinh((end, end)) for end in x]
    return (ends[0][0], ends[1][1]), ia.inverse(ia.root(ia.sum_of(ONE, ia.integer_power(x, 2))))


def _arcsinh(x: Interval) -> Interval:
    """At a number t >= 0: ln(1 + t + t^2 / (1 + sqrt(1 + t^2)))."""
    size, square = ia.sizes(x), ia.integer_power(x, 2)
    more = ia.quotient(square, ia.sum_of(ONE, ia.root(ia.sum_of(ONE, square))))
    low, high = rising("log1p", ia.sum_of(size, more))
    return np.where(x[0] < 0, -high, low), np.where(x[0] < 0, -low, high)


def arctanh(x: Interval) -> Ranges:
    """ln((1 + |x|) / (1 - |x|)) / 2, with the sign of x."""
    _, slope = _leg(x, "inverse hyperbolic tangent")
    ends = [_arctanh((end, end)) for end in x]
    return (ends[0][0], ends[1][1]), ia.integer_power(slope, 2)


def _arctanh(x: Interval) -> Interval:
    size = ia.sizes(x)
    ratio = ia.quotient(ia.product((2.0, 2.0), size), ia.difference(ONE, size))
    low, high = ia.product(HALF, ia.bounded(rising("log1p", ratio)))
    return np.where(x[0] < 0, -high, low), np.where(x[0] < 0, -low, high)


def arccosh(x: Interval) -> Ranges:
    """ln(x + sqrt(x^2 - 1))."""
    require(x[0] > 1, "the slope of the inverse hyperbolic cosine is unbounded at 1, which the quantity may be")
    leg = ia.root(ia.product(ia.difference(x, ONE), ia.sum_of(x, ONE)))
    return rising("log", ia.sum_of(x, leg)), ia.inverse(leg)


def logistic(x: Interval) -> Ranges:
    """1 / (1 + e^-x); its slope is sech(x / 2)^2 / 4."""
    low, high = rising("logistic", x)
    slope = even("sech2", ia.product(HALF, x))
    return (np.maximum(low, 0.0), np.minimum(high, 1.0)), ia.product((0.25, 0.25), slope)


def _times(name: str) -> Callable[[Interval], Ranges]:
    def function(x: Interval) -> Ranges:
        return ia.product(x, constant(name)), constant(name)

    return function


def logaddexp(a: Interval, b: Interval) -> tuple[Interval, Interval]:
    """ln(e^a + e^b), increasing in both, and its slope by a; that by b is 1 minus it."""
    ends = [_logaddexp((x, x), (y, y)) for x, y in zip(a, b, strict=True)]
    return (ends[0][0], ends[1][1]), logistic(ia.difference(a, b))[0]


def _logaddexp(a: Interval, b: Interval) -> Interval:
    larger = np.maximum(a[0], b[0])
    low, high = ia.negative(ia.sizes(ia.difference(a, b)))
    return ia.sum_of((larger, larger), rising("log1p", rising("exp", (low, high))))


NAMED: dict[str, Callable[[Interval], Ranges]] = {
    **{f.__name__: f for f in (exp, expm1, exp2, log, log1p, sqrt, cbrt, sin, cos, tan, tanh, arctan, arcsin, arccos)},
    **{f.__name__: f for f in (sinh, cosh, arcsinh, arctanh, arccosh)},
    "expit": logistic,
    "log2": _logarithm("ln 2"),
    "log10": _logarithm("ln 10"),
    "deg2rad": _times("degree"),
    "radians": _times("degree"),
    "rad2deg": _times("radian"),
    "degrees": _times("radian"),
}
