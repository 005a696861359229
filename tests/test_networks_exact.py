"""Networks on the margin of stability and a unit in the last place beside it: never undecided, never wrong."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from random_networks import is_stable, marginal_network

import control_kpos as kp
from control_kpos.exact.matrix import Matrix
from control_kpos.networks import AlgebraicLoop, NetworkInstability
from control_kpos.networks.certify import at_rate
from control_kpos.proof import independent
from control_kpos.proof.certificate import Status
from control_kpos.proof.files import read_content

ONES, TINY = np.ones((3, 3), dtype=object), Fraction(1, 10**30) * np.eye(3, dtype=int)
PAPER = kp.PolyhedralCone([[0, 1], [1, -2]])


def verdicts(seeds):
    for seed in seeds:
        made = marginal_network(np.random.default_rng(seed))
        if made is None:
            continue
        nodes, W, discrete = made
        try:
            net = kp.feedback_interconnect(nodes, W)
        except kp.DataError:  # ill-posed within rounding
            continue
        yield seed, nodes, W, discrete, net


@pytest.mark.parametrize("start", range(0, 900, 150))
def test_verdict_is_that_of_the_closed_loop_in_fractions(start):
    seen = dict.fromkeys(Status, 0)
    for seed, nodes, W, discrete, net in verdicts(range(start, start + 150)):
        certificate = net.certificate
        seen[certificate.status] += 1
        assert certificate.status is (Status.PROVED if is_stable(nodes, W, discrete) else Status.REFUTED), seed
        assert certificate.check(), seed
        assert np.isfinite(certificate.margin) and not str(certificate.margin).startswith("-0.0e"), seed
    assert seen[Status.PROVED] > 20 and seen[Status.REFUTED] > 60


def test_permuting_the_nodes_changes_no_verdict():
    rng = np.random.default_rng(0)
    for _, nodes, W, _, net in verdicts(range(1000, 1040)):
        order = rng.permutation(len(nodes))
        rows, columns = (
            np.concatenate([offsets[j] + np.arange(offsets[j + 1] - offsets[j]) for j in order])
            for offsets in net.model.offsets[1:]
        )
        other = kp.feedback_interconnect([nodes[j] for j in order], W[np.ix_(rows, columns)])
        assert other.certificate.status is net.certificate.status


def test_files_and_the_independent_checker_read_exact_certificates(tmp_path):
    kinds = set()
    for seed, _, _, _, net in verdicts(range(2000, 2150)):
        certificate = net.certificate
        exact = certificate.exact is not None or getattr(certificate.witness, "exact", None) is not None
        kind = (certificate.status, type(certificate.witness), exact)
        if kind in kinds:
            continue
        kinds.add(kind)
        certificate.save(tmp_path / "net.json")
        again = kp.load_certificate(tmp_path / "net.json")
        assert again.status is certificate.status and again.check(), seed
        assert independent.verdict(read_content(tmp_path / "net.json")).status == certificate.status.name, seed
    assert {(s, exact) for s, _, exact in kinds} >= {
        (Status.PROVED, True),
        (Status.PROVED, False),
        (Status.REFUTED, True),
        (Status.REFUTED, False),
    }


def lag(rate, D=0):
    return kp.ConeStateSpace([[-rate]], [[1.0]], [[1.0]], [[D]])


def ring(n, weight):
    return sp.csr_array((np.full(n, weight), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))


def masses(n):
    return kp.stack(np.tile([[0, 1], [-22.0, -13]], (n, 1, 1)), [[0], [1]], [[1, 0]], X=PAPER)


def test_a_loop_of_gain_one_and_the_doubles_beside_it():
    for n in (2, 60):
        for weight, status in (
            (22.0, Status.REFUTED),
            (np.nextafter(22.0, 0), Status.PROVED),
            (np.nextafter(22.0, 23), Status.REFUTED),
        ):
            certificate = kp.feedback_interconnect(masses(n), ring(n, weight)).certificate
            assert certificate.status is status and certificate.check()
    x = kp.feedback_interconnect([lag(1)] * 2, [[0, 3.0], ["1/3", 0]]).certificate.witness
    assert isinstance(x, NetworkInstability) and x.x[0] == 3 * x.x[1]


def test_thirds_need_fractions():
    stable = kp.feedback_interconnect([lag(3)] * 3, ONES - TINY)
    assert stable.certificate.status is Status.PROVED and stable.certificate.exact is not None
    assert stable.with_links(0.5 * np.eye(3)).certificate.status is Status.PROVED
    assert stable.without_node(0).certificate.status is Status.PROVED
    unstable = kp.feedback_interconnect([lag(3)] * 3, ONES + TINY)
    assert unstable.certificate.status is Status.REFUTED and unstable.certificate.check()


@pytest.mark.parametrize("tiny", [Fraction(1, 10**400), Fraction(-1, 10**400)])
def test_a_weight_of_which_the_closest_double_is_zero(tiny):
    certificate = kp.feedback_interconnect([lag(1.0), lag(1.0)], [[0, tiny], [0.25, 0]]).certificate
    assert certificate.status == ("PROVED" if tiny > 0 else "REFUTED")
    assert certificate.check()


def test_changed_exact_data_fail_their_check():
    W = ONES - TINY
    good = kp.feedback_interconnect([lag(3)] * 3, W).certificate
    tilted = tuple(value + Fraction(k, 10**25) for k, value in enumerate(good.exact[0]))
    assert good.check() and not replace(good, exact=None).check()
    assert not replace(good, exact=(tilted, *good.exact[1:])).check()
    assert not replace(good, v=good.v * 2).check()
    with pytest.raises(kp.DataError, match="2 exact vectors"):
        replace(good, exact=good.exact[:2])
    nodes = [lag(3), lag(7)]
    bad = kp.feedback_interconnect(nodes, [["0", "21/10"], ["10", "0"]]).certificate
    assert bad.status is Status.REFUTED and bad.check()
    shifted = replace(
        bad.witness,
        exact=tuple(tuple(Fraction(v) - Fraction(1, 10**30) for v in part.fractions()) for part in bad.witness.vectors),
    )
    assert not replace(bad, witness=shifted).check()


def test_feedthrough_next_to_gain_one():
    below = 1 - 2.0**-40
    for gain, kind in ((below, type(None)), (1 + 2.0**-40, AlgebraicLoop)):
        certificate = kp.feedback_interconnect([lag(4.0**40, D=gain), lag(4.0**40, D=1.0)], ring(2, 1.0)).certificate
        assert isinstance(certificate.witness, kind) and certificate.status is not Status.UNDECIDED
        assert certificate.check()


def test_one_way_chains_of_marginal_parts():
    rng = np.random.default_rng(3)
    pairs = [lag(r) for _ in range(8) for r in (1.0, 4.0)]
    W = np.kron(np.eye(8), [[0, 2.0], [2.0, 0]]) + np.kron(np.tril(rng.integers(0, 9, (8, 8)), -1), np.ones((2, 2)))
    assert kp.feedback_interconnect(pairs, W).certificate.status is Status.REFUTED
    slower = kp.feedback_interconnect(pairs, W - 2.0**-50 * np.kron(np.eye(8), [[0, 1], [1, 0]]))
    assert slower.certificate.status is Status.PROVED and slower.certificate.check()
    faster = W.copy()
    faster[6, 7] += 2.0**-50  # one part of eight
    certificate = kp.feedback_interconnect(pairs, faster).certificate
    assert certificate.status is Status.REFUTED and certificate.check()


class TestAskedRate:
    """Nodes and links of M = S - diag(1'S) - rate I, which has the decay rate `rate` exactly: 1'M = -rate 1'."""

    def network(self, seed, rate, discrete):
        rng = np.random.default_rng(seed)
        sizes = rng.integers(1, 4, int(rng.integers(2, 5)))
        ends = np.cumsum([0, *sizes])
        S = rng.integers(1, 4, (ends[-1], ends[-1])).astype(object) * Fraction(1, 100)
        np.fill_diagonal(S, 0)
        M = S - np.diag(S.sum(axis=0)) + np.diag([Fraction(int(discrete)) - rate] * ends[-1])
        W, nodes = M.copy(), []
        for j, n in enumerate(sizes):
            own = slice(ends[j], ends[j + 1])
            T = np.eye(n, dtype=int) + np.triu(rng.integers(-2, 3, (n, n)), 1)
            back = np.round(np.linalg.inv(T)).astype(int)
            W[own, own] = 0
            X, A = kp.PolyhedralCone(T.T.tolist()), T.astype(object) @ M[own, own] @ back.astype(object)
            nodes.append(kp.ConeStateSpace(A.tolist(), T, back, np.zeros((n, n)), discrete, X=X))
        return kp.feedback_interconnect(nodes, W.tolist())

    @pytest.mark.parametrize("discrete", [False, True])
    @pytest.mark.parametrize("seed", range(6))
    def test_just_below_at_and_above_the_rate(self, seed, discrete):
        rate = Fraction(1, 3) if seed % 2 else Fraction("0.7")
        c = self.network(seed, rate, discrete).certificate
        for asked in (rate / 2, rate * (1 - Fraction(1, 10**20)), rate):
            d = at_rate(c, asked)
            assert d and d.check() and d.required_rate == asked and d.decay_rate <= rate
            assert not replace(d, required_rate=2 * rate).check() and not replace(d, required_rate=Fraction(0)).check()
        assert not replace(d, required_rate=rate * (1 + Fraction(1, 10**30))).check()
        assert not replace(d, required_rate=float(rate)).check()
        assert at_rate(c, rate * (1 + Fraction(1, 10**20))).status is Status.UNDECIDED

    @pytest.mark.parametrize("discrete", [False, True])
    def test_files_keep_the_rate(self, discrete, tmp_path):
        net = self.network(1, Fraction(1, 3), discrete)
        d = at_rate(net.certificate, Fraction(1, 3))
        d.save(tmp_path / "c.json")
        again = kp.load_certificate(tmp_path / "c.json")
        assert again == d and again.required_rate == Fraction(1, 3) and again.explain() == d.explain()
        assert (
            "decay rate at least 1/3 per" in d.explain()
            and independent.verdict(read_content(tmp_path / "c.json")).status == "PROVED"
        )
        assert again != net.certificate and "required_rate" not in net.certificate.contents()

    def test_a_slow_node_at_the_end_of_a_chain(self):
        """V may weigh what is upstream; upstream the slow node feeds a faster one, and no V decays as fast."""
        nodes = [kp.ConeStateSpace([[a]], [[1]], [[1]], 0) for a in ("-1/3", -1, -1)]
        down = kp.feedback_interconnect(nodes, [[0, 1, "2/7"], [0, 0, 1], [0, 0, 0]])
        up = kp.feedback_interconnect(nodes, [[0, 0, 0], [0, 0, 1], ["2/7", 0, 0]])
        assert at_rate(down.certificate, Fraction(1, 3)) and not at_rate(up.certificate, Fraction(1, 3))
        assert at_rate(up.certificate, Fraction(333, 1000))
        assert down.linear_lyapunov(rate="1/3") and not up.linear_lyapunov(rate="1/3")

    def test_feedthrough_own_links_and_cones_with_more_facets(self):
        direct = kp.ConeStateSpace([[-1]], [[1]], [[1]], [["1/4"]])
        loops = kp.feedback_interconnect([direct] * 2, [[0, "1/2"], ["1/2", 0]])  # -1 + 4/7
        pyramid = kp.PolyhedralCone([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
        A = [["-2/3", 0, 0], [0, "-2/3", 0], [0, 0, "-1/2"]]
        node = kp.ConeStateSpace(A, [[0], [0], [1]], [[0, 0, 1]], 0, X=pyramid)
        ring = kp.feedback_interconnect([node] * 2, [[0, "1/6"], ["1/6", 0]])
        turned = kp.ConeStateSpace([[-1, "-1/9"], ["2/3", -1]], [[1], [0]], [[0, 1]], 0)  # positive with its own link
        own = kp.feedback_interconnect([turned] * 2, [["7/9", 0], [0, "7/9"]])
        for net, rate in ((loops, Fraction(3, 7)), (ring, Fraction(1, 3)), (own, Fraction(1, 3))):
            d = at_rate(net.certificate, rate)
            assert d and d.check() and not at_rate(net.certificate, rate + Fraction(1, 10**18))

    def test_edits_inherit_the_rate_while_it_holds(self):
        net = self.network(2, Fraction(1, 3), False)
        d = at_rate(net.certificate, Fraction(1, 3))
        net = kp.ConeNetwork(net.model, certificate=d)
        half = Matrix.from_fractions(net.model.coupling.fractions() / 2)
        assert net.with_links(half).certificate.required_rate == Fraction(1, 3)
        assert net.without_node(0).certificate.required_rate == Fraction(1, 3)


def test_cones_whose_generators_are_not_doubles():
    U = kp.PolyhedralCone([["1/3", "1"], ["1", "-1/7"]])
    Y = kp.PolyhedralCone([["1", "1/3", "0"], ["0", "1", "1/7"], ["1/9", "0", "1"], ["1", "1", "-1/11"]])
    C, B = Y.interior_point[:, None], U.dual.interior_point[None]
    block = np.outer(U.interior_point, Y.dual.interior_point)
    gain = float((B @ block @ C).item())
    for rate, status in ((1.01 * gain, Status.PROVED), (0.99 * gain, Status.REFUTED)):
        node = kp.ConeStateSpace([[-rate]], B, C, np.zeros((3, 2)), U=U, Y=Y)
        certificate = kp.feedback_interconnect([node] * 2, [[None, block], [block, None]]).certificate
        assert certificate.status is status and certificate.check()
