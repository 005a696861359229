"""Local observers of a network: bounds on all states from measurements at the nodes, for all time.

Nodes and links, with w(t) in [w_lo, w_hi] and |n(t)| <= noise, entry by entry, and D = 0:

    x_j' = A_j x_j + B_j u_j + w_j,    u = W C x + known inputs,    y_j = C_j x_j + n_j.

Every node has two copies of itself, which get the outputs of the copies of its neighbours through the same links, and a
gain L_j for what is measured at the node:

    z_j' = A_j z_j + B_j u_j(z) + L_j (C_j z_j - y_j) + constant,    constant = upper_j or lower_j.

What separates them obeys the network of the nodes A_j + L_j C_j, B_j, C_j under the same links, driven by
upper - (w + L n) and by (w + L n) - lower.  If that network is positive, both stay in X as long as on every facet h

    h'upper >= max h'(w + L n),    h'lower <= min h'(w + L n)    over all w and n,

and if it is stable (Theorem 4) the width z_hi - z_lo, driven by upper - lower, tends to a limit below each `x_max` with

    A_j x_j + B_j u_j + (upper - lower)_j in -X_j,    C_j x_j - y_j in -Y_j,    W y - u in -U

in the order of X.  Everything is proven node by node and link by link.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ..cones import Cone, Orthant
from ..design.bounded.network_certificate import moved
from ..design.plant import closed_loop, times
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..networks import conditions as on
from ..networks import files
from ..networks.blocks import take_blocks
from ..networks.certificate import ClaimOnNetwork, dissipation, node_vectors
from ..networks.model import NetworkModel
from ..networks.own_links import rightly_closed, same_network
from ..networks.witnesses import positive_parts
from ..proof.certificate import Fractions, Status, Vector, exactly
from ..proof.inclusion import NO_MARGIN
from ..proof.portable_cones import portable_rows
from ..proof.weights import Prover

_UPPER, _LOWER = "h'upper >= h'(w + L n)", "h'lower <= h'(w + L n)"
_COVER, _ABOVE, _WIDTH = "a'x >= 0", "(a - e)'x >= 0", "width - (2 a - e)'x_max >= 0"
_ENDS = ("x_max", "u_max", "y_max")


def pushed_forms(X: Cone, d: Matrix, box: Sequence[Matrix], gain: Matrix | None, sign: int) -> BilinearForms:
    """h'd - max h'(w + L n) for the facets h of X, or their negatives, and all nodes of a stack; shape (N, r, 1).

    Parameters
    ----------
    X : Cone
    d : Matrix, shape (N, n)
    box : (w_lo, w_hi, noise), shapes (N, n), (N, n), (N, q)
    gain : Matrix, shape (N, n, q), or None for no noise
    sign : 1 or -1
        -1: with -h for h, so that it is min h'(w + L n) - h'd.
    """
    h, count = sign * portable_rows(X.exact_facets), d.shape[0]
    H = Matrix.from_fractions(h)
    up, down = (Matrix.from_fractions(part) for part in (np.where(h > 0, h, 0), np.where(h < 0, h, 0)))
    left, right = [_repeated(part, count) for part in (H, -up, -down)], [d, box[1], box[0]]
    if gain is not None:
        around = gain if isinstance(X, Orthant) else times(H[None], gain)
        left, right = [*left, -_sizes(around)], [*right, box[2]]
    return on.stacked(Matrix.join(left, -1), None, on.beside(*right))


def _repeated(M: Matrix, count: int) -> Matrix:
    return M[None][np.zeros(count, dtype=np.intp)]


def _sizes(M: Matrix) -> Matrix:
    """|M| entry by entry."""
    if M.is_double:
        return Matrix(np.abs(M.values))
    integers, unit = M.as_integers()
    return Matrix.over(np.abs(integers) * Fraction(unit).numerator, Fraction(unit).denominator)


def apart(upper: Matrix, lower: Matrix) -> Matrix:
    """upper - lower, exactly."""
    return closed_loop(upper[:, None], lower[:, None], Matrix(np.array([[-1.0]])))[:, 0]


def observed(plant: NetworkModel, gain: Matrix) -> NetworkModel:
    """The network of the nodes A_j + L_j C_j, B_j, C_j, exactly.

    Raises
    ------
    DataError
        Gains of another size, or outside the blocks of the nodes; D is not 0.
    """
    n, _, q = plant.totals
    if gain.shape != (n, q) or not (gain.is_sparse and gain.is_double):
        raise DataError(
            "the gains stand in a sparse matrix of doubles, a row for each state, a column for each output."
        )
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
    """Proof that local observers enclose the states of a network for all time, and their width in the limit.

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
        The distance of the bounds on x_i tends to at most this.
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
        sizes = {
            "w_lo": n,
            "w_hi": n,
            "noise": p,
            "upper": n,
            "lower": n,
            "width": n,
            "x_max": n,
            "u_max": m,
            "y_max": p,
        }
        vectors = {name: exactly(self, name) for name in sizes}
        if any(vectors[name].shape != (size,) for name, size in sizes.items()) or self.covers.shape != (n, n):
            raise DataError("a vector has not the entries of all nodes.")
        x, u, y = (vectors[name] for name in _ENDS)
        return [
            *positive_parts(model),
            *dissipation(model, v, r, q, 0.0, discrete=model.discrete),
            on.balance(model, q, r, None),
            *self._pushed(),
            *moved(model, (x, u, y), apart(vectors["upper"], vectors["lower"]), "<="),
            *self._entries(),
        ]

    def _pushed(self) -> Iterator[Condition]:
        """The bounds in their order, and conditions on the constant inputs."""
        model = self.model
        lo, hi, noise, upper, lower = (exactly(self, name) for name in ("w_lo", "w_hi", "noise", "upper", "lower"))
        ordered = Matrix.join([hi[:, None], -lo[:, None]], -1)
        yield Condition("w_lo <= w_hi", BilinearForms(Matrix(np.ones((1, 2))), None, ordered), ">=")
        yield Condition("noise >= 0", BilinearForms(Matrix(np.ones((1, 1))), None, noise[:, None]), ">=")
        boxes = zip(*(model.split(part, kind) for part, kind in ((lo, 0), (hi, 0), (noise, 2))), strict=True)
        ends = zip(model.split(upper, 0), model.split(lower, 0), strict=True)
        parts = zip(boxes, ends, blocks_of(model, self.gain, 0, 2), strict=True)
        for g, (box, (high, low), gain) in enumerate(parts):
            X = model.stacks[g].X
            yield Condition(on.titled(_UPPER, model, g), pushed_forms(X, high, box, gain, 1), ">=")
            yield Condition(on.titled(_LOWER, model, g), pushed_forms(X, low, box, gain, -1), ">=")

    def _entries(self) -> Iterator[Condition]:
        """Conditions on bounds of entries."""
        model = self.model
        x, width = (model.split(exactly(self, name), 0) for name in ("x_max", "width"))
        for g, a in enumerate(blocks_of(model, self.covers, 0, 0)):
            s = model.stacks[g]
            eye = np.tile(np.eye(s.sizes[0]), (len(s), 1, 1))
            both = Matrix(np.concatenate([eye[0], eye[0]]))
            above = Matrix.join([a, Matrix(-eye)], -1)
            twice = Matrix.join([Matrix(-2 * a.values), Matrix(eye), Matrix(eye)], -1)
            yield Condition(on.titled(_COVER, model, g), on.stacked(a, None, s.rays[0]), ">=")
            yield Condition(on.titled(_ABOVE, model, g), on.stacked(above, both, s.rays[0]), ">=")
            final = on.stacked(twice, None, on.beside(x[g], x[g], width[g]))
            yield Condition(on.titled(_WIDTH, model, g), final, ">=")

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
        below = files.moved(self.model, ends[0], ends[1], ends[2], upper - lower)
        places = zip(("wz", "wC", "wW"), (0, 2, 1), below, strict=True)
        return out | {name: prover.vector(cones[kind], -vector) for name, kind, vector in places}

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: no enclosure of the states of the network is proven."
        time = "steps" if self.model.discrete else "time"
        return (
            f"Proved: from every enclosure of the first states the two copies of each of {self.plant.n_nodes} nodes, "
            f"which exchange outputs as the nodes do, enclose the states for all {time}, for all disturbances and "
            "noise within their bounds. The bounds on each state tend to a distance of at most its entry of `width`, "
            "whatever disturbances, noise, inputs and measurements do."
        )
