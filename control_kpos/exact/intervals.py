"""Arguments for a user's function that stand for all points of a box, and record what is done with them.

A user's function is called with objects of `IntervalDual` in place of numbers, or of arrays with one number for each of
many boxes.  Every operation rounds outwards, so that what comes out encloses all values and all partial derivatives on
the box.  The box has an interior, or is a point at which the derivative exists: at an end of it, the slope from inside
counts.  What an object knows is kept under no attribute: only this module reads it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .quantities import BINARY, UNARY, Known, constant
from .unreadable import Unreadable, UnsupportedError


class IntervalDual(Unreadable):
    """All values of a quantity on a box, and of its partial derivatives.

    Parameters
    ----------
    known : Known
        Bounds of both.
    steps : int
        The same for what came about by the same operations, in any call.
    """

    __array_priority__ = 1000
    __slots__ = ("_held", "_packed", "_steps")

    def __init__(self, known: Known, steps: int) -> None:
        _hold(self, known)
        _set_packed(self, False)
        _STEPS.__set__(self, steps)

    def __pos__(self) -> IntervalDual:
        return self

    def clip(self, low: Any = None, high: Any = None, out: Any = None) -> Any:
        """The nearest number between two."""
        if out is not None:
            raise UnsupportedError("a place for the result of clip")
        return _clipped(self, low, high)

    def __pow__(self, exponent: Any) -> Any:
        return NotImplemented if _is_for_numpy(self, exponent) else _binary("power", self, exponent)

    def __rpow__(self, base: Any) -> Any:
        return NotImplemented if _is_for_numpy(self, base) else _binary("power", base, self)

    def __array__(self, *_: Any, **__: Any) -> Any:
        """In an array of others; rows of many boxes can then be returned only."""
        if np.ndim(known_of(self).value[0]):
            _set_packed(self, True)
        return _alone(self)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **how: Any) -> Any:
        return _apply(ufunc, method, inputs, how)


# The only ways to what an object knows: no attribute leads there.
_HELD, _PACKED, _STEPS = (IntervalDual.__dict__[name] for name in ("_held", "_packed", "_steps"))
known_of: Callable[[Any], Known] = _HELD.__get__
_hold, _set_packed = _HELD.__set__, _PACKED.__set__
del IntervalDual._held, IntervalDual._packed, IntervalDual._steps  # type: ignore[attr-defined]


def _operator(name: str, swapped: bool = False) -> Callable[[Any, Any], Any]:
    def operation(self: IntervalDual, other: Any) -> Any:
        if _is_for_numpy(self, other):
            return NotImplemented
        return _binary(name, other, self) if swapped else _binary(name, self, other)

    return operation


def _method(name: str) -> Callable[..., Any]:
    """What numpy calls for its functions of the same names, on arrays of objects."""

    def operation(self: IntervalDual, *others: Any) -> Any:
        return _binary(name, self, *others) if others else _unary(name, self)

    return operation


for _name, _symbol in (("add", "add"), ("subtract", "sub"), ("multiply", "mul"), ("divide", "truediv")):
    setattr(IntervalDual, f"__{_symbol}__", _operator(_name))
    setattr(IntervalDual, f"__r{_symbol}__", _operator(_name, swapped=True))
for _name in (*UNARY, "hypot", "arctan2"):
    setattr(IntervalDual, _name, _method(_name))
IntervalDual.__neg__, IntervalDual.__abs__ = _method("negative"), _method("absolute")


def _is_for_numpy(item: IntervalDual, other: Any) -> bool:
    """Whether numpy applies the operation to each entry of an array."""
    if type(other) is IntervalDual or not isinstance(other, np.ndarray):
        return False
    return not np.ndim(known_of(item).value[0]) or other.dtype == object


def _read(item: Any, like: Known) -> Known:
    if type(item) is IntervalDual:
        if _PACKED.__get__(item):
            raise UnsupportedError("a row of many boxes that stands in an array is computed with")
        return known_of(item)
    variables = like.gradient[0].shape[-1]
    if is_finite_number(item):
        return constant(item, variables)
    if type(item) is np.ndarray and item.dtype.kind in "biuf" and item.shape in ((), np.shape(like.value[0])):
        if np.isfinite(item).all():
            return constant(item, variables)
        raise UnsupportedError("arithmetic with numbers that are not finite")
    raise UnsupportedError(f"arithmetic with {type(item).__name__}")


def _unary(name: str, item: IntervalDual) -> IntervalDual:
    return IntervalDual(UNARY[name](_read(item, known_of(item))), hash((name, steps_to(item))))


def _binary(name: str, first: Any, second: Any) -> IntervalDual:
    like = known_of(first if type(first) is IntervalDual else second)
    a, b = _read(first, like), _read(second, like)
    return IntervalDual(BINARY[name](a, b), hash((name, steps_to(first), steps_to(second))))


def steps_to(item: Any) -> int:
    """What a result of a call came about by, up to the hash of it."""
    if type(item) is IntervalDual:
        return _STEPS.__get__(item)
    return hash(item.tobytes() if isinstance(item, np.ndarray) else item)


def _clipped(item: Any, low: Any, high: Any) -> Any:
    raised = item if low is None else _either("maximum", item, low)
    return raised if high is None else _either("minimum", raised, high)


def _either(name: str, *items: Any) -> Any:
    """A function of one or two, at least one of them an interval; numpy's own, if none is."""
    if not any(type(item) is IntervalDual for item in items):
        return getattr(np, name)(*items)
    return _unary(name, *items) if len(items) == 1 else _binary(name, *items)


class Quantities(np.ndarray):
    """An array of quantities, with the functions of numpy that its own arrays of objects lack."""

    def mean(self, axis: Any = None, dtype: Any = None, out: Any = None, **how: Any) -> Any:
        """The sum over the number of terms."""
        if dtype is not None or out is not None:
            raise UnsupportedError("a type or a place for the result of mean")
        return self.sum(axis=axis, **how) / (self.size if axis is None else self.shape[axis])

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **how: Any) -> Any:
        return _apply(ufunc, method, inputs, how)


class Rows(Unreadable):
    """The quantities of many boxes, one row for each: rows can be taken, and nothing else.

    Parameters
    ----------
    rows : list of IntervalDual
    """

    __slots__ = ("_rows",)

    def __init__(self, rows: list[IntervalDual]) -> None:
        _ROWS.__set__(self, rows)

    def __len__(self) -> int:
        return len(_ROWS.__get__(self))

    def __getitem__(self, index: Any) -> Any:
        rows = _ROWS.__get__(self)
        if type(index) is slice:
            return Rows(rows[index])
        if isinstance(index, (int, np.integer)) and -len(rows) <= index < len(rows):
            return rows[int(index)]
        raise UnsupportedError("something else than one row of x, such as x[0], or of u is taken")

    def __iter__(self) -> Iterator[IntervalDual]:
        return iter(list(_ROWS.__get__(self)))

    __array__ = __array_ufunc__ = Unreadable._refuse


_ROWS = Rows.__dict__["_rows"]
del Rows._rows  # type: ignore[attr-defined]


def _apply(ufunc: Any, method: str, inputs: tuple[Any, ...], how: dict[str, Any]) -> Any:
    name = ufunc.__name__
    if any(type(x) is IntervalDual and np.ndim(known_of(x).value[0]) for x in inputs):
        if method != "__call__" or how or name not in {*UNARY, *BINARY, "clip"}:
            raise UnsupportedError(f"numpy's {name} of many boxes at once")
        return _clipped(*inputs) if name == "clip" else _either(name, *inputs)
    if "out" in how:
        how = {**how, "out": tuple(None if x is None else _plain(x) for x in how["out"])}
    function: Any = ufunc
    if name in _ENTRYWISE:
        function = np.frompyfunc(_ENTRYWISE[name], ufunc.nin, 1)
    try:
        result = getattr(function, method)(*(_plain(x) for x in inputs), **how)
    except TypeError as error:
        if type(error) is UnsupportedError:
            raise
        raise UnsupportedError(f"numpy's {name} does not take intervals: {error}") from error
    return result.view(Quantities) if type(result) is np.ndarray else result


# Arithmetic is left to numpy, which knows the first terms of sums and products.
_ENTRYWISE: dict[str, Callable[..., Any]] = {
    name: (lambda *items, name=name: _either(name, *items))
    for name in (*UNARY, *BINARY)
    if name not in ("add", "subtract", "multiply", "divide", "negative", "positive", "power")
}
_ENTRYWISE["clip"] = _clipped


def _alone(item: IntervalDual) -> Any:
    out = np.empty(1, dtype=object)
    out[0] = item  # an index of all entries would ask for an array
    return out.reshape(())


def _plain(item: Any) -> Any:
    """Arrays of numpy alone."""
    if type(item) is IntervalDual:
        return _alone(item)
    return item.view(np.ndarray) if type(item) is Quantities else item


def is_finite_number(item: Any) -> bool:
    """Whether this is one real number that a double comes near to."""
    if type(item) not in (int, float, bool) and not isinstance(item, (np.integer, np.floating)):
        return False  # also subclasses of float, which may compute in their own way
    return bool(abs(item) <= np.finfo(float).max)
