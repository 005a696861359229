"""A system in coordinates in which what its inputs reach and what its outputs see are spread alike.

A positive realization is a cone between the states that inputs reach and those with nonnegative outputs.  With
F = A (continuous time: e^(A t) for a short t), both scaled to the dominant eigenvalue, the singular values of the
Hankel matrix [C F^i][F^j B] give coordinates in which neither is thin (Moore, 1981: a balanced realization).  The new
coordinates are doubles, taken exactly: matrices in them are exact, and rounded once.

w' = 1'C (s I - A)^-1, with s beyond the dominant eigenvalue, is positive on every cone of states with nonnegative
outputs that A keeps, but for 0: heights are measured by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.linalg import Rationals, product, solve_columns
from ...exact.matrix import Matrix
from .minimal import Realization

Array = NDArray[np.float64]

# Where heights are measured and the time of a step, relative to the dominant eigenvalue or the distance of the furthest
# one.
_BEYOND, _STEP = 1.0, 0.4
# Singular values are not taken for less than this part of the largest one.
_THIN = 1e-13


@dataclass(frozen=True, eq=False)
class Spread:
    """A system in other coordinates, scaled to the dominant eigenvalue 1 (continuous time: 0).

    Attributes
    ----------
    exact : tuple of Rationals
        A, B and C in the new coordinates, without inputs and outputs that have no effect.
    T : Rationals, shape (n, n)
        x = T z.
    A, B, C : ndarray
        In floating point and scaled; columns of B have the height 1, and C is 1 in the middle.
    top, size : float
        The unscaled matrix is size A, in continuous time top I + size A.
    w : ndarray, shape (n,)
        Heights.
    states : ndarray, shape (n, k)
        Some that inputs lead to, of height 1.
    discrete : bool
    """

    exact: tuple[Rationals, Rationals, Rationals]
    T: Rationals
    A: Array
    B: Array
    C: Array
    top: float
    size: float
    w: Array
    states: Array
    discrete: bool
    thinness: float


def spread(s: Realization, *, discrete: bool) -> Spread | None:
    """The coordinates of a minimal system; None where eigenvalues, heights or middles are not what cones need."""
    T = None
    exact = s.A, s.B[:, s.B.any(axis=0)], s.C[s.C.any(axis=1)]
    thinness = 1.0
    for _ in range(2):  # the second time without most of the rounding errors of the first
        balanced = _balancing(*map(_rounded, exact), discrete=discrete)
        if balanced is None:
            return None
        new, thinness = balanced
        step = Matrix(new).fractions()
        T = step if T is None else product(T, step)
        turned = solve_columns(step, np.concatenate([product(exact[0], step), exact[1]], axis=1))
        if turned is None:
            return None
        n = len(step)
        exact = turned[:, :n], turned[:, n:], product(exact[2], step)
    return None if T is None else _scaled(exact, T, discrete, thinness)


def _rounded(M: Rationals) -> Array:
    return np.asarray(Matrix.from_fractions(M).values, dtype=np.float64)


def _unit(A: Array, discrete: bool) -> tuple[float, float]:
    """The dominant eigenvalue, and the size of the others relative to it."""
    values = np.linalg.eigvals(A)
    if discrete:
        top = float(np.abs(values).max())
        return top, top or 1.0
    top = float(values.real.max())
    return top, float(np.abs(values - top).max()) or 1.0


def _unit_columns(M: Array) -> Array:
    """Columns of length 1, of numbers of any size."""
    M = M / np.abs(M).max(axis=0)
    return M / np.linalg.norm(M, axis=0)


def _relative(A: Array, top: float, size: float, discrete: bool) -> Array:
    return A / size if discrete else (A - top * np.eye(len(A))) / size


def _balancing(A: Array, B: Array, C: Array, *, discrete: bool) -> tuple[Array, float] | None:
    M = _relative(A, *_unit(A, discrete), discrete)
    F = M if discrete else np.asarray(sl.expm(_STEP * M), dtype=np.float64)
    reached, seen = [_unit_columns(B)], [_unit_columns(C.T).T]
    for _ in range(2 * len(A)):
        reached.append(F @ reached[-1])
        seen.append(seen[-1] @ F)
    states = np.hstack(reached)
    if not (np.isfinite(states).all() and np.isfinite(np.vstack(seen)).all()):
        return None
    _, values, right = np.linalg.svd(np.vstack(seen) @ states)
    values, right = values[: len(A)], right[: len(A)].T
    if len(values) < len(A) or not values[0] > 0:
        return None
    T = states @ right / np.sqrt(np.maximum(values, _THIN * values[0]))
    return T, float(values[-1] / values[0])


def _scaled(
    exact: tuple[Rationals, Rationals, Rationals], T: Rationals, discrete: bool, thinness: float
) -> Spread | None:
    A, B, C = map(_rounded, exact)
    top, size = _unit(A, discrete)
    A = _relative(A, top, size, discrete)
    resolvent = np.linalg.inv((_BEYOND + discrete) * np.eye(len(A)) - A)
    C = _unit_columns(C.T).T
    w = np.asarray(C.sum(axis=0) @ resolvent, dtype=np.float64)
    heights = w @ B
    if not (heights > 0).all():
        return None
    B = B / heights
    middle = resolvent @ B.sum(axis=1)
    middle /= w @ middle
    if not (C @ middle > 0).all():
        return None
    F = A if discrete else np.asarray(sl.expm(_STEP * A), dtype=np.float64)
    states = [B]
    for _ in range(4 * len(A)):
        states.append(F @ states[-1])
    orbit = np.hstack(states)
    high = w @ orbit
    orbit = orbit[:, high > 1e-6 * high.max()]
    return Spread(exact, T, A, B, C / (C @ middle)[:, None], top, size, w, orbit / (w @ orbit), discrete, thinness)
