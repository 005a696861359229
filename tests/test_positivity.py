"""Theorem 1: positivity with respect to polyhedral cones."""

from dataclasses import fields, replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.exact.intake import exact_matrix
from control_kpos.exact.matrix import Matrix
from control_kpos.proof.certificate import Status
from control_kpos.proof.inclusion import PositivityViolation
from control_kpos.theorems.positivity import PositivityCertificate

PAPER = kp.PolyhedralCone([[0, 1], [1, -2]])
PLANT = [[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], [[0]]
R1 = kp.orthant(1)


def closed_loop(F1, F2, k="1"):
    """The mass-spring with u = F x, exactly."""
    return [[0, 1], [Fraction(F1) - Fraction(k), Fraction(F2)]]


def metzler(n):
    entry = st.integers(0, 5)
    return st.lists(st.lists(entry, min_size=n, max_size=n), min_size=n, max_size=n).map(
        lambda rows: np.array(rows, dtype=float) - np.diag([sum(r) + 1.0 for r in rows])
    )


@st.composite
def unimodular(draw, n=3):
    """An integer matrix with an integer inverse."""
    T = np.eye(n)
    for _ in range(4):
        i, j = draw(st.permutations(range(n)))[:2]
        T[i] += draw(st.integers(-2, 2)) * T[j]
    return T


class TestPaper:
    def test_the_feedback_of_section_v_lies_exactly_on_the_boundary(self):
        cert = kp.cone_positivity(closed_loop(-21, -13), *PLANT[1:], PAPER, R1, R1)
        assert cert.status is Status.PROVED
        assert cert.margin == 0
        assert cert.check()

    @pytest.mark.parametrize(("F2", "expected"), [("-13.0000000001", "PROVED"), ("-12.9999999999", "REFUTED")])
    def test_neighbours_of_the_boundary(self, F2, expected):
        # F2 <= (F1 - 4 - k) / 2
        for data in (closed_loop(-21, F2), np.array(closed_loop(-21, F2), dtype=float)):
            cert = kp.state_positivity(data, PAPER)
            assert cert.status.name == expected
            assert cert.check()

    def test_decimals_are_exact_where_doubles_err(self):
        # k = 1.1: the boundary is F2 = (F1 - 5.1) / 2, met exactly by F1 = -21.3, F2 = -13.2
        assert kp.state_positivity(closed_loop("-21.3", "-13.2", "1.1"), PAPER)
        beyond = kp.state_positivity(closed_loop("-21.3", "-13.19999999999999999999", "1.1"), PAPER)
        assert beyond.status is Status.REFUTED

    def test_not_positive_on_the_orthant(self):
        cert = kp.state_positivity(closed_loop(-21, -13), kp.orthant(2))
        assert cert.status is Status.REFUTED
        assert cert.witness.condition == "A X in X"
        assert cert.witness.value < 0


class TestTolerancesErr:
    def test_violation_below_every_tolerance_is_found(self):
        # 50-gon cone under a discrete rotation of 1 rad: it leaves the cone by about 2e-4 only
        angle = 2 * np.pi * np.arange(50) / 50
        X = kp.PolyhedralCone(np.column_stack([np.cos(angle), np.sin(angle), np.ones(50)]))
        turn = scipy.linalg.block_diag([[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]], 1)
        cert = kp.state_positivity(turn, X, discrete=True)
        assert cert.status is Status.REFUTED
        assert -5e-3 < cert.witness.value < 0

    # A x for x = (1, 1, 1), a generator on the facet x_1 = 0, moves by first + second - their sum
    CONE = kp.PolyhedralCone([[1, 1, 1], [0, 1, 0], [0, 0, 1]])

    @staticmethod
    def drift(first, second, total):
        return [[total, first, second], [0, 9, 9], [0, 9, 9]]

    def test_violation_that_floating_point_rounds_to_zero_is_found(self):
        A = self.drift(0.1, 1.0, -(0.1 + 1.0))  # the doubles add up to -8e-17
        assert (self.CONE.facets @ A @ self.CONE.rays.T).min() >= 0
        cert = kp.state_positivity(A, self.CONE, discrete=True)
        assert cert.status is Status.REFUTED and cert.check()

    def test_rounding_that_looks_like_a_violation_is_none(self):
        A = self.drift("0.1", "0.7", "-0.8")  # the decimals add up to 0, their doubles to -8e-17
        assert (self.CONE.facets @ np.array(A, dtype=float) @ self.CONE.rays.T).min() < 0
        cert = kp.state_positivity(A, self.CONE, discrete=True)
        assert cert.status is Status.PROVED and cert.margin <= 1e-16

    def test_cone_in_units_that_are_not_integers(self):
        # millimetres and 1/3 minutes: the paper's cone and boundary, rescaled without rounding
        s, t = Fraction(1000), Fraction(1, 20)
        X = kp.PolyhedralCone([[0, s * t], [s, -2 * s * t]])
        A = [[0, 1 / t], [-22 * t, -13]]
        assert kp.state_positivity(A, X)
        A[1][1] += Fraction(1, 10**12)
        assert kp.state_positivity(A, X).status is Status.REFUTED

    def test_tiny_negative_entry_is_seen(self):
        assert kp.state_positivity([[-1, -1e-300], [0, -1]], kp.orthant(2)).status is Status.REFUTED
        assert kp.state_positivity([[-1, 1e-300], [0, -1]], kp.orthant(2)).status is Status.PROVED


@given(metzler(3), unimodular())
def test_similarity_moves_cone_and_matrix_together(M, T):
    A = T @ M @ np.rint(np.linalg.inv(T))
    X = kp.PolyhedralCone(T.T)
    assert kp.state_positivity(A, X)
    spoiled = M.copy()
    spoiled[0, 1] = -1
    cert = kp.state_positivity(T @ spoiled @ np.rint(np.linalg.inv(T)), X)
    assert cert.status is Status.REFUTED and cert.check()


@given(metzler(3), unimodular(), st.permutations(range(3)), st.lists(st.integers(-300, 300), min_size=3, max_size=3))
@settings(deadline=None)
def test_order_length_and_redundancy_of_generators_change_nothing(M, T, order, powers):
    A = T @ M @ np.rint(np.linalg.inv(T))
    rays = T.T[list(order)] * np.ldexp(1.0, powers)[:, None]
    more = np.vstack([rays, 4 * rays[:1], T.T[list(order)][:1] + T.T[list(order)][1:2]])
    assert kp.state_positivity(A, kp.PolyhedralCone(rays))
    assert kp.state_positivity(A, kp.PolyhedralCone(more))


@pytest.mark.parametrize("scale", [1e-150, 1.0, 1e150, 2.0**-500, 2.0**500])
def test_scale_of_the_matrix_changes_nothing(scale):
    A = np.array([[-1.0, 2.0], [1e-3, -4.0]])
    good, bad = kp.state_positivity(scale * A, kp.orthant(2)), kp.state_positivity(-scale * A, kp.orthant(2))
    assert good and good.check() and good.margin == kp.state_positivity(A, kp.orthant(2)).margin
    assert bad.status is Status.REFUTED and bad.check()


def test_discrete_time_needs_every_pair():
    A = [[-1, 1], [1, 0]]
    assert kp.state_positivity(A, kp.orthant(2))
    cert = kp.state_positivity(A, kp.orthant(2), discrete=True)
    assert cert.status is Status.REFUTED and (cert.witness.facet, cert.witness.ray) == (0, 0)


@pytest.mark.parametrize(
    ("name", "B", "C", "D"),
    [
        ("B U in X", [[-1], [0]], [[1, 0]], 0),
        ("C X in Y", [[1], [0]], [[0, -1]], 0),
        ("D U in Y", [[1], [0]], [[1, 0]], -1),
    ],
)
def test_each_inclusion_is_needed(name, B, C, D):
    cert = kp.cone_positivity([[-1, 0], [0, -1]], B, C, [[D]], kp.orthant(2), R1, R1)
    assert cert.status is Status.REFUTED
    assert cert.witness.condition == name
    assert name in cert.explain() and cert.check()


def test_sparse_matrices_and_product_cones_pass_unchanged():
    n = 300
    A = sp.diags_array([np.full(n - 1, 1.0), np.full(n, -3.0), np.full(n - 1, 0.5)], offsets=[-1, 0, 1], format="csr")
    assert kp.state_positivity(A, kp.orthant(n))
    ring = sp.kron(sp.eye_array(n), np.array([[0.0, 1.0], [-22.0, -13.0]])) + sp.kron(
        sp.csr_array(np.roll(np.eye(n), 1, axis=1)), np.array([[0.0, 0.0], [1.0, 0.0]])
    )
    X = kp.product([PAPER] * n)
    cert = kp.state_positivity(ring, X)
    assert cert and cert.check()
    spoiled = ring.tolil()
    spoiled[3, 40] = -1.0
    refuted = kp.state_positivity(spoiled, X)
    assert refuted.status is Status.REFUTED and refuted.check()


def perturbations(cert):
    """The certificate with each of its fields changed, one at a time."""
    for field in fields(cert):
        value = getattr(cert, field.name)
        if isinstance(value, Status):
            changes = [s for s in Status if s is not value]
        elif isinstance(value, np.ndarray):
            changes = [-value, value * (1 + 1e-6), value[:-1], np.full_like(value, np.nan)]
        elif isinstance(value, bool):
            changes = [not value]
        elif isinstance(value, (int, float)):
            changes = [c for c in (value + 1, value * (1 + 1e-6) + 1e-9, float("nan")) if c != value]
        elif isinstance(value, dict):
            changes = [{**value, next(iter(value)): next(iter(value.values())) + 1e-3}, {}] if value else []
        elif hasattr(value, "values") and hasattr(value, "denominator"):
            changes = [Matrix(value.values * 1.001 + 0.5)]
            changes += [Matrix(-value.values)] if np.any(value.values) else []
        elif isinstance(value, kp.Cone):
            changes = [-value]
        else:
            changes = []
        for change in changes:
            yield field.name, replace(cert, **{field.name: change})


@pytest.mark.parametrize("A", [closed_loop(-21, -14), closed_loop(-21, -12)])
def test_a_changed_certificate_does_not_pass(A):
    cert = kp.cone_positivity(A, *PLANT[1:], PAPER, R1, R1)
    assert cert.check()
    for name, changed in perturbations(cert):
        if name in ("U", "Y", "B", "C", "D") and cert.witness is not None:
            continue  # the witness against A stands whatever B, C and D are
        assert not changed.check(), name
    if cert.witness is not None:
        for name, witness in perturbations(cert.witness):
            assert not replace(cert, witness=witness).check(), name


@pytest.mark.parametrize(
    ("A", "error", "text"),
    [
        ([[np.nan, 0], [0, 0]], kp.DataError, r"A\[0, 0\] is nan"),
        ([[0, np.inf], [0, 0]], kp.DataError, r"A\[0, 1\] is inf"),
        ([[1j, 0], [0, 0]], kp.DataError, "complex"),
        ([["a", 0], [0, 0]], kp.DataError, "'a'"),
        ([[1, 2], [3]], kp.ShapeError, "ragged"),
        ([], kp.ShapeError, "2 x 2"),
        (1.0, kp.ShapeError, "1 x 1"),
        (np.zeros((3, 3)), kp.ShapeError, "3 x 3"),
        (np.zeros((2, 2, 2)), kp.ShapeError, "2 dimensions"),
        ([[None, 1], [1, 1]], kp.DataError, "None"),
        (sp.csr_array([[np.nan, 0], [0, 0]]), kp.DataError, "nan"),
    ],
)
def test_bad_matrices_are_refused_by_name(A, error, text):
    with pytest.raises(error, match=text):
        kp.state_positivity(A, kp.orthant(2))


def test_improper_cones_are_refused():
    with pytest.raises(kp.NotProperConeError, match="X is not pointed"):
        kp.state_positivity(np.eye(2), kp.PolyhedralCone([[1, 0], [-1, 0], [0, 1]]))
    with pytest.raises(kp.NotProperConeError, match="X is not solid"):
        kp.state_positivity(np.eye(2), kp.PolyhedralCone([[1, 0]]))


def test_files_keep_the_verdict(tmp_path):
    for A in (closed_loop("-21.3", "-13.2", "1.1"), closed_loop(-21, -12)):
        cert = kp.cone_positivity(A, *PLANT[1:], PAPER, R1, R1)
        cert.save(tmp_path / "c.json")
        again = kp.load_certificate(tmp_path / "c.json")
        assert again.status is cert.status and again.check() and again.explain() == cert.explain()


@pytest.mark.parametrize(
    ("a", "ray", "value", "discrete", "status"),
    [
        (0.5, 1, 0.0, False, Status.UNDECIDED),  # h'A x = 0 is allowed
        (0.5, 1, 0.0, True, Status.UNDECIDED),
        (-1, 0, -1.0, False, Status.UNDECIDED),  # h'A x < 0 is allowed where h'x > 0, in continuous time
        (-1, 0, -1.0, True, Status.REFUTED),
    ],
)
def test_what_is_no_violation_refutes_nothing(a, ray, value, discrete, status):
    claimed = PositivityViolation("A X in X", 0, ray, np.array([1.0, 0.0]), np.eye(2)[ray], value)
    A = exact_matrix([[a, 0], [0, a]], "A")
    certificate = PositivityCertificate.settle(A=A, X=kp.orthant(2), discrete=discrete, witness=claimed)
    assert certificate.status is status


def test_a_violation_needs_the_facet_and_the_generator_it_names():
    plane, A = kp.orthant(2), exact_matrix([[-1, -2], [0, 0]], "A")
    named = PositivityViolation("A X in X", 0, 1, np.array([1.0, 0.0]), np.array([0.0, 1.0]), -2.0)
    other = np.array([1.0, 1.0])
    for change in ({"normal": other}, {"generator": other, "value": -3.0}, {"value": -2.1}, {}):
        witness = replace(named, **change)
        certificate = PositivityCertificate.settle(A=A, X=plane, witness=witness)
        assert certificate.status is (Status.UNDECIDED if change else Status.REFUTED)
