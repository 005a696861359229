"""Valid calls about nonlinear networks, argument by argument; part of `malformed_calls`."""

import numpy as np

import control_kpos as kp

NODES = kp.nonlinear_nodes(lambda x, u, p: [u[0] - p["a"] * x[0]], n_nodes=2, params={"a": [1, 2]})
NET = kp.nonlinear_interconnect(NODES, [[0, 0.5], [0.5, 0]])
X = kp.orthant(1)
CALLS = {
    "nonlinear_nodes": (
        kp.nonlinear_nodes,
        {
            "f": NODES.f,
            "g": lambda x, p: [x[0]],
            "n_nodes": 2,
            "states": 1,
            "inputs": 1,
            "outputs": 1,
            "params": {"a": [1, 2]},
            "X": X,
            "names": ["a", "b"],
        },
    ),
    "nonlinear_links": (
        kp.nonlinear_links,
        {"function": np.sin, "targets": [0, 1], "sources": [1, 0], "weights": [1, 2], "difference": True},
    ),
    "nonlinear_interconnect": (kp.nonlinear_interconnect, {"nodes": NODES, "coupling": [[0, 1], [1, 0]]}),
    "differential_positivity of a network": (
        kp.differential_positivity,
        {
            "jacobians": NET,
            "X": None,
            "region": [[0, 1], [0, 1]],
            "inputs": [[0, 1], [0, 1]],
            "equilibrium": None,
            "pieces": 4,
        },
    ),
    "NonlinearNetwork.dynamics": (NET.dynamics, {"x": [0, 1], "w": [0, 0]}),
    "NonlinearNetwork.linearize": (NET.linearize, {"x": [0, 1], "w": [0, 0]}),
    "NonlinearNetwork.unpack": (NET.unpack, {"x": [0, 1]}),
}
