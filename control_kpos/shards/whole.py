"""Small networks in one piece: what shards leave open, one process decides; in integers where the margin is near."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import CertificateFileError, FalseClaimError
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.certificate import NetworkCertificate
from ..networks.certify import certify
from ..networks.conditions import same_numbers
from ..networks.model import BLOCKS, NetworkModel
from ..networks.nodes import NodeStack
from ..networks.witnesses import AlgebraicLoop, CouplingViolation, NetworkInstability, NodeViolation
from ..proof.certificate import Status
from ..proof.files import load_certificate
from .network import ShardedNetwork

# Of a certificate in one piece.
FILE = "whole.json"
# Networks with more nodes, or more states and inputs, are never held in one piece.
_NODES, _SIGNALS = 5_000, 20_000
# And with links that are no doubles: entries of W.
_DENSE = 10**6

# What breaks a network, whatever supply rates it was given.
_BROKEN = (AlgebraicLoop, CouplingViolation, NetworkInstability, NodeViolation)


def fits(network: ShardedNetwork) -> bool:
    """True for a network that may be held in one piece."""
    _, states, inputs, outputs = (int(starts[-1]) for starts in network.starts)
    fractions = any("links" in shard.get("exact", ()) for shard in network.data["shards"])
    links = inputs * outputs if fractions else 0
    return network.n_nodes <= _NODES and states + inputs + outputs <= _SIGNALS and links <= _DENSE


def decided(network: ShardedNetwork, out: Path) -> tuple[NetworkCertificate, dict[str, str]] | None:
    """The certificate of a network in one piece, in a file, with its entry in the manifest; None if UNDECIDED."""
    found = certify(gathered(network))
    if found.status is Status.UNDECIDED:
        return None
    found.save(out / FILE)
    return found, {"sha256": _digest(out / FILE)}


def reproven(network: ShardedNetwork, out: Path, entry: Any) -> NetworkCertificate:
    """The certificate in the file, proven again, about the network in the shards.

    Raises
    ------
    CertificateFileError
        The file is missing, damaged or another one, or the network is too large to be held in one piece.
    FalseClaimError
        It proves nothing, or is about another network.
    """
    path = out / FILE
    if not fits(network):
        raise CertificateFileError(
            f"{path} is about a network in one piece, but {network.n_nodes} nodes are too many for that."
        )
    if not path.is_file():
        raise CertificateFileError(f"{path} is missing.")
    if not isinstance(entry, dict) or set(entry) != {"sha256"} or _digest(path) != entry["sha256"]:
        raise CertificateFileError(f"{path} is damaged: it is not the file that the manifest is about.")
    found = load_certificate(path)
    shows = isinstance(found, NetworkCertificate) and (bool(found) or isinstance(found.witness, _BROKEN))
    if not shows or found.status is Status.UNDECIDED:
        raise FalseClaimError(f"{path} proves nothing about a network.")
    if not same_network(found.model.origin or found.model, gathered(network, verify=True)):
        raise FalseClaimError(f"{path} is about another network than the one in {network.folder}.")
    return found


def rates_in_one_piece(network: ShardedNetwork, whole: NetworkCertificate) -> NDArray[np.float64]:
    """The rate of every shard where all of them are proven at once."""
    return np.where(np.diff(network.starts[0]) > 0, whole.decay_rate, np.inf) if whole else np.zeros(0)


def witness_in_one_piece(network: ShardedNetwork, whole: NetworkCertificate) -> Any:
    """The witness with the numbers that its nodes have in the source; vectors stay in the order of the shards."""
    found: Any = whole.witness
    if isinstance(found, AlgebraicLoop):
        return replace(found, nodes=np.sort([network.number(node) for node in found.nodes.tolist()]))
    ends = {end: network.number(getattr(found, end)) for end in ("node", "target", "source") if hasattr(found, end)}
    return replace(found, **ends) if ends else found


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


# -- the network


def gathered(network: ShardedNetwork, *, verify: bool = False) -> NetworkModel:
    """All shards in one piece."""
    stacks: dict[tuple[int, int, int], list[tuple[NodeStack, Index]]] = {}
    links: list[tuple[Matrix, Index, Index]] = []
    for p in network.filled:
        model, first, outputs = network.model(p, verify=verify), network.own(p, 0).start, network.own(p, 3)
        for stated, s, index in zip(network.data["shards"][p]["stacks"], model.stacks, model.members, strict=True):
            key = stated["X"], stated["U"], stated["Y"]
            stacks.setdefault(key, []).append((s, index + first))
        links.append((model.coupling, network.fed(p), np.arange(outputs.start, outputs.stop)))
    joined = [_joined(parts) for parts in stacks.values()]
    W = _coupling(links, (int(network.starts[2][-1]), int(network.starts[3][-1])))
    return NetworkModel(tuple(s for s, _ in joined), tuple(index for _, index in joined), W, network.dt)


def _coupling(links: list[tuple[Matrix, Index, Index]], shape: tuple[int, int]) -> Matrix:
    """W from the columns of every shard, with the inputs and outputs that they belong to."""
    if all(W.is_double for W, _, _ in links):
        parts = [(W.values.tocoo(), inputs, outputs) for W, inputs, outputs in links]
        data = np.concatenate([W.data for W, _, _ in parts])
        rows = np.concatenate([inputs[W.coords[0]] for W, inputs, _ in parts])
        columns = np.concatenate([outputs[W.coords[1]] for W, _, outputs in parts])
        return Matrix(sp.csr_array((data, (rows, columns)), shape=shape))
    table = np.full(shape, Fraction(0), dtype=object)
    for W, inputs, outputs in links:
        table[np.ix_(inputs, outputs)] = W.dense().fractions()
    return Matrix.from_fractions(table)


def _joined(parts: list[tuple[NodeStack, Index]]) -> tuple[NodeStack, Index]:
    """Stacks of the same cones as one, in the order of the nodes."""
    index = np.concatenate([k for _, k in parts])
    order, first = np.argsort(index, kind="stable"), parts[0][0]
    A, B, C, D = (Matrix.join([getattr(s, name) for s, _ in parts], 0)[order] for name in BLOCKS)
    return NodeStack(A, B, C, D, first.X, first.U, first.Y, first.dt), index[order]


def same_network(a: NetworkModel, b: NetworkModel) -> bool:
    """True if two networks have the same numbers, cones and time, node by node and link by link."""
    if (a.dt, a.n_nodes, len(a.stacks), a.coupling.shape) != (b.dt, b.n_nodes, len(b.stacks), b.coupling.shape):
        return False
    for s, i, t, j in zip(a.stacks, a.members, b.stacks, b.members, strict=True):
        cones = zip((s.X, s.U, s.Y), (t.X, t.U, t.Y), strict=True)
        if not np.array_equal(i, j) or s.sizes != t.sizes or not all(x == y for x, y in cones):
            return False
        if not all(same_numbers(getattr(s, name), getattr(t, name)) for name in BLOCKS):
            return False
    return same_numbers(a.coupling, b.coupling)
