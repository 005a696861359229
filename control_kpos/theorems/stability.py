"""Exponential stability of a K-positive system by a linear Lyapunov vector.

Theorem 2 (Kawano and Forni, Theorem `cone_s`).  Let e^{At} X stay inside X for t >= 0.  Then A is Hurwitz
if and only if some v satisfies, for every generator x_i of X,

    v'x_i > 0    and    v'A x_i < 0.

One linear solve decides it: for any c in int X*, v = -A^{-T} c lies in int X* exactly when A is Hurwitz.
In discrete time A - I takes the place of A.  A "no" has a witness too: some x in X, x != 0, with A x in X
(A x - x in X).  Exactly one of v and x exists.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cards import floored, raised
from ..cones import Cone
from ..exact.condition import Condition, all_hold
from ..exact.intake import exact_number
from ..exact.matrix import Matrix, bit_length
from ..exact.signs import BilinearForms
from ..proof.certificate import ClaimWithRate, Fractions, Status, Vector, exactly, is_tight
from ..proof.encoding import nested_text
from ..proof.inclusion import NO_MARGIN, PositivityViolation
from ..proof.portable_cones import own_generators
from ..proof.weights import (
    ProofOmittedError,
    Prover,
    drift,
    numbers,
)
from .generator_coordinates import decide_stability
from .growing_direction import (
    InstabilityCombination,
    InstabilityDirection,
    SlowDirection,
    combination_conditions,
    drift_forms,
    growing_combination,
    instability_conditions,
    transposed_drift,
)
from .lyapunov_candidates import ScaledProblem, SingularMatrixError
from .positivity import (
    ClaimOnPositivity,
    PositivityCertificate,
    state_positivity,
)

_POSITIVE, _DECREASING, _RATE = "v'x > 0", "v'A x < 0", "v'A x + rate v'x <= 0"
_REQUIRED = "v'A x + required_rate v'x <= 0"
_SLOW, _SLOW_IN = "h'A x + bound h'x >= 0", "h'x >= 0 (slow direction)"
_SMALL = 64
# Relative reductions tried until a decay rate is proven.
_BACKOFF = (0.0, 2.0**-50, 2.0**-44, 1e-11, 1e-9, 1e-6, 1e-3, 0.5)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LyapunovCertificate(ClaimOnPositivity, ClaimWithRate):
    """Proof that X is invariant and x' = A x exponentially stable, or proof that one of them fails.

    Attributes
    ----------
    positivity : PositivityCertificate
        Invariance of X, with the data A and X.
    v : ndarray, shape (n,), or None
        V(x) = v'x is positive on X without 0 and decreases along trajectories.
    decay_rate : float
        Proven: V(x(t)) <= exp(-decay_rate * t) V(x(0)), per unit of time of A; in discrete time
        V(x[k]) <= (1 - decay_rate)^k V(x[0]).  NaN if there is no v.
    v_exact : tuple of Fraction, or None
        The exact v where doubles do not suffice; v is its rounding.
    slow_direction : ndarray, shape (n,), or None
        With `rate="max"`: x in X with A x + decay_rate_bound x in X.
    required_rate : Fraction or None
        A decay rate that was asked for, exactly as given; the claim includes it.
    decay_rate_bound : float
        Proven with `slow_direction`: no decay rate above this one is possible.  inf without it.
    slow_direction_exact : tuple of Fraction, or None
        The exact slow direction where doubles do not suffice.
    witness : PositivityViolation, InstabilityDirection or None
        Why not: a facet and a generator where invariance breaks, or some x in X, x != 0, with A x in X; for a rate
        that was asked for a `SlowDirection`, with A x + rate x in X at a smaller rate.
    """

    claim: ClassVar[str] = "stable"
    no_margin: ClassVar[frozenset[str]] = NO_MARGIN | {_RATE, _REQUIRED, _SLOW, _SLOW_IN}

    v: Vector = Vector()
    decay_rate: float = float("nan")
    v_exact: Fractions = Fractions("v")
    slow_direction: Vector = Vector()
    decay_rate_bound: float = float("inf")
    slow_direction_exact: Fractions = Fractions("slow_direction")

    @property
    def A(self) -> Matrix:
        """The matrix the verdict is about."""
        return self.positivity.A

    @property
    def X(self) -> Cone:
        """The cone the verdict is about."""
        return self.positivity.X

    @cached_property
    def margin(self) -> float:
        """As of every certificate; 0 for a proof that rests on less than floating point resolves."""
        found = super().margin
        return max(found, 0.0) if self else found

    @property
    def discrete(self) -> bool:
        """True for x[k+1] = A x[k]."""
        return self.positivity.discrete

    def conditions(self) -> Sequence[Condition]:
        """The inequalities on v, and on the slow direction if there is one."""
        v = exactly(self, "v")[None]
        rays = self.X.exact_rays
        out = [
            Condition(_POSITIVE, BilinearForms(v, None, rays), ">"),
            Condition(_DECREASING, drift_forms(v, self.A, rays, self.discrete), "<"),
            Condition(_RATE, drift_forms(v, self.A, rays, self.discrete, self.decay_rate), "<="),
        ]
        if self.required_rate is not None:
            out.append(Condition(_REQUIRED, drift_forms(v, self.A, rays, self.discrete, self.required_rate), "<="))
        if self.slow_direction is not None:
            x = exactly(self, "slow_direction")[None]
            out += _slow_conditions(self.A, self.X, self.discrete, x, self.decay_rate_bound)
        return out

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.v is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def is_consistent(self) -> bool:
        """True if both rates are those that v and the slow direction prove, here or as another machine rounds."""
        if self.v is None:
            return True
        rate = proven_rate(exactly(self, "v")[None], self.A, self.X.exact_rays, self.discrete)
        bound: float | None = float("inf")
        if self.slow_direction is not None:
            x = exactly(self, "slow_direction")[None]
            bound = _proven_bound(self.A, self.X, self.discrete, x)
        found = ((self.decay_rate == rate, _RATE), (self.decay_rate_bound == bound, _SLOW))
        return all(same or is_tight(self._own_conditions, name) for same, name in found)

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        if isinstance(w, PositivityViolation):
            return replace(self.positivity, witness=w).refutation()
        if not isinstance(w, InstabilityDirection) or self.positivity.status is not Status.PROVED or not np.any(w.x):
            return None
        if isinstance(w, SlowDirection) and not w.rate < (self.required_rate or 0):
            return None
        return _growth_conditions(self.positivity, w)

    def evidence(self) -> dict[str, Any]:
        """Evidence of positivity, and of a witness x (the slow direction) the weights of x and A x (+ bound x) in X."""
        w, out, prover = self.witness, self.positivity.evidence(), Prover()
        if self.slow_direction is not None:
            z = exactly(self, "slow_direction").fractions()
            slowed = drift(self.A, z, self.discrete, Fraction(self.decay_rate_bound))
            with suppress(ProofOmittedError):  # then the claim is proven without the bound
                out |= {"ws": prover.vector(self.X, z), "wb": prover.vector(self.X, slowed)}
        if not isinstance(w, InstabilityDirection):
            return out
        x = exactly(w, "x").fractions()
        slow = Fraction(w.rate) if isinstance(w, SlowDirection) else Fraction(0)
        moved = drift(self.A, x, self.discrete, slow)
        if isinstance(w, InstabilityCombination) and w.weights is not None:
            rays = own_generators(self.X)
            shares = (w.weights[np.array([k])].T for k in range(2))
            found = [prover.repaired(rays, y[:, None], q) for y, q in zip((x, moved), shares, strict=True)]
        else:
            found = [prover.vector(self.X, y) for y in (x, moved)]
        weights = dict(zip(("wx", "wz"), found, strict=True))
        return {**out, "shows": "motion", "x": numbers(x), "rate": nested_text(self.discrete - slow), **weights}

    def explain(self) -> str:
        """What has been proven, and at what rate."""
        if isinstance(self.refuted_by, PositivityViolation):
            return f"Refuted: X is not invariant. {self.positivity.explain()}"
        if isinstance(self.refuted_by, SlowDirection):
            rate = self._asked(raised)
            return f"Refuted: X is invariant, but no v'x, v in int X*, decreases at rate {rate} on it: {self.witness}."
        if self.refuted_by is not None:
            ahead = "A x - x" if self.discrete else "A x"
            return (
                f"Refuted: X is invariant, but not exponentially stable: {self.witness}; {ahead} lies in X again, "
                "so the "
                f"{'spectral radius is at least 1' if self.discrete else 'rightmost eigenvalue is not negative'}."
            )
        if self:
            rate = floored(self.decay_rate) if self.required_rate is None else self._asked(floored)
            law = f"(1 - {rate})^k" if self.discrete else f"exp(-{rate} t)"
            most = self.decay_rate_bound
            bound = f" No rate above {raised(most)} is possible." if np.isfinite(most) else ""
            return (
                f"Proved exponentially stable on the invariant cone X: V(x) = v'x decreases at least as {law}.{bound} "
                f"Scale-free margin {self.margin:.3g}; invariance has margin {self.positivity.margin:.3g}. "
                "Stability on X implies stability in all of R^n, because X has interior."
            )
        if not self.positivity:
            return f"Undecided, because invariance is: {self.positivity.explain()}"
        if self.required_rate is not None:
            return "Undecided: X is invariant, but whether v'x can decrease at the given rate could not be proven."
        return (
            "Undecided: X is invariant, but neither a Lyapunov vector nor a direction of growth could be proven; the "
            "system may be too close to the edge of stability for its size."
        )


def linear_lyapunov(
    A: ArrayLike | Matrix | Any,
    X: Cone | ArrayLike,
    *,
    discrete: bool = False,
    rate: Literal["max"] | float | Fraction | str | None = None,
) -> LyapunovCertificate:
    """Decide whether x' = A x is K-positive and exponentially stable on X: Theorem 2.

    Parameters
    ----------
    A : array_like or sparse matrix, shape (n, n)
        Doubles, integers, fractions or decimal strings.
    X : Cone, or array_like of its generators, shape (p, n)
        Polyhedral proper cone in R^n; may be a product of any number of cones.
    discrete : bool
        True for x[k+1] = A x[k].
    rate : "max", number or None
        A positive number, per unit of time of A: also V(x(t)) <= exp(-rate t) V(x(0)) is claimed, in discrete time
        V(x[k]) <= (1 - rate)^k V(x[0]).  Numbers may be fractions or text, and equality will do.
        "max": the v of (nearly) the largest provable decay rate, with a proven bound from above (not on
        cones whose facets are too many to list).
        None: v = -A^{-T} c for the sum c of the normalised facets, or for another c in int X*.

    Returns
    -------
    LyapunovCertificate
        PROVED with v and its decay rate, or REFUTED with the violated facet and generator, or with x
        in X, x != 0, such that A x is in X, or A x + bound x for a bound below the rate that was asked for.

    Raises
    ------
    ShapeError, DataError, NotProperConeError
        A is not square of the size of X, or not finite and real; X is not proper; `rate` is not positive.

    Notes
    -----
    Costs the invariance check, one factorisation of A (sparse if A is), and for "max" an eigenvalue and
    a few more factorisations.  Near the boundary the Perron vector is refined until its sign is
    certain (see `refinement`), whatever the size.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> cert = kp.linear_lyapunov([[0, 1], [-22, -13]], X, rate="max")
    >>> cert.status.name, round(cert.decay_rate, 6)
    ('PROVED', 2.0)
    >>> kp.linear_lyapunov([[1, 0], [0, -1]], kp.orthant(2)).status.name
    'REFUTED'
    """
    if rate is not None and not (isinstance(rate, str) and rate == "max"):
        rate = exact_number(rate, "rate", positive=True)
    return lyapunov_on(state_positivity(A, X, discrete=discrete), rate=rate)


@np.errstate(all="ignore")
def lyapunov_on(
    positivity: PositivityCertificate, *, rate: Literal["max"] | Fraction | None = None
) -> LyapunovCertificate:
    """Decide stability once invariance has been decided; see `linear_lyapunov`."""
    if isinstance(rate, Fraction):
        return _at_rate(positivity, rate)
    if positivity.witness is not None:
        return LyapunovCertificate.settle(positivity=positivity, witness=positivity.witness)
    if not positivity:
        return LyapunovCertificate.settle(positivity=positivity)
    A, X, discrete = positivity.A, positivity.X, positivity.discrete
    fastest = rate == "max"
    for balanced in (False, True):
        problem = ScaledProblem(A, X, discrete, balanced=balanced)
        found = _by_doubles(positivity, problem, fastest)
        if found is not None:
            return found
    decided = decide_stability(A, X, discrete)
    if decided is None:
        return LyapunovCertificate.settle(positivity=positivity)
    stable, integers = decided
    # over a power of two, so that the doubles neither overflow nor vanish
    exact = Matrix.over(integers, 1 << bit_length(integers))
    if not stable:
        witness = _growing(positivity, Matrix(exact.values)) or _growing(positivity, exact)
        return LyapunovCertificate.settle(positivity=positivity, witness=witness)
    found = _fastest(positivity, ScaledProblem(A, X, discrete)) if fastest else None
    return found or _proved(positivity, exact)


def _by_doubles(positivity: PositivityCertificate, problem: ScaledProblem, fastest: bool) -> LyapunovCertificate | None:
    """A proof from one solve, or from shifts if the cone is not simplicial; None where doubles do not suffice."""
    with suppress(SingularMatrixError):
        v = Matrix(problem.left_vector(0.0))
        found = _fastest(positivity, problem) if fastest and _is_lyapunov(v[None], positivity) else None
        found = found or _proved(positivity, v)
        if found:
            return found
    for x in problem.growing_directions():
        witness = _growing(positivity, x)
        if witness is not None:
            return LyapunovCertificate.settle(positivity=positivity, witness=witness)
    return None


def _growing(positivity: PositivityCertificate, x: Matrix) -> InstabilityDirection | None:
    """The proven direction of growth along x, or None."""
    A, X, discrete, proof = positivity.A, positivity.X, positivity.discrete, positivity.generator_proof
    witness = InstabilityDirection(x) if proof is None else growing_combination(A, X, discrete, x, proof)
    return witness if witness is not None and all_hold(_growth_conditions(positivity, witness) or ()) else None


def _growth_conditions(positivity: PositivityCertificate, w: InstabilityDirection) -> list[Condition] | None:
    """The inequalities on a direction of growth; None if weights come without generators."""
    A, X, discrete, proof = positivity.A, positivity.X, positivity.discrete, positivity.generator_proof
    if not isinstance(w, InstabilityCombination):
        return instability_conditions(A, X, discrete, w)
    return None if proof is None else combination_conditions(A, X, discrete, w, proof)


def _proved(positivity: PositivityCertificate, v: Matrix, **more: Any) -> LyapunovCertificate:
    rate = proven_rate(v[None], positivity.A, positivity.X.exact_rays, positivity.discrete)
    return LyapunovCertificate.settle(positivity=positivity, v=v, decay_rate=rate, **more)


def _fastest(positivity: PositivityCertificate, problem: ScaledProblem) -> LyapunovCertificate | None:
    """The Perron vectors of a stable A, moved inwards just enough to be proven; None if A is not stable."""
    A, X, discrete = positivity.A, positivity.X, positivity.discrete
    best: tuple[float, NDArray[np.float64]] | None = None
    slow: tuple[float, Matrix] | None = None
    for v in problem.left_perron_vectors():
        row = Matrix(v[None])
        if _is_lyapunov(row, positivity):
            rate = proven_rate(row, A, X.exact_rays, discrete)
            if best is None or rate > best[0]:
                best = rate, v
    if best is None:
        return None
    for candidate in problem.right_perron_vectors() if positivity.generator_proof is None else ():
        bound = _proven_bound(A, X, discrete, candidate[None])
        if bound is not None and (slow is None or bound < slow[0]):
            slow = bound, candidate
        if slow is not None and slow[0] <= best[0] + 1e-9 * abs(best[0]):
            break
    if slow is None:
        return _proved(positivity, Matrix(best[1]))
    return _proved(positivity, Matrix(best[1]), decay_rate_bound=slow[0], slow_direction=slow[1])


def _at_rate(positivity: PositivityCertificate, rate: Fraction) -> LyapunovCertificate:
    """The certificate that claims a rate too."""
    A, X, discrete = positivity.A, positivity.X, positivity.discrete
    fastest = lyapunov_on(positivity, rate="max")
    if not fastest:
        return LyapunovCertificate.settle(**fastest.data() | {"required_rate": rate})
    found = _proved(positivity, exactly(fastest, "v"), required_rate=rate)
    if found:
        return found
    if fastest.slow_direction is not None and fastest.decay_rate_bound < rate:
        witness = SlowDirection(exactly(fastest, "slow_direction"), rate=fastest.decay_rate_bound)
        return LyapunovCertificate.settle(positivity=positivity, required_rate=rate, witness=witness)
    decided = decide_stability(A, X, discrete, rate, marginal=True)
    if decided is not None and decided[0]:
        found = _proved(positivity, Matrix.over(decided[1], 1 << bit_length(decided[1])), required_rate=rate)
    return found or LyapunovCertificate.settle(positivity=positivity, required_rate=rate)


# -- inequalities


def proven_rate(v: Matrix, A: Matrix, rays: Matrix, discrete: bool) -> float:
    """The largest decay rate in floating point that v proves, min_i -(v'A x_i) / (v'x_i) rounded down."""
    with np.errstate(all="ignore"):
        drift, value = drift_forms(v, A, rays, discrete).values, BilinearForms(v, None, rays).values
        quotient = float(np.min(-drift / value))
    if np.isfinite(quotient) and quotient > 0:
        for step in _BACKOFF:
            rate = quotient * (1 - step)
            # on large problems rate is rounded down until floating point proves it
            signs = drift_forms(v, A, rays, discrete, rate).signs(integers=A.shape[0] <= _SMALL)
            if np.isin(signs, (-1, 0)).all():
                return rate
    return 0.0


def _is_lyapunov(v: Matrix, p: PositivityCertificate) -> bool:
    return all_hold(
        [
            Condition(_POSITIVE, BilinearForms(v, None, p.X.exact_rays), ">"),
            Condition(_DECREASING, drift_forms(v, p.A, p.X.exact_rays, p.discrete), "<"),
        ]
    )


def _slow_conditions(A: Matrix, X: Cone, discrete: bool, row: Matrix, bound: float) -> list[Condition]:
    return [
        Condition(_SLOW_IN, BilinearForms(row, None, X.exact_facets), ">="),
        Condition(_SLOW, transposed_drift(row, A, X, discrete, bound), ">="),
    ]


def _proven_bound(A: Matrix, X: Cone, discrete: bool, row: Matrix) -> float | None:
    """The smallest bound on decay rates that x proves, rounded up; None if x proves nothing."""
    with np.errstate(all="ignore"):
        inside = BilinearForms(row, None, X.exact_facets).values
        drift = transposed_drift(row, A, X, discrete).values
        quotient = float(np.max(np.where(inside > 0, -drift / inside, -np.inf)))
    if np.isfinite(quotient):
        for step in _BACKOFF:
            bound = quotient + step * abs(quotient)
            if np.any(row.values) and all_hold(_slow_conditions(A, X, discrete, row, bound)):
                return bound
    return None
