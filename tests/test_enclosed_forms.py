"""Proven bounds of bilinear forms, what is kept of conditions, and places of sparse products."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from control_kpos.exact.condition import Condition, Evaluated
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.signs import BilinearForms
from control_kpos.proof.certificate import _agree


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_enclosures_hold_the_exact_numbers(seed):
    """Cancellation, fractions, and sizes at which products underflow; equal bounds where nothing was rounded."""
    rng = np.random.default_rng(seed)
    k, b = (int(size) for size in rng.integers(1, 90, 2))
    left = rng.integers(-3, 4, (k, b)) * rng.choice([1.0, 0.1, 1e-200], (k, b)) * (rng.random((k, b)) < 0.3)
    rows = rng.integers(-3, 4, (2, b)) * rng.choice([1.0, 0.3, 1e-160], (2, b))
    exact = np.array([[Fraction(x) for x in row] for row in rows.tolist()], dtype=object).reshape(2, b)
    if seed % 3 == 0:
        exact = exact / 7
    expected = np.array([[Fraction(x) for x in row] for row in left.tolist()], dtype=object) @ exact.T
    for exactly in (False, True):
        for kind in (np.asarray, sp.csr_array):
            low, high = BilinearForms(Matrix(kind(left)), None, Matrix.from_fractions(exact)).enclosure(exactly=exactly)
            assert (low <= expected).all() and (expected <= high).all()
            nothing = ((left != 0).astype(int) @ (rows != 0).T) == 0
            assert not exactly or not (low[nothing] != high[nothing]).any()
    whole = Matrix(np.round(left)), None, Matrix(np.round(rows))
    assert all(
        (bound == np.round(left) @ np.round(rows).T).all() for bound in BilinearForms(*whole).enclosure(exactly=True)
    )


@pytest.mark.parametrize("relation", [">", ">=", "<", "<=", "=="])
def test_what_is_kept_of_a_condition_says_the_same(relation):
    rows = np.random.default_rng(0).integers(-2, 3, (3, 4)).astype(float)
    for left in (rows, np.abs(rows) + 1, -np.abs(rows) - 1, 0 * rows):
        whole = Condition("z", BilinearForms(Matrix(left), None, Matrix(np.ones((2, 4)))), relation)
        kept = Evaluated.of(whole)
        assert kept.verdict() is whole.verdict() and kept.margin == whole.margin and kept.name == "z"
        assert (kept.residual == whole.residual).all() and (kept.scale == whole.scale).all()
        assert kept.worst_violation() is None


def test_what_overflows_is_not_enclosed():
    forms = BilinearForms(Matrix(sp.csr_array([[1e300, -1e300]])), None, Matrix(np.full((1, 2), 1e300)))
    with np.errstate(over="ignore", invalid="ignore"):
        low, high = forms.enclosure()
    assert not low > -np.inf and not high < np.inf


def test_sparse_products_that_underflow_keep_their_place():
    left, right = Matrix(sp.csr_array(np.diag([1e-200] * 70))), Matrix(sp.csr_array(np.diag([1e-200] * 70)))
    forms = BilinearForms(left, None, right)
    assert forms.pattern.nnz == 70 and (forms.signs().toarray() == np.eye(70)).all()


def test_stored_forms_beyond_the_range_of_doubles_are_compared_in_silence():
    forms = BilinearForms(Matrix(np.array([[1e308, 1e308], [1.0, 1.0]])), None, Matrix(np.array([[1.0, 1.0], [1, 0]])))
    condition = Condition("z >= 0", forms, ">=")
    with np.errstate(all="raise"):
        assert _agree([condition], {"z >= 0": condition.residual})
        changed = condition.residual.copy()
        changed[1, 1] = 2
        assert not _agree([condition], {"z >= 0": changed})
