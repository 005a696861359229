"""Networks in shards on ranks of MPI: bit by bit what one process finds, and no rank is left waiting."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import on_ranks
import pytest
import random_networks
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from network_examples import cycle, lag, random_masses, sparse_ring
from sharded_networks import masses, written

import control_kpos as kp
from control_kpos.__main__ import main
from control_kpos.shards import checkpoints, mpi
from control_kpos.shards.certifying import certify
from control_kpos.shards.network import ShardedNetwork
from control_kpos.shards.teams import Seen, Shard

HERE = Path(__file__).parent
NEEDS_MPI = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None, reason='mpi4py is not installed: pip install "control_kpos[mpi]"'
)
RANKS = [1, 2, 3]


def launched(ranks, *command, seconds=120):
    """Run Python on ranks; it ends in time or the test fails."""
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    mpiexec = shutil.which("mpiexec", path=places)
    assert mpiexec, "mpi4py is installed, but mpiexec is not on the PATH"
    known = os.pathsep.join([str(HERE.parent), str(HERE), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [mpiexec, "-n", str(ranks), sys.executable, *map(str, command)],
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
        env=os.environ | {"PYTHONPATH": known, "OMP_NUM_THREADS": "1"},
    )


def on(ranks, what, place, *more):
    """What every rank found."""
    done = launched(ranks, HERE / "on_ranks.py", what, place, *more)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def command_line(ranks, *more, seconds=120):
    return launched(ranks, "-m", "control_kpos", "certify", *more, seconds=seconds)


# -- the same as in one process


def near_the_margin(nodes, W, gap):
    """W times a factor for which the gain of the loop is 1 - gap."""
    s = kp.feedback_interconnect(nodes, W, progress=False).model.stacks[0]
    gains = np.ravel(s.C.values @ np.linalg.solve(-s.A.values, s.B.values))
    radius = abs(spla.eigs(sp.csr_array(W @ sp.diags_array(gains)), k=1, v0=np.ones(len(gains)))[0][0])
    return W * ((1 - gap) / radius)


def grid(side):
    line = sp.diags_array([1.0, 1.0], offsets=[-1, 1], shape=(side, side))
    return sp.csr_array(sp.kronsum(line, line))


def slow(side=40, gap=1e-3):
    """A network that takes a hundred steps of BiCGSTAB."""
    nodes = random_masses(np.random.default_rng(5), side**2)
    return nodes, near_the_margin(nodes, grid(side), gap)


def mixed(seed, *, discrete=False, feedthrough=True, count=17):
    """Nodes of all sizes and cones, some with several inputs and outputs."""
    rng = np.random.default_rng(seed)
    about = {"discrete": discrete, "feedthrough": feedthrough, "damping": 0.5}
    kinds = [random_networks.random_node(rng, **about) for _ in range(4)]
    nodes = [kinds[int(k)] for k in rng.integers(0, 4, count)]
    blocks = [
        [0.004 * random_networks.positive_map(rng, b.Y, a.U, 1) if rng.random() < 0.3 else None for b in nodes]
        for a in nodes
    ]
    return nodes, random_networks.dense_coupling(nodes, blocks)


WRONG = kp.ConeStateSpace([[-2.0]], [[-1.0]], [[1.0]], 0)
NETWORKS = {
    "sweeps": (*masses(n=60), 5, "PROVED"),
    "krylov": (*slow(12), 7, "PROVED"),
    "mixed": (*mixed(1), 4, "PROVED"),
    "discrete": (*mixed(2, discrete=True), 6, "PROVED"),
    "ragged, empty shards": (*mixed(3, feedthrough=False), 30, "PROVED"),
    "one node": ([lag(2.0)], [[1.0]], 3, "PROVED"),
    "own links": ([lag(1.0)] * 6, 0.5 * cycle(6) - 0.25 * np.eye(6), 3, "PROVED"),
    "two wrong nodes": ([lag(2.0)] * 3 + [WRONG] * 2 + [lag(2.0)] * 3, cycle(8), 8, "REFUTED"),
    "wrong link": ([lag(2.0)] * 6, cycle(6) * np.sign(2.5 - np.arange(6)), 3, "REFUTED"),
    "unstable": ([lag(1.0)] * 6, 2 * cycle(6), 3, "NOT PROVED"),
    "algebraic loop": ([lag(1.0, D=1.0)] * 4, cycle(4), 2, "NOT PROVED"),
    "eigenvalue on the margin": ([lag(1.0), lag(0.0)], np.zeros((2, 2)), 2, "NOT PROVED"),
}


@pytest.fixture(scope="module")
def all_networks(tmp_path_factory):
    """Networks in files, and what one process finds."""
    place = tmp_path_factory.mktemp("networks")
    known = {}
    for name, (nodes, W, parts, status) in NETWORKS.items():
        folder = written(place, nodes, W, parts, name)
        known[name] = on_ranks.certified(folder, "alone", None)
        assert status in (known[name][0], "NOT PROVED"), name
        assert (known[name][0] == "PROVED") == (status == "PROVED"), name
    return place, known


def files_in(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@NEEDS_MPI
@pytest.mark.parametrize("ranks", RANKS)
def test_any_number_of_ranks_finds_the_same(all_networks, ranks):
    """Statuses, rates, witnesses, reasons and all files, on every rank; with fewer shards than ranks too."""
    place, known = all_networks
    found = on(ranks, "all", place)
    assert found == [known] * ranks
    for name in NETWORKS:
        assert files_in(place / name / f"on-{ranks}") == files_in(place / name / "alone"), name
        assert kp.shards.check(place / name / f"on-{ranks}").status == known[name][0]


@NEEDS_MPI
def test_the_command_line_on_ranks(tmp_path, capsys):
    """10^4 nodes: mpiexec is noticed, one answer is printed, and the status is that of the answer."""
    nodes = random_masses(np.random.default_rng(1), 10**4)
    folder = written(tmp_path, nodes, kp.examples.random_regular(10**4, 3, seed=1), 5)
    done = command_line(2, folder, "--out", folder / "ranks", "--progress")
    assert (done.returncode, done.stdout.count("PROVED")) == (0, 1), done.stderr
    assert main(["certify", str(folder), "--out", str(folder / "alone"), "--no-mpi"]) == 0
    assert capsys.readouterr().out == done.stdout
    assert files_in(folder / "ranks") == files_in(folder / "alone")


@NEEDS_MPI
def test_the_command_line_says_once_that_nothing_is_proven(tmp_path):
    folder = written(tmp_path, [lag(1.0)] * 4, 2 * cycle(4), 3)
    done = command_line(2, folder, "--out", tmp_path / "proof")
    assert done.returncode == 1
    assert done.stdout.count("network of 4 nodes") == 1


@NEEDS_MPI
def test_mpi_is_used_when_asked_for(tmp_path):
    """--mpi in a single process without a launcher, where mpi4py starts it alone."""
    folder = written(tmp_path, [lag(3.0)] * 4, cycle(4), 3)
    command = [sys.executable, "-m", "control_kpos", "certify", folder, "--out", folder / "proof", "--mpi"]
    environment = os.environ | {"PYTHONPATH": str(HERE.parent)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert "PROVED" in done.stdout


# -- errors


@NEEDS_MPI
def test_a_damaged_shard_is_named_by_all(tmp_path):
    """Each is found by one rank only; the first of several is what all raise."""
    place = tmp_path / "networks"
    for p, name in [(0, "weights"), (2, "halo"), (2, "A0"), (3, "targets")]:
        folder = written(place, *masses(), 4, f"{p}-{name}")
        for shard in {p, 3}:
            path = folder / f"shard-{shard:05d}" / f"{name}.npy"
            path.write_bytes(path.read_bytes()[:-1] + b"\x01")
    found = on(2, "all", place)
    assert found[0] == found[1]
    for name, (kind, message) in found[0].items():
        p, _, file = name.partition("-")
        assert kind == "CertificateFileError"
        assert f"shard-{int(p):05d}/{file}.npy" in message
        assert not (place / name / "on-2" / "manifest.json").exists()
    done = command_line(2, place / "3-targets", "--out", tmp_path / "proof")
    assert (done.returncode, done.stdout.count("targets.npy")) == (2, 1)


@NEEDS_MPI
def test_a_full_disk_on_one_rank_names_the_file(tmp_path):
    """First for the rows of the port equations, then for v; and a run without errors goes on from there."""
    folder = written(tmp_path, random_masses(np.random.default_rng(1), 400), sparse_ring(400), 4)
    found = on(2, "full", folder)
    assert found[0] == found[1]
    assert found[0][0][0] == found[0][1][0] == "OSError"
    assert "ports-data-00002.npy" in found[0][0][1]
    assert "v-00002.npy" in found[0][1][1]
    assert found[0][2][0] == "PROVED"


@NEEDS_MPI
def test_arguments_that_are_wrong_on_one_rank(tmp_path):
    folder = written(tmp_path, *masses(), 2)
    found = on(2, "different", folder)
    assert found[0] == found[1]
    for kind, message in found[0]:
        assert kind == "DataError"
        assert "ranks 0 and 1 are given different arguments" in message
    assert not (folder / "other").exists()


@NEEDS_MPI
def test_an_unexpected_error_ends_the_job(tmp_path):
    folder = written(tmp_path, *masses(), 4)
    done = launched(2, HERE / "on_ranks.py", "mistake", folder, 3, seconds=60)
    assert done.returncode != 0
    assert done.stderr.count("ZeroDivisionError: a mistake in the program") == 1
    assert not (folder / "proof" / "manifest.json").exists()


# -- interrupted, and started again


def interrupted(folder, ranks, at):
    """A run of which a rank is killed before a product; what is left behind."""
    done = launched(ranks, HERE / "on_ranks.py", "killed", folder, at, seconds=60)
    assert done.returncode != 0
    assert "PROVED" not in done.stdout
    assert not (folder / "proof" / "manifest.json").exists()
    return sorted((folder / "proof" / ".unfinished").glob("guess-*"))


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A network, what one process finds and how many products it takes, and what a killed run left."""
    place = tmp_path_factory.mktemp("killed")
    folder = written(place, *slow(), 5)
    first, products = on_ranks.alone(folder, "first")
    assert first[0] == "PROVED"
    assert products > 60
    assert len(interrupted(folder, 2, products * 3 // 4)) == 5
    shutil.move(folder / "proof", place / "left")
    return folder, first, products, place / "left"


@NEEDS_MPI
@pytest.mark.parametrize("ranks", [0, 3])
def test_a_killed_run_goes_on(killed, tmp_path, ranks):
    """With another number of ranks, or none, and with fewer products than from the beginning."""
    folder, _, products, left = killed
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    shutil.copytree(left, tmp_path / "proof")
    if ranks:
        *found, count = on(ranks, "again", tmp_path)[0]
    else:
        found, count = on_ranks.alone(tmp_path, "proof")
    assert found[0] == "PROVED"
    assert count < 0.7 * products
    assert not (tmp_path / "proof" / ".unfinished").exists()
    assert kp.shards.check(tmp_path / "proof").status == "PROVED"


def damaged(path, damage):
    """Make a guess useless."""
    r = np.load(path)
    if damage == "pickle":
        np.save(path, np.array([{}] * len(r), dtype=object), allow_pickle=True)
    elif damage == "zip":
        path.write_bytes(b"PK\x03\x04" + path.read_bytes()[4:])
    elif damage == "missing":
        path.unlink()
    elif damage == "empty":
        path.write_bytes(b"")
    else:
        np.save(path, {"huge": 1e300 * r, "nan": np.nan * r, "short": r[1:], "long": np.append(r, 1)}[damage])


DAMAGES = ["huge", "nan", "short", "long", "empty", "pickle", "missing", "zip", "another network"]


@NEEDS_MPI
@pytest.mark.parametrize("damage", DAMAGES)
def test_guesses_are_not_trusted(killed, tmp_path, damage):
    """What is found is found from the beginning."""
    folder, first, products, left = killed
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    shutil.copytree(left, tmp_path / "proof")
    guesses = sorted((tmp_path / "proof" / ".unfinished").glob("guess-*"))
    if damage == "another network":
        for path in guesses:
            path.rename(path.with_name("guess-" + 16 * "0" + path.name[22:]))
    else:
        damaged(guesses[2], damage)
    assert on_ranks.alone(tmp_path, "proof") == (first, products + (damage == "huge"))
    assert not (tmp_path / "proof" / ".unfinished").exists()


def test_guesses_of_one_process(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "_EVERY", 0.0)
    folder = written(tmp_path, *slow(10), 3)
    kept = []
    write = checkpoints.Checkpoints.write

    def interrupted_write(self, tolerance, r):
        write(self, tolerance, r)
        kept.append(r)
        if len(kept) == 20:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoints.Checkpoints, "write", interrupted_write)
    with pytest.raises(KeyboardInterrupt):
        certify(folder, folder / "proof")
    assert len(list((folder / "proof" / ".unfinished").glob("guess-*"))) == 3
    assert certify(folder, folder / "proof")
    assert not (folder / "proof" / ".unfinished").exists()


# -- who has what


@pytest.mark.parametrize("size", [1, 2, 3, 8, 40])
def test_shards_are_shared_out(tmp_path, size):
    nodes, W = mixed(4)
    network = ShardedNetwork.open(written(tmp_path, nodes, W, 12))
    shares = mpi.shared_out(network, size)
    assert len(shares) == size
    assert [p for share in shares for p in share] == list(network.filled)
    most = max(sum(network.data["shards"][p]["nodes"] for p in share) for share in shares)
    assert most <= network.n_nodes / size + 2  # a shard has two nodes at most


def test_no_rank_has_anything_of_all_inputs(tmp_path):
    nodes = random_masses(np.random.default_rng(0), 40)
    network = ShardedNetwork.open(written(tmp_path, nodes, cycle(40), 8))
    for share in mpi.shared_out(network, 4):
        own = slice(network.own(share[0], 2).start, network.own(share[-1], 2).stop)
        away = mpi.distinct(x[(x < own.start) | (x >= own.stop)] for x in map(network.fed, share))
        assert len(away) == 1
        seen = Seen(own, away)
        vector = np.concatenate([np.arange(own.start, own.stop), away])
        for p in share:
            shard = Shard(network, tmp_path, tmp_path, p, seen)
            shard.keep_places()
            np.testing.assert_array_equal(vector[shard.places], network.fed(p))
            assert vector[shard.inputs].tolist() == list(range(*network.own(p, 2).indices(40)))


def test_distinct_numbers_are_merged_as_they_come(monkeypatch):
    monkeypatch.setattr(mpi, "_MERGED", 3)
    rng = np.random.default_rng(0)
    parts = [np.unique(rng.integers(0, 50, 8)) for _ in range(30)]
    np.testing.assert_array_equal(mpi.distinct(parts), np.unique(np.concatenate(parts)))
    assert mpi.distinct([]).tolist() == []


# -- arguments, and what is not there


@pytest.mark.parametrize("comm", [3, "COMM_WORLD", object(), [1]])
def test_what_is_no_communicator(tmp_path, comm):
    folder = written(tmp_path, *masses(), 2)
    with pytest.raises(kp.DataError, match=r"comm is .*; give a communicator of mpi4py"):
        kp.shards.certify(folder, folder / "proof", comm=comm)
    assert not (folder / "proof").exists()


@pytest.mark.parametrize("rank", [0, 1])
def test_without_mpi4py(tmp_path, capsys, monkeypatch, rank):
    """It says once what to install; without mpiexec nothing asks for it."""
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setenv("PMI_RANK", str(rank))
    folder = written(tmp_path, *masses(), 2)
    with pytest.raises(kp.DataError, match=r'pip install "control_kpos\[mpi\]"'):
        mpi.world()
    assert main(["certify", str(folder), "--out", str(folder / "proof")]) == 2
    assert ("control_kpos[mpi]" in capsys.readouterr().out) == (rank == 0)
    assert main(["certify", str(folder), "--out", str(folder / "proof"), "--no-mpi"]) == 0
    for name in ("PMI_SIZE", "PMI_RANK"):
        monkeypatch.delenv(name)
    assert main(["certify", str(folder), "--out", str(folder / "proof")]) == 0


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, (0, 1)),
        ({"PMI_SIZE": "4", "PMI_RANK": "3"}, (3, 4)),
        ({"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "1"}, (1, 2)),
        ({"PMI_SIZE": "4"}, (0, 1)),
        ({"PMI_SIZE": "many", "PMI_RANK": "0"}, (0, 1)),
        ({"SLURM_NTASKS": "8"}, (0, 1)),  # set in the script of a job too, which is one process
    ],
)
def test_launchers(monkeypatch, variables, expected):
    for name in ("PMI_SIZE", "PMI_RANK", "OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK", "MV2_COMM_WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert mpi.launched() == expected


@NEEDS_MPI
def test_progress_is_reported_by_the_first_rank(tmp_path):
    folder = written(tmp_path, *masses(), 4)
    first, second = on(2, "progress", folder)
    assert second == []
    assert any(line.startswith("reading of shard 1 of 4") for line in first)
    assert not any("shard 3" in line for line in first)
    assert any("products, residual" in line for line in first)
