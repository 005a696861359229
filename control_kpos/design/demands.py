"""What a user writes in cvxpy on the entries of a gain: constraints, and an objective."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import DataError
from ..exact.budget import begin, reason, seconds_left
from ..exact.programs import guarded, program_effort
from .plant import Floats
from .running import Programs


class Demands:
    """Constraints and an objective on a cvxpy variable F, and programs with them.

    Parameters
    ----------
    shape : tuple of int
        Of F.
    constraints, objective : callable or None
        As in `state_feedback`.
    lp : Programs
        Names the solver.

    Raises
    ------
    DataError
        The callables do not return what cvxpy can use.
    """

    def __init__(self, shape: tuple[int, ...], constraints: Any, objective: Any, lp: Programs) -> None:
        if callable(lp.solver):
            raise DataError("constraints and objective go through cvxpy: give solver as a name, or leave it out.")
        import cvxpy  # noqa: PLC0415  (heavy, and needed by few)

        cp: Any = cvxpy
        self.cp, self.message = cp, ""
        self.options = {} if lp.solver is None else {"solver": lp.solver}
        self.F: Any = cp.Variable(shape)
        try:
            self.own = list(constraints(self.F)) if constraints is not None else []
            cost = self.usual() if objective is None else objective(self.F)
        except (TypeError, ValueError, AttributeError, IndexError) as error:
            raise DataError(
                f"constraints or objective failed on a cvxpy variable of shape {self.F.shape}: {error}."
            ) from None
        if not all(isinstance(c, cp.constraints.constraint.Constraint) for c in self.own):
            raise DataError("constraints must return a list of cvxpy constraints on its argument.")
        self.cost = cp.expressions.expression.Expression.cast_to_const(cost)
        problem = cp.Problem(cp.Minimize(self.cost), self.own)
        if problem.is_mixed_integer():  # solvers of these print, and a few stop in the middle
            raise DataError("constraints and objective must not have integer or boolean variables of their own.")
        if not problem.is_dcp():
            raise DataError("constraints and objective must be convex in F by cvxpy's rules.")

    def usual(self) -> Any:
        """What is minimised without an objective."""
        return 0.0

    def is_met(self, F: Any) -> bool:
        """Whether a gain meets the user's constraints to 1e-6."""
        self.F.value = F
        tolerance = 1e-6 * (1 + np.abs(F).max())
        return all(_violation(c) <= tolerance for c in self.own)

    def cheapest(self, cost: Any, rows: list[Any], size: tuple[int, int]) -> Floats | None:
        """The gain of least cost under the user's constraints and further ones; `message` says why there is none.

        Parameters
        ----------
        size : tuple of int
            Rows and variables of the program, for the budget.
        """
        problem = self.cp.Problem(self.cp.Minimize(cost), [*self.own, *rows])
        self.message = f"{reason()} was reached"
        if not begin(program_effort(*size)):
            return None
        self.message = guarded(lambda: _status(problem, self.options), seconds_left())
        if self.message not in ("optimal", "optimal_inaccurate"):
            return None
        if np.shape(self.F.value) == self.F.shape and np.isfinite(self.F.value).all():
            return np.array(self.F.value, dtype=float)
        self.message = "the solver called a gain optimal that is no finite matrix"
        return None


def _violation(constraint: Any) -> float:
    return float(np.max(constraint.violation(), initial=0.0))


def _status(problem: Any, options: dict[str, Any]) -> str:
    problem.solve(**options)
    return str(problem.status)
