"""Modes that no feedback can move: eigenvalues s with rank [A - s I, B] < n (Hautus), for messages only."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..exact.budget import affords
from .plant import Plant

_RANK = 1e-10
# Operations of a singular value decomposition, for each entry and row.
_EFFORT = 10.0


def controllability_notes(plant: Plant) -> list[str]:
    """One sentence for each uncontrollable mode of the nominal plant, as far as the effort allows.

    In floating point: advice, no proof.
    """
    A, B = plant.pairs[0]
    effort = plant.n**2 * (plant.n + plant.m) * _EFFORT
    if not affords(effort):
        return []
    scale = max(np.abs(A).max(), np.abs(B).max(initial=0.0), np.finfo(float).tiny)
    with suppress(np.linalg.LinAlgError):
        modes = np.unique(np.round(np.linalg.eigvals(A) / scale, 9)) * scale
        upper = (mode for mode in modes if mode.imag >= 0 and affords(effort))
        return [_note(mode, plant) for mode in upper if _loses_rank(np.hstack([A - mode * np.eye(plant.n), B]))]
    return []


def _loses_rank(M: NDArray[Any]) -> bool:
    """The smallest singular value is rounding."""
    sizes = np.linalg.svd(M, compute_uv=False)
    return not sizes[-1] > _RANK * sizes[0]


def _note(mode: Any, plant: Plant) -> str:
    bad = abs(mode) >= 1 if plant.discrete else mode.real >= 0
    name = f"{mode.real:.4g}" if mode.imag == 0 else f"{mode.real:.4g} +/- {mode.imag:.4g}j"
    consequence = (
        "it is not stable, so no feedback stabilises this plant, as far as eigenvalues in floating point can tell; "
        "change the actuators"
        if bad
        else "it is stable and stays as it is, which limits the decay rate but not the design"
    )
    return f"The mode {name} is not controllable: {consequence}."
