"""Certificates of every kind for the tests of files and of the checker, small and with data of many sorts."""

import numpy as np

import control_kpos as kp

PAPER = kp.PolyhedralCone([[0, 1], [1, -2]])
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
LINE = kp.orthant(1)


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

CERTIFICATES = {
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
    "network": lambda: network(mass_springs(), kp.examples.ring(4)),
    "network, algebraic loops": lambda: network(mixed_nodes(), LINKS),
    "network, given supplies": lambda: network(
        [kp.ConeStateSpace([[-2]], [[1]], [[1]], [[0]])] * 2,
        [[0, 1], [1, 0]],
        supply_rates=[([-1], [0.6]), ([-1.5], [0.9])],
    ),
    "network, unstable": lambda: network(mass_springs(), 30 * kp.examples.ring(4)),
    "network, unstable, algebraic loops": lambda: network(mixed_nodes(), [[0, 0.5, 0], [9, 0, 0.1], [0.2, 0.2, 0]]),
    "network, wrong link": lambda: network(mass_springs(), -kp.examples.ring(4)),
    "network, node not positive": lambda: network(mass_springs(extra=1.0), kp.examples.ring(4)),
}
# refuted without a proof that stands alone
FOR_THE_PACKAGE = {
    "network, ill-posed loop": lambda: network(mixed_nodes(), [[0, 0.5, 4], [9, 0, 0.1], [4, 0.2, 0]]),
}
