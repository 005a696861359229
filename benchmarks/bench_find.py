"""How often a cone is found, how small, how fast: families with fixed seeds, every success proven."""

import time
from fractions import Fraction

import control as ct
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.exact.linalg import solve_columns
from control_kpos.find import design_cone_and_feedback, find_cone


def dominant(rng, n, discrete=False):
    """A Ginibre matrix with a simple, strictly dominant, real eigenvalue, of eigenvector condition below 1e8."""
    while True:
        A = rng.standard_normal((n, n)) / np.sqrt(n)
        values, V = np.linalg.eig(A)
        size = np.abs(values) if discrete else values.real
        first = int(np.argmax(size))
        if values[first].imag == 0 and (values[first].real > 0 or not discrete) and np.linalg.cond(V) < 1e8:
            return A


def externally_positive(rng, n, margin):
    """(A, b, c) with min / max = margin of the impulse response relative to its dominant mode."""
    while True:
        A = rng.standard_normal((n, n)) / np.sqrt(n)
        values, V = np.linalg.eig(A)
        first = int(np.argmax(values.real))
        gap = np.sort(values.real[first] - values.real)[1]
        if values[first].imag != 0 or gap < 0.02:
            continue
        b, c = rng.standard_normal(n), rng.standard_normal(n)
        residues = (c @ V) * np.linalg.solve(V, b)
        rest = np.arange(n) != first
        t = np.linspace(0, 20 / gap, 6000)
        transient = (np.exp(np.outer(t, values[rest] - values[first])) * residues[rest]).sum(axis=1).real
        if transient.min() < 0:
            level = (margin * transient.max() - transient.min()) / (1 - margin)
            e, left = V[:, first].real, np.linalg.inv(V)[first].real
            b = b + e * (1 - left @ b)
            return A, b, c + left * (level - c @ e)


def planted(rng, n, count):
    """Matrices that are Metzler, with entries in [0, 1], in one hidden simplicial basis."""
    while True:
        T = rng.standard_normal((n, n))
        if np.linalg.cond(T) < 50:
            break
    P = rng.random((count, n, n)) * (1 - np.eye(n)) - np.eye(n) * (1.5 * n * rng.random((count, n, 1)))
    return T @ P @ np.linalg.inv(T)


def measure(benchmark, questions, ask):
    """Counts and times of `ask` over many questions, reported as extra_info."""
    times, good, rays = [], 0, []

    def run():
        nonlocal good
        for question in questions:
            start = time.perf_counter()
            found, ratio = ask(question)
            times.append(time.perf_counter() - start)
            good += bool(found)
            if found and ratio is not None:
                rays.append(ratio)

    benchmark.pedantic(run, rounds=1)
    info = {
        "proved": f"{good} of {len(times)}",
        "median seconds": round(float(np.median(times)), 4),
        "longest": round(max(times), 3),
    }
    if rays:
        info["median rays"] = round(float(np.median(rays)), 3)
    benchmark.extra_info.update(info)
    print(f"\n    {benchmark.name}: {info}")
    return good / len(times), float(np.median(times)), float(np.median(rays)) if rays else 0.0


@pytest.mark.parametrize("discrete", [False, True], ids=["continuous", "discrete"])
@pytest.mark.parametrize("n", [2, 3, 5, 8, 12, 15, 20, 25, 30])
def test_one_matrix(benchmark, size, n, discrete):
    rng = np.random.default_rng(100 + n)
    matrices = [dominant(rng, n, discrete) for _ in range(size(50, 2))]

    def ask(A):
        found = find_cone(A, discrete=discrete)
        return found, found.n_rays / found.fewest_rays

    rate, _, _ = measure(benchmark, matrices, ask)
    assert rate == 1


def ill_conditioned(rng, n, conditioning):
    """Eigenvalue 1, the others at least 0.02 to 0.5 to the left of it, eigenvectors of the given condition number."""
    left, right = (np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(2))
    sizes = np.geomspace(1, 1 / conditioning, n)
    if rng.random() < 0.5:
        sizes = np.where(np.arange(n) < n - 1, 1, 1 / conditioning)
    V = left * sizes @ right
    gap = rng.choice([0.02, 0.1, 0.5])
    modes = np.diag(np.concatenate([[1.0], 1 - gap - rng.random(n - 1)]))
    for k in range(1, n - 1, 4):
        turn = rng.random()
        modes[k : k + 2, k : k + 2] = [[modes[k, k], -turn], [turn, modes[k, k]]]
    return V @ modes @ np.linalg.inv(V)


@pytest.mark.parametrize("conditioning", [1e5, 1e6, 1e7, 9e7])
@pytest.mark.parametrize("n", [5, 12, 20, 30])
def test_ill_conditioned_eigenvectors(benchmark, size, n, conditioning):
    rng = np.random.default_rng(600 + n)
    matrices = [ill_conditioned(rng, n, conditioning) for _ in range(size(20, 2))]

    def ask(A):
        found = find_cone(A)
        return found, found.n_rays / found.fewest_rays

    rate, median, _ = measure(benchmark, matrices, ask)
    assert rate == 1 and median < 0.3


@pytest.mark.parametrize("margin", [1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize("n", [3, 6, 9, 12])
def test_with_inputs_and_outputs(benchmark, size, n, margin):
    rng = np.random.default_rng(200 + n)
    systems = [externally_positive(rng, n, margin) for _ in range(size(30, 2))]

    def ask(system):
        A, b, c = system
        found = find_cone(ct.ss(A, b[:, None], c[None, :], 0))
        return found, found.n_rays

    rate, _, _ = measure(benchmark, systems, ask)
    assert rate == 1


@pytest.mark.parametrize(("n", "count"), [(3, 2), (3, 16), (5, 4), (5, 16), (8, 2), (8, 16)])
def test_planted_families(benchmark, size, n, count):
    rng = np.random.default_rng(300 + n + count)
    families = [planted(rng, n, count) for _ in range(size(10, 1))]

    def ask(family):
        found = find_cone(family, time_limit=10)
        assert not found or kp.PolyhedralCone(found.rays).is_proper
        return found, found.n_rays / n if found else None

    rate, _, _ = measure(benchmark, families, ask)
    assert rate >= size(0.9, 0)


def without_room(rng, n, count):
    """Exact matrices that are Metzler in one hidden basis, three in ten of the off-diagonal entries being zero."""
    while True:
        T = rng.integers(-3, 4, (n, n))
        if abs(np.linalg.det(T)) > 0.5 and np.linalg.cond(T) < 50:
            break
    T = np.array([[Fraction(int(x)) for x in row] for row in T], dtype=object)
    family = []
    for _ in range(count):
        P = rng.integers(1, 6, (n, n)) * (rng.random((n, n)) > 0.3)
        P[np.diag_indices(n)] = -rng.integers(0, 2 * n, n)
        P = np.array([[Fraction(int(x)) for x in row] for row in P], dtype=object)
        family.append(solve_columns(T.T, (T @ P).T).T)
    return family


@pytest.mark.parametrize(("n", "count"), [(3, 4), (3, 16), (5, 4), (5, 16), (8, 4), (8, 16)])
def test_planted_families_without_room(benchmark, size, n, count):
    rng = np.random.default_rng(700 + n + count)
    families = [without_room(rng, n, count) for _ in range(size(10, 1))]
    rate, _, _ = measure(benchmark, families, lambda family: (find_cone(family, time_limit=10), None))
    assert rate >= size(0.6, 0)


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 1), (4, 2), (6, 2), (8, 1), (8, 2)])
def test_cone_and_feedback(benchmark, size, n, m):
    rng = np.random.default_rng(400 + 10 * n + m)
    plants = [(rng.standard_normal((n, n)), rng.standard_normal((n, m))) for _ in range(size(20, 2))]
    rate, _, _ = measure(benchmark, plants, lambda plant: (design_cone_and_feedback(plant), None))
    assert rate == 1


@pytest.mark.parametrize("m", [1, 2])
def test_robust_cone_and_feedback(benchmark, size, m):
    rng = np.random.default_rng(500 + m)
    plants = []
    for _ in range(size(20, 1)):
        A, B = rng.standard_normal((4, 4)), rng.standard_normal((4, m))
        corners = [
            (A * (1 + 0.05 * rng.choice([-1, 1], A.shape)), B * (1 + 0.05 * rng.choice([-1, 1], B.shape)))
            for _ in range(6)
        ]
        plants.append(((A, B), corners))
    rate, _, _ = measure(
        benchmark, plants, lambda p: (design_cone_and_feedback(p[0], vertices=p[1], time_limit=20), None)
    )
    assert rate >= size(0.4, 0)


@pytest.mark.parametrize("factors", [4, 5, 8, 16])
def test_products_in_one_list(benchmark, size, factors):
    """Facets of a product of pentagons in coordinates of its own, R^12 to R^48."""
    rng, turn = np.random.default_rng(600), 2 * np.pi * np.arange(5) / 5
    pentagon = np.round(10 * np.column_stack([np.cos(turn), np.sin(turn), np.ones(5)]))
    n = 3 * factors
    flat = [np.kron(np.eye(factors), pentagon) @ rng.integers(-2, 3, (n, n)) for _ in range(size(5, 1))]
    rate, _, _ = measure(benchmark, flat, lambda rays: (kp.PolyhedralCone(rays).n_facets == 5 * factors, None))
    assert rate == 1
