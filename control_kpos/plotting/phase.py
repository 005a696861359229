"""Phase portraits: the flow of a system with two states, its cone, and its Lyapunov function."""

from __future__ import annotations

from typing import Any

import control as ct
import numpy as np
import scipy.linalg
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from ..cones import Cone
from ..errors import ConeMismatchError, ShapeError
from ..exact.intake import exact_matrix, flag, real_number, vector, words
from ..exact.matrix import dense
from ..systems.statespace import ConeStateSpace
from .figure import (
    BLUE,
    GREEN,
    ORANGE,
    SKY,
    Points,
    choose_axes,
    control_style,
    fan,
    finished,
    unit,
)

_FLOW = "0.72"
_N_LEVELS = 4
_N_TRAJECTORIES = 5
_N_DISCRETE_STEPS = 12
# Where trajectories start, between the origin and the border of the plot: far out if they come in,
# near if they go out.
_START, _START_UNSTABLE = 0.8, 0.15


def phase_portrait(
    sys: Any,
    pointdata: ArrayLike | None = None,
    timedata: float | None = None,
    *,
    X: Cone | ArrayLike | None = None,
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
    pointdata : array_like, shape (4,), optional
        Limits [xmin, xmax, ymin, ymax] of the plot; default [-1, 1, -1, 1].
    timedata : float, optional
        Duration of the trajectories, in units of time; default about five times the slowest time
        constant, or twelve steps in discrete time.
    X : Cone, or array_like of its generators, optional
        Proper cone in R^2; default `sys.X`, or the orthant for a system without cones.
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
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Not two states, data that are not usable, a cone of another dimension or one that is not proper.
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
    system = _system(sys, X)
    X, duration = system.X, _steps_or_duration(timedata, system)
    window, initial_states = _window(pointdata, initial_states)
    dominant_direction = flag(dominant_direction, "dominant_direction")
    show_legend = flag(show_legend, "show_legend")
    if not isinstance(level_lines, (bool, np.bool_)):
        level_lines = _level_vector(level_lines, X)
    A, discrete = np.asarray(system.A, dtype=float), system.isdtime(strict=True)
    title, user_ax = words(title, "title"), ax
    with control_style():
        ax = choose_axes(ax, "rectilinear")
        if discrete:
            if kwargs:
                raise TypeError(f"unrecognized keywords for a discrete-time phase portrait: {', '.join(kwargs)}.")
            lines: list[Any] = [[], None, [], None]
            ax.set(xlim=window[:2], ylim=window[2:])
        else:
            lines = _flow(system, window, duration, ax, kwargs)
        region = _clip(X, window)
        lines.append(_draw_region(ax, X, region))
        lines.append(_draw_level_lines(ax, system, region, level_lines))
        starts = _spread(A, X, discrete, window) if initial_states is None else initial_states
        lines.append(_draw_trajectories(ax, A, discrete, starts, duration, window))
        lines.append(_draw_dominant_direction(ax, A, discrete, window) if dominant_direction else [])
        ax.set(xlim=window[:2], ylim=window[2:], xlabel=system.state_labels[0], ylabel=system.state_labels[1])
        return finished(lines, ax, user_ax, title, f"Phase portrait for {system.name}", legend=show_legend)


# -- intake


def _system(sys: Any, X: Cone | ArrayLike | None) -> ConeStateSpace:
    """The system given, or the matrix as a system, with two states and the cone that is to be drawn."""
    if not isinstance(sys, ct.StateSpace):
        A = dense(exact_matrix(sys, "sys").values)
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
    return sys if X is None and isinstance(sys, ConeStateSpace) else ConeStateSpace(sys, X=X, name=sys.name)


def _steps_or_duration(timedata: float | None, sys: ConeStateSpace) -> float | None:
    if timedata is None:
        return None
    duration = real_number(timedata, "timedata", positive=True)
    return duration / (1 if sys.dt is True else sys.dt) if sys.isdtime(strict=True) else duration


def _window(pointdata: ArrayLike | None, initial_states: ArrayLike | None) -> tuple[Points, Points | None]:
    """Limits [xmin, xmax, ymin, ymax], and where trajectories start."""
    window = vector([-1, 1, -1, 1] if pointdata is None else pointdata, "pointdata", 4)
    if not (window[0] < window[1] and window[2] < window[3]):
        raise ShapeError(
            f"pointdata is {window.tolist()}; it must be [xmin, xmax, ymin, ymax] with xmin < xmax, ymin < ymax."
        )
    if initial_states is None:
        return window, None
    starts = dense(exact_matrix(initial_states, "initial_states").values)
    if starts.shape[1] != 2:
        raise ShapeError(f"initial_states is {starts.shape[0]} x {starts.shape[1]}; each row must have two states.")
    return window, starts


def _level_vector(level_lines: ArrayLike, X: Cone) -> Points:
    """The vector whose level lines are to be drawn, with entries of size one."""
    given = vector(level_lines, "level_lines", 2)
    v = given / (np.abs(given).max() or 1.0)  # so that products do not overflow
    if not (X.rays @ v > 0).all():
        raise ConeMismatchError(f"level_lines is {given.tolist()}, which is not positive on every generator of X.")
    return v


# -- drawing


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


def _flow(sys: ConeStateSpace, window: Points, duration: float | None, ax: Any, kwargs: dict[str, Any]) -> list[Any]:
    chosen = {"plot_separatrices": False, **kwargs}
    if not any(key in kwargs for key in ("plot_streamlines", "plot_vectorfield", "plot_streamplot", "gridtype")):
        chosen["plot_streamplot"] = {"color": _FLOW, "zorder": 1}
    return list(ct.phase_plane_plot(sys, window.tolist(), duration, ax=ax, **chosen).lines)


def _draw_region(ax: Any, X: Cone, region: Points) -> list[Any]:
    if not len(region):
        return []
    patch = ax.add_patch(Polygon(region, closed=True, facecolor=SKY, alpha=0.3, linewidth=0, zorder=0, label="cone"))
    far = 2 * np.abs(region).max()
    rays = [unit(r) * far for r in X.rays]
    return [patch] + [ax.plot([0, r[0]], [0, r[1]], color=BLUE, linewidth=1.8, zorder=2)[0] for r in rays]


def _draw_level_lines(ax: Any, sys: ConeStateSpace, region: Points, level_lines: bool | ArrayLike) -> list[Any]:
    X = sys.X
    if isinstance(level_lines, (bool, np.bool_)):
        certificate = sys.linear_lyapunov() if level_lines else None
        v = certificate.v if certificate else None
    else:
        v = np.asarray(level_lines)
    if v is None or not len(region):
        return []
    at_rays = X.rays @ v
    top = (region @ v).max()
    out = []
    for k in range(1, _N_LEVELS + 1):
        ends = X.rays / at_rays[:, None] * (top * k / (_N_LEVELS + 1))
        label = "level lines of $V(x) = v'x$" if k == 1 else None
        out += ax.plot(*ends.T, color=ORANGE, linestyle="--", linewidth=1.3, zorder=3, label=label)
    return out


def _spread(A: Points, X: Cone, discrete: bool, window: Points) -> Points:
    """States along a line across the cone, part of the way from the origin to the border of the window."""
    width = np.array([window[1] - window[0], window[3] - window[2]])
    modes = np.linalg.eigvals(A)
    grows = np.abs(modes).max() > 1 if discrete else modes.real.max() > 0
    exits = [_exit(d * width, window) for d in fan(X.rays / width, _N_TRAJECTORIES)]
    return (_START_UNSTABLE if grows else _START) * np.array([e for e in exits if e is not None]).reshape(-1, 2)


def _exit(direction: Points, window: Points) -> Points | None:
    """Where the ray from the origin leaves the window; None if the origin is outside."""
    limits = np.where(direction > 0, window[1::2], window[::2])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.min(np.where(direction != 0, limits / direction, np.inf))
    return direction * reach if reach > 0 else None


def _draw_trajectories(
    ax: Any, A: Points, discrete: bool, starts: Points, duration: float | None, window: Points
) -> list[Any]:
    if not len(starts):
        return []
    flow = _orbit(A, duration) if discrete else _exponentials(A, duration)
    width = np.array([window[1] - window[0], window[3] - window[2]])
    style = {"marker": "o", "markersize": 3, "linestyle": ":", "linewidth": 0.9} if discrete else {"linewidth": 1.3}
    out = []
    for k, start in enumerate(starts):
        with np.errstate(over="ignore", invalid="ignore"):
            path = flow @ start
        path = path[np.isfinite(path).all(axis=1) & (np.abs(path) < 100 * np.abs(window).max()).all(axis=1)]
        label = None if k else ("orbits" if discrete else "trajectories")
        out += ax.plot(*path.T, color="black", zorder=4, label=label, **style)
        ax.plot(*start, "o", color="black", markersize=3.5, zorder=4, clip_on=False)
        if not discrete:
            _arrow(ax, path[((path >= window[::2]) & (path <= window[1::2])).all(axis=1)], width)
    return out


def _exponentials(A: Points, duration: float | None) -> Points:
    """e^{At} at times that resolve the fastest and the slowest mode, shape (k, 2, 2)."""
    modes = np.linalg.eigvals(A)
    fast, slow = float(np.abs(modes).max()), abs(float(np.real(modes).max()))
    if duration is None:
        duration = 5 / slow if slow > 1e-6 * fast else 5 / (fast or 1.0)
    turns = np.abs(np.imag(modes)).max() * duration / (2 * np.pi)
    times = np.linspace(0, duration, 200 + min(5000, int(50 * turns)))
    if fast:
        times = np.union1d(times, np.geomspace(min(1e-2 / fast, duration), duration, 200))
    with np.errstate(over="ignore", invalid="ignore"):
        return scipy.linalg.expm(A * times[:, None, None])


def _orbit(A: Points, steps: float | None) -> Points:
    """Powers of A, shape (k, 2, 2)."""
    powers = [np.eye(2)]
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_N_DISCRETE_STEPS if steps is None else int(steps)):
            powers.append(A @ powers[-1])
    return np.array(powers)


def _arrow(ax: Any, path: Points, width: Points) -> None:
    """An arrow head where the path has gone a third of its length, measured on the page."""
    steps = np.linalg.norm(np.diff(path, axis=0) / width, axis=1)
    if len(path) < 3 or not steps.sum():
        return
    i = int(np.searchsorted(np.cumsum(steps), steps.sum() / 3))
    i = min(max(i, 1), len(path) - 1)
    arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.3, "mutation_scale": 11}
    ax.annotate("", path[i], path[i - 1], arrowprops=arrow, zorder=4, annotation_clip=True)


def _draw_dominant_direction(ax: Any, A: Points, discrete: bool, window: Points) -> list[Any]:
    modes, vectors = np.linalg.eig(A)
    k = int(np.argmax(np.abs(modes) if discrete else np.real(modes)))
    if np.imag(modes[k]) != 0:
        return []
    x = unit(np.real(vectors[:, k])) * 2 * np.abs(window).max()
    ends = np.column_stack([-x, x])
    return ax.plot(*ends, color=GREEN, linestyle="-.", linewidth=1.3, zorder=2, label="dominant direction")
