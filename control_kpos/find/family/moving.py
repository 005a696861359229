"""A common cone with any number of rays, by moving all rays at once.

Sequential linear programs on A_s (X + D) = (X + D) P_s, to first order in the motion D of the rays:

    maximise t   subject to   A_s D - D P0_s - X P_s = -A_s X,   P_s >= t off the diagonal,
                              w'D = 0,   |D_ij| <= radius,

P0_s being the multipliers of the round before (after Kousoulidis and Forni, 2019).  Without w'D = 0 the
rays drift apart until they span the whole space, for which A R = R P is trivially solvable: w'x = 1 for
every ray is what keeps the cone pointed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import affords, spend
from ...exact.programs import solve

Array = NDArray[np.float64]

_ROUNDS = 40
# Of the program for all matrices: what fits into memory, and operations to build and solve each entry.
_MOST_ENTRIES = 5 * 10**7
_PER_ENTRY = 250.0


@dataclass(frozen=True, eq=False)
class Placement:
    """Rays with multipliers.

    Attributes
    ----------
    X : ndarray, shape (n, N)
    P : ndarray, shape (M, N, N)
    margin : float
    """

    X: Array
    P: Array
    margin: float


def moving_descent(
    matrices: Array,
    X: Array,
    w: Array,
    *,
    discrete: bool,
    goal: float = 1e-4,
) -> Placement | None:
    """Move rays of height w'x = 1 until all multipliers have the right signs, or no further."""
    X = X / (w @ X)
    place = _solve(matrices, X, None, w, 0.0, discrete)
    radius = 0.3
    for _ in range(_ROUNDS):
        if place is None or place.margin >= goal or radius < 1e-5 or not affords():
            break
        moved = _solve(matrices, place.X, place.P, w, radius, discrete)
        if moved is None:
            radius /= 3
            continue
        settled = _solve(matrices, moved.X, None, w, 0.0, discrete)
        if settled is not None and settled.margin > place.margin + 1e-9:
            place, radius = settled, min(1.0, 1.5 * radius)
        else:
            radius /= 3
    return place


def _solve(matrices: Array, X: Array, P0: Array | None, w: Array, radius: float, discrete: bool) -> Placement | None:
    """One program; without `P0` the rays stay where they are."""
    M, (n, N) = len(matrices), X.shape
    entries = M * N * n * (N if P0 is None else 2 * N + n)
    if entries > _MOST_ENTRIES:
        return None
    spend(_PER_ENTRY * entries)
    # Coordinates in which the rays are well spread.
    u, s, _ = np.linalg.svd(X, full_matrices=False)
    if not s[-1] > 1e-9 * s[0]:
        return None
    to, back = (u / s).T * np.sqrt(N), u * s / np.sqrt(N)
    Y, A = to @ X, to @ matrices @ back
    moving = n * N if P0 is not None else 0
    required = np.ones((N, N), dtype=bool) if discrete else ~np.eye(N, dtype=bool)
    eye, blocks, right = sp.eye_array(N), [], []
    for k in range(M):
        row: list[sp.sparray | None] = [None] * M
        row[k] = sp.kron(eye, Y)
        shift = sp.csr_array((Y @ required).T.reshape(-1, 1))
        if P0 is not None:
            motion = sp.kron(eye, A[k]) - sp.kron(P0[k].T, sp.eye_array(n))
            blocks.append([-motion, *row, shift])
        else:
            blocks.append([*row, shift])
        right.append((A[k] @ Y).T.ravel())
    if P0 is not None:
        blocks.append([sp.kron(eye, (w @ back)[None, :]), *([None] * M), None])
        right.append(np.zeros(N))
    count = moving + M * N * N + 1
    lower, upper = np.zeros(count), np.full(count, np.inf)
    lower[:moving], upper[:moving] = -radius, radius
    diagonal = np.where(required.T.ravel(), 0.0, -np.inf)
    lower[moving:-1] = np.tile(diagonal, M)
    lower[-1], upper[-1] = -1e3, 1.0
    cost = np.zeros(count)
    cost[-1] = -1.0
    answer = solve(
        cost,
        A_eq=sp.csr_array(sp.block_array(blocks)),
        b_eq=np.concatenate(right),
        bounds=(lower, upper),
    )
    if not answer:
        return None
    t = float(answer.x[-1])
    P = answer.x[moving:-1].reshape(M, N, N).transpose(0, 2, 1) + t * required
    if P0 is not None:
        D = answer.x[:moving].reshape(N, n).T
        X = back @ (Y + D)
        X = X / (w @ X)
    return Placement(X, P, t)
