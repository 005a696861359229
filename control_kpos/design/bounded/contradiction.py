"""Proofs that no gain keeps a cone and an interval within bounds on states and inputs, by Farkas' lemma.

Let l_sk >= 0 on X (in continuous time l_sk'x_k = 0), d_s >= 0 on X, and for every input i let p_i and q_i lie in
[0, t_i x_max] and [0, t'_i x_max].  An F as demanded would make

    sum_sk l_sk'(A_s + B_s F) x_k  -  sum_s d_s'((A_s + B_s F) x_max + w_max)  -  sum_i F_i (p_i - q_i)

at least -sum_i (t_i + t'_i) u_i (in discrete time A_s - I for A_s in the middle).  There is none if the left side is
the same number for every F, and less.  p_i is a combination of generators with weights, as is t_i x_max - p_i, so that
no facet is needed; by duality of linear programs there are such numbers whenever no F exists.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...cones import Cone
from ...errors import DataError, TooLargeError
from ...exact.budget import affords, spend
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.rational_programs import exact_feasibility
from ...proof.encoding import register_record
from ..contradiction import Contradiction, as_columns, described, marks, numbers, values_on
from ..exact_rows import short_rows
from ..plant import Plant
from ..refusal import EFFORT_PER_ENTRY

Rationals = NDArray[np.object_]


@register_record
@dataclass(frozen=True, eq=False)
class BoundedFunctionals:
    """Functionals and states that combine the demands on a gain within bounds into a contradiction.

    Attributes
    ----------
    L : tuple of Matrix, shape (n, N)
        For every vertex: column k is the l >= 0 on X, l'x_k = 0 in continuous time, of l'(A + B F) x_k >= 0.
    d : Matrix, shape (n, number of vertices)
        Column s is a functional >= 0 on X, of which (A_s + B_s F) x_max + w_max takes no positive value.
    up, up_rest, down, down_rest : Matrix, shape (N, m), or None
        Weights of the generators in p_i, t_i x_max - p_i, q_i and t'_i x_max - q_i, for every input i.
    times : Matrix, shape (2, m), or None
        t and t'.
    """

    L: tuple[Matrix, ...]
    d: Matrix
    up: Matrix | None = None
    up_rest: Matrix | None = None
    down: Matrix | None = None
    down_rest: Matrix | None = None
    times: Matrix | None = None

    def __str__(self) -> str:
        parts = [part for part in (*self.L, self.d, self.up, self.down) if part is not None]
        used = sum(int(np.count_nonzero((part.fractions() != 0).any(axis=0))) for part in parts)
        return f"a combination of {used} demand{'s' * (used != 1)} that contradicts itself"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoBoundedFeedback(Contradiction):
    """Proof that no u = F x keeps X and [0, x_max] for all w in [0, w_max], with |u_i| <= u_i on the interval.

    The claim is "there is such an F"; the status is REFUTED when the functionals contradict it.

    Attributes
    ----------
    A, B : tuple of Matrix
        Vertices of the plant.
    X : Cone
    discrete : bool
    pattern : ndarray, shape (m, n)
        1 where F may differ from zero.
    x_max, w_max : Matrix, shape (1, n)
    u_max : Matrix, shape (1, m), or None
    witness : BoundedFunctionals
    """

    claim: ClassVar[str] = "bounded feedback exists"

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    X: Cone
    discrete: bool
    pattern: NDArray[np.float64]
    x_max: Matrix
    w_max: Matrix
    u_max: Matrix | None = None

    @property
    def scope(self) -> str:
        """Which gains are excluded, as words after "gain"."""
        return " within these bounds"

    def functionals(self) -> Any:
        """The witness."""
        return self.witness

    def refutation(self) -> Any:
        """The inequalities that prove the witness, or None."""
        w = self.witness
        return [*self._inwards(w.L), *self.contradiction(w)] if isinstance(w, BoundedFunctionals) else None

    def contradiction(self, w: Any) -> list[Condition]:
        """The inequalities above."""
        n, m, count = self.X.dim, self.B[0].shape[1], len(self.A)
        if self.x_max.shape != (1, n) or self.w_max.shape != (1, n):
            raise DataError("x_max and w_max have one entry for every state.")
        free = marks(self.pattern, (m, n))
        out = [Condition("d'x >= 0", values_on(w.d, self.rays, count), ">=")]
        slope, level = self._combined(w)
        parts = (w.up, w.up_rest, w.down, w.down_rest, w.times)
        if self.u_max is None and any(part is not None for part in parts):
            raise DataError("there are no bounds on inputs that states could be about.")
        if self.u_max is not None:
            more, used, kept = self._states(parts, m)
            slope, level, out = slope - more, level + used, [*out, *kept]
        out.append(Condition("the sum is below the bounds of the inputs", numbers([level]), "<"))
        return [*out, Condition("the sum is the same for every F", numbers(slope[free]), "==")] if free.any() else out

    def _combined(self, w: Any) -> tuple[Rationals, Any]:
        """What F is multiplied by in the first two sums, and the rest of them."""
        rays, (x,), (w_max,) = self.rays.fractions(), self.x_max.fractions(), self.w_max.fractions()
        slope, level = np.zeros((self.B[0].shape[1], self.X.dim), dtype=object), 0
        for l, d, A, B in zip(w.L, w.d.fractions().T, self.A, self.B, strict=True):
            own, a, b = l.fractions(), A.fractions(), B.fractions()
            level += (own * (a @ rays.T)).sum() - d @ (a @ x - int(self.discrete) * x + w_max)
            slope = slope + b.T @ own @ rays - np.outer(b.T @ d, x)
        return slope, level

    def _states(self, parts: tuple[Matrix | None, ...], m: int) -> tuple[Rationals, Any, list[Condition]]:
        """p - q as rows, sum (t + t')'u, and that weights are not negative and belong to the interval."""
        rays, (x,), N = self.rays.fractions(), self.x_max.fractions(), self.rays.shape[0]
        shapes = [(N, m)] * 4 + [(2, m)]
        if self.u_max is None or self.u_max.shape != (1, m):
            raise DataError("u_max has one entry for every input.")
        if any(part is None or part.shape != shape for part, shape in zip(parts, shapes, strict=True)):
            raise DataError("weights of generators are missing, or have not one column for every input.")
        up, up_rest, down, down_rest, times = (part.fractions() for part in parts if part is not None)
        apart = [
            (a + b).T @ rays - np.outer(t, x) for a, b, t in ((up, up_rest, times[0]), (down, down_rest, times[1]))
        ]
        every = np.concatenate([part.ravel() for part in (up, up_rest, down, down_rest, times)])
        kept = [
            Condition("weights and times >= 0", numbers(every), ">="),
            Condition("p and the rest are t x_max", numbers(np.concatenate(apart).ravel()), "=="),
        ]
        return (up - down).T @ rays, times.sum(axis=0) @ self.u_max.fractions()[0], kept

    def explain(self) -> str:
        """What is proven, in words."""
        if not isinstance(self.refuted_by, BoundedFunctionals):
            return "Undecided: there are no multipliers that are proven."
        inputs = "" if self.u_max is None else " with all |u_i| within input_bounds on it"
        zeros = "" if np.all(self.pattern == 1) else " of this structure"
        return (
            f"Proved impossible: no u = F x{zeros} keeps both X, X being {described(self.X)}, and the interval "
            f"[0, state_bounds] invariant for all disturbances in [0, disturbance_bounds]{inputs}; attached is "
            f"{self.witness}, checked in exact arithmetic. Nothing is said of other cones or other state_bounds: raise "
            "input_bounds, lower disturbance_bounds, or change these."
        )


# -- the search


def no_bounded_feedback(plant: Plant) -> NoBoundedFeedback | None:
    """The proof, if there is one within reach of exact arithmetic; whatever rate, ports and gain bounds ask."""
    bounds = plant.interval
    if bounds is None or bounds.x_max is None or plant.reads is not None:
        return None
    pattern = np.ones(plant.shape) if plant.pattern is None else plant.pattern.astype(float)
    data: dict[str, Any] = {
        "A": tuple(A for A, _ in plant.vertices),
        "B": tuple(B for _, B in plant.vertices),
        "X": plant.X,
        "discrete": plant.discrete,
        "pattern": pattern,
        "x_max": bounds.x_max[None],
        "w_max": bounds.w_max[None],
        "u_max": None if bounds.u_max is None else bounds.u_max[None],
    }
    search = _Search(NoBoundedFeedback(**data), pattern != 0)
    if not affords(search.entries * EFFORT_PER_ENTRY):
        return None
    spend(search.entries * EFFORT_PER_ENTRY)
    witness = search.witness()
    found = None if witness is None else NoBoundedFeedback.settle(**data, witness=witness)
    return None if found is None or found.refuted_by is None else found


class _Search:
    """The linear program of the numbers above, in fractions: every column is a number, every row an equation.

    Parameters
    ----------
    claim : NoBoundedFeedback
    free : ndarray of bool, shape (m, n)
    """

    def __init__(self, claim: NoBoundedFeedback, free: NDArray[np.bool_]) -> None:
        self.claim, self.free, self.m = claim, free, claim.B[0].shape[1]
        where = np.asarray(claim.X.incidence, dtype=bool)
        self.i, self.k = np.nonzero(np.ones_like(where) if claim.discrete else where)

    @property
    def entries(self) -> int:
        """About as many as the program has."""
        columns = (len(self.i) + self.claim.X.n_facets) * len(self.claim.A) + 4 * self.claim.X.n_rays * self.m
        return columns * (1 + int(self.free.sum()))

    def witness(self) -> BoundedFunctionals | None:
        """The numbers, or None if there are none or they take too long."""
        claim, m = self.claim, self.m
        facets, rays = short_rows(claim.X.exact_facets), claim.rays.fractions()
        columns = [*self._of_vertices(facets, rays), *self._of_inputs(rays)]
        rows = np.concatenate([np.concatenate([part[r] for part in columns], axis=1) for r in range(3)])
        right = np.array([0] * (len(rows) - 1) + [-1], dtype=object)
        try:
            y, _ = exact_feasibility(Matrix.from_fractions(rows), Matrix.from_fractions(right))
        except TooLargeError:
            return None
        if y is None:
            return None
        L, d, count = [], [], len(self.i)
        for _ in claim.A:
            own = np.zeros((len(rays), claim.X.dim), dtype=object)
            np.add.at(own, self.k, y[:count, None] * facets[self.i])
            L.append(as_columns(own))
            d.append(y[count : count + len(facets)] @ facets)
            y = y[count + len(facets) :]
        if claim.u_max is None:
            return BoundedFunctionals(tuple(L), as_columns(np.array(d)))
        up, up_rest, down, down_rest = y[: 4 * m * len(rays)].reshape(4, m, len(rays))
        times = Matrix.from_fractions(y[4 * m * len(rays) :].reshape(2, m))
        weights = map(as_columns, (up, up_rest, down, down_rest))
        return BoundedFunctionals(tuple(L), as_columns(np.array(d)), *weights, times=times)

    def _of_vertices(self, facets: Rationals, rays: Rationals) -> Any:
        """Columns (slope, states, level) of the weights of pairs, and of facets, vertex after vertex."""
        claim, (x,), (w,) = self.claim, self.claim.x_max.fractions(), self.claim.w_max.fractions()
        none = np.zeros((self._states, 1), dtype=object)
        for A, B in zip(claim.A, claim.B, strict=True):
            a, b = A.fractions(), facets @ B.fractions()
            slope = (b[self.i][:, :, None] * rays[self.k][:, None, :])[:, self.free].T
            yield slope, none.repeat(len(self.i), axis=1), (facets @ a @ rays.T)[self.i, self.k][None]
            moved = facets @ (a @ x - int(claim.discrete) * x + w)
            slope = -(b[:, :, None] * x)[:, self.free].T
            yield slope, none.repeat(len(facets), axis=1), -moved[None]

    @property
    def _states(self) -> int:
        """Equations of the states p and q."""
        return 0 if self.claim.u_max is None else 2 * self.m * self.claim.X.dim

    def _of_inputs(self, rays: Rationals) -> Any:
        """Columns of the weights in p, the rest, q, the rest, of all inputs; then of t and t'."""
        if self.claim.u_max is None:
            return
        m, N, (x,), (u,) = self.m, len(rays), self.claim.x_max.fractions(), self.claim.u_max.fractions()
        eye = np.eye(m, dtype=int).astype(object)
        each = np.kron(eye, rays.T)
        slope = np.array([np.outer(e, r)[self.free] for e in eye for r in rays], dtype=object).reshape(m * N, -1).T
        none, nothing = np.zeros_like(slope), np.zeros_like(each)
        level = np.zeros((1, m * N), dtype=object)
        for sign, states in ((-1, [each, nothing]), (1, [nothing, each])):
            yield sign * slope, np.concatenate(states), level
            yield none, np.concatenate(states), level
        ends = -np.kron(eye, x[:, None])
        zeros = np.zeros((len(slope), m), dtype=object)
        yield zeros, np.concatenate([ends, np.zeros_like(ends)]), u[None]
        yield zeros, np.concatenate([np.zeros_like(ends), ends]), u[None]
