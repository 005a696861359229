"""Products of sparse matrices of doubles without rounding: as matrices of doubles that stand below each other.

A double has 53 digits, so that the product of two is a double if they have 53 in all, or one is a power of two.
Others are split into halves of 26 digits and a sign, a = a1 + a2, b = b1 + b2: the four products are doubles.
What falls on one entry of the result is added with its rounding error, which goes to another layer: the rows of layer
k are the rows k n, ..., k n + n - 1 of a tower, and l'M is the product of l, repeated for every layer, with the tower.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import TooLargeError
from .matrix import Index, Matrix

Floats = NDArray[np.float64]

# Sizes of doubles whose products, and products of halves, neither overflow nor underflow.
_SMALLEST, _LARGEST = 2.0**-400, 2.0**400


def tower(terms: list[sp.csr_array]) -> Matrix:
    """Layers below each other whose sum is exactly the sum of some matrices; one layer where no entries meet."""
    terms = [term for term in terms if term.nnz] or terms[:1]
    if len(terms) == 1:
        return Matrix(terms[0])
    shape = terms[0].shape
    total = sp.csr_array(sum(terms[1:], start=terms[0]))
    if total.nnz == sum(term.nnz for term in terms):
        return Matrix(total)
    rows = np.concatenate([np.repeat(np.arange(shape[0]), np.diff(term.indptr)) for term in terms])
    columns = np.concatenate([term.indices for term in terms])
    return _layered(rows, columns, np.concatenate([term.data for term in terms]), shape)


def height(layers: Matrix, rows: int) -> int:
    """Number of layers of a tower."""
    return layers.shape[0] // rows if rows else 1


def repeated(left: Matrix, layers: Matrix) -> Matrix:
    """Rows l beside themselves, once for every layer: what multiplies a tower from the left."""
    return Matrix.join([left] * height(layers, left.shape[-1]), -1)


def sparse_product(left: sp.csr_array, right: sp.csr_array) -> list[sp.csr_array]:
    """Matrices of doubles whose sum is exactly left @ right; their entries may meet.

    Raises
    ------
    TooLargeError
        Entries so large or small that products of them are no doubles.
    """
    if _is_identity(left) or _is_identity(right):
        return [right if _is_identity(left) else left]
    count = np.diff(right.indptr)[left.indices]
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    at = np.repeat(right.indptr[left.indices], count) + within
    rows, columns = np.repeat(np.repeat(np.arange(left.shape[0]), np.diff(left.indptr)), count), right.indices[at]
    a, b = np.repeat(left.data, count), right.data[at]
    for factor in (a, b):
        size = np.abs(factor[factor != 0])
        if size.size and not (size.min() > _SMALLEST and size.max() < _LARGEST):
            raise TooLargeError("entries of a network differ by more than 240 decimal digits; rescale.")
    digits = [_digits(factor) for factor in (a, b)]
    short = (digits[0] + digits[1] <= 53) | (np.minimum(*digits) <= 1)
    parts = [np.where(short, a * b, 0.0)]
    if not short.all():
        parts += [np.where(short, 0.0, x * y) for x in _halves(a) for y in _halves(b)]
    out = []
    for part in parts:
        kept, n = part != 0, left.shape[0]
        layers = _layered(rows[kept], columns[kept], part[kept], (n, right.shape[1])).values
        out += [sp.csr_array(layers[k : k + n]) for k in range(0, layers.shape[0], max(n, 1))]
    return out


def _is_identity(M: sp.csr_array) -> bool:
    n = M.shape[0]
    unit = M.shape[1] == n == M.nnz and bool((M.data == 1).all())
    return unit and all(np.array_equal(part, np.arange(len(part))) for part in (M.indices, M.indptr))


def _digits(values: Floats) -> Index:
    """Binary digits of the odd part of every double."""
    whole = np.abs(np.ldexp(np.frexp(values)[0], 53)).astype(np.int64)
    return np.where(whole == 0, 0, 54 - np.frexp((whole & -whole).astype(float))[1])


def _halves(values: Floats) -> tuple[Floats, Floats]:
    """Doubles of at most 26 digits, or powers of two, with the sum given."""
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, 53).astype(np.int64)
    upper = ((whole + 2**26) >> 27) << 27
    return np.ldexp(upper.astype(float), exponent - 53), np.ldexp((whole - upper).astype(float), exponent - 53)


def _layered(rows: Index, columns: Any, values: Floats, shape: tuple[int, int]) -> Matrix:
    """Entries at given places; those that fall on one place are added, and what rounding leaves goes to more layers."""
    layers = []
    while not layers or len(values):
        key = rows.astype(np.int64) * shape[1] + columns
        order = np.argsort(key, kind="stable")
        first = np.flatnonzero(np.diff(key[order], prepend=-1))
        count = np.diff(first, append=len(key))
        total, left = values[order[first]], []
        for k in range(1, int(count.max(initial=1))):
            more = np.flatnonzero(count > k)
            at = order[first[more] + k]
            total[more], rest = _with_remainder(total[more], values[at])
            left.append((at[rest != 0], rest[rest != 0]))
        kept = total != 0
        at = order[first[kept]]
        layers.append(sp.csr_array((total[kept], (rows[at], columns[at])), shape=shape))
        again = np.concatenate([at for at, _ in left]) if left else np.empty(0, dtype=np.intp)
        values = np.concatenate([rest for _, rest in left]) if left else np.empty(0)
        rows, columns = rows[again], columns[again]
    return Matrix(layers[0] if len(layers) == 1 else sp.csr_array(sp.vstack(layers, format="csr")))


def _with_remainder(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Doubles s and e with s = fl(a + b) and s + e = a + b exactly (Knuth), where nothing overflows."""
    s = a + b
    away = s - a
    return s, (a - (s - away)) + (b - away)
