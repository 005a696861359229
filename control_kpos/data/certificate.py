"""K-positivity and stability of every plant that agrees with measurements.

Samples x1_t = A x0_t + B u0_t + v_t with |v_t| <= noise entrywise are the columns of X1 = [A B] Z + V, Z = [X0; U0].  A
plant [A B] is *consistent* if |X1 - [A B] Z| <= noise.  Its rows are consistent one by one: for z with Z l = z,

    (A x + B F x)_i >= sum_t (X1_it l_t - noise_it |l_t|)      (z = (x; F x)),

because [A B]_i z = (X1_i - V_i) l, and the largest right-hand side over l is the smallest left-hand side over all
consistent plants, by duality of linear programs; -l in its place bounds it from above.  Rows of different states do not
depend on each other, so that (A + BF) x ranges over the whole box [lo, hi] of these bounds, and

    min h'(A + BF) x = sum_{h_i > 0} h_i lo_i + sum_{h_i < 0} h_i hi_i.

That needs one l for each nonzero entry of h; a single l for all entries is only sufficient.  Every consistent plant is
K-positive with u = F x iff these sums are not negative for all facets h and generators x (continuous time, where X1
holds derivatives: for the incident pairs).  All of them are stable if h'(A + BF) e < 0 for some e in int X (discrete
time: h'(A + BF) e < h'e) for all facets, and the gauge norm of e falls, even if the plant changes in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..design.contradiction import Functionals, NoFeedback, NoInvariance
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Fractions, Status, Vector, exactly
from ..proof.encoding import register_record
from ..proof.portable_cones import portable_rows

_SAMPLED, _BELOW, _ABOVE = "Z l = (x, F x)", "X1 - [A B] Z <= noise", "X1 - [A B] Z >= -noise"
Rationals = NDArray[np.object_]
Place = tuple[int, int, int]


@register_record
@dataclass(frozen=True, eq=False)
class LeavingPlant:
    """A consistent plant that leaves X: h in X* with h'(A + BF) x < 0 for a generator x (continuous time: h'x = 0).

    Attributes
    ----------
    plant : Matrix, shape (n, n + m)
        [A B].
    ray : int
        The number of the generator.
    normal : ndarray, shape (n,)
    exact : tuple of Fraction, or None
        The exact normal where doubles do not suffice.
    """

    plant: Matrix
    ray: int
    normal: Vector = Vector(required=True)
    exact: Fractions = Fractions("normal")

    def __str__(self) -> str:
        return f"a plant that agrees with the data and leaves X at generator {self.ray}"


@register_record
@dataclass(frozen=True, eq=False)
class ExcludingPlants:
    """Consistent plants that no u = F x serves together: what they demand of F contradicts itself.

    Attributes
    ----------
    A, B : tuple of Matrix, shapes (n, n) and (n, m)
        One pair for each plant.
    functionals : Functionals
        The contradiction of what is demanded of F, see `control_kpos.design.contradiction`: of positivity and
        stability by a common e, or, without `d`, of positivity alone.
    """

    A: tuple[Matrix, ...]
    B: tuple[Matrix, ...]
    functionals: Functionals

    def contradiction(self, X: Cone, *, discrete: bool) -> NoFeedback | NoInvariance:
        """What the functionals prove about these plants.

        Parameters
        ----------
        X : Cone
        discrete : bool
        """
        (n, m), given = self.B[0].shape, {"A": self.A, "B": self.B, "X": X, "discrete": discrete}
        if self.functionals.d is None:
            eye = Matrix.identity(n)
            return NoInvariance(**given, R=eye, pattern=np.ones((m, n)), witness=self.functionals)
        return NoFeedback(**given, rate=0.0, free=np.ones((X.n_rays, m)), witness=self.functionals)

    @property
    def falling(self) -> int:
        """Of how many plants the stability is used."""
        d = self.functionals.d
        return 0 if d is None else int((d.fractions() != 0).astype(bool).any(axis=0).sum())

    def __str__(self) -> str:
        count = len(self.A)
        return f"{count} such plant{'s' * (count != 1)} and {self.functionals}"


def places(facets: Rationals, rays: Rationals, *, discrete: bool, stable: bool) -> list[Place]:
    """Which bounds a proof needs, in order: (k, i, 0) for the lower bound of entry i of the image of generator k, 1
    for the upper bound; k is the number of generators for e.

    Parameters
    ----------
    facets, rays : ndarray of Fraction, shapes (r, n) and (p, n)
    discrete : bool
    stable : bool
        Bounds of the image of e are needed as well.
    """
    signs = (facets > 0).astype(int) - (facets < 0).astype(int)
    counted = np.ones((len(facets), len(rays)), bool) if discrete else (facets @ rays.T == 0).astype(bool)
    out = [place for k in range(len(rays)) for place in _needed(k, signs[counted[:, k]])]
    return out + (_needed(len(rays), -signs) if stable else [])


def _needed(k: int, signs: NDArray[np.int_]) -> list[Place]:
    sides = np.any(signs > 0, axis=0), np.any(signs < 0, axis=0)
    return [(k, i, side) for i in range(signs.shape[1]) for side in (0, 1) if sides[side][i]]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DataCertificate(Certificate):
    """Proof that every plant which agrees with the data keeps X, and is stable if e is there; or that one leaves X, or
    that no gain F serves all of them.

    Attributes
    ----------
    X0, X1 : Matrix, shape (n, T)
        States, and one step later, or their derivatives.
    noise : Matrix, shape (n, T)
        |X1 - A X0 - B U0| is at most this.
    U0, F : Matrix, shapes (m, T) and (m, n), or None
        Inputs in the experiments, and the gain of u = F x; None: without inputs.
    X : Cone
    discrete : bool
    plant : Matrix, shape (n, n + m), or None
        [A B] of one plant that agrees with the data.
    combinations : Matrix, shape (K, T), or None
        The l of every bound that is needed, in the order of `places`.
    e : ndarray, shape (n,), or None
        In the interior of X: its gauge norm falls under every consistent plant.
    exact : tuple of Fraction, or None
        The exact e where doubles do not suffice.
    witness : LeavingPlant or ExcludingPlants or None
        The latter without F: no gain serves these plants together.
    """

    claim: ClassVar[str] = "from data"
    no_margin: ClassVar[frozenset[str]] = frozenset({_SAMPLED, _BELOW, _ABOVE, "h'x = 0", "h'x >= 0"})

    X0: Matrix
    X1: Matrix
    noise: Matrix
    X: Cone
    discrete: bool
    U0: Matrix | None = None
    F: Matrix | None = None
    plant: Matrix | None = None
    combinations: Matrix | None = None
    e: Vector = Vector()
    exact: Fractions = Fractions("e")

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        if self.combinations is None or self.plant is None:
            raise DataError("a proof needs combinations, and a plant that agrees with the data.")
        named, facets, rays = self._places, self._facets, self._vectors
        if self.combinations.shape != (len(named), self.X0.shape[1]):
            raise DataError("there must be one row of combinations for every bound, of one number for every sample.")
        bounds, p, n = self._bounds(named), self.X.n_rays, self.X.dim
        high, low = np.maximum(facets, 0), np.minimum(facets, 0)
        needed = np.ones((len(facets), p), dtype=bool)
        if not self.discrete:
            needed = (facets @ rays[:p, :n].T == 0).astype(bool)
        sides = Matrix.from_fractions(np.concatenate([high, low], axis=1))
        images = BilinearForms(sides, None, Matrix.from_fractions(bounds[:p]))
        out = [*self.agreement(self.plant), self._sampled(named), Condition("h'(A + B F) x >= 0", images, ">=", needed)]
        return out if self.e is None else [*out, *self._falls(bounds[p], rays[p, :n], high, low)]

    def _falls(self, bounds: Rationals, e: Rationals, high: Rationals, low: Rationals) -> list[Condition]:
        """h'e > 0, and the largest h'(A + BF) e is negative, or below h'e."""
        facets = self._facets
        sides = Matrix.from_fractions(np.concatenate([low, high, -int(self.discrete) * facets], axis=1))
        row = Matrix.from_fractions(np.concatenate([bounds, e])[None])
        inside = BilinearForms(Matrix.from_fractions(facets), None, Matrix.from_fractions(e[None]))
        return [
            Condition("h'e > 0", inside, ">"),
            Condition("h'(A + B F) e < 0", BilinearForms(sides, None, row), "<"),
        ]

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w, n = self.witness, self.X.dim
        if isinstance(w, ExcludingPlants):
            return self._no_gain(w)
        if not isinstance(w, LeavingPlant) or self.combinations is not None or self.e is not None:
            return None
        if type(w.ray) is not int or not 0 <= w.ray < self.X.n_rays:
            raise DataError("there is no such generator.")
        h, z = exactly(w, "normal")[None], Matrix.from_fractions(self._vectors[[w.ray]])
        if w.plant.shape != (n, self._Z.shape[0]) or h.shape != (1, n):
            raise DataError("the plant or its normal has another size.")
        own = Matrix.from_fractions(self._vectors[[w.ray], :n])
        kept = [] if self.discrete else [Condition("h'x = 0", BilinearForms(h, None, own), "==")]
        return [
            *self.agreement(w.plant),
            Condition("h'x >= 0", BilinearForms(h, None, self.X.exact_rays), ">="),
            *kept,
            Condition("h'(A + B F) x < 0", BilinearForms(h, w.plant, z), "<"),
        ]

    def _no_gain(self, w: ExcludingPlants) -> list[Condition]:
        """All plants agree, and their demands contradict each other."""
        if self.U0 is None or (self.F, self.combinations, self.e) != (None, None, None):
            raise DataError("that no gain exists is about plants with inputs, and there is no F.")
        if not (w.A and len(w.A) == len(w.B)):
            raise DataError("there must be one A and one B for every plant.")
        agreed: list[Condition] = []
        for s, pair in enumerate(zip(w.A, w.B, strict=True)):
            agreed += self.agreement(Matrix.join(pair, -1), f", plant {s}")
        return [*agreed, *(w.contradiction(self.X, discrete=self.discrete).refutation() or ())]

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        (n, T), m = self.X0.shape, 0 if self.U0 is None else self.U0.shape[0]
        if n != self.X.dim or any(M.shape != (n, T) for M in (self.X1, self.noise)):
            raise DataError("X0, X1, noise and X are of different sizes.")
        none = isinstance(self.witness, ExcludingPlants)
        if (not none and (self.U0 is None) != (self.F is None)) or (self.F is not None and self.F.shape != (m, n)):
            raise DataError("inputs need a gain F, of one row for each.")
        if self.U0 is not None and self.U0.shape != (m, T):
            raise DataError("U0 has another number of samples.")
        if self.witness is None and self.combinations is None:
            return Status.UNDECIDED, ()
        return super()._evaluate()

    # -- parts

    def targets(self) -> Rationals:
        """The (x; F x) that the combinations of each bound make, row by row."""
        return self._vectors[[k for k, _, _ in self._places]]

    @cached_property
    def _facets(self) -> Rationals:
        return self.X.exact_facets.plain().fractions()

    @cached_property
    def _Z(self) -> Matrix:
        return self.X0 if self.U0 is None else Matrix.join([self.X0, self.U0], -2)

    @cached_property
    def _places(self) -> list[Place]:
        rays = portable_rows(self.X.exact_rays)
        return places(self._facets, rays, discrete=self.discrete, stable=self.e is not None)

    @cached_property
    def _vectors(self) -> Rationals:
        """(x; F x) for every generator, and for e."""
        states = portable_rows(self.X.exact_rays)
        if self.e is not None:
            states = np.concatenate([states, exactly(self, "e").fractions()[None]])
        return states if self.F is None else np.concatenate([states, states @ self.F.fractions().T], axis=1)

    def _sampled(self, named: list[Place]) -> Condition:
        """Every l combines the samples to its (x; F x)."""
        chosen = np.zeros((len(named), len(self._vectors)))
        chosen[np.arange(len(named)), [k for k, _, _ in named]] = -1.0
        left = Matrix.join([self.combinations, Matrix(chosen)], -1)  # type: ignore[list-item]
        right = Matrix.join([self._Z, Matrix.from_fractions(self._vectors.T)], -1)
        return Condition(_SAMPLED, BilinearForms(left, None, right), "==")

    def _bounds(self, named: list[Place]) -> Rationals:
        """Row k: lower bounds of the image of the k-th vector, then upper bounds; 0 where none is needed."""
        n = self.X.dim
        out = np.zeros((len(self._vectors), 2 * n), dtype=int).astype(object)
        (l, unit), data = self.combinations.as_integers(), Matrix.join([self.X1, self.noise], -2)  # type: ignore[union-attr]
        measured, other = data.as_integers()
        for row, (k, i, side) in zip(l, named, strict=True):
            at = np.flatnonzero(row)
            value = row[at] @ measured[i, at] - (1 - 2 * side) * (np.abs(row[at]) @ measured[n + i, at])
            out[k, side * n + i] = value * unit * other
        return out

    def agreement(self, plant: Matrix, of: str = "") -> list[Condition]:
        """The inequalities that say that a plant agrees with the data.

        Parameters
        ----------
        plant : Matrix, shape (n, n + m)
            [A B].
        of : str
            Which plant, as a part of the names of the conditions.
        """
        n, eye = self.X.dim, Matrix.identity(self.X.dim)
        if plant.shape != (n, self._Z.shape[0]):
            raise DataError("the plant is of another size than the data.")
        right = Matrix.join([self._Z, self.X1, self.noise], -2).T
        return [
            Condition(_BELOW + of, BilinearForms(Matrix.join([plant, -eye, eye], -1), None, right), ">="),
            Condition(_ABOVE + of, BilinearForms(Matrix.join([plant, -eye, -eye], -1), None, right), "<="),
        ]

    def evidence(self) -> dict[str, Any]:
        """Nothing more: the data hold all that is needed."""
        return {}

    def explain(self) -> str:
        """What is proven, in words."""
        law = "" if self.F is None or self.F.is_zero else " with u = F x"
        if isinstance(self.refuted_by, ExcludingPlants):
            return self._told(self.refuted_by)
        if self.refuted_by is not None:
            return f"Refuted: not every plant that agrees with the data keeps X{law}: there is {self.witness}."
        if not self:
            return "Undecided: no statement about all plants that agree with the data is proven."
        stable = (
            " Stability is not claimed."
            if self.e is None
            else (
                " All of them are exponentially stable, also if the plant changes in time: the gauge norm of e, the "
                "largest abs(h'x) / h'e over the facets h, falls under each of them."
            )
        )
        return f"Proved: every plant that agrees with the data within the noise keeps X{law}.{stable}"

    def _told(self, w: ExcludingPlants) -> str:
        """What plants exclude."""
        also = (
            "",
            " and makes all of them stable",
            " and makes all of them stable with a common e",
        )[min(w.falling, 2)]
        other = " Other proofs of stability than by a common e are not excluded." if w.falling > 1 else ""
        return (
            f"Refuted: no gain F keeps X for every plant that agrees with the data{also}. The proof is {w}, checked "
            f"in exact arithmetic.{other}"
        )
