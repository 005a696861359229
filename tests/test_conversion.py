"""Generators <-> facets against exact enumeration, on degenerate, thin and badly scaled cones."""

from fractions import Fraction
from itertools import combinations, product
from math import comb, gcd, lcm

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos.cones.conversion as conversion
import control_kpos.cones.hull as hull
import control_kpos.cones.polyhedral as polyhedral
from control_kpos.cones import PolyhedralCone, orthant
from control_kpos.errors import TooLargeError
from control_kpos.exact.linalg import normals


def primitive(row):
    common = gcd(*row)
    return tuple(x // common for x in row)


def solve(rows, n):
    """Exact null space of a list of integer rows, by fractions: an independent implementation."""
    work, pivots = [[Fraction(x) for x in row] for row in rows], []
    for column in range(n):
        at = next((i for i in range(len(pivots), len(work)) if work[i][column]), None)
        if at is None:
            continue
        k = len(pivots)
        work[k], work[at] = work[at], work[k]
        work[k] = [x / work[k][column] for x in work[k]]
        for i in range(len(work)):
            if i != k:
                work[i] = [a - work[i][column] * b for a, b in zip(work[i], work[k], strict=True)]
        pivots.append(column)
    basis = []
    for free in sorted(set(range(n)) - set(pivots)):
        x = [Fraction(0)] * n
        x[free] = Fraction(1)
        for k, column in enumerate(pivots):
            x[column] = -work[k][free]
        scale = lcm(*(v.denominator for v in x))
        basis.append(tuple(int(v * scale) for v in x))
    return basis


def brute_force(rays):
    """{facet normal: generators not on it} of a pointed, solid cone, from all (n - 1)-subsets of generators."""
    rays = [tuple(int(x) for x in row) for row in rays]
    n = len(rays[0])
    found = {}
    for subset in combinations(range(len(rays)), n - 1):
        null = solve([rays[i] for i in subset], n)
        if len(null) != 1:
            continue
        values = [sum(a * b for a, b in zip(null[0], ray, strict=True)) for ray in rays]
        for sign in (1, -1):
            if all(sign * v >= 0 for v in values):
                found[primitive([sign * x for x in null[0]])] = frozenset(i for i, v in enumerate(values) if v)
    return found


def facets_of(X):
    rows = X.exact_facets.rows_as_integers(np.arange(X.n_facets))
    return {primitive([int(x) for x in row]) for row in rows}


def rays_of(X):
    rows = X.exact_rays.rows_as_integers(np.arange(X.n_rays))
    return {primitive([int(x) for x in row]) for row in rows}


def integers(values):
    """Exact integer rows of doubles."""
    out = []
    for row in np.asarray(values, dtype=float):
        exact = [Fraction(float(x)) for x in row]
        scale = lcm(*(x.denominator for x in exact))
        out.append([int(x * scale) for x in exact])
    return out


def assert_matches_brute_force(rays):
    expected = brute_force(integers(rays))
    X = PolyhedralCone(rays)
    assert X.is_proper
    assert facets_of(X) == set(expected)
    used = rays_of(X)
    extreme = {
        primitive(row)
        for i, row in enumerate(integers(rays))
        if len(solve([h for h, off in expected.items() if i not in off], len(row))) == 1
    }
    assert used == extreme
    assert_incidence(X)
    return X


def assert_incidence(X):
    H = X.exact_facets.rows_as_integers(np.arange(X.n_facets))
    R = X.exact_rays.rows_as_integers(np.arange(X.n_rays))
    Z = H @ R.T
    assert (Z >= 0).all()
    assert ((Z == 0) == X.incidence).all()
    for exact in (X.exact_facets, X.exact_rays):
        if exact.radius is not None:
            ints = exact.rows_as_integers(np.arange(exact.shape[0]))
            for row, value, radius in zip(ints, exact.values, exact.radius, strict=True):
                k = int(np.argmax(np.abs(value)))
                # the scale of an exact row is any that fits: compare ratios with generous allowance
                scale = Fraction(float(value[k])) / int(row[k])
                slack = Fraction(float(radius[k])) / abs(Fraction(float(value[k])))
                for x, v, r in zip(row, value, radius, strict=True):
                    exact_x = scale * int(x)
                    assert abs(exact_x - Fraction(float(v))) <= Fraction(float(r)) + 2 * abs(exact_x) * slack


def homogenized(points):
    points = np.asarray(points)
    return np.concatenate([np.ones((len(points), 1), dtype=points.dtype), points], axis=1)


small = st.integers(-3, 3)


@st.composite
def generators(draw, n, most):
    """Integer generators of a solid, pointed cone: many coincidences, since entries are small."""
    rows = draw(st.lists(st.tuples(*[small] * (n - 1)), min_size=n, max_size=most))
    rays = np.array([(1, *row) for row in rows])
    flat = len(solve([[int(x) for x in r] for r in rays], n)) > 0
    if flat:
        rays = np.concatenate(
            [rays, homogenized(np.eye(n - 1, dtype=int)), homogenized(np.zeros((1, n - 1), dtype=int))]
        )
    shear = np.eye(n, dtype=int)
    shear[0, 1:] = draw(st.lists(small, min_size=n - 1, max_size=n - 1))
    return rays @ shear


@settings(max_examples=60)
@given(st.data(), st.sampled_from([2, 3, 4]))
def test_small_cones_match_enumeration(data, n):
    assert_matches_brute_force(data.draw(generators(n, 9)))


@settings(max_examples=15)
@given(generators(5, 9))
def test_five_dimensions_match_enumeration(rays):
    assert_matches_brute_force(rays)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_cubes(n):
    cube = homogenized(np.array(list(product([-1, 1], repeat=n - 1))))
    X = assert_matches_brute_force(cube) if n < 5 else PolyhedralCone(cube)
    assert (X.n_rays, X.n_facets) == (2 ** (n - 1), 2 * (n - 1))
    assert X.dual.dual is X and X.dual == PolyhedralCone.from_facets(cube)


def test_rotated_cubes_in_doubles_are_not_cubes():
    """Rounding splits faces, which ones depends on the machine: the answer is about the doubles given."""
    facets = []
    for seed in range(5):
        angle = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        rays = homogenized(np.array(list(product([-1.0, 1.0], repeat=3))) @ angle)
        facets.append(assert_matches_brute_force(rays).n_facets)
    assert min(facets) >= 6 and max(facets) > 6


def test_many_rays_on_one_facet_and_inside():
    grid = np.array(list(product(range(5), repeat=2)))
    base = np.concatenate([grid, np.zeros((25, 1), dtype=int)], axis=1)
    rays = homogenized(np.concatenate([base, [[0, 0, 1], [1, 1, 1], [2, 2, 0], [2, 1, 1]]]))
    X = assert_matches_brute_force(rays)
    assert X.incidence.sum(axis=1).max() == 4


def test_cross_polytope_and_simplex_times_square():
    cross = homogenized(np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)]))
    assert assert_matches_brute_force(cross).n_facets == 8
    simplex = np.array([[0, 0], [1, 0], [0, 1]])
    square = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    rays = homogenized(np.array([[*a, *b] for a in simplex for b in square]))
    assert assert_matches_brute_force(rays).n_facets == 7


def gale_facets(p, n):
    """Number of facets of the cyclic polytope with p vertices in R^(n - 1)."""
    d = n - 1
    if d % 2 == 0:
        return comb(p - d // 2, d // 2) + comb(p - d // 2 - 1, d // 2 - 1)
    return 2 * comb(p - d // 2 - 1, d // 2)


@pytest.mark.parametrize(("p", "n"), [(6, 3), (10, 4), (12, 5), (20, 6), (24, 7), (16, 8)])
def test_cyclic_polytopes(p, n):
    X = PolyhedralCone([[t**k for k in range(n)] for t in range(1, p + 1)])
    assert (X.n_rays, X.n_facets) == (p, gale_facets(p, n))
    assert (X.incidence.sum(axis=1) == n - 1).all()
    gaps = ~X.incidence
    for row in gaps:  # Gale evenness: an even number of vertices between any two missing ones
        assert (np.diff(np.flatnonzero(row)) % 2 == 1).all()


def test_cyclic_polytope_on_trigonometric_nodes():
    p, n = 24, 7
    t = 2 * np.pi * np.arange(p) / p
    rays = np.stack([np.ones(p), *(f(k * t) for k in (1, 2, 3) for f in (np.cos, np.sin))], axis=1)
    assert PolyhedralCone(rays).n_facets == gale_facets(p, n)


@pytest.mark.parametrize("opening", [1e-3, 1e-6, 1e-9, 1e-15])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_thin_cones(n, opening):
    rng = np.random.default_rng(n)
    section = rng.integers(-4, 5, size=(12, n - 1)) * opening
    assert_matches_brute_force(np.concatenate([np.full((12, 1), 0.75), 0.25 + section], axis=1))


@settings(max_examples=25)
@given(st.data(), st.sampled_from([2, 3, 4]))
def test_verdicts_do_not_depend_on_scale_order_or_repetition(data, n):
    rays = data.draw(generators(n, 8)).astype(float)
    X = PolyhedralCone(rays)
    power = st.sampled_from([-500, -20, 0, 1, 33, 480])
    of_rows = np.array(data.draw(st.lists(power, min_size=len(rays), max_size=len(rays))))
    scaled = PolyhedralCone(np.ldexp(rays, of_rows[:, None]))
    assert scaled == X and hash(scaled) == hash(X)
    assert (scaled.incidence == X.incidence).all()

    order = data.draw(st.permutations(range(len(rays))))
    again = np.concatenate([rays[order], 3 * rays, rays[:1] + rays[-1:]])
    assert PolyhedralCone(again) == X

    units = np.array(data.draw(st.lists(power, min_size=n, max_size=n)))
    Y = PolyhedralCone(np.ldexp(rays, units))
    assert (Y.n_rays, Y.n_facets) == (X.n_rays, X.n_facets)
    assert sorted(map(tuple, Y.incidence.tolist())) == sorted(map(tuple, X.incidence.tolist()))
    assert Y.contains(Y.interior_point, strict=True)


@pytest.mark.parametrize("unit", [1e-150, 1e-6, 3.0, 1e150])
def test_decimal_units(unit):
    rays = np.array([[1, 2, 0], [1, -1, 1], [1, 0, -1], [1, 1, 1]]) * [1, unit, 1 / unit]
    X = assert_matches_brute_force(rays)
    assert X.n_facets == 4
    assert_matches_brute_force(rays * unit)


def test_fractions_and_decimals_are_exact():
    X = PolyhedralCone([["1", "0.1"], ["1", "1/3"], ["10", "1"]])
    assert X.n_rays == 2
    assert facets_of(X) == {(-1, 10), (1, -3)}
    assert X.contains(["1", "0.1"]) and X.contains([1, Fraction(1, 3)])
    # the double 0.1 is above 1/10, the double 1 / 3 below
    assert PolyhedralCone([[1, 0.1], [1, 1 / 3], [10, 1]]).rays.tolist() == [[1, 1 / 3], [10, 1]]
    assert X.contains([1, 0.1], strict=True) and X.contains([1, 1 / 3], strict=True)


@settings(max_examples=60)
@given(st.integers(1, 4).flatmap(lambda n: st.lists(st.tuples(*[st.integers(-2, 2)] * n), min_size=1, max_size=6)))
def test_any_cone_is_described_from_both_sides(rows):
    rows = [row for row in rows if any(row)]
    if not rows:
        return
    X = PolyhedralCone(rows)
    n = len(rows[0])
    assert_incidence(X)
    dimension = n - len(solve(rows, n))
    assert X.is_solid == (dimension == n)
    H = X.exact_facets.rows_as_integers(np.arange(X.n_facets))
    lines = len(solve(H.tolist(), n))
    assert X.is_pointed == (lines == 0)
    back = PolyhedralCone.from_facets(X.facets) if X.n_facets else None
    if back is not None:
        assert back == X and back.is_pointed == X.is_pointed and back.is_solid == X.is_solid
    for point in product([-1, 0, 1], repeat=n):
        assert X.contains(point) == in_cone(rows, point)
        assert X.dual.contains(point) == all(np.dot(row, point) >= 0 for row in rows)


def in_cone(rows, x):
    """Caratheodory: x is a nonnegative combination of independent generators."""
    n = len(x)
    if not any(x):
        return True
    for k in range(1, n + 1):
        for subset in combinations(rows, k):
            columns = [list(c) + [-xi] for c, xi in zip(zip(*subset, strict=True), x, strict=True)]
            null = solve(columns, k + 1)
            if len(null) == 1 and null[0][-1] != 0:
                scale = null[0][-1]
                if all(v * scale >= 0 for v in null[0][:-1]):
                    return True
    return False


def test_lazy_normals_agree_with_exact_ones(monkeypatch):
    rng = np.random.default_rng(5)
    rays = homogenized(rng.normal(size=(14, 4)))
    X = PolyhedralCone(rays)
    monkeypatch.setattr(conversion, "_CHEAP", 0)
    Y = PolyhedralCone(rays)
    assert Y.exact_facets.integer_rows is not None
    assert facets_of(X) == facets_of(Y) == set(brute_force(integers(rays)))
    assert_incidence(Y)
    np.testing.assert_allclose(X.facets, Y.facets, rtol=1e-9)
    monkeypatch.setattr(conversion, "_POOR", 0.0)
    Z = PolyhedralCone(rays)
    assert_incidence(Z)


@pytest.mark.parametrize("n", [25, 40])
def test_large_simplicial_cones(n):
    rng = np.random.default_rng(n)
    rays = rng.normal(size=(n, n))
    X = PolyhedralCone(rays)
    assert X.is_simplicial
    assert (X.incidence == ~np.eye(n, dtype=bool)).all()
    assert_incidence(X)
    assert X.contains(X.interior_point, strict=True)
    assert PolyhedralCone.from_facets(X.dual.rays[:n]).n_rays == n
    dependent = rays.copy()
    dependent[-1] = dependent[0]
    assert not PolyhedralCone(dependent).is_solid


@pytest.mark.parametrize(
    ("rays", "is_simple"),
    [
        (np.tri(60), True),
        (np.tri(60) * 2.0 ** np.random.default_rng(0).integers(-400, 400, 60), True),
        (3 * np.eye(30) + np.ones((30, 30)), True),
        (np.eye(40), True),
        (np.eye(30) + np.eye(30, k=1) / 3, False),
        (np.tri(30) / 3, False),
    ],
)
def test_large_simplicial_cones_of_structure_have_exact_facets(rays, is_simple):
    X = PolyhedralCone(rays)
    assert X.is_simplicial and (X.exact_facets.radius is None) == is_simple
    assert_incidence(X)


def test_large_simplicial_cones_of_fractions():
    rows = [[Fraction(1, 3 + i) if i == j else Fraction(int(i == j + 1)) for j in range(30)] for i in range(30)]
    X = PolyhedralCone(rows)
    assert X.is_simplicial and X.contains(X.interior_point, strict=True)
    assert_incidence(X)
    units = 10.0 ** np.arange(-150, 150, 10)
    Y = PolyhedralCone((np.tri(30) + np.random.default_rng(0).random((30, 30))) * units)
    assert (
        Y.is_simplicial
        and Y.contains(Y.interior_point, strict=True)
        and Y.dual.contains(Y.dual.interior_point, strict=True)
    )
    assert_incidence(Y)


def test_cones_too_large_for_elimination_are_refused():
    rays = np.random.default_rng(0).normal(size=(250, 250))
    rays[-1] = rays[0] + rays[1]
    with pytest.raises(TooLargeError, match="250 vectors in dimension 250"):
        _ = PolyhedralCone(rays).facets


CYCLIC = [[t**k for k in range(8)] for t in range(-8, 9)]  # 572 facets


def test_work_is_limited_with_a_word_about_how_far_it_came(monkeypatch):
    monkeypatch.setattr(hull, "LIMIT", 64 * 800)
    with pytest.raises(TooLargeError, match=r"17 vectors in dimension 8 .* 1\d of the 17 alone have \d{3} simplicial"):
        _ = PolyhedralCone(CYCLIC).facets
    monkeypatch.setattr(hull, "LIMIT", 64 * 4000)
    assert PolyhedralCone(CYCLIC).n_facets == 572


def test_work_in_integers_is_limited(monkeypatch):
    cross = np.column_stack([np.ones(16), np.concatenate([np.eye(8), -np.eye(8)])])  # the cone over 256 facets
    rows = cross @ np.random.default_rng(0).integers(-9, 10, (9, 9))
    assert PolyhedralCone(rows).n_facets == 256
    monkeypatch.setattr(hull, "LIMIT", 256 * 9**2 * 1.2)  # normals in integers count a thousand times as much
    monkeypatch.setattr(
        hull.Hyperplanes, "approximate", lambda self, v: (np.zeros((len(v), 9)), np.full(len(v), np.inf))
    )
    with pytest.raises(TooLargeError, match="simplicial pieces"):
        _ = PolyhedralCone(rows).facets


def test_memory_is_limited(monkeypatch):
    monkeypatch.setattr(hull, "_ROOM", 400 * (17 + 16 * 8))
    with pytest.raises(TooLargeError, match="17 vectors"):
        _ = PolyhedralCone(CYCLIC).facets
    before = hull.ALLOWANCE.set(hull.Allowance(np.inf))  # any amount, as for files that are trusted
    assert PolyhedralCone(CYCLIC).n_facets == 572
    hull.ALLOWANCE.reset(before)


def test_a_refusal_is_remembered(monkeypatch):
    X = PolyhedralCone(CYCLIC)
    monkeypatch.setattr(hull, "LIMIT", 1000)
    with pytest.raises(TooLargeError):
        _ = X.facets
    monkeypatch.setattr(polyhedral, "convert", lambda _: pytest.fail("it tries again"))
    for question in (lambda: X.facets, lambda: X.dual.rays, lambda: X.incidence):
        with pytest.raises(TooLargeError, match="17 vectors"):
            question()
    assert X.is_proper and X.n_rays == 17  # needs no facets


def test_less_is_allowed_for_a_while(monkeypatch):
    X = PolyhedralCone(CYCLIC)
    before = hull.ALLOWANCE.set(hull.Allowance(1000))
    with pytest.raises(TooLargeError):
        _ = X.facets
    hull.ALLOWANCE.reset(before)
    assert X.n_facets == 572


def test_normals_of_many_hyperplanes_at_once():
    rng = np.random.default_rng(0)
    for n in range(1, 7):
        stack = rng.integers(-2, 3, (200, n - 1, n)).astype(object)
        for S, h in zip(stack, normals(stack), strict=True):
            null = solve(S.tolist(), n)
            assert any(h) == (len(null) == 1)
            assert not any(h) or primitive(h) in {primitive(null[0]), primitive([-x for x in null[0]])}


def test_orthant_from_rays():
    assert PolyhedralCone(np.eye(4)) == orthant(4) == PolyhedralCone.from_facets(2 * np.eye(4))
    np.testing.assert_array_equal(PolyhedralCone(np.eye(3)).facets, np.eye(3))
