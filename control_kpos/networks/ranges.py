"""Numbers that are known within ranges: a lower and an upper end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from ..errors import DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix
from ..exact.matrix import Matrix


@dataclass(frozen=True, eq=False)
class Interval:
    """Numbers or matrices between two ends, as `interval` makes them.

    Attributes
    ----------
    lower, upper : number, array_like or sparse matrix
        The ends, as they were given.
    """

    remedy: ClassVar[str] = "ranges are for kp.stack, couplings and kp.nonlinear_links"
    lower: Any
    upper: Any


def interval(lower: ArrayLike | Any, upper: ArrayLike | Any) -> Interval:
    """A range for `stack` and `feedback_interconnect`: everything from one end to the other, also changing in time.

    Parameters
    ----------
    lower, upper : number, array_like or sparse matrix
        The ends, of one shape: for a matrix A, B, C or D of `stack` on nonnegative orthants, for a coupling or a block
        of it, or for one weight.

    Returns
    -------
    Interval

    Raises
    ------
    ShapeError, DataError
        Ends of different shapes; numbers that are not finite and real; an entry whose lower end is above its upper
        end.

    Examples
    --------
    >>> import control_kpos as kp
    >>> nodes = kp.stack(kp.interval([[[-3.0]], [[-4.0]]], [[[-2.0]], [[-3.0]]]), B=[[1]], C=[[1]])
    >>> net = kp.feedback_interconnect(nodes, [[0, kp.interval(0, 1)], [kp.interval("1/2", 2), 0]])
    >>> net.certificate.status.name
    'PROVED'
    """
    for end, name in ((lower, "lower"), (upper, "upper")):
        if isinstance(end, Interval):
            raise DataError(f"{name} is a range itself; give numbers.")
    low, high = (_read(end, name) for end, name in ((lower, "lower"), (upper, "upper")))
    if low.shape != high.shape:
        raise ShapeError(f"lower has shape {low.shape}, but upper has {high.shape}; a range has ends of one shape.")
    place = first_above(low, high)
    if place is not None:
        raise DataError(
            f"lower is above upper at {list(place)}: {_entry(low, place)} > {_entry(high, place)}. Exchange the ends."
        )
    return Interval(lower, upper)


def _read(end: Any, name: str) -> Matrix:
    return exact_matrix(end, name, ndim=2 if sp.issparse(end) else max(dimensions(end) or 0, 1))


def first_above(low: Matrix, high: Matrix) -> tuple[int, ...] | None:
    """The first place where a matrix is above another of its shape, exactly; None if there is none."""
    apart: Any
    if low.is_double and high.is_double:  # the sign of a difference of doubles is that of the exact one
        apart = sp.coo_array(low.values > high.values) if low.is_sparse else low.values > high.values
    else:
        apart = low.dense().fractions() > high.dense().fractions()
    places = apart.coords if sp.issparse(apart) else np.nonzero(apart)
    return tuple(int(axis[0]) for axis in places) if places[0].size else None


def _entry(M: Matrix, place: tuple[int, ...]) -> Any:
    return M.values[place] if M.is_double else M.fractions()[place]


def is_graph(data: Any) -> bool:
    """True for networkx graphs, without importing networkx."""
    kind = type(data)  # an instance may answer anything
    return all(hasattr(kind, name) for name in ("is_multigraph", "is_directed", "edges", "nodes"))


def has_ranges(data: Any) -> bool:
    """True if a matrix, a list of lists of entries or blocks, or an edge of a graph, holds a range."""
    if is_graph(data):
        return any(isinstance(weight, Interval) for *_, weight in data.edges(data="weight"))
    if isinstance(data, (list, tuple)):
        return any(isinstance(row, (list, tuple)) and any(isinstance(x, Interval) for x in row) for row in data)
    return isinstance(data, Interval)


def end_of(data: Any, end: str) -> Any:
    """The lower or the upper end of what may hold ranges."""
    take: Callable[[Any], Any] = lambda x: getattr(x, end) if isinstance(x, Interval) else x  # noqa: E731
    if isinstance(data, (list, tuple)) and has_ranges(data):
        return [[take(x) for x in row] if isinstance(row, (list, tuple)) else row for row in data]
    return take(data)
