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


def driven(A, B, noise="1/100", states=X0, inputs=U0, **more):
    return kp.data_feedback(states, sampled(A, B, states, inputs), inputs, noise=noise, **more).certificate


THREE = [[1, 0, 0, 1, -1], [0, 1, 0, 1, 1], [0, 0, 1, 1, 1]]
TURNED = [[0, "-1/3", 0], ["1/3", 0, 0], [0, 0, "1/2"]]
WEAK = [["6/5", "3/10"], ["1/10", "1/2"]], [[1], ["1/5"]]
FLAT = [[2, 0, 0], [0, 1, 0], [0, 0, -1]], [[0], [0], [0]]
CERTIFICATES = {
    "data, a gain": lambda: driven([["6/5", "1/3"], ["1/10", "1/2"]], [[1], ["1/5"]]),
    "data, a gain, derivatives": lambda: driven([[0, 1], [-1, 0]], [[0], [1]], discrete=False, X=[[0, 1], [1, -2]]),
    "data": lambda: known([["1/2", "1/5"], ["1/7", "3/5"]]),
    "data, growing": lambda: known([[2, "1/5"], ["1/7", "3/5"]]),
    "data, derivatives": lambda: known([[-1, "1/5"], ["1/7", -1]], discrete=False),
    "data, four generators": lambda: known(TURNED, SQUARE, states=THREE),
    "data, a plant that is not kept": lambda: known([["1/2", "1/5"], ["1/7", "3/5"]], noise="1/3"),
    "data, a plant that is not kept, derivatives": lambda: known([[-1, "1/200"], ["1/7", -1]], discrete=False),
    "data, not for any gain": lambda: driven(*WEAK, noise="1/5"),
    "data, not for any gain, a common vector": lambda: driven(*WEAK, noise="1/10"),
    "data, not for any gain, derivatives": lambda: driven([[0, 1], [-1, 0]], [[0], [1]], discrete=False),
    "data, not for any gain, four generators": lambda: driven(
        *FLAT, noise="1/1000", states=THREE, inputs=[[1, 0, 0, 2, 1]], X=SQUARE
    ),
    "data, a plant that is not kept, four generators": lambda: known(TURNED, SQUARE, "1/3", THREE),
}
