"""Parts of a cone that have nothing to do with each other: products whose generators come in one list.

Vectors x_1..x_p are divided into the finest parts whose spans are independent: every x is the sum of its components in
the spans, and X is the product of the cones of the parts in these coordinates.  Facets of each part alone are facets
of X, where all at once take a number of steps that multiplies from part to part.

Some of the x_i are a basis b_1..b_r, and x_j = sum_k c_jk b_k.  Parts are the connected components of the graph that
joins x_j and b_k if c_jk is not 0.  The c_jk are computed modulo a prime, which may turn some of them into 0.  So the
parts that this gives are tried only: they count if their ranks, in exact arithmetic, add up to r.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..exact.linalg import LARGEST_PRIME, echelon
from ..exact.matrix import Integers

Index = NDArray[np.intp]


def independent_parts(rows: Integers) -> list[Index]:
    """The finest parts of integer rows whose spans are independent, ordered by their first rows.

    Costs r^2 p operations on machine numbers for p rows of rank r, and the ranks of the parts if there are several.

    Parameters
    ----------
    rows : ndarray of int (object), shape (p, n)
        None of them is 0.

    Returns
    -------
    list of ndarray of int
        Each row belongs to one part.

    Examples
    --------
    >>> [part.tolist() for part in independent_parts(np.array([[1, 1, 0], [0, 0, 1], [1, -1, 0], [1, 0, 0]]))]
    [[0, 2, 3], [1]]
    """
    p = len(rows)
    whole = [np.arange(p)]
    reduced, basis = _coefficients(rows)
    k, j = np.nonzero(reduced)
    count, label = connected_components(coo_array((np.ones(len(k)), (basis[k], j)), shape=(p, p)), directed=False)
    if count < 2:
        return whole
    parts = [np.flatnonzero(label == c) for c in range(count)]
    ranks = [1 if len(part) == 1 else echelon(rows[part]).rank for part in parts]
    return parts if sum(ranks) == echelon(rows).rank else whole


def _coefficients(rows: Integers) -> tuple[NDArray[np.int64], Index]:
    """c transposed, modulo a prime, shape (r, p), and the rows that are the basis."""
    work = np.ascontiguousarray((np.asarray(rows, dtype=object) % LARGEST_PRIME).astype(np.int64).T)
    basis: list[int] = []
    for k in range(len(work)):
        left = work[k:].any(axis=0)
        if not left.any():
            break
        j = int(np.argmax(left))
        i = k + int(np.argmax(work[k:, j] != 0))
        work[[k, i]] = work[[i, k]]
        work[k] = work[k] * pow(int(work[k, j]), -1, LARGEST_PRIME) % LARGEST_PRIME
        others = np.flatnonzero(work[:, j])
        others = others[others != k]
        work[others] = (work[others] - work[others, j][:, None] * work[k]) % LARGEST_PRIME
        basis.append(j)
    return work[: len(basis)], np.array(basis, dtype=np.intp)
