"""Operations on systems with cones: python-control's, and cones for the result where they follow.

Every method calls the one it overrides, so that values, names, state order and refusals are
python-control's own.  If the result is a plain StateSpace, `connections` says whether it has cones.  If the
operands are positive, the result is rounded towards these cones, so that it is positive in doubles too.
"""

from __future__ import annotations

import numbers
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
    flag,
    found,
    real_number,
    require_shape,
    whole_number,
)
from ..exact.matrix import Matrix, dense
from ..theorems.positivity import PositivityCertificate
from . import cones_of_connections as connections
from .cones_of_connections import Model
from .reading import read_operand, refusing, require_names
from .rounding import LAST_DIGITS, round_towards

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

    @abstractmethod
    def _model(self, tracked: bool) -> Model:
        """The cones, and exact matrices if they are to be tracked."""

    @abstractmethod
    def _exact(self) -> dict[str, Matrix]:
        """Matrices that doubles cannot hold."""

    @abstractmethod
    def cone_positivity(self) -> PositivityCertificate:
        """The verdict on the system as it is."""

    @abstractmethod
    def _with_cones(self, result: StateSpace, model: Model | None) -> StateSpace:
        """The result as a system with cones; as it is if there are none."""

    def _adopt(
        self,
        result: Any,
        rule: Callable[..., Model | None],
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
        tracked = exactly or any(s._exact() for s in operands)
        try:
            model = rule(*(s._model(tracked) for s in operands))
        except (TooLargeError, UndecidedError):
            return result  # cones that nobody can compute are no reason to refuse the operation
        if model is not None and model.matrices is None and not copied and result.nstates <= _MOST_ROUNDED:
            # exact numbers are closer than any that a thin cone needs to be moved by
            small = result.nstates <= _MOST_TRACKED
            done = round_towards(result, model, operands, **({"most": LAST_DIGITS} if small else {}))
            if not done and small:
                model = rule(*(s._model(True) for s in operands))
        return self._with_cones(result, model)

    def _scaled(self, result: Any, factor: Any, rule: Callable[[Model, Matrix], Model | None]) -> Any:
        """Cones of s * factor or factor * s for a number or an array."""
        if isinstance(factor, numbers.Real):
            return self._adopt(result, lambda s: connections.scale(s, float(factor)))
        gain = _gain(factor)
        return result if gain is None else self._adopt(result, lambda s: rule(s, gain), exactly=not gain.is_double)

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
            result = super().__add__(other)
        if isinstance(other, ConeOperations):
            return self._adopt(result, connections.parallel, other)
        if isinstance(other, numbers.Real):
            other = np.full((self.noutputs, self.ninputs), float(other))
        gain = _gain(other)
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
            result = super().__mul__(other)
        if isinstance(other, ConeOperations):
            return self._adopt(result, connections.series, other)
        return self._scaled(result, other, connections.input_gain)

    def __rmul__(self, other: Any) -> Any:
        if isinstance(other, StateSpace):
            # the base class evaluates `other * self`, which would come straight back here
            return StateSpace.__mul__(other, self)
        with self._sizes_in_errors(other):
            result = super().__rmul__(other)
        return self._scaled(result, other, connections.output_gain)

    def __pow__(self, other: Any) -> Any:
        if isinstance(other, (int, np.integer)) and abs(other) > _LARGEST_POWER:
            raise TooLargeError(
                f"the power is {found(other)}; python-control multiplies {_LARGEST_POWER} times at most."
            )
        result = super().__pow__(other)  # products of ours, except for powers 0 and -1
        return self._adopt(result, connections.unit, copied=True) if type(other) is int and other == 0 else result

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
        k, D1 = real_number(sign, "sign"), self._direct()
        with refusing("other"), self._sizes_in_errors(other):
            result = super().feedback(other, k)
        if isinstance(other, ConeOperations):
            D2 = other._direct()
            return self._adopt(result, lambda s1, s2: connections.feedback(s1, s2, D1, D2, k), other)
        gain = _gain(other)
        if gain is None:
            return result
        return self._adopt(result, lambda s: connections.feedback_gain(s, gain, D1, k), exactly=not gain.is_double)

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
        D1, D2 = self._direct(), other._direct()
        return self._adopt(result, lambda s1, s2: connections.lower_lft(s1, s2, D1, D2, n_u, n_y), other)

    def _direct(self) -> Matrix:
        return self._exact().get("D") or Matrix(self.D)

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
        model = self._model(tracked=False)
        round_towards(result, model, [self])
        return self._with_cones(result, model)

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
        timescale, inverse = real_number(timescale, "timescale"), flag(inverse, "inverse")
        if not timescale:
            raise DataError("timescale is 0; give a number that is not 0.")
        singular = DataError("T is singular; a change of coordinates must be invertible.")
        try:
            with np.errstate(all="ignore"):
                result = ct.similarity_transform(self, dense(exact.values), timescale, inverse)
        except np.linalg.LinAlgError:
            raise singular from None
        if not _is_finite(result):
            raise DataError("T or timescale: the result leaves the range of doubles; choose other units.")

        def moved(s: Model) -> Model | None:
            model = connections.transform(s, exact, timescale, inverse)
            if model is None and timescale > 0:
                raise singular
            return model

        return self._adopt(result, moved, exactly=not exact.is_double)


def _is_finite(s: StateSpace) -> bool:
    return all(bool(np.isfinite(m).all()) for m in (s.A, s.B, s.C, s.D))


def _ports(operand: Any) -> str:
    if isinstance(operand, ct.InputOutputSystem):
        return f"{operand.name} has {operand.ninputs} inputs and {operand.noutputs} outputs"
    shape = np.shape(operand)
    return f"the array is {' x '.join(map(str, shape))}" if shape else f"the other operand is {operand!r}"


def _gain(factor: Any) -> Matrix | None:
    """A number or array as a matrix; None if it is no finite real matrix."""
    if isinstance(factor, ct.InputOutputSystem):
        return None
    try:
        gain = exact_matrix(np.atleast_2d(factor), "gain")
    except (KposError, ValueError, TypeError):
        return None
    return gain if len(gain.shape) == 2 and 0 not in gain.shape else None
