"""Families without a common cone that a short product gives away, where dominant directions say nothing."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from planted import metzler_hurwitz, similar

import control_kpos as kp
from control_kpos import Status, checker
from control_kpos.find import find_cone

UP, DOWN = np.array([[0, 1], [0, 0]]), np.array([[0, 0], [-1, 0]])
I2, ROT = np.eye(2, dtype=int), np.array([[0, -1], [1, 0]])
LONG = np.diag([1, 1], 1)
DISCRETE = {
    "chains that turn": [I2 + UP, I2 + DOWN],
    "a product with the eigenvalue -1 twice": [I2 + 2 * UP, I2 + 2 * DOWN],
    "by a little at a time": [I2 + UP, 3 * I2 + DOWN],
    "nilpotent": [UP, DOWN],
    "three states": [np.eye(3, dtype=int) + LONG, np.eye(3, dtype=int) - LONG.T],
    "beside a member that keeps the orthant": [I2 + UP, I2, I2 + DOWN],
}
CONTINUOUS = {
    "shears": [UP, DOWN],
    "linear chains": [[[-1, 0], [1, -1]], [[-2, -2], [0, -2]]],
    "with a member between": [UP - I2, -4 * I2, DOWN - I2],
    "large and small numbers": [10**9 * UP, DOWN - I2],
}
FAMILIES = {**{f"{name}, discrete": f for name, f in DISCRETE.items()}, **CONTINUOUS}


@pytest.mark.parametrize("name", FAMILIES)
def test_a_short_product_excludes_a_common_cone(name, tmp_path):
    family, discrete = FAMILIES[name], "discrete" in name
    shuffled = [similar(np.array(A), 3) for A in family]
    thirds = [np.array([[Fraction(int(x), 3) for x in row] for row in A], dtype=object) for A in family]
    doubles = [0.1 * np.array(A) for A in family]
    for k, members in enumerate((family, family[::-1], shuffled, thirds, doubles)):
        found = find_cone(members, discrete=discrete, restarts=0)
        assert found.status is Status.REFUTED and found.check(), k
        assert "no eigenvalue" in found.explain() and (k or "contradict" not in found.explain())
        found.save(tmp_path / "none.json")
        assert kp.load_certificate(tmp_path / "none.json").explain() == found.certificate.explain()
        assert checker.main(tmp_path / "none.json") == 1  # no cone: REFUTED
    # the product itself, by its eigenvalues
    M = np.eye(len(family[0]))
    w: Any = find_cone(family, discrete=discrete).obstruction
    for i, s in zip(w.cycle, w.shifts, strict=True):
        A = np.array(family[i], dtype=float)
        M = M @ (np.linalg.matrix_power(A, int(s)) if discrete else np.linalg.inv(float(s) * np.eye(len(A)) - A))
    values = np.linalg.eigvals(M)
    assert not ((abs(values.imag) < 1e-6 * abs(values).max()) & (values.real > 0.99 * abs(values).max())).any()


@pytest.mark.parametrize("change", ["cycle", "shifts", "bound"])
def test_a_changed_product_proves_nothing(change):
    found = find_cone([UP, DOWN])
    w: Any = found.obstruction
    other = {"cycle": (0,) * len(w.cycle), "shifts": tuple(-s for s in w.shifts), "bound": Fraction(10**9)}
    assert not replace(found.certificate, witness=replace(w, **{change: other[change]})).check()


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_families_with_a_common_cone_are_never_refuted(seed, discrete):
    """Chains among them: entries of their multipliers are 0, and eigenvalues of products repeat."""
    rng = np.random.default_rng(seed)
    n, count = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    members = []
    for _ in range(count):
        P = rng.integers(0, 3, (n, n)) * (rng.random((n, n)) < 0.5)
        stay = 0 if discrete else np.diag(-rng.integers(0, 9, n))
        P = np.triu(P, 1) + np.eye(n) if rng.random() < 0.3 else P + stay
        members.append(similar(P.astype(int), seed))
    assert find_cone(members, discrete=discrete, restarts=1, time_limit=10).status is not Status.REFUTED


def test_numbers_at_the_ends_of_the_doubles():
    for size in (1e-310, 1e-300, 1e150):
        assert find_cone([size * UP, size * DOWN], restarts=0).status is not Status.PROVED
        assert find_cone([size * UP, size * DOWN], discrete=True, restarts=0).status is not Status.PROVED
    assert find_cone([0 * UP, 0 * UP])
    assert find_cone([metzler_hurwitz(np.random.default_rng(0), 3)] * 2)
