"""What local gains can do at every generator, apart from all others, and the multipliers that prove it.

At a generator t of X_j the gain enters as z = F t, under h_i'(A_j t + B_j z) >= 0 for the facets h_i that are 0 on t
(in discrete time: for all) and |z| <= bound: small programs that share nothing, and one linear program for a solver.
One gain for all nodes makes one program of those of like generators.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from math import prod
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...exact.programs import solve
from ...exact.rounding import HALF_ULP
from ...networks.inwards import inwards
from ...networks.model import NetworkModel
from .no_smaller_gains import NodeRows

Floats = NDArray[np.float64]
Index = NDArray[np.intp]
Parts = list[Floats]


class Columns:
    """The programs of all generators for one bound, in doubles: min d'B z under invariance, |z| <= bound sizes.

    Parameters
    ----------
    model : NetworkModel
    data : sequence of NodeRows
    theta : float
        Minus the decay rate; plus 1 in discrete time.
    bound : sequence of ndarray, shape (N, m)
        |F_j t| <= bound at generators with leading entries of 1.
    uniform : bool
        One gain for all nodes.

    Attributes
    ----------
    levels : list of ndarray, shape (n,)
        h_k't_k.
    """

    def __init__(
        self, model: NetworkModel, data: Sequence[NodeRows], theta: float, bound: Sequence[Floats], *, uniform: bool
    ) -> None:
        self.model, self.theta, self.bound, self.uniform = model, theta, list(bound), uniform
        self.rays = [np.asarray(rows.rays.values) for rows in data]
        self.sizes = [np.asarray(rows.sizes.values)[:, 0] for rows in data]
        self.A = [np.asarray(rows.A.values) @ T.T for rows, T in zip(data, self.rays, strict=True)]
        self.B = [np.asarray(rows.B.values) for rows in data]
        self.levels = [np.einsum("ij,ij->i", rows.facets.values, T) for rows, T in zip(data, self.rays, strict=True)]
        # bound on |F t| at every generator, (N, n, m)
        self.most = [b[:, None, :] * size[:, None] for b, size in zip(self.bound, self.sizes, strict=True)]

    @cached_property
    def pairs(self) -> list[tuple[Index, Index]]:
        """Generators k and facets i whose products must not be negative."""
        wanted = [
            np.ones((len(T), len(T)), dtype=bool) if self.model.discrete else ~np.eye(len(T), dtype=bool)
            for T in self.rays
        ]
        return [(k, i) for k, i in map(np.nonzero, wanted)]

    @cached_property
    def variables(self) -> tuple[list[Index], int]:
        """Places (N, n, m) of F t / most, and how many there are."""
        return self._numbered([most.shape for most in self.most])

    @cached_property
    def programs(self) -> tuple[list[Index], int]:
        """Numbers (N, n, 1) of the programs, and how many there are."""
        return self._numbered([(*most.shape[:2], 1) for most in self.most])

    def _numbered(self, shapes: list[tuple[int, ...]]) -> tuple[list[Index], int]:
        """Consecutive numbers; the same for all nodes if they have one gain."""
        if self.uniform:
            one = np.arange(shapes[0][1] * shapes[0][2]).reshape(1, *shapes[0][1:])
            return [np.repeat(one, shape[0], axis=0) for shape in shapes], one.size
        *starts, end = np.cumsum([0, *map(prod, shapes)]).tolist()
        return [at + np.arange(prod(shape)).reshape(shape) for at, shape in zip(starts, shapes, strict=True)], end

    @cached_property
    def closed(self) -> tuple[sp.csr_array, Floats]:
        """Rows of invariance, rows z <= right, with a 0 for those that no gain moves."""
        rows, right = [], []
        for A, B, most, place, (k, i) in zip(self.A, self.B, self.most, self.variables[0], self.pairs, strict=True):
            data, columns = -B[:, i] * most[:, k], np.broadcast_to(place[:, k], B[:, i].shape)
            count, m = len(A) * len(k), B.shape[2]
            shape = (count, self.variables[1])
            rows.append(sp.csr_array((data.ravel(), columns.ravel(), np.arange(0, count * m + 1, m)), shape=shape))
            still = ~(data != 0).any(axis=2)
            right.append(np.where(still, np.maximum(A[:, i, k], 0.0), A[:, i, k]).ravel())
        return sp.csr_array(sp.vstack(rows, format="csr")), np.concatenate(right)

    def narrowest(self) -> tuple[Parts, Parts]:
        """The part of the bound that invariance takes at every generator, and w of the one where it is largest."""
        rows, right = self.closed
        (places, count), (numbers, groups) = self.variables, self.programs
        owner = np.zeros(count, dtype=np.intp)
        for place, number in zip(places, numbers, strict=True):
            owner[place] = number
        level = sp.csr_array((-np.ones(count), (np.arange(count), owner)), shape=(count, groups))
        eye, none = sp.eye_array(count, format="csr"), sp.csr_array((rows.shape[0], groups))
        wide = sp.block_array([[rows, none], [eye, level], [-eye, level]], format="csr")
        low = np.concatenate([np.full(count, -np.inf), np.zeros(groups)])
        cost = np.concatenate([np.zeros(count), np.ones(groups)])
        answer = solve(cost, wide, np.concatenate([right, np.zeros(2 * count)]), bounds=(low, np.inf))
        if not answer:
            return [], []
        needed = answer.x[count:]
        worst = int(np.argmax(needed))
        w = self.multipliers(answer.duals)
        chosen = [np.where(number == worst, part, 0.0) for number, part in zip(numbers, w, strict=True)]
        return [needed[number[:, :, 0]] for number in numbers], chosen

    def multipliers(self, duals: Any) -> Parts:
        """Multipliers of the rows of invariance as weights of facets (N, n, n), a row for each generator."""
        out, at = [], 0
        for A, (k, i) in zip(self.A, self.pairs, strict=True):
            part = np.zeros(A.shape)
            count = len(A) * len(k)
            part[:, k, i] = np.maximum(-duals[at : at + count], 0.0).reshape(len(A), len(k))
            at += count
            out.append(part)
        return out

    def fastest(self, d: Parts) -> tuple[Parts | None, Parts]:
        """Gains F that make d'(A + B F) t least at every generator, and the w = l - d that prove it."""
        rows, right = self.closed
        costs = [
            np.einsum("ji,jim->jm", part, B)[:, None, :] * most
            for part, B, most in zip(d, self.B, self.most, strict=True)
        ]
        units = [np.abs(c).max(axis=2, keepdims=True, initial=0.0) for c in costs]
        units = [np.where(u > 0, u, 1.0) for u in units]
        cost = np.concatenate([(c / u).ravel() for c, u in zip(costs, units, strict=True)])
        answer = solve(cost, rows, right, bounds=(-1.0, 1.0))
        if not answer:
            return None, []
        gains = [
            np.swapaxes(np.linalg.inv(T) @ (answer.x[place] * most), 1, 2)
            for T, place, most in zip(self.rays, self.variables[0], self.most, strict=True)
        ]
        l = [part * u for part, u in zip(self.multipliers(answer.duals), units, strict=True)]
        # where d is 0 on a generator, invariance itself says all that is needed
        return gains, [
            np.where((part > 0)[:, :, None], own - part[:, None], 0.0) for own, part in zip(l, d, strict=True)
        ]

    def of_one_gain(self) -> tuple[Parts, Parts]:
        """d and w = l - d that refute one gain and one x for all nodes: multipliers of the program of the least growth.

        Over xi >= 0, sum xi = 1, and z with |z| <= most xi, under invariance, the largest growth of any row is least.
        """
        (places, count), facets = self.variables, self.rays[0].shape[0]
        rows, right = self.closed
        shared = [np.broadcast_to(np.arange(facets), A.shape[:2]) for A in self.A]
        held = np.concatenate([shared[g][:, k].ravel() for g, (k, _) in enumerate(self.pairs)])
        level = sp.csr_array((-right, (np.arange(len(held)), held)), shape=(len(held), facets))
        falls = [
            self._growth(A, B, most, level)
            for A, B, most, level in zip(self.A, self.B, self.most, self.levels, strict=True)
        ]
        grown = np.concatenate([part.reshape(-1, part.shape[2]) for part in falls])
        grown[:, :facets] += self._links()
        size = np.abs(grown).max(axis=1)
        owner = np.zeros(count, dtype=np.intp)
        owner[places[0][0]] = np.arange(facets)[:, None]
        most = sp.csr_array((-np.ones(count), (np.arange(count), owner)), shape=(count, facets))
        eye = sp.eye_array(count, format="csr")
        wide = sp.block_array(
            [
                [level, rows, None],
                [grown[:, :facets], grown[:, facets:], -size[:, None]],
                [most, eye, None],
                [most, -eye, None],
            ],
            format="csr",
        )
        low = np.concatenate([np.zeros(facets), np.full(count + 1, -np.inf)])
        one = np.concatenate([np.ones(facets), np.zeros(count + 1)])
        cost = np.concatenate([np.zeros(facets + count), [1.0]])
        answer = solve(cost, wide, np.zeros(wide.shape[0]), one[None], [1.0], bounds=(low, np.inf))
        if not answer:
            return [], []
        d = np.maximum(-answer.duals[len(held) : len(held) + len(grown)], 0.0)  # type: ignore[index]
        at = np.cumsum([0, *(A.shape[0] * facets for A in self.A)])
        parts = [d[a:b].reshape(-1, facets) for a, b in pairwise(at)]
        l = self.multipliers(answer.duals)
        return parts, [own - part[:, None] for own, part in zip(l, parts, strict=True)]

    def _growth(self, A: Floats, B: Floats, most: Floats, level: Floats) -> Floats:
        """h_i'(A x + B z) - theta h_i'x over xi and z / most, for every node and facet, (N, n, n + n m)."""
        own = A - np.diag(self.theta * level)
        pushed = B[:, :, None, :] * most[:, None]
        return np.concatenate([own, pushed.reshape(*A.shape[:2], -1)], axis=2)

    def _links(self) -> Floats:
        """h_i'B_j sum_k W_jk C_k t for every node, facet and generator t, one below the other."""
        model, T = self.model, self.rays[0]
        received = [model.W @ model.times("C", model.at_all([t] * len(model.stacks), 0)) for t in T]
        split = [model.split(u, 1) for u in received]
        parts = [np.stack([B @ u[g][:, :, None] for u in split], axis=2)[..., 0] for g, B in enumerate(self.B)]
        return np.concatenate([part.reshape(-1, len(T)) for part in parts])

    def of_gains(self, w: Parts) -> list[tuple[Floats, Floats]]:
        """sum_i w_i h_i'B at every generator, and a bound on its rounding; over all nodes if they have one gain."""
        values = [part @ B for part, B in zip(w, self.B, strict=True)]
        sizes = [np.abs(part) @ np.abs(B) for part, B in zip(w, self.B, strict=True)]
        count = max(B.shape[1] for B in self.B)
        if self.uniform:
            count *= self.model.n_nodes
            values, sizes = ([np.concatenate(parts).sum(axis=0, keepdims=True)] for parts in (values, sizes))
        return [(value, 8 * (count + 24) * HALF_ULP * size) for value, size in zip(values, sizes, strict=True)]

    def ports(self, d: Parts) -> tuple[Floats, Floats]:
        """r <= B'd and q <= W'r in the orders of U* and Y*, by a few units in the last place."""
        model = self.model
        value, size = (
            model.join([np.einsum("ji,jim->jm", x, f(B)) for x, B in zip(d, self.B, strict=True)], 1)
            for f in (np.asarray, np.abs)
        )
        r = -inwards(model, "U", -value, size, max(sum(s.sizes) for s in model.stacks), dual=True)
        longest = int(np.diff(model.WT.indptr).max(initial=0)) + max(s.sizes[2] for s in model.stacks)
        return r, -inwards(model, "Y", -(model.WT @ r), abs(model.WT) @ np.abs(r), longest, dual=True)

    def slack(self, d: Parts, w: Parts) -> Parts:
        """What is left of the inequalities at every generator, (N, n), less what rounding may take."""
        q, out = self.model.split(self.ports(d)[1], 2), []
        parts = zip(
            self.A, self.of_gains(w), self.most, self.rays, self.levels, self.model.stacks, d, w, q, strict=True
        )
        for A, (b, room), most, T, level, s, d_g, w_g, q_g in parts:
            seen = np.einsum("jq,jqn,kn->jk", q_g, s.C.values, T, optimize=True)
            own, slow = np.einsum("jki,jik->jk", w_g, A), self.theta * d_g * level
            size = np.einsum("jki,jik->jk", np.abs(w_g), np.abs(A)) + np.abs(seen) + np.abs(slow)
            spent = ((np.abs(b) + room) * most).sum(axis=2)
            out.append(seen - own - slow - spent - 64 * (s.sizes[0] + 24) * HALF_ULP * (size + spent))
        return out
