"""Errors and warnings that say which argument is wrong, what was found, and what to do.

All of them are `ValueError` subclasses: python-control's `feedback` swallows `TypeError` and
`AttributeError`, and a refused cone must never turn into a silently different result.
"""

__all__ = [
    "ActuatorLossWarning",
    "CertificateFileError",
    "ConeMismatchError",
    "DataError",
    "FalseClaimError",
    "KposError",
    "NotProperConeError",
    "ShapeError",
    "SolverError",
    "TimebaseError",
    "TooLargeError",
    "UndecidedError",
]


class KposError(ValueError):
    """Base class of the errors raised by control_kpos."""


class DataError(KposError):
    """An argument holds something that is not a finite real number."""


class ShapeError(KposError):
    """An argument has the wrong shape, or is empty."""


class NotProperConeError(KposError):
    """A cone that must be proper contains a line (not pointed) or has no interior (not solid)."""


class ConeMismatchError(KposError):
    """The sizes of cones, matrices or coupling do not fit together."""


class TimebaseError(KposError):
    """Systems with different sampling times were combined."""


class UndecidedError(KposError):
    """A question with a yes/no answer could not be settled by proof."""


class TooLargeError(KposError):
    """More is asked for than is affordable: a dense array of sparse data, or all facets of a cone with too many."""


class CertificateFileError(KposError):
    """A certificate file is damaged, hostile, or of an unknown version."""


class FalseClaimError(CertificateFileError):
    """A certificate file states a verdict that its data do not prove."""


class SolverError(KposError):
    """No usable solver, or one that is not installed."""


class ActuatorLossWarning(UserWarning):
    """A certified gain is safe only as long as its actuators keep most of their effect."""
