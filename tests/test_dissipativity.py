"""Theorem 3: dissipativity with linear storage and supply, and induced gains."""

from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_positivity import PAPER, PLANT, closed_loop, metzler, perturbations, unimodular

import control_kpos as kp
from control_kpos.errors import DataError
from control_kpos.exact.intake import exact_matrix
from control_kpos.proof.certificate import Status
from control_kpos.theorems.dissipativity import DissipativityCertificate, SupplyViolation
from control_kpos.theorems.positivity import PositivityCertificate

R1, R2 = kp.orthant(1), kp.orthant(2)
LAG = [[-2.0]], [[1.0]], [[1.0]], [[0.0]]


def positive_matrix(rows, columns):
    return st.lists(st.lists(st.integers(0, 3), min_size=columns, max_size=columns), min_size=rows, max_size=rows).map(
        lambda m: np.array(m, dtype=float)
    )


def inequalities(cert, A, B, C, D, X, U, discrete=False):
    """The three inequalities of the theorem, recomputed in floating point."""
    S = np.asarray(A) - np.eye(len(A)) if discrete else np.asarray(A)
    v, q, r, a = cert.v, cert.q, cert.r, cert.decay_rate
    return X.rays @ v, X.rays @ (S.T @ v + a * v - C.T @ q), U.rays @ (B.T @ v - r - D.T @ q)


def test_a_chain_of_eighty_lags_at_its_gain():
    """The gain of a chain of lags is one: that supply is refuted, because the decrease is not strict."""
    n = 80
    A, B, C = np.eye(n, k=-1) - np.eye(n), np.eye(n)[:, :1], np.eye(n)[-1:]
    X = kp.orthant(n)
    at = kp.dissipativity(A, B, C, [[0.0]], X, R1, R1, q=[-1], r=[1])
    assert at.status is Status.REFUTED and at.check()
    assert kp.dissipativity(A, B, C, [[0.0]], X, R1, R1, q=[-1], r=[1.01])


@pytest.mark.parametrize("r", [0.5000001, 0.6, 10.0, 1e6])
def test_supply_above_the_gain_is_enough(r):
    cert = kp.dissipativity(*LAG, R1, R1, R1, q=[-1], r=[r])
    assert cert and cert.check() and cert.decay_rate > 0


@pytest.mark.parametrize("r", [0.5, 0.4999999, 0.0, -1.0])
def test_supply_up_to_the_gain_is_not(r):
    # the gain 1/2 itself is an infimum that no exponential certificate attains
    cert = kp.dissipativity(*LAG, R1, R1, R1, q=[-1], r=[r])
    assert cert.status is Status.REFUTED and cert.check()
    w = cert.witness
    assert -2 * w.x[0] + w.u[0] >= 0 and -w.x[0] + r * w.u[0] <= 0


def test_least_supply_is_the_gain():
    cert = kp.dissipativity(*LAG, R1, R1, R1, q=[-1])
    assert cert and cert.check() and 0.5 < cert.r[0] < 0.5 * (1 + 1e-5)


def test_most_output_for_a_given_input_supply():
    cert = kp.dissipativity(*LAG, R1, R1, R1, r=[3])
    assert cert and cert.check() and -6 < cert.q[0] < -6 * (1 - 1e-5)


def test_nothing_given():
    cert = kp.dissipativity(*LAG, R1, R1, R1)
    assert cert and cert.q[0] == -1 and 0.5 < cert.r[0] < 0.51


def test_an_unstable_system_can_be_dissipative_when_the_output_pays():
    system = [[1.0]], [[1.0]], [[1.0]], [[0.0]]
    cert = kp.dissipativity(*system, R1, R1, R1, q=[3], r=[2])
    assert cert and cert.check()
    refused = kp.dissipativity(*system, R1, R1, R1, q=[-1])
    assert refused.status is Status.REFUTED and refused.r is None and refused.check()


def test_hidden_unstable_modes_do_not_pass():
    # v = 0 satisfies the printed inequalities; the unstable mode is not seen by the output
    A, B, C, D = np.diag([-1.0, 1.0]), [[1.0], [0.0]], [[1.0, 0.0]], [[0.0]]
    cert = kp.dissipativity(A, B, C, D, R2, R1, R1, q=[0], r=[1])
    assert cert.status is Status.REFUTED and cert.check()


def test_feedthrough_counts():
    # G(0) = 1/2 + 2
    system = [[-2.0]], [[1.0]], [[1.0]], [[2.0]]
    assert kp.dissipativity(*system, R1, R1, R1, q=[-1], r=[2.51])
    assert kp.dissipativity(*system, R1, R1, R1, q=[-1], r=[2.49]).status is Status.REFUTED
    assert kp.induced_gain(*system, R1, R1, R1) == 2.5


def test_mass_spring_of_the_paper():
    A = np.array(closed_loop(-21, -14), dtype=float)
    B, C, D = (np.array(m, dtype=float) for m in PLANT[1:])
    cert = kp.dissipativity(A, B, C, D, PAPER, R1, R1, q=[-1])
    assert cert and cert.check() and abs(cert.r[0] - 1 / 22) < 1e-6
    storage, state, inputs = inequalities(cert, A, B, C, D, PAPER, R1)
    assert (storage > 0).all() and (state <= 1e-12).all() and (inputs <= 1e-15).all()
    # section V.B: r = v'B and q = -r close the ring
    v = np.array([5.09, 0.836])
    ring = kp.dissipativity(closed_loop(-21, -13), B, C, D, PAPER, R1, R1, q=[-0.836], r=[0.836])
    assert ring and (PAPER.rays @ (np.array(closed_loop(-21, -13), dtype=float).T @ v + 0.836 * C[0]) < 0).all()


@given(metzler(3), unimodular(), positive_matrix(3, 2), positive_matrix(2, 3), positive_matrix(2, 2), st.booleans())
@settings(deadline=None, max_examples=60)
def test_gain_is_the_threshold_of_dissipativity(M, T, N, L, D, discrete):
    A = T @ (M / 16 + np.eye(3) * discrete if discrete else M) @ np.rint(np.linalg.inv(T))
    if discrete and (np.diag(M) < -16).any():
        return
    B, C = T @ N, L @ np.rint(np.linalg.inv(T))
    X = kp.PolyhedralCone(T.T)
    system = A, B, C, D, X, R2, R2
    f = np.array([1.0, 2.0])
    S = A - np.eye(3) if discrete else A
    G = D - C @ np.linalg.solve(S, B)
    gain = kp.induced_gain(*system, discrete=discrete, e=[1, 1], f=f)
    assert gain == pytest.approx((f @ G).max(), rel=1e-9)
    assert kp.induced_gain(*system, discrete=discrete, norm="Linf") == pytest.approx(G.sum(axis=1).max(), rel=1e-9)
    above = kp.dissipativity(*system, q=-f, r=(f @ G) * 1.001 + 1e-6, discrete=discrete)
    assert above and above.check()
    if gain > 0:
        below = kp.dissipativity(*system, q=-f, r=(f @ G) * 0.999, discrete=discrete)
        assert below.status is Status.REFUTED and below.check()


def test_gains_are_correctly_rounded():
    assert kp.ConeStateSpace([["-1/3"]], [["1/7"]], [[1]], 0).gain() == float(Fraction(3, 7))
    assert kp.ConeStateSpace([["-1/3"]], [["1/7"]], [[1]], 0).gain(e=["1/3"], f=["1/11"]) == float(Fraction(9, 77))
    n, rate = 12, Fraction(1, 10**6)  # C adj(A) B is the same for every rate: a condition number of 10^7
    S = np.array([[Fraction((i * j) % 5 + 1, 7) * (i != j) for j in range(n)] for i in range(n)], dtype=object)
    A = S - np.diag(S.sum(axis=1)) - rate * np.eye(n, dtype=int).astype(object)
    ones = np.ones((n, 1), dtype=int)  # A 1 = -rate 1
    s = kp.ConeStateSpace(A.tolist(), ones, ones.T / 4, 0)
    assert s.gain() == s.gain(norm="Linf") == float(Fraction(n, 4) / rate)


def test_gain_agrees_with_simulation():
    A, B, C = [[-3.0, 1.0], [0.5, -2.0]], [[1.0], [0.0]], [[1.0, 1.0]]
    t = np.linspace(0, 20, 4001)
    y = np.asarray(ct.impulse_response(ct.ss(A, B, C, 0), t).outputs)
    assert kp.induced_gain(A, B, C, 0, R2, R1, R1) == pytest.approx(np.trapezoid(y, t), rel=1e-3)


def test_gain_of_unstable_and_of_non_positive_systems():
    assert kp.induced_gain([[1]], [[1]], [[1]], [[0]], R1, R1, R1) == np.inf
    with pytest.raises(kp.KposError, match="positive systems only"):
        kp.induced_gain([[-1]], [[-1]], [[1]], [[0]], R1, R1, R1)
    with pytest.raises(kp.DataError, match="norm is 'H2'"):
        kp.induced_gain(*LAG, R1, R1, R1, norm="H2")
    with pytest.raises(kp.DataError, match=r"e = .* interior"):
        kp.induced_gain(*LAG, R1, R1, R1, e=[0.0])


@pytest.mark.parametrize(("q", "r"), [([-1], [0.6]), ([-1], None), (None, [1.0]), ([-1], [0.3])])
def test_a_changed_certificate_does_not_pass(q, r):
    cert = kp.dissipativity([[-2.5]], [[1]], [[1]], [[0]], R1, R1, R1, q=q, r=r)
    assert cert.check()
    for name, changed in perturbations(cert):
        if cert.witness is not None and name in ("v", "decay_rate"):
            continue
        assert not changed.check(), name
    if cert.witness is not None:
        w = cert.witness
        for bad in (replace(w, x=-w.x, x_exact=None), replace(w, x=0 * w.x, u=0 * w.u, x_exact=None, u_exact=None)):
            assert not replace(cert, witness=bad).check()


@pytest.mark.parametrize("scale", [1e-150, 1e150, 2.0**300])
def test_scale_changes_no_verdict(scale):
    for r, expected in ((0.51, Status.PROVED), (0.49, Status.REFUTED)):
        cert = kp.dissipativity([[-2 * scale]], [[scale]], [[1]], [[0]], R1, R1, R1, q=[-1], r=[r])
        assert cert.status is expected and cert.check()


@pytest.mark.parametrize(
    ("q", "r", "text"),
    [
        ([-1, 2], None, "q is 1 x 2, but must be 1 x 1"),
        (None, [1, 2], "r is 1 x 2"),
        ([np.nan], None, "q.* is nan"),
    ],
)
def test_bad_supply_rates_are_refused(q, r, text):
    with pytest.raises(ValueError, match=text):
        kp.dissipativity(*LAG, R1, R1, R1, q=q, r=r)


def test_files_keep_the_verdict(tmp_path):
    for r in (0.6, 0.3):
        cert = kp.dissipativity(*LAG, R1, R1, R1, q=[-1], r=[r])
        cert.save(tmp_path / "c.json")
        again = kp.load_certificate(tmp_path / "c.json")
        assert again.status is cert.status and again.check() and again.explain() == cert.explain()


def forged(*, A=-2, B=1, C=1, D=0, **data):
    line = kp.orthant(1)
    positivity = kp.cone_positivity([[A]], [[B]], [[C]], [[D]], line, line, line)
    return DissipativityCertificate.settle(positivity=positivity, **{"q": np.array([-1.0]), **data})


def test_what_proves_no_dissipation():
    vectors = {"v": np.array([1.0]), "r": np.array([1.0]), "decay_rate": 0.0}
    assert forged(**vectors)
    assert not forged(A=-1, **vectors)  # (v'A - q'C) x = 0
    assert not forged(**{**vectors, "r": np.array([0.5])})
    assert not forged(D=1, **vectors) and forged(D=1, **{**vectors, "r": np.array([2.0])})
    for name in ("v", "r"):
        without = forged(**{**vectors, name: None})
        assert without.status is Status.UNDECIDED
        with pytest.raises(DataError):
            without.conditions()


def test_storage_must_be_positive_on_every_generator():
    plane, line = kp.orthant(2), kp.orthant(1)
    positivity = kp.cone_positivity([[-1, 0], [0, -1]], [[0], [0]], [[0, 1]], [[0]], plane, line, line)
    data = {"positivity": positivity, "q": np.array([1.0]), "r": np.array([1.0]), "decay_rate": 0.0}
    assert not DissipativityCertificate.settle(v=np.array([1.0, 0.0]), **data)
    assert DissipativityCertificate.settle(v=np.array([1.0, 1.0]), **data)


@pytest.mark.parametrize(
    ("system", "x", "u", "r", "status"),
    [
        ({"B": 0}, 0, 1, -1, Status.REFUTED),  # the input costs supply and does nothing
        ({"B": 0}, 0, 1, 0, Status.UNDECIDED),  # nothing happens
        ({}, 0, 1, 0, Status.REFUTED),  # the state moves for nothing
        ({}, 0, 1, 0.1, Status.UNDECIDED),  # for some supply
        ({}, 0, -1, 1, Status.UNDECIDED),  # by an input that is none
        ({"A": 1}, -1, 0, 1, Status.UNDECIDED),  # from a state that is none
        ({"A": 0}, 1, 0, None, Status.REFUTED),
        ({}, 1, 0, None, Status.UNDECIDED),
        ({}, 0, 1, None, Status.UNDECIDED),  # r may be as large as it likes
        ({"D": 1}, 0, 1, 1, Status.REFUTED),  # the output takes what the input brings
        ({"D": 1}, 0, 1, 2, Status.UNDECIDED),
    ],
)
def test_motions_that_no_storage_survives(system, x, u, r, status):
    witness = SupplyViolation(np.array([float(x)]), np.array([float(u)]))
    certificate = forged(r=None if r is None else np.array([float(r)]), witness=witness, **system)
    assert certificate.status is status


def test_motions_refute_only_what_is_positive():
    line, A, one = kp.orthant(1), exact_matrix([[1]], "A"), exact_matrix([[1]], "B")
    unproven = PositivityCertificate.settle(A=A, B=-one, C=one, D=one, X=line, U=line, Y=line)
    witness = SupplyViolation(np.array([1.0]), np.array([0.0]))
    data = {"q": np.array([-1.0]), "r": np.array([1.0]), "witness": witness}
    assert unproven.status is Status.UNDECIDED
    assert DissipativityCertificate.settle(positivity=unproven, **data).status is Status.UNDECIDED
