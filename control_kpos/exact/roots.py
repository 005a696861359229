"""Discs that hold one root of a polynomial each, proven in integers, and what they say about the spectrum.

Theorem (Smith, Journal of the ACM 17, 1970, page 137).  Let p have degree n and leading coefficient a, and let
z_1, .., z_n be distinct numbers.  All roots of p lie in the union of the discs around the z_i of radius

    n |p(z_i)| / |a prod_(j != i) (z_i - z_j)|,

and a disc that meets no other holds exactly one root.

FLINT proposes the z_i; the theorem holds for any distinct numbers, so they need not be trusted.  They are
rounded to a grid, symmetric to the real axis, and the radii are computed here in integers and rounded up.  A root is
real if its disc is symmetric, because its conjugate is a root in the same disc.  A root that lies exactly on a line,
where no disc decides, is found by algebra: p(s) and p(-s) have all roots on the imaginary axis in common.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import isqrt
from typing import Any, TypeVar

from flint import ctx, fmpz_poly

from .budget import spend
from .linalg import WrongAnswerError
from .polynomials import (
    Polynomial,
    common_divisor,
    divided,
    mirrored,
    primitive_part,
    square_free_part,
    vanishes,
    without_zero,
)

T = TypeVar("T")

# Binary digits of the first approximations, doubled until a question is decided; where that may never happen, and
# where no polynomial of a size that can be written down goes.
_FIRST, _ENOUGH, _ABSURD = 64, 512, 2**20
# Operations for each root and coefficient.
_PRODUCT = 1000.0


@dataclass(frozen=True)
class Disc:
    """All numbers within `radius` of x + i y; lengths in units of 2**-places.

    Attributes
    ----------
    x, y, radius : int
    places : int
    """

    x: int
    y: int
    radius: int
    places: int

    @property
    def is_real(self) -> bool:
        """Symmetric to the real axis: the root in it is real."""
        return self.y == 0

    def meets(self, other: Disc) -> bool:
        """True if the discs have a point in common."""
        return (self.x - other.x) ** 2 + (self.y - other.y) ** 2 <= (self.radius + other.radius) ** 2

    def range(self, *, modulus: bool = False) -> tuple[Fraction, Fraction]:
        """Bounds of the real part, or of the modulus, of the numbers in the disc."""
        low = high = self.x
        if modulus:
            low = isqrt(self.x**2 + self.y**2)
            high = low + 1
        unit = Fraction(2) ** -self.places
        return (low - self.radius) * unit, (high + self.radius) * unit


def root_discs(p: Polynomial, most: int = _ABSURD) -> Iterator[tuple[Disc, ...]]:
    """Disjoint discs that hold one root of p each, and together all of them; smaller and smaller ones.

    Parameters
    ----------
    p : list of int
        Without repeated roots.
    most : int
        Binary digits after which to stop.
    """
    digits = _FIRST
    while digits <= most:
        discs = _isolated(tuple(primitive_part(p)), digits)
        if discs is not None:
            yield discs
        digits *= 2


@lru_cache(maxsize=64)
def _isolated(p: tuple[int, ...], digits: int) -> tuple[Disc, ...] | None:
    """Discs of about so many correct digits; None if some of them meet."""
    n = len(p) - 1
    spend(_PRODUCT * n**2 * (1 + digits * n / 2000))
    points, places = _approximations(p, digits)
    everywhere = points + [(x, -y) for x, y in points if y]
    if len(everywhere) != n:
        return None
    shifted = [c << (places * k) for k, c in enumerate(p)]
    discs = []
    for x, y in points:
        gaps = [(x - u) ** 2 + (y - v) ** 2 for u, v in everywhere if (u, v) != (x, y)]
        if len(gaps) != n - 1:  # two points fall together
            return None
        value, scale = _squared_size(shifted, x, y), p[0] ** 2
        for gap in gaps:
            scale *= gap
        discs.append(Disc(x, y, isqrt(n * n * value // scale) + 1, places))
    discs += [Disc(d.x, -d.y, d.radius, places) for d in discs if d.y]
    apart = not any(a.meets(b) for k, a in enumerate(discs) for b in discs[:k])
    return tuple(discs) if apart else None


def _squared_size(p: list[int], x: int, y: int) -> int:
    """|p(x + i y)|^2, by Horner's rule."""
    a = b = 0
    for c in p:
        a, b = a * x - b * y + c, a * y + b * x
    return a * a + b * b


def _approximations(p: tuple[int, ...], digits: int) -> tuple[list[tuple[int, int]], int]:
    """Numbers near the roots of nonnegative imaginary part, on a grid, and the binary places of the grid."""
    with ctx.workprec(digits):
        found: Any = fmpz_poly(list(reversed(p))).complex_roots()
    parts = [(root.real.mid().man_exp(), root.imag.mid().man_exp()) for root, _ in found]
    numbers = [tuple((int(mantissa), int(exponent)) for mantissa, exponent in pair) for pair in parts]
    largest = [max(m.bit_length() + e for m, e in pair if m) for pair in numbers if any(m for m, _ in pair)]
    places = digits - min(largest, default=0)
    points = [(_on_grid(*x, places), _on_grid(*y, places)) for x, y in numbers if y[0] >= 0]
    return points, max(places, 0)


def _on_grid(mantissa: int, exponent: int, places: int) -> int:
    shift = exponent + max(places, 0)
    return mantissa << shift if shift >= 0 else mantissa >> -shift


# -- questions


def _decide(p: Polynomial, question: Callable[[tuple[Disc, ...]], T | None]) -> T:
    """The answer from discs small enough for one."""
    for discs in root_discs(p):
        answer = question(discs)
        if answer is not None:
            return answer
    raise WrongAnswerError("root")


def real_roots_above(p: Polynomial, bound: Fraction) -> int:
    """Number of different real roots larger than `bound`.

    Examples
    --------
    >>> real_roots_above([1, 0, -2, 0], Fraction(-1)), real_roots_above([1, 0, -2, 0], Fraction(0))
    (2, 1)
    """
    q = square_free_part(p)
    if vanishes(q, bound):
        q = divided(q, [bound.denominator, -bound.numerator]) or [1]

    def count(discs: tuple[Disc, ...]) -> int | None:
        ranges = [disc.range() for disc in discs if disc.is_real]
        if any(low <= bound <= high for low, high in ranges):
            return None
        return sum(low > bound for low, _ in ranges)

    return _decide(q, count)


def roots_beyond(p: Polynomial, bound: Fraction, *, modulus: bool = False) -> int:
    """Number of different roots whose real part (modulus) is larger than `bound`; only those 2^-500 beyond it count.

    Examples
    --------
    >>> roots_beyond([1, 0, 1], Fraction(0)), roots_beyond([1, 0, 1], Fraction(1, 2), modulus=True)
    (0, 2)
    """
    beyond = 0
    for discs in root_discs(square_free_part(p), _ENOUGH):
        ranges = [disc.range(modulus=modulus) for disc in discs]
        beyond = sum(low > bound for low, _ in ranges)
        if not any(low <= bound < high for low, high in ranges):
            break
    return beyond


def on_imaginary_axis(p: Polynomial) -> bool:
    """True if some root i w with w != 0 exists.

    Roots of p(s) and p(-s) alike are symmetric to the axis: if the mirror image of a disc meets no other disc, the
    root in it is its own mirror image.

    Examples
    --------
    >>> on_imaginary_axis([1, 0, 1]), on_imaginary_axis([1, 0, -1, 0])
    (True, False)
    """
    q = square_free_part(without_zero(p))

    def some(discs: tuple[Disc, ...]) -> bool | None:
        near = [disc for disc in discs if abs(disc.x) <= disc.radius]
        images = [(disc, Disc(-disc.x, disc.y, disc.radius, disc.places)) for disc in near]
        if any(not any(image.meets(other) for other in discs if other is not disc) for disc, image in images):
            return True
        return None if near else False

    return _decide(common_divisor(q, mirrored(q)), some)
