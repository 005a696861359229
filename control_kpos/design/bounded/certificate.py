"""Order intervals [0, x_max] = {x in X : x_max - x in X}, and what holds on them.

Let e^{At} keep X.  Then x' = A x + w stays in [0, x_max] for all x(0) in it and all w(t) in [0, w_max] if

    A x_max + w_max in -X       (discrete time: A X in X and A x_max + w_max - x_max in -X),

because x_max - x obeys the same equation with an input in X; w = w_max from x = x_max shows that it is necessary.
If A is Hurwitz (Schur), -A^{-1} maps X into X, so that every such x_max is at least -A^{-1} w_max in the order of X,
and x_min is at most that if A x_min + w_max in X.  f'x <= b on the interval if some g has

    g and g - f in X*,   g'x_max <= b,

for f'x <= g'x <= g'x_max; by duality of linear programs such a g exists whenever the inequality holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from ...cards import raised
from ...cones import Cone
from ...errors import DataError
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.signs import BilinearForms
from ...proof.certificate import Certificate, Fractions, Status, Vector, exactly
from ...proof.encoding import register_record
from ...proof.inclusion import NO_MARGIN
from ...proof.weights import Prover, drift
from ...theorems.decay_rates import drift_forms
from ...theorems.positivity import ClaimOnPositivity

_INSIDE, _KEPT, _LEAST = "h'x_max >= 0", "h'(A x_max + w_max) <= 0", "h'(A x_min + w_max) >= 0"
_COVER, _ABOVE, _BOUND = "g'x >= 0", "(g - f)'x >= 0", "g'x_max - b <= 0"


@register_record
@dataclass(frozen=True, eq=False)
class NoInterval:
    """Some d in X* with A'd in X* and d'w_max > 0: d'(A x + w_max) > 0 for all x in X, so that no x_max exists.

    Attributes
    ----------
    d : ndarray, shape (n,)
    exact : tuple of Fraction, or None
        The exact vector where doubles do not suffice.
    """

    d: Vector = Vector(required=True)
    exact: Fractions = Fractions("d")

    def __str__(self) -> str:
        return "a vector d in the dual of X for which d'x grows under w_max, wherever it starts"


@register_record
@dataclass(frozen=True, eq=False)
class BoundExceeded:
    """A state x in every invariant interval at which a bound does not hold: x <= x_min, and f'x > b.

    Attributes
    ----------
    x : ndarray, shape (n,)
    row : int
        The number of the bound.
    exact : tuple of Fraction, or None
        The exact x where doubles do not suffice.
    """

    x: Vector = Vector(required=True)
    row: int = 0
    exact: Fractions = Fractions("x")

    def __str__(self) -> str:
        return f"a state that lies in every invariant interval and breaks row {self.row} of the constraints"


class ToldAsInterval(Certificate):
    """What a certificate of an interval says, of one system or of a network."""

    rows: Matrix | None
    x_min: Any

    @property
    def gap(self) -> float:
        """The largest h'(x_max - x_min) / h'x_max over the facets h, rounded up; NaN without both, inf beside 0."""
        raise NotImplementedError

    def explain(self) -> str:
        """What is proven, in words."""
        if isinstance(self.refuted_by, NoInterval):
            return f"Refuted: no interval [0, x_max] is invariant under these disturbances: there is {self.witness}."
        if self.refuted_by is not None:
            return (
                f"Refuted: there is {self.witness}, for these disturbances and this X. Raise the bound, or lower w_max."
            )
        if not self:
            return "Undecided: no invariant interval is proven."
        bounds = "" if self.rows is None else " On it f'x <= c for every row of the constraints."
        least = "" if self.x_min is None else f" It is stable, {self._smallest()}."
        return (
            "Proved: from every x in the interval [0, x_max] in the order of X the state stays in it, for all "
            f"disturbances in [0, w_max].{bounds}{least}"
        )

    def _smallest(self) -> str:
        if self.gap == 0:
            return "and every invariant interval contains this one"
        if not self.gap < 1:  # far from a disturbance both ends are rounding
            return "and every invariant interval contains [0, x_min]"
        return f"and every invariant interval contains [0, x_min], which is smaller by at most {raised(self.gap)} of it"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OrderIntervalCertificate(ToldAsInterval, ClaimOnPositivity):
    """Proof that [0, x_max] is left by no trajectory, and that bounds hold on it; or that there is no such interval.

    Attributes
    ----------
    positivity : PositivityCertificate
        Of A on X, with these data.
    w_max : ndarray, shape (n,)
        Disturbances: w and w_max - w in X.
    x_max : ndarray, shape (n,), or None
    lyapunov, x_min : ndarray, shape (n,), or None
        v of v'x, which falls on X, so that A is Hurwitz (Schur); every invariant [0, x] has x - x_min in X.
    rows, bounds : Matrix, shape (k, n), and ndarray, shape (k,), or None
        f'x <= b on the interval.
    covers : Matrix, shape (k, n), or None
        The g that prove these bounds, row by row.
    exact : tuple of tuples of Fraction, or None
        Of w_max, x_max, lyapunov, x_min and bounds, where doubles do not suffice.
    witness : NoInterval, BoundExceeded or None
    """

    claim: ClassVar[str] = "order interval"
    no_margin: ClassVar[frozenset[str]] = NO_MARGIN | {_INSIDE, _KEPT, _LEAST, _COVER, _ABOVE, _BOUND, "h'w_max >= 0"}

    w_max: Vector = Vector(required=True)
    x_max: Vector = Vector()
    lyapunov: Vector = Vector()
    x_min: Vector = Vector()
    rows: Matrix | None = None
    bounds: Vector = Vector()
    covers: Matrix | None = None
    exact: Fractions = Fractions("w_max", "x_max", "lyapunov", "x_min", "bounds")

    @property
    def X(self) -> Cone:
        """The cone the verdict is about."""
        return self.positivity.X

    def conditions(self) -> Sequence[Condition]:
        """The inequalities above, as far as they are claimed."""
        x = exactly(self, "x_max")[None]
        out = [
            self._disturbance(),
            Condition(_INSIDE, BilinearForms(self.X.exact_facets, None, x), ">="),
            Condition(_KEPT, self._moved(x), "<="),
        ]
        if self.x_min is not None:
            out += [*self._stable(), self._least()]
        if self.rows is not None:
            out += self._bounded(x)
        return out

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w, facets, rays = self.witness, self.X.exact_facets, self.X.exact_rays
        if self.x_max is not None or self.covers is not None or self.positivity.status is not Status.PROVED:
            return None
        if isinstance(w, NoInterval):
            d = exactly(w, "d")[None]
            return [
                self._disturbance(),
                Condition("d'x >= 0", BilinearForms(d, None, rays), ">="),
                Condition("d'A x >= 0", drift_forms(d, self.positivity.A, rays, self.positivity.discrete), ">="),
                Condition("d'w_max > 0", BilinearForms(d, None, exactly(self, "w_max")[None]), ">"),
            ]
        if not isinstance(w, BoundExceeded) or self.x_min is None or self.rows is None:
            return None
        (rows, bounds), (x, least) = self._limits(), (exactly(*pair)[None] for pair in ((w, "x"), (self, "x_min")))
        if type(w.row) is not int or w.row < 0:
            raise DataError("the number of a row is not negative.")
        if w.row >= rows.shape[0]:
            return None
        f, b = rows[np.array([w.row])], bounds[np.array([w.row])][None]
        return [
            self._disturbance(),
            *self._stable(),
            self._least(),
            Condition("h'x >= 0", BilinearForms(facets, None, x), ">="),
            Condition(
                "h'(x_min - x) >= 0",
                BilinearForms(facets, _plus_and_minus(self.X.dim).T, Matrix.join([least, x], -1)),
                ">=",
            ),
            Condition("f'x - b > 0", _beyond(f, x, b), ">"),
        ]

    def _disturbance(self) -> Condition:
        w = exactly(self, "w_max")[None]
        return Condition("h'w_max >= 0", BilinearForms(self.X.exact_facets, None, w), ">=")

    def _moved(self, x: Matrix) -> BilinearForms:
        """h'(A x + w_max), with A - I for A in discrete time."""
        A, w, one = self.positivity.A, exactly(self, "w_max")[None].T, Matrix.identity(1)
        parts, vectors = [A, w], [x, one]
        if self.positivity.discrete:
            parts, vectors = [A, -Matrix.identity(self.X.dim, sparse=A.is_sparse), w], [x, x, one]
        return BilinearForms(self.X.exact_facets, Matrix.join(parts, -1), Matrix.join(vectors, -1))

    def _stable(self) -> list[Condition]:
        v, rays = exactly(self, "lyapunov")[None], self.X.exact_rays
        return [
            Condition("v'x > 0", BilinearForms(v, None, rays), ">"),
            Condition("v'A x < 0", drift_forms(v, self.positivity.A, rays, self.positivity.discrete), "<"),
        ]

    def _least(self) -> Condition:
        return Condition(_LEAST, self._moved(exactly(self, "x_min")[None]), ">=")

    def _limits(self) -> tuple[Matrix, Matrix]:
        """The rows f and the numbers b of f'x <= b."""
        rows, bounds = self.rows, exactly(self, "bounds")
        if rows is None or rows.shape != (bounds.shape[0], self.X.dim):
            raise DataError("every bound needs a row of the size of the states.")
        return rows, bounds

    def _bounded(self, x: Matrix) -> list[Condition]:
        (f, b), g, rays = self._limits(), self.covers, self.X.exact_rays
        if g is None or f.shape != g.shape:
            raise DataError("every bound needs a row g of the size of the states.")
        difference = BilinearForms(Matrix.join([g, f], -1), _plus_and_minus(self.X.dim), rays)
        return [
            Condition(_COVER, BilinearForms(g, None, rays), ">="),
            Condition(_ABOVE, difference, ">="),
            Condition(_BOUND, _beyond(g, x, b[None]), "<="),
        ]

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.x_max is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        if (self.rows is None) != (self.bounds is None) or (self.covers is not None and self.rows is None):
            raise DataError("rows have bounds, and without them there is nothing to cover.")
        if (self.lyapunov is None) != (self.x_min is None):
            raise DataError("x_min needs a vector v with v'A x < 0, which stands for nothing else.")
        return super()._evaluate()

    def evidence(self) -> dict[str, Any]:
        """Evidence of positivity, and weights of the vectors that lie in X."""
        A, X, discrete = self.positivity.A, self.X, self.positivity.discrete
        out, prover, w = self.positivity.evidence(), Prover(), exactly(self, "w_max").fractions()
        out["wu"] = prover.vector(X, w)
        if self.x_max is not None:
            x = exactly(self, "x_max").fractions()
            out |= {"wx": prover.vector(X, x), "wz": prover.vector(X, -drift(A, x, discrete) - w)}
        if self.x_min is not None:
            least = exactly(self, "x_min").fractions()
            out["wy"] = prover.vector(X, drift(A, least, discrete) + w)
            if isinstance(self.witness, BoundExceeded):
                x = exactly(self.witness, "x").fractions()
                out |= {"ws": prover.vector(X, x), "wb": prover.vector(X, least - x)}
        return out

    @property
    def gap(self) -> float:
        """The largest h'(x_max - x_min) / h'x_max over the facets h, rounded up; NaN without both, inf beside 0."""
        if self.x_max is None or self.x_min is None:
            return float("nan")
        facets = self.X.exact_facets.plain().fractions()
        high, low = (facets @ exactly(self, name).fractions() for name in ("x_max", "x_min"))
        if any(b == 0 and a != 0 for a, b in zip(low, high, strict=True)):
            return float("inf")
        parts = ((b - a) / b for a, b in zip(low, high, strict=True) if b)
        return float(raised(max([Fraction(0), *parts]), 9))


def _plus_and_minus(n: int) -> Matrix:
    eye = Matrix.identity(n)
    return Matrix.join([eye, -eye], -2)


def _beyond(rows: Matrix, x: Matrix, b: Matrix) -> BilinearForms:
    """f_i'x - b_i for every row, as [f_i', b_i] [x; -1]."""
    return BilinearForms(Matrix.join([rows, b.T], -1), None, Matrix.join([x, -Matrix.identity(1)], -1))
