"""The bracket of large networks, whose eigenvectors live on few nodes (`leading_nodes`), at a small size."""

import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.networks.spectrum import leading_nodes as localised
from control_kpos.networks.spectrum.descent import descend


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(localised, "LEAST_NODES", 100)


def network(n, coupling, seed):
    A, B, C, D = kp.examples.mass_spring_nodes(n, seed=seed)
    return kp.feedback_interconnect(kp.stack(A, B, C, D, X=kp.examples.paper_cone()), coupling)


def truth(net):
    return np.linalg.eigvals(net.sparse_A.toarray()).real.max()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("graph", [kp.examples.ring, lambda n: kp.examples.random_regular(n, 3, seed=2)])
def test_bracket_holds_the_abscissa(graph, seed):
    net = network(400, graph(400), seed)
    lower, upper = net.spectral_abscissa()
    exact = truth(net)
    assert 0 <= upper - lower <= 1e-6 * abs(exact)
    assert lower - 1e-9 <= exact <= upper + 1e-9
    assert net.abscissa_certificate().check()


def test_the_peak_is_found_and_belongs_to_both_sides():
    net = network(2000, kp.examples.ring(2000), 1)
    peak = localised.localised_peak(net.model, 0.0, 1e-6)
    assert peak is not None
    A = net.sparse_A
    rays, facets = kp.examples.paper_cone().rays, kp.examples.paper_cone().facets
    ahead = (A @ peak.x - peak.rate * peak.x).reshape(-1, 2)
    assert np.all(ahead @ facets.T >= -1e-12 * np.abs(peak.x).max())
    falling = (A.T @ peak.v - (1 - 1e-6) * peak.rate * peak.v).reshape(-1, 2)
    assert np.all(falling @ rays.T < 0)
    assert np.count_nonzero(peak.x) < 400


def test_a_place_that_is_quiet_at_first():
    """Few strongly coupled nodes with small entries in the early iterates have the largest eigenvalue."""
    n = 1000
    A = np.full((n, 1, 1), -2.0) - 0.5 * np.random.default_rng(0).random((n, 1, 1))
    A[:100] = -1.6  # large early entries
    W = sp.lil_array((n, n))
    W[np.arange(1, 200), np.arange(199)] = 0.9  # a chain: large entries but eigenvalue -1.6
    W[700, 701] = W[701, 700] = 1.9  # a small loop: eigenvalue about -0.3
    net = kp.feedback_interconnect(kp.stack(A, np.ones((n, 1, 1)), np.ones((n, 1, 1))), sp.csr_array(W))
    lower, upper = net.spectral_abscissa()
    assert lower - 1e-9 <= truth(net) <= upper + 1e-9
    assert upper - lower <= 1e-6 * abs(upper)


def test_equal_nodes_have_no_peak():
    A, B, C, _ = kp.examples.mass_spring()
    F = np.array(kp.examples.paper_gain())
    node = np.array([np.asarray(A) + np.asarray(B) @ F] * 300)
    stack = kp.stack(node, np.array([B] * 300), np.array([C] * 300), X=kp.examples.paper_cone())
    net = kp.feedback_interconnect(stack, kp.examples.ring(300))
    assert localised.localised_peak(net.model, 0.0, 1e-6) is None
    lower, upper = net.spectral_abscissa()
    assert lower <= truth(net) + 1e-9 and truth(net) - 1e-9 <= upper


def test_a_neighbourhood_grows_by_whole_steps_up_to_its_size():
    links = sp.csr_array(kp.examples.ring(50) + kp.examples.ring(50).T)
    mask = localised.neighbourhood(links, np.array([10]), 6)
    assert np.flatnonzero(mask).tolist() == [8, 9, 10, 11, 12]
    assert localised.neighbourhood(links, np.array([10]), 50).all()
    apart = sp.csr_array(np.kron(np.eye(2), np.ones((3, 3))))
    assert localised.neighbourhood(apart, np.array([0]), 6).tolist() == [True] * 3 + [False] * 3


def test_agrees_with_the_descent_alone():
    net = network(900, kp.examples.ring(900), 7)
    peak = localised.localised_peak(net.model, 0.0, 1e-6)
    alone = descend(net.model, 0.0)
    assert peak is not None and alone is not None
    assert abs(peak.rate - alone.theta) <= 1.5e-6 * abs(alone.theta)


def test_width_of_a_grid():
    """Its eigenvector falls off slowly, so that cutting it costs more than on a ring."""
    line = sp.diags_array([np.ones(59), np.ones(59)], offsets=[-1, 1])
    grid = sp.kron(line, sp.eye_array(60)) + sp.kron(sp.eye_array(60), line)
    net = network(3600, 0.5 * sp.csr_array(grid), 2)
    lower, upper = net.spectral_abscissa()
    assert 0 <= upper - lower <= 1e-6 * abs(upper)
