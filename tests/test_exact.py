"""The trusted kernel against rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from control_kpos.exact import signs as kernel
from control_kpos.exact import sizes as operand_sizes
from control_kpos.exact.intake import exact_matrix
from control_kpos.exact.matrix import Matrix, integers_of_doubles
from control_kpos.exact.signs import (
    UNKNOWN,
    BilinearForms,
    _decide,
)
from control_kpos.exact.sizes import row_norms

doubles = st.one_of(
    st.integers(-3, 3).map(float),
    st.floats(-1e3, 1e3, allow_nan=False),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([0.1, -0.1, 0.3, 1e-320, -1e-320, 1e150, -1e150, 1e-150, 2.0**-1074]),
)


def matrices(rows, columns):
    return st.lists(st.lists(doubles, min_size=columns, max_size=columns), min_size=rows, max_size=rows).map(
        lambda m: np.array(m, dtype=float).reshape(rows, columns)
    )


def truth(L, M, R):
    L, M, R = ([[Fraction(x) for x in row] for row in np.atleast_2d(m).tolist()] for m in (L, M, R))
    sign = lambda z: (z > 0) - (z < 0)  # noqa: E731
    return np.array(
        [[sign(sum(a * M[i][j] * b for i, a in enumerate(l) for j, b in enumerate(r))) for r in R] for l in L]
    )


@st.composite
def problems(draw):
    k, a, b, p = (draw(st.integers(1, 4)) for _ in range(4))
    return draw(matrices(k, a)), draw(matrices(a, b)), draw(matrices(p, b))


@given(problems())
@settings(max_examples=400)
def test_signs_are_those_of_the_exact_numbers(problem):
    L, M, R = problem
    expected = truth(L, M, R)
    forms = BilinearForms(*map(Matrix, (L, M, R)))
    np.testing.assert_array_equal(forms.signs(), expected)

    thin = BilinearForms(*(Matrix(sp.csr_array(m)) for m in (L, M, R)))
    np.testing.assert_array_equal(thin.signs().toarray(), expected)

    row = BilinearForms(Matrix(L[:1]), Matrix(sp.csr_array(M)), Matrix(sp.csr_array(R)))
    np.testing.assert_array_equal(row.signs(), expected[:1])


@given(st.lists(problems(), min_size=1, max_size=1), st.integers(1, 3), st.randoms())
def test_stacks_agree_with_single_problems(problem, size, random):
    L, M, R = problem[0]
    scale = np.array([random.choice([1.0, -3.0, 0.1, 2.0**-70]) for _ in range(size)])
    with np.errstate(over="ignore"):
        stack = scale[:, None, None] * M
    if not np.isfinite(stack).all():
        return
    expected = np.array([truth(L, m, R) for m in stack])
    np.testing.assert_array_equal(BilinearForms(Matrix(L), Matrix(stack), Matrix(R)).signs(), expected)
    rights = np.broadcast_to(R, (size, *R.shape)).copy()
    for right in (rights, rights[:1]):
        forms = BilinearForms(Matrix(L), Matrix(stack), Matrix(right))
        np.testing.assert_array_equal(forms.signs(), expected)
    lefts = np.broadcast_to(L, (size, *L.shape)).copy()
    np.testing.assert_array_equal(BilinearForms(Matrix(lefts), Matrix(stack), Matrix(R)).signs(), expected)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("row", "middle", "right"),
    [
        ([1.8e158], [[1e150, -1.0]], [4.6e-206, 1.0]),  # l'M overflows, z does not
        ([1.0], [[1e300, 1e300]], [-1e9, 0.9e9]),  # z overflows
        ([1.0, 1.0], [[1.7e308, -1.0], [1.7e308, 0.0]], [0.0, 1.0]),  # l'M overflows where it does not matter
        ([1.0], [[1.7e308, 1.7e308, -1.7e308, -1.75e308]], [1.0, 1.0, 1.0, 1.0]),  # a partial sum overflows
        ([1.0, 1.0, 1.0, 1.0], [[1.7e308], [1.7e308], [-1.7e308], [-1.75e308]], [1.0]),
    ],
)
def test_overflow_decides_nothing(row, middle, right, sign):
    L, M, R = sign * np.array([row]), np.array(middle), np.array([right])
    expected = truth(L, M, R)
    assert expected[0, 0] == -sign
    for wrap in (Matrix, lambda m: Matrix(sp.csr_array(m))):
        signs = BilinearForms(*map(wrap, (L, M, R))).signs()
        np.testing.assert_array_equal(signs.toarray() if sp.issparse(signs) else signs, expected)
    stack = BilinearForms(Matrix(L[None]), Matrix(np.array([M, M])), Matrix(R)).signs()
    np.testing.assert_array_equal(stack[:, 0, 0], [-sign, -sign])
    if row == [1.0]:
        alone = BilinearForms(Matrix(sign * M), None, Matrix(R))
        np.testing.assert_array_equal(alone.signs(), expected)


def test_cancellation_below_rounding_is_seen():
    # 0.1 + 0.2 - 0.3 is not zero for the doubles, and is zero for the decimals
    row, ones = [["0.1", "0.2", "-0.3"]], [[1, 1, 1]]
    decimals = BilinearForms(exact_matrix(row, "row"), None, exact_matrix(ones, "ones"))
    assert decimals.signs().tolist() == [[0]]
    assert BilinearForms(exact_matrix([[0.1, 0.2, -0.3]], "row"), None, exact_matrix(ones, "ones")).signs() == [[1]]


def test_radius_of_inexact_rows_is_respected():
    # the doubles say +1e-17, the radius says the true value may be negative, the integers say zero
    class Zero:
        def __call__(self, index):
            return np.zeros((len(index), 2), dtype=object)

    left = Matrix(np.array([[1e-17, 0.0]]), np.array([[1e-16, 0.0]]), integer_rows=Zero())
    assert BilinearForms(left, None, Matrix(np.eye(2)[:1])).signs().tolist() == [[0]]


def test_entries_that_do_not_matter_are_not_computed_exactly():
    forms = BilinearForms(Matrix(np.array([[0.1, -0.1]])), None, Matrix(np.array([[0.3, 0.3]])))
    assert forms.signs(where=np.array([[False]])).tolist() == [[UNKNOWN]]
    assert forms.signs().tolist() == [[0]]


def test_radius_of_sparse_rows_is_respected():
    class Exact:
        def __call__(self, index):
            rows = np.zeros((2, 80), dtype=object)
            rows[0, 0], rows[1, 79] = -1, 5
            return rows[index]

    values = np.zeros((2, 80))
    values[0, 0], values[1, 79] = 1e-17, 1.0  # the first sign is an artefact of rounding
    radius = sp.csr_array(np.where(values != 0, 1e-16, 0.0))
    left = Matrix(sp.csr_array(values), radius, integer_rows=Exact())
    for middle in (None, Matrix(sp.eye_array(80, format="csr")), Matrix(np.eye(80))):
        signs = BilinearForms(left, middle, Matrix(sp.eye_array(80, format="csr"))).signs()
        signs = signs.toarray() if sp.issparse(signs) else signs
        assert signs[0, 0] == -1 and signs[1, 79] == 1 and np.count_nonzero(signs) == 2


@pytest.mark.parametrize(("a", "b"), [("2/3", "1/7"), ("1/10", "1/5"), ("1/9", "1/5")])
@pytest.mark.parametrize("shift", [-1, 0, 1])
def test_fractions_between_sparse_rows_are_not_rounded(a, b, shift):
    # every column adds up to shift times 10^-30, which rounding hides
    n, entries = 80, [Fraction(a), Fraction(b), -Fraction(a) - Fraction(b) + shift * Fraction(1, 10**30)]
    M = np.full((n, n), Fraction(0), dtype=object)
    for k, value in enumerate(entries):
        M[(np.arange(n) + k) % n, np.arange(n)] = value
    ones, eye = np.ones((1, n)), sp.eye_array(n, format="csr")
    for left, middle, right in ((ones, M, eye), (eye, M.T, ones), (sp.csr_array(ones), M, eye)):
        signs = BilinearForms(Matrix(left), Matrix.from_fractions(middle), Matrix(right)).signs()
        assert (signs == shift).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_sparse_forms_have_the_signs_of_dense_ones(seed):
    rng = np.random.default_rng(seed)
    k, a, b, p = (int(size) for size in rng.integers(1, 100, 4))

    def rounded(rows, columns):
        kept = rng.random((rows, columns)) < rng.choice([0.02, 0.2])
        return rng.integers(-2, 3, (rows, columns)) * rng.choice([1.0, 0.1, 0.3, 1e10], (rows, columns)) * kept

    data = [rounded(k, a), rounded(a, b), rounded(p, b)]
    integers = [integers_of_doubles(rows)[0] for rows in data]
    expected = np.sign(integers[0] @ integers[1] @ integers[2].T)
    for sparse in np.ndindex(2, 2, 2):
        left, middle, right = (Matrix(sp.csr_array(m) if s else m) for m, s in zip(data, sparse, strict=True))
        signs = BilinearForms(left, middle, right).signs()
        signs = signs.toarray() if sp.issparse(signs) else signs
        assert (signs == expected).all()


def test_relative_sizes_are_free_of_scales_and_zero_for_zero():
    left = Matrix(np.array([[2.0, 0.0], [0.0, 0.0], [-1.0, 1.0]]))
    right = Matrix(np.array([[3.0, 0.0], [1.0, 1.0]]))
    expected = [[1.0, 1.0], [0.0, 0.0], [-1.0, 0.0]]
    assert BilinearForms(left, None, right).relative().tolist() == expected


def test_data_that_are_not_finite_are_never_decided():
    for value in (np.nan, np.inf):
        forms = BilinearForms(Matrix(np.array([[value, 1.0]])), None, Matrix(np.array([[1.0, 1.0], [0.0, 0.0]])))
        assert forms.signs()[0, 0] == UNKNOWN


def rounded_far(sign, scale):
    """A 2 x 2 matrix, sign * scale in its corner, of which the doubles know little; exactly known through integers."""
    value = np.array([[scale, 0.0], [0.0, 0.0]])
    if sign > 0:
        return Matrix(value)
    ints = np.array([[int(sign * scale * 2**20), 0], [0, 0]], dtype=object)
    return Matrix(value, np.abs(value) * 2.5, ints, 2**20)


@pytest.mark.parametrize(
    "signs", [(-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, -1)]
)
def test_radii_of_every_operand_count_at_every_scale(signs):
    for scales in np.ndindex(3, 3, 3):
        operands = [rounded_far(sign, 2.0 ** (20 * (k - 1))) for sign, k in zip(signs, scales, strict=True)]
        assert BilinearForms(*operands).signs()[0, 0] == np.prod(signs)
        if signs[1] > 0:
            assert BilinearForms(operands[0], None, operands[2]).signs()[0, 0] == signs[0] * signs[2]


# -- the bounds are those that are stated, neither smaller nor much larger


def rational(m):
    return np.vectorize(Fraction, otypes=[object])(np.asarray(m, dtype=float))


def relative_error(inner, outer):
    """K u / (1 - K u) for K = 2 (inner + outer) + 16 roundings."""
    count = Fraction(2 * (inner + outer) + 16, 2**53)
    return count / (1 - count)


def within(found, stated, factor):
    found = rational(found)
    assert (found >= stated * (1 - Fraction(1, 10**9))).all() and (found <= factor * stated).all()


TINY = Fraction(2) ** -1022


@pytest.mark.parametrize(
    ("shapes", "room"),  # norms of long rows are sharp
    [
        ([(2, 3), (3, 4), (5, 4)], 15),
        ([(2, 3), None, (5, 3)], 5),
        ([(1, 20), (20, 30), (2, 30)], 1 + 1e-7),
        ([(2, 20), None, (3, 20)], 1 + 1e-7),
    ],
)
@pytest.mark.parametrize("known", ["exact", "left", "middle", "right", "none"])
@pytest.mark.parametrize(
    "powers", [(0, 0, 0), (0, 300, 300), (-350, -700, -700), (-500, -600, 400), (-500, -600, -100)]
)
def test_the_bounds_are_the_stated_ones(shapes, room, known, powers):
    rng, with_middle = np.random.default_rng(len(known)), shapes[1] is not None
    values = [rng.normal(size=n) * 2.0**power for n, power in zip(shapes, powers, strict=True) if n]
    shapes = [shape for shape in shapes if shape]
    loose = [name in ("none", known) for name in ("left", "middle", "right")] if known != "none" else [True] * 3
    loose = loose if with_middle else [loose[0], loose[2]]
    radii = [abs(v) * 1e-9 * rng.random(v.shape) if free else None for v, free in zip(values, loose, strict=True)]
    forms = BilinearForms(*operands(values, radii, with_middle))
    inner, outer = (shapes[1][0], shapes[1][1]) if with_middle else (0, shapes[0][1])
    sizes = [abs(rational(v)) for v in values]
    errors = [rational(v * 0 if d is None else d) for v, d in zip(values, radii, strict=True)]
    reach = [size + error for size, error in zip(sizes, errors, strict=True)]
    error = sum(chain([*reach[:k], errors[k], *sizes[k + 1 :]]) for k in range(len(sizes)))
    stated = relative_error(inner, outer) * chain(sizes) + error * Fraction(101, 100)
    stated = stated + 4 * TINY * ((inner + 1) * sizes[-1].sum(axis=1)[None, :] + outer + 1)
    within(forms._entry_bound(), stated, 1 + Fraction(1, 10**9))

    left, right, dl, dr = (lengths(part) for part in (sizes[0], sizes[-1], errors[0], errors[-1]))
    nm, dm = (lengths(part.reshape(1, -1))[0] for part in (sizes[1], errors[1])) if with_middle else (1, 0)
    stated = relative_error(inner, outer) * nm * np.outer(left, right)
    stated = stated + 4 * TINY * ((inner + 1) * Fraction(np.sqrt(outer)) * right[None, :] + outer + 1)
    radius = np.outer(dl, right) * nm + np.outer(left + dl, right) * dm + np.outer(left + dl, dr) * (nm + dm)
    within(forms._norm_bound(), stated + Fraction(101, 100) * radius, Fraction(room))


@pytest.mark.parametrize("count", [1, 4, 16, 17, 25, 36])
@pytest.mark.parametrize("size", [2.0**-1074, 2.0**-1022, 1.0, 2.0**1000])
def test_norms_are_not_too_small_and_hardly_too_large(count, size):
    tiny, margin = Fraction(2) ** -1022, 1 + Fraction(1, 10**8)
    rows = np.vstack([np.full(count, size), np.zeros(count), np.append(size, np.zeros(count - 1))])
    exact = [Fraction(size) * Fraction(np.sqrt(count)), Fraction(0), Fraction(size)]  # roots of squares, mostly
    for m in (Matrix(rows), Matrix(sp.csr_array(rows))):
        found, radius = row_norms(m)
        spread = 1 if m.is_sparse or count > 16 else Fraction(np.sqrt(count))
        assert not np.any(radius)
        for value, norm in zip(found.tolist(), exact, strict=True):
            assert (
                norm * (1 + Fraction(1, 2 * 10**9)) + tiny / 2 <= Fraction(value) <= norm * margin * spread + 2 * tiny
            )
    empty = row_norms(Matrix(sp.csr_array((2, count))))[0]
    assert empty.shape == (2,) and (empty > 0).all() and (empty < 1e-300).all()


def lengths(rows):
    """Euclidean norms of rational rows, to double precision at any scale."""
    top = rows.max(axis=1)
    return np.array(
        [
            t * Fraction(float(np.linalg.norm((row / t).astype(float)))) if t else t
            for t, row in zip(top, rows, strict=True)
        ],
        dtype=object,
    )


def operands(values, radii, with_middle):
    out = [Matrix(v, d, np.zeros(v.shape, dtype=object)) for v, d in zip(values, radii, strict=True)]
    return out if with_middle else (out[0], None, out[1])


def chain(parts):
    """|l|'|M||r| for all rows."""
    *head, right = parts
    return (head[0] @ head[1] if len(head) == 2 else head[0]) @ right.T


def test_bounds_are_infinite_where_roundings_are_too_many():
    for length, expected in ((2**50 - 8, 1 / 3), (2**51 - 9, 1.0), (2**51 - 8, np.inf), (2**52, np.inf)):
        forms = BilinearForms(Matrix(np.ones((1, 1))), None, Matrix(np.ones((1, 1))))
        vars(forms)["_lengths"] = (0, length)
        assert forms._constants[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("powers", "limit"),
    [
        ((0, 0, 0), 2.0**52),
        ((-3, -5, 2), 2.0**46),
        ((-500, -500, 0), 2.0**-948),
        ((-500, -501, 0), -1),
        ((-600, -600, 400), -1),  # l'M is too fine although z is not
        ((-200, -200, -600), 2.0**-948),
        ((-200, -200, -601), -1),
        ((400, 400, 100), np.ldexp(1.0, 952)),
        ((400, 400, 101), -1),
    ],
)
def test_products_are_exact_up_to_a_limit(powers, limit):
    forms = BilinearForms(*(Matrix(np.array([[2.0**k]])) for k in powers))
    assert forms._exactness_limit() == limit if limit > 0 else forms._exactness_limit() < 0
    inexact_data = Matrix(np.ones((1, 1)), np.zeros((1, 1)))
    assert BilinearForms(inexact_data, None, Matrix(np.ones((1, 1))))._exactness_limit() < 0


def test_a_value_on_its_bound_is_not_decided():
    out, z = np.full(6, UNKNOWN, dtype=np.int8), np.array([1.0, -1.0, 2.0, -2.0, np.inf, np.nan])
    _decide(out, z, np.ones(6))
    assert out.tolist() == [UNKNOWN, UNKNOWN, 1, -1, UNKNOWN, UNKNOWN]


def test_entries_that_round_to_zero_are_not_zero():
    small = exact_matrix([["1e-400", "0", "-1e-400", 0.1]], "small")  # zero, zero, zero and 0.1 as doubles
    right = exact_matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 1, 1, 0], [0, 0, 0, 1], [2, 1, 1, 0]], "right")
    for middle in (None, exact_matrix(np.eye(4), "middle")):
        assert BilinearForms(small, middle, right).signs().tolist() == [[1, 0, -1, 0, 1, 1]]


@pytest.mark.parametrize("rows", [1, 2, 7])
def test_integers_of_sparse_rows_are_taken_in_pieces(rows, monkeypatch):
    """0.1 + 0.2 - 0.3 is positive, by less than floating point resolves; every piece holds one row."""
    monkeypatch.setattr(kernel, "_CHUNK", 1)
    monkeypatch.setattr(operand_sizes, "SMALL", 0)
    expected = np.array([(-1, 0, 1)[i % 3] for i in range(rows)])
    left = expected[:, None] * np.array([0.1, 0.2, -0.3]) + (expected == 0)[:, None] * np.array([1, -1, 0])
    sparse = Matrix(sp.csr_array(left)), None, Matrix(sp.csr_array(np.ones((1, 3))))
    np.testing.assert_array_equal(BilinearForms(*sparse).signs().toarray()[:, 0], expected)


def test_sparse_entries_as_large_as_their_radius_count():
    class Exact:
        def __call__(self, index):
            return np.array([[1, -1, 5]], dtype=object)[index]

    values, radius = sp.csr_array([[1e-17, 1e-17, 1.0]]), sp.csr_array([[1e-17, 2e-17, 1e-17]])
    left = Matrix(values, radius, integer_rows=Exact())
    signs = BilinearForms(left, None, Matrix(sp.eye_array(3, format="csr"))).signs()
    assert signs.toarray().tolist() == [[1, -1, 1]]


def thirds(rng, *shape):
    """Fractions among which sums often vanish."""
    return np.vectorize(lambda k: Fraction(int(k), 3), otypes=[object])(rng.integers(-1, 2, shape))


def test_stacks_of_fractions_and_of_larger_blocks():
    rng = np.random.default_rng(0)
    for size in (2, 5, 20):
        L, M, R = thirds(rng, 3, 2, size), thirds(rng, 3, size, size), thirds(rng, 3, 4, size)
        expected = np.array([truth(*parts) for parts in zip(L, M, R, strict=True)])
        assert expected.any() and (size > 2 or not expected.all())
        stacks = [Matrix.from_fractions(part) for part in (L, M, R)]
        np.testing.assert_array_equal(BilinearForms(*stacks).signs(), expected)
        doubles = [Matrix(np.array(3 * part, dtype=float)) for part in (L, M, R)]
        np.testing.assert_array_equal(BilinearForms(*doubles).signs(), expected)
        plain = np.array([truth(left, np.eye(size), right) for left, right in zip(L, R, strict=True)])
        np.testing.assert_array_equal(BilinearForms(stacks[0], None, stacks[2]).signs(), plain)


def test_dense_rows_with_a_sparse_matrix_between():
    rng, n = np.random.default_rng(1), 70
    L, R = rng.integers(-1, 2, (2, n)).astype(float), rng.integers(-1, 2, (3, n)).astype(float)
    M = sp.csr_array(np.diag(rng.integers(-1, 2, n).astype(float)))
    expected = truth(L, M.toarray(), R)
    np.testing.assert_array_equal(BilinearForms(*map(Matrix, (L, M, R))).signs(), expected)
    third = Matrix.from_fractions(rational(R) / 3)
    np.testing.assert_array_equal(BilinearForms(Matrix(L), Matrix(M), third).signs(), expected)
    tight = BilinearForms(
        Matrix(np.eye(n)[:1]),
        Matrix(sp.csr_array(np.eye(n)), sp.csr_array(np.eye(n) * 2)),
        Matrix(np.eye(n)[:1]),
    )
    assert tight.signs(integers=False)[0, 0] == UNKNOWN


def test_sums_have_as_many_terms_as_there_can_be():
    stack = BilinearForms(*(Matrix(np.ones(shape)) for shape in ((2, 1, 7), (2, 7, 5), (2, 3, 5))))
    assert stack._lengths == (7, 5)
    plane = BilinearForms(Matrix(np.ones((1, 7))), None, Matrix(np.ones((3, 7))))
    assert plane._lengths == (0, 7)
    rows = sp.csr_array([[1.0, 1.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    thin = BilinearForms(Matrix(rows), Matrix(sp.eye_array(4, format="csr")), Matrix(rows))
    assert thin._lengths == (1, 3)


def test_rows_of_the_identity_are_not_multiplied():
    """l'M e_i is an entry of l'M; a permutation, a longer row and rows without entry are no identity."""
    rng = np.random.default_rng(0)
    left, middle = (sp.random_array((90, 90), density=0.1, rng=rng, format="csr") for _ in range(2))
    eye = sp.eye_array(90, format="csr")
    gathered = sp.csr_array((np.ones(90), np.arange(90), np.r_[0, 2, 2, np.arange(3, 91)]), shape=(90, 90))
    for right in (eye, eye[::-1].tocsr(), 2 * eye, gathered):
        exact = left.toarray() @ middle.toarray() @ right.toarray().T
        for first in (Matrix(left), Matrix(left.toarray())):
            forms = BilinearForms(first, Matrix(middle), Matrix(right))
            signs = forms.signs()
            np.testing.assert_allclose(forms.values.toarray() if sp.issparse(forms.values) else forms.values, exact)
            signs = signs.toarray() if sp.issparse(signs) else signs
            np.testing.assert_array_equal(signs, np.sign(exact))


def test_one_row_before_a_sparse_matrix_is_multiplied_alone():
    rng = np.random.default_rng(0)
    M, R = rng.integers(-3, 4, (60, 40)), np.concatenate([np.eye(40, dtype=int), rng.integers(-2, 3, (5, 40))])
    row = np.array([[Fraction(int(k), 3**40) for k in rng.integers(1, 3**30, 60)]], dtype=object)
    M[:, ::3], at = 0, np.arange(45)[::-1]
    forms = BilinearForms(Matrix.from_fractions(row), *(Matrix(sp.csr_array(m.astype(float))) for m in (M, R)))
    np.testing.assert_array_equal(forms._sparse_pairs(np.zeros(45, dtype=int), at), np.sign(row @ M @ R.T)[0, ::-1])
