"""`switched(chain=)`: stability in the mean, against eigenvalues of the means; lost links; changed certificates."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.exact.matrix import Matrix

SEED = kp.PolyhedralCone([[0, 1], [1, -2]])
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
TWO = [[-1, 1], [2, -2]]


def of_means(family, chain, jumps, discrete):
    """The matrix of the means, x_j' = A_j x_j + sum_i q_ij J_ij x_i, or x_j+ = sum_i p_ij J_ij A_i x_i."""
    count, n = len(family), len(family[0])
    J = {(i, j): np.asarray(jumps.get((i, j), np.eye(n))) for i in range(count) for j in range(count)}
    step = [
        [chain[i][j] * J[i, j] @ (family[i] if discrete else np.eye(n)) for i in range(count)] for j in range(count)
    ]
    own = np.zeros((count * n, count * n))
    for j in range(count * (not discrete)):
        own[j * n : (j + 1) * n, j * n : (j + 1) * n] = family[j]
    return np.block(step) + own


def random_chain(rng, count, discrete):
    Q = rng.random((count, count)) * (rng.random((count, count)) < 0.8) + 1e-3
    return Q / Q.sum(axis=1)[:, None] if discrete else Q - np.diag(Q.sum(axis=1))


@pytest.mark.parametrize(("a", "status"), [("1.4", "PROVED"), ("3/2", "REFUTED"), ("1.6", "REFUTED")])
def test_two_modes_are_decided_exactly(a, status):
    """x' = -3 x, left at rate 1, and x' = a x, left at rate 2: the determinant of the means is 4 (2 - a) - 2."""
    s = kp.switched([[[-3]], [[a]]], chain=TWO)
    assert s.status.name == status and s.check()
    assert (s.vs is not None) == (status == "PROVED") and (s.margin == 0) == (a == "3/2")


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("discrete", [False, True])
def test_random_chains_agree_with_eigenvalues(seed, discrete):
    rng = np.random.default_rng(seed)
    for _ in range(2):
        n, count = int(rng.integers(1, 4)), int(rng.integers(2, 5))
        family = [rng.random((n, n)) * rng.uniform(0.2, 2) for _ in range(count)]
        if not discrete:
            family = [A - np.diag(rng.uniform(0, 2 * n) * np.ones(n)) for A in family]
        chain = random_chain(rng, count, discrete)
        pairs = [(i, j) for i in range(count) for j in range(count) if i != j and rng.random() < 0.4]
        jumps = {pair: rng.random((n, n)) * rng.uniform(0, 2) for pair in pairs}
        s = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete)
        L = of_means(family, chain, jumps, discrete)
        slowest = np.abs(np.linalg.eigvals(L)).max() - 1 if discrete else np.linalg.eigvals(L).real.max()
        assert s.status.name == ("PROVED" if slowest < 0 else "REFUTED") and s.check()
        if s:
            v = s.vs.ravel()
            assert (v > 0).all() and (v @ L + (s.decay_rate - discrete) * v <= 1e-9).all()
            best = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete, rate="max")
            assert best.decay_rate == pytest.approx(-slowest, rel=1e-5)
        else:
            x = np.asarray(s.witness.vectors.values).ravel()
            assert (x >= 0).all() and (L @ x - discrete * x >= -1e-9).all()


def test_jumps_count_from_the_first_to_the_second_member():
    """In the mean the second state is 3 q_01 / (1 + q_10) of what the first one sends."""
    family, chain = [-np.eye(1), -np.eye(1)], [[-1, 1], ["1/10", "-1/10"]]
    assert kp.switched(family, chain=chain, jumps={(0, 1): [[9]]})
    assert not kp.switched(family, chain=chain, jumps={(1, 0): [[9]], (0, 1): [[9]]})
    array = np.tile(np.eye(1), (2, 2, 1, 1))
    array[0, 1] = 9
    s = kp.switched(family, chain=chain, jumps=array)
    assert (
        s.certificate.between == (0, 1)
        and s.certificate == kp.switched(family, chain=chain, jumps={(0, 1): [[9]]}).certificate
    )
    assert kp.switched(family, chain=chain, jumps=[[None, [[9]]], [None, None]]).certificate == s.certificate


def test_on_other_cones():
    family = [[["-1", "0.6"], [0, -4]], [["1/3", "1.4"], [0, -4]]]
    assert kp.switched(family, X=SEED, chain=[[-1, 1], [3, -3]])
    assert kp.switched(family, X=SEED, chain=[[-3, 3], [1, -1]]).status == "REFUTED"
    quiet = [np.diag([-1, -1, -0.25]), np.diag([-2, -1, 0.125])]
    s = kp.switched(quiet, X=SQUARE, chain=[[-1, 1], [1, -1]], jumps={(0, 1): TURN})
    assert s and all((SQUARE.rays @ v > 0).all() for v in s.vs)
    tilted = kp.switched(quiet, X=SQUARE, chain=[[-1, 1], [1, -1]], jumps={(0, 1): -TURN})
    assert tilted.status == "REFUTED" and tilted.message == "The jump from 0 to 1 does not map X into X."
    assert "Member 1 does not keep X" in kp.switched([[[0.5]], [[-0.5]]], chain=TWO_STEPS, discrete=True).message


TWO_STEPS = [["1/3", "2/3"], ["1/2", "1/2"]]


def test_rates():
    family = [[[-3]], [["1.4"]]]
    best = kp.switched(family, chain=TWO, rate="max").decay_rate
    assert best == pytest.approx(2.3 - np.sqrt(1.7**2 + 2)) and best > kp.switched(family, chain=TWO).decay_rate
    s = kp.switched(family, chain=TWO, rate="0.08")
    assert s and s.certificate.required_rate == Fraction(2, 25) and "exp(-2/25 t)" in s.explain()
    slow = kp.switched(family, chain=TWO, rate=1)
    assert slow.status == "REFUTED" and 0 < slow.witness.rate < 0.09 and "not go to 0 at the rate 1" in slow.explain()
    exactly = kp.switched([[["1/4"]], [["1/4"]]], chain=TWO_STEPS, discrete=True, rate="3/4")
    assert exactly and exactly.certificate.required_rate == Fraction(3, 4)


def test_a_rate_that_is_neither_proven_nor_refuted_leaves_stability_proven():
    """Jordan blocks decay slower than any exponential of their eigenvalue, by every v."""
    s = kp.switched([[[-1, 1], [0, -1]]] * 2, chain=TWO, rate=1)
    assert s.status == "UNDECIDED" and s.others[0] and 0 < s.decay_rate < 1 and "not at the rate" in s.explain()


def test_rows_are_completed_or_refused():
    s = kp.switched([[[-3]], [[-1]]], chain=[[-0.1 - 0.2, 0.3], [0.7, -0.7]])
    assert [sum(row) for row in s.certificate.chain.fractions()] == [0, 0]
    assert s.certificate.chain.fractions()[0, 1] == Fraction(0.3)
    s = kp.switched([[[0.5]]] * 3, chain=[[0.1, 0.2, 0.7], [0.3, 0.6, 0.1], [1, 0, 0]], discrete=True)
    assert s and [sum(row) for row in s.certificate.chain.fractions()] == [1, 1, 1]


@pytest.mark.parametrize(
    ("more", "error", "message"),
    [
        (
            {"chain": [[-1, 1], [2, -1]]},
            kp.DataError,
            "row 1 of chain sums to 1; the rates of a row must sum to 0, with",
        ),
        ({"chain": [[1, -1], [0, 0]]}, kp.DataError, r"chain\[0, 1\] is -1; a rate between members"),
        ({"chain": [[0.5, 0.4], [0, 1]], "discrete": True}, kp.DataError, "sums to 0.9; the probabilities"),
        (
            {"chain": [[-1, 2], [0, 1]], "discrete": True},
            kp.DataError,
            r"chain\[0, 0\] is -1; a probability .* continuous",
        ),
        ({"chain": [[0.7, 0.3], [0.1, 0.9]]}, kp.DataError, "row 0 of chain sums to 1; .* in discrete time"),
        ({"chain": [[0]]}, kp.ShapeError, "chain is 1 x 1, but must be 2 x 2"),
        ({"jumps": {(0, 1): [[1]]}}, kp.DataError, "jumps belong to a chain"),
        ({"chain": TWO, "jumps": {(0, 2): [[1]]}}, kp.DataError, r"jumps has the key \(0, 2\); give pairs"),
        ({"chain": TWO, "jumps": {(0, 0): [[2]]}}, kp.DataError, r"jumps\[0, 0\] is not the identity"),
        ({"chain": TWO, "jumps": {(0, 1): [[1, 2]]}}, kp.ShapeError, r"jumps\[0, 1\] is 1 x 2, but must be 1 x 1"),
        ({"chain": TWO, "jumps": [[[[1]]]]}, kp.ShapeError, "jumps has length 1; there must be 2 x 2 matrices"),
        ({"chain": TWO, "jumps": []}, kp.ShapeError, "jumps has length 0; there must be 2 x 2 matrices"),
        ({"chain": TWO, "jumps": [[None], [None]]}, kp.ShapeError, r"jumps\[0\] has length 1"),
        ({"chain": TWO, "jumps": {(False, True): [[1]]}}, kp.DataError, r"jumps has the key \(False, True\)"),
        ({"chain": TWO, "jumps": 3}, kp.DataError, "jumps is"),
        ({"chain": TWO, "rate": "fast"}, kp.DataError, "rate"),
        ({"rate": "max"}, kp.DataError, 'rate="max" belongs to a chain'),
        ({"chain": TWO_STEPS, "rate": 1, "discrete": True}, kp.DataError, "rate is 1; in discrete time"),
    ],
)
def test_bad_input_is_refused(more, error, message):
    with pytest.raises(error, match=message):
        kp.switched([[[0.5]], [[0.25]]], **more)


@pytest.mark.parametrize("discrete", [False, True])
def test_sparse_members_of_thousands_of_states(discrete):
    rng = np.random.default_rng(0)
    n, count = 2000, 4
    family = [sp.random_array((n, n), density=3 / n, rng=rng) for _ in range(count)]
    family = [A / 8 if discrete else A - sp.diags_array(rng.uniform(2, 4, n)) for A in family]
    chain, jumps = (
        random_chain(rng, count, discrete),
        {(0, 1): sp.diags_array(rng.random(n)), (2, 3): 1.5 * sp.eye_array(n)},
    )
    s = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete)
    assert s and s.check() and s.decay_rate > 0 and s.vs.shape == (count, n)
    best = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete, rate="max")
    assert best.check() and best.decay_rate > s.decay_rate
    half = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete, rate=Fraction(best.decay_rate) / 2)
    assert half and half.certificate.required_rate == Fraction(best.decay_rate) / 2
    more = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete, rate=1.2 * best.decay_rate)
    assert more.status == "REFUTED" and more.check() and more.witness.rate > best.decay_rate
    family = [A * 8 if discrete else A + 4 * sp.eye_array(n) for A in family]
    s = kp.switched(family, chain=chain, jumps=jumps, discrete=discrete)
    assert s.status == "REFUTED" and s.check()


def test_changed_certificates_prove_nothing():
    proof = kp.switched([[[-3]], [["1.4"]]], chain=TWO, jumps={(0, 1): [["9/10"]]}, rate="max").certificate
    changes = [
        {"vs": -proof.vs},
        {"vs": Matrix(np.ones((2, 1)))},
        {"chain": Matrix(np.array([[-2.0, 2.0], [1.0, -1.0]]))},
        {"decay_rate": 2 * proof.decay_rate},
        {"required_rate": Fraction(1, 2)},
        {"jumps": (kp.state_positivity([[5]], kp.orthant(1), discrete=True),)},
        {"loops": proof.loops[::-1]},
    ]
    for change in changes:
        assert not type(proof).settle(**proof.data() | change), change
        assert not replace(proof, **change).check(), change
    for change in ({"between": (0, 2)}, {"between": (0, 0)}, {"between": ()}, {"chain": Matrix(np.eye(2))}):
        with pytest.raises(kp.DataError):
            type(proof).settle(**proof.data() | change)
    refuted = kp.switched([[[-3]], [[2]]], chain=TWO).certificate
    w = refuted.witness
    for changed in (replace(w, vectors=-w.vectors), replace(w, vectors=Matrix(np.array([[1.0], [0.0]])))):
        assert type(refuted).settle(**refuted.data() | {"witness": changed}).status == "UNDECIDED"
    with pytest.raises(kp.DataError, match="not negative"):
        type(refuted).settle(**refuted.data() | {"witness": replace(w, rate=-1.0)})


# -- links that are lost at random


def test_lost_links_are_one_averaged_network():
    """Each link is lost with probability 1/4, anew at every step: the mean obeys the network with 3/4 W."""
    node = kp.ConeStateSpace([[0.5]], [[1]], [[1]], 0, True)
    ring = np.roll(np.eye(4), 1, axis=0)
    for strength, stable in ((0.6, True), (0.7, False)):
        net = kp.feedback_interconnect([node] * 4, 0.75 * strength * ring)
        assert bool(net.certificate) == stable
        some = [kp.feedback_interconnect([node] * 4, strength * ring * row) for row in np.ndindex(2, 2, 2, 2)]
        odds = [0.75 ** sum(row) * 0.25 ** (4 - sum(row)) for row in np.ndindex(2, 2, 2, 2)]
        s = kp.switched(some, chain=[odds] * 16)
        assert s.status.name == ("PROVED" if stable else "REFUTED")


def test_losses_that_last_are_worse():
    node = kp.ConeStateSpace([["0.9"]], [[1]], [[1]], 0, True)
    nets = [kp.feedback_interconnect([node] * 2, [[0, w], [w, 0]]) for w in (0.2, 0)]
    quick, lasting = [["1/3", "2/3"], ["1/3", "2/3"]], [["0.9", "0.1"], ["0.05", "0.95"]]
    assert kp.switched(nets, chain=quick) and kp.switched(nets, chain=lasting).status == "REFUTED"
    assert kp.feedback_interconnect([node] * 2, [[0, 0.0667], [0.0667, 0]]).certificate


def test_with_feedthrough_the_averaged_network_does_not_decide():
    """x+ = x / 2 + 0.3 u, y = x + u, u = w y with w = 0.8 or 0: E w / (1 - w) = 2 is not 0.4 / 0.6."""
    node = kp.ConeStateSpace([[0.5]], [[0.3]], [[1]], [[1]], True)
    assert kp.feedback_interconnect([node], [[0.4]]).certificate
    nets = [kp.feedback_interconnect([node], [[w]]) for w in (0.8, 0)]
    assert kp.switched(nets, chain=[[0.5, 0.5]] * 2).status == "REFUTED"
