"""Importing, building a system, and Theorems 1 and 2, beside what people use today."""

import subprocess
import sys

import control as ct
import cvxpy as cp
import numpy as np
import pytest

import control_kpos as kp

IMPORT = "import in a new process"
BUILD = "build a system with 2 states"
STABLE = "prove stability, n = 500, simplicial cone"
POSITIVE = "decide positivity, n = 8, 60 rays"


# -- import


@pytest.mark.parametrize(("who", "module", "at_most"), [("ours", "control_kpos", None), ("control", "control", 1.15)])
def test_import(contest, who, module, at_most):
    contest(
        IMPORT, who, lambda: subprocess.run([sys.executable, "-c", f"import {module}"], check=True), at_most=at_most
    )


# -- construction


MATRICES = ([[-2.0, 1.0], [1.0, -2.0]], [[1.0], [0.0]], [[1.0, 0.0]], [[0.0]])


@pytest.mark.parametrize(("who", "build", "at_most"), [("ours", kp.ConeStateSpace, None), ("control.ss", ct.ss, 5)])
def test_construction(contest, who, build, at_most):
    contest(BUILD, who, lambda: [build(*MATRICES) for _ in range(200)], at_most=at_most)


# -- stability


@pytest.fixture(scope="module")
def plant():
    """A and the rays of a simplicial cone: A T = T M with M Metzler and Hurwitz, far from all boundaries."""

    def make(n):
        rng = np.random.default_rng(1)
        M = rng.uniform(0.5, 1.0, (n, n))
        np.fill_diagonal(M, 0)
        np.fill_diagonal(M, -M.sum(axis=1) - 1)
        T = np.eye(n) + 0.3 * rng.standard_normal((n, n)) / np.sqrt(n)
        return T @ M @ np.linalg.inv(T), T.T

    return make


def prove_stable(A, rays):
    certificate = kp.linear_lyapunov(A, kp.PolyhedralCone(rays))
    assert certificate
    return certificate


def solve_and_convert(A, rays):
    return np.linalg.solve(A.T, kp.PolyhedralCone(rays).facets.sum(axis=0))


def linear_program(A, rays):
    v = cp.Variable(A.shape[0])
    problem = cp.Problem(cp.Minimize(0), [rays @ v >= 1, (rays @ A.T) @ v <= -1])
    problem.solve()
    assert problem.status == cp.OPTIMAL


def solve_lyapunov(A, rays):
    return ct.lyap(A.T, np.eye(A.shape[0]))


@pytest.mark.parametrize(
    ("who", "method", "at_most"),
    [
        ("ours", prove_stable, None),
        ("solve and cone conversion", solve_and_convert, 3),
        ("control.lyap", solve_lyapunov, 1),
        ("linear program, cvxpy", linear_program, 1),
    ],
)
def test_stability(contest, plant, size, who, method, at_most):
    A, rays = plant(size(500, 20))
    contest(STABLE, who, lambda: method(A, rays), at_most=at_most, rounds=3)


# -- positivity


def test_positivity(contest, size):
    rng = np.random.default_rng(2)
    rays = np.column_stack([rng.standard_normal((size(60, 12), 7)), np.full(size(60, 12), 3.0)])
    inside, dual = rays.sum(axis=0), np.eye(8)[7]
    A = np.outer(inside, dual) / np.linalg.norm(inside) - 2 * np.eye(8)

    def decide():
        X = kp.PolyhedralCone(rays)
        return kp.cone_positivity(A, inside[:, None], dual[None, :], 0, X, kp.orthant(1), kp.orthant(1))

    assert contest(POSITIVE, "ours", decide, at_most=1.0, rounds=3)
