"""`data_feedback` and `data_positivity`: gains and verdicts for every plant that agrees with measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..cones import Cone
from ..design.running import within
from ..errors import DataError
from ..exact.matrix import Matrix
from ..proof.answer import Answer
from ..proof.certificate import Status
from .advice import not_enough
from .certificate import DataCertificate, LeavingPlant, Place
from .experiments import read_experiments
from .plants import Search
from .program import Floats, extreme
from .refusal import excluded

# Turns of gain and vector e on cones that are not simplicial.
_TURNS = 8
_NOBODY = (
    "no plant was found that agrees with the data, and none was excluded: the noise given is at the edge of what the "
    "samples allow. Give a larger bound of the noise."
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DataAnswer(Answer):
    """Outcome of `data_feedback` and `data_positivity`.  `bool(answer)` is True only for PROVED.

    Attributes
    ----------
    F : ndarray, shape (m, n), or None
        u = F x; None without one.
    K : ndarray, shape (m, n), or None
        -F, for python-control's u = -K x.
    e : ndarray, shape (n,), or None
        In the interior of X; its gauge norm falls under every plant that agrees with the data.
    plant : ndarray, shape (n, n + m), or None
        [A B] of one plant that agrees with the data, in the middle of the noise.
    """

    F: Floats | None = None
    K: Floats | None = None
    e: Floats | None = None
    plant: Floats | None = None

    def explain(self) -> str:
        """The verdict, why it holds, and what to do next, for a person.

        Returns
        -------
        str
        """
        verdict = "" if self.certificate is None else self.certificate.explain()
        message = self.message if not verdict else self.message[:1].upper() + self.message[1:]
        return f"{verdict} {message}".strip()


def data_feedback(
    X0: ArrayLike,
    X1: ArrayLike,
    U0: ArrayLike,
    *,
    noise: ArrayLike,
    X: Cone | ArrayLike | None = None,
    discrete: bool = True,
    time_limit: float | None = None,
) -> DataAnswer:
    """Find u = F x that keeps X and is stable for every plant that agrees with measurements.

    A plant x[k+1] = A x[k] + B u[k] + v[k] (x' in continuous time) agrees with the data if |X1 - A X0 - B U0| <= noise.

    Parameters
    ----------
    X0, X1 : array_like, shape (n, T), or list of such
        States, and the states one step later, or the derivatives of the states at the same times; one column for each
        sample, with a list one matrix for each experiment.
    U0 : array_like, shape (m, T), or list of such
        Inputs.
    noise : float or array_like, shape (n,) or (n, T), or list of the latter
        Bound of the disturbance and of the errors of X1, for all, each state or each entry.
    X : Cone or array_like of rays, optional
        Default: the nonnegative orthant.
    discrete : bool
        False: X1 holds derivatives.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    DataAnswer
        PROVED with F, e and a certificate about all these plants.  REFUTED: some plants that agree exclude every
        F together, see `explain`.  UNDECIDED: neither.  The last two come with advice on the next experiment.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Arguments that do not fit together, missing entries, and samples with which no plant agrees.

    Notes
    -----
    On simplicial cones one linear program finds a gain with a common e whenever there is one, up to rounding (two more
    where some products can only be 0), and where there is none its multipliers lead to the plants that prove it.  On
    other cones F and e take turns, and only positivity is refuted.  About 2 n p T variables for p generators.  See
    `DataCertificate` for the inequalities.

    Errors of X0 and U0 are not covered: the noise is that of X1.  Neither a decay rate nor bounds of states and inputs
    are claimed.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X0, U0 = [[1, 0, 1, 2], [0, 1, 1, 1]], [[0, 0, 1, -1]]
    >>> X1 = [["1.2", "0.3", "2.5", "1.7"], ["0.1", "0.5", "0.8", "0.5"]]
    >>> found = kp.data_feedback(X0, X1, U0, noise="0.01")
    >>> bool(found), found.F.shape, found.check()
    (True, (1, 2), True)
    """
    data = read_experiments(X0, X1, U0, noise, X, discrete)
    if data.U0 is None:
        raise DataError("U0 is None; give the inputs of the experiments, or take data_positivity.")
    return within(time_limit, lambda lp: _designed(Search(data, lp)), answer=DataAnswer)


def data_positivity(
    X0: ArrayLike,
    X1: ArrayLike,
    *,
    noise: ArrayLike,
    U0: ArrayLike | None = None,
    X: Cone | ArrayLike | None = None,
    discrete: bool = True,
    time_limit: float | None = None,
) -> DataAnswer:
    """Decide whether x+ = A x keeps X (x' = A x in continuous time) for every plant that agrees with measurements.

    Where they are also stable by a common e the certificate proves that too.

    Parameters
    ----------
    X0, X1 : array_like, shape (n, T), or list of such
        As in `data_feedback`.
    noise : float or array_like
        As in `data_feedback`.
    U0 : array_like, shape (m, T), or list of such, optional
        Inputs of the experiments; the statement is about A alone, u = 0.  Without them it is about the plant with what
        drove it, for samples of a closed loop.
    X : Cone or array_like of rays, optional
        Default: the nonnegative orthant.
    discrete : bool
        False: X1 holds derivatives.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    DataAnswer
        PROVED: every such plant keeps X, and with `e` every one is stable.  REFUTED: the witness is one that agrees
        with the data and leaves X.  UNDECIDED: at the edge, or the samples do not reach all states.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        As in `data_feedback`.

    Notes
    -----
    One small linear program for each entry of the image of each generator: the bounds are the exact range of A x over
    all these plants.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X0, X1 = [[1, 0, 1], [0, 1, 1]], [["0.5", "0.2", "0.7"], ["0.1", "0.6", "0.7"]]
    >>> found = kp.data_positivity(X0, X1, noise="0.01")
    >>> bool(found), found.e is not None
    (True, True)
    >>> kp.data_positivity(X0, X1, noise="0.2").status.name
    'REFUTED'
    """
    data = read_experiments(X0, X1, U0, noise, X, discrete)
    return within(time_limit, lambda lp: _decided(Search(data, lp)), answer=DataAnswer)


def _designed(search: Search) -> DataAnswer:
    if search.plant is None and search.repair.is_complete:
        return DataAnswer(status=Status.UNDECIDED, message=_NOBODY)
    tries = _simplicial_gains(search) if search.data.X.is_simplicial else _gains(search)
    for F, e, l in tries if search.plant is not None else ():
        proof = search.settle(Matrix(F), Matrix(e), l)
        if proof:
            return _answer(proof)
    refused = None if search.plant is None else excluded(search)
    if refused is not None:
        return DataAnswer(
            status=Status.REFUTED, certificate=refused, message=not_enough(search, gain=True, refuted=True)
        )
    return DataAnswer(status=Status.UNDECIDED, message=not_enough(search, gain=True))


def _simplicial_gains(search: Search) -> Iterator[tuple[Floats, Floats, Floats]]:
    named, p, m = search.named(True), len(search.x), search.m
    for found in search.candidates(search.simplicial()):
        xi, zeta = found.theta[:p], found.theta[p:].reshape(p, m)
        if (xi > 0).all():
            F: Floats = np.linalg.solve(search.x, zeta / xi[:, None]).T.astype(float)
            scale = np.append(xi, 1.0)[[place[0] for place in named]]
            yield F, xi @ search.x, found.l / scale[:, None]


def _gains(search: Search) -> Iterator[tuple[Floats, Floats, Floats]]:
    """F for fixed e and e for fixed F in turns."""
    e, last = np.asarray(search.data.X.interior_point, dtype=float), -np.inf
    for _ in range(_TURNS):
        unknowns, shape = search.fixed_vector(e), (search.m, search.data.X.dim)
        for found in search.candidates(unknowns):
            yield found.theta.reshape(shape), e, found.l
        found = search.joint(unknowns, search.named(True), search.pairs)
        better = None if found is None else search.vector(found.theta.reshape(shape))
        if better is None or not found.margin > last:  # type: ignore[union-attr]
            return
        last, e = found.margin, better[0]  # type: ignore[union-attr]


def _answer(proof: DataCertificate) -> DataAnswer:
    gain = None if proof.F is None else np.asarray(proof.F.values)
    plant = None if proof.plant is None else np.asarray(proof.plant.values)
    return DataAnswer(
        status=proof.status, certificate=proof, F=gain, K=None if gain is None else 0.0 - gain, e=proof.e, plant=plant
    )


# -- analysis


def _decided(search: Search) -> DataAnswer:
    if not search.repair.is_complete:
        return DataAnswer(status=Status.UNDECIDED, message=not_enough(search, gain=False))
    if search.plant is None:
        return DataAnswer(status=Status.UNDECIDED, message=_NOBODY)
    F, named = search.no_gain(), search.named(False)
    z = np.hstack([search.x, np.zeros((len(search.x), search.m))])
    bounds: dict[Place, float] = {}
    rows: dict[Place, Floats | None] = {}
    every: list[Floats] = []
    for k, i, side in named:
        found, l, w = extreme(search.samples, i, side, z[k], search.lp)
        if l is None:
            return DataAnswer(status=Status.UNDECIDED, message=not_enough(search, gain=False))
        bounds[k, i, side], rows[k, i, side] = found.value if side else -found.value, w
        every.append(l)
    l = np.array(every).reshape(len(named), search.samples.X1.shape[1])
    proof = search.settle(F, None, l)
    if not proof:
        return _refuted(search, bounds, rows)
    better = search.vector(None if F is None else np.asarray(F.values))
    if better is not None and better[1].margin > 0:
        stable = search.settle(F, Matrix(better[0]), np.concatenate([l, better[1].l]))
        proof = stable or proof
    return _answer(proof)


def _refuted(search: Search, bounds: dict[Place, float], rows: dict[Place, Floats | None]) -> DataAnswer:
    """A plant that leaves X at the worst pair, in the middle but for the rows that matter."""

    def worst(pair: tuple[int, int]) -> float:
        h, k = pair
        terms = [(float(search.h[h, i]), int(i)) for i in np.flatnonzero(search.h[h])]
        return sum(a * bounds[k, i, int(a < 0)] for a, i in terms)

    central = search.central
    for h, k in sorted(search.pairs, key=worst)[:3]:
        edge = central.copy()
        for i in np.flatnonzero(search.h[h]):
            row = rows[k, int(i), int(search.h[h, i] < 0)]
            edge[i] = central[i] if row is None else row
        normal = Matrix.from_fractions(search.facets[h])
        plant = search.inside(edge)
        proof = DataCertificate.settle(**search.data.data(), F=search.no_gain(), witness=LeavingPlant(plant, k, normal))
        if proof.status is Status.REFUTED:
            return DataAnswer(status=Status.REFUTED, certificate=proof, plant=np.asarray(plant.values))
    return DataAnswer(status=Status.UNDECIDED, message=not_enough(search, gain=False))
