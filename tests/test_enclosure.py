"""Combinations of generators in floating point: every bound against the same numbers in fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from control_kpos.exact.enclosure import (
    Bounds,
    Generators,
    enclosed_product,
    enclosed_sparse_product,
)
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.products import exact_product

SEEDS = st.integers(0, 2**32 - 1)


def fractions(values) -> np.ndarray:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(values, dtype=object))


def spread(rng, shape, decades=6):
    """Numbers of either sign and very different size."""
    return rng.standard_normal(shape) * 10.0 ** rng.uniform(-decades, decades, shape)


def inverse(M):
    """Exact inverse of a small matrix of fractions, by Gauss and Jordan."""
    n = len(M)
    work = np.concatenate([M, fractions(np.eye(n, dtype=int).tolist())], axis=1)
    for k in range(n):
        pivot = next(i for i in range(k, n) if work[i, k] != 0)
        work[[k, pivot]] = work[[pivot, k]]
        work[k] = work[k] / work[k, k]
        for i in range(n):
            if i != k:
                work[i] = work[i] - work[k] * work[i, k]
    return work[:, n:]


def corrected(R, Y, T, Q):
    """Q + Y (I - D)^-1 (T - R Q) with D = I - R Y, exactly: it solves R Q* = T."""
    R, Y, T, Q = map(fractions, (R, Y, T, Q))
    out = Q + Y @ inverse(R @ Y) @ (T - R @ Q)
    assert (R @ out == T).all()
    return out


def assert_true(bounds, exact, required):
    """What is claimed of the corrected weights holds."""
    for i, j in zip(*np.nonzero(required), strict=True):
        claimed = bool(np.broadcast_to(bounds.exact, required.shape)[i, j])
        assert not claimed or exact[i, j] >= 0
        lower = float(bounds.lower[i, j])
        assert claimed or lower == -np.inf or np.isnan(lower) or exact[i, j] >= Fraction(lower)


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 130), st.booleans(), st.booleans())
def test_products_lie_within_their_bounds(seed, width, left_inexact, right_inexact):
    rng = np.random.default_rng(seed)
    a, b = spread(rng, (2, width)), spread(rng, (3, width))
    sign = rng.choice([-1, 1], (2, width))
    b = b * np.sign(b[[0]]) * np.sign(b) if width % 2 else b  # half of them without cancellation
    ra = np.abs(a) * rng.choice([0, 1e-16, 0.5, 1]) if left_inexact else None
    rb = np.abs(b) * rng.choice([0, 1e-16, 0.5, 1]) if right_inexact else None
    product, bound = enclosed_product(Matrix(a, ra), Matrix(b, rb))
    for s in (sign, np.sign(a)):
        left = fractions(a) if ra is None else fractions(a) + fractions(s * ra)
        right = fractions(b) if rb is None else fractions(b) + fractions(np.sign(b) * rb)
        error = np.abs(left @ right.T - fractions(product))
        assert (error <= fractions(bound)).all()
    size = np.abs(a) @ np.abs(b).T
    assert (bound >= (min(width, 64) + width / 64) * 2.0**-53 * size).all()  # what any order of additions may need
    small = size * (1e-13 + 2.2 * (left_inexact + right_inexact) + 1.1)
    assert (bound <= small + 1e-290).all()  # a bound that says nothing would pass as well


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 30), st.booleans())
def test_sparse_products_lie_within_their_bounds(seed, N, inexact):
    rng = np.random.default_rng(seed)
    R, P = spread(rng, (N, 3)), spread(rng, (N, 4)) * (rng.random((N, 4)) < 0.4)
    radius = np.abs(R) * rng.choice([1e-16, 0.5]) if inexact else None
    product, bound = enclosed_sparse_product(Matrix(R, radius).T, csr_array(P))
    for j in range(4):
        moved = fractions(R) if radius is None else fractions(R) + fractions(radius * np.sign(R * P[:, [j]]))
        error = np.abs(moved.T @ fractions(P[:, j]) - fractions(product[:, j]))
        assert (error <= fractions(bound[:, j])).all()
    size = np.abs(R).T @ np.abs(P)
    assert (bound >= np.count_nonzero(P, axis=0).max() * 2.0**-53 * size).all()
    assert (bound <= size * (1e-13 + 0.6 * inexact) + 1e-290).all()


def test_sparse_products_that_underflow():
    tiny = np.full((1, 1), 1.1e-200)
    product, bound = enclosed_sparse_product(Matrix(tiny), csr_array(tiny))
    assert abs(Fraction(1.1e-200) ** 2 - Fraction(product[0, 0])) <= Fraction(bound[0, 0])


def test_bounds_claim_what_is_above_zero_or_exact():
    def bounds(*lower, exact=False):
        return Bounds.of("b", np.array(lower), np.array([2.0, 0.0])[: len(lower)], np.array(exact))

    assert bounds(1.0).verdict() and bounds(1.0).margin == 0.5 and bounds(4.0).margin == 1.0
    for lower in (0.0, -1.0, -np.inf, np.nan):
        assert bounds(lower).verdict() is None and not bounds(lower).margin > 0
        assert bounds(lower, exact=[True]).verdict()
    assert bounds(1.0, 1.0).margin == 0.0  # nothing to judge the second by
    assert bounds(-1.0, exact=[True]).margin == 0.0
    assert bounds(1.0).relation == ">" and bounds(1.0).worst_violation() is None


def test_products_that_underflow_or_overflow_are_not_claimed():
    for width in (1, 3):
        tiny, huge = Matrix(np.full((1, width), 1e-200)), Matrix(np.full((1, width), 1e200))
        product, bound = enclosed_product(tiny, tiny)
        assert abs(Fraction(1e-200) ** 2 * width - Fraction(product[0, 0])) <= Fraction(bound[0, 0])
        assert not enclosed_product(huge, huge)[1][0, 0] < np.inf


@settings(max_examples=150, deadline=None)
@given(SEEDS, st.integers(1, 3), st.integers(0, 3), st.sampled_from([0.0, 1e-17, 1e-9, 1e-3, 0.3]), st.booleans())
def test_weights_are_at_least_what_is_claimed(seed, n, more, rough, radius):
    rng = np.random.default_rng(seed)
    N, count = n + more, 4
    R = rng.standard_normal((n, N)) * 2.0 ** rng.integers(-30, 30, (n, 1))
    Y = np.linalg.pinv(R) + rough * rng.standard_normal((N, n)) / np.abs(R).max(axis=1) / N
    Y[rng.random(N) < 0.2] = 0.0
    if np.linalg.matrix_rank(R @ Y) < n:
        return
    Q = np.abs(rng.standard_normal((N, count))) * 10.0 ** rng.uniform(-19, 0, (N, count))
    Q[rng.random((N, count)) < 0.2] *= -1
    Q[rng.random((N, count)) < 0.2] = 0.0
    T = R @ Q + rng.choice([0, 1e-16, 1e-12, 1e-6]) * np.abs(R).max(axis=1, keepdims=True) * rng.standard_normal(
        (n, count)
    )
    M, x = rng.standard_normal((n, 2)), rng.standard_normal((count, 2))
    rest = fractions(T) - fractions(M) @ fractions(x).T
    required = rng.random((N, count)) < 0.8
    rays = Matrix(R.T.copy())
    if radius:  # generators that doubles cannot hold
        rays = Matrix.from_fractions(fractions(R.T) + fractions(R.T) / 3**40)
    parts = [(Matrix(M), Matrix(x)), (Matrix.from_fractions(rest), Matrix(np.eye(count)))]
    bounds = Generators(rays, Y).combination("T = R Q", parts, Matrix(Q), required)
    assert_true(bounds, corrected(rays.fractions().T, Y, T, Q), required)
    if bounds.verdict():
        assert (corrected(rays.fractions().T, Y, T, Q)[required] >= 0).all()


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 4), st.sampled_from([0.0, 1e-17, 1e-3, 0.3]))
def test_the_defect_of_a_right_inverse_is_not_smaller_than_it_is(seed, n, rough):
    rng = np.random.default_rng(seed)
    R, units = rng.standard_normal((n, n + 2)), 10.0 ** rng.uniform(-9, 9, n)
    Y = (np.linalg.pinv(R) + rough * rng.standard_normal((n + 2, n)) / n) / units
    R = R * units[:, None]
    basis = Generators(Matrix(R.T.copy()), Y)
    units = fractions(np.diag(2.0 ** basis.exponent.astype(float)))
    exact = units @ (fractions(np.eye(n)) - fractions(R) @ fractions(Y)) @ inverse(units)
    defect = np.abs(exact).sum(axis=1)
    assert (fractions(basis.defect) >= defect).all() and (
        fractions(basis.defect) <= defect + (1 + defect) * Fraction(1e-12)
    ).all()
    assert bool(basis.solid().verdict()) == (max(basis.defect) < 1 - 2.0**-40)
    flat = R.copy()
    flat[-1] = flat[0]
    assert n == 1 or not Generators(Matrix(flat.T.copy()), np.linalg.pinv(flat)).solid().verdict()


@pytest.mark.parametrize("seed", range(20))
def test_sparse_weights_with_room_are_proven_and_exact_ones_without(seed):
    rng = np.random.default_rng(seed)
    P = rng.integers(0, 4, (7, 7)) * (rng.random((7, 7)) < 0.4) - 6.0 * np.eye(7)
    P[:4] += 0.25  # room where the corrections go
    R = np.concatenate([4 * np.eye(4), rng.integers(0, 5, (4, 3))], axis=1)
    Y = np.concatenate([0.25 * np.eye(4), np.zeros((3, 4))])
    A = (R @ P)[:, :4] / 4
    P[:4, 4:] = Y[:4] @ (A @ R[:, 4:] - R[:, 4:] @ P[4:, 4:])
    off = ~np.eye(7, dtype=bool)[:4, 4:]
    basis, rays = Generators(Matrix(R.T.copy()), Y), Matrix(R.T.copy())
    proven = basis.sparse_combination("A R = R P", (Matrix(A), rays), Matrix(csr_array(P)), diagonal=False)
    assert bool(proven.verdict()) == bool((P[:4, 4:][off] >= 0).all())
    thirds = Matrix.from_fractions(fractions(A) / 3)  # no longer exact
    P = P / 3 + 0.1 * (P > 0)
    P[:4] += Y[:4] @ (A / 3 @ R - R @ P)
    room = np.where(np.eye(7, dtype=bool)[:4], np.inf, P[:4]).min()
    proven = basis.sparse_combination("A R = R P", (thirds, rays), Matrix(csr_array(P)), diagonal=False)
    assert bool(proven.verdict()) == (room > 0) or abs(room) < 1e-12
    assert not proven.verdict() or abs(proven.margin * np.abs(P[:4]).sum(axis=0).max() - room) < room + 1e-9


def test_bits_that_units_push_below_the_smallest_doubles_are_accounted_for():
    rays = Matrix(np.array([[1e200, 1.0], [1.2345678901234567e-121, 1.0]]))
    basis = Generators(rays, np.linalg.inv(rays.values.T))
    scaled = fractions(rays.values.T) * fractions(np.ldexp(1.0, basis.exponent))[:, None]
    lost = np.abs(scaled - fractions(basis.columns.values))
    assert lost.max() > 0 and (lost <= fractions(basis.columns.radius)).all()
    known = Matrix(rays.values, np.array([[1e190, 0.0], [1e-130, 0.25]]))
    basis = Generators(known, np.linalg.inv(rays.values.T))
    scaled = fractions(known.radius.T) * fractions(np.ldexp(1.0, basis.exponent))[:, None]
    assert (scaled + lost <= fractions(basis.columns.radius)).all()


@pytest.mark.parametrize("seed", range(20))
def test_weights_with_room_are_proven_and_exact_ones_without(seed):
    rng = np.random.default_rng(seed)
    R = rng.integers(-5, 6, (3, 6)).astype(float)
    R[:, :3] += 9 * np.eye(3)
    Q = rng.integers(0, 4, (6, 5)).astype(float)  # with zeros: only exactness helps
    everywhere, eye = np.ones(Q.shape, dtype=bool), Matrix(np.eye(3))
    basis = Generators(Matrix(R.T.copy()), np.linalg.pinv(R))
    assert basis.solid().verdict()
    exact = basis.combination("T = R Q", [(eye, Matrix((R @ Q).T.copy()))], Matrix(Q), everywhere)
    assert exact.verdict() and exact.margin == 0
    rounded = Matrix((R @ (Q + 1) * (1 + 1e-15)).T.copy())
    assert basis.combination("T = R Q", [(eye, rounded)], Matrix(Q + 1), everywhere).verdict()
    wrong = Q.copy()
    wrong[2, 3] = -1e-30
    assert not basis.combination("T = R Q", [(eye, Matrix((R @ Q).T.copy()))], Matrix(wrong), everywhere).verdict()
    spared = everywhere.copy()
    spared[2, 3] = False
    target = exact_product(Matrix(wrong.T.copy()), Matrix(R))
    assert basis.combination("T = R Q", [(eye, target)], Matrix(wrong), spared).verdict()


def test_a_negative_weight_is_not_excused_by_a_zero_row():
    R, Y = np.array([[1.0, 0, 1], [0, 1, 1]]), np.array([[1.0, 0], [0, 1], [0, 0]])
    Q = np.array([[2.0], [2], [-1]])
    target = [(Matrix(np.eye(2)), Matrix((R @ Q).T.copy()))]
    basis = Generators(Matrix(R.T.copy()), Y)
    assert not basis.combination("T = R Q", target, Matrix(Q), np.ones((3, 1), dtype=bool)).verdict()
    assert basis.combination("T = R Q", target, Matrix(Q), np.array([[True], [True], [False]])).verdict()
    assert basis.combination("T = R Q", target, Matrix(np.abs(Q) - [[2], [2], [0]]), np.array([[True]] * 3)).verdict()


@settings(max_examples=150, deadline=None)
@given(
    SEEDS, st.integers(1, 3), st.integers(1, 4), st.sampled_from([0.0, 1e-17, 1e-9, 0.1]), st.booleans(), st.booleans()
)
def test_sparse_weights_are_at_least_what_is_claimed(seed, n, more, rough, diagonal, radius):
    rng = np.random.default_rng(seed)
    N = n + more
    R = rng.standard_normal((n, N)) * 2.0 ** rng.integers(-30, 30, (n, 1))
    support = np.sort(rng.permutation(N)[: n + int(rng.integers(0, more))])
    Y = np.zeros((N, n))
    Y[support] = (
        np.linalg.pinv(R[:, support]) + rough * rng.standard_normal((len(support), n)) / np.abs(R).max(axis=1) / N
    )
    P = np.abs(rng.standard_normal((N, N))) * (rng.random((N, N)) < 0.5)
    P[support] = np.abs(rng.standard_normal((len(support), N))) * 10.0 ** rng.uniform(-19, 0, (len(support), N))
    P[rng.random((N, N)) < 0.05] *= -1
    P[np.arange(N), np.arange(N)] = rng.standard_normal(N)
    if rng.random() < 0.5:  # A as P has it, up to rounding
        A = R @ P @ np.linalg.pinv(R)
    else:  # P as A has it
        A = rng.standard_normal((n, n))
        P[support] += Y[support] @ (A @ R - R @ P)
    P += rng.choice([0, 10.0 ** rng.uniform(-17, -3)]) * rng.standard_normal((N, N)) * (P != 0)
    rays = Matrix(R.T.copy())
    if radius:
        rays = Matrix.from_fractions(fractions(R.T) + fractions(R.T) / 3**40)
    basis = Generators(rays, Y)
    if not basis.solid().verdict():
        return
    bounds = basis.sparse_combination("A R = R P", (Matrix(A), rays), Matrix(csr_array(P)), diagonal=diagonal)
    T = fractions(A) @ rays.fractions().T
    exact = corrected(rays.fractions().T, Y, T, P)
    required = np.ones((N, N), dtype=bool) if diagonal else ~np.eye(N, dtype=bool)
    assert not bounds.verdict() or (exact[required] >= 0).all()
    outside = np.setdiff1d(np.arange(N), support)  # weights there stay what they are
    if not ((P < 0) & required)[outside].any():
        assert_true(bounds, exact[support], required[support])


def test_one_generator_of_support_does_not_excuse_the_others():
    rays, Y = Matrix(np.array([[1.0], [2.0]])), np.array([[1.0], [0.0]])
    for value in (-0.5, np.nan, np.inf):
        P = csr_array(np.array([[-1.0, 0.5], [value, -2.0]]))
        bounds = Generators(rays, Y).sparse_combination(
            "A R = R P", (Matrix(np.array([[-1.0]])), rays), Matrix(P), diagonal=False
        )
        assert not bounds.verdict()


@pytest.mark.parametrize("seed", range(30))
def test_weights_where_large_numbers_cancel(seed):
    rng = np.random.default_rng(seed)
    R, Y = rng.standard_normal((2, 3)), np.zeros((3, 2))
    Y[:2] = np.linalg.inv(R[:, :2])
    x = R[:, rng.integers(3)]
    A = rng.standard_normal((2, 2)) + 1e9 * np.outer(rng.standard_normal(2), [-x[1], x[0]])
    P = np.abs(rng.standard_normal((3, 3)))
    P[:2] += Y[:2] @ (A @ R - R @ P)
    rays, required = Matrix(R.T.copy()), ~np.eye(3, dtype=bool)
    basis, exact = Generators(rays, Y), corrected(R, Y, fractions(A) @ fractions(R), P)
    sparse = basis.sparse_combination("A R = R P", (Matrix(A), rays), Matrix(csr_array(P)), diagonal=False)
    assert_true(sparse, exact[:2], required[:2])
    dense = basis.combination("A R = R P", [(Matrix(A), rays)], Matrix(P), required)
    assert_true(dense, exact, required)
