"""A network is a cone system: the same verdicts and operations as the closed loop written out."""

import copy
import pickle
from fractions import Fraction
from functools import partial

import control as ct
import numpy as np
import pytest
from network_examples import CONE, cycle, lag, mass, random_masses, sparse_ring

import control_kpos as kp
from control_kpos.networks.closed_loop import EXACT_STATES
from control_kpos.proof.certificate import Status

SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])  # four rays in R^3: not simplicial


def node_on_square(rng, dt, D):
    """A node positive on `SQUARE`: its axis decays most slowly, its inputs point along generators."""
    A = np.diag([0.2, 0.2, 0.4]) if dt else np.diag([-3.0, -3.0, -2.0])
    B = SQUARE.rays[:2].T * rng.random(2)
    C = np.array([[0.5, 0, 1.0], [0, -0.5, 1.0]]) * rng.random()
    return kp.ConeStateSpace(A, B, C, D * rng.random((2, 2)), dt, X=SQUARE)


def random_network(seed, dt=0, D=0.0, strength=0.3, exact=False):
    rng = np.random.default_rng(seed)
    nodes = [
        node_on_square(rng, dt, D),
        lag(0.3 if dt else 3.0 + rng.random(), D=D * rng.random(), dt=dt),
        node_on_square(rng, dt, D),
        lag(0.2 if dt else 2.0, dt=dt),
    ]
    if exact:
        nodes[1] = kp.ConeStateSpace([["1/3" if dt else "-10/3"]], [["1/7"]], [["3/7"]], [[0]], dt)
    W = strength * rng.random((6, 6)) * (rng.random((6, 6)) < 0.6)
    coupling = [[str(Fraction(x).limit_denominator(30)) for x in row] for row in W] if exact else W
    return kp.feedback_interconnect(nodes, coupling)


def written_out(net):
    """The closed loop as a system without nodes."""
    return kp.ConeStateSpace(*net.exact.matrices, net.dt, X=net.X, U=net.U, Y=net.Y)


CASES = [
    {"seed": seed, "dt": dt, "D": D, "strength": strength, "exact": exact}
    for seed in range(3)
    for dt in (0, 0.5)
    for D, exact in ((0.0, False), (0.3, False), (0.0, True), (0.3, True))
    for strength in (0.2, 3.0)
]


def outcome(ask):
    try:
        return ask()
    except kp.KposError as error:
        return type(error)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_verdicts_are_those_of_the_closed_loop_written_out(case):
    net = random_network(**case)
    plain = written_out(net)
    assert isinstance(net, kp.ConeStateSpace) and isinstance(net, ct.StateSpace)
    assert (net.X, net.U, net.Y) == (plain.X, plain.U, plain.Y)
    for ask in (
        lambda s: s.is_cone_positive(),
        lambda s: s.cone_positivity().status,
        lambda s: s.linear_lyapunov().status,
        lambda s: s.dissipativity().status,
        lambda s: s.gain(),
        lambda s: s.gain("Linf"),
    ):
        assert outcome(partial(ask, net)) == outcome(partial(ask, plain))
    assert net.cone_positivity().check() and net.linear_lyapunov().check()
    if net.certificate:
        assert net.is_cone_positive() and net.linear_lyapunov().status is Status.PROVED


@pytest.mark.parametrize("D", [0.0, 0.3])
def test_the_exact_closed_loop_is_that_of_fractions(D):
    net = random_network(1, D=D, exact=True)
    parts = [[Fraction(0)] * 6 for _ in range(6)]
    W = net.model.coupling.fractions()
    a, b, c, d = (np.full(shape, Fraction(0), dtype=object) for shape in ((8, 8), (8, 6), (6, 8), (6, 6)))
    for s, places in zip(net.model.stacks, net.model.places, strict=True):
        for whole, m, rows, columns in ((a, s.A, 0, 0), (b, s.B, 0, 1), (c, s.C, 2, 0), (d, s.D, 2, 1)):
            whole[places[rows][:, :, None], places[columns][:, None, :]] = m.fractions()
    A, B, C, DD = (m.fractions() for m in net.exact.matrices)
    eye = np.array(parts) + np.eye(6, dtype=int)
    # x' = a x + b u, y = c x + d u, u = W y + w: check (A, B, C, D) by what they have to satisfy
    assert (c + d @ W @ C == C).all() and (d @ (eye + W @ DD) == DD).all()
    assert (a + b @ W @ C == A).all() and (b @ (eye + W @ DD) == B).all()
    np.testing.assert_array_equal(net.A, net.exact.A.values)


def test_verdicts_do_not_depend_on_supply_rates():
    net = kp.feedback_interconnect([lag(2)] * 2, cycle(2), supply_rates=[(-9.0, 1.0)] * 2)
    assert net.certificate.status is Status.REFUTED  # no node is that dissipative
    assert net.is_cone_positive() and net.cone_positivity() and net.linear_lyapunov()


def test_a_network_can_be_positive_although_a_node_is_not():
    bad = kp.ConeStateSpace([[-1.0]], [[-1.0]], [[1.0]], 0)
    net = kp.feedback_interconnect([bad, bad], [[0, -0.5], [-0.5, 0]], inputs=[], outputs=[0])
    assert net.certificate.status is Status.REFUTED
    assert net.is_cone_positive() and net.linear_lyapunov()


def test_third_is_third():
    # gain 1 in thirds: marginal; in doubles it is stable by rounding
    nodes = [kp.ConeStateSpace([[-1]], [["1/3"]], [[1]], 0)] * 2
    for coupling, status in (
        ([[0, 3], [3, 0]], Status.REFUTED),
        ([[0, 3], ["2.9999999999999999999", 0]], Status.PROVED),
    ):
        net = kp.feedback_interconnect(nodes, coupling)
        assert net.linear_lyapunov().status is net.certificate.status is status
        assert kp.ConeStateSpace(net).linear_lyapunov().status is status
    assert net.exact.A.fractions()[0, 1] == 1


# -- large networks


def test_large_networks_stay_sparse():
    n = 4000
    net = kp.feedback_interconnect(random_masses(np.random.default_rng(0), n), 3.7 * sparse_ring(n))
    assert net.nstates > EXACT_STATES and net.is_cone_positive()
    positivity, stability = net.cone_positivity(), net.linear_lyapunov()
    assert positivity.A.is_sparse and positivity.status is not Status.REFUTED
    assert stability.status is Status.PROVED and stability.check()
    assert kp.orthant(n) == net.U and net.X.dim == 2 * n
    for ask in (net.gain, net.dissipativity):
        with pytest.raises(kp.TooLargeError, match=r"8000 states .* is refused"):
            ask()
    loud = kp.feedback_interconnect(random_masses(np.random.default_rng(0), n), 30 * sparse_ring(n))
    assert loud.is_cone_positive() and not loud.certificate
    bent = kp.feedback_interconnect(random_masses(np.random.default_rng(0), n), -sparse_ring(n))
    assert not bent.is_cone_positive() and bent.cone_positivity().check()


def test_connections_of_large_networks_are_networks():
    n = 3000
    net = kp.feedback_interconnect(random_masses(np.random.default_rng(0), n), sparse_ring(n), inputs=[0], outputs=[5])
    for made in (net.append(net), net.feedback(net, sign=1), net * net, net.feedback(mass(), sign=1), net[0, 0]):
        assert isinstance(made, kp.ConeNetwork) and made.certificate.status is Status.PROVED
    with pytest.raises(kp.TooLargeError):
        net.feedback(net)  # -Y is not in U: python-control's result would be dense


# -- operations


def square_network(seed, dt=0, D=0.0):
    return random_network(seed, dt=dt, D=D, strength=0.1)


@pytest.mark.parametrize("dt", [0, 0.5])
@pytest.mark.parametrize("D", [0.0, 0.1])
def test_operations_are_those_of_the_closed_loop_written_out(dt, D):
    one, two = square_network(1, dt, D), square_network(2, dt, D)
    K = 0.05 * np.ones((6, 6))
    operations = {
        "append": lambda s, t: s.append(t),
        "series": lambda s, t: s * t,
        "series with a plain cone system": lambda s, t: s * written_out(two),
        "feedback": lambda s, t: s.feedback(t, sign=1),
        "feedback, weak": lambda s, t: s.feedback(t, sign=0.25),
        "gain": lambda s, t: s.feedback(K, sign=1),
        "ct.feedback": lambda s, t: ct.feedback(s, t, sign=1),
        "ct.append": lambda s, t: ct.append(s, t),
        "negative feedback": lambda s, t: s.feedback(t),
        "sum": lambda s, t: s + t,
        "opposite": lambda s, t: -s,
        "scaled": lambda s, t: 2 * s,
        "part": lambda s, t: s[[0, 1], 3],
        "outputs apart": lambda s, t: s[[0, 2, 1], 2:5],
        "similar": lambda s, t: s.similarity_transform(np.eye(8)[::-1]),
    }
    if not dt:
        operations["sample"] = lambda s, t: s.sample(0.1)
    for name, operation in operations.items():
        ours, theirs = operation(one, two), operation(written_out(one), written_out(two))
        for matrix in "ABCD":
            np.testing.assert_allclose(
                getattr(ours, matrix), getattr(theirs, matrix), rtol=1e-9, atol=1e-12, err_msg=name
            )
        assert ours.dt == theirs.dt
        assert isinstance(ours, kp.ConeStateSpace) is isinstance(theirs, kp.ConeStateSpace), name
        if isinstance(theirs, kp.ConeStateSpace):
            assert (ours.X, ours.U, ours.Y) == (theirs.X, theirs.U, theirs.Y), name
            assert ours.is_cone_positive() is theirs.is_cone_positive(), name


def test_closing_a_loop_does_not_demote_a_network():
    net = square_network(3)
    for made in (net.append(net), net * net, net.feedback(net, sign=1), net.feedback(0.01 * np.ones((6, 6)), sign=1)):
        assert isinstance(made, kp.ConeNetwork)
        assert made.certificate.status is Status.PROVED and made.certificate.check()
    third = net.feedback([["1/30"] * 6] * 6, sign=1).model.coupling.fractions() - net.model.coupling.fractions()
    assert (third == Fraction(1, 30)).all()


def test_cones_of_chosen_signals():
    wide = kp.PolyhedralCone([[1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1]])
    node = kp.ConeStateSpace(-np.eye(3), np.eye(3), np.eye(3), 0, X=wide, U=wide, Y=wide)
    net = kp.feedback_interconnect([node, lag(1)], np.zeros((4, 4)))
    plain = written_out(net)
    for key in ((slice(None), slice(None)), ([3, 0], [3, 1, 0]), ([0, 3, 1], 2)):
        assert (net[key].U, net[key].Y) == (plain[key].U, plain[key].Y)
    chosen = kp.feedback_interconnect([node, lag(1)], np.zeros((4, 4)), inputs=[3, 0], outputs=[2])
    assert chosen.U == plain[:, [3, 0]].U and chosen.Y == plain[2, :].Y and chosen.is_cone_positive()
    thin = kp.PolyhedralCone([[1, 2], [2, 1]])
    other = kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0, X=thin, U=thin, Y=thin)
    torn = kp.feedback_interconnect([other], np.zeros((2, 2)), inputs=[0])
    with pytest.raises(kp.NotProperConeError, match="what is left of the cone of a node with 2 inputs"):
        _ = torn.U
    assert type(kp.feedback_interconnect([other], np.zeros((2, 2)))[:, 0]) is ct.StateSpace


def test_matrices_are_read_only():
    for n in (3, 400):
        net = kp.feedback_interconnect(random_masses(np.random.default_rng(0), n), sparse_ring(n))
        for matrix in (net.A, net.B, net.C, net.D, net.sparse_A.data, net.sparse_A.indices, net.sparse_B.data):
            with pytest.raises(ValueError, match="read-only"):
                matrix[0] = 7
        for name in ("A", "sparse_A", "sparse_B"):
            with pytest.raises(AttributeError):
                setattr(net, name, net.A)


def test_copies_and_pickles():
    net = kp.feedback_interconnect([mass(name="left"), lag(2, name="right")], cycle(2))
    for again in (copy.deepcopy(net), copy.copy(net), pickle.loads(pickle.dumps(net)), net.copy()):
        assert isinstance(again, kp.ConeNetwork) and again.X == net.X and again.input_labels == net.input_labels
        np.testing.assert_array_equal(again.A, net.A)
    assert kp.product([CONE, kp.orthant(1)]) == net.X


def test_a_network_is_a_node():
    inner = kp.feedback_interconnect([mass(), lag(2)], cycle(2), inputs=[0], outputs=[1])
    outer = kp.feedback_interconnect([inner, lag(3)], cycle(2))
    assert outer.certificate.status is Status.PROVED and kp.product([CONE, kp.orthant(2)]) == outer.X
    assert inner.feedback(lag(3), sign=1).certificate.status is Status.PROVED
