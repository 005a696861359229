"""The margin of stability, a unit in the last place beside it, and brackets of the abscissa: decided at any size."""

from dataclasses import replace
from fractions import Fraction

import flint
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.exact.linalg import solve_exactly
from control_kpos.exact.sparse_integers import SparseIntegers
from control_kpos.networks import NetworkInstability
from control_kpos.proof import independent
from control_kpos.proof.certificate import Status
from control_kpos.proof.files import read_content
from control_kpos.theorems.perron_pair import decide
from control_kpos.theorems.refinement import Refined, frames, rational_multiple

PAPER = kp.PolyhedralCone([[0, 1], [1, -2]])
BESIDE = ((np.nextafter(22.0, 0), Status.PROVED), (22.0, Status.REFUTED), (np.nextafter(22.0, 23), Status.REFUTED))


def masses(n):
    return kp.stack(np.tile([[0, 1], [-22.0, -13]], (n, 1, 1)), [[0], [1]], [[1, 0]], X=PAPER)


def is_stable(M):
    """M-matrix test in fractions: a Metzler M is stable if and only if M z = -1 has a solution z > 0."""
    z = solve_exactly(M, -np.ones((len(M), 1), dtype=int).astype(object))
    return z is not None and bool((z[0] > 0).all())


def laplacian(n, seed, low=0.1):
    """A random 3-regular Metzler matrix whose row sums are the rounding of its diagonal."""
    W = sp.csr_array(kp.examples.random_regular(n, 3, seed=seed))
    W.data = np.random.default_rng(seed).uniform(low, 1, W.nnz)
    return W, np.asarray(W.sum(axis=1)).ravel()


def row_sums(M):
    return [sum(map(Fraction, M[[i]].data.tolist())) for i in range(M.shape[0])]


# -- sizes


@pytest.mark.parametrize("n", [3, 200, 2000])
def test_rings_a_unit_in_the_last_place_beside_the_margin(n):
    for weight, status in BESIDE:
        certificate = kp.feedback_interconnect(masses(n), weight * kp.examples.ring(n)).certificate
        assert certificate.status is status
        if n <= 200:
            assert certificate.check() and certificate.margin <= 1e-15


@pytest.mark.parametrize(("n", "seed"), [(60, 0), (60, 1), (60, 2), (82, 3), (200, 4), (200, 5), (1000, 6)])
def test_regular_graphs_whose_margin_is_the_rounding_of_the_diagonal(n, seed):
    W, d = laplacian(n, seed)
    M = sp.csr_array(W - sp.diags_array(d))
    dense = kp.linear_lyapunov(M, kp.orthant(n))
    lags = kp.stack(-d.reshape(n, 1, 1), np.ones((n, 1, 1)), np.ones((n, 1, 1)))
    network = kp.feedback_interconnect(lags, W).certificate
    assert dense.status is network.status is not Status.UNDECIDED
    assert dense.check() and network.check()
    slower = kp.linear_lyapunov(sp.csr_array(W - sp.diags_array(d * (1 + 2.0**-48))), kp.orthant(n))
    faster = kp.linear_lyapunov(sp.csr_array(W - sp.diags_array(d * (1 - 2.0**-48))), kp.orthant(n))
    assert slower.status is Status.PROVED and faster.status is Status.REFUTED
    if max(row_sums(M)) < 0:
        assert dense.status is Status.PROVED
    if min(row_sums(M)) >= 0:
        assert dense.status is Status.REFUTED


@pytest.mark.parametrize("link", [1e-6, 1e-10, 1e-13, 1e-25])
def test_clusters_with_weak_links(link):
    rng = np.random.default_rng(5)
    inside = np.kron(np.eye(2), rng.integers(1, 9, (6, 6)).astype(float))
    M = inside.copy()
    M[0, 6] = M[6, 0] = link
    exact = np.array([[Fraction(value) for value in row] for row in M], dtype=object)
    np.fill_diagonal(exact, 0)
    d = exact.sum(axis=1)
    for shift, status in ((-1, Status.PROVED), (0, Status.REFUTED), (1, Status.REFUTED)):
        A = exact - np.diag(d - shift * Fraction(1, 10**40))
        certificate = kp.linear_lyapunov(A, kp.orthant(12))
        assert certificate.status is status and certificate.check()


@pytest.mark.parametrize("power", [-400, 0, 400])
@pytest.mark.parametrize("discrete", [False, True])
def test_units_and_discrete_time(power, discrete):
    if discrete and power:
        power //= 40  # A - I has one unit of time
    W, d = laplacian(40, 7)
    units = np.ldexp(1.0, np.random.default_rng(7).integers(-300, 300, 40))
    for change, status in ((1 + 2.0**-48, Status.PROVED), (1 - 2.0**-48, Status.REFUTED)):
        S = (W.toarray() - np.diag(d * change)) * 2.0**-8
        if discrete:
            A = np.array([[Fraction(value) for value in row] for row in S], dtype=object) + np.eye(40, dtype=int)
        else:
            A = np.ldexp(S, power) / units[:, None] * units
        certificate = kp.linear_lyapunov(A, kp.orthant(40), discrete=discrete)
        assert certificate.status is status and certificate.check()


def test_reducible_matrices():
    W, d = laplacian(24, 8)
    stable, marginal = (W.toarray() - np.diag(d * (1 + 2.0**-50))), np.array([[-1.0, 1.0], [1.0, -1.0]])
    link = np.zeros((24, 2))
    link[3, 1] = 1e6
    zero = np.zeros((2, 24))
    for last, status in ((marginal, Status.REFUTED), (marginal - 2.0**-50 * np.eye(2), Status.PROVED)):
        for M in (np.block([[stable, link], [zero, last]]), np.block([[last, zero], [link, stable]])):
            certificate = kp.linear_lyapunov(M, kp.orthant(26))
            assert certificate.status is status and certificate.check()


def test_simplicial_cones_and_cones_that_are_not():
    rng = np.random.default_rng(9)
    R = np.eye(6) + np.tril(rng.integers(0, 3, (6, 6)), -1)
    inverse = np.rint(np.linalg.inv(R))
    W = rng.integers(1, 9, (6, 6)) * 1.0
    np.fill_diagonal(W, 0)
    for step, status in ((-(2.0**-40), Status.PROVED), (0.0, Status.REFUTED), (2.0**-40, Status.REFUTED)):
        M = W - np.diag(W.sum(axis=1) - step)
        certificate = kp.linear_lyapunov(R @ M @ inverse, kp.PolyhedralCone(R.T))
        assert certificate.status is status and certificate.check()
        square = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
        A = np.diag([-2.0, -1.0, step])
        assert kp.linear_lyapunov(A, square).status is status


# -- agreement with fractions


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_decisions_are_those_of_fractions(seed):
    rng = np.random.default_rng(seed)
    n, longest = int(rng.integers(1, 9)), int(rng.choice([1, 4, 60]))

    def numbers(most, *shape):
        wide = rng.integers(0, longest, shape).astype(object)
        return rng.integers(1, most, shape).astype(object) << wide

    x = numbers(20, n)
    M = (numbers(50, n, n) * (rng.random((n, n)) < rng.uniform(0.1, 1)).astype(int).astype(object)) * x[:, None]
    np.fill_diagonal(M, 0)
    M[np.arange(n), np.arange(n)] = -(M @ x) // x
    M = M << int(rng.choice([0, 40, 400]))
    i = int(rng.integers(n))
    M[i, i] += int(rng.integers(-1, 2))
    N = SparseIntegers.dense(M) + SparseIntegers.diagonal(np.zeros(n, dtype=object))
    found = decide(N)
    assert found is not None and found.stable is is_stable(M)
    if found.stable:
        assert (found.vector > 0).all() and (found.vector @ M < 0).all()
    else:
        assert (found.vector >= 0).all() and found.vector.any() and (M @ found.vector >= 0).all()


@pytest.mark.parametrize("n", [60, 1500])
@pytest.mark.parametrize("above", [-1, 0, 1])
def test_both_vectors_in_floating_point_tell_the_side_before_integers_do(n, above):
    rng, W = np.random.default_rng(n), sp.csr_array(kp.examples.random_regular(n, 3, seed=1)).tocoo()
    x = rng.integers(1, 20, n).astype(object)
    data = rng.integers(2**49, 2**50, W.nnz).astype(object) * x[W.row]
    W = SparseIntegers.of(W.row, W.col, data, (n, n))
    N = W + SparseIntegers.diagonal(-(W.apply(x) // x) + above)  # N x = above x
    right, left = (Refined(*side) for side in frames(N))
    y = right.frame.between(left.frame) * left.solver.nearly[:-1]
    first = next(iter(right))
    assert first.leaning(y) in {0, -above} and next(step for step in right if step.P > 90).leaning(y) == -above
    assert next(iter(right)) is first
    np.testing.assert_array_equal(N.T.toarray(), N.toarray().T)


@pytest.mark.parametrize("length", [20, 60, 150])
def test_ratios_are_recovered_and_others_refused(length):
    rng = np.random.default_rng(length)
    parts = rng.integers(1, 30, 12).tolist()
    X = np.array([(k << length) // 29 for k in parts], dtype=object)
    found = rational_multiple(X, 3)
    assert [a * found[0] for a in parts] == [parts[0] * int(b) for b in found]
    noise = np.array([int(v) for v in rng.integers(2**40, 2**41, 12)], dtype=object)
    assert rational_multiple(noise, 3) is None


# -- certificates and files


def test_vectors_are_short_and_files_are_confirmed(tmp_path):
    n = 40
    for weight, status in BESIDE:
        certificate = kp.feedback_interconnect(masses(n), weight * kp.examples.ring(n)).certificate
        assert certificate.status is status
        vectors = certificate.exact if certificate else certificate.witness.exact
        for part in vectors or ():
            assert max(value.numerator.bit_length() + value.denominator.bit_length() for value in part) < 400
        certificate.save(tmp_path / "ring.json")
        assert (tmp_path / "ring.json").stat().st_size < 3000 * n
        again = kp.load_certificate(tmp_path / "ring.json")
        assert again.status is status and again.check()
        assert independent.verdict(read_content(tmp_path / "ring.json")).status == status.name


def test_a_changed_vector_does_not_pass():
    W = np.array([[Fraction(value) for value in row] for row in laplacian(30, 1)[0].toarray()], dtype=object)
    good = kp.linear_lyapunov(W - np.diag(W.sum(axis=1) + Fraction(1, 10**40)), kp.orthant(30))
    assert good.status is Status.PROVED and good.v_exact is not None and good.check()
    tilted = (good.v_exact[0] * (1 + Fraction(1, 10**6)), *good.v_exact[1:])
    v = np.array([float(value) for value in tilted])
    assert not replace(good, v=v, v_exact=tilted).check()
    assert not replace(good, v_exact=None).check()
    bad = kp.feedback_interconnect(masses(20), np.nextafter(22.0, 23) * kp.examples.ring(20)).certificate
    assert isinstance(bad.witness, NetworkInstability)
    x = bad.witness.x.copy()
    x[0] *= 1 + 1e-6
    assert not replace(bad, witness=replace(bad.witness, x=x, exact=None)).check()


# -- brackets of the abscissa


def rightmost(M):
    """The rightmost eigenvalue as a ball of more than 50 digits."""
    flint.ctx.prec = 400
    try:
        values = flint.acb_mat([[flint.fmpq(*Fraction(v).as_integer_ratio()) for v in row] for row in M]).eig()
        return max((value.real for value in values), key=float)
    finally:
        flint.ctx.prec = 53


def between(lower, value, upper):
    flint.ctx.prec = 400
    try:
        return bool(flint.arb(lower) <= value) and bool(value <= flint.arb(upper))
    finally:
        flint.ctx.prec = 53


def single_states(a, W):
    n = len(a)
    nodes = kp.stack(np.reshape(a, (n, 1, 1)), np.ones((n, 1, 1)), np.ones((n, 1, 1)))
    return kp.feedback_interconnect(nodes, W)


@pytest.mark.parametrize("n", [5, 20, 40])
def test_brackets_of_chains_that_are_far_from_normal(n):
    a = -np.random.default_rng(n).uniform(0.5, 5, n)
    W = np.diag(np.full(n - 1, 10.0), -1) + np.diag(np.full(n - 1, 0.01), 1)
    certificate = single_states(a, W).abscissa_certificate()
    assert certificate.status is Status.PROVED and certificate.check()
    truth = np.linalg.eigvalsh(np.diag(a) + np.sqrt(0.1) * (np.eye(n, k=1) + np.eye(n, k=-1))).max()
    assert certificate.lower - 1e-12 <= truth <= certificate.upper + 1e-12
    assert certificate.upper - certificate.lower < 1e-6 * abs(truth)
    if n <= 20:
        assert between(certificate.lower, rightmost(W + np.diag(a)), certificate.upper)


def test_brackets_of_long_chains():
    n = 400
    a = -np.random.default_rng(0).uniform(0.5, 5, n)
    W = sp.diags_array([np.full(n - 1, 10.0), np.full(n - 1, 0.01)], offsets=[-1, 1], format="csr")
    lower, upper = single_states(a, W).spectral_abscissa()
    assert lower - 1e-12 <= -0.26330972436261657 <= upper + 1e-12 and upper - lower < 1e-6


@pytest.mark.parametrize("slack", [0.0, 1e-3, 1e-9, 1e-14])
def test_brackets_next_to_zero(slack):
    W, d = laplacian(24, 3)
    M = W.toarray() - np.diag(d + slack)
    certificate = single_states(-(d + slack), W).abscissa_certificate()
    assert certificate.status is Status.PROVED and certificate.check()
    assert between(certificate.lower, rightmost(M), certificate.upper)
    size = max(abs(certificate.upper), 2.0**-40 * np.abs(M).max())
    assert certificate.upper - certificate.lower <= 2e-6 * size
