"""What is known of a network in shards: the verdict, its files, and the proof of a shard."""

from __future__ import annotations

from collections.abc import Sequence
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
from ..exact.intake import file_path, found
from ..exact.matrix import Matrix
from ..networks.blocks import Floats
from ..networks.certificate import REMEDY, decreasing
from ..networks.certify import at_own_link, violation
from ..networks.model import NetworkModel
from ..networks.own_links import own_links_closed
from ..networks.witnesses import CouplingViolation, NodeViolation, kept_parts, positive_parts
from ..progress import Reporter, Target
from ..proof.certificate import Status
from ..proof.files import digest
from .folders import read_array, read_manifest, shard_folder, write_manifest
from .network import ShardedNetwork

FORMAT = "kpos-shards-certificate/1"
VECTORS = ("v", "r", "q")
WEIGHTS = ("p", "t")
_DATA = {"network", "status", "refuted", "reason", "shards"}


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
    witness : CouplingViolation, NodeViolation or None
        For REFUTED: the link or the node that breaks Theorem 4, numbered in the whole network.
    refuted : int or None
        The shard in which it is.
    reason : str
        For UNDECIDED: what was tried.
    n_nodes, n_shards : int
    discrete : bool
        True in discrete time.
    path : Path
        The folder of the certificate.
    """

    status: Status
    decay_rate: float
    rates: NDArray[np.float64]
    witness: CouplingViolation | NodeViolation | None
    refuted: int | None
    reason: str
    n_nodes: int
    n_shards: int
    discrete: bool
    path: Path

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
            now = check(self.path)
        except (CertificateFileError, OSError):
            return False
        return (now.status, now.decay_rate, now.refuted) == (self.status, self.decay_rate, self.refuted)

    def explain(self) -> str:
        """A few sentences a person can act on."""
        what = f"the network of {self.n_nodes} nodes in {self.n_shards} shards"
        if self.status is Status.PROVED:
            rate, unit = floored(self.decay_rate, 4), "step" if self.discrete else "unit of time"
            return f"Proved: {what} is positive and exponentially stable with decay rate at least {rate} per {unit}."
        if self.status is Status.REFUTED:
            return f"Not certified: {what} fails in shard {self.refuted}, {self.witness}. {REMEDY[type(self.witness)]}"
        return f"Undecided: for {what} nothing is proven: {self.reason}."

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
    """A witness in a shard with the numbers of its nodes in the whole network."""
    own = network.own(p, 0)
    if isinstance(witness, NodeViolation):
        return replace(witness, node=own.start + witness.node)
    count, target = own.stop - own.start, witness.target
    target = own.start + target if target < count else int(network.halo(p)[target - count])
    return replace(witness, target=target, source=own.start + witness.source)


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


def check(out: str | PathLike[str], executor: Executor | None = None, *, progress: Target = None) -> ShardedCertificate:
    """Prove a certificate in shards again, one shard at a time, without any solver.

    Parameters
    ----------
    out : path-like
        The folder that `certify` wrote.  It names the folder of the network, as seen from there.
    executor : concurrent.futures.Executor, optional
        Proves the shards through its ``map``, in any order and in other processes; serially if not given.
    progress : callable or bool, optional
        As for `feedback_interconnect`.

    Returns
    -------
    ShardedCertificate
        With the status that the files prove.

    Raises
    ------
    CertificateFileError
        A file is missing, damaged or not the one that the manifests are about; it is named.
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
    place = file_path(out, "out")
    if not isinstance(executor, Executor | None):
        raise DataError(f"executor is {found(executor)}; give an executor of concurrent.futures, or None.")
    certificate = SavedCertificate.open(place)
    with Reporter(progress) as report, np.errstate(all="ignore"):
        return certificate.proven(executor, report)


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
    def open(cls, out: Path) -> SavedCertificate:
        """The certificate in a folder, and the network that it is about.

        Raises
        ------
        CertificateFileError
            A manifest is missing or damaged, or the network is another one.
        """
        data = read_manifest(out, FORMAT)
        try:
            about = data["shards"]
            sensible = set(data) == _DATA and data["status"] in Status.__members__ and isinstance(data["reason"], str)
            if not sensible or not (isinstance(about, list) and all(isinstance(shard, dict) for shard in about)):
                raise CertificateFileError("it has other entries.")
            network = ShardedNetwork.open(out / data["network"]["folder"])
            same = digest(network.data) == data["network"]["digest"]
        except (KeyError, TypeError) as error:
            raise CertificateFileError(f"the manifest of {out} describes no certificate: {error}") from None
        if not same:
            raise CertificateFileError(f"{network.folder} is not the network that the certificate in {out} is about.")
        certificate = cls(out, data, network)
        if data["status"] == "PROVED" and len(data["shards"]) != network.n_shards:
            raise CertificateFileError(f"{out} is about {len(data['shards'])} shards; there are {network.n_shards}.")
        return certificate

    def rate(self, p: int) -> float:
        """The decay rate that is stated for a shard."""
        try:
            rate = float.fromhex(self.data["shards"][p]["rate"])
        except (KeyError, TypeError, ValueError, OverflowError):
            rate = np.nan
        if not 0 <= rate < np.inf:
            raise CertificateFileError(f"the manifest of {self.out} states no rate of shard {p}.")
        return rate

    def vector(self, p: int, name: str, *, verify: bool = False) -> Floats:
        """v, r, q, p or t of a shard, mapped."""
        kind = {"v": 1, "r": 2, "q": 3, "p": 3, "t": 2}[name]
        files, own, file = self.data["shards"][p].get("files"), self.network.own(p, kind), f"{name}.npy"
        entry = files.get(name) if isinstance(files, dict) else None
        array = read_array(shard_folder(self.out, p) / file, entry, verify=verify)
        if array.shape != (own.stop - own.start,) or array.dtype != float:
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
        rates, witness, refuted = np.zeros(0), None, None
        if status is Status.PROVED:
            shards = list(network.filled)
            for p in shards:  # others read r of a shard, so that all are compared with their digests first
                for name in ("r", *("t" * self.has_weights)):
                    self.vector(p, name, verify=True)
            rates = np.full(network.n_shards, np.inf)
            proofs = map(self.prove, shards) if executor is None else executor.map(partial(_prove, self.out), shards)
            for count, (p, rate) in enumerate(proofs, 1):
                report(f"proven: {count} of {len(shards)} shards")
                rates[p] = rate
        elif status is Status.REFUTED:
            refuted = self.data["refuted"]
            if type(refuted) is not int or refuted not in list(network.filled):
                raise CertificateFileError(f"the manifest of {self.out} names no shard that is refuted.")
            _, witness, is_shown = positive_form(network, refuted, network.model(refuted, verify=True))
            if witness is None or not is_shown:
                raise FalseClaimError(f"{self.out} says REFUTED, but no node or link of shard {refuted} shows it.")
        least = float(rates.min(initial=np.inf)) if status is Status.PROVED else 0.0
        about = network.n_nodes, network.n_shards, network.discrete, self.out
        return ShardedCertificate(status, least, rates, witness, refuted, self.data["reason"], *about)

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
def _prove(out: Path, p: int) -> tuple[int, float]:
    """The same from the files, for any process."""
    return SavedCertificate.open(out).prove(p)
