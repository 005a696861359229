"""Finding invariant cones: for one matrix, with inputs and outputs, for a family, with feedback."""

from .answer import FoundCone
from .certificate import ConeCertificate, Obstruction
from .feedback.search import CodesignResult, design_cone_and_feedback
from .find import find_cone
from .realization.certificate import NegativeResponse, PositiveRealizationCertificate
from .realization.search import PositiveRealization, positive_realization

__all__ = [
    "CodesignResult",
    "ConeCertificate",
    "FoundCone",
    "NegativeResponse",
    "Obstruction",
    "PositiveRealization",
    "PositiveRealizationCertificate",
    "design_cone_and_feedback",
    "find_cone",
    "positive_realization",
]
