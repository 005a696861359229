"""The flow before and after feedback."""

from __future__ import annotations

from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np

from ..errors import DataError
from ..synthesis import DesignResult
from .figure import control_style
from .phase import phase_portrait


def plot_closed_loop(sys: Any, design: DesignResult, *, title: str | None = None, **kwargs: Any) -> ct.ControlPlot:
    """Phase portraits of a plant with two states without and with the feedback, side by side.

    Parameters
    ----------
    sys : control.StateSpace or ConeStateSpace
        The plant that was designed for.
    design : DesignResult
        With a gain.
    title : str, optional
    **kwargs
        Keywords of `phase_portrait`, such as `pointdata`.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    DataError
        The design has no gain, or the plant does not have two states.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
    >>> d = kp.state_feedback(plant, X=[[0, 1], [1, -2]])
    >>> cplt = kp.plot_closed_loop(plant, d)
    """
    if not design or design.closed_loop.nstates != 2 or not hasattr(design.closed_loop, "X"):
        raise DataError("plot_closed_loop needs a successful design for a plant with two states.")
    X = design.closed_loop.X
    with control_style():
        figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="tight")
        open_loop = ct.ss(sys.A, sys.B, sys.C, sys.D, sys.dt)
        parts = [
            phase_portrait(open_loop, X=X, ax=axes[0], title="without feedback", **{"level_lines": False, **kwargs}),
            phase_portrait(
                design.closed_loop, ax=axes[1], title=f"u = F x, decay rate {design.decay_rate:.3g}", **kwargs
            ),
        ]
        cplt = ct.ControlPlot(np.array([part.lines for part in parts], dtype=object), np.array([axes]), figure)
        cplt.set_plot_title("Open and closed loop" if title is None else title)
    return cplt
