"""Networks of cone systems: Theorem 4 from two nodes to millions."""

from .any_size import OutWeightCertificate as OutWeightCertificate
from .any_size import scale_free_certificate as scale_free_certificate
from .certificate import NetworkCertificate as NetworkCertificate
from .interconnect import feedback_interconnect as feedback_interconnect
from .model import NetworkModel as NetworkModel
from .network import ConeNetwork as ConeNetwork
from .nodes import NodeStack as NodeStack
from .nodes import stack as stack
from .spectrum.bracket import AbscissaCertificate as AbscissaCertificate
from .witnesses import AlgebraicLoop as AlgebraicLoop
from .witnesses import CouplingViolation as CouplingViolation
from .witnesses import NetworkInstability as NetworkInstability
from .witnesses import NodeNotDissipative as NodeNotDissipative
from .witnesses import NodeViolation as NodeViolation
from .witnesses import NoWeights as NoWeights
