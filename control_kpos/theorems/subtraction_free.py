"""Solutions for compartments with nearly all digits, however small the outflows: elimination without subtraction.

Let N >= 0 off the diagonal, w >= 0, and M = diag(N 1 + w) - N, so that M 1 = w.  Elimination of M x = b >= 0 on N and
w in the place of the diagonal adds, multiplies and divides nonnegative numbers only (Alfa, Xue and Ye, Mathematics of
Computation 71 (2002)):

    p_i = w_i + sum_{j left} N_ij,   N_kj += N_ki N_ij / p_i,   w_k += N_ki w_i / p_i,   b_k += N_ki b_i / p_i,
    x_i = (b_i + sum_{j left} N_ij x_j) / p_i    (backwards).

Of a sparse N many i are eliminated at a time, no two with a flow between them and those with few flows first, until a
few hundred or a filled matrix are left, which are eliminated one by one.

*The error.*  Let u = 2^-53 and E = 1 / (1 - u): a rounding changes a nonnegative number by a factor between 1/E and E.
Say k are left behind a step, d is the largest number of flows from an eliminated i, and c that of flows from one that
is left to those eliminated.  Then p_i takes d roundings, and each of N_kj, w_k, b_k at most d + 2 + c.  (One by one, in
panels: k + 3 in every step, and at the end of a panel of h steps h more, one for each of them, at most: k + 4.)
An entry of the solution of k equations is a quotient of two polynomials in the entries of N and w with
positive coefficients, homogeneous of the degrees k - 1 and k, times b (the matrix-tree theorem; Kirchhoff).  So factors
within E^(d+2+c) of all entries move the solution by a factor within E^(2k(d+2+c)); going back adds 2d + 2 roundings.
The sum over all steps is counted, and 2n more where the rates themselves were rounded.  For a full matrix

    sum_{k=0}^{n-1} (2 k (k + 4) + 2 k + 2) + 2 n = n (n - 1)(2n - 1) / 3 + 5 n (n - 1) + 4 n:

the relative error is below (2/3 n^3 + 5 n^2) u, up to 1 %.  That nothing overflows or underflows is watched.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import TooLargeError, UndecidedError
from ..exact.rounding import HALF_ULP, SMALLEST_NORMAL

Floats = NDArray[np.float64]
Index = NDArray[np.intp]
# Compartments whose elimination as a dense matrix takes seconds.
LARGEST = 2000
# Compartments that are eliminated one by one, as a dense matrix, even if it has many zeros; its share of nonzeros else.
_FEW, _FILLED = 100, 0.1
# Compartments whose effect on the others is added up in one product.
_PANEL = 64
# The share of rows that count as having few entries.
_FEWEST = 0.05
# Flows, and products of two, in all rounds together: ten seconds.
_WORK = 60_000_000
# Products at once in a solution.
_AT_ONCE = 10_000_000


class Round(NamedTuple):
    """Compartments eliminated together: where they are, where those left are, and the flows between both."""

    gone: Index
    left: Index
    into: sp.csr_array  # N_ki / p_i, from those left
    out: sp.csr_array  # N_ij, to those left
    p: Floats


class Elimination:
    """Factors of M = diag(N 1 + w) - N, for `solve`.

    Parameters
    ----------
    N : ndarray or sparse array, shape (n, n)
        Nonnegative; its diagonal is not read.
    w : ndarray, shape (n,)
        Nonnegative; every row reaches one that is positive through positive entries of N.

    Attributes
    ----------
    roundings : int
        How many roundings an entry of a solution takes at most, weighted by their effect.

    Raises
    ------
    TooLargeError
        More than 2000 are left when the matrix has filled up.
    UndecidedError
        A number left the range of doubles.

    Examples
    --------
    >>> Elimination(np.array([[0, 1], [1, 0]]), np.array([0, 1e-200])).solve(np.ones((2, 1)))[:, 0]
    array([2.e+200, 2.e+200])
    """

    def __init__(self, N: Any, w: Floats):
        w = np.array(w, dtype=float)
        self.size = len(w)
        self.roundings = 2 * self.size
        self.rounds: list[Round] = []
        with within_range():
            if sp.issparse(N):
                N, w = self._apart(_without_diagonal(sp.csr_array(N)), w)
                N = N.toarray()
            self._one_by_one(np.array(N, dtype=float), w)

    def _apart(self, N: sp.csr_array, w: Floats) -> tuple[sp.csr_array, Floats]:
        """Rounds of elimination, until little is left, or what is left has filled up."""
        order, work = np.random.default_rng(0).permutation(len(w)), 0
        while len(w) > _FEW and N.nnz < _FILLED * len(w) ** 2:
            chosen = _no_flows_between(N, order)
            gone, left = np.flatnonzero(chosen), np.flatnonzero(~chosen)
            into, out = N[left][:, gone], N[gone][:, left]
            work += N.nnz + np.diff(out.indptr)[into.indices].sum(dtype=np.int64)
            if work > _WORK:
                break
            p = w[gone] + _finite(out.sum(axis=1))
            into.data = into.data / p[into.indices]
            fed = _products(into, out)
            w = w[left] + _times(into, w[gone, None])[:, 0]
            N = _without_diagonal(sp.csr_array(N[left][:, left] + fed))
            order = order[left]
            self.rounds.append(Round(gone, left, into, out, p))
            d, c = int(np.diff(out.indptr).max(initial=0)), int(np.diff(into.indptr).max(initial=0))
            self.roundings += 2 * len(left) * (d + 2 + c) + 2 * d + 2
        if len(w) > LARGEST:
            raise TooLargeError(
                f"{len(w)} of {self.size} compartments are left, with {N.nnz} flows among them, and are eliminated as "
                f"a dense matrix; the limit is {LARGEST}. Stability alone needs no elimination."
            )
        return N, w

    def _one_by_one(self, N: Floats, w: Floats) -> None:
        n, p = len(w), np.empty(len(w))
        if n > LARGEST:
            raise TooLargeError(
                f"{n} compartments are eliminated as a dense matrix; the limit is {LARGEST}. If most flows are 0, give "
                "a sparse matrix; stability alone needs no elimination."
            )
        np.fill_diagonal(N, 0.0)
        for first in range(0, n, _PANEL):
            # The panel's rows and columns at every step, the rest after it.
            last = min(first + _PANEL, n)
            for i in range(first, last):
                ahead, panel = slice(i + 1, None), slice(i + 1, last)
                p[i] = w[i] + N[i, ahead].sum()
                N[ahead, i] /= p[i]
                w[ahead] += N[ahead, i] * w[i]
                N[panel, ahead] += N[panel, i, None] * N[i, ahead]
                N[last:, panel] += N[last:, i, None] * N[i, panel]
            N[last:, last:] += product(N[last:, first:last], N[first:last, last:])
        self.p, self.filled = p, N
        self.roundings += n * (n - 1) * (2 * n - 1) // 3 + 5 * n * (n - 1) + 2 * n

    def solve(self, b: Floats) -> Floats:
        """x with M x = b, every entry within `relative_error(roundings)` of its size.

        Parameters
        ----------
        b : ndarray, shape (n, r)
            Nonnegative.

        Raises
        ------
        UndecidedError
            A number left the range of doubles.
        """
        b = np.array(b, dtype=float)
        parts = []
        with within_range():
            for step in self.rounds:
                parts.append(b[step.gone])
                b = b[step.left] + _times(step.into, parts[-1])
            x = self._solve_filled(b)
            for step, own in zip(reversed(self.rounds), reversed(parts), strict=True):
                behind, x = x, np.empty((len(step.gone) + len(step.left), b.shape[1]))
                x[step.left] = behind
                x[step.gone] = (own + _times(step.out, behind)) / step.p[:, None]
        return x

    def _solve_filled(self, b: Floats) -> Floats:
        n, N = len(b), self.filled
        panels = [(first, min(first + _PANEL, n)) for first in range(0, n, _PANEL)]
        for first, last in panels:
            for i in range(first, last):
                b[i + 1 : last] += N[i + 1 : last, i, None] * b[i]
            b[last:] += product(N[last:, first:last], b[first:last])
        for first, last in reversed(panels):
            b[first:last] += product(N[first:last, last:], b[last:])
            for i in range(last - 1, first - 1, -1):
                b[i] = (b[i] + (N[i, i + 1 : last, None] * b[i + 1 : last]).sum(axis=0)) / self.p[i]
        return b


def relative_error(roundings: int) -> float:
    """A bound of the relative error of a nonnegative number after that many roundings, up to 1 %; inf beyond.

    Parameters
    ----------
    roundings : int
    """
    error = 1.01 * roundings * HALF_ULP
    return error if error <= 0.01 else np.inf


@contextmanager
def within_range() -> Iterator[None]:
    """Raise `UndecidedError` where a number leaves the range of doubles."""
    try:
        with np.errstate(all="raise"):
            yield
    except FloatingPointError:
        raise UndecidedError(
            "the rates differ by so much that a product of them leaves the range of doubles; scale the time, or leave "
            "out what is negligible."
        ) from None


def _no_flows_between(N: sp.csr_array, order: Index) -> NDArray[np.bool_]:
    """Rows without entries between them: those with the fewest entries among their neighbours, and few of all."""
    both = sp.csr_array(N + N.T)
    degrees = np.diff(both.indptr)
    key = degrees * np.int64(order.max() + 1) + order
    some = np.flatnonzero(degrees)
    chosen = np.ones(len(degrees), dtype=bool)
    chosen[some] = key[some] < np.minimum.reduceat(key[both.indices], both.indptr[some])
    return chosen & (degrees <= 1 + np.quantile(degrees, _FEWEST))


def product(left: Floats, right: Floats) -> Floats:
    """left @ right of dense nonnegative matrices: by BLAS, which notices no number out of range, where none can be.

    Parameters
    ----------
    left, right : ndarray, shapes (q, n) and (n, m)
    """
    least = [part.min(where=part > 0, initial=1.0) for part in (left, right)]
    if least[0] >= SMALLEST_NORMAL / least[1]:
        with np.errstate(all="ignore"):
            return _finite(left @ right)
    out = np.zeros((left.shape[0], right.shape[1]))
    for k in range(left.shape[1]):
        out += left[:, k, None] * right[k]
    return out


def _products(left: sp.csr_array, right: sp.csr_array) -> sp.csr_array:
    """left @ right of nonnegative arrays; numpy multiplies, which notices numbers out of range."""
    left = sp.coo_array(left)
    count = np.diff(right.indptr)[left.col]
    first = np.repeat(right.indptr[left.col] - np.append(0, np.cumsum(count)[:-1]), count) + np.arange(count.sum())
    values = np.repeat(left.data, count) * right.data[first]
    at = np.repeat(left.row, count), right.indices[first]
    out = sp.csr_array(sp.coo_array((values, at), shape=(left.shape[0], right.shape[1])))
    _finite(out.data)
    return out


def _times(left: sp.csr_array, right: Floats) -> Floats:
    """left @ right, right dense, some columns at a time."""
    some = max(1, _AT_ONCE // max(1, left.nnz))
    parts = (sp.csr_array(right[:, j : j + some]) for j in range(0, right.shape[1], some))
    return np.hstack([np.zeros((left.shape[0], 0)), *(_products(left, part).toarray() for part in parts)])


def _finite(sums: Floats) -> Floats:
    """The sums, which scipy made, and which does not notice numbers out of range."""
    if not np.isfinite(sums).all():
        raise FloatingPointError
    return sums


def _without_diagonal(N: sp.csr_array) -> sp.csr_array:
    """The entries that are not 0 and not on the diagonal."""
    entries = sp.coo_array(N)
    kept = (entries.row != entries.col) & (entries.data != 0)
    at = entries.row[kept], entries.col[kept]
    return sp.csr_array((_finite(entries.data[kept]), at), shape=N.shape)
