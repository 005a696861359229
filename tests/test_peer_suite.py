"""python-control's own tests, with ConeStateSpace in the place of every StateSpace they build."""

import os
import re
import subprocess
import sys
from pathlib import Path

import control as ct
import pytest

import control_kpos as kp

OURS = str(Path(kp.__file__).parent)
THEIRS = Path(ct.__file__).parent / "tests"
FILES = ("statesp_test.py", "bdalg_test.py", "type_conversion_test.py", "namedio_test.py")
built = 0


# -- this module as a plugin of the inner run


def pytest_configure(config):
    """Make StateSpace(...) build a ConeStateSpace, except where this package itself builds a plain one."""

    def make(cls, *args, **kwargs):
        global built
        frame = sys._getframe(1)
        while cls is ct.StateSpace and frame is not None and not frame.f_code.co_filename.startswith(OURS):
            if frame.f_code.co_filename.startswith(str(THEIRS)):
                built += 1
                return object.__new__(kp.ConeStateSpace)
            frame = frame.f_back
        return object.__new__(cls)

    ct.StateSpace.__new__ = make
    kp.ConeStateSpace.__name__ = "StateSpace"  # the tests compare printed names


def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_line(f"{built} systems had cones")


# -- the outer test


@pytest.mark.skipif(not THEIRS.is_dir(), reason="this python-control was installed without its tests")
def test_python_control_tests_pass_with_cone_state_spaces(tmp_path):
    settings = tmp_path / "pytest.ini"
    settings.write_text("[pytest]\nmarkers =\n    slycot: optional\n    noslycot: optional\n    pandas: optional\n")
    files = [str(THEIRS / name) for name in FILES]
    options = ["-q", "-p", "test_peer_suite", "-p", "no:cacheprovider", "-c", str(settings)]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *files],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), str(Path(OURS).parent)])},
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-1000:]
    assert int(re.search(r"(\d+) systems had cones", run.stdout)[1]) > 1000
