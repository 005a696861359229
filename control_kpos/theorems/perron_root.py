"""The Perron root of an irreducible Metzler matrix in floating point: two-sided inverse iteration.

Nothing here is trusted; what is proven with it is checked in integers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from ..exact.matrix import Integers
from ..exact.sparse_integers import Floats, SparseIntegers
from .refinement import Factors, Frame, balancing_units

_SHIFTS = 60


def root(N: SparseIntegers, e: Integers, relative: float) -> float:
    """The largest mu at which N - mu diag(e) is singular, for an irreducible part; NaN if it was not found."""
    if N.height == 1:
        return float(Fraction(int(N.data.sum())) / int(e[0]))
    frame, found = Frame(N, balancing_units(N)), float("nan")
    for at in approach(frame.F, frame.relative(e)):
        found = min(max(at.theta, at.lower), at.upper)
        if at.upper - at.lower <= 0.1 * relative * abs(found):
            break
    return found


@dataclass(frozen=True)
class Approach:
    """Positive x and y with their quotient theta, about the root, and the bounds lower <= root <= upper they give."""

    shift: float
    x: Floats
    y: Floats
    theta: float
    lower: float
    upper: float


def approach(F: sp.csr_array, e: Floats, start: float | None = None) -> Iterator[Approach]:
    """Bounds of the largest mu at which F - mu diag(e) is singular, for an irreducible Metzler F and e >= 0.

    Two-sided inverse iteration at shifts above the root, where solutions are positive: x_new = (mu E - F)^{-1} E x has
    F x_new = (mu - x / x_new) E x_new, so that the extreme quotients bound the root.  A shift below the root shows in
    a solution that is not positive.

    Parameters
    ----------
    F : csr_array, shape (n, n)
    e : ndarray, shape (n,)
        Rows in which e is zero (ports) hold equations without mu.
    start : float, optional
        First shift.  Default: the largest sum of a row over e.
    """
    own = e > 0
    x, y, low, high = np.ones(len(e)), np.ones(len(e)), -np.inf, np.inf
    E = sp.csr_array(sp.diags_array(e))
    size = float(np.max(abs(F).sum(axis=1)[own] / e[own]))
    mu = float(np.max(F.sum(axis=1)[own] / e[own])) + 1e-3 * size if start is None else start
    for _ in range(_SHIFTS):
        factors = Factors(sp.csc_array(F - mu * E))
        a, b = -factors.solve(e * x), -factors.solve(e * y, transposed=True)
        if not ((a > 0).all() and (b > 0).all() and np.isfinite(a).all() and np.isfinite(b).all()):
            low = max(low, mu)
            mu = 0.5 * (low + high) if np.isfinite(high) else mu + size
            size *= 4 if not np.isfinite(high) else 1
            if not (low < mu < high):
                return
            continue
        high = mu
        upper = mu - max(float((x[own] / a[own]).min()), float((y[own] / b[own]).min()))
        lower = mu - min(float((x[own] / a[own]).max()), float((y[own] / b[own]).max()))
        theta = mu - float(np.divide((b * e / b.max()) @ x, (b * e / b.max()) @ a))
        if not np.isfinite(theta):
            return
        x, y = a / a.max(), b / b.max()
        yield Approach(mu, x, y, theta, lower, upper)
        gap = high - theta
        mu = theta + max(0.1 * gap, 4e-16 * abs(theta))
        if mu <= low:
            mu = 0.5 * (low + high)
        if not (mu < high):
            return
