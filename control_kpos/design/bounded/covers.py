"""Whether f'x <= b on [0, x_max]: a g with g, g - f in X* and g'x_max <= b, or a state x of the interval with f'x > b.

On a simplicial cone, with x_max = sum_k a_k x_k for the generators x_k, g'x_k = max(0, f'x_k) is best, and x is the
sum of the a_k x_k with f'x_k > 0.  On other cones g solves a linear program with n variables; in fractions, where
doubles do not prove the bound, multipliers l_k >= 0 with sum_k l_k x_k = x_max and sum_k l_k max(0, f'x_k) > b
contradict it (Farkas), and x is the sum of the l_k x_k with f'x_k > 0.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ...cones import Cone, Orthant
from ...errors import TooLargeError
from ...exact.linalg import Rationals
from ...exact.matrix import Matrix
from ...exact.program import Block, Program
from ...exact.rational_programs import exact_feasibility
from ...proof.portable_cones import opposite_facets

Covered = tuple[Matrix | None, Matrix | None]


def covered(X: Cone, rows: Matrix, limits: Matrix, x_max: Matrix) -> list[Covered]:
    """For every row f and limit b exactly one of g, a row, and x; both None where neither was found.

    Parameters
    ----------
    X : Cone
    rows : Matrix, shape (k, n)
    limits : Matrix, shape (k,)
    x_max : Matrix, shape (n,)
    """
    if isinstance(X, Orthant):
        return _on_orthant(rows, limits, x_max)
    end, pairs = x_max.fractions(), list(zip(rows.fractions(), limits.fractions(), strict=True))
    rays = X.exact_rays.plain().fractions()
    if not X.is_simplicial:
        return [_searched(X, rays, rays @ f, b, end) for f, b in pairs]
    H, heights = opposite_facets(X, rays)
    parts, out = (H @ end) / heights, []
    for f, b in pairs:
        values = rays @ f
        out.append(_chosen((np.maximum(values, 0) / heights) @ H, rays.T @ np.where(values > 0, parts, 0), b, end))
    return out


def _on_orthant(rows: Matrix, limits: Matrix, x_max: Matrix) -> list[Covered]:
    """The positive parts of the rows, in integers: fractions take several times as long."""
    (f, unit), (end, length) = rows.as_integers(), x_max.as_integers()
    above, of_g, of_end = np.maximum(f, 0), Fraction(unit), Fraction(length)
    g = Matrix.over(above * of_g.numerator, of_g.denominator)
    out, most = list[Covered](), limits.fractions() / (of_g * of_end)
    for i, is_kept in enumerate(above @ end <= most):
        x = None if is_kept else Matrix.over(np.where(f[i] > 0, end, 0) * of_end.numerator, of_end.denominator)
        out.append((g[i : i + 1] if is_kept else None, x))
    return out


def _chosen(g: Rationals, x: Rationals, b: Fraction, end: Rationals) -> Covered:
    if g @ end <= b:
        return Matrix.from_fractions(g[None]), None
    return None, Matrix.from_fractions(x)


def _searched(X: Cone, rays: Rationals, values: Rationals, b: Fraction, end: Rationals) -> Covered:
    g = _by_program(X, rays, np.maximum(values, 0), end)
    if g is not None and g @ end <= b:
        return Matrix.from_fractions(g[None]), None
    return _in_fractions(rays, values, b, end)


def _by_program(X: Cone, rays: Rationals, needed: Rationals, end: Rationals) -> Rationals | None:
    """g with g'x_k >= needed_k from a solver, moved into X* by as much as it misses."""
    cost = np.array([float(a) for a in end])
    program = Program(g=Block(X.dim, cost=cost))
    program.above(np.array([float(a) for a in needed]), g=np.asarray(X.rays, dtype=float))
    answer = program.solve()
    if not answer:
        return None
    g, inner = (Matrix(np.asarray(part, dtype=float)).fractions() for part in (answer["g"], X.dual.interior_point))
    missing = max([Fraction(0), *((needed - rays @ g) / (rays @ inner)).tolist()])
    return g + missing * inner


def _in_fractions(
    rays: Rationals, values: Rationals, b: Fraction, end: Rationals
) -> tuple[Matrix | None, Matrix | None]:
    """g = g+ - g- with rays g - slack = needed and end'g + t = b, or what contradicts it."""
    needed, eye = np.maximum(values, 0), np.eye(len(rays), dtype=int).astype(object)
    zeros = np.zeros((len(rays), 1), dtype=int).astype(object)
    above = np.concatenate([rays, -rays, -eye, zeros], axis=1)
    last = np.concatenate([end, -end, zeros[:, 0], [1]])
    rows, right = np.concatenate([above, last[None]]), np.concatenate([needed, np.array([b], dtype=object)])
    try:
        found, y = exact_feasibility(Matrix.from_fractions(rows), Matrix.from_fractions(right))
    except TooLargeError:
        return None, None
    if found is not None:
        n = rays.shape[1]
        return Matrix.from_fractions((found[:n] - found[n : 2 * n])[None]), None
    if y is None or y[-1] <= 0:
        return None, None
    return None, Matrix.from_fractions(rays.T @ np.where(values > 0, -y[:-1] / y[-1], 0))
