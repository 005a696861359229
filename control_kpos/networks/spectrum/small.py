"""Small networks in rational arithmetic, where rounding hides on which side of the margin they lie.

The closed loop need not be formed.  On the product of all X_j and U_j

    M = [[A, B], [W C, W D - I]]        (A - I in place of A in discrete time)

is cross-positive, and it is stable if and only if the algebraic loop contracts and the closed loop is
stable: A + B (I - W D)^{-1} W C is a Schur complement of M.  So either (v, r) with (v, r)'M < 0 or (x, u) with
M (x, u) in X x U exists, and these are Theorem-4 data (q = -W'r) or a direction in which nothing decays.

Simplicial cones are taken to orthants, M falls into its strongly connected parts, and on each part

    [[M, d], [c', 0]] (x, t) = (0, 1),      c in int X*,  d in int X,

has a solution x in X with M x = -t d: a direction of growth if t <= 0; for t > 0 the transposed equations
give v.  What that leaves open (parts of cones that are not simplicial) goes to a linear program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from graphlib import TopologicalSorter
from math import lcm

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ...cones import Cone, orthant, product
from ...errors import DataError
from ...exact.matrix import Matrix
from ...proof.portable_cones import opposite_facets
from ...theorems.lyapunov_candidates import decide_exactly
from .. import conditions as on
from ..blocks import Index, take_blocks
from ..model import NetworkModel
from .lifting import solve_by_lifting

Rationals = NDArray[np.object_]

# States and inputs above which rational arithmetic would take more than a minute.
EXACT_SIZE = 600
_DIGITS = (53, 80, 160, 640)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What rational arithmetic found.

    Attributes
    ----------
    stable : bool
    state, port : ndarray of Fraction, shapes (sum n_j,), (sum m_j,)
        v and r if stable, else x and u.
    """

    stable: bool
    state: Rationals
    port: Rationals


class ExactNetwork:
    """M of a positive network in coordinates in which simplicial cones are orthants.

    Parameters
    ----------
    model : NetworkModel
        Of at most `EXACT_SIZE` states and inputs.

    Attributes
    ----------
    M : ndarray of Fraction, shape (sum n_j + sum m_j,) twice
    group : ndarray of int
        Coordinates of one cone that is not simplicial share a number; all others have their own.
    cones : dict of int to Cone
        By group, those that are not simplicial.
    """

    def __init__(self, model: NetworkModel) -> None:
        self.model = model
        n, m = model.totals[:2]
        self.split = n
        self.M = np.zeros((n + m, n + m), dtype=object)
        self.group = np.arange(n + m)
        self.cones: dict[int, Cone] = {}
        self.frames = [(_frame(s.X), _frame(s.U)) for s in model.stacks]
        for (x, u, _), s in zip(model.places, model.stacks, strict=True):
            for cone, place in ((s.X, x), (s.U, u + n)):
                if not cone.is_simplicial:
                    self.group[place] = place[:, :1]
                    self.cones.update(dict.fromkeys(place[:, 0].tolist(), cone))
        self._fill()

    def _fill(self) -> None:
        model, n, (_, place) = self.model, self.split, self.model._home
        for (x, u, _), s, ((left, right), (_, inputs)) in zip(model.places, model.stacks, self.frames, strict=True):
            self._put(x, x, left @ s.A.fractions() @ right)
            self._put(x, u + n, left @ s.B.fractions() @ inputs)
        for gj, gk, j, k in on.coupling_pairs(model):
            source, (into, _) = model.stacks[gk], self.frames[gj][1]
            u, y = model.places[gj][1][place[j]] + n, model.places[gk][2][place[k]]
            W = into @ take_blocks(model.coupling, u - n, y).fractions()
            (_, states), (_, inputs) = self.frames[gk]
            self._put(u, model.places[gk][0][place[k]], W @ source.C.fractions()[place[k]] @ states)
            self._put(u, model.places[gk][1][place[k]] + n, W @ source.D.fractions()[place[k]] @ inputs)
        self.M[np.arange(n, len(self.M)), np.arange(n, len(self.M))] -= 1

    def _put(self, rows: Index, columns: Index, blocks: Rationals) -> None:
        if blocks.size:
            self.M[rows[:, :, None], columns[:, None, :]] = blocks

    def decide(self, shift: float) -> Outcome | None:
        """Whether the algebraic loop contracts and the spectral abscissa is below the shift; None if too long."""
        M = self.M.copy()
        diagonal = np.arange(self.split)
        M[diagonal, diagonal] -= Fraction(shift)
        return self._decide(M, self._parts(0), 0)

    def decide_loop(self) -> Outcome | None:
        """Whether the algebraic loop u = W D u contracts; `state` is empty."""
        return self._decide(self.M, self._parts(self.split), self.split)

    def estimate(self) -> float:
        """The spectral abscissa in floating point, part by part; the algebraic loop must contract."""
        top = -np.inf
        for part in self._parts(0):
            count = int((part < self.split).sum())
            S = np.array([[float(value) for value in row] for row in self.M[np.ix_(part, part)]])
            if count:
                closed = S[:count, :count] - S[:count, count:] @ np.linalg.solve(S[count:, count:], S[count:, :count])
                top = max(top, float(np.linalg.eigvals(closed).real.max()))
        return top

    def _decide(self, M: Rationals, parts: list[Index], first: int) -> Outcome | None:
        w = np.full(len(M), Fraction(0), dtype=object)
        for part in parts:
            cone = self._cone(part)
            decided = _decide_part(M[np.ix_(part, part)], cone)
            if decided is None:
                return None
            stable, vector = decided
            if not stable:
                w[:] = Fraction(0)
                w[part] = vector
                return self._outcome(False, w, first)
            # every part pays for what it does to those before it
            burden, slack = cone.rays @ (w @ M[:, part]), cone.rays @ (vector @ M[np.ix_(part, part)])
            factor = max((Fraction(b) / -s for b, s in zip(burden, slack, strict=True)), default=Fraction(0))
            w[part] = vector * Fraction(2) ** max(0, _exponent(factor) + 2)
        return self._outcome(True, w, first)

    def _outcome(self, stable: bool, w: Rationals, first: int) -> Outcome:
        parts = []
        for kind in (0, 1):
            out = np.full(self.model.totals[kind], Fraction(0), dtype=object)
            for frames, places in zip(self.frames, self.model.places, strict=True):
                left, right = frames[kind]
                own = w[places[kind] + kind * self.split]
                out[places[kind]] = own @ (left if stable else right.T)
            parts.append(out)
        return Outcome(stable, parts[0][: 0 if first else None], parts[1])

    def _parts(self, first: int) -> list[Index]:
        """Strongly connected sets of coordinates from `first` on, each after all those that it influences."""
        rows, columns = np.nonzero(self.M[first:, first:])
        size = len(self.M)
        at = (self.group[rows + first], self.group[columns + first])
        graph = sp.csr_array((np.ones(len(rows)), at), shape=(size, size))
        label = connected_components(graph, directed=True, connection="strong")[1][self.group]
        after: dict[int, set[int]] = {int(k): set() for k in label[first:]}
        for target, source in zip(label[at[0]].tolist(), label[at[1]].tolist(), strict=True):
            if target != source:
                after[source].add(target)
        return [np.flatnonzero(label == k) for k in TopologicalSorter(after).static_order()]

    def _cone(self, part: Index) -> _PartCone:
        heads = [int(k) for k in part if self.group[k] == k]
        return _PartCone([self.cones.get(k) for k in heads])


class _PartCone:
    """A product of half-lines (None) and cones, with its generators and facets as integers."""

    def __init__(self, factors: list[Cone | None]) -> None:
        self.factors = factors
        one = np.ones((1, 1), dtype=object)
        self.rays = _block_diagonal([one if c is None else _rows(on.rays(c)) for c in factors])
        self.facets = _block_diagonal([one if c is None else _rows(on.facets(c)) for c in factors])

    def whole(self) -> Cone:
        """As a cone."""
        return product([orthant(1) if c is None else c for c in self.factors])


def _decide_part(S: Rationals, cone: _PartCone) -> tuple[bool, Rationals] | None:
    """Whether a cross-positive matrix is stable, with v (v'S < 0 on the cone) or x (S x in the cone)."""
    if len(S) == 1:
        return bool(S[0, 0] < 0), np.array([Fraction(1)], dtype=object)
    c, d = cone.facets.sum(axis=0), cone.rays.sum(axis=0)
    found = _bordered(S, d, c)
    if found is not None:
        x, t = found
        if t <= 0 and (cone.facets @ x >= 0).all():
            return False, x if t == 0 else _shortened(x, lambda z: _inside(cone.facets, z, S @ z))
        mirrored = _bordered(S.T, c, d) if t > 0 else None
        if mirrored is not None and _inside(cone.rays, mirrored[0], -(mirrored[0] @ S), strict=True):
            return True, _shortened(mirrored[0], lambda v: _inside(cone.rays, v, -(v @ S), strict=True))
    size = Fraction(2) ** _exponent(max(abs(Fraction(value)) for value in S.ravel()))
    try:
        return decide_exactly(Matrix.from_fractions(S / size), cone.whole(), False)
    except DataError:  # numbers further apart than doubles can be
        return None


def _inside(rows: Rationals, *vectors: Rationals, strict: bool = False) -> bool:
    values = [rows @ vector for vector in vectors]
    return all(bool((z > 0).all() if strict else (z >= 0).all()) for z in values) and bool(vectors[0].any())


def _bordered(S: Rationals, d: Rationals, c: Rationals) -> tuple[Rationals, Fraction] | None:
    """x and t with S x + t d = 0 and c'x = 1, or None."""
    size = len(S)
    K = np.zeros((size + 1, size + 1), dtype=object)
    K[:size, :size], K[:size, size], K[size, :size] = S, d, c
    scale = [lcm(*(Fraction(value).denominator for value in row)) for row in K]
    integers = np.array([[int(value * k) for value in row] for row, k in zip(K, scale, strict=True)], dtype=object)
    solved = solve_by_lifting(integers, np.array([0] * size + scale[-1:], dtype=object))
    if solved is None:
        return None
    numerators, denominator = solved
    out = np.array([Fraction(int(value), denominator) for value in numerators], dtype=object)
    return out[:size], out[size]


def _shortened(vector: Rationals, holds: Callable[[Rationals], bool]) -> Rationals:
    """The vector with as few binary digits as it takes."""
    for digits in _DIGITS:
        short = np.array([_rounded(value, digits) for value in vector], dtype=object)
        if holds(short):
            return short
    return vector


def _rounded(value: Fraction, digits: int) -> Fraction:
    unit = Fraction(2) ** (_exponent(abs(value)) - digits)
    return round(value / unit) * unit


def _exponent(value: Fraction) -> int:
    """About the binary logarithm of a number that is not negative."""
    return value.numerator.bit_length() - value.denominator.bit_length() if value else -10


def _frame(cone: Cone) -> tuple[Rationals, Rationals]:
    """Matrices into and out of coordinates in which a simplicial cone is an orthant; identities for others."""
    if not cone.is_simplicial:
        eye = np.eye(cone.dim, dtype=int).astype(object)
        return eye, eye
    rays = _rows(on.rays(cone))
    normals, heights = opposite_facets(cone, rays)
    return normals / heights[:, None], rays.T


def _rows(m: Matrix) -> Rationals:
    return m.rows_as_integers(np.arange(m.shape[0]))


def _block_diagonal(blocks: list[Rationals]) -> Rationals:
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)), dtype=object)
    i = j = 0
    for b in blocks:
        out[i : i + len(b), j : j + b.shape[1]] = b
        i, j = i + len(b), j + b.shape[1]
    return out
