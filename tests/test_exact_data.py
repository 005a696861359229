"""What is typed is what is proven: data in fractions and text reach every certificate as they are.

1/3 is no double.  Where the rounding of a datum changes a verdict, the verdict is that of the datum.
"""

from fractions import Fraction

import control as ct
import numpy as np
import pytest

import control_kpos as kp
from control_kpos.systems.system import System

THIRD = Fraction(1, 3)
# a double eigenvalue 0.4, which rounding turns into a complex pair
TWICE = [["0.1", "0.3"], ["-0.3", "0.7"]]
# leaves the cone of (0.1, 0.3) and (0.3, 0.1) invariant with equality, which rounding breaks
EDGE = [["-31/40", "9/40"], ["-9/40", "-1/40"]]
EDGE_CONE = [["0.1", "0.3"], ["0.3", "0.1"]]


def plant(A, B=None, C=None, **more):
    n = len(A)
    B = [[1]] + [[0]] * (n - 1) if B is None else B
    C = [[1] + [0] * (n - 1)] if C is None else C
    return kp.ConeStateSpace(A, B, C, np.zeros((len(C), len(B[0]))), **more)


def fractions(rows):
    return [[Fraction(x) for x in row] for row in rows]


# -- the door


@pytest.mark.parametrize(
    "data",
    [
        System.read([["1/3"]]),
        plant([["1/3"]]),
        [["1/3"]],
        [[THIRD]],
        np.array([[THIRD]]),
        ([["1/3"]], [[1]]),
        ([["1/3"]], [[1]], [[1]], 0),
    ],
)
def test_the_door_keeps_what_is_given(data):
    assert System.read(data).A.fractions().tolist() == [[THIRD]]


def test_the_door_reads_doubles_of_python_control():
    read = System.read(ct.ss([[1 / 3]], [[1]], [[1]], 0, 0.5), X=[[-1]])
    assert read.A.fractions()[0, 0] == Fraction(1 / 3)
    assert read.discrete
    assert kp.PolyhedralCone([[-1]]) == read.X


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (ct.tf([1], [1, 1]), "transfer function"),
        ([[1, 2]], "1 x 2; it must be square"),
        (([[1]], [[1], [2]]), "A is 1 x 1, but B has 2 rows"),
        (([[1]], [[1]], [[1, 2]], 0), r"sys\[2\] is 1 x 2"),
        (([[1]], [[1]], [[1]], [[1, 2]]), r"sys\[3\] is 1 x 2"),
        ("fast", "no number|text"),
    ],
)
def test_the_door_says_what_does_not_fit(data, said):
    with pytest.raises(kp.KposError, match=said):
        System.read(data)


def test_a_cone_of_another_dimension_is_refused():
    with pytest.raises(kp.ConeMismatchError, match="X has dimension 2, but the system has 1 states"):
        System.read([[1]], X=kp.orthant(2))


def test_a_system_is_what_it_is_now():
    s = plant([["1/3"]])
    s.A = np.array([[0.5]])
    assert s.exact.A.fractions()[0, 0] == Fraction(1, 2)
    s = plant([["1/3"]])
    s.A[0, 0] = 0.25
    assert s.exact.A.fractions()[0, 0] == Fraction(1, 4)


# -- searches for cones


def test_cone_of_a_system_is_that_of_its_matrix():
    matrix, system = kp.find_cone(TWICE), kp.find_cone(plant(TWICE, [[0], [0]], [[0, 0]]))
    assert matrix.status is system.status is kp.Status.PROVED
    assert system.certificate.matrices.fractions()[0].tolist() == fractions(TWICE)
    # and it is the rounding that changes the verdict
    assert kp.find_cone(np.array(TWICE, dtype=float)).status is kp.Status.REFUTED


def test_cone_of_a_family_of_systems_is_that_of_its_matrices():
    A = [["-1", "1/3"], ["1/7", "-2"]]
    found = kp.find_cone([plant(A), plant(TWICE)])
    assert [m.tolist() for m in found.certificate.matrices.fractions()] == [fractions(A), fractions(TWICE)]


def test_cone_of_a_system_holds_exact_inputs_and_outputs():
    s = plant([[-1, 0], [0, -2]], [["1/3"], ["1/3"]], [["1/3", "-1/3"]], U=[["1/7"]], Y=[["1/7"]])
    found = kp.find_cone(s)
    vectors, normals = found.certificate.contains.fractions()[0], found.certificate.within.fractions()[0]
    assert vectors[0] == vectors[1]
    assert normals[0] == -normals[1]
    # the vector lies on the boundary of the half-space: their product is exactly 0, and rounding may make it negative
    assert found.certificate.status is kp.Status.PROVED


def test_contains_and_within_may_be_text():
    found = kp.find_cone([[-1, 0], [0, -2]], contains=[["1/3", "1/7"]], within=[["3", "-7"]])
    assert found.certificate.contains.fractions().tolist() == [[THIRD, Fraction(1, 7)]]
    assert found.certificate.within.fractions().tolist() == [[3, -7]]


# -- cone and feedback


def test_cone_and_feedback_are_about_the_plant():
    s = plant([["-1", "1/3"], ["1/7", "-2"]], [[1], [0]])
    design = kp.design_cone_and_feedback(s)
    F = [Fraction(x) for x in design.F[0].tolist()]
    loop = [[-1 + F[0], THIRD + F[1]], [Fraction(1, 7), Fraction(-2)]]
    assert design.certificate.A.fractions().tolist() == loop
    assert design.closed_loop.exact.A.fractions().tolist() == loop


def test_cone_and_feedback_are_about_the_vertices():
    A = [["-1", "1/3"], ["1/7", "-2"]], [["-1", "1/3"], ["1/7", "-7/3"]]
    design = kp.design_cone_and_feedback(plant(A[0]), vertices=[plant(A[0]), plant(A[1])])
    F = [Fraction(x) for x in design.F[0].tolist()]
    for a, loop in zip(A, design.certificate.loops, strict=True):
        first = [Fraction(x) for x in a[0]]
        assert loop.A.fractions().tolist() == [[first[0] + F[0], first[1] + F[1]], [Fraction(x) for x in a[1]]]


# -- differential positivity


def test_jacobian_of_a_system_is_exact():
    X = kp.PolyhedralCone(EDGE_CONE)
    assert kp.differential_positivity(EDGE, X)
    certificate = kp.differential_positivity(plant(EDGE), X)
    assert certificate
    assert certificate.centres.fractions()[0].tolist() == fractions(EDGE)
    assert not kp.differential_positivity(np.array([[-31 / 40, 9 / 40], [-9 / 40, -1 / 40]]), X)


# -- operations


S = plant([["-1/3"]])


@pytest.mark.parametrize(
    ("result", "expected"),
    [
        (lambda: S * THIRD, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: THIRD * S, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: S / 3, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: S / Fraction(3), ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: S + THIRD, ([[-THIRD]], [[1]], [[1]], [[THIRD]])),
        (lambda: THIRD + S, ([[-THIRD]], [[1]], [[1]], [[THIRD]])),
        (lambda: S * np.array([[THIRD]]), ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: np.array([[THIRD]]) * S, ([[-THIRD]], [[1]], [[THIRD]], [[0]])),
        (lambda: S.feedback([["1/3"]], sign=1), ([[0]], [[1]], [[1]], [[0]])),
        (lambda: S.feedback(1, sign="1/3"), ([[0]], [[1]], [[1]], [[0]])),
        (lambda: S.feedback(S, sign="1/3"), ([[-THIRD, THIRD], [1, -THIRD]], [[1], [0]], [[1, 0]], [[0]])),
        (lambda: S.similarity_transform([["1/3"]]), ([[-THIRD]], [[THIRD]], [[3]], [[0]])),
        (lambda: S.similarity_transform([[1]], timescale="1/3"), ([[-1]], [[3]], [[1]], [[0]])),
        (lambda: kp.ConeStateSpace(S), ([[-THIRD]], [[1]], [[1]], [[0]])),
        (lambda: S.copy(), ([[-THIRD]], [[1]], [[1]], [[0]])),
    ],
)
def test_operations_keep_what_is_given(result, expected):
    s = result()
    assert isinstance(s, kp.ConeStateSpace)
    assert [m.fractions().tolist() for m in s.exact.matrices] == [fractions(rows) for rows in expected]


def test_exact_feedback_decides_at_the_margin():
    """-1/3 + 1/3 = 0 is not stable; with the double next to 1/3 it would be."""
    assert S.feedback(1, sign="1/3").linear_lyapunov().status is kp.Status.REFUTED
    assert S.feedback(1, sign=1 / 3).linear_lyapunov().status is kp.Status.PROVED


def test_node_of_the_paper_is_exact():
    node = kp.examples.mass_spring_node(["-64/3", "-13"], k="1/3", m="7/3")
    assert node.exact.A.fractions().tolist() == [[0, 1], [Fraction(-64, 3) - Fraction(1, 7), -13]]
