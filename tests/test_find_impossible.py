"""Proofs that no cone exists: Jordan chains on the circle, impulse responses that dip below zero."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from planted import similar
from scipy.linalg import block_diag

import control_kpos as kp
from control_kpos import checker, find_cone
from control_kpos.find.impossible.jordan_index import IndexObstruction


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
    assert cert.check() and "eigenvalue -1 " in found.explain()
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
        {"real": 0.9},
        {"radius": 2.0},
        {"matrix": 1},
        {"functional": w.functional[:, :2]},
    ):
        assert not replace(cert, witness=replace(w, **change)).check()
    assert not replace(cert, discrete=False).check()
    # the eigenvalue that is named is the one with longer chains: i and -1 both have the power 4
    both = find_cone(block_diag(1, [[-1, 1], [0, -1]], QUARTER), discrete=True)
    assert both.status is kp.Status.REFUTED and "eigenvalue -1 " in both.explain()
    assert not replace(both.certificate, witness=replace(both.obstruction, real=0.0, imag=1.0, order=4)).check()


def test_longer_chains_of_a_member_and_with_ports():
    longer = [[1, 0, 0], [0, -1, 1], [0, 0, -1]]
    family = find_cone([np.eye(3), longer], discrete=True)
    assert family.status is kp.Status.REFUTED and "of matrix 1" in family.explain() and family.check()
    ports = find_cone(longer, contains=[[1, 0, 0]], within=[[1, 0, 0]], discrete=True)
    assert ports.status is kp.Status.REFUTED and ports.check()
    assert find_cone(longer).status is not kp.Status.REFUTED  # in continuous time -1 is no rival of 1
