"""Plants for which a stabilising gain exists by construction, with all margins open."""

from fractions import Fraction

import numpy as np

import control_kpos as kp
from control_kpos.exact.linalg import solve_columns


def unit(rays):
    """Rows scaled to a leading entry of size 1: the first of at least an eighth of the size of the largest."""
    return np.array([x / next(abs(a) for a in x if 8 * abs(a) >= np.abs(x).max()) for x in np.asarray(rays)])


def metzler_hurwitz(rng, n):
    """Off-diagonal entries in [0.05, 1], diagonally dominant up to a scaling of the coordinates."""
    M = rng.uniform(0.05, 1.0, size=(n, n))
    np.fill_diagonal(M, 0.0)
    np.fill_diagonal(M, -M.sum(axis=1) - rng.uniform(0.2, 1.0, size=n))
    scale = rng.uniform(0.4, 2.5, size=n)
    return M * scale[:, None] / scale


def generators(rng, n):
    """Columns of a well-conditioned simplicial cone."""
    while True:
        T = rng.normal(size=(n, n))
        if np.linalg.cond(T) < 200:
            return T


def simplicial(rng, n, m):
    """(A, B, rays, F) with A + B F Metzler and Hurwitz in the coordinates of the rays."""
    T = generators(rng, n)
    closed = T @ metzler_hurwitz(rng, n) @ np.linalg.inv(T)
    B, F = rng.normal(size=(n, m)), rng.normal(size=(m, n))
    return closed - B @ F, B, T.T, F


def discrete(rng, n, m):
    """(A, B, rays, F) with A + B F positive and Schur in the coordinates of the rays."""
    T = generators(rng, n)
    M = rng.uniform(0.05, 1.0, size=(n, n))
    M *= rng.uniform(0.3, 0.95) / M.sum(axis=1).max()
    B, F = rng.normal(size=(n, m)), rng.normal(size=(m, n))
    return T @ M @ np.linalg.inv(T) - B @ F, B, T.T, F


def round_cone(rng, n, extra):
    """A proper cone with more generators than dimensions: around an axis, then skewed."""
    directions = rng.normal(size=(n + extra, n - 1))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = np.hstack([directions, np.ones((n + extra, 1))])
    rays = np.vstack([rays, np.hstack([-directions[:1], np.ones((1, 1))])])
    return kp.PolyhedralCone(rays @ (np.eye(n) + 0.3 * rng.normal(size=(n, n)) / np.sqrt(n)))


def polyhedral(rng, n, m, extra):
    """(A, B, X, F) on a cone that is not simplicial: A + B F = R N - s I with N >= 0 mapping the cone into itself."""
    while True:
        X = round_cone(rng, n, extra)
        if X.is_proper and not X.is_simplicial:
            break
    inside, normals = X.rays, X.facets / np.linalg.norm(X.facets, axis=1, keepdims=True)
    inward = sum(
        np.outer(rng.dirichlet(np.ones(len(inside))) @ inside, rng.dirichlet(np.ones(len(normals))) @ normals)
        for _ in range(n)
    )
    closed = inward - (np.linalg.eigvals(inward).real.max() + rng.uniform(0.2, 1.0)) * np.eye(n)
    B, F = rng.normal(size=(n, m)), rng.normal(size=(m, n))
    return closed - B @ F, B, X, F


def output(rng, n, m, q):
    """(A, B, C, rays, K) with A + B K C Metzler and Hurwitz in the coordinates of the rays."""
    T = generators(rng, n)
    closed = T @ metzler_hurwitz(rng, n) @ np.linalg.inv(T)
    B, K, C = rng.normal(size=(n, m)), rng.normal(size=(m, q)), rng.normal(size=(q, n))
    return closed - B @ K @ C, B, C, T.T, K


def pair(gap: float, frequency: float) -> np.ndarray:
    """Eigenvalues 0 and -gap +- i frequency."""
    return np.array([[0, 0, 0], [0, -gap, -frequency], [0, frequency, -gap]], dtype=float)


def with_dominant_eigenvalue(seed: int, n: int, *, discrete: bool) -> np.ndarray:
    """A random matrix with a simple, strictly dominant, real (discrete: positive) eigenvalue."""
    rng = np.random.default_rng(seed)
    while True:
        A = rng.standard_normal((n, n)) / np.sqrt(n)
        values = np.linalg.eigvals(A)
        size = np.abs(values) if discrete else values.real
        first, *rest = np.argsort(-size)
        real = values[first].imag == 0 and (values[first].real > 0 or not discrete)
        if real and (not rest or size[first] - size[rest[0]] > 1e-3):
            return A


def similar(A: np.ndarray, seed: int) -> list[list[Fraction]]:
    """T A T^-1 for a random integer T, exactly."""
    rng = np.random.default_rng(seed)
    while True:
        T = rng.integers(-2, 3, A.shape)
        if abs(np.linalg.det(T)) > 0.5:
            break
    fractions = [np.array([[Fraction(int(x)) for x in row] for row in M], dtype=object) for M in (A, T)]
    return solve_columns(fractions[1].T, (fractions[1] @ fractions[0]).T).T
