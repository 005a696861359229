"""Which vertex and which range of an uncertain network costs most, computed from the vectors of its proof.

Let d be half the width of a range of an entry of A, B, C, D or W.  With g_k the largest (C x)_k / v'x over the
generators x of the node of output k, the rate at which v'x falls somewhere is lower by at most about

    A: v_a d / v_b,    C: -q_j d / v_b,    W: r_i d g_k,    B and D: v_a d f_i, -q_j d f_i with f_i = max_k W_ik g_k,

if the range grows by d at its upper end and the vectors stay what they are.  Everything is on orthants, or about links.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ...exact.matrix import Matrix
from .. import conditions as on
from ..blocks import Floats, Index, apply
from ..model import BLOCKS, NetworkModel

# Names of matrices of the transposed network.
_TURNED = {"A": "A", "B": "C", "C": "B", "D": "D", "W": "W"}


class Costly(NamedTuple):
    """Something that costs much.

    Attributes
    ----------
    name : str
        What it is, in the names of nodes and signals.
    value : float
        Of a vertex: its margin, scale-free.  Of a range: by how much the margin falls if the range grows by half of its
        width on both sides, in the same units.
    """

    name: str
    value: float


class Costliest(NamedTuple):
    """What costs most.

    Attributes
    ----------
    vertices : tuple of Costly
        The smallest margin first.
    ranges : tuple of Costly
        The largest loss first.
    """

    vertices: tuple[Costly, ...]
    ranges: tuple[Costly, ...]


@dataclass(frozen=True, eq=False)
class Ends:
    """The vectors of a proof, and the two ends of its ranges; `turned` if they are about the transposed network."""

    model: NetworkModel
    lower: NetworkModel
    upper: NetworkModel
    v: Floats
    r: Floats
    q: Floats
    turned: bool


@np.errstate(all="ignore")
def margins_at_vertices(models: Sequence[NetworkModel], v: Matrix, q: Matrix) -> tuple[Floats, float]:
    """How fast v'x falls at every vertex of every node, in units of the fastest rate of all; and this rate."""
    first, gross = models[0], 0.0
    out = np.full((len(models), first.n_nodes), np.nan)
    vs, qs = first.split(v, 0), first.split(q, 2)
    for rate, model in zip(out, models, strict=True):
        for g, index in enumerate(model.members):
            forms = on.decrease_forms(model.stacks[g], vs[g], qs[g], 0.0, model.discrete)
            value = np.einsum("jn,kn->jk", vs[g].values, model.stacks[g].X.rays)
            rate[index] = (-forms.values[:, 0] / value).min(axis=1, initial=np.inf)
            gross = max(gross, float((forms.magnitudes[:, 0] / value).max(initial=0.0)))
    return (out / gross if gross > 0 else out), gross


@np.errstate(all="ignore")
def smallest_margins(model: NetworkModel, margins: Floats, place: Any, k: int) -> tuple[Costly, ...]:
    """The k vertices with the smallest margins."""
    chosen = _first(margins.ravel(), k)
    at = zip(*np.unravel_index(chosen, margins.shape), margins.ravel()[chosen], strict=True)
    return tuple(Costly(f"{model.name_of(int(j))} at {place(int(s))}", float(x)) for s, j, x in at)


@np.errstate(all="ignore")
def largest_losses(ends: Ends, gross: float, k: int) -> tuple[Costly, ...]:
    """The k ranges whose growth costs most."""
    found = [(name, where, loss) for name, where, loss in _losses(ends)]
    if not found:
        return ()
    chosen = sorted(
        ((float(loss[i]), name, [part[i] for part in where]) for name, where, loss in found for i in _first(-loss, k)),
        key=lambda item: -item[0],
    )
    return tuple(Costly(_named(ends, name, where), loss / gross) for loss, name, where in chosen[:k] if loss > 0)


def _first(values: Floats, k: int) -> Index:
    """Places of the k smallest, in order."""
    k = min(k, values.size)
    part = np.argpartition(values, k - 1)[:k] if k < values.size else np.arange(values.size)
    return part[np.argsort(values[part], kind="stable")]


def _losses(ends: Ends) -> Iterator[tuple[str, tuple[Index, Index], Floats]]:
    """For every matrix, rows and columns in the large system of the entries in ranges, and their losses."""
    model, v, r, q = ends.model, ends.v, ends.r, ends.q
    reach = np.zeros(model.totals[2])
    for s, (_, _, at), part in zip(model.stacks, model.places, model.split(v, 0), strict=True):
        rays = np.asarray(s.X.rays)
        value = part @ rays.T
        sent = np.abs(np.stack([apply(s.C.values, np.broadcast_to(x, part.shape)) for x in rays], axis=-1))
        reach[at] = (sent / value[:, None, :]).max(axis=-1, initial=0.0)
    heard = np.asarray((abs(model.W) @ sp.diags_array(reach)).max(axis=1).toarray()).ravel()
    apart = sp.coo_array(ends.upper.W - ends.lower.W)
    if apart.nnz:
        i, j = apart.coords
        yield "W", (i, j), 0.5 * np.abs(r[i] * apart.data) * reach[j]
    left = {"A": v, "B": v, "C": -q, "D": -q}
    right = {"A": 1 / v, "B": heard, "C": 1 / v, "D": heard}
    for g, places in enumerate(model.places):
        for name, (rows, columns) in BLOCKS.items():
            high, low = (getattr(m.stacks[g], name) for m in (ends.upper, ends.lower))
            width = np.abs(high.values - low.values) if high is not low else np.zeros(0)
            if width.any():
                j, a, b = np.nonzero(width)
                row, column = places[rows][j, a], places[columns][j, b]
                yield name, (row, column), 0.5 * width[j, a, b] * np.abs(left[name][row] * right[name][column])


def _named(ends: Ends, name: str, where: list[Any]) -> str:
    """An entry, in the names of signals of the network as it was given."""
    model, kinds = ends.model, (1, 2) if name == "W" else BLOCKS[name]
    row, column = (_signal(model, kind, int(place), ends.turned) for kind, place in zip(kinds, where, strict=True))
    to, of = (column, row) if ends.turned else (row, column)
    return f"the entry of {_TURNED[name] if ends.turned else name} from {of} to {to}"


def _signal(model: NetworkModel, kind: int, place: int, turned: bool) -> str:
    """The name of a signal and its node."""
    j = int(np.searchsorted(model.offsets[kind], place, side="right")) - 1
    g, row = model.locate(j)
    own, shown = place - int(model.offsets[kind][j]), (0, 2, 1)[kind] if turned else kind
    labels, letter = model.stacks[g].labels, "xuy"[shown]
    return f"{labels[row][kind][own] if labels else f'{letter}[{own}]'} of {model.name_of(j)}"
