"""Theorem 4 on networks built to pass, to fail, and to fool plausible but wrong tests."""

from dataclasses import replace

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import CONE, cycle, is_unstable, lag, mass, random_masses

import control_kpos as kp
from control_kpos.exact.intake import exact_matrix
from control_kpos.networks import (
    AlgebraicLoop,
    CouplingViolation,
    NetworkInstability,
    NodeViolation,
    NoWeights,
)
from control_kpos.proof.certificate import Status

# -- the paper


def test_ring_of_the_paper_by_its_program_by_the_solve_and_by_every_node():
    nodes, W = [mass()] * 10, cycle(10)
    net = kp.feedback_interconnect(nodes, W)
    assert net.certificate.status is Status.PROVED and net.certificate.check()
    # (cond2), (cond3) with the paper's choice v, r = v'B, q = -r
    v = np.array([5.09, 0.836])
    r = v @ [0, 1]
    for x in CONE.rays:
        assert -r * x[0] > v @ nodes[0].A @ x
    given = kp.feedback_interconnect(nodes, W, supply_rates=[(-r, r)] * 10).certificate
    assert given.status is Status.PROVED and np.all(given.sigma == 1)
    assert all(node.cone_positivity() for node in nodes)
    # the paper prints -1.48; the characteristic polynomial at the slowest mode says otherwise
    lower, upper = net.spectral_abscissa()
    assert lower <= (-13 + np.sqrt(85)) / 2 + 1e-12 and upper >= (-13 + np.sqrt(85)) / 2 - 1e-12


# -- plausible wrong tests


def test_self_loop_that_a_fast_node_would_hide_in_the_summed_condition():
    nodes, W = [lag(1), lag(100)], np.array([[2.0, 0], [0, 0]])
    rates = [(-0.9, 1.0), (-99.0, 1.0)]
    assert sum(q for q, _ in rates) + 2.0 * rates[0][1] <= 0  # the literal sum over nodes passes
    assert is_unstable(kp.feedback_interconnect(nodes, W))
    assert kp.feedback_interconnect(nodes, W).certificate.status is Status.REFUTED
    certificate = kp.feedback_interconnect(nodes, W, supply_rates=rates).certificate
    assert certificate.status is Status.REFUTED and isinstance(certificate.witness, NoWeights) and certificate.check()


def test_two_nodes_in_a_loop_without_self_loops():
    net = kp.feedback_interconnect([lag(1), lag(1)], [[0, 2], [0.6, 0]])
    assert is_unstable(net) and isinstance(net.certificate.witness, NetworkInstability) and net.certificate.check()


def test_long_chain_with_one_bad_node():
    n = 3000
    A = np.full((n, 1, 1), -1.0)
    A[1234] = 1e-3
    chain = sp.diags_array(np.full(n - 1, 0.5), offsets=-1, format="csr")
    certificate = kp.feedback_interconnect(kp.stack(A, [[1]], [[1]]), chain).certificate
    assert certificate.status is Status.REFUTED and certificate.check()
    assert np.flatnonzero(certificate.witness.x)[0] == 1234
    A[1234] = -1e-3
    assert kp.feedback_interconnect(kp.stack(A, [[1]], [[1]]), chain).certificate.status is Status.PROVED


def test_negative_coupling_that_satisfies_the_balance_but_leaves_the_cone():
    nodes, rates = [lag(1), lag(1)], [(-0.9e-3, 1e-3)] * 2
    v = 0.95e-3
    assert all(v > 0 and -v - q < 0 and v <= r for q, r in rates)  # (cond2): every node is dissipative
    for W in (np.array([[0, -5.0], [0.5, 0]]), np.array([[0, -5.0], [-5.0, 0]])):
        q, r = np.array(rates).T
        assert (q + W.T @ r < 0).all()  # (cond3) with sigma = 1: only (I) is broken
        for certificate in (
            kp.feedback_interconnect(nodes, W).certificate,
            kp.feedback_interconnect(nodes, W, supply_rates=rates).certificate,
        ):
            assert certificate.status is Status.REFUTED and isinstance(certificate.witness, CouplingViolation)
            assert (certificate.witness.target, certificate.witness.source) == (0, 1)
            assert certificate.check() and "node 1 to node 0" in certificate.explain()
    assert is_unstable(kp.feedback_interconnect(nodes, W))  # eigenvalue +4


def test_node_that_is_not_positive_although_the_inequalities_have_a_solution():
    bad = kp.ConeStateSpace([[1, -2], [-2, 1]], [[1], [1]], [[0, 0]], 0)
    v, q, r = np.array([1.0, 1.0]), 0.0, 2.0
    assert (v > 0).all() and (v @ bad.A - q * bad.C < 0).all() and (v @ bad.B <= r).all()  # (cond2) holds
    assert np.linalg.eigvals(bad.A).max() > 0
    certificate = kp.feedback_interconnect([lag(1), bad], np.zeros((2, 2))).certificate
    assert certificate.status is Status.REFUTED and isinstance(certificate.witness, NodeViolation)
    assert certificate.witness.node == 1 and certificate.check()


def test_block_transposed_coupling():
    wide = kp.ConeStateSpace([[-1.0]], [[1.0, 0.0]], [[1.0]], 0)  # two inputs, one output
    tall = kp.ConeStateSpace([[-1.0]], [[1.0]], [[1.0], [1.0]], 0)  # one input, two outputs
    W = [[None, [[0.1, 0.1], [0.1, 0.1]]], [[[0.1]], None]]
    net = kp.feedback_interconnect([wide, tall], W)
    assert net.certificate.status is Status.PROVED
    with pytest.raises(
        kp.ConeMismatchError, match=r"coupling\[0\]\[1\] is 1 x 1, but node 0 has 2 inputs and node 1 has 2"
    ):
        kp.feedback_interconnect([wide, tall], [[None, W[1][0]], [W[0][1], None]])
    # square blocks: transposing them makes another network, with another truth
    one = [kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0)] * 2
    block = np.array([[0.0, 3.0], [0.0, 0.0]])
    straight = kp.feedback_interconnect(one, [[None, block], [block, None]])
    twisted = kp.feedback_interconnect(one, [[None, block], [block.T, None]])
    assert straight.certificate.status is Status.PROVED and twisted.certificate.status is Status.REFUTED
    assert is_unstable(twisted) and not is_unstable(straight)


def test_exactly_marginal_and_next_to_it():
    assert kp.feedback_interconnect([lag(1)] * 2, cycle(2, 1 - 1e-9)).certificate.status is Status.PROVED
    assert kp.feedback_interconnect([lag(1)] * 2, cycle(2, 1 + 1e-9)).certificate.status is Status.REFUTED
    assert kp.feedback_interconnect([lag(1)] * 2, cycle(2)).certificate.status is not Status.PROVED


# -- feedthrough


def test_feedthrough_below_and_above_gain_one():
    assert kp.feedback_interconnect([lag(4, D=0.5)] * 2, cycle(2)).certificate.status is Status.PROVED
    strong = kp.feedback_interconnect([lag(4, D=2.0)] * 2, cycle(2))
    assert isinstance(strong.certificate.witness, AlgebraicLoop) and strong.certificate.check()
    assert list(strong.certificate.witness.nodes) == [0, 1]


def test_ill_posed_loop_is_named():
    nodes = [lag(1), lag(1, D=1.0), lag(1), lag(1, D=1.0)]
    W = np.zeros((4, 4))
    W[1, 3] = W[3, 1] = W[0, 1] = 1
    with pytest.raises(kp.DataError, match="algebraic loop through nodes 1, 3"):
        kp.feedback_interconnect(nodes, W)


def test_feedthrough_without_a_loop_needs_no_gain_bound():
    W = np.diag([5.0], -1)
    net = kp.feedback_interconnect([lag(1, D=3.0)] * 2, W)
    assert net.certificate.status is Status.PROVED
    direct = ct.feedback(ct.append(*[ct.ss(lag(1, D=3.0))] * 2), ct.ss([], [], [], W), sign=1)
    np.testing.assert_allclose(net.A, direct.A), np.testing.assert_allclose(net.D, direct.D)


# -- certificates


def test_changed_certificates_fail_their_check():
    rng = np.random.default_rng(1)
    certificate = kp.feedback_interconnect(random_masses(rng, 6), cycle(6)).certificate
    assert certificate.check() and bool(certificate)
    for name in ("v", "r", "q", "sigma"):
        value = getattr(certificate, name)
        assert not replace(certificate, **{name: -value}).check()
        assert not replace(
            certificate, **{name: value * np.linspace(1, 1.5, 6).reshape((6,) + (1,) * (value.ndim - 1))}
        ).check()
        assert not replace(certificate, **{name: value[:-1]}).check()
    assert not replace(certificate, decay_rate=certificate.decay_rate * 1.2).check()
    assert not replace(
        certificate, model=certificate.model.with_coupling(exact_matrix(sp.csr_array(cycle(6, 30.0)), "W"))
    ).check()
    worse = kp.feedback_interconnect(random_masses(rng, 6), cycle(6, 40.0)).certificate
    assert worse.check()
    assert not replace(worse, witness=replace(worse.witness, x=-worse.witness.x)).check()
    assert not replace(worse, witness=replace(worse.witness, u=worse.witness.u + 1)).check()
    assert not replace(worse, witness=replace(worse.witness, x=0 * worse.witness.x)).check()


def test_files(tmp_path):
    good = kp.feedback_interconnect([mass(), lag(2)], cycle(2)).certificate
    bad = kp.feedback_interconnect([mass(), lag(2)], cycle(2, 20.0)).certificate
    for certificate in (good, bad):
        certificate.save(tmp_path / "net.json")
        again = kp.load_certificate(tmp_path / "net.json")
        assert again.status is certificate.status and again.check()


def test_node_margins_show_the_weakest_node():
    net = kp.feedback_interconnect([lag(9), lag(1.05), lag(9)], cycle(3))
    assert int(np.argmin(net.certificate.node_margins)) == 1 and "node 1" in net.certificate.explain()
    assert net.certificate.node_margins.shape == (3,)
