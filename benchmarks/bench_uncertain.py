"""Networks with vertices at every node: beside the certificate of one network of that size, and linear programs.

Nodes of two states on orthants with four random vertices each, three links into every node.
"""

import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp


def matrices(n, vertices):
    rng = np.random.default_rng(1)
    A = rng.uniform(0, 1, (vertices, n, 2, 2)) - 3 * np.eye(2)
    B, C = rng.uniform(0, 1, (vertices, n, 2, 1)), rng.uniform(0, 1, (vertices, n, 1, 2))
    places = np.repeat(np.arange(n), 3), rng.integers(0, n, 3 * n)
    return A, B, C, sp.csr_array((rng.uniform(0, 0.5, 3 * n), places), shape=(n, n))


def certify(*data, W):
    certificate = kp.feedback_interconnect(kp.stack(*data), W, progress=False).certificate
    assert certificate.status is kp.Status.PROVED
    return certificate


@pytest.mark.parametrize("who", ["ours", "one network", "check of the certificate"])
def test_four_vertices_against_one_network(contest, size, who):
    n = size(10**6, 10**3)
    *data, W = matrices(n, 4)
    question = f"4 vertices a node, N = {n}"
    if who == "ours":
        contest(question, who, lambda: certify(*data, W=W), rounds=2)
    elif who == "one network":
        first = [part[0] for part in data]
        contest(question, who, lambda: certify(*first, W=W), at_most=8, rounds=2)
    else:
        certificate = certify(*data, W=W)
        contest(question, who, certificate.check, rounds=2)


def program_for_all(A, B, C, W):
    """v, r: v >= 1, r >= 0, v'A^s + r'W C^s <= -1 and v'B^s <= r at all vertices."""
    n = A.shape[1]
    rows = []
    for a, b, c in zip(A, B, C, strict=True):
        a, b, c = (sp.block_diag(list(part), format="csr") for part in (a, b, c))
        rows.append(sp.block_array([[a.T, (W @ c).T], [b.T, -sp.eye_array(n)]]))
    matrix = sp.csr_array(sp.vstack([*rows, -sp.eye_array(3 * n)]))
    each = np.concatenate([-np.ones(2 * n), np.zeros(n)])
    return matrix, np.concatenate([np.tile(each, len(A)), -np.ones(2 * n), np.zeros(n)])


@pytest.mark.timeout(600)
@pytest.mark.parametrize("who", ["ours", "HiGHS"])
def test_against_the_linear_program(contest, slow_contest, size, who):
    n = size(10**4, 200)
    *data, W = matrices(n, 4)
    question = f"program for 4 vertices, N = {n}"
    if who == "ours":
        contest(question, who, lambda: certify(*data, W=W), rounds=3)
        return
    matrix, bound = program_for_all(*data, W)
    outcome = slow_contest(question, who, "highs", {"matrix": matrix, "bound": bound}, at_most=1 / 50)
    assert outcome.remark or outcome.judgement < 1e-3


@pytest.mark.parametrize("who", ["ours", "proof at the given size"])
def test_largest_uncertainty(contest, size, who):
    n = size(10**5, 200)
    A, B, C, W = matrices(n, 1)
    nodes = kp.stack(A[0], B[0], C[0])
    net = kp.feedback_interconnect(nodes, kp.interval(0.9 * W, 1.1 * W), progress=False)
    question = f"largest uncertainty of links, N = {n}"
    if who == "ours":
        lower, upper = contest(question, who, lambda: kp.largest_uncertainty(net), rounds=1)
        assert lower < upper <= lower * (1 + 1e-6)
    else:
        contest(question, who, lambda: net.with_links(kp.interval(0.9 * W, 1.1 * W)).certificate, rounds=1)
