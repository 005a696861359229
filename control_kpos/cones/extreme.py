"""Pointed, solid, extreme: read off the generators of a cone, without its facets.

    pointed:  some w has w'x_i > 0 for all i, or else some p >= 0, p != 0, has sum_i p_i x_i = 0;
    solid:    the x_i span R^n;
    extreme:  some f has f'x_i < 0 <= f'x_j for all j != i, or else x_i is a nonnegative combination of the others.

Each is one linear program for a cone that may have millions of facets.  Floating point proposes w and f,
the kernel proves them, and rational arithmetic settles what is left.  In three dimensions the extreme generators are
the corners of a polygon, which the signs of determinants tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, TooLargeError
from ..exact.budget import spend
from ..exact.linalg import echelon
from ..exact.matrix import Integers, Matrix, divide_by_content
from ..exact.program import widest
from ..exact.programs import program_effort
from ..exact.rational_programs import exact_feasibility
from ..exact.rows import frozen
from ..exact.signs import BilinearForms
from .hull import ALLOWANCE, LIMIT, Allowance

# Facets that p generators can have, times the cube of the dimension, above which generators are asked first.
_MANY = 3 * 10**7
# So many facets are no trouble in any dimension.
_FEW = 2000
# Below this dimension facets are few, and above this number of generators many may be redundant.
LOW, _NUMEROUS = 5, 400
# Least distance at which a separator counts.
SEPARATES = 1e-9
# Number of rows times the square of their length above which the span is not computed.
_LONGEST = 5 * 10**6
# Operations that a unit of work allows a linear program in rational numbers.
_OPERATIONS = 100


@dataclass(frozen=True, eq=False)
class Extreme:
    """The extreme generators of a pointed cone.

    Attributes
    ----------
    rays : Matrix, shape (p, n)
        As they were given; none is redundant.
    pointing : ndarray, shape (n,), or None
        w with w'x > 0 on all of them, where doubles have one.
    """

    rays: Matrix
    pointing: NDArray[np.float64] | None


def most_facets(p: int, n: int) -> int:
    """The largest number of facets of a cone with p generators in dimension n (McMullen's upper bound theorem).

    Examples
    --------
    >>> most_facets(60, 8), most_facets(4, 3)
    (55440, 4)
    """
    k, odd = divmod(n - 1, 2)
    if p < n or n < 2:
        return 1
    return 2 * comb(p - k - 1, k) if odd else comb(p - k, k) + comb(p - k - 1, k - 1)


def may_have_many_facets(p: int, n: int) -> bool:
    """Whether the facets of p generators in dimension n could take more than a few seconds."""
    if not (LOW <= n < p <= _NUMEROUS and p * n**2 <= _LONGEST):
        return False
    return most_facets(p, n) > max(_FEW, _MANY / n**3)


def extreme_generators(generators: Matrix) -> Extreme | None:
    """The extreme ones among generators, in their order; None if the cone is not pointed.

    Parameters
    ----------
    generators : Matrix, shape (p, n)
        Nonzero rows.

    Raises
    ------
    TooLargeError
        If rational arithmetic would take too long.

    Notes
    -----
    p linear programs of about 10 n rows, ten milliseconds each for n = 12; and for each redundant generator one in
    rational numbers.  In three dimensions the corners of a polygon: a second for 80 000 generators.
    """
    rows = divide_by_content(generators.rows_as_integers(np.arange(generators.shape[0])))
    search = _Search(rows, generators)
    pointing = search.pointing()
    if pointing is None and search.line() is not None:
        return None
    seen: dict[tuple[int, ...], int] = {}
    for i, row in enumerate(rows.tolist()):
        seen.setdefault(tuple(row), i)
    first = np.array(list(seen.values()), dtype=np.intp)
    kept = None if pointing is None or rows.shape[1] != 3 else _corners(rows[first], pointing)
    kept = _Search(rows[first], generators[first]).extreme(pointing) if kept is None else kept
    return Extreme(generators[first[kept]], pointing)


def _corners(rows: Integers, pointing: NDArray[np.float64]) -> NDArray[np.intp]:
    """The extreme ones of different generators in three dimensions: corners of a polygon, by signs of determinants.

    With heights h = w'x > 0 the points (x_i / h, x_j / h) of the section are sorted, and the two chains of its border
    turn one way (Andrew, 1979).
    """
    w = Matrix(pointing[None]).as_integers()[0][0]
    i, j = np.delete(np.arange(3), np.argmax(np.abs(pointing)))
    points = [(int(x[i]), int(x[j]), int(x @ w)) for x in rows]
    shift = 2 * max(h.bit_length() for _, _, h in points)  # enough to tell two quotients apart
    order = sorted(range(len(points)), key=lambda k: [(a << shift) // points[k][2] for a in points[k][:2]])
    kept: set[int] = set()
    for way in (order, order[::-1]):
        chain: list[int] = []
        for k in way:
            while len(chain) > 1 and not _turns(points[chain[-2]], points[chain[-1]], points[k]):
                chain.pop()
            chain.append(k)
        kept |= set(chain)
    return np.array(sorted(kept), dtype=np.intp)


def _turns(a: tuple[int, int, int], b: tuple[int, int, int], c: tuple[int, int, int]) -> bool:
    """Whether the points of a section turn to the left: det(a, b, c) > 0."""
    (p, q, r), (s, t, u) = b, c
    return a[0] * (q * u - r * t) - a[1] * (p * u - r * s) + a[2] * (p * t - q * s) > 0


def line_in(generators: Matrix) -> NDArray[np.object_] | None:
    """p >= 0, p != 0, with sum_i p_i x_i = 0, if the cone is not pointed."""
    return _Search(generators.rows_as_integers(np.arange(generators.shape[0])), generators).line()


def rank(generators: Matrix) -> int:
    """Dimension of the span."""
    return echelon(generators.rows_as_integers(np.arange(generators.shape[0]))).rank


def separator(points: NDArray[np.float64], i: int, others: NDArray[np.intp]) -> tuple[NDArray[np.float64], float]:
    """g with g'x_i < 0 < g'x_j for all j in `others`, and the least of these sizes; not positive if none was found.

    Most of the others are far away: the linear program starts from the nearest ones, and those it forgets join.
    """
    n = points.shape[1]
    near = np.argsort(np.linalg.norm(points[others] - points[i], axis=1))
    active = np.zeros(len(others), dtype=bool)
    active[near[: 10 * n]] = True
    while True:
        spend(program_effort(int(active.sum()) + 1, n + 1))
        g, margin = widest(np.concatenate([points[others[active]], -points[[i]]]))
        if margin <= SEPARATES:
            return g, margin
        height = np.where(active, np.inf, points[others] @ g)
        forgotten = np.argsort(height)[: 4 * n]
        forgotten = forgotten[height[forgotten] < 0.5 * margin]
        if not forgotten.size:
            return g, margin
        active[forgotten] = True


class _Search:
    """Linear programs about generators, known as integers up to positive factors."""

    def __init__(self, rows: Integers, exact: Matrix) -> None:
        self.rows, self.exact = rows, exact
        self.allowance = ALLOWANCE.get() or Allowance(LIMIT, LIMIT)
        values = np.asarray(exact.values)
        top = np.abs(values).max(axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            self.unit = values / np.where(top > 0, top, 1.0)

    def pointing(self) -> NDArray[np.float64] | None:
        """w with w'x > 0 for every generator, proven; None if floating point finds none."""
        p, n = self.unit.shape
        self.allowance.take(20 * p * n, p, n)
        spread = self.unit / np.linalg.norm(self.unit, axis=1, keepdims=True)
        w, margin = widest(spread)
        if not margin > 0:
            return None
        w = np.ldexp(w, -np.frexp(np.abs(w).max())[1])
        signs = BilinearForms(Matrix(w[None]), None, self.exact).signs()
        return frozen(w) if (signs == 1).all() else None

    def line(self) -> NDArray[np.object_] | None:
        """p >= 0 with sum_i p_i x_i = 0 and sum_i p_i = 1."""
        p, n = self.rows.shape
        matrix = np.concatenate([self.rows.T, np.ones((1, p), dtype=int).astype(object)])
        return self._feasible(matrix, np.array([0] * n + [1], dtype=object))

    def extreme(self, pointing: NDArray[np.float64] | None) -> NDArray[np.intp]:
        """Those of distinct generators of a pointed cone that are no combination of the others."""
        p = len(self.rows)
        separators = np.array([self._separator(i, spread) for spread in [self._spread(pointing)] for i in range(p)])
        signs = BilinearForms(Matrix(separators), None, self.exact).signs()
        proven = (signs == 1 - 2 * np.eye(p, dtype=np.int8)).all(axis=1)
        others = np.arange(p)
        for i in np.flatnonzero(~proven):
            rest = others[others != i]
            if self._feasible(self.rows[rest].T, self.rows[i]) is not None:
                others = rest
        return others

    def _spread(self, pointing: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Generators of one height in coordinates that spread them out, and the map to these coordinates."""
        heights = np.ones(len(self.unit)) if pointing is None else self.unit @ pointing
        section = self.unit / np.where(heights > 0, heights, 1.0)[:, None]
        try:
            _, size, directions = np.linalg.svd(section, full_matrices=False)
        except np.linalg.LinAlgError:  # then the coordinates stay as they are
            return section, np.eye(section.shape[1])
        back = directions.T / np.maximum(size, size[0] * 2.0**-40)
        return section @ back, back

    def _separator(self, i: int, spread: tuple[NDArray[np.float64], NDArray[np.float64]]) -> NDArray[np.float64]:
        """f that should be negative on generator i and positive on all others; any vector if there is none."""
        section, back = spread
        p, n = section.shape
        self.allowance.take(20 * min(p, 10 * n) * n, *self.rows.shape)
        f = back @ separator(section, i, np.delete(np.arange(p), i))[0]
        top = np.abs(f).max()
        return np.ldexp(f, -np.frexp(top)[1]) if 0 < top < np.inf else np.ones(len(back))

    def _feasible(self, matrix: Integers, right: Integers) -> NDArray[np.object_] | None:
        """x >= 0 with matrix @ x = right."""
        n = len(matrix)
        digits = max(abs(int(x)).bit_length() for x in matrix.ravel())
        # about four eliminations
        self.allowance.take(2.4 * n**3 * (1 + n * digits / 1024) ** 1.6, *self.rows.shape)
        try:
            return exact_feasibility(matrix, right, work_limit=_OPERATIONS * min(self.allowance.work, LIMIT))[0]
        except DataError:
            raise TooLargeError(
                f"{len(self.rows)} vectors in dimension {self.rows.shape[1]} have numbers too long for linear "
                "programs; give them with fewer digits."
            ) from None
