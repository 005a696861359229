"""I - W D is regular or not, exactly, in whatever units the ports are."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import lag

import control_kpos as kp
from control_kpos import checker
from control_kpos.exact.linalg import rank
from control_kpos.networks.well_posed import is_singular


def refused(nodes, W):
    try:
        kp.feedback_interconnect(nodes, W)
    except kp.DataError as error:
        return "not well posed" in str(error) and "nodes 0" in str(error)
    return False


@pytest.mark.parametrize("power", [1, 20, 60, 300])
def test_units_of_ports_do_not_matter(power):
    """A loop of two nodes, one of them with its output in units of 2^power."""
    unit = 2.0**power
    gains = [1.0, 0.5, 2.0, -1.0, 1 - 2.0**-52, 1 + 2.0**-51]
    assert [refused([lag(1.0, D=1.0)] * 2, [[0, g * unit], [1 / unit, 0]]) for g in gains] == [True, *[False] * 5]


def test_fractions_decide():
    third = kp.ConeStateSpace([[-1]], [[1]], [[1]], [["1/3"]])
    assert refused([third], [[3]]) and refused([third] * 2, [[0, 3], [3, 0]])
    assert not refused([lag(1.0, D=1 / 3)], [[3]])
    assert not refused([third] * 2, [[0, 3], [Fraction(3) + Fraction(1, 10**30), 0]])


@pytest.mark.parametrize("size", [5, 4000])
def test_rings_of_gain_one(size):
    rng, i = np.random.default_rng(0), np.arange(size)
    D = np.ones((size, 1, 1))
    nodes = kp.stack(-D, D, D, D)
    powers = 2.0 ** rng.integers(-3, 4, size)
    powers[0] /= powers.prod() if size < 10 else 2.0 ** np.log2(powers).sum()
    weights = [powers, rng.uniform(0.5, 2, size), np.ones(size) - 2.0**-50 * (i == 0)]
    found = [refused(nodes, sp.csr_array((w, (i, (i + 1) % size)), shape=(size, size))) for w in weights]
    assert found == [True, False, False]


def test_dense_and_sparse_matrices_have_the_rank_that_echelon_finds():
    rng = np.random.default_rng(2)
    seen = {True: 0, False: 0}
    for _ in range(150):
        n = int(rng.integers(1, 25))
        M = (rng.integers(-3, 4, (n, n)) * (rng.random((n, n)) < rng.uniform(0.05, 1))).astype(object)
        if n > 1 and rng.random() < 0.5:  # dependent, but not at sight
            M[-1] = rng.integers(-2, 3, n - 1).astype(object) @ M[:-1]
        rows = [{k: int(x) for k, x in enumerate(row) if x} for row in M]
        found = is_singular(rows)
        seen[found] += 1
        assert found is (rank(M) < n)
    assert min(seen.values()) > 20


def test_several_loops_are_told_apart():
    W = sp.block_diag([np.array([[0, 0.5], [1, 0]]), np.array([[0, 4.0], [0.25, 0]])], format="csr")
    with pytest.raises(kp.DataError, match="through nodes 2, 3"):
        kp.feedback_interconnect([lag(1.0, D=1.0)] * 4, W)


def with_gains(rng, count, discrete=False, bound=0.3):
    """Nodes of which some are constant gains, links between them, and the same network without these nodes."""
    static = rng.random(count) < 0.4
    static[0] = False
    moving = [-1.0 - rng.random() if not discrete else 0.4 * rng.random() for _ in range(count)]
    dt = 1 if discrete else 0
    systems = [
        kp.ConeStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[0.5]], dt)
        if still
        else kp.ConeStateSpace([[a]], [[1]], [[1]], 0, dt)
        for still, a in zip(static, moving, strict=True)
    ]
    W = np.where(rng.random((count, count)) < 3 / count, bound * rng.random((count, count)), 0)
    S = np.diag(np.where(static, 0.5, 0.0))
    closed = np.linalg.solve(np.eye(count) - W @ S, W)  # u = W y, y = S u + x
    A = np.diag(moving) + closed
    return systems, W, A[np.ix_(~static, ~static)], static


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_constant_gains_are_nodes_too(seed, discrete, tmp_path):
    systems, W, A, static = with_gains(np.random.default_rng(seed), 9, discrete)
    net = kp.feedback_interconnect(systems, W)
    assert net.nstates == len(A) and static.any()
    np.testing.assert_allclose(net.A, A, atol=1e-12)
    same = kp.linear_lyapunov(A, kp.orthant(len(A)), discrete=discrete)
    assert net.certificate.status is same.status is kp.Status.PROVED and net.certificate.check()
    net.certificate.save(tmp_path / "c.json")
    assert kp.load_certificate(tmp_path / "c.json") == net.certificate and checker.main(tmp_path / "c.json") == 0
    lower, upper = net.spectral_abscissa()
    truth = np.abs(np.linalg.eigvals(A)).max() if discrete else np.linalg.eigvals(A).real.max()
    assert lower - 1e-12 <= truth <= upper + 1e-12
    dense = net.to_ss()
    sys = kp.ConeStateSpace(dense.A, dense.B, dense.C, dense.D, dense.dt)
    assert net.gain() == pytest.approx(sys.gain(), rel=1e-9)
    w = np.ones(len(A))
    assert kp.order_interval(net, w).x_max == pytest.approx(kp.order_interval(sys, w).x_max, rel=1e-9)
    assert net.linear_lyapunov() and net.cone_positivity()


def test_constant_gains_in_a_large_network():
    systems, W, A, _ = with_gains(np.random.default_rng(3), 500)
    net = kp.feedback_interconnect(systems, W)
    assert net.certificate and net.certificate.check()
    lower, upper = net.spectral_abscissa()
    assert lower - 1e-9 <= np.linalg.eigvals(A).real.max() <= upper + 1e-9
    loud = kp.feedback_interconnect(systems, 5 * W)
    assert loud.certificate.status is kp.Status.REFUTED and loud.certificate.check()


def test_nothing_but_constant_gains():
    gain = kp.ConeStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[0.5]])
    net = kp.feedback_interconnect([gain, gain], [[0, 0.5], [0.5, 0]])
    assert net.certificate and net.gain() == pytest.approx(2 / 3) and not net.poles().size
    with pytest.raises(kp.UndecidedError):
        net.spectral_abscissa()
    with pytest.raises(kp.ShapeError, match="no states"):
        kp.order_interval(net, [])
    assert kp.feedback_interconnect([gain, gain], [[0, 3], [3, 0]]).certificate.status is kp.Status.REFUTED


def test_growth_in_numbers_beyond_doubles_is_refuted():
    """The exact combination has entries of some hundred digits; only its direction counts."""
    rng = np.random.default_rng(1025)
    count, discrete, bound = int(rng.integers(2, 40)), bool(rng.integers(2)), 0.3 * 10 ** rng.uniform(-1, 1.5)
    systems, W, A, _ = with_gains(rng, count, discrete, bound)
    b = kp.order_interval(kp.feedback_interconnect(systems, W), np.ones(len(A)))
    assert b.status is kp.Status.REFUTED and b.check()
