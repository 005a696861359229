"""The numbers of an interval observer: constant inputs of its copies, final widths, and bounds on entries.

Everything here is a proposal in floating point, moved into X until the inequalities hold exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..design.bounded.covers import covered
from ..design.plant import Floats
from ..exact.linalg import Rationals
from ..exact.matrix import Matrix
from ..exact.program import Block, Program
from ..proof.certificate import exactly
from ..proof.portable_cones import portable_rows
from ..systems.system import System
from ..theorems.positivity import state_positivity
from ..theorems.stability import lyapunov_on
from .certificate import ErrorEquation, IntervalObserverCertificate

# How far proposals are moved into the cone, relative to their size, tried in turn.
INWARDS = (0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5)
# A bound that every width keeps: the least is wanted, whatever it is.
ANY = 1e300


def proven_observer(
    system: System, X: Cone, box: tuple[Matrix, Matrix, Matrix], gains: tuple[Floats, Floats]
) -> IntervalObserverCertificate | None:
    """The certificate for these gains L and N, or None.

    Parameters
    ----------
    system : System
        A and C of the plant.
    X : Cone
    box : tuple of Matrix, shapes (n,), (n,), (q,)
        w_lo, w_hi and the bounds on noise.
    gains : tuple of ndarray, shape (n, q)
        L and N.
    """
    try:
        return _proven(system, X, box, gains)
    except OverflowError:
        return None  # beyond all doubles


def _proven(
    system: System, X: Cone, box: tuple[Matrix, Matrix, Matrix], gains: tuple[Floats, Floats]
) -> IntervalObserverCertificate | None:
    L, N = (Matrix(np.ascontiguousarray(M, dtype=float)) for M in gains)
    equation = ErrorEquation.of(system.A, system.C, L, N)
    loop = lyapunov_on(state_positivity(Matrix.from_fractions(equation.F), X, discrete=system.discrete))
    if not loop:
        return None
    most, least = equation.pushed(X, *(part.fractions() for part in box))
    upper = least_above(X, most)
    lower = None if upper is None else least_above(X, -least)
    spread = None if upper is None or lower is None else _spread(X, loop.A, system.discrete, upper + lower)
    covers = None if spread is None else _covers(X, spread)
    if upper is None or lower is None or spread is None or covers is None:
        return None
    data: dict[str, Any] = dict(zip(("w_lo", "w_hi", "noise"), box, strict=True))
    data |= {"plant": system.A, "output": system.C, "gain": L, "shift": N, "positivity": loop.positivity}
    data |= {"upper": Matrix.from_fractions(upper), "lower": Matrix.from_fractions(-lower), "v": exactly(loop, "v")}
    data |= {"spread": Matrix.from_fractions(spread), "covers": covers}
    width = IntervalObserverCertificate(**data, width=Matrix(np.zeros(X.dim))).final_width()
    rounded = Matrix(Matrix.from_fractions(width).rounded(up=True))
    return IntervalObserverCertificate.settle(**data, width=rounded) or None


def least_above(X: Cone, needed: Rationals) -> Rationals | None:
    """A small vector d with h'd >= needed for every facet h of X, in doubles; None where none was proven.

    Parameters
    ----------
    X : Cone
    needed : ndarray of Fraction, shape (r,)
        For the rows of `portable_rows(X.exact_facets)`.
    """
    if not needed.any():
        return np.array([0 * needed[0]] * X.dim, dtype=object)
    exact = portable_rows(X.exact_facets)
    H, numbers = np.array(exact, dtype=float), np.array(needed, dtype=float)
    if X.is_simplicial:
        guess = np.linalg.solve(H, numbers)
    else:
        program = Program(d=Block(X.dim, cost=H.sum(axis=0)))
        program.above(numbers, d=H)
        answer = program.solve()
        if not answer:
            return None
        guess = np.asarray(answer["d"], dtype=float)
    return _moved(X, guess, lambda d: bool((exact @ d >= needed).all()))


def _moved(X: Cone, guess: Floats, holds: Any) -> Rationals | None:
    """The guess, moved along the interior of X as little as makes it right."""
    inside = np.asarray(X.interior_point, dtype=float)
    size = float(np.abs(guess).max()) / float(np.abs(inside).max())
    for part in INWARDS:
        candidate = guess + part * size * inside
        if not np.isfinite(candidate).all():
            return None
        d = Matrix(candidate).fractions()
        if holds(d):
            return d
    return None


def _spread(X: Cone, F: Matrix, discrete: bool, width: Rationals) -> Rationals | None:
    """A small x with F x + width in -X (F - I for F in discrete time)."""
    if not width.any():
        return width
    M, H = F.plain().fractions(), portable_rows(X.exact_facets)
    if discrete:
        M = M - np.eye(X.dim, dtype=int).astype(object)
    rounded, inside = np.array(M, dtype=float), np.asarray(X.interior_point, dtype=float)
    push = np.array(width, dtype=float)
    guess, more = -np.linalg.solve(rounded, np.stack([push, inside * np.abs(push).max()], axis=1)).T
    for part in INWARDS:
        if not np.isfinite(guess + part * more).all():
            return None
        x = Matrix(guess + part * more).fractions()
        if (H @ (M @ x + width) <= 0).all():
            return x
    return None


def _covers(X: Cone, spread: Rationals) -> Matrix | None:
    """Rows a_i with a_i and a_i - e_i in X* and a_i'spread small."""
    limits = Matrix(np.full(X.dim, ANY))
    found = [g for g, _ in covered(X, Matrix.identity(X.dim), limits, Matrix.from_fractions(spread))]
    rows = [g for g in found if g is not None]
    return Matrix.join(rows, -2) if len(rows) == X.dim else None


def entry_rows(certificate: IntervalObserverCertificate) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """a_i and a_i - e_i, in doubles."""
    a = np.asarray(certificate.covers.dense().values, dtype=float)
    return a, a - np.eye(len(a))
