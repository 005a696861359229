"""Chains far from normal, whose Perron vectors span thousands of digits: decided at the margin, and bracketed."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from random_networks import is_stable, marginal_network
from scipy.linalg import eigh_tridiagonal

import control_kpos as kp
from control_kpos.exact.condition import all_hold
from control_kpos.networks import conditions as on
from control_kpos.networks.spectrum.rational import ClosedPencil, NetworkPencil, network_pencil
from control_kpos.networks.witnesses import kept_parts, positive_parts


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


# -- large networks at the margin: brackets there, with unknowns for the inputs and without, evaluated once


def masses(n, weight):
    A = np.tile([[0, 1], [-22.0, -13]], (n, 1, 1))
    nodes = kp.stack(A, [[0], [1]], [[1, 0]], X=kp.PolyhedralCone([[0, 1], [1, -2]]))
    return kp.feedback_interconnect(nodes, weight * kp.examples.ring(n))


@pytest.mark.parametrize("n", [50, 4000])
@pytest.mark.parametrize("weight", [np.nextafter(22.0, 0), 22.0, np.nextafter(22.0, 23), 22 - 1e-9, 22 + 1e-9])
def test_brackets_of_rings_beside_the_margin(n, weight):
    """The abscissa is the larger root of s^2 + 13 s + 22 - weight."""
    certificate = masses(n, weight).abscissa_certificate()
    assert certificate and certificate.check()
    below, above = (
        s * s + 13 * s + 22 - Fraction(float(weight)) for s in map(Fraction, (certificate.lower, certificate.upper))
    )
    assert below <= 0 <= above
    size = max(abs(certificate.upper), 2.0**-40 * 22)
    assert certificate.upper - certificate.lower <= 2e-6 * size


@pytest.mark.parametrize("seed", [0, 1])
def test_regular_graphs_whose_factors_fill_in(seed):
    n = 2500
    W = sp.csr_array(kp.examples.random_regular(n, 3, seed=seed))
    W.data = np.random.default_rng(seed).integers(1, 9, W.nnz).astype(float)
    d, one = np.asarray(W.sum(axis=1)).ravel(), np.ones((n, 1, 1))
    for change, status in ((2.0**-52, "PROVED"), (0.0, "REFUTED"), (-(2.0**-53), "REFUTED")):
        net = kp.feedback_interconnect(kp.stack(-(d * (1 + change)).reshape(n, 1, 1), one, one), W)
        assert net.certificate.status.name == status and net.certificate.check()
        lower, upper = net.spectral_abscissa()
        assert lower < 0 or change <= 0
        assert (upper < 0) is (change > 0) and (lower > 0) is (change < 0) and upper - lower < 1e-16


def test_the_closed_loop_is_decided_as_the_equations_with_ports():
    count = {True: 0, False: 0}
    for seed in range(300):
        found = marginal_network(np.random.default_rng(seed))
        if found is None:
            continue
        nodes, W, discrete = found
        net = kp.feedback_interconnect(nodes, W)
        if net.model.has_feedthrough:
            assert type(network_pencil(net.model)) is NetworkPencil
            continue
        one, other = (kind(net.model).decide(float(discrete)) for kind in (ClosedPencil, NetworkPencil))
        assert one is not None and other is not None
        assert one[0] is other[0] is is_stable(nodes, W, discrete)
        count[one[0]] += 1
    assert min(count.values()) > 10


def test_a_hub_keeps_unknowns_for_the_inputs():
    n = 60
    B = np.ones((n, 8, 1))
    nodes = kp.stack(np.tile(-np.eye(8), (n, 1, 1)), B, np.ones((n, 1, 8)))
    assert type(network_pencil(kp.feedback_interconnect(nodes, np.ones((n, n)) / n).model)) is NetworkPencil
    assert type(network_pencil(masses(5, 1.0).model)) is ClosedPencil


@pytest.mark.parametrize("n", [50, 4000])
@pytest.mark.parametrize("weight", [20.0, 22.0])
def test_nodes_and_links_are_proven_once_and_forgotten(n, weight, monkeypatch):
    calls, before = [], on.positivity
    monkeypatch.setattr(on, "positivity", lambda model, g: calls.append(g) or before(model, g))
    net = masses(n, weight)
    certificate = net.abscissa_certificate()
    assert certificate and calls == [0]
    assert certificate.check() and calls == [0, 0]  # a check evaluates them anew
    with kept_parts(net.model):
        first, second = positive_parts(net.model), positive_parts(net.model)
        assert all(a is b for a, b in zip(first, second, strict=True)) and all_hold(first)
    assert positive_parts(net.model)[0] is not first[0]
