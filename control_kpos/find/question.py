"""What a cone must do (A R = R P, hold given vectors, lie in given half-spaces), and candidates for its generators.

Candidates come from eigenvectors, linear programs and random starts, and are not trusted.  `prove` tries to prove a
candidate, with the multipliers P that come with it or with those of linear programs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone, PolyhedralCone
from ..cones.extreme import LOW
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from .certificate import ConeCertificate

Array = NDArray[np.float64]

# A cone with a larger condition number is numerically flat: proven, but of no use.
FLAT = 1e12

# More generators are not compared with each other.
_COMPARED = 3000
# More numbers, in dimensions where facets may be many, are not put through an enumeration for redundant generators.
_ENUMERATED = 1600


def quiet(line: str) -> None:
    """Report nothing."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """Is there a proper polyhedral cone X that every A_s leaves invariant, between vectors and half-spaces?

    Attributes
    ----------
    matrices : Matrix, shape (M, n, n)
        A_1..A_M.
    discrete : bool
        True: A_s X in X; False: e^{A_s t} X in X.
    contains : Matrix, shape (k, n), or None
        Vectors that X must hold.
    within : Matrix, shape (r, n), or None
        Normals of half-spaces that X must lie in.
    max_rays : int or None
        Largest number of generators (`by_facets`: of facets).
    by_facets : bool
        Few facets instead of few generators: the search is for the dual cone and the transposed matrices.
    switching : bool
        Look for a common Lyapunov vector on X as well.
    seed, restarts : int
        Random starts.
    report : callable
        Called with reports of long work.
    """

    matrices: Matrix
    discrete: bool = False
    contains: Matrix | None = None
    within: Matrix | None = None
    max_rays: int | None = None
    by_facets: bool = False
    switching: bool = False
    seed: int = 0
    restarts: int = 200
    report: Callable[[str], None] = quiet

    @property
    def dim(self) -> int:
        """n."""
        return self.matrices.values.shape[-1]

    @property
    def searched(self) -> Matrix:
        """The matrices that keep the cone of the generators searched for, shape (M, n, n)."""
        return self.matrices.T if self.by_facets else self.matrices

    @property
    def ports(self) -> tuple[Matrix, Matrix]:
        """Vectors and normals, without rows where there are none."""
        nothing = Matrix.zeros(0, self.dim)
        return (
            nothing if self.contains is None else self.contains,
            nothing if self.within is None else self.within,
        )

    def admits(self, size: int) -> bool:
        """Whether so many generators are allowed."""
        return self.max_rays is None or size <= self.max_rays

    def at_least(self, fewest: int) -> str:
        """How many rays (by facets: facets) a cone has at least; only n, the dimension, is proven."""
        kind = "facets" if self.by_facets else "rays"
        reason = ", by the computed eigenvalues" if fewest > self.dim else ""
        return f"Any such cone has at least {fewest} {kind}{reason}."

    def settle(self, **proof: Any) -> ConeCertificate:
        """The certificate of an answer with this proof, or with this witness that there is none."""
        return ConeCertificate.settle(
            matrices=self.matrices,
            discrete=self.discrete,
            contains=self.contains,
            within=self.within,
            by_facets=self.by_facets,
            **proof,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """Generators of a cone, before any proof.

    Attributes
    ----------
    rays : Matrix, shape (N, n)
    pointing : ndarray, shape (n,)
        Should be positive on every generator.
    right_inverse : ndarray, shape (N, n)
        Y with R Y = I up to rounding.
    multipliers : Matrix, shape (M, N, N), or sparse, shape (N, N), or None
        P_s with A_s R = R P_s up to rounding; None: to be found by linear programs.
    combinations : Matrix, shape (k, N), or None
        The vectors that the cone must hold, in terms of its generators.
    separators : ndarray, shape (N, n), or None
        Row i should be negative on generator i and positive on all others.
    units : ndarray, shape (n,), or None
        Units of the states in which the cone is judged flat or not.
    """

    rays: Matrix
    pointing: Array
    right_inverse: Array
    multipliers: Matrix | None = None
    combinations: Matrix | None = None
    separators: Array | None = None
    units: Array | None = None

    @property
    def conditioning(self) -> float:
        """Condition number of the generators scaled to length 1; large: nearly in a hyperplane, or nearly a line."""
        R = np.asarray(self.rays.values) / (1.0 if self.units is None else self.units)
        lengths = np.linalg.norm(R, axis=1)
        return float(np.linalg.cond(R / lengths[:, None])) if (lengths > 0).all() else np.inf


class GeneratedCone(PolyhedralCone):
    """A `PolyhedralCone` known to be proper, and perhaps all of whose generators (as a dual: normals) are extreme.

    Extreme ones cost nothing to read; where that is not known, redundant ones are found exactly when the cone is asked
    for its rays.  Made by `proper_cone`.
    """

    @property
    def _known(self) -> Matrix | None:
        """What is extreme of what the cone was made from, where no enumeration is needed for it."""
        made = self._conversion
        if made.is_irredundant:
            return made.generators
        few = self.dim < LOW or made.generators.values.size <= _ENUMERATED or "faces" in vars(made)
        return None if (few and self.dim != 3) or made.extreme is None else made.extreme.rays

    @property
    def exact_rays(self) -> Matrix:
        """Generators as exact data; none is redundant."""
        return super().exact_rays if self._is_swapped or self._known is None else self._known

    @property
    def exact_facets(self) -> Matrix:
        """Facet normals as exact data; none is redundant."""
        return super().exact_facets if not self._is_swapped or self._known is None else self._known

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
        made = self._conversion
        if not made.is_irredundant:
            return super().__repr__()
        return (
            f"<PolyhedralCone in R^{self.dim}: {made.generators.shape[0]} {'facets' if self._is_swapped else 'rays'}>"
        )


def proper_cone(
    rays: Matrix, separators: NDArray[np.float64] | None, right_inverse: NDArray[np.float64]
) -> PolyhedralCone:
    """The cone of generators that are already proven to span a proper cone.

    Parameters
    ----------
    rays : Matrix, shape (N, n)
    separators : ndarray, shape (N, n), or None
        Row i should be negative on generator i and positive on all others, which proves generator i
        extreme.  Where this fails, or without them, redundant generators are found exactly when the cone is asked
        for its rays; of more than `_COMPARED` generators in four dimensions and above all are taken to be extreme.
    right_inverse : ndarray, shape (N, n)
        Y with rays' Y close to the identity.
    """
    cone = GeneratedCone._build(vars(Cone._from_rays(rays))["_conversion"], False)  # the rays need no reading
    vars(cone)["_right_inverse"] = right_inverse  # cones refuse to be changed from outside
    alike = rays.shape[0] > _COMPARED and rays.shape[1] > 3
    cone._conversion.is_irredundant = alike or _are_extreme(rays, separators)
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
