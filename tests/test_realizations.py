"""Positive realizations: planted ones are found, others refuted, and equations hold exactly."""

from dataclasses import replace
from fractions import Fraction
from math import pi, tan

import control as ct
import numpy as np
import pytest
from realized_systems import hidden

import control_kpos as kp
from control_kpos import checker
from control_kpos.find.realization.lower_bound import _has_walks, _walks, lower_bound
from control_kpos.find.realization.minimal import Realization, companion, minimal, of_response

FOUR = [0] + [1 - 25 * Fraction(2, 5) ** k + 75 * Fraction(1, 5) ** k for k in range(7)]


def responses(A, B, C, n):
    """C A^k B for k < n, in fractions."""
    A, B, C = (M.fractions() for M in (A, B, C))
    out = []
    for _ in range(n):
        out.append((C @ B).tolist())
        B = A @ B
    return out


def is_a_realization(found):
    """Same Markov parameters, signs, and the certificate checks."""
    cert = found.certificate
    p = cert.A_positive.fractions()
    off = p if cert.discrete else p - np.diag(np.diag(p))
    signs = (off >= 0).all() and all((M.fractions() >= 0).all() for M in (cert.B_positive, cert.C_positive, cert.D))
    length = len(p) + found.lower_bound + 1
    same = responses(cert.A, cert.B, cert.C, length) == responses(
        cert.A_positive, cert.B_positive, cert.C_positive, length
    )
    return bool(found) and found.check() and signs and same and found.system.nstates == found.order


@pytest.mark.parametrize("seed", range(40))
def test_hidden_realizations_are_found(seed):
    """With as few states as the hidden one has, or fewer; b'c > 0 so that rounding in `ct.tf` does no harm."""
    G, n = hidden(seed)
    found = kp.positive_realization(G)
    assert is_a_realization(found) and found.lower_bound <= found.order <= n


def test_four_rays_for_order_three():
    found = kp.positive_realization(FOUR)
    assert is_a_realization(found)
    assert found.lower_bound == found.order == 4  # of a system of three states
    assert len(found.certificate.A.values) == 3
    assert found.system.dt is True and found.system.is_cone_positive()


def test_the_order_of_a_response_that_is_zero_twice_is_the_smallest():
    """Graphs of three states lack its walks; the chain ends in a vertex that is no point of the orbit."""
    poles = [Fraction(1), Fraction(2, 5), Fraction(1, 5)]
    A = [[p if i == j else 0 for j in range(3)] for i, p in enumerate(poles)]
    found = kp.positive_realization(kp.ConeStateSpace(A, [[1], [1], [1]], [[1, -25, 75]], 0, True))
    assert is_a_realization(found) and found.order == found.lower_bound == 4
    h = responses(found.certificate.A_positive, found.certificate.B_positive, found.certificate.C_positive, 6)
    assert [x[0][0] for x in h] == [51, 6, 0, 0, Fraction(12, 25), Fraction(96, 125)]


def test_the_smallest_order_by_graphs():
    """Of all graphs with two states none has walks of 0 and 3 steps and none of 1 and 2, where a loop does not do."""
    s = of_response([Fraction(x) for x in FOUR])
    assert lower_bound(s, discrete=True) == 4
    positive = of_response([Fraction(0), *(Fraction(1) + Fraction(1, 2) ** k for k in range(6))])
    assert lower_bound(positive, discrete=True) == 2
    cycle = [Fraction(int(k % 3 == 1)) for k in range(12)]
    assert lower_bound(of_response(cycle), discrete=True) == 3
    for p in (1, 2, 3):  # every graph has the walks of its own responses
        rng = np.random.default_rng(p)
        P, b, c = (rng.integers(0, 2, shape) for shape in ((p, p), (p, 1), (1, p)))
        h = [int((c @ np.linalg.matrix_power(P, k) @ b)[0, 0]) for k in range(20)]
        assert _has_walks(_walks(p), np.array(h) > 0)
    assert not _has_walks(_walks(2), np.array([True, False, False, True, *[True] * 16]))
    assert _has_walks(_walks(4), np.array([True, True, False, False, *[True] * 16]))
    assert not _has_walks(_walks(3), np.array([False, False, False, True, *[True] * 16]))


@pytest.mark.parametrize("seed", range(60))
def test_bounds_of_the_order_hold_for_systems_of_that_order(seed):
    """Sparse systems of p states, many of them with fewer states in a minimal realization, and responses with zeros."""
    rng = np.random.default_rng(seed)
    p, discrete = 2 + seed % 3, seed % 4 > 0
    P = rng.integers(0, 4, (p, p)) * (rng.random((p, p)) < 0.45) - (0 if discrete else 3 * np.eye(p, dtype=int))
    b, c = (np.array(rng.random(shape) < 0.4, dtype=int) for shape in ((p, 1), (1, p)))
    A, B, C = (np.array(M.astype(int).tolist(), dtype=object) * Fraction(1) for M in (P, b, c))
    small = minimal(A, B, C, np.array([[Fraction(0)]], dtype=object))
    assert not len(small.A) or len(small.A) <= lower_bound(small, discrete=discrete) <= p


@pytest.mark.parametrize(
    ("P", "N", "Q"),
    [
        ([[3]], [[3]], [[1], [0]]),
        ([[3]], [[0, 2]], [[1]]),
        ([[0]], [[2]], [[0], [3]]),
        ([[0, 1], [1, 0]], [[1], [0]], [[0, 0], [2, 0]]),
    ],
)
def test_an_output_that_never_responds_needs_no_states(P, N, Q):
    """Nor does an input without effect: no state of its own, and no walk."""
    found = kp.positive_realization(ct.ss(P, N, Q, 0, True))
    assert is_a_realization(found) and found.order == found.lower_bound == len(P)


@pytest.mark.parametrize(
    ("P", "N", "Q", "order"),
    [
        # zeros leave no margin at either side of the cone
        ([[0, 4, 0], [0, 4, 0], [0, 0, 1]], [[4, 0], [4, 0], [2, 2]], [[0, 3, 0], [0, 2, 1]], 2),
        # a state that nobody sees, and one that nobody reaches
        ([[1, 0, 0], [2, 0, 0], [0, 3, 3]], [[0], [1], [0]], [[0, 1, 1]], 2),
        # the outer states are one
        ([[0, 1, 0], [1, 0, 1], [0, 1, 0]], [[1], [0], [1]], [[1, 0, 1]], 2),
    ],
)
@pytest.mark.parametrize("discrete", [True, False])
def test_nonnegative_systems_are_realizations_as_they_are(P, N, Q, order, discrete):
    found = kp.positive_realization(ct.ss(P, N, Q, 0, discrete))
    assert is_a_realization(found) and found.lower_bound <= found.order <= order


@pytest.mark.parametrize("p", [3, 4, 6])
def test_sectors_of_eigenvalues(p):
    """Random matrices, rings among them, stay inside; a ring is on the edge."""
    rng = np.random.default_rng(p)
    for sparse in (0, 0.5, 1):
        M = rng.random((200, p, p)) ** 3 * (rng.random((200, p, p)) > sparse) + np.roll(np.eye(p), 1, axis=0)
        values = np.linalg.eigvals(M)
        gap = values.real.max(axis=1, keepdims=True) - values.real
        assert (np.abs(values.imag) * tan(pi / p) <= gap * (1 + 1e-9) + 1e-9).all()


@pytest.mark.parametrize(("turn", "order"), [("1/2", 3), (1, 4), ("3/2", 6), (2, 7), (4, 13)])
def test_the_smallest_order_by_eigenvalues(turn, order):
    """0 and -1 ± i turn: tan(pi / p) <= 1 / turn."""
    assert tan(pi / order) <= 1 / float(Fraction(turn)) * (1 + 1e-12)
    assert order == 3 or tan(pi / (order - 1)) > 1 / float(Fraction(turn))
    A = np.array([[0, 0, 0], [0, -1, -Fraction(turn)], [0, Fraction(turn), -1]], dtype=object)
    one = np.array([[Fraction(1)]] * 3, dtype=object)
    s = Realization(A * Fraction(1), one, one.T, one[:1])
    assert lower_bound(s, discrete=False) == order
    A = np.array([[0, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=object) * Fraction(1)
    assert lower_bound(Realization(A, one, one.T, one[:1]), discrete=False) == 3  # no realization: nothing is said


def test_more_states_than_the_order_where_a_response_is_close_to_zero():
    found = kp.positive_realization(ct.ss(np.diag([-1, -2, -3]), np.ones((3, 1)), [[0.5, -1, 1]], 0))
    assert is_a_realization(found) and 3 <= found.order <= 5


def test_a_transfer_function():
    found = kp.positive_realization(ct.tf([1, 5, 5], [1, 6, 11, 6]))
    assert is_a_realization(found) and found.order == 3
    T = np.linspace(0, 5, 50)
    assert (np.diff(ct.step_response(found.system, T).outputs) >= -1e-12).all()
    given = ct.tf([1, 5, 5], [1, 6, 11, 6])
    assert np.allclose(ct.step_response(found.system, T).outputs, ct.step_response(given, T).outputs)


def test_common_factors_are_cancelled():
    found = kp.positive_realization(ct.tf([1, 1], [1, 3, 2]))
    assert is_a_realization(found) and (found.order, found.lower_bound) == (1, 1)
    hidden = kp.positive_realization(ct.ss([[-1, 0, 0], [0, 3, 0], [1, 0, 2]], [[1], [0], [0]], [[1, 1, 0]], 0))
    assert is_a_realization(hidden) and hidden.order == 1


def test_common_factors_that_rounding_keeps_are_told_of():
    """(s + 0.1) (s + 0.3) by itself and by a third factor: the product is rounded, and with it a pole stays."""
    nearly = ct.tf(np.poly([-1, -0.1, -2]), np.poly([-0.1, -3, -4, -5.0]))
    found = kp.positive_realization(nearly)
    assert found.status is kp.Status.REFUTED and "nearly the same response" in found.message
    assert "leave both out" in found.explain()
    assert "nearly" not in kp.positive_realization(ct.tf([1, -1], [1, 3, 2])).explain()


@pytest.mark.parametrize(
    ("G", "order"),
    [
        (ct.tf([2, 3], [1, 1]), 1),  # as many zeros as poles
        (ct.tf([1], [1, 0, 0, 0], True), 3),  # delays
        (ct.tf([1, 0, 2, 1], [1, 0, 0, 0], True), 3),
        (ct.tf([1, 0, 0, 1], [1, -0.5, 0, 0, 0], 0.1), 4),
        (ct.tf([1, 3], [1, -1, -2]), 2),  # unstable
        (ct.tf([1], [1, -2.5, 1], True), 2),
        (ct.tf([1], [1, 0]), 1),  # integrators
        (ct.tf([1], [1, 0, 0]), 2),
        (ct.zpk([-2], [-1, -3], 2), 2),
        ([0, 1, 1, 2, 3, 5], 2),
        (ct.ss([[-1, 0], [0, -2]], [[1, 0], [1, 0]], [[1, 1]], [[0, 1]]), 2),  # an input without states
        (ct.ss([[-1, 0], [0, -2]], [[1], [1]], [[0, 0], [1, 1]], 0), 2),  # an output without states
    ],
)
def test_kinds_of_systems(G, order):
    found = kp.positive_realization(G)
    assert is_a_realization(found) and found.order == found.lower_bound == order
    dt = True if isinstance(G, list) else G.dt
    assert found.system.dt == dt
    assert ("only system of order 2" in found.explain()) == isinstance(G, list)


@pytest.mark.parametrize(
    "G",
    [
        ct.tf([3], [1]),
        ct.tf([0], [1, 1]),
        ct.tf([0], [1, 0.5], True),
        ct.ss([], [], [], [[2, 0], [0, 1]]),
        ct.ss([[-1]], [[0]], [[1]], [[2]]),
        [3, 0, 0],
        [0, 0, 0],
    ],
)
def test_constants_need_no_states(G, tmp_path):
    found = kp.positive_realization(G)
    assert found and found.check() and found.order == found.system.nstates == found.lower_bound == 0
    assert "needs no states" in found.explain() and found.system.is_cone_positive()
    D = np.atleast_2d(G[0]) if isinstance(G, list) else np.atleast_2d(G(0.3))
    assert np.array_equal(found.system.D, D) and found.system.dt == (True if isinstance(G, list) else G.dt)
    found.save(tmp_path / "constant.json")
    assert checker.main(tmp_path / "constant.json") == 0
    negative = kp.positive_realization(ct.ss([], [], [], [[2, -1]]))
    assert negative.status is kp.Status.REFUTED and negative.check() and negative.certificate.witness.column == 1


@pytest.mark.parametrize(
    "G",
    [
        ct.ss([[-1, 1], [0, -1]], [[0, 0], [1, -1]], [[1, 0]], 0),
        ct.ss([[-1, 0], [1, -2]], [[1], [0]], [[0, 1], [0, -1]], 0),
        ct.ss([[0.5, 0], [1, 0.2]], [[1, -1], [0, 0]], [[0, 1]], 0, True),
    ],
)
def test_opposite_inputs_or_outputs(G):
    """C B = 0, and the response begins with the wrong sign later."""
    found = kp.positive_realization(G)
    assert found.status is kp.Status.REFUTED and found.check() and found.certificate.contains.shape[0] == 1


@pytest.mark.parametrize(
    "G",
    [
        ct.ss([[-1e200]], [[1e-200]], [[1e200]], 0),
        ct.ss([[-1e200, 1], [0, -1e-200]], [[1e150], [1e-150]], [[1e150, 1e150]], 0),
        [0, "1e-400", "1e-401", "1e-402", "1e-403"],
    ],
)
def test_numbers_of_any_size(G):
    found = kp.positive_realization(G)
    assert is_a_realization(found) and found.order == found.lower_bound


def test_responses_to_steps_never_fall():
    found = kp.positive_realization(FOUR)
    steps = ct.step_response(found.system, np.arange(12)).outputs
    assert (np.diff(steps) >= 0).all() and np.allclose(np.diff(steps)[:3], [51, 6, 0])
    assert "never fall" in found.explain()


def test_limits_of_time_are_kept():
    G = ct.ss(np.diag([-1, -2, -3]), np.ones((3, 1)), [[0.251, -1, 1]], 0)
    found = kp.positive_realization(G, time_limit=1e-6)
    assert found.status is kp.Status.UNDECIDED and "limit" in found.message and found.lower_bound == 3


def test_two_inputs_and_outputs():
    G = ct.tf([[[1], [2]], [[1], [0]]], [[[1, 1], [1, 2]], [[1, 1], [1]]])
    found = kp.positive_realization(G)
    assert is_a_realization(found)
    assert found.certificate.B.shape[1] == found.certificate.C.shape[0] == 2


@pytest.mark.parametrize(
    "G",
    [
        ct.tf([1, -1], [1, 3, 2]),  # a zero on the right
        ct.tf([-1], [1, 1]),
        ct.tf([-1, 1], [1, 1]),
        ct.tf([1], [1, 2, 5]),  # oscillates
        ct.tf([1, 1], [1, 1, 1], True),
        [0, 1, -1, 1, -1, 1],
    ],
)
def test_no_realization(G):
    found = kp.positive_realization(G)
    assert found.status is kp.Status.REFUTED and found.check() and found.system is None
    assert found.certificate.explain() in found.explain()


def test_wrong_certificates_are_noticed():
    cert = kp.positive_realization(FOUR).certificate
    assert cert and cert.check()
    for name in ("A", "B", "C", "A_positive", "B_positive", "C_positive", "transform"):
        assert not replace(cert, **{name: -getattr(cert, name)}).check()
    assert not type(cert).settle(**cert.data() | {"transform": None})
    assert not type(cert).settle(**cert.data() | {"witness": kp.NegativeResponse(0, 0, 1)})
    no = kp.positive_realization(ct.tf([-1], [1, 1])).certificate
    assert no.witness.step == 1 and no.check()
    for wrong in (kp.NegativeResponse(0, 0, 0), kp.NegativeResponse(1, 0, 1), kp.NegativeResponse(0, 0, 2)):
        assert not replace(no, witness=wrong).check()


def test_minimal_realizations_are_exact():
    F = Fraction
    s = companion([F(1), F(3), F(2)], [F(1), F(6), F(11), F(6)])  # (s + 1)(s + 2) of (s + 1)(s + 2)(s + 3)
    small = minimal(s.A, s.B, s.C, s.D)
    assert small.A.tolist() == [[-3]] and (small.C @ small.B).tolist() == [[1]]
    h = of_response([F(2), F(1), F(1), F(2), F(3), F(5), F(8)])  # Fibonacci
    assert h.D.tolist() == [[2]] and len(h.A) == 2 and (h.C @ h.A @ h.A @ h.A @ h.B).tolist() == [[3]]


@pytest.mark.parametrize(
    ("G", "says"),
    [
        ([1, 2, 3, 5, 9, 7], "determine no system"),
        ([], "without numbers"),
        ([[1, 2]], "give a transfer function"),
        ("1", "give a transfer function"),
        (ct.tf([1, 0, 0], [1, 1]), "more zeros than poles"),
        ([0, float("nan"), 1], "G"),
        (ct.frd([1, 2], [1, 2]), "G is a FrequencyResponseData"),
        (ct.ss(-np.eye(41), np.ones((41, 1)), np.ones((1, 41)), 0), "41 states"),
        (None, "G is None"),
    ],
)
def test_bad_arguments(G, says):
    with pytest.raises(kp.KposError, match=says):
        kp.positive_realization(G)


def test_huge_numbers_do_not_take_forever():
    """Terms of the series of e^(At) in fractions of a million digits are more than the effort allows."""
    found = kp.positive_realization(ct.ss([[1e308, 1], [-1e308, 1]], [[1], [1]], [[1, 1]], 0))
    assert found.status is not kp.Status.PROVED
