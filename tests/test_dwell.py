"""Dwell times of `switched`: enclosed exponentials, brackets, signals that are not stable."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import exp

import numpy as np
import pytest
import scipy.linalg as la

import control_kpos as kp
from control_kpos.families.dwell import partial_exponential, partial_sum

FAINSHIL = [[[-1, 0, 0], [10, -1, 0], [0, 0, -10]], [[-10, 0, 10], [0, -10, 0], [0, 10, -1]]]
WINGS = [[[-1, 10], [0, -1]], [[-1, 0], [10, -1]]]
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])


def about_times(s):
    """The certificates about dwell times, by status."""
    return {p.status.name: p for p in (s.certificate, *s.others) if isinstance(p, kp.DwellCertificate)}


def test_the_dwell_time_of_fainshils_pair():
    s = kp.switched(FAINSHIL)
    low, high = s.dwell_bounds
    assert low < 1.4384035 < high and high - low < 1e-3 and s.dwell_time == high
    assert s.status == "REFUTED" and s.check()  # by the cycle: no mixture refutes this pair
    assert about_times(s)["PROVED"].check() and about_times(s)["PROVED"].dwell_time <= Fraction(high)
    assert "1.43838 or longer" in s.explain() and "1.43856 or longer" in about_times(s)["PROVED"].explain()


@pytest.mark.parametrize("family", [FAINSHIL, WINGS])
def test_signals_that_dwell_decay_and_the_cycle_does_not(family):
    s = kp.switched(family)
    matrices = [np.array(A, dtype=float) for A in family]
    rng = np.random.default_rng(0)
    P = np.eye(len(matrices[0]))
    for k in range(60):
        P = la.expm(matrices[k % 2] * s.dwell_time * (1 + rng.exponential(0.2))) @ P
    assert np.abs(P).max() < 1e-2
    w = about_times(s)["REFUTED"].witness
    P = np.eye(len(matrices[0]))
    for k, t in zip(w.modes, w.times, strict=True):
        P = la.expm(matrices[k] * float(t)) @ P
    assert np.abs(np.linalg.eigvals(P)).max() >= 1 and min(w.times) >= Fraction(s.dwell_bounds[0])
    assert (P @ w.x - w.x >= -1e-9).all()


def test_a_closed_form():
    """e^{A T} = e^{-T} (I + 10 T E): the product has the trace e^{-2T} (2 + 100 T^2) and the determinant e^{-4T}."""

    def trace(T):
        return exp(-2 * T) * (2 + 100 * T**2) - 1 - exp(-4 * T)

    low, high = kp.switched(WINGS).dwell_bounds
    assert trace(low) >= 0 >= trace(high)


def test_every_order_is_stable_or_a_member_is_not():
    assert kp.switched([[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]]).dwell_bounds == (0.0, 0.0)
    s = kp.switched([[[1]], [[-1]]])
    assert s.dwell_bounds == (np.inf, np.inf) and s.dwell_time == np.inf
    assert kp.switched([[[1, 1], [0, 1]], [[1, 0], [1, 1]]], discrete=True).dwell_time == np.inf


def test_on_a_cone_of_four_generators(tmp_path):
    T = np.array([[1, 1, 0], [1, -1, 0], [0, 0, 1.0]])
    family = [np.linalg.inv(T) @ np.array(A, float) @ T for A in FAINSHIL]
    s = kp.switched(family, X=kp.PolyhedralCone(np.linalg.inv(T).T))
    assert s.dwell_bounds[0] < 1.4384035 < s.dwell_bounds[1] < 1.44
    waves = [[[-1, 0, 0], [0, -1, 0], [0, 0, -0.5]], [[-2, 0, 0], [0, -2, 0], [0, 0, -1]]]
    assert kp.switched(waves, X=SQUARE).dwell_time == 0


@pytest.mark.parametrize(
    ("z", "terms"), [(Fraction(1), 1), (Fraction(5, 2), 3), (Fraction(29, 2), 40), (Fraction(0), 1)]
)
def test_exponentials_are_enclosed(z, terms):
    done, rest = partial_exponential(z, terms)
    assert float(done) <= exp(z) * (1 + 1e-12) and exp(z) <= float(done + rest) * (1 + 1e-12)
    with pytest.raises(kp.DataError, match="terms do not show an exponential"):
        partial_exponential(Fraction(terms + 3, 2), terms)


def test_sums_of_matrices_are_exact():
    M = np.array([[Fraction(1, 3), Fraction(2)], [Fraction(0), Fraction(1, 7)]], dtype=object)
    x, t = np.array([[Fraction(1)], [Fraction(1, 2)]], dtype=object), Fraction(3, 4)
    total = term = x
    for k in range(1, 6):
        term = M @ term * t / k
        total = total + term
    assert (partial_sum(M, t, 5, x) == total).all()


def test_shorter_times_and_other_vectors_are_not_proven():
    s = kp.switched(FAINSHIL)
    enough, short = (about_times(s)[name] for name in ("PROVED", "REFUTED"))
    for changes in ({"dwell_time": Fraction(143, 100)}, {"vs": -enough.vs}, {"shifts": (Fraction(9), Fraction(10))}):
        assert not type(enough).settle(**enough.data() | changes)
    w = short.witness
    for changes in ({"x": -w.x}, {"times": tuple(t / 2 for t in w.times)}, {"shifts": (Fraction(9), Fraction(10))}):
        other = replace(w, **changes)
        assert type(short).settle(**short.data() | {"witness": other}).status == "UNDECIDED"
    assert type(short).settle(**short.data() | {"dwell_time": w.times[0] * 2}).status == "UNDECIDED"
    with pytest.raises(kp.DataError, match="a dwell time is positive"):
        type(short).settle(**short.data() | {"dwell_time": Fraction(0)})


def test_files_say_the_same(tmp_path):
    for p in about_times(kp.switched(FAINSHIL)).values():
        p.save(tmp_path / "file.json")
        assert kp.load_certificate(tmp_path / "file.json") == p


@pytest.mark.parametrize("seed", range(4))
def test_random_pairs(seed):
    rng = np.random.default_rng(seed)
    family = [rng.random((3, 3)) * 4 * (rng.random((3, 3)) < 0.4) for _ in range(2)]
    family = [A - np.diag(np.diag(A)) for A in family]
    family = [A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(3) for A in family]
    s = kp.switched(family)
    low, high = s.dwell_bounds
    assert low <= high and all(p.check() for p in s.others)
    assert all(a <= b for a, b in pairwise((0, low, high)))
