"""From a proposed gain to a certified one, and to the result that tells of it.

Solvers propose F in doubles with errors of 1e-9; the closed loop A + B F is formed in rational arithmetic
from the exact data and an F of few digits, and every demand is proven about that F, or F is not returned.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from ..cones import orthant
from ..errors import DataError
from ..exact.budget import OutOfBudgetError, budget, spend
from ..exact.matrix import Matrix
from ..exact.rounding import double_below
from ..families.candidates import inside
from ..families.common_vector import CommonVectorCertificate
from ..proof.answer import first_proven
from ..proof.certificate import Certificate, Status
from ..systems.statespace import ConeStateSpace
from ..theorems.positivity import PositivityCertificate, cone_positivity
from ..theorems.stability import LyapunovCertificate, linear_lyapunov
from .actuator_loss import certified_fraction
from .bounded.certificate import OrderIntervalCertificate
from .bounded.covers import covered
from .certificates import DisturbanceCertificate, FeedbackCertificate, GainBoundCertificate
from .controllability import controllability_notes
from .plant import Floats, Plant, closed_loop, times
from .result import DesignResult
from .running import EFFORT

# Significant decimal digits tried for the gain, fewest first.
_DIGITS = (3, 4, 5, 6, 8, 10, 12, 15)
# Part of the margins of F that a rounding of it must keep.
_KEPT = 0.5
# Operations of a proof, for each entry of the closed loop and for each product of integers in it.
_EFFORT_PER_ENTRY, _EFFORT_PER_PRODUCT = 6e3, 60.0
# The same where signs are found in integers, for n^2.2; margins above which floating point finds them.
_EFFORT_IN_INTEGERS, _CLEAR = 2.5e5, 1e-12
# How far, relatively, a rate in doubles may be below one that is then decided exactly.
_EQUAL = 1e-6


@dataclass(frozen=True)
class Accepted:
    """A gain with its proof.

    Attributes
    ----------
    F, size : ndarray, float
        As it was accepted, the K of output feedback; max |F x_k|.
    full : Matrix
        From states to inputs.
    closed : tuple of Matrix
        A + B F of every vertex.
    certificate : Certificate
    rate : float or Fraction
        The decay rate that was demanded.
    """

    F: Floats
    size: float
    full: Matrix
    closed: tuple[Matrix, ...]
    certificate: Certificate
    rate: float | Fraction


def roundings(F: Floats) -> Iterator[Floats]:
    """F with ever more significant digits, and F itself; entries below 1e-12 of the largest in a row vanish."""
    seen: list[Floats] = []
    cleaned = np.where(np.abs(F) < 1e-12 * np.abs(F).max(initial=0.0), 0.0, F)
    for digits in _DIGITS:
        candidate = _rounded(cleaned, digits)
        if not any(np.array_equal(candidate, old) for old in seen):
            seen.append(candidate)
            yield candidate
    yield F


def _rounded(values: Floats, digits: int) -> Floats:
    """With so many decimal digits: a whole number times or over a power of ten, which is exact up to 1e22."""
    with np.errstate(all="ignore"):
        last = np.where(values == 0, 0.0, np.floor(np.log10(np.abs(values)))) - (digits - 1)
        above, below = np.power(10.0, np.maximum(last, 0)), np.power(10.0, np.maximum(-last, 0))
        out = np.rint(values / above * below) * above / below
    return np.where(np.isfinite(out), out, values)


def accept(
    plant: Plant,
    F: Any,
    *,
    rate: float | Fraction = 0.0,
    x: Floats | None = None,
    gain: float = np.inf,
    gamma: float | None = None,
    rounded: bool = True,
) -> Accepted | None:
    """The first rounding of F for which every demand is proven, or None.

    Parameters
    ----------
    plant : Plant
    F : ndarray, shape (m, n); of output feedback the K of u = K y, shape (m, q)
    rate : float or Fraction
        Decay rate to be proven, exactly.
    x : ndarray, shape (n,), optional
        Candidate for the common vector of several vertices, or of the bound on the gain from disturbances.
    gain : float
        Roundings whose max |F x_k| exceeds this are passed over.
    gamma : float, optional
        Bound on the L-infinity gain, for a plant with a disturbance.
    rounded : bool
        False: F itself and no rounding of it.
    """
    F = np.asarray(F, dtype=float)
    if F.shape != plant.shape or not np.isfinite(F).all():
        return None
    if plant.pattern is not None:
        F = np.where(plant.pattern, F, 0.0)
    wanted = margins_of(plant, F)
    needed = np.where(wanted > 1e-9, _KEPT * wanted, -1e-11)

    def prove(candidate: Floats) -> Accepted | None:
        margins = margins_of(plant, candidate)
        if not (margins >= needed).all():
            return None
        size = plant.gain_of(candidate)
        if not (candidate is F or size <= gain):
            return None
        spend(_effort(plant, margins))
        try:
            return _prove(plant, candidate, size, rate, x, gamma)
        except DataError:  # numbers so large that the closed loop is no double
            return None

    try:
        return first_proven(roundings(F) if rounded else (F,), prove)
    except OutOfBudgetError:
        return None


def _effort(plant: Plant, margins: Floats) -> float:
    """Operations of one proof, most of them to form A + B F from numbers of any length.

    Where margins are so small that signs have to be found in integers, facets in integers take longer.
    """
    loops = len(plant.vertices) * (1 if plant.coupling is None else 2)
    forms = plant.n**2 + len(plant.facets) * len(plant.rays) / 50
    effort = _EFFORT_PER_ENTRY * forms + _EFFORT_PER_PRODUCT * plant.n**2 * plant.m
    if margins.min(initial=np.inf) < _CLEAR and plant.X.exact_facets.integer_rows is not None:
        effort += _EFFORT_IN_INTEGERS * plant.n**2.2
    return loops * effort


def margins_of(plant: Plant, F: Floats) -> Floats:
    """Relative margins of invariance in floating point, for all vertices."""
    rays, facets, u, out = plant.rays.T, plant.facets, F @ plant.seen, []
    most = np.abs(F) @ np.abs(plant.seen)
    for A, B in plant.pairs:
        M = facets @ (A @ rays + B @ u)
        size = np.abs(facets) @ (np.abs(A) @ np.abs(rays) + np.abs(B) @ most)
        out.append(np.where(size > 0, M / size, 0.0)[plant.incidence])
    return np.concatenate([*out, *_margins_in_interval(plant, F)])


def _margins_in_interval(plant: Plant, F: Floats) -> Iterator[Floats]:
    """Relative margins of -(A + B F) x_max - w_max in X and, on a simplicial cone, of |F x| <= u_max."""
    bounds = plant.interval
    if bounds is None or bounds.x_max is None:
        return
    x, w = np.asarray(bounds.x_max.values), np.asarray(bounds.w_max.values)
    for A, B in plant.pairs:
        size = np.abs(plant.facets) @ (np.abs(A) @ np.abs(x) + np.abs(B) @ (np.abs(F) @ np.abs(x)) + np.abs(w))
        moved = plant.facets @ (A @ x + B @ (F @ x) - plant.discrete * x + w)
        yield -moved / np.maximum(size, 1e-300)
    if bounds.u_max is not None and plant.X.is_simplicial:
        used, parts = F @ plant.rays.T, plant.facets @ x / np.einsum("ij,ij->i", plant.facets, plant.rays)
        yield 1 - np.array([np.maximum(side * used, 0) @ parts for side in (1, -1)]).max(axis=0) / bounds.u_max.values


def _prove(plant: Plant, F: Floats, size: float, rate: Any, x: Floats | None, gamma: float | None) -> Accepted | None:
    full = exact_gain(plant, F)
    closed = tuple(closed_loop(A, B, full) for A, B in plant.vertices)
    loops = _all_proven(_proven_loop(M, plant, rate) for M in closed)
    others = _all_proven(_others(plant, full, closed, loops, rate, x, gamma)) if loops else None
    if others is None:
        return None
    single = len(loops) == 1 and not others
    proof = loops[0] if single else FeedbackCertificate.settle(loops=loops, others=others)
    return Accepted(F, size, full, closed, proof, rate)


def _others(
    plant: Plant,
    full: Matrix,
    closed: tuple[Matrix, ...],
    loops: tuple[Any, ...],
    rate: Any,
    x: Floats | None,
    gamma: float | None,
) -> Iterator[Certificate | None]:
    """What is demanded besides the stability of every closed loop."""
    if plant.gain_bound is not None:
        yield GainBoundCertificate.settle(F=full, bound=plant.gain_bound, X=plant.X, leading=True)
    if plant.ports:
        sys = plant.system
        out = closed_loop(sys.C, sys.D, full)
        for M, (_, B) in zip(closed, plant.vertices, strict=True):
            yield cone_positivity(M, B, out, sys.D, plant.X, sys.U, sys.Y, discrete=plant.discrete)
    if plant.coupling is not None:
        for M in closed:
            yield _proven_loop(closed_loop(M, plant.coupling, Matrix.identity(plant.n)), plant, rate)
    if plant.disturbance is not None:
        E, G, H, D = plant.disturbance
        W, Z, seen = orthant(E.shape[1]), orthant(G.shape[0]), closed_loop(G, H, full)
        for M in closed:
            proof = cone_positivity(M, E, seen, D, plant.X, W, Z, discrete=plant.discrete)
            yield DisturbanceCertificate.settle(positivity=proof, x=x, gamma=gamma)
    if plant.interval is not None:
        yield from (_in_interval(plant, full, loop) for loop in loops)
    if len(closed) > 1:
        yield first_proven(
            _common(plant, closed, tuple(l.positivity for l in loops), rate, x),
            lambda pair: CommonVectorCertificate.of(*pair, Fraction(rate)) or None,
        )


def _common(
    plant: Plant, closed: tuple[Matrix, ...], positive: tuple[Any, ...], rate: float | Fraction, x: Floats | None
) -> Iterator[tuple[tuple[Any, ...], Floats]]:
    """Candidates for a common vector, x inside X first: a v inside X* is one of the transposed loops on X*."""
    rays, facets = plant.rays, plant.facets
    more: dict[str, Any] = {"discrete": plant.discrete, "rate": float(rate), "scale": plant.scale}
    if x is not None and plant.disturbance is None:  # that of a bound on a gain decays as slowly as it may
        yield positive, x
    found = inside(rays, facets, closed, **more)
    if found is not None:
        yield positive, found
    if x is not None and plant.disturbance is not None:
        yield positive, x
    turned = tuple(M.T for M in closed)
    found = inside(facets, rays, turned, **more)
    if found is not None:
        dual = plant.X.dual
        yield tuple(PositivityCertificate.settle(A=M, X=dual, discrete=plant.discrete) for M in turned), found


def _in_interval(plant: Plant, full: Matrix, loop: LyapunovCertificate) -> OrderIntervalCertificate | None:
    """[0, x_max] is kept, and |F x| <= u_max on it."""
    bounds = plant.interval
    if bounds is None or bounds.x_max is None:
        return None
    data: dict[str, Any] = {"positivity": loop.positivity, "w_max": bounds.w_max, "x_max": bounds.x_max}
    if bounds.u_max is not None:
        rows, limits = Matrix.join([full, -full], -2), Matrix.join([bounds.u_max] * 2, 0)
        found = [g for g, _ in covered(plant.X, rows, limits, bounds.x_max) if g is not None]
        if len(found) < rows.shape[0]:
            return None
        data |= {"rows": rows, "bounds": limits, "covers": Matrix.join(found, -2)}
    return OrderIntervalCertificate.settle(**data)


def _all_proven(parts: Iterable[Certificate | None]) -> Any:
    """The parts, or None as soon as one is not proven."""
    proven = []
    for part in parts:
        if not part:
            return None
        proven.append(part)
    return tuple(proven)


def _proven_loop(M: Matrix, plant: Plant, rate: float | Fraction) -> LyapunovCertificate | None:
    """Theorem 2 for one closed loop, with the tightest rate or exactly this one where the plain one does not do."""
    loop = linear_lyapunov(M, plant.X, discrete=plant.discrete)
    if not loop:
        return None
    if loop.decay_rate >= rate:
        return loop
    loop = linear_lyapunov(M, plant.X, discrete=plant.discrete, rate="max")
    if loop and loop.decay_rate < rate <= loop.decay_rate_bound and rate <= loop.decay_rate * (1 + _EQUAL):
        loop = linear_lyapunov(M, plant.X, discrete=plant.discrete, rate=rate)
    return loop if loop and (loop.decay_rate >= rate or loop.required_rate is not None) else None


def exact_gain(plant: Plant, F: Floats) -> Matrix:
    """The gain from states to inputs: F, or F C of output feedback."""
    K = Matrix(np.array(F))
    return K if plant.reads is None else times(K, plant.reads)


# -- results


def undecided(message: str, plant: Plant | None = None, **more: Any) -> DesignResult:
    """No gain was found, or none proven; with notes about the modes of the plant, if it is given."""
    notes = () if plant is None else controllability_notes(plant)
    return DesignResult(status=Status.UNDECIDED, message=message, notes=notes, **more)


def beyond_feedback(plant: Plant, message: str, **matrices: Any) -> DesignResult | None:
    """REFUTED with the message if what no feedback changes leaves the cones: arguments of `cone_positivity` but A."""
    for _, B in plant.vertices:
        data = {"B": B, "C": None, "D": None} | matrices
        positive = cone_positivity(np.eye(plant.n), **data, X=plant.X, discrete=plant.discrete)
        if positive.status is Status.REFUTED:
            return DesignResult(status=Status.REFUTED, certificate=positive, message=message)
    return None


def succeed(plant: Plant, found: Accepted, objective: str, value: float, limit: Any = float("nan")) -> DesignResult:
    """The result for an accepted gain; a limit may be given as a function that proves it."""
    return DesignResult(
        status=Status.PROVED,
        F=found.F,
        closed_loop=partial(loop_of, plant, found.closed[0], plant.vertices[0][1], found.full),
        certificate=found.certificate,
        objective=objective,
        value=value,
        limit=limit,
        decay_rate=proven_rate(found.certificate, found.rate),
        certified_fraction=partial(certified_fraction, plant, found.full, found.certificate, found.rate),
        weakened_rate=found.rate,
        notes=partial(_notes, plant),
    )


def loop_of(plant: Plant, closed: Matrix, B: Matrix, F: Matrix) -> ConeStateSpace:
    """The closed loop x' = (A + B F) x, y = (C + D F) x of a vertex, with the cones of the plant."""
    sys = plant.system
    return ConeStateSpace(
        closed,
        B,
        closed_loop(sys.C, sys.D, F),
        sys.D,
        sys.dt,
        X=plant.X,
        U=sys.U,
        Y=sys.Y,
        remove_useless_states=False,
        **plant.names,
    )


def _notes(plant: Plant) -> tuple[str, ...]:
    """What the rows of an interval are, F and -F; and the modes that no gain moves."""
    bounded = plant.interval is not None and plant.interval.u_max is not None
    rows = ("These rows are F and -F: every |u_i| is at most its input bound on [0, x_max].",) if bounded else ()
    with budget(EFFORT["a limit"]):
        return (*rows, *controllability_notes(plant))


def proven_gamma(found: Accepted) -> float:
    """The bound on the L-infinity gain from w to z that is proven for every vertex."""
    parts = found.certificate.others  # type: ignore[attr-defined]
    return max(part.gamma for part in parts if isinstance(part, DisturbanceCertificate))


def proven_rate(certificate: Certificate, demanded: float | Fraction) -> float:
    """Decay rate of a certificate (of its slowest vertex), and that which was demanded and proven, rounded down."""
    rate = float(getattr(certificate, "decay_rate", np.nan))
    return rate if rate >= demanded else double_below(demanded)
