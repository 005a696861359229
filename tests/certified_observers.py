"""Certificates of interval observers; part of `certified`."""

import control as ct
import numpy as np

import control_kpos as kp

SQUARE = [[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]


def observed(A, C, *, dt=0, X=None, w=None, noise=0):
    plant = kp.ConeStateSpace(A, np.ones((len(A), 1)), C, np.zeros((len(C), 1)), dt, X=X)
    w = [1] * len(A) if w is None else w
    return kp.interval_observer(plant, disturbance=([f"-{x}" for x in w], w), noise=noise, X=X)


def double_integrator(**more):
    plant = ct.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    return kp.interval_observer(plant, disturbance=([0, -1], [0, 1]), noise=["1/10"], **more)


def local(A=((-2, 1), (1, -2)), dt=0, X=None, outputs=None, noise=0.125, W=((0, 0.5), (0.25, 0))):
    """Local observers of two nodes."""
    nodes = kp.stack([A] * 2, [[1], [0]] if X is None else [[0], [1]], [[1, 0]], dt=dt, X=X)
    net = kp.feedback_interconnect(nodes, W, outputs=outputs)
    return kp.interval_observer(net, disturbance=([-0.5] * 4, [1, "1/3", 1, 1]), noise=noise)


CERTIFICATES = {
    "local observers": lambda: local().certificate,
    "local observers, fractions": lambda: local([["-1/3", "1/7"], ["1/5", -1]], noise="1/9").certificate,
    "local observers, in steps": lambda: local([[0.5, 0.25], [0.125, 0.5]], dt=1, outputs=[0]).certificate,
    "local observers, own links": lambda: local(W=[[0.25, 0.5], ["1/3", 0]]).certificate,
    "local observers, another cone": lambda: local([[0, 1], [-22, -13]], X=[[0, 1], [1, -2]]).certificate,
    "observer": lambda: double_integrator().certificate,
    "observer, fractions": lambda: observed([["-1/3", "1/7"], ["1/5", -1]], [[1, 0]], w=["1/3", 1]).certificate,
    "observer, in steps": lambda: observed([[0.5, 0.25], [0.125, 0.75]], [[1, 1]], dt=1, noise=0.25).certificate,
    "observer, four generators": lambda: (
        observed(np.diag([-1, -1.0, -0.5]), [[0, 0, 1]], X=SQUARE, noise=0.125).certificate
    ),
}
