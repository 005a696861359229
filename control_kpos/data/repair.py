"""From combinations of samples in floating point to exact ones.

A program returns l with Z l = z up to rounding.  A few independent samples make up the difference, in fractions.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from scipy.linalg import qr

from ..exact.linalg import solve_exactly
from ..exact.matrix import Matrix
from .certificate import Rationals
from .program import Floats

# Entries of l below this part of the largest are left out: rounding of the solver.
_NOTHING = 1e-13
# Samples so close to dependent count as such.
_RANK = 1e-12


class Repair:
    """Exact combinations of the columns of Z.

    Parameters
    ----------
    Z : Matrix, shape (k, T)
    """

    def __init__(self, Z: Matrix) -> None:
        self.Z, values = Z, np.asarray(Z.values)
        # the scaled data, so that units of the signals do not choose the samples
        sizes = np.abs(values).max(axis=1, initial=0.0)
        _, triangle, order = qr(values / np.where(sizes > 0, sizes, 1.0)[:, None], mode="economic", pivoting=True)
        self.rank = int((np.abs(np.diag(triangle)) > _RANK * abs(triangle[0, 0])).sum()) if triangle.size else 0
        self.basis = np.sort(order[: len(values)])
        self._integers, self._unit = Z.as_integers()

    @property
    def is_complete(self) -> bool:
        """True if the samples span all states and inputs, as far as doubles can tell."""
        return self.rank == self.Z.shape[0]

    def combinations(self, guesses: Floats, targets: Rationals) -> Matrix | None:
        """Rows l near those guessed with Z l = z exactly, for rows z; None if the basis is singular.

        Parameters
        ----------
        guesses : ndarray, shape (K, T)
        targets : ndarray of Fraction, shape (K, k)
        """
        if len(self.basis) < self.Z.shape[0]:
            return None
        small = np.abs(guesses) <= _NOTHING * np.abs(guesses).max(axis=1, keepdims=True, initial=0.0)
        guessed = Matrix(np.where(small, 0.0, guesses))
        l, unit = guessed.as_integers()
        # in units of the data, rest is over a common denominator
        rest = targets / self._unit - (l @ self._integers.T) * unit
        whole = Matrix.from_fractions(rest.T) if rest.size else Matrix.zeros(*rest.T.shape)
        right, factor = whole.as_integers()
        solved = solve_exactly(self._integers[:, self.basis], right)
        if solved is None:
            return None
        scale, out = Fraction(factor) / solved[1], np.array(guessed.fractions())
        out[:, self.basis] += (solved[0] * scale).T
        return Matrix.from_fractions(out)

    def interpolant(self, X1: Matrix) -> Matrix | None:
        """[A B] that is exact at the samples of the basis; None if they are dependent."""
        right, unit = X1.as_integers()
        solved = solve_exactly(self._integers[:, self.basis].T, right[:, self.basis].T)
        if solved is None:
            return None
        return Matrix.from_fractions(solved[0].T * (Fraction(unit) / (self._unit * solved[1])))
