"""The search for a cone: untrusted candidates in order of cost until one is proven, or a proof that there is none."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import DataError
from ..exact.budget import OutOfBudgetError, budget, ended_by, reason
from ..proof.answer import first_proven
from ..proof.certificate import Status
from .answer import FoundCone
from .certificate import Obstruction
from .family.search import FamilySearch, with_common_vector, with_separators
from .impossible.existence import spectral_obstruction
from .impossible.filters import family_obstruction
from .impossible.port_obstruction import port_obstruction
from .one_matrix import search as one_matrix
from .one_matrix.repeated import repeated_cones
from .ports import search as ports
from .question import Candidate, Proven, Question, prove

# Operations of a search without a time limit: half a minute or so.
_EFFORT = 3e10


class _OneMatrix:
    """One matrix, with or without vectors to hold and half-spaces to lie in."""

    obstruction_first = False

    def __init__(self, question: Question) -> None:
        self.question = question
        self.analysis = one_matrix.analysis(question.searched[0], discrete=question.discrete)
        self.fewest_rays = self.analysis.fewest_rays

    def candidates(self) -> Iterator[Candidate]:
        question = self.question
        if question.has_ports:
            yield from ports.candidates(question, self.analysis)
            return
        yield from one_matrix.candidates(question, self.analysis)
        yield from repeated_cones(question)
        if question.max_rays is not None:  # the modes need more: turn and move rays instead
            yield from FamilySearch(question).candidates()

    def obstruction(self) -> Obstruction | None:
        A, (vectors, normals) = self.question.matrices[0], self.question.ports
        found = spectral_obstruction(A, discrete=self.question.discrete)
        if found is None and self.question.has_ports:
            return port_obstruction(A, vectors, normals, discrete=self.question.discrete)
        return found

    def finished(self, found: Proven) -> Proven:
        return with_common_vector(self.question, found) if self.question.switching else found

    def shortfall(self) -> str:
        return f"Any such cone needs at least {self.fewest_rays} rays."


class _Family:
    """Several matrices: cheap proofs that there is no cone come first."""

    obstruction_first = True

    def __init__(self, question: Question) -> None:
        self.question, self.search = question, FamilySearch(question)
        self.fewest_rays = max(a.fewest_rays for a in self.search.analyses)

    def candidates(self) -> Iterator[Candidate]:
        return self.search.candidates()

    def obstruction(self) -> Obstruction | None:
        question = self.question
        found = family_obstruction(question.matrices, self.search.modes_in_user_units(), discrete=question.discrete)
        if found is not None:
            question.report(f"excluded: {found}")
        return found

    def finished(self, found: Proven) -> Proven:
        return with_common_vector(self.question, with_separators(found))

    def shortfall(self) -> str:
        if self.search.is_near:
            return (
                f"Rays were found that all matrices keep up to {max(-self.search.best, 0.0):.1g}, but the numbers "
                "leave no margin for a proof. If such a cone is meant to exist, give exact data (fractions), else a "
                "smaller family."
            )
        return (
            f"Any common cone needs at least {self.fewest_rays} rays. More restarts, another seed or more time may "
            "help."
        )


def find(question: Question) -> FoundCone:
    """Try the strategies in order of cost; the first proof ends the search."""
    strategy = _OneMatrix(question) if question.matrices.shape[0] == 1 else _Family(question)
    fewest = strategy.fewest_rays

    def proven(candidate: Candidate) -> Proven | None:
        try:
            return prove(question, candidate)
        except OutOfBudgetError:  # another candidate may be cheaper to prove
            return None

    obstruction = strategy.obstruction() if strategy.obstruction_first else None
    if obstruction is None and question.admits(fewest):
        found = first_proven(strategy.candidates(), proven)
        if found is not None:
            return FoundCone.of(question, strategy.finished(found), fewest)
    if not strategy.obstruction_first:
        obstruction = strategy.obstruction()
    if obstruction is not None:
        certificate = question.settle(witness=obstruction)
        return FoundCone(status=certificate.status, certificate=certificate, fewest_rays=fewest)
    if not question.admits(fewest):
        raise DataError(
            f"max_rays is {question.max_rays}, but every invariant polyhedral cone of this matrix has at least "
            f"{fewest} rays (and as many facets); ask for max_rays >= {fewest}."
        )
    limit = ended_by()
    return _undecided(question, (f"{_ended(limit)} " if limit else "") + strategy.shortfall(), fewest)


def find_within(question: Question, time_limit: float | None) -> FoundCone:
    """What `find` answers; UNDECIDED if a limit ends it, or eigenvalues or singular values do not converge."""
    operations = _EFFORT if time_limit is None else np.inf
    with np.errstate(all="ignore"), budget(operations, time_limit=time_limit):
        try:
            return find(question)
        except OutOfBudgetError:
            return _undecided(question, _ended(reason()), question.dim)
        except np.linalg.LinAlgError as error:
            return _undecided(question, f"Numerical linear algebra failed: {error}.", question.dim)


def _undecided(question: Question, message: str, fewest_rays: int) -> FoundCone:
    return FoundCone(status=Status.UNDECIDED, certificate=question.settle(), message=message, fewest_rays=fewest_rays)


def _ended(limit: str) -> str:
    """Which limit ended the search, as a sentence."""
    more = "more may help" if "time limit" in limit else "time_limit= sets another one, in seconds"
    return f"{limit[0].upper()}{limit[1:]} ended the search; {more}."
