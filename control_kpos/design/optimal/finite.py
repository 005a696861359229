"""What is proven of an optimal control over finitely many steps: a policy for every step, and the cost from both sides.

Let T(p) = D(p) + p with D of `problem`, T_c(p) the same for a policy c, and lower_N = upper_N = terminal.  If every
admissible input keeps X, then for every x in X

    upper_k - T_c(upper_{k+1}) in X*  for the policies c = c_k  =>  these policies cost at most upper_0'x,
    T(lower_{k+1}) - lower_k in X*                              =>  all inputs cost at least lower_0'x.

Both by induction from the last step: the steps from k on cost at most (least) upper_k'x (lower_k'x) for all x in X,
because the next state is in X.  No sign of the costs is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...cards import raised
from ...errors import DataError
from ...exact.condition import Condition, Evaluated, all_hold
from ...exact.matrix import Matrix
from .certificate import ClaimOnCost
from .problem import COSTS, Index, LinearCost


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FiniteCostCertificate(ClaimOnCost):
    """Proof of policies for N steps with linear cost, and of the optimal cost of these steps from both sides.

    Attributes
    ----------
    problem : LinearCost
    policies : ndarray of int, shape (N, m)
        mu_i = policies[k, i] l_g'x in step k.
    terminal : Matrix, shape (1, n)
        What the state after the last step costs.
    lower, upper : Matrix, shape (N, n)
        Proven: lower[k]'x <= optimal cost of the steps from k on, from x, <= cost of the policies <= upper[k]'x for all
        x in X.
    """

    claim: ClassVar[str] = "finite-horizon cost"
    policies: Index
    terminal: Matrix
    lower: Matrix
    upper: Matrix

    def conditions(self) -> Sequence[Condition]:
        """The assumptions but for that on costs, and two inequalities for every step, up to one that is not proven."""
        problem, policies, (n, shape) = self.problem, self.policies, (self.problem.X.dim, np.shape(self.policies))
        whole = len(shape) == 2 and shape[0] > 0 and all(map(problem.is_policy, policies))
        bounds = self.lower, self.upper, self.terminal
        if not whole or [M.shape for M in bounds] != [(shape[0], n), (shape[0], n), (1, n)]:
            raise DataError("every step has a policy, which takes for every control -1, 0 or 1, and two bounds.")
        if not problem.discrete or not all(np.isfinite(M.values).all() for M in bounds):
            raise DataError("steps are those of discrete time, and their costs are finite.")
        lower, upper = (
            [*(M[k : k + 1] for k in range(len(policies))), self.terminal] for M in (self.lower, self.upper)
        )
        out = list(self._assumptions())
        for k, policy in enumerate(policies):
            # the matrices of one step are as large as the problem: they are let go of before the next one
            out += map(Evaluated.of, problem.above(upper[k + 1], policy, upper[k], f", step {k}"))
            out += map(Evaluated.of, problem.below(lower[k + 1], lower[k], f", step {k}"))
            if not all_hold(out[-2:]):
                break  # that one is open is all that counts
        return out

    def refutation(self) -> None:
        """Nothing: the cost of finitely many steps is finite."""

    def _premises(self) -> Sequence[Condition]:
        return premises(self.problem)

    def _coded(self) -> dict[str, Any]:
        return {"policies": Matrix(np.asarray(self.policies, dtype=float))}

    @classmethod
    def _decoded(cls, own: dict[str, Any]) -> dict[str, Any]:
        policies = own["policies"]
        if not isinstance(policies, Matrix) or policies.is_sparse or not np.isin(policies.values, (-1, 0, 1)).all():
            raise DataError("policies must be a matrix of -1, 0 and 1.")
        return {**own, "policies": policies.values.astype(np.intp)}

    @cached_property
    def margin(self) -> float:
        """0: with the costs as good as known every step holds with equality, however robust the claim is."""
        return 0.0 if self else super().margin

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: the policies of the steps and the bounds of their cost are not proven."
        steps = len(self.policies)
        every, worst = self._against()
        return (
            f"Proved: for every x in X the policies of the {steps} steps cost at most upper[0]'x{every}, and no other "
            f"inputs cost less than lower[0]'x{worst}; {self._apart()}. Stability after the last step is not claimed."
        )

    @property
    def _bounds(self) -> tuple[Matrix, Matrix]:
        return self.lower[:1], self.upper[:1]

    def _apart(self) -> str:
        gap = self._gap()
        if gap == 0:
            return "the two are equal"
        if gap == float("inf"):
            return "how far the two are apart has no relative measure, since some costs are not positive"
        return f"the two differ by at most {raised(gap)} of the upper one"


def premises(problem: LinearCost) -> list[Condition]:
    """The assumptions that finitely many steps need."""
    return [condition for condition in problem.assumptions() if condition.name != COSTS]
