"""Plant: the exact matrices of all vertices, the cone, and the demands on the gain, as a design reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import lcm
from typing import Any

import numpy as np
import scipy.sparse as sp
from control import StateSpace
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone
from ..errors import (
    DataError,
    NotProperConeError,
    ShapeError,
)
from ..exact.intake import exact_matrix, flag, found, items, real_number, require_shape
from ..exact.matrix import Matrix
from ..systems.system import System

Floats = NDArray[np.float64]

# Powers of two by which the lengths of generators as they were given have to be better.
_FAR = 6

_LABELS = {"inputs": "input_labels", "outputs": "output_labels", "states": "state_labels"}


@dataclass(frozen=True, eq=False)
class Interval:
    """Bounds that hold for all time: x in [0, x_max], |u_i| <= u_i, for w in [0, w_max], in the order of X.

    Attributes
    ----------
    x_max : Matrix, shape (n,), or None
        None: any that does.
    u_max : Matrix, shape (m,), or None
    w_max : Matrix, shape (n,)
    """

    x_max: Matrix | None
    u_max: Matrix | None
    w_max: Matrix


@dataclass(frozen=True, eq=False)
class Plant:
    """x' = A_s x + B_s u, with demands on u = F x or u = K y.

    Attributes
    ----------
    system : System
        With C, D, U, Y; its A and B count only where they are the first vertex.
    vertices : tuple of (Matrix, Matrix)
        (A_s, B_s); one pair without uncertainty.
    reads : Matrix or None
        C of output feedback, u = K C x.
    gain_bound : ndarray, shape (m,), or None
        |F x_k| <= gain_bound at every generator x_k of X with a leading entry of 1, input by input.
    pattern : ndarray of bool, shape (m, n) or (m, q), or None
        Where the gain may differ from zero.
    ports : bool
        True: B U in X and (C + D F) X in Y are demanded as well.
    coupling : Matrix or None
        Stability is asked of A + B F + coupling, invariance of A + B F.
    disturbance : tuple of Matrix, or None
        (E, G, H, D): the L-infinity gain from w to z in x' = (A + B F) x + E w, z = (G + H F) x + D w is bounded.
    interval : Interval or None
        Bounds on states and inputs for all time.
    gap : float
        Part by which the gain may exceed the smallest one, for decay, margins and few digits.
    names : mapping
        Labels of inputs, outputs and states.
    """

    system: System
    vertices: tuple[tuple[Matrix, Matrix], ...]
    reads: Matrix | None = None
    gain_bound: Floats | None = None
    pattern: NDArray[np.bool_] | None = None
    ports: bool = False
    coupling: Matrix | None = None
    disturbance: tuple[Matrix, Matrix, Matrix, Matrix] | None = None
    interval: Interval | None = None
    gap: float = 1e-3
    names: Mapping[str, Any] = field(default_factory=dict)
    # states, inputs, shape of the gain, and two of the system's own, read far more often than set
    n: int = field(init=False)
    m: int = field(init=False)
    shape: tuple[int, int] = field(init=False)
    X: Cone = field(init=False)
    discrete: bool = field(init=False)

    def __post_init__(self) -> None:
        n, m = self.vertices[0][1].shape
        shape = m, n if self.reads is None else self.reads.shape[0]
        vars(self).update(n=n, m=m, shape=shape, X=self.system.X, discrete=bool(self.system.dt))

    @cached_property
    def pairs(self) -> list[tuple[Floats, Floats]]:
        """(A_s, B_s) as doubles."""
        return [(np.asarray(A.values), np.asarray(B.values)) for A, B in self.vertices]

    @cached_property
    def rays(self) -> Floats:
        """Generators of X, of lengths that programs cope with."""
        return self._coordinates[0]

    @cached_property
    def sizes(self) -> Floats:
        """Sizes of the leading entries of `rays`: gains are measured at the generators divided by these."""
        return self._coordinates[1]

    @cached_property
    def _coordinates(self) -> tuple[Floats, Floats]:
        return coordinates(self.X, self.facets, [A for A, _ in self.pairs])

    @cached_property
    def facets(self) -> Floats:
        """Facets of X; for a simplicial cone facets[i] is the one opposite rays[i]."""
        return np.asarray(self.X.facets, dtype=float)[self.facet_order]

    @cached_property
    def facet_order(self) -> NDArray[np.intp]:
        """Facet opposite every ray, for a simplicial cone; all of them in order otherwise."""
        if not self.X.is_simplicial:
            return np.arange(self.X.n_facets)
        return np.argmin(np.asarray(self.X.incidence), axis=0)

    @cached_property
    def incidence(self) -> NDArray[np.bool_]:
        """Pairs (facet, ray) with h'x = 0, in the order of `facets`; in discrete time all pairs."""
        where = np.asarray(self.X.incidence, dtype=bool)[self.facet_order]
        return np.ones_like(where) if self.discrete else where

    @cached_property
    def scale(self) -> float:
        """Size of A seen in the generators of X, per unit of time; of B, if A is zero or next to it.

        The size of B depends on the units of the inputs.
        """
        heights = np.maximum((self.facets @ self.rays.T).max(axis=1), np.finfo(float).tiny)
        H = self.facets / heights[:, None]
        size = max(np.abs(H @ A @ self.rays.T).max() for A, _ in self.pairs)
        push = max(np.abs(H @ B).max(initial=0.0) for _, B in self.pairs)
        return float(max(size, 1e-9 * push if size > 0 else push, 1e-300))

    @cached_property
    def free(self) -> NDArray[np.bool_] | None:
        """Which F t_k may differ from zero, shape (n, m), if the pattern says just that; None if it does not.

        F = G T^{-1} keeps a pattern of F that follows the blocks of a block diagonal T.
        """
        free = np.ones((self.n, self.m), dtype=bool)
        if self.pattern is None:
            return free
        reach = (self.rays != 0).T  # states x generators
        linked = (reach.astype(int) @ reach.T.astype(int)) > 0
        closure = np.linalg.matrix_power(linked.astype(float), self.n) > 0
        for j, row in enumerate(self.pattern):
            if (closure[np.ix_(row, ~row)]).any():
                return None
            free[:, j] = [bool(row[np.flatnonzero(reach[:, k])[0]]) for k in range(self.n)]
        return free

    @cached_property
    def seen(self) -> Floats:
        """What the gain reads at the generators, one a column: x_k, or C x_k."""
        return self.rays.T if self.reads is None else np.asarray(self.reads.values) @ self.rays.T

    def gain_of(self, F: Floats) -> float:
        """max |F x_k| over inputs and generators x_k of X with leading entries 1; of F C x_k for output feedback."""
        return float((np.abs(np.asarray(F, dtype=float) @ self.seen) / self.sizes).max(initial=0.0))


# -- lengths of generators, which have no meaning


def leading(rows: NDArray[Any]) -> NDArray[np.intp]:
    """Where the leading entry of each row is: the first that has at least an eighth of the size of the largest.

    A gain is measured at generators scaled to a leading entry of 1 (or -1): equal cones have equal ones.

    >>> leading(np.array([[0, 1], [1, -2], [1, 9]])).tolist()
    [1, 0, 1]
    """
    sizes = np.abs(rows)
    return np.argmax(8 * sizes >= sizes.max(axis=1, keepdims=True), axis=1)


def leading_sizes(rows: NDArray[Any]) -> NDArray[Any]:
    """The sizes of the leading entries."""
    return np.abs(rows[np.arange(len(rows)), leading(rows)])


def coordinates(X: Cone, facets: Floats, drifts: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Generators of a cone in doubles, and the sizes of their leading entries.

    They have leading entries of 1; or the lengths that they were given, where these go with the units of the states:
    the entries of A, seen in the generators, are of sizes that are less far apart.

    Parameters
    ----------
    X : Cone
    facets : ndarray, shape (r, n)
    drifts : sequence of ndarray, shape (..., n, n)
    """
    rays, exact = np.asarray(X.rays, dtype=float), X.exact_rays
    every = np.arange(len(rays))
    sizes = np.abs(rays[every, leading(rays if exact.is_double else exact.rows_as_integers(every))])
    unit = rays / sizes[:, None]
    if (sizes == 1).all() or _range(unit, facets, drifts) <= _range(rays, facets, drifts) + _FAR:
        return unit, np.ones(len(rays))
    return rays, sizes


def _range(rays: Floats, facets: Floats, drifts: Sequence[Floats]) -> int:
    """Powers of two between the entries of A seen in these generators, and in facets of height 1 over them."""
    heights = np.maximum((facets @ rays.T).max(axis=1), np.finfo(float).tiny)
    seen = [facets / heights[:, None] @ A @ rays.T for A in drifts]
    exponents = np.frexp(np.concatenate([M[M != 0] for M in seen]))[1]
    return int(np.ptp(exponents)) if exponents.size else 0


# -- exact sums and products


def closed_loop(A: Matrix, B: Matrix, F: Matrix) -> Matrix:
    """A + B F exactly; of stacks, for each matrix."""
    if B.is_zero:
        return A
    (a, unit), (b, first), (f, second) = A.as_integers(), B.as_integers(), F.as_integers()
    own, product = Fraction(unit), Fraction(first) * second
    # integers throughout: sums and products of fractions take ten times as long
    common = lcm(own.denominator, product.denominator)
    left, right = int(own * common), int(product * common)
    return Matrix.over(a * left + (b @ f) * right, common)


def times(left: Matrix, right: Matrix) -> Matrix:
    """left right exactly; of stacks, for each matrix."""
    (a, unit), (b, other) = left.as_integers(), right.as_integers()
    factor = Fraction(unit) * other
    return Matrix.over((a @ b) * factor.numerator, factor.denominator)


def shifted(A: Matrix, number: float | Fraction) -> Matrix:
    """A + number I exactly."""
    n = A.shape[-1]
    scaled = Matrix.from_fractions(np.eye(n, dtype=int).astype(object) * Fraction(number))
    return closed_loop(A, Matrix.identity(n), scaled) if number else A


# -- arguments


def read_plant(
    sys: Any,
    X: Cone | ArrayLike | None,
    *,
    gain_bound: ArrayLike | None = None,
    structure: ArrayLike | None = None,
    vertices: Sequence[Any] | None = None,
    ports: bool = False,
    output: bool = False,
    gap: float = 1e-3,
) -> Plant:
    """Check the arguments of a design and gather them.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, NotProperConeError
        Naming the argument, what was found and what to do.
    """
    system = read_system(sys, X)
    system.X.require_proper("X")
    n, m, q = system.sizes
    if m == 0:
        raise ShapeError("the system has no inputs: there is nothing to feed back to.")
    pairs = [(system.A, system.B)]
    if vertices is not None:
        pairs = [_vertex(v, s, n, m) for s, v in enumerate(items(vertices, "vertices"))]
        if not pairs:
            raise ShapeError("vertices is empty; give at least one pair (A, B), or leave it out.")
    return Plant(
        system,
        tuple(pairs),
        system.C if output else None,
        read_bound(gain_bound, m),
        _pattern(structure, m, q if output else n),
        flag(ports, "ports"),
        gap=real_number(gap, "gap", positive=True),
        names={} if isinstance(sys, System) else {key: getattr(sys, label) for key, label in _LABELS.items()},
    )


def read_system(sys: Any, X: Cone | ArrayLike | None) -> System:
    """The exact data of sys, with the cone X if one is given."""
    if not isinstance(sys, (StateSpace, System)):
        raise DataError(f"sys is a {type(sys).__name__}; give a ConeStateSpace or what control.ss returns.")
    system = System.read(sys, X=X)
    if not system.A.shape[0]:
        raise ShapeError("sys has no states; there is nothing to design.")
    return system


def refuse_cone(X: Any) -> None:
    """Raise if a cone is given for a large network."""
    if X is not None:
        raise DataError("the cone of a large network is that of its nodes; leave X out, and give the nodes theirs.")


def in_sparse_form(M: Matrix, name: str) -> Matrix:
    """The matrix in sparse form; DataError if it holds fractions."""
    if not M.is_double:
        raise DataError(
            f"{name} of a network in sparse matrices must hold doubles. Round the fractions yourself: what is proven "
            "is then about the rounded numbers."
        )
    return M if M.is_sparse else Matrix(sp.csr_array(M.values))


def _vertex(vertex: Any, s: int, n: int, m: int) -> tuple[Matrix, Matrix]:
    if isinstance(vertex, StateSpace):
        vertex = System.read(vertex, f"vertices[{s}]").matrices[:2]
    if not isinstance(vertex, (tuple, list)) or len(vertex) != 2:
        raise ShapeError(f"vertices[{s}] is not a pair (A, B); give one pair of matrices for each vertex.")
    A, B = exact_matrix(vertex[0], f"vertices[{s}][0]"), exact_matrix(vertex[1], f"vertices[{s}][1]")
    require_shape(A, f"vertices[{s}][0]", (n, n), f"the system has {n} states")
    require_shape(B, f"vertices[{s}][1]", (n, m), f"the system has {n} states and {m} inputs")
    return A, B


def read_bound(bound: ArrayLike | None, m: int) -> Floats | None:
    """A bound on |F x| for each of m inputs, from one number or m of them; 0 is allowed."""
    if bound is None:
        return None
    # the doubles below: what is proven for them holds for the bound that was given
    values = exact_matrix(bound, "gain_bound", ndim=1).rounded(up=False)
    if values.shape == (1,):
        values = np.full(m, values[0])
    if values.shape != (m,):
        raise ShapeError(
            f"gain_bound has {values.size} entries, and the gain {m} rows; give one number, or one for each."
        )
    if not (values >= 0).all():
        raise DataError(f"gain_bound is {values.min():g}; a bound on |F x| cannot be negative.")
    return values


def _pattern(structure: ArrayLike | None, m: int, width: int) -> NDArray[np.bool_] | None:
    if structure is None:
        return None
    try:
        mask = np.asarray(structure)
    except Exception:  # noqa: BLE001  (ragged; or the object's own conversion, which may raise anything)
        raise ShapeError(f"structure is {found(structure)}, but must be a {m} x {width} matrix.") from None
    if mask.shape != (m, width):
        shape = " x ".join(map(str, mask.shape))
        raise ShapeError(f"structure is {shape}, but the gain is {m} x {width}; mark entries that may differ from 0.")
    if mask.dtype.kind not in "bif" or not np.isin(mask, (0, 1)).all():
        raise DataError("structure must hold booleans (or 0 and 1): True where the gain may differ from 0.")
    return mask.astype(bool)


def require_simplicial(X: Cone, what: str) -> None:
    """Raise unless X has as many generators as dimensions."""
    if not X.is_simplicial:
        raise NotProperConeError(
            f"{what} needs a simplicial cone (as many generators as dimensions); X has {X.n_rays} generators "
            f"in dimension {X.dim}."
        )
