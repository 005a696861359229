"""Weighted sums of quantities: what occurs twice is counted once.

A quantity may be a sum  s_1 q_1 + ... + s_k q_k + t  of others, with numbers s_i and t for each box.  In sums of sums
equal quantities are put together, so that x - x is zero, and (a + x) - x is a.  A quotient of two sums f / g has the
derivative

    (f_k g - g_k f) / g^2  by  q_k,    where  f_k g - g_k f = sum_j (f_k g_j - g_k f_j) q_j + (f_k g_0 - g_k f_0),

in which q_k cancels: x / (1 + x + y) rises in x all over x, y >= 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import interval_arithmetic as ia
from .interval_arithmetic import ONE, ZERO, Interval

# Sums of more quantities are quantities of their own.
_MOST = 6


class Sum(NamedTuple):
    """s_1 q_1 + ... + s_k q_k + t, with numbers for each box; of no quantity, it is a number.

    Attributes
    ----------
    terms : tuple of pairs
        Quantities, with a value, a gradient and a name each, and their factors.
    shift : pair of arrays
    """

    terms: tuple[tuple[Any, Interval], ...]
    shift: Interval = ZERO

    def moved(self, scale: Interval, shift: Interval) -> Sum | None:
        """scale * this + shift; None where the numbers grow too large."""
        terms = tuple((base, ia.loose_product(scale, factor)) for base, factor in self.terms)
        out = Sum(terms, ia.loose_sum(ia.loose_product(scale, self.shift), shift))
        return out if all(ia.is_bounded(number) for number in (out.shift, *(factor for _, factor in terms))) else None

    def plus(self, other: Sum) -> Sum | None:
        """The sum; None if it has too many terms."""
        factors = {id(base.name): (base, factor) for base, factor in self.terms}
        for base, factor in other.terms:
            _, known = factors.get(id(base.name), (base, ZERO))
            factors[id(base.name)] = base, ia.loose_sum(known, factor)
        terms = tuple((base, s) for base, s in factors.values() if np.any(s[0]) or np.any(s[1]))
        return Sum(terms, self.shift).moved(ONE, other.shift) if len(terms) <= _MOST else None

    def times(self, other: Sum) -> Sum | None:
        """The product, if one of them is a number."""
        if not other.terms:
            return self.moved(other.shift, ZERO)
        return other.moved(self.shift, ZERO) if not self.terms else None

    def factor(self, name: object) -> Interval:
        """The factor of a quantity."""
        return next((factor for base, factor in self.terms if base.name is name), ZERO)

    def value(self, places: list[Interval] | None = None) -> Interval:
        """Bounds of the value, where its quantities are, or at other places; they may be infinite."""
        total = self.shift
        places = [base.value for base, _ in self.terms] if places is None else places
        for (_, factor), place in zip(self.terms, places, strict=True):
            total = ia.loose_sum(total, ia.loose_product(factor, place))
        return total

    def gradient(self) -> Interval:
        """Bounds of the derivatives; they may be infinite."""
        return combined([(base, spread(factor)) for base, factor in self.terms])


def spread(a: Interval) -> Interval:
    """An interval for all derivatives."""
    if a[0] is a[1]:
        return (same := np.asarray(a[0])[..., None], same)
    return np.asarray(a[0])[..., None], np.asarray(a[1])[..., None]


def combined(slopes: list[tuple[Any, Interval]]) -> Interval:
    """Slopes by quantities times the derivatives of these, added; they may be infinite."""
    total = ZERO
    for base, slope in slopes:
        total = ia.loose_sum(total, ia.loose_product(base.gradient, slope))
    return total


def proportional(f: Sum, g: Sum, where: Any) -> bool:
    """Whether f is a multiple of g, proven on some boxes; a factor of g is not zero there."""
    if not g.terms or ia.may_be_zero(g.terms[0][1]):
        return False
    pivot, divisor = g.terms[0]
    ratio = f.factor(pivot.name)
    pairs = [(f.factor(base.name), g.factor(base.name)) for base, _ in (*f.terms, *g.terms)] + [(f.shift, g.shift)]
    crossed = (ia.difference(ia.product(a, divisor), ia.product(ratio, b)) for a, b in pairs)
    return all(bool(np.all((low == 0) & (high == 0) | ~where)) for low, high in crossed)


@np.errstate(all="ignore")
def quotient(f: Sum, g: Sum, inverse: Interval) -> tuple[Interval, Interval] | None:
    """Bounds of the value and of the derivatives of f / g, where 1 / g is known; None if they help nothing.

    Where the quotient rises or falls with a quantity, its value is taken at the ends of that.
    """
    names = {id(base.name) for base, _ in g.terms}
    if not names or (f.terms and not names.intersection(id(base.name) for base, _ in f.terms)):
        return None
    bases = [base for base, _ in g.terms] + [base for base, _ in f.terms if id(base.name) not in names]
    per = ia.loose_product(inverse, inverse)
    above, below = (Sum(tuple((base, side.factor(base.name)) for base in bases), side.shift) for side in (f, g))
    turns = [_turn(above, below, k) for k in range(len(bases))]
    slopes = combined([(base, spread(ia.loose_product(turn, per))) for base, turn in zip(bases, turns, strict=True)])
    reached = []
    for side in (0, 1):
        places = [_end(base.value, turn, side) for base, turn in zip(bases, turns, strict=True)]
        bottom = below.value(places)
        if ia.may_be_zero(bottom):
            return None
        reached.append(ia.loose_product(above.value(places), ia.loose_inverse(bottom))[side])
    value = reached[0], reached[1]
    return (value, slopes) if ia.is_bounded(value) and ia.is_bounded(slopes) else None


def _turn(f: Sum, g: Sum, k: int) -> Interval:
    """f_k g - g_k f, without the quantity itself."""
    (_, mine), (_, other) = f.terms[k], g.terms[k]

    def crossed(a: Interval, b: Interval) -> Interval:
        return ia.loose_sum(ia.loose_product(mine, b), ia.negative(ia.loose_product(other, a)))

    pairs = enumerate(zip(f.terms, g.terms, strict=True))
    terms = tuple((base, crossed(a, b)) for j, ((base, a), (_, b)) in pairs if j != k)
    return Sum(terms, crossed(f.shift, g.shift)).value()


def _end(value: Interval, turn: Interval, side: int) -> Interval:
    """The end of a quantity at which something that rises with it, or falls, is least (side 0) or largest (side 1)."""
    rises, falls = np.asarray(turn[0] >= 0), np.asarray(turn[1] <= 0)
    low = np.where(rises, value[side], np.where(falls, value[1 - side], value[0]))
    high = np.where(rises, value[side], np.where(falls, value[1 - side], value[1]))
    return low, high
