"""Cheap proofs that a family has no common cone.

An invariant cone holds the dominant direction e_s of every A_s (with the right sign), and its dual the
dominant functional l_s; hence (l_i'e_j)(l_j'e_k)..(l_p'e_i) >= 0 around every cycle.  If a cycle is negative,
the product of resolvents (s_i I - A_i)^-1 along it (discrete time: of powers of A_i), which maps any such
cone into itself, has a negative dominant eigenvalue; that no nonnegative one is dominant is proven exactly.

Where there are no such directions, or none that contradict each other, short products are tried: of the matrices in
discrete time, else of resolvents a little and far to the right of all eigenvalues.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, groupby
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...cards import about
from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.roots import real_roots_above
from ...proof.encoding import LATER, register_record
from ...proof.weights import ProofOmittedError
from ..one_matrix.modes import PER_CUBE, Modes, modes
from .existence import (
    SpectralObstruction,
    disc_ahead,
    excludes_cones,
    fact,
    spectrum_polynomial,
)
from .jordan_index import IndexObstruction, matrix_obstruction
from .port_obstruction import resolvent

_LARGEST = 16
_POWER = 24
# Relative gap up to which eigenvalues may lie beside the dominant one.
_BESIDE = 1e-6
# Letters of the longest products, entries of all products of one length, parts of the size of a matrix by which shifts
# lie to the right of its eigenvalues, and products that are looked at closely.
_LONGEST, _MOST, _SHIFTS, _SUSPECTS = 6, 2 * 10**5, (0.03, 0.3, 3.0), 4
# Products of directions and functionals of length 1 that are clearly negative.
_CLEARLY = 1e-9
# Relative size up to which an imaginary part may be rounding of a repeated eigenvalue.
_NEARLY_REAL = 1e-3
# Operations on one long integer.
_PER_NUMBER = 1e3


@dataclass(frozen=True, eq=False)
class PerronObstruction:
    """Dominant directions and functionals of a family that contradict each other.

    Attributes
    ----------
    cycle : tuple of int
        Matrices i, j, .. with (l_i'e_j)(l_j'e_k).. < 0.
    shifts : tuple of Fraction
        s_i of the resolvents; discrete time: the powers.
    bound : Fraction
        The product of the resolvents has an eigenvalue of modulus above `bound`, but no real one.
    value : float
        The product around the cycle, in floating point; not negative, or not a number, where no dominant directions
        contradict each other, and the product of resolvents or powers was tried for itself.
    """

    computed: ClassVar[tuple[str, ...]] = ("value",)

    cycle: tuple[int, ...]
    shifts: tuple[Fraction, ...]
    bound: Fraction
    value: float = LATER

    def restated(self, matrices: Matrix, *, discrete: bool) -> PerronObstruction:
        """The obstruction with what files leave out."""
        found = [modes(np.asarray(matrices[i].values), discrete=discrete) for i in self.cycle]
        known = [m for m in found if m is not None]
        cross, n = _cross(known), len(known)
        around = [cross[k, (k + 1) % n] for k in range(n)]
        return replace(self, value=float(np.prod(around)) if n == len(found) else np.nan)

    def conditions(self, matrices: Matrix, *, discrete: bool) -> Sequence[Condition] | None:
        """The exact root count of the product."""
        if len(self.cycle) != len(self.shifts) or not all(0 <= i < matrices.shape[0] for i in self.cycle):
            return None
        product = _product(matrices, self.cycle, self.shifts, discrete)
        if product is None:
            return None
        spectral = SpectralObstruction(0, "ahead", self.bound, discrete=True)
        return [
            fact(
                "a product of resolvents or powers has no nonnegative dominant eigenvalue",
                excludes_cones(spectrum_polynomial(product), spectral),
            )
        ]

    def evidence(self, matrices: Matrix, *, discrete: bool) -> dict[str, Any]:
        """A disc outside the circle of radius `bound` that holds an eigenvalue of the product."""
        product = _product(matrices, self.cycle, self.shifts, discrete)
        if product is None:
            raise ProofOmittedError("the product does not keep cones")
        values = np.linalg.eigvals(product.values).astype(complex)
        largest = complex(values[np.argmax(np.abs(values))])
        return {"z": disc_ahead(spectrum_polynomial(product), largest, self.bound, discrete=True)}

    def __str__(self) -> str:
        names = ", ".join(map(str, self.cycle))
        why = (
            ": their dominant directions e and functionals l contradict each other (computed: the product of l_i'e_j "
            f"around this cycle is {about(self.value, digits=3)})"
        )
        return (
            f"a product of resolvents or powers of the matrices {names} would keep such a cone, but no eigenvalue of "
            f"its largest modulus is a nonnegative number{why if self.value < -_CLEARLY else ''}"
        )


register_record(PerronObstruction)


def family_obstruction(
    matrices: Matrix, each: list[Modes | None], *, discrete: bool
) -> SpectralObstruction | IndexObstruction | PerronObstruction | None:
    """A proven reason why the family has no common cone, or None."""
    for s, m in enumerate(each):
        if m is None or _gap(m, discrete) <= _BESIDE * float(np.abs([m.dominant, *m.others]).max()):
            found = matrix_obstruction(matrices[s], matrix=s, discrete=discrete)
            if found is not None:
                return found
    if matrices.shape[-1] > _LARGEST:
        return None
    known = [m for m in each if m is not None]
    found = _cycle_obstruction(matrices, known, discrete) if len(known) == len(each) else None
    return found or _product_obstruction(matrices, discrete)


def _cycle_obstruction(matrices: Matrix, known: list[Modes], discrete: bool) -> PerronObstruction | None:
    """Dominant directions that contradict each other."""
    cross = _cross(known)
    pairs = np.where(np.tri(len(known), dtype=bool), np.inf, cross * cross.T)
    cycles: list[tuple[float, tuple[int, ...]]] = [
        (float(pairs.flat[k]), divmod(k, len(known))) for k in np.argsort(pairs, axis=None)[:4].tolist()
    ]
    if len(known) <= 24:
        for i, j, k in combinations(range(len(known)), 3):
            cycles += [(cross[a, b] * cross[b, c] * cross[c, a], (a, b, c)) for a, b, c in ((i, j, k), (i, k, j))]
    for value, cycle in sorted(cycles)[:4]:
        if value < -_CLEARLY:
            found = _prove(matrices, known, cycle, float(value), discrete)
            if found is not None:
                return found
    return None


def _product_obstruction(matrices: Matrix, discrete: bool) -> PerronObstruction | None:
    """A short product without a nonnegative dominant eigenvalue."""
    letters, maps = _letters(matrices, discrete)
    words = _words(len(letters), matrices.shape[-1])
    spend(PER_CUBE * sum(len(w) for w in words) * matrices.shape[-1] ** 3)
    suspects: list[tuple[float, tuple[int, ...]]] = []
    for word in words:
        turned = maps[word[:, 0]]
        for k in range(1, word.shape[1]):
            turned = turned @ maps[word[:, k]]
        values = np.linalg.eigvals(turned)
        top = np.abs(values).max(axis=1)
        # rounding may turn a repeated real eigenvalue into pairs
        real = (np.abs(values.imag) <= _NEARLY_REAL * top[:, None]) & (values.real >= 0)
        most = np.where(real, values.real, 0.0).max(axis=1)
        some = np.flatnonzero(most < (1 - _NEARLY_REAL) * top)[:_SUSPECTS].tolist()
        suspects += [(float(most[k] / top[k]), tuple(word[k].tolist())) for k in some]
        if suspects:
            break
    for _, letter in sorted(suspects)[:_SUSPECTS]:
        found = _of_word(matrices, [letters[k] for k in letter], discrete)
        if found is not None:
            return found
    return None


def _letters(matrices: Matrix, discrete: bool) -> tuple[list[tuple[int, Fraction]], NDArray[np.float64]]:
    """Maps that keep every cone that the family keeps, of size one, and their numbers and shifts."""
    values = np.asarray(matrices.values, dtype=float)
    size = np.abs(values).max(axis=(1, 2))
    size = np.where(size > np.finfo(float).tiny, size, 1.0)
    values = values / size[:, None, None]
    if discrete:
        return [(i, Fraction(1)) for i in range(len(values))], values
    letters, maps = [], []
    for i, A in enumerate(values):
        top = float(np.linalg.eigvals(A).real.max())
        for part in _SHIFTS:
            shift = Fraction(top + part).limit_denominator(1000)
            letters.append((i, shift * Fraction(float(size[i]))))
            maps.append(np.linalg.inv(float(shift) * np.eye(len(A)) - A))
    stack = np.array(maps)
    return letters, stack / np.abs(stack).max(axis=(1, 2), keepdims=True)


def _words(count: int, n: int) -> list[NDArray[np.intp]]:
    """Words of so many letters, short ones first, one of each cycle: its first letter is the least."""
    out: list[NDArray[np.intp]] = []
    for length in range(2, _LONGEST + 1):
        if count**length * n**2 > _MOST:
            break
        word = np.indices((count,) * length).reshape(length, -1).T
        out.append(word[(word >= word[:, :1]).all(axis=1) & (word != word[:, :1]).any(axis=1)])
    return out


def _of_word(matrices: Matrix, word: list[tuple[int, Fraction]], discrete: bool) -> PerronObstruction | None:
    """The obstruction by the product of these letters; equal neighbours are powers in discrete time."""
    runs = [(i, s, len(list(same))) for (i, s), same in groupby(word)]
    cycle = tuple(i for i, _, k in runs for _ in range(1 if discrete else k))
    shifts = tuple(x for _, s, k in runs for x in ([Fraction(k)] if discrete else [s] * k))
    product = _product(matrices, cycle, shifts, discrete)
    if product is None:
        return None
    values = np.linalg.eigvals(product.values)
    top = float(np.abs(values).max())
    real = values.real[(np.abs(values.imag) <= _NEARLY_REAL * top) & (values.real >= 0)]
    bound = Fraction((top + float(real.max(initial=0.0))) / 2).limit_denominator(10**6)
    found = PerronObstruction(cycle, shifts, bound)
    found = found.restated(matrices, discrete=discrete)
    conditions = found.conditions(matrices, discrete=discrete)
    return found if conditions is not None and all(c.verdict() for c in conditions) else None


def _cross(known: list[Modes]) -> NDArray[np.float64]:
    """l_i'e_j of dominant functionals and directions of length 1."""
    left = np.array([m.left / np.linalg.norm(m.left) for m in known])
    return left @ np.array([m.right for m in known]).T


def _prove(
    matrices: Matrix, known: list[Modes], cycle: tuple[int, ...], value: float, discrete: bool
) -> PerronObstruction | None:
    for closeness in (1e-2, 1e-3, 1e-5):
        shifts = []
        for i in cycle:
            m = known[i]
            gap = _gap(m, discrete)
            if discrete:
                fading = max(1 - gap / m.dominant, 1e-3)
                power = _POWER if fading >= 1 else min(_POWER, int(np.ceil(np.log(closeness) / np.log(fading))))
                shifts.append(Fraction(max(power, 1)))
            else:
                shifts.append(Fraction(m.dominant + closeness * gap))
        product = _product(matrices, cycle, tuple(shifts), discrete)
        if product is None:
            continue
        size = np.sort(np.abs(np.linalg.eigvals(product.values)))
        if not np.isfinite(size).all():
            continue
        bound = Fraction(float(size[-1] + (size[-2] if len(size) > 1 else 0.0)) / 2)
        found = PerronObstruction(cycle, tuple(shifts), bound, value)
        conditions = found.conditions(matrices, discrete=discrete)
        if conditions is not None and all(c.verdict() for c in conditions):
            return found
    return None


def _gap(m: Modes, discrete: bool) -> float:
    """Distance from the dominant eigenvalue to the real part (discrete time: modulus) of the next one."""
    return float((m.dominant - (np.abs(m.others) if discrete else m.others.real)).min(initial=1.0))


def _product(matrices: Matrix, cycle: tuple[int, ...], shifts: tuple[Fraction, ...], discrete: bool) -> Matrix | None:
    """The product of resolvents (or powers) up to a positive factor; None where one is not invariant."""
    out = None
    for i, s in zip(cycle, shifts, strict=True):
        A = matrices[i]
        spend(_PER_NUMBER * A.values.size * A.shape[0])
        if discrete:
            if s.denominator != 1 or not 1 <= s <= _POWER:
                return None
            factor = A.as_integers()[0]
            M = factor
            for _ in range(int(s) - 1):
                M = M @ factor
        else:
            if real_roots_above(spectrum_polynomial(A), s):
                return None
            solved = resolvent(A, s)
            if solved is None:
                return None
            M = solved[0]
        out = M if out is None else out @ M
    if out is None:
        return None
    # Doubles for the user's eyes; the proof runs on the integers.
    size = max(abs(int(x)) for x in out.ravel()) or 1
    return Matrix.from_fractions(np.array([[Fraction(int(x), size) for x in row] for row in out], dtype=object))


__all__ = ["PerronObstruction", "family_obstruction"]
