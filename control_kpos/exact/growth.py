"""Relative growth: by how many percent a quantity grows when a variable grows by one percent.

For a quantity f and variables x_i, numbers g_i are enclosed with

    x_i df/dx_i = g_i f    everywhere on the box.

Products add their growth, quotients subtract it, powers multiply it, and a sum of two quantities of one sign grows by a
mean of theirs.  So the sign of df/dx_i is seen where f and its derivative vanish together: x^3 / (1 + x + x^3) grows by
3 - g percent, and g, that of the denominator, is a mean of 0, 1 and 3.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import interval_arithmetic as ia
from .bends import product, sum_of
from .interval_arithmetic import Interval

_OPEN = (-np.inf, np.inf)
# Bounds of a f'(a) / f(a) for a >= 0, where f(0) = 0: f is concave or convex on all of a >= 0, or a root.
_OF = {
    **dict.fromkeys(("log1p", "tanh", "arctan", "arcsinh"), (0.0, 1.0)),
    **dict.fromkeys(("expm1", "sinh", "arcsin", "arctanh"), (1.0, np.inf)),
    **dict.fromkeys(("deg2rad", "radians", "rad2deg", "degrees"), (1.0, 1.0)),
    "sqrt": ia.HALF,
    "cbrt": ia.inverse((3.0, 3.0)),
}


class Growth(NamedTuple):
    """Relative growth by each variable, on each box.

    Attributes
    ----------
    variables, share : pair of arrays, shape (..., k)
        Bounds of the variables, and of the growth, which are infinite where nothing is known.
    """

    variables: Interval
    share: Interval


def negative(a: Growth | None) -> Growth | None:
    """That of 1 / f."""
    return None if a is None else a._replace(share=ia.negative(a.share))


def added(a: Growth | None, b: Growth | None) -> Growth | None:
    """That of a product; a number does not grow."""
    if a is None or b is None:
        return a if b is None else b
    return a._replace(share=sum_of(a.share, b.share))


def scaled(factor: Interval, a: Growth | None) -> Growth | None:
    """That of a power."""
    return None if a is None else a._replace(share=product(_spread(factor), a.share))


def mean(a: Growth | None, first: Interval, b: Growth | None, second: Interval) -> Growth | None:
    """That of a sum, known where both terms have the same sign."""
    known = b if a is None else a
    if known is None:
        return None
    zero = np.zeros(1), np.zeros(1)
    low, high = ia.hull(zero if a is None else a.share, zero if b is None else b.share)
    same = np.asarray(((first[0] >= 0) & (second[0] >= 0)) | ((first[1] <= 0) & (second[1] <= 0)))[..., None]
    return known._replace(share=(np.where(same, low, -np.inf), np.where(same, high, np.inf)))


def either(a: Growth | None, b: Growth | None) -> Growth | None:
    """That of a quantity which is one of two."""
    same = (0.0, 0.0), (0.0, 0.0)
    return mean(a, same[0], b, same[1])


def unknown(a: Growth | None, b: Growth | None) -> Growth | None:
    """That of a quantity of which nothing is known yet."""
    known = b if a is None else a
    return None if known is None else known._replace(share=_OPEN)


def of_function(name: str, a: Growth | None, value: Interval, gradient: Interval) -> Growth | None:
    """That of a function of a quantity with this value and these derivatives."""
    if a is None:
        return None
    if name == "exp":
        return a._replace(share=product(a.variables, gradient))
    least, most = _OF.get(name, _OPEN)
    right = value[0] >= 0
    return scaled((np.where(right, least, -np.inf), np.where(right, most, np.inf)), a)


def _spread(a: Interval) -> Interval:
    return np.asarray(a[0])[..., None], np.asarray(a[1])[..., None]


@np.errstate(all="ignore")
def met(a: Growth, value: Interval, gradient: Interval) -> tuple[Growth, Interval]:
    """Growth and derivatives, each narrowed by what the other and the value say of it."""
    value, share = _spread(value), a.share
    if np.isinf(share[0]).any() or np.isinf(share[1]).any():
        share = ia.common(share, _from_derivatives(a.variables, value, gradient))
    least, most = a.variables
    # On a side x_i = 0 alone nothing follows; at an end of a wider one the derivatives from inside do.
    up, down = (least >= 0) & (most > 0), (most <= 0) & (least < 0)
    low, high = product(share, value)
    size = ia.sizes(a.variables)
    least, most = _least(np.where(up, low, -high), size), -_least(np.where(up, -high, low), size)
    known = up | down
    return a._replace(share=share), ia.common(
        gradient, (np.where(known, least, -np.inf), np.where(known, most, np.inf))
    )


def _from_derivatives(variables: Interval, value: Interval, gradient: Interval) -> Interval:
    """x f' / f, where f is not zero; and zero where f' is."""
    away = (value[0] > 0) | (value[1] < 0)
    per = ia.loose_inverse((np.where(away, value[0], 1.0), np.where(away, value[1], 1.0)))
    ratio = product(variables, gradient, per)
    still = (gradient[0] == 0) & (gradient[1] == 0)
    low, high = (np.where(still, 0.0, np.where(away, end, none)) for end, none in zip(ratio, _OPEN, strict=True))
    return low, high


def _least(rate: Any, size: Interval) -> Any:
    """The lower end of a rate over numbers > 0 between bounds, of which the lower one may be zero."""
    down = ia.below(rate / np.where(rate > 0, size[1], size[0]))
    return np.where(rate > 0, np.maximum(down, 0.0), np.where(rate == 0, 0.0, down))
