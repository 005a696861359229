"""A network whose nodes have vertices, with one certificate for every choice of them."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...cards import card
from ...errors import DataError, ShapeError
from ...proof.in_time import kept
from ..blocks import Index
from ..coupling import read_ends
from ..model import NetworkModel
from ..network import ConeNetwork
from ..nodes import known_by
from ..ranges import has_ranges
from .certificate import UncertainNetworkCertificate
from .certify import certify_all
from .members import Vertices, counts, member


class UncertainNetwork(ConeNetwork):
    """A network whose nodes are known within sets; made by `feedback_interconnect` from nodes with vertices.

    As a StateSpace (A, poles, responses) it is its nominal member, which has the first vertex of every node and the
    upper ends of ranges.
    `certificate` is about every choice.  Theorems 1 to 3, designs and connections need one system and refuse it: give
    them `nominal` or another `member`.

    Parameters
    ----------
    models : tuple of NetworkModel
        The networks of the vertices; they share cones and links.
    lower : NetworkModel, optional
        The network of the lower ends of ranges.
    external, name, progress, time_limit
        As for `ConeNetwork`.

    Attributes
    ----------
    models : tuple of NetworkModel
        The networks of the vertices, at the upper ends of ranges.
    lower : NetworkModel or None
        The network of the lower ends of ranges, if there are any.
    certificate : UncertainNetworkCertificate
        Positivity and exponential stability for every choice of vertices, their mixtures and numbers in ranges, also if
        it changes at any time; or what breaks them.  Found when first asked for.

    Examples
    --------
    >>> import control_kpos as kp
    >>> nodes = kp.stack([[[[-2.0]], [[-3.0]]], [[[-4.0]], [[-2.5]]]], B=[[1]], C=[[1]])
    >>> net = kp.feedback_interconnect(nodes, [[0, 1], [2, 0]])
    >>> net.certificate.status.name, net.member([1, 0]).A.diagonal()
    ('PROVED', array([-4., -3.]))
    """

    def __init__(
        self,
        models: Vertices,
        lower: NetworkModel | None = None,
        *,
        external: tuple[Index, Index] | None = None,
        name: str | None = None,
        progress: Any = None,
        time_limit: float | None = None,
    ) -> None:
        super().__init__(models[0], external=external, name=name, progress=progress, time_limit=time_limit)
        self.models, self.lower = models, lower

    @property
    def certificate(self) -> UncertainNetworkCertificate:  # type: ignore[override]
        """Theorem 4 with one v, r, q for all vertices: PROVED, or REFUTED with what breaks it."""
        return kept(self, "certificate", self._certificate)

    def _certificate(self) -> UncertainNetworkCertificate:  # type: ignore[override]
        return self._in_time(None, lambda: certify_all(self.models, self.lower), self._nothing)

    def _nothing(self) -> UncertainNetworkCertificate:
        return UncertainNetworkCertificate.settle(model=self.models[0], vertices=self.models[1:], lower=self.lower)

    @cached_property
    def nominal(self) -> ConeNetwork:
        """The network with the first vertex of every node."""
        return ConeNetwork(self.models[0], external=self._external, **self._runs())

    def member(self, choice: ArrayLike) -> ConeNetwork:
        """The network with one vertex for each node.

        Parameters
        ----------
        choice : array_like of int, shape (N,)
            The vertex of every node, counted from 0.

        Returns
        -------
        ConeNetwork

        Raises
        ------
        ShapeError, DataError
            Not one whole number per node; a vertex that the node does not have.
        """
        chosen = _whole(choice, self.model)
        most = np.zeros(self.model.n_nodes, dtype=np.intp)
        for count, index in zip(counts(self.models), self.model.members, strict=True):
            most[index] = count
        outside = np.flatnonzero((chosen < 0) | (chosen >= most))
        if outside.size:
            j = int(outside[0])
            raise DataError(
                f"choice[{j}] is {chosen[j]}, but {self.model.name_of(j)} has the vertices 0 to {most[j] - 1}."
            )
        return ConeNetwork(member(self.models, chosen), external=self._external, **self._runs())

    # -- what is about one system

    def require_certain(self) -> None:
        """See `ConeNetwork`."""
        raise DataError(
            f"{self.name} is a network with vertices or ranges, and this is about one system. Its verdict for all "
            "choices is .certificate; give .nominal, or another .member(choice), for one of them."
        )

    @property
    def exact(self) -> Any:
        """Refused: there is no single closed loop."""
        return self.require_certain()

    def is_cone_positive(self, *, time_limit: float | None = None) -> bool:
        """Refused; see `exact`."""
        self.require_certain()
        return False

    def abscissa_certificate(self, relative: float = 1e-6, *, time_limit: float | None = None) -> Any:
        """Refused; see `exact`."""
        return self.require_certain()

    def _joined(self, *_: Any, **__: Any) -> Any:
        return self.require_certain()

    def _edited(self, *_: Any, **__: Any) -> Any:
        return self.require_certain()

    def room_for(self, *_: Any, **__: Any) -> Any:
        """Refused; see `exact`."""
        return self.require_certain()

    def with_links(self, coupling: Any) -> UncertainNetwork:
        """The same nodes, with their vertices, under other links; the certificate is found anew.

        Parameters
        ----------
        coupling : as for `feedback_interconnect`

        Returns
        -------
        UncertainNetwork
        """
        W, least = read_ends(coupling, self.model)
        models, low = tuple(m.with_coupling(W) for m in self.models), self.lower or self.models[0]
        kept = has_ranges(coupling) or (self.lower is not None and self._ranges_in_nodes)
        lower = low.with_coupling(least) if kept else None
        return UncertainNetwork(models, lower, external=self._external, **self._runs())

    @property
    def _ranges_in_nodes(self) -> bool:
        low = self.lower
        return low is not None and any(a is not b for a, b in zip(low.stacks, self.model.stacks, strict=True))

    @cached_property
    def lower_ends(self) -> ConeNetwork:
        """The network at the lower ends of all ranges, with the first vertices elsewhere."""
        return ConeNetwork(self.lower or self.models[0], external=self._external, **self._runs())

    def _twin(self) -> UncertainNetwork:
        return UncertainNetwork(self.models, self.lower, external=self._external, **self._runs())

    def __repr__(self) -> str:
        known = known_by(len(self.models), self.lower)
        return f"<UncertainNetwork{ConeNetwork.__repr__(self)[len('<ConeNetwork') : -1]}, {known}>"

    def _repr_html_(self) -> str | None:
        certificate = self.__dict__.get("certificate")
        rows = [("nodes", str(self.model.n_nodes)), ("vertices", str(len(self.models)))]
        if certificate is None:
            return card(f"Network {self.name}", rows, text="Ask for its certificate: .certificate")
        return card(f"Network {self.name}", rows, status=certificate.status.name, text=certificate.explain())


def _whole(choice: ArrayLike, model: NetworkModel) -> Index:
    try:
        given = np.asarray(choice)
    except Exception:  # noqa: BLE001  (conversion runs code of the object, which may raise anything)
        given = np.zeros(0)
    if given.shape != (model.n_nodes,) or given.dtype.kind not in "iu":
        raise ShapeError(
            f"choice has shape {given.shape} and holds {given.dtype}; give {model.n_nodes} whole numbers, one vertex "
            "for each node."
        )
    return given.astype(np.intp)
