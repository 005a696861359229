"""Cones in the plane and in space."""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import is_color_like
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone, as_cone
from ..errors import DataError, ShapeError
from ..exact.intake import found, real_number, words
from .figure import (
    BLUE,
    GREEN,
    ORANGE,
    PINK,
    UNNAMED,
    YELLOW,
    Points,
    choose_axes,
    control_style,
    fan,
    finished,
    unit,
)

_PALETTE = (BLUE, ORANGE, GREEN, PINK, YELLOW, "black")
# matplotlib multiplies sizes with one another.
_LARGEST = 1e100
_DASHES = ("-", "--", "-.", ":")


def plot_cone(
    X: Cone | ArrayLike,
    ax: Any = None,
    *,
    title: str | None = None,
    size: float = 1.0,
    color: Any = None,
    label: str | None = None,
) -> ct.ControlPlot:
    """Draw a cone in two or three dimensions.

    In the plane the cone is cut off by a circle; in space by a plane that all its rays meet.

    Parameters
    ----------
    X : Cone, or array_like of its generators, shape (p, n)
        Proper cone in R^2 or R^3.
    ax : matplotlib.axes.Axes, optional
        Where to draw; an axes with projection "3d" for a cone in R^3.
    title : str, optional
        Title; default a short description, if `ax` is not given.
    size : float
        Length of the longest ray drawn.
    color : matplotlib color, optional
        Colour of the cone; default the next of the palette on these axes.
    label : str, optional
        Name in the legend; without one there is no legend.

    Returns
    -------
    cplt : control.ControlPlot
        `cplt.lines` has two lists of artists: of the rays, and of the faces.

    Raises
    ------
    ShapeError
        The cone is not in two or three dimensions, or `ax` is not of the same dimension.
    NotProperConeError
        The cone contains a line or has no interior.

    Notes
    -----
    python-control draws into the axes of the current figure if there is one only, and not all of its plots work in
    three dimensions.  Call `plt.figure()` before them when the current figure shows a cone in space.

    Examples
    --------
    >>> import control_kpos as kp
    >>> cplt = kp.plot_cone(kp.lorentz(3, facets=12), title="ice cream")
    >>> cplt.axes[0, 0].name
    '3d'
    """
    X, size = as_cone(X, "X"), real_number(size, "size", positive=True)
    if size > _LARGEST:
        raise DataError(f"size is {size:g}; matplotlib draws numbers up to {_LARGEST:g} only.")
    title, label = words(title, "title"), words(label, "label") or None
    if color is not None and not _is_color(color):
        raise DataError(f"color is {found(color)}; give a matplotlib color.")
    if X.dim not in (2, 3):
        raise ShapeError(
            f"plot_cone draws in two or three dimensions, but X has dimension {X.dim}; draw an image of it, "
            f"X.transform(T) with a matrix T of shape (3, {X.dim})."
        )
    X.require_proper("X")
    projection = "3d" if X.dim == 3 else "rectilinear"
    if isinstance(ax, Axes) and ax.name != projection:
        raise ShapeError(f"X has dimension {X.dim}, so ax must have the projection {projection!r}.")
    user_ax = ax
    with control_style():
        ax = choose_axes(ax, projection)
        next_color, dashes = _next_style(ax)
        color = next_color if color is None else color
        draw = _draw_cone_in_space if X.dim == 3 else _draw_cone_in_plane
        lines = list(draw(ax, X, size, color, dashes, label))
        default = f"Cone with {X.n_rays} rays and {X.n_facets} facets"
        return finished(lines, ax, user_ax, title, default, legend=label is not None)


def _is_color(color: Any) -> bool:
    try:
        return bool(is_color_like(color))
    except (TypeError, ValueError):  # matplotlib 3.9 asks a generator for its length
        return False


def _draw_cone_in_plane(
    ax: Any, X: Cone, size: float, color: Any, dashes: str, label: str | None
) -> tuple[list[Any], list[Any]]:
    arc = size * fan(X.rays, 60)
    sector = Polygon(np.vstack([[0, 0], arc]), closed=True, facecolor=color, alpha=0.3, linewidth=0, zorder=0)
    faces = [ax.add_patch(sector)]
    rays = [ax.plot([0, r[0]], [0, r[1]], color=color, linestyle=dashes, linewidth=1.8)[0] for r in (arc[0], arc[-1])]
    rays[0].set_label(label or UNNAMED)
    ax.axhline(0, color="0.6", linewidth=0.6, zorder=0)
    ax.axvline(0, color="0.6", linewidth=0.6, zorder=0)
    ax.set(xlabel=ax.get_xlabel() or "x[0]", ylabel=ax.get_ylabel() or "x[1]")
    if ax.get_autoscale_on():  # a frame that somebody chose stays
        ax.set_aspect("equal", adjustable="datalim")
    return rays, faces


def _draw_cone_in_space(
    ax: Any, X: Cone, size: float, color: Any, dashes: str, label: str | None
) -> tuple[list[Any], list[Any]]:
    w = X.dual.interior_point
    ends = np.array([unit(r) for r in X.rays])
    ends = ends / (ends @ unit(w))[:, None]
    ends *= size / np.linalg.norm(ends, axis=1).max()
    ring = ends[_around(ends)]
    sides = [np.array([[0.0, 0.0, 0.0], p, q]) for p, q in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    walls = Poly3DCollection(sides, facecolors=color, alpha=0.3, shade=True)
    lid = Poly3DCollection([ring], facecolors=color, edgecolors=color, alpha=0.12, linestyle=":")
    faces = [ax.add_collection3d(walls), ax.add_collection3d(lid)]
    rays = [ax.plot(*np.column_stack([np.zeros(3), r]), color=color, linestyle=dashes, linewidth=1.6)[0] for r in ring]
    rays[0].set_label(label or UNNAMED)
    ax.set(xlabel="x[0]", ylabel="x[1]", zlabel="x[2]")
    ax.set_aspect("equal")
    ax.locator_params(nbins=5)
    return rays, faces


def _around(points: Points) -> NDArray[np.intp]:
    """Order of the corners of a convex polygon in space."""
    middle = points.mean(axis=0)
    _, _, directions = np.linalg.svd(points - middle)
    flat = (points - middle) @ directions[:2].T
    return np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))


def _next_style(ax: Any) -> tuple[str, str]:
    """Colour and line style for one more cone on these axes."""
    drawn = sum(isinstance(child, Poly3DCollection if ax.name == "3d" else Polygon) for child in ax.get_children())
    k = drawn // (2 if ax.name == "3d" else 1)
    return _PALETTE[k % len(_PALETTE)], _DASHES[k % len(_DASHES)]
