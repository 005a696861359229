"""A small campaign; benchmarks/campaign.py runs the long one."""

import json
import os
import subprocess
import sys

import campaigns
import certified
import pytest


def test_near_marginal_systems_get_the_true_verdict():
    found = campaigns.wrong_verdicts(250, seed=1)
    assert not found["false"] and not found["undecided"]
    assert 50 < found["stable"] < 200


def test_verdicts_do_not_depend_on_the_description():
    assert not campaigns.changed_verdicts(40, seed=2)


def test_both_readers_agree_on_polyhedral_cones(tmp_path):
    assert not campaigns.polyhedral_disagreements(30, 3, tmp_path / "file.json")


@pytest.mark.parametrize("part", range(3))
def test_changed_files_are_accepted_only_where_they_are_true(part, tmp_path):
    contents = []
    for name in list(certified.CERTIFICATES)[part::3]:
        certified.CERTIFICATES[name]().save(tmp_path / "file.json")
        contents.append(json.loads((tmp_path / "file.json").read_text()))
    found, accepted = campaigns.contradictions(contents, 40, 100 * part, tmp_path / "file.json")
    assert not found and accepted


def test_threads_do_not_change_verdicts():
    code = (
        "import numpy as np, control_kpos as kp;"
        "rng = np.random.default_rng(5); A = rng.random((60, 60)); A -= np.diag(A.sum(axis=1));"
        "print([kp.linear_lyapunov(A - s * np.eye(60), kp.orthant(60)).status.name for s in (-1e-9, 1e-13, 1e-9)])"
    )
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    outputs = set()
    for threads in ("1", "4"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads, "PYTHONPATH": root}
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
        outputs.add(done.stdout)
    assert len(outputs) == 1
