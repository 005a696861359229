"""Certificates that networks inherit from the ones they were made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any

from ..exact.condition import Condition
from ..proof.certificate import Certificate, Status
from .certificate import NetworkCertificate
from .edits import Overlay
from .model import NetworkModel


def inherit(certificate: NetworkCertificate, model: NetworkModel) -> NetworkCertificate | None:
    """The data of a certificate, proven for the same nodes under other links; None if they prove nothing there.

    No solve.  Weaker links always pass: r_j lies in U_j*, so taking (W - W')Y inside U away from W lowers
    every sum of (III').
    """
    if certificate.status is not Status.PROVED:
        return None
    draft = NetworkCertificate.settle(
        model=model,
        v=certificate.v,
        r=certificate.r,
        q=certificate.q,
        sigma=certificate.sigma,
        decay_rate=certificate.decay_rate,
        loop_weights=certificate.loop_weights,
        exact=certificate.exact,
    )
    return draft if draft.status is Status.PROVED else None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LocalCertificate(Certificate):
    """Theorem 4 for a changed network: the old certificate, and a proof of what changed.

    Has the attributes of a `NetworkCertificate`; those that concern all nodes are put together, and
    `check`, `save` and `residuals` work on the whole, when first asked for.

    Attributes
    ----------
    overlay : Overlay
        The certified network and its changes.
    decay_rate : float
        Proven for the changed network.
    """

    overlay: Overlay

    @cached_property
    def whole(self) -> NetworkCertificate:
        """The same proof without reference to the old network; linear in its size, no solve."""
        return self.overlay.certificate(self.overlay.build())

    @property
    def decay_rate(self) -> float:
        """See the class."""
        return self.overlay.decay_rate

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The margin of the whole."""
        return self.whole.margin

    def __getattr__(self, name: str) -> Any:
        if name in ("v", "r", "q", "sigma", "model", "node_margins", "loop_weights"):
            return getattr(self.whole, name)
        raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")

    def conditions(self) -> Sequence[Condition]:
        return self.whole.conditions()

    def refutation(self) -> Sequence[Condition] | None:
        return None

    def check(self) -> bool:
        """Recompute the proof of the whole changed network."""
        return self.whole.status is Status.PROVED and self.whole.check()

    def save(self, path: str | PathLike[str]) -> None:
        """Write the whole as a certificate of its own.

        Parameters
        ----------
        path : path-like
        """
        self.whole.save(path)

    def explain(self) -> str:
        changed, gone = len(self.overlay.nodes), len(self.overlay.removed)
        return (
            f"Proved: the network of {self.overlay.n_nodes} nodes is positive and exponentially stable with decay "
            "rate at least "
            f"{self.decay_rate:.4g}. Inherited from a certificate of {self.overlay.base.model.n_nodes} nodes; "
            f"{changed} nodes were proven "
            f"anew and {gone} removed. It stays stable under constant link delays and when links are weakened or lost."
        )

    def __repr__(self) -> str:
        changed = len(self.overlay.nodes)
        return f"<LocalCertificate {self.status.name}, {self.overlay.n_nodes} nodes, {changed} proven anew>"
