"""Exact linear algebra: what FLINT answers is multiplied back, and a wrong answer is refused."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control_kpos.exact import linalg
from control_kpos.exact.linalg import (
    LARGEST_PRIME,
    WrongAnswerError,
    columns,
    echelon,
    independent_modulo,
    inverse_rows,
    nullspace,
    power,
    prime_below,
    product,
    rank,
    solve_columns,
    solve_exactly,
)
from control_kpos.exact.matrix import integers_of_doubles

SIZES = st.integers(1, 9)


def integers(rows, columns, seed, largest=9):
    return np.random.default_rng(seed).integers(-largest, largest + 1, (rows, columns)).astype(object)


def of_rank(rows, columns, r, seed):
    """The product of two random factors; the identities in them make the rank exactly r."""
    left, right = integers(rows, r, seed), integers(r, columns, seed + 1)
    left[:r], right[:, :r] = np.eye(r, dtype=int), np.eye(r, dtype=int)
    rng = np.random.default_rng(seed)
    return (left @ right)[rng.permutation(rows)][:, rng.permutation(columns)]


# -- equations


@given(SIZES, st.integers(1, 3), st.integers(0, 10**6), st.sampled_from([3, 2**30, 2**53]))
def test_solutions_solve(n, k, seed, largest):
    A, B = integers(n, n, seed, largest), integers(n, k, seed + 1)
    found = solve_exactly(A, B)
    if found is None:
        assert echelon(A).rank < n
    else:
        assert found[1] > 0 and (A @ found[0] == found[1] * B).all()


def test_solutions_are_unique_and_signed():
    A, b = np.array([[2, 1], [1, 3]], dtype=object), np.array([[1], [1]], dtype=object)
    for matrix, sign in ((A, 1), (A[::-1], 1), (-A, -1)):
        x, denominator = solve_exactly(matrix, b)
        assert denominator == 5 and x[:, 0].tolist() == [2 * sign, sign]
    assert solve_exactly(np.array([[1, 2], [2, 4]], dtype=object), b) is None
    x, denominator = solve_exactly(np.zeros((0, 0), dtype=object), np.zeros((0, 2), dtype=object))
    assert x.shape == (0, 2) and denominator == 1


def test_a_hundred_equations_of_doubles():
    A, _ = integers_of_doubles(np.random.default_rng(0).normal(size=(100, 100)))
    b = integers(100, 1, 1)
    x, denominator = solve_exactly(A, b)
    assert denominator > 0 and (A @ x == denominator * b).all()


@pytest.mark.parametrize("n", [1, 2, 5, 12, 30])
def test_rows_of_the_inverse(n):
    for largest in (3, 2**30, 2**53):
        R = integers(n, n, n, largest)
        H = inverse_rows(R)
        if H is None:
            assert echelon(R).rank < n
            continue
        image = R @ H.T
        assert (np.diag(image) > 0).all() and not image[~np.eye(n, dtype=bool)].any()
        assert (inverse_rows(R, np.array([n - 1, 0])) == H[[n - 1, 0]]).all()
        assert all(np.gcd.reduce(np.abs(h)) == 1 for h in H)
    assert inverse_rows(np.zeros((n, n), dtype=object), np.arange(1)) is None


# -- rank and kernel


@given(SIZES, SIZES, st.integers(0, 9), st.integers(0, 10**6))
def test_rank_and_kernel_of_a_product(p, n, r, seed):
    r = min(p, n, r)
    M = of_rank(p, n, r, seed)
    form = echelon(M)
    assert form.rank == r and form.null_space.shape == (n - r, n)
    assert not (M @ form.null_space.T).any()
    free = np.setdiff1d(np.arange(n), form.columns)
    assert (form.null_space[:, free] * (1 - np.eye(n - r, dtype=int)) == 0).all()
    assert (np.diag(form.null_space[:, free]) > 0).all()
    before = [echelon(M[: k + 1]).rank for k in range(p)]
    assert form.rows.tolist() == [k for k in range(p) if before[k] > (before[k - 1] if k else 0)]


def test_the_rank_modulo_a_prime_is_not_believed():
    """Rows that are independent, and dependent modulo a prime; and matrices that vanish modulo several."""
    second = prime_below(LARGEST_PRIME)
    third = prime_below(second)
    for factor in (LARGEST_PRIME, LARGEST_PRIME * second, LARGEST_PRIME * second * third):
        M = np.array([[1, 1], [1, 1 + factor]], dtype=object)
        assert len(independent_modulo(M, LARGEST_PRIME)[0]) == 1
        assert echelon(M).rank == 2 and solve_exactly(M, np.eye(2, dtype=int)) is not None
        assert echelon(M * factor).rank == 2 and echelon(factor * np.ones((2, 3), dtype=object)).rank == 1


def test_primes_are_prime():
    prime = LARGEST_PRIME
    for _ in range(4):
        assert all(prime % k for k in range(2, 46341))
        prime = prime_below(prime)


# -- a library that lies


class Lying:
    """Integer matrices whose solutions are wrong, or that are said to be singular."""

    def __init__(self, kind, matrix):
        self.kind, self.matrix = kind, matrix

    def solve(self, right):
        if self.kind == "singular":
            raise ZeroDivisionError
        solution, common = self.matrix.solve(right.matrix).numer_denom()
        ones = type(solution)(solution.nrows(), solution.ncols(), [1] * solution.nrows() * solution.ncols())
        self.answer = {
            "entry": lambda: (solution + ones, common),
            "sign": lambda: (-1 * solution, -common),
            "zero": lambda: (0 * solution, 0 * common),
            "scale": lambda: (2 * solution, common),
        }[self.kind]()
        return self

    def numer_denom(self):
        return self.answer


@pytest.mark.parametrize("kind", ["singular", "entry", "sign", "zero", "scale"])
def test_wrong_answers_of_the_library_are_refused(kind, monkeypatch):
    true = linalg._flint
    monkeypatch.setattr(linalg, "_flint", lambda matrix: Lying(kind, true(matrix)))
    A = np.array([[2, 1], [1, 3]], dtype=object)
    for question in (
        lambda: solve_exactly(A, np.array([[1], [1]], dtype=object)),
        lambda: inverse_rows(A),
        lambda: echelon(np.array([[1, 2, 3]], dtype=object)),
    ):
        with pytest.raises(WrongAnswerError, match="please report"):
            question()


# -- fractions


def test_linear_algebra_of_fractions():
    third = Fraction(1, 3)
    M = np.array([[third, 2 * third, 1], [1, 2, 3]], dtype=object)
    assert rank(M) == 1 and columns(M).tolist() == [[third], [1]]
    N = nullspace(M)
    assert N.shape == (3, 2) and not (M @ N).any() and N[1:].tolist() == [[1, 0], [0, 1]]
    W = np.array([[third, 0], [1, 1], [2, 5]], dtype=object)
    Z = np.array([[Fraction(1, 7)], [-2]], dtype=object)
    assert (solve_columns(W, W @ Z) == Z).all()
    assert solve_columns(W, np.array([[0], [0], [1]], dtype=object)) is None
    assert (product(W.T, W) == W.T @ W).all()
    square = (W.T @ W).astype(object)
    assert (power(square, 3) == square @ square @ square).all() and (power(square, 0) == np.eye(2)).all()
