"""Nonlinear systems that keep a cone of displacements."""

from .certificate import DifferentialCertificate as DifferentialCertificate
from .certificate import DifferentialViolation as DifferentialViolation
from .differential import differential_positivity as differential_positivity
