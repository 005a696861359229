"""Simplicial cones through a vector for matrices with rational eigenvalues, exactly.

    g_0 = b,   g_(k+1) = (A - m_k I) g_k     so that     A g_k = m_k g_k + g_(k+1)

for the eigenvalues m_0..m_(n-1) in any order: A annihilates what comes after g_(n-1), so the cone of the g_k is
invariant (Cumani, 1982).  It lies in c'x >= 0 if c'g_k >= 0 for all k.  Nothing is rounded: repeated
eigenvalues and zeros of any relative degree are no trouble.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice, permutations

import numpy as np

from ...exact.linalg import Rationals, solve_columns
from ...exact.matrix import Matrix
from ...exact.polynomials import rational_roots
from ..impossible.existence import spectrum_polynomial

_LARGEST = 16
_ORDERS = 200


def rational_chains(
    A: Matrix, vectors: Matrix, normals: Matrix, *, discrete: bool
) -> Iterator[tuple[Matrix, Matrix, Matrix]]:
    """Cones that hold all vectors and lie in all half-spaces.

    Yields
    ------
    rays : Matrix, shape (n, n)
    multipliers : Matrix, shape (n, n)
    combinations : Matrix, shape (k, n)
        The vectors as combinations of the generators.
    """
    n = A.shape[0]
    if n > _LARGEST:
        return
    roots = rational_roots(spectrum_polynomial(A), np.linalg.eigvals(A.values))
    if len(roots) < n or (discrete and min(roots) < 0):
        return
    M, B = A.fractions(), vectors.fractions()
    C = Matrix.from_fractions(normals.rows_as_integers(np.arange(normals.shape[0]))).fractions()
    for order in _orders(roots):
        for b in B:
            R = _chain(M, b, order, C)
            combinations = None if R is None else _combinations(R, B)
            if R is None or combinations is None:
                continue
            P = np.array([[Fraction(0)] * n for _ in range(n)], dtype=object)
            for k, root in enumerate(order):
                P[k, k] = root
                if k + 1 < n:
                    P[k + 1, k] = Fraction(1)
            exact = Matrix.from_fractions
            yield exact(R), exact(P), exact(combinations)


def _orders(roots: list[Fraction]) -> Iterator[tuple[Fraction, ...]]:
    """Different orders of the eigenvalues, monotone ones first."""
    falling = tuple(sorted(roots, reverse=True))
    seen = {falling, falling[::-1]}
    yield from sorted(seen, reverse=True)
    for order in islice(permutations(falling), 5 * _ORDERS):
        if order not in seen and len(seen) < _ORDERS:
            seen.add(order)
            yield order


def _chain(M: Rationals, b: Rationals, order: tuple[Fraction, ...], C: Rationals) -> Rationals | None:
    """The vectors g_k as rows, or None if they leave a half-space or end too early."""
    rows = [b]
    for root in order[:-1]:
        rows.append(M @ rows[-1] - root * rows[-1])
    R = np.array(rows, dtype=object)
    if not all(row.any() for row in R) or (len(C) and (C @ R.T < 0).any()):
        return None
    return R


def _combinations(R: Rationals, B: Rationals) -> Rationals | None:
    """Nonnegative coordinates of the rows of B in the basis R, or None."""
    coordinates = solve_columns(R.T, B.T)
    return None if coordinates is None or (coordinates < 0).any() else coordinates.T
