"""Strongly connected parts of a network: what decides about it, and how their proofs join.

Links from one part to another without a way back change no eigenvalue, but they spoil eigenvectors: two parts
with close eigenvalues in a row have nearly one eigenvector between them.  So parts are looked at without the
links between them.  A state x of one part with A x - mu x in X stays one in the network, as what x sends to others
only adds to A x.  Lyapunov vectors v join with weights: if v_S falls by c_S in its own part S, then s_S v_S
falls in the network once s_S c_S outweighs what S is charged for by the parts that it feeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...exact.matrix import Matrix
from ..blocks import Floats, Index, apply
from ..model import NetworkModel
from .descent import (
    Approach,
    cone_coordinates,
    descend,
    slow_state,
)
from .port_solves import direct_loop

# Chains of parts longer than this are left to solves with the whole network.
_LONGEST = 300
# Weights stay within this range, so that no product of data overflows or vanishes.
_LEAST, _LARGEST = 1e-200, 1e200


@dataclass(frozen=True, eq=False)
class Parts:
    """A network cut into its strongly connected parts: `part` numbers the one that a node belongs to.

    `inner` has the links inside parts only; `between` is the transposed coupling of the links between parts.
    """

    model: NetworkModel
    inner: NetworkModel
    part: Index
    between: sp.csr_array

    def slow_state(self, found: Approach, relative: float) -> tuple[Floats, float] | None:
        """x in X on the part of largest abscissa, with A x - rate x in X; see `abscissa.slow_state`."""
        owner = self.part[self.model.owners(0)]
        count = int(self.part.max()) + 1
        supply, stored = (np.bincount(owner, w * found.x, minlength=count) for w in (found.c, found.v))
        mask = self.part == np.argmax(found.shift - supply / stored)
        alone = self.inner.restrict(mask)
        nearer = descend(alone, found.shift, relative=0.5 * relative)
        slow = None if nearer is None else slow_state(alone, nearer, relative)
        return None if slow is None else (self.model.lifted(mask, slow[0]), slow[1])

    def joined(self, v: Floats, c: Floats) -> Floats | None:
        """s_S v_S for every part S, falling in the whole network, or None; v, c in int X*, (A_inner - mu I)'v = -c."""
        model, levels = self.model, self._levels()
        if levels is None:
            return None
        spare = cone_coordinates(model, c, dual=True)
        r, e = self._prices(v, spare)
        weight = np.full(int(self.part.max()) + 1, _LEAST)
        for level in levels:
            charged = self.between @ (weight[self.part[model.owners(1)]] * r)
            ratio = np.zeros(model.n_nodes)
            parts = zip(model.stacks, model.members, model.split(charged, 2), spare, model.split(e, 1), strict=True)
            for s, index, h, spared, extra in parts:
                own = np.einsum("jn,kn->jk", apply(s.C.values, h, transposed=True), s.X.rays) / spared
                ratio[index] = 4 * own.max(axis=1, initial=0.0)
                if model.has_feedthrough:
                    through = np.einsum("jm,km->jk", apply(s.D.values, h, transposed=True), s.U.rays)
                    room = np.einsum("jm,km->jk", extra, s.U.rays)
                    ratio[index] = np.maximum(ratio[index], (2 * through / room).max(axis=1, initial=0.0))
            needed = np.zeros_like(weight)
            np.maximum.at(needed, self.part, ratio)
            weight[level] = np.maximum(needed[level], _LEAST)
            if not weight[level].max() < _LARGEST:
                return None
        return weight[self.part[model.owners(0)]] * v

    def _prices(self, v: Floats, spare: list[Floats]) -> tuple[Floats, Floats]:
        """r >= B'v + D'W'r inside the parts, with room e for what D passes on from others."""
        model = self.inner
        r = model.times("B", v, transposed=True)
        if not model.has_feedthrough:
            return r, np.zeros_like(r)
        e = model.at_all([s.U.dual.interior_point for s in model.stacks], 1)
        cost = direct_loop(model).solve(e, True, 1e-12)
        part_of_all = np.full(int(self.part.max()) + 1, np.inf)
        heard = model.split(model.WT @ cost, 2)
        for s, index, h, spared in zip(model.stacks, model.members, heard, spare, strict=True):
            own = np.einsum("jn,kn->jk", apply(s.C.values, h, transposed=True), s.X.rays)
            with np.errstate(divide="ignore"):
                ratio = np.where(own > 0, spared / (4 * own), np.inf).min(axis=1)
            np.minimum.at(part_of_all, self.part[index], ratio)
        e = np.minimum(part_of_all, 1.0)[self.part[model.owners(1)]] * e
        return direct_loop(model).solve(r + e, True, 1e-12), e

    def _levels(self) -> list[Index] | None:
        """Parts by the longest chain of parts that they feed; None if that is too long."""
        model, count = self.model, int(self.part.max()) + 1
        coo = self.between.tocoo()
        source, target = (self.part[model.owners(kind)[at]] for kind, at in ((2, coo.coords[0]), (1, coo.coords[1])))
        feeds = sp.csr_array((np.ones(len(source)), (target, source)), shape=(count, count))
        feeds.sum_duplicates()
        open_ends = np.bincount(feeds.indices, minlength=count)
        level, out = np.flatnonzero(open_ends == 0), []
        while level.size:
            out.append(level)
            if len(out) > _LONGEST:
                return None
            behind, times = np.unique(feeds[level].indices, return_counts=True)
            open_ends[behind] -= times
            level = behind[open_ends[behind] == 0]
        return out


def strong_parts(model: NetworkModel) -> Parts | None:
    """The strongly connected parts, or None if no link leads from one to another.

    Costs one depth-first search over the coupling.
    """
    count, part = connected_components(_listening(model), directed=True, connection="strong")
    if count == 1:
        return None
    coo = model.W.tocoo()
    inside = part[model.owners(1)[coo.coords[0]]] == part[model.owners(2)[coo.coords[1]]]
    if inside.all():
        return None
    kept, cut = (
        sp.csr_array((coo.data[chosen], (coo.coords[0][chosen], coo.coords[1][chosen])), shape=coo.shape)
        for chosen in (inside, ~inside)
    )
    return Parts(model, model.with_coupling(Matrix(kept)), part.astype(np.intp), sp.csr_array(cut.T))


def _listening(model: NetworkModel) -> sp.csr_array:
    """Which nodes hear which."""
    n = model.n_nodes
    if model.is_ordered and model.totals[1:] == (n, n):
        return model.W
    coo = model.W.tocoo()
    at = model.owners(1)[coo.coords[0]], model.owners(2)[coo.coords[1]]
    out = sp.csr_array((np.ones(coo.nnz), at), shape=(n, n))
    out.sum_duplicates()  # several links between two nodes
    return out
