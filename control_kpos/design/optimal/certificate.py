"""What is proven of an optimal control with linear cost: a policy, and the optimal cost from both sides.

Under the assumptions of `problem`, for every x in X,

    D_c(upper)'x <= 0  for the policy c   =>   the policy costs at most upper'x, and nobody pays more than that;
    D(lower)'x >= 0                       =>   every policy costs at least lower'x.

The first holds because upper'x falls by the stage cost at least.  The second needs a cost that vanishes at x = 0 only:
a policy of finite cost then drives x to 0.  The closed loop of the policy is exponentially stable without a discount,
because upper'x falls and upper lies in X*.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any, ClassVar, TypeVar

import numpy as np

from ...cards import raised
from ...cones.product import ProductCone
from ...errors import DataError
from ...exact.condition import Condition, residuals
from ...exact.matrix import Matrix
from ...exact.signs import BilinearForms
from ...proof.certificate import Certificate, Status, Vector, exactly
from ...proof.encoding import register_record, require_kinds
from ...proof.weights import ProofOmittedError
from .network_problem import PUSHES, NetworkCost
from .problem import ABOVE, ADMITTED, BLOCKS, CONTROL, COSTS, DISTURBANCE, INSIDE, KEPT, LIMITS, Index, LinearCost

# Squared dimension times generators times facets of a cone above which files leave out the proof.
_FACETS = 10**6

C = TypeVar("C", bound="ClaimOnCost")


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
class ClaimOnCost(Certificate):
    """A claim about an optimal control problem with linear cost, which files hold by the names of its parts.

    Attributes
    ----------
    problem : LinearCost
    """

    problem: LinearCost

    def __post_init__(self) -> None:
        _require_sound(self.problem)
        super().__post_init__()

    def _assumptions(self) -> Sequence[Condition]:
        return vars(self).get("_known") or self._premises()

    def _premises(self) -> Sequence[Condition]:
        return self.problem.assumptions()

    @property
    @abstractmethod
    def _bounds(self) -> tuple[Matrix, Matrix]:
        """The bounds of the optimal cost, each a row."""

    def evidence(self) -> dict[str, Any]:
        """Nothing: the inequalities are in the data, and whoever reads them finds the facets of X."""
        X = self.problem.X
        factors = X.factors if isinstance(X, ProductCone) else (X,)
        if any(not Y.is_simplicial and Y.dim**2 * Y.n_rays * Y.n_facets > _FACETS for Y in factors):
            raise ProofOmittedError("to find all facets of X in fractions would take minutes")
        return {}

    def contents(self) -> dict[str, Any]:
        """The problem by the names of its parts, and the fields."""
        own = {key: value for key, value in self.data().items() if key != "problem"}
        if self.problem.A.shape[0] != self.problem.X.dim or self.problem.B.shape[0] != self.problem.X.dim:
            raise DataError(
                "the closed loop of this network has entries that are no doubles; files cannot hold it yet."
            )
        parts = {f.name: getattr(self.problem, f.name) for f in fields(LinearCost)}
        return {**parts, **own, **{name: tuple(parts[name].tolist()) for name in BLOCKS}, **self._coded()}

    @abstractmethod
    def _coded(self) -> dict[str, Any]:
        """Policies as files hold them."""

    @classmethod
    @abstractmethod
    def _decoded(cls, own: dict[str, Any]) -> dict[str, Any]:
        """The fields but for the problem, with policies as certificates hold them."""

    @classmethod
    def restore(cls: type[C], contents: dict[str, Any]) -> C:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        require_kinds(LinearCost, contents)
        own = dict(contents)
        parts: dict[str, Any] = {f.name: own.pop(f.name) for f in fields(LinearCost)}
        blocks: dict[str, Any] = {name: _whole(parts[name], name) for name in BLOCKS}
        sparse = all(parts[name].is_sparse for name in ("A", "B", "limits"))
        return cls.settle(problem=(NetworkCost if sparse else LinearCost)(**parts | blocks), **cls._decoded(own))

    def _against(self) -> tuple[str, str]:
        """Whom the costs are against, in words."""
        if DISTURBANCE not in self.problem.kinds:
            return "", ""
        return " against every admissible disturbance", " against the worst one"

    def _gap(self) -> Fraction | float:
        """The largest (upper - lower)'x / upper'x on X, exactly; of networks no less."""
        lower, upper = self._bounds
        if isinstance(self.problem, NetworkCost):
            return self.problem.gap(lower.values[0], upper.values[0])
        rays = self.problem.X.exact_rays.plain().fractions()
        low, high = (rays @ bound.fractions()[0] for bound in (lower, upper))
        if any(b <= 0 != b - a for a, b in zip(low, high, strict=True)):
            return float("inf")
        return max(Fraction(0), *((b - a) / (b or 1) for a, b in zip(low, high, strict=True)))

    @property
    def gap(self) -> float:
        """The largest (upper - lower)'x / upper'x on X, rounded up; inf where upper'x <= 0, NaN without bounds."""
        try:
            found = self._gap()
        except DataError:
            return float("nan")
        return float(raised(found, 9)) if isinstance(found, Fraction) else found


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalCostCertificate(ClaimOnCost):
    """Proof of a policy with linear cost and of the optimal cost from both sides, or that no cost is finite.

    Attributes
    ----------
    problem : LinearCost
    policy : ndarray of int, shape (m,)
        mu_i = policy_i l_g'x.
    gain : Matrix, shape (m, n)
        mu = gain x, in the place of a policy: a gain that fulfils further constraints.
    lower, upper : ndarray, shape (n,)
        Proven: lower'x <= optimal cost from x <= cost of the policy or gain <= upper'x for all x in X.
    witness : GrowingCost
        For REFUTED: no policy has a finite cost from inside X.
    """

    claim: ClassVar[str] = "optimal cost"
    no_margin: ClassVar[frozenset[str]] = frozenset({LIMITS, KEPT, COSTS, INSIDE, ABOVE, ADMITTED, *PUSHES})

    policy: Index | None = None
    lower: Vector = Vector()
    upper: Vector = Vector()
    gain: Matrix | None = None

    @property
    def _bounds(self) -> tuple[Matrix, Matrix]:
        return exactly(self, "lower")[None], exactly(self, "upper")[None]

    def conditions(self) -> Sequence[Condition]:
        """The assumptions, and the two inequalities."""
        problem, policy = self.problem, self.policy
        if self.gain is not None:
            return [*self._assumptions(), *self._of_gain(self.gain)]
        if policy is None or not problem.is_policy(policy):
            raise DataError("a policy takes for every control -1, 0 or 1, and at most one column of every group.")
        return [*self._assumptions(), *problem.bracket(*self._bounds, policy)]

    def _of_gain(self, gain: Matrix) -> list[Condition]:
        """The two inequalities for a gain, which is admissible."""
        problem, (lower, upper) = self.problem, self._bounds
        sound = gain.shape == problem.B.shape[::-1] and not gain.is_sparse and np.isfinite(gain.values).all()
        if self.policy is not None or isinstance(problem, NetworkCost) or DISTURBANCE in problem.kinds or not sound:
            raise DataError("a gain stands in the place of a policy, for one system without disturbances.")
        inside = Condition(INSIDE, BilinearForms(upper, None, problem.rays), ">=")
        above = Condition(ABOVE, problem.paid(upper, gain), "<=")
        return [problem.admits(gain), inside, above, *problem.below(lower)]

    def refutation(self) -> Sequence[Condition] | None:
        """The assumptions, and a vector along which nothing falls."""
        if not isinstance(self.witness, GrowingCost) or any(
            x is not None for x in (self.policy, self.lower, self.upper, self.gain)
        ):
            return None
        return [*self._assumptions(), *self.problem.growing(exactly(self.witness, "d")[None])]

    def data(self) -> dict[str, Any]:
        """As of every certificate, without a gain where there is a policy."""
        return {key: x for key, x in super().data().items() if key != "gain" or x is not None}

    def _coded(self) -> dict[str, Any]:
        return {"policy": None if self.policy is None else tuple(self.policy.tolist())}

    @classmethod
    def _decoded(cls, own: dict[str, Any]) -> dict[str, Any]:
        policy = own.get("policy")
        return {**own, "policy": None if policy is None else _whole(policy, "policy")}

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.lower is None:
            return Status.UNDECIDED, self._assumptions()
        return super()._evaluate()

    def explain(self) -> str:
        """What is proven, in words."""
        every, worst = self._against()
        if isinstance(self.refuted_by, GrowingCost):
            worst = " against the worst disturbance" if worst else ""
            return (
                f"Refuted: no admissible input has a finite cost from inside X{worst}. There is {self.witness}{worst}. "
                "Widen the limits, or act on other states."
            )
        if not self:
            return "Undecided: the policy and the bounds of its cost are not proven."
        stable = "" if self._is_discounted else " Its closed loop is exponentially stable."
        if self.gain is not None:
            return (
                "Proved: for every x in X the gain keeps to the limits and costs at most upper'x, and no input within "
                f"the limits costs less than lower'x; the two differ by at most {raised(self._gap())} of the upper one."
                f"{stable} Of gains that meet further constraints nothing else is proven."
            )
        return (
            f"Proved: for every x in X the policy costs at most upper'x{every}, and no policy costs less than "
            f"lower'x{worst}; the two differ by at most {raised(self._gap())} of the upper one.{stable}"
        )

    @property
    def _is_discounted(self) -> bool:
        return self.problem.discount != int(self.problem.discrete)


def settled(kind: type[C], assumptions: Sequence[Condition], **data: Any) -> C:
    """The certificate, for a problem whose assumptions have been evaluated; `check` evaluates them again."""
    draft = kind(**data)
    vars(draft)["_known"] = assumptions
    with np.errstate(all="ignore"):
        status, conditions = draft._evaluate()
    out = kind(**data, status=status, residuals=residuals(conditions))
    vars(out)["_own_conditions"] = conditions
    return out


def _whole(values: Any, name: str) -> Index:
    """Whole numbers as an array."""
    if not isinstance(values, tuple) or not all(type(value) is int for value in values):
        raise DataError(f"{name} must be a tuple of whole numbers.")
    return np.array(values, dtype=np.intp)


def _require_sound(problem: LinearCost) -> None:
    """Refuse owners, kinds and a discount that are none."""
    kinds, owner, n, m = problem.kinds, problem.owner, problem.X.dim, len(problem.owner)
    alone = np.bincount(owner, minlength=len(kinds)) if len(owner) and owner.min() >= 0 else np.zeros(len(kinds))
    single = (kinds == CONTROL) | (kinds == DISTURBANCE)
    shapes = problem.s.shape == (1, n) and problem.r.shape == (1, m) and problem.limits.shape == (len(kinds), n)
    if (
        not (shapes and problem.fits())
        or owner.shape != (m,)
        or len(alone) != len(kinds)
        or (alone < 1).any()
        or (alone[single] != 1).any()
    ):
        raise DataError("costs, limits and blocks must fit A and B, and every control and disturbance has one column.")
    if type(problem.discrete) is not bool or not isinstance(problem.discount, Fraction):
        raise DataError("discrete is true or false, and the discount a fraction.")
    if not np.isin(kinds, range(4)).all():
        raise DataError("kinds of blocks are numbers from 0 to 3.")
    free = problem.r[:, kinds[owner] == DISTURBANCE]
    if not free.is_zero and np.any(free.fractions() != 0):
        raise DataError("a disturbance has no cost.")
    if not (0 < problem.discount <= 1 if problem.discrete else problem.discount >= 0):
        raise DataError(
            "a discount is a factor in (0, 1] in discrete time and a rate that is not negative in continuous."
        )
