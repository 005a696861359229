"""Long stacks: the order of products and the size of pieces change no sign, and memory grows with the data alone."""

import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.exact import stacks
from control_kpos.exact.condition import Condition
from control_kpos.exact.distinct import distinct
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.signs import UNKNOWN, BilinearForms
from control_kpos.exact.stacks import Identity, Joined, StackedForms, Transposed, forms_on, stacked
from control_kpos.networks.blocks import shared
from control_kpos.networks.certify import candidates, provable_rate
from control_kpos.networks.conditions import balance_forms


def doubles(rng, *shape):
    """Doubles over many orders of magnitude, with zeros."""
    return rng.standard_normal(shape) * 10.0 ** rng.integers(-8, 8, shape) * (rng.random(shape) < 0.8)


def integers(rng, *shape):
    """Small integers, whose sums often vanish."""
    return rng.integers(-3, 4, shape).astype(float)


def tenths(rng, *shape):
    """Multiples of the double 0.1, whose sums vanish where floating point does not see it."""
    return rng.integers(-3, 4, shape) * 0.1


def extreme(rng, *shape):
    """Doubles from the smallest to near the largest."""
    return rng.standard_normal(shape) * 2.0 ** rng.integers(-500, 300, shape)


def thirds(rng, *shape):
    """Fractions, as a Matrix."""
    numbers = [Fraction(int(k), 3) for k in rng.integers(-3, 4, int(np.prod(shape)))]
    return Matrix.from_fractions(np.array(numbers, dtype=object).reshape(shape))


KINDS = [doubles, integers, tenths, extreme, thirds]


def matrix(values):
    return values if isinstance(values, Matrix) else Matrix(values)


def exact_forms(left, middle, right):
    """The forms in fractions, for stacks."""
    left, right = left.dense().fractions(), right.dense().fractions()
    out = left if middle is None else left @ middle.dense().fractions()
    return out @ np.swapaxes(right, -1, -2)


def exact_signs(left, middle, right):
    z = exact_forms(left, middle, right)
    return (z > 0).astype(int) - (z < 0).astype(int)


# -- the same facets and generators for a whole stack


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(2, 2, 2, 2), (1, 3, 2, 4), (3, 1, 4, 1), (4, 4, 4, 4)])
def test_one_product_for_a_stack_has_the_signs_of_stacked_products(kind, size):
    rng, (k, a, b, p) = np.random.default_rng(0), size
    cones = integers if kind is thirds else kind
    for _ in range(10):
        left, middle, right = matrix(cones(rng, k, a)), matrix(kind(rng, 7, a, b)), matrix(cones(rng, p, b))
        at_once, one_by_one = forms_on(left, middle, right), BilinearForms(left, middle, right)
        assert isinstance(at_once, stacks._AtOnce) or kind is extreme
        expected = exact_signs(left, middle, right)
        np.testing.assert_array_equal(at_once.signs(), expected)
        np.testing.assert_array_equal(one_by_one.signs(), expected)


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_of_one_product_hold_the_exact_forms(kind):
    rng = np.random.default_rng(1)
    for _ in range(20):
        left, middle, right = matrix(integers(rng, 3, 2)), matrix(kind(rng, 5, 2, 3)), matrix(integers(rng, 4, 3))
        exact = exact_forms(left, middle, right)
        for exactly in (False, True):
            low, high = forms_on(left, middle, right).enclosure(exactly=exactly)
            inside = [Fraction(a) <= z <= Fraction(b) for a, z, b in zip(low.flat, exact.flat, high.flat, strict=True)]
            assert all(inside)


def test_products_out_of_range_are_left_to_stacked_products():
    middle = Matrix(np.ones((3, 2, 2)))
    for size in (1e-200, 1e200):
        rows = Matrix(size * np.array([[1.0, 2.0], [3.0, 1.0]]))
        forms = forms_on(rows, middle, rows)
        assert not isinstance(forms, stacks._AtOnce)
        assert (forms.signs() == 1).all()
    tiny = Matrix(np.array([[2.0**-500, 0.0], [0.0, 1.0]]))
    assert isinstance(forms_on(tiny, middle, tiny), stacks._AtOnce)


def test_entries_at_the_end_of_the_range_prove_nothing_wrong():
    rng = np.random.default_rng(2)
    for _ in range(50):
        left, right = (Matrix(rng.standard_normal((2, 2)) * 2.0**e) for e in (-500, -520))
        middle = Matrix(rng.standard_normal((4, 2, 2)) * 2.0 ** rng.integers(-1000, 1000, (4, 1, 1)))
        np.testing.assert_array_equal(forms_on(left, middle, right).signs(), exact_signs(left, middle, right))


def test_identities_multiply_nothing():
    eye, middle = Matrix(np.eye(2)), Matrix(np.arange(12.0).reshape(3, 2, 2) - 5)
    forms = forms_on(eye, middle, eye)
    assert np.shares_memory(forms.values, middle.values)
    np.testing.assert_array_equal(forms.signs(), np.sign(middle.values))


# -- sums of parts


@pytest.mark.parametrize("kind", KINDS)
def test_sums_of_parts_have_the_signs_of_joined_matrices(kind):
    rng = np.random.default_rng(3)
    for _ in range(20):
        rows = [matrix(kind(rng, 5, 1, size)) for size in (2, 1, 2)]
        blocks = [matrix(kind(rng, 5, 2, 2)), matrix(kind(rng, 5, 1, 2)), Matrix(-np.eye(2)[None])]
        right = matrix(integers(rng, 3, 2))
        parts = forms_on(Joined(rows, -1), Joined(blocks, -2), right)
        assert isinstance(parts, stacks._Summed) or kind is thirds
        whole = Matrix.join(rows, -1), Matrix.join(blocks, -2), right
        np.testing.assert_array_equal(parts.signs(), exact_signs(*whole))
        np.testing.assert_array_equal(BilinearForms(*whole).signs(), parts.signs())


def test_bounds_of_sums_of_parts_hold_the_exact_forms():
    rng = np.random.default_rng(4)
    for _ in range(30):
        rows = [Matrix(doubles(rng, 4, 1, 3)), Matrix(doubles(rng, 4, 1, 2))]
        blocks = [Matrix(doubles(rng, 4, 3, 2)), Matrix(doubles(rng, 1, 2, 2))]
        right = Matrix(doubles(rng, 3, 2))
        exact = exact_forms(Matrix.join(rows, -1), Matrix.join(blocks, -2), right)
        low, high = forms_on(Joined(rows, -1), Joined(blocks, -2), right).enclosure()
        inside = [Fraction(a) <= z <= Fraction(b) for a, z, b in zip(low.flat, exact.flat, high.flat, strict=True)]
        assert all(inside)


@pytest.mark.parametrize("kind", [doubles, integers, tenths, extreme])
def test_sums_over_links_are_those_of_the_joined_matrix(kind):
    """(q' + r'W) y, where the transpose of W is at hand."""
    rng = np.random.default_rng(5)
    for size in (3, 80):
        W = sp.csr_array(kind(rng, size + 2, size) * (rng.random((size + 2, size)) < 3 / size))
        q, r = (Matrix(kind(rng, 1, n)) for n in (size, size + 2))
        links = Transposed(Matrix(sp.csr_array(W.T)))
        forms = forms_on(Joined([q, r], -1), Joined([Identity(size), links], -2), Identity(size))
        assert links.shape == W.shape and links.column_length == Matrix(W).column_length
        joined = Matrix.join([q, r], -1), Matrix.join([Matrix.identity(size, sparse=True), Matrix(W)], -2)
        expected = exact_signs(*joined, Matrix.identity(size))
        np.testing.assert_array_equal(forms.signs(), expected)


def test_balance_with_fractions_and_weights_takes_the_weights():
    """sigma_k q_k + sum_j sigma_j r_j W_jk, for q that are no doubles."""
    nodes = kp.stack([[[-3]]] * 2, B=[[1]], C=[[1]])
    model = kp.feedback_interconnect(nodes, [[0, 1], [1, 0]]).model
    q = Matrix.from_fractions(np.array([Fraction(-1, 3), Fraction(-1, 3)]))
    r = Matrix.from_fractions(np.array([Fraction(1, 3), Fraction(1, 3)]))
    assert balance_forms(model, q, r, np.array([1.0, 2.0])).signs().tolist() == [[1, -1]]
    assert balance_forms(model, q, r, np.ones(2)).signs().tolist() == [[0, 0]]


# -- pieces


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("piece", [1, 3, 10])
def test_pieces_have_the_signs_of_the_whole(kind, piece, monkeypatch):
    monkeypatch.setattr(stacks, "PIECE", piece)
    rng = np.random.default_rng(6)
    cones = integers if kind is thirds else kind
    left, middle, right = matrix(cones(rng, 2, 3)), matrix(kind(rng, 10, 3, 2)), matrix(cones(rng, 4, 2))
    rows = [matrix(kind(rng, 10, 1, 3)), matrix(kind(rng, 10, 1, 1))]
    blocks = [middle, matrix(kind(rng, 1, 1, 2))]
    questions = [(left, middle, right), (matrix(kind(rng, 10, 1, 2)), None, right)]
    questions += [(Joined(rows, -1), Joined(blocks, -2), right), (left, None, matrix(kind(rng, 10, 1, 3)))]
    for operands in questions:
        whole = [m.whole if isinstance(m, Joined) else m for m in operands]
        pieces, expected = StackedForms(*operands), BilinearForms(*whole)
        np.testing.assert_array_equal(pieces.signs(), expected.signs())
        np.testing.assert_allclose(pieces.values, expected.values, rtol=0, atol=1e-14 * expected.magnitudes.max())
        np.testing.assert_allclose(pieces.magnitudes, expected.magnitudes, rtol=1e-13)
        np.testing.assert_allclose(StackedForms(*operands).values, pieces.values, rtol=1e-13)
        low, high = pieces.enclosure()
        assert ((low <= pieces.values) & (pieces.values <= high)).all()
        where = rng.random(pieces.shape) < 0.5
        some = pieces.signs(where)
        np.testing.assert_array_equal(some[where], expected.signs()[where])


def test_stacks_in_pieces_only_where_they_are_long(monkeypatch):
    monkeypatch.setattr(stacks, "PIECE", 4)
    row = Matrix(np.ones((1, 2)))
    assert isinstance(stacked(row, Matrix(np.ones((9, 2, 2))), row), StackedForms)
    assert not isinstance(stacked(row, Matrix(np.ones((8, 2, 2))), row), StackedForms)


def test_what_floating_point_leaves_open_may_stay_open():
    left, right = Matrix(np.array([[0.1, 0.2]])), Matrix(np.array([[1.0]]))
    middle = Matrix(np.array([[[3.0], [-1.5 - 2.0**-51]]] * 3))
    forms = StackedForms(left, middle, right)
    assert (forms.signs(integers=False) == UNKNOWN).any() and not (forms.signs() == UNKNOWN).any()


def test_a_violation_is_found_in_its_piece(monkeypatch):
    monkeypatch.setattr(stacks, "PIECE", 2)
    values = np.ones((9, 2, 2))
    values[7, 1, 0], values[5, 0, 1] = -2, 1e-17
    forms = stacked(Matrix(np.eye(2)), Matrix(values), Matrix(np.eye(2)))
    condition = Condition("h'A x >= 0", forms, ">=")
    assert condition.verdict() is False and condition.worst_violation() == (7, 1, 0)
    spared = Condition("h'A x >= 0", forms, ">=", np.broadcast_to(np.eye(2, dtype=bool), values.shape))
    assert spared.verdict() is True and spared.worst_violation() is None
    assert spared.residual[7, 1, 0] == 0 and spared.margin == 1


def spread_nodes(n):
    """Mass-spring nodes in a random network, and their certificate's data."""
    A, B, C, D = kp.examples.mass_spring_nodes(n, seed=1)
    nodes = kp.stack(A, B, C, D, X=kp.examples.paper_cone())
    return nodes, kp.examples.random_regular(n, 3, seed=1)


def test_networks_in_pieces_have_the_same_verdict_rate_and_residuals(monkeypatch):
    nodes, W = spread_nodes(50)
    whole = kp.feedback_interconnect(nodes, W).certificate
    monkeypatch.setattr(stacks, "PIECE", 7)
    pieces = kp.feedback_interconnect(nodes, W).certificate
    assert whole and pieces and pieces.check() and whole.check()
    assert pieces.decay_rate == pytest.approx(whole.decay_rate, rel=1e-14)
    for name, values in whole.residuals.items():
        np.testing.assert_allclose(pieces.residuals[name], values, rtol=1e-12, atol=1e-13)
    v, _, q = map(Matrix, next(candidates(pieces.model, 0.0)))
    assert provable_rate(pieces.model, v, q, discrete=False) == pieces.decay_rate


def test_a_bad_node_far_down_a_stack_is_named(monkeypatch):
    monkeypatch.setattr(stacks, "PIECE", 5)
    A = np.tile([[-3.0, 1.0], [1.0, -3.0]], (40, 1, 1))
    A[33, 0, 1] = -1e-9
    net = kp.feedback_interconnect(kp.stack(A, B=[[1], [0]], C=[[0, 1]]), kp.examples.ring(40))
    assert net.certificate.status is kp.Status.REFUTED and net.certificate.witness.node == 33


# -- equal nodes


def test_equal_nodes_are_proven_once():
    B = Matrix(np.tile([[0.0], [1.0]], (6, 1, 1)))
    assert shared(B).shape == (1, 2, 1)
    for place in (0, 3, 5):
        other = B.values.copy()
        other[place, 0, 0] = 1e-300
        assert shared(Matrix(other)).shape == (6, 2, 1)
    A = np.tile([[-3.0]], (6, 1, 1)) - np.arange(6.0)[:, None, None]
    net = kp.feedback_interconnect(kp.stack(A, B=np.ones((6, 1, 1)), C=np.ones((6, 1, 1))), kp.examples.ring(6))
    assert net.certificate and net.certificate.check()
    bad = kp.feedback_interconnect(kp.stack(A, B=-np.ones((6, 1, 1)), C=np.ones((6, 1, 1))), kp.examples.ring(6))
    assert bad.certificate.status is kp.Status.REFUTED and bad.certificate.witness.node == 0


# -- distinct integers


def test_distinct_integers():
    rng = np.random.default_rng(7)
    for values in (rng.integers(-5, 5, 40), rng.integers(0, 3, (4, 5)), np.array([2]), np.zeros(0, dtype=np.intp)):
        np.testing.assert_array_equal(distinct(values), np.unique(values))


# -- memory


@pytest.mark.parametrize(("graph", "certify", "check"), [("3-regular", 480, 520), ("ring", 400, 430)])
def test_bytes_of_a_node(graph, certify, check):
    """Above the data: what a node of two states takes at the peak, to certify and to check."""
    n = 2**17
    nodes, W = spread_nodes(n)
    W = kp.examples.ring(n) if graph == "ring" else W
    tracemalloc.start()
    try:
        certificate = kp.feedback_interconnect(nodes, W).certificate
        assert certificate.status is kp.Status.PROVED
        assert tracemalloc.get_traced_memory()[1] <= certify * n
        tracemalloc.reset_peak()
        assert certificate.check()
        assert tracemalloc.get_traced_memory()[1] <= check * n
    finally:
        tracemalloc.stop()
