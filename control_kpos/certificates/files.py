"""Certificates as files: JSON, numbers as exact text, written whole or not at all.

Format ``kpos-certificate/1``.  Doubles are hexadecimal text ("0x1.8p+1"), exact data integers or
fractions ("-213/10"); no JSON number with a decimal point occurs, so no reader can round.  The status
is written for people; a reader recomputes it.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..arrays import ExactMatrix
from ..cones import Cone, Orthant, PolyhedralCone, ProductCone, orthant, product
from ..errors import CertificateFileError, KposError

FORMAT = "kpos-certificate/1"
# Refused before anything is allocated.
MAX_FILE_BYTES = 2 * 10**9
MAX_ENTRIES = 10**8

_records: dict[str, type] = {}
_restorers: dict[str, Callable[[dict[str, Any]], Any]] = {}


def register_record(cls: type) -> type:
    """Class decorator: dataclasses of this kind may stand in certificate files as witnesses."""
    _records[cls.__name__] = cls
    return cls


def register_claim(claim: str, restore: Callable[[dict[str, Any]], Any]) -> None:
    """Let `restore` rebuild certificates of a claim from the data in their file."""
    _restorers[claim] = restore


def save_certificate(claim: str, status: str, data: dict[str, Any], path: str | PathLike[str]) -> None:
    """Write a certificate; an interrupted write leaves the old file, or none."""
    content = {"format": FORMAT, **_encode_claim(claim, status, data)}
    target = Path(path)
    handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            json.dump(content, stream, indent=None, separators=(",", ":"))
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def load_certificate(path: str | PathLike[str]) -> Any:
    """Read a certificate and recompute its verdict from the data in the file.

    Parameters
    ----------
    path : path-like
        A file written by `Certificate.save`.

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

    Examples
    --------
    >>> import control_kpos as kp, tempfile, pathlib
    >>> cert = kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2))
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "stable.json"
    >>> cert.save(file)
    >>> kp.load_certificate(file).status.name
    'PROVED'
    """
    if os.path.getsize(path) > MAX_FILE_BYTES:
        raise CertificateFileError(f"{path} is larger than {MAX_FILE_BYTES} bytes.")
    try:
        text = Path(path).read_text(encoding="utf-8")
        content = json.loads(text, parse_float=_refuse, parse_constant=_refuse, object_pairs_hook=_unique)
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError, ValueError) as error:
        raise CertificateFileError(f"{path} is not a certificate file: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CertificateFileError(f"{path} is not in the format {FORMAT!r}.")
    content.pop("format")
    try:
        return _decode_claim(content)
    except CertificateFileError:
        raise
    except (
        KposError,
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        AttributeError,
        ArithmeticError,
        RecursionError,
    ) as error:
        raise CertificateFileError(f"{path} holds data that do not fit together: {error}") from None


def _refuse(text: str) -> Any:
    raise CertificateFileError(f"the bare number {text} may have been rounded; numbers must be integers or text.")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) != len(pairs):
        raise CertificateFileError("a key occurs twice.")
    return out


# -- writing


def _encode_claim(claim: str, status: str, data: dict[str, Any]) -> dict[str, Any]:
    return {"claim": claim, "status": status, "data": {key: encode(value) for key, value in data.items()}}


def encode(value: Any) -> Any:
    """A field of a certificate as JSON data."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return {"double": float(value).hex()}
    if isinstance(value, Fraction):
        return {"fraction": str(value)}
    if isinstance(value, np.ndarray):
        return {"array": _nested(value), "shape": list(value.shape)}
    if isinstance(value, ExactMatrix):
        return _encode_matrix(value)
    if isinstance(value, Cone):
        return {"cone": _encode_cone(value)}
    if isinstance(value, (tuple, list)):
        return {"tuple": [encode(item) for item in value]}
    if hasattr(value, "claim"):
        return {"certificate": _encode_claim(value.claim, value.status.name, value.data())}
    if is_dataclass(value) and type(value).__name__ in _records:
        return {
            "record": type(value).__name__,
            "fields": {f.name: encode(getattr(value, f.name)) for f in fields(value)},
        }
    raise TypeError(f"a certificate cannot hold {type(value).__name__}")


def _text(x: Any) -> str | int:
    if isinstance(x, float):
        return int(x) if x.is_integer() and abs(x) < 2**53 and not (x == 0 and str(x)[0] == "-") else x.hex()
    return str(x) if isinstance(x, Fraction) else x


def _nested(a: Any) -> list[Any]:
    return [_text(x) for x in a.ravel().tolist()]


def _encode_matrix(m: ExactMatrix) -> dict[str, Any]:
    if m.is_sparse:
        coo = sp.coo_array(m.values)
        entries = [[int(i), int(j), _text(x)] for i, j, x in zip(*coo.coords, coo.data.tolist(), strict=True)]
        return {"sparse": entries, "shape": list(m.shape)}
    source = m.values if m.is_double else m.fractions()
    return {"matrix": _nested(np.asarray(source)), "shape": list(m.shape)}


def _encode_cone(cone: Cone) -> dict[str, Any]:
    if isinstance(cone, Orthant):
        return {"orthant": cone.dim}
    if isinstance(cone, ProductCone):
        pairs = zip(cone.factors, cone.counts, strict=True)
        return {"product": [[int(count), _encode_cone(factor)] for factor, count in pairs]}
    if cone.exact_rays.integer_rows is None:
        return {"rays": _encode_matrix(cone.exact_rays)}
    rays = cone.exact_rays.rows_as_integers(np.arange(cone.n_rays))
    return {"rays": {"matrix": [int(x) for x in rays.ravel()], "shape": list(rays.shape)}}


# -- reading


def _decode_claim(content: dict[str, Any]) -> Any:
    claim, data = content["claim"], content["data"]
    if claim not in _restorers:
        raise CertificateFileError(f"the claim {claim!r} is unknown.")
    certificate = _restorers[claim]({key: decode(value) for key, value in data.items()})
    if certificate.status.name != content["status"]:
        raise CertificateFileError(
            f"the file says {content['status']}, but its data give {certificate.status.name} for {claim!r}."
        )
    return certificate


def decode(value: Any) -> Any:
    """The inverse of `encode`."""
    if not isinstance(value, dict):
        if isinstance(value, list):
            raise CertificateFileError("a bare list has no meaning here.")
        return value
    if "double" in value:
        return float.fromhex(value["double"])
    if "fraction" in value:
        return Fraction(value["fraction"])
    if "array" in value:
        return np.array([_double(x) for x in _sized(value["array"], value["shape"])]).reshape(value["shape"])
    if "tuple" in value:
        return tuple(decode(item) for item in value["tuple"])
    if "matrix" in value or "sparse" in value:
        return _decode_matrix(value)
    if "cone" in value:
        return _decode_cone(value["cone"])
    if "certificate" in value:
        return _decode_claim(value["certificate"])
    if "record" in value:
        return _records[value["record"]](**{key: decode(item) for key, item in value["fields"].items()})
    raise CertificateFileError(f"an object with the keys {sorted(value)} has no meaning here.")


def _number(x: Any) -> Fraction:
    if isinstance(x, bool) or not isinstance(x, (int, str)):
        raise CertificateFileError(f"{x!r} is not a number.")
    if isinstance(x, str) and len(x) > 10**5:
        raise CertificateFileError("a number has more than 100000 characters.")
    return Fraction(float.fromhex(x)) if isinstance(x, str) and "0x" in x else Fraction(x)


def _double(x: Any) -> float:
    if isinstance(x, str) and x.lstrip("-") in ("inf", "nan"):
        return float(x)
    exact = _number(x)
    value = exact.numerator / exact.denominator
    if Fraction(value) != exact:
        raise CertificateFileError(f"{x!r} is not a double.")
    return value


def _sized(entries: list[Any], shape: list[int]) -> list[Any]:
    count = 1
    for side in shape:
        if not isinstance(side, int) or side < 0:
            raise CertificateFileError(f"{shape} is not a shape.")
        count *= side
    if not isinstance(entries, list) or len(entries) != count:
        raise CertificateFileError(f"{len(entries)} entries do not fill the shape {shape}.")
    return entries


def _decode_matrix(value: dict[str, Any]) -> ExactMatrix:
    shape = value["shape"]
    if "matrix" in value:
        flat = [_number(x) for x in _sized(value["matrix"], shape)]
        out = np.empty(len(flat), dtype=object)
        out[:] = flat
        return ExactMatrix.from_fractions(out.reshape(shape))
    rows, columns = shape
    entries = value["sparse"]
    if max(rows, columns) > MAX_ENTRIES or len(entries) > MAX_ENTRIES:
        raise CertificateFileError(f"a sparse matrix of shape {shape} is larger than this reader takes.")
    places = {(i, j) for i, j, _ in entries}
    if len(places) != len(entries) or any(not (0 <= i < rows and 0 <= j < columns) for i, j in places):
        raise CertificateFileError("a sparse matrix has an entry twice, or outside its shape.")
    i, j, x = zip(*entries, strict=True) if entries else ((), (), ())
    data = np.array([_double(k) for k in x], dtype=float)
    return ExactMatrix(sp.csr_array((data, (np.array(i, dtype=int), np.array(j, dtype=int))), shape=tuple(shape)))


def _decode_cone(value: dict[str, Any]) -> Cone:
    if "orthant" in value:
        if not isinstance(value["orthant"], int) or value["orthant"] > MAX_ENTRIES:
            raise CertificateFileError(
                f"an orthant of dimension {value['orthant']!r} is larger than this reader takes."
            )
        return orthant(value["orthant"])
    if "product" in value:
        if sum(int(count) for count, _ in value["product"]) > MAX_ENTRIES:
            raise CertificateFileError("a product of cones is larger than this reader takes.")
        factors: list[Cone] = []
        for count, factor in value["product"]:
            factors += [_decode_cone(factor)] * int(count)
        return product(factors)
    return PolyhedralCone(_decode_matrix(value["rays"]))
