"""Proofs that no gain exists, by Farkas' lemma.

If rows G x >= 0, S x < 0, x_1..x_n > 0 have no solution, there are weights a, b, c >= 0, b and c not both
zero, with a'G - b'S + (c, 0)' = 0: multiplying a supposed solution by this identity gives 0 > 0.  They
are found in rational arithmetic and checked by the kernel against rows rebuilt from the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...cones import Cone
from ...errors import DataError
from ...exact.budget import affords, spend
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.program import alternative
from ...exact.signs import BilinearForms
from ...proof.certificate import Certificate
from ...proof.encoding import register_record
from ...proof.portable_cones import portable_rows
from ...proof.weights import ProofOmittedError, columns, require_portable
from ...systems.system import System
from ..plant import EFFORT_PER_ENTRY, EFFORT_TO_CHECK, Plant, column_freedom, exact_geometry
from .inequalities import Inequalities, feedback_inequalities, gain_rows, output_rows
from .repair import repaired_multipliers

# Operations of a product of fractions, of data as they are given and with facets that have thousands of digits.
_EFFORT_PER_PRODUCT = 1e4, 9e4


@register_record
@dataclass(frozen=True, eq=False)
class Multipliers:
    """Nonnegative numbers that combine the inequalities of a design into a contradiction.

    Attributes
    ----------
    closed : tuple of Fraction
        For rows that must be nonnegative: invariance, gain bound, ports.
    drift : tuple of Fraction
        For rows that must be negative: A + B F maps xi towards 0.
    positive : tuple of Fraction
        For xi > 0.
    """

    closed: tuple[Fraction, ...]
    drift: tuple[Fraction, ...]
    positive: tuple[Fraction, ...]

    def __str__(self) -> str:
        used = sum(1 for group in (self.closed, self.drift, self.positive) for value in group if value)
        return f"a combination of {used} inequalities that contradicts itself"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoFeedback(Certificate):
    """Proof that no u = F x makes a simplicial cone invariant and the closed loop stable as demanded.

    The claim is "there is such an F"; the status is REFUTED when the multipliers contradict it.

    Attributes
    ----------
    A, B : tuple of Matrix
        Vertices of the plant.
    X : Cone
        Simplicial.
    discrete : bool
    rate : float
        Decay rate that was to be exceeded.
    gain_bound : ndarray, shape (m,), or None
        |F x_k| <= gain_bound at the generators, read up to a relative 1e-9.
    free : ndarray, shape (n, m)
        1 where F x_k may differ from zero.
    coupling : Matrix or None
        Stability was asked of A + B F + coupling.
    witness : Multipliers
    """

    claim: ClassVar[str] = "feedback exists"

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    X: Cone
    discrete: bool
    rate: float
    gain_bound: NDArray[np.float64] | None
    free: NDArray[np.float64]
    coupling: Matrix | None = None
    ports: tuple[Matrix, Matrix, Cone] | None = None

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        raise DataError("this certificate can only refute; give multipliers as its witness.")

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities that prove the witness, or None."""
        w = self.witness
        if not isinstance(w, Multipliers):
            return None
        system = self._rows()
        groups = [np.array(g, dtype=object) for g in (w.closed, w.drift, w.positive)]
        numbers = np.concatenate(groups)
        if numbers.size != len(system):
            return None
        row = Matrix.from_fractions(numbers[None, :])
        strict = np.concatenate(
            [np.zeros(len(groups[0]), dtype=int), np.ones(len(numbers) - len(groups[0]), dtype=int)]
        )
        return [
            Condition("multipliers >= 0", BilinearForms(row, None, Matrix.identity(numbers.size)), ">="),
            Condition(
                "sum of strict multipliers > 0",
                BilinearForms(row, None, Matrix(strict[None, :].astype(float))),
                ">",
            ),
            Condition("combination = 0", BilinearForms(row, None, Matrix.from_fractions(system.T)), "=="),
        ]

    def _rows(self) -> NDArray[np.object_]:
        """closed, -drift and xi rows over the free variables, in integers and fractions."""
        q = self.inequalities()
        return homogeneous_rows(q, _theta(self.rate, self.discrete), np.asarray(self.free) != 0)[0]

    def inequalities(self) -> Inequalities:
        """The exact inequalities that have no solution."""
        return exact_inequalities(self._plant())

    def _plant(self) -> Plant:
        C_D, Y = ((), None) if self.ports is None else (self.ports[:2], self.ports[2])
        system = System.read((self.A[0], self.B[0], *C_D), X=self.X, Y=Y, dt=self.discrete)
        pairs, ports = tuple(zip(self.A, self.B, strict=True)), self.ports is not None
        return Plant(system, pairs, gain_bound=self.gain_bound, ports=ports, coupling=self.coupling)

    def evidence(self) -> dict[str, Any]:
        """The combinations of facets that the multipliers make: of X for every generator and vertex, of Y, of X again.

        L[s] has sum_i a_sik h_i in column k, G has sum_i o_ik g_i, and d has sum_i d_si h_i in column s, for facets
        h of X and g of Y; what gain bounds add follows from these.
        """
        w = self.witness
        if not isinstance(w, Multipliers):
            raise ProofOmittedError("no multipliers are given")
        require_portable(self.X)
        rays = portable_rows(self.X.exact_rays)
        if self.gain_bound is not None and (rays != Matrix(np.asarray(self.X.rays, dtype=float)).fractions()).any():
            raise ProofOmittedError("bounds at generators that are no doubles are for control_kpos alone")
        plant, n = self._plant(), self.X.dim
        facets, _ = exact_geometry(plant)
        Y = None if self.ports is None else self.ports[2]
        outer = np.zeros((0, 0), dtype=object) if Y is None else _facets(Y)
        L, G = np.zeros((len(self.A), n, n), dtype=object), np.zeros((n, outer.shape[1]), dtype=object)
        for weight, (kind, *place) in zip(w.closed, self.inequalities().labels, strict=True):
            if kind == "positivity":
                s, i, k = place
                L[s, k] += weight * facets[i]
            elif kind == "output":
                i, k = place
                G[k] += weight * outer[i]
        d = np.array(w.drift, dtype=object).reshape(-1, n) @ facets
        return {"L": [columns(l, n) for l in L], "G": columns(G, outer.shape[1]), "d": columns(d, n)}

    def explain(self) -> str:
        """What is proven, in words."""
        w = self.witness
        if not isinstance(w, Multipliers):
            return "Undecided: no multipliers are given."
        labels = self.inequalities().labels
        used = [labels[i] for i, value in enumerate(w.closed) if value]
        pairs = sorted({(i, k) for kind, _, i, k in (u for u in used if u[0] == "positivity")})
        at = ", ".join(f"facet {i} at generator {k}" for i, k in pairs[:4]) + (" and others" if len(pairs) > 4 else "")
        gains = sorted({u[1] for u in used if u[0] == "gain"})
        demands = [f"invariance of X ({at})"] if pairs else []
        if gains:
            demands.append(f"the gain bound on input{'s' if len(gains) > 1 else ''} {', '.join(map(str, gains))}")
        if any(u[0] == "output" for u in used):
            demands.append("outputs in Y")
        if any(w.drift):
            speed = f"a decay rate above {self.rate:g}" if self.rate else "stability"
            demands.append(speed)
        verdict = "cannot be had with any F" if len(demands) == 1 else "exclude each other for every F"
        return (
            f"Proved impossible: {' and '.join(demands)} {verdict}; attached is {w}, checked in exact arithmetic. "
            "Relax a demand, or choose another cone."
        )


def _entries(plant: Plant) -> int:
    """About as many as `exact_inequalities` has."""
    n, m = plant.n, plant.m
    rows = n * n * len(plant.vertices) + (0 if plant.gain_bound is None else 2 * n * m)
    return (rows + (plant.system.Y.n_facets * n if plant.ports else 0)) * n * (1 + m)


def _theta(rate: float, discrete: bool) -> Fraction:
    return 1 - Fraction(rate) if discrete else -Fraction(rate)


def homogeneous_rows(
    q: Inequalities, theta: Fraction, free: NDArray[np.bool_]
) -> tuple[NDArray[np.object_], NDArray[np.intp]]:
    """Rows G; -S; xi >= 0 over xi and the z that may differ from zero, and the columns kept."""
    kept = np.concatenate([np.arange(q.n), q.n + np.flatnonzero(free.ravel())])
    positive = np.zeros((q.n, q.size), dtype=object)
    positive[np.arange(q.n), np.arange(q.n)] = 1
    rows = np.concatenate([q.closed, -q.decreasing(theta), positive])
    return rows[:, kept], kept


def exact_inequalities(plant: Plant) -> Inequalities:
    """The inequalities of a design in integers and fractions."""
    facets, rays = exact_geometry(plant)
    pairs = [(_rational(A), _rational(B)) for A, B in plant.vertices]
    drift = None
    if plant.coupling is not None:
        drift = [(A + _rational(plant.coupling), B) for A, B in pairs]
    q = feedback_inequalities(facets, rays, pairs, discrete=plant.discrete, drift_plants=drift)
    if plant.gain_bound is not None:
        slack = 1 + Fraction(1, 10**9)
        bound = np.array([Fraction(b) * slack for b in plant.gain_bound.tolist()], dtype=object)
        q = q.with_closed(*gain_rows(q.n, q.m, _lengths(plant.X, rays), bound))
    if plant.ports:
        C, D = (_rational(M) for M in plant.system.matrices[2:])
        q = q.with_closed(*output_rows(C, D, _facets(plant.system.Y), rays))
    return q


def _facets(Y: Cone) -> NDArray[np.object_]:
    return Y.exact_facets.rows_as_integers(np.arange(Y.n_facets))


def _rational(M: Matrix) -> NDArray[np.object_]:
    return M.fractions()


def _lengths(X: Cone, integer_rays: NDArray[np.object_]) -> NDArray[np.object_]:
    """Integer ray k = lengths[k] * rays[k], up to the rounding of rays[k]: a bound on F x_k, for the integer ray."""
    rays = np.asarray(X.rays, dtype=float)
    largest = np.argmax(np.abs(rays), axis=1)
    return np.array([Fraction(integer_rays[k, j]) / Fraction(rays[k, j]) for k, j in enumerate(largest)], dtype=object)


def decide(plant: Plant, rate: float) -> tuple[NoFeedback | None, NDArray[np.object_] | None]:
    """Exactly one of a proof that no gain exists and an exact solution; neither if that takes too long.

    Returns
    -------
    certificate : NoFeedback or None
    x : ndarray of Fraction or None
        (xi, z) over integer generators.
    """
    free = column_freedom(plant)
    entries, long = _entries(plant), plant.X.exact_facets.integer_rows is not None
    products = len(plant.vertices) * plant.n**3 * _EFFORT_PER_PRODUCT[long]
    if free is None or not affords(entries * EFFORT_PER_ENTRY + products):
        return None, None
    spend(entries * EFFORT_PER_ENTRY + products)
    q = exact_inequalities(plant)
    rows, kept = homogeneous_rows(q, _theta(rate, plant.discrete), free)
    first = len(q.closed)
    strict = np.arange(len(rows)) >= first
    owner = np.concatenate([np.arange(q.n), np.repeat(np.arange(q.n), q.m)])[kept]
    multipliers, solution = repaired_multipliers(rows, owner, q.n, strict), None
    if multipliers is None:
        multipliers, solution = alternative(rows, strict)
    if multipliers is not None:
        if not affords(entries * EFFORT_TO_CHECK + products):
            return None, None
        ends = np.cumsum([first, len(q.drift), q.n])
        groups = [tuple(part) for part in np.split(multipliers, ends[:-1])]
        certificate = NoFeedback.settle(
            A=tuple(A for A, _ in plant.vertices),
            B=tuple(B for _, B in plant.vertices),
            X=plant.X,
            discrete=plant.discrete,
            rate=rate,
            gain_bound=plant.gain_bound,
            free=free.astype(float),
            coupling=plant.coupling,
            ports=(*plant.system.matrices[2:], plant.system.Y) if plant.ports else None,
            witness=Multipliers(*groups),
        )
        return certificate, None
    if solution is None:
        return None, None
    x = np.full(q.size, Fraction(0), dtype=object)
    x[kept] = solution
    return None, x
