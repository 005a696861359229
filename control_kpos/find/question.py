"""What a cone must do (A R = R P, hold given vectors, lie in given half-spaces), and candidates for its generators.

Candidates come from eigenvectors, linear programs and random starts, and are not trusted.  `prove` tries to prove a
candidate, with the multipliers P that come with it or with those of linear programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cones import PolyhedralCone
from ..exact.budget import spend
from ..exact.matrix import Matrix
from ..proof.answer import first_proven
from ..proof.proposed_weights import multipliers
from .certificate import ConeCertificate
from .generators import proper_cone

Array = NDArray[np.float64]

# A proof takes a few products of n x n with n x N matrices, and singular values: operations divided by n^2 N.
_PER_PRODUCT = 0.6


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
    def has_ports(self) -> bool:
        """Whether there are vectors to hold or half-spaces to lie in."""
        return self.contains is not None or self.within is not None

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


@dataclass(frozen=True, eq=False)
class Proven:
    """A certificate that is PROVED, and the candidate it is about."""

    certificate: ConeCertificate
    candidate: Candidate

    def cone(self) -> PolyhedralCone:
        """The cone; the dual of what the generators span if they are facet normals."""
        cone = proper_cone(self.candidate.rays, self.candidate.separators, self.candidate.right_inverse)
        return cone.dual if self.certificate.by_facets else cone


def prove(question: Question, candidate: Candidate) -> Proven | None:
    """The certificate of the candidate, or None if it proves nothing."""
    size = candidate.rays.values.shape[0]
    spend(_PER_PRODUCT * size * question.matrices.values.size)
    P = candidate.multipliers
    if P is None:
        P = _by_programs(question, candidate)
    certificate = None
    if P is not None:
        certificate = question.settle(
            rays=candidate.rays,
            multipliers=P,
            pointing=candidate.pointing,
            right_inverse=candidate.right_inverse,
            shares=candidate.combinations,
        )
    question.report(f"a cone with {size} rays: {'proved' if certificate else 'not proven'}")
    return Proven(certificate, candidate) if certificate else None


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
