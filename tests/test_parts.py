"""Products whose generators, or facets, come in one list and in any coordinates are taken apart."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import block_diag

import control_kpos as kp
from control_kpos.cones import conversion, hull, parts
from control_kpos.cones.parts import independent_parts
from control_kpos.errors import TooLargeError
from control_kpos.exact.matrix import Matrix


def polygon(corners: int) -> np.ndarray:
    turn = 2 * np.pi * np.arange(corners) / corners
    return np.round(20 * np.column_stack([np.cos(turn), np.sin(turn), np.ones(corners)]))


def coordinates(rng: np.random.Generator, n: int) -> np.ndarray:
    while True:
        T = rng.integers(-2, 3, (n, n)).astype(float)
        if np.linalg.matrix_rank(T) == n:
            return T


FACTORS = {
    "polygons": [polygon(5), polygon(4), polygon(6)],
    "a line beside": [polygon(5), np.array([[1.0], [-1.0]]), polygon(4)],
    "rays beside": [np.eye(1), polygon(5), np.eye(1), polygon(4)],
    "redundant": [np.vstack([polygon(5), [[0, 0, 20]]]), np.array([[1.0, 0], [1, 1], [0, 1]])],
    "not pointed": [np.array([[1.0, 0], [-1, 0], [0, 1]]), polygon(5)],
    "a plane and more": [np.array([[1.0, 0], [0, 1], [-1, -1]]), polygon(4), polygon(5)],
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", FACTORS)
def test_flat_products_are_the_products(name, seed):
    rng = np.random.default_rng(seed)
    factors = FACTORS[name]
    flat = block_diag(*factors)
    expected = kp.product([kp.PolyhedralCone(rays) for rays in factors])
    order = rng.permutation(len(flat))
    assert kp.PolyhedralCone(flat[order]) == expected
    X = kp.PolyhedralCone(flat)
    assert (X.n_rays, X.n_facets) == (expected.n_rays, expected.n_facets)
    T = coordinates(rng, flat.shape[1])
    turned = kp.PolyhedralCone((flat @ T)[order])
    assert turned == expected.transform(T.T)
    products = turned.exact_facets.plain().fractions() @ turned.exact_rays.plain().fractions().T
    assert (products >= 0).all() and np.array_equal(turned.incidence, products == 0)
    back = kp.PolyhedralCone.from_facets(turned.exact_facets)
    assert back == turned and np.array_equal(back.incidence.sum(), turned.incidence.sum())


@pytest.mark.parametrize("count", [4, 5, 8, 16])
def test_twelve_to_forty_eight_dimensions(count):
    """All at once, R^24 was refused."""
    n = 3 * count
    flat = block_diag(*[polygon(5)] * count) @ coordinates(np.random.default_rng(0), n)
    X = kp.PolyhedralCone(flat)
    assert X.is_proper and (X.n_rays, X.n_facets) == (5 * count, 5 * count)
    assert X.incidence.sum() == 5 * count * (5 * count - 3)
    Y = kp.PolyhedralCone.from_facets(flat)
    assert Y.n_rays == 5 * count and X.dual == Y
    if count < 16:
        assert kp.PolyhedralCone(np.vstack([flat, flat.sum(axis=0)])) == X  # redundant, and joins all factors
    assert kp.linear_lyapunov(-np.eye(n), X) and kp.linear_lyapunov(-np.eye(n), Y)


def test_embedded_and_of_exact_numbers():
    """In a subspace, with thirds, and in units that differ by 10^12."""
    rows = block_diag(polygon(5), polygon(4)).astype(int).astype(object) * Fraction(1, 3)
    units = np.array([Fraction(10) ** k for k in (0, 12, -12, 3, 0, 6)], dtype=object)
    embedded = np.concatenate([rows * units, (rows * units).sum(axis=1)[:, None]], axis=1)
    X = kp.PolyhedralCone(embedded)
    assert X.n_rays == 9 and X.n_facets == 9 + 2 and not X.is_solid and X.is_pointed
    assert kp.PolyhedralCone.from_facets(X.exact_facets) == X


def test_a_product_up_to_rounding_is_none():
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    rows = block_diag(polygon(5), polygon(4)) @ Q
    whole = independent_parts(kp.PolyhedralCone(rows)._conversion.generators.rows_as_integers(np.arange(9)))
    assert [len(part) for part in whole] == [9]


@pytest.mark.parametrize("seed", range(20))
def test_the_finest_parts(seed):
    """Against all divisions of few vectors in two: parts are independent, and none can be divided."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(2, 6)), int(rng.integers(2, 8))
    rows = rng.integers(-1, 2, (p, n)) * (rng.random((p, n)) < 0.6)
    rows = rows[rows.any(axis=1)].astype(object)
    if not len(rows):
        return

    def rank(index) -> int:
        return int(np.linalg.matrix_rank(rows[list(index)].astype(float))) if len(index) else 0

    found = independent_parts(rows)
    assert sorted(np.concatenate(found).tolist()) == list(range(len(rows)))
    assert sum(rank(part) for part in found) == rank(range(len(rows)))
    for part in map(list, found):
        for code in range(1, 2 ** (len(part) - 1)):
            one = [i for k, i in enumerate(part) if code >> k & 1]
            other = [i for i in part if i not in one]
            assert rank(one) + rank(other) > rank(part)


def test_what_a_prime_hides_is_not_believed(monkeypatch):
    """Modulo 7 the first row looks like a part of its own; its rank does not fit."""
    rows = np.array([[1, 7, 0], [0, 1, 0], [0, 0, 1], [1, 0, 7]], dtype=object)
    assert [part.tolist() for part in independent_parts(rows)] == [[0, 1, 2, 3]]
    monkeypatch.setattr(parts, "LARGEST_PRIME", 7)
    assert [part.tolist() for part in independent_parts(rows)] == [[0, 1, 2, 3]]


def test_the_work_of_all_parts_is_limited_together(monkeypatch):
    cyclic = np.array([[t**k for k in range(8)] for t in range(-8, 9)])
    flat = block_diag(cyclic, cyclic)
    work = hull.Allowance(1e9)
    before = hull.ALLOWANCE.set(work)
    assert conversion.convert(Matrix(cyclic.astype(float))).facets.shape == (572, 8)
    hull.ALLOWANCE.reset(before)
    monkeypatch.setattr(hull, "LIMIT", 1.5 * (1e9 - work.work))
    assert kp.PolyhedralCone(cyclic).n_facets == 572
    with pytest.raises(TooLargeError):
        conversion.convert(Matrix(flat.astype(float)))
    monkeypatch.setattr(hull, "LIMIT", 3 * (1e9 - work.work))
    assert conversion.convert(Matrix(flat.astype(float))).facets.shape == (2 * 572, 16)
