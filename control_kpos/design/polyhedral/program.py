"""Gains on any polyhedral cone, of any linear shape: u = F x with a pattern, or u = K y.

Invariance is linear in the gain; stability, v'(A + B F) x_k < 0, is linear in F for fixed v and has a closed
form in v for fixed F.  Alternating the two is a policy iteration:

    F: the linear program  max gamma - rho sum_k v'(A + B F) x_k / v'x_k   subject to invariance and
       v'(A + B F) x_k <= -gamma v'x_k,
    v: -(A + B F - (lambda + d) I)^{-T} c  for the rightmost eigenvalue lambda and shrinking d > 0.

The small reward rho on the sum matters: without it the iteration stops early in one case out of eight, because
columns that are not the worst stay where they are.  What is found is a local optimum, never worse than the start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.budget import affords
from ...exact.program import SMALL, Block, Program, Solver
from ..plant import Floats, Plant
from ..simplicial.inequalities import solved
from ..simplicial.program import scaled_rows, spend_on_entries, stacked

_RHO = 1e-2
_SHIFTS = (1.0, 0.1, 0.01, 1e-4)
# Gains beyond this many times the ratio of the sizes of A and B are not looked for.
_BOX = 1e4
_ROUNDS = 12
_STRICT = 1e-6
_SEED = 20211


@dataclass(frozen=True)
class Iterate:
    """A gain, its Lyapunov vector, and the decay rate v proves (in floating point)."""

    gain: Floats
    v: Floats
    rate: float


class GainProgram:
    """Linear programs over the free entries of L in u = L R x, with R = I or C.

    Parameters
    ----------
    plant : Plant
        On any proper polyhedral cone.
    lp : callable
        As `control_kpos.exact.programs.solve`.
    """

    def __init__(self, plant: Plant, lp: Solver) -> None:
        self.plant, self.lp = plant, lp
        self.read = np.eye(plant.n) if plant.reads is None else np.asarray(plant.reads.values)
        self.shape = plant.shape
        pattern = np.ones(self.shape, dtype=bool) if plant.pattern is None else plant.pattern
        self.free = np.flatnonzero(pattern.ravel())
        # generators seen by the gain, and drifts A_s (A_s - I in discrete time)
        self.seen = plant.seen.T
        eye = np.eye(plant.n) if plant.discrete else 0.0
        self.drifts = [A - eye for A, _ in plant.pairs]
        inputs = [np.abs(plant.facets @ B).max(initial=0.0) for _, B in plant.pairs]
        sizes = [np.abs(plant.facets @ A @ plant.rays.T).max() for A, _ in plant.pairs]
        self.unit = max(sizes) / max(inputs) if max(inputs) > 0 and max(sizes) > 0 else 1.0

    def coefficients(self, left: Floats, k: NDArray[np.intp]) -> Any:
        """Rows of left_r' L R x_k(r) over the free entries of L."""
        return products(left, self.seen, k, self.free)

    @cached_property
    def invariance(self) -> tuple[Any, Floats]:
        """(G, g) with G l + g >= 0: invariance for every vertex, and ports."""
        plant = self.plant
        G, g = self.forms(plant.facets, plant.pairs, plant.incidence)
        if plant.ports:
            C, D = (np.asarray(M.values) for M in plant.system.matrices[2:])
            outer = self.forms(np.asarray(plant.system.Y.facets), [(C, D)])
            G, g = stacked(G, outer[0]), np.concatenate([g, outer[1]])
        return G, g

    @cached_property
    def sizes(self) -> Floats:
        """What margins of invariance are relative to."""
        G, g = self.invariance
        return abs(G) @ np.full(G.shape[1], self.unit) + np.abs(g)

    def forms(self, facets: Floats, pairs: Sequence[tuple[Floats, Floats]], where: Any = True) -> tuple[Any, Floats]:
        """(G, g) with h_i'(A + B L R) x_k = G l + g for the pairs (i, k) `where` that is true, for every (A, B)."""
        i, k = np.nonzero(np.broadcast_to(where, (len(facets), len(self.plant.rays))))
        rows = [self.coefficients((facets @ B)[i], k) for _, B in pairs]
        return stacked(*rows), np.concatenate([(facets @ A @ self.plant.rays.T)[i, k] for A, _ in pairs])

    @cached_property
    def inputs(self) -> tuple[Any, NDArray[np.intp]]:
        """Rows of (L R x_k)_j over the free entries, for x_k with leading entries 1, and j for each."""
        j, k = (index.ravel() for index in np.indices((self.plant.m, len(self.plant.rays))))
        return scaled_rows(self.coefficients(np.eye(self.plant.m)[j], k), 1 / self.plant.sizes[k]), j

    @cached_property
    def _both(self) -> Any:
        return stacked(self.inputs[0], -self.inputs[0])

    def invariant(self, most: float = np.inf, *, cost: Floats | float = 0.0) -> Program:
        """A program over the free entries: invariance, and |L R x_k| <= bound, or a very large box, or `most`."""
        G, g = self.invariance
        program = self.bounded(most, cost=cost)
        program.above(-g, gain=G)
        return program

    def bounded(self, most: float = np.inf, *, cost: Floats | float = 0.0) -> Program:
        """The same without invariance."""
        program = Program(gain=Block(len(self.free), cost=cost))
        program.below(np.minimum(self._limits(), most), gain=self._both)
        return program

    def _limits(self) -> Floats:
        j = self.inputs[1]
        bound = np.full(self.plant.m, _BOX * self.unit) if self.plant.gain_bound is None else self.plant.gain_bound
        return np.concatenate([bound[j], bound[j]])

    def stability(self, v: Floats) -> tuple[Any, Floats, Floats]:
        """(S, s, w): v'(drift + B L R) x_k = S l + s, and w = v'x_k."""
        k = np.arange(len(self.plant.rays))
        rows = [self.coefficients(np.tile(v @ B, (len(k), 1)), k) for _, B in self.plant.pairs]
        constants = [self.plant.rays @ (v @ M) for M in self.drifts]
        weights = np.tile(self.plant.rays @ v, len(rows))
        return stacked(*rows), np.concatenate(constants), weights

    def any_invariant(self) -> bool | None:
        """Whether some gain keeps X invariant within the bounds; None if the solver failed."""
        return {"optimal": True, "infeasible": False}.get(self.invariant().solve(self.lp).outcome)

    def fastest(self, v: Floats, ceiling: float, most: float = np.inf) -> Iterate | None:
        """Gain of largest decay rate (up to `ceiling`) for this v, with |L R x_k| <= most."""
        S, s, w = self.stability(v)
        program = self.invariant(most, cost=_RHO * scaled_rows(S, 1 / w).sum(axis=0) / len(w))
        program.add(rate=Block(1, high=ceiling, cost=-1.0))
        program.below(-s, gain=S, rate=w)
        answer = program.solve(self.lp)
        return Iterate(self.fill(answer["gain"]), v, float(answer["rate"][0])) if answer else None

    def charged(self) -> Program:
        """Invariance, and the smallest max |L R x_k|, a variable `largest`."""
        G, g = self.invariance
        free = self.plant.gain_bound is None
        program = Program(gain=Block(len(self.free))) if free else self.bounded()
        program.above(-g, gain=G)
        self.charge(program, _BOX * self.unit if free else np.inf)
        return program

    def charge(self, program: Program, most: float = np.inf) -> None:
        """Minimise max |L R x_k|, a new variable `largest`, at most `most`."""
        program.add(largest=Block(1, high=most, cost=1.0))
        program.below(0.0, gain=self._both, largest=-np.ones(self._both.shape[0]))

    def smallest(self, v: Floats, rate: float) -> tuple[Iterate, float] | None:
        """Gain of smallest max |L R x_k| that has this decay rate with this v."""
        S, s, w = self.stability(v)
        program = self.charged()
        program.below(-s - rate * w, gain=S)
        answer = program.solve(self.lp)
        return (Iterate(self.fill(answer["gain"]), v, rate), float(answer["largest"][0])) if answer else None

    def centred(self, v: Floats, rate: float, most: float) -> Floats | None:
        """Gain within `most` with a slack of its own in every inequality; see `Program.spread`."""
        G, g = self.invariance
        S, s, w = self.stability(v)
        scale = np.concatenate([np.where(self.sizes > 0, self.sizes, 1.0), w * max(self.plant.scale, rate)])
        program = Program(gain=Block(len(self.free)))
        program.spread(np.concatenate([-g, s + rate * w]), scale, gain=stacked(G, -S))
        program.below(np.minimum(self._limits(), most), gain=self._both)
        answer = program.solve(self.lp)
        return self.fill(answer["gain"]) if answer else None

    def fill(self, entries: Floats) -> Floats:
        """The gain with these free entries."""
        out = np.zeros(self.shape[0] * self.shape[1])
        out[self.free] = entries
        return out.reshape(self.shape)

    # -- vectors

    def facet_sum(self) -> Floats:
        """A vector inside X*: the sum of the facets, each of height 1 over X."""
        return self._weighted(np.ones(len(self.plant.facets)))

    def _weighted(self, weights: Floats) -> Floats:
        heights = (self.plant.facets @ self.plant.rays.T).max(axis=1)
        return (weights / heights) @ self.plant.facets

    def starts(self, count: int, extra: tuple[Floats, ...] = ()) -> Iterator[Floats]:
        """Vectors inside X*: given ones, the facet sum, then random combinations of facets."""
        yield from extra
        yield self.facet_sum()
        rng = np.random.default_rng(_SEED)
        for _ in range(count - 1):
            yield self._weighted(rng.lognormal(sigma=1.5, size=len(self.plant.facets)))

    def vectors(self, gain: Floats) -> Iterator[Floats]:
        """Lyapunov vectors for a fixed gain, nearer and nearer to the left Perron vector."""
        c = self.facet_sum()
        if len(self.drifts) > 1:
            v = self._common_vector(gain)
            if v is not None:
                yield v
            return
        M = self.drifts[0] + self.plant.pairs[0][1] @ gain @ self.read
        if not np.isfinite(M).all():
            return
        rightmost = np.linalg.eigvals(M).real.max()
        size = max(abs(rightmost), 1e-3 * self.plant.scale)
        for d in _SHIFTS:
            v = -solved((M - (rightmost + d * size) * np.eye(len(M))).T, c)
            heights = self.plant.rays @ v
            if np.isfinite(v).all() and (heights > 1e-12 * np.abs(heights).max()).all():
                yield v / heights.max()

    def _common_vector(self, gain: Floats) -> Floats | None:
        """The v inside X* that decreases fastest along all vertices, by bisection on the rate."""
        rays = self.plant.rays
        loops = [M + B @ gain @ self.read for M, (_, B) in zip(self.drifts, self.plant.pairs, strict=True)]
        n = self.plant.n
        low, high, best = -2 * self.plant.scale * n, 2 * self.plant.scale * n, None
        for _ in range(24):
            if not affords():
                break
            rate = (low + high) / 2
            program = Program(v=Block(n))
            program.below(0.0, v=np.concatenate([rays @ (M.T + rate * np.eye(n)) for M in loops]))
            program.above(1.0, v=rays)
            answer = program.solve(self.lp)
            if answer:
                low, best = rate, answer["v"]
            else:
                high = rate
        return best

    # -- iterations

    def speed_up(self, v: Floats, ceiling: float, goal: float = np.inf, most: float = np.inf) -> Iterate | None:
        """Alternate from v until the decay rate exceeds `goal` or stops growing."""
        best = self.fastest(v, ceiling, most)
        if best is None:
            return None
        for _ in range(_ROUNDS):
            if best.rate > goal:
                return best
            found = best
            for vector in self.vectors(best.gain):
                candidate = self.fastest(vector, ceiling, most)
                if candidate is not None and candidate.rate > found.rate:
                    found = candidate
                if found.rate > goal:
                    return found
            if found.rate <= best.rate + 1e-6 * self.plant.scale:
                return found
            best = found
        return best

    def slim(self, iterate: Iterate, rate: float) -> tuple[Iterate, float]:
        """Alternate to make the gain small at a given decay rate; never larger than at the start."""
        best, size = iterate, self.plant.gain_of(iterate.gain)
        for _ in range(_ROUNDS):
            before = size
            for vector in (best.v, *self.vectors(best.gain)):
                found = self.smallest(vector, rate)
                if found is not None and found[1] < size:
                    best, size = found
            if size >= before * (1 - 1e-3):
                break
        return best, size

    @property
    def strict(self) -> float:
        """Decay demanded beyond the required one."""
        return _STRICT * self.plant.scale


def products(left: Floats, right: Floats, k: NDArray[np.intp], free: NDArray[np.intp]) -> Any:
    """Rows of left_r' L right_k(r) over the entries `free` of L in row-major order; sparse where they are many.

    Parameters
    ----------
    left, right : ndarray, shapes (R, m), (p, q)
    k : ndarray of int, shape (R,)
    free : ndarray of int, shape (f,)
    """
    (count, m), width = left.shape, right.shape[1]
    if count * m * width <= SMALL:
        return (left[:, :, None] * right[k][:, None, :]).reshape(count, m * width)[:, free]
    spend_on_entries(float(m * np.count_nonzero(right, axis=1)[k].sum()))
    seen = sp.csr_array(right)[k]
    return sp.csr_array(sp.hstack([scaled_rows(seen, column) for column in left.T], format="csr")[:, free])
