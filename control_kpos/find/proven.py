"""Candidates for an invariant cone, proven: the certificate first, then the cone that brings its own multipliers."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from ..cones import PolyhedralCone
from ..exact.budget import OutOfBudgetError, spend
from ..exact.matrix import Matrix
from ..proof.answer import first_proven
from ..proof.certificate import Status
from ..proof.inclusion import GeneratorProof
from ..proof.proposed_weights import Found, multipliers
from .certificate import ConeCertificate
from .question import Candidate, Question, proper_cone

# A proof takes a few products of n x n with n x N matrices, and singular values: operations divided by n^2 N.
_PER_PRODUCT = 0.6


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
