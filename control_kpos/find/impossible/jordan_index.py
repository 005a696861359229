"""No cone in discrete time because some eigenvalue on the circle has longer Jordan chains than the spectral radius.

If A X is inside X, the spectral radius rho is an eigenvalue, and no eigenvalue z with |z| = rho has a larger index, the
size of its largest Jordan block (Vandergraft, 1968): (s I - A)^(-1) grows as (s - rho)^(-index) for s above rho, and
nowhere on the circle |s| faster.

Proof, in integers.  Let p be the characteristic polynomial, r the product of its different factors, and k the index of
rho.  V = range r(A)^k holds an eigenvector for z if and only if the index of z is larger than k.  For vectors x and u,
u'(s I - A)^(-1) r(A)^k x has poles only at such eigenvalues; let q be its denominator.  Then for a rational b >= 0

    p has one real root above b:                        it is rho, if there is a cone
    q(A) r(A)^k = 0, and q has no real root above b:    the index of rho is at most k
    A^N has one real eigenvalue above b^N:              it is rho^N
    u'(s I - A^N)^(-1) r(A)^k x has a pole above b^N:   it is z^N for a root z of q, so that |z| = rho.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from math import atan2, pi
from typing import Any, ClassVar

import numpy as np

from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.linalg import identity, product
from ...exact.matrix import Integers, Matrix
from ...exact.polynomials import Polynomial, at_matrix, characteristic_of, poles, square_free_part
from ...exact.roots import Disc, real_roots_above, root_discs
from ...proof.encoding import LATER, register_record
from .existence import SpectralObstruction, computed, fact, require_countable, spectral_obstruction, spectrum_polynomial

# States, orders of roots of unity, and lengths of Jordan chains of the spectral radius above which none is sought.
_LARGEST, _LARGEST_ORDER, _LONGEST = 24, 60, 8
# Digits to which the roots on the circle are told apart, and operations for each entry and digit of a power.
_DIGITS, _PER_DIGIT = 128, 2.0


@dataclass(frozen=True, eq=False)
class IndexObstruction:
    """An eigenvalue on the circle of the spectral radius with longer Jordan chains than the spectral radius itself.

    Attributes
    ----------
    matrix : int
        Which matrix of the family.
    bound : Fraction
        b; the spectral radius is the only real eigenvalue above it.
    index : int
        k; the Jordan chains of the spectral radius are not longer, those of the eigenvalue in the way are.
    order : int
        N, with z^N = rho^N.
    start, functional : Matrix, shape (1, n)
        x and u.
    radius, real, imag : float
        rho and z, in floating point.
    """

    computed: ClassVar[tuple[str, ...]] = ("radius", "real", "imag")

    matrix: int
    bound: Fraction
    index: int
    order: int
    start: Matrix
    functional: Matrix
    radius: float = LATER
    real: float = LATER
    imag: float = LATER

    def restated(self, matrices: Matrix, *, discrete: bool) -> IndexObstruction:
        """The obstruction with what files leave out: an eigenvalue z on the circle of which this order is one."""
        if not self._makes_sense(matrices, discrete):
            return self
        circle = _circles(square_free_part(spectrum_polynomial(matrices[self.matrix])))
        found = ((radius, z) for _, order, radius, z in circle if self.order % order == 0)
        radius, z = next(found, (np.nan, complex(np.nan)))
        return replace(self, radius=radius, real=z.real, imag=z.imag)

    def conditions(self, matrices: Matrix, *, discrete: bool) -> list[Condition] | None:
        """The exact root counts behind the obstruction."""
        if not self._makes_sense(matrices, discrete):
            return None
        return [fact("an eigenvalue on the circle has a larger index", _holds(matrices[self.matrix], self))]

    def _makes_sense(self, matrices: Matrix, discrete: bool) -> bool:
        n = matrices.shape[-1]
        sizes = self.start.shape == self.functional.shape == (1, n)
        numbers = 1 <= self.index <= n and 1 <= self.order <= _LARGEST_ORDER and self.bound >= 0
        return discrete and sizes and numbers and 0 <= self.matrix < matrices.shape[0]

    def evidence(self, matrices: Matrix, *, discrete: bool) -> dict[str, Any]:
        """Nothing: all is counted again."""
        require_countable(matrices)
        return {}

    def __str__(self) -> str:
        where = "" if self.matrix == 0 else f"of matrix {self.matrix} "
        return (
            f"an eigenvalue {where}{computed(self.real, self.imag)} has the modulus of the largest real one "
            f"{computed(self.radius)}, but longer Jordan chains: {self.index + 1} or more vectors, where those of the "
            f"largest real one have no more than {self.index}"
        )


register_record(IndexObstruction)


def matrix_obstruction(
    A: Matrix, *, matrix: int = 0, discrete: bool = False
) -> SpectralObstruction | IndexObstruction | None:
    """A proven reason why no proper polyhedral cone is invariant: the spectrum of A, or its Jordan chains; or None."""
    found = spectral_obstruction(A, matrix=matrix, discrete=discrete)
    return _by_index(A, matrix) if found is None and discrete else found


def _by_index(A: Matrix, matrix: int) -> IndexObstruction | None:
    n = A.shape[0]
    if n > _LARGEST:
        return None
    p = spectrum_polynomial(A)
    if len(square_free_part(p)) == len(p):  # then all Jordan chains have one vector
        return None
    rng = np.random.default_rng(0)
    x, u = (Matrix(rng.integers(1, 100, (1, n)).astype(float)) for _ in range(2))
    circle = list(_circles(square_free_part(p)))
    for index in range(1, min(n, _LONGEST) if circle else 0):
        suspects = [IndexObstruction(matrix, b, index, N, x, u, radius, z.real, z.imag) for b, N, radius, z in circle]
        longer = _longer(A, suspects[0])
        if longer is not None:  # the least index for which the spectral radius has no longer chains
            has_some = len(longer[2]) > 1
            return next((w for w in suspects if has_some and _is_on_circle(A, w, *longer[:2])), None)
    return None


def _circles(p: Polynomial) -> Iterator[tuple[Fraction, int, float, complex]]:
    """For each eigenvalue on the circle: a number just below the radius, the order, the radius, the eigenvalue."""
    discs = next(root_discs(p, _DIGITS), ())
    outer = max((_size(d) for d in discs), default=0.0)
    circle = [d for d in discs if _size(d) > outer * (1 - 1e-12)]
    rest = [_size(d) for d in discs if d not in circle]
    if not outer or not any(d.is_real and d.x > 0 for d in circle):
        return
    bound = Fraction((max(rest, default=0.0) + outer) / 2).limit_denominator(1000)
    bound = bound if max(rest, default=0.0) < bound < outer else Fraction((max(rest, default=0.0) + outer) / 2)
    turns = [Fraction(atan2(d.y, d.x) / (2 * pi)).limit_denominator(_LARGEST_ORDER).denominator for d in circle]
    for order, d in sorted(zip(turns, circle, strict=True), key=lambda pair: pair[0]):
        if order > 1:  # the least order that fits is that of the eigenvalue
            yield bound, order, outer, _middle(d)


def _middle(disc: Disc) -> complex:
    """The number in the middle; a real part that may be 0 is 0."""
    unit = Fraction(2) ** -disc.places
    return complex(float(disc.x * unit) if abs(disc.x) > disc.radius else 0.0, float(disc.y * unit))


def _size(disc: Disc) -> float:
    low, high = disc.range(modulus=True)
    return float((low + high) / 2)


def _holds(A: Matrix, w: IndexObstruction) -> bool:
    """The claim in exact arithmetic."""
    longer = _longer(A, w)
    return longer is not None and _is_on_circle(A, w, *longer[:2])


def _longer(A: Matrix, w: IndexObstruction) -> tuple[Integers, Integers, Polynomial] | None:
    """r(A)^k x, u and q in integers; None if b has not one real eigenvalue above it, or that may be a root of q."""
    M, unit = A.as_integers()
    p, level = characteristic_of(M), w.bound / Fraction(unit)
    if real_roots_above(p, level) != 1:
        return None
    inner, factor = identity(len(M)), at_matrix(square_free_part(p), M)
    for _ in range(w.index):
        inner = product(inner, factor)
    x, u = inner @ w.start.as_integers()[0][0], w.functional.as_integers()[0][0]
    q = poles(p, M, x, u)
    return None if product(at_matrix(q, M), inner).any() or real_roots_above(q, level) else (x, u, q)


def _is_on_circle(A: Matrix, w: IndexObstruction, x: Integers, u: Integers) -> bool:
    """Whether A^N has one real eigenvalue above b^N, and that is a pole."""
    M, unit = A.as_integers()
    level = (w.bound / Fraction(unit)) ** w.order
    spend(_PER_DIGIT * M.size * w.order * max(abs(int(a)).bit_length() for a in M.ravel()))
    turned = np.linalg.matrix_power(M, w.order)
    around = characteristic_of(turned)
    return real_roots_above(around, level) == 1 == real_roots_above(poles(around, turned, x, u), level)
