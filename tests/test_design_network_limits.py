"""Limits of local gains: numbers that prove them for networks of any size, and that prove nothing else."""

from dataclasses import replace

import numpy as np
import planted
import pytest
import scipy.linalg
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from test_design_networks import node, random_network, ring

import control_kpos as kp
from control_kpos.design.network import search
from control_kpos.design.network.lower_limit import Refutation

pytestmark = pytest.mark.filterwarnings("ignore::control_kpos.ActuatorLossWarning")


def random_nodes(rng, count, discrete):
    """Nodes of one to three states that local gains F make positive and stable, on orthants and skewed cones."""
    nodes, gains = [], []
    for _ in range(count):
        n, m = (int(k) for k in rng.integers(1, 4, size=2))
        T = planted.generators(rng, n) if rng.integers(2) else np.eye(n)
        loop = rng.uniform(0, 0.8 / n, size=(n, n)) if discrete else planted.metzler_hurwitz(rng, n)
        B, F = T @ rng.uniform(size=(n, m)), rng.normal(size=(m, n))
        A, C = T @ loop @ np.linalg.inv(T) - B @ F, rng.uniform(size=(1, n)) @ np.linalg.inv(T)
        nodes.append(kp.ConeStateSpace(A, B, C, 0, *([1] if discrete else []), X=kp.PolyhedralCone(T.T)))
        gains.append(F)
    return nodes, gains


def random_links(rng, nodes, weight):
    shape = sum(s.ninputs for s in nodes), len(nodes)
    return rng.uniform(0, weight, shape) * (rng.random(shape) < 0.4)


def margin(nodes, W, rate, bound):
    """The largest decrease beyond the rate that |F_j t| <= bound allows, by dense rows of this test's own."""
    discrete = bool(nodes[0].dt)
    T = scipy.linalg.block_diag(*(planted.unit(s.X.rays).T for s in nodes))
    A, B, C = (scipy.linalg.block_diag(*(getattr(s, name) for s in nodes)) for name in "ABC")
    owner = np.repeat(np.arange(len(nodes)), [s.nstates for s in nodes])
    own = np.repeat(np.arange(len(nodes)), [s.ninputs for s in nodes])
    A, L, B = (np.linalg.solve(T, M) for M in (A @ T, B @ W @ C @ T, B))
    n = len(A)
    free = [(k, c) for k in range(n) for c in np.flatnonzero(own == owner[k])]
    # variables xi, z, margin
    pushed = np.zeros((n, n, len(free)))  # facet, generator, z
    for place, (k, c) in enumerate(free):
        pushed[:, k, place] = B[:, c]
    # links of nodes to themselves count for invariance of the node, too
    local = A + np.where(owner[:, None] == owner, L, 0.0)
    invariant = [
        np.concatenate([-local[i, k] * np.eye(n)[k], -pushed[i, k], [0]])
        for i in range(n)
        for k in range(n)
        if owner[i] == owner[k] and (discrete or i != k)
    ]
    still = (float(discrete) - rate) * np.eye(n)
    falls = np.hstack([A + L - still, pushed.sum(axis=1), np.ones((n, 1))])
    sizes = [
        np.concatenate([-bound * np.eye(n)[k], sign * np.eye(len(free))[place], [0]])
        for place, (k, _) in enumerate(free)
        for sign in (1, -1)
    ]
    rows = np.vstack([*invariant, falls, *sizes])
    total = np.concatenate([np.ones(n), np.zeros(len(free) + 1)])[None]
    ends = [(0, None)] * n + [(None, None)] * (len(free) + 1)
    cost = -np.eye(n + len(free) + 1)[-1]
    found = linprog(cost, rows, np.zeros(len(rows)), total, [1], bounds=ends)
    return -found.fun if found.status == 0 else -np.inf


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("weight", [0.3, 5])
@pytest.mark.parametrize("n", [3, 40, 400])
def test_networks_of_any_size_have_proven_limits(n, weight, uniform):
    """Light links leave invariance of one node to decide, heavy ones the stability of all."""
    stack, W, _ = random_network(n, weight=weight)
    d = kp.network_feedback(stack, W, rate=0.1, uniform=uniform)
    assert d and 0 < d.limit <= d.value <= d.limit * (1 + 1e-3)
    assert "which is proven" in d.explain() and ("common vector x inside X" in d.explain()) == uniform
    if not uniform:
        refused = kp.network_feedback(stack, W, rate=0.1, gain_bound=0.999 * d.limit)
        assert not refused


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.booleans(), st.sampled_from([0, 0.05, "1/20"]))
def test_limits_of_nodes_of_all_kinds(seed, discrete, rate):
    rng = np.random.default_rng(seed)
    nodes, _ = random_nodes(rng, int(rng.integers(1, 6)), discrete)
    W = random_links(rng, nodes, 0.1)
    d = kp.network_feedback(nodes, W, rate=rate)
    if not d:
        return
    assert d.limit <= d.value <= d.limit * (1 + 1e-3)
    rate = 0.05 if rate else 0.0
    assert margin(nodes, W, rate, d.value * (1 + 1e-6)) > -1e-9
    if d.limit:
        assert margin(nodes, W, rate, d.limit * (1 - 1e-6)) < 1e-9


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("discrete", [False, True])
def test_gains_that_do_it_are_never_refuted(seed, discrete):
    rng = np.random.default_rng(seed)
    nodes, gains = random_nodes(rng, 4, discrete)
    W = random_links(rng, nodes, 1e-3)
    model = kp.feedback_interconnect(nodes, W).model
    model = search.own_links_closed(model) or model
    own = [
        F - W[np.ix_(rows, [j])] @ s.C
        for j, (F, s, rows) in enumerate(zip(gains, nodes, inputs_of(nodes), strict=True))
    ]
    size = max(np.abs(F @ planted.unit(s.X.rays).T).max() for F, s in zip(own, nodes, strict=True))
    for rate in (0, 1e-3):
        proof = Refutation(model, rate)
        assert not proof.refuses(size) and not proof.refuses(2 * size)


def inputs_of(nodes):
    return np.split(np.arange(sum(s.ninputs for s in nodes)), np.cumsum([s.ninputs for s in nodes])[:-1])


def proof_of(weight, uniform):
    """A proof for a network of two sizes of nodes, in two stacks (one if uniform)."""
    rng = np.random.default_rng(1)
    nodes = [node(k) for k in rng.uniform(0.5, 2, size=6)]
    nodes += [] if uniform else [kp.ConeStateSpace([[1.0]], [[1.0]], [[1.0]], 0)] * 2
    W = weight * (ring(len(nodes)) + 0.3 * ring(len(nodes)) @ ring(len(nodes)))
    d = kp.network_feedback(nodes, W, rate=0.2, uniform=uniform)
    model = kp.feedback_interconnect(nodes, W).model
    bound = [np.full((len(s), s.sizes[1]), d.limit) for s in model.stacks]
    return Refutation(model, 0.2, uniform).proves(bound)


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("weight", [0.1, 20.0])
def test_changed_numbers_prove_nothing(weight, uniform):
    c = proof_of(weight, uniform)
    assert c.holds()
    stable = weight > 1
    assert any(part.any() for part in c.d) == stable

    def scaled(parts, factor):
        return tuple(factor * part for part in parts)

    assert not replace(c, bound=scaled(c.bound, 1.01)).holds()
    assert not replace(c, most=scaled(c.most, 0.99)).holds()
    assert not replace(c, w=scaled(c.w, -1)).holds()
    assert not replace(c, d=scaled(c.d, 0), w=scaled(c.w, 0), most=scaled(c.most, 0), r=0 * c.r, q=0 * c.q).holds()
    if stable:
        assert not replace(c, rate=0.1).holds()
        assert not replace(c, d=scaled(c.d, 0.9)).holds() and not replace(c, d=scaled(c.d, -1)).holds()
        assert not replace(c, r=1.01 * c.r).holds() and not replace(c, q=1.01 * c.q).holds()
        for k in range(len(c.w)):
            more = [part.copy() for part in c.w]
            more[k][:, 0, 0] += 1e-9  # l would not be 0 at the facet opposite the generator
            assert not replace(c, w=tuple(more)).holds()


def test_parts_in_a_row_have_limits():
    """Links that lead one way leave one vector between equal nodes: each alone decides."""
    row = sp.csr_array(np.diag(np.ones(199), -1))
    d = kp.network_feedback([node()] * 200, 3 * row, rate=0.5)
    assert d and 4.99 < d.limit <= 5 <= d.value <= 5.005


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("none", [0, 1e-300, 5e-324])
def test_inputs_with_a_bound_of_zero_are_not_used(none, uniform):
    """Two inputs a node, of which the first or none may act; without gains the network has a decay rate of 1/2."""
    A, B = [[-2, 1], [1, -2]], [[1, 0], [0, 1]]
    plants, links = [kp.ConeStateSpace(A, B, [[1, 0]], 0)] * 3, 0.5 * np.kron(ring(3).toarray(), [[1], [0]])
    still = kp.network_feedback(plants, links, gain_bound=none, uniform=uniform, rate="0.4")
    assert still and still.check() and not still.F.any() and still.value == 0
    fast = kp.network_feedback(plants, links, gain_bound=none, uniform=uniform, rate=0.8)
    assert fast.status is kp.Status.REFUTED and fast.check()
    some = kp.network_feedback(plants, links, gain_bound=[2, none] * 3, uniform=uniform, rate=0.8)
    assert some and some.check() and some.value > 0 and not some.F[..., 1, :].any() and some.F[..., 0, :].any()
    assert np.abs(some.F).max() <= 2


def test_a_limit_that_is_not_proven_is_none(monkeypatch):
    monkeypatch.setattr(Refutation, "proves", lambda *_: None)
    d = kp.network_feedback([node()] * 3, ring(3))
    assert d and np.isnan(d.limit) and "the best found" in d.explain()


def test_one_gain_for_all_takes_no_less_than_gains_of_their_own():
    stack, W, _ = random_network(60, weight=5)
    own, one = (kp.network_feedback(stack, W, rate=0.1, uniform=uniform) for uniform in (False, True))
    assert own.limit <= one.value and own.limit <= one.limit * (1 + 1e-3)
