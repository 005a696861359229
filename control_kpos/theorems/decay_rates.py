"""Decay rates that a vector proves, and bounds of all decay rates that a direction proves.

v in int X* proves the rate min_i -(v'A x_i) / (v'x_i) over the generators x_i.  x in X proves that no rate is above
the least b with A x + b x in X, which is the largest -(h'A x) / (h'x) over the facets h.  Both are rounded to doubles,
to the side that is proven.
"""

from __future__ import annotations

from fractions import Fraction
from math import prod
from typing import TypeAlias

import numpy as np

from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition, all_hold
from ..exact.matrix import Matrix, nearest_double
from ..exact.signs import BilinearForms
from ..exact.sparse_integers import SparseIntegers
from .generator_coordinates import sparse_integers

Rate: TypeAlias = float | Fraction
SLOW, SLOW_IN = "h'A x + bound h'x >= 0", "h'x >= 0 (slow direction)"
_SMALL = 64
# Entries of the generators up to which all quotients take less time in integers than one sign in doubles and integers.
_AT_ONCE = 1000
# Relative reductions tried until a decay rate is proven.
_BACKOFF = (0.0, 2.0**-50, 2.0**-44, 1e-11, 1e-9, 1e-6, 1e-3, 0.5)


def drift_forms(v: Matrix, A: Matrix, rays: Matrix, discrete: bool, rate: Rate = 0.0) -> BilinearForms:
    """v'A x_i + rate v'x_i, with A - I for A in discrete time."""
    if not np.isfinite(float(rate)):
        raise DataError(f"a rate of {rate} proves nothing; it must be finite.")
    if not discrete and not rate:
        return BilinearForms(v, A, rays)
    rows, blocks, eye = [v], [A], Matrix.identity(A.shape[0], sparse=A.is_sparse)
    if discrete:
        rows, blocks = [*rows, v], [*blocks, -eye]
    if rate:
        row, block = at_rate(v, rate, eye)
        rows, blocks = [*rows, row], [*blocks, block]
    return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), rays)


def at_rate(v: Matrix, rate: Rate, eye: Matrix) -> tuple[Matrix, Matrix]:
    """rate v' as a product of two matrices, in doubles if the rate is one."""
    if rate == 1:
        return v, eye
    if rate == float(rate):
        return v, Matrix(eye.values * float(rate))
    return Matrix.from_fractions(v.fractions() * rate), eye


def transposed_drift(x: Matrix, A: Matrix, X: Cone, discrete: bool, rate: Rate = 0.0) -> BilinearForms:
    """h'A x + rate h'x for the facets h, with A - I for A in discrete time."""
    return drift_forms(x, A.T, X.exact_facets, discrete, rate)


def proven_rate(v: Matrix, A: Matrix, rays: Matrix, discrete: bool) -> float:
    """The largest decay rate in floating point that v proves, min_i -(v'A x_i) / (v'x_i) rounded down."""
    with np.errstate(all="ignore"):
        drift, value = drift_forms(v, A, rays, discrete).values, BilinearForms(v, None, rays).values
        quotient = float(np.min(-drift / value))
    is_positive = bool(np.isfinite(quotient) and quotient > 0)
    at_once = is_positive and _is_small(A, rays)
    if is_positive and not at_once:
        for step in _BACKOFF:
            rate = quotient * (1 - step)
            # on large problems rate is rounded down until floating point proves it
            signs = drift_forms(v, A, rays, discrete, rate).signs(integers=A.shape[0] <= _SMALL)
            if np.isin(signs, (-1, 0)).all():
                return rate
    if v.is_double and not at_once:
        return 0.0
    least = min(_quotients(v, A, rays, discrete), default=Fraction(0))
    return max(0.0, _rounded(least, up=False))


def slow_conditions(A: Matrix, X: Cone, discrete: bool, row: Matrix, bound: float) -> list[Condition]:
    """x != 0, x in X and A x + bound x in X, on the facets of X."""
    return [
        Condition("slow direction is not 0", BilinearForms(row, None, row), ">"),
        Condition(SLOW_IN, BilinearForms(row, None, X.exact_facets), ">="),
        Condition(SLOW, transposed_drift(row, A, X, discrete, bound), ">="),
    ]


def proven_bound(A: Matrix, X: Cone, discrete: bool, row: Matrix) -> float | None:
    """The smallest bound on decay rates that x proves, rounded up; None if x proves nothing."""
    with np.errstate(all="ignore"):
        inside = BilinearForms(row, None, X.exact_facets).values
        drift = transposed_drift(row, A, X, discrete).values
        quotient = float(np.max(np.where(inside > 0, -drift / inside, -np.inf)))
    proposed = [quotient + step * abs(quotient) for step in _BACKOFF] if np.isfinite(quotient) else []
    if not row.is_double:
        largest = max(_quotients(row, A.T, X.exact_facets, discrete), default=None)
        proposed += [] if largest is None else [_rounded(largest, up=True)]
    for bound in proposed:
        if all_hold(slow_conditions(A, X, discrete, row, bound)):
            return bound
    return None


def _is_small(A: Matrix, points: Matrix) -> bool:
    return not A.is_sparse and prod(points.shape) <= _AT_ONCE


def _quotients(row: Matrix, A: Matrix, points: Matrix, discrete: bool) -> list[Fraction]:
    """-(v'A x_i) / (v'x_i) without rounding, where v'x_i > 0: also where doubles overflow or vanish."""
    v, every = row.rows_as_integers(np.arange(1))[0], np.arange(points.shape[0])
    if _is_small(A, points):
        (N, factor), P = A.as_integers(), points.dense().rows_as_integers(every)
        value, moved = P @ v, P @ (v @ N)
    else:
        (S, factor), P = sparse_integers(A), SparseIntegers.dense(points.plain().rows_as_integers(every))
        value, moved = P.apply(v), P.apply(S.T.apply(v))
    factor = Fraction(factor)
    return [discrete - factor * Fraction(a, b) for a, b in zip(moved.tolist(), value.tolist(), strict=True) if b > 0]


def _rounded(x: Fraction, *, up: bool) -> float:
    nearest = nearest_double(x)
    beyond = nearest < x if up else nearest > x
    return float(np.nextafter(nearest, np.inf if up else -np.inf)) if beyond else nearest
