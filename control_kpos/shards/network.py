"""A network in shards: what its manifest states, and every shard as a model with its halo.

Shard s holds nodes that follow each other and the columns of W that leave them, as rows of W' over the inputs that
they feed: its own, then all inputs of the nodes elsewhere that they feed, the halo.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..cones import Cone
from ..cones.hull import ALLOWANCE, LIMIT, Allowance
from ..errors import CertificateFileError, FalseClaimError, KposError, NotProperConeError, TooLargeError
from ..exact.matrix import Matrix
from ..networks.blocks import Index
from ..networks.model import BLOCKS, Halo, NetworkModel
from ..networks.nodes import NodeStack, Timebase
from ..proof.portable_cones import decode_cone, encode_cone
from .exact_numbers import with_entries, with_weights
from .folders import read_array, read_manifest, read_text, shard_folder

FORMAT = "kpos-shards/1"
NAMES = "names.json"
_SIZES = ("states", "inputs", "outputs")
# Sizes in a manifest that no network has.
MOST = 2**48
# Dimensions of all cones in a manifest together.
_DIMENSIONS = 10**6
# Nodes, states, inputs and outputs of a shard that need not have a byte in its files.
_FREE_SIZES = 10**7
_STACK = {"nodes", "X", "U", "Y"}
_SHARD = {"nodes", "stacks", "files"}
# Arrays that may have numbers beside them which are no doubles.
_EXACT = {"nodes": re.compile(r"[ABCD][0-9]+"), "links": re.compile("weights")}
_NONE = object()
_DATA = {"dt", "cones", "shards"}
_LINKS = {"indptr", "targets", "weights", "halo"}


def stated_double(text: str) -> float:
    """A number as `float.hex` writes it, neither infinite nor below 0; ValueError otherwise."""
    number = float.fromhex(text)
    if number.hex() != text or not 0 <= number < np.inf:
        raise ValueError(f"{text} is not a number that may stand there")
    return number


@contextmanager
def limited_work() -> Iterator[None]:
    """Within, cones of unknown origin may ask for no more than half a minute of work, all together."""
    allowed = ALLOWANCE.set(Allowance(LIMIT))
    try:
        yield
    except TooLargeError as error:
        raise CertificateFileError(f"the cones of the network are too much work: {error}") from None
    finally:
        ALLOWANCE.reset(allowed)


class ConeTable:
    """Distinct cones, by what files have of them."""

    def __init__(self) -> None:
        self.encoded: list[Any] = []
        self._places: dict[str, int] = {}
        self._known: dict[int, tuple[Cone, int]] = {}

    def place(self, cone: Cone) -> int:
        """The place of a cone in the table."""
        if id(cone) not in self._known:
            runs = encode_cone(cone)
            text = json.dumps(runs)
            if text not in self._places:
                self._places[text] = len(self.encoded)
                self.encoded.append(runs)
            self._known[id(cone)] = cone, self._places[text]
        return self._known[id(cone)][1]


@dataclass(frozen=True, eq=False)
class ShardedNetwork:
    """A network in files, of which one shard at a time is looked at.

    Attributes
    ----------
    folder : Path
    data : dict
        What the manifest states.
    cones : tuple of Cone
    bounded : bool
        True where the sizes of a shard need the bytes of its files: for manifests of unknown origin.
    """

    folder: Path
    data: dict[str, Any]
    cones: tuple[Cone, ...]
    bounded: bool = False

    @classmethod
    def open(cls, folder: Path, *, bounded: bool = False) -> ShardedNetwork:
        """The network in a folder.

        Raises
        ------
        CertificateFileError
            The manifest is missing, damaged, or describes no network.
        """
        out = cls.of(folder, read_manifest(folder, FORMAT), bounded=bounded)
        if not all(map(_has_its_files, out.data["shards"])):
            raise CertificateFileError(f"the manifest of {folder} describes no network: its shards have other files.")
        return out

    @classmethod
    def of(cls, folder: Path, data: dict[str, Any], *, bounded: bool = False) -> ShardedNetwork:
        """The network that a manifest describes."""
        try:
            cones, room = list[Cone](), _DIMENSIONS if bounded else MOST
            for runs in data["cones"]:
                cones.append(decode_cone(runs, room))
                room -= cones[-1].dim
            out = cls(folder, data, tuple(cones), bounded)
            out._require_sense()
        except NotProperConeError as error:
            raise FalseClaimError(f"the manifest of {folder} holds no cones: {error}") from None
        except (KposError, KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
            raise CertificateFileError(f"the manifest of {folder} describes no network: {error}") from None
        return out

    def _require_sense(self) -> None:
        if set(self.data) != _DATA or any(
            set(s) - {"exact"} != _SHARD or not isinstance(s["files"], dict) or not _is_exact(s.get("exact", _NONE))
            for s in self.data["shards"]
        ):
            raise CertificateFileError("it has other entries.")
        stacks = [t for s in self.data["shards"] for t in s["stacks"]]
        numbers = [n for t in stacks for n in (t[key] for key in _STACK)] + [s["nodes"] for s in self.data["shards"]]
        if any(set(t) != _STACK for t in stacks) or any(type(n) is not int or not 0 <= n < MOST for n in numbers):
            raise CertificateFileError("its stacks are not understood.")
        if any(t["nodes"] < 1 for t in stacks) or any(
            sum(t["nodes"] for t in s["stacks"]) != s["nodes"] for s in self.data["shards"]
        ):
            raise CertificateFileError("its stacks have not the nodes of their shards.")
        if not stacks or any(t[key] >= len(self.cones) for t in stacks for key in "XUY"):
            raise CertificateFileError("it has no nodes, or cones that are not there.")
        if sum(t["nodes"] * sum(self.cones[t[key]].dim + 1 for key in "XUY") for t in stacks) >= MOST:
            raise CertificateFileError("its sizes are absurd.")
        if not (self.data["dt"] is None or isinstance(self.data["dt"], bool)):
            stated_double(self.data["dt"])

    @cached_property
    def dt(self) -> Timebase:
        return read_time(self.data["dt"])

    @property
    def discrete(self) -> bool:
        """True in discrete time."""
        return bool(self.dt)

    @property
    def n_shards(self) -> int:
        """How many shards there are, empty ones included."""
        return len(self.data["shards"])

    @property
    def filled(self) -> Iterator[int]:
        """The numbers of the shards that have nodes."""
        return (p for p, shard in enumerate(self.data["shards"]) if shard["nodes"])

    @cached_property
    def starts(self) -> tuple[Index, Index, Index, Index]:
        """Where the nodes, states, inputs and outputs of every shard begin, and their numbers."""
        counts = np.zeros((4, self.n_shards + 1), dtype=np.int64)
        for p, shard in enumerate(self.data["shards"]):
            counts[0, p + 1] = shard["nodes"]
            for t in shard["stacks"]:
                counts[1:, p + 1] += t["nodes"] * np.array([self.cones[t[key]].dim for key in "XUY"])
        nodes, states, inputs, outputs = np.cumsum(counts, axis=1)
        return nodes, states, inputs, outputs

    @property
    def n_nodes(self) -> int:
        """The nodes of all shards."""
        return int(self.starts[0][-1])

    def own(self, p: int, kind: int) -> slice:
        """The nodes (kind 0), states (1), inputs (2) or outputs (3) of a shard among all."""
        return slice(int(self.starts[kind][p]), int(self.starts[kind][p + 1]))

    def array(self, p: int, name: str, *, verify: bool = False) -> Any:
        """An array of a shard, mapped."""
        entry = self.data["shards"][p]["files"].get(name)
        return read_array(shard_folder(self.folder, p) / f"{name}.npy", entry, verify=verify)

    def exact(self, p: int, kind: str) -> dict[str, Any]:
        """The numbers of the nodes or links of a shard that are no doubles, by array; see `exact_numbers`."""
        entries = self.data["shards"][p].get("exact", {})
        if kind not in entries:
            return {}
        path = shard_folder(self.folder, p) / exact_file(kind)
        out = read_text(path, entries[kind])
        known = (name for name in self.data["shards"][p]["files"] if _EXACT[kind].fullmatch(name))
        if not (isinstance(out, dict) and out and set(out) <= set(known)):
            raise CertificateFileError(f"{path} is damaged: it is about other arrays.")
        return out

    def numbers(self, p: int, places: Any) -> Index:
        """The numbers that nodes of a shard have in the source, by their places in the shard."""
        own = self.own(p, 0)
        if "numbers" not in self.data["shards"][p]["files"]:
            return np.arange(own.start, own.stop)[places]
        numbers = self.array(p, "numbers", verify=True)
        if numbers.shape != (own.stop - own.start,) or numbers.dtype.kind != "i":
            raise CertificateFileError(f"the numbers of nodes of {shard_folder(self.folder, p)} are damaged.")
        return numbers[places]

    def number(self, node: int) -> int:
        """The number in the source of a node, by its place among those of all shards."""
        p = int(np.searchsorted(self.starts[0], node, side="right")) - 1
        return int(self.numbers(p, node - self.own(p, 0).start))

    def name(self, number: int) -> str:
        """The name of a node, by its number in the source; empty if it has none."""
        moved = any("numbers" in shard["files"] for shard in self.data["shards"])
        for p in self.filled if any("names" in shard["files"] for shard in self.data["shards"]) else ():
            own, files = self.own(p, 0), self.data["shards"][p]["files"]
            if not moved and not own.start <= number < own.stop:
                continue
            at = np.flatnonzero(self.numbers(p, slice(None)) == number) if moved else [number - own.start]
            if len(at):
                return self._names(p)[int(at[0])] if "names" in files else ""
        return ""

    def _names(self, p: int) -> list[str]:
        path = shard_folder(self.folder, p) / NAMES
        names = read_text(path, self.data["shards"][p]["files"]["names"])
        if not isinstance(names, list) or [*map(type, names)] != [str] * self.data["shards"][p]["nodes"]:
            raise CertificateFileError(f"{path} is damaged: it has not one name for every node.")
        return names

    def members(self, p: int, *, verify: bool = False) -> list[Index]:
        """The places of the nodes of every stack among those of the shard."""
        shard = self.data["shards"][p]
        if self.bounded:
            self._require_room(p)
        if len(shard["stacks"]) == 1:
            return [np.arange(shard["nodes"])]
        out = [self.array(p, f"members{g}", verify=verify) for g in range(len(shard["stacks"]))]
        sizes = [t["nodes"] for t in shard["stacks"]]
        whole = [m.shape for m in out] == [(n,) for n in sizes] and all(m.dtype.kind == "i" for m in out)
        if not whole or not np.array_equal(np.sort(np.concatenate(out)), np.arange(shard["nodes"])):
            raise CertificateFileError(f"the stacks of {shard_folder(self.folder, p)} do not share out its nodes.")
        return out

    def _require_room(self, p: int) -> None:
        """Refuse sizes for which the files of a shard are too short, before memory is asked for."""
        sizes = sum(int(starts[p + 1] - starts[p]) for starts in self.starts)
        paths = [shard_folder(self.folder, p) / f"{name}.npy" for name in self.data["shards"][p]["files"]]
        if sizes > _FREE_SIZES and sizes > _FREE_SIZES + sum(path.stat().st_size for path in paths if path.exists()):
            raise CertificateFileError(f"the sizes of {shard_folder(self.folder, p)} are absurd for its files.")

    def model(self, p: int, *, verify: bool = False) -> NetworkModel:
        """A shard as a model; with `verify` its files are compared with their digests."""
        members = self.members(p, verify=verify)
        exact = self.exact(p, "nodes")
        stacks = [self._stack(p, g, exact, verify) for g in range(len(members))]
        nodes = self.halo(p, verify=verify)
        kinds, _, sizes = self.receivers(nodes, verify=verify)
        occurring = np.flatnonzero(np.bincount(kinds))
        halo = Halo(tuple(self.cones[i] for i in occurring), np.searchsorted(occurring, kinds))
        width = sum(index.size * s.sizes[1] for index, s in zip(members, stacks, strict=True)) + int(sizes.sum())
        WT = self._links(p, width, verify)
        W = self._weights(p, WT)
        out = NetworkModel(tuple(stacks), tuple(members), W, self.dt, None, halo)
        vars(out)["WT"] = WT
        return out

    def _weights(self, p: int, WT: sp.csr_array) -> Matrix:
        """W of a shard: in doubles, or dense if there are others."""
        exact = self.exact(p, "links")
        if not exact:
            return Matrix(sp.csr_array(WT.T))
        try:
            return with_weights(WT, exact.get("weights", []))
        except CertificateFileError as error:
            raise CertificateFileError(f"the links of {shard_folder(self.folder, p)} are damaged: {error}") from None

    def _stack(self, p: int, g: int, exact: dict[str, Any], verify: bool) -> NodeStack:
        stated = self.data["shards"][p]["stacks"][g]
        cones = [self.cones[stated[key]] for key in "XUY"]
        parts = {}
        for name, (i, j) in BLOCKS.items():
            shape = stated["nodes"], cones[i].dim, cones[j].dim
            if f"{name}{g}" not in self.data["shards"][p]["files"]:  # zeros
                parts[name] = Matrix(np.broadcast_to(np.zeros((1, *shape[1:])), shape))
                continue
            values = self.array(p, f"{name}{g}", verify=verify)
            if values.shape not in (shape, (1, *shape[1:])) or values.dtype != float:
                raise CertificateFileError(
                    f"{name}{g} of {shard_folder(self.folder, p)} has not the size of its nodes."
                )
            if verify and not np.isfinite(values).all():
                raise CertificateFileError(f"{name}{g} of {shard_folder(self.folder, p)} holds numbers not finite.")
            if f"{name}{g}" in exact:
                M = self._in_fractions(p, f"{name}{g}", values, exact)
                parts[name] = M if len(values) == shape[0] else M[np.zeros(shape[0], dtype=np.intp)]
            else:
                parts[name] = Matrix(np.broadcast_to(values, shape))
        return NodeStack(**parts, X=cones[0], U=cones[1], Y=cones[2], dt=self.dt)

    def _in_fractions(self, p: int, name: str, values: Any, exact: dict[str, Any]) -> Matrix:
        try:
            return with_entries(values, exact[name])
        except CertificateFileError as error:
            raise CertificateFileError(f"{name} of {shard_folder(self.folder, p)} is damaged: {error}") from None

    def _links(self, p: int, width: int, verify: bool) -> sp.csr_array:
        """W' of a shard, outputs by own inputs and inputs of the halo."""
        data, indices, indptr = (self.array(p, name, verify=verify) for name in ("weights", "targets", "indptr"))
        outputs = self.own(p, 3)
        if data.dtype != float or any(part.dtype.kind != "i" for part in (indices, indptr)):
            raise CertificateFileError(f"the links of {shard_folder(self.folder, p)} are of other types.")
        try:
            out = sp.csr_array((data, indices, indptr), shape=(outputs.stop - outputs.start, width), copy=False)
            if verify:
                out.check_format(full_check=True)
        except ValueError as error:
            raise CertificateFileError(f"the links of {shard_folder(self.folder, p)} are damaged: {error}") from None
        if verify and not (out.has_canonical_format and np.isfinite(data).all()):
            raise CertificateFileError(f"the links of {shard_folder(self.folder, p)} are damaged.")
        return out

    # -- the halo

    def halo(self, p: int, *, verify: bool = False) -> Index:
        """The nodes elsewhere that a shard feeds, in their order."""
        nodes, own = self.array(p, "halo", verify=verify), self.own(p, 0)
        elsewhere = (nodes < own.start) | (nodes >= own.stop)
        if nodes.ndim != 1 or not (
            nodes.dtype.kind == "i"
            and elsewhere.all()
            and (np.diff(nodes) > 0).all()
            and ((nodes >= 0) & (nodes < self.n_nodes)).all()
        ):
            raise CertificateFileError(f"the halo of {shard_folder(self.folder, p)} is damaged.")
        return nodes

    def fed(self, p: int, *, verify: bool = False) -> Index:
        """The inputs that the columns of the links of a shard stand for, among those of all nodes."""
        own = self.own(p, 2)
        _, first, sizes = self.receivers(self.halo(p, verify=verify), verify=verify)
        return np.concatenate([np.arange(own.start, own.stop), ranges(first, sizes)])

    @cached_property
    def _uniform(self) -> int | None:
        """The input cone of all nodes, if they have the same."""
        kinds = {t["U"] for shard in self.data["shards"] for t in shard["stacks"]}
        return kinds.pop() if len(kinds) == 1 else None

    def _inputs_in(self, p: int, verify: bool) -> tuple[Index, Index]:
        """For the nodes of a shard: the place of the input cone, and where the inputs begin among all; and the end."""
        shard = self.data["shards"][p]
        kinds = np.zeros(shard["nodes"], dtype=np.int64)
        for t, index in zip(shard["stacks"], self.members(p, verify=verify), strict=True):
            kinds[index] = t["U"]
        sizes = self._dims[kinds]
        return kinds, self.own(p, 2).start + np.concatenate([[0], np.cumsum(sizes)])

    @cached_property
    def _dims(self) -> Index:
        return np.array([cone.dim for cone in self.cones], dtype=np.int64)

    def receivers(self, nodes: Index, *, verify: bool = False) -> tuple[Index, Index, Index]:
        """For nodes in their order: the places of their input cones, where their inputs begin, and how many."""
        kinds, first = np.zeros(len(nodes), dtype=np.int64), np.zeros(len(nodes), dtype=np.int64)
        if self._uniform is not None:
            kinds += self._uniform
            first[:] = nodes * self._dims[self._uniform]
            return kinds, first, self._dims[kinds]
        cuts = np.searchsorted(nodes, self.starts[0])
        for p in np.flatnonzero(np.diff(cuts)).tolist():
            part = slice(cuts[p], cuts[p + 1])
            inside, begin = self._inputs_in(p, verify)
            at = nodes[part] - self.own(p, 0).start
            kinds[part], first[part] = inside[at], begin[at]
        return kinds, first, self._dims[kinds]

    def nodes_of(self, inputs: Index) -> Index:
        """The nodes that have these inputs, in their order."""
        if self._uniform is not None:
            return inputs // self._dims[self._uniform]
        out, cuts = np.zeros(len(inputs), dtype=np.int64), np.searchsorted(inputs, self.starts[2])
        for p in np.flatnonzero(np.diff(cuts)).tolist():
            part = slice(cuts[p], cuts[p + 1])
            _, begin = self._inputs_in(p, verify=False)
            out[part] = self.own(p, 0).start + np.searchsorted(begin, inputs[part], side="right") - 1
        return out


def _is_exact(entries: Any) -> bool:
    return entries is _NONE or (isinstance(entries, dict) and bool(entries) and set(entries) <= set(_EXACT))


def _has_its_files(shard: dict[str, Any]) -> bool:
    """True if the files of a shard are those that it needs, and none without a meaning."""
    count, names = len(shard["stacks"]), set(shard["files"])
    needed = {*_LINKS, *(f"members{g}" for g in range(count) if count > 1)} if count else set[str]()
    free = {"numbers", "names", *(f"{name}{g}" for name in BLOCKS for g in range(count))} if count else set[str]()
    return needed <= names <= needed | free


def exact_file(kind: str) -> str:
    """The name of the file with the numbers of nodes or links that are no doubles."""
    return f"exact-{kind}.json"


def read_time(dt: Any) -> Timebase:
    """The time that a manifest states."""
    return float.fromhex(dt) if isinstance(dt, str) else dt


def ranges(first: Index, sizes: Index) -> Index:
    """first, first + 1, ... of each, behind each other."""
    ends = np.cumsum(sizes)
    return np.repeat(first - (ends - sizes), sizes) + np.arange(int(sizes.sum()))
