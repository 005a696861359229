"""A common cone for a family A_1..A_M: linear programs that move the rays, from many starts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import cached_property

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...cards import raised
from ...exact.budget import OutOfBudgetError, affords
from ...exact.matrix import Matrix
from ...proof.proposed_weights import pointing_functional
from ...theorems.lyapunov_candidates import common_vector
from ..certificate import ConeCertificate
from ..generators import extreme_generators
from ..one_matrix.explicit import modal_cone
from ..one_matrix.modes import Analysis, Modes, balancing_units, dominant_index, modes
from ..proven import Proven
from ..question import Candidate, Question
from .descent import moving_descent, simplicial_descent
from .flags import flag_orthants

Array = NDArray[np.float64]

# A search that comes that close may have found a cone without margin, whose generators are simple fractions.
NEARLY = 1e-5
_DENOMINATORS = (1, 12, 1000)


class FamilySearch:
    """Searches from many starts.

    Attributes
    ----------
    best : float
        Largest margin that any start reached.
    """

    def __init__(self, question: Question) -> None:
        values = np.asarray(question.searched.values)
        self.question, self.units = question, balancing_units(np.abs(values).max(axis=0))
        self.balanced = values * self.units / self.units[:, None]
        self.best = -np.inf

    @cached_property
    def analyses(self) -> list[Analysis]:
        """Every matrix with its modes, in units where all together are balanced."""
        matrices, discrete = self.question.searched, self.question.discrete
        return [
            Analysis(matrices[s], A, self.units, discrete, modes(A, discrete=discrete))
            for s, A in enumerate(self.balanced)
        ]

    def shortfall(self, fewest_rays: int) -> str:
        """What a search without success says."""
        if self.best > -NEARLY:  # some start came close to a cone
            error = raised(max(-self.best, 0.0), 1)
            return (
                f"Rays were found that all matrices keep, as computed, up to {error}, but the numbers leave no "
                "margin for a proof. If such a cone is meant to exist, give exact data (fractions), else a smaller "
                "family."
            )
        return f"{self.question.at_least(fewest_rays)} More restarts, another seed or more time may help."

    def modes_in_user_units(self) -> list[Modes | None]:
        """Modes of every matrix as it was given."""
        return [
            m and Modes(m.dominant, m.right * self.units, m.left / self.units, m.others, m.bases, m.conditioning)
            for m in (a.modes for a in self.analyses)
        ]

    def candidates(self) -> Iterator[Candidate]:
        """Orthants in exact coordinates; rays moved from each start until all matrices keep their cone, or nearly."""
        question, discrete = self.question, self.question.discrete
        yield from flag_orthants(question)
        known = [d for d in map(_directions, self.analyses) if d is not None]
        if not known:
            return
        normal, e, w = _aligned(self.balanced, known, discrete)
        for attempt, R in enumerate(_starts(normal, e, w, question)):
            if not affords():
                question.report(f"the limit is reached after {attempt} starts")
                return
            try:
                R, margin = _moved(normal, R, w, discrete)
                self.best = max(self.best, margin)
                question.report(f"start {attempt}: {R.shape[1]} rays, margin {margin:.3g} (best {self.best:.3g})")
                if margin >= -NEARLY:
                    yield from (self._candidate(rays) for rays in _roundings(R, self.units, margin))
            except (OutOfBudgetError, np.linalg.LinAlgError):  # another start may need less, or be no singular matrix
                continue

    def _candidate(self, rays: Matrix) -> Candidate:
        values = np.asarray(rays.values)
        return Candidate(
            rays=rays,
            pointing=pointing_functional(values / self.units) / self.units,
            right_inverse=np.linalg.pinv((values / self.units).T) / self.units,
            multipliers=self._solved(rays),
            units=self.units,
        )

    def _solved(self, rays: Matrix) -> Matrix | None:
        """Multipliers of a simplicial cone, if they are well away from zero."""
        n = rays.shape[1]
        if rays.shape[0] != n:
            return None
        R = (np.asarray(rays.values) / self.units).T
        P = np.linalg.solve(R, self.balanced @ R)
        free = P[:, np.ones((n, n), dtype=bool) if self.question.discrete else ~np.eye(n, dtype=bool)]
        return Matrix(P) if free.size and free.min() > 1e-9 * np.abs(P).max() else None


def _directions(a: Analysis) -> tuple[Array, Array] | None:
    """Dominant functional and direction, of length 1; None if the dominant eigenvalue is not real."""
    if a.modes is not None:
        return a.modes.left / np.linalg.norm(a.modes.left), a.modes.right
    values, left, right = (np.asarray(x, dtype=np.complex128) for x in sl.eig(a.matrix, left=True, right=True))
    first = dominant_index(values, discrete=a.discrete)
    if values[first].imag != 0 or (a.discrete and values[first].real < 0):
        return None
    return left[:, first].real, right[:, first].real


def _moved(matrices: Array, R: Array, w: Array, discrete: bool) -> tuple[Array, float]:
    """Rays and margin after a descent from one start."""
    simplicial = R.shape[1] == R.shape[0]
    place = (
        simplicial_descent(matrices, R, discrete=discrete)
        if simplicial
        else moving_descent(matrices, R, w, discrete=discrete)
    )
    return (R, -np.inf) if place is None else (place.R, place.margin)


def completed(question: Question, found: Proven) -> Proven:
    """The same with functionals that single out each generator, and a common Lyapunov vector, if there are any."""
    rays = np.asarray(found.candidate.rays.values)
    if found.candidate.separators is None:
        with suppress(OutOfBudgetError):
            index, separators = extreme_generators(rays, found.candidate.pointing)
            if len(index) == len(rays):
                found = Proven(found.certificate, replace(found.candidate, separators=separators))
    matrices = np.asarray(question.searched.values)
    v = common_vector(matrices, rays, np.zeros(matrices.shape), discrete=question.discrete)
    if v is None:
        return found
    certificate = ConeCertificate.settle(**{**found.certificate.data(), "v": v})
    return Proven(certificate, found.candidate) if certificate else found


def _aligned(matrices: Array, known: list[tuple[Array, Array]], discrete: bool) -> tuple[Array, Array, Array]:
    """Matrices shifted and scaled to size one; mean dominant direction and functional of those known."""
    towards = known[0][1]
    sides = [1.0 if functional @ towards >= 0 else -1.0 for functional, _ in known]
    left = np.mean([side * functional for side, (functional, _) in zip(sides, known, strict=True)], axis=0)
    right = np.mean([side * direction for side, (_, direction) in zip(sides, known, strict=True)], axis=0)
    values = np.linalg.eigvals(matrices)
    top = np.where(discrete, np.abs(values), values.real).max(axis=1)[:, None, None]
    if discrete:
        scaled = matrices / np.where(top > 0, top, 1.0)
    else:
        scaled = matrices - top * np.eye(matrices.shape[-1])
        scaled = scaled / np.maximum(np.abs(scaled).max(axis=(1, 2), keepdims=True), 1e-300)
    height = float(left @ right)
    return scaled, right / (height if height > 0 else 1.0), left


def _starts(matrices: Array, e: Array, w: Array, question: Question) -> Iterator[Array]:
    """Generators to begin with: the orthant, cones of the mean matrix, and random simplices around e."""
    n, rng = len(e), np.random.default_rng(question.seed)
    most = question.max_rays or 3 * n + 4
    yield np.eye(n)
    mean = modes(matrices.mean(axis=0), discrete=question.discrete)
    cone = None if mean is None else modal_cone(mean, discrete=question.discrete, max_rays=most)
    if cone is not None and not (w @ cone.R > 0).all():
        cone = None
    if cone is not None and cone.R.shape[1] == n:
        yield cone.R
    centre = e if w @ e > 0 else w / (w @ w)
    for k in range(question.restarts):
        if k == 3 and cone is not None and cone.R.shape[1] > n:
            yield cone.R
        extra = 0 if n < 3 or k % 4 < 3 else 1 + int(rng.integers(0, max(1, min(n, most - n))))
        basis = np.eye(n) if mean is None or k % 2 else np.column_stack([mean.right, *mean.bases])
        flat = basis[:, 1:] - np.outer(centre, w @ basis[:, 1:]) / (w @ centre)
        corners = _corners(n - 1, min(n + extra, most), rng)
        size = (3.0, 1.0, 10.0)[k % 3]
        yield centre[:, None] + size * flat @ corners


def _corners(dim: int, count: int, rng: np.random.Generator) -> Array:
    """Corners of a random regular simplex, or of a random polytope around 0 with more corners."""
    if dim == 0:
        return np.zeros((0, 1))
    if count == dim + 1:
        simplex = np.linalg.svd(np.eye(count) - 1 / count)[0][:, :dim].T
    else:
        points = rng.standard_normal((dim, count))
        simplex = points / np.linalg.norm(points, axis=0)
        simplex = simplex - simplex.mean(axis=1, keepdims=True)
    turn = np.linalg.qr(rng.standard_normal((dim, dim)))[0]
    return turn @ simplex


def _roundings(R: Array, units: Array, margin: float) -> Iterator[Matrix]:
    """The generators as doubles, and as simple fractions where there is no margin to spare."""
    rays = (R / np.abs(R).max(axis=0)).T * units
    if margin > 1e-9:
        yield Matrix(np.ascontiguousarray(rays))
    if margin < 1e-6:
        for most in _DENOMINATORS:
            scaled = rays / np.abs(rays).max(axis=1, keepdims=True)
            rows = [[Fraction(float(x)).limit_denominator(most) for x in row] for row in scaled]
            if np.linalg.matrix_rank(np.array(rows, dtype=float)) == rays.shape[1]:
                yield Matrix.from_fractions(np.array(rows, dtype=object))
