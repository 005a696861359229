"""Rounding towards cones: a computed matrix, moved by a few units in the last place until M S lies in T.

Products, inverses and matrix exponentials are rounded.  If the true matrix maps a cone S into T and touches its
boundary, the computed one misses it by a rounding error every other time.  Among the doubles close to M,

    M + epsilon t s',   t in int T, s in int S*,

lies in the interior of what is wanted: h_k't > 0 for every facet of T and s'x_i > 0 for every generator of S.
The same move turns a flow x' = M x on the boundary of a cone inwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone, Orthant
from ..exact.matrix import Matrix
from ..proof.inclusion import Inclusion

# Sizes of epsilon tried, in units of the largest entry; thin cones need more than a rounding error.
_STEPS = tuple(2.0**k for k in range(-54, -28, 2))
# Up to here it is one.
LAST_DIGITS = 2.0**-46


def maps_into(M: Matrix, source: Cone, target: Cone, *, flow: bool = False) -> bool:
    """True if M source lies in target, by proven signs; with `flow`, if e^{Mt} keeps the source for t >= 0."""
    if not source.dim or not target.dim:
        return True
    if isinstance(source, Orthant) and isinstance(target, Orthant) and M.is_double:
        return bool((_inner(np.asarray(M.values), flow) >= 0).all())
    return Inclusion("A", target, M, source, flow).condition().verdict() is True


def rounded_into(
    M: NDArray[np.float64],
    source: Cone,
    target: Cone,
    *,
    flow: bool = False,
    size: float = 0.0,
    most: float = _STEPS[-1],
) -> NDArray[np.float64] | None:
    """The doubles close to M that map the source into the target, proven.

    Parameters
    ----------
    M : ndarray, shape (m, n)
    source, target : Cone
        In R^n and R^m.
    flow : bool
        True: e^{Mt} is to keep the source for t >= 0; the target is the source.
    size : float
        Of the numbers that M was computed from, if they were larger than its own: all of M may be rounding.
    most : float
        Largest epsilon, in units of the largest entry or of `size`.

    Returns
    -------
    ndarray, shape (m, n), or None
        M itself if it will do; None if nothing within `most`, by default 1e-9, does.
    """
    if maps_into(Matrix(M), source, target, flow=flow):
        return M
    size = max(size, float(np.abs(M).max()))
    if isinstance(source, Orthant) and isinstance(target, Orthant):  # keeps zeros
        inner = _inner(M, flow)
        return np.where(inner < 0, 0.0, M) if inner.min() >= -most * size else None
    inward = np.outer(target.interior_point, source.dual.interior_point)
    for step in (s for s in _STEPS if s <= most):
        moved = M + step * size * inward
        if maps_into(Matrix(moved), source, target, flow=flow):
            return moved
    return None


def round_towards(result: Any, model: Any, operands: Sequence[Any], **limits: float) -> bool:
    """Undo what rounding has done to a result of positive operands; False if it takes more than last digits."""
    X, U, Y = model.X, model.U, model.Y
    if X.dim != result.nstates:
        return True
    flow = not result.dt
    maps = [("A", X, X, flow), ("B", U, X, False), ("C", X, Y, False), ("D", U, Y, False)]
    missed = [
        (name, source, target, flow)
        for name, source, target, flow in maps
        if not maps_into(Matrix(getattr(result, name)), source, target, flow=flow)
    ]
    if not missed or not all(s.cone_positivity() for s in operands):
        return True
    # a direct term may be all that rounding left of the product of what goes in and out
    sizes = {"D": float(np.abs(result.C).max(initial=0.0) * np.abs(result.B).max(initial=0.0))}
    rounded = {
        name: rounded_into(getattr(result, name), *cones, flow=flow, size=sizes.get(name, 0.0), **limits)
        for name, *cones, flow in missed
    }
    for name, matrix in rounded.items():
        if matrix is not None:
            setattr(result, name, matrix)
    return all(matrix is not None for matrix in rounded.values())


def _inner(M: NDArray[np.float64], flow: bool) -> NDArray[np.float64]:
    """M, with a diagonal of zeros for a flow: these entries decide between orthants."""
    return M - np.diag(np.diag(M)) if flow else M
