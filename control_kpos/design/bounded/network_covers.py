"""Whether f'x <= b on [0, x_max] for many sparse rows f, on a product of cones: see `covers` for one system.

The g of `certificate` is best node by node.  Where the cone of a node is simplicial, g'x_k = max(0, f'x_k) on its
generators; on others all g of all rows come from one linear program.  g is moved into the dual cones by as much as
rounding may miss them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from ...cones import Cone, Orthant
from ...exact.matrix import Matrix
from ...exact.program import Block, Program
from ...networks.blocks import Index, block_diagonal
from ...networks.model import NetworkModel
from ..plant import Floats
from ..running import Programs

# Units of the last place, for each state of a node, by which g is moved.
_ROUNDED = 2.0**-47
# Parts by which states that break a bound are moved into the interval.
_PARTS = (0.0, 1e-13, 1e-10, 1e-7)
# What keeps quotients of numbers that are both 0 finite.
_LEAST = 1e-300


def network_covers(model: NetworkModel, rows: Matrix, x_max: Floats, lp: Programs) -> Matrix | None:
    """g for every row f, sparse; None where no linear program found it."""
    out = sp.csr_array(rows.shape)
    for k, s in enumerate(model.stacks):
        part = _columns(rows.values, model, k)
        if not part.nnz:
            continue
        if isinstance(s.X, Orthant):
            found = sp.csr_array((np.maximum(part.data, 0.0), part.indices, part.indptr), shape=part.shape)
        else:
            found = _of_stack(model, k, part, x_max, lp)
        if found is None:
            return None
        out = out + found
    out.eliminate_zeros()
    return Matrix(sp.csr_array(out))


def _columns(rows: sp.csr_array, model: NetworkModel, k: int) -> sp.csr_array:
    """The rows without the states of other stacks."""
    if len(model.stacks) == 1:
        return rows
    mine = np.zeros(model.totals[0], dtype=bool)
    mine[model.places[k][0]] = True
    out = sp.csr_array(rows * mine[None])
    out.eliminate_zeros()
    return out


def _of_stack(model: NetworkModel, k: int, part: sp.csr_array, x_max: Floats, lp: Programs) -> sp.csr_array | None:
    """g on the nodes of one stack."""
    X = model.stacks[k].X
    row, node, blocks = _touched(model, k, part)
    rays = np.asarray(X.rays, dtype=float)
    needed = np.maximum(blocks @ rays.T, 0.0)
    if X.is_simplicial:
        H = _opposite(X)
        g = (needed / np.einsum("kn,kn->k", H, rays)) @ H
    else:
        found = _searched(needed, rays, model.split(x_max, 0)[k][node], lp)
        if found is None:
            return None
        g = found
    inner = np.asarray(X.dual.interior_point, dtype=float)
    seen = rays @ inner
    missed = np.maximum((needed - g @ rays.T) / seen, 0.0).max(axis=1, initial=0.0)
    size = ((np.abs(g) + np.abs(blocks)) @ np.abs(rays).T / seen).max(axis=1, initial=0.0)
    g = g + (missed + _ROUNDED * X.dim * size)[:, None] * inner
    place = model.places[k][0][node]
    return sp.csr_array((g.ravel(), (np.repeat(row, X.dim), place.ravel())), shape=part.shape)


def _touched(model: NetworkModel, k: int, part: sp.csr_array) -> tuple[Index, Index, Floats]:
    """Rows and nodes (of a stack) of the blocks that are not 0, and the blocks."""
    n = model.stacks[k].sizes[0]
    home, first = np.empty(model.totals[0], dtype=np.intp), model.places[k][0]
    home[first] = np.arange(first.size).reshape(first.shape)
    rows, at = np.repeat(np.arange(part.shape[0]), np.diff(part.indptr)), home[part.indices]
    keys, where = np.unique(rows.astype(np.int64) * len(first) + at // n, return_inverse=True)
    blocks = np.zeros((len(keys), n))
    np.add.at(blocks, (where, at % n), part.data)
    return keys // len(first), keys % len(first), blocks


def _opposite(X: Cone) -> Floats:
    """For every generator of a simplicial cone the facet that it does not lie on."""
    return np.asarray(X.facets, dtype=float)[np.argmin(np.asarray(X.incidence), axis=0)]


def _searched(needed: Floats, rays: Floats, ends: Floats, lp: Programs) -> Floats | None:
    """g with rays g >= needed and the least ends'g, for all blocks at once."""
    count, n = ends.shape
    program = Program(g=Block(count * n, cost=ends.ravel()))
    program.above(needed.ravel(), g=_beside(rays, count))
    answer = program.solve(lp)
    return answer["g"].reshape(count, n) if answer else None


def largest_states(
    model: NetworkModel, rows: Matrix, bounds: Floats, x_min: Floats, lp: Programs
) -> Iterator[tuple[int, Floats]]:
    """The row that is broken most on [0, x_min], and states x of it with f'x > b."""
    most, found = np.zeros(rows.shape[0]), []
    for k, s in enumerate(model.stacks):
        row, node, blocks = _touched(model, k, _columns(rows.values, model, k))
        if not len(row):
            continue
        best = _best_states(s.X, blocks, model.split(x_min, 0)[k][node], lp)
        if best is None:
            return
        np.add.at(most, row, np.einsum("bn,bn->b", blocks, best))
        found.append((row, model.places[k][0][node], best))
    excess = (most - bounds) / (np.abs(bounds) + np.abs(most) + _LEAST)
    if not excess.size or not excess.max() > 0:
        return
    worst, x = int(np.argmax(excess)), np.zeros(rows.shape[1])
    for row, places, best in found:
        x[places[row == worst]] = best[row == worst]
    for part in _PARTS:
        yield worst, (1 - part) * x + part / 2 * x_min


def _best_states(X: Cone, blocks: Floats, ends: Floats, lp: Programs) -> Floats | None:
    """For every block f and end the x of [0, end] with the largest f'x."""
    if X.is_simplicial:
        H, rays = _opposite(X), np.asarray(X.rays, dtype=float)
        weights = np.maximum(ends @ H.T, 0.0) / np.einsum("kn,kn->k", H, rays)
        return np.where(blocks @ rays.T > 0, weights, 0.0) @ rays
    H = np.asarray(X.facets, dtype=float)
    program = Program(x=Block(blocks.size, cost=-blocks.ravel()))
    every = _beside(H, len(blocks))
    program.above(0.0, x=every)
    program.below((ends @ H.T).ravel(), x=every)
    answer = program.solve(lp)
    return answer["x"].reshape(blocks.shape) if answer else None


def _beside(rows: Floats, count: int) -> sp.csr_array:
    """The rows for each of so many vectors."""
    at, columns = (np.arange(count * size).reshape(count, size) for size in rows.shape)
    return block_diagonal([(np.broadcast_to(rows, (count, *rows.shape)), at, columns)], (at.size, columns.size))
