"""Networks with vertices at every node: against all mixtures and a linear program, at any size, forged certificates."""

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
from network_examples import CONE, cycle, lag, sparse_ring
from scipy.linalg import block_diag
from scipy.optimize import linprog

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import ConeMismatchError, DataError, ShapeError
from control_kpos.networks.nodes import UncertainStack

# Each vertex is stable; with the column of b1 of the first and that of b2 of the second there is the eigenvalue +.5.
CROSSED = kp.stack([[[-1, 0], [0, -1]]], [[[[1.5, 0], [0, 0]]], [[[0, 0], [0, 1.5]]]], np.eye(2))
SWAP = [[0, 1], [1, 0]]


def random_vertices(rng, count=2):
    """Two nodes with simplicial X and U and any Y, as lists of their vertices, and the coupling."""
    discrete, feedthrough = bool(rng.random() < 0.4), bool(rng.random() < 0.4)
    nodes = []
    for _ in range(2):
        m, q = int(rng.integers(1, 3)), int(rng.integers(1, 4))
        X, U, Y = (random_networks.random_cone(rng, n) for n in (2, m, q))
        made = []
        for _ in range(count):
            inner = random_networks.positive_map(rng, X, X)
            inner /= np.abs(np.linalg.eigvals(inner)).max()
            A = inner * rng.uniform(0.2, 0.9) if discrete else inner - rng.uniform(1.2, 1.9) * np.eye(2)
            B, C = random_networks.positive_map(rng, U, X), random_networks.positive_map(rng, X, Y)
            scale = 1 / (np.linalg.norm(C) * np.linalg.norm(B))
            D = 0.3 * random_networks.positive_map(rng, U, Y) if feedthrough else np.zeros((q, m))
            made.append(kp.ConeStateSpace(A, B * scale, C, D * scale, discrete, X=X, U=U, Y=Y))
        nodes.append(made)
    strength = 10 ** rng.uniform(-1.5, 1)
    blocks = [[strength * random_networks.positive_map(rng, b[0].Y, a[0].U, 1) for b in nodes] for a in nodes]
    return nodes, np.block(blocks), discrete


def large_matrix(nodes, W, discrete):
    """L = [[A, B], [W C, W D - I]] of one vertex of every node, in coordinates of the generators of X and U."""
    A, B, C, D = (block_diag(*(getattr(s, name) for s in nodes)) for name in "ABCD")
    L = np.block([[A - discrete * np.eye(len(A)), B], [W @ C, W @ D - np.eye(len(W))]])
    R = block_diag(*(s.X.rays.T for s in nodes), *(s.U.rays.T for s in nodes))
    return np.linalg.solve(R, L @ R)


def largest_mixture(nodes, W, discrete):
    """The largest real part of an eigenvalue of a mixture: every generator picks the vertex of its node."""
    whole = [large_matrix([made[s] for made in nodes], W, discrete) for s in range(len(nodes[0]))]
    choices = itertools.product(range(len(whole)), repeat=len(whole[0]))
    columns = np.arange(len(whole[0]))
    mixed = np.array([np.array(whole)[list(choice), :, columns].T for choice in choices])
    return np.linalg.eigvals(mixed).real.max()


def transposed(nodes):
    """The nodes of the transposed network on the dual cones."""
    made = [[(s.A.T, s.C.T, s.B.T, s.D.T, s.X.dual, s.Y.dual, s.U.dual, s.dt) for s in node] for node in nodes]
    return [[kp.ConeStateSpace(*s[:4], s[7], X=s[4], U=s[5], Y=s[6]) for s in node] for node in made]


def linear_program(nodes, W, discrete):
    """The largest t for (v, r): w >= t and w'L^s <= -t on the generators of X and U, at all vertices."""
    whole = [large_matrix([made[s] for made in nodes], W, discrete) for s in range(len(nodes[0]))]
    size = len(whole[0])
    A_ub = np.column_stack([np.vstack([*(L.T for L in whole), -np.eye(size)]), np.ones((len(whole) + 1) * size)])
    bounds, total = [(None, None)] * (size + 1), np.append(np.ones(size), 0)[None]
    return linprog(-np.eye(size + 1)[-1], A_ub, np.zeros(len(A_ub)), total, [1.0], bounds).x[-1]


@pytest.mark.parametrize("seed", range(150))
def test_random_networks_agree_with_all_mixtures_and_the_linear_program(seed):
    """By v iff every mixture of columns is Hurwitz (Schur) iff a program for v and r is feasible; by e iff of rows."""
    nodes, W, discrete = random_vertices(np.random.default_rng(seed))
    net = kp.feedback_interconnect(nodes, W)
    found, most = net.certificate, largest_mixture(nodes, W, discrete)
    rows = transposed(nodes)
    simplicial = all(node[0].U.is_simplicial for node in rows)
    other = most if most < 0 or not simplicial else largest_mixture(rows, W.T, discrete)
    assert abs(most) > 1e-5 and abs(other) > 1e-5  # none is on the margin
    assert (linear_program(nodes, W, discrete) > 1e-9) == (most < 0)
    assert isinstance(found, kp.BoundedNetworkCertificate) == (bool(found) and most > 0)
    if simplicial:
        assert most < 0 or (linear_program(rows, W.T, discrete) > 1e-9) == (other < 0)
        assert found.check() and found.status == ("PROVED" if min(most, other) < 0 else "REFUTED")
    assert found.check() and found.status == ("PROVED" if found else "REFUTED")
    members = [net.member(choice) for choice in itertools.product(range(2), repeat=2)]
    if found:
        assert all(m.certificate for m in members)
        assert not replace(found, v=-found.v if isinstance(found.v, np.ndarray) else tuple(-x for x in found.v)).check()
    elif isinstance(found.witness, kp.FailingMember):
        chosen = net.member(found.witness.vertices)
        assert chosen.certificate.status == "REFUTED"
    else:
        assert (
            isinstance(found.witness, kp.NoCommonVectors)
            and "about one set of vectors for all vertices" in found.explain()
        )


def test_every_generator_of_the_inputs_picks_its_vertex():
    """Both vertices are stable and no (v, r) is common: the eigenvalue of the mixture is +.5."""
    net = kp.feedback_interconnect(CROSSED, SWAP)
    assert all(net.member([s]).certificate for s in range(2))
    found = net.certificate
    assert found.status == "REFUTED" and found.check()
    assert "it does not show that any choice of vertices is unstable" in found.explain()
    halved = kp.stack([[[-1, 0], [0, -1]]], [[[[0.75, 0], [0, 0]]], [[[0, 0], [0, 0.75]]]], np.eye(2))
    assert kp.feedback_interconnect(halved, SWAP).certificate


def test_decay_under_random_changes_of_vertices():
    """V = v'x falls along discrete trajectories whose nodes change at random, as fast as is stated."""
    rng = np.random.default_rng(0)
    A = rng.uniform(0, 0.3, (3, 5, 2, 2))
    net = kp.feedback_interconnect(kp.stack(A, [[1], [0]], [[0, 0.3]], dt=True), sparse_ring(5))
    found = net.certificate
    assert found and found.decay_rate > 0
    x = rng.uniform(0, 1, net.nstates)
    for _ in range(20):
        after = net.member(rng.integers(0, 3, 5)).A @ x
        v = found.v.ravel()
        assert v @ after <= (1 - found.decay_rate) * (v @ x) * (1 + 1e-12)
        x = after


def test_nodes_with_several_numbers_of_vertices_stand_beside_each_other():
    """A list of systems, a stack with vertices and a node that is known."""
    nodes = [[lag(2), lag(3), lag(2.5)], kp.stack([[[[-2.0]]], [[[-4.0]]]], [[1]], [[1]]), lag(2)]
    net = kp.feedback_interconnect(nodes, cycle(3))
    assert net.certificate and len(net.models) == 3 and net.nstates == 3
    assert net.member([2, 1, 0]).certificate and net.nominal.certificate
    np.testing.assert_array_equal(net.member([2, 1, 0]).A.diagonal(), [-2.5, -4, -2])
    with pytest.raises(DataError, match=r"choice\[1\] is 2, but node 1 has the vertices 0 to 1"):
        net.member([0, 2, 0])
    for choice in ([0, 0], [0.5, 0, 0], [[0, 0, 0]], "x"):
        with pytest.raises(ShapeError, match="3 whole numbers"):
            net.member(choice)


def test_fractions_are_proven_as_they_are():
    """x' = (-x + u)/3 or -x + u in a loop of gain 1 is on the margin, refuted; a bit below it is proved."""
    third = [lag(1), kp.ConeStateSpace([["-1/3"]], [["1/3"]], [[1]], 0)]
    found = kp.feedback_interconnect([third, lag(1)], SWAP).certificate
    assert found.status == "REFUTED" and found.check() and isinstance(found.witness, kp.FailingMember)
    below = [[0, "0.999"], [1, 0]]
    assert kp.feedback_interconnect([third, lag(1)], below).certificate.check()
    assert kp.feedback_interconnect([third, lag(1)], below).models[1].stacks[0].A.fractions().item() == Fraction(-1, 3)


def test_a_vertex_that_is_not_positive_is_named():
    net = kp.feedback_interconnect([lag(2), [lag(2), lag(3), kp.ConeStateSpace([[-2]], [[-1]], [[1]], 0)]], cycle(2))
    found = net.certificate
    assert found.status == "REFUTED" and found.check()
    assert "at its vertex 2 node 1 is not positive" in found.explain() and "no sign of instability" in found.explain()


def test_a_vertex_that_alone_is_not_stable_is_named():
    found = kp.feedback_interconnect([lag(2), [lag(2), lag(-1)]], cycle(2)).certificate
    assert found.status == "REFUTED" and found.check()
    assert "node 1 at its vertex 1 does not decay even without the others" in found.explain()
    late = kp.feedback_interconnect([[lag(3), lag(2)], [lag(3), lag(2), lag(0)]], 0.1 * cycle(2)).certificate
    assert "node 1 at its vertex 2 does not decay even without the others" in late.explain() and late.check()
    both = kp.feedback_interconnect([[lag(2), lag(0.25)], lag(2)], cycle(2)).certificate
    assert both.status == "REFUTED" and "without the others" not in both.explain()
    alone = kp.feedback_interconnect([lag(2), [lag(2), lag(-1)]], np.zeros((2, 2))).certificate
    assert "node 1 at its vertex 1 does not decay even without the others" in alone.explain()
    assert "the network itself is refuted" in alone.explain() and "growth rate at least 1" not in alone.explain()


def test_a_link_that_leaves_the_cones_is_named():
    found = kp.feedback_interconnect([[lag(2), lag(3)], lag(2)], [[0, -1], [1, 0]]).certificate
    assert isinstance(found.witness, kp.CouplingViolation) and found.check() and "node 1 to node 0" in found.explain()


def test_algebraic_loops_contract_at_all_vertices_or_one_is_named():
    """D = 1/2 and 1, or 1/2 and 2, around a ring of two."""
    strong = [lag(9, 0.5), lag(9, 1.0)]
    assert kp.feedback_interconnect([strong, lag(9, 0.9)], SWAP).certificate.check()
    found = kp.feedback_interconnect([[lag(9, 0.5), lag(9, 2.0)], lag(9, 0.9)], SWAP).certificate
    assert found.status == "REFUTED" and found.check() and isinstance(found.witness.witness, kp.AlgebraicLoop)
    assert list(found.witness.vertices) == [1, 0] or list(found.witness.vertices) == [1, 1]


def test_algebraic_loops_of_mixtures_are_told_from_those_of_members():
    """y = D u, u = W y with D = diag(5/4, 0) or diag(0, 5/4): a mixture has gain 25/16, the members have none."""
    D = [[[[1.25, 0], [0, 0]]], [[[0, 0], [0, 1.25]]]]
    net = kp.feedback_interconnect(kp.stack([[[-9, 0], [0, -9]]], np.eye(2), np.eye(2), D), SWAP)
    found = net.certificate
    assert isinstance(found.witness, kp.NoCommonVectors) and found.check() and not found.witness.storage.x.any()
    assert "no vectors p, t show" in found.explain()
    assert all(net.member([s]).certificate for s in range(2))
    assert net.with_links(0.75 * np.array(SWAP)).certificate.check()


@pytest.mark.parametrize(("D", "W"), [((1, 1), SWAP), (("2/3", "3/4"), [[0, 2], [1, 0]]), ((0.5, 2), SWAP)])
def test_algebraic_loops_of_mixtures_of_gain_1_are_refuted(D, W):
    """Exactly: y = (4, 3) with u = (6, 4) is carried around by diag(2/3, 3/4) and W."""
    vertices = [[[[D[0], 0], [0, 0]]], [[[0, 0], [0, D[1]]]]]
    found = kp.feedback_interconnect(kp.stack([[[-9, 0], [0, -9]]], np.eye(2), np.eye(2), vertices), W).certificate
    assert found.status == "REFUTED" and found.check() and not found.witness.storage.x.any()
    assert "no vectors p, t show" in found.explain()


def test_wider_cones_keep_their_own_verdict():
    """Masses in a ring, with two stiffnesses, on the cone of the paper."""
    A = np.array([[[[0, 1], [-22, -13]]] * 4, [[[0, 1], [-23, -14]]] * 4])
    net = kp.feedback_interconnect(kp.stack(A, [[0], [1]], [[1, 0]], X=CONE), cycle(4))
    assert net.certificate.check() and net.certificate.decay_rate > 0
    assert net.certificate.vertex_margins.shape == (2, 4)
    np.testing.assert_array_equal(net.certificate.node_margins, net.certificate.vertex_margins.min(axis=0))
    assert net.with_links(30 * cycle(4)).certificate.status == "REFUTED"


def test_large_networks_need_a_handful_of_solves(monkeypatch):
    """20 000 nodes with 4 vertices: fewer than 12 solves."""
    from control_kpos.networks.uncertain import mixtures

    solves = []
    system = mixtures.PortSystem
    monkeypatch.setattr(mixtures, "PortSystem", lambda *given: solves.append(1) or system(*given))
    rng, n = np.random.default_rng(1), 20_000
    A = rng.uniform(0, 1, (4, n, 2, 2)) - 3 * np.eye(2)
    B, C = rng.uniform(0, 1, (4, n, 2, 1)), rng.uniform(0, 1, (4, n, 1, 2))
    W = sp.csr_array(
        (rng.uniform(0, 0.5, 3 * n), (np.repeat(np.arange(n), 3), rng.integers(0, n, 3 * n))), shape=(n, n)
    )
    net = kp.feedback_interconnect(kp.stack(A, B, C), W)
    assert net.certificate and 1 < len(solves) < 12
    assert net.certificate.decay_rate < net.nominal.certificate.decay_rate


# -- certificates and files


def some():
    yield kp.feedback_interconnect([[lag(2), lag(3, 0.25)], lag(7 / 3)], SWAP).certificate
    yield kp.feedback_interconnect([[lag(2), lag(0.25)], lag(1)], SWAP).certificate
    yield kp.feedback_interconnect([[lag(2), lag(-1)], lag(1)], [[0, -1], [1, 0]]).certificate
    yield kp.feedback_interconnect([[lag(2), kp.ConeStateSpace([[-2]], [[-1]], [[1]], 0)]], [[0]]).certificate
    yield kp.feedback_interconnect([[lag(9, 0.5), lag(9, 2.0)], lag(9, 0.9)], SWAP).certificate
    D = [[[[1.25, 0], [0, 0]]], [[[0, 0], [0, 1.25]]]]
    yield kp.feedback_interconnect(kp.stack([[[-9, 0], [0, -9]]], np.eye(2), np.eye(2), D), SWAP).certificate
    yield kp.feedback_interconnect(CROSSED, SWAP).certificate


@pytest.mark.parametrize("which", range(7))
@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_certificates_are_saved_and_checked_independently(which, suffix, tmp_path, capsys):
    found = list(some())[which]
    path = tmp_path / f"c{suffix}"
    found.save(path)
    loaded = kp.load_certificate(path)
    assert loaded == found and loaded.check() and loaded.status is found.status
    assert loaded.explain() == found.explain()
    if suffix == ".json":
        assert checker.main(path) == (0 if found else 1)
        assert capsys.readouterr().out.startswith(found.status.name)


def test_perturbed_certificates_fail():
    proved, failing, *_, mixed = some()
    for change in ({"decay_rate": 2 * proved.decay_rate}, {"v": [[-1.0], [1.0]]}, {"r": [[0.0], [0.0]]}):
        assert not replace(proved, **change).check()
    other = kp.feedback_interconnect([[lag(2), lag(0.1)], lag(7 / 3)], SWAP).models[1:]
    assert not replace(proved, vertices=other).check()
    assert not replace(failing, witness=replace(failing.witness, choice=np.zeros(2))).check()
    for choice in (np.full(2, 7.0), np.zeros(3), np.full(2, 0.5)):
        assert not replace(failing, witness=replace(failing.witness, choice=choice)).check()
    for name in ("storage", "bound"):
        w = getattr(mixed.witness, name)
        for change in ({"x": 0 * w.x}, {"x": -w.x}, {"u": 3 * w.u}, {"u": -w.u}, {"y": 0 * w.y}, {"x": w.x[:-1]}):
            assert not replace(mixed, witness=replace(mixed.witness, **{name: replace(w, **change)})).check()
    assert replace(mixed, witness=mixed.witness.storage, status=kp.Status.UNDECIDED)._evaluate()[0] == "UNDECIDED"


# -- what is refused


def test_bad_vertices_are_named():
    two, three = np.zeros((2, 1, 1, 1)) - 1, np.zeros((3, 1, 1, 1)) - 1
    with pytest.raises(ShapeError, match="A has 2 vertices, but B has 3"):
        kp.stack(two, three, [[1]])
    with pytest.raises(ShapeError, match=r"A\[1\] has shape \(2, 1, 1\), but A\[0\] has \(1, 1, 1\)"):
        kp.stack([two[0], np.concatenate([two[0], two[0]])], [[1]], [[1]])
    with pytest.raises(ShapeError, match="A is an empty list of vertices"):
        kp.stack(np.zeros((0, 1, 1, 1)), [[1]], [[1]])
    with pytest.raises(ShapeError, match=r"systems\[0\] is an empty list of vertices"):
        kp.feedback_interconnect([[], lag(1)], SWAP)
    with pytest.raises(ShapeError, match=r"systems\[0\] is a list; the vertices of a node are systems"):
        kp.feedback_interconnect([[1, 2], lag(1)], SWAP)
    with pytest.raises(ConeMismatchError, match=r"systems\[1\]: .* vertex 1 has \(2, 2, 2\), but vertex 0 \(1, 1, 1\)"):
        kp.feedback_interconnect([lag(1), [lag(1), kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0)]], SWAP)
    with pytest.raises(ConeMismatchError, match=r"systems\[0\]: .* their cones differ"):
        kp.feedback_interconnect([[lag(1), kp.ConeStateSpace([[-1]], [[1]], [[1]], 0, X=[[-1]])]], [[0]])
    with pytest.raises(DataError, match="supply_rates"):
        kp.feedback_interconnect([[lag(1), lag(2)]], [[0]], supply_rates=[([-1], [1])])
    with pytest.raises(DataError, match=r"A\[1\]"):
        kp.stack([two[0], np.full((1, 1, 1), np.nan)], [[1]], [[1]])


def test_what_is_about_one_system_refuses_networks_with_vertices():
    net = kp.feedback_interconnect([[lag(1), lag(2)], lag(3)], SWAP, name="grid")
    refused = [
        net.linear_lyapunov,
        net.cone_positivity,
        net.is_cone_positive,
        net.gain,
        net.dissipativity,
        net.spectral_abscissa,
        lambda: net.append(net),
        lambda: net.with_node(lag(1)),
        lambda: net.without_node(0),
        lambda: net.room_for(lag(1), [0], [1]),
        lambda: kp.state_feedback(net),
        lambda: kp.order_interval(net, [1, 1]),
        lambda: kp.optimal_feedback(net, [1, 1], [0, 0], [[1, 1]] * 2),
    ]
    for call in refused:
        with pytest.raises(DataError, match="grid is a network with vertices or ranges, and this is about one system"):
            call()
    stack = kp.stack([[[[-1.0]]], [[[-2.0]]]], [[1]], [[1]])
    for call in (kp.scale_free_certificate, lambda s: net.nominal.with_node(s)):
        with pytest.raises(DataError, match="has vertices, but nodes have to be known exactly here"):
            call(stack)
    assert isinstance(stack, UncertainStack) and "2 vertices" in repr(stack)


def test_as_a_state_space_it_is_its_nominal_member():
    net = kp.feedback_interconnect([[lag(1), lag(2)], lag(3)], 0.5 * np.array(SWAP), name="grid")
    np.testing.assert_array_equal(net.A, [[-1, 0.5], [0.5, -3]])
    np.testing.assert_allclose(sorted(net.poles().real), sorted(net.nominal.poles().real))
    copy = net.copy("other")
    assert (copy.name, copy.certificate.status) == ("other", net.certificate.status) and "3 vertices" not in repr(net)
    assert "2 vertices" in repr(net) and "Ask for its certificate" in net.with_links(SWAP)._repr_html_()
    assert "PROVED" in net._repr_html_() and net.copy().name != net.name


# -- cones that are not simplicial

SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])


def random_squares(rng, discrete):
    """Two nodes with four generators of X, U and Y, two vertices each, and the coupling."""
    nodes = []
    for _ in range(2):
        made = []
        for _ in range(2):
            inner = random_networks.positive_map(rng, SQUARE, SQUARE)
            inner /= np.abs(np.linalg.eigvals(inner)).max()
            A = inner * rng.uniform(0.2, 0.9) if discrete else inner - rng.uniform(1.2, 1.9) * np.eye(3)
            B, C, D = (random_networks.positive_map(rng, SQUARE, SQUARE) for _ in range(3))
            scale = 1 / (np.linalg.norm(C) * np.linalg.norm(B))
            D = 0.1 * scale * D * (rng.random() < 0.3)
            made.append(kp.ConeStateSpace(A, B * scale, C, D, discrete, X=SQUARE, U=SQUARE, Y=SQUARE))
        nodes.append(made)
    strength = 10 ** rng.uniform(-2.5, -1)
    blocks = [[strength * random_networks.positive_map(rng, SQUARE, SQUARE, 1) for _ in nodes] for _ in nodes]
    return nodes, np.block(blocks)


@pytest.mark.parametrize("seed", range(12))
def test_other_cones_are_decided_by_a_linear_program(seed):
    """PROVED iff a dense program for (v, r) is feasible; the other answers are checked by members."""
    rng = np.random.default_rng(seed)
    discrete = bool(seed % 2)
    nodes, W = random_squares(rng, discrete)
    net = kp.feedback_interconnect(nodes, W)
    found = net.certificate
    by_v = program_on_rays(nodes, W, discrete) > 1e-9
    assert found.check() and bool(found) == (by_v or program_on_rays(transposed(nodes), W.T, discrete) > 1e-9)
    assert not found or by_v == (found.e is None)
    members = [net.member(choice).certificate for choice in itertools.product(range(2), repeat=2)]
    assert all(members) or not found
    if not net.models[0].has_feedthrough and not net.models[1].has_feedthrough:
        assert found.status != "UNDECIDED"


def program_on_rays(nodes, W, discrete):
    """The largest t with w'z >= t and w'L^s z <= -t for the generators z of X and U, sum w'z = 1."""
    Z = block_diag(*(made[0].X.rays for made in nodes), *(made[0].U.rays for made in nodes))
    rows = []
    for s in range(2):
        A, B, C, D = (block_diag(*(getattr(made[s], name) for made in nodes)) for name in "ABCD")
        L = np.block([[A - discrete * np.eye(len(A)), B], [W @ C, W @ D - np.eye(len(W))]])
        rows.append(Z @ L.T)
    A_ub = np.column_stack([np.vstack([*rows, -Z]), np.ones(3 * len(Z))])
    bounds, total = [(None, None)] * (Z.shape[1] + 1), np.append(Z.sum(axis=0), 0)[None]
    return linprog(-np.eye(Z.shape[1] + 1)[-1], A_ub, np.zeros(len(A_ub)), total, [1.0], bounds).x[-1]


def crossing(gain):
    """x' = -3/2 x + B x with B = p h' for two p in the square cone, h'p = 0 for its own p and 2 gain for the other."""
    ends = ([1, 1, 1], [-1, 0, 1]), ([-1, -1, 1], [1, 0, 1])
    made = [kp.ConeStateSpace(np.diag([-1.5] * 3), np.outer(p, h), np.eye(3), 0, **SQUARES) for p, h in ends]
    return kp.feedback_interconnect([made], gain * np.eye(3))


SQUARES = {"X": SQUARE, "U": SQUARE, "Y": SQUARE}


def test_a_motion_excludes_common_vectors_on_other_cones(tmp_path):
    """Both members are stable; states that take one vertex for p and the other for the other p grow."""
    assert crossing(0.7).certificate.check()
    net = crossing(0.8)
    found = net.certificate
    assert isinstance(found.witness, kp.NoCommonVectors) and found.check()
    assert all(net.member([s]).certificate for s in range(2)) and "take different vertices" in found.explain()
    for name in ("storage", "bound"):
        w = getattr(found.witness, name)
        for change in ({"x": -w.x}, {"u": 3 * w.u}, {"y": 3 * w.y}):
            assert not replace(found, witness=replace(found.witness, **{name: replace(w, **change)})).check()
    found.save(tmp_path / "c.json")
    assert kp.load_certificate(tmp_path / "c.json").status == "REFUTED"
