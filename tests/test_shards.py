"""Networks in shards on files: the same verdicts as in one piece, from one shard at a time, and nothing forged."""

import json
import os
import resource
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
from network_examples import cycle, lag
from sharded_networks import certified, masses, written

import control_kpos as kp
from control_kpos.__main__ import main
from control_kpos.exact.condition import all_hold
from control_kpos.exact.matrix import Matrix
from control_kpos.networks.certificate import decreasing
from control_kpos.networks.certify import settle
from control_kpos.networks.inwards import lower_outputs
from control_kpos.networks.spectrum.port_solves import krylov
from control_kpos.networks.witnesses import positive_parts
from control_kpos.proof.files import digest
from control_kpos.shards import certifying, steps
from control_kpos.shards.certificate import SavedCertificate
from control_kpos.shards.network import ShardedNetwork


def vectors(certificate):
    """v, r and q of all shards behind each other."""
    saved = SavedCertificate.open(certificate.path)
    return [np.concatenate([saved.vector(p, name) for p in saved.network.filled]) for name in "vrq"]


# -- verdicts and rates


@pytest.mark.parametrize("parts", [1, 5, 30])
def test_rates_do_not_depend_on_the_number_of_shards(tmp_path, parts):
    nodes, W = masses()
    whole = kp.feedback_interconnect(nodes, W).certificate
    found = certified(tmp_path, nodes, W, parts)
    assert found.status == "PROVED"
    assert found.n_shards == parts
    assert found.decay_rate == found.rates.min()
    # products of stacks of other lengths may differ in the last bit
    assert found.decay_rate == pytest.approx(whole.decay_rate, rel=1e-14, abs=0)
    assert found.check()
    assert "Proved" in found.explain()


@pytest.mark.parametrize("seed", range(6))
def test_verdicts_are_those_of_the_network_in_one_piece(tmp_path, seed):
    """Nodes of all sizes and cones, with feedthrough, in discrete time; also on the margin and a digit beside it."""
    rng = np.random.default_rng(seed)
    proved = 0
    for trial in range(12):
        if trial % 2:
            nodes, blocks, _ = random_networks.random_network(rng)
            W = random_networks.dense_coupling(nodes, blocks)
        else:
            nodes, W, _ = random_networks.marginal_network(rng) or ([lag(2.0)] * 3, cycle(3), False)
        whole = kp.feedback_interconnect(nodes, W)
        found = certified(tmp_path, nodes, W, int(rng.integers(1, len(nodes) + 3)), f"{trial}")
        assert found.status is whole.certificate.status, found.explain()
        again = kp.shards.check(found.path)
        assert (again.status, again.decay_rate) == (found.status, found.decay_rate)
        if found and found.whole is None:
            proved += 1
            alone = settle(whole.certificate.model, tuple(vectors(found)), whole.certificate.loop)
            assert alone.status == "PROVED"
            # the same r: products of stacks of other lengths may differ in the last bit
            assert alone.decay_rate == pytest.approx(found.decay_rate, rel=1e-12, abs=0)
        elif found:  # so close to the margin that only integers decide
            assert found.whole.exact is not None
    assert proved > 1


@pytest.mark.parametrize("digits", [2, 5, 8])
@pytest.mark.parametrize("side", [-1, 1])
def test_near_the_margin(tmp_path, digits, side, monkeypatch):
    monkeypatch.setattr(certifying, "fits", lambda network: False)  # as for a large network
    nodes, W = masses(seed=digits, n=30)
    model = kp.feedback_interconnect(nodes, W).model
    gains = model.stacks[0].C.values @ np.linalg.inv(-model.stacks[0].A.values) @ model.stacks[0].B.values
    radius = np.abs(np.linalg.eigvals((W @ sp.diags_array(np.ravel(gains))).toarray())).max()
    found = certified(tmp_path, nodes, W / radius * (1 + side * 10.0**-digits), 4)
    assert found.status == ("REFUTED" if side > 0 else "PROVED")
    assert found.check()
    assert found.whole is None
    assert (found.witness.rate if side > 0 else found.decay_rate) > 0


# -- a shard as a model


def test_no_inequality_of_theorem_4_is_lost_or_divided(tmp_path):
    """The conditions of the shards are those of the network in one piece, with a factor for every output once."""
    nodes = [
        lag(3.0),
        random_networks.random_node(np.random.default_rng(3), discrete=False, feedthrough=True, damping=0.8),
    ]
    nodes = [nodes[j % 2] for j in range(6)]
    blocks = [[0.1 * random_networks.positive_map(np.random.default_rng(1), b.Y, a.U, 1) for b in nodes] for a in nodes]
    net = kp.feedback_interconnect(nodes, random_networks.dense_coupling(nodes, blocks))
    assert net.certificate
    network = ShardedNetwork.open(written(tmp_path, nodes, net.model.coupling, 3))
    v, r, q = (net.certificate.__dict__[name].values for name in "vrq")
    p, t = (part.values for part in net.certificate.loop)
    total = {"shards": 0, "whole": 0}
    whole = [*positive_parts(net.model), *decreasing(net.model, *map(Matrix, (v, r, q)), 0.0, (Matrix(p), Matrix(t)))]

    def count(conditions):
        """Equal B, C and D of nodes in one model are proven once."""
        return sum(c.residual.size for c in conditions if not c.name.startswith(("h'B", "h'C", "h'D")))

    total["whole"] = count(whole)
    for s in network.filled:
        model, fed = network.model(s), network.fed(s)
        own = [Matrix(v[network.own(s, 1)]), Matrix(r[fed]), Matrix(q[network.own(s, 3)])]
        weights = Matrix(p[network.own(s, 3)]), Matrix(t[fed])
        conditions = [*positive_parts(model), *decreasing(model, *own, 0.0, weights)]
        assert all_hold(conditions)
        total["shards"] += count(conditions)
    assert total["shards"] == total["whole"]


@pytest.mark.parametrize("place", range(6))
def test_r_of_any_input_matters(tmp_path, place):
    """(III') of a shard reads r of its halo: a larger one breaks the shards that feed it, a smaller one its own."""
    nodes, W = kp.stack([[[-2.0]]] * 6, [[1.0]], [[1.0]]), cycle(6)
    network = ShardedNetwork.open(written(tmp_path, nodes, W, 3))
    r = np.ones(6)
    r[place] *= 1 + 1e-9
    holds = []
    for s in network.filled:
        model, own = network.model(s), network.own(s, 1)
        q = Matrix(np.full(2, -1.0))
        holds.append(all_hold(decreasing(model, Matrix(np.ones(2)), Matrix(r[network.fed(s)]), q, 0.5, None)))
        assert own.stop - own.start == 2
    feeding = (place + 1) % 6 // 2
    assert [s for s, fine in enumerate(holds) if not fine] == [feeding]


def test_the_halo_knows_the_cones_of_its_nodes(tmp_path):
    """A link into a cone elsewhere that it leaves is seen from its source, under the numbers of the whole network."""
    other = kp.PolyhedralCone([[1.0, 1.0], [1.0, -1.0]])
    plain = kp.ConeStateSpace(-3 * np.eye(2), np.eye(2), np.eye(2), 0)
    turned = kp.ConeStateSpace(-3 * np.eye(2), np.eye(2), np.eye(2), 0, X=other, U=other, Y=other)
    nodes = [plain, plain, plain, turned]
    blocks = [[None] * 4 for _ in range(4)]
    blocks[3][0] = np.array([[1.0, 1.0], [0.0, 0.0]])
    assert certified(tmp_path, nodes, blocks, 2, "good").status == "PROVED"
    blocks[3][0] = np.array([[1.0, 1.0], [0.0, 2.0]])  # e2 goes to (1, 2), which is not in the cone
    found, whole = certified(tmp_path, nodes, blocks, 2, "bad"), kp.feedback_interconnect(nodes, blocks).certificate
    assert found.status == whole.status == "REFUTED"
    assert vars(found.witness) == vars(whole.witness)
    assert (found.refuted, found.witness.target, found.witness.source) == (0, 3, 0)


def test_a_node_that_is_not_positive_is_named(tmp_path):
    nodes = [lag(2.0)] * 4 + [kp.ConeStateSpace([[-2.0]], [[-1.0]], [[1.0]], 0)] + [lag(2.0)]
    found = certified(tmp_path, nodes, cycle(6), 3)
    whole = kp.feedback_interconnect(nodes, cycle(6)).certificate
    assert found.status == whole.status == "REFUTED"
    assert (found.witness.node, found.refuted) == (whole.witness.node, 2) == (4, 2)
    assert found.check()
    assert "node 4 is not positive" in found.explain()


def test_links_of_nodes_to_themselves_become_parts_of_them(tmp_path):
    W = 0.5 * cycle(6) - 0.25 * np.eye(6)
    found = certified(tmp_path, [lag(1.0)] * 6, W, 3)
    assert found.status == "PROVED"
    assert found.decay_rate == pytest.approx(0.75, abs=1e-9)
    assert found.check()


def test_a_node_on_the_margin(tmp_path):
    found = certified(tmp_path, [lag(1.0), lag(0.0)], np.zeros((2, 2)), 2)
    assert found.status == "REFUTED"
    assert (found.witness.rate, found.witness.node, found.witness.alive) == (0.0, 1, 1)
    assert found.check()


def test_algebraic_loops_that_do_not_contract(tmp_path):
    found = certified(tmp_path, [lag(1.0, D=1.0)] * 4, cycle(4), 2)
    assert found.status == "REFUTED"
    assert "algebraic loop of gain 1 or more through nodes 0, 1, 2, 3" in found.explain()
    assert found.check()


# -- sources


class Made:
    """A network that exists only as two functions."""

    def __init__(self, n):
        self.n_nodes, self.asked = n, []

    def nodes(self, first, last):
        self.asked.append((first, last))
        return kp.stack(-3.0 - np.arange(first, last)[:, None, None] % 5, [[1.0]], [[1.0]])

    def links(self, first, last):
        rows = (np.arange(first, last) + 7) % self.n_nodes
        return sp.csc_array((np.ones(len(rows)), rows, np.arange(len(rows) + 1)), shape=(self.n_nodes, last - first))


def test_a_source_of_functions_gives_the_same_files(tmp_path):
    source = Made(50)
    asked = kp.shards.write(source, tmp_path / "asked", 4)
    assert source.asked == [(0, 12), (12, 25), (25, 37), (37, 50)]
    source.asked.clear()
    given = written(tmp_path, source.nodes(0, 50), source.links(0, 50), 4, "given")
    texts = [(folder / "manifest.json").read_text() for folder in (asked, given)]
    assert texts[0] == texts[1]
    assert kp.shards.certify(asked, tmp_path / "proof").status == "PROVED"


def test_ragged_shards_of_mixed_nodes(tmp_path):
    rng = np.random.default_rng(4)
    kinds = [random_networks.random_node(rng, discrete=True, feedthrough=False, damping=0.5) for _ in range(3)]
    nodes = [kinds[int(k)] for k in rng.integers(0, 3, 17)]
    blocks = [
        [0.01 * random_networks.positive_map(rng, b.Y, a.U, 1) if rng.random() < 0.3 else None for b in nodes]
        for a in nodes
    ]
    whole = kp.feedback_interconnect(nodes, blocks).certificate
    for parts in (1, 3, 5, 30):
        found = certified(tmp_path, nodes, blocks, parts, f"{parts}")
        assert found.status == "PROVED"
        assert found.decay_rate == pytest.approx(whole.decay_rate, rel=1e-9)
        assert found.check()


def test_equal_matrices_are_written_once(tmp_path):
    folder = written(tmp_path, kp.stack(-np.ones((9, 1, 1)), [[1.0]], [[1.0]]), 0.5 * cycle(9), 2)
    files = json.loads((folder / "manifest.json").read_text())["data"]["shards"][0]["files"]
    assert files["A0"]["shape"] == [1, 1, 1]
    assert "D0" not in files


def test_one_shard_at_a_time(tmp_path, monkeypatch):
    """While one shard is read, no array of another one is held."""
    alive, most = [], []
    original = ShardedNetwork.model

    def model(self, p, *, verify=False):
        out = original(self, p, verify=verify)
        alive.append(weakref.ref(out))
        most.append(sum(ref() is not None for ref in alive))
        return out

    folder = written(tmp_path, *masses(), 6)
    monkeypatch.setattr(ShardedNetwork, "model", model)
    kp.shards.check(kp.shards.certify(folder, folder / "proof").path)
    assert len(most) >= 24
    assert max(most) == 1


def test_files_are_closed_again(tmp_path):
    folder = written(tmp_path, *masses(), 24)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 12, hard))
    try:
        found = kp.shards.certify(folder, folder / "proof")
        assert kp.shards.check(found.path).status == found.status == "PROVED"
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


# -- arguments


def test_any_executor(tmp_path):
    found = certified(tmp_path, *masses(), 5)
    with ThreadPoolExecutor(2) as executor:
        again = kp.shards.check(found.path, executor)
    np.testing.assert_array_equal(again.rates, found.rates)


def test_the_command_line(tmp_path, capsys):
    folder = written(tmp_path, *masses(), 2)
    proof = str(folder / "proof")
    assert main(["certify", str(folder), "--out", proof]) == 0
    assert "PROVED Proved: the network of 24 nodes in 2 shards" in capsys.readouterr().out
    assert main(["check", proof]) == 0
    assert "PROVED" in capsys.readouterr().out
    assert main(["check", str(folder)]) == 2
    assert main(["certify", proof, "--out", str(tmp_path / "other")]) == 2
    assert main(["certify", str(folder), "--out", str(folder)]) == 2
    assert "UNREADABLE" in capsys.readouterr().out
    unstable = written(tmp_path, [lag(1.0)] * 3, 2 * cycle(3), 2, "unstable")
    assert main(["certify", str(unstable), "--out", proof]) == 1
    assert "REFUTED Not certified" in capsys.readouterr().out
    assert main(["check", proof]) == 1
    saved = folder / "proof" / "manifest.json"
    content = json.loads(saved.read_text())
    content["data"].pop("growth")
    content["data"].update(status="REFUTED", refuted=1, shards=[])
    saved.write_text(json.dumps({**content, "digest": digest(content["data"])}))
    assert main(["check", proof]) == 1
    assert "WRONG" in capsys.readouterr().out


def test_a_solve_with_one_unknown():
    """BiCGSTAB is done after half a step: the other half would divide 0 by 0."""
    r, steps = krylov(np.array([[0.9]]), np.ones(1), np.ones(1), 1e-13, 50)
    assert r == pytest.approx(10.0)
    assert steps == 1


def test_progress(tmp_path):
    lines = []
    folder = kp.shards.write(masses(), tmp_path / "network", 2, progress=lines.append)
    kp.shards.certify(folder, folder / "proof", progress=lines.append)
    kp.shards.check(folder / "proof", progress=lines.append)
    assert lines[0] == "nodes of shard 1 of 2"
    assert "proof of shard 2 of 2" in lines
    assert lines[-1] == "proven: 2 of 2 shards"


class Wrong(Made):
    def __init__(self, n, nodes=None, links=None):
        super().__init__(n)
        self.wrong_nodes, self.wrong_links = nodes, links

    def nodes(self, first, last):
        return super().nodes(first, last) if self.wrong_nodes is None else self.wrong_nodes

    def links(self, first, last):
        return super().links(first, last) if self.wrong_links is None else self.wrong_links


ONE = kp.stack([[[-1.0]]], [[1.0]], [[1.0]])
REFUSED = [
    ((ONE,), kp.DataError, "source has 1 items"),
    (7, kp.DataError, "source is 7"),
    ((ONE, [[1, 2]]), kp.ConeMismatchError, "coupling is 1 x 2"),
    ((kp.stack([[[[-1.0]]], [[[-2.0]]]], [[1.0]], [[1.0]]), [[0]]), kp.DataError, "vertices"),
    (Wrong(2.5), kp.DataError, r"source\.n_nodes"),
    (Wrong(0), kp.DataError, r"source\.n_nodes"),
    (Wrong(8, nodes=[]), kp.ShapeError, r"source\.nodes\(0, 4\)"),
    (Wrong(8, nodes=ONE), kp.ConeMismatchError, r"source\.nodes\(0, 4\) gives 1 nodes"),
    (Wrong(8, links=np.zeros((8, 3))), kp.ConeMismatchError, "nodes 0 to 3 are 8 x 3"),
    (Wrong(8, links=sp.csc_array(np.full((8, 4), np.nan))), kp.DataError, r"source\.links\(0, 4\)"),
]


@pytest.mark.parametrize(("source", "error", "says"), REFUSED)
def test_sources_that_are_refused(tmp_path, source, error, says):
    with pytest.raises(error, match=says):
        kp.shards.write(source, tmp_path / "network", 2)
    assert not (tmp_path / "network" / "manifest.json").exists()


def test_nodes_of_different_timebases(tmp_path):
    class Mixed(Made):
        def nodes(self, first, last):
            return kp.stack(np.full((last - first, 1, 1), 0.5), [[1.0]], [[0.1]], dt=0.1 if first < 4 else 0.2)

    with pytest.raises(kp.TimebaseError, match=r"nodes 4 to 7 have dt = 0\.2"):
        kp.shards.write(Mixed(8), tmp_path, 2)


def test_other_arguments_that_are_refused(tmp_path):
    nodes, W = masses()
    with pytest.raises(kp.DataError, match="parts is 0"):
        kp.shards.write((nodes, W), tmp_path, 0)
    with pytest.raises(kp.DataError, match="folder is 3"):
        kp.shards.write((nodes, W), 3)
    folder = written(tmp_path, nodes, W, 2)
    with pytest.raises(kp.DataError, match="holds a network already"):
        kp.shards.write((nodes, W), folder)
    with pytest.raises(kp.DataError, match=r"out is .*the folder of the network"):
        kp.shards.certify(folder, folder)
    with pytest.raises(kp.DataError, match="folder is None"):
        kp.shards.certify(None, folder)
    with pytest.raises(kp.DataError, match="executor is 3"):
        kp.shards.check(folder / "proof", 3)
    with pytest.raises(kp.CertificateFileError, match=r"no manifest\.json"):
        kp.shards.check(tmp_path / "nowhere")


def test_lowered_outputs_read_the_halo(tmp_path):
    """q <= -W'r of a shard with r of the inputs that it feeds."""
    nodes, W = masses()
    network = ShardedNetwork.open(written(tmp_path, nodes, W, 3))
    r = np.arange(1.0, 25.0)
    q = np.concatenate([lower_outputs(network.model(p), r[network.fed(p)]) for p in network.filled])
    exact = -(W.T @ r)
    assert (q <= exact).all()
    np.testing.assert_allclose(q, exact, rtol=1e-12)


def test_numbers_of_others_that_are_not_in_their_files(tmp_path, monkeypatch):
    """A process that sees other numbers than the files hold proves nothing: files are what others will check."""
    nodes, W = masses()
    folder = written(tmp_path, nodes, W, 3)
    prove = steps.prove

    def other(shard, r, t=None):
        """The second shard proves, and writes, a little more of r than the others see."""
        r = r.copy()
        r[shard.inputs] *= 1 + 1e-12 * (shard.p == 1)
        return prove(shard, r, t)

    monkeypatch.setattr(steps, "prove", other)
    with pytest.raises(kp.CertificateFileError, match=r"r\.npy .* are not what shard [02] was proven with"):
        kp.shards.certify(folder, tmp_path / "c")
    assert not (tmp_path / "c" / "manifest.json").exists()


def test_what_an_unfinished_run_has_left_does_no_harm(tmp_path, monkeypatch):
    nodes, W = masses()
    folder = written(tmp_path, nodes, W, 3)
    alone = kp.shards.certify(folder, tmp_path / "alone")
    left = tmp_path / "c" / ".unfinished"
    left.mkdir(parents=True)
    for name in ("direct-data", "direct-indices", "direct-indptr", "direct-columns", "c", "v", "places"):
        for p in range(3):
            np.save(left / f"{name}-{p:05d}.npy", np.full(7, np.nan))
            (left / f"closed-{p:05d}").touch()
    found = kp.shards.certify(folder, tmp_path / "c")
    assert found.status == "PROVED"
    assert np.array_equal(found.rates, alone.rates)
    assert not left.exists()
