"""Finding invariant cones: for one matrix, with inputs and outputs, for a family, with feedback."""

from .certificate import ConeCertificate as ConeCertificate
from .certificate import Obstruction as Obstruction
from .feedback.search import CodesignResult as CodesignResult
from .feedback.search import design_cone_and_feedback as design_cone_and_feedback
from .find import find_cone as find_cone
from .result import FoundCone as FoundCone
