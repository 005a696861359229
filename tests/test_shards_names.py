"""Names of nodes in shards, and what certificates say by them."""

import json
import re

import numpy as np
import pytest
from network_examples import cycle, lag
from sharded_networks import written
from test_shards_files import forged

import control_kpos as kp
from control_kpos.shards import folders
from control_kpos.shards.network import ShardedNetwork

WORDS = ["Ω bus", "home 1", "home 2", 'the "main" one', "5\n", "last \ud800"]


class Named:
    """Six lags with names, made part by part; node 4 has a negative input."""

    n_nodes = 6

    def nodes(self, first, last):
        B = np.where(np.arange(first, last) == 4, -1.0, 1.0)[:, None, None]
        return kp.stack(-2 * np.ones((last - first, 1, 1)), B, [[1.0]], names=WORDS[first:last])

    def links(self, first, last):
        return cycle(6)[:, first:last]


@pytest.mark.parametrize("partition", [None, [0, 1, 0, 1, 0, 1], [1, 1, 0, 2, 0, 3]])
def test_names_follow_their_nodes(tmp_path, partition):
    made = kp.shards.write(Named(), tmp_path / "asked", 4, partition=partition)
    given = kp.shards.write((Named().nodes(0, 6), cycle(6)), tmp_path / "given", 4, partition=partition)
    assert (made / "manifest.json").read_text() == (given / "manifest.json").read_text()
    network = ShardedNetwork.open(made)
    assert [network.name(j) for j in range(6)] == [*WORDS[:5], "last ?"]
    proof = kp.shards.certify(made, made / "proof")
    assert proof.status == "REFUTED"
    assert '(node 4 is "5\n"). ' in proof.explain()
    (made / "manifest.json").unlink()
    assert 'node 4 is "5' not in proof.explain()


def test_links_are_named_by_both_ends(tmp_path):
    nodes = [lag(1.0, name=f"n{j}") for j in range(4)]
    W = cycle(4) / 2
    W[2, 0] = -1
    folder = written(tmp_path, nodes, W, 2)
    assert 'node 2 is "n2", node 0 is "n0"' in kp.shards.certify(folder, folder / "proof").explain()


def test_only_some_nodes_have_names(tmp_path):
    nodes = [lag(1.0, name="first"), kp.ConeStateSpace(-np.eye(2), [[-1], [1]], [[1, 1]], 0), lag(1.0)]
    folder = written(tmp_path, nodes, np.zeros((3, 3)), 2)
    assert json.loads((folder / "shard-00000" / "names.json").read_text()) == ["first"]
    assert "names" not in ShardedNetwork.open(folder).data["shards"][1]["files"]
    explained = kp.shards.certify(folder, folder / "proof").explain()
    assert "node 1 is not positive" in explained
    assert "node 1 is" not in re.sub("node 1 is not", "", explained)


def test_the_labels_of_a_graph_are_names(tmp_path):
    networkx = pytest.importorskip("networkx")
    graph = networkx.DiGraph([("a", "b", {"weight": 0.5}), ("b", "c", {"weight": -0.5})])
    folder = written(tmp_path, [lag(1.0)] * 3, graph, 2)
    assert 'node 2 is "c", node 1 is "b"' in kp.shards.certify(folder, folder / "proof").explain()


def test_names_in_tables(tmp_path):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = {"A": [[-2.0]] * 6, "B": [[1.0]] * 4 + [[-1.0], [1.0]], "C": [[1.0]] * 6}
    pq.write_table(pa.table(table | {"name": WORDS[:5] + ["last"], "node": [5, 3, 1, 0, 2, 4]}), tmp_path / "nodes")
    pq.write_table(pa.table({"source": [0], "target": [1], "weight": [0.5]}), tmp_path / "links")
    source = kp.shards.parquet(tmp_path / "nodes", tmp_path / "links")
    folder = kp.shards.write(source, tmp_path / "network", 2)
    network = ShardedNetwork.open(folder)
    assert [network.name(j) for j in (5, 3, 1, 0, 2, 4)] == [*WORDS[:5], "last"]
    assert 'node 2 is "5\n"' in kp.shards.certify(folder, folder / "proof").explain()
    pq.write_table(pa.table(table | {"name": [1] * 6}), tmp_path / "nodes")
    with pytest.raises(kp.DataError, match="column 'name' holds int64; give text"):
        kp.shards.write(kp.shards.parquet(tmp_path / "nodes", tmp_path / "links"), tmp_path / "other")


@pytest.mark.parametrize("content", [[], ["a"] * 5, [1] * 6, {"a": 1}, "names"])
def test_damaged_names_change_no_verdict(tmp_path, content):
    folder = kp.shards.write(Named(), tmp_path / "network", 1)
    entry = folders.write_text(folder / "shard-00000" / "names.json", content)
    forged(folder, lambda data: data["shards"][0]["files"].update(names=entry), inside="")
    proof = kp.shards.certify(folder, folder / "proof")
    assert proof.status == "REFUTED"
    assert "node 4 is not positive" in proof.explain()
    with pytest.raises(kp.CertificateFileError, match=r"names\.json is damaged"):
        ShardedNetwork.open(folder).name(4)


def test_an_interrupted_write_keeps_names(tmp_path, monkeypatch):
    whole = kp.shards.write(Named(), tmp_path / "whole", 3)

    class Interrupted(Named):
        def links(self, first, last):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kp.shards.write(Interrupted(), tmp_path / "network", 3)
    (tmp_path / "network" / "shard-00001" / "names.json").write_text("[]")
    folder = kp.shards.write(Named(), tmp_path / "network", 3, resume=True)
    assert (folder / "manifest.json").read_text() == (whole / "manifest.json").read_text()
    assert ShardedNetwork.open(folder).name(3) == WORDS[3]
