"""Theorem 4 as a certificate: a network is positive and exponentially stable, or why not.

Theorem 4 (Kawano and Forni, Theorem `cone_ic_s`).  Let W map Y into U (I), let every node be positive
and exponentially dissipative with storage v_j'x_j, v_j in int X_j*, and supply r_j'u_j + q_j'y_j (II).
If there are sigma_j > 0 such that for every node k and every generator y of Y_k

    sigma_k q_k'y + sum_j sigma_j r_j'W_jk y <= 0,                                          (III')

then the network is positive on the product of the X_j and exponentially stable.  The paper's (III) reads
as one inequality summed over all nodes; that would let unstable networks through (a fast node hides a
self-loop with gain above 1), while its proof uses (III').  With feedthrough D the loop u = W D u must
contract, which p_k in int Y_k* and t_j prove.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cards import floored
from ..cones import Orthant
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.rows import frozen
from ..proof.certificate import Certificate, ClaimWithRate, Fractions, Status, Vector, VectorPair, exactly
from ..proof.in_time import unfinished
from . import conditions as on
from . import files
from .model import NetworkModel
from .own_links import rightly_closed
from .witnesses import (
    AlgebraicLoop,
    CouplingViolation,
    LoopWeights,
    NetworkInstability,
    NodeNotDissipative,
    NodeViolation,
    NoWeights,
    positive_parts,
    refute,
    restated,
)

# What a refusal is about, and what to do.
REMEDY = {
    CouplingViolation: "This is about these cones, and no sign of instability. Change the sign of the link, or choose "
    "cones that the coupling respects.",
    NodeViolation: "This is about these cones, and no sign of instability. Choose another cone for this node, or a "
    "local feedback that makes it positive.",
    NetworkInstability: "Weaken links, or raise the local gains at the nodes where x is largest.",
    AlgebraicLoop: "Weaken the feedthrough D or the links of this loop, or put dynamics into it.",
    NodeNotDissipative: "This is about these supply rates, not about stability. Relax that of the node: raise r or "
    "lower -q, or raise its local feedback.",
    NoWeights: "This is about these supply rates, not about stability. Relax them, or let the package find them: call "
    "without supply_rates.",
}


class NodeVector(Vector):
    """A field of vectors of all nodes, held after each other; it reads as (N, size), or a tuple if they differ in size.

    Parameters
    ----------
    kind : int
        0 for states, 1 for inputs, 2 for outputs of the `model` of the record.
    """

    def __init__(self, kind: int) -> None:
        super().__init__()
        self.kind = kind

    def read(self, record: Any, held: Any) -> Any:
        """See `Vector`."""
        model: NetworkModel = record.model
        if len({s.sizes[self.kind] for s in model.stacks}) == 1:
            return held.values.reshape(model.n_nodes, -1)
        return tuple(np.split(held.values, model.offsets[self.kind][1:-1]))

    def hold(self, value: Any) -> Any:
        """See `Vector`."""
        if isinstance(value, np.ndarray) and value.ndim > 2:
            raise DataError("the vectors of all nodes stand in an array of at most two dimensions.")
        if not isinstance(value, np.ndarray) and any(np.ndim(part) != 1 for part in value):
            raise DataError("the vector of a node has one dimension.")
        flat = np.ravel(value) if isinstance(value, np.ndarray) else np.concatenate([np.ravel(part) for part in value])
        return super().hold(flat)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClaimOnNetwork(Certificate):
    """A certificate that rests on v, r, q of Theorem 4 for the nodes of a network."""

    model: NetworkModel
    v: NodeVector = NodeVector(0)
    r: NodeVector = NodeVector(1)
    q: NodeVector = NodeVector(2)
    loop_weights: VectorPair = VectorPair()
    exact: Fractions = Fractions("v", "r", "q")

    @property
    def loop(self) -> LoopWeights:
        """`loop_weights`, exactly."""
        return None if self.loop_weights is None else exactly(self, "loop_weights")

    def is_consistent(self) -> bool:
        """True if links of nodes to themselves were closed rightly, should they have been."""
        return super().is_consistent() and rightly_closed(self.model)

    def contents(self) -> dict[str, Any]:
        """The network as one large system, and the fields."""
        own = {key: value for key, value in self.data().items() if key != "model"}
        if not self.model.has_feedthrough or not isinstance(self.witness, NetworkInstability | None):
            own["loop_weights"] = None  # there is no loop, or the witness does not need it
        return {**files.describe(self.model), **own}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> Any:
        """The inverse of `contents`; also reads files of version 0.1 that hold the model as a record.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        own = {f.name: contents[f.name] for f in fields(cls) if f.name in contents}
        model = own.get("model") or files.rebuild(contents)
        own = {**own, "model": model}
        draft = cls(**own)
        for name, total in zip("vrq", model.totals, strict=True):
            if vars(draft)[name] is not None and exactly(draft, name).shape != (total,):
                raise DataError(f"{name} has not {total} entries in all.")
        return cls.settle(**{**own, "witness": restated(draft)})


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NetworkCertificate(ClaimOnNetwork, ClaimWithRate):
    """Proof that a network is positive and exponentially stable by Theorem 4, or why it is not.

    Attributes
    ----------
    model : NetworkModel
        Nodes and coupling: the data the verdict is about.
    v : ndarray, shape (N, n), or tuple of ndarrays (n_j,), or None
        Storage functions v_j'x_j, per node.
    r, q : likewise, (m_j,) and (q_j,)
        Supply rates r_j'u_j + q_j'y_j, per node.
    sigma : ndarray, shape (N,), or None
        Weights of the nodes in V(x) = sum sigma_j v_j'x_j.
    decay_rate : float
        Proven: V(x(t)) <= exp(-decay_rate * t) V(x(0)), per unit of time; in discrete time
        V(x[k]) <= (1 - decay_rate)^k V(x[0]).
    required_rate : Fraction or None
        A decay rate that a design was asked for, exactly as given, if `decay_rate` is below it; the claim includes it.
    loop_weights : tuple of two ndarrays, shapes (sum q_k,), (sum m_j,), or None
        With feedthrough: p and t with p'D u <= t'u and t'W y < p'y, so that the algebraic loop contracts;
        tuples of Fraction where doubles do not suffice.
    exact : tuple of three tuples of Fraction, or None
        v (empty without a v), r and q in the order of nodes where doubles do not suffice; those above are their
        rounding.
    witness : CouplingViolation, NodeViolation, NetworkInstability, AlgebraicLoop, NodeNotDissipative or NoWeights
        What breaks the network, for REFUTED.
    """

    claim: ClassVar[str] = "network"

    sigma: NDArray[np.float64] | None = None
    decay_rate: float = 0.0

    def conditions(self) -> Sequence[Condition]:
        model = self.model
        if self.sigma is None:
            raise DataError("v, r, q or sigma is missing.")
        if not (0 <= self.decay_rate < np.inf and np.all(self.sigma > 0) and np.shape(self.sigma) == (model.n_nodes,)):
            raise DataError("decay_rate must not be negative, and sigma must hold one positive number per node.")
        v, r, q = node_vectors(self)
        if model.has_feedthrough and self.loop is None:
            raise DataError("loop_weights are missing although some D is not zero.")
        loop = self.loop if model.has_feedthrough else None
        decay = decreasing(model, v, r, q, self.decay_rate, loop, sigma=self.sigma, required=self.required_rate)
        return positive_parts(model) + decay

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.v is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def refutation(self) -> Sequence[Condition] | None:
        if isinstance(self.witness, NoWeights):
            rows = no_weights(self.model, exactly(self, "q"), exactly(self, "r"), exactly(self.witness, "y"))
            return [*positive_parts(self.model), *rows]
        return refute(self.model, self.witness, self.loop)

    def evidence(self) -> dict[str, Any]:
        """Weights for positivity and the coupling, and those of a witness; or the normal that is crossed."""
        return files.evidence(self.model, self.witness)

    @cached_property
    @np.errstate(all="ignore")
    def node_margins(self) -> NDArray[np.float64]:
        """How fast each node's storage decays, relative to the fastest rate in the network; shape (N,).

        Computed in floating point; what is proven is `decay_rate`.
        The smallest -(v'A - q'C)x / v'x over the generators of X_j, divided by the largest
        (|v|'|A||x| + |q|'|C||x|) / v'x of all nodes: free of all units, NaN without a proof.  The node with
        the smallest is where the network is weakest.
        """
        rate, gross = np.full(self.model.n_nodes, np.nan), 0.0
        if self.v is None or self.q is None:
            return frozen(rate)
        model = self.model
        vs, qs = (model.split(exactly(self, name), kind) for name, kind in (("v", 0), ("q", 2)))
        for g, index in enumerate(model.members):
            s = model.stacks[g]
            forms = on.decrease_forms(s, vs[g], qs[g], 0.0, model.discrete)
            with np.errstate(all="ignore"):
                value = np.einsum("jn,kn->jk", vs[g].values, s.X.rays)
                rate[index] = (-forms.values[:, 0] / value).min(axis=1, initial=np.inf)
                gross = max(gross, float((forms.magnitudes[:, 0] / value).max(initial=0.0)))
        if self.exact is not None:  # what is left of the margins after rounding means nothing
            rate = np.maximum(rate, 0.0)
        return frozen(rate / gross if gross > 0 else rate)

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The smallest of the node margins, computed; for REFUTED minus the smallest margin of the witness."""
        if self.witness is not None:
            return 0.0 - abs(min((c.margin for c in self._own_conditions), default=0.0))
        return float(np.fmin.reduce(self.node_margins, initial=1.0)) if self else 0.0

    def explain(self) -> str:
        model = self.model
        what = f"the network of {model.n_nodes} nodes ({model.totals[0]} states)"
        links = "the links"
        if model.origin is not None:
            what += ", with the links of nodes to themselves closed first as parts of these nodes,"
            links = "the links between different nodes"
        if self:
            weakest = int(np.argmin(self.node_margins))
            unit = "step" if model.discrete else "unit of time"
            without = " whose sources have no feedthrough" if model.has_feedthrough else ""
            delays = f"It stays stable under any constant delays of {links}{without}"
            return (
                f"Proved: {what} is positive and exponentially stable with decay rate at least {self._rate_text} per "
                f"{unit}. "
                f"By scale-free margins, computed and not proven, the weakest is {model.name_of(weakest)} with about "
                f"{self.node_margins[weakest]:.3g}. {delays}, "
                f"and when {links} are weakened, lost or switched over time, as long as what is left and what is "
                "taken away "
                "both map Y into U. Nothing is said of a weakened feedback inside a node."
            )
        if self.status is Status.REFUTED:
            return f"Not certified: {what} fails, {self._reason()}. {REMEDY[type(self.witness)]}"
        if unfinished(self):
            return unfinished(self)
        return (
            f"Undecided: for {what} neither a certificate nor a witness was found; it may be too close to the "
            "edge of stability. "
            "Change the gains or links a little."
        )

    @property
    def _rate_text(self) -> str:
        """The decay rate that texts name: the one that was asked for, or `decay_rate`."""
        return floored(self.decay_rate, 4) if self.required_rate is None else self._asked(floored)

    def _reason(self) -> str:
        """What the witness shows, in words that its conditions prove."""
        model, w = self.model, self.witness
        if isinstance(w, NetworkInstability) and model.discrete:
            return f"{w}".replace("growth rate", "growth factor per step")
        if isinstance(w, NodeViolation):
            s = model.stacks[model.locate(w.node)[0]]
            if all(isinstance(cone, Orthant) for cone in (s.X, s.U, s.Y)):
                return f"{w}; its cones are nonnegative orthants, as those of nodes given without cones"
        return f"{w}"


def decreasing(
    model: NetworkModel,
    v: Matrix,
    r: Matrix,
    q: Matrix,
    rate: float,
    loop: LoopWeights,
    *,
    sigma: NDArray[np.float64] | None = None,
    required: Fraction | None = None,
) -> list[Condition]:
    """(II), (III') and contracting algebraic loops, for positive nodes and (I); r, and t of the loops, with the halo.

    A network is proven if all its shards are, for no inequality takes its terms from two of them.
    """
    out = dissipation(model, v, r, q, rate, discrete=model.discrete, required=required)
    out.append(on.balance(model, q, r, sigma))
    return out if loop is None else [*out, *on.loop_gain(model, *loop)]


def dissipation(
    model: NetworkModel,
    v: Matrix,
    r: Matrix,
    q: Matrix,
    rate: float,
    *,
    discrete: bool,
    required: Fraction | None = None,
) -> list[Condition]:
    """(II): storage, decrease (also at a rate that was asked for) and supply of every node."""
    out = []
    parts = zip(*(model.split(part, kind) for kind, part in enumerate((v, r, q))), strict=True)
    for g, (v_g, r_g, q_g) in enumerate(parts):
        out.append(on.storage(model, g, v_g))
        out.append(on.decrease(model, g, v_g, q_g, rate, discrete=discrete))
        if required is not None:
            out.append(on.decrease(model, g, v_g, q_g, required, discrete=discrete, name=on.REQUIRED))
        if model.stacks[g].sizes[1]:
            out.append(on.supply(model, g, v_g, q_g, r_g))
    return out


def no_weights(model: NetworkModel, q: Matrix, r: Matrix, y: Matrix) -> list[Condition]:
    """y in Y with q_j'y_j + r_j'(W y)_j >= 0 for every node j, and > 0 for one: then no sigma > 0 exists."""
    forms = on.supply_by_node(model, q, r, y)
    largest = np.zeros(forms.values.shape, dtype=bool)
    largest[int(np.argmax(forms.values[:, 0])), 0] = True
    somewhere = Condition("q'y + r'W y > 0 somewhere", forms, ">", largest)
    return [*on.emitted(model, y), Condition("q'y + r'W y >= 0", forms, ">="), somewhere]


def rates_of(certificate: Any) -> dict[str, Any]:
    """The rates that a certificate claims, as fields of another."""
    return {name: getattr(certificate, name) for name in ("decay_rate", "required_rate")}


def node_vectors(certificate: Any) -> list[Matrix]:
    """v, r and q of a certificate, of all nodes after each other.

    Raises
    ------
    DataError
        One is missing, or of another size than the network.
    """
    out, totals = [exactly(certificate, name) for name in "vrq"], certificate.model.totals
    for part, total in zip(out, totals, strict=True):
        if part.shape != (total,):
            raise DataError(f"a per-node vector has {part.shape[0]} entries; {total} are needed.")
    return out
