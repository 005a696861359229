"""A certificate of every kind about networks with vertices, and nonlinear ones; part of `certified`."""

import certified_data
import certified_nonlinear
import certified_observers
import numpy as np

import control_kpos as kp

# ROWS map the nonnegative orthant into SQUARE.
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
ROWS = [[1, -1, 0], [1, 1, 0], [1, 1, 1]]


def lag(rate, gain=1, D=0):
    return kp.ConeStateSpace([[rate]], [[gain]], [[1]], [[D]])


def in_a_loop(*vertices):
    """A node with these vertices in a loop with a lag."""
    return kp.feedback_interconnect([list(vertices), lag(-1)], [[0, 0.5], [0.5, 0]]).certificate


def with_four_outputs(*rates):
    """Nodes whose output cone has four generators, with links among their own ports."""
    made = [kp.ConeStateSpace(np.diag([r] * 3), [["1/3"]] * 3, ROWS, 0, Y=SQUARE) for r in rates]
    return kp.feedback_interconnect([made], [[0, 0, 0.25]]).certificate


def square(*rates):
    """Nodes with four generators of X, U and Y, and a third of every state as its input."""
    cones = {"X": SQUARE, "U": SQUARE, "Y": SQUARE}
    made = [kp.ConeStateSpace([[r, 0, 0], [0, r, 0], [0, 0, r]], np.eye(3), np.eye(3), 0, **cones) for r in rates]
    return kp.feedback_interconnect([made], [["1/3", 0, 0], [0, "1/3", 0], [0, 0, "1/3"]]).certificate


def crossed(D=None):
    """Both vertices are stable and the mixture of their columns is not."""
    B = [[[[1.5, 0], [0, 0]]], [[[0, 0], [0, 1.5]]]]
    nodes = kp.stack([[[-1, 0], [0, -1]]], B, np.eye(2)) if D is None else kp.stack([np.diag([-9, -9])], TWO, TWO, D)
    return kp.feedback_interconnect(nodes, [[0, 1], [1, 0]]).certificate


def rows_alone(entries, W, outputs=1):
    """Vertices with a common e and no common v, in a loop with a lag."""
    made = [([[-1, 0], [3, -3]], "1/8"), ([[-5, 4], [4, -5]], 0.125)]
    if outputs == 1:
        node = [kp.ConeStateSpace(A, [[1], [0]], [[0, gain]], 0) for A, gain in made]
        return kp.feedback_interconnect([node, lag(-2, *entries)], [[0, W], [1, 0]]).certificate
    node = [kp.ConeStateSpace(A, [[1], [0]], [[0, 0], [0, 0], [0, gain]], 0, Y=SQUARE) for A, gain in made]
    return kp.feedback_interconnect([node, lag(-2, *entries)], [[0, 0, 0, W], [0, 0, 1, 0]]).certificate


def with_opposite_signs():
    """A loop that is unstable if both links are below 0."""
    W = [[0, kp.interval(-2, "1/3")], [kp.interval("-5/3", 0.5), 0]]
    return kp.feedback_interconnect([lag(-1), lag(-1)], W).certificate


TWO = np.eye(2)
CERTIFICATES = {
    "vertices": lambda: in_a_loop(lag("-7/3"), lag(-0.75), lag(-3, D=0.25)),
    "vertices, four generators of outputs": lambda: with_four_outputs(-2, -2.25),
    "vertices and ranges": lambda: (
        kp.feedback_interconnect(
            [kp.stack(kp.interval([["-7/3"]], [[-2]]), [[1]], kp.interval([[0]], [[0.5]])), [lag(-2), lag(-3)]],
            [[0, kp.interval("1/3", 1)], [0.5, 0]],
        ).certificate
    ),
    "vertices, four generators of everything": lambda: square(-2, "-7/3"),
    "bounded": lambda: rows_alone([1, 0.25], 1),
    "bounded, a cone of four generators": lambda: rows_alone(["1/3"], 1, 3),
    "bounded, in ranges": lambda: rows_alone([1], kp.interval("1/3", 0.5)),
    "bounded, around 0": lambda: (
        kp.feedback_interconnect(
            [kp.stack(kp.interval([["-7/3"]], [[-2]]), [[1]], kp.interval([[-1]], [[0.5]])), [lag(-2), lag(-3)]],
            [[0, kp.interval("-1/3", 1)], [0.5, 0]],
        ).certificate
    ),
    "not for any range": lambda: kp.feedback_interconnect([lag(-1)], [[kp.interval("-5/3", 0.5)]]).certificate,
    "not for any signs": with_opposite_signs,
    "not for any vertices": lambda: in_a_loop(lag(-1), lag("1/3")),
    "not for any vertices, positive": lambda: in_a_loop(lag(-1), lag(-1, "-1/3")),
    "not for any vertices, mixed": crossed,
    "not for any vertices, mixed directly": lambda: crossed([[[[1.25, 0], [0, 0]]], [[[0, 0], [0, 1.25]]]]),
}
CERTIFICATES |= certified_nonlinear.CERTIFICATES | certified_observers.CERTIFICATES | certified_data.CERTIFICATES
