"""What every design runs on: a budget, a solver of linear programs, and a line about each of them.

The default calls HiGHS without a modelling layer.  Answers are checked for shape and finiteness only; the certificates
prove them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp

from ..errors import SolverError
from ..exact.budget import OutOfBudgetError, begin, budget, ended_by, reason, seconds_left
from ..exact.intake import seconds
from ..exact.programs import Solution, failure, guarded, program_effort, solve, vetted
from ..progress import Reporter, Target
from ..proof.answer import Answer
from ..proof.certificate import Status
from .result import DesignResult

# Operations after which a search gives up, where no time limit is given: a nanosecond each, about.  The answer is then
# the same on every machine.
EFFORT = {
    "one system": 6e10,
    "trade-off": 6e11,
    "network": 6e11,
    "a node of a network alone": 1e10,
    "refusal of a whole network": 3e10,
    "a limit": 1e10,
    "a limit of a network": 1e11,
}
# Operations of the interior point method, for each entry.
_INTERIOR_EFFORT = 3e3

SolverChoice = str | Callable[..., Any] | None
A = TypeVar("A", bound=Answer)


def operations(what: str, time_limit: float | None) -> float:
    """Operations for a search of this kind; no bound but the clock if a time limit is given.

    >>> operations("network", None), operations("network", 5.0)
    (600000000000.0, inf)
    """
    return EFFORT[what] if time_limit is None else float("inf")


def within(
    time_limit: float | None,
    design: Callable[[Programs], A],
    what: str = "one system",
    *,
    answer: type[A] = DesignResult,
    solver: SolverChoice = None,
    progress: Target = False,
) -> A:
    """The design; UNDECIDED, with a word about it, if the limit ends it or floating point fails.

    Parameters
    ----------
    time_limit : float or None
        Seconds, as the user gave them.  None: as many operations as `EFFORT` says.
    design : callable
        From the linear programs to the result.  May raise OutOfBudgetError, and LinAlgError where a factorisation
        of doubles does not converge.  Numbers that overflow are candidates without proof, not worth a warning.
    what : str
        Key of `EFFORT`.
    answer : type
        Of the result.
    solver, progress
        As in `state_feedback`.
    """
    time_limit = seconds(time_limit)
    with budget(operations(what, time_limit), time_limit=time_limit), np.errstate(all="ignore"):
        try:
            with Reporter(progress) as report:
                result = design(Programs(solver, report))
        except OutOfBudgetError:
            message = f"{reason()} ended the design, or does not allow its next step."
            return answer(status=Status.UNDECIDED, message=message)
        except np.linalg.LinAlgError as error:
            message = f"floating point fails on these numbers ({error}); choose other units, or a less flat cone."
            return answer(status=Status.UNDECIDED, message=message)
        limit = ended_by()
        if result.status is Status.UNDECIDED and limit and limit not in result.message:
            return replace(result, message=f"{result.message.rstrip('.')}; {limit} ended the design.")
        return result


class Programs:
    """The linear programs of one design: one solver for all of them, and a line about each.

    An instance is called like `control_kpos.exact.programs.solve`.

    Parameters
    ----------
    solver : str, callable or None
        None: HiGHS.  A name: that solver through cvxpy.  A callable: f(c, A_ub, b_ub, A_eq, b_eq, bounds)
        that returns x or a `Solution`.
    report : callable
        Called with what is being done, line by line.

    Raises
    ------
    SolverError
        If cvxpy is missing or does not know the solver, or it is not installed.
    """

    def __init__(self, solver: SolverChoice, report: Callable[[str], None] = lambda _: None) -> None:
        if solver is not None and not isinstance(solver, str) and not callable(solver):
            raise SolverError(f"solver is {solver!r}; give the name of a solver, a callable, or None for HiGHS.")
        self.solver = _installed(solver) if isinstance(solver, str) else solver
        self._report, self._stage, self._count = report, "", 0

    def on_highs(self) -> Programs:
        """The same with HiGHS, whatever the solver."""
        return Programs(None, self._report)

    def stage(self, name: str) -> None:
        """Say what is being done now; lines about programs start with it."""
        self._stage = f"{name}: "
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
        data, solver = (c, A_ub, b_ub, A_eq, b_eq, bounds), self.solver
        rows = sum(0 if b is None else np.size(b) for b in (b_ub, b_eq))
        entries = sum(A.nnz if sp.issparse(A) else np.size(A) for A in (A_ub, A_eq) if A is not None)
        interior = options.get("method") == "ipm"
        if not begin(_INTERIOR_EFFORT * entries if interior else program_effort(rows, np.size(c), entries)):
            return failure(f"{reason()} was reached")
        self._count += 1
        self._report(f"{self._stage}linear program {self._count}, {np.size(c)} variables, {rows} rows")
        if solver is None:
            return solve(*data, **options)
        call = (lambda: solver(*data)) if callable(solver) else lambda: _through_cvxpy(solver, *data)
        return vetted(guarded(call, seconds_left()), np.asarray(c, dtype=float))


def _installed(solver: str) -> str:
    """The name of an installed cvxpy solver; SolverError with the list otherwise."""
    import cvxpy as cp  # noqa: PLC0415  (heavy, and needed by few)

    known = cp.installed_solvers()
    if solver.upper() not in known:
        raise SolverError(f"solver {solver!r} is not installed; cvxpy finds {', '.join(known)}.")
    return solver.upper()


def _through_cvxpy(name: str, c: Any, A_ub: Any, b_ub: Any, A_eq: Any, b_eq: Any, bounds: Any) -> Solution:
    import cvxpy as cp  # noqa: PLC0415  (heavy, and needed by few)

    c = np.asarray(c, dtype=float)
    x = cp.Variable(c.size, bounds=[np.broadcast_to(np.asarray(side, dtype=float), c.shape) for side in bounds])
    rows = [] if A_ub is None else [sp.csr_array(A_ub) @ x <= b_ub]
    rows += [] if A_eq is None else [sp.csr_array(A_eq) @ x == b_eq]
    problem = cp.Problem(cp.Minimize(c @ x), rows)
    problem.solve(solver=name)
    if problem.status in ("optimal", "optimal_inaccurate"):
        return Solution("optimal", np.asarray(x.value, dtype=float))
    status = problem.status
    outcome = "infeasible" if "infeasible" in status else "unbounded" if "unbounded" in status else "failed"
    return Solution(outcome, np.empty(0), message=f"{name}: {status}")
