"""Local gains for whole networks, uniform gains, and gains that are good for any number of nodes."""

import warnings
from dataclasses import replace
from fractions import Fraction

import numpy as np
import planted
import pytest
import scipy.linalg
import scipy.sparse as sp
from certified import third
from exact_plants import THIRD

import control_kpos as kp
from control_kpos import checker
from control_kpos.exact.matrix import Matrix

PAPER = kp.PolyhedralCone([[0, 1], [1, -2]])

# the mass on a spring is positive on this cone with feedback only
pytestmark = pytest.mark.filterwarnings("ignore::control_kpos.ActuatorLossWarning")


def node(k=1.0):
    return kp.ConeStateSpace([[0, 1], [-k, 0]], [[0], [1]], [[1, 0]], 0, X=PAPER)


def ring(n):
    return sp.csr_array(np.roll(np.eye(n), 1, axis=1))


def random_network(n, seed=0, degree=3, weight=1.0):
    rng = np.random.default_rng(seed)
    A = np.zeros((n, 2, 2))
    A[:, 0, 1], A[:, 1, 0] = 1, -rng.uniform(0.5, 2, size=n)
    where = (np.repeat(np.arange(n), degree), rng.integers(0, n, size=degree * n))
    W = sp.csr_array((weight * rng.uniform(0, 1, size=degree * n), where), shape=(n, n))
    return kp.stack(A, [[0], [1]], [[1, 0]], X=PAPER), W, A


# -- scale-free gains, section V.B


@pytest.mark.parametrize("weight", [0, 1, 5])
def test_one_node_program_serves_rings_of_any_size(weight):
    d = kp.scale_free_feedback(node(), weight)
    assert d and d.check()
    for n in (1, 2, 3, 10, 400):
        net = kp.feedback_interconnect([d.closed_loop] * n, weight * ring(n))
        assert net.certificate and net.spectral_abscissa()[1] <= -d.decay_rate + 1e-9


def test_scale_free_gain_serves_random_graphs_and_heavier_links_break_it():
    d = kp.scale_free_feedback(node(), 2, rate=0.2)
    rng = np.random.default_rng(1)
    for n in (5, 50):
        W = rng.uniform(size=(n, n)) * (rng.uniform(size=(n, n)) < 0.3)
        W = 2 * W / np.maximum(W.sum(axis=0), 1e-9)  # out-weights
        for coupling in (W, W.T):  # and in-weights
            net = kp.feedback_interconnect([d.closed_loop] * n, coupling)
            assert net.certificate and net.spectral_abscissa()[1] <= -0.2 + 1e-9
    heavy = kp.feedback_interconnect([d.closed_loop] * 5, 50 * ring(5))
    assert not heavy.certificate


def test_weight_decides():
    assert kp.scale_free_feedback(node(), 5, gain_bound=5.5)
    d = kp.scale_free_feedback(node(), 50, gain_bound=5.5)
    assert d.status is kp.Status.REFUTED and d.check() and d.nearest.gain_bound == pytest.approx(27, rel=1e-2)


def test_scale_free_certificate_needs_its_parts():
    c = kp.scale_free_feedback(node(), 1).certificate
    assert not replace(c, weight=2.0).check()
    assert not replace(c, local=kp.scale_free_feedback(node(), 2).certificate.local).check()
    assert c.covers(ring(5)) and not c.covers(2 * ring(5))
    assert c.interconnect(ring(5)).__dict__["certificate"].check()


def test_scale_free_saving(tmp_path):
    kp.scale_free_feedback(node(), 1).certificate.save(tmp_path / "c.json")
    assert kp.load_certificate(tmp_path / "c.json").status is kp.Status.PROVED


def test_scale_free_refusals():
    with pytest.raises(kp.DataError, match="weight is -1"):
        kp.scale_free_feedback(node(), -1)
    with pytest.raises(kp.ShapeError, match="one input"):
        kp.scale_free_feedback(kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0), 1)
    d = kp.scale_free_feedback(kp.ConeStateSpace(node(), X=[[0, -1], [1, 2]]), 1)
    assert d.status is kp.Status.REFUTED


# -- local gains


@pytest.mark.parametrize("n", [1, 2, 7])
def test_ring_of_paper_plants(n):
    d = kp.network_feedback([node()] * n, ring(n), rate=0.5)
    assert d and d.check() and d.F.shape == (n, 1, 2)
    closed = np.kron(np.eye(n), node().A) + np.kron(ring(n).toarray(), [[0, 0], [1, 0]])
    for j in range(n):
        closed[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] += node().B @ d.F[j]
    np.testing.assert_allclose(d.closed_loop.A, closed, atol=1e-12)
    assert np.linalg.eigvals(closed).real.max() <= -0.5 + 1e-9
    assert d.value == pytest.approx(5 if n > 1 else 4, rel=0.06)  # alone, its link helps: F + W C


def test_different_nodes_with_a_bound():
    stack, W, A = random_network(300)
    d = kp.network_feedback(stack, W, gain_bound=15, rate=0.1)
    assert d and d.check() and d.decay_rate >= 0.1
    used = np.abs(np.einsum("jma,ka->jmk", d.F, PAPER.rays))
    assert used.max() <= 15
    np.testing.assert_allclose(d.closed_loop.model.stacks[0].A.values[:, 1], A[:, 1] + d.F[:, 0], atol=1e-12)


def test_nodes_of_different_sizes():
    small = kp.ConeStateSpace([[1.0]], [[1.0]], [[1.0]], 0)
    d = kp.network_feedback([node(), small, node(2.0)], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], rate=0.2)
    assert d and isinstance(d.F, tuple) and [f.shape for f in d.F] == [(1, 2), (1, 1), (1, 2)]
    assert [k.shape for k in d.K] == [(1, 2), (1, 1), (1, 2)]


def test_discrete_time_network():
    part = kp.ConeStateSpace([[1.1, 0.1], [0.2, 0.5]], [[1], [0]], [[0, 1]], 0, 1)
    d = kp.network_feedback([part] * 4, 0.3 * ring(4), rate=0.1)
    assert d and d.check()
    assert np.abs(np.linalg.eigvals(d.closed_loop.A)).max() <= 0.9 + 1e-9


def in_other_units(systems, states, inputs):
    """Nodes with x scaled by `states` and u by `inputs`, node by node; cones go along."""
    out = []
    for sys, S, e in zip(systems, states, inputs, strict=True):
        A, B, C = (np.asarray(M) for M in (sys.A, sys.B, sys.C))
        X = kp.PolyhedralCone(sys.X.rays * S)
        out.append(kp.ConeStateSpace(S[:, None] * A / S, S[:, None] * B / e, C / S, 0, X=X))
    return out


@pytest.mark.parametrize("bounded", [False, True], ids=["smallest gain", "bounded"])
@pytest.mark.parametrize("decades", [3, 6])
def test_units_of_the_nodes_change_no_verdict(decades, bounded):
    rng = np.random.default_rng(decades)
    nodes = [node(k) for k in (0.5, 1.0, 2.0, 1.5)]
    states = [2.0 ** rng.integers(-3.3 * decades, 3.3 * decades, size=2) for _ in nodes]
    W = sp.csr_array(ring(4) + 0.3 * ring(4) @ ring(4))
    d = kp.network_feedback(nodes, W, rate=0.5, **({"gain_bound": 12.0} if bounded else {}))
    scaled = in_other_units(nodes, states, np.ones(4))
    # the same gains in the other units, as they are measured there
    needed = [np.abs((F / S) @ planted.unit(sys.X.rays).T).max() for F, S, sys in zip(d.F, states, scaled, strict=True)]
    bounds = {"gain_bound": 1.1 * np.array(needed)} if bounded else {}
    e = kp.network_feedback(scaled, W, rate=0.5, **bounds)
    assert d and e and e.check() and e.decay_rate >= 0.5
    used = [np.abs(G @ planted.unit(sys.X.rays).T).max() for G, sys in zip(e.F, scaled, strict=True)]
    if bounded:
        assert (used <= bounds["gain_bound"] * (1 + 1e-12)).all()
    else:
        assert max(used) <= 1.06 * max(needed)
    for S, G, sys in zip(states, e.F, nodes, strict=True):
        assert kp.linear_lyapunov(sys.A + sys.B @ (G * S), sys.X)


def test_units_of_the_inputs_only_scale_the_gains():
    nodes, inputs = [node(k) for k in (0.5, 2.0, 1.0)], np.array([1e6, 1e-6, 1.0])
    W = ring(3).toarray()
    scaled = in_other_units(nodes, np.ones((3, 2)), inputs)
    for units, systems in ((np.ones(3), nodes), (inputs, scaled)):
        d = kp.network_feedback(systems, W * units[:, None], rate=0.5, gain_bound=9 * units)
        assert d and d.check() and d.decay_rate >= 0.5 and d.value <= 1


def test_a_grid_in_si_units():
    """Angles of 1e-6 beside powers of 1e6 on the orthant, where the generators do not follow the units."""
    rng = np.random.default_rng(0)
    nodes = []
    for _ in range(30):
        A = rng.uniform(0.1, 1, size=(3, 3))
        np.fill_diagonal(A, -A.sum(axis=1) + [0.4, 0, 0])
        S = np.array([1e-6, 1.0, 1e6])
        nodes.append(kp.ConeStateSpace(S[:, None] * A / S, S[:, None] * [[1.0], [0.0], [0.0]], [[0, 0, 1] / S], 0))
    d = kp.network_feedback(nodes, 0.05 * ring(30), rate=0.05)
    assert d and d.check() and d.decay_rate >= 0.05


@pytest.mark.parametrize("stiffness", [1.0, 500.0])
def test_nodes_without_an_actuator_of_their_own(stiffness):
    """Buses without machines: a bound of next to nothing, beside machines with large gains."""
    rng = np.random.default_rng(0)
    bus = [kp.ConeStateSpace([[-stiffness * k]], [[1.0]], [[1.0]], 0) for k in rng.uniform(0.5, 1, size=20)]
    nodes = [node(k) for k in rng.uniform(0.5, 2, size=20)] + bus
    W = sp.csr_array(0.2 * np.roll(np.eye(40), 1, axis=1) + 0.01 * np.roll(np.eye(40), 7, axis=1))
    d = kp.network_feedback(nodes, W, gain_bound=[15.0] * 20 + [1e-9] * 20)
    assert d and d.check()
    assert all(np.abs(f).max() <= 1e-9 for f in d.F[20:])


def test_equal_cones_of_nodes_give_equal_gains():
    long = kp.ConeStateSpace(node(), X=kp.PolyhedralCone([[0, 4], [0.5, -1]]))  # the same cone
    for bound, status in (([9, 6], kp.Status.PROVED), ([9, 4], kp.Status.REFUTED)):
        d, e = (kp.network_feedback([node(), other], ring(2), gain_bound=bound) for other in (node(), long))
        assert d.status is e.status is status and (not d or np.array_equal(d.F, e.F))
    limits = [kp.network_feedback([other] * 2, ring(2)).limit for other in (node(), long)]
    assert limits[0] == pytest.approx(limits[1], rel=1e-3)


def test_uniform_gain_for_nodes_that_differ():
    stack, W, _ = random_network(40, weight=0.5)
    d = kp.network_feedback(stack, W, uniform=True, rate=0.2)
    assert d and d.check() and d.F.shape == (1, 2)


def test_weakened_local_gains():
    stack, W, _ = random_network(30)
    d = kp.network_feedback(stack, W, gain_bound=15, rate=0.1)
    s = np.asarray(d.certified_fraction)
    assert s.shape == (30,) and (s > 0).all() and (s < 1).all()
    base = d.closed_loop.model

    def weakened(fraction):
        A = stack.A.values + fraction[:, None, None] * np.einsum("am,jmb->jab", [[0.0], [1.0]], d.F)
        return kp.feedback_interconnect(kp.stack(A, [[0], [1]], [[1, 0]], X=PAPER), base.coupling.values)

    rng = np.random.default_rng(0)
    for _ in range(3):
        assert weakened(s + rng.uniform(size=30) * (1 - s)).certificate
    assert not weakened(0.5 * s).certificate
    assert "%" in d.explain()


def test_a_warning_names_the_node_that_weak_actuators_take_out_of_its_cone():
    tank = kp.ConeStateSpace([[1.0]], [[1.0]], [[1.0]], 0)
    with pytest.warns(kp.ActuatorLossWarning, match=r"% of its local gain, node 1 .* at 1 of 3 nodes") as caught:
        d = kp.network_feedback([tank, node(), tank], 0.1 * ring(3), rate=0.2)
    assert caught[0].filename == __file__
    assert f"{100 * d.certified_fraction[1]:.4g} %" in str(caught[0].message)
    assert d.certified_fraction[1] > d.certified_fraction[0] > 0


@pytest.mark.filterwarnings("error")
def test_no_warning_where_nodes_stay_positive_with_weak_actuators():
    tank = kp.ConeStateSpace([[1.0]], [[1.0]], [[1.0]], 0)  # unstable without feedback, but positive
    d = kp.network_feedback([tank] * 3, 0.1 * ring(3), rate=0.2)
    assert d and (d.certified_fraction > 0).all()
    refused = kp.network_feedback([node()] * 3, ring(3), gain_bound=4)
    assert refused.status is kp.Status.REFUTED


def test_rounding_of_large_networks_is_stated():
    stack, W, _ = random_network(6000)
    d = kp.network_feedback(stack, W, gain_bound=15, rate=0.1)
    assert d and any("rounding" in note or "last place" in note for note in d.notes)


def test_progress_of_a_network_design():
    lines = []
    stack, W, _ = random_network(20)
    assert kp.network_feedback(stack, W, gain_bound=15, rate=0.1, progress=lines.append)
    assert any("20 nodes: linear program 1" in line for line in lines) and "proof" in lines[-1]

    def interrupt(line):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kp.network_feedback(stack, W, progress=interrupt)


# -- failures


def test_node_that_blocks_everything_is_named():
    d = kp.network_feedback([node()] * 3, ring(3), gain_bound=4)
    assert d.status is kp.Status.REFUTED and d.check() and "node 0" in d.message


def test_too_fast_or_too_tight_names_what_is_possible():
    fast = kp.network_feedback([node()] * 300, ring(300), rate=3)
    assert fast.status is kp.Status.REFUTED and fast.check() and fast.F is None
    assert "node 0 cannot have a decay rate of 3" in fast.message
    assert fast.nearest.decay_rate == pytest.approx(2, rel=1e-2)
    tight = kp.network_feedback([node()] * 3, 20 * ring(3), gain_bound=6)
    assert tight.status is kp.Status.REFUTED and tight.check()
    assert "as a whole" in tight.message and tight.nearest.gain_bound == pytest.approx(12, rel=1e-2)
    large = kp.network_feedback([node()] * 300, 20 * ring(300), gain_bound=6)
    assert large.status is kp.Status.UNDECIDED and large.nearest.gain_bound == pytest.approx(12, rel=1e-2)


@pytest.mark.parametrize("seed", range(6))
def test_small_networks_are_settled_either_way(seed):
    rng = np.random.default_rng(seed)
    tank = kp.ConeStateSpace([[0.5]], [[1.0]], [[1.0]], 0)
    nodes = [node(k) if k < 1.5 else tank for k in rng.uniform(0.5, 2, size=4)]
    W = rng.uniform(0, 8, size=(4, 4)) * (rng.uniform(size=(4, 4)) < 0.5)
    free = kp.network_feedback(nodes, W, rate=0.2)
    assert free
    for factor, status in ((1.02, kp.Status.PROVED), (0.98, kp.Status.REFUTED)):
        d = kp.network_feedback(nodes, W, rate=0.2, gain_bound=factor * free.limit)
        assert d.status is status and d.check()


def test_refusals_of_networks_do_not_survive_a_change(tmp_path):
    c = kp.network_feedback([node()] * 3, 20 * ring(3), gain_bound=6).certificate
    w = c.witness
    assert c.check() and w.L[0].fractions().any()
    changed = type(c).settle(**{**c.data(), "witness": replace(w, L=(Matrix.from_fractions(-w.L[0].fractions()),))})
    assert changed.status is kp.Status.UNDECIDED
    assert not replace(c, gain_bound=2.1 * c.gain_bound).check()
    assert not replace(c, coupling=replace(c.coupling, values=0.5 * c.coupling.values)).check()
    c.save(tmp_path / "none.json")
    assert kp.load_certificate(tmp_path / "none.json").status is kp.Status.REFUTED


@pytest.mark.parametrize(
    ("systems", "coupling", "arguments", "error", "message"),
    [
        ([node()], [[0, 1]], {}, kp.ConeMismatchError, "1 x 2"),
        ([], [[0]], {}, kp.ShapeError, "empty"),
        ([node()], [[0]], {"gain_bound": [1, 2]}, kp.ShapeError, "2 entries"),
        ([node()], [[0]], {"gain_bound": -1}, kp.DataError, "cannot be negative"),
        ([node()], [[0]], {"rate": "max"}, kp.DataError, "number"),
        ([kp.ConeStateSpace([[-1.0]], [[1.0]], [[1.0]], [[1.0]])], [[0]], {}, kp.DataError, "D is not zero"),
        (
            [node(), kp.ConeStateSpace([[-1.0]], [[1.0]], [[1.0]], 0)],
            np.zeros((2, 2)),
            {"uniform": True},
            kp.ShapeError,
            "equal",
        ),
    ],
)
def test_wrong_arguments(systems, coupling, arguments, error, message):
    with pytest.raises(error, match=message):
        kp.network_feedback(systems, coupling, **arguments)


def test_cone_that_is_not_simplicial_is_refused():
    square = kp.PolyhedralCone([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
    with pytest.raises(kp.NotProperConeError, match="4 generators"):
        kp.network_feedback([kp.ConeStateSpace(-np.eye(3), [[0], [0], [1]], [[0, 0, 1]], 0, X=square)], [[0]])


class TestExactRates:
    """Rates that are reached with equality, whatever the gain or at the bound on it."""

    @pytest.mark.parametrize("gain_bound", [None, 4])
    @pytest.mark.parametrize("uniform", [False, True])
    @pytest.mark.parametrize("discrete", [False, True])
    @pytest.mark.parametrize("n", [1, 30])
    def test_one_mode_that_no_gain_moves(self, n, discrete, uniform, gain_bound, tmp_path):
        plants, links = [third(discrete)] * n, 0.25 * ring(n)
        d = kp.network_feedback(plants, links, rate="1/3", uniform=uniform, gain_bound=gain_bound)
        c = d.certificate
        assert d and c.check() and c.required_rate == THIRD == d.weakened_rate and d.decay_rate == 1 / 3
        assert not replace(c, required_rate=THIRD + Fraction(1, 10**30)).check()
        c.save(tmp_path / "c.json")
        assert kp.load_certificate(tmp_path / "c.json") == c and checker.main(tmp_path / "c.json") == 0
        assert d.closed_loop.certificate is c and "decay rate at least 1/3 per" in d.explain()
        beyond = [
            kp.network_feedback(plants, links, rate=rate, uniform=uniform, gain_bound=gain_bound)
            for rate in (THIRD + Fraction(1, 10**18), "0.334")
        ]
        assert [b.status for b in beyond] == [kp.Status.UNDECIDED, kp.Status.REFUTED]

    @pytest.mark.parametrize("uniform", [False, True])
    def test_the_bound_on_the_gain_is_reached(self, uniform):
        plants = [kp.ConeStateSpace([["2/3"]], [[1]], [[1]], 0)] * 3
        d = kp.network_feedback(plants, np.zeros((3, 3)), rate="1/3", gain_bound=1, uniform=uniform)
        assert d and (d.F == -1).all() and d.certificate.required_rate == THIRD and d.value == 1
        assert not kp.network_feedback(plants, np.zeros((3, 3)), rate="1/3", gain_bound=1 - 2.0**-53, uniform=uniform)

    def test_weakened_actuators_keep_the_rate(self):
        d = kp.network_feedback([third()] * 2, 0.25 * ring(2), rate="1/3")
        assert (d.certified_fraction > 0).all() and (d.certified_fraction < 1).all()
        F = [
            [[Fraction(f) * Fraction(s) for f in row] for row in part]
            for part, s in zip(d.F.tolist(), d.certified_fraction, strict=True)
        ]
        weak = [kp.ConeStateSpace([[1 + f[0][0], f[0][1]], [0, "-1/3"]], [[1], [0]], [[1, 0]], 0) for f in F]
        model = kp.feedback_interconnect(weak, 0.25 * ring(2)).model
        assert d.certificate.settle(**d.certificate.data() | {"model": model, "decay_rate": 0.0})

    def test_the_largest_rate_of_networks_is_not_that_of_the_node(self):
        d = kp.scale_free_feedback(node(), 1, rate="max")
        assert d and d.value == d.decay_rate == d.certificate.decay_rate and 1.99 < d.value <= d.limit

    def test_any_number_of_nodes(self, tmp_path):
        d = kp.scale_free_feedback(third(), 1, rate="1/3")
        c = d.certificate
        assert d and c.check() and c.required_rate == THIRD == c.local.required_rate
        assert d.decay_rate == 1 / 3 and "decay rate at least 1/3." in c.explain()
        local = replace(c.local, required_rate=THIRD + Fraction(1, 10**30))
        assert not local.check() and not replace(c, local=local).check()
        c.save(tmp_path / "c.json")
        assert kp.load_certificate(tmp_path / "c.json") == c and checker.main(tmp_path / "c.json") == 0
        assert c.interconnect(ring(7)).certificate.required_rate == THIRD
        assert not kp.scale_free_feedback(third(), 1, rate=THIRD + Fraction(1, 10**18))
        assert kp.scale_free_feedback(third(), 1, rate="0.334").status is kp.Status.REFUTED


@pytest.mark.parametrize("discrete", [False, True])
def test_links_and_ports_that_no_local_gain_can_mend_are_refuted(discrete):
    X = kp.examples.paper_cone()
    A = [[0.5, 0.1], [0, 0.5]] if discrete else [[0, 1], [-1, 0]]
    plant = kp.ConeStateSpace(A, [[0], [1]], [[1, 0]], 0, discrete, X=X)
    assert kp.network_feedback([plant] * 2, -np.eye(2))  # F + W_jj C is what counts
    wrong_sign = kp.network_feedback([plant] * 2, [[0, -1], [1, 0]])
    assert wrong_sign.status is kp.Status.REFUTED and wrong_sign.certificate.check()
    assert "link from node 1 to node 0" in wrong_sign.explain()
    measures_velocity = kp.ConeStateSpace(A, [[0], [1]], [[0, 1]], 0, discrete, X=X)
    outside = kp.network_feedback([plant, measures_velocity], np.eye(2))
    assert outside.status is kp.Status.REFUTED and outside.certificate.check()
    assert "node 1" in outside.explain() and "C X in Y" in outside.explain()


def test_links_of_nodes_to_themselves_are_no_reason():
    """x_j' = x_j + F x_j + W_jj x_j + ...: gains can cancel own links, and own links can help."""
    single = kp.ConeStateSpace([[1.0]], [[1.0]], [[1.0]], 0)
    d = kp.network_feedback([single] * 2, [[-1, -0.5], [0.5, -1]])
    assert d.status is kp.Status.REFUTED and d.check() and "link from node 1 to node 0" in d.explain()
    crossed = kp.ConeStateSpace([[1.0, -1], [0, 1]], [[0], [1.0]], [[1.0, 0]], 0)
    d = kp.network_feedback([crossed] * 2, [[-1, 0.5], [0.5, -1]])
    assert d.status is kp.Status.REFUTED and "node 0 cannot be made positive" in d.explain()
    # -1 + |W_01| + F: up to 1/2 + |F| is possible
    own = [[-2, 0.5], [0.5, -2]]
    for rate, status in (("0.59", kp.Status.PROVED), ("0.61", kp.Status.REFUTED)):
        assert kp.network_feedback([single] * 2, own, gain_bound=0.1, rate=rate).status is status


@pytest.mark.parametrize("seed", range(8))
def test_fractions_of_gains_beside_links_of_nodes_to_themselves(seed):
    """A_j + B_j F_j diag(s) + B_j W_jj C_j, at the fraction that is proven, in all nodes at once."""
    rng = np.random.default_rng(seed)
    W, B, C = np.round(rng.uniform(0, 0.1, (3, 3)), 2), np.array([[1], [0.5]]), np.array([[1, 0.25]])
    W[np.diag_indices(3)] = np.round(rng.uniform(-3, 1, 3), 2)
    gains = np.round(rng.uniform(-1, 1, (3, 1, 2)), 2)
    loops = [planted.metzler_hurwitz(rng, 2) - np.eye(2) for _ in range(3)]
    data = [M - B @ (F + w * C) for M, F, w in zip(loops, gains, np.diag(W), strict=True)]
    nodes = [kp.ConeStateSpace(A, B, C, 0) for A in data]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", kp.ActuatorLossWarning)
        d = kp.network_feedback(nodes, W)
    assert d and d.check() and d.limit <= np.abs(gains).max() and (d.certified_fraction < 1).any()
    parts = [scipy.linalg.block_diag(*(getattr(s, name) for s in nodes)) for name in "ABC"]
    for s in (np.ones(3), d.certified_fraction):
        F = scipy.linalg.block_diag(*(part * f for part, f in zip(s, d.F, strict=True)))
        loop = parts[0] + parts[1] @ (F + W @ parts[2])
        assert (loop[~np.eye(6, dtype=bool)] >= -1e-12).all() and np.linalg.eigvals(loop).real.max() < 1e-9
