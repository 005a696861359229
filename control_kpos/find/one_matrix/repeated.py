"""Cones for matrices whose dominant eigenvalue is repeated, rational or not, in rational arithmetic.

Invariance then holds with equalities that no rounding survives: the double integrator [[0, 1], [0, 0]] has cones, and
matrices arbitrarily near it have none.

A = S + N with S semisimple, N nilpotent, both rational polynomials in A (Jordan and Chevalley), although no eigenvalue
may be rational.  Let p be the product of (s - z) over all eigenvalues z as often repeated as the dominant one.  On
G = ker p(S), chains v, N v, .., N^(k-1) v and their images under S span blocks

    span {w, S w, .., S^(d-1) w},   w = N^j v,   d = deg p,

on each of which S acts as the companion matrix of p, whose dominant eigenvalue is simple, and N moves one block
to the next without changing coordinates.  One cone of the companion matrix, put into every block, is
invariant under S + N; the last block takes the other eigenvalues along.  In discrete time p may hold several
eigenvalues of the circle, such as 1 and -1; so it does where their chains are as long as those of the dominant one.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ...exact.linalg import Rationals, columns, jordan_chains, nullspace, product, solve_columns
from ...exact.matrix import Matrix
from ...exact.polynomials import (
    Polynomial,
    at_matrix,
    derivative,
    divided,
    multiply,
    rational_roots,
    square_free_factors,
)
from ...proof.proposed_weights import pointing_functional
from ..impossible.existence import spectrum_polynomial
from ..proven import first_cone
from ..question import Candidate, Question
from .modes import analysis
from .search import candidates

_LARGEST = 24
_MIXTURES = 4
# Roots that coincide are known to about half the digits, or a third of them.
_NEAR = 1e-3


def repeated_cones(question: Question) -> Iterator[Candidate]:
    """Exact generators, for one matrix."""
    A = question.searched[0]
    if A.shape[0] > _LARGEST:
        return
    factors = square_free_factors(spectrum_polynomial(A))
    values = np.linalg.eigvals(A.values)
    top = float((np.abs(values) if question.discrete else values.real).max())
    scale = float(np.abs(A.values).max()) or 1.0
    near = [k for k, f in enumerate(factors) if np.abs(_roots(f) - top).min(initial=np.inf) < _NEAR * scale]
    if len(near) != 1 or near[0] == 0:
        return
    M = A.fractions()
    S = _semisimple(M, factors)
    if S is None:
        return
    whole = factors[near[0]]
    linear = {root: [root.denominator, -root.numerator] for root in rational_roots(whole, values)}
    # a factor is enough where others have shorter chains; with the same length on the circle all move together
    tried = [p for root, p in linear.items() if abs(root - top) < _NEAR * scale]
    circle = divided(whole, _product([p for root, p in linear.items() if abs(root) < top - _NEAR * scale])) or whole
    for p in [*tried, *(p for p in (circle, whole) if tried[:1] != [p] and len(p) > 1)]:
        rays = _in_blocks(M, S, p, question.discrete)
        if rays is not None and question.admits(rays.shape[0]):
            values = np.asarray(rays.values)
            yield Candidate(rays=rays, pointing=pointing_functional(values), right_inverse=np.linalg.pinv(values.T))


def _in_blocks(M: Rationals, S: Rationals, p: Polynomial, discrete: bool) -> Matrix | None:
    """The cone in the blocks of the chains on ker p(S)."""
    d, at = len(p) - 1, at_matrix(p, S)
    G = nullspace(at)
    for seed in range(_MIXTURES):  # a vector of the basis may lie in a smaller block
        mixed = G @ np.random.default_rng(seed).integers(-2, 3, (G.shape[1], G.shape[1])).astype(object)
        chains = jordan_chains(M - S, mixed, lambda w: _cyclic(S, w, d))
        if chains is not None:
            return _generators(M, S, chains, columns(at), d, discrete)
    return None


def _roots(p: Polynomial) -> NDArray[np.complex128]:
    size = max(map(abs, p))
    return np.roots([float(Fraction(c, size)) for c in p]).astype(np.complex128)


def _product(factors: list[Polynomial]) -> Polynomial:
    return reduce(multiply, factors, [1])


def _semisimple(M: Rationals, factors: list[Polynomial]) -> Rationals | None:
    """The semisimple part, by Newton's method on the product of the factors."""
    p = _product(factors)
    slope = derivative(p)
    lead = p[0] * (len(p) - 1)
    S = M
    for _ in range(len(M).bit_length() + 1):
        value = at_matrix(p, S)
        if not value.any():
            break
        # `derivative` is known up to a positive factor only
        step = solve_columns(at_matrix(slope, S) * (lead // slope[0]), value)
        if step is None:
            return None
        S = S - step
    return S


def _cyclic(S: Rationals, w: Rationals, d: int) -> list[Rationals]:
    """w, S w, .., S^(d-1) w."""
    out = [w]
    for _ in range(d - 1):
        out.append(S @ out[-1])
    return out


def _generators(
    M: Rationals, S: Rationals, chains: list[list[Rationals]], W: Rationals, d: int, discrete: bool
) -> Matrix | None:
    """The cone of the companion matrix in every block, and the cone of the last block with the rest."""
    last = np.array(_cyclic(S, chains[0][-1], d), dtype=object).T
    companion = solve_columns(last, product(S, last))
    inner = None if companion is None else _cone_of(Matrix.from_fractions(companion), discrete)
    if inner is None:
        return None
    blocks = [w for k, chain in enumerate(chains) for w in (chain[:-1] if k == 0 else chain)]
    rows = [inner @ np.array(_cyclic(S, w, d), dtype=object) for w in blocks]
    if not W.shape[1]:
        return Matrix.from_fractions(np.concatenate([*rows, inner @ last.T]))
    basis = np.concatenate([last, W], axis=1)
    whole = solve_columns(basis, product(M, basis))
    if whole is None:
        return None
    outer = _cone_of(Matrix.from_fractions(whole), discrete)
    if outer is None:
        return None
    if d == 1 and outer[0, 0] * inner[0, 0] < 0:  # every cone holds the dominant direction or its opposite
        outer = -outer
    if len(chains[0]) > 1 and d > 1:  # N moves the cone of the block before into the last one, where it is invariant
        held = np.concatenate([inner, np.zeros((len(inner), W.shape[1]), dtype=int).astype(object)], axis=1)
        sums = [np.concatenate([side, held]) for side in (outer, -outer)]
        outer = next((rays for rays in sums if _is_pointed(rays.astype(float))), None)
        if outer is None:
            return None
    return Matrix.from_fractions(np.concatenate([*rows, outer @ basis.T]))


def _is_pointed(rays: NDArray[np.float64]) -> bool:
    return bool((rays @ pointing_functional(rays) > 0).all())


def _cone_of(A: Matrix, discrete: bool) -> Rationals | None:
    """Generators of an invariant cone, or None."""
    question = Question(matrices=Matrix.stack([A]), discrete=discrete)
    found = first_cone(question, candidates(question, analysis(A, discrete=discrete)))
    return None if found is None else found.candidate.rays.fractions()
