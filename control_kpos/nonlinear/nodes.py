"""Kinds of nonlinear nodes, x_j' = f(x_j, u_j), y_j = g(x_j), and the links among them.

One function describes all nodes of a kind: x[k] is state k of all of them, an array of N numbers, so that
`x[0] * x[1]` is written as for one node.  Links carry functions too,

    u_i = sum_l w_il y_l + sum over links of weight phi(y_l)    or    weight phi(y_l - y_own(i)) for differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..cones import Cone, Orthant, as_cone, orthant
from ..errors import ConeMismatchError, DataError, NotProperConeError, ShapeError, TooLargeError
from ..exact.intake import exact_matrix, flag, places, whole_number
from ..networks.ranges import Interval

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Function = Callable[..., Any]

# Nodes of one kind: their states alone would fill a gigabyte.
_MOST_NODES = 10**8


@dataclass(frozen=True, eq=False)
class NonlinearNodes:
    """N nodes that one function describes; made by `nonlinear_nodes`.

    Attributes
    ----------
    f : callable
        f(x, u, p), the rates of all states; x[k] and u[k] are arrays of N numbers, p is `params`.
    g : callable or None
        g(x, p), the outputs; None: the first states.
    sizes : tuple of int
        Number of states, inputs and outputs of one node.
    count : int
        N.
    params : mapping
        Numbers, or arrays of N numbers, by name; read only.
    X : Cone
        Simplicial, in R^n: the order of the states.
    names : tuple of str
        One for each node; empty if none were given.
    """

    f: Function
    g: Function | None
    sizes: tuple[int, int, int]
    count: int
    params: Mapping[str, Any]
    X: Cone
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return self.count

    def __repr__(self) -> str:
        n, m, q = self.sizes
        return f"<NonlinearNodes: {self.count} nodes of {n} states, {m} inputs and {q} outputs each>"

    def outputs(self, x: Any, params: Mapping[str, Any]) -> Any:
        """The outputs for rows of states."""
        return [x[k] for k in range(self.sizes[2])] if self.g is None else self.g(x, params)

    def part(self, chosen: slice) -> Mapping[str, Any]:
        """The params of some of the nodes."""
        return MappingProxyType({k: v[chosen] if np.ndim(v) else v for k, v in self.params.items()})


def nonlinear_nodes(
    f: Function,
    g: Function | None = None,
    *,
    n_nodes: int,
    states: int = 1,
    inputs: int = 1,
    outputs: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    X: Cone | ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> NonlinearNodes:
    """Nonlinear nodes x_j' = f(x_j, u_j), y_j = g(x_j) of one kind, as many as you like.

    Parameters
    ----------
    f : callable
        f(x, u, p) returns the rates of all states, a list of `states` rows.  x[k] and u[k] are arrays of one number for
        each node, or intervals: write it with arithmetic and functions of numpy that act entry by entry.
    g : callable, optional
        g(x, p) returns a list of `outputs` rows; the first states if not given.
    n_nodes : int
        N, the number of nodes.
    states, inputs, outputs : int
        Numbers of states, inputs and outputs of one node, 1 or more each.
    params : dict, optional
        What f and g find in p: by name, a number for all nodes or an array of N numbers.
    X : Cone, or array_like of its generators, optional
        Simplicial, in R^n: the order of the states of every node.  The nonnegative orthant if not given.
    names : sequence of str, optional
        One name per node.

    Returns
    -------
    NonlinearNodes
        To be passed to `nonlinear_interconnect`.

    Raises
    ------
    DataError, ShapeError, TooLargeError
        f or g that cannot be called; numbers that are not positive; params or names of another length than N; more
        than 10^8 nodes.
    ConeMismatchError, NotProperConeError
        X in another dimension, or not simplicial.

    Examples
    --------
    An epidemic: x is the infected share of each city, u what arrives from others.

    >>> import control_kpos as kp
    >>> cities = kp.nonlinear_nodes(
    ...     lambda x, u, p: [-p["cure"] * x[0] + (1 - x[0]) * u[0]], n_nodes=3, params={"cure": [2, 2.5, 3]}
    ... )
    >>> cities
    <NonlinearNodes: 3 nodes of 1 states, 1 inputs and 1 outputs each>
    """
    for name, function in (("f", f), ("g", g)):
        if not callable(function) and not (name == "g" and function is None):
            raise DataError(f"{name} is a {type(function).__name__}; give a function.")
    count = whole_number(n_nodes, "n_nodes", least=1)
    if count > _MOST_NODES:
        raise TooLargeError(f"n_nodes is {count}; at most {_MOST_NODES} nodes are taken.")
    given = (("states", states), ("inputs", inputs), ("outputs", outputs))
    n, m, q = (whole_number(number, name, least=1) for name, number in given)
    if g is None and q > n:
        raise DataError(f"outputs is {q}, but without g the outputs are states, of which there are {n}; give g.")
    cone = orthant(n) if X is None else as_cone(X, "X")
    if cone.dim != n:
        raise ConeMismatchError(f"X is a cone in dimension {cone.dim}, but the nodes have {n} states.")
    cone.require_proper("X")
    if not cone.is_simplicial:
        raise NotProperConeError(
            f"X has {cone.n_rays} generators in dimension {n}; the cone of nonlinear nodes must be simplicial, with as "
            "many generators as dimensions."
        )
    labels = tuple(str(name) for name in places(names, "names")) if names is not None else ()
    if labels and len(labels) != count:
        raise ShapeError(f"names has {len(labels)} entries, but n_nodes is {count}; give one name for each node.")
    return NonlinearNodes(f, g, (n, m, q), count, _numbers(params, count), cone, labels)


def _numbers(params: Any, count: int) -> Mapping[str, Any]:
    """Numbers and arrays that functions can read, and not change."""
    if params is None:
        return MappingProxyType({})
    if not isinstance(params, Mapping):
        raise DataError(f"params is a {type(params).__name__}; give a dict of numbers and arrays.")
    out: dict[str, Any] = {}
    for name, data in params.items():
        label = f"params[{name!r}]"
        read = exact_matrix(data, label, ndim=1)
        if not read.is_double:
            raise DataError(f"{label} is no double; nonlinear functions compute with doubles. Give a float.")
        values = np.array(read.values)
        if values.shape not in ((1,), (count,)):
            raise ShapeError(f"{label} has {values.size} entries; give one number, or one for each of {count} nodes.")
        values.flags.writeable = False
        out[name] = float(values[0]) if values.shape == (1,) else values
    return MappingProxyType(out)


@dataclass(frozen=True, eq=False)
class Links:
    """Links with a function; made by `nonlinear_links`.

    Attributes
    ----------
    function : callable or Interval
        phi, or a range of slopes: a weight that is anywhere in it, also changing in time.
    targets, sources : ndarray of int, shape (E,)
        Inputs and outputs, counted over all nodes.
    weights : ndarray, shape (E,)
    difference : bool
        phi is applied to y_source - y_own, where own is the output of the target's node with the input's number.
    """

    function: Function | Interval
    targets: Index
    sources: Index
    weights: Array
    difference: bool = False


def nonlinear_links(
    function: Function | Interval,
    targets: ArrayLike,
    sources: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    difference: bool = False,
) -> Links:
    """Nonlinear links: input targets[e] receives weights[e] phi(y[sources[e]]), or of a difference to its own output.

    Parameters
    ----------
    function : callable or control_kpos.interval
        phi, of one argument, entry by entry; or a range: a link y -> w y whose weight w is anywhere in it, also
        changing in time.
    targets, sources : array_like of int, shape (E,)
        Inputs and outputs, counted over all nodes; node numbers where nodes have one input and one output.
    weights : array_like, shape (E,), or number, optional
        1 if not given; not negative for links that keep the orders.
    difference : bool
        True: phi(y_source - y_own), y_own being output i of the node whose input i is the target.  Slopes of such
        links stand in two places of the Jacobian, and both are taken together.

    Returns
    -------
    Links
        To be passed to `nonlinear_interconnect`.

    Raises
    ------
    DataError, ShapeError
        No function; numbers that are no places, or not as many of them.

    Examples
    --------
    Two phases that attract each other through a line of strength 3:

    >>> import numpy as np, control_kpos as kp
    >>> kp.nonlinear_links(np.sin, [0, 1], [1, 0], weights=3, difference=True).weights
    array([3., 3.])
    """
    if not (callable(function) or isinstance(function, Interval)):
        raise DataError(f"function is a {type(function).__name__}; give a function of one number, or kp.interval(...).")
    if isinstance(function, Interval):
        for end in (function.lower, function.upper):
            if np.shape(end) not in ((), (1,)):
                raise ShapeError(f"function is a range of shape {np.shape(end)}; give two numbers.")
    i, k = _places(targets, "targets"), _places(sources, "sources")
    if len(i) != len(k):
        raise ShapeError(f"targets has {len(i)} entries, but sources has {len(k)}; a link has one of each.")
    read = exact_matrix([1.0] if weights is None else weights, "weights", ndim=1)
    if not read.is_double:
        raise DataError("weights holds a number that is no double; nonlinear links compute with doubles. Give floats.")
    w = read.values
    if w.shape not in ((1,), (len(i),)):
        raise ShapeError(f"weights has {w.size} entries; give one number, or one for each of {len(i)} links.")
    return Links(function, i, k, np.array(np.broadcast_to(w, len(i))), flag(difference, "difference"))


def _places(data: Any, name: str) -> Index:
    read = exact_matrix(data, name, ndim=1).values
    wrong = (read != np.floor(read)) | (read < 0) | (read > 2**53)
    if wrong.any():
        raise DataError(f"{name} holds {read[wrong][0]}; give places, whole numbers from 0.")
    return read.astype(np.intp)


def own_outputs(inputs: Index, outputs: Index, targets: Index) -> Index:
    """The output of the same node with the same number within the node, for inputs that need one.

    Parameters
    ----------
    inputs, outputs : ndarray of int, shape (N + 1,)
        Where those of node j begin.
    targets : ndarray of int
    """
    node = np.searchsorted(inputs, targets, side="right") - 1
    own = outputs[node] + targets - inputs[node]
    missing = own >= outputs[node + 1]
    if missing.any():
        i = int(targets[np.argmax(missing)])
        raise DataError(
            f"input {i} receives a difference, but node {int(node[np.argmax(missing)])} has no output with the number "
            "of this input within its node; give the node one more output."
        )
    return own


def is_orthant(X: Cone) -> bool:
    """True if the order of the states is entry by entry."""
    return isinstance(X, Orthant)
