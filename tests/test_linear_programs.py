"""HiGHS behind one function: scaling, outcomes, and solvers that misbehave."""

import os
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

from control_kpos.errors import ShapeError
from control_kpos.exact import programs as linear_programs
from control_kpos.exact.programs import balance, guarded, solve


def random_program(seed):
    rng = np.random.default_rng(seed)
    m, n = rng.integers(1, 12), rng.integers(1, 8)
    A = rng.normal(size=(m, n))
    return rng.normal(size=n), A, A @ rng.uniform(-1, 1, size=n) + rng.uniform(0, 1, size=m)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("method", ["simplex", "ipm"])
def test_agrees_with_linprog(seed, method):
    c, A, b = random_program(seed)
    solution = solve(c, A, b, bounds=(-2.0, 2.0), method=method)
    reference = linprog(c, A_ub=A, b_ub=b, bounds=(-2.0, 2.0))
    assert solution.outcome == "optimal"
    assert solution.value == pytest.approx(reference.fun, abs=1e-6)
    assert (A @ solution.x <= b + 1e-6).all()


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("decades", [10, 60, 200])
def test_scaling_rows_and_columns_changes_nothing(seed, decades):
    rng = np.random.default_rng(seed)
    c, A, b = random_program(seed)
    rows = 2.0 ** rng.integers(-decades, decades, size=len(b))
    columns = 2.0 ** rng.integers(-decades, decades, size=len(c))
    plain = solve(c, A, b, bounds=(-2.0, 2.0))
    scaled = solve(c * columns, A * rows[:, None] * columns, b * rows, bounds=(-2.0 / columns, 2.0 / columns))
    assert scaled.value == pytest.approx(plain.value, rel=1e-6, abs=1e-6)


def test_balance_makes_magnitudes_equal():
    rng = np.random.default_rng(0)
    A = (
        rng.uniform(0.5, 1, size=(6, 5))
        * 10.0 ** rng.integers(-150, 150, size=(6, 1))
        * 10.0 ** rng.integers(-50, 50, size=5)
    )
    r, c = balance(sp.csr_array(A))
    scaled = np.ldexp(A, r[:, None] + c)
    assert scaled.max() / scaled.min() < 32


def test_outcomes():
    assert solve([1.0], [[1.0]], [-1.0]).outcome == "infeasible"
    assert solve([-1.0], [[-1.0]], [0.0]).outcome in ("unbounded", "infeasible")
    assert solve([1.0, 2.0]).value == 0.0
    assert solve([np.nan], [[1.0]], [1.0]).outcome == "failed"
    assert not solve([1.0], [[1.0]], [-1.0])


def test_equations_and_sparse_rows():
    solution = solve([1.0, 3.0], A_eq=sp.csr_array([[1.0, 1.0]]), b_eq=[2.0])
    assert solution.x.tolist() == [2.0, 0.0]
    assert set(solution.basic) == {0}


def test_sizes_are_compared():
    with pytest.raises(ShapeError, match="2 variables"):
        solve([1.0, 2.0], [[1.0, 2.0, 3.0]], [1.0])
    with pytest.raises(ShapeError, match="2 bounds"):
        solve([1.0, 2.0], [[1.0, 2.0]], [1.0, 2.0])


def raising(error):
    def run():
        raise error

    return run


@pytest.mark.parametrize("error", [RuntimeError("no licence"), MemoryError(), SystemExit(1), FloatingPointError()])
@pytest.mark.parametrize("limit", [np.inf, 5.0])
def test_a_solver_that_raises_is_a_sentence(error, limit):
    assert type(error).__name__ in guarded(raising(error), limit)


def test_a_solver_that_hangs_is_left_behind():
    assert "did not answer" in guarded(lambda: time.sleep(5), 0.01)


def test_an_interrupt_passes_through():
    with pytest.raises(KeyboardInterrupt):
        guarded(raising(KeyboardInterrupt()))


def test_a_solver_that_fails_gives_no_point(monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", lambda *_: 1 / 0)
    solution = solve([1.0], [[1.0]], [1.0])
    assert solution.outcome == "failed" and "ZeroDivisionError" in solution.message and solution.x.size == 0


def test_calls_after_a_hang_are_not_disturbed():
    late = []
    assert "did not answer" in guarded(lambda: late.append(time.sleep(1.5)), 0.01)
    assert [guarded(lambda k=k: k, 5.0) for k in range(3)] == [0, 1, 2]


def test_an_interrupt_in_another_thread_passes_through():
    with pytest.raises(KeyboardInterrupt):
        guarded(raising(KeyboardInterrupt()), 5.0)
    assert guarded(lambda: 1, 5.0) == 1


def test_a_call_that_hangs_leaves_warnings_alone():
    guarded(lambda: time.sleep(1), 0.01)
    with pytest.warns(UserWarning, match="heard"):
        warnings.warn("heard", stacklevel=1)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_has_threads_of_its_own():
    assert solve([1.0], [[-1.0]], [-2.0], time_limit=5.0).value == 2.0
    code = "import os, sys; from control_kpos.exact.programs import guarded; guarded(int, 5.0); child = os.fork()\n"
    code += "if child == 0: os._exit(guarded(lambda: 7, 5.0) != 7)\nsys.exit(os.waitpid(child, 0)[1])"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


@pytest.mark.parametrize("seed", range(40))
def test_presolve_changes_no_outcome(seed):
    c, A, b = random_program(seed)
    for right in (b, b - 5.0):
        plain, direct = (solve(c, A, right, bounds=(-2.0, 2.0), presolve=choice) for choice in (True, False))
        assert plain.outcome == direct.outcome
        assert plain.value == pytest.approx(direct.value, abs=1e-6, nan_ok=True)


def test_other_callers_of_highs_in_the_same_process_do_no_harm():
    code = "import highspy; from control_kpos.exact.programs import solve; h = highspy.Highs(); "
    code += "h.setOptionValue('output_flag', False); h.addVar(0.0, 1.0); h.run(); assert solve([1.0], [[-1.0]], [-2.0])"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0
