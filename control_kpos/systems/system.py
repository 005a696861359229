"""System: exact matrices A, B, C, D and cones X, U, Y, and the one door through which data come in.

    x' = A x + B u  (or x[k+1] = A x[k] + B u[k]),   y = C x + D u,   x in X,  u in U,  y in Y.

What is typed is what is proven: "1/3" stays 1/3.  A `ConeStateSpace` shows python-control the doubles closest to
its data and keeps the data beside them, in its attribute `exact`.  Proofs about a system use `exact`, never its
attributes A, B, C, D.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from control import StateSpace, TransferFunction
from numpy.typing import ArrayLike

from ..cones import Cone, as_cone
from ..cones.orthant import nonnegative
from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix, require_shape
from ..exact.matrix import Matrix

Timebase: TypeAlias = "float | bool | None"


@dataclass(frozen=True, eq=False)
class System:
    """A linear system as exact data.

    Attributes
    ----------
    A, B, C, D : Matrix, shapes (n, n), (n, m), (q, n), (q, m)
    X, U, Y : Cone
        Cones of states, inputs and outputs, in R^n, R^m and R^q.
    dt : float, bool or None
        Timebase as in python-control: 0 or None for continuous time, a positive number or True for discrete time.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    X: Cone
    U: Cone
    Y: Cone
    dt: Timebase = 0

    @classmethod
    def read(
        cls,
        data: Any,
        name: str = "sys",
        *,
        X: Cone | ArrayLike | None = None,
        U: Cone | ArrayLike | None = None,
        Y: Cone | ArrayLike | None = None,
        dt: Timebase = None,
    ) -> System:
        """Read anything that describes a linear system, without rounding.

        Parameters
        ----------
        data : System, StateSpace, tuple of matrices, or matrix
            A `ConeStateSpace` or a network is read with its exact data, any other `control.StateSpace` with its
            doubles.  (A, B) and (A, B, C, D) hold matrices of numbers, fractions or text; a matrix alone is A.
        name : str
            What the user calls it, for messages.
        X, U, Y : Cone, or array_like of its generators, optional
            Instead of the cones of `data`; the nonnegative orthants if it has none.
        dt : float, bool or None
            Timebase of matrices; systems have their own.

        Returns
        -------
        System

        Raises
        ------
        DataError, ShapeError
            `data` is no system, has numbers that are not finite and real, or matrices that do not fit together.
        ConeMismatchError
            A cone of another dimension.

        Examples
        --------
        >>> import control_kpos as kp
        >>> third = kp.ConeStateSpace([["-1/3"]], [[1]], [[1]], 0)
        >>> third.A[0, 0], System.read(third).A.fractions()[0, 0]
        (np.float64(-0.3333333333333333), Fraction(-1, 3))
        >>> System.read(([["-1/3"]], [[1]])).B.shape
        (1, 1)
        """
        own = data if isinstance(data, System) else getattr(data, "exact", None)
        if not isinstance(own, System):
            own = _of_matrices(*_matrices(data, name), data.dt if isinstance(data, StateSpace) else dt)
        if X is None and U is None and Y is None:
            return own
        sizes = (("X", X, own.X, "states"), ("U", U, own.U, "inputs"), ("Y", Y, own.Y, "outputs"))
        return replace(own, **{key: _cone(key, given, kept, of) for key, given, kept, of in sizes})

    @property
    def discrete(self) -> bool:
        """True for x[k+1] = A x[k] + B u[k]."""
        return bool(self.dt)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of states, inputs and outputs."""
        return self.A.shape[0], self.D.shape[1], self.D.shape[0]

    @property
    def matrices(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """A, B, C, D."""
        return self.A, self.B, self.C, self.D

    @property
    def is_double(self) -> bool:
        """True if doubles hold all of the data."""
        return all(m.is_double for m in self.matrices)

    def moving(self) -> System:
        """The same with at least one state: a static gain gets an idle one, x' = -x (x[k+1] = 0)."""
        if self.A.shape[0]:
            return self
        _, m, q = self.sizes
        idle = Matrix(np.array([[0.0 if self.discrete else -1.0]]))
        return replace(self, A=idle, B=Matrix.zeros(1, m), C=Matrix.zeros(q, 1), X=nonnegative(1))


def _matrices(data: Any, name: str) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """A, B, C, D of a system, a tuple of matrices or a matrix, with shapes that fit together."""
    if isinstance(data, TransferFunction):
        raise DataError(f"{name} is a transfer function, which has no state; convert it with control.ss first.")
    if isinstance(data, StateSpace):
        given, names = (data.A, data.B, data.C, data.D), [f"{name}.{letter}" for letter in "ABCD"]
    elif _is_tuple_of_matrices(data):
        given, names = data, [f"{name}[{place}]" for place in range(len(data))]
    else:
        given, names = (data,), [name]
    read = [exact_matrix(m, label) for m, label in zip(given, names, strict=True)]
    A = read[0]
    n = A.shape[0]
    if A.shape != (n, n) or (not n and not isinstance(data, StateSpace)):
        raise ShapeError(f"{names[0]} is {A.shape[0]} x {A.shape[1]}; it must be square and not empty.")
    B = read[1] if len(read) > 1 else Matrix.zeros(n, 0)
    if B.shape[0] != n:
        raise ConeMismatchError(f"{name}: A is {n} x {n}, but B has {B.shape[0]} rows.")
    if len(read) < 3:
        return A, B, Matrix.zeros(0, n), Matrix.zeros(0, B.shape[1])
    C, D = read[2:]
    require_shape(C, names[2], (None, n), f"A is {n} x {n}")
    if D.shape == (1, 1) and D.is_zero:
        D = Matrix.zeros(C.shape[0], B.shape[1])  # D = 0, as in control.ss
    return A, B, C, require_shape(D, names[3], (C.shape[0], B.shape[1]), "outputs by inputs")


def _is_tuple_of_matrices(data: Any) -> bool:
    """True for (A, B) and (A, B, C, D), of which A is a matrix beyond doubt; lists of rows are matrices."""
    if not isinstance(data, (tuple, list)) or len(data) not in (2, 4):
        return False
    return isinstance(data[0], Matrix) or sp.issparse(data[0]) or dimensions(data[0]) == 2


def _of_matrices(A: Matrix, B: Matrix, C: Matrix, D: Matrix, dt: Timebase) -> System:
    return System(A, B, C, D, *(nonnegative(size) for size in (A.shape[0], B.shape[1], C.shape[0])), dt=dt)


def _cone(name: str, given: Cone | ArrayLike | None, kept: Cone, of: str) -> Cone:
    if given is None:
        return kept
    cone = as_cone(given, name)
    if cone.dim != kept.dim:
        raise ConeMismatchError(f"{name} has dimension {cone.dim}, but the system has {kept.dim} {of}.")
    return cone
