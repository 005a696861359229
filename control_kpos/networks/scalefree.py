"""Certificates for any number of nodes on any graph with bounded weights.

Let a node be dissipative with storage v'x and supply r u + q y, r > 0, and let q <= -w r.  Then copies of
it on any graph whose weights w_jk >= 0 satisfy sum_j w_jk <= w for every node k satisfy (III') with
sigma = 1, whatever their number.  A single node with a self-loop of weight w is such a network, so the
bound is sharp: there is such a v if and only if A + w B C is stable.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ..arguments import real_number
from ..arrays import ExactMatrix, exact_matrix, vector
from ..certificates.exact import BilinearForms
from ..certificates.result import Certificate, Condition, Status
from ..errors import ConeMismatchError, DataError, ShapeError
from ..statespace import ConeStateSpace
from .blocks import Floats, Index
from .certificate import NetworkCertificate, flat, per_node
from .certify import certify
from .coupling import is_graph, read_coupling
from .model import NetworkModel, NodeStack, gather
from .network import ConeNetwork
from .solvers import PortSystem
from .supply import certify_rates


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OutWeightCertificate(Certificate):
    """Proof that every network of these node types with out-weights at most `weight` is stable.

    Attributes
    ----------
    local : NetworkCertificate
        Of one node of each type with a self-loop of this weight.
    weight : float
        Bound on sum_j w_jk, the weights of all links that leave a node.
    witness : object or None
        What breaks the self-loops, themselves networks with these out-weights.
    """

    claim: ClassVar[str] = "out-weight"

    local: NetworkCertificate
    weight: float

    def parts(self) -> Sequence[Certificate]:
        return (self.local,)

    def conditions(self) -> Sequence[Condition]:
        loops = self.local.model.coupling
        if not np.array_equal(np.asarray(loops.values.todense()), self.weight * np.eye(self.local.model.n_nodes)):
            raise DataError("the local certificate is not about self-loops of this weight.")
        r = flat(self.local.r, self.local.model, 1) if self.local.r is not None else np.zeros(0)
        if np.ptp(r) or not np.all(r > 0):
            raise DataError("the node types must have one r > 0 in common.")
        return ()

    def refutation(self) -> Sequence[Condition] | None:
        return self.local._own_conditions if self.local.status is Status.REFUTED else None

    @property
    def decay_rate(self) -> float:
        """Proven for every such network, per unit of time."""
        return self.local.decay_rate

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The margin of the local certificate."""
        return self.local.margin

    def explain(self) -> str:
        kinds = self.local.model.n_nodes
        what = "copies of this node" if kinds == 1 else f"nodes of these {kinds} types"
        if self:
            return (
                f"Proved: any number of {what}, on any graph with nonnegative weights whose sum over the links "
                "that leave a "
                f"node is at most {self.weight:.6g}, is positive and stable with decay rate at least "
                f"{self.decay_rate:.4g}."
            )
        return (
            f"Not certified: already a node with a self-loop of weight {self.weight:.6g} fails. {self.local.explain()} "
            "Ask for a smaller weight, or raise the local gain."
        )

    def covers(self, coupling: Any) -> bool:
        """True if a coupling of such nodes has nonnegative weights and out-weights at most `weight`, exactly.

        Parameters
        ----------
        coupling : array_like or sparse matrix, shape (N, N)
        """
        exact = exact_matrix(coupling, "coupling")
        if not exact.is_double:
            raise DataError("coupling holds fractions; give doubles, which are compared exactly.")
        W = sp.csr_array(exact.values)
        if not self or W.shape[0] != W.shape[1] or (W.data < 0).any():
            return False
        ones = ExactMatrix(np.ones((1, W.shape[0] + 1)))
        table = sp.csr_array(sp.vstack([W, sp.csr_array(np.full((1, W.shape[1]), -self.weight))], format="csr"))
        forms = BilinearForms(ones, ExactMatrix(table), ExactMatrix(sp.eye_array(W.shape[1], format="csr")))
        return Condition("sum of out-weights <= weight", forms, "<=").verdict() is True

    def interconnect(self, coupling: Any, types: Sequence[int] | None = None, name: str | None = None) -> ConeNetwork:
        """The network of such nodes under a coupling, certified without a solve.

        Parameters
        ----------
        coupling : array_like, sparse matrix or networkx graph, shape (N, N)
        types : sequence of int, optional
            Type of every node; the first type if not given.
        name : str, optional

        Returns
        -------
        ConeNetwork
            Its certificate holds copies of the local v, r, q, proven for this coupling; if they do not
            cover it, it is found anew when first asked for.
        """
        local = self.local
        kinds = np.zeros(_size(coupling), dtype=np.intp) if types is None else _kinds(types)
        if kinds.size and not (kinds.min() >= 0 and kinds.max() < local.model.n_nodes):
            raise ShapeError(
                f"types must name one of the {local.model.n_nodes} node types, 0 to {local.model.n_nodes - 1}."
            )
        stacks, members = [], []
        for s, index in zip(local.model.stacks, local.model.members, strict=True):
            place = np.full(local.model.n_nodes, -1)
            place[index] = np.arange(len(index))
            chosen = np.flatnonzero(place[kinds] >= 0)
            if chosen.size:
                plain = NodeStack(s.A, s.B, s.C, s.D, s.X, s.U, s.Y, s.dt)
                stacks.append(plain.take(place[kinds[chosen]]))
                members.append(chosen)
        empty = NetworkModel(tuple(stacks), tuple(members), ExactMatrix(sp.csr_array((0, 0))), local.model.dt)
        model = empty.with_coupling(read_coupling(coupling, empty))
        return ConeNetwork(model, name=name, certificate=self._carry(model, kinds))

    def _carry(self, model: NetworkModel, kinds: Any) -> NetworkCertificate | None:
        local = self.local
        if not self or local.v is None or local.r is None or local.q is None or local.exact is not None:
            return None

        def spread(value: Any, kind: int) -> Floats:
            own = np.split(flat(value, local.model, kind), local.model.offsets[kind][1:-1])
            return (
                np.concatenate([own[t] for t in kinds])
                if len({len(o) for o in own}) > 1
                else np.stack(own)[kinds].ravel()
            )

        loop = None
        if model.has_feedthrough and local.loop_weights is not None:
            if isinstance(local.loop_weights[0], tuple):
                return None
            loop = spread(local.loop_weights[0], 2), spread(local.loop_weights[1], 1)
        draft = NetworkCertificate.settle(
            model=model,
            v=per_node(spread(local.v, 0), model, 0),
            r=per_node(spread(local.r, 1), model, 1),
            q=per_node(spread(local.q, 2), model, 2),
            sigma=np.ones(model.n_nodes),
            decay_rate=local.decay_rate,
            loop_weights=loop,
        )
        return draft if draft.status is Status.PROVED else None


def _size(coupling: Any) -> int:
    if is_graph(coupling):
        return len(coupling.nodes)
    return exact_matrix(coupling, "coupling").shape[0]


def _kinds(types: Any) -> Index:
    kinds = np.asarray(vector(types, "types"))
    if not ((kinds == np.round(kinds)) & (np.abs(kinds) < 2**31)).all():
        raise DataError("types holds numbers that are not whole; give the number of the type of every node.")
    return kinds.astype(np.intp)


def scale_free_certificate(
    nodes: ConeStateSpace | NodeStack | Iterable[ConeStateSpace], weight: float | None = None
) -> OutWeightCertificate:
    """Certify every network of copies of some node types, of any size, by the sum of the weights that leave a node.

    Parameters
    ----------
    nodes : ConeStateSpace, or sequence of them, or NodeStack
        Node types with one input and one output each, on the nonnegative axis.
    weight : float, optional
        Bound on the out-weights.  Default: just below the largest that works, 1 / max G_t(0) (continuous time) or
        1 / max G_t(1) (discrete time).

    Returns
    -------
    OutWeightCertificate
        PROVED, or REFUTED with what breaks a node with a self-loop of this weight.

    Raises
    ------
    ConeMismatchError
        Nodes with several inputs or outputs.
    DataError
        A weight that is not a nonnegative number.

    Notes
    -----
    Costs one small solve per type, whatever the networks.

    Examples
    --------
    >>> import control_kpos as kp
    >>> node = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
    >>> certificate = kp.scale_free_certificate(node, weight=21)
    >>> certificate.status.name, certificate.covers([[0, 20], [21, 0]]), certificate.covers([[2, 20], [20, 0]])
    ('PROVED', True, False)
    """
    stacks, members, dt = gather(nodes, "nodes")
    for s in stacks:
        if s.sizes[1:] != (1, 1) or not (s.U.rays[0, 0] > 0 and s.Y.rays[0, 0] > 0):
            raise ConeMismatchError(
                f"a node has {s.sizes[1]} inputs and {s.sizes[2]} outputs; scale-free certificates are for nodes "
                "with one "
                "nonnegative input and one nonnegative output."
            )
    count = sum(len(s) for s in stacks)
    bare = NetworkModel(stacks, members, ExactMatrix(sp.csr_array((count, count))), 0 if dt is None else dt)
    if weight is None:
        gains = np.concatenate([g.ravel() for g in PortSystem(bare, 1.0 if bare.discrete else 0.0).loop.G])
        top = float(gains.max())
        weight = (1 - 1e-9) / top if np.isfinite(top) and top > 0 else 1.0
    weight = real_number(weight, "weight", nonnegative=True)
    model = bare.with_coupling(ExactMatrix(sp.csr_array(weight * sp.eye_array(count))))
    if count == 1 and weight > 0:
        local = certify(model)
    else:
        local = certify_rates(model, np.full(count, -weight), np.ones(count))
        if not local and weight > 0:
            whole = certify(model)
            local = whole if whole.status is Status.REFUTED else local
    return OutWeightCertificate.settle(local=local, weight=weight, witness=local.witness)
