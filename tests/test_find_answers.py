"""Answers of searches for cones: checked, saved, shown, taken wherever a cone is, and what ended a search."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace

import control as ct
import numpy as np
import pytest
from planted import pair, with_dominant_eigenvalue

import control_kpos as kp
from control_kpos import (
    PolyhedralCone,
    Status,
    load_certificate,
    state_positivity,
)
from control_kpos.errors import DataError
from control_kpos.find import find_cone


def test_an_answer_is_checked_saved_and_shown(tmp_path):
    found = find_cone(pair(1.0, 5.0))
    assert found.check() and found.margin == found.certificate.margin and found.message == found.explanation == ""
    found.save(tmp_path / "cone.json")
    assert load_certificate(tmp_path / "cone.json").status is Status.PROVED
    assert "16 rays" in repr(found) and "PROVED" in found._repr_html_() and "conditioning" in found._repr_html_()
    refuted = find_cone(pair(0.0, 1.0))
    assert refuted.check() and refuted.witness is refuted.obstruction and refuted.cone is None
    assert not replace(refuted, certificate=found.certificate).check()
    unknown = find_cone(pair(2.0**-40, 1.0))
    assert not unknown.check() and unknown.message and unknown.message in unknown.explain()
    with pytest.raises(DataError, match="nothing was proven"):
        unknown.save(tmp_path / "none.json")


TURNING = [[-1, 4, 0], [-4, -1, 0], [0, 0, 1]]
USES = {
    "system": lambda X: kp.ConeStateSpace(np.array(TURNING), np.eye(3), np.eye(3), 0, X=X).X,
    "positivity": lambda X: kp.state_positivity(TURNING, X).X,
    "stability": lambda X: kp.linear_lyapunov(TURNING, X).X,
    "feedback": lambda X: kp.state_feedback(ct.ss(np.array(TURNING), np.eye(3), np.eye(3), 0), X=X).closed_loop.X,
    "product": lambda X: kp.product([X, kp.orthant(1)]).factors[0],
    "times": lambda X: (kp.orthant(1) * X).factors[1],
    "intersection": lambda X: PolyhedralCone(np.eye(3)) & X & X,
    "sum": lambda X: PolyhedralCone(np.eye(3)) + X,
    "within": lambda X: find_cone(TURNING, within=X).cone,
    "contains": lambda X: kp.PolyhedralCone.from_facets([[0, 0, 1]]).contains(X),
    "nodes": lambda X: kp.stack(A=np.array([TURNING] * 2), B=np.zeros((2, 3, 1)), C=np.zeros((2, 1, 3)), X=X).X,
    "nonlinear": lambda X: kp.differential_positivity(TURNING, X).X,
}


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("use", USES)
def test_an_answer_is_taken_wherever_a_cone_is(use):
    found = find_cone(TURNING)
    assert USES[use](found) == USES[use](found.cone)
    with pytest.raises(DataError, match=r"search that found no cone.*not real"):
        USES[use](find_cone(pair(0.0, 1.0)))


def test_a_numerically_flat_cone_is_not_handed_on():
    flat = replace(find_cone(TURNING), status=Status.UNDECIDED, conditioning=1e13, message="numerically flat")
    with pytest.raises(DataError, match="numerically flat"):
        state_positivity(TURNING, flat)


def test_without_a_time_limit_the_answer_is_counted_not_timed(monkeypatch):
    """A clock that jumps by an hour at every look changes nothing."""
    rng = np.random.default_rng(0)
    family = [rng.standard_normal((3, 3)) - 2 * np.eye(3) for _ in range(3)]
    questions = [pair(1.0, 5.0), with_dominant_eigenvalue(0, 8, discrete=False), family]
    expected = [find_cone(question, restarts=3) for question in questions]
    jumps = itertools.count(0.0, 3600.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(jumps))
    for question, before in zip(questions, expected, strict=True):
        after = find_cone(question, restarts=3)
        assert (after.status, after.message) == (before.status, before.message)
        assert after.rays is None or np.array_equal(after.rays, before.rays)


def test_an_answer_tells_which_limit_ended_the_search(monkeypatch):
    assert "The time limit of 1e-06 s ended the search" in find_cone(pair(1.0, 5.0), time_limit=1e-6).explain()
    monkeypatch.setattr("control_kpos.find.find._EFFORT", 10.0)
    spent = find_cone(pair(1.0, 5.0))
    assert spent.status is Status.UNDECIDED and "The effort set for this search ended the search" in spent.explain()


def test_the_text_goes_by_the_status_and_says_what_is_computed():
    """A witness that proves nothing refutes nothing; numbers from floating point are called computed."""
    refuted, between = find_cone(pair(0.0, 1.0)), find_cone(np.diag([-1.0, -2]), contains=[[1, 1]], within=[[-1, 2]])
    for found in (refuted, between, find_cone([np.eye(3), pair(0.0, 1.0)])):
        unproven = replace(found.certificate, status=Status.UNDECIDED)
        assert "No invariant" in found.explain() and unproven.explain().startswith("Undecided: no cone")
    assert (
        "exists: " in refuted.explain()
        and "(computed: 1 ± " not in refuted.explain()
        and "(computed: " in refuted.explain()
    )
    assert "holds the vectors and lies in the half-spaces asked for" in between.explain()
    wrong = replace(between.certificate, witness=replace(between.obstruction, value=-7.0))
    assert not wrong.check()
    proved, none = find_cone(pair(1.0, 5.0)), find_cone(pair(2.0**-40, 1.0))
    assert "Computed, not proven: every such cone has at least 16 rays" in proved.explain()
    assert "by the computed eigenvalues" in none.explain() and "Refuted" not in none.explain()


def test_a_transfer_function_is_realized_first():
    G = ct.tf([1], [1, 3, 2])
    found = kp.find_cone(G)
    assert found and kp.ConeStateSpace(G, X=found.cone).is_cone_positive()
    assert kp.ConeStateSpace(found.system, X=found).is_cone_positive() and (found.system.A == ct.ss(G).A).all()
    assert "control.ss made of the transfer function" in found.explain() and found.status is kp.Status.PROVED
    assert kp.find_cone(ct.ss(G)).system is None and "control.ss" not in kp.find_cone(ct.ss(G)).explain()
    assert kp.find_cone(ct.tf([1, -3], [1, 3, 2])).status is kp.Status.REFUTED  # a zero at 3
    with pytest.raises(kp.KposError, match=r"A: control\.ss finds no realization"):
        kp.find_cone(ct.tf([1, 0, 0], [1, 1]))
