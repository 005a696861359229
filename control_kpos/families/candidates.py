"""Candidates for a common vector: worst mixtures, one solve each, or a linear program.  Nothing here is trusted.

On a simplicial cone X a common e, A_s e in -int X for all s, exists if and only if every *mixture* is stable: the
matrices M with h_k'M = h_k'A_s(k) for the facets h_k, each with an s(k) of its own.  Policy iteration: solve
M e = -d for some d in int X, and let every facet take the s with the largest h_k'A_s e, keeping the old one in ties.
e rises in the order of X, so this ends, in a handful of solves, with the least e such that A_s e + d in -X for all s,
or with a mixture that is not stable.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..cones import Cone
from ..cones.polyhedral import has_open_facets
from ..exact.budget import affords
from ..exact.matrix import Matrix
from ..exact.program import Block, Program, alternative
from ..exact.programs import program_effort
from ..theorems.krylov import bicgstab, norm
from .common_vector import NoCommonVector

Floats = NDArray[np.float64]
# Solves of a policy iteration; 3 suffice for most families.
_SOLVES = 30
# Relative changes that are rounding, and no improvement; iterations and accuracy of a sparse solve.
_TIE, _STEPS, _GOAL = 1e-12, 500, 1e-13
# How far inside X a common vector is sought, relative to the generators.
_INTERIOR = 1e-6
# Rows times columns of an exact program.
_EXACT = 5000
# Matrices with more rows are taken sparse.
_DENSE = 400


def common_candidates(X: Cone, matrices: Sequence[Matrix], *, discrete: bool, rate: float = 0.0) -> Iterator[Floats]:
    """Vectors e inside X that all A + rate I may map into -X (A - I + rate I in discrete time).

    Parameters
    ----------
    X : Cone
    matrices : sequence of Matrix, shape (n, n)
    discrete : bool
    rate : float

    Yields
    ------
    ndarray, shape (n,)
    """
    if X.is_simplicial:
        found = worst_mixture(X, matrices, discrete=discrete, rate=rate)
        if found is not None:
            yield found
    if X.dim <= _DENSE and not has_open_facets(X):
        found = inside(np.asarray(X.rays), np.asarray(X.facets), matrices, discrete=discrete, rate=rate)
        if found is not None:
            yield found


def worst_mixture(X: Cone, matrices: Sequence[Matrix], *, discrete: bool, rate: float = 0.0) -> Floats | None:
    """The e of the worst mixture on a simplicial cone; None if a mixture is not stable."""
    H = _form(X.exact_facets.values, X.dim)
    moved = [_form(H @ (_form(A.values, X.dim) + (rate - discrete) * _eye(X.dim)), X.dim) for A in matrices]
    push = H @ np.asarray(X.interior_point)
    chosen, every = np.zeros(X.dim, dtype=int), np.arange(X.dim)
    e: Floats | None = np.zeros(X.dim)
    for _ in range(_SOLVES):
        e = _solved(_picked(moved, chosen), -push, e)
        if e is None or not (H @ e > 0).all():
            return None
        values = np.array([G @ e for G in moved])
        now = values[chosen, every]
        better = values.max(axis=0) > now + _TIE * push
        if not better.any():
            return e
        chosen = np.where(better, values.argmax(axis=0), chosen)
    return None


def _form(M: Any, n: int) -> Any:
    """Dense up to a size, sparse beyond."""
    if n > _DENSE:
        return sp.csr_array(M)
    return M.toarray() if sp.issparse(M) else np.asarray(M)


def _eye(n: int) -> Any:
    return sp.eye_array(n, format="csr") if n > _DENSE else np.eye(n)


def _picked(moved: list[Any], chosen: NDArray[np.intp]) -> Any:
    """Row k of the matrix with number chosen[k]."""
    if isinstance(moved[0], np.ndarray):
        return np.array(moved)[chosen, np.arange(len(chosen))]
    picks = [sp.diags_array((chosen == s).astype(float)) @ G for s, G in enumerate(moved)]
    return sp.csr_array(sum(picks[1:], picks[0]))


def _solved(G: Any, b: Floats, near: Floats) -> Floats | None:
    """G e = b, or None."""
    if isinstance(G, np.ndarray):
        try:
            e: Any = np.linalg.solve(G, b)
        except np.linalg.LinAlgError:
            return None
    else:
        e = _iterated(G, b, near)
    return e if np.isfinite(e).all() else None


def _iterated(G: Any, b: Floats, near: Floats) -> Floats:
    """By BiCGSTAB over the diagonal, which sparse factors of a random graph do not beat; by factors where it stalls."""
    own = G.diagonal()
    if (own != 0).all():
        T, right = sp.eye_array(len(b), format="csr") - sp.diags_array(1 / own) @ G, b / own
        e, _ = bicgstab(T, right, near, _GOAL * norm(right), _STEPS)
        if np.isfinite(e).all() and np.abs(G @ e - b).max() <= 1e-9 * np.abs(b).max():
            return e
    try:
        return spla.splu(sp.csc_array(G)).solve(b)
    except RuntimeError:
        return np.full(len(b), np.nan)


def inside(
    rays: Floats,
    facets: Floats,
    matrices: Sequence[Matrix],
    *,
    discrete: bool,
    rate: float = 0.0,
    scale: float | None = None,
) -> Floats | None:
    """x inside a cone with M x + rate x in the negative cone for all M (M - I in discrete time), in floating point.

    Parameters
    ----------
    rays, facets : ndarray, shapes (p, n) and (r, n)
    matrices : sequence of Matrix, shape (n, n)
    discrete : bool
    rate : float
    scale : float, optional
        Size of the matrices, against which margins count; by default the largest entry seen in generators and facets.
    """
    if not affords(program_effort((len(matrices) + 1) * len(facets), len(rays))):
        return None
    columns, shift = rays.T, (rate - discrete) * np.eye(rays.shape[1])
    H = facets / (facets @ columns).max(axis=1)[:, None]
    moved = np.concatenate([H @ (np.asarray(_form(M.values, 0)) + shift) @ columns for M in matrices])
    scale = max(float(np.abs(moved).max()), 1e-300) if scale is None else scale
    # a sum of generators with coefficients; the largest common margin
    program = Program(coefficients=Block(len(rays), low=0.0, high=1.0), margin=Block(1, low=-1.0, cost=-1.0))
    program.above(0.0, np.full(len(moved), scale), coefficients=-moved)
    program.below(-_INTERIOR, coefficients=-H @ columns)
    answer = program.solve()
    return columns @ answer["coefficients"] if answer else None


def no_common(X: Cone, matrices: Sequence[Matrix], *, discrete: bool) -> NoCommonVector | None:
    """The witness that no e exists, in exact arithmetic; None if one exists, or the family is too large for that.

    Parameters
    ----------
    X : Cone
    matrices : sequence of Matrix, shape (n, n)
    discrete : bool
    """
    n, r = X.dim, 0 if has_open_facets(X) else X.n_facets
    if not r or (len(matrices) + 1) * r * n > _EXACT:
        return None
    H, eye = X.exact_facets.plain().fractions(), np.eye(n, dtype=int).astype(object)
    moved = [-(H @ (A.dense().fractions() - int(discrete) * eye)) for A in matrices]
    rows = np.concatenate([H, *moved])
    multipliers, _ = alternative(rows, np.ones(len(rows), dtype=bool))
    if multipliers is None:
        return None
    vectors = np.array([multipliers[r + s * r : 2 * r + s * r] @ H for s in range(len(matrices))], dtype=object)
    size: Any = max(1, *np.abs(vectors).ravel())
    return NoCommonVector(Matrix.from_fractions(np.asarray(vectors / size, dtype=object)))
