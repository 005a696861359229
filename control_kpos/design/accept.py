"""From a proposed gain to a certified one.

Solvers propose F in doubles with errors of 1e-9; the closed loop A + B F is formed in rational arithmetic
from the exact data and an F of few digits, and every demand is proven about that F, or F is not returned.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..errors import DataError
from ..exact.budget import OutOfBudgetError, affords, spend
from ..exact.condition import Condition
from ..exact.intake import exact_matrix
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.answer import first_proven
from ..proof.certificate import Certificate
from ..proof.portable_cones import portable_rows
from ..proof.weights import ProofOmittedError, Prover
from ..theorems.positivity import PositivityCertificate, cone_positivity
from ..theorems.stability import LyapunovCertificate, linear_lyapunov
from .plant import Floats, Plant

# Significant decimal digits tried for the gain, fewest first.
_DIGITS = (3, 4, 5, 6, 8, 10, 12, 15)
# Part of the margins of F that a rounding of it must keep.
_KEPT = 0.5
# Operations of a proof, for each entry of the closed loop and for each product of integers in it.
_EFFORT_PER_ENTRY, _EFFORT_PER_PRODUCT = 6e3, 60.0
# The same where signs are found in integers, for n^2.2; margins above which floating point finds them.
_EFFORT_IN_INTEGERS, _CLEAR = 2.5e5, 1e-12


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class GainBoundCertificate(Certificate):
    """Proof that -bound <= F x_k <= bound at every generator of X, input by input.

    Attributes
    ----------
    F : Matrix, shape (m, n)
    bound : ndarray, shape (m,)
    X : Cone
    """

    claim: ClassVar[str] = "gain bound"

    F: Matrix
    bound: Floats
    X: Cone

    def conditions(self) -> list[Condition]:
        """The inequalities that prove the claim."""
        # [F, -b] [x; 1] with the generators as doubles: their length matters here
        rays = np.asarray(self.X.rays, dtype=float)
        right = Matrix(np.hstack([rays, np.ones((len(rays), 1))]))
        F = self.F.fractions()
        b = np.array([[Fraction(v)] for v in np.asarray(self.bound).tolist()], dtype=object)
        upper = Matrix.from_fractions(np.concatenate([F, -b], axis=1))
        lower = Matrix.from_fractions(np.concatenate([F, b], axis=1))
        return [
            Condition("F x - bound <= 0", BilinearForms(upper, None, right), "<="),
            Condition("F x + bound >= 0", BilinearForms(lower, None, right), ">="),
        ]

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def evidence(self) -> dict[str, Any]:
        """Nothing: generators in files have the lengths that they have here."""
        rays = self.X.exact_rays
        if (portable_rows(rays) != Matrix(np.asarray(self.X.rays, dtype=float)).fractions()).any():
            raise ProofOmittedError("bounds at generators that are no doubles are for control_kpos alone")
        return {}

    def explain(self) -> str:
        """What is proven, in words."""
        if self:
            bound = np.array2string(np.asarray(self.bound), precision=4)
            return f"Proved: |F x_k| is at most {bound} at every generator of X."
        return "The gain exceeds its bound at some generator of X."


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FeedbackCertificate(Certificate):
    """Proof that one gain does everything that was asked: all of its parts are proven.

    Attributes
    ----------
    loops : tuple of LyapunovCertificate
        One for each vertex (A_s + B_s F), each with its proof of invariance.
    others : tuple of Certificate
        Gain bound, positivity from input to output, a common vector.
    """

    claim: ClassVar[str] = "feedback"

    loops: tuple[LyapunovCertificate, ...]
    others: tuple[Certificate, ...] = ()

    def parts(self) -> tuple[Certificate, ...]:
        """Proofs that this one rests on."""
        return self.loops + self.others

    def conditions(self) -> list[Condition]:
        """None of its own; raises if there is no closed loop."""
        if not self.loops:
            raise DataError("a feedback without a closed loop proves nothing.")
        return []

    def evidence(self) -> dict[str, Any]:
        """Nothing: every part comes with a proof of its own."""
        return {}

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The smallest margin of the parts."""
        return min(part.margin for part in self.parts())

    @property
    def decay_rate(self) -> float:
        """Proven for every vertex."""
        return min(loop.decay_rate for loop in self.loops)

    @property
    def v(self) -> Floats | None:
        """Lyapunov vector of the (first) closed loop."""
        return self.loops[0].v

    def explain(self) -> str:
        """What is proven, in words."""
        if len(self.loops) == 1:
            return " ".join(part.explain() for part in self.parts())
        slowest = min(self.loops, key=lambda loop: loop.decay_rate)
        rest = " ".join(part.explain() for part in self.others)
        return f"All {len(self.loops)} vertices are proven; the slowest: {slowest.explain()} {rest}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CommonVectorCertificate(Certificate):
    """Proof that one x inside X is mapped inwards by every vertex: stability of the whole convex hull.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance under every vertex.
    x : ndarray, shape (n,)
        Interior to X, with A_s x interior to -X for every s (A_s x - x in discrete time).  Then x (t) stays in
        the shrinking order interval between -c(t) x and c(t) x, for any switching among the vertices.
    """

    claim: ClassVar[str] = "common vector"

    loops: tuple[PositivityCertificate, ...]
    x: Floats

    def parts(self) -> tuple[Certificate, ...]:
        """Proofs that this one rests on."""
        return self.loops

    def conditions(self) -> list[Condition]:
        """The inequalities that prove the claim."""
        x = exact_matrix(self.x, "x")
        X = self.loops[0].X
        if any(loop.X != X or loop.discrete != self.loops[0].discrete for loop in self.loops):
            raise DataError("the vertices must be about one cone, and all in continuous or all in discrete time.")
        out = [Condition("h'x > 0", BilinearForms(X.exact_facets, None, x), ">")]
        for s, loop in enumerate(self.loops):
            A = loop.A
            if loop.discrete:
                A = Matrix.from_fractions(A.fractions() - Matrix.identity(X.dim).fractions())
            out.append(Condition(f"h'A_{s} x < 0", BilinearForms(X.exact_facets, A, x), "<"))
        return out

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def contents(self) -> dict[str, Any]:
        """The dual statement: x is a common Lyapunov vector of the A_s' on X*."""
        first = self.loops[0]
        return {
            "A": tuple(loop.A.T for loop in self.loops),
            "X": first.X.dual,
            "discrete": first.discrete,
            "v": self.x,
        }

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> CommonVectorCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        X, discrete = contents["X"].dual, contents["discrete"]
        loops = tuple(PositivityCertificate.settle(A=A.T, X=X, discrete=discrete) for A in contents["A"])
        return cls.settle(loops=loops, x=contents["v"])

    def evidence(self) -> dict[str, Any]:
        """Weights of A_s'h for the generators h of X*."""
        prover, X = Prover(), self.loops[0].X.dual
        invariance = not self.loops[0].discrete
        return {"P": [prover.inclusion(X, loop.A.T, X, invariance=invariance) for loop in self.loops]}

    def explain(self) -> str:
        """What is proven, in words."""
        if self:
            return (
                f"Proved: one vector x inside X is mapped into the interior of -X by all {len(self.loops)} vertices, "
                "so every system in their convex hull, also switching, is exponentially stable."
            )
        return "The common vector is not proven for every vertex."


@dataclass(frozen=True)
class Accepted:
    """A gain with its proof."""

    F: Floats
    closed: tuple[Matrix, ...]
    certificate: Certificate


def closed_loop(A: Matrix, B: Matrix, F: Floats | NDArray[np.object_]) -> Matrix:
    """A + B F exactly."""
    (a, unit), (b, first), (f, second) = A.as_integers(), B.as_integers(), exact_matrix(F, "F").as_integers()
    own, product = Fraction(unit), Fraction(first) * second
    # integers throughout: sums and products of fractions take ten times as long
    common = lcm(own.denominator, product.denominator)
    left, right = int(own * common), int(product * common)
    return Matrix.from_fractions((a * left + (b @ f) * right) * Fraction(1, common))


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
) -> Accepted | None:
    """The first rounding of F for which every demand is proven, or None.

    Parameters
    ----------
    plant : Plant
    F : ndarray, shape (m, n); with plant.C the K of u = K y, shape (m, q)
    rate : float
        Decay rate to be proven.
    x : ndarray, shape (n,), optional
        Candidate for the common vector of several vertices.
    gain : float
        Roundings whose max |F x_k| exceeds this are passed over.
    """
    F = np.asarray(F, dtype=float)
    shape = (plant.m, plant.n if plant.C is None else plant.C.shape[0])
    if F.shape != shape or not np.isfinite(F).all():
        return None
    if plant.pattern is not None:
        F = np.where(plant.pattern, F, 0.0)
    needed = _needed_slack(plant, F)

    def prove(candidate: Floats) -> Accepted | None:
        margins = slack(plant, candidate)
        if not (margins >= needed).all() or not (candidate is F or plant.gain_of(candidate) <= gain):
            return None
        spend(_effort(plant, margins))
        try:
            return _prove(plant, candidate, rate, x)
        except DataError:  # numbers so large that the closed loop is no double
            return None

    try:
        return first_proven((candidate for candidate in roundings(F) if affords()), prove)
    except OutOfBudgetError:
        return None


def _needed_slack(plant: Plant, F: Floats) -> Floats:
    """Margins that a rounding of F must keep."""
    wanted = slack(plant, F)
    return np.where(wanted > 1e-9, _KEPT * wanted, -1e-11)


def _effort(plant: Plant, margins: Floats) -> float:
    """Operations of one proof, most of them to form A + B F from numbers of any length.

    Where margins are so small that signs have to be found in integers, facets in integers take longer.
    """
    loops = len(plant.A) * (1 if plant.coupling is None else 2)
    forms = plant.n**2 + len(plant.facets) * len(plant.rays) / 50
    effort = _EFFORT_PER_ENTRY * forms + _EFFORT_PER_PRODUCT * plant.n**2 * plant.m
    if plant.X.exact_facets.integer_rows is not None and margins.min(initial=np.inf) < _CLEAR:
        effort += _EFFORT_IN_INTEGERS * plant.n**2.2
    return loops * effort


def _proven_loop(M: Matrix, plant: Plant, rate: float) -> LyapunovCertificate | None:
    """Theorem 2 for one closed loop, with the tightest rate only where the plain one does not do."""
    loop = linear_lyapunov(M, plant.X, discrete=plant.discrete)
    if loop and loop.decay_rate < rate:
        loop = linear_lyapunov(M, plant.X, discrete=plant.discrete, rate="max")
    return loop if loop and loop.decay_rate >= rate else None


def slack(plant: Plant, F: Floats) -> Floats:
    """Relative margins of invariance in floating point, for all vertices."""
    full, out = plant.on_states(F), []
    with np.errstate(all="ignore"):
        for A, B in plant.pairs:
            M = plant.facets @ (A + B @ full) @ plant.rays.T
            size = np.abs(plant.facets) @ (np.abs(A) + np.abs(B) @ np.abs(full)) @ np.abs(plant.rays.T)
            out.append(np.where(size > 0, M / size, 0.0)[plant.incidence])
    return np.concatenate(out)


def _prove(plant: Plant, F: Floats, rate: float, x: Floats | None) -> Accepted | None:
    full = F if plant.C is None else exact_matrix(F, "K").fractions() @ plant.C.fractions()
    closed = tuple(closed_loop(A, B, full) for A, B in zip(plant.A, plant.B, strict=True))
    others: list[Certificate] = []
    if plant.gain_bound is not None:
        bound = GainBoundCertificate.settle(F=exact_matrix(full, "F"), bound=plant.gain_bound, X=plant.X)
        if not bound:
            return None
        others.append(bound)
    if plant.ports:
        sys = plant.system.exact
        B, C, D = sys.matrices[1:]
        out = closed_loop(C, D, full)
        ports = cone_positivity(closed[0], B, out, D, plant.X, sys.U, sys.Y, discrete=plant.discrete)
        if not ports:
            return None
        others.append(ports)
    loops = []
    for M in closed:
        loop = _proven_loop(M, plant, rate)
        if loop is None:
            return None
        loops.append(loop)
    if plant.coupling is not None:
        coupled = [Matrix.from_fractions(M.fractions() + plant.coupling.fractions()) for M in closed]
        for M in coupled:
            loop = _proven_loop(M, plant, rate)
            if loop is None:
                return None
            others.append(loop)
    if len(closed) > 1:
        common = None if x is None else CommonVectorCertificate.settle(loops=tuple(l.positivity for l in loops), x=x)
        if not common:
            return None
        others.append(common)
    certificate = (
        loops[0]
        if len(loops) == 1 and not others
        else FeedbackCertificate.settle(loops=tuple(loops), others=tuple(others))
    )
    return Accepted(F, closed, certificate) if certificate else None
