"""Pictures of a design: what a decay rate costs, and the flow before and after feedback."""

from __future__ import annotations

from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np

from ..cards import floored
from ..design import DesignResult, OptimalFeedback
from ..design.tradeoff import Tradeoff
from ..errors import DataError
from ..exact.intake import found, words
from ..find import CodesignResult
from .figure import (
    BLUE,
    ORANGE,
    choose_axes,
    control_style,
    legend_beside,
    set_title,
)
from .phase import phase_portrait


def plot_tradeoff(curve: Tradeoff, *, ax: Any = None, title: str | None = None) -> ct.ControlPlot:
    """Smallest gain against decay rate, with the largest rate, as computed, as a line and proven designs as markers.

    Parameters
    ----------
    curve : Tradeoff
        From `gain_rate_tradeoff`.
    ax : matplotlib Axes, optional
        Where to draw; default as in python-control.
    title : str, optional

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    DataError
        No rate of the curve is within reach.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
    >>> curve = kp.gain_rate_tradeoff(plant, X=[[0, 1], [1, -1]])
    >>> cplt = kp.plot_tradeoff(curve)
    """
    if not isinstance(curve, Tradeoff):
        raise DataError(f"curve is {found(curve)}; give what gain_rate_tradeoff returns.")
    title, held = words(title, "title"), np.isfinite(curve.gains)
    if not held.any():
        raise DataError("no decay rate of the curve is within reach; there is nothing to draw.")
    with control_style():
        axes = choose_axes(ax, "rectilinear", "gain and rate")
        lines = axes.plot(curve.rates[held], curve.gains[held], "-", color=BLUE, label="smallest gain (linear program)")
        if np.isfinite(curve.largest_rate):
            lines.append(
                axes.axvline(curve.largest_rate, color="black", linestyle=":", label="largest decay rate (computed)")
            )
        proven = [d for d in curve.designs if d]
        if proven:
            points = [d.decay_rate for d in proven], [d.value for d in proven]
            lines += axes.plot(*points, "o", color=ORANGE, markerfacecolor="none", label="proven designs")
        axes.set_xlabel("decay rate [1/time]")
        axes.set_ylabel("gain max |F x_k| at the generators of X")
        axes.set_ylim(bottom=0, top=1.15 * float(curve.gains[held].max()) or 1.0)
        axes.grid(True, alpha=0.3)
        legend = legend_beside(axes)
        grid = np.empty((1, 1), dtype=object)
        grid[0, 0] = axes
        cplt = ct.ControlPlot(np.array([[lines]], dtype=object), grid, axes.figure, legend=legend)
        set_title(cplt, ax, title, "Gain against decay rate")
    return cplt


def plot_closed_loop(
    sys: Any, design: DesignResult | OptimalFeedback | CodesignResult, *, title: str | None = None, **kwargs: Any
) -> ct.ControlPlot:
    """Phase portraits of a plant with two states without and with the feedback, side by side; of modes one for each.

    Parameters
    ----------
    sys : control.StateSpace or ConeStateSpace
        The plant that was designed for.
    design : DesignResult, OptimalFeedback or CodesignResult
        With a gain; with a `horizon` its first gain is drawn.
    title : str, optional
    **kwargs
        Keywords of `phase_portrait`, such as `pointdata`.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    DataError
        The design has no gain, or is one of an observer or a network; the plant does not have two states.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> plant = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
    >>> d = kp.state_feedback(plant, X=[[0, 1], [1, -2]])
    >>> cplt = kp.plot_closed_loop(plant, d)
    """
    title = words(title, "title")
    if not isinstance(sys, ct.StateSpace):
        raise DataError(f"sys is {found(sys)}; give the plant, a StateSpace.")
    if not isinstance(design, (DesignResult, OptimalFeedback, CodesignResult)):
        raise DataError(f"design is {found(design)}; give what a design function returns, such as state_feedback.")
    if not design:
        raise DataError(f"design is {design.status.name}, without a gain to draw; see design.explain().")
    loops = _loops(design)
    if any(loop.nstates != 2 or not hasattr(loop, "X") for _, loop in loops):
        raise DataError("plot_closed_loop draws feedback for one plant with two states, not an observer or a network.")
    X = loops[0][1].X
    with control_style():
        figure, axes = plt.subplots(1, 1 + len(loops), figsize=(4.8 * (1 + len(loops)), 4.2), layout="tight")
        open_loop = ct.ss(sys.A, sys.B, sys.C, sys.D, sys.dt, states=sys.state_labels)
        parts = [
            phase_portrait(open_loop, X=X, ax=axes[0], title="without feedback", **{"level_lines": False, **kwargs}),
            *(
                phase_portrait(loop, ax=ax, title=name, **kwargs)
                for (name, loop), ax in zip(loops, axes[1:], strict=True)
            ),
        ]
        cplt = ct.ControlPlot(np.array([part.lines for part in parts], dtype=object), np.array([axes]), figure)
        cplt.set_plot_title("Open and closed loop" if title is None else title)
    return cplt


def _loops(design: Any) -> list[tuple[str, Any]]:
    """The closed loops with a title for each."""
    if isinstance(design, CodesignResult):
        return [("u = F x, with its cone", design.closed_loop)]
    if isinstance(design, OptimalFeedback):
        steps = np.ndim(design.F) == 3
        return [("first gain of the horizon, held" if steps else "least cost", design.closed_loop)]
    if isinstance(design.closed_loop, tuple):
        return [(f"mode {s}, {design.law}", loop) for s, loop in enumerate(design.closed_loop)]
    return [(f"{design.law}, decay rate {floored(design.decay_rate, 3)}", design.closed_loop)]
