"""Systems that have positive realizations by construction, in other coordinates."""

import control as ct
import numpy as np


def hidden(seed):
    """A positive system of order 2 to 6, dense or sparse, continuous or discrete, and that order.

    Coordinates are changed by integer matrices with integer inverses, so that the numbers of the system are exact;
    where it is dense, and leaves room for rounding, also by any matrices.
    """
    rng = np.random.default_rng(seed)
    n, discrete, sparse, short = 2 + seed % 5, seed // 5 % 2 == 1, seed // 10 % 2 == 1, seed // 20 % 2 == 1
    P = rng.integers(1, 33, (n, n)) / 32
    b, c = rng.integers(1, 9, (n, 1)) / 8, rng.integers(1, 9, (1, n)) / 8
    if sparse:
        P, b, c = P * (rng.random((n, n)) < 0.5), b * (rng.random((n, 1)) < 0.6), c * (rng.random((1, n)) < 0.6)
        b[0], c[0, 0] = 1, 1
    if discrete:
        P = P / 2 ** np.ceil(np.log2(max(P.sum(axis=0).max(), 1e-3)))
    else:
        P = P - np.diag(rng.integers(1, 65, n) / 16 + (rng.random() < 0.8) * P.sum(axis=0))
    lower, upper = (np.tril(rng.integers(-2, 3, (n, n)), -1) + np.eye(n) for _ in range(2))
    rounded = not sparse and seed // 40 % 2 == 1
    T, inverse = lower @ upper.T, np.rint(np.linalg.inv(upper.T)) @ np.rint(np.linalg.inv(lower))
    T = rng.standard_normal((n, n)) if rounded else T
    inverse = np.linalg.inv(T) if rounded else inverse
    system = ct.ss(T @ P @ inverse, T @ b, c @ inverse, 0, True if discrete else 0)
    return (ct.ss2tf(system) if short else system), n
