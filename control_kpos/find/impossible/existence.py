"""Does a matrix leave any proper polyhedral cone invariant?  Read off the spectrum, exactly.

Continuous time: if and only if the spectral abscissa is an eigenvalue and every eigenvalue of that real
part is that number.  Discrete time: only if the spectral radius r is an eigenvalue and every
eigenvalue z of that modulus is r times a root of unity (Barker and Turner; Tam).  If there
is a cone, its explicit construction proves that.  If there is none, exact root counts of the characteristic
polynomial prove it, here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...cards import about, raised
from ...exact.condition import Condition
from ...exact.enclosure import Bounds
from ...exact.matrix import Matrix
from ...exact.polynomials import (
    Polynomial,
    characteristic_polynomial,
    circle_part,
    moebius,
    scale_roots,
    shift_roots,
    square_free_part,
    vanishes,
    without_roots_of_unity,
)
from ...exact.roots import Disc, on_imaginary_axis, real_roots_above, root_discs, roots_beyond
from ...proof.encoding import LATER, register_record
from ...proof.numerals import number_text
from ...proof.weights import ProofOmittedError

# Characteristic polynomials of larger matrices take too long in exact arithmetic.
LARGEST = 120
# Binary digits to which eigenvalues are told apart.
_DIGITS = 256
# States up to which a checker counts eigenvalues again; 3 s at 30.
COUNTABLE = 30
_NEWTON = 8


@dataclass(frozen=True, eq=False)
class SpectralObstruction:
    """An eigenvalue that no K-positive matrix can have.

    Attributes
    ----------
    matrix : int
        Which matrix of the family.
    kind : {"ahead", "beside"}
        "ahead": some eigenvalue lies beyond `bound` (to the right of it; discrete time: outside the
        circle of that radius), but no real one does.  "beside": no real eigenvalue lies beyond
        `bound`, and one that is not real lies exactly on the line (discrete time: on the circle, and
        is not `bound` times a root of unity).
    bound : Fraction
    real, imag : float
        The eigenvalue in the way, in floating point.
    discrete : bool
    """

    computed: ClassVar[tuple[str, ...]] = ("real", "imag", "discrete")

    matrix: int
    kind: str
    bound: Fraction
    real: float = LATER
    imag: float = LATER
    discrete: bool = LATER

    def restated(self, matrices: Matrix, *, discrete: bool) -> SpectralObstruction:
        """The obstruction with what files leave out."""
        value = in_the_way(np.linalg.eigvals(matrices[self.matrix].values).astype(complex), discrete)
        return replace(self, real=float(value.real), imag=float(value.imag), discrete=discrete)

    def conditions(self, matrices: Matrix, *, discrete: bool) -> Sequence[Condition] | None:
        """The exact root counts behind the obstruction."""
        if type(self.matrix) is not int or discrete != self.discrete or not 0 <= self.matrix < matrices.shape[0]:
            return None
        holds = excludes_cones(spectrum_polynomial(matrices[self.matrix]), self)
        return [fact(f"the eigenvalue {self.kind} of {about(self.bound)} is in the way", holds)]

    def evidence(self, matrices: Matrix, *, discrete: bool) -> dict[str, Any]:
        """A disc ahead of the bound that holds an eigenvalue; nothing where it is beside the bound."""
        require_countable(matrices)
        if self.kind != "ahead":
            return {}
        p = spectrum_polynomial(matrices[self.matrix])
        return {"z": disc_ahead(p, complex(self.real, self.imag), self.bound, discrete=self.discrete)}

    def __str__(self) -> str:
        where = "" if self.matrix == 0 else f"of matrix {self.matrix} "
        value, most = computed(self.real, self.imag), raised(self.bound)
        if self.discrete and self.kind == "ahead":
            return f"no eigenvalue {where}of the largest modulus {value} is a nonnegative number (none beyond {most})"
        if self.discrete:
            return (
                f"an eigenvalue {where}of modulus {about(self.bound)} {value} is no root of unity times its modulus, "
                "and no real one is larger"
            )
        if self.kind == "ahead":
            return f"the rightmost eigenvalues {where}{value} are not real, and no real one lies to the right of {most}"
        return (
            f"eigenvalues {where}of real part {about(self.bound)} {value} are not real, and no real one is larger; "
            "only a cone that is not polyhedral could be invariant"
        )


register_record(SpectralObstruction)


def computed(real: float, imag: float = 0.0) -> str:
    """An eigenvalue from floating point, for texts that prove something about it.

    >>> computed(-0.0, 1.0)
    '(computed: 0 ± 1i)'
    """
    real = real + 0.0  # no minus zero
    return f"(computed: {about(real, abs(imag), form='{} ± {}i') if imag else about(real)})"


def spectrum_polynomial(A: Matrix) -> Polynomial:
    """Integer polynomial whose roots are the eigenvalues of A."""
    return scale_roots(*characteristic_polynomial(A))


def spectral_obstruction(A: Matrix, *, matrix: int = 0, discrete: bool = False) -> SpectralObstruction | None:
    """A proven reason why no proper polyhedral cone is invariant under A, or None.

    None means that a cone exists, or that this test cannot tell.  Costs exact arithmetic on the
    characteristic polynomial: 0.5 s for 60 rows of doubles, 5 s for 120.
    """
    if A.shape[0] > LARGEST:
        return None
    values = np.linalg.eigvals(A.values).astype(complex)
    p = spectrum_polynomial(A)
    for kind, bound, value in _guesses(values, p, discrete):
        found = SpectralObstruction(matrix, kind, bound, float(value.real), float(value.imag), discrete)
        if excludes_cones(p, found):
            return found
    return None


def _guesses(values: NDArray[np.complex128], p: Polynomial, discrete: bool) -> Iterator[tuple[str, Fraction, complex]]:
    """Bounds at which the obstruction may be proven, the most likely first."""
    size, good, bad = (
        np.abs(values) if discrete else values.real,
        _is_good(values, discrete),
        in_the_way(values, discrete),
    )
    ahead = float(size[~good].max(initial=-np.inf))
    real = float(size[good].max(initial=0.0 if discrete else -np.inf))
    scale = float(np.abs(values).max(initial=0.0)) or 1.0
    if not np.isfinite(ahead):
        return
    low = max(real, ahead - scale) if np.isfinite(real) else ahead - scale
    if ahead > low:
        yield "ahead", Fraction((ahead + low) / 2), bad
    if np.isfinite(real) and abs(ahead - real) <= 1e-6 * scale:
        for digits in (1, 10, 1000, 10**6):
            simple = Fraction(real).limit_denominator(digits)
            if vanishes(p, simple):
                yield "beside", simple, bad
                break
        bound = _between(p, discrete)
        if bound is not None:
            yield "ahead", bound, bad


def _is_good(values: NDArray[np.complex128], discrete: bool) -> NDArray[np.bool_]:
    """Which eigenvalues a matrix that keeps a cone may have in front."""
    return (values.imag == 0) & ((values.real >= 0) | (not discrete))


def in_the_way(values: NDArray[np.complex128], discrete: bool) -> complex:
    """The foremost of the other eigenvalues; 0 if there are none."""
    bad = values[~_is_good(values, discrete)]
    return complex(bad[np.argmax(np.abs(bad) if discrete else bad.real)]) if bad.size else 0j


def _between(p: Polynomial, discrete: bool) -> Fraction | None:
    """A bound between the rightmost root and the real ones (discrete time: the moduli), if these are smaller."""

    def is_good(disc: Disc) -> bool:
        return disc.is_real and (disc.x >= 0 or not discrete)

    for discs in root_discs(square_free_part(p), _DIGITS):
        good = [disc.range(modulus=discrete) for disc in discs if is_good(disc)]
        bad = [disc.range(modulus=discrete) for disc in discs if not is_good(disc)]
        if not good or not bad or max(low for low, _ in good) > max(high for _, high in bad):
            return None
        low, high = max(high for _, high in good), max(low for low, _ in bad)
        if low < high:
            return (low + high) / 2
    return None


def excludes_cones(p: Polynomial, w: SpectralObstruction) -> bool:
    """True if the obstruction holds for this characteristic polynomial."""
    if (w.discrete and w.bound <= 0) or real_roots_above(p, w.bound):
        return False
    if w.kind == "ahead":
        return roots_beyond(p, w.bound, modulus=w.discrete) > 0
    if w.kind != "beside":
        return False
    if not w.discrete:
        return on_imaginary_axis(shift_roots(p, w.bound))
    rest, _ = without_roots_of_unity(circle_part(scale_roots(p, 1 / w.bound)))
    return len(rest) > 1 and on_imaginary_axis(moebius(rest, Fraction(1)))


def require_countable(matrices: Matrix) -> None:
    """Raise where counting eigenvalues takes a checker in plain Python more than a few seconds."""
    if matrices.shape[-1] > COUNTABLE:
        raise ProofOmittedError(f"eigenvalues are counted again up to {COUNTABLE} states")


def disc_ahead(p: Polynomial, near: complex, bound: Fraction, *, discrete: bool) -> list[str | int]:
    """Real part, imaginary part and radius of a disc that lies ahead of the bound and holds a root of p.

    The disc around z of radius n |p(z)| / |p'(z)| holds one (Laguerre).  Newton's method brings z closer to it.

    Raises
    ------
    ProofOmittedError
        No such disc was found.
    """
    re, im = Fraction(near.real), Fraction(near.imag)
    for step in range(1, _NEWTON):
        value, slope = _value_and_slope(p, re, im)
        size = slope[0] ** 2 + slope[1] ** 2
        if size == 0:
            break
        ratio = (value[0] ** 2 + value[1] ** 2) / size
        # one more than the degree, and what underflow may hide
        reach = (Fraction(math.sqrt(ratio)) + (ratio > 0) * Fraction(1, 10**150)) * len(p)
        if re**2 + im**2 > (bound + reach) ** 2 if discrete else re > bound + reach:
            return [number_text(x) for x in (re, im, reach)]
        unit = Fraction(2) ** (math.frexp(abs(near))[1] - 60 * step)
        re -= (value[0] * slope[0] + value[1] * slope[1]) / size
        im -= (value[1] * slope[0] - value[0] * slope[1]) / size
        re, im = (unit * round(x / unit) for x in (re, im))
    raise ProofOmittedError("the eigenvalue in the way is too close to the bound, or to others")


def _value_and_slope(p: Polynomial, re: Fraction, im: Fraction) -> tuple[tuple[Fraction, Fraction], ...]:
    """p(z) and p'(z) by Horner's rule, as pairs of real and imaginary parts."""
    value, slope = (Fraction(0), Fraction(0)), (Fraction(0), Fraction(0))
    for a in p:
        slope = re * slope[0] - im * slope[1] + value[0], re * slope[1] + im * slope[0] + value[1]
        value = re * value[0] - im * value[1] + a, re * value[1] + im * value[0]
    return value, slope


def fact(name: str, holds: bool) -> Condition:
    """A condition that was decided in exact arithmetic."""
    return Bounds.of(name, np.array([1.0 if holds else -1.0]), np.ones(1))
