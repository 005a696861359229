"""Verdicts: conditions that are recomputed from data, never remembered.

A certificate holds data (matrices, cones, vectors).  Its status follows from conditions, sets of
inequalities whose signs the kernel in `exact` proves.  PROVED: every condition of the claim holds.
REFUTED: a witness is present and every condition on the witness holds.  UNDECIDED: neither.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from fractions import Fraction
from functools import cached_property
from os import PathLike
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..cards import Signals, card, floored
from ..errors import DataError
from ..exact.condition import Condition, all_hold, residuals
from ..exact.matrix import Matrix
from .encoding import Encoder, stated
from .files import register_claim, save_certificate, unproven_rates
from .portable_cones import encode_cone
from .weights import ProofOmittedError

# Stored and recomputed residuals may differ by the rounding of another machine's matrix product.
_SAME_RESIDUAL = 1e-11


class Status(Enum):
    """Outcome of a question: what is claimed, and whether it has been proven.

    >>> Status.PROVED == "PROVED", Status.REFUTED in ("PROVED", "UNDECIDED")
    (True, False)
    """

    PROVED = "proved: the inequalities hold for the exact data"
    REFUTED = "refuted: the witness shows that the claim is false"
    UNDECIDED = "undecided: neither a proof nor a counterexample was found"

    def __bool__(self) -> bool:
        return self is Status.PROVED

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, str) and other == self.name)

    __hash__ = Enum.__hash__  # that of the name


def _protect(record: Any) -> None:
    """Make the arrays of a dataclass read-only, so that what has been proven stays what is stored."""
    for field in fields(record) if is_dataclass(record) else ():
        value = vars(record).get(field.name)
        if isinstance(value, np.ndarray):
            object.__setattr__(record, field.name, _read_only(value))


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


# -- vectors as fields


class Vector:
    """A field of a record that holds a vector as one `Matrix`; it reads as doubles.

    Made with a Matrix, or with doubles.  A field `Fractions` takes and gives the fractions behind them.

    Parameters
    ----------
    required : bool
        The field has no default; else it is None.
    """

    def __init__(self, *, required: bool = False) -> None:
        self.required = required

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, record: Any, owner: type | None = None) -> Any:
        if record is None and self.required:
            raise AttributeError(self.name)
        held = None if record is None else vars(record)[self.name]
        return None if held is None else self.read(record, held)

    def __set__(self, record: Any, value: Any) -> None:
        vars(record)[self.name] = value if value is None or isinstance(value, Matrix) else self.hold(value)

    def read(self, record: Any, held: Any) -> Any:
        """What the field shows of what is held."""
        return held.values

    def hold(self, value: Any) -> Any:
        """What is held for a value that is no Matrix."""
        return Matrix(np.asarray(value, dtype=float))


class VectorPair(Vector):
    """A field of two vectors, which reads as a tuple of arrays, or of tuples of fractions where these are needed."""

    def read(self, record: Any, held: Any) -> Any:
        """See `Vector`."""
        return tuple(part.values if part.is_double else tuple(part.fractions().tolist()) for part in held)

    def hold(self, value: Any) -> Any:
        """See `Vector`."""
        return tuple(
            part if isinstance(part, Matrix) else _of_fractions(part) if isinstance(part, tuple) else Matrix(part)
            for part in value
        )


@dataclass(frozen=True)
class _Apart:
    """Doubles that are not the rounding of the fractions beside them: a record may hold them, and proves nothing."""

    values: Any
    exact: Any
    is_double: ClassVar[bool] = False

    def fractions(self) -> Any:
        return np.array(self.exact, dtype=object)


class Fractions:
    """The field of the fractions that vectors are the rounding of: of one, or a tuple for several; None for doubles."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def __get__(self, record: Any, owner: type | None = None) -> Any:
        held = [] if record is None else [vars(record)[name] for name in self.names]
        if all(part is None or part.is_double for part in held):
            return None
        out = [() if part is None else tuple(part.fractions().tolist()) for part in held]
        return tuple(out) if len(out) > 1 else out[0]

    def __set__(self, record: Any, fractions: Any) -> None:
        if fractions is None:
            return
        given = fractions if len(self.names) > 1 else (fractions,)
        if len(given) != len(self.names):
            raise DataError(f"there are {len(given)} exact vectors, not one for each of {', '.join(self.names)}.")
        for name, part in zip(self.names, given, strict=True):
            if (held := vars(record)[name]) is None and part:
                raise DataError(f"exact numbers stand where {name} has none.")
            if held is not None:
                exact = _of_fractions(part)
                vars(record)[name] = exact if np.array_equal(exact.values, held.values) else _Apart(held.values, part)


def _of_fractions(values: Sequence[Any]) -> Matrix:
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return Matrix.from_fractions(column)


def exactly(record: Any, name: str) -> Any:
    """The vector that a field of a record holds, a Matrix of shape (n,); of a pair a tuple of two.

    Raises
    ------
    DataError
        There is none; it is not finite; or its doubles are not the rounding of its fractions.
    """
    held = vars(record)[name]
    for part in held if isinstance(held, tuple) else (held,):
        if isinstance(part, _Apart):
            raise DataError("the exact vector does not round to the doubles beside it.")
        if part is None or part.values.ndim != 1 or not np.isfinite(part.values).all():
            raise DataError("a vector of finite numbers is needed.")
    return held


C = TypeVar("C", bound="Certificate")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Certificate(ABC):
    """A verdict with the data that prove it.

    `bool(certificate)` is True only for PROVED.

    Attributes
    ----------
    status : Status
        PROVED, REFUTED or UNDECIDED, about the exact value of the data.
    witness : object or None
        For REFUTED: what breaks the claim; itself checkable.
    residuals : mapping of str to ndarray
        The numbers whose signs matter, in floating point, by the name of their condition.
    """

    status: Status = Status.UNDECIDED
    witness: Any = None
    residuals: Mapping[str, NDArray[np.float64]] | None = None

    claim: ClassVar[str]
    # conditions that may hold with equality however robust the claim is
    no_margin: ClassVar[frozenset[str]] = frozenset()
    # vectors of a proof that some witness needs as well
    beside_witness: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        for part in (self, self.witness):
            _protect(part)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "claim" in cls.__dict__:
            register_claim(cls)

    @classmethod
    @np.errstate(all="ignore")
    def settle(cls: type[C], **data: Any) -> C:
        """The certificate for these data, with the status that follows from them.

        Parameters
        ----------
        **data
            Every field of the certificate but `status` and `residuals`.
        """
        draft = cls(**data)
        status, conditions = draft._evaluate()
        settled = cls(**data, status=status, residuals=residuals(conditions))
        vars(settled)["_own_conditions"] = conditions  # spares a second evaluation
        return settled

    @abstractmethod
    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""

    @abstractmethod
    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities that prove the witness, or None if the witness is not valid."""

    @abstractmethod
    def explain(self) -> str:
        """A few sentences a person can act on."""

    @property
    def refuted_by(self) -> Any:
        """The witness, if it is proven: what texts speak of; else None."""
        return self.witness if self.status is Status.REFUTED else None

    def is_consistent(self) -> bool:
        """True if its conditions are about all numbers that it states."""
        return not unproven_rates(self)

    @property
    def _signals(self) -> Signals:
        """Names that texts may use; no part of the claim, of comparisons, or of files."""
        return vars(self).get("_named", Signals())

    def parts(self) -> Sequence[Certificate]:
        """Certificates that this one rests on."""
        return ()

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is not None:
            conditions = self.refutation()
            refuted = conditions is not None and all_hold(conditions)
            return (Status.REFUTED if refuted else Status.UNDECIDED), conditions or ()
        if not all(part.status is Status.PROVED for part in self.parts()):
            return Status.UNDECIDED, ()
        conditions = self.conditions()
        return (Status.PROVED if all_hold(conditions) else Status.UNDECIDED), conditions

    @cached_property
    def _own_conditions(self) -> Sequence[Condition]:
        return self._evaluate()[1]

    @cached_property
    @np.errstate(all="ignore")
    def margin(self) -> float:
        """Scale-free distance to the boundary, at most 1; 0 on it, negative beyond it.

        The smallest |z| / (|l|'|M||r|) of the inequalities of the claim, or of the witness with a
        minus sign.
        """
        counted = [c for c in self._own_conditions if c.name not in self.no_margin]
        if self.witness is not None:
            broken = (c.margin for c in counted if c.relation != "==")
            return 0.0 - abs(min(broken, default=0.0))
        return min((c.margin for c in counted), default=0.0)

    @np.errstate(all="ignore")
    def check(self) -> bool:
        """Recompute the verdict from the data, without any solver.

        Returns
        -------
        bool
            True if the stated status, witness and residuals are those of the data.
        """
        try:
            if not all(part.check() for part in self.parts()):
                return False
            if not self.is_consistent():
                return False
            status, conditions = self._evaluate()
            return status is self.status and _agree(conditions, self.residuals)
        except (ValueError, TypeError, IndexError, AttributeError, ArithmeticError):
            return False  # data that do not even fit together prove nothing

    @np.errstate(all="ignore")
    def save(self, path: str | PathLike[str]) -> None:
        """Write the certificate (format ``kpos-certificate/1``); see `load_certificate`.

        Parameters
        ----------
        path : path-like
            Written whole or not at all.  JSON with what an independent checker needs; with the suffix
            ``.npz`` an archive of arrays, for large networks.
        """
        save_certificate(self, path)

    @np.errstate(all="ignore")
    def proof(self) -> dict[str, Any]:
        """What a checker without this package needs besides the data, as JSON data.

        Returns
        -------
        dict
            Empty if the data suffice; {"omitted": reason} if the claim cannot be checked without the package.
        """
        if self.status is Status.UNDECIDED:
            return {"omitted": "nothing is proven"}
        try:
            return {name: x for name, x in self.evidence().items() if x is not None and x != [None] * len(x)}
        except ProofOmittedError as reason:
            return {"omitted": str(reason)}

    def evidence(self) -> dict[str, Any]:
        """The content of `proof`; raises `ProofOmittedError` where it would be too long."""
        raise ProofOmittedError(f"claims of the kind {self.claim!r} are for control_kpos alone")

    def __bool__(self) -> bool:
        return self.status is Status.PROVED

    @np.errstate(all="ignore")
    def __eq__(self, other: object) -> bool:
        """True if both are of one kind and state the same about the same numbers, as files hold them."""
        if self is other or type(self) is not type(other):
            return self is other
        return _stated(self, _ENCODER) == _stated(other, _ENCODER)

    def __hash__(self) -> int:
        return hash((self.claim, self.status))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.status.name}, margin {self.margin:.3g}>"

    def _repr_html_(self) -> str:
        rows = [("scale-free margin", f"{self.margin:.3g}")]
        rate = getattr(self, "decay_rate", np.nan)
        if self and np.isfinite(rate):
            rows.append(("decay rate", floored(rate)))
        return card(type(self).__name__, rows, status=self.status.name, text=self.explain())

    def data(self) -> dict[str, Any]:
        """The fields that determine the verdict, by name."""
        derived = ("status", "residuals")
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in derived}

    def contents(self) -> dict[str, Any]:
        """What determines the verdict, by the names it has in files; `restore` is the inverse."""
        return self.data()

    @classmethod
    def restore(cls: type[C], contents: dict[str, Any]) -> C:
        """The certificate for the contents of a file, with the status that follows from them.

        Parameters
        ----------
        contents : dict
            What `contents` returned.
        """
        return cls.settle(**contents)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClaimWithRate(Certificate):
    """A claim that includes a decay rate, exactly as it was given, if one was asked for: a positive `required_rate`."""

    required_rate: Fraction | None = None

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.required_rate is not None and not (isinstance(self.required_rate, Fraction) and self.required_rate > 0):
            raise DataError("required_rate is no rate that anybody can ask for: it must be a positive fraction.")
        return super()._evaluate()

    def data(self) -> dict[str, Any]:
        """As of every certificate, without a rate where none was asked for."""
        return {k: x for k, x in super().data().items() if k != "required_rate" or x is not None}

    def _asked(self, rounded: Callable[[Fraction], str]) -> str:
        """The rate that was asked for; rounded if it is long."""
        text = str(self.required_rate)
        return text if len(text) < 8 else rounded(self.required_rate or Fraction(0))


def _stated(certificate: Any, encoder: Encoder) -> dict[str, Any]:
    """What a file says of a certificate, but for its proof."""
    data = {key: encoder.value(value) for key, value in certificate.contents().items()}
    return {"claim": certificate.claim, "status": certificate.status.name, "data": stated(data)}


def states_the_same(one: Any, other: Any) -> bool:
    """True if two records are the same in files."""
    return _ENCODER.value(one) == _ENCODER.value(other)


def _generators_of(cone: Any) -> list[Any]:
    """A cone as files hold it, without the vectors that show it to be proper: equal cones may have others."""
    return [[count, part["rays"]] for count, part in encode_cone(cone)]


_ENCODER = Encoder(_stated, _generators_of)


@np.errstate(invalid="ignore", over="ignore")
def _agree(conditions: Sequence[Condition], residuals: Mapping[str, NDArray[np.float64]] | None) -> bool:
    if residuals is None or set(residuals) != {condition.name for condition in conditions}:
        return False
    for condition in conditions:
        stored, fresh = np.asarray(residuals[condition.name]), condition.residual
        if stored.shape != fresh.shape:
            return False
        differ = stored != fresh  # sizes take as long as the forms
        if differ.any() and (differ & (np.abs(stored - fresh) > _SAME_RESIDUAL * condition.scale)).any():
            return False
    return True


def named(certificate: C, signals: Signals) -> C:
    """The certificate, which then knows the names of signals, as do its parts."""
    for part in certificate.parts():
        named(part, signals)
    vars(certificate)["_named"] = signals
    return certificate
