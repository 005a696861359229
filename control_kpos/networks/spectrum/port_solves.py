"""Linear solves with mu I - A_cl, reduced to the ports; untrusted, the caller checks them.

With K_j = (mu I - A_j)^{-1} and the transfer matrix G = D + C K B of all nodes (block-diagonal),

    (mu I - A_cl)' v = c   <=>   r = (W G)' r + B'K'c,   v = K'(c + C'W'r),
    (mu I - A_cl) x  = d   <=>   u = (W G) u + W C K d,  x = K (B u + d).

K-positive nodes make T = W G a nonnegative operator whose powers sum up iff mu exceeds the spectral
abscissa.  Far from it a few sweeps r <- T'r + b do.  Near it, graphs of small bandwidth (rings, chains,
ladders) are factored; the others (random graphs, where a factorisation fills in without bound) have
few isolated eigenvalues next to 1 and are left to BiCGSTAB and GMRES.  What BiCGSTAB does not solve on a graph that
lies nearly in a plane (grids, roads) is factored too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ...exact.budget import require_time
from ...theorems.krylov import bicgstab, dot, norm
from ...theorems.refinement import envelope
from ..blocks import Floats, Index, inverse, multiply
from ..model import NetworkModel

# A factorisation in a banded order may take this many entries for each unknown, or this many in all.
_ENVELOPE_PER_UNKNOWN = 40
_ENVELOPE_TOTAL = 2 * 10**6
# Unknowns up to which flat graphs are factored where Krylov methods do not end, and operations it takes per
# size^(3/2).
_FLAT, _FLAT_COST = 300_000, 30.0
_SWEEPS = 60
_ITERATIONS = 400
# Part of a solution that its residual may be for it to show that there is none.
_SINGULAR = 1e-6


Keep: TypeAlias = "Callable[[Floats], None] | None"
Dot: TypeAlias = Callable[[Floats, Floats], np.float64]


def largest(a: Floats) -> float:
    """The largest absolute value of the entries."""
    return float(np.abs(a).max(initial=0.0))


class Loop:
    """The equations r = T r + b and r = T'r + b with T = W G, for block-diagonal G: one stack (N, q, m) per stack."""

    def __init__(self, model: NetworkModel, G: list[Floats]) -> None:
        self.model, self.G = model, G
        self.iterations = 0
        self.iteration_limit = _ITERATIONS
        self.sweeps_only = False

    @cached_property
    def T(self) -> sp.csr_array:
        """W G, inputs to inputs."""
        W = self.model.W
        if self._is_scalar:
            return sp.csr_array((W.data * self.G[0].ravel()[W.indices], W.indices, W.indptr), shape=W.shape)
        return sp.csr_array(W @ self.model.blocks(self.G, 2, 1))

    @cached_property
    def TT(self) -> sp.csr_array:
        """T'."""
        W = self.model.WT
        if self._is_scalar:  # transposing a large sparse matrix costs more than several products with it
            scales = np.repeat(self.G[0].ravel(), np.diff(W.indptr))
            return sp.csr_array((W.data * scales, W.indices, W.indptr), shape=W.shape)
        return sp.csr_array(self.T.T)

    @property
    def _is_scalar(self) -> bool:
        """True if every G_j is a number and the nodes stand in their order."""
        return len(self.G) == 1 and self.G[0].shape[1:] == (1, 1) and self.model.is_ordered

    def solve(
        self, b: Floats, transposed: bool, tolerance: float = 1e-9, guess: Floats | None = None, near: bool = False
    ) -> Floats:
        """Solve r = T r + b, or r = T'r + b; the caller checks the result."""
        require_time()
        T = self.TT if transposed else self.T
        if not T.nnz or not np.any(b):
            return b.copy()
        with np.errstate(all="ignore"):
            if not near:
                r, converged, grows = sweep(T, b, tolerance)
                if converged:
                    return r
                if self.sweeps_only:
                    return np.full_like(b, np.nan)
                if grows:
                    self.iteration_limit = min(self.iteration_limit, _ITERATIONS // 8)
            if self.factors is not None:
                return self._direct(self.factors, T, b, transposed)
            known = self.model.__dict__
            if "_krylov_fails" not in known:
                start = b if guess is None else guess
                r, count = krylov(T, b, start, tolerance, self.iteration_limit - self.iterations)
                self.iterations += count
                if not is_flat(self.model) or norm(b - (r - T @ r)) <= tolerance * norm(b):
                    return r
                known["_krylov_fails"] = True  # at this shift, and at those that follow close by
            if self.flat_factors is None:
                return np.full_like(b, np.nan)
            return self._direct(self.flat_factors, T, b, transposed)

    @cached_property
    def factors(self) -> Any:
        """LU factors of I - T in a banded order, or None if the graph has none."""
        order = banded_order(self.model)
        return None if order is None else self._factored(order, "NATURAL")

    @cached_property
    def flat_factors(self) -> Any:
        """LU factors of I - T of a graph that lies nearly in a plane, in an order of least degrees, or None."""
        size = self.T.shape[0]
        require_time(_FLAT_COST * size**1.5)
        return self._factored(np.arange(size), "MMD_AT_PLUS_A")

    def _factored(self, order: Index, spec: str) -> Any:
        """LU factors in an order, which may be changed further, and the order."""
        if not np.isfinite(self.T.data).all():
            return None
        require_time()
        matrix = sp.csc_array(sp.eye_array(len(order), format="csr") - self.T)[order][:, order].tocsc()
        for threshold in (0.0, 1.0):  # M-matrices need no pivoting; anything else may
            try:
                return spla.splu(
                    matrix,
                    permc_spec=spec,
                    diag_pivot_thresh=threshold,
                    options={"SymmetricMode": threshold == 0.0},
                ), order
            except (RuntimeError, ValueError):  # exactly singular
                continue
        return None

    def _direct(self, factors: Any, T: sp.csr_array, b: Floats, transposed: bool) -> Floats:
        lu, order = factors
        r = np.empty_like(b)
        r[order] = lu.solve(b[order], "T" if transposed else "N")
        correction = np.empty_like(b)
        correction[order] = lu.solve((b - (r - T @ r))[order], "T" if transposed else "N")
        better = r + correction
        return better if np.isfinite(better).all() else r


class PortSystem:
    """The matrix mu I - A_cl of a network, ready to be solved with; the shift is mu."""

    def __init__(self, model: NetworkModel, shift: float) -> None:
        self.model, self.shift = model, float(shift)
        self.K = [inverse(self.shift * np.eye(s.sizes[0]) - s.A.values) for s in model.stacks]

    @cached_property
    def KB(self) -> list[Floats]:
        return [multiply(k, s.B.values) for k, s in zip(self.K, self.model.stacks, strict=True)]

    @cached_property
    def CK(self) -> list[Floats]:
        return [multiply(s.C.values, k) for k, s in zip(self.K, self.model.stacks, strict=True)]

    @cached_property
    def loop(self) -> Loop:
        """The port equations, with the transfer matrices G = D + C K B."""
        G = [s.D.values + multiply(s.C.values, kb) for kb, s in zip(self.KB, self.model.stacks, strict=True)]
        return Loop(self.model, G)

    @cached_property
    def is_finite(self) -> bool:
        """False if mu is an eigenvalue of a node."""
        return all(np.isfinite(k).all() for k in self.K)

    @np.errstate(all="ignore")
    def dual(
        self, c: Floats, tolerance: float = 1e-9, *, guess: Floats | None = None, near: bool = False
    ) -> tuple[Floats, Floats, Floats]:
        """v and r for a row vector c, from a guess of v; `near`: mu is close to the abscissa.

        The third answer is (mu I - A_cl)' v, which differs from c by the error of the solve.
        """
        model = self.model
        b = model.apply(self.KB, c, 0, 1, transposed=True)
        start = None if guess is None else model.times("B", guess, transposed=True)  # without feedthrough r = B'v
        r = self.loop.solve(b, True, tolerance, start, near)
        v = model.apply(self.K, c, 0, 0, transposed=True) + model.apply(self.CK, model.WT @ r, 2, 0, transposed=True)
        missed = model.WT @ (r - (self.loop.TT @ r + b))
        return v, r, c + model.times("C", missed, transposed=True)

    @np.errstate(all="ignore")
    def primal(
        self, d: Floats, tolerance: float = 1e-9, *, guess: Floats | None = None, near: bool = False
    ) -> tuple[Floats, Floats]:
        """x and u for a column vector d, from a guess of x; `near`: mu is close to the abscissa."""
        model = self.model
        start = None if guess is None else model.W @ model.times("C", guess)
        u = self.loop.solve(model.W @ model.apply(self.CK, d, 2, 0), False, tolerance, start, near)
        return model.apply(self.K, d, 0, 0) + model.apply(self.KB, u, 0, 1), u


def direct_loop(model: NetworkModel) -> Loop:
    """The algebraic loop u = W D u + b of the feedthrough terms."""
    if "_direct_loop" not in model.__dict__:
        model.__dict__["_direct_loop"] = Loop(model, [s.D.values for s in model.stacks])
    return model.__dict__["_direct_loop"]


def banded_order(model: NetworkModel) -> Index | None:
    """An order of the inputs in which I - W G has a small envelope, or None; found once for a model.

    Costs one breadth-first search over the coupling.
    """
    if "_banded_order" not in model.__dict__:
        model.__dict__["_banded_order"] = _find_banded_order(model)
    return model.__dict__["_banded_order"]


def same_graph(model: NetworkModel, other: NetworkModel) -> None:
    """Let a network with links where another one has them take over the order that was found for it."""
    for known in ("_banded_order", "_is_flat"):
        if known in model.__dict__:
            other.__dict__[known] = model.__dict__[known]


def is_flat(model: NetworkModel) -> bool:
    """True if the graph has an envelope as graphs in a plane have it, where a factorisation fills in moderately."""
    banded_order(model)
    return model.__dict__.get("_is_flat", False)


def _find_banded_order(model: NetworkModel) -> Index | None:
    size = model.totals[1]
    if model.is_ordered and model.stacks[0].sizes[1:] == (1, 1):
        pattern = model.W
    else:
        feeds = model.blocks([np.ones((len(s), s.sizes[2], s.sizes[1])) for s in model.stacks], 2, 1)
        pattern = sp.csr_array(abs(model.W) @ feeds)
    count, component = connected_components(pattern, directed=True, connection="strong")
    if count == size:  # no loops: any topological order is triangular
        return np.argsort(component, kind="stable")
    if pattern.nnz > 12 * size + 1000:
        return None
    order, entries = envelope(pattern)
    model.__dict__["_is_flat"] = entries <= size**1.5 and size <= _FLAT
    return order if entries <= max(_ENVELOPE_PER_UNKNOWN * size, _ENVELOPE_TOTAL) else None


def krylov(
    T: Any, b: Floats, start: Floats, tolerance: float, limit: int, *, dot: Dot = dot, keep: Keep = None
) -> tuple[Floats, int]:
    """BiCGSTAB, restarted from its best iterate when rounding has spoilt the recursion; T is used in products only.

    The second answer is the number of steps.  `keep` is given the iterates that it restarts from.
    """

    def norm(a: Floats) -> float:
        return float(np.sqrt(dot(a, a)))

    size, steps = norm(b), 0
    goal = tolerance * size
    best, error = start, norm(b - (start - T @ start))
    if not error <= size:
        best, error = np.zeros_like(b), size
    while error > goal and steps < limit:
        trial, count = bicgstab(T, b, best, goal, limit - steps, dot=dot, keep=keep)
        steps += count
        now = norm(b - (trial - T @ trial))
        if not now < 0.5 * error:
            return (trial if now <= _SINGULAR * norm(trial) else best), steps
        best, error = trial, now
    return best, steps


def sweep(
    T: Any,
    b: Floats,
    tolerance: float,
    *,
    size: Callable[[Floats], float] = largest,
    start: Floats | None = None,
    keep: Keep = None,
) -> tuple[Floats, bool, bool]:
    """r <- T r + b from r = b, or from a guess, while it contracts well; whether it converged, whether it grows.

    T is used in products only; `size` is the largest absolute value of a vector.  `keep` is given every r.
    """
    r, term = (b.copy(), b) if start is None else (start.copy(), b - (start - T @ start))
    if start is not None:
        r += term
    whole, before = size(b), size(term)
    for k in range(_SWEEPS):
        require_time()
        term = T @ term
        r += term
        now = size(term)
        if now <= 0.1 * tolerance * whole:
            return r, True, False
        if not np.isfinite(now) or (k >= 5 and now > 0.75 * before):
            return r, False, not now < 1.02 * before
        before = now
        if keep is not None:
            keep(r)
    return r, False, False
