"""The trusted kernel: proven signs of bilinear forms z_ki = l_k' M r_i.

Every claim of this package comes down to signs of such numbers: h_k'A x_i for invariance, v'A x_i
for stability.  Three steps, each taken only for what the one before left open:

1. floating point with an a-priori bound, |fl(z) - z| <= g |l|'|M||r| + underflow by the lemma in `rounding`,
   first with norms, where these take less time, then entrywise;
2. exactness: if all data are multiples of powers of two so coarse that |l|'|M||r| stays below 2^52
   units, no rounding happened and fl(z) = z;
3. integer arithmetic with mantissas at a common exponent.

Comparisons are written so that NaN and infinity count as undecided.  Nothing here calls a solver.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .distinct import distinct
from .matrix import (
    Integers,
    Matrix,
    dense,
    granularity,
    integers_of_doubles,
    is_sparse,
)
from .rounding import RADIUS_FACTOR, SMALLEST_NORMAL, chain_constants
from .sizes import (
    SHORT_ROWS,
    SMALL,
    absolute,
    dense_if_small,
    finite,
    frobenius,
    nonzero,
    row_length,
    row_norms,
    times,
)
from .sparse_integers import SparseIntegers, columns_as_integers, csr_integers

UNKNOWN = 2
# Multiplications of integers after which exact arithmetic gives up (about a minute).
EXACT_LIMIT = 3 * 10**8
_CHUNK = 10**6


class BilinearForms:
    """The numbers z_ki = l_k' M r_i for rows l_k of `left` and rows r_i of `right`.

    Parameters
    ----------
    left : Matrix, shape (..., k, a)
    middle : Matrix, shape (..., a, b), or None for the identity
    right : Matrix, shape (..., p, b)
        Dense, or sparse in two dimensions.  Dense operands may be stacks; leading dimensions
        broadcast.  The result is sparse if every operand is; entries outside its pattern are zero.

    Notes
    -----
    Signs cost a few times the products themselves; integer arithmetic runs only on entries whose
    relative size |z| / (|l|'|M||r|) is below about 1e-15.
    """

    # The operand that multiplies the product of the others.
    _multiplied_last = -1

    def __init__(self, left: Matrix, middle: Matrix | None, right: Matrix) -> None:
        self.is_sparse = all(m.is_sparse for m in (left, middle, right) if m is not None)
        if not self.is_sparse:
            left, right = dense_if_small(left), dense_if_small(right)
            middle = None if middle is None else dense_if_small(middle)
        self.left, self.middle, self.right = left, middle, right
        self._operands = [m for m in (left, middle, right) if m is not None]
        self._is_double = all(m.is_double for m in self._operands)

    def pieces(self) -> Iterator[tuple[slice, BilinearForms]]:
        """The forms on pieces of a long stack, made one after the other: of this one, all at once."""
        yield slice(None), self

    @cached_property
    def values(self) -> Any:
        """The forms in floating point: ndarray (..., k, p), or csr_array on `pattern`."""
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            z = self._product(*(m.values for m in self._operands))
        return self._on_pattern(z) if self.is_sparse else np.asarray(z)

    @cached_property
    def magnitudes(self) -> Any:
        """|l_k|' |M| |r_i| in floating point, shaped like `values`."""
        return self._on_pattern(self._summed_sizes) if self.is_sparse else np.asarray(self._summed_sizes)

    @cached_property
    def pattern(self) -> sp.csr_array:
        """Positions of a sparse result where some product of entries may not be zero."""
        if self._smallest_product > SMALLEST_NORMAL and self._is_double:
            out = sp.csr_array(self._summed_sizes)
        else:
            out = sp.csr_array(self._product(*(nonzero(m) for m in self._operands)))
        out.sort_indices()
        return out

    @cached_property
    def _summed_sizes(self) -> Any:
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            return self._product(*(absolute(m.values) for m in self._operands))

    @cached_property
    def _smallest_product(self) -> float:
        """No more than the size of any product of entries of sparse operands that are not zero."""
        sizes = (np.abs(m.values.data) for m in self._operands)
        return prod(float(size.min(initial=1.0, where=size != 0)) for size in sizes)

    @np.errstate(all="ignore")
    def enclosure(self, *, exactly: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Proven bounds of dense forms from below and above, infinite or NaN where there are none.

        They are equal where nothing was rounded, if `exactly`, for which all data are read once more.
        """
        z, bound = self.values, self._entry_bound()
        low, high = np.nextafter(z - bound, -np.inf), np.nextafter(z + bound, np.inf)
        if exactly:
            exact = self.magnitudes <= self._exactness_limit()
            low[exact] = high[exact] = z[exact]
            low[self._structure() == 0] = high[self._structure() == 0] = 0.0
        return low, high

    def relative(self) -> Any:
        """z_ki / (|l_k|'|M||r_i|), between -1 and 1 and free of all scales; 0 for 0/0."""
        z, m = (self.values.data, self.magnitudes.data) if self.is_sparse else (self.values, self.magnitudes)
        with np.errstate(invalid="ignore", over="ignore"):
            ratio = np.divide(z, m, out=np.zeros_like(m), where=m > 0)
        if not self.is_sparse:
            return ratio
        return sp.csr_array((ratio, self.pattern.indices, self.pattern.indptr), self.pattern.shape)

    def signs(self, where: NDArray[np.bool_] | None = None, *, integers: bool = True) -> Any:
        """Proven signs -1, 0, +1, or `UNKNOWN` where exact arithmetic would be out of reach.

        Parameters
        ----------
        where : ndarray of bool, shaped like the dense result, optional
            Entries that matter; the others are reported as `UNKNOWN` unless they come for free.
        integers : bool
            False: leave what floating point cannot decide as `UNKNOWN`.

        Returns
        -------
        ndarray of int8, shape (..., k, p), or csr_array of int8 on `pattern`
        """
        z = self.values.data if self.is_sparse else self.values
        out = np.full(z.shape, UNKNOWN, dtype=np.int8)
        if not self._is_small and not any(m.is_sparse for m in self._operands):
            _decide(out, z, self._norm_bound())  # the norm of a large sparse matrix decides nothing
        open_ = _unknown(out, where)
        if open_.any() and self._is_finite:
            _decide(out, z, self._entry_bound())
            open_ = _unknown(out, where)
            if open_.any():
                if not self.is_sparse:
                    out[self._structure() == 0] = 0
                if _unknown(out, where).any():
                    magnitudes = self.magnitudes.data if self.is_sparse else self.magnitudes
                    exact = (out == UNKNOWN) & (magnitudes <= self._exactness_limit())
                    out[exact] = np.sign(z[exact]).astype(np.int8)
                open_ = _unknown(out, where)
                if integers and open_.any():
                    self._decide_by_integers(out, open_)
        if self.is_sparse:
            return sp.csr_array((out, self.pattern.indices, self.pattern.indptr), self.pattern.shape)
        return out

    # -- floating point with a bound

    @property
    def _is_finite(self) -> bool:
        return all(finite(m) for m in self._operands)

    @property
    def _is_small(self) -> bool:
        """True if the products of the entrywise bound take less time than norms; its zeros, signs and margins too."""
        width = self.left.shape[-1] * self.right.shape[-1]
        in_rows = len(self.left.shape) == 3 and self.left.shape[-2] == 1 and len(self.right.shape) == 2
        return (width <= SMALL and self.values.size <= SMALL) or (in_rows and width <= SHORT_ROWS)

    @cached_property
    def _ends_in_identity(self) -> bool:
        """True if the rows r_i are the unit vectors, and the forms the entries of l'M."""
        R, n = self.right.values, self.right.shape[-1]
        if not self.right.is_sparse or not self.right.is_double or R.shape != (n, n) or self.middle is None:
            return False
        unit = R.nnz == n and bool((R.data == 1).all()) and np.array_equal(R.indices, np.arange(n))
        return unit and np.array_equal(R.indptr, np.arange(n + 1))

    def _product(self, *factors: Any) -> Any:
        *head, right = factors
        out = times(head[0], head[1]) if len(head) == 2 else head[0]
        if self._ends_in_identity:
            return out
        return times(out, right.T if is_sparse(right) else np.swapaxes(right, -1, -2))

    def _on_pattern(self, z: sp.csr_array) -> sp.csr_array:
        z = sp.csr_array(z)
        z.sort_indices()
        if z.nnz != self.pattern.nnz:  # a product underflowed and was dropped
            rows = np.repeat(np.arange(z.shape[0]), np.diff(self.pattern.indptr))
            data = np.asarray(z[rows, self.pattern.indices]).ravel()
        else:
            data = z.data
        return sp.csr_array((data, self.pattern.indices, self.pattern.indptr), self.pattern.shape)

    @cached_property
    def _lengths(self) -> tuple[int, int]:
        """Bounds on the number of terms in the inner sums over a and over b."""
        if self.middle is None:
            return 0, min(row_length(self.left), row_length(self.right))
        return min(row_length(self.left), self.middle.column_length), row_length(self.right)

    @cached_property
    def _constants(self) -> tuple[float, float, float]:
        """The factor of the lemma, and what underflows in l'M, before r multiplies it, and in the sum over b.

        A term passes through one rounding for each entry of both inner sums.
        """
        return chain_constants(*self._lengths)

    def _norm_bound(self) -> NDArray[np.float64]:
        """Bound on |fl(z) - z| through Euclidean norms: no matrix product."""
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            nl, dl = row_norms(self.left)
            nr, dr = row_norms(self.right)
            nm, dm = (1.0, 0.0) if self.middle is None else frobenius(self.middle)
            nl, dl, nr, dr = nl[..., :, None], dl[..., :, None], nr[..., None, :], dr[..., None, :]
            g, inner, outer = self._constants  # |r|_1 <= sqrt(length) |r|_2
            bound = (g * nl * nm + inner * np.sqrt(self._lengths[1])) * nr + outer
            if not self._is_double:
                bound = bound + RADIUS_FACTOR * (dl * nm * nr + (nl + dl) * dm * nr + (nl + dl) * (nm + dm) * dr)
            return bound

    def _entry_bound(self) -> NDArray[np.float64]:
        """Bound on |fl(z) - z| entry by entry."""
        g, inner, outer = self._constants
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            spread = np.ones(1) if self._ends_in_identity else np.asarray(abs(self.right.values).sum(axis=-1))
            lost = inner * spread + outer
            if self.is_sparse:
                bound = g * self.magnitudes.data + (lost if len(lost) == 1 else lost[self.pattern.indices])
            else:
                bound = g * self.magnitudes + lost[..., None, :]
            if self._is_double:
                return bound
            done: list[Any] = []
            for i, m in enumerate(self._operands):
                if m.radius is not None:
                    rest = [absolute(k.values) for k in self._operands[i + 1 :]]
                    more = self._product(*done, m.radius, *rest)
                    bound = bound + RADIUS_FACTOR * (self._on_pattern(more).data if self.is_sparse else dense(more))
                done.append(absolute(m.values) if m.radius is None else abs(m.values) + m.radius)
            return bound

    def _structure(self) -> NDArray[np.float64]:
        """Number of products of nonzero entries in each form; 0 proves a zero."""
        return dense(self._product(*(nonzero(m) for m in self._operands)))

    def _exactness_limit(self) -> float:
        """Magnitude up to which the floating point result is exact; negative if that cannot be said."""
        if not self._is_double:
            return -1.0
        units = granularity(*(m.values.data if m.is_sparse else m.values for m in self._operands))
        unit = sum(units)
        if min(unit, unit - units[self._multiplied_last]) < -1000 or unit > 900:
            return -1.0
        return float(np.ldexp(1.0, unit + 52))

    # -- integers

    def _decide_by_integers(self, out: NDArray[np.int8], open_: NDArray[np.bool_]) -> None:
        if self.is_sparse:
            rows = np.repeat(np.arange(self.pattern.shape[0]), np.diff(self.pattern.indptr))
            out[open_] = self._sparse_pairs(rows[open_], self.pattern.indices[open_])
            return
        if any(m.is_sparse for m in self._operands):
            out[open_] = self._sparse_pairs(*np.nonzero(open_))
            return
        index = np.nonzero(open_)
        width = self.right.shape[-1]
        cost = len(index[0]) * width * (self.left.shape[-1] if out.ndim > 2 else 1)
        if out.ndim == 2 and self.middle is not None:
            cost += len(distinct(index[0])) * self.left.shape[-1] * width
        if cost > EXACT_LIMIT:
            return
        out[index] = self._stacked(index) if out.ndim > 2 else self._plane(*index)

    def _plane(self, k: NDArray[np.intp], i: NDArray[np.intp]) -> NDArray[np.int8]:
        """Exact signs of two-dimensional dense forms at the positions (k, i)."""
        rows, k = np.unique(k, return_inverse=True)
        columns, i = np.unique(i, return_inverse=True)
        left = self.left.rows_as_integers(rows)
        if self.middle is not None:
            left = left @ self.middle.as_integers()[0]
        right = self.right.rows_as_integers(columns)
        step = max(1, _CHUNK // right.shape[1])
        parts = [np.sign((left[k[s : s + step]] * right[i[s : s + step]]).sum(axis=1)) for s in range(0, len(k), step)]
        return np.concatenate(parts).astype(np.int8)

    def _stacked(self, index: tuple[NDArray[np.intp], ...]) -> NDArray[np.int8]:
        """Exact signs of stacked forms at the positions (batch..., k, i)."""
        *batch, k, i = index
        step = max(1, _CHUNK // (self.left.shape[-1] * self.right.shape[-1]))
        parts = []
        for s in range(0, len(k), step):
            at = tuple(b[s : s + step] for b in batch)
            row = _stack_rows(self.left, at, k[s : s + step])
            if self.middle is not None:
                block = self.middle if self.middle.values.ndim == 2 else None
                ints = self.middle.as_integers()[0] if block else _stack_blocks(self.middle, at)
                row = (row[:, :, None] * ints).sum(axis=1)
            parts.append(np.sign((row * _stack_rows(self.right, at, i[s : s + step])).sum(axis=1)))
        return np.concatenate(parts).astype(np.int8)

    def _sparse_pairs(self, k: NDArray[np.intp], i: NDArray[np.intp]) -> NDArray[np.int8]:
        """Exact signs at the positions (k, i), k in ascending order, when some operand is sparse."""
        rows, k = np.unique(k, return_inverse=True)
        columns, i = (i, np.arange(len(i))) if (np.diff(i) > 0).all() else np.unique(i, return_inverse=True)
        right = csr_integers(self.right, columns)
        middle = None if self.middle is None else columns_as_integers(self.middle, distinct(right.indices))
        step = max(1, _CHUNK // self._row_work(middle))
        parts = []
        for start in range(0, len(rows), step):
            left = csr_integers(self.left, rows[start : start + step])
            if len(rows) == 1:  # each pair has this row
                row = left.toarray()[0]
                parts.append(np.sign(right.apply(row if middle is None else middle.T.apply(row))[i]).astype(np.int8))
                break
            at = slice(*np.searchsorted(k, (start, start + step)))
            forms = (left if middle is None else left @ middle).paired(right, k[at] - start, i[at])
            parts.append(np.sign(forms).astype(np.int8))
        return np.concatenate(parts)

    def _row_work(self, middle: SparseIntegers | None) -> int:
        """Most multiplications that a row of `left` takes."""
        if middle is None:
            return row_length(self.left)
        return row_length(self.left) * int(np.diff(middle.indptr).max(initial=1)) + 1


def _decide(out: NDArray[np.int8], z: NDArray[np.float64], bound: NDArray[np.float64]) -> None:
    with np.errstate(invalid="ignore", over="ignore"):
        np.copyto(out, 1, where=z > bound)
        np.copyto(out, -1, where=z < -bound)
        # the bounds hold where nothing overflowed; overflow on the way to z leaves it, and the sum, infinite or NaN
        if not np.isfinite(z.sum()):
            out[~np.isfinite(z)] = UNKNOWN


def _unknown(out: NDArray[np.int8], where: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """Entries that matter and are not decided."""
    open_ = out == UNKNOWN
    return open_ if where is None else open_ & where


def _stack_rows(m: Matrix, batch: tuple[NDArray[np.intp], ...], row: NDArray[np.intp]) -> Integers:
    if m.values.ndim == 2:
        rows, inverse = np.unique(row, return_inverse=True)
        return m.rows_as_integers(rows)[inverse]
    if m.numerators is not None:
        return m.numerators[_aligned(m, batch) + (row,)]
    return integers_of_doubles(m.values[_aligned(m, batch) + (row,)], by_row=True)[0]


def _stack_blocks(m: Matrix, batch: tuple[NDArray[np.intp], ...]) -> Integers:
    if m.numerators is not None:
        return m.numerators[_aligned(m, batch)]
    blocks = m.values[_aligned(m, batch)]
    flat = integers_of_doubles(blocks.reshape(len(blocks), -1), by_row=True)[0]  # a factor per block is harmless
    return flat.reshape(blocks.shape)


def _aligned(m: Matrix, batch: tuple[NDArray[np.intp], ...]) -> tuple[NDArray[np.intp], ...]:
    """Batch indices of an operand whose leading dimensions were broadcast."""
    sizes = m.shape[:-2]
    own = batch[len(batch) - len(sizes) :]
    return tuple(np.zeros_like(b) if size == 1 else b for b, size in zip(own, sizes, strict=True))
