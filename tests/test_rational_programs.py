"""Farkas' lemma in rational numbers: exactly one answer, and each is checked."""

from fractions import Fraction

import numpy as np
import pytest

from control_kpos.errors import ShapeError, TooLargeError
from control_kpos.exact import rational_programs
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.programs import Solution
from control_kpos.exact.rational_programs import (
    exact_feasibility,
    is_farkas,
    is_solution,
)


def system(seed):
    """Small integers make many degenerate and boundary cases; every other one is feasible by construction."""
    rng = np.random.default_rng(seed)
    m, n = rng.integers(1, 8), rng.integers(1, 12)
    M = rng.integers(-3, 4, size=(m, n))
    return M, M @ rng.integers(0, 3, size=n) if seed % 2 else rng.integers(-3, 4, size=m)


@pytest.mark.parametrize("seed", range(200))
def test_exactly_one_of_the_two_systems_is_solved(seed):
    M, b = system(seed)
    x, y = exact_feasibility(M, b)
    assert (x is None) != (y is None)
    if x is not None:
        assert (x >= 0).all() and (M.astype(object) @ x == b).all()
        assert np.count_nonzero(x) <= len(M)
    else:
        assert (y @ M.astype(object) >= 0).all() and y @ b.astype(object) < 0
    assert x is not None or seed % 2 == 0


WRONG = {
    "nothing": lambda m, n: Solution("failed", np.empty(0)),
    "infeasible": lambda m, n: Solution("infeasible", np.empty(0)),
    "first columns": lambda m, n: Solution("optimal", np.zeros(n), 0.0, np.arange(m)),
    "repeated": lambda m, n: Solution("optimal", np.zeros(n), 0.0, np.zeros(m, dtype=int)),
    "random": lambda m, n: Solution("optimal", np.zeros(n), 0.0, np.random.default_rng(m).permutation(n)[:m]),
    "too short": lambda m, n: Solution("optimal", np.zeros(n), 0.0, np.arange(max(m - 1, 0))),
}


@pytest.mark.parametrize("lie", WRONG)
@pytest.mark.parametrize("seed", range(30))
def test_a_lying_solver_changes_no_answer(seed, lie, monkeypatch):
    M, b = system(seed)
    truth = exact_feasibility(M, b)[0] is not None
    monkeypatch.setattr(rational_programs, "solve", lambda c, A_eq, b_eq, **_: WRONG[lie](len(b_eq), len(c)))
    x, y = exact_feasibility(M, b)
    assert (x is not None) == truth
    assert is_solution(M, b, x) if truth else is_farkas(M, b, y)


def test_a_system_feasible_only_exactly():
    third = Fraction(1, 3)
    x, _ = exact_feasibility([["1/3", 1]], [third])
    assert is_solution([["1/3", 1]], [third], x)
    tiny = Fraction(1, 10**40)
    assert exact_feasibility([[1, -1], [1, -1]], [0, tiny])[1] is not None
    assert exact_feasibility([[1, -1], [1, -1]], [tiny, tiny])[0] is not None


def test_scales_do_not_matter():
    M, b = np.array([[1.0, -2.0], [3.0, 1.0]]), np.array([-1.0, 4.0])
    for scale in (1e-200, 1.0, 1e200):
        x, y = exact_feasibility(M * scale, b)
        assert y is None and is_solution(M * scale, b, x)


def test_wrong_witnesses_are_refused():
    M, b = [[1, 1], [0, 1]], [2, 1]
    assert is_solution(M, b, [1, 1])
    assert not is_solution(M, b, [2, 0]) and not is_solution(M, b, [1]) and not is_solution(M, b, [3, -1])
    assert is_farkas([[1]], [-1], [1])
    assert not is_farkas([[1]], [-1], [-1]) and not is_farkas([[1]], [0], [1]) and not is_farkas([[1]], [-1], [1, 0])


def test_refusals():
    with pytest.raises(ShapeError, match="2 rows, but b has 1"):
        exact_feasibility([[1], [2]], [1])
    with pytest.raises(TooLargeError):
        exact_feasibility(np.random.default_rng(0).normal(size=(300, 300)), np.ones(300), work_limit=10**9)


def test_systems_of_doubles_with_85_rows_are_decided():
    rng = np.random.default_rng(0)
    M, x = rng.normal(size=(85, 120)), rng.integers(0, 3, 120)
    b = (Matrix(M).fractions() @ x).tolist()
    found, _ = exact_feasibility(M, b)
    assert is_solution(M, b, found)
    _, farkas = exact_feasibility(np.abs(M), -np.abs(M) @ x)
    assert is_farkas(np.abs(M), -np.abs(M) @ x, farkas)


def test_common_denominators_longer_than_a_double():
    """Fractions whose common denominator exceeds 1e308."""
    primes = [10**30 + k for k in (57, 99, 147, 1, 3, 7, 9, 11, 13, 17, 19, 21)]
    M = [[Fraction(1, p) for p in primes], [1] * len(primes)]
    x, y = exact_feasibility(M, [0, 1])
    assert x is None and is_farkas(M, [0, 1], y)
