"""ConeStateSpace: a python-control StateSpace that knows its cones.

    x' = A x + B u  (or x[k+1] = A x[k] + B u[k]),   y = C x + D u,   x in X,  u in U,  y in Y.

Verdicts are those of Theorems 1 to 3, in `theorems`.  Operations are python-control's; their results keep cones
wherever positivity of the operands implies positivity of the result; see `operations` and `cones_of_connections`.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from copy import deepcopy
from fractions import Fraction
from html import escape
from typing import Any, Literal

import numpy as np
from control import StateSpace, TransferFunction
from control.exception import ControlDimension
from numpy.typing import ArrayLike

from ..cards import Signals
from ..cones import Cone, Orthant
from ..cones.orthant import nonnegative
from ..errors import (
    DataError,
    KposError,
    ShapeError,
    UndecidedError,
)
from ..exact.intake import exact_matrix
from ..exact.matrix import Matrix, dense
from ..proof.certificate import Status, named
from ..theorems.dissipativity import DissipativityCertificate, dissipativity_of
from ..theorems.gains import Norm, induced_gain_of
from ..theorems.positivity import PositivityCertificate, positivity_of
from ..theorems.stability import LyapunovCertificate, linear_lyapunov
from .cones_of_connections import Connection
from .operations import ConeOperations
from .reading import (
    KindError,
    Removal,
    SystemSizeError,
    read_cone,
    read_matrix,
    realized,
    require_names,
    require_timebase,
    size_of,
)
from .signals import signals_of
from .system import System

_MATRICES = ("A", "B", "C", "D")
# As numpy summarises larger arrays, a cone with more numbers is described rather than listed.
_MOST_RAY_ENTRIES = 1000
_LONGEST_FRACTION = 24


class ConeStateSpace(ConeOperations):
    """ConeStateSpace(A, B, C, D[, dt], X=None, U=None, Y=None)

    Linear system with polyhedral proper cones for states, inputs and outputs.

    Carrying cones is no claim: `is_cone_positive` and the certificates say whether the system leaves them
    invariant.  It is a `control.StateSpace`, and everything python-control does with one works.

    Parameters
    ----------
    A, B, C, D : array_like, shapes (n, n), (n, m), (q, n), (q, m)
        Real numbers; integers, `Fraction` and decimal text such as "1/3" or "-21.3" are kept exactly and
        stay exact through connections.  D = 0 stands for zeros of the right shape.  A single argument is a
        `StateSpace` (also a `LinearICSystem`) to copy, with its names, timebase and, if it has any, cones; or a
        `TransferFunction`, of which the realization by `control.ss` is taken.
    dt : None, True or float, optional
        As in `control.StateSpace`: 0 continuous time, True or a positive number discrete time.  None, no
        timebase, is read as continuous time, as python-control's simulations read it.
    X, U, Y : Cone or array_like of rays, shapes (p, n), (p, m), (p, q), optional
        Default: nonnegative orthants.
    **names
        Keywords of `control.StateSpace`: name, inputs, outputs, states, dt, remove_useless_states, ...

    Attributes
    ----------
    X, U, Y : Cone
        State, input and output cone.  To change them make a copy: ``ConeStateSpace(sys, X=...)``.

    Raises
    ------
    DataError
        NaN, infinite or complex entries, text that is no number.
    ShapeError
        Matrices that do not fit together.
    ConeMismatchError, NotProperConeError
        A cone of the wrong dimension, or one that is not pointed or not solid.
    TypeError
        Unknown keywords, wrong number of arguments.

    Notes
    -----
    ::

        u in U ---> [ x' = A x + B u, x in X ] ---> y = C x + D u in Y

    `+ * - append feedback [] sample copy` and pickling keep the class where cones follow; a plain
    `StateSpace` is returned otherwise, in particular if the other operand is plain.

    Examples
    --------
    >>> import control_kpos as kp
    >>> node = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
    >>> node.is_cone_positive()
    True
    >>> node.X.contains([1, -1])
    True
    >>> type(node.feedback(node, sign=1)).__name__, type(node.feedback(node)).__name__
    ('ConeStateSpace', 'StateSpace')
    """

    def __init__(
        self,
        *args: Any,
        X: Cone | ArrayLike | None = None,
        U: Cone | ArrayLike | None = None,
        Y: Cone | ArrayLike | None = None,
        **names: Any,
    ) -> None:
        if len(args) == 1 and isinstance(args[0], TransferFunction):
            args = (realized(args[0], "sys"),)
        source = args[0] if len(args) == 1 else None
        exact: Mapping[str, Matrix] = {}
        if len(args) in (4, 5):
            read = [read_matrix(data, name) for data, name in zip(args[:4], _MATRICES, strict=True)]
            exact = {name: m for name, (_, m) in zip(_MATRICES, read, strict=True) if m is not None}
            args = (*(values for values, _ in read), *args[4:])
            require_timebase(args[4] if len(args) == 5 else names.get("dt"))
        elif isinstance(source, StateSpace):
            X, U, Y = (
                given if given is not None else getattr(source, name, None)
                for name, given in (("X", X), ("U", U), ("Y", Y))
            )
            own = getattr(source, "exact", None)
            if isinstance(own, System):
                exact = {name: m for name, m in zip(_MATRICES, own.matrices, strict=True) if not m.is_double}
        elif source is not None:
            raise KindError(
                "sys: the one-argument constructor can only take in a StateSpace object; "
                f"received {type(source)}. Give a StateSpace, a TransferFunction, or A, B, C and D."
            )
        elif len(args) == 1:
            raise KindError("sys is None; give a StateSpace, or A, B, C and D.")
        require_names(names)
        try:
            super().__init__(*args, **names)
        except (ControlDimension, ValueError) as error:
            if isinstance(error, KposError):
                raise
            if not isinstance(error, ControlDimension) and "reshape" not in str(error):
                raise DataError(str(error)) from None
            sizes = ", ".join(f"{n} {size_of(a)}" for n, a in zip(_MATRICES, args, strict=False) if len(args) > 1)
            raise SystemSizeError(
                f"{error}. A must be n x n, B n x m, C q x n and D q x m{f'; here {sizes}' if sizes else ''}."
            ) from None
        for name in _MATRICES:
            if not np.isfinite(getattr(self, name)).all():
                exact_matrix(getattr(self, name), name)  # raises, naming the entry
        removal = self.__dict__.pop("_removal", None)
        self._given = {name: (getattr(self, name), self._as_stored(name, m, removal)) for name, m in exact.items()}
        self._cones = (
            read_cone(X, "X", self.nstates, "states", removal),
            read_cone(U, "U", self.ninputs, "inputs"),
            read_cone(Y, "Y", self.noutputs, "outputs"),
        )

    def _as_stored(self, name: str, m: Matrix, removal: Removal | None) -> Matrix:
        """Exact data in the shape python-control has given to the matrix."""
        if removal is not None and name != "D":
            return removal.matrix(name, m, self.ninputs if name == "B" else self.noutputs)
        return Matrix.from_fractions(m.fractions().reshape(getattr(self, name).shape))

    # -- cones and verdicts

    @property
    def X(self) -> Cone:
        """State cone."""
        return self._cones[0]

    @property
    def U(self) -> Cone:
        """Input cone."""
        return self._cones[1]

    @property
    def Y(self) -> Cone:
        """Output cone."""
        return self._cones[2]

    @property
    def cones(self) -> tuple[Cone, Cone, Cone]:
        """(X, U, Y)."""
        return self._cones

    def is_cone_positive(self) -> bool:
        """Decide whether x stays in X and y in Y for all x(0) in X and u(t) in U.

        Returns
        -------
        bool

        Raises
        ------
        UndecidedError
            Some sign is out of reach of exact arithmetic (very large dense systems with full mantissas).
        """
        verdict = self.cone_positivity()
        if verdict.status is Status.UNDECIDED:
            raise UndecidedError(f"{self.name}: {verdict.explain()}")
        return bool(verdict)

    def cone_positivity(self) -> PositivityCertificate:
        """Theorem 1: proof that the system is positive, or the facet and generator that break it.

        Returns
        -------
        PositivityCertificate
            See `control_kpos.cone_positivity`.

        Examples
        --------
        >>> s = kp.ConeStateSpace([[-1, 2], [-3, -4]], [[1], [0]], [[1, 0]], 0)
        >>> s.cone_positivity().witness.condition, s.cone_positivity().witness.value
        ('A X in X', -3.0)
        """
        return named(positivity_of(self._question()), self._signals())

    def linear_lyapunov(self, rate: Literal["max"] | float | Fraction | str | None = None) -> LyapunovCertificate:
        """Theorem 2: proof that X is invariant and x' = A x exponentially stable, or that one of them fails.

        Parameters
        ----------
        rate : "max" or number, optional
            A positive number: this decay rate is claimed too.  "max": the fastest decay rate that can be proven.

        Returns
        -------
        LyapunovCertificate
            See `control_kpos.linear_lyapunov`.

        Examples
        --------
        >>> s = kp.ConeStateSpace([[-2, 1], [1, -2]], [[1], [0]], [[1, 0]], 0)
        >>> round(s.linear_lyapunov(rate="max").decay_rate, 6)
        1.0
        """
        s = self._question()
        return named(linear_lyapunov(s.A, s.X, discrete=s.discrete, rate=rate), self._signals())

    def dissipativity(self, q: ArrayLike | None = None, r: ArrayLike | None = None) -> DissipativityCertificate:
        """Theorem 3: exponential dissipativity with storage v'x and supply rate r'u + q'y.

        Parameters
        ----------
        q : array_like, shape (noutputs,), optional
        r : array_like, shape (ninputs,), optional
            What is not given is found.

        Returns
        -------
        DissipativityCertificate
            See `control_kpos.dissipativity`.
        """
        positive = positivity_of(self._question(ports=True))
        return named(dissipativity_of(positive, q=q, r=r), self._signals())

    def gain(self, norm: Norm = "L1", e: ArrayLike | None = None, f: ArrayLike | None = None) -> float:
        """Induced gain from inputs in U to outputs in Y; inf if the system is not stable.

        Parameters
        ----------
        norm : {"L1", "L2", "Linf"}
            "L2": U and Y are nonnegative orthants.
        e : array_like, shape (ninputs,), optional
        f : array_like, shape (noutputs,), optional
            Weights for general cones, see `control_kpos.gains.induced_gain`.

        Returns
        -------
        float

        Examples
        --------
        >>> round(kp.ConeStateSpace([[-2]], [[1]], [[6]], [[1]]).gain(), 12)
        4.0
        """
        return induced_gain_of(positivity_of(self._question(ports=True)), norm=norm, e=e, f=f)

    @property
    def exact(self) -> System:
        """The system as it is now, exactly: what was given, where no matrix has been assigned or changed since."""
        A, B, C, D = map(self._matrix, _MATRICES)
        return System(A, B, C, D, *self._cones, dt=self.dt)

    def _matrix(self, name: str) -> Matrix:
        array = getattr(self, name)
        given, exact = self._given.get(name, (None, None))
        if exact is None or array is not given or array.shape != exact.shape or (array != exact.values).any():
            exact = exact_matrix(array, name)
            self._given[name] = array, exact
        return exact

    def _signals(self) -> Signals:
        return signals_of(self, *self._cones)

    def _question(self, *, ports: bool = False) -> System:
        """The system as the theorems take it."""
        if ports and not (self.ninputs and self.noutputs):
            raise ShapeError(f"{self.name} has {self.ninputs} inputs and {self.noutputs} outputs; it needs both here.")
        return self.exact.moving()

    def _with_cones(self, result: StateSpace, found: Connection | None, tracked: bool) -> StateSpace:
        if found is None:
            return result
        X = found.X
        if X.dim != result.nstates:  # python-control was told to remove useless states
            if not isinstance(X, Orthant):
                return result
            X = nonnegative(result.nstates)
        cones = {"X": X, "U": found.U, "Y": found.Y, "remove_useless_states": False}
        if not tracked or X is not found.X:
            return ConeStateSpace(result, **cones)
        labels = {"inputs": result.input_labels, "outputs": result.output_labels, "states": result.state_labels}
        data = found.system(result.dt).matrices
        return ConeStateSpace(*data, result.dt, name=result.name, **labels, **cones)

    def _remove_useless_states(self) -> None:
        # runs inside the constructor of the base class, before there are cones
        labels, full = self.state_labels, self.nstates
        constant = ~self.A.any(axis=1) & ~self.B.any(axis=1)
        super()._remove_useless_states()
        self._removal = Removal(
            full, constant, np.array([labels.index(label) for label in self.state_labels], dtype=int)
        )

    # -- copies

    def __deepcopy__(self, memo: dict[int, Any]) -> ConeStateSpace:
        memo.update({id(cone): cone for cone in self._cones})  # immutable, and costly to convert again
        out = type(self).__new__(type(self))
        memo[id(self)] = out
        out.__setstate__(deepcopy(self.__getstate__(), memo))
        return out

    def __getstate__(self) -> dict[str, Any]:
        # the functions the base class makes hold on to the original system, and cannot be pickled
        return {name: value for name, value in self.__dict__.items() if name not in ("updfcn", "outfcn")}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__.update(state)
        self.updfcn = lambda t, x, u, params: self.A @ np.atleast_1d(x) + self.B @ np.atleast_1d(u)
        self.outfcn = lambda t, x, u, params: self.C @ np.atleast_1d(x) + self.D @ np.atleast_1d(u)

    # -- text

    def _shown_cones(self) -> dict[str, Cone]:
        """Cones worth mentioning: all but nonnegative orthants."""
        return {name: cone for name, cone in zip("XUY", self._cones, strict=True) if not isinstance(cone, Orthant)}

    def _repr_eval_(self) -> str:
        exact = {name: m for name, m in zip(_MATRICES, self.exact.matrices, strict=True) if not m.is_double}
        with np.printoptions(floatmode="unique") if _default_print_options() else nullcontext():
            text, at = super()._repr_eval_().removeprefix("StateSpace").removesuffix(")"), 0
            for name in _MATRICES:
                doubles = repr(getattr(self, name))
                shown = _fractions(exact[name]) if name in exact else doubles
                if not self.nstates and name != "D" and self.D.size:
                    shown = "[]"  # numpy's text for empty arrays needs names that are not ours
                at = text.index(doubles, at)
                text = text[:at] + shown + text[at + len(doubles) :]
                at += len(shown)
        cones = "".join(f",\n{name}={_rays(cone)}" for name, cone in self._shown_cones().items())
        return f"{type(self).__name__}{text}{cones})"

    def _repr_html_(self) -> str | None:
        if not self.D.size:
            return None  # python-control reads numpy's text for arrays back, and that of empty ones it cannot read
        text = super()._repr_html_()
        shown = ", ".join(f"{name}: {escape(_described(cone))}" for name, cone in self._shown_cones().items())
        return f"{text}\n<br>Cones {shown}" if text and shown else text

    def __str__(self) -> str:
        return "\n\n".join([super().__str__(), *(f"{n}: {_described(c)}" for n, c in self._shown_cones().items())])


def _fractions(m: Matrix) -> str:
    """Fractions as text that can be read back, decimals with all digits if the fractions are long."""
    text = m.fractions().astype(str)
    if max(map(len, text.ravel())) <= _LONGEST_FRACTION:
        return repr(text.tolist())
    return repr(np.asarray(m.values))


def _default_print_options() -> bool:
    """True if numpy would print 8 digits of doubles only because its default was not changed.

    Read back with fewer digits a system is another system, and may have another verdict.
    """
    options = np.get_printoptions()
    return (options["precision"], options["floatmode"], options["suppress"]) == (8, "maxprec", False)


def _described(cone: Cone) -> str:
    if cone.n_rays * cone.dim <= 12:
        return f"generated by {_rays(cone)}"
    return repr(cone)


def _rays(cone: Cone) -> str:
    """The rays of a cone as text that can be read back, if there are not too many."""
    rays = cone.exact_rays
    if cone.n_rays * cone.dim > _MOST_RAY_ENTRIES:
        return repr(cone)
    numbers = dense(rays.values) if rays.is_double else rays.rows_as_integers(np.arange(cone.n_rays))
    return repr([[int(x) if abs(x) < 2**53 and x == int(x) else x for x in row] for row in numbers.tolist()])
