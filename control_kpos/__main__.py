"""Command line: the mass-spring examples of the paper, `check` for saved certificates, `certify` for shards.

The demo follows Kawano and Forni, section II (no feedback on the orthant), V.A (one node) and V.B
(a ring of nodes).
"""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from . import shards
from .cards import about, floored, raised, shown
from .cones import orthant
from .design import state_feedback
from .errors import CertificateFileError, DataError, FalseClaimError, KposError
from .examples import (
    mass_spring,
    mass_spring_node,
    paper_cone,
    paper_gain,
    ring,
)
from .networks import feedback_interconnect, stack
from .plotting import phase_portrait
from .proof.certificate import Status
from .proof.files import load_certificate, read_content
from .proof.independent import verdict
from .shards.mpi import aborting, launched, world
from .systems.statespace import ConeStateSpace
from .theorems.growing_direction import InstabilityDirection
from .theorems.positivity import state_positivity
from .theorems.stability import LyapunovCertificate, linear_lyapunov

PROVED, REFUTED, UNREADABLE = 0, 1, 2
_RING = (-13 + np.sqrt(85)) / 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        Of the demo 0 if every verdict is as expected; of `check` and `certify` 0 for PROVED, 1 for
        REFUTED, UNDECIDED or wrong, 2 for a file that cannot be read.
    """
    parser = argparse.ArgumentParser(
        prog="python -m control_kpos",
        description="Mass-spring systems that keep a cone invariant: one node, a ring of nodes, and a phase portrait.",
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("kpos-demo"),
        metavar="DIR",
        help="folder for the figure and the certificates (default: kpos-demo)",
    )
    parser.add_argument(
        "--nodes",
        type=_positive_integer,
        nargs="+",
        default=[10, 1000, 100_000],
        metavar="N",
        help="sizes of the rings (default: 10 1000 100000)",
    )
    commands = parser.add_subparsers(title="other commands", dest="command", metavar="")
    check = commands.add_parser(
        "check",
        help="check a saved certificate again",
        description="Check a saved certificate again, from its data and without any solver. "
        "Exit status: 0 proved, 1 refuted or wrong, 2 unreadable.",
    )
    check.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="a file written by certificate.save(FILE), or a folder by control_kpos.shards.certify",
    )
    check.add_argument(
        "--network",
        type=Path,
        metavar="FOLDER",
        help="of a certificate in shards: the network, if it is not where the certificate says",
    )
    certify = commands.add_parser(
        "certify",
        help="certify a network in shards on files",
        description="Decide whether a network that control_kpos.shards.write has written is positive and exponentially "
        "stable, and write the certificate. Exit status: 0 proved, 1 refuted or undecided, 2 unreadable. "
        "On many processes: mpiexec -n P python -m control_kpos certify FOLDER --out CERT.",
    )
    certify.add_argument("folder", type=Path, metavar="FOLDER", help="the network")
    certify.add_argument("--out", type=Path, metavar="CERT", required=True, help="folder for the certificate")
    certify.add_argument(
        "--mpi",
        action=argparse.BooleanOptionalAction,
        help="share the work out among the processes of MPI (default: if mpiexec has started more than one)",
    )
    certify.add_argument("--progress", action="store_true", help="report on standard error, also into a file")
    options = parser.parse_args(arguments)
    if options.command == "certify":
        return certify_shards(options.folder, options.out, options.mpi, True if options.progress else None)
    if options.command == "check":
        if options.file.is_dir():
            return of_shards(lambda: shards.check(options.file, network=options.network), _say)
        if options.network is not None:
            parser.error(f"--network belongs to certificates in shards, which are folders; {options.file} is none")
        return check_file(options.file)
    return demo(options.output, options.nodes)


def certify_shards(folder: Path, out: Path, mpi: bool | None, progress: bool | None) -> int:
    """Certify a network in shards, with other processes if there are any; the first speaks for all."""
    rank, size = launched() if mpi is None else (0, 2 * mpi)
    try:
        comm = world() if size > 1 else None
    except DataError as error:
        if rank == 0:
            _say(f"UNREADABLE {error}")
        return UNREADABLE
    speaks = comm is None or comm.rank == 0
    with aborting(comm):
        return of_shards(lambda: shards.certify(folder, out, comm=comm, progress=progress), _say if speaks else _silent)


def of_shards(found: Callable[[], shards.ShardedCertificate], say: Callable[[str], None]) -> int:
    """Say what is found of a network in shards, and return the exit status."""
    try:
        certificate = found()
    except FalseClaimError as error:
        say(f"WRONG {error}")
        return REFUTED
    except (KposError, OSError) as error:
        say(f"UNREADABLE {error}")
        return UNREADABLE
    say(f"{certificate.status.name} {certificate.explain()}")
    return PROVED if certificate else REFUTED


def check_file(path: Path) -> int:
    """Check a saved certificate twice, say what it shows, and return the exit status.

    The independent checker proves it from the proof in the file, the package from the data; both must agree.
    """
    try:
        certificate = load_certificate(path)
        independent = verdict(read_content(path))
    except FalseClaimError as error:
        _say(f"WRONG {error}")
        return REFUTED
    except (CertificateFileError, OSError) as error:
        _say(f"UNREADABLE {error}")
        return UNREADABLE
    if independent.status == "UNREADABLE":
        _say(f"UNREADABLE {path}: {independent.text}")
        return UNREADABLE
    _say(f"{certificate.status.name} {certificate.explain()}")
    _say(independent.text)
    agreed = independent.status in (certificate.status.name, "")
    return PROVED if certificate.status is Status.PROVED and agreed else REFUTED


def demo(output: Path, sizes: Sequence[int]) -> int:
    """Run the examples of the paper, print an account, and return the exit status."""
    output.mkdir(parents=True, exist_ok=True)
    as_expected = all([orthant_is_too_small(), one_node(output), rings(output, sizes)])
    print(f"\nCertificates and figure are in {output}/; check one again with")
    print(f"  python -m control_kpos check {output / 'ring.json'}")
    return PROVED if as_expected else REFUTED


def orthant_is_too_small() -> bool:
    """Section II: on the orthant, no feedback makes the mass-spring system positive and stable."""
    A, B, _, _ = mass_spring()
    _heading("1. On the orthant no feedback makes a mass on a spring positive and stable")
    print("Plant x1' = x2, x2' = -(k/m) x1 + u with k = m = 1, feedback u = F1 x1 + F2 x2.")
    none = state_feedback(ConeStateSpace(*mass_spring()))
    _say(none.explain())
    print("By hand:")
    print(f"For every F the state e1 = (1, 0) moves along (A + B F) e1 = ({A[0, 0]:g}, F1 - {-A[1, 0]:g}).")
    print(f"  positive requires F1 - {-A[1, 0]:g} >= 0, else the trajectory from e1 leaves the orthant;")
    print(f"  stable   requires F1 - {-A[1, 0]:g} <  0, else (A + B F) e1 lies in the orthant and e1 cannot decay.")
    print("Both together are impossible. For instance")
    refuted = []
    for F in ([2.0, -13.0], [1.0, -13.0], [-21.0, -13.0]):
        certificate = linear_lyapunov(A + B @ [F], orthant(2))
        refuted.append(certificate.status is Status.REFUTED)
        what = "not positive" if not certificate.positivity else "positive, not stable"
        _say(f"F = [{F[0]:g}, {F[1]:g}]: {what}; {_why(certificate)}.", indent="  ")
    return none.status is Status.REFUTED and all(refuted)


def one_node(output: Path) -> bool:
    """Section V.A: on a wider cone, F = [-21, -13] does."""
    _heading("2. On the cone generated by (0, 1) and (1, -2), F = [-21, -13] does")
    node = mass_spring_node(name="mass on a spring, u = [-21, -13] x")
    positive, stable = node.cone_positivity(), node.linear_lyapunov(rate="max")
    _say(f"Theorem 1: {positive.explain()}")
    A, B, _, _ = mass_spring()
    for change in (-1e-10, 1e-10):
        verdict = state_positivity(A + B @ (paper_gain() + [0, change]), paper_cone())
        print(f"  F2 = -13 {'-+'[change > 0]} 1e-10: {verdict.status.name}")
    _say(f"Theorem 2: {stable.explain()}")
    v = np.asarray(stable.v)
    print(f"  v = {shown(v / np.abs(v).max())}, decay rate {floored(stable.decay_rate, 10)}")
    print(f"  poles {shown(np.sort(node.poles().real))}")
    paper_v = np.array([5.09, 0.836])
    values, slopes = paper_cone().rays @ paper_v, paper_cone().rays @ node.A.T @ paper_v
    print("  The paper's v = (5.09, 0.836) is one too: on the generators")
    print(f"  v'x = {shown(values)} and v'Ax = {shown(slopes)}.")
    print(f"Theorem 3: from force to position the induced gain is {about(node.gain('L1'))}; exactly it is 1/22.")
    cplt = phase_portrait(node, pointdata=[-1, 2, -5, 5], title="Closed loop, F = [-21, -13], in its cone")
    cplt.figure.savefig(output / "phase_portrait.png", dpi=150)
    print(f"Phase portrait: {output / 'phase_portrait.png'}")
    positive.save(output / "positive.json")
    stable.save(output / "stable.json")
    return bool(positive and stable and positive.check() and stable.check())


def rings(output: Path, sizes: Sequence[int]) -> bool:
    """Section V.B: the same gain stabilises a ring of any size."""
    _heading("3. Rings of such nodes, u_j = F x_j + y_(j+1)")
    A, B, C, _ = mass_spring()
    closed = A + B @ paper_gain()
    as_expected = True
    print("     nodes  verdict  decay rate  rightmost eigenvalue, proven       seconds")
    for n_nodes in sizes:
        nodes = stack(np.broadcast_to(closed, (n_nodes, 2, 2)), B, C, X=paper_cone())
        with _progress(f"Proving a ring of {n_nodes} nodes"):
            start = time.perf_counter()
            network = feedback_interconnect(nodes, ring(n_nodes))
            certificate = network.certificate
            seconds = time.perf_counter() - start
            low, high = network.spectral_abscissa(relative=1e-9)
        print(
            f"{n_nodes:10d}  {certificate.status.name:7}  {floored(certificate.decay_rate, 7):>10}  "
            f"between {floored(low, 9)} and {raised(high, 9)}  {seconds:7.2f}"
        )
        as_expected &= bool(certificate) and certificate.check() and low <= _RING + 1e-12 and high >= _RING - 1e-12
        if n_nodes == min(sizes):
            certificate.save(output / "ring.json")
            _say(f"Theorem 4: {certificate.explain()}")
    # The ring is block-circulant: its modes are those of A + B F + w B C over the N-th roots of unity w.
    roots = np.exp(2j * np.pi * np.arange(1000) / 1000)
    computed = np.linalg.eigvals(closed + roots[:, None, None] * (B @ C)).real.max()
    print(f"Largest real part of the 2000 eigenvalues for N = 1000, computed: {computed:.6f}")
    print("  For every N it belongs to lambda^2 + 13 lambda + 22 - w = 0 at w = 1,")
    print(f"  (-13 + sqrt(85))/2, {about(_RING)}.")
    print("  The paper prints -1.48 for N = 1000; that is wrong (F = [-17, -13] would give -1.475).")
    return bool(as_expected and abs(computed - _RING) < 1e-9)


# -- printing


def _heading(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}")


def _say(text: str, indent: str = "") -> None:
    print(textwrap.fill(text, 100, initial_indent=indent, subsequent_indent=indent + "  "))


def _silent(text: str) -> None:
    """What another process says."""


def _why(certificate: LyapunovCertificate) -> str:
    """What refutes stability, with its numbers."""
    witness = certificate.witness
    return f"A x lies in X for x = {shown(witness.x)}" if isinstance(witness, InstabilityDirection) else str(witness)


@contextmanager
def _progress(what: str) -> Iterator[None]:
    """Say what is being done, and then how long it took."""
    print(f"{what} ...", end="", file=sys.stderr, flush=True)
    start = time.perf_counter()
    try:
        yield
    finally:
        print(f" {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)


def _positive_integer(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive whole number")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
