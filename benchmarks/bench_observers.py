"""Interval observers of random plants, simulated beside them with disturbances and noise on their bounds.

Whether a state ever leaves its bounds, and how much of the proven final width is used.  In continuous time noise and
disturbances keep their values between samples, so that the discretisation of plant and observer together is exact.
Local observers of a large network, beside the certificate of the network that they make stable.
"""

import control as ct
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import control_kpos as kp

_STEPS = 200


def random_plant(rng):
    """Not stable half of the time, with 1 to 4 states and from 1 output on."""
    n, discrete = int(rng.integers(1, 5)), bool(rng.random() < 0.5)
    q = int(rng.integers(max(n - 1, 1), n + 1))
    A, C = rng.normal(size=(n, n)), rng.normal(size=(q, n))
    if discrete:
        A *= rng.uniform(0.5, 1.05) / np.abs(np.linalg.eigvals(A)).max()
    else:
        A -= (np.linalg.eigvals(A).real.max() + rng.uniform(-0.05, 1)) * np.eye(n)
    return ct.ss(A, rng.normal(size=(n, 1)), C, 0, discrete)


def joint(plant, o):
    """Plant and both copies, from (u, one, w, n), and bounds from their states, u, one and n."""
    n, q, both = plant.nstates, plant.noutputs, o.system
    y = np.hstack([np.eye(q), np.zeros((q, 2))])  # of the inputs y, u, one of the copies
    known = np.eye(q + 2)[:, q:]
    A = np.block([[plant.A, np.zeros((n, 2 * n))], [both.B @ y.T @ plant.C, both.A]])
    own = np.hstack([plant.B, np.zeros((n, 1)), np.eye(n), np.zeros((n, q))])
    B = np.vstack([own, np.hstack([both.B @ known, np.zeros((2 * n, n)), both.B @ y.T])])
    C = np.hstack([both.D @ y.T @ plant.C, both.C])
    D = np.hstack([both.D @ known, np.zeros((2 * n, n)), both.D @ y.T])
    return A, B, C, D


def hostile(rng, plant, o, low, high, noise):
    """Escapes of a run, and the largest part of the final width that is used."""
    A, B, C, D = joint(plant, o)
    n, q, step = plant.nstates, plant.noutputs, 10.0 ** rng.uniform(-2, 0)
    if not plant.dt:
        whole = scipy.linalg.expm(step * np.block([[A, B], [np.zeros((B.shape[1], sum(B.shape)))]]))
        A, B = whole[: len(A), : len(A)], whole[: len(A), len(A) :]
    x = rng.normal(size=n)
    z = np.concatenate([x, o.start((x - rng.random(n), x + rng.random(n)))])
    side, escapes, ratio = int(rng.integers(3)), 0, 0.0
    for k in range(_STEPS):
        # always the same bound, the other one now and then, or any at any time
        up, loud = ((rng.random(size) < (1.0, (k // 7) % 2, 0.5)[side]) for size in (n, q))
        now = np.concatenate([[np.sin(k)], [1.0], np.where(up, high, low), np.where(loud, noise, -noise)])
        bounds = C @ z + D @ now
        room = 1e-9 * (1 + np.abs(z).max())
        escapes += int(((z[:n] > bounds[:n] + room) | (z[:n] < bounds[n:] - room)).sum())
        ratio = float(((bounds[:n] - bounds[n:]) / np.where(o.width > 0, o.width, np.inf)).max())
        z = A @ z + B @ now
    return escapes, ratio


@pytest.mark.timeout(1800)
def test_nothing_escapes(benchmark, size):
    rng, count = np.random.default_rng(7), size(1000, 20)
    proved, escapes, ratios = 0, 0, []

    def run():
        nonlocal proved, escapes
        while proved < count:
            plant = random_plant(rng)
            n, q = plant.nstates, plant.noutputs
            low, noise = -rng.random(n), 10.0 ** rng.uniform(-3, 0) * rng.random(q)
            high = low + rng.random(n)
            o = kp.interval_observer(plant, disturbance=(low, high), noise=noise)
            if o:
                found, ratio = hostile(rng, plant, o, low, high, noise)
                proved, escapes = proved + 1, escapes + found
                ratios.append(ratio)

    benchmark.pedantic(run, rounds=1)
    benchmark.extra_info.update(observers=proved, escapes=escapes, last_width=float(np.median(ratios)))
    print(f"\n{proved} observers, {escapes} escapes, last width / proven width: median {np.median(ratios):.6f}")
    assert escapes == 0


@pytest.mark.timeout(600)
@pytest.mark.parametrize("who", ["ours", "certificate of the network of A + L C"])
def test_local_observers(contest, size, who):
    count = size(10_000, 300)
    rng = np.random.default_rng(1)
    A = rng.random((count, 2, 2)) / 2 - np.diag([3, 1])
    W = sp.csr_array(sp.random(count, count, 3 / count, random_state=0))
    net = kp.feedback_interconnect(kp.stack(A, [[0], [0.1]], [[1, 0]]), W, progress=False)
    box = {"disturbance": (-np.ones(2 * count), np.ones(2 * count)), "noise": 0.05}
    question = f"local observers, N = {count}"
    if who == "ours":
        assert contest(question, who, lambda: kp.interval_observer(net, **box), rounds=2)
        return
    model = kp.interval_observer(net, **box).certificate.model
    contest(question, who, lambda: kp.feedback_interconnect(model.stacks[0], W, progress=False).certificate, rounds=2)
