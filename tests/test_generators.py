"""Theorems 1 to 3 on cones whose facets are not listed: the verdicts are those of facets, and are proven."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from strategies import integer_matrices, many_rays, proper_cone, without_facets

import control_kpos as kp
from control_kpos.cones import polyhedral
from control_kpos.exact.matrix import Matrix
from control_kpos.proof.files import read_content
from control_kpos.proof.inclusion import GeneratorProof, PlaneViolation
from control_kpos.proof.independent import verdict
from control_kpos.proof.portable_cones import own_generators
from control_kpos.proof.proposed_weights import prove
from control_kpos.theorems.growing_direction import InstabilityCombination


@pytest.fixture
def no_facets(monkeypatch):
    """Whoever asks for facets of a cone that is not simplicial fails the test."""
    convert = polyhedral.convert

    def only_small(generators):
        p, n = generators.shape
        return convert(generators) if p <= n else pytest.fail(f"facets of {p} generators in dimension {n}")

    monkeypatch.setattr(polyhedral, "convert", only_small)


def inside(rays: np.ndarray, rng: np.random.Generator, *, strictly: bool) -> np.ndarray:
    """An integer matrix that maps the cone of rays (1, y) into itself: sum of z w' with z in X and w in X*."""
    n, rays = rays.shape[1], rays.astype(object)
    eye = np.eye(n, dtype=int).astype(object)
    if not strictly:  # generators that w maps to 0, and images on the boundary
        k = int(rng.integers(1, n))
        return np.outer(rays[rng.integers(len(rays))], rays[:, k].max() * eye[0] - eye[k])
    A = 0 * eye
    for _ in range(3):
        z = rng.integers(1, 4, len(rays)).astype(object) @ rays
        A = A + np.outer(z, np.append(int(np.abs(rays).max()) * n, rng.integers(-1, 2, n - 1)))
    return A


def slow_modes(n: int, seed: int = 0) -> np.ndarray:
    """A stable matrix whose cones need many generators."""
    rng = np.random.default_rng(seed)
    pairs = [
        [[a, w], [-w, a]] for a, w in zip(-0.4 - rng.random(n // 3) / 3, 0.6 + rng.random(n // 3) / 2, strict=True)
    ]
    rest = np.diag(-1 - rng.random(n - 1 - 2 * len(pairs)))
    T = rng.standard_normal((n, n))
    return T @ block_diag([[-0.3]], *pairs, rest) @ np.linalg.inv(T)


# -- Theorem 1


@settings(max_examples=150)
@given(st.data(), st.integers(1, 4), st.booleans(), st.booleans())
def test_verdicts_are_those_of_facets(data, n, discrete, by_construction):
    X = data.draw(proper_cone(n))
    if by_construction:
        rays, weights = X.rays, data.draw(integer_matrices(X.n_facets, X.n_rays, 1))
        A = rays.T @ np.abs(weights).T @ X.facets - (0 if discrete else 3) * np.eye(n)
    else:
        A = data.draw(integer_matrices(n, n, 3))
    known = kp.state_positivity(A, X, discrete=discrete)
    found = kp.state_positivity(A, without_facets(X._conversion.generators), discrete=discrete)
    assert found.status is known.status and found.check()
    assert found.generator_proof is not None and known.generator_proof is None
    assert (found.witness is None) == bool(found) and (found or isinstance(found.witness, PlaneViolation))
    assert not by_construction or found


@settings(max_examples=80)
@given(st.data(), st.integers(2, 3), st.integers(1, 2))
def test_inputs_and_outputs_too(data, n, m):
    X, U, Y = data.draw(proper_cone(n)), data.draw(proper_cone(m)), data.draw(proper_cone(m))
    A = X.rays.T @ np.ones((X.n_rays, X.n_facets)) @ X.facets
    inputs = data.draw(st.booleans())
    B = X.rays[:1].T @ U.facets[:1] if inputs else data.draw(integer_matrices(n, m, 1))
    C = Y.rays[-1:].T @ X.facets[:1] if data.draw(st.booleans()) else data.draw(integer_matrices(m, n, 1))
    D = np.zeros((m, m))
    known = kp.cone_positivity(A, B, C, D, X, U, Y)
    found = kp.cone_positivity(A, B, C, D, without_facets(X._conversion.generators), U, Y)
    assert found.status is known.status and found.check() and found.generator_proof is not None
    assert not (inputs and not found) or found.witness.condition == "C X in Y"


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("strictly", [False, True])
@pytest.mark.parametrize(("n", "p"), [(9, 45), (11, 30)])
def test_large_cones_with_an_invariance_by_construction(n, p, strictly, discrete, no_facets):
    rays, rng = many_rays(n, p), np.random.default_rng(n)
    X = kp.PolyhedralCone(rays)
    A = inside(rays, rng, strictly=strictly)
    A = A if discrete else A - np.eye(n, dtype=int).astype(object) * A.max()
    cert = kp.state_positivity(A, X, discrete=discrete)
    assert cert and cert.check() and cert.generator_proof is not None
    crossing = A.copy()
    crossing[0, 1] -= 10 ** len(str(A.max()))  # tilts the axis of the cone
    cert = kp.state_positivity(crossing, X, discrete=discrete)
    assert cert.status is kp.Status.REFUTED and cert.check()
    h, x = cert.witness.exact_normal().fractions()[0], rays[cert.witness.ray].astype(object)
    assert (rays.astype(object) @ h >= 0).all() and h @ (crossing @ x) < 0
    assert discrete or h @ x == 0


def test_cones_that_are_found(no_facets, tmp_path):
    n = 12
    A = slow_modes(n)
    found = kp.find_cone(A).cone
    for X in (found, kp.PolyhedralCone(found.rays)):
        B, C = found.rays[:2].T, found.dual.interior_point[None]
        s = kp.ConeStateSpace(A, B, C, np.zeros((1, 2)), X=X)
        assert s.is_cone_positive() and s.cone_positivity().check()
        cert, no = s.cone_positivity(), kp.state_positivity(A + np.eye(n)[::-1], X)
        assert "from generators alone" in cert.explain() and no.status is kp.Status.REFUTED
        assert "supporting plane" in no.explain() and no.witness.facet == -1 and no.margin < 0
        for c in (cert, no):
            c.save(tmp_path / "file.json")
            again = kp.load_certificate(tmp_path / "file.json")
            assert again.status is c.status and again.check() and again.generator_proof is not None
            assert verdict(read_content(tmp_path / "file.json")).status == c.status.name


def test_inputs_that_leave_the_cone(no_facets, tmp_path):
    rays = many_rays(9, 45)
    A, X = inside(rays, np.random.default_rng(0), strictly=True), kp.PolyhedralCone(rays)
    B = np.column_stack([rays[0], -rays[1]])
    cert = kp.cone_positivity(A, B, None, None, X, kp.orthant(2))
    assert cert.witness.condition == "B U in X" and cert.witness.ray == 1 and cert.check()
    cert.save(tmp_path / "file.json")
    assert verdict(read_content(tmp_path / "file.json")).status == "REFUTED"
    assert kp.cone_positivity(A, B[:, :1], None, None, X, kp.orthant(1))
    zero = kp.cone_positivity(A, 0 * B, None, None, X, kp.orthant(2))
    assert zero and zero.check()


def test_outputs_that_leave_their_cone(no_facets):
    rays = many_rays(9, 45)
    A, X = inside(rays, np.random.default_rng(0), strictly=True), kp.PolyhedralCone(rays)
    cert = kp.cone_positivity(A, None, -np.eye(9)[:1], None, X, None, kp.orthant(1))
    assert cert.witness.condition == "C X in Y" and cert.witness.facet == 0 and cert.check()


def test_redundant_generators_of_fractions_round_trip(no_facets, tmp_path):
    rays = many_rays(9, 45).astype(object)
    rays = np.vstack([rays, rays[:3] * Fraction(1, 3), rays[4:5] + rays[7:8]])
    A = inside(many_rays(9, 45), np.random.default_rng(1), strictly=True) * Fraction(1, 7)
    cert = kp.state_positivity(A, rays, discrete=True)
    assert cert and own_generators(cert.X).shape[0] == 49 and cert.X.n_rays == 45
    cert.save(tmp_path / "file.json")
    assert (
        kp.load_certificate(tmp_path / "file.json") and verdict(read_content(tmp_path / "file.json")).status == "PROVED"
    )


@pytest.fixture(scope="module")
def proved():
    rays = many_rays(9, 45)
    A = inside(rays, np.random.default_rng(0), strictly=True)
    return kp.cone_positivity(A, rays[:1].T, None, None, kp.PolyhedralCone(rays), kp.orthant(1), discrete=True)


def test_wrong_proofs_are_not_believed(proved):
    proof = proved.generator_proof
    P, shares = proof.multipliers.values, proof.shares
    wrong = [
        replace(proof, multipliers=Matrix(P * (1 + 1e-9))),
        replace(proof, multipliers=Matrix(P + np.abs(P).max() * np.eye(len(P))[[3]])),
        replace(proof, multipliers=Matrix(-P)),
        replace(proof, multipliers=Matrix(P[:-1])),
        replace(proof, multipliers=None),
        replace(proof, pointing=-proof.pointing),
        replace(proof, pointing=proof.pointing[:-1]),
        replace(proof, right_inverse=0 * proof.right_inverse),
        replace(proof, right_inverse=-proof.right_inverse),
        replace(proof, shares=None),
        replace(proof, shares=Matrix(-np.asarray(shares.values))),
    ]
    assert proved and proved.check()
    for other in wrong:
        assert not replace(proved, generator_proof=other).check()
    with pytest.raises(ValueError, match="read-only"):
        proof.pointing[0] = 1


def test_a_proof_of_one_matrix_is_none_of_another(proved):
    A = proved.A.fractions()
    A[0, 1] -= 10**9
    assert not replace(proved, A=Matrix.from_fractions(A)).check()
    settled = type(proved).settle(A=Matrix.from_fractions(A), X=proved.X, generator_proof=proved.generator_proof)
    assert settled.status is kp.Status.UNDECIDED


def test_wrong_planes_are_not_believed():
    rays = many_rays(9, 45)
    A = np.eye(9)[::-1]
    cert = kp.state_positivity(A, kp.PolyhedralCone(rays))
    w = cert.witness
    assert cert.status is kp.Status.REFUTED and cert.check()
    opposite, other = tuple(-x for x in w.normal_exact), (Fraction(1), *w.normal_exact[1:])
    wrong = [
        replace(w, normal_exact=opposite, normal=-w.normal),
        replace(w, normal_exact=other, normal=np.array([float(x) for x in other])),
        replace(w, normal=w.normal * 2),
        replace(w, normal_exact=w.normal_exact[:-1], normal=w.normal[:-1]),
        replace(w, ray=(w.ray + 1) % 45),
        replace(w, ray=(w.ray + 1) % 45, generator=rays[(w.ray + 1) % 45]),
        replace(w, ray=45),
        replace(w, generator=w.generator * 2),
        replace(w, value=w.value * 2),
        replace(w, condition="B U in X"),
    ]
    for witness in wrong:
        assert not replace(cert, witness=witness).check()


def test_a_half_space_is_no_cone_for_a_proof():
    # w = e_2 is not negative on its generators, and every A that keeps its boundary maps it into itself
    half = kp.PolyhedralCone([[1, 0], [-1, 0], [0, 1]])
    inverse, P = np.array([[1.0, 0], [0, 0], [0, 1]]), np.diag([-1.0, -1, -1])
    proof = GeneratorProof(np.array([0.0, 1]), inverse, Matrix(P))
    conditions = {c.name: c.verdict() for c in proof.conditions(-Matrix.identity(2), half, None, None, discrete=False)}
    assert conditions.pop("w'x > 0") is False and all(conditions.values())
    forged = kp.PositivityCertificate.settle(A=-Matrix.identity(2), X=half, generator_proof=proof)
    assert forged.status is kp.Status.UNDECIDED


@pytest.mark.parametrize("sign", [1, -1])
def test_input_cones_given_by_facets(sign):
    U = kp.PolyhedralCone(
        [["1/3", 1, 0.1], [0, "1/7", 1], [1, 0, 0.3], [1, 1, 3]]
    ).dual  # rays with factors of their own
    assert U.exact_rays.integer_rows is not None
    X = without_facets(kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]).rays)
    B = sign * np.outer([0.5, 0.25, 1], U.dual.interior_point)
    cert = kp.cone_positivity(-np.eye(3), B, None, None, X, U)
    assert bool(cert) == (sign > 0) and cert.status is not kp.Status.UNDECIDED and cert.check()
    assert cert.generator_proof is not None


@pytest.mark.parametrize(
    ("A", "normal", "ray"),
    [
        (-1, (0, 0, 1), 0),  # inside the dual cone: the generator is not on the plane
        (0, (-1, 0, 1), 0),  # on the plane, and the field is tangent to it
        (-1, (-1, 0, 1), 2),  # a plane that the generator does not lie on
        (-1, (-1, 0, 1), 4),  # there is no such generator
        (-1, (-1, 0, 1), -1),
        (1, (1, 0, 0), 0),  # a plane through the cone
    ],
)
def test_planes_that_no_field_crosses(A, normal, ray):
    rays = np.array([[1.0, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
    X, A, h = without_facets(rays), A * np.eye(3), np.array(normal, dtype=float)
    known = kp.state_positivity(A, X)
    assert known
    x = rays[min(ray, 3)]
    witness = PlaneViolation("A X in X", -1, ray, h, x, float(h @ A @ x), tuple(Fraction(t) for t in normal))
    forged = kp.PositivityCertificate.settle(A=Matrix(A), X=X, generator_proof=known.generator_proof, witness=witness)
    assert forged.status is kp.Status.UNDECIDED


def test_what_generators_cannot_decide_is_left_to_facets(monkeypatch):
    X = without_facets(many_rays(5, 9))
    monkeypatch.setattr("control_kpos.theorems.positivity.prove", lambda *_, **__: None)
    with pytest.raises(kp.TooLargeError):
        kp.state_positivity(np.eye(5), X)


def test_work_is_limited(monkeypatch):
    rays = many_rays(9, 45)
    A = Matrix(inside(rays, np.random.default_rng(0), strictly=False).astype(float))
    X = kp.PolyhedralCone(rays)
    assert prove(A, X, None, None, discrete=True)
    monkeypatch.setattr("control_kpos.proof.proposed_weights.LIMIT", 1e4)
    assert prove(A, X, None, None, discrete=True) is None


# -- Theorem 2


@settings(max_examples=100)
@given(st.data(), st.integers(1, 3), st.booleans(), st.integers(0, 6))
def test_stability_is_that_of_facets(data, n, discrete, shift):
    X = data.draw(proper_cone(n))
    weights = np.abs(data.draw(integer_matrices(X.n_facets, X.n_rays, 1)))
    A = X.rays.T @ weights.T @ X.facets
    A = A * 2.0**-shift if discrete else A - 4.0**shift * np.eye(n)
    known = kp.linear_lyapunov(A, X, discrete=discrete)
    found = kp.linear_lyapunov(A, without_facets(X._conversion.generators), discrete=discrete)
    assert found.status is known.status and found.check()
    assert found.positivity.generator_proof is not None


def test_stability_on_cones_that_are_found(no_facets, tmp_path):
    n = 12
    A = slow_modes(n)
    X = kp.find_cone(A).cone
    stable, fastest = kp.linear_lyapunov(A, X), kp.linear_lyapunov(A, X, rate="max")
    growing = kp.linear_lyapunov(A + 0.35 * np.eye(n), X, rate="max")
    assert stable and fastest and 0 < stable.decay_rate <= fastest.decay_rate
    assert fastest.decay_rate == pytest.approx(0.3) and fastest.decay_rate_bound == np.inf
    assert growing.status is kp.Status.REFUTED and isinstance(growing.witness, InstabilityCombination)
    left = kp.linear_lyapunov(A + np.eye(n)[::-1], X)
    assert isinstance(left.witness, PlaneViolation)
    for cert in (stable, fastest, growing, left):
        assert cert.check()
        cert.save(tmp_path / "file.json")
        assert kp.load_certificate(tmp_path / "file.json").status is cert.status
        assert verdict(read_content(tmp_path / "file.json")).status == cert.status.name
    step = np.eye(n) + A / 20
    discrete = kp.linear_lyapunov(step, X, discrete=True)
    assert discrete and discrete.check()
    slower = kp.linear_lyapunov(step + 0.1 * np.eye(n), X, discrete=True)
    assert slower.status is kp.Status.REFUTED and slower.check()


@pytest.mark.parametrize(("step", "discrete"), [(2.0**-20, True), (2.0**20, False)])
def test_fine_steps_need_no_rational_numbers(step, discrete, no_facets, monkeypatch):
    A = slow_modes(12)
    X = kp.find_cone(A).cone
    monkeypatch.setattr("control_kpos.proof.proposed_weights.exact_combination", lambda *_, **__: pytest.fail("exact"))
    cert = kp.state_positivity(np.eye(12) + step * A if discrete else A - step * np.eye(12), X, discrete=discrete)
    assert cert and cert.check()


def test_a_marginal_system_on_a_large_cone(no_facets):
    rays = many_rays(9, 40)
    inward = np.outer(rays.sum(axis=0), np.eye(9, dtype=int)[0])  # maps x to x_1 times the sum of the generators
    A = inward - 40 * np.eye(9, dtype=int)  # whose first entry is 40: the eigenvalue is 0
    for shift, status in ((-1, kp.Status.PROVED), (0, kp.Status.REFUTED), (1, kp.Status.REFUTED)):
        cert = kp.linear_lyapunov(A + shift * np.eye(9, dtype=int), kp.PolyhedralCone(rays))
        assert cert.status is status and cert.check() and cert.positivity.generator_proof is not None


def test_wrong_weights_are_not_believed():
    rays = many_rays(9, 45)
    cert = kp.linear_lyapunov(inside(rays, np.random.default_rng(0), strictly=True), kp.PolyhedralCone(rays))
    w = cert.witness
    assert cert.status is kp.Status.REFUTED and cert.check()
    q = np.asarray(w.weights.values)
    wrong = [
        replace(w, weights=Matrix(-q)),
        replace(w, weights=Matrix(q[::-1])),
        replace(w, weights=Matrix(q[:1])),
        replace(w, weights=None),
        replace(w, x=-w.x, exact=None),
        replace(w, x=0 * w.x, weights=Matrix(0 * q)),
    ]
    for witness in wrong:
        assert not replace(cert, witness=witness).check()
    assert not replace(cert, positivity=kp.state_positivity(np.eye(9)[::-1], cert.X)).check()


# -- Theorem 3


def test_dissipativity_on_cones_that_are_found(no_facets, tmp_path):
    A = slow_modes(12)
    X = kp.find_cone(A).cone
    B, C, D = X.rays[:2].T, X.dual.interior_point[None], np.zeros((1, 2))
    cert = kp.dissipativity(A, B, C, D, X, kp.orthant(2), kp.orthant(1))
    assert cert and cert.check()
    cert.save(tmp_path / "file.json")
    assert (
        kp.load_certificate(tmp_path / "file.json") and verdict(read_content(tmp_path / "file.json")).status == "PROVED"
    )
    assert kp.induced_gain(A, B, C, D, X, kp.orthant(2), kp.orthant(1)) == pytest.approx(
        (-C @ np.linalg.solve(A, B)).max(), rel=1e-6
    )
