"""A small campaign; benchmarks/campaign.py runs the long one."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import campaigns
import certified
import numpy as np
import pytest
import stated_designs
import stated_functions
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


STATED = (
    statements.false_coverage,
    statements.false_networks,
    stated_designs.false_designs,
    stated_functions.false_functions,
)


@pytest.mark.parametrize("falsehoods", STATED)
def test_nothing_false_is_stated(falsehoods):
    assert not falsehoods(60, seed=11)


def test_the_truth_is_independent():
    """The checks of the campaign notice what is false."""
    nodes, W = [kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)] * 2, np.array([[0, 1.5], [0.5, 0]])
    top, radius = statements.true_abscissa(nodes, W)
    assert abs(float(top) - (np.sqrt(0.75) - 1)) < 1e-15 and float(radius) == 0


def task(pairs, **asked):
    pairs = tuple((np.array(A, dtype=float), np.array(B, dtype=float)) for A, B in pairs)
    one = statements.fractions_of(np.eye(len(pairs[0][0]), dtype=int))
    return stated_designs.Task(pairs, one, one, asked=asked)


def test_the_truth_about_designs_is_independent():
    rng, single = np.random.default_rng(1), [([[1]], [[1]])]
    asked = task(single, rate="1", gain_bound=5.0)
    d = asked.design()

    def promises(**changes):
        return " ".join(stated_designs.broken_promises(rng, task(single, **changes), replace(d, **result)))

    result = {}
    assert d and not promises(rate="1", gain_bound=5.0) and "the gain bound" in promises(gain_bound=0.1)
    assert "the loop" in promises(rate="9") and "the vector" in promises(rate="9")
    result = {"limit": 1.01 * d.limit}
    assert "the limit" in promises(rate="1") and "the limit" not in promises(rate="3")
    assert stated_designs.is_possible(asked, 1, 5.0) and not stated_designs.is_possible(asked, 1, 1.5)
    disturbed = task(single, gain_bound=5.0, disturbance=(np.eye(1), np.eye(1)))
    assert abs(stated_designs.smallest_amplification(disturbed, 0, 5.0) - 0.25) < 1e-3
    assert stated_designs.amplification(disturbed, statements.fractions_of([[-5]])) == Fraction(1, 4)
    # F = 0 serves both, with a vector of its own for each
    zero = np.zeros((2, 1))
    both = task([([[-1, 1.5], [0.1, -1]], zero), ([[-1, 0.1], [1.5, -1]], zero)])
    assert not stated_designs.is_possible(both, 0) and next(stated_designs.stabilising_gains(rng, both)) is not None
    refused = both.design()
    assert stated_designs.false_refusal(rng, both, refused) is None
    assert stated_designs.false_refusal(rng, asked, refused) == "refused what a linear program finds"


def test_the_truth_about_functions_is_independent():
    rng, box = np.random.default_rng(1), np.array([[0, 1], [0, 1.0]])
    falls = stated_functions.worst_quotient(rng, lambda t, x, u, p: [-x[0], -x[1] - x[0] ** 2], box, kp.orthant(2))
    rises = stated_functions.worst_quotient(rng, lambda t, x, u, p: [-x[0], x[0] ** 2], box, kp.orthant(2))
    assert falls < -0.1 and rises >= 0
    v = np.array([1.0, 1.0])
    assert stated_functions.worst_quotient(rng, lambda t, x, u, p: [-x[0], 2 * x[0]], box, kp.orthant(2), v) < -0.9


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
