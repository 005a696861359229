"""Sums, products and quotients of intervals between doubles, rounded outwards, entry by entry.

An interval is a pair of numbers, or of arrays of one shape; shapes are combined as numpy does.  Each operation returns
an enclosure of all results; one that would not be finite is refused.  Results that are doubles by construction
(products with zero or a power of two, sums without rounding) are exact, so that signs survive.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .rounding import SMALLEST_NORMAL
from .unreadable import UnboundedError

Array = NDArray[np.float64]
Interval = tuple[Any, Any]

UNBOUNDED = "a value or derivative is not bounded"
ZERO, HALF, ONE = (0.0, 0.0), (0.5, 0.5), (1.0, 1.0)
MAY_BE_ZERO = "division by a quantity that may be zero"


def below(x: Any) -> Any:
    """The next smaller double."""
    return np.nextafter(x, -np.inf)


def above(x: Any) -> Any:
    """The next larger double."""
    return np.nextafter(x, np.inf)


@np.errstate(all="ignore")
def outwards(low: Any, high: Any) -> Interval:
    """The next smaller and the next larger double."""
    return bounded((below(low), above(high)))


def is_bounded(a: Interval) -> bool:
    """Whether no end is infinite or not a number."""
    return bool(np.isfinite(a[0]).all() and np.isfinite(a[1]).all())


def bounded(a: Interval) -> Interval:
    """The interval, unless an end is infinite or not a number."""
    if is_bounded(a):
        return a
    raise UnboundedError(UNBOUNDED)


def negative(a: Interval) -> Interval:
    """-a."""
    return -a[1], -a[0]


@np.errstate(all="ignore")
def product(a: Interval, b: Interval) -> Interval:
    """Product of intervals.  A product with an exact zero is an exact zero, and signs survive."""
    return bounded(loose_product(a, b))


@np.errstate(all="ignore")
def loose_product(a: Interval, b: Interval) -> Interval:
    """The product, which may be infinite."""
    first = [(x, x == 0, is_power_of_two(x)) for x in (a[:1] if a[0] is a[1] else a)]
    second = [(x, x == 0, is_power_of_two(x)) for x in (b[:1] if b[0] is b[1] else b)]
    low = high = None
    for x, x_zero, x_power in first:
        for y, y_zero, y_power in second:
            p = x * y
            exact = x_zero | y_zero | ((x_power | y_power) & (np.abs(p) >= SMALLEST_NORMAL))
            down, up = (p, p) if np.all(exact) else (np.where(exact, p, below(p)), np.where(exact, p, above(p)))
            low = down if low is None else np.minimum(low, down)
            high = up if high is None else np.maximum(high, up)
    return low, high


def is_power_of_two(x: Any) -> Any:
    """Whether products with it are exact, but for underflow."""
    return np.abs(np.frexp(x)[0]) == 0.5


@np.errstate(all="ignore")
def sum_of(a: Interval, b: Interval) -> Interval:
    """Sum of intervals, rounded only where rounding happened (Knuth's error of a sum)."""
    return bounded(loose_sum(a, b))


@np.errstate(all="ignore")
def loose_sum(a: Interval, b: Interval) -> Interval:
    """The sum, which may be infinite."""
    low, high = a[0] + b[0], a[1] + b[1]
    too_high, too_low = _error(a[0], b[0], low) < 0, _error(a[1], b[1], high) > 0
    return (
        np.where(too_high, below(low), low) if np.any(too_high) else low,
        np.where(too_low, above(high), high) if np.any(too_low) else high,
    )


def _error(x: Any, y: Any, total: Any) -> Any:
    """x + y - total, exactly, where total is the rounded sum."""
    back = total - x
    return (x - (total - back)) + (y - back)


def difference(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return sum_of(a, negative(b))


def may_be_zero(a: Interval) -> bool:
    """Whether some interval holds zero."""
    return bool(np.any((a[0] <= 0) & (a[1] >= 0)))


@np.errstate(all="ignore")
def inverse(a: Interval) -> Interval:
    """Range of 1 / x."""
    if may_be_zero(a):
        raise UnboundedError(MAY_BE_ZERO)
    return bounded(loose_inverse(a))


@np.errstate(all="ignore")
def loose_inverse(a: Interval) -> Interval:
    """Range of 1 / x for intervals without zero, which may be infinite."""
    low, high = 1 / a[1], 1 / a[0]
    exact = is_power_of_two(a[1]), is_power_of_two(a[0])
    low = np.where(exact[0] & (np.abs(low) >= SMALLEST_NORMAL), low, below(low))
    return low, np.where(exact[1] & (np.abs(high) >= SMALLEST_NORMAL), high, above(high))


def quotient(a: Interval, b: Interval) -> Interval:
    """a / b, where b does not hold zero."""
    return product(a, inverse(b))


@np.errstate(all="ignore")
def root(a: Interval) -> Interval:
    """Range of the square root, which processors round correctly."""
    low, high = np.sqrt(np.maximum(a[0], 0.0)), np.sqrt(a[1])
    return bounded((np.where(low == 0, low, below(low)), np.where(high == 0, high, above(high))))


@np.errstate(all="ignore")
def integer_power(a: Interval, power: int) -> Interval:
    """Range of x^k, k >= 0."""
    if power == 0:
        return np.ones_like(a[0]), np.ones_like(a[1])
    if power % 2 == 0:
        a = sizes(a)
    ends = [(np.asarray(x), np.asarray(x)) for x in a]
    powers = [_multiplied(end, power) for end in ends]
    low, high = powers[0][0], powers[1][1]
    return bounded((np.maximum(low, 0.0) if power % 2 == 0 else low, high))


def _multiplied(a: Interval, power: int) -> Interval:
    """x^k for numbers x, by squaring."""
    if power == 1:
        return a
    half = _multiplied(loose_product(a, a), power // 2)
    return loose_product(half, a) if power % 2 else half


def sizes(a: Interval) -> Interval:
    """Range of |x|."""
    least = np.maximum(np.maximum(a[0], -a[1]), 0.0)
    return least, np.maximum(np.abs(a[0]), np.abs(a[1]))


def hull(*parts: Interval) -> Interval:
    """The smallest interval that holds all parts."""
    low, high = parts[0]
    for a, b in parts[1:]:
        low, high = np.minimum(low, a), np.maximum(high, b)
    return low, high


def common(*parts: Interval) -> Interval:
    """What all parts, which enclose the same numbers, have in common."""
    low, high = parts[0]
    for a, b in parts[1:]:
        low, high = np.maximum(low, a), np.minimum(high, b)
    return low, high
