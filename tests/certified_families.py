"""Certificates about families, for the tests of files and of the checker."""

import numpy as np

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
