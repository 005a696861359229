"""Simplicial cones for families without room: orthants, in coordinates that eigenvectors and Jordan chains give.

If a matrix has a defective dominant eigenvalue, every invariant cone has entries of P = T^-1 A T that are 0, and rays
that programs move do not get there exactly.  Here the coordinates T are exact:

    T = I
    lines in which kernels and ranges of the powers of A_s - lam_s I, of several s, meet
    (N^(n-1) v, .., N v, v), a Jordan chain of one A_s, each vector less a multiple of those before it.

In each of them the orthant {T D y : y >= 0}, D = diag(d), d_i = 1 or -1, is kept by all A_s if D P_s D has the right
signs.  An entry other than 0 of P_s, off the diagonal, decides whether d_i = d_j; what is not connected is positive.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import combinations, islice

import numpy as np

from ...exact.budget import spend
from ...exact.linalg import Rationals, columns, identity, nullspace, product, rank, solve_columns
from ...exact.matrix import Matrix
from ...exact.polynomials import rational_roots
from ..impossible.existence import spectrum_polynomial
from ..question import Candidate, Question

# States and members above which only the coordinates as given are tried, and how many bases of lines.
_LARGEST, _MEMBERS, _BASES = 8, 8, 30
# Multiples of the vectors before, in a chain.
_MULTIPLES = (0, 1, 4, 16, 64, 256)
# Operations for each number of an exact basis.
_PER_NUMBER = 1e4


def flag_orthants(question: Question) -> Iterator[Candidate]:
    """Orthants in exact coordinates that all matrices keep."""
    n, count = question.dim, question.matrices.shape[0]
    if not question.admits(n):
        return
    members = [question.searched[s].fractions() for s in range(count)]
    bases = _bases(question, members) if n <= _LARGEST and count <= _MEMBERS else iter([identity(n)])
    for T in bases:
        spend(_PER_NUMBER * count * n**2)
        P = [solve_columns(T, product(A, T)) for A in members]
        sides = _sides([p for p in P if p is not None], discrete=question.discrete)
        if sides is not None:
            yield _candidate(T * sides, [p * sides * sides[:, None] for p in P if p is not None])


def _candidate(T: Rationals, P: list[Rationals]) -> Candidate:
    inverse = np.linalg.inv(T.astype(float))
    return Candidate(
        rays=Matrix.from_fractions(T.T),
        pointing=inverse.sum(axis=0),
        right_inverse=inverse,
        multipliers=Matrix.stack([Matrix.from_fractions(p) for p in P]),
    )


def _sides(P: list[Rationals], *, discrete: bool) -> np.ndarray | None:
    """d with the right signs of d_i P_ij d_j for all matrices, or None."""
    signs = [np.sign(p).astype(int) for p in P]
    n = len(signs[0])
    sides = np.zeros(n, dtype=int)
    for first in range(n):
        waiting = [] if sides[first] else [first]
        sides[first] = sides[first] or 1
        while waiting:
            i = waiting.pop()
            for link in (part for M in signs for part in (M[i], M[:, i])):
                new = np.flatnonzero((link != 0) & (sides == 0))
                sides[new] = sides[i] * link[new]
                waiting += new.tolist()
    required = np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool)
    kept = all(((sides[:, None] * M * sides)[required] >= 0).all() for M in signs)
    return sides if kept else None


def _bases(question: Question, members: list[Rationals]) -> Iterator[Rationals]:
    """Coordinates worth trying."""
    n = question.dim
    yield identity(n)
    nilpotent = [
        N
        for N in (_shifted(question.searched[s], A, question.discrete) for s, A in enumerate(members))
        if N is not None
    ]
    yield from _meeting_lines([_flag(N) for N in nilpotent], n)
    for N in nilpotent:
        yield from _chains(N)


def _shifted(A: Matrix, M: Rationals, discrete: bool) -> Rationals | None:
    """A - lam I for its dominant eigenvalue, if that is rational."""
    values = np.linalg.eigvals(A.values)
    roots = rational_roots(spectrum_polynomial(A), values)
    top = float((np.abs(values) if discrete else values.real).max())
    near = [r for r in roots if abs(float(r) - top) <= 1e-3 * float(np.abs(values).max())]
    return M - max(near) * identity(len(M)) if near else None


def _flag(N: Rationals) -> list[Rationals]:
    """Kernels and ranges of the powers of N, as bases."""
    out, power = [], N
    for _ in range(len(N)):
        out += [nullspace(power), columns(power)]
        if len(out) > 2 and out[-1].shape[1] == out[-3].shape[1]:
            break
        power = product(power, N)
    return [V for V in out if 0 < V.shape[1] < len(N)]


def _meeting_lines(flags: list[list[Rationals]], n: int) -> Iterator[Rationals]:
    """Bases from lines in which two of the spaces meet, or that are one of them."""
    lines: dict[tuple[Fraction, ...], Rationals] = {}
    spaces = [(s, V) for s, flag in enumerate(flags) for V in flag]
    met = [V for _, V in spaces] + [_meet(V, W) for (s, V), (t, W) in combinations(spaces, 2) if s != t]
    for V in met:
        if V.shape[1] == 1:
            x = V[:, 0] / V[np.flatnonzero(V[:, 0])[0], 0]
            lines.setdefault(tuple(x), x)
    for some in islice(combinations(lines.values(), n), _BASES):
        T = np.array(some, dtype=object).T
        if rank(T) == n:
            yield T


def _meet(V: Rationals, W: Rationals) -> Rationals:
    """Basis of the vectors in both spaces."""
    return V @ nullspace(np.concatenate([V, -W], axis=1))[: V.shape[1]]


def _chains(N: Rationals) -> Iterator[Rationals]:
    """A Jordan chain that spans the space, each vector less a multiple of those before it."""
    n = len(N)
    last = next((v for v in identity(n) if len(_chain(N, v)) == n), None)
    if last is None:
        return
    T = np.array(_chain(N, last), dtype=object).T
    for multiple in _MULTIPLES:
        U = identity(n)
        for k in range(1, n):
            for j in range(k):
                U[:, k] = U[:, k] - multiple ** (n - k) * U[:, j]
        yield product(T, U)


def _chain(N: Rationals, v: Rationals) -> list[Rationals]:
    """.., N v, v, as long as they are not 0: independent, as N is nilpotent."""
    out: list[Rationals] = []
    while v.any() and len(out) <= len(N):
        out.insert(0, v)
        v = N @ v
    return out
