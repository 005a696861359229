"""Exact matrices: integers, fractions and rows with factors of their own."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.exact.intake import exact_matrix
from control_kpos.exact.matrix import Matrix, integers_of_doubles
from control_kpos.exact.signs import (
    BilinearForms,
)

doubles = st.one_of(
    st.integers(-3, 3).map(float),
    st.floats(-1e3, 1e3, allow_nan=False),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([0.1, -0.1, 0.3, 1e-320, -1e-320, 1e150, -1e150, 1e-150, 2.0**-1074]),
)


def test_sums_of_forms_through_stacked_matrices():
    # v'A x + v'x / 3 for v = (3, 1), A = diag(-1, -1), x = (1, 1): -4 + 4/3 < 0; with rate 1 it vanishes
    v, A = exact_matrix([[3, 1]], "v"), exact_matrix([[-1, 0], [0, -1]], "A")
    x = exact_matrix([[1, 1]], "x")
    for rate, sign in (("1/3", -1), ("1", 0), ("4/3", 1)):
        shift = exact_matrix([[rate, 0], [0, rate]], "shift")
        forms = BilinearForms(Matrix.join([v, v], -1), Matrix.join([A, shift], -2), x)
        assert forms.signs().tolist() == [[sign]]


@pytest.mark.parametrize("axis", [-1, -2])
def test_matrices_side_by_side_keep_their_exact_entries(axis):
    parts = [exact_matrix(rows, "part") for rows in ([["1/3", "0.1"], [2, 1e-30]], [[0.1, -5e-324], [3, 2**70]])]
    joined = Matrix.join(parts, axis)
    expected = np.concatenate([part.fractions() for part in parts], axis=axis)
    assert (joined.fractions() == expected).all()
    far = np.array([abs(a - Fraction(b)) for a, b in zip(expected.ravel(), joined.values.ravel(), strict=True)])
    assert (far <= [Fraction(r) for r in joined.radius.ravel()]).all()


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(-(2**1200), 2**1200), max_size=6), st.one_of(st.just(1), st.integers(1, 2**300)))
def test_integers_over_a_denominator_are_what_their_fractions_are(integers, denominator):
    denominator <<= 200
    made = Matrix.over(np.array(integers, dtype=object), denominator)
    fractions = [Fraction(x, denominator) for x in integers]
    expected = Matrix.from_fractions(np.array(fractions, dtype=object))
    assert made.fractions().tolist() == fractions and made.is_double == expected.is_double
    np.testing.assert_array_equal(made.values, expected.values)
    if not made.is_double:
        np.testing.assert_array_equal(made.radius, expected.radius)


@pytest.mark.parametrize(("value", "bits"), [(2**1100, 0), (3, 1074), (1, 1074), (1, 1200), (2**53 + 1, 0)])
def test_numbers_at_the_ends_of_doubles_over_a_denominator(value, bits):
    integers = np.array([value], dtype=object)
    if value == 2**1100:
        with pytest.raises(kp.DataError, match="does not fit into a double"):
            Matrix.over(integers, 1)
        return
    made, exact = Matrix.over(integers, 2**bits), Fraction(value, 2**bits)
    assert made.fractions().tolist() == [exact] and made.is_double == (Fraction(made.values[0]) == exact)
    assert made.is_double or abs(Fraction(made.values[0]) - exact) <= Fraction(made.radius[0])


@pytest.mark.parametrize("value", [0.1, -1e-310, 1e300, 0.0, -7.0])
def test_integers_of_doubles_are_exact(value):
    ints, exponent = integers_of_doubles(np.array([value, 0.75]))
    assert [Fraction(int(i)) * Fraction(2) ** int(exponent.item()) for i in ints] == [Fraction(value), Fraction(3, 4)]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.integers(-(2**70), 2**70), min_size=1, max_size=4), st.integers(0, 1100), st.integers(0, 1100))
def test_quotients_by_powers_of_two_are_those_of_fractions(numbers, longer, bits):
    integers = np.array([k << longer for k in numbers], dtype=object)
    try:
        expected = [k / 2**bits for k in integers.tolist()]
    except OverflowError:
        return
    made = Matrix.over(integers, 2**bits)
    assert made.values.tolist() == expected
    assert made.fractions().tolist() == [Fraction(k, 2**bits) for k in integers.tolist()]
    assert made.is_double is all(Fraction(a) == Fraction(k, 2**bits) for a, k in zip(expected, integers, strict=True))


@pytest.mark.parametrize("form", ["csr", "csc", "coo"])
def test_sparse_data_are_read_with_short_indices_and_left_alone(form):
    data = sp.random_array((30, 20), density=0.2, rng=np.random.default_rng(0)).asformat(form)
    if form == "coo":
        data.coords = tuple(index.astype(np.int64) for index in data.coords)
    else:
        data.indices, data.indptr = data.indices.astype(np.int64), data.indptr.astype(np.int64)
    before = data.toarray()
    read = exact_matrix(data, "M").values
    assert read.indices.dtype == read.indptr.dtype == np.int32
    read.data[:] = 7.0
    np.testing.assert_array_equal(data.toarray(), before)
    assert (read.indices.nbytes, data.shape) == (4 * data.nnz, (30, 20))
