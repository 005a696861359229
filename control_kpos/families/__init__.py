"""Families of systems: arbitrary, slow, random and state-dependent switching, what refutes it; systems with delays."""

from .chain import MeanDirection, MeanStabilityCertificate
from .common_vector import CommonVectorCertificate, NoCommonVector
from .delay_certificate import DelayCertificate, FailingTerm
from .delayed import delayed
from .dwell import DwellCertificate, DwellCycle
from .stabilising import StabilisingCertificate
from .switched import Switching, switched
from .switching import CycleOfGrowth, NextModeCertificate, SwitchingCertificate, UnstableMixture

__all__ = [
    "CommonVectorCertificate",
    "CycleOfGrowth",
    "DelayCertificate",
    "DwellCertificate",
    "DwellCycle",
    "FailingTerm",
    "MeanDirection",
    "MeanStabilityCertificate",
    "NextModeCertificate",
    "NoCommonVector",
    "StabilisingCertificate",
    "Switching",
    "SwitchingCertificate",
    "UnstableMixture",
    "delayed",
    "switched",
]
