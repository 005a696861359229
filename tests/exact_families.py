"""What "1/3" becomes in the arguments of `switched`, for the test of exact arguments."""

from exact_plants import THIRD

import control_kpos as kp

MINUS, CONE = [[-1, 0], [0, -1]], [["1/3", "1/7"], [0, 1]]
SIXTH = THIRD / 2


def random(**more):
    """A chain of two members on the half-line."""
    return kp.switched([[[-3]], [[-2]]], **{"chain": [[-1, 1], [1, -1]]} | more).certificate


SWITCHED = {
    "family": lambda: (kp.switched([[["-1/3"]]]).certificate.loops[0].A, [[-THIRD]]),
    "X": lambda: (kp.switched([MINUS], X=CONE).certificate.loops[0].X, kp.PolyhedralCone([[7, 3], [0, 1]]).dual),
    "chain": lambda: (
        random(chain=[["-1/3", "1/3"], ["1/6", "-1/6"]]).chain,
        [[-THIRD, THIRD], [SIXTH, -SIXTH]],
    ),
    "jumps": lambda: (random(jumps={(0, 1): [["1/3"]]}).jumps[0].A, [[THIRD]]),
    "rate": lambda: (random(rate="1/3").required_rate, THIRD),
}
