"""Proofs that no gain exists, by Farkas' lemma.

If rows G x >= 0, S x > 0 have no solution, there are weights a, b >= 0, b not zero, with a'G + b'S = 0: multiplying a
supposed solution by this identity gives 0 > 0.  The weights are found in rational arithmetic, for the rows of
`simplicial.inequalities`, or, on any cone, of invariance alone, h_i'(A + B G R) x_k >= 0, which is linear in the gain.
What is proven is a combination of the demands themselves: weights of facets make functionals l that are nonnegative on
a cone, with which l'(A + B F) x >= 0 is demanded whatever the facets are.
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
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate
from ..proof.encoding import register_record
from ..proof.portable_cones import portable
from ..proof.weights import ProofOmittedError
from ..systems.system import System
from .exact_rows import exact_geometry, exact_inequalities, lengths, outer_facets, short_rows
from .plant import Plant, leading_sizes

Rationals = NDArray[np.object_]

# What the refutation of a common vector is about, and leaves open.
_COMMON = " with a common vector x inside X for all vertices"
_OTHER_VECTOR = "A common v in X*, with V(x) = v'x falling at all vertices, is not excluded by this. "
# Where other cones come from.
_OTHERS = "find_cone and design_cone_and_feedback look for one"


def described(X: Cone) -> str:
    """A cone in words, after "being"."""
    if isinstance(X, Orthant):
        return f"the nonnegative orthant of R^{X.dim} (the default)"
    return f"a cone of {X.n_rays} generators in R^{X.dim}"


@register_record
@dataclass(frozen=True, eq=False)
class Multipliers:
    """Nonnegative numbers that combine the rows of `exact_inequalities` into a contradiction; made `Functionals`.

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


@register_record
@dataclass(frozen=True, eq=False)
class PairMultipliers:
    """Nonnegative weights of pairs (facet, generator), vertex after vertex, against invariance; made `Functionals`.

    Attributes
    ----------
    weights : tuple of Fraction
        In the order of `numpy.nonzero(incidence)` (all pairs in discrete time), for each vertex.
    """

    weights: tuple[Fraction, ...]


@register_record
@dataclass(frozen=True, eq=False)
class Functionals:
    """Functionals, nonnegative on cones, that combine the demands on a gain into a contradiction.

    Attributes
    ----------
    L : tuple of Matrix, shape (n, N)
        For every vertex: column k is the l >= 0 on X, l'x_k = 0 in continuous time, of l'(A + B F) x_k >= 0.
    d : Matrix, shape (n, number of vertices), or None
        Column s is a functional >= 0 on X that is to decrease with vertex s.
    G : Matrix, shape (q, N), or None
        Column k is the g >= 0 on Y of g'(C + D F) x_k >= 0.
    """

    L: tuple[Matrix, ...]
    d: Matrix | None = None
    G: Matrix | None = None

    def __str__(self) -> str:
        parts = [part for part in (*self.L, self.d, self.G) if part is not None]
        used = sum(int(np.count_nonzero((part.fractions() != 0).any(axis=0))) for part in parts)
        return f"a combination of {used} demand{'s' * (used != 1)} that contradicts itself"


class Contradiction(Certificate):
    """The claim "there is such a gain", REFUTED by functionals that make a contradiction of its inequalities."""

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    X: Cone
    discrete: bool

    @property
    def scope(self) -> str:
        """Which gains are excluded, as words after "gain"."""
        return ""

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        raise DataError("this certificate can only refute; give functionals as its witness.")

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> Any:
        """The inverse of `contents`; the multipliers of facets in files of version 0.1 are made functionals."""
        return cls.refuted(**contents)

    @classmethod
    def refuted(cls, *, witness: Any, **data: Any) -> Any:
        """The certificate with what these multipliers of facets, or functionals, prove."""
        draft = cls(**data, witness=witness)
        return cls.settle(**data, witness=draft.functionals())

    @abstractmethod
    def functionals(self) -> Any:
        """The witness, and what the multipliers of facets combine to if it has those."""

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities that prove the witness, or None."""
        w = self.witness
        return [*self._inwards(w.L), *self.contradiction(w)] if isinstance(w, Functionals) else None

    @abstractmethod
    def contradiction(self, w: Functionals) -> list[Condition]:
        """The inequalities on the combination of all demands."""

    def evidence(self) -> dict[str, Any]:
        """Nothing: the functionals are in the data."""
        return {}

    @property
    def rays(self) -> Matrix:
        """The generators, with the lengths that they have in files."""
        return portable(self.X.exact_rays)

    def _inwards(self, L: tuple[Matrix, ...]) -> list[Condition]:
        """l >= 0 on X, and in continuous time l_k'x_k = 0."""
        out, rays, n = [], self.rays, self.X.dim
        if not len(L) == len(self.A) == len(self.B) or any(
            A.shape != (n, n) or B.shape != (n, self.B[0].shape[1]) for A, B in zip(self.A, self.B, strict=True)
        ):
            raise DataError("there are functionals, A and B for every vertex, of the sizes of X and of the inputs.")
        for s, functionals in enumerate(L):
            forms = values_on(functionals, rays, rays.shape[0])
            out.append(Condition(f"l{s}'x >= 0", forms, ">="))
            if not self.discrete:
                out.append(Condition(f"l{s}_k'x_k = 0", forms, "==", np.eye(rays.shape[0], dtype=bool)))
        return out


def values_on(functionals: Matrix | None, rays: Matrix, count: int) -> BilinearForms:
    """f'x for so many functionals, given as columns, and all generators."""
    if functionals is None or functionals.shape != (rays.shape[1], count):
        raise DataError(f"functionals are missing, or are not {rays.shape[1]} x {count}.")
    return BilinearForms(functionals.T, None, rays)


def numbers(x: Any) -> BilinearForms:
    """Exact numbers as forms."""
    return BilinearForms(Matrix.from_fractions(np.atleast_2d(np.array(x, dtype=object)).T), None, Matrix.identity(1))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoFeedback(Contradiction):
    """Proof that no u = F x makes a simplicial cone invariant and the closed loop stable as demanded.

    The claim is "there is such an F"; the status is REFUTED when the functionals contradict it.

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
        |F x_k| <= gain_bound at the generators.
    leading : bool
        True: at generators with a leading entry of 1; False: with their lengths in `X.rays`.
    free : ndarray, shape (n, m)
        1 where F x_k may differ from zero.
    coupling : Matrix or None
        Stability was asked of A + B F + coupling.
    witness : Functionals
    """

    claim: ClassVar[str] = "feedback exists"

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    X: Cone
    discrete: bool
    rate: float
    gain_bound: NDArray[np.float64] | None = None
    free: NDArray[np.float64]
    coupling: Matrix | None = None
    ports: tuple[Matrix, Matrix, Cone] | None = None
    leading: bool = False

    def contradiction(self, w: Functionals) -> list[Condition]:
        """What is asked would make sum_k xi_k (a_k + b_k'F x_k) >= 0 for some xi > 0, and > 0 if some d is not 0.

        But a_k + |b_k|'gain_bound <= 0 for all k, b_k = 0 without a bound; and one is < 0 unless some d is not 0.
        """
        rays, count = self.rays, len(self.A)
        out = [Condition("d'x >= 0", values_on(w.d, rays, count), ">=")]
        if self.ports is None and w.G is not None:
            raise DataError("there are no outputs that G could be about.")
        if self.ports is not None:
            out.append(Condition("g'y >= 0", values_on(w.G, portable(self.ports[2].exact_rays), rays.shape[0]), ">="))
        a, b = self._combined(w)
        if self.gain_bound is None:
            out.append(Condition("b = 0", numbers(b.ravel()), "=="))
        else:
            a = a + (np.abs(b) @ Matrix(self.gain_bound).fractions()) * self._sizes()
        d = (w.d.fractions().T @ rays.fractions().T).sum() if w.d is not None else 0
        out.append(Condition("a + |b|'gain_bound <= 0", numbers(a), "<="))
        return [*out, Condition("sum of d'x - a - |b|'gain_bound > 0", numbers([d - a.sum()]), ">")]

    def _combined(self, w: Functionals) -> tuple[Rationals, Rationals]:
        """a (one for each generator) and b (a row for each generator), 0 where F x_k cannot differ from zero."""
        m, rays = self.B[0].shape[1], self.rays.fractions()
        free = marks(self.free, (len(rays), m))
        if self.gain_bound is not None and not (self.gain_bound.shape == (m,) and (self.gain_bound >= 0).all()):
            raise DataError("bounds on gains are not negative, one for each input.")
        a, b = np.zeros(len(rays), dtype=object), np.zeros((len(rays), m), dtype=object)
        extra = int(self.discrete) - Fraction(self.rate)
        added = -extra * rays.T if self.coupling is None else self.coupling.fractions() @ rays.T - extra * rays.T
        d = () if w.d is None else w.d.fractions().T
        for l, f, A, B in zip(w.L, d, self.A, self.B, strict=True):
            moved, pushed, own = A.fractions() @ rays.T, B.fractions(), l.fractions()
            a = a + (own * moved).sum(axis=0) - f @ (moved + added)
            b = b + own.T @ pushed - f @ pushed
        if self.ports is not None and w.G is not None:
            (C, D, Y), g = self.ports, w.G.fractions()
            if C.shape != (Y.dim, len(rays)) or D.shape != (Y.dim, m):
                raise DataError("C and D do not fit the cones.")
            a, b = a + (g * (C.fractions() @ rays.T)).sum(axis=0), b + g.T @ D.fractions()
        return a, b * free

    def _sizes(self) -> Rationals:
        """What a bound on |F x_k| is multiplied by, for the generators in files."""
        rays = self.rays.fractions()
        return leading_sizes(rays) if self.leading else lengths(self.X, rays)

    @property
    def scope(self) -> str:
        """Those of the structure; of several vertices with a common x, if stability of more than one was used."""
        w = self.witness
        used = w.d.fractions().any(axis=0).sum() if isinstance(w, Functionals) and w.d is not None else 0
        return ("" if np.all(self.free) else " of this structure") + (_COMMON if used > 1 else "")

    def functionals(self) -> Any:
        """The witness; for multipliers of the rows of `exact_inequalities` the facets that they combine.

        L[s] has sum_i a_sik h_i in column k, G has sum_i o_ik g_i, and d has sum_i d_si h_i in column s, for facets
        h of X and g of Y; what gain bounds and xi > 0 add follows from these.
        """
        w = self.witness
        if not isinstance(w, Multipliers):
            return w
        plant, n = self._plant(), self.X.dim
        facets, _ = exact_geometry(plant)
        outer = np.zeros((0, 0), dtype=object) if self.ports is None else outer_facets(self.ports[2])
        L, G = np.zeros((len(self.A), n, n), dtype=object), np.zeros((n, outer.shape[1]), dtype=object)
        labels = exact_inequalities(plant, as_given=not self.leading).labels
        for weight, (kind, *place) in zip(w.closed, labels, strict=True):
            if kind == "positivity":
                s, i, k = place
                L[s, k] += weight * facets[i]
            elif kind == "output":
                i, k = place
                G[k] += weight * outer[i]
        d = np.array(w.drift, dtype=object).reshape(-1, n) @ facets
        unit = unit_of(*L, G, d)
        outputs = None if self.ports is None else as_columns(G * unit)
        return Functionals(tuple(as_columns(l * unit) for l in L), as_columns(d * unit), outputs)

    def _plant(self) -> Plant:
        *C_D, Y = self.ports or (None,)
        system = System.read((self.A[0], self.B[0], *C_D), X=self.X, Y=Y, dt=self.discrete)
        pairs, ports = tuple(zip(self.A, self.B, strict=True)), self.ports is not None
        return Plant(system, pairs, gain_bound=self.gain_bound, ports=ports, coupling=self.coupling)

    def evidence(self) -> dict[str, Any]:
        """Nothing: the functionals are in the data."""
        doubles = Matrix(np.asarray(self.X.rays, dtype=float)).fractions()
        if self.gain_bound is not None and not self.leading and (self.rays.fractions() != doubles).any():
            raise ProofOmittedError("bounds at generators that are no doubles are for control_kpos alone")
        return super().evidence()

    def explain(self) -> str:
        """What is proven, in words."""
        w = self.refuted_by
        if not isinstance(w, Functionals):
            return "Undecided: there are no multipliers that are proven."
        # on a simplicial cone l = sum_i a_i h_i, where a_i > 0 if l'x_i > 0 for the generator x_i that h_i is not 0 on
        seen = [self.rays.fractions() @ l.fractions() for l in w.L]
        pairs = sorted({(int(i), int(k)) for values in seen for i, k in np.argwhere(values != 0)})
        at = ", ".join(f"facet {i} at generator {k}" for i, k in pairs[:4]) + (" and others" if len(pairs) > 4 else "")
        gains = np.flatnonzero((self._combined(w)[1] != 0).any(axis=0)).tolist()
        drift = w.d is not None and w.d.fractions().any()
        demands = [f"invariance of X ({at})"] if pairs else []
        if gains:
            demands.append(f"the gain bound on input{'s' if len(gains) > 1 else ''} {', '.join(map(str, gains))}")
        if w.G is not None and w.G.fractions().any():
            demands.append("outputs in Y")
        if drift:
            speed = f"a decay rate above {raised(self.rate)}" if self.rate else "stability"
            demands.append(speed)
        if not pairs and drift:  # what decreases is a vector inside X
            demands[-1] += " while X stays invariant"
        every, besides = f"F{self.scope}", _OTHER_VECTOR if self.scope.endswith(_COMMON) else ""
        verdict = f"cannot be had with any {every}" if len(demands) == 1 else f"exclude each other for every {every}"
        names = self._signals.legend(" and ".join(demands))
        return (
            f"Proved impossible: {' and '.join(demands)} {verdict}, X being {described(self.X)}; attached is {w}, "
            f"checked in exact arithmetic.{names} {besides}Relax a demand, or choose another cone: {_OTHERS}."
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
    witness : Functionals
    """

    claim: ClassVar[str] = "invariant gain exists"

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    R: Matrix
    pattern: NDArray[np.float64]
    X: Cone
    discrete: bool

    def contradiction(self, w: Functionals) -> list[Condition]:
        """sum l'A x < 0, and sum (B'l) (R x)' = 0 where the gain may differ from zero."""
        rays, level = self.rays.fractions(), Fraction(0)
        free = marks(self.pattern, (self.B[0].shape[1], self.R.shape[0]))
        if self.R.shape != (free.shape[1], self.X.dim) or (w.d, w.G) != (None, None):
            raise DataError("R does not fit X, or there are functionals d or G, which mean nothing here.")
        slope = np.zeros(free.shape, dtype=object)
        for l, A, B in zip(w.L, self.A, self.B, strict=True):
            own = l.fractions()
            level += (own * (A.fractions() @ rays.T)).sum()
            slope = slope + B.fractions().T @ own @ (rays @ self.R.fractions().T)
        out = [Condition("sum l'A x < 0", numbers([level]), "<")]
        return [*out, Condition("sum (B'l) (R x)' = 0", numbers(slope[free]), "==")] if free.any() else out

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
        free = np.flatnonzero(marks(self.pattern, (self.B[0].shape[1], self.R.shape[0])))
        parts = []
        for A, B in zip(self.A, self.B, strict=True):
            left = (facets @ B.fractions())[i]
            slopes = (left[:, :, None] * seen[k][:, None, :]).reshape(len(i), left.shape[1] * seen.shape[1])
            parts.append(np.concatenate([slopes[:, free], (facets @ A.fractions() @ rays.T)[i, k][:, None]], axis=1))
        return np.concatenate([*parts, np.array([[0] * len(free) + [1]], dtype=object)])

    def functionals(self) -> Any:
        """The witness; for multipliers of pairs sum_i y_ik h_i, the facets they combine, in column k of L[s]."""
        w, X = self.witness, self.X
        if not isinstance(w, PairMultipliers):
            return w
        rays, own = short_rows(X.exact_rays), self.rays.fractions()
        top = np.array([np.flatnonzero(row)[0] for row in rays])
        stretch = rays[np.arange(len(rays)), top] / own[np.arange(len(rays)), top]
        facets, (i, k) = short_rows(X.exact_facets), self._pairs()
        L = np.zeros((len(self.A), X.n_rays, X.dim), dtype=object)
        for s, weights in enumerate(np.split(np.array(w.weights, dtype=object), len(self.A))):
            np.add.at(L[s], k, (weights * stretch[k])[:, None] * facets[i])
        unit = unit_of(*L)
        return Functionals(tuple(as_columns(l * unit) for l in L))

    def explain(self) -> str:
        """What is proven, in words."""
        if not isinstance(self.refuted_by, Functionals):
            return "Undecided: there are no multipliers that are proven."
        return (
            f"Proved impossible: no gain of this shape keeps X invariant, X being {described(self.X)}; attached is "
            f"{self.witness}, checked in exact arithmetic. Choose more actuators, a freer structure, or another cone: "
            f"{_OTHERS}."
        )


def as_columns(vectors: Rationals) -> Matrix:
    """Vectors as the columns of a matrix."""
    return Matrix.from_fractions(vectors.T)


def unit_of(*parts: Rationals) -> Fraction:
    """A power of two that brings the largest of these numbers near 1."""
    largest = max((abs(Fraction(x)) for part in parts for x in part.ravel()), default=Fraction(1)) or Fraction(1)
    return Fraction(2) ** (largest.denominator.bit_length() - largest.numerator.bit_length())


def marks(free: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Where 1 stands among 0 and 1; DataError for anything else."""
    if np.shape(free) != shape:
        raise DataError(f"the marks must be {shape[0]} x {shape[1]}, not {np.shape(free)}.")
    if not np.isin(free, (0, 1)).all():
        raise DataError("entries that may differ from zero are marked by 1, the others by 0.")
    return np.asarray(free) != 0
