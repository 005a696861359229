"""Dwell times: what is proven if every member stays active for a time of at least T.

Let M_s = A_s + a_s I map X into X, so that e^{A_s t} = e^{-a_s t} sum_k (M_s t)^k / k! keeps X.  If v_s in int X* have

    v_s'A_s x < 0    and    v_t'e^{A_s T} x < v_s'x   for t != s

on the generators x, all signals that stay in each mode for T or longer are exponentially stable: v_s'x falls while s is
active, and v_t'x at the switch to t, a time of T or more later, is less than v_s'x was in the beginning.  No
exponential is evaluated: the first line gives v_s'M_s x <= a_s v_s'x, so with z = a_s T, v_t <= c v_s on X and

    sum_{k<=N} v_t'(M_s T)^k x / k!  +  c rest v_s'x  <  e_N v_s'x,     e_N = sum_{k<=N} z^k / k! <= e^z,
    rest = 2 z^(N+1) / (N+1)! >= e^z - e_N                  for 2 z <= N + 2,

implies the second.  From below, in the order of X: e^{A_s t} x >= sum_{k<=N} (M_s t)^k x / k! / (e_N + rest), so that a
cycle of members and times for which the product of the right-hand sides maps some x to x or more does not let it go
to 0.  All numbers are rational, and nothing is rounded.

In discrete time T is a whole number of steps, A_s - I takes the place of A_s in the first line, and the power A_s^T
that of e^{A_s T}: no series is needed, nor any shift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from ..cards import about, floored, raised, shown
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Fractions, Status, Vector, exactly
from ..proof.encoding import register_record
from ..proof.weights import Prover
from ..theorems.decay_rates import drift_forms
from .switching import ClaimOnFamily

# Terms of a series, and steps in discrete time, above which a certificate is refused.
MOST_TERMS = 1000
MOST_STEPS = 1000
Rationals = Any


def partial_exponential(z: Fraction, terms: int) -> tuple[Fraction, Fraction]:
    """e_N = sum_{k<=N} z^k / k! and a bound of what is left of e^z.

    >>> partial_exponential(Fraction(1), 1)
    (Fraction(2, 1), Fraction(1, 1))
    """
    if not 0 <= 2 * z <= terms + 2 or terms > MOST_TERMS:
        raise DataError(f"{terms} terms do not show an exponential of {float(z):g}.")
    total = term = Fraction(1)
    for k in range(1, terms + 1):
        term = term * z / k
        total += term
    return total, 2 * term * z / (terms + 1)


def partial_sum(M: Rationals, t: Fraction, terms: int, x: Rationals) -> Rationals:
    """sum_{k<=N} (M t)^k x / k! for the columns x, in fractions."""
    (m, unit), (y, over) = _integers(M * t), _integers(x)
    start, below = y, 1
    for k in range(terms, 0, -1):  # x + M t / k (what is inside)
        start, below = y * (below * k * unit) + m @ start, below * k * unit
    return start * Fraction(1, below * over)


def power(A: Matrix, steps: int, x: Rationals) -> Rationals:
    """A^steps x for the columns x, in fractions."""
    (m, unit), (y, over) = _integers(A.dense().fractions()), _integers(x)
    for _ in range(steps):
        y = m @ y
    return y * Fraction(1, over * unit**steps)


def _integers(values: Rationals) -> tuple[Rationals, int]:
    """Integers and their common denominator."""
    numerators, factor = Matrix.from_fractions(np.asarray(values, dtype=object)).as_integers()
    factor = Fraction(factor)
    return numerators * factor.numerator, factor.denominator


def shifted(A: Matrix, a: Fraction) -> Rationals:
    """A + a I, in fractions."""
    return A.dense().fractions() + a * np.eye(A.shape[0], dtype=int).astype(object)


@register_record
@dataclass(frozen=True, eq=False)
class DwellCycle:
    """Members with times, again and again, whose product P has P x - x in X for some x in X, x != 0.

    Attributes
    ----------
    x : ndarray, shape (n,)
    modes : tuple of int
        In the order in which they are active.
    times : tuple of Fraction
        How long each of them is active.
    shifts : tuple of Fraction
        a_s of every member of the family: A_s + a_s I maps X into X.  None in discrete time.
    terms : int
        Terms of every series.
    exact : tuple of Fraction, or None
        The exact x where doubles do not suffice.
    """

    x: Vector = Vector(required=True)
    modes: tuple[int, ...] = ()
    times: tuple[Fraction, ...] = ()
    shifts: tuple[Fraction, ...] = ()
    terms: int = 1
    exact: Fractions = Fractions("x")

    def __str__(self) -> str:
        parts = ", ".join(f"{s} for {about(t)}" for s, t in zip(self.modes, self.times, strict=True))
        return f"a cycle of the members {parts} that takes x = {shown(self.x)} to no less"


class ClaimOnExponentials(ClaimOnFamily):
    """A claim about e^{A_s t}, by series; in discrete time about A_s^t."""

    def _kept(self, shifts: Sequence[Fraction]) -> list[Condition]:
        """A_s + a_s I maps X into X."""
        if self.discrete and not shifts:
            return []
        if self.discrete or len(shifts) != len(self.loops) or min(shifts) < 0:
            raise DataError("exponentials are those of continuous time, with a shift that is not negative for each.")
        X = self.X
        forms = (
            BilinearForms(X.exact_facets, Matrix.from_fractions(shifted(loop.A, a)), X.exact_rays)
            for loop, a in zip(self.loops, shifts, strict=True)
        )
        return [Condition(f"h'(A_{s} + a I) x >= 0", form, ">=") for s, form in enumerate(forms)]

    def _steps(self, t: Fraction) -> int:
        """A time as a number of steps."""
        if t.denominator != 1 or not 0 < t <= MOST_STEPS:
            raise DataError(f"in discrete time members are active for whole numbers of steps, up to {MOST_STEPS}.")
        return int(t)

    def _weights(self, shifts: Sequence[Fraction]) -> list[Any]:
        """Weights of (A_s + a_s I) x for the generators x of X."""
        if self.discrete:
            return super().evidence()["P"]
        prover, matrices = Prover(), (shifted(loop.A, a) for loop, a in zip(self.loops, shifts, strict=True))
        return [prover.inclusion(self.X, Matrix.from_fractions(M), self.X) for M in matrices]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DwellCertificate(ClaimOnExponentials):
    """Proof that a family is exponentially stable for every order of its members that dwells for long enough.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance of X under every member.
    vs : Matrix, shape (S, n)
        v_s in int X*: v_s'x falls while s is active.
    dwell_time : Fraction
        T: every member stays active for T or longer; in discrete time for T steps.
    shifts : tuple of Fraction
        a_s: A_s + a_s I maps X into X.  None in discrete time.
    terms : tuple of int
        Terms of the series of every member.  None in discrete time.
    witness : DwellCycle or None
        For REFUTED: a signal whose times are all `dwell_time` or longer and that does not let x go to 0.
    """

    claim: ClassVar[str] = "dwell time"
    no_margin: ClassVar[frozenset[str]] = frozenset({"h'x >= 0", "h'(P x - x) >= 0"})

    dwell_time: Fraction
    vs: Matrix | None = None
    shifts: tuple[Fraction, ...] = ()
    terms: tuple[int, ...] = ()

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.dwell_time <= 0:
            raise DataError("a dwell time is positive.")
        if self.discrete:
            self._steps(self.dwell_time)
        return super()._evaluate()

    def conditions(self) -> list[Condition]:
        """The inequalities of every member and every pair of them."""
        vs, count, X = self.vs, len(self.loops), self.X
        if vs is None or vs.shape != (count, X.dim) or len(self.terms) != (0 if self.discrete else count):
            raise DataError("every member has a vector, and in continuous time a number of terms.")
        out = [*self._kept(self.shifts), Condition("v_s'x > 0", BilinearForms(vs, None, X.exact_rays), ">")]
        for s, loop in enumerate(self.loops):
            row = vs[np.array([s])]
            out.append(Condition(f"v_{s}'A_{s} x < 0", drift_forms(row, loop.A, X.exact_rays, self.discrete), "<"))
        if any(c.verdict() is not True for c in out):
            return out
        return out + [self._switched(s) for s in range(count) if count > 1]

    def _switched(self, s: int) -> Condition:
        """sum_k v_t'(M T)^k x / k! + c rest v_s'x - e_N v_s'x for all t and x, scaled."""
        v, rays = self._fractions(), self.X.exact_rays.plain().fractions()
        others, A = np.delete(v, s, axis=0), self.loops[s].A
        if self.discrete:
            done, rest, sums = Fraction(1), Fraction(0), power(A.T, int(self.dwell_time), others.T)
        else:
            done, rest = partial_exponential(self.shifts[s] * self.dwell_time, self.terms[s])
            sums = partial_sum(shifted(A, self.shifts[s]).T, self.dwell_time, self.terms[s], others.T)
        own, values = rays @ v[s], others @ rays.T
        most = np.array([max(row / own) for row in values], dtype=object)
        excess = (sums.T @ rays.T + (rest * most)[:, None] * own - done * own) / (done * own)
        forms = BilinearForms(Matrix.from_fractions(excess), None, Matrix.identity(len(rays)))
        return Condition(f"v_t'e^(A_{s} T) x < v_{s}'x", forms, "<")

    def _fractions(self) -> Rationals:
        return np.empty((0, 0), dtype=object) if self.vs is None else self.vs.fractions()

    def refutation(self) -> list[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        if not isinstance(w, DwellCycle) or self.vs is not None or self.shifts or self.terms:
            return None
        if not all(loop.status is Status.PROVED for loop in self.loops):
            return None
        row, facets, kept = exactly(w, "x")[None], self.X.exact_facets, self._kept(w.shifts)
        if not all(c.verdict() is True for c in kept):
            return kept
        moved = self._around(w)
        moved = Matrix.from_fractions(moved[None] / max(1, *map(abs, moved)))
        return [
            *kept,
            self._long_enough(w),
            Condition("x is not 0", BilinearForms(row, None, row), ">"),
            Condition("h'x >= 0", BilinearForms(row, None, facets), ">="),
            Condition("h'(P x - x) >= 0", BilinearForms(moved, None, facets), ">="),
        ]

    def _long_enough(self, w: DwellCycle) -> Condition:
        short = min(w.times) < self.dwell_time
        sign, one = Matrix(np.array([[-1.0 if short else 1.0]])), Matrix.identity(1)
        return Condition("times >= dwell_time", BilinearForms(sign, None, one), ">=")

    def _around(self, w: DwellCycle) -> Rationals:
        """What is proven of P x from below, minus x."""
        count, modes = len(self.loops), w.modes
        if not modes or len(modes) != len(w.times) or not all(0 <= s < count for s in modes) or w.terms < 1:
            raise DataError("a cycle has members of the family, a time for each, and terms.")
        x = out = exactly(w, "x").fractions()
        for s, t in zip(modes, w.times, strict=True):
            if self.discrete:
                out = power(self.loops[s].A, self._steps(t), out[:, None])[:, 0]
                continue
            done, rest = partial_exponential(w.shifts[s] * t, w.terms)
            sums = partial_sum(shifted(self.loops[s].A, w.shifts[s]), t, w.terms, out[:, None])[:, 0]
            out = sums / (done + rest)
        return out - x

    def evidence(self) -> dict[str, Any]:
        """Weights of (A_s + a_s I) x for the generators x of X, and of the vectors of the witness that lie in X."""
        w, prover = self.witness, Prover()
        if not isinstance(w, DwellCycle):
            return {"P": self._weights(self.shifts)}
        x = exactly(w, "x").fractions()
        vectors = {"wx": prover.vector(self.X, x), "wz": prover.vector(self.X, self._around(w))}
        return {"P": self._weights(w.shifts), **vectors}

    def explain(self) -> str:
        """What is proven, in words."""
        time = (floored if self.refuted_by is not None else raised)(self.dwell_time, 6)
        time += (" step" + "s" * (self.dwell_time > 1)) * self.discrete
        if self.refuted_by is not None:
            return (
                f"Refuted: not stable for every order in which each member stays active for {time} or longer: there is "
                f"{self.witness}."
            )
        if self:
            return (
                "Proved exponentially stable for every order in which each of the "
                f"{len(self.loops)} members stays active for {time} or longer: v_s'x falls while member s is active, "
                "and from one switch to the next."
            )
        return "Undecided: stability with this dwell time is not proven."
