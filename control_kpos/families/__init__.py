"""Families of systems: arbitrary switching, its growth, and what refutes it."""

from .common_vector import CommonVectorCertificate, NoCommonVector
from .dwell import DwellCertificate, DwellCycle
from .switched import Switching, switched
from .switching import CycleOfGrowth, NextModeCertificate, SwitchingCertificate, UnstableMixture

__all__ = [
    "CommonVectorCertificate",
    "CycleOfGrowth",
    "DwellCertificate",
    "DwellCycle",
    "NextModeCertificate",
    "NoCommonVector",
    "Switching",
    "SwitchingCertificate",
    "UnstableMixture",
    "switched",
]
