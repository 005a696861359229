"""Local observers of networks: enclosures, widths against dense matrices, faults, sizes."""

import json
from dataclasses import replace

import control as ct
import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
import tampering
from certified_observers import local

import control_kpos as kp
from control_kpos import checker
from control_kpos.exact.matrix import Matrix
from control_kpos.networks.own_links import own_links_closed


def random_network(rng, discrete, outputs=None):
    """Four nodes on two cones, with links of all kinds, some measured."""
    cones, nodes = [random_networks.random_cone(rng, 2) for _ in range(2)], []
    for j in range(4):
        X, ports = cones[j % 2], 1 + j % 2
        U = kp.orthant(ports)
        inner = random_networks.positive_map(rng, X, X)
        inner /= np.abs(np.linalg.eigvals(inner)).max()
        A = inner * rng.uniform(0.2, 0.9) if discrete else inner - rng.uniform(1.1, 1.9) * np.eye(2)
        B, C = random_networks.positive_map(rng, U, X), random_networks.positive_map(rng, X, U)
        size = np.linalg.norm(B) * np.linalg.norm(C)
        nodes.append(kp.ConeStateSpace(A, B / size, C, np.zeros((ports, ports)), discrete, X=X, U=U, Y=U))
    return kp.feedback_interconnect(nodes, 0.05 * rng.random((6, 6)), outputs=outputs)


@pytest.fixture(scope="module")
def pair():
    return local()


@pytest.mark.parametrize("seed", range(6))
def test_nothing_escapes_and_widths_are_those_of_dense_matrices(seed):
    rng = np.random.default_rng(seed)
    net = random_network(rng, discrete=True, outputs=[0, 2, 3] if seed % 2 else None)
    n, q = net.nstates, net.noutputs
    low, high, noise = -rng.random(n), rng.random(n), 0.1 * rng.random(q)
    o = kp.interval_observer(net, disturbance=(low, high), noise=noise)
    assert o and o.check() and len(o.L) == 4
    x = rng.normal(size=n)
    first, T, u = (x - rng.random(n), x + rng.random(n)), np.arange(80), rng.normal(size=(net.ninputs, 80))
    states, measured = [], []
    for k in T:
        states.append(x)
        measured.append(net.C @ x + noise * rng.choice([-1, 1], q))
        x = net.A @ x + net.B @ u[:, k] + np.where(rng.random(n) < 0.5, low, high)
    lower, upper = o.simulate(T, np.array(measured).T, u, x0=first)
    x = np.array(states).T
    assert (lower <= x + 1e-9).all() and (x <= upper + 1e-9).all()
    proof = o.certificate
    F = net.A + proof.gain.values.toarray() @ net.model.block_matrices[2].toarray()
    last = np.linalg.solve(np.eye(n) - F, proof.upper - proof.lower)
    assert o.width == pytest.approx((2 * proof.covers.values.toarray() - np.eye(n)) @ last, rel=1e-6)


def test_continuous_time():
    rng = np.random.default_rng(0)
    net = random_network(rng, discrete=False)
    n, T = net.nstates, np.linspace(0, 4, 1601)
    o = kp.interval_observer(net, disturbance=(-np.ones(n), np.ones(n)), noise=0.1)
    u, w = np.sin(np.outer(np.arange(net.ninputs) + 1, T)), np.sign(np.cos(3 * T)) * np.ones((n, 1))
    plant = ct.ss(net.A, np.hstack([net.B, np.eye(n)]), net.C, 0)
    run = ct.forced_response(plant, T, np.vstack([u, w]), np.ones(n))
    lower, upper = o.simulate(T, run.outputs + 0.09, u, x0=(np.zeros(n), np.full(n, 2)))
    assert (lower <= run.states).all() and (run.states <= upper).all()


def test_gains_make_bounds_narrower_and_only_measured_outputs_count():
    nodes = kp.stack([[[-2, 1], [1, -2]]] * 5, [[0], [1]], [[1, 0]])
    ring = np.roll(np.eye(5), 1, axis=0)
    box = ([-1] * 10, [1] * 10)
    nets = [kp.feedback_interconnect(nodes, ring, outputs=which) for which in ([0], [0, 1, 2], None)]
    seen = [kp.interval_observer(net, disturbance=box, noise=0.01) for net in nets]
    assert all(seen) and sorted((o.width.sum() for o in seen), reverse=True) == [o.width.sum() for o in seen]
    assert not seen[0].L[1:].any() and seen[0].L[0].any()
    free = kp.order_interval(kp.feedback_interconnect(nodes, ring), [2] * 10)
    assert seen[0].width.sum() < free.x_max.sum()


def test_an_unstable_network_is_observed():
    net = kp.feedback_interconnect(kp.stack([[[1.0]]] * 2, [[1]], [[1]]), [[0, 1], [1, 0]])
    o = kp.interval_observer(net, disturbance=([-1, -1], [1, 1]), noise=0.5)
    assert net.certificate.status is kp.Status.REFUTED and o and (o.L < -2).all()


def test_no_local_gains_are_refuted_with_proof():
    blind = kp.stack([[[1, 0], [0, -1]]] * 3, [[0], [1]], [[0, 1]])  # the unstable state is not seen
    net = kp.feedback_interconnect(blind, np.roll(np.eye(3), 1, axis=0))
    o = kp.interval_observer(net, noise=1)
    assert o.status is kp.Status.REFUTED and o.check() and o.L is None and "no local gains" in o.explain()
    some = kp.feedback_interconnect(blind, np.roll(np.eye(3), 1, axis=0), outputs=[0])
    o = kp.interval_observer(some, noise=1)
    assert o.status is kp.Status.UNDECIDED and "none were excluded" in o.explain()


def test_links_of_nodes_to_themselves_belong_to_the_nodes():
    o = local(W=[[0.25, 0.5], ["1/3", 0]])
    assert o and o.check() and o.certificate.plant.origin is not None
    model = o.certificate.plant.origin
    assert (o.certificate.plant.stacks[0].A.values == own_links_closed(model).stacks[0].A.values).all()


def test_cones_of_generators_in_doubles():
    R = np.array([[1.3, 0.2], [0.7, 1.0]])  # its facets are known exactly as integers of any length
    A, B, C = R @ [[-1, 0.2], [0.3, -2]] @ np.linalg.inv(R), R @ [[0.1], [0.2]], [[1, 0.5]] @ np.linalg.inv(R)
    seen = []
    for rays in (R.T.tolist(), [[13, 7], [2, 10]]):
        nodes = kp.stack([A] * 3, B, C, X=kp.PolyhedralCone(rays))
        net = kp.feedback_interconnect(nodes, np.roll(np.eye(3), 1, axis=0), outputs=[0, 1])
        o = kp.interval_observer(net, disturbance=([-1] * 6, [1] * 6), noise=0.1)
        assert o and o.check()
        seen.append(o.width)
    assert seen[0] == pytest.approx(seen[1], rel=1e-6) and seen[0].max() < 10


def test_a_whole_network_may_be_one_system():
    net = kp.feedback_interconnect(kp.stack([[[-2.0]]] * 2, [[1]], [[1]]), [[0, 1], [1, 0]])
    o = kp.interval_observer(net, disturbance=([-1, -1], [1, 1]), noise=0.1, X=kp.orthant(2))
    assert o and isinstance(o.certificate, kp.IntervalObserverCertificate)


def test_many_nodes():
    rng = np.random.default_rng(1)
    count = 2000
    A = rng.random((count, 2, 2)) / 2 - np.diag([3, 1])
    W = sp.csr_array(sp.random(count, count, 3 / count, random_state=0))
    net = kp.feedback_interconnect(kp.stack(A, [[0], [0.1]], [[1, 0]]), W, outputs=list(range(0, count, 2)))
    o = kp.interval_observer(net, disturbance=(-np.ones(2 * count), np.ones(2 * count)), noise=0.05)
    assert o and o.check() and o.L.shape == (count, 2, 1) and not o.L[1::2].any()


CHANGES = dict.fromkeys(["w_lo", "upper", "x_max", "width"], -1) | dict.fromkeys(["w_hi", "noise", "lower"], 1)
CHANGES |= dict.fromkeys(["v", "u_max", "y_max"], -9)


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_vector_does_not_pass(pair, name):
    proof = pair.certificate
    values = np.ravel(getattr(proof, name)) + CHANGES[name]
    assert proof.check() and not replace(proof, **{name: Matrix(values)}).check()


@pytest.mark.parametrize("name", ["gain", "covers"])
def test_a_changed_matrix_does_not_pass(pair, name):
    proof = pair.certificate
    M = getattr(proof, name).values
    for changed in (M * 0.5, sp.csr_array(M + sp.csr_array(np.eye(*M.shape, k=-2)))):
        assert not replace(proof, **{name: Matrix(sp.csr_array(changed))}).check()


def test_another_network_does_not_pass(pair):
    proof = pair.certificate
    assert not replace(proof, model=proof.plant).check()
    assert not replace(proof, plant=proof.model).check()
    weaker = proof.plant.with_coupling(Matrix(sp.csr_array(proof.plant.W * 0.5)))
    assert not replace(proof, plant=weaker).check()


def test_files(pair, tmp_path, capsys):
    for o in (pair, local([["-1/3", "1/7"], ["1/5", -1]], noise="1/9"), local(W=[[0.25, 0.5], ["1/3", 0]])):
        for suffix in ("json", "npz"):
            path = tmp_path / f"file.{suffix}"
            o.save(path)
            loaded = kp.load_certificate(path)
            assert loaded == o.certificate and loaded.check() and loaded.exact == o.certificate.exact
        assert checker.main(tmp_path / "file.json") == 0


@pytest.mark.parametrize("name", ["upper", "width", "x_max"])
def test_forged_files(pair, tmp_path, capsys, name):
    path = tmp_path / "file.json"
    pair.save(path)
    content = json.loads(path.read_text())
    content["data"][name]["array"] = [0 for _ in content["data"][name]["array"]]
    path.write_text(json.dumps(tampering.redigested(content)))
    assert checker.main(path) == 1
    with pytest.raises(kp.KposError):
        kp.load_certificate(path)


def test_networks_that_are_refused():
    square = [[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]
    wide = kp.ConeStateSpace(-np.eye(3), [[0], [0], [1]], [[0, 0, 1]], 0, X=square)
    with pytest.raises(kp.NotProperConeError, match="4 generators"):
        kp.interval_observer(kp.feedback_interconnect([wide, wide], [[0, 1], [1, 0]]))
    direct = kp.ConeStateSpace([[-1]], [[1]], [[1]], [[0.25]])
    with pytest.raises(kp.DataError, match="feedthrough"):
        kp.interval_observer(kp.feedback_interconnect([direct] * 2, [[0, 1], [1, 0]]))
    ranges = kp.feedback_interconnect(
        [kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)] * 2, kp.interval([[0, 0], [0, 0]], [[0, 1], [1, 0]])
    )
    with pytest.raises(kp.DataError):
        kp.interval_observer(ranges)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"disturbance": ([0], [1])}, "disturbance"),
        ({"disturbance": ([1] * 4, [0] * 4)}, "disturbance has its lower"),
        ({"noise": [1, 2, 3]}, "noise"),
        ({"noise": -1}, "noise"),
    ],
)
def test_bad_arguments_are_named(change, words):
    net = kp.feedback_interconnect(kp.stack([[[-2, 1], [1, -2]]] * 2, [[0], [1]], [[1, 0]]), [[0, 1], [1, 0]])
    with pytest.raises(kp.KposError, match=words):
        kp.interval_observer(net, **{"disturbance": ([0] * 4, [1] * 4), "noise": 0.1} | change)


def test_bad_signals_are_named(pair):
    for change, words in (({"y": [0, 0]}, "y has shape"), ({"x0": ([0], [1])}, "x0"), ({"u": [[0, 0]]}, "u has shape")):
        with pytest.raises(kp.KposError, match=words):
            pair.simulate(**{"T": [0, 1], "y": np.zeros((2, 2)), "x0": ([0] * 4, [1] * 4)} | change)
    with pytest.raises(kp.DataError, match="one plant"):
        pair.start(([0] * 4, [1] * 4))


def test_pictures(pair):
    T, y = [0, 1, 2], np.zeros((2, 3))
    cplt = kp.plot_observer(pair, T, y, x0=([0] * 4, [1] * 4), states=np.zeros((4, 3)), which=[2, 0])
    assert [ax.get_ylabel() for ax in cplt.axes[:, 0]] == ["node[1]_x[0]", "node[0]_x[0]"]
    assert [text.get_text() for text in cplt.legend.get_texts()] == ["bounds", "state"]
    for which, words in (([4], "which holds 4"), ([0] * 21, "choose 1 to 20")):
        with pytest.raises(kp.KposError, match=words):
            kp.plot_observer(pair, T, y, x0=([0] * 4, [1] * 4), which=which)
