"""Designs of every size end with their time limit, and what they are assembled from."""

import time
from fractions import Fraction

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from test_time_limits import LIMIT, assert_ends

import control_kpos as kp
from control_kpos.design.accept import closed_loop
from control_kpos.design.network.program import _distinct
from control_kpos.design.polyhedral import program as rows
from control_kpos.design.result import DesignResult
from control_kpos.design.running import EFFORT, within
from control_kpos.design.simplicial import program
from control_kpos.exact.budget import OutOfBudgetError, begin, budget, spend
from control_kpos.exact.intake import exact_matrix
from control_kpos.find.feedback.placement import placed


def plant(n, m, seed=0):
    rng = np.random.default_rng(seed)
    return ct.ss(rng.standard_normal((n, n)), rng.standard_normal((n, m)), np.eye(n)[:2], np.zeros((2, m)))


def vertices(n, m, count):
    rng = np.random.default_rng(0)
    return [(rng.standard_normal((n, n)) - 4 * np.eye(n), plant(n, m).B) for _ in range(count)]


def slow_waves(size):
    """Opaque to interval arithmetic, and slow."""
    return ct.nlsys(
        lambda t, x, u, p: np.array([float(np.sin(float(x[i - 1]))) - 3 * x[i] for i in range(size)]),
        inputs=0,
        states=size,
    )


def tanks(count):
    rng = np.random.default_rng(0)
    nodes = [kp.ConeStateSpace([[-1 - a, 1], [1, -1 - b]], [[0], [1]], [[1, 0]], 0) for a, b in rng.random((count, 2))]
    return nodes, 0.3 * kp.examples.random_regular(count)


def many_rays(n):
    return kp.PolyhedralCone(np.hstack([np.ones((2 * n - 2, 1)), np.vstack([np.eye(n - 1), -np.eye(n - 1)])]))


DESIGNS = {
    "cone and gain": lambda **k: kp.design_cone_and_feedback(plant(100, 4), **k),
    "cone and gain, many inputs": lambda **k: kp.design_cone_and_feedback(plant(60, 20), **k),
    "cone and gain, vertices": lambda **k: kp.design_cone_and_feedback(plant(60, 4), vertices(60, 4, 4), **k),
    "largest rate": lambda **k: kp.state_feedback(plant(150, 20), rate="max", **k),
    "as many inputs as states": lambda **k: kp.state_feedback(plant(100, 100), rate=1, gain_bound=50, **k),
    "first gain": lambda **k: kp.state_feedback(plant(200, 100), method="first", **k),
    "two steps": lambda **k: kp.state_feedback(plant(200, 100), method="two-step", **k),
    "alternation": lambda **k: kp.state_feedback(plant(200, 10), method="alternation", **k),
    "vertices": lambda **k: kp.state_feedback(plant(100, 10), vertices=vertices(100, 10, 10), **k),
    "polyhedral cone, vertices": lambda **k: kp.state_feedback(
        plant(10, 10), X=many_rays(10), vertices=vertices(10, 10, 10), **k
    ),
    "polyhedral cone, bound": lambda **k: kp.state_feedback(plant(10, 10), X=many_rays(10), rate=1, gain_bound=30, **k),
    "constraints": lambda **k: kp.state_feedback(
        plant(4, 4), X=kp.lorentz(4, 1000), constraints=lambda F: [F >= -10], **k
    ),
    "disturbance": lambda **k: kp.state_feedback(
        plant(100, 100), disturbance=(np.ones((100, 3)), np.ones((2, 100))), **k
    ),
    "output": lambda **k: kp.output_feedback(plant(200, 10), rate="max", **k),
    "observer": lambda **k: kp.observer_gain(plant(200, 10), rate="max", **k),
    "trade-off": lambda **k: kp.gain_rate_tradeoff(plant(100, 50), np.linspace(0, 1, 20), certify=True, **k),
    "trade-off without rates": lambda **k: kp.gain_rate_tradeoff(plant(300, 200), **k),
    "network": lambda **k: kp.network_feedback(*tanks(10_000), rate=0.2, **k),
    "network, one gain": lambda **k: kp.network_feedback(*tanks(10_000), rate=0.2, uniform=True, **k),
    "sampled system": lambda **k: kp.differential_positivity(slow_waves(60), kp.orthant(60), [[-3, 3]] * 60, **k),
    "many Jacobians": lambda **k: kp.differential_positivity(
        list(np.random.default_rng(0).random((20_000, 4, 4))), kp.orthant(4), **k
    ),
}


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("name", DESIGNS)
def test_large_designs_end_and_claim_nothing_unproven(name):
    assert_ends(DESIGNS[name], LIMIT)


def test_a_reached_limit_is_said():
    for design in (DESIGNS["first gain"], DESIGNS["cone and gain"], DESIGNS["many Jacobians"], DESIGNS["network"]):
        answer = design(time_limit=1e-3)
        assert answer.status is kp.Status.UNDECIDED and "time limit" in answer.explain()


@pytest.mark.parametrize("effort", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("name", ["cone and gain, many inputs", "cone and gain, vertices", "first gain", "alternation"])
def test_a_refused_step_is_said_although_something_is_left(name, effort):
    with budget(effort) as outer:
        answer = DESIGNS[name]()
        assert answer.status is kp.Status.UNDECIDED and "effort set for this search" in answer.explain()
        assert outer.refused_by or not outer.left() > 0


def test_designs_say_what_ended_them():
    def late(_):
        spend(1e300)

    def given_up(_):
        time.sleep(2e-3)
        return DesignResult(status=kp.Status.UNDECIDED, message="no gain was found.")

    def worn_out(lp):
        spend(EFFORT["one system"] * (1 - 1e-15))
        begin(1e9)
        return given_up(lp)

    assert "the time limit of 60 s ended the design" in within(60, late).message
    assert "the effort set for this search ended the design" in within(None, late).message
    assert within(60, given_up).message == within(None, given_up).message == "no gain was found."
    assert within(1e-3, given_up).message == "no gain was found; the time limit of 0.001 s ended the design."
    assert within(None, worn_out).message == "no gain was found; the effort set for this search ended the design."


SMALL_EFFORT = {
    "largest rate": lambda: kp.state_feedback(plant(6, 3), rate="max", gain_bound=5),
    "alternation": lambda: kp.state_feedback(plant(4, 2), X=kp.lorentz(4, 12)),
    "observer": lambda: kp.observer_gain(plant(6, 2), rate=0.1),
    "network": lambda: kp.network_feedback(*tanks(30), rate=0.2),
}


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("name", SMALL_EFFORT)
@pytest.mark.parametrize("share", [1e-5, 1e-4, 1e-3, 1.0])
def test_without_a_time_limit_no_clock_decides(name, share, monkeypatch):
    for what in EFFORT:
        monkeypatch.setitem(EFFORT, what, EFFORT[what] * share)
    quick = SMALL_EFFORT[name]()
    reads = iter(range(10**9))
    # a clock that runs a thousand seconds at every look
    monkeypatch.setattr("control_kpos.exact.budget.time.monotonic", lambda: 1e3 * next(reads))
    slow = SMALL_EFFORT[name]()
    assert slow.status is quick.status and slow.message == quick.message and "time limit" not in slow.explain()
    assert slow.F is None if quick.F is None else np.array_equal(slow.F, quick.F)
    if quick.status is kp.Status.UNDECIDED and share < 1e-4:
        assert "the effort set for this search" in quick.message


def test_a_tradeoff_has_one_limit():
    curve = kp.gain_rate_tradeoff(plant(30, 30), [0.1, 0.2, 0.3], certify=True, time_limit=0.02)
    assert curve.rates.tolist() == [0.1, 0.2, 0.3] and curve.gains.shape == (3,) and len(curve.designs) == 3
    assert not kp.gain_rate_tradeoff(plant(300, 200), time_limit=1e-3).rates.size


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 12), st.integers(1, 4), st.integers(1, 5))
def test_products_are_the_same_dense_and_sparse(seed, count, m, width):
    rng = np.random.default_rng(seed)
    sparse = lambda *shape: rng.standard_normal(shape) * (rng.random(shape) < 0.5)  # noqa: E731
    left, right = sparse(count, m), sparse(3, width)
    k = rng.integers(0, 3, count)
    free = np.flatnonzero(rng.random(m * width) < 0.7)
    dense = rows.products(left, right, k, free)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows, "SMALL", -1)
        other = rows.products(left, right, k, free)
    assert sp.issparse(other) and not sp.issparse(dense)
    np.testing.assert_allclose(other.toarray(), dense, rtol=1e-15)
    L = rng.standard_normal((m, width))
    some = np.zeros(m * width)
    some[free] = L.ravel()[free]
    expected = np.einsum("rm,mq,rq->r", left, some.reshape(m, width), right[k])
    np.testing.assert_allclose(dense @ L.ravel()[free], expected, atol=1e-12)


def test_programs_too_large_for_the_time_are_not_set_up():
    with budget(1e9):
        program.spend_on_entries(1e5)
        with pytest.raises(OutOfBudgetError):
            program.spend_on_entries(5e7)
    with budget(), pytest.raises(OutOfBudgetError):  # memory ends as well
        program.spend_on_entries(1e10)


def test_rows_that_repeat_count_once():
    rng = np.random.default_rng(1)
    few = rng.integers(-2, 3, (6, 4)).astype(float)
    many = sp.csr_array(few[rng.integers(0, 6, 200)])
    kept = _distinct(many).toarray()
    assert len(kept) == len(np.unique(many.toarray(), axis=0))
    np.testing.assert_array_equal(np.unique(kept, axis=0), np.unique(many.toarray(), axis=0))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3))
def test_closed_loops_are_exact(seed, n, m):
    rng = np.random.default_rng(seed)
    A = exact_matrix(rng.standard_normal((n, n)), "A")
    B = exact_matrix([[f"{a}/7" for a in row] for row in rng.integers(-9, 9, (n, m)).tolist()], "B")
    F = rng.standard_normal((m, n)) * 10.0 ** rng.integers(-9, 9)
    expected = A.fractions() + B.fractions() @ np.array([[Fraction(v) for v in row] for row in F.tolist()])
    assert (closed_loop(A, B, exact_matrix(F, "F")).fractions() == expected).all()


@pytest.mark.parametrize(("n", "m"), [(2, 1), (3, 3), (6, 2), (12, 4), (40, 20)])
def test_poles_are_placed(n, m):
    rng = np.random.default_rng(n)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
    poles = -np.linspace(1, 3, n)
    F = placed(A, B, poles)
    assert F is not None
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A + B @ F).real), np.sort(poles), rtol=1e-5)
    doubled = placed(A, np.hstack([B, B]), poles)  # inputs that repeat
    assert doubled is not None
    np.testing.assert_allclose(
        np.sort(np.linalg.eigvals(A + np.hstack([B, B]) @ doubled).real), np.sort(poles), rtol=1e-5
    )


def test_poles_of_the_plant_itself_and_poles_out_of_reach():
    A, B = np.diag([-1.0, 2.0]), np.array([[1.0], [1.0]])
    F = placed(A, B, np.array([-1.0, -3.0]))  # -1 is a pole already
    assert F is not None
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A + B @ F).real), [-3, -1])
    assert placed(np.diag([1.0, 2.0]), np.array([[1.0], [0.0]]), np.array([-1.0, -3.0])) is None
    with budget(time_limit=1e-9), pytest.raises(OutOfBudgetError):
        placed(A, B, np.array([-1.0, -3.0]))


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5])
def test_the_smallest_gain_is_within_the_gap_of_the_proven_limit(gap):
    """5 is the infimum for the plant of the paper; other plants are random."""
    seed = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
    d = kp.state_feedback(seed, gap=gap)
    assert d and 4.999 < d.limit <= 5 < d.value <= 5 * (1 + gap)
    rng = np.random.default_rng(4)
    for _ in range(5):
        A, B = rng.random((3, 3)) - 0.5 * np.eye(3), rng.standard_normal((3, 2))
        d = kp.state_feedback(kp.ConeStateSpace(A, B, np.eye(3), np.zeros((3, 2))), gap=gap)
        assert not d or np.isnan(d.limit) or d.value <= d.limit * (1 + gap + 1e-4)
