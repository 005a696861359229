"""Networks in shards beside the same in one process: time, CPU and memory, on one rank and on several.

    python benchmarks/bench_shards.py --nodes 1e6 --shards 8 --runs 5
    python benchmarks/bench_shards.py --nodes 1e7 --shards 40 --runs 1 --in-process 1e6

Every figure is taken in processes of its own, from after the imports to the end; medians of the runs, contenders in
turn.  Nodes are mass-spring systems on the paper's cone with three links from and to each, made part by part.
"""

import argparse
import inspect
import json
import math
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.shards import mpi

SMOKE = ["--nodes", "2000", "--shards", "4", "--runs", "1"]


class Masses:
    """Nodes j with links to a_i j + b_i modulo their number, for three numbers a_i that are prime to it."""

    def __init__(self, n):
        rng = np.random.default_rng(1)
        self.n_nodes, self.factors = n, []
        while len(self.factors) < 3:
            a, b = int(rng.integers(2, n)), int(rng.integers(n))
            if math.gcd(a, n) == 1:
                self.factors.append((a, b))

    def nodes(self, first, last):
        j = np.arange(first, last)
        k, f1, f2 = (0.5 + (j * np.sqrt(prime)) % 1.0 for prime in (2, 3, 5))
        A = np.zeros((last - first, 2, 2))
        A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -21.5 - k - f1, -14.0 - f2
        return kp.stack(A, [[0], [1]], [[1, 0]], X=kp.examples.paper_cone())

    def links(self, first, last):
        j = np.arange(first, last)
        targets = np.sort(np.stack([(a * j + b) % self.n_nodes for a, b in self.factors], axis=1), axis=1)
        places = 3 * np.arange(last - first + 1)
        shape = self.n_nodes, last - first
        out = sp.csc_array((np.ones(targets.size), targets.ravel(), places), shape=shape)
        out.sum_duplicates()
        return out


# -- one figure, in a process of its own


def in_one_piece(source):
    """Certify and check in one process."""
    nodes, W = source.nodes(0, source.n_nodes), sp.csr_array(source.links(0, source.n_nodes))
    yield
    certificate = kp.feedback_interconnect(nodes, W, progress=False).certificate
    yield certificate.decay_rate
    yield certificate.check()


def in_dask(folder, out):
    from dask.distributed import Client, LocalCluster

    with LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        yield
        yield kp.shards.certify(folder, out, client=client).decay_rate


def of_files(what, folder, out, n, parts):
    if what == "write":
        yield
        yield bool(kp.shards.write(Masses(n), folder, parts))
    elif what == "check":
        yield
        yield kp.shards.check(out).decay_rate
    else:
        comm = None
        if what == "ranks":
            comm = mpi.world()
            comm.Barrier()
        yield
        yield kp.shards.certify(folder, out, comm=comm).decay_rate


def measure(what, folder, n, parts):
    """Print wall and CPU seconds of every stage, and the peak, in all and above that after the imports."""
    if what == "ranks":
        mpi.world()
    out = folder / "proof"
    if what == "one piece":
        stages = in_one_piece(Masses(n))
    else:
        stages = in_dask(folder, out) if what == "dask" else of_files(what, folder, out, n, parts)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    next(stages)
    found = []
    while True:
        wall, cpu = time.perf_counter(), time.process_time()
        answer = next(stages, None)
        if answer is None:
            break
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        found.append(
            {
                "wall": time.perf_counter() - wall,
                "cpu": time.process_time() - cpu,
                "peak": 1024 * peak,
                "above": 1024 * (peak - before),
                "answer": float(answer),
            }
        )
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()


def asked(what, folder, n, parts, ranks=1):
    """The stages of a measurement, each with the figures of all ranks."""
    command = [sys.executable, __file__, "--one", what, "--folder", str(folder), "--nodes", str(n)]
    command += ["--shards", str(parts)]
    if what == "ranks":
        beside = Path(sys.executable).with_name("mpiexec")
        command = [str(beside if beside.exists() else "mpiexec"), "-n", str(ranks), *command]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return list(zip(*(json.loads(line) for line in done.stdout.replace("][", "]\n[").splitlines()), strict=True))


# -- the table


def largest(stage, key):
    return max(rank[key] for rank in stage)


class Table:
    """Figures of all runs by contender, and their medians."""

    def __init__(self):
        self.figures = {}

    def add(self, who, stage):
        for key in ("wall", "cpu", "peak", "above", "answer"):
            self.figures.setdefault((who, key), []).append(largest(stage, key))

    def __call__(self, who, key):
        return median(self.figures[who, key]) if (who, key) in self.figures else math.nan

    def contenders(self):
        return list(dict.fromkeys(who for who, _ in self.figures))


def compare(options, say=print):
    """Measure all contenders in turn, and print figures and ratios."""
    n, parts, table = options.nodes, options.shards, Table()
    place = Path(tempfile.mkdtemp(dir=options.folder))
    try:
        whole, half = place / "whole", place / "half"
        table.add("write", asked("write", whole, n, parts)[0])
        asked("write", half, n // 2, parts // 2)
        for _ in range(options.runs):
            stages = asked("one piece", place, options.in_process or n, parts)
            table.add("in one piece", stages[0])
            table.add("check in one piece", stages[1])
            table.add("serial", asked("serial", whole, n, parts)[0])
            table.add("check", asked("check", whole, n, parts)[0])
            table.add("half on 1 rank", asked("ranks", half, n // 2, parts // 2)[0])
            table.add("1 rank", asked("ranks", whole, n, parts)[0])
            for ranks in sorted({2, options.ranks}):
                table.add(f"{ranks} ranks", asked("ranks", whole, n, parts, ranks)[0])
            if "client" in inspect.signature(kp.shards.certify).parameters:
                table.add("Dask, 2 workers", asked("dask", whole, n, parts)[0])
    finally:
        shutil.rmtree(place)
    report(options, table, say)
    return table


def report(options, table, say):
    n, m = options.nodes, options.in_process or options.nodes
    say(f"{n} nodes in {options.shards} shards, in one piece {m}; medians of {options.runs} runs")
    say(f"{'':22s}{'wall s':>9s}{'CPU s a rank':>14s}{'peak MB a rank':>16s}{'above imports':>15s}")
    for who in table.contenders():
        figures = [table(who, key) for key in ("wall", "cpu", "peak", "above")]
        say(f"{who:22s}{figures[0]:9.2f}{figures[1]:14.2f}{figures[2] / 1e6:16.0f}{figures[3] / 1e6:15.0f}")
    scale, one, check = n / m, "in one piece", "check in one piece"

    def ratio(a, b, key, factor=1.0):
        return table(a, key) / (table(b, key) * factor) if table(b, key) else math.nan

    rows = [
        ("1 rank / in one piece, wall", ratio("1 rank", one, "wall", scale), "at most 1.25"),
        ("1 rank / in one piece, CPU", ratio("1 rank", one, "cpu", scale), "at most 1.25"),
        ("1 rank / 2 ranks, wall", ratio("1 rank", "2 ranks", "wall"), "at least 1.6"),
        ("1 rank / 2 ranks, CPU a rank", ratio("1 rank", "2 ranks", "cpu"), "at least 1.75"),
        ("weak scaling, half on 1 / all on 2", ratio("half on 1 rank", "2 ranks", "wall"), "at least 0.85"),
        ("peak a rank of 2 / in one piece", ratio("2 ranks", one, "above", scale), "at most 0.125 at 1e7"),
        ("check, shards / in one piece, CPU", ratio("check", check, "cpu", scale), "at most 1.3"),
        ("check, shards / in one piece, peak", ratio("check", check, "above", scale), "at most 0.25"),
        ("Dask / 2 ranks, wall", ratio("Dask, 2 workers", "2 ranks", "wall"), "at most 2"),
    ]
    for question, value, goal in rows:
        say(f"{question:36s}" + ("  skipped" if math.isnan(value) else f"{value:9.3f}") + f"   {goal}")


def options_of(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    whole = {"type": lambda text: int(float(text)), "metavar": "N"}
    parser.add_argument("--nodes", default=10**6, **whole)
    parser.add_argument("--shards", default=8, **whole)
    parser.add_argument("--ranks", default=2, help="also on so many", **whole)
    parser.add_argument("--runs", default=5, **whole)
    parser.add_argument("--in-process", help="nodes in one piece, if fewer", **whole)
    parser.add_argument("--folder", type=Path, help="where files go")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    return parser.parse_args(arguments)


def test_shards_beside_one_process():
    """At a size that only shows that it works: run this file as a script for figures."""
    table = compare(options_of(SMOKE))
    answers = {table(who, "answer") for who in ("in one piece", "serial", "1 rank", "2 ranks", "check")}
    assert len(answers) == 1


if __name__ == "__main__":
    chosen = options_of(None)
    if chosen.one:
        measure(chosen.one, chosen.folder, chosen.nodes, chosen.shards)
    else:
        compare(chosen)
