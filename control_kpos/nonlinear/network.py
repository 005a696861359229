"""Networks of nonlinear nodes as one object: assembled, simulated, linearised."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import control as ct
import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..cones import orthant
from ..errors import DataError, ShapeError
from ..exact.intake import vector
from ..exact.matrix import Matrix
from ..exact.unreadable import UnboundedError
from ..networks.coupling import read_ends
from ..networks.model import NetworkModel
from ..networks.network import ConeNetwork
from ..networks.nodes import NodeStack
from ..networks.ranges import Interval
from ..networks.ranges import has_ranges as holds_ranges
from .enclosed import at_point
from .nodes import Links, NonlinearNodes, own_outputs

Array = NDArray[np.float64]


class NonlinearNetwork:
    """Nonlinear nodes and their links; made by `nonlinear_interconnect`.

    States, inputs and outputs are counted node by node, those of one node after each other, as in `ConeNetwork`.

    Parameters
    ----------
    kinds : tuple of NonlinearNodes
        The nodes of the first kind are the first ones, and so on.
    model : NetworkModel
        Where states and signals stand.
    ends : tuple of csr_array, shape (sum m_j, sum q_k)
        Upper and lower end of the linear coupling; equal unless it was given by ranges, or by numbers that are no
        doubles.
    links : tuple of Links
    has_ranges : bool
        The linear coupling is known by ranges.

    Attributes
    ----------
    kinds, model, links, has_ranges
        As given.
    lower, upper : csr_array
        The ends of the linear coupling.
    n_nodes : int
    totals : tuple of int
        All states, inputs and outputs.

    Examples
    --------
    >>> import control_kpos as kp
    >>> cities = kp.nonlinear_nodes(lambda x, u, p: [-2 * x[0] + (1 - x[0]) * u[0]], n_nodes=3)
    >>> net = kp.nonlinear_interconnect(cities, [[0, 1, 0], [0.5, 0, 0.5], [0, 1, 0]])
    >>> net.totals, net.dynamics([0.5, 0, 0]).tolist()
    ((3, 3, 3), [-1.0, 0.25, 0.0])
    """

    def __init__(self, kinds: Any, model: NetworkModel, ends: Any, links: Any, has_ranges: bool) -> None:
        self.kinds, self.model, self.links = kinds, model, links
        self.upper, self.lower = ends
        self.has_ranges = has_ranges

    @property
    def n_nodes(self) -> int:
        return self.model.n_nodes

    @property
    def totals(self) -> tuple[int, int, int]:
        return self.model.totals

    @cached_property
    def own(self) -> tuple[Any, ...]:
        """For links of differences, the output of the node of every target; None for other links."""
        ports = self.model.offsets[1], self.model.offsets[2]
        return tuple(own_outputs(*ports, each.targets) if each.difference else None for each in self.links)

    def pack(self, *rows: Any) -> Array:
        """A vector of all states from rows of states, one list of rows for each kind of nodes.

        Parameters
        ----------
        *rows : list of array_like
            For every kind its states x[0], x[1], ..., each a number or an array of N numbers.

        Returns
        -------
        ndarray, shape (sum n_j,)

        Raises
        ------
        ShapeError
            Not one list for each kind, not one row for each state, or rows of another length.
        """
        if len(rows) != len(self.kinds):
            raise ShapeError(f"rows: there are {len(rows)} lists, but {len(self.kinds)} kinds of nodes; give one each.")
        parts = []
        for kind, given in zip(self.kinds, rows, strict=True):
            if len(given) != kind.sizes[0]:
                raise ShapeError(f"rows: {len(given)} rows for nodes of {kind.sizes[0]} states; give one for each.")
            part = [vector(row, "rows") for row in given]
            if any(row.shape not in ((1,), (kind.count,)) for row in part):
                raise ShapeError(f"rows: a row has neither 1 nor {kind.count} numbers; give one for each node.")
            parts.append(np.column_stack([np.broadcast_to(row, kind.count) for row in part]))
        return np.concatenate([part.ravel() for part in parts])

    def unpack(self, x: Any) -> list[Array]:
        """The inverse of `pack`: for every kind an array with one row for each state.

        Parameters
        ----------
        x : array_like, shape (sum n_j,)
        """
        return [part.T for part in self.model.split(vector(x, "x", self.totals[0]), 0)]

    @np.errstate(all="ignore")
    def dynamics(self, x: ArrayLike, w: ArrayLike | None = None) -> Array:
        """x' for states x and external inputs w, which are added to what links bring.

        Parameters
        ----------
        x : array_like, shape (sum n_j,)
        w : array_like, shape (sum m_j,), optional
            Zero if not given.

        Returns
        -------
        ndarray, shape (sum n_j,)

        Raises
        ------
        ShapeError, DataError
            Vectors of another length; links that are known by ranges only.

        Notes
        -----
        One call of every f and g, and one sparse product.
        """
        states = self.model.split(vector(x, "x", self.totals[0]), 0)
        external = None if w is None else vector(w, "w", self.totals[1])
        u = self._received(self.outputs(states), external)
        parts = zip(self.kinds, states, self.model.split(u, 1), strict=True)
        rates = (_evaluated(k, k.f(_rows(x), _rows(u), k.params), k.sizes[0], "f") for k, x, u in parts)
        return self.model.join(list(rates), 0)

    def outputs(self, states: list[Array]) -> Array:
        """The outputs of all nodes.

        Parameters
        ----------
        states : list of ndarray, shapes (N, n)
            The states of every kind of nodes.
        """
        parts = zip(self.kinds, states, strict=True)
        return self.model.join([_evaluated(k, k.outputs(_rows(x), k.params), k.sizes[2], "g") for k, x in parts], 2)

    def _received(self, y: Array, external: Array | None) -> Array:
        if self.is_ranged:
            raise DataError("some links are known by ranges only; give functions or numbers to compute with them.")
        u = self.upper @ y + (0.0 if external is None else external)
        for each, own in zip(self.links, self.own, strict=True):
            d = y[each.sources] if own is None else y[each.sources] - y[own]
            d.flags.writeable = False
            np.add.at(u, each.targets, each.weights * np.asarray(each.function(d)))
        return u

    @property
    def is_ranged(self) -> bool:
        """True if some link is known by a range only."""
        return self.has_ranges or any(isinstance(each.function, Interval) for each in self.links)

    @property
    def system(self) -> ct.NonlinearIOSystem:
        """The network for python-control: x' = dynamics(x, u), all states as outputs, all external inputs as inputs."""
        n, m, _ = self.totals
        return ct.nlsys(lambda t, x, u, p: self.dynamics(x, u), None, inputs=m, outputs=n, states=n)

    @np.errstate(all="ignore")
    def linearize(self, x: ArrayLike, w: ArrayLike | None = None) -> ConeNetwork:
        """The linear network of displacements at a point, on the cones of the nodes.

        Parameters
        ----------
        x : array_like, shape (sum n_j,)
        w : array_like, shape (sum m_j,), optional
            External inputs; zero if not given.

        Returns
        -------
        ConeNetwork
            Its matrices are midpoints of enclosures, up to rounding those of the derivatives.

        Raises
        ------
        ShapeError, DataError
            Vectors of another length; a derivative that is unbounded at this point.
        """
        state, external = vector(x, "x", self.totals[0]), None if w is None else vector(w, "w", self.totals[1])
        try:
            return at_point(self, state, external)
        except (DataError, UnboundedError) as error:
            raise DataError(f"at this x: {error}") from None

    def __repr__(self) -> str:
        n, m, q = self.totals
        return f"<NonlinearNetwork of {self.n_nodes} nodes: {n} states, {m} inputs, {q} outputs>"


def nonlinear_interconnect(
    nodes: NonlinearNodes | Sequence[NonlinearNodes], coupling: ArrayLike | Links | Sequence[Any] | Any = None
) -> NonlinearNetwork:
    """Connect nonlinear nodes: u = W y + what links bring + external inputs.

    Parameters
    ----------
    nodes : NonlinearNodes, or a list of several kinds
    coupling : array_like, sparse matrix, networkx graph, interval or Links; or a list of a matrix and several Links
        A matrix W, shape (sum m_j, sum q_k), or a range of it, as for `feedback_interconnect`; and links with
        functions (`control_kpos.links`).

    Returns
    -------
    NonlinearNetwork
        `differential_positivity` decides on it.

    Raises
    ------
    ShapeError, ConeMismatchError, DataError
        No nodes; a coupling of another size; links from or to ports that do not exist.

    Examples
    --------
    A Hopfield network, x' = -x + W tanh(x) + w:

    >>> import numpy as np, control_kpos as kp
    >>> neurons = kp.nonlinear_nodes(lambda x, u, p: [u[0] - x[0]], lambda x, p: [np.tanh(x[0])], n_nodes=2)
    >>> net = kp.nonlinear_interconnect(neurons, [[0, 0.5], [0.8, 0]])
    >>> kp.differential_positivity(net, region=[[-2, 2], [-2, 2]]).status.name
    'PROVED'
    """
    kinds = (nodes,) if isinstance(nodes, NonlinearNodes) else tuple(_list(nodes))
    if not kinds:
        raise ShapeError("nodes is empty; a network needs at least one node.")
    for kind in kinds:
        if not isinstance(kind, NonlinearNodes):
            raise ShapeError(f"nodes holds a {type(kind).__name__}; give what kp.nonlinear_nodes returns.")
    model = _skeleton(kinds)
    parts: list[Any] = [] if coupling is None else [coupling]
    if isinstance(coupling, (list, tuple)) and any(isinstance(part, Links) for part in coupling):
        parts = list(coupling)
    found = tuple(part for part in parts if isinstance(part, Links))
    matrices = [part for part in parts if not isinstance(part, Links)]
    if len(matrices) > 1:
        raise DataError(f"coupling has {len(matrices)} matrices; add them up to one.")
    _, m, q = model.totals
    ends = read_ends(matrices[0] if matrices else sp.csr_array((m, q)), model)
    upper, lower = (
        end.values if end.is_sparse else sp.csr_array(end.rounded(up=up))
        for end, up in zip(ends, (True, False), strict=True)
    )
    for each in found:
        for name, index, size in (("targets", each.targets, m), ("sources", each.sources, q)):
            if (index >= size).any():
                raise ShapeError(f"coupling: {name} holds {int(index.max())}, but there are {size} such ports.")
    out = NonlinearNetwork(kinds, model, (upper, lower), found, bool(matrices) and holds_ranges(matrices[0]))
    _ = out.own  # refuses differences without an own output
    return out


def _list(nodes: Any) -> list[Any]:
    if isinstance(nodes, (list, tuple)):
        return list(nodes)
    raise ShapeError(f"nodes is a {type(nodes).__name__}; give what kp.nonlinear_nodes returns, or a list of it.")


def _skeleton(kinds: tuple[NonlinearNodes, ...]) -> NetworkModel:
    """Where states and signals stand; the matrices are zero."""
    stacks, members, first = [], [], 0
    for kind in kinds:
        n, m, q = kind.sizes
        A, B, C, D = (Matrix(np.zeros((kind.count, *shape))) for shape in ((n, n), (n, m), (q, n), (q, m)))
        stacks.append(NodeStack(A, B, C, D, kind.X, orthant(m), orthant(q), 0, kind.names))
        members.append(np.arange(first, first + kind.count))
        first += kind.count
    W = Matrix(sp.csr_array((sum(len(k) * k.sizes[1] for k in kinds), sum(len(k) * k.sizes[2] for k in kinds))))
    return NetworkModel(tuple(stacks), tuple(members), W, 0)


def _rows(values: Array) -> Array:
    """One row for each state or input, which a function cannot change: intervals are not changed either."""
    rows = values.T
    rows.flags.writeable = False
    return rows


def _evaluated(kind: NonlinearNodes, result: Any, rows: int, name: str) -> Array:
    """Rows of values as an array (N, rows)."""
    given = list(result)
    if len(given) != rows:
        raise ShapeError(f"{name} returned {len(given)} rows; the nodes need {rows}.")
    return np.column_stack([np.broadcast_to(np.asarray(row, dtype=float), kind.count) for row in given])
