"""What is known of a network in shards: the verdict, its files, and the proof of a shard."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike, path
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import floored
from ..errors import CertificateFileError, DataError, FalseClaimError
from ..exact.condition import all_hold
from ..exact.intake import folder_path, found
from ..exact.matrix import Matrix
from ..networks.blocks import Floats
from ..networks.certificate import REMEDY, NetworkCertificate, decreasing
from ..networks.certify import at_own_link, violation
from ..networks.model import NetworkModel
from ..networks.own_links import own_links_closed
from ..networks.witnesses import (
    AlgebraicLoop,
    CouplingViolation,
    NetworkInstability,
    NodeViolation,
    kept_parts,
    positive_parts,
)
from ..progress import Reporter, Target
from ..proof.certificate import Status
from ..proof.files import digest
from .folders import MANIFEST, read_array, read_manifest, shard_folder, write_manifest
from .growth_proof import VECTORS as GROWING
from .growth_proof import Growth, Part, heard, is_growing, senders, stated_rate, together
from .network import ShardedNetwork, limited_work, stated_double
from .whole import rates_in_one_piece, reproven, witness_in_one_piece

FORMAT = "kpos-shards-certificate/1"
VECTORS = ("v", "r", "q")
WEIGHTS = ("p", "t")
_DATA = {"network", "status", "refuted", "reason", "shards"}
# What manifests of some certificates have besides.
_MORE = {"growth", "whole"}
_REMEDY = {**REMEDY, Growth: REMEDY[NetworkInstability]}


@dataclass(frozen=True, eq=False)
class ShardedCertificate:
    """Whether a network in shards is positive and exponentially stable by Theorem 4; `bool` of it is True for PROVED.

    Attributes
    ----------
    status : Status
        PROVED, REFUTED or UNDECIDED, for the exact value of the doubles in the files.
    decay_rate : float
        Proven: V(x(t)) <= exp(-decay_rate t) V(x(0)) for V(x) = sum v_j'x_j; (1 - decay_rate) to the power of the
        steps in discrete time.  The smallest of `rates`.
    rates : ndarray
        The rate that every shard proves for its nodes; inf where there are none.  Empty without a proof.
    witness : CouplingViolation, NodeViolation, Growth, NetworkInstability, AlgebraicLoop or None
        For REFUTED: the link or the node that breaks Theorem 4, numbered in the whole network, or a state that grows;
        also an algebraic loop that does not contract, in small networks.
    refuted : int or None
        The shard in which a link or node is.
    reason : str
        For UNDECIDED: what was tried.
    n_nodes, n_shards : int
    discrete : bool
        True in discrete time.
    path : Path
        The folder of the certificate.
    whole : NetworkCertificate or None
        Of a small network that shards left open: the certificate of all shards in one piece, which numbers nodes as
        they follow each other in the shards.
    network : Path or None
        The folder of the network, if it may be elsewhere than the certificate says.
    """

    status: Status
    decay_rate: float
    rates: NDArray[np.float64]
    witness: CouplingViolation | NodeViolation | Growth | NetworkInstability | AlgebraicLoop | None
    refuted: int | None
    reason: str
    n_nodes: int
    n_shards: int
    discrete: bool
    path: Path
    whole: NetworkCertificate | None = None
    network: Path | None = None

    def __bool__(self) -> bool:
        return bool(self.status)

    def check(self) -> bool:
        """Prove every shard again from its files; False if something was changed.

        Returns
        -------
        bool
            True if the files prove `status` and `decay_rate`.
        """
        try:
            now = check(self.path, network=self.network)
        except (CertificateFileError, OSError):
            return False
        mine, proven = ((c.status, c.decay_rate, c.refuted, f"{c.witness}") for c in (self, now))
        return proven == mine

    def explain(self) -> str:
        """A few sentences a person can act on."""
        what = f"the network of {self.n_nodes} nodes in {self.n_shards} shards"
        if self.status is Status.PROVED:
            rate, unit = floored(self.decay_rate, 4), "step" if self.discrete else "unit of time"
            return f"Proved: {what} is positive and exponentially stable with decay rate at least {rate} per {unit}."
        if self.status is Status.REFUTED:
            place = "" if self.refuted is None else f" in shard {self.refuted}"
            return f"Not certified: {what} fails{place}, {self._reason()}. {_REMEDY[type(self.witness)]}"
        return f"Undecided: for {what} nothing is proven: {self.reason}."

    def _reason(self) -> str:
        """The witness, with the names of its nodes if the files have them."""
        steps = isinstance(self.witness, NetworkInstability) and self.discrete
        text = f"{self.witness}".replace("growth rate", "growth factor per step") if steps else f"{self.witness}"
        nodes = [getattr(self.witness, end) for end in ("node", "target", "source") if hasattr(self.witness, end)]
        try:
            network = SavedCertificate.open(self.path, self.network).network
            known = {j: name for j in nodes if (name := network.name(j))}
        except (CertificateFileError, OSError):
            known = {}
        names = [f'node {j} is "{name}"' for j, name in known.items()]
        return f"{text} ({', '.join(names)})" if names else text

    def __repr__(self) -> str:
        return f"<ShardedCertificate: {self.status.name}, {self.n_nodes} nodes in {self.n_shards} shards>"


# -- the proof of a shard


def positive_form(network: ShardedNetwork, p: int, model: NetworkModel) -> tuple[NetworkModel, Any, bool]:
    """A shard that is positive on its cones, or what breaks it, and whether either is proven.

    Links of nodes to themselves are closed as a part of these nodes where they break it as they are.
    """
    with kept_parts(model):
        found = violation(model)
        if found is None:
            return model, None, all_hold(positive_parts(model))
    closed = own_links_closed(model) if at_own_link(model, found.witness) else None
    if closed is not None:
        return positive_form(network, p, closed)
    return model, _renumbered(network, p, found.witness), bool(found.status is Status.REFUTED)


def _renumbered(network: ShardedNetwork, p: int, witness: Any) -> Any:
    """A witness in a shard with the numbers of its nodes in the source of the network."""
    own = network.own(p, 0)
    if isinstance(witness, NodeViolation):
        return replace(witness, node=network.number(own.start + witness.node))
    count, target = own.stop - own.start, witness.target
    target = own.start + target if target < count else int(network.halo(p)[target - count])
    return replace(witness, target=network.number(target), source=network.number(own.start + witness.source))


def is_proven(model: NetworkModel, vectors: Sequence[Floats], rate: float, loop: Sequence[Floats] | None) -> bool:
    """(II) and (III') of a positive shard by the kernel; v, r, q and p, t, where r and t include the halo."""
    v, r, q = map(Matrix, vectors)
    weights = None if loop is None else (Matrix(loop[0]), Matrix(loop[1]))
    return all_hold(decreasing(model, v, r, q, rate, weights))


# -- its files


def state(network: ShardedNetwork, out: Path, **data: Any) -> None:
    """Write the manifest of a certificate."""
    place = path.relpath(network.folder.resolve(), out.resolve())
    about = {"folder": place, "digest": digest(network.data)}
    empty = {"status": "UNDECIDED", "refuted": None, "reason": "", "shards": []}
    write_manifest(out, FORMAT, {"network": about, **empty, **data})


def check(
    out: str | PathLike[str],
    executor: Executor | None = None,
    *,
    network: str | PathLike[str] | None = None,
    progress: Target = None,
) -> ShardedCertificate:
    """Prove a certificate in shards again, one shard at a time, without any solver.

    Parameters
    ----------
    out : path-like
        The folder that `certify` wrote.  It names the folder of the network, as seen from there.
    executor : concurrent.futures.Executor, optional
        Proves the shards through its ``map``, in any order and in other processes; serially if not given.
    network : path-like, optional
        The folder of the network, if it is not where the certificate says.
    progress : callable or bool, optional
        As for `feedback_interconnect`.

    Returns
    -------
    ShardedCertificate
        With the status that the files prove.

    Raises
    ------
    CertificateFileError
        A file is missing, damaged or not the one that the manifests are about; it is named.  Or cones and sizes in
        the manifests ask for more work or memory than certificates of this size need.
    FalseClaimError
        A shard that does not prove what the certificate states of it.

    Notes
    -----
    Needs the memory of one shard for each that is proven at a time, with r of the nodes that it feeds.

    Examples
    --------
    >>> import control_kpos as kp, tempfile
    >>> nodes = kp.stack([[[-3]]] * 4, B=[[1]], C=[[1]])
    >>> folder = kp.shards.write((nodes, kp.examples.ring(4)), tempfile.mkdtemp(), parts=2)
    >>> kp.shards.certify(folder, folder / "proof").decay_rate > 1
    True
    >>> kp.shards.check(folder / "proof").status.name
    'PROVED'
    """
    place = folder_path(out, "out")
    if not isinstance(executor, Executor | None):
        raise DataError(f"executor is {found(executor)}; give an executor of concurrent.futures, or None.")
    given = None if network is None else folder_path(network, "network")
    with Reporter(progress) as report, np.errstate(all="ignore"), limited_work():
        return SavedCertificate.open(place, given).proven(executor, report)


@dataclass(frozen=True, eq=False)
class SavedCertificate:
    """A certificate in files.

    Attributes
    ----------
    out : Path
    data : dict
        What its manifest states.
    network : ShardedNetwork
    """

    out: Path
    data: dict[str, Any]
    network: ShardedNetwork

    @classmethod
    def open(cls, out: Path, moved: Path | None = None) -> SavedCertificate:
        """The certificate in a folder, and the network that it is about, which may have been moved.

        Raises
        ------
        CertificateFileError
            A manifest is missing or damaged, or the network is another one.
        """
        data = read_manifest(out, FORMAT)
        try:
            about = data["shards"]
            sensible = (
                _DATA <= set(data) <= _DATA | _MORE
                and data["status"] in Status.__members__
                and isinstance(data["reason"], str)
            )
            if not sensible or not (isinstance(about, list) and all(isinstance(shard, dict) for shard in about)):
                raise CertificateFileError("it has other entries.")
            folder = out / data["network"]["folder"] if moved is None else moved
            if not (folder / MANIFEST).exists():
                raise CertificateFileError(
                    f"{folder} has no {MANIFEST}, but the network that the certificate in {out} is about should be "
                    "there. If it was moved, give its folder: check(out, network=FOLDER), or --network FOLDER."
                )
            network = ShardedNetwork.open(folder, bounded=True)
            same = digest(network.data) == data["network"]["digest"]
        except (KeyError, TypeError) as error:
            raise CertificateFileError(f"the manifest of {out} describes no certificate: {error}") from None
        if not same:
            raise CertificateFileError(f"{network.folder} is not the network that the certificate in {out} is about.")
        certificate = cls(out, data, network)
        more, status = _MORE & set(data), data["status"]
        listed = "growth" in more or (not more and status == "PROVED")
        if listed and len(data["shards"]) != network.n_shards:
            raise CertificateFileError(f"{out} is about {len(data['shards'])} shards; there are {network.n_shards}.")
        sound = certificate._has_its_entries() if listed else not data["shards"]
        sound &= len(more) < 2 and ("growth" not in more or status == "REFUTED")
        if not sound or (data["refuted"] is not None and (more or status != "REFUTED")):
            raise CertificateFileError(f"the manifest of {out} has other entries.")
        return certificate

    def _has_its_entries(self) -> bool:
        """True if every shard with nodes has its vectors, for a proof a rate, and nothing else; others have nothing."""
        vectors, entries = (GROWING, {"files"}) if "growth" in self.data else (VECTORS, {"rate", "files"})
        names = {*vectors, *(WEIGHTS if self.has_weights else ())}
        return all(
            set(shard) == entries and isinstance(shard["files"], dict) and set(shard["files"]) == names
            if count
            else not shard
            for shard, count in zip(self.data["shards"], np.diff(self.network.starts[0]).tolist(), strict=True)
        )

    def rate(self, p: int) -> float:
        """The decay rate that is stated for a shard."""
        try:
            return stated_double(self.data["shards"][p]["rate"])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise CertificateFileError(f"the manifest of {self.out} states no rate of shard {p}.") from None

    def vector(self, p: int, name: str, *, verify: bool = False) -> Floats:
        """v, r, q, p or t of a shard, or x, u, y or z, mapped."""
        files, file = self.data["shards"][p].get("files"), f"{name}.npy"
        entry = files.get(name) if isinstance(files, dict) else None
        array = read_array(shard_folder(self.out, p) / file, entry, verify=verify)
        if name == "z":
            size = int(self.network.receivers(self.network.halo(p))[2].sum())
        else:
            own = self.network.own(p, {"v": 1, "r": 2, "q": 3, "p": 3, "t": 2, "x": 1, "u": 2, "y": 3}[name])
            size = own.stop - own.start
        if array.shape != (size,) or array.dtype != float:
            raise CertificateFileError(f"{shard_folder(self.out, p) / file} has not the size of its shard.")
        return array

    @property
    def has_weights(self) -> bool:
        """True if there are p and t for algebraic loops."""
        return any(isinstance(s.get("files"), dict) and "p" in s["files"] for s in self.data["shards"])

    def at_fed(self, p: int, name: str) -> Floats:
        """r or t at the inputs that a shard feeds, those of others out of their files."""
        places, starts = self.network.fed(p), self.network.starts[2]
        own = self.network.own(p, 2)
        out = np.empty(len(places))
        out[: own.stop - own.start] = self.vector(p, name)
        away, cut = places[own.stop - own.start :], own.stop - own.start
        cuts = np.searchsorted(away, starts)
        for k in np.flatnonzero(np.diff(cuts)).tolist():
            part = slice(cuts[k], cuts[k + 1])
            out[cut + part.start : cut + part.stop] = self.vector(k, name)[away[part] - starts[k]]
        return out

    def proven(self, executor: Any, report: Any) -> ShardedCertificate:
        """The status, proven anew.

        Raises
        ------
        FalseClaimError
            It is not the one stated.
        """
        network, status = self.network, Status[self.data["status"]]
        rates, witness, refuted, whole = np.zeros(0), None, None, None
        if "whole" in self.data:
            whole = reproven(network, self.out, self.data["whole"])
            if whole.status is not status:
                raise FalseClaimError(
                    f"{self.out} says {status.name}, but its file in one piece proves {whole.status.name}."
                )
            witness, rates = witness_in_one_piece(network, whole), rates_in_one_piece(network, whole)
        elif status is Status.PROVED:
            rates = np.full(network.n_shards, np.inf)
            for p, rate in self._each(("r", "t"), "prove", executor, report):
                rates[p] = rate
        elif "growth" in self.data:
            witness = self._growth(executor, report)
        elif status is Status.REFUTED:
            refuted = self.data["refuted"]
            if type(refuted) is not int or refuted not in list(network.filled):
                raise CertificateFileError(f"the manifest of {self.out} names no shard that is refuted.")
            _, witness, is_shown = positive_form(network, refuted, network.model(refuted, verify=True))
            if witness is None or not is_shown:
                raise FalseClaimError(f"{self.out} says REFUTED, but no node or link of shard {refuted} shows it.")
        least = float(rates.min()) if rates.size else 0.0
        about = network.n_nodes, network.n_shards, network.discrete, self.out.absolute()
        return ShardedCertificate(
            status, least, rates, witness, refuted, self.data["reason"], *about, whole, network.folder.absolute()
        )

    def _each(
        self, shared: Sequence[str], method: str, executor: Any, report: Any, *given: Mapping[int, Any]
    ) -> Iterator[tuple[int, Any]]:
        """What a method proves of every shard; others read the vectors that are `shared`: digests come first."""
        shards = list(self.network.filled)
        for p in shards:
            for name in shared:
                if name != "t" or self.has_weights:
                    self.vector(p, name, verify=True)
        each = [shards, *([part[p] for p in shards] for part in given)]
        task = partial(_prove, self.out, self.network.folder, method)
        proofs = map(getattr(self, method), *each) if executor is None else executor.map(task, *each)
        for count, proof in enumerate(proofs, 1):
            report(f"proven: {count} of {len(shards)} shards")
            yield proof

    def _growth(self, executor: Any, report: Any) -> Growth:
        """The state that grows, proven anew."""
        rate = stated_rate(self.data["growth"], self.network, self.out)
        parts = dict(self._each(("z", "t"), "prove_growth", executor, report, senders(self.network, verify=True)))
        found = together(parts, rate, self.network)
        if found is None:
            raise FalseClaimError(f"{self.out} says REFUTED, but the state that is to grow is 0.")
        return found

    def prove_growth(self, p: int, feeding: Sequence[int]) -> tuple[int, Part]:
        """The number of a shard, and its part of the state, proven; `feeding` are the shards that feed it."""
        model, witness, positive = positive_form(self.network, p, self.network.model(p, verify=True))
        loops, rate = self.has_weights, stated_rate(self.data["growth"], self.network, self.out)
        x, u, y, z = (self.vector(p, name, verify=name != "z") for name in GROWING)
        loop = [self.vector(p, "p", verify=True), self.at_fed(p, "t")] if loops else None
        received = heard(self.network, p, feeding, lambda s: self.vector(s, "z"))
        if witness is not None or not (
            positive and (loops or not model.has_feedthrough) and is_growing(model, (x, u, y, z), rate, received, loop)
        ):
            raise FalseClaimError(f"{self.out} says REFUTED, but shard {p} does not show that the state grows.")
        return p, Part.of(self.network, p, model, x)

    def prove(self, p: int) -> tuple[int, float]:
        """The number of a shard and the rate that it proves."""
        model, witness, positive = positive_form(self.network, p, self.network.model(p, verify=True))
        loops, rate = self.has_weights, self.rate(p)
        vectors = [self.vector(p, name, verify=name != "r") for name in VECTORS]
        vectors[1] = self.at_fed(p, "r")
        loop = [self.vector(p, "p", verify=True), self.at_fed(p, "t")] if loops else None
        whole = all(np.isfinite(part).all() for part in (*vectors, *(loop or ())))
        whole &= loops or not model.has_feedthrough
        if witness is not None or not (positive and whole and is_proven(model, vectors, rate, loop)):
            raise FalseClaimError(f"{self.out} says PROVED, but shard {p} is not proven by its vectors.")
        return p, rate


@np.errstate(all="ignore")
def _prove(out: Path, network: Path, method: str, p: int, *given: Any) -> tuple[int, Any]:
    """The same from the files, for any process."""
    with limited_work():
        return getattr(SavedCertificate.open(out, network), method)(p, *given)
