"""Networks that are proven by e inside X: families without a common v, ranges that change sign, delays; files."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import CONE, cycle, lag, sparse_ring
from scipy.linalg import block_diag

import control_kpos as kp
from control_kpos import checker
from control_kpos.exact.matrix import Matrix

# A common e = (1, 1.1), and no common v: v1 > 3 v2 and v1 < 1.25 v2.
ROWS = [[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]]


def alone(gain=0.0):
    """Both vertices, in a loop with a lag."""
    node = [kp.ConeStateSpace(A, [[1], [0]], [[0, 1]], 0) for A in ROWS]
    return kp.feedback_interconnect([node, lag(2)], [[0, gain], [1, 0]])


def gauge(found, x):
    """|x|_e on orthants."""
    return np.max(np.abs(x) / np.concatenate([np.ravel(part) for part in found.e]))


@pytest.mark.parametrize("gain", [0.0, 0.25])
def test_families_with_a_common_e_alone_are_proven(gain):
    """No v exists, e does, and e makes A_s e negative at every vertex; |x|_e falls under any switching."""
    net = alone(gain)
    found = net.certificate
    assert isinstance(found, kp.BoundedNetworkCertificate) and found.check() and found.decay_rate > 0
    e = np.concatenate([np.ravel(part) for part in found.e])
    u, y = (np.concatenate([np.ravel(part) for part in vectors]) for vectors in (found.u, found.y))
    for s in range(2):
        A, B, C, _ = (block_diag(*(m,)) for m in (p.toarray() for p in net.models[s].block_matrices))
        assert (A @ e + B @ u + found.decay_rate * e <= 1e-12).all() and (C @ e <= y * (1 + 1e-12)).all()
    assert (net.model.W @ y <= u * (1 + 1e-12)).all() and (e > 0).all()
    rng, x = np.random.default_rng(0), np.array([1.0, -1.0, 0.5])
    for _ in range(30):
        A = net.member(rng.integers(0, 2, 2) * [1, 0]).A
        after = np.linalg.matrix_power(np.eye(3) + A * 1e-4, 1000) @ x
        assert gauge(found, after) <= np.exp(-0.1 * found.decay_rate) * gauge(found, x) * (1 + 1e-3)
        x = after
    assert "abs(h'x) / h'e over the facets h of X" in found.explain() and "Every choice is positive" in found.explain()
    assert found.network.W.toarray().tolist() == net.model.W.toarray().tolist()
    assert found.vertex_margins.shape == (2, 2) and kp.feedback_interconnect([lag(1)], [[0]]).certificate


def test_what_excludes_v_alone_is_undecided():
    """The storage of a family that is proven by e."""
    from control_kpos.networks.uncertain.halves import by_storage

    net = alone(0.25)
    half = by_storage(net.models, None)
    w = next(half.motions())
    found = kp.UncertainNetworkCertificate.settle(**half.given, witness=w)
    assert found.status == "UNDECIDED" and "neither found nor excluded" in found.explain() and found.check() is not None
    assert found.refuted_by is None


@pytest.mark.parametrize("seed", range(60))
def test_ranges_that_change_sign(seed):
    """PROVED by e iff the network of the bounds is stable; then members of both signs are."""
    rng = np.random.default_rng(seed)
    discrete, n, N = bool(seed % 2), 2, 3
    ends = {}
    for name, shape in (("A", (n, n)), ("B", (n, 1)), ("C", (1, n)), ("D", (1, 1))):
        low = rng.uniform(-0.3, 0.2, (N, *shape)) * (name != "D" or seed % 3 == 0)
        ends[name] = low, low + rng.uniform(0, 0.3, (N, *shape)) * (name != "D" or seed % 3 == 0)
    if not discrete:
        ends["A"] = tuple(end - 1.2 * np.eye(n) for end in ends["A"])
    low = rng.uniform(-1, 0.5, (N, N)) * 10 ** rng.uniform(-1, 0.7)
    high = low + rng.uniform(0, 0.5, (N, N))
    net = kp.feedback_interconnect(
        kp.stack(*(kp.interval(*ends[name]) for name in "ABCD"), dt=discrete), kp.interval(low, high)
    )
    bounds = {name: np.maximum(*map(np.abs, pair)) for name, pair in ends.items()}
    if not discrete:
        bounds["A"] = np.where(np.eye(n, dtype=bool), ends["A"][1], bounds["A"])
    top = kp.feedback_interconnect(
        kp.stack(*bounds.values(), dt=discrete), np.maximum(np.abs(low), np.abs(high))
    ).certificate
    found = net.certificate
    assert found.check() and bool(found) == bool(top)
    if not found:
        return
    assert isinstance(found, kp.BoundedNetworkCertificate) and "nothing is said of positivity" in found.explain()
    for _ in range(5):
        part = {name: a + rng.integers(0, 2, a.shape) * (b - a) for name, (a, b) in ends.items()}
        W = low + rng.integers(0, 2, low.shape) * (high - low)
        member = kp.feedback_interconnect(kp.stack(*part.values(), dt=discrete), W)
        assert member.poles().real.max() < 0 if not discrete else np.abs(member.poles()).max() < 1
    for change in ({"upper": None}, {"lower": None}, {"upper": found.model, "lower": found.model}):
        again = replace(found, **change)
        assert not again.check() or "lower" in change
    beyond = found.upper.with_coupling(Matrix(sp.csr_array(-2 * found.model.coupling.values)))
    assert not replace(found, upper=beyond).check()


def test_signs_of_many_nodes_are_found():
    """A ring of 6 nodes with links in [-2, 1/2]: with signs that alternate it grows; with 5 nodes there are none."""
    for n, signs in ((6, True), (5, False)):
        W = cycle(n) * 1.0
        found = kp.feedback_interconnect([lag(1)] * n, kp.interval(-2 * W, 0.5 * W)).certificate
        assert found.status == "REFUTED" and found.check()
        assert isinstance(found.witness, kp.FailingMember) == signs
    assert kp.feedback_interconnect([lag(1)] * 5, kp.interval(-0.9 * W, 0.5 * W)).certificate


def test_blocks_between_other_cones_keep_their_ends():
    """A mass on the cone of the paper beside lags: the links between orthants change sign."""
    mass = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=CONE)
    wedge = kp.PolyhedralCone([[1, 1], [1, -1]])
    wide = kp.ConeStateSpace(-3 * np.eye(2), np.eye(2), np.eye(2), 0, X=wedge, U=wedge, Y=wedge)
    rotated = [[1, -0.25], [-0.25, 1]]  # maps the wedge into itself, and has entries below 0
    W = [[None, kp.interval([["-1/3"]], [[1]]), None], [[[1]], None, None], [None, None, rotated]]
    net = kp.feedback_interconnect([mass, lag(2), wide], W)
    found = net.certificate
    assert found and found.check() and isinstance(found, kp.BoundedNetworkCertificate)
    assert found.network.coupling.fractions()[2:, 2:].tolist() == rotated
    doubled = [row[:2] + [None if b is None else 10 * np.array(b) for b in row[2:]] for row in W]
    assert not kp.feedback_interconnect([mass, lag(2), wide], doubled).certificate


def test_large_networks_are_bounded_as_fast():
    """20 000 nodes with the vertices of ROWS and links around 0; linear in the data."""
    n = 20_000
    A = np.array([[ROWS[s]] * n for s in range(2)], dtype=float)
    W = 0.1 * sparse_ring(n)
    net = kp.feedback_interconnect(kp.stack(A, [[1], [0]], [[0, 1]]), kp.interval(-W, W))
    assert isinstance(net.certificate, kp.BoundedNetworkCertificate) and net.certificate.decay_rate > 0.1
    assert sp.issparse(net.certificate.network.coupling.values)


@pytest.mark.parametrize("suffix", [".json", ".npz"])
@pytest.mark.parametrize("make", [lambda: alone(0.25), lambda: signed()])
def test_certificates_by_e_are_saved_and_checked_independently(suffix, make, tmp_path, capsys):
    found, path = make().certificate, tmp_path / f"c{suffix}"
    found.save(path)
    loaded = kp.load_certificate(path)
    assert loaded == found and loaded.check() and loaded.explain() == found.explain()
    assert np.array_equal(np.ravel(loaded.e[0]), np.ravel(found.e[0]))
    assert suffix != ".json" or checker.main(path) == 0
    assert "WRONG" not in capsys.readouterr().out


def signed():
    nodes = kp.stack(kp.interval([["-7/3"]], [["-5/3"]]), [["1/3"]], [[1]], kp.interval([[-0.25]], [[0.25]]))
    return kp.feedback_interconnect(nodes, [[kp.interval(-1, "1/3")]])


def test_perturbed_proofs_by_e_fail():
    found = alone(0.25).certificate
    v, r, q = (np.concatenate([np.ravel(x) for x in part]) for part in (found.v, found.r, found.q))
    changes = [{"v": -v}, {"v": v * [1, 0.5, 1]}, {"r": 0.9 * r}, {"q": 0.9 * q}, {"decay_rate": 2 * found.decay_rate}]
    for change in changes:
        assert not replace(found, **change).check()
    assert not replace(found, witness=kp.NoCommonStorage(np.zeros(2), np.zeros(2), np.zeros(2))).check()


def test_delays_that_change_do_not_matter():
    """Euler steps of x' = A(t) x + B W y(t - h(t)), with switching and jumping delays: |x|_e of the past bounds it."""
    net = alone(0.25)
    found, rng, step = net.certificate, np.random.default_rng(2), 0.01
    blocks = [[m.toarray() for m in model.block_matrices] for model in net.models]
    past = [np.array([1.0, -0.5, 0.7])] * 60
    largest = max(gauge(found, x) for x in past)
    for _ in range(600):
        A, B, C, _ = blocks[int(rng.integers(2))]
        late = past[-1 - int(rng.integers(50))]
        past.append(past[-1] + step * (A @ past[-1] + B @ (net.model.W @ (C @ late))))
        assert gauge(found, past[-1]) <= largest * (1 + 1e-9)
    assert gauge(found, past[-1]) < 0.5 * largest
