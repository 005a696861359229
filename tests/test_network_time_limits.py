"""Questions about networks end with their time limit: UNDECIDED, with the reason; a fake clock counts its readings."""

import pickle
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

import control_kpos as kp
from control_kpos.exact import budget as clock
from control_kpos.exact.budget import OutOfBudgetError, budget, require_time

RNG = np.random.default_rng(0)
NODE = kp.ConeStateSpace([[-2, 1], [1, -3]], [[1], [0]], [[0, 1]], 0)
DIRECT = kp.ConeStateSpace([[-2, 1], [1, -3]], [[1], [0]], [[0, 1]], [["0.1"]])
SLOWER = kp.ConeStateSpace([[-3, 1], [1, -3]], [[1], [0]], [[0, 1]], 0)
RAYS = [[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]
PYRAMID = kp.ConeStateSpace(np.diag([-3.0, -3.0, -2.0]), [[0], [0], [1]], [[0, 0, 1]], 0, X=RAYS)
LIMITS = [*range(1, 12), 15, 20, 30, 50, 80, 200, 1000]


def links(size, n=8):
    W = np.zeros((n, n))
    for j in range(n):
        W[j, RNG.choice(n, 3, replace=False)] = RNG.random(3)
    np.fill_diagonal(W, 0)
    return size * W


NETWORKS = {
    "stable": ([NODE] * 8, links(0.3)),
    "with feedthrough": ([DIRECT] * 8, links(0.3)),
    "not stable": ([NODE] * 8, links(30.0)),
    "loops of feedthrough": ([DIRECT] * 8, links(30.0)),
    "other cones": ([PYRAMID] * 8, links(0.3)),
    "vertices": ([[NODE, SLOWER]] * 8, links(0.3)),
    "vertices, not stable": ([[NODE, SLOWER]] * 8, links(30.0)),
}
QUESTIONS = {
    "certificate": lambda net, limit: net.certificate,
    "edited": lambda net, limit: net.with_links(0.9 * net.model.W).certificate,
    "lyapunov": lambda net, limit: net.linear_lyapunov(time_limit=limit),
    "fastest": lambda net, limit: net.linear_lyapunov("max", time_limit=limit),
    "dissipativity": lambda net, limit: net.dissipativity(time_limit=limit),
    "positivity": lambda net, limit: net.cone_positivity(time_limit=limit),
    "abscissa": lambda net, limit: net.abscissa_certificate(time_limit=limit),
    "gain": lambda net, limit: kp.structured_gain(net, time_limit=limit),
    "margin": lambda net, limit: kp.robust_margin(net, time_limit=limit),
    "delayed": lambda net, limit: kp.delayed(net, 0.01 * np.eye(net.model.stacks[0].sizes[0]), time_limit=limit),
}
CASES = [
    (n, q) for n in NETWORKS for q in QUESTIONS if q in ("certificate", "edited") or not n.startswith(("vert", "loops"))
]


@pytest.fixture
def readings(monkeypatch):
    """A clock that moves on by a second at every look, and how far it is."""
    ticks = count()
    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=lambda: float(next(ticks))))
    return lambda: next(ticks)


@pytest.mark.parametrize(("name", "question"), CASES)
def test_a_limit_ends_a_question_with_its_reason(name, question, readings):
    ask, given = QUESTIONS[question], NETWORKS[name]
    whole = ask(kp.feedback_interconnect(*given), None)
    stopped = 0
    for limit in LIMITS:
        begun = readings()
        found = ask(kp.feedback_interconnect(*given, time_limit=limit), limit)
        assert readings() - begun <= 3 * limit + 20  # "edited" asks two questions
        assert found.status in (whole.status, kp.Status.UNDECIDED)
        if found.status is not whole.status:
            assert f"the time limit of {limit} s" in found.explain()
            stopped += 1
        else:
            assert found.check()
    assert stopped or question == "positivity"
    assert (
        found.status is whole.status or "feedthrough" in name or "not stable" in name or question in ("gain", "margin")
    )


def test_without_a_limit_no_clock_is_read(readings):
    begun = readings()
    net = kp.feedback_interconnect(*NETWORKS["stable"])
    assert net.certificate and net.spectral_abscissa() and net.gain("L2") > 0
    assert readings() == begun + 1


def test_answers_in_numbers_raise_undecided(readings):
    net = kp.feedback_interconnect(*NETWORKS["stable"], time_limit=1)
    for ask in (net.spectral_abscissa, net.gain, lambda: net.gain("L2"), net.poles):
        with pytest.raises(kp.UndecidedError, match="time limit"):
            ask()
    assert net.gain(time_limit=1e9) > 0 and net.spectral_abscissa(time_limit=1e9)[0] < 0
    assert net.is_cone_positive(time_limit=1e9)


def test_a_bracket_keeps_what_it_has(readings):
    net = kp.feedback_interconnect(*NETWORKS["stable"])
    found = [net.abscissa_certificate(1e-13, time_limit=limit) for limit in (10, 100, 1000)]
    assert all(cert.check() for cert in found)
    widths = [cert.upper - cert.lower for cert in found if cert]
    assert widths == sorted(widths, reverse=True)


def test_the_largest_uncertainty_is_as_close_as_time_allows(readings):
    weight = kp.interval("0.4", "0.6")
    lag = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)
    net = kp.feedback_interconnect([lag, lag], [[0, weight], [weight, 0]])
    whole = kp.largest_uncertainty(net)
    assert not whole.ended
    for limit in LIMITS:
        found = kp.largest_uncertainty(net, time_limit=limit)
        assert found.check() and found.lower <= whole.lower and found.upper >= whole.upper
        assert found == whole or (found.ended and f"the time limit of {limit} s" in found.explain())


def test_a_limit_is_inherited_and_checked():
    net = kp.feedback_interconnect(*NETWORKS["stable"], time_limit=100)
    again = pickle.loads(pickle.dumps(net))
    for other in (net.copy(), net.with_links(net.model.W), net.without_node(0), net.append(net), again):
        assert other.time_limit == 100
    assert kp.feedback_interconnect(*NETWORKS["vertices"], time_limit=7).member([0] * 8).time_limit == 7
    for wrong in (0, -1, "soon", np.nan):
        with pytest.raises(kp.DataError, match="time_limit"):
            kp.feedback_interconnect(*NETWORKS["stable"], time_limit=wrong)


def test_unfinished_verdicts_are_saved_without_a_reason(readings, tmp_path):
    found = kp.feedback_interconnect(*NETWORKS["stable"], time_limit=1).certificate
    found.save(tmp_path / "late.json")
    loaded = kp.load_certificate(tmp_path / "late.json")
    assert loaded == found and loaded.status is kp.Status.UNDECIDED and "time limit" not in loaded.explain()


def test_the_clock_alone_stops_a_step():
    with budget(1.0):
        require_time(1e30)  # operations are for searches that count
    with budget(time_limit=1e6) as limited:
        require_time(1e14)
        with pytest.raises(OutOfBudgetError, match="the time limit of 1e\\+06 s"):
            require_time(1e16)
        assert limited.refused_by == "the time limit of 1e+06 s"
