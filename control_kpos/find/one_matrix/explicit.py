"""An invariant cone from the modes of A, with P in closed form.

Every cone here has generators e + V w: the dominant direction e displaced along the other modes.
One real mode gets a segment, a complex pair a regular m-gon, and a few modes together can be the
harmonics of one m-gon (`polygons`).

Polygons are combined in two ways.  *Free sum*: the convex hull around e.  *Attaching*: one vertex x
is replaced by x + (polygon), which saves a generator; it costs decay, since the polygon must now be
invariant relative to the rate Q_xx at which x stays.  An all-real spectrum then gives exactly n
generators.

A part rho_j e of A x_j is kept aside and spread over generators that have e inside: over all of them, or, for very
many generators, over a few that span the space, which keeps P sparse.  This makes entries of P positive, so
that rounding errors do not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import affords, spend
from ...exact.matrix import Matrix
from .modes import Modes
from .polygons import Group, Polygon, dimensions, groupings, smallest_polygon

Array = NDArray[np.float64]

# Part of the available decay kept aside for the strictness of P.
_RISE = 0.02
_TIGHT = 1e-4
# From this many generators on P is sparse, and the first cone found is taken: others would save little and cost much.
LARGE = 1000
# Separators are compared with all generators; they are left out for more of these.
_SEPARATED = 3000
# Entries of all generators together at most: two hundred megabytes or so, for R, P and what the proof needs.
MOST_ENTRIES = 4 * 10**6
# Operations to place one mode, and to build one number of the generators.
_PER_MODE, _PER_NUMBER = 2e5, 20.0


@dataclass(frozen=True, eq=False)
class Multipliers:
    """P = core + weights rise', for which A R = R P.

    Attributes
    ----------
    core : csr_array, shape (N, N)
        A R = R core + e rise'.
    weights, rise : ndarray, shape (N,)
        e = R weights; not negative.
    """

    core: sp.csr_array
    weights: Array
    rise: Array

    @property
    def is_thin(self) -> bool:
        """True if a few generators only have weights."""
        return bool((self.weights == 0).any())

    def combined(self) -> Array | sp.csr_array:
        """P, sparse if a few generators only have weights."""
        if not self.is_thin:
            return self.core.toarray() + np.outer(self.weights, self.rise)
        return sp.csr_array(self.core + sp.csr_array(self.weights[:, None]) @ sp.csr_array(self.rise[None, :]))


@dataclass(frozen=True, eq=False)
class ModalCone:
    """Generators and the multipliers that show their invariance, in the units of the modes, before any proof.

    Attributes
    ----------
    R : ndarray, shape (n, N)
        Generators, one a column.
    pointing : ndarray, shape (n,)
        Positive on every generator.
    multipliers : Multipliers or None
        A R = R P up to rounding.
    separators : ndarray, shape (N, n), or None
        Row i is negative on generator i and positive on the others: each generator is extreme.
    """

    R: Array
    pointing: Array
    multipliers: Multipliers | None = None
    separators: Array | None = None

    @property
    def right_inverse(self) -> Array:
        """Y with R Y = I up to rounding; rows are zero where P must not be corrected."""
        out = np.zeros(self.R.T.shape)
        some = slice(None) if self.multipliers is None else np.flatnonzero(self.multipliers.weights)
        out[some] = np.linalg.pinv(self.R[:, some])
        return out

    @property
    def stacked_multipliers(self) -> Matrix | None:
        """The multipliers as a certificate takes them: a stack of one, or sparse."""
        if self.multipliers is None:
            return None
        P = self.multipliers.combined()
        return Matrix(P) if sp.issparse(P) else Matrix(P[None])


def modal_cone(
    m: Modes, *, discrete: bool = False, max_rays: int | None = None, thin: bool | None = None
) -> ModalCone | None:
    """The smallest of several attached sums of polygons; None if none has at most `max_rays`.

    Parameters
    ----------
    m : Modes
    discrete : bool
    max_rays : int, optional
    thin : bool, optional
        Whether few generators only have weights, so that P is sparse.  By default where there are many.

    Notes
    -----
    Costs a few milliseconds for n = 30.
    """
    scale = abs(m.dominant) if discrete else 1.0
    if scale == 0:
        return None
    targets = m.others / scale if discrete else m.others - m.dominant
    best: _Sum | None = None
    for kind in (False, True) if thin is None else (thin,):
        best = best or _smallest_sum(targets, discrete=discrete, thin=kind, most=LARGE if thin is None else None)
    if best is None or best.size > (MOST_ENTRIES // len(m.right) if max_rays is None else max_rays):
        return None
    V = np.column_stack([m.right, *m.bases])
    points, unscaled = best.built()
    eye = sp.eye_array(best.size, format="csr")
    core = unscaled.core * scale if discrete else unscaled.core + m.dominant * eye
    multipliers = Multipliers(sp.csr_array(core), unscaled.weights, unscaled.rise * scale)
    separators = best.separators(points)
    if separators is not None:
        separators = np.asarray(np.linalg.solve(V.T, separators.T).T, dtype=np.float64)
    return ModalCone(V @ points, m.left, multipliers, separators)


def _smallest_sum(targets: NDArray[np.complex128], *, discrete: bool, thin: bool, most: int | None) -> _Sum | None:
    """The smallest of several sums of polygons, of at most `most` generators unless `thin`."""
    best: _Sum | None = None
    effort = _PER_MODE * len(targets)
    for k, groups in enumerate(groupings(targets, 1.0 if discrete else 0.0, discrete=discrete)):
        if k and best is not None and (best.size > LARGE or not affords(effort)):
            break
        if k:
            spend(effort)
        built = _placed(targets, groups, discrete=discrete, thin=thin)
        if built is not None and (best is None or built.size < best.size) and (thin or not most or built.size <= most):
            best = built
    return best


class _Step(NamedTuple):
    """One polygon of a sum: attached to generator `place`, or added freely where that is None."""

    place: int | None
    polygon: Polygon
    rows: NDArray[np.intp]
    rise: float
    even: Array


class _Sum:
    """A growing cone in modal coordinates (first coordinate: the dominant direction, always 1).

    A X = X core + e rise' and e = X weights, up to the shift or scale that makes the dominant eigenvalue `top`.
    While it grows it keeps what choices depend on: at which rate each generator stays, and whether it has a weight.
    """

    def __init__(self, dims: int, *, discrete: bool, thin: bool) -> None:
        self.dims, self.discrete, self.thin = dims, discrete, thin
        self.top = 1.0 if discrete else 0.0
        self.steps: list[_Step] = []
        self.stay = np.zeros(0)
        self.weighted = np.zeros(0, dtype=bool)

    @property
    def size(self) -> int:
        """Number of generators."""
        return len(self.stay)

    def add(self, polygon: Polygon, rows: NDArray[np.intp], rise: float = 0.0, place: int | None = None) -> None:
        """Free sum with a polygon around e; or generator `place` replaced by its copies displaced to the corners."""
        even = polygon.convex_weights(thin=self.thin)
        self.steps.append(_Step(place, polygon, rows, rise, even))
        kept = np.arange(self.size) != (-1 if place is None else place)
        self.stay = np.concatenate([self.stay[kept], np.full(len(even), polygon.rates[0])])
        self.weighted = np.concatenate([self.weighted[kept], even > 0])

    def place(self, group: NDArray[np.complex128], rows: NDArray[np.intp]) -> bool:
        """Add one group of modes where it costs the fewest generators."""
        gap = float((self.top - (np.abs(group) if self.discrete else group.real)).min())
        if gap <= 0:
            return False
        best, found = 0, None
        able = np.flatnonzero(self.weighted)
        _, owners = np.unique(self.stay[able], return_index=True)
        for k in able[owners]:
            fit = smallest_polygon(group, float(self.stay[k]), discrete=self.discrete)
            if fit is not None and (found is None or len(fit.rates) < len(found.rates)):
                best, found = int(k), fit
                if len(fit.rates) <= dimensions(group) + 1:
                    break
        free, rise = self._free(group, gap)
        if found is not None and (free is None or len(found.rates) - 1 <= len(free.rates)):
            self.add(found, rows, place=best)
            return True
        if free is None:
            return False
        self.add(free, rows, rise)
        return True

    def _free(self, group: NDArray[np.complex128], gap: float) -> tuple[Polygon | None, float]:
        """The smallest polygon around e, and the decay kept aside."""
        tight = smallest_polygon(group, self.top - _TIGHT * gap, discrete=self.discrete)
        free = smallest_polygon(group, self.top - _RISE * gap, discrete=self.discrete)
        if free is None or (tight is not None and len(tight.rates) < len(free.rates)):
            return tight, _TIGHT * gap
        return free, _RISE * gap

    def built(self) -> tuple[Array, Multipliers]:
        """Generators, one a column, and multipliers up to shift and scale."""
        points, core = np.zeros((self.dims, 0)), sp.csr_array((0, 0))
        weights, rise = np.zeros(0), np.zeros(0)
        placed = 0
        for step in self.steps:
            N, m, k, even = len(weights), len(step.even), step.place, step.even
            spend(_PER_NUMBER * self.dims * (N + m))
            ring = _circulant(step.polygon.rates)
            if k is None:
                kept = np.concatenate([np.arange(N), np.full(m, -1)])
                points = np.column_stack([points, np.zeros((self.dims, m))])
                points[0, N:] = 1.0
                core = sp.csr_array(sp.block_diag([core, ring])) if N else ring
                part = len(step.rows) / (len(step.rows) + placed) if N else 1.0
                weights = np.concatenate([weights * (1 - part), even * part])
                rise = np.concatenate([rise, np.full(m, step.rise)])
            else:
                rest = np.delete(np.arange(N), k)
                kept = np.concatenate([rest, np.full(m, k)])
                points, rise = points[:, kept], rise[kept]
                weights = np.concatenate([weights[rest], weights[k] * even])
                core = _attached(core, k, rest, ring, even)
            points[np.ix_(step.rows, np.arange(len(weights) - m, len(weights)))] = step.polygon.corners
            placed += len(step.rows)
        return points, Multipliers(core, weights, rise)

    def separators(self, points: Array) -> Array | None:
        """Functionals that single out each generator, or None for too many of them.

        All corners w of one polygon have the same length, so 1 - w'y/w'w vanishes at w and is positive
        at the other corners and at 0; the sum over the polygons that a generator is a corner of
        vanishes at this generator only.
        """
        if self.size > _SEPARATED:
            return None
        out = np.zeros((self.size, self.dims))
        for step in self.steps:
            corner = points[step.rows].T
            length = (corner**2).sum(axis=1, keepdims=True)
            on = length[:, 0] > 0
            out[np.ix_(np.flatnonzero(on), step.rows)] = -corner[on] / length[on]
            out[on, 0] += 1.0
        values = out @ points
        np.fill_diagonal(values, np.inf)
        out[:, 0] -= 0.5 * np.minimum(values.min(axis=1), 1.0)
        return out


def _circulant(rates: Array) -> sp.csr_array:
    """Q with Q[j + k mod m, j] = rates[k]."""
    m, k = len(rates), np.flatnonzero(rates)
    column = np.broadcast_to(np.arange(m)[:, None], (m, len(k)))
    data = np.broadcast_to(rates[k], (m, len(k)))
    return sp.csr_array((data.ravel(), (((column + k) % m).ravel(), column.ravel())), shape=(m, m))


def _attached(core: sp.csr_array, k: int, rest: NDArray[np.intp], ring: sp.csr_array, even: Array) -> sp.csr_array:
    """Core after generator k was replaced: what flowed to it flows to its copies, which flow as it did."""
    outflow, inflow = core[:, [k]][rest], core[[k]][:, rest]
    copied = outflow @ sp.csr_array(np.ones((1, len(even))))
    divided = sp.csr_array(even[:, None]) @ inflow
    return sp.csr_array(sp.block_array([[core[rest][:, rest], copied], [divided, ring]], format="csr"))


def _placed(targets: NDArray[np.complex128], groups: list[Group], *, discrete: bool, thin: bool) -> _Sum | None:
    sizes = np.where(targets.imag > 0, 2, 1)
    first_row = np.concatenate([[1], 1 + np.cumsum(sizes)])
    cone = _Sum(int(first_row[-1]), discrete=discrete, thin=thin)
    if not groups:
        cone.add(Polygon(np.array([cone.top]), np.zeros((0, 1))), np.zeros(0, dtype=int))
    for group in groups:
        rows = [np.arange(first_row[i], first_row[i] + sizes[i]) for i in group]
        if cone.place(targets[list(group)], np.concatenate(rows)):
            continue
        alone = zip(group, rows, strict=True)
        if len(group) == 1 or not all(cone.place(targets[[i]], r) for i, r in alone):
            return None
    return cone
