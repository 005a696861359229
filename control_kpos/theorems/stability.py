"""Exponential stability of a K-positive system by a linear Lyapunov vector.

Theorem 2 (Kawano and Forni, Theorem `cone_s`).  Let e^{At} X stay inside X for t >= 0.  Then A is Hurwitz
if and only if some v satisfies, for every generator x_i of X,

    v'x_i > 0    and    v'A x_i < 0.

One linear solve decides it: for any c in int X*, v = -A^{-T} c lies in int X* exactly when A is Hurwitz.
In discrete time A - I takes the place of A.  A "no" has a witness too: some x in X, x != 0, with A x in X
(A x - x in X).  Exactly one of v and x exists.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import tee
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..cards import floored, raised
from ..cones import Cone
from ..exact.condition import Condition, all_hold
from ..exact.intake import exact_number
from ..exact.matrix import Integers, Matrix, bit_length
from ..exact.signs import BilinearForms
from ..proof.certificate import ClaimWithRate, Fractions, Status, Vector, exactly
from ..proof.generators_in_files import growth_weights
from ..proof.in_time import unfinished
from ..proof.inclusion import NO_MARGIN, PositivityViolation
from ..proof.portable_cones import own_generators
from ..proof.weights import (
    ProofOmittedError,
    Prover,
    drift,
)
from .decay_rates import SLOW, SLOW_IN, drift_forms, proven_bound, proven_rate, slow_conditions
from .generator_coordinates import around_the_rate, decide_rate, decide_stability
from .growing_direction import (
    InstabilityCombination,
    InstabilityDirection,
    SlowDirection,
    combination_conditions,
    growing_combination,
    instability_conditions,
    moving_condition,
)
from .lyapunov_candidates import ScaledProblem, SingularMatrixError
from .positivity import (
    ClaimOnPositivity,
    PositivityCertificate,
    state_positivity,
)

_POSITIVE, _DECREASING, _RATE = "v'x > 0", "v'A x < 0", "v'A x + rate v'x <= 0"
_REQUIRED = "v'A x + required_rate v'x <= 0"


# Relative distances of a decay rate from its bound: no better bound is sought; no better vectors are.
_TIGHT, _CLOSE_ENOUGH = 1e-9, 1e-6


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
        that was asked for a `SlowDirection`, with A x + rate x in X at a smaller rate, or not 0 at this one.
    """

    claim: ClassVar[str] = "stable"
    no_margin: ClassVar[frozenset[str]] = NO_MARGIN | {_RATE, _REQUIRED, SLOW, SLOW_IN}

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
            out += slow_conditions(self.A, self.X, self.discrete, x, self.decay_rate_bound)
        return out

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.v is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        if isinstance(w, PositivityViolation):
            return replace(self.positivity, witness=w).refutation()
        if not isinstance(w, InstabilityDirection) or self.positivity.status is not Status.PROVED or not np.any(w.x):
            return None
        conditions, asked = _growth_conditions(self.positivity, w), self.required_rate or 0
        if conditions is None or not isinstance(w, SlowDirection) or w.rate < asked:
            return conditions
        return [*conditions, moving_condition(self.A, self.X, self.discrete, w)] if w.rate == asked else None

    @classmethod
    def _completed(cls, contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any]) -> dict[str, Any]:
        """The contents with the proof from generators, and the weights of a direction of growth, if it is one."""
        w, out = contents.get("witness"), super()._completed(contents, data, proof)
        if not isinstance(w, InstabilityCombination):
            return out
        return {**out, "witness": replace(w, weights=growth_weights(contents, data, proof, exactly(w, "x")))}

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
            weights = (w.weights[np.array([k])].T for k in range(2))
            found = [prover.repaired(rays, y[:, None], q) for y, q in zip((x, moved), weights, strict=True)]
        else:
            found = [prover.vector(self.X, y) for y in (x, moved)]
        weights = dict(zip(("wx", "wz"), found, strict=True))
        return {**out, **weights}

    def explain(self) -> str:
        """What has been proven, and at what rate."""
        if isinstance(self.refuted_by, PositivityViolation):
            return f"Refuted: X is not invariant. {self.positivity.explain()}"
        if isinstance(self.refuted_by, SlowDirection):
            rate = self._asked(raised)
            short = f", but not at {rate}" if self.refuted_by.rate == self.required_rate else ""
            return (
                f"Refuted: X is invariant, but no v'x, v in int X*, decreases at rate {rate} on it: "
                f"{self.witness}{short}."
            )
        if self.refuted_by is not None:
            ahead = "A x - x" if self.discrete else "A x"
            names = self._signals.support(np.asarray(self.refuted_by.x))
            return (
                f"Refuted: X is invariant, but not exponentially stable: {self.witness}; {ahead} lies in X again, "
                "so the "
                f"{'spectral radius is at least 1' if self.discrete else 'rightmost eigenvalue is not negative'}."
                f"{names}"
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
        if unfinished(self):
            return unfinished(self)
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
    first, *again = tee(ScaledProblem.both(positivity.A, positivity.X, positivity.discrete), 3)
    fastest = _fastest(positivity, first) if rate == "max" else None
    if fastest is not None:
        return fastest
    found = _by_doubles(positivity, again[0])
    found = _exactly(positivity) if found is None else found
    return _fastest(positivity, again[1], found) or found if rate == "max" and found else found


def _by_doubles(positivity: PositivityCertificate, problems: Iterable[ScaledProblem]) -> LyapunovCertificate | None:
    """A proof from one solve, or from shifts if the cone is not simplicial; None where doubles do not suffice."""
    for problem in problems:
        with suppress(SingularMatrixError):
            found = by_vector(positivity, Matrix(problem.left_vector(0.0)))
            if found:
                return found
        for x in problem.growing_directions():
            witness = _growing(positivity, x)
            if witness is not None:
                return LyapunovCertificate.settle(positivity=positivity, witness=witness)
    return None


def _exactly(positivity: PositivityCertificate) -> LyapunovCertificate:
    """The decision at zero, whatever doubles resolve."""
    decided = decide_stability(positivity.A, positivity.X, positivity.discrete)
    if decided is None:
        return LyapunovCertificate.settle(positivity=positivity)
    exact = _scaled(decided[1])
    if decided[0]:
        return by_vector(positivity, exact)
    witness = _growing(positivity, Matrix(exact.values)) or _growing(positivity, exact)
    return LyapunovCertificate.settle(positivity=positivity, witness=witness)


def _scaled(integers: Integers) -> Matrix:
    """Over a power of two, so that the doubles neither overflow nor vanish."""
    return Matrix.over(integers, 1 << bit_length(integers))


def _growing(positivity: PositivityCertificate, x: Matrix) -> InstabilityDirection | None:
    """The proven direction of growth along x, or None."""
    A, X, discrete, proof = positivity.A, positivity.X, positivity.discrete, positivity.generator_proof
    witness = InstabilityDirection(x) if proof is None else growing_combination(A, X, discrete, x, proof)
    return witness if witness is not None and all_hold(_growth_conditions(positivity, witness) or ()) else None


def _growth_conditions(positivity: PositivityCertificate, w: InstabilityDirection) -> list[Condition] | None:
    """The inequalities on a direction of growth; None if weights come without generators."""
    A, X, discrete, proof = positivity.A, positivity.X, positivity.discrete, positivity.generator_proof
    if not isinstance(w, InstabilityCombination) or proof is None:
        return instability_conditions(A, X, discrete, w)
    return combination_conditions(A, X, discrete, w, proof)


def by_vector(positivity: PositivityCertificate, v: Matrix, **more: Any) -> LyapunovCertificate:
    """The certificate that v makes, with the decay rate that v proves.

    Parameters
    ----------
    positivity : PositivityCertificate
    v : Matrix, shape (n,)
    **more : object
        Other fields.
    """
    rate = proven_rate(v[None], positivity.A, positivity.X.exact_rays, positivity.discrete)
    return LyapunovCertificate.settle(positivity=positivity, v=v, decay_rate=rate, **more)


def _fastest(
    p: PositivityCertificate, problems: Iterable[ScaledProblem], found: LyapunovCertificate | None = None
) -> LyapunovCertificate | None:
    """The v of the largest rate, and the x of the smallest bound, close to the Perron vectors; None without a v.

    By doubles, then exact at rates beside them, if stability is proven.
    """
    best = _Best() if found is None else _Best(found.decay_rate, exactly(found, "v"))
    for problem in problems:
        best = _improved(p, best, map(Matrix, problem.left_perron_vectors()), problem.right_perron_vectors())
        if best.is_closed:
            break
    else:
        if best.v is None:
            return None
        exact = {stable: [_scaled(vector)] for stable, vector in around_the_rate(p.A, p.X, p.discrete).items()}
        best = _improved(p, best, exact.get(True, []), exact.get(False, []))
    return None if best.v is None else by_vector(p, best.v, decay_rate_bound=best.bound, slow_direction=best.x)


class _Best(NamedTuple):
    """The largest rate with its v, and the smallest bound with its x."""

    rate: float = 0.0
    v: Matrix | None = None
    bound: float = float("inf")
    x: Matrix | None = None
    is_closed: bool = False


def _improved(p: PositivityCertificate, best: _Best, lefts: Iterable[Matrix], rights: Iterable[Matrix]) -> _Best:
    """The best of what was known and of some more vectors."""
    proven = [v for v in lefts if _is_lyapunov(v[None], p)]
    for v in proven:
        rate = proven_rate(v[None], p.A, p.X.exact_rays, p.discrete)
        if best.v is None or rate > best.rate:
            best = best._replace(rate=rate, v=v)
    if p.generator_proof is not None:
        return best._replace(is_closed=bool(proven))
    for x in rights if proven else ():
        bound = proven_bound(p.A, p.X, p.discrete, x[None])
        if bound is not None and bound < best.bound:
            best = best._replace(bound=bound, x=x)
        if best.bound <= best.rate * (1 + _TIGHT):
            break
    return best._replace(is_closed=best.bound <= best.rate * (1 + _CLOSE_ENOUGH))


def _at_rate(positivity: PositivityCertificate, rate: Fraction) -> LyapunovCertificate:
    """The certificate that claims a rate too."""
    fastest = lyapunov_on(positivity, rate="max")
    if not fastest:
        return LyapunovCertificate.settle(**fastest.data() | {"required_rate": rate})
    found = by_vector(positivity, exactly(fastest, "v"), required_rate=rate)
    if found:
        return found
    if fastest.slow_direction is not None and fastest.decay_rate_bound < rate:
        witness = SlowDirection(exactly(fastest, "slow_direction"), rate=fastest.decay_rate_bound)
        return LyapunovCertificate.settle(positivity=positivity, required_rate=rate, witness=witness)
    faster, vector = decide_rate(positivity.A, positivity.X, positivity.discrete, rate)
    if vector is None:
        return LyapunovCertificate.settle(positivity=positivity, required_rate=rate)
    if faster:
        return by_vector(positivity, _scaled(vector), required_rate=rate)
    witness = SlowDirection(_scaled(vector), rate=rate)
    return LyapunovCertificate.settle(positivity=positivity, required_rate=rate, witness=witness)


def _is_lyapunov(v: Matrix, p: PositivityCertificate) -> bool:
    return all_hold(
        [
            Condition(_POSITIVE, BilinearForms(v, None, p.X.exact_rays), ">"),
            Condition(_DECREASING, drift_forms(v, p.A, p.X.exact_rays, p.discrete), "<"),
        ]
    )
