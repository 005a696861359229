"""Switching that depends on the state and stabilises a family, although its members need not be stable.

Let every A_s keep X, and let some v in int X* and weights w_s >= 0 of sum 1 have

    v'(sum_s w_s A_s) x < 0    (discrete time: v'(sum_s w_s A_s) x < v'x)   on the generators x.

The least of the numbers v'A_s x is at most their mean, so that v'x falls from every x in X under the rule

    s(x) = argmin_s v'A_s x.

Where several members attain the least number, they agree in v'A_s x: whatever is chosen there, also mixtures of them as
in Filippov's solutions, v'x falls at the same speed.  For a given v such weights are necessary too: without them some
x in X, not 0, has v'A_s x >= 0 (>= v'x) for all s, by duality of linear programs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cards import floored
from ..errors import DataError, ShapeError
from ..exact.condition import Condition
from ..exact.intake import dimensions, exact_matrix
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Fractions, Vector, exactly
from ..theorems.decay_rates import at_rate
from ..theorems.positivity import PositivityCertificate, state_positivity
from ..theorems.stability import lyapunov_on
from .arguments import Family
from .growth import combined, steepest
from .switching import ClaimOnFamily

# States up to which a rule is sought.
_STATES = 60


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StabilisingCertificate(ClaimOnFamily):
    """Proof that the rule s(x) = argmin_s v'A_s x makes v'x fall from every x in X.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance of X under every member.
    v : ndarray, shape (n,)
        v'x > 0 on X without 0.
    weights : tuple of Fraction
        w_s >= 0 of sum 1: v'x falls in the mixture of the members with these weights.
    decay_rate : float
        Proven of the rule: v'x falls at least like exp(-decay_rate t), in discrete time like (1 - decay_rate)^k.
    v_exact : tuple of Fraction, or None
        The exact v where doubles do not suffice.
    """

    claim: ClassVar[str] = "stabilising switching"
    no_margin: ClassVar[frozenset[str]] = frozenset({"v'(sum w A) x + rate v'x <= 0"})

    v: Vector = Vector()
    weights: tuple[Fraction, ...] = ()
    decay_rate: float = 0.0
    v_exact: Fractions = Fractions("v")

    def conditions(self) -> list[Condition]:
        """The inequalities on v."""
        v, rays, lam = exactly(self, "v")[None], self.X.exact_rays, self.weights
        if len(lam) != len(self.loops) or min(lam) < 0 or sum(lam) != 1:
            raise DataError("weights are not negative, have the sum 1, and there is one for every member.")
        if not 0 <= self.decay_rate < np.inf:
            raise DataError("decay_rate must not be negative.")
        eye = Matrix.identity(self.X.dim, sparse=self.loops[0].A.is_sparse)
        terms = [(a, loop.A) for a, loop in zip(lam, self.loops, strict=True) if a]
        rows = [v if a == 1 else Matrix.from_fractions(v.fractions() * a) for a, _ in terms]
        blocks = [A for _, A in terms]
        if self.discrete:
            rows, blocks = [*rows, v], [*blocks, -eye]
        row, block = at_rate(v, self.decay_rate, eye)
        out = [
            Condition("v'x > 0", BilinearForms(v, None, rays), ">"),
            Condition("v'(sum w A) x < 0", _summed(rows, blocks, rays), "<"),
        ]
        if self.decay_rate:
            falls = _summed([*rows, row], [*blocks, block], rays)
            out.append(Condition("v'(sum w A) x + rate v'x <= 0", falls, "<="))
        return out

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def rule(self, x: ArrayLike) -> Any:
        """The member s(x) = argmin_s v'A_s x, in floating point; the first one of several.

        Parameters
        ----------
        x : array_like, shape (n,) or (k, n)
            States in X.

        Returns
        -------
        int, or ndarray of int, shape (k,)

        Raises
        ------
        DataError, ShapeError
            Not finite and real, or not of n states.

        Notes
        -----
        Costs S n multiplications for every x.
        """
        many = dimensions(x) == 2
        states = exact_matrix(x, "x", ndim=2 if many else 1).dense().values
        if states.shape[-1] != self.X.dim:
            raise ShapeError(f"x has {states.shape[-1]} states; it must have {self.X.dim}.")
        chosen = np.argmin(states @ self._speeds.T, axis=-1)
        return chosen if many else int(chosen)

    @cached_property
    def _speeds(self) -> NDArray[np.float64]:
        """v'A_s, one a row."""
        return np.array([np.asarray(loop.A.values.T @ self.v) for loop in self.loops])

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: the rule is not proven to make v'x fall."
        law = f"(1 - {floored(self.decay_rate)})^k" if self.discrete else f"exp(-{floored(self.decay_rate)} t)"
        return (
            "Proved: the rule that takes the member s with the least v'A_s x keeps X, and makes v'x fall at least like "
            f"{law} from every x in X."
        )


def _summed(rows: list[Matrix], blocks: list[Matrix], rays: Matrix) -> BilinearForms:
    return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), rays)


def stabilising(family: Family, loops: tuple[PositivityCertificate, ...]) -> StabilisingCertificate | None:
    """A rule that stabilises the family, or None where none is found.

    Parameters
    ----------
    family : Family
    loops : tuple of PositivityCertificate
    """
    for weights, mixed in _slow_mixtures(family):
        proof = lyapunov_on(state_positivity(mixed, family.X, discrete=family.discrete))
        if proof:
            return StabilisingCertificate.settle(
                loops=loops, v=exactly(proof, "v"), weights=weights, decay_rate=proof.decay_rate
            )
    return None


def _slow_mixtures(family: Family) -> Iterator[tuple[tuple[Fraction, ...], Matrix]]:
    """Weights of mixtures with a small growth rate, and the mixtures."""
    if family.X.dim <= _STATES and len(family.matrices) > 1:
        yield from combined(family.matrices, steepest(family.matrices, -1))
