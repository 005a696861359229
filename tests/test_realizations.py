"""Positive realizations: planted ones are found, others refuted, and equations hold exactly."""

from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.find.realization.minimal import companion, minimal, of_response

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


@pytest.mark.parametrize("seed", range(12))
def test_planted_realizations_are_found(seed):
    rng = np.random.default_rng(seed)
    n, discrete = 2 + seed % 2, seed % 4 > 1
    P = rng.integers(0, 5, (n, n)) / 16
    P = P if discrete else P - 2 * np.eye(n)
    b, c, T = rng.integers(1, 4, (n, 1)), rng.integers(1, 4, (1, n)), rng.integers(-3, 4, (n, n)) + 5 * np.eye(n)
    inverse = np.linalg.inv(T)
    H = [c @ np.linalg.matrix_power(P, k) @ b for k in range(2 * n + 1)]
    found = kp.positive_realization([0, *(float(h[0, 0]) for h in H)]) if discrete else kp.positive_realization(
        ct.ss(T @ P @ inverse, T @ b, c @ inverse, 0)
    )  # fmt: skip
    assert is_a_realization(found) and found.order == n


def test_four_rays_for_order_three():
    found = kp.positive_realization(FOUR)
    assert is_a_realization(found)
    assert found.lower_bound == found.order == 4  # of a system of three states
    assert len(found.certificate.A.values) == 3
    assert found.system.dt is True and found.system.is_cone_positive()


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
        (ct.tf([3], [1]), "G is constant"),
        (ct.tf([1, 0, 0], [1, 1]), "more zeros than poles"),
        ([0, float("nan"), 1], "G"),
    ],
)
def test_bad_arguments(G, says):
    with pytest.raises(kp.KposError, match=says):
        kp.positive_realization(G)
