"""Local observers of a network: bounds on all states from measurements at the nodes, for all time.

Nodes and links, with w(t) in [w_lo, w_hi] and |n(t)| <= noise, entry by entry, and D = 0:

    x_j' = A_j x_j + B_j u_j + w_j,    u = W C x + known inputs,    y_j = C_j x_j + n_j.

Every node has two copies of itself, which get the outputs of the copies of its neighbours through the same links, and a
gain L_j for what is measured at the node:

    z_j' = A_j z_j + B_j u_j(z) + L_j (C_j z_j - y_j) + constant,    constant = upper_j or lower_j.

What separates them obeys the network of the nodes A_j + L_j C_j, B_j, C_j under the same links, driven by
upper - (w + L n) and by (w + L n) - lower.  If that network is positive, both stay in X as long as on every facet h

    h'upper >= max h'(w + L n),    h'lower <= min h'(w + L n)    over all w and n,

and if it is stable (Theorem 4) the width z_hi - z_lo, driven by upper - lower, is at last below each `x_max` with

    A_j x_j + B_j u_j + (upper - lower)_j in -X_j,    C_j x_j - y_j in -Y_j,    W y - u in -U

in the order of X.  Everything is proven node by node and link by link.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cones import Cone, Orthant
from ..design.bounded.network_certificate import moved
from ..design.plant import closed_loop, times
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.linalg import Rationals
from ..exact.matrix import Matrix
from ..networks import conditions as on
from ..networks import files
from ..networks.blocks import take_blocks
from ..networks.certificate import ClaimOnNetwork, dissipation, node_vectors
from ..networks.model import NetworkModel
from ..networks.own_links import rightly_closed, same_network
from ..networks.witnesses import positive_parts
from ..proof.certificate import Fractions, Status, Vector, exactly
from ..proof.inclusion import NO_MARGIN
from ..proof.weights import Prover
from .certificate import nonnegative

_UPPER, _LOWER = "h'upper >= h'(w + L n)", "h'lower <= h'(w + L n)"
_COVER, _ABOVE, _WIDTH = "a'x >= 0", "(a - e)'x >= 0", "(2 a - e)'x_max <= width"
_ENDS = ("x_max", "u_max", "y_max")


class Box:
    """Disturbances and noise of a network, stack by stack, exactly.

    Parameters
    ----------
    plant : NetworkModel
    w_lo, w_hi, noise : Matrix, shapes (n,), (n,), (sum q_k,)
    """

    def __init__(self, plant: NetworkModel, w_lo: Matrix, w_hi: Matrix, noise: Matrix) -> None:
        self.plant = plant
        self.w_lo, self.w_hi = plant.split(w_lo.fractions(), 0), plant.split(w_hi.fractions(), 0)
        self.noise = plant.split(noise.fractions(), 2)

    def pushed(self, g: int, gain: Matrix) -> tuple[Rationals, Rationals]:
        """The largest and the smallest h'(w + L n) for all nodes of a stack and facets h, shape (N, r)."""
        H = self.plant.stacks[g].X.exact_facets.plain()
        around = (np.abs(times(H[None], gain).fractions()) * self.noise[g][:, None, :]).sum(axis=2)
        most, least = highest(H, self.w_lo[g], self.w_hi[g]), -highest(-H, self.w_lo[g], self.w_hi[g])
        return most + around, least - around


def highest(H: Matrix, lo: Rationals, hi: Rationals) -> Rationals:
    """The largest h'w over lo <= w <= hi, for rows h of H and of stacks (N, n) of bounds; shape (N, r)."""
    h = H.fractions()
    up, down = np.where(h > 0, h, 0), np.where(h < 0, h, 0)
    return hi @ up.T + lo @ down.T


def observed(plant: NetworkModel, gain: Matrix) -> NetworkModel:
    """The network of the nodes A_j + L_j C_j, B_j, C_j, exactly.

    Raises
    ------
    DataError
        Gains of another size, or outside the blocks of the nodes; D is not 0.
    """
    n, _, q = plant.totals
    if gain.shape != (n, q) or not (gain.is_sparse and gain.is_double):
        raise DataError("the gains stand in a sparse matrix of doubles, a row for each state, a column for each output.")
    if plant.has_feedthrough:
        raise DataError("local observers are for nodes without feedthrough.")
    parts = blocks_of(plant, gain, 0, 2)
    stacks = [replace(s, A=closed_loop(s.A, L, s.C)) for s, L in zip(plant.stacks, parts, strict=True)]
    return NetworkModel(tuple(stacks), plant.members, plant.coupling, plant.dt)


def blocks_of(model: NetworkModel, M: Matrix, rows: int, columns: int) -> list[Matrix]:
    """The blocks of the nodes in a sparse matrix, stack by stack, if it has no others.

    Raises
    ------
    DataError
        There are entries outside the blocks.
    """
    out = [take_blocks(M, p[rows], p[columns]) for p in model.places]
    if sum(np.count_nonzero(block.values) for block in out) != sp.csr_array(M.values).count_nonzero():
        raise DataError("a matrix has entries outside the blocks of the nodes.")
    return out


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NetworkObserverCertificate(ClaimOnNetwork):
    """Proof that local observers enclose the states of a network for all time, and how wide they are at last.

    Attributes
    ----------
    plant : NetworkModel
        The network that is observed.
    gain : Matrix, sparse, shape (n, sum q_k)
        L, block by block; 0 in the columns of outputs that are not measured.
    model : NetworkModel
        Of the nodes A_j + L_j C_j; it follows from `plant` and `gain`.
    v, r, q, exact
        As in `NetworkCertificate`, with sigma = 1, for `model`.
    w_lo, w_hi : ndarray, shape (n,)
        Bounds on the disturbances, entry by entry.
    noise : ndarray, shape (sum q_k,)
        Bounds on |n|, entry by entry; 0 at outputs that are not measured.
    w_lo_exact, w_hi_exact, noise_exact : tuple of Fraction, or None
        Where doubles do not suffice.
    upper, lower : ndarray, shape (n,)
        Constant inputs of the two copies.
    x_max, u_max, y_max : ndarray, shapes (n,), (sum m_j,), (sum q_k,)
        In the order of X z_hi - z_lo tends to at most x_max.
    covers : Matrix, sparse, shape (n, n)
        The rows a_i that turn bounds in the order of X into bounds on entries.
    width : ndarray, shape (n,)
        The bounds on x_i are at last no further apart than this.
    """

    claim: ClassVar[str] = "network observer"
    no_margin: ClassVar[frozenset[str]] = NO_MARGIN

    plant: NetworkModel
    gain: Matrix
    w_lo: Vector = Vector(required=True)
    w_hi: Vector = Vector(required=True)
    noise: Vector = Vector(required=True)
    upper: Vector = Vector(required=True)
    lower: Vector = Vector(required=True)
    x_max: Vector = Vector(required=True)
    u_max: Vector = Vector(required=True)
    y_max: Vector = Vector(required=True)
    width: Vector = Vector(required=True)
    covers: Matrix
    w_lo_exact: Fractions = Fractions("w_lo")
    w_hi_exact: Fractions = Fractions("w_hi")
    noise_exact: Fractions = Fractions("noise")

    @cached_property
    def X(self) -> Cone:
        """The product of the cones of the states of all nodes."""
        return files.product_cone(self.plant, 0)

    def is_consistent(self) -> bool:
        """True if links of nodes to themselves were closed rightly in the plant, should they have been."""
        return super().is_consistent() and rightly_closed(self.plant)

    def conditions(self) -> Sequence[Condition]:
        """The inequalities above."""
        model, (v, r, q) = self.model, node_vectors(self)
        if not same_network(observed(self.plant, self.gain), model):
            raise DataError("the network that is stable is not that of the nodes A + L C.")
        n, m, p = model.totals
        sizes = {"w_lo": n, "w_hi": n, "noise": p, "upper": n, "lower": n, "width": n, "x_max": n, "u_max": m, "y_max": p}
        vectors = {name: exactly(self, name) for name in sizes}
        if any(vectors[name].shape != (size,) for name, size in sizes.items()) or self.covers.shape != (n, n):
            raise DataError("a vector has not the entries of all nodes.")
        lo, hi, noise = (vectors[name].fractions() for name in ("w_lo", "w_hi", "noise"))
        if (lo > hi).any() or (noise < 0).any():
            raise DataError("w_lo <= w_hi and noise >= 0.")
        apart = Matrix.from_fractions(vectors["upper"].fractions() - vectors["lower"].fractions())
        x, u, y = (vectors[name] for name in _ENDS)
        return [
            *positive_parts(model),
            *dissipation(model, v, r, q, 0.0, discrete=model.discrete),
            on.balance(model, q, r, None),
            *self._pushed(),
            *moved(model, (x, u, y), apart, "<="),
            *self._entries(),
        ]

    def _pushed(self) -> Iterator[Condition]:
        """Conditions on the constant inputs."""
        model, box = self.model, Box(self.plant, *(exactly(self, name) for name in ("w_lo", "w_hi", "noise")))
        ends = [model.split(exactly(self, name).fractions(), 0) for name in ("upper", "lower")]
        for g, gain in enumerate(blocks_of(model, self.gain, 0, 2)):
            H = model.stacks[g].X.exact_facets.plain().fractions()
            most, least = box.pushed(g, gain)
            yield nonnegative(on.titled(_UPPER, model, g), ends[0][g] @ H.T - most)
            yield nonnegative(on.titled(_LOWER, model, g), least - ends[1][g] @ H.T)

    def _entries(self) -> Iterator[Condition]:
        """Conditions on bounds of entries."""
        model = self.model
        x, width = (model.split(exactly(self, name).fractions(), 0) for name in ("x_max", "width"))
        for g, a in enumerate(blocks_of(model, self.covers, 0, 0)):
            s = model.stacks[g]
            eye = np.eye(s.sizes[0])
            rest = Matrix.join([a, Matrix(np.tile(-eye, (len(s), 1, 1)))], -1)
            both = Matrix(np.concatenate([eye, eye]))
            yield Condition(on.titled(_COVER, model, g), on.stacked(a, None, s.rays[0]), ">=")
            yield Condition(on.titled(_ABOVE, model, g), on.stacked(rest, both, s.rays[0]), ">=")
            yield nonnegative(on.titled(_WIDTH, model, g), width[g] - widths(a, x[g]))

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is not None:
            raise DataError("there is no witness against an observer.")
        return super()._evaluate()

    @cached_property
    def margin(self) -> float:  # type: ignore[override]
        """0: bounds that are as narrow as possible leave nothing to spare."""
        return 0.0

    def contents(self) -> dict[str, Any]:
        """The network that is observed as one large system, and the fields."""
        own = {key: value for key, value in self.data().items() if key not in ("model", "plant", "loop_weights")}
        return {**files.describe(self.plant), **own}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> Any:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        own = {f.name: contents[f.name] for f in fields(cls) if f.name in contents}
        plant = files.rebuild(contents)
        return cls.settle(**own, plant=plant, model=observed(plant, own["gain"]))

    def evidence(self) -> dict[str, Any]:
        """Weights for positivity and the coupling, and of the vectors that lie in X, U and Y."""
        out, prover = files.evidence(self.model, None), Prover()
        cones = [files.product_cone(self.model, kind) for kind in range(3)]
        if all(isinstance(cone, Orthant) for cone in cones):
            return out
        upper, lower, *ends = (exactly(self, name).fractions() for name in ("upper", "lower", *_ENDS))
        below = files.moved(self.model, *ends, upper - lower)
        places = zip(("wz", "wC", "wW"), (0, 2, 1), below, strict=True)
        return out | {name: prover.vector(cones[kind], -vector) for name, kind, vector in places}

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: no enclosure of the states of the network is proven."
        time = "steps" if self.model.discrete else "time"
        return (
            f"Proved: from every enclosure of the first states the two copies of each of {self.plant.n_nodes} nodes, "
            f"which exchange outputs as the nodes do, enclose the states for all {time}, for all disturbances and noise "
            "within their bounds. Their distance is at last at most `width`, entry by entry, whatever disturbances, "
            "noise, inputs and measurements do."
        )


def widths(a: Matrix, x: NDArray[Any]) -> Rationals:
    """(2 a_i - e_i)'x of every node, shape (N, n)."""
    return 2 * (a.fractions() * x[:, None, :]).sum(axis=2) - x
