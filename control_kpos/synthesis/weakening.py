"""How much of its effect a gain may lose before the proof no longer holds.

All inequalities of a certificate are linear in the fraction s of the gain that acts, A + s B F, so the
fractions covered by one and the same Lyapunov vector form an interval that ends at 1, in closed form.
"""

from __future__ import annotations

import numpy as np

from .acceptance import Accepted
from .plant import Floats, Plant

# Distance kept from the end of the interval, which is computed in floating point.
_GUARD = 1e-9


def certified_fraction(plant: Plant, found: Accepted) -> float:
    """Smallest s such that every fraction in [s, 1] keeps X invariant and the same v decreasing."""
    F = found.F if plant.C is None else found.F @ np.asarray(plant.C.values)
    loops = getattr(found.certificate, "loops", (found.certificate,))
    ends = [0.0]
    for (A, B), loop in zip(plant.pairs, loops, strict=True):
        open_, slope = plant.facets @ A @ plant.rays.T, plant.facets @ B @ F @ plant.rays.T
        ends.append(interval_start(open_[plant.incidence], slope[plant.incidence]))
        shifted = A - np.eye(plant.n) if plant.discrete else A
        ends.append(interval_start(-(loop.v @ shifted @ plant.rays.T), -(loop.v @ B @ F @ plant.rays.T)))
    return max(ends)


def interval_start(constant: Floats, slope: Floats) -> float:
    """Smallest s in [0, 1] with constant + t slope >= 0 for all t in [s, 1]; the value at 1 is known to be so."""
    size = np.abs(constant) + np.abs(slope)
    falling = constant < -1e-13 * size
    if not falling.any():
        return 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -constant[falling] / slope[falling]
    return float(min(1.0, np.max(np.nan_to_num(ends, nan=1.0, posinf=1.0)) * (1 + _GUARD)))
