"""Whatever searches takes a time limit, keeps it on hard instances, and claims nothing it has not proven."""

import inspect
import time

import control as ct
import numpy as np
import pytest
from scipy.linalg import block_diag

import control_kpos as kp
from control_kpos.exact.budget import SPEED, OutOfBudgetError, affords, budget, seconds_left, spend

LIMIT = 0.3
# Bounds that only something that hangs exceeds, however loaded the machine is.
PATIENCE = 20


def plant(n, m, seed=0):
    rng = np.random.default_rng(seed)
    return ct.ss(rng.standard_normal((n, n)), rng.standard_normal((n, m)), np.eye(n)[:2], np.zeros((2, m)))


def family(n, count, seed=0):
    rng = np.random.default_rng(seed)
    return [rng.standard_normal((n, n)) - 4 * np.eye(n) for _ in range(count)]


def vertices(n, m):
    return [(A, plant(n, m).B) for A in family(n, 4)]


def whole_numbers(n):
    return np.random.default_rng(0).integers(-3, 4, (n, n)).astype(float)


def oscillations(count):
    """A dominant eigenvalue, and pairs that decay slowly: thousands of rays for each."""
    blocks = [[[-1e-3, 1 + 0.01 * k], [-1 - 0.01 * k, -1e-3]] for k in range(count)]
    return block_diag(*blocks, 0)


def far_apart():
    """A matrix, vectors and half-spaces whose orbits are long."""
    rng = np.random.default_rng(0)
    T = np.linalg.qr(rng.standard_normal((16, 16)))[0]
    return T @ np.diag(-np.arange(16.0)) @ T.T, rng.standard_normal((5, 16)) + 3, rng.standard_normal((5, 16)) + 3


def waves(size):
    """A nonlinear system with sums of many waves, whose enclosures are slow and wide."""

    def rates(t, x, u, p):
        return [sum(0.1 * np.sin((k + 1) * x[i - 1]) for k in range(8)) - 3 * x[i] for i in range(size)]

    return ct.nlsys(rates, inputs=0, states=size)


def tanks(count):
    tank = kp.ConeStateSpace([[-1, 1], [1, -1]], [[0], [1]], [[1, 0]], 0)
    return [tank] * count, 0.3 * kp.examples.random_regular(count)


SEARCHES = {
    "find_cone": lambda **k: kp.find_cone(family(5, 3, seed=4), restarts=10**9, **k),
    "find_cone of a large matrix": lambda **k: kp.find_cone(family(60, 1)[0], **k),
    "find_cone of a very large matrix": lambda **k: kp.find_cone(family(1200, 1)[0], **k),
    "find_cone of whole numbers": lambda **k: kp.find_cone(whole_numbers(60), **k),
    "find_cone of slow oscillations": lambda **k: kp.find_cone(oscillations(30), **k),
    "find_cone of a large family": lambda **k: kp.find_cone(family(200, 3), restarts=10**9, **k),
    "find_cone of a long family": lambda **k: kp.find_cone(family(4, 3000), restarts=10**9, **k),
    "find_cone with inputs and outputs": lambda **k: kp.find_cone(*far_apart(), **k),
    "design_cone_and_feedback": lambda **k: kp.design_cone_and_feedback(plant(10, 2), vertices(10, 2), **k),
    "state_feedback": lambda **k: kp.state_feedback(plant(5, 3), X=kp.lorentz(5, 40), rate="max", **k),
    "state_feedback on an orthant": lambda **k: kp.state_feedback(plant(40, 8), rate="max", gain_bound=5, **k),
    "output_feedback": lambda **k: kp.output_feedback(plant(12, 3), rate="max", **k),
    "observer_gain": lambda **k: kp.observer_gain(plant(40, 3), rate="max", **k),
    "network_feedback": lambda **k: kp.network_feedback(*tanks(2000), rate=0.2, **k),
    "network_feedback, one gain for all": lambda **k: kp.network_feedback(*tanks(2000), uniform=True, rate=0.2, **k),
    "scale_free_feedback": lambda **k: kp.scale_free_feedback(tanks(8)[0][0], rate="max", **k),
    "gain_rate_tradeoff": lambda **k: kp.gain_rate_tradeoff(plant(30, 8), rates=np.linspace(0, 1, 20), **k),
    "differential_positivity": lambda **k: kp.differential_positivity(
        waves(6), kp.orthant(6), [[-3, 3]] * 6, pieces=10**6, **k
    ),
}


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("name", SEARCHES)
def test_searches_end(name):
    assert_ends(SEARCHES[name], LIMIT)


def assert_ends(search, limit):
    """The search is back in time, and what it claims, of each of its designs if there are several, passes the check."""
    begin = time.monotonic()
    answer = search(time_limit=limit)
    assert time.monotonic() - begin < limit + PATIENCE
    for result in getattr(answer, "designs", (answer,)):
        check = getattr(result, "check", None) or getattr(getattr(result, "certificate", None), "check", None)
        assert result.status is kp.Status.UNDECIDED or (check is not None and check())


def test_a_search_that_was_ended_says_so():
    found = kp.find_cone(family(1200, 1)[0], time_limit=LIMIT)
    assert found.status is kp.Status.UNDECIDED and not found.certificate
    assert f"The time limit of {LIMIT} s ended the search" in found.explain()


def test_limits_end_with_the_search():
    with budget(time_limit=LIMIT):
        with budget(time_limit=1e6):
            assert 0 < seconds_left() <= LIMIT
            spend(1e5)
            with pytest.raises(OutOfBudgetError, match=f"the time limit of {LIMIT} s"):
                spend(2 * LIMIT * SPEED)
        with pytest.raises(ZeroDivisionError), budget(time_limit=LIMIT / 2):
            _ = 1 / 0
        assert seconds_left() > LIMIT / 4
    assert seconds_left() == np.inf


def test_operations_are_counted_in_every_budget_around():
    with budget(1e6) as outer:
        with budget(1e9) as inner:
            spend(6e5)
            assert affords(3.9e5) and not affords(4.1e5)
            with pytest.raises(OutOfBudgetError, match="the effort set for this search"):
                spend(4.1e5)
        assert outer.operations == inner.operations == 4e5
        with budget(1e5), pytest.raises(OutOfBudgetError):
            spend(2e5)
        spend(3e5)
    spend(1e300)  # outside every budget nothing is counted


@pytest.mark.parametrize("name", sorted({name.split(" ")[0].rstrip(",") for name in SEARCHES}))
@pytest.mark.parametrize("limit", [0, -1, np.nan, "soon", True, [1, 2]])
def test_limits_are_positive_numbers_of_seconds(name, limit):
    assert inspect.signature(getattr(kp, name)).parameters["time_limit"].default is None
    search = next(make for label, make in SEARCHES.items() if label.split(" ")[0].rstrip(",") == name)
    with pytest.raises((kp.DataError, kp.ShapeError), match="time_limit"):
        search(time_limit=limit)


@pytest.mark.parametrize("limit", [1e-9, 2e-3])
@pytest.mark.parametrize("own", [None, 100])
def test_a_question_with_a_short_limit_leaves_no_verdict_to_longer_ones(own, limit):
    nodes, links = tanks(200)
    net = kp.feedback_interconnect(nodes, links, time_limit=own)
    net.linear_lyapunov(time_limit=limit)
    kp.structured_gain(net, time_limit=limit)
    assert net.certificate.status.name == "REFUTED"


def test_nested_limits_name_the_shorter_and_keep_nothing():
    net = kp.feedback_interconnect(*tanks(50), time_limit=100)
    with budget(time_limit=1e-9) as around:
        found = net.certificate
    assert found.status.name == "UNDECIDED"
    assert "1e-09 s" in found.explain()
    assert around.refused_by
    assert net.certificate.status.name == "REFUTED"
    ranges = kp.interval(0.1 * np.ones((3, 3)), 0.2 * np.ones((3, 3)))
    uncertain = kp.feedback_interconnect(tanks(8)[0][:3], ranges, time_limit=100)
    with budget(time_limit=1e-9):
        assert uncertain.certificate.status.name == "UNDECIDED"
    assert uncertain.certificate.status.name != "UNDECIDED"
