r"""Bordered refinement: the sign of a nearly singular Perron root, and its vector to any precision.

Let N be an irreducible Metzler matrix of integers, F = D^{-1} N with D = -diag N (or any positive diagonal matrix), and
1 the vector of ones.  The bordered equations

    [ F   1 ] [x]   [0]
    [ 1'  0 ] [t] = [n]

are well conditioned even where F is singular, because its Perron root is simple.  F x = -t 1 then says on which
side of zero the root lies: t < 0 and x >= 0 give N x >= 0, so that the root is not negative; t > 0 for N' in place of
N gives v > 0 with v'N < 0, so that it is.  Near zero x is nearly the Perron vector, and positive.

x and t are integers over a power of two.  The residual is formed without rounding, the correction comes from floating
point, and about 40 bits are added in each step (Wan, Journal of Symbolic Computation 41, 2006).  The bordered matrix
is never factored, as dense borders fill in: S = F - e_k e_k' is, without pivoting, since it is minus an M-matrix; the
Sherman-Morrison-Woodbury formula adds the rest.  Nothing here is trusted: signs are checked in integers, and what a
certificate holds is proven by its own conditions.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..exact.budget import spend
from ..exact.matrix import Index, Integers
from ..exact.sparse_integers import Floats, SparseIntegers, mantissas
from .krylov import bicgstab, norm

# Bits that a step adds, of the 53 of a double; the rest is lost to the condition of the bordered matrix.
_BITS = 40
# Steps of the conjugate gradients that balance a matrix.
_BALANCING_STEPS = 1000
# t is this many bits longer than the residual before its sign counts.
_CLEAR = 4
# Operations after which a margin that stays undecided is given up: a minute.
_MOST = 6e10
# The exponent of a residual of zero.
_NOTHING = -(2**20)
# Steps without progress after which the bordered matrix counts as singular.
_STALLS = 3
# Larger parts are given to a Krylov method first: on expanders, factors fill in and Krylov methods converge at once.
_FACTORED_FIRST, _NARROW = 1000, 40
_KRYLOV_TRIAL, _KRYLOV_STEPS = (16, 2.0**-5), 250
_KRYLOV_ERROR, _KRYLOV_BEST = 2.0**-26, 2.0**-50
# What is left open of a product with a Perron vector in floating point.
_KNOWN = 2.0**-20
# Matrices this dense, or smaller than the second number, are factored as dense ones.
_DENSE, _SMALL = 0.1, 48


class Step(NamedTuple):
    """x = X 2^-P in the units of the frame, t = T 2^-P, and the residual, `rest` 2^(error - P), below 2^(error - P)."""

    X: Integers
    T: int
    P: int
    error: int
    rest: Floats

    @property
    def is_exact(self) -> bool:
        """True if nothing is left of the residual."""
        return self.error == _NOTHING

    @property
    def sign(self) -> int:
        """Of t, and of -N x everywhere; 0 while the residual leaves it open."""
        return int(np.sign(self.T)) if self.T.bit_length() > self.error + _CLEAR else 0

    def leaning(self, y: Floats) -> int:
        """The sign that t will have, judged by y with y'F nearly 0; 0 if the errors of y may hide it.

        y'(F x + t 1) = t y'1, so that t misses y'rest / y'1, up to the errors of x and y multiplied.
        """
        own = y * self.rest[:-1]
        t = np.ldexp(float(self.T), -self.error) * y.sum() + own.sum()
        return int(np.sign(t)) if abs(t) > _KNOWN * np.abs(own).sum() else 0


class Frame:
    """N in powers of two as units of its unknowns, and F in floating point.

    Parameters
    ----------
    N : SparseIntegers, shape (n, n)
        Irreducible Metzler matrix.
    units : ndarray of int, shape (n,)
        Exponents; x_j in the frame means x_j 2**units_j outside.
    """

    def __init__(self, N: SparseIntegers, units: NDArray[np.int64]) -> None:
        self.units = units
        self.N, self.size = N.in_units(units, N.sizes)
        self._given = N
        self._size = mantissas(self.size)

    @cached_property
    def _own(self) -> tuple[Floats, NDArray[np.int64]]:
        return mantissas(self._given.sizes)

    @cached_property
    def F(self) -> sp.csr_array:
        """D^{-1} N in floating point."""
        mantissa, exponent = self.N.mantissas
        rows = self.N.rows
        with np.errstate(all="ignore"):
            values = np.ldexp(mantissa / self._size[0][rows], np.maximum(exponent - self._size[1][rows], -1100))
        return sp.csr_array((values, self.N.indices, self.N.indptr), shape=(len(self.units), len(self.units)))

    def relative(self, E: Integers) -> Floats:
        """E / D for a diagonal matrix E that stands beside N."""
        mantissa, exponent = mantissas(E)
        return np.ldexp(mantissa / self._own[0], exponent - self._own[1])

    def residual(self, X: Integers, T: int) -> tuple[Floats, NDArray[np.int64]]:
        """-(F x + t 1) as doubles times powers of two, formed without rounding first."""
        mantissa, exponent = mantissas(-(self.N.apply(X) + self.size * T))
        return mantissa / self._size[0], exponent - self._size[1]

    def left(self, y: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """v with v'N = 0, as doubles times powers of two, for y with y'F = 0."""
        size, power = self._own  # F_ij = N_ij 2^u_j / (|N_ii| 2^u_i)
        mantissa, exponent = np.frexp(y / size)
        return mantissa, exponent - power - self.units

    def between(self, other: Frame) -> Floats:
        """The diagonal G with F_other = G^{-1} F' G, for a frame of N'."""
        size, power = self._own
        return np.ldexp(size, power + self.units + other.units - int(np.median(power + self.units + other.units)))

    def holds(self, X: Integers, sign: int) -> bool:
        """N x >= 0 for x >= 0, x != 0 (sign -1), or N x < 0 for x > 0 (sign 1), in integers."""
        if sign > 0:
            return bool((X > 0).all() and (self.N.apply(X) < 0).all())
        return bool((X >= 0).all() and X.any() and (self.N.apply(X) >= 0).all())


class Borders:
    """Solves with K = [[F, 1], [1', 0]] in floating point.

    Parameters
    ----------
    F : csr_array, shape (n, n)
    k : int
        Where S = F - e_k e_k' differs from F; best where the product of both Perron vectors is large.
    """

    def __init__(self, F: sp.csr_array, k: int = 0) -> None:
        self.F, self.k, self.n = F, k, F.shape[0]

    @cached_property
    def _factors(self) -> Factors:
        correction = sp.csr_array((np.ones(1), ([self.k], [self.k])), shape=self.F.shape)
        return Factors(sp.csc_array(self.F - correction))

    def mirrored(self, F: sp.csr_array, G: Floats, y: Floats | None = None) -> Borders:
        """The same for F = G^{-1} F_here' G with a diagonal G, from the same factors, or near the margin from the y of
        `directions`.
        """
        out = Borders(F, self.k)
        own: dict[str, Any] = {} if self._is_krylov else {"_factors": _Mirrored(self._factors, G)}
        if y is not None and self._is_krylov and abs(self.nearly[-1]) < _KRYLOV_ERROR:
            own["nearly"] = np.append(y / G * (self.n / (y / G).sum()), 0.0)
        vars(out).update(_is_krylov=self._is_krylov, **own)
        return out

    @cached_property
    def _on_borders(self) -> tuple[Floats, Floats]:
        one, unit = np.ones(self.n), np.zeros(self.n)
        unit[self.k] = 1.0
        return self._factors.solve(one), self._factors.solve(unit)

    @cached_property
    def _is_krylov(self) -> bool:
        """True if factors fill in and BiCGSTAB converges at once, as it does on expanders."""
        if self.n <= _FACTORED_FIRST or envelope(self.F)[1] <= _NARROW * self.n:
            return False
        steps, goal = _KRYLOV_TRIAL
        right = np.random.default_rng(0).normal(size=self.n + 1)
        z, _ = bicgstab(self._iteration, right, np.zeros(self.n + 1), goal * norm(right), steps)
        return norm(right - (z - self._iteration @ z)) <= 1.01 * goal * norm(right)

    @cached_property
    def _iteration(self) -> sp.csr_array:
        """I + K with borders divided by sqrt(n)."""
        n, F, border = self.n, self.F, np.full(self.n, self.n**-0.5)
        data = np.concatenate([np.insert(F.data, F.indptr[1:], border), border])
        indices = np.concatenate([np.insert(F.indices, F.indptr[1:], n), np.arange(n)])
        indptr = np.append(F.indptr + np.arange(n + 1), len(data))
        return sp.csr_array((data, indices, indptr), shape=(n + 1, n + 1)) + sp.eye_array(n + 1, format="csr")

    def _krylov(self, right: Floats, start: Floats | None = None, error: float = _KRYLOV_ERROR) -> Floats:
        size = np.sqrt(self.n)
        scaled = np.append(right[:-1], right[-1] / size)
        goal = _KRYLOV_ERROR * norm(scaled)
        if start is None:  # what is left of the last equation starts no method
            start = np.append(np.full(self.n, right[-1] / self.n), 0.0)
        start = np.append(start[:-1], start[-1] * size)
        z, _ = bicgstab(self._iteration, -scaled, start, error * norm(scaled), _KRYLOV_STEPS)
        if not norm(scaled + z - self._iteration @ z) <= 2 * goal:
            K = self._iteration - sp.eye_array(self.n + 1)
            z, _ = spla.gmres(K, scaled, rtol=_KRYLOV_ERROR, restart=_KRYLOV_STEPS, maxiter=1)
        return np.append(z[:-1], z[-1] / size)

    def solve(self, right: Floats) -> Floats:
        """(x, t) with F x + t 1 = right[:-1] and 1'x = right[-1]."""
        if self._is_krylov:
            return self._krylov(right)
        p, (q, r), k = self._factors.solve(right[:-1]), self._on_borders, self.k
        determinant = (1 + r[k]) * q.sum() - q[k] * r.sum()
        missing = p.sum() - right[-1]
        at_k = (p[k] * q.sum() - q[k] * missing) / determinant
        t = ((1 + r[k]) * missing - r.sum() * p[k]) / determinant
        return np.append(p - t * q - at_k * r, t)

    @cached_property
    def perron(self) -> Floats:
        """(x, t) with F x + t 1 = 0 and entries of x about 1."""
        return self._krylov(self._sum, self.nearly, _KRYLOV_BEST) if self._is_krylov else self.nearly

    @cached_property
    def nearly(self) -> Floats:
        """`perron` to about half as many digits, where these take time."""
        return self.solve(self._sum)

    @property
    def _sum(self) -> Floats:
        return np.append(np.zeros(self.n), self.n)

    def directions(self) -> tuple[Floats, Floats] | None:
        """x, y with F x = a e_k and y'F = a e_k', near the margin nearly Perron vectors; None if not positive."""
        if self._is_krylov:
            x, y = self.nearly[:-1], self.mirrored(sp.csr_array(self.F.T), np.ones(self.n)).nearly[:-1]
        else:
            unit = np.zeros(self.n)
            unit[self.k] = 1.0
            x, y = -self._on_borders[1], -self._factors.solve(unit, transposed=True)
        return (x, y) if (x > 0).all() and (y > 0).all() and np.isfinite(x).all() and np.isfinite(y).all() else None


def envelope(pattern: sp.csr_array) -> tuple[Index, float]:
    """An order in which a square matrix has a small envelope, and how many entries that has."""
    both = sp.csr_array(pattern + pattern.T)
    order = np.asarray(reverse_cuthill_mckee(both, symmetric_mode=True), dtype=np.intp)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    filled = np.flatnonzero(np.diff(both.indptr))
    if not filled.size:
        return order, 0.0
    first = np.minimum.reduceat(rank[both.indices], both.indptr[:-1][filled])
    return order, float(np.maximum(rank[filled] - first, 0).sum())


class Factors:
    """Triangular factors of minus an M-matrix; NaN where there are none."""

    def __init__(self, S: sp.csc_array) -> None:
        n = S.shape[0]
        self._sparse = self._dense = None
        spend(float(n) ** 3 / 10 if n <= _SMALL or S.nnz > _DENSE * n * n else 1e3 * S.nnz)
        with np.errstate(all="ignore"):
            if not np.isfinite(S.data).all():
                return
            if n <= _SMALL or S.nnz > _DENSE * n * n:
                factors, pivots, failed = scipy.linalg.lapack.dgetrf(S.toarray())
                self._dense = None if failed else (factors, pivots)
                return
            try:
                self._sparse = spla.splu(
                    S, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
                )
            except (RuntimeError, ValueError):  # exactly singular
                return

    def solve(self, b: Floats, transposed: bool = False) -> Floats:
        if self._sparse is not None:
            return self._sparse.solve(b, "T" if transposed else "N")
        if self._dense is not None:
            return scipy.linalg.lapack.dgetrs(*self._dense, b, trans=int(transposed))[0]
        return np.full_like(b, np.nan)


class _Mirrored:
    """Factors of G^{-1} S' G from those of S."""

    def __init__(self, factors: Factors, G: Floats) -> None:
        self._of, self._G = factors, G

    def solve(self, b: Floats, transposed: bool = False) -> Floats:
        if transposed:
            return self._G * self._of.solve(b / self._G)
        return self._of.solve(self._G * b, transposed=True) / self._G


Pair: TypeAlias = tuple[tuple[Frame, Borders], tuple[Frame, Borders]]


def moved(made: Pair, N: SparseIntegers) -> Pair:
    """Frames for N in the units, and with the solvers, of a matrix that differs from N by a shift."""
    (frame, solver), (other, transposed) = made
    return (Frame(N, frame.units), solver), (Frame(N.T, other.units), transposed)


def frames(N: SparseIntegers) -> Pair | None:
    """Frames for N and for N' in which their Perron vectors are about 1, or None where floating point finds no such."""
    with np.errstate(all="ignore"):
        frame = Frame(N, balancing_units(N))
        solver = Borders(frame.F)
        found = solver.directions()
        for _ in range(2):
            if found is None:
                return None
            weight, spread = found[0] * found[1], np.log2(found[0])
            k = int(np.argmax(weight))
            if weight[solver.k] >= 2.0**-10 * weight[k] and np.ptp(spread) <= 10:
                break
            frame = Frame(N, _centred(frame.units + np.rint(spread).astype(np.int64)))
            solver = Borders(frame.F, k)
            found = solver.directions()
        if found is None:
            return None
        other = Frame(N.T, _centred(frame.left(found[1])[1]))
        return (frame, solver), (other, solver.mirrored(other.F, frame.between(other), found[1]))


def _centred(units: NDArray[np.int64]) -> NDArray[np.int64]:
    """Units that differ by no more than rounding counted as equal."""
    units = units - int(np.median(units))
    return units if np.abs(units).max() > 4 else np.zeros_like(units)


def balancing_units(N: SparseIntegers) -> NDArray[np.int64]:
    """Exponents u for which N_ij 2**(u_j - u_i) / |N_ii| differ least between (i, j) and (j, i): least squares.

    Zero if they differ little as it is.
    """
    n, rows = N.height, N.rows
    mantissa, exponent = N.mantissas
    with np.errstate(divide="ignore"):
        length = np.log2(np.abs(mantissa)) + exponent
    size, power = mantissas(N.sizes)
    own = np.log2(size) + power
    inside = (rows != N.indices) & (N.data != 0)
    i, j, length = rows[inside], N.indices[inside], (length - own[rows])[inside]
    pull = np.bincount(i, length, minlength=n) - np.bincount(j, length, minlength=n)
    if np.abs(pull).max(initial=0.0) <= 2:
        return np.zeros(n, dtype=np.int64)
    links = sp.csr_array((np.ones(len(i)), (i, j)), shape=(n, n))
    links = links + links.T
    laplacian = sp.csr_array(sp.diags_array(links.sum(axis=1)) - links)
    units, missed = spla.cg(laplacian, pull - pull.mean(), rtol=1e-3, maxiter=_BALANCING_STEPS)
    if missed:  # long graphs, whose factors do not fill in
        ground = sp.csr_array((np.ones(1), ([0], [0])), shape=(n, n))
        units = spla.splu(sp.csc_array(laplacian + ground), permc_spec="MMD_AT_PLUS_A").solve(pull - pull.mean())
    usable = np.abs(units).max() <= np.ptp(own) + np.abs(length).sum()  # False for NaN; no balance needs more
    return _centred(np.rint(units).astype(np.int64)) if usable else np.zeros(n, dtype=np.int64)


def refine(frame: Frame, solver: Borders) -> Iterator[Step]:
    """x and t with more and more bits, until floating point adds none or the budget is spent."""
    n = len(frame.units)
    start = solver.perron
    if not (np.isfinite(start).all() and np.abs(start).max() < 2.0**20):
        return
    bits = _BITS if np.abs(start).max() >= 2.0**9 else 53
    whole: Integers = np.rint(np.ldexp(start, bits)).astype(np.int64).astype(object)
    X, T, P, stalls, spent = whole[:-1], int(whole[-1]), bits, 0, 0.0
    while stalls < _STALLS and spent < _MOST:
        cost = (100.0 + P) * len(frame.N.data)
        spend(cost)
        spent += cost
        rest, top = _residual(frame, X, T, (n << P) - int(X.sum()))
        yield Step(X, T, P, top, rest)
        if not rest.any():
            return
        step = max(4, _BITS - top)
        change = np.rint(np.ldexp(solver.solve(rest), _BITS))
        if not np.abs(change).max() < 2.0**62:
            return
        added: Integers = change.astype(np.int64).astype(object)
        added = added if top + step == _BITS else np.left_shift(added, top + step - _BITS)
        X, T, P = np.left_shift(X, step) + added[:-1], (T << step) + int(added[-1]), P + step
        stalls = stalls + 1 if step < 8 else 0


class Refined:
    """The steps of `refine`, each made once."""

    def __init__(self, frame: Frame, solver: Borders) -> None:
        self.frame, self.solver = frame, solver
        self._steps: list[Step] = []
        self._more = refine(frame, solver)

    def __iter__(self) -> Iterator[Step]:
        yield from self._steps
        for step in self._more:
            self._steps.append(step)
            yield step


def _residual(frame: Frame, X: Integers, T: int, missing: int) -> tuple[Floats, int]:
    """The residual of the bordered equations as doubles of size about 1, and their exponent."""
    mantissa, exponent = frame.residual(X, T)
    last, size = mantissas(np.array([missing], dtype=object))
    mantissa, exponent = np.append(mantissa, last), np.append(exponent, size)
    top = int(exponent[mantissa != 0].max(initial=_NOTHING))
    return np.ldexp(mantissa, np.maximum(exponent - top, -1100)), top


def rational_multiple(X: Integers, wrong: int) -> Integers | None:
    """Integers in the ratios that X has up to an error of 2^wrong in each entry, small ones first; None if too long.

    Examples
    --------
    >>> rational_multiple(np.array([2**40 // 3, 2**40 // 2, 2**40], dtype=object), 4)
    array([2, 3, 6], dtype=object)
    """
    pivot = max(X.tolist())
    common = 1
    while common.bit_length() < (pivot.bit_length() - wrong) // 2:
        scaled = X * common
        nearest = (2 * scaled + pivot) // (2 * pivot)
        far = np.flatnonzero(abs(scaled - nearest * pivot) > (common << wrong))
        if not far.size:
            return nearest
        common *= _denominator(int(scaled[far[0]]), pivot, common << wrong)
    return None


def _denominator(a: int, b: int, error: int) -> int:
    """Of the first convergent p / q of a / b with |a q - p b| <= q error."""
    left, right, before, q = b, a % b, 0, 1
    while right > q * error:  # the remainders of Euclid's algorithm are |a q - p b|
        quotient, rest = divmod(left, right)
        before, q = q, before + quotient * q
        left, right = right, rest
    return q
