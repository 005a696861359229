"""Which solver answers a linear program: HiGHS directly, any solver cvxpy knows, or a callable.

The default calls HiGHS without a modelling layer.  Here answers are checked for shape and finiteness only; the
theorem modules prove them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import SolverError
from ..exact.budget import begin, reason, seconds_left
from ..exact.programs import Solution, failure, guarded, program_effort, solve, vetted

# Operations of the interior point method, for each entry.
_INTERIOR_EFFORT = 3e3

SolverChoice = str | Callable[..., Any] | None


class Programs:
    """The linear programs of one design: one solver for all of them, and a line about each.

    An instance is called like `control_kpos.exact.programs.solve`.

    Parameters
    ----------
    solver : str, callable or None
        None: HiGHS.  A name: that solver through cvxpy.  A callable: f(c, A_ub, b_ub, A_eq, b_eq, bounds)
        that returns x or a `Solution`.
    report : callable, optional
        Called with what is being done, line by line.

    Raises
    ------
    SolverError
        If cvxpy is missing or does not know the solver, or it is not installed.
    """

    def __init__(self, solver: SolverChoice, report: Callable[[str], None] | None = None) -> None:
        if isinstance(solver, str):
            name = installed(solver)
            self._call: Callable[..., Any] | None = lambda *data: _through_cvxpy(name, *data)
        elif solver is None or callable(solver):
            self._call = solver
        else:
            raise SolverError(f"solver is {solver!r}; give the name of a solver, a callable, or None for HiGHS.")
        self._report, self._stage, self._count = report, "", 0

    def on_highs(self) -> Programs:
        """The same with HiGHS, whatever the solver."""
        return Programs(None, self._report)

    def stage(self, name: str) -> None:
        """Say what is being done now; lines about programs start with it."""
        self._stage = name
        if self._report is not None:
            self._report(name)

    def __call__(
        self,
        c: Any,
        A_ub: Any = None,
        b_ub: Any = None,
        A_eq: Any = None,
        b_eq: Any = None,
        bounds: Any = (0.0, np.inf),
        **options: Any,
    ) -> Solution:
        data = (c, A_ub, b_ub, A_eq, b_eq, bounds)
        rows = sum(0 if b is None else np.size(b) for b in (b_ub, b_eq))
        entries = sum(A.nnz if sp.issparse(A) else np.size(A) for A in (A_ub, A_eq) if A is not None)
        interior = options.get("method") == "ipm"
        if not begin(_INTERIOR_EFFORT * entries if interior else program_effort(rows, np.size(c), entries)):
            return failure(f"{reason()} was reached")
        if self._report is not None:
            self._count += 1
            lead = f"{self._stage}: " if self._stage else ""
            self._report(f"{lead}linear program {self._count}, {np.size(c)} variables, {rows} rows")
        call = self._call
        if call is None:
            return solve(*data, **options)
        return vetted(guarded(lambda: call(*data), seconds_left()), np.asarray(c, dtype=float))


def installed(solver: str) -> str:
    """The name of an installed cvxpy solver; SolverError with the list otherwise."""
    import cvxpy as cp  # noqa: PLC0415  (heavy, and needed by few)

    known = cp.installed_solvers()
    if solver.upper() not in known:
        raise SolverError(f"solver {solver!r} is not installed; cvxpy finds {', '.join(known)}.")
    return solver.upper()


def _through_cvxpy(name: str, c: Any, A_ub: Any, b_ub: Any, A_eq: Any, b_eq: Any, bounds: Any) -> Solution:
    import cvxpy as cp  # noqa: PLC0415  (heavy, and needed by few)

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
