"""Closing the loop u = W y + w around many nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from control import StateSpace
from numpy.typing import ArrayLike

from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.intake import places
from ..exact.matrix import Matrix
from .blocks import Index
from .coupling import named_by_graph, read_ends
from .given_rates import SupplyRates, certify_rates, read_rates
from .model import NetworkModel, gather
from .network import ConeNetwork
from .nodes import NodeStack, UncertainStack, with_vertices
from .uncertain.members import lower_ends, spread
from .uncertain.network import UncertainNetwork


@np.errstate(all="ignore")
def feedback_interconnect(
    systems: NodeStack | StateSpace | Iterable[NodeStack | StateSpace | Sequence[StateSpace]],
    coupling: ArrayLike | Any,
    *,
    supply_rates: SupplyRates | None = None,
    inputs: Sequence[int | str] | None = None,
    outputs: Sequence[int | str] | None = None,
    name: str | None = None,
    progress: Callable[[str], None] | bool | None = None,
    time_limit: float | None = None,
) -> ConeNetwork:
    """Close the loop u = coupling @ y + w around many nodes, and decide Theorem 4.

    ::

        w --->(+)---> [ nodes ] ---+---> y
               ^                   |
               +---- coupling <----+

    Parameters
    ----------
    systems : sequence of ConeStateSpace, or NodeStack
        Nodes of any sizes and cones; `control_kpos.stack` for many alike.  They may be mixed.  A plain
        `control.StateSpace` gets the nonnegative orthants as its cones.  A list of systems in the place of one gives
        a node vertices, as `control_kpos.stack` does for many.
    coupling : array_like, sparse matrix, list of lists of blocks, or networkx graph
        W, shape (sum m_j, sum q_k); or a range of it, or of entries or blocks of it (`control_kpos.interval`).
        Blocks W[j][k] are m_j x q_k; None stands for zeros.  In a graph,
        for nodes with one input and one output, an edge j -> k of weight w feeds y_j into u_k, an undirected
        edge both ways; edges without a weight have weight 1, and a weight may be a range.
        Its nodes are 0, ..., N - 1 or the names of the
        systems.  Any other labels stand for the systems in the order of ``list(graph.nodes)`` and become
        the names of the nodes, if these have none.  Sparse matrices hold doubles: give weights
        such as "1/3" in a dense matrix, in blocks or in a graph, and they stay what they are.
    supply_rates : sequence of (q_j, r_j), optional
        Test these local supply rates r_j'u_j + q_j'y_j and find weights sigma, instead of finding rates.
    inputs, outputs : sequence of int or str, optional
        External signals to keep, by place among all of them or by name; all if not given.
    name : str, optional
        Name of the closed loop.
    progress : callable or bool, optional
        Receives lines about long work; True writes to standard error, False is silent.  Default: standard
        error if it is a terminal.
    time_limit : float, optional
        Seconds for each question about the network that is given no limit of its own, its certificate among them;
        what is not settled by then is UNDECIDED, and says so.  Networks that are made of this one inherit it.

    Returns
    -------
    ConeNetwork
        The closed loop as a StateSpace, also if it is unstable or not positive.  Its `certificate` is
        found when first asked for.  An `UncertainNetwork` if some node has vertices, or something a range: then the
        certificate is about every choice of them, also one that changes at any time.

    Raises
    ------
    ShapeError, ConeMismatchError, DataError
        An empty network; a coupling or supply rates of the wrong size; NaN or inf; an algebraic loop that
        makes the closed loop ill-posed.
    TimebaseError
        Nodes with different sampling times.

    Notes
    -----
    Theorem 4 (Kawano and Forni, `cone_ic_s`), with its condition (III) for every node and generator.
    Costs one sparse solve in the sum m_j inputs; see `control_kpos.networks.certify`.

    Examples
    --------
    >>> import control_kpos as kp, numpy as np
    >>> node = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
    >>> ring = kp.feedback_interconnect([node] * 3, [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    >>> ring.certificate.status.name
    'PROVED'
    >>> lower, upper = ring.spectral_abscissa()
    >>> round(upper, 4)
    -1.8902
    """
    stacks, members, dt = gather(with_lists(systems), uncertain=True)
    empty = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), 0 if dt is None else dt)
    W, least = read_ends(coupling, empty)
    model = named_by_graph(empty, coupling).with_coupling(W)
    external = None
    if inputs is not None or outputs is not None:
        external = (_select(model, inputs, 1, "inputs"), _select(model, outputs, 2, "outputs"))
    if least is not W or any(isinstance(s, UncertainStack) for s in stacks):
        if supply_rates is not None:
            raise DataError("supply_rates are for networks that are known exactly; leave them out here.")
        return UncertainNetwork(
            spread(model),
            lower_ends(model, least),
            external=external,
            name=name,
            progress=progress,
            time_limit=time_limit,
        )
    find = None
    if supply_rates is not None:
        q, r = read_rates(model, supply_rates)
        find = partial(certify_rates, q=q, r=r)

    return ConeNetwork(model, external=external, name=name, find=find, progress=progress, time_limit=time_limit)


def with_lists(systems: Any) -> Any:
    """The nodes, with lists of systems read as the vertices of one node."""
    if not isinstance(systems, (list, tuple)) or not any(isinstance(item, (list, tuple)) for item in systems):
        return systems
    return [
        _vertices(item, f"systems[{position}]") if isinstance(item, (list, tuple)) else item
        for position, item in enumerate(systems)
    ]


def _vertices(systems: Sequence[Any], name: str) -> UncertainStack:
    """One node from the systems of its vertices."""
    if not systems:
        raise ShapeError(f"{name} is an empty list of vertices; give at least one system.")
    if not all(isinstance(item, StateSpace) for item in systems):
        raise ShapeError(f"{name} is a list; the vertices of a node are systems, such as ConeStateSpace objects.")
    _, _, dt = gather(systems, name)
    parts = [gather(system, name)[0][0] for system in systems]
    first, sizes = parts[0], [(item.nstates, item.ninputs, item.noutputs) for item in systems]
    other = next((s for s, size in enumerate(sizes) if size != sizes[0]), None)
    if other is not None or any((s.X, s.U, s.Y) != (first.X, first.U, first.Y) for s in parts):
        which = "their cones differ" if other is None else f"vertex {other} has {sizes[other]}, but vertex 0 {sizes[0]}"
        raise ConeMismatchError(
            f"{name}: the vertices of a node have the same numbers of states, inputs and outputs, and the same cones; "
            f"{which}."
        )
    names = next((s.names for s in parts if s.names), ())
    common = {"X": first.X, "U": first.U, "Y": first.Y, "dt": dt, "names": names}
    return with_vertices(tuple(replace(part, **common) for part in parts))


def _select(model: NetworkModel, chosen: Sequence[int | str] | int | str | None, kind: int, what: str) -> Index:
    """Places of signals given by place or name, names being those of the network or of a node."""
    count = model.totals[kind]
    if chosen is None:
        return np.arange(count)
    picked = places(chosen, what)
    known: dict[str, list[int]] = {}
    if any(isinstance(item, str) for item in picked):
        for place, label in enumerate(model.signal_names(kind)):
            known[label] = [place]
        for j, node in enumerate(model.names):
            known.setdefault(node, list(range(int(model.offsets[kind][j]), int(model.offsets[kind][j + 1]))))
    out: list[int] = []
    for item in picked:
        if isinstance(item, str):
            if item not in known:
                raise ShapeError(f"{what} names {item!r}, which is neither one of the {count} {what} nor a node.")
            out += known[item]
        elif -count <= item < count:
            out.append(item % count)
        else:
            raise ShapeError(f"{what} holds {item}; there are {count} {what}.")
    if len(set(out)) != len(out):
        raise ShapeError(f"{what} names a signal twice.")
    return np.array(out, dtype=np.intp)
