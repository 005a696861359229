"""A certificate of every kind about plants that agree with measurements; part of `certified`."""

from fractions import Fraction

import numpy as np

import control_kpos as kp

SQUARE = [[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]]
X0, U0 = [[1, 0, 1, 2], [0, 1, 1, 1]], [[0, 0, 1, -1]]


def sampled(A, B=None, states=X0, inputs=U0):
    """A x + B u, exactly."""
    image = np.array([[Fraction(a) for a in row] for row in A], dtype=object) @ np.array(states)
    return image if B is None else image + np.array([[Fraction(b) for b in row] for row in B], dtype=object) @ inputs


def known(A, X=None, noise="1/100", states=X0, **more):
    return kp.data_positivity(states, sampled(A, states=states), noise=noise, X=X, **more).certificate


def driven(A, B, **more):
    return kp.data_feedback(X0, sampled(A, B), U0, noise="1/100", **more).certificate


THREE = [[1, 0, 0, 1, -1], [0, 1, 0, 1, 1], [0, 0, 1, 1, 1]]
TURNED = [[0, "-1/3", 0], ["1/3", 0, 0], [0, 0, "1/2"]]
CERTIFICATES = {
    "data, a gain": lambda: driven([["6/5", "1/3"], ["1/10", "1/2"]], [[1], ["1/5"]]),
    "data, a gain, derivatives": lambda: driven([[0, 1], [-1, 0]], [[0], [1]], discrete=False, X=[[0, 1], [1, -2]]),
    "data": lambda: known([["1/2", "1/5"], ["1/7", "3/5"]]),
    "data, not stable": lambda: known([[2, "1/5"], ["1/7", "3/5"]]),
    "data, derivatives": lambda: known([[-1, "1/5"], ["1/7", -1]], discrete=False),
    "data, four generators": lambda: known(TURNED, SQUARE, states=THREE),
    "data, a plant that leaves": lambda: known([["1/2", "1/5"], ["1/7", "3/5"]], noise="1/3"),
    "data, a plant that leaves, derivatives": lambda: known([[-1, "1/200"], ["1/7", -1]], discrete=False),
    "data, a plant that leaves four generators": lambda: known(TURNED, SQUARE, "1/3", THREE),
}
