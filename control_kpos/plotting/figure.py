"""What the figures have in common.

They follow python-control: they draw into `ax` if it is given, else into the current figure if it has
a single axes with the same kind of picture, else into a new one, and return a `control.ControlPlot`.
Colours are from the Okabe-Ito palette and are never the only difference between two things, so that
the figures stay readable for the colour-blind and in black and white.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

import control as ct
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..errors import DataError, ShapeError
from ..exact.intake import found, words

Points: TypeAlias = NDArray[np.float64]

BLUE, ORANGE, GREEN, PINK, YELLOW, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
# The label of what has no place in a legend: python-control reads the labels of all lines, and None is no text.
UNNAMED = "_nolegend_"
# Letters of a row of a legend that fit below a picture.
_LETTERS = 104


@contextmanager
def control_style() -> Iterator[None]:
    """python-control's settings of matplotlib; underflow in what is drawn disturbs nobody."""
    # Loads the backend.  In a notebook that turns interactive mode on, which would be undone at the end
    # of the context if the first figure were made inside: only that one would ever be shown.
    plt.draw_if_interactive()
    with plt.rc_context(ct.config.defaults["ctrlplot.rcParams"]), np.errstate(all="ignore"):
        yield


def choose_axes(ax: Any, projection: str, kind: str | None = None) -> Any:
    """The axes given, the only one of the current figure if it suits, or a new one.

    Pictures of a plane or of space (no `kind`) go over whatever is there on linear axes.  Others go over
    their own kind only: poles over poles, never a graph over poles.
    """
    if ax is not None:
        require_axes(ax, projection)
        return ax
    figure = plt.gcf()
    present = figure.get_axes()
    if len(present) == 1 and _suits(present[0], projection, kind):
        present[0].set_gid(kind)
        return present[0]
    if present:
        figure = plt.figure()
    figure.set_layout_engine("tight")
    axes = figure.add_subplot(projection=projection)
    axes.set_gid(kind)
    return axes


def require_axes(ax: Any, projection: str) -> None:
    """Refuse what is no axes of this projection."""
    if not isinstance(ax, Axes):
        raise DataError(f"ax is {found(ax)}; give matplotlib axes.")
    if ax.name != projection:
        raise ShapeError(f"ax has the projection {ax.name!r}; this picture needs {projection!r}.")


def _suits(axes: Any, projection: str, kind: str | None) -> bool:
    linear = axes.get_xscale() == axes.get_yscale() == "linear"
    return axes.name == projection and (
        not axes.has_data() or (axes.get_gid() == kind and (kind is not None or linear))
    )


def legend_beside(ax: Any) -> Any:
    """A legend outside the data, each name once however often a picture is drawn over another."""
    handles, labels = ax.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    names: dict[str, Any] = {"handles": list(once.values()), "labels": list(once), "frameon": False}
    if ax.name == "3d":
        return ax.legend(loc="upper left", bbox_to_anchor=(0, 1), **names)
    columns = max(1, min(4, _LETTERS // (max(map(len, once), default=0) + 8)))  # besides a handle, and gaps
    return ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=columns, borderaxespad=0, **names)


def finished(
    lines: list[Any], ax: Any, user_ax: Any, title: str | None, default: str, *, legend: bool = True
) -> ct.ControlPlot:
    """The picture of these lists of artists, with its legend and title."""
    array = np.empty(len(lines), dtype=object)
    array[:] = lines
    cplt = ct.ControlPlot(array, ax, ax.figure, legend=legend_beside(ax) if legend else None)
    set_title(cplt, user_ax, title, default)
    return cplt


def set_title(cplt: ct.ControlPlot, user_ax: Any, title: str | None, default: str) -> None:
    """Title of the figure if it is ours, of the axes if they are given."""
    title = words(title, "title")
    if user_ax is None:
        cplt.set_plot_title(default if title is None else title)
    elif title is not None:
        user_ax.set_title(title)


def unit(x: Points) -> Points:
    """A vector divided by its length."""
    x = x / np.abs(x).max()  # first, so that the norm neither overflows nor underflows
    return x / np.linalg.norm(x)


def fan(rays: Points, count: int) -> Points:
    """Unit vectors from the first of two rays to the second, at equal angles."""
    first, last = (unit(r) for r in rays)
    turn = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last) * np.linspace(0, 1, count)[:, None]
    return np.cos(turn) * first + np.sin(turn) * np.array([-first[1], first[0]])
