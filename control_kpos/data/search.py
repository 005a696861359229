"""`data_feedback` and `data_positivity`: gains and verdicts for every plant that agrees with measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..cards import raised
from ..cones import Cone
from ..design.running import Programs, within
from ..errors import DataError
from ..exact.matrix import Matrix
from ..proof.answer import Answer
from ..proof.certificate import Status
from ..proof.portable_cones import portable_rows
from .advice import not_enough
from .certificate import DataCertificate, LeavingPlant, Place, places
from .experiments import Experiments, read_experiments
from .program import Floats, Found, Samples, Unknowns, extreme, joint, middle
from .refusal import excluded
from .repair import Repair

# Shares of the plant in the middle, in turn: a plant at the edge of the noise is moved inside.
_INWARDS = (1e-12, 1e-9, 1e-6, 1e-3, 0.1)
# Room inside the noise, relative to the data, below which samples may contradict each other.
_EDGE = 1e-9
# Room of positivity, as a part of the margin of decay.
_ROOM = 0.01
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
        return f"{verdict} {self.message}".strip()


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
    On simplicial cones one linear program finds a gain with a common e whenever there is one, up to rounding, and
    where there is none its multipliers lead to the plants that prove it.  On other cones F and e take turns, and only
    positivity is refuted.  About 2 n p T variables for p generators.  See `DataCertificate` for the inequalities.

    Errors of X0 and U0 are not covered: the noise is that of X1.  Neither a decay rate nor bounds of
    states and inputs are claimed; `certificate.plant` is one plant for which `state_feedback` designs these.

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
    return within(time_limit, lambda lp: _designed(_Search(data, lp)), answer=DataAnswer)


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
        Inputs of the experiments; the statement is about A alone, u = 0.
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
    return within(time_limit, lambda lp: _decided(_Search(data, lp)), answer=DataAnswer)


class _Search:
    """The data in doubles and exactly, and a plant in the middle."""

    def __init__(self, data: Experiments, lp: Programs) -> None:
        self.data, self.lp = data, lp
        n = data.X.dim
        self.m = 0 if data.U0 is None else data.U0.shape[0]
        self.Z = data.X0 if data.U0 is None else Matrix.join([data.X0, data.U0], -2)
        self.repair = Repair(self.Z)
        self.samples = Samples(*(np.asarray(M.values) for M in (self.Z, data.X1, data.noise)))
        self.rays, self.facets = portable_rows(data.X.exact_rays), data.X.exact_facets.plain().fractions()
        self.x = self.rays.astype(float)
        h = self.facets.astype(float)
        self.h = h / np.linalg.norm(h, axis=1, keepdims=True)
        incident = self.facets @ self.rays.T == 0
        wanted = np.ones(incident.shape, bool) if data.discrete else incident.astype(bool)
        self.pairs = [(int(a), int(b)) for a, b in np.argwhere(wanted)]
        rows = [middle(self.samples, i, lp) for i in range(n)]
        self.plant = self._plant(rows)

    def named(self, stable: bool) -> list[Place]:
        """See `places`."""
        return places(self.facets, self.rays, discrete=self.data.discrete, stable=stable)

    def _plant(self, rows: list[Any]) -> Matrix | None:
        """One that agrees, exactly; `DataError` if there is none."""
        for i, (w, inside, l) in enumerate(rows):
            if w is not None and inside < _EDGE * np.abs(self.samples.X1).max(initial=0.0):
                self._exclude(i, w, inside, l)
        if any(w is None for w, _, _ in rows):
            return None
        exact = self.repair.interpolant(self.data.X1) if self.repair.is_complete else None
        for plant in (Matrix(np.array([w for w, _, _ in rows])), exact):
            if plant is not None and self._agrees(plant):
                return plant
        return None

    def _agrees(self, plant: Matrix) -> bool:
        draft = DataCertificate(**self.data.data(), F=self.no_gain())
        return all(c.verdict() is True for c in draft.agreement(plant))

    def inside(self, edge: Floats) -> Matrix:
        """The plant at an edge of the noise, moved inside until it agrees; the one in the middle if it never does."""
        central = np.asarray(self.plant.values)  # type: ignore[union-attr]
        moved = (Matrix((1 - part) * edge + part * central) for part in _INWARDS)
        return next((plant for plant in moved if self._agrees(plant)), self.plant)  # type: ignore[return-value]

    def no_gain(self) -> Matrix | None:
        """F = 0, where there are inputs."""
        return Matrix.zeros(self.m, self.data.X.dim) if self.m else None

    def _exclude(self, i: int, w: Floats, inside: float, l: Floats | None) -> None:
        """Z l = 0 and X1_i l > noise_i'|l| for some l: then no row of a plant agrees."""
        if not self.repair.is_complete:
            return
        worst = np.zeros(self.samples.X1.shape[1])
        off = self.samples.X1[i] - w @ self.samples.Z
        at = int(np.argmax(np.abs(off) - self.samples.noise[i]))
        worst[at] = np.sign(off[at]) or 1.0
        none = np.full((1, self.Z.shape[0]), Fraction(0), dtype=object)
        guesses = [g for part in (l, worst) if part is not None for g in (part, -part)]
        for t in np.setdiff1d(np.arange(len(worst)), self.repair.basis) if inside <= 0 else ():
            guesses += [s * np.eye(1, len(worst), t)[0] for s in (1.0, -1.0)]
        row, noise = (M.fractions()[i] for M in (self.data.X1, self.data.noise))
        for guess in guesses:
            exact = self.repair.combinations(np.asarray(guess)[None], none)
            y = None if exact is None else exact.fractions()[0]
            if y is not None and row @ y > noise @ np.abs(y):
                least = float(noise.max()) + max(-inside, float((np.abs(off) - self.samples.noise[i]).max()))
                names = "X0, X1 and U0" if self.m else "X0 and X1"
                raise DataError(
                    f"no plant agrees with the samples {names}: those of state {i} contradict each other by more than "
                    f"the noise of {float(noise.max()):.3g}. Give a larger one (about {raised(least, 2)}), or look for "
                    "samples that belong to another plant."
                )

    def settle(self, F: Matrix | None, e: Matrix | None, l: Floats) -> DataCertificate | None:
        """The certificate with exact combinations near l."""
        draft = DataCertificate(**self.data.data(), F=F, e=e)
        targets = draft.targets()
        exact = self.repair.combinations(l, targets)
        if exact is None:
            return None
        return DataCertificate.settle(**self.data.data(), F=F, e=e, combinations=exact, plant=self.plant)

    # -- the program of a gain

    def simplicial(self) -> Unknowns:
        """z_k = (xi_k x_k; zeta_k), z_e = their sum: F x_k = zeta_k / xi_k."""
        p, n, m = len(self.x), self.data.X.dim, self.m
        moved = np.zeros((p + 1, n + m, p + p * m))
        for k in range(p):
            moved[k, :n, k] = self.x[k]
            moved[k, n:, p + k * m : p + (k + 1) * m] = np.eye(m)
        moved[p] = moved[:p].sum(axis=0)
        low, high = np.zeros(p + p * m), np.ones(p + p * m)
        low[p:], high[p:] = -np.inf, np.inf
        price = np.concatenate([np.zeros(p), np.ones(p * m)])
        return Unknowns(np.zeros((p + 1, n + m)), moved, low, high, price)

    def start(self) -> Unknowns:
        """The program of a gain, on cones that are not simplicial with e in the middle of X."""
        simplicial = self.data.X.is_simplicial
        return self.simplicial() if simplicial else self.fixed_vector(np.asarray(self.data.X.interior_point, float))

    def fixed_vector(self, e: Floats, *, free: bool = True) -> Unknowns:
        """z = (x; F x) for all generators and e: linear in F, which is 0 unless `free`."""
        states, n, m = np.vstack([self.x, e]), self.data.X.dim, self.m
        moved = np.zeros((len(states), n + m, m * n))
        for j in range(m):
            moved[:, n + j, j * n : (j + 1) * n] = states
        fixed = np.hstack([states, np.zeros((len(states), m))])
        most = np.full(m * n, np.inf if free else 0.0)
        return Unknowns(fixed, moved, -most, most, np.ones(m * n))

    def fixed_gain(self, F: Floats | None) -> Unknowns:
        """z_e = sum a_k (x_k; F x_k)."""
        vectors = self.x if F is None else np.hstack([self.x, self.x @ F.T])
        p = len(self.x)
        moved = np.zeros((p + 1, vectors.shape[1], p))
        moved[p] = vectors.T
        return Unknowns(np.zeros((p + 1, vectors.shape[1])), moved, np.zeros(p), np.ones(p), np.zeros(p))

    def joint(
        self,
        unknowns: Unknowns,
        named: list[Place],
        pairs: list[tuple[int, int]],
        *,
        samples: Samples | None = None,
        stable: bool = True,
        **more: Any,
    ) -> Found | None:
        """See `joint` of `program`; the last vector is e."""
        at_e = len(self.x) if stable else None
        given = (samples or self.samples, named, unknowns, self.h, pairs, at_e, self.data.discrete, self.lp)
        return joint(*given, **more)

    def candidates(self, unknowns: Unknowns) -> Iterator[Found]:
        """Points with a margin of decay: inside, or where some bounds can only be 0 with as many inside as possible."""
        named = self.named(True)
        inside = self.joint(unknowns, named, self.pairs, room=_ROOM)
        if inside is not None and inside.margin > 0:
            yield inside
        at_edge = self.joint(unknowns, named, self.pairs)
        if at_edge is not None and at_edge.margin > 0:
            spread = self.joint(unknowns, named, self.pairs, least=at_edge.margin / 2)
            yield from (found for found in (spread, at_edge) if found is not None)

    def vector(self, F: Floats | None) -> tuple[Floats, Found] | None:
        """e for a gain, with the combinations of its bounds."""
        named = [place for place in self.named(True) if place[0] == len(self.x)]
        found = self.joint(self.fixed_gain(F), named, [])
        return None if found is None else (found.theta @ self.x, found)


def _designed(search: _Search) -> DataAnswer:
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


def _simplicial_gains(search: _Search) -> Iterator[tuple[Floats, Floats, Floats]]:
    named, p, m = search.named(True), len(search.x), search.m
    for found in search.candidates(search.simplicial()):
        xi, zeta = found.theta[:p], found.theta[p:].reshape(p, m)
        if (xi > 0).all():
            F = np.linalg.solve(search.x, zeta / xi[:, None]).T
            scale = np.append(xi, 1.0)[[place[0] for place in named]]
            yield F, xi @ search.x, found.l / scale[:, None]


def _gains(search: _Search) -> Iterator[tuple[Floats, Floats, Floats]]:
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


def _decided(search: _Search) -> DataAnswer:
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


def _refuted(search: _Search, bounds: dict[Place, float], rows: dict[Place, Floats | None]) -> DataAnswer:
    """A plant that leaves X at the worst pair, in the middle but for the rows that matter."""

    def worst(pair: tuple[int, int]) -> float:
        h, k = pair
        return sum(search.h[h, i] * bounds[k, i, int(search.h[h, i] < 0)] for i in np.flatnonzero(search.h[h]))

    central = np.asarray(search.plant.values)  # type: ignore[union-attr]
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
