"""L2 gains of networks by sparse solves, and gains that are zero, against singular values and eigenvalues."""

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sp
from gain_systems import CHAIN, EYE, PAIR, TILTED, random_system, ring

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import DataError, KposError, UndecidedError
from control_kpos.theorems.positivity import positivity_of
from control_kpos.theorems.stability import lyapunov_on

SEED = kp.PolyhedralCone([[0, 1], [1, -2]])


def gain_of(net):
    """The DC gain, dense."""
    A, B, C, D = (M.toarray() for M in (net.sparse_A, net.sparse_B, net.sparse_C, net.sparse_D))
    return D - C @ np.linalg.solve(A - np.eye(len(A)) * bool(net.dt), B)


def size_of(G, structure):
    return np.linalg.norm(G, 2) if structure == "full" else np.abs(np.linalg.eigvals(G)).max()


def directed_ring(n, seed):
    rng = np.random.default_rng(seed)
    A = np.zeros((n, 2, 2))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = -2 - rng.random(n), 1, 0.3, -2 - rng.random(n)
    W = sp.csr_array((np.full(n, 0.8), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))
    return A, W


def in_cones(seed, **ports):
    rng = np.random.default_rng(seed)
    A = np.array([[[0, 1], [-20 - rng.random(), -13]] for _ in range(200)])
    graph = nx.to_scipy_sparse_array(nx.random_regular_graph(4, 200, seed=seed))
    return kp.feedback_interconnect(kp.stack(A, [[0], [1]], [[1, 0]], X=SEED), sp.csr_array(graph) * 1.0, **ports)


def in_steps(seed, feedthrough):
    rng = np.random.default_rng(seed)
    D = [[0.2]] if feedthrough else None
    nodes = kp.stack(rng.random((151, 2, 2)) * 0.3, [[0.1], [0.3]], [[1, 0.2]], D, dt=1)
    W = sp.csr_array((np.full(151, 0.5), (np.arange(151), (np.arange(151) + 1) % 151)), shape=(151, 151))
    return kp.feedback_interconnect(nodes, W)


NETWORKS = {
    "localised": lambda: kp.feedback_interconnect(
        kp.stack(directed_ring(200, 0)[0], [[0], [1]], [[1, 0]]), directed_ring(200, 0)[1]
    ),
    "even": lambda: ring(301),
    "other cones": lambda: in_cones(1),
    "some ports": lambda: in_cones(2, inputs=[0, 5, 7], outputs=[3, 9, 11]),
    "in steps": lambda: in_steps(3, False),
    "feedthrough": lambda: in_steps(4, True),
}


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("structure", ["full", "diagonal"])
def test_bounds_of_networks(name, structure):
    net = NETWORKS[name]()
    cert, value = kp.structured_gain(net, structure), size_of(gain_of(net), structure)
    assert cert and cert.check() and cert.positivity.A.is_sparse
    assert cert.lower * (1 - 1e-10) <= value <= cert.upper * (1 + 1e-10)
    assert cert.upper - cert.lower <= (1e-2 if name == "some ports" else 1e-7) * cert.upper  # these are far apart
    assert kp.robust_margin(net, structure).lower == pytest.approx(1 / value, rel=1e-4)


def test_loops_may_be_paired_in_any_way():
    net = in_cones(3)
    order = np.random.default_rng(0).permutation(200)
    pairs = [([i], [int(j)]) for i, j in enumerate(order)]
    cert, value = kp.structured_gain(net, pairs), np.abs(np.linalg.eigvals(gain_of(net)[order])).max()
    assert cert and cert.check() and cert.lower * (1 - 1e-9) <= value <= cert.upper * (1 + 1e-9)
    assert cert.upper - cert.lower <= 1e-6 * cert.upper


def test_other_blocks_take_dense_matrices():
    cert = kp.structured_gain(ring(301), [1] + [300])
    assert cert and cert.check() and cert.d.shape == (2,)


@pytest.mark.parametrize("changed", ["w", "u", "z", "r", "x", "p", "a", "c", "y", "s"])
def test_changed_vectors_of_networks_prove_nothing(changed):
    cert = kp.structured_gain(ring(301))
    values = getattr(cert, changed) * (0.9 if changed in "uzpwcs" else 1.1)
    assert not type(cert).settle(**cert.data() | {changed: values})


def test_large_networks():
    A, W = directed_ring(6000, 5)
    net = kp.feedback_interconnect(kp.stack(A, [[0], [1]], [[1, 0]]), W)
    cert = kp.structured_gain(net)
    assert cert and cert.upper - cert.lower <= 1e-8 * cert.upper and net.gain("L2") == cert.upper
    found = kp.robust_margin(net)
    assert found and found.upper - found.lower <= 1e-8 * found.upper and found.delta is None
    with pytest.raises(kp.TooLargeError, match="gain of this network"):
        net.gain("L1")


def test_files_of_large_networks(tmp_path):
    for structure, name in (("full", "file.json"), ("diagonal", "file.npz")):
        cert = kp.structured_gain(ring(1000), structure)
        cert.save(tmp_path / name)
        assert kp.load_certificate(tmp_path / name) == cert
    assert checker.main(tmp_path / "file.json") == 0


def test_networks_without_a_gain():
    unstable = kp.feedback_interconnect(
        kp.stack(np.full((6000, 1, 1), -1.0), [[1]], [[1]]), sp.csr_array(1.5 * sp.eye_array(6000))
    )
    cert = kp.structured_gain(unstable)
    assert cert.status == "REFUTED" and cert.check() and unstable.gain("L2") == np.inf
    assert kp.robust_margin(unstable).upper == 0
    nodes = kp.stack(np.full((6000, 1, 1), -1.0), [[-1]], [[1]], U=[[-1]])
    with pytest.raises(kp.ConeMismatchError, match="U is no nonnegative orthant"):
        kp.structured_gain(kp.feedback_interconnect(nodes, sp.csr_array((6000, 6000))))
    negative = kp.stack(np.full((6000, 1, 1), -1.0), [[-1]], [[1]])
    net = kp.feedback_interconnect(negative, sp.csr_array((6000, 6000)))
    assert kp.structured_gain(net).status == "REFUTED"
    with pytest.raises(KposError, match="positive systems only"):
        net.gain("L2")
    several = kp.stack([np.full((400, 1, 1), -1.0), np.full((400, 1, 1), -2.0)], [[1]], [[1]])
    with pytest.raises(DataError, match="vertices"):
        kp.structured_gain(kp.feedback_interconnect(several, sp.csr_array((400, 400))))


def test_nothing_is_said_where_nothing_is_proven(monkeypatch):
    net = ring(6000)
    monkeypatch.setattr("control_kpos.networks.gains._from_above", lambda *_: iter(()))
    assert kp.structured_gain(net).status == "UNDECIDED"
    with pytest.raises(UndecidedError, match="the gain is not known"):
        net.gain("L2")


# -- gains that are zero


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("discrete", [False, True])
def test_zero_is_proven_if_and_only_if_no_signal_comes_back(seed, discrete):
    """G^k = 0 for nonnegative G if and only if its graph has no cycle; of one block G = 0."""
    rng = np.random.default_rng([seed, discrete])
    data, G = random_system(rng, discrete, zeros=0.75)
    system, m = kp.ConeStateSpace(*data, discrete), len(G)
    sure = (G > 1e-14).astype(int)
    for structure, zero in (("full", not sure.any()), ("diagonal", not np.linalg.matrix_power(sure, m).any())):
        cert = kp.structured_gain(system, structure)
        assert cert and cert.check() and (cert.upper == 0) == zero
        margin = kp.robust_margin(system, structure)
        assert (margin.lower == np.inf) == zero and margin.check()


def test_zero_in_other_coordinates():
    cert = kp.structured_gain(TILTED)
    assert cert and cert.check() and cert.upper == 0 and kp.robust_margin(TILTED, "full").lower == np.inf


def test_zero_of_blocks():
    """u1 -> y2 -> u2 -> y3, in blocks {1}, {2, 3} and {1, 2}, {3}."""
    A = [[-1, 0, 0], [1, -1, 0], [0, 1, -1]]
    s = kp.ConeStateSpace(A, np.eye(3), [[0, 0, 0], [1, 0, 0], [0, 1, 0]], 0)
    assert kp.structured_gain(s, "diagonal").upper == 0
    assert kp.structured_gain(s, [1, 2]).upper > 0.9 and kp.structured_gain(s, [2, 1]).upper > 0.9


def test_zero_of_large_networks():
    n = 3000
    W = sp.csr_array((np.ones(n - 1), (np.arange(1, n), np.arange(n - 1))), shape=(n, n))
    nodes = kp.stack(np.full((n, 2, 2), [[-2.0, 0], [1, -2]]), [[1], [0]], [[0, 1]])
    found = kp.robust_margin(kp.feedback_interconnect(nodes, W, inputs=[1500], outputs=[1499]), "full")
    assert found and found.check() and found.lower == np.inf
    cert = kp.structured_gain(kp.feedback_interconnect(nodes, W, inputs=list(range(1, n)), outputs=list(range(n - 1))))
    assert cert.upper > 0  # one block: outputs before inputs of the same block are reached


@pytest.mark.parametrize(
    "change",
    [
        {"levels": np.zeros(2), "block_levels": np.zeros(2)},
        {"levels": None},
        {"block_levels": np.ones(3)},
        {"levels": np.full(2, np.nan)},
        {"p": None},
        {"w": np.ones(2)},
        {"lower": 0.5},
        {"p": -np.ones(2)},
    ],
)
def test_changed_levels_prove_nothing(change):
    cert = kp.structured_gain(CHAIN, "diagonal")
    assert cert.upper == 0 and cert.check() and not replace(cert, **change).check()
    with_gain = kp.structured_gain(PAIR)
    assert not replace(with_gain, levels=np.zeros(2), block_levels=np.zeros(1)).check()


def test_cones_that_are_not_simplicial_have_small_bounds():
    square = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
    s = kp.ConeStateSpace(-np.eye(3), [[0], [0], [1]], [[0, 0, 0]], 0, X=square)
    cert = kp.structured_gain(s)
    assert cert and 0 < cert.upper < 1e-5 and cert.lower == 0


# -- systems without states


def test_theorems_about_systems_without_states():
    """A static gain gets an idle state wherever a system is read."""
    sys = kp.ConeStateSpace([], [], [], EYE)
    p = positivity_of(sys.exact)
    assert p and p.A.shape == (1, 1) and lyapunov_on(p) and lyapunov_on(p, rate="max")
    assert sys.gain("L2") == 1 and kp.structured_gain(sys).upper == pytest.approx(1)


@pytest.mark.parametrize("structure", ["full", "diagonal"])
@pytest.mark.parametrize("changed", ["none", "inputs", "outputs", "links"])
def test_parts_that_do_not_meet_leave_gains_close(changed, structure):
    """The first guess of the vector is the Perron vector itself, or far from it in parts that it does not reach."""
    B, C, W = np.ones((160, 2, 1)), np.ones((160, 1, 2)), sp.csr_array((160, 160))
    if changed == "inputs":
        B[3] = 0
    if changed == "outputs":
        C[5] = 0
    if changed == "links":  # sparse chains of nodes that differ
        rng = np.random.default_rng(3)
        B, C = rng.random((160, 2, 1)) * (rng.random((160, 2, 1)) < 0.6), rng.random((160, 1, 2))
        W = sp.csr_array(sp.triu(sp.random_array((160, 160), density=0.01, rng=rng) * 0.3, 1))
    net = kp.feedback_interconnect(kp.stack([[[-3, 1], [0, -3]]] * 160, B=B, C=C), W)
    found, size = kp.structured_gain(net, structure), size_of(gain_of(net), structure)
    assert found and found.check() and size * (1 - 1e-2) < found.lower <= size * (1 + 1e-9)
    assert size * (1 - 1e-9) <= found.upper < size * (1 + 1e-2)
