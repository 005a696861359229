"""Arguments for a user's function that stand for all points of a box, and record what is done with them.

A user's function is called with objects of `IntervalDual` in place of numbers, or of arrays with one number for each of
many boxes.  Every operation rounds outwards, so that what comes out encloses all values and all partial derivatives on
the box.  The box has an interior, or is a point at which the derivative exists: at an end of it, the slope from inside
counts.  What an object knows is kept under no attribute: only this module reads it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .branches import Comparison, Joined, chosen
from .quantities import BINARY, UNARY, Known, constant, minus
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
_COMPARED = {"less": "lt", "less_equal": "le", "greater": "gt", "greater_equal": "ge", "equal": "eq", "not_equal": "ne"}
for _name, _symbol in _COMPARED.items():
    setattr(IntervalDual, f"__{_symbol}__", _operator(_name))
for _name in (*UNARY, "hypot", "arctan2"):
    setattr(IntervalDual, _name, _method(_name))
IntervalDual.__neg__, IntervalDual.__abs__ = _method("negative"), _method("absolute")


def _is_for_numpy(item: IntervalDual, other: Any) -> bool:
    """Whether numpy applies the operation to each entry of an array."""
    if not _is_array(other):
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


def _binary(name: str, first: Any, second: Any) -> Any:
    if name == "multiply" and Choice in (type(first), type(second)):
        chooser, factor = (first, second) if type(first) is Choice else (second, first)
        return _where(chooser, factor, 0.0)  # true is 1, false is 0
    like = known_of(first if type(first) is IntervalDual else second)
    a, b = _read(first, like), _read(second, like)
    steps = hash((name, steps_to(first), steps_to(second)))
    return Choice(_comparison(name, a, b), steps) if name in _COMPARED else IntervalDual(BINARY[name](a, b), steps)


def _comparison(name: str, a: Known, b: Known) -> Any:
    """Conditions do not ask which branch is taken where both sides are equal: the branches have to meet there."""
    if name in ("equal", "not_equal"):
        equality = Comparison(minus(a, b), is_equality=True)
        return equality if name == "equal" else Joined("not", (equality,))
    return Comparison(minus(b, a) if name.startswith("less") else minus(a, b))


def steps_to(item: Any) -> int:
    """What a result of a call came about by, up to the hash of it."""
    if type(item) is IntervalDual:
        return _STEPS.__get__(item)
    if type(item) is Choice:
        return _CHOICE_STEPS.__get__(item)
    if isinstance(item, np.ndarray):
        return hash(item.tobytes())
    return hash((item, item == -1))  # -1 and -2 have one hash


def _clipped(item: Any, low: Any, high: Any) -> Any:
    raised = item if low is None else _OWN["maximum"](item, low)
    return raised if high is None else _OWN["minimum"](raised, high)


class Choice(Unreadable):
    """A condition on quantities, which says nothing but which of two others is taken.

    Parameters
    ----------
    condition : Comparison or Joined
    steps : int
        The same for what came about by the same operations, in any call.
    """

    __array_priority__ = 1000
    __slots__ = ("_condition", "_steps")

    def __init__(self, condition: Any, steps: int) -> None:
        _CONDITION.__set__(self, condition)
        _CHOICE_STEPS.__set__(self, steps)

    def __and__(self, other: Any) -> Any:
        return _joined("logical_and", self, other)

    def __or__(self, other: Any) -> Any:
        return _joined("logical_or", self, other)

    def __invert__(self) -> Any:
        return _joined("logical_not", self)

    def __mul__(self, other: Any) -> Any:
        return NotImplemented if _is_array(other) else _binary("multiply", self, other)

    __rmul__ = __mul__

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **how: Any) -> Any:
        return _apply(ufunc, method, inputs, how)

    def __array_function__(self, function: Any, _: Any, inputs: Any, how: Any) -> Any:
        return _selected(function, inputs, how)

    __array__ = Unreadable._refuse


_CONDITION, _CHOICE_STEPS = (Choice.__dict__[name] for name in ("_condition", "_steps"))
del Choice._condition, Choice._steps  # type: ignore[attr-defined]
_JOINED = {"logical_and": "and", "logical_or": "or", "logical_not": "not"}
_JOINED |= {"bitwise_and": "and", "bitwise_or": "or", "invert": "not"}


def _joined(name: str, *items: Any) -> Any:
    """Conditions joined by and, or, not."""
    if any(type(item) is not Choice for item in items):
        raise UnsupportedError("a condition on quantities is joined with something else")
    steps = hash((name, *(steps_to(item) for item in items)))
    return Choice(Joined(_JOINED[name], tuple(_CONDITION.__get__(item) for item in items)), steps)


def _where(choice: Any, first: Any, second: Any) -> Any:
    """np.where for one quantity, or one of many boxes; entry by entry for arrays."""
    if type(choice) is Choice:
        condition = _CONDITION.__get__(choice)
        like = condition.comparisons[0].d
        if np.ndim(like.value[0]) or not any(_is_array(item) and item.ndim for item in (first, second)):
            a, b = _read(first, like), _read(second, like)
            steps = hash(("where", *(steps_to(item) for item in (choice, first, second))))
            return IntervalDual(chosen(condition, a, b, steps), steps)
        choice = _alone(choice)
    if _is_array(choice):
        return np.frompyfunc(_where, 3, 1)(*(_plain(x) for x in (choice, first, second))).view(Quantities)
    return first if choice else second


def _select(conditions: Any, choices: Any, default: Any = 0) -> Any:
    out = default
    for condition, choice in reversed(list(zip(conditions, choices, strict=True))):
        out = _where(condition, choice, out)
    return out


def _piecewise(x: Any, conditions: Any, functions: Any, *others: Any, **named: Any) -> Any:
    if type(x) is not IntervalDual or np.ndim(known_of(x).value[0]):
        raise UnsupportedError("np.piecewise of an array")
    conditions = conditions if type(conditions) in (list, tuple) else [conditions]
    values = [f(x, *others, **named) if callable(f) else f for f in functions]
    out = values[len(conditions)] if len(values) == len(conditions) + 1 else 0.0
    for condition, value in zip(conditions, values, strict=False):
        out = _where(condition, value, out)
    return out


_SELECTIONS: dict[Any, Callable[..., Any]] = {np.where: _where, np.select: _select, np.piecewise: _piecewise}


def _selected(function: Any, inputs: Any, how: Any) -> Any:
    if function not in _SELECTIONS:
        raise UnsupportedError(f"numpy's {function.__name__} of conditions")
    try:
        return _SELECTIONS[function](*inputs, **how)
    except (TypeError, ValueError) as error:
        if isinstance(error, UnsupportedError):
            raise
        raise UnsupportedError(f"numpy's {function.__name__}: {error}") from error


class Quantities(np.ndarray):
    """An array of quantities, with the functions of numpy that its own arrays of objects lack."""

    @classmethod
    def of(cls, items: list[IntervalDual]) -> Quantities:
        """One entry for each."""
        out = np.empty(len(items), dtype=object).view(cls)
        for i, item in enumerate(items):
            out[i] = item
        return out

    def __array_function__(self, function: Any, types: Any, inputs: Any, how: Any) -> Any:
        if function in _SELECTIONS:
            return _selected(function, inputs, how)
        return super().__array_function__(function, types, inputs, how)

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

    @classmethod
    def of(cls, items: list[IntervalDual]) -> Rows:
        """One row for each."""
        return cls(items)

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
    if name in _OWN and not _is_own(ufunc):
        raise UnsupportedError(f"a function of the name {name} that is none of numpy's")
    if any(type(x) in (IntervalDual, Choice) for x in inputs) and not any(
        _is_array(x) and x.dtype == object for x in inputs
    ):
        many = any(type(x) is IntervalDual and np.ndim(known_of(x).value[0]) for x in inputs)
        if many and (method != "__call__" or how or name not in _OWN):
            raise UnsupportedError(f"numpy's {name} of many boxes at once")
        if method == "__call__" and not how and name in _OWN:
            return _OWN[name](*inputs)
    if "out" in how:
        how = {**how, "out": tuple(None if x is None else _plain(x) for x in how["out"])}
    function: Any = ufunc
    if name in _OWN and name not in _NUMPYS:
        function = np.frompyfunc(_OWN[name], ufunc.nin, 1)
    try:
        result = getattr(function, method)(*(_plain(x) for x in inputs), **how)
    except TypeError as error:
        if type(error) is UnsupportedError:
            raise
        raise UnsupportedError(f"numpy's {name} does not take intervals: {error}") from error
    return result.view(Quantities) if type(result) is np.ndarray else result


def _is_array(x: Any) -> bool:
    return issubclass(type(x), np.ndarray)  # what is unreadable refuses isinstance


def _is_own(ufunc: Any) -> bool:
    """Whether this is the function that numpy or scipy.special has under its name, not another one called so."""
    return any(getattr(library, ufunc.__name__, None) is ufunc for library in _libraries())


def _libraries() -> list[Any]:
    names = ("numpy._core.umath", "numpy.core.umath", "scipy.special")
    return [np, *(sys.modules[name] for name in names if name in sys.modules)]


def _named(name: str) -> Callable[..., Any]:
    """A function of quantities, conditions and numbers; numpy's own where all are numbers."""

    def function(*items: Any) -> Any:
        if name in _JOINED:
            return _joined(name, *items)
        if not any(type(item) in (IntervalDual, Choice) for item in items):
            return next(getattr(library, name) for library in _libraries() if hasattr(library, name))(*items)
        return _unary(name, *items) if len(items) == 1 else _binary(name, *items)

    return function


_OWN: dict[str, Callable[..., Any]] = {name: _named(name) for name in (*UNARY, *BINARY, *_COMPARED, *_JOINED)}
_OWN["clip"] = _clipped
# In arrays arithmetic is left to numpy, which knows the first terms of sums and products.
_NUMPYS = ("add", "subtract", "multiply", "divide", "negative", "positive", "power")


def _alone(item: Any) -> Any:
    out = np.empty(1, dtype=object)
    out[0] = item  # an index of all entries would ask for an array
    return out.reshape(())


def _plain(item: Any) -> Any:
    """Arrays of numpy alone."""
    if type(item) in (IntervalDual, Choice):
        return _alone(item)
    return item.view(np.ndarray) if type(item) is Quantities else item


def is_finite_number(item: Any) -> bool:
    """Whether this is one real number that a double comes near to."""
    if type(item) not in (int, float, bool) and not isinstance(item, (np.integer, np.floating)):
        return False  # also subclasses of float, which may compute in their own way
    return bool(abs(item) <= np.finfo(float).max)
