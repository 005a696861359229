"""The nonnegative orthant, which holds its dimension only."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import ShapeError, UndecidedError
from ..exact.intake import whole_number
from ..exact.matrix import Matrix
from ..exact.rows import nonzero
from .base import Cone

_LARGEST = 2**40


class Orthant(Cone):
    """The nonnegative orthant {x in R^n : x_i >= 0}; its own dual.

    Parameters
    ----------
    n : int
        Dimension, at least 1.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X = kp.orthant(3)
    >>> X.n_facets, X.dual == X, X.contains([1, 0, 2])
    (3, True, True)
    """

    def __init__(self, n: int) -> None:
        vars(self).update(dim=whole_number(n, "n", least=1, most=_LARGEST, outside=ShapeError))

    @property
    def exact_rays(self) -> Matrix:
        return self._identity

    @cached_property
    def _identity(self) -> Matrix:
        n = self.dim
        return Matrix(sp.csr_array((np.ones(n), np.arange(n), np.arange(n + 1)), shape=(n, n)))

    @property
    def exact_facets(self) -> Matrix:
        return self._identity

    @property
    def dual(self) -> Orthant:
        return self

    @property
    def is_pointed(self) -> bool:
        return True

    @property
    def is_solid(self) -> bool:
        return True

    @property
    def n_rays(self) -> int:
        return self.dim

    @property
    def n_facets(self) -> int:
        return self.dim

    @property
    def incidence(self) -> NDArray[np.bool_]:
        self._refuse_large((self.dim, self.dim), "incidence")
        return ~np.eye(self.dim, dtype=bool)

    @property
    def interior_point(self) -> NDArray[np.float64]:
        return np.broadcast_to(1.0, (self.dim,))

    def _contains_rows(self, points: Matrix, strict: bool) -> NDArray[np.bool_]:
        if points.is_sparse or points.integer_rows is not None:
            return super()._contains_rows(points, strict)
        # integers rather than the doubles next to them, which may have underflowed
        x = np.asarray(points.values if points.numerators is None else points.numerators)
        inside = x > 0 if strict else x >= 0
        return np.asarray(np.array(inside, dtype=bool).all(axis=1))

    def _equals(self, other: Cone) -> bool:
        return isinstance(other, Orthant) or super()._equals(other)

    def _image(self, T: Matrix) -> Cone:
        columns = T.T
        return Cone._from_rays(columns[np.flatnonzero(nonzero(columns).any(axis=1))])

    def __neg__(self) -> Cone:
        return Cone._product([Cone._from_rays(Matrix(np.array([[-1.0]])))] * self.dim)

    def _describe_line(self) -> str:
        raise UndecidedError("an orthant contains no line.")

    def _describe_hyperplane(self) -> str:
        raise UndecidedError("an orthant lies in no hyperplane.")

    def __repr__(self) -> str:
        return f"orthant({self.dim})"


def orthant(n: int) -> Orthant:
    """The nonnegative orthant in R^n, which holds n only, whatever the size.

    Parameters
    ----------
    n : int
        Dimension, at least 1.

    Returns
    -------
    Orthant

    Examples
    --------
    >>> import control_kpos as kp
    >>> kp.orthant(2).rays
    array([[1., 0.],
           [0., 1.]])
    """
    return Orthant(n)


class Origin(Orthant):
    """The cone {0} of R^0: the states of a static gain, the inputs of an autonomous system."""

    def __init__(self) -> None:
        vars(self).update(dim=0)


@cache
def nonnegative(n: int) -> Orthant:
    """The nonnegative orthant of R^n, for n = 0 as well; one object for each n."""
    return orthant(n) if n else Origin()
