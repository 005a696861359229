"""BiCGSTAB for equations x - T x = b; untrusted, the caller checks what it finds."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..exact.sparse_integers import Floats


def bicgstab(T: Any, b: Floats, x: Floats, goal: float, limit: int) -> tuple[Floats, int]:
    """BiCGSTAB (van der Vorst, 1992) on x - T x = b; the iterate and the number of steps.

    Dot products avoid the threaded BLAS, which stalls on a busy machine at these sizes.
    """
    x = x.copy()
    r = b - (x - T @ x)
    if not norm(r) > goal:
        return x, 0
    shadow, p, rho = r.copy(), r.copy(), dot(r, r)
    for count in range(1, limit + 1):
        ahead = p - T @ p
        alpha = rho / dot(shadow, ahead)
        r -= alpha * ahead
        second = r - T @ r
        x += alpha * p
        if not np.any(second):  # half a step was enough
            return x, count
        omega = dot(second, r) / dot(second, second)
        x += omega * r
        r -= omega * second
        size = norm(r)
        if not size > goal:
            return x, count
        rho, before = dot(shadow, r), rho
        if not np.isfinite(size) or rho == 0 or omega == 0:
            return x, count
        p -= omega * ahead
        p *= (rho / before) * (alpha / omega)
        p += r
    return x, limit


def dot(a: Floats, b: Floats) -> np.float64:
    """The product of two vectors."""
    return np.float64(np.einsum("i,i->", a, b))


def norm(a: Floats) -> float:
    """The Euclidean norm."""
    return float(np.sqrt(dot(a, a)))
