"""Pictures of cones and of the flow inside them.

The figures follow python-control: they draw into `ax` if it is given, else into the current figure
if it has a single suitable axes, else into a new one, and return a `control.ControlPlot`.  Colours
are from the Okabe-Ito palette and are never the only difference between two things, so that the
figures stay readable for the colour-blind and in black and white.
"""

from __future__ import annotations

from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np
import scipy.linalg
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike, NDArray

from .arrays import exact_matrix, vector
from .cones import Cone, orthant
from .errors import ConeMismatchError, ShapeError
from .stability import linear_lyapunov

Points = NDArray[np.float64]

CONE, EDGE, LEVEL, FLOW, TRAJECTORY = "#56B4E9", "#0072B2", "#D55E00", "0.72", "black"
_PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "black")
_DASHES = ("-", "--", "-.", ":")
_N_LEVELS = 4
_N_TRAJECTORIES = 5
_N_DISCRETE_STEPS = 12
# Where trajectories start, between the origin and the border of the plot: far out if they come in,
# near if they go out.
_START, _START_UNSTABLE = 0.8, 0.15


def phase_portrait(
    sys: Any,
    X: Cone | None = None,
    *,
    pointdata: ArrayLike | None = None,
    timedata: float | None = None,
    initial_states: ArrayLike | None = None,
    level_lines: bool | ArrayLike = True,
    dominant_direction: bool = False,
    show_legend: bool = True,
    ax: Any = None,
    title: str | None = None,
    **kwargs: Any,
) -> ct.ControlPlot:
    """Draw the flow of a system with two states, its cone, and trajectories inside the cone.

    The flow is that of `control.phase_plane_plot` with zero input.  The cone is shaded below it;
    dashed lines are level lines of the Lyapunov function V(x) = v'x inside the cone, if the system
    is proven stable on it.  In discrete time the orbits are drawn, and no flow.

    Parameters
    ----------
    sys : ConeStateSpace, StateSpace or array_like, shape (2, 2)
        The system, or its matrix A (continuous time).
    X : Cone, optional
        Proper cone in R^2; default `sys.X`, or the orthant for a system without cones.
    pointdata : array_like, shape (4,), optional
        Limits [xmin, xmax, ymin, ymax] of the plot; default [-1, 1, -1, 1].
    timedata : float, optional
        Duration of the trajectories, in units of time; default about five times the slowest time
        constant.
    initial_states : array_like, shape (k, 2), optional
        Where trajectories start; default a few points where the cone leaves the plot.
    level_lines : bool or array_like, shape (2,)
        Whether to draw level lines of V(x) = v'x, or the vector v whose level lines to draw.
    dominant_direction : bool
        Whether to draw the line along the eigenvector of the rightmost eigenvalue, if that is real.
    show_legend : bool
        Whether to explain the lines below the plot.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    title : str, optional
        Title; default "Phase portrait for" and the name of the system, if `ax` is not given.
    **kwargs
        Passed to `control.phase_plane_plot`: `plot_streamlines`, `plot_vectorfield`,
        `plot_separatrices` and so on.

    Returns
    -------
    cplt : control.ControlPlot
        `cplt.lines` has the four entries of `control.phase_plane_plot`, and after them lists of
        artists: of the cone, the level lines, the trajectories, the dominant direction.

    Raises
    ------
    ShapeError, ConeMismatchError, NotProperConeError
        Not two states, a cone of another dimension, or one that is not proper.
    TypeError
        A keyword that neither this function nor `control.phase_plane_plot` knows.

    Notes
    -----
    Takes some tenths of a second, most of it for the flow.

    Examples
    --------
    >>> import control_kpos as kp
    >>> cplt = kp.phase_portrait(kp.examples.mass_spring_node(), pointdata=[-1, 2, -4, 4])
    >>> cplt.axes[0, 0].get_xlabel()
    'position'
    """
    plain, X = _system_and_cone(sys, X)
    window, initial_states = _window(pointdata, initial_states)
    A, discrete = np.asarray(plain.A, dtype=float), plain.isdtime(strict=True)
    user_ax = ax
    with plt.rc_context(ct.config.defaults["ctrlplot.rcParams"]):
        ax = _axes(ax, "rectilinear")
        if discrete:
            if kwargs:
                raise TypeError(f"unrecognized keywords for a discrete-time phase portrait: {', '.join(kwargs)}.")
            lines: list[Any] = [[], None, [], None]
            ax.set(xlim=window[:2], ylim=window[2:])
        else:
            lines = _flow(plain, window, timedata, ax, kwargs)
        region = _clip(X, window)
        lines.append(_draw_region(ax, X, region))
        lines.append(_draw_level_lines(ax, A, X, discrete, region, level_lines))
        starts = _spread(A, X, discrete, window) if initial_states is None else initial_states
        lines.append(_draw_trajectories(ax, A, discrete, starts, timedata, window))
        lines.append(_draw_dominant_direction(ax, A, discrete, window) if dominant_direction else [])
        ax.set(xlim=window[:2], ylim=window[2:], xlabel=plain.state_labels[0], ylabel=plain.state_labels[1])
        legend = _legend_beside(ax) if show_legend else None
        array = np.empty(len(lines), dtype=object)
        array[:] = lines
        cplt = ct.ControlPlot(array, ax, ax.figure, legend=legend)
    _set_title(cplt, user_ax, title, f"Phase portrait for {plain.name}")
    return cplt


def plot_cone(
    X: Cone,
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
    X : Cone
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

    Examples
    --------
    >>> import control_kpos as kp
    >>> cplt = kp.plot_cone(kp.lorentz(3, facets=12), title="ice cream")
    >>> cplt.axes[0, 0].name
    '3d'
    """
    if X.dim not in (2, 3):
        raise ShapeError(
            f"plot_cone draws in two or three dimensions, but X has dimension {X.dim}; draw an image of it, "
            f"X.transform(T) with a matrix T of shape (3, {X.dim})."
        )
    X.require_proper("X")
    projection = "3d" if X.dim == 3 else "rectilinear"
    if ax is not None and getattr(ax, "name", None) != projection:
        raise ShapeError(f"X has dimension {X.dim}, so ax must have the projection {projection!r}.")
    user_ax = ax
    with plt.rc_context(ct.config.defaults["ctrlplot.rcParams"]):
        ax = _axes(ax, projection)
        next_color, dashes = _next_style(ax)
        color = next_color if color is None else color
        draw = _draw_cone_in_space if X.dim == 3 else _draw_cone_in_plane
        lines = np.empty(2, dtype=object)
        lines[:] = draw(ax, X, size, color, dashes, label)
        legend = _legend_beside(ax) if label is not None else None
        cplt = ct.ControlPlot(lines, ax, ax.figure, legend=legend)
    _set_title(cplt, user_ax, title, f"Cone with {X.n_rays} rays and {X.n_facets} facets")
    return cplt


# -- intake


def _system_and_cone(sys: Any, X: Cone | None) -> tuple[Any, Cone]:
    if not isinstance(sys, ct.StateSpace):
        A = np.asarray(exact_matrix(sys, "sys").values)
        if A.shape != (2, 2):
            raise ShapeError(
                f"phase_portrait draws two states, but the matrix given as sys is {A.shape[0]} x {A.shape[1]}."
            )
        sys = ct.StateSpace(A, np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)), name="A")
    if sys.nstates != 2:
        raise ShapeError(
            f"phase_portrait draws two states, but {sys.name} has {sys.nstates}; "
            "plot its outputs over time with control.initial_response instead."
        )
    if X is None:
        X = getattr(sys, "X", None) or orthant(2)
    if X.dim != 2:
        raise ConeMismatchError(f"X has dimension {X.dim}, but {sys.name} has 2 states.")
    X.require_proper("X")
    return sys, X


def _window(pointdata: ArrayLike | None, initial_states: ArrayLike | None) -> tuple[Points, Points | None]:
    """Limits [xmin, xmax, ymin, ymax], and where trajectories start."""
    window = vector([-1, 1, -1, 1] if pointdata is None else pointdata, "pointdata", 4)
    if not (window[0] < window[1] and window[2] < window[3]):
        raise ShapeError(
            f"pointdata is {window.tolist()}; it must be [xmin, xmax, ymin, ymax] with xmin < xmax, ymin < ymax."
        )
    if initial_states is None:
        return window, None
    starts = np.asarray(exact_matrix(initial_states, "initial_states").values)
    if starts.shape[1] != 2:
        raise ShapeError(f"initial_states is {starts.shape[0]} x {starts.shape[1]}; each row must have two states.")
    return window, starts


def _axes(ax: Any, projection: str) -> Any:
    """The axes given, the only one of the current figure if it suits, or a new one."""
    if ax is not None:
        return ax
    figure = plt.gcf()
    present = figure.get_axes()
    if len(present) == 1 and present[0].name == projection:
        return present[0]
    if present:
        figure = plt.figure()
    figure.set_layout_engine("tight")
    return figure.add_subplot(projection=projection)


# -- the plane


def _clip(X: Cone, window: Points) -> Points:
    """Corners of the part of the cone inside the window, in order; perhaps none."""
    xmin, xmax, ymin, ymax = window
    corners = np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])
    for h in X.facets:
        inside, rest = corners @ h, []
        for i, (p, a) in enumerate(zip(corners, inside, strict=True)):
            q, b = corners[i - 1], inside[i - 1]
            if (a < 0) != (b < 0):
                rest.append(q + (p - q) * (b / (b - a)))
            if a >= 0:
                rest.append(p)
        corners = np.array(rest).reshape(-1, 2)
    return corners


def _flow(sys: Any, window: Points, timedata: float | None, ax: Any, kwargs: dict[str, Any]) -> list[Any]:
    chosen = {"plot_separatrices": False, **kwargs}
    if not any(key in kwargs for key in ("plot_streamlines", "plot_vectorfield", "plot_streamplot", "gridtype")):
        chosen["plot_streamplot"] = {"color": FLOW, "zorder": 1}
    return list(ct.phase_plane_plot(sys, window.tolist(), timedata, ax=ax, **chosen).lines)


def _draw_region(ax: Any, X: Cone, region: Points) -> list[Any]:
    if not len(region):
        return []
    patch = ax.add_patch(Polygon(region, closed=True, facecolor=CONE, alpha=0.3, linewidth=0, zorder=0, label="cone"))
    far = 2 * np.abs(region).max()
    rays = [_unit(r) * far for r in X.rays]
    return [patch] + [ax.plot([0, r[0]], [0, r[1]], color=EDGE, linewidth=1.8, zorder=2)[0] for r in rays]


def _draw_level_lines(
    ax: Any, A: Points, X: Cone, discrete: bool, region: Points, level_lines: bool | ArrayLike
) -> list[Any]:
    if isinstance(level_lines, (bool, np.bool_)):
        cert = linear_lyapunov(A, X, discrete=discrete) if level_lines else None
        v = cert.v if cert else None
    else:
        v = vector(level_lines, "level_lines", 2)
    if v is None or not len(region):
        return []
    at_rays = X.rays @ v
    top = (region @ v).max()
    if not (at_rays > 0).all():
        raise ConeMismatchError(f"level_lines is {v.tolist()}, which is not positive on every generator of X.")
    out = []
    for k in range(1, _N_LEVELS + 1):
        ends = X.rays / at_rays[:, None] * (top * k / (_N_LEVELS + 1))
        label = "level lines of $V(x) = v'x$" if k == 1 else None
        out += ax.plot(*ends.T, color=LEVEL, linestyle="--", linewidth=1.3, zorder=3, label=label)
    return out


def _spread(A: Points, X: Cone, discrete: bool, window: Points) -> Points:
    """States along a line across the cone, part of the way from the origin to the border of the window."""
    width = np.array([window[1] - window[0], window[3] - window[2]])
    modes = np.linalg.eigvals(A)
    grows = np.abs(modes).max() > 1 if discrete else modes.real.max() > 0
    exits = [_exit(d * width, window) for d in _fan(X.rays / width, _N_TRAJECTORIES)]
    return (_START_UNSTABLE if grows else _START) * np.array([e for e in exits if e is not None]).reshape(-1, 2)


def _fan(rays: Points, count: int) -> Points:
    """Unit vectors from the first of two rays to the second, at equal angles."""
    first, last = (_unit(r) for r in rays)
    turn = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last) * np.linspace(0, 1, count)[:, None]
    return np.cos(turn) * first + np.sin(turn) * np.array([-first[1], first[0]])


def _exit(direction: Points, window: Points) -> Points | None:
    """Where the ray from the origin leaves the window; None if the origin is outside."""
    limits = np.where(direction > 0, window[1::2], window[::2])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.min(np.where(direction != 0, limits / direction, np.inf))
    return direction * reach if reach > 0 else None


def _draw_trajectories(
    ax: Any, A: Points, discrete: bool, starts: Points, timedata: float | None, window: Points
) -> list[Any]:
    if not len(starts):
        return []
    flow = _orbit(A, timedata) if discrete else _exponentials(A, timedata)
    width = np.array([window[1] - window[0], window[3] - window[2]])
    style = {"marker": "o", "markersize": 3, "linestyle": ":", "linewidth": 0.9} if discrete else {"linewidth": 1.3}
    out = []
    for k, start in enumerate(starts):
        with np.errstate(over="ignore", invalid="ignore"):
            path = flow @ start
        path = path[np.isfinite(path).all(axis=1) & (np.abs(path) < 100 * np.abs(window).max()).all(axis=1)]
        label = None if k else ("orbits" if discrete else "trajectories")
        out += ax.plot(*path.T, color=TRAJECTORY, zorder=4, label=label, **style)
        ax.plot(*start, "o", color=TRAJECTORY, markersize=3.5, zorder=4, clip_on=False)
        if not discrete:
            _arrow(ax, path[((path >= window[::2]) & (path <= window[1::2])).all(axis=1)], width)
    return out


def _exponentials(A: Points, duration: float | None) -> Points:
    """e^{At} at times that resolve the fastest and the slowest mode, shape (k, 2, 2)."""
    modes = np.linalg.eigvals(A)
    fast, slow = np.abs(modes).max(), np.abs(modes.real.max())
    if duration is None:
        duration = 5 / slow if slow > 1e-6 * fast else 5 / (fast or 1.0)
    turns = np.abs(modes.imag).max() * duration / (2 * np.pi)
    times = np.linspace(0, duration, 200 + min(5000, int(50 * turns)))
    if fast:
        times = np.union1d(times, np.geomspace(min(1e-2 / fast, duration), duration, 200))
    with np.errstate(over="ignore", invalid="ignore"):
        return scipy.linalg.expm(A * times[:, None, None])


def _orbit(A: Points, duration: float | None) -> Points:
    """Powers of A, shape (k, 2, 2)."""
    powers = [np.eye(2)]
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_N_DISCRETE_STEPS if duration is None else int(duration)):
            powers.append(A @ powers[-1])
    return np.array(powers)


def _arrow(ax: Any, path: Points, width: Points) -> None:
    """An arrow head where the path has gone a third of its length, measured on the page."""
    steps = np.linalg.norm(np.diff(path, axis=0) / width, axis=1)
    if len(path) < 3 or not steps.sum():
        return
    i = int(np.searchsorted(np.cumsum(steps), steps.sum() / 3))
    i = min(max(i, 1), len(path) - 1)
    arrow = {"arrowstyle": "-|>", "color": TRAJECTORY, "linewidth": 1.3, "mutation_scale": 11}
    ax.annotate("", path[i], path[i - 1], arrowprops=arrow, zorder=4, annotation_clip=True)


def _draw_dominant_direction(ax: Any, A: Points, discrete: bool, window: Points) -> list[Any]:
    modes, vectors = np.linalg.eig(A)
    k = int(np.argmax(np.abs(modes) if discrete else modes.real))
    if modes[k].imag != 0:
        return []
    x = _unit(vectors[:, k].real) * 2 * np.abs(window).max()
    ends = np.column_stack([-x, x])
    return ax.plot(*ends, color="#009E73", linestyle="-.", linewidth=1.3, zorder=2, label="dominant direction")


# -- cones alone


def _draw_cone_in_plane(
    ax: Any, X: Cone, size: float, color: Any, dashes: str, label: str | None
) -> tuple[list[Any], list[Any]]:
    arc = size * _fan(X.rays, 60)
    sector = Polygon(
        np.vstack([[0, 0], arc]), closed=True, facecolor=color, alpha=0.3, linewidth=0, zorder=0
    )
    faces = [ax.add_patch(sector)]
    rays = [ax.plot([0, r[0]], [0, r[1]], color=color, linestyle=dashes, linewidth=1.8)[0] for r in (arc[0], arc[-1])]
    rays[0].set_label(label)
    ax.axhline(0, color="0.6", linewidth=0.6, zorder=0)
    ax.axvline(0, color="0.6", linewidth=0.6, zorder=0)
    ax.set(xlabel="x[0]", ylabel="x[1]")
    ax.set_aspect("equal", adjustable="datalim")
    return rays, faces


def _draw_cone_in_space(
    ax: Any, X: Cone, size: float, color: Any, dashes: str, label: str | None
) -> tuple[list[Any], list[Any]]:
    w = X.dual.interior_point
    ends = np.array([_unit(r) for r in X.rays])
    ends = ends / (ends @ _unit(w))[:, None]
    ends *= size / np.linalg.norm(ends, axis=1).max()
    ring = ends[_around(ends)]
    sides = [np.array([[0.0, 0.0, 0.0], p, q]) for p, q in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    walls = Poly3DCollection(sides, facecolors=color, alpha=0.3, shade=True)
    lid = Poly3DCollection([ring], facecolors=color, edgecolors=color, alpha=0.12, linestyle=":")
    faces = [ax.add_collection3d(walls), ax.add_collection3d(lid)]
    rays = [ax.plot(*np.column_stack([np.zeros(3), r]), color=color, linestyle=dashes, linewidth=1.6)[0] for r in ring]
    rays[0].set_label(label)
    ax.set(xlabel="x[0]", ylabel="x[1]", zlabel="x[2]")
    ax.set_aspect("equal")
    return rays, faces


def _around(points: Points) -> NDArray[np.intp]:
    """Order of the corners of a convex polygon in space."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle)
    flat = (points - middle) @ axes[:2].T
    return np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))


# -- small things


def _unit(x: Points) -> Points:
    x = x / np.abs(x).max()  # first, so that the norm neither overflows nor underflows
    return x / np.linalg.norm(x)


def _next_style(ax: Any) -> tuple[str, str]:
    """Colour and line style for one more cone on these axes."""
    drawn = sum(isinstance(child, Poly3DCollection if ax.name == "3d" else Polygon) for child in ax.get_children())
    k = drawn // (2 if ax.name == "3d" else 1)
    return _PALETTE[k % len(_PALETTE)], _DASHES[k % len(_DASHES)]


def _legend_beside(ax: Any) -> Any:
    """A legend outside the data."""
    if ax.name == "3d":
        return ax.legend(loc="upper left", bbox_to_anchor=(0, 1), frameon=False)
    return ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=4, frameon=False, borderaxespad=0)


def _set_title(cplt: ct.ControlPlot, user_ax: Any, title: str | None, default: str) -> None:
    if user_ax is None:
        cplt.set_plot_title(default if title is None else title)
    elif title is not None:
        user_ax.set_title(title)
