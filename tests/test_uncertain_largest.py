"""How far uncertainty may grow: against eigenvalues, in exact numbers, with what is refuted at the other end."""

import pickle
from fractions import Fraction

import numpy as np
import pytest
from network_examples import lag, sparse_ring

import control_kpos as kp
from control_kpos.errors import DataError

SLOW, FAST = np.array([[[-2.0]], [[-3.0]]]), np.array([[[-4.0]], [[-2.5]]])


def loop(low, high, back=None):
    weight = kp.interval(low, high)
    return kp.feedback_interconnect([lag(1), lag(1)], [[0, weight], [weight if back is None else back, 0]])


def bound_of(middle, half, t):
    """The largest absolute values at the factor t."""
    return np.maximum(np.abs(middle + t * half), np.abs(middle - t * half))


@pytest.mark.parametrize("seed", range(12))
def test_ranges_grow_until_their_bounds_are_unstable(seed):
    """The factor at which A + B W C with all bounds has the eigenvalue 0 lies in the bracket, 1e-6 wide."""
    rng = np.random.default_rng(seed)
    N = 4
    A, B, C = (
        rng.uniform(0, 0.3, (N, 2, 2)) - 2 * np.eye(2),
        rng.uniform(0.2, 1, (N, 2, 1)),
        rng.uniform(0, 1, (N, 1, 2)),
    )
    W, half = rng.uniform(0.1, 0.4, (N, N)), rng.uniform(0, 0.05, (N, N))
    slack = 0.02 * np.eye(2)
    net = kp.feedback_interconnect(kp.stack(kp.interval(A - slack, A + slack), B, C), kp.interval(W - half, W + half))
    lower, upper = found = kp.largest_uncertainty(net)
    assert 0 < lower < upper <= lower * (1 + 1e-6) and found.check() and found.certificate and found.scope != ""

    def abscissa(t):
        parts = [np.zeros((2 * N, N)), np.zeros((N, 2 * N)), np.zeros((2 * N, 2 * N))]
        for j in range(N):
            at = slice(2 * j, 2 * j + 2)
            parts[0][at, j], parts[1][j, at], parts[2][at, at] = B[j, :, 0], C[j, 0], A[j] + t * slack
        return np.linalg.eigvals(parts[2] + parts[0] @ bound_of(W, half, t) @ parts[1]).real.max()

    assert abscissa(lower * (1 - 1e-9)) < 0 < abscissa(upper * (1 + 1e-9))


@pytest.mark.parametrize(
    ("net", "factor", "scope"),
    [
        (loop("0.4", "0.6"), 5.0, "network"),
        (loop("1/3", "1/2", 1), 7.0, "network"),
        (loop(-0.4, 0.6), 1.8, "network"),
        (loop(-2, 1.9, 1), None, None),
        (kp.feedback_interconnect(kp.stack([SLOW, FAST], [[1]], [[1]]), [[0, 1], [2, 0]]), 4.0, "network"),
        (kp.feedback_interconnect([[lag(1), lag(2, 0.25)], lag(1)], [[0, 1], [0.5, 0]]), None, None),
    ],
)
def test_factors_are_those_of_pencil_and_paper(net, factor, scope):
    lower, upper = found = kp.largest_uncertainty(net)
    assert found.check() and lower <= upper
    if scope is not None:
        assert lower <= factor * (1 + 1e-12) and upper >= factor * (1 - 1e-12) and found.scope == scope
        assert upper - lower <= 1e-6 * upper and "Proved up to the factor" in found.explain()


def test_vertices_that_leave_their_cones_end_the_growth():
    """B = (1 - t, t): positive up to t = 1."""
    nodes = kp.stack([[[-2, 0], [0, -2]]], [[[[1], [0]]], [[[0], [1]]]], [[1, 1]])
    found = kp.largest_uncertainty(kp.feedback_interconnect(nodes, [[0.5]]))
    assert found.lower == 1 < found.upper < 1 + 1e-6 and found.scope == "positivity"
    assert "which says nothing of stability" in found.explain()


def test_common_vectors_may_end_before_stability():
    """p' = -p + b1 u1, q' = -q + b2 u2, u = (q, p): each vertex is stable, a mixture is not."""
    B = [[[[1, 0], [0, 1]]], [[[2, 0], [0, 1]]], [[[1, 0], [0, 2]]]]
    net = kp.feedback_interconnect(kp.stack([[[-1, 0], [0, -1]]], B, 0.5 * np.eye(2)), [[0, 1], [1, 0]])
    found = kp.largest_uncertainty(net)
    # (1 + t)^2 / 4 = 1 for the mixture, (1 + t) / 4 = 1 for each vertex
    assert found.lower <= 1 <= found.upper and found.scope == "common vectors"
    assert "no v and no e exist for all choices" in found.explain()


def test_bounds_may_end_before_what_is_in_the_ranges():
    """A ring of three with links around 0 has no signs that make all of them large: only its bounds are refuted."""
    W = np.roll(np.eye(3), 1, axis=0)
    found = kp.largest_uncertainty(kp.feedback_interconnect([lag(1)] * 3, kp.interval(-0.5 * W, 0.4 * W)))
    assert found.lower <= 0.95 / 0.45 <= found.upper and found.scope == "bounds" and found.check()
    assert "which says nothing of what is in the ranges" in found.explain()


def test_what_is_unstable_from_the_start_and_what_never_is():
    found = kp.largest_uncertainty(loop(2, 3, 1))
    assert tuple(found) == (0, 0) and found.certificate is None and found.scope == "network" and found.check()
    assert "Nothing is proven" in found.explain()
    free = kp.feedback_interconnect([lag(1), lag(1)], [[0, kp.interval(0, 1)], [0, 0]])
    found = kp.largest_uncertainty(free)
    assert found.lower > 1e15 and found.upper == np.inf and found.refutation is None and found.check()
    assert "nothing is refuted" in found.explain()


def test_negative_feedback_inside_nodes_is_closed_first():
    """x' = -x - x / 2 + u, or less, in a loop of gain (1 + t) / 2 * 2 / 3: stable below t = 2."""
    W = [[-0.5, kp.interval(0, 1)], [1, 0]]
    found = kp.largest_uncertainty(kp.feedback_interconnect([[lag(1), lag(2)], lag(1)], W))
    assert found.scope == "network" and found.check() and found.certificate.check()
    assert found.lower <= 2 <= found.upper


def test_own_links_between_vertices_of_inputs_and_outputs_are_closed_at_pairs():
    """What is proven at the factor 1 is found: the link itself, which leaves the cones at all factors, is no reason."""
    B, C = (
        [np.array([part]) for part in parts] for parts in ([[[1], [0.2]], [[1.1], [0.3]]], [[[0.2, 1]], [[0.3, 1.1]]])
    )
    net = kp.feedback_interconnect(kp.stack([[[-3, 1], [1, -3]]], B, C), [[-0.2]])
    found = kp.largest_uncertainty(net)
    assert net.certificate and found.lower > 1 and found.certificate.check()
    assert found.upper == np.inf and not found.scope and "nothing is refuted" in found.explain()


def test_what_is_not_positive_without_uncertainty_is_refuted_at_zero():
    nodes = kp.stack([[[-2, 0], [0, -2]]], [[[[-1], [0]]], [[[0], [1]]]], [[1, 1]])
    found = kp.largest_uncertainty(kp.feedback_interconnect(nodes, [[0.5]]))
    assert found == (0, 0) and found.scope == "positivity" and found.certificate is None


def test_it_is_a_pair_that_can_be_sent():
    found = kp.largest_uncertainty(loop("0.4", "0.6"))
    copy = pickle.loads(pickle.dumps(found))
    assert copy == found == (found.lower, found.upper) and copy.scope == found.scope and copy.check()
    assert found.certificate.model.coupling.fractions()[0, 1] == (1 + Fraction(found.lower) / 5) / 2


def test_large_networks_are_bracketed():
    """2 000 nodes with links in ranges: the ends of links are doubles, rounded outwards."""
    W = 0.2 * sparse_ring(2000)
    net = kp.feedback_interconnect([kp.stack(np.full((2000, 1, 1), -1.0), [[1]], [[1]])], kp.interval(0.9 * W, 1.1 * W))
    found = kp.largest_uncertainty(net)
    assert found.lower < found.upper <= found.lower * (1 + 1e-6) and found.scope == "network" and found.check()


@pytest.mark.parametrize("net", [None, 3, lag(1), kp.feedback_interconnect([lag(2)], [[0]])])
def test_networks_without_uncertainty_are_refused(net):
    with pytest.raises(DataError, match="give a network with vertices or ranges"):
        kp.largest_uncertainty(net)
