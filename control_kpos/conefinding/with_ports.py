"""An invariant cone for one matrix that holds given vectors and lies in given half-spaces."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..arrays import ExactMatrix, concatenate
from .certificate import ConeCertificate
from .core import core_inside
from .modes import Modes, modes
from .multipliers import Frame, nonnegative_combination
from .orbit import assemble, flow, follow
from .reduction import extreme_generators
from .single import as_stack, balanced, flatness

Array = NDArray[np.float64]

# Generators are tested for redundancy up to this number; each test is a linear program.
_PRUNED = 80
_SHRINK = (1.0, 0.2)
# The dynamics are followed with gaps reduced by this part of the smallest one.
_SLACK = (1e-3, 1e-4, 1e-5)


def find_with_ports(
    A: ExactMatrix, vectors: ExactMatrix, normals: ExactMatrix, *, discrete: bool, max_rays: int | None
) -> tuple[ConeCertificate, Array | None, float]:
    """Certificate (PROVED or UNDECIDED), separators and conditioning.

    Parameters
    ----------
    vectors : ExactMatrix, shape (k, n)
        To be held by the cone, such as the columns of B; k may be 0.
    normals : ExactMatrix, shape (r, n)
        Half-spaces to lie in, such as the rows of C; r may be 0.
    """
    stack = as_stack([A])
    nothing = ConeCertificate.settle(
        matrices=stack, discrete=discrete, contains=_given(vectors), within=_given(normals)
    )
    easy = _orthant(stack, vectors, normals, discrete)
    n = A.shape[0]
    if easy and (max_rays is None or n <= max_rays):
        return easy, 1.0 - 2.0 * np.eye(n), 1.0
    matrix, units = balanced(A)
    m = modes(matrix, discrete=discrete)
    if m is None:
        return nothing, None, np.inf
    m = oriented(m, np.asarray(vectors.values) / units, np.asarray(normals.values) * units)
    for points, P, starts, basis in _proposals(A, m, vectors, normals, units, discrete):
        rays, multipliers, separators, shares = _exactly(points, P, starts, basis, units, vectors, m)
        if max_rays is not None and rays.shape[0] > max_rays:
            continue
        R = (np.asarray(rays.values) / units).T
        inverse = np.linalg.pinv(R)
        P = multipliers.values + inverse @ (matrix @ R - R @ multipliers.values)
        certificate = ConeCertificate.settle(
            matrices=stack,
            discrete=discrete,
            rays=rays,
            multipliers=ExactMatrix(P[None]),
            pointing=m.left / units,
            right_inverse=inverse / units,
            contains=_given(vectors),
            shares=shares if vectors.shape[0] else None,
            within=_given(normals),
        )
        if certificate:
            return certificate, separators, flatness(R)
    return nothing, None, np.inf


def _orthant(stack: ExactMatrix, vectors: ExactMatrix, normals: ExactMatrix, discrete: bool) -> ConeCertificate:
    """The orthant, on which zeros of A, B and C are no trouble: P = A."""
    eye = np.eye(stack.shape[-1])
    return ConeCertificate.settle(
        matrices=stack,
        discrete=discrete,
        rays=ExactMatrix(eye),
        multipliers=stack,
        pointing=np.ones(len(eye)),
        right_inverse=eye,
        contains=_given(vectors),
        shares=_given(vectors),
        within=_given(normals),
    )


def oriented(m: Modes, vectors: Array, normals: Array) -> Modes:
    """The modes with the dominant direction on the side of the half-spaces and of the vectors."""
    score = np.sign(normals @ m.right).sum() + np.sign(vectors @ m.left).sum()
    return m if score >= 0 else Modes(m.dominant, -m.right, -m.left, m.others, m.bases, m.conditioning)


def _given(rows: ExactMatrix) -> ExactMatrix | None:
    return rows if rows.shape[0] else None


def _proposals(
    A: ExactMatrix, m: Modes, vectors: ExactMatrix, normals: ExactMatrix, units: Array, discrete: bool
) -> Iterator[tuple[list[Array], Array, list[int], Array]]:
    """Generators in modal coordinates, multipliers, and where the orbit of each vector starts."""
    basis = np.column_stack([m.right, *m.bases])
    to_modal = np.linalg.inv(basis)
    starts = (np.asarray(vectors.values) / units) @ to_modal.T
    c = (np.asarray(normals.values) * units) @ basis
    if not ((c[:, 0] > 0).all() and (starts[:, 0] > 0).all()):
        return
    for shrink, slack in product(_SHRINK, _SLACK):
        f = flow(m, slack, discrete=discrete)
        core = core_inside(m, c, shrink, discrete=discrete)
        if core is None:
            return
        orbits = [follow(f, y, c, core) for y in starts]
        if all(orbit is not None for orbit in orbits):
            found = [orbit for orbit in orbits if orbit is not None]
            points, P, rows = assemble(f, found, core)
            yield list(points), P, rows, basis


def _exactly(
    points: list[Array],
    P: Array,
    starts: list[int],
    basis: Array,
    units: Array,
    vectors: ExactMatrix,
    m: Modes,
) -> tuple[ExactMatrix, ExactMatrix, Array | None, ExactMatrix]:
    """Generators in the user's coordinates, the vectors themselves among them, none redundant."""
    values = np.array(points) @ basis.T
    own = np.zeros(len(values), dtype=bool)
    for row in starts:
        if row >= 0:
            own[row] = True
    separators = None
    index = np.arange(len(values))
    if len(values) <= _PRUNED:
        index, separators = extreme_generators(values, m.left)
        P, shares = _substituted(values, P, index, m)
        separators = separators / units
    else:
        shares = np.eye(len(values))
    rows = [ExactMatrix((values * units)[[i]]) for i in index]
    combos = np.zeros((vectors.shape[0], len(index)))
    for j, row in enumerate(starts):
        if row < 0:
            frame = Frame.of(values[index], m.left)
            target = np.asarray(vectors.values)[j] / units
            if frame is not None:
                combos[j] = (
                    nonnegative_combination(frame, frame.to @ target, size=float(np.abs(frame.to @ target).max()))[0]
                    / frame.heights
                )
            continue
        combos[j] = shares[:, row]
        at = np.flatnonzero(index == row)
        if at.size:
            rows[int(at[0])] = _row(vectors, j)
    return concatenate(rows, axis=-2), ExactMatrix(P), separators, ExactMatrix(combos)


def _substituted(values: Array, P: Array, index: NDArray[np.intp], m: Modes) -> tuple[Array, Array]:
    """Multipliers after dropping generators that are combinations of the others, and these combinations.

    Returns
    -------
    P : ndarray, shape (p, p)
    shares : ndarray, shape (p, N)
        Every generator as a combination of the kept ones.
    """
    shares = np.zeros((len(index), len(values)))
    shares[np.arange(len(index)), index] = 1.0
    dropped = np.setdiff1d(np.arange(len(values)), index)
    frame = Frame.of(values[index], m.left) if dropped.size else None
    if frame is not None:
        for j in dropped:
            target = frame.to @ values[j]
            q, _ = nonnegative_combination(frame, target, size=float(np.abs(target).max()) or 1.0)
            shares[:, j] = np.maximum(q, 0.0) / frame.heights
    return shares @ P[:, index], shares


def _row(m: ExactMatrix, j: int) -> ExactMatrix:
    return ExactMatrix(
        np.asarray(m.values)[[j]],
        None if m.radius is None else m.radius[[j]],
        None if m.numerators is None else m.numerators[[j]],
        m.denominator,
    )
