"""Theorem 4 for a network in shards: a solve for r over all shards, then the proof, one shard after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from shutil import rmtree
from typing import Any, TypeVar

import numpy as np

from ..errors import DataError
from ..exact.budget import OutOfBudgetError
from ..exact.intake import folder_path, seconds
from ..exact.rounding import HALF_ULP
from ..networks.blocks import Floats
from ..networks.certificate import NetworkCertificate
from ..progress import Reporter, Target
from ..proof.certificate import Status
from . import steps
from .certificate import FORMAT, ShardedCertificate, state
from .checkpoints import Checkpoints
from .dask_team import DaskTeam, read_client
from .folders import MANIFEST, format_of
from .growth import Search
from .growth_proof import Growth
from .mpi import MpiTeam, Ranks
from .network import ShardedNetwork
from .ports import SolvePorts
from .teams import Team
from .unfinished import PLAN
from .whole import decided, fits, rates_in_one_piece, reproven, witness_in_one_piece

T = TypeVar("T")

# Accuracies of the solve that are tried in turn.
_TOLERANCES = (1e-7, 1e-11, 1e-13)
# Rounds in which r and q settle where inputs act on outputs at once.
_ROUNDS = 60
# Where files are kept in the folder of a certificate until it is written.
_ASIDE = ".unfinished"


def certify(
    folder: str | PathLike[str],
    out: str | PathLike[str],
    *,
    comm: Any = None,
    client: Any = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> ShardedCertificate:
    """Decide Theorem 4 for a network in shards, and write the certificate in shards too.

    Parameters
    ----------
    folder : path-like
        A network that `write` has written.
    out : path-like
        A folder for the certificate: v, r and q of every shard, and a manifest.  An older one in it is replaced.
    comm : mpi4py.MPI.Intracomm, optional
        Ranks that share out the shards, on machines that see the same folders.  All of them call this with the same
        arguments and get the same certificate; for PROVED it is bit for bit that of one process.
    client : distributed.Client, optional
        Its workers do the steps for the shards.  They and this process see both folders under the same names.  A step
        that was lost with its worker is done again by another one.
    time_limit : float, optional
        Seconds for the search, not counting the proof of what it has found, and what small networks take in one piece.
        It is looked at between products and shards.
    progress : callable or bool, optional
        As for `feedback_interconnect`; of many ranks the first reports.

    Returns
    -------
    ShardedCertificate
        PROVED with a decay rate; REFUTED with a node that is not positive or a link that leaves the cones;
        otherwise UNDECIDED.

    Raises
    ------
    CertificateFileError
        A file is missing, damaged or not the one that the manifest is about; it is named.
    DataError
        `out` is the folder of the network, or holds another one; `comm` is no communicator, `client` no client of
        Dask, or both are given; ranks are given different arguments.
    SolverError
        The Dask cluster lost all of its workers, or several with the same shard.
    OSError
        Files cannot be written; the file is named.

    Where one rank finds such an error, all raise it.  An error of another kind on one of them would leave the others
    waiting: run scripts by ``mpiexec -n P python -m mpi4py SCRIPT``, which ends all.

    Notes
    -----
    h = W'r, r = G'h + b, and v, q and every inequality of Theorem 4 (see `NetworkCertificate`) read the data of one
    shard, and r at the inputs that its outputs feed.  No sum is divided between shards: the network is proven if every
    shard is, and its decay rate is the smallest of theirs.
    In memory at a time: one shard, and about ten vectors of 8 bytes for every input of the network; of many ranks each
    has those of its shards, and entries at the inputs elsewhere that they feed.  The port equations are kept in files
    inside `out` until the end, 12 bytes a link.

    r is kept in files there every half a minute of the solve.  A run that was interrupted goes on from them when it is
    started again, with any number of ranks.  They are guesses: whatever they hold, nothing wrong is proven.

    Examples
    --------
    >>> import control_kpos as kp, tempfile
    >>> nodes = kp.stack([[[-3]]] * 4, B=[[1]], C=[[1]])
    >>> folder = kp.shards.write((nodes, kp.examples.ring(4)), tempfile.mkdtemp(), parts=2)
    >>> proof = kp.shards.certify(folder, folder / "proof")
    >>> proof.status.name, bool(proof.decay_rate == proof.rates.min())
    ('PROVED', True)
    """
    if comm is not None and client is not None:
        raise DataError("comm and client are given; give one of them: MPI or Dask.")
    ranks, workers = None if comm is None else Ranks(comm), None if client is None else read_client(client)
    begun = time.monotonic()
    lead, together = (True, _alone) if ranks is None else (ranks.rank == 0, ranks.same)
    limit = together(lambda: seconds(time_limit))
    if ranks is not None:
        ranks.require_alike(f"folder = {folder}, out = {out}, time_limit = {limit}")
    network, place, reporter = together(lambda: _begun(folder, out, progress, lead))
    with reporter as report, np.errstate(all="ignore"):
        about = network, place, place / _ASIDE, report
        if workers is not None:
            team: Team = DaskTeam(*about, workers)
        else:
            team = Team(*about) if ranks is None else MpiTeam(*about, ranks=ranks)
        team.deadline = np.inf if limit is None else begun + limit
        found = _Run(team).certificate()
        team.lead(lambda: rmtree(place / _ASIDE, ignore_errors=True))
    return found


def _alone(work: Callable[[], T]) -> T:
    return work()


def _begun(folder: Any, out: Any, progress: Target, lead: bool) -> tuple[ShardedNetwork, Path, Reporter]:
    """The network, and a folder for its certificate without an older one, made by who leads."""
    source, place, reporter = folder_path(folder, "folder"), folder_path(out, "out"), Reporter(progress)
    network = ShardedNetwork.open(source)
    if place.resolve() == source.resolve():
        raise DataError(f"out is {place}, the folder of the network; give another folder, such as one inside it.")
    if ((place / MANIFEST).exists() and format_of(place) != FORMAT) or (place / _ASIDE / PLAN).exists():
        raise DataError(
            f"out: {place} holds something else than a certificate in shards, such as another network, which would be "
            "lost; give another folder, or remove it first."
        )
    if lead:
        (place / _ASIDE).mkdir(parents=True, exist_ok=True)
        (place / MANIFEST).unlink(missing_ok=True)
    return network, place, reporter if lead else Reporter(False)


class _Run:
    """One certification, as every member of a team does it: what is known of all shards, and vectors of own inputs."""

    def __init__(self, team: Team) -> None:
        self.team, self.network = team, team.network
        self.b, self.direct, self.t = team.zeros(2), team.zeros(2), None
        self.kept = Checkpoints(team)
        self.ports, self.loops = SolvePorts(team, steps.PORTS), SolvePorts(team, steps.DIRECT)
        self.peak, self.finite, self.feedthrough = 0.0, True, False
        self.least = float(self.network.discrete)

    def certificate(self) -> ShardedCertificate:
        """Read every shard once; then solve and prove."""
        found = self._read()
        if found is not None:
            return found
        try:
            found, reason = self._decided()
        except OutOfBudgetError:
            found, reason = None, "the time limit ended the search"
        if found is None:
            found = self._in_one_piece()
        return self._undecided(reason) if found is None else found

    def _decided(self) -> tuple[ShardedCertificate | None, str]:
        """Vectors that prove it, or a state that grows; or why there are none."""
        if self.feedthrough and not self._loop_contracts():
            return None, "the algebraic loops of the feedthrough terms are not proven to contract"
        for tolerance in _TOLERANCES if self.finite else ():
            may_prove = self._candidate(tolerance)
            if may_prove is None:
                break
            rates = self._proof() if may_prove else None
            if rates is not None:
                return self._settled(Status.PROVED, shards=rates), ""
        search = Search(self.team, steps.PORTS, steps.DIRECT, self.least, self.t)
        shown = search.found(brief=fits(self.network))  # what is small is decided in one piece sooner
        if shown is not None:
            return self._settled(Status.REFUTED, shards=shown.shards, witness=shown.growth), ""
        if not self.finite:
            return None, "a node alone has an eigenvalue on the margin of stability, or overflows"
        return None, "no vectors that prove it and no state that grows were found, as may be close to the margin"

    def _in_one_piece(self) -> ShardedCertificate | None:
        """A network that is small enough, decided as a whole by the member that leads."""
        team = self.team
        mine: list[tuple[NetworkCertificate, dict[str, str]] | None] = []
        if not fits(self.network) or not team.in_time():
            return None
        team.report("all shards in one piece")
        team.lead(lambda: mine.append(decided(self.network, team.out)))
        done = next((found for found in mine if found is not None), None)
        entry = team.first(None if done is None else (0, done[1]))
        if entry is None:
            return None
        whole = reproven(self.network, team.out, entry[1]) if done is None else done[0]
        return self._settled(whole.status, whole=(whole, entry[1]))

    def _read(self) -> ShardedCertificate | None:
        """Keep the port equations of all shards; or the answer, if their data give one."""
        team = self.team
        witness, unproven, finite, feedthrough = None, None, True, False
        reading = team.each("reading", steps.read, self.least, until=lambda found: found.witness is not None)
        for p, found in reading:
            if found.witness is not None:
                witness = p, found.witness
                break
            own = team.own(p, 2)
            self.b[own] = found.b
            if found.direct is not None:
                feedthrough, self.direct[own] = True, found.direct
            unproven = unproven if found.proven or unproven is not None else (p, None)
            finite &= found.finite
        witness, unproven = team.first(witness), team.first(unproven)
        self.finite, self.feedthrough = team.all(finite), not team.all(not feedthrough)
        if witness is not None:
            return self._settled(Status.REFUTED, refuted=witness[0], witness=witness[1])
        if unproven is not None:
            return self._undecided(f"shard {unproven[0]} is not proven positive on its cones")
        return None

    def _loop_contracts(self) -> bool:
        """True with p and t that prove the algebraic loops to contract."""
        sums, t = self.loops.solve(self.direct, 1e-13), self.team.zeros(2)
        for p, part in self.team.each("algebraic loops", steps.weigh_loop, sees=[sums]):
            t[self.team.own(p, 2)] = part
        self.t = t
        return self.team.all(all(fine for _, fine in self.team.each("loop proof", steps.prove_loop, sees=[t])))

    # -- candidates

    def _candidate(self, tolerance: float) -> bool | None:
        """v of every shard aside, and r; False if they prove nothing, None if more accuracy will not help."""
        team = self.team
        if self.peak > 0:
            for p, part in team.each("right side", steps.even_out, self.least, self.peak):
                self.b[team.own(p, 2)] = part
        start = self.kept.start(tolerance)
        self.r = self.ports.solve(self.b, tolerance, start, lambda r: self.kept.offer(tolerance, r))
        self.kept.write(tolerance, self.r)
        missed = self.r - (self.ports @ self.r + self.b)
        raised, inside, reached, peak = self.r.copy(), True, True, 0.0
        for p, found in team.each("storage", steps.store, self.least, sees=[self.r, missed]):
            raised[team.own(p, 2)] = found.raised
            inside, reached, peak = inside and found.inside, reached and found.reached, max(peak, found.peak)
        reached, self.peak = team.all(reached), team.most(peak)
        if not team.all(inside):
            return None
        if not self.feedthrough:
            self.r = raised
        elif reached:
            self._settle_direct()
        return reached

    def _settle_direct(self) -> None:
        """r >= B'v - D'q and q <= -W'r in the orders of U* and Y*, round by round."""
        team, raised = self.team, self.r.copy()
        for count in range(_ROUNDS):
            for p, part in team.each(f"supply rates, round {count + 1},", steps.settle_direct, sees=[self.r]):
                raised[team.own(p, 2)] = part
            settled = bool((np.abs(raised - self.r) <= 4 * HALF_ULP * np.abs(raised)).all())
            self.r = raised.copy()
            if team.all(settled):
                return

    # -- the proof

    def _proof(self) -> list[dict[str, Any]] | None:
        """The rates and files of all shards, or None if one is not proven."""
        sees: list[Floats] = [self.r] if self.t is None else [self.r, self.t]
        proofs = self.team.each("proof", steps.prove, sees=sees, until=lambda entry: entry is None)
        found: dict[int, dict[str, Any]] = {p: entry for p, entry in proofs if entry is not None}
        if not self.team.all(len(found) == len(self.team.shards)):
            return None
        shards = self.team.together(found)
        entries = [shards.get(p, {}) for p in range(self.network.n_shards)]
        for name, vector in zip("rt", sees, strict=False):
            self.team.each("files", steps.confirm, name, sees=[vector])
        return entries

    def _undecided(self, reason: str) -> ShardedCertificate:
        return self._settled(Status.UNDECIDED, reason=reason)

    def _settled(
        self,
        status: Status,
        *,
        shards: list[dict[str, Any]] | None = None,
        witness: Any = None,
        refuted: int | None = None,
        reason: str = "",
        whole: tuple[NetworkCertificate, dict[str, str]] | None = None,
    ) -> ShardedCertificate:
        """The certificate, with its manifest written last."""
        shards, team = shards or [], self.team
        entries: dict[str, Any] = {"status": status.name, "refuted": refuted, "reason": reason, "shards": shards}
        if isinstance(witness, Growth):
            entries["growth"] = witness.rate.hex()
        if whole is not None:
            entries["whole"] = whole[1]
        team.lead(lambda: state(self.network, team.out, **entries))
        proven = np.zeros(0)
        if whole is not None:
            witness = witness_in_one_piece(self.network, whole[0])
            proven = rates_in_one_piece(self.network, whole[0])
        elif status is Status.PROVED:
            proven = np.array([float.fromhex(s["rate"]) if s else np.inf for s in shards])
        least = float(proven.min()) if proven.size else 0.0
        about = self.network.n_nodes, self.network.n_shards, self.network.discrete, team.out.absolute()
        return ShardedCertificate(status, least, proven, witness, refuted, reason, *about, whole=whole and whole[0])
