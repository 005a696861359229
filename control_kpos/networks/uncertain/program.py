"""Common vectors of Theorem 4 for all vertices on any cones, by linear programs; proposals that the kernel checks.

With w = (v, r), q = -W'r and L^s = [[A^s, B^s], [W C^s, W D^s - I]] (A^s - I in discrete time), common vectors and
loops that contract exist iff some w has w'z > 0 and w'L^s z < 0 for all generators z of X and U and all vertices s.
The alternative, x^s in X and u^s in U with a y between sum (C^s x^s + D^s u^s) and what brings sum u^s, is another
program.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...exact.programs import solve
from .. import conditions as on
from ..blocks import Floats
from ..certify import Data
from ..inwards import lower_outputs
from ..model import NetworkModel
from .members import Vertices
from .witnesses import NoCommonStorage

# Unknowns from which on the interior point method is faster.
_MANY = 2000
# Motions of a smaller margin are not tried; vectors are lifted into their cones by a part of the margin.
_LEAST, _LIFT = 1e-9, 1e-3


@np.errstate(all="ignore")
def common_vectors(models: Vertices) -> Data | None:
    """v, r and q = -W'r, less a few units in the last place; None if the solver finds none.  One sparse program."""
    first = models[0]
    Z = sp.csr_array(sp.block_diag([_rays(first, 0), _rays(first, 1)], format="csr"))
    size = abs(Z).max(axis=1).toarray().ravel()
    rows = [Z @ sp.csr_array(_large(m).T) for m in models]
    limits = np.concatenate([np.tile(-size, len(rows)), np.zeros(len(size))])
    cost = np.asarray(Z.sum(axis=0)).ravel()
    free = (np.full(len(cost), -np.inf), np.full(len(cost), np.inf))
    found = solve(cost, sp.csr_array(sp.vstack([*rows, -Z])), limits, bounds=free, method=_method(len(cost)))
    if not found:
        return None
    v, r = np.split(found.x, [first.totals[0]])
    return v, r, lower_outputs(first, r)


def loops_of(models: Vertices, r: Floats) -> tuple[Floats, Floats]:
    """p and t from the r of such a program: W'r and a little of int Y*, and r itself."""
    first = models[0]
    e = first.at_all([s.Y.dual.interior_point for s in first.stacks], 2)
    U = _rays(first, 1)
    room = U @ r - np.max([U @ m.times("D", first.WT @ r, transposed=True) for m in models], axis=0)
    used = np.max([U @ m.times("D", e, transposed=True) for m in models], axis=0)
    part = np.where(used > 0, room / used, np.inf).min(initial=1.0)
    return first.WT @ r + 0.5 * max(float(part), 0.0) * e, r


@np.errstate(all="ignore")
def growing_motion(models: Vertices) -> NoCommonStorage | None:
    """x^s, u^s and y that exclude common vectors, with room for rounding; None if there are none.  One program."""
    first = models[0]
    X, U = _rays(first, 0).T, _rays(first, 1).T
    eye = sp.eye_array(first.totals[0], format="csr") * float(first.discrete)
    blocks = [m.block_matrices for m in models]
    states = sp.hstack([*((A - eye) @ X for A, _, _, _ in blocks), *(B @ U for _, B, _, _ in blocks)])
    outputs = sp.hstack([*(C @ X for _, _, C, _ in blocks), *(D @ U for _, _, _, D in blocks)])
    inputs = sp.hstack([sp.csr_array((first.totals[1], len(models) * X.shape[1])), *([-U] * len(models))])
    y = {0: sp.csr_array((first.totals[0], first.totals[2])), 2: -sp.eye_array(first.totals[2]), 1: first.W}
    rows, size = [], []
    for kind, part in ((0, states), (2, outputs), (1, inputs)):
        H = _facets(first, kind)
        rows.append(-(H @ sp.csr_array(sp.hstack([part, y[kind]]))))
        size.append(np.asarray(abs(H).sum(axis=1)).ravel())
    M = sp.csr_array(sp.hstack([sp.vstack(rows), sp.csr_array(np.concatenate(size)[:, None])]))
    count, n = M.shape[1], len(models) * X.shape[1]
    weights = count - 1 - first.totals[2]
    lower, upper = np.zeros(count), np.full(count, np.inf)
    lower[weights:-1], upper[-1] = -np.inf, 1.0
    total, cost = np.where(np.arange(count) < n, 1.0, 0.0)[None], np.zeros(count)
    cost[-1] = -1.0
    found = solve(cost, M, np.zeros(M.shape[0]), total, [1.0], (lower, upper), method=_method(count))
    if not found or not found.x[-1] > _LEAST:
        return None
    lift = _LIFT * found.x[-1] / len(models)
    parts = np.split(np.maximum(found.x[:weights], 0.0), [n])
    x, u = (_lifted(G, part, len(models), lift) for G, part in zip((X, U), parts, strict=True))
    return NoCommonStorage(x, u, found.x[weights:-1])


def _lifted(G: Any, weights: Floats, count: int, lift: float) -> Floats:
    """Vectors of these weights at the generators, all of them a little larger, one vertex after the other."""
    small = lift / max(G.shape[1], 1) / max(float(abs(G).max()), 1.0) if G.shape[1] else 0.0
    return np.concatenate([G @ (part + small) for part in np.split(weights, count)])


def _large(model: NetworkModel) -> sp.csr_array:
    """L of one vertex."""
    A, B, C, D = model.block_matrices
    eye = sp.eye_array(model.totals[0], format="csr") * float(model.discrete)
    return sp.csr_array(sp.block_array([[A - eye, B], [model.W @ C, model.W @ D - sp.eye_array(model.totals[1])]]))


def _rays(model: NetworkModel, kind: int) -> sp.csr_array:
    cones = [((s.X, s.U, s.Y)[kind], s.rays[kind]) for s in model.stacks]
    return sp.csr_array(on.rows_of_product(model, cones, kind).values)


def _facets(model: NetworkModel, kind: int) -> sp.csr_array:
    cones = [(s.X, s.U, s.Y)[kind] for s in model.stacks]
    return sp.csr_array(on.rows_of_product(model, [(cone, on.facets(cone)) for cone in cones], kind).values)


def _method(unknowns: int) -> Any:
    return "simplex" if unknowns < _MANY else "ipm"
