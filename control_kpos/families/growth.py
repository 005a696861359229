"""Candidates for growth under switching: vectors by next mode, cycles of modes, mixtures.  Nothing here is trusted.

In generator coordinates of a simplicial cone, A_s x_r = sum_k P_s[k, r] x_k and a_s[r] = v_s'x_r, the least gamma with
(gamma v_s - A_s'v_t)'x_r >= 0 is the eigenvalue of the monotone operator a_s -> max_t P_s'a_t (entry by entry), found
by iteration from a > 0; the largest quotient bounds it from above at every step.  Other cones: bisection of gamma, one
linear program each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import product as words
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cones import Cone
from ..cones.orthant import Orthant
from ..exact.budget import affords, spend
from ..exact.matrix import Matrix
from ..exact.program import Block, Program
from ..exact.programs import program_effort
from ..proof.certificate import exactly
from ..proof.weights import product
from ..theorems.growing_direction import InstabilityDirection
from ..theorems.positivity import state_positivity
from ..theorems.stability import lyapunov_on

Floats = NDArray[np.float64]
# Iterations, what is added to make every entry positive, and how close the quotients come.
_STEPS, _ADDED, _CLOSE = 3000, (0.0, 1e-12, 1e-9), 1e-13
_HALVINGS = 50
# Products tried for cycles, dimension up to which they are, and how close to the largest radius counts as equal.
_WORDS, _DENSE, _EQUAL = 2000, 60, 1e-9
# Points on every segment of the search for mixtures, rounds, and denominators that weights are rounded to.
_POINTS, _ROUNDS, _DENOMINATORS = 33, 6, (8, 64, 4096, 2**30)


# -- next-mode vectors


def next_mode_vectors(X: Cone, matrices: Sequence[Matrix]) -> Iterator[tuple[Floats, float]]:
    """Vectors v_s, one a row, and the growth that they prove up to rounding."""
    if X.is_simplicial and (isinstance(X, Orthant) or X.dim <= 400):
        transposed = [in_generators(A.values, X) for A in matrices]

        def worst(a: Floats) -> Floats:
            return np.array([(P @ a.T).max(axis=1) for P in transposed])

        for added in _ADDED:
            yield iterated(worst, X, len(matrices), added)
    elif X.dim <= 400:
        yield from _bisected(X, matrices)


def in_generators(A: Any, X: Cone) -> Any:
    """P' for A x_r = sum_k P[k, r] x_k on a simplicial cone that A keeps."""
    if isinstance(X, Orthant):
        return sp.csr_array(A.T) if sp.issparse(A) else np.maximum(np.asarray(A).T, 0)
    A, rays = A.toarray() if sp.issparse(A) else np.asarray(A), np.asarray(X.rays, dtype=float)
    return np.maximum(rays @ A.T @ np.linalg.inv(rays), 0)


def iterated(
    operator: Callable[[Floats], Floats], X: Cone, count: int, added: float = 0.0, goal: float = np.nan
) -> tuple[Floats, float]:
    """Vectors v_s, one a row, with operator(a) <= gamma a up to rounding for a_s[r] = v_s'x_r; nearly the least gamma.

    The operator is monotone, and that of a multiple is the multiple.  With a goal, gamma on one side of it will do.
    """
    a, best, least = np.ones((count, X.dim)), np.ones((count, X.dim)), np.inf
    for _ in range(_STEPS):
        moved = operator(a)
        moved = moved + added * moved.max()
        ratio = moved / a
        high, low = ratio.max(), ratio.min()
        if high < least:
            best, least = a, high
        if not high - low > _CLOSE * high or high < goal or low >= goal:
            break
        a = a + moved / high  # the operator and the identity: cycles of the first do not matter
        a = np.maximum(a / a.max(), 1e-200)
    return (best if isinstance(X, Orthant) else best @ np.linalg.inv(np.asarray(X.rays, dtype=float)).T), float(least)


def _bisected(X: Cone, matrices: Sequence[Matrix]) -> Iterator[tuple[Floats, float]]:
    rays, facets = np.asarray(X.rays, dtype=float), np.asarray(X.facets, dtype=float)
    count, n = len(matrices), X.dim
    spend(_HALVINGS * program_effort(count**2 * len(rays), count * n))
    dense = [A.values.toarray() if sp.issparse(A.values) else np.asarray(A.values) for A in matrices]
    middle = facets.sum(axis=0)
    high = max(float((rays @ A.T @ middle / (rays @ middle)).max()) for A in dense)
    low, found = 0.0, np.tile(middle, (count, 1))
    for _ in range(_HALVINGS):
        gamma = (low + high) / 2
        vs = _program(rays, dense, gamma)
        low, high, found = (gamma, high, found) if vs is None else (low, gamma, vs)
        if high - low < 1e-9 * high:
            break
    for more in (1e-12, 1e-9, 1e-7):
        yield found, high * (1 + more)


def _program(rays: Floats, matrices: list[Floats], gamma: float) -> Floats | None:
    """Vectors for this growth, or None."""
    count, n = len(matrices), rays.shape[1]
    names = [f"v{s}" for s in range(count)]
    program, none = Program(**{name: Block(n, -1e6, 1e6) for name in names}), np.zeros(len(rays))
    for s, A in enumerate(matrices):
        positive: Any = {names[s]: rays}
        program.above(none + 1, 0.0, **positive)
        for t in range(count):
            parts: Any = (
                {names[s]: gamma * rays, names[t]: -(rays @ A.T)}
                if s != t
                else {names[s]: rays @ (gamma * np.eye(n) - A.T)}
            )
            program.above(np.zeros(len(rays)), **parts)
    answer = program.solve()
    return np.array([answer[name] for name in names]) if answer else None


# -- cycles


def cycles(X: Cone, matrices: Sequence[Matrix]) -> Iterator[tuple[tuple[int, ...], Floats]]:
    """Modes of cycles with (nearly) the largest radius of the product per step, short ones first, and the products."""
    if X.dim > _DENSE:
        return
    dense = [_dense(A) for A in matrices]
    found = []
    for modes in _words(len(matrices)):
        if not affords(20 * X.dim**3):
            break
        spend(20 * X.dim**3)
        P = np.eye(X.dim)
        for s in modes:
            P = dense[s] @ P
        radius = np.abs(np.linalg.eigvals(P)).max() if np.isfinite(P).all() else 0.0
        found.append((float(radius) ** (1 / len(modes)), modes, P))
    largest = max((rate for rate, *_ in found), default=0.0)
    for rate, modes, P in found:
        if rate >= largest * (1 - _EQUAL) and rate > 0:
            yield modes, P
            return


def _dense(A: Matrix) -> Floats:
    return A.values.toarray() if A.is_sparse else np.asarray(A.values)


def _words(count: int) -> Iterator[tuple[int, ...]]:
    """Orders of modes, short ones first, each once among its rotations."""
    length, left = 1, _WORDS
    while count**length <= left and length <= 12:
        for word in words(range(count), repeat=length):
            if word == min(word[k:] + word[:k] for k in range(length)):
                yield word
        left, length = left - count**length, length + 1


def directions(X: Cone, P: Floats) -> Iterator[Matrix]:
    """x in X that P does not shrink, up to rounding: its dominant vector, and after some steps from inside X."""
    facets = np.asarray(X.facets, dtype=float)
    values, vectors = np.linalg.eig(P)
    x = np.real(vectors[:, np.argmax(np.abs(values))])
    x = x if (facets @ x).sum() >= 0 else -x
    y = np.asarray(X.interior_point, dtype=float)
    for _ in range(100):
        y = P @ y + np.abs(P).max() * 1e-3 * y
        y = y / max(np.abs(y).max(), 1e-300)
    for z in (x, y):
        z = z / max(np.abs(z).max(), 1e-300)
        z = np.where(np.abs(z) < 1e-13, 0.0, z)
        if np.isfinite(z).all():
            yield Matrix(z)


def factor_of(X: Cone, matrices: Sequence[Matrix], modes: Sequence[int], x: Matrix) -> Fraction | None:
    """The largest factor with P x - factor x in X, exactly; None if x is not in X, or it is not positive."""
    start = out = x.fractions()
    for s in modes:
        out = product(matrices[s], out)
    facets = X.exact_facets.plain().fractions()
    before, after = facets @ start, facets @ out
    if min(before) < 0 or min(after) < 0 or not any(before):
        return None
    factor = min(a / b for a, b in zip(after, before, strict=True) if b > 0)
    return factor if factor > 0 else None


def growing(X: Cone, matrices: Sequence[Matrix], modes: Sequence[int]) -> Matrix | None:
    """x in X with P x - x in X for the exact product, or None."""
    out = np.eye(X.dim, dtype=int).astype(object)
    for s in modes:
        out = matrices[s].dense().fractions() @ out
    return _not_shrunk(Matrix.from_fractions(out), X, discrete=True)


def _not_shrunk(M: Matrix, X: Cone, *, discrete: bool) -> Matrix | None:
    """x in X with M x in X (M x - x), decided exactly; None where M is stable."""
    witness = lyapunov_on(state_positivity(M, X, discrete=discrete)).refuted_by
    return exactly(witness, "x") if isinstance(witness, InstabilityDirection) else None


# -- mixtures


def mixtures(X: Cone, matrices: Sequence[Matrix], *, discrete: bool) -> Iterator[tuple[tuple[Fraction, ...], Matrix]]:
    """Weights lam of sum 1 and x in X with sum lam_s A_s x in X (minus x), members alone first."""
    count = len(matrices)
    for s, A in enumerate(matrices):
        x = _not_shrunk(A, X, discrete=discrete)
        if x is not None:
            yield tuple(Fraction(int(s == t)) for t in range(count)), x
    if X.dim > _DENSE or count == 1:
        return
    for lam, mixed in combined(matrices, steepest(matrices, 1)):
        x = _not_shrunk(mixed, X, discrete=discrete)
        if x is not None:
            yield lam, x


def combined(matrices: Sequence[Matrix], weights: list[float]) -> Iterator[tuple[tuple[Fraction, ...], Matrix]]:
    """Weights of sum 1 near the given ones, simple ones first, and sum lam_s A_s."""
    exact = [A.dense().fractions() for A in matrices]
    for most in _DENOMINATORS:
        lam = [Fraction(a).limit_denominator(most) for a in weights]
        if not any(lam):
            continue
        lam = [a / sum(lam) for a in lam]
        mixed = sum((a * A for a, A in zip(lam, exact, strict=True) if a), start=0 * exact[0])
        yield tuple(lam), Matrix.from_fractions(np.asarray(mixed))


def steepest(matrices: Sequence[Matrix], sign: int) -> list[float]:
    """Weights with a large growth rate of the mixture, or with a small one for the sign -1.

    From the mean of all towards one member after the other, by points on the way.
    """
    stack, count = np.array([_dense(A) for A in matrices]), len(matrices)
    best = np.full(count, 1 / count)
    rate, steps = sign * _rate(stack, best), np.linspace(0, 1, _POINTS)
    for _ in range(_ROUNDS):
        before = rate
        for s in range(count):
            ends = [best, np.eye(count)[s]]
            tried = [(1 - t) * ends[0] + t * ends[1] for t in steps] + [
                (1 + t) * ends[0] - t * ends[1] for t in steps * best[s] / max(1 - best[s], 1e-9)
            ]
            tried = [np.maximum(w, 0) / np.maximum(w, 0).sum() for w in tried]
            rates = [sign * _rate(stack, w) for w in tried]
            if max(rates) > rate:
                rate, best = max(rates), tried[int(np.argmax(rates))]
        if not rate > before + 1e-12 * abs(before):
            break
    return best.tolist()


def _rate(stack: Floats, weights: Floats) -> float:
    spend(30 * stack.shape[1] ** 3)
    return float(np.real(np.linalg.eigvals(np.einsum("s,sij->ij", weights, stack))).max())
