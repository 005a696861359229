"""Certificates of every kind for the tests of files and of the checker, small and with data of many sorts."""

import certified_vertices
import control as ct
import numpy as np
import scipy as sp
from certified_families import SWITCHED
from gain_systems import GAINS
from strategies import without_facets

import control_kpos as kp
from control_kpos.design.bounded.interval import read_constraints
from control_kpos.design.bounded.network_interval import NetworkBounds, network_intervals
from control_kpos.design.plant import in_sparse_form
from control_kpos.design.running import Programs
from control_kpos.exact.intake import exact_matrix
from control_kpos.exact.matrix import Matrix
from control_kpos.find.one_matrix.explicit import modal_cone
from control_kpos.find.one_matrix.modes import modes

PAPER, LINE = kp.PolyhedralCone([[0, 1], [1, -2]]), kp.orthant(1)
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])


def scalar_supply(r):
    return kp.dissipativity([[-2]], [[1]], [[1]], [[0]], LINE, LINE, LINE, q=[-1], r=[r])


def network(systems, coupling, **more):
    return kp.feedback_interconnect(systems, coupling, **more).certificate


def mass_springs(count=4, extra=0.0):
    A, B, C, _ = kp.examples.mass_spring()
    closed = A + B @ (kp.examples.paper_gain() + [[0.0, extra]])
    return kp.stack(A=np.array([closed] * count), B=B, C=C, X=PAPER, U=LINE, Y=LINE)


def mixed_nodes():
    one = kp.ConeStateSpace([[-2]], [[1]], [[1]], [[0.5]])
    two = kp.ConeStateSpace([[-2, 1], ["0.1", -3]], [[1], [0]], [[1, 0]], [[0]])
    return [one, two, one]


LINKS = [[0, 0.5, 0], [0.1, 0, 0.1], [0.2, 0.2, 0]]

PLANT = [[0], [1]], [[1, 0]], [[0]], PAPER, LINE, LINE

INWARDS = [[-2, 0.1, 0], [0, -3, 0.2], [0, 0, -1]]
PYRAMID = [[0.5], [0], ["0.9"]], [[0, 0, 1]], [[0]]

SPIRAL = [[-1, 4, 0], [-4, -1, 0], [0, 0, 1]]
FAMILY = [[[-2, 1], [1, -2]], [["-3", "1/3"], ["0.5", -2]]]


def own_links(rate, across=0):
    """Nodes with links to themselves: I - W_jj D_j has a zero on its diagonal, or has none."""
    two = kp.ConeStateSpace([[rate, across], [0, rate]], np.eye(2), np.eye(2), np.eye(2))
    one = kp.ConeStateSpace([["-1/3"]], [[1]], [[1]], [[0.5]])
    links = [[1, -1, 0.1, 0, 0], [-1, 2, 0, 0, 0], [0.05, 0.05, -1, 0, 0], [0, 0, 0.1, -1, 0.5], [0, 0, 0, 0.25, -1]]
    return network([two, one, two], links)


def thin_cone(A):
    """The certificate of a cone with sparse multipliers, as those of thousands of generators are."""
    found = modal_cone(modes(np.array(A, dtype=float)), thin=True)
    return kp.ConeCertificate.settle(
        matrices=Matrix.stack([Matrix(np.array(A, dtype=float))]),
        rays=Matrix(found.R.T.copy()),
        multipliers=Matrix(found.multipliers.combined()),
        pointing=found.pointing,
        right_inverse=found.right_inverse,
    )


def designed(**demands):
    plant = kp.ConeStateSpace(*kp.examples.mass_spring(), X=PAPER)
    return kp.state_feedback(plant, **demands).certificate


def of_vertices(*family, **demands):
    """A feedback of the first state for these matrices, with one common vector."""
    vertices = [(A, [[1], [0]]) for A in family]
    plant = kp.ConeStateSpace(*vertices[0], np.eye(2), np.zeros((2, 1)))
    return kp.state_feedback(plant, vertices=vertices, **demands).certificate


def two_vertices():
    A, B, _, _ = kp.examples.mass_spring()
    return [(A, B), (np.array([[0, 1], [-1.2, -0.1]]), B)]


def ports():
    return kp.find_cone(
        ct.ss([[-1, 4, 0], [-4, -1, 0], [0, 0, -0.2]], [[0.3], [0.2], [1]], [[0.1, 0, 1]], [[0]])
    ).certificate


def pendulum(X, region, stiffness=0.0, damping=-3.0):
    def field(t, x, u, p):
        return [x[1], stiffness * x[0] - np.sin(x[0]) + damping * x[1]]

    return kp.differential_positivity(ct.nlsys(field, inputs=0, states=2), X, region)


def node(a, d=0):
    return kp.ConeStateSpace([[a]], [[1]], [[1]], [[d]])


LAG = node(-1)
SLOW = kp.ConeStateSpace([["1/3"]], [[1]], [[1]], 0, True)


def bracket(systems, coupling):
    return kp.feedback_interconnect(systems, coupling).abscissa_certificate()


# dominant directions that point the same way for neither sign
TURNED = [[[0.5, 0], [0, -0.25]], [[-0.625, 0.375], [-1.125, 0.875]]]


def supplied(*rates):
    return network([kp.ConeStateSpace([[-2]], [[1]], [[1]], [[0]])] * 2, [[0, 1], [1, 0]], supply_rates=rates)


def third(discrete=False):
    """A plant of which one mode decays at 1/3 whatever the gain."""
    more = (1,) if discrete else ()
    return kp.ConeStateSpace([[1, 0], [0, "2/3" if discrete else "-1/3"]], [[1], [0]], [[1, 0]], [[0]], *more)


def at_a_third(discrete=False):
    return kp.network_feedback([third(discrete)] * 2, [[0, 0.25], [0.25, 0]], rate="1/3").certificate


def interval(w_max, constraints=None, X=PAPER, A=((0, 1), (-22, -13))):
    return kp.order_interval(kp.ConeStateSpace(A, np.eye(2), np.eye(2), 0, X=X), w_max, constraints=constraints)


def network_interval(systems, coupling, w_max, constraints=None):
    """The certificate of a small network, as large ones have it."""
    net, n = kp.feedback_interconnect(systems, coupling), len(w_max)
    f, c = (None, None) if constraints is None else read_constraints(constraints, n)
    rows = None if f is None else in_sparse_form(f, "f")
    given = NetworkBounds(exact_matrix(w_max, "w_max", ndim=1), rows, c)
    return next(found for found in network_intervals(net, given, Programs(None)) if found.status != "UNDECIDED")


def pyramid():
    return kp.ConeStateSpace(
        [[-2, 0.25, 0], [0.125, -2, 0], [0, 0, -1.5]], [[0.125], [0], [1]], [[0, 0, 1]], 0, X=SQUARE
    )


def optimal(A=None, B=None, s=(3, 1), r=None, limits=((2, 1),), X=PAPER, discrete=None, **more):
    A, B = A or [["0.7", "0.1"], ["-0.2", "0.3"]], B or [[0], ["0.2"]]
    discrete = A[0][0] in (2, "0.7") if discrete is None else discrete
    X = None if discrete is False or "discount" in more else X
    plant = kp.ConeStateSpace(A, B, np.eye(2), 0 * np.ones(np.shape(B)), discrete, X=X)
    return kp.optimal_feedback(plant, s, ["0.1"] * len(B[0]) if r is None else r, limits, **more)


def on_a_square(grows=0, *, discrete, **more):
    A = (np.diag([0.25, 0.25, 0.5]) + grows * np.eye(3) if discrete else np.diag([-2, -2, -1.5])).tolist()
    plant = kp.ConeStateSpace(A, [["1/8"], ["1/9"], [0]], np.eye(3), np.zeros((3, 1)), discrete, X=SQUARE)
    return kp.optimal_feedback(plant, [0.25, 0, 1], ["-1/7"], [[0, 0.25, 0.5]], **more)


DECAYS = [[-1, 0, 0], [0, -2, 0], [0, 0, -3]]
CERTIFICATES = SWITCHED | {
    "positive": lambda: kp.state_positivity([[0, 1], [-22, -13]], PAPER),
    "positive, decimals": lambda: kp.state_positivity([[0, 1], ["-21.3", "-12.9"]], PAPER),
    "positive, fractions": lambda: kp.state_positivity([["-1/3", "1/7"], ["2/9", "-1/3"]], kp.orthant(2)),
    "positive with ports": lambda: kp.cone_positivity([[0, 1], [-22, -13]], *PLANT),
    "positive, four generators": lambda: kp.state_positivity([[-2, 0.1, 0], [0, -3, 0.2], [0, 0, -1]], SQUARE),
    "positive, discrete": lambda: kp.state_positivity(
        [[0.5, 0.1, 0], [0, 0.5, 0], [0, 0, 0.75]], SQUARE, discrete=True
    ),
    "not positive": lambda: kp.state_positivity([[0, 1], [-22, -12]], PAPER),
    "not positive, input": lambda: kp.cone_positivity([[0, 1], [-22, -13]], [[0], [-1]], *PLANT[1:]),
    "not positive, output": lambda: kp.cone_positivity([[0, 1], [-22, -13]], [[0], [1]], [[0, 1]], *PLANT[2:]),
    "not positive, discrete": lambda: kp.state_positivity([[0.1, -0.1], [0, 0.1]], kp.orthant(2), discrete=True),
    "stable": lambda: kp.linear_lyapunov([[0, 1], [-22, -13]], PAPER),
    "stable, tightest rate": lambda: kp.linear_lyapunov([[-2, 1], [0.5, -2]], kp.orthant(2), rate="max"),
    "stable, discrete": lambda: kp.linear_lyapunov([[0.5, 0, 0], [0, 0.5, 0], [0, 0, 0.75]], SQUARE, discrete=True),
    "stable, product": lambda: kp.linear_lyapunov(
        np.kron(np.eye(2), [[0, 1], [-22, -13]]) + np.kron([[0, 1], [1, 0]], [[0, 0], [1, 0]]), kp.product([PAPER] * 2)
    ),
    "stable, near the margin": lambda: kp.linear_lyapunov([[-1, 1], [1 - 2.0**-50, -1]], kp.orthant(2)),
    "stable, at a rate": lambda: kp.linear_lyapunov([["-4/3", 1], [1, "-4/3"]], kp.orthant(2), rate="1/3"),
    "not stable, at a rate": lambda: kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2), rate=1.5),
    "unstable": lambda: kp.linear_lyapunov([[1, 0], [0, 1]], kp.orthant(2)),
    "unstable, marginal": lambda: kp.linear_lyapunov([[-1, 1], [1, -1]], kp.orthant(2)),
    "unstable, four generators": lambda: kp.linear_lyapunov([[-1, 0, 0], [0, -1, 0], [0, 0, 0.5]], SQUARE),
    "unstable, discrete": lambda: kp.linear_lyapunov([[0.5, 0, 0], [0, 0.5, 0], [0, 0, 1]], SQUARE, discrete=True),
    "unstable because not positive": lambda: kp.linear_lyapunov([[0, 1], [-22, -12]], PAPER),
    "dissipative": lambda: scalar_supply(0.6),
    "dissipative, gain bound": lambda: kp.dissipativity([[0, 1], [-22, -13]], *PLANT, q=[-1], r=[1 / 22 + 1e-6]),
    "dissipative, discrete": lambda: kp.dissipativity(
        [[0.5]], [[1]], [[1]], [[0.25]], LINE, LINE, LINE, q=[-1], r=[2.5], discrete=True
    ),
    "not dissipative": lambda: scalar_supply(0.4),
    "not dissipative, boundary": lambda: scalar_supply(0.5),
    "not dissipative for any r": lambda: kp.dissipativity([[1]], [[1]], [[1]], [[0]], LINE, LINE, LINE, q=[-1]),
    # the doubles next to these supplies are on the other side of what is needed
    "dissipative, just": lambda: LAG.dissipativity(q=["-1/3"], r=["0.3333333333333333334"]),
    "not dissipative, just": lambda: LAG.dissipativity(q=["-1/10"], r=["1/10"]),
    "not dissipative, discrete, just": lambda: SLOW.dissipativity(q=["-1/3"], r=["0.4999999999999999999"]),
    "network, given supplies, just": lambda: network(
        [LAG] * 2, [[0, "1/3"], ["1/3", 0]], supply_rates=[(["-1/10"], ["3/10"])] * 2
    ),
    "network, node not dissipative, just": lambda: network(
        [LAG] * 2, [[0, 0], [0, 0]], supply_rates=[(["-1/3"], ["1/3"])] * 2
    ),
    "network, not to be weighted, just": lambda: network(
        [LAG] * 2, [[0, "1/3"], ["1/3", 0]], supply_rates=[(["-1/10"], ["0.3000000000000000001"])] * 2
    ),
    "network": lambda: network(mass_springs(), kp.examples.ring(4)),
    "network, algebraic loops": lambda: network(mixed_nodes(), LINKS),
    "network, given supplies": lambda: supplied(([-1], [0.6]), ([-1.5], [0.9])),
    "network, node not dissipative": lambda: supplied(([-1], [0.4]), ([-1.5], [0.9])),
    "network, not to be weighted": lambda: supplied(([-1], [1.1]), ([-1.5], [2])),
    "network, unstable": lambda: network(mass_springs(), 30 * kp.examples.ring(4)),
    "network, unstable, algebraic loops": lambda: network(mixed_nodes(), [[0, 0.5, 0], [9, 0, 0.1], [0.2, 0.2, 0]]),
    "network, at a rate": at_a_third,
    "network, discrete, at a rate": lambda: at_a_third(True),
    "network, wrong link": lambda: network(mass_springs(), -kp.examples.ring(4)),
    "network, node not positive": lambda: network(mass_springs(extra=1.0), kp.examples.ring(4)),
    "network, loop not well posed": lambda: network(mixed_nodes(), [[0, 0.5, 4], [9, 0, 0.1], [4, 0.2, 0]]),
    "network, own links closed": lambda: own_links(-3),
    "network, own links closed, unstable": lambda: own_links(1),
    "network, own links closed, node not positive": lambda: own_links(-3, -2),
    "network, discrete": lambda: network(
        [kp.ConeStateSpace([[0.5]], [[1]], [[1]], [[0]], dt=True)] * 2, [[0, 0.25], [0.25, 0]]
    ),
    "positive, from generators": lambda: kp.cone_positivity(INWARDS, *PYRAMID, without_facets(SQUARE.rays), LINE, LINE),
    "positive, discrete, from generators": lambda: kp.state_positivity(
        [["1/3", 0.1, 0], [0, 0.25, 0.2], [0, 0, 1]], without_facets(SQUARE.rays), discrete=True
    ),
    "not positive, from generators": lambda: kp.state_positivity(
        [[-2, 0.1, 0], [0, -3, 2.5], [0, 0, -1]], without_facets(SQUARE.rays)
    ),
    "not positive, input, from generators": lambda: kp.cone_positivity(
        INWARDS, [[1], [0], ["0.9"]], *PYRAMID[1:], without_facets(SQUARE.rays), LINE, LINE
    ),
    "stable, from generators": lambda: kp.linear_lyapunov(INWARDS, without_facets(SQUARE.rays)),
    "unstable, from generators": lambda: kp.linear_lyapunov(np.diag([-1, -1, 0.5]), without_facets(SQUARE.rays)),
    "dissipative, from generators": lambda: kp.dissipativity(
        INWARDS, *PYRAMID, without_facets(SQUARE.rays), LINE, LINE, q=[-1], r=[2]
    ),
    **GAINS,
    "cone": lambda: kp.find_cone(SPIRAL).certificate,
    "cone, few weights": lambda: thin_cone(SPIRAL),
    "cone, by facets": lambda: kp.find_cone(SPIRAL, few="facets").certificate,
    "cone, discrete": lambda: kp.find_cone([[0.5, 0.4, 0], [-0.4, 0.5, 0], [0, 0, 0.9]], discrete=True).certificate,
    "cone with ports": ports,
    "cone and vector for a family": lambda: kp.find_cone(FAMILY).certificate,
    "feedback, gain bound": lambda: designed(gain_bound=[100.0]),
    "feedback, gain bound of no gain": lambda: (
        kp.state_feedback(kp.ConeStateSpace([[-1, 0], [0, -2]], [[1], [0]], [[1, 0]], 0), gain_bound=1).certificate
    ),
    "feedback, common vector": lambda: designed(vertices=two_vertices()),
    "feedback, common vector of the dual": lambda: of_vertices([[-1, 3], [0, -3]], [[-5, 4], [4, -5]]),
    "feedback, disturbance gain of vertices": lambda: of_vertices(
        [[1, 1], [1, -3]], [["1/2", 1], [1, -4]], gain_bound=8, disturbance=([[1], [1]], [[1, 0]])
    ),
    "feedback, disturbance gain": lambda: designed(gain_bound=[50.0], disturbance=([[0], [1]], [[1, 0]])),
    "Jacobians, common vector": lambda: kp.differential_positivity(FAMILY, kp.orthant(2)),
    "Jacobians": lambda: kp.differential_positivity([[[-2, 1], [1, 2]], FAMILY[1]], kp.orthant(2)),
    "Jacobians, discrete": lambda: kp.differential_positivity(
        [[[0.5, 0.1, 0], [0, 0.5, 0], [0, 0, 0.75]], np.eye(3) / 2], SQUARE, discrete=True
    ),
    "Jacobians, one not positive": lambda: kp.differential_positivity(
        [FAMILY[0], [[-3, 1], [-0.5, -2]]], kp.orthant(2)
    ),
    "Jacobians within bounds": lambda: pendulum(kp.PolyhedralCone([[1, 0], [1, -2]]), [[-1.5, 1.5], [-9, 9]]),
    "Jacobians within bounds, common vector": lambda: pendulum(PAPER, [[-0.1, 0.1], [-1, 1]], -20.5, -13.0),
    "Jacobians within bounds, on an orthant": lambda: kp.differential_positivity(
        ct.nlsys(lambda t, x, u, p: [np.sin(x[1]) - 2 * x[0], np.exp(x[0]) - 5 * x[1]], inputs=0, states=2),
        kp.orthant(2),
        [[-1, 1], [-1, 1]],
    ),
    "Jacobians within bounds, four generators": lambda: kp.differential_positivity(
        ct.nlsys(lambda t, x, u, p: [-3 * x[0] + 0.1 * np.sin(x[1]), 0.1 * x[2] - 3 * x[1], -x[2]], inputs=0, states=3),
        SQUARE,
        [[-1, 1]] * 3,
    ),
    "Jacobians within bounds, not positive": lambda: pendulum(kp.PolyhedralCone([[1, 0], [1, -2]]), [[-4, 4], [-9, 9]]),
    "stable, tightest rate, four generators": lambda: kp.linear_lyapunov(INWARDS, SQUARE, rate="max"),
    "stable, tightest rate, discrete": lambda: kp.linear_lyapunov(
        [[0.5, 0.25], [0.25, 0.5]], kp.orthant(2), discrete=True, rate="max"
    ),
    "bracket": lambda: bracket(mass_springs(), kp.examples.ring(4)),
    "bracket, algebraic loops": lambda: bracket(mixed_nodes(), LINKS),
    "bracket, discrete": lambda: bracket(
        [kp.ConeStateSpace([[0.5]], [[1]], [[1]], [[0]], dt=True)] * 2, [[0, 0.25], [0.25, 0]]
    ),
    "any number of nodes": lambda: kp.scale_free_certificate(node(-2)),
    "any number of nodes, of two types": lambda: kp.scale_free_certificate([node(-2), node(-3)]),
    "any number of nodes, algebraic loops": lambda: kp.scale_free_certificate(node(-2, 0.5)),
    "any number of nodes, link": lambda: kp.scale_free_certificate(node(-2), weight=1.5, link=[[0.5]]),
    "any number of nodes, rounded product": lambda: kp.scale_free_certificate(node(-2), weight=0.7, link=[[0.3]]),
    "any number of nodes, exact link": lambda: kp.scale_free_certificate(node(-2), weight=1, link=[["1/3"]]),
    "any number of nodes, paper": lambda: kp.scale_free_certificate(kp.examples.mass_spring_node(), weight=21),
    "any number of nodes, at a rate": lambda: kp.scale_free_feedback(third(), 1, rate="1/3").certificate,
    "any number of nodes, not stable": lambda: kp.scale_free_certificate(node(-2), weight=3),
    "optimal cost": lambda: optimal().certificate,
    "optimal cost, continuous, with a discount": lambda: (
        optimal(
            [["-1/3", 0.5], [0.25, -2]], [[0.125], [-0.25]], s=["1/3", 1], limits=[["1/7", 0.5]], discount="1/3"
        ).certificate
    ),
    "optimal cost, groups and a disturbance": lambda: (
        optimal(
            [["1/2", "1/4"], [0, "1/4"]],
            [[0, -0.125], [0.25, 0]],
            X=None,
            r=[1, "-1/3"],
            groups=[[0, 1]],
            disturbance=([["1/7"], [0]], [[0.5, 0]]),
            discrete=True,
        ).certificate
    ),
    "optimal cost, four generators": lambda: on_a_square(discrete=True).certificate,
    "optimal cost, four generators in continuous time": lambda: on_a_square(discrete=False).certificate,
    "optimal cost, four generators, not finite": lambda: on_a_square(2, discrete=True).certificate,
    "finite cost, four generators": lambda: on_a_square(2, discrete=True, horizon=2).certificate,
    "finite cost": lambda: optimal(horizon=3, terminal_cost=["1/3", "1/7"]).certificate,
    "finite cost, rounded": lambda: (
        optimal(
            A=[["1/3", "1/7"], ["1/11", 0.2]], X=None, discrete=True, horizon=3, limits=[[0, "1/" + "9" * 250]]
        ).certificate
    ),
    "finite cost, groups and a disturbance": lambda: (
        optimal(
            [["1/2", "1/4"], [0, "1/4"]],
            [[0, -0.125], [0.25, 0]],
            X=None,
            r=[1, "-1/3"],
            groups=[[0, 1]],
            disturbance=([["1/7"], [0]], [[0.5, 0]]),
            discrete=True,
            discount="1/2",
            horizon=2,
        ).certificate
    ),
    "optimal cost, under constraints": lambda: optimal(constraints=lambda F: [F[0, 0] >= -1]).certificate,
    "optimal cost, under constraints, four generators": lambda: (
        on_a_square(discrete=True, constraints=lambda F: [F[0, 2] <= 0.25]).certificate
    ),
    "optimal cost, groups under constraints": lambda: (
        optimal(
            [["1/2", "1/4"], [0, "1/4"]],
            [[0, -0.125], [0.25, 0]],
            X=None,
            r=[1, "-1/3"],
            groups=[[0, 1]],
            use_all=True,
            s=[3, 3],
            constraints=lambda F: [F[1, 0] <= 1],
            discrete=True,
        ).certificate
    ),
    "optimal cost, not finite": lambda: optimal([[2, 0], [0, 0.5]], [[0.5], [0]], limits=[[1, 0]], X=None).certificate,
    "order interval": lambda: interval([0, 1], ([[1, 0], [0, -1]], ["1/22", 0.5])).certificate,
    "order interval, four generators": lambda: (
        kp.order_interval(
            kp.ConeStateSpace(np.diag([-2.0, -2.0, -1.0]), np.eye(3), np.eye(3), 0, X=SQUARE),
            [0, 0, "1/3"],
            constraints=([[1, 0, 0]], [1]),
        ).certificate
    ),
    "order interval, discrete, beside what grows": lambda: (
        kp.order_interval(kp.ConeStateSpace([[2, 0], [0, 0.5]], np.eye(2), np.eye(2), 0, True), [0, 1]).certificate
    ),
    "not any order interval": lambda: interval([1, 0], X=kp.orthant(2), A=[[1, 0], [0, -1]]).certificate,
    "not any order interval within a bound": lambda: interval([0, 1], ([[1, 0]], ["1/23"])).certificate,
    "network interval": lambda: network_interval(
        [kp.ConeStateSpace([[0, 1], [-22, -14]], [[0], [1]], [[1, 0]], 0, X=PAPER), pyramid()],
        [[0, 0.25], [0.5, 0]],
        [0, "1/3", 0, 0, 1],
        ([[1, 0, 0, 0, 0], [0, -1, 1, 1, 0]], ["1/9", 4]),
    ),
    "network interval, feedthrough": lambda: network_interval(mixed_nodes(), LINKS, [1, 0, 0.5, 1]),
    "network interval, discrete": lambda: network_interval([SLOW] * 2, [[0, 0.5], [0.25, 0]], [1, "1/7"]),
    "not any network interval": lambda: network_interval([node(-0.5), node(-1)], [[0, 1], [1, 0]], [0, "1/3"]),
    "not any network interval within a bound": lambda: network_interval(
        [pyramid(), LAG], [[0, 0.25], [0.5, 0]], [0, 0, 1, 1], ([[0, 0, 0, 1], [0, 0, 1, 0]], [9, "1/3"])
    ),
    **certified_vertices.CERTIFICATES,
    "feedback in an interval": lambda: designed(state_bounds=[1, -1], input_bounds=10, disturbance_bounds=[0, "1/10"]),
    "not any feedback within bounds": lambda: designed(state_bounds=[1, "-1/3"], input_bounds="1/7"),
    "not any feedback within bounds, four generators, two vertices": lambda: (
        kp.state_feedback(
            pyramid(),
            vertices=[([[-1, 0, 0], [0, -1, 0], [0, 0, rate]], [[0], [0], [1]]) for rate in ("1/3", 0.5)],
            state_bounds=[0, 0, 1],
            disturbance_bounds=[0, 0, 0.25],
            input_bounds="2/3",
        ).certificate
    ),
    "not any feedback of a structure within bounds": lambda: (
        kp.state_feedback(
            kp.ConeStateSpace([[0.5, 0], [0, "4/3"]], [[0], [1]], np.eye(2), 0, True),
            state_bounds=[1, 1],
            structure=[[1, 0]],
        ).certificate
    ),
    "not any cone, ahead": lambda: kp.find_cone([[0, 1], [-1, 0]]).certificate,
    "not any cone, ahead, discrete": lambda: kp.find_cone([[-2, 0], [0, 1]], discrete=True).certificate,
    "not any cone, beside": lambda: kp.find_cone([["1/3", 1, 0], [-1, "1/3", 0], [0, 0, "1/3"]]).certificate,
    "not any cone, beside, discrete": lambda: (
        kp.find_cone([["0.6", "-0.8", 0], ["0.8", "0.6", 0], [0, 0, 1]], discrete=True).certificate
    ),
    "not any cone, longer chains": lambda: (
        kp.find_cone([["1/3", 0, 0], [0, "-1/3", 1], [0, 0, "-1/3"]], discrete=True).certificate
    ),
    "not any cone, cycle": lambda: kp.find_cone(TURNED).certificate,
    "not any cone, cycle, discrete": lambda: kp.find_cone(TURNED, discrete=True).certificate,
    "not any cone, ports": lambda: kp.find_cone(ct.ss([[-1, 0], [0, -2]], [[1], [1]], [[-1, 2]], [[0]])).certificate,
    "not any cone, response below zero": lambda: kp.find_cone(DECAYS, [[1, 1, 1]], [["0.2499", -1, 1]]).certificate,
    "not any cone, response at zero": lambda: (
        kp.find_cone([["-1/3", 0, 0], [0, "-2/3", 0], [0, 0, -1]], [[1, 1, 1]], [["1/4", -1, 1]]).certificate
    ),
    "not any feedback": lambda: kp.state_feedback(kp.ConeStateSpace(*kp.examples.mass_spring())).certificate,
    "not any feedback, gain bound": lambda: designed(rate=50.0, gain_bound=[30.0]),
    "not any feedback, ports": lambda: (
        kp.state_feedback(
            kp.ConeStateSpace([[-1, -1], [0, -1]], [[0], [1]], [[1, 0]], 0), gain_bound=[5.0], ports=True
        ).certificate
    ),
    "not any feedback, two vertices": lambda: (
        kp.state_feedback(kp.ConeStateSpace(*kp.examples.mass_spring()), vertices=two_vertices()).certificate
    ),
    "not any feedback, discrete": lambda: (
        kp.state_feedback(kp.ConeStateSpace([[0.5, -1], [0, 1.5]], [[0], [1]], [[1, 0]], 0, dt=True)).certificate
    ),
    "not any invariant gain": lambda: (
        kp.output_feedback(kp.ConeStateSpace(*kp.examples.mass_spring()[:2], [[0, 1]], 0)).certificate
    ),
    "not any invariant gain, four generators": lambda: (
        kp.state_feedback(
            kp.ConeStateSpace([[-1, 0, 0], [0, -1, 0], [3, 0, -1]], [[0], [1], [0]], [[1, 0, 0]], 0, X=SQUARE)
        ).certificate
    ),
}
# for which no proof that stands alone is written, with the reason
FOR_THE_PACKAGE = {
    "no cone, too many states": lambda: kp.find_cone(sp.linalg.block_diag(*[[[0, 1], [-1, 0]]] * 16)).certificate,
}
