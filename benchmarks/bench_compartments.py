"""Compartments from which little leaves: elimination without subtraction, beside solves with the rounded diagonal.

What flows in leaves through the only outflow, so that the content there is known: one over its rate.
"""

import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import control_kpos as kp

LEAK = 1e-14


def filled(n):
    rng = np.random.default_rng(1)
    F = 10.0 ** rng.uniform(-12, 12, (n, n))
    np.fill_diagonal(F, 0)
    return F


def tree(n):
    rng = np.random.default_rng(2)
    pairs = np.array(list(nx.random_labeled_rooted_tree(n, seed=1).edges)).T
    both = np.hstack([pairs, pairs[::-1]])
    return sp.csr_array((10.0 ** rng.uniform(-6, 6, both.shape[1]), tuple(both)), shape=(n, n))


def matrix(F):
    """-A, its diagonal in doubles."""
    out = np.asarray(F.sum(axis=0)).ravel()
    out[0] += LEAK
    return sp.csc_array(sp.diags_array(out) - F) if sp.issparse(F) else np.diag(out) - F


PEERS = {"numpy.linalg.solve": np.linalg.solve, "SuperLU": spsolve}


@pytest.mark.parametrize(
    ("make", "sizes", "who"),
    [
        (filled, (600, 60), "ours"),
        (filled, (600, 60), "numpy.linalg.solve"),
        (tree, (100_000, 2000), "ours"),
        (tree, (100_000, 2000), "SuperLU"),
    ],
)
def test_gain(contest, benchmark, size, make, sizes, who):
    n = size(*sizes)
    F = make(n)
    question = f"gain, {make.__name__}, {n} compartments"
    into = np.zeros((n, 1))
    into[-1] = 1
    leak = np.where(np.arange(n) == 0, LEAK, 0.0)
    if who == "ours":
        out = np.zeros((1, n))
        out[0, 0] = 1
        found = contest(question, who, lambda: _solved(kp.compartmental(F, leak, into, out)))
        content = found.gain[0, 0]
        benchmark.extra_info["proven"] = found.relative_error
    else:
        M = matrix(F)
        content = np.ravel(contest(question, who, lambda: PEERS[who](M, into[:, 0])))[0]
    error = benchmark.extra_info["relative error"] = abs(LEAK * content - 1)
    print(f"{question}, {who}: relative error {error:.1e}")
    if who == "ours":
        assert error <= found.relative_error


def _solved(found):
    assert found and found.gain.shape == (1, 1)
    return found
