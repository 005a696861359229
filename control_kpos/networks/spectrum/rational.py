"""Certificates found in integers, where rounding hides on which side of the margin a network lies.

The closed loop is a sparse pencil of integers, which need not be formed.  On the product of all X_j and U_j

    M - mu E = [[A - mu I, B], [W C, W D - I]]

is cross-positive, and it is stable if and only if the algebraic loop contracts and the spectral abscissa of the
closed loop is below mu: A + B (I - W D)^{-1} W C is a Schur complement of M.  So there is either (v, r) with
(v, r)'(M - mu E) < 0 or (x, u) with (M - mu E)(x, u) in X x U.

From (v, r) with v'A + r'W C < 0 and v'B + r'W D - r' < 0 on the generators, q = -W'r completes the data of Theorem 4.
From (x, u) with A x + B u in X and W(C x + D u) - u in U, the output y = C x + D u completes a witness.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import gcd
from typing import Any, TypeAlias

import numpy as np

from ...errors import TooLargeError
from ...exact.matrix import Integers, Matrix, bit_length
from ...exact.rounding import double_below
from ...exact.sparse_integers import SparseIntegers
from ...theorems.generator_coordinates import Coordinates, Pencil, sparse_integers
from ...theorems.perron_pair import Cones, Decision
from .. import conditions as on
from ..certificate import NetworkCertificate
from ..integers import blocks, scales
from ..model import NetworkModel
from ..witnesses import (
    AlgebraicLoop,
    LoopWeights,
    NetworkInstability,
    nodes_in_loop,
)

Outcome: TypeAlias = "tuple[bool, Integers, Integers]"

# Binary digits above which integers are divided, so that their doubles do not overflow.
_LONGEST = 900
# How many times the entries of the equations with ports the closed loop may have.
_MORE = 4


@dataclass(frozen=True, eq=False)
class NetworkPencil:
    """M - mu E of a positive network, in generator coordinates."""

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
        N = at.of_map(states + inputs)
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

    def decide(self, shift: float | Fraction, *, marginal: bool = False, growing: bool = False) -> Outcome | None:
        """Whether the algebraic loop contracts and the spectral abscissa is below the shift; None where undecided.

        With it come v and r if stable, else x and u, all times one number.
        """
        found = self.pencil.decide(shift, marginal=marginal, growing=growing)
        return None if found is None else self.outcome(found)

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
        return self.outcome(Decision(found.stable, np.concatenate([np.zeros(n, dtype=object), found.vector])))

    def outcome(self, found: Decision) -> Outcome:
        """Of a decision about the pencil: v and r, or x and u."""
        n, vector = self.model.totals[0], found.vector
        if found.stable:
            scales = np.array(self._scales, dtype=object)[(np.arange(len(vector)) >= n).astype(int)]
            vector = self.coordinates.into.T.apply(vector * scales)
        else:
            vector = self.coordinates.out.apply(vector)
        return found.stable, vector[:n], vector[n:]


class ClosedPencil(NetworkPencil):
    """A + B W C - mu I of a positive network without feedthrough: fewer unknowns, where its entries are not many."""

    @cached_property
    def coordinates(self) -> Coordinates:
        """Of the product of all X_j."""
        pieces = [(s.X, x) for (x, _, _), s in zip(self.model.places, self.model.stacks, strict=True)]
        return Coordinates.of(pieces, self.model.totals[0])

    @cached_property
    def _parts(self) -> tuple[SparseIntegers, SparseIntegers, SparseIntegers]:
        """A, B and W C, multiplied by both scales, the first, and the second."""
        (W, factor), (state, port) = self.W, self._scales
        heard = W.times(factor.numerator) @ blocks(self.model, "C", port // factor.denominator)
        return blocks(self.model, "A", state * port), blocks(self.model, "B", state), heard

    @cached_property
    def pencil(self) -> Pencil:
        """See `NetworkPencil`."""
        (A, B, heard), at, (state, port) = self._parts, self.coordinates, self._scales
        return Pencil(at.of_map(A + B @ heard), at.heights * (state * port), at.cones)

    def outcome(self, found: Decision) -> Outcome:
        """See `NetworkPencil`."""
        (_, B, heard), (state, port) = self._parts, self._scales
        if found.stable:
            v = self.coordinates.into.T.apply(found.vector)
            return True, v * state, B.T.apply(v)
        x = self.coordinates.out.apply(found.vector)
        return False, x * port, heard.apply(x)


def network_pencil(model: NetworkModel) -> NetworkPencil:
    """With unknowns for the inputs only where the network has feedthrough, or the closed loop many entries more."""
    if model.has_feedthrough:
        return NetworkPencil(model)
    _, B, C, _ = model.block_matrices
    heard = np.bincount(B.indices, minlength=model.totals[1])
    sent = np.diff(C.indptr)
    closed = int(heard[np.repeat(np.arange(model.totals[1]), np.diff(model.W.indptr))] @ sent[model.W.indices])
    apart = B.nnz + int(sent[model.W.indices].sum()) + model.totals[1]
    return (ClosedPencil if closed <= _MORE * apart else NetworkPencil)(model)


def certify_exactly(
    model: NetworkModel, loop: LoopWeights, required: Fraction | None = None, *, growing: bool = False
) -> NetworkCertificate:
    """Decide Theorem 4 for a positive network with W Y in U, also at the margin and within rounding of it.

    A decay rate that is required is proven, also with equality, or left UNDECIDED; so is all where the Perron vector
    cannot be refined, or cones that are not simplicial ask for programs too long.  What grows is looked for first if
    that is expected.
    """
    network = network_pencil(model)
    try:
        return _certified(network, loop, required, growing)
    except TooLargeError:  # facets of some cone
        return NetworkCertificate.settle(model=model, loop_weights=loop)


def _certified(
    network: NetworkPencil, loop: LoopWeights, required: Fraction | None, growing: bool
) -> NetworkCertificate:
    model = network.model
    if model.has_feedthrough and loop is None:
        direct = network.decide_loop()
        if direct is None or not direct[0]:
            witness = None if direct is None else _algebraic(network, direct[2])
            return NetworkCertificate.settle(model=model, witness=witness)
        loop = _loop_weights(network, direct[2])
    least = 1.0 if model.discrete else 0.0
    shift = least if required is None else model.discrete - required
    found = network.decide(shift, marginal=required is not None, growing=growing)
    if found is None or (required is not None and not found[0]):
        return NetworkCertificate.settle(model=model, loop_weights=loop)
    if found[0]:
        rates = {"decay_rate": double_below(required or 0.0), "required_rate": required}
        vectors = {**_falling(network, found), "sigma": np.ones(model.n_nodes), "loop_weights": loop}
        return NetworkCertificate.settle(model=model, **vectors, **rates)
    return NetworkCertificate.settle(model=model, loop_weights=loop, witness=_growing(network, found, least))


def bracket_exactly(
    model: NetworkModel, relative: float, loop: LoopWeights, about: float | None = None
) -> dict[str, Any] | None:
    """Both sides of a bracket of the spectral abscissa, as fields of an `AbscissaCertificate`, or None.

    The network is positive, with an algebraic loop that contracts.  `about` is an estimate of the abscissa, if there is
    one.
    """
    network = network_pencil(model)
    try:
        about = network.pencil.estimate(relative) if about is None else about
    except TooLargeError:
        return None
    if not np.isfinite(about):
        return None
    ends = network.pencil.bracket(about, sought(model, relative, about), _size(model))
    if len(ends) < 2:
        return None
    (lower, below), (upper, above) = ends[False], ends[True]
    sides = {**_falling(network, network.outcome(above)), "below": _growing(network, network.outcome(below), lower)}
    return {"lower": lower, "upper": upper, **sides, "loop_weights": loop}


def sought(model: NetworkModel, relative: float, about: float) -> float:
    """The width of a bracket: relative to the abscissa or to 2^-40 of the size of A, whichever is larger."""
    return relative * max(abs(about), 2.0**-40 * _size(model) + 1e-300)


def _size(model: NetworkModel) -> float:
    return max(float(np.abs(s.A.values).max(initial=0.0)) for s in model.stacks)


def _falling(network: NetworkPencil, found: Outcome) -> dict[str, Any]:
    """v, r, q of a stable outcome."""
    W, factor = network.W
    _, v, r = found
    q = W.T.apply(r) * -factor.numerator
    return dict(zip("vrq", _over_power_of_two([v * factor.denominator, r * factor.denominator, q]), strict=True))


def _growing(network: NetworkPencil, found: Outcome, rate: float) -> NetworkInstability:
    x, u, y = _together(*network.signals(found[1], found[2]))
    return NetworkInstability(x, u, y, rate)


def _algebraic(network: NetworkPencil, port: Integers) -> AlgebraicLoop:
    _, u, y = network.signals(np.zeros(network.model.totals[0], dtype=object), port)
    y, u = _together(y, u)
    return AlgebraicLoop(y, u, nodes_in_loop(network.model, y))


def _loop_weights(network: NetworkPencil, t: Integers) -> LoopWeights:
    """p = W't and a little of int Y*, as much as (t' - t'W D) u leaves room for."""
    model, (W, factor) = network.model, network.W
    p = W.T.apply(t) * factor
    inner = model.join([np.tile(_row_sum(on.facets(s.Y)), (len(s), 1)) for s in model.stacks], 2)
    part = Fraction(1)
    for s, p_g, e_g, t_g in zip(model.stacks, model.split(p, 2), model.split(inner, 2), model.split(t, 1), strict=True):
        D, rays = s.D.fractions(), s.rays[1]
        rows = rays.rows_as_integers(np.arange(rays.shape[0])).T
        spare = (t_g - (p_g[:, None, :] @ D)[:, 0]) @ rows
        cost = (e_g[:, None, :] @ D)[:, 0] @ rows
        part = min([part, *(Fraction(a) / b for a, b in zip(spare.ravel(), cost.ravel(), strict=True) if b > 0)])
    p = p + inner * part
    size = 1 << bit_length(t)
    return Matrix.from_fractions(p / Fraction(size)), Matrix.over(t, size)


def _row_sum(rows: Any) -> Integers:
    return rows.rows_as_integers(np.arange(rows.shape[0])).sum(axis=0)


def _together(*vectors: Integers) -> list[Matrix]:
    """Integers without a common factor, so that they are doubles if they can be."""
    content = gcd(*np.concatenate(vectors).tolist())
    return _over_power_of_two([x // content if content > 1 else x for x in vectors], spared=_LONGEST)


def _over_power_of_two(vectors: list[Integers], spared: int = 0) -> list[Matrix]:
    """Integers over a common power of two, of size 2^spared at most."""
    bits = max(0, *(bit_length(x) - spared for x in vectors))
    return [Matrix.over(x, 1 << bits) for x in vectors]
