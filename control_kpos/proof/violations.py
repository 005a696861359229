"""What breaks an inclusion M S in T of cones: a supporting plane of T and a generator of S on its wrong side."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..exact.condition import Condition
from ..exact.intake import shown
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from .encoding import register_record
from .generators import SUPPORTING, own_generators, portable


@register_record
@dataclass(frozen=True, eq=False)
class PositivityViolation:
    """A facet and a generator that break an inclusion.

    Attributes
    ----------
    condition : str
        "A X in X", "B U in X", "C X in Y" or "D U in Y"; for A in continuous time this stands for
        e^{At} X in X.
    facet, ray : int
        Row numbers in `facets` of the target cone and in `rays` of the source cone.
    normal, generator : ndarray
        These two rows.
    value : float
        normal' M generator < 0, in floating point (its sign is proven).
    """

    condition: str
    facet: int
    ray: int
    normal: NDArray[np.float64]
    generator: NDArray[np.float64]
    value: float

    def __str__(self) -> str:
        return (
            f"{self.condition} fails at facet {self.facet}, normal {shown(self.normal)}, and generator "
            f"{self.ray}, {shown(self.generator)}: the product is {self.value:.3g} < 0"
        )


@register_record
@dataclass(frozen=True, eq=False)
class PlaneViolation(PositivityViolation):
    """A supporting hyperplane and a generator that break an inclusion, found without facets.

    Attributes
    ----------
    facet : int
        -1: facets have not been enumerated.
    ray : int
        Row number among the generators of the source cone as they were given.
    normal : ndarray
        Rounded; no generator of the target cone is on its negative side.
    normal_exact : tuple of Fraction
        The exact normal.
    """

    normal_exact: tuple[Fraction, ...] = ()

    def __str__(self) -> str:
        return (
            f"{self.condition} fails at the supporting plane with normal {shown(self.normal)} and generator "
            f"{self.ray}, {shown(self.generator)}: the product is {self.value:.3g} < 0"
        )

    def conditions(self, target: Cone, M: Matrix, source: Cone, *, invariance: bool) -> list[Condition] | None:
        """The inequalities that it breaks, and those that make the plane a supporting one; None if it does not fit.

        Parameters
        ----------
        target, source : Cone
        M : Matrix, shape (target.dim, source.dim)
        invariance : bool
            Target is source, and the generator must lie on the plane.
        """
        rays = own_generators(source) if invariance or source is target else portable(source.exact_rays)
        normal = self.exact_normal()
        if not 0 <= self.ray < rays.shape[0] or normal.shape[1] != target.dim:
            return None
        generator = rays[np.array([self.ray])].dense()
        product = BilinearForms(normal, M, generator)
        same = np.array_equal(self.normal, normal.values[0].copy()) and np.array_equal(
            self.generator, generator.values[0].copy()
        )
        if not same or not abs(product.values[0, 0] - self.value) <= 1e-11 * product.magnitudes[0, 0]:
            return None
        out = [
            Condition(f"{self.condition}: z < 0", product, "<"),
            Condition(SUPPORTING, BilinearForms(normal, None, own_generators(target)), ">="),
        ]
        if invariance:
            out.append(Condition("h'x = 0", BilinearForms(normal, None, generator), "=="))
        return out

    def exact_normal(self) -> Matrix:
        """The normal as a 1 x n matrix."""
        return _row_of(self.normal_exact)


def plane_violation(condition: str, normal: NDArray[np.object_], ray: int, M: Matrix, source: Matrix) -> PlaneViolation:
    """The violation with an exact normal, of any length, and row `ray` of the generators `source`."""
    top = max(abs(Fraction(x)) for x in normal)
    power = Fraction(2) ** (top.numerator.bit_length() - top.denominator.bit_length())
    exact = tuple(Fraction(x) / power for x in normal)
    h, x = _row_of(exact), source[np.array([ray])].dense()
    value = float(BilinearForms(h, M, x).values[0, 0])
    return PlaneViolation(condition, -1, ray, h.values[0].copy(), x.values[0].copy(), value, exact)


def _row_of(numbers: tuple[Fraction, ...]) -> Matrix:
    row = np.empty((1, len(numbers)), dtype=object)
    row[0] = numbers
    return Matrix.from_fractions(row)


def parallel(a: Any, b: NDArray[np.float64]) -> bool:
    """Whether two vectors point the same way, up to rounding."""
    a = np.asarray(a, dtype=float)
    if a.shape != b.shape or not np.isfinite(a).all():
        return False
    top_a, top_b = np.abs(a).max(initial=0.0), np.abs(b).max(initial=0.0)
    return bool(top_a > 0 and top_b > 0 and np.abs(a / top_a - b / top_b).max() < 1e-12)
