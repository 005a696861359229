"""Products of cones and approximations of Lorentz cones."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import any_cone, integer_matrices, proper_cone

import control_kpos as kp
from control_kpos.cones import (
    Orthant,
    PolyhedralCone,
    ProductCone,
    lorentz,
    orthant,
    product,
)

# -- products

PAPER = PolyhedralCone([[0, 1], [1, -2]])


def test_products_keep_their_structure():
    P = product([PAPER] * 3 + [orthant(1), orthant(2)])
    assert (P.factors, P.counts) == ((PAPER, orthant(3)), (3, 1))
    assert product([P, P]).counts == (3, 1, 3, 1)
    assert product([orthant(2), orthant(3)]) == orthant(5) and isinstance(product([orthant(2)] * 3), Orthant)
    assert product([PAPER]) is PAPER
    assert isinstance(PAPER * orthant(1), ProductCone)
    assert product([product([PAPER] * 2)] * 5).counts == (10,)
    assert -orthant(3) == PolyhedralCone(-np.eye(3))


@settings(max_examples=20)
@given(st.data())
def test_products_agree_with_dense_block_matrices(data):
    parts = data.draw(
        st.lists(st.one_of(any_cone(1), any_cone(2), proper_cone(3, 5), st.just(orthant(2))), min_size=1, max_size=4)
    )
    parts = parts + parts[:1]
    P = product(parts)
    rays = scipy.linalg.block_diag(*(X.rays for X in parts))
    facets = scipy.linalg.block_diag(*(X.facets for X in parts))
    assert np.array_equal(P.rays, rays) and np.array_equal(P.facets, facets)
    assert (P.n_rays, P.n_facets, P.dim) == (*[len(rays), len(facets)], rays.shape[1])
    H = P.exact_facets.rows_as_integers(np.arange(P.n_facets))
    R = P.exact_rays.rows_as_integers(np.arange(P.n_rays))
    assert ((H @ R.T == 0) == P.incidence).all()
    assert P.is_pointed == all(X.is_pointed for X in parts)
    assert P.is_solid == all(X.is_solid for X in parts)
    points = data.draw(integer_matrices(5, P.dim, 1))
    Q = PolyhedralCone.from_facets(facets) if len(facets) else None
    for strict in (False, True):
        expected = Q.contains(points, strict) if Q else np.ones(5, dtype=bool)
        assert (P.contains(points, strict) == expected).all()
    if Q:
        assert P == Q and Q == P and hash(P) == hash(Q)


def test_products_with_rounded_facets():
    X = PolyhedralCone(np.random.default_rng(0).normal(size=(3, 3)))
    P = product([orthant(2), X, X])
    assert P.exact_facets.radius is not None and P.exact_facets.is_sparse
    Q = PolyhedralCone(P.rays)
    assert P.contains(P) and P == Q and Q == P
    assert P.contains(P.interior_point, strict=True)


def test_huge_products():
    P = product([PAPER] * 1_000_000)
    assert (P.dim, P.n_rays, P.counts) == (2_000_000, 2_000_000, (1_000_000,))
    assert P.is_proper and P.dual.dual is P
    assert P.contains(P.interior_point, strict=True)
    assert P.exact_rays.values.nnz == 3_000_000
    for name in ("rays", "facets", "incidence"):
        with pytest.raises(kp.TooLargeError, match="exact_"):
            getattr(P, name)
    with pytest.raises(kp.TooLargeError, match="exact_rays"):
        _ = orthant(10**6).rays
    assert orthant(10**6) == orthant(10**6) and orthant(10**9).dim == 10**9
    interleaved = product([PAPER, orthant(1)] * 100_000)
    assert interleaved.contains(np.ones(300_000)) and interleaved.dim == 300_000


# -- Lorentz cones


@pytest.mark.parametrize(("n", "facets"), [(2, None), (3, 3), (3, 4), (3, 12), (4, 4), (4, 30), (5, 40), (6, None)])
def test_lorentz_approximations_are_exactly_inside_and_outside(n, facets):
    inner, outer = lorentz(n, facets), lorentz(n, facets, kind="outer")
    rays = inner.exact_rays.rows_as_integers(np.arange(inner.n_rays))
    assert (rays[:, 0] > 0).all()
    assert (rays[:, 0] ** 2 == (rays[:, 1:] ** 2).sum(axis=1)).all()
    assert inner == outer.dual and inner.is_proper and outer.contains(inner)
    assert outer.n_facets == inner.n_rays == (facets or (2 if n == 2 else 8 * (n - 2)))


def test_lorentz_approximations_converge():
    x = np.random.default_rng(0).normal(size=(2000, 3))
    x[:, 0] = np.abs(x[:, 0]) * 2
    slack = (x[:, 0] - np.linalg.norm(x[:, 1:], axis=1)) / x[:, 0]
    inner, outer = lorentz(3, 100), lorentz(3, 100, kind="outer")
    assert inner.contains(x[slack > 2e-3]).all() and not outer.contains(x[slack < -2e-3]).any()
    assert not inner.contains(x[slack < 0]).any() and outer.contains(x[slack > 0]).all()
