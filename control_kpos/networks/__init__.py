"""Networks of cone systems: Theorem 4 from two nodes to millions."""

from .any_size import OutWeightCertificate, scale_free_certificate
from .certificate import NetworkCertificate
from .compartmental import Compartments, compartmental
from .interconnect import feedback_interconnect
from .model import NetworkModel
from .network import ConeNetwork
from .nodes import NodeStack, UncertainStack, stack
from .ranges import interval
from .spectrum.bracket import AbscissaCertificate
from .state_delays import DelayedNetworkCertificate
from .uncertain.bounded import BoundedNetworkCertificate
from .uncertain.certificate import UncertainNetworkCertificate
from .uncertain.largest import largest_uncertainty
from .uncertain.network import UncertainNetwork
from .uncertain.witnesses import FailingEnd, FailingMember, NoCommonStorage, NoCommonVectors
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
    "BoundedNetworkCertificate",
    "Compartments",
    "ConeNetwork",
    "CouplingViolation",
    "DelayedNetworkCertificate",
    "FailingEnd",
    "FailingMember",
    "NetworkCertificate",
    "NetworkInstability",
    "NetworkModel",
    "NoCommonStorage",
    "NoCommonVectors",
    "NoWeights",
    "NodeNotDissipative",
    "NodeStack",
    "NodeViolation",
    "OutWeightCertificate",
    "UncertainNetwork",
    "UncertainNetworkCertificate",
    "UncertainStack",
    "compartmental",
    "feedback_interconnect",
    "interval",
    "largest_uncertainty",
    "scale_free_certificate",
    "stack",
]
