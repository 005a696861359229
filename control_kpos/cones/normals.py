"""Hyperplanes through n - 1 generators: normals in floating point with an error bound, and exactly.

The floating point side works in coordinates in which the generators spread out evenly.  A linear map
changes no sign of h'x, so this only makes the bound decide more: thin cones and mixed units need no
tolerance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..exact.linalg import normals
from ..exact.matrix import Integers, divide_by_content, integers_of_doubles
from ..exact.rounding import error_factor, sum_factor
from ..exact.rows import unit_rows

# Entries of the matrices that are eliminated together, so that long integers do not fill the memory.
_CHUNK = 500_000


class Hyperplanes:
    """Inner normals h of simplicial cones spanned by n - 1 of the given generators.

    Parameters
    ----------
    G : ndarray of int (object), shape (p, n)
        Generators.
    T : ndarray of int (object), shape (n, n)
        Change of coordinates z = T'x, from `round_map`.
    center : ndarray of int (object), shape (n,)
        The side that counts as inner: h'center > 0.

    Attributes
    ----------
    Z : ndarray, shape (p, n)
        Generators in the new coordinates, correctly rounded, largest entries in [1/2, 1).
    """

    def __init__(self, G: Integers, T: Integers, center: Integers) -> None:
        self.G, self.T, self.center = G, T, center
        self.Z = unit_rows(G @ T)[0]
        self._z_center = unit_rows((center @ T)[None])[0]

    def exact(self, vertices: NDArray[np.intp]) -> Integers:
        """Inner normals without common factors; vertices has shape (k, n - 1), the result (k, n)."""
        h = np.zeros((len(vertices), self.G.shape[1]), dtype=object)
        step = max(1, _CHUNK // self.G.shape[1] ** 2)
        for s in range(0, len(vertices), step):
            h[s : s + step] = normals(self.G[vertices[s : s + step]])
        inward = (h * self.center).sum(axis=1) > 0
        return np.where(inward[:, None], h, -h)

    def approximate(self, vertices: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Inner normals in the new coordinates, h'center = 1, and bounds of their errors.

        With M = [simplex; center], h solves M h = e_n.  If N is the computed inverse and |I - N M| <= eta,
        then |h - h_exact| <= |N| |e_n - M h| / (1 - eta) in the maximum norm.

        Returns
        -------
        h : ndarray, shape (k, n)
        error : ndarray, shape (k,)
            Bound of the error of h'z computed in floating point, for every z whose correct rounding has
            entries below 1, roundings included.  Infinite where nothing can be said.
        """
        n = self.Z.shape[1]
        center = np.broadcast_to(self._z_center, (len(vertices), 1, n))
        M = np.concatenate([self.Z[vertices], center], axis=1)
        N = _inverses(M)
        # n roundings in a product, one of Z, two of the differences
        small = error_factor(n + 3)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            h = N[:, :, -1]
            size_h = np.abs(h).max(axis=1)
            unit = np.eye(n)
            norm_N = np.abs(N).sum(axis=2).max(axis=1) * sum_factor(n)
            eta = np.abs(unit - N @ M).sum(axis=2).max(axis=1) * sum_factor(n) + small * n * norm_N
            residual = np.abs(unit[-1] - (M @ h[:, :, None])[:, :, 0]).max(axis=1) + small * n * size_h
            error = n * (norm_N * residual / (1 - eta) + small * size_h) * sum_factor(n)
        return h, np.where((eta < 0.5) & np.isfinite(error), error, np.inf)


def _inverses(M: NDArray[Any]) -> NDArray[Any]:
    """Inverses of a stack; NaN, which decides nothing, for the singular ones."""
    try:
        return np.linalg.inv(M)
    except np.linalg.LinAlgError:
        regular = np.linalg.det(M) != 0
        out = np.full_like(M, np.nan)
        if regular.any() and not regular.all():
            out[regular] = _inverses(M[regular])
        return out


def round_map(G: Integers) -> Integers:
    """Integer matrix T that makes the directions of G @ T spread out evenly.

    Directions are scaled to length one and whitened, again and again; the map is applied exactly, so
    that cones thinner than the precision of doubles open up as well.
    """
    n = G.shape[1]
    T = np.eye(n, dtype=int).astype(object)
    for _ in range(6):
        Z = unit_rows(G @ T)[0]
        length = np.linalg.norm(Z, axis=1, keepdims=True)
        try:
            _, size, directions = np.linalg.svd(Z / np.where(length > 0, length, 1), full_matrices=False)
        except np.linalg.LinAlgError:  # no convergence: any invertible map will do
            break
        if not (np.isfinite(size).all() and np.isfinite(directions).all()) or size[0] < 4 * size[-1]:
            break
        step, _ = integers_of_doubles(directions.T / np.maximum(size, size[0] * 2.0**-60))
        T = T @ step
    return divide_by_content(T.ravel()[None]).reshape(n, n)
