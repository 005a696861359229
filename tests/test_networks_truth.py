"""The verdict on random networks equals what the eigenvalues say, whatever the cones, sizes and timebase."""

import numpy as np
import pytest
from random_networks import dense_coupling, poles_by_dense_algebra, random_network

import control_kpos as kp
from control_kpos.networks import NetworkInstability
from control_kpos.proof.certificate import Status


@pytest.mark.parametrize("seed", range(8))
def test_verdict_is_the_eigenvalues(seed):
    rng = np.random.default_rng(1000 + seed)
    seen, kinds = dict.fromkeys(Status, 0), np.zeros(5, dtype=int)
    for _ in range(150):
        nodes, blocks, discrete = random_network(rng)
        W = dense_coupling(nodes, blocks)
        loop, poles, closed = poles_by_dense_algebra(nodes, W)
        edge = np.abs(poles).max() - 1 if discrete else poles.real.max()
        if abs(edge) < 1e-9 or abs(loop - 1) < 1e-6:
            continue
        net = kp.feedback_interconnect(nodes, blocks if rng.random() < 0.5 else W)
        cert = net.certificate
        seen[cert.status] += 1
        kinds += [discrete, not discrete, any(s.D.any() for s in nodes), not all(s.X.is_simplicial for s in nodes)] + [
            len({(s.nstates, s.ninputs, s.noutputs) for s in nodes}) > 1
        ]
        stable = edge < 0 and loop < 1
        assert cert.status is (Status.PROVED if stable else Status.REFUTED), cert.explain()
        assert cert.check()
        np.testing.assert_allclose(net.A, closed, rtol=1e-8, atol=1e-10 * np.abs(closed).max())
        if stable:
            slowest = (1 - np.abs(poles).max()) if discrete else -poles.real.max()
            assert 0 < cert.decay_rate <= slowest * (1 + 1e-9)
        elif isinstance(cert.witness, NetworkInstability):
            ahead = closed @ cert.witness.x - cert.witness.rate * cert.witness.x
            assert net.X.contains(cert.witness.x)
            assert net.X.contains(ahead + 1e-9 * np.abs(ahead).max() * net.X.interior_point)
    assert seen[Status.PROVED] > 20 and seen[Status.REFUTED] > 20
    assert (kinds > 20).all()  # discrete, continuous, with D, non-simplicial, of different sizes


@pytest.mark.parametrize("seed", range(3))
def test_bracket_encloses_the_rightmost_pole(seed):
    rng = np.random.default_rng(2000 + seed)
    done = 0
    for _ in range(40):
        nodes, blocks, _ = random_network(rng)
        loop, poles, _ = poles_by_dense_algebra(nodes, dense_coupling(nodes, blocks))
        if loop > 0.99:
            continue
        lower, upper = kp.feedback_interconnect(nodes, blocks).spectral_abscissa()
        exact = poles.real.max()
        slip = 1e-9 * max(1.0, np.abs(poles).max())
        assert lower - slip <= exact <= upper + slip
        assert upper - lower <= 2e-6 * max(abs(exact), 1e-3)
        done += 1
    assert done > 15


def test_permuting_the_nodes_changes_nothing():
    rng = np.random.default_rng(5)
    for _ in range(40):
        nodes, blocks, _ = random_network(rng)
        order = rng.permutation(len(nodes))
        one = kp.feedback_interconnect(nodes, blocks).certificate
        other = kp.feedback_interconnect([nodes[j] for j in order], [[blocks[j][k] for k in order] for j in order])
        assert one.status is other.certificate.status
        if one:
            assert other.certificate.decay_rate == pytest.approx(one.decay_rate, rel=1e-5)
            np.testing.assert_allclose(other.certificate.node_margins, one.node_margins[order], rtol=1e-4, atol=1e-9)
