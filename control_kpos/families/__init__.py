"""Families of systems: arbitrary, slow, random and state-dependent switching, its growth, and what refutes it."""

from .chain import MeanDirection, MeanStabilityCertificate
from .common_vector import CommonVectorCertificate, NoCommonVector
from .dwell import DwellCertificate, DwellCycle
from .stabilising import StabilisingCertificate
from .switched import Switching, switched
from .switching import CycleOfGrowth, NextModeCertificate, SwitchingCertificate, UnstableMixture

__all__ = [
    "CommonVectorCertificate",
    "CycleOfGrowth",
    "DwellCertificate",
    "DwellCycle",
    "MeanDirection",
    "MeanStabilityCertificate",
    "NextModeCertificate",
    "NoCommonVector",
    "StabilisingCertificate",
    "Switching",
    "SwitchingCertificate",
    "UnstableMixture",
    "switched",
]
