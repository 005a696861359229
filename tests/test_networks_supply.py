"""The modular test (III') with given supply rates: sigma is found, or outputs prove that there is none."""

import numpy as np
import pytest
from scipy.optimize import linprog

import control_kpos as kp


def node():
    """Dissipative with every q >= -1 and r >= 1/2 - q/4 or so: gain 1/2."""
    return kp.ConeStateSpace([[-2.0]], [[1.0]], [[1.0]], 0)


def certificate(W, q, r):
    rates = [([a], [b]) for a, b in zip(q, r, strict=True)]
    return kp.feedback_interconnect([node()] * len(q), W, supply_rates=rates).certificate


@pytest.mark.parametrize("seed", range(60))
def test_verdict_is_that_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    W = rng.random((n, n)) * (rng.random((n, n)) < 0.4)
    q, r = -rng.random(n) * 0.3, 0.2 + rng.random(n)
    if seed % 2:  # coarse numbers, so that many cases are exactly on the boundary
        W, q, r = np.round(8 * W) / 8, -rng.integers(0, 5, n) / 8, rng.integers(3, 8, n) / 8
    found = certificate(W, q, r)
    truth = linprog(np.zeros(n), np.diag(q) + W.T * r, np.zeros(n), bounds=(1, None))
    assert found.status is (kp.Status.PROVED if truth.status == 0 else kp.Status.REFUTED)
    assert found.check()
    if found:
        gains = np.diag(q) + W.T * r
        assert np.all(found.sigma > 0) and np.all(gains @ found.sigma <= 1e-12 * abs(gains) @ found.sigma)
    else:
        supply = q * found.witness.y + r * (W @ found.witness.y)
        assert np.all(supply >= -1e-15) and np.any(supply > 0)


def test_a_node_that_nobody_hears_and_a_supply_rate_without_outputs():
    """The last row of (III') is zero and has no slack; sigma = (3, 2, 1) fits the others."""
    W = np.zeros((3, 3))
    W[1, 0], W[2, 1] = 0.22307702229625076, 0.17673551085237668
    assert certificate(W, [-0.05, -0.05, 0.0], [0.3, 0.3, 0.3])


def test_a_loop_on_the_boundary_has_one_sigma_only():
    W = np.array([[0, 0.5], [0.5, 0]])
    found = certificate(W, [-0.125, -0.5], [0.5, 0.5])
    assert found and found.sigma[0] == 2 * found.sigma[1]
    assert certificate(W, [-0.125, np.nextafter(-0.5, 0)], [0.5, 0.5]).status is kp.Status.REFUTED


def test_weights_that_would_be_zero_are_not_weights():
    nodes = [
        kp.ConeStateSpace([[-2.5]], [[0]], [[1]], 0),
        kp.ConeStateSpace([[-1.5]], [[0]], [[1]], 0),
        kp.ConeStateSpace([[-2, 0.5], [0.25, -2]], [[1], [1]], [[1, 0.5]], 0),
    ]
    W = [[0.125, 0.125, 0.25], [0, 0, 0], [0.25, 0.25, 0]]
    rates = [([-0.125], [0.75]), ([-0.25], [0.125]), ([-0.375], [0.5])]
    found = kp.feedback_interconnect(nodes, W, supply_rates=rates).certificate
    assert found.status is kp.Status.REFUTED and "no weights sigma" in found.explain()
