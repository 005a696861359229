"""Intervals with derivatives: enclosures of a function and of its Jacobian on a box.

A user's function is called with objects of `IntervalDual` in place of numbers.  Every operation rounds
outwards, so that what comes out encloses all values and all partial derivatives on the box.  Elementary
functions are enclosed at the ends of intervals, by `elementary`.  Functions that are not made of arithmetic
and the usual elementary functions cannot be called this way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from flint import arb
from numpy.typing import NDArray

from ..errors import DataError, ShapeError
from .elementary import Interval, enclosed, integer_power, real_power, sine_and_cosine

Array = NDArray[np.float64]

# An unbounded enclosure is cut in two this often before it is given up.
_DEEPEST = 10


class UnboundedError(ArithmeticError):
    """A value or a derivative is not bounded on the box."""


class UnsupportedError(TypeError):
    """The function does something with its argument that intervals do not know."""


def _out(low: Any, high: Any) -> tuple[Any, Any]:
    return _finite(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))


def _finite(low: Any, high: Any) -> tuple[Any, Any]:
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise UnboundedError("a value or derivative is not bounded")
    return low, high


def _times(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[Any, Any]:
    """Product of intervals.  A product with an exact zero is an exact zero, and signs survive."""
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        pairs = [np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float)) for x in a for y in b]
        low, high = np.full(pairs[0][0].shape, np.inf), np.full(pairs[0][0].shape, -np.inf)
        for x, y in pairs:
            product, exact = x * y, (x == 0) | (y == 0)
            low = np.minimum(low, np.where(exact, 0.0, np.nextafter(product, -np.inf)))
            high = np.maximum(high, np.where(exact, 0.0, np.nextafter(product, np.inf)))
    return _finite(low, high)


def _plus(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[Any, Any]:
    """Sum of intervals, rounded only where rounding happened (Knuth's error of a sum)."""
    with np.errstate(over="ignore", invalid="ignore"):
        sums = [np.asarray(x, dtype=float) + y for x, y in zip(a, b, strict=True)]
        errors = []
        for x, y, s in zip(a, b, sums, strict=True):
            back = s - x
            errors.append((x - (s - back)) + (y - back))
        low = np.where(errors[0] < 0, np.nextafter(sums[0], -np.inf), sums[0])
        high = np.where(errors[1] > 0, np.nextafter(sums[1], np.inf), sums[1])
    return _finite(low, high)


class IntervalDual:
    """All values of a quantity on a box, and of its partial derivatives.

    Parameters
    ----------
    value : pair of float
        Lower and upper bound.
    gradient : pair of ndarray, shape (n,)
        Bounds of the partial derivatives.
    """

    __array_priority__ = 1000
    __slots__ = ("gradient", "value")

    def __init__(self, value: Interval, gradient: tuple[Array, Array]) -> None:
        self.value, self.gradient = value, gradient

    def _chain(self, value: Interval, slope: Interval) -> IntervalDual:
        return IntervalDual(_finite(*value), _times(self.gradient, _finite(*slope)))

    def _read(self, other: Any) -> IntervalDual:
        if isinstance(other, IntervalDual):
            return other
        if isinstance(other, (int, float, np.integer, np.floating)) and np.isfinite(other):
            zero = np.zeros_like(self.gradient[0])
            exact = float(other)
            value = (exact, exact) if exact == other else _out(exact, exact)
            return IntervalDual(value, (zero, zero))
        raise UnsupportedError(f"arithmetic with {type(other).__name__}")

    def __add__(self, other: Any) -> IntervalDual:
        if isinstance(other, np.ndarray):
            return NotImplemented
        b = self._read(other)
        return IntervalDual(_plus(self.value, b.value), _plus(self.gradient, b.gradient))

    __radd__ = __add__

    def __neg__(self) -> IntervalDual:
        return IntervalDual((-self.value[1], -self.value[0]), (-self.gradient[1], -self.gradient[0]))

    def __pos__(self) -> IntervalDual:
        return self

    def __sub__(self, other: Any) -> IntervalDual:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self + (-self._read(other))

    def __rsub__(self, other: Any) -> IntervalDual:
        return self._read(other) + (-self)

    def __mul__(self, other: Any) -> IntervalDual:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if other is self:
            return self**2
        b = self._read(other)
        first, second = _times(self.gradient, b.value), _times(b.gradient, self.value)
        return IntervalDual(_times(self.value, b.value), _plus(first, second))

    __rmul__ = __mul__

    def reciprocal(self) -> IntervalDual:
        """1 / x."""
        value = _inverse(self.value)
        slope = _times(value, value)
        return IntervalDual(value, _times(self.gradient, (-slope[1], -slope[0])))

    def __truediv__(self, other: Any) -> IntervalDual:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self * self._read(other).reciprocal()

    def __rtruediv__(self, other: Any) -> IntervalDual:
        return self._read(other) * self.reciprocal()

    def __pow__(self, power: Any) -> IntervalDual:
        if isinstance(power, (float, np.floating)) and float(power).is_integer():
            power = int(power)
        if isinstance(power, (int, np.integer)):
            power = int(power)
            if power < 0:
                return (self**-power).reciprocal()
            if power == 0:
                return self._read(1.0)
            slope = _times(self._read(power).value, _power(self.value, power - 1))
            return IntervalDual(_power(self.value, power), _times(self.gradient, slope))
        if isinstance(power, (float, np.floating)):
            if self.value[0] <= 0:
                raise UnboundedError("a logarithm of a quantity that may be zero or negative")
            slope = _hull(*(real_power(x, float(power), 1) for x in self.value))
            value = _hull(*(real_power(x, float(power)) for x in self.value))
            return self._chain(value, _times((float(power), float(power)), _finite(*slope)))
        raise UnsupportedError(f"a power of type {type(power).__name__}")

    def __rpow__(self, base: Any) -> IntervalDual:
        return (self * self._read(base).log()).exp()

    # numpy calls these methods for its functions of the same names

    def square(self) -> IntervalDual:
        """x squared."""
        return self**2

    def sin(self) -> IntervalDual:
        """sin x."""
        return self._chain(*sine_and_cosine(self.value))

    def cos(self) -> IntervalDual:
        """cos x."""
        (low, high), value = sine_and_cosine(self.value)
        return self._chain(value, (-high, -low))

    def tan(self) -> IntervalDual:
        """tan x."""
        return self.sin() / self.cos()

    def exp(self) -> IntervalDual:
        """e to the x."""
        value = _rising(arb.exp, self.value)
        return self._chain(value, value)

    def log(self) -> IntervalDual:
        """Natural logarithm."""
        if self.value[0] <= 0:
            raise UnboundedError("a logarithm of a quantity that may be zero or negative")
        return self._chain(_rising(arb.log, self.value), _inverse(self.value))

    def sqrt(self) -> IntervalDual:
        """Square root."""
        if self.value[0] <= 0:
            raise UnboundedError("a square root of a quantity that may be zero or negative")
        value = _rising(arb.sqrt, self.value)
        return self._chain(value, _times((0.5, 0.5), _inverse(value)))

    def tanh(self) -> IntervalDual:
        """tanh x."""
        low, high = _rising(arb.tanh, self.value)
        return self._chain((max(low, -1.0), min(high, 1.0)), _even(lambda ball: ball.sech() ** 2, self.value))

    def arctan(self) -> IntervalDual:
        """arctan x."""
        return self._chain(_rising(arb.atan, self.value), _even(lambda ball: 1 / (1 + ball * ball), self.value))

    def sinh(self) -> IntervalDual:
        """sinh x."""
        return self._chain(_rising(arb.sinh, self.value), _even(arb.cosh, self.value))

    def cosh(self) -> IntervalDual:
        """cosh x."""
        return self._chain(_even(arb.cosh, self.value), _rising(arb.sinh, self.value))

    def __abs__(self) -> IntervalDual:
        low, high = self.value
        if low >= 0:
            return self
        if high <= 0:
            return -self
        reach = np.maximum(np.abs(self.gradient[0]), np.abs(self.gradient[1]))
        return IntervalDual((0.0, max(-low, high)), (-reach, reach))

    absolute = fabs = __abs__

    def _refuse(self, *_: Any) -> Any:
        raise UnsupportedError("comparisons and conversions to float have no meaning for intervals")

    __float__ = __int__ = __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __index__ = _refuse


def _inverse(value: Interval) -> Interval:
    """Range of 1 / x."""
    low, high = value
    if low <= 0 <= high:
        raise UnboundedError("division by a quantity that may be zero")
    with np.errstate(over="ignore"):
        return _out(1 / high, 1 / low)


def _hull(*parts: Interval) -> Interval:
    """The smallest interval that holds all parts."""
    return min(low for low, _ in parts), max(high for _, high in parts)


def _rising(function: Callable[[Any], Any], value: Interval) -> Interval:
    """Range of an increasing function."""
    return enclosed(function, value[0])[0], enclosed(function, value[1])[1]


def _even(function: Callable[[Any], Any], value: Interval) -> Interval:
    """Range of an even function that is monotone in |x|: from the number nearest to zero to the farthest."""
    nearest = min(max(value[0], 0.0), value[1])
    farthest = max(value, key=abs)
    return _hull(enclosed(function, nearest), enclosed(function, farthest))


def _power(value: Interval, power: int) -> Interval:
    """Range of x^k, rounded outwards; exact zeros stay."""
    if power == 0:
        return 1.0, 1.0
    ends = [integer_power(x, power) for x in value]
    if power % 2 == 0 and value[0] < 0 < value[1]:
        ends.append((0.0, 0.0))
    return _finite(*_hull(*ends))


def jacobian_enclosure(
    function: Callable[[Any], Any], lower: Sequence[float] | Array, upper: Sequence[float] | Array
) -> tuple[Array, Array]:
    """Bounds of the Jacobian of a function on a box.

    Parameters
    ----------
    function : callable
        Takes an object array of n quantities, returns n quantities; made of arithmetic and elementary
        functions.
    lower, upper : array_like, shape (n,)

    Returns
    -------
    low, high : ndarray, shape (n, n)
        Proven: every Jacobian on the box lies between them.

    Raises
    ------
    UnboundedError, UnsupportedError

    Examples
    --------
    >>> low, high = jacobian_enclosure(lambda x: [x[1], -np.sin(x[0])], [-1, 0], [1, 0])
    >>> bool(low[1, 0] <= -1 and high[1, 0] >= -np.cos(1)), low[0].round(3), high[0].round(3)
    (True, array([0., 1.]), array([0., 1.]))
    """
    n = len(lower)
    x = np.empty(n, dtype=object)
    for i, (a, b) in enumerate(zip(lower, upper, strict=True)):
        unit = np.zeros(n)
        unit[i] = 1.0
        x[i] = IntervalDual((float(a), float(b)), (unit, unit))
    try:
        values = list(np.asarray(function(x), dtype=object).ravel())
    except UnboundedError:
        raise
    except (TypeError, AttributeError, ValueError, NotImplementedError) as error:
        raise UnsupportedError(str(error)) from None
    zero = np.zeros(n)
    rows = [y.gradient if isinstance(y, IntervalDual) else (zero, zero) for y in values]
    return np.array([low for low, _ in rows]), np.array([high for _, high in rows])


def enclosed_jacobian(function: Callable[[Any], Any], box: Array, n: int) -> tuple[Array, Array]:
    """Midpoint and radius of the Jacobian with respect to the first n quantities."""
    low, high = jacobian_enclosure(function, box[:, 0], box[:, 1])
    if low.shape[0] != n:
        raise ShapeError(f"the system's update function returned {low.shape[0]} values for {n} states.")
    low, high = low[:, :n], high[:, :n]
    centre = 0.5 * low + 0.5 * high
    exact = low == high
    radius = np.nextafter(np.maximum(np.nextafter(centre - low, np.inf), np.nextafter(high - centre, np.inf)), np.inf)
    # An end that is exactly zero stays exactly zero: h'J x >= 0 may hold with equality there.
    at_zero = ((low == 0) | (high == 0)) & ~exact
    centre = np.where(exact, low, np.where(at_zero, 0.5 * (low + high), centre))
    return centre, np.where(exact, 0.0, np.where(at_zero, np.abs(centre), radius))


def jacobian_pieces(
    function: Callable[[Any], Any],
    whole: Array,
    n: int,
    decided: Callable[[Array, Array], bool],
    most: int,
    late: Callable[[int], bool] = lambda _: False,
) -> Iterator[tuple[Array, Array]]:
    """Enclosures on at most `most` boxes that cover `whole`, cut in two where `decided` says no, until it is late.

    `late` is called with the number of boxes that wait.
    """
    waiting, produced = [(whole, 0)], 0
    while waiting:
        box, depth = waiting.pop()
        wide = box[:, 1] - box[:, 0]
        final = produced + len(waiting) + 1 >= most or not wide.any() or late(len(waiting) + 1)
        try:
            centre, radius = enclosed_jacobian(function, box, n)
        except UnboundedError as error:
            if final or depth >= _DEEPEST:
                corner = ", ".join(f"[{a:.4g}, {b:.4g}]" for a, b in box)
                raise DataError(
                    f"the Jacobian is unbounded on region {corner}: {error}; choose a smaller region."
                ) from None
            waiting += _halves(box, wide, depth)
            continue
        if final or decided(centre, radius):
            produced += 1
            yield centre, radius
        else:
            waiting += _halves(box, wide, depth)


def _halves(box: Array, wide: Array, depth: int) -> list[tuple[Array, int]]:
    """Cut the sides in turns, so that no direction is favoured by its units."""
    sides = np.flatnonzero(wide > 0)
    side = int(sides[depth % len(sides)])
    middle = 0.5 * (box[side, 0] + box[side, 1])
    first, second = box.copy(), box.copy()
    first[side, 1] = second[side, 0] = middle
    return [(second, depth + 1), (first, depth + 1)]


def jacobian_by_differences(function: Callable[[Array], Any], point: Array, box: Array) -> Array:
    """Jacobian with respect to the first len(box) quantities, by central differences: no enclosure."""
    columns = []
    with np.errstate(all="ignore"):
        for i, (low, high) in enumerate(box):
            step = np.zeros_like(point)
            step[i] = 1e-6 * max(1.0, abs(point[i]), high - low)
            ahead, behind = (np.asarray(function(point + s * step), dtype=float) for s in (1, -1))
            columns.append((ahead - behind) / (2 * step[i]))
    return np.column_stack(columns)


def box_points(box: Array, count: int) -> Iterator[Array]:
    """The centre, corners and random points of a box."""
    yield box.mean(axis=1)
    rng = np.random.default_rng(0)
    corners = min(2 ** len(box), count // 2)
    for k in range(corners):
        pick = [(k >> i) & 1 for i in range(len(box))] if corners == 2 ** len(box) else rng.integers(0, 2, len(box))
        yield box[np.arange(len(box)), pick]
    for _ in range(count - corners):
        yield box[:, 0] + rng.random(len(box)) * (box[:, 1] - box[:, 0])
