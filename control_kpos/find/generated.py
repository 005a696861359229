"""Cones known by generators that are proven extreme, for dimensions where facets are out of reach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..cones import PolyhedralCone
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms

# More generators are not compared with each other.
_COMPARED = 3000
# More numbers are not put through an enumeration, which would drop redundant generators.
_ENUMERATED = 1600


class GeneratedCone(PolyhedralCone):
    """A `PolyhedralCone` known to be proper, whose generators (or, as a dual, normals) are taken as they are.

    They are extreme wherever that could be proven at little cost; else some may be redundant.  What the cone was made
    from costs nothing to read; the other description is enumerated when first asked for.
    Made by `proper_cone`.
    """

    @property
    def exact_rays(self) -> Matrix:
        """Generators as exact data."""
        return self._faces.rays if self._is_swapped else self._conversion.generators

    @property
    def exact_facets(self) -> Matrix:
        """Facet normals as exact data."""
        return self._conversion.generators if self._is_swapped else self._faces.facets

    @property
    def n_rays(self) -> int:
        """Number of generators."""
        return self.exact_rays.shape[0]

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return self.exact_facets.shape[0]

    @property
    def is_pointed(self) -> bool:
        """True: proven before the cone was made."""
        return True

    @property
    def is_solid(self) -> bool:
        """True: proven before the cone was made."""
        return True

    def __repr__(self) -> str:
        known = f"{self._conversion.generators.shape[0]} {'facets' if self._is_swapped else 'rays'}"
        return f"<PolyhedralCone in R^{self.dim}: {known}>"


def proper_cone(
    rays: Matrix, separators: NDArray[np.float64] | None, right_inverse: NDArray[np.float64]
) -> PolyhedralCone:
    """The cone of generators that are already proven to span a proper cone.

    Parameters
    ----------
    rays : Matrix, shape (N, n)
    separators : ndarray, shape (N, n), or None
        Row i should be negative on generator i and positive on all others, which proves generator i
        extreme.  Where this fails, or without them, a cone of few generators finds redundant ones by enumeration
        when asked for its rays; many are kept as they are.
    right_inverse : ndarray, shape (N, n)
        Y with rays' Y close to the identity.
    """
    if not _are_extreme(rays, separators) and rays.values.size <= _ENUMERATED:
        return PolyhedralCone(rays)
    cone = GeneratedCone(rays)
    values = np.asarray(rays.values)
    weights = np.ldexp(1.0, -np.frexp(np.abs(values).max(axis=1))[1])
    point = weights @ values
    weights = np.ldexp(weights, -np.frexp(np.abs(point).max())[1])
    point = np.ldexp(point, -np.frexp(np.abs(point).max())[1])
    column = (Matrix.identity(rays.shape[1]), Matrix(point[None, :]))
    everywhere = np.ones((len(values), 1), dtype=bool)
    inside = Generators(rays, right_inverse).combination("x = R q", [column], Matrix(weights[:, None]), everywhere)
    if inside.verdict() and (inside.lower > 0).all():
        point.flags.writeable = False
        vars(cone)["_interior_point"] = point  # cones refuse to be changed from outside
    return cone


def _are_extreme(rays: Matrix, separators: NDArray[np.float64] | None) -> bool:
    """Whether every separator is proven to single out its generator."""
    if separators is None or not rays.shape[0] == len(separators) <= _COMPARED:
        return False
    signs = BilinearForms(Matrix(separators), None, rays).signs()
    return bool(np.array_equal(signs, np.ones_like(signs) - 2 * np.eye(len(signs), dtype=signs.dtype)))
