"""Settings shared by the tests, the docstring examples and the benchmarks."""

import os

# Before anything imports numpy or matplotlib.pyplot, and python-control imports both.  Tests run in
# parallel and benchmarks are compared with one another; threads in the linear algebra disturb both.
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control as ct
import matplotlib.pyplot as plt
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import control_kpos as kp

# No deadline: the same example may take ten times longer on a loaded machine.  "thorough" is for
# HYPOTHESIS_PROFILE=thorough, before a release.
# With CI set the examples are the same in every run.
settings.register_profile(
    "default",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize="CI" in os.environ,
)
settings.register_profile("thorough", settings.get_profile("default"), max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


@pytest.fixture(autouse=True)
def _fresh_state():
    """Close figures and undo changed defaults, so that the order of the tests does not matter."""
    defaults = dict(ct.config.defaults)
    yield
    plt.close("all")
    ct.config.defaults.clear()
    ct.config.defaults.update(defaults)


@pytest.fixture(autouse=True)
def _names_in_docstrings(doctest_namespace):
    """Names that the examples in docstrings take for granted."""
    doctest_namespace.update(ct=ct, kp=kp, np=np)
