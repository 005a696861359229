"""Multipliers P with A R = R P for given generators, as far inside the allowed signs as possible.

One linear program for each generator x_j:

    maximise t   subject to   R p = A x_j,   p_i >= t s_i   (i != j in continuous time),

in coordinates where the generators are well spread.  A strictly positive t survives rounding; where
t = 0 the structure of A asks for exact zeros, and exact rational arithmetic takes over.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ..errors import TooLargeError
from ..exact.budget import spend
from ..exact.matrix import Matrix
from ..exact.programs import program_effort, solve
from ..exact.rational_programs import exact_feasibility

Array = NDArray[np.float64]

# Below this a margin may be rounding of the solver.
_STRICT = 1e-9
# Rational columns above this dimension take seconds each.
_EXACT_DIMENSION = 40


@dataclass(frozen=True, eq=False)
class Frame:
    """Generators in coordinates where they have heights w'x = 1 and are well spread.

    Attributes
    ----------
    R : ndarray, shape (n, N)
        Generators of height 1.
    heights : ndarray, shape (N,)
        w'x of the original generators.
    to, back : ndarray, shape (n, n)
        R = to @ original / heights.
    """

    R: Array
    heights: Array
    to: Array
    back: Array

    @classmethod
    def of(cls, rays: Array, pointing: Array) -> Frame | None:
        """None if some generator has no positive height, or the generators span too little."""
        heights = rays @ pointing
        if not (heights > 0).all():
            return None
        R = (rays / heights[:, None]).T
        u, s, _ = np.linalg.svd(R, full_matrices=False)
        if len(s) < len(R) or not s[-1] > 1e-14 * s[0]:
            return None
        to = (u / s).T
        spread = to @ R
        # What should be zero is, or a solver would scale rounding errors up.
        return cls(np.where(np.abs(spread) < 1e-14, 0.0, spread), heights, to, u * s)


def pointing_functional(rays: Array) -> Array:
    """w with w'x well above 0 for every generator of length 1, by a linear program."""
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    n = rays.shape[1]
    answer = solve(
        np.append(np.zeros(n), -1.0),
        A_ub=np.column_stack([-unit, np.ones(len(unit))]),
        b_ub=np.zeros(len(unit)),
        bounds=(np.full(n + 1, -1.0), np.full(n + 1, 1.0)),
    )
    return answer.x[:-1] if answer else np.zeros(n)


def nonnegative_combination(
    frame: Frame, target: Array, free: int | None = None, *, size: float
) -> tuple[Array, float]:
    """Coefficients p with R p = target and the largest t with p_i >= t; `free` is left out.

    `size` is what t is measured against; a target far below it is rounding.

    Returns
    -------
    p : ndarray, shape (N,)
        In units of the frame's generators (of height 1).
    t : float
        -inf if no combination was found.
    """
    N = frame.R.shape[1]
    unit = np.ones(N)
    lower = np.zeros(N + 1)
    if free is not None:
        unit[free], lower[free] = 0.0, -np.inf
    lower[N] = -np.inf
    # p = z + t unit with z >= 0 keeps the program small: n rows only.
    matrix = np.column_stack([frame.R, frame.R @ unit])
    upper = np.full(N + 1, np.inf)
    upper[N] = 10.0
    cost = np.zeros(N + 1)
    cost[N] = -1.0
    answer = solve(cost, A_eq=matrix, b_eq=target / size, bounds=(lower, upper))
    if not answer:
        return np.zeros(N), -np.inf
    p = answer.x[:N] + answer.x[N] * unit
    with suppress(np.linalg.LinAlgError):  # no convergence: the point stays as the solver gave it
        p = p + np.linalg.lstsq(frame.R, target / size - frame.R @ p, rcond=None)[0]
    rest = np.delete(p, free) if free is not None else p
    return p * size, float(rest.min(initial=np.inf))


def multipliers(
    A: Matrix,
    rays: Matrix,
    pointing: Array,
    *,
    discrete: bool = False,
) -> Matrix | None:
    """P with A R = R P and the signs that invariance asks for; None if there is none.

    Parameters
    ----------
    A : Matrix, shape (n, n)
    rays : Matrix, shape (N, n)
    pointing : ndarray, shape (n,)
        Positive on every generator.

    Returns
    -------
    Matrix, shape (N, N), or None

    Notes
    -----
    N linear programs of n rows, a millisecond or two each.
    """
    frame = Frame.of(np.asarray(rays.values), pointing)
    if frame is None:
        return None
    images = frame.to @ A.values @ frame.back @ frame.R
    size = float(np.abs(images).max()) or 1.0
    columns: list[NDArray] = []
    for j in range(rays.shape[0]):
        spend(program_effort(*frame.R.shape))
        p, t = nonnegative_combination(frame, images[:, j], None if discrete else j, size=size)
        column: NDArray | None
        if t > _STRICT:
            column = p * frame.heights[j] / frame.heights
        else:
            image = (A.fractions() * _exact_row(rays, j)[None, :]).sum(axis=1)
            column = _exact_column(rays, image, None if discrete else j)
        if column is None:
            return None
        columns.append(column)
    stacked = _stack(columns)
    values = np.asarray(stacked.values)
    numerators = None if stacked.numerators is None else stacked.numerators.T
    return Matrix(values.T, None if stacked.radius is None else stacked.radius.T, numerators, stacked.denominator)


def _exact_row(m: Matrix, j: int) -> NDArray:
    if m.numerators is not None:
        return np.array([Fraction(x, m.denominator) for x in m.numerators[j]], dtype=object)
    return np.array([Fraction(x) for x in m.values[j].tolist()], dtype=object)


def _exact_column(rays: Matrix, target: NDArray, free: int | None) -> NDArray | None:
    """An exact combination, by rational arithmetic."""
    if rays.shape[1] > _EXACT_DIMENSION:
        return None
    R = rays.fractions().T
    if free is not None:
        R = np.concatenate([R, -R[:, [free]]], axis=1)
    try:
        x, _ = exact_feasibility(Matrix.from_fractions(R), Matrix.from_fractions(target))
    except TooLargeError:
        return None
    if x is None or free is None:
        return x
    out = x[:-1].copy()
    out[free] = out[free] - x[-1]
    return out


def _stack(columns: list[NDArray]) -> Matrix:
    if all(c.dtype != object for c in columns):
        return Matrix(np.array(columns))
    return Matrix.from_fractions(np.array([[Fraction(x) for x in c] for c in columns], dtype=object))
