"""Products of operands of bilinear forms, and sizes of them: absolute values, numbers of entries, norms."""

from __future__ import annotations

from functools import reduce
from itertools import product
from math import prod
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .matrix import Matrix, is_sparse
from .rounding import SMALLEST_NORMAL, SUM_FACTOR, sum_factor

# Entries up to which dense arithmetic takes less time than sparse, and products less than norms.
SMALL = 4096
# Entries of a matrix of a stack up to which `einsum` takes less time than a stacked product.
SHORT_ROWS = 64
_SHORT = 16


def times(x: Any, y: Any) -> Any:
    """x @ y; long stacks of short rows by one product where y is the same for all, and entry by entry otherwise."""
    if is_sparse(x) or is_sparse(y) or x.ndim != 3:
        return x @ y
    if y.ndim == 2:
        return (x.reshape(len(x) * x.shape[1], x.shape[2]) @ y).reshape(*x.shape[:2], y.shape[1])
    if y.ndim == 3 and x.shape[1] == 1 and y.shape[1] * y.shape[2] <= SHORT_ROWS:
        return np.einsum("nka,nab->nkb", x, y)
    return x @ y


def dense_if_small(m: Matrix) -> Matrix:
    """Sparse operands below the size where their overhead pays, as dense ones."""
    return m.kept_dense if m.is_sparse and m.shape[0] * m.shape[1] <= SMALL else m


def absolute(values: Any) -> Any:
    """Absolute values; a sparse matrix shares its places, which are not to be written to, and entries above 0."""
    if not is_sparse(values):
        return abs(values)
    if values.data.min(initial=0.0) >= 0:
        return values
    return sp.csr_array((np.abs(values.data), values.indices, values.indptr), shape=values.shape)


def nonzero(m: Matrix) -> Any:
    """Ones where the exact entry may be nonzero."""
    if m.is_sparse:
        reach = abs(m.values) if m.radius is None else abs(m.values) + m.radius
        return sp.csr_array((np.ones(reach.nnz), reach.indices, reach.indptr), m.shape)
    kind = m.values != 0 if m.radius is None else (m.values != 0) | (m.radius != 0)
    return kind.astype(np.float64)


def finite(m: Matrix) -> bool:
    """True if no entry is infinite or NaN."""
    return bool(np.isfinite(m.values.data if m.is_sparse else m.values).all())


def row_length(m: Matrix) -> int:
    """The most entries of a row."""
    return int(np.diff(m.values.indptr).max(initial=0)) if is_sparse(m.values) else m.shape[-1]


def _norm(values: NDArray[np.float64], axes: tuple[int, ...]) -> NDArray[np.float64]:
    """Bound on the Euclidean norm over trailing axes, at most the root of their size too large.

    Square roots are correctly rounded (IEEE 754), as sums and products are.
    """
    sizes = values.shape[len(values.shape) - len(axes) :]
    count = prod(sizes)
    if 0 < count <= _SHORT:  # numpy reduces short axes slowly
        entries = (np.abs(values[(..., *index)]) for index in product(*map(range, sizes)))
        return reduce(np.maximum, entries) * (np.sqrt(count) * SUM_FACTOR) + SMALLEST_NORMAL
    top = np.abs(values).max(axis=axes, keepdims=True, initial=0.0)
    scaled = np.divide(values, top, out=np.zeros_like(values), where=top > 0)
    total = np.sqrt(np.square(scaled).sum(axis=axes)) * sum_factor(count)
    return total * top.reshape(total.shape) + SMALLEST_NORMAL


def row_norms(m: Matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Norms of the rows, and of their radii."""
    sizes = [
        _sparse_row_norms(part) if is_sparse(part) else _norm(part, (-1,))
        for part in (m.values, m.radius)
        if part is not None
    ]
    return sizes[0], sizes[1] if len(sizes) > 1 else np.zeros_like(sizes[0])


def _sparse_row_norms(rows: sp.csr_array) -> NDArray[np.float64]:
    top = abs(rows).max(axis=1).toarray().ravel() if rows.nnz else np.zeros(rows.shape[0])
    return top * np.sqrt(np.diff(rows.indptr)) * SUM_FACTOR + SMALLEST_NORMAL


def frobenius(m: Matrix) -> tuple[Any, Any]:
    """Norms of the matrix, or of each of a stack, and of its radii."""
    if is_sparse(m.values):
        return _norm(m.values.data, (-1,)), 0.0 if m.radius is None else _norm(m.radius.data, (-1,))
    shape = m.shape[:-2] + (1, 1)
    size = _norm(m.values, (-2, -1)).reshape(shape)
    return size, np.zeros(shape) if m.radius is None else _norm(m.radius, (-2, -1)).reshape(shape)
