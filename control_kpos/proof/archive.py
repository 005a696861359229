"""Archives (.npz) with the keys of a JSON certificate: large arrays of doubles beside a JSON text.

A zip file with a member ``certificate.json`` in which {"member": "a3"} stands for the array in ``a3.npy``
(type <f8 or <i8, up to three dimensions).  The sizes in all headers are checked before an array is read, and no
member is ever unpickled or executed.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Callable
from math import prod
from os import PathLike
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..errors import CertificateFileError
from .numerals import nested_text, number_text

MAX_MEMBERS = 10_000
_TEXT = "certificate.json"
_NAME = re.compile(r"certificate\.json|a\d{1,5}\.npy")
_TYPES = ("<f8", "<i8")


def is_archive(path: str | PathLike[str]) -> bool:
    """True for a zip file, whatever its name."""
    with open(path, "rb") as stream:
        return stream.read(4) == b"PK\x03\x04"


def write_archive(stream: IO[bytes], content: dict[str, Any]) -> None:
    """Write JSON data with arrays among them; not compressed, so that sizes cannot lie."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        arrays: list[NDArray[Any]] = []
        text = json.dumps(_extract(content, arrays), separators=(",", ":"))
        archive.writestr(_TEXT, text)
        for k, array in enumerate(arrays):
            with archive.open(f"a{k}.npy", "w", force_zip64=True) as member:
                kind = "<i8" if array.dtype.kind in "iu" else "<f8"
                npy.write_array(member, array.astype(kind), version=(1, 0), allow_pickle=False)


def read_archive(path: str | PathLike[str], parse: Callable[[str], Any]) -> Any:
    """The JSON data of an archive, with arrays in their places.

    Raises
    ------
    CertificateFileError
        Anything unusual about the archive.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = _checked_members(archive)
            content = parse(archive.read(_TEXT).decode())
            arrays = {name[:-4]: _read_array(archive, member) for name, member in members.items() if name != _TEXT}
        return _insert(content, arrays)
    except CertificateFileError:
        raise
    except (
        zipfile.BadZipFile,
        OSError,
        EOFError,
        KeyError,
        ValueError,
        TypeError,
        NotImplementedError,
        RuntimeError,
        MemoryError,
        SyntaxError,
    ) as error:
        raise CertificateFileError(f"{path} is not a valid archive: {error}") from None


def expand(content: Any) -> Any:
    """The same data with arrays as exact text, as in a JSON file."""
    if isinstance(content, dict):
        if isinstance(content.get("sparse"), dict) and isinstance(content["sparse"].get("rows"), np.ndarray):
            parts = [content["sparse"][key].tolist() for key in ("rows", "columns", "values")]
            entries = [[i, j, number_text(x)] for i, j, x in zip(*parts, strict=True)]
            return {"sparse": entries, "shape": content["shape"]}
        return {key: expand(value) for key, value in content.items()}
    if isinstance(content, np.ndarray):
        return nested_text(content.tolist())
    return [expand(item) for item in content] if isinstance(content, list) else content


def _extract(content: Any, arrays: list[NDArray[Any]]) -> Any:
    if isinstance(content, dict):
        return {key: _extract(value, arrays) for key, value in content.items()}
    if isinstance(content, list):
        return [_extract(item, arrays) for item in content] if any(map(_is_nested, content)) else content
    if isinstance(content, np.ndarray):
        arrays.append(content)
        return {"member": f"a{len(arrays) - 1}"}
    return content


def _is_nested(item: Any) -> bool:
    return isinstance(item, (dict, list, np.ndarray))


def _checked_members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Members by name: known names, each once, stored as they are, together no larger than the file."""
    members = {info.filename: info for info in archive.infolist()}
    size = os.fstat(archive.fp.fileno()).st_size if archive.fp is not None else 0
    if len(members) != len(archive.infolist()) or len(members) > MAX_MEMBERS:
        raise CertificateFileError("the archive names a member twice, or has too many.")
    for name, info in members.items():
        if not _NAME.fullmatch(name):
            raise CertificateFileError(f"the archive holds {name[:60]!r}, which does not belong there.")
        if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
            raise CertificateFileError(
                f"{name} is compressed; archives of certificates are not, so that sizes cannot lie."
            )
    if sum(info.file_size for info in members.values()) > size:
        raise CertificateFileError("the members claim to be larger than the archive.")
    return members


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(member) as stream:
        if npy.read_magic(stream) != (1, 0):
            raise CertificateFileError(f"{member.filename} is of an unknown version.")
        shape, fortran, kind = npy.read_array_header_1_0(stream, max_header_size=1000)
        if kind.str not in _TYPES or fortran or not 1 <= len(shape) <= 3 or min(shape) < 0:
            raise CertificateFileError(f"{member.filename} holds {kind} of shape {shape}, which is not expected.")
        count = prod(shape)
        if 8 * count >= member.file_size:
            raise CertificateFileError(f"{member.filename} claims {count} numbers, more than it can hold.")
        data = stream.read()
    if len(data) != 8 * count:
        raise CertificateFileError(f"{member.filename} holds {len(data)} bytes for {count} numbers.")
    return np.frombuffer(data, dtype=kind).reshape(shape)


def _insert(content: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    if isinstance(content, dict):
        if set(content) == {"member"}:
            return arrays[content["member"]]
        return {key: _insert(value, arrays) for key, value in content.items()}
    if isinstance(content, list):
        return [_insert(item, arrays) for item in content] if any(map(_is_nested, content)) else content
    return content
