"""Networks: margins over the graph, the pattern of the closed loop, and poles beside the certified bound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import control as ct
import numpy as np
import scipy.sparse as sp
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Circle, Rectangle
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import shortest_path

from ..cards import raised
from ..errors import DataError, ShapeError
from ..exact.intake import exact_matrix, found, whole_number, words
from ..exact.matrix import dense
from ..networks import ConeNetwork
from .figure import (
    BLUE,
    ORANGE,
    SKY,
    Points,
    choose_axes,
    control_style,
    finished,
)

# More nodes than this are not drawn one by one; of more than that only those that matter get a name.
MOST_NODES = 400
_MOST_NAMES = 30
_MOST_ARROWS = 60
# Entries drawn one by one; of more, the density.
_MOST_ENTRIES = 20_000
_BINS = 400
_RIGHTMOST = 60
# Rounds of the layout of a graph.
_ROUNDS = 150


def plot_network(
    net: ConeNetwork,
    ax: Any = None,
    *,
    positions: ArrayLike | Mapping[str, ArrayLike] | None = None,
    title: str | None = None,
) -> ct.ControlPlot:
    """Draw a network: its nodes coloured by margin, or for a large one the pattern of its closed loop.

    Up to 400 nodes are drawn as a graph.  Light nodes are the weak ones, and the weakest is ringed; if
    the network is refuted, the nodes and the link that break it are.  Names that would cover something are
    left out.  Of larger networks the nonzero
    entries of the closed-loop matrix are shown.

    Parameters
    ----------
    net : ConeNetwork
        As `feedback_interconnect` returns it.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    positions : array_like, shape (N, 2), or mapping from node names to pairs, optional
        Where nodes stand; default: chosen so that distances resemble numbers of links.
    title : str, optional
        Title; default the name of the network and its verdict, if `ax` is not given.

    Returns
    -------
    cplt : control.ControlPlot
        `cplt.lines` has three lists of artists: links, nodes, marks; of a large network the first holds
        the pattern.

    Raises
    ------
    DataError, ShapeError
        Not a network; positions that do not fit.

    Notes
    -----
    The layout takes about a second for 400 nodes.

    Examples
    --------
    >>> import control_kpos as kp
    >>> node = kp.examples.mass_spring_node()
    >>> cplt = kp.plot_network(kp.feedback_interconnect([node] * 6, kp.examples.ring(6)))
    >>> links, nodes, marks = cplt.lines
    """
    _require_network(net)
    title, user_ax, n_nodes = words(title, "title"), ax, net.model.n_nodes
    with control_style():
        ax = choose_axes(ax, "rectilinear", "network")
        if n_nodes > MOST_NODES:
            what = f"{net.name}: closed loop of {n_nodes} nodes, {net.sparse_A.nnz} entries"
            return finished([_draw_pattern(ax, net.sparse_A), [], []], ax, user_ax, title, what, legend=False)
        links = _links(net)
        xy = graph_layout(links) if positions is None else _positions(positions, net)
        lines = _draw_graph(ax, net, links, xy)
        what = f"{net.name}: {n_nodes} nodes, {net.certificate.status.name}"
        cplt = finished(lines, ax, user_ax, title, what, legend=bool(ax.get_legend_handles_labels()[0]))
        cplt.lines[2] = _legible(ax, cplt.lines[2], xy)
        return cplt


def plot_poles(net: ConeNetwork, ax: Any = None, *, k: int | None = None, title: str | None = None) -> ct.ControlPlot:
    """Draw the poles of a network and the region that is proven to hold none.

    Poles are computed in floating point; the bound is proven without them.

    Parameters
    ----------
    net : ConeNetwork
        A positive network, stable or not.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    k : int, optional
        How many of the rightmost poles to draw; default all of a network of up to 400 states, else 60.
    title : str, optional
        Title; default the name of the network, if `ax` is not given.

    Returns
    -------
    cplt : control.ControlPlot
        `cplt.lines` has two lists of artists: the poles, and the bound.

    Raises
    ------
    DataError, UndecidedError
        Not a network; a network whose spectral abscissa cannot be bracketed, as it is not positive.

    Examples
    --------
    >>> import control_kpos as kp
    >>> node = kp.examples.mass_spring_node()
    >>> cplt = kp.plot_poles(kp.feedback_interconnect([node] * 6, kp.examples.ring(6)))
    >>> cplt.axes[0, 0].get_xlabel()
    'real part'
    """
    _require_network(net)
    title, k = words(title, "title"), None if k is None else whole_number(k, "k", least=1)
    user_ax, upper = ax, net.spectral_abscissa()[1]
    count = (net.nstates if net.nstates <= MOST_NODES else _RIGHTMOST) if k is None else k
    poles = net.poles(min(count, net.nstates))
    with control_style():
        ax = choose_axes(ax, "rectilinear", "poles")
        label = "poles" if len(poles) == net.nstates else f"{len(poles)} of {net.nstates} poles"
        drawn = ax.plot(poles.real, poles.imag, "x", color="black", markersize=5, label=label, zorder=3)
        bound = _draw_disc(ax, upper) if net.model.discrete else _draw_half_plane(ax, upper, poles)
        ax.set(xlabel="real part", ylabel="imaginary part")
        return finished([drawn, bound], ax, user_ax, title, f"Poles of {net.name}")


# -- intake


def _require_network(net: Any) -> None:
    if not isinstance(net, ConeNetwork):
        raise DataError(f"net is {found(net)}; give a network, as feedback_interconnect(systems, coupling) returns it.")


def _positions(positions: Any, net: ConeNetwork) -> Points:
    if isinstance(positions, Mapping):
        missing = [name for name in net.model.names if name not in positions]
        if missing:
            raise DataError(f"positions has no entry for {missing[0]!r} ({len(missing)} nodes are missing).")
        positions = [positions[name] for name in net.model.names]
    xy = dense(exact_matrix(positions, "positions").values)
    if xy.shape != (net.model.n_nodes, 2):
        raise ShapeError(f"positions is {xy.shape[0]} x {xy.shape[1]}; it must be {net.model.n_nodes} x 2.")
    return xy


def _links(net: ConeNetwork) -> sp.csr_array:
    """Largest entry of every block of the coupling, shape (N, N): row j listens to column k."""
    W, n_nodes = sp.coo_array(net.model.W), net.model.n_nodes
    j, k = net.model.owners(1)[W.coords[0]], net.model.owners(2)[W.coords[1]]
    keep = W.data != 0
    return sp.csr_array((np.abs(W.data[keep]), (j[keep], k[keep])), shape=(n_nodes, n_nodes))


# -- drawing


def graph_layout(links: sp.csr_array) -> Points:
    """Coordinates of the nodes, shape (N, 2), by stress majorisation from classical scaling.

    Minimises the sum over pairs of (distance - number of links between)^2; every round is one step of
    SMACOF with unit weights.  Dense in the number of nodes: for graphs that a person can look at.
    """
    n_nodes = links.shape[0]
    if n_nodes == 1:
        return np.zeros((1, 2))
    hops = shortest_path(abs(links), directed=False, unweighted=True)
    near = np.isfinite(hops)
    hops[~near] = hops[near].max(initial=1.0) + 2  # parts without links between them stand apart
    centred = hops**2 - (hops**2).mean(axis=0) - (hops**2).mean(axis=1)[:, None] + (hops**2).mean()
    values, vectors = np.linalg.eigh(-centred / 2)
    xy = vectors[:, -1:-3:-1] * np.sqrt(np.maximum(values[-1:-3:-1], 1e-3))
    # nodes with the same neighbours would stay on top of each other
    xy = xy + 1e-3 * np.random.default_rng(0).standard_normal(xy.shape)
    for _ in range(_ROUNDS):
        far = np.linalg.norm(xy[:, None, :] - xy[None, :, :], axis=2)
        ratio = np.where(far > 1e-9, hops / np.maximum(far, 1e-9), 0.0)
        xy = (ratio.sum(axis=1)[:, None] * xy - ratio @ xy) / n_nodes
    return xy


def _draw_graph(ax: Any, net: ConeNetwork, links: sp.csr_array, xy: Points) -> list[list[Any]]:
    edges = sp.coo_array(links)
    j, k = edges.coords
    ends = np.stack([xy[k], xy[j]], axis=1)
    width = 0.4 + 1.6 * edges.data / edges.data.max(initial=1e-300)
    drawn: list[Any] = [ax.add_collection(LineCollection(list(ends), colors="0.6", linewidths=width, zorder=1))]
    one_way = (abs(links - links.T) > 0).nnz > 0
    if one_way and edges.nnz <= _MOST_ARROWS:
        arrow = {"arrowstyle": "-|>", "color": "0.35", "shrinkA": 8, "shrinkB": 8, "mutation_scale": 10}
        drawn += [
            ax.annotate("", xy[b], xy[a], arrowprops=arrow, zorder=1) for a, b in zip(k, j, strict=True) if a != b
        ]
    size = float(np.clip(4000 / len(xy), 18, 160))
    margins = net.certificate.node_margins
    if np.isfinite(margins).all():
        low, high = max(margins.min(), 1e-300), margins.max()
        norm = LogNorm(low, high) if high > 30 * low else Normalize(low if high > 1.02 * low else 0.0, high)
        nodes = ax.scatter(*xy.T, s=size, c=margins, cmap="cividis_r", norm=norm, edgecolors="black", zorder=2)
        nodes.set_linewidth(0.6)
        _bar_of_colours(ax, nodes, "scale-free margin of the node")
        broken, mark = np.array([int(np.argmin(margins))]), "weakest node"
    else:
        nodes = ax.scatter(*xy.T, s=size, color=SKY, edgecolors="black", linewidths=0.6, zorder=2)
        broken, mark = broken_nodes(net), "what breaks it"
    marks: list[Any] = []
    if broken.size:
        style = {"s": 2.6 * size + 60, "facecolors": "none", "edgecolors": ORANGE, "linewidths": 2.2, "clip_on": False}
        marks.append(ax.scatter(*xy[broken].T, label=mark, zorder=3, **style))
    names = net.model.names
    named = broken.tolist() if len(xy) <= _MOST_NAMES else broken[:3].tolist()
    if len(xy) <= _MOST_NAMES:
        named += [i for i in range(len(xy)) if i not in named]
    labels = []
    outwards = xy - xy.mean(axis=0)
    outwards = outwards / np.maximum(np.hypot(*outwards.T), 1e-300)[:, None]
    for i in named:
        right, up = outwards[i]
        lift = 5 + (0.9 if i in broken else 0.6) * np.sqrt(size)
        style = {
            "ha": "left" if right > 0.4 else "right" if right < -0.4 else "center",
            "va": "bottom" if up > 0.4 else "top" if up < -0.4 else "center",
            "fontsize": "small",
            "zorder": 4,
        }
        box = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
        at = (lift * right, lift * up)
        labels.append(ax.annotate(names[i], xy[i], at, textcoords="offset points", bbox=box, **style))
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.18)
    ax.set_axis_off()
    return [drawn, [nodes], marks + labels]


def _bar_of_colours(ax: Any, drawn: Any, label: str) -> None:
    """Inside the axes of the picture: python-control would draw into another axes of the figure."""
    ax.figure.colorbar(drawn, cax=ax.inset_axes((1.04, 0.1, 0.04, 0.8)), label=label)


def _legible(ax: Any, marks: list[Any], xy: Points) -> list[Any]:
    """Marks without the names that cover a node or an earlier name, which are taken away.

    Ask when nothing moves any more: legends and titles take room.
    """
    ax.figure.draw_without_rendering()
    places = ax.transData.transform(xy)
    boxes: list[Any] = []
    for name in [mark for mark in marks if isinstance(mark, Text)]:
        box = name.get_window_extent()
        if any(box.overlaps(other) for other in boxes) or any(box.contains(*place) for place in places):
            name.remove()
            marks = [mark for mark in marks if mark is not name]
        else:
            boxes.append(box)
    return marks


def broken_nodes(net: ConeNetwork) -> NDArray[np.intp]:
    """Nodes that the witness names: of a growing direction those where it is largest."""
    witness = net.certificate.witness
    for names in (("target", "source"), ("node",), ("nodes",)):
        if all(hasattr(witness, name) for name in names):
            return np.unique(np.concatenate([np.atleast_1d(getattr(witness, name)) for name in names])).astype(np.intp)
    x = getattr(witness, "x", None)
    if x is None or np.shape(x) != (net.nstates,):
        return np.zeros(0, dtype=np.intp)
    size = net.model.peaks(x)
    return np.flatnonzero(size > 0.5 * size.max())


def _draw_pattern(ax: Any, A: sp.csr_array) -> list[Any]:
    entries, n = sp.coo_array(A), A.shape[0]
    row, column = entries.coords
    out: list[Any]
    if entries.nnz <= _MOST_ENTRIES:
        out = ax.plot(column, row, ".", color="black", markersize=float(np.clip(900 / n, 0.4, 4)), linestyle="")
        ax.set(xlim=(-0.5, n - 0.5), ylim=(n - 0.5, -0.5))
    else:
        count, *_ = np.histogram2d(row, column, bins=_BINS, range=[[0, n], [0, n]])
        image = np.ma.masked_equal(count, 0)
        out = [ax.imshow(image, cmap="cividis_r", norm=LogNorm(), extent=(0, n, n, 0), interpolation="nearest")]
        cell = -(-n // _BINS)
        _bar_of_colours(ax, out[0], f"nonzero entries per {cell} x {cell} cell")
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlabel="from state", ylabel="to state")
    ax.xaxis.set_major_locator(MaxNLocator(4))
    return out


def _draw_half_plane(ax: Any, upper: float, poles: NDArray[np.complex128]) -> list[Any]:
    width = max(float(np.ptp(poles.real)), abs(upper), 1e-300)
    line = ax.axvline(upper, color=BLUE, linewidth=1.8, zorder=2, label=f"certified bound {raised(upper, 5)}")
    right = max(upper, 0.0) + 0.15 * width
    face = ax.axvspan(upper, right, facecolor=SKY, alpha=0.3, zorder=0, label="proven free of poles")
    axis = ax.axvline(0.0, color="0.5", linewidth=0.8, linestyle=":", zorder=1)
    ax.set_xlim(poles.real.min() - 0.05 * width, right)
    if np.ptp(poles.imag) < 1e-9 * width:
        ax.set_ylim(-1, 1)
    return [line, face, axis]


def _draw_disc(ax: Any, radius: float) -> list[Any]:
    edge = 1.15 * max(radius, 1.0)
    face = ax.add_patch(
        Rectangle((-edge, -edge), 2 * edge, 2 * edge, facecolor=SKY, alpha=0.3, zorder=0, label="proven free of poles")
    )
    inside = ax.add_patch(Circle((0, 0), radius, facecolor="white", edgecolor=BLUE, linewidth=1.8, zorder=1))
    inside.set_label(f"certified bound {raised(radius, 5)}")
    circle = ax.add_patch(Circle((0, 0), 1.0, fill=False, edgecolor="0.5", linestyle=":", zorder=2))
    ax.set(xlim=(-edge, edge), ylim=(-edge, edge))
    ax.set_aspect("equal", adjustable="box")
    return [face, inside, circle]
