"""Optimal control with linear cost: random transport networks with three controlled links a node.

What is in a node moves along three links and leaks; a control moves up to half as much more, or less, along each.
Beside HiGHS on the linear program of the guide, and beside the certificate of the closed loop.
"""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

import control_kpos as kp


def transport(n, links=3, seed=0):
    """Arguments of `optimal_feedback`, discrete time."""
    rng, size = np.random.default_rng(seed), n * links
    j = np.repeat(np.arange(n), links)
    k = (j + rng.integers(1, n, size=size)) % n
    w = rng.uniform(0.03, 0.1, size=size)
    kept = 1 - np.bincount(j, w, minlength=n) - rng.uniform(0.02, 0.3, size=n)
    nodes = kp.stack(kept[:, None, None], np.ones((1, 1)), np.ones((1, 1)), dt=True)
    ends = np.concatenate([k, j]), np.tile(np.arange(size), 2)
    return {
        "sys": kp.feedback_interconnect(nodes, sp.csr_array((w, (k, j)), shape=(n, n)), progress=False),
        "s": rng.uniform(0.5, 2, size=n),
        "r": rng.uniform(0, 0.3, size=size),
        "limits": sp.csr_array((0.5 * w, (np.arange(size), j)), shape=(size, n)),
        "controls": sp.csr_array((np.concatenate([np.ones(size), -np.ones(size)]), ends), shape=(n, size)),
    }


def proved(problem):
    a = kp.optimal_feedback(**problem)
    assert a and a.iterations <= 10 and a.certificate.gap <= 1e-6
    return a


def linear_program(problem, method):
    """max 1'p subject to s + (A - I)'p - L'zeta >= 0, |r + B'p| <= zeta."""
    B, L = problem["controls"], problem["limits"]
    n, m = B.shape
    own = sp.eye_array(m)
    rows = [[sp.eye_array(n) - problem["sys"].sparse_A.T, L.T], [B.T, -own], [-B.T, -own]]
    bound = np.concatenate([problem["s"], -problem["r"], problem["r"]])
    cost, sides = np.concatenate([-np.ones(n), np.zeros(m)]), [(None, None)] * (n + m)
    return linprog(cost, sp.csc_array(sp.block_array(rows)), bound, bounds=sides, method=method).x[:n]


@pytest.mark.timeout(600)
@pytest.mark.parametrize("who", ["ours", "highs-ipm", "highs-ds"])
def test_against_the_linear_program(contest, size, who):
    n = size(2000, 200)
    problem = transport(n)
    question = f"optimal control of a transport network, N = {n}"
    if who == "ours":
        contest(question, who, lambda: proved(problem))
        return
    p = contest(question, who, lambda: linear_program(problem, who), at_most=1 / 100, rounds=1)
    np.testing.assert_allclose(proved(problem).cost, p, rtol=1e-9)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("who", ["ours", "certificate of the closed loop"])
def test_a_million_nodes(contest, size, who):
    n = size(10**6, 2000)
    problem = transport(n)
    question = f"optimal control of a transport network, N = {n}"
    if who == "ours":
        contest(question, who, lambda: proved(problem), rounds=2)
        return
    loop = proved(problem).closed_loop.model

    def certify():
        certificate = kp.feedback_interconnect(loop.stacks[0], loop.W, progress=False).certificate
        assert certificate.status is kp.Status.PROVED

    contest(question, who, certify, at_most=12, rounds=2)
