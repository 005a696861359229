"""A linear program with named blocks of variables and of rows, and a margin to be as large as possible.

    minimise    sum_b cost_b'x_b
    subject to  sum_b A_b x_b <= right               (`below`)
                sum_b A_b x_b >= right + s scale     (`above`: one margin s for many rows, or a slack for each)
                sum_b A_b x_b = right                (`equal`)
                lower_b <= x_b <= upper_b            (`Block`)

Small programs are assembled dense; one sparse part makes the whole sparse.  The answer is a proposal in doubles, read
block by block.  Where it is "infeasible", `alternative` finds, in exact arithmetic, the combination of rows that
contradicts itself (Farkas), or a point after all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError, TooLargeError
from .matrix import Matrix
from .programs import Solution, solve
from .rational_programs import exact_feasibility

Floats = NDArray[np.float64]
Rationals = NDArray[np.object_]
Solver = Callable[..., Solution]

# Entries up to which dense matrices are faster.
SMALL = 30_000
# Reward of a row's own slack variable, relative to its scale: for the first 1e-7 as much as for the next 1e-5 and 1e-3,
# a concave utility, so that no row takes all and rows that must be 0 do no harm.
_TIERS = (1e-7, 1e-5, 1e-3)


class Block(NamedTuple):
    """`size` variables with bounds and cost, arrays or one number for all of them."""

    size: int
    low: ArrayLike = -np.inf
    high: ArrayLike = np.inf
    cost: ArrayLike = 0.0


class Program:
    """Blocks of variables and rows, in the order in which they are named.

    Parameters
    ----------
    **blocks : Block
        By name; more may be added with `add`.

    Examples
    --------
    The largest s with x_0 - x_1 >= s, x_1 >= s and x_0 <= 1:

    >>> program = Program(x=Block(2, high=1.0), margin=Block(1, cost=-1.0))
    >>> program.above(0.0, margin=np.ones(2), x=np.array([[1.0, -1.0], [0.0, 1.0]]))
    >>> answer = program.solve()
    >>> answer["x"], answer["margin"]
    (array([1. , 0.5]), array([0.5]))
    """

    def __init__(self, **blocks: Block) -> None:
        self._places: dict[str, slice] = {}
        self._blocks: list[Block] = []
        self._below: list[tuple[dict[str, Any], Floats]] = []
        self._equal: list[tuple[dict[str, Any], Floats]] = []
        self._size = 0
        self.add(**blocks)

    def add(self, **blocks: Block) -> None:
        """Add variables.

        Parameters
        ----------
        **blocks : Block
            By name.
        """
        for name, block in blocks.items():
            self._places[name] = slice(self._size, self._size + block.size)
            self._size += block.size
            self._blocks.append(block)

    def below(self, right: ArrayLike, **parts: Any) -> None:
        """Add rows sum A_b x_b <= right.

        Parameters
        ----------
        right : array_like, shape (k,) or scalar
        **parts : ndarray or sparse, shape (k, count), or (k,) for a block of one variable
            A_b, by the name of the block.
        """
        self._below.append(_rows(right, parts))

    def equal(self, right: ArrayLike, **parts: Any) -> None:
        """Add rows sum A_b x_b = right.

        Parameters
        ----------
        right, **parts
            As in `below`.
        """
        self._equal.append(_rows(right, parts))

    def above(self, right: ArrayLike, margin: ArrayLike = 0.0, *, name: str = "margin", **parts: Any) -> None:
        """Add rows sum A_b x_b >= right + s margin, where s is the block of one variable called `name`.

        Parameters
        ----------
        right : array_like, shape (k,) or scalar
        margin : array_like, shape (k,)
            The factor of s in each row; 0: none.
        name : str
        **parts
            As in `below`.
        """
        negative = {block: -part for block, part in parts.items()}
        if np.any(margin):
            negative[name] = np.asarray(margin, dtype=float)
        self.below(-np.asarray(right, dtype=float), **negative)

    def spread(self, right: ArrayLike, scale: Floats, **parts: Any) -> None:
        """Add rows sum A_b x_b >= right + s_r scale_r, with a slack s_r of its own, at most 1e-3, for every row.

        Their reward makes as many rows positive as possible before it makes any of them large.

        Parameters
        ----------
        right : array_like, shape (k,) or scalar
        scale : ndarray, shape (k,)
        **parts
            As in `below`.
        """
        self.add(slack=Block(len(_TIERS) * len(scale), low=0.0, high=1.0, cost=-1.0))
        negative = {block: -part for block, part in parts.items()}
        self.below(-np.asarray(right, dtype=float), **negative, slack=_diagonals([scale * tier for tier in _TIERS]))

    def solve(self, lp: Solver = solve, **options: Any) -> Solution:
        """Hand the program to a solver.

        Parameters
        ----------
        lp : callable
            As `control_kpos.exact.programs.solve`.
        **options
            For it.

        Returns
        -------
        Solution
            With answer[name] for the variables of a block.  Not checked.
        """
        low, high, cost = (np.concatenate([_filled(b[k], b.size) for b in self._blocks]) for k in (1, 2, 3))
        below, equal = self._assembled(self._below), self._assembled(self._equal)
        return replace(lp(cost, *below, *equal, bounds=(low, high), **options), places=self._places)

    def _assembled(self, groups: list[tuple[dict[str, Any], Floats]]) -> tuple[Any, Floats | None]:
        if not groups:
            return None, None
        right = np.concatenate([right for _, right in groups])
        if any(sp.issparse(part) for parts, _ in groups for part in parts.values()):
            return self._sparse(groups, len(right)), right
        matrix, at = np.zeros((len(right), self._size)), 0
        for parts, bounds in groups:
            for name, part in parts.items():
                matrix[at : at + len(bounds), self._places[name]] = part
            at += len(bounds)
        return matrix, right

    def _sparse(self, groups: list[tuple[dict[str, Any], Floats]], height: int) -> sp.csr_array:
        data, rows, columns, at = [], [], [], 0
        for parts, bounds in groups:
            for name, part in parts.items():
                row, column, values = _entries(part)
                data.append(values)
                rows.append(row + at)
                columns.append(column + self._places[name].start)
            at += len(bounds)
        places = np.concatenate(rows), np.concatenate(columns)
        return sp.csr_array((np.concatenate(data), places), shape=(height, self._size))


def _rows(right: ArrayLike, parts: dict[str, Any]) -> tuple[dict[str, Any], Floats]:
    shaped = {name: part if sp.issparse(part) or np.ndim(part) == 2 else part[:, None] for name, part in parts.items()}
    height = next(iter(shaped.values())).shape[0]
    return shaped, _filled(right, height)


def _filled(values: Any, count: int) -> Floats:
    """As many numbers, if one is given for all: `numpy.broadcast_to` takes as long as a small program's assembly."""
    return np.full(count, values, dtype=float) if np.ndim(values) == 0 else np.asarray(values, dtype=float)


def _entries(part: Any) -> tuple[Any, Any, Floats]:
    """Rows, columns and values of what is not 0."""
    if sp.issparse(part):
        found = sp.coo_array(part)
        return *found.coords, found.data
    flat = part.ravel()
    at = np.flatnonzero(flat != 0)  # a twentieth of the time of coo_array
    return at // part.shape[1], at % part.shape[1], flat[at]


def _diagonals(sizes: list[Floats]) -> Any:
    """Diagonal matrices side by side."""
    if sum(size.size**2 for size in sizes) <= SMALL:
        return np.hstack([np.diag(size) for size in sizes])
    count, width = sizes[0].size, len(sizes)
    indices = np.arange(count)[:, None] + count * np.arange(width)
    parts = np.stack(sizes, axis=1).ravel(), indices.ravel(), np.arange(0, count * width + 1, width)
    return sp.csr_array(parts, shape=(count, count * width))


def widest(rows: Floats) -> tuple[Floats, float]:
    """w in the unit box whose least product with a row is as large as possible, and that product; zeros if none.

    >>> widest(np.array([[1.0, 0.0], [0.0, 1.0]]))
    (array([1., 1.]), 1.0)
    """
    n = rows.shape[1]
    program = Program(w=Block(n, -1.0, 1.0), margin=Block(1, -1.0, 1.0, -1.0))
    program.above(0.0, np.ones(len(rows)), w=rows)
    answer = program.solve()
    return (answer["w"], float(answer["margin"][0])) if answer else (np.zeros(n), 0.0)


def alternative(rows: Rationals, strict: NDArray[np.bool_]) -> tuple[Rationals | None, Rationals | None]:
    """Exactly one of multipliers that contradict  rows x >= 0, rows x > 0 where strict,  and a solution x.

    Multipliers are y >= 0 with y'rows = 0 and a positive sum over the strict rows: multiplying them with a supposed
    solution gives 0 > 0 (Motzkin's form of Farkas' lemma).  Both None if exact arithmetic would take too long.

    Parameters
    ----------
    rows : ndarray of int and Fraction, shape (K, v)
    strict : ndarray of bool, shape (K,)

    Returns
    -------
    multipliers : ndarray of Fraction, shape (K,), or None
    x : ndarray of Fraction, shape (v,), or None

    Examples
    --------
    >>> alternative(np.array([[1], [-1]], dtype=object), np.array([False, True]))
    (array([Fraction(1, 1), Fraction(1, 1)], dtype=object), None)
    """
    matrix = np.concatenate([rows.T, strict.astype(int).astype(object)[None, :]])
    right = np.array([0] * rows.shape[1] + [1], dtype=object)
    try:
        multipliers, x = exact_feasibility(Matrix.from_fractions(matrix), Matrix.from_fractions(right))
    except (TooLargeError, DataError):  # too much work, or numbers beyond the range of doubles
        return None, None
    return multipliers, None if x is None else x[:-1]
