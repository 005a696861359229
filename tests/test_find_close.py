"""Cones of matrices with real eigenvalues that doubles do not tell apart, and what is exact of cones of doubles."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from planted import similar

import control_kpos as kp
from control_kpos import Status, checker
from control_kpos.exact.linalg import solve_columns
from control_kpos.find import find_cone


def hilbert(n: int) -> list[list[Fraction]]:
    return [[Fraction(1, i + j + 1) for j in range(n)] for i in range(n)]


def pivots(A: list[list[Fraction]]) -> list[Fraction]:
    """D of A = L D L', in rational arithmetic."""
    M, out = [list(row) for row in A], []
    for k in range(len(M)):
        out.append(M[k][k])
        for i in range(k + 1, len(M)):
            part = M[i][k] / M[k][k]
            M[i] = [a - part * b for a, b in zip(M[i], M[k], strict=True)]
    return out


@pytest.mark.parametrize("n", [8, 12, 14])
@pytest.mark.parametrize("exact", [True, False])
def test_minus_a_hilbert_matrix_keeps_a_cone_and_is_decided(n, exact):
    """Stable if and only if all pivots of the symmetric matrix are negative; as doubles it need not be."""
    rows = [[-x if exact else Fraction(-float(x)) for x in row] for row in hilbert(n)]
    found: Any = find_cone(rows)
    assert found and found.check() and found.cone.is_simplicial
    assert kp.state_positivity(rows, found)
    stable = all(x < 0 for x in pivots(rows))
    assert kp.linear_lyapunov(rows, found).status is (Status.PROVED if stable else Status.REFUTED)
    assert stable or not exact


def test_a_shift_by_less_than_the_gap_is_told():
    """-hilbert(10) has an eigenvalue near -1.1e-13."""
    A = np.array([[-x for x in row] for row in hilbert(10)], dtype=object)
    eye = np.eye(10, dtype=int).astype(object)
    for shift, stable in ((Fraction(1, 10**13), True), (Fraction(2, 10**13), False)):
        moved = (A + shift * eye).tolist()
        assert all(x < 0 for x in pivots(moved)) is stable
        found: Any = find_cone(moved)
        assert found and kp.linear_lyapunov(moved, found).status is (Status.PROVED if stable else Status.REFUTED)


@pytest.mark.parametrize("seed", [1, 2])
def test_close_rational_eigenvalues_in_any_coordinates(seed, tmp_path):
    """They need not be those of a symmetric matrix; one gap is 10^-20, and one eigenvalue 10^6."""
    values = [Fraction(1), 1 - Fraction(1, 10**20), Fraction(0), Fraction(-(10**6))]
    T = np.array(similar(np.diag([1, 2, 3, 5]), seed), dtype=object)
    D = np.array([[v if i == j else Fraction(0) for j in range(4)] for i, v in enumerate(values)], dtype=object)
    turned: Any = solve_columns(T.T, (T @ D).T)
    A = turned.T
    found: Any = find_cone(A.tolist())
    assert found and found.check() and kp.state_positivity(A.tolist(), found)
    found.save(tmp_path / "cone.json")
    assert kp.load_certificate(tmp_path / "cone.json") and checker.main(tmp_path / "cone.json") == 0


def test_facets_of_cones_of_doubles_as_fractions():
    X = kp.PolyhedralCone([[1.1, 0.3, 2], [0.2, 1, 3], [1, -1, 2], [0.5, 0.5, 0.9]])
    products = X.exact_facets.fractions() @ X.exact_rays.fractions().T
    assert (products >= 0).all() and np.array_equal(products == 0, X.incidence)
    assert all(isinstance(x, Fraction) for x in X.exact_facets.fractions().ravel())
    assert kp.PolyhedralCone.from_facets(X.exact_facets.fractions()) == X
    assert kp.PolyhedralCone(X.dual.exact_rays.fractions()) == X.dual
