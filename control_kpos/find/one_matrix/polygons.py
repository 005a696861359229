"""Circulant matrices on the corners of one polygon: rates and corners for one mode, or a few.

A circulant Q = sum_k c_k S^k, S the cyclic shift, has the eigenvalues sum_k c_k z^(jk), z = exp(2 pi i/m),
j = 0..m-1, so c follows from the wanted eigenvalues by a discrete Fourier transform, and what must hold is c_k >= 0
for k >= 1 (discrete time: also c_0 >= 0).  For one pair with decay gap a and frequency w that is
tan(pi/m) <= a/w (Dmitriev and Dynkin, 1946).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .grouping import spectra

_LARGEST = 100_000
# Up to so many corners every corner may flow to every other one.
_DENSE = 500


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

    @property
    def size(self) -> int:
        """Number of corners."""
        return len(self.rates)

    def shares(self, *, thin: bool) -> NDArray[np.float64]:
        """Convex weights of corners whose mean is zero: equal ones, or on three corners only if `thin`."""
        if not thin or len(self.corners) != 2 or self.size <= 6:
            return np.full(self.size, 1 / self.size)
        some = np.array([0, round(self.size / 3), round(2 * self.size / 3)])
        out = np.zeros(self.size)
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
        even = Polygon(rates, corners).shares(thin=m > _DENSE)
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
