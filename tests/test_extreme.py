"""Cones whose facets may be out of reach: what generators alone say agrees with what facets say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import any_cone, integer_matrices, many_rays, proper_cone, without_facets

import control_kpos as kp
from control_kpos.cones import hull, polyhedral
from control_kpos.cones.extreme import (
    extreme_generators,
    line_in,
    may_have_many_facets,
    most_facets,
)
from control_kpos.cones.polyhedral import has_open_facets
from control_kpos.exact.matrix import Matrix

dimensions = st.integers(1, 4)


@settings(max_examples=150)
@given(st.data(), dimensions, st.booleans())
def test_generators_and_facets_agree(data, n, swapped):
    X = data.draw(st.one_of(proper_cone(n), any_cone(n)))
    Y = without_facets(X._conversion.generators)
    X, Y = (X.dual, Y.dual) if swapped else (X, Y)
    assert (Y.is_pointed, Y.is_solid) == (X.is_pointed, X.is_solid)
    if X.is_proper:
        known, same = (Y.facets, X.facets) if swapped else (Y.rays, X.rays)
        np.testing.assert_array_equal(known, same)
        assert (Y.n_facets if swapped else Y.n_rays) == len(same)


@settings(max_examples=60)
@given(st.data(), st.integers(2, 4))
def test_messages_say_why_a_cone_is_not_proper(data, n):
    X = data.draw(any_cone(n))
    for Y in (without_facets(X._conversion.generators), without_facets(X._conversion.generators).dual):
        if Y.is_proper:
            Y.require_proper("X")
        else:
            with pytest.raises(kp.NotProperConeError, match=r"X is not (pointed|solid): it (contains|lies)"):
                Y.require_proper("X")


def test_a_line_is_named():
    rays = np.vstack([many_rays(8, 40), -many_rays(8, 40)[3:5].sum(axis=0)])
    X = kp.PolyhedralCone(rays)
    with pytest.raises(
        kp.NotProperConeError, match=r"line through .*; the opposite of generator \d+ is a sum of others"
    ):
        X.require_proper("X")
    weights = line_in(Matrix(rays.astype(float)))
    assert weights is not None and (weights >= 0).all() and weights.any() and not (weights @ rays).any()


@pytest.mark.parametrize(("p", "n"), [(60, 8), (17, 8), (9, 7), (6, 4), (5, 3), (7, 5), (12, 6)])
def test_the_largest_number_of_facets_is_that_of_cyclic_cones(p, n):
    if p <= 20:
        assert kp.PolyhedralCone(many_rays(n, p)).n_facets == most_facets(p, n)
    else:
        assert most_facets(p, n) == 55440


def test_which_cones_are_asked_for_facets_first():
    assert not may_have_many_facets(60, 8)  # 55 440 facets at most, found in seconds
    assert not may_have_many_facets(200, 200)  # simplicial
    assert not may_have_many_facets(300, 4)
    assert not may_have_many_facets(5000, 8)  # hardly all extreme
    assert may_have_many_facets(67, 12) and may_have_many_facets(45, 30)
    assert not has_open_facets(kp.orthant(50)) and not has_open_facets(kp.lorentz(3, facets=16))
    assert not has_open_facets(kp.PolyhedralCone.from_facets(many_rays(12, 67)))


def test_a_cone_that_has_its_facets_uses_them():
    X = without_facets(many_rays(5, 9))
    assert has_open_facets(X)
    X._conversion._refusal = ""
    assert X.n_facets and not has_open_facets(X)


def test_redundant_generators_are_found_among_many(monkeypatch):
    monkeypatch.setattr(polyhedral, "convert", lambda _: pytest.fail("facets are enumerated"))
    rays = many_rays(9, 60)
    inside = np.random.default_rng(0).integers(0, 3, (4, 60)) @ rays
    edge = rays[3] + rays[4]
    X = kp.PolyhedralCone(np.vstack([rays[:2], rays[1:2] * 3, inside, rays[2:], edge]))
    assert X.is_proper and X.n_rays == 60
    np.testing.assert_array_equal(X.rays, rays)
    assert kp.PolyhedralCone(rays[::-1]) == X and kp.PolyhedralCone(rays[1:]) != X and kp.orthant(9) != X
    assert (rays @ X.dual.interior_point > 0).all()


@pytest.mark.parametrize("unit", [1e-150, 1e-6, 1e100])
def test_units_do_not_matter(unit):
    rays = many_rays(8, 30).astype(float)
    scaled = rays * np.geomspace(1, unit, 8) * np.geomspace(1, 1 / unit, 30)[:, None]
    X = without_facets(scaled)
    assert X.is_proper
    np.testing.assert_array_equal(X.rays, scaled)


@settings(max_examples=40)
@given(integer_matrices(9, 3, 2))
def test_only_extreme_generators_are_kept(rows):
    rows = rows[(rows != 0).any(axis=1)]
    found = extreme_generators(Matrix(rows.astype(float))) if len(rows) else None
    if found is None:
        assert not len(rows) or not kp.PolyhedralCone(rows).is_pointed
        return
    np.testing.assert_array_equal(found.rays.values, kp.PolyhedralCone(rows).rays)
    assert found.pointing is None or (rows @ found.pointing > 0).all()


def test_numbers_too_long_for_linear_programs():
    rays = np.vstack([many_rays(8, 30).astype(object), [[10**400] + [0] * 7], [[10**401, 1] + [0] * 6]])
    X = kp.PolyhedralCone(Matrix(np.ones(rays.shape), np.ones(rays.shape) * np.inf, integer_rows=rays.__getitem__))
    X._conversion._refusal = "no"
    with pytest.raises(kp.TooLargeError):
        _ = X.is_pointed


def test_work_is_limited(monkeypatch):
    monkeypatch.setattr("control_kpos.cones.extreme.LIMIT", 1e4)
    with pytest.raises(kp.TooLargeError, match="60 vectors in dimension 9"):
        _ = kp.PolyhedralCone(many_rays(9, 60)).rays
    before = hull.ALLOWANCE.set(hull.Allowance(1e4))
    with pytest.raises(kp.TooLargeError):
        _ = kp.PolyhedralCone(many_rays(9, 60)).is_pointed
    hull.ALLOWANCE.reset(before)
