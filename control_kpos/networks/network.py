"""Networks: nodes and a coupling with the verdict of Theorem 4, as a python-control StateSpace that stays sparse."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from control import StateSpace
from numpy.typing import ArrayLike

from ..cards import card
from ..errors import ShapeError, UndecidedError
from ..exact.intake import flag, places, real_number, words
from ..exact.matrix import Matrix
from ..progress import Reporter
from ..systems.statespace import ConeStateSpace
from .blocks import Index
from .closed_loop_system import ClosedLoopSystem
from .coupling import named_by_graph, read_coupling
from .edits import inherited, node_number, permissible_weight, placed, single_node, weights_by_node
from .given_rates import SupplyRates, certify_rates, read_rates
from .model import NetworkModel, gather
from .nodes import NodeStack
from .spectrum.bracket import AbscissaCertificate, bracket

# Brackets are not sought narrower than this: rounding is in the way.
_NARROWEST = 1e-13


class ConeNetwork(ClosedLoopSystem):
    """The closed loop u = W y + w of many nodes; made by `feedback_interconnect`.

    ::

        w --->(+)---> [ nodes x' = A x + B u ] ---> y
               ^                                |
               +--------- coupling W <----------+

    A `ConeStateSpace` from the external inputs w to the outputs y, on the products of the nodes' cones.  Its A, B,
    C, D are read-only dense arrays made on demand for up to `DENSE_STATES` = 5000 states, so that python-control's
    functions work; above that they raise `TooLargeError` and name the sparse attributes, which have no such limit.

    Parameters
    ----------
    model : NetworkModel
        Nodes in stacks and the coupling.
    external : tuple of two ndarrays of int, optional
        Places of the external inputs and outputs kept; all if not given.
    name : str, optional
        Name of the system.
    certificate : NetworkCertificate, optional
        If it is known already.
    find : callable, optional
        Takes the model and returns its certificate, instead of `certify`.
    progress : callable or bool, optional
        As for `feedback_interconnect`.

    Attributes
    ----------
    model : NetworkModel
        Nodes in stacks and the coupling.
    certificate : NetworkCertificate
        Theorem 4: proof of positivity and stability, or what breaks them.  Found when first asked for.
    sparse_A, sparse_B, sparse_C, sparse_D : csr_array
        The closed loop from w to y.
    X, U, Y : Cone
        Products of the nodes' cones; of those inputs and outputs that are external.

    Examples
    --------
    >>> import control_kpos as kp
    >>> nodes = kp.stack([[[-2.0]], [[-3.0]]], B=[[1]], C=[[1]])
    >>> net = kp.feedback_interconnect(nodes, [[0, 1], [2, 0]])
    >>> net.A
    array([[-2.,  1.],
           [ 2., -3.]])
    >>> net.without_node(0).certificate.status.name
    'PROVED'
    """

    # -- the spectrum

    def abscissa_certificate(self, relative: float = 1e-6) -> AbscissaCertificate:
        """Proof of both sides of a bracket of the spectral abscissa; see `spectral_abscissa`.

        Parameters
        ----------
        relative : float
            Width of the bracket sought, relative to the abscissa.

        Returns
        -------
        AbscissaCertificate
        """
        relative = min(max(real_number(relative, "relative", positive=True), _NARROWEST), 1.0)
        with Reporter(self._progress) as report:
            return bracket(self.model, relative, report)

    def spectral_abscissa(self, relative: float = 1e-6) -> tuple[float, float]:
        """Bracket of the largest real part of the poles, both sides proven.

        Parameters
        ----------
        relative : float
            Width sought, relative to the abscissa (to a 2^-40 part of the size of A where the abscissa is smaller).

        Returns
        -------
        lower, upper : float
            In discrete time of the spectral radius, which is the rightmost pole of a positive network.

        Raises
        ------
        UndecidedError
            A side could not be proven; in particular if the network is not positive.

        Notes
        -----
        Some ten pairs of solves with shifts that fall towards the abscissa.  In networks of moderate size, and where
        rounding leaves the bracket wide, both ends come from Perron vectors refined to as many digits as they need.
        """
        certificate = self.abscissa_certificate(relative)
        if not certificate:
            raise UndecidedError(f"{self.name}: {certificate.explain()}")
        return certificate.lower, certificate.upper

    # -- variations

    def with_links(self, coupling: Any) -> ConeNetwork:
        """The same nodes under other links; inherits the certificate where it covers them.

        Parameters
        ----------
        coupling : as for `feedback_interconnect`

        Returns
        -------
        ConeNetwork
            Its certificate holds the same v and is proven for the new links without a solve if what is left of
            every link and what is taken away both map Y into U, or if Theorem 4 still holds with this v.
            Otherwise it is found anew when first asked for.
        """
        model = self.model.with_coupling(read_coupling(coupling, self.model))
        return self._edited(model, np.arange(model.n_nodes), self._external)

    def with_node(
        self,
        system: ConeStateSpace | NodeStack,
        *,
        incoming: Mapping[int, Any] | None = None,
        outgoing: Mapping[int, Any] | None = None,
    ) -> ConeNetwork:
        """The network with one more node, which gets the last number.

        Parameters
        ----------
        system : ConeStateSpace
        incoming : dict of int to float or array_like, optional
            Weights (blocks) of links into the new node, by the number of the node they come from.
        outgoing : dict of int to float or array_like, optional
            Weights (blocks) of links out of the new node, by the number of the node they lead to.

        Returns
        -------
        ConeNetwork
            With all external signals.  If this network is certified and its sources can afford the new node,
            the certificate is inherited, without a solve for the whole network; otherwise it is found anew when
            first asked for.
        """
        into, out_of = ({} if links is None else links for links in (incoming, outgoing))
        return self._with_placed(self.model.n_nodes, system, into, out_of)

    def replace_node(
        self,
        node: int,
        system: ConeStateSpace | NodeStack,
        *,
        incoming: Mapping[int, Any] | None = None,
        outgoing: Mapping[int, Any] | None = None,
    ) -> ConeNetwork:
        """The network with another system as one of its nodes.

        Parameters
        ----------
        node : int
        system : ConeStateSpace
        incoming, outgoing : dict, optional
            New links, see `with_node`; the old ones stay if not given.

        Returns
        -------
        ConeNetwork
            Certified like that of `with_node`.
        """
        return self._with_placed(node_number(self.model, node), system, incoming, outgoing)

    def without_node(self, node: int) -> ConeNetwork:
        """The network without a node and its links; later nodes move up.

        Parameters
        ----------
        node : int

        Returns
        -------
        ConeNetwork
            With all external signals; certified by the same vectors if this one is.
        """
        if self.model.n_nodes == 1:
            raise ShapeError("the only node of a network cannot be removed.")
        left = np.delete(np.arange(self.model.n_nodes), node_number(self.model, node))
        keep = np.isin(np.arange(self.model.n_nodes), left)
        return self._edited(self.model.restrict(keep), left)

    def room_for(
        self,
        system: ConeStateSpace | NodeStack,
        sources: Sequence[int] | Mapping[int, Any],
        targets: Sequence[int] | Mapping[int, Any],
    ) -> float:
        """Which links of a new node stay certified: the largest product of the weights in and out.

        Parameters
        ----------
        system : ConeStateSpace
            A node without feedthrough.
        sources, targets : sequence of int, or dict of int to array_like
            Nodes that the new node listens to (feeds).  With several inputs or outputs, a dictionary of blocks
            L, inputs of the target by outputs of the source; a link is then its weight times L.

        Returns
        -------
        float
            For every pair of link weights a (from each source) and b (to each target) with a * b below this
            number the certificate covers the new node, which then needs no solve.  Computed, with 0.1 % to spare;
            `with_node` proves it.  inf without a loop through the network; 0 if the certificate does not hold, the
            node is not positive and stable, or a link does not map Y into U.

        Raises
        ------
        ConeMismatchError
            Links of another shape than the ports; feedthrough in the node or in a source.
        """
        return permissible_weight(self.certificate, single_node(system, self.dt), sources, targets)

    @np.errstate(all="ignore")
    def _with_placed(
        self, node: int, system: Any, incoming: Mapping[int, Any] | None, outgoing: Mapping[int, Any] | None
    ) -> ConeNetwork:
        stack = single_node(system, self.dt)
        given = zip((incoming, outgoing), ("incoming", "outgoing"), strict=True)
        into, out_of = (None if w is None else weights_by_node(self.model, w, name) for w, name in given)
        model = placed(self.model, node, stack, into, out_of)
        origin = np.arange(model.n_nodes)
        return self._edited(model, np.where(origin == node, -1, origin))

    def _edited(self, model: NetworkModel, origin: Index, external: tuple[Index, Index] | None = None) -> ConeNetwork:
        certificate = inherited(self.certificate, model, origin)
        return ConeNetwork(model, external=external, certificate=certificate, progress=self._progress)

    def copy(self, name: str | None = None, use_prefix_suffix: bool = True) -> ConeNetwork:
        """A network that shares the immutable data.

        Parameters
        ----------
        name : str, optional
        use_prefix_suffix : bool
            As in python-control.
        """
        name, use_prefix_suffix = words(name, "name"), flag(use_prefix_suffix, "use_prefix_suffix")
        out = ConeNetwork(self.model, external=self._external, find=self._find, progress=self._progress)
        if "certificate" in self.__dict__:
            out.__dict__["certificate"] = self.certificate
        out.name = self._name_or_default(
            self.name if name is None and use_prefix_suffix else name,
            prefix_suffix_name="duplicate" if name is None and use_prefix_suffix else None,
        )
        return out

    def __repr__(self) -> str:
        return (
            f"<ConeNetwork {self.name}: {self.model.n_nodes} nodes, {self.nstates} states, {self.model.W.nnz} links, "
            f"{self.ninputs} inputs, {self.noutputs} outputs>"
        )

    def __str__(self) -> str:
        return StateSpace.__str__(self) if self.nstates <= 50 else repr(self)

    def _repr_eval_(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str | None:
        certificate = self.__dict__.get("certificate")  # not worth a long computation
        rows = [
            ("nodes", str(self.model.n_nodes)),
            ("states, inputs, outputs", f"{self.nstates}, {self.ninputs}, {self.noutputs}"),
            ("links", str(self.model.W.nnz)),
        ]
        if certificate is None:
            return card(f"Network {self.name}", rows, text="Ask for its certificate: .certificate")
        return card(f"Network {self.name}", rows, status=certificate.status.name, text=certificate.explain())


@np.errstate(all="ignore")
def feedback_interconnect(
    systems: NodeStack | StateSpace | Iterable[NodeStack | StateSpace],
    coupling: ArrayLike | Any,
    *,
    supply_rates: SupplyRates | None = None,
    inputs: Sequence[int | str] | None = None,
    outputs: Sequence[int | str] | None = None,
    name: str | None = None,
    progress: Callable[[str], None] | bool | None = None,
) -> ConeNetwork:
    """Close the loop u = coupling @ y + w around many nodes, and decide Theorem 4.

    ::

        w --->(+)---> [ nodes ] ---+---> y
               ^                   |
               +---- coupling <----+

    Parameters
    ----------
    systems : sequence of ConeStateSpace, or NodeStack
        Nodes of any sizes and cones; `control_kpos.stack` for many alike.  They may be mixed.  A plain
        `control.StateSpace` gets the nonnegative orthants as its cones.
    coupling : array_like, sparse matrix, list of lists of blocks, or networkx graph
        W, shape (sum m_j, sum q_k).  Blocks W[j][k] are m_j x q_k; None stands for zeros.  In a graph,
        for nodes with one input and one output, an edge j -> k of weight w feeds y_j into u_k, an undirected
        edge both ways; edges without a weight have weight 1.  Its nodes are 0, ..., N - 1 or the names of the
        systems.  Any other labels stand for the systems in the order of ``list(graph.nodes)`` and become
        the names of the nodes, if these have none.  Sparse matrices hold doubles: give weights
        such as "1/3" in a dense matrix, in blocks or in a graph, and they stay what they are.
    supply_rates : sequence of (q_j, r_j), optional
        Test these local supply rates r_j'u_j + q_j'y_j and find weights sigma, instead of finding rates.
    inputs, outputs : sequence of int or str, optional
        External signals to keep, by place among all of them or by name; all if not given.
    name : str, optional
        Name of the closed loop.
    progress : callable or bool, optional
        Receives lines about long work; True writes to standard error, False is silent.  Default: standard
        error if it is a terminal.

    Returns
    -------
    ConeNetwork
        The closed loop as a StateSpace, also if it is unstable or not positive.  Its `certificate` is
        found when first asked for.

    Raises
    ------
    ShapeError, ConeMismatchError, DataError
        An empty network; a coupling or supply rates of the wrong size; NaN or inf; an algebraic loop that
        makes the closed loop ill-posed.
    TimebaseError
        Nodes with different sampling times.

    Notes
    -----
    Theorem 4 (Kawano and Forni, `cone_ic_s`), with its condition (III) for every node and generator.
    Costs one sparse solve in the sum m_j inputs; see `control_kpos.networks.certify`.

    Examples
    --------
    >>> import control_kpos as kp, numpy as np
    >>> node = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
    >>> ring = kp.feedback_interconnect([node] * 3, [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    >>> ring.certificate.status.name
    'PROVED'
    >>> lower, upper = ring.spectral_abscissa()
    >>> round(upper, 4)
    -1.8902
    """
    stacks, members, dt = gather(systems)
    empty = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), 0 if dt is None else dt)
    model = named_by_graph(empty, coupling).with_coupling(read_coupling(coupling, empty))
    external = None
    if inputs is not None or outputs is not None:
        external = (_select(model, inputs, 1, "inputs"), _select(model, outputs, 2, "outputs"))
    find = None
    if supply_rates is not None:
        q, r = read_rates(model, supply_rates)
        find = partial(certify_rates, q=q, r=r)

    return ConeNetwork(model, external=external, name=name, find=find, progress=progress)


def _select(model: NetworkModel, chosen: Sequence[int | str] | int | str | None, kind: int, what: str) -> Index:
    """Places of signals given by place or name, names being those of the network or of a node."""
    count = model.totals[kind]
    if chosen is None:
        return np.arange(count)
    picked = places(chosen, what)
    known: dict[str, list[int]] = {}
    if any(isinstance(item, str) for item in picked):
        for place, label in enumerate(model.signal_names(kind)):
            known[label] = [place]
        for j, node in enumerate(model.names):
            known.setdefault(node, list(range(int(model.offsets[kind][j]), int(model.offsets[kind][j + 1]))))
    out: list[int] = []
    for item in picked:
        if isinstance(item, str):
            if item not in known:
                raise ShapeError(f"{what} names {item!r}, which is neither one of the {count} {what} nor a node.")
            out += known[item]
        elif -count <= item < count:
            out.append(item % count)
        else:
            raise ShapeError(f"{what} holds {item}; there are {count} {what}.")
    if len(set(out)) != len(out):
        raise ShapeError(f"{what} names a signal twice.")
    return np.array(out, dtype=np.intp)
