"""Proofs that no gain exists, by Farkas' lemma.

If rows G x >= 0, S x > 0 have no solution, there are weights a, b >= 0, b not zero, with a'G + b'S = 0: multiplying a
supposed solution by this identity gives 0 > 0.  They are found in rational arithmetic and checked by the kernel against
rows rebuilt from the data.  The rows are those of `simplicial.inequalities`, or, on any cone, invariance alone,
h_i'(A + B L R) x_k >= 0, which is linear in the gain L.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cards import raised
from ..cones import Cone, Orthant
from ..errors import DataError
from ..exact.budget import affords, spend
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.program import alternative
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate
from ..proof.encoding import register_record
from ..proof.portable_cones import portable_rows
from ..proof.weights import ProofOmittedError, columns, require_portable
from ..systems.system import System
from .exact_rows import exact_geometry, exact_inequalities, homogeneous_rows, outer_facets, short_rows
from .plant import Plant
from .simplicial.inequalities import Inequalities, gain_from_columns
from .simplicial.repair import repaired_multipliers

Rationals = NDArray[np.object_]

# Operations of a decision in rational arithmetic, for each entry of its rows, and of the check of its multipliers.
EFFORT_PER_ENTRY, _EFFORT_TO_CHECK = 3e4, 1e4
# Operations of a product of fractions, of data as they are given and with facets that have thousands of digits.
_EFFORT_PER_PRODUCT = 1e4, 9e4


# Where other cones come from.
_OTHERS = "find_cone and design_cone_and_feedback look for one"


def described(X: Cone) -> str:
    """A cone in words, after "being"."""
    if isinstance(X, Orthant):
        return f"the nonnegative orthant of R^{X.dim}"
    return f"a cone of {X.n_rays} generators in R^{X.dim}"


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


@register_record
@dataclass(frozen=True, eq=False)
class PairMultipliers:
    """Nonnegative weights of pairs (facet, generator), vertex after vertex, that contradict invariance.

    Attributes
    ----------
    weights : tuple of Fraction
        In the order of `numpy.nonzero(incidence)` (all pairs in discrete time), for each vertex.
    """

    weights: tuple[Fraction, ...]

    def __str__(self) -> str:
        return f"a combination of {sum(1 for w in self.weights if w)} invariance conditions that contradicts itself"


class Contradiction(Certificate):
    """The claim "there is such a gain", REFUTED by multipliers that make a contradiction of its inequalities."""

    @property
    def scope(self) -> str:
        """Which gains are excluded, as words after "gain"."""
        return ""

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        raise DataError("this certificate can only refute; give multipliers as its witness.")

    @abstractmethod
    def combination(self) -> tuple[Rationals, Rationals, NDArray[np.bool_]] | None:
        """Multipliers, the homogeneous rows they combine, and which of these are strict; None without a witness."""

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities that prove the witness, or None."""
        found = self.combination()
        if found is None or len(found[0]) != len(found[1]):
            return None
        numbers, rows, strict = found
        row, any_strict = Matrix.from_fractions(numbers[None, :]), Matrix(strict[None, :].astype(float))
        return [
            Condition("multipliers >= 0", BilinearForms(row, None, Matrix.identity(numbers.size)), ">="),
            Condition("sum of strict multipliers > 0", BilinearForms(row, None, any_strict), ">"),
            Condition("combination = 0", BilinearForms(row, None, Matrix.from_fractions(rows.T)), "=="),
        ]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoFeedback(Contradiction):
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
    leading : bool
        True: at generators with a leading entry of 1; False: with their lengths in `X.rays`.
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
    leading: bool = False

    def combination(self) -> tuple[Rationals, Rationals, NDArray[np.bool_]] | None:
        """The multipliers over rows closed, -drift and xi, of the variables that are free."""
        w = self.witness
        if not isinstance(w, Multipliers):
            return None
        m = self.B[0].shape[1]
        if self.gain_bound is not None and not (self.gain_bound.shape == (m,) and (self.gain_bound >= 0).all()):
            raise DataError("bounds on gains are not negative, one for each input.")
        if self.ports is not None and len(self.ports) != 3:
            raise DataError("the ports are C, D and Y.")
        free = _marks(self.free, (self.X.dim, m))
        rows = homogeneous_rows(self.inequalities(), self.rate, self.discrete, free)[0]
        numbers = np.array([*w.closed, *w.drift, *w.positive], dtype=object)
        return numbers, rows, np.arange(len(rows)) >= len(w.closed)

    @property
    def scope(self) -> str:
        """Of several vertices those that share a Lyapunov vector, if stability of more than one was used."""
        drift = self.witness.drift if isinstance(self.witness, Multipliers) else ()
        used = sum(any(part) for part in np.reshape(np.array(drift, dtype=object), (-1, self.X.dim)))
        return " with a common Lyapunov vector for all vertices" if used > 1 else ""

    def inequalities(self) -> Inequalities:
        """The exact inequalities that have no solution."""
        return exact_inequalities(self._plant(), as_given=not self.leading)

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
        rays, doubles = portable_rows(self.X.exact_rays), Matrix(np.asarray(self.X.rays, dtype=float))
        if self.gain_bound is not None and not self.leading and (rays != doubles.fractions()).any():
            raise ProofOmittedError("bounds at generators that are no doubles are for control_kpos alone")
        plant, n = self._plant(), self.X.dim
        facets, _ = exact_geometry(plant)
        Y = None if self.ports is None else self.ports[2]
        outer = np.zeros((0, 0), dtype=object) if Y is None else outer_facets(Y)
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
        w = self.refuted_by
        if not isinstance(w, Multipliers):
            return "Undecided: there are no multipliers that are proven."
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
            speed = f"a decay rate above {raised(self.rate)}" if self.rate else "stability"
            demands.append(speed)
        if not pairs and any(w.drift):  # what decreases is a vector inside X
            demands[-1] += " while X stays invariant"
        every = f"F{self.scope}"
        verdict = f"cannot be had with any {every}" if len(demands) == 1 else f"exclude each other for every {every}"
        return (
            f"Proved impossible: {' and '.join(demands)} {verdict}, X being {described(self.X)}; attached is {w}, "
            f"checked in exact arithmetic. Relax a demand, or choose another cone: {_OTHERS}."
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoInvariance(Contradiction):
    """Proof that no gain makes a cone invariant: the claim "there is one" is REFUTED.

    Attributes
    ----------
    A, B : tuple of Matrix
    R : Matrix
        The gain acts on R x: the identity for state feedback, C for output feedback.
    pattern : ndarray, shape (m, rows of R)
        1 where the gain may differ from zero.
    X : Cone
    discrete : bool
    witness : PairMultipliers
    """

    claim: ClassVar[str] = "invariant gain exists"

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    R: Matrix
    pattern: NDArray[np.float64]
    X: Cone
    discrete: bool

    def combination(self) -> tuple[Rationals, Rationals, NDArray[np.bool_]] | None:
        """G l + g >= 0 as [G g](l, s) >= 0 with s > 0."""
        w = self.witness
        rows = self.rows()
        if not isinstance(w, PairMultipliers) or len(w.weights) != len(rows) - 1:
            return None
        numbers = np.array(w.weights, dtype=object)
        return np.append(numbers, -(numbers @ rows[:-1, -1])), rows, np.arange(len(rows)) == len(numbers)

    def _pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Facets and generators whose products must not be negative."""
        where = np.asarray(self.X.incidence, dtype=bool)
        i, k = np.nonzero(np.ones_like(where) if self.discrete else where)
        return i, k

    def rows(self) -> Rationals:
        """Exact [G, g] with G l + g >= 0 over the free entries l of the gain, and [0, 1] below."""
        i, k = self._pairs()
        facets, rays = short_rows(self.X.exact_facets), short_rows(self.X.exact_rays)
        seen = rays @ self.R.fractions().T
        free = np.flatnonzero(_marks(self.pattern, (self.B[0].shape[1], self.R.shape[0])))
        parts = []
        for A, B in zip(self.A, self.B, strict=True):
            left = (facets @ B.fractions())[i]
            slopes = (left[:, :, None] * seen[k][:, None, :]).reshape(len(i), left.shape[1] * seen.shape[1])
            parts.append(np.concatenate([slopes[:, free], (facets @ A.fractions() @ rays.T)[i, k][:, None]], axis=1))
        return np.concatenate([*parts, np.array([[0] * len(free) + [1]], dtype=object)])

    def evidence(self) -> dict[str, Any]:
        """sum_i y_ik h_i, the facets combined by their weights, in column k of L[s], for every vertex s."""
        w, X = self.witness, self.X
        if not isinstance(w, PairMultipliers):
            raise ProofOmittedError("no multipliers are given")
        require_portable(X)
        rays, portable = short_rows(X.exact_rays), portable_rows(X.exact_rays)
        top = np.array([np.flatnonzero(row)[0] for row in rays])
        lengths = rays[np.arange(len(rays)), top] / portable[np.arange(len(rays)), top]
        facets, (i, k) = short_rows(X.exact_facets), self._pairs()
        L = np.zeros((len(self.A), X.n_rays, X.dim), dtype=object)
        for s, weights in enumerate(np.split(np.array(w.weights, dtype=object), len(self.A))):
            np.add.at(L[s], k, (weights * lengths[k])[:, None] * facets[i])
        return {"L": [columns(l, X.dim) for l in L]}

    def explain(self) -> str:
        """What is proven, in words."""
        if not isinstance(self.refuted_by, PairMultipliers):
            return "Undecided: there are no multipliers that are proven."
        return (
            f"Proved impossible: no gain of this shape keeps X invariant, X being {described(self.X)}; attached is "
            f"{self.witness}, checked in exact arithmetic. Choose more actuators, a freer structure, or another cone: "
            f"{_OTHERS}."
        )


def _marks(free: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Where 1 stands among 0 and 1; DataError for anything else."""
    if np.shape(free) != shape:
        raise DataError(f"the marks must be {shape[0]} x {shape[1]}, not {np.shape(free)}.")
    if not np.isin(free, (0, 1)).all():
        raise DataError("entries that may differ from zero are marked by 1, the others by 0.")
    return np.asarray(free) != 0


def _entries(plant: Plant) -> int:
    """About as many as `exact_inequalities` has."""
    n, m = plant.n, plant.m
    rows = n * n * len(plant.vertices) + (0 if plant.gain_bound is None else 2 * n * m)
    return (rows + (plant.system.Y.n_facets * n if plant.ports else 0)) * n * (1 + m)


def decide(plant: Plant, rate: float) -> tuple[NoFeedback | None, NDArray[np.float64] | None]:
    """Exactly one of a proof that no gain exists and a gain, rounded to doubles; neither if that takes too long.

    A gain beyond the range of doubles is infinite.
    """
    free = plant.free
    entries, long = _entries(plant), plant.X.exact_facets.integer_rows is not None
    products = len(plant.vertices) * plant.n**3 * _EFFORT_PER_PRODUCT[long]
    if free is None or not affords(entries * EFFORT_PER_ENTRY + products):
        return None, None
    spend(entries * EFFORT_PER_ENTRY + products)
    q = exact_inequalities(plant)
    rows, kept = homogeneous_rows(q, rate, plant.discrete, free)
    strict = np.arange(len(rows)) >= len(q.closed)
    owner = np.concatenate([np.arange(q.n), np.repeat(np.arange(q.n), q.m)])[kept]
    multipliers, solution = repaired_multipliers(rows, owner, q.n, strict), None
    if multipliers is None:
        multipliers, solution = alternative(rows, strict)
    if multipliers is None:
        return None, None if solution is None else _gain(plant, q, solution, kept)
    if not affords(entries * _EFFORT_TO_CHECK + products):
        return None, None
    groups = np.split(multipliers, np.cumsum([len(q.closed), len(q.drift)]))
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
        leading=True,
        witness=Multipliers(*(tuple(group) for group in groups)),
    )
    return certificate, None


def _gain(plant: Plant, q: Inequalities, solution: Rationals, kept: NDArray[np.intp]) -> NDArray[np.float64]:
    """F of an exact solution (xi, z) over integer generators."""
    x = np.full(q.size, Fraction(0), dtype=object)
    x[kept] = solution
    try:
        G = (x[q.n :].reshape(q.n, q.m) / x[: q.n, None]).T.astype(float)
        return gain_from_columns(G, exact_geometry(plant)[1].astype(float))
    except OverflowError:
        return np.full((q.m, q.n), np.inf)


def no_invariance(plant: Plant) -> NoInvariance | None:
    """The proof, if there is one within reach of exact arithmetic within the time limit."""
    pattern = np.ones(plant.shape) if plant.pattern is None else plant.pattern.astype(float)
    data = {
        "A": tuple(A for A, _ in plant.vertices),
        "B": tuple(B for _, B in plant.vertices),
        "R": Matrix.identity(plant.n) if plant.reads is None else plant.reads,
        "pattern": pattern,
        "X": plant.X,
        "discrete": plant.discrete,
    }
    entries = np.prod(plant.X.incidence.shape) * len(plant.vertices) * (1 + pattern.sum())
    if not affords(entries * EFFORT_PER_ENTRY):
        return None
    spend(entries * EFFORT_PER_ENTRY)
    rows = NoInvariance(**data).rows()
    weights, _ = alternative(rows, np.arange(len(rows)) == len(rows) - 1)
    if weights is None or not affords(entries * _EFFORT_TO_CHECK):
        return None
    return NoInvariance.settle(**data, witness=PairMultipliers(tuple(weights[:-1])))
