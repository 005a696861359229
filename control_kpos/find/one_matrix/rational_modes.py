"""Cones for matrices in discrete time whose dominant eigenvalues are r times roots of unity, r rational.

R^n splits over the rationals into the generalised eigenspace G of all eigenvalues of modulus r and an invariant
complement W with smaller eigenvalues.  Where A / r acts on G with finite order m, its cone has the generators
e +- A^i g / r^i, e an eigenvector for r and g in G; on W it is a polygon around e from the modes of A on W, with
coordinates rounded to doubles.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import lcm

import numpy as np
from numpy.typing import NDArray

from ...exact.linalg import (
    Rationals,
    columns,
    identity,
    nullspace,
    power,
    product,
    rank,
    solve_columns,
)
from ...exact.matrix import Matrix
from ...exact.polynomials import (
    circle_part,
    scale_roots,
    vanishes,
    without_roots_of_unity,
)
from ..impossible.existence import spectrum_polynomial
from .explicit import LARGE, modal_cone
from .modes import modes

_LARGEST = 24
_LARGEST_ORDER = 60


def rational_cones(A: Matrix) -> Iterator[tuple[Matrix, NDArray[np.float64]]]:
    """Exact generators and a pointing vector.

    Yields
    ------
    rays : Matrix, shape (N, n)
    pointing : ndarray, shape (n,)
    """
    n = A.shape[0]
    if n > _LARGEST:
        return
    M, p = A.fractions(), spectrum_polynomial(A)
    guess = float(np.abs(np.linalg.eigvals(A.values)).max())
    tried = {Fraction(guess), *(Fraction(guess).limit_denominator(d) for d in (1, 10, 1000, 10**6))}
    found = [r for r in tried if r > 0 and vanishes(p, r) and abs(r - guess) < 1e-2]
    if not found:
        return
    dominant = min(found, key=lambda r: r.denominator)
    orders = without_roots_of_unity(circle_part(scale_roots(p, 1 / dominant)))[1]
    order = lcm(*orders) if orders else 1
    if order > _LARGEST_ORDER:
        return
    eye = identity(n)
    shifted = power(M, order) - eye * dominant**order
    settled = power(shifted, n)
    G, W = nullspace(settled), columns(settled)
    e = nullspace(M - eye * dominant)[:, 0]
    functional = _pointing(M, dominant, e)
    if functional is None or (shifted @ G).any():
        return
    around = _polygon(M, dominant, e, W)
    if around is None:
        return
    generators = np.array([*_orbits(M, dominant, order, G, e, functional), *around], dtype=object)
    pointing = _heights(generators)
    if pointing is not None:
        yield Matrix.from_fractions(generators), pointing


def _heights(generators: Rationals) -> NDArray[np.float64] | None:
    """A vector with positive product with every generator: least squares is enough for cones around an axis."""
    values = generators.astype(float)
    values = values / np.linalg.norm(values, axis=1, keepdims=True)
    w = np.linalg.lstsq(values, np.ones(len(values)), rcond=None)[0]
    if (values @ w > 1e-9).all():
        return w
    from_dual = np.linalg.pinv(values).sum(axis=1)
    return from_dual if (values @ from_dual > 1e-9).all() else None


def _pointing(M: Rationals, dominant: Fraction, e: Rationals) -> Rationals | None:
    """A left eigenvector with value 1 on e, or None (on a Jordan chain every left eigenvector vanishes on e)."""
    left = nullspace((M - identity(len(M)) * dominant).T)
    heights = left.T @ e
    some = np.flatnonzero(heights)
    return left[:, some[0]] / heights[some[0]] if some.size else None


def _orbits(
    M: Rationals, dominant: Fraction, order: int, G: Rationals, e: Rationals, functional: Rationals
) -> list[Rationals]:
    """e +- the orbits of vectors g with functional'g = 0, under a map of finite order."""
    spanned: list[Rationals] = []
    rows: list[Rationals] = []
    for j in range(G.shape[1]):
        g = G[:, j] - e * (functional @ G[:, j])
        if not g.any() or rank(np.array([*spanned, g], dtype=object)) == len(spanned):
            continue
        for _ in range(order):
            if rank(np.array([*spanned, g], dtype=object)) > len(spanned):
                spanned.append(g)
            rows += [e + g, e - g]
            g = M @ g / dominant
    return list({tuple(row): row for row in rows}.values())


def _polygon(M: Rationals, dominant: Fraction, apex: Rationals, W: Rationals) -> list[Rationals] | None:
    """apex + W y for the corners y of a polytope that is invariant relative to the dominant eigenvalue."""
    d = W.shape[1]
    if not d:
        return []
    inner = solve_columns(W, product(M, W))
    if inner is None:
        return None
    reduced = np.zeros((d + 1, d + 1))
    reduced[0, 0] = float(dominant)
    reduced[1:, 1:] = inner.astype(float)
    m = modes(reduced, discrete=True)
    found = None if m is None else modal_cone(m, discrete=True, max_rays=LARGE)
    if found is None:
        return None
    corners = found.R[1:] / found.R[0]
    return [apex + W @ np.array([Fraction(float(y)) for y in column], dtype=object) for column in corners.T]
