"""Candidates for storage functions and supply rates, and the rational alternative.

Candidates solve (v'A - q'C) x_i <= 0, (v'B - r' - q'D) u_j <= 0 of Theorem 3 up to rounding.  Nothing here is trusted:
`dissipativity` proves what is proposed, or drops it.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ..errors import TooLargeError
from ..exact.matrix import Matrix, dense
from ..exact.program import Block, Program
from ..exact.rational_programs import exact_feasibility
from ..systems.system import System
from .lyapunov_candidates import ScaledProblem, SingularMatrixError

Vector = NDArray[np.float64]
Rationals = NDArray[np.object_]
# How far the storage is moved into int X*, relative to the storage itself.  A little where the least
# supply is asked for, as far as a given supply allows for the sake of the decay rate.
_LEAST = (1e-6, 1e-9, 1e-3, 1e-12, 1e-1)
_GIVEN = (1.0, 0.1, 1e-2, 1e-3, 1e-6, 1e-9, 1e-12)
_RATIONAL_ROWS = 120
# Margin where the least supply is sought, as small as for the solves.
_LEAST_MARGIN = 1e-6


def storage_candidates(
    p: System, supply_q: Matrix, supply_r: Matrix | None, *, free_q: bool
) -> Iterator[tuple[Vector, Matrix]]:
    """Storages worth proving, most useful first, with the q that each is for; `free_q`: multiples of the one given."""
    q, r = dense(supply_q.values)[0], None if supply_r is None else dense(supply_r.values)[0]
    least = _LeastStorage.of(p)
    if free_q and r is not None:
        if least is not None:
            for inwards in _LEAST:
                v0, v1 = least.storage(q), least.inside
                part = _largest_part(p, v0 + inwards * _ratio(v0, v1) * v1, q, r)
                for back in (0.0, 1e-12, 1e-6):
                    g = part * (1 - back)
                    if 0 < g < np.inf:
                        v = g * (v0 + inwards * _ratio(v0, v1) * v1)
                        yield v, Matrix(g * q[None])
        program = _program(p, q, r, free_q=True)
        if program is not None:
            yield program[0], Matrix(program[1][None])
        return
    if least is not None:
        v0, v1 = least.storage(q), least.inside
        for inwards in _LEAST if r is None else _GIVEN:
            yield v0 + inwards * _ratio(v0, v1) * v1, supply_q
    program = _program(p, q, r, free_q=False)
    if program is not None:
        yield program[0], supply_q


class _LeastStorage:
    """v = S^{-T}(C'q - a little of int X*) for a stable S = A (A - I in discrete time)."""

    def __init__(self, p: System, inside: Vector) -> None:
        self.p, self.inside = p, inside
        S = dense(p.A.values)
        self.S = S - np.eye(len(S)) if p.discrete else S

    @classmethod
    def of(cls, p: System) -> _LeastStorage | None:
        try:
            inside = ScaledProblem(p.A, p.X, p.discrete).left_vector(0.0)
        except SingularMatrixError:
            return None
        return cls(p, inside) if (p.X.exact_rays.values @ inside > 0).all() else None

    def storage(self, q: Vector) -> Vector:
        with np.errstate(all="ignore"):
            try:
                return np.asarray(np.linalg.solve(self.S.T, np.asarray(self.p.C.values.T @ q)), dtype=np.float64)
            except np.linalg.LinAlgError:
                return np.full(len(self.S), np.nan)


def _ratio(v: Vector, inside: Vector) -> float:
    size, unit = np.abs(v).max(initial=0.0), np.abs(inside).max(initial=0.0)
    return float(size / unit) if size > 0 and unit > 0 and np.isfinite(size) else 1.0


def _largest_part(p: System, v: Vector, q: Vector, r: Vector) -> float:
    """The largest g with g (v'B - q'D) u_j <= r'u_j for all generators u_j."""
    rays = dense(p.U.exact_rays.values)
    need = rays @ (v @ dense(p.B.values) - q @ dense(p.D.values))
    have = rays @ r
    with np.errstate(all="ignore"):
        parts = np.where(need > 0, have / need, np.where(have >= 0, np.inf, -np.inf))
    part = float(parts.min())
    return 1.0 if part == np.inf else part


def _program(p: System, q: Vector, r: Vector | None, *, free_q: bool) -> tuple[Vector, Vector] | None:
    """The storage of largest common margin by a linear program; with `free_q` also q = -g f, q = f given.

    Unknowns: v, the margin t, and r or g where they are free.
    """
    A, B, C, D = (dense(m.values) for m in (p.A, p.B, p.C, p.D))
    S = A - np.eye(len(A)) if p.discrete else A
    X, U = dense(p.X.exact_rays.values), dense(p.U.exact_rays.values)
    n = len(A)
    with np.errstate(all="ignore"):
        X = X / np.abs(X).max(axis=1, keepdims=True)
        U = U / np.abs(U).max(axis=1, keepdims=True)
        drift, push = X @ S.T, U @ B.T
    column_c, column_d = X @ (C.T @ q), U @ (D.T @ q)
    margin = np.ones(len(X))
    if free_q:
        program = Program(v=Block(n), t=Block(1, 0.0, 1.0, -1e-3), g=Block(1, high=1e6, cost=-1.0))
        program.above(0.0, margin, name="t", v=X)
        program.below(0.0, v=drift, t=margin, g=-column_c)
        program.below(U @ r, v=push, g=-column_d)
    elif r is not None:
        program = Program(v=Block(n), t=Block(1, 0.0, 1.0, -1.0))
        program.above(0.0, margin, name="t", v=X)
        program.below(column_c, v=drift, t=margin)
        program.below(U @ r + column_d, v=push)
    else:  # least supply on the generators of U
        program = Program(v=Block(n, cost=push.sum(axis=0)))
        program.above(_LEAST_MARGIN, v=X)
        program.below(column_c - _LEAST_MARGIN, v=drift)
    answer = program.solve()
    if not answer:
        return None
    return answer["v"], q * (answer["g"][0] if free_q else 1.0)


def supply_witness(p: System, q: Matrix, r: Matrix | None) -> tuple[Rationals | None, Rationals, Rationals] | None:
    """Settle dissipativity for given q and r in rational arithmetic.

    Motzkin's theorem of the alternative: either some storage v satisfies the inequalities of the theorem,
    or X a = S X b + B U c for some a, b, c >= 0 with supply q'C X b + (r' + q'D) U c <= 0 and not all of
    a, b and the supply zero.  With r free the input is left out.

    Returns
    -------
    (v, ., .) or (None, x, u) with x = X b and u = U c, or None where the problem is too large.
    """
    A, B, C, D = (
        Matrix(dense(m.values), m.radius, m.numerators, m.denominator).fractions() for m in (p.A, p.B, p.C, p.D)
    )
    n, m = B.shape
    if n > _RATIONAL_ROWS:
        return None
    S = A - np.eye(n, dtype=int).astype(object) if p.discrete else A
    X = p.X.exact_rays.rows_as_integers(np.arange(p.X.n_rays)).T
    U = p.U.exact_rays.rows_as_integers(np.arange(p.U.n_rays)).T
    k = 0 if r is None else U.shape[1]
    U = U[:, :k]
    exact_q, exact_r = q.plain().fractions()[0], (Matrix.zeros(1, m) if r is None else r.plain()).fractions()[0]
    a, b = X.shape[1], X.shape[1]
    M = np.zeros((n + 2, a + b + k + 1), dtype=object)
    M[:n, :a], M[:n, a : a + b], M[:n, a + b : a + b + k] = X, -(S @ X), -(B @ U)
    M[n, a : a + b], M[n, a + b : a + b + k], M[n, -1] = exact_q @ (C @ X), (exact_r + exact_q @ D) @ U, 1
    M[n + 1, : a + b], M[n + 1, -1] = 1, 1
    try:
        combination, farkas = exact_feasibility(M, [0] * (n + 1) + [1])
    except TooLargeError:
        return None
    if farkas is not None:
        return farkas[:n] / farkas[n], np.empty(0, dtype=object), np.empty(0, dtype=object)
    if combination is None:
        return None
    x = X @ combination[a : a + b]
    u = U @ combination[a + b : a + b + k] if k else np.array([Fraction(0)] * m, dtype=object)
    return None, x, u
