"""Variations of a certified network that touch only what changed."""

from __future__ import annotations

from ..certificates.result import Status
from .certificate import NetworkCertificate
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
    )
    return draft if draft.status is Status.PROVED else None
