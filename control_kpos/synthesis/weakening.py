"""How much of its effect a gain may lose before the proof no longer holds.

All inequalities of a certificate are linear in the fraction s of the gain that acts, A + s B F, so the
fractions covered by one and the same Lyapunov vector form an interval that ends at 1, in closed form.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..stability import LyapunovCertificate
from .acceptance import Accepted
from .plant import Floats, Plant

# Distance kept from the end of the interval, which is computed in floating point.
_GUARD = 1e-9


def certified_fraction(plant: Plant, found: Accepted) -> float:
    """Smallest s such that every fraction in [s, 1] keeps X invariant and the same v decreasing."""
    F = found.F if plant.C is None else found.F @ np.asarray(plant.C.values)
    loops: Any = getattr(found.certificate, "loops", (found.certificate,))
    extra = 0.0
    if plant.coupling is not None:
        loops = [c for c in found.certificate.parts() if isinstance(c, LyapunovCertificate)][-len(plant.A) :]
        extra = np.asarray(plant.coupling.values)
    ends = [0.0]
    for (A, B), loop in zip(plant.pairs, loops, strict=True):
        start, slope = plant.facets @ A @ plant.rays.T, plant.facets @ B @ F @ plant.rays.T
        ends.append(interval_start(start[plant.incidence], slope[plant.incidence]))
        drift = A + extra - (np.eye(plant.n) if plant.discrete else 0.0)
        v = np.asarray(loop.v)
        ends.append(interval_start(-(v @ drift @ plant.rays.T), -(v @ B @ F @ plant.rays.T)))
    return max(ends)


def interval_start(constant: Floats, slope: Floats) -> float:
    """Smallest s in [0, 1] with constant + t slope >= 0 for all t in [s, 1]; the value at 1 is known to be so."""
    return float(interval_starts(constant[None, :], slope[None, :])[0])


def interval_starts(constant: Floats, slope: Floats) -> Floats:
    """`interval_start` for each row."""
    size = np.abs(constant) + np.abs(slope)
    falling = constant < -1e-13 * size
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where(falling, -constant / slope * (1 + _GUARD), 0.0)
    return np.clip(np.nan_to_num(ends, nan=1.0, posinf=1.0).max(axis=1, initial=0.0), 0.0, 1.0)
