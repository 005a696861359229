"""Feasibility of M x = b, x >= 0 in rational numbers: a solution or a proof that there is none.

Farkas' lemma: exactly one of the two systems

    M x = b,  x >= 0        and        y'M >= 0,  y'b < 0

has a solution.  HiGHS proposes an optimal basis of the phase-one program; one exact factorisation of
that basis gives x or y.  If the proposal was wrong, the simplex method in integers with Bland's rule
decides.  Either answer is checked before it is returned, by `is_solution` or `is_farkas`.
"""

from __future__ import annotations

from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Integers, exact_matrix, primitive
from .errors import ShapeError, TooLargeError
from .linear_programs import solve

Rationals = NDArray[np.object_]

# Above this many rows times columns of M the integers would take minutes.
SIZE_LIMIT = 60_000


def exact_feasibility(M: Any, b: Any) -> tuple[Rationals | None, Rationals | None]:
    """Decide M x = b, x >= 0 exactly.

    Parameters
    ----------
    M : array_like of numbers, Fraction or decimal strings, or ExactMatrix, shape (m, n)
    b : likewise, shape (m,)

    Returns
    -------
    x : ndarray of Fraction, shape (n,), or None
        A solution with at most m positive entries.
    y : ndarray of Fraction, shape (m,), or None
        y'M >= 0 and y'b < 0.  Exactly one of x and y is not None.

    Raises
    ------
    ShapeError
        If M and b do not fit.
    TooLargeError
        If M has more than `SIZE_LIMIT` entries.

    Notes
    -----
    One elimination in integers, about m**3 multiplications of numbers that grow to m times the length
    of the data: 0.1 s for 60 rows of doubles.

    Examples
    --------
    >>> x, y = exact_feasibility([[1, 1]], [3])
    >>> x, y
    (array([Fraction(3, 1), Fraction(0, 1)], dtype=object), None)
    >>> exact_feasibility([[1, 1]], [-1])
    (None, array([Fraction(1, 1)], dtype=object))
    """
    matrix, right = _integers(M, b)
    m, n = matrix.shape
    if matrix.size > SIZE_LIMIT:
        raise TooLargeError(f"exact feasibility of a {m} x {n} system is refused (limit {SIZE_LIMIT} entries).")
    signs = np.where(right < 0, -1, 1)
    phase_one = np.concatenate([matrix * signs[:, None], np.eye(m, dtype=int).astype(object)], axis=1)
    target = right * signs
    for basis in _proposals(phase_one, target, n):
        x, y = _read_basis(phase_one, target, basis, n)
        if x is not None and is_solution(matrix, right, x):
            return x, None
        if y is not None:
            y = primitive_fractions(y * signs)
            if is_farkas(matrix, right, y):
                return None, y
    return _check(matrix, right, *_bland(phase_one, target, n, signs))


def is_solution(M: Any, b: Any, x: Any) -> bool:
    """True if M x = b and x >= 0, in exact arithmetic."""
    matrix, right = _integers(M, b)
    x = np.array([Fraction(v) for v in x], dtype=object)
    return x.shape == (matrix.shape[1],) and bool((x >= 0).all() and (matrix @ x == right).all())


def is_farkas(M: Any, b: Any, y: Any) -> bool:
    """True if y'M >= 0 and y'b < 0, in exact arithmetic: then M x = b has no solution x >= 0."""
    matrix, right = _integers(M, b)
    y = np.array([Fraction(v) for v in y], dtype=object)
    return y.shape == (matrix.shape[0],) and bool((y @ matrix >= 0).all() and y @ right < 0)


def primitive_fractions(y: Rationals) -> Rationals:
    """y times the positive number that makes its entries integers without a common factor."""
    common = lcm(*(Fraction(v).denominator for v in y)) if y.size else 1
    return np.array([Fraction(int(v)) for v in primitive([int(Fraction(v) * common) for v in y])], dtype=object)


def solve_exactly(matrix: Integers, right: Integers) -> Rationals | None:
    """Solution of a square system with integer entries, or None if it is singular.

    Parameters
    ----------
    matrix : ndarray of int (object), shape (m, m)
    right : ndarray of int (object), shape (m, k)

    Returns
    -------
    ndarray of Fraction, shape (m, k), or None

    Notes
    -----
    Fraction-free elimination (Bareiss): every intermediate number is a minor of the data.
    """
    m = len(matrix)
    work = np.concatenate([matrix, right], axis=1).astype(object)
    last = 1
    for k in range(m):
        pivots = [i for i in range(k, m) if work[i, k] != 0]
        if not pivots:
            return None
        best = min(pivots, key=lambda i: abs(work[i, k]))
        if best != k:
            work[[k, best]] = work[[best, k]]
        pivot = work[k, k]
        others = np.arange(m) != k
        column = work[others, k]
        work[others, k:] = (pivot * work[others, k:] - column[:, None] * work[k, k:]) // last
        last = pivot
    return np.array([[Fraction(int(v), int(last)) for v in row] for row in work[:, m:]], dtype=object).reshape(
        right.shape
    )


def _integers(M: Any, b: Any) -> tuple[Integers, Integers]:
    """M and b as integers, each row [M_i, b_i] multiplied by one positive number."""
    (left, factor), (right, other) = _common(M, "M", 2), _common(b, "b", 1)
    if len(left) != len(right):
        raise ShapeError(f"M has {len(left)} rows, but b has {len(right)} entries.")
    ratio = Fraction(other) / Fraction(factor)
    return left * ratio.denominator, right * ratio.numerator


def _common(data: Any, name: str, ndim: int) -> tuple[Integers, Fraction]:
    if isinstance(data, np.ndarray) and data.dtype == object and data.ndim == ndim:
        # exact already, and perhaps beyond the range of doubles
        exact = [Fraction(x) for x in data.ravel()]
        common = lcm(*(x.denominator for x in exact))
        ints = np.array([x.numerator * (common // x.denominator) for x in exact], dtype=object)
        return ints.reshape(data.shape), Fraction(1, common)
    ints, factor = exact_matrix(data, name, ndim=ndim).as_integers()
    return np.asarray(ints, dtype=object), Fraction(factor)


def _proposals(matrix: Integers, right: Integers, n: int) -> list[NDArray[np.intp]]:
    """Bases of the phase-one program that HiGHS calls optimal; at most one."""
    m = len(matrix)
    try:
        values = np.array([[float(v) for v in row] for row in matrix]).reshape(matrix.shape)
        goal = np.array([float(v) for v in right])
    except OverflowError:
        return []
    cost = np.concatenate([np.zeros(n), np.ones(m)])
    answer = solve(cost, A_eq=values, b_eq=goal)
    if not answer or answer.basic is None or len(answer.basic) != m:
        return []
    # a basic row stands for its artificial variable
    basis = np.unique(np.where(answer.basic >= n + m, answer.basic - m, answer.basic))
    return [basis] if len(basis) == m else []


def _read_basis(
    matrix: Integers, right: Integers, basis: NDArray[np.intp], n: int
) -> tuple[Rationals | None, Rationals | None]:
    """The x, or the y, that an optimal phase-one basis stands for."""
    square = matrix[:, basis]
    solution = solve_exactly(square, right[:, None])
    if solution is None or not (solution >= 0).all():
        return None, None
    solution = solution[:, 0]
    if all(value == 0 for value, j in zip(solution, basis, strict=True) if j >= n):
        x = np.full(n, Fraction(0), dtype=object)
        inside = basis < n
        x[basis[inside]] = solution[inside]
        return x, None
    price = solve_exactly(square.T, np.array([[int(j >= n)] for j in basis], dtype=object))
    return None, None if price is None else -price[:, 0]


def _bland(matrix: Integers, right: Integers, n: int, signs: NDArray[Any]) -> tuple[Rationals | None, Rationals | None]:
    """Phase one of the simplex method on an integer tableau, with Bland's rule: always ends."""
    m = len(matrix)
    table = np.concatenate([matrix, right[:, None]], axis=1).astype(object)
    # reduced costs of "minimise the sum of the artificial variables", priced out
    price = np.concatenate([-table[:, :n].sum(axis=0), np.zeros(m, dtype=int), [-table[:, -1].sum()]]).astype(object)
    table = np.concatenate([table, price[None, :]])
    basis, last = list(range(n, n + m)), 1
    while True:
        enter = next((j for j in range(n + m) if table[-1, j] < 0), None)
        if enter is None:
            break
        ratios = [
            (Fraction(int(table[i, -1]), int(table[i, enter])), basis[i], i) for i in range(m) if table[i, enter] > 0
        ]
        leave = min(ratios)[2]  # some entry is positive: the phase-one cost is bounded below
        pivot = table[leave, enter]
        others = np.arange(m + 1) != leave
        column = table[others, enter]
        table[others] = (pivot * table[others] - column[:, None] * table[leave]) // last
        last = pivot
        basis[leave] = enter
    if table[-1, -1] == 0:
        x = np.full(n + m, Fraction(0), dtype=object)
        for i, j in enumerate(basis):
            x[j] = Fraction(int(table[i, -1]), int(last))
        return x[:n], None
    # the reduced cost of artificial i is 1 - y_i
    y = np.array([Fraction(int(table[-1, n + i]), int(last)) - 1 for i in range(m)], dtype=object)
    return None, primitive_fractions(y * signs)


def _check(
    matrix: Integers, right: Integers, x: Rationals | None, y: Rationals | None
) -> tuple[Rationals | None, Rationals | None]:
    if (x is not None and is_solution(matrix, right, x)) or (y is not None and is_farkas(matrix, right, y)):
        return x, y
    raise ArithmeticError("the exact simplex method returned a wrong answer; please report this.")
