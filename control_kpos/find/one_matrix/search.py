"""A proper polyhedral cone for one matrix: what to try, in which order.

1. The modes of A and polygons, where eigenvectors are well conditioned (`explicit`).
2. The same for a neighbouring matrix with better conditioned ones, where they are not.
3. The same in coordinates close to the modes (`preconditioned`).
4. The orthant, and exact rational modes, where A has several dominant eigenvalues (`rational_modes`; irrational
   ones: `repeated`).
Every candidate is put to the proof; the first one proven wins.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...exact.budget import require_seconds
from ...exact.matrix import Matrix
from ...exact.products import exact_product
from ...proof.multipliers import multipliers
from ..certificate import ConeCertificate
from .explicit import LARGE, Candidate, modal_cone
from .modes import (
    SECONDS_PER_CUBE,
    Modes,
    dominant_index,
    eigenbasis,
    modes,
)
from .preconditioned import modal_coordinates
from .rational_modes import rational_cones

# Beyond the first, a neighbouring matrix with better eigenvectors is tried before A's own; beyond the
# second, A's own are of use in coordinates close to them only.
_WELL_CONDITIONED = 1e4
_ILL_CONDITIONED = 3e5
# The proof takes a few products of n x n with n x N matrices, and singular values: seconds divided by n^2 N.
_SECONDS_PER_PRODUCT = 6e-10
_SPREADS = (0.3, 0.5, 0.7, 0.15)


def balanced(A: Matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A in units where its rows and columns have similar size, and the units (powers of two).

    Returns
    -------
    matrix : ndarray, shape (n, n)
        diag(units)^-1 A diag(units).
    units : ndarray, shape (n,)
    """
    values = np.asarray(A.values)
    units = balancing_units(values)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        matrix = values * units / units[:, None]
    return (matrix, units) if np.isfinite(matrix).all() else (values, np.ones(len(values)))


def balancing_units(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Powers of two u that make row and column sizes of diag(u)^-1 A diag(u) similar (Osborne)."""
    with np.errstate(divide="ignore"):
        level = np.log2(np.abs(size))
    np.fill_diagonal(level, -np.inf)
    exponent = np.zeros(len(level))
    for _ in range(20):
        before = exponent.copy()
        for i in range(len(level)):
            row = (level[i] + exponent).max(initial=-np.inf) - exponent[i]
            column = (level[:, i] - exponent).max(initial=-np.inf) + exponent[i]
            if np.isfinite(row) and np.isfinite(column):
                exponent[i] = np.clip(exponent[i] + np.rint((row - column) / 2), -500, 500)
        if np.array_equal(before, exponent):
            break
    return np.exp2(exponent)


def eigenvalues(A: Matrix) -> NDArray[np.complex128]:
    """Eigenvalues that are accurate as long as the condition number of the eigenvectors is below 1e12."""
    matrix, units = balanced(A)
    found = None
    if not np.linalg.cond(eigenbasis(matrix)) < _WELL_CONDITIONED:
        found = modal_coordinates(A, matrix, units)
    return np.linalg.eigvals(A.values if found is None else found[1]).astype(np.complex128)


def candidates(A: NDArray[np.float64], m: Modes | None, *, discrete: bool, max_rays: int | None) -> Iterator[Candidate]:
    """Cones worth proving, the most economic first."""
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
            yield Candidate(found.R, found.pointing, None, found.separators)
    if m is not None and _WELL_CONDITIONED <= m.conditioning < _ILL_CONDITIONED:
        found = modal_cone(m, discrete=discrete, max_rays=max_rays)
        if found is not None:
            yield found


def spread(A: NDArray[np.float64], part: float, *, discrete: bool) -> NDArray[np.float64]:
    """A with its other eigenvalues moved towards the dominant one, each by a different part of its gap.

    A (nearly) defective A has no usable eigenvectors; a neighbour with less decay has, and its cone has room
    for A.  The dominant eigenvector stays.
    """
    require_seconds(SECONDS_PER_CUBE * len(A) ** 3)
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


def find_single(
    A: Matrix, *, discrete: bool, max_rays: int | None
) -> tuple[ConeCertificate, NDArray[np.float64] | None, float]:
    """Certificate (PROVED or UNDECIDED), separators and conditioning of the first proven cone."""
    matrix, units = balanced(A)
    m = modes(matrix, discrete=discrete)
    stack = Matrix.stack([A])
    well_conditioned = m is not None and m.conditioning < _WELL_CONDITIONED
    for candidate in candidates(matrix, m, discrete=discrete, max_rays=max_rays):
        programs = well_conditioned or candidate.multipliers is None
        certificate = prove(stack, candidate, units, discrete=discrete, programs=programs)
        if certificate:
            separators = None if candidate.separators is None else candidate.separators / units
            return certificate, separators, flatness(candidate.R)
    if not well_conditioned:
        for certificate, separators in _preconditioned(A, matrix, units, discrete=discrete, max_rays=max_rays):
            if certificate and certificate.rays is not None:
                return certificate, separators, flatness((certificate.rays.values / units).T)
    eye = Matrix.identity(A.shape[0])
    orthant = (matrix + (0 if discrete else np.diag(np.full(len(matrix), np.inf))) >= 0).all()
    exact = [(eye, np.ones(A.shape[0]))] if orthant else []
    for rays, pointing in chain(exact, rational_cones(A, discrete=discrete)):
        if max_rays is None or rays.shape[0] <= max_rays:
            found = prove_exactly(A, rays, pointing, discrete=discrete)
            if found[0]:
                return found
    return ConeCertificate.settle(matrices=stack, discrete=discrete), None, np.inf


def _preconditioned(
    A: Matrix,
    matrix: NDArray[np.float64],
    units: NDArray[np.float64],
    *,
    discrete: bool,
    max_rays: int | None,
) -> Iterator[tuple[ConeCertificate, NDArray[np.float64] | None]]:
    """Certificates, proven or not, of cones found for V^-1 A V, with separators."""
    found = modal_coordinates(A, matrix, units)
    if found is None:
        return
    V, T = found
    inverse = np.linalg.inv(V / units[:, None]) / units
    for candidate in candidates(T, modes(T, discrete=discrete), discrete=discrete, max_rays=max_rays):
        R = Matrix(np.ascontiguousarray(candidate.R.T))
        P = _own_multipliers(candidate) or multipliers(Matrix(T), R, candidate.pointing, discrete=discrete)
        if P is None:
            continue
        certificate = ConeCertificate.settle(
            matrices=Matrix.stack([A]),
            discrete=discrete,
            rays=exact_product(R, Matrix(V)),
            multipliers=P if P.is_sparse else Matrix.stack([P]),
            pointing=candidate.pointing @ inverse,
            right_inverse=candidate.right_inverse @ inverse,
        )
        yield certificate, None if candidate.separators is None else candidate.separators @ inverse


def prove(
    stack: Matrix, candidate: Candidate, units: NDArray[np.float64], *, discrete: bool, programs: bool
) -> ConeCertificate:
    """Put a candidate in balanced coordinates to the proof, with linear programs for P if its own will not do."""
    require_seconds(_SECONDS_PER_PRODUCT * candidate.R.size * len(units))
    rays = Matrix(np.ascontiguousarray(candidate.R.T * units))
    pointing = candidate.pointing / units
    inverse = candidate.right_inverse / units
    P = _own_multipliers(candidate)
    certificate = ConeCertificate.settle(matrices=stack, discrete=discrete)
    if P is not None:
        certificate = ConeCertificate.settle(
            matrices=stack,
            discrete=discrete,
            rays=rays,
            multipliers=P if P.is_sparse else Matrix.stack([P]),
            pointing=pointing,
            right_inverse=inverse,
        )
    if certificate or not programs or rays.shape[0] > LARGE:
        return certificate
    return _prove(stack, rays, pointing, np.linalg.pinv(candidate.R) / units, discrete=discrete)


def _own_multipliers(candidate: Candidate) -> Matrix | None:
    return None if candidate.multipliers is None else Matrix(candidate.multipliers.combined())


def prove_exactly(
    A: Matrix, rays: Matrix, pointing: NDArray[np.float64], *, discrete: bool
) -> tuple[ConeCertificate, None, float]:
    """Certificate, without separators, and conditioning of a cone that may have no margin at all."""
    require_seconds(_SECONDS_PER_PRODUCT * rays.values.size * rays.shape[1])
    values = np.asarray(rays.values).T
    certificate = _prove(Matrix.stack([A]), rays, pointing, np.linalg.pinv(values), discrete=discrete)
    return certificate, None, flatness(values)


def _prove(
    stack: Matrix,
    rays: Matrix,
    pointing: NDArray[np.float64],
    inverse: NDArray[np.float64],
    *,
    discrete: bool,
) -> ConeCertificate:
    """A certificate for generators whose multipliers are still to be found."""
    P = multipliers(stack[0], rays, pointing, discrete=discrete)
    if P is None:
        return ConeCertificate.settle(matrices=stack, discrete=discrete)
    return ConeCertificate.settle(
        matrices=stack,
        discrete=discrete,
        rays=rays,
        multipliers=Matrix.stack([P]),
        pointing=pointing,
        right_inverse=inverse,
    )


def flatness(R: NDArray[np.float64]) -> float:
    """Condition number of generators scaled to length 1: large means nearly in a hyperplane, or nearly a line."""
    lengths = np.linalg.norm(R, axis=0)
    return float(np.linalg.cond(R / lengths)) if (lengths > 0).all() else np.inf
