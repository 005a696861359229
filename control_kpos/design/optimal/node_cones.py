"""The cone of the states of a network by its nodes: generators and facets as sparse rows of doubles.

The lengths of generators and facets have no meaning, so that rows of integers below 2^53 are rows of doubles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...cones import Cone, Orthant, orthant
from ...cones.product import ProductCone
from ...errors import DataError
from ...exact.matrix import Matrix
from ...networks.blocks import block_diagonal
from .problem import Index


@dataclass(frozen=True, eq=False)
class NodeCones:
    """A product of cones, every coordinate of an orthant as a factor of its own.

    Attributes
    ----------
    X : Cone
    """

    X: Cone

    @cached_property
    def _kinds(self) -> tuple[list[Cone], Index]:
        """Different factors, and which of them every factor is."""
        X = self.X
        factors, counts = (X.factors, X.counts) if isinstance(X, ProductCone) else ((X,), (1,))
        half_line = orthant(1)
        parts = [
            (half_line, c * Y.dim) if isinstance(Y, Orthant) else (Y, c) for Y, c in zip(factors, counts, strict=True)
        ]
        kinds = list({id(Y): Y for Y, _ in parts}.values())
        number = {id(Y): k for k, Y in enumerate(kinds)}
        return kinds, np.repeat([number[id(Y)] for Y, _ in parts], [c for _, c in parts])

    def _starts(self, sizes: list[int]) -> Index:
        """Where the coordinates (generators, facets) of every factor begin, and their number."""
        return np.concatenate([[0], np.cumsum(np.array(sizes, dtype=np.intp)[self._kinds[1]])])

    @cached_property
    def starts(self) -> Index:
        """Where the coordinates of every factor begin, and their number."""
        return self._starts([Y.dim for Y in self._kinds[0]])

    @cached_property
    def owners(self) -> Index:
        """The factor of every coordinate."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    @cached_property
    def is_orthant(self) -> bool:
        """True if generators and facets are the unit vectors."""
        return isinstance(self.X, Orthant)

    @cached_property
    def rays(self) -> Matrix:
        """Generators."""
        return self._rows("exact_rays")

    @cached_property
    def facets(self) -> Matrix:
        """Facet normals."""
        return self._rows("exact_facets")

    @cached_property
    def are_doubles(self) -> bool:
        """True if generators and facets can be held as doubles."""
        return all(part.is_double for name in ("exact_rays", "exact_facets") for part in self._parts(name))

    def _parts(self, name: str) -> list[Matrix]:
        """Generators or facets of the different factors, as integers where they are no doubles."""
        return [_whole(getattr(Y, name).dense()) for Y in self._kinds[0]]

    def _rows(self, name: str) -> Matrix:
        exact = getattr(self.X, name)
        if exact.is_double:
            return Matrix(sp.csr_array(exact.values))
        parts, kind = self._parts(name), self._kinds[1]
        if not self.are_doubles:
            raise DataError(
                "a network in sparse matrices needs cones with generators and facets of doubles or integers."
            )
        first, blocks = self._starts([part.shape[0] for part in parts]), []
        for k, part in enumerate(parts):
            (r, c), at = part.shape, np.flatnonzero(kind == k)
            places = first[at][:, None] + np.arange(r), self.starts[at][:, None] + np.arange(c)
            blocks.append((np.broadcast_to(part.values, (len(at), r, c)), *places))
        rows = block_diagonal(blocks, (int(first[-1]), int(self.starts[-1])))
        rows.eliminate_zeros()
        return Matrix(rows)

    def apart(self, facets: Any, generators: Any) -> NDArray[np.bool_]:
        """True for pairs (facet, generator) with h'x = 0."""
        if self.is_orthant:
            return np.asarray(facets != generators)
        kinds, kind = self._kinds
        table = np.zeros((len(kinds), max(Y.n_facets for Y in kinds), max(Y.n_rays for Y in kinds)), dtype=bool)
        for k, Y in enumerate(kinds):
            table[k, : Y.n_facets, : Y.n_rays] = Y.incidence
        firsts = self._starts([Y.n_facets for Y in kinds]), self._starts([Y.n_rays for Y in kinds])
        j, k = (
            np.searchsorted(first, at, side="right") - 1 for first, at in zip(firsts, (facets, generators), strict=True)
        )
        own = j == k
        out = ~own
        node = j[own]
        out[own] = table[kind[node], facets[own] - firsts[0][node], generators[own] - firsts[1][node]]
        return out


def _whole(rows: Matrix) -> Matrix:
    return rows if rows.is_double else Matrix.from_fractions(rows.rows_as_integers(np.arange(rows.shape[0])))
