"""Exact root counts of integer polynomials: where the spectrum of a matrix lies, without rounding.

Polynomials are lists of Python integers, highest power first, known up to a positive factor.
Real roots are counted by Descartes' rule and Sturm's theorem, roots to the right of the imaginary axis by the Cauchy
index of p(iw) (Gantmacher, The Theory of Matrices, volume 2, chapter 15).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import accumulate, pairwise
from math import gcd

import numpy as np
from numpy.typing import NDArray

from .budget import require_seconds
from .matrix import Matrix

Polynomial = list[int]

# Intervals looked at for real roots, before a chain of polynomials counts them.
_INTERVALS = 200


def characteristic_polynomial(A: Matrix) -> tuple[Polynomial, Fraction]:
    """Characteristic polynomial of M, where A = M * f, by Faddeev and LeVerrier's recursion.

    Returns
    -------
    polynomial : list of int
        Monic, of M; the eigenvalues of A are its roots times f.
    f : Fraction
        Positive.

    Notes
    -----
    n matrix products of integers with up to n times as many digits as A: 0.3 s at n = 30.
    """
    M, factor = A.as_integers()
    n = M.shape[0]
    coefficients: Polynomial = [1]
    power = np.zeros_like(M)
    eye = np.array([[int(i == j) for j in range(n)] for i in range(n)], dtype=object)
    for k in range(1, n + 1):
        require_seconds()
        power = M @ (power + coefficients[-1] * eye) if k > 1 else M.copy()
        coefficients.append(-sum(power[i, i] for i in range(n)) // k)
    return coefficients, Fraction(factor)


def scale_roots(p: Polynomial, factor: Fraction) -> Polynomial:
    """Polynomial whose roots are those of p times a positive factor."""
    n = len(p) - 1
    num, den = factor.numerator, factor.denominator
    return _primitive([c * num**k * den ** (n - k) for k, c in enumerate(p)])


def shift_roots(p: Polynomial, by: Fraction) -> Polynomial:
    """Polynomial whose roots are those of p minus `by`."""
    num, den = by.numerator, by.denominator
    # With s = x / den, den^n p(x / den) has integer coefficients; Horner shifts it by num.
    out = [c * den**k for k, c in enumerate(p)]
    n = len(out) - 1
    for i in range(n):
        require_seconds()
        for j in range(1, n + 1 - i):
            out[j] += num * out[j - 1]
    return _primitive([c * den ** (n - k) for k, c in enumerate(out)])


def real_roots_above(p: Polynomial, bound: Fraction) -> int:
    """Number of different real roots larger than `bound`.

    By Descartes' rule of signs on ever smaller intervals (Vincent, 1834); by Sturm's theorem where that does not end
    soon, as at multiple roots.
    """
    q = _without_zero(shift_roots(p, bound))  # at a multiple root the whole chain would vanish
    count = _positive_roots(q)
    if count is not None:
        return count
    chain = _sturm(q, derivative(q))
    return _changes([_sign(f[-1]) for f in chain]) - _changes([_sign(f[0]) for f in chain])


def _positive_roots(p: Polynomial) -> int | None:
    """Number of different positive roots if p does not vanish at 0; None if that takes too many intervals.

    Changes of sign are as many as the positive roots, with multiplicity, or an even number more: none and one are
    certain.  Beyond 1 the roots are those of p(x + 1), between 0 and 1 those of x^n p(1 / x) at x + 1.
    """
    n = len(p) - 1
    top = max((-((abs(p[0]).bit_length() - abs(c).bit_length()) // k) for k, c in enumerate(p[1:], 1) if c), default=0)
    shifts = [top * (n - k) for k in range(n + 1)]  # a unit of about the size of the largest root
    count, intervals = 0, [[c << (e - min(shifts)) for c, e in zip(p, shifts, strict=True)]]
    for _ in range(_INTERVALS):
        if not intervals:
            return count
        require_seconds()
        q = intervals.pop()
        changes = _changes([_sign(c) for c in q])
        if changes <= 1:
            count += changes
            continue
        beyond, within = _moved(q), _moved(q[::-1])
        count += beyond[-1] == 0
        intervals += [_without_zero(beyond), _without_zero(within)]
    return None


def _moved(p: Polynomial) -> Polynomial:
    """p(x + 1)."""
    out = list(p)
    for k in range(len(p), 1, -1):
        out[:k] = accumulate(out[:k])
    return out


def _without_zero(p: Polynomial) -> Polynomial:
    """p without its roots at 0."""
    while len(p) > 1 and p[-1] == 0:
        p = p[:-1]
    return p


def vanishes(p: Polynomial, at: Fraction) -> bool:
    """True if `at` is a root."""
    return _evaluate(p, at) == 0


def imaginary_axis(p: Polynomial) -> tuple[int, bool]:
    """Roots right of the imaginary axis, and whether there are roots on it other than 0.

    Returns
    -------
    right : int
        Number of roots with positive real part, with multiplicity; -1 if there are roots on the axis.
    on_axis : bool
        True if some root i w with w != 0 exists.
    """
    n = len(p) - 1
    # p(iw) i^-n = U(w) - i V(w) with real U of degree n and V of degree at most n - 1.
    U = [c * (1, 0, -1, 0)[k % 4] for k, c in enumerate(p)]
    V = [c * (0, 1, 0, -1)[k % 4] for k, c in enumerate(p)]
    common = _gcd(U, V)
    roots = _real_root_count(common)
    at_zero = vanishes(common, Fraction(0))
    on_axis = roots - at_zero > 0
    if roots:
        return -1, on_axis
    chain = _sturm(_primitive(U), _primitive(V))
    index = _changes([_sign(f[0]) * (-1) ** (len(f) - 1) for f in chain]) - _changes([_sign(f[0]) for f in chain])
    return (n - index) // 2, False


def moebius(p: Polynomial, radius: Fraction) -> Polynomial:
    """Polynomial in s with p's roots z = radius (1 + s) / (1 - s): |z| > radius is Re s > 0.

    Roots at z = -radius go to infinity: the degree drops.
    """
    q = scale_roots(p, 1 / radius) if radius else p
    n = len(q) - 1
    out = [0] * (n + 1)
    for k, c in enumerate(q):
        require_seconds()
        term = [c]
        for _ in range(n - k):
            term = multiply(term, [1, 1])
        for _ in range(k):
            term = multiply(term, [-1, 1])
        out = [a + b for a, b in zip(out, term, strict=True)]
    return _strip(out)


def without_roots_of_unity(p: Polynomial) -> tuple[Polynomial, list[int]]:
    """p without those roots that are roots of unity, and the orders removed."""
    orders = []
    p = _primitive(p)
    limit = 2 * (len(p) - 1) ** 2 + 6  # Euler's phi of k is at least sqrt(k / 2)
    for k in range(1, limit + 1):
        if len(p) == 1:
            break
        while True:
            g = _gcd(p, [1] + [0] * (k - 1) + [-1])
            if len(g) == 1:
                break
            p = _divide(p, g)
            if k not in orders:
                orders.append(k)
    return p, orders


def circle_part(p: Polynomial) -> Polynomial:
    """Greatest common divisor of p and its reversal: holds every root on the unit circle."""
    p = _without_zero(p)
    return _gcd(p, p[::-1])


def rational_roots(p: Polynomial, near: NDArray[np.complex128]) -> list[Fraction]:
    """Rational roots with small denominators next to some numbers, with multiplicity.

    Multiple roots are known to few digits only: the simplest fractions come first.
    """
    found: list[Fraction] = []
    p = _primitive(p)
    for digits in (1, 10, 1000, 10**6):
        for root in sorted({Fraction(float(z.real)).limit_denominator(digits) for z in np.asarray(near)}):
            while len(p) > 1 and vanishes(p, root):
                found.append(root)
                p = _divide(p, [root.denominator, -root.numerator])
    return found


def square_free_factors(p: Polynomial) -> list[Polynomial]:
    """p_1, p_2, .. without repeated or common roots, p = p_1 p_2^2 p_3^3 .. up to a factor (Yun)."""
    out = []
    common = _gcd(p, derivative(p))
    rest = _divide(p, common)
    while len(rest) > 1:
        shared = _gcd(rest, common) if len(common) > 1 else [1]
        out.append(_divide(rest, shared))
        common = _divide(common, shared) if len(common) > 1 else [1]
        rest = shared
    return out


# -- arithmetic


def _sign(x: int | Fraction) -> int:
    return (x > 0) - (x < 0)


def _changes(signs: Sequence[int]) -> int:
    present = [s for s in signs if s]
    return sum(a != b for a, b in pairwise(present))


def _strip(p: Polynomial) -> Polynomial:
    k = next((i for i, c in enumerate(p) if c), len(p) - 1)
    return p[k:]


def _primitive(p: Polynomial) -> Polynomial:
    p = _strip(p)
    g = gcd(*p)
    return [c // g for c in p] if g > 1 else p


def _evaluate(p: Polynomial, at: Fraction) -> int:
    """p(at) times a positive integer."""
    num, den, value, power = at.numerator, at.denominator, 0, 1
    for c in p:
        value = value * num + c * power
        power *= den
    return value


def derivative(p: Polynomial) -> Polynomial:
    """The derivative up to a positive factor."""
    n = len(p) - 1
    return _primitive([c * (n - k) for k, c in enumerate(p[:-1])]) if n else [0]


def _remainder(a: Polynomial, b: Polynomial) -> Polynomial:
    """Remainder of a by b times a positive factor."""
    a = list(a)
    while len(a) >= len(b) and any(a):
        require_seconds()
        lead = a[0]
        if lead:
            scale = abs(b[0])
            sign = lead if b[0] > 0 else -lead
            a = [scale * x - sign * (b[i] if i < len(b) else 0) for i, x in enumerate(a)]
        a = a[1:]
    return _primitive(a) if any(a) else [0]


def _sturm(a: Polynomial, b: Polynomial) -> list[Polynomial]:
    chain = [a]
    while any(b):
        chain.append(b)
        a, b = b, [-c for c in _remainder(a, b)]
    return chain


def _gcd(a: Polynomial, b: Polynomial) -> Polynomial:
    a, b = _strip(a), _strip(b)
    while any(b):
        a, b = b, (_remainder(a, b) if len(a) >= len(b) else a)
    a = _primitive(a)
    return a if a[0] > 0 else [-c for c in a]


def _divide(a: Polynomial, b: Polynomial) -> Polynomial:
    rest, out = [Fraction(c) for c in a], []
    for _ in range(len(a) - len(b) + 1):
        lead = rest[0] / b[0]
        out.append(lead)
        rest = [x - lead * (b[i] if i < len(b) else 0) for i, x in enumerate(rest)][1:]
    den = 1
    for c in out:
        den = den * c.denominator // gcd(den, c.denominator)
    return _primitive([int(c * den) for c in out])


def multiply(a: Polynomial, b: Polynomial) -> Polynomial:
    """The product."""
    out = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] += x * y
    return out


def _real_root_count(p: Polynomial) -> int:
    if len(p) == 1:
        return 0
    chain = _sturm(p, derivative(p))
    low = [_sign(f[0]) * (-1) ** (len(f) - 1) for f in chain]
    return _changes(low) - _changes([_sign(f[0]) for f in chain])
