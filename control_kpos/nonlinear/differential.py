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

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from control import NonlinearIOSystem, StateSpace
from numpy.typing import ArrayLike, NDArray

from ..cards import shown
from ..cones import Cone, as_cone
from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.budget import OVERTIME, OutOfBudgetError, affords, budget, operations_left, seconds_left, spend
from ..exact.intake import (
    dimensions,
    exact_matrix,
    flag,
    items,
    seconds,
    whole_number,
)
from ..exact.intervals import steps_to
from ..exact.jacobians import (
    box_points,
    enclosed_jacobian,
    jacobian_by_differences,
    jacobian_pieces,
    sharper_jacobian,
    values_on_box,
)
from ..exact.matrix import Matrix, dense
from ..exact.programs import program_effort
from ..exact.sharper import FACES
from ..exact.unreadable import UnboundedError, Unreadable, UnsupportedError
from ..proof.certificate import Status
from ..systems.system import System
from ..theorems.lyapunov_candidates import common_vector
from .certificate import (
    DifferentialCertificate,
    DifferentialViolation,
    extreme_products,
    invariance,
)
from .certify_network import certify_network
from .contraction import DifferentialNetworkCertificate
from .network import NonlinearNetwork

Array = NDArray[np.float64]

_SAMPLES = 200
# Points at which a violation is looked for, before and after the region is cut.
_FEW, _MANY = 12, 60
# Points where values are compared with their enclosures, and the relative difference that rounding may make.
_COMPARED, _DIFFERENCE = 4, 1e-6
# Operations of a decision without a time limit: a minute or so.
_EFFORT = 6e10
# The part of them that goes into enclosures; the rest looks for a violation.
_FOR_PROOFS = 0.7
# Operations of one enclosure, unless a time limit is given and the clock says that the system's function takes more;
# and of the conditions on one Jacobian, besides those that grow with its size.
_PER_ENCLOSURE, _PER_JACOBIAN = 1e6, 3e5


@np.errstate(all="ignore")
def differential_positivity(
    jacobians: Any,
    X: Cone | ArrayLike | None = None,
    region: ArrayLike | None = None,
    *,
    inputs: ArrayLike | None = None,
    equilibrium: ArrayLike | None = None,
    discrete: bool | None = None,
    pieces: int = 256,
    time_limit: float | None = None,
) -> DifferentialCertificate | DifferentialNetworkCertificate:
    """Decide whether a nonlinear system keeps the cone X of displacements.

    Parameters
    ----------
    jacobians : NonlinearIOSystem, StateSpace, NonlinearNetwork, matrix or sequence of matrices
        A system or a network, with `region`; or the vertices of a set of Jacobians, each (n, n).
    X : Cone, or array_like of its generators, shape (p, n)
        Polyhedral and proper, in R^n.  Not for a network, whose nodes have cones.
    region : array_like, shape (n, 2), optional
        Box of states: lower and upper bound of each.  For a network the order interval between both, in the order of
        the cones; (1, 2) if all states have the same.
    inputs : array_like, shape (m, 2), optional
        Box of (external) inputs; zero if omitted.
    equilibrium : array_like, shape (n,), optional
        Of a network: a point at rest that the region is to hold; refused if it does not.
    discrete : bool, optional
        For matrices: x[k+1] = f(x[k]).  Systems know.
    pieces : int
        Largest number of boxes the region, in networks that of every node, may be cut into to tighten the enclosure.
    time_limit : float, optional
        Seconds, inf for no limit; what is not settled by then is UNDECIDED.  Without it operations are counted
        instead, and the answer is the same on every machine; they last for about a minute.  Boxes are cut while the
        decisions about them still fit.

    Returns
    -------
    DifferentialCertificate, or DifferentialNetworkCertificate for a network
        `explain()` says what follows.  A system whose function cannot be called with intervals, or looks at its
        arguments, is sampled, which is stated and never PROVED.  Functions are called inside the region only, and at
        an end of it, or at a kink of `abs`, `np.maximum`, `np.minimum`, `np.clip` and of `np.where`, whose branches
        have to be proven to meet, slopes from inside count.

    Raises
    ------
    ShapeError, ConeMismatchError, DataError, NotProperConeError
        Sizes that do not fit; a region that is not a box; a Jacobian that is unbounded on the region; a system
        that depends on time, or whose function fails at a point of the region; an equilibrium outside of it.

    Examples
    --------
    A pendulum with strong damping, for angles up to a quarter turn:

    >>> import control as ct, control_kpos as kp
    >>> pendulum = ct.nlsys(lambda t, x, u, p: [x[1], -np.sin(x[0]) - 3 * x[1]], inputs=0, states=2)
    >>> X = kp.PolyhedralCone([[1, 0], [1, -2]])
    >>> cert = differential_positivity(pendulum, X, [[-1.5, 1.5], [-9, 9]])
    >>> cert.status.name, cert.source
    ('PROVED', 'enclosed')

    Two towns that infect each other:

    >>> towns = kp.nonlinear_nodes(lambda x, u, p: [(1 - x[0]) * u[0] - x[0]], n_nodes=2)
    >>> net = kp.nonlinear_interconnect(towns, [[0, 0.5], [0.5, 0]])
    >>> differential_positivity(net, region=[[0, 1]]).contracts
    True
    """
    if isinstance(jacobians, NonlinearNetwork):
        if X is not None or discrete is not None or time_limit is not None:
            raise DataError(
                "X, discrete and time_limit are not for networks; leave them out, and name the region: region=..."
            )
        most = whole_number(pieces, "pieces", least=1)
        return certify_network(jacobians, region, inputs, equilibrium, most)
    if equilibrium is not None:
        raise DataError("equilibrium is for networks; leave it out.")
    if X is None:
        raise DataError("X is missing: give the cone that jacobians are to keep, or its generators.")
    X = as_cone(X, "X")
    X.require_proper("X")
    timed = None if discrete is None else flag(discrete, "discrete")
    pieces, limit = whole_number(pieces, "pieces", least=1), seconds(time_limit)
    _effort(X, 1)  # facets are found before the limit counts: without them nothing can be said
    with budget(_EFFORT if limit is None else np.inf, time_limit=limit):
        if isinstance(jacobians, NonlinearIOSystem) and not isinstance(jacobians, StateSpace):
            return _of_system(jacobians, X, region, inputs, pieces)
        if isinstance(jacobians, StateSpace):
            system = System.read(jacobians, "jacobians")
            timed, jacobians = system.discrete, [system.A]
        elif region is not None or inputs is not None:
            raise DataError(f"{'region' if region is not None else 'inputs'} is for a system, not for matrices.")
        stack = _vertices(jacobians, X)
        return _settled(stack, np.zeros(stack.shape), X, bool(timed), "vertices")


def _effort(X: Cone, count: int) -> float:
    """Operations of the conditions on so many Jacobians."""
    return count * (_PER_JACOBIAN + 20.0 * X.n_facets * X.n_rays * X.dim)


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


def _settled(centres: Matrix, radii: Array, X: Cone, discrete: bool, source: str) -> DifferentialCertificate:
    """The certificate for enclosed or given Jacobians, with a violation or a common vector if there is one."""
    data: dict[str, Any] = {"centres": centres, "radii": radii, "X": X, "discrete": discrete, "source": source}
    effort = _effort(X, centres.shape[0])
    certificate = DifferentialCertificate(**data)
    if affords(effort - OVERTIME):
        certificate = DifferentialCertificate.settle(**data)
    if certificate.status is not Status.PROVED:
        witness = _violation(certificate, None)
        return certificate if witness is None else DifferentialCertificate.settle(**data, witness=witness)
    try:
        spend(effort + program_effort(centres.shape[0] * X.n_rays, 2 * X.dim))
        v = common_vector(np.asarray(centres.values), np.asarray(X.rays), radii, discrete=discrete)
    except OutOfBudgetError:
        return certificate
    if v is None or not affords(2 * effort - OVERTIME):
        return certificate
    contracting = DifferentialCertificate.settle(**data, v=v)
    return contracting if contracting else certificate


def _violation(certificate: DifferentialCertificate, points: Array | None) -> DifferentialViolation | None:
    for s in range(certificate.centres.shape[0]):
        if s and not affords():
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


class _Enclosure:
    """The system's function on boxes, and decisions about the Jacobians found.

    With a time limit the clock says what an enclosure takes, because the function is the user's.
    """

    def __init__(self, function: Callable[[Any], Any], X: Cone, discrete: bool) -> None:
        self._function, self._X, self._discrete = function, X, discrete
        self.effort, self.last_decision = _PER_ENCLOSURE, False
        self._steps: list[int] | None = None

    def __call__(self, z: Any) -> Any:
        before = operations_left()
        value = self._function(z)
        steps = [steps_to(y) for y in np.asarray(value, dtype=object).ravel()]
        if self._steps not in (None, steps):
            raise UnsupportedError("the function does something else than at an earlier call")
        self._steps = steps
        self.effort = max(self.effort, before - operations_left())
        with suppress(OutOfBudgetError):  # the value is there; what follows asks whether it may begin
            spend(_PER_ENCLOSURE)
        return value

    def decided(self, centre: Array, radius: Array) -> bool:
        """Whether the condition is proven for every Jacobian of this piece."""
        piece = DifferentialCertificate(
            centres=Matrix(centre[None]), radii=radius[None], X=self._X, discrete=self._discrete
        )
        self.last_decision = invariance(piece, 0).verdict() is True
        return self.last_decision

    def affords(self, enclosures: int, decisions: int) -> bool:
        """Whether so many more may begin."""
        return affords(enclosures * self.effort + _effort(self._X, decisions))


def _of_system(
    sys: NonlinearIOSystem, X: Cone, region: ArrayLike | None, inputs: ArrayLike | None, pieces: int
) -> DifferentialCertificate:
    n = int(sys.nstates or 0)
    if X.dim != n:
        raise ConeMismatchError(f"jacobians: the system has {n} states, but X has dimension {X.dim}.")
    if region is None:
        raise DataError("region is missing: give the lower and upper bound of each state, shape (n, 2).")
    box, held = _box(region, n, "region"), _box(inputs, int(sys.ninputs or 0), "inputs")
    discrete = sys.dt is not None and (sys.dt is True or sys.dt != 0)
    instant = _AnyTime()
    enclosure = _Enclosure(_closed_over(sys, n, instant), X, discrete)
    whole = np.concatenate([box, held])
    try:
        _require_agreement(sys, enclosure, whole, n)
        refuted = _refuted_at_once(enclosure, whole, n, {"X": X, "discrete": discrete, "source": "enclosed"})
        if refuted is not None:
            return refuted
        found, is_proven = _pieces(enclosure, whole, n, pieces)
    except UnsupportedError:
        if instant.was_read:
            raise DataError(
                "jacobians: the system depends on time t; differential positivity is about systems that do not. "
                "Make t an input and give its range with inputs."
            ) from None
        return _sampled(sys, X, box, held, discrete)
    centres, radii = np.array([c for c, _ in found]), np.array([r for _, r in found])
    data = {"centres": Matrix(centres), "radii": radii, "X": X, "discrete": discrete, "source": "enclosed"}
    certificate = _settled(**data) if is_proven else DifferentialCertificate(**data)
    if certificate:
        return certificate
    witness = _at_points(enclosure, whole, n, data)
    return certificate if witness is None else DifferentialCertificate.settle(**data, witness=witness)


def _refuted_at_once(
    enclosure: _Enclosure, whole: Array, n: int, data: dict[str, Any]
) -> DifferentialCertificate | None:
    """The certificate with a violation at one of a few points, before the region is cut; None if there is none."""
    if not enclosure.affords(1 + FACES + _FEW, _FEW):
        return None
    try:
        centre, radius = sharper_jacobian(enclosure, whole, n)
    except UnboundedError:
        return None
    if enclosure.decided(centre, radius):
        return None
    data = {**data, "centres": Matrix(centre[None]), "radii": radius[None]}
    witness = _at_points(enclosure, whole, n, data, _FEW)
    return None if witness is None else DifferentialCertificate.settle(**data, witness=witness)


def _pieces(enclosure: _Enclosure, whole: Array, n: int, most: int) -> tuple[list[tuple[Array, Array]], bool]:
    """Jacobians enclosed on pieces of the region, and whether the condition is proven for all of them."""
    found: list[tuple[Array, Array]] = []
    open_: list[tuple[Array, Array]] = []  # pieces that were not cut, and not decided
    with budget(_FOR_PROOFS * operations_left(), time_limit=_FOR_PROOFS * seconds_left()):

        def late(waiting: int) -> bool:
            return not enclosure.affords(waiting, len(found) + waiting)

        for piece in jacobian_pieces(enclosure, whole, n, enclosure.decided, most, late):
            found.append(piece)
            if not enclosure.last_decision:
                open_.append(piece)
            enclosure.last_decision = False
    return found, all(enclosure.decided(*piece) for piece in open_)


def _at_points(
    enclosure: _Enclosure, whole: Array, n: int, data: dict[str, Any], count: int = _MANY
) -> DifferentialViolation | None:
    """A violation at one of several points of the region."""
    for k, point in enumerate(box_points(whole, count)):
        if k and not enclosure.affords(1, 3):
            return None
        try:
            centre, radius = enclosed_jacobian(enclosure, np.column_stack([point, point]), n, kinks=False)
        except UnboundedError:
            continue
        at_point = {**data, "centres": Matrix(centre[None]), "radii": radius[None]}
        witness = _violation(DifferentialCertificate.settle(**at_point), point[None, :n])
        if witness is not None:
            return witness
    return None


class _AnyTime(Unreadable):
    """Stands for every time: a function that computes with it cannot be enclosed, and that is remembered."""

    __slots__ = ("was_read",)

    def __init__(self) -> None:
        self.was_read = False

    def _looked_at(self) -> str:
        self.was_read = True
        return "the function depends on time"

    __array__ = __array_ufunc__ = Unreadable._refuse


def _closed_over(sys: NonlinearIOSystem, n: int, instant: _AnyTime) -> Callable[[Any], Any]:
    """f(x, u) as a function of all states and inputs together."""

    def function(z: Any) -> Any:
        if sys.updfcn is None:
            raise UnsupportedError("the system has no update function")
        return sys.updfcn(instant, z[:n], z[n:], dict(sys.params))

    return function


def _value(sys: NonlinearIOSystem, n: int, point: Array) -> Array:
    """f(x, u) in floating point, at a point of the region."""
    try:
        value = sys.dynamics(0.0, point[:n].copy(), point[n:].copy())
        if np.iscomplexobj(value):
            raise TypeError("complex values")
        value = np.asarray(value, dtype=float)
    except Exception as error:
        raise DataError(
            f"jacobians: the system's function fails at {_named(point, n)}: {type(error).__name__}: {error}"
        ) from error
    if value.shape != (n,):
        raise ShapeError(f"the system's update function returned {value.size} values for {n} states.")
    if not np.isfinite(value).all():
        raise DataError(f"jacobians: the system's function is not finite at {_named(point, n)}; choose another region.")
    return value


def _named(point: Array, n: int) -> str:
    return f"x = {shown(point[:n])}" + (f", u = {shown(point[n:])}" if len(point) > n else "")


def _require_agreement(sys: NonlinearIOSystem, enclosure: _Enclosure, whole: Array, n: int) -> None:
    """Refuse a function that does with numbers something else than with intervals, as far as a few points show."""
    for k, point in enumerate(box_points(whole, _COMPARED)):
        if k and not enclosure.affords(1, 0):
            return
        try:
            values, _ = values_on_box(enclosure, point, point, 0)
        except UnboundedError:
            continue
        low, high = np.array([y.value for y in values]).T
        tolerance = (high - low) + _DIFFERENCE * (1 + np.abs(low) + np.abs(high))
        seen = _value(sys, n, point)
        if seen.shape == low.shape and ((seen < low - tolerance) | (high + tolerance < seen)).any():
            raise UnsupportedError("the function treats numbers unlike intervals")


def _sampled(sys: NonlinearIOSystem, X: Cone, box: Array, held: Array, discrete: bool) -> DifferentialCertificate:
    """Jacobians by differences at points of the region, as many as the effort allows."""
    n = len(box)
    found, effort = [], _PER_ENCLOSURE
    for point in box_points(np.concatenate([box, held]), _SAMPLES):
        if found and not affords(effort + _effort(X, len(found) + 1)):
            break
        before = operations_left()
        _value(sys, n, point)
        found.append(jacobian_by_differences(lambda z: _value(sys, n, z), point, box))
        effort = max(effort, before - operations_left())
        if not np.isfinite(found[-1]).all():
            raise DataError(f"jacobians: the Jacobian is not finite at {_named(point, n)}; choose a smaller region.")
    stack = np.array(found)
    return DifferentialCertificate.settle(
        centres=Matrix(stack), radii=np.zeros(stack.shape), X=X, discrete=discrete, source="sampled"
    )


def _box(data: ArrayLike | None, n: int, name: str) -> Array:
    if data is None:
        return np.zeros((n, 2))
    exact = exact_matrix(data, name)
    box = exact.rounded(up=False)
    if box.shape != (n, 2):
        raise ShapeError(f"{name} has shape {box.shape}, but must be ({n}, 2): lower and upper bound of each of {n}.")
    if (box[:, 0] > box[:, 1]).any():
        row = int(np.argmax(box[:, 0] > box[:, 1]))
        raise DataError(f"{name}[{row}] is [{box[row, 0]}, {box[row, 1]}]: the lower bound exceeds the upper one.")
    return np.column_stack([box[:, 0], exact.rounded(up=True)[:, 1]])  # the smallest box of doubles around
