"""Cross-positive matrices in coordinates in which simplicial cones are orthants, as sparse integers.

With the generators x_i of a simplicial cone and the facets h_i that do not contain them, M = (h_i'A x_k) is Metzler,
and A x <= mu x in the order of the cone reads M a <= mu E a for x = sum a_i x_i and E = diag(h_i'x_i).  Neither the
lengths of facets nor those of generators matter, so that no division is needed.  Cones that are not simplicial keep
the coordinates they have.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..cones import Cone, Orthant
from ..cones.polyhedral import has_open_facets
from ..cones.product import ProductCone
from ..errors import TooLargeError
from ..exact.matrix import Index, Integers, Matrix, integers_of_doubles
from ..exact.rounding import SMALLEST_NORMAL
from ..exact.sparse_integers import SparseIntegers, mantissas
from ..proof.portable_cones import opposite_facets
from .perron_pair import Cones, Decision, Memory, decide, perron_vectors, strong_parts
from .perron_root import root
from .refinement import frames

# Rows up to which facets of a cone that are not doubles are written out.
_EXACT_FACETS = 80
# Part of a decay rate by which a proven one may be smaller.
_CLOSE = 1e-9
# Where shifts are tried beside an estimate: rounding as a part of the size of A; how far at most; how often halfway.
_ESTIMATE, _FARTHEST, _HALVES = 2.0**-50, 64, 100


@dataclass(frozen=True)
class Coordinates:
    """Coordinates of a product of cones.

    Attributes
    ----------
    into : SparseIntegers, shape (n, n)
        Rows are the facets opposite to the generators, or unit vectors.
    out : SparseIntegers, shape (n, n)
        Columns are the generators, or unit vectors.
    heights : ndarray of int (object), shape (n,)
        The diagonal of into @ out.
    cones : Cones
        Those that are not simplicial.
    """

    into: SparseIntegers
    out: SparseIntegers
    heights: Integers
    cones: Cones

    @classmethod
    def of(cls, pieces: Iterable[tuple[Cone, Index]], size: int) -> Coordinates:
        """Of cones that stand at the given places, (count, dimension) each.

        Raises
        ------
        TooLargeError
            Facets that are not doubles are too many to be written out.
        """
        group, facets, rays, pieces = np.arange(size), {}, {}, list(pieces)
        if all(isinstance(cone, Orthant) for cone, _ in pieces):
            one = np.ones(size, dtype=object)
            eye = SparseIntegers.diagonal(one)
            return cls(eye, eye, one, Cones(group))
        blocks: list[tuple[Index, Integers, Integers]] = []
        for cone, places in pieces:
            n = cone.dim
            if isinstance(cone, Orthant):
                blocks.append((places.reshape(-1, 1), np.ones((1, 1), dtype=object), np.ones((1, 1), dtype=object)))
                continue
            own, open_ = _rows(cone.exact_rays), has_open_facets(cone)
            if not open_ and cone.exact_facets.integer_rows is not None and n > _EXACT_FACETS:
                raise TooLargeError(f"the exact facets of a cone in dimension {n} are out of reach.")
            if cone.is_simplicial and not open_:
                blocks.append((places, opposite_facets(cone, own)[0], own.T))
                continue
            group[places] = places[:, :1]
            facets.update(dict.fromkeys(places[:, 0].tolist(), None if open_ else _rows(cone.exact_facets)))
            rays.update(dict.fromkeys(places[:, 0].tolist(), own))
            eye = np.eye(n, dtype=int).astype(object)
            blocks.append((places, eye, eye))
        into = block_diagonal([(places, places, H) for places, H, _ in blocks], (size, size))
        out = block_diagonal([(places, places, R) for places, _, R in blocks], (size, size))
        heights = np.ones(size, dtype=object)
        for places, H, R in blocks:
            heights[places] = (H * R.T).sum(axis=1)
        return cls(into, out, heights, Cones(group, facets, rays))

    def of_map(self, A: SparseIntegers) -> SparseIntegers:
        """A map between states in these coordinates, times their heights."""
        return A if self.into is self.out else self.into @ A @ self.out

    def lifted(self, found: Decision) -> Integers:
        """v or x of a decision, in the units of the cones, times a positive number."""
        return (self.into.T if found.stable else self.out).apply(found.vector)


def pieces_of(X: Cone) -> list[tuple[Cone, Index]]:
    """The factors of a cone with their places."""
    if not isinstance(X, ProductCone):
        return [(X, np.arange(X.dim)[None])]
    kinds, blocks, _ = X._kinds
    starts = X._coordinates
    return [(kind, starts[block][:, None] + np.arange(kind.dim)) for kind, block in zip(kinds, blocks, strict=True)]


def block_diagonal(blocks: Iterable[tuple[Index, Index, Integers]], shape: tuple[int, int]) -> SparseIntegers:
    """One block, or one of a stack, at every row of places (count, r) and (count, c); zeros are left out."""
    rows, columns, data = [], [], []
    for i, j, block in blocks:
        stack = np.broadcast_to(block, (len(i), *block.shape[-2:]))
        i, j = np.broadcast_arrays(i[:, :, None], j[:, None, :])
        used = stack != 0
        rows.append(i[used])
        columns.append(j[used])
        data.append(stack[used])
    return SparseIntegers.of(np.concatenate(rows), np.concatenate(columns), np.concatenate(data), shape)


def sparse_integers(A: Matrix) -> tuple[SparseIntegers, Fraction]:
    """A matrix with a common factor as integers times it."""
    if A.is_double:
        values = sp.coo_array(A.values)
        data, exponent = integers_of_doubles(values.data)
        rows, columns = values.coords
        shape = (A.shape[0], A.shape[1])
        return SparseIntegers.of(rows, columns, data, shape), Fraction(2) ** int(exponent.item())
    numerators, factor = A.as_integers()
    return SparseIntegers.dense(np.asarray(numerators, dtype=object)), Fraction(factor)


@dataclass(frozen=True)
class Pencil:
    """N - mu E, in integers, for a closed loop that is cross-positive.

    Attributes
    ----------
    N : SparseIntegers, shape (n, n)
    E : ndarray of int (object), shape (n,)
        Zero where a row holds an equation between ports.
    cones : Cones
    memory : dict
        See `decide`.
    """

    N: SparseIntegers
    E: Integers
    cones: Cones
    memory: Memory = field(default_factory=dict, repr=False)

    def at(self, shift: Any) -> SparseIntegers:
        """N - shift E times a positive number, with a place for each entry of the diagonal."""
        mu = Fraction(shift)
        if not mu and (self.N.rows == self.N.indices).sum() == self.N.height:
            return self.N
        return self.N.times(mu.denominator) + SparseIntegers.diagonal(-mu.numerator * self.E)

    def decide(self, shift: Any, *, marginal: bool = False, growing: bool = False) -> Decision | None:
        """Whether the spectral abscissa is below the shift; None if that is infinite, or out of reach."""
        if isinstance(shift, float) and not np.isfinite(shift):
            return None
        return decide(self.at(shift), self.cones, marginal=marginal, memory=self.memory, growing=growing)

    @np.errstate(all="ignore")
    def estimate(self, relative: float) -> float:
        """The spectral abscissa in floating point, part by part, about to this relative width."""
        top = -np.inf
        for part, N in strong_parts(self.N, self.cones.group):
            e = self.E[part]
            if e.any():
                at = _root_by_eigenvalues(N, e) if self.cones.touches(part) else root(N, e, relative)
                top = max(top, at)
        return top

    def bracket(self, about: float, width: float, size: float) -> dict[bool, tuple[float, Decision]]:
        """Shifts below and above the spectral abscissa with what decides them, by whether they are above.

        Parameters
        ----------
        about : float
            An estimate of the abscissa.
        width : float
            How close the shifts should be.  They are as close as decisions are within reach; one may be missing.
        size : float
            Of A: the rounding of the estimate is small against it.
        """
        ends: dict[bool, tuple[float, Decision]] = {}
        sharp = self._sharpened(about)
        start = (about, _ESTIMATE * size) if sharp is None else (sharp, 0.0)
        for at in _proposals(self, ends, *start, width, size):
            found = self.decide(at, growing=True in ends)
            if found is not None:
                ends[found.stable] = at, found
            elif len(ends) == 2:
                break
        return ends

    def _sharpened(self, about: float) -> float | None:
        """The quotient of the Perron vectors at an estimate, if there is one part; its frames are kept."""
        N = self.at(about)
        if self.cones.facets or len(strong_parts(N, self.cones.group)) > 1:
            return None
        made = frames(N)
        if made is None:
            return None
        self.memory[0] = made
        vectors = perron_vectors(made)
        return None if vectors is None else self.quotient(*vectors)

    def quotient(self, v: Integers, x: Integers) -> float | None:
        """v'N x / v'E x: about the abscissa, with an error of the order of the errors of v and x multiplied."""
        top, below = int(v @ self.N.apply(x)), int(v @ (self.E * x))
        return top / below if below else None


def _root_by_eigenvalues(N: SparseIntegers, e: Integers) -> float:
    """The rightmost finite eigenvalue of N - mu diag(e), in floating point."""
    mantissa, exponent = mantissas(N.data)
    size, power = mantissas(e)
    top = int(exponent.max(initial=0))
    M = np.zeros((N.height, N.height))
    M[N.rows, N.indices] = np.ldexp(mantissa, np.maximum(exponent - top, -1100))
    own, ports = np.flatnonzero(e != 0), np.flatnonzero(e == 0)
    M, rest = M[:, np.r_[own, ports]], len(own)
    closed = M[own][:, :rest]
    if ports.size:
        closed = closed - M[own][:, rest:] @ np.linalg.solve(M[ports][:, rest:], M[ports][:, :rest])
    scaled = closed / np.ldexp(size[own], power[own] - top)[:, None]
    return float(np.linalg.eigvals(scaled).real.max())


def _proposals(
    pencil: Pencil, ends: dict[bool, tuple[float, Decision]], about: float, error: float, width: float, size: float
) -> Iterator[float]:
    """Shifts to decide: beside the estimate, outwards, beside the quotient of the vectors of both sides, and halves."""
    step = max(0.4 * width, error, SMALLEST_NORMAL)  # steps of 0 would never end
    limit = _FARTHEST * max(abs(about) + size, step)
    while not ends and step < limit:
        yield about + step
        step *= 1 if ends else 64  # undecided so close to the abscissa
    while len(ends) < 2 and step < limit:
        yield about - step if True in ends else about + step
        step *= 8
    quotient = pencil.quotient(ends[True][1].vector, ends[False][1].vector) if len(ends) == 2 else None
    if quotient is not None and ends[True][0] - ends[False][0] > width:
        for at in (quotient + 0.4 * width, quotient - 0.4 * width):
            if ends[False][0] < at < ends[True][0]:
                yield at
    for _ in range(_HALVES if len(ends) == 2 else 0):
        lower, upper = ends[False][0], ends[True][0]
        at = 0.5 * (lower + upper)
        if upper - lower <= width or at in (lower, upper):
            return
        yield at


def _pencil(A: Matrix, X: Cone) -> tuple[Coordinates, Pencil]:
    at = Coordinates.of(pieces_of(X), X.dim)
    S, factor = sparse_integers(A)
    N = at.of_map(S).times(factor.numerator)
    return at, Pencil(N, at.heights * factor.denominator, at.cones)


def decide_stability(A: Matrix, X: Cone, discrete: bool) -> tuple[bool, Integers] | None:
    """Settle whether a K-positive A is stable, with v or x as integers times one number.

    v decreases, A x is in X; in discrete time A - I takes the place of A.  None if this is out of reach.
    """
    try:
        at, pencil = _pencil(A, X)
    except TooLargeError:
        return None
    found = pencil.decide(discrete)
    return None if found is None else (found.stable, at.lifted(found))


def decide_rate(A: Matrix, X: Cone, discrete: bool, rate: Fraction) -> tuple[bool, Integers | None]:
    """Settle whether some v in int X* decreases at a rate or faster.

    Either v does, or A x + rate x is in X and not 0 for some x in X; in discrete time A - I takes the place of A.
    """
    try:
        at, pencil = _pencil(A, X)
    except TooLargeError:
        return False, None
    found = pencil.decide(discrete - rate, marginal=True)
    return (False, None) if found is None else (found.stable, at.lifted(found))


def around_the_rate(A: Matrix, X: Cone, discrete: bool) -> dict[bool, Integers]:
    """v (True) and x (False) of `decide_stability` at rates just below and just above the largest, as far as found."""
    if not X.is_simplicial and X.dim > _EXACT_FACETS:
        return {}
    try:
        at, pencil = _pencil(A, X)
        about = pencil.estimate(_CLOSE)
    except (TooLargeError, np.linalg.LinAlgError):
        return {}
    if not np.isfinite(about):
        return {}
    ends = pencil.bracket(about, _CLOSE * abs(discrete - about), abs(about) + discrete)
    return {stable: at.lifted(found) for stable, (_, found) in ends.items()}


def _rows(m: Matrix) -> Integers:
    return m.rows_as_integers(np.arange(m.shape[0]))
