"""Characteristic polynomials, common divisors and root discs: proven by integers, whatever FLINT answers."""

from fractions import Fraction
from math import gcd

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from control_kpos.exact import polynomials, roots
from control_kpos.exact.linalg import LARGEST_PRIME, WrongAnswerError
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.polynomials import (
    _annihilates,
    _by_traces,
    characteristic_polynomial,
    common_divisor,
    cyclotomic,
    divided,
    moebius,
    multiply,
    scale_roots,
    shift_roots,
    square_free_factors,
    square_free_part,
    totient,
    without_roots_of_unity,
)
from control_kpos.exact.roots import on_imaginary_axis, real_roots_above, root_discs, roots_beyond


def of_roots(*given):
    """The polynomial with these rational roots."""
    p = [1]
    for root in map(Fraction, given):
        p = multiply(p, [root.denominator, -root.numerator])
    return p


def integers(n, seed, largest=9):
    return np.random.default_rng(seed).integers(-largest, largest + 1, (n, n)).astype(object)


def companion(p):
    """An integer matrix with this monic characteristic polynomial."""
    n = len(p) - 1
    M = np.eye(n, k=1, dtype=int).astype(object)
    M[-1] = [-c for c in reversed(p[1:])]
    return M


RATIONAL = st.fractions(min_value=-5, max_value=5, max_denominator=4)


# -- characteristic polynomials


@given(st.lists(st.integers(-9, 9), min_size=1, max_size=8), st.integers(0, 10**6))
def test_a_companion_matrix_in_other_coordinates(tail, seed):
    p = [1, *tail]
    n = len(tail)
    T = np.triu(integers(n, seed, 3), 1) + np.eye(n, dtype=int)
    back = np.eye(n, dtype=int).astype(object)
    for _ in range(n):  # (I - N)^-1 = I + N + N^2 + ..
        back = np.eye(n, dtype=int) + (np.eye(n, dtype=int).astype(object) - T) @ back
    M = T @ companion(p) @ back
    assert _annihilates(p, M) in (True, None) and _by_traces(M) == p
    assert scale_roots(*characteristic_polynomial(Matrix.from_fractions(M))) == p


@pytest.mark.parametrize(
    "M", [np.eye(5), np.zeros((3, 3)), np.diag([2.0, 2, 3]), np.kron(np.eye(3), [[0, 1], [-1, 0]]), np.zeros((0, 0))]
)
def test_matrices_whose_images_of_a_vector_do_not_span_the_space(M):
    expected = [1]
    for block in (np.eye(2), M)[1:]:
        expected = np.rint(np.poly(block)).astype(int).tolist() if len(block) else [1]
    p, factor = characteristic_polynomial(Matrix(M))
    assert scale_roots(p, factor) == expected
    if len(M):
        assert _annihilates(p, M.astype(int).astype(object)) is None


def test_decimals_and_doubles():
    p, factor = characteristic_polynomial(Matrix.from_fractions(np.array([[Fraction(1, 3), 1], [0, Fraction(-1, 2)]])))
    assert scale_roots(p, factor) == of_roots("1/3", "-1/2")
    A = np.random.default_rng(0).normal(size=(40, 40))
    p, factor = characteristic_polynomial(Matrix(A))
    M, f = Matrix(A).as_integers()
    assert len(p) == 41 and factor == f and p[1] == -M.trace()
    assert p[2] * 2 == M.trace() ** 2 - (M @ M).trace()


@given(st.integers(1, 7), st.integers(0, 10**6), st.integers(0, 7))
def test_a_wrong_characteristic_polynomial_does_not_pass(n, seed, place):
    M = integers(n, seed)
    p, _ = characteristic_polynomial(Matrix.from_fractions(M))
    wrong = list(p)
    wrong[place % len(p)] += 1
    assert not _annihilates(wrong, Matrix.from_fractions(M).as_integers()[0])


def test_a_lying_library_is_refused(monkeypatch):
    class Lie:
        def __init__(self, *_):
            pass

        def charpoly(self):
            return self

        def gcd(self, _):
            return self

        def coeffs(self):
            return [1, 2, 1]

    M = np.array([[1, 2], [3, 4]])
    monkeypatch.setattr(polynomials, "fmpz_mat", Lie)
    monkeypatch.setattr(polynomials, "_flint", Lie)
    with pytest.raises(WrongAnswerError):
        characteristic_polynomial(Matrix.from_fractions(M.astype(object)))
    assert common_divisor([1, 3], [1, 4]) == [1]  # proven without the library
    cubes = of_roots(-1, -1, 2), of_roots(-1, -1, -1, 2)
    for a, b in (([1, 0, -1], [1, -1]), (of_roots(1, 1, 1), of_roots(1, 1, 1)), cubes):
        with pytest.raises(WrongAnswerError):
            common_divisor(a, b)


# -- common divisors and changes of the variable


@given(*[st.lists(RATIONAL, max_size=4) for _ in range(3)])
def test_common_divisors_of_products(shared, left, right):
    left = [x for x in left if x not in right]
    g = common_divisor(multiply(of_roots(*shared), of_roots(*left)), multiply(of_roots(*shared), of_roots(*right)))
    assert g == of_roots(*sorted(shared))
    assert common_divisor(multiply([6], of_roots(*shared)), [0]) == g


def test_a_prime_that_divides_leading_coefficients_or_makes_roots_meet():
    p = LARGEST_PRIME
    assert common_divisor([p, 1], [p, 2]) == [1]
    assert common_divisor([1, 1], [1, 1 + p]) == [1]
    assert common_divisor(multiply([1, 1], [p, 3]), multiply([1, 1 + p], [p, 3])) == [p, 3]


def test_exact_division():
    assert divided(of_roots(1, 2, 3), of_roots(2)) == of_roots(1, 3)
    assert divided(of_roots(1, 2, 3), of_roots(4)) is None and divided([1, 1], [1, 1, 1]) is None
    assert divided([2, 1], [3, 1]) is None


@given(st.lists(RATIONAL, min_size=1, max_size=5), RATIONAL)
def test_roots_move(given_roots, by):
    p = of_roots(*given_roots)
    assert shift_roots(p, by) == of_roots(*[x - by for x in given_roots])
    assert scale_roots(p, 1 + abs(by)) == of_roots(*[x * (1 + abs(by)) for x in given_roots])
    radius = Fraction(1, 2) + abs(by)
    images = [(x - radius) / (x + radius) for x in given_roots if x != -radius]
    moved = moebius(p, radius)
    assert moved in (of_roots(*images), [-c for c in of_roots(*images)])


def test_roots_of_unity():
    for k in range(1, 31):
        p = cyclotomic(k)
        assert len(p) - 1 == totient(k) == sum(gcd(j, k) == 1 for j in range(1, k + 1))
        assert divided([1] + [0] * (k - 1) + [-1], p) is not None
        assert all(divided([1] + [0] * (j - 1) + [-1], p) is None for j in range(1, k))
    p = multiply(multiply(cyclotomic(5), cyclotomic(5)), multiply(cyclotomic(12), [5, -6, 5]))
    rest, orders = without_roots_of_unity(p)
    assert rest == [5, -6, 5] and orders == [5, 12]


@given(st.lists(RATIONAL, max_size=5))
def test_square_free_factors_have_the_roots_of_one_multiplicity(given_roots):
    factors = square_free_factors(of_roots(*given_roots))
    for times, factor in enumerate(factors, 1):
        assert factor == of_roots(*sorted(x for x in set(given_roots) if given_roots.count(x) == times))
    assert square_free_part(of_roots(*given_roots)) == of_roots(*sorted(set(given_roots)))


# -- discs


@settings(max_examples=60)
@given(st.lists(RATIONAL, max_size=5, unique=True), st.lists(st.tuples(RATIONAL, RATIONAL), max_size=3, unique=True))
def test_every_root_is_in_a_disc_of_its_own(real, pairs):
    pairs = {(x, abs(y)) for x, y in pairs if y}
    p = of_roots(*real)
    for x, y in pairs:
        size = x * x + y * y
        common = np.lcm.reduce([x.denominator, size.denominator])
        p = multiply(p, [int(common), int(-2 * x * common), int(size * common)])
    places = [(x, Fraction(0)) for x in real] + [(x, s * y) for x, y in pairs for s in (1, -1)]
    for _, discs in zip(range(2), root_discs(p), strict=False):
        assert len(discs) == len(places)
        for disc in discs:
            unit = Fraction(1, 2**disc.places)
            inside = [
                (x, y)
                for x, y in places
                if (x - disc.x * unit) ** 2 + (y - disc.y * unit) ** 2 <= (disc.radius * unit) ** 2
            ]
            assert len(inside) == 1 and disc.is_real == (inside[0][1] == 0)
    for bound in (Fraction(-1, 2), Fraction(0), *real):
        assert real_roots_above(p, bound) == sum(x > bound for x in real)
        assert roots_beyond(p, bound) == sum(x > bound for x, _ in places)
        if bound >= 0:
            assert roots_beyond(p, bound, modulus=True) == sum(x * x + y * y > bound**2 for x, y in places)
    assert on_imaginary_axis(p) == any(x == 0 and y for x, y in places)


def test_roots_that_nearly_meet():
    tiny = Fraction(1, 10**60)
    p = of_roots(1, 1 + tiny, -2)
    assert real_roots_above(p, Fraction(1)) == 1 and real_roots_above(p, 1 + tiny / 2) == 1
    q = multiply([10**120, 0, 10**120 + 0], of_roots(0, tiny))
    assert on_imaginary_axis(q) and real_roots_above(q, Fraction(0)) == 1
    beside = multiply([10**80, -2 * 10**20, 10**80], [1, 1])  # real part 1e-60
    assert not on_imaginary_axis(beside) and roots_beyond(beside, Fraction(0)) == 2


def test_wrong_approximations_prove_nothing(monkeypatch):
    p = of_roots(1, 2, 3)
    true = roots._approximations

    def wrong(change):
        return lambda q, digits: change(*true(q, digits))

    for change in (
        lambda points, places: (points[:-1], places),
        lambda points, places: ([points[0]] * 3, places),
        lambda points, places: ([(0, 0), (1, 0), (2, 0)], places),
        lambda points, places: ([(x + (1 << places), y) for x, y in points], places),
    ):
        roots._isolated.cache_clear()
        monkeypatch.setattr(roots, "_approximations", wrong(change))
        for discs in root_discs(p, 128):  # discs that are disjoint hold the roots nevertheless
            held = [[x for x in (1, 2, 3) if abs(x * 2**d.places - d.x) <= d.radius] for d in discs]
            assert sorted(map(len, held)) == [1, 1, 1]
    roots._isolated.cache_clear()


# -- exact root counts


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 7))
def test_root_counts_agree_with_eigenvalues(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.integers(-9, 10, (n, n)).astype(float)
    bound = float(rng.uniform(0.1, 8)) + 0.01
    values = np.linalg.eigvals(A)
    if np.abs(values.real - bound).min() < 1e-6 or np.abs(np.abs(values) - bound).min() < 1e-6:
        return
    p = scale_roots(*characteristic_polynomial(Matrix(A)))
    if np.abs(np.subtract.outer(values, values) + np.eye(n)).min() > 1e-4:  # different roots are counted
        assert roots_beyond(p, Fraction(bound)) == (values.real > bound).sum()
        assert roots_beyond(p, Fraction(bound), modulus=True) == (np.abs(values) > bound).sum()
    real = np.unique(np.round(values[np.abs(values.imag) < 1e-7].real, 4))
    if np.abs(values.imag)[np.abs(values.imag) > 0].min(initial=1.0) > 1e-4:
        assert real_roots_above(p, Fraction(bound)) == (real > bound).sum()


def test_real_roots_are_counted_at_and_beside_multiple_ones():
    rng = np.random.default_rng(0)
    for _ in range(2000):
        p, roots = [int(rng.integers(1, 5))], set()
        for _ in range(rng.integers(1, 6)):
            times, constant = int(rng.integers(1, 4)), int(rng.integers(-6, 7))
            if rng.random() < 0.6:
                leading = int(rng.integers(1, 4))
                roots.add(Fraction(-constant, leading))
                factor = [leading, constant]
            else:  # not real
                factor = [1, constant, constant**2 // 4 + int(rng.integers(1, 3))]
            for _ in range(times):
                p = multiply(p, factor)
        bounds = [*roots, Fraction(int(rng.integers(-12, 13)), int(rng.integers(1, 4)))]
        bound = bounds[rng.integers(len(bounds))]
        assert real_roots_above(p, bound) == sum(root > bound for root in roots)
