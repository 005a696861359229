"""Structured gains that are exactly 0: no input comes back to its own block, by whatever way.

Let X be simplicial.  In the coordinates of its generators x_j every entry of -A^{-1}, and of B, C and D, is
nonnegative, so that no terms cancel: an entry of the DC gain G is 0 if and only if no path of nonzero entries leads
from the input to the output.  Levels, one for every generator and every block, with

    h_i'A x_j != 0, i != j   =>  level i >= level j,          h_i'B e_k != 0  =>  level i >= level of the block of k,
    (C x_j)_q != 0           =>  level of the block of q > level j,
    D_qk != 0                =>  level of the block of q > level of the block of k

(h_i is the facet across from x_i) exist if and only if the structured gain is 0: along every path from an input to an
output the level of the blocks rises, and so G is strictly triangular by blocks, and small in some scaling of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..systems.system import System
from .blocks import Blocks

Floats = NDArray[np.float64]
Index = NDArray[np.intp]


def level_conditions(system: System, levels: Floats, of_blocks: Floats, blocks: Blocks) -> list[Condition]:
    """The entries that have to be 0, given the levels of generators and of blocks.

    Raises
    ------
    DataError
        X is not simplicial, or the levels are not those of its generators and of the blocks.
    """
    if not system.X.is_simplicial or levels.shape != (system.X.dim,) or of_blocks.shape != (blocks.count,):
        raise DataError("there is a level for every generator of a simplicial cone, and for every block.")
    if not (np.isfinite(levels).all() and np.isfinite(of_blocks).all()):
        raise DataError("levels are finite numbers.")
    into, out_of = of_blocks[blocks.inputs], of_blocks[blocks.outputs]
    opposite = levels[_opposite(system.X)]
    sides = {"A": (opposite, levels, 0), "B": (opposite, into, 0), "C": (out_of, levels, 1), "D": (out_of, into, 1)}
    return [_zero(f"{name} leads to no lower level", forms, *sides[name]) for name, forms in _maps(system).items()]


def _maps(system: System) -> dict[str, BilinearForms]:
    """h_i'A x_j, h_i'B e_k, (C x_j)_q and D_qk."""
    facets, rays = system.X.exact_facets, system.X.exact_rays
    _, m, q = system.sizes
    ins, outs = Matrix.identity(m, sparse=True), Matrix.identity(q, sparse=True)
    return {
        "A": BilinearForms(facets, system.A, rays),
        "B": BilinearForms(facets, system.B, ins),
        "C": BilinearForms(outs, system.C, rays),
        "D": BilinearForms(outs, system.D, ins),
    }


def _zero(name: str, forms: BilinearForms, to: Floats, of: Floats, rise: int) -> Condition:
    """Zeros are required where the level does not rise by so much."""
    if forms.is_sparse:
        rows = np.repeat(np.arange(len(to)), np.diff(forms.pattern.indptr))
        return Condition(name, forms, "==", to[rows] < of[forms.pattern.indices] + rise)
    return Condition(name, forms, "==", to[:, None] < of + rise)


def _opposite(X: Cone) -> Index:
    """The generator that every facet of a simplicial cone does not contain."""
    signs = BilinearForms(X.exact_facets, None, X.exact_rays).signs()
    positive = sp.csr_array(signs > 0) if sp.issparse(signs) else sp.csr_array(np.asarray(signs) > 0)
    if (np.diff(positive.indptr) != 1).any():
        raise DataError("a facet of a simplicial cone contains all generators but one.")
    return positive.indices.astype(np.intp)


def found_levels(system: System, blocks: Blocks) -> dict[str, Any] | None:
    """Levels of the generators and blocks, if the structured gain is 0; None if it is not, or X is not simplicial.

    The levels number the strongly connected parts of the graph of all signals in a topological order.
    """
    n = system.X.dim
    if not system.X.is_simplicial:
        return None
    maps, opposite = _maps(system), _opposite(system.X)
    places = {"A": (opposite, np.arange(n)), "B": (opposite, n + blocks.inputs)}
    places |= {"C": (n + blocks.outputs, np.arange(n)), "D": (n + blocks.outputs, n + blocks.inputs)}
    edges = {name: _edges(forms, *places[name]) for name, forms in maps.items()}
    to, of = (np.concatenate([edge[k] for edge in edges.values()]) for k in range(2))
    size = n + blocks.count
    graph = sp.csr_array((np.ones(len(to)), (of, to)), shape=(size, size))
    part = connected_components(graph, connection="strong")[1].astype(float)
    part = part if (part[to] >= part[of]).all() else -part
    rising = all((part[edges[name][0]] > part[edges[name][1]]).all() for name in "CD")
    return {"levels": part[:n], "block_levels": part[n:]} if rising else None


def _edges(forms: BilinearForms, to: Index, of: Index) -> tuple[Index, Index]:
    """Where entries lead to, and from where; all that are not proven to be zero."""
    found = sp.coo_array(forms.signs())
    rows, columns = found.coords
    kept = found.data != 0
    return to[rows[kept]], of[columns[kept]]
