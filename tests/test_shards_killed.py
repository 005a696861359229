"""A write that is killed, at any moment: nothing half-written is read, and what was finished is kept."""

import subprocess
import sys
import time

import numpy as np
import pytest
from test_shards_tables import lags, pa, ring, saved

import control_kpos as kp
from control_kpos.shards.network import ShardedNetwork

SCRIPT = """
import sys
import control_kpos as kp
source = kp.shards.parquet(sys.argv[1], sys.argv[2])
print("begun", flush=True)
kp.shards.write(source, sys.argv[3], 200, partition=[j % 200 for j in range(2000)], progress=False)
"""


@pytest.mark.parametrize("wait", [0.05, 0.2, 0.5])
def test_a_killed_write_is_continued(tmp_path, wait):
    nodes, links = (saved(tmp_path / name, table) for name, table in (("nodes", lags(2000)), ("links", ring(2000))))
    labels = np.arange(2000) % 200
    folder = tmp_path / "network"
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, nodes, links, folder], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    time.sleep(wait)
    process.kill()
    process.communicate()
    source = kp.shards.parquet(nodes, links)
    if not (folder / "manifest.json").exists():
        with pytest.raises(kp.CertificateFileError, match=r"no manifest\.json"):
            ShardedNetwork.open(folder)
        kp.shards.write(source, folder, 200, partition=labels, resume=True)
    whole = kp.shards.write(source, tmp_path / "whole", 200, partition=labels)
    assert (folder / "manifest.json").read_text() == (whole / "manifest.json").read_text()
    left = {path.name for path in folder.rglob("*")} - {path.name for path in whole.rglob("*")}
    assert left <= {".unfinished"}  # killed after the manifest was written


def test_another_table_is_not_continued(tmp_path, monkeypatch):
    links = saved(tmp_path / "links", ring(6))
    source = kp.shards.parquet(saved(tmp_path / "nodes", lags(6)), links)

    def stop(self, sizes):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(type(source), "link_pieces", stop)
        with pytest.raises(KeyboardInterrupt):
            kp.shards.write(source, tmp_path / "network", 2)
    more = lags(6) | {"D": [[0.5]] * 6}
    other = kp.shards.parquet(saved(tmp_path / "nodes", pa.table(more)), links)
    with pytest.raises(kp.DataError, match="the beginning of another network"):
        kp.shards.write(other, tmp_path / "network", 2, resume=True)
    again = kp.shards.parquet(saved(tmp_path / "nodes", lags(6)), links)
    folder = kp.shards.write(again, tmp_path / "network", 2, resume=True)
    assert kp.shards.certify(folder, folder / "proof").status == "PROVED"
