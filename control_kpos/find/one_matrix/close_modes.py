"""Cones for matrices whose eigenvalues are real, different, and closer to each other than doubles tell.

-hilbert(12) has eigenvalues between -1.8 and -1e-17: as doubles give them the dominant one may have either sign, and
its eigenvector is mixed with others.  Here eigenvalues come from the characteristic polynomial with many digits, and
eigenvectors V from one step of inverse iteration in rational arithmetic.  The cone S of the diagonal matrix of gaps,
which doubles hold with full relative accuracy, gives the cone R = V S of A, with P = R^-1 A R to many digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from ...exact.budget import affords, spend
from ...exact.linalg import Rationals, identity, nullspace, product, solve_columns
from ...exact.matrix import Matrix
from ...exact.polynomials import square_free_part
from ...exact.roots import root_discs
from ..impossible.existence import spectrum_polynomial
from ..question import Candidate, Question
from .explicit import modal_cone
from .modes import modes

_LARGEST = 24
# Binary digits of eigenvalues, and those to which vectors and multipliers are kept.
_DIGITS, _KEPT = 512, 400
# Operations for each n^4 of the solutions in rational arithmetic.
_PER_POWER = 2e3


def close_cones(question: Question) -> Iterator[Candidate]:
    """A simplicial cone for one matrix in continuous time, in exact numbers."""
    A = question.searched[0]
    n, effort = question.dim, _PER_POWER * question.dim**4
    if question.discrete or n > _LARGEST or not question.admits(n) or not affords(effort):
        return
    p = spectrum_polynomial(A)
    if len(square_free_part(p)) < len(p):
        return
    discs = ()
    for found in root_discs(p, _DIGITS):
        if not all(disc.is_real for disc in found):
            return
        discs = found
    if not discs:
        return
    spend(effort)
    M, values = A.fractions(), sorted((Fraction(disc.x, 2**disc.places) for disc in discs), reverse=True)
    V = np.array([_eigenvector(M, value) for value in values], dtype=object).T
    m = modes(np.diag([float(value - values[0]) for value in values]))
    cone = None if m is None else modal_cone(m, discrete=False, max_rays=n)
    if cone is None or cone.R.shape[1] != n:
        return
    R = _rounded(V @ np.array([[Fraction(float(x)) for x in row] for row in cone.R], dtype=object))
    P = solve_columns(R, product(M, R))
    if P is None:
        return
    inverse = np.linalg.inv(R.astype(float))
    yield Candidate(
        rays=Matrix.from_fractions(R.T),
        pointing=inverse.sum(axis=0),
        right_inverse=inverse,
        multipliers=Matrix.stack([Matrix.from_fractions(_rounded(P))]),
    )


def _eigenvector(M: Rationals, value: Fraction) -> Rationals:
    """Of the eigenvalue next to a number, largest entry 1 or -1."""
    shifted = M - value * identity(len(M))
    start = np.array([[Fraction(int(k))] for k in np.random.default_rng(0).integers(1, 100, len(M))], dtype=object)
    solved = solve_columns(shifted, start)
    v = (nullspace(shifted) if solved is None else solved)[:, 0]
    return _rounded(v / np.abs(v).max())


def _rounded(numbers: Rationals) -> Rationals:
    """To so many binary digits behind the point."""
    unit = 2**_KEPT
    return np.vectorize(lambda x: Fraction(round(x * unit), unit), otypes=[object])(numbers)
