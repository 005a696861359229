"""Rows of `test_exact_arguments` about nonlinear networks."""

from fractions import Fraction

import numpy as np
from exact_plants import THIRD

import control_kpos as kp

CONE, SAME = [["1/3", "1/7"], [0, 1]], kp.PolyhedralCone([[7, 3], [0, 1]])
NODES = kp.nonlinear_nodes(lambda x, u, p: [u[0] - x[0]], n_nodes=1)


def holds_a_third():
    """The ends of a coupling of a third lie around it, next to each other."""
    net = kp.nonlinear_interconnect(NODES, [["1/3"]])
    low, high = net.lower[0, 0], net.upper[0, 0]
    return Fraction(low) <= THIRD <= Fraction(high) and high == np.nextafter(low, 1)


ROWS = {
    "nonlinear_nodes": {
        "X": lambda: (kp.nonlinear_nodes(lambda x, u, p: [x[0], x[1]], n_nodes=1, states=2, X=CONE).X, SAME),
    },
    "nonlinear_interconnect": {"coupling": lambda: (holds_a_third(), True)},
}
_COMPUTED = "nonlinear functions compute with doubles; what is no double is refused"
_SIMULATED = "a simulation in floating point"
DOUBLES = {
    "nonlinear_nodes": {"params": _COMPUTED},
    "nonlinear_links": dict.fromkeys(["weights", "targets", "sources"], _COMPUTED),
    "NonlinearNetwork.dynamics": dict.fromkeys("xw", _SIMULATED),
    "NonlinearNetwork.linearize": dict.fromkeys("xw", _SIMULATED),
    "NonlinearNetwork.unpack": {"x": _SIMULATED},
    "NonlinearNetwork.pack": {"rows": _SIMULATED},
}
