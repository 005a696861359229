"""Links of nodes to themselves in networks with vertices: closed at every vertex, against members and mixtures."""

import itertools

import numpy as np
import pytest
from network_examples import lag
from scipy.linalg import block_diag

import control_kpos as kp

SHAPES = (("B", (2, 1)), ("C", (1, 2)))


def closed_loops(vertices, W):
    """A of the network with one vertex of every node, own links included."""
    for choice in itertools.product(*vertices):
        A, B, C, D = (block_diag(*(getattr(s, name) for s in choice)) for name in "ABCD")
        yield A + B @ np.linalg.solve(np.eye(len(W)) - W @ D, W @ C)


@pytest.mark.parametrize("seed", range(24))
def test_negative_feedback_inside_nodes_is_closed_at_every_vertex(seed):
    """Positive SISO nodes of two vertices with own links below 0: members, and mixtures, are stable where proven."""
    rng = np.random.default_rng(seed)
    varies, made = ["A", "AB", "AC", "ABC"][seed % 4], []
    for _ in range(2):
        A = [rng.uniform(0.3, 0.6, (2, 2)) - 1.5 * np.eye(2) for _ in range(2)]
        B, C = ([rng.uniform(0.1, 0.2 if name in varies else 1, shape) for _ in range(2)] for name, shape in SHAPES)
        B, C = (x if name in varies else x[:1] * 2 for x, name in ((B, "B"), (C, "C")))
        D = 0.2 * (seed % 3 == 0 and varies != "ABC")
        made.append([kp.ConeStateSpace(a, b, c, [[D]]) for a, b, c in zip(A, B, C, strict=True)])
    W = np.array([[-0.3, rng.uniform(0, 4)], [rng.uniform(0, 2), 0]])
    found = kp.feedback_interconnect(made, W).certificate
    abscissas = [np.linalg.eigvals(A).real.max() for A in closed_loops(made, W)]
    assert found.check() and (bool(found) or max(abscissas) > -0.2)
    if not found:
        return
    assert len(found.models) == (4 if varies == "ABC" else 2)
    for _ in range(10):
        mixed = []
        for first, second in made:
            t = rng.uniform()
            parts = ((1 - t) * getattr(first, name) + t * getattr(second, name) for name in "ABCD")
            mixed.append([kp.ConeStateSpace(*parts)])
        assert max(np.linalg.eigvals(A).real.max() for A in closed_loops(mixed, W)) < 0


def test_own_links_that_cannot_be_closed_stay_what_they_are():
    """D varies together with B, C; or own links are in ranges."""
    vertices = [lag(1, 0.1), lag(2, 0.2)]
    found = kp.feedback_interconnect([vertices, lag(1)], [[-0.5, 1], [1, 0]]).certificate
    assert isinstance(found.witness, kp.CouplingViolation) and found.witness.target == found.witness.source == 0
    kept = kp.feedback_interconnect([[lag(1), lag(2)], lag(1)], [[-0.5, kp.interval(0, 1)], [1, 0]])
    assert kept.certificate and kept.certificate.check()
    ranged = kp.feedback_interconnect([[lag(1), lag(2)], lag(1)], [[kp.interval(-0.5, -0.4), 1], [1, 0]])
    assert not ranged.certificate
    unstable = kp.feedback_interconnect([[lag(1), lag(2)], lag(1)], [[-0.5, 2], [1, 0]]).certificate
    assert isinstance(unstable.witness, kp.FailingMember) and unstable.check()
