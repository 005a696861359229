"""A proper polyhedral cone for one matrix: what to try, in which order.

1. The modes of A and polygons, where eigenvectors are well conditioned (`explicit`).
2. The same for a neighbouring matrix with better conditioned ones, where they are not.
3. The same in coordinates close to the modes.  Computed in floating point, eigenvectors of condition number k are
   wrong by about |A| k / gap units in the last place, which for k = 1e7 can be all of them.  Rounded, they are still
   a basis V, known exactly, and T = V^-1 A V is nearly diagonal, with well conditioned eigenvectors.  Iterative
   refinement with the residual A V - V T in exact arithmetic gives every entry of T to almost full precision.  A cone
   R for T becomes the cone V R for A, with the same P; V R is kept exactly, since rounding it would move it by k
   units in the last place.
4. The orthant, and exact rational modes, where A has several dominant eigenvalues (`rational_modes`; irrational
   ones: `repeated`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import affords, spend
from ...exact.matrix import Matrix
from ...exact.products import as_doubles, exact_product, summed_products
from ...proof.proposed_weights import multipliers
from ..question import Candidate, Question
from .explicit import LARGE, ModalCone, fewest_rays, modal_cone
from .modes import PER_CUBE, Modes, balanced, dominant_index, eigenbasis, modes
from .rational_modes import rational_cones

Array = NDArray[np.float64]

# Beyond this, a neighbouring matrix with better eigenvectors is tried, and then A in coordinates close to its own.
_WELL_CONDITIONED = 1e4
_SPREADS = (0.3, 0.5, 0.7, 0.15)
# Rounds of iterative refinement, and operations of an exact product divided by n^3.
_ROUNDS, _PER_EXACT_PRODUCT = 6, 100.0
# Relative distance to which rounding may move copies of a repeated eigenvalue.
_SPLIT = 1e-4


@dataclass(frozen=True, eq=False)
class Analysis:
    """A in balanced units, with its modes.

    Attributes
    ----------
    A : Matrix, shape (n, n)
    matrix : ndarray, shape (n, n)
        diag(units)^-1 A diag(units), up to rounding.
    units : ndarray, shape (n,)
    discrete : bool
    modes : Modes or None
        Of `matrix`.
    """

    A: Matrix
    matrix: Array
    units: Array
    discrete: bool
    modes: Modes | None

    @property
    def is_well_conditioned(self) -> bool:
        """Whether the modes are known and may be used as they are."""
        return self.modes is not None and self.modes.conditioning < _WELL_CONDITIONED

    @cached_property
    def near_modes(self) -> tuple[Array, Array] | None:
        """A basis V close to eigenvectors of A, and T = V^-1 A V accurately.

        None if V is numerically singular, or the effort left is too little for exact products.
        """
        effort = _ROUNDS * _PER_EXACT_PRODUCT * len(self.matrix) ** 3
        basis = eigenbasis(self.matrix)
        if not np.linalg.cond(basis) < 1e12 or not affords(effort):
            return None
        spend(effort)
        V = basis * self.units[:, None]
        exact, inverse = Matrix(V), np.linalg.inv(basis) / self.units
        T, last = np.zeros_like(V), np.inf
        for _ in range(_ROUNDS):
            rest = as_doubles(*summed_products([(self.A, Matrix(V.T)), (exact, Matrix(-T.T))]))
            with np.errstate(over="ignore", invalid="ignore"):
                change = inverse @ rest
                size = float(np.abs(change).max())
            if not size < last:
                break
            T, last = T + change, size
        return (V, T) if np.isfinite(T).all() else None

    @cached_property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues, accurate as long as the condition number of the eigenvectors is below 1e12."""
        m = self.modes
        if m is not None and m.conditioning < _WELL_CONDITIONED:
            return np.concatenate([[m.dominant], m.others, m.others[m.others.imag > 0].conj()])
        simple = m is None and np.linalg.cond(eigenbasis(self.matrix)) < _WELL_CONDITIONED
        near = None if simple else self.near_modes
        return np.linalg.eigvals(self.matrix if near is None else near[1]).astype(np.complex128)

    @cached_property
    def fewest_rays(self) -> int:
        """Least number of rays (and of facets) of an invariant polyhedral cone, from the spectrum."""
        values = self.eigenvalues
        first = dominant_index(values, discrete=self.discrete)
        rest = values[np.arange(len(values)) != first]
        # Rounding turns a repeated eigenvalue into pairs close to it, which bound nothing.
        rest = rest[np.abs(rest - values[first]) > _SPLIT * np.abs(values).max()]
        size = float(abs(values[first])) if self.discrete else float(values[first].real)
        return fewest_rays(rest[rest.imag > 0], size, len(values))


def analysis(A: Matrix, *, discrete: bool) -> Analysis:
    """Units and modes of a matrix: one dense eigenvalue decomposition."""
    matrix, units = balanced(A)
    return Analysis(A, matrix, units, discrete, modes(matrix, discrete=discrete))


def candidates(question: Question, a: Analysis) -> Iterator[Candidate]:
    """Cones worth proving, the most economic first."""
    well_conditioned, most = a.is_well_conditioned, question.max_rays
    for cone in modal_cones(a.matrix, a.modes, discrete=a.discrete, max_rays=most):
        yield from _of_modal_cone(cone, a.units, programs=well_conditioned or cone.multipliers is None)
    if not well_conditioned and a.near_modes is not None:
        yield from _near_modes(a, *a.near_modes, max_rays=most)
    n = len(a.matrix)
    if question.admits(n) and (a.matrix + (0 if a.discrete else np.diag(np.full(n, np.inf))) >= 0).all():
        P = Matrix.stack([a.A])
        yield Candidate(rays=Matrix.identity(n), pointing=np.ones(n), right_inverse=np.eye(n), multipliers=P)
    for rays, pointing in rational_cones(a.A, discrete=a.discrete):
        if question.admits(rays.shape[0]):
            inverse = np.linalg.pinv(np.asarray(rays.values).T)
            yield Candidate(rays=rays, pointing=pointing, right_inverse=inverse)


def modal_cones(A: Array, m: Modes | None, *, discrete: bool, max_rays: int | None) -> Iterator[ModalCone]:
    """Cones from the modes of A, or of a matrix near A where those are ill-conditioned, the most economic first."""
    if m is not None and m.conditioning < _WELL_CONDITIONED:
        found = modal_cone(m, discrete=discrete, max_rays=max_rays)
        if found is not None:
            yield found
            return
    for part in _SPREADS:
        near = modes(spread(A, part, discrete=discrete), discrete=discrete)
        if near is None or not near.conditioning < (0.1 * m.conditioning if m is not None else np.inf):
            continue
        # Multipliers for A itself take a linear program for each generator.
        found = modal_cone(near, discrete=discrete, max_rays=min(max_rays or LARGE, LARGE))
        if found is not None:
            yield ModalCone(found.R, found.pointing, None, found.separators)


def spread(A: Array, part: float, *, discrete: bool) -> Array:
    """A with its other eigenvalues moved towards the dominant one, each by a different part of its gap.

    A (nearly) defective A has no usable eigenvectors; a neighbour with less decay has, and its cone is one for A
    as well.  The dominant eigenvector stays.
    """
    spend(PER_CUBE * len(A) ** 3)
    values = np.linalg.eigvals(A).astype(np.complex128)
    top = values[dominant_index(values, discrete=discrete)].real
    near = 1e-6 * float(np.abs(values).max(initial=0.0))
    T, Z, _ = sl.schur(A, output="real", sort=lambda re, im: abs(re - top) <= near and abs(im) <= near)
    n = len(T)
    k = 1
    while k < n:
        size = 2 if k + 1 < n and T[k + 1, k] != 0 else 1
        at = slice(k, k + size)
        block = T[at, at]
        amounts = part * np.arange(k + 1, k + size + 1) / n
        value = complex(np.linalg.eigvals(block)[0])
        gap = top - (abs(value) if discrete else value.real)
        if value.real >= 0 or not discrete:
            nearly_real = abs(value.imag) < 0.1 * part * gap
            T[at, at] = block + gap * np.diag(amounts if nearly_real else amounts[:1].repeat(size))
        else:
            T[at, at] = block * (1 + amounts[0] * gap / abs(value))
        k += size
    return Z @ T @ Z.T


def _of_modal_cone(cone: ModalCone, units: Array, *, programs: bool) -> Iterator[Candidate]:
    """A cone in the user's units: with its own multipliers, then with those of linear programs."""
    own = Candidate(
        rays=Matrix(np.ascontiguousarray(cone.R.T * units)),
        pointing=cone.pointing / units,
        right_inverse=cone.right_inverse / units,
        multipliers=cone.stacked_multipliers,
        separators=None if cone.separators is None else cone.separators / units,
        units=units,
    )
    if own.multipliers is not None:
        yield own
    if programs and cone.R.shape[1] <= LARGE:
        yield replace(own, multipliers=None, right_inverse=np.linalg.pinv(cone.R) / units)


def _near_modes(a: Analysis, V: Array, T: Array, *, max_rays: int | None) -> Iterator[Candidate]:
    """Cones found for T = V^-1 A V."""
    inverse = np.linalg.inv(V / a.units[:, None]) / a.units
    for cone in modal_cones(T, modes(T, discrete=a.discrete), discrete=a.discrete, max_rays=max_rays):
        R, P = Matrix(np.ascontiguousarray(cone.R.T)), cone.stacked_multipliers
        if P is None:
            found = multipliers(Matrix(T), R, cone.pointing, discrete=a.discrete)
            if found is None:
                continue
            P = Matrix.stack([found])
        yield Candidate(
            rays=exact_product(R, Matrix(V)),
            pointing=cone.pointing @ inverse,
            right_inverse=cone.right_inverse @ inverse,
            multipliers=P,
            separators=None if cone.separators is None else cone.separators @ inverse,
            units=a.units,
        )
