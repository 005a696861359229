"""Certificates for networks of any size: what `covers` says of a coupling is true of its eigenvalues."""

from fractions import Fraction

import numpy as np
import pytest

import control_kpos as kp


def node(a=-1.0, b=1.0, c=1.0, d=0.0, **cones):
    return kp.ConeStateSpace([[a]], [[b]], [[c]], [[d]], **cones)


def closed(s, W):
    """Closed-loop matrix of copies of a system under a coupling, and the spectral radius of the algebraic loop."""
    n = len(W) // s.ninputs
    A, B, C, D = (np.kron(np.eye(n), M) for M in (s.A, s.B, s.C, s.D))
    radius = np.abs(np.linalg.eigvals(W @ D)).max()
    return (A + B @ np.linalg.solve(np.eye(len(W)) - W @ D, W @ C) if radius < 1 else None), radius


def is_stable(s, W):
    A, radius = closed(s, W)
    return radius < 1 and np.linalg.eigvals(A).real.max() < 0


@pytest.mark.parametrize("seed", range(40))
def test_covered_graphs_are_stable(seed):
    """Links of any size and sign, with and without feedthrough, on random graphs near the bound."""
    rng = np.random.default_rng(seed)
    sign = rng.choice([-1, 1])
    s = node(-1, 1, sign, sign * rng.choice([0, 0.25, 0.5]), Y=[[sign]])
    link = float(sign * rng.choice([0.5, 1, 2]))
    weight = float(rng.choice([0.25, 0.5, 0.9, 1.9]))
    certificate = kp.scale_free_certificate(s, weight, link=[[link]])
    for _ in range(10):
        n = int(rng.integers(2, 6))
        W = rng.random((n, n)) * (rng.random((n, n)) < 0.6)
        W *= rng.choice([0.9, 0.999, 1.1, 2]) / max(W.sum(axis=rng.integers(2)).max(), 1e-9)
        W *= rng.choice([weight, weight * abs(link), 1]) * rng.choice([sign, sign, -sign])
        if certificate.covers(W):
            assert is_stable(s, W) and certificate.interconnect(W).linear_lyapunov()


@pytest.mark.parametrize("seed", range(20))
def test_covered_graphs_of_larger_nodes_are_stable(seed):
    rng = np.random.default_rng(seed)
    s = kp.ConeStateSpace([[-1]], rng.random((1, 2)), rng.random((2, 1)), 0.3 * rng.random((2, 2)) * (seed % 2))
    link = np.eye(2) if seed % 3 else rng.random((2, 2))
    certificate = kp.scale_free_certificate(s, 0.3, link=link)
    for _ in range(10):
        graph = np.abs(rng.standard_normal((3, 3)))
        W = np.kron(graph * rng.choice([0.05, 0.1, 0.3]), rng.choice([0, 1], (2, 2)) if seed % 4 else link)
        if certificate.covers(W):
            assert is_stable(s, W)
    assert certificate.covers(np.kron(0.3 * (np.eye(3) - np.diag([0, 0, 1])), link)) == bool(certificate)


def test_links_that_feed_a_part_without_storage_may_not_loop():
    s = kp.ConeStateSpace([[-1]], [[1, 0]], [[1], [0]], [[0, 0], [0, 0.5]])
    certificate = kp.scale_free_certificate(s, weight=0.5, link=np.eye(2))
    assert [certificate.covers(np.diag([0.0, w])) for w in (2.0, 10.0)] == [False, False]
    assert certificate.check() or not certificate


def test_a_weight_of_nothing_covers_no_links():
    certificate = kp.scale_free_certificate(node(1 - 2, 1, -1, Y=[[-1]]), weight=0, link=[[1]])
    assert not certificate.covers([[0, -1.0], [-1.0, 0]])


@pytest.mark.parametrize(("link", "words"), [(1, "nonnegative weights whose sum"), (-1, "nonpositive weights the sum")])
def test_the_text_tells_the_graphs(link, words):
    certificate = kp.scale_free_certificate(node(-2, 1, link, Y=[[link]]), weight=0.5, link=[[2 * link]])
    assert words in certificate.explain() and "at most 1," in certificate.explain()
    assert certificate.covers([[0, link], [link, 0]]) and not certificate.covers([[0, 1.001 * link], [link, 0]])
    assert certificate.covers([[0, str(Fraction(999, 1000) * link)], [str(link), 0]])
