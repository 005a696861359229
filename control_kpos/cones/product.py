"""Products of cones, kept as factors and counts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import DataError, ShapeError
from ..exact.intake import found, items
from ..exact.matrix import Integers, Matrix
from ..exact.rows import frozen
from .base import Cone, held_cone
from .orthant import Orthant, nonnegative


class ProductCone(Cone):
    """The product X_1 x X_2 x ... of cones, in the order of the factors; made by `product`.

    Parameters
    ----------
    factors : sequence of Cone
        Factors in order, equal neighbours named once.  None of them is a product.
    counts : sequence of int
        How many times each factor stands in a row.

    Notes
    -----
    Rays and facets are block diagonal.  Nothing is enumerated before it is asked for, and then in sparse
    form (`exact_rays`, `exact_facets`); the dense `rays`, `facets`, `incidence` are refused for large
    products.

    Examples
    --------
    >>> import control_kpos as kp
    >>> P = kp.product([kp.PolyhedralCone([[0, 1], [1, -2]])] * 2)
    >>> P.factors[0].n_rays, P.counts
    (2, (2,))
    >>> P.rays
    array([[ 0.,  1.,  0.,  0.],
           [ 1., -2.,  0.,  0.],
           [ 0.,  0.,  0.,  1.],
           [ 0.,  0.,  1., -2.]])
    """

    factors: tuple[Cone, ...]
    counts: tuple[int, ...]

    def __init__(self, factors: Sequence[Cone], counts: Sequence[int]) -> None:
        dim = sum(int(c) * X.dim for X, c in zip(factors, counts, strict=True))
        vars(self).update(factors=tuple(factors), counts=tuple(int(c) for c in counts), dim=dim)

    @property
    def n_rays(self) -> int:
        return self._sizes[0]

    @property
    def n_facets(self) -> int:
        return self._sizes[1]

    @cached_property
    def _sizes(self) -> tuple[int, int]:
        return self._total(lambda X: X.n_rays), self._total(lambda X: X.n_facets)

    def _total(self, size: Callable[[Cone], int]) -> int:
        kinds, blocks, _ = self._kinds
        return sum(len(block) * size(X) for X, block in zip(kinds, blocks, strict=True))

    @cached_property
    def _kinds(self) -> tuple[list[Cone], list[NDArray[np.intp]], NDArray[np.intp]]:
        """Different factors, the numbers of the blocks that are copies of each, and the factor of each block."""
        number: dict[int, int] = {}
        kinds: list[Cone] = []
        run = np.empty(len(self.factors), dtype=np.intp)
        for k, X in enumerate(self.factors):
            key = -X.dim if isinstance(X, Orthant) else id(X)
            if key not in number:
                number[key] = len(kinds)
                kinds.append(X)
            run[k] = number[key]
        kind = np.repeat(run, self.counts)
        order = np.argsort(kind, kind="stable")
        blocks = np.split(order, np.cumsum(np.bincount(kind, minlength=len(kinds)))[:-1])
        return kinds, blocks, kind

    def _starts(self, size: Callable[[Cone], int]) -> NDArray[np.intp]:
        """First row (or coordinate) of each block."""
        kinds, _, kind = self._kinds
        sizes = np.array([size(X) for X in kinds], dtype=np.intp)[kind]
        return np.cumsum(sizes) - sizes

    @cached_property
    def _coordinates(self) -> NDArray[np.intp]:
        return self._starts(lambda X: X.dim)

    @property
    def exact_rays(self) -> Matrix:
        return self._rays

    @cached_property
    def _rays(self) -> Matrix:
        return self._block_diagonal(lambda X: X.exact_rays)

    @property
    def exact_facets(self) -> Matrix:
        return self._facets

    @cached_property
    def _facets(self) -> Matrix:
        return self._block_diagonal(lambda X: X.exact_facets)

    def _block_diagonal(self, part: Callable[[Cone], Matrix]) -> Matrix:
        kinds, blocks, _ = self._kinds
        row_starts = self._starts(lambda X: part(X).shape[0])
        rows, columns, values, radii = [], [], [], []
        for X, block in zip(kinds, blocks, strict=True):
            exact = part(X)
            pattern = sp.coo_array(abs(exact.values) + (0 if exact.radius is None else exact.radius))
            i, j = pattern.coords
            value = np.asarray(sp.csr_array(exact.values)[i, j]).ravel() if len(i) else np.zeros(0)
            radius = np.zeros(len(i)) if exact.radius is None else np.asarray(sp.csr_array(exact.radius)[i, j]).ravel()
            rows.append((row_starts[block][:, None] + i).ravel())
            columns.append((self._coordinates[block][:, None] + j).ravel())
            values.append(np.tile(value, len(block)))
            radii.append(np.tile(radius, len(block)))
        shape = (self._total(lambda X: part(X).shape[0]), self.dim)
        at = np.concatenate(rows), np.concatenate(columns)
        matrix = sp.csr_array((np.concatenate(values), at), shape=shape)
        if all(part(X).is_double for X in kinds):
            return Matrix(matrix)
        radius = sp.csr_array((np.concatenate(radii), at), shape=shape)
        exact_parts = [part(X).dense() for X in kinds]
        return Matrix(
            matrix,
            radius,
            integer_rows=_BlockRows(exact_parts, self._kinds[2], row_starts, self._coordinates, self.dim),
        )

    @property
    def incidence(self) -> NDArray[np.bool_]:
        self._refuse_large((self.n_facets, self.n_rays), "incidence")
        out = np.ones((self.n_facets, self.n_rays), dtype=bool)
        facet, ray = self._starts(lambda X: X.n_facets), self._starts(lambda X: X.n_rays)
        kinds, blocks, _ = self._kinds
        for X, block in zip(kinds, blocks, strict=True):
            rows = facet[block][:, None] + np.arange(X.n_facets)
            columns = ray[block][:, None] + np.arange(X.n_rays)
            out[rows[:, :, None], columns[:, None, :]] = X.incidence
        return out

    @property
    def dual(self) -> Cone:
        return self._dual

    @cached_property
    def _dual(self) -> Cone:
        duals = {id(X): X.dual for X in self.factors}
        out = ProductCone([duals[id(X)] for X in self.factors], self.counts)
        vars(out).update(_dual=self)
        return out

    @property
    def is_pointed(self) -> bool:
        return all(X.is_pointed for X in self._kinds[0])

    @property
    def is_solid(self) -> bool:
        return all(X.is_solid for X in self._kinds[0])

    @property
    def interior_point(self) -> NDArray[np.float64]:
        return self._interior_point

    @cached_property
    def _interior_point(self) -> NDArray[np.float64]:
        out = np.empty(self.dim)
        kinds, blocks, _ = self._kinds
        for X, block in zip(kinds, blocks, strict=True):
            out[self._coordinates[block][:, None] + np.arange(X.dim)] = X.interior_point
        return frozen(out)

    def _contains_rows(self, points: Matrix, strict: bool) -> NDArray[np.bool_]:
        if points.is_sparse or points.integer_rows is not None:
            return super()._contains_rows(points, strict)
        out = np.ones(points.shape[0], dtype=bool)
        kinds, blocks, _ = self._kinds
        for X, block in zip(kinds, blocks, strict=True):
            at = self._coordinates[block][:, None] + np.arange(X.dim)

            def blocks_of(matrix: Any, at: NDArray[np.intp] = at, size: int = X.dim) -> Any:
                return None if matrix is None else np.asarray(matrix)[:, at].reshape(-1, size)

            rows = Matrix(
                blocks_of(points.values), blocks_of(points.radius), blocks_of(points.numerators), points.denominator
            )
            inside = X._contains_rows(rows, strict)
            out &= inside.reshape(len(out), len(block)).all(axis=1)
        return out

    def _equals(self, other: Cone) -> bool:
        if isinstance(other, ProductCone) and self.counts == other.counts:
            pairs = {(id(X), id(Y)): (X, Y) for X, Y in zip(self.factors, other.factors, strict=True)}.values()
            if all(X.dim == Y.dim for X, Y in pairs):
                return all(X == Y for X, Y in pairs)
        return super()._equals(other)

    def __neg__(self) -> Cone:
        negative = {id(X): -X for X in self._kinds[0]}
        return product([negative[id(X)] for X, c in zip(self.factors, self.counts, strict=True) for _ in range(c)])

    def _first_block(self, wanted: Callable[[Cone], bool]) -> tuple[int, Cone]:
        k = next(k for k, X in enumerate(self.factors) if wanted(X))
        return sum(self.counts[:k]), self.factors[k]

    def _describe_line(self) -> str:
        number, X = self._first_block(lambda X: not X.is_pointed)
        return f"in factor {number} of the product, {X._describe_line()}"

    def _describe_hyperplane(self) -> str:
        number, X = self._first_block(lambda X: not X.is_solid)
        return f"in factor {number} of the product, {X._describe_hyperplane()}"

    def __repr__(self) -> str:
        runs = [
            f"{X!r}" if c == 1 else f"{X!r} ({c} times)" for X, c in zip(self.factors[:3], self.counts[:3], strict=True)
        ]
        more = f", and {len(self.factors) - 3} more" if len(self.factors) > 3 else ""
        return f"<ProductCone in R^{self.dim}: {', '.join(runs)}{more}>"


@dataclass(frozen=True, eq=False)
class _BlockRows:
    """Exact rows of a block diagonal matrix."""

    parts: Sequence[Matrix]
    kind: NDArray[np.intp]
    row_starts: NDArray[np.intp]
    coordinates: NDArray[np.intp]
    dim: int

    def __call__(self, index: NDArray[np.intp]) -> Integers:
        block = np.searchsorted(self.row_starts, index, side="right") - 1
        out = np.zeros((len(index), self.dim), dtype=object)
        for k in np.unique(self.kind[block]):
            at = np.flatnonzero(self.kind[block] == k)
            rows = self.parts[k].rows_as_integers(index[at] - self.row_starts[block[at]])
            out[at[:, None], self.coordinates[block[at]][:, None] + np.arange(rows.shape[1])] = rows
        return out


def product(factors: Iterable[Cone]) -> Cone:
    """The product X_1 x X_2 x ... in R^(n_1 + n_2 + ...), with its block structure kept.

    Parameters
    ----------
    factors : iterable of Cone
        At least one.  Products among them are taken apart, neighbouring orthants merge.  Factors that
        are one and the same object are stored once: `product([X] * 1000000)` takes a moment.

    Returns
    -------
    Cone
        A `ProductCone`; an `Orthant` for a product of orthants; the factor itself if there is only one.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> P = kp.product([X] * 1000 + [kp.orthant(2)])
    >>> P.dim, P.n_rays, P.counts
    (2002, 2002, (1000, 1))
    """
    runs: list[tuple[Cone, int]] = []
    position = 0
    for _, group in groupby(items(factors, "factors"), key=id):
        same = list(group)
        X: Any = held_cone(same[0], f"factors[{position}]")
        if not isinstance(X, Cone):
            raise DataError(f"factors[{position}] is {found(X)}; give cones.")
        position += len(same)
        parts = list(zip(X.factors, X.counts, strict=True)) if isinstance(X, ProductCone) else [(X, 1)]
        if len(parts) == 1:
            _append(runs, parts[0][0], parts[0][1] * len(same))
        else:
            for _ in same:
                for factor, count in parts:
                    _append(runs, factor, count)
    if not runs:
        raise ShapeError("factors is empty; give at least one cone.")
    if len(runs) == 1 and runs[0][1] == 1:
        return runs[0][0]
    return ProductCone([X for X, _ in runs], [c for _, c in runs])


def _append(runs: list[tuple[Cone, int]], X: Cone, count: int) -> None:
    """Add copies of a factor; orthants merge, equal neighbours are counted."""
    if isinstance(X, Orthant):
        X, count = nonnegative(X.dim * count), 1  # of nodes without states, the origin of R^0
        if runs and isinstance(runs[-1][0], Orthant):
            X = nonnegative(runs.pop()[0].dim + X.dim)
    elif runs and runs[-1][0] is X:
        count += runs.pop()[1]
    runs.append((X, count))


Cone._product = staticmethod(product)
