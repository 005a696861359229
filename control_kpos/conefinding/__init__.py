"""Finding invariant cones: for one matrix, with inputs and outputs, for a family, with feedback."""

from .certificate import ConeCertificate, Obstruction
from .find import find_cone
from .result import FoundCone

__all__ = ["ConeCertificate", "FoundCone", "Obstruction", "find_cone"]
