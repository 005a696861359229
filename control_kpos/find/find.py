"""find_cone: the one entrance to all searches for a cone."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import numpy as np
from control import StateSpace, TransferFunction

from ..cones import Cone
from ..errors import (
    ConeMismatchError,
    DataError,
    ShapeError,
    TimebaseError,
    TooLargeError,
)
from ..exact.budget import OutOfTimeError, limited_to
from ..exact.intake import (
    choice,
    dimensions,
    exact_matrix,
    flag,
    items,
    seconds,
    whole_number,
)
from ..exact.matrix import Matrix
from ..exact.rational_programs import exact_feasibility
from ..exact.signs import BilinearForms
from ..progress import Reporter, Target
from ..proof.certificate import Status
from ..systems.system import System
from .certificate import ConeCertificate
from .family.search import NEARLY, Effort, find_common
from .generated import proper_cone
from .impossible.existence import spectral_obstruction
from .impossible.port_obstruction import port_obstruction
from .one_matrix.explicit import fewest_rays
from .one_matrix.modes import dominant_index
from .one_matrix.repeated import repeated_cones
from .one_matrix.search import eigenvalues, find_single, prove_exactly
from .ports.search import find_with_ports
from .result import FoundCone

# Relative distance to which rounding may move copies of a repeated eigenvalue.
_SPLIT = 1e-4


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
    time_limit: float = 30.0,
    progress: Target = None,
) -> FoundCone:
    """Find a proper polyhedral cone X that A leaves invariant, or prove that there is none.

    Continuous time: e^{At} X inside X for all t >= 0; discrete time: A X inside X.

    Parameters
    ----------
    A : array_like, shape (n, n), StateSpace, or sequence of matrices or systems
        One matrix; a system, whose cone holds B U and lies in {x : C x in Y}; or a family, for a common
        cone.
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
    time_limit : float
        Seconds for the whole search, after which the answer is UNDECIDED; inf for no limit.
    progress : callable or bool, optional
        Called with a line about long work.  By default work of more than two seconds shows one line, overwritten, in a
        terminal or a notebook; False: never; True: also where nobody seems to watch.

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
    refutations (`filters`), then linear programs that turn the rays (`commutator`, `moving`).

    Examples
    --------
    A pair with frequency 4 and gap 2 needs at least 7 rays:

    >>> found = find_cone([[-1, 4, 0], [-4, -1, 0], [0, 0, 1]])
    >>> found.status.name, found.n_rays, found.fewest_rays
    ('PROVED', 7, 7)
    >>> print(find_cone([[0, 1], [-1, 0]]).explain())
    No invariant proper polyhedral cone exists: the rightmost eigenvalues 0 ± 1i are not real, and ...
    """
    by_facets = choice(few, "few", ("rays", "facets")) == "facets"
    most = None if max_rays is None else whole_number(max_rays, "max_rays", least=1)
    timed = None if discrete is None else flag(discrete, "discrete")
    effort = Effort(whole_number(seed, "seed"), whole_number(restarts, "restarts"))
    limit = seconds(time_limit)
    if isinstance(A, TransferFunction):
        raise DataError("A is a transfer function, which has no state; convert it with control.ss first.")
    if _is_family(A):
        if contains is not None or within is not None or by_facets:
            raise DataError("contains, within and few are for one matrix; a family takes max_rays only.")
        matrices, timed = family(A, "A"), _timed(A, timed)
        with Reporter(progress) as report:
            search = partial(_common, matrices, most, bool(timed), effort, report)
            return _carefully(search, limit, matrices, bool(timed))
    if isinstance(A, StateSpace):
        matrix, vectors, normals, timed = _of_system(A, contains, within, timed)
    else:
        matrix = square(A, "A")
        n = matrix.shape[0]
        vectors, normals = _rows(contains, "contains", n, "rays"), _rows(within, "within", n, "facets")
    if vectors.shape[0] or normals.shape[0]:
        with Reporter(progress) as report:
            search = partial(_with_ports, matrix, vectors, normals, most, bool(timed), report)
            return _carefully(search, limit, Matrix.stack([matrix]), bool(timed))
    with Reporter(progress) as report:
        search = partial(_one, matrix, most, bool(timed), by_facets, effort, report)
        return _carefully(search, limit, Matrix.stack([matrix]), bool(timed))


def _carefully(search: Callable[[], FoundCone], limit: float, matrices: Matrix, discrete: bool) -> FoundCone:
    """What a search finds; nothing if time is over, or eigenvalues or singular values do not converge."""
    try:
        with np.errstate(all="ignore"), limited_to(limit):
            return search()
    except OutOfTimeError:
        reason = f"The time limit of {limit:g} s ended the search; more may help."
    except np.linalg.LinAlgError as error:
        reason = f"Numerical linear algebra failed: {error}."
    nothing = ConeCertificate.settle(matrices=matrices, discrete=discrete)
    return FoundCone(nothing, None, matrices.shape[-1], np.inf, reason)


def _is_family(A: Any) -> bool:
    if isinstance(A, (list, tuple)):
        return not A or any(isinstance(x, StateSpace) or dimensions(x) == 2 for x in A)
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


def _common(
    matrices: Matrix, max_rays: int | None, discrete: bool, effort: Effort, report: Callable[[str], None]
) -> FoundCone:
    bound = max(lower_bound(matrices[s], discrete=discrete) for s in range(matrices.shape[0]))
    certificate, separators, conditioning, best = find_common(
        matrices, discrete=discrete, max_rays=max_rays, effort=effort, report=report
    )
    if certificate.status is not Status.REFUTED:
        _require_rays(max_rays, bound)
    if not certificate or certificate.rays is None or certificate.right_inverse is None:
        more = f"Any common cone needs at least {bound} rays. More restarts, another seed or more time may help."
        if best > -NEARLY:
            more = (
                f"Rays were found that all matrices keep up to {max(-best, 0.0):.1g}, but the numbers leave no room "
                "for a proof. If such a cone is meant to exist, give exact data (fractions), else a smaller family."
            )
        more = "" if certificate.witness else more
        return FoundCone(certificate, None, bound, np.inf, more)
    cone = proper_cone(certificate.rays, separators, certificate.right_inverse)
    more = (
        "It is invariant under the whole convex hull of the family."
        if certificate.v is None
        else "It is invariant under the whole convex hull of the family; v proves stability under arbitrary switching."
    )
    return FoundCone(certificate, cone, bound, conditioning, more)


def _of_system(
    sys: StateSpace, contains: Any, within: Any, discrete: bool | None
) -> tuple[Matrix, Matrix, Matrix, bool]:
    """A, the vectors B u and the normals C'y of a system, and whether its time is discrete."""
    timed = sys.dt is not None and (sys.dt is True or sys.dt != 0)
    if discrete is not None and discrete != timed:
        raise TimebaseError(f"the system has dt = {sys.dt}, but discrete = {discrete}; leave discrete out.")
    given = System.read(sys, "A")
    matrix = square(given.A, "A")
    n = matrix.shape[0]
    if contains is None:
        contains = _nonzero(_product(given.U.exact_rays, given.B.T))
    if within is None:
        within = _nonzero(_product(given.Y.exact_facets, given.C))
    return matrix, _rows(contains, "contains", n, "rays"), _rows(within, "within", n, "facets"), timed


def _rows(data: Any, name: str, n: int, kind: str) -> Matrix:
    """Vectors or normals, one a row, from an array or a cone; none if data is None."""
    if data is None:
        return Matrix.zeros(0, n)
    if isinstance(data, Cone):
        data = data.exact_rays if kind == "rays" else data.exact_facets
    matrix = exact_matrix(data, name).plain()
    if matrix.shape[1] != n:
        raise ConeMismatchError(
            f"{name} has vectors of size {matrix.shape[1]}, but A is {n} x {n}; give one vector of size {n} a row "
            "(for the columns of B: B.T)."
        )
    return matrix


def _product(left: Matrix, right: Matrix) -> Matrix:
    """Exact product of two matrices."""
    return Matrix.from_fractions(left.plain().fractions() @ right.plain().fractions())


def _nonzero(rows: Matrix) -> Matrix | None:
    """Rows that are not zero; None if there are none."""
    index = np.flatnonzero((np.asarray(rows.values) != 0).any(axis=1))
    return rows[index] if index.size else None


def _with_ports(
    A: Matrix,
    vectors: Matrix,
    normals: Matrix,
    max_rays: int | None,
    discrete: bool,
    report: Callable[[str], None],
) -> FoundCone:
    signs = BilinearForms(normals, None, vectors).signs() if normals.shape[0] and vectors.shape[0] else np.zeros((0, 0))
    if (signs < 0).any():
        i, j = (int(k) for k in np.argwhere(signs < 0)[0])
        raise ConeMismatchError(
            f"vector {j} of contains (column {j} of B) lies outside half-space {i} of within (row {i} of C): their "
            f"product is {float(normals.values[i] @ vectors.values[j]):.6g} < 0, so no cone holds the one and "
            "lies in the other. Change the sign of an input or output, or choose other ones."
        )
    _require_room(vectors, "contains", "vectors", "holds them holds a line, and is not pointed")
    _require_room(normals, "within", "normals", "lies in these half-spaces is flat, and not solid")
    bound = lower_bound(A, discrete=discrete)
    certificate, separators, conditioning = find_with_ports(
        A, vectors, normals, discrete=discrete, max_rays=max_rays, report=report
    )
    if certificate and certificate.rays is not None and certificate.right_inverse is not None:
        cone = proper_cone(certificate.rays, separators, certificate.right_inverse)
        return FoundCone(certificate, cone, bound, conditioning)
    obstruction = spectral_obstruction(A, discrete=discrete) or port_obstruction(A, vectors, normals, discrete=discrete)
    if obstruction is not None:
        refuted = ConeCertificate.settle(
            matrices=Matrix.stack([A]), discrete=discrete, contains=vectors, within=normals, witness=obstruction
        )
        return FoundCone(refuted, None, bound, np.inf)
    _require_rays(max_rays, bound)
    return FoundCone(certificate, None, bound, np.inf, f"Any such cone needs at least {bound} rays.")


def _require_room(rows: Matrix, name: str, kind: str, consequence: str) -> None:
    """Raise if a combination of some rows with positive weights is zero."""
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


def _require_rays(max_rays: int | None, bound: int) -> None:
    if max_rays is not None and max_rays < bound:
        raise _too_few(max_rays, bound)


def _too_few(max_rays: int | None, bound: int) -> DataError:
    return DataError(
        f"max_rays is {max_rays}, but every invariant polyhedral cone of this matrix has at least {bound} rays "
        f"(and as many facets); ask for max_rays >= {bound}."
    )


def square(data: Any, name: str) -> Matrix:
    """Read a square matrix, or the A of a system."""
    matrix = System.read(data, name).A if isinstance(data, StateSpace) else exact_matrix(data, name)
    if matrix.shape[0] != matrix.shape[1] or not matrix.shape[0]:
        raise ShapeError(f"{name} is {matrix.shape[0]} x {matrix.shape[1]}; it must be square and not empty.")
    return Matrix(matrix.values.toarray()) if matrix.is_sparse else matrix


def _one(
    A: Matrix,
    max_rays: int | None,
    discrete: bool,
    by_facets: bool,
    effort: Effort,
    report: Callable[[str], None],
) -> FoundCone:
    bound = lower_bound(A, discrete=discrete)
    searched = A.T if by_facets else A
    if max_rays is not None and max_rays < bound:
        certificate, separators, conditioning = None, None, np.inf
    else:
        certificate, separators, conditioning = find_single(searched, discrete=discrete, max_rays=max_rays)
        if not certificate and not discrete:
            for rays, pointing in repeated_cones(searched):
                if max_rays is None or rays.shape[0] <= max_rays:
                    certificate, separators, conditioning = prove_exactly(searched, rays, pointing, discrete=False)
        if not certificate and max_rays is not None:  # the modes need more: turn and move rays instead
            certificate, separators, conditioning, _ = find_common(
                Matrix.stack([searched]), discrete=discrete, max_rays=max_rays, effort=effort, report=report
            )
    if certificate is None or not certificate:
        obstruction = spectral_obstruction(A, discrete=discrete)
        if obstruction is not None:
            refuted = ConeCertificate.settle(matrices=Matrix.stack([A]), discrete=discrete, witness=obstruction)
            return FoundCone(refuted, None, bound, np.inf)
    if certificate is None:
        raise _too_few(max_rays, bound)
    if not certificate or certificate.rays is None or certificate.right_inverse is None:
        return FoundCone(certificate, None, bound, np.inf, f"Any such cone needs at least {bound} rays.")
    cone: Cone = proper_cone(certificate.rays, separators, certificate.right_inverse)
    if by_facets:
        cone = cone.dual
        data = {**certificate.data(), "matrices": Matrix.stack([A]), "by_facets": True, "v": None}
        certificate = ConeCertificate.settle(**data)
    return FoundCone(certificate, cone, bound, conditioning)


def lower_bound(A: Matrix, *, discrete: bool) -> int:
    """Least number of rays (and of facets) of an invariant polyhedral cone, from the spectrum."""
    values = eigenvalues(A)
    first = dominant_index(values, discrete=discrete)
    rest = values[np.arange(len(values)) != first]
    # Rounding turns a repeated eigenvalue into pairs close to it, which bound nothing.
    rest = rest[np.abs(rest - values[first]) > _SPLIT * np.abs(values).max()]
    size = float(abs(values[first])) if discrete else float(values[first].real)
    return fewest_rays(rest[rest.imag > 0], size, len(values))
