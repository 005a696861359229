"""What a write has finished, kept until all of it is: after a crash or a full disk it can be resumed.

Beside the shards stands a folder with a note for every shard whose files were written, with their digests and with
what was to be written.  A shard is kept if it was written for the same network and its files are those noted.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from typing import Any

from ..errors import CertificateFileError, DataError
from ..proof.files import digest
from .folders import read_array, read_manifest, read_text, shard_folder, write_manifest
from .network import NAMES, exact_file
from .partition import Parts

_FORMAT = "kpos-shards-unfinished/1"
_NAME = ".unfinished"
PLAN = "plan.json"


def plan_of(source: Any, parts: Parts) -> dict[str, Any]:
    """What a network is told from another one by, before any of it is read."""
    order = "" if parts.order is None else hashlib.sha256(parts.order.astype("<i8").tobytes()).hexdigest()
    return {"nodes": source.n_nodes, "cuts": digest({"cuts": parts.cuts}), "order": order, "source": _about(source)}


def _about(source: Any) -> Any:
    return source.about() if hasattr(source, "about") else None


@dataclass(frozen=True, eq=False)
class Unfinished:
    """Notes of the shards that are written.

    Attributes
    ----------
    folder : Path
        Of the network.
    """

    folder: Path

    @classmethod
    def begin(cls, folder: Path, plan: dict[str, Any], *, resume: bool) -> Unfinished:
        """Notes of a write; with `resume` those that are there are kept.

        Raises
        ------
        DataError
            They are about another network.
        """
        notes = cls(folder)
        found = notes._note(PLAN) if resume else None
        if found not in (None, plan):
            raise DataError(
                f"folder: what {folder} holds is the beginning of another network, or of one in other shards, which "
                "resume=True does not continue; give what was given then, or leave resume out to begin again."
            )
        for left in [*folder.glob(".*.part"), *folder.glob("shard-*/.*.part")]:  # of a write that was killed
            left.unlink(missing_ok=True)
        if found is None:
            rmtree(notes.place, ignore_errors=True)
        notes.place.mkdir(parents=True, exist_ok=True)
        notes._keep(PLAN, plan)
        return notes

    @property
    def place(self) -> Path:
        """Where they are."""
        return self.folder / _NAME

    def end(self) -> None:
        """Remove them: all is written."""
        rmtree(self.place, ignore_errors=True)

    def kept(self, kind: str, p: int, about: str) -> dict[str, Any] | None:
        """What was noted of a shard; None unless it was written for the same network and its files are whole."""
        note = self._note(_name(kind, p))
        try:
            if note is None or note["about"] != about:
                return None
            place = shard_folder(self.folder, p)
            for name, entry in note["data"]["files"].items():
                if name == "names":
                    read_text(place / NAMES, entry)
                else:
                    read_array(place / f"{name}.npy", entry, verify=True)
            for name, entry in note["data"].get("exact", {}).items():
                read_text(place / exact_file(name), entry)
            return note["data"]
        except (CertificateFileError, KeyError, TypeError, AttributeError):
            return None

    def keep(self, kind: str, p: int, about: str, data: dict[str, Any]) -> None:
        """Note what was written of a shard."""
        self._keep(_name(kind, p), {"about": about, "data": data})

    def _note(self, name: str) -> Any:
        try:
            return read_manifest(self.place, _FORMAT, name)
        except CertificateFileError:
            return None

    def _keep(self, name: str, data: dict[str, Any]) -> None:
        write_manifest(self.place, _FORMAT, data, name)


def _name(kind: str, p: int) -> str:
    return f"{p:05d}-{kind}.json"
