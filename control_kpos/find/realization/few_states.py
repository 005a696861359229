"""Cones of few rays between inputs and outputs: rays moved by linear programs.

A R = R P, B = R N and Q = C R with P >= 0 (continuous time: off the diagonal) and N, Q >= 0 become, for a small
motion D of the rays R with multipliers P0 and N0,

    A D - D P0 - R P = -A R,    D N0 + R N = B,    C (R + D) = Q,

and a linear program makes the smallest of the entries of P, N and Q as large as possible (see `family.descent`), with
w'D = 0 for the heights of `spread`.

A response that is zero at times leaves no margin.  Then, for one input, the first h + 1 rays are a chain, exactly:

    g_0 = b,    g_(k+1) = (A - m_k I) g_k    so that    A g_k = m_k g_k + g_(k+1),

with m_k >= 0 in discrete time, and only what follows has a margin: the other rays, and where A takes g_h and them.
Here h = 0 means b itself is a ray, and no chain (h = -1) leaves all rays free.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import affords, spend
from ...exact.linalg import Rationals, product
from ...exact.program import Block, Program
from ...exact.programs import program_effort
from ..family.descent import Place, descend, required_entries
from .spread import Spread

Array = NDArray[np.float64]

# Sizes of random simplices relative to the orbits; the first start is made of points of the orbits.
_SIZES = (1.5, 4.0, 0.8, 8.0)
# Margin that is enough, and below which a place is not worth a proof.
_GOAL, _WORTH = 1e-3, 1e-9
# Weight of negative outputs of a chain against the margin of all else; both are negative by that much at most.
_PENALTY, _LOWEST = 10.0, -1e3
# Relative height below which a chain is taken to leave the cone.
_LOW = 1e-9
# Denominators of shifts and coordinates, and shifts that are zero.
_DENOMINATORS, _ZERO = ((12, 2**10), (1000, 2**22), (10**7, 2**44)), 1e-7


def few_rays(s: Spread, count: int, length: int, *, starts: int, seed: int = 0) -> Iterator[Rationals]:
    """So many rays, one a row, in the coordinates that the system was given in, to be proven.

    Parameters
    ----------
    s : Spread
    count : int
    length : int
        h, the last of a chain; -1 for none.
    starts, seed : int
    """
    rng = np.random.default_rng([seed, count, length + 1])
    for k in range(starts):
        if not affords():
            return
        place = _Search(s, count, length).from_start(rng, k)
        if place is not None and place.margin > _WORTH:
            for shifts, units in _DENOMINATORS:
                yield _exactly(s, place, length, shifts, units)


class _Search:
    """Programs for a number of rays with a chain."""

    def __init__(self, s: Spread, count: int, length: int) -> None:
        self.s, self.length, self.shifts = s, length, max(length, 0)
        self.n, self.p, self.m = len(s.A), count, s.B.shape[1]
        self.required = required_entries(count, s.discrete)
        self.margins = self.required & (np.arange(count) >= length)  # columns of the chain but for its last have none
        self.bounds = _bounds(self.required, self.shifts)

    def from_start(self, rng: np.random.Generator, k: int) -> Place | None:
        """Rays moved as far as they go from one start."""
        R = self._around(rng, k)
        heights = self.s.w @ R
        if not (heights > 0).all():
            return None
        low, high = (0.0, 0.5) if self.s.discrete else (-2.0, 0.0)
        shifts = rng.uniform(low, high, self.shifts) if k else np.full(self.shifts, 1.5 * low)
        start = self.settled(R / heights, shifts)
        return None if start is None else descend(start, self.moved, goal=_GOAL)

    def _around(self, rng: np.random.Generator, k: int) -> Array:
        """Points of the orbits for k = 0, then corners of random polytopes, of simplices for n rays."""
        n, p, states = self.n, self.p, self.s.states
        middle = states.mean(axis=1)[:, None]
        if k == 0:
            chosen = np.linspace(0, states.shape[1] - 1, p).astype(int)
            return middle + _SIZES[0] * (states[:, chosen] - middle)
        corners = rng.standard_normal((n - 1, p))
        if p == n:
            columns = np.column_stack([np.ones(n), rng.standard_normal((n, n - 1))])
            corners = np.linalg.qr(columns)[0][:, 1:].T * np.sqrt(n)
        axes, sizes, _ = np.linalg.svd(states - middle)
        width = np.resize(sizes, n - 1) / np.sqrt(states.shape[1])
        return middle + _SIZES[k % 4] * (axes[:, : n - 1] * width) @ corners

    def settled(self, R: Array, shifts: Array) -> Place | None:
        """The best multipliers of rays whose chain has these shifts."""
        R, heights = np.array(R, dtype=np.float64), [1.0]
        for k in range(self.length + 1):
            g: Array = self.s.A @ R[:, k - 1] - shifts[k - 1] * R[:, k - 1] if k else self.s.B[:, 0]
            height = float(self.s.w @ g)
            heights.append(height / float(np.linalg.norm(g) or 1.0))
            R[:, k] = g / height
        return self._solved(R, None, 0.0) if min(heights) > _LOW and np.isfinite(R).all() else None

    def moved(self, place: Place, radius: float) -> Place | None:
        """The rays of one program, and their own best multipliers."""
        found = self._solved(place.R, place, radius)
        return None if found is None else self.settled(found.R, np.diag(found.P)[: self.shifts])

    def _solved(self, R: Array, at: Place | None, radius: float) -> Place | None:
        """The best multipliers, of rays that move within the radius if `at` is given."""
        s, n, p, m = self.s, self.n, self.p, self.m
        spend(program_effort(n * p + n * m + p, p * p + p * m + n * p))
        low, high = self.bounds
        anywhere = float(self.length < 0)  # the input is a ray of the chain, or has a margin
        program = Program(P=Block(p * p, low, high), N=Block(p * m, 0.0))
        program.add(margin=Block(1, _LOWEST, 1.0, -1.0), lowest=Block(1, _LOWEST, 0.0, -_PENALTY))
        images = {"P": np.kron(np.eye(p), R), "margin": (R @ self.margins).T.ravel()}
        inputs = {"N": np.kron(np.eye(m), R), "margin": np.tile(R.sum(axis=1), m) * anywhere}
        outputs: dict[str, Any] = {}
        if at is not None:
            program.add(D=Block(n * p, -radius, radius))
            images["D"] = np.kron(at.P.T, np.eye(n)) - np.kron(np.eye(p), s.A)
            inputs["D"] = np.kron(at.F.T, np.eye(n))
            outputs["D"] = np.kron(np.eye(p), s.C)
            program.equal(0.0, D=np.kron(np.eye(p), s.w[None]))
        if at is not None and self.length >= 0:
            program.equal(0.0, D=np.eye(n, n * p))
        program.equal((s.A @ R).T.ravel(), **images)
        program.equal(s.B.T.ravel(), **inputs)
        chain = np.repeat(np.arange(p) <= self.length, len(s.C))
        for name, rows in (("margin", ~chain), ("lowest", chain)):
            if rows.any():
                parts = {block: part[rows] for block, part in outputs.items()}
                program.above(-(s.C @ R).T.ravel()[rows], np.ones(rows.sum()), name=name, **parts)
        answer = program.solve()
        if not answer:
            return None
        t = float(answer["margin"][0])
        P = answer["P"].reshape(p, p).T + t * self.margins
        N = answer["N"].reshape(m, p).T + t * anywhere
        R = R if at is None else R + answer["D"].reshape(p, n).T
        return Place(R / (s.w @ R), P, t + _PENALTY * float(answer["lowest"][0]), N)


def _bounds(required: NDArray[np.bool_], shifts: int) -> tuple[Array, Array]:
    """Of P, column by column: two entries of each column of a chain, and the signs of the others."""
    low, high = np.where(required, 0.0, -np.inf), np.full(required.shape, np.inf)
    for k in range(shifts):
        others = ~np.isin(np.arange(len(low)), (k, k + 1))
        low[others, k] = high[others, k] = 0.0
    return low.T.ravel(), high.T.ravel()


def _exactly(s: Spread, place: Place, length: int, shifts: int, units: int) -> Rationals:
    """Rays in fractions: a chain, computed exactly from its rounded shifts, and the others rounded."""
    A, B, _ = s.exact
    out = []
    if length >= 0:
        g = B[:, 0]
        out.append(g)
        for m in np.diag(place.P)[:length]:
            scale = Fraction(s.size)
            shift = Fraction(0) if abs(m) < _ZERO else Fraction(float(m)).limit_denominator(shifts)
            shift = shift * scale if s.discrete else Fraction(s.top) + shift * scale
            g = product(A, g[:, None])[:, 0] - shift * g
            out.append(g)
    out += [[Fraction(round(float(x) * units), units) for x in ray] for ray in place.R.T[length + 1 :]]
    rays = np.array(out, dtype=object)
    return product(rays, s.T.T)
