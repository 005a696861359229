"""Proofs that no cone exists: Jordan chains on the circle, impulse responses that dip below zero."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from planted import similar
from scipy.linalg import block_diag, expm

import control_kpos as kp
from control_kpos import checker, find_cone
from control_kpos.exact.linalg import solve_columns
from control_kpos.find.impossible.jordan_index import IndexObstruction
from control_kpos.find.impossible.response import ExponentialObstruction, SeriesObstruction


def chain(block, length):
    """A Jordan chain of a block, as a matrix of integers."""
    block = np.atleast_2d(block)
    return np.kron(np.eye(length, dtype=int), block) + np.kron(
        np.eye(length, k=1, dtype=int), np.eye(len(block), dtype=int)
    )


QUARTER, THIRD = [[0, -1], [1, 0]], [[0, -1], [1, -1]]
ROOT, TURNED_ROOT = [[0, 2], [1, 0]], [[0, -2], [1, 0]]  # +-sqrt(2), and i times that
SILVER = [[1, 2], [1, 1]]  # 1 +- sqrt(2)
TURNED_SILVER = [[0, 0, 0, -1], [1, 0, 0, 0], [0, 1, 0, -6], [0, 0, 1, 0]]  # i times these
LONGER = {
    "-1 in a chain of two": (chain(1, 1), chain(-1, 2)),
    "a quarter of a turn": (chain(1, 1), chain(QUARTER, 2)),
    "a third of a turn": (chain(1, 1), chain(THIRD, 2)),
    "three and two": (chain(1, 2), chain(-1, 3)),
    "three and two, turned": (chain(1, 2), chain(QUARTER, 3)),
    "one and one, and three": (chain(1, 1), chain(1, 1), chain(-1, 1), chain(-1, 3)),
    "longer ones inside": (2 * chain(1, 1), chain(-2, 2), chain(1, 3)),
    "an irrational radius": (chain(ROOT, 1), chain(TURNED_ROOT, 2)),
    "irrational powers": (chain(SILVER, 1), chain(TURNED_SILVER, 2)),
}


@pytest.mark.parametrize("name", LONGER)
@pytest.mark.parametrize("scale", [Fraction(1), Fraction(2, 7)])
def test_longer_jordan_chains_on_the_circle_exclude_a_cone(name, scale, tmp_path):
    whole = block_diag(*LONGER[name])
    for A in (whole.astype(object), np.array(similar(whole, 1), dtype=object)):
        found = find_cone((A * scale).tolist(), discrete=True)
        assert found.status is kp.Status.REFUTED and found.check() and "longer Jordan chains" in found.explain()
        found.save(tmp_path / "none.json")
        assert kp.load_certificate(tmp_path / "none.json").status is kp.Status.REFUTED
        assert checker.main(tmp_path / "none.json") == 1


@pytest.mark.parametrize(
    "blocks",
    [
        (chain(1, 1), chain(-1, 1)),
        (chain(1, 2), chain(-1, 2)),
        (chain(1, 3), chain(-1, 2)),
        (chain(1, 2), chain(QUARTER, 1)),
        (chain(2, 1), chain(-1, 2)),
        (chain(1, 1), chain(1, 2), chain(-1, 2)),
        (chain(ROOT, 2),),
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_chains_that_are_not_longer_exclude_none(blocks, seed):
    """The spectral radius has the longest chains of its circle: cones exist, whether this search finds them or not."""
    assert find_cone(similar(block_diag(*blocks), seed), discrete=True).status is not kp.Status.REFUTED
    whole = block_diag(*blocks).astype(float)
    x = kp.find_cone([[1, 0, 0], [0, -1, 1], [0, 0, -1]], discrete=True).obstruction.start
    n = len(whole)
    ones = type(x)(np.arange(1.0, n + 1)[None])
    for order, index, bound in ((2, 1, "1/2"), (4, 1, "1/2"), (2, 2, "1/2"), (2, 1, "1")):
        witness = IndexObstruction(0, Fraction(bound), index, order, ones, ones, 1.0, -1.0, 0.0)
        assert not witness.conditions(type(x)(whole[None]), discrete=True)[0].verdict()


def test_a_changed_witness_of_longer_chains_fails():
    found = find_cone([[1, 0, 0], [0, -1, 1], [0, 0, -1]], discrete=True)
    cert, w = found.certificate, found.obstruction
    assert cert.check() and "eigenvalue (computed: -1) " in found.explain()
    harmless = {"bound": Fraction(0), "order": 4}
    for name, value in harmless.items():
        assert replace(cert, witness=replace(w, **{name: value})).check()
    for change in (
        {"index": 2},
        {"index": 4},
        {"order": 3},
        {"order": 0},
        {"bound": Fraction(1)},
        {"bound": Fraction(-1, 2)},
        {"matrix": 1},
        {"functional": w.functional[:, :2]},
    ):
        assert not replace(cert, witness=replace(w, **change)).check()
    assert not replace(cert, discrete=False).check()
    # the eigenvalue that is named is the one with longer chains, although i and -1 both have the power 4
    both = find_cone(block_diag(1, [[-1, 1], [0, -1]], QUARTER), discrete=True)
    assert both.status is kp.Status.REFUTED and "eigenvalue (computed: -1) " in both.explain()
    other = find_cone(block_diag(1, -1, chain(QUARTER, 2)), discrete=True)
    assert other.status is kp.Status.REFUTED and "(computed: 0 ± 1i)" in other.explain()


def test_longer_chains_of_a_member_and_with_ports():
    longer = [[1, 0, 0], [0, -1, 1], [0, 0, -1]]
    family = find_cone([np.eye(3), longer], discrete=True)
    assert family.status is kp.Status.REFUTED and "of matrix 1" in family.explain() and family.check()
    ports = find_cone(longer, contains=[[1, 0, 0]], within=[[1, 0, 0]], discrete=True)
    assert ports.status is kp.Status.REFUTED and ports.check()
    assert find_cone(longer).status is not kp.Status.REFUTED  # in continuous time -1 is no rival of 1


# -- between vectors and half-spaces

THREE = [[-1, 0, 0], [0, -2, 0], [0, 0, -3]]


def refuted(found, path):
    """A "no" that the package, a file and the checker agree about."""
    assert found.status is kp.Status.REFUTED and found.check()
    found.save(path)
    assert kp.load_certificate(path).status is kp.Status.REFUTED and checker.main(path) == 1
    return found.obstruction


@pytest.mark.parametrize("c", ["0.2", "0.247", "0.249", "0.2499", "0.249999", "0.24999999999999999999"])
@pytest.mark.parametrize("scale", [1, "1/7", 30])
def test_a_response_below_zero_by_any_amount(c, scale, tmp_path):
    """c e^(-t) - e^(-2t) + e^(-3t) is (c - 1/4) / 2 at t = ln 2."""
    A = np.array(THREE, dtype=object) * Fraction(scale)
    refuted(find_cone(A.tolist(), contains=[[1, 1, 1]], within=[[c, -1, 1]]), tmp_path / "none.json")
    turned, T = np.array(similar(np.array(THREE), 3), dtype=object), transformation(3)
    row = solve_columns(T.T, np.array([[Fraction(c)], [Fraction(-1)], [Fraction(1)]], dtype=object))[:, 0]
    found = find_cone(
        (turned * Fraction(scale)).tolist(), contains=[(T @ np.ones(3, dtype=int)).tolist()], within=[row.tolist()]
    )
    refuted(found, tmp_path / "none.json")


def transformation(seed):
    """The T of `similar` for three states."""
    T = np.random.default_rng(seed).integers(-2, 3, (3, 3))
    assert abs(np.linalg.det(T)) > 0.5
    return np.array([[Fraction(int(x)) for x in row] for row in T], dtype=object)


DIPS = {
    "a pair": ([[-1, 0, 0], [0, "-1.05", -2], [0, 2, "-1.05"]], [1, 1, 0], ["0.9", 1, 0]),
    "a pair, just": ([[-1, 0, 0], [0, "-1.05", -2], [0, 2, "-1.05"]], [1, 1, 0], ["0.924", 1, 0]),
    "a repeated eigenvalue": (
        [[-1, 0, 0], [0, -2, 1], [0, 0, -2]],
        [1, 0, 1],
        ["0.3678", -1, 0],
    ),  # e^(-t) (.3678 - t e^(-t))
    "irrational eigenvalues": ([[-3, 2, 0], [1, -3, 0], [0, 0, -2]], [1, 0, 1], ["1.2", "-1.13", -1]),
}


@pytest.mark.parametrize("name", DIPS)
def test_responses_below_zero_of_any_spectrum(name, tmp_path):
    A, b, c = DIPS[name]
    witness = refuted(find_cone(A, contains=[b], within=[c]), tmp_path / "none.json")
    matrix, row = np.array(A, dtype=float), np.array(c, dtype=float)
    if isinstance(witness, SeriesObstruction):
        assert row @ expm(matrix * float(witness.time)) @ np.array(b, dtype=float) < 0


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("unit", [1, "1/3", 5])
def test_a_response_that_touches_zero_has_no_polyhedral_cone(turn, unit, tmp_path):
    """c = 1/4: zero at t = ln 2 / unit and nowhere else; with 0.26 there is a cone."""
    A = (np.array(THREE, dtype=object) * Fraction(unit)).tolist()
    b, c = [1, turn, 1], ["1/4", -turn, 1]
    found = find_cone(A, contains=[b], within=[c])
    witness = refuted(found, tmp_path / "none.json")
    assert f"zero near t = {np.log(2) / float(Fraction(unit)):.3g}" in found.explain()
    assert witness.low < Fraction(1, 2) < witness.high
    assert find_cone(A, contains=[b], within=[["0.26", -turn, 1]])
    hidden = block_diag(THREE, [[-1, 1], [0, -1]])  # what the response does not see may be defective
    found = find_cone(hidden, contains=[[1, turn, 1, 0, 0]], within=[[0.25, -turn, 1, 0, 0]])
    assert found.status is kp.Status.REFUTED and isinstance(found.obstruction, ExponentialObstruction)


def test_changed_witnesses_of_responses_fail():
    below = find_cone(THREE, contains=[[1, 1, 1]], within=[["0.2499", -1, 1]]).certificate
    touching = find_cone(THREE, contains=[[1, 1, 1]], within=[["1/4", -1, 1]]).certificate
    series, exponential = below.witness, touching.witness
    assert isinstance(series, SeriesObstruction) and isinstance(exponential, ExponentialObstruction)
    for change in (
        {"time": Fraction(-1)},
        {"time": Fraction(2)},
        {"terms": 1},
        {"terms": 5},
        {"normal": -series.normal},
    ):
        assert not replace(below, witness=replace(series, **change)).check()
    for change in (
        {"low": Fraction(51, 100), "high": Fraction(52, 100)},
        {"low": Fraction(0), "high": Fraction(1)},  # no time can be told
        {"high": Fraction(1, 2)},
        {"rates": exponential.rates[::-1]},
        {"weights": tuple(2 * r for r in exponential.weights)},
        {"weights": ()},
        {"normal": series.normal},
    ):
        assert not replace(touching, witness=replace(exponential, **change)).check()
    for certificate in (below, touching):
        assert not replace(certificate, discrete=True).check()


def test_a_response_below_zero_late_in_discrete_time(tmp_path):
    """c - q + q^2 with q = (1 - s)^k, nearly: below zero where q is near 1/2, which is after ln 2 / s steps."""
    for s, c in (("0.01", "0.2499"), ("0.001", "0.24999"), ("0.0005", "0.249999")):
        poles = [1, 1 - Fraction(s), (1 - Fraction(s)) ** 2]
        A = [[poles[i] if i == j else 0 for j in range(3)] for i in range(3)]
        witness = refuted(
            find_cone(A, contains=[[1, 1, 1]], within=[[c, -1, 1]], discrete=True), tmp_path / "none.json"
        )
        assert abs(witness.power * float(s) - np.log(2)) < 0.05


@pytest.mark.parametrize("c", [0.25, "0.25000001"])
def test_a_response_that_comes_close_to_zero_is_named_where_there_is_no_answer(c):
    """In rounded coordinates nobody knows whether it touches; far from zero nothing is said."""
    T = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    A = T @ np.array(THREE) @ T.T if c == 0.25 else THREE
    b, row = (T @ np.ones(3), T @ [c, -1, 1]) if c == 0.25 else ([1, 1, 1], [c, -1, 1])
    found = find_cone(A, contains=[b], within=[row])
    assert found.status is kp.Status.UNDECIDED and "Computed: the impulse response" in found.message
    assert "near t = 0.693." in found.message
