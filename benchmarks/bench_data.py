"""Gains from measurements: the whole answer with its proof, beside HiGHS on the program that its user would write.

Six states, two inputs, 200 samples, noise of 1 % of the states, on the orthant: 42 bounds of plants in each program.
"""

import highspy
import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp

NOISE = 0.01


def measurements(n, m, count):
    """A plant that a gain can make positive and stable, seen through noise."""
    rng = np.random.default_rng(1)
    M = rng.uniform(0.1, 1, (n, n))
    B = rng.normal(size=(n, m))
    A = 0.7 * M / np.abs(np.linalg.eigvals(M)).max() + 0.3 * B @ rng.normal(size=(m, n))
    X0, U0 = rng.normal(size=(n, count)), rng.normal(size=(m, count))
    return X0, A @ X0 + B @ U0 + rng.uniform(-NOISE, NOISE, (n, count)), U0


def bounded(signs, row):
    """What l = p - q counts in a bound of a row."""
    return np.concatenate([signs * row - NOISE, -signs * row - NOISE])


def program(X0, X1, U0):
    """Find xi, z, and p, q >= 0 for every entry of the image of every generator and of e, with the largest margin.

    Z (p - q) = (xi_k e_k; z_k) with lower bounds >= 0, and Z (p - q) = (xi; sum z_k) with upper bounds < xi.
    """
    n, m = len(X0), len(U0)
    Z, own, bounds = np.vstack([X0, U0]), n + n * m + 1, n * n + n
    equal, right, sides = [], [], []
    for k in range(n + 1):
        target = np.zeros((n + m, own))
        for j in range(n) if k == n else [k]:
            target[j, j] = 1.0
            target[n:, n + j * m : n + (j + 1) * m] = np.eye(m)
        equal += [target] * n
        for i in range(n):
            side, limit = bounded(1 if k < n else -1, X1[i]), np.zeros(own)
            limit[-1] = -0.01 if k < n else -1.0
            limit[i] = float(k == n)
            sides.append(side)
            right.append(limit)
    both = np.hstack([Z, -Z])
    rows = sp.block_array(
        [
            [-sp.csr_array(np.vstack(equal)), sp.kron(sp.eye_array(bounds), sp.csr_array(both))],
            [sp.csr_array(np.array(right)), sp.block_diag([side[None] for side in sides])],
        ],
        format="csr",
    )
    low = np.concatenate([np.zeros(n), np.full(n * m + 1, -np.inf), np.zeros(rows.shape[1] - own)])
    high = np.concatenate([np.ones(n), np.full(n * m, np.inf), [0.05], np.full(rows.shape[1] - own, np.inf)])
    equalities = bounds * (n + m)
    ends = np.zeros(rows.shape[0]), np.where(np.arange(rows.shape[0]) < equalities, 0.0, np.inf)
    cost = np.zeros(rows.shape[1])
    cost[own - 1] = -1.0
    return cost, low, high, ends, rows


def bare(cost, low, high, ends, rows):
    solver = highspy.Highs()
    solver.setOptionValue("output_flag", False)
    counts, kinds = (*rows.shape[::-1], rows.nnz), (int(highspy.MatrixFormat.kRowwise), 1)
    inside = rows.indptr.astype(np.int32), rows.indices.astype(np.int32), rows.data
    solver.passModel(*counts, *kinds, 0.0, cost, low, high, *ends, *inside, np.zeros(len(cost), dtype=np.int32))
    solver.run()
    return -solver.getObjectiveValue()


@pytest.mark.parametrize(("who", "at_most"), [("ours", None), ("bare HiGHS", 2)])
def test_gain_from_data(contest, size, who, at_most):
    """The peer passes the program as matrices and has it solved; writing it down and proving the gain is our part."""
    data = measurements(*size((6, 2, 200), (2, 1, 20)))
    question = f"gain from data, {data[0].shape[0]} states, {data[0].shape[1]} samples"
    if who == "ours":
        assert contest(question, who, lambda: kp.data_feedback(*data, noise=NOISE), rounds=3).check()
    else:
        matrices = program(*data)
        assert contest(question, who, lambda: bare(*matrices), at_most=at_most, rounds=3) > 0
