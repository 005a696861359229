"""Links of nodes to themselves belong to the nodes: (I) is asked of the others, and nothing else changes."""

from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import CONE, lag
from random_networks import fractions, is_stable, marginal_network, resolved_coupling

import control_kpos as kp
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.signs import BilinearForms
from control_kpos.networks import AlgebraicLoop, CouplingViolation, NetworkInstability, NodeViolation
from control_kpos.networks.own_links import own_links_closed, same_network
from control_kpos.proof import files, independent
from control_kpos.proof.certificate import Status


def laplacian(weights):
    return np.diag(weights.sum(axis=1)) - weights


def ring(n):
    return np.roll(np.eye(n), 1, 0) + np.roll(np.eye(n), -1, 0)


def opened(rng, nodes, W):
    """Nodes that become the given ones once links of any sign to themselves are closed, and W with these links."""
    ends = np.cumsum([[0, 0], *((s.ninputs, s.noutputs) for s in nodes)], axis=0)
    out, links = [], fractions(W)
    for s, (u, y), (v, z) in zip(nodes, ends[:-1], ends[1:], strict=True):
        K = fractions(rng.integers(-3, 4, size=(s.ninputs, s.noutputs)) / 4)
        A, B, C, D = (fractions(getattr(s, name)) for name in "ABCD")
        L = resolved_coupling(-K, D)
        if L is None:
            return None
        data = A + B @ L @ C, B + B @ L @ D, C + D @ L @ C, D + D @ L @ D
        out.append(kp.ConeStateSpace(*data, s.dt, X=s.X, U=s.U, Y=s.Y))
        links[u:v, y:z] += K
    return out, links


def opened_networks(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        made = marginal_network(rng)
        changed = made and opened(rng, made[0], made[1])
        if not changed:
            continue
        try:
            yield made, kp.feedback_interconnect(*changed)
        except kp.DataError:  # ill-posed
            continue


def require_files(certificate, folder):
    """The certificate checks, and so do its files, read here and by the independent checker."""
    assert certificate.check()
    for suffix in ("json", "npz"):
        path = folder / f"own.{suffix}"
        certificate.save(path)
        again = kp.load_certificate(path)
        assert again.status is certificate.status and again.check() and again.explain() == certificate.explain()
    found = independent.verdict(files.read_content(folder / "own.json"))
    assert found.status == certificate.status.name, found.text


@pytest.mark.parametrize("start", [0, 100])
def test_opening_links_of_nodes_to_themselves_changes_no_verdict(start, tmp_path):
    seen = {}
    for (nodes, W, discrete), net in opened_networks(range(start, start + 100)):
        certificate = net.certificate
        assert certificate.status is (Status.PROVED if is_stable(nodes, W, discrete) else Status.REFUTED)
        assert not isinstance(certificate.witness, CouplingViolation)
        if isinstance(certificate.witness, NodeViolation):  # or a loop through one node has gain 1 or more
            base = kp.feedback_interconnect(nodes, W).certificate.witness
            assert isinstance(base, NodeViolation | AlgebraicLoop)
        closed = certificate.model.origin is not None
        key = certificate.status, closed
        seen[key] = seen.get(key, 0) + 1
        if seen[key] <= 5:
            require_files(certificate, tmp_path)
        if closed:
            assert "closed first" in certificate.explain()
    assert seen[Status.PROVED, True] > 10 and seen[Status.REFUTED, True] > 20


@pytest.mark.parametrize("discrete", [False, True])
def test_a_laplacian_is_a_coupling(discrete, tmp_path):
    rng = np.random.default_rng(3)
    weights = np.array([[str(Fraction(int(w), 60)) for w in row] for row in rng.integers(0, 4, (5, 5))], dtype=object)
    L = laplacian(np.array([[Fraction(w) for w in row] for row in weights]) * (1 - np.eye(5, dtype=int)))
    statuses = []
    for rate in (Fraction(-1, 7), Fraction(0), Fraction(1, 10**20)):  # the eigenvector of ones has this rate
        node = kp.ConeStateSpace([[rate + discrete]], [[1]], [[1]], [[0]], discrete)
        net = kp.feedback_interconnect([node] * 5, -L)
        certificate = net.certificate
        statuses.append(certificate.status.name)
        require_files(certificate, tmp_path)
        lower, upper = net.spectral_abscissa()
        assert lower <= rate + discrete <= upper
        assert net.is_cone_positive() and net.linear_lyapunov().status is certificate.status
        if rate >= 0:
            assert isinstance(certificate.witness, NetworkInstability)
    assert statuses == ["PROVED", "REFUTED", "REFUTED"]
    require_files(net.abscissa_certificate(), tmp_path)


def test_what_is_proven_as_given_stays_as_it_was():
    W = 0.3 * ring(5) + 0.2 * np.eye(5)
    net = kp.feedback_interconnect([lag(1.0, D=0.1)] * 5, W)
    assert net.certificate and net.certificate.model is net.model
    unstable = kp.feedback_interconnect([lag(1.0)] * 5, 3 * W)
    assert isinstance(unstable.certificate.witness, NetworkInstability) and unstable.certificate.model is unstable.model
    wrong = ring(5) - np.eye(5)
    wrong[0, 1] = -1
    witness = kp.feedback_interconnect([lag(1.0)] * 5, wrong).certificate.witness
    assert isinstance(witness, CouplingViolation) and witness.target != witness.source


def test_a_link_to_itself_makes_a_node_positive_or_not():
    A = [[-3, -1], [1, -3]]
    node = kp.ConeStateSpace(A, [[1], [0]], [[0, 1]], 0)
    nets = [kp.feedback_interconnect([node] * 2, [[w, 0.5], [0.5, w]]) for w in (0, 1, 2)]
    assert [net.certificate.status.name for net in nets] == ["REFUTED", "PROVED", "PROVED"]
    witness = kp.feedback_interconnect([lag(1.0, D=0.5)] * 2, [[4, 1], [1, -4]]).certificate.witness
    assert isinstance(witness, NodeViolation) and witness.node == 0  # its own loop has gain 2
    seed = kp.ConeStateSpace([[0, 1], [-21.5, -13]], [[0], [1]], [[1, 0]], 0, X=CONE)
    nets = [kp.feedback_interconnect([seed] * 2, [[-w, 0.1], [0.1, -w]]) for w in (0.5, 1)]
    assert [net.certificate.status.name for net in nets] == ["PROVED", "REFUTED"]  # -22 is the edge of positivity


def test_a_singular_link_to_itself_stays_open():
    net = kp.feedback_interconnect([lag(1.0, D=0.5)] * 2, [[2, -1], [1, 0]])  # I - W D is regular, its own part is not
    assert own_links_closed(net.model) is None
    assert net.certificate.status is Status.REFUTED and net.certificate.model is net.model


def test_edits_and_responses_of_such_a_network():
    n = 6
    net = kp.feedback_interconnect([lag(0.1)] * n, -laplacian(ring(n)))
    room = net.room_for(lag(2.0), sources=[0], targets=[3])
    assert 0 < room < np.inf
    a = 0.9 * np.sqrt(room)
    for changed in (
        net.with_node(lag(2.0), incoming={0: a}, outgoing={3: a}),
        net.without_node(2),
        net.replace_node(1, lag(0.2)),
        net.with_links(-laplacian(ring(n)) - 0.5 * np.eye(n)),
    ):
        assert "certificate" in vars(changed) and changed.certificate.check()
        assert same_network(changed.certificate.model, own_links_closed(changed.model))
        assert np.linalg.eigvals(changed.A).real.max() < -changed.certificate.decay_rate + 1e-12
    plain = ct.ss(net.A, net.B, net.C, net.D)
    assert np.allclose(net.poles(2).real.max(), plain.poles().real.max())
    T = np.linspace(0, 5, 40)
    reference = ct.initial_response(plain, T, np.arange(n))
    assert np.allclose(net.initial_response(T, np.arange(n)).outputs, reference.outputs, atol=1e-9)
    assert np.isclose(net.gain("Linf"), plain.dcgain().sum(axis=1).max())


def test_given_supply_rates_go_with_the_links():
    n = 4
    W = -laplacian(ring(n))
    net = kp.feedback_interconnect([lag(0.1)] * n, W, supply_rates=[([0], [1])] * n)
    assert net.certificate and net.certificate.check() and (net.certificate.q == -2).all()
    loud = kp.feedback_interconnect([lag(0.1)] * n, W, supply_rates=[([Fraction(1, 10)], [1])] * n)
    assert loud.certificate.status is Status.REFUTED and loud.certificate.check()


def test_what_is_not_the_closed_network_does_not_check(tmp_path):
    net = kp.feedback_interconnect([lag(0.1, D=0.25)] * 3, -laplacian(ring(3)))
    certificate = net.certificate
    assert certificate and certificate.check()
    model = certificate.model
    faster = kp.stack(np.full((3, 1, 1), -9.0), [[1]], [[1]], [[0.1]])
    for wrong in (replace(model, stacks=(faster,)), replace(model, origin=certificate.model)):
        assert not type(certificate).settle(**{**certificate.data(), "model": wrong}).check()
    path = tmp_path / "own.json"
    certificate.save(path)
    path.write_text(path.read_text().replace(',"own_links_closed":true', "").replace('"digest"', '"producer "'))
    with pytest.raises(kp.KposError):
        kp.load_certificate(path)
    with pytest.raises(kp.DataError, match="no node has a link to itself"):
        type(certificate).restore(
            {**kp.feedback_interconnect(lag(1.0), [[0]]).certificate.contents(), "own_links_closed": True}
        )


def test_matrices_of_a_stack_may_have_denominators_of_their_own():
    below = np.array([2**60 + 2 * k + 1 for k in range(6000)], dtype=object)[:, None, None]
    stack = Matrix.over(np.ones((6000, 1, 1), dtype=object), below)
    beside = Matrix.join([stack, Matrix(np.full((6000, 1, 1), 0.5))], -1)
    assert stack.fractions()[7, 0, 0] == Fraction(1, 2**60 + 15) and beside[5].fractions()[0, 1] == Fraction(1, 2)
    assert not stack.is_double and beside[np.array([3])].fractions()[0, 0, 0] == Fraction(1, 2**60 + 7)
    signs = BilinearForms(
        Matrix(np.array([[2.0**60, -1.0]])),
        Matrix.join([stack, Matrix(np.ones((1, 1, 1)))], -2),
        Matrix(np.ones((1, 1))),
    )
    assert (signs.signs() == -1).all()  # 2^60 / (2^60 + 2 k + 1) is below 1 by less than a rounding
    with pytest.raises(kp.TooLargeError, match="denominators of their own"):
        stack.as_integers()


@pytest.mark.parametrize("feedthrough", [False, True])
def test_thousands_of_different_nodes(feedthrough):
    rng, n = np.random.default_rng(1), 5000
    weights = sp.csr_array(sp.random_array((n, n), density=3 / n, rng=rng))
    weights.setdiag(0)
    W = weights - sp.diags_array(weights.sum(axis=1))
    D = rng.uniform(0, 0.3, (n, 1, 1)) if feedthrough else None
    nodes = kp.stack(-rng.uniform(0.1, 1, (n, 1, 1)), rng.uniform(0.5, 1, (n, 1, 1)), np.ones((n, 1, 1)), D)
    net = kp.feedback_interconnect(nodes, W)
    assert net.certificate and net.certificate.check()
    lower, upper = net.spectral_abscissa()
    assert lower <= upper < -net.certificate.decay_rate + 1e-12 and upper - lower < 1e-5 * abs(upper)
    assert net.poles(1).real.max() == pytest.approx(upper, rel=1e-5)
