"""Circulant matrices on the corners of a polygon: which modes fit one polygon, its rates and its corners.

A circulant Q = sum_k c_k S^k on m corners, S the cyclic shift, has the eigenvalues sum_k c_k z^(jk),
z = exp(2 pi i/m), j = 0..m-1; harmonic 0 is its column sum t.  Given the eigenvalues, c is a discrete Fourier
transform away, and what must hold is c_k >= 0 for k >= 1 (discrete time: also c_0 >= 0).  For one pair with decay
gap a and frequency w that is tan(pi/m) <= a/w (Dmitriev and Dynkin, 1946).

Since t adds t/m to every c_k, there is a least t, the *need* of a group of modes, from which on c >= 0.  A group of
m - 1 dimensions that meets its need costs one generator per dimension, which is as cheap as it gets; a complex pair
alone may need a polygon with many more corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import spend

Group = tuple[int, ...]

_LARGEST = 100_000
# Up to so many corners every corner may flow to every other one.
_DENSE = 500
# Pairs, and real modes, with the smallest gaps that look for partners: groups of three grow with the cube.
_PARTNERS = 60


@dataclass(frozen=True, eq=False)
class Polygon:
    """Corners, and a circulant that carries a group of modes on them.

    Attributes
    ----------
    rates : ndarray, shape (m,)
        Q[j + k mod m, j] = rates[k].
    corners : ndarray, shape (d, m)
        One a column, all of the same length; their sum is zero.
    """

    rates: NDArray[np.float64]
    corners: NDArray[np.float64]

    def convex_weights(self, *, thin: bool) -> NDArray[np.float64]:
        """Convex weights of corners whose mean is zero: equal ones, or on three corners only if `thin`."""
        m = len(self.rates)
        if not thin or len(self.corners) != 2 or m <= 6:
            return np.full(m, 1 / m)
        some, out = np.array([0, round(m / 3), round(2 * m / 3)]), np.zeros(m)
        out[some] = np.linalg.solve(np.vstack([self.corners[:, some], np.ones(3)]), [0.0, 0.0, 1.0])
        return out


def dimensions(group: NDArray[np.complex128]) -> int:
    """Dimension of the invariant subspace of some modes, one of each complex pair given."""
    return int(np.where(group.imag > 0, 2, 1).sum())


def smallest_polygon(group: NDArray[np.complex128], total: float, *, discrete: bool) -> Polygon | None:
    """The polygon with the fewest corners that carries the group at column sum `total`."""
    if len(group) > 1 or group[0].imag == 0:
        return _simplex(group, total, discrete)
    size = _least_size(complex(group[0]), total, discrete)
    if size is None:
        return None
    return _simplex(group, total, discrete) if size == 3 else _polygon(complex(group[0]), size, total, discrete)


def _least_size(target: complex, total: float, discrete: bool) -> int | None:
    if not discrete:
        gap = total - target.real
        if gap <= 0:
            return None
        size = max(3, int(np.ceil(np.pi / np.arctan2(gap, target.imag) * (1 - 1e-12))))
        return size if size <= _LARGEST else None
    if abs(target) >= total:
        return None
    for sizes in (np.arange(3, 100), np.arange(100, _LARGEST + 1)):
        step = 2 * np.pi / sizes
        inside = abs(target) * np.cos(np.angle(target) % step - step / 2) <= total * np.cos(step / 2) * (1 + 1e-14)
        if inside.any():
            return int(sizes[np.argmax(inside)])
    return None


def _simplex(group: NDArray[np.complex128], total: float, discrete: bool) -> Polygon | None:
    """One corner more than there are dimensions, the modes on different harmonics."""
    m = dimensions(group) + 1
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
    return Polygon(rates, np.array(corners))


def _polygon(target: complex, m: int, total: float, discrete: bool) -> Polygon | None:
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
        even = Polygon(rates, corners).convex_weights(thin=m > _DENSE)
        return Polygon(np.maximum(rates, 0.0) + max(rest, 0.0) * even, corners)
    rates[1] = target.imag / np.sin(angle[1])
    rest = total - target.real - rates[1] * (1 - np.cos(angle[1]))
    if rest < -1e-12 * abs(target):
        return None
    far = [m // 2, (m + 1) // 2]  # the opposite corner, or both: the least outflow for a given decay
    rates[far[0]] += max(rest, 0.0) / (1 - np.cos(angle[far[0]])) / 2
    rates[far[1]] += max(rest, 0.0) / (1 - np.cos(angle[far[1]])) / 2
    rates[0] = total - rates[1:].sum()
    return Polygon(rates, corners)


def spectra(
    pairs: NDArray[np.complex128], real: NDArray[np.float64] | None
) -> Iterator[tuple[list[int], NDArray[np.complex128]]]:
    """Ways to put some pairs, and possibly one real eigenvalue, on the harmonics of one circulant.

    Parameters
    ----------
    pairs : ndarray of complex, shape (k, G)
        k pairs, for G groups at once.
    real : ndarray, shape (G,), or None

    Yields
    ------
    harmonics : list of int
        Harmonic of each pair, negative for the conjugate.
    spectrum : ndarray of complex, shape (G, m)
        Eigenvalues with column sum 0.
    """
    k, count = pairs.shape
    m = 2 * k + 1 + (real is not None)
    for order in permutations(range(1, k + 1)):
        for signs in product((1, -1), repeat=k):
            if signs and signs[0] < 0:
                continue  # a mirror image
            spectrum = np.zeros((count, m), dtype=complex)
            for j, sign, value in zip(order, signs, pairs, strict=True):
                spectrum[:, sign * j] = value
                spectrum[:, -sign * j] = value.conj()
            if real is not None:
                spectrum[:, m // 2] = real
            yield [s * j for s, j in zip(signs, order, strict=True)], spectrum


def needs(pairs: NDArray[np.complex128], real: NDArray[np.float64] | None, *, discrete: bool) -> NDArray[np.float64]:
    """Least column sum with nonnegative rates, for G groups at once; shape (G,)."""
    best = np.full(pairs.shape[1], np.inf)
    for _, spectrum in spectra(pairs, real):
        rates = np.fft.fft(spectrum, axis=1).real
        best = np.minimum(best, -(rates if discrete else rates[:, 1:]).min(axis=1))
    return best


def groupings(targets: NDArray[np.complex128], top: float, *, discrete: bool) -> list[list[Group]]:
    """Partitions of the modes into groups worth trying, each in a good order for attaching.

    Pairs that need no more than a triangle stay alone; the others look for partners.
    """
    gap = top - (np.abs(targets) if discrete else targets.real)
    by_gap = [int(i) for i in np.argsort(gap, kind="stable")]
    found: list[list[Group]] = [[(i,) for i in by_gap]]
    pairs = [i for i in by_gap if targets[i].imag > 0]
    reals = [i for i in by_gap if targets[i].imag == 0]
    if len(pairs) + len(reals) < 2 or not pairs:
        return found
    pairs, reals = pairs[:_PARTNERS], reals[:_PARTNERS]
    needed, members = _offers(targets, pairs, reals, top, discrete)
    alone = np.full(len(targets), -np.inf)
    alone[pairs] = needs(targets[None, pairs], None, discrete=discrete)
    rng = np.random.default_rng(0)
    for trial in range(8):
        spend(1e3 * len(members))
        spare = top - needed
        if trial:
            spare = spare * rng.uniform(0.5, 1.5, len(spare))
        found.append(_greedy(members, alone >= (0.5 * top if trial % 2 else top), spare, by_gap))
    return found


def _offers(
    targets: NDArray[np.complex128], pairs: list[int], reals: list[int], top: float, discrete: bool
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Needs of feasible groups of two or three modes, and the groups, one a row, filled up with -1."""
    lists: list[tuple[list[Group], int]] = [
        ([(i, j) for i in pairs for j in reals], 1),
        (list(combinations(pairs, 2)), 2),
        ([(i, j, r) for i, j in combinations(pairs, 2) for r in reals], 2),
        (list(combinations(pairs[:20], 3)), 3),
    ]
    needed, members = [np.zeros(0)], [np.zeros((0, 3), dtype=np.intp)]
    for groups, k in lists:
        if not groups:
            continue
        index = np.array(groups).T
        real = targets[index[k]].real if len(index) > k else None
        need = needs(targets[index[:k]], real, discrete=discrete)
        below = np.flatnonzero(need < top)
        needed.append(need[below])
        rows = np.full((len(below), 3), -1)
        rows[:, : len(index)] = index[:, below].T
        members.append(rows)
    return np.concatenate(needed), np.concatenate(members)


def _greedy(
    members: NDArray[np.intp], helped: NDArray[np.bool_], spare: NDArray[np.float64], by_gap: list[int]
) -> list[Group]:
    """Take the groups one by one: those that help the most of their modes first, then those with most to spare."""
    part = np.append(helped, False)[members].sum(axis=1) / (members >= 0).sum(axis=1)
    order = np.lexsort((-spare, -part))
    taken: set[int] = set()
    chosen: list[Group] = []
    for row in members[order[: np.count_nonzero(part)]].tolist():
        group = tuple(i for i in row if i >= 0)
        if not taken.intersection(group):
            chosen.append(group)
            taken.update(group)
    chosen += [(i,) for i in by_gap if i not in taken]
    place = {i: k for k, i in enumerate(by_gap)}
    return sorted(chosen, key=lambda group: min(place[i] for i in group))
