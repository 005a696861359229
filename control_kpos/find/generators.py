"""Extreme generators: how to find them, and cones whose generators are proven extreme.

A generator x_i is extreme if some g has g'x_i < 0 < g'x_j for all other generators x_j.  That needs no facets, which
in high dimensions are too many to list.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone, PolyhedralCone
from ..exact.budget import spend
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.program import widest
from ..exact.programs import program_effort
from ..exact.signs import BilinearForms
from ..proof.proposed_weights import Frame

Array = NDArray[np.float64]

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
    def is_pointed(self) -> bool:
        """True: proven before the cone was made."""
        return True

    @property
    def is_solid(self) -> bool:
        """True: proven before the cone was made."""
        return True

    @cached_property
    def _interior_point(self) -> Array:
        right_inverse = vars(self).get("_right_inverse")
        point = None if right_inverse is None else _proven_inside(self._conversion.generators, right_inverse)
        return super()._interior_point if point is None else point

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
    cone = GeneratedCone._build(vars(Cone._from_rays(rays))["_conversion"], False)  # the rays need no reading
    vars(cone)["_right_inverse"] = right_inverse  # cones refuse to be changed from outside
    return cone


def _proven_inside(rays: Matrix, right_inverse: Array) -> Array | None:
    """A point that is proven to lie inside, near the middle of the generators; None if the proof fails."""
    values = np.asarray(rays.values)
    weights = np.ldexp(1.0, -np.frexp(np.abs(values).max(axis=1))[1])
    point = weights @ values
    weights = np.ldexp(weights, -np.frexp(np.abs(point).max())[1])
    point = np.ldexp(point, -np.frexp(np.abs(point).max())[1])
    basis, eye = Generators(rays, right_inverse), Matrix.identity(rays.shape[1])
    inside = basis.images("x = R q", eye, Matrix(point[None, :]), Matrix(weights[:, None]))
    if not (inside.verdict() and (inside.lower > 0).all()):
        return None
    point.flags.writeable = False
    return point


def _are_extreme(rays: Matrix, separators: NDArray[np.float64] | None) -> bool:
    """Whether every separator is proven to single out its generator."""
    if separators is None or not rays.shape[0] == len(separators) <= _COMPARED:
        return False
    signs = BilinearForms(Matrix(separators), None, rays).signs()
    return bool(np.array_equal(signs, np.ones_like(signs) - 2 * np.eye(len(signs), dtype=signs.dtype)))


def extreme_generators(
    rays: Array, pointing: Array, keep: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.intp], Array]:
    """Generators that are no combination of the others, with functionals that single them out.

    Parameters
    ----------
    rays : ndarray, shape (N, n)
    pointing : ndarray, shape (n,)
        Positive on every generator.
    keep : ndarray of bool, shape (N,), optional
        Generators that are never dropped, extreme or not.

    Returns
    -------
    index : ndarray of int, shape (p,)
    separators : ndarray, shape (p, n)
        Row i is negative on generator index[i] and positive on the others; zero if none was found.

    Notes
    -----
    One linear program in n variables for each generator, with about 10 n rows.
    """
    frame = Frame.of(rays, pointing)
    if frame is None:
        return np.arange(len(rays)), np.zeros_like(rays)
    points = frame.R.T
    n = points.shape[1]
    left = list(range(len(rays)))
    separators: dict[int, Array] = {}
    order = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1))  # inner ones first
    for i in order.tolist():
        is_extreme, separator = _separator(points, i, np.array([j for j in left if j != i], dtype=np.intp))
        if separator is not None:
            separators[i] = frame.to.T @ separator
        if not is_extreme and (keep is None or not keep[i]):
            left.remove(i)
    index = np.array(left)
    return index, np.array([separators.get(i, np.zeros(n)) for i in left])


def _separator(points: Array, i: int, others: NDArray[np.intp]) -> tuple[bool, Array | None]:
    """Whether x_i may be extreme, and g with g'x_i < 0 < g'x_j for the others if one was found.

    Most of the others are far away: the program starts from the nearest ones, and those it forgets join.
    """
    n = points.shape[1]
    near = np.argsort(np.linalg.norm(points[others] - points[i], axis=1))
    active = np.zeros(len(others), dtype=bool)
    active[near[: 10 * n]] = True
    while True:
        spend(program_effort(int(active.sum()) + 1, n + 1))
        g, margin = widest(np.concatenate([points[others[active]], -points[[i]]]))
        if margin <= 1e-9:
            return False, None
        height = np.where(active, np.inf, points[others] @ g)
        forgotten = np.argsort(height)[: 4 * n]
        forgotten = forgotten[height[forgotten] < 0.5 * margin]
        if not forgotten.size:
            return True, g
        active[forgotten] = True
