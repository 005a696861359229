"""Reading a coupling: dense, sparse, blocks, or a networkx graph."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix, sparse_matrix
from ..exact.matrix import Matrix
from .model import NetworkModel


def read_coupling(coupling: Any, model: NetworkModel) -> Matrix:
    """W in u = W y as exact data of the size the nodes ask for.

    Parameters
    ----------
    coupling : array_like, sparse matrix, list of lists of blocks, or networkx graph
    model : NetworkModel
        With the nodes; its own coupling is ignored.

    Raises
    ------
    ConeMismatchError
        A coupling of another size than the nodes need (both sizes named).
    ShapeError, DataError
        Ragged blocks, NaN, inf; graphs with parallel edges, unknown node labels or weights that are no
        numbers.
    """
    if is_graph(coupling):
        return _from_graph(coupling, model)
    if sp.issparse(coupling):
        out = Matrix(sparse_matrix(coupling, "coupling"))
    elif _has_blocks(coupling):
        out = _from_blocks(coupling, model)
    else:
        out = exact_matrix(coupling, "coupling")
        if out.is_double:
            out = Matrix(sp.csr_array(out.values))
    _, m, q = model.totals
    if out.shape != (m, q):
        raise ConeMismatchError(
            f"coupling is {out.shape[0]} x {out.shape[1]}, but the nodes have {m} inputs and {q} outputs in "
            f"all{_largest(model)}."
        )
    return out


def _largest(model: NetworkModel) -> str:
    """A hint at the node that people forget: the first with more than one port."""
    for s, index in zip(model.stacks, model.members, strict=True):
        _, m, q = s.sizes
        if (m, q) != (1, 1):
            return f" ({model.name_of(int(index[0]))} has {m} inputs and {q} outputs)"
    return ""


def is_graph(coupling: Any) -> bool:
    """True for networkx graphs, without importing networkx."""
    kind = type(coupling)  # an instance may answer anything
    return all(hasattr(kind, name) for name in ("is_multigraph", "is_directed", "edges", "nodes"))


def _from_graph(graph: Any, model: NetworkModel) -> Matrix:
    """Edge j -> k of weight w: y_j feeds u_k."""
    if graph.is_multigraph():
        raise DataError(
            "coupling is a multigraph; parallel edges have no single weight. Add their weights up in a Graph or "
            "DiGraph."
        )
    for s, index in zip(model.stacks, model.members, strict=True):
        if s.sizes[1:] != (1, 1):
            raise ConeMismatchError(
                f"coupling is a graph, but {model.name_of(int(index[0]))} has {s.sizes[1]} inputs and "
                f"{s.sizes[2]} outputs; "
                "graphs couple nodes with one input and one output. Give a matrix or blocks."
            )
    labels = list(graph.nodes)
    if len(labels) != model.n_nodes:
        raise ConeMismatchError(f"coupling is a graph of {len(labels)} nodes, but there are {model.n_nodes} systems.")
    number: dict[Any, int] = {name: j for j, name in enumerate(model.names)}
    if not any(label in number for label in labels):
        number = {j: j for j in range(model.n_nodes)}
    elif len(number) < model.n_nodes:
        twice = next(name for j, name in enumerate(model.names) if number[name] != j)
        raise ConeMismatchError(
            f"coupling is a graph with names for nodes, but two systems are called {twice!r}; give them different "
            f"names, or number the nodes of the graph 0 to {model.n_nodes - 1}."
        )
    strange = next((label for label in labels if label not in number), None)
    if strange is not None:
        raise ConeMismatchError(
            f"coupling is a graph with a node {strange!r}; nodes must be named like the systems, or 0 to "
            f"{model.n_nodes - 1}."
        )
    rows, columns, weights = [], [], []
    for tail, head, weight in graph.edges(data="weight", default=1):
        ends = [(tail, head)] if graph.is_directed() or tail == head else [(tail, head), (head, tail)]
        for a, b in ends:
            rows.append(number[b])
            columns.append(number[a])
            weights.append(weight)
    values = exact_matrix(weights, "coupling weights", ndim=1)
    if not values.is_double:
        raise DataError("edge weights must be doubles; give exact fractions as a matrix.")
    size = (model.n_nodes, model.n_nodes)
    return Matrix(sparse_matrix(sp.coo_array((values.values, (rows, columns)), shape=size), "coupling"))


def _has_blocks(coupling: Any) -> bool:
    if not isinstance(coupling, (list, tuple)):
        return False
    entries = [b for row in coupling if isinstance(row, (list, tuple)) for b in row]
    return any(b is None or sp.issparse(b) or (not isinstance(b, str) and dimensions(b) == 2) for b in entries)


def _from_blocks(coupling: Any, model: NetworkModel) -> Matrix:
    """Blocks W[j][k] of shape (m_j, q_k); None and 0 stand for zeros."""
    n = model.n_nodes
    if len(coupling) != n or any(len(row) != n for row in coupling):
        lengths = sorted({len(row) for row in coupling})
        raise ConeMismatchError(
            f"coupling has {len(coupling)} block rows of {lengths} blocks, but there are {n} nodes; give {n} x "
            f"{n} blocks."
        )
    m, q = np.diff(model.offsets[1]), np.diff(model.offsets[2])
    rows, columns, data = [], [], []
    for j, row in enumerate(coupling):
        for k, block in enumerate(row):
            if block is None or (dimensions(block) == 0 and not sp.issparse(block) and block == 0):
                continue
            name = f"coupling[{j}][{k}]"
            exact = Matrix(sparse_matrix(block, name)) if sp.issparse(block) else exact_matrix(block, name)
            if exact.shape != (m[j], q[k]):
                raise ConeMismatchError(
                    f"{name} is {exact.shape[0]} x {exact.shape[1]}, but {model.name_of(j)} has {m[j]} inputs and "
                    f"{model.name_of(k)} has {q[k]} outputs."
                )
            if not exact.is_double:
                raise ShapeError(f"{name} holds fractions; give them as one dense coupling matrix.")
            coo = sp.coo_array(exact.values)
            rows.append(coo.coords[0] + model.offsets[1][j])
            columns.append(coo.coords[1] + model.offsets[2][k])
            data.append(coo.data)
    if not data:
        return Matrix(sp.csr_array((model.totals[1], model.totals[2])))
    at = (np.concatenate(rows), np.concatenate(columns))
    return Matrix(
        sparse_matrix(sp.coo_array((np.concatenate(data), at), shape=(model.totals[1], model.totals[2])), "coupling")
    )
