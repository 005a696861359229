"""The node of the paper: a mass, a spring, a damper, and its cone."""

import numpy as np

A, B, C, D = np.array([[0.0, 1.0], [-22.0, -13.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
RAYS = [[0, 1], [1, -2]]
NAMES = {"name": "node", "inputs": ["force"], "outputs": ["place"], "states": ["place", "speed"]}


def same(s, t):
    """Same system, same cones, same verdict."""
    return (
        all((getattr(s, name) == getattr(t, name)).all() for name in "ABCD")
        and s.cones == t.cones
        and s.dt == t.dt
        and (s.input_labels, s.output_labels, s.state_labels) == (t.input_labels, t.output_labels, t.state_labels)
        and s.cone_positivity().status is t.cone_positivity().status
    )
