"""Nonlinear systems that keep a cone of displacements."""

from .certificate import DifferentialCertificate, DifferentialViolation
from .differential import differential_positivity

__all__ = [
    "DifferentialCertificate",
    "DifferentialViolation",
    "differential_positivity",
]
