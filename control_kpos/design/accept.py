"""From a proposed gain to a certified one, and to the result that tells of it.

Solvers propose F in doubles with errors of 1e-9; the closed loop A + B F is formed in rational arithmetic
from the exact data and an F of few digits, and every demand is proven about that F, or F is not returned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import about
from ..errors import DataError
from ..exact.budget import OutOfBudgetError, affords, spend
from ..exact.intake import exact_matrix
from ..exact.matrix import Matrix
from ..proof.answer import first_proven
from ..proof.certificate import Certificate, Status
from ..systems.statespace import ConeStateSpace
from ..theorems.positivity import cone_positivity
from ..theorems.stability import LyapunovCertificate, linear_lyapunov
from .certificates import CommonVectorCertificate, FeedbackCertificate, GainBoundCertificate
from .plant import Floats, Plant
from .result import DesignResult

# Significant decimal digits tried for the gain, fewest first.
_DIGITS = (3, 4, 5, 6, 8, 10, 12, 15)
# Part of the margins of F that a rounding of it must keep.
_KEPT = 0.5
# Operations of a proof, for each entry of the closed loop and for each product of integers in it.
_EFFORT_PER_ENTRY, _EFFORT_PER_PRODUCT = 6e3, 60.0
# The same where signs are found in integers, for n^2.2; margins above which floating point finds them.
_EFFORT_IN_INTEGERS, _CLEAR = 2.5e5, 1e-12
# Relative size of a singular value that counts as zero; operations of a decomposition, for each entry and row.
_RANK, _EFFORT = 1e-10, 10.0
# Distance kept from the end of the interval of fractions, which is computed in floating point.
_GUARD = 1e-9

# From a gain and its first closed loop to the proof of a further demand.
Further = Callable[[Floats, Matrix], Certificate]


@dataclass(frozen=True)
class Accepted:
    """A gain with its proof."""

    F: Floats
    closed: tuple[Matrix, ...]
    certificate: Certificate

    @property
    def loops(self) -> Any:
        """The proofs of stability, one for each vertex."""
        return getattr(self.certificate, "loops", (self.certificate,))


def closed_loop(A: Matrix, B: Matrix, F: Matrix) -> Matrix:
    """A + B F exactly; of stacks, for each matrix."""
    if B.is_zero:
        return A
    (a, unit), (b, first), (f, second) = A.as_integers(), B.as_integers(), F.as_integers()
    own, product = Fraction(unit), Fraction(first) * second
    # integers throughout: sums and products of fractions take ten times as long
    common = lcm(own.denominator, product.denominator)
    left, right = int(own * common), int(product * common)
    return Matrix.over(a * left + (b @ f) * right, common)


def roundings(F: Floats) -> Iterator[Floats]:
    """F with ever more significant digits, and F itself; entries below 1e-12 of the largest in a row vanish."""
    seen: list[Floats] = []
    cleaned = np.where(np.abs(F) < 1e-12 * np.abs(F).max(initial=0.0), 0.0, F)
    for digits in _DIGITS:
        candidate = np.array([[float(f"{v:.{digits - 1}e}") for v in row] for row in cleaned]).reshape(F.shape)
        if not any(np.array_equal(candidate, old) for old in seen):
            seen.append(candidate)
            yield candidate
    yield F


def accept(
    plant: Plant,
    F: Any,
    *,
    rate: float = 0.0,
    x: Floats | None = None,
    gain: float = np.inf,
    also: Further | None = None,
) -> Accepted | None:
    """The first rounding of F for which every demand is proven, or None.

    Parameters
    ----------
    plant : Plant
    F : ndarray, shape (m, n); of output feedback the K of u = K y, shape (m, q)
    rate : float
        Decay rate to be proven.
    x : ndarray, shape (n,), optional
        Candidate for the common vector of several vertices.
    gain : float
        Roundings whose max |F x_k| exceeds this are passed over.
    also : callable, optional
        A further demand, to be proven about F and the first closed loop.
    """
    F = np.asarray(F, dtype=float)
    if F.shape != plant.shape or not np.isfinite(F).all():
        return None
    if plant.pattern is not None:
        F = np.where(plant.pattern, F, 0.0)
    wanted = slack(plant, F)
    needed = np.where(wanted > 1e-9, _KEPT * wanted, -1e-11)

    def prove(candidate: Floats) -> Accepted | None:
        margins = slack(plant, candidate)
        if not (margins >= needed).all() or not (candidate is F or plant.gain_of(candidate) <= gain):
            return None
        spend(_effort(plant, margins))
        try:
            return _prove(plant, candidate, rate, x, also)
        except DataError:  # numbers so large that the closed loop is no double
            return None

    try:
        return first_proven((candidate for candidate in roundings(F) if affords()), prove)
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


def slack(plant: Plant, F: Floats) -> Floats:
    """Relative margins of invariance in floating point, for all vertices."""
    rays, facets, u, out = plant.rays.T, plant.facets, F @ plant.seen, []
    most = np.abs(F) @ np.abs(plant.seen)
    for A, B in plant.pairs:
        M = facets @ (A @ rays + B @ u)
        size = np.abs(facets) @ (np.abs(A) @ np.abs(rays) + np.abs(B) @ most)
        out.append(np.where(size > 0, M / size, 0.0)[plant.incidence])
    return np.concatenate(out)


def _prove(plant: Plant, F: Floats, rate: float, x: Floats | None, also: Further | None) -> Accepted | None:
    full = exact_gain(plant, F)
    closed = tuple(closed_loop(A, B, full) for A, B in plant.vertices)
    loops = _all_proven(_proven_loop(M, plant, rate) for M in closed)
    others = _all_proven(_others(plant, full, closed, loops, rate, x)) if loops else None
    if others is not None and also is not None:
        others = _all_proven((*others, also(F, closed[0])))
    if others is None:
        return None
    single = len(loops) == 1 and not others
    return Accepted(F, closed, loops[0] if single else FeedbackCertificate.settle(loops=loops, others=others))


def _others(
    plant: Plant, full: Matrix, closed: tuple[Matrix, ...], loops: tuple[Any, ...], rate: float, x: Floats | None
) -> Iterator[Certificate | None]:
    """What is demanded besides the stability of every closed loop."""
    if plant.gain_bound is not None:
        yield GainBoundCertificate.settle(F=full, bound=plant.gain_bound, X=plant.X)
    if plant.ports:
        sys = plant.system
        out = closed_loop(sys.C, sys.D, full)
        for M, (_, B) in zip(closed, plant.vertices, strict=True):
            yield cone_positivity(M, B, out, sys.D, plant.X, sys.U, sys.Y, discrete=plant.discrete)
    if plant.coupling is not None:
        for M in closed:
            yield _proven_loop(closed_loop(M, plant.coupling, Matrix.identity(plant.n)), plant, rate)
    if len(closed) > 1:
        yield None if x is None else CommonVectorCertificate.settle(loops=tuple(l.positivity for l in loops), x=x)


def _all_proven(parts: Iterable[Certificate | None]) -> Any:
    """The parts, or None as soon as one is not proven."""
    proven = []
    for part in parts:
        if not part:
            return None
        proven.append(part)
    return tuple(proven)


def _proven_loop(M: Matrix, plant: Plant, rate: float) -> LyapunovCertificate | None:
    """Theorem 2 for one closed loop, with the tightest rate only where the plain one does not do."""
    loop = linear_lyapunov(M, plant.X, discrete=plant.discrete)
    if loop and loop.decay_rate < rate:
        loop = linear_lyapunov(M, plant.X, discrete=plant.discrete, rate="max")
    return loop if loop and loop.decay_rate >= rate else None


def exact_gain(plant: Plant, F: Floats) -> Matrix:
    """The gain from states to inputs: F, or F C of output feedback."""
    K = exact_matrix(F, "F")
    return K if plant.reads is None else closed_loop(Matrix.zeros(plant.m, plant.n), K, plant.reads)


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


def succeed(plant: Plant, found: Accepted, objective: str, value: float, limit: float) -> DesignResult:
    """The result for an accepted gain."""
    sys = plant.system
    loop = ConeStateSpace(
        found.closed[0],
        plant.vertices[0][1],
        closed_loop(sys.C, sys.D, exact_gain(plant, found.F)),
        sys.D,
        sys.dt,
        X=plant.X,
        U=sys.U,
        Y=sys.Y,
        remove_useless_states=False,
        **plant.names,
    )
    return DesignResult(
        status=Status.PROVED,
        F=found.F,
        closed_loop=loop,
        certificate=found.certificate,
        objective=objective,
        value=value,
        limit=limit,
        decay_rate=proven_rate(found),
        certified_fraction=certified_fraction(plant, found),
        notes=controllability_notes(plant),
    )


def proven_rate(found: Accepted) -> float:
    """Decay rate of the slowest vertex."""
    return float(getattr(found.certificate, "decay_rate", np.nan))


# -- actuators that lose effect


def certified_fraction(plant: Plant, found: Accepted) -> float:
    """Smallest s such that every fraction in [s, 1] of the gain keeps X invariant and the same v decreasing.

    All inequalities of the certificate are linear in s, A + s B F, so these fractions are an interval that ends at 1.
    """
    u, loops, extra = found.F @ plant.seen, found.loops, 0.0
    if plant.coupling is not None:
        loops = [c for c in found.certificate.parts() if isinstance(c, LyapunovCertificate)][-len(plant.vertices) :]
        extra = np.asarray(plant.coupling.values)
    starts = [np.zeros(1)]
    for (A, B), loop in zip(plant.pairs, loops, strict=True):
        base, slope = plant.facets @ A @ plant.rays.T, plant.facets @ B @ u
        starts.append(interval_starts(base[None, plant.incidence], slope[None, plant.incidence]))
        drift, v = A + extra - (np.eye(plant.n) if plant.discrete else 0.0), np.asarray(loop.v)
        starts.append(interval_starts(-(v @ drift @ plant.rays.T)[None], -(v @ B @ u)[None]))
    return float(np.concatenate(starts).max())


def interval_starts(constant: Floats, slope: Floats) -> Floats:
    """Row by row the smallest s in [0, 1] with constant + t slope >= 0 for all t in [s, 1]; at 1 this is known."""
    size = np.abs(constant) + np.abs(slope)
    falling = constant < -1e-13 * size
    ends = np.where(falling, -constant / slope * (1 + _GUARD), 0.0)
    return np.clip(np.nan_to_num(ends, nan=1.0, posinf=1.0).max(axis=1, initial=0.0), 0.0, 1.0)


# -- modes that no feedback moves


def controllability_notes(plant: Plant) -> tuple[str, ...]:
    """One sentence for each uncontrollable mode of the first vertex, as far as the effort allows.

    Eigenvalues s with rank [A - s I, B] < n (Hautus) in floating point: advice, no proof.
    """
    A, B = plant.pairs[0]
    effort = plant.n**2 * (plant.n + plant.m) * _EFFORT
    if not affords(effort):
        return ()
    scale = max(np.abs(A).max(), np.abs(B).max(initial=0.0), np.finfo(float).tiny)
    with suppress(np.linalg.LinAlgError):
        modes = np.unique(np.round(np.linalg.eigvals(A) / scale, 9)) * scale
        upper = (mode for mode in modes if mode.imag >= 0 and affords(effort))
        fixed = [mode for mode in upper if _loses_rank(np.hstack([A - mode * np.eye(plant.n), B]))]
        return tuple(_note(mode, plant.discrete) for mode in fixed)
    return ()


def _loses_rank(M: NDArray[Any]) -> bool:
    """The smallest singular value is rounding."""
    sizes = np.linalg.svd(M, compute_uv=False)
    return not sizes[-1] > _RANK * sizes[0]


def _note(mode: Any, discrete: bool) -> str:
    bad = abs(mode) >= 1 if discrete else mode.real >= 0
    parts, form = ((mode.real,), "{}") if mode.imag == 0 else ((mode.real, mode.imag), "{} +/- {}j")
    consequence = (
        "it is not stable, so no feedback stabilises this plant, as far as eigenvalues in floating point can tell; "
        "change the actuators"
        if bad
        else "it is stable and stays as it is, which limits the decay rate but not the design"
    )
    return f"The mode {about(*parts, digits=4, form=form)} is not controllable: {consequence}."
