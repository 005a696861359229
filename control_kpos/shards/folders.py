"""Folders of arrays with a manifest that states their sizes, types and digests.

Every file is written under another name first and then renamed, the manifest last: a folder without one is unfinished
and is never read.  Arrays are mapped, not read; before its numbers are used a file is compared with its digest.
"""

from __future__ import annotations

import hashlib
import io
import json
import mmap
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..errors import CertificateFileError
from ..proof.files import digest, parse, require_regular, write_whole

MANIFEST = "manifest.json"
# Types of the numbers in files.
_KINDS = ("<f8", "<i8", "<i4")
_BLOCK = 2**22
# Bytes of a file before its numbers.
HEADER = 128
_ENTRY = {"dtype", "shape", "sha256"}
_TEXT = {"bytes", "sha256"}


class _Hashed:
    """A stream that keeps the digest of what is written to it."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.stream, self.hash = stream, hashlib.sha256()

    def write(self, data: Any) -> int:
        self.hash.update(data)
        return self.stream.write(data)


def write_array(path: Path, array: NDArray[Any]) -> dict[str, Any]:
    """Write an array as .npy; its entry in the manifest."""
    array = np.asarray(array)
    kind = "<f8" if array.dtype.kind == "f" else "<i4" if array.dtype.itemsize == 4 else "<i8"
    array = np.ascontiguousarray(array, dtype=kind)
    digests = []

    def write(stream: IO[bytes]) -> None:
        out = _Hashed(stream)
        npy.write_array(out, array, version=(1, 0), allow_pickle=False)  # type: ignore[arg-type]
        digests.append(out.hash.hexdigest())

    write_whole(path, write, durable=False)  # its digest tells whether it reached the disk
    return {"dtype": kind, "shape": list(array.shape), "sha256": digests[-1]}


def keep_array(path: Path, array: NDArray[Any]) -> None:
    """Write an array that is needed for a while only, whole or not at all; `numpy.load` reads it."""
    array = np.ascontiguousarray(array)

    def write(stream: IO[bytes]) -> None:
        npy.write_array_header_1_0(stream, npy.header_data_from_array_1_0(array))
        stream.write(array.data)  # numpy would not say that the disk is full

    write_whole(path, write, durable=False)


def write_text(path: Path, content: Any) -> dict[str, Any]:
    """Write JSON in UTF-8; its entry in the manifest."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()
    write_whole(path, lambda stream: stream.write(text), durable=False)
    return {"bytes": len(text), "sha256": hashlib.sha256(text).hexdigest()}


def read_text(path: Path, entry: Any) -> Any:
    """The content of such a file.

    Raises
    ------
    CertificateFileError
        The file is missing, or is not the one that the manifest is about.
    """
    try:
        require_regular(path)
        if not isinstance(entry, dict) or set(entry) != _TEXT or path.stat().st_size != entry["bytes"]:
            raise CertificateFileError("it has not the length that the manifest states.")
        text = path.read_bytes()
        if hashlib.sha256(text).hexdigest() != entry["sha256"]:
            raise CertificateFileError("it is not the file that the manifest is about; its digest differs.")
        return parse(text.decode())
    except FileNotFoundError:
        raise CertificateFileError(f"{path} is missing.") from None
    except (CertificateFileError, UnicodeDecodeError) as error:
        raise CertificateFileError(f"{path} is damaged: {error}") from None


def append(path: Path, records: NDArray[Any] | bytes) -> None:
    """Write records behind those in a file that nobody else reads."""
    try:
        with open(path, "ab") as stream:
            stream.write(records if isinstance(records, bytes) else np.ascontiguousarray(records).data)
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(path)) from None  # a full disk names no file


def mapped(path: Path) -> NDArray[Any]:
    """An array that is kept, without reading all of it.

    Raises
    ------
    CertificateFileError
        Somebody else has changed the file meanwhile.
    """
    with open(path, "rb") as stream:
        try:
            shape, kind = _described(stream.read(HEADER))
        except (ValueError, EOFError, SyntaxError):
            shape, kind = (-1,), np.dtype(float)
        if stream.seek(0, 2) != HEADER + int(np.prod(shape, dtype=object)) * kind.itemsize:
            raise CertificateFileError(
                f"{path} is damaged; no other process may write to this folder while a certificate is made there."
            )
        if 0 in shape:
            return np.zeros(shape, dtype=kind)
        data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(data, dtype=kind, offset=HEADER).reshape(shape)


@lru_cache
def _described(header: bytes) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of what follows; a product of a shard maps three arrays, and reading this takes longer."""
    stream = io.BytesIO(header)
    npy.read_magic(stream)
    shape, _, kind = npy.read_array_header_1_0(stream)
    return shape, kind


def write_manifest(folder: Path, form: str, data: dict[str, Any], name: str = MANIFEST) -> None:
    """Write the manifest, which makes a folder readable."""
    text = json.dumps({"format": form, "digest": digest(data), "data": data}, indent=1)
    write_whole(folder / name, lambda stream: stream.write(text.encode()), durable=name == MANIFEST)


def read_manifest(folder: Path, form: str, name: str = MANIFEST) -> dict[str, Any]:
    """The data of a manifest.

    Raises
    ------
    CertificateFileError
        There is none, or it is damaged or of another format.
    """
    path = folder / name
    if not path.exists():
        raise CertificateFileError(f"the folder {folder} has no {name}: nothing was written there, or not to the end.")
    try:
        require_regular(path)
        content = parse(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or content.get("format") != form:
            raise CertificateFileError(f"it is not in the format {form!r}.")
        if set(content) != {"format", "digest", "data"} or content["digest"] != digest(content["data"]):
            raise CertificateFileError("its data do not have the digest that it states.")
    except (CertificateFileError, UnicodeDecodeError) as error:
        raise CertificateFileError(f"{path} is damaged: {error}") from None
    return content["data"]


def format_of(folder: Path) -> str:
    """The format of the manifest in a folder; "" if there is none, or none that can be read."""
    try:
        require_regular(folder / MANIFEST)
        content = parse((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, CertificateFileError, UnicodeDecodeError):
        return ""
    return str(content.get("format")) if isinstance(content, dict) else ""


def read_array(path: Path, entry: Any, *, verify: bool) -> NDArray[Any]:
    """The numbers of a file, mapped; with `verify` they are compared with the digest first.

    Raises
    ------
    CertificateFileError
        The file is missing, or is not the one that the manifest is about.
    """
    try:
        if not isinstance(entry, dict) or set(entry) != _ENTRY or entry["dtype"] not in _KINDS:
            raise CertificateFileError("the manifest says nothing of it that can be understood.")
        if any(type(n) is not int for n in entry["shape"]):
            raise CertificateFileError("the manifest states no shape.")
        require_regular(path)
        with open(path, "rb") as stream:
            if verify and _digest_of(stream) != entry["sha256"]:
                raise CertificateFileError("it is not the file that the manifest is about; its digest differs.")
            array = _mapped(stream)
    except FileNotFoundError:
        raise CertificateFileError(f"{path} is missing.") from None
    except (CertificateFileError, ValueError, TypeError, EOFError, SyntaxError, TokenError) as error:
        raise CertificateFileError(f"{path} is damaged: {error}") from None
    if array.dtype.str != entry["dtype"] or list(array.shape) != entry["shape"]:
        raise CertificateFileError(
            f"{path} is damaged: it holds {array.dtype.str} of shape {array.shape}, but the manifest states "
            f"{entry['dtype']} of shape {tuple(entry['shape'])}."
        )
    return array


def _digest_of(stream: IO[bytes]) -> str:
    out = hashlib.sha256()
    stream.seek(0)
    while block := stream.read(_BLOCK):
        out.update(block)
    return out.hexdigest()


def _mapped(stream: IO[bytes]) -> NDArray[Any]:
    stream.seek(0)
    if npy.read_magic(stream) != (1, 0):
        raise CertificateFileError("it is of an unknown version.")
    shape, fortran, kind = npy.read_array_header_1_0(stream, max_header_size=1000)
    if kind.str not in _KINDS or fortran:
        raise CertificateFileError(f"it holds {kind}, which is not expected.")
    count, begin = int(np.prod(shape, dtype=object)), stream.tell()
    if stream.seek(0, 2) != begin + count * kind.itemsize:
        raise CertificateFileError(f"it does not hold {count} numbers.")
    if not count:
        return np.zeros(shape, dtype=kind)
    data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(data, dtype=kind, count=count, offset=begin).reshape(shape)


def shard_folder(folder: Path, number: int) -> Path:
    """Where the files of a shard are."""
    return folder / f"shard-{number:05d}"


def write_arrays(folder: Path, number: int, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays of a shard as files; their entries in the manifest by name."""
    place = shard_folder(folder, number)
    place.mkdir(parents=True, exist_ok=True)
    return {name: write_array(place / f"{name}.npy", array) for name, array in arrays.items()}
