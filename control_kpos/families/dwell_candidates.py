"""Candidates for dwell times: linear programs for the vectors, products of exponentials for cycles.  Not trusted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import reduce
from itertools import permutations, product
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..cones import Cone
from ..exact.budget import spend
from ..exact.matrix import Matrix
from ..exact.program import Block, Program
from ..exact.programs import program_effort
from .dwell import MOST_STEPS, MOST_TERMS
from .growth import in_generators, iterated

Floats = NDArray[np.float64]
# Halvings of the dwell time, how close its ends come relatively, and doublings until vectors are found.
_HALVINGS, _CLOSE, _DOUBLINGS = 60, 1e-5, 24
# Binary digits of times and of vectors, relative to the longest.
_DIGITS, _SHORT = 24, 30
# Relative accuracy of a series, and members in a cycle.
_ACCURACY, _LENGTH = 1e-9, 3
# Ratios of the times of a cycle.
_RATIOS = (1.0, 1.5, 2.5)
# Grid of times.
_POINTS = 200
# In discrete time: how many different numbers of steps a cycle has, from the least one on.
_MORE_STEPS = 2


def shift_of(X: Cone, A: Matrix) -> Fraction:
    """The least a, rounded up to a few digits, for which A + a I maps X into X."""
    facets, rays = X.exact_facets.plain().fractions(), X.exact_rays.plain().fractions()
    heights, moved = facets @ rays.T, facets @ A.dense().fractions() @ rays.T
    pairs = zip(heights.ravel(), moved.ravel(), strict=True)
    least = max((Fraction(-m) / h for h, m in pairs if h > 0), default=Fraction(0))
    unit = Fraction(1, 1024)
    return max(Fraction(0), -(-least // unit) * unit)


def terms_for(z: float) -> int | None:
    """Terms of the series of e^z that reach the accuracy; None if they are too many."""
    term, total, k = 1.0, 1.0, 0
    while k < MOST_TERMS:
        k += 1
        term *= z / k
        total += term
        if k + 2 > 2 * z and term <= _ACCURACY * total:
            return k
    return None


def flow(A: Floats, t: Any, discrete: bool) -> Floats:
    """e^{A t}, or A^t."""
    return np.linalg.matrix_power(A, int(t)) if discrete else la.expm(A * float(t))


def vectors(X: Cone, matrices: Sequence[Floats], T: float, discrete: bool = False) -> Floats | None:
    """v_s with v_s'A_s x < 0 (v_s'A_s x < v_s'x) and v_t'e^{A_s T} x < v_s'x (v_t'A_s^T x), or None."""
    rays, count, n = np.asarray(X.rays, dtype=float), len(matrices), X.dim
    rays = rays / np.linalg.norm(rays, axis=1)[:, None]
    spend(program_effort(count**2 * len(rays), count * n))
    names = [f"v{s}" for s in range(count)]
    program = Program(**{name: Block(n, -1.0, 1.0) for name in names}, margin=Block(1, -1.0, 1.0, -1.0))
    ones, none = np.ones(len(rays)), np.zeros(len(rays))
    for s, A in enumerate(matrices):
        size, moved = max(1.0, float(np.abs(A).max())), rays @ flow(A, T, discrete).T
        parts: list[Any] = [{names[s]: rays}, {names[s]: -(rays @ A.T - (rays if discrete else 0)) / size}]
        parts += [{names[s]: rays, names[t]: -moved} for t in range(count) if t != s]
        for part in parts:
            program.above(none, ones, **part)
    answer = program.solve()
    if answer and answer["margin"][0] > 0:
        vs = np.array([answer[name] for name in names])
    elif X.is_simplicial:
        vs = _iterated(X, matrices, T, discrete)
    else:
        return None
    return None if vs is None else shortened(vs)


def _iterated(X: Cone, matrices: Sequence[Floats], T: float, discrete: bool) -> Floats | None:
    """The same where sizes are too far apart for a linear program: the worst of A_s'v_s and (e^{A_s T})'v_t, again."""
    spend(100 * len(matrices) ** 2 * X.dim**2)
    rays, eye, count = np.asarray(X.rays, dtype=float), np.eye(X.dim), len(matrices)
    shifts = [max(1e-300, -float(np.diag(rays @ A.T @ np.linalg.inv(rays)).min())) for A in matrices]
    own = [in_generators(A if discrete else A / a + eye, X) for A, a in zip(matrices, shifts, strict=True)]
    later = [in_generators(flow(A, T, discrete), X) for A in matrices]

    def worst(a: Floats) -> Floats:
        others = [np.delete(a, s, axis=0) for s in range(count)]
        switched = [(F @ b.T).max(axis=1) for F, b in zip(later, others, strict=True)]
        return np.maximum([P @ row for P, row in zip(own, a, strict=True)], switched)

    vs, gamma = iterated(worst, X, count, goal=1.0)
    return vs if gamma < 1 else None


def shortened(vs: Floats) -> Floats:
    """Numbers with a few binary digits."""
    mantissas, exponents = np.frexp(vs)
    return np.ldexp(np.rint(np.ldexp(mantissas, _SHORT)), exponents - _SHORT)


def least_dwell_times(X: Cone, matrices: Sequence[Floats]) -> Iterator[tuple[Fraction, Floats]]:
    """Dwell times, the least first, a little longer ones after it, with their vectors."""
    slowest = max(-np.linalg.eigvals(A).real.max() for A in matrices)
    low, high = 0.0, 1.0 / max(slowest, 1e-12)
    for _ in range(_DOUBLINGS):
        if vectors(X, matrices, high) is not None:
            break
        low, high = high, 2 * high
    else:
        return
    for _ in range(_HALVINGS):
        if high - low <= _CLOSE * high:
            break
        middle = (low + high) / 2
        low, high = (low, middle) if vectors(X, matrices, middle) is not None else (middle, high)
    for more in (1e-4, 1e-3, 1e-2, 0.1, 1.0):
        T = short(high * (1 + more), up=True)
        found = vectors(X, matrices, float(T))
        if found is not None:
            yield T, found


def least_steps(X: Cone, matrices: Sequence[Floats]) -> Iterator[tuple[Fraction, Floats]]:
    """The same in discrete time: whole numbers of steps."""
    low, high = 0, 1
    while vectors(X, matrices, high, True) is None:
        low, high = high, 2 * high
        if high > MOST_STEPS:
            return
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if vectors(X, matrices, middle, True) is not None else (middle, high)
    for T in (high, high + 1, 2 * high):
        found = vectors(X, matrices, T, True)
        if found is not None:
            yield Fraction(T), found


def short(t: float, *, up: bool) -> Fraction:
    """A number with a few binary digits, not below t (`up`) or not above it."""
    unit = Fraction(2) ** (int(np.floor(np.log2(t))) - _DIGITS)
    return (-(-Fraction(t) // unit) if up else Fraction(t) // unit) * unit


def unstable_cycles(matrices: Sequence[Floats], most: float) -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
    """Members and times, up to about `most`, with a product of radius just above 1; the longest least time first."""
    found = []
    count = len(matrices)
    for length in range(2, min(_LENGTH, count) + 1):
        for modes in permutations(range(count), length):
            if modes[0] != min(modes):
                continue
            for ratios in _ratios(length):
                t = _longest(matrices, modes, ratios, most)
                if t is not None:
                    found.append((t, modes, tuple(t * r for r in ratios)))
    for _, modes, times in sorted(found, key=lambda item: -item[0])[:3]:
        yield modes, times


def unstable_step_cycles(matrices: Sequence[Floats], most: int) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Members and numbers of steps, all of T or T + 1 and so on, with a radius of 1 or more; the largest T first."""
    count = len(matrices)
    orders = [
        modes for length in (2, _LENGTH) for modes in permutations(range(count), length) if modes[0] == min(modes)
    ]
    for T in range(most, 0, -1):
        powers = [[flow(A, T + more, True) for more in range(_MORE_STEPS)] for A in matrices]
        for modes in orders:
            for mores in product(range(_MORE_STEPS), repeat=len(modes)):
                spend(30 * len(matrices[0]) ** 3)
                P = reduce(lambda P, M: M @ P, [powers[s][more] for s, more in zip(modes, mores, strict=True)])
                if np.abs(np.linalg.eigvals(P)).max() >= 1 - 1e-12:
                    yield modes, tuple(T + more for more in mores)


def _ratios(length: int) -> list[tuple[float, ...]]:
    if length > 2:
        return [(1.0,) * length]
    return [(1.0, r) for r in _RATIOS] + [(r, 1.0) for r in _RATIOS[1:]]


def _longest(
    matrices: Sequence[Floats], modes: tuple[int, ...], ratios: tuple[float, ...], most: float
) -> float | None:
    """The longest least time on a grid with a radius of 1 or more, then by halving, and a little less."""
    grid = most * np.arange(1, _POINTS + 1) / _POINTS
    spend(1e3 * _POINTS * len(modes) * len(matrices[0]) ** 3)
    grows = [t for t in grid if radius(matrices, modes, [t * r for r in ratios]) > 1]
    if not grows:
        return None
    low, high = grows[-1], grows[-1] + grid[0]
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if radius(matrices, modes, [middle * r for r in ratios]) > 1 else (low, middle)
    return low * (1 - 1e-5)


def transition(
    matrices: Sequence[Floats], modes: Sequence[int], times: Sequence[Any], discrete: bool = False
) -> Floats:
    """The product of the exponentials, or powers, of a cycle."""
    P = np.eye(len(matrices[0]))
    for s, t in zip(modes, times, strict=True):
        P = flow(matrices[s], t, discrete) @ P
    return P


def radius(matrices: Sequence[Floats], modes: Sequence[int], times: Sequence[Any]) -> float:
    """The spectral radius of that product."""
    return float(np.abs(np.linalg.eigvals(transition(matrices, modes, times))).max())
