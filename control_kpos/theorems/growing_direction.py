"""Directions of growth: what shows that a K-positive system is not exponentially stable.

Some x in X, x != 0, with A x in X (A x - x in X in discrete time).  Facets prove that both are in X; where they are
too many, nonnegative combinations of generators do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cards import raised, shown
from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Fractions, Vector, exactly
from ..proof.encoding import register_record
from ..proof.inclusion import GeneratorProof
from ..proof.portable_cones import own_generators
from ..proof.proposed_weights import combinations
from .decay_rates import Rate, transposed_drift


@register_record
@dataclass(frozen=True, eq=False)
class InstabilityDirection:
    """Some x in X, x != 0, with A x in X (A x - x in X in discrete time): no trajectory from x decays.

    Attributes
    ----------
    x : ndarray, shape (n,)
    exact : tuple of Fraction, or None
        The exact vector where doubles do not suffice; x is its rounding.
    """

    x: Vector = Vector(required=True)
    exact: Fractions = Fractions("x")

    def __str__(self) -> str:
        return f"a direction x = {shown(self.x)} in X along which the state does not decay"


@register_record
@dataclass(frozen=True, eq=False)
class SlowDirection(InstabilityDirection):
    """Some x in X, x != 0, with A x + rate x in X (A x - x + rate x): no v'x decreases faster than at this rate.

    Attributes
    ----------
    rate : float or Fraction
        Below the decay rate that was asked for; or that rate, if A x + rate x is not 0.
    """

    rate: Rate = 0.0

    def __str__(self) -> str:
        rate = raised(float(self.rate))
        return f"a direction x = {shown(self.x)} in X along which v'x decays at a rate of at most {rate}"


@register_record
@dataclass(frozen=True, eq=False)
class InstabilityCombination(InstabilityDirection):
    """A direction of growth with the weights that show it, without facets.

    Attributes
    ----------
    weights : Matrix, shape (2, N)
        x and A x (A x - x) as combinations of the generators, up to an error that the proof takes up.
    """

    weights: Matrix | None = None


# -- inequalities


def instability_conditions(A: Matrix, X: Cone, discrete: bool, w: InstabilityDirection) -> list[Condition]:
    """x in X and A x in X (A x - x in X), on the facets of X; for a slow direction A x + rate x."""
    x, rate = exactly(w, "x")[None], w.rate if isinstance(w, SlowDirection) else 0.0
    return [
        Condition("h'x >= 0", BilinearForms(x, None, X.exact_facets), ">="),
        Condition("h'A x >= 0", transposed_drift(x, A, X, discrete, rate), ">="),
    ]


def moving_condition(A: Matrix, X: Cone, discrete: bool, w: SlowDirection) -> Condition:
    """A x + rate x is not 0: some facet is positive on it."""
    moved = transposed_drift(exactly(w, "x")[None], A, X, discrete, w.rate)
    positive = moved.signs() == 1
    return Condition("h'(A x + rate x) > 0", moved, ">", positive if positive.any() else None)


def combination_conditions(
    A: Matrix, X: Cone, discrete: bool, w: InstabilityCombination, proof: GeneratorProof
) -> list[Condition]:
    """x in X and A x in X (A x - x in X), on generators of a cone that `proof` shows to be proper."""
    rays, x = own_generators(X), exactly(w, "x")[None]
    if w.weights is None or w.weights.shape != (2, rays.shape[0]):
        raise DataError("there must be two weights for every generator.")
    basis, everywhere = Generators(rays, proof.right_inverse), np.ones((rays.shape[0], 1), dtype=bool)
    own, moved = (w.weights[np.array([k])].T for k in range(2))
    eye = Matrix.identity(X.dim)
    terms = [(A.plain(), x), *([(-eye, x)] if discrete else [])]
    return [basis.images("x = R q", eye, x, own), basis.combination("A x = R q", terms, moved, everywhere)]


def growing_combination(
    A: Matrix, X: Cone, discrete: bool, x: Matrix, proof: GeneratorProof
) -> InstabilityCombination | None:
    """Weights that show growth along x, not yet proven; None if there are none."""
    shift = np.eye(X.dim, dtype=int).astype(object) * int(discrete)
    moved = Matrix.from_fractions(A.plain().fractions() - shift)
    found = [combinations(X, proof, M, x[None]) for M in (Matrix.identity(X.dim), moved)]
    if found[0] is None or found[1] is None:
        return None
    weights = Matrix.join([found[0].T, found[1].T], -2)
    return InstabilityCombination(x, None, weights)
