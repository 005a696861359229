"""Why no invariant polyhedral cone fits between b and c'x >= 0 in continuous time: the impulse response itself.

h(t) = c'e^(At) b >= 0 for t >= 0 if an invariant cone holds b and lies in c'x >= 0.  If the cone is polyhedral, more is
true: A + a I maps it into itself for some a, so no term of e^(at) h(t) = sum_k c'(A + aI)^k b t^k / k! is negative,
and h(t) = 0 at one t > 0 makes h zero for all t.  Two ways to prove h(t) <= 0 at some t > 0, in rational arithmetic:

series         h(t) is the sum of the first m terms c'A^k b t^k / k!, up to |c|_1 |b|_max r^m / m! / (1 - r / m) where
               r = |A| t < m, |A| being the largest row sum of sizes.  The upper bound is negative.
exponentials   h(t) = sum_i r_i e^(s_i t) for rational eigenvalues s_i, all of them top - m_i unit with whole m_i.  Then
               h(t) e^(-top t) = sum_i r_i q^m_i with q = e^(-unit t), and this polynomial has a root between 0 and 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...cards import about
from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.linalg import solve_columns
from ...exact.matrix import Matrix
from ...exact.polynomials import (
    Polynomial,
    characteristic_of,
    poles,
    primitive_part,
    rational_roots,
    scale_roots,
    square_free_part,
    vanishes,
)
from ...exact.roots import real_roots_above, root_discs
from ...proof.encoding import register_record
from .existence import fact, spectrum_polynomial
from .port_obstruction import LARGEST, Between, port_obstruction

Array = NDArray[np.float64]

# Terms of a series, and degree of a polynomial in e^(-unit t), at most.
_TERMS, _DEGREE = 600, 80
# Times at which the response is looked at, and responses that may be negative where floating point does not tell.
_TIMES, _NEARLY = 400, 1e-9
# Relative height below which a response without an answer is called close to zero.
_LOW = 1e-3
# Relative width of the interval around a time that is stated.
_NARROW = Fraction(1, 10**6)
# Operations of a product of long integers, of a matrix exponential, divided by n^3, and of a sum of fractions, divided
# by the square of their lengths in digits of machine integers.
_PER_PRODUCT, _PER_LOOK, _PER_DIGITS = 200.0, 30.0, 10.0


@dataclass(frozen=True, eq=False)
class SeriesObstruction(Between):
    """An impulse response that is negative at some time.

    Attributes
    ----------
    time : Fraction
        t > 0.
    terms : int
        m.
    """

    time: Fraction
    terms: int

    def conditions(self, matrices: Matrix, *, discrete: bool) -> list[Condition] | None:
        """The sign of a rational number."""
        if discrete or not self.fits(matrices.shape[-1]) or self.time <= 0 or not 0 < self.terms <= _TERMS:
            return None
        top = _highest(matrices[0], self)
        return [fact("c'e^(At) b < 0", top is not None and top < 0)]

    def __str__(self) -> str:
        return f"the impulse response c'e^(At) b is negative at t = {about(self.time)}"


@dataclass(frozen=True, eq=False)
class ExponentialObstruction(Between):
    """An impulse response of rational exponents that is zero at some time, but not always.

    Attributes
    ----------
    rates, weights : tuple of Fraction
        s_i and r_i.
    low, high : Fraction
        0 <= low < high <= 1, between which q = e^(-unit t) is.
    """

    rates: tuple[Fraction, ...]
    weights: tuple[Fraction, ...]
    low: Fraction
    high: Fraction

    def conditions(self, matrices: Matrix, *, discrete: bool) -> list[Condition] | None:
        """The exponents, and the count of roots."""
        ordered = 0 < self.low < self.high <= 1 and self.high - self.low <= _NARROW
        if discrete or not self.fits(matrices.shape[-1]) or not ordered or not 0 < len(self.rates) == len(self.weights):
            return None
        return [
            fact("c'e^(At) b = sum r e^(st)", _is_sum(matrices[0], self)),
            fact("c'e^(At) b = 0 at some t > 0", _vanishes_between(self)),
        ]

    def __str__(self) -> str:
        return (
            f"the impulse response c'e^(At) b is zero near t = {self._time():.3g}, and not always: an invariant cone "
            "between b and c'x >= 0 would not be polyhedral"
        )

    def _time(self) -> float:
        unit = _unit(self.rates)
        return 0.0 if unit is None else -math.log(float(self.low + self.high) / 2) / float(unit)


register_record(SeriesObstruction)
register_record(ExponentialObstruction)


def obstruction_between(A: Matrix, vectors: Matrix, normals: Matrix, *, discrete: bool) -> Between | None:
    """A proven reason why no invariant polyhedral cone holds the vectors and lies in the half-spaces, or None."""
    found = port_obstruction(A, vectors, normals, discrete=discrete)
    if found is not None or discrete or A.shape[0] > LARGEST:
        return found
    pairs = product(range(vectors.shape[0]), range(normals.shape[0]))
    suspects = (w for j, i in pairs for w in _suspects(A, vectors[[j]], normals[[i]]))
    return next((w for w in suspects if _is_proven(w, Matrix.stack([A]))), None)


def _is_proven(w: SeriesObstruction | ExponentialObstruction, matrices: Matrix) -> bool:
    conditions = w.conditions(matrices, discrete=False)
    return conditions is not None and all(c.verdict() for c in conditions)


def _suspects(A: Matrix, vector: Matrix, normal: Matrix) -> Iterator[SeriesObstruction | ExponentialObstruction]:
    """Reasons of both kinds, to be proven."""
    spend(_PER_LOOK * _TIMES * A.shape[0] ** 3)
    times = [t for t, height in _minima(A, vector, normal) if height < _NEARLY]
    for t in (short for time in times for short in _fractions(time)):
        terms = _enough(A, t)
        if terms is not None:
            yield SeriesObstruction(normal, vector, t, terms)
    if times:
        yield from _by_exponents(A, vector, normal)


# -- series


def _highest(A: Matrix, w: SeriesObstruction) -> Fraction | None:
    """An upper bound of c'e^(At) b; None if there are too few terms for one."""
    M, unit = A.as_integers()
    (x,), b_unit = w.vector.as_integers()
    (c,), c_unit = w.normal.as_integers()
    step = w.time * Fraction(unit)
    reach = max(sum(map(abs, row)) for row in M.tolist()) * step
    if reach >= w.terms:
        return None
    total, factor = Fraction(0), Fraction(1)
    size = sum(map(abs, c.tolist())) * max(map(abs, x.tolist()))
    for k in range(w.terms):
        digits = (factor.denominator.bit_length() + factor.numerator.bit_length()) / 30
        spend(_PER_PRODUCT * M.size + _PER_DIGITS * digits**2)  # common factors of long numbers
        total += factor * int(c @ x)
        factor *= step / (k + 1)
        x = M @ x
    rest = size * reach**w.terms / math.factorial(w.terms) / (1 - reach / w.terms)
    return (total + rest) * b_unit * c_unit


def _enough(A: Matrix, t: Fraction) -> int | None:
    """Terms after which the rest is of no weight; None if these are too many."""
    reach = float(np.abs(A.values).sum(axis=1).max() * float(t))
    for terms in (20, 40, 80, 150, 300, _TERMS):
        if reach < terms and terms * (math.log(terms) - 1 - math.log(max(reach, 1e-300))) > 80 + reach:
            return terms
    return None


def near_zero(A: Matrix, vectors: Matrix, normals: Matrix) -> str:
    """What to know of a question without an answer: how close an impulse response comes to zero, as computed."""
    pairs = product(range(vectors.shape[0]), range(normals.shape[0]))
    low = [m for j, i in pairs for m in _minima(A, vectors[[j]], normals[[i]])] if A.shape[0] <= LARGEST else []
    t, height = min(low, key=lambda m: m[1], default=(0.0, np.inf))
    if not height < _LOW:
        return ""
    return (
        f" Computed: the impulse response c'e^(At) b is {height:.1g} of |c| |e^(At) b| near t = {t:.3g}. The closer to "
        "zero, the more rays a cone takes; if it touches zero, and is not zero always, there is no polyhedral one."
    )


def _minima(matrix: Matrix, vector: Matrix, normal: Matrix) -> Iterator[tuple[float, float]]:
    """Times at which the response has a minimum, the lowest first, and its height relative to the sizes."""
    A, b, c = np.asarray(matrix.values), np.asarray(vector.values)[0], np.asarray(normal.values)[0]
    values = np.linalg.eigvals(A)
    top, scale = float(values.real.max()), float(np.abs(values).max(initial=0.0)) or 1.0
    gaps = top - values.real
    last = 60 / max(1e-6 * scale, float(gaps[gaps > 1e-9 * scale].min(initial=scale)))
    moved, times = A - top * np.eye(len(A)), np.geomspace(0.01 / scale, last, _TIMES)
    flows = sl.expm(times[:, None, None] * moved)
    states = flows @ b
    size = np.linalg.norm(states, axis=1) * np.linalg.norm(c)
    response = (states @ c) / np.where(size > 0, size, 1.0)
    ends = np.concatenate([[np.inf], response, [np.inf]])
    lowest = np.flatnonzero((response <= ends[:-2]) & (response <= ends[2:]))
    for k in sorted(lowest.tolist(), key=lambda k: response[k])[:3]:
        t = _settled(moved, A, b, c, float(times[k]))
        height = float(c @ sl.expm(moved * t) @ b) / float(size[k] or 1.0)
        if np.isfinite(height) and t > 0:
            yield t, height


def _fractions(t: float) -> Iterator[Fraction]:
    """Simple fractions near t, then t itself."""
    mantissa, exponent = math.frexp(t)
    short = [Fraction(mantissa).limit_denominator(digits) for digits in (10, 1000, 10**6)]
    yield from (x * Fraction(2) ** exponent for x in (*short, Fraction(mantissa)))


def _settled(moved: Array, A: Array, b: Array, c: Array, t: float) -> float:
    """A time where the derivative of the response vanishes, near t: Newton's method."""
    for _ in range(30):
        x = A @ sl.expm(moved * t) @ b
        bend = float(c @ A @ x)
        step = float(c @ x) / bend if bend > 0 else 0.0
        if not abs(step) < t / 2:
            break
        t -= step
    return t


# -- exponentials


def _by_exponents(A: Matrix, vector: Matrix, normal: Matrix) -> Iterator[ExponentialObstruction]:
    """Where all poles of the response are rational and simple."""
    M, unit = A.as_integers()
    x, c = vector.as_integers()[0][0], normal.as_integers()[0][0]
    q = scale_roots(poles(characteristic_of(M), M, x, c), Fraction(unit))
    rates = rational_roots(q, np.linalg.eigvals(A.values))
    if not 0 < len(set(rates)) == len(rates) == len(q) - 1:
        return
    powers = np.array([[s**k for s in rates] for k in range(len(rates))], dtype=object)
    weights = solve_columns(powers, np.array([_responses(A, vector, normal, len(rates))], dtype=object).T)
    if weights is None:
        return
    found = tuple(rates), tuple(weights[:, 0])
    in_q = _in_exponential(*found)
    discs = next(root_discs(square_free_part(in_q), 128), ()) if in_q is not None and len(in_q) > 1 else ()
    for low, high in sorted((disc.range() for disc in discs if disc.is_real), reverse=True):
        if 0 < low < high < 1:
            yield ExponentialObstruction(normal, vector, *found, low, high)


def _responses(A: Matrix, vector: Matrix, normal: Matrix, count: int) -> list[Fraction]:
    """c'b, c'A b, c'A^2 b, .."""
    M, x, c = A.fractions(), vector.fractions()[0], normal.fractions()[0]
    out = []
    for _ in range(count):
        out.append(c @ x)
        x = M @ x
    return out


def _is_sum(A: Matrix, w: ExponentialObstruction) -> bool:
    """c'A^k b = sum_i r_i s_i^k for k < n, with eigenvalues s_i: then for all k."""
    p = spectrum_polynomial(A)
    sums = [sum(r * s**k for s, r in zip(w.rates, w.weights, strict=True)) for k in range(A.shape[0])]
    return all(vanishes(p, s) for s in w.rates) and sums == _responses(A, w.vector, w.normal, A.shape[0])


def _unit(rates: tuple[Fraction, ...]) -> Fraction | None:
    """The largest number of which all differences of rates are multiples; None if there are none."""
    steps = [max(rates) - s for s in rates]
    below = math.lcm(*(step.denominator for step in steps))
    return Fraction(math.gcd(*(int(step * below) for step in steps)), below) or None


def _in_exponential(rates: tuple[Fraction, ...], weights: tuple[Fraction, ...]) -> Polynomial | None:
    """sum_i r_i q^m_i; None if the degree is too high, or if all rates are one."""
    unit = _unit(rates) if rates else None
    if unit is None or (max(rates) - min(rates)) / unit > _DEGREE:
        return None
    below = math.lcm(*(r.denominator for r in weights))
    out = [0] * (int((max(rates) - min(rates)) / unit) + 1)
    for s, r in zip(rates, weights, strict=True):
        out[-1 - int((max(rates) - s) / unit)] += int(r * below)
    return out


def _vanishes_between(w: ExponentialObstruction) -> bool:
    """Whether the polynomial has a root between low and high, and is not zero."""
    q = _in_exponential(w.rates, w.weights)
    if q is None or not any(q):
        return False
    q = primitive_part(q)
    return not vanishes(q, w.high) and real_roots_above(q, w.low) > real_roots_above(q, w.high)
