"""Plants with entries that doubles do not hold."""

from fractions import Fraction

import numpy as np

import control_kpos as kp

THIRD = Fraction(1, 3)
LAG = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)


def plant(A, B=None, C=None, **more):
    n = len(A)
    B = [[1]] + [[0]] * (n - 1) if B is None else B
    C = [[1] + [0] * (n - 1)] if C is None else C
    return kp.ConeStateSpace(A, B, C, np.zeros((len(C), len(B[0]))), **more)


def after_one_step(cost):
    """The terminal cost that a plan of one step is about."""
    return kp.optimal_feedback(
        plant([[1]], dt=True), [1], [0], [[0]], horizon=1, terminal_cost=cost
    ).certificate.terminal


def supplied(W, q, r):
    return kp.feedback_interconnect([LAG, LAG], W, supply_rates=[(q, r)] * 2).certificate


THIRDS = plant([["-1/3"]])
