"""Candidates for proofs of structured gains, by singular vectors of the scaled DC gain.

Of blocks of single signals the Perron vectors of G(0) balance everything.  Of others log d minimises
log sigma_max(d_out^(1/2) G(0) d_in^(-1/2)), which is convex in log d, and smooth where the largest singular value is
simple.  Blocks that lead back to each other are balanced together, others are scaled apart.

Nothing here is trusted: `structured_gain` proves what is proposed, or drops it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..errors import DataError
from ..exact.budget import require_time
from ..exact.linalg import identity, solve_columns
from ..exact.matrix import Matrix, dense
from ..systems.system import System
from .blocks import Blocks

Floats = NDArray[np.float64]
Index = NDArray[np.intp]
Fields = dict[str, Any]
# Relative distances from the value found at which bounds are tried.
_FROM_ABOVE = (2.0**-50, 2.0**-46, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0)
_FROM_BELOW = (0.0, 2.0**-50, 2.0**-46, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2)
# Entries of the worst inputs below this part of the largest are left out, in turn.
_SUPPORTS = (0.0, 1e-12, 1e-8, 1e-4, 1e-2)
# Part of what a bound has to spare that goes to the states.
_SHARE = 0.25
# States up to which systems of equations are solved exactly.
_EXACT_STATES = 30
# Newton steps in log d, and parts of a step.
_STEPS = 50
_DAMPED = tuple(0.5**k for k in range(0, 40, 2))
# A larger slope at the end says that the norm has a kink; parts of the largest gain that are added to all then.
_FLAT = 1e-9
_SMOOTHED = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
# Relative changes of a norm that may be rounding.
_ROUNDING = 1e-14
# Of eigenvalues, relative: closer ones count as this far apart.
_GAP = 1e-12
# Binary digits between the weights of blocks one after the other, and between all of them at most.
_APART = 80
_RANGE = 800


@dataclass(frozen=True)
class Plant(ABC):
    """A stable positive system in floating point, with solutions of A x = b (A - I in discrete time).

    Attributes
    ----------
    blocks : Blocks
    B, C, D : ndarray or csr_array
    up, down : ndarray, shape (n,)
        -A^{-1} of a point inside X, and -A^{-T} of one inside X*.
    """

    blocks: Blocks
    B: Any
    C: Any
    D: Any
    up: Floats
    down: Floats
    # relative distance of numbers that inequalities are about, so that doubles tell them apart in long sums
    room: ClassVar[float] = 0.0

    @abstractmethod
    def after(self, x: Floats) -> Floats:
        """-A^{-1} x."""

    @abstractmethod
    def before(self, p: Floats) -> Floats:
        """-A^{-T} p."""

    def state(self, w: Floats) -> Floats:
        """-A^{-1} B w."""
        return self.after(self.B @ w)

    def costate(self, z: Floats) -> Floats:
        """-A^{-T} C'z."""
        return self.before(self.C.T @ z)

    def respond(self, w: Floats) -> Floats:
        """G w for the DC gain G and w >= 0."""
        return np.maximum(self.C @ self.state(w) + self.D @ w, 0.0)


@dataclass(frozen=True)
class DensePlant(Plant):
    """A plant of moderate size.

    Attributes
    ----------
    system : System
    G : ndarray
        The DC gain.
    """

    system: System
    G: Floats

    @classmethod
    def of(cls, p: System, blocks: Blocks) -> DensePlant:
        B, C, D = (dense(M.values) for M in (p.B, p.C, p.D))
        steady = -_solve(p, B)
        up, down = (
            -_solve(p, np.array(point, dtype=float)[:, None], transposed=k)[:, 0]
            for k, point in enumerate((p.X.interior_point, p.X.dual.interior_point))
        )
        return cls(blocks, B, C, D, up, down, p, np.maximum(C @ steady + D, 0.0))

    @cached_property
    def scaling(self) -> Scaling:
        """See `_scaling`."""
        return _scaling(self.G, self.blocks)

    def respond(self, w: Floats) -> Floats:
        """G w."""
        return self.G @ w

    def after(self, x: Floats) -> Floats:
        """-A^{-1} x."""
        return -_solve(self.system, x[:, None])[:, 0]

    def before(self, p: Floats) -> Floats:
        """-A^{-T} p."""
        return -_solve(self.system, p[:, None], transposed=True)[:, 0]


def _solve(p: System, b: Floats, *, transposed: Any = False) -> Floats:
    """A^{-1} b (A - I in discrete time), of doubles, correctly rounded for a few states."""
    n = p.X.dim
    if n <= _EXACT_STATES and np.isfinite(b).all():
        A = p.A.plain().fractions()
        A = A - identity(n) if p.discrete else A
        x = solve_columns(A.T if transposed else A, Matrix(b).fractions())
        with suppress(DataError):  # beyond the range of doubles
            return np.full(b.shape, np.nan) if x is None else Matrix.from_fractions(x).values
        return np.full(b.shape, np.inf)
    require_time(n**3 / 10)
    S = dense(p.A.values) - np.eye(n) * p.discrete
    try:
        return np.asarray(np.linalg.solve(S.T if transposed else S, b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full(b.shape, np.nan)


def from_above(plant: DensePlant) -> Iterator[Fields]:
    """Fields of proofs of an upper bound, the lowest first."""
    blocks, (d, value, _) = plant.blocks, plant.scaling
    for part in _FROM_ABOVE:
        upper = value * (1 + part) if value > 0 else part
        w, u, d_used = _paired(plant.G, blocks, d, upper)
        if all((x > 0).all() and np.isfinite(x).all() for x in (w, u, d_used)):
            yield upper_fields(plant, (w, u, d_used), upper)


def upper_fields(plant: Plant, pair: tuple[Floats, Floats, Floats], upper: float) -> Fields:
    """Fields of a proof of an upper bound from w, u, d > 0 with G w < upper u and G'(d u) < upper d w, by block."""
    (w, u, d), blocks = pair, plant.blocks
    r = np.nextafter(d[blocks.inputs] * w * (1 - plant.room), 0)
    z = np.nextafter(d[blocks.outputs] * u * (1 + plant.room), np.inf)
    x, p = plant.state(w), plant.costate(z)
    x = x + plant.up * _share(upper * u - plant.C @ x - plant.D @ w, plant.C @ plant.up, x, plant.up)
    p = p + plant.down * _share(upper * r - p @ plant.B - z @ plant.D, plant.down @ plant.B, p, plant.down)
    return {"upper": upper, "w": w, "u": u, "d": d, "r": r, "z": z, "x": x, "p": p}


def _share(spare: Floats, cost: Floats, x: Floats, inside: Floats) -> float:
    """How much of a vector inside the cone may be added, in view of what it costs."""
    parts = spare[cost > 0] / cost[cost > 0]
    if parts.size:
        return _SHARE * max(float(parts.min()), 0.0)
    return float(np.abs(x).max(initial=0.0) / np.abs(inside).max(initial=0.0)) or 1.0


def _paired(G: Floats, blocks: Blocks, d: Floats, upper: float) -> tuple[Floats, Floats, Floats]:
    """w, u, d with G w < upper u and G'(d u) < upper d w, by block; not positive if `upper` is too low."""
    if blocks.is_diagonal:
        square = upper * np.eye(len(d)) - blocks.square(G)
        w, left = _solved(square), _solved(square.T)
        u = np.empty(len(d))
        u[blocks.partner] = w
        by_block = np.empty(len(d))
        by_block[blocks.inputs] = left / w
        return w, u, by_block
    ins, outs = np.sqrt(d[blocks.inputs]), np.sqrt(d[blocks.outputs])
    M = outs[:, None] * G / ins
    both = _solved(np.block([[upper * np.eye(len(outs)), -M], [-M.T, upper * np.eye(len(ins))]]))
    return both[len(outs) :] / ins, both[: len(outs)] / outs, d


def _solved(M: Floats) -> Floats:
    """M^{-1} 1, or NaN."""
    try:
        return np.asarray(np.linalg.solve(M, np.ones(len(M))), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full(len(M), np.nan)


def from_below(plant: Plant, inputs: Floats, parts: Sequence[float] = _FROM_BELOW) -> Iterator[Fields]:
    """Fields of proofs of a lower bound, the highest first, from inputs that are amplified; none if 0 is all.

    `parts` are relative distances from the value found.
    """
    worst = _worst_inputs(plant, inputs)
    if worst is None:
        return
    x = plant.state(worst)
    later = plant.after(x)  # in the face that the inputs reach, and inside it
    later = later * float(np.abs(x).max(initial=0.0) / np.abs(later).max(initial=np.finfo(float).tiny))
    for part in parts:
        s = x - part * later
        y = np.maximum((plant.C @ s + plant.D @ worst) * (1 - 4 * part), 0.0)
        lower = plant.blocks.quotient(y, worst) * (1 - 2.0**-50 - 4 * plant.room)
        if 0 < lower < np.inf:
            c = np.nextafter(lower * worst * (1 + plant.room), np.inf) * (worst > 0)
            yield {"lower": lower, "a": worst, "c": c, "y": y, "s": s}


def _worst_inputs(plant: Plant, a: Floats) -> Floats | None:
    """The part of inputs a >= 0 whose blocks G amplifies most, or None if no block is amplified."""
    best, found = 0.0, None
    for support in _SUPPORTS:
        kept = np.where(a >= support * a.max(initial=0.0), a, 0.0)
        value = plant.blocks.quotient(plant.respond(kept), kept)
        if np.isfinite(value) and value > best:
            best, found = value, kept
    return found


class Scaling(NamedTuple):
    """Weights of the blocks, the scaled norm, and the inputs at which it is attained."""

    d: Floats
    value: float
    inputs: Floats


def _scaling(G: Floats, blocks: Blocks) -> Scaling:
    """The least scaled norm, part by part: blocks that do not lead back to each other are scaled apart."""
    d, worst, inputs = np.ones(blocks.count), 0.0, np.zeros(G.shape[1])
    if not np.isfinite(G).all():
        return Scaling(d, np.nan, inputs)
    label, depth = _parts(G, blocks)
    for part in range(int(label.max()) + 1):
        members = np.flatnonzero(label == part)
        ins, outs = (np.flatnonzero(np.isin(of, members)) for of in (blocks.inputs, blocks.outputs))
        own = Blocks(*(np.searchsorted(members, of[k]) for of, k in ((blocks.inputs, ins), (blocks.outputs, outs))))
        found = (_perron if own.is_diagonal else _least_norm)(G[np.ix_(outs, ins)], own)
        d[members] = found.d
        if found.value > worst:
            worst, inputs = found.value, np.zeros(G.shape[1])
            inputs[ins] = found.inputs
    return Scaling(d * np.ldexp(1.0, -depth * min(_APART, _RANGE // (int(depth.max()) + 1))), worst, inputs)


def _parts(G: Floats, blocks: Blocks) -> tuple[Index, Index]:
    """The strongly connected part of every block, and the most parts before it."""
    to, of = np.nonzero(G)
    edges = np.unique(np.stack([blocks.inputs[of], blocks.outputs[to]]), axis=1)
    graph = sp.csr_array((np.ones(edges.shape[1]), edges), shape=(blocks.count, blocks.count))
    count, label = connected_components(graph, connection="strong")
    before, after = label[edges]
    before, after = before[before != after], after[before != after]
    depth, last = np.zeros(count, dtype=np.intp), None
    while last is None or (depth != last).any():
        last = depth.copy()
        np.maximum.at(depth, after, last[before] + 1)
    return label, depth[label]


def _perron(G: Floats, blocks: Blocks) -> Scaling:
    """Of blocks of single signals; their weights are found with a bound."""
    require_time(float(len(G)) ** 3)
    values, vectors = map(np.real, np.linalg.eig(blocks.square(G)))
    first = int(np.argmax(values))
    return Scaling(np.ones(blocks.count), max(float(values[first]), 0.0), np.abs(vectors[:, first]))


def _least_norm(G: Floats, blocks: Blocks) -> Scaling:
    """By Newton's method in log d; where the norm has a kink, of gains that have none and come ever closer."""
    now = _descended(np.zeros(blocks.count), G, blocks)
    if np.abs(now.slope).max() > _FLAT and G.any():
        for part in _SMOOTHED:
            now = _descended(now.t, G + part * G.max(), blocks)
    inputs = now.first[len(G) :] / np.exp(now.t / 2)[blocks.inputs]
    return Scaling(np.exp(now.t), _Scaled.at(now.t, G, blocks).value, inputs)


def _descended(t: Floats, G: Floats, blocks: Blocks) -> _Scaled:
    """The end of Newton's method from t."""
    now = _Scaled.at(t, G, blocks)
    for _ in range(_STEPS if blocks.count > 1 and G.any() else 0):
        step = np.linalg.lstsq(now.curvature(), -now.slope)[0]
        tried = (_Scaled.at(now.t + part * step, G, blocks) for part in _DAMPED)
        better = next((scaled for scaled in tried if scaled.is_better_than(now)), None)
        if better is None:
            break
        now = better
    return now


class _Scaled(NamedTuple):
    """The largest eigenvalue of H = [[0, M], [M', 0]] for the gain M scaled at t = log d, and its derivatives.

    dH / dt_k = (P_k H + H P_k) / 2 with P_k = 1 on the outputs of block k and -1 on its inputs.
    """

    t: Floats
    values: Floats
    first: Floats
    products: Floats
    sizes: Floats

    @classmethod
    def at(cls, t: Floats, G: Floats, blocks: Blocks) -> _Scaled:
        M = np.exp(t / 2)[blocks.outputs][:, None] * G / np.exp(t / 2)[blocks.inputs]
        q, m = M.shape
        require_time(float(q + m) ** 3)
        H = np.zeros((q + m, q + m))
        H[:q, q:], H[q:, :q] = M, M.T
        values, V = np.linalg.eigh(H) if np.isfinite(H).all() else (np.full(q + m, np.inf), np.eye(q + m))
        first = V[:, -1] = np.abs(V[:, -1])
        of = np.concatenate([blocks.outputs, blocks.inputs])
        signs = np.repeat([1.0, -1.0], [q, m])
        members = (np.arange(blocks.count)[:, None] == of) * first
        return cls(t, values, first, (members * signs) @ V, (members * first).sum(axis=1))

    @property
    def value(self) -> float:
        """sigma_max(M)."""
        return float(self.values[-1])

    @property
    def slope(self) -> Floats:
        """Of log sigma_max(M)."""
        return self.products[:, -1]

    def is_better_than(self, other: _Scaled) -> bool:
        """True for a smaller norm, or one that is the same but for rounding, and flatter."""
        flatter = np.abs(self.slope).max() < 0.5 * np.abs(other.slope).max()
        return self.value < other.value * (1 - _ROUNDING) or (flatter and self.value < other.value * (1 + _ROUNDING))

    def curvature(self) -> Floats:
        """The matrix of second derivatives of log sigma_max(M)."""
        s, rest = self.value, self.values[:-1]
        weights = np.append(rest + (rest + s) ** 2 / np.maximum(s - rest, _GAP * s), s) / (2 * s)
        square = (self.products * weights) @ self.products.T + np.diag(self.sizes) / 2
        return square - np.outer(self.slope, self.slope)
