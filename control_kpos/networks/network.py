"""Networks: nodes and a coupling with the verdict of Theorem 4, as a python-control StateSpace that stays sparse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from control import StateSpace

from ..cards import card
from ..errors import ShapeError, UndecidedError
from ..exact.intake import flag, real_number, words
from ..progress import Reporter
from ..systems.statespace import ConeStateSpace
from .blocks import Index
from .closed_loop_system import ClosedLoopSystem
from .coupling import read_coupling
from .edits import inherited, node_number, permissible_weight, placed, single_node, weights_by_node
from .model import NetworkModel
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
    progress, time_limit : optional
        As for `feedback_interconnect`.

    Attributes
    ----------
    model : NetworkModel
        Nodes in stacks and the coupling.
    certificate : NetworkCertificate
        Theorem 4: proof of positivity and stability, or what breaks them.  Found when first asked for.
    sparse_A, sparse_B, sparse_C, sparse_D : csr_array
        The closed loop from w to y.
    time_limit : float or None
        Seconds for each question that is given no limit of its own.
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

    def abscissa_certificate(self, relative: float = 1e-6, *, time_limit: float | None = None) -> AbscissaCertificate:
        """Proof of both sides of a bracket of the spectral abscissa; see `spectral_abscissa`.

        Parameters
        ----------
        relative : float
            Width of the bracket sought, relative to the abscissa.
        time_limit : float, optional
            Seconds; the bracket is as narrow as it was then, or UNDECIDED.  Default: that of the network.

        Returns
        -------
        AbscissaCertificate
        """
        relative = min(max(real_number(relative, "relative", positive=True), _NARROWEST), 1.0)
        with Reporter(self._progress) as report:
            return self._in_time(
                time_limit,
                lambda: bracket(self.model, relative, report),
                lambda: AbscissaCertificate.settle(model=self.model),
            )

    def spectral_abscissa(self, relative: float = 1e-6, *, time_limit: float | None = None) -> tuple[float, float]:
        """Bracket of the largest real part of the poles, both sides proven.

        Parameters
        ----------
        relative : float
            Width sought, relative to the abscissa (to a 2^-40 part of the size of A where the abscissa is smaller).
        time_limit : float, optional
            Seconds; the bracket is as narrow as it was then.  Default: that of the network.

        Returns
        -------
        lower, upper : float
            In discrete time of the spectral radius, which is the rightmost pole of a positive network.

        Raises
        ------
        UndecidedError
            A side could not be proven, or not in time; in particular if the network is not positive.

        Notes
        -----
        Some ten pairs of solves with shifts that fall towards the abscissa.  In networks of moderate size, and where
        rounding leaves the bracket wide, both ends come from Perron vectors refined to as many digits as they need.
        """
        certificate = self.abscissa_certificate(relative, time_limit=time_limit)
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
        certificate = self._in_time(None, lambda: inherited(self.certificate, model, origin), lambda: None)
        return ConeNetwork(model, external=external, certificate=certificate, **self._runs())

    def copy(self, name: str | None = None, use_prefix_suffix: bool = True) -> ConeNetwork:
        """A network that shares the immutable data.

        Parameters
        ----------
        name : str, optional
        use_prefix_suffix : bool
            As in python-control.
        """
        name, use_prefix_suffix = words(name, "name"), flag(use_prefix_suffix, "use_prefix_suffix")
        out = self._twin()
        if "certificate" in self.__dict__:
            out.__dict__["certificate"] = self.certificate
        out.name = self._name_or_default(
            self.name if name is None and use_prefix_suffix else name,
            prefix_suffix_name="duplicate" if name is None and use_prefix_suffix else None,
        )
        return out

    def _twin(self) -> ConeNetwork:
        """A network of the same data."""
        return ConeNetwork(self.model, external=self._external, find=self._find, **self._runs())

    def _runs(self) -> dict[str, Any]:
        """What networks made of this one take over."""
        return {"progress": self._progress, "time_limit": self.time_limit}

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
