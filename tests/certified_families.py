"""Certificates about families, for the tests of files and of the checker."""

from fractions import Fraction

import numpy as np
import scipy.sparse as sp

import control_kpos as kp

SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
DIAGONALS = [[[-1, 0, 0], [0, -1, 0], [0, 0, "1/3"]], [[-2, 0, 0], [0, -1, 0], [0, 0, "-1/7"]]]
CYCLE = [[[0, 2], [0, 0]], [[0, 0], ["1/2", 0]]]
TURNS = [[["1/2", "1/2"], [0, "1/2"]], [["1/2", 0], ["1/2", "1/2"]]]
STEPS = [[["1/2", "5/3"], [0, "1/2"]], [["1/2", 0], [2, "1/2"]]]
SLOW_TURNS = [[["1/2", "5/2"], [0, "1/2"]], [["3/2", 0], ["1/2", "1/2"]]]
QUIET = [[[-1, 0, 0], [0, -1, 0], [0, 0, "-1/3"]], [[-2, 0, 0], [0, -1, 0], [0, 0, "1/9"]]]
SLOWLY = [["-1/9", "1/9"], [1, -1]]
DWELLING = [[[-1, 0, 0], [10, -1, 0], [0, 0, -10]], [[-10, 0, 10], [0, -10, 0], [0, 10, -1]]]


def dwelling(family, status, X=None, discrete=None):
    """A certificate about a dwell time."""
    s = kp.switched(family, X=X, discrete=discrete)
    found = [p for p in (s.certificate, *s.others) if isinstance(p, kp.DwellCertificate) and p.status.name == status]
    return found[0]


def random(*members, **more):
    """A certificate about the mean, for the same chain of two members."""
    chain = [["2/3", "1/3"], ["1/2", "1/2"]] if more.get("discrete") else [[-1, 1], ["2/3", "-2/3"]]
    return kp.switched(list(members), **{"chain": chain} | more).certificate


PULSES = {(0, 1): [["1/2", "1/3"], [0, 1]]}
TURN = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
BOTH = [[[1, 0], [1, -3]], [["-10/3", 1], [0, 1]]]
SWITCHED = {
    "common vector, not any": lambda: kp.switched([[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]]).others[0],
    "common vector, not any, discrete": lambda: kp.switched(TURNS, discrete=True).others[0],
    "common vector, not any, four generators": lambda: next(
        p for p in kp.switched(DIAGONALS, X=SQUARE).others if not p
    ),
    "family, not stable, a mixture": lambda: kp.switched([[[-1, "10/3"], [0, -1]], [[-1, 0], [10, -1]]]).certificate,
    "family, not stable, a member": lambda: kp.switched([[["1/3", 0], [0, -1]], [[-1, 0], [0, -1]]]).certificate,
    "family, not stable, a mixture, discrete": lambda: (
        kp.switched([[[0, "10/3"], [0, 0]], [[0, 0], [10, 0]]], discrete=True).certificate
    ),
    "family, not stable, a cycle": lambda: kp.switched(CYCLE, discrete=True).certificate,
    "family, not stable, four generators": lambda: kp.switched(DIAGONALS, X=SQUARE).certificate,
    "dwell time": lambda: dwelling([[[-1, "10/3"], [0, -1]], [[-1, 0], [3, -1]]], "PROVED"),
    "dwell time, not enough": lambda: dwelling([[[-1, "10/3"], [0, -1]], [[-1, 0], [3, -1]]], "REFUTED"),
    "growth under switching": lambda: kp.switched(TURNS, discrete=True).certificate,
    "growth under switching, four generators": lambda: next(
        p for p in kp.switched([np.diag([0.25, 0.5, 1]), np.eye(3) / 4], X=SQUARE, discrete=True).others if p
    ),
    "dwell time, discrete": lambda: dwelling(STEPS, "PROVED", discrete=True),
    "dwell time, not enough, discrete": lambda: dwelling(STEPS, "REFUTED", discrete=True),
    "mean stable": lambda: random([[-2, 1], [0, -1]], [["1/3", 0], [0, -3]], rate="1/50"),
    "mean stable, with jumps, discrete": lambda: random(*TURNS, jumps=PULSES, discrete=True, rate="max"),
    "mean stable, four generators": lambda: random(*QUIET, X=SQUARE, jumps={(1, 0): TURN}),
    "not mean stable": lambda: random([[-2, 1], [0, -1]], [["2/3", 0], [0, -3]], jumps={(1, 0): [[2, 0], [0, 2]]}),
    "not mean stable at a rate": lambda: random([[-2, 1], [0, -1]], [["1/3", 0], [0, -3]], rate=2),
    "not mean stable, discrete": lambda: random(*SLOW_TURNS, jumps=PULSES, discrete=True),
    "not mean stable, four generators": lambda: random(*DIAGONALS, X=SQUARE, jumps={(1, 0): TURN}, chain=SLOWLY),
    "stabilising switching": lambda: kp.switched(BOTH).stabilising,
    "stabilising switching, discrete": lambda: kp.switched(STEPS, discrete=True).stabilising,
    "stabilising switching, four generators": lambda: kp.switched(DIAGONALS, X=SQUARE).stabilising,
}


def pairs():
    """Two nodes on a cone of four generators and one on the half-line."""
    first = kp.stack([np.diag([-3.0, -3, -2])] * 2, B=[[0], [0], [1]], C=[[0, 0, 1]], X=SQUARE)
    other = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
    return kp.feedback_interconnect([first, other], [[0, 0, 1], [0.5, 0, 0], [0, 0.25, 0]])


TWO = kp.stack([[[-2]], [[-3]]], B=[[1]], C=[[1]])
RING = [[0, 1], [1, 0]]
DELAYED = {
    "delays": lambda: kp.delayed([[-3, "1/3"], [1, -3]], [[["1/7", 0], [0, 1]], [[0, 0], [1, 0]]]),
    "delays with a rate": lambda: kp.delayed([[-3, 1], [1, -3]], [[1, 0], [0, 1]], max_delay="1/3"),
    "delays with a rate, discrete": lambda: kp.delayed([["0.3"]], [["0.2"]], discrete=True, max_delay=4),
    "delays with a rate, four generators": lambda: kp.delayed(
        np.diag([-3, -3, -2]), np.diag([0.5, 0.25, 1]), SQUARE, max_delay=2
    ),
    "delays, not stable": lambda: kp.delayed([[-2, "1/3"], [1, -2]], [[2, 0], [0, "1/3"]]),
    "delays, not stable, four generators": lambda: kp.delayed(np.diag([-3, -3, -2]), np.diag([0.5, 0.25, 3]), SQUARE),
    "delays, not positive": lambda: kp.delayed([[-1, 1], [0, -1]], [[[1, 0], [0, 1]], [[1, 0], ["-1/3", 0]]]),
    "delays, not positive, four generators": lambda: kp.delayed(np.diag([-3, -3, -4]), np.diag([4.5, 0, 3]), SQUARE),
    "network with delays": lambda: kp.delayed(kp.feedback_interconnect(TWO, RING), [[["1/2"]], [["1/3"]]]),
    "network with delays, discrete": lambda: kp.delayed(
        kp.feedback_interconnect(kp.stack([[[0.25]], [[0.125]]], B=[[1]], C=[[1]], dt=1), [[0, 0.25], [0.5, 0]]),
        [[0.25]],
    ),
    "network with delays, four generators": lambda: kp.delayed(
        pairs(), [np.diag([0.5, 0.25, 1]), np.diag([0, 0.25, 0.5]), [[0.5]]]
    ),
    "network with delays, not stable": lambda: kp.delayed(kp.feedback_interconnect(TWO, RING), [[[2]], [[1]]]),
    "network with delays, not positive": lambda: kp.delayed(kp.feedback_interconnect(TWO, RING), [["-1/8"]]),
}
COMPARTMENTS = {
    "compartments": lambda: kp.compartmental([[0, "1/3", 0], [2, 0, 0], [0, 1, 0]], [0, 0, "1/7"]).certificate,
    "compartments, sparse": lambda: kp.compartmental(sp.csr_array([[0, 1], [2, 0]]), [0, 1e-200]).certificate,
    "compartments, not drained": lambda: kp.compartmental([[0, 3, 0], ["1/3", 0, 0], [0, 0, 0]], [0, 0, 1]).certificate,
}
REALIZATIONS = {
    "positive realization": lambda: kp.positive_realization([0, "1/3", "1/6", "1/12", "1/24"]).certificate,
    "positive realization, more states": lambda: kp.positive_realization(FOUR).certificate,
    "positive realization, not any": lambda: (
        kp.positive_realization(kp.ConeStateSpace([["-1/3"]], [[1]], [[-1]], 0)).certificate
    ),
}
# the impulse response of 1, 2/5 and 1/5 with the weights 1, -25, 75: four rays are needed
FOUR = [0] + [1 - 25 * Fraction(2, 5) ** k + 75 * Fraction(1, 5) ** k for k in range(7)]
SWITCHED |= DELAYED | COMPARTMENTS | REALIZATIONS  # all families
