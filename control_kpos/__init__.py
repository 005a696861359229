"""Analysis and design of cone-invariant (K-positive) linear systems on top of python-control."""

from . import arrays as arrays
from .certificates.files import load_certificate as load_certificate
from .certificates.result import Certificate as Certificate
from .certificates.result import Status as Status
from .cones import Cone as Cone
from .cones import PolyhedralCone as PolyhedralCone
from .cones import lorentz as lorentz
from .cones import orthant as orthant
from .cones import product as product
from .dissipativity import DissipativityCertificate as DissipativityCertificate
from .dissipativity import SupplyViolation as SupplyViolation
from .dissipativity import dissipativity as dissipativity
from .dissipativity import induced_gain as induced_gain
from .errors import CertificateFileError as CertificateFileError
from .errors import ConeMismatchError as ConeMismatchError
from .errors import DataError as DataError
from .errors import KposError as KposError
from .errors import NotProperConeError as NotProperConeError
from .errors import ShapeError as ShapeError
from .errors import SolverError as SolverError
from .errors import TimebaseError as TimebaseError
from .errors import TooLargeError as TooLargeError
from .errors import UndecidedError as UndecidedError
from .positivity import PositivityCertificate as PositivityCertificate
from .positivity import PositivityViolation as PositivityViolation
from .positivity import cone_positivity as cone_positivity
from .positivity import state_positivity as state_positivity
from .stability import InstabilityDirection as InstabilityDirection
from .stability import LyapunovCertificate as LyapunovCertificate
from .stability import linear_lyapunov as linear_lyapunov
from .statespace import ConeStateSpace as ConeStateSpace

__version__ = "0.1.0"
