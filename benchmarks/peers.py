"""Solvers of others that may take very long, each in a process of its own with a limit on time and memory.

`python peers.py NAME FOLDER` loads the data of a question from FOLDER, answers it with the solver NAME and prints
the seconds that the call took and a number that judges the answer.
"""

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

try:
    import resource
except ImportError:  # not on Windows
    resource = None

MEMORY = 12 * 10**9


@dataclass(frozen=True)
class Outcome:
    """What a peer did.

    Attributes
    ----------
    seconds : float
        Of the call alone; the time limit if it was ended.
    judgement : float
        Largest violation of a linear program, or relative error of a simulation; NaN without an answer.
    remark : str
        "" if it came to an end, else the limit it went over.
    """

    seconds: float
    judgement: float
    remark: str


def ask(name, folder, limit):
    """Run a peer on the data in a folder for at most `limit` seconds, start and loading not counted."""
    command = [sys.executable, str(Path(__file__)), name, str(folder)]
    allowance = 30
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=limit + allowance, check=False)
    except subprocess.TimeoutExpired:
        return Outcome(limit, np.nan, f"over {limit} s")
    if found.returncode < 0 or "MemoryError" in found.stderr:
        return Outcome(limit, np.nan, f"over {MEMORY // 10**9} GB")
    if found.returncode:
        raise RuntimeError(found.stderr)
    seconds, judgement = json.loads(found.stdout.splitlines()[-1])
    return Outcome(seconds, judgement, f"over {limit} s" if seconds > limit else "")


def save(folder, **data):
    """Write sparse matrices and arrays where a peer finds them."""
    for name, value in data.items():
        if sp.issparse(value):
            sp.save_npz(folder / f"{name}.npz", sp.csr_array(value), compressed=False)
        else:
            np.save(folder / f"{name}.npy", value)


def load(folder):
    """The inverse of `save`."""
    found = {path.stem: sp.load_npz(path) for path in folder.glob("*.npz")}
    return found | {path.stem: np.load(path) for path in folder.glob("*.npy")}


# -- linear programs: find z with matrix z <= bound


def highs(matrix, bound):
    import scipy.optimize

    return lambda: (
        scipy.optimize.linprog(np.zeros(matrix.shape[1]), matrix, bound, bounds=(None, None), method="highs").x
    )


def clarabel(matrix, bound):
    import clarabel as package

    settings = package.DefaultSettings()
    settings.verbose = False
    rows, columns = matrix.shape
    program = sp.csc_matrix((columns, columns)), np.zeros(columns), sp.csc_matrix(matrix), bound
    cones = [package.NonnegativeConeT(rows)]
    return lambda: np.array(package.DefaultSolver(*program, cones, settings).solve().x)


def pdlp(matrix, bound):
    from ortools.pdlp import solvers_pb2
    from ortools.pdlp.python import pdlp as package

    program = package.QuadraticProgram()
    program.constraint_matrix = sp.csc_matrix(matrix)
    program.constraint_lower_bounds, program.constraint_upper_bounds = np.full(len(bound), -np.inf), bound
    program.objective_vector = np.zeros(matrix.shape[1])
    program.variable_lower_bounds = np.full(matrix.shape[1], -np.inf)
    program.variable_upper_bounds = np.full(matrix.shape[1], np.inf)
    parameters = solvers_pb2.PrimalDualHybridGradientParams()
    return lambda: np.array(package.primal_dual_hybrid_gradient(program, parameters).primal_solution)


# -- simulations: rows @ x(t) for x' = A x


def bdf(A, x0, times, rows):
    from scipy.integrate import solve_ivp

    options = {"jac": sp.csc_array(A), "rtol": 1e-7, "atol": 1e-10}
    return lambda: rows @ solve_ivp(lambda t, x: A @ x, (0, times[-1]), x0, "BDF", times, **options).y


def expm_multiply(A, x0, times, rows):
    from scipy.sparse.linalg import expm_multiply as multiply

    return lambda: rows @ multiply(A, x0, start=0, stop=times[-1], num=len(times)).T


def main(name, folder):
    """Answer one question and judge the answer."""
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    data = load(Path(folder))
    last = data.pop("last", None)
    call = globals()[name](**data)
    start = time.perf_counter()
    answer = call()
    seconds = time.perf_counter() - start
    if last is None:
        judgement = float((data["matrix"] @ answer - data["bound"]).max())
    else:
        judgement = float(np.abs(answer[:, -1] - last).max() / np.abs(last).max())
    sys.stdout.write(json.dumps([seconds, judgement]) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
