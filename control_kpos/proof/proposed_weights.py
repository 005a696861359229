"""Proposed weights: vectors as nonnegative combinations of generators, by linear programs; nothing here is trusted.

Columns of P with A R = R P are sought as far inside the allowed signs as possible, for each generator x_j:

    maximise t   subject to   R p = A x_j,   p_i >= t s_i   (i != j in continuous time),

in coordinates where the generators are well spread.  A strictly positive t survives rounding; where
t = 0 the structure of A asks for exact zeros, and exact rational arithmetic takes over.  What is found
is proven by `inclusion.GeneratorProof`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..cones.hull import LIMIT, Allowance
from ..errors import DataError, TooLargeError
from ..exact.budget import spend
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.program import Block, Program, widest
from ..exact.programs import program_effort
from ..exact.rational_programs import exact_combination
from .inclusion import GeneratorProof
from .portable_cones import own_generators, portable

Array = NDArray[np.float64]

# Below this a margin may be rounding of the solver.
_STRICT = 1e-9
# Below this the tolerances of the solver have eaten from it.
_CLOSE = 1e-6
# Multiplications of machine words for all rational columns together, some ten seconds, and for the worst of them.
_WORK = 10**10
# Binary digits of all rational weights together.
_DIGITS = 4 * 10**8
# Rational columns above this dimension take seconds each.
_EXACT_DIMENSION = 40


@dataclass(frozen=True, eq=False)
class Frame:
    """Generators in coordinates where they have heights w'x = 1 and are well spread.

    Attributes
    ----------
    R : ndarray, shape (n, N)
        Generators of height 1.
    heights : ndarray, shape (N,)
        w'x of the original generators.
    to, back : ndarray, shape (n, n)
        R = to @ original / heights.
    """

    R: Array
    heights: Array
    to: Array
    back: Array

    @classmethod
    def of(cls, rays: Array, pointing: Array) -> Frame | None:
        """None if some generator has no positive height, or the generators span too little as far as can be seen."""
        heights = rays @ pointing
        if not (heights > 0).all():
            return None
        R = (rays / heights[:, None]).T
        try:
            u, s, _ = np.linalg.svd(R, full_matrices=False)
        except np.linalg.LinAlgError:
            return None
        if len(s) < len(R) or not s[-1] > 1e-14 * s[0]:
            return None
        to = (u / s).T
        spread = to @ R
        # What should be zero is, or a solver would scale rounding errors up.
        return cls(np.where(np.abs(spread) < 1e-14, 0.0, spread), heights, to, u * s)


def pointing_functional(rays: Array) -> Array:
    """w with w'x well above 0 for every generator of length 1, by a linear program."""
    return widest(rays / np.linalg.norm(rays, axis=1, keepdims=True))[0]


def nonnegative_combination(
    frame: Frame, target: Array, free: int | None = None, *, size: float
) -> tuple[Array, float]:
    """Coefficients p with R p = target and the largest t with p_i >= t; `free` is left out.

    `size` is what t is measured against; a target far below it is rounding.

    Returns
    -------
    p : ndarray, shape (N,)
        In units of the frame's generators (of height 1).
    t : float
        -inf if no combination was found.
    """
    N = frame.R.shape[1]
    unit, lower = np.ones(N), np.zeros(N)
    if free is not None:
        unit[free], lower[free] = 0.0, -np.inf
    # p = z + t unit with z >= 0 keeps the program small: n rows only.
    program = Program(z=Block(N, lower), t=Block(1, high=10.0, cost=-1.0))
    program.equal(target / size, z=frame.R, t=frame.R @ unit)
    answer = program.solve()
    if not answer:
        return np.zeros(N), -np.inf
    p = answer["z"] + answer["t"] * unit
    with suppress(np.linalg.LinAlgError):  # no convergence: the point stays as the solver gave it
        p = p + np.linalg.lstsq(frame.R, target / size - frame.R @ p, rcond=None)[0]
    rest = np.delete(p, free) if free is not None else p
    return p * size, float(rest.min(initial=np.inf))


class Found(NamedTuple):
    """A matrix for which a cone was found, and the proof."""

    A: Matrix
    proof: GeneratorProof


class Crossing(NamedTuple):
    """A supporting hyperplane of X and a generator that A (of X) or B (of U) takes across it."""

    matrix: str
    normal: NDArray[np.object_]
    ray: int


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
    known = _known(X, rays, A, discrete)
    sources = [("A", A, rays)] if known is None else []
    sources += [] if B is None or U is None else [("B", B, portable(U.exact_rays))]
    if known is not None and not sources:
        return known, None
    values = np.asarray(rays.values)
    w = pointing_functional(values) if known is None else known.pointing
    frame = Frame.of(values, w)
    if frame is None:
        return None
    # frame.R has orthonormal rows, so its transpose is its right inverse
    inverse = (frame.R.T @ frame.to) / frame.heights[:, None] if known is None else known.right_inverse
    about_cone = GeneratorProof(w, inverse)
    search = _Search(rays, frame, Generators(rays, inverse))
    found: dict[str, Matrix] = {} if known is None or known.multipliers is None else {"A": known.multipliers}
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


def _known(X: Cone, rays: Matrix, A: Matrix, discrete: bool) -> GeneratorProof | None:
    """The proof with which the cone was found, for a multiple of that matrix plus one of I; None if it does not fit.

    a A + c I has the multipliers a P + c I, up to rounding, which `conditions` judge.
    """
    values, eye = np.asarray(A.plain().values), np.eye(X.dim)
    for given, proof in vars(X).get("_found", ()):
        part, shift = _multiple(values, np.asarray(given.values))
        P = proof.multipliers
        if P is None or P.shape[0] != rays.shape[0] or not part > 0:
            continue
        if np.abs(values - part * given.values - shift * eye).max() > _CLOSE * np.abs(values).max():
            continue
        if part != 1 or shift:
            P = Matrix(part * np.asarray(P.values) + shift * np.eye(rays.shape[0]))
        proposed = replace(proof, multipliers=P)
        if all(c.verdict() for c in proposed.conditions(A, X, None, None, discrete=discrete)):
            return proposed
    return None


def _multiple(A: Array, given: Array) -> tuple[float, float]:
    """a and c with a given + c I close to A."""
    beside = given * (1 - np.eye(len(given)))
    part = float((A * beside).sum() / (beside**2).sum()) if beside.any() else 1.0
    return part, float(np.diag(A - part * given).mean())


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
        image = M.fractions() @ vectors[np.array([j])].fractions()[0]
        if not image.any():
            return np.full(N, Fraction(0), dtype=object)
        digits = max(int(x).bit_length() for x in np.abs(self.rays.as_integers()[0]).ravel())
        self.allowance.take(2.4 * n**3 * (1 + n * digits / 1024) ** 1.6, N, n)
        try:
            x, h = exact_combination(self.rays.fractions(), image, j if free else None, work_limit=_WORK / count)
        except DataError:
            raise TooLargeError(f"the numbers of column {j} are too long for a linear program.") from None
        if h is not None or x is None:
            return np.asarray(h, dtype=object), j
        self.digits += N * N * max(Fraction(v).denominator.bit_length() for v in x)
        if self.digits > _DIGITS:
            raise TooLargeError("the multipliers are too long.")
        return x


def multipliers(
    A: Matrix,
    rays: Matrix,
    pointing: Array,
    *,
    discrete: bool = False,
) -> Matrix | None:
    """P with A R = R P and the signs that invariance asks for; None if there is none.

    Parameters
    ----------
    A : Matrix, shape (n, n)
    rays : Matrix, shape (N, n)
    pointing : ndarray, shape (n,)
        Positive on every generator.

    Returns
    -------
    Matrix, shape (N, N), or None

    Notes
    -----
    N linear programs of n rows, a millisecond or two each.
    """
    frame = Frame.of(np.asarray(rays.values), pointing)
    if frame is None:
        return None
    images = frame.to @ A.values @ frame.back @ frame.R
    size = float(np.abs(images).max()) or 1.0
    columns: list[NDArray] = []
    for j in range(rays.shape[0]):
        spend(program_effort(*frame.R.shape))
        p, t = nonnegative_combination(frame, images[:, j], None if discrete else j, size=size)
        if t > _STRICT:
            columns.append(p * frame.heights[j] / frame.heights)
            continue
        column = _affordable_column(A, rays, j, None if discrete else j)
        if column is None:
            return None
        columns.append(column)
    return _stacked(columns)


def _affordable_column(A: Matrix, rays: Matrix, j: int, free: int | None) -> NDArray[np.object_] | None:
    """An exact combination, by rational arithmetic; None if there is none, or it is too dear."""
    if rays.shape[1] > _EXACT_DIMENSION:
        return None
    try:
        return exact_combination(rays.fractions(), A.fractions() @ rays[np.array([j])].fractions()[0], free)[0]
    except TooLargeError:
        return None


def _signed(N: int, discrete: bool) -> NDArray[np.bool_]:
    """Entries of P that must not be negative."""
    return np.ones((N, N), dtype=bool) if discrete else ~np.eye(N, dtype=bool)


def _stacked(columns: list[NDArray]) -> Matrix:
    if all(c.dtype != object for c in columns):
        return Matrix(np.array(columns).T)
    return Matrix.from_fractions(np.array([[Fraction(x) for x in c] for c in columns], dtype=object)).T
