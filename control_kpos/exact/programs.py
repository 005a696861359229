"""Linear programs in floating point: fast, convenient and untrusted.

    minimise c'x   subject to   A_ub x <= b_ub,   A_eq x = b_eq,   lower <= x <= upper

solved by HiGHS.  Rows and columns are scaled by powers of two first, because HiGHS drops matrix
entries below 1e-9 and takes 1e20 for infinity.  The answer of a solver is a proposal: the theorem modules prove it or
drop it.  The answer "infeasible" counts only once `rational_programs` has found an exact Farkas combination.
"""

from __future__ import annotations

import os
import queue
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar, Literal, TypeAlias, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, SolverError
from .budget import seconds_left
from .rows_to_bounds import rows_to_bounds

T = TypeVar("T")
Outcome: TypeAlias = Literal["optimal", "infeasible", "unbounded", "failed"]

# Of HiGHS's simplex method, on the scaled program; its default is 1e-7, its smallest 1e-10.
_TOLERANCE = 1e-9
# HiGHS's number of the primal simplex method.
_PRIMAL = 4
# Steps after which HiGHS gives up, whatever the clock says: of the simplex method a number and one for each row and
# variable, where two or three are usual, and of the interior point method, where fifty are.
_STEPS, _INTERIOR_STEPS = (10_000, 50), 400


@dataclass(frozen=True)
class Solution:
    """What a solver answered; a claim, not a fact.

    Attributes
    ----------
    outcome : {"optimal", "infeasible", "unbounded", "failed"}
        "failed" covers errors, time limits and answers that are not finite numbers.
    x : ndarray, shape (n,)
        The point found; empty unless the outcome is "optimal".
    value : float
        c'x; NaN unless the outcome is "optimal".
    basic : ndarray of int
        Basic variables, x first and the rows after them; empty where the method has no basis.
    duals : ndarray, shape (k,), or None
        How fast the value grows with the right-hand side of each row, those of A_ub first; None from other solvers.
    message : str
        Why it failed.
    places : mapping
        Where the blocks of a `control_kpos.exact.program.Program` are in x: `solution[name]` reads one.
    """

    outcome: Outcome
    x: NDArray[np.float64]
    value: float = np.nan
    basic: NDArray[np.intp] | None = None
    message: str = ""
    places: Mapping[str, slice] = field(default_factory=dict)
    duals: NDArray[np.float64] | None = None

    def __bool__(self) -> bool:
        return self.outcome == "optimal"

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.x[self.places[name]]


def failure(message: str) -> Solution:
    """A `Solution` without a point."""
    return Solution("failed", np.empty(0), message=message)


def solve(
    c: ArrayLike,
    A_ub: Any = None,
    b_ub: ArrayLike | None = None,
    A_eq: Any = None,
    b_eq: ArrayLike | None = None,
    bounds: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    *,
    method: Literal["simplex", "primal", "ipm"] = "simplex",
    presolve: bool = True,
    time_limit: float = np.inf,
) -> Solution:
    """Solve a linear program with HiGHS after scaling it by powers of two.

    Parameters
    ----------
    c : array_like, shape (n,)
        Cost.
    A_ub, A_eq : array_like or sparse, shape (k, n), optional
        Rows of A_ub x <= b_ub and of A_eq x = b_eq.
    b_ub, b_eq : array_like, shape (k,), optional
        Right-hand sides.
    bounds : pair of array_like, shape (n,) or scalars
        Lower and upper bounds; infinities mean none.  The default is x >= 0.
    method : {"simplex", "primal", "ipm"}
        "primal" is the primal simplex method without presolve: half of the time where a feasible point is next to 0 and
        there are several rows for each variable; the other one after all if the outcome is not "optimal".  "ipm" is
        the interior point method without crossover: for large sparse problems whose solution need not be a vertex.
    presolve : bool
        False: leave out HiGHS's presolve, half of the time where a few hundred rows hold nothing to be simplified but
        rows of one entry, and no basis; with presolve after all if the outcome is not "optimal".
    time_limit : float
        Seconds after which the outcome is "failed", if the search around it does not end earlier.  Kept also if the
        solver does not keep it.

    Returns
    -------
    Solution
        Never raises for a solver's sake.

    Raises
    ------
    ShapeError
        If the sizes do not fit.

    Notes
    -----
    About a millisecond for a few dozen rows; linear in the number of nonzeros up to the solver's work.

    Examples
    --------
    >>> solution = solve([1, 1], A_ub=[[-1, -2]], b_ub=[-2])
    >>> solution.outcome, solution.value
    ('optimal', 1.0)
    """
    cost = np.asarray(c, dtype=float)
    n = cost.size
    kinds = [(A_ub, b_ub, -np.inf), (A_eq, b_eq, None)]
    given = [(_rows(A, n), np.atleast_1d(np.asarray(b, dtype=float)), low) for A, b, low in kinds if A is not None]
    for A, b, _ in given:
        if A.shape[0] != b.size or A.shape[1] != n:
            raise ShapeError(
                f"a constraint matrix is {A.shape[0]} x {A.shape[1]}, but there are {n} variables and {b.size} bounds."
            )
    parts = [A for A, _, _ in given] or [sp.csr_array((0, n))]
    matrix = parts[0] if len(parts) == 1 else sp.csr_array(sp.vstack(parts, format="csr"))
    upper = np.concatenate([b for _, b, _ in given]) if given else np.empty(0)
    lower = (
        np.concatenate([b if low is None else np.full(b.size, low) for _, b, low in given]) if given else np.empty(0)
    )
    box = [np.broadcast_to(np.asarray(side, dtype=float), n) for side in bounds]
    if not all(np.isfinite(data).all() for data in (cost, matrix.data)) or np.isnan(upper).any():
        return failure("the program has entries that are not finite")
    if any(np.isnan(side).any() for side in box):
        return failure("the program has bounds that are not numbers")
    presolve = presolve and method != "primal"
    if not presolve:
        matrix, lower, upper, box = rows_to_bounds(matrix, lower, upper, box)
    if _contradicts_itself(matrix, lower, upper, box):
        return Solution("infeasible", np.empty(0), message="a bound or a row without entries cannot hold")
    if not matrix.data.any():
        return _best_in_box(cost, box[0], box[1], upper.size)
    limit = min(time_limit, seconds_left())
    found = vetted(guarded(lambda: _run_highs(cost, matrix, lower, upper, box, method, presolve, limit), limit), cost)
    return found if presolve else replace(found, basic=None)


def _contradicts_itself(
    matrix: sp.csr_array, lower: NDArray[np.float64], upper: NDArray[np.float64], box: list[NDArray[np.float64]]
) -> bool:
    """True if some bounds exclude every number, or a row without entries excludes 0: HiGHS refuses these, or dies."""
    low, high = box
    empty = matrix.indptr[1:] == matrix.indptr[:-1]
    crossed = (low > high) | (low == np.inf) | (high == -np.inf)
    impossible = (lower == np.inf) | (upper == -np.inf) | (empty & ((lower > 0) | (upper < 0)))
    return bool(crossed.any() or impossible.any())


def _best_in_box(cost: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64], rows: int) -> Solution:
    """The program without entries in its rows, which HiGHS may die of: every variable at its better bound."""
    x = np.where(cost > 0, low, np.where(cost < 0, high, np.clip(0.0, low, high)))
    if not np.isfinite(x).all():
        return Solution("unbounded", np.empty(0), message="nothing limits the cost")
    return Solution("optimal", x, float(cost @ x), duals=np.zeros(rows))


def program_effort(rows: int, columns: int, entries: float | None = None) -> float:
    """Operations that a program takes, about: for those who count them before they call `solve`.

    A few passes over the entries for each row or column, whichever are fewer.

    >>> program_effort(10, 20)
    506000.0
    """
    return 5e5 + 3.0 * min(rows, columns) * (rows * columns if entries is None else entries)


def vetted(answer: Any, cost: NDArray[np.float64]) -> Solution:
    """What a solver returned as a `Solution`, "failed" unless it is one, or a finite vector of the right length.

    Parameters
    ----------
    answer : object
        A `Solution`, a vector, None for "no point", or a sentence of `guarded`.
    cost : ndarray, shape (n,)
    """
    if isinstance(answer, str):
        return failure(answer)
    basic = duals = None
    if isinstance(answer, Solution):
        if answer.outcome != "optimal":
            return answer
        answer, basic, duals = answer.x, answer.basic, answer.duals
    if answer is None:
        return Solution("infeasible", np.empty(0), message="the solver found no point")
    try:
        x = np.asarray(answer, dtype=float)
    except (TypeError, ValueError):
        return failure("the solver returned something that is not a vector")
    if x.shape != cost.shape or not np.isfinite(x).all():
        return failure("the solver returned a vector of the wrong length, or numbers that are not finite")
    return Solution("optimal", x, float(cost @ x), basic, duals=duals)


def guarded(call: Callable[[], T], time_limit: float = np.inf) -> T | str:
    """The result of `call`, or a sentence if it raised or did not return in time.

    With a finite limit the call runs in another thread, which is left behind when the limit passes: solvers do
    not keep their own limits reliably.
    """
    outcome: list[T | str] = []
    passed_on: list[BaseException] = []

    def run() -> None:
        try:
            outcome.append(call())
        except (KeyboardInterrupt, SolverError) as error:
            passed_on.append(error)
        except BaseException as error:  # noqa: BLE001  (a solver may raise anything, MemoryError and SystemExit included)
            outcome.append(f"the solver raised {type(error).__name__}: {error}")

    with warnings.catch_warnings():  # here, so that a call that hangs does not keep its filter
        warnings.simplefilter("ignore")
        if np.isfinite(time_limit):
            _Worker.run_for(max(time_limit, 0.0) + 0.5, run)
        else:
            run()
    for error in passed_on:
        raise error
    return outcome[0] if outcome else f"the solver did not answer within {time_limit:g} s"


class _Worker(threading.Thread):
    """A thread that makes one call after another; one that is late is given up, and ends after its call.

    Kept for the next call because HiGHS sets up memory of its own for every thread, as much work as a small program.
    """

    idle: ClassVar[list[_Worker]] = []

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._calls: queue.SimpleQueue[tuple[Callable[[], None], threading.Event] | None] = queue.SimpleQueue()
        self.start()

    @classmethod
    def run_for(cls, seconds: float, call: Callable[[], None]) -> None:
        """Make the call, and return when it does or when the time has passed."""
        try:
            worker = cls.idle.pop()
        except IndexError:
            worker = cls()
        done = threading.Event()
        worker._calls.put((call, done))
        try:
            done.wait(min(seconds, threading.TIMEOUT_MAX))
        finally:
            if done.is_set():
                cls.idle.append(worker)
            else:
                worker._calls.put(None)

    def run(self) -> None:
        while (task := self._calls.get()) is not None:
            call, done = task
            call()
            done.set()
            del task, call, done  # results do not outlive their caller


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_Worker.idle.clear)  # threads do not survive a fork


def _rows(A: Any, n: int) -> sp.csr_array:
    if sp.issparse(A):
        return sp.csr_array(A, dtype=float)
    dense = np.asarray(A, dtype=float)
    if dense.ndim < 2:
        dense = dense.reshape(-1, n)
    # a ninth of the time of csr_array(dense), which goes through coordinates
    flat, width = dense.ravel(), max(dense.shape[1], 1)
    at = np.flatnonzero(flat != 0)
    indptr = np.searchsorted(at, np.arange(len(dense) + 1) * width)
    return sp.csr_array((flat[at], at % width, indptr), shape=dense.shape)


@dataclass(frozen=True)
class _Highs:
    """HiGHS, what its statuses mean, and a solver of it that is silent."""

    own: Any
    outcomes: Mapping[Any, Outcome]
    quiet: Any


@cache
def _highs() -> _Highs:
    """HiGHS, which the first program loads: `import highspy` takes a tenth of what `import control_kpos` does."""
    import highspy  # noqa: PLC0415  (takes time, and Theorems 1 and 2 need no program)

    class QuietHighs(highspy.Highs):
        """Silent from the start: HiGHS prints two lines when its constructor registers callbacks."""

        def enableCallbacks(self) -> None:
            """Register callbacks with the output switched off."""
            self.setOptionValue("output_flag", False)
            super().enableCallbacks()

    status = highspy.HighsModelStatus
    outcomes: dict[Any, Outcome] = {
        status.kOptimal: "optimal",
        status.kInfeasible: "infeasible",
        status.kUnbounded: "unbounded",
        status.kUnboundedOrInfeasible: "infeasible",
    }
    return _Highs(highspy, outcomes, QuietHighs)


def _run_highs(
    cost: NDArray[np.float64],
    matrix: sp.csr_array,
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    box: list[NDArray[np.float64]],
    method: str,
    presolve: bool,
    time_limit: float,
) -> Solution:
    begun = time.monotonic()
    rows, columns = balance(matrix)
    right = np.concatenate([np.ldexp(upper, rows), *(np.ldexp(side, -columns) for side in box)])
    size = -_exponent(right[np.isfinite(right)])
    objective = np.ldexp(cost, columns)
    price = -_exponent(objective)

    highs = _highs()
    solver = highs.quiet()
    options: dict[str, Any] = {
        "threads": 1,
        "presolve": "choose" if presolve else "off",
        "simplex_iteration_limit": _STEPS[0] + _STEPS[1] * (cost.size + lower.size),
        "ipm_iteration_limit": _INTERIOR_STEPS,
    }
    if method == "primal":
        options |= {"simplex_strategy": _PRIMAL}
    if method != "ipm":
        options |= {"primal_feasibility_tolerance": _TOLERANCE, "dual_feasibility_tolerance": _TOLERANCE}
    if method == "ipm":
        options |= {"solver": "ipm", "run_crossover": "off"}
    if np.isfinite(time_limit):
        options["time_limit"] = float(max(time_limit, 1e-3))
    for name, value in options.items():
        solver.setOptionValue(name, value)
    # as arrays: an HighsLp copies its vectors number by number through Python
    passed = solver.passModel(
        cost.size,
        lower.size,
        matrix.nnz,
        int(highs.own.MatrixFormat.kRowwise),
        int(highs.own.ObjSense.kMinimize),
        0.0,
        np.ldexp(objective, price),
        np.ldexp(box[0], size - columns),
        np.ldexp(box[1], size - columns),
        np.ldexp(lower, rows + size),
        np.ldexp(upper, rows + size),
        matrix.indptr.astype(np.int32),
        matrix.indices.astype(np.int32),
        np.ldexp(matrix.data, np.repeat(rows, np.diff(matrix.indptr)) + columns[matrix.indices]),
        np.zeros(cost.size, dtype=np.int32),
    )
    if passed == highs.own.HighsStatus.kError:
        return failure("HiGHS refused the program")
    if solver.run() == highs.own.HighsStatus.kError:
        # one pool of threads serves the whole process, and another caller of HiGHS has chosen its size
        solver.setOptionValue("threads", 0)
        solver.run()
    if not presolve and solver.getModelStatus() != highs.own.HighsModelStatus.kOptimal:
        left = time_limit - (time.monotonic() - begun)
        return _run_highs(cost, matrix, lower, upper, box, "ipm" if method == "ipm" else "simplex", True, left)
    outcome = highs.outcomes.get(solver.getModelStatus(), "failed")
    if outcome == "infeasible" and not lower.size:
        outcome = "unbounded"
    if outcome != "optimal":
        return Solution(outcome, np.empty(0), message=f"HiGHS: {solver.modelStatusToString(solver.getModelStatus())}")
    found = solver.getSolution()
    x = np.ldexp(np.asarray(found.col_value, dtype=float), columns - size)
    duals = np.ldexp(np.asarray(found.row_dual, dtype=float), rows - price)
    basic = None
    if method != "ipm":
        _, index = solver.getBasicVariables()  # type: ignore[attr-defined]
        index = np.asarray(index, dtype=np.intp)
        basic = np.where(index >= 0, index, cost.size - 1 - index)
    return Solution("optimal", x, basic=basic, duals=duals)


def _exponent(values: NDArray[np.float64]) -> int:
    """e with 2**e about the largest magnitude; 0 for zeros."""
    return int(np.frexp(np.abs(values).max(initial=0.0))[1])


def balance(matrix: sp.csr_array, sweeps: int = 4) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Exponents r, c that bring 2**r_i |a_ij| 2**c_j close to 1: geometric means in turns.

    Parameters
    ----------
    matrix : csr_array, shape (m, n)
    sweeps : int
        Passes over rows and columns.

    Returns
    -------
    rows, columns : ndarray of int32, shapes (m,), (n,)
    """
    m, n = matrix.shape
    row, column, data = np.repeat(np.arange(m), np.diff(matrix.indptr)), matrix.indices, matrix.data
    held = data != 0
    if not held.all():
        row, column, data = row[held], column[held], data[held]
    size = np.frexp(data)[1].astype(float)
    r, c = np.zeros(m), np.zeros(n)
    per_row, per_column = np.maximum(np.bincount(row, minlength=m), 1), np.maximum(np.bincount(column, minlength=n), 1)
    for _ in range(sweeps):
        r = -np.bincount(row, size + c[column], minlength=m) / per_row
        c = -np.bincount(column, size + r[row], minlength=n) / per_column
    return np.rint(r).astype(np.int32), np.rint(c).astype(np.int32)
