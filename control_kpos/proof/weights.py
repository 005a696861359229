"""Proofs of inclusion without facets: M x_i = sum_k W_ki y_k with W >= 0, in rational numbers.

A file lists the generators of cones, not their facets.  Its reader proves M X inside Y by multiplication: for every
generator x_i of X some column of W gives M x_i as a nonnegative combination of generators of Y.  For invariance
in continuous time W_ii is free.  Products are taken block by block; a simplicial cone needs one
scalar product per weight, other cones one exact feasibility problem per column.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import lcm
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cones import (
    Cone,
    Orthant,
    ProductCone,
    orthant,
)
from ..errors import TooLargeError
from ..exact.linalg import solve_exactly
from ..exact.matrix import Matrix, integers_of_doubles
from ..exact.rational_programs import exact_combination, exact_feasibility
from .encoding import encode_triplets
from .numerals import number_text
from .portable_cones import (
    LARGE,
    independent,
    opposite_facets,
    portable_rows,
    right_inverse,
    spanning_inverse,
)

Rationals = NDArray[np.object_]
# row, column, number
Entry = tuple[int, int, Any]
# Digits written, and work spent, before a proof is left out of a file.
_BITS = 10**8
# Of a solution of n equations in doubles, divided by n.
_DIGITS = 240
_PROGRAMS = 3000
_WORK = 25 * 10**8
_BLOCKS = 2 * 10**5
_REPAIRS = 3 * 10**5
_HALF_LINE = orthant(1)


class ProofOmittedError(ArithmeticError):
    """A proof would be too long for a file, or take too long to find."""


class _Block(NamedTuple):
    """One factor of a cone: where its coordinates and generators begin."""

    cone: Cone
    row: int
    ray: int


class Prover:
    """Finds weights; equal blocks are solved once."""

    def __init__(self) -> None:
        self._cache: dict[Any, Rationals] = {}
        self._rays: dict[int, Rationals] = {}
        self._facets: dict[int, tuple[Rationals, Rationals] | None] = {}
        self._held: list[Any] = []
        self._programs = 0
        self._bits = 0

    def inclusion(
        self,
        target: Cone,
        M: Matrix,
        source: Cone,
        *,
        invariance: bool = False,
        source_rays: Matrix | None = None,
    ) -> Any:
        """Weights of M x_i, column by column, as JSON data; None for a simplicial target, where they follow.

        Parameters
        ----------
        target, source : Cone
        M : Matrix, shape (target.dim, source.dim)
        invariance : bool
            Target is source, and the weights on the diagonal are free.
        source_rays : Matrix, shape (N, n), or None
            The generators of the source, a cone without factors, if the file does not have its `rays`.

        Raises
        ------
        ProofOmittedError
            If it would take too long.
        """
        if _determines_weights(target):
            return None
        if source_rays is not None:
            return self._images(target, M, source_rays)
        targets, sources = _blocks(target), _blocks(source)
        entries: list[Entry] = []
        for a, b, piece in _pieces(M, targets, sources):
            diagonal = invariance and a.row == b.row
            key = (id(a.cone), id(b.cone), diagonal, tuple(piece.ravel()))
            if key not in self._cache:
                images = piece @ self._generators(b.cone).T
                free = range(images.shape[1]) if diagonal else None
                self._cache[key] = self._weights(a.cone, images, free)
            entries += _entries(self._cache[key], a.ray, b.ray)
        return self._encoded(entries, (target.n_rays, source.n_rays))

    def within_bounds(self, X: Cone, A: Matrix, radius: NDArray[np.float64], *, invariance: bool) -> Any:
        """P with A x_i = sum_k P_ki x_k and P_ki >= sum_j |Z_kj| (radius |x_i|)_j, as JSON data.

        Then J x_i has weights >= 0 (invariance: but for its own) for every J with |J - A| <= radius, entry by entry,
        because sum_k x_k Z_kj = e_j.  On simplicial cones this is necessary too.
        """
        if X.is_simplicial or not radius.any():
            return self.inclusion(X, A, X, invariance=invariance)
        if X.n_rays * X.n_rays * X.dim > _REPAIRS:
            raise ProofOmittedError("exact weights for so many generators would take too long")
        rays, Z = _written(X)
        spread = np.abs(Z) @ Matrix(radius).fractions() @ np.abs(rays.T)
        rest = (A.fractions() @ rays.T - rays.T @ spread).T
        free = range(len(rays)) if invariance else [None] * len(rays)
        P = spread + np.array([self._column(rays, y, i, False) for y, i in zip(rest, free, strict=True)]).T
        return self._encoded(_entries(P), P.shape)

    def _images(self, target: Cone, M: Matrix, rays: Matrix) -> Any:
        """Weights of M x for generators x of a cone of which nothing else is known."""
        images = M.plain().fractions() @ rays.fractions().T
        entries: list[Entry] = []
        for block in _blocks(target):
            W = self._weights(block.cone, images[block.row : block.row + block.cone.dim], None)
            entries += _entries(W, block.ray)
        return self._encoded(entries, (target.n_rays, rays.shape[0]))

    def vector(self, target: Cone, x: Rationals, *, interior: bool = False) -> Any:
        """Weights of one vector in a cone, as JSON data; None for a simplicial one, where they follow."""
        if _determines_weights(target):
            return None
        out: list[Entry] = []
        for block in _blocks(target):
            part = x[block.row : block.row + block.cone.dim]
            if not interior and not any(part):
                continue
            column = np.array(part, dtype=object)[:, None]
            out += _entries(self._weights(block.cone, column, None, interior=interior), block.ray)
        return self._encoded(out, (target.n_rays, 1))

    def repaired(self, rays: Matrix, images: Rationals, guess: Matrix, *, invariance: bool = False) -> Any:
        """Weights of vectors in a cone of which generators are all that is known, as JSON data.

        Parameters
        ----------
        rays : Matrix, shape (N, n)
        images : ndarray of Fraction, shape (n, c)
            The vectors, one a column.
        guess : Matrix, shape (N, c)
            Weights up to rounding.
        invariance : bool
            c = N, and the weights on the diagonal are free.
        """
        rows = portable_rows(rays)
        if images.shape[1] * rows.size > _REPAIRS:
            raise ProofOmittedError("exact weights for so many generators would take too long")
        weights = guess.fractions()
        missing = images - rows.T @ weights
        rest = np.flatnonzero(missing.any(axis=0))
        if rest.size:
            Z = spanning_inverse(rays, rows)
            if Z is None:
                raise ProofOmittedError(f"exact weights are written up to dimension {LARGE}")
            weights[:, rest] += Z @ missing[:, rest]
        allowed = np.eye(*weights.shape, dtype=bool) if invariance else np.zeros(weights.shape, dtype=bool)
        for j in np.flatnonzero(((weights < 0) & ~allowed).any(axis=0)):
            weights[:, j] = self._column(rows, images[:, j], int(j) if invariance else None, interior=False)
        return self._encoded(_entries(weights), weights.shape)

    def repaired_map(
        self, rays: Matrix, M: Matrix, guess: sp.csr_array, support: NDArray[np.intp], *, invariance: bool
    ) -> Any:
        """Weights of M x for every generator x in terms of the generators, from sparse ones, as JSON data.

        Parameters
        ----------
        rays : Matrix, shape (N, n)
        M : Matrix, shape (n, n)
        guess : csr_array, shape (N, N)
            Weights up to rounding, positive in the rows of `support`.
        support : ndarray of int
            Generators that span the space and take up the rounding errors.
        invariance : bool
            The weights on the diagonal are free.
        """
        if _DIGITS * rays.values.size * rays.shape[1] > _BITS:
            raise ProofOmittedError("the proof would be longer than a file should be")
        rows, _ = rays.as_integers()
        matrix, scale = M.as_integers()
        coo = guess.tocoo()
        weights, exponent = integers_of_doubles(coo.data)
        unit = Fraction(2) ** int(exponent.item())
        basis = support[independent(rays[support], rows[support])]
        short = len(basis) == rays.shape[1] <= LARGE
        inverse = solve_exactly(rows[basis].T, np.eye(len(basis), dtype=int).astype(object)) if short else None
        if inverse is None:
            raise ProofOmittedError(f"exact weights are written up to dimension {LARGE}")
        image = np.zeros_like(rows)
        np.add.at(image, coo.coords[1], rows[coo.coords[0]] * weights[:, None])
        # without the factor of the integers, which M x and the generators have in common
        common = lcm(unit.denominator, Fraction(scale).denominator)
        missing = rows @ matrix.T * int(scale * common) - image * int(unit * common)
        added = missing @ inverse[0].T
        found = {(int(i), int(j)): Fraction(x) for i, j, x in zip(*coo.coords, coo.data.tolist(), strict=True)}
        for j, k in zip(*np.nonzero(added), strict=True):
            place = int(basis[k]), int(j)
            found[place] = found.get(place, Fraction(0)) + Fraction(int(added[j, k]), inverse[1] * common)
        if any(x < 0 and (i != j or not invariance) for (i, j), x in found.items()):
            raise ProofOmittedError("rounding errors are larger than what the weights have to spare")
        entries = [(i, j, x) for (i, j), x in sorted(found.items())]
        return self._encoded(entries, guess.shape)

    def _count(self, entries: list[Entry]) -> None:
        self._bits += sum(
            Fraction(x).numerator.bit_length() + Fraction(x).denominator.bit_length() for _, _, x in entries
        )
        if self._bits > _BITS:
            raise ProofOmittedError("the proof would be longer than a file should be")

    def _encoded(self, entries: list[Entry], shape: tuple[int, int]) -> Any:
        self._count(entries)
        return _encoded(entries, shape)

    def _generators(self, cone: Cone) -> Rationals:
        if id(cone) not in self._rays:
            self._held.append(cone)
            self._rays[id(cone)] = portable_rows(cone.exact_rays)
        return self._rays[id(cone)]

    def _weights(self, cone: Cone, images: Rationals, free: range | None, *, interior: bool = False) -> Rationals:
        """W with rays' W = images and W >= 0 except W_ii for i in `free`; with `interior` W > 0."""
        if isinstance(cone, Orthant):
            return images
        rays = self._generators(cone)
        opposite = self._opposite(cone)
        if opposite is not None:
            H, height = opposite
            return (H @ images) / height[:, None]
        found = [self._column(rays, y, None if free is None else i, interior) for i, y in enumerate(images.T)]
        return np.array(found, dtype=object).reshape(len(found), len(rays)).T

    def _opposite(self, cone: Cone) -> tuple[Rationals, Rationals] | None:
        """Facets and heights of a simplicial cone."""
        if id(cone) not in self._facets:
            self._held.append(cone)
            simplicial = cone.n_rays == cone.dim
            if simplicial and cone.dim > LARGE:
                raise ProofOmittedError(f"exact weights in a simplicial cone are written up to dimension {LARGE}")
            self._facets[id(cone)] = opposite_facets(cone, self._generators(cone)) if simplicial else None
        return self._facets[id(cone)]

    def _column(self, rays: Rationals, y: Rationals, free: int | None, interior: bool) -> Rationals:
        """One vector as a combination of generators, by a basis of a linear program in rationals."""
        self._programs += 1
        if self._programs > _PROGRAMS:
            raise ProofOmittedError(f"more than {_PROGRAMS} exact linear programs would be needed")
        try:
            if interior:  # s y = R (1 + b) with s, b >= 0; s > 0 because the cone is pointed
                found, _ = exact_feasibility(np.column_stack([y, -rays.T]), rays.sum(axis=0), work_limit=_WORK)
                return np.array([]) if found is None else (found[1:] + 1) / found[0]
            found, _ = exact_combination(rays, y, free, work_limit=_WORK)
        except TooLargeError as error:
            raise ProofOmittedError(str(error)) from None
        if found is None:
            raise ProofOmittedError("some vector is not in the cone it was thought to be in")
        return found


def _determines_weights(cone: Cone) -> bool:
    """True if the generators of a cone are as many as its dimensions, so that readers work weights out."""
    if isinstance(cone, ProductCone) and cone.is_simplicial and sum(cone.counts) > _BLOCKS:
        raise ProofOmittedError(f"the product has more than {_BLOCKS} factors")
    return cone.is_simplicial


def _blocks(cone: Cone) -> list[_Block]:
    runs = list(zip(cone.factors, cone.counts, strict=True)) if isinstance(cone, ProductCone) else [(cone, 1)]
    runs = [
        (_HALF_LINE, factor.dim * count) if isinstance(factor, Orthant) else (factor, count) for factor, count in runs
    ]
    if sum(count for _, count in runs) > _BLOCKS:
        raise ProofOmittedError(f"the product has more than {_BLOCKS} factors")
    out, row, ray = [], 0, 0
    for factor, count in runs:
        n_rays = factor.n_rays
        for _ in range(count):
            out.append(_Block(factor, row, ray))
            row, ray = row + factor.dim, ray + n_rays
    return out


def _pieces(M: Matrix, targets: list[_Block], sources: list[_Block]) -> Iterator[tuple[_Block, _Block, Rationals]]:
    """Blocks of M that are not zero, as fractions."""
    if not M.is_sparse:
        full = M.fractions()
        for a in targets:
            for b in sources:
                piece = full[a.row : a.row + a.cone.dim, b.row : b.row + b.cone.dim]
                if piece.any():
                    yield a, b, piece
        return
    coo = sp.coo_array(M.values)
    tops, lefts = np.array([a.row for a in targets]), np.array([b.row for b in sources])
    i, j = np.searchsorted(tops, coo.coords[0], "right") - 1, np.searchsorted(lefts, coo.coords[1], "right") - 1
    order = np.lexsort((j, i))
    cuts = np.flatnonzero((np.diff(i[order]) != 0) | (np.diff(j[order]) != 0)) + 1
    for part in np.split(order, cuts):
        if not part.size:
            continue
        a, b = targets[int(i[part[0]])], sources[int(j[part[0]])]
        if a.cone.dim * b.cone.dim > 10**6:
            raise ProofOmittedError("a factor of the cone is too large")
        piece = np.zeros((a.cone.dim, b.cone.dim), dtype=object)
        rows, columns = coo.coords[0][part] - a.row, coo.coords[1][part] - b.row
        piece[rows, columns] = [Fraction(x) for x in coo.data[part].tolist()]
        yield a, b, piece


def _written(cone: Cone) -> tuple[Rationals, Rationals]:
    """The generators and the right inverse of a cone as readers of its file have them, block diagonal."""
    out = tuple(np.full((cone.n_rays, cone.dim), Fraction(0), dtype=object) for _ in range(2))
    for block in _blocks(cone):
        rays = portable_rows(block.cone.exact_rays)
        Z = right_inverse(block.cone, rays)
        if Z is None:
            raise ProofOmittedError(f"cones are proven solid up to dimension {LARGE}")
        for whole, part in zip(out, (rays, Z), strict=True):
            whole[block.ray : block.ray + len(rays), block.row : block.row + block.cone.dim] = part
    return out[0], out[1]


def _entries(W: Rationals, row: int = 0, column: int = 0) -> list[Entry]:
    """Where W, which begins in this row and column, is not zero."""
    return [(row + int(i), column + int(j), W[i, j]) for i, j in zip(*np.nonzero(W), strict=True)]


def _encoded(entries: list[Entry], shape: tuple[int, int]) -> dict[str, Any]:
    if 3 * len(entries) < shape[0] * shape[1]:
        return encode_triplets(entries, shape)
    full: list[list[Any]] = [[0] * shape[1] for _ in range(shape[0])]
    for i, j, x in entries:
        full[i][j] = number_text(x)
    return {"matrix": full}


def crossed_facet(target: Cone | None, facet: int, first: int = 0, size: int | None = None) -> dict[str, Any]:
    """Of a broken inclusion the exact normal, which begins at an entry of a vector of this size.

    Nothing for a simplicial cone, or None, of which readers have all facets.
    """
    if target is None or target.is_simplicial:
        return {}
    row = target.exact_facets.rows_as_integers(np.array([facet]))[0]
    entries = [(first + int(j), 0, int(row[j])) for j in np.flatnonzero(row)]
    return {"normal": encode_triplets(entries, (len(row) if size is None else size, 1))}


def drift(A: Matrix, x: Rationals, discrete: bool, rate: Fraction = Fraction(0)) -> Rationals:
    """A x + rate x, with A - I for A in discrete time."""
    return product(A, x) + (rate - discrete) * x


def product(M: Matrix, x: Rationals) -> Rationals:
    """M x exactly."""
    if not M.is_sparse:
        return M.fractions() @ x
    out = np.array([Fraction(0)] * M.shape[0], dtype=object)
    coo = sp.coo_array(M.values)
    for i, j, value in zip(*coo.coords, coo.data.tolist(), strict=True):
        if x[j]:
            out[i] += Fraction(value) * x[j]
    return out


def columns(vectors: Any, size: int) -> dict[str, Any]:
    """Vectors of one size as the columns of a matrix, as JSON data."""
    entries = [(i, j, x[i]) for j, x in enumerate(vectors) for i in range(size) if x[i]]
    return _encoded(entries, (size, len(vectors)))
