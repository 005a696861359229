"""Cones as users meet them: set operations, membership, messages, products of any size."""

import copy
import pickle
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import any_cone, integer_matrices, proper_cone, simplicial_cone, unimodular

import control_kpos as kp
from control_kpos.cones import (
    Cone,
    PolyhedralCone,
    lorentz,
    orthant,
    product,
)

SQUARE = [[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]]
PAPER = PolyhedralCone([[0, 1], [1, -2]])


# -- what the paper needs


def test_cone_of_the_paper():
    assert PAPER.facets.tolist() == [[2, 1], [1, 0]]
    assert PAPER.incidence.tolist() == [[False, True], [True, False]]
    assert PAPER.is_proper and PAPER.is_simplicial
    assert PAPER.dual.rays.tolist() == [[2, 1], [1, 0]]
    assert PAPER.contains(PAPER.interior_point, strict=True)


def test_rays_keep_order_and_scaling():
    X = PolyhedralCone([[4, 4], [2, 1], [0.5, 0], [3, 0], [8, 8], [1, 0.25]])
    assert X.rays.tolist() == [[4, 4], [0.5, 0]]
    assert PolyhedralCone(["1/3", "1"]).rays.tolist() == [[1 / 3, 1]]


def test_facets_keep_order_and_scaling():
    X = PolyhedralCone.from_facets([[0, 4], [1, 1], [0.5, 0], [0, 2]])
    assert X.facets.tolist() == [[0, 4], [0.5, 0]]


def test_facets_of_a_simplicial_cone_are_opposite_to_its_rays():
    X = PolyhedralCone([[1, 0, 0], [1, 1, 0], [1, 1, 1]])
    assert (X.incidence == ~np.eye(3, dtype=bool)).all()
    assert (np.diag(X.facets @ X.rays.T) > 0).all()


# -- improper cones


@pytest.mark.parametrize(
    ("rays", "message"),
    [
        (
            [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1], [-2, 0, 0]],
            "not pointed: it contains the line through .1, 0, 0.; generators 0 and 4 point both ways along it",
        ),
        ([[1, 0], [0, 1], [-1, -1]], "not pointed.*generator 0 is a sum of others"),
        ([[1, 0, 0], [0, 1, 0], [1, 1, 0]], "not solid: it lies in the hyperplane with normal .0, 0, -?1."),
        ([[1, 2]], "not solid"),
    ],
)
def test_improper_cones_are_refused_with_a_witness(rays, message):
    X = PolyhedralCone(rays)
    assert not X.is_proper
    with pytest.raises(kp.NotProperConeError, match=f"^plant cone is {message}"):
        X.require_proper("plant cone")


def test_improper_cone_from_facets():
    half_space = PolyhedralCone.from_facets([[1, 0]])
    assert half_space.is_solid and not half_space.is_pointed
    assert half_space.rays.tolist() == [[1, 0], [0, 1], [0, -1]]
    with pytest.raises(kp.NotProperConeError, match=r"line through \(0, 1\), which is orthogonal to all normals"):
        half_space.require_proper("X")
    ray = PolyhedralCone.from_facets([[1, 0], [0, 1], [0, -1]])
    with pytest.raises(kp.NotProperConeError, match=r"not solid: .* normal .0, -?1."):
        ray.require_proper("X")


def test_improper_factor_is_named():
    P = product([orthant(2), PAPER, PolyhedralCone([[1, 0], [-1, 0], [0, 1]])])
    with pytest.raises(kp.NotProperConeError, match=r"X is not pointed: in factor 2 of the product, .*line through"):
        P.require_proper("X")
    with pytest.raises(kp.NotProperConeError, match=r"Y is not solid: in factor 0 of the product"):
        product([PolyhedralCone([[1, 1]]), PAPER]).require_proper("Y")


def test_the_point_and_the_whole_space():
    point = orthant(2) & -orthant(2)
    assert point.n_rays == 0 and point.is_pointed and not point.is_solid
    assert point.contains([0, 0]) and not point.contains([1, 0])
    assert orthant(2).contains(point)
    space = orthant(2) + -orthant(2)
    assert space.n_facets == 0 and space.is_solid and not space.is_pointed
    assert space.contains([-5, 3], strict=True) and space == point.dual and space != point
    assert space.interior_point.shape == (2,)
    with pytest.raises(kp.NotProperConeError, match="no interior"):
        _ = point.interior_point


# -- membership


def test_membership_is_exact():
    X = PolyhedralCone([[1, 0], ["10", "1"]])
    assert X.contains(["1", "0.1"]) and not X.contains([1, 0.1])  # the double 0.1 is above 1/10
    assert not X.contains(["1", "0.1"], strict=True)
    assert X.contains([Fraction(1), Fraction(1, 10)])
    assert X.contains([1, np.nextafter(0.1, 0)], strict=True)
    assert X.contains([2.0**-1000, 0]) and not X.contains([2.0**-1000, -(2.0**-1074)])


def test_membership_shapes():
    points = np.array([[0, 1], [1, -2], [1, 0], [-1, 0]])
    assert PAPER.contains(points).tolist() == [True, True, True, False]
    assert PAPER.contains(points, strict=True).tolist() == [False, False, True, False]
    assert PAPER.contains(points[0]) is True
    assert PAPER.contains(PAPER.exact_facets).tolist() == [True, True]
    assert PAPER.contains(np.zeros((0, 2))).shape == (0,)
    assert orthant(2).contains(points).tolist() == [True, False, True, False]
    assert PAPER.contains(orthant(2)) and not orthant(2).contains(PAPER)
    assert PolyhedralCone([[1, 0], [-1, 1]]).contains(orthant(2), strict=False)
    assert not PAPER.contains(orthant(2), strict=True)
    assert PAPER.contains(PolyhedralCone([[1, 1], [1, -1]]), strict=True)


@settings(max_examples=50)
@given(st.data(), st.sampled_from([1, 2, 3]))
def test_contains_agrees_with_the_definition(data, n):
    X = data.draw(any_cone(n))
    points = data.draw(integer_matrices(6, n))
    H = X.exact_facets.rows_as_integers(np.arange(X.n_facets)).reshape(X.n_facets, n)
    assert X.contains(points).tolist() == [(H @ x >= 0).all() for x in points]
    assert X.contains(points, strict=True).tolist() == [(H @ x > 0).all() for x in points]
    combination = np.abs(data.draw(integer_matrices(3, X.n_rays))) @ X.rays
    assert X.contains(combination).all()


# -- operations


@settings(max_examples=40)
@given(st.data(), st.sampled_from([1, 2, 3]))
def test_operations_on_sets(data, n):
    X, Y = data.draw(any_cone(n)), data.draw(any_cone(n))
    points = data.draw(integer_matrices(8, n, 2))
    both = X & Y
    assert (both.contains(points) == (X.contains(points) & Y.contains(points))).all()
    assert X.contains(both) and Y.contains(both)
    assert (X + Y).contains(X) and (X + Y).contains(Y)
    assert (X + Y).dual == X.dual & Y.dual  # each is the definition of the other
    assert (-X).contains(-points).tolist() == X.contains(points).tolist()
    opposite = -X
    assert -opposite == X
    P = X * Y
    pairs = np.concatenate([points, points[::-1]], axis=1)
    assert (P.contains(pairs) == (X.contains(points) & Y.contains(points[::-1]))).all()
    assert P.dual == X.dual * Y.dual
    assert X.dual.dual == X


@settings(max_examples=40)
@given(st.data(), st.sampled_from([2, 3, 4]))
def test_images(data, n):
    X, T = data.draw(proper_cone(n)), data.draw(unimodular(n))
    Y = X.transform(T)
    inverse = np.rint(np.linalg.inv(T)).astype(int)
    assert (inverse @ T == np.eye(n)).all()
    assert Y.is_proper and Y.transform(inverse) == X
    assert (Y.n_rays, Y.n_facets) == (X.n_rays, X.n_facets)
    assert np.array_equal(Y.rays, X.rays @ T.T)
    S = data.draw(integer_matrices(2, n))
    image = X.transform(S)
    assert image.contains(X.rays @ S.T).all()
    assert image.dim == 2
    pulled_back = image.dual.rays @ S  # h in (S X)* exactly if S'h in X*
    assert X.dual.contains(pulled_back).all()


def test_singular_images():
    X = orthant(3).transform([[1, 0, 0], [0, 1, 0], [0, 0, 0]])
    assert not X.is_solid and X.rays.tolist() == [[1, 0, 0], [0, 1, 0]]
    assert orthant(2).transform([[1, -1]]).n_facets == 0
    assert PAPER.transform(np.zeros((2, 2))).n_rays == 0
    assert orthant(2).transform([["0.1", "0"], ["0", "1/3"]]) == orthant(2)


def test_large_images_are_rounded_with_a_bound():
    rng = np.random.default_rng(0)
    n = 160
    R, T = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    Y = PolyhedralCone(R).transform(T)
    assert Y.is_simplicial
    np.testing.assert_allclose(Y.rays, R @ T.T, atol=1e-9)
    assert Y.contains(Y.interior_point, strict=True)
    exact = Y.exact_rays.rows_as_integers(np.array([3]))[0]
    assert abs(exact[0] / exact[1] - Y.rays[3, 0] / Y.rays[3, 1]) < 1e-9


@settings(max_examples=40)
@given(st.data(), st.sampled_from([1, 2, 3, 4]))
def test_interior_points(data, n):
    X = data.draw(st.one_of(proper_cone(n), simplicial_cone(n)))
    for cone in (X, X.dual, X * X):
        assert cone.contains(cone.interior_point, strict=True)
    assert (X.facets @ X.interior_point > 0).all()


@pytest.mark.parametrize("unit", [1e-300, 1e-150, 1e-6, 1, 1e150])
def test_interior_points_in_mixed_units(unit):
    X = PolyhedralCone(np.array(SQUARE) * [1, unit, 1] @ [[1, 0, 0], [0, 1, 0], [1, 0, 1]])
    assert X.contains(X.interior_point, strict=True)
    assert X.dual.contains(X.dual.interior_point, strict=True)


def test_interior_point_of_rays_of_very_different_length():
    X = PolyhedralCone([[1e300, 1e300, 0], [0, 1e-300, 0], [1, 0, 1]])
    assert X.contains(X.interior_point, strict=True)


def test_no_double_lies_between_two_neighbours():
    ray = np.array([1, np.nextafter(1, 2)])
    X = PolyhedralCone([[1, 1], ray])
    assert X.contains(X.interior_point, strict=True)  # between 1 and its neighbour as a ratio there are some
    Y = PolyhedralCone([[10**40, 10**40], [10**40, 10**40 + 1]])
    assert Y.is_proper
    with pytest.raises(kp.UndecidedError, match="too thin"):
        _ = Y.interior_point


# -- equality


def test_equality_of_sets():
    assert PolyhedralCone(np.eye(2)) == orthant(2) and orthant(2) != orthant(3)
    assert hash(PolyhedralCone(np.eye(2))) == hash(orthant(2))
    assert product([PAPER, orthant(1)]) == PolyhedralCone([[0, 1, 0], [1, -2, 0], [0, 0, 1]])
    assert PolyhedralCone([[1, 0], [-1, 0], [0, 1]]) == PolyhedralCone([[2, 0], [-1, 0], [7, 3]])
    assert PolyhedralCone(SQUARE) != PolyhedralCone(SQUARE[:3])
    assert PAPER != "cone" and not PAPER == 1  # noqa: SIM201
    large = np.random.default_rng(0).normal(size=(100, 100))
    assert PolyhedralCone(large) == PolyhedralCone(4 * large[::-1])
    assert PolyhedralCone(large) != PolyhedralCone(large + np.eye(100))
    nearly = PolyhedralCone([[0, 1], [1, np.nextafter(-2, 0)]])
    assert nearly != PAPER


@settings(max_examples=40)
@given(st.data(), st.sampled_from([1, 2, 3]))
def test_equal_cones_have_equal_hashes(data, n):
    X, Y = data.draw(any_cone(n)), data.draw(any_cone(n))
    same = bool(X.contains(Y) and Y.contains(X))
    assert (X == Y) == same
    assert not same or hash(X) == hash(Y)
    again = PolyhedralCone(np.concatenate([3 * X.rays[::-1], X.rays]))
    assert again == X and hash(again) == hash(X)


# -- objects


@pytest.mark.parametrize(
    "X",
    [
        PAPER,
        orthant(3),
        product([PAPER] * 3),
        PolyhedralCone.from_facets(SQUARE),
        lorentz(4),
        PolyhedralCone(np.tri(30) + 0.1),
    ],
    ids=repr,
)
def test_copies_and_pickles(X):
    for how in (copy.copy, copy.deepcopy, lambda X: pickle.loads(pickle.dumps(X))):
        fresh = how(X)
        assert fresh == X and type(fresh) is type(X) and hash(fresh) == hash(X)
    X.dual.interior_point  # noqa: B018  # with everything computed
    assert pickle.loads(pickle.dumps(X)) == X


def test_cones_are_immutable():
    X = PolyhedralCone(data := np.array([[0.0, 1.0], [1.0, -2.0]]))
    data[0] = 7
    assert X == PAPER
    for cone in (X, orthant(2), product([PAPER] * 2)):
        with pytest.raises(AttributeError):
            cone.rays = np.eye(2)
        with pytest.raises(AttributeError, match="immutable"):
            cone.colour = "red"
        for array in (cone.rays, cone.facets, cone.interior_point):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1


def test_representations_are_short():
    X = PolyhedralCone(SQUARE)
    assert repr(X) == "<PolyhedralCone in R^3 from 4 generators>"
    assert X.n_facets == 4 and repr(X) == "<PolyhedralCone in R^3: 4 rays, 4 facets>"
    assert repr(orthant(4)) == "orthant(4)"
    assert len(repr(product([PAPER, orthant(1)] * 500))) < 300
    flat = PolyhedralCone([[1, 0]])
    assert not flat.is_solid and "not solid" in repr(flat)


# -- bad input

BAD_DATA = [
    ([[1, np.nan]], kp.DataError, r"rays\[0, 1\] is nan"),
    ([[1, np.inf]], kp.DataError, "inf"),
    ([[1, 1j]], kp.DataError, "complex"),
    ([["1", "two"]], kp.DataError, "'two'"),
    ([[1, None]], kp.DataError, "None"),
    ([[1, 2], [3]], kp.ShapeError, "ragged"),
    ([], kp.ShapeError, "rays"),
    ([[]], kp.ShapeError, "empty"),
    (np.zeros((0, 3)), kp.ShapeError, "empty"),
    (np.ones((2, 2, 2)), kp.ShapeError, "rays"),
    ([[1, 0], [0, 0], [0, 1]], kp.DataError, "row 1 is zero"),
    ([["1", "0"], ["0", "0/3"]], kp.DataError, "row 1 is zero"),
    ("abc", kp.DataError, "rays"),
    (5, kp.ShapeError, "rays is a single number"),
    (np.array(5.0), kp.ShapeError, "rays is a single number"),
    ({"a": 1}, kp.DataError, "rays"),
    (np.array([["a"]]), kp.DataError, "'a'"),
]


@pytest.mark.parametrize(("data", "error", "message"), BAD_DATA)
def test_bad_generators(data, error, message):
    with pytest.raises(error, match=message):
        PolyhedralCone(data)
    with pytest.raises(error, match=message.replace("rays", "normals")):
        PolyhedralCone.from_facets(data)


def test_other_kinds_of_numbers():
    expected = PolyhedralCone([[1, 0], [1, 3]])
    for rays in (
        np.array([[1, 0], [1, 3]], dtype=np.int8),
        np.array([[1, 0], [1, 3]], dtype=np.float32),
        np.array([[1, 0], [1, 3]], dtype=np.longdouble),
        [[Decimal(1), Decimal(0)], [Fraction(1, 3), 1]],
        [[10**200, 0], [10**200, 3 * 10**200]],
        sp.csr_array(np.array([[1.0, 0], [1, 3]])),
        np.ma.masked_array([[1.0, 0], [1, 3]]),
        [[True, False], [1, 3]],
    ):
        assert PolyhedralCone(rays) == expected


@pytest.mark.parametrize("x", [[1, 2, 3], [[1], [2]], 3, np.zeros((2, 2, 2)), [[1, 2], [3]], [], "ab"])
@pytest.mark.parametrize("X", [PAPER, orthant(2), product([orthant(1), PolyhedralCone([[-1]])])], ids=repr)
def test_bad_vectors(X, x):
    with pytest.raises((kp.ShapeError, kp.DataError), match="x"):
        X.contains(x)


def test_bad_operands():
    with pytest.raises(kp.DataError, match="nan"):
        orthant(2).contains([1, np.nan])
    for operation in (lambda X, Y: X & Y, lambda X, Y: X + Y, lambda X, Y: X.contains(Y)):
        with pytest.raises(kp.ConeMismatchError, match=r"2 and 3"):
            operation(PAPER, orthant(3))
        with pytest.raises((TypeError, kp.DataError)):
            operation(PAPER, {})
    with pytest.raises(TypeError):
        PAPER * 3
    with pytest.raises(kp.ShapeError, match="T is 2 x 3, but must have 2 columns"):
        PAPER.transform(np.ones((2, 3)))
    with pytest.raises(kp.DataError, match="T"):
        PAPER.transform([[1, np.nan], [0, 1]])
    with pytest.raises(kp.ShapeError):
        PAPER.transform(np.zeros((0, 2)))
    with pytest.raises(kp.DataError, match=r"factors\[1\] is a list"):
        product([PAPER, [1, 2]])
    with pytest.raises(kp.ShapeError, match="empty"):
        product([])
    for n in (2.0, "2", True, None):
        with pytest.raises(kp.DataError, match=r"n is .* whole number"):
            orthant(n)
    for n in (0, -1):
        with pytest.raises(kp.ShapeError, match="whole number, from 1"):
            orthant(n)
    for arguments in ({"n": 1}, {"n": 3, "facets": 2}, {"n": 2, "facets": 3}):
        with pytest.raises(kp.ShapeError):
            lorentz(**arguments)
    for arguments in ({"n": 3, "kind": "both"}, {"n": 2.5}, {"n": 3, "facets": 4.0}):
        with pytest.raises(kp.DataError):
            lorentz(**arguments)


def test_every_cone_is_a_cone():
    for X in (PAPER, orthant(1), product([PAPER] * 2), lorentz(3)):
        assert isinstance(X, Cone)
