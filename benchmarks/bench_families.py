"""Families under switching: dwell times, growth, and the mean when a Markov chain switches.

Beside a bisection of the same linear program with HiGHS, products of matrices, and eigenvalues of the means.
"""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linprog
from scipy.sparse.linalg import eigs

import control_kpos as kp

FAINSHIL = [[[-1, 0, 0], [10, -1, 0], [0, 0, -10]], [[-10, 0, 10], [0, -10, 0], [0, 10, -1]]]
SHEARS = [[[1, 1], [0, 1]], [[1, 0], [1, 1]]]


def has_vectors(T):
    """v_s > 0 with v_s'A_s < 0 and v_t'e^{A_s T} < v_s', by HiGHS."""
    A, B = (np.array(M, dtype=float) for M in FAINSHIL)
    none = np.zeros((3, 3))
    rows = [[A.T, none], [none, B.T], [-np.eye(3), la.expm(A * T).T], [la.expm(B * T).T, -np.eye(3)]]
    return linprog(np.ones(6), np.block(rows), -np.full(12, 1e-9), bounds=(1e-6, 1)).status == 0


def bisected():
    low, high = 0.5, 4.0
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (low, middle) if has_vectors(middle) else (middle, high)
    return high


@pytest.mark.parametrize("who", ["ours", "bisection with HiGHS, no proof"])
def test_dwell_time(contest, benchmark, who):
    question = "dwell time of a pair, n = 3"
    if who != "ours":
        assert abs(contest(question, who, bisected) - 1.4384035) < 1e-3
        return
    low, high = contest(question, who, lambda: kp.switched(FAINSHIL)).dwell_bounds
    benchmark.extra_info.update(lower=low, upper=high)
    assert low < 1.4384035 < high and high - low < 1e-3


def longest_products(length=10):
    stack = [np.eye(2)]
    for _ in range(length):
        stack = [np.array(A) @ P for P in stack for A in SHEARS]
    return max(np.abs(np.linalg.eigvals(P)).max() ** (1 / length) for P in stack)


@pytest.mark.parametrize("who", ["ours", "1024 products, from below only"])
def test_growth(contest, benchmark, who):
    question = "growth of two shears"
    if who != "ours":
        assert abs(contest(question, who, longest_products) - 1.618034) < 1e-6
        return
    low, high = contest(question, who, lambda: kp.switched(SHEARS, discrete=True)).growth_bounds
    benchmark.extra_info.update(lower=low, upper=high)
    assert low < 1.6180340 and high > 1.6180339 and high - low < 1e-6


def chain_of(n, count, seed=0):
    """Sparse members with three entries a row beside the diagonal, and a full chain."""
    rng = np.random.default_rng(seed)
    family = [
        sp.random_array((n, n), density=3 / n, rng=rng) - sp.diags_array(rng.uniform(2, 4, n)) for _ in range(count)
    ]
    chain = rng.random((count, count))
    return family, chain - np.diag(chain.sum(axis=1))


def means(family, chain):
    n = family[0].shape[0]
    return sp.csr_array(sp.block_diag(family) + sp.kron(chain.T, sp.eye_array(n)))


@pytest.mark.timeout(600)
@pytest.mark.parametrize("who", ["ours", "numpy.linalg.eigvals", "ARPACK"])
@pytest.mark.parametrize(("full", "count"), [(200, 4), (5000, 10)])
def test_chain(contest, benchmark, size, who, full, count):
    n = size(full, full // 50)
    family, chain = chain_of(n, count)
    question = f"mean stability, {count} members, n = {n}"
    if who == "ours":
        s = contest(question, who, lambda: kp.switched(family, chain=chain))
        benchmark.extra_info["decay rate"] = s.decay_rate
        assert s
        return
    L = means(family, chain)
    if who == "ARPACK":
        found = contest(question, who, lambda: eigs(L, 1, which="LR", return_eigenvectors=False))
    elif L.shape[0] > 2000:
        pytest.skip("minutes")  # eigenvalues of 50 000 states in dense matrices
    else:
        found = contest(question, who, lambda: np.linalg.eigvals(L.toarray()))
    assert found.real.max() < 0
