"""Theorem 4 for every choice at once: nodes known within sets, as a certificate, or why there is none.

Let node j be some mixture of its vertices (A, B, C, D)_j^s at every time.  If all vertices are positive, W maps Y into
U (I), algebraic loops contract by common p, t, and v_j in int X_j*, r_j, q_j satisfy at every vertex

    (v'A - q'C) x < 0,    (v'B - r' - q'D) u <= 0,    and once    q'y + r'W y <= 0,

then sum v_j'x_j decreases whatever the nodes are, for these inequalities are linear in (A, B, C, D)_j: the network is
positive and exponentially stable for every choice, also if it changes at any time.

No common v, r, q exist if some x^s in X, u^s in U and y have, with x = sum x^s not 0,

    sum (A^s x^s + B^s u^s) in X,    sum (C^s x^s + D^s u^s) - y in Y,    W y - sum u^s in U    (discrete: A - I):

q = -W'r without loss, since (C x, D u) is in Y; then r'(I - W D) >= v'B >= 0 on U, so that r is in U* for loops that
contract, and 0 <= v'sum (A^s x^s + B^s u^s) < q'sum (C^s x^s + D^s u^s) + r'sum u^s <= -r'W y + r'W y = 0.

With x = 0 and y in Y, y not 0, they exclude common p, t: p'y <= p'sum D^s u^s <= t'sum u^s <= t'W y < p'y.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...cards import floored
from ...errors import DataError
from ...exact.condition import Condition, all_hold
from ...exact.distinct import distinct
from ...exact.intake import whole_number
from ...exact.matrix import Matrix
from ...exact.rows import frozen
from ...exact.signs import BilinearForms
from ...proof.certificate import Status, exactly
from ...proof.in_time import unfinished
from ...proof.weights import ProofOmittedError
from .. import conditions as on
from .. import files
from ..certificate import ClaimOnNetwork, NetworkCertificate, dissipation, node_vectors
from ..model import BLOCKS, NetworkModel
from ..witnesses import CouplingViolation, NetworkInstability, NodeViolation, refute, restated
from .costly import Costliest, Costly, Ends, largest_losses, margins_at_vertices, smallest_margins
from .members import Vertices, member, transposed
from .signed import turned_signs
from .witnesses import FailingEnd, FailingMember, NoCommonStorage, NoCommonVectors


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class UncertainNetworkCertificate(ClaimOnNetwork):
    """Proof that a network is positive and exponentially stable for every choice of its nodes, or why not.

    Attributes
    ----------
    model : NetworkModel
        The network of the first vertices.
    vertices : tuple of NetworkModel
        Those of the other vertices, with the same cones and links.
    lower : NetworkModel or None
        With ranges: the network of their lower ends; the upper ends are those of `model`, and of all vertices.
    v, r, q, loop_weights, exact
        As in `NetworkCertificate`, with sigma = 1: one for all vertices.
    decay_rate : float
        Proven for every choice, also one that changes: V(x(t)) <= exp(-decay_rate t) V(x(0)); in discrete time
        V(x[k]) <= (1 - decay_rate)^k V(x[0]).
    witness : FailingMember, FailingEnd, CouplingViolation or NoCommonVectors
        For REFUTED.  `NoCommonVectors` says nothing of the network itself.  A `NoCommonStorage` alone leaves it
        UNDECIDED: there may be a proof by e.
    """

    claim: ClassVar[str] = "uncertain network"

    vertices: tuple[NetworkModel, ...] = ()
    lower: NetworkModel | None = None
    decay_rate: float = 0.0

    @property
    def models(self) -> Vertices:
        """The networks of all vertices."""
        return (self.model, *self.vertices)

    def conditions(self) -> Sequence[Condition]:
        """Theorem 4 at every vertex, with (I) and (III') once."""
        if not 0 <= self.decay_rate < np.inf:
            raise DataError("decay_rate must not be negative.")
        v, r, q = node_vectors(self)
        out = [*self._positive(), *self._contracting(), on.balance(self.model, q, r, None)]
        for s, model in self._distinct():
            parts = dissipation(model, v, r, q, self.decay_rate, discrete=model.discrete)
            out += [_at(c, s) for c in parts if s == 0 or not c.name.startswith(on.STORAGE)]
        return [*out, *self._within(self.lower, q)] if self.lower is not None else out

    def _within(self, low: NetworkModel, q: Matrix) -> Iterator[Condition]:
        """Positive at the lower ends, which are below the upper ones, and -q in Y*: then the upper ends are worst."""
        stacks = range(len(low.stacks))
        for condition in [*on.coupling(low), *(c for g in stacks for c in on.positivity(low, g))]:
            yield replace(condition, name=f"{condition.name} [lower]")
        yield from on.coupling_within(low, self.model)
        for g, (s, q_g) in enumerate(zip(low.stacks, low.split(q, 2), strict=True)):
            yield from on.nodes_within(low, self.model, g)
            yield Condition(on.titled("-q'y >= 0", low, g), on.stacked(on.beside(-q_g), None, s.rays[2]), ">=")

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.v is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        if isinstance(self.witness, NoCommonStorage):
            return Status.UNDECIDED, self._excluded(self.witness) or ()
        return super()._evaluate()

    @property
    def e(self) -> Any:
        """None: the proof is by v.  See `BoundedNetworkCertificate`."""
        return None

    def _distinct(self) -> Iterator[tuple[int, NetworkModel]]:
        """The vertices, each with its number."""
        return enumerate(self.models)

    def _positive(self) -> list[Condition]:
        """All vertices positive, and (I)."""
        out = on.coupling(self.model)
        for s, model in self._distinct():
            out += [_at(c, s) for g in range(len(model.stacks)) for c in on.positivity(model, g)]
        return out

    def _contracting(self) -> list[Condition]:
        """The algebraic loops of all choices contract."""
        if not any(model.has_feedthrough for model in self.models):
            return []
        if self.loop is None:
            raise DataError("loop_weights are missing although some D is not zero.")
        p, t = self.loop
        out = list(on.loop_gain(self.model, p, t))
        for s, model in self._distinct():
            parts = enumerate(zip(model.split(p, 2), model.split(t, 1), strict=True))
            out += [_at(on.loop_direct(model, g, *part), s) for g, part in parts if s]
        return out

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        if isinstance(w, FailingMember):
            return self._failing(w)
        if isinstance(w, CouplingViolation):
            return refute(self.model, w, None)
        if isinstance(w, FailingEnd):
            known = self.lower is not None and isinstance(w.witness, NodeViolation | CouplingViolation)
            return refute(self.lower, w.witness, None) if known and self.lower is not None else None
        if not isinstance(w, NoCommonVectors):
            return None
        first = self._excluded(w.storage)
        turned = transposed(self.models)
        second = UncertainNetworkCertificate(model=turned[0], vertices=turned[1:])._excluded(w.bound)
        if first is None or second is None:
            return None
        return [*first, *(replace(c, name=f"{c.name} [transposed]") for c in second)]

    def _excluded(self, w: NoCommonStorage) -> Sequence[Condition] | None:
        """The inequalities that exclude common v, r, q."""
        if not (np.any(w.x) or np.any(w.y)):
            return None
        return [*self._positive(), *([] if np.any(w.x) else on.emitted(self.model, exactly(w, "y"))), *self._mixed(w)]

    def _failing(self, w: FailingMember) -> Sequence[Condition] | None:
        chosen, count = np.asarray(w.choice), len(self.models)
        whole = chosen.shape == (self.model.n_nodes,) and np.isin(chosen, np.arange(count)).all()
        failing = self._member(w) if whole else None
        return None if failing is None else refute(failing, w.witness, self.loop)

    def _member(self, w: FailingMember) -> NetworkModel | None:
        """The member that a witness is about; None if there is none."""
        chosen = member(self.models, w.vertices)
        if w.signs is None:
            return chosen
        signs = np.asarray(w.signs)
        valid = self.lower is not None and signs.shape == w.choice.shape and (np.abs(signs) == 1).all()
        return turned_signs(chosen, self.lower, signs) if valid and self.lower is not None else None

    def _mixed(self, w: NoCommonStorage) -> Iterator[Condition]:
        """The motion of a mixture; see the head of this module."""
        model, y = self.model, exactly(w, "y")
        xs, us = (_parts(exactly(w, name), len(self.models)) for name in "xu")
        if any(part.shape != (n,) for part, n in zip((xs[0], us[0], y), model.totals, strict=True)):
            raise DataError("the vectors of the mixture have not the entries of all nodes.")
        split = [[model.split(part, kind) for part in whole] for kind, whole in ((0, xs), (1, us), (2, [y]))]
        for g, s in enumerate(model.stacks):
            x_g, u_g, (y_g,) = ([part[g] for part in parts] for parts in split)
            for k, (x, u) in enumerate(zip(x_g, u_g, strict=True)):
                yield _at(Condition(on.titled("h'x >= 0", model, g), _seen(s.X, x), ">="), k)
                yield _at(Condition(on.titled("h'u >= 0", model, g), _seen(s.U, u), ">="), k)
            A, B, C, D = ([getattr(m.stacks[g], name) for m in self.models] for name in BLOCKS)
            eye = [Matrix(-np.eye(s.sizes[0])[None])] * (len(x_g) * model.discrete)
            row = on.beside(*x_g, *u_g, *(x_g if model.discrete else ()))
            forms = on.stacked(on.facets(s.X), Matrix.join([*A, *B, *eye], -1), row)
            yield Condition(on.titled("h'sum (A x + B u) >= 0", model, g), forms, ">=")
            if s.sizes[2]:
                middle = Matrix.join([*C, *D, Matrix(-np.eye(s.sizes[2])[None])], -1)
                forms = on.stacked(on.facets(s.Y), middle, on.beside(*x_g, *u_g, y_g))
                yield Condition(on.titled("h'(sum (C x + D u) - y) >= 0", model, g), forms, ">=")
        back = [-Matrix.identity(model.totals[1], sparse=True)] * len(us)
        middle = Matrix.join([model.coupling, *back], -1)
        yield Condition("h'(W y - sum u) >= 0", BilinearForms(on.after(y, *us), middle.T, on.input_facets(model)), ">=")

    @property
    def vertex_margins(self) -> NDArray[np.float64]:
        """How fast each node's storage decays at each vertex, relative to the fastest rate of all; shape (S, N).

        Computed in floating point as `NetworkCertificate.node_margins`; NaN without a proof.
        """
        return self._margins[0]

    @cached_property
    def _margins(self) -> tuple[NDArray[np.float64], float]:
        """`vertex_margins`, and the fastest rate."""
        if not self:
            return frozen(np.full((len(self.models), self.model.n_nodes), np.nan)), 0.0
        margins, fastest = margins_at_vertices(self.models, exactly(self, "v"), exactly(self, "q"))
        return frozen(margins), fastest

    def costliest(self, k: int = 3) -> Costliest:
        """The vertices with the smallest margins, and the ranges whose growth costs most of the margin.

        Parameters
        ----------
        k : int
            How many of each.

        Returns
        -------
        Costliest
            With `vertices` and `ranges`, tuples of (name, value); empty without a proof.  Computed, not proven.

        Examples
        --------
        >>> import control_kpos as kp
        >>> lag = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0, name="tank", inputs=["flow"], outputs=["level"])
        >>> W = [[0, kp.interval(0.1, 0.9)], [kp.interval(0.4, 0.5), 0]]
        >>> found = kp.feedback_interconnect([[lag, 2 * lag], lag], W).certificate.costliest()
        >>> found.vertices[0].name, found.ranges[0].name
        ('node 1 ("tank") at its vertex 0', 'the entry of W from level of node 1 ("tank") to flow of node 0 ("tank")')
        """
        k = whole_number(k, "k", least=1)
        if not self:
            return Costliest((), ())
        return Costliest(smallest_margins(self.model, self.vertex_margins, self._place, k), self._losses(k))

    def _losses(self, k: int) -> tuple[Costly, ...]:
        """The ranges whose growth costs most."""
        if self.lower is None:
            return ()
        v, r, q = (part.values for part in node_vectors(self))
        high, turned = getattr(self, "upper", None) or self.model, self.e is not None
        return largest_losses(Ends(self.model, self.lower, high, v, r, q, turned), self._margins[1], k)

    @property
    def node_margins(self) -> NDArray[np.float64]:
        """The smallest of `vertex_margins` of every node; shape (N,)."""
        return frozen(self.vertex_margins.min(axis=0))

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The smallest of the node margins, computed; for REFUTED minus the smallest margin of the witness."""
        if self.witness is not None:
            return 0.0 - abs(min((c.margin for c in self._own_conditions), default=0.0))
        return float(np.fmin.reduce(self.node_margins, initial=1.0)) if self else 0.0

    # -- files

    def contents(self) -> dict[str, Any]:
        """The network of the first vertices as one large system, the matrices of the others, and the fields."""
        own = {key: value for key, value in self.data().items() if key != "model"}
        if not isinstance(self._refuted_part, NetworkInstability | None):
            own["loop_weights"] = None
        others = tuple(tuple(files.describe(m)[name] for name in BLOCKS) for m in self.vertices)
        if self.lower is not None:
            own["lower"] = tuple(files.describe(self.lower)[name] for name in (*BLOCKS, "W"))
        return {**files.describe(self.model), **own, "vertices": others}

    @property
    def _refuted_part(self) -> Any:
        """What breaks a member, or a link."""
        w = self.witness
        return (
            w.witness if isinstance(w, FailingMember | FailingEnd) else w if isinstance(w, CouplingViolation) else None
        )

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> Any:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        if "own_links_closed" in contents:
            raise DataError("links of nodes with vertices to themselves are not closed.")
        model = files.rebuild(contents)
        own = {f.name: contents[f.name] for f in fields(cls) if f.name in contents}
        if any(len(vertex) != len(BLOCKS) for vertex in contents["vertices"]):
            raise DataError("a vertex has A, B, C and D.")
        others = tuple(
            files.rebuild({**contents, **dict(zip(BLOCKS, vertex, strict=True))}) for vertex in contents["vertices"]
        )
        ends = {name: _end(contents, name) for name in ("lower", "upper") if name in {f.name for f in fields(cls)}}
        own |= {"model": model, "vertices": others, **ends}
        return cls.settle(**{**own, "witness": cls(**own).restated()})

    def restated(self) -> Any:
        """The witness, with what files leave out."""
        w = self.witness
        if isinstance(w, FailingMember):
            chosen = self._member(w)
            if chosen is None:
                raise DataError("signs are for networks with ranges, 1 or -1 for every node.")
            return replace(w, witness=restated(NetworkCertificate(model=chosen, witness=w.witness)))
        if isinstance(w, FailingEnd) and self.lower is not None:
            return FailingEnd(restated(NetworkCertificate(model=self.lower, witness=w.witness)))
        return restated(NetworkCertificate(model=self.model, witness=w)) if isinstance(w, CouplingViolation) else w

    def evidence(self) -> dict[str, Any]:
        """Weights for positivity of every vertex and the coupling, and those of a witness."""
        w = self.witness
        if isinstance(w, FailingMember):
            return files.evidence(self._member(w) or self.model, w.witness)
        if isinstance(w, CouplingViolation):
            return files.evidence(self.model, w)
        if isinstance(w, FailingEnd) and self.lower is not None:
            return files.evidence(self.lower, w.witness)
        each = [files.evidence(model, None) for model in self.models]
        out = {name: [part[name] for part in each] for name in each[0] if name != "M"}
        plain = all(files.product_cone(self.model, kind).is_simplicial for kind in range(3))
        if not plain and (w is not None or self.lower is not None):
            raise ProofOmittedError("mixtures and ranges on cones that are not simplicial are for control_kpos alone")
        return {**out, "M": each[0].get("M")}

    # -- words

    def explain(self) -> str:
        model, w = self.model, self.witness
        what = f"the network of {model.n_nodes} nodes ({model.totals[0]} states) {self._known}"
        if self:
            unit = "step" if model.discrete else "unit of time"
            without = " whose sources have no feedthrough" if any(m.has_feedthrough for m in self.models) else ""
            return (
                f"Proved: {what} is positive and exponentially stable with decay rate at least "
                f"{floored(self.decay_rate, 4)} per {unit} for every choice: {self._choices}, and all may change at "
                f"any time, independently of each other. {self._costly} The network stays stable under any constant "
                f"delays of the links{without}, and when links are weakened, lost or switched over time, as long as "
                "what is left and what is taken away both map Y into U."
            )
        if isinstance(w, NoCommonStorage) and all_hold(self._own_conditions):
            return (
                f"Undecided: for {what} {w}. Vectors e, u, y that bound the network at all vertices were neither found "
                "nor excluded. Change the gains or links a little."
            )
        if not self.refuted_by:
            if unfinished(self):
                return unfinished(self)
            return (
                f"Undecided: for {what} neither common vectors v, r, q of Theorem 4, or e, u, y, nor a witness "
                "against them was found; it may be too close to the edge of stability. Change the gains or links a "
                "little."
            )
        if isinstance(w, NoCommonVectors):
            return (
                f"Not certified: for {what} {w}. This is about one set of vectors for all vertices: it does not "
                "show that any choice of vertices is unstable. Make the vertices less different, or split them."
            )
        if not isinstance(w, FailingMember):
            return f"Not certified: {what} fails, {w}. {_CONES}"
        return f"Not certified: {what} fails, {self._reason(w)}"

    @property
    def _costly(self) -> str:
        """The node and vertex with the smallest margin."""
        (vertex, *_), ranges = self.costliest(1)
        text = (
            f"By scale-free margins, computed and not proven, the most costly is {vertex.name}, with about "
            f"{vertex.value:.3g}"
        )
        if ranges:
            text += f"; of the ranges {ranges[0].name}, growing by half its width, about {ranges[0].value:.3g} of that"
        return f"{text}."

    @property
    def _known(self) -> str:
        """What the nodes and links are known by."""
        vertices = f"with up to {len(self.models)} vertices" if self.vertices else ""
        return " ".join(part for part in (vertices, "with ranges" if self.lower is not None else "") if part)

    @property
    def _choices(self) -> str:
        nodes = "every node is any mixture of its vertices" if self.vertices else ""
        ranges = "what has a range is anywhere in it" if self.lower is not None else ""
        return ", ".join(part for part in (nodes, ranges) if part)

    def _place(self, vertex: int) -> str:
        return f"its vertex {vertex}" if self.vertices else "the upper ends of its ranges"

    def _reason(self, w: FailingMember) -> str:
        inner = w.witness
        if isinstance(inner, NodeViolation):
            return f"at {self._place(int(w.vertices[inner.node]))} {inner}. {_CONES}"
        scope = "This choice is a member: the network itself is refuted."
        if isinstance(inner, NetworkInstability):
            alive = distinct(self.model.owners(0)[np.asarray(inner.x) != 0])
            j = int(alive[0])
            if len(alive) == 1 and not np.any(np.asarray(inner.u)[self.model.owners(1) == j]):
                return (
                    f"{self.model.name_of(j)} at {self._place(int(w.vertices[j]))} does not decay even without the "
                    f"others. {scope} Raise the local gain there."
                )
        text = f"{w}" if self.vertices or w.signs is not None else f"at the upper ends of the ranges, {inner}"
        text = text.replace("growth rate", "growth factor per step") if self.model.discrete else text
        return f"{text}. {scope} Weaken links, or raise the local gains at the nodes where x or y is largest."


_CONES = (
    "This is about these cones, and no sign of instability. Choose other cones, or a local feedback that makes the "
    "node positive."
)


def _end(contents: dict[str, Any], name: str) -> NetworkModel | None:
    """The network at one end of its ranges, from a file."""
    end = contents.get(name)
    if end is not None and len(end) != len(BLOCKS) + 1:
        raise DataError(f"the {name} ends have A, B, C, D and W.")
    return None if end is None else files.rebuild({**contents, **dict(zip((*BLOCKS, "W"), end, strict=True))})


def _at(condition: Condition, vertex: int) -> Condition:
    """The condition, with the vertex that it is about."""
    return replace(condition, name=f"{condition.name} [vertex {vertex}]")


def _parts(vector: Matrix, count: int) -> list[Matrix]:
    size, rest = divmod(vector.shape[0], count)
    if rest:
        raise DataError("the vertices have vectors of one length.")
    return [vector[np.arange(s * size, (s + 1) * size)] for s in range(count)]


def _seen(cone: Any, x: Matrix) -> BilinearForms:
    return on.stacked(on.facets(cone), None, on.beside(x))
