"""Gains that place real distinct poles, with eigenvectors far from dependent.

With U the complement of the range of B, x is an eigenvector of some A + B F for the pole p if and only if
U'(A - p I) x = 0.  Each of the n eigenvectors is chosen in its subspace as orthogonal as possible to the others, in
turns (Kautsky, Nichols and van Dooren, Robust pole assignment in linear state feedback, 1985, method 0).  The inverse
of the matrix of eigenvectors follows every change by a rank-one update, so that a turn costs n^3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...exact.budget import spend

Array = NDArray[np.float64]

_TURNS = 10
_TINY = 1e-12
# Condition of the eigenvectors beyond which the poles of A + B F are anywhere.
_WORST = 1e15
# Operations on the subspaces, divided by n^4.
_PER_STEP = 1.5


def placed(A: Array, B: Array, poles: Array) -> Array | None:
    """F for which A + B F has the poles, or None if (A, B) does not allow it in floating point.

    Parameters
    ----------
    A, B : ndarray, shapes (n, n), (n, m)
    poles : ndarray, shape (n,)
        Real, distinct.

    Raises
    ------
    OutOfBudgetError
        If the effort left is too little for it.

    Notes
    -----
    n factorisations of n x n matrices: 30 ms for 60 states.

    Examples
    --------
    >>> F = placed(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([-1.0, -2.0]))
    >>> F.round(9)
    array([[-1., -3.]])
    """
    n = len(A)
    spend(_PER_STEP * n**4)
    try:
        with np.errstate(all="ignore"):
            X = _far_apart(_subspaces(A, B, poles))
            if not np.linalg.cond(X) < _WORST:
                return None
            F = np.linalg.pinv(B, rcond=_TINY) @ (np.linalg.solve(X.T, (X * poles).T).T - A)
    except np.linalg.LinAlgError:
        return None
    return F if np.isfinite(F).all() else None


def _subspaces(A: Array, B: Array, poles: Array) -> Array:
    """Orthonormal bases of the eigenvectors that each pole may have, shape (n, n, r), r the rank of B."""
    n = len(A)
    left, sizes, _ = np.linalg.svd(B, full_matrices=True)
    rank = int((sizes > _TINY * sizes.max(initial=0.0)).sum())
    if rank == n:
        return np.broadcast_to(np.eye(n), (n, n, n))
    shifted = A - poles[:, None, None] * np.eye(n)
    normal = np.swapaxes(left[:, rank:].T @ shifted, 1, 2)
    return np.linalg.qr(normal, mode="complete")[0][:, :, n - rank :]


def _far_apart(bases: Array) -> Array:
    """One vector of length 1 of each subspace, as columns; the best of several turns."""
    n, _, rank = bases.shape
    X = np.einsum("kir,kr->ik", bases, np.random.default_rng(0).standard_normal((n, rank)))
    X = X / np.linalg.norm(X, axis=0)
    best, least = X, np.inf
    for _ in range(_TURNS):
        inverse = np.linalg.inv(X)
        size = float(np.linalg.norm(inverse))
        if not size < least * (1 - 1e-3):
            break
        best, least = X.copy(), size
        for k in range(n) if rank > 1 else ():
            x = bases[k] @ (bases[k].T @ inverse[k])
            length = np.linalg.norm(x)
            if not length > _TINY * np.linalg.norm(inverse[k]):
                continue
            x = x / length
            change = inverse @ (x - X[:, k])
            if not abs(1 + change[k]) > _TINY:
                continue
            inverse = inverse - np.outer(change / (1 + change[k]), inverse[k])
            X[:, k] = x
    return best
