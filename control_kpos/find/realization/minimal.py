"""Minimal realizations in fractions: of transfer functions, of systems, and of impulse responses.

A system is reduced to what its inputs reach, the range V of [B, AB, A^2 B, ...], with A V = V A1, B = V B1, C1 = C V;
then the same is done for the transposed system.  What is left is minimal (Kalman), exactly.

An impulse response h_1, h_2, ..., h_N of one input and output whose Hankel matrices have the rank n, also with one row
or one column more, has the minimal realization c = (1, 0, ...), b = (h_1, ..., h_n), A the companion matrix of the
recurrence h_(k+n) = a_1 h_k + ... + a_n h_(k+n-1), and no other one goes through these numbers (Ho and Kalman; Tether).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ...errors import DataError, TooLargeError
from ...exact.linalg import Rationals, columns, product, rank, solve_columns
from ...exact.matrix import Matrix

# States up to which systems are reduced in fractions.
_LARGEST = 40


@dataclass(frozen=True)
class Realization:
    """x' = A x + B u (x[k+1]), y = C x + D u, minimal, in fractions."""

    A: Rationals
    B: Rationals
    C: Rationals
    D: Rationals

    @property
    def matrices(self) -> tuple[Matrix, ...]:
        """A, B, C and D."""
        return tuple(map(Matrix.from_fractions, (self.A, self.B, self.C, self.D)))


def minimal(A: Rationals, B: Rationals, C: Rationals, D: Rationals) -> Realization:
    """The minimal realization; the given one if it is minimal."""
    if len(A) > _LARGEST:
        raise TooLargeError(f"G has {len(A)} states; minimal realizations are formed in fractions up to {_LARGEST}.")
    A, B, C = _reached(A, B, C)
    At, Ct, Bt = _reached(A.T, C.T, B.T)
    return Realization(At.T, Bt.T, Ct.T, D)


def _reached(A: Rationals, B: Rationals, C: Rationals) -> tuple[Rationals, Rationals, Rationals]:
    """The system on the range of [B, AB, ...]."""
    n = len(A)
    V = columns(B) if B.size else B[:, :0]
    while 0 < V.shape[1] < n:
        more = columns(np.concatenate([V, product(A, V)], axis=1))
        if more.shape[1] == V.shape[1]:
            break
        V = more
    if V.shape[1] == n:
        return A, B, C
    if not V.shape[1]:
        return A[:0, :0], B[:0], C[:, :0]
    A1, B1 = solve_columns(V, product(A, V)), solve_columns(V, B)
    if A1 is None or B1 is None:
        raise ArithmeticError("what inputs reach is not invariant")
    return A1, B1, product(C, V)


def connected(s: Realization) -> Realization:
    """Without the states to which no walk leads from an input, or from which none leads to an output: same response."""
    from_inputs, to_outputs = (s.B != 0).any(axis=1), (s.C != 0).any(axis=0)
    walks = s.A != 0
    for _ in range(len(s.A)):
        from_inputs = from_inputs | (walks & from_inputs).any(axis=1)
        to_outputs = to_outputs | (walks.T & to_outputs).any(axis=1)
    kept = np.flatnonzero(from_inputs & to_outputs)
    return Realization(s.A[np.ix_(kept, kept)], s.B[kept], s.C[:, kept], s.D)


def towards(small: Realization, s: Realization) -> Rationals | None:
    """R with C A^k R = Q P^k for the minimal (A, B, C) and P, Q of s, k < n; None if there is none.

    If any R satisfies A R = R P and C R = Q it is this one.
    """
    seen, wanted = [small.C], [s.C]
    for _ in range(len(small.A) - 1):
        seen.append(product(seen[-1], small.A))
        wanted.append(product(wanted[-1], s.A))
    return solve_columns(np.concatenate(seen), np.concatenate(wanted))


def companion(numerator: Sequence[Fraction], denominator: Sequence[Fraction]) -> Realization:
    """The companion form of a proper rational function, coefficients from the highest power on; perhaps not minimal."""
    den = _without_leading_zeros(denominator)
    num = _without_leading_zeros(numerator)
    if len(num) > len(den):
        raise DataError("G has more zeros than poles; no state-space system has such a transfer function.")
    n = len(den) - 1
    a = [x / den[0] for x in den]
    b = [Fraction(0)] * (n + 1 - len(num)) + [x / den[0] for x in num]
    A = np.full((n, n), Fraction(0), dtype=object)
    for i in range(n - 1):
        A[i, i + 1] = Fraction(1)
    B, C = np.full((n, 1), Fraction(0), dtype=object), np.full((1, n), Fraction(0), dtype=object)
    for i in range(n):
        A[n - 1, i] = -a[n - i]
        C[0, i] = b[n - i] - b[0] * a[n - i]
    if n:
        B[n - 1, 0] = Fraction(1)
    return Realization(A, B, C, np.array([[b[0]]], dtype=object))


def beside_each_other(parts: list[list[Realization]]) -> Realization:
    """Outputs by rows, inputs by columns; each part has states of its own."""
    q, m = len(parts), len(parts[0])
    n = sum(len(part.A) for row in parts for part in row)
    A, B, C = (np.full(shape, Fraction(0), dtype=object) for shape in ((n, n), (n, m), (q, n)))
    D, first = np.full((q, m), Fraction(0), dtype=object), 0
    for i, row in enumerate(parts):
        for j, part in enumerate(row):
            own = slice(first, first + len(part.A))
            A[own, own], B[own, [j]], C[[i], own], D[i, j] = part.A, part.B, part.C, part.D[0, 0]
            first = own.stop
    return Realization(A, B, C, D)


def of_response(h: Sequence[Fraction]) -> Realization:
    """The minimal realization of an impulse response h_0 = D, h_1, h_2, ...

    Raises
    ------
    DataError
        There are too few numbers to know the order.
    """
    D, h = np.array([[h[0]]], dtype=object), h[1:]
    rows = len(h) // 2
    width = len(h) - rows
    n = rank(_hankel(h, rows, width)) if rows else len(h)
    if rows and n == rank(_hankel(h, rows + 1, width)) == rank(_hankel(h, rows, width + 1)) and 2 * n <= len(h):
        H = _hankel(h, n, n)
        a = solve_columns(H, np.array(h[n : 2 * n], dtype=object)[:, None]) if n else None
        if n and a is not None:
            A = np.full((n, n), Fraction(0), dtype=object)
            A[np.arange(n - 1), np.arange(1, n)] = Fraction(1)
            A[n - 1] = a[:, 0]
            C = np.array([[Fraction(int(i == 0)) for i in range(n)]], dtype=object)
            return Realization(A, np.array(h[:n], dtype=object)[:, None], C, D)
        if not n:
            empty: Any = np.zeros((0, 0), dtype=object)
            return Realization(empty, empty.reshape(0, 1), empty.reshape(1, 0), D)
    raise DataError(
        f"G is an impulse response of {len(h) + 1} numbers, which determine no system: their Hankel matrices have "
        "no rank below their size. Give more numbers, exactly: twice the order and one more at least."
    )


def _hankel(h: Sequence[Fraction], rows: int, width: int) -> Rationals:
    return np.array([[h[i + j] for j in range(width)] for i in range(rows)], dtype=object).reshape(rows, width)


def _without_leading_zeros(p: Sequence[Fraction]) -> list[Fraction]:
    first = next((k for k, x in enumerate(p) if x), len(p) - 1)
    return list(p[first:])
