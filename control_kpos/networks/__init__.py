"""Networks of cone systems: Theorem 4 from two nodes to millions."""

from .any_size import OutWeightCertificate, scale_free_certificate
from .certificate import NetworkCertificate
from .model import NetworkModel
from .network import ConeNetwork, feedback_interconnect
from .nodes import NodeStack, stack
from .spectrum.bracket import AbscissaCertificate
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
    "NetworkCertificate",
    "NetworkInstability",
    "NetworkModel",
    "NoWeights",
    "NodeNotDissipative",
    "NodeStack",
    "NodeViolation",
    "OutWeightCertificate",
    "feedback_interconnect",
    "scale_free_certificate",
    "stack",
]
