"""Reading a coupling: dense, sparse, blocks, or a networkx graph."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import ConeMismatchError, DataError, TooLargeError
from ..exact.intake import dimensions, exact_matrix, sparse_matrix
from ..exact.matrix import Matrix
from .blocks import Index
from .model import NetworkModel
from .ranges import end_of, has_ranges, is_graph

# Entries up to which couplings with fractions are kept, in dense form.
_EXACT_ENTRIES = 10**7


def read_coupling(coupling: Any, model: NetworkModel) -> Matrix:
    """W in u = W y as exact data of the size that the nodes of the model ask for; its own coupling is ignored.

    Raises
    ------
    ConeMismatchError
        A coupling of another size than the nodes need (both sizes named).
    ShapeError, DataError
        Ragged blocks, NaN, inf; graphs with parallel edges or weights that are no numbers.
    TooLargeError
        Fractions among more than 10^7 entries, zeros counted.
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


def read_ends(coupling: Any, model: NetworkModel) -> tuple[Matrix, Matrix]:
    """The upper and lower ends of W, which are the same object if it has no ranges; see `read_coupling`."""
    if not has_ranges(coupling):
        W = read_coupling(coupling, model)
        return W, W
    if is_graph(coupling):
        return _from_graph(coupling, model, "upper"), _from_graph(coupling, model, "lower")
    return read_coupling(end_of(coupling, "upper"), model), read_coupling(end_of(coupling, "lower"), model)


def _largest(model: NetworkModel) -> str:
    """A hint at the node that people forget: the first with more than one port."""
    for s, index in zip(model.stacks, model.members, strict=True):
        _, m, q = s.sizes
        if (m, q) != (1, 1):
            return f" ({model.name_of(int(index[0]))} has {m} inputs and {q} outputs)"
    return ""


def _from_graph(graph: Any, model: NetworkModel, end: str = "") -> Matrix:
    """Edge j -> k of weight w, or one end of its range: y_j feeds u_k."""
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
    number = {label: j for j, label in enumerate(_labels_in_order(graph, model))}
    rows, columns, weights = [], [], []
    for tail, head, weight in graph.edges(data="weight", default=1):
        ends = [(tail, head)] if graph.is_directed() or tail == head else [(tail, head), (head, tail)]
        for a, b in ends:
            rows.append(number[b])
            columns.append(number[a])
            weights.append(end_of(weight, end) if end else weight)
    values = exact_matrix(weights, "coupling weights", ndim=1)
    i, k = np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)
    return from_entries([i], [k], [values], (model.n_nodes, model.n_nodes))


def _labels_in_order(graph: Any, model: NetworkModel) -> list[Any]:
    """The nodes of a graph in the order of the systems.

    Labels may be the names of the systems, or 0, ..., N - 1.  Any others stand for the systems in the order in which
    the graph holds its nodes.
    """
    labels = list(graph.nodes)
    if len(labels) != model.n_nodes:
        raise ConeMismatchError(f"coupling is a graph of {len(labels)} nodes, but there are {model.n_nodes} systems.")
    number: dict[Any, int] = {name: j for j, name in enumerate(model.names)}
    if not any(label in number for label in labels):
        numbered = set(labels) == set(range(len(labels)))
        return list(range(len(labels))) if numbered else labels
    if len(number) < model.n_nodes:
        twice = next(name for j, name in enumerate(model.names) if number[name] != j)
        raise ConeMismatchError(
            f"coupling is a graph with names for nodes, but two systems are called {twice!r}; give them different "
            f"names, or number the nodes of the graph 0 to {model.n_nodes - 1}."
        )
    strange = next((label for label in labels if label not in number), None)
    if strange is not None:
        raise ConeMismatchError(
            f"coupling is a graph with a node {strange!r} that is no name of a system, although others are; name all "
            f"nodes of the graph like the systems, or 0 to {model.n_nodes - 1}."
        )
    return model.names


def named_by_graph(model: NetworkModel, coupling: Any) -> NetworkModel:
    """The nodes with the labels of a graph as their names, where they have none of their own."""
    if not is_graph(coupling) or any(s.names for s in model.stacks):
        return model
    labels = [str(label) for label in _labels_in_order(coupling, model)]
    if len(set(labels)) < len(labels) or labels == [str(j) for j in range(len(labels))]:
        return model
    stacks = tuple(
        replace(s, names=tuple(labels[j] for j in index.tolist()))
        for s, index in zip(model.stacks, model.members, strict=True)
    )
    return NetworkModel(stacks, model.members, model.coupling, model.dt)


def entries_of(M: Matrix) -> tuple[Index, Index, Matrix]:
    """Rows, columns and exact values of the entries that are not zero."""
    if M.is_double:
        coo = sp.coo_array(M.values)
        return coo.coords[0].astype(np.intp), coo.coords[1].astype(np.intp), Matrix(coo.data)
    rows, columns = np.nonzero(M.as_integers()[0])
    return rows, columns, M[rows, columns]


def from_entries(
    rows: list[Index], columns: list[Index], values: list[Matrix], shape: tuple[int, int], name: str = "coupling"
) -> Matrix:
    """A coupling from its entries, those in the same place added: sparse, or dense if there are fractions."""
    at = np.concatenate([*rows, np.zeros(0, dtype=np.intp)]), np.concatenate([*columns, np.zeros(0, dtype=np.intp)])
    if all(part.is_double for part in values):
        data = np.concatenate([*(part.values for part in values), np.zeros(0)])
        return Matrix(sparse_matrix(sp.coo_array((data, at), shape=shape), name))
    if shape[0] * shape[1] > _EXACT_ENTRIES:
        raise TooLargeError(
            f"{name} of {shape[0]} x {shape[1]} with decimals or fractions is refused (limit {_EXACT_ENTRIES} entries, "
            "zeros counted); give a graph this large in doubles."
        )
    out = np.full(shape, Fraction(0), dtype=object)
    np.add.at(out, at, np.concatenate([part.fractions() for part in values]))
    return Matrix.from_fractions(out)


def _has_blocks(coupling: Any) -> bool:
    if not isinstance(coupling, (list, tuple)):
        return False
    entries = (b for row in coupling if isinstance(row, (list, tuple)) for b in row)
    return any(
        b is None or sp.issparse(b) or dimensions(b) == 2 for b in entries if not isinstance(b, (str, int, float))
    )


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
    rows, columns, values = [], [], []
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
            i, k_own, entries = entries_of(exact)
            rows.append(i + model.offsets[1][j])
            columns.append(k_own + model.offsets[2][k])
            values.append(entries)
    return from_entries(rows, columns, values, model.totals[1:])
