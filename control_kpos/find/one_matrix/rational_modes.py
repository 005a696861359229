"""Cones for matrices with several dominant eigenvalues, in rational arithmetic.

When the dominant eigenvalue lam is not simple, invariance holds with equalities that no rounding
survives: the double integrator [[0, 1], [0, 0]] has cones, and matrices arbitrarily near it have none.
If lam is rational, R^n splits over the rationals into the generalised eigenspace G of lam (discrete
time: of all eigenvalues of modulus lam) and an invariant complement W with smaller eigenvalues.

* On a Jordan chain, A e_j = lam e_j + e_(j-1): the chain vectors themselves are generators.
* On an eigenspace of lam, or where A / lam acts with finite order m (roots of unity in discrete time),
  e and the finite orbits e +- A^i g / lam^i.
* On W, a polygon around e from the modes of A on W, with coordinates rounded to doubles.
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
    jordan_chains,
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


def rational_cones(A: Matrix, *, discrete: bool) -> Iterator[tuple[Matrix, NDArray[np.float64]]]:
    """Exact generators and a pointing vector, for a rational dominant eigenvalue.

    Yields
    ------
    rays : Matrix, shape (N, n)
    pointing : ndarray, shape (n,)
    """
    n = A.shape[0]
    if n > _LARGEST:
        return
    M = A.fractions()
    p = spectrum_polynomial(A)
    values = np.linalg.eigvals(A.values)
    guess = float(np.abs(values).max() if discrete else values.real.max())
    tried = {Fraction(guess), *(Fraction(guess).limit_denominator(d) for d in (1, 10, 1000, 10**6))}
    dominant = next(
        (x for x in sorted(tried, key=lambda x: x.denominator) if vanishes(p, x) and abs(x - guess) < 1e-2), None
    )
    if dominant is None:
        return
    order = 1
    if discrete and dominant > 0:
        orders = without_roots_of_unity(circle_part(scale_roots(p, 1 / dominant)))[1]
        order = lcm(*orders) if orders else 1
        if order > _LARGEST_ORDER:
            return
    eye = identity(n)
    shifted = power(M, order) - eye * dominant**order
    settled = power(shifted, n)
    G, W = nullspace(settled), columns(settled)
    e = nullspace(M - eye * dominant)[:, 0]
    functional = _pointing(M, dominant, G, W, e)
    core = None if (shifted @ G).any() else _orbits(M, dominant, order, G, e, functional)
    rows = core
    if core is None and order == 1:
        chains = jordan_chains(M - eye * dominant, G, lambda w: [w])
        rows = None if chains is None else [x for chain in chains for x in reversed(chain)]
    if rows is None:
        return
    apex = e if core is not None else rows[0]
    around = _polygon(M, dominant, apex, W, discrete)
    if around is None:
        return
    if core is None and W.shape[1]:
        rows = rows[1:]
    generators = np.array([*rows, *around], dtype=object)
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


def _pointing(M: Rationals, dominant: Fraction, G: Rationals, W: Rationals, e: Rationals) -> Rationals | None:
    """A left eigenvector with value 1 on e, or None (on a Jordan chain every left eigenvector vanishes on e)."""
    left = nullspace((M - identity(len(M)) * dominant).T)
    for k in range(left.shape[1]):
        height = left[:, k] @ e
        if height != 0:
            return left[:, k] / height
    return None


def _orbits(
    M: Rationals, dominant: Fraction, order: int, G: Rationals, e: Rationals, functional: Rationals | None
) -> list[Rationals] | None:
    """e +- the orbits of vectors g with functional'g = 0, under a map of finite order."""
    if functional is None:
        return None
    if G.shape[1] == 1:
        return []
    spanned: list[Rationals] = []
    rows: list[Rationals] = []
    for j in range(G.shape[1]):
        g = G[:, j] - e * (functional @ G[:, j])
        if not g.any() or (spanned and rank(np.array([*spanned, g], dtype=object)) == len(spanned)):
            continue
        for _ in range(order):
            if not spanned or rank(np.array([*spanned, g], dtype=object)) > len(spanned):
                spanned.append(g)
            rows += [e + g, e - g]
            g = M @ g / dominant if dominant else g
    # A semisimple eigenvalue needs a simplex only: e + g_1, .., e + g_k, e - sum of them.
    if order == 1:
        return [*(e + g for g in spanned), e - sum(spanned[1:], spanned[0])]
    unique: dict[tuple, Rationals] = {tuple(row): row for row in rows}
    return list(unique.values())


def _polygon(M: Rationals, dominant: Fraction, apex: Rationals, W: Rationals, discrete: bool) -> list[Rationals] | None:
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
    m = modes(reduced, discrete=discrete)
    found = None if m is None else modal_cone(m, discrete=discrete, max_rays=LARGE)
    if found is None:
        return None
    corners = found.R[1:] / found.R[0]
    return [apex + W @ np.array([Fraction(float(y)) for y in column], dtype=object) for column in corners.T]
