"""The rounding lemma, and every bound that follows from it, against rational arithmetic."""

from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest
import scipy.sparse as sp

from control_kpos.cones.normals import Hyperplanes
from control_kpos.cones.simplicial import simplicial_facets
from control_kpos.exact.enclosure import enclosed_product, enclosed_sparse_product
from control_kpos.exact.matrix import Matrix, granularity, integers_of_doubles
from control_kpos.exact.rounding import (
    HALF_ULP,
    SMALLEST_NORMAL,
    error_factor,
    rounding_radius,
    sum_factor,
    underflow,
)
from control_kpos.exact.rows import _rounded_image
from control_kpos.exact.signs import UNKNOWN, BilinearForms

# Binary exponents of the data: ordinary numbers, mixed units, subnormal numbers, and the whole range of doubles.
RANGES = [(-2, 2), (-60, 60), (-1074, -1000), (-1074, 300), (-500, 500)]


def fractions(values):
    return np.array([Fraction(float(x)) for x in np.asarray(values).ravel()], dtype=object).reshape(np.shape(values))


def adversarial(rng, shape, low, high):
    """Doubles of all exponents between low and high, some of them zero, some with full mantissas."""
    mantissa = rng.integers(2**52, 2**53, shape) / 2.0**52
    few = rng.random(shape) < 0.3
    mantissa = np.where(few, np.round(mantissa * 4) / 4, mantissa)
    size = np.ldexp(mantissa, rng.integers(low, high, shape))
    return np.where(rng.random(shape) < 0.1, 0.0, size * rng.choice([-1.0, 1.0], shape))


def cancelling(rng, left, right):
    """Rows of `right` changed so that their products with the first row of `left` nearly cancel."""
    out = right.copy()
    with np.errstate(all="ignore"):
        for row in out:
            last = -(left[0, :-1] @ row[:-1]) / left[0, -1]
            if np.isfinite(last):
                row[-1] = last
    return out


@pytest.mark.parametrize("terms", [0, 1, 2, 7, 10**6, 2**40, 2**50])
def test_the_factor_is_twice_the_classical_one(terms):
    u = Fraction(1, 2**53)
    gamma = terms * u / (1 - terms * u)
    assert u == HALF_ULP
    assert Fraction(error_factor(terms)) >= 2 * gamma + 15 * u
    assert Fraction(sum_factor(terms)) * (1 - gamma) > 1 + max(Fraction(1, 2**30), gamma / 4)


def test_the_lemma_claims_nothing_for_sums_that_are_too_long():
    assert error_factor(2**51) == sum_factor(2**51) == np.inf


@pytest.mark.parametrize(("low", "high"), RANGES)
def test_sums_in_every_order_stay_within_the_bound(low, high):
    rng = np.random.default_rng(high - low)
    for _ in range(20):
        x, y = adversarial(rng, (2, 5), low, high)
        y = cancelling(rng, x[None], y[None])[0]
        exact = sum(fractions(x) * fractions(y))
        with np.errstate(all="ignore"):
            terms = x * y
            size = float(np.abs(x) @ np.abs(y))
        if not np.isfinite(size):
            continue
        bound = error_factor(5) * size + underflow(5)
        for order in permutations(range(5)):
            total = 0.0
            for i in order:
                total += float(terms[i])
            assert abs(Fraction(total) - exact) <= Fraction(bound)


def within(value, bound, exact):
    """Whether finite values are as close to the exact ones as their finite bounds say."""
    good = np.isfinite(value) & np.isfinite(bound)
    assert good.any()
    apart = np.abs(fractions(np.where(good, value, 0.0)) - exact)
    return (~good | (apart <= fractions(np.where(good, bound, 0.0)))).all()


@pytest.mark.parametrize(("low", "high"), RANGES)
@pytest.mark.parametrize("width", [1, 3, 70, 200])
def test_dense_and_sparse_products_are_enclosed(width, low, high):
    rng = np.random.default_rng(width)
    left = adversarial(rng, (3, width), low, high)
    right = cancelling(rng, left, adversarial(rng, (4, width), low, high))
    exact = fractions(left) @ fractions(right).T
    value, bound = enclosed_product(Matrix(left), Matrix(right))
    assert within(value, bound, exact)
    finite = np.where(np.isfinite(right), right, 0.0)
    value, bound = enclosed_sparse_product(Matrix(finite), sp.csr_array(left.T))
    assert within(value, bound, fractions(finite) @ fractions(left.T))


@pytest.mark.parametrize(("low", "high"), RANGES)
def test_products_of_rounded_factors_are_enclosed(low, high):
    rng = np.random.default_rng(3)
    left, right = adversarial(rng, (3, 9), low, high), adversarial(rng, (4, 9), low, high)
    radii = [np.abs(M) * rng.choice([0.0, 2.0**-40, 0.25, 3.0], M.shape) + 2.0**-1074 for M in (left, right)]
    signs = [rng.choice([-1, 1], M.shape) for M in (left, right)]
    moved = [fractions(M) + fractions(r) * s for M, r, s in zip((left, right), radii, signs, strict=True)]
    value, bound = enclosed_product(Matrix(left, radii[0]), Matrix(right, radii[1]))
    assert within(value, bound, moved[0] @ moved[1].T)
    image = _rounded_image(Matrix(left, radii[0]), Matrix(right, radii[1])) if high < 300 else None
    if image is not None:
        assert within(image.values, image.radius, moved[0] @ moved[1].T)


def test_images_of_subnormal_numbers_keep_their_error():
    """A bound that multiplies the factor with the small operand first would underflow to nothing."""
    left = np.array([[2.0**1000, 2.0**1000]])
    T = np.array([[2.0**-1028 + 2.0**-1074, 2.0**-1050 / 3]])
    image = _rounded_image(Matrix(left), Matrix(T))
    assert within(image.values, image.radius, fractions(left) @ fractions(T).T)
    assert image.radius[0, 0] >= 2.0**-52 * abs(image.values[0, 0])


@pytest.mark.parametrize(("low", "high"), RANGES)
@pytest.mark.parametrize("middle", [False, True])
@pytest.mark.parametrize("rounded", [False, True])
def test_bounds_of_bilinear_forms_hold(low, high, middle, rounded):
    rng = np.random.default_rng(abs(low))
    for _ in range(10):
        n, m = rng.integers(1, 6, 2)
        left = adversarial(rng, (3, n), low, high)
        M = adversarial(rng, (n, m), low, high) if middle else np.eye(n)
        with np.errstate(all="ignore"):
            right = cancelling(rng, left @ M, adversarial(rng, (4, M.shape[1]), low, high))
        arrays = [left, M, right] if middle else [left, right]
        exact, operands = [], []
        for array in arrays:
            radius = np.abs(array) * 2.0**-30 + 2.0**-1074 if rounded else None
            sign = rng.choice([-1, 1], array.shape)
            exact.append(fractions(array) + (0 if radius is None else fractions(radius) * sign))
            operands.append(Matrix(array, radius))
        z = exact[0] @ exact[1] @ exact[2].T if middle else exact[0] @ exact[1].T
        forms = BilinearForms(operands[0], operands[1] if middle else None, operands[-1])
        for bound in (forms._norm_bound(), forms._entry_bound()):
            value, size = np.asarray(forms.values), np.broadcast_to(bound, z.shape)
            good = np.isfinite(value) & np.isfinite(size)
            apart = np.abs(fractions(np.where(good, value, 0.0)) - z)
            assert (~good | (apart <= fractions(np.where(good, size, 0.0)))).all()
        if not rounded:
            signs = forms.signs()
            assert ((signs == UNKNOWN) | (signs == np.sign(z))).all()
            assert (signs != UNKNOWN).all()


@pytest.mark.parametrize("n", [3, 8, 30])
@pytest.mark.parametrize("spread", [0, 20])
def test_rows_of_an_inverse_are_as_close_as_their_radius_says(n, spread):
    rng = np.random.default_rng(n)
    R = rng.standard_normal((n, n)) + n * np.eye(n)
    R = np.ldexp(R, rng.integers(-spread, spread + 1, n)[:, None] + rng.integers(-spread, spread + 1, n))
    facets = simplicial_facets(Matrix(R))
    integers = facets.rows_as_integers(np.arange(n))
    assert facets.radius.max() < 1e-10
    for k in range(n):
        top = int(np.abs(facets.values[k]).argmax())
        # rows are known up to a factor: one within the radius of the largest entry must fit all others
        low, high = (Fraction(facets.values[k, top]) + s * Fraction(facets.radius[k, top]) for s in (-1, 1))
        for j in range(n):
            ends = [Fraction(int(integers[k, j]), int(integers[k, top])) * x for x in (low, high)]
            value, radius = Fraction(facets.values[k, j]), Fraction(facets.radius[k, j])
            assert min(ends) - radius <= value <= max(ends) + radius


@pytest.mark.parametrize("n", [2, 4, 7])
@pytest.mark.parametrize("thin", [0, 20, 45])
def test_heights_above_a_hyperplane_are_as_close_as_they_say(n, thin):
    rng = np.random.default_rng(n + thin)
    G = rng.integers(-(2**20), 2**20, (n + 6, n)).astype(object)
    G[:, -1] = G[:, -1] * 2**thin + 2 ** (thin + 22)
    eye = np.eye(n, dtype=int).astype(object)
    planes = Hyperplanes(G, eye, G.sum(axis=0))
    vertices = np.array([rng.choice(n + 6, n - 1, replace=False) for _ in range(12)])
    h, error = planes.approximate(vertices)
    exact = planes.exact(vertices)
    for row, bound, normal in zip(h, error, exact, strict=True):
        if not np.isfinite(bound):
            continue
        length = [max(int(x).bit_length() for x in point) for point in [*G, planes.center]]
        unit = Fraction(1, int(normal @ planes.center)) * 2 ** length[-1]
        for z, point, bits in zip(planes.Z, G, length, strict=False):
            assert abs(Fraction(float(row @ z)) - unit * int(normal @ point) / 2**bits) <= Fraction(bound)


def test_powers_of_two_are_read_off_the_bits():
    powers = np.ldexp(1.0, np.arange(-1074, 1024))
    assert granularity(*(np.array([x]) for x in powers)) == list(range(-1074, 1024))
    assert granularity(np.array([0.0, 3 * 2.0**-1074, 1e300]), np.zeros(2)) == [-1074, 0]
    for x in (0.1, 2.0**-1074, 1.7976931348623157e308, -(2.0**-1022), 3.0, 0.0):
        ints, exponent = integers_of_doubles(np.array([x, 1.0]))
        assert int(ints[0]) * Fraction(2) ** int(exponent[0]) == Fraction(x)


def test_correctly_rounded_doubles_are_within_their_radius():
    rng = np.random.default_rng(0)
    for _ in range(200):
        x = Fraction(int(rng.integers(1, 2**62)), int(rng.integers(1, 2**62))) * Fraction(2) ** int(
            rng.integers(-1090, 900)
        )
        value = x.numerator / x.denominator
        assert abs(Fraction(value) - x) <= Fraction(rounding_radius(np.array([value]))[0])
    assert np.finfo(float).tiny == SMALLEST_NORMAL
