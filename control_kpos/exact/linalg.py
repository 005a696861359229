"""Exact linear algebra on integers and fractions: FLINT solves, our own integers check.

Every answer of FLINT is multiplied back before it counts:

    solve_exactly:  A X = d B and d > 0, in Python's integers;
    null_space:     M x = 0 for every vector x; they are independent, for each alone has an entry in one column;
    rank r:         an r x r minor is not zero modulo a prime, by elimination here, and n - r independent vectors of
                    the kernel are known.

So an error in FLINT cannot make a wrong answer, only an exception.  Normals of thousands of small sets of vectors are
found by Bareiss' fraction-free elimination of all of them at once, which numpy does faster than a library could one
by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import isqrt, lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .budget import spend
from .matrix import Index, Integers, divide_by_content

Rationals = NDArray[np.object_]

# A prime; products of residues fit into int64.
LARGEST_PRIME = 2**31 - 1
# (a b - c d) stays below 2**63 if all entries do not exceed this.
_INT64_FACTOR = 2**31 - 1
# Operations for each product of long integers, of residues, and in lifting a column of doubles.
_PRODUCT, _RESIDUE, _LIFTING = 150.0, 10.0, 50.0


class WrongAnswerError(ArithmeticError):
    """An answer of FLINT that our own integers do not confirm; it is not used."""

    def __init__(self, what: str) -> None:
        super().__init__(f"FLINT returned a wrong {what}; please report this.")


# -- systems of equations


def solve_exactly(matrix: Integers, right: Integers) -> tuple[Integers, int] | None:
    """Solution of a square system with integer entries, or None if it is singular.

    Parameters
    ----------
    matrix : ndarray of int (object), shape (m, m)
    right : ndarray of int (object), shape (m, k)

    Returns
    -------
    numerators : ndarray of int (object), shape (m, k)
    denominator : int
        Positive: matrix @ numerators = denominator * right.

    Notes
    -----
    Dixon's p-adic lifting: 0.02 s for 60 equations of doubles, 0.3 s for 120, 4 s for 300, and as much again for
    each further column.  The check costs m^2 k products.

    Examples
    --------
    >>> numerators, denominator = solve_exactly(np.array([[2, 1], [1, 3]]), np.array([[1], [1]]))
    >>> numerators.ravel().tolist(), denominator
    ([2, 1], 5)
    """
    matrix, right = np.asarray(matrix, dtype=object), np.asarray(right, dtype=object)
    if not matrix.size:
        return np.zeros(right.shape, dtype=object), 1
    try:
        solution, common = _flint(matrix).solve(_flint(right)).numer_denom()
    except ZeroDivisionError:
        if echelon(matrix).rank == len(matrix):
            raise WrongAnswerError("rank") from None
        return None
    numerators, denominator = _integers(solution), int(common)
    if not (denominator > 0 and (matrix @ numerators == denominator * right).all()):
        raise WrongAnswerError("solution")
    return numerators, denominator


def lifting_operations(matrix: Integers, columns: int) -> float:
    """Operations of `solve_exactly` for so many right-hand sides and the rows of a matrix, one equation each."""
    digits = max((int(x).bit_length() for x in matrix.ravel()), default=1)
    return _LIFTING * len(matrix) ** 3 * (1 + columns) * (1 + digits / 53) + 1e5


def inverse_rows(matrix: Integers, index: Index | None = None) -> Integers | None:
    """Rows h_k with h_k'x_i = 0 for i != k and h_k'x_k > 0, for the rows x_i of a square integer matrix.

    Parameters
    ----------
    matrix : ndarray of int (object), shape (n, n)
    index : ndarray of int, shape (m,), optional
        Which k; default all.

    Returns
    -------
    ndarray of int (object), shape (m, n), or None
        Without common factors; None if the matrix is singular.  These are rows of the transposed inverse, up to
        positive factors.

    Examples
    --------
    >>> inverse_rows(np.array([[0, 1], [1, -2]])).tolist()
    [[2, 1], [1, 0]]
    """
    n = len(matrix)
    wanted = np.arange(n) if index is None else np.asarray(index)
    unit = np.zeros((n, len(wanted)), dtype=int).astype(object)
    unit[wanted, np.arange(len(wanted))] = 1
    found = solve_exactly(matrix, unit)
    return None if found is None else divide_by_content(found[0].T)


# -- rank and kernel


@dataclass(frozen=True, eq=False)
class Echelon:
    """Which rows and columns of an integer matrix are independent, and its kernel.

    Attributes
    ----------
    rows, columns : ndarray of int, shape (rank,)
        Independent rows and columns, the earliest ones.
    null_space : ndarray of int (object), shape (n - rank, n)
        Basis of {x : M x = 0}, one vector a row, without common factors.  Each alone has an entry in one of the
        columns that are not in `columns`; the entry is positive.
    """

    rows: Index
    columns: Index
    null_space: Integers

    @property
    def rank(self) -> int:
        return len(self.rows)


def echelon(matrix: Integers) -> Echelon:
    """Rank, independent rows and columns, and kernel of an integer matrix, shape (p, n).

    Costs p n r products of small numbers for rank r, and unless r = n the solution of r equations.

    Examples
    --------
    >>> form = echelon(np.array([[1, 2, 3], [2, 4, 6], [0, 1, 1]]))
    >>> form.rank, form.rows.tolist(), form.null_space.tolist()
    (2, [0, 2], [[-1, -1, 1]])
    """
    matrix = np.asarray(matrix, dtype=object)
    prime = LARGEST_PRIME
    while True:
        rows, columns = independent_modulo(matrix, prime)
        null_space = _kernel(matrix, rows, columns)
        if null_space is not None:
            return Echelon(rows, columns, null_space)
        prime = prime_below(prime)  # it divides a minor that is not zero; only finitely many primes do


@cache
def prime_below(number: int) -> int:
    """The largest prime below a number up to 2^31.

    >>> prime_below(LARGEST_PRIME)
    2147483629
    """
    candidate = number - 1
    while not all(candidate % k for k in range(2, isqrt(candidate) + 1)):
        candidate -= 1
    return candidate


def independent_modulo(matrix: Integers, prime: int) -> tuple[Index, Index]:
    """The first independent rows modulo a prime, and the columns of their leading entries.

    They form a minor that is not zero modulo the prime: what is independent modulo a prime is independent.
    """
    work = (matrix % prime).astype(np.int64)
    rows: list[int] = []
    columns: list[int] = []
    for row in range(len(work)):
        column = int(np.argmax(work[row] != 0))
        if not work[row, column]:
            continue
        rows.append(row)
        columns.append(column)
        if len(rows) == work.shape[1]:
            break
        below = row + 1 + np.flatnonzero(work[row + 1 :, column])
        spend(_RESIDUE * len(below) * work.shape[1])
        factor = work[below, column] * pow(int(work[row, column]), -1, prime) % prime
        work[below] = (work[below] - factor[:, None] * work[row]) % prime
    return np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)


def _kernel(matrix: Integers, rows: Index, columns: Index) -> Integers | None:
    """Basis of the kernel if no row depends on more than the given ones, else None."""
    n = matrix.shape[1]
    free = np.setdiff1d(np.arange(n), columns)
    basis = np.zeros((len(free), n), dtype=int).astype(object)
    if not len(free):
        return basis
    solved = solve_exactly(matrix[np.ix_(rows, columns)], matrix[np.ix_(rows, free)])
    if solved is None:  # the minor is not zero modulo a prime
        raise WrongAnswerError("rank")
    numerators, denominator = solved
    basis[np.arange(len(free)), free] = denominator
    basis[:, columns] = -numerators.T
    return None if (matrix @ basis.T).any() else divide_by_content(basis)


# -- fractions


def nullspace(M: Rationals) -> Rationals:
    """Basis of {x : M x = 0} as columns."""
    form = echelon(_by_row(M))
    free = np.setdiff1d(np.arange(M.shape[1]), form.columns)
    out = [[Fraction(t, x[j]) for t in x] for x, j in zip(form.null_space.tolist(), free, strict=True)]
    return np.array(out, dtype=object).reshape(len(free), M.shape[1]).T


def columns(M: Rationals) -> Rationals:
    """Basis of the range of M as columns."""
    return M[:, echelon(_by_row(M)).columns]


def rank(M: Rationals) -> int:
    """Number of independent rows."""
    return echelon(_by_row(M)).rank


def solve_columns(W: Rationals, Y: Rationals) -> Rationals | None:
    """Z with W Z = Y, for independent columns W; None unless they span Y."""
    whole = _by_row(np.concatenate([W, Y], axis=1))
    left, right = whole[:, : W.shape[1]], whole[:, W.shape[1] :]
    rows = echelon(left).rows
    solved = solve_exactly(left[rows], right[rows]) if len(rows) == left.shape[1] else None
    if solved is None or not (left @ solved[0] == solved[1] * right).all():
        return None
    return fractions(*solved)


def product(*factors: Rationals) -> Rationals:
    """Product of matrices of fractions, over common denominators."""
    numerators, denominator = common_denominator(factors[0])
    for factor in factors[1:]:
        more, other = common_denominator(factor)
        numerators, denominator = numerators @ more, denominator * other
    return fractions(numerators, denominator)


def power(M: Rationals, k: int) -> Rationals:
    """M^k, by repeated squares."""
    square, denominator = common_denominator(M)
    out = np.eye(len(M), dtype=int).astype(object)
    for digit in reversed(f"{k:b}"):
        spend(_PRODUCT * len(M) ** 3)
        if digit == "1":
            out = out @ square
        square = square @ square
    return fractions(out, denominator**k)


def identity(n: int) -> Rationals:
    """The n x n identity."""
    return fractions(np.eye(n, dtype=int).astype(object), 1)


def fractions(numerators: Integers, denominator: int) -> Rationals:
    """Integers over a common denominator, as fractions."""
    flat = [Fraction(x, denominator) for x in numerators.ravel().tolist()]
    return np.array(flat, dtype=object).reshape(numerators.shape)


def common_denominator(M: Rationals) -> tuple[Integers, int]:
    """Integers N and a number d > 0 with M = N / d."""
    flat = [Fraction(x) for x in M.ravel()]
    common = lcm(*(x.denominator for x in flat))
    out = [x.numerator * (common // x.denominator) for x in flat]
    return np.array(out, dtype=object).reshape(M.shape), common


def _by_row(M: Rationals) -> Integers:
    """Integers proportional to each row."""
    return np.array([common_denominator(row)[0] for row in M], dtype=object).reshape(M.shape)


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
        powers.append(product(N, powers[-1]))
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


# -- many small matrices at once


def normals(stack: Integers) -> Integers:
    """Vectors orthogonal to all rows of each matrix of a stack.

    Parameters
    ----------
    stack : ndarray of int (object), shape (k, n - 1, n)

    Returns
    -------
    ndarray of int (object), shape (k, n)
        The vector of maximal minors, without common factor and of either sign; zero where the n - 1
        rows are dependent.  Costs about k n^3 / 2 multiplications of integers.
    """
    count, rows, n = stack.shape
    work: NDArray[Any] = np.array(_as_small_integers(stack))
    order = np.tile(np.arange(n), (count, 1))
    each = np.arange(count)
    last: NDArray[Any] = np.ones(count, dtype=work.dtype)
    singular = np.zeros(count, dtype=bool)
    for k in range(rows):
        spend(_PRODUCT * count * (n - k) ** 2)
        # row k of an independent set has a nonzero entry left; swap it into column k
        pivot_at = k + np.argmax(work[:, k, k:] != 0, axis=1)
        swap = np.flatnonzero(pivot_at != k)
        at = pivot_at[swap]
        order[swap, k], order[swap, at] = order[swap, at], order[swap, k]
        work[swap, :, k], work[swap, :, at] = work[swap, :, at], work[swap, :, k]
        work = _room(work)
        pivot = work[:, k, k].copy()
        singular |= pivot == 0
        pivot[pivot == 0] = 1
        below = pivot[:, None, None] * work[:, k + 1 :, k + 1 :]
        below -= work[:, k + 1 :, k, None] * work[:, None, k, k + 1 :]
        work[:, k + 1 :, k + 1 :] = below // last[:, None, None] if k else below
        work[:, k, k] = last = pivot

    # back substitution; minors of the whole matrix, so that every division is exact
    h = np.zeros((count, n), dtype=object)
    h[:, rows] = last
    for k in range(rows - 1, -1, -1):
        h[:, k] = -(work[:, k, k + 1 :] * h[:, k + 1 :]).sum(axis=1) // work[:, k, k]
    out = np.zeros_like(h)
    out[each[:, None], order] = h
    out[singular] = 0
    return divide_by_content(out)


def _as_small_integers(matrix: NDArray[Any]) -> NDArray[Any]:
    """As int64 if products of two entries fit into it."""
    if matrix.dtype == np.int64 or not matrix.size:
        return matrix
    small = int(max(matrix.max(), -matrix.min())) <= _INT64_FACTOR
    return matrix.astype(np.int64) if small else matrix


def _room(matrix: NDArray[Any]) -> NDArray[Any]:
    """As Python integers if products of two entries would overflow int64."""
    if matrix.dtype != np.int64 or not matrix.size or max(matrix.max(), -matrix.min()) <= _INT64_FACTOR:
        return matrix
    return matrix.astype(object)


# -- FLINT's integers


def _flint(matrix: Integers) -> Any:
    rows, columns = matrix.shape
    from flint import fmpz_mat  # noqa: PLC0415  (takes time, and most verdicts need no exact solve)

    return fmpz_mat(rows, columns, matrix.ravel().tolist())


def _integers(matrix: Any) -> Integers:
    flat = [int(x) for x in matrix.entries()]
    return np.array(flat, dtype=object).reshape(matrix.nrows(), matrix.ncols())
