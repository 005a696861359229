"""Feasibility of M x = b, x >= 0 in rational numbers: a solution or a proof that there is none.

Farkas' lemma: exactly one of the two systems

    M x = b,  x >= 0        and        y'M >= 0,  y'b < 0

has a solution.  HiGHS proposes an optimal basis of the phase-one program; exact factorisations of that
basis give x or y.  If the proposal is not optimal, the simplex method goes on from it in integers, with
Bland's rule.  Either answer is checked before it is returned, by `is_solution` or `is_farkas`.
"""

from __future__ import annotations

from fractions import Fraction
from math import gcd, lcm
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import ShapeError, TooLargeError
from .budget import OutOfBudgetError, budget, seconds_left, spend
from .intake import exact_matrix
from .linalg import Rationals, lifting_operations, solve_exactly
from .matrix import Integers, primitive
from .programs import balance, solve

# Operations after which exact arithmetic gives up.
WORK_LIMIT = 10**10
# Under a time limit, the seconds that a solver which hangs is waited for, for each entry of M, and one more: the
# simplex method here comes to the same answer without it.
_PATIENCE = 1e-5


def exact_feasibility(M: Any, b: Any, *, work_limit: float = WORK_LIMIT) -> tuple[Rationals | None, Rationals | None]:
    """Decide M x = b, x >= 0 exactly.

    Parameters
    ----------
    M : array_like of numbers, Fraction or decimal strings, or Matrix, shape (m, n)
    b : likewise, shape (m,)
    work_limit : float
        Operations after which to give up; earlier if the search around it ends.

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
        If the operations exceed the limit, or the search around it ends.

    Notes
    -----
    Two exact solutions of m equations if HiGHS is right: 0.2 s for 60 rows of doubles, 4 s for 150.

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
    factors = np.array([_common_factor(matrix[i], right[i]) for i in range(m)], dtype=object)
    signs = np.where(right < 0, -1, 1).astype(object)
    reduced = (matrix * signs[:, None]) // factors[:, None] if m else matrix
    target = (right * signs) // factors if m else right
    phase_one = np.concatenate([reduced, np.eye(m, dtype=int).astype(object)], axis=1)
    rows, basis = _proposal(reduced, target)
    # the artificial variables cost what they cost HiGHS, which saw scaled rows
    cost = np.array([0] * n + [1 << int(r) for r in rows - rows.min(initial=0)], dtype=object)
    try:
        with budget(work_limit):
            x, y = _simplex(phase_one, target, cost, n, basis)
    except OutOfBudgetError as error:
        raise TooLargeError(f"exact feasibility of a {m} x {n} system takes too long: {error}.") from None
    if y is not None:
        y = primitive_fractions(y * signs / factors)
    if (x is not None and _solves(matrix, right, x)) or (y is not None and _excludes(matrix, right, y)):
        return x, y
    raise ArithmeticError("the exact simplex method returned a wrong answer; please report this.")


def exact_combination(
    vectors: Rationals, target: Rationals, free: int | None = None, *, work_limit: float = WORK_LIMIT
) -> tuple[Rationals | None, Rationals | None]:
    """A target as a combination of the rows x_i of `vectors` with weights >= 0, that of row `free` of any sign.

    Returns
    -------
    weights : ndarray of Fraction, shape (N,), or None
    h : ndarray of Fraction, shape (n,), or None
        h'x_i >= 0 (= 0 at `free`) and h'target < 0.  Exactly one of the two is not None.

    Raises
    ------
    TooLargeError
        As in `exact_feasibility`.
    """
    R = vectors.T if free is None else np.concatenate([vectors.T, -vectors[[free]].T], axis=1)
    weights, h = exact_feasibility(R, target, work_limit=work_limit)
    if weights is None or free is None:
        return weights, h
    weights[free] -= weights[-1]
    return weights[:-1], h


def is_solution(M: Any, b: Any, x: Any) -> bool:
    """True if M x = b and x >= 0, in exact arithmetic."""
    return _solves(*_integers(M, b), x)


def is_farkas(M: Any, b: Any, y: Any) -> bool:
    """True if y'M >= 0 and y'b < 0, in exact arithmetic: then M x = b has no solution x >= 0."""
    return _excludes(*_integers(M, b), y)


def _solves(matrix: Integers, right: Integers, x: Any) -> bool:
    x = np.array([Fraction(v) for v in x], dtype=object)
    return x.shape == (matrix.shape[1],) and bool((x >= 0).all() and (matrix @ x == right).all())


def _excludes(matrix: Integers, right: Integers, y: Any) -> bool:
    y = np.array([Fraction(v) for v in y], dtype=object)
    return y.shape == (matrix.shape[0],) and bool((y @ matrix >= 0).all() and y @ right < 0)


def primitive_fractions(y: Rationals) -> Rationals:
    """y times the positive number that makes its entries integers without a common factor."""
    common = lcm(*(Fraction(v).denominator for v in y)) if y.size else 1
    return np.array([Fraction(int(v)) for v in primitive([int(Fraction(v) * common) for v in y])], dtype=object)


def _integers(M: Any, b: Any) -> tuple[Integers, Integers]:
    """M and b as integers, multiplied by one positive number."""
    M, b = exact_matrix(M, "M"), exact_matrix(b, "b", ndim=1)
    if M.shape[0] != b.shape[0]:
        raise ShapeError(f"M has {M.shape[0]} rows, but b has {b.shape[0]} entries.")
    (left, factor), (right, other) = M.as_integers(), b.as_integers()
    ratio = Fraction(other) / Fraction(factor)
    return np.asarray(left, dtype=object) * ratio.denominator, np.asarray(right, dtype=object) * ratio.numerator


def _common_factor(row: Integers, value: Any) -> int:
    return gcd(*(int(v) for v in row), int(value)) or 1


def _proposal(matrix: Integers, right: Integers) -> tuple[NDArray[np.int32], NDArray[np.intp] | None]:
    """Exponents of row scales, and the basis of the scaled phase-one program that HiGHS calls optimal."""
    m, n = matrix.shape
    mantissa, exponent = _frexp(matrix)
    rows, columns = balance(sp.csr_array(np.ldexp(mantissa, exponent - exponent.max(initial=0))))
    values = np.ldexp(mantissa, np.maximum(exponent + rows[:, None] + columns - exponent.max(initial=0), -1000))
    size, power = _frexp(right)
    power = power + rows
    goal = np.ldexp(size, np.maximum(power - power[size != 0].max(initial=-1100), -1000))
    cost = np.concatenate([np.zeros(n), np.ones(m)])
    patience = 1 + _PATIENCE * matrix.size if seconds_left() < np.inf else np.inf
    answer = solve(cost, A_eq=np.hstack([values, np.eye(m)]), b_eq=goal, time_limit=patience)
    if not answer or answer.basic is None:
        return rows, None
    # a basic row stands for its artificial variable
    basis = np.unique(np.where(answer.basic >= n + m, answer.basic - m, answer.basic))
    return rows, basis if len(basis) == m else None


def _frexp(values: Integers) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mantissas and exponents of integers of any length."""
    exponent = np.array([abs(int(v)).bit_length() for v in values.ravel()], dtype=np.int64).reshape(values.shape)
    shift = np.maximum(exponent - 60, 0)
    mantissa = np.array([float(int(v) >> int(s)) for v, s in zip(values.ravel(), shift.ravel(), strict=True)])
    return np.ldexp(mantissa.reshape(values.shape), shift - exponent), exponent


def _simplex(
    matrix: Integers, right: Integers, cost: Integers, n: int, proposal: NDArray[np.intp] | None
) -> tuple[Rationals | None, Rationals | None]:
    """Phase one from a basis, in integers; each step solves with the basis afresh.

    Bland's rule, so that it ends; the variables n, n+1, ... are artificial.
    """
    m = len(matrix)
    step = 2 * lifting_operations(matrix, 1)
    basis = np.arange(n, n + m) if proposal is None else proposal
    while True:
        spend(step)
        inside = solve_exactly(matrix[:, basis], right[:, None])
        if inside is None or (inside[0] < 0).any():
            # not a feasible basis: HiGHS was wrong, start from the artificial variables
            basis = np.arange(n, n + m)
            continue
        values = inside[0][:, 0]
        price = solve_exactly(matrix[:, basis].T, cost[basis][:, None])
        if price is None:  # a basis is invertible
            raise ArithmeticError("the exact simplex method lost its basis; please report this.")
        y, denominator = price[0][:, 0], price[1]
        reduced = cost * denominator - y @ matrix
        negative = np.flatnonzero(reduced < 0)
        if not (values[basis >= n] != 0).any():
            x = np.full(n, Fraction(0), dtype=object)
            x[basis[basis < n]] = [Fraction(int(v), inside[1]) for v in values[basis < n]]
            return x, None
        if not negative.size:
            return None, np.array([Fraction(-int(v)) for v in y], dtype=object)
        enter = int(negative[0])
        column = solve_exactly(matrix[:, basis], matrix[:, enter][:, None])
        if column is None:
            raise ArithmeticError("the exact simplex method lost its basis; please report this.")
        direction = column[0][:, 0]
        candidates = [
            (Fraction(int(values[i]), int(direction[i])), int(basis[i]), i) for i in range(m) if direction[i] > 0
        ]
        basis = basis.copy()
        basis[min(candidates)[2]] = enter  # some entry is positive: the cost is bounded below
