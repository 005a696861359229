"""Networks with ranges of links and of nodes on orthants: decided by their ends, saved, refused where wrong."""

from dataclasses import replace
from fractions import Fraction

import networkx as nx
import numpy as np
import pytest
from network_examples import CONE, cycle, lag, sparse_ring

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import ConeMismatchError, DataError, ShapeError


def in_range(low, high, size=1):
    """x' = -a x + u, y = x with a between `low` and `high`, at so many nodes."""
    ends = (np.full((size, 1, 1), -float(a)) for a in (high, low))
    return kp.stack(kp.interval(*ends), [[1]], [[1]])


@pytest.mark.parametrize("seed", range(40))
def test_ranges_are_decided_by_their_upper_ends(seed):
    """PROVED iff the network of the upper ends is stable; then members drawn from the ranges are."""
    rng = np.random.default_rng(seed)
    discrete, n, N = bool(seed % 2), 2, 3
    ends = {}
    for name, shape in (("A", (n, n)), ("B", (n, 1)), ("C", (1, n)), ("D", (1, 1))):
        low = rng.uniform(0, 0.3, (N, *shape)) * (seed % 3 > 0 or name != "D")
        ends[name] = low, low + rng.uniform(0, 0.3, (N, *shape)) * (seed % 3 > 0 or name != "D")
    if not discrete:
        ends["A"] = tuple(end - 1.2 * np.eye(n) for end in ends["A"])
    W = rng.uniform(0, 0.5, (N, N))
    upper = W + rng.uniform(0, rng.choice([0.1, 3]), (N, N))
    nodes = kp.stack(*(kp.interval(*ends[name]) for name in "ABCD"), dt=discrete)
    net = kp.feedback_interconnect(nodes, kp.interval(W, upper))
    highest = kp.feedback_interconnect(kp.stack(*(ends[name][1] for name in "ABCD"), dt=discrete), upper)
    found = net.certificate
    assert found.check() and found.status is highest.certificate.status
    assert ("what has a range is anywhere in it" if found else "network itself is refuted") in found.explain()
    if found:
        part = {name: low + rng.uniform(0, 1, low.shape) * (high - low) for name, (low, high) in ends.items()}
        between = kp.stack(*(part[name] for name in "ABCD"), dt=discrete)
        member = kp.feedback_interconnect(between, W + rng.uniform(0, 1, W.shape) * (upper - W))
        assert member.certificate and member.certificate.decay_rate > 0
        assert not replace(found, lower=highest.with_links(upper + 1).model).check()
        swapped = replace(found, model=found.lower, lower=found.model)
        assert not swapped.check()


def test_upper_ends_of_links_alone_prove_nothing():
    """1/(s + 1) twice with weights in [-10, 1/2]: -10 twice has the eigenvalue 9, in the coordinates (x, -y)."""
    weight = kp.interval(-10, 0.5)
    found = kp.feedback_interconnect([lag(1), lag(1)], [[0, weight], [weight, 0]]).certificate
    assert found.status == "REFUTED" and found.check() and list(found.witness.signs) in ([1, -1], [-1, 1])
    assert (
        "signs of all signals turned at 1 nodes" in found.explain()
        and "the network itself is refuted" in found.explain()
    )
    for change in ({"signs": np.ones(2)}, {"signs": -2 * found.witness.signs}, {"signs": np.ones(3)}, {"signs": None}):
        assert not replace(found, witness=replace(found.witness, **change)).check()
    one = kp.feedback_interconnect([lag(1), lag(1)], [[0, weight], [1, 0]]).certificate  # no member of one sign is bad
    assert one.status == "REFUTED" and one.check() and isinstance(one.witness, kp.FailingEnd)
    assert "at the lower ends of the ranges, W does not map Y into U" in one.explain()
    assert kp.feedback_interconnect([lag(1), lag(1)], [[0, kp.interval(0, 0.5)], [weight.upper, 0]]).certificate


def test_a_node_that_is_not_positive_at_its_lower_end_is_named():
    nodes = kp.stack([[[-1.0]], [[-1.0]]], kp.interval([[[0]], [["-4/3"]]], [[[1]], [[1]]]), [[1]])
    found = kp.feedback_interconnect(nodes, 0.9 * cycle(2)).certificate
    assert found.status == "REFUTED" and found.check() and "at the lower ends of the ranges, node 1" in found.explain()


def test_ranges_stand_beside_vertices_and_other_cones():
    """A node in a range, one with vertices, a mass on the cone of the paper, a block and a weight in ranges."""
    mass = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=CONE)
    nodes = [in_range(2, 3), [lag(2), lag(3)], mass]
    W = [[0, kp.interval("1/3", 1), 0], [0, 0, 1], [kp.interval(0, 0.5), 0, 0]]
    net = kp.feedback_interconnect(nodes, W)
    found = net.certificate
    assert found.check() and "2 vertices with ranges" in found.explain()
    assert net.model.coupling.fractions()[0, 1] == 1 and net.lower_ends.model.coupling.fractions()[0, 1] == Fraction(
        1, 3
    )
    assert net.lower_ends.certificate and net.nominal.certificate
    assert net.with_links(cycle(3)).certificate.lower is not None and net.with_links(60 * cycle(3)).certificate.witness
    known = kp.feedback_interconnect([lag(1), lag(1)], [[0, kp.interval(0, 0.5)], [1, 0]])
    assert known.with_links(0.5 * cycle(2)).lower is None


@pytest.mark.parametrize("seed", range(10))
def test_vertices_and_ranges_stand_in_one_stack(seed):
    """A is a list of vertices and B, C are ranges: proven iff the vertices are with the upper ends."""
    rng = np.random.default_rng(seed)
    N, discrete = 3, bool(seed % 2)
    A = rng.uniform(0, 0.3, (2, N, 2, 2)) - (0 if discrete else 1.3) * np.eye(2)
    B, C = ((low, low + rng.uniform(0, 0.3, low.shape)) for low in rng.uniform(0, 0.3, (2, N, 2)))
    B, C = [end[:, :, None] for end in B], [end[:, None, :] for end in C]
    W = rng.uniform(0, 10 ** rng.uniform(-1, 1), (N, N))
    found = kp.feedback_interconnect(kp.stack(A, kp.interval(*B), kp.interval(*C), dt=discrete), W).certificate
    highest = kp.feedback_interconnect(kp.stack(A, B[1], C[1], dt=discrete), W).certificate
    assert found.check() and found.status is highest.status
    for _ in range(3 if found else 0):
        a, b, c = rng.uniform(0, 1, (3, N, 1, 1))
        member = kp.stack(*(x + t * (y - x) for t, (x, y) in zip((a, b, c), (A, B, C), strict=True)), dt=discrete)
        assert kp.feedback_interconnect(member, rng.uniform(0, 1, W.shape) * W).certificate


def test_ranges_are_weights_of_graphs():
    graph = nx.DiGraph()
    graph.add_edge("a", "b", weight=kp.interval("1/3", "1/2"))
    graph.add_edge("b", "a")
    net = kp.feedback_interconnect([lag(1), lag(2)], graph)
    assert net.certificate and net.model.names == ["a", "b"] and repr(net).endswith("2 outputs, ranges>")
    assert net.lower.coupling.fractions().tolist() == [[0, 1], [Fraction(1, 3), 0]]
    assert net.model.coupling.values.toarray().tolist() == [[0, 1], [0.5, 0]]
    graph.add_edge("b", "a", weight=kp.interval(0, 4))
    assert net.with_links(graph).certificate.status == "REFUTED"
    both = nx.Graph()
    both.add_edge(0, 1, weight=kp.interval(-0.9, 0.5))
    assert kp.feedback_interconnect([lag(1), lag(1)], both).certificate.e is not None
    with pytest.raises(DataError, match="coupling weights"):
        kp.scale_free_certificate([lag(1), lag(1)], 0.5).interconnect(both)


def test_blocks_and_other_cones_of_links_have_ranges_in_the_order_of_their_cones():
    """U = Y = cone{(1, 1), (1, -1)}: W in a range if what is between the ends maps Y into U."""
    wedge = kp.PolyhedralCone([[1, 1], [1, -1]])
    node = kp.ConeStateSpace(-3 * np.eye(2), np.eye(2), np.eye(2), 0, X=wedge, U=wedge, Y=wedge)
    low, high = 0.5 * np.eye(2), np.array([[1, 0.25], [0.25, 1]])
    found = kp.feedback_interconnect([node, node], [[None, kp.interval(low, high)], [np.eye(2), None]]).certificate
    assert found and found.check()
    beyond = kp.interval(low, np.array([[1, 1], [0, 1]]))  # entries are above, but what is between maps (1, 1) out of U
    assert not kp.feedback_interconnect([node, node], [[None, beyond], [np.eye(2), None]]).certificate


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_certificates_of_ranges_are_saved_and_checked_independently(suffix, tmp_path, capsys):
    nodes = kp.stack(kp.interval([["-7/3"]], [["-5/3"]]), [["1/3"]], [[1]], kp.interval([[0]], [[0.25]]))
    for W in ([[kp.interval(0, "1/3")]], [[kp.interval(-1, "1/3")]], [[kp.interval(0, 3)]]):
        found, path = kp.feedback_interconnect(nodes, W).certificate, tmp_path / f"c{suffix}"
        found.save(path)
        loaded = kp.load_certificate(path)
        assert loaded == found and loaded.check() and loaded.explain() == found.explain()
        assert suffix != ".json" or checker.main(path) == (0 if found else 1)
    assert "WRONG" not in capsys.readouterr().out


def test_bad_ranges_are_named():
    with pytest.raises(DataError, match=r"lower is above upper at \[1, 0\]: 3.0 > 2.0"):
        kp.interval([[0], [3]], [[1], [2]])
    with pytest.raises(DataError, match=r"lower is above upper at \[0\]: 1/3 > 0.25"):
        kp.interval("1/3", "1/4")
    with pytest.raises(DataError, match="lower is above upper"):
        kp.interval(sparse_ring(3), 0.5 * sparse_ring(3))
    with pytest.raises(ShapeError, match=r"lower has shape \(1,\), but upper has \(2,\)"):
        kp.interval([1], [1, 2])
    with pytest.raises(DataError, match="lower is a range itself"):
        kp.interval(kp.interval(0, 1), 2)
    with pytest.raises(DataError, match="upper"):
        kp.interval(0, np.nan)
    with pytest.raises(ConeMismatchError, match="X is no nonnegative orthant; ranges of entries are for orthants"):
        kp.stack(kp.interval([[[0, 1], [-23, -13]]], [[[0, 1], [-22, -13]]]), [[0], [1]], [[1, 0]], X=CONE)
    with pytest.raises(DataError, match="A is a range of several stacks; a range is the same for all vertices"):
        kp.stack(kp.interval([[[[-2]]]] * 2, [[[[-1]]]] * 2), [[[[1]]], [[[2]]]], [[1]])
    with pytest.raises(DataError, match="A"):
        kp.stack([kp.interval([[[-2]]], [[[-1]]])] * 2, [[1]], [[1]])
    with pytest.raises(ShapeError, match="A has 2 vertices, but B has 3"):
        kp.stack([[[[-2]]]] * 2, [[[[1]]]] * 3, kp.interval([[0]], [[1]]))
    with pytest.raises(ShapeError, match="A has shape"):
        kp.stack(kp.interval(np.zeros((0, 1, 1)), np.zeros((0, 1, 1))), [[1]], [[1]])
    with pytest.raises(ConeMismatchError, match="coupling is 1 x 1"):
        kp.feedback_interconnect([lag(1), lag(1)], kp.interval([[0]], [[1]]))
