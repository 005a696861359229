"""plot_network, plot_poles: what is drawn is what the certificates say."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.plotting import network
from control_kpos.plotting.network import graph_layout

LINKS, NODES, MARKS = 0, 1, 2


@pytest.fixture
def net():
    A, B, C, D = kp.examples.mass_spring_nodes(10)
    return kp.feedback_interconnect(kp.stack(A, B, C, D, X=kp.examples.paper_cone()), kp.examples.ring(10), name="ten")


def test_nodes_are_coloured_by_their_margins(net):
    cplt = kp.plot_network(net)
    (nodes,) = cplt.lines[NODES]
    np.testing.assert_array_equal(nodes.get_array(), net.certificate.node_margins)
    weakest = int(np.argmin(net.certificate.node_margins))
    np.testing.assert_array_equal(cplt.lines[MARKS][0].get_offsets()[0], nodes.get_offsets()[weakest])
    assert cplt.figure.get_suptitle() == "ten: 10 nodes, PROVED"


def test_every_link_is_drawn_between_its_ends(net):
    cplt = kp.plot_network(net)
    xy = cplt.lines[NODES][0].get_offsets()
    segments = cplt.lines[LINKS][0].get_segments()
    assert len(segments) == net.model.W.nnz
    for j in range(10):  # node j listens to node j + 1
        assert any(np.allclose(s, [xy[(j + 1) % 10], xy[j]]) for s in segments)


def test_what_breaks_a_network_is_marked(net):
    unstable = net.with_links(40 * net.model.W)
    assert not unstable.certificate
    assert network.broken_nodes(unstable).size
    W = net.model.W.copy()
    W[2, 3] = -1.0
    cplt = kp.plot_network(net.with_links(W))
    assert cplt.lines[MARKS][0].get_offsets().shape == (2, 2)
    assert cplt.legend.get_texts()[0].get_text() == "what breaks it"


def test_large_networks_show_their_pattern():
    A, B, C, D = kp.examples.mass_spring_nodes(network.MOST_NODES + 2)
    net = kp.feedback_interconnect(kp.stack(A, B, C, D, X=kp.examples.paper_cone()), kp.examples.ring(len(A)))
    (pattern,) = kp.plot_network(net).lines[LINKS]
    assert len(pattern.get_xydata()) == net.sparse_A.nnz


def test_positions_are_taken(net):
    xy = np.random.default_rng(0).normal(size=(10, 2))
    np.testing.assert_array_equal(kp.plot_network(net, positions=xy).lines[NODES][0].get_offsets(), xy)
    by_name = dict(zip(net.model.names, xy, strict=True))
    np.testing.assert_array_equal(kp.plot_network(net, positions=by_name).lines[NODES][0].get_offsets(), xy)
    with pytest.raises(kp.ShapeError, match="10 x 2"):
        kp.plot_network(net, positions=xy[:3])
    with pytest.raises(kp.DataError, match="node"):
        kp.plot_network(net, positions={})


def test_layout_of_a_ring_is_a_circle():
    xy = graph_layout(kp.examples.ring(12))
    radii = np.linalg.norm(xy - xy.mean(axis=0), axis=1)
    assert np.ptp(radii) < 0.05 * radii.mean()


def test_layout_keeps_separate_parts_apart():
    W = kp.examples.ring(4).toarray()
    xy = graph_layout(kp.feedback_interconnect([kp.examples.mass_spring_node()] * 8, np.kron(np.eye(2), W)).model.W)
    assert np.isfinite(xy).all()
    assert np.linalg.norm(xy[:4].mean(axis=0) - xy[4:].mean(axis=0)) > 1


def test_poles_lie_left_of_the_certified_bound(net):
    cplt = kp.plot_poles(net)
    (poles,) = cplt.lines[0]
    bound = cplt.lines[1][0].get_xdata()[0]
    assert len(poles.get_xdata()) == net.nstates
    assert max(poles.get_xdata()) <= bound
    assert bound == net.spectral_abscissa()[1]


def test_poles_in_discrete_time_lie_in_the_disc():
    net = kp.feedback_interconnect([kp.examples.mass_spring_node().sample(0.1)] * 4, kp.examples.ring(4))
    cplt = kp.plot_poles(net, k=3)
    (poles,) = cplt.lines[0]
    assert len(poles.get_xdata()) == 3
    assert np.hypot(*poles.get_data()).max() <= cplt.lines[1][1].get_radius() * (1 + 1e-9)


@pytest.mark.parametrize("draw", [kp.plot_network, kp.plot_poles])
def test_only_networks_are_drawn(draw):
    with pytest.raises(kp.DataError, match="feedback_interconnect"):
        draw(kp.examples.mass_spring_node())


def test_pictures_go_into_given_axes(net):
    figure, axes = plt.subplots(1, 2)
    assert kp.plot_network(net, axes[0], title="left").figure is figure
    assert kp.plot_poles(net, axes[1]).axes[0, 0] is axes[1]
    assert axes[0].get_title() == "left"


def test_different_pictures_do_not_share_axes():
    plt.close("all")
    net = kp.feedback_interconnect([kp.examples.mass_spring_node()] * 4, kp.examples.ring(4))
    poles, again, graph = kp.plot_poles(net), kp.plot_poles(net), kp.plot_network(net)
    assert again.figure is poles.figure
    assert graph.figure is not poles.figure
    figure, ax = plt.subplots()
    ax.semilogy([1.0, 2.0], [1e-9, 1.0])
    assert kp.plot_network(net).figure is not figure
    plt.close("all")
