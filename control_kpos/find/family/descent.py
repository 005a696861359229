"""Rays, or rays and a gain, moved by linear programs until every matrix keeps their cone.

A cone with generators R (columns) is invariant under A_s if A_s R = R P_s with P_s >= 0 off the diagonal (discrete
time: everywhere).  To first order in a small motion this is linear, and a linear program finds the motion that makes
the smallest such entry t as large as possible (after Kousoulidis and Forni, 2019).  `descend` follows such motions in
a trust region; there are two linearisations.

n rays.  P_s = R^-1 A_s R, and R (I + E) changes it by P_s E - E P_s.  R stays invertible, so the cone stays pointed
and solid; 1'E = 0 keeps the rays in a hyperplane.  With inputs B_s and a gain F for all of them, P_s is
R^-1 (A_s + B_s F) R, and F + G changes it by R^-1 B_s G R as well.  Then P_s 1 < 0 (discrete time: < 1) is asked for
too: the sum of the rays, which is inside the cone, moves inwards along every A_s + B_s F, a common certificate of
stability.

Any number of rays.  A_s (R + D) = (R + D) P_s becomes A_s D - D P0_s - R P_s = -A_s R, P0_s being the multipliers of
the round before.  Without w'D = 0 the rays drift apart until they span the whole space, for which A R = R P is
trivially solvable: w'x = 1 for every ray is what keeps the cone pointed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import expm

from ...exact.budget import affords, spend
from ...exact.program import Block, Program
from ...exact.programs import program_effort

Array = NDArray[np.float64]

_ROUNDS = 60
# Entries of the rows of a program: what fits into memory, and operations to set up, scale and solve each, sparse and
# dense.
_MOST_ENTRIES, _PER_ENTRY, _PER_DENSE_ENTRY = 5 * 10**7, 250.0, 50.0


@dataclass(frozen=True, eq=False)
class Place:
    """Where the rays are.

    Attributes
    ----------
    R : ndarray, shape (n, N)
        Generators, one a column.
    P : ndarray, shape (M, N, N)
        Multipliers.
    margin : float
        The smallest number that should be positive.
    F : ndarray, shape (m, n)
        Gain of u = F x, without rows if there is none.
    """

    R: Array
    P: Array
    margin: float
    F: Array


def descend(place: Place, step: Callable[[Place, float], Place | None], goal: float = 1e-3) -> Place:
    """Follow the steps while they raise the margin, up to `goal`; `step` proposes one within a radius."""
    radius = 0.3
    for _ in range(_ROUNDS):
        if place.margin >= goal or radius < 1e-5 or not affords():
            break
        moved = step(place, radius)
        if moved is None or not moved.margin > place.margin + 1e-9:
            radius /= 3
            continue
        if moved.margin > place.margin + 0.1 * abs(place.margin):
            radius = min(1.0, 1.7 * radius)
        place = moved
    return place


def required_entries(n: int, discrete: bool) -> NDArray[np.bool_]:
    """Entries of P that must be nonnegative."""
    return np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool)


def simplicial_descent(
    matrices: Array, R: Array, *, discrete: bool, inputs: Array | None = None, F: Array | None = None
) -> Place:
    """Move n rays, and a gain if there are inputs, until every P_s has the right signs, or no further.

    Parameters
    ----------
    matrices : ndarray, shape (M, n, n)
    R : ndarray, shape (n, n)
    inputs : ndarray, shape (M, n, m), optional
    F : ndarray, shape (m, n), optional
    """
    count, n = matrices.shape[:2]
    B, gain = (np.zeros((count, n, 0)), np.zeros((0, n))) if inputs is None or F is None else (inputs, F)
    stable = inputs is not None

    def settled(R: Array, F: Array) -> Place:
        P = np.asarray(np.linalg.solve(R, (matrices + B @ F) @ R), dtype=np.float64)
        margin = float(_demands(P, discrete, stable).min(initial=np.inf))
        return Place(R, P, margin / (float(np.abs(P).max()) or 1.0) if stable and not discrete else margin, F)

    def step(place: Place, radius: float) -> Place | None:
        reach = np.asarray(np.linalg.solve(place.R, B), dtype=np.float64)
        motion = _motion(place, reach, radius, discrete, stable)
        if motion is None:
            return None
        moved = place.R @ expm(motion[: n * n].reshape(n, n))  # invertible, whatever the step
        unit = moved / np.linalg.norm(moved, axis=0)
        if not np.isfinite(moved).all() or not np.linalg.cond(unit) < 1e6:
            return None
        return settled(moved if stable else unit, place.F + motion[n * n :].reshape(place.F.shape))

    return descend(settled(R, gain), step)


def _demands(P: Array, discrete: bool, stable: bool) -> Array:
    """What has to be positive: entries of P, and what is lacking in the sums of its rows if `stable`."""
    entries = P[:, required_entries(P.shape[1], discrete)].ravel()
    return np.concatenate([entries, (discrete - P.sum(axis=2)).ravel()]) if stable else entries


def _motion(place: Place, reach: Array, radius: float, discrete: bool, stable: bool) -> Array | None:
    """E and G of one program, row by row; `reach` is R^-1 B_s."""
    P, R, (count, n, m) = place.P, place.R, reach.shape
    entries = count * n * n * (n + m) * n
    if entries > _MOST_ENTRIES:
        return None
    spend(_PER_DENSE_ENTRY * entries)
    eye, required = np.eye(n), required_entries(n, discrete)
    # Row (s, i, j), column (a, b): d(P E - E P)_ij / dE_ab = P_ia [j = b] - [i = a] P_bj; the same for R^-1 B G R.
    changes = np.einsum("sia,jb->sijab", P, eye) - np.einsum("ia,sbj->sijab", eye, P)
    gained = np.einsum("sia,bj->sijab", reach, R)
    changes = np.concatenate([x.reshape(count, n, n, x.shape[3] * n) for x in (changes, gained)], axis=3)
    pushed = float(np.abs(reach).max(initial=0.0) * np.abs(R).max())
    size = min(float(np.abs(P).max()) / max(pushed, 1e-300), 1e100)
    most = radius * np.repeat([1.0, size], [n * n, m * n])
    demands, values = changes[:, required].reshape(-1, len(most)), _demands(P, discrete, stable)
    if stable:
        demands = np.concatenate([demands, -changes.sum(axis=2).reshape(-1, len(most))])
    # What is safe whatever the step does within the radius needs no row.
    near = values - np.abs(demands) @ most < max(1.0, float(np.abs(values).max(initial=0.0))) * 0.05
    spend(program_effort(int(near.sum()), len(most)))
    program = Program(motion=Block(len(most), -most, most), margin=Block(1, -1e3, 10.0, -1.0))
    program.above(-values[near], np.ones(near.sum()), motion=demands[near])
    if not stable:
        program.equal(0.0, motion=np.kron(np.ones((1, n)), eye))
    answer = program.solve()
    return answer["motion"] if answer else None


def moving_descent(matrices: Array, R: Array, w: Array, *, discrete: bool) -> Place | None:
    """Move any number of rays of height w'x = 1 until all multipliers have the right signs, or no further."""

    def step(place: Place, radius: float) -> Place | None:
        moved = _program(matrices, place.R, w, discrete, place.P, radius)
        return None if moved is None else _program(matrices, moved.R, w, discrete)

    start = _program(matrices, R / (w @ R), w, discrete)
    return None if start is None else descend(start, step, goal=1e-4)


def _program(
    matrices: Array, R: Array, w: Array, discrete: bool, P0: Array | None = None, radius: float = 0.0
) -> Place | None:
    """The best multipliers; with `P0` the rays move as well."""
    M, (n, N) = len(matrices), R.shape
    entries = M * N * n * (N if P0 is None else 2 * N + n)
    if entries > _MOST_ENTRIES:
        return None
    spend(_PER_ENTRY * entries)
    # Coordinates in which the rays are well spread.
    u, s, _ = np.linalg.svd(R, full_matrices=False)
    if not s[-1] > 1e-9 * s[0]:
        return None
    to, back = (u / s).T * np.sqrt(N), u * s / np.sqrt(N)
    Y, A = to @ R, to @ matrices @ back
    required = required_entries(N, discrete)
    low = np.tile(np.where(required.T.ravel(), 0.0, -np.inf), M)
    program = Program(P=Block(M * N * N, low), margin=Block(1, -1e3, 1.0, -1.0))
    images = sp.block_diag([sp.kron(sp.eye_array(N), Y)] * M)
    parts = {"P": images, "margin": np.tile((Y @ required).T.ravel(), M)}
    if P0 is not None:
        program.add(D=Block(n * N, -radius, radius))
        motions = [sp.kron(P0[k].T, sp.eye_array(n)) - sp.kron(sp.eye_array(N), A[k]) for k in range(M)]
        parts["D"] = sp.vstack(motions)
        program.equal(0.0, D=sp.kron(sp.eye_array(N), (w @ back)[None, :]))
    program.equal(np.concatenate([(A[k] @ Y).T.ravel() for k in range(M)]), **parts)
    answer = program.solve()
    if not answer:
        return None
    t = float(answer["margin"][0])
    P = answer["P"].reshape(M, N, N).transpose(0, 2, 1) + t * required
    if P0 is not None:
        R = back @ (Y + answer["D"].reshape(N, n).T)
        R = R / (w @ R)
    return Place(R, P, t, np.zeros((0, n)))
