"""A simplicial cone and a gain for several plants, moved together.

With R = rays' invertible and P_s = R^-1 (A_s + B_s F) R, moving the rays and the gain, R (I + E) and F + G,
changes P_s to first order by

    P_s E - E P_s + R^-1 B_s G R,

so one linear program with n^2 + m n + 1 unknowns improves invariance and stability of all loops at once:

    maximise t   subject to   (P_s)_ij >= t (i != j),   P_s 1 <= -t,   |E_ij| <= radius,   |G_ij| <= size of F radius

(discrete time: P_s >= t, P_s 1 <= 1 - t).  P_s 1 < 0 says that the sum of the rays, which is inside the cone, moves
inwards along every A_s + B_s F: that is a common certificate of stability.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import expm

from ...exact.budget import affords, spend
from ...exact.programs import program_effort, solve
from ..family.commutator import required_entries

Array = NDArray[np.float64]

_ROUNDS = 80
# Operations to set up and scale a program, for each entry of its rows.
_PER_ENTRY = 200.0


def joint_descent(
    matrices: Array,
    inputs: Array,
    R: Array,
    F: Array,
    *,
    discrete: bool,
    goal: float = 1e-3,
) -> tuple[Array, Array, float]:
    """Move n rays and a gain until every loop is invariant and stable, or no further.

    Parameters
    ----------
    matrices, inputs : ndarray, shapes (M, n, n), (M, n, m)
    R : ndarray, shape (n, n)
        Generators to start from, one a column.
    F : ndarray, shape (m, n)
        Gain to start from, u = F x.
    goal : float
        Margin at which to stop.

    Returns
    -------
    R, F : ndarray
    margin : float
        t, relative to the largest entry of P in continuous time.
    """
    radius, effort = 0.3, _effort(*inputs.shape)
    P = _loops(matrices, inputs, R, F)
    margin = _margin(P, discrete)
    for _ in range(_ROUNDS):
        if margin >= goal or radius < 1e-4 or not affords(effort):
            break
        reach = np.asarray(np.linalg.solve(R, inputs), dtype=np.float64)
        found = _step(P, reach, R, radius, discrete)
        if found is None:
            break
        E, G = found
        moved, gain = R @ expm(E), F + G  # invertible, whatever the step
        if not np.isfinite(moved).all() or not np.linalg.cond(moved / np.linalg.norm(moved, axis=0)) < 1e6:
            radius /= 4
            continue
        images = _loops(matrices, inputs, moved, gain)
        value = _margin(images, discrete)
        if value > margin + 1e-9:
            radius = min(1.0, 1.7 * radius) if value > margin + 0.1 * abs(margin) else radius
            R, F, P, margin = moved, gain, images, value
        else:
            radius /= 3
    return R, F, margin


def _loops(matrices: Array, inputs: Array, R: Array, F: Array) -> Array:
    return np.asarray(np.linalg.solve(R, (matrices + inputs @ F) @ R), dtype=np.float64)


def _margin(P: Array, discrete: bool) -> float:
    entries = float(P[:, required_entries(P.shape[1], discrete)].min(initial=np.inf))
    decrease = float((discrete - P.sum(axis=2)).min())
    return min(entries, decrease) / (1.0 if discrete else float(np.abs(P).max()) or 1.0)


def _effort(count: int, n: int, m: int) -> float:
    """Operations to set up and solve one program."""
    entries = count * n * n * (2 * n + m)
    return 2 * _PER_ENTRY * entries + program_effort(count * n * n, n * (n + 2 * m), entries)


def _step(P: Array, reach: Array, R: Array, radius: float, discrete: bool) -> tuple[Array, Array] | None:
    """E and G of one program; `reach` is R^-1 B_s."""
    count, n, m = reach.shape
    spend(_effort(count, n, m))
    eye = sp.eye_array(n, format="csr")
    required = np.flatnonzero(required_entries(n, discrete))
    ones = sp.kron(eye, np.ones((1, n)), format="csr")
    entries, sums = [], []
    # P E - E P + reach (G R), entry by entry; G R has variables of its own, so that rows have few entries
    for s in range(count):
        rows = sp.csr_array(
            sp.hstack([sp.kron(P[s], eye) - sp.kron(eye, P[s].T), sp.csr_array((n * n, m * n)), sp.kron(reach[s], eye)])
        )
        entries.append(-rows[required])
        sums.append(ones @ rows)
    bounded = sp.csr_array(sp.vstack([*entries, *sums]))
    largest = float(np.abs(reach).max(initial=0.0) * np.abs(R).max())
    size = float(np.abs(P).max() / max(largest, 1e-300))
    most = np.concatenate([np.full(n * n, radius), np.full(m * n, radius * min(size, 1e100))])
    free = np.full(m * n, np.inf)
    # G R in terms of G
    same = sp.hstack(
        [sp.csr_array((m * n, n * n)), sp.kron(sp.eye_array(m), R.T), -sp.eye_array(m * n), sp.csr_array((m * n, 1))]
    )
    cost = np.zeros(n * n + 2 * m * n + 1)
    cost[-1] = -1.0
    answer = solve(
        cost,
        A_ub=sp.hstack([bounded, np.ones((bounded.shape[0], 1))], format="csr"),
        b_ub=np.concatenate([P.reshape(count, -1)[:, required].ravel(), (discrete - P.sum(axis=2)).ravel()]),
        A_eq=sp.csr_array(same),
        b_eq=np.zeros(m * n),
        bounds=(np.concatenate([-most, -free, [-1e3]]), np.concatenate([most, free, [10.0]])),
    )
    if not answer:
        return None
    return answer.x[: n * n].reshape(n, n), answer.x[n * n : n * n + m * n].reshape(m, n)
