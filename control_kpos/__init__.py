"""Analysis and design of cone-invariant (K-positive) linear systems on top of python-control."""

import importlib
from typing import TYPE_CHECKING, Any

from . import examples
from .cones import Cone, PolyhedralCone, lorentz, orthant, product
from .errors import (
    ActuatorLossWarning,
    CertificateFileError,
    ConeMismatchError,
    DataError,
    FalseClaimError,
    KposError,
    NotProperConeError,
    ShapeError,
    SolverError,
    TimebaseError,
    TooLargeError,
    UndecidedError,
)
from .proof.certificate import Certificate, Status
from .proof.files import load_certificate
from .proof.inclusion import PlaneViolation, PositivityViolation
from .systems.statespace import ConeStateSpace
from .theorems.compartments import CompartmentalCertificate, Trap
from .theorems.dissipativity import DissipativityCertificate, SupplyViolation, dissipativity
from .theorems.gains import induced_gain
from .theorems.growing_direction import InstabilityCombination, InstabilityDirection
from .theorems.positivity import PositivityCertificate, cone_positivity, state_positivity
from .theorems.robust_margin import RobustMargin, robust_margin, structured_gain
from .theorems.stability import LyapunovCertificate, linear_lyapunov
from .theorems.structured_gain import StructuredGainCertificate

if TYPE_CHECKING:
    from . import shards
    from .data import (
        DataAnswer,
        DataCertificate,
        ExcludingPlants,
        LeavingPlant,
        data_feedback,
        data_positivity,
    )
    from .design import (
        DesignResult,
        FiniteCostCertificate,
        NetworkIntervalCertificate,
        OptimalCostCertificate,
        OptimalFeedback,
        OrderInterval,
        OrderIntervalCertificate,
        Tradeoff,
        gain_rate_tradeoff,
        network_feedback,
        observer_gain,
        optimal_feedback,
        order_interval,
        output_feedback,
        scale_free_feedback,
        state_feedback,
    )
    from .families import (
        CommonVectorCertificate,
        CycleOfGrowth,
        DelayCertificate,
        DwellCertificate,
        DwellCycle,
        FailingTerm,
        MeanDirection,
        MeanStabilityCertificate,
        NextModeCertificate,
        NoCommonVector,
        StabilisingCertificate,
        Switching,
        SwitchingCertificate,
        UnstableMixture,
        delayed,
        switched,
    )
    from .find import (
        CodesignResult,
        ConeCertificate,
        FoundCone,
        NegativeResponse,
        PositiveRealization,
        PositiveRealizationCertificate,
        design_cone_and_feedback,
        find_cone,
        positive_realization,
    )
    from .networks import (
        AbscissaCertificate,
        AlgebraicLoop,
        BoundedNetworkCertificate,
        Compartments,
        ConeNetwork,
        CouplingViolation,
        DelayedNetworkCertificate,
        FailingEnd,
        FailingMember,
        NetworkCertificate,
        NetworkInstability,
        NoCommonStorage,
        NoCommonVectors,
        NodeNotDissipative,
        NodeViolation,
        NoWeights,
        OutWeightCertificate,
        UncertainNetworkCertificate,
        compartmental,
        feedback_interconnect,
        interval,
        largest_uncertainty,
        scale_free_certificate,
        stack,
    )
    from .nonlinear import (
        DifferentialCertificate,
        DifferentialNetworkCertificate,
        NonlinearNetwork,
        OrderViolation,
        differential_positivity,
        nonlinear_interconnect,
        nonlinear_links,
        nonlinear_nodes,
    )
    from .observers import (
        IntervalObserver,
        IntervalObserverCertificate,
        NetworkObserverCertificate,
        interval_observer,
    )
    from .plotting import (
        phase_portrait,
        plot_closed_loop,
        plot_cone,
        plot_network,
        plot_observer,
        plot_poles,
        plot_responses,
        plot_tradeoff,
    )

__version__ = "0.1.0"

__all__ = [
    "AbscissaCertificate",
    "ActuatorLossWarning",
    "AlgebraicLoop",
    "BoundedNetworkCertificate",
    "Certificate",
    "CertificateFileError",
    "CodesignResult",
    "CommonVectorCertificate",
    "CompartmentalCertificate",
    "Compartments",
    "Cone",
    "ConeCertificate",
    "ConeMismatchError",
    "ConeNetwork",
    "ConeStateSpace",
    "CouplingViolation",
    "CycleOfGrowth",
    "DataAnswer",
    "DataCertificate",
    "DataError",
    "DelayCertificate",
    "DelayedNetworkCertificate",
    "DesignResult",
    "DifferentialCertificate",
    "DifferentialNetworkCertificate",
    "DissipativityCertificate",
    "DwellCertificate",
    "DwellCycle",
    "ExcludingPlants",
    "FailingEnd",
    "FailingMember",
    "FailingTerm",
    "FalseClaimError",
    "FiniteCostCertificate",
    "FoundCone",
    "InstabilityCombination",
    "InstabilityDirection",
    "IntervalObserver",
    "IntervalObserverCertificate",
    "KposError",
    "LeavingPlant",
    "LyapunovCertificate",
    "MeanDirection",
    "MeanStabilityCertificate",
    "NegativeResponse",
    "NetworkCertificate",
    "NetworkInstability",
    "NetworkIntervalCertificate",
    "NetworkObserverCertificate",
    "NextModeCertificate",
    "NoCommonStorage",
    "NoCommonVector",
    "NoCommonVectors",
    "NoWeights",
    "NodeNotDissipative",
    "NodeViolation",
    "NonlinearNetwork",
    "NotProperConeError",
    "OptimalCostCertificate",
    "OptimalFeedback",
    "OrderInterval",
    "OrderIntervalCertificate",
    "OrderViolation",
    "OutWeightCertificate",
    "PlaneViolation",
    "PolyhedralCone",
    "PositiveRealization",
    "PositiveRealizationCertificate",
    "PositivityCertificate",
    "PositivityViolation",
    "RobustMargin",
    "ShapeError",
    "SolverError",
    "StabilisingCertificate",
    "Status",
    "StructuredGainCertificate",
    "SupplyViolation",
    "Switching",
    "SwitchingCertificate",
    "TimebaseError",
    "TooLargeError",
    "Tradeoff",
    "Trap",
    "UncertainNetworkCertificate",
    "UndecidedError",
    "UnstableMixture",
    "__version__",
    "compartmental",
    "cone_positivity",
    "data_feedback",
    "data_positivity",
    "delayed",
    "design_cone_and_feedback",
    "differential_positivity",
    "dissipativity",
    "examples",
    "feedback_interconnect",
    "find_cone",
    "gain_rate_tradeoff",
    "induced_gain",
    "interval",
    "interval_observer",
    "largest_uncertainty",
    "linear_lyapunov",
    "load_certificate",
    "lorentz",
    "network_feedback",
    "nonlinear_interconnect",
    "nonlinear_links",
    "nonlinear_nodes",
    "observer_gain",
    "optimal_feedback",
    "order_interval",
    "orthant",
    "output_feedback",
    "phase_portrait",
    "plot_closed_loop",
    "plot_cone",
    "plot_network",
    "plot_observer",
    "plot_poles",
    "plot_responses",
    "plot_tradeoff",
    "positive_realization",
    "product",
    "robust_margin",
    "scale_free_certificate",
    "scale_free_feedback",
    "shards",
    "stack",
    "state_feedback",
    "state_positivity",
    "structured_gain",
    "switched",
]

# Folders that are imported when one of their names is first used: `import control_kpos` is to cost little
# more than `import control`.
_ON_DEMAND = {
    name: room
    for room, names in {
        ".design": (
            "DesignResult FiniteCostCertificate NetworkIntervalCertificate OptimalCostCertificate OptimalFeedback "
            "OrderInterval OrderIntervalCertificate Tradeoff gain_rate_tradeoff network_feedback observer_gain "
            "optimal_feedback order_interval output_feedback scale_free_feedback state_feedback"
        ),
        ".data": "DataAnswer DataCertificate ExcludingPlants LeavingPlant data_feedback data_positivity",
        ".families": (
            "CommonVectorCertificate CycleOfGrowth DelayCertificate DwellCertificate DwellCycle FailingTerm "
            "MeanDirection MeanStabilityCertificate NextModeCertificate NoCommonVector StabilisingCertificate "
            "Switching SwitchingCertificate UnstableMixture delayed switched"
        ),
        ".find": (
            "CodesignResult ConeCertificate FoundCone NegativeResponse PositiveRealization "
            "PositiveRealizationCertificate design_cone_and_feedback find_cone positive_realization"
        ),
        ".networks": (
            "AbscissaCertificate AlgebraicLoop BoundedNetworkCertificate Compartments ConeNetwork CouplingViolation "
            "DelayedNetworkCertificate FailingEnd FailingMember NetworkCertificate NetworkInstability "
            "NoCommonStorage NoCommonVectors NoWeights NodeNotDissipative NodeViolation OutWeightCertificate "
            "UncertainNetworkCertificate compartmental feedback_interconnect interval largest_uncertainty "
            "scale_free_certificate stack"
        ),
        ".nonlinear": (
            "DifferentialCertificate DifferentialNetworkCertificate NonlinearNetwork OrderViolation "
            "differential_positivity nonlinear_interconnect nonlinear_links nonlinear_nodes"
        ),
        ".observers": "IntervalObserver IntervalObserverCertificate NetworkObserverCertificate interval_observer",
        ".plotting": (
            "phase_portrait plot_closed_loop plot_cone plot_network plot_observer plot_poles plot_responses "
            "plot_tradeoff"
        ),
        ".shards": "shards",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:
    if name not in _ON_DEMAND:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room = importlib.import_module(_ON_DEMAND[name], __name__)
    value = room if _ON_DEMAND[name] == f".{name}" else getattr(room, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
