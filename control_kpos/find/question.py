"""What a cone must do (A R = R P, hold given vectors, lie in given half-spaces), and candidates for its generators.

Candidates come from eigenvectors, linear programs and random starts, and are not trusted.  `prove` tries to prove a
candidate, with the multipliers P that come with it or with those of linear programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from control import StateSpace
from numpy.typing import NDArray

from ..cones import Cone, PolyhedralCone
from ..cones.base import HoldsCone
from ..cones.extreme import LOW
from ..exact.budget import OutOfBudgetError, spend
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.answer import Answer, first_proven
from ..proof.certificate import Status
from ..proof.inclusion import GeneratorProof
from ..proof.proposed_weights import Found, multipliers
from .certificate import ConeCertificate, Obstruction

Array = NDArray[np.float64]

# A cone with a larger condition number is numerically flat: proven, but of no use.
FLAT = 1e12
# A proof takes a few products of n x n with n x N matrices, and singular values: operations divided by n^2 N.
_PER_PRODUCT = 0.6

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


@dataclass(frozen=True, eq=False)
class Proven:
    """A certificate that is PROVED, and the candidate it is about."""

    certificate: ConeCertificate
    candidate: Candidate

    def cone(self) -> PolyhedralCone:
        """The cone; the dual of what the generators span if they are facet normals."""
        cone = proper_cone(self.candidate.rays, self.candidate.separators, self.candidate.right_inverse)
        if not self.certificate.by_facets:
            vars(cone)["_found"] = self._proofs()
        return cone.dual if self.certificate.by_facets else cone

    def _proofs(self) -> list[Found]:
        """What proves the cone for each matrix, where its multipliers are dense."""
        c, about = self.certificate, (self.candidate.pointing, self.candidate.right_inverse)
        if c.multipliers is None or c.multipliers.is_sparse:
            return []
        count = c.matrices.shape[0]
        return [Found(c.matrices[s], GeneratorProof(*about, c.multipliers[s])) for s in range(count)]


def prove(question: Question, candidate: Candidate) -> Proven | None:
    """The certificate of the candidate, or None if it proves nothing, or a limit leaves too little for it."""
    size = candidate.rays.values.shape[0]
    found = None
    with suppress(OutOfBudgetError):  # another candidate may be cheaper to prove
        spend(_PER_PRODUCT * size * question.matrices.values.size)
        P = _by_programs(question, candidate) if candidate.multipliers is None else candidate.multipliers
        if P is not None:
            certificate = question.settle(
                rays=candidate.rays,
                multipliers=P,
                pointing=candidate.pointing,
                right_inverse=candidate.right_inverse,
                shares=candidate.combinations,
            )
            found = Proven(certificate, candidate) if certificate.status is Status.PROVED else None
    question.report(f"a cone with {size} rays: {'proved' if found else 'not proven'}")
    return found


def first_cone(question: Question, candidates: Iterable[Candidate]) -> Proven | None:
    """The first of the candidates that is proven."""
    return first_proven(candidates, partial(prove, question))


def _by_programs(question: Question, candidate: Candidate) -> Matrix | None:
    """Multipliers of all matrices, by linear programs and rational arithmetic."""
    found = []
    for A in (question.searched[s] for s in range(question.matrices.shape[0])):
        P = multipliers(A, candidate.rays, candidate.pointing, discrete=question.discrete)
        if P is None:
            return None
        found.append(P)
    return Matrix.stack(found)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ConeAnswer(Answer, HoldsCone):
    """The answer of a search for a cone, taken wherever a cone is asked for.

    Attributes
    ----------
    cone : Cone or None
    """

    cone: Cone | None = None

    def __cone__(self) -> Cone | str:
        return self.cone if self and self.cone is not None else self.explain()

    @property
    def explanation(self) -> str:
        """`message`, by its earlier name."""
        return self.message

    def __repr__(self) -> str:
        if self.cone is None:
            return super().__repr__()
        return f"<{type(self).__name__} {self.status.name}, {self.cone!r}>"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FoundCone(ConeAnswer):
    """A cone with the proof that it is invariant, a proof that there is none, or neither.

    `bool(found)` is True only if a cone was found, proven, and is not numerically flat.  A `FoundCone` is taken
    wherever a cone is asked for; one without a cone is refused there with its reason.

    Attributes
    ----------
    certificate : ConeCertificate
        The proof, which recomputes itself with `check()`.
    cone : Cone or None
        Proper and invariant; None unless the certificate is PROVED.
    fewest_rays : int
        Lower bound on the number of generators (`few="facets"`: of facets) of any invariant cone, from
        eigenvalues in floating point: computed, not proven.
    conditioning : float
        Condition number of the generators scaled to length 1, states in balanced units.
    system : StateSpace or None
        For a transfer function: its realization by `control.ss`, whose states the cone is in.
    """

    certificate: ConeCertificate  # type: ignore[reportGeneralTypeIssues]  (never without one)
    fewest_rays: int = 1
    conditioning: float = np.inf
    system: StateSpace | None = None

    @classmethod
    def of(cls, question: Question, proven: Proven, fewest_rays: int) -> FoundCone:
        """The answer for a cone that is proven; UNDECIDED if it is numerically flat.

        Parameters
        ----------
        question : Question
        proven : Proven
        fewest_rays : int
        """
        conditioning = proven.candidate.conditioning
        flat = not conditioning <= FLAT
        message = (
            "This is numerically flat, hence no success: rescale the states, or separate the dominant eigenvalue more."
        )
        return cls(
            status=Status.UNDECIDED if flat else Status.PROVED,
            certificate=proven.certificate,
            message=message if flat else "",
            cone=proven.cone(),
            fewest_rays=fewest_rays,
            conditioning=conditioning,
        )

    @property
    def is_flat(self) -> bool:
        """True if the cone is so thin that nothing should be built on it."""
        return self.certificate.status is Status.PROVED and not self.conditioning <= FLAT

    @property
    def obstruction(self) -> Obstruction | None:
        """For REFUTED: why no such cone exists."""
        return self.certificate.witness

    @property
    def rays(self) -> NDArray[np.float64] | None:
        """Generators of the cone, one a row; None if there is no cone."""
        return None if self.cone is None else self.cone.rays

    @property
    def n_rays(self) -> int:
        """Number of rays of the cone (of facets, if few facets were asked for); 0 if there is no cone."""
        if self.cone is None:
            return 0
        return self.cone.n_facets if self.certificate.by_facets else self.cone.n_rays

    @property
    def v(self) -> NDArray[np.float64] | None:
        """Common Lyapunov vector on the cone, if one was found."""
        return self.certificate.v

    def explain(self) -> str:
        """A few sentences a person can act on.

        Returns
        -------
        str
        """
        parts = [self.certificate.explain()]
        if self.certificate.status is Status.PROVED:
            kind = "facets" if self.certificate.by_facets else "rays"
            parts.append(
                f"Computed, not proven: every such cone has at least {self.fewest_rays} {kind}; conditioning "
                f"{self.conditioning:.3g}."
            )
        if self and self.certificate.matrices.shape[0] > 1:
            stable = "" if self.v is None else "; v proves stability under arbitrary switching"
            parts.append(f"It is invariant under the whole convex hull of the family{stable}.")
        return " ".join([*parts, self.message]).strip()

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        if self.cone is None:
            return []
        return [
            ("cone", repr(self.cone)),
            ("fewest rays of any such cone, computed", str(self.fewest_rays)),
            ("conditioning, computed", f"{self.conditioning:.3g}"),
        ]
