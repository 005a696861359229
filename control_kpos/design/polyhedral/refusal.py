"""Proof that no gain of the given shape keeps a polyhedral cone invariant.

h_i'(A + B L R) x_k >= 0 is linear in L.  If weights y >= 0 over the pairs (i, k) have
sum y_ik (h_i'B_j)(R x_k)_l = 0 for every free entry (j, l) and sum y_ik h_i'A x_k < 0, no L satisfies all of them.
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
from ..plant import EFFORT_PER_ENTRY, EFFORT_TO_CHECK, Plant, within_doubles


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


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoInvariance(Certificate):
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

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        raise DataError("this certificate can only refute; give multipliers as its witness.")

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities that prove the witness, or None."""
        w = self.witness
        if not isinstance(w, PairMultipliers):
            return None
        rows, constants = self.rows()
        numbers = np.array(w.weights, dtype=object)
        if numbers.shape != (len(rows),):
            return None
        row = Matrix.from_fractions(numbers[None, :])
        return [
            Condition("multipliers >= 0", BilinearForms(row, None, Matrix.identity(len(rows))), ">="),
            Condition("combination of slopes = 0", BilinearForms(row, None, Matrix.from_fractions(rows.T)), "=="),
            Condition(
                "combination of constants < 0",
                BilinearForms(row, None, Matrix.from_fractions(constants[None, :])),
                "<",
            ),
        ]

    def _pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Facets and generators whose products must not be negative."""
        where = np.asarray(self.X.incidence, dtype=bool)
        i, k = np.nonzero(np.ones_like(where) if self.discrete else where)
        return i, k

    @staticmethod
    def _rows_of(m: Matrix) -> NDArray[np.object_]:
        return within_doubles(m.rows_as_integers(np.arange(m.shape[0])))

    def rows(self) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
        """Exact (G, g) with G l + g >= 0 over the free entries l of the gain."""
        i, k = self._pairs()
        facets, rays = self._rows_of(self.X.exact_facets), self._rows_of(self.X.exact_rays)
        seen = rays @ self.R.fractions().T
        free = np.flatnonzero(np.asarray(self.pattern).ravel())
        rows, constants = [], []
        for A, B in zip(self.A, self.B, strict=True):
            left = (facets @ B.fractions())[i]
            full = (left[:, :, None] * seen[k][:, None, :]).reshape(len(i), left.shape[1] * seen.shape[1])
            rows.append(full[:, free])
            constants.append((facets @ A.fractions() @ rays.T)[i, k])
        return np.concatenate(rows), np.concatenate(constants)

    def evidence(self) -> dict[str, Any]:
        """sum_i y_ik h_i, the facets combined by their weights, in column k of L[s], for every vertex s."""
        w, X = self.witness, self.X
        if not isinstance(w, PairMultipliers):
            raise ProofOmittedError("no multipliers are given")
        require_portable(X)
        rays, portable = self._rows_of(X.exact_rays), portable_rows(X.exact_rays)
        top = np.array([np.flatnonzero(row)[0] for row in rays])
        lengths = rays[np.arange(len(rays)), top] / portable[np.arange(len(rays)), top]
        facets, (i, k) = self._rows_of(X.exact_facets), self._pairs()
        L = np.zeros((len(self.A), X.n_rays, X.dim), dtype=object)
        for s, weights in enumerate(np.split(np.array(w.weights, dtype=object), len(self.A))):
            np.add.at(L[s], k, (weights * lengths[k])[:, None] * facets[i])
        return {"L": [columns(l, X.dim) for l in L]}

    def explain(self) -> str:
        """What is proven, in words."""
        if not isinstance(self.witness, PairMultipliers):
            return "Undecided: no multipliers are given."
        return (
            f"Proved impossible: no gain of this shape keeps X invariant; attached is {self.witness}, checked in exact "
            "arithmetic. Choose another cone, more actuators, or a freer structure."
        )


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
    pairs = np.prod(plant.X.incidence.shape) * len(plant.vertices)
    entries = pairs * (1 + pattern.sum())
    if not affords(entries * EFFORT_PER_ENTRY):
        return None
    spend(entries * EFFORT_PER_ENTRY)
    rows, constants = NoInvariance(**data).rows()
    # G l + g >= 0 is [G g](l, s) >= 0 with s > 0
    unit = np.array([[0] * rows.shape[1] + [1]], dtype=object)
    homogeneous = np.concatenate([np.concatenate([rows, constants[:, None]], axis=1), unit])
    weights, _ = alternative(homogeneous, np.arange(len(homogeneous)) == len(rows))
    if weights is None or not affords(entries * EFFORT_TO_CHECK):
        return None
    return NoInvariance.settle(**data, witness=PairMultipliers(tuple(weights[:-1])))
