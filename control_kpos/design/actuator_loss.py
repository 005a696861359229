"""How much of its effect an actuator may lose before the proof no longer holds.

All inequalities of a certificate are linear in the fraction s of the gain that acts, A + s B F, so the
fractions covered by one and the same Lyapunov vector form an interval that ends at 1, in closed form.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..networks.model import NetworkModel
from ..proof.certificate import exactly
from ..theorems.stability import LyapunovCertificate
from .accept import Accepted
from .plant import Floats, Plant

# Distance kept from the end of the interval, which is computed in floating point.
_GUARD = 1e-9


def certified_fraction(plant: Plant, found: Accepted) -> float:
    """Smallest s such that every fraction in [s, 1] keeps X invariant and the same v decreasing."""
    F = plant.on_states(found.F)
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
    ends = np.where(falling, -constant / slope * (1 + _GUARD), 0.0)
    return np.clip(np.nan_to_num(ends, nan=1.0, posinf=1.0).max(axis=1, initial=0.0), 0.0, 1.0)


def node_fractions(model: NetworkModel, gains: list[Floats], certificate: Any) -> tuple[Floats, Floats]:
    """Smallest fractions of the local gains that keep the node invariant, and the network certified, node by node.

    All nodes may be weakened at once.
    """
    v = exactly(certificate, "v").values
    block_b, block_c = model.block_matrices[1], model.block_matrices[2]
    received = block_c.T @ (model.WT @ (block_b.T @ v))
    invariant, certified = np.zeros(model.n_nodes), np.zeros(model.n_nodes)
    for s, index, F, v_j, c_j in zip(
        model.stacks, model.members, gains, model.split(v, 0), model.split(received, 0), strict=True
    ):
        rays = np.asarray(s.X.rays)
        facets = np.asarray(s.X.facets)
        A, BF = np.asarray(s.A.values), np.einsum("jam,jmb->jab", np.asarray(s.B.values), F)
        where = np.ones_like(s.X.incidence) if model.discrete else np.asarray(s.X.incidence)
        constant = np.einsum("ia,jab,kb->jik", facets, A, rays, optimize=True)[:, where]
        slope = np.einsum("ia,jab,kb->jik", facets, BF, rays, optimize=True)[:, where]
        drift = A - np.eye(s.sizes[0]) if model.discrete else A
        fall = -(np.einsum("ja,jab,kb->jk", v_j, drift, rays, optimize=True) + c_j @ rays.T)
        fall_slope = -np.einsum("ja,jab,kb->jk", v_j, BF, rays, optimize=True)
        invariant[index] = interval_starts(constant, slope)
        certified[index] = np.maximum(invariant[index], interval_starts(fall, fall_slope))
    return invariant, certified


def loss_of_positivity(model: NetworkModel, invariant: Floats, fraction: Floats) -> str:
    """What to warn of: the node whose invariance suffers first from a weaker gain."""
    if not invariant.any():
        return ""
    first = int(np.argmax(invariant))
    return (
        f"below {100 * fraction[first]:.4g} % of its local gain, {model.name_of(first)} is no longer certified to stay "
        "in its state cone, and then nothing is certified about the network; weakened gains break positivity at "
        f"{np.count_nonzero(invariant)} of {model.n_nodes} nodes (certified_fraction holds the limit of each)."
    )
