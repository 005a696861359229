"""Nodes of one size and with the same cones, in stacked arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from control.config import defaults
from numpy.typing import ArrayLike

from ..cones import Cone, Orthant, as_cone, orthant
from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix, places
from ..exact.matrix import Matrix
from ..proof.encoding import register_record
from ..systems.reading import require_timebase
from .ranges import Interval, end_of

Timebase: TypeAlias = "float | bool | None"


@register_record
@dataclass(frozen=True, eq=False)
class NodeStack:
    """Many nodes of one size with the same cones, as `control_kpos.stack` builds them.

    Attributes
    ----------
    A, B, C, D : Matrix, shapes (N, n, n), (N, n, m), (N, q, n), (N, q, m)
    X, U, Y : Cone
        Proper cones in R^n, R^m, R^q.
    dt : float, bool or None
        Timebase as in python-control: 0 continuous, a positive number or True discrete.
    names : tuple of str
        Node names; empty if none were given.
    labels : tuple of (states, inputs, outputs)
        Signal names per node, each a tuple of str; empty for the defaults x[i], u[i], y[i].
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    X: Cone
    U: Cone
    Y: Cone
    dt: Timebase = 0
    names: tuple[str, ...] = ()
    labels: tuple[tuple[tuple[str, ...], ...], ...] = ()

    def __len__(self) -> int:
        return self.A.shape[0]

    @cached_property
    def sizes(self) -> tuple[int, int, int]:
        """States, inputs and outputs of one node."""
        return self.A.shape[-1], self.B.shape[-1], self.C.shape[-2]

    @cached_property
    def rays(self) -> tuple[Matrix, Matrix, Matrix]:
        """Generators of X, U and Y in dense form."""
        return self.X.exact_rays.dense(), self.U.exact_rays.dense(), self.Y.exact_rays.dense()

    @property
    def transposed(self) -> NodeStack:
        """The nodes (A', C', B', D') on X*, Y*, U*."""
        labels = tuple((x, y, u) for x, u, y in self.labels)
        cones = self.X.dual, self.Y.dual, self.U.dual
        return NodeStack(self.A.T, self.C.T, self.B.T, self.D.T, *cones, self.dt, self.names, labels)

    def take(self, index: Any) -> NodeStack:
        """The nodes at these places, as a stack."""
        index = np.atleast_1d(np.asarray(index, dtype=np.intp))
        a, b, c, d = (m[index] for m in (self.A, self.B, self.C, self.D))
        names = tuple(self.names[i] for i in index) if self.names else ()
        labels = tuple(self.labels[i] for i in index) if self.labels else ()
        return NodeStack(a, b, c, d, self.X, self.U, self.Y, self.dt, names, labels)

    def __repr__(self) -> str:
        n, m, q = self.sizes
        return f"<NodeStack of {len(self)} nodes: {n} states, {m} inputs, {q} outputs each>"


@dataclass(frozen=True, eq=False)
class UncertainStack(NodeStack):
    """Nodes that are each known to be one of several, or a mixture of them; A, B, C, D are those of the first.

    Attributes
    ----------
    vertices : tuple of NodeStack
        Node j is (A, B, C, D)_j of one of these, or any convex combination of them.
    lower : NodeStack or None
        Matrices in ranges, on orthants: their lower ends; the upper ends are those of all vertices.
    """

    vertices: tuple[NodeStack, ...] = ()
    lower: NodeStack | None = None

    def __repr__(self) -> str:
        return f"{NodeStack.__repr__(self)[:-1]}, {known_by(len(self.vertices), self.lower)}>"


def known_by(count: int, lower: Any) -> str:
    """How many vertices there are, and whether there are ranges, in words."""
    vertices = f"{count} vertices" if count > 1 or lower is None else ""
    return " and ".join(part for part in (vertices, "" if lower is None else "ranges") if part)


def vertices_of(stack: NodeStack) -> tuple[NodeStack, ...]:
    """The vertices of a stack: itself, if its nodes are known exactly."""
    return stack.vertices if isinstance(stack, UncertainStack) else (stack,)


def with_vertices(vertices: tuple[NodeStack, ...]) -> UncertainStack:
    """Nodes with these vertices, in stacks of the same cones."""
    first = {field.name: getattr(vertices[0], field.name) for field in fields(NodeStack)}
    return UncertainStack(**first, vertices=vertices)


def stack(
    A: ArrayLike | Sequence[ArrayLike] | Interval,
    B: ArrayLike | Sequence[ArrayLike] | Interval,
    C: ArrayLike | Sequence[ArrayLike] | Interval,
    D: ArrayLike | Sequence[ArrayLike] | Interval | None = None,
    dt: Timebase = None,
    *,
    X: Cone | ArrayLike | None = None,
    U: Cone | ArrayLike | None = None,
    Y: Cone | ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> NodeStack:
    """Many nodes of one size as stacked arrays, for networks up to millions of nodes.

    Parameters
    ----------
    A : array_like, shape (N, n, n), or a list of S of them
        A list [A1, A2, ...], or an array (S, N, n, n), gives every node S vertices: see Returns.  On nonnegative
        orthants each matrix may be a range, `control_kpos.interval`, the same at all vertices.
    B : array_like, shape (N, n, m) or (n, m), or a list of S stacks (N, n, m)
        Two-dimensional B, C or D is the same for all nodes; what is given once is the same at all vertices.
    C : array_like, shape (N, q, n) or (q, n), or a list of S stacks (N, q, n)
    D : array_like, shape (N, q, m) or (q, m), or a list of S stacks (N, q, m), optional
        Zero if not given.
    dt : float, bool or None
        0 for continuous time, a positive number or True for discrete time; the default is
        python-control's, 0.
    X, U, Y : Cone, or array_like of its generators, optional
        The same for all nodes; the nonnegative orthants if not given.
    names : sequence of str, optional
        One name per node.

    Returns
    -------
    NodeStack
        To be passed to `feedback_interconnect`.  With vertices an `UncertainStack`: node j is any
        (A, B, C, D)_j^s, s = 1..S, taken jointly, or a mixture of them, another one at any time and at every node;
        with ranges every entry is anywhere in its range.
        Only `feedback_interconnect` takes it.

    Raises
    ------
    ShapeError, DataError
        Sizes that do not fit, an empty stack, numbers that are not finite and real; vertices that differ in size or
        in number.
    NotProperConeError, ConeMismatchError
        Cones that are not proper, or of another dimension; ranges on other cones than orthants.

    Notes
    -----
    Copies the arrays once: 8 N (n n + n m + q n + q m) bytes.

    Examples
    --------
    >>> import numpy as np, control_kpos as kp
    >>> A = np.array([[[0, 1], [-22, -13]], [[0, 1], [-21, -13]]])
    >>> nodes = kp.stack(A, B=[[0], [1]], C=[[1, 0]], X=kp.PolyhedralCone([[0, 1], [1, -2]]))
    >>> len(nodes), nodes.sizes
    (2, (2, 1, 1))
    """
    given: dict[str, Any] = {"A": A, "B": B, "C": C, "D": D}
    cones: dict[str, Any] = {"X": X, "U": U, "Y": Y}
    if any(isinstance(data, Interval) for data in given.values()):
        return _in_ranges(given, dt, cones, names)
    lists = {name: found for name, data in given.items() if (found := _vertices(data, name)) is not None}
    if not lists:
        return _certain(given, dt, cones, names)
    _require_alike(lists)
    first = _certain(given | {name: found[0] for name, found in lists.items()}, dt, cones, names)
    known = {"X": first.X, "U": first.U, "Y": first.Y}
    others = [_certain(given | dict(zip(lists, k, strict=True)), dt, known) for k in zip(*lists.values(), strict=True)]
    return with_vertices((first, *others[1:]))


def _in_ranges(given: dict[str, Any], dt: Timebase, cones: dict[str, Any], names: Sequence[str] | None) -> NodeStack:
    """Nodes between two ends, at every vertex if other matrices are lists."""
    first = {}
    for name, data in given.items():
        found = _vertices(end_of(data, "upper"), name)
        if found is not None and isinstance(data, Interval):
            raise DataError(f"{name} is a range of several stacks; a range is the same for all vertices of a node.")
        first |= {} if found is None else {name: found[0]}
    upper = stack(**{name: end_of(data, "upper") for name, data in given.items()}, dt=dt, **cones, names=names)
    for name in ("X", "U", "Y"):
        if not isinstance(getattr(upper, name), Orthant):
            raise ConeMismatchError(
                f"{name} is no nonnegative orthant; ranges of entries are for orthants. Give the vertices as lists."
            )
    low = {name: end_of(data, "lower") for name, data in given.items()} | first
    lower = _certain(low, dt, {"X": upper.X, "U": upper.U, "Y": upper.Y})
    if lower.sizes != upper.sizes or len(lower) != len(upper):
        raise ShapeError("the ends of the ranges have not the shapes of one stack.")
    return replace(with_vertices(vertices_of(upper)), lower=lower)


def _vertices(data: Any, name: str) -> list[Any] | None:
    """The stacks in a list of them or in an array of four dimensions, as matrices; None for a single one."""
    if isinstance(data, (list, tuple)):
        several = bool(data) and dimensions(data[0]) == 3
    else:
        several = dimensions(data) == 4
    if not several:
        return None
    found = [exact_matrix(part, f"{name}[{s}]", ndim=3) for s, part in enumerate(data)]
    if not found:
        raise ShapeError(f"{name} is an empty list of vertices; give at least one stack of matrices.")
    return found


def _require_alike(lists: dict[str, list[Any]]) -> None:
    """Raise if the matrices of a list differ in shape, or two lists in length."""
    name, found = next(iter(lists.items()))
    for other, those in lists.items():
        if len(those) != len(found):
            raise ShapeError(
                f"{name} has {len(found)} vertices, but {other} has {len(those)}; a vertex is one A, B, C and D "
                "together. Give lists of one length, or a matrix once for all vertices."
            )
        apart = next((s for s, part in enumerate(those) if part.shape != those[0].shape), None)
        if apart is not None:
            raise ShapeError(
                f"{other}[{apart}] has shape {those[apart].shape}, but {other}[0] has {those[0].shape}; the vertices "
                "of a node have one size."
            )


def _certain(
    given: dict[str, Any], dt: Timebase, cones_given: dict[str, Any], names: Sequence[str] | None = None
) -> NodeStack:
    """Nodes from one stack of every matrix; D may be None."""
    matrices = {name: exact_matrix(given[name], name, ndim=3) for name in "ABC"}
    count, n = matrices["A"].shape[0], matrices["A"].shape[2]
    m, q = matrices["B"].shape[2], matrices["C"].shape[1]
    matrices["D"] = Matrix.zeros(1, q, m) if given["D"] is None else exact_matrix(given["D"], "D", ndim=3)
    if count == 0 or n == 0:
        raise ShapeError(f"A has shape {matrices['A'].shape}: a stack needs at least one node with at least one state.")
    for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (q, n)), ("D", (q, m))):
        have = matrices[name].shape
        if have[1:] != shape or have[0] not in (1, count):
            raise ShapeError(
                f"{name} has shape {have}; it must be ({count}, {shape[0]}, {shape[1]}), one matrix per node as in A."
            )
        if have[0] == 1 < count:
            matrices[name] = matrices[name][np.zeros(count, dtype=np.intp)]
    cones = {}
    for (name, cone), size in zip(cones_given.items(), (n, m, q), strict=True):
        cones[name] = orthant(size) if cone is None else as_cone(cone, name)
        if cones[name].dim != size:
            raise ConeMismatchError(
                f"{name} is a cone in dimension {cones[name].dim}, but the nodes need dimension {size}."
            )
        cones[name].require_proper(name)
    labels = tuple(str(name) for name in places(names, "names")) if names is not None else ()
    if labels and (len(labels) != count or len(set(labels)) != count):
        raise ShapeError(
            f"names has {len(labels)} entries ({len(set(labels))} distinct); {count} nodes need {count} distinct names."
        )
    require_timebase(dt)
    dt = defaults["control.default_dt"] if dt is None else dt
    return NodeStack(**matrices, **cones, dt=dt, names=labels)
