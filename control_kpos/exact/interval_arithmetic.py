"""Sums and products of intervals between doubles, rounded outwards, and of bounds of gradients.

An interval is a pair of floats; a gradient is a pair of arrays that bound its entries.  Each operation returns an
enclosure of all sums or products; a result that would not be finite is refused.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .unreadable import UnboundedError

Array = NDArray[np.float64]
Interval = tuple[float, float]
Gradient = tuple[Array, Array]

UNBOUNDED = "a value or derivative is not bounded"


def outwards(low: float, high: float) -> Interval:
    """The next smaller and the next larger double."""
    return bounded(math.nextafter(low, -math.inf), math.nextafter(high, math.inf))


def bounded(low: float, high: float) -> Interval:
    """The interval, unless an end is infinite or not a number."""
    if math.isfinite(low) and math.isfinite(high):
        return low, high
    raise UnboundedError(UNBOUNDED)


def product(a: Interval, b: Interval) -> Interval:
    """Product of intervals.  A product with an exact zero is an exact zero, and signs survive."""
    (low, high), (first, last) = a, b
    products = (low * first, low * last, high * first, high * last)
    zeros = (not low or not first, not low or not last, not high or not first, not high or not last)
    return bounded(
        min(0.0 if zero else math.nextafter(x, -math.inf) for x, zero in zip(products, zeros, strict=True)),
        max(0.0 if zero else math.nextafter(x, math.inf) for x, zero in zip(products, zeros, strict=True)),
    )


def sum_of(a: Interval, b: Interval) -> Interval:
    """Sum of intervals, rounded only where rounding happened (Knuth's error of a sum)."""
    low, high = a[0] + b[0], a[1] + b[1]
    if _error(a[0], b[0], low) < 0:
        low = math.nextafter(low, -math.inf)
    if _error(a[1], b[1], high) > 0:
        high = math.nextafter(high, math.inf)
    return bounded(low, high)


def _error(x: Any, y: Any, total: Any) -> Any:
    """x + y - total, exactly, where total is the rounded sum."""
    back = total - x
    return (x - (total - back)) + (y - back)


@np.errstate(all="ignore")
def scaled(gradient: Gradient, factor: Interval) -> Gradient:
    """`product` for every entry of a gradient."""
    if not gradient[0].size:
        return gradient
    ends, factors = np.stack(gradient)[:, None], np.array(factor, dtype=float)[:, None]
    products = (ends * factors).reshape(4, -1)
    exact = ((ends == 0) | (factors == 0)).reshape(4, -1)
    low = np.where(exact, 0.0, np.nextafter(products, -np.inf)).min(axis=0)
    return bounded_gradient(low, np.where(exact, 0.0, np.nextafter(products, np.inf)).max(axis=0))


@np.errstate(all="ignore")
def added(a: Gradient, b: Gradient) -> Gradient:
    """`sum_of` for every entry of two gradients."""
    if not a[0].size:
        return a
    low, high = a[0] + b[0], a[1] + b[1]
    low = np.where(_error(a[0], b[0], low) < 0, np.nextafter(low, -np.inf), low)
    return bounded_gradient(low, np.where(_error(a[1], b[1], high) > 0, np.nextafter(high, np.inf), high))


def bounded_gradient(low: Array, high: Array) -> Gradient:
    """The gradient, unless an entry has a bound that is infinite or not a number."""
    if np.isfinite(low).all() and np.isfinite(high).all():
        return low, high
    raise UnboundedError(UNBOUNDED)
