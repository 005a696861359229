"""Elementary functions of doubles, enclosed between doubles, and the ranges of sine and cosine.

FLINT's ball arithmetic (arb) encloses the value at a number; the ends of the ball are rounded outwards here.  No
function of the C library is trusted.  Products and sums of intervals need none of this and stay in `intervals`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from flint import arb, ctx

Interval = tuple[float, float]

# Binary digits to compute with.  No double is nearer to a zero of sine or cosine than 2^-62 of its size, so that this
# leaves more digits than a double has (Muller, Elementary Functions, chapter on range reduction).
_BITS = 150


def enclosed(function: Callable[[Any], Any], x: float) -> Interval:
    """The value of a function of balls at a double, between doubles at most two apart; infinite where it overflows.

    >>> low, high = enclosed(arb.exp, 1.0)
    >>> low < high == math.nextafter(low, 3), low <= math.e <= high
    (True, True)
    """
    with ctx.workprec(_BITS):
        ball = function(arb(float(x)))
        if not ball.is_finite():
            return -math.inf, math.inf
        return _doubles(ball)


def _doubles(ball: Any) -> Interval:
    return _below(ball.lower()), -_below(-ball.upper())


def _below(number: Any) -> float:
    """The largest double that is not above a number."""
    nearest = float(number)
    return nearest if arb(nearest) <= number else math.nextafter(nearest, -math.inf)


def integer_power(x: float, power: int) -> Interval:
    """x^k."""
    return enclosed(lambda ball: ball**power, x)


def real_power(x: float, power: float, less: int = 0) -> Interval:
    """x^(power - less) for x > 0."""
    return enclosed(lambda ball: ball ** (arb(power) - less), x)


def sine_and_cosine(value: Interval) -> tuple[Interval, Interval]:
    """Ranges of sine and cosine on an interval; an extremum at an end that is in doubt counts as reached."""
    low, high = float(value[0]), float(value[1])
    first, last = quarter_turns(low, high)
    with ctx.workprec(_BITS):
        balls = [arb(x).sin_cos() for x in {low, high}]
        sine, cosine = [_doubles(s) for s, _ in balls], [_doubles(c) for _, c in balls]

    def reached(quarter: int) -> bool:
        return (quarter - first) % 4 <= last - first

    def span(ends: list[Interval], lowest: int, highest: int) -> Interval:
        bottom = -1.0 if reached(lowest) else max(min(a for a, _ in ends), -1.0)
        return bottom, 1.0 if reached(highest) else min(max(b for _, b in ends), 1.0)

    return span(sine, 3, 1), span(cosine, 2, 0)


def quarter_turns(low: float, high: float) -> tuple[int, int]:
    """The first and the last k with k pi / 2 in an interval, or beside it by less than can be told.

    >>> quarter_turns(-1.0, 5.0), quarter_turns(1.0, 1.5)
    ((0, 3), (1, 0))
    """
    size = max(math.frexp(low)[1], math.frexp(high)[1], 0)
    with ctx.workprec(_BITS + size):
        quarter = arb.pi() / 2
        first: Any = (arb(low) / quarter).lower().ceil().unique_fmpz()
        last: Any = (arb(high) / quarter).upper().floor().unique_fmpz()
        return int(first), int(last)
