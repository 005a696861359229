"""A nonlinear network of 100 000 nodes beside the certificate of one linear network of that size."""

import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp


def contacts(n):
    """Three neighbours each: a ring, and others at random."""
    rng, ring = np.random.default_rng(0), np.arange(n)
    rows, columns = (np.concatenate([end, rng.integers(0, n, 2 * n)]) for end in (ring, (ring + 1) % n))
    return sp.csr_array((rng.uniform(0.05, 0.15, 3 * n), (rows, columns)), shape=(n, n))


def epidemic(n):
    cure = np.random.default_rng(1).uniform(1, 2, n)
    nodes = kp.nonlinear_nodes(lambda x, u, p: [(1 - x[0]) * u[0] - p["cure"] * x[0]], n_nodes=n, params={"cure": cure})
    return kp.nonlinear_interconnect(nodes, contacts(n))


@pytest.mark.parametrize("who", ["ours", "certificate of the linear network at 0"])
def test_an_epidemic_of_a_hundred_thousand_cities(contest, size, who):
    net = epidemic(size(10**5, 10**3))

    def contracts():
        certificate = kp.differential_positivity(net, region=[[0, 1]])
        assert certificate.contracts and certificate.invariant

    def linear():
        A = -net.kinds[0].params["cure"][:, None, None]
        assert kp.feedback_interconnect(kp.stack(A, [[1]], [[1]]), net.upper, progress=False).certificate

    question = f"contraction of an SIS epidemic, N = {net.n_nodes}"
    contest(question, who, contracts if who == "ours" else linear, at_most=None if who == "ours" else 20, rounds=3)
