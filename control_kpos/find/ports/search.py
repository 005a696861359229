"""An invariant cone for one matrix that holds given vectors and lies in given half-spaces.

Tried in this order: the orthant; chains through a vector in rational arithmetic, first where orbits would start along a
boundary or where the dominant eigenvalue is repeated; orbits into a core (`orbit`).

Chains, for matrices with rational eigenvalues:

    g_0 = b,   g_(k+1) = (A - m_k I) g_k     so that     A g_k = m_k g_k + g_(k+1)

for the eigenvalues m_0..m_(n-1) in any order: A annihilates what comes after g_(n-1), so the cone of the g_k is
invariant (Cumani, 1982).  It lies in c'x >= 0 if c'g_k >= 0 for all k.  Nothing is rounded: repeated eigenvalues and
zeros of any relative degree are no trouble.

In discrete time A^k b may touch half-spaces at any k: A g_k = g_(k+1) is kept exactly up to the last step, which ends
in the core.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice, permutations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import spend
from ...exact.linalg import Rationals, solve_columns
from ...exact.matrix import Matrix
from ...exact.polynomials import rational_roots
from ...proof.proposed_weights import Frame, nonnegative_combination
from ..generators import extreme_generators
from ..impossible.existence import spectrum_polynomial
from ..one_matrix.modes import Analysis
from ..question import Candidate, Question
from .assembly import Assembly, Path, assemble
from .core import Core, Split, core_inside, split
from .orbit import Flow, first_steps, flow, follow, step_bounds, steps_on_boundary

Array = NDArray[np.float64]

# Generators are tested for redundancy up to this number, times the dimension; each test is a linear program.
_PRUNED = 1600
# The dynamics are followed with gaps reduced by this part of the smallest one.
_REDUCTIONS = (1e-4, 1e-3, 1e-5)
# Lengths of steps along a boundary, as parts of the longest sensible one.
_FIRST = (0.5, 0.1, 0.02, 0.004)
# Exact steps in discrete time, which may touch half-spaces.
_POWERS = 400
# States, and orders of the eigenvalues, above which no more chains are tried.
_LARGEST, _ORDERS = 16, 200


def candidates(question: Question, a: Analysis) -> Iterator[Candidate]:
    """Cones worth proving: with those first that are likely to be found at little cost."""
    search = _Search(question, a)
    on_boundary = [steps_on_boundary(a.A, search.vectors[[j]], search.normals) for j in range(len(search.b))]
    s = split(a.matrix, a.modes, discrete=a.discrete)
    attempts = [search.orthant(), search.orbits(s, on_boundary), search.chains()]
    if s is None or any(on_boundary):
        attempts[1:] = attempts[:0:-1]
    for attempt in attempts:
        yield from attempt


class _Search:
    """The question in balanced units, and several ways to answer it."""

    def __init__(self, question: Question, a: Analysis) -> None:
        self.vectors, self.normals = question.ports
        self.question, self.A, self.discrete = question, a.A, a.discrete
        self.matrix, self.units = a.matrix, a.units
        self.b, self.c = np.asarray(self.vectors.values) / self.units, np.asarray(self.normals.values) * self.units

    def orthant(self) -> Iterator[Candidate]:
        """The orthant, on which zeros of A, B and C are no trouble: P = A."""
        n = self.question.dim
        if self.question.admits(n):
            eye = np.eye(n)
            yield Candidate(
                rays=Matrix(eye),
                pointing=np.ones(n),
                right_inverse=eye,
                multipliers=Matrix.stack([self.A]),
                combinations=self._combinations(self.vectors),
                separators=1.0 - 2.0 * eye,
                units=self.units,
            )

    def _combinations(self, found: Matrix) -> Matrix | None:
        return found if self.vectors.values.shape[0] else None

    def chains(self) -> Iterator[Candidate]:
        """Simplicial cones in rational arithmetic."""
        if not self.question.admits(self.question.dim):
            return
        for rays, P, combinations in _rational_chains(self.A, self.vectors, self.normals, self.discrete):
            values = np.asarray(rays.values)
            if np.linalg.matrix_rank(values / self.units) < len(values):
                continue
            inverse = np.linalg.inv((values / self.units).T) / self.units
            heights = inverse.sum(axis=0)
            yield Candidate(
                rays=rays,
                pointing=heights,
                right_inverse=inverse,
                multipliers=Matrix.stack([P]),
                combinations=self._combinations(combinations),
                separators=heights - 2.0 * inverse * (heights @ values.T).max(),
                units=self.units,
            )

    def orbits(self, s: Split | None, on_boundary: list[int]) -> Iterator[Candidate]:
        """Orbits of the vectors and a core."""
        if s is None:
            return
        if np.sign(self.c @ s.right).sum() + np.sign(self.b @ s.left).sum() < 0:
            s = s.turned()
        for paths, built in self._proposals(s, on_boundary):
            candidate = self._exactly(built, paths, s)
            if self.question.admits(candidate.rays.shape[0]):
                yield candidate

    def _proposals(self, s: Split, on_boundary: list[int]) -> Iterator[tuple[list[Path], Assembly]]:
        """Paths of all vectors into a core, and what they make together."""
        to_split = np.asarray(np.linalg.inv(s.basis).T, dtype=np.float64)
        c, b = self.c @ s.basis, self.b @ to_split
        if not ((c[:, 0] > 0).all() and (b[:, 0] > 0).all()):
            return
        core = core_inside(s, c, b, discrete=self.discrete)
        if core is None:
            return
        for reduction in _REDUCTIONS:
            spend(s.S.size)
            f = flow(s, reduction, discrete=self.discrete)
            paths = self._paths(f, c, core, to_split, on_boundary)
            if paths is not None:
                yield paths, assemble(f, paths, core)

    def _paths(self, f: Flow, c: Array, core: Core, to_split: Array, on_boundary: list[int]) -> list[Path] | None:
        """A path into the core for every vector, or None."""
        lengths = np.array(_FIRST if any(on_boundary) else _FIRST[:1])
        if any(on_boundary) and not f.discrete:
            lengths = lengths * step_bounds(f.S, c).longest
        attempts = [(on_boundary, length) for length in lengths[: 1 if f.discrete else None]]
        if f.discrete:
            attempts.append(([self._powers(f, core, b, to_split) for b in self.b], 1.0))
        for counts, length in attempts:
            paths: list[Path] = []
            for j, count in enumerate(counts):
                vector = self.vectors[np.array([j])]
                first = first_steps(self.A, vector, count, float(length), f.dominant, discrete=f.discrete)
                head = (np.asarray(first.points.values) / self.units) @ to_split
                orbit = follow(f, head[-1], c, core)
                if orbit is None:
                    break
                paths.append(Path(np.concatenate([head[:-1], orbit.points]), first, orbit))
            if len(paths) == len(counts):
                return paths
        return None

    def _powers(self, f: Flow, core: Core, b: Array, to_split: Array) -> int:
        """k for which one more step from A^k b ends in the core: up to there b, A b, .. may be kept exactly."""
        for k in range(_POWERS):
            size = float(np.abs(b).max())
            if size == 0 or core.holds((f.S @ (b @ to_split))[None])[0]:
                return k
            b = self.matrix @ (b / size)
        return 0

    def _exactly(self, built: Assembly, paths: list[Path], s: Split) -> Candidate:
        """Generators in the user's coordinates, the vectors themselves among them, none redundant."""
        values = built.points @ s.basis.T
        rays, kept = self._rays(values, built, paths)
        index, separators = np.arange(len(values)), None
        P, combinations = built.P, built.combinations
        if values.size <= _PRUNED:
            index, separators = extreme_generators(values, s.left, kept)
            P, changed = _substituted(values, P, index, s.left)
            combinations, separators = combinations @ changed.T, separators / self.units
        R = values[index].T
        # What is known exactly stays: columns without residual, vectors that are generators themselves.
        column, own = built.exact[index], np.isin(built.starts, index)[:, None]
        unheld = np.where(own, 0.0, self.b - combinations @ R.T)
        residual = np.where(column, 0.0, self.matrix @ R - (P.T @ R.T).T)
        support = built.support if sp.issparse(P) else np.arange(len(index))
        inverse = np.linalg.pinv(R[:, support])
        combinations[:, support] += unheld @ inverse.T
        correction = inverse @ residual
        if sp.issparse(P):
            to = sp.csr_array(
                (np.ones(len(support)), (support, np.arange(len(support)))), shape=(len(index), len(support))
            )
            P = sp.csr_array(P + to @ sp.csr_array(correction))
        else:
            P = P + correction
        kept_rays = rays[index]
        in_units = (np.asarray(kept_rays.values) / self.units).T
        right_inverse = np.zeros(in_units.T.shape)
        right_inverse[support] = np.linalg.pinv(in_units[:, support])
        return Candidate(
            rays=kept_rays,
            pointing=s.left / self.units,
            right_inverse=right_inverse / self.units,
            multipliers=Matrix(P) if sp.issparse(P) else Matrix(P[None]),
            combinations=self._combinations(Matrix(combinations)),
            separators=separators,
            units=self.units,
        )

    def _rays(self, values: Array, built: Assembly, paths: list[Path]) -> tuple[Matrix, NDArray[np.bool_]]:
        """Exact generators, and which of them must stay because others are exact combinations of them."""
        rows, kept, at = [], np.zeros(len(values), dtype=bool), 0
        for path, row in zip(paths, built.starts, strict=True):
            if row < 0:
                continue
            known = path.first.points
            rows += [Matrix(values[at:row] * self.units), known]
            at = row + known.shape[0]
            kept[row:at] = path.count > 0
        return Matrix.join([*rows, Matrix(values[at:] * self.units)], -2), kept


def _substituted(values: Array, P: Array, index: NDArray[np.intp], pointing: Array) -> tuple[Array, Array]:
    """Multipliers after dropping generators that are combinations of the others, and these combinations.

    Returns
    -------
    P : ndarray, shape (p, p)
    combinations : ndarray, shape (p, N)
        Every generator as a combination of the kept ones.
    """
    combinations = np.zeros((len(index), len(values)))
    combinations[np.arange(len(index)), index] = 1.0
    dropped = np.setdiff1d(np.arange(len(values)), index)
    frame = Frame.of(values[index], pointing) if dropped.size else None
    if frame is not None:
        for j in dropped:
            target = frame.to @ values[j]
            q, _ = nonnegative_combination(frame, target, size=float(np.abs(target).max()) or 1.0)
            combinations[:, j] = np.maximum(q, 0.0) / frame.heights
    return combinations @ P[:, index], combinations


def _rational_chains(
    A: Matrix, vectors: Matrix, normals: Matrix, discrete: bool
) -> Iterator[tuple[Matrix, Matrix, Matrix]]:
    """Rays, multipliers, and all vectors as combinations of the rays, of simplicial cones in all half-spaces."""
    n = A.shape[0]
    if n > _LARGEST:
        return
    roots = rational_roots(spectrum_polynomial(A), np.linalg.eigvals(A.values))
    if len(roots) < n or (discrete and min(roots) < 0):
        return
    M, B = A.fractions(), vectors.fractions()
    C = Matrix.from_fractions(normals.rows_as_integers(np.arange(normals.shape[0]))).fractions()
    for order in _orders(roots):
        for b in B:
            R = _chain(M, b, order, C)
            combinations = None if R is None else solve_columns(R.T, B.T)
            if R is not None and combinations is not None and (combinations >= 0).all():
                P = np.diag(np.array(order, dtype=object)) + np.eye(n, k=-1, dtype=int).astype(object)
                exact = Matrix.from_fractions
                yield exact(R), exact(P), exact(combinations.T)


def _orders(roots: list[Fraction]) -> Iterator[tuple[Fraction, ...]]:
    """Different orders of the eigenvalues, monotone ones first."""
    falling = tuple(sorted(roots, reverse=True))
    seen = {falling, falling[::-1]}
    yield from sorted(seen, reverse=True)
    for order in islice(permutations(falling), 5 * _ORDERS):
        if order not in seen and len(seen) < _ORDERS:
            seen.add(order)
            yield order


def _chain(M: Rationals, b: Rationals, order: tuple[Fraction, ...], C: Rationals) -> Rationals | None:
    """The vectors g_k as rows, or None if they leave a half-space or end too early."""
    rows = [b]
    for root in order[:-1]:
        rows.append(M @ rows[-1] - root * rows[-1])
    R = np.array(rows, dtype=object)
    if not all(row.any() for row in R) or (len(C) and (C @ R.T < 0).any()):
        return None
    return R
