"""A proper polyhedral cone for one matrix: what to try, in which order.

1. The modes of A and polygons, where eigenvectors are well conditioned (`explicit`).
2. The same for a neighbouring matrix with better conditioned ones, where they are not.
3. The same in coordinates close to the modes.  Computed in floating point, eigenvectors of condition number k are
   wrong by about |A| k / gap units in the last place, which for k = 1e7 can be all of them.  Rounded, they are still
   a basis V, known exactly, and T = V^-1 A V is nearly diagonal, with well conditioned eigenvectors.  Iterative
   refinement with the residual A V - V T in exact arithmetic gives every entry of T to almost full precision.  A cone
   R for T becomes the cone V R for A, with the same P; V R is kept exactly, since rounding it would move it by k
   units in the last place.
4. The orthant, and exact rational modes, where A has several dominant eigenvalues (`rational_modes`; repeated ones:
   `repeated`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import spend
from ...exact.matrix import Matrix
from ...exact.products import exact_product
from ...proof.proposed_weights import multipliers
from ..question import Candidate, Question
from .explicit import LARGE, ModalCone, modal_cone
from .modes import PER_CUBE, WELL_CONDITIONED, Analysis, Modes, dominant_index, modes
from .rational_modes import rational_cones

Array = NDArray[np.float64]

_SPREADS = (0.3, 0.5, 0.7, 0.15)


def candidates(question: Question, a: Analysis) -> Iterator[Candidate]:
    """Cones worth proving, the most economic first."""
    well_conditioned = a.modes is not None and a.modes.conditioning < WELL_CONDITIONED
    most = question.max_rays
    for cone in modal_cones(a.matrix, a.modes, discrete=a.discrete, max_rays=most):
        yield from _of_modal_cone(cone, a.units, programs=well_conditioned or cone.multipliers is None)
    if not well_conditioned and a.near_modes is not None:
        yield from _near_modes(a, *a.near_modes, max_rays=most)
    n = len(a.matrix)
    if question.admits(n) and (a.matrix + (0 if a.discrete else np.diag(np.full(n, np.inf))) >= 0).all():
        P = Matrix.stack([a.A])
        yield Candidate(rays=Matrix.identity(n), pointing=np.ones(n), right_inverse=np.eye(n), multipliers=P)
    for rays, pointing in rational_cones(a.A) if a.discrete else ():
        if question.admits(rays.shape[0]):
            inverse = np.linalg.pinv(np.asarray(rays.values).T)
            yield Candidate(rays=rays, pointing=pointing, right_inverse=inverse)


def modal_cones(A: Array, m: Modes | None, *, discrete: bool, max_rays: int | None) -> Iterator[ModalCone]:
    """Cones from the modes of A, or of a matrix near A where those are ill-conditioned, the most economic first."""
    if m is not None and m.conditioning < WELL_CONDITIONED:
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


def _of_modal_cone(cone: ModalCone, units: Array, *, programs: bool) -> list[Candidate]:
    """A cone in the user's units: with its own multipliers, then with those of linear programs."""
    own = Candidate(
        rays=Matrix(np.ascontiguousarray(cone.R.T * units)),
        pointing=cone.pointing / units,
        right_inverse=cone.right_inverse / units,
        multipliers=cone.stacked_multipliers,
        separators=None if cone.separators is None else cone.separators / units,
        units=units,
    )
    found = [] if own.multipliers is None else [own]
    if programs and cone.R.shape[1] <= LARGE:
        found.append(replace(own, multipliers=None, right_inverse=np.linalg.pinv(cone.R) / units))
    return found


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
