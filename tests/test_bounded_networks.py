"""Order intervals of networks, proven node by node: against the closed loop, at any size, forged certificates."""

from dataclasses import replace
from fractions import Fraction

import certified
import numpy as np
import pytest
import random_networks
import scipy.sparse as sp
from network_examples import CONE, lag, sparse_ring

import control_kpos as kp
from control_kpos import checker
from control_kpos.design.bounded.certificate import BoundExceeded, NoInterval
from control_kpos.errors import DataError, KposError, ShapeError

MASS = kp.ConeStateSpace([[0, 1], [-22, -14]], [[0], [1]], [[1, 0]], 0, X=CONE)


def lags(n, rate=2.0, weight=1.0):
    return kp.feedback_interconnect(kp.stack(np.full((n, 1, 1), -rate), [[1]], [[1]]), weight * sparse_ring(n))


def solved(nodes, W, w, discrete):
    """The exact end of the smallest interval, by the closed loop in floating point."""
    _, poles, closed = random_networks.poles_by_dense_algebra(nodes, W)
    stable = np.abs(poles).max() < 1 if discrete else poles.real.max() < 0
    return stable, np.linalg.solve(discrete * np.eye(len(closed)) - closed, w)


@pytest.mark.parametrize("seed", range(40))
def test_random_networks_have_the_interval_of_their_closed_loop(seed):
    """Cones of all kinds, feedthrough, both times: x_min <= -A^{-1} w <= x_max in the order of X, close by."""
    rng = np.random.default_rng(seed)
    nodes, blocks, discrete = random_networks.random_network(rng, 4)
    W, net = random_networks.dense_coupling(nodes, blocks), kp.feedback_interconnect(nodes, blocks)
    w = np.concatenate([random_networks.inside(rng, s.X) for s in nodes])
    if not net.certificate:
        return
    found = certified.network_interval(nodes, W, w)
    stable, x = solved(nodes, W, w, discrete)
    assert stable and found.status == "PROVED" and found.check() and found.gap < 1e-4
    size = np.abs(net.X.facets) @ np.abs(x)
    assert (net.X.facets @ (found.x_max - x) >= -1e-9 * size).all()
    assert (net.X.facets @ (x - found.x_min) >= -1e-9 * size).all()
    f = rng.standard_normal(len(w))
    most = certified.network_interval(nodes, W, w, ([f], [1e9])).reached()[0]
    if most < 1e-6 * np.abs(f) @ np.abs(x):
        return  # f'x <= 0 on all of X
    for part, status in ((1.001, "PROVED"), (0.999, "REFUTED")):
        decided = certified.network_interval(nodes, W, w, ([f], [most * part]))
        assert decided.status == status and decided.check()


@pytest.mark.parametrize("seed", range(40))
def test_networks_that_grow_have_none(seed):
    rng = np.random.default_rng(1000 + seed)
    nodes, blocks, _ = random_networks.random_network(rng, 4, density=1.0)
    net = kp.feedback_interconnect(nodes, blocks)
    if isinstance(net.certificate.witness, kp.NetworkInstability):
        w = np.concatenate([random_networks.inside(rng, s.X) for s in nodes])
        found = certified.network_interval(nodes, random_networks.dense_coupling(nodes, blocks), w)
        assert found.status == "REFUTED" and found.check() and isinstance(found.witness, NoInterval)


def test_a_large_ring_and_bounds_at_every_node():
    """x' = -2 x + x_next + 1: x = 1 everywhere."""
    n = 500
    net, each = lags(n), sp.eye_array(n, format="csr")
    b = kp.order_interval(net, np.ones(n), constraints=(each, np.full(n, 1.001)))
    assert b and b.check() and b.certificate.gap < 1e-10 and "for every row of the constraints" in b.explain()
    np.testing.assert_allclose(b.x_max, 1, rtol=1e-10)
    assert (b.x_min <= 1).all() and (b.x_max >= 1).all() and (b.reached >= 1).all()
    limits = np.full(n, 1.001)
    limits[17] = 0.999
    no = kp.order_interval(net, np.ones(n), constraints=(each, limits))
    assert no.status == "REFUTED" and no.check() and no.witness.row == 17


def test_a_disturbance_of_one_node_fades():
    b = kp.order_interval(lags(400), np.eye(1, 400)[0])
    assert b and b.check() and "smaller" not in b.explain()
    np.testing.assert_allclose(b.x_max[[0, 399, 398]], [0.5, 0.25, 0.125], rtol=1e-9)
    np.testing.assert_allclose(b.x_max, b.x_min, rtol=1e-9, atol=1e-12)


def test_nothing_pushes():
    b = kp.order_interval(lags(400), np.zeros(400), constraints=(sp.csr_array(np.ones((1, 400))), [0]))
    assert b and not b.x_max.any() and b.certificate.gap == 0 and b.reached.tolist() == [0]


def test_inputs_on_the_interval():
    """|F x| <= u_max are the rows F and -F."""
    net = kp.feedback_interconnect([MASS] * 200, 0.25 * sparse_ring(200))
    F = sp.kron(sp.eye_array(200), [[-3.0, 1.0]], format="csr")
    b = kp.order_interval(net, np.tile([0, 1], 200), constraints=(sp.vstack([F, -F], format="csr"), np.ones(400)))
    assert b and b.check()
    rng = np.random.default_rng(0)
    heights = np.diag(CONE.facets @ CONE.rays.T)
    assert (heights > 0).all()  # facet k is opposite generator k
    for _ in range(20):
        parts = b.x_max.reshape(-1, 2) @ CONE.facets.T / heights * rng.random((200, 2))
        x = (parts @ CONE.rays).ravel()
        assert (F @ x <= b.reached[:200]).all() and (-F @ x <= b.reached[200:]).all()


def test_growth_that_the_disturbance_reaches():
    no = kp.order_interval(lags(400, rate=0.5), np.eye(1, 400)[0])
    assert no.status == "REFUTED" and no.check() and isinstance(no.witness, NoInterval)


def test_growth_in_a_part_of_a_random_graph():
    """Nodes that nobody hears do not grow; what grows is found in the others."""
    n, rng = 2000, np.random.default_rng(0)
    W = sp.csr_array((np.full(3 * n, 0.5), (np.repeat(np.arange(n), 3), rng.integers(0, n, 3 * n))), shape=(n, n))
    net = kp.feedback_interconnect(kp.stack(np.full((n, 1, 1), -1.0), [[1]], [[1]]), W)
    no = kp.order_interval(net, np.ones(n))
    assert no.status == "REFUTED" and no.check() and 0 < np.count_nonzero(no.witness.d) < n
    unheard = np.flatnonzero(W.sum(axis=0) == 0)
    assert unheard.size and not no.witness.d[unheard].any()


def test_growth_that_it_does_not_reach_is_left_open():
    nodes = [lag(-1.0)] + [lag(2.0)] * 400
    b = kp.order_interval(kp.feedback_interconnect(nodes, sp.csr_array((401, 401))), np.eye(1, 401, 1)[0])
    assert b.status == "UNDECIDED" and "none was excluded" in b.message


def test_networks_that_are_not_positive_part_by_part_are_left_open():
    b = kp.order_interval(lags(400, weight=-1.0), np.ones(400))
    assert b.status == "UNDECIDED" and "node by node" in b.message


def test_bounds_between_both_ends_are_left_open():
    exact = kp.order_interval(lags(400), np.ones(400), constraints=(sp.csr_array(np.eye(1, 400)), [1]))
    assert exact.status == "UNDECIDED" and "an invariant interval was found" in exact.message


def test_files(tmp_path):
    b = kp.order_interval(lags(400), np.full(400, 0.5), constraints=(sp.csr_array(np.eye(1, 400)), ["2/3"]))
    for name in ("file.json", "file.npz"):
        b.save(tmp_path / name)
        assert kp.load_certificate(tmp_path / name) == b.certificate
    assert checker.main(tmp_path / "file.json") == 0


PUSHED = [0, "1/3", 1]


def small(constraints=None, w=PUSHED):
    return certified.network_interval([MASS, lag(3.0)], [[0, 0.25], [0.5, 0]], w, constraints)


@pytest.mark.parametrize(
    ("name", "factor"),
    [(f"{x}_max", part) for x in "xuy" for part in (0.5, -1.0)]
    + [(f"{x}_min", part) for x in "xuy" for part in (2.0, 1.5)]
    + [("w_max", 2.0), ("w_max", -1.0), ("v", -1.0), ("r", 0.5), ("q", 0.5), ("bounds", 0.5)],
)
def test_changed_certificates_prove_nothing(name, factor):
    good = small(([[0, 0, 1]], ["1/2"]))
    assert good
    data = {k: x for k, x in good.data().items() if k not in ("exact", f"{name}_exact")}
    old = getattr(good, name)
    changed = tuple(factor * np.array(x) for x in old) if isinstance(old, tuple) else factor * np.array(old)
    assert type(good).settle(**data | {name: old}) and not type(good).settle(**data | {name: changed})
    assert not replace(good, status=kp.Status.REFUTED).check()


def test_other_links_or_rows_prove_nothing():
    good, other = small(([[0, 0, 1]], ["1/2"])), small(([[0, 0, 2]], [1]))
    assert good and not type(good).settle(**good.data() | {"rows": other.rows})
    stronger = certified.network_interval([MASS, lag(3.0)], [[0, 0.5], [0.5, 0]], PUSHED)
    assert not type(good).settle(**small().data() | {"model": stronger.model})
    for change in ({"covers": None}, {"x_max": good.x_max[:2]}, {"w_max": good.w_max[:2], "w_max_exact": None}):
        with pytest.raises(DataError):
            type(good).settle(**good.data() | change)


def test_forged_witnesses_refute_nothing():
    no = certified.network_interval([lag(0.5), lag(1.0)], [[0, 1], [1, 0]], [0, "1/3"])
    assert no.status == "REFUTED"
    for d in ([0, 1], [-1, -1], [0, 0]):
        assert type(no).settle(**no.data() | {"witness": NoInterval(np.array(d, dtype=float))}).status == "UNDECIDED"
    for name in "rq":
        assert (
            type(no).settle(**no.data() | {name: np.array([9.0, 9.0]) * (1 if name == "r" else -1)}).status
            == "UNDECIDED"
        )
    no = small(([[0, 0, 1]], ["1/4"]))
    assert no.status == "REFUTED" and no.check()
    for x, row in ((no.witness.x * 2, 0), (no.witness.x / 2, 0), (no.witness.x, 1)):
        assert type(no).settle(**no.data() | {"witness": BoundExceeded(x, row)}).status == "UNDECIDED"
    with pytest.raises(DataError, match="number of a row"):
        type(no).settle(**no.data() | {"witness": BoundExceeded(no.witness.x, -1)})


def test_fractions_are_kept():
    found = small(([[0, 0, 1]], ["2/3"]))
    assert found.w_max_exact[1] == Fraction(1, 3) and found.bounds_exact == (Fraction(2, 3),)


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"w_max": [1]}, ShapeError, r"w_max has shape \(1,\)"),
        ({"w_max": -np.ones(400)}, DataError, "outside X, beyond facet 0"),
        ({"X": kp.orthant(400)}, DataError, "leave X out"),
        ({"constraints": ([["1/3"] * 400], [1])}, DataError, "must hold doubles"),
        ({"constraints": (np.ones((1, 3)), [1])}, ShapeError, "constraints f"),
    ],
)
def test_wrong_arguments(kwargs, error, words):
    with pytest.raises(error, match=words):
        kp.order_interval(**{"sys": lags(400), "w_max": np.ones(400)} | kwargs)
    assert issubclass(error, KposError)


def test_a_time_limit_ends_it():
    b = kp.order_interval(lags(400), np.ones(400), time_limit=1e-9)
    assert b.status == "UNDECIDED" and "time limit" in b.message
