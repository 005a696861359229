"""`positive_realization`: nonnegative matrices for a transfer function, a system or an impulse response.

The minimal realization is formed exactly.  `find_cone` seeks a cone that A keeps between B and C, or refutes every such
cone, and with it every positive realization.  Rays that are not needed are dropped, and the coordinates in terms of the
rays that are left are solved in fractions.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from control import InputOutputSystem, StateSpace, TransferFunction

from ...cones import Cone, PolyhedralCone
from ...errors import ConeMismatchError, DataError, KposError, TooLargeError
from ...exact.intake import dimensions, exact_matrix, found
from ...exact.linalg import Rationals, product, solve_columns
from ...exact.matrix import Matrix
from ...exact.rational_programs import exact_combination
from ...progress import Target
from ...proof.answer import Answer
from ...proof.certificate import Status
from ...systems.statespace import ConeStateSpace
from ...systems.system import System
from ...theorems.positivity import state_positivity
from ..certificate import ConeCertificate
from ..find import find_cone
from ..question import FoundCone
from .certificate import NegativeResponse, PositiveRealizationCertificate
from .minimal import Realization, beside_each_other, companion, minimal, of_response

# Rays that are tried one by one whether the cone does without them; work of a linear program in fractions; orders that
# are asked for one by one above the lower bound.
_DROPPED, _WORK, _MORE = 30, 10**8, 4


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
        Every realization, nonnegative or not, has at least so many states: the order of a minimal one, exactly.
    """

    system: ConeStateSpace | None = None
    order: int | None = None
    lower_bound: int = 0

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
        order n.
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
        G is none of these, has more zeros than poles, is constant, or its numbers do not determine a system.
    TooLargeError
        More than 40 states.

    Notes
    -----
    Costs a minimal realization in fractions, and what `find_cone` costs for it with its inputs and outputs, once more
    for a few small numbers of rays.  Rays that the cone does not need are dropped; a smaller order may exist.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> found = kp.positive_realization(ct.tf([1, 5, 5], [1, 6, 11, 6]))
    >>> found.status.name, found.order, found.lower_bound
    ('PROVED', 3, 3)
    >>> kp.positive_realization(ct.tf([1, -1], [1, 3, 2])).status.name
    'REFUTED'
    """
    given, dt = _read(G)
    small = minimal(given.A, given.B, given.C, given.D)
    discrete, n = dt is not None and dt != 0, len(small.A)
    if not n:
        raise DataError("G is constant: y = D u has no states that a realization could have.")
    A, B, C, D = small.matrices
    data = {"A": A, "B": B, "C": C, "D": D, "discrete": discrete}
    for step, response in enumerate((small.D, product(small.C, small.B))):
        for i, j in np.argwhere(response < 0):
            where = NegativeResponse(int(i), int(j), step)
            cert = PositiveRealizationCertificate.settle(**data, witness=where)
            return PositiveRealization(status=cert.status, certificate=cert, lower_bound=n)
    inner, outer = B.T[np.flatnonzero(small.B.any(axis=0))], C[np.flatnonzero(small.C.any(axis=1))]
    try:
        cone = find_cone(A, inner, outer, discrete=discrete, time_limit=time_limit, progress=progress)
    except ConeMismatchError as error:
        return _undecided(PositiveRealizationCertificate.settle(**data), n, str(error))
    if cone.status is Status.REFUTED:
        return PositiveRealization(status=cone.status, certificate=cone.certificate, message=_NONE, lower_bound=n)
    if cone.cone is None:
        return _undecided(PositiveRealizationCertificate.settle(**data), n, cone.message)
    limits = range(n, min(cone.cone.n_rays, n + _MORE))
    search = partial(find_cone, A, inner, outer, discrete=discrete, time_limit=time_limit, progress=progress)
    fewer = (search(max_rays=most) for most in limits)
    smaller = (_certified(small, data, other) for other in fewer if other.cone is not None)
    cert = next(filter(None, smaller), None) or _certified(small, data, cone)
    if not cert:
        return _undecided(cert, n, "A cone was found, but its coordinates in fractions would take too long.")
    system = ConeStateSpace(cert.A_positive, cert.B_positive, cert.C_positive, D, dt)
    return PositiveRealization(status=cert.status, certificate=cert, system=system, order=system.nstates, lower_bound=n)


_NONE = "No realization of any order has nonnegative matrices; the matrices of the proof are minimal."


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
    for rays in (_fewer(s, cone, discrete), proof.rays.fractions()):
        try:
            P, N = _weights(rays, product(s.A, rays.T), free=not discrete), _weights(rays, s.B, free=False)
        except TooLargeError:
            continue
        if P is not None and N is not None:
            out = {"A_positive": P, "B_positive": N, "C_positive": product(s.C, rays.T), "transform": rays.T}
            return {name: Matrix.from_fractions(M) for name, M in out.items()}
    return {}


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
