"""Whether the algebraic loop u = W D u + ... of a network has one solution: I - W D is regular.

Three answers, in order of cost.  If t > 0 has |W| |D| t < t, the loop contracts in the norm of t.  If elimination in
floating point, in units that balance rows and columns, meets no small pivot, nothing speaks against the network.
What is left are loops that are singular within rounding; there elimination in integers decides, modulo a prime for
"regular" and exactly for "singular".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from heapq import heapify, heappop, heappush
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ..errors import DataError
from ..exact.linalg import LARGEST_PRIME, common_denominator, echelon, independent_modulo
from ..exact.matrix import Index
from ..exact.rounding import sum_factor
from .integers import direct_loop_of
from .model import NetworkModel
from .witnesses import list_nodes

# Pivots smaller than this part of their row are looked at exactly.
_SMALL = 1e-8
# Products that the removal of an unknown may add before elimination goes on with a dense matrix, up to this size.
_FILL, _DENSE = 16, 700
# Powers of |W| |D| that are added up to show that they contract.
_POWERS = 100
# Binary digits up to which fractions are eliminated.
_LONGEST = 20_000

Row = dict[int, Any]


def require_well_posed(model: NetworkModel) -> None:
    """Raise if I - W D is proven singular, naming the algebraic loop.

    Raises
    ------
    DataError
        It is.  Loops of thousands of inputs that are singular within rounding are let pass if integers do not decide.
    """
    if not model.has_feedthrough or _contracts(model):
        return
    loop = sp.csr_array(model.W @ model.block_matrices[3])
    if not _is_suspicious(sp.csr_array(sp.eye_array(loop.shape[0], format="csr") - loop)):
        return
    for index, rows in _loops(model):
        if is_singular(rows):
            raise DataError(
                "the network is not well posed: I - W D is singular on the algebraic loop through "
                f"{list_nodes(np.unique(model.owners(1)[index]))}. "
                "Change a feedthrough term D or a link of this loop, or put dynamics into it."
            )


def _contracts(model: NetworkModel) -> bool:
    """True if a sum of powers of |W| |D| proves that these loops contract."""
    W = abs(model.W)
    terms = (int(np.diff(W.indptr).max(initial=0)) + 2) * max(sum(s.sizes[1:]) for s in model.stacks)
    total = term = np.ones(model.totals[1])
    with np.errstate(all="ignore"):
        for _ in range(_POWERS):
            term = W @ model.times("D", term, absolute=True)
            if not term.any():
                break
            total = total + term
        ahead = W @ model.times("D", total, absolute=True)
        return bool((ahead * sum_factor(terms) < total).all())


def _is_suspicious(P: sp.csr_array) -> bool:
    """True if elimination in floating point meets a small pivot, in units that balance rows and columns."""
    with np.errstate(all="ignore"):
        for axis in (1, 0, 1):
            top = abs(P).max(axis=axis).toarray().ravel()
            if not (np.isfinite(top).all() and top.all()):
                return True
            unit = sp.diags_array(np.ldexp(1.0, -np.frexp(top)[1]))
            P = sp.csr_array(unit @ P if axis else P @ unit)
        try:
            pivots = np.abs(spla.splu(sp.csc_array(P)).U.diagonal())
        except (RuntimeError, ValueError):  # singular, or not finite
            return True
    return not bool((pivots > _SMALL).all())


def _loops(model: NetworkModel) -> Iterator[tuple[Index, list[Row]]]:
    """The inputs of every algebraic loop, and the rows of I - W D on it, times one number."""
    loop, below = direct_loop_of(model)
    count, component = connected_components(loop.pattern(), directed=True, connection="strong")
    inside = component[loop.rows] == component[loop.indices]
    rows: dict[int, Row] = {}
    entries = (part[inside].tolist() for part in (loop.rows, loop.indices, loop.data))
    for i, k, value in zip(*entries, strict=True):
        rows.setdefault(i, {i: below})
        rows[i][k] = rows[i].get(k, 0) - value
    order = np.argsort(component, kind="stable")
    for index in np.split(order, np.searchsorted(component[order], np.arange(1, count))):
        if index[0] in rows:
            yield index, [rows[i] for i in index.tolist()]


def is_singular(rows: list[Row]) -> bool:
    """True if a square integer matrix is proven singular.

    Parameters
    ----------
    rows : list of dict of int to int
        Entries of every row by column; they are not changed.
    """
    regular = _has_full_rank(rows, lambda x: x % LARGEST_PRIME, lambda x: pow(x, -1, LARGEST_PRIME))
    return regular is False and _has_full_rank(rows, _short_fraction, lambda x: 1 / x) is False


def _short_fraction(x: Any) -> Fraction:
    x = Fraction(x)
    if max(x.numerator.bit_length(), x.denominator.bit_length()) > _LONGEST:
        raise OverflowError
    return x


def _has_full_rank(rows: list[Row], read: Callable[[Any], Any], inverse: Callable[[Any], Any]) -> bool | None:
    """Whether a matrix is regular in the field whose numbers are read like this; None if that takes too long."""
    left = {i: {k: y for k, x in row.items() if (y := read(x))} for i, row in enumerate(rows)}
    try:
        if not _eliminate(left, read, inverse):
            return False
    except OverflowError:
        return None
    if len(left) > _DENSE:
        return None
    columns = {k: at for at, k in enumerate(sorted({k for row in left.values() for k in row}))}
    core = np.zeros((len(left), len(left)), dtype=object)
    if len(columns) < len(left):
        return False
    for row, entries in zip(core, left.values(), strict=True):
        for k, x in entries.items():
            row[columns[k]] = x
    if read is _short_fraction:
        return echelon(common_denominator(core)[0]).rank == len(left)
    return len(independent_modulo(core, LARGEST_PRIME)[0]) == len(left)


def _eliminate(rows: dict[int, Row], read: Callable[[Any], Any], inverse: Callable[[Any], Any]) -> bool:
    """Remove unknowns while that fills in little; False if a row vanishes."""
    users: dict[int, set[int]] = {}
    for i, row in rows.items():
        for k in row:
            users.setdefault(k, set()).add(i)
    heap = [(len(row), i) for i, row in rows.items()]
    heapify(heap)
    while heap:
        length, i = heappop(heap)
        if i not in rows or len(rows[i]) != length:
            continue  # it has changed since
        if not length:
            return False
        k = min(rows[i], key=lambda k: len(users[k]))
        if (length - 1) * (len(users[k]) - 1) > _FILL:
            break
        pivot = rows.pop(i)
        for column in pivot:
            users[column].discard(i)
        for j in users.pop(k):
            _subtract(rows[j], pivot, rows[j].pop(k) * inverse(pivot[k]), k, read)
            for column in pivot:
                if column != k:
                    (users[column].add if column in rows[j] else users[column].discard)(j)
            heappush(heap, (len(rows[j]), j))
    return True


def _subtract(row: Row, pivot: Row, factor: Any, without: int, read: Callable[[Any], Any]) -> None:
    for k, x in pivot.items():
        if k != without:
            row[k] = read(row.get(k, 0) - factor * x)
            if not row[k]:
                del row[k]
