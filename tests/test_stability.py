"""Theorem 2: exponential stability by a linear Lyapunov vector."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from test_positivity import PAPER, closed_loop, metzler, perturbations, unimodular

import control_kpos as kp
from control_kpos.errors import DataError
from control_kpos.exact.intake import exact_matrix
from control_kpos.proof.certificate import Status, exactly
from control_kpos.theorems.growing_direction import InstabilityDirection
from control_kpos.theorems.positivity import PositivityCertificate
from control_kpos.theorems.stability import LyapunovCertificate


def routh_stable(A):
    """Exact truth for n <= 3, by the Routh-Hurwitz criterion in rational numbers."""
    A = [[Fraction(x) for x in row] for row in np.asarray(A, dtype=float).tolist()]
    n = len(A)
    trace = sum(A[i][i] for i in range(n))
    if n == 1:
        return trace < 0
    minors = sum(A[i][i] * A[j][j] - A[i][j] * A[j][i] for i in range(n) for j in range(i))
    if n == 2:
        return trace < 0 and minors > 0
    (a, b, c), (d, e, f), (g, h, i) = A
    det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return trace < 0 and det < 0 and -trace * minors > -det


class TestPaper:
    def test_lyapunov_vector_of_the_mass_spring(self):
        cert = kp.linear_lyapunov(closed_loop(-21, -13), PAPER)
        assert cert and cert.check()
        A = np.array(closed_loop(-21, -13), dtype=float)
        assert (PAPER.rays @ cert.v > 0).all() and (PAPER.rays @ A.T @ cert.v < 0).all()

    def test_the_printed_vector_is_one_too(self):
        v = np.array([5.09, 0.836])
        A = np.array(closed_loop(-21, -13), dtype=float)
        assert (PAPER.rays @ v > 0).all() and (PAPER.rays @ A.T @ v < 0).all()

    def test_fastest_provable_rate_is_the_dominant_eigenvalue(self):
        cert = kp.linear_lyapunov(closed_loop(-21, -13), PAPER, rate="max")
        assert cert and cert.check()
        # lambda^2 + 13 lambda + 22 = (lambda + 2)(lambda + 11)
        assert 2 - 1e-9 < cert.decay_rate <= 2 <= cert.decay_rate_bound < 2 + 1e-9

    @pytest.mark.parametrize(("F2", "expected"), [("-13.0000000001", "PROVED"), ("-12.9999999999", "REFUTED")])
    def test_boundary_of_invariance(self, F2, expected):
        cert = kp.linear_lyapunov(closed_loop(-21, F2), PAPER)
        assert cert.status.name == expected and cert.check()


def test_a_vector_alone_proves_nothing():
    # v = (1, 1) passes both inequalities on the orthant, yet 3 is an eigenvalue: A is not Metzler
    A = np.array([[1.0, -2.0], [-2.0, 1.0]])
    cert = kp.linear_lyapunov(A, kp.orthant(2))
    assert cert.status is Status.REFUTED and cert.witness.condition == "A X in X"
    forged = replace(
        kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2)),
        positivity=cert.positivity,
        v=np.array([1.0, 1.0]),
        decay_rate=1.0,
    )
    assert not forged.check()


@given(metzler(3), unimodular())
@settings(deadline=None)
def test_lyapunov_vector_decreases(M, T):
    A, X = T @ M @ np.rint(np.linalg.inv(T)), kp.PolyhedralCone(T.T)
    cert = kp.linear_lyapunov(A, X)
    assert cert and all(cert.v @ T > 0) and all(cert.v @ A @ T < 0)
    assert (cert.v @ A @ T + cert.decay_rate * cert.v @ T <= 1e-9 * np.abs(cert.v) @ np.abs(A) @ np.abs(T)).all()
    assert not replace(cert, v=-cert.v).check()


@given(st.data())
@settings(deadline=None, max_examples=300)
def test_verdict_is_the_exact_truth(data):
    n = data.draw(st.integers(1, 3))
    entry = st.one_of(st.integers(0, 3), st.sampled_from([0.0, 0.1, 1e-10, 1 / 3]))
    A = np.array(data.draw(st.lists(st.lists(entry, min_size=n, max_size=n), min_size=n, max_size=n)), dtype=float)
    A -= np.diag(
        np.array(
            data.draw(st.lists(st.one_of(st.integers(0, 7), st.sampled_from([0.1, 1 / 3])), min_size=n, max_size=n)),
            dtype=float,
        )
    )
    cert = kp.linear_lyapunov(A, kp.orthant(n))
    assert cert.status is (Status.PROVED if routh_stable(A) else Status.REFUTED)
    assert cert.check()


def test_no_unstable_system_is_ever_proved_stable():
    rng = np.random.default_rng(20261122)
    wrong = undecided = 0
    for _ in range(10_000):
        n = int(rng.integers(2, 4))
        A = rng.random((n, n)) * rng.choice([1.0, 1e-6, 1e6])
        A -= np.diag(np.diag(A))
        # put the rightmost eigenvalue within a relative 10^-1 .. 10^-17 of zero
        shift = np.linalg.eigvals(A).real.max() * (1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-17, -1))
        A -= shift * np.eye(n)
        cert = kp.linear_lyapunov(A, kp.orthant(n))
        undecided += cert.status is Status.UNDECIDED
        wrong += (cert.status is Status.PROVED) != routh_stable(A)
    assert (wrong, undecided) == (0, 0)


MARGINAL = {
    "zero": ([[0.0]], False),
    "singular": ([[-1, 1], [1, -1]], False),
    "defective at zero": ([[0, 1], [0, 0]], False),
    "defective and stable": ([[-1, 1], [0, -1]], True),
    "reducible, one mode grows": ([[-1, 0], [0, 1]], False),
    "reducible, stable": ([[-1, 1], [0, -2]], True),
    "reducible, hidden integrator": ([[-1, 0, 0], [1, 0, 0], [0, 1, -1]], False),
    "just stable": ([[-1 - 1e-10, 1], [1, -1]], True),
    "just unstable": ([[-1 + 1e-10, 1], [1, -1]], False),
    "very stiff": ([[-1e-8, 1e8], [0, -1e8]], True),
}


@pytest.mark.parametrize("name", MARGINAL)
@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150, 2.0**400])
@pytest.mark.parametrize("rate", [None, "max"])
def test_marginal_matrices(name, scale, rate):
    A, stable = MARGINAL[name]
    cert = kp.linear_lyapunov(scale * np.array(A, dtype=float), kp.orthant(len(A)), rate=rate)
    assert cert.status is (Status.PROVED if stable else Status.REFUTED)
    assert cert.check() and cert.explain()
    if not stable:
        assert isinstance(cert.witness, kp.InstabilityDirection)


@pytest.mark.parametrize("name", MARGINAL)
def test_marginal_matrices_on_other_cones_and_in_discrete_time(name):
    A, stable = np.array(MARGINAL[name][0], dtype=float), MARGINAL[name][1]
    n = len(A)
    T = np.triu(np.ones((n, n)))
    cert = kp.linear_lyapunov(T @ A @ np.rint(np.linalg.inv(T)), kp.PolyhedralCone(T.T))
    assert cert.status is (Status.PROVED if stable else Status.REFUTED) and cert.check()
    if np.abs(A).max() < 10:
        discrete = (4 * np.eye(n) + A) / 4  # the same verdict about A / 4
        if (discrete * 4 - 4 * np.eye(n) == A).all():
            cert = kp.linear_lyapunov(discrete, kp.orthant(n), discrete=True)
            assert cert.status is (Status.PROVED if stable else Status.REFUTED) and cert.check()


@given(metzler(3), st.lists(st.integers(-400, 400), min_size=3, max_size=3))
@settings(deadline=None)
def test_units_of_the_state_change_nothing(M, powers):
    D = np.ldexp(1.0, powers)
    with np.errstate(over="ignore", under="ignore"):
        A = M * D[:, None] / D
    assert kp.linear_lyapunov(A, kp.PolyhedralCone(np.diag(D)))
    unstable = M + 20 * np.eye(3)
    with np.errstate(over="ignore", under="ignore"):
        A = unstable * D[:, None] / D
    assert kp.linear_lyapunov(A, kp.PolyhedralCone(np.diag(D))).status is Status.REFUTED


def test_discrete_decay_rate_is_a_contraction_per_step():
    A = np.array([[0.5, 0.25], [0.0, 0.5]])
    cert = kp.linear_lyapunov(A, kp.orthant(2), discrete=True, rate="max")
    assert cert and (cert.v @ A <= (1 - cert.decay_rate) * cert.v * (1 + 1e-12)).all()
    assert abs(cert.decay_rate - 0.5) < 1e-3
    assert cert.decay_rate_bound >= 0.5 - 1e-15


def test_non_simplicial_cone_and_many_sizes():
    rng = np.random.default_rng(3)
    for n in (2, 3, 4, 5):
        G = np.vstack([np.eye(n - 1), -np.eye(n - 1)])
        X = kp.PolyhedralCone(np.column_stack([G, np.ones(2 * n - 2)]))
        A = np.diag(np.append(-3 - rng.random(n - 1), -1))
        cert = kp.linear_lyapunov(A, X, rate="max")
        assert cert and abs(cert.decay_rate - 1) < 1e-6
        assert kp.linear_lyapunov(A + 1.5 * np.eye(n), X).status is Status.REFUTED


def test_sparse_ring_of_mass_springs():
    n = 400
    ring = sp.kron(sp.eye_array(n), np.array([[0.0, 1.0], [-22.0, -13.0]])) + sp.kron(
        sp.csr_array(np.roll(np.eye(n), 1, axis=1)), np.array([[0.0, 0.0], [1.0, 0.0]])
    )
    cert = kp.linear_lyapunov(ring, kp.product([PAPER] * n), rate="max")
    assert cert and cert.check()
    # the paper prints -1.48; lambda^2 + 13 lambda + 21 = 0 gives (-13 + sqrt(85)) / 2
    truth = (13 - np.sqrt(85)) / 2
    assert truth - 1e-6 < cert.decay_rate <= truth * (1 + 1e-12)
    assert abs(cert.decay_rate - 1.48) > 0.4


@pytest.mark.parametrize(
    ("A", "rate"),
    [([[-2, 1], [1, -2]], None), ([[-2, 1], [1, -2]], "max"), ([[2, 1], [1, -2]], None), ([[-1, 1], [1, -1]], None)],
)
def test_a_changed_certificate_does_not_pass(A, rate):
    cert = kp.linear_lyapunov(A, kp.orthant(2), rate=rate)
    assert cert.check()
    changed_names = set()
    for name, changed in perturbations(cert):
        if cert.witness is not None and name in ("v", "decay_rate", "decay_rate_bound"):
            continue
        changed_names.add(name)
        assert not changed.check(), name
    assert "status" in changed_names
    if cert.witness is not None:
        x = cert.witness.x
        for bad in (-x, 0 * x, x * np.array([1, -1]), x[:1], x * np.nan):
            assert not replace(cert, witness=kp.InstabilityDirection(bad)).check()


def test_files_keep_the_verdict(tmp_path):
    for A in (
        [[-2, 1], [1, -2]],
        [["-1", "1/3"], ["3", "-1"]],
        [[-2, -1], [1, -2]],
        [["-1/3", "1/3"], ["1/3", "-1/3"]],
    ):
        cert = kp.linear_lyapunov(A, kp.orthant(2))
        cert.save(tmp_path / "c.json")
        again = kp.load_certificate(tmp_path / "c.json")
        assert again.status is cert.status and again.check() and again.explain() == cert.explain()


@pytest.mark.parametrize("rate", ["fast", 0, -1, "-1/3", float("nan"), True, float("inf")])
def test_rates_that_cannot_be_asked_for_are_refused(rate):
    with pytest.raises(kp.DataError, match="rate"):
        kp.linear_lyapunov([[-1]], kp.orthant(1), rate=rate)


class TestAskedRate:
    """A = T M T^-1 with M = S - diag(S 1) - rate I has the decay rate `rate` exactly, on the cone of T."""

    @settings(max_examples=40)
    @given(unimodular(), st.integers(0, 2**32 - 1), st.sampled_from(["1/3", "2", "0.7", "22/7"]), st.booleans())
    def test_just_below_at_and_above_the_rate(self, T, seed, rate, discrete):
        rng, n, rate = np.random.default_rng(seed), 3, Fraction(rate) / (4 if discrete else 1)
        S = rng.integers(1, 4, (n, n)).astype(object) * Fraction(1, 60)
        np.fill_diagonal(S, 0)
        M = S - np.diag(S.sum(axis=1)) + np.diag([Fraction(int(discrete)) - rate] * n)
        T = T.astype(int).astype(object)
        inverse = np.round(np.linalg.inv(T.astype(float))).astype(int).astype(object)
        A, X = T @ M @ inverse, kp.PolyhedralCone(T.T.tolist())
        beside = [(rate * (1 + Fraction(1, 10**k)), False) for k in (2, 12, 18, 30)]
        for asked, proved in ((rate / 2, True), (rate * (1 - Fraction(1, 10**30)), True), (rate, True), *beside):
            cert = kp.linear_lyapunov(A.tolist(), X, discrete=discrete, rate=asked)
            assert cert.status is (Status.PROVED if proved else Status.REFUTED), (asked, cert.explain())
            assert cert.check() and cert.required_rate == asked
            assert not replace(cert, required_rate=rate * 2 if proved else rate).check()

    @pytest.mark.parametrize("rate", ["1/3", "0.4"])
    def test_files_keep_the_rate(self, rate, tmp_path):
        cert = kp.linear_lyapunov([["-4/3", 1], [1, "-4/3"]], kp.orthant(2), rate=rate)
        cert.save(tmp_path / "c.json")
        again = kp.load_certificate(tmp_path / "c.json")
        assert again.status is cert.status is (Status.PROVED if rate == "1/3" else Status.REFUTED)
        assert again.required_rate == Fraction(rate) and again.explain() == cert.explain() and again.check()

    def test_without_a_rate_files_are_as_before(self):
        assert "required_rate" not in kp.linear_lyapunov([[-1]], kp.orthant(1)).contents()

    def test_what_is_said(self):
        said = [kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2), rate=r).explain() for r in ("1/3", "1.5")]
        assert "at least as exp(-1/3 t)" in said[0]
        assert "no v'x, v in int X*, decreases at rate 3/2" in said[1] and "at a rate of at most 1." in said[1]
        s = kp.ConeStateSpace([[-2, 1], [1, -2]], [[1], [0]], [[1, 0]], 0)
        assert s.linear_lyapunov(rate=1) and not s.linear_lyapunov(rate=1.5)
        assert kp.feedback_interconnect([s, s], [[0, 0], [0, 0]]).linear_lyapunov(rate=1)

    def test_an_unstable_system_is_refuted_as_such(self):
        cert = kp.linear_lyapunov([[1]], kp.orthant(1), rate=1)
        assert cert.status is Status.REFUTED and "not exponentially stable" in cert.explain() and cert.check()


def test_what_is_proven_cannot_be_written_to():
    certificate = kp.linear_lyapunov([[0, 1], [-22, -13]], kp.examples.paper_cone())
    with pytest.raises(ValueError, match="read-only"):
        certificate.v[0] = -5
    unstable = kp.linear_lyapunov([[1.0]], kp.orthant(1))
    with pytest.raises(ValueError, match="read-only"):
        unstable.witness.x[0] = 0
    node = kp.examples.mass_spring_node()
    net = kp.feedback_interconnect([node, node], [[0, 1], [1, 0]])
    with pytest.raises(ValueError, match="read-only"):
        net.certificate.v[0][0] = 1


def test_rounding_of_the_diagonal_decides_stability_and_leaves_supply_undecided():
    rng = np.random.default_rng(26)
    A = rng.random((150, 150))
    A -= np.diag(A.sum(axis=1)) + 1e-15 * np.eye(150)  # row sums of 75, of which doubles know 14 digits
    certificate = kp.linear_lyapunov(A, kp.orthant(150))
    sums = [sum(map(Fraction, row)) for row in A.tolist()]
    assert max(sums) > 0 > min(sums)  # neither follows from the vector of ones
    assert certificate.status is kp.Status.PROVED and certificate.check() and 0 <= certificate.margin < 1e-12
    port, line = np.ones((150, 1)), kp.orthant(1)
    supply = kp.dissipativity(A, port, port.T, [[0]], kp.orthant(150), line, line, q=[-1], r=[1])
    assert supply.status is kp.Status.UNDECIDED and supply.check() and "Undecided" in supply.explain()


@pytest.mark.parametrize(("A", "discrete"), [([[-1, 1], [1, -1]], False), ([[1, 0], [0, 1]], True)])
def test_equality_proves_no_decay(A, discrete):
    positivity = kp.state_positivity(A, kp.orthant(2), discrete=discrete)
    certificate = LyapunovCertificate.settle(positivity=positivity, v=np.ones(2), decay_rate=0.0)
    assert positivity and certificate.status is kp.Status.UNDECIDED


def test_a_direction_refutes_only_what_is_positive_and_only_if_it_is_one():
    plane, up = kp.orthant(2), InstabilityDirection(np.array([1.0, 0.0]))
    positivity = kp.state_positivity([[1, 0], [0, -1]], plane)
    assert LyapunovCertificate.settle(positivity=positivity, witness=up).status is kp.Status.REFUTED
    for witness in (InstabilityDirection(np.zeros(2)), "up"):
        assert LyapunovCertificate.settle(positivity=positivity, witness=witness).status is kp.Status.UNDECIDED
    unproven = PositivityCertificate.settle(A=exact_matrix([[1, 0], [-1, -1]], "A"), X=plane)
    assert unproven.status is kp.Status.UNDECIDED
    assert LyapunovCertificate.settle(positivity=unproven, witness=up).status is kp.Status.UNDECIDED


@pytest.mark.parametrize(
    ("v", "exact"),
    [
        (np.ones((1, 2)), None),
        (np.array([1.0, np.nan]), None),
        (np.array([0.5, 0.25]), (Fraction(1, 2),)),
        (np.array([0.5, 0.25]), (Fraction(1, 2), Fraction(1, 3))),
    ],
)
def test_vectors_that_are_none(v, exact):
    with pytest.raises(DataError):
        exactly(InstabilityDirection(v, exact), "x")


@pytest.mark.parametrize(
    ("slow", "bound", "proven"), [(1, 1.0, True), (1, 1.5, True), (1, 0.5, False), (-1, 1.0, False)]
)
def test_a_bound_on_decay_rates_needs_a_direction_that_is_slow(slow, bound, proven):
    positivity = kp.state_positivity([[-1, 0], [0, -2]], kp.orthant(2))
    direction = {"slow_direction": np.array([float(slow), 0.0]), "decay_rate_bound": bound}
    certificate = LyapunovCertificate.settle(positivity=positivity, v=np.ones(2), decay_rate=1.0, **direction)
    assert (certificate.status is kp.Status.PROVED) is proven


@pytest.mark.parametrize(
    "A", [[[0, 1, 0], [2, -3, 1], [2, 2, -4]], [[0, 3, 0, 0], [2, -3, 0, 1], [1, 1, -2, 0], [3, 1, 0, -4]]]
)
def test_equations_that_are_singular_in_doubles_give_no_warning(A):
    """Both equations of the border are divided by 0 here; warnings are errors in these tests."""
    certificate = kp.linear_lyapunov(A, kp.orthant(len(A)))
    assert certificate.status is kp.Status.REFUTED and certificate.check()


@pytest.mark.parametrize("seed", range(60))
def test_units_of_the_states_decide_nothing(seed):
    """Rows without a diagonal entry have no size of their own: units 150 digits apart must not hide the verdict."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A = rng.integers(0, 4, (n, n)) * (rng.random((n, n)) < 0.7) * 1.0
    np.fill_diagonal(A, -rng.integers(0, 12, n) * (rng.random(n) < 0.6))
    far = 2.0 ** rng.integers(-250, 251, n)
    certificate = kp.linear_lyapunov(A * far[:, None] / far, kp.orthant(n))
    assert certificate.status is kp.linear_lyapunov(A, kp.orthant(n)).status is not kp.Status.UNDECIDED
    assert certificate.check()
