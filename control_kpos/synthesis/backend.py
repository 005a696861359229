"""Which solver answers a linear program: HiGHS directly, any solver cvxpy knows, or a callable.

The default calls HiGHS without a modelling layer.  Answers are checked for shape and finiteness here and for
truth by the theorem modules.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import SolverError
from ..linear_programs import Solution, failure, guarded, solve

SolverChoice = str | Callable[..., Any] | None


def backend(solver: SolverChoice, time_limit: float) -> Callable[..., Solution]:
    """A function with the signature of `control_kpos.linear_programs.solve` that keeps one deadline.

    Parameters
    ----------
    solver : str, callable or None
        None: HiGHS.  A name: that solver through cvxpy.  A callable: f(c, A_ub, b_ub, A_eq, b_eq, bounds)
        that returns x or a `Solution`.
    time_limit : float
        Seconds for all programs together.

    Raises
    ------
    SolverError
        If cvxpy is missing or does not know the solver, or it is not installed.
    """
    deadline = time.monotonic() + time_limit
    if isinstance(solver, str):
        name = installed(solver)
        call = lambda *data: _through_cvxpy(name, *data)  # noqa: E731
    elif solver is None:

        def direct(
            c: Any,
            A_ub: Any = None,
            b_ub: Any = None,
            A_eq: Any = None,
            b_eq: Any = None,
            bounds: Any = (0.0, np.inf),
            **more: Any,
        ) -> Solution:
            left = deadline - time.monotonic()
            if left <= 0:
                return failure("the time limit has passed")
            return solve(c, A_ub, b_ub, A_eq, b_eq, bounds, time_limit=left, **more)

        return direct
    elif callable(solver):
        call = solver
    else:
        raise SolverError(f"solver is {solver!r}; give the name of a solver, a callable, or None for HiGHS.")

    def other(
        c: Any,
        A_ub: Any = None,
        b_ub: Any = None,
        A_eq: Any = None,
        b_eq: Any = None,
        bounds: Any = (0.0, np.inf),
        **_: Any,
    ) -> Solution:
        left = deadline - time.monotonic()
        if left <= 0:
            return failure("the time limit has passed")
        answer = guarded(lambda: call(c, A_ub, b_ub, A_eq, b_eq, bounds), left)
        return _vetted(answer, np.asarray(c, dtype=float))

    return other


def installed(solver: str) -> str:
    """The name of an installed cvxpy solver; SolverError with the list otherwise."""
    import cvxpy as cp  # noqa: PLC0415  (heavy, and needed by few)

    known = cp.installed_solvers()
    if solver.upper() not in known:
        raise SolverError(f"solver {solver!r} is not installed; cvxpy finds {', '.join(known)}.")
    return solver.upper()


def _vetted(answer: Any, cost: NDArray[np.float64]) -> Solution:
    """The answer as a `Solution`, "failed" unless it is a finite vector of the right length."""
    if isinstance(answer, str):
        return failure(answer)
    if isinstance(answer, Solution):
        if answer.outcome != "optimal":
            return answer
        answer = answer.x
    if answer is None:
        return Solution("infeasible", np.empty(0), message="the solver found no point")
    try:
        x = np.asarray(answer, dtype=float)
    except (TypeError, ValueError):
        return failure("the solver returned something that is not a vector")
    if x.shape != cost.shape or not np.isfinite(x).all():
        return failure("the solver returned a vector of the wrong length, or numbers that are not finite")
    return Solution("optimal", x, float(cost @ x))


def _through_cvxpy(name: str, c: Any, A_ub: Any, b_ub: Any, A_eq: Any, b_eq: Any, bounds: Any) -> Solution:
    import cvxpy as cp  # noqa: PLC0415

    c = np.asarray(c, dtype=float)
    x = cp.Variable(c.size)
    constraints = []
    for A, b, equal in ((A_ub, b_ub, False), (A_eq, b_eq, True)):
        if A is not None and np.size(b):
            left = sp.csr_array(A) @ x
            constraints.append(left == np.asarray(b) if equal else left <= np.asarray(b))
    for side, lower in zip(bounds, (True, False), strict=True):
        side = np.broadcast_to(np.asarray(side, dtype=float), c.shape)
        held = np.flatnonzero(np.isfinite(side))
        if held.size:
            constraints.append(x[held] >= side[held] if lower else x[held] <= side[held])
    problem = cp.Problem(cp.Minimize(c @ x), constraints)
    problem.solve(solver=name)
    value: Any = x.value
    if problem.status in ("optimal", "optimal_inaccurate"):
        return Solution("optimal", np.asarray(value, dtype=float), float(c @ value))
    outcome = (
        "infeasible" if "infeasible" in problem.status else "unbounded" if "unbounded" in problem.status else "failed"
    )
    return Solution(outcome, np.empty(0), message=f"{name}: {problem.status}")
