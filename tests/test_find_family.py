"""Common cones of families, and cone and feedback together."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from planted import generators, metzler_hurwitz, similar
from scipy.linalg import block_diag

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import ConeMismatchError, DataError, ShapeError
from control_kpos.exact.linalg import solve_columns
from control_kpos.find import design_cone_and_feedback, find_cone


def planted(seed: int, n: int, count: int) -> np.ndarray:
    """Matrices that are Metzler and Hurwitz in the same hidden coordinates."""
    rng = np.random.default_rng(seed)
    T = generators(rng, n)
    return np.array([T @ metzler_hurwitz(rng, n) @ np.linalg.inv(T) for _ in range(count)])


@pytest.mark.parametrize(("n", "count"), [(2, 3), (3, 8), (4, 4), (5, 3)])
def test_planted_common_cones_are_found_and_proven(n, count):
    for seed in range(3):
        matrices = planted(seed, n, count)
        found = find_cone(matrices, time_limit=30)
        assert found and found.certificate.check() and found.cone.is_proper
        for A in matrices:
            assert kp.state_positivity(A, found.cone)
        mixed = np.tensordot(np.random.default_rng(seed).dirichlet(np.ones(count)), matrices, 1)
        assert kp.state_positivity(mixed, found.cone)  # the whole convex hull


def test_a_common_lyapunov_vector_proves_robust_stability():
    matrices = [[[-2, 1], [1, -2]], [[-1, 0.2], [0.1, -3]]]
    found = find_cone(matrices)
    assert found.v is not None
    assert (found.rays @ found.v > 0).all()
    for A in matrices:
        assert (found.rays @ np.transpose(A) @ found.v < 0).all()
    assert not replace(found.certificate, v=-found.v).check()


def test_discrete_time_family():
    found = find_cone([[[0.9, 0.1], [0.1, 0.5]], [[0.4, 0.1], [0.6, 0.3]]], discrete=True)
    assert found and found.v is not None and found.certificate.check()


def test_perron_filter_refutes_a_pair_and_a_cycle():
    pair = [np.array([[1.0, 0], [0, -1]]), np.array([[2.0, 3], [-1, -2]])]
    turned = [np.array([[1.0, 0], [0, -1]]), np.array([[-1.0, 4.0], [0, 1]]) @ np.diag([1, 1])]
    cycle = [[[1, 0], [0, -1]], [[-1, 3], [0.1, 2]], [[0, -2], [-1, 1]]]
    found = find_cone(cycle)
    assert found.status is kp.Status.REFUTED and found.certificate.check()
    assert len(found.obstruction.cycle) == 3 and "contradict" in found.explain()
    assert not replace(found.certificate, witness=replace(found.obstruction, cycle=(0, 1, 1))).check()
    for family in (pair, turned):
        answer = find_cone(family, time_limit=2)
        assert answer.certificate.check()


def test_an_impossible_member_is_named():
    found = find_cone([[[1, 2], [3, 4]], [[0, 1], [-1, 0]]])
    assert found.status is kp.Status.REFUTED and found.obstruction.matrix == 1
    assert "of matrix 1" in found.explain()


def test_a_search_is_never_fooled_by_the_whole_space():
    # Both matrices have cones, no common pointed one: rays that span the plane satisfy A R = R P.
    family = [
        np.array([[0.0, 1], [1, 0]]),
        np.array([[0.0, -1], [-1, 0]]),
        np.array([[1.0, 0], [0, -1]]),
        -np.array([[1.0, 0], [0, -1]]),
    ]
    found = find_cone(family, time_limit=3)
    assert not found
    assert found.cone is None


def test_time_limit_and_progress():
    rng = np.random.default_rng(1)
    family = [np.diag(-np.arange(7.0)) + 0.2 * rng.standard_normal((7, 7)) for _ in range(9)]
    said: list[str] = []
    start = time.monotonic()
    find_cone(family, time_limit=1.0, restarts=10**6, progress=said.append)
    assert time.monotonic() - start < 15
    assert said
    said.clear()
    find_cone(family, time_limit=0.1, progress=False)
    assert not said


def tight(seed: int, n: int, count: int) -> list[np.ndarray]:
    """Matrices with one cone in common and no room: every off-diagonal entry of P is 0 in one of them."""
    rng = np.random.default_rng(seed)
    while True:
        T = rng.integers(-2, 3, (n, n))
        if abs(np.linalg.det(T)) > 0.5:
            break
    T = np.array([[Fraction(int(x)) for x in row] for row in T], dtype=object)
    family = []
    for k in range(count):
        P = rng.integers(1, 6, (n, n)) * ((np.add.outer(np.arange(n), 2 * np.arange(n)) + k) % 3 > 0)
        P[np.diag_indices(n)] = -rng.integers(0, 3 * n, n)
        P = np.array([[Fraction(int(x)) for x in row] for row in P], dtype=object)
        family.append(solve_columns(T.T, (T @ P).T).T)
    return family


@pytest.mark.parametrize("n", [2, 3, 4])
def test_a_family_without_room_for_its_cone(n):
    matrices = tight(n, n, 6)
    found = find_cone(matrices, time_limit=30)
    assert found and found.n_rays == n and found.certificate.check()
    for A in matrices:
        assert kp.state_positivity(A, found.cone)


def shift(n, level, weights=None):
    """A linear chain: one eigenvalue, one eigenvector."""
    return level * np.eye(n, dtype=int) + np.diag(weights or [1] * (n - 1), 1)


def chains(n):
    """Families of chains with the orthant in common, in discrete time if no entry is negative."""
    mixed = np.random.default_rng(n).integers(0, 4, (n, n)) - 9 * np.eye(n, dtype=int)
    return {
        "up and down": [shift(n, -1), shift(n, -2, [2] * (n - 1)).T],
        "one way": [shift(n, -1), shift(n, -3, list(range(1, n)))],
        "one way, the other way round": [shift(n, -3, list(range(1, n))).T, shift(n, 2).T],
        "up and down, discrete": [shift(n, 1), shift(n, 1).T],
        "one way, discrete": [shift(n, 2), shift(n, 1, [3] * (n - 1))],
        "with others": [shift(n, -1), shift(n, 0).T, mixed, mixed.T],
    }


@pytest.mark.parametrize("name", chains(2))
@pytest.mark.parametrize("n", [2, 3, 5])
def test_families_of_linear_chains_have_the_orthant(name, n):
    family, discrete = chains(n)[name], "discrete" in name
    signs, order = np.diag((-1) ** np.arange(n)), np.random.default_rng(n).permutation(n)
    for members in (family, [signs @ A @ signs for A in family], [A[order][:, order] for A in family]):
        found = find_cone(members, discrete=discrete, restarts=0)
        assert found and found.cone.is_simplicial and found.check() and found.margin == 0
        assert all(kp.state_positivity(A, found.cone, discrete=discrete) for A in members)


@pytest.mark.parametrize("name", chains(2))
@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("seed", [1, 2])
def test_families_of_linear_chains_in_other_coordinates(name, n, seed, tmp_path):
    members = [similar(A, seed) for A in chains(n)[name]]  # the same coordinates for all
    found = find_cone(members, discrete="discrete" in name, restarts=0)
    assert found and found.cone.is_simplicial and found.check()
    assert all(kp.state_positivity(A, found.cone, discrete="discrete" in name) for A in members)
    found.save(tmp_path / "cone.json")
    assert kp.load_certificate(tmp_path / "cone.json") and checker.main(tmp_path / "cone.json") == 0


def test_families_of_chains_with_other_modes_behind():
    """Rays move from dominant directions, also where these are orthogonal to their functionals."""
    behind = np.array([[-3, -1], [1, -3]])
    found = find_cone([block_diag(shift(2, -1), behind), block_diag(shift(2, -2), behind - np.eye(2, dtype=int))])
    assert found and found.check()


def test_chains_that_turn_against_each_other_have_no_orthant():
    """The common invariant lines of [[0, 1], [0, 0]] and its opposite leave no pointed cone."""
    assert find_cone([[[0, 1], [0, 0]], [[0, -1], [0, 0]]], restarts=2).status is not kp.Status.PROVED
    assert find_cone([[[1, 1], [0, 1]], [[1, 0], [-1, 1]]], discrete=True, restarts=2).status is not kp.Status.PROVED


def test_rounded_data_leave_no_room_and_that_is_said():
    rng = np.random.default_rng(16)
    T = generators(rng, 3)
    P = rng.random((16, 3, 3)) * (rng.random((16, 3, 3)) > 0.4)
    P[:, range(3), range(3)] = -3 * rng.random((16, 3))
    found = find_cone(list(T @ P @ np.linalg.inv(T)), time_limit=2)
    assert found.status is kp.Status.UNDECIDED and "exact data" in found.explain()


def test_same_seed_same_cone():
    matrices = planted(4, 3, 5)
    assert np.array_equal(find_cone(matrices, seed=3).rays, find_cone(matrices, seed=3).rays)


def test_bad_families_are_named():
    with pytest.raises(ShapeError, match="empty family"):
        find_cone([])
    with pytest.raises(ShapeError, match=r"A\[1\] is 3 x 3, but A\[0\] is 2 x 2"):
        find_cone([np.eye(2), np.eye(3)])
    with pytest.raises(DataError, match=r"A\[1\]\[0, 1\] is nan"):
        find_cone([np.eye(2), [[1, np.nan], [0, 1]]])


# -- cone and feedback


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (3, 1), (4, 2), (6, 2), (8, 2)])
def test_every_controllable_pair_has_a_cone_and_a_gain(n, m):
    rng = np.random.default_rng(10 * n + m)
    for _ in range(3):
        A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
        design = design_cone_and_feedback((A, B))
        assert design and design.certificate.check() and design.cone.is_simplicial
        assert (np.linalg.eigvals(A + B @ design.F).real < 0).all()
        assert np.array_equal(design.K, -design.F)
        assert design.closed_loop.linear_lyapunov()


def test_named_plants():
    two_mass = ([[0, 0, 1, 0], [0, 0, 0, 1], [-1, 1, 0, 0], [1, -1, 0, 0]], [[0], [0], [1], [0]])
    pendulum = ([[0, 1, 0, 0], [0, 0, -0.981, 0], [0, 0, 0, 1], [0, 0, 21.582, 0]], [[0], [1], [0], [-2]])
    for plant in (([[0, 1], [-1, 0]], [[0], [1]]), two_mass, pendulum, ([[0, 1], [1, -0.3]], [[0], [1]])):
        assert design_cone_and_feedback(plant)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_poles_are_placed_where_they_are_wanted(n, discrete):
    rng = np.random.default_rng(n)
    plant = rng.standard_normal((n, n)), rng.standard_normal((n, 1 if n < 4 else 2))
    poles = 0.9 * 0.7 ** np.arange(n) if discrete else -np.arange(1.0, n + 1)
    design = design_cone_and_feedback(ct.ss(*plant, np.eye(n), 0, discrete), poles=poles)
    assert design and design.check() and design.cone.is_simplicial
    np.testing.assert_allclose(np.sort(design.poles.real), np.sort(poles), rtol=1e-6)
    assert kp.linear_lyapunov(plant[0] + plant[1] @ design.F, design.cone, discrete=discrete)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("rate", ["1/3", 0.75])
def test_a_rate_that_is_asked_for_is_proven(rate, discrete):
    plant = ct.ss([[0, 1], [0, 0.5]], [[0], [1]], np.eye(2), 0, discrete)
    design = design_cone_and_feedback(plant, rate=rate)
    assert design and design.certificate.decay_rate >= float(Fraction(rate))


def test_without_a_rate_the_loop_is_as_fast_as_the_plant():
    """Not 5e-6, as the smallest gain of a double integrator would leave."""
    for scale in (1, 100):
        design = design_cone_and_feedback(([[0, scale], [-scale, 0]], [[0], [1]]))
        assert design.certificate.decay_rate > scale / 10
    assert design_cone_and_feedback(([[0, 1], [0, 0]], [[0], [1]])).certificate.decay_rate >= 0.04


@pytest.mark.parametrize(
    ("poles", "error", "words"),
    [
        ([-1], ShapeError, "poles"),
        ([-1, -1], DataError, "distinct"),
        ([-1, 1], DataError, "negative"),
        ([-1, np.nan], DataError, "poles"),
        ([-1 + 1j, -1 - 1j], DataError, "poles"),
    ],
)
def test_poles_that_cannot_be_placed_are_refused(poles, error, words):
    with pytest.raises(error, match=words):
        design_cone_and_feedback(([[0, 1], [0, 0]], [[0], [1]]), poles=poles)


def test_poles_that_are_slower_than_the_rate_are_refused():
    with pytest.raises(DataError, match="rate asks for 1"):
        design_cone_and_feedback(([[0, 1], [0, 0]], [[0], [1]]), poles=[-0.5, -2], rate=1)
    assert design_cone_and_feedback(([[0, 1], [0, 0]], [[0], [1]]), poles=[-2, -3], rate=1)


def test_discrete_time_design():
    design = design_cone_and_feedback(ct.ss([[0, 1], [-1, 1.2]], [[0], [1]], np.eye(2), 0, 0.1))
    assert design and (np.abs(design.poles) < 1).all() and design.closed_loop.dt == 0.1


def test_robust_design_serves_every_vertex():
    A, B = np.array([[0.0, 1], [-1, 0]]), np.array([[0.0], [1]])
    vertices = [(A * (1 + s), B * (1 + r)) for s in (-0.05, 0.05) for r in (-0.05, 0.05)]
    design = design_cone_and_feedback((A, B), vertices=vertices)
    assert design
    for As, Bs in vertices:
        assert kp.linear_lyapunov(As + Bs @ design.F, design.cone)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("m", [1, 2])
def test_robust_designs_move_cone_and_gain_together(m, discrete):
    rng = np.random.default_rng(30 + m)
    A, B = rng.standard_normal((3, 3)), rng.standard_normal((3, m))
    corners = [
        (A * (1 + 0.05 * rng.choice([-1, 1], A.shape)), B * (1 + 0.05 * rng.choice([-1, 1], B.shape))) for _ in range(6)
    ]
    dt = True if discrete else 0
    plant = ct.ss(A, B, np.eye(3), 0, dt)
    design = design_cone_and_feedback(plant, vertices=corners, time_limit=30)
    assert design and design.certificate.check() and design.cone.is_simplicial
    for As, Bs in [(A, B), *corners]:
        assert kp.linear_lyapunov(As + Bs @ design.F, design.cone, discrete=discrete)


def test_a_system_outside_the_hull_of_its_vertices_is_served_too():
    B = np.array([[0.0], [1]])
    corners = [(np.array([[0.0, 1], [-k, 0]]), B) for k in (1.0, 1.1)]
    design = design_cone_and_feedback(([["0", "1"], ["-1/3", "0"]], [["0"], ["1"]]), vertices=corners)
    assert design and design.check() and len(design.certificate.loops) == 3
    exact = [[0, 1], [Fraction(-1, 3) + Fraction(design.F[0, 0]), Fraction(design.F[0, 1])]]
    assert (design.certificate.loops[0].A.fractions() == np.array(exact, dtype=object)).all()
    assert not design.closed_loop.exact.A.is_double


@pytest.mark.parametrize("turn", [1, 2, 5])
@pytest.mark.parametrize("routine", ["matrix_rank", "eigvals", "eig", "svd", "solve", "inv", "pinv", "cond", "qr"])
def test_decompositions_that_do_not_converge_leave_a_design_undecided(routine, turn, monkeypatch):
    A, B = np.array([[0.0, 1], [-1, 0]]), np.array([[0.0], [1]])
    original, turns = getattr(np.linalg, routine), itertools.count(1)

    def fails(*arguments, **more):
        if next(turns) >= turn:
            raise np.linalg.LinAlgError("injected")
        return original(*arguments, **more)

    monkeypatch.setattr(np.linalg, routine, fails)
    for vertices in (None, [(1.1 * A, B)]):
        design = design_cone_and_feedback((A, B), vertices=vertices, time_limit=2)
        assert design.status is kp.Status.UNDECIDED or design.check()


def test_progress_of_a_design():
    A, B = np.array([[0.0, 1], [-1, 0]]), np.array([[0.0], [1]])
    said: list[str] = []
    far = [(A, B), (-A, -B), (3 * A, -B)]  # no gain serves both signs of B
    assert not design_cone_and_feedback((A, B), vertices=far, time_limit=1, progress=said.append)
    assert any("margin" in line for line in said)
    design_cone_and_feedback((A, B), vertices=far, time_limit=0.5, progress=False)


def test_uncontrollable_and_bad_plants():
    design = design_cone_and_feedback((np.eye(2), [[1], [1]]))
    assert design.status is kp.Status.UNDECIDED and "not controllable: only 1 of 2" in design.explain()
    with pytest.raises(DataError, match="no inputs"):
        design_cone_and_feedback((np.eye(2), np.zeros((2, 0))))
    with pytest.raises(ConeMismatchError, match="B has 3 rows"):
        design_cone_and_feedback((np.eye(2), np.ones((3, 1))))
    with pytest.raises(ShapeError, match=r"vertices\[0\]"):
        design_cone_and_feedback((np.eye(2), np.eye(2)), vertices=[(np.eye(3), np.eye(3))])
