"""How many states a positive realization needs at least, proven in exact arithmetic.

Order      That of a minimal realization, n.
Sectors    A matrix of order p with P_ij >= 0 (i != j) and the rightmost eigenvalue lam has no eigenvalue x + iy with
           |y| > (lam - x) cot(pi/p) (Dmitriev and Dynkin, 1945).  States that no input reaches, or no output sees,
           can be left out; then lam is a pole, the rightmost one.  With z = |y| + i (lam - x), p states are too few
           exactly if z, z^2, ..., z^p have positive imaginary parts.
Walks      Discrete time: an entry of C P^k N is not zero exactly if a walk of k steps leads from a state of the input
           to one of the output.  p states are too few if no graph of p states has such walks for those k at which the
           response is not zero, and none for the others.  For p = n, P is similar to A, and the trace of A^k is
           positive exactly if some walk of k steps ends where it began, else zero.  All graphs of up to 4 states are
           compared.
"""

from __future__ import annotations

from fractions import Fraction
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ...exact.linalg import product
from ...exact.matrix import Matrix
from ...exact.polynomials import square_free_part
from ...exact.roots import root_discs
from ..impossible.existence import spectrum_polynomial
from .minimal import Realization

Booleans = NDArray[np.bool_]

# Graphs of more states are too many; steps that walks are compared for; binary digits of eigenvalues; nothing is
# said where they ask for so many states.
_STATES, _STEPS, _DIGITS, _MOST = 4, 20, 256, 1000


def lower_bound(s: Realization, *, discrete: bool) -> int:
    """So many states or more, for every positive realization of a minimal system."""
    n = len(s.A)
    bound = max(n, _by_sectors(s))
    while discrete and bound <= _STATES and _lacks_walks(s, bound):
        bound += 1
    return bound


def _by_sectors(s: Realization) -> int:
    """The largest order that some eigenvalue asks for."""
    p = square_free_part(spectrum_polynomial(Matrix.from_fractions(s.A)))
    discs = next(root_discs(p, _DIGITS), ()) if len(p) > 2 else ()
    first = max(discs, key=lambda disc: disc.range()[1], default=None)
    if first is None or not first.is_real:  # then there is no positive realization
        return 1
    top = first.range()[1]
    needed = 1
    for disc in discs:
        height = (abs(disc.y) - disc.radius) * Fraction(2) ** -disc.places
        if height > 0:
            needed = max(needed, _needed((top - disc.range()[0]) / height))
    return needed


def _needed(slope: Fraction) -> int:
    """The first p for which z^p has no positive imaginary part, z being 1 + i slope: all up to then are too few."""
    height, gap = 2**_DIGITS, ceil(slope * 2**_DIGITS)  # a little steeper
    x, y, p = height, gap, 1
    while y > 0 and p < _MOST:
        x, y, p = x * height - y * gap, x * gap + y * height, p + 1
    return p if y <= 0 else 1


def _lacks_walks(s: Realization, p: int) -> bool:
    """Whether no graph of p states has the walks of the response."""
    powers, closed = [s.B], []
    A = s.A
    for _ in range(_STEPS - 1):
        powers.append(product(s.A, powers[-1]))
        trace = sum(A[i, i] for i in range(len(A)))
        if p == len(A) and trace < 0:
            return True
        closed.append(trace > 0)
        A = product(A, s.A)
    responses = np.array([product(s.C, x) > 0 for x in powers], dtype=bool)
    patterns = {tuple(h) for h in responses.reshape(_STEPS, -1).T.tolist()}
    walks = _walks(p)
    if p == len(s.A):
        fits = np.all(_closed(walks) == np.array(closed)[:, None], axis=0)
        walks = walks[..., fits]
    # for a response that is always zero the input, or the output, may have no states at all
    return any(any(pattern) and not _has_walks(walks, np.array(pattern)) for pattern in patterns)


def _walks(p: int) -> NDArray[np.uint8]:
    """For each state, number of steps and graph: the states where walks end, as bits; shape (p, steps, graphs)."""
    graphs = np.arange(2 ** (p * p))
    to = [((graphs >> (p * i)) & (2**p - 1)).astype(np.uint8) for i in range(p)]
    out = np.zeros((p, _STEPS, len(graphs)), dtype=np.uint8)
    for start in range(p):
        out[start, 0] = 1 << start
        for k in range(1, _STEPS):
            for i in range(p):
                out[start, k] |= np.where(out[start, k - 1] >> i & 1, to[i], 0).astype(np.uint8)
    return out


def _closed(walks: NDArray[np.uint8]) -> Booleans:
    """Whether some walk of 1, 2, ... steps ends where it starts, in each graph."""
    return np.any([walks[i, 1:] >> i & 1 for i in range(len(walks))], axis=0)


def _has_walks(walks: NDArray[np.uint8], pattern: Booleans) -> bool:
    """Whether walks of 0, 1, ... steps lead from some states to some states as in the pattern, in some graph."""
    p = len(walks)
    for count in range(1, p + 1):  # states may be renamed, so that the first ones are those of the input
        ends = np.bitwise_or.reduce(walks[:count], axis=0)
        for seen in range(1, 2**p):
            if np.all(((ends & seen) > 0) == pattern[:, None], axis=0).any():
                return True
    return False
