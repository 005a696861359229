"""Matrices, cones and records as JSON data, without rounding: the vocabulary of certificate files.

Numbers are those of `numerals`.  No JSON number with a decimal point occurs, so no reader can round.  The page
certificate_format in docs has it all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from fractions import Fraction
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cones import Cone
from ..errors import CertificateFileError
from ..exact.matrix import Matrix
from .numerals import double, nested_text, number, number_text, number_texts, special_double

_FREE_DIMENSION = 20_000

# Keys of the objects that stand for a value.
_OBJECTS = [
    *({key} for key in ("double", "fraction", "fractions", "array", "tuple", "matrix", "cone", "certificate")),
    {"sparse", "shape"},
    {"record", "fields"},
]
# What stands in fields, by their annotations, which may end in "| None".
_KINDS: dict[str, tuple[type, ...]] = {
    "float": (float,),
    "Fraction": (Fraction,),
    "float | Fraction": (float, Fraction),
    "Rate": (float, Fraction),
    "int": (int,),
    "bool": (bool,),
    "str": (str,),
    "Matrix": (Matrix,),
    "Cone": (Cone,),
    "Floats | Matrix": (np.ndarray, Matrix),
    **dict.fromkeys(("NodeVector", "Array"), (np.ndarray, tuple)),
    **dict.fromkeys(("Vector", "Floats", "NDArray[np.float64]"), (np.ndarray,)),
    **dict.fromkeys(
        ("VectorPair", "Fractions", "tuple[int, ...]", "tuple[Fraction, ...]", "tuple[Matrix, ...]"), (tuple,)
    ),
}
# And in tuples.
_ITEMS: dict[str, tuple[type, ...]] = {
    "tuple[int, ...]": (int,),
    "tuple[Fraction, ...]": (Fraction,),
    "tuple[Matrix, ...]": (Matrix,),
    "Fractions": (Fraction, tuple),
    "VectorPair": (np.ndarray, tuple),
    **dict.fromkeys(("NodeVector", "Array"), (np.ndarray,)),
}

# And in tuples in these.
_EXACT = ("Fractions", "VectorPair")

_PART = {"claim", "status", "data", "proof"}

_records: dict[str, type] = {}

T = TypeVar("T")

# The value of a field that files leave out, until it is computed.
LATER: Any = None


@dataclass(frozen=True)
class Written:
    """Something that is JSON data already.

    Attributes
    ----------
    content : dict
    """

    content: dict[str, Any]


def register_record(cls: type[T]) -> type[T]:
    """Class decorator: dataclasses of this kind may stand in certificate files.

    The fields that a class names in `computed` follow from the others and from the claim.  Files leave them out; files
    of version 0.1 have them, and whoever restores the claim computes them anew.
    """
    _records[cls.__name__] = cls
    return cls


def is_record(value: Any) -> bool:
    """True for what a class of this kind is of."""
    return type(value) in _records.values()


# -- writing


class Encoder:
    """Writes the fields of certificates as JSON data.

    Parameters
    ----------
    encode_claim : callable
        Writes the certificates among them.
    encode_cone : callable
        Writes cones.
    compact : bool
        Leave arrays of doubles as arrays, for an archive.
    """

    def __init__(
        self,
        encode_claim: Callable[[Any, Encoder], dict[str, Any]],
        encode_cone: Callable[[Cone], Any],
        *,
        compact: bool = False,
    ) -> None:
        self.encode_claim, self.encode_cone, self.compact = encode_claim, encode_cone, compact

    def value(self, value: Any) -> Any:
        """Any field."""
        if value is None or isinstance(value, (bool, str)):
            return value
        if isinstance(value, (int, np.integer)):
            return int(value)
        if isinstance(value, (float, np.floating)):
            return {"double": float(value).hex()}
        if isinstance(value, Fraction):
            return {"fraction": number_text(value)}
        if isinstance(value, np.ndarray):
            return {"array": self.nested(value)}
        if isinstance(value, Matrix):
            return self.matrix(value)
        if isinstance(value, Cone):
            return {"cone": self.encode_cone(value)}
        if isinstance(value, Written):
            return value.content
        if isinstance(value, tuple) and value and all(isinstance(item, Fraction) for item in value):
            return {"fractions": [number_text(item) for item in value]}
        if isinstance(value, (tuple, list)):
            return {"tuple": [self.value(item) for item in value]}
        if hasattr(value, "claim"):
            return {"certificate": self.encode_claim(value, self)}
        if is_dataclass(value) and type(value).__name__ in _records:
            written = [f.name for f in fields(value) if f.name not in getattr(value, "computed", ())]
            content = {name: self.value(getattr(value, name)) for name in written}
            return {"record": type(value).__name__, "fields": content}
        raise TypeError(f"a certificate cannot hold {type(value).__name__}")

    def matrix(self, m: Matrix) -> dict[str, Any]:
        """A matrix, or a stack of them, with its exact entries."""
        shape = [int(side) for side in m.shape]
        if m.is_sparse:
            coo = sp.csr_array(m.values).sorted_indices().tocoo()  # one matrix, one text
            if self.compact:
                rows, columns = (index.astype(np.int64) for index in coo.coords)
                return {"sparse": {"rows": rows, "columns": columns, "values": coo.data}, "shape": shape}
            rows, columns = (index.tolist() for index in coo.coords)
            return {"sparse": list(map(list, zip(rows, columns, number_texts(coo.data), strict=True))), "shape": shape}
        # the zeros of matrices have no sign, as readers know them
        return {"matrix": self.nested(np.asarray(m.values + 0.0 if m.is_double else m.fractions()))}

    def nested(self, values: NDArray[Any]) -> Any:
        """Entries as lists of rows."""
        if self.compact and values.dtype != object:
            return np.ascontiguousarray(values)
        if values.dtype != float:
            return nested_text(values.tolist())
        texts = np.empty(values.size, dtype=object)
        texts[:] = number_texts(values.ravel())
        return texts.reshape(values.shape).tolist()


def encode_triplets(entries: list[tuple[int, int, Any]], shape: tuple[int, ...]) -> dict[str, Any]:
    """A sparse matrix from its nonzero entries (row, column, number)."""
    return {"sparse": [[int(i), int(j), number_text(x)] for i, j, x in entries], "shape": [int(side) for side in shape]}


# -- reading


# What a file has in its proof, exactly: certificates hold it too, up to rounding.
_IN_PROOF = {
    None: {"multipliers", "pointing", "right_inverse", "shares"},
    "GeneratorProof": {"multipliers", "pointing", "right_inverse", "shares"},
    "InstabilityCombination": {"weights"},
}


def stated(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a file without the numbers that its proof has as well."""
    out = {name: x for name, x in data.items() if name not in _IN_PROOF[None]}
    for name in ("generator_proof", "witness"):
        record = out.get(name)
        kind = record.get("record") if isinstance(record, dict) else None
        if record is not None and isinstance(kind, str) and kind in _IN_PROOF:
            rest = {key: x for key, x in record["fields"].items() if key not in _IN_PROOF[kind]}
            out[name] = {**record, "fields": rest}
    return out


class Decoder:
    """The inverse of `Encoder` for one file.

    Parameters
    ----------
    size : int
        Size of the file in bytes: no dimension in it may be larger by more than 20000, so that a few bytes
        cannot ask for gigabytes.
    decode_claim, decode_cone : callable
        Read the certificates and cones in it.
    """

    def __init__(
        self, size: int, decode_claim: Callable[[Any, Decoder], Any], decode_cone: Callable[[Any, int], Cone]
    ) -> None:
        self.limit = size + _FREE_DIMENSION
        self.decode_claim, self.decode_cone = decode_claim, decode_cone

    def value(self, value: Any) -> Any:
        """Any field."""
        if not isinstance(value, dict):
            if isinstance(value, list):
                raise CertificateFileError("a bare list has no meaning here.")
            return value
        if set(value) not in _OBJECTS:
            raise CertificateFileError(f"an object with the keys {sorted(value)} has no meaning here.")
        if "double" in value:
            return special_double(value["double"])
        if "fraction" in value:
            return number(value["fraction"])
        if "fractions" in value:
            if not value["fractions"]:
                raise CertificateFileError("an empty tuple is written as a tuple.")
            return tuple(map(number, value["fractions"]))
        if "array" in value:
            return self._array(value["array"])
        if "tuple" in value:
            return self._tuple(value["tuple"])
        if "matrix" in value or "sparse" in value:
            return self.matrix(value)
        if "cone" in value:
            return self.decode_cone(value["cone"], self.limit)
        if "certificate" in value:
            if set(value["certificate"]) != _PART:
                raise CertificateFileError("a certificate inside another has a claim, a status, data and a proof.")
            return self.decode_claim(value["certificate"], self)
        kind = _records[value["record"]]
        names = {field.name for field in fields(kind)}
        said = {key: x for key, x in value["fields"].items() if key not in getattr(kind, "computed", ())}
        content = {key: self.value(x) for key, x in said.items() if x is not None or key in names}
        needed = [f.name for f in fields(kind) if f.default not in (None, MISSING) and f.name not in content]
        if needed:
            raise CertificateFileError(f"{', '.join(needed)} is missing.")
        require_kinds(kind, content)
        return kind(**content)

    def _tuple(self, items: Any) -> tuple[Any, ...]:
        out = tuple(self.value(item) for item in items)
        if out and all(isinstance(item, Fraction) for item in out):
            raise CertificateFileError("several fractions stand in fractions.")
        return out

    def _array(self, entries: Any) -> NDArray[np.float64]:
        if isinstance(entries, np.ndarray):
            return _doubles(entries)
        shape = nested_shape(entries)
        return np.array([special_double(x) for x in flat_entries(entries, shape)], dtype=float).reshape(shape)

    def _is_size(self, side: Any) -> bool:
        return type(side) is int and 0 <= side <= self.limit

    def matrix(self, value: dict[str, Any]) -> Matrix:
        """Dense or sparse, or a stack of dense ones."""
        if "sparse" in value:
            shape = value["shape"]
            if not isinstance(shape, list) or len(shape) != 2 or not all(map(self._is_size, shape)):
                raise CertificateFileError(f"{str(shape)[:60]} is not a shape that this file can hold.")
            return self._sparse(value["sparse"], (shape[0], shape[1]))
        if isinstance(value["matrix"], np.ndarray):
            long = _is_long(value["matrix"])
            return exact_rows(value["matrix"].tolist()) if long else Matrix(_finite(value["matrix"]))
        return exact_rows(value["matrix"])

    def _sparse(self, entries: Any, shape: tuple[int, ...]) -> Matrix:
        if isinstance(entries, dict):  # index arrays of an archive
            i, j, data = (np.asarray(entries[key]) for key in ("rows", "columns", "values"))
            if i.dtype.kind != "i" or j.dtype.kind != "i":
                raise CertificateFileError("the indices of a sparse matrix are not integers.")
            data = _finite(data)
        else:
            if any(not isinstance(e, list) or len(e) != 3 or not all(map(self._is_size, e[:2])) for e in entries):
                raise CertificateFileError("a sparse matrix has an entry that is not [row, column, number].")
            i, j = (np.array([e[k] for e in entries], dtype=np.int64) for k in (0, 1))
            data = np.array([double(e[2]) for e in entries], dtype=float)
        if not (i.ndim == 1 and i.shape == j.shape == data.shape):
            raise CertificateFileError("the arrays of a sparse matrix differ in length.")
        if i.size and (min(i.min(), j.min()) < 0 or i.max() >= shape[0] or j.max() >= shape[1]):
            raise CertificateFileError("a sparse matrix has an entry outside its shape.")
        out = sp.csr_array((data, (i, j)), shape=shape)
        if out.nnz != len(data):
            raise CertificateFileError("a sparse matrix has an entry twice.")
        return Matrix(out)


def require_kinds(cls: Any, values: dict[str, Any]) -> None:
    """Refuse values of another kind than the fields of a dataclass that they are for.

    A number that is stated as a double is read as one, and as nothing else.
    """
    for field in fields(cls):
        value, kind = values.get(field.name, field.default), str(field.type).removesuffix(" | None")
        if value is field.default or (value is None and kind != field.type):
            continue
        items = value if isinstance(value, tuple) else ()
        numbers = [x for item in items if isinstance(item, tuple) and kind in _EXACT for x in item]
        fits = _is_any(value, _KINDS.get(kind)) and all(_is_any(item, _ITEMS.get(kind)) for item in items)
        if not fits or not all(isinstance(x, Fraction) for x in numbers):
            raise CertificateFileError(f"{field.name} is {str(value)[:60]!r}, which is of another kind ({field.type}).")


def _is_any(value: Any, kinds: tuple[type, ...] | None) -> bool:
    return kinds is None or (isinstance(value, kinds) and (type(value) is not bool or bool in kinds))


def exact_rows(rows: Any) -> Matrix:
    """Nested lists of numbers as exact data."""
    shape = nested_shape(rows)
    if len(shape) < 2:
        raise CertificateFileError("a matrix must be a list of rows.")
    flat = np.empty(int(np.prod(shape)), dtype=object)
    flat[:] = [number(x) for x in flat_entries(rows, shape)]
    return Matrix.from_fractions(flat.reshape(shape))


def nested_shape(entries: Any) -> tuple[int, ...]:
    """Shape of nested lists, at most three deep."""
    shape: list[int] = []
    while isinstance(entries, list) and len(shape) < 3:
        shape.append(len(entries))
        if not entries:
            break
        entries = entries[0]
    if not shape or (isinstance(entries, list) and entries):
        raise CertificateFileError("numbers must be nested one to three lists deep.")
    return tuple(shape)


def flat_entries(entries: list[Any], shape: tuple[int, ...]) -> list[Any]:
    """The numbers in nested lists of a given shape."""
    for side in shape[1:]:
        if any(not isinstance(part, list) or len(part) != side for part in entries):
            raise CertificateFileError("nested lists of numbers are ragged.")
        entries = [x for part in entries for x in part]
    return entries


def _doubles(values: NDArray[Any]) -> NDArray[np.float64]:
    """An array of an archive; its integers must be doubles."""
    if _is_long(values):
        raise CertificateFileError("an integer in the archive is not a double.")
    return values.astype(float)


def _is_long(values: NDArray[Any]) -> bool:
    """True if some integer among the entries is no double."""
    if values.dtype.kind != "i":
        return False
    far = values[(values > 2**53) | (values < -(2**53))]
    return any(int(float(x)) != x for x in far.tolist())


def _finite(values: NDArray[Any]) -> NDArray[np.float64]:
    values = _doubles(values)
    if not np.isfinite(values).all():
        raise CertificateFileError("a matrix has entries that are not finite.")
    return values
