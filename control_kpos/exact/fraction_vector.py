"""Vectors of fractions that are written out as fractions only when somebody asks for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from .matrix import Matrix


class FractionVector(Sequence[Fraction]):
    """A vector that reads as a tuple of Fraction and is stored as integers over one denominator.

    Parameters
    ----------
    matrix : Matrix, shape (n,)
        The same numbers, with their doubles.

    Examples
    --------
    >>> x = FractionVector(Matrix.over(np.array([1, 3], dtype=object), 2))
    >>> x == (Fraction(1, 2), Fraction(3, 2)), x.matrix.values
    (True, array([0.5, 1.5]))
    """

    def __init__(self, matrix: Matrix) -> None:
        self.matrix = matrix

    @classmethod
    def of(cls, values: Sequence[Fraction]) -> FractionVector:
        """From a tuple of fractions, or one of these."""
        if isinstance(values, cls):
            return values
        column = np.empty(len(values), dtype=object)
        column[:] = values
        return cls(Matrix.from_fractions(column))

    @cached_property
    def _fractions(self) -> tuple[Fraction, ...]:
        return tuple(self.matrix.fractions().tolist())

    def __len__(self) -> int:
        return self.matrix.shape[0]

    def __getitem__(self, index: Any) -> Any:
        return self._fractions[index]

    def __iter__(self) -> Iterator[Fraction]:
        return iter(self._fractions)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, (tuple, FractionVector)):
            return NotImplemented
        return self._fractions == tuple(other)

    def __hash__(self) -> int:
        return hash(self._fractions)

    def __repr__(self) -> str:
        return repr(self._fractions)
