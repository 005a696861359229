"""An invariant cone from the modes of A, with P in closed form.

Every cone here has generators e + V w: the dominant direction e displaced along the other modes.
One real mode gets a segment, a complex pair a regular m-gon, and a few modes together can share one
m-gon as its harmonics: a circulant Q with Q = sum_k c_k S^k, S the cyclic shift, has the eigenvalues
sum_k c_k z^(jk), z = exp(2 pi i/m), j = 0..m-1, so c follows from the wanted eigenvalues by a
discrete Fourier transform, and what must hold is c_k >= 0 for k >= 1 (discrete time: also c_0 >= 0).
For one pair with decay gap a and frequency w that is tan(pi/m) <= a/w (Dmitriev and Dynkin, 1946).

Polygons are combined in two ways.  *Free sum*: the convex hull around e.  *Attaching*: one vertex x
is replaced by x + (polygon), which saves a generator; it costs decay, since the polygon must now be
invariant relative to the rate Q_xx at which x stays.  An all-real spectrum then gives exactly n
generators.

A part rho_j e of A x_j is kept aside and spread over all generators (e is inside the cone), which
makes every off-diagonal entry of P positive: that slack is what the proof lives on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .grouping import Group, groupings, spectra
from .modes import Modes

# Part of the available decay kept aside for the strictness of P.
_SLACK = 0.02
_TIGHT = 1e-4
_LARGEST_POLYGON = 8000
# From this many generators on the first cone found is taken: others would save little and cost much.
_LARGE = 1000


@dataclass(frozen=True, eq=False)
class Candidate:
    """Generators and the multipliers that show their invariance, before any proof.

    Attributes
    ----------
    R : ndarray, shape (n, N)
        Generators, one a column.
    pointing : ndarray, shape (n,)
        Positive on every generator.
    P : ndarray, shape (N, N), or None
        A R = R P up to rounding.
    separators : ndarray, shape (N, n), or None
        Row i is negative on generator i and positive on the others: each generator is extreme.
    """

    R: NDArray[np.float64]
    pointing: NDArray[np.float64]
    P: NDArray[np.float64] | None = None
    separators: NDArray[np.float64] | None = None


def fewest_rays(others: NDArray[np.complex128], dominant: float, n: int) -> int:
    """Lower bound max(n, p_i) on the number of generators of any invariant polyhedral cone.

    P is an N x N matrix with nonnegative off-diagonal entries whose spectrum holds that of A, hence
    N >= pi / atan(gap / frequency) for every complex pair (Dmitriev and Dynkin; for a discrete-time
    cone the same holds for P minus a multiple of the identity).
    """
    pairs = others[others.imag > 0]
    if not pairs.size:
        return n
    angle = np.arctan2(dominant - pairs.real, pairs.imag)
    angle = angle[angle > 0]  # the others exclude any polyhedral cone
    if not angle.size:
        return n
    # A pair exactly at tan(pi/p) must not be pushed to p + 1 by the rounding of its eigenvalue.
    return max(n, int(np.ceil(np.pi / angle * (1 - 1e-9)).max()))


def modal_cone(m: Modes, *, discrete: bool = False, max_rays: int | None = None) -> Candidate | None:
    """The smallest of several attached sums of polygons; None if none has at most `max_rays`.

    Costs a few milliseconds for n = 30.
    """
    best: _Builder | None = None
    top = 1.0 if discrete else 0.0
    scale = abs(m.dominant) if discrete else 1.0
    if scale == 0:
        return None
    targets = m.others / scale if discrete else m.others - m.dominant
    for groups in groupings(targets, top, discrete=discrete):
        for tight in (True, False):
            built = _build(targets, groups, top, discrete, tight=tight)
            if built is not None and (best is None or built.size < best.size):
                best = built
        if best is not None and best.size > _LARGE:
            break
    if best is None or (max_rays is not None and best.size > max_rays):
        return None
    V = np.column_stack([m.right, *m.bases])
    P = best.core + np.outer(best.weights, best.slack)
    P = P * scale if discrete else P + m.dominant * np.eye(best.size)
    return Candidate(V @ best.points, m.left, P, np.linalg.solve(V.T, best.separators().T).T)


class _Builder:
    """A growing cone in modal coordinates (first coordinate: the dominant direction, always 1).

    A X = X core + e slack' and e = X weights, up to the shift or scale that makes the dominant
    eigenvalue `top`.
    """

    def __init__(self, dims: int, top: float, discrete: bool) -> None:
        self.points = np.zeros((dims, 0))
        self.core = np.zeros((0, 0))
        self.slack = np.zeros(0)
        self.weights = np.zeros(0)
        self.blocks: list[NDArray[np.intp]] = []
        self.top, self.discrete = top, discrete

    def separators(self) -> NDArray[np.float64]:
        """Functionals that single out each generator.

        All corners w of one polygon have the same length, so 1 - w'y/w'w vanishes at w and is positive
        at the other corners and at 0; the sum over the polygons that a generator is a corner of
        vanishes at this generator only.
        """
        out = np.zeros((self.size, self.points.shape[0]))
        for rows in self.blocks:
            corner = self.points[rows].T
            length = (corner**2).sum(axis=1, keepdims=True)
            on = length[:, 0] > 0
            out[np.ix_(np.flatnonzero(on), rows)] = -corner[on] / length[on]
            out[on, 0] += 1.0
        values = out @ self.points
        np.fill_diagonal(values, np.inf)
        out[:, 0] -= 0.5 * np.minimum(values.min(axis=1), 1.0)
        return out

    @property
    def size(self) -> int:
        return self.points.shape[1]

    def add(
        self, polygon: NDArray[np.float64], rows: NDArray[np.intp], rates: NDArray[np.float64], slack: float
    ) -> None:
        """Free sum with a polygon around e."""
        m, N = len(rates), self.size
        self.blocks.append(rows)
        points = np.zeros((self.points.shape[0], N + m))
        points[:, :N] = self.points
        points[0, N:] = 1.0
        points[np.ix_(rows, np.arange(N, N + m))] = polygon
        core = np.zeros((N + m, N + m))
        core[:N, :N] = self.core
        core[N:, N:] = _circulant(rates)
        share = 1.0 if N == 0 else len(rows) / (len(rows) + np.count_nonzero(self.points[1:].any(axis=1)))
        self.weights = np.concatenate([self.weights * (1 - share), np.full(m, share / m)])
        self.slack = np.concatenate([self.slack, np.full(m, slack)])
        self.points, self.core = points, core

    def attach(self, k: int, polygon: NDArray[np.float64], rows: NDArray[np.intp], rates: NDArray[np.float64]) -> None:
        """Replace generator k by its copies displaced to the corners of a polygon."""
        m, N = len(rates), self.size
        self.blocks.append(rows)
        rest = np.delete(np.arange(N), k)
        keep = np.concatenate([rest, np.full(m, k)])
        core = self.core[np.ix_(keep, keep)]
        core[N - 1 :, :] /= m  # what flowed to x_k is shared by its copies
        core[N - 1 :, N - 1 :] = _circulant(rates)
        self.points = self.points[:, keep]
        self.points[np.ix_(rows, np.arange(N - 1, N - 1 + m))] = polygon
        self.core, self.slack = core, self.slack[keep]
        self.weights = np.concatenate([self.weights[rest], np.full(m, self.weights[k] / m)])


def _circulant(rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Q with Q[j + k mod m, j] = rates[k]."""
    m = len(rates)
    index = np.arange(m)
    return rates[(index[:, None] - index[None, :]) % m]


def _build(
    targets: NDArray[np.complex128], groups: list[Group], top: float, discrete: bool, *, tight: bool
) -> _Builder | None:
    sizes = np.where(targets.imag > 0, 2, 1)
    first_row = np.concatenate([[1], 1 + np.cumsum(sizes)])
    cone = _Builder(int(first_row[-1]), top, discrete)
    if not groups:
        cone.add(np.zeros((0, 1)), np.zeros(0, dtype=int), np.array([top]), 0.0)
    for group in groups:
        rows = [np.arange(first_row[i], first_row[i] + sizes[i]) for i in group]
        if _place(cone, targets[list(group)], np.concatenate(rows), tight):
            continue
        if len(group) == 1 or not all(_place(cone, targets[[i]], r, tight) for i, r in zip(group, rows, strict=True)):
            return None
    return cone


def _place(cone: _Builder, group: NDArray[np.complex128], rows: NDArray[np.intp], tight: bool) -> bool:
    """Add one group of modes where it costs the fewest generators."""
    gap = float((cone.top - (np.abs(group) if cone.discrete else group.real)).min())
    if gap <= 0:
        return False
    best, found = 0, None
    _, owners = np.unique(np.diag(cone.core), return_index=True)
    for k in owners if tight else owners[::-1]:
        fit = _smallest(group, float(cone.core[k, k]), cone.discrete)
        if fit is not None and (found is None or len(fit[0]) < len(found[0])):
            best, found = int(k), fit
            if len(fit[0]) <= _dims(group) + 1:
                break
    slack = _SLACK * gap
    free = None
    for part in (slack, _TIGHT * gap):
        free = _smallest(group, cone.top - part, cone.discrete)
        slack = part
        if free is not None:
            tighter = _smallest(group, cone.top - _TIGHT * gap, cone.discrete)
            if tighter is not None and len(tighter[0]) < len(free[0]):
                free, slack = tighter, _TIGHT * gap
            break
    if found is not None and (free is None or len(found[0]) - 1 <= len(free[0])):
        cone.attach(best, found[1], rows, found[0])
        return True
    if free is None:
        return False
    cone.add(free[1], rows, free[0], slack)
    return True


def _dims(group: NDArray[np.complex128]) -> int:
    return int(np.where(group.imag > 0, 2, 1).sum())


def _smallest(
    group: NDArray[np.complex128], total: float, discrete: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Rates and corners of the smallest polygon that carries the group at column sum `total`."""
    dims = _dims(group)
    if len(group) > 1 or group[0].imag == 0:
        return _rates(group, dims + 1, total, discrete)
    size = _polygon_size(complex(group[0]), total, discrete)
    return None if size is None else _rates(group, size, total, discrete)


def _polygon_size(target: complex, total: float, discrete: bool) -> int | None:
    if not discrete:
        gap = total - target.real
        if gap <= 0:
            return None
        size = max(3, int(np.ceil(np.pi / np.arctan2(gap, target.imag) * (1 - 1e-12))))
        return size if size <= _LARGEST_POLYGON else None
    if abs(target) >= total:
        return None
    for sizes in (np.arange(3, 100), np.arange(100, _LARGEST_POLYGON + 1)):
        step = 2 * np.pi / sizes
        inside = abs(target) * np.cos(np.angle(target) % step - step / 2) <= total * np.cos(step / 2) * (1 + 1e-14)
        if inside.any():
            return int(sizes[np.argmax(inside)])
    return None


def _rates(
    group: NDArray[np.complex128], m: int, total: float, discrete: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Nonnegative circulant rates on m corners with the group's eigenvalues, and the corners."""
    if m != _dims(group) + 1:
        return _polygon(complex(group[0]), m, total, discrete)
    pairs, reals = group[group.imag > 0], group[group.imag == 0]
    if len(reals) > 1:
        return None
    best: tuple[NDArray[np.float64], list[int]] | None = None
    for harmonics, spectrum in spectra(pairs[:, None], reals.real if len(reals) else None):
        spectrum[0, 0] = total
        rates = np.fft.fft(spectrum[0]).real / m
        floor = rates.min() if discrete else rates[1:].min()
        if floor >= -1e-14 * abs(rates).max() and (best is None or rates[0] > best[0][0]):
            best = (rates, harmonics)
    if best is None:
        return None
    rates, harmonics = best
    rates[1:] = np.maximum(rates[1:], 0.0)
    angle = 2 * np.pi * np.arange(m) / m
    corners = [row for j in harmonics for row in (np.cos(j * angle), np.sin(j * angle))]
    if len(reals):
        corners.append(np.cos(np.pi * np.arange(m)))
    return rates, np.array(corners)


def _polygon(
    target: complex, m: int, total: float, discrete: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """One pair on a regular m-gon with more corners than it needs."""
    angle = 2 * np.pi * np.arange(m) / m
    corners = np.array([np.cos(angle), np.sin(angle)])
    rates = np.zeros(m)
    if discrete:
        k = int(np.floor(np.angle(target) / (2 * np.pi / m)))
        near = np.array([k, (k + 1) % m])
        rates[near] = np.linalg.solve(corners[:, near], [target.real, target.imag])
        rest = total - rates.sum()
        if rest < -1e-14 or rates.min() < -1e-14:
            return None
        return np.maximum(rates, 0.0) + max(rest, 0.0) / m, corners
    rates[1] = target.imag / np.sin(angle[1])
    rest = total - target.real - rates[1] * (1 - np.cos(angle[1]))
    if rest < -1e-12 * abs(target):
        return None
    far = [m // 2, (m + 1) // 2]  # the opposite corner, or both: the least outflow for a given decay
    rates[far[0]] += max(rest, 0.0) / (1 - np.cos(angle[far[0]])) / 2
    rates[far[1]] += max(rest, 0.0) / (1 - np.cos(angle[far[1]])) / 2
    rates[0] = total - rates[1:].sum()
    return rates, corners
