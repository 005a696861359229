"""Time responses of many signals in one picture: bands, a heat map, or a few signals that are named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import control as ct
import numpy as np
from matplotlib.colors import LogNorm, Normalize

from ..errors import DataError, ShapeError
from ..exact.intake import choice, found, places, words
from .figure import BLUE, GREEN, ORANGE, PINK, SKY, YELLOW, Points, choose_axes, control_style, finished

# Signals that are drawn as lines if nothing is said, and at most; samples of a heat map, and rows that get names.
_FEW, _MOST, _COLUMNS, _NAMED = 8, 12, 1000, 30
# Parts of the largest value: where a heat map turns to powers of ten, and the least of these.
_FAR, _LEAST = 0.02, 1e-6
# Parts of the signals between the edges of a band.
_BANDS = ((0.05, 0.95, 0.25), (0.25, 0.75, 0.45))
_COLOURS = ("black", ORANGE, GREEN, PINK, YELLOW, BLUE)
_DASHES = ("-", "--", "-.", ":")


def plot_responses(
    response: Any,
    outputs: Sequence[int | str] | None = None,
    *,
    inputs: Sequence[int | str] | None = None,
    kind: str | None = None,
    ax: Any = None,
    title: str | None = None,
) -> ct.ControlPlot:
    """Draw all outputs of a time response in one axes: of a network of hundreds of nodes in a second.

    Parameters
    ----------
    response : control.TimeResponseData
        As `ConeNetwork.step_response`, `forced_response` and their like in python-control return it.
    outputs : sequence of int or str, optional
        Outputs that get a line and a name, by place or name.  Default: all of up to 8, else none.
    inputs : sequence of int or str, optional
        Of a response to several inputs one at a time: which of them, by place or name; default all.
    kind : {"lines", "bands", "map"}, optional
        "bands": minimum, quantiles, median and maximum over all outputs and inputs, and lines over them; "map": a heat
        map, one row for each output and input; "lines": lines alone.  Default: "lines" for up to 8 signals, else
        "bands".
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    title : str, optional
        Default: that of the response, if `ax` is not given.

    Returns
    -------
    cplt : control.ControlPlot
        `cplt.lines` has two lists of artists: bands or map, and lines.

    Raises
    ------
    DataError, ShapeError
        Not a response; signals that it does not have; more than 12 lines.

    Examples
    --------
    >>> import control_kpos as kp
    >>> node = kp.examples.mass_spring_node()
    >>> net = kp.feedback_interconnect([node] * 20, kp.examples.ring(20))
    >>> cplt = kp.plot_responses(net.step_response(4.0), [0], inputs=[0])
    >>> cplt.axes[0, 0].get_xlabel()
    'Time [s]'
    """
    if not isinstance(response, ct.TimeResponseData):
        raise DataError(f"response is {found(response)}; give what step_response or forced_response returns.")
    kind, title, user_ax = choice(kind, "kind", ("lines", "bands", "map", None)), words(title, "title"), ax
    y, names, source = _signals(response, inputs)
    own = _chosen(outputs, "outputs", list(response.output_labels or []), response.noutputs)
    lines = [k for k in range(len(names)) if k % response.noutputs in own]
    few = len(names) <= _FEW
    kind = ("lines" if few else "bands") if kind is None else kind
    if outputs is None and kind != "map":
        lines = list(range(len(names))) if few or kind == "lines" else []
    most, what = (_NAMED, "named rows") if kind == "map" else (_MOST, "lines")
    if len(lines) > most or (kind == "lines" and not lines):
        raise DataError(
            f"{len(lines)} {what} are too many or too few for one picture; choose 1 to {most} by outputs and inputs."
        )
    with control_style():
        ax = choose_axes(ax, "rectilinear", "responses")
        t = np.asarray(response.time, dtype=float)
        if kind == "map":
            drawn = [_draw_map(ax, t, y, names, lines if outputs is not None else [])], []
        else:
            drawn = _draw_bands(ax, t, y) if kind == "bands" else [], _draw_lines(ax, t, y, names, lines)
        ax.set_xlabel("Time [s]")
        what = (response.title or f"Responses of {response.sysname or 'a system'}") + f" from {source}" * bool(source)
        return finished(list(drawn), ax, user_ax, title, what, legend=kind != "map")


def _signals(response: ct.TimeResponseData, inputs: Any) -> tuple[Points, list[str], str]:
    """All signals as rows, input by input, their names, and the input that all of them are from, if there is one."""
    y = np.asarray(response.y, dtype=float)  # without squeezing
    labels = list(response.output_labels or [f"y[{k}]" for k in range(response.noutputs)])
    if y.ndim == 2:
        if inputs is not None:
            raise DataError("inputs is for responses to several inputs one at a time; this one has a single trace.")
        return y, labels, ""
    traces = list(response.trace_labels or [f"From u[{k}]" for k in range(y.shape[1])])
    sources = [label.removeprefix("From ") for label in traces]
    kept = _chosen(inputs, "inputs", sources, y.shape[1]) if inputs is not None else list(range(y.shape[1]))
    rows = np.concatenate([y[:, k] for k in kept])
    if len(kept) == 1:
        return rows, labels, sources[kept[0]]
    return rows, [f"{label} from {sources[k]}" for k in kept for label in labels], ""


def _chosen(given: Any, name: str, labels: list[str], count: int) -> list[int]:
    """Places of signals by place or name."""
    out = []
    for item in [] if given is None else places(given, name):
        place = labels.index(item) if item in labels else item
        if isinstance(place, str) or not -count <= place < count:
            raise ShapeError(f"{name} names {item!r}, which is none of the {count} {name} of this response.")
        out.append(int(place) % count)
    if given is not None and not out:
        raise ShapeError(f"{name} is empty; leave it out for all of them.")
    return out


def _draw_bands(ax: Any, t: Points, y: Points) -> list[Any]:
    """All signals between their extremes and quantiles."""
    low, *rest, median = np.quantile(y, [0.0, *(edge for a, b, _ in _BANDS for edge in (a, b)), 1.0, 0.5], axis=0)
    *edges, high = rest
    text = f"all {len(y)} signals"
    out = [ax.fill_between(t, low, high, color=SKY, alpha=0.25, linewidth=0, label=text, zorder=1)]
    for k, (a, b, alpha) in enumerate(_BANDS):
        label = f"{a:.0%} to {b:.0%} of them"
        out.append(
            ax.fill_between(
                t, edges[2 * k], edges[2 * k + 1], color=SKY, alpha=alpha, linewidth=0, label=label, zorder=1
            )
        )
    out += ax.plot(t, low, "-", t, high, "-", color=BLUE, linewidth=0.6, zorder=1)
    out += ax.plot(t, median, color=BLUE, linewidth=1.8, label="median", zorder=2)
    ax.set_ylabel("outputs")
    return out


def _draw_lines(ax: Any, t: Points, y: Points, names: list[str], lines: list[int]) -> list[Any]:
    out: list[Any] = []
    for place, k in enumerate(lines):
        style = {"color": _COLOURS[place % len(_COLOURS)], "linestyle": _DASHES[place % len(_DASHES)]}
        out += ax.plot(t, y[k], linewidth=1.4, label=names[k], zorder=3, **style)
    if len(lines) == len(y) == 1:
        ax.set_ylabel(names[0])
    elif not ax.get_ylabel():
        ax.set_ylabel("outputs")
    return out


def _draw_map(ax: Any, t: Points, y: Points, names: list[str], marked: list[int]) -> Any:
    """A row for each signal, the first on top.

    Colours on both sides of 0 if signals change sign; of powers of ten if most are far below the largest.
    """
    step = -(-len(t) // _COLUMNS)
    shown, size = y[:, ::step], float(np.abs(y).max(initial=0.0)) or 1.0
    signed = y.min(initial=0.0) < 0 < y.max(initial=0.0)
    if signed:
        norm = Normalize(-size, size)
    elif y.min(initial=0.0) == 0 and np.median(y.max(axis=1)) < _FAR * size:
        norm, shown = LogNorm(_LEAST * size, size), np.maximum(shown, _LEAST * size)
    else:
        norm = Normalize(float(min(y.min(), 0.0)), float(max(y.max(), 0.0)) or 1.0)
    edges = (
        np.append(t[::step], t[-1] + (t[-1] - t[0]) / max(len(t) - 1, 1)) if len(t) > 1 else np.array([t[0], t[0] + 1])
    )
    image = ax.pcolormesh(
        edges[: shown.shape[1] + 1],
        np.arange(len(y) + 1) - 0.5,
        shown,
        norm=norm,
        cmap="RdBu_r" if signed else "cividis",
        rasterized=True,
    )
    ax.set_ylim(len(y) - 0.5, -0.5)
    named = marked if marked else list(range(len(names))) if len(names) <= _NAMED else []
    if named:
        ax.set_yticks(named, [names[k] for k in named], fontsize="small")
    ax.set_ylabel("" if named else "place of the output" + " and input" * (" from " in names[0]))
    ax.figure.colorbar(image, cax=ax.inset_axes((1.03, 0.0, 0.03, 1.0)), label="value of the output")
    return image
