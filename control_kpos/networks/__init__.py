"""Networks of cone systems: Theorem 4 from two nodes to millions."""

from .any_size import OutWeightCertificate, scale_free_certificate
from .certificate import NetworkCertificate
from .interconnect import feedback_interconnect
from .model import NetworkModel
from .network import ConeNetwork
from .nodes import NodeStack, UncertainStack, stack
from .spectrum.bracket import AbscissaCertificate
from .uncertain.certificate import FailingMember, UncertainNetworkCertificate, UnstableMixture
from .uncertain.network import UncertainNetwork
from .witnesses import (
    AlgebraicLoop,
    CouplingViolation,
    NetworkInstability,
    NodeNotDissipative,
    NodeViolation,
    NoWeights,
)

__all__ = [
    "AbscissaCertificate",
    "AlgebraicLoop",
    "ConeNetwork",
    "CouplingViolation",
    "FailingMember",
    "NetworkCertificate",
    "NetworkInstability",
    "NetworkModel",
    "NoWeights",
    "NodeNotDissipative",
    "NodeStack",
    "NodeViolation",
    "OutWeightCertificate",
    "UncertainNetwork",
    "UncertainNetworkCertificate",
    "UncertainStack",
    "UnstableMixture",
    "feedback_interconnect",
    "scale_free_certificate",
    "stack",
]
