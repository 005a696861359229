"""Operations on systems with cones: python-control's, and cones for the result where they follow.

Every method calls the one it overrides, so that values, names, state order and refusals are
python-control's own.  If the result is a plain StateSpace, `cones_of_connections` finds its cones, if any follow.  If
the operands are positive, the result is rounded towards these cones, so that it is positive in doubles too.
"""

from __future__ import annotations

import numbers
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import partial
from typing import Any

import control as ct
import numpy as np
from control import StateSpace
from numpy.typing import ArrayLike

from ..errors import (
    DataError,
    KposError,
    ShapeError,
    TimebaseError,
    TooLargeError,
    UndecidedError,
)
from ..exact.intake import (
    choice,
    exact_matrix,
    exact_number,
    flag,
    found,
    real_number,
    require_shape,
    whole_number,
)
from ..exact.matrix import Matrix, dense
from ..theorems.positivity import PositivityCertificate
from . import cones_of_connections as connections
from .cones_of_connections import Connection
from .reading import read_operand, refusing, require_names
from .rounding import LAST_DIGITS, round_towards
from .system import System

# Holds whose sampled matrices are integrals of e^{At} with nonnegative weights.
_POSITIVE_HOLDS = ("zoh", "foh", "impulse")
_METHODS = (*_POSITIVE_HOLDS, "gbt", "bilinear", "tustin", "euler", "forward_diff", "backward_diff")
# python-control multiplies one by one, in a recursion.
_LARGEST_POWER = 200
# States above which results are not checked for what rounding has done to them; it would take longer than they do.
_MOST_ROUNDED = 300
# States up to which fractions take over where the cones are too thin for that.
_MOST_TRACKED = 16


class ConeOperations(StateSpace):
    """What a StateSpace with cones does differently: results keep cones where positivity is kept."""

    @property
    @abstractmethod
    def exact(self) -> System:
        """The system as exact data."""

    @abstractmethod
    def cone_positivity(self) -> PositivityCertificate:
        """The verdict on the system as it is."""

    @abstractmethod
    def _with_cones(self, result: StateSpace, found: Connection | None, tracked: bool) -> StateSpace:
        """The result as a system with cones, with their exact matrices if `tracked`; as it is if there are none."""

    def _adopt(
        self,
        result: Any,
        rule: Callable[..., Connection | None],
        *others: ConeOperations,
        exactly: bool = False,
        copied: bool = False,
    ) -> Any:
        """The result with the cones that `rule` finds from the operands, if they follow.

        `exactly`: track the matrices in fractions even if the operands are doubles.  `copied`: no arithmetic has
        touched the entries.
        """
        if type(result) is not StateSpace:
            return result  # NotImplemented, or an interconnection with a nonlinear system
        operands = (self, *others)
        if any(s.nstates and bool(s.dt) != bool(result.dt) for s in operands):
            return result  # a system without timebase was positive as a continuous one
        if not _is_finite(result):
            return result  # overflow
        given = [s.exact for s in operands]
        tracked = exactly or not all(s.is_double for s in given)
        try:
            found = rule(*map(Connection.of, given))
            if found is not None and not tracked and not copied and result.nstates <= _MOST_ROUNDED:
                # exact numbers are closer than any that a thin cone needs to be moved by
                small = result.nstates <= _MOST_TRACKED
                done = round_towards(result, found, operands, **({"most": LAST_DIGITS} if small else {}))
                tracked = not done and small
            return self._with_cones(result, found, tracked)
        except (TooLargeError, UndecidedError):
            return result  # an operation is not refused because its cones are too large to compute

    def _scaled(self, result: Any, factor: Any, rule: Callable[[Connection, Matrix], Connection | None]) -> Any:
        """Cones of s * factor or factor * s for a number or an array."""
        gain = as_gain(factor)
        if gain is None:
            return result
        if isinstance(factor, numbers.Real):
            number = gain.fractions()[0, 0]
            return self._adopt(result, lambda s: connections.scale(s, number), exactly=not gain.is_double)
        return self._adopt(result, lambda s: rule(s, gain), exactly=not gain.is_double)

    def _require_operand(self, other: Any) -> None:
        if isinstance(other, (numbers.Number, np.ndarray)):
            read_operand(other)
        elif isinstance(other, (StateSpace, ct.TransferFunction)):
            try:
                ct.common_timebase(self.dt, other.dt)
            except ValueError:
                raise TimebaseError(
                    f"incompatible timebases: {self.name} has dt = {self.dt}, {other.name} has dt = {other.dt}; "
                    "sample one of them, or build both with the same dt."
                ) from None

    @contextmanager
    def _sizes_in_errors(self, other: Any) -> Iterator[None]:
        """Say in python-control's refusals what the sizes are."""
        try:
            yield
        except KposError:
            raise
        except ValueError as error:
            raise ShapeError(f"{str(error).rstrip('.')}: {_ports(self)}, {_ports(other)}.") from None

    # -- arithmetic

    def __neg__(self) -> StateSpace:
        return self._adopt(super().__neg__(), connections.negate, copied=True)

    def __add__(self, other: Any) -> Any:
        self._require_operand(other)
        with self._sizes_in_errors(other):
            result = super().__add__(_in_doubles(other))
        if isinstance(other, ConeOperations):
            return self._adopt(result, connections.parallel, other)
        if isinstance(other, numbers.Real):
            other = np.full((self.noutputs, self.ninputs), other)
        gain = as_gain(other)
        if gain is None:
            return result
        return self._adopt(result, lambda s: connections.add_gain(s, gain), exactly=not gain.is_double)

    def __radd__(self, other: Any) -> Any:
        if isinstance(other, StateSpace):
            # Python asks the subclass first; `self + other` would swap the states
            return StateSpace.__add__(other, self)
        return super().__radd__(other)

    def __mul__(self, other: Any) -> Any:
        self._require_operand(other)
        with self._sizes_in_errors(other):
            result = super().__mul__(_in_doubles(other))
        if isinstance(other, ConeOperations):
            return self._adopt(result, connections.series, other)
        return self._scaled(result, other, connections.input_gain)

    def __rmul__(self, other: Any) -> Any:
        if isinstance(other, StateSpace):
            # the base class evaluates `other * self`, which would come straight back here
            return StateSpace.__mul__(other, self)
        with self._sizes_in_errors(other):
            result = super().__rmul__(_in_doubles(other))
        return self._scaled(result, other, connections.output_gain)

    def __pow__(self, other: Any) -> Any:
        if isinstance(other, (int, np.integer)) and abs(other) > _LARGEST_POWER:
            raise TooLargeError(
                f"the power is {found(other)}; python-control multiplies {_LARGEST_POWER} times at most."
            )
        result = super().__pow__(other)  # products of ours, except for powers 0 and -1
        return self._adopt(result, connections.unit, copied=True) if type(other) is int and other == 0 else result

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, numbers.Rational) and other and not self.exact.is_double:
            return self * Fraction(1, other)  # 1 / 3 is no double
        return super().__truediv__(other)

    # -- connections

    def append(self, other: Any) -> StateSpace:
        """Systems side by side, with products of cones.

        Parameters
        ----------
        other : StateSpace or what python-control converts into one

        Returns
        -------
        StateSpace
            With cones if `other` has them.
        """
        read_operand(other)
        self._require_operand(other)
        dt = self.dt
        try:
            with refusing("other"), self._sizes_in_errors(other):
                result = super().append(other)
        finally:
            self.dt = dt  # python-control changes it
        if not isinstance(other, ConeOperations):
            return result
        return self._adopt(result, connections.append, other, copied=True)

    def feedback(self, other: Any = 1, sign: float = -1) -> Any:
        """The loop u = r + sign * y2, where `other` maps y to y2.

        Parameters
        ----------
        other : StateSpace, number, array_like, or what python-control accepts
        sign : float
            +1 for positive feedback; the default is python-control's.

        Returns
        -------
        StateSpace
            With cones (X1 x X2, U1, Y1) if Y1 lies in U2, sign * Y2 in U1 and the direct terms allow it.

        Examples
        --------
        >>> s = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
        >>> s.feedback(s, sign=1).linear_lyapunov().status.name
        'PROVED'
        >>> isinstance(s.feedback(s), kp.ConeStateSpace)  # -Y2 does not lie in U1
        False
        """
        read_operand(other)
        self._require_operand(other)
        k, D1 = exact_number(sign, "sign"), self.exact.D
        with refusing("other"), self._sizes_in_errors(other):
            result = super().feedback(_in_doubles(other), float(k))
        own = float(k) == k
        if isinstance(other, ConeOperations):
            D2 = other.exact.D
            return self._adopt(result, lambda s1, s2: connections.feedback(s1, s2, D1, D2, k), other, exactly=not own)
        gain = as_gain(other)
        if gain is None:
            return result
        rule = partial(connections.feedback_gain, K=gain, D1=D1, sign=k)
        return self._adopt(result, rule, exactly=not (own and gain.is_double))

    def lft(self, other: Any, nu: int = -1, ny: int = -1) -> StateSpace:
        """Linear fractional transformation: `other` closes the last inputs and outputs of this system.

        Parameters
        ----------
        other : StateSpace
        nu, ny : int
            Numbers of inputs and outputs that are closed; -1: as many as possible.

        Returns
        -------
        StateSpace
            With cones under the conditions of `feedback` for the signals that are closed.
        """
        read_operand(other)
        self._require_operand(other)
        nu, ny = whole_number(nu, "nu", least=-1), whole_number(ny, "ny", least=-1)
        for name, count, size in (("nu", nu, self.ninputs), ("ny", ny, self.noutputs)):
            if count > size:
                raise ShapeError(f"{name} is {count}, but the system has {size} {'in' if name == 'nu' else 'out'}puts.")
        with refusing("other"), self._sizes_in_errors(other):
            result = super().lft(other, nu, ny)
        if not isinstance(other, ConeOperations):
            return result
        n_u = min(other.noutputs, self.ninputs) if nu == -1 else nu
        n_y = min(other.ninputs, self.noutputs) if ny == -1 else ny
        D1, D2 = self.exact.D, other.exact.D
        return self._adopt(result, lambda s1, s2: connections.lower_lft(s1, s2, D1, D2, n_u, n_y), other)

    def __getitem__(self, key: Any) -> StateSpace:
        result = super().__getitem__(key)
        inputs = [self.input_index[label] for label in result.input_labels]
        outputs = [self.output_index[label] for label in result.output_labels]
        if (len(inputs), len(outputs)) != (result.ninputs, result.noutputs):
            return result
        return self._adopt(result, lambda s: connections.select(s, inputs, outputs), copied=True)

    # -- other forms of the same system

    def sample(self, Ts: float, method: str = "zoh", *args: Any, **kwargs: Any) -> StateSpace:
        """Discrete-time system at the sampling times.

        Parameters
        ----------
        Ts : float
            Sampling period.
        method : str
            Cones are kept by "zoh", "foh" and "impulse"; see `control.StateSpace.sample`.
        *args, **kwargs
            As in `control.StateSpace.sample`.

        Returns
        -------
        StateSpace

        Examples
        --------
        >>> s = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
        >>> s.sample(0.1).is_cone_positive()
        True
        >>> type(s.sample(0.1, method="tustin")).__name__
        'StateSpace'
        """
        Ts = real_number(Ts, "Ts", positive=True)
        method = choice(method, "method", _METHODS)
        require_names(kwargs)
        with refusing("Ts or method"):
            result = super().sample(Ts, method, *args, **kwargs)
        if method not in _POSITIVE_HOLDS or not _is_finite(result):
            return result
        same = Connection.of(self.exact)
        round_towards(result, same, [self])
        return self._with_cones(result, same, tracked=False)

    def linearize(self, x0: Any, *args: Any, **kwargs: Any) -> StateSpace:
        """The system itself: python-control differentiates it numerically, which costs ten digits.

        Parameters
        ----------
        x0 : array_like or OperatingPoint
        *args, **kwargs
            As in `control.NonlinearIOSystem.linearize`.

        Returns
        -------
        StateSpace
        """
        require_names(kwargs)
        with refusing("x0 or u0"):
            result = super().linearize(x0, *args, **kwargs)
        if result.nstates == self.nstates:
            result.A, result.B, result.C, result.D = (m.copy() for m in (self.A, self.B, self.C, self.D))
        return self._adopt(result, lambda s: s, copied=True)

    def to_ss(self, *args: Any, **kwargs: Any) -> StateSpace:
        """A copy.

        Parameters
        ----------
        *args, **kwargs
            As in `control.ss`.

        Returns
        -------
        StateSpace
        """
        return self._adopt(super().to_ss(*args, **kwargs), lambda s: s, copied=True)

    def similarity_transform(self, T: ArrayLike, timescale: float = 1, inverse: bool = False) -> StateSpace:
        """The same system in states z = T x, with the cone T X.

        Parameters
        ----------
        T : array_like, shape (n, n)
            Invertible; numbers, fractions or decimal text.
        timescale : float
            The new clock shows timescale * t.
        inverse : bool
            True: x = T z.

        Returns
        -------
        StateSpace

        Raises
        ------
        ShapeError, DataError
            T has the wrong size, or is singular.

        Examples
        --------
        >>> import control_kpos as kp
        >>> s = kp.ConeStateSpace([[-2, 1], [1, -2]], [[1], [0]], [[1, 0]], 0)
        >>> z = s.similarity_transform([[1, 1], [0, 1]])
        >>> z.X == kp.PolyhedralCone([[1, 0], [1, 1]]), z.is_cone_positive()
        (True, True)
        """
        n = self.nstates
        exact = require_shape(exact_matrix(T, "T"), "T", (n, n), "the number of states")
        scale, inverse = exact_number(timescale, "timescale"), flag(inverse, "inverse")
        if not float(scale):
            raise DataError("timescale is 0; give a number that is not 0.")
        singular = DataError("T is singular; a change of coordinates must be invertible.")
        try:
            with np.errstate(all="ignore"):
                result = ct.similarity_transform(self, dense(exact.values), float(scale), inverse)
        except np.linalg.LinAlgError:
            raise singular from None
        if not _is_finite(result):
            raise DataError("T or timescale: the result leaves the range of doubles; choose other units.")

        def moved(s: Connection) -> Connection | None:
            found = connections.transform(s, exact, scale, inverse)
            if found is None and scale > 0:
                raise singular
            return found

        return self._adopt(result, moved, exactly=not (exact.is_double and float(scale) == scale))


def _is_finite(s: StateSpace) -> bool:
    return all(bool(np.isfinite(m).all()) for m in (s.A, s.B, s.C, s.D))


def _ports(operand: Any) -> str:
    if isinstance(operand, ct.InputOutputSystem):
        return f"{operand.name} has {operand.ninputs} inputs and {operand.noutputs} outputs"
    shape = np.shape(operand)
    return f"the array is {' x '.join(map(str, shape))}" if shape else f"the other operand is {operand!r}"


def _in_doubles(operand: Any) -> Any:
    """The operand in numbers that python-control computes with: fractions and text as the doubles closest to them."""
    if isinstance(operand, str) or as_gain(operand) is None:
        return operand
    array = np.asarray(operand)
    if array.dtype.kind not in "OUS":
        return operand
    values = exact_matrix(operand, "other", ndim=array.ndim).values
    return values if array.ndim else float(values)


def as_gain(factor: Any) -> Matrix | None:
    """A number or array as a matrix; None if it is no finite real matrix."""
    if isinstance(factor, ct.InputOutputSystem):
        return None
    try:
        gain = exact_matrix(np.atleast_2d(factor), "gain")
    except (KposError, ValueError, TypeError):
        return None
    return gain if len(gain.shape) == 2 and 0 not in gain.shape else None
