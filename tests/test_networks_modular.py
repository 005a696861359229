"""Modular use: given supply rates, changed links and nodes, any number of nodes."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import cycle, is_unstable, lag, mass, random_masses

import control_kpos as kp
from control_kpos.exact.intake import exact_matrix
from control_kpos.networks import NodeNotDissipative, scale_free_certificate
from control_kpos.proof.certificate import Status

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
        n = net.model.n_nodes
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


def edits_of(net, node):
    return {
        "links": net.with_links(0.5 * net.model.W),
        "added": net.with_node(node, incoming={0: 0.25}, outgoing={1: 0.25}),
        "alone": net.with_node(node),
        "replaced": net.replace_node(1, node),
        "rewired": net.replace_node(0, node, incoming={2: 0.1}, outgoing={0: 0.1}),
        "removed": net.without_node(1),
    }


@pytest.mark.parametrize("D", [0.0, 0.2])
@pytest.mark.parametrize("dt", [0, 0.1])
def test_edited_networks_equal_fresh_ones(tmp_path, D, dt):
    nodes = [lag(0.4 if dt else 3.0 + j, D=D, dt=dt) for j in range(4)]
    net = kp.feedback_interconnect(nodes, 0.5 * cycle(4))
    for name, edited in edits_of(net, lag(0.3 if dt else 5.0, D=D, dt=dt)).items():
        fresh = kp.feedback_interconnect(_as_list(edited), edited.model.W)
        for matrix in "ABCD":
            np.testing.assert_array_equal(getattr(edited, matrix), getattr(fresh, matrix), err_msg=name)
        assert edited.certificate.status is fresh.certificate.status is Status.PROVED, name
        assert edited.certificate.check()
        edited.certificate.save(tmp_path / "edited.json")
        assert kp.load_certificate(tmp_path / "edited.json").check()


def test_certificates_are_inherited_where_nothing_has_to_be_solved():
    net = kp.feedback_interconnect([mass()] * 5, cycle(5))
    for name, edited in edits_of(net, mass()).items():
        assert vars(edited)["certificate"].check(), name  # there before anyone asked
    loud = kp.feedback_interconnect([mass()] * 5, cycle(5, 23.0))
    assert "certificate" not in vars(loud.without_node(0)) and loud.without_node(0).certificate.check()


def test_a_wrong_inheritance_is_no_proof():
    net = kp.feedback_interconnect([mass()] * 5, cycle(5))
    grown = net.with_node(mass(), incoming={0: 0.5}, outgoing={1: 0.5}).certificate
    assert grown.check() and not replace(grown, v=grown.v[::-1] * [[1.0, 3.0]]).check()
    assert not replace(grown, model=grown.model.with_coupling(exact_matrix(sp.csr_array(cycle(6, 30.0)), "W"))).check()


def test_links_of_new_nodes_are_what_was_typed():
    third = Fraction(1, 3)
    net = kp.feedback_interconnect([lag(2)] * 2, [["0", "1/7"], ["1/7", "0"]])
    grown = net.with_node(lag(2), incoming={0: "1/3"}, outgoing={1: third})
    W = grown.model.coupling.fractions()
    assert W[2, 0] == W[1, 2] == third and W[0, 1] == Fraction(1, 7) and grown.certificate.check()
    # a loop of gain exactly 1 through the new node: marginal in fractions, stable in doubles
    line = kp.feedback_interconnect([lag(1)] * 2, [[0, 0], [0, 0]])
    assert line.with_node(lag(1), incoming={0: "1/3"}, outgoing={0: 3}).certificate.status is Status.REFUTED
    assert line.with_node(lag(1), incoming={0: 1 / 3}, outgoing={0: 3}).certificate.status is Status.PROVED
    assert grown.without_node(0).model.coupling.fractions()[0, 1] == third
    assert grown.replace_node(0, lag(3)).model.coupling.fractions().tolist() == W.tolist()


def test_a_node_that_asks_for_too_much_is_decided_afresh():
    net = kp.feedback_interconnect([mass()] * 5, cycle(5))
    room = net.room_for(mass(), [0], [2])
    assert room > 10
    inside = net.with_node(mass(), incoming={0: 0.9 * room}, outgoing={2: 1.0})
    assert "certificate" in vars(inside) and inside.certificate.check()
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
        assert ("certificate" in vars(grown)) is covered
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
