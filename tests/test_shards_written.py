"""Writing of shards: nodes in a partition, writes that were interrupted, numbers that no double is equal to."""

import errno
import json
import shutil
import sys
from fractions import Fraction

import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
from network_examples import cycle, lag
from sharded_networks import certified, masses, written
from test_shards_files import forged

import control_kpos as kp
from control_kpos.shards import folders, sources
from control_kpos.shards.network import ShardedNetwork


class Made:
    """A network that is asked for part by part, of random nodes of several sizes."""

    def __init__(self, nodes, W):
        self.systems, self.W, self.n_nodes, self.asked = nodes, W, len(nodes), []
        self.ends = np.cumsum([0, *(s.noutputs for s in nodes)])

    def nodes(self, first, last):
        self.asked.append(("nodes", first))
        return self.systems[first:last]

    def links(self, first, last):
        self.asked.append(("links", first))
        return sp.csc_array(self.W[:, self.ends[first] : self.ends[last]])


def mixed(seed, n=15, discrete=False):
    rng = np.random.default_rng(seed)
    kinds = [random_networks.random_node(rng, discrete=discrete, feedthrough=True, damping=0.5) for _ in range(3)]
    nodes = [kinds[int(k)] for k in rng.integers(0, 3, n)]
    blocks = [
        [0.001 * random_networks.positive_map(rng, b.Y, a.U, 1) if rng.random() < 0.3 else None for b in nodes]
        for a in nodes
    ]
    return nodes, random_networks.dense_coupling(nodes, blocks), rng


# -- partitions


@pytest.mark.parametrize("seed", range(4))
def test_nodes_in_a_partition(tmp_path, monkeypatch, seed):
    """From memory and part by part, with empty shards: the verdict of the network in one piece, in another order."""
    monkeypatch.setattr(sources, "_PIECE", 4)
    nodes, W, rng = mixed(seed, discrete=bool(seed % 2))
    labels = rng.choice([0, 1, 3], len(nodes))
    whole = kp.feedback_interconnect(nodes, W).certificate
    folder = kp.shards.write((nodes, W), tmp_path / "memory", 5, partition=labels)
    found = kp.shards.certify(folder, folder / "proof")
    assert found.status == whole.status == "PROVED"
    assert found.decay_rate == pytest.approx(whole.decay_rate, rel=1e-9)
    assert found.check()
    network = ShardedNetwork.open(folder)
    assert [network.own(p, 0).stop - network.own(p, 0).start for p in range(5)] == np.bincount(
        labels, minlength=5
    ).tolist()
    for p in network.filled:
        count = network.data["shards"][p]["nodes"]
        np.testing.assert_array_equal(network.numbers(p, np.arange(count)), np.flatnonzero(labels == p))
    asked = kp.shards.write(Made(nodes, W), tmp_path / "asked", 5, partition=labels)
    again = kp.shards.certify(asked, asked / "proof")
    np.testing.assert_allclose(again.rates, found.rates, rtol=1e-9)
    assert not (asked / ".sorting").exists()


def test_the_same_network_in_another_order(tmp_path):
    """Every matrix and every link of the whole network is in the shards, in its place."""
    nodes, W, rng = mixed(7)
    network = ShardedNetwork.open(kp.shards.write((nodes, W), tmp_path / "network", partition=rng.integers(0, 4, 15)))
    order = np.concatenate([network.numbers(p, np.arange(network.data["shards"][p]["nodes"])) for p in range(4)])
    u, y = (np.cumsum([0, *(getattr(s, size) for s in nodes)]) for size in ("ninputs", "noutputs"))
    rows, cols = (np.concatenate([np.arange(at[j], at[j + 1]) for j in order]) for at in (u, y))
    assembled = np.zeros_like(W)
    for p in network.filled:
        model = network.model(p, verify=True)
        assembled[np.ix_(network.fed(p), np.arange(network.own(p, 3).start, network.own(p, 3).stop))] = (
            model.W.toarray()
        )
        for j in range(model.n_nodes):
            data = model.data_of(j)
            system = nodes[int(network.numbers(p, j))]
            assert all(np.array_equal(data[name].values, getattr(system, name)) for name in "ABCD")
    np.testing.assert_array_equal(assembled, W[np.ix_(rows, cols)])


@pytest.mark.parametrize("fault", ["node", "link"])
@pytest.mark.parametrize("partition", [[1, 0, 1, 0, 1, 0], [2, 2, 1, 1, 0, 0], None])
def test_witnesses_have_the_numbers_of_the_source(tmp_path, partition, fault):
    nodes, W = [lag(2.0) for _ in range(6)], cycle(6)
    if fault == "node":
        nodes[4] = kp.ConeStateSpace([[-2.0]], [[-1.0]], [[1.0]], 0)
    else:
        W[1, 3] = -1.0
    folder = kp.shards.write((nodes, W), tmp_path / "network", 3, partition=partition)
    found, whole = kp.shards.certify(folder, folder / "proof"), kp.feedback_interconnect(nodes, W).certificate
    assert found.status == whole.status == "REFUTED"
    assert {k: str(x) for k, x in vars(found.witness).items()} == {k: str(x) for k, x in vars(whole.witness).items()}
    assert found.check()


def test_metis_lets_few_links_lead_elsewhere(tmp_path):
    pytest.importorskip("pymetis")
    n = 400
    shuffled = np.random.default_rng(1).permutation(n)
    W = sp.csr_array((np.ones(n), (shuffled[np.arange(n) - 1], shuffled)), shape=(n, n))  # a ring, out of order
    nodes = kp.stack(-3 * np.ones((n, 1, 1)), [[1.0]], [[1.0]])
    halos = {}
    for partition in ("blocks", "metis"):
        folder = kp.shards.write((nodes, W), tmp_path / partition, 4, partition=partition)
        network = ShardedNetwork.open(folder)
        halos[partition] = sum(len(network.halo(p)) for p in range(4))
        sizes = np.diff(network.starts[0])
        assert sizes.max() <= 1.1 * n / 4
    assert halos["metis"] <= 12 < 200 < halos["blocks"]
    again = kp.shards.write((nodes, W), tmp_path / "again", 4, partition="metis")
    assert (again / "manifest.json").read_text() == (tmp_path / "metis" / "manifest.json").read_text()


def test_metis_part_by_part(tmp_path, monkeypatch):
    pytest.importorskip("pymetis")
    monkeypatch.setattr(sources, "_PIECE", 4)
    nodes, W, _ = mixed(3, n=30)
    labels = []
    for name, source in (("memory", (nodes, W)), ("asked", Made(nodes, W))):
        network = ShardedNetwork.open(kp.shards.write(source, tmp_path / name, 3, partition="metis"))
        labels.append([network.numbers(p, slice(None)).tolist() for p in range(3)])
    assert labels[0] == labels[1]
    assert sorted(j for shard in labels[0] for j in shard) == list(range(30))


@pytest.mark.parametrize("parts", [1, 4, 9])
def test_metis_where_there_is_nothing_to_choose(tmp_path, parts):
    pytest.importorskip("pymetis")
    folder = kp.shards.write(([lag(1.0)] * 4, np.zeros((4, 4))), tmp_path / "network", parts, partition="metis")
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"


def test_a_partition_in_order_moves_nothing(tmp_path):
    nodes, W = masses()
    source = np.repeat([0, 1, 1, 3], 6)
    network = ShardedNetwork.open(kp.shards.write((nodes, W), tmp_path / "network", partition=source))
    assert np.diff(network.starts[0]).tolist() == [6, 12, 0, 6]
    assert not any("numbers" in shard["files"] for shard in network.data["shards"])


@pytest.mark.parametrize(
    ("partition", "error", "says"),
    [
        ("best", kp.DataError, "partition is 'best'"),
        ([0, 1], kp.ShapeError, "for each of 24 nodes"),
        ([0.5] * 24, kp.DataError, r"partition\[0\] is 0\.5"),
        (["1/3"] * 24, kp.DataError, r"partition\[0\] is 0\.33"),
        ([0] * 20 + [-1] * 4, kp.DataError, r"partition\[20\] is -1"),
        (np.array([0] * 20 + [2] * 4), kp.DataError, r"partition\[20\] is 2, but there are 2 shards"),
        (np.array([10**5] * 24), kp.DataError, "numbered 0 to 99999"),
        ({"a": 1}, kp.DataError, "partition"),
    ],
)
def test_partitions_that_are_refused(tmp_path, partition, error, says):
    with pytest.raises(error, match=says):
        kp.shards.write(masses(), tmp_path / "network", 2, partition=partition)


def test_without_pymetis(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pymetis", None)
    with pytest.raises(kp.SolverError, match=r'pip install "control_kpos\[metis\]"'):
        kp.shards.write(masses(), tmp_path / "network", 2, partition="metis")


def test_damaged_numbers(tmp_path):
    nodes = [kp.ConeStateSpace([[-2.0]], [[-1.0]], [[1.0]], 0)] * 6
    folder = kp.shards.write((nodes, cycle(6)), tmp_path / "network", partition=[0, 1] * 3)
    forged(
        folder,
        lambda d: d["shards"][0]["files"].update(numbers=d["shards"][0]["files"]["halo"] | {"shape": [1]}),
        inside="",
    )
    with pytest.raises(kp.CertificateFileError, match=r"shard-00000"):
        kp.shards.certify(folder, folder / "proof")


# -- writes that were interrupted


def stop_after(monkeypatch, count):
    """A disk that is full after so many files."""
    original, seen = folders.write_whole, iter(range(10**6))

    def no_space(stream):
        raise OSError(errno.ENOSPC, "No space left on device")

    def write(path, content, **more):
        original(path, no_space if next(seen) >= count else content, **more)

    monkeypatch.setattr(folders, "write_whole", write)


@pytest.mark.parametrize("labels", [None, np.arange(12) % 4])
@pytest.mark.parametrize("count", [0, 1, 9, 14, 22, 30])
def test_an_interrupted_write_is_continued(tmp_path, monkeypatch, count, labels):
    """Whatever was finished is kept and not asked for again, and the files are those of a write in one go."""
    nodes, W, _ = mixed(1, n=12)
    whole = kp.shards.write(Made(nodes, W), tmp_path / "whole", 4, partition=labels)
    with monkeypatch.context() as patch:
        stop_after(patch, count)
        with pytest.raises(OSError, match="No space left") as caught:
            kp.shards.write(Made(nodes, W), tmp_path / "network", 4, partition=labels)
        assert "network" in str(caught.value.filename)
    with pytest.raises(kp.CertificateFileError, match=r"no manifest\.json"):
        kp.shards.certify(tmp_path / "network", tmp_path / "proof")
    finished = {path: path.stat().st_mtime_ns for path in (tmp_path / "network").rglob("shard-*/*.npy")}
    noted = {path.name for path in (tmp_path / "network" / ".unfinished").iterdir()} if count > 1 else set()
    source = Made(nodes, W)
    kp.shards.write(source, tmp_path / "network", 4, partition=labels, resume=True)
    for p in range(4):
        for kind in ("nodes", "links") if labels is None else ():
            assert ((kind, 3 * p) in source.asked) == (f"{p:05d}-{kind}.json" not in noted)
        if f"{p:05d}-links.json" in noted:
            kept = [path for path in finished if path.parent.name == f"shard-{p:05d}"]
            assert all(path.stat().st_mtime_ns == finished[path] for path in kept)
    assert (tmp_path / "network" / "manifest.json").read_text() == (whole / "manifest.json").read_text()
    assert {path.name for path in (tmp_path / "network").iterdir()} == {path.name for path in whole.iterdir()}
    assert kp.shards.certify(tmp_path / "network", tmp_path / "proof").status == "PROVED"


def interrupted(place, monkeypatch, source, count=22, **more):
    with monkeypatch.context() as patch:
        stop_after(patch, count)
        with pytest.raises(OSError, match="No space left"):
            kp.shards.write(source, place / "network", 4, **more)


@pytest.mark.parametrize("damage", ["changed", "missing", "shortened"])
def test_what_was_damaged_since_is_written_again(tmp_path, monkeypatch, damage):
    nodes, W, _ = mixed(1, n=12)
    whole = kp.shards.write((nodes, W), tmp_path / "whole", 4)
    interrupted(tmp_path, monkeypatch, (nodes, W))
    path = tmp_path / "network" / "shard-00000" / "A0.npy"
    data = path.read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(data[:-1] + bytes([data[-1] ^ 1]) if damage == "changed" else data[:-8])
    for note in (tmp_path / "network" / ".unfinished").glob("00001-*"):
        note.write_text("{")
    kp.shards.write((nodes, W), tmp_path / "network", 4, resume=True)
    assert (tmp_path / "network" / "manifest.json").read_text() == (whole / "manifest.json").read_text()
    kp.shards.check(kp.shards.certify(tmp_path / "network", tmp_path / "proof").path)


def test_another_network_is_not_continued(tmp_path, monkeypatch):
    nodes, W, _ = mixed(1, n=12)
    interrupted(tmp_path, monkeypatch, (nodes, W))
    other, V, _ = mixed(2, n=13)
    with pytest.raises(kp.DataError, match="the beginning of another network"):
        kp.shards.write((other, V), tmp_path / "network", 4, resume=True)
    with pytest.raises(kp.DataError, match="the beginning of another network"):
        kp.shards.write((nodes, W), tmp_path / "network", 4, partition=np.arange(12) % 4, resume=True)
    kp.shards.write((other, V), tmp_path / "network", 4)  # without resume, nothing of it is kept
    whole = kp.shards.write((other, V), tmp_path / "whole", 4)
    assert (tmp_path / "network" / "manifest.json").read_text() == (whole / "manifest.json").read_text()
    with pytest.raises(kp.DataError, match="holds a network already"):
        kp.shards.write((other, V), tmp_path / "network", 4, resume=True)
    with pytest.raises(kp.DataError, match="resume is 'yes'"):
        kp.shards.write((other, V), tmp_path / "again", 4, resume="yes")


def test_what_was_sorted_is_removed_after_a_fault(tmp_path, monkeypatch):
    nodes, W, _ = mixed(1, n=12)
    interrupted(tmp_path, monkeypatch, Made(nodes, W), partition=np.arange(12) % 4)
    assert not (tmp_path / "network" / ".sorting").exists()


def test_a_full_disk_while_sorting_names_the_file(tmp_path, monkeypatch):
    nodes, W, _ = mixed(1, n=12)

    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    class Full:
        def __init__(self, *arguments): ...
        def __enter__(self):
            return self

        def __exit__(self, *error): ...

        write = full

    monkeypatch.setattr(folders, "open", Full, raising=False)
    with pytest.raises(OSError, match=r"\.sorting.00000-nodes"):
        kp.shards.write(Made(nodes, W), tmp_path / "network", 4, partition=np.arange(12) % 4)


# -- numbers that no double is equal to


THIRDS = [
    kp.ConeStateSpace([["-1/3", "1/7"], [0, -2]], [["1/3"], [1]], [[1, "0.2"]], 0),
    kp.ConeStateSpace([[-2, 0], [1, -3]], [[1], [1]], [[1, 1]], [["1/9"]]),
]


def test_numbers_stay_what_they_are(tmp_path):
    nodes = [THIRDS[j % 2] for j in range(6)]
    W = [["1/100" if i != j and (i + j) % 2 else 0 for j in range(6)] for i in range(6)]
    whole = kp.feedback_interconnect(nodes, W)
    for labels in (None, [0, 1, 2, 0, 1, 2]):
        folder = kp.shards.write((nodes, W), tmp_path / f"{labels}", 3, partition=labels)
        network = ShardedNetwork.open(folder)
        for p in network.filled:
            model = network.model(p, verify=True)
            at = network.numbers(p, np.arange(model.n_nodes))
            for j, node in enumerate(at.tolist()):
                for name in "ABCD":
                    exact = getattr(nodes[node].exact, name).fractions()
                    assert (model.data_of(j)[name].fractions() == exact).all()
            fed = [network.number(int(k)) for k in network.fed(p)]
            assert (model.coupling.fractions() == whole.model.coupling[np.ix_(fed, at)].fractions()).all()
        found = kp.shards.certify(folder, folder / "proof")
        assert found.status == whole.certificate.status == "PROVED"
        assert found.decay_rate == pytest.approx(whole.certificate.decay_rate, rel=1e-9)
        assert found.check()


def test_equal_matrices_of_fractions_are_written_once(tmp_path):
    folder = written(tmp_path, kp.stack([[["-1/3"]]] * 9, [[1]], [[1]]), cycle(9) / 8, 2)
    exact = json.loads((folder / "shard-00000" / "exact-nodes.json").read_text())
    assert exact == {"A0": [[0, "-1/3"]]}
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"


@pytest.mark.parametrize("tiny", [Fraction(1, 10**400), Fraction(-1, 10**400)])
@pytest.mark.parametrize("where", ["A", "W"])
def test_the_proof_is_about_the_exact_numbers(tmp_path, tiny, where):
    """The double closest to it is 0, where a negative number breaks positivity."""
    A = [[[-1, tiny if where == "A" else 0], [0, -1]]] * 2
    W = [[0, tiny if where == "W" else 0], [0.25, 0]]
    nodes = kp.stack(A, [[1], [1]], [[1, 1]])
    found, whole = certified(tmp_path, nodes, W, 2), kp.feedback_interconnect(nodes, W).certificate
    assert whole.status == ("PROVED" if tiny > 0 else "REFUTED")
    assert found.status == whole.status
    assert found.check()


def test_a_function_may_give_fractions(tmp_path):
    class Thirds:
        n_nodes = 4

        def nodes(self, first, last):
            return kp.stack([[["-1/3"]]] * (last - first), [[1]], [[1]])

        def links(self, first, last):
            return [["1/7" if (i - j) % 4 == 1 else 0 for j in range(first, last)] for i in range(4)]

    source = Thirds()
    folder = kp.shards.write(source, tmp_path / "asked", 2)
    given = written(tmp_path, source.nodes(0, 4), source.links(0, 4), 2, "given")
    assert (folder / "manifest.json").read_text() == (given / "manifest.json").read_text()
    with pytest.raises(kp.DataError, match="a number that no double is equal to"):
        kp.shards.write(source, tmp_path / "sorted", partition=[0, 1, 0, 1])


EXACT = {"A0": [[0, "-1/3"], [2, "1/7"]]}
BAD = [
    {},
    [],
    {"Z0": [[0, "-1/3"]]},
    {"A0": []},
    {"A0": [[0, "-1/4"]]},
    {"A0": [[0, "1/3"]]},
    {"A0": [[8, "-1/3"]]},
    {"A0": [[-1, "-1/3"]]},
    {"A0": [["0", "-1/3"]]},
    {"A0": [[0, "-1/3"], [0, "-1/3"]]},
    {"A0": [[0, "-1/0"]]},
    {"A0": [[0, "a third"]]},
    {"A0": [[0]]},
    {"A0": 7},
    {"A0": [[3, "-2"]]},
    {"weights": [[0, "1/3"]]},
]


@pytest.mark.parametrize("content", BAD)
def test_exact_numbers_that_make_no_sense(tmp_path, content):
    folder = written(tmp_path, [THIRDS[0]] * 2, cycle(2) / 100, 1)
    path = folder / "shard-00000" / "exact-nodes.json"
    assert json.loads(path.read_text())["A0"][0] == [0, "-1/3"]
    entry = folders.write_text(path, content)
    forged(folder, lambda data: data["shards"][0]["exact"].update(nodes=entry), inside="")
    with pytest.raises(kp.CertificateFileError, match="shard-00000"):
        kp.shards.certify(folder, folder / "proof")


@pytest.mark.parametrize("entry", [{}, [], ["nodes"], 5, {"else": {}}, {"nodes": {}}, {"nodes": 5}, {"links": None}])
def test_manifests_of_exact_numbers_that_make_no_sense(tmp_path, entry):
    folder = written(tmp_path, [THIRDS[0]] * 2, [[0, "1/7"], ["1/7", 0]], 1)
    forged(folder, lambda data: data["shards"][0].update(exact=entry), inside="")
    with pytest.raises(kp.CertificateFileError):
        kp.shards.certify(folder, folder / "proof")


@pytest.mark.parametrize("name", ["exact-nodes.json", "exact-links.json"])
@pytest.mark.parametrize("damage", ["changed", "missing", "longer"])
def test_damaged_exact_numbers(tmp_path, name, damage):
    W = [[0, "1/7"], ["1/7", 0]]
    folder = written(tmp_path, [THIRDS[0]] * 2, W, 1)
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"
    path = folder / "shard-00000" / name
    if damage == "missing":
        path.unlink()
    else:
        text = path.read_text()
        path.write_text(text.replace("7", "9") if damage == "changed" else text + " ")
    with pytest.raises(kp.CertificateFileError, match=name.replace(".", r"\.")):
        kp.shards.check(folder / "proof")


def test_exact_numbers_that_are_left_out(tmp_path):
    """A manifest without them is about other numbers, and a certificate is about one manifest."""
    folder = written(tmp_path, [THIRDS[0]] * 2, cycle(2) / 100, 1)
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"
    forged(folder, lambda data: data["shards"][0].pop("exact"), inside="")
    with pytest.raises(kp.CertificateFileError, match="is not the network"):
        kp.shards.check(folder / "proof")
    shutil.rmtree(folder)


def test_many_links_with_fractions(tmp_path):
    n = 4000
    graph = pytest.importorskip("networkx").DiGraph()
    graph.add_nodes_from(range(n))
    graph.add_edge(0, 1, weight="1/3")
    nodes = kp.stack(-np.ones((n, 1, 1)), [[1]], [[1]])
    with pytest.raises(kp.TooLargeError):
        written(tmp_path, nodes, graph, 1)
