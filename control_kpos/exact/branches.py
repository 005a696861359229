"""Functions of several branches: `np.where` and the like, with conditions that tell nothing but which branch is taken.

A comparison of quantities gives a condition.  On a box where it is undecided, or decided but for points where what is
compared is equal, the branches have to have the same value at these points: a function that jumps is not the integral
of its derivatives.  A continuous one is, and its derivatives are those of one branch or the other almost everywhere.

The proof that branches meet on the surface d = 0, where d is the difference of what is compared, is one of two.  The
difference of the branches may be a multiple of d, as a sum of the same quantities.  Or d is a line in one variable with
its zero at a double c: then the function is called once more with the variable at c, and the difference has to be
zero, with nothing rounded.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import growth as rates
from . import interval_arithmetic as ia
from .bends import unknown_where
from .quantities import Known, Variable, differ, minus
from .sums import Sum, proportional
from .unreadable import Surface, UnsupportedError, Watch, note_gap, note_kink, note_surface, same_object

Truth = tuple[Any, Any]
_JUMP = "np.where, or a function like it, whose branches are not proven to meet where the condition changes"


class Comparison(NamedTuple):
    """d > 0, where nothing is said of d = 0; or d == 0."""

    d: Known
    is_equality: bool = False

    def truth(self) -> Truth:
        """On which boxes it holds, and on which it fails, at all points."""
        low, high = (np.asarray(end) for end in self.d.value)
        apart = (low > 0) | (high < 0)
        return (np.zeros_like(apart), apart) if self.is_equality else (low > 0, high < 0)

    def truth_beside(self) -> Truth:
        """The same at points with d != 0; nothing for a box that has none."""
        low, high = (np.asarray(end) for end in self.d.value)
        if self.is_equality:
            return np.zeros(low.shape, dtype=bool), np.ones(low.shape, dtype=bool)
        return (low >= 0) & (high > 0), (high <= 0) & (low < 0)

    @property
    def comparisons(self) -> list[Comparison]:
        """Itself."""
        return [self]

    @property
    def key(self) -> tuple[Any, ...]:
        """The same for conditions that came about by the same steps."""
        return self.d.name, self.is_equality


class Joined(NamedTuple):
    """Conditions joined by "and" or "or"; or one under "not"."""

    how: str
    parts: tuple[Any, ...]

    def truth(self) -> Truth:
        """On which boxes it holds, and on which it fails, at all points."""
        return self._joined([part.truth() for part in self.parts])

    def truth_beside(self) -> Truth:
        """The same at points where nothing that is compared is equal."""
        return self._joined([part.truth_beside() for part in self.parts])

    def _joined(self, truths: list[Truth]) -> Truth:
        if self.how == "not":
            return truths[0][::-1]
        (yes, no), (also, nor) = truths
        return (yes & also, no | nor) if self.how == "and" else (yes | also, no & nor)

    @property
    def comparisons(self) -> list[Comparison]:
        """All that it is made of."""
        return [one for part in self.parts for one in part.comparisons]

    @property
    def key(self) -> tuple[Any, ...]:
        """The same for conditions that came about by the same steps."""
        return self.how, *(part.key for part in self.parts)


def chosen(condition: Any, a: Known, b: Known, steps: int) -> Known:
    """One quantity where a condition holds, another one where it fails.

    Raises
    ------
    UnsupportedError
        The function may jump: the branches are not proven to meet.
    """
    yes, no = condition.truth()
    if (yes | no).all():
        first, second = yes, no
    else:
        gap = minus(a, b)
        note_gap(steps, gap.value)
        for one in condition.comparisons:
            _require_meeting(one.d, gap, ~(yes | no), steps)
        beside = condition.truth_beside()
        first, second = yes | (beside[0] & ~no), no | (beside[1] & ~yes)
    return _either(first, second, a, b, same_object("where", condition.key, a.name, b.name))


def _either(first: Any, second: Any, a: Known, b: Known, name: object) -> Known:
    """The first quantity on some boxes, the second one on others, and either on the rest."""
    if first.all():
        return a
    if second.all():
        return b
    sides = zip(a.value, b.value, ia.hull(a.value, b.value), strict=True)
    low, high = (np.where(first, x, np.where(second, y, z)) for x, y, z in sides)
    gradient = _picked(first, second, a.gradient, b.gradient)
    open_ = np.asarray(~first & ~second)
    if (open_[..., None] & differ(a.gradient, b.gradient)).any():
        note_kink()
    bend, growth = None, rates.either(a.growth, b.growth)
    if a.bend is not None or b.bend is not None:
        zero = np.zeros((1, 1)), np.zeros((1, 1))
        here, there = np.asarray(first)[..., None], np.asarray(second)[..., None]
        bend = unknown_where(open_, _picked(here, there, a.bend or zero, b.bend or zero), gradient)
    return Known((low, high), gradient, name, None, bend, growth)


def _picked(first: Any, second: Any, a: Any, b: Any) -> tuple[Any, Any]:
    one, other = np.asarray(first)[..., None], np.asarray(second)[..., None]
    low, high = (np.where(one, x, np.where(other, y, z)) for x, y, z in zip(a, b, ia.hull(a, b), strict=True))
    return low, high


def _require_meeting(d: Known, gap: Known, open_: Any, steps: int) -> None:
    """Branches with this difference meet where d is zero: proven now, or noted as what a further call has to show."""
    touched = np.asarray((d.value[0] <= 0) & (d.value[1] >= 0) & open_)
    if not touched.any() or _is_zero(gap.value, touched):
        return
    if proportional(gap.sum, d.sum, touched):
        return
    root = _zero_of(d.sum)
    if root is None:
        raise UnsupportedError(_JUMP)
    note_surface(Surface(steps, *root, touched))


def _is_zero(a: ia.Interval, where: Any) -> bool:
    return bool(((np.asarray(a[0]) == 0) & (np.asarray(a[1]) == 0) | ~where).all())


@np.errstate(all="ignore")
def _zero_of(line: Sum) -> tuple[int, Any] | None:
    """The one variable in a sum, and the double at which that is zero, on each box; None if there is none."""
    if len(line.terms) != 1 or not isinstance(line.terms[0][0].name, Variable) or ia.may_be_zero(line.terms[0][1]):
        return None
    base, scale = line.terms[0]
    root = -np.asarray(line.shift[0]) / np.asarray(scale[0])
    return (base.name.index, root) if _is_zero(line.value([(root, root)]), np.asarray(True)) else None


def require_no_jumps(watch: Watch, call: Any) -> None:
    """Call the function on the surfaces that were noted, where its branches have to meet.

    Parameters
    ----------
    watch : Watch
        Of the call that met them.
    call : callable
        Takes a surface, calls the function on it, and returns on which boxes it was called and what was noted.
    """
    for surface in watch.surfaces:
        boxes, seen = call(surface)
        gaps = seen.gaps.get(surface.steps, [])
        if boxes.any() and not (gaps and all(_is_zero(gap, boxes) for gap in gaps)):
            raise UnsupportedError(_JUMP)
