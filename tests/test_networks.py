"""Theorem 4 on networks built to pass, to fail, and to fool plausible but wrong tests."""

from dataclasses import replace

import control as ct
import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.certificates.result import Status
from control_kpos.networks import (
    AlgebraicLoop,
    CouplingViolation,
    NetworkInstability,
    NodeNotDissipative,
    NodeViolation,
    NoWeights,
    scale_free_certificate,
)

CONE = kp.PolyhedralCone([[0, 1], [1, -2]])


def lag(rate, D=0.0, dt=0, **names):
    """x' = -rate x + u, y = x + D u."""
    return kp.ConeStateSpace([[-rate if not dt else rate]], [[1.0]], [[1.0]], [[D]], dt, **names)


def mass(F=(-21, -13), k=1.0, **names):
    return kp.ConeStateSpace([[0, 1], [F[0] - k, F[1]]], [[0], [1]], [[1, 0]], 0, X=CONE, **names)


def cycle(n, weight=1.0):
    return weight * np.roll(np.eye(n), 1, axis=1)


def random_masses(rng, n):
    A = np.zeros((n, 2, 2))
    A[:, 0, 1] = 1
    A[:, 1, 0] = -21 + rng.uniform(-1, 0, n) - rng.uniform(0.5, 1.5, n)
    A[:, 1, 1] = -13 + rng.uniform(-2, -1, n)
    return kp.stack(A, [[0], [1]], [[1, 0]], X=CONE)


def is_unstable(net):
    return np.linalg.eigvals(net.A).real.max() > 0


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
    nodes, W = [lag(1), lag(1)], np.array([[0, -5.0], [5.0, 0]])
    W2 = np.array([[0, -5.0], [-5.0, 0]])
    assert is_unstable(kp.feedback_interconnect(nodes, W2))  # eigenvalue +4
    for coupling, place in ((W, (0, 1)), (W2, (0, 1))):
        rates = [(-1e-3, 1e-3)] * 2  # q'y + r'W y <= 0 holds in the columns of negative entries
        for certificate in (
            kp.feedback_interconnect(nodes, coupling).certificate,
            kp.feedback_interconnect(nodes, coupling, supply_rates=rates).certificate,
        ):
            assert certificate.status is Status.REFUTED and isinstance(certificate.witness, CouplingViolation)
            assert (certificate.witness.target, certificate.witness.source) == place
            assert certificate.check() and "node 1 to node 0" in certificate.explain()


def test_node_that_is_not_positive_although_the_inequalities_have_a_solution():
    bad = kp.ConeStateSpace([[1, -2], [-2, 1]], [[1], [1]], [[0, 0]], 0)  # v = (1, 1) decreases on the rays
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


# -- couplings and nodes in all their forms


def test_forms_of_coupling_agree():
    nodes = [mass(name=f"cart{j}") for j in range(3)]
    W = cycle(3, 2.0)
    messy = sp.coo_array(([1.0, 1.0, 2.0, 2.0, 0.0], ([0, 0, 2, 1, 0], [1, 1, 0, 2, 0])), shape=(3, 3))
    graph = nx.DiGraph()
    graph.add_weighted_edges_from([("cart1", "cart0", 2.0), ("cart2", "cart1", 2.0), ("cart0", "cart2", 2.0)])
    numbered = nx.relabel_nodes(graph, {f"cart{j}": j for j in range(3)})
    blocks = [[None if not w else [[w]] for w in row] for row in W]
    for form in (
        W,
        W.tolist(),
        messy,
        messy.tocsr(),
        messy.tocsc(),
        sp.lil_matrix(W),
        sp.bsr_array(W),
        sp.dok_array(W),
        sp.dia_array(sp.csr_array(W)),
        graph,
        numbered,
        blocks,
    ):
        net = kp.feedback_interconnect(nodes, form)
        np.testing.assert_array_equal(net.model.W.toarray(), W)
    unsorted = sp.csr_array(W)
    unsorted = sp.csr_array((unsorted.data[::-1], np.array([2, 0, 1])[[1, 0, 2]], unsorted.indptr), shape=(3, 3))
    np.testing.assert_array_equal(kp.feedback_interconnect(nodes, unsorted).model.W.toarray(), unsorted.toarray())


def test_undirected_graph_couples_both_ways():
    net = kp.feedback_interconnect([lag(5)] * 4, nx.path_graph(4))
    np.testing.assert_array_equal(net.model.W.toarray(), nx.to_numpy_array(nx.path_graph(4)))


def test_sequence_and_stack_are_the_same_network():
    rng = np.random.default_rng(0)
    stack = random_masses(rng, 20)
    listed = [kp.ConeStateSpace(A, [[0], [1]], [[1, 0]], 0, X=CONE) for A in stack.A.values]
    one, two = kp.feedback_interconnect(stack, cycle(20)), kp.feedback_interconnect(listed, cycle(20))
    np.testing.assert_array_equal(one.sparse_A.toarray(), two.sparse_A.toarray())
    np.testing.assert_allclose(one.certificate.v, two.certificate.v)
    mixed = kp.feedback_interconnect([stack, lag(1)], np.zeros((21, 21)))
    assert mixed.model.n_nodes == 21 and mixed.certificate.status is Status.PROVED


def test_exact_data_decide_where_doubles_cannot():
    # k = 1.1, F = (-21.3, -13.2) sits on the boundary in decimals; its doubles do not
    node = kp.ConeStateSpace([["0", "1"], ["-22.4", "-13.2"]], [[0], [1]], [[1, 0]], 0, X=CONE)
    assert kp.feedback_interconnect([node] * 3, cycle(3)).certificate.status is Status.PROVED
    third = kp.feedback_interconnect([lag(1)] * 2, [["0", "1/3"], ["1/3", "0"]])
    assert third.certificate.status is Status.PROVED and third.certificate.check()


def test_timebases():
    slow = kp.feedback_interconnect([lag(0.5, dt=0.1)] * 2, cycle(2, 0.4))
    assert slow.dt == 0.1 and slow.certificate.status is Status.PROVED
    assert kp.feedback_interconnect([lag(0.5, dt=True)] * 2, cycle(2, 0.6)).certificate.status is Status.REFUTED
    with pytest.raises(kp.TimebaseError, match=r"systems\[1\] has dt = 0.2, but systems\[0\] has dt = 0.1"):
        kp.feedback_interconnect([lag(0.5, dt=0.1), lag(0.5, dt=0.2)], cycle(2))


# -- bad input


@pytest.mark.parametrize(
    ("coupling", "error", "words"),
    [
        (np.zeros((2, 3)), kp.ConeMismatchError, "coupling is 2 x 3, but the nodes have 2 inputs and 2 outputs"),
        (np.array([[0, np.nan], [1, 0]]), kp.DataError, "nan"),
        (np.array([[0, np.inf], [1, 0]]), kp.DataError, "inf"),
        ([[0, 1], [1]], kp.ShapeError, "ragged"),
        (nx.MultiDiGraph([(0, 1), (0, 1)]), kp.DataError, "multigraph"),
        (nx.path_graph(["a", "b"]), kp.ConeMismatchError, "'a'"),
        (nx.path_graph(3), kp.ConeMismatchError, "3 nodes, but there are 2"),
        (1j * np.eye(2), kp.DataError, "complex"),
    ],
)
def test_bad_couplings_are_refused_by_name(coupling, error, words):
    with pytest.raises(error, match=words):
        kp.feedback_interconnect([lag(1)] * 2, coupling)


def test_out_of_range_sparse_entries_are_refused():
    broken = sp.csr_array(np.eye(2))
    broken.indices = np.array([0, 7], dtype=broken.indices.dtype)
    with pytest.raises(kp.ShapeError, match="coupling"):
        kp.feedback_interconnect([lag(1)] * 2, broken)


def test_other_bad_input():
    with pytest.raises(kp.ShapeError, match="empty"):
        kp.feedback_interconnect([], np.zeros((0, 0)))
    with pytest.raises(kp.ShapeError, match=r"systems\[1\] is a StateSpace"):
        kp.feedback_interconnect([lag(1), ct.ss(-1, 1, 1, 0)], cycle(2))
    with pytest.raises(kp.NotProperConeError, match="X is not solid"):
        kp.stack(-np.eye(2)[None], np.ones((2, 1)), np.ones((1, 2)), X=kp.PolyhedralCone([[1, 0]]))
    with pytest.raises(kp.ShapeError, match=r"B has shape \(1, 3, 1\)"):
        kp.stack(-np.eye(2)[None], np.ones((3, 1)), np.ones((1, 2)))
    with pytest.raises(kp.ShapeError, match="supply_rates has 1 entries; 2 nodes"):
        kp.feedback_interconnect([lag(1)] * 2, cycle(2), supply_rates=[(-1, 1)])
    with pytest.raises(kp.ShapeError, match=r"q in supply_rates\[1\]"):
        kp.feedback_interconnect([lag(1)] * 2, cycle(2), supply_rates=[(-1, 1), ([-1, 2], 1)])
    with pytest.raises(TypeError):
        kp.feedback_interconnect([lag(1)] * 2, cycle(2), colour="red")


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
        certificate, model=certificate.model.with_coupling(kp.arrays.exact_matrix(sp.csr_array(cycle(6, 30.0)), "W"))
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


# -- supply rates


def test_supply_rates_find_weights():
    nodes, W = [lag(2), lag(2)], np.array([[0, 10.0], [0.1, 0]])
    certificate = kp.feedback_interconnect(nodes, W, supply_rates=[(-1.0, 1.0)] * 2).certificate
    assert certificate.status is Status.UNDECIDED or certificate.check()
    certificate = kp.feedback_interconnect(nodes, W, supply_rates=[(-1.5, 1.0)] * 2).certificate
    assert certificate.status is Status.PROVED and certificate.check()
    assert np.ptp(certificate.sigma) > 0
    local = [node.dissipativity(q=[-1.5], r=[1.0]) for node in nodes]
    assert kp.feedback_interconnect(nodes, W, supply_rates=local).certificate.status is Status.PROVED


def test_supply_rate_that_a_node_does_not_satisfy():
    certificate = kp.feedback_interconnect(
        [lag(2), lag(2)], cycle(2), supply_rates=[(-1.0, 1.0), (-5.0, 1.0)]
    ).certificate
    assert certificate.status is Status.REFUTED and isinstance(certificate.witness, NodeNotDissipative)
    assert certificate.witness.node == 1 and certificate.check()


# -- variations


def test_weaker_links_inherit_the_certificate():
    rng = np.random.default_rng(2)
    net = kp.feedback_interconnect(random_masses(rng, 8), cycle(8, 15.0))
    for _ in range(5):
        weaker = net.with_links(sp.csr_array(cycle(8, 15.0) * rng.choice([0.0, 0.3, 1.0], size=(8, 8))))
        assert weaker.__dict__["certificate"].status is Status.PROVED  # there before anyone asked
        assert np.linalg.eigvals(weaker.A).real.max() <= np.linalg.eigvals(net.A).real.max() + 1e-9
    stronger = net.with_links(cycle(8, 40.0))
    assert stronger.certificate.status is Status.REFUTED


def test_plug_and_play_proves_what_a_fresh_certificate_proves():
    rng = np.random.default_rng(3)
    net = kp.feedback_interconnect(random_masses(rng, 30), sp.csr_array(cycle(30)))
    for step in range(12):
        kind = rng.integers(3)
        n = net.certificate.overlay.n_nodes if hasattr(net.certificate, "overlay") else net.model.n_nodes
        if kind == 0:
            net = net.with_node(mass(), incoming={int(rng.integers(n)): 0.5}, outgoing={int(rng.integers(n)): 0.5})
        elif kind == 1:
            net = net.without_node(int(rng.integers(n)))
        else:
            net = net.replace_node(int(rng.integers(n)), mass(F=(-22, -14)))
        assert net.certificate.status is Status.PROVED, step
    fresh = kp.feedback_interconnect(net.model.stacks and _as_list(net), net.model.W)
    assert fresh.certificate.status is Status.PROVED
    np.testing.assert_allclose(fresh.A, net.A)
    assert net.certificate.check()
    assert np.linalg.eigvals(net.A).real.max() <= -net.certificate.decay_rate


def _as_list(net):
    nodes = [None] * net.model.n_nodes
    for s, index in zip(net.model.stacks, net.model.members, strict=True):
        for place, j in enumerate(index):
            nodes[j] = kp.ConeStateSpace(*(m.values[place] for m in (s.A, s.B, s.C, s.D)), s.dt, X=s.X, U=s.U, Y=s.Y)
    return nodes


def test_a_node_that_asks_for_too_much_is_decided_afresh():
    net = kp.feedback_interconnect([mass()] * 5, cycle(5))
    room = net.room_for(mass(), [0], [2])
    assert room > 10
    inside = net.with_node(mass(), incoming={0: 0.9 * room}, outgoing={2: 1.0})
    assert hasattr(inside.certificate, "overlay") and inside.certificate.check()
    outside = net.with_node(mass(), incoming={0: 1e4 * room}, outgoing={2: 1.0})
    assert outside.certificate.status is Status.REFUTED and is_unstable(outside)
    with pytest.raises(kp.ShapeError, match="node 9 does not exist"):
        net.without_node(9)
    with pytest.raises(kp.TimebaseError):
        net.with_node(lag(0.5, dt=0.1))


def test_room_for_nodes_with_several_channels():
    rng = np.random.default_rng(11)
    wide = kp.ConeStateSpace(-np.diag([5.0, 6.0]), np.eye(2), [[1, 0.5], [0, 1]], 0, U=kp.orthant(2), Y=kp.orthant(2))
    net = kp.feedback_interconnect([wide] * 4, np.kron(cycle(4), rng.random((2, 2))))
    new = kp.ConeStateSpace([[-3.0]], [[1.0, 2.0]], [[1.0], [0.2]], 0)
    sources, targets = {0: rng.random((2, 2)), 2: rng.random((2, 2))}, {1: rng.random((2, 2))}
    room = net.room_for(new, sources, targets)
    for share, covered in ((0.99, True), (1e3, False)):
        into = {k: share * room * block for k, block in sources.items()}
        grown = net.with_node(new, incoming=into, outgoing=targets)
        assert hasattr(grown.certificate, "overlay") is covered
    with pytest.raises(kp.ConeMismatchError, match=r"sources\[0\] is 1 x 1, but must be 2 x 2"):
        net.room_for(new, [0], targets)


def test_no_room_for_nodes_that_break_the_network_by_themselves():
    net = kp.feedback_interconnect([mass()] * 5, cycle(5))
    assert net.room_for(mass(), [], [2]) == np.inf
    assert net.room_for(lag(-1), [0], [2]) == 0 and net.room_for(lag(-1), [], [2]) == 0  # unstable
    crossed = kp.ConeStateSpace([[-1, -1], [0, -1]], [[0], [1]], [[1, 0]], 0)  # not positive
    assert net.room_for(crossed, [0], [2]) == 0
    assert net.room_for(mass(), {0: [[-1.0]]}, [2]) == 0
    with pytest.raises(kp.ConeMismatchError, match="system has feedthrough"):
        net.room_for(lag(2, D=0.1), [0], [2])


def test_scale_free_certificates():
    certificate = scale_free_certificate(mass(), weight=21.0)
    assert certificate.status is Status.PROVED and certificate.check()
    rng = np.random.default_rng(4)
    for n in (2, 17, 300):
        W = sp.random_array((n, n), density=min(1.0, 4 / n), rng=rng, format="csr")
        W = sp.csr_array(W @ sp.diags_array(20.9 / np.maximum(W.sum(axis=0), 1e-9)))
        assert certificate.covers(W)
        net = certificate.interconnect(W)
        assert net.__dict__["certificate"].status is Status.PROVED
        assert np.linalg.eigvals(net.A).real.max() < -certificate.decay_rate + 1e-9
    assert not certificate.covers(cycle(3, 21.1)) and not certificate.covers(cycle(3, -1.0))
    assert scale_free_certificate(mass(), weight=22.5).status is Status.REFUTED
    types = scale_free_certificate([mass(), lag(30.0)], weight=20.0)
    assert types.interconnect(cycle(6, 20.0), types=[0, 1, 0, 1, 1, 0]).certificate.status is Status.PROVED
    assert 21.9 < scale_free_certificate(mass()).weight < 22


def test_weights_that_enter_do_as_well_for_one_type():
    certificate = scale_free_certificate(mass(), weight=21.0)
    fan = np.zeros((4, 4))
    fan[1:, 0] = 20.0  # one node feeds three: 60 leave it, 20 enter each
    assert certificate.covers(fan) and certificate.interconnect(fan).certificate.status is Status.PROVED
    assert certificate.covers(fan + fan.T) is False
    types = scale_free_certificate([mass(), lag(30.0)], weight=20.0)
    assert types.covers(np.diag([20.0]), types=[1]) and not types.covers(fan, types=[0, 1, 1, 1])


def test_scale_free_certificates_of_nodes_with_several_channels():
    U = kp.PolyhedralCone([[1, 1], [1, -1]])
    A, B, C = -np.diag([3.0, 4.0]), np.eye(2), np.array([[1.0, 0.2], [0.1, 1.0]])
    plant = kp.ConeStateSpace(A, B, C, 0, U=kp.orthant(2), Y=kp.orthant(2))
    for link in (None, [[0.5, 0.5], [0.2, 0.8]]):
        certificate = scale_free_certificate(plant, link=link)
        K = np.eye(2) if link is None else np.array(link)
        gain = np.abs(np.linalg.eigvals(K @ C @ np.linalg.inv(-A) @ B)).max()
        assert certificate.weight == pytest.approx(1 / gain) and certificate.status is Status.PROVED
        assert scale_free_certificate(plant, 1.001 / gain, link=link).status is Status.REFUTED
        rng = np.random.default_rng(0)
        graph = rng.random((6, 6))
        W = np.kron(graph / graph.sum(axis=0) * certificate.weight * 0.999, K)
        assert certificate.covers(W) and not certificate.covers(1.01 * W) and not certificate.covers(-W)
        net = certificate.interconnect(W)
        assert net.__dict__["certificate"].check() and np.linalg.eigvals(net.A).real.max() < 0
        # links of another shape count by the supply rate r at every generator of Y
        r = certificate.local.r[0]
        other = np.outer([0.3, 0.7], [1.0, 2.0])
        most = min((r @ K)[i] / (r @ other)[i] for i in range(2)) * certificate.weight
        ring = np.kron(cycle(3), other)
        assert certificate.covers(0.999 * most * ring) and not certificate.covers(1.001 * most * ring)
    with pytest.raises(kp.ConeMismatchError, match=r"one supply rate r serves all.*2 inputs"):
        scale_free_certificate([plant, plant], 0.1)
    with pytest.raises(kp.ConeMismatchError, match="give link, a 2 x 2 matrix that maps Y into U"):
        scale_free_certificate(kp.ConeStateSpace(A, [[1, 0.5], [0, 0.5]], C, 0, U=U))
    with pytest.raises(kp.ShapeError, match="link is 1 x 2, but must be 2 x 2"):
        scale_free_certificate(plant, link=[[1, 2]])
    with pytest.raises(kp.ShapeError, match="types"):
        certificate.covers(W, types=[0, 3])


# -- the closed loop


def test_python_control_works_on_it_and_names_follow():
    net = kp.feedback_interconnect([mass(name="left"), mass(name="right")], cycle(2), name="pair")
    assert isinstance(net, ct.StateSpace) and net.name == "pair"
    assert net.input_labels == ["left_u[0]", "right_u[0]"] and net.state_labels[0] == "left_x[0]"
    plain = ct.ss(net.A, net.B, net.C, net.D)
    np.testing.assert_allclose(np.sort(ct.poles(net)), np.sort(plain.poles()))
    np.testing.assert_allclose(net(1j), plain(1j))
    np.testing.assert_allclose(ct.dcgain(net), ct.dcgain(plain))
    assert (net * net).nstates == 8
    assert net.copy().certificate.status is Status.PROVED


def test_external_signals_are_chosen_by_name_or_place():
    nodes = [mass(name="left"), mass(name="right")]
    net = kp.feedback_interconnect(nodes, cycle(2), inputs=["left"], outputs=["right_y[0]", 0])
    whole = kp.feedback_interconnect(nodes, cycle(2))
    np.testing.assert_array_equal(net.B, whole.B[:, [0]])
    np.testing.assert_array_equal(net.C, whole.C[[1, 0]])
    with pytest.raises(kp.ShapeError, match="middle"):
        kp.feedback_interconnect(nodes, cycle(2), outputs=["middle"])


def test_large_networks_refuse_dense_matrices_and_say_what_to_do():
    net = kp.feedback_interconnect(random_masses(np.random.default_rng(0), 4000), _ring(4000))
    with pytest.raises(kp.TooLargeError, match="sparse_A"):
        _ = net.A
    with pytest.raises(kp.TooLargeError):
        net.poles()
    lower, upper = net.spectral_abscissa()
    assert abs(net.poles(3)[0].real - upper) < 1e-5 and upper - lower < 1e-5
    response = net.initial_response(1.0, 1.0, outputs=[0, 17])
    assert isinstance(response, ct.TimeResponseData) and response.outputs.shape == (2, 200)


@pytest.mark.parametrize(
    "ask", [lambda n: n(0j), ct.dcgain, lambda n: ct.frequency_response(n, [1.0]), ct.ss2tf, ct.tf]
)
def test_what_would_fill_the_memory_is_refused_before_it_does(ask):
    """python-control makes arrays of states squared, or lists of ports squared, before it looks at A."""
    n = 20_000
    nodes = kp.stack(A=-np.ones((n, 1, 1)), B=np.ones((n, 1, 1)), C=np.ones((n, 1, 1)))
    net = kp.feedback_interconnect(nodes, sp.eye_array(n, k=1, format="csr") * 0.5)
    with pytest.raises(kp.TooLargeError, match="forced_response"):
        ask(net)


def _ring(n):
    return sp.csr_array((np.ones(n), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))


@pytest.mark.parametrize("dt", [0, 0.1])
def test_responses_are_those_of_python_control(dt):
    rng = np.random.default_rng(6)
    nodes = [
        lag(0.5 if dt else 3.0, D=0.2, dt=dt),
        lag(0.3 if dt else 40.0, D=0.1, dt=dt),
        lag(0.2 if dt else 1.5, dt=dt),
    ]
    net = kp.feedback_interconnect(nodes, 0.5 * rng.random((3, 3)))
    plain = ct.ss(net.A, net.B, net.C, net.D, dt)
    T, x0 = np.arange(0, 3.05, 0.1), rng.random(3)
    U = rng.random((3, len(T)))
    ours, theirs = net.forced_response(T, U, x0), ct.forced_response(plain, T, U, x0)
    np.testing.assert_allclose(ours.outputs, theirs.outputs, atol=1e-10)
    np.testing.assert_allclose(ours.states, theirs.states, atol=1e-10)
    np.testing.assert_allclose(
        net.initial_response(T, x0).outputs, ct.initial_response(plain, T, x0).outputs, atol=1e-10
    )


def test_bad_simulation_input():
    net = kp.feedback_interconnect([lag(1)] * 2, cycle(2, 0.5))
    for T in ([0, 1, 5], [], -1.0, [1, 0]):
        with pytest.raises(kp.KposError):
            net.initial_response(T, 1.0)
    with pytest.raises(kp.ShapeError, match="X0 has 3 entries; it must have 2"):
        net.initial_response(1.0, [1, 2, 3])
    with pytest.raises(kp.ShapeError, match="U is 1 x 4"):
        net.forced_response([0, 1, 2], [[1, 2, 3, 4]])
    with pytest.raises(kp.ShapeError, match="outputs names 'z'"):
        net.initial_response(1.0, 1.0, outputs=["z"])


# -- delays and lost links


def test_delayed_links_stay_stable_and_converge_to_the_delay_equation():
    rng = np.random.default_rng(7)
    net = kp.feedback_interconnect(random_masses(rng, 5), cycle(5, 18.0))
    assert net.certificate.status is Status.PROVED and "delay" in net.certificate.explain()
    T = np.linspace(0, 1, 41)
    undelayed = net.delayed_response(T, 1.0, 0.0, refine=40).outputs
    np.testing.assert_allclose(undelayed, net.initial_response(T, 1.0).outputs, atol=1e-6)
    # one node fed by itself, delayed: x' = -2 x + x(t - 1) with x = 1 before, solved by steps on [0, 1]
    single = kp.feedback_interconnect([lag(2)], [[1.0]]).delayed_response(T, 1.0, 1.0, refine=10)
    np.testing.assert_allclose(single.outputs[0], 0.5 + 0.5 * np.exp(-2 * T), atol=1e-6)
    for _ in range(3):
        late = net.delayed_response(np.linspace(0, 60, 121), 1.0, rng.uniform(0, 4, (5, 5)), refine=30).outputs
        assert np.abs(late[:, -1]).max() < 0.2 * np.abs(late[:, 0]).max()
    with pytest.raises(kp.DataError, match="not negative"):
        net.delayed_response(T, 1.0, -1.0)


def test_switching_links_off_and_on_never_raises_the_storage():
    rng = np.random.default_rng(8)
    net = kp.feedback_interconnect(random_masses(rng, 6), cycle(6, 18.0))
    v = np.concatenate([np.ravel(k) for k in net.certificate.v])
    x = np.ravel(rng.random((6, 2)) @ CONE.rays)
    before = v @ x
    for _ in range(20):
        lost = net.with_links(cycle(6, 18.0) * (rng.random((6, 6)) < 0.5))
        x = lost.initial_response([0, 0.3], x).states[:, -1]
        assert v @ x <= before * np.exp(-0.3 * net.certificate.decay_rate) + 1e-12
        before = v @ x


def test_progress_is_reported_and_interruption_leaves_nothing_half_done():
    lines = []
    net = kp.feedback_interconnect(random_masses(np.random.default_rng(9), 50), _ring(50), progress=lines.append)
    net.spectral_abscissa()
    assert lines and "abscissa" in lines[0]

    def interrupt(line):
        raise KeyboardInterrupt

    broken = kp.feedback_interconnect(random_masses(np.random.default_rng(9), 50), 30 * _ring(50), progress=interrupt)
    with pytest.raises(KeyboardInterrupt):
        _ = broken.certificate
    broken._progress = None
    assert broken.certificate.status is Status.REFUTED
