"""Systems on orthants with structured gains, for tests of gains and of files."""

import numpy as np
import scipy.sparse as sp

import control_kpos as kp

EYE = np.eye(2)
PAIR = kp.ConeStateSpace([[-2, 1], [1, -3]], EYE, EYE, 0)
STEPS = kp.ConeStateSpace([["1/5", "1/10"], ["1/10", "1/3"]], EYE, EYE, [[0, 1], [0, 0]], True)
PYRAMID = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
SLANTED = kp.ConeStateSpace(np.diag([-1, -1, -0.5]), [[0], [0], [1]], [[0.5, 0, 1]], [[1]], X=PYRAMID)
CHAIN = kp.ConeStateSpace([[-1, 0], [1, -1]], EYE, [[0, 0], [1, 0]], 0)  # y2 = x1, so that G(0)^2 = 0


# z1' = -2 z1, z2' = z1 - 3 z2 + u, y = z1 in the coordinates of the generators (0, 1), (1, -2).
TILTED = kp.ConeStateSpace([[-1, 1], [-2, -4]], [[1], [-2]], [[2, 1]], 0, X=[[0, 1], [1, -2]])


def ring(n, **ports):
    """Nodes of one state on a ring, x_j' = -2 x_j + x_(j+1) / 2 + u_j: a network that is kept in sparse matrices."""
    W = sp.csr_array((np.full(n, 0.5), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))
    return kp.feedback_interconnect(kp.stack(np.full((n, 1, 1), -2.0), B=[[1]], C=[[1]]), W, **ports)


def random_system(rng, discrete=False, zeros=0.4):
    """(A, B, C, D), G: positive, stable, with as many inputs as outputs."""
    n, m = rng.integers(1, 6), rng.integers(1, 5)

    def sparse(*shape):
        return rng.random(shape) * (rng.random(shape) > zeros)

    A = sparse(n, n)
    A = A * 0.9 / (A.sum(axis=1, keepdims=True) + 0.2) if discrete else A - np.diag(A.sum(axis=1) + 0.2)
    B, C, D = sparse(n, m), sparse(m, n), sparse(m, m) * (rng.random() < 0.5)
    return (A, B, C, D), D - C @ np.linalg.solve(A - discrete * np.eye(n), B)


GAINS = {
    "L2 gain": lambda: kp.structured_gain(PAIR),
    "structured gain, loops": lambda: kp.structured_gain(PAIR, "diagonal"),
    "structured gain, crossed": lambda: kp.structured_gain(PAIR, [([0], [1]), ([1], [0])]),
    "structured gain, blocks, discrete": lambda: kp.structured_gain(STEPS, [1, 1]),
    "L2 gain, discrete": lambda: kp.structured_gain(STEPS),
    "L2 gain, four generators": lambda: kp.structured_gain(SLANTED),
    "structured gain, zero": lambda: kp.structured_gain(CHAIN, [1, 1]),
    "structured gain, zero, slanted": lambda: kp.structured_gain(TILTED),
    "L2 gain, network": lambda: kp.structured_gain(ring(301)),
    "no L2 gain, unstable": lambda: kp.structured_gain(kp.ConeStateSpace([[1, 1], [1, -3]], EYE, EYE, 0)),
    "no L2 gain, not positive": lambda: kp.structured_gain(kp.ConeStateSpace([[-2, -1], [1, -3]], EYE, EYE, 0)),
}
