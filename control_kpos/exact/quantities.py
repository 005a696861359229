"""Quantities with derivatives: bounds of a value and of its partial derivatives on a box, or on many boxes at once.

A value is an interval, or an array of them with one for each box; a derivative has one axis more, the last one, for
the variables.  Besides, a quantity knows by which steps it came about, and whether it is a weighted sum of others: what
occurs twice in sums and quotients is counted once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import bends, functions
from . import growth as rates
from . import interval_arithmetic as ia
from .bends import Bend
from .growth import Growth
from .interval_arithmetic import ONE, ZERO, Interval
from .sums import Sum, quotient, spread
from .unreadable import UnboundedError, UnsupportedError, note_kink, same_object

Array = NDArray[np.float64]
Gradient = tuple[Any, Any]

# Larger whole powers are not enclosed.
_HIGHEST = 1000
DEPENDS = "which depends on"


class Variable:
    """Names one of the quantities that a function is called with; each call has its own."""

    __slots__ = ("index",)

    def __init__(self, index: int) -> None:
        self.index = index


class Known(NamedTuple):
    """What is known of a quantity on a box.

    Attributes
    ----------
    value : pair of arrays, shape ()  or (N,)
        Lower and upper bound, for each box.
    gradient : pair of arrays, shape (..., k)
        Bounds of the partial derivatives.
    name : object
        The same for quantities that came about by the same steps.
    terms : Sum, optional
        This as a sum of others.
    bend : pair of arrays, shape (..., k, k), optional
        Bounds of the second derivatives, which may be infinite; None for zero, and where nobody asked.
    growth : Growth, optional
        Relative growth; the same.
    """

    value: Interval
    gradient: Gradient
    name: object
    terms: Sum | None = None
    bend: Bend = None
    growth: Growth | None = None

    @property
    def sum(self) -> Sum:
        """The quantity as a sum, of itself alone if of nothing else."""
        return Sum(((self, ONE),)) if self.terms is None else self.terms

    @property
    def is_constant(self) -> bool:
        """Whether it is a number that the box does not change."""
        return self.terms is not None and not self.terms.terms


def constant(number: Any, variables: int) -> Known:
    """A number, or one for each box."""
    exact = np.asarray(number, dtype=float)
    value = (exact, exact) if _is_double(exact, number) else ia.outwards(exact, exact)
    zero = np.zeros(variables)
    name = same_object("constant", exact.shape, value[0].tobytes(), value[1].tobytes())
    return Known(value, (zero, zero), name, Sum((), value))


def _is_double(exact: Any, number: Any) -> bool:
    """Whether nothing was rounded; large integers are compared as such."""
    if np.ndim(number) == 0:
        return bool(exact == (int(number) if isinstance(number, (int, np.integer)) else number))
    return bool((exact == number).all() and (np.abs(exact) < 2.0**53).all()) or np.asarray(number).dtype == float


def plus(a: Known, b: Known) -> Known:
    """a + b."""
    value, gradient = ia.sum_of(a.value, b.value), ia.sum_of(a.gradient, b.gradient)
    name, bend = same_object("+", *_in_order(a, b)), bends.total(a.bend, b.bend)
    growth = rates.mean(a.growth, a.value, b.growth, b.value)
    return _refined(Known(value, gradient, name, a.sum.plus(b.sum), bend, growth))


def _refined(known: Known) -> Known:
    """A quantity that may be a sum of others: then it is enclosed as such, too; and by its relative growth."""
    if known.terms is not None:
        value, gradient = known.terms.value(), known.terms.gradient()
        if ia.is_bounded(value) and ia.is_bounded(gradient):
            known = known._replace(value=ia.common(known.value, value), gradient=ia.common(known.gradient, gradient))
    if known.growth is None:
        return known
    growth, gradient = rates.met(known.growth, known.value, known.gradient)
    return known._replace(growth=growth, gradient=gradient)


def _in_order(a: Known, b: Known) -> list[object]:
    """Names of what may be exchanged."""
    return sorted((a.name, b.name), key=id)


def minus(a: Known, b: Known) -> Known:
    """a - b."""
    return plus(a, negative(b))


def negative(a: Known) -> Known:
    """-a."""
    terms = a.sum.moved((-1.0, -1.0), ZERO)
    name, bend = same_object("-", a.name), bends.negative(a.bend)
    return Known(ia.negative(a.value), ia.negative(a.gradient), name, terms, bend, a.growth)


def times(a: Known, b: Known) -> Known:
    """a * b."""
    if a.name is b.name and not a.is_constant:
        return integer_power(a, 2)
    first, second = ia.product(a.gradient, spread(b.value)), ia.product(b.gradient, spread(a.value))
    value, gradient = ia.product(a.value, b.value), ia.sum_of(first, second)
    bend = bends.total(bends.scaled(b.value, a.bend), bends.scaled(a.value, b.bend), _crossed(a, b))
    name, growth = same_object("*", *_in_order(a, b)), rates.added(a.growth, b.growth)
    return _refined(Known(value, gradient, name, a.sum.times(b.sum), bend, growth))


def _crossed(a: Known, b: Known) -> Bend:
    """a' b' + b' a', if second derivatives were asked for."""
    return None if a.bend is None or b.bend is None else bends.both(a.gradient, b.gradient)


def over(a: Known, b: Known) -> Known:
    """a / b, with (a' - (a / b) b') / b for its slope, where b occurs less often than in that of a (1 / b)."""
    return _refined(_over(a, b)._replace(growth=rates.added(a.growth, rates.negative(b.growth))))


def _over(a: Known, b: Known) -> Known:
    with _of(b):
        inverse = ia.inverse(b.value)
    value = ia.product(a.value, inverse)
    better = quotient(a.sum, b.sum, inverse)
    if better is not None:
        value = ia.common(value, better[0])
    by_b = ia.product(b.gradient, spread(value))
    slope = ia.product(ia.difference(a.gradient, by_b), spread(inverse))
    if better is not None:
        slope = ia.common(slope, better[1])
    terms = a.sum.moved(inverse, ZERO) if b.is_constant else None
    return _bent(Known(value, slope, same_object("/", a.name, b.name), terms), a, b)


def _bent(ratio: Known, a: Known, b: Known) -> Known:
    """A quotient q = a / b with its second derivatives, (a'' - q b'' - q' b' - b' q') / b."""
    if a.bend is None and b.bend is None:
        return ratio
    crossed = None if b.bend is None else bends.both(ratio.gradient, b.gradient)
    parts = bends.total(a.bend, bends.negative(bends.total(bends.scaled(ratio.value, b.bend), crossed)))
    return ratio._replace(bend=bends.scaled(ia.inverse(b.value), parts))


def chained(
    name: str, a: Known, ranges: functions.Ranges, curvature: Callable[..., Interval], exponent: Interval | None = None
) -> Known:
    """A function of a, a power perhaps, with ranges of values and of slopes, and of second derivatives by these."""
    value, slope = ia.bounded(ranges[0]), ia.bounded(ranges[1])
    bend = None
    if a.bend is not None:
        bend = bends.chained(slope, curvature(a.value, value, slope), a.gradient, a.bend)
    known = Known(value, ia.product(a.gradient, spread(slope)), same_object(name, a.name), None, bend)
    growth = (
        rates.of_function(name, a.growth, a.value, a.gradient) if exponent is None else rates.scaled(exponent, a.growth)
    )
    return _refined(known._replace(growth=growth))


def integer_power(a: Known, power: int) -> Known:
    """a^k, k >= 1."""
    if power == 1:
        return a
    slope = ia.product((float(power), float(power)), ia.integer_power(a.value, power - 1))
    ranges = ia.integer_power(a.value, power), slope
    exponent = float(power), float(power)
    return chained(f"power {power}", a, ranges, lambda x, *_: bends.integer_power(x, power), exponent)


def power(a: Known, b: Known) -> Known:
    """a^b, for a constant b or a positive a."""
    if not b.is_constant or (b.value[0] != b.value[1]).any():
        return applied("exp", times(b, applied("log", a)))
    first = float(np.ravel(b.value[0])[0])
    if (b.value[0] != first).any():
        return _real_power(f"power {id(b.name)}", a, b.value[0])
    exponent = first
    if not exponent.is_integer():
        return _real_power(f"power {exponent!r}", a, exponent)
    if exponent == 0:
        return constant(np.ones(np.shape(a.value[0])), a.gradient[0].shape[-1])
    if abs(exponent) > _HIGHEST:
        raise UnsupportedError(f"power {exponent:g}")
    raised = integer_power(a, int(abs(exponent)))
    return raised if exponent > 0 else reciprocal(raised)


def _real_power(name: str, a: Known, power: Any) -> Known:
    with _of(a):
        ranges = functions.real_power(a.value, power)
    return chained(name, a, ranges, lambda x, *_: bends.real_power(x, power), (power, power))


def applied(name: str, a: Known) -> Known:
    """A function of `functions` by its name."""
    with _of(a):
        return chained(name, a, functions.NAMED[name](a.value), bends.OF[name])


class _of:  # noqa: N801 -- reads as a word
    """Say which variables something unbounded depends on."""

    def __init__(self, a: Known) -> None:
        self._a = a

    def __enter__(self) -> None:
        return None

    def __exit__(self, _: Any, error: BaseException | None, __: Any) -> None:
        if not isinstance(error, UnboundedError) or DEPENDS in str(error):
            return
        low, high = np.broadcast_arrays(*(np.atleast_1d(side) for side in self._a.gradient))
        moving = (low != 0) | (high != 0)
        on = np.flatnonzero(moving.any(axis=tuple(range(moving.ndim - 1))))
        if on.size:
            names = ", ".join(f"x[{i}]" for i in on[:3]) + (", ..." if on.size > 3 else "")
            error.args = (f"{error} ({DEPENDS} {names})",)


def larger(a: Known, b: Known) -> Known:
    """The larger of two quantities.

    Where they are equal all over a box, the derivative is one of the two or does not exist.
    """
    value = np.maximum(a.value[0], b.value[0]), np.maximum(a.value[1], b.value[1])
    first = np.asarray((a.value[0] >= b.value[1]) & (a.value[1] > b.value[0]))[..., None]
    second = np.asarray((b.value[0] >= a.value[1]) & (b.value[1] > a.value[0]))[..., None]
    either = ia.hull(a.gradient, b.gradient)
    if (~first & ~second & differ(a.gradient, b.gradient)).any():
        note_kink()
    low, high = (
        np.where(first, x, np.where(second, y, z)) for x, y, z in zip(a.gradient, b.gradient, either, strict=True)
    )
    for chosen, taken in ((first, a), (second, b)):
        if chosen.all():
            return taken._replace(value=value)
    bend = None if a.bend is None and b.bend is None else bends.unknown_where(True, None, (low, high))
    growth = rates.either(a.growth, b.growth)
    return Known(value, (low, high), same_object("larger", *_in_order(a, b)), None, bend, growth)


def differ(a: Gradient, b: Gradient) -> Any:
    """Where two slopes need not be the same number."""
    return (a[0] != b[0]) | (a[1] != b[1]) | (a[0] != a[1])


def smaller(a: Known, b: Known) -> Known:
    """The smaller of two quantities."""
    return negative(larger(negative(a), negative(b)))


def size(a: Known) -> Known:
    """|a|."""
    return larger(a, negative(a))


def sign(a: Known) -> Known:
    """1 or -1, for a quantity that is nowhere zero; it jumps elsewhere."""
    up, down = np.asarray(a.value[0] > 0), np.asarray(a.value[1] < 0)
    if not (up | down).all():
        raise UnsupportedError("the sign of a quantity that may be zero, where it jumps")
    return constant(np.where(up, 1.0, -1.0), a.gradient[0].shape[-1])


def heaviside(a: Known, _: Known) -> Known:
    """0 or 1, for a quantity that is nowhere zero."""
    one = constant(1.0, a.gradient[0].shape[-1])
    return times(constant(0.5, a.gradient[0].shape[-1]), plus(one, sign(a)))


def hypot(a: Known, b: Known) -> Known:
    """sqrt(a^2 + b^2), with slopes a / hypot and b / hypot; at zero it has a kink."""
    squares = ia.sum_of(ia.integer_power(a.value, 2), ia.integer_power(b.value, 2))
    value = ia.root(squares)
    if (value[0] == 0).any():
        note_kink()
    parts = [ia.product(x.gradient, spread(_share(x.value, y.value))) for x, y in ((a, b), (b, a))]
    gradient = ia.sum_of(*parts)
    bend = None if a.bend is None and b.bend is None else _bend_of_hypot(a, b, Known(value, gradient, None))
    growth = rates.either(a.growth, b.growth)
    return _refined(Known(value, gradient, same_object("hypot", *_in_order(a, b)), None, bend, growth))


def _bend_of_hypot(a: Known, b: Known, length: Known) -> Bend:
    """(a' a' + b' b' + a a'' + b b'' - h' h') / h."""
    zero = np.asarray(length.value[0] == 0)
    per = ia.inverse((length.value[0] + zero, length.value[1] + zero))
    squares = bends.total(*(bends.squared(ia.bounded(x.gradient)) for x in (a, b)))
    lever = (bends.scaled(x.value, x.bend) for x in (a, b))
    parts = bends.total(squares, *lever, bends.negative(bends.squared(length.gradient)))
    return bends.unknown_where(zero, bends.scaled(per, parts), length.gradient)


def _share(a: Interval, b: Interval) -> Interval:
    """Range of a / sqrt(a^2 + b^2), which rises with a and falls with |b| where a > 0."""
    least, most = ia.sizes(b)
    low = np.where(a[0] < 0, _leg(a[0], least)[0], _leg(a[0], most)[0])
    return low, np.where(a[1] > 0, _leg(a[1], least)[1], _leg(a[1], most)[1])


@np.errstate(all="ignore")
def _leg(a: Any, b: Any) -> Interval:
    """a / sqrt(a^2 + b^2) at numbers, between -1 and 1."""
    squares = ia.loose_sum(ia.loose_product((a, a), (a, a)), ia.loose_product((b, b), (b, b)))
    low, high = ia.root(ia.bounded(squares))
    ok = low > 0
    down, up = np.where(ok, low, 1.0), np.where(ok, high, 1.0)
    ratio = ia.quotient((a, a), (down, up))
    return np.where(ok, np.maximum(ratio[0], -1.0), -1.0), np.where(ok, np.minimum(ratio[1], 1.0), 1.0)


def logaddexp(a: Known, b: Known) -> Known:
    """ln(e^a + e^b)."""
    value, slope = functions.logaddexp(a.value, b.value)
    first = ia.product(a.gradient, spread(slope))
    rest = functions.logistic(ia.difference(b.value, a.value))[0]
    second = ia.product(b.gradient, spread(rest))
    bend = None
    if a.bend is not None or b.bend is not None:
        apart = bends.squared(ia.difference(a.gradient, b.gradient))
        curved = bends.scaled(bends.product(slope, rest), apart)
        bend = bends.total(bends.scaled(slope, a.bend), bends.scaled(rest, b.bend), curved)
    name, growth = same_object("logaddexp", *_in_order(a, b)), rates.unknown(a.growth, b.growth)
    return _refined(Known(ia.bounded(value), ia.sum_of(first, second), name, None, bend, growth))


def logaddexp2(a: Known, b: Known) -> Known:
    """log2(2^a + 2^b)."""
    zero = np.zeros(a.gradient[0].shape[-1])
    low, high = functions.constant("ln 2")
    size = np.asarray(low), np.asarray(high)
    number = Known(size, (zero, zero), same_object("ln 2"), Sum((), size))
    return over(logaddexp(times(a, number), times(b, number)), number)


def arctan2(a: Known, b: Known) -> Known:
    """The angle of (b, a), for b > 0."""
    if not np.all(b.value[0] > 0):
        raise UnboundedError("arctan2 with a second argument that may not be positive")
    return applied("arctan", over(a, b))


def square(a: Known) -> Known:
    """a^2."""
    return integer_power(a, 2)


def reciprocal(a: Known) -> Known:
    """1 / a."""
    return over(constant(1.0, a.gradient[0].shape[-1]), a)


UNARY: dict[str, Callable[[Known], Known]] = {
    **{name: (lambda a, name=name: applied(name, a)) for name in functions.NAMED},
    "negative": negative,
    "positive": lambda a: a,
    "conjugate": lambda a: a,
    "absolute": size,
    "fabs": size,
    "square": square,
    "reciprocal": reciprocal,
    "sign": sign,
    "logit": lambda a: minus(applied("log", a), applied("log1p", negative(a))),
    "log_expit": lambda a: negative(logaddexp(constant(0.0, a.gradient[0].shape[-1]), negative(a))),
}
BINARY: dict[str, Callable[[Known, Known], Known]] = {
    "add": plus,
    "subtract": minus,
    "multiply": times,
    "divide": over,
    "power": power,
    "float_power": power,
    "maximum": larger,
    "minimum": smaller,
    "fmax": larger,
    "fmin": smaller,
    "hypot": hypot,
    "logaddexp": logaddexp,
    "logaddexp2": logaddexp2,
    "heaviside": heaviside,
    "arctan2": arctan2,
}
