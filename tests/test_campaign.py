"""A small campaign; benchmarks/campaign.py runs the long one."""

import json
import os
import subprocess
import sys

import campaigns
import certified
import numpy as np
import pytest
import statements

import control_kpos as kp


def test_near_marginal_systems_get_the_true_verdict():
    found = campaigns.wrong_verdicts(250, seed=1)
    assert not found["false"] and not found["undecided"]
    assert 50 < found["stable"] < 200


def test_verdicts_do_not_depend_on_the_description():
    assert not campaigns.changed_verdicts(40, seed=2)


def test_both_readers_agree_on_claims_of_every_kind(tmp_path):
    found, seen = campaigns.disagreements(60, 3, tmp_path / "file.json")
    assert not found and len({name.split(" ")[0] for name in seen}) > 6


@pytest.mark.parametrize("part", range(3))
def test_changed_files_are_accepted_only_where_they_are_true(part, tmp_path):
    contents = []
    for name in list(certified.CERTIFICATES)[part::3]:
        certified.CERTIFICATES[name]().save(tmp_path / "file.json")
        contents.append(json.loads((tmp_path / "file.json").read_text()))
    found, accepted = campaigns.contradictions(contents, 40, 100 * part, tmp_path / "file.json")
    assert not found and accepted


@pytest.mark.parametrize("falsehoods", [statements.false_coverage, statements.false_networks, statements.false_designs])
def test_nothing_false_is_stated(falsehoods):
    assert not falsehoods(60, seed=11)


def test_the_truth_is_independent():
    """The checks of the campaign notice what is false."""
    nodes, W = [kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)] * 2, np.array([[0, 1.5], [0.5, 0]])
    top, radius = statements.true_abscissa(nodes, W)
    assert abs(float(top) - (np.sqrt(0.75) - 1)) < 1e-15 and float(radius) == 0
    s, T = kp.ConeStateSpace([[1]], [[1]], [[1]], 0), statements.fractions_of([[1]])
    d = kp.state_feedback(s, rate=1, gain_bound=5)
    asked = {"rate": "1", "gain_bound": 5}
    assert not list(statements._broken_promises(d, s, T, T, asked))
    assert "the gain bound" in list(statements._broken_promises(d, s, T, T, asked | {"gain_bound": 0.1}))
    assert any("the loop" in what for what in statements._broken_promises(d, s, T, T, {"rate": "9"}))
    assert not statements.impossible_by_linprog(s, T, T, asked)
    assert statements.impossible_by_linprog(s, T, T, {"gain_bound": 0.5})


def test_threads_do_not_change_verdicts():
    tests = os.path.dirname(os.path.abspath(__file__))
    outputs = set()
    for threads in ("1", "4"):
        environment = {
            **os.environ,
            "OPENBLAS_NUM_THREADS": threads,
            "OMP_NUM_THREADS": threads,
            "PYTHONPATH": os.pathsep.join([tests, os.path.dirname(tests)]),
        }
        done = subprocess.run(
            [sys.executable, "-c", "import campaigns; print(campaigns.digest(21, 5))"],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        )
        outputs.add(done.stdout)
    assert len(outputs) == 1
