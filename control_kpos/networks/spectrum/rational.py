"""Certificates of small networks found in rational arithmetic.

From (v, r) with v'A + r'W C < 0 and v'B + r'W D - r' < 0 on the generators, q = -W'r completes the data of Theorem 4.
From (x, u) with A x + B u in X and W(C x + D u) - u in U, the output y = C x + D u completes a witness.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from ...exact.rational_programs import primitive_fractions
from ...proof.weights import product
from .. import conditions as on
from ..certificate import NetworkCertificate, per_node
from ..model import NetworkModel
from ..witnesses import (
    AlgebraicLoop,
    LoopWeights,
    NetworkInstability,
    with_exact,
)
from .small import (
    EXACT_SIZE,
    ExactNetwork,
    Outcome,
    Rationals,
)


def certify_exactly(model: NetworkModel, loop: LoopWeights) -> NetworkCertificate:
    """Decide Theorem 4 for a positive network of at most `exact.EXACT_SIZE` states and inputs.

    Parameters
    ----------
    model : NetworkModel
        Nodes are positive, and W maps Y into U.
    loop : tuple or None
        Proof that the algebraic loop contracts, if one is known.

    Returns
    -------
    NetworkCertificate
        UNDECIDED for larger networks, and where cones that are not simplicial ask for programs too long.
    """
    if sum(model.totals[:2]) > EXACT_SIZE:
        return NetworkCertificate.settle(model=model, loop_weights=loop)
    network = ExactNetwork(model)
    if model.has_feedthrough and loop is None:
        direct = network.decide_loop()
        if direct is None or not direct.stable:
            witness = None if direct is None else _algebraic(model, direct.port)
            return NetworkCertificate.settle(model=model, witness=witness)
        loop = _loop_weights(model, direct.port)
    least = 1.0 if model.discrete else 0.0
    found = network.decide(least)
    if found is None:
        return NetworkCertificate.settle(model=model, loop_weights=loop)
    if found.stable:
        sigma = np.ones(model.n_nodes)
        return NetworkCertificate.settle(model=model, **_falling(model, found), sigma=sigma, loop_weights=loop)
    return NetworkCertificate.settle(model=model, loop_weights=loop, witness=_growing(model, found, least))


def bracket_exactly(model: NetworkModel, relative: float, loop: LoopWeights) -> dict[str, Any] | None:
    """Both sides of a bracket of the spectral abscissa, as fields of an `AbscissaCertificate`; None if too long.

    Parameters
    ----------
    model : NetworkModel
        Positive, and with an algebraic loop that contracts.
    relative : float
        Width of the bracket, relative to the abscissa or to 2^-40 of the size of A, whichever is larger.
    loop : tuple or None
        Proof that the algebraic loop contracts.
    """
    if sum(model.totals[:2]) > EXACT_SIZE:
        return None
    network = ExactNetwork(model)
    about = network.estimate()
    if not np.isfinite(about):
        return None
    tiny = 2.0**-40 * max(float(np.abs(s.A.values).max()) for s in model.stacks) + 1e-300
    ends: dict[bool, tuple[float, Outcome]] = {}
    step = 0.4 * relative * max(abs(about), tiny)
    for _ in range(200):
        if len(ends) == 2:
            lower, upper = ends[False][0], ends[True][0]
            at = 0.5 * (lower + upper)
            if upper - lower <= relative * max(abs(at), tiny) or at in (lower, upper):
                break
        elif not ends:
            at = about + step
        else:  # outwards until the other side is found
            at, step = (about - step, 8 * step) if True in ends else (about + step, 8 * step)
        found = network.decide(at)
        if found is None:
            return None
        ends[found.stable] = at, found
    if len(ends) < 2:
        return None
    (lower, below), (upper, above) = ends[False], ends[True]
    sides = {**_falling(model, above), "below": _growing(model, below, lower)}
    return {"lower": lower, "upper": upper, **sides, "loop_weights": loop}


def _falling(model: NetworkModel, found: Outcome) -> dict[str, Any]:
    """v, r, q and exact of a stable outcome."""
    v, r = found.state, found.port
    size = Fraction(2) ** _exponent(max(abs(value) for value in v))
    vectors, exact = with_exact((v / size, r / size, _asked(model, -r) / size))
    v_, r_, q_ = (per_node(part, model, kind) for kind, part in enumerate(vectors))
    return {"v": v_, "r": r_, "q": q_, "exact": exact}


def _growing(model: NetworkModel, found: Outcome, rate: float) -> NetworkInstability:
    x, u = _together(found.state, found.port)
    (x_, u_, y_), exact = with_exact((x, u, _outputs(model, x, u)))
    return NetworkInstability(x_, u_, y_, rate, exact)


def _algebraic(model: NetworkModel, port: Rationals) -> AlgebraicLoop:
    (u,) = _together(port)
    (y_, u_), exact = with_exact((_outputs(model, None, u), u))
    return AlgebraicLoop(y_, u_, np.unique(model.owners(2)[y_ != 0]), exact)


def _loop_weights(model: NetworkModel, t: Rationals) -> LoopWeights:
    """p = W't and a little of int Y*, as much as (t' - t'W D) u leaves room for."""
    p = _asked(model, t)
    inner = model.join([np.tile(_row_sum(on.facets(s.Y)), (len(s), 1)) for s in model.stacks], 2)
    share = Fraction(1)
    for s, p_g, e_g, t_g in zip(model.stacks, model.split(p, 2), model.split(inner, 2), model.split(t, 1), strict=True):
        D, rays = s.D.fractions(), on.rays(s.U)
        rows = rays.rows_as_integers(np.arange(rays.shape[0])).T
        spare = (t_g - (p_g[:, None, :] @ D)[:, 0]) @ rows
        cost = (e_g[:, None, :] @ D)[:, 0] @ rows
        share = min([share, *(a / b for a, b in zip(spare.ravel(), cost.ravel(), strict=True) if b > 0)])
    p = p + inner * share
    return tuple(map(Fraction, p)), tuple(map(Fraction, t))


def _row_sum(rows: Any) -> Rationals:
    return rows.rows_as_integers(np.arange(rows.shape[0])).sum(axis=0)


def _outputs(model: NetworkModel, x: Rationals | None, u: Rationals) -> Rationals:
    """C x + D u."""
    parts = []
    for s, (own, ports, _) in zip(model.stacks, model.places, strict=True):
        y = (s.D.fractions() @ u[ports][:, :, None])[:, :, 0]
        parts.append(y if x is None else y + (s.C.fractions() @ x[own][:, :, None])[:, :, 0])
    return model.join(parts, 2)


def _asked(model: NetworkModel, r: Rationals) -> Rationals:
    """W'r."""
    return product(model.coupling.T, r)


def _together(*vectors: Rationals) -> list[Rationals]:
    """Vectors times one number, so that they are integers of the size of doubles if they can be."""
    joint = primitive_fractions(np.concatenate(vectors))
    joint = joint / Fraction(2) ** max(0, _exponent(max(abs(value) for value in joint)) - 900)
    return np.split(joint, np.cumsum([len(vector) for vector in vectors])[:-1])


def _exponent(value: Any) -> int:
    value = Fraction(value)
    return value.numerator.bit_length() - value.denominator.bit_length()
