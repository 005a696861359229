"""Certificates as files: JSON with numbers as exact text, or an archive of arrays; written whole or not at all.

Format ``kpos-certificate/1``, described for other readers on the page certificate_format in docs.  A file
holds the data of a certificate and, where that is affordable, what a checker without this package needs
to prove it again.  The status is written for people; every reader recomputes it.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import os
import secrets
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..cones.hull import ALLOWANCE, Allowance
from ..errors import (
    CertificateFileError,
    FalseClaimError,
    KposError,
    NotProperConeError,
    TooLargeError,
)
from ..exact.intake import file_path, flag
from ..exact.matrix import Matrix
from .archive import is_archive, read_archive, write_archive
from .encoding import Decoder, Encoder, is_record, require_kinds, stated
from .independent import require_agreement, verdict
from .portable_cones import LARGE, decode_cone, encode_cone, factors_in, is_portable

FORMAT = "kpos-certificate/1"
MAX_FILE_BYTES = 2 * 10**9
# Work that cones in files of unknown origin may ask for: half a second, and a microsecond or so for each byte.
_FREE_WORK = 4 * 10**6
_WORK_PER_BYTE = 20
# Bytes of a refused file of which the checker is asked what is wrong: it needs about a second.
_SHORT = 10**6
# What reading a file may come upon.
_REFUSALS = (
    *(KposError, ValueError, TypeError, KeyError, IndexError, AttributeError, ArithmeticError),
    *(RecursionError, MemoryError),
)
# What proofs rest on, and refutations never.
_FOR_PROOFS = ("v", "sigma", "slow_direction", "rays", "multipliers", "pointing", "right_inverse", "shares")
# Claims that are about no system.
_TIMELESS = (
    "compartmental",
    "delayed network",
    "differentially-positive network",
    "feedback",
    "gain bound",
    "out-weight",
)
# Data that stand there as numbers or text.
_BARE = ("dt", "source")
_KEYS = {"format", "producer", "semantics", "digest", "claim", "status", "data", "proof"}

# Folders imported on demand; they register their claims when they are.
_FOLDERS_WITH_CLAIMS = tuple(
    f"control_kpos.{name}" for name in ("networks", "families", "design", "find", "nonlinear", "data")
)

_restorers: dict[str, Any] = {}


def register_claim(kind: Any) -> None:
    """Let a class of certificates rebuild those of its claim from the data in their file."""
    _restorers[kind.claim] = kind


def save_certificate(certificate: Any, path: str | PathLike[str]) -> None:
    """Write a certificate; an interrupted write leaves the old file, or none."""
    path = file_path(path)
    compact = path.suffix.lower() == ".npz"
    content = _describe(certificate, compact=compact)
    text = b"" if compact else _file_text(content).encode()
    write_whole(path, lambda stream: write_archive(stream, content) if compact else stream.write(text))


def write_whole(path: Path, write: Callable[[IO[bytes]], Any], *, durable: bool = True) -> None:
    """Write a file through `write`; an interrupted write leaves the old file, or none.

    `durable`: it has reached the disk when this returns, which may take longer than to write it.
    """
    target = Path(os.path.realpath(path))  # what a link points to is written, and the link stays
    mode = target.stat().st_mode if target.exists() else None
    if mode is not None and not stat.S_ISREG(mode):
        raise CertificateFileError(f"{path} is not a regular file.")
    # named before it exists, so that an interruption at any moment finds what to remove
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as stream:
            write(stream)
            stream.flush()
            if durable:
                os.fsync(stream.fileno())
        if mode is not None:
            os.chmod(temporary, stat.S_IMODE(mode))
        os.replace(temporary, target)
    except BaseException as error:
        with suppress(OSError):  # what went wrong first is what is reported
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None:
            # not the name of the temporary file; a full disk names none
            raise type(error)(error.errno, error.strerror, str(path)) from None
        raise


@np.errstate(all="ignore")
def load_certificate(path: str | PathLike[str], *, trusted: bool = False) -> Any:
    """Read a certificate and recompute its verdict from the data in the file.

    Parameters
    ----------
    path : path-like
        A file written by `Certificate.save`.
    trusted : bool
        True: the cones in the file may ask for any amount of work.  Otherwise for about a second, more in a
        long file, so that a short file cannot keep the reader busy for hours.

    Returns
    -------
    Certificate
        Of the same kind as was saved.  Its status is what the data prove, whatever the file says.

    Raises
    ------
    CertificateFileError
        The file is damaged, of another format, or states a status that its data do not prove.
    OSError
        The file cannot be opened.

    Notes
    -----
    Nothing in the file is executed.  Sizes are checked before anything is allocated.

    Examples
    --------
    >>> import control_kpos as kp, tempfile, pathlib
    >>> cert = kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2))
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "stable.json"
    >>> cert.save(file)
    >>> kp.load_certificate(file).status.name
    'PROVED'
    """
    path, trusted = file_path(path), flag(trusted, "trusted")
    content = None
    try:
        content, size = read_content(path), os.path.getsize(path)
        certificate = _certificate_in(content, size, trusted=trusted)
        require_agreement(content)
        return certificate
    except TooLargeError as error:
        raise CertificateFileError(f"{path} is too much work: {error} If you trust it, say trusted=True.") from None
    except _REFUSALS as error:
        raise _refusal(error, path, content) from None


def _certificate_in(content: dict[str, Any], size: int, *, trusted: bool) -> Any:
    allowed = ALLOWANCE.set(Allowance(math.inf if trusted else _FREE_WORK + _WORK_PER_BYTE * size))
    try:
        return _decode_claim(content, Decoder(size, _decode_claim, decode_cone))
    finally:
        ALLOWANCE.reset(allowed)


def _refusal(error: Exception, path: PathLike[str], content: dict[str, Any] | None) -> CertificateFileError:
    """What to raise for a file that is refused: false or malformed as the checker has it, or else as it seems here."""
    is_false = isinstance(error, (FalseClaimError, NotProperConeError))  # nothing about such a cone is written wrongly
    if content is not None and os.path.getsize(path) < _SHORT:
        status = verdict(content).status
        is_false = status == "WRONG" or (is_false and status != "UNREADABLE")
    named = isinstance(error, CertificateFileError) or is_false
    text = f"{path}: {error}" if named else f"{path} holds data that do not fit together: {error}"
    return (FalseClaimError if is_false else CertificateFileError)(str(error) if str(path) in str(error) else text)


def read_content(path: str | PathLike[str]) -> dict[str, Any]:
    """The JSON data of a file, with the arrays of an archive, after the checks of its frame: format, keys, digest."""
    require_regular(path)
    if os.path.getsize(path) > MAX_FILE_BYTES:
        raise CertificateFileError(f"{path} is larger than {MAX_FILE_BYTES} bytes.")
    archive = is_archive(path)
    if archive:
        content = read_archive(path, parse)
    else:
        try:
            content = parse(Path(path).read_text(encoding="utf-8"))
        except (UnicodeDecodeError, CertificateFileError) as error:
            raise CertificateFileError(f"{path} is not a certificate file: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CertificateFileError(f"{path} is not in the format {FORMAT!r}.")
    if set(content) - _KEYS:
        raise CertificateFileError(f"{path} has the unknown keys {sorted(set(content) - _KEYS)}.")
    if not archive and content["digest"] != digest(content["data"]):
        raise CertificateFileError("the data do not have the digest that the file states.")
    return content


def require_regular(path: str | PathLike[str]) -> None:
    """Refuse pipes, devices and folders, which need not end, or are no files."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise CertificateFileError(f"{path} is not a regular file.")


def parse(text: str) -> Any:
    """JSON data without numbers that a reader could round, and without a key twice."""
    try:
        content = json.loads(
            text, parse_float=_refuse, parse_constant=_refuse, parse_int=_short_integer, object_pairs_hook=_unique
        )
        if "\\u" in text:  # half of a pair of characters is no text: nobody could print it
            json.dumps(content, ensure_ascii=False).encode()
        return content
    except CertificateFileError:
        raise
    except (json.JSONDecodeError, RecursionError, ValueError, MemoryError) as error:
        raise CertificateFileError(str(error) or "nested too deeply") from None


def _refuse(text: str) -> Any:
    raise CertificateFileError(f"the bare number {text[:60]} may have been rounded; numbers must be integers or text.")


def _short_integer(text: str) -> int:
    if len(text) > 20:
        raise CertificateFileError(f"the integer {text[:20]}... is too long for JSON; write it as text.")
    return int(text)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) != len(pairs):
        raise CertificateFileError("a key occurs twice.")
    return out


# -- writing


def _describe(certificate: Any, *, compact: bool) -> dict[str, Any]:
    content = _encode_claim(certificate, Encoder(_encode_claim, encode_cone, compact=compact))
    package = sys.modules.get(__name__.partition(".")[0])
    return {
        "format": FORMAT,
        "producer": f"control_kpos {getattr(package, '__version__', '')}".strip(),
        "semantics": "binary" if all_doubles(certificate) else "decimal",
        **content,
    }


def _file_text(content: dict[str, Any]) -> str:
    """JSON with the digest of the data, which are written once for both; archives have checksums of their own."""
    texts = {key: _compact_text(value, sort_keys=key == "data") for key, value in content.items()}
    texts = {"format": texts["format"], "digest": _compact_text(_digest(texts["data"])), **texts}
    return "{" + ",".join(f'"{key}":{text}' for key, text in texts.items()) + "}"


def _encode_claim(certificate: Any, encoder: Encoder) -> dict[str, Any]:
    data = {key: encoder.value(value) for key, value in certificate.contents().items()}
    proof = certificate.proof()
    if not all(map(is_portable, factors_in(data))):
        proof = {"omitted": f"cones are proven pointed and solid up to dimension {LARGE}"}
    data = data if "omitted" in proof else stated(data)
    return {"claim": certificate.claim, "status": certificate.status.name, "data": data, "proof": proof}


def digest(data: dict[str, Any]) -> str:
    """SHA-256 of the data as compact JSON with sorted keys."""
    return _digest(_compact_text(data, sort_keys=True))


def _digest(text: str) -> str:
    return "sha256:" + hashlib.sha256(text.encode()).hexdigest()


def _compact_text(content: Any, *, sort_keys: bool = False) -> str:
    return json.dumps(content, separators=(",", ":"), sort_keys=sort_keys)


def all_doubles(value: Any) -> bool:
    """True if every matrix among the data is known as doubles."""
    if isinstance(value, Matrix):
        return value.is_double
    if isinstance(value, dict):
        return all(map(all_doubles, value.values()))
    if isinstance(value, (tuple, list)):
        return all(map(all_doubles, value))
    return all_doubles(stated(value.contents())) if hasattr(value, "claim") else True


# -- reading


def _decode_claim(content: Any, decoder: Decoder) -> Any:
    claim, data, proof = content["claim"], content["data"], content["proof"]
    if not isinstance(proof, dict):
        raise CertificateFileError("the proof is no object.")
    data = data if "omitted" in proof else stated(data)
    if claim not in _restorers:
        for folder in _FOLDERS_WITH_CLAIMS:
            importlib.import_module(folder)
    if claim not in _restorers:
        raise CertificateFileError(f"the claim {str(claim)[:60]!r} is unknown.")
    timed = claim not in _TIMELESS and "model" not in data
    for name in ("discrete", "leading", "by_facets"):
        if type(data.get(name, None if timed and name == "discrete" else False)) is not bool:
            raise CertificateFileError(f"{name} is {str(data.get(name))[:60]!r}; it must be true or false.")
    for name, value in data.items():
        if type(value) in (int, str) and name not in _BARE:
            raise CertificateFileError(f"{name} is {str(value)[:60]!r}, which has no meaning there.")
    names = {field.name for field in fields(_restorers[claim])}
    contents = {key: decoder.value(value) for key, value in data.items() if value is not None or key in names}
    require_kinds(_restorers[claim], contents)
    if "omitted" not in proof and hasattr(_restorers[claim], "_completed"):  # what stands in its proof alone
        contents = _restorers[claim]._completed(contents, data, proof)
    certificate = _restorers[claim].restore(contents)
    witness = certificate.witness
    if witness is not None and not is_record(witness):
        raise CertificateFileError(f"the witness is {str(witness)[:60]!r}, which is none.")
    if certificate.status.name != content["status"]:
        if content["status"] in ("PROVED", "REFUTED") and is_empty(certificate):
            raise CertificateFileError(f"it holds nothing that could make {str(claim)!r} {content['status']}.")
        raise FalseClaimError(
            f"the file says {str(content['status'])[:60]}, but its data give {certificate.status.name} for {claim!r}."
        )
    for name in _unread(certificate, {name for name, value in data.items() if value is not None}):
        raise CertificateFileError(
            f"{name[:60]} can say nothing in a certificate for {claim!r} that is {content['status']}."
        )
    for name in unproven_rates(certificate):
        kind = CertificateFileError if certificate and name == "decay_rate" else FalseClaimError  # a rate below 0
        raise kind(f"the file states a {name} of {getattr(certificate, name):g}, which its data do not prove.")
    return certificate


def is_empty(certificate: Any) -> bool:
    """True if a certificate is undecided because a vector is missing, with no witness in its place."""
    parts_hold = all(part.status.name == "PROVED" for part in certificate.parts())
    return certificate.witness is None and not certificate._own_conditions and parts_hold


def _unread(certificate: Any, names: set[str]) -> list[str]:
    """Names of entries from which nothing follows.

    They have no place among the contents; nor among the fields, which files of version 0.1 have; or a witness stands
    beside them that needs them not.
    """
    known = (certificate.contents(), certificate.data())
    rest = min(
        (names - {name for name, x in some.items() if x is not None or "exact" in name} for some in known), key=len
    )
    beside = names.intersection(_FOR_PROOFS) if certificate.witness is not None else set[str]()
    return sorted(rest | beside - certificate.beside_witness)


def unproven_rates(certificate: Any) -> list[str]:
    """Names of the rates that a certificate states although none of its conditions is about them.

    A proof holds a decay rate that is not negative; a bound on rates comes with a slow direction.
    """
    own = vars(certificate)
    rate, bound = own.get("decay_rate", 0.0), own.get("decay_rate_bound", math.inf)
    proved = bool(certificate)
    allowed = (proved and 0 <= rate < math.inf) or (not proved and (math.isnan(rate) or rate == 0))
    bounded = proved and own.get("slow_direction") is not None
    return ["decay_rate"] * (not allowed) + ["decay_rate_bound"] * (not bounded and bound != math.inf)
