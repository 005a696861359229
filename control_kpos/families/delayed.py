"""`delayed`: is a system with state delays stable, whatever the delays are?"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from math import ceil
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from control import InputOutputSystem, StateSpace
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone
from ..errors import DataError, ShapeError
from ..exact.budget import OutOfBudgetError, budget, spend
from ..exact.intake import dimensions, exact_matrix, exact_number, found, items, require_shape, seconds
from ..exact.matrix import Matrix, is_sparse
from ..networks.network import ConeNetwork
from ..networks.state_delays import DelayedNetworkCertificate, delayed_network
from ..proof.certificate import Status, exactly
from ..systems.system import System
from ..theorems.growing_direction import InstabilityDirection
from ..theorems.positivity import PositivityCertificate, state_positivity
from ..theorems.stability import LyapunovCertificate, lyapunov_on
from .arguments import cone_and_time
from .delay_certificate import MOST_STEPS, DelayCertificate, FailingTerm, growth

Floats = NDArray[np.float64]
# Entries of matrices that are added in fractions.
_EXACT_ENTRIES = 10**6
# Halvings of the interval that holds the rate; relative distances from it that are tried.
_HALVINGS = 60
_BELOW = (1e-9, 1e-6, 1e-3, 0.1)
# Digits of the factor, and the least terms of an exponential series.
_DIGITS, _TERMS = 60, 25


def delayed(
    A: Any,
    A_delay: Any,
    X: Cone | ArrayLike | None = None,
    *,
    discrete: bool | None = None,
    max_delay: float | Fraction | str | None = None,
    time_limit: float | None = None,
) -> DelayCertificate | DelayedNetworkCertificate:
    """Decide whether x' = A x + sum_k A_k x(t - h_k) is positive on X and exponentially stable, whatever the delays.

    Parameters
    ----------
    A : array_like or sparse matrix, shape (n, n), system, or ConeNetwork
        Cross-positive on X; of a system its A, X and time.  Of a network: delays in the states of its nodes.
    A_delay : array_like or sparse matrix, shape (n, n), or a list of them
        One matrix for every delay; each is to map X into X.  Of a network the blocks of its nodes: (N, n, n), (n, n)
        for all nodes, or a list of N blocks where nodes differ in size.
    X : Cone or array_like of rays, optional
        Default: that of a system, or the orthant.
    discrete : bool, optional
        True for x[k+1] = A x[k] + sum_k A_k x[k - h_k].  Default: the time of a system; continuous for a matrix.
    max_delay : number, optional
        A decay rate for all delays of at most this one is proven besides.  In discrete time a number of steps.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED, and a rate is as good as it was found.  Default: that of a
        network.

    Returns
    -------
    DelayCertificate or DelayedNetworkCertificate
        PROVED: positive, and exponentially stable for all bounded delays, constant or not.  REFUTED: a matrix does not
        keep X, or no choice of delays is stable.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, NotProperConeError, TimebaseError
        Matrices of another size than A or X, or what is no matrix; of a network, `X`, `discrete` or `max_delay`.

    Notes
    -----
    Costs the check of A_k X in X and what `linear_lyapunov` costs for A + sum A_k, the rate some 60 solves more.  DC
    gains do not depend on the delays: those of a system with A + sum A_k in the place of A are those for all delays.

    Examples
    --------
    >>> import control_kpos as kp
    >>> cert = kp.delayed([[-3, 1], [1, -3]], [[1, 0], [0, 1]], max_delay=1)
    >>> cert.status.name, round(cert.decay_rate, 4)
    ('PROVED', 0.4429)
    >>> kp.delayed([[-3, 1], [1, -3]], [[2, 0], [0, 2]]).status.name
    'REFUTED'
    """
    if isinstance(A, ConeNetwork):
        for name, given in (("X", X), ("discrete", discrete), ("max_delay", max_delay)):
            if given is not None:
                raise DataError(
                    f"{name} has no place beside a network, "
                    f"{'for which no rate is proven' if name == 'max_delay' else 'which has its own cones and time'}"
                    "; leave it out."
                )
        return delayed_network(A, A_delay, time_limit=time_limit)
    is_system = isinstance(A, (StateSpace, System))
    if not is_system and isinstance(A, InputOutputSystem):
        raise DataError(f"A is {found(A)}; give a matrix, or a state-space system (control.ss makes one).")
    system = System.read(A if is_system else exact_matrix(A, "A"), "A")
    if not system.sizes[0]:
        raise ShapeError("A has no states; there is nothing to delay.")
    n, known = system.sizes[0], [(0, system)] if is_system else []
    cone, steps = cone_and_time(known, X, discrete, n, "A", "A")
    matrices = _delayed_matrices(A_delay, n)
    longest = None if max_delay is None else exact_number(max_delay, "max_delay", nonnegative=True)
    if longest is not None and steps and (longest.denominator != 1 or longest > MOST_STEPS):
        raise DataError(
            f"max_delay is {float(longest):g}; in discrete time it is a number of steps, at most {MOST_STEPS}."
        )
    with budget(float("inf"), time_limit=seconds(time_limit)), np.errstate(all="ignore"):
        return _decided(state_positivity(system.A, cone, discrete=steps), matrices, longest)


def _delayed_matrices(given: Any, n: int) -> list[Matrix]:
    """The matrices of all delays."""
    single = is_sparse(given) or isinstance(given, Matrix) or dimensions(given) == 2
    listed = [given] if single else items(given, "A_delay")
    if not listed:
        raise DataError("A_delay is empty; give a matrix, or a list of one for each delay.")
    names = ["A_delay"] if single else [f"A_delay[{k}]" for k in range(len(listed))]
    for name, part in zip(names, listed, strict=True):
        if isinstance(part, (StateSpace, System)):
            raise DataError(f"{name} is {found(part)}; give a matrix, such as the A of a system.")
    read = [exact_matrix(part, name) for part, name in zip(listed, names, strict=True)]
    return [require_shape(M, name, (n, n), f"A is {n} x {n}") for M, name in zip(read, names, strict=True)]


def _decided(own: PositivityCertificate, matrices: list[Matrix], longest: Fraction | None) -> DelayCertificate:
    X = own.X
    parts = tuple(state_positivity(M, X, discrete=True) for M in matrices)
    known: dict[str, Any] = {"own": own, "delayed": parts}
    for k, part in enumerate((own, *parts)):
        if part.status is Status.REFUTED:
            return DelayCertificate.settle(**known, witness=FailingTerm(k, part.witness))
    if not all((own, *parts)):
        return DelayCertificate.settle(**known)
    try:
        found = next((proof for proof in _sums(known) if proof.status is not Status.UNDECIDED), None)
    except OutOfBudgetError:
        found = None
    if found is None:
        return DelayCertificate.settle(**known)
    with_rate = None if longest is None or not found else _with_rate(found, longest)
    return found if with_rate is None else with_rate


def _sums(known: dict[str, Any]) -> Iterator[DelayCertificate]:
    """What stability of the sum of the matrices proves, or a direction of its growth."""
    own: PositivityCertificate = known["own"]
    for S in _sum(own.A, [part.A for part in known["delayed"]]):
        stable = _stability_of(S, own)
        if stable:
            yield DelayCertificate.settle(**known, v=exactly(stable, "v"))
        elif isinstance(stable.witness, InstabilityDirection):
            x = exactly(stable.witness, "x")
            yield DelayCertificate.settle(**known, witness=InstabilityDirection(x))


def _stability_of(S: Matrix, own: PositivityCertificate) -> LyapunovCertificate:
    return lyapunov_on(state_positivity(S, own.X, discrete=own.discrete))


def _sum(A: Matrix, others: list[Matrix]) -> Iterator[Matrix]:
    """The sum in doubles, and if that is rounded, exactly, where that is affordable."""
    parts = [A, *others]
    if all(M.is_double for M in parts):
        total = parts[0].values
        for M in parts[1:]:
            total = total + M.values
        sparse = is_sparse(total)
        total = sp.csr_array(total) if sparse else np.asarray(total)
        if np.isfinite(total.data if sparse else total).all():
            yield Matrix(total)
    if A.shape[0] ** 2 <= _EXACT_ENTRIES:
        exact = parts[0].plain().fractions()
        for M in parts[1:]:
            exact = exact + M.plain().fractions()
        yield Matrix.from_fractions(exact)


# -- rates


def _with_rate(found: DelayCertificate, longest: Fraction) -> DelayCertificate | None:
    """The certificate with the largest rate that some v proves, or None; a time limit ends the search for more."""
    problem = _Rates(found, float(longest))
    low, high = 0.0, problem.most
    with suppress(OutOfBudgetError):
        for _ in range(_HALVINGS):
            spend()
            middle = (low + high) / 2
            low, high = (middle, high) if problem.vector(middle) is not None else (low, middle)
    for part in _BELOW:
        rate = low * (1 - part)
        v = problem.vector(rate)
        if v is None or not 0 < rate < np.inf:
            continue
        proof = _at_rate(found, rate, longest, v)
        if proof:
            return proof
    return None


def _at_rate(found: DelayCertificate, rate: float, longest: Fraction, v: Floats) -> DelayCertificate | None:
    terms = () if found.discrete else (max(_TERMS, ceil(4 * rate * float(longest))),)
    try:
        least = growth(Fraction(rate), longest, terms, discrete=found.discrete)
    except DataError:
        return None
    factor = Fraction(-int(-least * 2**_DIGITS // 1), 2**_DIGITS)
    more = {"rate": rate, "max_delay": longest, "factor": factor, "terms": terms, "v": Matrix(v), "exact": None}
    return DelayCertificate.settle(**found.data() | more) or None


class _Rates:
    """v = -(A + b sum A_k + c I)^{-T} w for rates c, with b = e^{c h}, in floating point."""

    def __init__(self, found: DelayCertificate, longest: float) -> None:
        self.discrete, self.longest = found.discrete, longest
        self.X = found.X
        self.rays = self.X.exact_rays.values
        parts = [M.values for M in (found.A, *found.A_delay)]
        if any(map(is_sparse, parts)):
            parts = [sp.csc_array(M) for M in parts]
        self.A, self.rest = parts[0], sum(parts[1:])
        self.inside = np.asarray(self.X.dual.interior_point, dtype=float)
        self.most = 1.0 if self.discrete else float(abs(self.A).sum(axis=0).max()) or 1.0  # a norm of A, at least

    def vector(self, rate: float) -> Floats | None:
        """A v for this rate, or None."""
        if self.discrete and rate >= 1:
            return None
        b = (1 - rate) ** -self.longest if self.discrete else np.exp(rate * self.longest)
        S = self.A + b * self.rest
        shift = rate - self.discrete
        if not np.isfinite(b):
            return None
        try:
            if is_sparse(S):
                v = -spla.splu(sp.csc_array(S + shift * sp.eye_array(S.shape[0]))).solve(self.inside, "T")
            else:
                v = -np.linalg.solve((S + shift * np.eye(len(S))).T, self.inside)
        except (RuntimeError, ValueError, np.linalg.LinAlgError):
            return None
        return v if np.isfinite(v).all() and (self.rays @ v > 0).all() else None
