"""find_cone: a cone X with e^{At} X inside X (A X inside X), for one matrix, a system, or a family.

Untrusted candidates are tried in order of cost until one is proven, or there is a proof that no cone exists.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, Literal, TypeVar

import numpy as np
from control import InputOutputSystem, StateSpace, TransferFunction

from ..cards import about
from ..cones import Cone
from ..cones.base import held_cone
from ..errors import ConeMismatchError, DataError, ShapeError, TimebaseError, TooLargeError
from ..exact.budget import OutOfBudgetError, budget, ended_by, reason
from ..exact.intake import choice, dimensions, exact_matrix, flag, items, seconds, whole_number
from ..exact.matrix import Matrix
from ..exact.products import exact_product
from ..exact.rational_programs import exact_feasibility
from ..exact.signs import BilinearForms
from ..progress import Reporter, Target
from ..proof.answer import first_proven
from ..proof.certificate import Status
from ..systems.reading import realized
from ..systems.system import System
from .answer import FoundCone
from .certificate import Obstruction
from .family.search import FamilySearch, completed
from .impossible.filters import family_obstruction
from .impossible.jordan_index import matrix_obstruction
from .impossible.response import near_zero, obstruction_between
from .one_matrix import search as one_matrix
from .one_matrix.close_modes import close_cones
from .one_matrix.modes import Analysis, analysis
from .one_matrix.repeated import repeated_cones
from .ports import search as ports
from .proven import prove
from .question import Candidate, Question

T = TypeVar("T")

# Operations of a search without a time limit: half a minute or so.
_EFFORT = 3e10


def find_cone(
    A: Any,
    contains: Any = None,
    within: Any = None,
    max_rays: int | None = None,
    *,
    discrete: bool | None = None,
    few: Literal["rays", "facets"] = "rays",
    seed: int = 0,
    restarts: int = 200,
    time_limit: float | None = None,
    progress: Target = None,
) -> FoundCone:
    """Find a proper polyhedral cone X that A leaves invariant, or prove that there is none.

    Continuous time: e^{At} X inside X for all t >= 0; discrete time: A X inside X.

    Parameters
    ----------
    A : array_like, shape (n, n), StateSpace, TransferFunction, or sequence of matrices or systems
        One matrix; a system, whose cone holds B U and lies in {x : C x in Y}; a transfer function, of which the
        realization by `control.ss` is taken; or a family, for a common cone.
    contains : array_like, shape (k, n), or Cone, optional
        Vectors that X must hold, one a row (for the columns of B: ``B.T``).  For a system it replaces B.
    within : array_like, shape (r, n), or Cone, optional
        Normals of half-spaces that X must lie in, one a row (``C``).  For a system it replaces C.
    max_rays : int, optional
        Largest number of generators.  Where the modes of one matrix give more, a search as for a family follows.
    discrete : bool, optional
        For matrices: discrete time.  Systems know.
    few : {"rays", "facets"}
        Which of the two descriptions of X should be short.  For one matrix without contains and within.
    seed, restarts : int
        Random starts of such a search.
    time_limit : float, optional
        Seconds for the whole search, after which the answer is UNDECIDED; inf for no limit.  Without it operations
        are counted instead, and the answer is the same on every machine; they last for about half a minute.
    progress : callable or bool, optional
        Called with a line about long work.  By default work of more than two seconds shows one line, overwritten, in a
        terminal or a notebook; False: never; True: even if the output is not a terminal.

    Returns
    -------
    FoundCone
        `.cone`, `.certificate`, `.status`: PROVED; REFUTED with `.obstruction`, proven as well; UNDECIDED
        if nothing was found.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, TimebaseError
        Numbers that are not finite and real; sizes that do not fit; `max_rays` below what any cone needs; a
        vector of `contains` outside a half-space of `within`; `discrete` against the system's timebase.

    Notes
    -----
    One matrix: decided by the spectrum (`control_kpos.find.impossible.existence`), built from its modes
    (`explicit`); 0.1 s at n = 30.  With vectors and half-spaces: orbits of rays (`orbit`).  A family: cheap
    refutations (`filters`), then linear programs that turn the rays (`descent`).

    Examples
    --------
    A pair with frequency 4 and gap 2 takes at least 7 rays:

    >>> found = find_cone([[-1, 4, 0], [-4, -1, 0], [0, 0, 1]])
    >>> found.status.name, found.n_rays, found.fewest_rays
    ('PROVED', 7, 7)
    >>> print(find_cone([[0, 1], [-1, 0]]).explain())
    No invariant proper polyhedral cone exists: the rightmost eigenvalues (computed: 0 ± 1i) are not real, ...
    """
    by_facets = choice(few, "few", ("rays", "facets")) == "facets"
    most = None if max_rays is None else whole_number(max_rays, "max_rays", least=1)
    timed = None if discrete is None else flag(discrete, "discrete")
    more: dict[str, Any] = {"seed": whole_number(seed, "seed"), "restarts": whole_number(restarts, "restarts")}
    limit = seconds(time_limit)
    converted = realized(A, "A") if isinstance(A, TransferFunction) else None
    A = A if converted is None else converted
    if isinstance(A, InputOutputSystem) and not isinstance(A, StateSpace):
        raise DataError(f"A is a {type(A).__name__}; give a matrix, a transfer function or a state-space system.")
    if _is_family(A):
        if contains is not None or within is not None or by_facets:
            raise DataError("contains, within and few are for one matrix; a family takes max_rays only.")
        matrices, timed = family(A, "A"), _timed(A, timed)
        more["switching"] = True
    else:
        if isinstance(A, StateSpace):
            A, contains, within, timed = _of_system(A, contains, within, timed)
        matrix = square(A, "A")
        n = matrix.shape[0]
        vectors, normals = _rows(contains, "contains", n, "rays"), _rows(within, "within", n, "facets")
        _require_fit(vectors, normals)
        more |= {"contains": vectors, "within": normals}
        more["by_facets"] = by_facets and vectors is None and normals is None
        matrices = Matrix.stack([matrix])
    with Reporter(progress) as report:
        question = Question(matrices=matrices, discrete=bool(timed), max_rays=most, report=report, **more)
        found = within_limits(
            lambda: _find(question),
            lambda message: _undecided(question, message, question.dim),
            operations=_EFFORT,
            time_limit=limit,
        )
    return (
        found
        if converted is None
        else replace(found, system=converted, message=f"{found.message}{_CONVERTED}".lstrip())
    )


# What is said of a transfer function.
_CONVERTED = (
    " The states are those of `.system`, which control.ss made of the transfer function: its numbers, as rounded "
    "there, are what the proof is about."
)


def _is_family(A: Any) -> bool:
    if isinstance(A, (list, tuple)):
        return not A or isinstance(A[0], StateSpace) or dimensions(A[0]) == 2 or isinstance(A[-1], StateSpace)
    return dimensions(A) == 3


def _timed(members: Any, timed: bool | None) -> bool | None:
    """Whether the time of a family is discrete: the systems in it know."""
    for s, item in enumerate(members):
        if isinstance(item, StateSpace) and item.dt is not None:
            own = bool(item.dt)
            if timed is not None and own != timed:
                kind = "discrete" if timed else "continuous"
                raise TimebaseError(
                    f"A[{s}] has dt = {item.dt}, but the others, or the argument discrete, say {kind} time."
                )
            timed = own
    return timed


def family(data: Any, name: str) -> Matrix:
    """Read several square matrices of one size, or systems, as a stack."""
    given = items(data, name)
    if not given:
        raise ShapeError(f"{name} is an empty family; give at least one matrix.")
    read = [square(x, f"{name}[{s}]") for s, x in enumerate(given)]
    for s, matrix in enumerate(read):
        if matrix.shape != read[0].shape:
            raise ShapeError(
                f"{name}[{s}] is {matrix.shape[0]} x {matrix.shape[1]}, but {name}[0] is {read[0].shape[0]} x "
                f"{read[0].shape[1]}; all matrices of a family must have one size."
            )
    return Matrix.stack(read)


def _of_system(sys: StateSpace, contains: Any, within: Any, discrete: bool | None) -> tuple[Matrix, Any, Any, bool]:
    """A, the vectors B u and the normals C'y of a system, and whether its time is discrete."""
    timed = sys.dt is not None and (sys.dt is True or sys.dt != 0)
    if discrete is not None and discrete != timed:
        raise TimebaseError(f"the system has dt = {sys.dt}, but discrete = {discrete}; leave discrete out.")
    given = System.read(sys, "A")
    if contains is None:
        contains = _nonzero(_product(given.U.exact_rays, given.B.T))
    if within is None:
        within = _nonzero(_product(given.Y.exact_facets, given.C))
    return given.A, contains, within, timed


def _rows(data: Any, name: str, n: int, kind: str) -> Matrix | None:
    """Vectors or normals, one a row, from an array or a cone; None if there are none."""
    if data is None:
        return None
    data = held_cone(data, name)
    if isinstance(data, Cone):
        data = data.exact_rays if kind == "rays" else data.exact_facets
    matrix = exact_matrix(data, name).plain()
    if matrix.shape[1] != n:
        raise ConeMismatchError(
            f"{name} has vectors of size {matrix.shape[1]}, but A is {n} x {n}; give one vector of size {n} a row "
            "(for the columns of B: B.T)."
        )
    return matrix if matrix.shape[0] else None


def _product(left: Matrix, right: Matrix) -> Matrix:
    """Exact product of two matrices."""
    return Matrix.from_fractions(left.plain().fractions() @ right.plain().fractions())


def _nonzero(rows: Matrix) -> Matrix | None:
    """Rows that are not zero; None if there are none."""
    index = np.flatnonzero((np.asarray(rows.values) != 0).any(axis=1))
    return rows[index] if index.size else None


def _require_fit(vectors: Matrix | None, normals: Matrix | None) -> None:
    """Raise if no cone holds the vectors and lies in the half-spaces, whatever the matrix."""
    outside = [] if vectors is None or normals is None else BilinearForms(normals, None, vectors).signs() < 0
    if vectors is not None and normals is not None and np.any(outside):
        i, j = (int(k) for k in np.argwhere(outside)[0])
        product = float(exact_product(normals[[i]], vectors[[j]]).values[0, 0])
        raise ConeMismatchError(
            f"vector {j} of contains (column {j} of B) lies outside half-space {i} of within (row {i} of C): their "
            f"product is {about(product, digits=3)} < 0, so no cone holds the one and "
            "lies in the other. Change the sign of an input or output, or choose other ones."
        )
    _require_one_side(vectors, "contains", "vectors", "holds them holds a line, and is not pointed")
    _require_one_side(normals, "within", "normals", "lies in these half-spaces is flat, and not solid")


def _require_one_side(rows: Matrix | None, name: str, kind: str, consequence: str) -> None:
    """Raise if a combination of some rows with positive weights is zero."""
    if rows is None:
        return
    index = np.flatnonzero((np.asarray(rows.values) != 0).any(axis=1))
    if index.size < 2:
        return
    some = rows[index].fractions()
    try:
        weights, _ = exact_feasibility(np.vstack([some.T, np.ones(len(some), dtype=int)]), [0] * some.shape[1] + [1])
    except TooLargeError:  # a contradiction would only have ended a search that cannot succeed
        return
    if weights is not None:
        used = ", ".join(str(k) for k in index[weights > 0][:6])
        raise ConeMismatchError(
            f"a sum of the {kind} {used} of {name} with positive weights is zero, so every cone that {consequence}. "
            f"Leave one of them out, or change its sign."
        )


def square(data: Any, name: str) -> Matrix:
    """Read a square matrix, or the A of a system."""
    matrix = System.read(data, name).A if isinstance(data, StateSpace) else exact_matrix(data, name)
    if matrix.shape[0] != matrix.shape[1] or not matrix.shape[0]:
        raise ShapeError(f"{name} is {matrix.shape[0]} x {matrix.shape[1]}; it must be square and not empty.")
    return Matrix(matrix.values.toarray()) if matrix.is_sparse else matrix


def _find(question: Question) -> FoundCone:
    """Try the strategies in order of cost; the first proof ends the search.

    That a family has no common cone is asked first, because it is cheap to see.
    """
    family, obstruction = None, None
    if question.matrices.shape[0] == 1:
        known = analysis(question.searched[0], discrete=question.discrete)
        fewest, candidates = known.fewest_rays, _of_one_matrix(question, known)
    else:
        family = FamilySearch(question)
        fewest, candidates = max(a.fewest_rays for a in family.analyses), family.candidates()
        obstruction = family_obstruction(question.matrices, family.modes_in_user_units(), discrete=question.discrete)

    allowed = question.max_rays is None or fewest <= question.max_rays
    if obstruction is None and allowed:
        found = first_proven(candidates, partial(prove, question))
        if found is not None:
            return FoundCone.of(question, completed(question, found) if question.switching else found, fewest)
    if family is None:
        obstruction = _obstruction(question)
    if obstruction is not None:
        certificate = question.settle(witness=obstruction)
        return FoundCone(status=certificate.status, certificate=certificate, fewest_rays=fewest)
    if not allowed:
        raise DataError(
            f"max_rays is {question.max_rays}, but every invariant polyhedral cone has, by the computed eigenvalues, "
            f"at least {fewest} rays (and as many facets); ask for max_rays >= {fewest}."
        )
    shortfall = question.at_least(fewest) if family is None else family.shortfall(fewest)
    if family is None and not question.discrete:
        shortfall += near_zero(question.matrices[0], *question.ports)
    return _undecided(question, f"{ended(ended_by())} {shortfall}".lstrip(), fewest)


def _of_one_matrix(question: Question, known: Analysis) -> Iterator[Candidate]:
    """Cones for one matrix, with or without vectors to hold and half-spaces to lie in."""
    if question.contains is not None or question.within is not None:
        return ports.candidates(question, known)
    strategies = [
        lambda: one_matrix.candidates(question, known),
        lambda: repeated_cones(question),
        lambda: close_cones(question),
    ]
    if question.max_rays is not None:  # the modes need more: turn and move rays instead
        strategies.append(lambda: FamilySearch(question).candidates())
    return chain.from_iterable(strategy() for strategy in strategies)


def _obstruction(question: Question) -> Obstruction | None:
    A, (vectors, normals) = question.matrices[0], question.ports
    found = matrix_obstruction(A, discrete=question.discrete)
    if found is None and (vectors.shape[0] or normals.shape[0]):
        return obstruction_between(A, vectors, normals, discrete=question.discrete)
    return found


def within_limits(
    search: Callable[[], T], undecided: Callable[[str], T], *, operations: float, time_limit: float | None
) -> T:
    """What a search answers; UNDECIDED if a limit ends it, or eigenvalues or singular values do not converge."""
    with np.errstate(all="ignore"), budget(operations if time_limit is None else np.inf, time_limit=time_limit):
        try:
            return search()
        except OutOfBudgetError:
            return undecided(ended(reason()))
        except np.linalg.LinAlgError as error:
            return undecided(f"Numerical linear algebra failed: {error}.")


def _undecided(question: Question, message: str, fewest_rays: int) -> FoundCone:
    return FoundCone(status=Status.UNDECIDED, certificate=question.settle(), message=message, fewest_rays=fewest_rays)


def ended(limit: str) -> str:
    """Which limit ended the search, as a sentence; empty if none did."""
    if not limit:
        return ""
    more = "more may help" if "time limit" in limit else "time_limit= sets another one, in seconds"
    return f"{limit[0].upper()}{limit[1:]} ended the search; {more}."
