"""Solvers that hang, lie, raise or return garbage, and time limits: in time, and never a gain without proof."""

import time

import control as ct
import cvxpy as cp
import numpy as np
import planted
import pytest

import control_kpos as kp
from control_kpos.exact import programs as linear_programs
from control_kpos.exact.programs import Solution

# networks of masses on springs are positive with feedback only
pytestmark = pytest.mark.filterwarnings("ignore::control_kpos.ActuatorLossWarning")

PAPER = [[0, 1], [1, -2]]
PLANT = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
SQUARE = kp.PolyhedralCone([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
TURN = ct.ss([[0, -1, 0], [1, 0, 0], [0, 0, -1]], np.eye(3)[:, :2], np.eye(3), 0)
NODE = kp.ConeStateSpace(PLANT, X=PAPER)
LIMIT = 0.3

DESIGNS = {
    "one-shot": lambda **k: kp.state_feedback(PLANT, X=PAPER, rate=1, **k),
    "first": lambda **k: kp.state_feedback(PLANT, X=PAPER, method="first", **k),
    "largest rate": lambda **k: kp.state_feedback(PLANT, X=PAPER, rate="max", **k),
    "alternation": lambda **k: kp.state_feedback(PLANT, X=PAPER, method="alternation", **k),
    "polyhedral": lambda **k: kp.state_feedback(TURN, X=SQUARE, **k),
    "two-step": lambda **k: kp.state_feedback(PLANT, X=PAPER, method="two-step", **k),
    "vertices": lambda **k: kp.state_feedback(
        PLANT, X=PAPER, vertices=[([[0, 1], [-c, 0]], [[0], [1]]) for c in (0.5, 2)], **k
    ),
    "disturbance": lambda **k: kp.state_feedback(PLANT, X=PAPER, disturbance=([[0], [1]], [[1, 0]]), gain_bound=8, **k),
    "output": lambda **k: kp.output_feedback(ct.ss([[-3, 1], [2, 1]], [[0], [1]], [[0, 1]], 0), **k),
    "observer": lambda **k: kp.observer_gain(ct.ss([[1, 1], [0.5, -2]], [[1], [0]], [[1, 0]], 0), rate=1, **k),
    "scale-free": lambda **k: kp.scale_free_feedback(NODE, 1.0, **k),
    "network": lambda **k: kp.network_feedback([NODE] * 2, [[0, 1], [1, 0]], **k),
    "bounded network": lambda **k: kp.network_feedback([NODE] * 2, [[0, 1], [1, 0]], gain_bound=9, **k),
}
IMPOSSIBLE = {
    "one-shot": lambda **k: kp.state_feedback(PLANT, X=kp.orthant(2), **k),
    "alternation": lambda **k: kp.state_feedback(PLANT, X=kp.orthant(2), method="alternation", **k),
    "polyhedral": lambda **k: kp.state_feedback(
        ct.ss([[0, -5, 0], [5, 0, 0], [0, 0, -1]], [[0], [0], [1e-3]], np.eye(3), 0),
        X=SQUARE,
        structure=[[1, 0, 0]],
        **k,
    ),
    "output": lambda **k: kp.output_feedback(PLANT, **k),
    "network": lambda **k: kp.network_feedback([NODE] * 2, [[0, 1], [1, 0]], gain_bound=4, **k),
}


def never_wrong(design, *, possible, limit=LIMIT):
    """The design within its time; what it claims is true, and a gain has its proof."""
    begin = time.monotonic()
    d = design(time_limit=limit)
    assert time.monotonic() - begin < limit + 2
    assert d.status is not (kp.Status.REFUTED if possible else kp.Status.PROVED)
    if d.status is kp.Status.UNDECIDED:
        assert d.F is None and d.closed_loop is None and d.explain()
    else:
        assert d.check()
    return d


# -- HiGHS


def raising(error):
    def run(*_, **__):
        raise error

    return run


def answering(x, outcome="optimal"):
    def run(cost, *_):
        return Solution(outcome, x(len(cost)), 0.0)

    return run


FAULTS = {
    "hangs": lambda *_: time.sleep(60),
    "raises": raising(RuntimeError("licence expired")),
    "has no memory": raising(MemoryError()),
    "exits": raising(SystemExit(1)),
    "says infeasible": answering(lambda n: np.empty(0), "infeasible"),
    "says unbounded": answering(lambda n: np.empty(0), "unbounded"),
    "gives up": answering(lambda n: np.empty(0), "failed"),
    "NaN": answering(lambda n: np.full(n, np.nan)),
    "infinite": answering(lambda n: np.full(n, np.inf)),
    "too short": answering(lambda n: np.ones(n - 1)),
    "too long": answering(lambda n: np.ones(n + 1)),
    "zeros": answering(np.zeros),
    "ones": answering(np.ones),
    "garbage": answering(lambda n: 1e3 * np.random.default_rng(n).normal(size=n)),
    "huge": answering(lambda n: np.full(n, 1e300)),
    "nothing": lambda *_: None,
    "text": lambda *_: "optimal",
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", DESIGNS)
def test_highs_that_fails(fault, name, monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", FAULTS[fault])
    never_wrong(DESIGNS[name], possible=True)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_highs_that_fails_where_there_is_no_gain(fault, name, monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", FAULTS[fault])
    never_wrong(IMPOSSIBLE[name], possible=False)


@pytest.mark.parametrize("every", [2, 3, 5])
@pytest.mark.parametrize("name", DESIGNS)
def test_highs_that_lies_now_and_then(name, every, monkeypatch):
    run, count = linear_programs._run_highs, [0]

    def lies(cost, *rest):
        count[0] += 1
        true = run(cost, *rest)
        return Solution("optimal", true.x + 0.1, true.value) if true and count[0] % every == 0 else true

    monkeypatch.setattr(linear_programs, "_run_highs", lies)
    never_wrong(DESIGNS[name], possible=True, limit=20)


# -- solvers through cvxpy

WITH_CVXPY = {
    "by name": lambda **k: kp.state_feedback(PLANT, X=PAPER, rate=1, solver="CLARABEL", **k),
    "alternation by name": lambda **k: kp.state_feedback(PLANT, X=PAPER, method="alternation", solver="CLARABEL", **k),
    "network by name": lambda **k: kp.network_feedback([NODE] * 2, [[0, 1], [1, 0]], solver="SCIPY", **k),
    "constraints": lambda **k: kp.state_feedback(PLANT, X=PAPER, constraints=lambda F: [F[0, 0] == -21], rate=1, **k),
    "objective": lambda **k: kp.state_feedback(PLANT, X=PAPER, objective=lambda F: cp.sum_squares(F), **k),
}


def claiming(value, status="optimal"):
    """Problem.solve that fills in a value of its own."""

    def run(self, *_, **__):
        for variable in self.variables():
            variable.save_value(None if value is None else value(variable.shape))
        self._status, self._value = status, 0.0
        return 0.0

    return run


CVXPY_FAULTS = {
    "hangs": lambda *_, **__: time.sleep(60),
    "raises": raising(cp.error.SolverError("the solver failed")),
    "has no memory": raising(MemoryError()),
    "raises anything": raising(KeyError("x")),
    "no value": claiming(None),
    "NaN": claiming(lambda shape: np.full(shape, np.nan)),
    "garbage": claiming(lambda shape: 1e3 * np.random.default_rng(1).normal(size=shape)),
    "zeros": claiming(np.zeros),
    "another shape": claiming(lambda shape: np.ones(7)),
    "text": claiming(lambda shape: "optimal"),
    "infeasible": claiming(None, "infeasible"),
    "unknown status": claiming(np.ones, "perhaps"),
}


@pytest.mark.parametrize("fault", CVXPY_FAULTS)
@pytest.mark.parametrize("name", WITH_CVXPY)
def test_cvxpy_that_fails(fault, name, monkeypatch):
    def run(self, *arguments, **options):
        return CVXPY_FAULTS[fault](self, *arguments, **options)

    monkeypatch.setattr(cp.Problem, "solve", run)
    never_wrong(WITH_CVXPY[name], possible=True)


# -- time limits without faults


@pytest.mark.parametrize("limit", [0.05, 0.3, 1.0])
@pytest.mark.parametrize(
    "demands", [{}, {"method": "alternation"}, {"rate": "max"}, {"gain_bound": 1e-3}, {"method": "first"}], ids=str
)
def test_time_limits_of_large_designs(limit, demands):
    A, B, rays, _ = planted.simplicial(np.random.default_rng(0), 25, 6)
    plant = kp.ConeStateSpace(A, B, np.eye(25), 0, X=rays)
    _ = plant.X.facets
    begin = time.monotonic()
    d = kp.state_feedback(plant, time_limit=limit, **demands)
    assert time.monotonic() - begin < limit + 2
    assert d.status is kp.Status.UNDECIDED or d.check()


@pytest.mark.parametrize("limit", [0.05, 0.5])
def test_time_limits_of_large_networks(limit):
    rng = np.random.default_rng(0)
    A = np.zeros((3000, 2, 2))
    A[:, 0, 1], A[:, 1, 0] = 1, -rng.uniform(0.5, 2, size=3000)
    nodes = kp.stack(A, [[0], [1]], [[1, 0]], X=kp.PolyhedralCone(PAPER))
    for demands in ({"gain_bound": 15}, {}, {"rate": 3.0}):
        begin = time.monotonic()
        d = kp.network_feedback(nodes, 0.1 * kp.examples.ring(3000), time_limit=limit, **demands)
        assert time.monotonic() - begin < limit + 2
        assert d.status is kp.Status.UNDECIDED or d.check()


# -- factorisations that fail


@pytest.mark.parametrize("broken", ["solve", "inv", "eigvals", "svd"])
@pytest.mark.parametrize("name", [*DESIGNS, *IMPOSSIBLE])
def test_factorisations_that_do_not_converge(broken, name, monkeypatch):
    monkeypatch.setattr(np.linalg, broken, raising(np.linalg.LinAlgError("did not converge")))
    for designs in (DESIGNS, IMPOSSIBLE):
        if name in designs:
            never_wrong(designs[name], possible=designs is DESIGNS, limit=20)


@pytest.mark.parametrize("height", [1e-8, 1e-30, 1e-300])
@pytest.mark.parametrize("demands", [{}, {"rate": "max"}, {"method": "first"}, {"method": "alternation"}], ids=str)
def test_flat_cones_give_no_warnings(height, demands):
    d = kp.state_feedback(PLANT, X=[[1, 0], [1, height]], **demands)
    assert d.check() or d.status is kp.Status.UNDECIDED
