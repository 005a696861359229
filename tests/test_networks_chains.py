"""Chains far from normal, whose Perron vectors span thousands of digits: decided at the margin, and bracketed."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh_tridiagonal

import control_kpos as kp
from control_kpos.networks.spectrum.rational import NetworkPencil


def chain(size, up, down, shift=0.0):
    """A chain whose abscissa is that of a symmetric one, moved to a shift if it is not None, and the abscissa."""
    rates = -np.random.default_rng(0).uniform(0.5, 5, size)
    like = np.full(size - 1, np.sqrt(up * down))
    abscissa = eigh_tridiagonal(rates, like, select="i", select_range=(size - 1, size - 1))[0][0]
    moved = rates if shift is None else rates - abscissa + shift
    W = sp.diags_array([np.full(size - 1, up), np.full(size - 1, down)], offsets=[-1, 1]).tocsr()
    one = np.ones((size, 1, 1))
    net = kp.feedback_interconnect(kp.stack(moved.reshape(size, 1, 1), one, one), W)
    return net, abscissa if shift is None else shift


@pytest.mark.parametrize(
    ("size", "up", "down"), [(50, 10, 0.01), (50, 1e6, 1e-12), (400, 100, 0.001), (1500, 100, 0.001)]
)
def test_brackets_of_chains_are_tight(size, up, down):
    net, abscissa = chain(size, up, down, None)
    lower, upper = net.spectral_abscissa()
    assert lower - 1e-9 <= abscissa <= upper + 1e-9 and upper - lower <= 2e-6 * abs(abscissa)
    assert net.certificate


@pytest.mark.parametrize(("size", "up", "down"), [(50, 10, 0.01), (400, 100, 0.001), (1200, 10, 0.01)])
@pytest.mark.parametrize("shift", [1e-3, 1e-9, -1e-9, -1e-3])
def test_chains_beside_the_margin_are_decided(size, up, down, shift):
    net, _ = chain(size, up, down, shift)
    assert net.certificate.status.name == ("PROVED" if shift < 0 else "REFUTED") and net.certificate.check()
    lower, upper = net.spectral_abscissa()
    assert lower - 1e-12 <= shift <= upper + 1e-12 and upper - lower <= 1e-12 + 2e-6 * abs(shift)


def test_a_bracket_that_rounding_widens_is_proven_all_the_same():
    net, _ = chain(400, 100, 0.001, 1e-14)
    certificate = net.abscissa_certificate()
    assert certificate and certificate.check() and certificate.upper - certificate.lower < 1e-13


def test_feedthrough_does_not_widen_brackets_of_graphs_in_parts():
    rng, size = np.random.default_rng(1), 3000
    W = sp.csr_array(sp.random_array((size, size), density=3 / size, rng=rng))
    D = rng.uniform(0, 0.1, (size, 1, 1))
    nodes = kp.stack(
        -rng.uniform(0.1, 1, (size, 1, 1)) - 3, rng.uniform(0.5, 1, (size, 1, 1)), np.ones((size, 1, 1)), D
    )
    lower, upper = kp.feedback_interconnect(nodes, W).spectral_abscissa()
    assert upper - lower <= 2e-6 * abs(upper)


@pytest.mark.parametrize(("size", "up", "down"), [(60, 1.0, 1.0), (400, 100, 0.001)])
def test_frames_of_other_shifts_change_no_decision(size, up, down):
    """The first decision is at a far shift or at a near one; all of them use what it factored."""
    net, abscissa = chain(size, up, down)
    shifts = [abscissa + sign * distance for distance in (10.0, 1e-2, 1e-6, 1e-10) for sign in (1, -1)]
    for order in (shifts, shifts[::-1]):
        pencil = NetworkPencil(net.model).pencil
        for shift in order:
            found, N = pencil.decide(shift), pencil.at(shift)
            assert found.stable is (shift > abscissa)
            moved = (N.T if found.stable else N).apply(found.vector)
            assert (moved < 0).all() if found.stable else (moved >= 0).all() and found.vector.any()
