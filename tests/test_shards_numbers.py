"""Shards with their nodes in another order: which node a witness names, and files that only some readers look at."""

import shutil

import numpy as np
import pytest
from network_examples import cycle, lag
from sharded_networks import written

import control_kpos as kp

ORDER = [2, 2, 1, 1, 0, 0]


def moved(place, nodes, W, order=ORDER):
    return kp.shards.write((nodes, W), place / "network", partition=order)


def agreed(folder):
    """The witness, as certified and as checked."""
    found = kp.shards.certify(folder, folder / "proof")
    again = kp.shards.check(folder / "proof")
    assert found.status == "REFUTED" and found.explain() == again.explain() and found.check()
    return found


def test_growth_is_at_the_node_of_the_source(tmp_path):
    nodes = [lag(4.0)] * 5 + [lag(-2.0)]
    found = agreed(moved(tmp_path, nodes, 1e-4 * cycle(6)))
    assert found.witness.node == 5 and "largest at node 5." in found.explain()


def test_loops_in_one_piece_are_through_nodes_of_the_source(tmp_path):
    W = np.zeros((6, 6))
    W[4, 1] = W[1, 4] = 1.0
    found = agreed(moved(tmp_path, [lag(4.0, D=1.0)] * 6, W))
    assert found.whole is not None and found.witness.nodes.tolist() == [1, 4]


def test_damaged_numbers_name_no_node(tmp_path):
    up = kp.orthant(1)
    bad = kp.ConeStateSpace([[-4.0]], [[-1.0]], [[1.0]], 0, X=up, U=up, Y=up)
    folder = moved(tmp_path, [lag(4.0)] * 5 + [bad], cycle(6))
    assert agreed(folder).witness.node == 5
    path = folder / "shard-00000" / "numbers.npy"
    data = path.read_bytes()
    path.write_bytes(data[:-8] + bytes([3]) + data[-7:])
    for again in (lambda: kp.shards.check(folder / "proof"), lambda: kp.shards.certify(folder, folder / "proof")):
        with pytest.raises(kp.CertificateFileError, match=r"numbers\.npy is damaged"):
            again()


def test_damaged_places_of_other_shards_refute_nothing(tmp_path):
    """Which cone an input elsewhere has is read from the files of another shard."""
    up, down = kp.orthant(1), kp.PolyhedralCone([[-1.0]])
    signs = [1, 1, 1, -1, -1, 1]
    nodes = [kp.ConeStateSpace([[-4.0]], [[s]], [[1.0]], 0, X=up, U=up if s > 0 else down, Y=up) for s in signs]
    W = np.zeros((6, 6))
    for j, k in ((2, 0), (3, 1), (0, 2), (1, 3), (5, 4), (4, 5)):
        W[j, k] = signs[j]
    folder = written(tmp_path, nodes, W, 3)
    assert kp.shards.certify(folder, tmp_path / "proof")
    one, two = (folder / "shard-00001" / f"members{g}.npy" for g in (0, 1))
    data = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(data)
    for again in (lambda: kp.shards.certify(folder, tmp_path / "again"), lambda: kp.shards.check(tmp_path / "proof")):
        with pytest.raises(kp.CertificateFileError, match=r"shard-00001.members\d\.npy is damaged"):
            again()


# -- where certificates go


def test_no_other_network_is_replaced_by_a_certificate(tmp_path):
    one, other = (written(tmp_path, [lag(4.0)] * 6, cycle(6), 3, name) for name in ("one", "other"))
    with pytest.raises(kp.DataError, match="which would be lost"):
        kp.shards.certify(one, other)
    assert kp.shards.certify(other, other / "proof")
    assert kp.shards.certify(other, other / "proof")  # an older certificate is
    with pytest.raises(kp.DataError, match="holds a certificate"):
        written(other, [lag(4.0)] * 6, cycle(6), 3, "proof")
    shutil.rmtree(other / "shard-00002")
    (other / ".unfinished").mkdir()
    (other / ".unfinished" / "plan.json").write_text("{}")
    (other / "manifest.json").unlink()
    with pytest.raises(kp.DataError, match="which would be lost"):
        kp.shards.certify(one, other)


def test_relative_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kp.shards.write(([lag(4.0)] * 6, cycle(6)), "network", 3)
    monkeypatch.chdir(tmp_path / "network")
    found = kp.shards.certify(".", "proof")
    monkeypatch.chdir(tmp_path / "network" / "proof")
    again = kp.shards.check(".", network="..")
    monkeypatch.chdir(tmp_path)
    assert found.path == again.path == tmp_path / "network" / "proof"
    assert found.check() and again.check()


@pytest.mark.parametrize("data", [b"", b"nothing", None])
def test_files_aside_that_somebody_changes_are_named(tmp_path, data):
    folder = written(tmp_path, [lag(4.0)] * 6, cycle(6), 3)

    def change(line):
        if line.startswith("storage"):
            path = folder / "proof" / ".unfinished" / "places-00001.npy"
            path.write_bytes(path.read_bytes() * 2 if data is None else data)

    with pytest.raises(kp.CertificateFileError, match=r"places-00001\.npy is damaged; no other process"):
        kp.shards.certify(folder, folder / "proof", progress=change)
    assert kp.shards.certify(folder, folder / "proof")
