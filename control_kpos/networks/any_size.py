"""Certificates for any number of nodes on any graph with bounded weights.

Let a node be dissipative with storage v'x and supply r'u + q'y, and q'y <= -w r'K y for a link K that maps Y
into U.  Then copies of it under any coupling with W Y inside U and

    sum_j r'W_jk y <= w r'K y        for every node k and generator y of Y

satisfy (III') with sigma = 1, whatever their number.  If D is not 0, the algebraic loops have to contract as well:
p'D u <= t'u and w t'K y < p'y for a t that is a multiple of r do it, as sum_j t'W_jk y <= w t'K y < p'y then.  With
one input, one output and K = 1 these are the graphs with sum_j w_jk <= w.  A single node with the self-loop w K is such
a network, so the bound is sharp: there is such a v if and only if A + w B K C is stable.  For copies of one node with
one input and one output it is the largest eigenvalue of W that counts, which has the sign of K and is at most w |K| in
size if sum_k |W_jk| <= w |K|: a bound on the links that enter a node does as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from ..cards import about, floored
from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.condition import Condition, all_hold
from ..exact.intake import exact_matrix, exact_number, require_shape, vector
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Status, exactly, states_the_same
from ..proof.weights import ProofOmittedError
from ..systems.statespace import ConeStateSpace
from ..theorems.stability import LyapunovCertificate
from . import conditions as on
from .blocks import Floats, Index, converging
from .certificate import NetworkCertificate, node_vectors, rates_of
from .certify import certify_as_given
from .coupling import read_coupling
from .given_rates import certify_rates_as_given
from .model import NetworkModel, gather
from .network import ConeNetwork
from .nodes import NodeStack
from .ranges import is_graph
from .spectrum.port_solves import PortSystem
from .witnesses import NodeNotDissipative, NoWeights


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OutWeightCertificate(Certificate):
    """Proof that every network of these node types with out-weights at most `weight` is stable.

    Attributes
    ----------
    local : NetworkCertificate
        Of one node of each type with a self-loop of this weight.
    weight : float, or Fraction where a double does not suffice
        Bound on sum_j w_jk, the weights of all links that leave a node; for one type with one input and one
        output, on those that enter it instead if these are smaller.
    link : ndarray, shape (m, q), or Matrix where doubles do not suffice
        A link of weight 1: the K in sum_j r'W_jk y <= weight r'K y.
    witness : object or None
        What breaks the self-loops, themselves networks with these out-weights.
    """

    claim: ClassVar[str] = "out-weight"

    local: NetworkCertificate
    weight: float | Fraction
    link: Floats | Matrix

    def parts(self) -> Sequence[Certificate]:
        return (self.local,)

    def contents(self) -> dict[str, Any]:
        """The fields but for the witness, which is that of `local`."""
        return {key: value for key, value in self.data().items() if key != "witness"}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> OutWeightCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By field.
        """
        if len(contents["link"].shape) != 2:
            raise DataError("link is a matrix.")
        witness = contents["local"].witness
        if contents.get("witness") is not None and not states_the_same(contents["witness"], witness):
            raise DataError("the witness is that of the self-loops.")
        return cls.settle(**{**contents, "witness": witness})

    def conditions(self) -> Sequence[Condition]:
        model = self.local.model
        if self.weight < 0:
            raise DataError("weight must not be negative.")
        r = exactly(self.local, "r").values
        if model.n_nodes > 1 and (np.ptp(r) or not np.all(r > 0)):
            raise DataError("the node types must have one r > 0 in common.")
        contracting = self._contracting()
        if self._proves_loops:
            return contracting
        if not np.array_equal(self._loops.dense().values, model.coupling.dense().values):
            raise DataError("the local certificate is not about self-loops of this weight.")
        # in files of version 0.1 the self-loops are rounded: their v, r, q have to do for the exact ones
        return [*contracting, *replace(self.local, model=model.with_coupling(self._loops)).conditions()]

    def _contracting(self) -> list[Condition]:
        """With feedthrough: t is a multiple of r, so that the loops of all these networks contract."""
        if self.local.loop is None:
            return []
        r, t = exactly(self.local, "r").fractions(), self.local.loop[1].fractions()
        ratio = next((b / a for a, b in zip(r, t, strict=True) if a), Fraction(0))
        apart = Matrix.from_fractions(np.array([*(t - ratio * r), min(ratio, Fraction(0))], dtype=object))
        return [Condition("t = a r, a >= 0", BilinearForms(apart[None], None, Matrix.identity(apart.shape[0])), "==")]

    def refutation(self) -> Sequence[Condition] | None:
        if isinstance(self.local.witness, (NodeNotDissipative, NoWeights)):
            return None  # only about these supplies
        if not self._proves_loops:
            raise DataError("the local certificate is not about self-loops of this weight.")
        return self.local._own_conditions if self.local.status is Status.REFUTED else None

    @property
    def _loops(self) -> Matrix:
        """The self-loops that this is about."""
        return _self_loops(exact_matrix(self.link, "link"), Fraction(self.weight), self.local.model.n_nodes)

    @property
    def _proves_loops(self) -> bool:
        """True if the local certificate is about these self-loops."""
        loops, coupling = self._loops.dense(), self.local.model.coupling.dense()
        return loops.shape == coupling.shape and not (loops.fractions() != coupling.fractions()).any()

    def evidence(self) -> dict[str, Any]:
        """Nothing: `local` comes with a proof of its own."""
        local, link = self.local, exact_matrix(self.link, "link").fractions() * Fraction(self.weight)
        m, q = link.shape
        for j in range(local.model.n_nodes):
            if (local.model.coupling[j * m : (j + 1) * m].plain().fractions()[:, j * q : (j + 1) * q] != link).any():
                raise ProofOmittedError("weight times link is rounded in the self-loops that are proven")
        return {}

    @property
    def decay_rate(self) -> float:
        """Proven for every such network, per unit of time."""
        return self.local.decay_rate

    @property
    def required_rate(self) -> Fraction | None:
        """The rate that was asked for, exactly as given: proven for every such network as well."""
        return self.local.required_rate

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The margin of the local certificate."""
        return self.local.margin

    def explain(self) -> str:
        kinds = self.local.model.n_nodes
        what = "copies of this node" if kinds == 1 else f"nodes of these {kinds} types"
        if self:
            return (
                f"Proved: any number of {what}, {self._graphs()}, is positive and stable with decay rate at least "
                f"{self.local._rate_text}."
            )
        loop = f"a node with a self-loop of weight {about(self.weight)}"
        if self.status is Status.REFUTED:
            return (
                f"Not certified: already {loop} fails. "
                f"{self.local.explain()} Ask for a smaller weight, or raise the local gain."
            )
        return f"Undecided: {loop} is not decided, or not as these networks need it. {self.local.explain()}"

    def _graphs(self) -> str:
        """The couplings that this is about, in words."""
        link = exact_matrix(self.link, "link").fractions()
        if link.shape != (1, 1):
            return (
                f"with any links that map Y into U and sum_j r'W_jk y <= {floored(self.weight)} r'K y for every node k "
                "and y in Y, for the link K and the r of the certificate"
            )
        entering = " (or the sum over those that enter a node)" if self.local.model.n_nodes == 1 else ""
        sign = "nonpositive" if link[0, 0] < 0 else "nonnegative"
        what = "whose sum" if link[0, 0] >= 0 else "the sum of whose sizes"
        return (
            f"on any graph with {sign} weights {what} over the links that leave a node{entering} is at most "
            f"{floored(self._largest_sum)}"
        )

    @np.errstate(all="ignore")
    def covers(self, coupling: Any, types: Sequence[int] | None = None) -> bool:
        """True if the local v, r, q prove the network with this coupling, or its in-weights are small enough, exactly.

        True is a proof that the network is positive and stable; False that this certificate does not say so.

        Parameters
        ----------
        coupling : as for `feedback_interconnect`
        types : sequence of int, optional
            Type of every node; the first type if not given.
        """
        if not self:
            return False
        model, kinds = self._network(coupling, types)
        if self._carry(model, kinds) is not None:
            return True
        return self.local.model.totals[1:] == (1, 1) and all_hold(on.coupling(model)) and self._bounds_rows(model)

    @property
    def _largest_sum(self) -> Fraction:
        """weight |link| of nodes with one input and one output."""
        return Fraction(self.weight) * abs(exact_matrix(self.link, "link").fractions()[0, 0])

    def _bounds_rows(self, model: NetworkModel) -> bool:
        """sum_k |W_jk| <= weight |link| for the links that enter a node.

        What maps Y into U has the sign of the link, as the self-loops do unless they are 0.
        """
        n, most, link = model.n_nodes, self._largest_sum, exact_matrix(self.link, "link").values[0, 0]
        if not most:
            return False
        bound = Matrix.from_fractions(np.full((1, n), -most))
        table = Matrix.join([model.coupling.T, bound], -2)
        sums = Matrix(np.append(np.full(n, -1.0 if link < 0 else 1.0), 1.0)[None])
        forms = BilinearForms(sums, table, Matrix(sp.eye_array(n, format="csr")))
        return Condition("sum of in-weights <= weight", forms, "<=").verdict() is True

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
        model, kinds = self._network(coupling, types)
        return ConeNetwork(model, name=name, certificate=self._carry(model, kinds))

    def _network(self, coupling: Any, types: Sequence[int] | None) -> tuple[NetworkModel, Index]:
        """The network of such nodes, and the type of every node."""
        local = self.local.model
        kinds = np.zeros(_size(coupling) // local.stacks[0].sizes[1], dtype=np.intp) if types is None else _kinds(types)
        if kinds.size and not (kinds.min() >= 0 and kinds.max() < local.n_nodes):
            raise ShapeError(f"types must name one of the {local.n_nodes} node types, 0 to {local.n_nodes - 1}.")
        stacks, members, (group, place) = [], [], local.home
        for g, s in enumerate(local.stacks):
            chosen = np.flatnonzero(group[kinds] == g)
            if chosen.size:
                stacks.append(replace(s, names=(), labels=()).take(place[kinds[chosen]]))
                members.append(chosen)
        empty = NetworkModel(tuple(stacks), tuple(members), Matrix(sp.csr_array((0, 0))), local.dt)
        return empty.with_coupling(read_coupling(coupling, empty)), kinds

    def _spread(self, kinds: Index) -> list[Matrix]:
        """v, r and q of every node."""
        return [part[self._places(kind, kinds)] for kind, part in enumerate(node_vectors(self.local))]

    def _places(self, kind: int, kinds: Index) -> Index:
        """Where the entries of every node are in a vector of `local`."""
        first = self.local.model.offsets[kind]
        size = np.diff(first)[kinds]
        return np.arange(size.sum()) + np.repeat(first[:-1][kinds] - np.cumsum(size) + size, size)

    def _carry(self, model: NetworkModel, kinds: Index) -> NetworkCertificate | None:
        """The local data at every node, if they prove this network."""
        if not self:
            return None
        loop, (v, r, q) = None, self._spread(kinds)
        if model.has_feedthrough and self.local.loop_weights is not None:
            p, t = exactly(self.local, "loop_weights")
            loop = p[self._places(2, kinds)], t[self._places(1, kinds)]
        vectors = {"v": v, "r": r, "q": q, "sigma": np.ones(model.n_nodes), "loop_weights": loop}
        draft = NetworkCertificate.settle(model=model, **vectors, **rates_of(self.local))
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


@np.errstate(all="ignore")
def scale_free_certificate(
    nodes: ConeStateSpace | NodeStack | Iterable[ConeStateSpace],
    weight: float | None = None,
    *,
    link: ArrayLike | None = None,
) -> OutWeightCertificate:
    """Certify every network of copies of some node types, of any size, by the sum of the weights that leave a node.

    Parameters
    ----------
    nodes : ConeStateSpace, or sequence of them, or NodeStack
        Node types with one input and one output each, on the nonnegative axis; or one node of any kind.
    weight : float, optional
        Bound on the out-weights.  Default: just below the largest that works, 1 / max G_t(0) (continuous time) or
        1 / max G_t(1) (discrete time); with several inputs or outputs 1 / rho(K G(0)).
    link : array_like, shape (m, q), optional
        What weights are measured by, for a node with several inputs or outputs: the K in
        sum_j r'W_jk y <= weight r'K y, with the r found.  Default: the identity, if U contains Y.

    Returns
    -------
    OutWeightCertificate
        PROVED, or REFUTED with what breaks a node with a self-loop of this weight.

    Raises
    ------
    ConeMismatchError
        Several node types of which one has several inputs or outputs: r would have to be one for all.  A node with
        several inputs or outputs for which a link has to be given.
    DataError
        A weight that is not a nonnegative number.
    UndecidedError
        No weight is given, and LAPACK does not converge.

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
    if not all(s.sizes[0] for s in stacks):
        raise ShapeError("nodes: a node has no states; every type of node needs at least one.")
    count = sum(len(s) for s in stacks)
    shape = _link(stacks, count, link)
    bare = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), 0 if dt is None else dt)
    if weight is None:
        gains = PortSystem(bare, 1.0 if bare.discrete else 0.0).loop.G
        with converging("the largest weight"):
            loops = [
                np.abs(np.linalg.eigvals(shape.values @ g)).max() if np.isfinite(g).all() else np.inf
                for G in gains
                for g in G
            ]
        top = float(max(loops))
        weight = (1 - 1e-9) / top if np.isfinite(top) and top > 0 else 1.0
    bound = exact_number(weight, "weight", nonnegative=True)
    model = bare.with_coupling(_self_loops(shape, bound, count))
    if count == 1:
        local = certify_as_given(model)
    else:
        local = certify_rates_as_given(model, Matrix.from_fractions(np.full(count, -bound)), Matrix(np.ones(count)))
        if not local:
            whole = certify_as_given(model)
            local = whole if whole.status is Status.REFUTED else local
    return OutWeightCertificate.settle(local=local, weight=_plain(bound), link=_plain(shape), witness=local.witness)


def _self_loops(link: Matrix, weight: Fraction, count: int) -> Matrix:
    """The coupling of so many nodes, each with a self-loop of this weight."""
    loops = Matrix.from_fractions(np.kron(np.eye(count, dtype=int).astype(object), weight * link.fractions()))
    return Matrix(sp.csr_array(loops.values)) if loops.is_double else loops


def _plain(x: Any) -> Any:
    """A number or matrix as doubles, if these suffice."""
    if isinstance(x, Matrix):
        return np.array(x.values) if x.is_double else x
    return float(x) if float(x) == x else x


def out_weight_certificate(node: ConeStateSpace, weight: Fraction, proof: LyapunovCertificate) -> OutWeightCertificate:
    """The certificate for copies of a node with one input, one output and D = 0, from a proof for A + weight B C."""
    stacks, members, dt = gather(node, "node")
    one = Matrix(np.ones((1, 1)))
    model = NetworkModel(stacks, members, _self_loops(one, weight, 1), 0 if dt is None else dt)
    v = exactly(proof, "v")
    r = v.fractions() @ stacks[0].B.fractions()[0]
    vectors = {"v": v, "r": Matrix.from_fractions(r), "q": Matrix.from_fractions(-weight * r)}
    local = NetworkCertificate.settle(model=model, **vectors, sigma=np.ones(1), **rates_of(proof))
    return OutWeightCertificate.settle(local=local, weight=_plain(weight), link=_plain(one))


def _link(stacks: Sequence[NodeStack], count: int, link: ArrayLike | None) -> Matrix:
    """The link of weight 1, or what is missing to say what that is."""
    s = stacks[0]
    _, m, q = s.sizes
    if all(t.sizes[1:] == (1, 1) and t.U.rays[0, 0] > 0 and t.Y.rays[0, 0] > 0 for t in stacks) and link is None:
        return Matrix(np.ones((1, 1)))
    if count > 1:
        raise ConeMismatchError(
            "scale-free certificates for several node types are for nodes with one nonnegative input and one "
            f"nonnegative output, so that one supply rate r serves all; here a node has {m} inputs and {q} outputs. "
            "Certify one type at a time."
        )
    if link is not None:
        return require_shape(exact_matrix(link, "link"), "link", (m, q), "inputs by outputs").dense()
    if m != q or not s.U.contains(s.Y):
        raise ConeMismatchError(
            f"the node has {m} inputs and {q} outputs, and there is no telling what a link of weight 1 makes of the "
            f"outputs; give link, a {m} x {q} matrix that maps Y into U."
        )
    return Matrix.identity(m)
