"""Why no invariant cone fits between given vectors b and half-spaces c'x >= 0.

A cone X that is invariant, holds b and lies in c'x >= 0 makes every one of these numbers nonnegative:

    c'(s I - A)^(-k) b   for real s beyond the largest real eigenvalue, k = 1, 2, ..   (continuous time)
    c'A^k b              for k = 0, 1, 2, ..                                           (discrete time)

because (s I - A)^(-1), an integral of e^((A - sI)t), maps X into X.  One negative number is a proof.
For k = 1 that is the transfer function: a simple real zero beyond the dominant eigenvalue changes its
sign.  As k grows with s = k / t, it approaches the impulse response at time t.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from ...cards import about
from ...exact.budget import spend
from ...exact.condition import Condition
from ...exact.linalg import solve_exactly
from ...exact.matrix import Matrix
from ...exact.products import as_doubles
from ...exact.roots import real_roots_above
from ...proof.encoding import LATER, register_record
from .existence import fact, require_countable, spectrum_polynomial

LARGEST = 40
_MOST = 400
# Powers in discrete time whose sign is found exactly, and how low they are in floating point, relative to the sizes.
_LOOKED_AT, _NEARLY = 5, 1e-12
# Operations of one product of long integers.
_PER_PRODUCT = 200.0


@dataclass(frozen=True, eq=False)
class Between:
    """An obstruction between a vector and a half-space.

    Attributes
    ----------
    normal : Matrix, shape (1, n)
        c, a half-space that the cone was to lie in.
    vector : Matrix, shape (1, n)
        b, a vector that the cone was to hold.
    """

    normal: Matrix
    vector: Matrix

    def __post_init__(self) -> None:
        for name in ("normal", "vector"):
            object.__setattr__(self, name, getattr(self, name).dense())

    def restated(self, matrices: Matrix, *, discrete: bool) -> Between:
        """The obstruction with what files leave out."""
        return self

    def fits(self, n: int) -> bool:
        """Whether the sizes are those of the matrix."""
        return self.normal.shape == self.vector.shape == (1, n)

    def conditions(self, matrices: Matrix, *, discrete: bool) -> Sequence[Condition] | None:
        """The signs that prove it; those of each kind are its own."""
        raise NotImplementedError

    def evidence(self, matrices: Matrix, *, discrete: bool) -> dict[str, Any]:
        """Nothing: what the witness holds is all that is needed."""
        require_countable(matrices)
        return {}

    def concerns(self, contains: Matrix | None, within: Matrix | None) -> bool:
        """True if the cone was to hold the vector and to lie in the half-space."""
        wanted = ((contains, self.vector), (within, self.normal))
        return all(
            rows is not None
            and rows.shape[1:] == row.shape[1:]
            and (rows.fractions() == row.fractions()).all(axis=1).any()
            for rows, row in wanted
        )


@dataclass(frozen=True, eq=False)
class PortObstruction(Between):
    """A product of a half-space, the dynamics and a vector that is negative where it must not be.

    Attributes
    ----------
    power : int
        k.
    shift : Fraction or None
        s; None in discrete time.
    value : float
        The product, correctly rounded (its sign is proven).
    time : float
        About when the impulse response c'e^(At) b (c'A^k b) is negative; inf if s is real and k = 1, NaN if unknown.
    zero : float or None
        A real transmission zero beyond the dominant eigenvalue, if there is one.
    """

    computed: ClassVar[tuple[str, ...]] = ("value", "time", "zero")

    power: int
    shift: Fraction | None
    value: float = LATER
    time: float = LATER
    zero: float | None = None

    def restated(self, matrices: Matrix, *, discrete: bool) -> PortObstruction:
        """The obstruction with what files leave out: its value, and a time or a zero in floating point."""
        if not self._makes_sense(matrices, discrete):
            return self
        M, b, c = (np.asarray(part.values) for part in (matrices[0], self.vector[0], self.normal[0]))
        value, k, s = _rounded_value(matrices[0], self), self.power, self.shift
        if s is None:
            return replace(self, value=value, time=float(k))
        if k != 1:
            return replace(self, value=value, time=_negative_near(M, b, c, k, float(s)))
        zero = min(_zeros_ahead(M, b, c), key=lambda z: abs(z - s), default=None)
        return replace(self, value=value, time=np.inf, zero=zero)

    def conditions(self, matrices: Matrix, *, discrete: bool) -> Sequence[Condition] | None:
        """The exact sign of the product."""
        if not self._makes_sense(matrices, discrete):
            return None
        return [fact("c'(s I - A)^-k b < 0, and as stated", _is_proven(matrices[0], self))]

    def _makes_sense(self, matrices: Matrix, discrete: bool) -> bool:
        continuous = self.shift is not None
        return self.fits(matrices.shape[-1]) and discrete != continuous and continuous <= self.power <= 10 * _MOST

    def __str__(self) -> str:
        value = f"{'about ' if self.value else ''}{self.value:.3g}"
        if self.shift is None:
            return f"the impulse response c'A^k b is {value} < 0 at k = {self.power}"
        if self.power == 1:
            zero = "" if self.zero is None else f" (computed: the real transmission zero {self.zero:.6g} is to blame)"
            return (
                f"the transfer function c'(sI - A)^-1 b is {value} <= 0 at s = {about(self.shift)}, beyond every real "
                f"eigenvalue, where that of a cone-positive system is positive{zero}"
            )
        when = "" if np.isnan(self.time) else f" (computed: near t = {self.time:.3g})"
        return (
            f"the impulse response c'e^(At) b is negative at some time{when}, as "
            f"c'(sI - A)^-{self.power} b is {value} < 0 at s = {about(self.shift)}, beyond every real eigenvalue"
        )


register_record(PortObstruction)


def port_obstruction(A: Matrix, vectors: Matrix, normals: Matrix, *, discrete: bool = False) -> PortObstruction | None:
    """A proven reason why no invariant cone holds the vectors and lies in the half-spaces, or None."""
    if A.shape[0] > LARGEST:
        return None
    for j in range(vectors.shape[0]):
        for i in range(normals.shape[0]):
            spend(_PER_PRODUCT * A.values.size)
            b, c = vectors[[j]], normals[[i]]
            for k, s in _suspects(A, np.asarray(b.values)[0], np.asarray(c.values)[0], discrete):
                found = PortObstruction(c, b, k, s).restated(Matrix.stack([A]), discrete=discrete)
                if _is_proven(A, found):
                    return found
    return None


def transmission_zeros(
    A: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Finite zeros of c'(sI - A)^-1 b, from a generalised eigenvalue problem."""
    n = len(A)
    left = np.block([[A, b[:, None]], [c[None], np.zeros((1, 1))]])
    right = np.zeros((n + 1, n + 1))
    right[:n, :n] = np.eye(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = sl.eigvals(left, right)
    return values[np.isfinite(values) & (np.abs(values) < 1e8 * (1 + np.abs(A).max()))]


def _spectrum(M: NDArray[np.float64]) -> tuple[NDArray[np.complex128], float, float]:
    """The eigenvalues, their size, and the largest real one or, without such, the largest real part."""
    values: NDArray[np.complex128] = np.linalg.eigvals(M).astype(np.complex128)
    scale = float(np.abs(values).max(initial=0.0)) or 1.0
    reals = values[np.abs(values.imag) < 1e-9 * scale].real
    return values, scale, float((reals if reals.size else values.real).max())


def _zeros_ahead(M: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> list[float]:
    """Real transmission zeros that are not behind the eigenvalues."""
    _, scale, edge = _spectrum(M)
    zeros = transmission_zeros(M, b, c)
    return [float(z.real) for z in zeros if abs(z.imag) < 1e-7 * scale and z.real > edge - 1e-12 * scale]


def _negative_near(M: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], k: int, s: float) -> float:
    """A time with c'e^(Mt) b < 0 near k / s, or k / (s - edge) where the response grows; NaN if it is not negative."""
    _, _, edge = _spectrum(M)
    with np.errstate(all="ignore"):
        times = [k / rate for rate in (s, s - max(edge, 0.0)) if rate > 0]
        return next((t for t in times if float(c @ sl.expm((M - edge * np.eye(len(M))) * t) @ b) < 0), np.nan)


def _suspects(
    A: Matrix, b: NDArray[np.float64], c: NDArray[np.float64], discrete: bool
) -> Iterator[tuple[int, Fraction | None]]:
    """Powers and shifts for which the product may be negative."""
    M = np.asarray(A.values)
    if discrete:
        x, heights = b.copy(), []
        for _ in range(10 * _MOST):
            size = float(np.linalg.norm(x)) or 1.0
            heights.append(float(c @ x) / size)
            x = M @ (x / size)
        for k in np.argsort(heights)[:_LOOKED_AT].tolist():
            if heights[k] < _NEARLY * np.linalg.norm(c):
                yield k, None
        return
    values, scale, edge = _spectrum(M)
    top, eye, zeros = float(values.real.max()), np.eye(len(M)), _zeros_ahead(M, b, c)
    spread = scale * np.array([1e-6, 1e-4, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0])
    grid = {edge + d for d in spread} | {
        z + f * (z - edge) for z in zeros for f in (-0.5, -0.1, -1e-3, 0.0, 1e-3, 0.1, 1.0)
    }
    grid |= {float(Fraction(z).limit_denominator(1000)) for z in zeros}
    for s in sorted(grid, key=lambda s: abs(s - edge - 0.3 * scale)):
        if s > edge:
            value = float(c @ np.linalg.solve(s * eye - M, b))
            if value <= 1e-9 * np.linalg.norm(c) * np.linalg.norm(b):
                yield 1, Fraction(s)
    found = []
    for t in np.geomspace(
        0.01 / scale,
        60 / max(1e-6 * scale, float(np.abs(top - values.real)[np.abs(top - values.real) > 0].min(initial=scale))),
        80,
    ):
        with np.errstate(over="ignore", invalid="ignore"):
            response = float(c @ sl.expm((M - top * eye) * min(t, 1e6)) @ b)
        if np.isfinite(response):
            found.append((response, float(t)))
    for response, t in sorted(found)[:2]:
        for k in (2, 4, 8, 16, 32):
            s = k / t + max(edge, 0.0) if k / t <= edge else k / t
            if response < 0 and s > edge:
                x = b.copy()
                solver = np.linalg.inv(s * eye - M) * (s - edge)
                for _ in range(k):
                    x = solver @ x
                if float(c @ x) < -1e-9 * np.linalg.norm(c) * np.linalg.norm(x):
                    yield k, Fraction(s).limit_denominator(10**6)
                    break


def _exact_value(A: Matrix, w: PortObstruction) -> tuple[int, Fraction] | None:
    """The product that is claimed to be negative, as an integer and a positive factor; None if s is too small."""
    (b, b_unit), (c, c_unit) = w.vector.as_integers(), w.normal.as_integers()
    if w.shift is None:
        moved: tuple[NDArray[np.object_], int | Fraction] | None = A.as_integers()
    elif w.power < 1 or real_roots_above(spectrum_polynomial(A), w.shift):
        return None
    else:
        moved = resolvent(A, w.shift)
    if moved is None:
        return None
    (M, unit), x = moved, b[0]
    for _ in range(w.power):
        spend(_PER_PRODUCT * M.size)
        x = M @ x
    return int(c[0] @ x), Fraction(unit) ** w.power * b_unit * c_unit


def _is_proven(A: Matrix, w: PortObstruction) -> bool:
    """The claim in exact arithmetic: negative, or zero for a transfer function that is not zero; and its value."""
    found = _exact_value(A, w)
    if found is None or _rounded(*found) != w.value:
        return False
    if found[0] or w.shift is None or w.power != 1:
        return found[0] < 0
    return _is_not_identically_zero(A, w.vector.as_integers()[0][0], w.normal.as_integers()[0][0])


def _rounded_value(A: Matrix, w: PortObstruction) -> float:
    found = _exact_value(A, w)
    return np.nan if found is None else _rounded(*found)


def _rounded(product: int, unit: Fraction) -> float:
    return float(as_doubles(np.array([product], dtype=object), unit)[0])


def _is_not_identically_zero(A: Matrix, b: NDArray[np.object_], c: NDArray[np.object_]) -> bool:
    M, x = A.as_integers()[0], b
    for _ in range(len(b)):
        if c @ x != 0:
            return True
        x = M @ x
    return False


def resolvent(A: Matrix, s: Fraction) -> tuple[NDArray[np.object_], Fraction] | None:
    """(s I - A)^-1 as integers and a positive factor; None if s is an eigenvalue."""
    M, factor = A.as_integers()
    ratio = s / Fraction(factor)
    eye = np.eye(len(M), dtype=int).astype(object)
    solved = solve_exactly(eye * ratio.numerator - M * ratio.denominator, eye)
    return None if solved is None else (solved[0], ratio.denominator / (Fraction(factor) * solved[1]))
