"""Near the margin: grids are solved and their rates sharpened; cones with any facets are decided by refinement."""

import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.exact.sparse_integers import SparseIntegers
from control_kpos.networks.spectrum.evening import evener
from control_kpos.networks.spectrum.port_solves import PortSystem, is_flat
from control_kpos.theorems.bordered import decide_bordered
from control_kpos.theorems.perron_pair import _by_solution


def grid(k, gap, uneven=False):
    """k x k nodes of two states with their abscissa at -gap, or rows with random weights of sum 1 - gap."""
    path = sp.diags_array([np.ones(k - 1), np.ones(k - 1)], offsets=[1, -1])
    W = sp.csr_array(sp.kron(path, sp.eye_array(k)) + sp.kron(sp.eye_array(k), path))
    A, s = np.array([[-2.0, 1], [1, -3]]), 0.0 if uneven else -gap
    gain = 1 / ((s + 2) * (s + 3) - 1)
    if uneven:
        W.data = np.random.default_rng(0).random(W.nnz) ** 3 + 0.01
        W = sp.csr_array(sp.diags_array((1 - gap) / gain / W.sum(axis=1)) @ W)
    else:
        W = W / (4 * np.cos(np.pi / (k + 1)) * gain)
    return kp.feedback_interconnect(kp.stack(np.broadcast_to(A, (k * k, 2, 2)), B=[[1], [0]], C=[[0, 1]]), W)


@pytest.mark.parametrize("k", [20, 150])
@pytest.mark.parametrize("gap", [1e-2, 1e-3])
def test_the_rate_of_a_grid_is_close_to_the_best(k, gap):
    found = grid(k, gap).certificate
    assert found and found.check() and 0.9 * gap < found.decay_rate <= gap


def test_uneven_grids_are_factored_where_bicgstab_fails():
    net = grid(200, 1e-3, uneven=True)
    found = net.certificate
    assert is_flat(net.model) and net.model.__dict__.get("_krylov_fails")
    assert found and found.check() and found.decay_rate > 1e-4


def test_expanders_are_not_flat():
    net = kp.feedback_interconnect(
        [kp.ConeStateSpace([[-5]], [[1]], [[1]], 0)] * 3000, kp.examples.random_regular(3000)
    )
    assert not is_flat(net.model)


def test_fast_solves_and_good_rates_are_left_alone():
    net = grid(10, 3.0)
    system, v = PortSystem(net.model, 0.0), np.ones(200)
    assert not list(evener(system, v, 0.1))
    system.loop.iterations = 1
    assert list(evener(system, v, 1e-9)) and not list(evener(system, v, 1e9))


def pyramid(seed, shift):
    """A matrix that is cross-positive on a cone of four rays in space: sums of x_i h_j', and where its root is."""
    rng = np.random.default_rng(seed)
    rays = np.array([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]], dtype=object)
    facets = np.array([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]], dtype=object)
    N = rays.T @ rng.integers(1, 9, (4, 4)).astype(object) @ facets
    root = np.linalg.eigvals(N.astype(float)).real.max()
    scale = 10**6
    return N * scale - round(root * scale) * np.eye(3, dtype=int) - shift * np.eye(3, dtype=int), facets, rays


@pytest.mark.parametrize("shift", [10**6, 10, 2, -2, -10, -(10**6)])
@pytest.mark.parametrize("seed", range(8))
def test_refinement_decides_as_exact_solutions_do(seed, shift):
    M, facets, rays = pyramid(seed, shift)
    N = SparseIntegers.dense(M)
    stable, z = decide_bordered(N, facets, rays)
    assert stable is (shift > 0) is _by_solution(N, facets, rays).stable
    if stable:
        assert (rays @ z > 0).all() and (rays @ (z @ M) < 0).all()
    else:
        assert z.any() and (facets @ z >= 0).all() and (facets @ (M @ z) >= 0).all()


def test_a_root_of_zero_is_found_among_small_integers():
    rays = np.array([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]], dtype=object)
    facets = np.array([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]], dtype=object)
    M = np.outer([3, 1, 7], [0, 0, 1]).astype(object) - 7 * np.eye(3, dtype=int)  # M (3, 1, 7) = 0
    stable, x = decide_bordered(SparseIntegers.dense(M), facets, rays)
    assert not stable and not (M @ x).any() and x.any()


def test_singular_and_large_equations_are_left_to_others():
    zero, eye = np.zeros((3, 3), dtype=object), np.eye(3, dtype=int).astype(object)
    found = decide_bordered(SparseIntegers.dense(zero), eye, eye)
    assert found is None or not found[0]
    tall = SparseIntegers.diagonal(-np.ones(1501, dtype=object))
    assert decide_bordered(tall, np.zeros((0, 1501), dtype=object), np.zeros((0, 1501), dtype=object)) is None


@pytest.mark.parametrize("gap", [0, 1e-12, 1e-6, -1e-3])
def test_networks_on_pyramids_are_bracketed(gap):
    n, rng = 40, np.random.default_rng(3)
    node = kp.ConeStateSpace(
        np.diag([-3.0, -3.0, -2.0]), [[0], [0], [1]], [[0, 0, 1]], 0, X=[[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]
    )
    W = rng.random((n, n)) * (rng.random((n, n)) < 0.1) + 0.1 * np.roll(np.eye(n), 1, axis=1)
    W *= (2 - gap) / np.linalg.eigvals(W).real.max()
    found = kp.feedback_interconnect([node] * n, W).abscissa_certificate()
    assert found and found.check() and abs(found.lower + gap) < 1e-13 + 1e-5 * abs(gap)
