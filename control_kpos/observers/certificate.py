"""Interval observers: bounds on the state of a plant from its measurements, for all time.

Plant and measurement, with w(t) in [w_lo, w_hi] and |n(t)| <= noise, entry by entry:

    x' = A x + B u + w,    y = C x + n.

For any L and N let T = I - N C, F = T A + L C and K = F N - L.  Then z = T x obeys

    z' = F z + K y + T B u + (T w - K n),    x = z + N (y - n).

Let F keep X.  Two copies with constant inputs in the place of T w - K n,

    z_hi' = F z_hi + K y + T B u + upper,    z_lo' = F z_lo + K y + T B u + lower,

keep z_hi - z and z - z_lo in X if they are there at the start, because on every facet h

    h'upper >= max h'(T w - K n),    h'lower <= min h'(T w - K n)    over all w and n.

Let a_i and a_i - e_i be in X*.  Then z_i <= a_i'z_hi - (a_i - e_i)'z_lo, and z_i >= a_i'z_lo - (a_i - e_i)'z_hi.

The width z_hi - z_lo obeys the same equation with the input upper - lower, whatever y, u, w and n do.  If F is Hurwitz
(v'z > 0, v'F z < 0 on the generators), it tends to a limit below each `spread` with F spread + upper - lower in -X, and
the width of the bounds on x_i to at most (2 a_i - e_i)'spread + 2 |N_i|'noise.  In discrete time x[k+1] = A x[k] + ...
everything holds with F - I in the place of F where growth or decay is meant; X is kept if F X is in X.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.linalg import Rationals
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Fractions, Status, Vector, exactly
from ..proof.inclusion import NO_MARGIN
from ..proof.portable_cones import portable_rows
from ..proof.weights import Prover, drift
from ..theorems.decay_rates import drift_forms
from ..theorems.positivity import ClaimOnPositivity

_UPPER, _LOWER = "h'upper >= h'(T w - K n)", "h'lower <= h'(T w - K n)"
_COVER, _ABOVE = "a'x >= 0", "(a - e)'x >= 0"
_SPREAD, _WIDTH = "h'(F spread + upper - lower) <= 0", "(2 a - e)'spread + 2 |N|'noise <= width"


class ErrorEquation(NamedTuple):
    """T, F and K of the plant and the gains L and N, exactly.

    Attributes
    ----------
    T, F : ndarray of Fraction, shape (n, n)
    K : ndarray of Fraction, shape (n, q)
    """

    T: Rationals
    F: Rationals
    K: Rationals

    @classmethod
    def of(cls, A: Matrix, C: Matrix, L: Matrix, N: Matrix) -> ErrorEquation:
        """For a plant and gains.

        Parameters
        ----------
        A, C : Matrix, shapes (n, n) and (q, n)
        L, N : Matrix, shape (n, q)
        """
        a, c, gain, shift = (M.plain().fractions() for M in (A, C, L, N))
        T = np.eye(len(a), dtype=int).astype(object) - shift @ c
        F = T @ a + gain @ c
        return cls(T, F, F @ shift - gain)

    def pushed(self, X: Cone, w_lo: Rationals, w_hi: Rationals, noise: Rationals) -> tuple[Rationals, Rationals]:
        """The largest and the smallest h'(T w - K n) on every facet h of X.

        Parameters
        ----------
        X : Cone
        w_lo, w_hi, noise : ndarray of Fraction, shapes (n,), (n,), (q,)
        """
        H = portable_rows(X.exact_facets)
        G, around = H @ self.T, np.abs(H @ self.K) @ noise
        most, least = (np.maximum(G * a, G * b).sum(axis=1) for a, b in ((w_hi, w_lo), (-w_hi, -w_lo)))
        return most + around, -(least + around)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class IntervalObserverCertificate(ClaimOnPositivity):
    """Proof that two copies of an observer enclose the state of a plant for all time, and their width in the limit.

    Attributes
    ----------
    positivity : PositivityCertificate
        Of F = (I - N C) A + L C on X.
    plant, output : Matrix, shapes (n, n) and (q, n)
        A and C.
    gain, shift : Matrix, shape (n, q)
        L and N.
    w_lo, w_hi : ndarray, shape (n,)
        Bounds on the disturbance, entry by entry.
    noise : ndarray, shape (q,)
        Bounds on |n|, entry by entry.
    upper, lower : ndarray, shape (n,)
        Constant inputs of the two copies.
    v : ndarray, shape (n,)
        v'z falls under F, so that F is Hurwitz (Schur).
    spread : ndarray, shape (n,)
        In the order of X z_hi - z_lo tends to at most this.
    covers : Matrix, shape (n, n)
        The rows a_i that turn bounds in the order of X into bounds on entries.
    width : ndarray, shape (n,)
        The distance of the bounds on x_i tends to at most this.
    exact : tuple of tuples of Fraction, or None
        Of all these vectors, where doubles do not suffice.
    """

    claim: ClassVar[str] = "interval observer"
    no_margin: ClassVar[frozenset[str]] = NO_MARGIN | {_UPPER, _LOWER, _COVER, _ABOVE, _SPREAD, _WIDTH}

    plant: Matrix
    output: Matrix
    gain: Matrix
    shift: Matrix
    w_lo: Vector = Vector(required=True)
    w_hi: Vector = Vector(required=True)
    noise: Vector = Vector(required=True)
    upper: Vector = Vector(required=True)
    lower: Vector = Vector(required=True)
    v: Vector = Vector(required=True)
    spread: Vector = Vector(required=True)
    width: Vector = Vector(required=True)
    covers: Matrix
    exact: Fractions = Fractions("w_lo", "w_hi", "noise", "upper", "lower", "v", "spread", "width")

    @property
    def X(self) -> Cone:
        """The cone in whose order the copies enclose z."""
        return self.positivity.X

    @property
    def discrete(self) -> bool:
        """True for x[k+1] = A x[k] + B u[k] + w[k]."""
        return self.positivity.discrete

    @cached_property
    def equation(self) -> ErrorEquation:
        """T, F and K, exactly.

        Raises
        ------
        DataError
            The matrices do not fit together, or F is not the matrix that keeps X.
        """
        n, q = self.X.dim, self.output.shape[0]
        shapes = [M.shape for M in (self.plant, self.output, self.gain, self.shift)]
        if any(s != t for s, t in zip(shapes, [(n, n), (q, n), (n, q), (n, q)], strict=True)):
            raise DataError("the plant, its output and the gains have not the sizes of the states and the outputs.")
        found = ErrorEquation.of(self.plant, self.output, self.gain, self.shift)
        if (self.positivity.A.plain().fractions() != found.F).any():
            raise DataError("the matrix that keeps X is not (I - N C) A + L C.")
        return found

    def conditions(self) -> Sequence[Condition]:
        """The inequalities above."""
        v, rays, eye = exactly(self, "v")[None], self.X.exact_rays, Matrix.identity(self.X.dim)
        lo, hi, noise = self._box()
        if self.covers.shape != eye.shape:
            raise DataError("covers are square, a row for each state.")
        H = portable_rows(self.X.exact_facets)
        most, least = self.equation.pushed(self.X, lo, hi, noise)
        above = H @ self._vector("upper") - most, least - H @ self._vector("lower")
        both = Matrix.join([self.covers, eye], -1)
        return [
            Condition("v'x > 0", BilinearForms(v, None, rays), ">"),
            Condition("v'F x < 0", drift_forms(v, self.positivity.A, rays, self.discrete), "<"),
            *(nonnegative(name, part) for name, part in zip((_UPPER, _LOWER), above, strict=True)),
            nonnegative(_SPREAD, H @ self._falling()),
            Condition(_COVER, BilinearForms(self.covers, None, rays), ">="),
            Condition(_ABOVE, BilinearForms(both, Matrix.join([eye, -eye], -2), rays), ">="),
            nonnegative(_WIDTH, self._vector("width") - self.final_width()),
        ]

    def final_width(self) -> Rationals:
        """(2 a_i - e_i)'spread + 2 |N_i|'noise for all i."""
        a, x, n = self.covers.plain().fractions(), self._vector("spread"), self._vector("noise")
        return 2 * (a @ x) - x + 2 * (np.abs(self.shift.plain().fractions()) @ n)

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def _vector(self, name: str) -> Rationals:
        return exactly(self, name).fractions()

    def _box(self) -> tuple[Rationals, Rationals, Rationals]:
        lo, hi, noise = (self._vector(name) for name in ("w_lo", "w_hi", "noise"))
        if lo.shape != hi.shape or (lo > hi).any() or (noise < 0).any() or len(noise) != self.output.shape[0]:
            raise DataError("w_lo <= w_hi and noise >= 0, with one number for each state and each output.")
        return lo, hi, noise

    def _falling(self) -> Rationals:
        """-(F spread + upper - lower), with F - I for F in discrete time."""
        x, upper, lower = (self._vector(name) for name in ("spread", "upper", "lower"))
        return -drift(self.positivity.A, x, self.discrete) - upper + lower

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is not None:
            raise DataError("there is no witness against an observer.")
        return super()._evaluate()

    def evidence(self) -> dict[str, Any]:
        """Evidence of positivity, and weights of -(F spread + upper - lower) in X."""
        return {**self.positivity.evidence(), "wz": Prover().vector(self.X, self._falling())}

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: no enclosure of the state is proven."
        time = "steps" if self.discrete else "time"
        return (
            "Proved: from every enclosure of the first state the two copies of the observer enclose the state for all "
            f"{time}, for all disturbances and noise within their bounds. The bounds on each state tend to a "
            "distance of at most its entry of `width`, whatever disturbances, noise, inputs and measurements do."
        )


def nonnegative(name: str, values: Rationals) -> Condition:
    """That these numbers are not negative."""
    column = Matrix.from_fractions(values.reshape(-1, 1))
    return Condition(name, BilinearForms(Matrix(np.ones((1, 1))), None, column), ">=")
