"""The first steps of an orbit that has to leave a half-space's boundary, in exact arithmetic.

If c'b = c'A b = .. = c'A^(r-2) b = 0 < c'A^(r-1) b (relative degree r), every orbit from b starts on the
boundary c'x = 0, and so do its next points; rounded, they would leave the half-space.  They are kept exactly,

    g_(k+1) = (A + s_k I) g_k     so that     A g_k = g_(k+1) - s_k g_k     without any residual,

until c'A g_k > 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ...exact.matrix import Matrix


@dataclass(frozen=True, eq=False)
class FirstSteps:
    """Points on the boundary, known exactly.

    Attributes
    ----------
    points : Matrix, shape (k + 1, n)
        The first one is the vector itself.
    stays, moves : ndarray, shape (k,)
        A g_j = moves_j g_(j+1) + stays_j g_j, exactly.
    """

    points: Matrix
    stays: NDArray[np.float64]
    moves: NDArray[np.float64]


def steps_on_boundary(A: Matrix, vector: Matrix, normals: Matrix) -> int:
    """How many steps from a vector stay on the boundary of some half-space, in exact arithmetic."""
    M, x = A.as_integers()[0], vector.as_integers()[0][0]
    C = normals.rows_as_integers(np.arange(normals.shape[0]))
    still = np.ones(len(C), dtype=bool)
    for k in range(A.shape[0]):
        still &= C @ x == 0 if len(C) else still
        if not still.any():
            return max(k - 1, 0)
        x = M @ x
    return 0  # c'A^k b vanishes for all k: another half-space decides


def first_steps(A: Matrix, vector: Matrix, count: int, length: float, dominant: float, *, discrete: bool) -> FirstSteps:
    """`count` steps of length about `length` (which has no meaning in discrete time)."""
    M, g = A.fractions(), vector.fractions()[0]
    mantissa, exponent = np.frexp(0.0 if discrete else 1 / length - dominant)
    shift = Fraction(float(np.ldexp(np.round(mantissa * 256) / 256, exponent)))  # few digits: exact and short
    points, moves = [g], []
    for _ in range(count):
        moved = M @ points[-1] + shift * points[-1]
        size = float(np.abs(moved.astype(float)).max())
        scale = Fraction(2) ** int(np.frexp(size)[1])
        points.append(moved / scale)
        moves.append(float(scale))
    rows = Matrix.from_fractions(np.array(points, dtype=object))
    return FirstSteps(rows, np.full(count, -float(shift)), np.array(moves))
