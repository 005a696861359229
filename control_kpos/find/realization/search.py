"""`positive_realization`: nonnegative matrices for a transfer function, a system or an impulse response.

The minimal realization is formed exactly.  If it is nonnegative, or G is as it was given and the order cannot be
smaller, there is nothing to seek.  Else as many rays as it needs at least are moved until A keeps
their cone between B and C (`few_states`).  Where that fails, `find_cone` seeks any such cone, or refutes all, and with
them every positive realization; then more rays are moved, but fewer than its cone has.  The coordinates in terms of the
rays are solved in fractions.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial
from typing import Any

import numpy as np
from control import InputOutputSystem, StateSpace, TransferFunction

from ...cones import Cone, PolyhedralCone
from ...errors import ConeMismatchError, DataError, KposError, TooLargeError
from ...exact.budget import OutOfBudgetError, budget
from ...exact.intake import dimensions, exact_matrix, found, seconds
from ...exact.linalg import Rationals, identity, product, solve_columns
from ...exact.matrix import Matrix
from ...exact.rational_programs import exact_combination
from ...progress import Target
from ...proof.answer import Answer
from ...proof.certificate import Status
from ...systems.statespace import ConeStateSpace
from ...systems.system import System
from ...theorems.positivity import state_positivity
from ..answer import FoundCone
from ..certificate import ConeCertificate
from ..find import find_cone, within_limits
from .certificate import NegativeResponse, PositiveRealizationCertificate
from .few_states import few_rays
from .lower_bound import lower_bound
from .minimal import Realization, beside_each_other, companion, connected, minimal, of_response, towards
from .spread import Spread, spread

# Rays that are tried one by one whether the cone does without them; work of a linear program in fractions; numbers of
# states that are tried beyond those of a minimal realization, and starts for each: at first, and later.
_DROPPED, _WORK, _MORE, _STARTS = 30, 10**8, 4, (3, 4)
# Hankel singular values below which a system of smaller order is told of, relative to the largest one.
_NEARLY = 1e-10
# Operations of a search without a time limit, and of that for one number of states; steps for each state after which a
# response is asked for zeros.
_EFFORT, _EACH, _LOOK = 6e10, 2e9, 3


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PositiveRealization(Answer):
    """A realization with nonnegative matrices, a proof that there is none, or neither.

    Attributes
    ----------
    certificate : PositiveRealizationCertificate or ConeCertificate
        PROVED: the matrices and what makes their response that of G.  REFUTED: why there is none.
    system : ConeStateSpace or None
        The realization, on nonnegative orthants.
    order : int or None
        Number of its states.
    lower_bound : int
        Every realization with nonnegative matrices has at least so many states: proven from the order of a minimal
        realization, from eigenvalues that are not real, and in discrete time from zeros of the response.
    scope : str
        For an impulse response: how far it is known, and what is taken to follow.
    """

    system: ConeStateSpace | None = None
    order: int | None = None
    lower_bound: int = 0
    scope: str = ""

    def explain(self) -> str:
        """The verdict, why it holds, and of what response.

        Returns
        -------
        str
        """
        return f"{super().explain()} {self.scope}".rstrip()

    def facts(self) -> list[tuple[str, str]]:
        """The order, and its bound from below."""
        known = [] if self.order is None else [("order", str(self.order))]
        return [*known, ("order at least", str(self.lower_bound))]


def positive_realization(G: Any, *, time_limit: float | None = None, progress: Target = None) -> PositiveRealization:
    """Find a realization with nonnegative matrices, or prove that there is none.

    x' = P x + N u, y = Q x + D u with N, Q, D >= 0 and P >= 0 off the diagonal; in discrete time P >= 0 throughout.

    Parameters
    ----------
    G : TransferFunction, StateSpace, or array_like, shape (k,)
        A transfer function or a system, whose numbers are taken exactly; or an impulse response h_0, h_1, ... of one
        input and output in discrete time, long enough to determine a system: at least 2 n + 1 exact numbers for the
        order n.  What is realized then is the only system of the smallest order that begins so (a minimal partial
        realization).
    time_limit : float, optional
        Seconds, see `find_cone`.
    progress : callable or bool, optional
        See `find_cone`.

    Returns
    -------
    PositiveRealization
        PROVED with `.system`, `.order` and `.lower_bound`: then the impulse response is nonnegative, and responses to
        steps never fall.  REFUTED: no realization of any order has nonnegative matrices.

    Raises
    ------
    DataError
        G is none of these, has more zeros than poles, or its numbers do not determine a system.
    TooLargeError
        More than 40 states.

    Notes
    -----
    Costs a minimal realization in fractions and linear programs that move rays: 0.1 s for 6 states with room for
    them. Where that finds nothing, what `find_cone` costs, and linear programs for a few more states: seconds.  An
    order above `lower_bound` may not be the smallest.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> found = kp.positive_realization(ct.tf([1, 5, 5], [1, 6, 11, 6]))
    >>> found.status.name, found.order, found.lower_bound
    ('PROVED', 3, 3)
    >>> kp.positive_realization(ct.tf([1, -1], [1, 3, 2])).status.name
    'REFUTED'
    """
    limit = seconds(time_limit)
    given, dt = _read(G)
    small = minimal(given.A, given.B, given.C, given.D)
    discrete, n = dt is not None and dt != 0, len(small.A)
    small = small if n else _with_idle_state(small, discrete)
    A, B, C, D = small.matrices
    data = {"A": A, "B": B, "C": C, "D": D, "discrete": discrete}
    for step, response in enumerate((small.D, product(small.C, small.B))):
        for i, j in np.argwhere(response < 0):
            where = NegativeResponse(int(i), int(j), step)
            cert = PositiveRealizationCertificate.settle(**data, witness=where)
            return PositiveRealization(status=cert.status, certificate=cert, lower_bound=n)
    answer = within_limits(
        lambda: (
            _answered(_Task(small, dt, data, lower_bound(small, discrete=discrete), progress), given)
            if n
            else _constant(small, dt, data)
        ),
        lambda message: _undecided(PositiveRealizationCertificate.settle(**data), n, message),
        operations=_EFFORT,
        time_limit=limit,
    )
    if isinstance(G, InputOutputSystem):
        return answer
    return replace(answer, scope=_BEGINS.format(last=len(G) - 1, order=n))


def _with_idle_state(s: Realization, discrete: bool) -> Realization:
    """y = D u with a state that no input reaches and no output sees, for certificates are about some states."""
    q, m = s.D.shape
    zero = np.full((q, m), Fraction(0), dtype=object)
    return Realization(np.array([[Fraction(discrete - 1)]], dtype=object), zero[:1], zero[:, :1], s.D)


def _constant(s: Realization, dt: Any, data: dict[str, Any]) -> PositiveRealization:
    """D >= 0 is positive as it is."""
    cert = PositiveRealizationCertificate.settle(**data, **_from_rays(s, identity(1), data["discrete"]))
    system = ConeStateSpace([], [], [], s.D, dt)
    return PositiveRealization(status=cert.status, certificate=cert, message=_IDLE, system=system, order=0)


@dataclass(frozen=True, eq=False)
class _Task:
    """A minimal system, its timebase, what a certificate says of it, and a bound of the order."""

    small: Realization
    dt: Any
    data: dict[str, Any]
    bound: int
    progress: Target

    @property
    def discrete(self) -> bool:
        return self.data["discrete"]

    @cached_property
    def is_zero_at_times(self) -> bool:
        """Whether the response of an output is exactly zero after a few steps (continuous time: derivatives of it)."""
        x, zero = self.small.B, False
        for _ in range(_LOOK * len(x)):
            zero |= bool((product(self.small.C, x) == 0).any())
            x = product(self.small.A, x)
        return zero

    def found(self, cert: PositiveRealizationCertificate) -> PositiveRealization:
        system = ConeStateSpace(cert.A_positive, cert.B_positive, cert.C_positive, cert.D, self.dt)
        return PositiveRealization(
            status=cert.status, certificate=cert, system=system, order=system.nstates, lower_bound=self.bound
        )


def _answered(task: _Task, given: Realization) -> PositiveRealization:
    """What is found, unless G is nonnegative as it was given and of no larger order."""
    own = _as_given(task, given)
    if own is not None and own.order == task.bound:
        return own
    answer = _searched(task)
    is_better = own is not None and (answer.status is Status.UNDECIDED or (answer.order or 0) > (own.order or 0))
    return own if own is not None and is_better else answer


def _as_given(task: _Task, given: Realization) -> PositiveRealization | None:
    """The minimal realization, or G without states that do nothing, if the certificate finds no sign against it."""
    for s in (task.small, connected(given)):
        R = towards(task.small, s) if _is_nonnegative(s, task.discrete) else None
        if R is not None:
            matrices = {"A_positive": s.A, "B_positive": s.B, "C_positive": s.C, "transform": R}
            fields = {name: Matrix.from_fractions(M) for name, M in matrices.items()}
            cert = PositiveRealizationCertificate.settle(**task.data, **fields)
            if cert:
                return task.found(cert)
    return None


def _is_nonnegative(s: Realization, discrete: bool) -> bool:
    off = s.A if discrete else s.A[~np.eye(len(s.A), dtype=bool)]
    return all((M >= 0).all() for M in (off, s.B, s.C, s.D))


def _searched(task: _Task) -> PositiveRealization:
    """Few states first, as few as the bound says; then any cone, or a proof that there is none; then between."""
    small, data, n = task.small, task.data, len(task.small.A)
    coordinates = spread(small, discrete=task.discrete)
    cert = _with_states(task, coordinates, task.bound, few=True)
    if cert is not None:
        return task.found(cert)
    A, B, C, _ = small.matrices
    inner, outer = B.T[np.flatnonzero(small.B.any(axis=0))], C[np.flatnonzero(small.C.any(axis=1))]
    search = partial(find_cone, A, discrete=task.discrete, progress=task.progress)
    try:
        cone = search(inner, outer)
    except ConeMismatchError as error:  # inputs, or outputs, against each other: some response is negative
        single = (search(inner[[j]], outer[[i]]) for j in range(inner.shape[0]) for i in range(outer.shape[0]))
        cone = next((found for found in single if found.status is Status.REFUTED), None)
        if cone is None:
            return _undecided(PositiveRealizationCertificate.settle(**data), task.bound, str(error))
    if cone.status is Status.REFUTED:
        message = _NONE + (_THIN if coordinates is not None and coordinates.thinness < _NEARLY else "")
        return PositiveRealization(
            status=cone.status, certificate=cone.certificate, message=message, lower_bound=task.bound
        )
    most = n + _MORE if cone.cone is None else min(cone.cone.n_rays - 1, n + _MORE)
    smaller = (_with_states(task, coordinates, count, few=False) for count in range(task.bound, most + 1))
    cert = next(filter(None, smaller), None)
    if cert is None and cone.cone is None:
        return _undecided(PositiveRealizationCertificate.settle(**data), task.bound, cone.message)
    cert = cert or _certified(small, data, cone)
    if not cert:
        message = "A cone was found, but its coordinates in fractions would take too long."
        return _undecided(cert, task.bound, message)
    return task.found(cert)


def _with_states(task: _Task, s: Spread | None, count: int, *, few: bool) -> PositiveRealizationCertificate | None:
    """A certificate with so many states; few starts, or more of them and of other kinds."""
    if s is None or count > len(s.A) + _MORE:
        return None
    with budget(_EACH), suppress(OutOfBudgetError, np.linalg.LinAlgError):
        chains = [count - 1, *([] if few else range(count - 1))] if s.B.shape[1] == 1 and task.is_zero_at_times else []
        for length in (-1, *chains):
            for rays in few_rays(s, count, length, starts=_STARTS[not few]):
                fields = _from_rays(task.small, rays, task.discrete)
                cert = PositiveRealizationCertificate.settle(**task.data, **fields) if fields else None
                if cert:
                    return cert
    return None


_NONE = "No realization of any order has nonnegative matrices; the proof is about a minimal realization."
_IDLE = "G is constant, y = D u, and needs no states; the certificate is about a state that does nothing."
_THIN = (
    " Computed: a system of a smaller order has nearly the same response. The numbers of G are taken exactly: where a "
    "pole was meant to cancel a zero, leave both out."
)
_BEGINS = (
    "G is known up to h_{last}; its later numbers are taken to be those of the only system of order {order} that "
    "begins with these numbers, and no system of a smaller order does."
)


def _undecided(cert: PositiveRealizationCertificate, n: int, message: str) -> PositiveRealization:
    return PositiveRealization(status=Status.UNDECIDED, certificate=cert, message=message, lower_bound=n)


def _read(G: Any) -> tuple[Realization, Any]:
    """Exact matrices of G, and its timebase."""
    if isinstance(G, TransferFunction):
        parts = [
            [companion(_exact(G.num[i][j], "num"), _exact(G.den[i][j], "den")) for j in range(G.ninputs)]
            for i in range(G.noutputs)
        ]
        return beside_each_other(parts), G.dt
    if isinstance(G, StateSpace):
        system = System.read(G, "G")
        return Realization(*(M.plain().fractions() for M in system.matrices)), G.dt
    if isinstance(G, InputOutputSystem) or dimensions(G) != 1:
        raise DataError(
            f"G is {found(G)}; give a transfer function, a state-space system, or an impulse response as a list of "
            "numbers."
        )
    h = exact_matrix(G, "G", ndim=1).fractions().tolist()
    if not h:
        raise DataError("G is an impulse response without numbers; give h_0, h_1, and so on.")
    return of_response(h), True


def _exact(coefficients: Any, name: str) -> list[Fraction]:
    return exact_matrix(coefficients, f"{name} of G", ndim=1).fractions().tolist()


def _certified(s: Realization, data: dict[str, Any], cone: FoundCone) -> PositiveRealizationCertificate:
    """The certificate that the generators of a cone make."""
    fields = {} if cone.cone is None else _coordinates(s, cone.certificate, cone.cone, data["discrete"])
    return PositiveRealizationCertificate.settle(**data, **fields)


def _coordinates(s: Realization, proof: ConeCertificate, cone: Cone, discrete: bool) -> dict[str, Matrix | None]:
    """P, N, Q and R for the generators of a cone, or of a smaller one; nothing where fractions take too long."""
    if proof.by_facets or proof.rays is None:
        return {}
    return _from_rays(s, _fewer(s, cone, discrete), discrete) or _from_rays(s, proof.rays.fractions(), discrete)


def _from_rays(s: Realization, rays: Rationals, discrete: bool) -> dict[str, Matrix | None]:
    """P, N, Q and R for these rays; nothing where there are none, or fractions take too long."""
    try:
        P, N = _weights(rays, product(s.A, rays.T), free=not discrete), _weights(rays, s.B, free=False)
    except TooLargeError:
        return {}
    if P is None or N is None:
        return {}
    out = {"A_positive": P, "B_positive": N, "C_positive": product(s.C, rays.T), "transform": rays.T}
    return {name: Matrix.from_fractions(M) for name, M in out.items()}


def _weights(rays: Rationals, images: Rationals, *, free: bool) -> Rationals | None:
    """W >= 0 (but for its diagonal, if `free`) with rays' W = images."""
    if len(rays) == rays.shape[1]:
        return solve_columns(rays.T, images)
    found_weights = []
    for i, y in enumerate(images.T):
        weights, _ = exact_combination(rays, y, i if free else None, work_limit=_WORK)
        if weights is None:
            return None
        found_weights.append(weights)
    return np.array(found_weights, dtype=object).T


def _fewer(s: Realization, cone: Cone, discrete: bool) -> Rationals:
    """Generators of a cone without those that it can do without, one after another."""
    rays = cone.exact_rays.plain().fractions()
    A, B = Matrix.from_fractions(s.A), Matrix.from_fractions(s.B.T)
    if len(rays) > _DROPPED:
        return rays
    smaller: Rationals | None = rays
    while smaller is not None:
        rays = smaller
        smaller = next((r for r in _without_one(rays) if _fits(r, A, B, discrete)), None)
    return rays


def _without_one(rays: Rationals) -> list[Rationals]:
    return [np.delete(rays, i, axis=0) for i in range(len(rays))] if len(rays) > rays.shape[1] else []


def _fits(rays: Rationals, A: Matrix, B: Matrix, discrete: bool) -> bool:
    """Whether these generate a proper cone that A keeps and that holds all inputs."""
    try:
        X = PolyhedralCone(rays)
        if not X.is_proper or not np.all(X.contains(B.fractions())):
            return False
        return bool(state_positivity(A, X, discrete=discrete))
    except KposError:
        return False
