"""Cones between the columns of B and the half-spaces of C."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from planted import generators, metzler_hurwitz
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import ConeMismatchError, DataError, TimebaseError
from control_kpos.exact.matrix import Matrix
from control_kpos.find import find_cone


def externally_positive(seed: int, n: int, margin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, b, c) whose impulse response, relative to its dominant mode, has minimum / maximum = margin."""
    rng = np.random.default_rng(seed)
    while True:
        A = rng.standard_normal((n, n)) / np.sqrt(n)
        values, V = np.linalg.eig(A)
        first = int(np.argmax(values.real))
        gap = np.sort(values.real[first] - values.real)[1]
        if values[first].imag != 0 or gap < 0.05:
            continue
        b, c = rng.standard_normal(n), rng.standard_normal(n)
        residues = (c @ V) * np.linalg.solve(V, b)
        rest = np.arange(n) != first
        t = np.linspace(0, 20 / gap, 4000)
        transient = (np.exp(np.outer(t, values[rest] - values[first])) * residues[rest]).sum(axis=1).real
        if transient.min() >= 0:
            continue
        level = (margin * transient.max() - transient.min()) / (1 - margin)
        e, left = V[:, first].real, np.linalg.inv(V)[first].real
        b = b + e * (1 - left @ b)
        c = c + left * (level - c @ e)
        return A, b, c


@pytest.mark.parametrize("margin", [0.01, 0.1])
@pytest.mark.parametrize("n", [2, 3, 4, 6, 8, 12])
def test_externally_positive_systems_have_a_proven_cone(n, margin):
    for seed in range(3):
        A, b, c = externally_positive(seed, n, margin)
        found = find_cone(ct.ss(A, b[:, None], c[None, :], 0))
        assert found and found.certificate.check()
        rays = found.certificate.rays.values
        assert (rays @ c >= -1e-12 * np.linalg.norm(rays, axis=1) * np.linalg.norm(c)).all()
        if n <= 3 and found.n_rays <= 40:
            assert found.cone.contains(b)
            assert kp.cone_positivity(A, b[:, None], c[None, :], [[0]], found.cone, kp.orthant(1), kp.orthant(1))


def test_the_result_goes_straight_into_a_network():
    node = ct.ss([[0, 1], [-2, -3]], [[0], [1]], [[1, 0]], 0)
    X = find_cone(node).cone
    sys = kp.ConeStateSpace(node, X=X)
    assert sys.is_cone_positive()
    net = kp.feedback_interconnect([sys] * 3, 0.3 * (np.ones((3, 3)) - np.eye(3)))
    assert net.certificate


def test_planted_input_and_output_cones():
    rng = np.random.default_rng(0)
    for n in (2, 3, 5):
        T = generators(rng, n)
        A = T @ metzler_hurwitz(rng, n) @ np.linalg.inv(T)
        B, C = T @ rng.uniform(0.2, 1, (n, 2)), rng.uniform(0.2, 1, (2, n)) @ np.linalg.inv(T)
        found = find_cone(A, contains=B.T, within=C)
        assert found and found.certificate.check()


def test_discrete_time_orbits():
    sys = ct.ss([[0.9, 0], [0, 0.2]], [[1], [-0.5]], [[1, 1]], 0, True)
    found = find_cone(sys)
    assert found and found.certificate.discrete and found.certificate.check()


@pytest.mark.parametrize(
    ("numerator", "denominator", "word"),
    [
        ([1, -1], [1, 3, 2], "zero 1 "),
        ([1, 0, 0], [1, 6, 11, 6], "zero 0 "),
        ([1, 0.2, 1.01], [1, 6, 11, 6], "impulse response"),
    ],
)
def test_obstruction_by_zeros_and_by_the_impulse_response(numerator, denominator, word):
    found = find_cone(ct.ss(ct.tf(numerator, denominator)))
    assert found.status is kp.Status.REFUTED and word in found.explain()
    assert found.certificate.check()
    harmless = replace(found.obstruction, normal=-found.obstruction.normal)
    if found.obstruction.value < 0:
        assert not replace(found.certificate, witness=harmless).check()


def test_negative_impulse_response_in_discrete_time():
    found = find_cone(ct.ss([[0.5, 0], [0, -0.5]], [[1], [1]], [[1, 2]], 0, True))
    assert found.status is kp.Status.REFUTED and "k = 1" in found.explain()


def test_a_changed_containment_fails():
    found = find_cone(ct.ss([[0, 1], [-2, -3]], [[0], [1]], [[1, 0]], 0))
    cert = found.certificate
    assert not replace(cert, contains=Matrix(np.array([[0.0, -1.0]]))).check()
    assert not replace(cert, within=Matrix(np.array([[-1.0, 0.0]]))).check()


def test_bad_input_is_named():
    A = [[-1, 0], [0, -2]]
    with pytest.raises(ConeMismatchError, match=r"column 0 of B.*row 1 of C"):
        find_cone(A, contains=[[1, 1]], within=[[1, 0], [1, -2]])
    with pytest.raises(ConeMismatchError, match="size 3, but A is 2 x 2"):
        find_cone(A, contains=[[1, 1, 1]])
    fast = [[0, 0, 0], [0, -1, -5], [0, 5, -1]]
    for question in ({"A": [fast, np.eye(3)]}, {"A": fast, "contains": [[1, 2, 0]]}):
        with pytest.raises(DataError, match=r"max_rays is 3, but every .* at least 16 rays"):
            find_cone(**question, max_rays=3, time_limit=1)
    for wrong in ({"seed": 1.5}, {"restarts": -1}, {"time_limit": 0}, {"max_rays": 0}, {"discrete": "no"}):
        with pytest.raises(DataError, match=next(iter(wrong))):
            find_cone(A, **wrong)
    with pytest.raises(TimebaseError, match="discrete"):
        find_cone(ct.ss(A, [[1], [1]], [[1, 1]], 0), discrete=True)


def test_high_relative_degree_on_the_orthant():
    # c'b = c'Ab = 0 exactly: every orbit starts on the boundary, where no rounding is allowed
    chain = ct.ss([[-1, 0, 0], [1, -2, 0], [0, 1, -3]], [[1], [0], [0]], [[0, 0, 1]], 0)
    found = find_cone(chain)
    assert found and found.certificate.check() and found.cone == kp.orthant(3)


S = ct.tf("s")


@pytest.mark.parametrize(
    "transfer",
    [
        1 / (S + 1) ** 2,  # a repeated dominant eigenvalue
        1 / (S + 1) ** 4,
        (S + 3) / ((S + 1) ** 2 * (S + 2)),
        1 / ((S + 1) * (S + 2) ** 2),  # a repeated eigenvalue behind it
        (S + 4) / ((S + 1) * (S + 2) ** 3),
        1 / ((S + 1) * (S + 2) * (S + 3)),  # relative degree 3
        1 / ((S + 1) * ((S + 2) ** 2 + 1)),  # with a complex pair: the first step is exact
        1 / ((S + 1) * (S + 2) * ((S + 3) ** 2 + 2)),
        1 / ((S + 1) * ((S + 2) ** 2 + 1) ** 2),  # a repeated complex pair, and relative degree 5
        1 / (S * (S + 1) ** 2),
    ],
)
def test_textbook_transfer_functions(transfer):
    sys = ct.ss(transfer)
    found = find_cone(sys)
    assert found and found.certificate.check()
    assert kp.cone_positivity(sys.A, sys.B, sys.C, sys.D, found.cone, kp.orthant(1), kp.orthant(1))


def test_a_discrete_time_chain_of_delays():
    sys = ct.ss([[0, 0, 0.2], [1, 0, -0.1], [0, 1, 0.7]], [[1], [0], [0]], [[0, 0, 1]], 0, True)
    found = find_cone(sys)
    assert found and found.certificate.check()
    assert kp.cone_positivity(sys.A, sys.B, sys.C, sys.D, found.cone, kp.orthant(1), kp.orthant(1), discrete=True)


TOUCHING = {
    "fault": ([1, "1/2", "-1/2"], [1, -1, 1]),  # 1, 0, 1, 3/4, ...
    "two zeros": ([1, "2/5", "1/5"], [1, -25, 75]),  # 51, 6, 0, 0, 0.48, ...
    "nearly": ([1, "2/5", "1/5"], [1, -25, "75.0000000001"]),
    "barely": ([1, "2/5", "1/5"], [1, -25, "75.001"]),
    "slow": (["1/3", "3/10", "4/15"], [1, -4, "4.5"]),
    "zero at first": ([2, "1/2", "-1/2"], [1, -2, 1]),
    "ends": ([1, "1/2", 0], [1, -2, 5]),  # 4, 0, 1/2, ...
    "four modes": ([1, "1/2", "1/4", "-1/4"], [1, -4, 4, "-1/2"]),
}


@pytest.mark.parametrize("name", TOUCHING)
def test_responses_in_discrete_time_may_touch_zero(name, tmp_path):
    """Powers are exact: c'A^k b = 0 is no obstacle, in any coordinates; and 1e-12 below zero there is no cone."""
    poles, c = ([Fraction(x) for x in row] for row in TOUCHING[name])
    n = len(c)
    A = np.array([[x if i == j else Fraction(0) for j in range(n)] for i, x in enumerate(poles)], dtype=object)
    b, T = np.array([Fraction(1)] * n, dtype=object), np.tri(n, dtype=int) - np.eye(n, k=-1, dtype=int)
    turned, inverse = similar_by(A, T), np.array(np.rint(np.linalg.inv(T)), dtype=int)
    for M, x, f in ((A, b, np.array(c)), (turned, T @ b, np.array(c) @ inverse)):
        found = find_cone(M.tolist(), contains=[x.tolist()], within=[f.tolist()], discrete=True)
        assert found and found.check() and found.cone.contains(x.tolist())
        assert kp.cone_positivity(
            M, x[:, None], f[None], [[0]], found.cone, kp.orthant(1), kp.orthant(1), discrete=True
        )
        found.save(tmp_path / "cone.json")
        assert checker.main(tmp_path / "cone.json") == 0
    lowest = min(sum(w * p**k for w, p in zip(c, poles, strict=True)) for k in range(30))
    assert lowest >= 0
    below = [c[0] - (lowest + Fraction(1, 10**12)), *c[1:]]  # lower by as much at the lowest, if the first pole is 1
    if poles[0] == 1:
        assert find_cone(A.tolist(), contains=[[1] * n], within=[below], discrete=True).status is kp.Status.REFUTED


def similar_by(A, T):
    """T A T^-1 for T with an integer inverse."""
    return T @ A @ np.array(np.rint(np.linalg.inv(T)), dtype=int)


def test_several_responses_in_discrete_time_touch_zero():
    A = np.diag([1, 0.5, -0.5])
    found = find_cone(
        A, contains=[[1, 1, 1], [1, 0, 0], [1, -1, 0]], within=[[1, -1, 1], [1, 0, 0], [2, 1, -1]], discrete=True
    )
    assert found and found.check()
    rays = found.certificate.rays.values
    assert (rays @ np.array([[1, -1, 1], [1, 0, 0], [2, 1, -1]]).T >= 0).all()


def narrow(margin: float) -> ct.StateSpace:
    """Impulse response e^(-t) (1 + margin + a e^(-0.05 t) cos 2 t), close to 0 at one time."""
    A = np.array([[-1.0, 0, 0], [0, -1.05, -2], [0, 2, -1.05]])
    t = np.linspace(0, 6, 60001)
    wave = np.exp(-0.05 * t) * np.cos(2 * t)
    return ct.ss(A, [[1], [1], [0]], [[margin - wave.min(), 1, 0]], 0)


def test_thousands_of_rays_have_a_sparse_proof(tmp_path):
    found = find_cone(narrow(5e-3))
    cert = found.certificate
    assert found and cert.multipliers.is_sparse and found.n_rays > 600
    P, R = cert.multipliers.values, cert.rays.values
    assert np.allclose(R @ cert.matrices.values[0].T, P.T @ R, atol=1e-8 * abs(P).max())
    for change in (
        {"multipliers": Matrix(P * (1 + 1e-6))},
        {"multipliers": Matrix(-P)},
        {"right_inverse": 0 * cert.right_inverse},
        {"rays": Matrix(R[::-1])},
        {"matrices": Matrix(cert.matrices.values - 1e-3)},
    ):
        assert not replace(cert, **change).check()
    upper = P.tolil()
    upper[0, 1] = -1e-9  # a negative multiplier far from what takes up rounding
    assert not replace(cert, multipliers=Matrix(upper.tocsr())).check()
    with pytest.raises(DataError, match="one matrix"):
        replace(cert, matrices=Matrix(np.concatenate([cert.matrices.values] * 2))).conditions()
    cert.save(tmp_path / "cone.npz")
    assert kp.load_certificate(tmp_path / "cone.npz").check()


def test_as_many_rays_as_the_least_value_of_the_response_asks_for():
    # an orbit passes a minimum of height m at time t in about t^2 f''/ (2 m) steps
    assert find_cone(narrow(0.02)).n_rays < find_cone(narrow(0.002)).n_rays < 12 * find_cone(narrow(0.02)).n_rays


@pytest.mark.parametrize("height", [0.01, 0.1, 1.0])
@pytest.mark.parametrize(("gap", "frequency"), [(0.02, 5.0), (0.05, 2.0), (0.1, 0.3), (1.0, 5.0)])
def test_slow_oscillations(gap, frequency, height):
    # long steps would feed the oscillation; and a vector may lie inside a core with hundreds of rays
    t = np.linspace(0, 2 * np.pi / frequency, 10001)
    lowest = -(np.exp(-gap * t) * np.cos(frequency * t)).min()
    A = [[-1, 0, 0], [0, -1 - gap, -frequency], [0, frequency, -1 - gap]]
    found = find_cone(ct.ss(A, [[1], [1], [0]], [[lowest + height, 1, 0]], 0))
    assert found and found.certificate.check() and found.n_rays < 4000


@pytest.mark.parametrize("name", ["contains", "within"])
@pytest.mark.parametrize("rows", [[[0, 1], [0, -1]], [[1, 0], [-1, 1], ["-1/3", "-1"]]])
def test_vectors_that_leave_a_cone_no_room_are_refused(name, rows):
    """A cone that holds b and -b is not pointed; one between two opposite half-spaces is not solid."""
    with pytest.raises(kp.ConeMismatchError, match=f"of {name} with positive weights is zero"):
        kp.find_cone([[0, 1], [-1, -3]], **{name: rows})


def redundant(seed: int, n: int) -> ct.StateSpace:
    """Real distinct modes whose impulse response nearly touches 0: orbits of hundreds of generators."""
    rng = np.random.default_rng(seed)
    T = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A = np.diag(-np.arange(1.0, n + 1))
    b, c = np.ones(n), np.array([1, -4, 4.003] + [0.0] * (n - 3))
    return ct.ss(T @ A @ T.T, (T @ b)[:, None], (T @ c)[None], 0)


DIAGONAL = ct.ss(np.diag([-1.0, -2, -3]), np.ones((3, 1)), [[1, -4, 4.003]], 0)


@pytest.mark.parametrize("s", [DIAGONAL, redundant(0, 3), redundant(1, 4), narrow(5e-3)])
def test_a_found_cone_has_one_description(s, tmp_path):
    """Redundant generators of the proof are none of the cone: rays, facets, incidence, equality, counts agree."""
    found = kp.find_cone(s)
    X, proven = found.cone, found.certificate
    again = kp.PolyhedralCone(X.rays)
    for one, other in ((again, X), (X, kp.PolyhedralCone(proven.rays.values[::-1])), (again.dual, X.dual)):
        assert one == other and hash(one) == hash(other)
        assert (one.n_rays, one.n_facets) == (other.n_rays, other.n_facets)
    assert (again * again) == kp.product([X, X])
    assert -again == -X and X & again == X
    assert found.n_rays == X.n_rays == len(found.rays) == again.n_rays <= proven.rays.shape[0]
    assert X.incidence.shape == X.dual.incidence.T.shape == (X.n_facets, X.n_rays)
    assert np.array_equal(X.incidence, again.incidence) and (X.incidence.sum(axis=0) >= X.dim - 1).all()
    rows = X.exact_rays.fractions()
    doubled = kp.PolyhedralCone(np.vstack([rows, 2 * rows[:3], rows[:1] + rows[1:2]]))
    assert doubled == X and np.array_equal(doubled.rays, X.rays)
    assert kp.ConeStateSpace(s, X=X).is_cone_positive() and kp.linear_lyapunov(s.A, X)
    found.save(tmp_path / "cone.npz")
    assert kp.PolyhedralCone(kp.load_certificate(tmp_path / "cone.npz").rays) == X


def test_redundant_generators_are_found_where_facets_are_many():
    """In eight dimensions, by linear programs; what is dropped is a combination of the others."""
    A, b, c = externally_positive(1, 8, 0.001)
    found = find_cone(ct.ss(A, b[:, None], c[None, :], 0))
    given, kept = found.certificate.rays.values, found.rays
    dropped = [x for x in given.tolist() if x not in kept.tolist()]
    assert dropped and len(kept) + len(dropped) == len(given)
    for x in dropped:
        assert nnls(kept.T, np.array(x))[1] < 1e-9 * np.linalg.norm(x)


def test_redundant_generators_of_very_many_are_found_in_three_dimensions():
    found = find_cone(narrow(5e-4))
    X, given = found.cone, found.certificate.rays.values
    assert 3000 < X.n_rays < len(given) and kp.PolyhedralCone(X.rays) == X
    kept = {tuple(x) for x in X.rays.tolist()}
    dropped = np.array([x for x in given.tolist() if tuple(x) not in kept])
    section = [x[:, 1:] / x[:, :1] for x in (X.rays, dropped)]  # the dominant direction is the first
    hull = ConvexHull(section[0])
    assert (section[1] @ hull.equations[:, :2].T + hull.equations[:, 2] < 1e-12).all()


def test_cones_of_the_same_generators_are_equal_at_any_size():
    X = find_cone([[-1e-4, 1, 0], [-1, -1e-4, 0], [0, 0, 0]]).cone
    assert X.n_rays > 30_000 and kp.PolyhedralCone(X.rays[::-1]) == X
