"""Cones for one matrix: existence decided both ways, and proofs that check themselves."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planted import pair, similar, with_dominant_eigenvalue
from scipy.linalg import block_diag

from control_kpos import (
    PolyhedralCone,
    Status,
    load_certificate,
    state_positivity,
)
from control_kpos.errors import DataError, ShapeError
from control_kpos.exact.enclosure import Generators
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.polynomials import (
    multiply,
    rational_roots,
    square_free_factors,
)
from control_kpos.find import ConeCertificate, find_cone
from control_kpos.find.impossible.existence import SpectralObstruction
from control_kpos.find.one_matrix.modes import analysis

# -- a cone exists


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 12, 30])
def test_a_strictly_dominant_real_eigenvalue_has_a_proven_cone(n, discrete):
    for seed in range(3):
        A = with_dominant_eigenvalue(seed, n, discrete=discrete)
        found = find_cone(A, discrete=discrete)
        assert found.status is Status.PROVED
        assert found.cone.n_rays == found.n_rays >= found.fewest_rays >= n
        assert found.cone.is_proper and found.certificate.check()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 4), st.booleans())
def test_facets_agree_with_the_proof_from_generators(seed, n, discrete):
    A = with_dominant_eigenvalue(seed, n, discrete=discrete)
    found = find_cone(A, discrete=discrete)
    if found.n_rays > 40 or not found:
        return
    X = PolyhedralCone(found.rays)
    assert X.is_proper and X.n_rays == found.n_rays
    assert state_positivity(A, X, discrete=discrete)


def test_an_all_real_spectrum_has_a_simplicial_cone():
    rng = np.random.default_rng(0)
    for n in range(1, 12):
        T = np.linalg.qr(rng.standard_normal((n, n)))[0]
        found = find_cone(T @ np.diag(-np.arange(n, dtype=float)) @ T.T)
        assert found and found.n_rays == n and found.cone.is_simplicial


@pytest.mark.parametrize(("ratio", "rays"), [(0.5, 3), (1.0, 4), (1.1, 5), (5.0, 16), (20.0, 63)])
def test_a_pair_needs_the_polygon_of_dmitriev_and_dynkin(ratio, rays):
    found = find_cone(pair(1.0, ratio))
    assert found.fewest_rays == rays
    assert found and rays <= found.n_rays <= rays + (ratio == 1.0)  # tan(pi/4) = 1: no room for rounding


@pytest.mark.parametrize("few", ["rays", "facets"])
def test_fewer_than_the_modes_give_on_request(few):
    rng = np.random.default_rng(6)
    done = 0
    while done < 3:
        n = 6
        metzler = rng.random((n, n)) * (rng.random((n, n)) < 0.6) - np.diag(3 * rng.random(n))
        T = rng.standard_normal((n, n))
        if np.linalg.cond(T) > 100 or np.iscomplex(np.linalg.eigvals(metzler)).sum() < 4:
            continue
        found = find_cone(T @ metzler @ np.linalg.inv(T), max_rays=n, few=few, time_limit=20)
        assert found and found.n_rays == n and found.cone.is_simplicial and found.certificate.check()
        done += 1
    cyclic = with_dominant_eigenvalue(11, 8, discrete=False)
    free = find_cone(cyclic)
    fewer = find_cone(cyclic, max_rays=free.n_rays - 1, time_limit=5, few=few)
    assert fewer.status is Status.UNDECIDED or fewer.n_rays < free.n_rays


def test_few_facets_on_request():
    A = with_dominant_eigenvalue(3, 5, discrete=False)
    found = find_cone(A, few="facets")
    assert found and found.certificate.check()
    assert found.cone.n_facets == found.n_rays
    assert state_positivity(A, found.cone)


@pytest.mark.parametrize("discrete", [False, True])
def test_exactly_defective_and_repeated_dominant_eigenvalues(discrete):
    J = np.diag([1.0, 1, 1, 1, 1]) + np.diag([1.0, 0, 1, 0], 1)
    for A in (J, np.eye(3), np.zeros((2, 2)), np.diag([1.0, 1, 0.5])):
        found = find_cone(A, discrete=discrete)
        assert found and found.certificate.check()
        assert state_positivity(A, PolyhedralCone(found.certificate.rays), discrete=discrete)


def test_double_integrator_has_a_cone_without_margin():
    found = find_cone([[0, 1], [0, 0]])
    assert found and found.margin == 0
    assert not find_cone([[0, 1], [-1e-300, 0]])


def test_roots_of_unity_in_discrete_time():
    for A in (np.roll(np.eye(4), 1, axis=0), np.diag([1.0, -1, 0.5]), [[1, 0, 0], [0, 0, -1], [0, 1, 0]]):
        found = find_cone(A, discrete=True)
        assert found and state_positivity(A, PolyhedralCone(found.certificate.rays), discrete=True)


def test_exact_data_are_kept_exactly():
    found = find_cone([["1/3", "0"], ["1/7", "-21.3"]])
    assert found and found.certificate.matrices.numerators is not None


ROOT = np.array([[0, 2], [1, 0]])  # eigenvalues +- sqrt(2)
CHAIN = np.block([[ROOT, np.eye(2, dtype=int)], [0 * ROOT, ROOT]])
BEHIND = np.array([[-2, -3], [3, -2]])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("blocks", [(ROOT, ROOT), (CHAIN,), (CHAIN, ROOT), (ROOT, ROOT, BEHIND), (CHAIN, BEHIND)])
def test_repeated_irrational_dominant_eigenvalues(blocks, seed):
    # a cone exists whatever the Jordan structure: every eigenvalue of that real part is that number
    found = find_cone(similar(block_diag(*blocks), seed))
    assert found and found.certificate.check() and found.margin == 0
    assert found.n_rays <= sum(map(len, blocks)) + 2 and found.fewest_rays <= found.n_rays


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_repeated_rational_dominant_eigenvalues(seed, discrete):
    # the other eigenvalues are as often repeated, in chains of other lengths
    chain, turning = np.array([[1, 1], [0, 1]]), np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    for blocks in ((chain, -np.eye(2, dtype=int)), (chain, [[0]], turning - 2 * np.eye(3, dtype=int))):
        A = similar(block_diag(*blocks), seed)
        if discrete:
            A = [[(x + 3 * (i == j)) / 4 for j, x in enumerate(row)] for i, row in enumerate(A)]
        found = find_cone(A, discrete=discrete)
        assert found and found.check() and found.fewest_rays <= found.n_rays


TURNING = np.array([[0, -1], [1, 0]])  # eigenvalues +- i


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("behind", [(), ([[0]],), ([[0]], np.array([[0, 1], [0, 0]]))])
@pytest.mark.parametrize("others", [(-np.eye(1, dtype=int),), (-np.eye(1, dtype=int), TURNING)])
def test_chains_of_one_length_all_around_the_circle(others, behind, seed):
    for length in (2, 3):
        step = np.eye(length, k=1, dtype=int)
        around = [np.kron(np.eye(length, dtype=int), z) + np.kron(step, np.eye(len(z), dtype=int)) for z in others]
        A = block_diag(np.eye(length, dtype=int) + step, *around, *behind)
        A = similar(A, seed) if length == 2 else A  # computed roots of chains of three are far apart
        found = find_cone(A, discrete=True)
        assert found and found.check() and state_positivity(A, found.cone, discrete=True)
    longer = block_diag(
        np.eye(2, dtype=int) + np.eye(2, k=1, dtype=int), np.eye(3, k=1, dtype=int) - np.eye(3, dtype=int)
    )
    assert find_cone(longer, discrete=True).status is Status.REFUTED


def test_an_irrational_eigenvalue_and_its_negative_in_discrete_time():
    for A in (ROOT, block_diag(ROOT, ROOT), CHAIN):
        assert find_cone(A, discrete=True)
    assert find_cone(-ROOT, discrete=True).status is not Status.PROVED


# -- no cone exists


def test_imaginary_pair_beside_the_dominant_eigenvalue_is_refuted():
    found = find_cone(pair(0.0, 1.0))
    assert found.status is Status.REFUTED and found.cone is None
    assert found.obstruction.kind == "beside" and "not polyhedral" in found.explain()
    assert found.certificate.check()
    # moved by the smallest amount there is, the pair is ahead of or behind the real eigenvalue
    assert find_cone(pair(-(2.0**-40), 1.0)).status is Status.REFUTED
    assert find_cone(pair(2.0**-40, 1.0)).status is Status.UNDECIDED  # needs 10^12 rays


@pytest.mark.parametrize("n", [2, 4, 9])
def test_a_rightmost_pair_is_refuted(n):
    rng = np.random.default_rng(n)
    done = 0
    while done < 5:
        A = rng.standard_normal((n, n))
        values = np.linalg.eigvals(A)
        if values[np.argmax(values.real)].imag == 0:
            continue
        found = find_cone(A)
        assert found.status is Status.REFUTED and found.certificate.check()
        assert abs(found.obstruction.imag) > 0
        done += 1


def test_a_continuous_time_cone_without_a_discrete_time_one():
    A = np.diag([-1.0, 0.5])
    assert find_cone(A)
    refuted = find_cone(A, discrete=True)
    assert refuted.status is Status.REFUTED and refuted.certificate.check()


def test_a_rational_rotation_that_is_no_root_of_unity():
    A = [["1", "0", "0"], ["0", "3/5", "-4/5"], ["0", "4/5", "3/5"]]
    found = find_cone(A, discrete=True)
    assert found.status is Status.REFUTED and "root of unity" in found.explain()


def test_a_50_gon_is_not_invariant_under_a_rotation_by_one_radian():
    angle = 2 * np.pi * np.arange(50) / 50
    X = PolyhedralCone(np.column_stack([np.ones(50), np.cos(angle), np.sin(angle)]))
    A = np.array([[1, 0, 0], [0, np.cos(1), -np.sin(1)], [0, np.sin(1), np.cos(1)]])
    assert state_positivity(A, X, discrete=True).status is Status.REFUTED
    rays = Matrix(X.rays)
    P = np.linalg.lstsq(X.rays.T, A @ X.rays.T, rcond=None)[0]
    cert = ConeCertificate.settle(
        matrices=Matrix(A[None]),
        discrete=True,
        rays=rays,
        multipliers=Matrix(P[None]),
        pointing=np.array([1.0, 0, 0]),
        right_inverse=np.linalg.pinv(X.rays.T),
    )
    assert cert.status is Status.UNDECIDED


def test_a_repeated_eigenvalue_does_not_hide_a_larger_one():
    # +-1, +-i and 0 three times: a cone exists, whatever a witness at 0 says
    A = block_diag([[0, 1], [-1, 0]], np.zeros((3, 3)), 1, -1).astype(float)
    assert find_cone(A).status is Status.PROVED
    for kind in ("beside", "ahead"):
        witness = SpectralObstruction(0, kind, Fraction(0), 0.0, 1.0, False)
        assert not witness.conditions(Matrix.stack([Matrix(A)]), discrete=False)[0].verdict()
        assert ConeCertificate.settle(matrices=Matrix.stack([Matrix(A)]), witness=witness).status is Status.UNDECIDED


def test_a_lyapunov_vector_is_not_claimed_where_it_is_not_proven():
    found = find_cone([[-1.0, 0.5], [0.25, -2.0]])
    forged = replace(found.certificate, by_facets=True, v=np.array([1.0, 1.0]))
    assert not forged.check()


# -- certificates


def test_perturbed_certificates_fail():
    A = with_dominant_eigenvalue(1, 4, discrete=False)
    cert = find_cone(A).certificate
    assert cert.check()
    P = cert.multipliers.values
    for change in (
        {"multipliers": Matrix(-P)},
        {"multipliers": Matrix(P + 1e-3)},
        {"pointing": -cert.pointing},
        {"right_inverse": 2.5 * cert.right_inverse},
        {"matrices": Matrix(-cert.matrices.values)},
        {"rays": Matrix(cert.rays.values[::-1])},
        {"discrete": True},
    ):
        assert not replace(cert, **change).check()
    assert not replace(find_cone(pair(0.0, 1.0)).certificate, matrices=Matrix(pair(1.0, 1.0)[None])).check()


def test_rays_that_span_everything_prove_nothing():
    # A R = R P with P >= 0 is solvable for any A if the rays positively span the space
    A = np.array([[0.0, 1.0], [-1.0, 0.0]])
    rays = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
    P = np.maximum(0, rays @ A @ rays.T) + 1.0
    P = P - 0.0
    assert np.allclose(rays.T @ P, A @ rays.T)
    cert = ConeCertificate.settle(
        matrices=Matrix(A[None]),
        rays=Matrix(rays),
        multipliers=Matrix(P[None]),
        pointing=np.array([1.0, 1.0]),
        right_inverse=np.linalg.pinv(rays.T),
    )
    assert cert.status is Status.UNDECIDED  # not pointed


def test_certificates_survive_a_file(tmp_path):
    for found in (find_cone(pair(1.0, 5.0)), find_cone(pair(0.0, 1.0)), find_cone([[0, 1], [0, 0]])):
        found.certificate.save(tmp_path / "cone.json")
        assert load_certificate(tmp_path / "cone.json").status is found.certificate.status


@pytest.mark.parametrize("power", [-300, 300])
def test_units_change_no_verdict(power):
    A = with_dominant_eigenvalue(5, 3, discrete=False)
    units = np.ldexp(1.0, [0, power, -power // 2])
    assert find_cone(A * units / units[:, None])


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("length", [2, 3, 4])
def test_defective_modes_behind_a_simple_dominant_one(length, discrete):
    chain = np.diag(np.full(length, 0.1 if discrete else -1.0)) + np.eye(length, length, 1) * (0.3 if discrete else 1.0)
    A = np.block([[np.ones((1, 1)), np.zeros((1, length))], [np.zeros((length, 1)), chain]])
    turn = np.linalg.qr(np.random.default_rng(length).standard_normal(A.shape))[0]
    for matrix in (A, turn @ A @ turn.T):
        found = find_cone(matrix, discrete=discrete)
        assert found and found.n_rays == length + 1 and found.conditioning < 1e5


def test_nearly_defective_matrices_are_never_flat_successes():
    for size in (1e-4, 1e-9, 1e-13):
        A = np.diag([1.0, 0, 0, 0]) + np.diag([0, 1.0, 1.0], 1)
        A[3, 1] = size
        found = find_cone(A)
        assert found.conditioning <= 1e12 if found else found.status is Status.UNDECIDED


def with_eigenvectors(seed: int, n: int, conditioning: float) -> np.ndarray:
    """Eigenvalue 1 and others with real part below 0.9, eigenvectors of the given condition number."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(2))
    V = left * np.geomspace(1, 1 / conditioning, n) @ right
    modes = np.diag(np.concatenate([[1.0], rng.uniform(-0.5, 0.7, n - 1)]))
    for k in range(1, n - 1, 4):
        turn = rng.uniform(0.1, 0.6)
        modes[k : k + 2, k : k + 2] = [[0.1, -turn], [turn, 0.1]]
    return V @ modes @ np.linalg.inv(V)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("n", [5, 12, 20, 30])
@pytest.mark.parametrize("conditioning", [1e5, 1e7, 8e7])
def test_ill_conditioned_eigenvectors(n, conditioning, discrete):
    # |A| is about the condition number: for the last one, rounding moves the eigenvalues in the third digit
    found = find_cone(with_eigenvectors(n, n, conditioning), discrete=discrete)
    assert found and found.conditioning > conditioning / 100 and found.certificate.check()
    assert found.n_rays >= found.fewest_rays


@pytest.mark.parametrize("discrete", [False, True])
def test_facets_agree_on_ill_conditioned_eigenvectors(discrete):
    A = with_eigenvectors(3, 5, 5e7)
    found = find_cone(A, discrete=discrete)
    assert not found.certificate.rays.is_double
    assert PolyhedralCone(found.certificate.rays).is_proper
    assert state_positivity(A, found.cone, discrete=discrete)
    # The doubles next to the generators will not do: they are too far away.
    rounded = replace(found.certificate, rays=Matrix(found.certificate.rays.values))
    assert not rounded.check()


def test_eigenvalues_are_accurate_behind_ill_conditioned_eigenvectors():
    A = with_eigenvectors(7, 8, 5e7)
    values = analysis(Matrix(A), discrete=False).eigenvalues
    rows = [[Fraction(x) for x in row] for row in A.tolist()]
    trace = sum(rows[i][i] for i in range(8))
    trace_of_square = sum(rows[i][j] * rows[j][i] for i in range(8) for j in range(8))
    assert values.sum() == pytest.approx(float(trace), rel=1e-13)
    assert (values**2).sum() == pytest.approx(float(trace_of_square), rel=1e-13)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.floats(0, 12), st.floats(-9, 0))
def test_proven_bounds_hold_in_exact_arithmetic(seed, digits, smallest):
    rng = np.random.default_rng(seed)
    n = 3
    turns = [np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(2)]
    R = turns[0] * np.geomspace(1, 10.0**-digits, n) @ turns[1]
    Q = 10.0**smallest * rng.random((n, 2))
    T = (R @ Q).T
    basis = Generators(Matrix(R.T.copy()), np.linalg.inv(R))
    eye = Matrix(np.eye(n))
    bounds = basis.combination("T = R Q", [(eye, Matrix(T))], Matrix(Q), np.ones(Q.shape, dtype=bool))
    for j in range(2):
        column = [Fraction(x) for x in T[j].tolist()]
        matrix = [[Fraction(x) for x in row] for row in R.tolist()]
        for k in range(n):  # Gauss elimination
            pivot = max(range(k, n), key=lambda i: abs(matrix[i][k]))
            matrix[k], matrix[pivot] = matrix[pivot], matrix[k]
            column[k], column[pivot] = column[pivot], column[k]
            for i in range(n):
                if i != k:
                    factor = matrix[i][k] / matrix[k][k]
                    matrix[i] = [x - factor * y for x, y in zip(matrix[i], matrix[k], strict=True)]
                    column[i] -= factor * column[k]
        for i in range(n):
            assert bounds.lower[i, j] <= column[i] / matrix[i][i] or bounds.exact[i, j]


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-6, 6), min_size=1, max_size=4), st.lists(st.integers(-6, 6), min_size=1, max_size=3))
def test_square_free_factors_multiply_back(single, double):
    p = [1]
    for root in [*single, *double, *double]:
        p = multiply(p, [1, -root])
    back = [1]
    for k, factor in enumerate(square_free_factors(p), start=1):
        for _ in range(k):
            back = multiply(back, factor)
    assert [Fraction(c, back[0]) for c in back] == [Fraction(c, p[0]) for c in p]
    assert sorted(rational_roots(p, np.roots(p))) == sorted([*single, *double, *double])


# -- bad input


def test_bad_input_is_named():
    with pytest.raises(ShapeError, match="A is 2 x 3"):
        find_cone(np.ones((2, 3)))
    with pytest.raises(DataError, match=r"A\[0, 1\] is nan"):
        find_cone([[1, np.nan], [0, 1]])
    with pytest.raises(DataError, match="at least 16 rays"):
        find_cone(pair(1.0, 5.0), max_rays=10)
    with pytest.raises(DataError, match="few"):
        find_cone(np.eye(2), few="edges")


def test_eighty_states_whose_rightmost_eigenvalues_are_not_real():
    A = np.random.default_rng(0).normal(size=(80, 80))
    values = np.linalg.eigvals(A)
    assert values[np.argmax(values.real)].imag
    found = find_cone(A)
    assert found.status is Status.REFUTED and found.obstruction.kind == "ahead" and found.certificate.check()
    assert (
        not replace(found.obstruction, bound=Fraction(100))
        .conditions(Matrix.stack([Matrix(A)]), discrete=False)[0]
        .verdict()
    )
