"""What networks say is chosen by status and conditions, and the scope of a "no" is part of it."""

from dataclasses import replace

import numpy as np
import pytest
from network_examples import lag

import control_kpos as kp
from control_kpos.errors import DataError
from control_kpos.proof.certificate import Status


def ring(weight, nodes=None, **more):
    return kp.feedback_interconnect(nodes or [lag(1.0)] * 3, weight * np.roll(np.eye(3), 1, 0), **more)


def refused():
    """Refuted certificates of every kind, with words that their text must hold."""
    turning = kp.ConeStateSpace([[-1, -1], [0, -1]], [[1], [0]], [[1, 0]], 0)
    yield ring(-1).certificate, "about these cones"
    yield (
        kp.feedback_interconnect([turning], [[0]]).certificate,
        "nonnegative orthants, as those of nodes given without",
    )
    yield ring(2).certificate, "growth rate at least"
    yield ring(2, [lag(0.5, dt=True)] * 3).certificate, "growth factor per step at least"
    yield ring(1, [lag(1.0, D=2.0)] * 3).certificate, "algebraic loop of gain 1 or more through nodes 0, 1, 2"
    yield ring(0.5, supply_rates=[([-1], [0.1])] * 3).certificate, "these supply rates, not about stability"
    yield ring(0.5, supply_rates=[([-0.4], [1])] * 3).certificate, "these supply rates, not about stability"


@pytest.mark.parametrize(("certificate", "words"), list(refused()))
def test_a_refusal_says_what_it_is_about_and_nothing_without_its_conditions(certificate, words):
    assert certificate.status is Status.REFUTED and words in certificate.explain()
    other = ring(0.5).model if certificate.model.totals == (3, 3, 3) else certificate.model
    for model in (other, replace(other, dt=0)):
        moved = type(certificate).settle(**{**certificate.data(), "model": model})
        said = moved.explain()
        assert said.startswith({"REFUTED": "Not certified", "PROVED": "Proved"}.get(moved.status.name, "Undecided"))


def test_numbers_and_nodes_in_words_are_those_of_the_data():
    wrong = ring(-1).certificate
    for change in ({"value": -7.0}, {"value": 1.0}):
        stated = type(wrong).settle(**{**wrong.data(), "witness": replace(wrong.witness, **change)})
        assert stated.status is Status.UNDECIDED and stated.explain().startswith("Undecided")
    loop = ring(1, [lag(1.0, D=2.0)] * 3).certificate
    data = {"y": loop.witness.y, "u": loop.witness.u, "nodes": np.array([0])}
    stated = type(loop).settle(**{**loop.data(), "witness": type(loop.witness)(**data)})
    assert stated.status is Status.UNDECIDED and stated.explain().startswith("Undecided")


def test_margins_are_called_computed():
    said = ring(0.5).certificate.explain()
    assert "computed and not proven" in said and "with decay rate at least 0.4999" in said


def test_scale_free_certificates_speak_by_status():
    certificate = kp.scale_free_certificate(lag(1.0), weight=2.0)
    assert "already" in certificate.explain() and certificate.status is Status.REFUTED
    with pytest.raises(DataError, match="self-loops of this weight"):
        type(certificate).settle(**{**certificate.data(), "weight": 0.5})
    apart = replace(certificate, status=Status.UNDECIDED)
    assert apart.explain().startswith("Undecided")
