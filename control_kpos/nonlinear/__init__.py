"""Nonlinear systems and networks that keep a cone of displacements."""

from .certificate import DifferentialCertificate, DifferentialViolation
from .contraction import DifferentialNetworkCertificate, OrderViolation
from .differential import differential_positivity
from .network import NonlinearNetwork, nonlinear_interconnect
from .nodes import Links, NonlinearNodes, nonlinear_links, nonlinear_nodes

__all__ = [
    "DifferentialCertificate",
    "DifferentialNetworkCertificate",
    "DifferentialViolation",
    "Links",
    "NonlinearNetwork",
    "NonlinearNodes",
    "OrderViolation",
    "differential_positivity",
    "nonlinear_interconnect",
    "nonlinear_links",
    "nonlinear_nodes",
]
