"""Differential positivity: nonlinear systems that keep a cone of displacements.

Let J(x) be the Jacobian of x' = f(x) on a convex region.  If every J(x) is K-positive on X,

    h'J(x) x_i >= 0   for every facet h and generator x_i of X with h'x_i = 0,

then two solutions that start ordered, x(0) - y(0) in X, stay ordered while they remain in the region: the
flow is monotone in the order of X (Forni and Sepulchre, Differentially positive systems, 2016).  The
condition is linear in J, hence holds on a whole interval matrix [mid - rad, mid + rad] if and only if
h'mid x_i - |h|'rad |x_i| >= 0.  If besides v'J(x) x_i < 0 for one v in int X*, V(d) = v'd decreases along
all displacements d in X: the flow contracts.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from control import NonlinearIOSystem, StateSpace
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone, as_cone
from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.budget import OVERTIME, SPEED
from ..exact.intake import (
    dimensions,
    exact_matrix,
    flag,
    items,
    seconds,
    whole_number,
)
from ..exact.intervals import (
    UnboundedError,
    UnsupportedError,
    box_points,
    enclosed_jacobian,
    jacobian_by_differences,
    jacobian_pieces,
)
from ..exact.matrix import Matrix, dense
from ..exact.programs import solve
from ..proof.certificate import Status
from ..systems.system import System
from .certificate import (
    DifferentialCertificate,
    DifferentialViolation,
    extreme_products,
    invariance,
)

Array = NDArray[np.float64]

_SAMPLES = 200
# Share of the time that goes into enclosures; the rest looks for a violation.
_FOR_PROOFS = 0.7
# Last steps of each kind that an estimate rests on.
_TIMED = 15
# To set up a linear program, for each of its entries.
_SECONDS_PER_ENTRY = 2e-7


def differential_positivity(
    jacobians: Any,
    X: Cone | ArrayLike,
    region: ArrayLike | None = None,
    *,
    inputs: ArrayLike | None = None,
    discrete: bool | None = None,
    pieces: int = 256,
    time_limit: float = 60.0,
) -> DifferentialCertificate:
    """Decide whether a nonlinear system keeps the cone X of displacements.

    Parameters
    ----------
    jacobians : NonlinearIOSystem, StateSpace, matrix or sequence of matrices
        A system, with `region`; or the vertices of a set of Jacobians, each (n, n).
    X : Cone, or array_like of its generators, shape (p, n)
        Polyhedral and proper, in R^n.
    region : array_like, shape (n, 2), optional
        Box of states: lower and upper bound of each.
    inputs : array_like, shape (m, 2), optional
        Box of inputs of a system; zero if omitted.
    discrete : bool, optional
        For matrices: x[k+1] = f(x[k]).  Systems know.
    pieces : int
        Largest number of boxes the region may be cut into to tighten the enclosure.
    time_limit : float
        Seconds; what is not settled by then is UNDECIDED.  Boxes are cut while the decisions about them still fit.

    Returns
    -------
    DifferentialCertificate
        `explain()` says what follows.  A system whose function cannot be called with intervals is sampled,
        which is stated and never PROVED.

    Raises
    ------
    ShapeError, ConeMismatchError, DataError, NotProperConeError
        Sizes that do not fit; a region that is not a box; a Jacobian that is unbounded on the region; a system
        that depends on time.

    Examples
    --------
    A pendulum with strong damping, for angles up to a quarter turn:

    >>> import control as ct, control_kpos as kp
    >>> pendulum = ct.nlsys(lambda t, x, u, p: [x[1], -np.sin(x[0]) - 3 * x[1]], inputs=0, states=2)
    >>> X = kp.PolyhedralCone([[1, 0], [1, -2]])
    >>> cert = differential_positivity(pendulum, X, [[-1.5, 1.5], [-9, 9]])
    >>> cert.status.name, cert.source
    ('PROVED', 'enclosed')
    """
    X = as_cone(X, "X")
    X.require_proper("X")
    timed = None if discrete is None else flag(discrete, "discrete")
    clock, pieces = _Clock(seconds(time_limit)), whole_number(pieces, "pieces", least=1)
    if isinstance(jacobians, NonlinearIOSystem) and not isinstance(jacobians, StateSpace):
        return _of_system(jacobians, X, region, inputs, pieces, clock)
    if isinstance(jacobians, StateSpace):
        system = System.read(jacobians, "jacobians")
        timed, jacobians = system.discrete, [system.A]
    elif region is not None or inputs is not None:
        raise DataError(f"{'region' if region is not None else 'inputs'} is for a system, not for matrices.")
    stack = _vertices(jacobians, X)
    return _settled(stack, np.zeros(stack.shape), X, bool(timed), "vertices", clock)


class _Clock:
    """The time limit, and what an enclosure and a decision about one piece take, as measured."""

    def __init__(self, limit: float) -> None:
        self._begin, self.limit, self.last_decision = time.monotonic(), limit, False
        self._spent: dict[str, deque[float]] = {kind: deque(maxlen=_TIMED) for kind in ("enclosure", "decision")}

    @property
    def left(self) -> float:
        return self._begin + self.limit - time.monotonic()

    @contextmanager
    def timing(self, kind: str) -> Iterator[None]:
        """Time one step."""
        begin = time.monotonic()
        try:
            yield
        finally:
            self._spent[kind].append(time.monotonic() - begin)

    def needed(self, kind: str, count: int) -> float:
        """Seconds for so many more steps."""
        return count * float(np.median(self._spent[kind])) if self._spent[kind] else 0.0


def _vertices(data: Any, X: Cone) -> Matrix:
    given = [data] if dimensions(data) == 2 else items(data, "jacobians")
    if not given:
        raise ShapeError("jacobians is empty; give at least one matrix.")
    read = [exact_matrix(item, f"jacobians[{s}]") for s, item in enumerate(given)]
    for s, matrix in enumerate(read):
        if matrix.shape != (X.dim, X.dim):
            raise ConeMismatchError(
                f"jacobians[{s}] is {matrix.shape[0]} x {matrix.shape[1]}, but X has dimension {X.dim}."
            )
    if all(m.is_double for m in read):
        return Matrix(np.array([dense(m.values) for m in read]))
    return Matrix.from_fractions(np.array([m.fractions() for m in read], dtype=object))


def _settled(
    centres: Matrix, radii: Array, X: Cone, discrete: bool, source: str, clock: _Clock
) -> DifferentialCertificate:
    """The certificate for enclosed or given Jacobians, with a violation or a common vector if there is one."""
    data: dict[str, Any] = {"centres": centres, "radii": radii, "X": X, "discrete": discrete, "source": source}
    draft, count = DifferentialCertificate(**data), centres.shape[0]
    for s in range(min(count, _TIMED)):
        with clock.timing("decision"):
            invariance(draft, s).verdict()
    if clock.needed("decision", count) > clock.left + OVERTIME / SPEED:
        witness = _violation(draft, None, clock)
        return draft if witness is None else DifferentialCertificate.settle(**data, witness=witness)
    plain = DifferentialCertificate.settle(**data)
    if plain.status is not Status.PROVED:
        witness = _violation(plain, None, clock)
        return plain if witness is None else DifferentialCertificate.settle(**data, witness=witness)
    if clock.needed("decision", count) > clock.left:
        return plain
    v = _common_vector(np.asarray(centres.values), radii, X, discrete, clock.left)
    if v is None or clock.needed("decision", 2 * count) > clock.left + OVERTIME / SPEED:
        return plain
    contracting = DifferentialCertificate.settle(**data, v=v)
    return contracting if contracting else plain


def _violation(
    certificate: DifferentialCertificate, points: Array | None, clock: _Clock
) -> DifferentialViolation | None:
    for s in range(certificate.centres.shape[0]):
        if s and clock.left < 0:
            break
        radius = certificate.radii[s]
        if radius.any() and points is None:
            continue
        at = invariance(certificate, s).worst_violation()
        if at is None:
            continue
        forms = extreme_products(certificate, s, 1)
        if forms.signs()[at] < 0:
            point = None if points is None else points[s]
            value = float(forms.values[at])
            return DifferentialViolation(np.asarray(certificate.centres.values[s]), radius, at[0], at[1], value, point)
    return None


def _of_system(
    sys: NonlinearIOSystem,
    X: Cone,
    region: ArrayLike | None,
    inputs: ArrayLike | None,
    pieces: int,
    clock: _Clock,
) -> DifferentialCertificate:
    n = int(sys.nstates or 0)
    if X.dim != n:
        raise ConeMismatchError(f"jacobians: the system has {n} states, but X has dimension {X.dim}.")
    if region is None:
        raise DataError("region is missing: give the lower and upper bound of each state, shape (n, 2).")
    box, held = _box(region, n, "region"), _box(inputs, int(sys.ninputs or 0), "inputs")
    discrete = sys.dt is not None and (sys.dt is True or sys.dt != 0)
    instant = _AnyTime()
    function = _closed_over(sys, n, instant)
    whole = np.concatenate([box, held])

    def decided(centre: Array, radius: Array) -> bool:
        with clock.timing("decision"):
            piece = DifferentialCertificate(centres=Matrix(centre[None]), radii=radius[None], X=X, discrete=discrete)
            clock.last_decision = invariance(piece, 0).verdict() is True
        return clock.last_decision

    def enclosed(z: Any) -> Any:
        with clock.timing("enclosure"):
            return function(z)

    found: list[tuple[Array, Array]] = []
    open_: list[tuple[Array, Array]] = []  # pieces that were not cut, and not decided

    def late(waiting: int) -> bool:
        more = clock.needed("enclosure", waiting) + clock.needed("decision", len(found) + waiting)
        return more > clock.left - (1 - _FOR_PROOFS) * clock.limit

    try:
        for piece in jacobian_pieces(enclosed, whole, n, decided, pieces, late):
            found.append(piece)
            if not clock.last_decision:
                open_.append(piece)
            clock.last_decision = False
    except UnsupportedError:
        if instant.was_read:
            raise DataError(
                "jacobians: the system depends on time t; differential positivity is about systems that do not. "
                "Make t an input and give its range with inputs."
            ) from None
        return _sampled(sys, X, box, held, discrete, clock)
    centres, radii = np.array([c for c, _ in found]), np.array([r for _, r in found])
    data = {"centres": Matrix(centres), "X": X, "discrete": discrete}
    if all(decided(*piece) for piece in open_):
        certificate = _settled(Matrix(centres), radii, X, discrete, "enclosed", clock)
    else:
        certificate = DifferentialCertificate(**data, radii=radii, source="enclosed")
    if certificate:
        return certificate
    for k, point in enumerate(box_points(whole, 60)):
        if clock.needed("enclosure", 1) + clock.needed("decision", 3) > clock.left + (0.0 if k else OVERTIME / SPEED):
            break
        try:
            centre, radius = enclosed_jacobian(enclosed, np.column_stack([point, point]), n)
        except UnboundedError:
            continue
        single = DifferentialCertificate.settle(
            **{**data, "centres": Matrix(centre[None])}, radii=radius[None], source="enclosed"
        )
        witness = _violation(single, point[None, :n], clock)
        if witness is not None:
            return DifferentialCertificate.settle(**data, radii=radii, source="enclosed", witness=witness)
    return certificate


class _AnyTime:
    """Stands for every time: a function that computes with it cannot be enclosed, and that is remembered."""

    def __init__(self) -> None:
        self.was_read = False

    def _read(self, *_: Any, **__: Any) -> Any:
        self.was_read = True
        raise UnsupportedError("the function depends on time")

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _read
    __mod__ = __rmod__ = __floordiv__ = __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = _read
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _read
    __float__ = __int__ = __index__ = __bool__ = __array__ = __array_ufunc__ = _read


def _closed_over(sys: NonlinearIOSystem, n: int, clock: _AnyTime) -> Callable[[Any], Any]:
    """f(x, u) as a function of all states and inputs together."""

    def function(z: Any) -> Any:
        if sys.updfcn is None:
            raise UnsupportedError("the system has no update function")
        return sys.updfcn(clock, z[:n], z[n:], dict(sys.params))

    return function


def _sampled(
    sys: NonlinearIOSystem, X: Cone, box: Array, held: Array, discrete: bool, clock: _Clock
) -> DifferentialCertificate:
    """Jacobians by central differences at points of the region, as many as there is time for."""
    n = len(box)
    found = []
    for point in box_points(np.concatenate([box, held]), _SAMPLES):
        if found and clock.needed("enclosure", 1) + clock.needed("decision", len(found) + 1) > clock.left:
            break
        with clock.timing("enclosure"):
            found.append(jacobian_by_differences(lambda x: sys.dynamics(0.0, x[:n], x[n:]), point, box))
        with clock.timing("decision"):
            sample = DifferentialCertificate(
                centres=Matrix(found[-1][None]), radii=np.zeros((1, n, n)), X=X, discrete=discrete
            )
            invariance(sample, 0).verdict()
    stack = np.array(found)
    if not np.isfinite(stack).all():
        raise DataError("the Jacobian is not finite at some points of region; choose a smaller region.")
    return DifferentialCertificate.settle(
        centres=Matrix(stack), radii=np.zeros(stack.shape), X=X, discrete=discrete, source="sampled"
    )


def _box(data: ArrayLike | None, n: int, name: str) -> Array:
    if data is None:
        return np.zeros((n, 2))
    box = np.asarray(exact_matrix(data, name).values)
    if box.shape != (n, 2):
        raise ShapeError(f"{name} has shape {box.shape}, but must be ({n}, 2): lower and upper bound of each of {n}.")
    if (box[:, 0] > box[:, 1]).any():
        row = int(np.argmax(box[:, 0] > box[:, 1]))
        raise DataError(f"{name}[{row}] is [{box[row, 0]:g}, {box[row, 1]:g}]: the lower bound exceeds the upper one.")
    return box


def _common_vector(centres: Array, radii: Array, X: Cone, discrete: bool, time_limit: float) -> Array | None:
    """v in int X* with v'J x < 0 for all enclosed J: a linear program in v and sizes w >= |v|."""
    if len(centres) * X.n_rays * X.dim * _SECONDS_PER_ENTRY > time_limit:
        return None
    rays = np.asarray(X.rays, dtype=float)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    n = rays.shape[1]
    moved = np.concatenate([rays @ A.T - (rays if discrete else 0) for A in centres])
    spread = np.concatenate([np.abs(rays) @ R.T for R in radii])
    eye = np.eye(n)
    rows = np.block(
        [
            [-rays, np.zeros_like(rays), np.ones((len(rays), 1))],
            [moved, spread, np.ones((len(moved), 1))],
            [eye, -eye, np.zeros((n, 1))],
            [-eye, -eye, np.zeros((n, 1))],
        ]
    )
    cost = np.zeros(2 * n + 1)
    cost[-1] = -1.0
    lower = np.concatenate([np.full(n, -1.0), np.zeros(n + 1)])
    answer = solve(cost, A_ub=rows, b_ub=np.zeros(len(rows)), bounds=(lower, np.ones(2 * n + 1)), time_limit=time_limit)
    return answer.x[:n] if answer and answer.x[-1] > 1e-9 else None
