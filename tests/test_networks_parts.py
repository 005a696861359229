"""Networks that fall into parts: verdicts and brackets with one-way links, and with none."""

import numpy as np
import pytest
import scipy.sparse as sp
from random_networks import dense_coupling, marginal_network, poles_by_dense_algebra, random_network

import control_kpos as kp
from control_kpos.networks import NodeViolation
from control_kpos.networks.spectrum.strong_parts import strong_parts
from control_kpos.proof.certificate import Status


def lags(rates, D=0.0):
    return kp.stack(-np.asarray(rates)[:, None, None], [[1.0]], [[1.0]], [[D]])


def random_ring_with_chords(rng, n):
    """A strongly connected graph whose rows sum to one."""
    order = rng.permutation(n)
    ring = sp.csr_array((np.ones(n), (order, np.roll(order, 1))), shape=(n, n))
    chords = sum(sp.eye_array(n, format="csr")[rng.permutation(n)] for _ in range(2))
    return sp.csr_array((ring + chords) / 3)


def in_a_row(rng, gains, size, link):
    """Strongly connected parts of equal size, each feeding the next through one link."""
    count = len(gains)
    blocks = sp.block_diag([g * random_ring_with_chords(rng, size) for g in gains])
    ahead = (np.arange(1, count) * size, np.arange(count - 1) * size + 1)
    return sp.csr_array(blocks.tocsr() + sp.csr_array((np.full(count - 1, link), ahead), shape=blocks.shape))


@pytest.mark.parametrize("link", [1.0, 1e3])
@pytest.mark.parametrize("slack", [1e-2, 1e-4, 1e-7])
def test_equal_parts_in_a_row(slack, link):
    """Their eigenvectors coincide but for rounding: the closed loop has nearly one Jordan block."""
    rng = np.random.default_rng(0)
    stable = kp.feedback_interconnect(lags(np.ones(1000)), in_a_row(rng, np.full(10, 1 - slack), 100, link))
    assert stable.certificate.status is Status.PROVED
    lower, upper = stable.spectral_abscissa()
    assert lower <= -slack * (1 - 1e-6) and upper >= -slack * (1 + 1e-6)
    if slack > 1e-7:
        assert upper - lower <= 1e-6 * slack
    gains = np.full(10, 1 - 1e-4)
    gains[4] = 1 + slack
    certificate = kp.feedback_interconnect(lags(np.ones(1000)), in_a_row(rng, gains, 100, link)).certificate
    assert certificate.status is Status.REFUTED and certificate.check()


def test_parts_with_feedthrough_in_a_row():
    rng = np.random.default_rng(1)
    W = in_a_row(rng, np.full(6, 0.4), 100, 5.0)
    nodes = lags(np.ones(600), D=0.5)  # gain of a part: 0.4 (1 + 0.5) = 0.6
    net = kp.feedback_interconnect(nodes, W)
    assert net.certificate.status is Status.PROVED and net.certificate.check()
    lower, upper = net.spectral_abscissa()  # x' = -x + u, u = 0.4 (x + u / 2)
    assert lower <= -1 + 0.5 + 1e-9 and upper >= -0.5 - 1e-9 and upper - lower < 1e-5


def test_a_network_in_one_piece_has_no_parts():
    net = kp.feedback_interconnect(lags([1.0, 1.0]), [[0, 0.5], [0.5, 0]])
    assert strong_parts(net.model) is None
    apart = kp.feedback_interconnect(lags([1.0, 1.0]), [[0.5, 0], [0, 0.5]])
    assert strong_parts(apart.model) is None  # nothing leads from one to the other
    one_way = kp.feedback_interconnect(lags([1.0, 1.0]), [[0.5, 7.0], [0, 0.5]])
    np.testing.assert_array_equal(strong_parts(one_way.model).inner.W.toarray(), [[0.5, 0], [0, 0.5]])


def test_long_chains_are_not_cut_into_levels():
    n = 2000
    chain = kp.feedback_interconnect(lags(np.ones(n)), sp.diags_array(np.full(n - 1, 0.9), offsets=-1, format="csr"))
    parts = strong_parts(chain.model)
    assert parts.joined(np.ones(n), np.ones(n)) is None
    assert chain.certificate.status is Status.PROVED


# -- small networks: brackets are always found


@pytest.mark.parametrize("density", [0.0, 0.1, 0.3])
def test_small_networks_in_parts_have_a_bracket(density):
    rng = np.random.default_rng(int(100 * density))
    done = 0
    for _ in range(150):
        nodes, blocks, _ = random_network(rng, 6, density)
        W = dense_coupling(nodes, blocks)
        loop, poles, _ = poles_by_dense_algebra(nodes, W)
        if loop > 0.99:
            continue
        certificate = kp.feedback_interconnect(nodes, W).abscissa_certificate()
        assert certificate.status is Status.PROVED and certificate.check()
        top = poles.real.max()
        # several nearly equal eigenvalues in a row spoil the digits of those that LAPACK computes
        assert certificate.lower - 1e-4 <= top <= certificate.upper + 1e-4
        assert certificate.upper - certificate.lower <= 2e-6 * abs(certificate.upper)
        done += 1
    assert done > 100


def test_networks_on_the_margin_have_a_bracket():
    widths = []
    for seed in range(3000, 3120):
        made = marginal_network(np.random.default_rng(seed))
        if made is None:
            continue
        nodes, W, discrete = made
        if poles_by_dense_algebra(nodes, W)[0] > 0.99:
            continue
        net = kp.feedback_interconnect(nodes, W)
        certificate = net.abscissa_certificate()
        if isinstance(net.certificate.witness, NodeViolation):
            assert certificate.status is Status.UNDECIDED
            continue
        assert certificate.status is Status.PROVED and certificate.check(), seed
        least = 1.0 if discrete else 0.0
        assert (certificate.upper < least) <= (net.certificate.status is Status.PROVED)
        assert (certificate.lower >= least) <= (net.certificate.status is Status.REFUTED)
        size = max(float(np.abs(s.A).max()) for s in nodes)
        widths.append((certificate.upper - certificate.lower) / max(abs(certificate.upper), 2.0**-39 * size + 1e-300))
    assert len(widths) > 90 and max(widths) < 3e-6
