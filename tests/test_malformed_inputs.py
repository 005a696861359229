"""Malformed inputs to every public function: a typed error that names the argument, never a wrong answer."""

from decimal import Decimal
from fractions import Fraction

import certified
import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp

X2, LINE = kp.orthant(2), kp.orthant(1)
GOOD = [[-2.0, 1.0], [1.0, -2.0]]
nan, inf = float("nan"), float("inf")


def broken_sparse():
    matrix = sp.csr_array(np.eye(2))
    matrix.indices = np.array([0, 7], dtype=matrix.indices.dtype)
    return matrix


MATRICES = {  # no 2 x 2 matrix of finite real numbers
    "NaN": [[nan, 1], [1, -2]],
    "infinity": [[-2, inf], [1, -2]],
    "minus infinity": [[-inf, 1], [1, -2]],
    "complex": [[-2 + 1j, 1], [1, -2]],
    "complex in objects": np.array([[-2, 1j], [1, -2]], dtype=object),
    "text": [["a", "b"], ["c", "d"]],
    "an expression": [["1+1", "0"], ["0", "1"]],
    "a division by zero": [["1/0", "1"], ["1", "1"]],
    "text that says nan": [["nan", "1"], ["1", "1"]],
    "None": None,
    "None inside": [[None, 1], [1, 1]],
    "a dictionary": {"A": 1},
    "a set": {1, 2},
    "a function": len,
    "dates": np.array([["2020-01-01", "2020-01-02"]] * 2, dtype="datetime64[D]"),
    "bytes that are no number": [[b"x", b"y"], [b"z", b"w"]],
    "empty": [],
    "empty rows": [[], []],
    "0 x 0": np.zeros((0, 0)),
    "a number": 3.0,
    "a vector": [1.0, 2.0],
    "not square": [[1, 2, 3], [4, 5, 6]],
    "too large": np.eye(3),
    "three dimensions": np.zeros((2, 2, 2)),
    "ragged": [[1, 2], [3]],
    "ragged deeper": [[[1], 2], [3, 4]],
    "masked": np.ma.array([[1.0, 2.0], [3.0, 4.0]], mask=[[True, False], [False, False]]),
    "a NaN of Decimal": [[Decimal("NaN"), 0], [0, 1]],
    "an infinite Decimal": [[Decimal("Infinity"), 0], [0, 1]],
    "sparse with NaN": sp.csr_array([[nan, 1.0], [1.0, 1.0]]),
    "sparse complex": sp.csr_array([[1j, 1.0], [1.0, 1.0]]),
    "sparse and too large": sp.eye_array(5),
    "sparse out of range": broken_sparse(),
    "a huge fraction": [[Fraction(10) ** 400, 0], [0, 1]],
}
USES = {
    "state_positivity": lambda M: kp.state_positivity(M, X2),
    "linear_lyapunov": lambda M: kp.linear_lyapunov(M, X2),
    "cone_positivity": lambda M: kp.cone_positivity(M, [[1], [0]], [[1, 0]], [[0]], X2, LINE, LINE),
    "dissipativity": lambda M: kp.dissipativity(M, [[1], [0]], [[1, 0]], [[0]], X2, LINE, LINE),
    "induced_gain": lambda M: kp.induced_gain(M, [[1], [0]], [[1, 0]], [[0]], X2, LINE, LINE),
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("name", MATRICES)
def test_matrices(name, use):
    with pytest.raises(kp.KposError) as caught:
        USES[use](MATRICES[name])
    assert "A" in str(caught.value)


RAYS = {
    "NaN": [[nan, 1], [1, 0]],
    "infinite": [[inf, 1], [1, 0]],
    "complex": [[1j, 1], [1, 0]],
    "text": [["a", "b"]],
    "empty": [],
    "empty rows": [[]],
    "a zero row": [[1, 0], [0, 0]],
    "ragged": [[1, 0], [1]],
    "three dimensions": np.ones((1, 2, 2)),
    "None": None,
    "masked": np.ma.array([[1.0, 2.0]], mask=[[True, False]]),
}


@pytest.mark.parametrize("make", [kp.PolyhedralCone, kp.PolyhedralCone.from_facets], ids=["rays", "normals"])
@pytest.mark.parametrize("name", RAYS)
def test_cones(name, make):
    with pytest.raises(kp.KposError):
        make(RAYS[name])


IMPROPER = {
    "a line": [[1, 0], [-1, 0], [0, 1]],
    "a half-plane of lines": [[1, 0], [-1, 0]],
    "flat": [[1, 0]],
    "everything": [[1, 0], [-1, 0], [0, 1], [0, -1]],
    "nearly flat the wrong way": [[1, 0], [-1, 0], [1e-300, 1]],
    "doubled ray": [[1, 1], [2, 2]],
}


@pytest.mark.parametrize("name", IMPROPER)
def test_improper_cones_are_refused_by_name(name):
    cone = kp.PolyhedralCone(IMPROPER[name])
    for use in (kp.state_positivity, kp.linear_lyapunov):
        with pytest.raises(kp.NotProperConeError, match=r"X is not (pointed|solid)"):
            use(GOOD, cone)
    with pytest.raises(kp.NotProperConeError):
        kp.ConeStateSpace(GOOD, [[1], [0]], [[1, 0]], [[0]], X=cone)


OTHERS = {
    "orthant of size 0": lambda: kp.orthant(0),
    "orthant of negative size": lambda: kp.orthant(-1),
    "orthant of size 1.5": lambda: kp.orthant(1.5),
    "orthant of size True": lambda: kp.orthant(True),
    "orthant of text": lambda: kp.orthant("2"),
    "product of nothing": lambda: kp.product([]),
    "product of numbers": lambda: kp.product([1, 2]),
    "transform of the wrong size": lambda: X2.transform([[1, 2, 3]]),
    "transform with NaN": lambda: X2.transform([[nan, 2]]),
    "contains of the wrong size": lambda: X2.contains([1, 2, 3]),
    "contains NaN": lambda: X2.contains([nan, 1]),
    "contains text": lambda: X2.contains("x"),
    "contains another dimension": lambda: X2.contains(LINE),
    "intersection of dimensions": lambda: X2 & LINE,
    "sum of dimensions": lambda: X2 + LINE,
    "lorentz of size 0": lambda: kp.lorentz(0, facets=4),
    "lorentz of an unknown kind": lambda: kp.lorentz(3, facets=8, kind="middle"),
    "unknown rate": lambda: kp.linear_lyapunov(GOOD, X2, rate="min"),
    "B of the wrong size": lambda: kp.cone_positivity(GOOD, [[1]], [[1, 0]], [[0]], X2, LINE, LINE),
    "C of the wrong size": lambda: kp.cone_positivity(GOOD, [[1], [0]], [[1]], [[0]], X2, LINE, LINE),
    "D of the wrong size": lambda: kp.cone_positivity(GOOD, [[1], [0]], [[1, 0]], [[0, 0]], X2, LINE, LINE),
    "q of the wrong size": lambda: kp.dissipativity([[-1]], [[1]], [[1]], [[0]], LINE, LINE, LINE, q=[1, 2]),
    "r with NaN": lambda: kp.dissipativity([[-1]], [[1]], [[1]], [[0]], LINE, LINE, LINE, r=[nan]),
    "unknown norm": lambda: kp.induced_gain([[-1]], [[1]], [[1]], [[0]], LINE, LINE, LINE, norm="H2"),
    "weight outside": lambda: kp.induced_gain([[-1]], [[1]], [[1]], [[0]], LINE, LINE, LINE, e=[-1]),
    "gain of what is not positive": lambda: kp.induced_gain([[-1]], [[-1]], [[1]], [[0]], LINE, LINE, LINE),
    "system with NaN": lambda: kp.ConeStateSpace([[nan]], [[1]], [[1]], [[0]]),
    "system with infinity": lambda: kp.ConeStateSpace([[-1]], [[inf]], [[1]], [[0]]),
    "complex system": lambda: kp.ConeStateSpace([[1j]], [[1]], [[1]], [[0]]),
    "cone of the wrong size": lambda: kp.ConeStateSpace([[-1]], [[1]], [[1]], [[0]], X=X2),
    "nodes of nothing": lambda: kp.feedback_interconnect([], np.zeros((0, 0))),
    "coupling of the wrong size": lambda: kp.feedback_interconnect(certified.mass_springs(3), np.eye(4)),
    "coupling with NaN": lambda: kp.feedback_interconnect(certified.mass_springs(2), [[0, nan], [1, 0]]),
    "coupling of text": lambda: kp.feedback_interconnect(certified.mass_springs(2), [["a", "b"], ["c", "d"]]),
    "nodes that are numbers": lambda: kp.feedback_interconnect([1, 2], np.eye(2)),
    "a stack of NaN": lambda: kp.stack(A=[[[nan]]], B=[[1]], C=[[1]]),
    "a stack that is not square": lambda: kp.stack(A=np.zeros((2, 2, 3)), B=np.zeros((2, 1)), C=np.zeros((1, 2))),
    "supply rates of the wrong number": lambda: kp.feedback_interconnect(
        certified.mass_springs(3), kp.examples.ring(3), supply_rates=[([-1], [1])]
    ),
    "find_cone of NaN": lambda: kp.find_cone([[nan]]),
    "find_cone of what is not square": lambda: kp.find_cone([[1, 2]]),
    "find_cone of complex": lambda: kp.find_cone([[1j]]),
    "find_cone of nothing": lambda: kp.find_cone([]),
    "state_feedback of a matrix": lambda: kp.state_feedback(GOOD),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_arguments(name):
    with pytest.raises((kp.KposError, TypeError)) as caught:
        OTHERS[name]()
    assert len(str(caught.value)) > 10


GOOD_ENTRIES = {  # unusual, but numbers
    "float32": np.array(GOOD, dtype=np.float32),
    "integers": [[-2, 1], [1, -2]],
    "int8": np.array([[-2, 1], [1, -2]], dtype=np.int8),
    "big integers": [[-(2**70), 1], [1, -(2**70)]],
    "long doubles": np.array(GOOD, dtype=np.longdouble),
    "decimals": [[Decimal("-2.1"), 1], [1, Decimal("-2.1")]],
    "fractions": [[Fraction(-7, 3), 1], [1, Fraction(-7, 3)]],
    "text": [["-2.5", "1/3"], ["1", "-2"]],
    "negative zeros": [[-2.0, -0.0], [-0.0, -2.0]],
    "subnormal": [[-2.0, 5e-324], [0.0, -2.0]],
    "Fortran order": np.asfortranarray(GOOD),
    "sparse": sp.csr_array(np.array(GOOD)),
    "sparse with duplicates": sp.coo_array(
        ([-1.0, -1.0, -2.0, 1.0, 1.0], ([0, 0, 1, 0, 1], [0, 0, 1, 1, 0])), shape=(2, 2)
    ),
    "sparse with explicit zeros": sp.csr_array(([-2.0, 0.0, -2.0], [0, 1, 1], [0, 2, 3]), shape=(2, 2)),
    "unmasked": np.ma.array(GOOD, mask=False),
}


@pytest.mark.parametrize("name", GOOD_ENTRIES)
def test_unusual_numbers_are_numbers(name, tmp_path):
    certificate = kp.linear_lyapunov(GOOD_ENTRIES[name], X2)
    assert certificate and certificate.check()
    certificate.save(tmp_path / "file.json")
    assert kp.load_certificate(tmp_path / "file.json")
