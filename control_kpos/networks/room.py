"""Which links a new node may have: the room that a certificate leaves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from ..cones import Cone
from ..errors import ConeMismatchError
from ..exact.condition import all_hold
from ..exact.matrix import Matrix
from . import conditions as on
from .blocks import Floats, inverse
from .edits import Overlay, shaped_link
from .model import NetworkModel, NodeStack


def room_for(
    overlay: Overlay, stack: NodeStack, incoming: Mapping[int, object], outgoing: Mapping[int, object]
) -> float:
    """The largest product a b of weights for which a new node on links a L_k in and b L_j out is covered.

    With h' = b sum_j r_j'L_j for the targets j and G = C (-A)^{-1} B (C (I - A)^{-1} B in discrete time), the new node
    charges its source k with a h'G L_k y, which the slack of the decrease at k has to cover at every generator of X_k.

    Parameters
    ----------
    overlay : Overlay
    stack : NodeStack
        One node.
    incoming, outgoing : mapping of int to array_like
        L_k, shape (m, q_k), by identity of the source; L_j, shape (m_j, q), by identity of the target.

    Returns
    -------
    float
        0 if the certificate does not hold, the node is not positive or not stable, or a link leaves the cones; inf if
        no loop through the network arises.
    """
    m, q = stack.sizes[1:]
    into = {k: shaped_link(w, m, overlay.node(k).stack.sizes[2], f"sources[{k}]") for k, w in incoming.items()}
    out_of = {j: shaped_link(w, overlay.node(j).stack.sizes[1], q, f"targets[{j}]") for j, w in outgoing.items()}
    with_feedthrough = [f"node {k}" for k in into if not overlay.node(k).stack.D.is_zero]
    if with_feedthrough or not stack.D.is_zero:
        raise ConeMismatchError(
            f"{', '.join(with_feedthrough) or 'system'} has feedthrough D, so that charges pass on to further nodes at "
            "once; room_for covers D = 0. Try with_node instead."
        )
    discrete = overlay.base.model.discrete
    alone = NetworkModel((stack,), (np.array([0]),), Matrix(sp.csr_array((m, q))), stack.dt)
    K = inverse(float(discrete) * np.eye(stack.sizes[0]) - stack.A.values)[0]
    stable = bool((stack.X.rays @ (np.asarray(stack.X.dual.interior_point) @ K) > 0).all())
    fits = all(_maps(w, overlay.node(k).stack.Y, stack.U) for k, w in into.items()) and all(
        _maps(w, stack.Y, overlay.node(j).stack.U) for j, w in out_of.items()
    )
    if not (overlay.covered and stable and fits and all_hold(on.positivity(alone, 0))):
        return 0.0
    h = sum((overlay.node(j).r @ w for j, w in out_of.items()), np.zeros(q))
    price = h @ stack.C.values[0] @ K @ stack.B.values[0]
    room = np.inf
    for k, w in into.items():
        local = overlay.node(k)
        s = local.stack
        slack = -on.decrease_forms(s, local.v[None], local.q[None], 0.0, discrete).values[0, 0]
        charged = s.X.rays @ (price @ w @ s.C.values[0])
        with np.errstate(divide="ignore"):
            room = min(room, float(np.where(charged > 0, slack / charged, np.inf).min()))
    return 0.999 * room


def _maps(link: Floats, source: Cone, target: Cone) -> bool:
    return bool((target.facets @ link @ source.rays.T >= 0).all())
