"""A certificate of every kind about nonlinear networks; part of `certified`."""

import numpy as np

import control_kpos as kp

RING = np.array([[0, 0.25, 0], [0, 0, 0.5], [0.25, 0, 0]])


def epidemic(W=RING, region=(0, 1)):
    cities = kp.nonlinear_nodes(lambda x, u, p: [(1 - x[0]) * u[0] - x[0]], n_nodes=3)
    return kp.differential_positivity(kp.nonlinear_interconnect(cities, W), region=[region])


def phases(degrees, lines=None):
    """Two machines and a load, with a cone that is no orthant."""
    machines = kp.nonlinear_nodes(
        lambda x, u, p: [x[1], u[0] - x[0] - 5 * x[1]], n_nodes=2, states=2, X=[[0, 1], [1, -2.5]]
    )
    load = kp.nonlinear_nodes(lambda x, u, p: [u[0]], n_nodes=1)
    lines = kp.nonlinear_links(np.sin, [0, 1, 2, 2], [2, 2, 0, 1], difference=True) if lines is None else lines
    net = kp.nonlinear_interconnect([machines, load], lines)
    high = net.pack([np.radians(degrees), 0], [np.radians(degrees)])
    return kp.differential_positivity(net, region=np.column_stack([-high, high]))


CERTIFICATES = {
    "nonlinear network": epidemic,
    "nonlinear network of order alone": lambda: epidemic(4 * RING),
    "not a nonlinear network of this order": lambda: epidemic(-RING),
    "nonlinear network of phases": lambda: phases(40),
    "not a nonlinear network of phases so far apart": lambda: phases(50),
}
