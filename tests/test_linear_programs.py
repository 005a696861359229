"""HiGHS behind one function: scaling, outcomes, and solvers that misbehave."""

import os
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from control_kpos.errors import ShapeError
from control_kpos.exact import programs as linear_programs
from control_kpos.exact.program import Block, Program, alternative
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


DEGENERATE = {
    "no rows, no cost": (lambda **k: solve([0.0, 0.0], **k), "optimal", [0.0, 0.0]),
    "nothing at all": (lambda **k: solve([], **k), "optimal", []),
    "no rows, a bound each": (
        lambda **k: solve([1.0, -1.0, 0.0], bounds=(-3.0, 5.0), **k),
        "optimal",
        [-3.0, 5.0, 0.0],
    ),
    "no rows, no bound": (lambda **k: solve([-1.0, 1.0], **k), "unbounded", []),
    "no cost, far bounds": (lambda **k: solve([0.0], bounds=(1e300, 1e301), **k), "optimal", [1e300]),
    "rows without entries": (lambda **k: solve([1.0], np.zeros((2, 1)), [1.0, 2.0], **k), "optimal", [0.0]),
    "rows of zeros that are stored": (
        lambda **k: solve([1.0], sp.csr_array(([0.0], ([0], [0])), shape=(1, 1)), [1.0], **k),
        "optimal",
        [0.0],
    ),
    "a row without entries that cannot hold": (
        lambda **k: solve([1.0, 0.0], [[1.0, 1.0], [0.0, 0.0]], [1.0, -1.0], **k),
        "infeasible",
        [],
    ),
    "an equation without entries": (
        lambda **k: solve([1.0], [[1.0]], [1.0], A_eq=[[0.0]], b_eq=[1.0], **k),
        "infeasible",
        [],
    ),
    "bounds that cross": (lambda **k: solve([1.0], [[1.0]], [1.0], bounds=(3.0, 2.0), **k), "infeasible", []),
    "a lower bound of infinity": (
        lambda **k: solve([0.0], [[1.0]], [1.0], bounds=(np.inf, np.inf), **k),
        "infeasible",
        [],
    ),
    "an upper bound of minus infinity": (
        lambda **k: solve([0.0], [[1.0]], [1.0], bounds=(-np.inf, -np.inf), **k),
        "infeasible",
        [],
    ),
    "a row below minus infinity": (lambda **k: solve([1.0], [[1.0]], [-np.inf], **k), "infeasible", []),
}


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("options", [{}, {"presolve": False}, {"method": "primal"}, {"method": "ipm"}])
def test_programs_that_highs_must_not_see(name, options, monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", lambda *_: pytest.fail("HiGHS was asked"))
    call, outcome, x = DEGENERATE[name]
    solution = call(**options)
    assert solution.outcome == outcome and solution.x.tolist() == x


def test_highs_says_nothing():
    """The first solver object of a process prints a banner from C, which no redirection inside Python catches."""
    code = "from control_kpos.exact.programs import solve; assert solve([1.0], [[-1.0]], [-2.0])\n"
    code += "import control_kpos as kp; assert kp.state_feedback(kp.ConeStateSpace([[1]], [[1]], [[1]], [[0]]))"
    done = subprocess.run([sys.executable, "-c", code], timeout=120, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_highs_ends_by_its_own_count(monkeypatch):
    monkeypatch.setattr(linear_programs, "_STEPS", (0, 0))
    c, A, b = random_program(1)
    answer = solve(c, A, b, bounds=(-2.0, 2.0), presolve=False)
    assert answer.outcome == "failed" and "limit" in answer.message


def test_blocks_are_the_same_dense_and_sparse():
    rng = np.random.default_rng(0)
    a, b, c = rng.random((2, 3)), rng.random((4, 3)), rng.random((4, 2))

    def data(convert):
        out = []
        program = Program(x=Block(3, low=-1.0, cost=[1.0, 2.0, 3.0]), t=Block(1, high=5.0))
        program.add(y=Block(2, low=0.0))
        program.below(1.0, x=convert(a))
        program.above(np.arange(4.0), np.arange(4.0), name="t", x=convert(b), y=c)
        program.equal(2.0, y=convert(np.eye(2)))
        program.solve(lambda *data, bounds: out.extend((*data, *bounds)) or linear_programs.failure("none"))
        return [part.toarray() if sp.issparse(part) else part for part in out]

    cost, above, right, equal, goal, low, high = data(lambda M: M)
    for one, other in zip((cost, above, right, equal, goal, low, high), data(sp.csr_array), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(cost, [1, 2, 3, 0, 0, 0])
    np.testing.assert_array_equal(above[:2], np.hstack([a, np.zeros((2, 3))]))
    np.testing.assert_array_equal(above[2:], np.hstack([-b, np.arange(4.0)[:, None], -c]))
    np.testing.assert_array_equal(right, [1, 1, 0, -1, -2, -3])
    np.testing.assert_array_equal(equal, np.hstack([np.zeros((2, 4)), np.eye(2)]))
    np.testing.assert_array_equal([low, high], [[-1, -1, -1, -np.inf, 0, 0], [np.inf] * 3 + [5] + [np.inf] * 2])


@pytest.mark.parametrize("count", [3, 150])
def test_slacks_move_every_row_that_can_be_positive(count):
    """x_k >= slack, x_0 = 0, sum x <= 1: every other row leaves 0, none takes all."""
    program = Program(x=Block(count, low=-1.0))
    program.spread(0.0, np.ones(count), x=np.eye(count))
    program.below(1.0, x=np.ones((1, count)))
    program.equal(0.0, x=np.eye(count)[:1])
    x = program.solve()["x"]
    assert x[0] == 0 and (x[1:] >= 1e-3 - 1e-9).all()


@given(st.integers(0, 10**6))
def test_exactly_one_of_a_point_and_a_contradiction(seed):
    rng = np.random.default_rng(seed)
    count, width = rng.integers(1, 7), rng.integers(1, 5)
    rows = rng.integers(-2, 3, size=(count, width)).astype(object)
    strict = rng.random(count) < 0.5
    y, x = alternative(rows, strict)
    assert (y is None) != (x is None)
    if y is not None:
        assert (y >= 0).all() and not (y @ rows).any() and y[strict].sum() > 0
    else:
        assert (rows @ x >= 0).all() and (rows[strict] @ x > 0).all()


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


@pytest.mark.parametrize("seed", range(40))
def test_rows_of_one_entry_are_bounds(seed):
    """Of both signs, among inequalities and equations: the same optimum by every method."""
    rng = np.random.default_rng(seed)
    c, A, b = random_program(seed)
    n = len(c)
    single = np.eye(n)[rng.integers(0, n, size=6)] * rng.choice([-3.0, 0.5, 2.0], size=(6, 1))
    rows, right = np.concatenate([A, single]), np.concatenate([b, rng.uniform(0.5, 4, size=6)])
    fixed, value = np.eye(n)[:1] * -2.0, np.array([0.25])
    data = {"A_ub": sp.csr_array(rows), "b_ub": right, "A_eq": fixed, "b_eq": value, "bounds": (-2.0, 2.0)}
    plain = solve(c, **data)
    for options in ({"presolve": False}, {"method": "primal"}):
        other = solve(c, **data, **options)
        assert plain.outcome == other.outcome
        if other:
            assert other.value == pytest.approx(plain.value, abs=1e-6)
            assert (rows @ other.x <= right + 1e-6).all() and other.x[0] == pytest.approx(-0.125)
            assert other.basic is None


def test_rows_of_one_entry_can_contradict_each_other():
    for options in ({"presolve": False}, {"method": "primal"}):
        assert solve([1.0], [[1.0], [-1.0]], [-1.0, -1.0], bounds=(-5.0, 5.0), **options).outcome == "infeasible"
