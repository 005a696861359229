"""Elementary functions of many doubles at once, enclosed between doubles by arithmetic alone.

The argument is reduced, a Taylor polynomial is summed by Horner's rule, and the error bound is the lemma of
`docs/rounding.md`: a term that passes through k roundings is off by at most a factor 1 + (k + 1) u, u = 2^-53.  The
bounds stand in `docs/rounding.md`, section "Elementary functions"; no function of the C library enters.  Functions take
an array and return lower and upper bounds of its shape; `elementary` encloses single numbers more tightly.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import interval_arithmetic as ia
from .interval_arithmetic import ONE, Interval
from .rounding import HALF_ULP, underflow

Array = NDArray[np.float64]

# Roundings that no sum below exceeds, with what is left out of the series; see `docs/rounding.md`.
_UNITS = 64
# ln 2 and pi / 2 in pieces; multiples of the pieces of 32 bits by small integers are exact.
_LN2 = (float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33"))
_QUARTER = (
    float.fromhex("0x1.921fb54400000p+0"),
    float.fromhex("0x1.0b4611a600000p-34"),
    float.fromhex("0x1.3198a2e037073p-69"),
)
_PER_LN2, _PER_QUARTER = 1.4426950408889634, 0.6366197723675814
# Sine and cosine of larger numbers are enclosed by [-1, 1].
_FARTHEST = 2.0**16
# Quarter turns that are nearer than this to an integer may be on either side of it.
_DOUBT = 1e-9
# Where exp leaves the doubles.
_HIGHEST, _LOWEST = 709.78, -745.2

_EXP = [1 / math.factorial(k) for k in range(14)]
_SIN = [(-1) ** k / math.factorial(2 * k + 1) for k in range(10)]
_COS = [(-1) ** k / math.factorial(2 * k) for k in range(11)]
_ATANH = [1 / (2 * k + 1) for k in range(13)]
_ATAN = [(-1) ** k / (2 * k + 1) for k in range(14)]


def _horner(coefficients: list[float], x: Array) -> Array:
    total = np.full_like(x, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        total = total * x + c
    return total


def _within(value: Array, error: Any) -> Interval:
    """value - error and value + error, rounded outwards for the roundings of both."""
    wide = error * (1 + 8 * HALF_ULP) + np.abs(value) * (2 * HALF_ULP) + underflow(1)
    return ia.below(value - wide), ia.above(value + wide)


@np.errstate(all="ignore")
def exp(x: Array) -> Interval:
    """e^x = 2^n e^r, |r| <= 0.35."""
    n = np.rint(np.clip(x, _LOWEST, _HIGHEST) * _PER_LN2)
    r = (x - n * _LN2[0]) - n * _LN2[1]
    value = _horner(_EXP, r)
    error = value * (_UNITS * HALF_ULP)
    low, high = (np.ldexp(end, n.astype(int)) for end in _within(value, error))
    low, high = np.maximum(ia.below(low), 0.0), ia.above(high)
    low = np.where(x > _HIGHEST, 1.79e308, np.where(x < _LOWEST, 0.0, low))
    high = np.where(x > _HIGHEST, np.inf, np.where(x < _LOWEST, 5e-324, high))
    return np.where(x == 0, 1.0, low), np.where(x == 0, 1.0, high)


@np.errstate(all="ignore")
def log(x: Array) -> Interval:
    """ln x = n ln 2 + 2 artanh((m - 1) / (m + 1)), m between the roots of 1/2 and 2; x > 0."""
    m, n = np.frexp(x)
    small = m < 0.7071067811865476
    m, n = np.where(small, 2 * m, m), (n - small).astype(float)
    s = (m - 1) / (m + 1)
    part = 2 * s * _horner(_ATANH, s * s)
    whole = n * _LN2[0]
    value = whole + (part + n * _LN2[1])
    low, high = _within(value, (_UNITS * np.abs(part) + 4 * np.abs(value) + np.abs(n * 2.0**-20)) * HALF_ULP)
    return np.where(x == 1, 0.0, low), np.where(x == 1, 0.0, high)


@np.errstate(all="ignore")
def arctan(x: Array) -> Interval:
    """By the inverse for |x| > 1, and halved twice: arctan t = 2 arctan(t / (1 + sqrt(1 + t^2)))."""
    size = np.abs(x)
    far = size > 1
    t = np.where(far, 1 / np.where(far, size, 1.0), size)
    for _ in range(2):
        t = t / (1 + np.sqrt(1 + t * t))
    part = 4 * t * _horner(_ATAN, t * t)
    value = np.where(far, _QUARTER[0] + _QUARTER[1] - part, part)
    low, high = _within(value, (_UNITS * np.abs(part) + 4 * far) * HALF_ULP)
    low, high = np.where(x == 0, 0.0, np.maximum(low, 0.0)), np.where(x == 0, 0.0, high)
    return np.where(x < 0, -high, low), np.where(x < 0, -low, high)


@np.errstate(all="ignore")
def _sine_and_cosine(x: Array) -> tuple[Interval, Interval]:
    n = np.rint(x * _PER_QUARTER)
    r = ((x - n * _QUARTER[0]) - n * _QUARTER[1]) - n * _QUARTER[2]
    s, c = r * _horner(_SIN, r * r), _horner(_COS, r * r)
    sine, cosine = (
        _within(s, _UNITS * HALF_ULP * np.where(n == 0, np.abs(r), 1.0)),
        _within(c, _UNITS * HALF_ULP + 0 * r),
    )
    turn = n % 4
    first = [_picked(turn, parts) for parts in zip(sine, cosine, ia.negative(sine), ia.negative(cosine), strict=True)]
    turned = [_picked(turn, parts) for parts in zip(cosine, ia.negative(sine), ia.negative(cosine), sine, strict=True)]
    far = np.abs(x) > _FARTHEST
    ends = [np.where(far, side, np.clip(end, -1, 1)) for end, side in zip(first + turned, (-1, 1, -1, 1), strict=True)]
    ends = [np.where(x == 0, exact, end) for end, exact in zip(ends, (0.0, 0.0, 1.0, 1.0), strict=True)]
    return (ends[0], ends[1]), (ends[2], ends[3])


def _picked(turn: Array, parts: tuple[Array, ...]) -> Array:
    return np.select([turn == k for k in range(4)], list(parts))


@np.errstate(all="ignore")
def sine_and_cosine(value: Interval) -> tuple[Interval, Interval]:
    """Ranges of sine and cosine on intervals; an extremum at an end that is in doubt counts as reached."""
    low, high = value
    first, last = np.ceil(low * _PER_QUARTER - _DOUBT), np.floor(high * _PER_QUARTER + _DOUBT)
    ends = [_sine_and_cosine(low), _sine_and_cosine(high)]
    far = (np.abs(low) > _FARTHEST) | (np.abs(high) > _FARTHEST)

    def reached(quarter: int) -> Any:
        return far | ((quarter - first) % 4 <= last - first)

    def span(parts: list[Interval], lowest: int, highest: int) -> Interval:
        bottom, top = ia.hull(*parts)
        return np.where(reached(lowest), -1.0, bottom), np.where(reached(highest), 1.0, top)

    return span([s for s, _ in ends], 3, 1), span([c for _, c in ends], 2, 0)


# -- from these, with inequalities that are tight near zero


def _odd(half: Any) -> Any:
    """An odd function, from its values at |x|."""

    @np.errstate(all="ignore")
    def function(x: Array) -> Interval:
        low, high = half(np.abs(x))
        low, high = np.where(x == 0, 0.0, np.maximum(low, 0.0)), np.where(x == 0, 0.0, high)
        return np.where(x < 0, -high, low), np.where(x < 0, -low, high)

    return function


@np.errstate(all="ignore")
def expm1(x: Array) -> Interval:
    """e^x - 1, which is between x and x e^x."""
    power = exp(x)
    low, high = ia.loose_sum(power, (-1.0, -1.0))
    return np.maximum(low, x), np.minimum(high, ia.loose_product((x, x), power)[1])


@np.errstate(all="ignore")
def log1p(x: Array) -> Interval:
    """ln(1 + x), which is between x / (1 + x) and x; x > -1, or it is not bounded below."""
    total = ia.loose_sum(ONE, (x, x))
    least, most = (np.where(end > 0, end, 1.0) for end in total)
    ratio = ia.loose_product((x, x), (ia.below(1 / most), ia.above(1 / least)))[0]
    low = np.where(total[0] > 0, np.maximum(log(least)[0], ratio), -np.inf)
    high = np.where(total[1] > 0, np.minimum(log(most)[1], x), np.inf)
    return np.where(x == 0, 0.0, low), high


@np.errstate(all="ignore")
def _tanh(x: Array) -> Interval:
    """(1 - t) / (1 + t), t = e^-2x, which is between x - x^3 / 3 and x; x >= 0."""
    t = exp(-2 * x)
    low, high = ia.quotient(ia.difference(ONE, t), ia.sum_of(ONE, t))
    near = np.minimum(x, 1.0)
    return np.maximum(low, ia.below(near * (1 - near * near * 0.334))), np.minimum(high, near)


@np.errstate(all="ignore")
def sech2(x: Array) -> Interval:
    """1 / cosh(x)^2 = 4 t / (1 + t)^2, t = e^-2|x|."""
    t = exp(-2 * np.abs(x))
    total = ia.sum_of(ONE, t)
    return ia.quotient(ia.product((4.0, 4.0), t), ia.product(total, total))


@np.errstate(all="ignore")
def _sinh(x: Array) -> Interval:
    """(e^x - e^-x) / 2, which is at least x; x >= 0."""
    low, high = ia.loose_sum(exp(x), ia.negative(exp(-x)))
    return np.maximum(low / 2, x), ia.above(high / 2)


@np.errstate(all="ignore")
def cosh(x: Array) -> Interval:
    """(e^x + e^-x) / 2, which is at least 1."""
    low, high = ia.loose_sum(exp(np.abs(x)), exp(-np.abs(x)))
    return np.maximum(ia.below(low / 2), 1.0), np.where(x == 0, 1.0, ia.above(high / 2))


@np.errstate(all="ignore")
def logistic(x: Array) -> Interval:
    """1 / (1 + e^-x)."""
    t = exp(-np.abs(x))
    above = np.where(x < 0, t[0], 1.0), np.where(x < 0, t[1], 1.0)
    return ia.quotient(above, ia.sum_of(ONE, t))


tanh, sinh = _odd(_tanh), _odd(_sinh)
