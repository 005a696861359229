"""Cone and feedback together: place isolated real poles, take their cone, polish the gain.

If (A, B) is controllable, poles can be placed at real distinct numbers, and the simplicial cone of that spectrum is
invariant; so a cone and a gain always exist.  They may be fragile: perturbed loops keep a cone only if the dominant
pole stays real and well separated.  From pole patterns with an isolated dominant pole, from gentle to aggressive, cone
and gain are therefore moved together (`descent`) until all vertices are served.  At the cone the smallest gain is then
found by the linear program of `design.simplicial`, for all vertices at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from control import StateSpace
from numpy.typing import ArrayLike, NDArray

from ...cards import about, shown
from ...cones import PolyhedralCone
from ...cones.simplicial import simplicial_facets
from ...design import state_feedback
from ...design.accept import accept, margins_of, succeed
from ...design.controllability import reachable
from ...design.plant import read_plant
from ...errors import DataError, ShapeError
from ...exact.budget import OutOfBudgetError, affords, ended_by, seconds_left, spend
from ...exact.intake import exact_number, items, seconds, vector, whole_number
from ...exact.matrix import Matrix, dense
from ...exact.programs import program_effort
from ...progress import Reporter, Target
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ...systems.statespace import ConeStateSpace
from ...systems.system import System
from ..answer import ConeAnswer
from ..family.descent import simplicial_descent
from ..find import ended, square, within_limits
from ..one_matrix.explicit import modal_cone
from ..one_matrix.modes import modes
from .placement import placed

Array = NDArray[np.float64]

# Random pole patterns of the robust search after the ones listed.
_RANDOM = 1000
# Operations of a search without a time limit: a minute or so.
_EFFORT = 6e10
# Operations for the facets of 60 generators in integers, where floating point does not do.
_FOR_SIXTY = 4e9
# Operations of a singular value decomposition, divided by the cube of its size.
_PER_STEP = 1.5


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CodesignResult(ConeAnswer):
    """A cone, and a gain that makes it invariant and the loop stable.

    `bool(result)` is True only for PROVED.  A `CodesignResult` is taken wherever a cone is asked for.

    Attributes
    ----------
    cone : Cone or None
        Simplicial.
    F : ndarray, shape (m, n), or None
        Gain of u = F x.
    closed_loop : ConeStateSpace or None
        From the input added to F x to all states as outputs, or to the system's own.
    poles : ndarray, shape (n,), or None
        Closed-loop poles of the nominal system.
    """

    F: Array | None = None
    closed_loop: Any = None
    poles: NDArray[np.complex128] | None = None

    @property
    def K(self) -> Array | None:
        """Gain of python-control's u = -K x."""
        return None if self.F is None else -self.F

    def explain(self) -> str:
        """A few sentences a person can act on.

        Returns
        -------
        str
        """
        if self.F is None:
            return super().explain()
        size = float(np.abs(self.F).max())
        return f"A cone and a gain (largest entry {about(size, digits=4)}) were found. {super().explain()}"

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        if self.F is None or self.poles is None:
            return []
        poles = ", ".join(f"{pole:.4g}" for pole in np.sort_complex(self.poles))
        size = about(float(np.abs(self.F).max()), digits=4)
        return [("cone", repr(self.cone)), ("largest entry of F", size), ("poles", poles)]


def design_cone_and_feedback(
    sys: Any,
    vertices: Sequence[Any] | None = None,
    *,
    rate: float | None = None,
    poles: ArrayLike | None = None,
    time_limit: float | None = None,
    seed: int = 0,
    progress: Target = None,
) -> CodesignResult:
    """Find a proper cone X and a gain F so that A + B F leaves X invariant and is stable.

    Parameters
    ----------
    sys : StateSpace or pair (A, B)
        Continuous or discrete time.  (A, B) controllable.
    vertices : sequence of StateSpace or (A_s, B_s), optional
        Plants that the same cone and gain must serve besides the system, together with the convex hull of them all.
    rate : float, optional
        Decay rate that is proven, per unit of time; in discrete time V(x[k+1]) <= (1 - rate) V(x[k]).  Default: half of
        that of poles as far from the edge of stability as those of the plant, and a tenth of its size more; less only
        where no cone is found otherwise.
    poles : array_like, shape (n,), optional
        Real, distinct and stable: the gain places them, and the cone is theirs; the gain is not made smaller then.
    time_limit : float, optional
        Seconds, inf for no limit.  Without it operations are counted instead, and the answer is the same on every
        machine; they last for about a minute.
    seed : int
        Of the random starts of the robust search.
    progress : callable or bool, optional
        Called with a line about long work.  By default work of more than two seconds shows one line, overwritten, in a
        terminal or a notebook; False: never; True: even if the output is not a terminal.

    Returns
    -------
    CodesignResult
        UNDECIDED with a message if (A, B) is not controllable, or if no design was found.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError
        Sizes that do not fit; numbers that are not finite and real; a plant without inputs.

    Notes
    -----
    Without vertices this succeeds for every controllable pair that is not numerically uncontrollable:
    milliseconds to a second.  With vertices it is a search.

    Examples
    --------
    >>> import control as ct
    >>> design = design_cone_and_feedback(ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0))
    >>> design.status.name, design.cone.is_simplicial
    ('PROVED', True)
    """
    limit, seed = seconds(time_limit), whole_number(seed, "seed")
    plant = _plant(sys, "sys")
    asked = None if rate is None else exact_number(rate, "rate", nonnegative=True)
    places = None if poles is None else _given_poles(poles, plant)
    if places is not None and asked is not None:
        slowest = float(1 - np.abs(places).max()) if plant.discrete else float(-places.max())
        if slowest < asked:
            raise DataError(f"poles decay at {about(slowest)}, and rate asks for {about(asked)}; give one of them.")
    others = [
        _plant(item, f"vertices[{k}]") for k, item in enumerate(items([] if vertices is None else vertices, "vertices"))
    ]
    for k, other in enumerate(others):
        if other.sizes[:2] != plant.sizes[:2]:
            raise ShapeError(
                f"vertices[{k}] has {other.sizes[0]} states and {other.sizes[1]} inputs, but the system has "
                f"{plant.sizes[0]} and {plant.sizes[1]}."
            )
    served = [plant, *(other for other in others if not _is_same(other, plant))]
    with Reporter(progress) as report:
        return within_limits(
            lambda: _search(served, asked, places, seed, report),
            _not_found,
            operations=_EFFORT,
            time_limit=limit,
        )


def _not_found(reason: str) -> CodesignResult:
    advice = (
        "No cone and gain were found; none was excluded. A lower rate, vertices nearer to each other, more inputs, or "
        "more time may help: the dominant pole should stay real and isolated in every vertex."
    )
    return CodesignResult(status=Status.UNDECIDED, message=f"{reason} {advice}".lstrip())


def _uncontrollable(plant: System, rank: int) -> str:
    """Why no poles are placed where floating point finds fewer directions than states that the input moves."""
    advice, n = "Design for the controllable part, or use state_feedback with a cone of your own.", plant.sizes[0]
    with suppress(OutOfBudgetError):
        exact = reachable(plant.A, plant.B).shape[1]
        if exact < n:
            return f"(A, B) is not controllable: only {exact} of {n} directions can be moved by the input. {advice}"
    return f"(A, B) is so close to uncontrollable that floating point finds only {rank} of {n} directions. {advice}"


def _given_poles(poles: Any, plant: System) -> Array:
    """Poles to be placed.

    Raises
    ------
    ShapeError, DataError
        Not one for every state; not real, distinct and stable.
    """
    found = vector(poles, "poles", plant.sizes[0])
    stable = (np.abs(found) < 1) if plant.discrete else (found < 0)
    if not stable.all() or len(np.unique(found)) < len(found):
        where = "inside the unit circle" if plant.discrete else "negative"
        raise DataError(f"poles are {shown(found)}; they must be real, distinct and {where}.")
    return found


def _search(
    served: list[System], rate: Fraction | None, poles: Array | None, seed: int, report: Callable[[str], None]
) -> CodesignResult:
    """Poles after poles, until cone and gain are proven."""
    matrices, inputs = (np.array([dense(m.values) for m in kind]) for kind in zip(*map(_pair, served), strict=True))
    robust, n, discrete = len(served) > 1, matrices.shape[-1], served[0].discrete
    rank = _controllable(matrices[0], inputs[0])
    if rank < n:
        return CodesignResult(status=Status.UNDECIDED, message=_uncontrollable(served[0], rank))

    def proven(attempt: tuple[int, Array]) -> CodesignResult | None:
        (k, F), found = attempt, None
        try:
            R = _starting_cone(matrices[0] + inputs[0] @ F, discrete)
            if R is not None and robust:
                place = simplicial_descent(matrices, R, discrete=discrete, inputs=inputs, F=F)
                report(f"poles {k}: margin {place.margin:.3g}")
                R, F = place.R if place.margin > 0 else None, place.F
            if R is not None and _is_within_reach(R):
                rates = _rates(matrices + inputs @ F, discrete, robust) if rate is None else (rate,)
                found = first_proven(rates, lambda least: _polished(served, R, F, least, keep=poles is not None))
        except OutOfBudgetError:
            if not affords():
                raise
        if not found:  # other poles may need less
            report(f"poles {k}: no cone and gain")
        return found

    near = np.abs(np.linalg.eigvals(matrices[0]))
    patterns = _poles(near, discrete, robust, seed) if poles is None else iter([poles])
    fast = (_fast_enough(pattern, None if poles is not None else rate, discrete) for pattern in patterns)
    gains = (F for F in (placed(matrices[0], inputs[0], pattern) for pattern in fast) if F is not None)
    found = first_proven(enumerate(gains), proven)
    return found or _not_found(ended(ended_by()))


def _is_within_reach(R: Array) -> bool:
    """Whether the facets of the cone can be computed with the effort that is left."""
    return (
        affords((len(R) / 60) ** 6.5 * _FOR_SIXTY) or simplicial_facets(Matrix(np.ascontiguousarray(R.T))) is not None
    )


def _plant(item: Any, name: str) -> System:
    """The plant; all its states are outputs if it is a pair (A, B)."""
    if not isinstance(item, StateSpace):
        if not isinstance(item, (tuple, list)) or len(item) != 2:
            raise DataError(f"{name} must be a StateSpace or a pair (A, B), not {type(item).__name__}.")
        A = square(item[0], f"{name}: A")
        item = A, item[1], np.eye(A.shape[0]), [[0]]
    plant = System.read(item, name)
    square(plant.A, f"{name}.A")
    if not plant.sizes[1]:
        raise DataError(f"{name} has no inputs; there is nothing to design.")
    return plant


def _pair(plant: System) -> tuple[Matrix, Matrix]:
    return plant.A, plant.B


def _is_same(one: System, other: System) -> bool:
    return all((a.fractions() == b.fractions()).all() for a, b in zip(_pair(one), _pair(other), strict=True))


def _controllable(A: Array, B: Array) -> int:
    """Rank of the controllability matrix, each power scaled to length one."""
    blocks, block, (n, m) = [], B / (np.linalg.norm(B) or 1.0), B.shape
    rank, first = 0, min(n, 2 * n // m + 1)
    for k in range(1, n + 1):
        blocks.append(block)
        if k in (first, n):  # more columns make no singular value smaller
            spend(_PER_STEP * n * n * m * k)
            rank = int(np.linalg.matrix_rank(np.column_stack(blocks), tol=1e-12 * n))
        if rank == n:
            break
        block = A @ block
        block = block / (np.linalg.norm(block) or 1.0)
    return rank


def _fast_enough(poles: Any, rate: Fraction | None, discrete: bool) -> Array:
    """The poles, all moved by one factor where the dominant one is slower than a rate that is asked for."""
    found, slowest = np.asarray(poles, dtype=float), float(np.max(poles))
    needed = 0.0 if rate is None else float(rate)
    if discrete:
        return found if 1 - slowest > needed or needed >= 1 else found * (0.8 * (1 - needed) / slowest)
    return found if -slowest > needed else found * (1.25 * needed / -slowest)


def _rates(loops: Array, discrete: bool, robust: bool) -> tuple[float, ...]:
    """Decay rates demanded where none is given: half of that of the placed poles; any for several plants."""
    modes = np.linalg.eigvals(loops)
    rate = float(np.min(1 - np.abs(modes) if discrete else -modes.real))
    return (max(rate, 0.0) / 2, 0.0) if robust else (max(rate, 0.0) / 2,)


def _poles(moduli: Array, discrete: bool, robust: bool, seed: int) -> Iterator[NDArray[np.floating]]:
    """Where to place the poles: close to where they are, then at a few sizes, and at random for several plants."""
    n, rng = len(moduli), np.random.default_rng(seed)
    if discrete:
        for top, ratio in ((0.8, 0.8), (0.5, 0.4), (0.9, 0.9)):
            yield top * ratio ** np.arange(n)
        for _ in range(_RANDOM if robust else 0):
            yield rng.uniform(0.1, 0.95) * np.cumprod(rng.uniform(0.2, 0.95, n))
        return
    size = max(float(np.median(moduli)) or 1.0, 1e-3 * (float(moduli.max()) or 1.0))
    # Real, at the open-loop distances, a little apart; for several plants with the dominant pole alone on the right.
    near = np.sort(moduli) + 1e-1 * size
    for k in range(1, n):
        near[k] = max(near[k], (1.4 if robust else 1.15) * near[k - 1])
    for front in (0.5, 0.25, 0.1) if robust else (1.0,):
        yield -near * np.append(front, np.ones(n - 1))
    for first, ratio in ((1.0, 1.6), (0.3, 1.3), (4.0, 1.3)):
        yield -size * first * ratio ** np.arange(n)
    for _ in range(_RANDOM if robust else 0):
        yield -size * 10 ** rng.uniform(-1.5, 1) * np.cumprod(np.append(1.0, rng.uniform(1.2, 4, n - 1)))


def _starting_cone(A: Array, discrete: bool) -> Array | None:
    """The simplicial cone of a closed loop with real poles, generators as columns of length 1."""
    m = modes(A, discrete=discrete)
    found = None if m is None else modal_cone(m, discrete=discrete, max_rays=len(A))
    return None if found is None else found.R / np.linalg.norm(found.R, axis=0)


def _polished(served: list[System], R: Array, F: Array, rate: Any, *, keep: bool = False) -> CodesignResult | None:
    """The smallest gain at this cone and rate, for all plants, proven; F if that is all there is, or to `keep`."""
    spend(program_effort(len(served) * R.size, F.size))
    cone, source = PolyhedralCone(np.ascontiguousarray(R.T)), served[0]
    system = ConeStateSpace(*source.matrices, source.dt or 0, X=cone, remove_useless_states=False)
    pairs = [_pair(plant) for plant in served]
    plant = read_plant(system, cone, vertices=pairs)
    inside = keep or (margins_of(plant, F) > 0).all()
    given = accept(plant, F, rate=rate, x=R.sum(axis=1), rounded=not keep) if inside else None
    design = None
    if not keep:
        design = state_feedback(system, X=cone, vertices=pairs, rate=rate, time_limit=max(seconds_left(), 1e-3))
    if not design and given is not None:
        design = succeed(plant, given, "", given.size)
    if not design:
        return None
    return CodesignResult(
        status=Status.PROVED,
        certificate=design.certificate,
        cone=cone,
        F=np.asarray(design.F),
        closed_loop=design.closed_loop,
        poles=np.linalg.eigvals(dense(source.A.values) + dense(source.B.values) @ design.F),
    )
