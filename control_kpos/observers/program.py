"""Gains of an interval observer on a simplicial cone, by linear programs.

In generator coordinates, R = [x_1 ... x_n], the error equation of `certificate` has the matrix M = R^{-1} F R, and the
width tends to -M^{-1} g in them, g_k = sum_j |(R^{-1}T)_kj| (w_hi - w_lo)_j + 2 sum_i |(R^{-1}K)_ki| noise_i.  Let c be
what generators count in the sum of the entries.  For eta > 0 with eta'M + c' <= 0 the sum of the final widths is at
most eta'g, and for the best eta equal to it.  With N fixed and Z = diag(eta) R^{-1} L all is linear in (eta, Z):

    minimise    sum_k eta_k |(R^{-1}T)_k|'(w_hi - w_lo) + 2 |Z'_k|'noise,   Z' = diag(eta) R^{-1} T A N + Z (C N - I)
    subject to  diag(eta) R^{-1} T A R + Z C R >= 0 off the diagonal (discrete time: everywhere),
                its column sums + c' <= 0    (discrete time: - eta' besides).

So the smallest final width for a given N takes one program.  N and L together are the gains of the outputs -C A x and
C x, linear as long as the products of N and L in the noise are replaced by |Z_N| and |Z_L|: that gives a first N, which
a search improves entry by entry.

Gains may be large without making the width smaller: then they are bounded, |Z_ki| <= g_i eta_k, by the least g of a few
that costs next to no width.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..design.plant import Floats
from ..design.running import Programs
from ..exact.program import Block, Program

# Parts of the size of A that entries off the diagonal keep from 0, tried in turn: rounding may move gains by them.
KEPT = (0.0, 1e-9, 1e-6, 1e-3)
# Noise that gains are measured by, relative to the disturbance, where there is less: without noise no gain is largest.
_NOISE = 1e-3
# Rates of decay are at most so many times the size of A.
FASTEST = 100.0
# Sizes of N that are tried, relative to the outputs of generators.
_SHIFTS = (1.0, 10.0, 100.0)
# Bounds on gains that are tried, relative to the size of A over the outputs of generators, and the width they may cost.
_GAINS, _COSTS = (1.0, 3.0, 10.0, 30.0), 1.001
# Programs of a search for a better N, and its smallest step, relative to N.
_SEARCHES, _STEP = 40, 2e-2


class Measured(NamedTuple):
    """A plant in doubles, with its bounds.

    Attributes
    ----------
    A, C : ndarray, shapes (n, n) and (q, n)
    R : ndarray, shape (n, n)
        Generators of the cone, one a column.
    disturbance, noise : ndarray, shapes (n,) and (q,)
        w_hi - w_lo, and the bounds on noise.
    discrete : bool
    """

    A: Floats
    C: Floats
    R: Floats
    disturbance: Floats
    noise: Floats
    discrete: bool

    @property
    def least_noise(self) -> Floats:
        """The noise that is counted."""
        return least_noise(self.disturbance, self.noise)


def least_noise(disturbance: Floats, noise: Floats) -> Floats:
    """Noise that gains are measured by."""
    floor = _NOISE * (float(disturbance.max(initial=0.0)) or float(noise.max(initial=0.0)) or 1.0)
    return np.maximum(noise, floor)


class Proposal(NamedTuple):
    """Gains, and the sum of the final widths that the program promises."""

    L: Floats
    N: Floats
    value: float


def unshifted(plant: Measured, lp: Programs) -> Iterator[Proposal]:
    """The best gains with N = 0, with less and less on the edge.

    Parameters
    ----------
    plant : Measured
    lp : Programs
    """
    yield from _safer(plant, np.zeros((len(plant.A), len(plant.C))), lp)


def shifted(plant: Measured, lp: Programs) -> Iterator[Proposal]:
    """Gains with an N that makes the promised width small, with less and less on the edge.

    Parameters
    ----------
    plant : Measured
    lp : Programs
    """
    starts = [N for most in _SHIFTS if (N := _jointly(plant, most, lp)) is not None]
    first = min(filter(None, (_best(plant, N, 0.0, lp) for N in starts)), key=lambda p: p.value, default=None)
    if first is None:
        return
    better = _descended(plant, first, lp)
    for N in (np.round(better.N, 6), better.N):
        yield from _safer(plant, N, lp)


def _safer(plant: Measured, N: Floats, lp: Programs) -> Iterator[Proposal]:
    rest = list[Proposal]()
    for kept in KEPT:
        found = _best(plant, N, kept, lp)
        calmer = None if found is None else _calmer(plant, found, kept, lp)
        if calmer is not None:
            yield calmer
        rest += [found] if found is not None else []
        if calmer is None:
            yield from rest
            rest.clear()
    yield from rest


def _calmer(plant: Measured, found: Proposal, kept: float, lp: Programs) -> Proposal | None:
    """Smaller gains with next to the same width, if there are any."""
    for most in _GAINS:
        other = _best(plant, found.N, kept, lp, most)
        if other is not None and other.value <= _COSTS * found.value:
            return other
    return None


def _descended(plant: Measured, best: Proposal, lp: Programs) -> Proposal:
    """Better N, one entry after another, with smaller and smaller steps."""
    step, left = float(np.abs(best.N).max()) / 2, _SEARCHES
    while left > 0 and step > _STEP * float(np.abs(best.N).max()):
        before = best.value
        for i, j in np.ndindex(best.N.shape):
            for sign in (1.0, -1.0):
                N = best.N.copy()
                N[i, j] += sign * step
                found, left = _best(plant, N, 0.0, lp), left - 1
                if found is not None and found.value < best.value:
                    best = found
                    break
        if best.value == before:
            step /= 2
    return best


def _best(plant: Measured, N: Floats, kept: float, lp: Programs, most: float | None = None) -> Proposal | None:
    """L of the smallest sum of the final widths for this N; in generator coordinates at most so large if asked for."""
    n, q = N.shape
    T = np.eye(n) - N @ plant.C
    inverse = np.linalg.inv(plant.R)
    own, measured = inverse @ T @ plant.A @ plant.R, plant.C @ plant.R
    cost = np.abs(inverse @ T) @ plant.disturbance
    program = _program(plant, cost, n * q)
    _keep(program, plant, kept, own, {"Z": measured})
    noisy, through = inverse @ T @ plant.A @ N, plant.C @ N - np.eye(q)
    eta = np.zeros((n * q, n))
    for k in range(n):
        eta[k * q : (k + 1) * q, k] = noisy[k]
    _sizes(program, "noise", 2 * np.tile(plant.least_noise, n), eta=eta, Z=np.kron(np.eye(n), through.T))
    if most is not None:
        largest = np.kron(np.eye(n), (most * _size(plant) * _units(measured))[:, None])
        for sign in (1.0, -1.0):
            program.above(0.0, eta=largest, Z=sign * np.eye(n * q))
    answer = program.solve(lp)
    if not answer or answer["eta"].min() <= 0:  # solvers have broken bounds
        return None
    value = float(cost @ answer["eta"] + 2 * np.tile(plant.least_noise, n) @ answer["noise"])
    shifted = 2 * float(np.abs(N).sum(axis=0) @ plant.least_noise)
    return Proposal(_gain(plant, answer["eta"], answer["Z"]), N, value + shifted)


def _jointly(plant: Measured, most: float, lp: Programs) -> Floats | None:
    """An N for which L exists, at most so large relative to outputs of generators; noise is counted by |L| and |N|."""
    n, q = len(plant.A), len(plant.C)
    inverse, scale = np.linalg.inv(plant.R), max(float(np.abs(plant.A).max()), 1.0)
    program = _program(plant, np.zeros(n), n * q)
    program.add(Y=Block(n * q))
    own, seen = inverse @ plant.A @ plant.R, plant.C @ plant.R
    _keep(program, plant, 0.0, own, {"Z": seen, "Y": -plant.C @ plant.A @ plant.R})
    count = 2 * np.tile(plant.least_noise, n)
    _sizes(program, "noise", count, Z=np.eye(n * q))
    _sizes(program, "moved", scale * count, Y=np.eye(n * q))
    program.above(0.0, eta=np.kron(np.eye(n), most * _units(seen)[:, None]), moved=-np.eye(n * q))
    eta = np.zeros((n * n, n))
    for k in range(n):
        eta[k * n : (k + 1) * n, k] = inverse[k]
    _sizes(program, "pushed", np.tile(plant.disturbance, n), eta=eta, Y=np.kron(np.eye(n), -plant.C.T))
    answer = program.solve(lp)
    return _gain(plant, answer["eta"], answer["Y"]) if answer and answer["eta"].min() > 0 else None


def _program(plant: Measured, cost: Floats, size: int) -> Program:
    least = np.abs(plant.R).sum(axis=0) / (FASTEST * _size(plant))
    return Program(eta=Block(len(plant.A), low=least, cost=cost), Z=Block(size))


def _size(plant: Measured) -> float:
    """The size of A in generator coordinates."""
    return float(np.abs(np.linalg.solve(plant.R, plant.A @ plant.R)).max()) or 1.0


def _units(seen: Floats) -> Floats:
    """1 over the largest output of a generator, for each output."""
    return 1 / np.where(seen.any(axis=1), np.abs(seen).max(axis=1), 1.0)


def _keep(program: Program, plant: Measured, kept: float, own: Floats, measured: dict[str, Floats]) -> None:
    """Rows of M >= 0 off the diagonal, and of eta'M + c' <= 0."""
    n = len(own)
    scale = kept * float(np.abs(own).max())
    for k in range(n):
        columns = np.array([j for j in range(n) if plant.discrete or j != k], dtype=int)
        if not columns.size:
            continue
        reached = np.array([any(G[:, j].any() for G in measured.values()) for j in columns])
        eta = np.zeros((len(columns), n))
        eta[:, k] = own[k, columns] - scale * reached
        parts: dict[str, Any] = {name: _at(k, n, G[:, columns].T) for name, G in measured.items()}
        program.above(0.0, eta=eta, **parts)
    counted = np.abs(plant.R).sum(axis=0)
    sums = {name: np.tile(G.T, (1, n)) for name, G in measured.items()}
    program.below(-counted, eta=own.T - plant.discrete * np.eye(n), **sums)


def _at(k: int, n: int, rows: Floats) -> Floats:
    """Rows about the k-th of n parts."""
    out = np.zeros((len(rows), n * rows.shape[1]))
    out[:, k * rows.shape[1] : (k + 1) * rows.shape[1]] = rows
    return out


def _sizes(program: Program, name: str, cost: Floats, **parts: Any) -> None:
    """Variables of this name that are at least the sizes of the sums of these parts."""
    program.add(**{name: Block(len(cost), low=0.0, cost=cost)})
    for sign in (1.0, -1.0):
        signed: dict[str, Any] = {name: np.eye(len(cost)), **{part: sign * M for part, M in parts.items()}}
        program.above(0.0, **signed)


def _gain(plant: Measured, eta: Floats, Z: Floats) -> Floats:
    n = len(plant.A)
    return plant.R @ (np.asarray(Z).reshape(n, -1) / np.asarray(eta)[:, None])
