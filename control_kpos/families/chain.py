"""Mean stability of a family whose members follow each other at random, by a Markov chain.

Let every A_i keep X, and the jumps J_ij map X into X.  With x_i = E(x; the mode is i) in X the means obey

    x_j' = A_j x_j + q_jj x_j + sum_i q_ij J_ij x_i     (x_j[k+1] = sum_i p_ij J_ij A_i x_i[k]),

a system L on X^M: q_ij is the rate from i to j, p_ij the probability; at a change of mode from i to j, x becomes
J_ij x, in discrete time after A_i was applied.  By Theorem 2 on X^M the means go to 0 exponentially if and only if some
v_i in int X* have

    (A_i'v_i + q_ii v_i + sum_j q_ij J_ij'v_j)'x < 0    (sum_j p_ij v_j'J_ij A_i x < v_i'x)

on the generators x; if not, some x_i in X, not all 0, are mapped by L (L - I) into X.  The expectation of v_i'x, i
being the mode, falls, and with it that of |x|, for x(0) in X, and so for every x(0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any, ClassVar

import numpy as np

from ..cards import floored, raised, shown_rows
from ..cones.polyhedral import has_open_facets
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Integers, Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, ClaimWithRate, Status
from ..proof.encoding import register_record
from ..proof.weights import Prover, product
from ..theorems.decay_rates import Rate, at_rate
from ..theorems.generator_coordinates import sparse_integers
from ..theorems.positivity import PositivityCertificate
from .common_vector import is_alike
from .switching import ClaimOnFamily

Scaled = tuple[Integers, Fraction]


@register_record
@dataclass(frozen=True, eq=False)
class MeanDirection:
    """x_i in X, not all 0, that the system of the means maps into X: L x + rate x in X (L x - x + rate x).

    Attributes
    ----------
    vectors : Matrix, shape (M, n)
        The x_i, one a row.
    rate : float or Fraction
        0: the means do not go to 0; otherwise less than a rate that was asked for.
    """

    vectors: Matrix
    rate: Rate = 0.0

    def __str__(self) -> str:
        return f"means x_i in X, {shown_rows(np.asarray(self.vectors.dense().values))}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MeanStabilityCertificate(ClaimOnFamily, ClaimWithRate):
    """Proof that the mean of x goes to 0 exponentially when a Markov chain switches; or that it does not.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance of X under every member.
    chain : Matrix, shape (M, M)
        Rates q_ij from i to j, rows of sum 0; in discrete time probabilities p_ij, rows of sum 1.
    jumps : tuple of PositivityCertificate
        J_ij maps X into X.
    between : tuple of int
        i and j for every jump, one pair after the other; without a jump J_ij is the identity.
    vs : Matrix, shape (M, n)
        v_i in int X*: the expectation of v_i'x, i being the mode, falls.
    decay_rate : float
        Proven: it falls at least like exp(-decay_rate t), in discrete time like (1 - decay_rate)^k.
    required_rate : Fraction or None
        The same for the rate that was asked for, exactly as given.
    witness : MeanDirection or None
        Means that do not go to 0, or not at the rate that was asked for.
    """

    claim: ClassVar[str] = "mean stable"

    chain: Matrix
    jumps: tuple[PositivityCertificate, ...] = ()
    between: tuple[int, ...] = ()
    vs: Matrix | None = None
    decay_rate: float = 0.0

    def parts(self) -> tuple[Certificate, ...]:
        """Proofs that this one rests on."""
        return (*self.loops, *self.jumps)

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        count, pairs = len(self.loops), self._pairs()
        if self.chain.shape != (count, count):
            raise DataError(f"a chain of {count} members has {count} rows and columns.")
        q = self.chain.dense().fractions()
        if any(sum(row) != int(self.discrete) for row in q) or min(self._rates(q), default=0) < 0:
            raise DataError("rows of a chain sum to 0, of probabilities to 1; rates between members are not negative.")
        if len(self.jumps) != len(pairs) or len(self.between) != 2 * len(pairs):
            raise DataError("every jump is between two different members, and at most one from one to another.")
        if any(not is_alike(jump, self.X, True) for jump in self.jumps):
            raise DataError("jumps map X into X.")
        return super()._evaluate()

    def _rates(self, q: Any) -> list[Fraction]:
        """The entries of the chain that are rates or probabilities."""
        return [a for i, row in enumerate(q) for j, a in enumerate(row) if i != j or self.discrete]

    def _pairs(self) -> dict[tuple[int, int], Matrix]:
        """The jumps, by the members that they are between."""
        every = range(len(self.loops))
        named = zip(zip(self.between[::2], self.between[1::2], strict=False), self.jumps, strict=False)
        return {(i, j): jump.A for (i, j), jump in named if i in every and j in every and i != j}

    def conditions(self) -> list[Condition]:
        """The inequalities of every member."""
        vs, X = self.vs, self.X
        if vs is None or vs.shape != (len(self.loops), X.dim):
            raise DataError("every member has a vector.")
        out = [Condition("v_i'x > 0", BilinearForms(vs, None, X.exact_rays), ">")]
        rates = {name: vars(self)[name] for name in ("decay_rate", "required_rate") if vars(self)[name]}
        for i, (v, ahead) in enumerate(zip(_single(vs), self._ahead(vs), strict=True)):
            out.append(Condition(f"(L'v)_{i}'x < 0", self._drift(i, v, ahead), "<"))
            for name, rate in rates.items():
                out.append(Condition(f"(L'v)_{i}'x + {name} v_{i}'x <= 0", self._drift(i, v, ahead, rate), "<="))
        return out

    @property
    def margin(self) -> float:  # type: ignore[override]
        """Scale-free: how far the vectors lie inside the dual of X and fall; a rate may be met with equality."""
        if self.witness is not None:
            return 0.0 - abs(min((c.margin for c in self._own_conditions if "L x" in c.name), default=0.0))
        return min((c.margin for c in self._own_conditions if c.relation != "<="), default=0.0)

    def _ahead(self, vs: Matrix) -> list[Matrix]:
        """w_i = sum_j q_ij J_ij'v_j, with q_ii, exactly."""
        q, pairs, rows = self.chain.dense().fractions(), self._pairs(), _rows(vs)
        return [
            _sum([_times(row[j], _moved(pairs.get((i, j)), v, True)) for j, v in enumerate(rows)])
            for i, row in enumerate(q)
        ]

    def _drift(self, i: int, v: Matrix, ahead: Matrix, rate: Rate = 0.0) -> BilinearForms:
        """v_i'A_i x + w_i'x (w_i'A_i x - v_i'x) + rate v_i'x."""
        A, w = self.loops[i].A, ahead[None]
        eye = Matrix.identity(self.X.dim, sparse=A.is_sparse)
        rows, blocks = ([w, v], [A, -eye]) if self.discrete else ([v, w], [A, eye])
        if rate:
            row, block = at_rate(v, rate, eye)
            rows, blocks = [*rows, row], [*blocks, block]
        return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), self.X.exact_rays)

    def refutation(self) -> list[Condition] | None:
        """The inequalities on the witness."""
        w, count, X = self.witness, len(self.loops), self.X
        if not isinstance(w, MeanDirection) or self.vs is not None or has_open_facets(X):
            return None
        if not w.rate >= 0:
            raise DataError("the rate of a witness is not negative.")
        slow = self.required_rate is not None and w.rate < self.required_rate
        if w.vectors.shape != (count, X.dim) or not (w.rate == 0 or slow) or not self._is_kept():
            return None
        xs = Matrix.join(_single(w.vectors), -1)
        return [
            Condition("x is not 0", BilinearForms(xs, None, xs), ">"),
            Condition("h'x_i >= 0", BilinearForms(w.vectors, None, X.exact_facets), ">="),
            *(Condition(f"h'(L x)_{j} >= 0", self._grown(w, j, y), ">=") for j, y in enumerate(self._arriving(w))),
        ]

    def _is_kept(self) -> bool:
        """True if all members and jumps keep X."""
        return all(part.status is Status.PROVED for part in self.parts())

    def _arriving(self, w: MeanDirection) -> list[Matrix]:
        """y_j = sum_i q_ij J_ij x_i, with q_jj (sum_i p_ij J_ij A_i x_i), exactly."""
        q, pairs, rows = self.chain.dense().fractions(), self._pairs(), _rows(w.vectors)
        if self.discrete:
            rows = [_moved(loop.A, x) for loop, x in zip(self.loops, rows, strict=True)]
        return [
            _sum([_times(a, _moved(pairs.get((i, j)), x)) for i, (a, x) in enumerate(zip(q[:, j], rows, strict=True))])
            for j in range(len(rows))
        ]

    def _grown(self, w: MeanDirection, j: int, arriving: Matrix) -> BilinearForms:
        """h'A_j x_j + h'y_j (h'y_j - h'x_j) + rate h'x_j."""
        A, x, y = self.loops[j].A, w.vectors[np.array([j])], arriving[None]
        eye = Matrix.identity(self.X.dim, sparse=A.is_sparse)
        rows, blocks = [x, y], [-eye if self.discrete else A.T, eye]
        if w.rate:
            row, block = at_rate(x, w.rate, eye)
            rows, blocks = [*rows, row], [*blocks, block]
        return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), self.X.exact_facets)

    def _image(self, w: MeanDirection) -> list[Any]:
        """(L x)_j + rate x_j ((L x)_j - x_j + rate x_j), in fractions."""
        shift, out = Fraction(w.rate) - int(self.discrete), []
        for loop, x, y in zip(self.loops, w.vectors.dense().fractions(), self._arriving(w), strict=True):
            out.append(y.fractions() + shift * x + (0 if self.discrete else product(loop.A, x)))
        return out

    def contents(self) -> dict[str, Any]:
        """The members, their cone and time, the chain, the jumps and the fields."""
        out = super().contents()
        if self.jumps:
            out["jumps"] = tuple(jump.A for jump in self.jumps)
        return {name: x for name, x in out.items() if name != "decay_rate" or self.vs is not None}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> MeanStabilityCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        X, given = contents["X"], contents.get("jumps") or ()
        if not all(isinstance(J, Matrix) for J in given):
            raise DataError("jumps are matrices.")
        jumps = tuple(PositivityCertificate.settle(A=J, X=X, discrete=True) for J in given)
        return super().restore({**contents, "jumps": jumps, "between": contents.get("between") or ()})

    def evidence(self) -> dict[str, Any]:
        """Weights of A_i x and J_ij x for the generators of X; of a witness also those of x_i and (L x)_i in X."""
        prover, X, w = Prover(), self.X, self.witness
        out = {**super().evidence(), "N": [prover.inclusion(X, jump.A, X) for jump in self.jumps]}
        if not isinstance(w, MeanDirection):
            return out
        vectors = {"wx": w.vectors.dense().fractions(), "wz": self._image(w)}
        return {**out, **{name: [prover.vector(X, row) for row in rows] for name, rows in vectors.items()}}

    def explain(self) -> str:
        """What is proven, in words."""
        w = self.refuted_by
        if w is not None and w.rate:
            return (
                f"Refuted: the mean of x does not go to 0 at the rate {self._asked(raised)}: from {w}, it falls at a "
                f"rate of at most {raised(w.rate)}."
            )
        if w is not None:
            return f"Refuted: not mean stable: from {w}, the mean of x does not go to 0."
        if self:
            rate = floored(self.decay_rate) if self.required_rate is None else self._asked(floored)
            law = f"(1 - {rate})^k" if self.discrete else f"exp(-{rate} t)"
            return (
                f"Proved mean stable: the expectation of |x| goes to 0 at least as {law}, whatever x(0) and the first "
                "mode, because that of v_i'x, i being the mode, does so on X."
            )
        return "Undecided: neither mean stability nor a direction in which the mean does not go to 0 is proven."


def _single(M: Matrix) -> list[Matrix]:
    """The rows, each as a matrix."""
    return [M[np.array([i])] for i in range(M.shape[0])]


def _rows(M: Matrix) -> list[Scaled]:
    """The rows as integers times a number."""
    integers, factor = M.dense().as_integers()
    return [(row, Fraction(factor)) for row in integers]


def _moved(J: Matrix | None, x: Scaled, transposed: bool = False) -> Scaled:
    """J x, or J'x; x for None."""
    if J is None:
        return x
    S, factor = sparse_integers(J)
    return (S.T if transposed else S).apply(x[0]), factor * x[1]


def _times(a: Fraction, x: Scaled) -> Scaled:
    return x[0], Fraction(a) * x[1]


def _sum(parts: list[Scaled]) -> Matrix:
    """The sum, exactly."""
    used = [(x, factor) for x, factor in parts if factor]
    below = lcm(*(factor.denominator for _, factor in used))
    total = sum((x * (f.numerator * (below // f.denominator)) for x, f in used), start=0 * parts[0][0])
    return Matrix.over(np.asarray(total, dtype=object), below)
