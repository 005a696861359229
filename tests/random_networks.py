"""Random networks of cone systems: generic ones, and ones on the margin of stability or next to it."""

from fractions import Fraction
from math import lcm

import numpy as np
from scipy.linalg import block_diag

import control_kpos as kp
from control_kpos.exact.linalg import solve_exactly
from control_kpos.proof.certificate import Status

# -- generic data


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


def random_network(rng, most=5, density=0.5):
    """Nodes, blocks of the coupling, and whether time is discrete."""
    discrete, feedthrough = bool(rng.random() < 0.4), bool(rng.random() < 0.4)
    count = int(rng.integers(1, most + 1))
    nodes = []
    for _ in range(count):
        if nodes and rng.random() < 0.3:
            nodes.append(nodes[int(rng.integers(len(nodes)))])
        else:
            nodes.append(random_node(rng, discrete=discrete, feedthrough=feedthrough, damping=rng.uniform(0.2, 0.9)))
    strength = 10 ** rng.uniform(-1.5, 1.0)
    blocks = [
        [strength * positive_map(rng, b.Y, a.U, 1) if rng.random() < density else None for b in nodes] for a in nodes
    ]
    return nodes, blocks, discrete


def dense_coupling(nodes, blocks):
    rows = [
        np.hstack([np.zeros((a.ninputs, b.noutputs)) if w is None else w for w, b in zip(row, nodes, strict=True)])
        for row, a in zip(blocks, nodes, strict=True)
    ]
    return np.vstack(rows)


def poles_by_dense_algebra(nodes, W):
    """Gain of the algebraic loop, poles, and matrix of the closed loop."""
    A, B, C, D = (block_diag(*(getattr(s, name) for s in nodes)) for name in "ABCD")
    loop = np.abs(np.linalg.eigvals(W @ D)).max()
    closed = A + B @ np.linalg.solve(np.eye(len(W)) - W @ D, W @ C)
    return loop, np.linalg.eigvals(closed), closed


# -- data on the margin: every node has A_j x_j + B_j u_j = (1 - share) rate x_j for one state x of the network


def integer_cone(rng, n):
    if n == 1:
        return kp.orthant(1) if rng.random() < 0.7 else kp.PolyhedralCone([[-1]])
    if rng.random() < 0.35:
        return kp.orthant(n)
    corners = np.vstack([np.eye(n - 1), -np.ones((1, n - 1))])
    extra = rng.integers(-3, 4, size=(int(rng.integers(0, 3)) if n > 2 else 0, n - 1))
    return kp.PolyhedralCone(np.hstack([np.ones((n + len(extra), 1)), np.vstack([corners, extra])]).astype(int))


def combination(rng, rows, on_a_face):
    """A sum of rows with small whole weights; some are 0 on a face."""
    rows = np.array(rows.rows_as_integers(np.arange(rows.shape[0])), dtype=float)
    weights = rng.integers(0 if on_a_face else 1, 3, size=len(rows))
    weights[rng.integers(len(rows))] += not weights.any()
    return weights @ rows


def ray_and_facet(rng, target, source, share):
    """y h' with y in the target and h in the dual of the source, on faces with probability `share`."""
    y = combination(rng, target.exact_rays, rng.random() < share)
    return np.outer(y, combination(rng, source.exact_facets, rng.random() < share))


def marginal_network(rng):
    """Nodes and coupling of a network on the margin, next to it, or with parts on it; None if it is ill-posed.

    With A_j = x_j h_j' - rate_j I and B_j = x_j b_j' the rate h_j'x_j + b_j'u_j makes A x + B u = 0, where u are
    the inputs that belong to the state x; in doubles up to their rounding, and some rates are changed.
    """
    discrete, feedthrough, forward = rng.random() < 0.4, rng.random() < 0.35, rng.random() < 0.6
    count = int(rng.integers(1, 7))
    cones = [tuple(integer_cone(rng, int(rng.integers(1, top))) for top in (4, 3, 3)) for _ in range(count)]
    x = [combination(rng, X.exact_rays, rng.random() < 0.3) for X, _, _ in cones]
    h = [combination(rng, X.exact_facets, rng.random() < 0.5) for X, _, _ in cones]
    b = [combination(rng, U.exact_facets, rng.random() < 0.5) for _, U, _ in cones]
    C = [0.25 * ray_and_facet(rng, Y, X, 0.5) for X, _, Y in cones]
    direct = [feedthrough and rng.random() < 0.7 for _ in cones]
    D = [
        d * ray_and_facet(rng, Y, U, 1.0) * 2.0 ** -int(rng.integers(3, 8))
        for d, (_, U, Y) in zip(direct, cones, strict=True)
    ]
    density = rng.uniform(0.2, 0.7)
    blocks = [[np.zeros((U.dim, Y.dim)) for _, _, Y in cones] for _, U, _ in cones]
    for j, (_, U, _) in enumerate(cones):
        for k, (_, _, Y) in enumerate(cones):
            if rng.random() < (density if not forward or k < j or rng.random() < 0.15 else 0):
                blocks[j][k] = ray_and_facet(rng, U, Y, 0.3) * 2.0 ** -int(rng.integers(0, 4))
    W = np.block(blocks)
    resolved = resolved_coupling(W, block_diag(*D))
    if resolved is None:
        return None
    u = np.split(
        resolved @ fractions(block_diag(*C)) @ fractions(np.concatenate(x)),
        np.cumsum([U.dim for _, U, _ in cones])[:-1],
    )
    kind = rng.random()
    nodes = []
    for j, (X, U, Y) in enumerate(cones):
        rate = float(fractions(h[j]) @ fractions(x[j]) + fractions(b[j]) @ u[j])
        rate = changed_rate(rng, kind, rate)
        A, B = np.outer(x[j], h[j]) - rate * np.eye(X.dim), np.outer(x[j], b[j])
        if discrete:
            step = 2.0 ** -int(np.ceil(np.log2(rate)))
            A, B = step * np.outer(x[j], h[j]) + (1 - step * rate) * np.eye(X.dim), step * B
        nodes.append(kp.ConeStateSpace(A, B, C[j], D[j], bool(discrete), X=X, U=U, Y=Y))
    return nodes, W, bool(discrete)


def changed_rate(rng, kind, rate):
    """The rate as it is (kind < 0.3), a few units beside it, or far from it for some nodes."""
    if rate <= 0:
        return 1.0
    if 0.3 <= kind < 0.55:
        rate *= 1 + 2.0 ** -int(rng.integers(20, 53)) * rng.choice([-1, 1])
    elif 0.55 <= kind < 0.7 and rng.random() < 0.5:
        rate *= rng.choice([0.5, 1, 2, 1 + 2**-50, 1 - 2**-51])
    elif 0.7 <= kind < 0.85 and rng.random() < 0.6:
        rate *= 2.0
    elif kind >= 0.85:
        rate = float(rng.integers(1, 30))
    return rate


# -- what is true, in rational arithmetic on the dense loop


def fractions(M):
    M = np.asarray(M)
    return np.array([Fraction(t) for t in M.ravel().tolist()], dtype=object).reshape(M.shape)


def resolved_coupling(W, D):
    """(I - W D)^{-1} W in fractions, or None if I - W D is singular."""
    W, D = fractions(W), fractions(D)
    both = np.concatenate([np.eye(len(W), dtype=int).astype(object) - W @ D, W], axis=1)
    common = lcm(*(Fraction(t).denominator for t in both.ravel()))
    whole = np.array([int(t * common) for t in both.ravel()], dtype=object).reshape(both.shape)
    solved = solve_exactly(whole[:, : len(W)], whole[:, len(W) :])
    if solved is None:
        return None
    return np.array([Fraction(int(t), solved[1]) for t in solved[0].ravel()], dtype=object).reshape(W.shape)


def is_stable(nodes, W, discrete):
    """Decided by Theorem 2 on the closed loop in fractions, and on the algebraic loop."""
    A, B, C, D = (fractions(block_diag(*(getattr(s, name) for s in nodes))) for name in "ABCD")
    X, Y = kp.product([s.X for s in nodes]), kp.product([s.Y for s in nodes])
    if D.any() and not decided(kp.linear_lyapunov(D @ fractions(W), Y, discrete=True)):
        return False
    return decided(kp.linear_lyapunov(A + B @ resolved_coupling(W, D) @ C, X, discrete=discrete))


def decided(certificate):
    assert certificate.status is not Status.UNDECIDED, certificate.explain()
    return certificate.status is Status.PROVED
