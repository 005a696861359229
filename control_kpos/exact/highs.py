"""HiGHS itself: one scaled program in, what it answered out.

A module of its own because `import highspy` takes a twentieth of what this package adds to `import control`: the first
program loads it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import highspy
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Outcome: TypeAlias = Literal["optimal", "infeasible", "unbounded", "failed"]
Vector: TypeAlias = NDArray[np.float64]

_OUTCOMES: dict[Any, Outcome] = {
    highspy.HighsModelStatus.kOptimal: "optimal",
    highspy.HighsModelStatus.kInfeasible: "infeasible",
    highspy.HighsModelStatus.kUnbounded: "unbounded",
    highspy.HighsModelStatus.kUnboundedOrInfeasible: "infeasible",
}


@dataclass(frozen=True)
class ScaledProgram:
    """minimise cost'x   subject to   lower <= matrix x <= upper,   box[0] <= x <= box[1]."""

    cost: Vector
    matrix: sp.csr_array
    lower: Vector
    upper: Vector
    box: tuple[Vector, Vector]


class _QuietHighs(highspy.Highs):
    """HiGHS prints two lines from C when it is first asked for anything, and its constructor registers callbacks."""

    def enableCallbacks(self) -> None:
        """Register callbacks with the output switched off."""
        self.setOptionValue("output_flag", False)
        super().enableCallbacks()


def run(
    program: ScaledProgram, options: dict[str, Any], presolve: bool, time_limit: float
) -> tuple[Outcome, Vector, NDArray[np.intp] | None, str]:
    """Outcome, point, basic variables (None where the method has no basis) and why it failed.

    Without presolve, and with it after all if the outcome is not "optimal".
    """
    begun = time.monotonic()
    solver = _QuietHighs()
    limit = {"time_limit": float(max(time_limit, 1e-3))} if np.isfinite(time_limit) else {}
    for name, value in {**options, **limit, "threads": 1, "presolve": "choose" if presolve else "off"}.items():
        solver.setOptionValue(name, value)
    n, m, matrix = program.cost.size, program.lower.size, program.matrix
    # as arrays: an HighsLp copies its vectors number by number through Python
    passed = solver.passModel(
        n,
        m,
        matrix.nnz,
        int(highspy.MatrixFormat.kRowwise),
        int(highspy.ObjSense.kMinimize),
        0.0,
        program.cost,
        *program.box,
        program.lower,
        program.upper,
        matrix.indptr.astype(np.int32),
        matrix.indices.astype(np.int32),
        matrix.data,
        np.zeros(n, dtype=np.int32),
    )
    if passed == highspy.HighsStatus.kError:
        return "failed", np.empty(0), None, "HiGHS refused the program"
    if solver.run() == highspy.HighsStatus.kError:
        # one pool of threads serves the whole process, and another caller of HiGHS has chosen its size
        solver.setOptionValue("threads", 0)
        solver.run()
    status = solver.getModelStatus()
    if not presolve and status != highspy.HighsModelStatus.kOptimal:
        return run(program, options, True, time_limit - (time.monotonic() - begun))
    outcome = _OUTCOMES.get(status, "failed")
    if outcome == "infeasible" and not m:
        outcome = "unbounded"
    if outcome != "optimal":
        return outcome, np.empty(0), None, f"HiGHS: {solver.modelStatusToString(status)}"
    x = np.asarray(solver.getSolution().col_value, dtype=float)
    if options.get("solver") == "ipm":
        return outcome, x, None, ""
    _, basic = solver.getBasicVariables()  # type: ignore[attr-defined]
    basic = np.asarray(basic, dtype=np.intp)
    return outcome, x, np.where(basic >= 0, basic, n - 1 - basic), ""
