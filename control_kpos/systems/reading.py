"""Arguments of a system: matrices as python-control reads them, exact data kept, cones of the right size."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from control import InputOutputSystem, StateSpace, TransferFunction, ss
from control.exception import ControlDimension
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone, Orthant, as_cone
from ..cones.orthant import nonnegative
from ..errors import (
    ConeMismatchError,
    DataError,
    KposError,
    NotProperConeError,
    ShapeError,
    TimebaseError,
)
from ..exact.intake import exact_matrix, found, whole_number
from ..exact.matrix import Matrix, dense
from .cones_of_connections import image, preimage

# Names for more signals than this would take gigabytes.
_MOST_SIGNALS = 10**7


class KindError(DataError, TypeError):
    """Data of the wrong kind, complex ones included: a TypeError as well, which is what python-control raises."""


class SystemSizeError(ShapeError, ControlDimension):
    """A, B, C, D do not fit together: a ControlDimension as well, as python-control has it."""


@dataclass(frozen=True)
class Removal:
    """Which states python-control removed as useless: constant ones, and others that nothing depends on."""

    full: int
    constant: NDArray[np.bool_]
    kept: NDArray[np.intp]

    def matrix(self, name: str, m: Matrix, width: int) -> Matrix:
        """What remains of A, B or C, given flat or not; `width` is the number of inputs or outputs."""
        every = np.arange(width)
        shape, rows, columns = {
            "A": ((self.full, self.full), self.kept, self.kept),
            "B": ((self.full, width), self.kept, every),
            "C": ((width, self.full), every, self.kept),
        }[name]
        return Matrix.from_fractions(m.fractions().reshape(shape)[np.ix_(rows, columns)])

    def cone(self, X: Cone) -> Cone:
        """X where the constant states are 0, seen from the states that are kept."""
        axes = np.eye(self.full)
        moving = np.flatnonzero(~self.constant)
        section = preimage(Matrix(axes[:, moving]), X)
        shadow = None if section is None else image(Matrix(axes[self.kept][:, moving]), section)
        if shadow is None:
            raise NotProperConeError(
                f"X: what is left of it after useless states are removed is not proper; keep states "
                f"{sorted(set(range(self.full)) - set(self.kept.tolist()))} with remove_useless_states=False."
            )
        return shadow


def read_matrix(data: Any, name: str) -> tuple[Any, Matrix | None]:
    """Values for python-control to read, and the exact matrix if they are not exact.

    Doubles are passed on as they come, so that python-control decides what 0, a vector or [] means.
    """
    ndim = 2
    if isinstance(data, Matrix):
        return (dense(data.values) if data.is_sparse else data.values), (None if data.is_double else data)
    if not sp.issparse(data):
        array = _as_array(data)
        if array is not None and array.ndim > 2:
            raise SystemSizeError(f"state-space matrix {name} must be 2-dimensional; its shape is {array.shape}.")
        if array is not None:
            if array.dtype.kind == "c":
                raise KindError(f"{name} is complex; each entry must be a real number, not 'complex'.")
            if _fits_doubles(array) and not np.ma.is_masked(data):
                return (array if array.ndim else data), None
            ndim = array.ndim
    exact = exact_matrix(data, name, ndim=ndim)
    values = dense(exact.values)
    return (values if values.ndim else float(values)), (None if exact.is_double else exact)


def realized(source: TransferFunction, name: str) -> StateSpace:
    """The realization of a transfer function that `control.ss` finds, under the same names."""
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ss(source, name=source.name, inputs=source.input_labels, outputs=source.output_labels)
    except (ValueError, TypeError, ArithmeticError, LookupError, NotImplementedError) as error:
        raise KindError(f"{name}: control.ss finds no realization of the transfer function: {error}.") from None


def require_timebase(dt: Any) -> None:
    """Refuse what is no timebase; python-control lets NaN and inf through."""
    if not (dt is None or (isinstance(dt, (bool, int, float)) and 0 <= dt <= sys.float_info.max)):
        raise TimebaseError(
            f"invalid timebase, dt = {found(dt)}: give 0 for continuous time, a sampling time or True for discrete "
            "time, or None."
        )


def require_names(names: Mapping[str, Any]) -> None:
    """Refuse names of systems and signals that are no text; counts beyond any use included."""
    name = names.get("name")
    if not (name is None or isinstance(name, str)):
        raise KindError(f"name is {found(name)}; give text.")
    for what in ("inputs", "outputs", "states", "input", "output", "state"):
        given = names.get(what)
        if given is None or isinstance(given, str):
            continue
        if isinstance(given, (int, np.integer)):
            whole_number(int(given), what, most=_MOST_SIGNALS)
        elif not (isinstance(given, (list, tuple)) and all(isinstance(label, str) for label in given)):
            raise KindError(f"{what} is {found(given)}; give a number, or a list of names.")


def read_operand(other: Any, name: str = "other") -> None:
    """Refuse what is no system and no finite real matrix."""
    if isinstance(other, InputOutputSystem):
        return
    if other is None or isinstance(other, (str, bytes)):
        raise KindError(f"{name} is {found(other)}; give a system, a number or a matrix.")
    try:
        exact_matrix(other, name)
    except KposError as error:
        raise KindError(str(error)) from None


@contextmanager
def refusing(names: str) -> Iterator[None]:
    """Refusals of python-control as errors that name the arguments."""
    try:
        with np.errstate(all="ignore"):
            yield
    except KposError:
        raise
    except (TypeError, ValueError, ArithmeticError, AttributeError, LookupError, OSError) as error:
        raise KindError(f"{names}: {error}") from None


def _as_array(data: Any) -> NDArray[Any] | None:
    try:
        return np.asarray(data)
    except Exception:  # noqa: BLE001  (ragged; or the object's own conversion, which may raise anything)
        return None


def _fits_doubles(array: NDArray[Any]) -> bool:
    """True if conversion to doubles loses nothing."""
    kind, size = array.dtype.kind, array.dtype.itemsize
    if kind in "iu" and size == 8 and array.size:
        return bool(array.min() >= -(2**53) and array.max() <= 2**53)
    return kind in "iub" or (kind == "f" and size <= 8)


def read_cone(given: Cone | ArrayLike | None, name: str, size: int, of: str, removal: Removal | None = None) -> Cone:
    """The cone X, U or Y of a system with `size` states, inputs or outputs."""
    if given is None:
        return nonnegative(size)
    cone = given if isinstance(given, Cone) else as_cone(given, name)
    if removal is not None and cone.dim == removal.full != size:
        return nonnegative(size) if isinstance(cone, Orthant) else removal.cone(cone)
    if cone.dim != size:
        raise ConeMismatchError(f"{name} is a cone in {cone.dim} dimensions, but the system has {size} {of}.")
    if not cone.is_proper:
        cone.require_proper(name)
    return cone


def size_of(data: Any) -> str:
    """The shape of an argument, for messages."""
    array = _as_array(data)
    return " x ".join(map(str, array.shape)) or "a number" if array is not None else "ragged"
