"""Which modes share a polygon.

A circulant Q = sum_k c_k S^k on m corners (S the cyclic shift) has the eigenvalues
sum_k c_k z^(jk), z = exp(2 pi i/m), j = 0..m-1; harmonic 0 is its column sum.  Given the eigenvalues,
c is a discrete Fourier transform away, and since the column sum t adds t/m to every c_k, there is a
least t, the *need* of the group, from which on c >= 0 (in continuous time c_0 is free).  A group of
modes with m - 1 dimensions that meets the need costs one generator per dimension, which is as cheap
as it gets; a complex pair alone may need a polygon with many more corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import require_seconds

Group = tuple[int, ...]

# Pairs, and real modes, with the smallest gaps that look for partners: groups of three grow with the cube.
_PARTNERS = 60


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


def groupings(targets: NDArray[np.complex128], top: float, *, discrete: bool, seed: int = 0) -> Iterator[list[Group]]:
    """Partitions of the modes into groups worth trying, each in a good order for attaching.

    Pairs that need no more than a triangle stay alone; the others look for partners.
    """
    gap = top - (np.abs(targets) if discrete else targets.real)
    by_gap = [int(i) for i in np.argsort(gap, kind="stable")]
    yield [(i,) for i in by_gap]
    pairs = [i for i in by_gap if targets[i].imag > 0]
    reals = [i for i in by_gap if targets[i].imag == 0]
    if len(pairs) + len(reals) < 2 or not pairs:
        return
    pairs, reals = pairs[:_PARTNERS], reals[:_PARTNERS]
    needed, members = _offers(targets, pairs, reals, top, discrete)
    alone = np.full(len(targets), -np.inf)
    alone[pairs] = needs(targets[None, pairs], None, discrete=discrete)
    rng = np.random.default_rng(seed)
    for trial in range(8):
        require_seconds()
        spare = top - needed
        if trial:
            spare = spare * rng.uniform(0.5, 1.5, len(spare))
        yield _greedy(members, alone >= (0.5 * top if trial % 2 else top), spare, by_gap)


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
    share = np.append(helped, False)[members].sum(axis=1) / (members >= 0).sum(axis=1)
    order = np.lexsort((-spare, -share))
    taken: set[int] = set()
    chosen: list[Group] = []
    for row in members[order[: np.count_nonzero(share)]].tolist():
        group = tuple(i for i in row if i >= 0)
        if not taken.intersection(group):
            chosen.append(group)
            taken.update(group)
    chosen += [(i,) for i in by_gap if i not in taken]
    place = {i: k for k, i in enumerate(by_gap)}
    return sorted(chosen, key=lambda group: min(place[i] for i in group))
