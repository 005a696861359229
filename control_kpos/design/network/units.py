"""Units of states and inputs in the linear program of a network, chosen by powers of two.

A grid in SI units has states of 1e-6 and 1e6 side by side; in units d, A becomes D^{-1} A D.  The units sought make
the entries of A, and of the links, about as large as their mirror images: with a_ik the logarithms of the entries, d
minimises sum (a_ik + d_k - d_i)^2, a Laplacian system.  Data of moderate range are left as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ...cones import Cone
from ...networks.model import NetworkModel
from ...systems.statespace import ConeStateSpace

Floats = NDArray[np.float64]

# Range of magnitudes, in powers of two, below which units are left alone.
_MODERATE = 16


def own_cones(systems: Sequence[Any]) -> dict[int, Cone]:
    """State cones of those nodes that do not come in a stack, by number."""
    out: dict[int, Cone] = {}
    count = 0
    for item in systems:
        if isinstance(item, ConeStateSpace):
            out[count] = item.X
        count += 1 if isinstance(item, ConeStateSpace) else len(item)
    return out


def generator_lengths(cones: Mapping[int, Cone], model: NetworkModel) -> list[Floats]:
    """Lengths of every node's own generators, relative to those of its stack; shape (N, n) for each stack.

    Nodes share a stack if their cones are equal as sets; gains are measured at the generators each node came with.
    """
    out = []
    for s, index in zip(model.stacks, model.members, strict=True):
        rays = np.asarray(s.X.rays, dtype=float)
        lengths = np.ones((len(index), len(rays)))
        known: dict[int, Floats] = {id(s.X): np.ones(len(rays))}
        for place, j in enumerate(index.tolist()):
            X = cones.get(j, s.X)
            if id(X) not in known:  # each generator is a multiple of one of the stack's
                known[id(X)] = np.linalg.solve(rays.T, np.asarray(X.rays, dtype=float).T).max(axis=1)
            lengths[place] = known[id(X)]
        out.append(lengths)
    return out


def state_units(local: list[Floats], links: sp.csr_array) -> list[Floats]:
    """Powers of two for the states of every node, shape (N, n) for each stack.

    Parameters
    ----------
    local : list of ndarray, shape (N, n, n)
        A of the nodes in the coordinates of their generators.
    links : csr_array, shape (sum n, sum n)
        B W C in these coordinates, in the order of the stacks.
    """
    plain = [np.ones(M.shape[:2]) for M in local]
    sizes = [np.abs(values[values != 0]) for values in (*local, links.data)]
    if _spread(np.concatenate(sizes)) <= _MODERATE:
        return plain
    blocks, at = [], 0
    for M in local:
        count, n, _ = M.shape
        number = at + np.arange(count * n).reshape(count, n)
        at += count * n
        blocks.append(
            (M.ravel(), *(np.broadcast_to(x, M.shape).ravel() for x in (number[:, :, None], number[:, None])))
        )
    values, rows, columns = (np.concatenate(group) for group in zip(*blocks, strict=True))
    whole = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(at, at)) + links).tocoo()
    off = (whole.row != whole.col) & (whole.data != 0)
    i, k, size = whole.row[off], whole.col[off], np.frexp(whole.data[off])[1].astype(float)
    edges = np.arange(len(size))
    # rows of d_i - d_k = size
    incidence = sp.csr_array(
        (np.repeat([1.0, -1.0], len(size)), (np.tile(edges, 2), np.concatenate([i, k]))), shape=(len(size), at)
    )
    found = spla.lsqr(incidence, size, atol=1e-3, btol=1e-3, iter_lim=200)[0]
    if np.ptp(found) <= _MODERATE:  # a few small links, not other units
        return plain
    units = np.exp2(np.clip(np.rint(found), -500, 500))
    out, at = [], 0
    for M in local:
        out.append(units[at : at + M[:, 0].size].reshape(M.shape[:2]))
        at += M[:, 0].size
    return out


def input_units(A: Floats, B: Floats) -> Floats:
    """Powers of two for the inputs of every node, shape (N, m), that bring the columns of B to the size of A.

    Parameters
    ----------
    A, B : ndarray, shapes (N, n, n), (N, n, m)
    """
    pushes, size = np.abs(B).max(axis=1, initial=0.0), np.abs(A).max(axis=(1, 2), initial=0.0)
    target = np.frexp(np.where(size > 0, size, 1.0))[1][:, None]
    exponent = np.where(pushes > 0, target - np.frexp(pushes)[1], 0)
    return np.where(np.abs(exponent) > _MODERATE, np.exp2(exponent.astype(float)), 1.0)


def _spread(sizes: Floats) -> int:
    exponents = np.frexp(sizes)[1]
    return int(exponents.max() - exponents.min()) if sizes.size else 0
