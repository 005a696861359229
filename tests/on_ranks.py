"""What every rank of MPI does in test_shards_mpi.py: ``mpiexec -n P python on_ranks.py WHAT PLACE [NUMBER]``.

The first prints what all of them found as a line of JSON.
"""

import json
import os
import resource
import signal
import sys
from pathlib import Path

import control_kpos as kp
from control_kpos.__main__ import main
from control_kpos.shards import checkpoints, steps
from control_kpos.shards.ports import SolvePorts

PRODUCTS = [0]


def described(found):
    """What a certificate says, bit by bit."""
    witness = None if found.witness is None else repr(sorted(vars(found.witness).items()))
    rates = [rate.hex() for rate in found.rates.tolist()]
    return [found.status.name, found.decay_rate.hex(), rates, witness, found.refuted, found.reason]


def networks(place):
    return sorted(path.parent for path in place.glob("*/manifest.json"))


def certified(folder, out, comm):
    """What is found, or the error."""
    PRODUCTS[0] = 0
    try:
        place = folder / out if isinstance(folder, Path) else out
        return described(kp.shards.certify(folder, place, comm=comm, progress=False))
    except (kp.KposError, OSError) as error:
        return [type(error).__name__, str(error)]


def counted(die_at=None):
    """Count the products of all shards with a vector; the process that calls this ends before that one."""
    product = SolvePorts.__matmul__

    def counting(self, r):
        PRODUCTS[0] += 1
        if PRODUCTS[0] == die_at:
            os.kill(os.getpid(), signal.SIGKILL)
        return product(self, r)

    SolvePorts.__matmul__ = counting


def failing(number):
    """A proof that fails with an error that nobody expects."""
    prove = steps.prove

    def broken(shard, *given):
        if shard.p == number:
            raise ZeroDivisionError("a mistake in the program")
        return prove(shard, *given)

    steps.prove = broken


def run(what, place, number):
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    last = comm.rank == comm.size - 1
    if what == "all":
        out = {folder.name: certified(folder, f"on-{comm.size}", comm) for folder in networks(place)}
    elif what == "again":
        counted()
        out = [*certified(place, "proof", comm), PRODUCTS[0]]
    elif what == "killed":
        checkpoints._EVERY = 0.0
        counted(number if last else None)
        out = certified(place, "proof", comm)
    elif what == "full":
        out = []
        for most in (800, 1500, -1):  # bytes, as if the disk were full: no file may be longer
            resource.setrlimit(resource.RLIMIT_FSIZE, (most if last else -1, -1))
            out.append(certified(place, "proof", comm))
    elif what == "progress":
        lines = []
        kp.shards.certify(place, place / "proof", comm=comm, progress=lines.append)
        out = lines
    elif what == "different":  # arguments that are wrong on one rank only
        out = [certified(place, "proof" if last else "other", comm), certified(place if last else 3, "proof", comm)]
    else:  # the command line, with a mistake in the program
        failing(number)
        sys.exit(main(["certify", str(place), "--out", str(place / "proof")]))
    everything = comm.gather(out)
    if comm.rank == 0:
        print(json.dumps(everything))


def alone(place, out):
    """The same by one process without MPI, and the number of products."""
    before = SolvePorts.__matmul__
    counted()
    try:
        return certified(place, out, None), PRODUCTS[0]
    finally:
        SolvePorts.__matmul__ = before


if __name__ == "__main__":
    run(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else None)
