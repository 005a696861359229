"""The inequalities of feedback design on a simplicial cone, linear after a change of variables.

Let t_1..t_n generate X, h_i be the facet opposite t_i and d_i = h_i't_i.  With xi > 0 and z_k = xi_k F t_k,
the closed loop x' = (A + B F) x keeps X invariant and decreases faster than exp(-rate t) if and only if

    h_i'(A t_k xi_k + B z_k) >= 0                  for i != k,
    sum_k h_i'(A t_k xi_k + B z_k) < -rate d_i xi_i  for every i,

because T^{-1}(A + B F)T is then Metzler and maps xi below -rate xi.  In discrete time the first line holds
for all i, k and the second has (1 - rate) d_i xi_i on its right.  Bounds |F t_k| <= f read |z_k| <= f xi_k.

Everything here works on doubles and on integers alike: the linear programs and the proofs that there is
no gain are about the same rows.  In doubles they are sparse: a closed row holds 1 + m of n (1 + m) entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Rows = NDArray[Any]


@dataclass(frozen=True)
class Inequalities:
    """Homogeneous rows over x = (xi_1..xi_n, z_1..z_n), z_k in R^m: ndarrays of numbers, or csr_arrays of doubles.

    Attributes
    ----------
    closed : ndarray or csr_array, shape (R, n + n m)
        closed x >= 0.
    drift : ndarray or csr_array, shape (S n, n + n m)
        drift x < theta * weight * xi[owner], theta = -rate (continuous) or 1 - rate (discrete).
    weight : ndarray, shape (S n,)
    owner : ndarray of int, shape (S n,)
    labels : tuple
        What each closed row says: ("positivity", s, i, k), ("gain", j, k), ("output", i, k) ...; empty for doubles.
    """

    n: int
    m: int
    closed: Rows
    drift: Rows
    weight: Rows
    owner: NDArray[np.intp]
    labels: tuple[tuple[Any, ...], ...]

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.n * (1 + self.m)

    def decreasing(self, theta: Any) -> Rows:
        """Rows that must be negative: drift x - theta weight xi[owner]; not for doubles."""
        rows = self.drift.copy()
        index = np.arange(len(rows))
        rows[index, self.owner] = rows[index, self.owner] - theta * self.weight
        return rows

    def with_closed(self, rows: Rows, labels: Sequence[tuple[Any, ...]]) -> Inequalities:
        """The same with more closed rows."""
        below = np.concatenate if rows.dtype == object else sp.vstack
        closed = below([self.closed, rows])
        return Inequalities(self.n, self.m, closed, self.drift, self.weight, self.owner, self.labels + tuple(labels))


def feedback_inequalities(
    facets: Rows,
    rays: Rows,
    plants: Sequence[tuple[Rows, Rows]],
    *,
    discrete: bool = False,
    drift_plants: Sequence[tuple[Rows, Rows]] | None = None,
) -> Inequalities:
    """Rows for x' = (A_s + B_s F) x on a simplicial cone.

    Parameters
    ----------
    facets, rays : ndarray, shape (n, n)
        facets[i] vanishes on every ray but rays[i].
    plants : sequence of (A_s, B_s)
        Shapes (n, n) and (n, m); one F and one xi for all.
    discrete : bool
    drift_plants : sequence of (A_s, B_s), optional
        Where stability is asked of other matrices than invariance, such as A + w B C.

    Returns
    -------
    Inequalities
    """
    n, m = len(rays), plants[0][1].shape[1]
    i, k = np.nonzero(np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool))
    constants = [(facets @ A @ rays.T)[i, k] for A, _ in plants]
    slopes = [(facets @ B)[i] for _, B in plants]
    closed = column_rows(np.concatenate(constants), np.concatenate(slopes), np.tile(k, len(plants)), n)
    drift = np.concatenate(
        [np.hstack([facets @ A @ rays.T, np.tile(facets @ B, (1, n))]) for A, B in drift_plants or plants]
    )
    exact, copies = facets.dtype == object, len(drift) // n
    pairs = list(zip(i.tolist(), k.tolist(), strict=True)) if exact else []
    return Inequalities(
        n,
        m,
        closed,
        drift if exact else sp.csr_array(drift),
        np.tile(np.einsum("ij,ij->i", facets, rays), copies),
        np.tile(np.arange(n), copies),
        tuple(("positivity", s, a, b) for s in range(len(plants)) for a, b in pairs),
    )


def column_rows(constant: Rows, slope: Rows, k: NDArray[np.intp], n: int) -> Rows:
    """Rows constant_r xi_k(r) + slope_r'z_k(r).

    Parameters
    ----------
    constant : ndarray, shape (R,)
    slope : ndarray, shape (R, m)
    k : ndarray of int, shape (R,)
    n : int
    """
    count, m = slope.shape
    columns = np.concatenate([k[:, None], n + m * k[:, None] + np.arange(m)], axis=1)
    data = np.concatenate([constant[:, None], slope], axis=1)
    if data.dtype != object:
        held = data != 0
        indptr = np.concatenate([[0], np.cumsum(held.sum(axis=1))])
        return sp.csr_array((data[held].astype(float), columns[held], indptr), shape=(count, n * (1 + m)))
    rows = np.zeros((count, n * (1 + m)), dtype=object)
    rows[np.arange(count)[:, None], columns] = data
    return rows


def gain_rows(n: int, m: int, lengths: Rows, bound: Rows) -> tuple[Rows, list[tuple[Any, ...]]]:
    """Exact rows bound_j lengths_k xi_k - |z_kj| >= 0, and what they say."""
    k, j = np.divmod(np.arange(n * m), m)
    index = np.arange(n * m)
    level, slope = np.zeros((2, n * m, n * (1 + m)), dtype=object)
    level[index, k] = lengths[k] * bound[j]
    slope[index, n + index] = 1
    labels = [("gain", int(b), int(a)) for a, b in zip(k, j, strict=True)]
    return np.concatenate([level - slope, level + slope]), labels + labels


def output_rows(C: Rows, D: Rows, facets: Rows, rays: Rows) -> tuple[Rows, list[tuple[Any, ...]]]:
    """Rows of (C + D F) t_k in Y, with facets of Y."""
    i, k = (index.ravel() for index in np.indices((len(facets), len(rays))))
    rows = column_rows((facets @ C @ rays.T)[i, k], (facets @ D)[i], k, len(rays))
    return rows, [("output", int(a), int(b)) for a, b in zip(i, k, strict=True)] if rows.dtype == object else []


def split(x: Rows, n: int, m: int) -> tuple[Rows, Rows]:
    """(xi, G) with G[:, k] = z_k / xi_k = F t_k, which is no number where a solver left xi_k at zero."""
    xi = x[:n]
    return xi, (x[n:].reshape(n, m) / xi[:, None]).T


def solved(M: Rows, right: Rows) -> Rows:
    """x with M x = right; not a number if floating point finds M singular."""
    try:
        return np.asarray(np.linalg.solve(M, right), dtype=float)
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.nan)


def gain_from_columns(G: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """F with F t_k = G[:, k]."""
    return solved(rays, G.T).T
