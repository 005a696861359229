"""State delays as a certificate: x' = A x + sum_k A_k x(t - h_k), or why it is not positive or not stable.

Let A be cross-positive on X and every A_k map X into X: then the state stays in X whatever the delays h_k(t) >= 0 are.
(The delayed terms are inputs in X; and where the delays are constant, positive and different, an initial function that
is 0 but near one of the times 0, -h_k shows that this is necessary.)  With S = A + sum A_k,

    stable for one choice of delays  <=>  for all bounded delays, also in time  <=>  v'S x_i < 0 for some v in int X*.

Such a v is a Lyapunov functional for constant delays: V = v'x(t) + sum_k v'A_k (integral of x over [t - h_k, t]) has
V' = v'S x(t).  For delays that change in time take any e in int X with S e in -int X, which exists as well, and c > 0
with A e + b sum A_k e + c e in -X, b = e^{c h}, for the largest delay h: z(t) = e^{-ct} e has z' >= A z + sum A_k z(t -
h_k(t)) in the order of X, so that -z <= x <= z from some initial function on: |x(t)|_e <= e^{-ct} max |x(s)|_e over the
initial function, in the gauge norm of e.

*Rate.*  v'(A + b sum A_k) x_i + c v'x_i < 0 with b >= e^{c h} proves the rate c for all delays of at most h: by the
same steps such an e exists, and for constant delays the functional v'x + sum_k (integral of e^{c(s + h_k - t)} v'A_k x)
falls like e^{-ct}.

*Not stable.*  If x in X, x != 0, has S x in X, the solution that starts with x at all times t <= 0 has x(t) - x in X
for ever, because x(t) - x obeys the same equation with the input S x and starts at 0.  So no choice of delays is
stable, constant or not.

In discrete time, x[k+1] = A x[k] + sum_k A_k x[k - h_k]: A maps X into X as well, S - I takes the place of S, and
v'(A + b sum A_k) x_i < (1 - c) v'x_i with b >= (1 - c)^{-h}.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from ..cards import floored
from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Fractions, Status, Vector, exactly
from ..proof.encoding import register_record
from ..proof.inclusion import PlaneViolation, PositivityViolation
from ..proof.weights import Prover, crossed_facet, drift, product
from ..theorems.decay_rates import Rate, at_rate
from ..theorems.growing_direction import InstabilityDirection
from ..theorems.positivity import PositivityCertificate
from .common_vector import is_alike
from .dwell import partial_exponential

_DECREASING, _RATE, _FACTOR = "v'S x < 0", "v'(A + b sum A_k) x + rate v'x < 0", "b >= growth within the delay"


@register_record
@dataclass(frozen=True, eq=False)
class FailingTerm:
    """The matrix that breaks positivity, and where.

    Attributes
    ----------
    term : int
        0 for A, k for the k-th delayed matrix.
    violation : PositivityViolation
        A facet and a generator.
    """

    term: int = 0
    violation: Any = None

    def __str__(self) -> str:
        what = f"A_{self.term}" if self.term else "A"
        return f"{self.violation}".replace("A X in X", f"{what} X in X")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DelayCertificate(Certificate):
    """Proof that x' = A x + sum A_k x(t - h_k) is positive and exponentially stable for any delays, or why it is not.

    Attributes
    ----------
    own : PositivityCertificate
        A is cross-positive on X (discrete time: maps X into X).
    delayed : tuple of PositivityCertificate
        A_k maps X into X.
    v : ndarray, shape (n,), or None
        v'x is positive on X without 0, and v'(A + sum A_k) x negative (discrete time: less than v'x).
    max_delay : Fraction or None
        The longest delay for which a rate is claimed; None: none is.
    rate : float or None
        For delays of at most `max_delay` the state decays at this rate.
    factor : Fraction or None
        b >= e^(rate max_delay); in discrete time b >= (1 - rate)^(-max_delay).
    terms : tuple of int
        How many terms of the exponential series show it; empty in discrete time.
    exact : tuple of Fraction, or None
        The exact v where doubles do not suffice.
    witness : FailingTerm, InstabilityDirection or None
        For REFUTED.
    """

    claim: ClassVar[str] = "delayed"
    no_margin: ClassVar[frozenset[str]] = frozenset({_RATE, _FACTOR})

    own: PositivityCertificate
    delayed: tuple[PositivityCertificate, ...]
    v: Vector = Vector()
    max_delay: Fraction | None = None
    rate: float | None = None
    factor: Fraction | None = None
    terms: tuple[int, ...] = ()
    exact: Fractions = Fractions("v")

    @property
    def X(self) -> Cone:
        """The cone the verdict is about."""
        return self.own.X

    @property
    def discrete(self) -> bool:
        """True for x[k+1] = A x[k] + sum A_k x[k - h_k]."""
        return self.own.discrete

    @property
    def A(self) -> Matrix:
        """The matrix without delay."""
        return self.own.A

    @property
    def A_delay(self) -> tuple[Matrix, ...]:
        """The delayed matrices."""
        return tuple(part.A for part in self.delayed)

    @property
    def decay_rate(self) -> float:
        """Proven for delays of at most `max_delay`, per unit of time of A; NaN where no rate is claimed."""
        return float("nan") if self.rate is None else self.rate

    def parts(self) -> Sequence[Certificate]:
        """Positivity of every matrix."""
        return (self.own, *self.delayed)

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if not self.delayed or not all(is_alike(part, self.X, True) for part in self.delayed):
            raise DataError("there must be a delayed matrix, and each is claimed to map the cone into itself.")
        if any(M.shape != self.A.shape for M in self.A_delay):
            raise DataError("the delayed matrices have not the size of A.")
        if self.witness is None and self.v is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def conditions(self) -> list[Condition]:
        """The inequalities on v, and those of the rate."""
        v, rays = exactly(self, "v")[None], self.X.exact_rays
        out = [
            Condition("v'x > 0", BilinearForms(v, None, rays), ">"),
            Condition(_DECREASING, self._drift(v, rays), "<"),
        ]
        given = (self.rate, self.max_delay, self.factor)
        if all(x is None for x in given) and not self.terms:
            return out
        if self.rate is None or self.max_delay is None or self.factor is None:
            raise DataError("a rate comes with the longest delay and with a factor.")
        if not 0 < self.rate < np.inf:
            raise DataError("a rate is positive and finite.")
        out.append(Condition(_RATE, self._drift(v, rays, self.rate, self.factor), "<"))
        spare = self.factor - growth(Fraction(self.rate), self.max_delay, self.terms, discrete=self.discrete)
        sign = Matrix(np.array([[float((spare > 0) - (spare < 0))]]))
        return [*out, Condition(_FACTOR, BilinearForms(sign, None, Matrix.identity(1)), ">=")]

    def _drift(
        self, row: Matrix, points: Matrix, rate: Rate = 0, factor: Rate = 1, *, transposed: bool = False
    ) -> BilinearForms:
        """row'(A + factor sum A_k) x + rate row'x, with A - I for A in discrete time; nothing is added beforehand."""
        matrices = [M.T if transposed else M for M in (self.A, *self.A_delay)]
        eye = Matrix.identity(self.A.shape[0], sparse=self.A.is_sparse)
        pairs = [(row, matrices[0]), *((_times(row, factor), M) for M in matrices[1:])]
        pairs += [(row, -eye)] * self.discrete + [at_rate(row, rate, eye)] * bool(rate)
        rows, blocks = zip(*pairs, strict=True)
        return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), points)

    def refutation(self) -> list[Condition] | None:
        """The inequalities on the witness."""
        w, claimed = self.witness, (self.v, self.rate, self.max_delay, self.factor, self.terms or None)
        if any(x is not None for x in claimed):
            return None  # a witness says nothing about those
        if isinstance(w, FailingTerm):
            if not 0 <= w.term <= len(self.delayed) or not isinstance(w.violation, PositivityViolation):
                return None
            found = replace(self.parts()[w.term], witness=w.violation).refutation()
            return None if found is None else list(found)
        if not isinstance(w, InstabilityDirection) or not np.any(w.x) or not all(self.parts()):
            return None
        x = exactly(w, "x")[None]
        return [
            Condition("h'x >= 0", BilinearForms(x, None, self.X.exact_facets), ">="),
            Condition("h'S x >= 0", self._drift(x, self.X.exact_facets, transposed=True), ">="),
        ]

    # -- files

    def contents(self) -> dict[str, Any]:
        """The matrices, their cone and time, and the fields."""
        rest = {name: x for name, x in self.data().items() if name not in ("own", "delayed") and x is not None}
        rest = {name: x for name, x in rest.items() if name != "terms" or x}
        w = self.witness
        if isinstance(w, FailingTerm) and isinstance(w.violation, PlaneViolation):
            rest["witness"] = self._by_extreme_ray(w, w.violation)
        return {"A": (self.A, *self.A_delay), "X": self.X, "discrete": self.discrete, **rest}

    def _by_extreme_ray(self, w: FailingTerm, plane: PlaneViolation) -> FailingTerm:
        """The witness at one of the extreme rays, which files hold: what leaves through a plane has one that does."""
        part, rays, h = self.parts()[w.term], self.X.exact_rays.dense(), plane.exact_normal()
        leaves = BilinearForms(h, part.A, rays).signs()[0] == -1  # type: ignore[attr-defined]
        on = BilinearForms(h, None, rays).signs()[0] == 0 if not part.discrete else leaves  # type: ignore[attr-defined]
        found = np.flatnonzero(leaves & on)
        return replace(w, violation=replace(plane, ray=int(found[0]))) if found.size else w

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> DelayCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        rest = dict(contents)
        matrices, X, discrete = (rest.pop(name) for name in ("A", "X", "discrete"))
        if len(matrices) < 2 or not all(isinstance(M, Matrix) for M in matrices):
            raise DataError("there must be a matrix A and a delayed one.")
        own = PositivityCertificate.settle(A=matrices[0], X=X, discrete=discrete)
        delayed = tuple(PositivityCertificate.settle(A=M, X=X, discrete=True) for M in matrices[1:])
        draft = cls(own=own, delayed=delayed, **rest)
        w = draft.witness
        if isinstance(w, FailingTerm) and 0 <= w.term <= len(delayed):
            part = replace(draft.parts()[w.term], witness=w.violation)  # type: ignore[type-var]
            rest["witness"] = replace(w, violation=part.restated())  # type: ignore[attr-defined]
        return cls.settle(own=own, delayed=delayed, **rest)

    def evidence(self) -> dict[str, Any]:
        """Weights of A x and A_k x in X, and those of a witness; or the normal that is crossed."""
        w, prover, X = self.witness, Prover(), self.X
        if isinstance(w, FailingTerm):
            return {} if isinstance(w.violation, PlaneViolation) else crossed_facet(X, w.violation.facet)
        pairs = zip((self.A, *self.A_delay), (not self.discrete, *[False] * len(self.delayed)), strict=True)
        out: dict[str, Any] = {"P": [prover.inclusion(X, M, X, invariance=flow) for M, flow in pairs]}
        if isinstance(w, InstabilityDirection):
            x = exactly(w, "x").fractions()
            moved = drift(self.A, x, self.discrete) + sum(product(M, x) for M in self.A_delay)
            out |= {"wx": prover.vector(X, x), "wz": prover.vector(X, moved)}
        return out

    # -- words

    def explain(self) -> str:
        """What has been proven, and for which delays."""
        kept = "maps X into X" if self.discrete else "keeps X (e^{At} X in X)"
        if isinstance(self.refuted_by, FailingTerm):
            return (
                f"Refuted: not positive on X: {self.witness}. If the delays are constant, positive and different from "
                "each other, X is left from some initial function in X. Choose another cone."
            )
        if self.refuted_by is not None:
            return (
                f"Refuted: X is kept, but no delays make the system stable, constant or not: there is {self.witness} "
                "under the sum of all matrices. A state that was x at all times before stays above x, in the order "
                "of X."
            )
        if not self:
            return (
                "Undecided: neither stability for all delays nor a direction of growth could be proven; the sum of the "
                "matrices may be too close to the edge of stability."
            )
        law = "(1 - {})^k" if self.discrete else "exp(-{} t)"
        rate = (
            f"For delays up to {floored(self.max_delay)} the state decays at least like "
            f"{law.format(floored(self.rate))}."
            if self.rate is not None and self.max_delay is not None
            else "The decay rate depends on the delays; none is claimed. max_delay, the longest one, asks for one."
        )
        return (
            f"Proved: A {kept}, the delayed matrices map X into X, and the system is exponentially stable for all "
            f"bounded delays, also different ones and ones that change in time: v'x falls under the sum of all "
            f"matrices. {rate} Scale-free margin {self.margin:.3g}."
        )


def growth(rate: Fraction, delay: Fraction, terms: tuple[int, ...], *, discrete: bool) -> Fraction:
    """A bound of e^(rate delay) by a series; in discrete time (1 - rate)^(-delay), exactly.

    Raises
    ------
    DataError
        The numbers are no rate and no delay, or too many steps, or the terms are too few.
    """
    if rate <= 0 or delay < 0:
        raise DataError("a rate is positive, and a delay is not negative.")
    if not discrete:
        if len(terms) != 1:
            raise DataError("one series shows the factor.")
        return sum(partial_exponential(rate * delay, terms[0]), Fraction(0))
    if rate >= 1 or delay.denominator != 1 or terms or delay > MOST_STEPS:
        raise DataError("in discrete time a rate is below 1, and a delay is a moderate number of steps, without terms.")
    return (1 - rate) ** -int(delay)


# Steps of a delay in discrete time for which a rate is proven.
MOST_STEPS = 1000


def _times(row: Matrix, factor: Rate) -> Matrix:
    return row if factor == 1 else Matrix.from_fractions(row.fractions() * Fraction(factor))
