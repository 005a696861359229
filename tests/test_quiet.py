"""Nothing but answers: no output of ours or of a solver, no warning, no foreign exception, whatever numpy is told."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import statements

EVERY_CALL = """
import warnings
import numpy as np
from malformed_calls import CALLS
from control_kpos.errors import ActuatorLossWarning

warnings.simplefilter("error")
warnings.simplefilter("ignore", ActuatorLossWarning)
with np.errstate(all="MODE"):
    for name, (function, arguments) in CALLS.items():
        if name == "load_certificate":
            continue  # the example is of a file that does not exist
        answer = function(**arguments)
        if not isinstance(answer, type):
            for text in ("explain", "_repr_html_", "__repr__", "__str__"):
                getattr(answer, text, str)()
"""


@pytest.mark.parametrize("mode", ["warn", "raise"])
def test_every_public_function_is_silent(mode, tmp_path):
    tests = Path(__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", EVERY_CALL.replace("MODE", mode)],
        cwd=tmp_path,  # files are written, too
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tests), str(tests.parent)])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("mode", ["warn", "raise"])
def test_no_foreign_error_in_units_of_any_size(mode, tmp_path):
    assert not statements.foreign_errors(120, 7, mode, tmp_path / "c.json")
