"""Analysis and design of cone-invariant (K-positive) linear systems on top of python-control."""

import importlib
from typing import TYPE_CHECKING, Any

from . import examples as examples
from .cones import Cone as Cone
from .cones import PolyhedralCone as PolyhedralCone
from .cones import lorentz as lorentz
from .cones import orthant as orthant
from .cones import product as product
from .errors import ActuatorLossWarning as ActuatorLossWarning
from .errors import CertificateFileError as CertificateFileError
from .errors import ConeMismatchError as ConeMismatchError
from .errors import DataError as DataError
from .errors import FalseClaimError as FalseClaimError
from .errors import KposError as KposError
from .errors import NotProperConeError as NotProperConeError
from .errors import ShapeError as ShapeError
from .errors import SolverError as SolverError
from .errors import TimebaseError as TimebaseError
from .errors import TooLargeError as TooLargeError
from .errors import UndecidedError as UndecidedError
from .proof.certificate import Certificate as Certificate
from .proof.certificate import Status as Status
from .proof.files import load_certificate as load_certificate
from .systems.statespace import ConeStateSpace as ConeStateSpace
from .theorems.dissipativity import DissipativityCertificate as DissipativityCertificate
from .theorems.dissipativity import SupplyViolation as SupplyViolation
from .theorems.dissipativity import dissipativity as dissipativity
from .theorems.gains import induced_gain as induced_gain
from .theorems.positivity import PlaneViolation as PlaneViolation
from .theorems.positivity import PositivityCertificate as PositivityCertificate
from .theorems.positivity import PositivityViolation as PositivityViolation
from .theorems.positivity import cone_positivity as cone_positivity
from .theorems.positivity import state_positivity as state_positivity
from .theorems.stability import InstabilityCombination as InstabilityCombination
from .theorems.stability import InstabilityDirection as InstabilityDirection
from .theorems.stability import LyapunovCertificate as LyapunovCertificate
from .theorems.stability import linear_lyapunov as linear_lyapunov

if TYPE_CHECKING:
    from .design import DesignResult as DesignResult
    from .design import Tradeoff as Tradeoff
    from .design import gain_rate_tradeoff as gain_rate_tradeoff
    from .design import network_feedback as network_feedback
    from .design import observer_gain as observer_gain
    from .design import output_feedback as output_feedback
    from .design import scale_free_feedback as scale_free_feedback
    from .design import state_feedback as state_feedback
    from .find import CodesignResult as CodesignResult
    from .find import ConeCertificate as ConeCertificate
    from .find import FoundCone as FoundCone
    from .find import design_cone_and_feedback as design_cone_and_feedback
    from .find import find_cone as find_cone
    from .networks import AbscissaCertificate as AbscissaCertificate
    from .networks import AlgebraicLoop as AlgebraicLoop
    from .networks import ConeNetwork as ConeNetwork
    from .networks import CouplingViolation as CouplingViolation
    from .networks import NetworkCertificate as NetworkCertificate
    from .networks import NetworkInstability as NetworkInstability
    from .networks import NodeNotDissipative as NodeNotDissipative
    from .networks import NodeViolation as NodeViolation
    from .networks import NoWeights as NoWeights
    from .networks import OutWeightCertificate as OutWeightCertificate
    from .networks import feedback_interconnect as feedback_interconnect
    from .networks import scale_free_certificate as scale_free_certificate
    from .networks import stack as stack
    from .nonlinear import DifferentialCertificate as DifferentialCertificate
    from .nonlinear import differential_positivity as differential_positivity
    from .plotting import phase_portrait as phase_portrait
    from .plotting import plot_closed_loop as plot_closed_loop
    from .plotting import plot_cone as plot_cone
    from .plotting import plot_network as plot_network
    from .plotting import plot_poles as plot_poles
    from .plotting import plot_tradeoff as plot_tradeoff

__version__ = "0.1.0"

# Rooms that are imported when one of their names is first used: `import control_kpos` is to cost little
# more than `import control`.
_ON_DEMAND = {
    name: room
    for room, names in {
        ".find": (
            "CodesignResult",
            "ConeCertificate",
            "FoundCone",
            "design_cone_and_feedback",
            "find_cone",
        ),
        ".networks": (
            "AbscissaCertificate",
            "AlgebraicLoop",
            "ConeNetwork",
            "CouplingViolation",
            "NetworkCertificate",
            "NetworkInstability",
            "NodeNotDissipative",
            "NodeViolation",
            "NoWeights",
            "OutWeightCertificate",
            "feedback_interconnect",
            "scale_free_certificate",
            "stack",
        ),
        ".nonlinear": (
            "DifferentialCertificate",
            "differential_positivity",
        ),
        ".plotting": (
            "phase_portrait",
            "plot_closed_loop",
            "plot_cone",
            "plot_network",
            "plot_poles",
            "plot_tradeoff",
        ),
        ".design": (
            "DesignResult",
            "Tradeoff",
            "gain_rate_tradeoff",
            "network_feedback",
            "observer_gain",
            "output_feedback",
            "scale_free_feedback",
            "state_feedback",
        ),
    }.items()
    for name in names
}


def __getattr__(name: str) -> Any:
    if name not in _ON_DEMAND:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_ON_DEMAND[name], __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_ON_DEMAND})
