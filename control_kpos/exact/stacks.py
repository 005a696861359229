"""Bilinear forms z_jki = l_jk' M_j r_ji on long stacks of small matrices: piece by piece, in the cheapest order.

Three orders of the products, all within the lemma of `rounding`:

- k generators and facets that are the same for all matrices of a stack: M_j, written as one row, times the matrix of
  all products of entries of l_k and r_i; one product of matrices for the whole stack.  A term meets one rounding in
  the product of its entries of l and r, and as many as M_j has entries in the rest.
- one row l_j for every matrix of the stack: its sums entry by entry, then one product with all r_i.
- stacked products as numpy has them.

Nothing is kept of a piece but its signs and its forms, so that a stack takes the memory of its own data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .matrix import Matrix
from .rounding import SMALLEST_NORMAL, error_factor, underflow
from .signs import BilinearForms
from .sizes import absolute, finite, row_length, times

# Stacks of matrices of at most four entries are proven this many at a time, so that the numbers stay in the caches.
PIECE = 2**15
# Products of entries of l and r for one matrix up to which these are formed, and one product is made of all.
_AT_ONCE = 4096


def pieces(count: int, entries: int) -> Iterator[slice]:
    """Places of a long stack of matrices of so many entries, as many at a time as the caches hold."""
    step = max(1, min(PIECE, 4 * PIECE // max(entries, 1)))
    return (slice(start, start + step) for start in range(0, count, step))


@dataclass(frozen=True, eq=False)
class Identity:
    """The identity as a sparse operand, made only where its entries are needed.

    Attributes
    ----------
    size : int
    """

    size: int

    @property
    def shape(self) -> tuple[int, int]:
        """Its sides."""
        return self.size, self.size

    @property
    def whole(self) -> Matrix:
        """The matrix."""
        return Matrix.identity(self.size, sparse=True)


@dataclass(frozen=True, eq=False)
class Transposed:
    """The transpose of a sparse matrix as an operand, made only where its entries are needed.

    Attributes
    ----------
    of : Matrix
    """

    of: Matrix

    @property
    def shape(self) -> tuple[int, int]:
        """Its sides."""
        return self.of.shape[1], self.of.shape[0]

    @property
    def is_double(self) -> bool:
        """As of the matrix."""
        return self.of.is_double

    @property
    def column_length(self) -> int:
        """The most entries of a column."""
        return row_length(self.of)

    @property
    def whole(self) -> Matrix:
        """The matrix."""
        return self.of.T


@dataclass(frozen=True, eq=False)
class Joined:
    """Matrices beside each other (axis -1) or below each other (-2), joined only where that is needed.

    Attributes
    ----------
    parts : sequence of Matrix, shapes (r, c); or (N, r, c), and (1, r, c) for the same at every place of a stack
    axis : int
    shape : tuple of int
    """

    parts: Sequence[Matrix | Identity | Transposed]
    axis: int
    shape: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        shape = list(max(part.shape for part in self.parts))
        shape[self.axis] = sum(part.shape[self.axis] for part in self.parts)
        object.__setattr__(self, "shape", tuple(shape))

    @property
    def whole(self) -> Matrix:
        """The matrix, or the stack."""
        return Matrix.join([_whole(part) for part in self.parts], self.axis)


Operand: TypeAlias = "Matrix | Joined | Identity | Transposed"


def _whole(m: Any) -> Any:
    return m if m is None or isinstance(m, Matrix) else m.whole


def _cut(m: Any, part: slice) -> Any:
    """A piece of a stack; what is the same for all of it stays."""
    if isinstance(m, Joined):
        return Joined([_cut(own, part) for own in m.parts], m.axis)
    return m if m is None or len(m.shape) < 3 or m.shape[0] == 1 else m[part]


class StackedForms(BilinearForms):
    """Bilinear forms on a long stack, evaluated piece by piece; dense.

    Parameters
    ----------
    left, middle, right : as for `BilinearForms`
        At least one is a stack (N, r, c), or a `Joined` of such.
    """

    def __init__(self, left: Operand, middle: Operand | None, right: Operand) -> None:
        self.is_sparse = False
        self._given = left, middle, right
        self.count = max(m.shape[0] for m in self._given if m is not None and len(m.shape) == 3)
        self.shape = self.count, left.shape[-2], right.shape[-2]

    def pieces(self) -> Iterator[tuple[slice, BilinearForms]]:
        """The forms on pieces of the stack, made one after the other."""
        left, middle, right = self._given
        entries = max(prod(m.shape[1:]) for m in self._given if m is not None and len(m.shape) == 3)
        for part in pieces(self.count, entries):
            yield part, forms_on(_cut(left, part), _cut(middle, part), _cut(right, part))

    @cached_property
    def values(self) -> Any:
        """See `BilinearForms`."""
        return self._gathered("values")

    @property
    def magnitudes(self) -> Any:  # type: ignore[override]
        """See `BilinearForms`; not kept."""
        return self._gathered("magnitudes")

    def _gathered(self, name: str) -> NDArray[np.float64]:
        out = np.empty(self.shape)
        for part, forms in self.pieces():
            out[part] = getattr(forms, name)
        return out

    def enclosure(self, *, exactly: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `BilinearForms`."""
        low, high = np.empty(self.shape), np.empty(self.shape)
        for part, forms in self.pieces():
            low[part], high[part] = forms.enclosure(exactly=exactly)
        return low, high

    def signs(self, where: NDArray[np.bool_] | None = None, *, integers: bool = True) -> Any:
        """See `BilinearForms`; the forms are kept from the same pass."""
        signs, values = np.empty(self.shape, dtype=np.int8), np.empty(self.shape)
        for part, forms in self.pieces():
            signs[part] = forms.signs(None if where is None else where[part], integers=integers)
            values[part] = forms.values
        vars(self).setdefault("values", values)
        return signs


class _AtOnce(BilinearForms):
    """Forms of facets and generators that are the same for all matrices of a stack: z_j = (l (x) r) vec M_j.

    The products of entries of l and r do not overflow or underflow, which `fits` says of them, so that nothing is lost
    that M_j could multiply.
    """

    _multiplied_last = 1

    @staticmethod
    def fits(left: Matrix, middle: Matrix | None, right: Matrix) -> bool:
        """True if the forms are of this kind, and less work than stacked products."""
        operands = [m for m in (left, middle, right) if m is not None]
        if [len(m.shape) for m in operands] != [2, 3, 2] or any(m.is_sparse for m in operands):
            return False
        if not (left.is_double and right.is_double) or left.values.size * right.values.size > _AT_ONCE:
            return False
        products = np.abs(np.multiply.outer(_nonzero_entries(left), _nonzero_entries(right)))
        return bool(np.all((products >= SMALLEST_NORMAL) & np.isfinite(products)))

    def _product(self, *factors: Any) -> Any:
        left, middle, right = factors
        if _is_identity(left) and _is_identity(right):
            return middle
        z = middle.reshape(len(middle), prod(middle.shape[1:])) @ np.kron(left, right).T
        return z.reshape(len(middle), len(left), len(right))

    @cached_property
    def _constants(self) -> tuple[float, float, float]:
        entries = prod(self._operands[1].shape[1:])
        return error_factor(entries + 1), 0.0, underflow(entries)

    @property
    def _is_small(self) -> bool:
        return True


def _is_identity(values: NDArray[np.float64]) -> bool:
    rows, columns = values.shape
    return rows == columns and np.array_equal(values, np.eye(rows))


def _nonzero_entries(m: Matrix) -> NDArray[np.float64]:
    values = np.asarray(m.values)
    return values[values != 0]


class _Summed(BilinearForms):
    """Forms (l_1'M_1 + l_2'M_2 + ...) r, whose parts are joined for integers alone; all in doubles.

    A term of l_t'M_t meets as many roundings as l_t has entries, and one in the sum for each other part at the most:
    no more than with all of them joined.
    """

    def __init__(self, left: Joined, middle: Joined, right: Matrix | Identity) -> None:
        self.is_sparse, self._is_double = False, True
        self._given = left, middle, right

    @staticmethod
    def fits(left: Operand, middle: Operand | None, right: Operand) -> bool:
        """True if rows l and matrices M have parts of the same sizes, in doubles."""
        if not (isinstance(left, Joined) and isinstance(middle, Joined) and not isinstance(right, Joined)):
            return False
        match = [part.shape[-1] for part in left.parts] == [part.shape[-2] for part in middle.parts]
        known = all(isinstance(m, Identity) or m.is_double for m in (*left.parts, *middle.parts, right))
        return match and known and left.axis == -1 and middle.axis == -2 and left.shape[-2] == 1

    @cached_property
    def left(self) -> Matrix:  # type: ignore[override]
        return _whole(self._given[0])

    @cached_property
    def middle(self) -> Matrix:  # type: ignore[override]
        return _whole(self._given[1])

    @cached_property
    def right(self) -> Matrix:  # type: ignore[override]
        return _whole(self._given[2])

    @cached_property
    def _operands(self) -> list[Matrix]:  # type: ignore[override]
        return [self.left, self.middle, self.right]

    @cached_property
    def values(self) -> Any:
        """See `BilinearForms`."""
        return self._summed(lambda entries: entries)

    @cached_property
    def _summed_sizes(self) -> Any:
        return self._summed(absolute)

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def _summed(self, of: Callable[[Any], Any]) -> Any:
        left, middle, right = self._given
        total: Any = 0.0
        for row, block in zip(left.parts, middle.parts, strict=True):
            term = of(row.values)  # type: ignore[union-attr]
            if isinstance(block, Transposed):
                term = (of(block.of.values) @ term.T).T
            elif isinstance(block, Matrix):
                alike = len(block.shape) == 3 and len(block.values) == 1
                term = times(term, of(block.values[0] if alike else block.values))
            total = term + total
        return total if isinstance(right, Identity) else times(total, of(right.values).T)

    @cached_property
    def _lengths(self) -> tuple[int, int]:
        _, middle, right = self._given
        inner = sum(1 if isinstance(part, Identity) else part.column_length for part in middle.parts)
        return inner, 1 if isinstance(right, Identity) else row_length(right)

    @property
    def _ends_in_identity(self) -> bool:  # type: ignore[override]
        return isinstance(self._given[2], Identity)

    @property
    def _is_small(self) -> bool:
        return True

    @property
    def _is_finite(self) -> bool:
        left, middle, right = self._given
        parts = (*left.parts, *middle.parts, right)
        return all(finite(m.of if isinstance(m, Transposed) else m) for m in parts if not isinstance(m, Identity))


def forms_on(left: Operand, middle: Operand | None, right: Operand) -> BilinearForms:
    """Bilinear forms with their products in the cheapest order."""
    if _Summed.fits(left, middle, right):
        return _Summed(left, middle, right)  # type: ignore[arg-type]
    l, m, r = (_whole(x) for x in (left, middle, right))
    with np.errstate(all="ignore"):
        return (_AtOnce if _AtOnce.fits(l, m, r) else BilinearForms)(l, m, r)  # type: ignore[arg-type]


def stacked(left: Operand, middle: Operand | None, right: Operand) -> BilinearForms:
    """Bilinear forms on stacks of any length."""
    count = max((m.shape[0] for m in (left, middle, right) if m is not None and len(m.shape) == 3), default=0)
    return (StackedForms if count > 2 * PIECE else forms_on)(left, middle, right)
