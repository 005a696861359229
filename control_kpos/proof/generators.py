"""Positivity of a system on a cone of which generators are known, and facets are too many.

With the generators as columns of R, Theorem 1 reads: e^{At} X stays in X (A X lies in X) and B U in X if

    A R = R P,  P off-diagonal >= 0  (discrete time: P >= 0),      B u_i = R n_i,  n_i >= 0,
    w'R > 0                          (the cone is pointed),
    R Y = I for some Y               (the cone is solid).

For polyhedral cones this is necessary too.  A column of P that does not exist has a reason, by Farkas' lemma: a vector
h with h'x >= 0 on all generators, h'x_j = 0 and h'A x_j < 0, a supporting hyperplane that the field crosses.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..cones.hull import LIMIT, Allowance
from ..errors import DataError, TooLargeError
from ..exact.condition import Condition
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.rational_programs import exact_feasibility
from ..exact.signs import BilinearForms
from .encoding import register_record
from .multipliers import Frame, nonnegative_combination, pointing_functional
from .portable_cones import given_generators, portable_rows

_POINTED, _STATE, _INPUT = "w'x > 0", "A R = R P", "B U = R N"
SUPPORTING = "h'x >= 0 on X"
# Conditions that say nothing about how far the system is from losing positivity, or a violation from being none.
NO_MARGIN = frozenset({_POINTED, "R Y = I", SUPPORTING})
# Below this a margin may be rounding of the solver.
_STRICT = 1e-9
# Below this the tolerances of the solver have eaten from it.
_CLOSE = 1e-6
# Multiplications of machine words for all rational columns together, some ten seconds, and for the worst of them.
_WORK = 10**10
# Binary digits of all rational multipliers together.
_DIGITS = 4 * 10**8


@register_record
@dataclass(frozen=True, eq=False)
class GeneratorProof:
    """What proves positivity without facets.

    Attributes
    ----------
    pointing : ndarray, shape (n,)
        w with w'x > 0 for every generator.
    right_inverse : ndarray, shape (N, n)
        Y with R Y close to the identity.
    multipliers : Matrix, shape (N, N), or None
        P with A R = R P up to an error that the proof takes up; None beside a violation.
    shares : Matrix, shape (N, k), or None
        B u_i = R n_i likewise, for the generators u_i of U.
    """

    pointing: NDArray[np.float64]
    right_inverse: NDArray[np.float64]
    multipliers: Matrix | None = None
    shares: Matrix | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                view = value.view()
                view.flags.writeable = False
                object.__setattr__(self, field.name, view)

    def conditions(self, A: Matrix, X: Cone, B: Matrix | None, U: Cone | None, *, discrete: bool) -> list[Condition]:
        """The inequalities and equations above, proven from the data and nothing else."""
        rays = own_generators(X)
        basis = Generators(rays, self.right_inverse)
        out: list[Condition] = [pointed(rays, self.pointing), basis.solid()]
        if self.multipliers is None:
            raise DataError("the multipliers are missing.")
        columns = [(_STATE, A, rays, self.multipliers, _signed(rays.shape[0], discrete))]
        if B is not None and U is not None:
            inputs = portable(U.exact_rays)
            if self.shares is None:
                raise DataError("the shares of the inputs are missing.")
            columns.append((_INPUT, B, inputs, self.shares, np.ones((rays.shape[0], inputs.shape[0]), dtype=bool)))
        for name, M, sources, weights, required in columns:
            if weights.shape != required.shape:
                raise DataError(f"{name}: {weights.shape} weights do not fit {required.shape} columns.")
            out.append(basis.combination(name, [(M.plain(), sources)], weights, required))
        return out


class Crossing(NamedTuple):
    """A supporting hyperplane of X and a generator that A (of X) or B (of U) takes across it."""

    matrix: str
    normal: NDArray[np.object_]
    ray: int


def own_generators(X: Cone) -> Matrix:
    """The generators of X as they were given, with lengths that files keep."""
    return portable(given_generators(X))


def portable(rows: Matrix) -> Matrix:
    """Dense rows with one common factor, of the lengths that they have in files."""
    return rows.plain() if rows.integer_rows is None else Matrix.from_fractions(portable_rows(rows))


def pointed(rays: Matrix, w: NDArray[np.float64]) -> Condition:
    """w is positive on all generators."""
    return Condition(_POINTED, BilinearForms(Matrix(np.asarray(w, dtype=float)[None, :]), None, rays), ">")


def prove(
    A: Matrix, X: Cone, B: Matrix | None, U: Cone | None, *, discrete: bool
) -> tuple[GeneratorProof, Crossing | None] | None:
    """Find the multipliers, or a supporting hyperplane that is crossed.

    Returns
    -------
    GeneratorProof, Crossing or None
        With a crossing, the proof is about the cone alone.
    None instead of both if neither was found within the work that conversions of cones may take.

    Notes
    -----
    One linear program of n rows for each generator of X and of U, a millisecond or two; rational arithmetic where
    some weight has to be zero.
    """
    rays = own_generators(X)
    values = np.asarray(rays.values)
    w = pointing_functional(values)
    frame = Frame.of(values, w)
    if frame is None:
        return None
    inverse = (np.linalg.pinv(frame.R) @ frame.to) / frame.heights[:, None]
    about_cone = GeneratorProof(w, inverse)
    search = _Search(rays, frame, Generators(rays, inverse))
    found: dict[str, Matrix] = {}
    sources = [("A", A, rays)] + ([] if B is None or U is None else [("B", B, portable(U.exact_rays))])
    for name, M, vectors in sources:
        free = name == "A" and not discrete
        try:
            weights = search.weights(M.plain(), vectors, free=free)
        except TooLargeError:
            return None
        if isinstance(weights, tuple):
            return about_cone, Crossing(name, *weights)
        found[name] = weights
    return GeneratorProof(w, inverse, found["A"], found.get("B")), None


def combinations(X: Cone, proof: GeneratorProof, M: Matrix, vectors: Matrix) -> Matrix | None:
    """Q >= 0 with M x_j = R Q_j up to an error that the proof takes up; None if it does not exist or is not found.

    Parameters
    ----------
    X : Cone
    proof : GeneratorProof
        Knows a vector positive on X, and a right inverse.
    M : Matrix, shape (n, k)
    vectors : Matrix, shape (c, k)
    """
    rays = own_generators(X)
    frame = Frame.of(np.asarray(rays.values), proof.pointing)
    if frame is None:
        return None
    try:
        found = _Search(rays, frame, Generators(rays, proof.right_inverse)).weights(M, vectors, free=False)
    except TooLargeError:
        return None
    return None if isinstance(found, tuple) else found


class _Search:
    """Looks for nonnegative combinations of generators."""

    def __init__(self, rays: Matrix, frame: Frame, basis: Generators) -> None:
        self.rays, self.frame, self.basis = rays, frame, basis
        self.allowance = Allowance(LIMIT)
        self.digits = 0

    def weights(self, M: Matrix, vectors: Matrix, *, free: bool) -> Matrix | tuple[NDArray[np.object_], int]:
        """Q with M x_j = R Q_j; or a vector h and some j, with h'M x_j < 0 and h'x >= 0 on the cone.

        `free`: the vectors are the generators, Q_jj may have any sign, and h'x_j = 0.
        """
        frame, heights = self.frame, self.frame.heights
        scale = heights if free or vectors is self.rays else np.ones(vectors.shape[0])
        with np.errstate(all="ignore"):
            images = frame.to @ (np.asarray(M.values) @ (np.asarray(vectors.values) / scale[:, None]).T)
        size = float(np.abs(images).max(initial=0.0))
        size = size if 0 < size < np.inf else 1.0
        N, n = self.rays.shape
        columns: list[NDArray] = []
        margins = np.empty(vectors.shape[0])
        for j in range(vectors.shape[0]):
            self.allowance.take(20 * N * n, N, n)
            p, margins[j] = nonnegative_combination(frame, images[:, j], j if free else None, size=size)
            if vectors is self.rays and not margins[j] > _CLOSE:
                p, margins[j] = self._closer(images[:, j], j, p, margins[j], free)
            columns.append(p * scale[j] / heights)
        doubtful = [int(j) for j in np.argsort(margins) if not margins[j] > _STRICT]
        for k, j in enumerate(doubtful):
            exact = self._exact(M, vectors, j, free, len(doubtful) if k else 1)  # the worst may settle it
            if isinstance(exact, tuple):
                return exact
            columns[j] = exact
        Q = _stacked(columns)
        required = _signed(len(columns), not free) if vectors is self.rays else np.ones(Q.shape, dtype=bool)
        bounds = self.basis.combination("", [(M, vectors)], Q, required)
        failing = np.asarray((~((bounds.lower > 0) | bounds.exact) & required).any(axis=0))
        failing[doubtful] = False
        if not failing.any():
            return Q
        for j in np.flatnonzero(failing):
            exact = self._exact(M, vectors, int(j), free, int(failing.sum()))
            if isinstance(exact, tuple):
                return exact
            columns[j] = exact
        return _stacked(columns)

    def _closer(
        self, image: NDArray[np.float64], j: int, p: NDArray[np.float64], margin: float, free: bool
    ) -> tuple[NDArray[np.float64], float]:
        """Column j once more, in units of what the image has besides x_j: steps of fine discretisations are short."""
        own = p[j]
        rest = image - own * self.frame.R[:, j]
        size = float(np.abs(rest).max())
        if not 0 < size < np.inf:
            return p, margin
        closer, better = nonnegative_combination(self.frame, rest, j, size=size)
        closer[j] += own
        return (closer, better) if better > _STRICT and (free or closer[j] > 0) else (p, margin)

    def _exact(
        self, M: Matrix, vectors: Matrix, j: int, free: bool, count: int
    ) -> NDArray[np.object_] | tuple[NDArray[np.object_], int]:
        """Column j in rational numbers, for one part in `count` of the work, or the reason why there is none."""
        N, n = self.rays.shape
        R = self.rays.fractions().T
        image = M.fractions() @ Matrix.from_fractions(vectors.fractions()[[j]]).fractions()[0]
        if not image.any():
            return np.full(N, Fraction(0), dtype=object)
        matrix = np.concatenate([R, -R[:, [j]]], axis=1) if free else R
        digits = max(int(x).bit_length() for x in np.abs(self.rays.as_integers()[0]).ravel())
        self.allowance.take(2.4 * n**3 * (1 + n * digits / 1024) ** 1.6, N, n)
        try:
            x, h = exact_feasibility(matrix, image, work_limit=_WORK / count)
        except DataError:
            raise TooLargeError(f"the numbers of column {j} are too long for a linear program.") from None
        if h is not None or x is None:
            return np.asarray(h, dtype=object), j
        if free:
            x[j] -= x[-1]
            x = x[:-1]
        self.digits += N * N * max(Fraction(v).denominator.bit_length() for v in x)
        if self.digits > _DIGITS:
            raise TooLargeError("the multipliers are too long.")
        return x


def _signed(N: int, discrete: bool) -> NDArray[np.bool_]:
    """Entries of P that must not be negative."""
    return np.ones((N, N), dtype=bool) if discrete else ~np.eye(N, dtype=bool)


def _stacked(columns: list[NDArray]) -> Matrix:
    if all(c.dtype != object for c in columns):
        return Matrix(np.array(columns).T)
    rows = Matrix.from_fractions(np.array([[Fraction(x) for x in c] for c in columns], dtype=object))
    return rows.T
