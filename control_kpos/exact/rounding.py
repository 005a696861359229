"""How far a computed sum of products is from the exact one: the only rounding analysis of this package.

Let s = sum_i x_i1 x_i2 ... be computed in IEEE double arithmetic, rounding to nearest, so that every term passes
through at most k roundings on its way into the result, in whatever order and with or without fused operations, and let
S = sum_i |x_i1 x_i2 ...| be computed likewise.  If nothing overflows,

    |computed s - s| <= error_factor(k) * computed S + underflow(operations).

A dot product of n numbers has k = n, in any order of summation; a product of two matrices and a vector adds up its two
inner dimensions.  The proof, and what is assumed of the machine, is in docs/rounding.md; Higham, Accuracy and Stability
of Numerical Algorithms, sections 2.2 and 3.1, has the classical form.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
from numpy.typing import NDArray

HALF_ULP = 2.0**-53
SMALLEST_NORMAL = 2.0**-1022
# For sums in which an error bound is one of the factors.
RADIUS_FACTOR = 1.01
# What `sum_factor` is at the least; enough for four million terms.
SUM_FACTOR = 1 + 2.0**-29


def double_below(x: float | Fraction) -> float:
    """The largest double that is not above x.

    >>> double_below(Fraction(1, 10)) < Fraction(1, 10) == Fraction("0.1"), double_below(0.1)
    (True, 0.1)
    """
    nearest = float(x)
    return nearest if nearest <= x else float(np.nextafter(nearest, -np.inf))


def error_factor(roundings: int) -> float:
    """The g of |computed s - s| <= g * computed S; inf where the lemma does not apply.

    Parameters
    ----------
    roundings : int
        Of each term on its way into s.

    Notes
    -----
    At least twice gamma_k = k eps / (1 - k eps), eps = 2^-53: the other half and the constant leave room for the
    rounding of S, of the bound itself and of sums of such bounds.
    """
    count = (2 * roundings + 16) * HALF_ULP
    return count / (1 - count) if count < 0.5 else np.inf


def underflow(terms: int) -> float:
    """What products that underflow add to the error of a sum of so many terms, and to that of its bound."""
    return 4 * SMALLEST_NORMAL * (terms + 1)


def sum_constants(roundings: int, terms: int) -> tuple[float, float]:
    """Factor and underflow for a sum of so many terms, each through so many roundings."""
    return error_factor(roundings), underflow(terms)


@cache
def chain_constants(inner: int, outer: int) -> tuple[float, float, float]:
    """For (l'M) r: the factor, and what underflows in l'M, before r multiplies it, and in the product with r.

    Parameters
    ----------
    inner, outer : int
        Entries of l (0 without M) and of r.
    """
    return error_factor(inner + outer), underflow(inner), underflow(outer)


def sum_factor(terms: int) -> float:
    """A computed sum of so many nonnegative numbers, times this, is no smaller than the exact sum."""
    return max(SUM_FACTOR, 1 + error_factor(terms))


@np.errstate(all="ignore")
def rounding_radius(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bound on the rounding error of correctly rounded doubles."""
    return np.abs(values) * (2 * HALF_ULP) + 2.0**-1074
