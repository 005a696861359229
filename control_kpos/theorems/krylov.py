"""BiCGSTAB for equations x - T x = b; untrusted, the caller checks what it finds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..exact.budget import require_time
from ..exact.sparse_integers import Floats


def dot(a: Floats, b: Floats) -> np.float64:
    """The product of two vectors."""
    return np.float64(np.einsum("i,i->", a, b))


def norm(a: Floats) -> float:
    """The Euclidean norm."""
    return float(np.sqrt(dot(a, a)))


def bicgstab(
    T: Any,
    b: Floats,
    x: Floats,
    goal: float,
    limit: int,
    *,
    dot: Callable[[Floats, Floats], np.float64] = dot,
    keep: Callable[[Floats], None] | None = None,
) -> tuple[Floats, int]:
    """BiCGSTAB (van der Vorst, 1992) on x - T x = b; the iterate and the number of steps.

    Dot products avoid the threaded BLAS, which stalls on a busy machine at these sizes; `dot` may also be a sum over
    many processes.  `keep` is given every iterate.
    """
    x = x.copy()
    r = b - (x - T @ x)
    if not np.sqrt(dot(r, r)) > goal:
        return x, 0
    shadow, p, rho = r.copy(), r.copy(), dot(r, r)
    for count in range(1, limit + 1):
        require_time()
        ahead = p - T @ p
        alpha = rho / dot(shadow, ahead)
        r -= alpha * ahead
        second = r - T @ r
        x += alpha * p
        length = dot(second, second)
        if length == 0:  # half a step was enough
            return x, count
        omega = dot(second, r) / length
        x += omega * r
        r -= omega * second
        size = np.sqrt(dot(r, r))
        if not size > goal:
            return x, count
        rho, before = dot(shadow, r), rho
        if not np.isfinite(size) or rho == 0 or omega == 0:
            return x, count
        p -= omega * ahead
        p *= (rho / before) * (alpha / omega)
        p += r
        if keep is not None:
            keep(x)
    return x, limit
