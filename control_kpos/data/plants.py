"""What a search among measurements works with: the data in doubles and exactly, a plant in the middle, programs."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from ..cards import raised
from ..design.running import Programs
from ..errors import DataError
from ..exact.matrix import Matrix
from ..proof.portable_cones import portable_rows
from .certificate import DataCertificate, Place, places
from .experiments import Experiments
from .program import Floats, Found, Samples, Unknowns, joint, middle
from .repair import Repair

# Shares of the plant in the middle, in turn: a plant at the edge of the noise is moved inside.
_INWARDS = (1e-12, 1e-9, 1e-6, 1e-3, 0.1)
# Room inside the noise, relative to the data, below which samples may contradict each other.
_EDGE = 1e-9
# Room of positivity, as a part of the margin of decay.
_ROOM = 0.01


class Search:
    """The data in doubles and exactly, and a plant in the middle."""

    def __init__(self, data: Experiments, lp: Programs) -> None:
        self.data, self.lp = data, lp
        n = data.X.dim
        self.m = 0 if data.U0 is None else data.U0.shape[0]
        self.Z = data.X0 if data.U0 is None else Matrix.join([data.X0, data.U0], -2)
        self.repair = Repair(self.Z)
        self.samples = Samples(*(np.asarray(M.values) for M in (self.Z, data.X1, data.noise)))
        self.rays, self.facets = portable_rows(data.X.exact_rays), data.X.exact_facets.plain().fractions()
        self.x = self.rays.astype(float)
        h = self.facets.astype(float)
        self.h = h / np.linalg.norm(h, axis=1, keepdims=True)
        incident = self.facets @ self.rays.T == 0
        wanted = np.ones(incident.shape, bool) if data.discrete else incident.astype(bool)
        self.pairs = [(int(a), int(b)) for a, b in np.argwhere(wanted)]
        rows = [middle(self.samples, i, lp) for i in range(n)]
        self.plant = self._plant(rows)

    def named(self, stable: bool) -> list[Place]:
        """See `places`."""
        return places(self.facets, self.rays, discrete=self.data.discrete, stable=stable)

    def _plant(self, rows: list[Any]) -> Matrix | None:
        """One that agrees, exactly; `DataError` if there is none."""
        for i, (w, inside, l) in enumerate(rows):
            if w is not None and inside < _EDGE * np.abs(self.samples.X1).max(initial=0.0):
                self._exclude(i, w, inside, l)
        if any(w is None for w, _, _ in rows):
            return None
        exact = self.repair.interpolant(self.data.X1) if self.repair.is_complete else None
        for plant in (Matrix(np.array([w for w, _, _ in rows])), exact):
            if plant is not None and self._agrees(plant):
                return plant
        return None

    def _agrees(self, plant: Matrix) -> bool:
        draft = DataCertificate(**self.data.data(), F=self.no_gain())
        return all(c.verdict() is True for c in draft.agreement(plant))

    @property
    def central(self) -> Floats:
        """The plant in the middle, in doubles; for searches that have one."""
        return np.asarray(self.plant.values)  # type: ignore[union-attr]

    def inside(self, edge: Floats) -> Matrix:
        """The plant at an edge of the noise, moved inside until it agrees; the one in the middle if it never does."""
        moved = (Matrix((1 - part) * edge + part * self.central) for part in _INWARDS)
        return next((plant for plant in moved if self._agrees(plant)), self.plant)  # type: ignore[return-value]

    def no_gain(self) -> Matrix | None:
        """F = 0, where there are inputs."""
        return Matrix.zeros(self.m, self.data.X.dim) if self.m else None

    def _exclude(self, i: int, w: Floats, inside: float, l: Floats | None) -> None:
        """Z l = 0 and X1_i l > noise_i'|l| for some l: then no row of a plant agrees."""
        if not self.repair.is_complete:
            return
        worst = np.zeros(self.samples.X1.shape[1])
        off = self.samples.X1[i] - w @ self.samples.Z
        at = int(np.argmax(np.abs(off) - self.samples.noise[i]))
        worst[at] = np.sign(off[at]) or 1.0
        none = np.full((1, self.Z.shape[0]), Fraction(0), dtype=object)
        guesses = [g for part in (l, worst) if part is not None for g in (part, -part)]
        for t in np.setdiff1d(np.arange(len(worst)), self.repair.basis) if inside <= 0 else ():
            guesses += [s * np.eye(1, len(worst), t)[0] for s in (1.0, -1.0)]
        row, noise = (M.fractions()[i] for M in (self.data.X1, self.data.noise))
        for guess in guesses:
            exact = self.repair.combinations(np.asarray(guess)[None], none)
            y = None if exact is None else exact.fractions()[0]
            if y is not None and row @ y > noise @ np.abs(y):
                least = float(noise.max()) + max(-inside, float((np.abs(off) - self.samples.noise[i]).max()))
                names = "X0, X1 and U0" if self.m else "X0 and X1"
                raise DataError(
                    f"no plant agrees with the samples {names}: those of state {i} contradict each other by more than "
                    f"the noise of {float(noise.max()):.3g}. Give a larger one (about {raised(least, 2)}), or look for "
                    "samples that belong to another plant."
                )

    def settle(self, F: Matrix | None, e: Matrix | None, l: Floats) -> DataCertificate | None:
        """The certificate with exact combinations near l."""
        draft = DataCertificate(**self.data.data(), F=F, e=e)
        targets = draft.targets()
        exact = self.repair.combinations(l, targets)
        if exact is None:
            return None
        return DataCertificate.settle(**self.data.data(), F=F, e=e, combinations=exact, plant=self.plant)

    # -- the program of a gain

    def simplicial(self) -> Unknowns:
        """z_k = (xi_k x_k; zeta_k), z_e = their sum: F x_k = zeta_k / xi_k."""
        p, n, m = len(self.x), self.data.X.dim, self.m
        moved = np.zeros((p + 1, n + m, p + p * m))
        for k in range(p):
            moved[k, :n, k] = self.x[k]
            moved[k, n:, p + k * m : p + (k + 1) * m] = np.eye(m)
        moved[p] = moved[:p].sum(axis=0)
        low, high = np.zeros(p + p * m), np.ones(p + p * m)
        low[p:], high[p:] = -np.inf, np.inf
        price = np.concatenate([np.zeros(p), np.ones(p * m)])
        return Unknowns(np.zeros((p + 1, n + m)), moved, low, high, price)

    def start(self) -> Unknowns:
        """The program of a gain, on cones that are not simplicial with e in the middle of X."""
        simplicial = self.data.X.is_simplicial
        return self.simplicial() if simplicial else self.fixed_vector(np.asarray(self.data.X.interior_point, float))

    def fixed_vector(self, e: Floats, *, free: bool = True) -> Unknowns:
        """z = (x; F x) for all generators and e: linear in F, which is 0 unless `free`."""
        states, n, m = np.vstack([self.x, e]), self.data.X.dim, self.m
        moved = np.zeros((len(states), n + m, m * n))
        for j in range(m):
            moved[:, n + j, j * n : (j + 1) * n] = states
        fixed = np.hstack([states, np.zeros((len(states), m))])
        most = np.full(m * n, np.inf if free else 0.0)
        return Unknowns(fixed, moved, -most, most, np.ones(m * n))

    def fixed_gain(self, F: Floats | None) -> Unknowns:
        """z_e = sum a_k (x_k; F x_k)."""
        vectors = self.x if F is None else np.hstack([self.x, self.x @ F.T])
        p = len(self.x)
        moved = np.zeros((p + 1, vectors.shape[1], p))
        moved[p] = vectors.T
        return Unknowns(np.zeros((p + 1, vectors.shape[1])), moved, np.zeros(p), np.ones(p), np.zeros(p))

    def joint(
        self,
        unknowns: Unknowns,
        named: list[Place],
        pairs: list[tuple[int, int]],
        *,
        samples: Samples | None = None,
        stable: bool = True,
        **more: Any,
    ) -> Found | None:
        """See `joint` of `program`; the last vector is e."""
        at_e = len(self.x) if stable else None
        given = (samples or self.samples, named, unknowns, self.h, pairs, at_e, self.data.discrete, self.lp)
        return joint(*given, **more)

    def candidates(self, unknowns: Unknowns) -> Iterator[Found]:
        """Points with a margin of decay: inside, or where some bounds can only be 0 with as many inside as possible."""
        named = self.named(True)
        inside = self.joint(unknowns, named, self.pairs, room=_ROOM)
        if inside is not None and inside.margin > 0:
            yield inside
        at_edge = self.joint(unknowns, named, self.pairs)
        if at_edge is not None and at_edge.margin > 0:
            spread = self.joint(unknowns, named, self.pairs, least=at_edge.margin / 2)
            yield from (found for found in (spread, at_edge) if found is not None)

    def vector(self, F: Floats | None) -> tuple[Floats, Found] | None:
        """e for a gain, with the combinations of its bounds."""
        named = [place for place in self.named(True) if place[0] == len(self.x)]
        found = self.joint(self.fixed_gain(F), named, [])
        return None if found is None else (found.theta @ self.x, found)
