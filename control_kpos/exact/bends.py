"""Second derivatives: bounds of them on boxes, by the rules for sums, products, quotients and functions of a quantity.

They tell in which direction a derivative grows, so that it can be enclosed at the ends of a box.  A bound may be
infinite, which says nothing.  None stands for zero: a number has no second derivatives, and nobody asked for those of
other quantities.  The last two axes are those of the variables.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import functions
from . import interval_arithmetic as ia
from .interval_arithmetic import Interval
from .rounding import SMALLEST_NORMAL

Bend = tuple[Any, Any] | None

_LARGEST = float(np.finfo(float).max)


@np.errstate(all="ignore")
def product(first: Interval, *others: Interval) -> Interval:
    """Product of intervals; zero times something unbounded is zero."""
    for other in others:
        pairs = [_number(x, y) for x in first for y in other]
        low, high = zip(*pairs, strict=True)
        first = np.minimum(np.minimum.reduce(low), _LARGEST), np.maximum(np.maximum.reduce(high), -_LARGEST)
    return first


def _number(x: Any, y: Any) -> Interval:
    p = np.where((x == 0) | (y == 0), 0.0, x * y)
    exact = (x == 0) | (y == 0) | ((ia.is_power_of_two(x) | ia.is_power_of_two(y)) & (np.abs(p) >= SMALLEST_NORMAL))
    return np.where(exact, p, ia.below(p)), np.where(exact, p, ia.above(p))


@np.errstate(all="ignore")
def sum_of(a: Interval, b: Interval) -> Interval:
    """Sum of intervals."""
    low, high = ia.loose_sum(a, b)
    return np.minimum(low, _LARGEST), np.maximum(high, -_LARGEST)


def total(*parts: Bend) -> Bend:
    """The sum of second derivatives."""
    out = None
    for part in parts:
        out = part if out is None else out if part is None else sum_of(out, part)
    return out


def scaled(factor: Interval, bend: Bend) -> Bend:
    """A factor, one for each box, times second derivatives."""
    return None if bend is None else product((_spread(factor[0]), _spread(factor[1])), bend)


def _spread(x: Any) -> Any:
    return np.asarray(x)[..., None, None]


def negative(bend: Bend) -> Bend:
    """Those of -a."""
    return None if bend is None else ia.negative(bend)


def outer(a: Interval, b: Interval) -> Interval:
    """Products of the derivatives of a by the first variable with those of b by the second."""
    return product((a[0][..., :, None], a[1][..., :, None]), (b[0][..., None, :], b[1][..., None, :]))


def both(a: Interval, b: Interval) -> Interval:
    """a' b' for both orders of the variables, added."""
    first = outer(a, b)
    turned = np.swapaxes(first[0], -1, -2), np.swapaxes(first[1], -1, -2)
    return sum_of(first, turned)


def squared(a: Interval) -> Interval:
    """a' a', whose diagonal is not negative."""
    low, high = outer(a, a)
    return np.where(np.eye(low.shape[-1], dtype=bool), np.maximum(low, 0.0), low), high


def chained(slope: Interval, curvature: Interval, gradient: Interval, bend: Bend) -> Bend:
    """Those of f(a): f' a'' + f'' a' a'."""
    return total(scaled(slope, bend), scaled(curvature, squared(gradient)))


def unknown_where(unknown: Any, bend: Bend, like: Interval) -> Bend:
    """Nothing is said of some boxes."""
    shape = (*np.shape(like[0]), np.shape(like[0])[-1])
    low, high = (np.zeros(shape), np.zeros(shape)) if bend is None else bend
    where = _spread(unknown)
    return np.where(where, -np.inf, low), np.where(where, np.inf, high)


# -- second derivatives of functions


def integer_power(x: Interval, power: int) -> Interval:
    """k (k - 1) x^(k - 2)."""
    if power == 1:
        return 0.0, 0.0
    factor = float(power * (power - 1))
    return product((factor, factor), ia.integer_power(x, power - 2))


def real_power(x: Interval, power: Any) -> Interval:
    """p (p - 1) x^(p - 2) for x >= 0."""
    factor = ia.product((power, power), ia.sum_of((power, power), (-1.0, -1.0)))
    return product(factor, functions.power_or_infinite(x, ia.sum_of((power, power), (-2.0, -2.0))))


def _times(name: str, number: float, *powers: int) -> Callable[..., Interval]:
    """A number and powers of x, of the value and of the slope of a function, multiplied."""

    def curvature(*ranges: Interval) -> Interval:
        parts = [part for part, power in zip(ranges, powers, strict=True) for _ in range(power)]
        per = [functions.constant(name)] if name else []
        return product((number, number), *per, *parts)

    return curvature


def _of_logistic(_: Interval, value: Interval, slope: Interval) -> Interval:
    double = ia.difference(ia.ONE, ia.product((2.0, 2.0), value))
    return product(slope, double)


# By the argument x, the value and the slope: sqrt'' = -2 sqrt'^3, tan'' = 2 tan tan', and the like.
OF: dict[str, Callable[[Interval, Interval, Interval], Interval]] = {
    "exp": _times("", 1.0, 0, 1, 0),
    "expm1": _times("", 1.0, 0, 0, 1),
    "exp2": _times("ln 2", 1.0, 0, 0, 1),
    "log": _times("", -1.0, 0, 0, 2),
    "log1p": _times("", -1.0, 0, 0, 2),
    "log2": _times("ln 2", -1.0, 0, 0, 2),
    "log10": _times("ln 10", -1.0, 0, 0, 2),
    "sqrt": _times("", -2.0, 0, 0, 3),
    "cbrt": _times("", -6.0, 0, 1, 3),
    "sin": _times("", -1.0, 0, 1, 0),
    "cos": _times("", -1.0, 0, 1, 0),
    "tan": _times("", 2.0, 0, 1, 1),
    "tanh": _times("", -2.0, 0, 1, 1),
    "arctan": _times("", -2.0, 1, 0, 2),
    "arcsin": _times("", 1.0, 1, 0, 3),
    "arccos": _times("", 1.0, 1, 0, 3),
    "sinh": _times("", 1.0, 0, 1, 0),
    "cosh": _times("", 1.0, 0, 1, 0),
    "arcsinh": _times("", -1.0, 1, 0, 3),
    "arctanh": _times("", 2.0, 1, 0, 2),
    "arccosh": _times("", -1.0, 1, 0, 3),
    "expit": _of_logistic,
    **dict.fromkeys(("deg2rad", "radians", "rad2deg", "degrees"), _times("", 0.0, 0, 0, 0)),
}
