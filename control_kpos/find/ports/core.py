"""A cone around the dominant direction inside given half-spaces, with multipliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from numpy.typing import NDArray

from ...cones import PolyhedralCone
from ...errors import TooLargeError
from ...exact.matrix import Matrix
from ...proof.proposed_weights import Frame, multipliers, nonnegative_combination
from ..one_matrix.explicit import (
    LARGE,
    MOST_ENTRIES,
    ModalCone,
    Multipliers,
    modal_cone,
)
from ..one_matrix.modes import Modes, dominant_index, modes
from ..one_matrix.search import modal_cones

Array = NDArray[np.float64]

# Polytopes that no half-space limits have about the size of the dominant direction, more for vectors further out.
_LARGEST = (1.0, 1e3)
# Off the half-spaces by this part, so that rounding does not matter.
_INSIDE = 1 - 1e-9
# Facets of a polytope in more dimensions are too many to enumerate.
_HULL_DIMENSION = 7
# From this many generators on few of them take up rounding errors: the multipliers become sparse.
LARGEST_DENSE = 600
# Eigenvectors of a larger condition number are not used as a basis of the complement.
_WELL_CONDITIONED = 1e6
# Below this, relative to the largest eigenvalue, a gap is not told from rounding.
_SMALLEST_GAP = 1e-9


@dataclass(frozen=True, eq=False)
class Split:
    """Coordinates (1, y) with the dominant direction first.

    Attributes
    ----------
    dominant : float
    right, left : ndarray, shape (n,)
        A right = dominant right, left A = dominant left, left right = 1.
    complement : ndarray, shape (n, n - 1)
        Q.
    S : ndarray, shape (n - 1, n - 1)
        A Q = Q S.
    gap : float
        Distance from the dominant eigenvalue to the real part (discrete time: modulus) of the next one.
    modes : Modes or None
        If Q holds the modes.
    """

    dominant: float
    right: Array
    left: Array
    complement: Array
    S: Array
    gap: float
    modes: Modes | None

    @property
    def basis(self) -> Array:
        """[e Q]."""
        return np.column_stack([self.right, self.complement])

    def turned(self) -> Split:
        """The same with -e."""
        return replace(self, right=-self.right, left=-self.left)


def split(A: Array, m: Modes | None, *, discrete: bool) -> Split | None:
    """A [e Q] = [e Q] blkdiag(lam, S), or None if the dominant eigenvalue is not real and simple.

    Q holds the modes m of A where they are well conditioned, else any orthonormal basis of {x : l'x = 0}.
    """
    if m is not None and m.conditioning < _WELL_CONDITIONED:
        blocks = [
            np.array([[z.real, -z.imag], [z.imag, z.real]])[: V.shape[1], : V.shape[1]]
            for z, V in zip(m.others, m.bases, strict=True)
        ]
        size = len(A) - 1
        S = sl.block_diag(*blocks) if blocks else np.zeros((size, size))
        Q = np.column_stack(m.bases) if blocks else np.zeros((len(A), size))
        gap = m.dominant - (np.abs(m.others) if discrete else m.others.real)
        return Split(m.dominant, m.right, m.left, Q, S, float(gap.min(initial=1.0)), m)
    return _by_functional(A, discrete)


def _by_functional(A: Array, discrete: bool) -> Split | None:
    values, left, right = (np.asarray(a, dtype=np.complex128) for a in sl.eig(A, left=True, right=True))
    first = dominant_index(values, discrete=discrete)
    if values[first].imag != 0 or (discrete and values[first].real < 0):
        return None
    e, functional = right[:, first].real, left[:, first].real
    rest = np.delete(values, first)
    gap = float((values[first].real - (np.abs(rest) if discrete else rest.real)).min(initial=1.0))
    height = float(functional @ e)
    if gap <= _SMALLEST_GAP * float(np.abs(values).max()) or abs(height) < 1e-8:
        return None
    Q = sl.null_space(functional[None, :])
    return Split(float(values[first].real), e, functional / height, Q, Q.T @ A @ Q, gap, None)


@dataclass(frozen=True, eq=False)
class Block:
    """A polytope around 0 in some of the coordinates.

    Attributes
    ----------
    rows, at : slice
        Which generators and which coordinates are its own.
    functionals : ndarray, shape (f, d)
        One for each facet; their maximum is the gauge of the polytope.
    facets : ndarray of int, shape (f, d), or None
        The corners of each facet of a segment or polygon.
    """

    rows: slice
    at: slice
    functionals: Array
    facets: NDArray[np.intp] | None = None


@dataclass(frozen=True, eq=False)
class Core:
    """The free sum of polytopes: generators e + w, in coordinates (1, y).

    Attributes
    ----------
    points : ndarray, shape (N, n)
        Generators, first coordinate 1.
    P : ndarray or csr_array, shape (N, N)
        Multipliers, positive off the diagonal (discrete time: everywhere); sparse ones in rows with weights.
    weights : ndarray, shape (N,)
        e as a combination of the generators.
    blocks : list of Block
    """

    points: Array
    P: Any
    weights: Array
    blocks: list[Block]

    def holds(self, y: Array) -> NDArray[np.bool_]:
        """Which rows are inside."""
        return self.gauge(y) <= y[:, 0] * (1 - 1e-9)

    def gauge(self, y: Array) -> Array:
        """How far out the rows are, as heights: first coordinates from here on are inside."""
        total = np.zeros(len(y))
        for block in self.blocks:
            total += (y[:, block.at] @ block.functionals.T).max(axis=1)
        return total

    def combination(self, y: Array) -> Array:
        """A point inside as a positive combination of the generators."""
        out = np.zeros(len(self.points))
        used = 0.0
        for block in self.blocks:
            if block.facets is None:
                return self._by_program(y)
            values = block.functionals @ y[block.at]
            facet = int(np.argmax(values))
            corners = self.points[block.rows, block.at][block.facets[facet]]
            out[block.rows][block.facets[facet]] += np.linalg.solve(corners.T, y[block.at])
            used += float(values[facet])
        return out + (y[0] - used) * self.weights

    def _by_program(self, y: Array) -> Array:
        frame = Frame.of(self.points, np.eye(len(y))[0])
        if frame is None:
            return np.full(len(self.points), -np.inf)
        return nonnegative_combination(frame, frame.to @ y, size=float(y[0]))[0] / frame.heights


def core_inside(split: Split, normals: Array, vectors: Array, *, discrete: bool) -> Core | None:
    """A large invariant cone around e inside {x : normals x >= 0}.

    Parameters
    ----------
    normals : ndarray, shape (r, n)
        In the coordinates of the split, positive on the dominant direction.
    vectors : ndarray, shape (k, n)
        What the core would hold ideally.
    """
    if len(split.right) == 1:
        return Core(np.eye(1), np.array([[split.dominant]]), np.ones(1), [])
    out = np.abs(vectors[:, 1:]).max(axis=1, initial=0.0) / vectors[:, 0]
    size = np.clip(3 * len(split.S) * out.max(initial=0.0), *_LARGEST)
    if split.modes is None:
        return _one_block(split, normals, float(size), discrete)
    return _one_for_each_mode(split.modes, normals, float(size), discrete)


def _one_for_each_mode(m: Modes, normals: Array, largest: float, discrete: bool) -> Core | None:
    parts = _parts(m, discrete, thin=None)
    count = sum(part.R.shape[1] for part in parts)
    if len(parts) != len(m.bases) or count * len(m.right) > MOST_ENTRIES:
        return None
    thin = count > LARGEST_DENSE
    parts = _parts(m, discrete, thin=True) if thin else parts
    rows: list[Array] = []
    blocks: list[Block] = []
    start, count = 1, 0
    for V, part in zip(m.bases, parts, strict=True):
        size = V.shape[1]
        at = slice(start, start + size)
        corners = _scaled((part.R[1:] / part.R[0]).T, normals[:, at], normals[:, 0], largest)
        points = np.zeros((len(corners), len(m.right)))
        points[:, 0], points[:, at] = 1.0, corners
        rows.append(points)
        blocks.append(_in_order(slice(count, count + len(corners)), at, corners))
        start, count = start + size, count + len(corners)
    points = np.concatenate(rows)
    if thin:
        P = _thinly_coupled([part.multipliers for part in parts if part.multipliers is not None])
        return Core(points, P.combined(), P.weights, blocks)
    weights = np.concatenate([np.full(len(p), 1 / (len(p) * len(rows))) for p in rows])
    own = [part.multipliers.combined() for part in parts if part.multipliers is not None]
    return Core(points, _coupled(own, weights), weights, blocks)


def _parts(m: Modes, discrete: bool, *, thin: bool | None) -> list[ModalCone]:
    """A cone for each mode alone, in the coordinates of (1, mode); fewer than modes if one has none."""
    out: list[ModalCone] = []
    for value, V in zip(m.others, m.bases, strict=True):
        eye = np.eye(1 + V.shape[1])
        alone = Modes(m.dominant, eye[0], eye[0], np.array([value]), [eye[:, 1:]], 1.0)
        found = modal_cone(alone, discrete=discrete, thin=thin)
        if found is None or found.multipliers is None:
            break
        out.append(found)
    return out


def _one_block(split: Split, normals: Array, largest: float, discrete: bool) -> Core | None:
    """The first cone of the search without half-spaces, made small enough."""
    n = len(split.right)
    if n - 1 > _HULL_DIMENSION:
        return None
    A = sl.block_diag(split.dominant, split.S)
    height = np.eye(n)[0]
    for candidate in modal_cones(A, modes(A, discrete=discrete), discrete=discrete, max_rays=LARGE):
        if not (candidate.R[0] > 0).all():
            continue
        corners = _scaled((candidate.R[1:] / candidate.R[0]).T, normals[:, 1:], normals[:, 0], largest)
        points = np.column_stack([np.ones(len(corners)), corners])
        frame = Frame.of(points, height)
        P = None if frame is None else multipliers(Matrix(A), Matrix(points), height, discrete=discrete)
        if frame is None or P is None:
            continue
        weights, t = nonnegative_combination(frame, frame.to @ height, size=1.0)
        if t > 0:
            try:
                facets = PolyhedralCone(points).facets
            except TooLargeError:
                continue
            block = Block(slice(0, len(points)), slice(1, n), -facets[:, 1:] / facets[:, :1])
            return Core(points, np.asarray(P.values), weights / frame.heights, [block])
    return None


def _scaled(corners: Array, normals: Array, heights: Array, largest: float) -> Array:
    """Corners scaled so that e + corner nearly reaches the half-spaces, or a size."""
    reach = -(normals @ corners.T)
    heights = np.broadcast_to(heights[:, None], reach.shape)
    limit = np.divide(heights, reach, out=np.full_like(reach, np.inf), where=reach > 0).min(initial=np.inf)
    return corners * (_INSIDE * min(float(limit), largest))


def _coupled(parts: list[Array], weights: Array) -> Array:
    """Block-diagonal multipliers with a part of e moved from each block to all generators."""
    out = np.zeros((len(weights), len(weights)))
    start = 0
    for P in parts:
        size = len(P)
        free = P + np.diag(np.full(size, np.inf))
        part = 0.5 * float(free.min()) * size
        at = slice(start, start + size)
        out[at, at] = P - part / size
        out[:, at] += part * weights[:, None]
        start += size
    return out


def _thinly_coupled(parts: list[Multipliers]) -> Multipliers:
    """Multipliers of the free sum, what is kept aside going to few generators of every block."""
    return Multipliers(
        sp.csr_array(sp.block_diag([part.core for part in parts])),
        np.concatenate([part.weights for part in parts]) / len(parts),
        np.concatenate([part.rise for part in parts]),
    )


def _in_order(rows: slice, at: slice, corners: Array) -> Block:
    """A segment, or a polygon with its corners in order."""
    count, size = corners.shape
    index = np.arange(count)
    facets = index[:, None] if size == 1 else np.column_stack([index, (index + 1) % count])
    return Block(rows, at, _functionals(corners, facets), facets)


def _functionals(corners: Array, facets: NDArray[np.intp]) -> Array:
    """For each facet the functional that is 1 on its corners."""
    ones = np.ones((*facets.shape, 1))
    return np.asarray(np.linalg.solve(corners[facets], ones)[:, :, 0], dtype=np.float64)
