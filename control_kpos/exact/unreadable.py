"""Arguments from which nothing can be read, and a watch over what a function does with them.

A statement about a function on a whole set rests on one call only if the function takes the same path for all of it.
Whatever could make it branch (comparisons, hashes, text, conversions, `isinstance`) is refused here.  A refusal is
remembered, whatever the function does with the exception, and wherever it is made.  What Python does not let an object
refuse (`type(x)`, `is`, errors of others that are caught) is found in the code that ran, by `own_code`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from .own_code import followed


@dataclass
class Watch:
    """What happened during one call of a function."""

    refusals: list[Exception] = field(default_factory=list)
    met_kink: bool = False
    names: dict[Any, object] = field(default_factory=dict)
    surfaces: list[Surface] = field(default_factory=list)
    gaps: dict[int, list[Any]] = field(default_factory=dict)


class Surface(NamedTuple):
    """Where the branches of a function have to meet.

    Attributes
    ----------
    steps : int
        Which result of the function has branches.
    variable : int
        Which of the arguments is fixed.
    place : ndarray
        At which number, for each box.
    boxes : ndarray of bool
        On which boxes.
    """

    steps: int
    variable: int
    place: Any
    boxes: Any


_WATCH: ContextVar[Watch] = ContextVar("_WATCH")
# All that are open: a refusal in another thread or context belongs to one of them, whichever that is.
_OPEN: list[Watch] = []


class RefusedError(Exception):
    """Raised into a function that is being watched, and remembered from the moment it is made."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        watch = _WATCH.get(None)
        for each in _OPEN if watch is None else [watch]:
            each.refusals.append(self)


class UnboundedError(RefusedError, ArithmeticError):
    """A value or a derivative is not bounded on the box."""


class UnsupportedError(RefusedError, TypeError):
    """The function does something with its argument that intervals do not know."""


def note_kink() -> None:
    """Two slopes meet inside the quantities at hand."""
    if (watch := _WATCH.get(None)) is not None:
        watch.met_kink = True


def note_surface(surface: Surface) -> None:
    """Branches have to meet on a surface."""
    if (watch := _WATCH.get(None)) is not None:
        watch.surfaces.append(surface)


def note_gap(steps: int, gap: Any) -> None:
    """Between which bounds the difference of two branches is."""
    if (watch := _WATCH.get(None)) is not None:
        watch.gaps.setdefault(steps, []).append(gap)


def same_object(*description: Any) -> object:
    """One object for each description, within a call."""
    watch = _WATCH.get(None)
    return object() if watch is None else watch.names.setdefault(description, object())


def watched(function: Callable[[Any], Any], argument: Any) -> tuple[list[Any], Watch]:
    """The values of a function that met no refusal, as a list, and what else was noted.

    Raises
    ------
    UnboundedError, UnsupportedError
        The refusal that ended the function; UnsupportedError also if the function went on after one, or failed, or
        ran code that can tell types apart.
    """
    watch = Watch()
    values: list[Any] = []
    failure: Exception | None = None
    before = _WATCH.set(watch)
    _OPEN.append(watch)
    try:
        result, telling = followed(lambda: function(argument))
        if telling:
            raise UnsupportedError(f"the function, or one that it calls, can tell types apart: {', '.join(telling)}")
        values = list(np.asarray(result, dtype=object).ravel())
    except Exception as error:  # noqa: BLE001 -- the function is the user's
        failure = error
    finally:
        _WATCH.reset(before)
        _OPEN.remove(watch)
    if failure is None and not watch.refusals:
        return values, watch
    if failure is not None and watch.refusals == [failure]:
        raise failure
    if not watch.refusals:
        raise UnsupportedError(f"the function fails with {type(failure).__name__}: {failure}") from failure
    raise UnsupportedError("the function goes on after an exception that intervals raised") from failure


class Unreadable:
    """A quantity that tells nothing about itself; subclasses allow what is true of all its values."""

    __slots__ = ()

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise UnsupportedError(self._looked_at())

    def _looked_at(self) -> str:
        return "the function looks at its argument: comparison, conversion, text or type"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__array"):  # numpy asks
            raise AttributeError(name)
        return self._refuse()

    def _same(self, *_: Any) -> Any:
        return self

    __copy__ = __deepcopy__ = _same
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = __divmod__ = __rdivmod__ = __pow__ = __rpow__ = _refuse
    __neg__ = __pos__ = __abs__ = __round__ = __trunc__ = __floor__ = __ceil__ = _refuse
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = __hash__ = _refuse
    __float__ = __int__ = __index__ = __complex__ = __bool__ = __str__ = __repr__ = __format__ = _refuse
    __reduce_ex__ = __sizeof__ = __dir__ = _refuse

    __class__: Any = property(_refuse)  # what `isinstance` reads where the type itself does not answer
