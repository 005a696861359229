"""Cones of connections: series, parallel, feedback, selection, change of coordinates.

Let systems be positive with respect to their cones (X, U, Y).  Each function gives cones for which the
connection is positive too, whatever the matrices of the systems are, or None where there are none:

    s1 s2              Y2 in U1                            (X2 x X1, U2, Y1)
    s1 + s2                                                (X1 x X2, U1 & U2, Y1 + Y2)
    feedback(s1, s2)   Y1 in U2, sign Y2 in U1,            (X1 x X2, U1, Y1)
                       spectral radius of D2 D1 below 1
    M s,  s M          M Y, and {u : M u in U}             (X, U, M Y), (X, {u : M u in U}, Y)

States are ordered as python-control orders them.  Matrices are multiplied out in fractions only on
demand, and only if a system was given in numbers that doubles cannot hold.  Otherwise python-control's own doubles are
the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone, Orthant, product
from ..cones.orthant import nonnegative
from ..errors import TooLargeError
from ..exact.linalg import solve_exactly
from ..exact.matrix import Matrix
from ..theorems.stability import linear_lyapunov
from .rounding import maps_into
from .system import System

Rationals: TypeAlias = NDArray[np.object_]
Realization: TypeAlias = tuple[Rationals, Rationals, Rationals, Rationals]


@dataclass(frozen=True, eq=False)
class Connection:
    """Cones of a system that is made of others, and its exact matrices when they are asked for.

    Attributes
    ----------
    X, U, Y : Cone
        State, input and output cone.
    form : callable
        Multiplies the matrices out.
    """

    X: Cone
    U: Cone
    Y: Cone
    form: Callable[[], Realization]

    @classmethod
    def of(cls, s: System) -> Connection:
        """A system that is not made of others."""

        def form() -> Realization:
            A, B, C, D = (m.plain().fractions() for m in s.matrices)
            return A, B, C, D

        return cls(s.X, s.U, s.Y, form)

    @cached_property
    def matrices(self) -> Realization:
        """A, B, C, D as arrays of Fraction."""
        return self.form()

    def system(self, dt: Any) -> System:
        """Cones and matrices together."""
        A, B, C, D = (Matrix.from_fractions(m) for m in self.matrices)
        return System(A, B, C, D, self.X, self.U, self.Y, dt)


def stacked(*cones: Cone) -> Cone:
    """Product of cones, in order; an orthant if all of them are."""
    if all(isinstance(cone, Orthant) for cone in cones):
        return nonnegative(sum(cone.dim for cone in cones))
    return product([cone for cone in cones if cone.dim])


def lies_in(inner: Cone, outer: Cone) -> bool:
    """True if the inner cone is a subset of the outer one."""
    same = inner is outer or (isinstance(inner, Orthant) and isinstance(outer, Orthant))
    return (same and inner.dim == outer.dim) or outer.contains(inner)


def opposite(cone: Cone) -> Cone:
    """-cone; the cone {0} of a system without states is its own."""
    return -cone if cone.dim else cone


def image(M: Matrix, cone: Cone) -> Cone | None:
    """A proper cone that holds M y for y in the cone: an orthant or its negative, else the image itself."""
    if not M.shape[0]:
        return nonnegative(0)
    sign = _orthant_sign(cone) * _common_sign(M)
    return _signed_orthant(M.shape[0], sign) if sign else _proper(cone.transform(exact_rows(M)))


def preimage(M: Matrix, cone: Cone) -> Cone | None:
    """A proper cone of vectors u with M u in the cone: an orthant or its negative, else all of them."""
    if not M.shape[1]:
        return nonnegative(0)
    sign = _orthant_sign(cone) * _common_sign(M)
    return _signed_orthant(M.shape[1], sign) if sign else _proper(cone.dual.transform(exact_rows(M).T).dual)


def _orthant_sign(cone: Cone) -> int:
    """1 for the nonnegative orthant, -1 for the nonpositive one, else 0."""
    if isinstance(cone, Orthant):
        return 1
    return -1 if cone == opposite(nonnegative(cone.dim)) else 0


def _common_sign(M: Matrix) -> int:
    """1 if all entries are >= 0, -1 if all are <= 0, else 0."""
    return 1 if (M.values >= 0).all() else -1 if (M.values <= 0).all() else 0


def _signed_orthant(n: int, sign: int) -> Cone:
    return nonnegative(n) if sign > 0 else opposite(nonnegative(n))


def _proper(cone: Cone) -> Cone | None:
    return cone if cone.is_proper else None


def exact_rows(M: Matrix) -> NDArray[Any]:
    """M as an array that loses nothing: doubles if they are exact, else fractions."""
    return np.asarray(M.values) if M.is_double else M.fractions()


def negate(s: Connection) -> Connection:
    """-s."""

    def form() -> Realization:
        A, B, C, D = s.matrices
        return A, B, -C, -D

    return Connection(s.X, s.U, opposite(s.Y), form)


def append(first: Connection, second: Connection) -> Connection:
    """Both systems side by side."""

    def form() -> Realization:
        A, B, C, D = (_diagonal(a, b) for a, b in zip(first.matrices, second.matrices, strict=True))
        return A, B, C, D

    return Connection(stacked(first.X, second.X), stacked(first.U, second.U), stacked(first.Y, second.Y), form)


def copies(s: Connection, count: int) -> Connection:
    """The same system `count` times side by side."""
    out = s
    for _ in range(count - 1):
        out = append(out, s)
    return out


def unit(s: Connection) -> Connection:
    """The gain 1 from the inputs of a system to themselves."""
    return gain(Matrix(np.eye(s.U.dim)), s.U, s.U)


def gain(M: Matrix, U: Cone, Y: Cone) -> Connection:
    """y = M u without states."""
    q, m = M.shape
    return Connection(
        nonnegative(0), U, Y, lambda: (_zeros(0, 0), _zeros(0, m), _zeros(q, 0), M.fractions() + _zeros(q, m))
    )


def _is_siso(s: Connection) -> bool:
    return s.U.dim == s.Y.dim == 1


def _spread(s: Connection, outputs: int, inputs: int) -> Connection | None:
    """A system with one input and one output between all inputs and all outputs, as python-control does it."""
    return output_gain(copies(s, inputs), Matrix(np.ones((outputs, inputs))))


def select(s: Connection, inputs: Sequence[int], outputs: Sequence[int]) -> Connection | None:
    """Some inputs and outputs, given by their numbers."""
    chosen = output_gain(s, Matrix(np.eye(s.Y.dim)[outputs]))
    return None if chosen is None else input_gain(chosen, Matrix(np.eye(s.U.dim)[:, inputs]))


def output_gain(s: Connection, M: Matrix) -> Connection | None:
    """M s: outputs multiplied by M."""
    if _is_siso(s):
        s = copies(s, M.shape[1])
    Y = image(M, s.Y)

    def form() -> Realization:
        A, B, C, D = s.matrices
        return A, B, M.fractions() @ C, M.fractions() @ D

    return None if Y is None else Connection(s.X, s.U, Y, form)


def input_gain(s: Connection, M: Matrix) -> Connection | None:
    """s M: inputs multiplied by M before they enter."""
    if _is_siso(s):
        s = copies(s, M.shape[0])
    U = preimage(M, s.U)

    def form() -> Realization:
        A, B, C, D = s.matrices
        return A, B @ M.fractions(), C, D @ M.fractions()

    return None if U is None else Connection(s.X, U, s.Y, form)


def scale(s: Connection, factor: Fraction) -> Connection:
    """B and D multiplied by a number, as python-control does it for s * factor and factor * s.

    A negative factor turns states and outputs around and leaves the inputs as they are.
    """
    X, Y = (s.X, s.Y) if factor >= 0 else (opposite(s.X), opposite(s.Y))

    def form() -> Realization:
        A, B, C, D = s.matrices
        return A, B * factor, C, D * factor

    return Connection(X, s.U, Y, form)


def add_gain(s: Connection, M: Matrix) -> Connection | None:
    """s + M: M joins the direct term."""
    if _is_siso(s) and M.shape != (1, 1):
        spread = _spread(s, *M.shape)
        return None if spread is None else add_gain(spread, M)
    if not maps_into(M, s.U, s.Y):
        return None

    def form() -> Realization:
        A, B, C, D = s.matrices
        return A, B, C, D + M.fractions()

    return replace(s, form=form)


def parallel(first: Connection, second: Connection) -> Connection | None:
    """Outputs added, one input for both."""
    if _is_siso(first) and not _is_siso(second):
        spread = _spread(first, second.Y.dim, second.U.dim)
        return None if spread is None else parallel(spread, second)
    if _is_siso(second) and not _is_siso(first):
        spread = _spread(second, first.Y.dim, first.U.dim)
        return None if spread is None else parallel(first, spread)
    U = _narrower(first.U, second.U)
    Y = _wider(first.Y, second.Y)
    if U is None or Y is None:
        return None

    def form() -> Realization:
        (A1, B1, C1, D1), (A2, B2, C2, D2) = first.matrices, second.matrices
        return _diagonal(A1, A2), np.vstack([B1, B2]), np.hstack([C1, C2]), D1 + D2

    return Connection(stacked(first.X, second.X), U, Y, form)


def _narrower(a: Cone, b: Cone) -> Cone | None:
    return a if lies_in(a, b) else b if lies_in(b, a) else _proper(a & b)


def _wider(a: Cone, b: Cone) -> Cone | None:
    return a if lies_in(b, a) else b if lies_in(a, b) else _proper(a + b)


def series(outer: Connection, inner: Connection) -> Connection | None:
    """outer * inner: the output of the inner system drives the outer one."""
    if _is_siso(outer) and not _is_siso(inner):
        outer = copies(outer, inner.Y.dim)
    elif _is_siso(inner) and not _is_siso(outer):
        inner = copies(inner, outer.U.dim)
    if not lies_in(inner.Y, outer.U):
        return None

    def form() -> Realization:
        (A1, B1, C1, D1), (A2, B2, C2, D2) = outer.matrices, inner.matrices
        A = np.block([[A2, _zeros(len(A2), len(A1))], [B1 @ C2, A1]])
        return A, np.vstack([B2, B1 @ D2]), np.hstack([D1 @ C2, C1]), D1 @ D2

    return Connection(stacked(inner.X, outer.X), inner.U, outer.Y, form)


def feedback(plant: Connection, other: Connection, D1: Matrix, D2: Matrix, sign: Fraction) -> Connection | None:
    """The plant with u = r + sign y2, where the other system maps the plant's y to y2.

    Parameters
    ----------
    plant, other : Connection
    D1, D2 : Matrix
        Direct terms of the plant and of the other system.
    sign : Fraction
        Gain in the feedback path, of any size.

    Returns
    -------
    Connection or None
        None also if sign D2 D1, which maps U1 into itself, has a spectral radius of 1 or more: only below 1
        does (I - sign D2 D1)^-1 = I + sign D2 D1 + ... map U1 into U1.
    """
    returned = other.Y if sign >= 0 else opposite(other.Y)
    if not lies_in(plant.Y, other.U) or not (sign == 0 or lies_in(returned, plant.U)):
        return None
    return _closed(plant, other, D1, D2, sign)


def feedback_gain(plant: Connection, K: Matrix, D1: Matrix, sign: Fraction) -> Connection | None:
    """The plant with u = r + sign K y for a matrix K."""
    signed = Matrix.from_fractions(K.fractions() * sign)
    if not maps_into(signed, plant.Y, plant.U):
        return None
    # the cones of K are those of the plant, the other way round
    return _closed(plant, gain(K, plant.Y, plant.U), D1, K, sign)


def _closed(plant: Connection, other: Connection, D1: Matrix, D2: Matrix, sign: Fraction) -> Connection | None:
    direct = bool(sign and np.any(D1.values) and np.any(D2.values))
    if direct:
        loop = Matrix.from_fractions(sign * (D2.fractions() @ D1.fractions()))
        if not linear_lyapunov(loop, plant.U, discrete=True):
            return None

    def form() -> Realization:
        (A1, B1, C1, D1f), (A2, B2, C2, D2f) = plant.matrices, other.matrices
        E = _identity(len(D2f))
        if direct:
            E = _inverse(E - sign * (D2f @ D1f))
        # u1 = E (r + sign D2 C1 x1 + sign C2 x2), then everything else follows from u1
        u1 = np.hstack([sign * (E @ (D2f @ C1)), sign * (E @ C2)])
        C = np.hstack([C1, _zeros(len(C1), len(A2))]) + D1f @ u1
        D = D1f @ E
        A = _diagonal(A1, A2) + np.vstack([B1 @ u1, B2 @ C])
        return A, np.vstack([B1 @ E, B2 @ D]), C, D

    return Connection(stacked(plant.X, other.X), plant.U, plant.Y, form)


def lower_lft(plant: Connection, other: Connection, D1: Matrix, D2: Matrix, n_u: int, n_y: int) -> Connection | None:
    """The plant with its last n_y outputs and n_u inputs closed through the first inputs and outputs of the other.

    ::

        w  ---> [       ] ---> z
        u2 ---> [ plant ] ---> y2          y2 ---> [ other ] ---> u2
                                           w' ---> [       ] ---> z'
    """
    both = append(plant, other)
    direct = Matrix.from_fractions(_diagonal(D1.fractions(), D2.fractions()))
    m, q = plant.U.dim, plant.Y.dim
    K = np.zeros((both.U.dim, both.Y.dim))
    K[np.arange(m - n_u, m), np.arange(q, q + n_u)] = 1
    K[np.arange(m, m + n_y), np.arange(q - n_y, q)] = 1
    loop = feedback_gain(both, Matrix(K), direct, Fraction(1))
    if loop is None:
        return None
    inputs = [*range(m - n_u), *range(m + n_y, both.U.dim)]
    return select(loop, inputs, [*range(q - n_y), *range(q + n_u, both.Y.dim)])


def transform(s: Connection, T: Matrix, timescale: Fraction, inverse: bool) -> Connection | None:
    """New states z = T x, or x = T z with `inverse`, and a clock that shows timescale * t.

    Returns None if T is singular or time would run backwards.
    """
    rows = exact_rows(T)
    if _permutes_axes(rows) and isinstance(s.X, Orthant):
        X = s.X
    else:
        X = _proper(s.X.dual.transform(rows.T).dual if inverse else s.X.transform(rows))
    if X is None or not timescale > 0:
        return None

    def form() -> Realization:
        back = _inverse(T.fractions())
        forward, away = (back, T.fractions()) if inverse else (T.fractions(), back)
        A, B, C, D = s.matrices
        return forward @ A @ away / timescale, forward @ B / timescale, C @ away, D

    return replace(s, X=X, form=form)


def _permutes_axes(T: NDArray[Any]) -> bool:
    """True if T maps the nonnegative orthant onto itself."""
    nonzero = T != 0
    return bool((nonzero.sum(axis=0) == 1).all() and (nonzero.sum(axis=1) == 1).all() and (T >= 0).all())


def _zeros(rows: int, columns: int) -> Rationals:
    return np.full((rows, columns), Fraction(0), dtype=object)


def _identity(n: int) -> Rationals:
    return _zeros(n, n) + np.eye(n, dtype=int)


def _diagonal(a: Rationals, b: Rationals) -> Rationals:
    return np.block([[a, _zeros(a.shape[0], b.shape[1])], [_zeros(b.shape[0], a.shape[1]), b]])


def _inverse(M: Rationals) -> Rationals:
    """The inverse of a matrix that has one: I - sign D2 D1 with a spectral radius below 1, or T with a solid image."""
    integers, factor = Matrix.from_fractions(M).as_integers()
    solution = solve_exactly(integers, np.eye(len(M), dtype=int).astype(object))
    if solution is None:
        raise TooLargeError(f"the inverse of a {len(M)} x {len(M)} matrix is out of reach of exact arithmetic.")
    return solution[0] * (1 / (Fraction(solution[1]) * factor))
