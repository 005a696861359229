"""A common cone for a family A_1..A_M: filters, then searches from many starts within a time limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import OutOfTimeError, seconds_left
from ...exact.matrix import Matrix
from ...exact.programs import solve
from ...proof.multipliers import multipliers, pointing_functional
from ..certificate import ConeCertificate
from ..impossible.filters import family_obstruction
from ..one_matrix.explicit import modal_cone
from ..one_matrix.modes import Modes, modes
from ..one_matrix.search import balancing_units, flatness
from ..reduction import extreme_generators
from .commutator import simplicial_descent
from .moving import moving_descent

Array = NDArray[np.float64]

# A search that comes that close may have found a cone without margin, whose generators are simple fractions.
NEARLY = 1e-5
_DENOMINATORS = (1, 12, 1000)


@dataclass(frozen=True)
class Effort:
    """Random starts of a search: their seed, and how many."""

    seed: int
    restarts: int


def find_common(
    matrices: Matrix,
    *,
    discrete: bool,
    max_rays: int | None,
    effort: Effort,
    report: Callable[[str], None],
) -> tuple[ConeCertificate, Array | None, float, float]:
    """Certificate, separators, conditioning of a common cone, and the best margin of the search.

    Every attempt is put to the proof; the certificate is REFUTED only with a proven obstruction.
    """
    units = _units(matrices)
    balanced = np.asarray(matrices.values) * units / units[:, None]
    known = [modes(A, discrete=discrete) for A in balanced]
    obstruction = family_obstruction(matrices, [_unscaled(m, units) for m in known], discrete=discrete)
    if obstruction is not None:
        report(f"excluded: {obstruction}")
        return ConeCertificate.settle(matrices=matrices, discrete=discrete, witness=obstruction), None, np.inf, -np.inf
    nothing = ConeCertificate.settle(matrices=matrices, discrete=discrete)
    if all(m is None for m in known):
        return nothing, None, np.inf, -np.inf
    normal, e, w = _aligned(balanced, [m for m in known if m is not None], discrete)
    rng = np.random.default_rng(effort.seed)
    best = -np.inf
    for attempt, R in enumerate(_starts(normal, e, w, rng, discrete, effort.restarts, max_rays)):
        if seconds_left() <= 0:
            report(f"time limit reached after {attempt} starts")
            break
        if R.shape[1] == R.shape[0]:
            R, margin = simplicial_descent(normal, R, discrete=discrete)
        else:
            place = moving_descent(normal, R, w, discrete=discrete)
            R, margin = (R, -np.inf) if place is None else (place.X, place.margin)
        best = max(best, margin)
        report(f"start {attempt}: {R.shape[1]} rays, margin {margin:.3g} (best {best:.3g})")
        if margin < -NEARLY:
            continue
        try:
            certificate = next(
                filter(None, (_proven(matrices, x, units, discrete) for x in _roundings(R, units, margin))), None
            )
        except OutOfTimeError:  # another start may be cheaper to prove
            continue
        if certificate is not None:
            return certificate, _separators(certificate), flatness(R), best
    return nothing, None, np.inf, best


def _separators(certificate: ConeCertificate) -> Array | None:
    """Functionals that single out each generator, if all are extreme and there is time to see that."""
    rays, pointing = certificate.rays, certificate.pointing
    if rays is None or pointing is None:
        return None
    try:
        index, separators = extreme_generators(np.asarray(rays.values), pointing)
    except OutOfTimeError:
        return None
    return separators if len(index) == rays.shape[0] else None


def _units(matrices: Matrix) -> Array:
    """Powers of two in which all matrices together are balanced."""
    return balancing_units(np.abs(matrices.values).max(axis=0))


def _unscaled(m: Modes | None, units: Array) -> Modes | None:
    if m is None:
        return None
    return Modes(m.dominant, m.right * units, m.left / units, m.others, m.bases, m.conditioning)


def _aligned(matrices: Array, known: list[Modes], discrete: bool) -> tuple[Array, Array, Array]:
    """Matrices shifted and scaled to size one; mean dominant direction and functional of those known."""
    first = known[0]
    side = np.array([1.0 if m.left @ first.right >= 0 else -1.0 for m in known])
    left = np.mean([s * m.left / np.linalg.norm(m.left) for s, m in zip(side, known, strict=True)], axis=0)
    right = np.mean([s * m.right for s, m in zip(side, known, strict=True)], axis=0)
    values = np.linalg.eigvals(matrices)
    top = np.where(discrete, np.abs(values), values.real).max(axis=1)[:, None, None]
    if discrete:
        scaled = matrices / np.where(top > 0, top, 1.0)
    else:
        scaled = matrices - top * np.eye(matrices.shape[-1])
        scaled = scaled / np.maximum(np.abs(scaled).max(axis=(1, 2), keepdims=True), 1e-300)
    height = float(left @ right)
    return scaled, right / (height if height > 0 else 1.0), left


def _starts(
    matrices: Array, e: Array, w: Array, rng: np.random.Generator, discrete: bool, restarts: int, max_rays: int | None
) -> Iterator[Array]:
    """Generators to begin with: the orthant, cones of the mean matrix, and random simplices around e."""
    n = len(e)
    most = max_rays or 3 * n + 4
    yield np.eye(n)
    mean = modes(matrices.mean(axis=0), discrete=discrete)
    cone = None if mean is None else modal_cone(mean, discrete=discrete, max_rays=most)
    if cone is not None and not (w @ cone.R > 0).all():
        cone = None
    if cone is not None and cone.R.shape[1] == n:
        yield cone.R
    centre = e if w @ e > 0 else w / (w @ w)
    for k in range(restarts):
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


def _proven(matrices: Matrix, rays: Matrix, units: Array, discrete: bool) -> ConeCertificate:
    """The certificate for these generators, with a common Lyapunov vector if there is one."""
    values = np.asarray(rays.values)
    pointing = pointing_functional(values / units) / units
    inverse = np.linalg.pinv((values / units).T) / units
    quick = _solved(matrices, rays, units, discrete)
    if quick is None:
        found = []
        for s in range(matrices.shape[0]):
            P = multipliers(matrices[s], rays, pointing, discrete=discrete)
            if P is None:
                return ConeCertificate.settle(matrices=matrices, discrete=discrete)
            found.append(P)
        quick = Matrix.stack(found)
    data = {
        "matrices": matrices,
        "discrete": discrete,
        "rays": rays,
        "multipliers": quick,
        "pointing": pointing,
        "right_inverse": inverse,
    }
    certificate = ConeCertificate.settle(**data)
    if not certificate:
        return certificate
    v = common_vector(np.asarray(matrices.values), values, discrete=discrete)
    if v is None:
        return certificate
    with_vector = ConeCertificate.settle(**data, v=v)
    return with_vector if with_vector else certificate


def _solved(matrices: Matrix, rays: Matrix, units: Array, discrete: bool) -> Matrix | None:
    """Multipliers of a simplicial cone, if they are well away from zero."""
    n = rays.shape[1]
    if rays.shape[0] != n:
        return None
    R = (np.asarray(rays.values) / units).T
    P = np.linalg.solve(R, (np.asarray(matrices.values) * units / units[:, None]) @ R)
    free = P[:, np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool)]
    return Matrix(P) if free.size and free.min() > 1e-9 * np.abs(P).max() else None


def common_vector(matrices: Array, rays: Array, *, discrete: bool) -> Array | None:
    """v with v'x > 0 and v'A_s x < 0 (discrete time: < v'x) on every generator, by a linear program."""
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    n = rays.shape[1]
    moved = np.concatenate([unit @ A.T - (unit if discrete else 0) for A in matrices])
    moved = moved / np.maximum(np.abs(moved).max(), 1e-300)
    rows = np.block([[-unit, np.ones((len(unit), 1))], [moved, np.ones((len(moved), 1))]])
    answer = solve(
        np.append(np.zeros(n), -1.0),
        A_ub=rows,
        b_ub=np.zeros(len(rows)),
        bounds=(np.full(n + 1, -1.0), np.full(n + 1, 1.0)),
    )
    return answer.x[:-1] if answer and answer.x[-1] > 1e-12 else None
