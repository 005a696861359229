"""Arithmetic on stacks of small matrices: batched inverses, block-diagonal CSR; and LAPACK that does not converge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..errors import UndecidedError
from ..exact.distinct import distinct
from ..exact.matrix import Doubles, Matrix
from ..exact.stacks import pieces

Floats: TypeAlias = NDArray[np.float64]
Index: TypeAlias = NDArray[np.intp]

# Entries of a matrix up to which a loop over them takes less time than `einsum`.
_LOOPED = 4


@contextmanager
def converging(what: str) -> Iterator[None]:
    """Where LAPACK or ARPACK fails inside, say what could not be computed."""
    try:
        with np.errstate(all="ignore"):
            yield
    except (np.linalg.LinAlgError, spla.ArpackError) as error:
        raise UndecidedError(
            f"{what} could not be computed ({error}); rescale the data, or move them a little."
        ) from None


def inverse(stack: Floats) -> Floats:
    """Inverses of a stack (N, n, n); all NaN where a matrix is singular."""
    if stack.shape[-1] == 1:
        with np.errstate(divide="ignore"):
            return np.reciprocal(stack).astype(np.float64, copy=False)
    if stack.shape[-1] == 2:  # ten times faster than the general routine on long stacks
        out = np.empty(stack.shape)
        with np.errstate(all="ignore"):
            for part in pieces(len(stack), 4):
                (a, b), (c, d) = np.moveaxis(stack[part], 0, -1)
                determinant = a * d - b * c
                for (i, j), entry in {(0, 0): d, (0, 1): -b, (1, 0): -c, (1, 1): a}.items():
                    np.divide(entry, determinant, out=out[part, i, j])
                singular = ~np.isfinite(out[part]).all(axis=(1, 2))
                if singular.any():
                    out[part][singular] = np.nan
        return out
    try:
        with np.errstate(all="ignore"):
            return np.asarray(np.linalg.inv(stack), dtype=np.float64)
    except np.linalg.LinAlgError:
        pass
    with np.errstate(all="ignore"):  # numpy gives up on the whole stack: set the singular ones aside
        scaled = stack / np.maximum(np.abs(stack).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
        singular = ~(np.abs(np.linalg.det(scaled)) > 0)
        safe = np.where(singular[:, None, None], np.eye(stack.shape[-1]), stack)
        try:
            out = np.linalg.inv(safe)
        except np.linalg.LinAlgError:
            out = np.full(stack.shape, np.nan)
            for j, matrix in enumerate(safe):  # reached only if a determinant hides an exact zero pivot
                try:
                    out[j] = np.linalg.inv(matrix)
                except np.linalg.LinAlgError:
                    continue
    out[singular] = np.nan
    return out


def apply(stack: Floats, x: Floats, *, transposed: bool = False, absolute: bool = False) -> Floats:
    """M_j x_j, or M_j' x_j, for a stack (N, r, c) and vectors (N, c) or (N, r), or |M_j| x_j."""
    rows, columns = stack.shape[1:]
    if transposed:
        stack, rows, columns = stack.transpose(0, 2, 1), columns, rows
    out = np.zeros((len(x), rows))
    for part in pieces(len(x), rows * columns):
        total, M, y = out[part], stack[part] if len(stack) > 1 else stack, x[part]
        M = np.abs(M) if absolute else M
        if rows * columns > _LOOPED:
            np.einsum("nij,nj->ni", M, y, out=total)
            continue
        for i in range(rows):
            for k in range(columns):
                total[:, i] += M[:, i, k] * y[:, k]
    return out


def multiply(left: Floats, right: Floats) -> Floats:
    """Products of two stacks of small matrices, (N, a, b) and (N, b, c)."""
    out = np.zeros((len(left), left.shape[1], right.shape[2]))
    for part in pieces(len(left), left.shape[1] * left.shape[2]):
        total, L, R = out[part], left[part], right[part] if len(right) > 1 else right
        if left.shape[1] * left.shape[2] > _LOOPED:
            np.einsum("nij,njk->nik", L, R, out=total)
            continue
        for i in range(left.shape[1]):
            for k in range(right.shape[2]):
                for j in range(left.shape[2]):
                    total[:, i, k] += L[:, i, j] * R[:, j, k]
    return out


def block_diagonal(parts: Sequence[tuple[Floats, Index, Index]], shape: tuple[int, int]) -> sp.csr_array:
    """Sparse matrix from (blocks, rows, columns): blocks (N, r, c) stand at rows (N, r) and columns (N, c)."""
    if len(parts) == 1 and _in_order(parts[0][1]) and _in_order(parts[0][2]):
        blocks, _, columns = parts[0]
        n, r, c = blocks.shape
        kind = np.int32 if max(*shape, blocks.size) < 2**31 else np.int64
        indices = np.repeat(columns.astype(kind), r, axis=0).ravel()
        indptr = np.arange(0, n * r * c + 1, max(c, 1), dtype=kind) if c else np.zeros(n * r + 1, dtype=kind)
        return sp.csr_array((blocks.ravel(), indices, indptr), shape=shape)
    data = [blocks.ravel() for blocks, _, _ in parts]
    i = [np.repeat(rows.ravel(), columns.shape[1]) for _, rows, columns in parts]
    j = [np.repeat(columns, rows.shape[1], axis=0).ravel() for _, rows, columns in parts]
    return sp.csr_array((np.concatenate(data), (np.concatenate(i), np.concatenate(j))), shape=shape)


def read_only(M: sp.csr_array) -> sp.csr_array:
    """The same matrix, in which nothing can be assigned any more."""
    M.sort_indices()
    for part in (M.data, M.indices, M.indptr):
        part.flags.writeable = False
    return M


def shared_view(M: sp.csr_array) -> sp.csr_array:
    """Another csr_array of the same arrays: what is assigned to it is not assigned to M."""
    return sp.csr_array((M.data, M.indices, M.indptr), shape=M.shape, copy=False)


def _in_order(index: Index) -> bool:
    return index.size == 0 or (
        index.ravel()[0] == 0 and index.ravel()[-1] == index.size - 1 and bool((np.diff(index.ravel()) == 1).all())
    )


def nonzero_blocks(M: Doubles, row_owner: Index, column_owner: Index) -> tuple[Index, Index]:
    """Pairs (j, k) of blocks that hold a nonzero entry."""
    coo = sp.coo_array(M)
    keep = coo.data != 0
    i, k = row_owner[coo.coords[0][keep]].astype(np.int64), column_owner[coo.coords[1][keep]].astype(np.int64)
    width = int(column_owner.max(initial=0)) + 1
    pairs = distinct(i * width + k)
    return pairs // width, pairs % width


def shared(stack: Matrix) -> Matrix:
    """A stack of one matrix if all are equal: equal nodes need no separate proof."""
    values = stack.values
    if not stack.is_double or len(values) < 2 or not np.array_equal(values[0], values[-1]):
        return stack
    return Matrix(values[:1]) if not values.strides[0] or (values == values[:1]).all() else stack


def take_blocks(M: Matrix, rows: Index, columns: Index) -> Matrix:
    """Blocks M[rows_b, columns_b] as a stack: rows (K, r), columns (K, c) -> (K, r, c)."""
    if not M.is_sparse:
        return M[rows[:, :, None], columns[:, None, :]]
    r, c = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    if r.size == 0:
        return Matrix(np.zeros(r.shape))
    flat = sp.csr_array(M.values)[r.flatten(), c.flatten()]  # copies: older scipy writes into indices
    return Matrix(np.asarray(flat.todense() if sp.issparse(flat) else flat, dtype=float).reshape(r.shape))
