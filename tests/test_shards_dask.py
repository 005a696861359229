"""Networks in shards certified by the workers of a Dask cluster; one of them dies."""

import os
import signal

import numpy as np
import pytest
import random_networks
from sharded_networks import masses, written

import control_kpos as kp
from control_kpos.shards import dask_team

distributed = pytest.importorskip("distributed", reason="needs the extra dask")


@pytest.fixture(scope="module")
def client():
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as out,
    ):
        yield out


def test_rates_are_those_of_one_process(tmp_path, client):
    nodes, W = masses(seed=3, n=200)
    folder = written(tmp_path, nodes, W, 7)
    alone, found = (
        kp.shards.certify(folder, tmp_path / "alone"),
        kp.shards.certify(folder, tmp_path / "c", client=client),
    )
    assert found.status == "PROVED"
    assert np.array_equal(found.rates, alone.rates)
    assert found.check()
    assert kp.shards.check(tmp_path / "c", client.get_executor()).decay_rate == found.decay_rate
    assert not list((tmp_path / "c").glob(".*"))


def test_many_shards(tmp_path, client):
    """Dask sends large arguments on a way of their own; steps have none."""
    nodes, W = masses(seed=4, n=240)
    folder = written(tmp_path, nodes, W, 120)
    found = kp.shards.certify(folder, tmp_path / "c", client=client)
    assert found.status == "PROVED"
    assert np.array_equal(found.rates, kp.shards.certify(folder, tmp_path / "alone").rates)


def test_verdicts_of_networks_of_all_kinds(tmp_path, client):
    rng, counts = np.random.default_rng(8), {}
    for trial in range(12):
        nodes, blocks, _ = random_networks.random_network(rng)
        W = random_networks.dense_coupling(nodes, blocks) * (1 if trial % 4 else -1)
        folder = written(tmp_path, nodes, W, int(rng.integers(1, len(nodes) + 3)), f"{trial}")
        alone = kp.shards.certify(folder, tmp_path / f"alone{trial}")
        found = kp.shards.certify(folder, tmp_path / f"dask{trial}", client=client)
        assert (found.status, found.refuted, str(found.witness)) == (alone.status, alone.refuted, str(alone.witness))
        assert np.array_equal(found.rates, alone.rates)
        counts[found.status.name] = counts.get(found.status.name, 0) + 1
    assert counts.get("PROVED") and counts.get("REFUTED")


def test_a_killed_worker_is_survived(tmp_path, client):
    nodes, W = masses(seed=5, n=400)
    folder, out = written(tmp_path, nodes, W, 9), tmp_path / "c"
    killed = []

    def kill(line):
        if "storage" in line and not killed:
            pid = next(iter(client.run(os.getpid).values()))
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)

    found = kp.shards.certify(folder, out, client=client, progress=kill)
    assert killed
    assert found.status == "PROVED"
    assert np.array_equal(found.rates, kp.shards.certify(folder, tmp_path / "alone").rates)


def test_errors_of_workers_are_those_of_one_process(tmp_path, client):
    nodes, W = masses(seed=6, n=50)
    folder = written(tmp_path, nodes, W, 3)
    path = folder / "shard-00001" / "weights.npy"
    data = path.read_bytes()
    path.write_bytes(b"nothing")
    with pytest.raises(kp.CertificateFileError, match=r"shard-00001.*weights\.npy") as caught:
        kp.shards.certify(folder, tmp_path / "c", client=client)
    path.write_bytes(data)  # while the scheduler remembers the error, which is still held here
    assert kp.shards.certify(folder, tmp_path / "c", client=client) and caught.value.args


def test_a_cluster_that_gives_up_is_said_to():
    class KilledError(Exception):
        pass

    KilledError.__module__ = "distributed.scheduler"

    class Lost:
        def result(self):
            raise KilledError("worker died")

    with pytest.raises(kp.KposError, match="gave up shard 4"):
        dask_team._result(Lost(), 4)


def test_a_client_that_is_closed(tmp_path, client):
    folder = written(tmp_path, *masses(seed=6, n=10), 2)
    closed = distributed.Client(client.scheduler.address)
    closed.close()
    with pytest.raises(kp.DataError, match="client is closed"):
        kp.shards.certify(folder, tmp_path / "c", client=closed)


@pytest.mark.parametrize("client", [1, "tcp://127.0.0.1:8786", object(), []])
def test_what_is_no_client(tmp_path, client):
    nodes, W = masses(seed=6, n=10)
    with pytest.raises(kp.DataError, match=r"client is .*distributed\.Client"):
        kp.shards.certify(written(tmp_path, nodes, W, 2), tmp_path / "c", client=client)
