"""What costs most in networks with vertices and ranges: margins, and losses against certificates of wider ranges."""

import numpy as np
import pytest
from network_examples import lag

import control_kpos as kp
from control_kpos.errors import DataError


def tank(rate, name):
    return kp.ConeStateSpace([[-rate]], [[1]], [[1]], 0, name=name, inputs=["flow"], outputs=["level"])


def test_the_weakest_vertices_come_first_with_their_names():
    net = kp.feedback_interconnect([[tank(2, "a"), tank(3, "a")], tank(4, "b")], [[0, 1], [1, 0]])
    found = net.certificate.costliest(2)
    margins = net.certificate.vertex_margins
    assert [x.value for x in found.vertices] == sorted(margins.ravel())[:2] and found.ranges == ()
    s, j = np.unravel_index(np.argmin(margins), margins.shape)
    assert found.vertices[0].name == f'node {j} ("{"ab"[j]}") at its vertex {s}'
    assert found.vertices[0].name in net.certificate.explain()


def ranges(signed):
    """Ranges of A, of B, of C and of a link that are wide, one at a time."""
    nodes = {"A": [[[-3.0]], [[-4.0]]], "B": [[[1.0]], [[1.0]]], "C": [[[1.0]], [[1.0]]]}
    W = np.array([[0.0, 1.0], [1.0, 0.0]])
    for name in "ABCW":
        low, high = dict(nodes), dict(nodes)
        links = [W, W]
        if name == "W":
            links = [W - [[0, 1.5 if signed else 0.3], [0.1, 0]], W + [[0, 0.3], [0.1, 0]]]
        else:
            base = np.array(nodes[name])
            step = np.array([[[0.05]], [[0.6]]])
            low[name], high[name] = base - step, base + step
            links = [W - 0.01 * W, W + 0.01 * W] if not signed else [W - 1.5 * W, W + 0.01 * W]
        stack = kp.stack(*(kp.interval(low[x], high[x]) for x in "ABC"))
        yield name, kp.feedback_interconnect(stack, kp.interval(*links))


@pytest.mark.parametrize("signed", [False, True])
def test_the_range_that_costs_most_is_named(signed):
    where = {"A": "x[0] of node 1 to x[0] of node 1", "B": "u[0] of node 1 to x[0] of node 1"}
    where |= {"C": "x[0] of node 1 to y[0] of node 1", "W": "y[0] of node 1 to u[0] of node 0"}
    for name, net in ranges(signed):
        found = net.certificate
        assert found and (found.e is not None) == signed
        ranked = found.costliest(9).ranges
        named = [x.name for x in ranked]
        assert f"the entry of {name} from {where[name]}" in (named if signed else named[:2]), (name, named)
        assert list(ranked) == sorted(ranked, key=lambda x: -x.value) and named[0] in found.explain()


def test_losses_are_those_of_links_that_grow():
    """One loop: the loss of a link is what the decay rate of the same vectors falls by."""
    W = [[0, kp.interval(0.4, 0.6)], [0.5, 0]]
    found = kp.feedback_interconnect([lag(1), lag(1)], W).certificate
    (link,) = found.costliest().ranges
    v = np.ravel(found.v)
    wider = np.array([[0, 0.7], [0.5, 0]])
    before, after = (1 - (m.T @ v) / v for m in (found.model.W.toarray(), wider))
    gross = found._margins[1]
    assert link.value * gross == pytest.approx((before - after).max(), rel=1e-6)


@pytest.mark.parametrize("k", [0, -1, 1.5, "x", None, True])
def test_the_number_is_whole(k):
    found = kp.feedback_interconnect([[lag(1), lag(2)]], [[0]]).certificate
    with pytest.raises(DataError, match=r"k is .* it must be a whole number, at least 1"):
        found.costliest(k)
    refuted = kp.feedback_interconnect([[lag(-1), lag(2)]], [[0]]).certificate
    assert refuted.costliest() == ((), ())
