"""What is proven of an optimal control with linear cost: a policy, and the optimal cost from both sides.

Under the assumptions of `problem`, for every x in X,

    D_c(upper)'x <= 0  for the policy c   =>   the policy costs at most upper'x, and nobody pays more than that;
    D(lower)'x >= 0                       =>   every policy costs at least lower'x.

The first holds because upper'x falls by the stage cost at least.  The second needs a cost that vanishes at x = 0 only:
a policy of finite cost then drives x to 0.  The closed loop of the policy is exponentially stable without a discount,
because upper'x falls and upper lies in X*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...cards import raised
from ...cones import Cone
from ...errors import DataError
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.signs import BilinearForms
from ...proof.certificate import Certificate, Status, Vector, exactly
from ...proof.encoding import register_record
from ...proof.weights import ProofOmittedError
from .problem import CONTROL, COSTS, DISTURBANCE, KEPT, LIMITS, Index, LinearCost


@register_record
@dataclass(frozen=True, eq=False)
class GrowingCost:
    """A vector d in X* for which d'x does not fall under any policy: from x with d'x > 0 nothing leads to 0.

    Attributes
    ----------
    d : ndarray, shape (n,)
    """

    d: Vector = Vector(required=True)

    def __str__(self) -> str:
        return "a vector d in the dual of X for which d'x does not fall under any admissible input"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalCostCertificate(Certificate):
    """Proof of a policy with linear cost and of the optimal cost from both sides, or that no cost is finite.

    Attributes
    ----------
    A, B, s, r, limits : Matrix
        x' = A x + B mu, stage cost s'x + r'mu, limits l_g'x.
    X : Cone
    discrete : bool
    owner, kinds : tuple of int
        The block of every column of B, and what kind it is, see `design.optimal.problem`.
    discount : Fraction
    policy : tuple of int, of length m
        mu_i = policy_i l_g'x.
    lower, upper : ndarray, shape (n,)
        Proven: lower'x <= optimal cost from x <= cost of the policy <= upper'x for all x in X.
    witness : GrowingCost
        For REFUTED: no policy has a finite cost from inside X.
    """

    claim: ClassVar[str] = "optimal cost"
    no_margin: ClassVar[frozenset[str]] = frozenset({LIMITS, KEPT, COSTS, "upper'x >= 0", "D(upper)'x <= 0"})

    A: Matrix
    B: Matrix
    X: Cone
    discrete: bool
    s: Matrix
    r: Matrix
    limits: Matrix
    owner: tuple[int, ...]
    kinds: tuple[int, ...]
    discount: Fraction
    policy: tuple[int, ...] | None = None
    lower: Vector = Vector()
    upper: Vector = Vector()

    @cached_property
    def _problem(self) -> LinearCost:
        owner, kinds = _whole(self.owner, "owner"), _whole(self.kinds, "kinds")
        given = self.A, self.B, self.X, self.discrete, self.s, self.r, self.limits
        problem = LinearCost(*given, owner, kinds, self.discount)
        _require_sound(problem)
        return problem

    def conditions(self) -> Sequence[Condition]:
        """The assumptions, and the two inequalities."""
        problem, policy = self._problem, _whole(self.policy or (), "policy")
        if not problem.is_policy(policy):
            raise DataError("a policy takes for every control -1, 0 or 1, and at most one column of every group.")
        lower, upper = (exactly(self, name)[None] for name in ("lower", "upper"))
        return [
            *problem.assumptions(),
            Condition("upper'x >= 0", BilinearForms(upper, None, self.X.exact_rays), ">="),
            Condition("D(upper)'x <= 0", problem.residual(upper, policy), "<="),
            Condition("D(lower)'x >= 0", problem.residual(lower), ">="),
        ]

    def refutation(self) -> Sequence[Condition] | None:
        """The assumptions, and a vector along which nothing falls."""
        if not isinstance(self.witness, GrowingCost) or any(
            x is not None for x in (self.policy, self.lower, self.upper)
        ):
            return None
        return [*self._problem.assumptions(), *self._problem.growing(exactly(self.witness, "d")[None])]

    def evidence(self) -> dict[str, Any]:
        """Nothing: the inequalities are in the data.  On cones that are not simplicial the facets are missing."""
        if not self.X.is_simplicial:
            raise ProofOmittedError("invariance under all inputs needs the facets of X; it is for control_kpos alone")
        return {}

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.lower is None:
            return Status.UNDECIDED, self._problem.assumptions()
        return super()._evaluate()

    def explain(self) -> str:
        """What is proven, in words."""
        disturbed = DISTURBANCE in self.kinds
        if isinstance(self.refuted_by, GrowingCost):
            worst = " against the worst disturbance" if disturbed else ""
            return (
                f"Refuted: no admissible input has a finite cost from inside X{worst}. There is {self.witness}{worst}. "
                "Widen the limits, or act on other states."
            )
        if not self:
            return "Undecided: the policy and the bounds of its cost are not proven."
        every, worst = (" against every admissible disturbance", " against the worst one") if disturbed else ("", "")
        stable = "" if self._is_discounted else " Its closed loop is exponentially stable."
        return (
            f"Proved: for every x in X the policy costs at most upper'x{every}, and no policy costs less than "
            f"lower'x{worst}; the two differ by at most {raised(self._gap())} of the upper one.{stable}"
        )

    @property
    def gap(self) -> float:
        """The largest (upper - lower)'x / upper'x on X, rounded up; inf where upper'x = 0, NaN without bounds."""
        if self.lower is None or self.upper is None:
            return float("nan")
        found = self._gap()
        return float(raised(found, 9)) if isinstance(found, Fraction) else found

    def _gap(self) -> Fraction | float:
        """The same, exactly."""
        rays = self.X.exact_rays.plain().fractions()
        low, high = (rays @ exactly(self, name).fractions() for name in ("lower", "upper"))
        if any(b <= 0 for b in high):
            return float("inf")
        return max(Fraction(0), *((b - a) / b for a, b in zip(low, high, strict=True)))

    @property
    def _is_discounted(self) -> bool:
        return self.discount != int(self.discrete)


def certificate_of(problem: LinearCost, **more: Any) -> OptimalCostCertificate:
    """The certificate about a problem, with a policy and bounds, or a witness."""
    data = {f.name: getattr(problem, f.name) for f in fields(problem)}
    blocks = {name: tuple(data[name].tolist()) for name in ("owner", "kinds")}
    return OptimalCostCertificate.settle(**data | blocks, **more)


def _whole(values: Any, name: str) -> Index:
    """Whole numbers as an array."""
    if not isinstance(values, tuple) or not all(type(value) is int for value in values):
        raise DataError(f"{name} must be a tuple of whole numbers.")
    return np.array(values, dtype=np.intp)


def _require_sound(problem: LinearCost) -> None:
    """Refuse owners, kinds and a discount that are none."""
    kinds, owner, n, m = problem.kinds, problem.owner, problem.A.shape[0], problem.B.shape[1]
    alone = np.bincount(owner, minlength=len(kinds)) if len(owner) and owner.min() >= 0 else np.zeros(len(kinds))
    single = (kinds == CONTROL) | (kinds == DISTURBANCE)
    shapes = problem.s.shape == (1, n) and problem.r.shape == (1, m) and problem.limits.shape == (len(kinds), n)
    if not shapes or owner.shape != (m,) or len(alone) != len(kinds) or (alone < 1).any() or (alone[single] != 1).any():
        raise DataError("costs, limits and blocks must fit A and B, and every control and disturbance has one column.")
    if type(problem.discrete) is not bool or not isinstance(problem.discount, Fraction):
        raise DataError("discrete is true or false, and the discount a fraction.")
    if not np.isin(kinds, range(4)).all():
        raise DataError("kinds of blocks are numbers from 0 to 3.")
    if np.any(problem.r.fractions()[0, kinds[owner] == DISTURBANCE] != 0):
        raise DataError("a disturbance has no cost.")
    if not (0 < problem.discount <= 1 if problem.discrete else problem.discount >= 0):
        raise DataError(
            "a discount is a factor in (0, 1] in discrete time and a rate that is not negative in continuous."
        )
