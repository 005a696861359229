"""Intervals with derivatives: enclosures of a function and of its Jacobian on a box.

A user's function is called with objects of `IntervalDual` in place of numbers.  Every operation rounds
outwards, so that what comes out encloses all values and all partial derivatives on the box.  The box has an
interior, or is a point at which the derivative exists: at an end of it, the slope from inside counts.  Elementary
functions are enclosed at the ends of intervals, by `elementary`.  Functions that are not made of arithmetic
and the usual elementary functions cannot be called this way.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import arb
from numpy.typing import NDArray

from .elementary import Interval, enclosed, integer_power, real_power, sine_and_cosine
from .interval_arithmetic import UNBOUNDED, Gradient, added, bounded, outwards, product, scaled, sum_of
from .unreadable import UnboundedError, Unreadable, UnsupportedError, note_kink, same_object

Array = NDArray[np.float64]

# Longer numbers are not kept exactly.
_LONGEST = 1000


class _Line(NamedTuple):
    """scale * a + shift, where a is a quantity with a name; a constant has none, and scale 0."""

    name: object
    value: Interval
    gradient: Gradient
    scale: Fraction = Fraction(1)
    shift: Fraction = Fraction(0)

    @property
    def key(self) -> tuple[Any, ...]:
        return self.name, self.scale, self.shift

    def moved(self, scale: Fraction, shift: Fraction) -> _Line | None:
        """scale * this + shift; None where the numbers grow too long."""
        if scale == 1 and not shift:
            return self
        scale, shift = scale * self.scale, scale * self.shift + shift
        if max(x.bit_length() for number in (scale, shift) for x in number.as_integer_ratio()) > _LONGEST:
            return None
        return self._replace(scale=scale, shift=shift)

    def plus(self, other: _Line) -> _Line | None:
        if other.name is None:
            return self.moved(Fraction(1), other.shift)
        if self.name is None:
            return other.moved(Fraction(1), self.shift)
        if self.name is other.name:
            return self._replace(scale=self.scale + other.scale).moved(Fraction(1), other.shift)
        return None

    def times(self, other: _Line) -> _Line | None:
        if other.name is None:
            return self.moved(other.shift, Fraction(0))
        return other.moved(self.shift, Fraction(0)) if self.name is None else None


class IntervalDual(Unreadable):
    """All values of a quantity on a box, and of its partial derivatives.

    Parameters
    ----------
    value : pair of float
        Lower and upper bound.
    gradient : pair of ndarray, shape (n,)
        Bounds of the partial derivatives.
    """

    __array_priority__ = 1000
    __slots__ = ("gradient", "line", "value")

    def __init__(self, value: Interval, gradient: Gradient, line: _Line | None = None) -> None:
        self.value, self.gradient = value, gradient
        self.line = _Line(object(), value, gradient) if line is None else line

    def _chain(self, name: str, value: Interval, slope: Interval) -> IntervalDual:
        return self._named(name, bounded(*value), scaled(self.gradient, bounded(*slope)))

    def _named(self, function: str, value: Interval, gradient: Gradient) -> IntervalDual:
        name = same_object(function, *self.line.key)
        return IntervalDual(value, gradient, _Line(name, value, gradient))

    def _read(self, other: Any) -> IntervalDual:
        if isinstance(other, IntervalDual):
            return other
        if is_finite_number(other):
            zero = np.zeros_like(self.gradient[0])
            exact = float(other)
            value = (exact, exact) if exact == other else outwards(exact, exact)
            number = Fraction(int(other) if isinstance(other, (int, np.integer)) else exact)
            line = _Line(None, value, (zero, zero), Fraction(0), number) if number == other else None
            return IntervalDual(value, (zero, zero), line)
        raise UnsupportedError(f"arithmetic with {type(other).__name__}")

    def __add__(self, other: Any) -> IntervalDual:
        if _is_array(other):
            return NotImplemented
        b = self._read(other)
        return IntervalDual(sum_of(self.value, b.value), added(self.gradient, b.gradient), self.line.plus(b.line))

    __radd__ = __add__

    def __neg__(self) -> IntervalDual:
        value, gradient = (-self.value[1], -self.value[0]), (-self.gradient[1], -self.gradient[0])
        return IntervalDual(value, gradient, self.line.moved(Fraction(-1), Fraction(0)))

    def __pos__(self) -> IntervalDual:
        return self

    def __sub__(self, other: Any) -> IntervalDual:
        if _is_array(other):
            return NotImplemented
        return self + (-self._read(other))

    def __rsub__(self, other: Any) -> IntervalDual:
        return self._read(other) + (-self)

    def __mul__(self, other: Any) -> IntervalDual:
        if _is_array(other):
            return NotImplemented
        if other is self:
            return self**2
        b = self._read(other)
        first, second = scaled(self.gradient, b.value), scaled(b.gradient, self.value)
        value, gradient = product(self.value, b.value), added(first, second)
        line = self.line.times(b.line)
        if line is None:
            line = _Line(same_object("*", *self.line.key, *b.line.key), value, gradient)
        return IntervalDual(value, gradient, line)

    __rmul__ = __mul__

    def reciprocal(self) -> IntervalDual:
        """1 / x."""
        return _quotient(self._read(1.0), self)

    def __truediv__(self, other: Any) -> IntervalDual:
        if _is_array(other):
            return NotImplemented
        return _quotient(self, self._read(other))

    def __rtruediv__(self, other: Any) -> IntervalDual:
        return _quotient(self._read(other), self)

    def __pow__(self, power: Any) -> IntervalDual:
        if not is_finite_number(power):
            raise UnsupportedError("a power that is not a number")
        if not float(power).is_integer():
            return self._real_power(float(power))
        power = int(power)
        if power < 0:
            return (self**-power).reciprocal()
        if power == 0:
            return self._read(1.0)
        slope = product(self._read(power).value, _power(self.value, power - 1))
        return self._named(f"power {power}", _power(self.value, power), scaled(self.gradient, slope))

    def _real_power(self, power: float) -> IntervalDual:
        self._require_positive(f"power {power:g}", or_zero=power > 1)
        value, slope = (
            _hull(*(real_power(x, power, less) if x else (0.0, 0.0) for x in self.value)) for less in (0, 1)
        )
        return self._chain(f"power {power!r}", value, product((power, power), bounded(*slope)))

    def _require_positive(self, what: str, or_zero: bool = False) -> None:
        low = self.value[0]
        if low < 0:
            raise UnboundedError(f"the {what} of a quantity that may be negative")
        if low == 0 and not or_zero:
            raise UnboundedError(f"the slope of the {what} is unbounded at zero, which the quantity may be")

    def __rpow__(self, base: Any) -> IntervalDual:
        return (self * self._read(base).log()).exp()

    # numpy calls these methods for its functions of the same names

    def square(self) -> IntervalDual:
        """x squared."""
        return self**2

    def sin(self) -> IntervalDual:
        """sin x."""
        return self._chain("sin", *sine_and_cosine(self.value))

    def cos(self) -> IntervalDual:
        """cos x."""
        (low, high), value = sine_and_cosine(self.value)
        return self._chain("cos", value, (-high, -low))

    def tan(self) -> IntervalDual:
        """tan x."""
        return self.sin() / self.cos()

    def exp(self) -> IntervalDual:
        """e to the x."""
        value = _rising(arb.exp, self.value)
        return self._chain("exp", value, value)

    def log(self) -> IntervalDual:
        """Natural logarithm."""
        self._require_positive("logarithm")
        return self._chain("log", _rising(arb.log, self.value), _inverse(self.value))

    def sqrt(self) -> IntervalDual:
        """Square root."""
        self._require_positive("square root")
        value = _rising(arb.sqrt, self.value)
        return self._chain("sqrt", value, product((0.5, 0.5), _inverse(value)))

    def tanh(self) -> IntervalDual:
        """tanh x."""
        low, high = _rising(arb.tanh, self.value)
        return self._chain("tanh", (max(low, -1.0), min(high, 1.0)), _even(lambda ball: ball.sech() ** 2, self.value))

    def arctan(self) -> IntervalDual:
        """arctan x."""
        return self._chain(
            "arctan", _rising(arb.atan, self.value), _even(lambda ball: 1 / (1 + ball * ball), self.value)
        )

    def sinh(self) -> IntervalDual:
        """sinh x."""
        return self._chain("sinh", _rising(arb.sinh, self.value), _even(arb.cosh, self.value))

    def cosh(self) -> IntervalDual:
        """cosh x."""
        return self._chain("cosh", _even(arb.cosh, self.value), _rising(arb.sinh, self.value))

    def __abs__(self) -> IntervalDual:
        return larger(self, -self)

    absolute = fabs = __abs__

    def clip(self, low: Any = None, high: Any = None, out: Any = None) -> IntervalDual:
        """The nearest number between two."""
        if out is not None:
            raise UnsupportedError("a place for the result of clip")
        raised = self if low is None else larger(self, low)
        return raised if high is None else smaller(raised, high)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **how: Any) -> Any:
        return _apply(ufunc, method, inputs, how)


class Quantities(np.ndarray):
    """An array of quantities, with the functions of numpy that its own arrays of objects lack."""

    def mean(self, axis: Any = None, dtype: Any = None, out: Any = None, **how: Any) -> Any:
        """The sum over the number of terms."""
        if dtype is not None or out is not None:
            raise UnsupportedError("a type or a place for the result of mean")
        return self.sum(axis=axis, **how) / (self.size if axis is None else self.shape[axis])

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **how: Any) -> Any:
        return _apply(ufunc, method, inputs, how)


def _apply(ufunc: Any, method: str, inputs: tuple[Any, ...], how: dict[str, Any]) -> Any:
    if "out" in how:
        how = {**how, "out": tuple(None if x is None else _plain(x) for x in how["out"])}
    named = _KINKED.get(ufunc.__name__)
    function: Any = ufunc if named is None else np.frompyfunc(named, ufunc.nin, 1)
    try:
        result = getattr(function, method)(*(_plain(x) for x in inputs), **how)
    except TypeError as error:
        if type(error) is UnsupportedError:
            raise
        raise UnsupportedError(f"numpy's {ufunc.__name__} does not take intervals: {error}") from error
    return result.view(Quantities) if type(result) is np.ndarray else result


def _plain(item: Any) -> Any:
    """Arrays of numpy alone."""
    if type(item) is IntervalDual:
        out = np.empty((), dtype=object)
        out[()] = item
        return out
    return item.view(np.ndarray) if type(item) is Quantities else item


def larger(a: Any, b: Any) -> Any:
    """The larger of two quantities, at least one of them an interval.

    Where they are equal all over the box, the derivative is one of the two or does not exist.
    """
    if type(a) is not IntervalDual:
        a, b = b, a
    if type(a) is not IntervalDual:
        return np.maximum(np.asarray(a), b)
    b = a._read(b)
    if a.value[0] >= b.value[1] and a.value[1] > b.value[0]:
        return a
    if b.value[0] >= a.value[1] and b.value[1] > a.value[0]:
        return b
    if any((x != y).any() for x in a.gradient for y in b.gradient):
        note_kink()
    gradient = np.minimum(a.gradient[0], b.gradient[0]), np.maximum(a.gradient[1], b.gradient[1])
    return IntervalDual((max(a.value[0], b.value[0]), max(a.value[1], b.value[1])), gradient)


def smaller(a: Any, b: Any) -> Any:
    """The smaller of two quantities."""
    return -larger(-a, -b)


def _between(x: Any, low: Any, high: Any) -> Any:
    return smaller(larger(x, low), high)


_KINKED: dict[str, Callable[..., Any]] = {"maximum": larger, "minimum": smaller, "clip": _between}


def is_finite_number(item: Any) -> bool:
    """Whether this is one real number that a double comes near to."""
    if type(item) not in (int, float, bool) and not isinstance(item, (np.integer, np.floating)):
        return False  # also subclasses of float, which may compute in their own way
    return bool(abs(item) <= np.finfo(float).max)


def _is_array(item: Any) -> bool:
    return type(item) is not IntervalDual and isinstance(item, np.ndarray)


def _quotient(a: IntervalDual, b: IntervalDual) -> IntervalDual:
    """a / b, with (a' - (a / b) b') / b for its slope, where b occurs less often than in that of a (1 / b)."""
    if b.line.name is None and b.line.shift:
        line = a.line.moved(1 / b.line.shift, Fraction(0))
    elif a.line.name is None or a.line.name is b.line.name:
        return _fractional_linear(a.line, b.line)
    else:
        line = None
    inverse = _inverse(b.value)
    value = product(a.value, inverse)
    by_b = scaled(b.gradient, value)
    return IntervalDual(value, scaled(added(a.gradient, (-by_b[1], -by_b[0])), inverse), line)


def _fractional_linear(a: _Line, b: _Line) -> IntervalDual:
    """The quotient of two lines in one quantity: monotone in it, with a slope of one sign."""
    ends = [Fraction(float(x)) for x in b.value]
    below = [b.scale * x + b.shift for x in ends]
    if min(below) <= 0 <= max(below):
        raise UnboundedError("division by a quantity that may be zero")
    turn = a.scale * b.shift - a.shift * b.scale
    value = _hull(*(_around((a.scale * x + a.shift) / y) for x, y in zip(ends, below, strict=True)))
    gradient = scaled(b.gradient, _hull(*(_around(turn / y**2) for y in below)))
    return IntervalDual(value, gradient, _Line(same_object("/", *a.key, *b.key), value, gradient))


def _around(number: Fraction) -> Interval:
    try:
        near = float(number)
    except OverflowError:
        raise UnboundedError(UNBOUNDED) from None
    return (near, near) if near == number else outwards(near, near)


def _inverse(value: Interval) -> Interval:
    """Range of 1 / x."""
    low, high = value
    if low <= 0 <= high:
        raise UnboundedError("division by a quantity that may be zero")
    return outwards(1 / high, 1 / low)


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
    return bounded(*_hull(*ends))
