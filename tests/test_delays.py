"""`delayed`: systems and networks with state delays, against eigenvalues, simulations and characteristic equations."""

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from gain_systems import ring

import control_kpos as kp
from control_kpos import checker
from control_kpos.errors import ConeMismatchError, DataError, ShapeError, TimebaseError
from control_kpos.exact.matrix import Matrix
from control_kpos.families.delay_certificate import growth

SEED = kp.PolyhedralCone([[0, 1], [1, -2]])
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
A, LATER = [[-3, 1], [1, -3]], [[1, 0], [0, 1]]
NODES = kp.stack([[[-2]], [[-3]]], B=[[1]], C=[[1]])
NET = kp.feedback_interconnect(NODES, [[0, 1], [1, 0]])


def metzler(rng, n, discrete):
    """A matrix and delayed ones on the orthant, whose sum is on either side of the edge."""
    M = [rng.random((n, n)) * (rng.random((n, n)) < 0.6) for _ in range(3)]
    size = rng.uniform(0.6, 1.4)
    if discrete:
        total = sum(M)
        radius = max(np.abs(np.linalg.eigvals(total)).max(), 1e-3)
        return M[0] * size / radius, [part * size / radius for part in M[1:]]
    M[0] -= np.diag(M[0].diagonal())
    abscissa = np.linalg.eigvals(sum(M)).real.max()
    return M[0] - np.eye(n) * (abscissa - np.log(size)), M[1:]


def steps(own, later, delays, x, count):
    """x[k+1] = A x[k] + sum A_k x[k - h_k(k)] from x at all times before; delays are functions of k."""
    past = [np.asarray(x, dtype=float)] * 40
    for k in range(count):
        past.append(own @ past[-1] + sum(M @ past[-1 - h(k)] for M, h in zip(later, delays, strict=True)))
    return np.array(past[39:])


# -- against eigenvalues, and simulation


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("discrete", [False, True])
def test_stable_for_all_delays_if_the_sum_is(seed, discrete):
    rng = np.random.default_rng([seed, discrete])
    n = int(rng.integers(1, 5))
    own, later = metzler(rng, n, discrete)
    values = np.linalg.eigvals(own + sum(later))
    edge = np.abs(values).max() - 1 if discrete else values.real.max()
    c = kp.delayed(own, later, discrete=discrete)
    assert c.check() and c.status == ("PROVED" if edge < 0 else "REFUTED")
    if c:
        S = own + sum(later) - discrete * np.eye(n)
        assert (c.v > 0).all() and (c.v @ S < 0).all() and np.isnan(c.decay_rate)
    else:
        x = np.asarray(c.witness.x)
        assert (x >= 0).all() and ((own + sum(later) - discrete * np.eye(n)) @ x >= -1e-12).all()


@pytest.mark.parametrize("seed", range(10))
def test_steps_fall_at_the_proven_rate_for_delays_that_change(seed):
    """In the norm of an e for the same rate, which exists because v does."""
    rng = np.random.default_rng(seed)
    own, later = metzler(rng, 3, True)
    own, later = own * 0.6, [M * 0.6 for M in later]
    c = kp.delayed(own, later, discrete=True, max_delay=5)
    assert c and c.check() and 0 < c.decay_rate < 1
    M = own + float(c.factor) * sum(later) - (1 - c.decay_rate) * np.eye(3)
    assert np.linalg.eigvals(M).real.max() < 0
    e = -np.linalg.solve(M, np.ones(3))
    delays = [lambda k, h=h: int(h[k]) for h in rng.integers(0, 6, (2, 60))]
    x = steps(own, later, delays, e * rng.random(3), 60)
    sizes = (np.abs(x) / e).max(axis=1)
    assert (sizes <= (1 - c.decay_rate) ** np.arange(61) * (1 + 1e-9)).all()


@pytest.mark.parametrize("seed", range(10))
def test_a_direction_of_growth_holds_for_delays_that_change(seed):
    rng = np.random.default_rng(seed)
    own, later = metzler(rng, 3, True)
    size = np.abs(np.linalg.eigvals(own + sum(later))).max() / 1.01
    own, later = own / size, [M / size for M in later]
    c = kp.delayed(own, later, discrete=True)
    x = np.asarray(c.witness.x)
    delays = [lambda k, h=h: int(h[k]) for h in rng.integers(0, 6, (2, 60))]
    assert (steps(own, later, delays, x, 60) >= x - 1e-12).all()


@pytest.mark.parametrize(("h", "most"), [("1/3", 1 / 3), (1, 1), (4, 4), (0, 0)])
def test_the_rate_solves_the_characteristic_equation(h, most):
    """x' = -3 x + x2 + x(t - h) and so on: c + e^{ch} = 2."""
    c = kp.delayed(A, LATER, max_delay=h)
    assert c and c.check() and c.max_delay == Fraction(h)
    rate = c.decay_rate
    assert rate + np.exp(rate * most) == pytest.approx(2, rel=1e-8) and rate + np.exp(rate * most) < 2
    assert float(c.factor) >= np.exp(rate * most) * (1 - 1e-15)


def test_rates_in_steps_are_exact():
    c = kp.delayed([["0.3"]], [["0.2"]], discrete=True, max_delay=4)
    z = 1 - Fraction(c.decay_rate)
    assert c and c.factor >= z**-4 and c.terms == () and z > Fraction(3, 10) + Fraction(2, 10) * c.factor
    roots = np.roots([1, -0.3, 0, 0, 0, -0.2])
    assert 1 - c.decay_rate == pytest.approx(np.abs(roots).max(), rel=1e-8)


def test_delays_beyond_doubles():
    c = kp.delayed(A, LATER, max_delay=1e308)
    assert c and c.check() and np.isnan(c.decay_rate)
    assert kp.delayed(A, LATER, max_delay=10**6).decay_rate == pytest.approx(np.log(2) / 1e6, rel=1e-5)


def test_no_delay_has_the_rate_of_the_sum():
    c = kp.delayed(A, LATER, max_delay=0)
    assert c.decay_rate == pytest.approx(kp.linear_lyapunov(np.add(A, LATER), kp.orthant(2), rate="max").decay_rate)


# -- any cones, exact data, sparse data, systems


def test_other_cones():
    c = kp.delayed([[0, 1], [-22, -13]], [["1/4", 0], [0, "1/2"]], SEED)
    assert not c and isinstance(c.witness, kp.FailingTerm) and c.witness.term == 1
    c = kp.delayed([[0, 1], [-22, -13]], [[0.5, 0], [0, 0.5]], SEED)
    assert c and c.check() and (SEED.rays @ c.v > 0).all()
    c = kp.delayed(np.diag([-3, -3, -2]), [np.diag([0.5, 0.25, 1])], SQUARE, max_delay=1)
    assert c and c.check() and c.decay_rate > 0.3


def test_what_is_typed_is_what_is_proven():
    """-1/3 + 1/3 = 0 exactly, which the doubles of three thirds do not tell."""
    c = kp.delayed([["-1"]], [[["1/3"]], [["1/3"]], [["1/3"]]])
    assert c.status == "REFUTED" and c.check()
    assert kp.delayed([["-1.0000000000000000000001"]], [[["1/3"]]] * 3).status == "PROVED"
    assert c.A_delay[0].fractions()[0, 0] == Fraction(1, 3)


@pytest.mark.parametrize("n", [50, 2000])
def test_sparse_matrices(n):
    rng = np.random.default_rng(n)
    own = sp.diags_array([np.full(n, -3.0), rng.random(n - 1), rng.random(n - 1)], offsets=[0, 1, -1])
    later = sp.diags_array([rng.random(n) * 0.9], offsets=[0])
    c = kp.delayed(sp.csr_array(own), sp.csr_array(later), max_delay=1)
    assert c and c.check() and c.A.is_sparse and c.decay_rate > 0
    assert kp.delayed(own, sp.csr_array(2.5 * sp.eye_array(n))).status == "REFUTED"


def test_systems_bring_their_cone_and_time():
    s = kp.ConeStateSpace([[0.5]], [[1]], [[1]], 0, True)
    assert kp.delayed(s, [["1/4"]]).discrete and not kp.delayed([[-1]], [["1/4"]]).discrete
    s = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=SEED)
    assert kp.delayed(s, [[0.5, 0], [0, 0.5]]).X == SEED
    with pytest.raises(TimebaseError, match="discrete is True"):
        kp.delayed(s, LATER, discrete=True)


# -- what is not positive


@pytest.mark.parametrize(("later", "term"), [([[[1, 0], [0, 1]], [[0, 0], ["-1/9", 0]]], 2), ([LATER, LATER], None)])
def test_the_matrix_that_fails_is_named(later, term):
    c = kp.delayed(A, later)
    if term is None:
        assert c.status == "REFUTED" and isinstance(c.witness, kp.InstabilityDirection)  # -3 + 1 + 2 = 0
        return
    assert c.status == "REFUTED" and c.check() and c.witness.term == term
    assert f"A_{term} X in X fails" in c.explain()
    assert "A X in X fails" in kp.delayed([[-1, -1], [0, -1]], LATER).explain()


def test_in_steps_A_has_to_map_the_cone_into_itself():
    assert kp.delayed([[-0.5]], [[0.25]], discrete=True).witness.term == 0
    assert kp.delayed([[-0.5]], [[0.25]])


# -- what proves nothing


def test_changed_certificates_prove_nothing():
    c = kp.delayed(A, LATER, max_delay=1)
    later = kp.state_positivity([[2, 0], [0, 2]], kp.orthant(2), discrete=True)
    for change in (
        {"v": -c.v},
        {"rate": c.rate * 1.001},
        {"max_delay": Fraction(2)},
        {"factor": Fraction(1)},
        {"terms": (1,)},
        {"delayed": (later,)},
    ):
        assert not replace(c, **change).check()
        assert not _settled(c, change)
    refuted = kp.delayed(A, [[2, 0], [0, 2]])
    for change in ({"witness": None}, {"v": np.ones(2)}, {"witness": kp.InstabilityDirection(np.array([1.0, -1.0]))}):
        assert not replace(refuted, **change).check()


def _settled(c, change):
    try:
        return type(c).settle(**c.data() | change)
    except DataError:
        return False


@pytest.mark.parametrize(
    "change",
    [
        {"rate": None},
        {"factor": None},
        {"max_delay": None},
        {"rate": -1.0},
        {"rate": np.inf},
        {"terms": ()},
        {"terms": (10**6,)},
        {"delayed": ()},
    ],
)
def test_certificates_that_do_not_fit_together(change):
    c = kp.delayed(A, LATER, max_delay=1)
    assert not replace(c, **change).check()
    with pytest.raises(DataError):
        type(c).settle(**c.data() | change)


def test_bounds_of_growth():
    assert growth(Fraction(1, 2), Fraction(1), (20,), discrete=False) >= Fraction(Decimal(1).exp().sqrt())
    assert growth(Fraction(1, 2), Fraction(3), (), discrete=True) == 8
    for rate, delay in ((Fraction(1), 1), (Fraction(1, 2), Fraction(1, 2)), (Fraction(1, 2), 1001), (Fraction(0), 1)):
        with pytest.raises(DataError):
            growth(rate, Fraction(delay), (), discrete=True)


# -- networks


def sums(net, blocks):
    """The closed loop with the delayed terms added."""
    return net.sparse_A.toarray() + sp.block_diag(blocks).toarray()


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("discrete", [False, True])
def test_networks_agree_with_the_sum(seed, discrete):
    rng = np.random.default_rng([seed, discrete])
    N, n = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    own = rng.random((N, n, n)) * (0.2 if discrete else 1.0) - (0 if discrete else 1) * np.eye(n) * 3
    later = rng.random((N, n, n)) * (rng.random((N, n, n)) < 0.5) * (0.4 if discrete else 1.0)
    B, C = rng.random((N, n, 1)), rng.random((N, 1, n))
    W = rng.random((N, N)) * (rng.random((N, N)) < 0.5) * 0.3
    D = [[0.1]] if seed % 3 == 0 else None
    net = kp.feedback_interconnect(kp.stack(own, B, C, D, dt=int(discrete)), W)
    values = np.linalg.eigvals(sums(net, later))
    edge = np.abs(values).max() - 1 if discrete else values.real.max()
    c = kp.delayed(net, later)
    assert c.check() and c.status == ("PROVED" if edge < 0 else "REFUTED") and np.isnan(c.decay_rate)
    if c:
        v = np.asarray(c.v).ravel()
        assert (v > 0).all() and (v @ (sums(net, later) - discrete * np.eye(N * n)) < 0).all()


def test_nodes_of_several_sizes_and_cones():
    first = kp.stack([np.diag([-3.0, -3, -2])] * 2, B=[[0], [0], [1]], C=[[0, 0, 1]], X=SQUARE)
    other = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
    net = kp.feedback_interconnect([first, other], [[0, 0, 1], [0.5, 0, 0], [0, 0.25, 0]])
    blocks = [np.diag([0.5, 0.25, 1]), np.diag([0, 0.25, 0.5]), [[0.5]]]
    c = kp.delayed(net, blocks)
    assert c and c.check() and len(c.v) == 3
    assert kp.delayed(net, [blocks[0], blocks[1], [["-1/9"]]]).status == "REFUTED"
    with pytest.raises(ShapeError, match="2 entries; 3 nodes"):
        kp.delayed(net, blocks[:2])
    with pytest.raises(ShapeError, match=r"A_delay\[2\] is 2 x 2"):
        kp.delayed(net, [*blocks[:2], LATER])


def test_a_network_that_no_delay_makes_stable():
    c = kp.delayed(NET, [[[2]], [[1]]])
    assert c.status == "REFUTED" and c.check() and "no delays of these states make" in c.explain()
    c = kp.delayed(NET, [["-1/8"]])
    assert c.status == "REFUTED" and "not positive" in c.explain()


def test_networks_with_vertices_are_refused():
    several = kp.stack([[[[-2.0]]], [[[-3.0]]]], [[1]], [[1]])
    with pytest.raises(DataError, match="vertices"):
        kp.delayed(kp.feedback_interconnect(several, [[0]]), [[0.5]])


def test_cones_with_open_facets(tmp_path):
    """66 rays in 9 dimensions: positivity from generators, and a plane in the place of a facet."""
    rng = np.random.default_rng(0)
    X = kp.PolyhedralCone(np.hstack([rng.integers(-5, 6, (67, 8)), np.full((67, 1), 9)]))
    c = kp.delayed(-2 * np.eye(9), np.diag([0.5] + [-0.3] * 7 + [0.1]), X)
    assert c.status == "REFUTED" and c.check() and isinstance(c.witness.violation, kp.PlaneViolation)
    c.save(tmp_path / "file.json")
    assert checker.main(tmp_path / "file.json") == 1


def test_static_nodes_have_no_delays():
    static = kp.ConeStateSpace([], [], [], [[0.25]])
    net = kp.feedback_interconnect([kp.ConeStateSpace([[-2]], [[1]], [[1]], 0), static], [[0, 1], [1, 0]])
    assert kp.delayed(net, [[["1/2"]], np.zeros((0, 0))])


def test_exact_blocks_of_networks():
    """-2 + 1/3 + 5/3 = 0 at a node alone."""
    net = kp.feedback_interconnect([kp.ConeStateSpace([["-5/3"]], [[1]], [[1]], 0)] * 2, [[0, "4/3"], ["4/3", 0]])
    assert kp.delayed(net, [["1/3"]]).status == "REFUTED"
    assert kp.delayed(net, [["333333333333333333333/1000000000000000000000"]]).status == "PROVED"


def test_a_large_ring():
    c = kp.delayed(ring(20_000), [[0.5]])
    assert c and c.check() and c.v.shape == (20_000, 1)
    assert kp.delayed(ring(20_000), [[1.5]]).status == "REFUTED"


def test_networks_made_of_other_links_prove_nothing():
    c = kp.delayed(NET, [[0.5]])
    one = c.network.model
    for W in (one.W * 2, sp.csr_array(one.W.shape), one.W[::-1]):
        other = one.with_coupling(Matrix(sp.csr_array(W)))
        with pytest.raises(DataError, match="delayed states"):
            type(c).settle(network=type(c.network).settle(model=other))
    assert not replace(c, network=NET.certificate).check()


# -- bad input


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ((A, [[1]]), ShapeError, "A_delay is 1 x 1, but must be 2 x 2"),
        ((A, []), DataError, "A_delay is empty"),
        ((A, [LATER, [[1]]]), ShapeError, r"A_delay\[1\] is 1 x 1"),
        ((A, 3), DataError, "A_delay"),
        ((A, [kp.ConeStateSpace(A, LATER, LATER, 0)]), DataError, r"A_delay\[0\] is a ConeStateSpace"),
        (([[1, 2]], LATER), ShapeError, "A is 1 x 2"),
        ((ct.tf([1], [1, 1]), [[1]]), DataError, "A is a TransferFunction; give a matrix, or a state-space system"),
        ((kp.interval([[-2]], [[-1]]), [[1]]), DataError, "of type Interval; ranges are for kp.stack"),
        ((A, LATER, SQUARE), ConeMismatchError, "X is a cone in 3 dimensions, but A has 2 states"),
        ((NET, [[[1]], [[1]], [[1]]]), ShapeError, r"A_delay has shape \(3, 1, 1\)"),
        ((NET, LATER), ShapeError, r"it must be \(2, 1, 1\)"),
        ((NET, [[1]], SEED), DataError, "X has no place beside a network"),
    ],
)
def test_arguments_that_are_none(arguments, error, text):
    with pytest.raises(error, match=text):
        kp.delayed(*arguments)


def test_delays_that_are_none():
    for value in (-1, "x", np.nan):
        with pytest.raises(DataError, match="max_delay"):
            kp.delayed(A, LATER, max_delay=value)
    with pytest.raises(DataError, match="number of steps"):
        kp.delayed([[0.5]], [[0.25]], discrete=True, max_delay=0.5)
    with pytest.raises(ShapeError, match=r"max_delay has shape \(2,\); give one number"):
        kp.delayed(A, LATER, max_delay=[1, 2])
    with pytest.raises(DataError, match="max_delay has no place beside a network, for which no rate is proven"):
        kp.delayed(NET, [[1]], max_delay=1)
