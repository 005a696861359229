"""Wrong arguments, hopeless plants, and solvers that fail, hang or lie: never a gain without proof."""

import time

import control as ct
import cvxpy as cp
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.design.controllability import controllability_notes
from control_kpos.design.plant import read_plant
from control_kpos.errors import ShapeError
from control_kpos.exact import programs as linear_programs
from control_kpos.exact.programs import Solution

# networks of masses on springs are positive with feedback only
pytestmark = pytest.mark.filterwarnings("ignore::control_kpos.ActuatorLossWarning")

PAPER = [[0, 1], [1, -2]]
PLANT = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"X": [[0, 1, 0], [1, 0, 0], [0, 0, 1]]}, kp.ConeMismatchError, "dimension 3, but the system has 2"),
        ({"X": [[0, 1], [0, -1], [1, 0]]}, kp.NotProperConeError, "not pointed"),
        ({"rate": -1}, kp.DataError, "rate is -1"),
        ({"rate": "fast"}, kp.DataError, "'fast'"),
        ({"rate": np.nan}, kp.DataError, "rate is nan"),
        ({"gain_bound": -1}, kp.DataError, "cannot be negative"),
        ({"gain_bound": [1, 2, 3]}, kp.ShapeError, "3 entries"),
        ({"gain_bound": np.nan}, kp.DataError, "finite"),
        ({"structure": [[1, 0, 1]]}, kp.ShapeError, "structure is 1 x 3, but the gain is 1 x 2"),
        ({"structure": [["a", "b"]]}, kp.DataError, "booleans"),
        ({"vertices": []}, kp.ShapeError, "vertices is empty"),
        (
            {"vertices": [([[0, 1], [-1, 0]], [[0], [1]]), ([[0]], [[1]])]},
            kp.ShapeError,
            r"vertices\[1\]\[0\] is 1 x 1",
        ),
        ({"vertices": [3]}, kp.ShapeError, "pair"),
        ({"disturbance": [[0, 1]]}, kp.ShapeError, "disturbance must be"),
        ({"disturbance": ([[1]], [[1, 0]])}, kp.ShapeError, "disturbance E is 1 x 1"),
        ({"disturbance": ([[0], [1]], [[1, 0]]), "rate": "max"}, kp.DataError, "fixed rate"),
        ({"method": "magic"}, kp.DataError, "one-shot"),
        ({"method": "one-shot", "structure": [[0, 1]]}, kp.DataError, "blocks"),
        ({"solver": "NOSUCHSOLVER"}, kp.SolverError, "cvxpy finds"),
        ({"solver": 7}, kp.SolverError, "solver is 7"),
        ({"time_limit": 0}, kp.DataError, "time_limit"),
        ({"constraints": lambda F: [F[0, 5] == 1]}, kp.DataError, "shape"),
        ({"constraints": lambda F: [1]}, kp.DataError, "list of cvxpy constraints"),
        ({"objective": lambda F: -(F[0, 0] ** 2)}, kp.DataError, "convex"),
    ],
)
def test_wrong_arguments(arguments, error, message):
    with pytest.raises(error, match=message):
        kp.state_feedback(PLANT, **{"X": PAPER, **arguments})


def test_not_a_system():
    with pytest.raises(kp.DataError, match=r"give a ConeStateSpace"):
        kp.state_feedback([[1]])


# -- hopeless plants


def test_uncontrollable_mode_that_matters_is_named():
    d = kp.state_feedback(ct.ss([[1, 0], [0, -1]], [[0], [1]], [[1, 0]], 0))
    assert d.status is kp.Status.REFUTED and d.check()
    assert "mode 1 is not controllable" in d.explain() and "no feedback stabilises" in d.explain()


def test_uncontrollable_mode_that_does_not_matter_is_named():
    d = kp.state_feedback(ct.ss([[1, 0], [0, -1]], [[1], [0]], [[1, 0]], 0))
    assert d and "mode -1 is not controllable: it is stable" in d.explain()


def test_no_actuator():
    d = kp.state_feedback(ct.ss([[1, 0], [0, -1]], [[0], [0]], [[1, 0]], 0))
    assert d.status is kp.Status.REFUTED and d.check()


def test_zero_bound_is_no_feedback():
    d = kp.state_feedback(PLANT, X=PAPER, gain_bound=0)
    assert d.status is kp.Status.REFUTED and d.check()


def test_invariance_alone_impossible_on_a_cone_that_is_not_simplicial():
    square = kp.PolyhedralCone([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
    turn = [[0, -5, 0], [5, 0, 0], [0, 0, -1]]
    d = kp.state_feedback(ct.ss(turn, [[0], [0], [1e-3]], np.eye(3), 0), X=square, structure=[[1, 0, 0]])
    assert d.status is kp.Status.REFUTED and d.check() and "invariance alone" in d.message


# -- solvers


def wrong_length(c, *_):
    return np.zeros(len(c) + 1)


def not_numbers(c, *_):
    return np.full(len(c), np.nan)


def random_point(c, *_):
    return np.random.default_rng(0).normal(size=len(c)) * 100


def garbage(c, *_):
    return Solution("optimal", np.ones(len(c)), 0.0)


def failing(*_):
    raise RuntimeError("licence expired")


def out_of_memory(*_):
    raise MemoryError


def hanging(*_):
    time.sleep(20)


def always_infeasible(c, *_):
    return Solution("infeasible", np.empty(0))


def text(c, *_):
    return "optimal"


def nothing(c, *_):
    return None


LIARS = [
    wrong_length,
    not_numbers,
    random_point,
    garbage,
    failing,
    out_of_memory,
    hanging,
    always_infeasible,
    text,
    nothing,
]


@pytest.mark.parametrize("solver", LIARS, ids=lambda f: f.__name__)
@pytest.mark.parametrize(
    "design",
    [
        lambda **k: kp.state_feedback(PLANT, X=PAPER, rate=1, **k),
        lambda **k: kp.state_feedback(PLANT, X=PAPER, rate="max", **k),
        lambda **k: kp.state_feedback(PLANT, X=PAPER, method="alternation", **k),
        lambda **k: kp.state_feedback(PLANT, X=PAPER, method="two-step", **k),
        lambda **k: kp.state_feedback(PLANT, X=PAPER, disturbance=([[0], [1]], [[1, 0]]), gain_bound=8, **k),
        lambda **k: kp.output_feedback(ct.ss([[-3, 1], [2, 1]], [[0], [1]], [[0, 1]], 0), **k),
        lambda **k: kp.network_feedback([kp.ConeStateSpace(PLANT, X=PAPER)] * 2, [[0, 1], [1, 0]], **k),
    ],
    ids=["one-shot", "largest rate", "alternation", "two-step", "disturbance", "output", "network"],
)
def test_a_bad_solver_never_gives_an_uncertified_gain(solver, design):
    begin = time.monotonic()
    d = design(solver=solver, time_limit=0.3)
    assert time.monotonic() - begin < 0.3 + 2
    if d:
        assert d.check()
    else:
        assert d.F is None and d.closed_loop is None and d.explain()
    assert d.status is not kp.Status.REFUTED


@pytest.mark.parametrize("solver", [always_infeasible, failing])
def test_a_bad_solver_hides_no_proof(solver):
    d = kp.state_feedback(PLANT, X=kp.orthant(2), solver=solver)
    assert d.status is kp.Status.REFUTED and d.check()


def test_highs_itself_may_fail(monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", lambda *_: failing())
    d = kp.state_feedback(PLANT, X=PAPER, rate=1)
    assert (d and d.check()) or (d.status is kp.Status.UNDECIDED and d.F is None)
    refuted = kp.state_feedback(PLANT, X=kp.orthant(2))
    assert refuted.status is kp.Status.REFUTED and refuted.check()


@pytest.mark.parametrize("name", ["CLARABEL", "scipy", "highs"])
def test_other_solvers_by_name(name):
    d = kp.state_feedback(PLANT, X=PAPER, rate=1, solver=name)
    assert d and d.check() and d.value == pytest.approx(5, rel=0.07)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e6, 1e12])
def test_sizes_of_inputs_do_not_make_modes_uncontrollable_or_unstable(size):
    fixed = kp.state_feedback(ct.ss(np.diag([-1e-4, -1.0]), [[0], [size]], np.eye(2), 0))
    assert (
        fixed
        and "no feedback" not in fixed.explain()
        and "-0.0001 is not controllable: it is stable" in fixed.explain()
    )
    weak = kp.state_feedback(ct.ss([[1, 0], [0, -1]], [[size], [1 / size]], np.eye(2), 0))
    assert "controllable" not in weak.explain()


@pytest.mark.parametrize("dt", [None, 1])
def test_modes_on_the_edge_of_stability_are_decided(dt):
    turn = [[0, 1, 0], [-1, 0, 0], [0, 0, 0.5]]  # the eigenvalues i, -i in either kind of time
    d = kp.state_feedback(ct.ss(turn, [[0], [0], [1]], np.eye(3), 0, *([dt] if dt else [])))
    assert not d and "not controllable: it is not stable" in d.explain()
    slow = [[0, 1, 0], [-1 + 2.0**-52, -(2.0**-52), 0], [0, 0, 0.5]]
    damped = controllability_notes(read_plant(ct.ss(slow, [[0], [0], [1]], np.eye(3), 0, *([dt] if dt else [])), None))
    assert "it is stable" in damped[0]
    still = [[0 if dt is None else -1, 0], [1, 0.5]]
    assert (
        "it is not stable" in kp.state_feedback(ct.ss(still, [[0], [1]], np.eye(2), 0, *([dt] if dt else []))).explain()
    )


def test_what_is_not_controllable_of_a_family_is_about_its_first_vertex():
    A, B = np.diag([-2.0, -1]), [[0.0], [1]]
    d = kp.state_feedback(ct.ss(A, B, np.eye(2), 0), vertices=[(A, B), (A, [[1.0], [1]])])
    assert d and "mode -2 of the first vertex is not controllable" in d.explain()


def test_fractions_are_not_rounded_to_an_uncontrollable_plant():
    A, B = [["1/3", "0"], ["0", "1/3"]], [["1"], ["1"]]
    assert "not controllable" in kp.state_feedback(kp.ConeStateSpace(A, B, np.eye(2), np.zeros((2, 1)))).explain()
    A[1][1] = "0.33333333333333333333333333"
    assert "not controllable" not in kp.state_feedback(kp.ConeStateSpace(A, B, np.eye(2), np.zeros((2, 1)))).explain()


def test_refusals_name_their_cone():
    d = kp.state_feedback(PLANT)
    assert d.status is kp.Status.REFUTED and "the nonnegative orthant of R^2" in d.explain()
    assert "No gain exists for this cone" in d.explain() and "find_cone" in d.explain()
    slow = kp.state_feedback(PLANT, X=PAPER, rate=3)
    assert slow.status is kp.Status.REFUTED and "a cone of 2 generators in R^2" in slow.explain()
    still = kp.state_feedback(ct.ss([[1, 0], [0, -1]], [[0], [1]], np.eye(2), 0))
    assert "stability while X stays invariant cannot be had with any F, X" in still.explain()
    half = ct.ss(np.eye(2), np.eye(2), np.eye(2), 0)
    held = kp.state_feedback(half, structure=[[1, 1], [0, 0]])
    assert kp.state_feedback(half) and held.status is kp.Status.REFUTED and held.check()
    assert "No gain of this structure exists" in held.explain() and "any F of this structure, X" in held.explain()
    both = kp.state_feedback(half, structure=[[1, 1], [0, 0]], vertices=[half, half])
    assert "is not excluded" not in both.explain()  # no vector is needed to see that one entry is too large
    bounded = kp.state_feedback(half, state_bounds=[1, 1], input_bounds=0.5)
    assert bounded.status is kp.Status.REFUTED and "exists for this cone: Proved impossible" in bounded.explain()
    out = kp.output_feedback(ct.ss([[1, 0], [0, -1]], [[0], [1]], np.eye(2), 0))
    assert out.status is kp.Status.REFUTED and out.check() and "nonnegative orthant" in out.explain()


@pytest.mark.parametrize(
    "design",
    [
        lambda static: kp.state_feedback(static),
        lambda static: kp.output_feedback(static),
        lambda static: kp.observer_gain(static),
        lambda static: kp.gain_rate_tradeoff(static),
        lambda static: kp.optimal_feedback(static, [], [1], np.zeros((1, 0))),
        lambda static: kp.order_interval(static, []),
        lambda static: kp.design_cone_and_feedback(static),
        lambda static: kp.scale_free_certificate(static, weight=0.5),
        lambda static: kp.scale_free_certificate([kp.ConeStateSpace([[-1]], [[1]], [[1]], 0), static], weight=0.5),
    ],
)
def test_systems_without_states_are_refused(design):
    with pytest.raises(ShapeError, match=r"no states|not empty"):
        design(kp.ConeStateSpace([], [], [], [[0.5]]))


@pytest.mark.parametrize("kind", ["integer", "boolean"])
def test_variables_that_are_whole_numbers_are_refused(kind, capfd):
    whole = cp.Variable(**{kind: True})
    with pytest.raises(kp.DataError, match="integer or boolean"):
        kp.state_feedback(PLANT, X=PAPER, constraints=lambda F: [F[0, 0] == whole])
    assert capfd.readouterr() == ("", "")
