"""The band in which an interval observer holds the states of a plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import ArrayLike

from ..errors import DataError, ShapeError
from ..exact.intake import exact_matrix, found, places
from ..observers import IntervalObserver
from .figure import BLUE, ORANGE, control_style, set_title

# States that one picture shows.
_ROWS = 20


def plot_observer(
    observer: IntervalObserver,
    T: ArrayLike,
    y: ArrayLike,
    u: ArrayLike | None = None,
    *,
    x0: Any,
    states: ArrayLike | None = None,
    which: Sequence[int] | None = None,
    title: str | None = None,
) -> ct.ControlPlot:
    """Draw the bounds on every state over time as a band, and the states inside where they are known.

    Parameters
    ----------
    observer : IntervalObserver
        From `interval_observer`.
    T, y, u, x0
        As in `IntervalObserver.simulate`.
    states : array_like, shape (n, k), optional
        The states of the plant, of a simulation.
    which : sequence of int, optional
        Places of the states to draw; default: all, up to 20.
    title : str, optional

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    DataError, ShapeError
        As in `IntervalObserver.simulate`; states of another size; more than 20 of them to draw.

    Examples
    --------
    >>> import control as ct, control_kpos as kp
    >>> o = kp.interval_observer(ct.ss(-1, 1, 1, 0), disturbance=([-1], [1]), noise=[0.1])
    >>> cplt = kp.plot_observer(o, [0, 1, 2], [0, 0, 0], x0=([-1], [1]))
    """
    if not isinstance(observer, IntervalObserver):
        raise DataError(f"observer is {found(observer)}; give what interval_observer returns.")
    lower, upper = observer.simulate(T, y, u, x0=x0)
    times = np.asarray(exact_matrix(T, "T", ndim=1).dense().values, dtype=float)
    known = None if states is None else np.asarray(exact_matrix(states, "states").dense().values, dtype=float)
    if known is not None and known.shape != lower.shape:
        raise ShapeError(f"states has shape {known.shape}; it must be {lower.shape}, one row per state.")
    chosen = _chosen(which, len(lower))
    names = [] if observer.system is None else [label.removesuffix("_hi") for label in observer.system.state_labels]
    with control_style():
        count = len(chosen)
        figure, grid = plt.subplots(
            count, 1, sharex=True, squeeze=False, figsize=(6.4, 1.2 + 1.8 * count), layout="tight"
        )
        lines = []
        for i, axes in zip(chosen, grid[:, 0], strict=True):
            drawn = [axes.fill_between(times, lower[i], upper[i], color=BLUE, alpha=0.2, label="bounds")]
            drawn += axes.plot(times, lower[i], "-", times, upper[i], "-", color=BLUE, linewidth=1)
            if known is not None:
                drawn += axes.plot(times, known[i], "--", color=ORANGE, label="state")
            axes.set_ylabel(names[i])
            axes.grid(True, alpha=0.3)
            lines.append(drawn)
        grid[-1, 0].set_xlabel("time")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        shown = [(h, text) for h, text in zip(handles, labels, strict=True) if not text.startswith("_")]
        # above the axes, on the right, where nothing is drawn
        place: dict[str, Any] = {
            "loc": "lower right",
            "bbox_to_anchor": (1, 1.01),
            "borderaxespad": 0,
            "frameon": False,
        }
        legend = grid[0, 0].legend(*zip(*shown, strict=True), ncols=len(shown), **place)
        array = np.empty((count, 1), dtype=object)
        for i, drawn in enumerate(lines):
            array[i, 0] = drawn
        cplt = ct.ControlPlot(array, grid, figure, legend=legend)
        set_title(cplt, None, title, "Bounds on the states")
    return cplt


def _chosen(which: Any, count: int) -> list[int]:
    """Places of the states to draw."""
    picked = list[int]()
    for item in range(count) if which is None else places(which, "which"):
        if isinstance(item, str) or not 0 <= item < count:
            raise ShapeError(f"which holds {item!r}; the {count} states are numbered 0 to {count - 1}.")
        picked.append(item)
    if not 0 < len(picked) <= _ROWS:
        raise DataError(f"{len(picked)} states are too many or too few for one picture; choose 1 to {_ROWS} by which.")
    return picked
