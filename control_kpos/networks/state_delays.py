"""Delays in the states of the nodes of a network: x_j' = A_j x_j + B_j u_j + A_dj x_j(t - h_j), as links of a network.

A delayed state is an output that comes back to its node: with B' = [B, A_d], C' = [C; I], U' = U x X, Y' = Y x X and
W' = diag(W, I) the network is one with delays in the links from x_j to x_j, and nothing else is new.  Theorem 4 holds
for it if and only if S = A_cl + diag(A_dj) is Hurwitz, A_cl being the closed loop without the delayed terms, and every
A_dj maps X_j into X_j: that is what `families.delay_certificate` asks for, so that the network is exponentially stable
for all bounded delays h_j(t), different ones and ones that change in time; and if it has a direction of growth, no
delays at all make it stable.  No matrices are added, so that nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ..cones import PolyhedralCone, product
from ..errors import DataError, ShapeError
from ..exact.condition import Condition
from ..exact.intake import exact_matrix, items, require_shape
from ..exact.matrix import Matrix
from ..proof.certificate import Certificate, Status
from ..proof.in_time import in_time, unfinished
from .certificate import NetworkCertificate
from .certify import certify_as_given
from .coupling import entries_of, from_entries
from .model import NetworkModel
from .network import ConeNetwork
from .nodes import NodeStack
from .witnesses import CouplingViolation, NodeNotDissipative, NodeViolation, NoWeights


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DelayedNetworkCertificate(Certificate):
    """Proof that a network with delayed states is positive and exponentially stable for any delays, or why it is not.

    Attributes
    ----------
    network : NetworkCertificate
        Of the network in which delayed states are links of nodes to themselves: the last n inputs and outputs of a
        node with n states are its delayed states.
    witness : object or None
        What breaks that network.
    """

    claim: ClassVar[str] = "delayed network"

    network: NetworkCertificate

    @property
    def v(self) -> Any:
        """Of every node: sum v_j'x_j falls under the sum of all matrices; None without a proof."""
        return self.network.v

    @property
    def decay_rate(self) -> float:
        """NaN: the rate depends on the delays, and none is claimed."""
        return float("nan")

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The margin of `network`."""
        return self.network.margin

    def parts(self) -> Sequence[Certificate]:
        """The certificate of the network with links."""
        return (self.network,)

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        _require_delays(self.network.model)
        return super()._evaluate()

    def conditions(self) -> Sequence[Condition]:
        """Those of the network."""
        return self.network._own_conditions

    def refutation(self) -> Sequence[Condition] | None:
        """Those of its witness."""
        w = self.network.witness
        if w is not self.witness or isinstance(w, NodeNotDissipative | NoWeights):
            return None
        return self.network._own_conditions if self.network.status is Status.REFUTED else None

    def contents(self) -> dict[str, Any]:
        """The network."""
        return {"network": self.network}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> DelayedNetworkCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By field.
        """
        network = contents["network"]
        return cls.settle(network=network, witness=network.witness)

    def evidence(self) -> dict[str, Any]:
        """Nothing: `network` comes with a proof of its own."""
        return {}

    def explain(self) -> str:
        """What is proven, and for which delays."""
        model = self.network.model
        what = f"the network of {model.n_nodes} nodes ({model.totals[0]} states) with delayed states"
        if self:
            return (
                f"Proved: {what} is positive, and exponentially stable for all bounded delays of these states, another "
                "one at every node, also if they change in time. The decay rate depends on the delays; none is claimed."
            )
        if self.status is not Status.REFUTED:
            if unfinished(self):
                return unfinished(self)
            return f"Undecided: for {what} neither a certificate nor a witness was found."
        if isinstance(self.witness, NodeViolation | CouplingViolation):
            return (
                f"Refuted: {what} is not positive part by part, {self.witness}. The last inputs of a node, as many as "
                "it has states, are its delayed states. Choose other cones."
            )
        return f"Refuted: no delays of these states make {what} stable: {self.network._reason()}."


def delayed_network(net: ConeNetwork, A_delay: Any, *, time_limit: float | None = None) -> DelayedNetworkCertificate:
    """Decide whether a network with a delay in the states of its nodes is positive and stable; see `kp.delayed`.

    Parameters
    ----------
    net : ConeNetwork
    A_delay : array_like, shape (N, n, n) or (n, n), or list of N matrices (n_j, n_j)
        A_dj of every node; (n, n) is the same for all.
    time_limit : float, optional
        Seconds.  Default: that of the network.

    Returns
    -------
    DelayedNetworkCertificate

    Raises
    ------
    DataError, ShapeError
        Blocks of another number or size than the nodes.
    """
    net.require_certain()
    model = with_delays(net.model, list(_blocks(A_delay, net.model)))

    def decided(network: NetworkCertificate) -> DelayedNetworkCertificate:
        return DelayedNetworkCertificate.settle(network=network, witness=network.witness)

    limit = net.time_limit if time_limit is None else time_limit
    nothing = NetworkCertificate.settle(model=model)
    return in_time(limit, lambda: decided(certify_as_given(model)), lambda: decided(nothing))


def with_delays(model: NetworkModel, blocks: Sequence[Matrix]) -> NetworkModel:
    """The network in which the delayed states, with one stack (N, n, n) of blocks per stack, are links.

    Parameters
    ----------
    model : NetworkModel
    blocks : sequence of Matrix
    """
    stacks = tuple(_with_ports(s, block) for s, block in zip(model.stacks, blocks, strict=True))
    bare = NetworkModel(stacks, model.members, Matrix(sp.csr_array((0, 0))), model.dt)
    shift = [bare.offsets[kind][model.owners(kind)] - model.offsets[kind][model.owners(kind)] for kind in (1, 2)]
    rows, columns, values = entries_of(model.coupling)
    own = [_delayed_places(bare, kind) for kind in (1, 2)]
    ones = Matrix(np.ones(len(own[0])))
    W = from_entries(
        [rows + shift[0][rows], own[0]],
        [columns + shift[1][columns], own[1]],
        [values, ones],
        (bare.totals[1], bare.totals[2]),
    )
    return bare.with_coupling(W)


def _with_ports(s: NodeStack, block: Matrix) -> NodeStack:
    count, (n, m, q) = len(s), s.sizes
    if not n:
        return s
    eye = Matrix(np.broadcast_to(np.eye(n), (count, n, n)))
    C = Matrix.join([s.C, eye], -2) if q else eye
    B = Matrix.join([s.B, block], -1) if m else block
    D = Matrix.join([s.D, Matrix.zeros(count, q, n)], -1)
    D = Matrix.join([D, Matrix.zeros(count, n, m + n)], -2)
    U, Y = (product([cone, s.X]) if cone.dim else s.X for cone in (s.U, s.Y))
    return replace(s, B=B, C=C, D=D, U=U, Y=Y, labels=())


def _delayed_places(model: NetworkModel, kind: int) -> Any:
    """Places of the delayed states among the inputs or outputs, in the order of the states."""
    ends, sizes = model.offsets[kind][1:], np.diff(model.offsets[0])
    starts = ends - sizes
    return np.repeat(starts - model.offsets[0][:-1], sizes) + np.arange(model.totals[0])


def _blocks(given: Any, model: NetworkModel) -> Iterator[Matrix]:
    """The delayed matrices of every stack, (N, n, n) each."""
    sizes = {s.sizes[0] for s in model.stacks}
    if len(sizes) == 1:
        n = next(iter(sizes))
        every = exact_matrix(given, "A_delay", ndim=3)
        if every.shape[1:] != (n, n) or every.shape[0] not in (1, model.n_nodes):
            raise ShapeError(
                f"A_delay has shape {every.shape}; it must be ({model.n_nodes}, {n}, {n}), one matrix for every node, "
                f"or ({n}, {n})."
            )
        for index in model.members:
            yield every[index if every.shape[0] > 1 else np.zeros(len(index), dtype=np.intp)]
        return
    listed = items(given, "A_delay")
    if len(listed) != model.n_nodes:
        raise ShapeError(
            f"A_delay has {len(listed)} entries; {model.n_nodes} nodes of different sizes need one matrix each."
        )
    for s, index in zip(model.stacks, model.members, strict=True):
        n = s.sizes[0]
        own = [
            require_shape(exact_matrix(listed[j], f"A_delay[{j}]"), f"A_delay[{j}]", (n, n), f"node {j} has {n} states")
            for j in index.tolist()
        ]
        yield Matrix.stack([M.dense() for M in own])


def _require_delays(model: NetworkModel) -> None:
    """Raise DataError unless the last inputs and outputs of every node are its states, and are linked as such."""
    for s in model.stacks:
        n, m, q = s.sizes
        C, D = _numbers(s.C), _numbers(s.D)
        states = C[:, q - n :], D[:, q - n :], D[:, :, m - n :]
        if min(m, q) < n or (states[0] != np.eye(n, dtype=int)).any() or any(part.any() for part in states[1:]):
            raise DataError("the last outputs of a node are not its states.")
        if not (_ends_with(s.U, s.X) and _ends_with(s.Y, s.X)):
            raise DataError("the cones of the delayed states are not those of the states.")
    inputs, outputs = (_delayed_places(model, kind) for kind in (1, 2))
    rows, columns, values = entries_of(model.coupling)
    own = np.isin(rows, inputs) | np.isin(columns, outputs)
    paired = np.argsort(rows[own], kind="stable")
    alike = np.array_equal(rows[own][paired], inputs) and np.array_equal(columns[own][paired], outputs)
    if not alike or (_numbers(values[own]) != 1).any():
        raise DataError("the delayed states are not linked to their nodes, and to nothing else.")


def _numbers(M: Matrix) -> Any:
    """The exact entries."""
    return M.values if M.is_double else M.fractions()


def _ends_with(cone: Any, X: Any) -> bool:
    """True if the cone is a product with X as its last factor."""
    head = cone.dim - X.dim
    if not X.dim:
        return True
    rays = cone.exact_rays.plain().fractions()
    last, first = (rays[:, head:] != 0).any(axis=1), (rays[:, :head] != 0).any(axis=1)
    return not (last & first).any() and PolyhedralCone(rays[last][:, head:]) == X
