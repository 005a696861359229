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
                rays = _exactly(s, place, length, shifts, units)
                if rays is not None:
                    yield rays


class _Search:
    """Programs for a number of rays with a chain."""

    def __init__(self, s: Spread, count: int, length: int) -> None:
        self.s, self.count, self.length = s, count, length
        n, p, m = len(s.A), count, s.B.shape[1]
        self.required = required_entries(p, s.discrete)
        self.margins = self.required & (np.arange(p) >= length)  # columns of the chain but for its last have none
        self.inputs = length < 0
        self.moving = np.arange(p) > length
        self.sizes = n, p, m

    def from_start(self, rng: np.random.Generator, k: int) -> Place | None:
        """Rays moved as far as they go from one start."""
        n, p, _ = self.sizes
        s, middle = self.s, self.s.states.mean(axis=1)
        around, sizes, _ = np.linalg.svd(s.states - middle[:, None])
        if k == 0:
            chosen = np.linspace(0, s.states.shape[1] - 1, p).astype(int)
            R = middle[:, None] + _SIZES[0] * (s.states[:, chosen] - middle[:, None])
        else:
            corners = rng.standard_normal((n - 1, p))
            if p == n and n > 1:
                corners = np.linalg.qr(np.column_stack([np.ones(n), rng.standard_normal((n, n - 1))]))[0][:, 1:].T
                corners = corners * np.sqrt(n)
            width = np.resize(sizes, n - 1) / np.sqrt(s.states.shape[1])
            R = middle[:, None] + _SIZES[k % 4] * (around[:, : n - 1] * width) @ corners
        heights = s.w @ R
        if not (heights > 0).all():
            return None
        low, high = (0.0, 0.5) if s.discrete else (-2.0, 0.0)
        shifts = rng.uniform(low, high, max(self.length, 0)) if k else np.full(max(self.length, 0), 1.5 * low)
        start = self.settled(R / heights, shifts)
        return None if start is None else descend(start, self.moved, goal=_GOAL)

    def settled(self, R: Array, shifts: Array) -> Place | None:
        """The best multipliers of rays whose chain has these shifts."""
        R = self._with_chain(R, shifts)
        return None if R is None else self._solved(R, None, 0.0)

    def moved(self, place: Place, radius: float) -> Place | None:
        """The rays of one program, and their own best multipliers."""
        found = self._solved(place.R, place, radius)
        return None if found is None else self.settled(found.R, np.diag(found.P)[: max(self.length, 0)])

    def _with_chain(self, R: Array, shifts: Array) -> Array | None:
        if self.length < 0:
            return R
        R = R.copy()
        g = self.s.B[:, 0]
        for k in range(self.length + 1):
            R[:, k] = g
            if k < self.length:
                g = self.s.A @ g - shifts[k] * g
                height = self.s.w @ g
                if not height > 1e-9 * np.linalg.norm(g) * np.linalg.norm(self.s.w):
                    return None
                g = g / height
        return R

    def _solved(self, R: Array, at: Place | None, radius: float) -> Place | None:
        s, (n, p, m) = self.s, self.sizes
        spend(program_effort(n * p + n * m + p, p * p + p * m + n * p))
        chain = max(self.length, 0)
        low, high = np.where(self.required, 0.0, -np.inf), np.full((p, p), np.inf)
        for k in range(chain):  # column k has two entries
            high[:, k] = 0.0
            low[np.arange(p) != k, k] = 0.0
            high[[k, k + 1], k] = np.inf
        program = Program(P=Block(p * p, low.T.ravel(), high.T.ravel()), N=Block(p * m, 0.0))
        program.add(margin=Block(1, _LOWEST, 1.0, -1.0), lowest=Block(1, _LOWEST, 0.0, -_PENALTY))
        images = {"P": np.kron(np.eye(p), R), "margin": (R @ self.margins).T.ravel()}
        inputs = {"N": np.kron(np.eye(m), R), "margin": np.tile(R.sum(axis=1), m) if self.inputs else np.zeros(n * m)}
        outputs, values = {}, (s.C @ R).T.ravel()
        if at is not None:
            program.add(D=Block(n * p, -radius, radius))
            images["D"] = np.kron(at.P.T, np.eye(n)) - np.kron(np.eye(p), s.A)
            inputs["D"] = np.kron(at.F.T, np.eye(n))
            program.equal(0.0, D=np.kron(np.eye(p), s.w[None]))
            outputs = {"D": np.kron(np.eye(p), s.C)}
            if self.length >= 0:
                program.equal(0.0, D=np.eye(n, n * p))
        program.equal((s.A @ R).T.ravel(), **images)
        program.equal(s.B.T.ravel(), **inputs)
        q = len(s.C)
        for name, rows in (("margin", np.repeat(self.moving, q)), ("lowest", np.repeat(~self.moving, q))):
            if rows.any():
                parts = {block: part[rows] for block, part in outputs.items()}
                program.above(-values[rows], np.ones(rows.sum()), name=name, **parts)
        answer = program.solve()
        if not answer:
            return None
        t = float(answer["margin"][0])
        P = answer["P"].reshape(p, p).T + t * self.margins
        N = answer["N"].reshape(m, p).T + t * self.inputs
        if at is not None:
            R = R + answer["D"].reshape(p, n).T
            R = R / (s.w @ R)
        return Place(R, P, t + _PENALTY * float(answer["lowest"][0]), N)


def _exactly(s: Spread, place: Place, length: int, shifts: int, units: int) -> Rationals | None:
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
