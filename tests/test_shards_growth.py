"""Networks in shards that grow: a state in files, proven shard by shard; and small networks in one piece."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
from network_examples import cycle, lag
from sharded_networks import certified, masses, verdicts, written

import control_kpos as kp
from control_kpos.exact.condition import all_hold
from control_kpos.exact.matrix import Matrix
from control_kpos.networks import conditions as on
from control_kpos.proof.files import digest
from control_kpos.shards import certifying, whole
from control_kpos.shards.certificate import SavedCertificate
from control_kpos.shards.folders import shard_folder, write_arrays
from control_kpos.shards.growth_proof import heard, is_growing, senders
from control_kpos.shards.network import ShardedNetwork


@pytest.fixture
def apart(monkeypatch):
    """No network is small enough to be held in one piece."""
    monkeypatch.setattr(certifying, "fits", lambda network: False)


def restated(path, **changes):
    """A manifest with other entries, and the right digest."""
    content = json.loads((path / "manifest.json").read_text())
    content["data"].update(changes)
    (path / "manifest.json").write_text(json.dumps({**content, "digest": digest(content["data"])}))


def changed(found, p, **arrays):
    """Other vectors in the files of a shard, with the right digests."""
    shards = json.loads((found.path / "manifest.json").read_text())["data"]["shards"]
    shards[p]["files"] |= write_arrays(found.path, p, arrays)
    restated(found.path, shards=shards)


# -- verdicts


def wide_nodes(rng, discrete):
    """Inputs and outputs in cones that are no orthants, some with more facets than dimensions."""
    out = []
    while len(out) < 5:
        node = random_networks.random_node(rng, discrete=discrete, feedthrough=len(out) % 2 == 0, damping=0.5)
        if node.ninputs + node.noutputs > 2:
            out.append(node)
    return out


@pytest.mark.parametrize("seed", range(6))
def test_wide_cones_feedthrough_and_discrete_time(tmp_path, apart, seed):
    rng = np.random.default_rng(seed)
    nodes = wide_nodes(rng, discrete=bool(seed % 2))
    blocks = [[random_networks.positive_map(rng, b.Y, a.U, 1) for b in nodes] for a in nodes]
    W = random_networks.dense_coupling(nodes, blocks)
    loop = random_networks.poles_by_dense_algebra(nodes, W)[0]
    W = W * 0.8 / loop
    _, poles, _ = random_networks.poles_by_dense_algebra(nodes, W)
    grows = np.abs(poles).max() > 1 if seed % 2 else poles.real.max() > 0
    found = certified(tmp_path, nodes, W, 3)
    assert found.status == ("REFUTED" if grows else "PROVED")
    assert found.check()
    if grows:
        assert seed % 2 <= found.witness.rate <= (np.abs(poles).max() if seed % 2 else poles.real.max()) + 1e-12
        assert ("growth factor per step" in found.explain()) == bool(seed % 2)


def test_a_part_that_grows_among_others_that_do_not(tmp_path, apart):
    W = sp.block_diag([0.5 * cycle(20), 1.5 * cycle(4), 0.9 * cycle(9)]).toarray()
    W[0, 20] = W[25, 21] = 0.1
    found = certified(tmp_path, [lag(1.0)] * 33, W, 5)
    assert found.status == "REFUTED"
    assert 20 <= found.witness.node < 24
    assert 0 < found.witness.rate <= 0.5
    again = kp.shards.check(found.path)
    assert again.witness == found.witness


def test_a_node_alone_that_grows_is_found_in_its_shard(tmp_path, apart):
    found = certified(tmp_path, [lag(1.0)] * 5 + [lag(-0.25)] + [lag(1.0)] * 3, 0.1 * cycle(9), 4)
    assert (found.status.name, found.witness.node) == ("REFUTED", 5)
    assert 0.1 <= found.witness.rate <= 0.26
    assert found.check()


def test_an_executor(tmp_path):
    nodes, W = masses()
    found = certified(tmp_path, nodes, 10 * W, 5)
    with ThreadPoolExecutor(2) as executor:
        assert kp.shards.check(found.path, executor).witness == found.witness
    assert found.witness.alive == 48


# -- the proof


def test_no_inequality_of_the_motion_is_lost_or_divided(tmp_path):
    """The conditions of the shards are those of one piece, and one for every input of the halo that z is below."""
    nodes, W = masses(n=12)
    found = certified(tmp_path, nodes, 10 * W, 4)
    saved = SavedCertificate.open(found.path)
    network = saved.network
    x, u, y = (np.concatenate([saved.vector(p, name) for p in network.filled]) for name in "xuy")
    net = kp.feedback_interconnect(nodes, 10 * W)
    whole = list(on.motion(net.model, *map(Matrix, (x, u, y)), found.witness.rate))
    total, away = sum(c.residual.size for c in whole), 0
    assert all_hold(whole)
    feeding = senders(network)
    for p in network.filled:
        model = network.model(p)
        z = saved.vector(p, "z")
        values, places = heard(network, p, feeding[p], lambda s: saved.vector(s, "z"))
        vectors = Matrix(saved.vector(p, "x")), Matrix(np.r_[saved.vector(p, "u"), z]), Matrix(saved.vector(p, "y"))
        own = on.motion(model, *vectors, found.witness.rate, (Matrix(values), places))
        total, away = total - sum(c.residual.size for c in own), away + len(z)
    assert total == -away


@pytest.mark.parametrize("name", ["x", "u", "y", "z"])
@pytest.mark.parametrize("p", range(3))
def test_every_vector_of_every_shard_matters(tmp_path, name, p):
    """On x' = -x + u, y = x around a cycle with gain 1.5: x = 1, u = 1.5 x, z = 1.5 y and rate 0.5 leave no room."""
    folder = written(tmp_path, [lag(1.0)] * 6, 1.5 * cycle(6), 3)
    network = ShardedNetwork.open(folder)
    ones = {s: {"x": np.ones(2), "u": np.full(2, 1.5), "y": np.ones(2), "z": np.full(1, 1.5)} for s in range(3)}
    feeding = senders(network)
    assert feeding == {0: [1], 1: [2], 2: [0]}

    def proven(vectors):
        sent = {s: heard(network, s, feeding[s], lambda k: vectors[k]["z"]) for s in range(3)}
        parts = ([vectors[s][key] for key in "xuyz"] for s in range(3))
        return [is_growing(network.model(s), part, 0.5, sent[s], None) for s, part in enumerate(parts)]

    assert proven(ones) == [True] * 3
    hearing = (p - 1) % 3
    for factor in (1 + 1e-12, 1 - 1e-12):
        vectors = {s: dict(v) for s, v in ones.items()}
        vectors[p][name] = ones[p][name].copy()
        vectors[p][name][-1] *= factor
        more = factor > 1
        # a larger x, u, y or z asks for more of what it is bounded by; a smaller one gives less to what it bounds
        broken = {"x": {p}, "u": {p}, "y": {p}, "z": {p if more else hearing}}[name]
        assert {s for s, fine in enumerate(proven(vectors)) if not fine} == broken


def test_bounds_of_several_shards_are_added_up(tmp_path):
    """Node 0 hears four others in four shards; together they send 4, and nothing of it may be left out."""
    W = np.zeros((5, 5))
    W[0, 1:] = W[1:, 0] = 1.0
    folder = written(tmp_path, [lag(1.0)] * 5, W, 5)
    network = ShardedNetwork.open(folder)
    feeding = senders(network)
    assert feeding[0] == [1, 2, 3, 4]
    values, places = heard(network, 0, feeding[0], lambda s: np.ones(1))
    x, y, z = np.array([2.0]), np.array([2.0]), np.full(4, 2.0)
    model = network.model(0)
    for u, holds in ((4.0, True), (np.nextafter(4.0, 5.0), False)):
        assert is_growing(model, (x, np.array([u]), y, z), 1.0, (values, places), None) is holds
    assert not is_growing(model, (x, np.array([4.0]), y, z), 1.0, (values[1:], places[1:]), None)


# -- changed files


def grown(tmp_path):
    return certified(tmp_path, [lag(1.0)] * 6, 1.5 * cycle(6), 3)


def test_changed_vectors_are_found(tmp_path):
    found = grown(tmp_path)
    saved = SavedCertificate.open(found.path)
    for name in "xuyz":
        for factor in (0.5, 2.0, -1.0, np.nan):
            original = np.array(saved.vector(1, name))
            changed(found, 1, **{name: factor * original})
            if factor == 0.5 and name == "y":  # smaller outputs are still bounds; what is sent of them is not
                assert not found.check()
            with pytest.raises(kp.FalseClaimError, match="does not show that the state grows"):
                kp.shards.check(found.path)
            changed(found, 1, **{name: original})
    assert found.check()


def test_the_state_zero_does_not_grow(tmp_path):
    found = grown(tmp_path)
    for p in range(3):
        changed(found, p, x=np.zeros(2), u=np.zeros(2), y=np.zeros(2), z=np.zeros(1))
    with pytest.raises(kp.FalseClaimError, match="is 0"):
        kp.shards.check(found.path)


@pytest.mark.parametrize("rate", ["0x1.0p+0", "-0x1.0p-3", "nan", "inf", 3, None])
def test_other_rates_are_refused(tmp_path, rate):
    found = grown(tmp_path)
    restated(found.path, growth=rate)
    with pytest.raises(kp.CertificateFileError):
        kp.shards.check(found.path)
    assert not found.check()


def test_smaller_rates_are_true(tmp_path):
    found = grown(tmp_path)
    restated(found.path, growth=(0.5 * found.witness.rate).hex())
    assert kp.shards.check(found.path).witness.rate == 0.5 * found.witness.rate
    assert not found.check()


def test_damaged_missing_and_exchanged_files_are_named(tmp_path):
    found = grown(tmp_path)
    for name in "xuyz":
        path = shard_folder(found.path, 2) / f"{name}.npy"
        original = path.read_bytes()
        path.write_bytes(original[:-1] + bytes([original[-1] ^ 1]))
        with pytest.raises(kp.CertificateFileError, match=rf"{name}\.npy"):
            kp.shards.check(found.path)
        path.unlink()
        with pytest.raises(kp.CertificateFileError, match="missing"):
            kp.shards.check(found.path)
        path.write_bytes(original)
    changed(found, 0, z=np.zeros(2))
    with pytest.raises(kp.CertificateFileError, match="has not the size of its shard"):
        kp.shards.check(found.path)


@pytest.mark.parametrize("status", ["PROVED", "UNDECIDED"])
def test_growth_is_no_proof_of_anything_else(tmp_path, status):
    found = grown(tmp_path)
    restated(found.path, status=status)
    with pytest.raises(kp.CertificateFileError):
        kp.shards.check(found.path)


def test_growth_of_a_network_that_is_not_positive_shows_nothing(tmp_path):
    """x' = -x, and nothing else: the state would have to grow by what it does not get."""
    nodes = [lag(1.0)] * 3 + [kp.ConeStateSpace([[-2.0]], [[-1.0]], [[1.0]], 0)] + [lag(1.0)] * 2
    found = grown(tmp_path)
    other = written(tmp_path, nodes, 1.5 * cycle(6), 3, "other")
    content = json.loads((other / "manifest.json").read_text())
    proof = other / "proof"
    shutil.copytree(found.path, proof)
    restated(proof, network={"folder": "..", "digest": digest(content["data"])})
    with pytest.raises(kp.FalseClaimError, match="shard 1 does not show"):
        kp.shards.check(proof)


# -- in one piece


def test_numbers_that_are_no_doubles(tmp_path):
    """A cycle of gain 3 * 1/3 is on the margin; with 0.34 for 1/3 it grows."""
    nodes = kp.stack([[["-1/3"]]] * 4, [[1]], [[1]])
    links = [["1/3" if j == (k + 1) % 4 else 0 for k in range(4)] for j in range(4)]
    found = certified(tmp_path, nodes, links, 3)
    assert found.status == "REFUTED"
    assert found.check()
    faster = [[x if x == 0 else "0.34" for x in row] for row in links]
    found = certified(tmp_path, nodes, faster, 3, "faster")
    assert found.status == "REFUTED"
    assert found.whole is None
    assert found.check()


def on_the_margin(n=6):
    return [lag(1.0)] * n, cycle(n)


def test_the_margin_itself_is_decided_in_one_piece(tmp_path):
    found = certified(tmp_path, *on_the_margin(), 3)
    one = kp.feedback_interconnect(*on_the_margin()).certificate
    assert found.status is one.status is found.whole.status
    assert (found.path / "whole.json").exists()
    assert f"{found.witness}" in found.explain()
    assert found.check()


def test_gathered_shards_are_the_network(tmp_path):
    rng = np.random.default_rng(8)
    for trial in range(8):
        nodes, blocks, _ = random_networks.random_network(rng)
        W = random_networks.dense_coupling(nodes, blocks)
        network = ShardedNetwork.open(written(tmp_path, nodes, W, int(rng.integers(1, 6)), f"{trial}"))
        one, many = kp.feedback_interconnect(nodes, W).model, whole.gathered(network)
        assert (one.coupling.values != many.coupling.values).nnz == 0
        for j in range(one.n_nodes):
            a, b = one.data_of(j), many.data_of(j)
            assert all(a[key] == b[key] for key in "XUY")
            assert all((a[key].values == b[key].values).all() for key in "ABCD")
        assert whole.same_network(many, whole.gathered(network))


@pytest.mark.parametrize("part", ["link", "node", "time", "cone", "size"])
def test_a_certificate_of_another_network_is_refused(tmp_path, part):
    nodes, W = on_the_margin()
    found = certified(tmp_path, nodes, W, 3)
    if part == "link":
        W = W + 1e-16 * W[::-1]
    elif part == "node":
        nodes = [*nodes[:-1], lag(1.0 - 2.0**-52)]
    elif part == "time":
        nodes = [kp.ConeStateSpace([[1.0]], [[1.0]], [[1.0]], 0, 0.5)] * 6
    elif part == "cone":
        ray = kp.PolyhedralCone([[-1.0]])
        nodes = [kp.ConeStateSpace([[-1.0]], [[1.0]], [[1.0]], 0, X=ray, U=ray, Y=ray)] * 6
    else:
        nodes, W = on_the_margin(7)
    other = written(tmp_path, nodes, W, 3, "other")
    shutil.copytree(found.path, other / "proof")
    content = json.loads((other / "manifest.json").read_text())
    restated(other / "proof", network={"folder": "..", "digest": digest(content["data"])})
    with pytest.raises(kp.FalseClaimError, match="is about another network"):
        kp.shards.check(other / "proof")


def test_what_is_no_answer_in_one_piece_is_refused(tmp_path, monkeypatch):
    found = certified(tmp_path, *on_the_margin(), 3)
    restated(found.path, status="PROVED")
    with pytest.raises(kp.FalseClaimError, match="proves REFUTED"):
        kp.shards.check(found.path)
    restated(found.path, status="REFUTED", whole={"sha256": "0" * 64})
    with pytest.raises(kp.CertificateFileError, match="not the file"):
        kp.shards.check(found.path)
    file = found.path / "whole.json"
    kp.linear_lyapunov([[-1.0]], kp.orthant(1)).save(file)
    restated(found.path, whole={"sha256": whole._digest(file)})
    with pytest.raises(kp.FalseClaimError, match="proves nothing about a network"):
        kp.shards.check(found.path)
    file.unlink()
    with pytest.raises(kp.CertificateFileError, match=r"whole\.json is missing"):
        kp.shards.check(found.path)
    monkeypatch.setattr(whole, "_NODES", 5)
    with pytest.raises(kp.CertificateFileError, match="6 nodes are too many"):
        kp.shards.check(found.path)


def test_supply_rates_that_fail_refute_no_network(tmp_path):
    """A file may say REFUTED of supply rates that somebody chose; that is nothing about stability."""
    nodes, W = [lag(1.0)] * 6, 0.5 * cycle(6)
    found = certified(tmp_path, nodes, W, 3)
    file = found.path / "whole.json"
    chosen = kp.feedback_interconnect(nodes, W, supply_rates=[([-1.0], [9.0])] * 6)
    assert chosen.certificate.status == "REFUTED"
    chosen.certificate.save(file)
    restated(found.path, status="REFUTED", shards=[], whole={"sha256": whole._digest(file)})
    with pytest.raises(kp.FalseClaimError, match="proves nothing"):
        kp.shards.check(found.path)


def test_proofs_in_one_piece_have_rates(tmp_path):
    nodes, W = masses(seed=3, n=20)
    model = kp.feedback_interconnect(nodes, W).model
    gains = model.stacks[0].C.values @ np.linalg.inv(-model.stacks[0].A.values) @ model.stacks[0].B.values
    radius = np.abs(np.linalg.eigvals((W @ sp.diags_array(np.ravel(gains))).toarray())).max()
    found = certified(tmp_path, nodes, W / radius * (1 - 2e-14), 25)
    one = kp.feedback_interconnect(nodes, W / radius * (1 - 2e-14)).certificate
    assert found.status is one.status
    if found.whole is not None and found:
        assert found.decay_rate == one.decay_rate == found.rates.min()
        assert np.isinf(found.rates).sum() == 5


# -- time


def test_a_time_limit_ends_the_search(tmp_path, apart):
    nodes, W = masses(n=60)
    folder = written(tmp_path, nodes, W, 6)
    found = kp.shards.certify(folder, folder / "proof", time_limit=1e-9)
    assert found.status == "UNDECIDED"
    assert "the time limit ended the search" in found.explain()
    assert kp.shards.certify(folder, folder / "proof", time_limit=1e9).status == "PROVED"


# -- many


@pytest.mark.parametrize("first", [0, 15, 30, 45])
def test_verdicts_on_random_networks_are_those_of_one_process(tmp_path, first):
    """`python benchmarks/campaign.py shards 1000` runs a thousand."""
    counts = verdicts(range(first, first + 15), tmp_path)
    assert not counts["false"]
    assert not counts["less decided"]
    assert counts["PROVED"] and counts["REFUTED"]
