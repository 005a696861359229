"""Small nodes and couplings for the tests of networks."""

import numpy as np
import scipy.sparse as sp

import control_kpos as kp

CONE = kp.PolyhedralCone([[0, 1], [1, -2]])


def lag(rate, D=0.0, dt=0, **names):
    """x' = -rate x + u, y = x + D u."""
    return kp.ConeStateSpace([[-rate if not dt else rate]], [[1.0]], [[1.0]], [[D]], dt, **names)


def mass(F=(-21, -13), k=1.0, **names):
    return kp.ConeStateSpace([[0, 1], [F[0] - k, F[1]]], [[0], [1]], [[1, 0]], 0, X=CONE, **names)


def cycle(n, weight=1.0):
    return weight * np.roll(np.eye(n), 1, axis=1)


def random_masses(rng, n):
    A = np.zeros((n, 2, 2))
    A[:, 0, 1] = 1
    A[:, 1, 0] = -21 + rng.uniform(-1, 0, n) - rng.uniform(0.5, 1.5, n)
    A[:, 1, 1] = -13 + rng.uniform(-2, -1, n)
    return kp.stack(A, [[0], [1]], [[1, 0]], X=CONE)


def is_unstable(net):
    return np.linalg.eigvals(net.A).real.max() > 0


def sparse_ring(n):
    return sp.csr_array((np.ones(n), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))
