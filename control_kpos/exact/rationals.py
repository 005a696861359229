"""Linear algebra over the rationals, on small matrices of fractions."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from .budget import require_seconds

Rationals = NDArray[np.object_]


def identity(n: int) -> Rationals:
    """The n x n identity."""
    return np.array([[Fraction(int(i == j)) for j in range(n)] for i in range(n)], dtype=object)


def power(M: Rationals, k: int) -> Rationals:
    """M^k."""
    out = identity(len(M))
    for _ in range(k):
        require_seconds()
        out = out @ M
    return out


def _reduced(M: Rationals) -> tuple[Rationals, list[int]]:
    """Reduced row echelon form and its pivot columns."""
    M = np.array([[Fraction(x) for x in row] for row in M], dtype=object).reshape(M.shape)
    pivots: list[int] = []
    for j in range(M.shape[1]):
        require_seconds()
        row = len(pivots)
        found = next((i for i in range(row, M.shape[0]) if M[i, j] != 0), None)
        if found is None:
            continue
        M[[row, found]] = M[[found, row]]
        M[row] = M[row] / M[row, j]
        for i in range(M.shape[0]):
            if i != row and M[i, j] != 0:
                M[i] = M[i] - M[row] * M[i, j]
        pivots.append(j)
    return M, pivots


def nullspace(M: Rationals) -> Rationals:
    """Basis of {x : M x = 0} as columns."""
    R, pivots = _reduced(M)
    free = [j for j in range(M.shape[1]) if j not in pivots]
    out = np.array([[Fraction(0)] * len(free) for _ in range(M.shape[1])], dtype=object).reshape(M.shape[1], len(free))
    for k, j in enumerate(free):
        out[j, k] = Fraction(1)
        for i, pivot in enumerate(pivots):
            out[pivot, k] = -R[i, j]
    return out


def columns(M: Rationals) -> Rationals:
    """Basis of the range of M as columns."""
    return M[:, _reduced(M)[1]]


def rank(M: Rationals) -> int:
    """Number of independent rows."""
    return len(_reduced(M)[1])


def solve_columns(W: Rationals, Y: Rationals) -> Rationals:
    """Z with W Z = Y, for independent columns W that span Y."""
    R, _ = _reduced(np.concatenate([W, Y], axis=1))
    return R[: W.shape[1], W.shape[1] :]


def jordan_chains(
    N: Rationals, G: Rationals, block: Callable[[Rationals], list[Rationals]]
) -> list[list[Rationals]] | None:
    """Chains v, N v, .. until 0 whose blocks together are a basis of the span of G; long chains first.

    Parameters
    ----------
    N : ndarray of Fraction, shape (n, n)
        Nilpotent on the span of G, which it keeps.
    G : ndarray of Fraction, shape (n, k)
    block : callable
        Vectors that come with a vector, itself first; N moves the block of w to that of N w.
    """
    powers = [G]
    while powers[-1].any():
        powers.append(N @ powers[-1])
    chains: list[list[Rationals]] = []
    ends: list[Rationals] = []
    for length in range(len(powers) - 1, 0, -1):
        starts = G @ nullspace(powers[length])
        for v in starts.T:
            chain = [v]
            while (N @ chain[-1]).any():
                chain.append(N @ chain[-1])
            new = [*ends, *block(chain[-1])]
            if len(chain) == length and rank(np.array(new, dtype=object)) == len(new):
                chains.append(chain)
                ends = new
    rows = [x for chain in chains for w in chain for x in block(w)]
    return chains if len(rows) == G.shape[1] and rank(np.array(rows, dtype=object)) == len(rows) else None
