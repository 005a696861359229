"""The closed loop of a network as a sparse pencil of integers, without forming it.

On the product of all X_j and U_j

    M - mu E = [[A - mu I, B], [W C, W D - I]]

is cross-positive, and it is stable if and only if the algebraic loop contracts and the spectral abscissa of the
closed loop is below mu: A + B (I - W D)^{-1} W C is a Schur complement of M.  So there is either (v, r) with
(v, r)'(M - mu E) < 0 or (x, u) with (M - mu E)(x, u) in X x U.  These are Theorem-4 data (q = -W'r), or a direction in
which the state does not decay faster than mu.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ...exact.matrix import Integers
from ...exact.sparse_integers import SparseIntegers
from ...theorems.generator_coordinates import Coordinates, Pencil, sparse_integers
from ...theorems.perron_pair import Cones, Decision
from ..exact_loop import blocks, scales
from ..model import NetworkModel

Outcome: TypeAlias = "tuple[bool, Integers, Integers]"


@dataclass(frozen=True, eq=False)
class NetworkPencil:
    """M - mu E of a positive network, in generator coordinates.

    Attributes
    ----------
    model : NetworkModel
    """

    model: NetworkModel

    @cached_property
    def coordinates(self) -> Coordinates:
        """Of the product of all X_j and U_j."""
        model, (n, m, _) = self.model, self.model.totals
        pieces = []
        for (x, u, _), s in zip(model.places, model.stacks, strict=True):
            pieces += [(s.X, x), (s.U, u + n)]
        return Coordinates.of(pieces, n + m)

    @cached_property
    def W(self) -> tuple[SparseIntegers, Fraction]:
        """The coupling as integers times a factor."""
        return sparse_integers(self.model.coupling)

    @cached_property
    def _scales(self) -> tuple[int, int]:
        """What the rows of states and those of inputs are multiplied by to be integers."""
        state, output = scales(self.model)
        return state, output * self.W[1].denominator

    @cached_property
    def pencil(self) -> Pencil:
        """M and E."""
        (n, m, _), at, (W, factor) = self.model.totals, self.coordinates, self.W
        size, (state, port) = n + m, self._scales
        output = port // factor.denominator
        own, sent = self._beside("AB", state), self._beside("CD", output)
        states = SparseIntegers(own.data, own.indices, np.append(own.indptr, np.full(m, own.indptr[-1])), size)
        heard = W.times(factor.numerator) @ sent
        inputs = SparseIntegers(
            heard.data, heard.indices, np.concatenate([np.zeros(n, dtype=np.intp), heard.indptr]), size
        )
        N = at.into @ (states + inputs) @ at.out
        E = at.heights * state
        E[n:] = 0
        direct = -at.heights * port
        direct[:n] = 0
        return Pencil(N + SparseIntegers.diagonal(direct), E, at.cones)

    def _beside(self, names: str, scale: int) -> SparseIntegers:
        """[A, B] or [C, D] times the scale."""
        left, right = (blocks(self.model, name, scale, beside=True) for name in names)
        return left + right

    def signals(self, x: Integers, u: Integers) -> tuple[Integers, Integers, Integers]:
        """x, u and y = C x + D u, all times one number."""
        scale = self._scales[1] // self.W[1].denominator
        return x * scale, u * scale, self._beside("CD", scale).apply(np.concatenate([x, u]))

    def decide(self, shift: float) -> Outcome | None:
        """Whether the algebraic loop contracts and the spectral abscissa is below the shift.

        Returns
        -------
        stable : bool
        state, port : ndarray of int (object), shapes (sum n_j,), (sum m_j,)
            v and r if stable, else x and u, all times one number.  None instead where it is undecided.
        """
        found = self.pencil.decide(shift)
        return None if found is None else self._outcome(found)

    def decide_loop(self) -> Outcome | None:
        """Whether the algebraic loop u = W D u contracts; `state` holds zeros."""
        n, (m, N, cones) = self.model.totals[0], (self.model.totals[1], self.pencil.N, self.pencil.cones)
        inside = (N.rows >= n) & (N.indices >= n)
        own = SparseIntegers.of(N.rows[inside] - n, N.indices[inside] - n, N.data[inside], (m, m))
        facets = {k - n: rows for k, rows in cones.facets.items() if k >= n}
        rays = {k - n: rows for k, rows in cones.rays.items() if k >= n}
        found = Pencil(own, np.zeros(m, dtype=object), Cones(cones.group[n:] - n, facets, rays)).decide(0)
        if found is None:
            return None
        return self._outcome(Decision(found.stable, np.concatenate([np.zeros(n, dtype=object), found.vector])))

    def _outcome(self, found: Decision) -> Outcome:
        n, vector = self.model.totals[0], found.vector
        if found.stable:
            scales = np.array(self._scales, dtype=object)[(np.arange(len(vector)) >= n).astype(int)]
            vector = self.coordinates.into.T.apply(vector * scales)
        else:
            vector = self.coordinates.out.apply(vector)
        return found.stable, vector[:n], vector[n:]
