"""The verdict on random networks equals what the eigenvalues say, whatever the cones, sizes and timebase."""

import numpy as np
import pytest

import control_kpos as kp
from control_kpos.certificates.result import Status
from control_kpos.networks import NetworkInstability


def random_cone(rng, n):
    """A proper cone with interior (1, 0, ..., 0), simplicial or not."""
    if n == 1:
        return kp.orthant(1) if rng.random() < 0.5 else kp.PolyhedralCone([[-1.0]])
    if rng.random() < 0.3:
        return kp.orthant(n)
    count = n + (int(rng.integers(0, 3)) if n > 2 else 0)
    corners = np.vstack([np.eye(n - 1), -np.ones((1, n - 1))])
    points = np.vstack([corners, rng.normal(size=(count - n, n - 1))])
    rays = np.hstack([np.ones((len(points), 1)), points])
    return kp.PolyhedralCone(np.round(rays * 64) / 64)


def inside(rng, cone):
    return rng.uniform(0.1, 1.0, size=cone.n_rays) @ cone.rays


def positive_map(rng, source, target, terms=2):
    """sum of y h' with y in the interior of the target and h in that of the source's dual."""
    return sum(np.outer(inside(rng, target), inside(rng, source.dual)) for _ in range(terms))


def random_node(rng, *, discrete, feedthrough, damping):
    n, m, q = int(rng.integers(1, 4)), int(rng.integers(1, 3)), int(rng.integers(1, 3))
    X, U, Y = random_cone(rng, n), random_cone(rng, m), random_cone(rng, q)
    inner = positive_map(rng, X, X)
    radius = np.abs(np.linalg.eigvals(inner)).max()
    A = inner / radius * damping if discrete else inner / radius - (1.0 + damping) * np.eye(n)
    B, C = positive_map(rng, U, X), positive_map(rng, X, Y)
    D = 0.3 * positive_map(rng, U, Y) if feedthrough else np.zeros((q, m))
    scale = 1 / (np.linalg.norm(C) * np.linalg.norm(B))
    return kp.ConeStateSpace(A, B * scale, C, D * scale, discrete, X=X, U=U, Y=Y)


def random_network(rng):
    discrete, feedthrough = bool(rng.random() < 0.4), bool(rng.random() < 0.4)
    count = int(rng.integers(1, 6))
    nodes = []
    for _ in range(count):
        if nodes and rng.random() < 0.3:
            nodes.append(nodes[int(rng.integers(len(nodes)))])
        else:
            nodes.append(random_node(rng, discrete=discrete, feedthrough=feedthrough, damping=rng.uniform(0.2, 0.9)))
    strength = 10 ** rng.uniform(-1.5, 1.0)
    blocks = [[strength * positive_map(rng, b.Y, a.U, 1) if rng.random() < 0.5 else None for b in nodes] for a in nodes]
    return nodes, blocks, discrete


def dense_coupling(nodes, blocks):
    rows = [
        np.hstack([np.zeros((a.ninputs, b.noutputs)) if w is None else w for w, b in zip(row, nodes, strict=True)])
        for row, a in zip(blocks, nodes, strict=True)
    ]
    return np.vstack(rows)


def truth(nodes, W):
    """Gain of the algebraic loop, and the abscissa (radius) of the closed loop, by dense linear algebra."""
    A, B, C, D = (
        np.block(
            [[m if i == k else np.zeros((m.shape[0], n.shape[1])) for k, n in enumerate(ms)] for i, m in enumerate(ms)]
        )
        for ms in ([s.A for s in nodes], [s.B for s in nodes], [s.C for s in nodes], [s.D for s in nodes])
    )
    loop = np.abs(np.linalg.eigvals(W @ D)).max()
    closed = A + B @ np.linalg.solve(np.eye(len(W)) - W @ D, W @ C)
    return loop, np.linalg.eigvals(closed), closed


@pytest.mark.parametrize("seed", range(8))
def test_verdict_is_the_eigenvalues(seed):
    rng = np.random.default_rng(1000 + seed)
    seen = dict.fromkeys(Status, 0)
    for _ in range(150):
        nodes, blocks, discrete = random_network(rng)
        W = dense_coupling(nodes, blocks)
        loop, poles, closed = truth(nodes, W)
        edge = np.abs(poles).max() - 1 if discrete else poles.real.max()
        if abs(edge) < 1e-9 or abs(loop - 1) < 1e-6:
            continue
        net = kp.feedback_interconnect(nodes, blocks if rng.random() < 0.5 else W)
        cert = net.certificate
        seen[cert.status] += 1
        stable = edge < 0 and loop < 1
        assert cert.status is (Status.PROVED if stable else Status.REFUTED), cert.explain()
        assert cert.check()
        np.testing.assert_allclose(net.A, closed, rtol=1e-8, atol=1e-10 * np.abs(closed).max())
        if stable:
            slowest = (1 - np.abs(poles).max()) if discrete else -poles.real.max()
            assert 0 < cert.decay_rate <= slowest * (1 + 1e-9)
        elif isinstance(cert.witness, NetworkInstability):
            ahead = closed @ cert.witness.x - cert.witness.rate * cert.witness.x
            assert net.X.contains(cert.witness.x)
            assert net.X.contains(ahead + 1e-9 * np.abs(ahead).max() * net.X.interior_point)
    assert seen[Status.PROVED] > 20 and seen[Status.REFUTED] > 20


@pytest.mark.parametrize("seed", range(3))
def test_bracket_encloses_the_rightmost_pole(seed):
    rng = np.random.default_rng(2000 + seed)
    done = 0
    for _ in range(40):
        nodes, blocks, _ = random_network(rng)
        loop, poles, _ = truth(nodes, dense_coupling(nodes, blocks))
        if loop > 0.99:
            continue
        lower, upper = kp.feedback_interconnect(nodes, blocks).spectral_abscissa()
        exact = poles.real.max()
        slip = 1e-9 * max(1.0, np.abs(poles).max())
        assert lower - slip <= exact <= upper + slip
        assert upper - lower <= 2e-6 * max(abs(exact), 1e-3)
        done += 1
    assert done > 15


def test_permuting_the_nodes_changes_nothing():
    rng = np.random.default_rng(5)
    for _ in range(40):
        nodes, blocks, _ = random_network(rng)
        order = rng.permutation(len(nodes))
        one = kp.feedback_interconnect(nodes, blocks).certificate
        other = kp.feedback_interconnect([nodes[j] for j in order], [[blocks[j][k] for k in order] for j in order])
        assert one.status is other.certificate.status
        if one:
            assert other.certificate.decay_rate == pytest.approx(one.decay_rate, rel=1e-5)
            np.testing.assert_allclose(other.certificate.node_margins, one.node_margins[order], rtol=1e-4, atol=1e-9)
