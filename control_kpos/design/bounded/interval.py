"""`order_interval`: the smallest interval of states that bounded disturbances do not leave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from control import StateSpace
from numpy.typing import ArrayLike

from ...cones import Cone
from ...errors import DataError, ShapeError, TooLargeError
from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.intake import exact_matrix, require_shape
from ...exact.linalg import lifting_operations, solve_exactly
from ...exact.matrix import Matrix
from ...exact.rational_programs import exact_feasibility
from ...exact.signs import BilinearForms
from ...networks.closed_loop import EXACT_STATES
from ...networks.network import ConeNetwork
from ...networks.witnesses import AlgebraicLoop, CouplingViolation, NodeViolation
from ...proof.answer import Answer
from ...proof.certificate import Status, exactly, named
from ...systems.signals import signals_of
from ...theorems.positivity import state_positivity
from ...theorems.stability import LyapunovCertificate, lyapunov_on
from ..contradiction import unit_of
from ..plant import Floats, in_sparse_form, read_system, refuse_cone, shifted
from ..running import Programs, within
from .certificate import BoundExceeded, NoInterval, OrderIntervalCertificate
from .covers import covered
from .network_interval import NetworkBounds, network_intervals

# States up to which intervals are exact; beyond, how far x_max and x_min are apart, relatively, tried in turn.
_EXACT = 30
_APART = (1e-13, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4)
_OPEN = (
    "an invariant interval was found, but the constraints are neither proven on it nor refuted on all others, which "
    "may be smaller. Without constraints the answer is that interval."
)
_NOTHING = "no invariant interval was proven, and none was excluded at this size."
_NOT_BY_PARTS = (
    "intervals of a network of this size are proven node by node, and a node, a link or an algebraic loop does not "
    "allow it: see the certificate of the network."
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OrderInterval(Answer):
    """Outcome of `order_interval`.  `bool(answer)` is True only for PROVED.

    Attributes
    ----------
    x_max : ndarray, shape (n,), or None
        [0, x_max] = {x in X : x_max - x in X} is left by no trajectory; rounded, `certificate` holds the exact one.
    x_min : ndarray, shape (n,), or None
        Every invariant [0, x] has x - x_min in X; the same as x_max up to 30 states.  None if A is not stable; large
        networks that are not stable are refuted, or left open.
    reached : ndarray, shape (k,), or None
        Proven: f'x is at most this on the interval, for every row f of the constraints.
    """

    x_max: Floats | None = None
    x_min: Floats | None = None
    reached: Floats | None = None


def order_interval(
    sys: Any,
    w_max: ArrayLike,
    *,
    constraints: tuple[ArrayLike, ArrayLike] | None = None,
    X: Cone | ArrayLike | None = None,
    time_limit: float | None = None,
) -> OrderInterval:
    """Find the smallest [0, x_max] that x' = A x + w never leaves, whatever w does in [0, w_max].

    Intervals are those of the order of X: [0, x_max] = {x in X : x_max - x in X}, on the orthant a box.

    Parameters
    ----------
    sys : ConeStateSpace, control.StateSpace or network
        A, often a closed loop; discrete time x[k+1] = A x[k] + w[k] if its timebase says so.  Networks of any size: of
        more than 300 states they are taken node by node, as they were given, in sparse matrices.
    w_max : array_like, shape (n,)
        In X.  Disturbances add to x' (to x[k+1]); those of an input u in [0, u_max] are w_max = B u_max if B U lies
        in X.
    constraints : (f, c), shapes (k, n) and (k,), optional
        f x <= c is to hold on the whole interval, row by row.  |F x| <= u_max are the rows F and -F.  For a large
        network f may be sparse, and holds doubles.
    X : Cone or array_like of rays, optional
        Default: the cone of `sys` (the orthant for a plain system).
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    OrderInterval
        PROVED with x_max, the smallest in the order of X if A is stable.  REFUTED, with proof: X is not invariant under
        A; no such interval exists; or a constraint is broken in every one of them.  UNDECIDED otherwise, and for large
        networks whose nodes and links are not positive one by one.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Arguments that do not fit together; w_max outside X.

    Notes
    -----
    [0, x_max] is invariant if and only if X is, for x_max inside X, and A x_max + w_max lies in -X; the smallest x_max
    is -A^{-1} w_max ((I - A)^{-1} w_max).  f'x <= c on it is proven by some g with g and g - f in X* and
    g'x_max <= c.  Exact up to 30 states; n^3 operations.  A network of 100 000 states takes a second: see
    `NetworkIntervalCertificate`.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> loop = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=X)
    >>> b = kp.order_interval(loop, [0, 1], constraints=([[1, 0]], ["1/22"]))
    >>> bool(b), b.x_max.round(6), b.certificate.exact[1][0]
    (True, array([0.045455, 0.      ]), Fraction(1, 22))
    """
    if isinstance(sys, ConeNetwork) and sys.nstates > EXACT_STATES:
        return _of_network(sys, w_max, constraints, X, time_limit)
    system = read_system(sys, X)
    system.X.require_proper("X")
    w = _vector(w_max, "w_max", system.sizes[0], "state of sys")
    rows, bounds = read_constraints(constraints, system.sizes[0])
    _require_inside(w, system.X)
    found = within(time_limit, lambda _: _found(system, w, rows, bounds), answer=OrderInterval)
    if found.certificate is not None and isinstance(sys, StateSpace):
        named(found.certificate, signals_of(sys, system.X, system.U, system.Y))
    return found


def _of_network(net: ConeNetwork, w_max: Any, constraints: Any, X: Any, time_limit: float | None) -> OrderInterval:
    """The same for a network of any size."""
    net.require_certain()
    refuse_cone(X)
    w = _vector(w_max, "w_max", net.nstates, "state of sys")
    rows, bounds = read_constraints(constraints, net.nstates)
    _require_inside(w, net.X)
    given = NetworkBounds(w, None if rows is None else in_sparse_form(rows, "constraints f"), bounds)
    return within(time_limit, lambda lp: _proven_network(net, given, lp), "network", answer=OrderInterval)


def _proven_network(net: ConeNetwork, given: NetworkBounds, lp: Programs) -> OrderInterval:
    for proof in network_intervals(net, given, lp):
        if proof.status is Status.PROVED:
            return _answer(proof, proof.reached())
        if proof.status is Status.REFUTED:
            return OrderInterval(status=Status.REFUTED, certificate=proof)
    if isinstance(net.certificate.witness, (NodeViolation, CouplingViolation, AlgebraicLoop)):
        return OrderInterval(status=Status.UNDECIDED, message=_NOT_BY_PARTS)
    plain = given._replace(rows=None, bounds=None)
    found = given.rows is not None and any(network_intervals(net, plain, lp))
    return OrderInterval(status=Status.UNDECIDED, message=_OPEN if found else _NOTHING)


def read_constraints(constraints: Any, n: int) -> tuple[Matrix | None, Matrix | None]:
    """f and c of f x <= c, exactly."""
    if constraints is None:
        return None, None
    pair = constraints if isinstance(constraints, (tuple, list)) else ()
    if len(pair) != 2:
        raise ShapeError("constraints must be a pair (f, c): the rows f of f x <= c, and the numbers c.")
    f = exact_matrix(pair[0], "constraints f")
    require_shape(f, "constraints f", (None, n), "one column per state of sys")
    return f, _vector(pair[1], "constraints c", f.shape[0], "row of f")


def _vector(values: Any, name: str, size: int, of: str) -> Matrix:
    row = exact_matrix(values, name, ndim=1)
    if row.shape != (size,):
        raise ShapeError(f"{name} has shape {np.shape(values)}; it must be ({size},), one number per {of}.")
    return row


def _require_inside(w: Matrix, X: Cone) -> None:
    at = Condition("h'w >= 0", BilinearForms(X.exact_facets, None, w[None]), ">=").worst_violation()
    if at is not None:
        raise DataError(f"w_max lies outside X, beyond facet {at[0]}; give one with X.contains(w_max).")


def _found(system: Any, w: Matrix, rows: Matrix | None, bounds: Matrix | None) -> OrderInterval:
    positivity = state_positivity(system.A, system.X, discrete=system.discrete)
    if positivity.status is not Status.PROVED:
        message = (
            "" if positivity.witness is None else "x' = A x does not keep X, so no [0, x_max] inside is invariant."
        )
        return OrderInterval(status=positivity.status, certificate=positivity, message=message)
    loop, plain = lyapunov_on(positivity), False
    for x_max, x_min in _intervals(loop, w):
        found = _settled(loop, w, rows, bounds, x_max, x_min)
        if found is not None and found.status is not Status.UNDECIDED:
            return found
        plain = plain or found is not None
    if plain:
        return OrderInterval(status=Status.UNDECIDED, message=_OPEN)
    for d in _growing(loop, w) if not loop else ():
        proof = OrderIntervalCertificate.settle(positivity=positivity, w_max=w, witness=NoInterval(d))
        if proof.status is Status.REFUTED:
            return OrderInterval(status=Status.REFUTED, certificate=proof)
    return OrderInterval(status=Status.UNDECIDED, message=_NOTHING)


def _settled(
    loop: LyapunovCertificate,
    w: Matrix,
    rows: Matrix | None,
    bounds: Matrix | None,
    x_max: Matrix,
    x_min: Matrix | None,
) -> OrderInterval | None:
    """The answer for an interval, with the constraints proven or one of them refuted; None if it is not invariant."""
    settle = partial(OrderIntervalCertificate.settle, positivity=loop.positivity, w_max=w)
    least = {} if x_min is None else {"lyapunov": exactly(loop, "v"), "x_min": x_min}
    plain = settle(x_max=x_max, **least)
    if not plain or rows is None or bounds is None:
        return _answer(plain, None) if plain else None
    found = covered(loop.X, rows, bounds, x_max)
    covers = [g for g, _ in found if g is not None]
    if len(covers) == len(found):
        proof = settle(x_max=x_max, **least, rows=rows, bounds=bounds, covers=Matrix.join(covers, -2))
        reached = [g.fractions()[0] @ x_max.fractions() for g in covers]
        return _answer(proof, _rounded_up(reached)) if proof else None
    for i, (_, x) in enumerate([] if x_min is None else covered(loop.X, rows, bounds, x_min)):
        proof = None if x is None else settle(**least, rows=rows, bounds=bounds, witness=BoundExceeded(x, i))
        if proof is not None and proof.status is Status.REFUTED:
            return OrderInterval(status=Status.REFUTED, certificate=proof)
    return OrderInterval(status=Status.UNDECIDED)


def _rounded_up(reached: Sequence[Fraction]) -> Floats:
    return Matrix.from_fractions(np.array(reached, dtype=object)).rounded(up=True)


def _answer(proof: Any, most: Floats | None) -> OrderInterval:
    return OrderInterval(status=Status.PROVED, certificate=proof, x_max=proof.x_max, x_min=proof.x_min, reached=most)


# -- candidates


def _intervals(loop: LyapunovCertificate, w: Matrix) -> Iterator[tuple[Any, Any]]:
    """(x_max, x_min), exact ones first; no x_min where A is not stable."""
    M = shifted(loop.A.plain(), -int(loop.discrete))
    if loop and M.shape[0] <= _EXACT:
        spend(lifting_operations(M.as_integers()[0], 1))
        exact = _solved(M, w)
        if exact is not None:
            yield exact, exact
    if loop:
        yield from _nudged(np.asarray(M.values), np.asarray(w.values), loop.X)
    elif M.shape[0] <= _EXACT:
        yield from _undriven(M, w, loop.X)


def _solved(M: Matrix, w: Matrix) -> Matrix | None:
    """-M^{-1} w."""
    (a, unit), (b, other) = M.as_integers(), w.as_integers()
    found = solve_exactly(a, -b[:, None])
    if found is None:
        return None
    factor = Fraction(other) / Fraction(unit)
    return Matrix.over(found[0][:, 0] * factor.numerator, found[1] * factor.denominator)


def _nudged(M: Floats, w: Floats, X: Cone) -> Iterator[tuple[Matrix, Matrix]]:
    """-M^{-1} w in doubles, a little larger and a little smaller."""
    inside = np.asarray(X.interior_point, dtype=float)
    x, more = np.linalg.solve(-M, np.stack([w, inside * np.abs(w).max(initial=0.0)], axis=1)).T
    for part in _APART:
        yield Matrix(x * (1 + part) + part * more), Matrix(x * (1 - part) - part * more)


def _undriven(M: Matrix, w: Matrix, X: Cone) -> Iterator[tuple[Matrix, None]]:
    """x in X with -(M x + w) in X for an M that is not stable, in fractions: w may not reach what grows."""
    rays = X.exact_rays.plain().fractions()
    weights, _ = _alternative(M, w, X)
    if weights is not None:
        with suppress(DataError):  # beyond the range of doubles
            yield Matrix.from_fractions(rays.T @ weights[: len(rays)]), None


def _growing(loop: LyapunovCertificate, w: Matrix) -> Iterator[Matrix]:
    """The d that excludes every x_max, where the same program has no solution."""
    if loop.A.shape[0] <= _EXACT:
        _, y = _alternative(shifted(loop.A.plain(), -int(loop.discrete)), w, loop.X)
        if y is not None:
            d = loop.X.exact_facets.plain().fractions().T @ y
            yield Matrix.from_fractions(d * unit_of(d))  # its length has no meaning, and may be no double


def _alternative(M: Matrix, w: Matrix, X: Cone) -> tuple[Any, Any]:
    """Weights a >= 0 of generators with -h'(M R'a + w) >= 0 on every facet, or a combination that contradicts it."""
    facets, rays = (R.plain().fractions() for R in (X.exact_facets, X.exact_rays))
    rows = np.concatenate([facets @ M.fractions() @ rays.T, np.eye(len(facets), dtype=int).astype(object)], axis=1)
    right = -(facets @ w.fractions())
    try:
        return exact_feasibility(Matrix.from_fractions(rows), Matrix.from_fractions(right))
    except TooLargeError:
        return None, None
