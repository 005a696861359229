"""Couplings and nodes in all their forms, and the messages for those that do not fit."""

from dataclasses import replace
from fractions import Fraction

import control as ct
import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import CONE, cycle, lag, mass, random_masses

import control_kpos as kp
from control_kpos.proof.certificate import Status

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


def test_graphs_with_labels_of_any_kind():
    graph = nx.Graph()
    graph.add_nodes_from(["tank", ("pump", 1), 7])
    graph.add_edge(7, "tank", weight="1/3")
    net = kp.feedback_interconnect([lag(5), lag(6), lag(7)], graph)
    assert net.model.names == ["tank", "('pump', 1)", "7"] and net.input_labels[0] == "tank_u[0]"
    assert net.model.coupling.fractions()[2, 0] == net.model.coupling.fractions()[0, 2] == Fraction(1, 3)
    assert not kp.feedback_interconnect([lag(5)] * 2, nx.DiGraph([(1, 0)])).model.stacks[0].names  # numbers
    other = kp.feedback_interconnect([lag(5, name="a"), lag(6, name="b")], nx.DiGraph([("u", "v")]))
    assert other.model.names == ["a", "b"] and other.model.W[1, 0] == 1
    with pytest.raises(kp.ConeMismatchError, match="a node 'u' that is no name of a system, although others are"):
        kp.feedback_interconnect([lag(5, name="a"), lag(6, name="b")], nx.DiGraph([("a", "u")]))
    wide = kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0, name="wide")
    with pytest.raises(kp.ConeMismatchError, match=r"node 1 \(.wide.\) has 2 inputs and 2 outputs; graphs couple"):
        kp.feedback_interconnect([lag(1), wide], nx.path_graph(2))


def test_plain_systems_get_orthants():
    plain = ct.ss([[-3.0, 1.0], [0.5, -4.0]], [[1], [0]], [[0, 1]], 0, name="plain")
    mixed = kp.feedback_interconnect([plain, lag(2)], cycle(2))
    cones = kp.feedback_interconnect([kp.ConeStateSpace(plain), lag(2)], cycle(2))
    assert mixed.certificate.status is Status.PROVED and kp.orthant(3) == mixed.X
    np.testing.assert_array_equal(mixed.A, cones.A)
    assert kp.feedback_interconnect([ct.ss(-1, -1, 1, 0)] * 2, cycle(2)).certificate.status is Status.REFUTED
    assert kp.feedback_interconnect(ct.ss(-2, 1, 1, 0), [[1]]).certificate.status is Status.PROVED


def test_blocks_of_fractions():
    net = kp.feedback_interconnect([lag(2)] * 2, [[None, [["1/3"]]], [[[0.5]], None]])
    assert net.model.coupling.fractions()[0, 1] == Fraction(1, 3)
    assert net.certificate.status is Status.PROVED


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
    with pytest.raises(kp.TimebaseError, match=r"systems\[1\] has dt = 0.1, but systems\[0\] has dt = 0"):
        kp.feedback_interconnect([lag(0.5), lag(0.5, dt=0.1)], cycle(2))
    with pytest.raises(kp.TimebaseError, match=r"systems\[1\] has dt = 0.1, but systems\[0\] has dt = 0.2"):
        kp.feedback_interconnect([kp.stack([[[0.5]]], [[1]], [[1]], dt=0.2), lag(0.5, dt=0.1)], cycle(2))
    assert kp.feedback_interconnect([lag(0.5, dt=True), lag(0.5, dt=0.1)], cycle(2, 0.1)).dt == 0.1


# -- bad input


@pytest.mark.parametrize(
    ("coupling", "error", "words"),
    [
        (np.zeros((2, 3)), kp.ConeMismatchError, "coupling is 2 x 3, but the nodes have 2 inputs and 2 outputs"),
        (sp.eye_array(3), kp.ConeMismatchError, "coupling is 3 x 3, but the nodes have 2 inputs and 2 outputs"),
        (0.5, kp.ConeMismatchError, "coupling is 1 x 1"),
        (np.array([[0, np.nan], [1, 0]]), kp.DataError, "nan"),
        (sp.csr_array([[0, np.nan], [1, 0]]), kp.DataError, "nan"),
        (sp.lil_matrix([[0, np.inf], [1, 0]]), kp.DataError, "inf"),
        (sp.coo_array(([1e308, 1e308], ([0, 0], [1, 1])), shape=(2, 2)), kp.DataError, "inf"),  # their sum
        ([[None, [[np.nan]]], [None, None]], kp.DataError, r"coupling\[0\]\[1\]\[0, 0\] is nan"),
        ([[None, [[1]]]], kp.ConeMismatchError, "1 block rows of .* but there are 2 nodes"),
        (None, kp.DataError, "None"),
        ("ring", kp.DataError, "'ring'"),
        (np.array([[0, np.inf], [1, 0]]), kp.DataError, "inf"),
        ([[0, 1], [1]], kp.ShapeError, "ragged"),
        (nx.MultiDiGraph([(0, 1), (0, 1)]), kp.DataError, "multigraph"),
        (nx.MultiGraph([(0, 1), (0, 1)]), kp.DataError, "multigraph"),
        (nx.DiGraph([(0, 1, {"weight": np.nan})]), kp.DataError, "weights.* nan"),
        (nx.DiGraph([(0, 1, {"weight": "heavy"})]), kp.DataError, "'heavy'"),
        (nx.path_graph(3), kp.ConeMismatchError, "3 nodes, but there are 2"),
        (1j * np.eye(2), kp.DataError, "complex"),
    ],
)
def test_bad_couplings_are_refused_by_name(coupling, error, words):
    with pytest.raises(error, match=words):
        kp.feedback_interconnect([lag(1)] * 2, coupling)


def test_out_of_range_sparse_entries_are_refused():
    for index in (7, -1):
        rows = sp.csr_array(np.eye(2))
        rows.indices = np.array([0, index], dtype=rows.indices.dtype)
        triplets = sp.coo_array(np.eye(2))
        triplets.coords = (np.array([0, index]), np.array([0, 1]))
        for broken in (rows, triplets):
            with pytest.raises(kp.ShapeError, match="coupling"):
                kp.feedback_interconnect([lag(1)] * 2, broken)
    backwards = sp.csr_array(np.eye(2))
    backwards.indptr = np.array([0, 3, 2], dtype=backwards.indptr.dtype)
    with pytest.raises(kp.ShapeError, match="coupling is not a valid sparse matrix"):
        kp.feedback_interconnect([lag(1)] * 2, backwards)


def test_the_node_with_other_ports_is_named():
    nodes = [lag(1, name="a"), kp.ConeStateSpace([[-1.0]], [[1.0, 0.0]], [[1.0]], 0, name="fork")]
    sizes = r'2 x 2, but the nodes have 3 inputs and 2 outputs in all \(node 1 \("fork"\) has 2 inputs'
    with pytest.raises(kp.ConeMismatchError, match=sizes):
        kp.feedback_interconnect(nodes, np.zeros((2, 2)))
    with pytest.raises(kp.ConeMismatchError, match=r'"fork"\) has 2 inputs and 1 outputs; graphs couple nodes'):
        kp.feedback_interconnect(nodes, nx.path_graph(2))


def test_graphs_of_named_systems():
    named = [lag(1, name="a"), lag(1, name="b")]
    with pytest.raises(kp.ConeMismatchError, match="a node 'c'"):
        kp.feedback_interconnect(named, nx.DiGraph([("a", "c")]))
    with pytest.raises(kp.ConeMismatchError, match="two systems are called 'a'"):
        kp.feedback_interconnect([named[0]] * 2, nx.DiGraph([("a", "b")]))
    assert kp.feedback_interconnect([named[0]] * 2, nx.DiGraph([(0, 1)])).model.W.toarray().tolist() == [[0, 0], [1, 0]]


def test_links_out_of_the_cones_are_a_verdict_with_the_pair():
    """Not an exception, whatever the form of the coupling: h'W_jk y < 0 for the facet and the generator named."""
    U = kp.PolyhedralCone([[1, 1], [1, -1]])
    node = kp.ConeStateSpace(-4 * np.eye(2), np.eye(2), np.eye(2), 0, X=U, U=U, Y=U)
    block = np.diag([1.0, 2.0])
    W = np.kron([[0, 0, 0], [0, 0, 0.1], [0, 0, 0]], block)
    blocks = [[None] * 3, [None, None, 0.1 * block], [None] * 3]
    for form in (W, sp.csr_array(W), blocks):
        for rates in (None, [([-1, 0], [1, 0])] * 3):
            certificate = kp.feedback_interconnect([node] * 3, form, supply_rates=rates).certificate
            w = certificate.witness
            assert certificate.status is Status.REFUTED and (w.target, w.source) == (1, 2) and certificate.check()
            h, y = U.exact_facets.fractions()[w.facet], U.exact_rays.fractions()[w.ray]
            product = h @ (Fraction(0.1) * np.diag([1, 2]).astype(object)) @ y
            assert product < 0 and w.value == float(product)
            for value in (np.nextafter(w.value, 0), np.nextafter(w.value, -9)):  # a unit in the last place is seen
                assert not replace(certificate, witness=replace(w, value=value)).check()
            assert "node 2 to node 1" in certificate.explain()
    exact = kp.feedback_interconnect([lag(1)] * 2, [["0", "-1/1000000000000000000000"], ["0", "0"]]).certificate
    assert exact.status is Status.REFUTED and (exact.witness.target, exact.witness.source) == (0, 1)


@pytest.mark.parametrize(
    ("rates", "error", "words"),
    [
        ([(-1, 1)], kp.ShapeError, "supply_rates has 1 entries; 2 nodes"),
        ([(-1, 1)] * 3, kp.ShapeError, "supply_rates has 3 entries; 2 nodes"),
        ([(-1, 1), (-1, [1, 2])], kp.ShapeError, r"r in supply_rates\[1\] has 2 entries; it must have 1"),
        ([(-1, 1), ([-1, -2], 1)], kp.ShapeError, r"q in supply_rates\[1\] has 2 entries; it must have 1"),
        ([(-1, 1), ([], 1)], kp.ShapeError, r"q in supply_rates\[1\]"),
        ([(-1, 1), (-1, 1, 1)], kp.ShapeError, r"supply_rates\[1\] must be a pair"),
        ([(-1, 1), -1], kp.ShapeError, r"supply_rates\[1\] must be a pair"),
        ([(-1, 1), (np.nan, 1)], kp.DataError, "nan"),
    ],
)
def test_bad_supply_rates_are_refused_by_name(rates, error, words):
    with pytest.raises(error, match=words):
        kp.feedback_interconnect([lag(1)] * 2, cycle(2), supply_rates=rates)


def test_other_bad_input():
    with pytest.raises(kp.ShapeError, match="empty"):
        kp.feedback_interconnect([], np.zeros((0, 0)))
    with pytest.raises(kp.ShapeError, match=r"systems\[1\] is a TransferFunction"):
        kp.feedback_interconnect([lag(1), ct.tf(1, [1, 1])], cycle(2))
    with pytest.raises(kp.NotProperConeError, match="X is not solid"):
        kp.stack(-np.eye(2)[None], np.ones((2, 1)), np.ones((1, 2)), X=kp.PolyhedralCone([[1, 0]]))
    with pytest.raises(kp.ShapeError, match=r"B has shape \(1, 3, 1\)"):
        kp.stack(-np.eye(2)[None], np.ones((3, 1)), np.ones((1, 2)))
    line = kp.PolyhedralCone([[1], [-1]])
    for name in ("U", "Y"):
        with pytest.raises(kp.NotProperConeError, match=f"{name} is not pointed"):
            kp.stack(-np.ones((2, 1, 1)), [[1]], [[1]], **{name: line})
    with pytest.raises(kp.ShapeError, match="at least one node"):
        kp.stack(np.zeros((0, 1, 1)), [[1]], [[1]])
    with pytest.raises(kp.ShapeError, match="empty"):
        kp.feedback_interconnect((node for node in ()), np.zeros((0, 0)))
    with pytest.raises(kp.DataError, match=r"A\[1, 0, 0\] is inf"):
        kp.stack([[[-1]], [[np.inf]]], [[1]], [[1]])
    with pytest.raises(TypeError):
        kp.feedback_interconnect([lag(1)] * 2, cycle(2), colour="red")
