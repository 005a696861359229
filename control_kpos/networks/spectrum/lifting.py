"""Exact solution of square systems of a few hundred integer equations.

Dixon's lifting (Numerische Mathematik 40, 1982): with the inverse modulo one prime p, the solution of M x = b
follows digit by digit to the base p; when there are enough digits its fractions are recovered by the
Euclidean algorithm.  Every digit costs a product with a small inverse and one with the sparse M, so that
networks with hundreds of nodes take seconds where an elimination in integers would take hours.
"""

from __future__ import annotations

from fractions import Fraction
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from ...exact.matrix import Integers

# Primes below 2^25: sums of 2^13 products of residues stay below 2^63.
_PRIMES = (33554393, 33554383, 33554371)
_LARGEST = 2**13


def solve_by_lifting(matrix: Integers, right: Integers) -> tuple[Integers, int] | None:
    """Solution of a square system with integer entries.

    Parameters
    ----------
    matrix : ndarray of int (object), shape (m, m)
    right : ndarray of int (object), shape (m,)

    Returns
    -------
    numerators : ndarray of int (object), shape (m,)
    denominator : int
        Positive: matrix @ numerators = denominator * right.  None instead of both if the matrix is singular
        modulo all primes tried (above all if it is singular), or larger than 8192 rows.

    Notes
    -----
    m**3 operations on machine integers, and for each of the digits of the solution, at most
    m times the length of the data, m**2 on machine integers and one on long integers per nonzero entry.

    Examples
    --------
    >>> import numpy as np
    >>> solve_by_lifting(np.array([[2, 0], [1, 3]], dtype=object), np.array([1, 1], dtype=object))
    (array([3, 1], dtype=object), 6)
    """
    size = len(matrix)
    if size > _LARGEST:
        return None
    for prime in _PRIMES:
        inverse = _inverse(np.array(matrix % prime, dtype=np.int64), prime)
        if inverse is not None:
            return _lift(matrix, right, inverse, prime)
    return None


def _inverse(a: NDArray[np.int64], p: int) -> NDArray[np.int64] | None:
    """Inverse modulo p by Gauss-Jordan elimination, or None."""
    size = len(a)
    work = np.concatenate([a, np.eye(size, dtype=np.int64)], axis=1)
    for k in range(size):
        pivots = np.flatnonzero(work[k:, k])
        if not pivots.size:
            return None
        best = k + int(pivots[0])
        if best != k:
            work[[k, best]] = work[[best, k]]
        work[k] = work[k] * pow(int(work[k, k]), -1, p) % p
        others = np.flatnonzero(work[:, k])
        others = others[others != k]
        work[others] = (work[others] - work[others, k, None] * work[k]) % p
    return work[:, size:]


def _lift(matrix: Integers, right: Integers, inverse: NDArray[np.int64], p: int) -> tuple[Integers, int]:
    rows, columns = np.nonzero(matrix)
    data, starts = matrix[rows, columns], np.searchsorted(rows, np.arange(len(matrix)))
    rest, total, modulus = right.copy(), np.zeros(len(matrix), dtype=object), 1
    digits, ready = 0, 8
    while True:
        digit = inverse @ np.array(rest % p, dtype=np.int64) % p
        exact = digit.astype(object)
        total = total + exact * modulus
        rest = (rest - np.add.reduceat(data * exact[columns], starts)) // p
        modulus *= p
        digits += 1
        if digits < ready:
            continue
        ready = digits + digits // 2
        found = _fractions(total, modulus)
        if found is not None:
            numerators, denominator = found
            if (np.add.reduceat(data * numerators[columns], starts) == denominator * right).all():
                return found


def _fractions(residues: Integers, modulus: int) -> tuple[Integers, int] | None:
    """Numerators over a common denominator with these residues, all small against the modulus, or None."""
    bound = isqrt(modulus // 2)
    common, parts = 1, []
    for residue in residues.tolist():
        found = _fraction(residue * common % modulus, modulus, bound)
        if found is None or common * found.denominator > bound:
            return None
        parts.append((found.numerator, common * found.denominator))
        common *= found.denominator
    return np.array([n * (common // d) for n, d in parts], dtype=object), common


def _fraction(residue: int, modulus: int, bound: int) -> Fraction | None:
    """n / d with n = d residue modulo the modulus and n, d up to the bound, or None."""
    a, b, s, t = modulus, residue, 0, 1
    while b > bound:
        quotient = a // b
        a, b, s, t = b, a - quotient * b, t, s - quotient * t
    return Fraction(b, t) if 0 < abs(t) <= bound else None
