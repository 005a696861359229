"""Values that are nobody's idea of an argument, and valid calls of every public function to put them into."""

from decimal import Decimal
from fractions import Fraction

import control as ct
import networkx as nx
import numpy as np
import scipy.sparse as sp

import control_kpos as kp

nan, inf = float("nan"), float("inf")


class Hostile:
    """Answers to every question with an error of its own."""

    def __getattr__(self, name):
        raise RuntimeError("no attributes")


class NoArray:
    def __array__(self, *_, **__):
        raise RuntimeError("no array")


class LyingLength(list):
    def __len__(self):
        return 10**9


def recursive():
    out = []
    out.append(out)
    return out


def broken_sparse():
    matrix = sp.csr_array(np.eye(2))
    matrix.indices = np.array([0, 7], dtype=matrix.indices.dtype)
    return matrix


VALUES = {
    "None": lambda: None,
    "True": lambda: True,
    "False": lambda: False,
    "zero": lambda: 0,
    "minus one": lambda: -1,
    "one and a half": lambda: 1.5,
    "NaN": lambda: nan,
    "infinity": lambda: inf,
    "minus infinity": lambda: -inf,
    "imaginary": lambda: 1j,
    "tiny": lambda: 1e-320,
    "huge": lambda: 1e308,
    "a huge integer": lambda: 10**30,
    "an integer that is no double": lambda: 10**400,
    "a huge negative integer": lambda: -(10**30),
    "a fraction that is no double": lambda: Fraction(10) ** 400,
    "a decimal NaN": lambda: Decimal("NaN"),
    "a signalling NaN": lambda: Decimal("sNaN"),
    "text": lambda: "x",
    "empty text": lambda: "",
    "text of numpy": lambda: np.str_("max"),
    "text with a zero byte": lambda: "a\0b",
    "bytes": lambda: b"x",
    "an object": object,
    "an ellipsis": lambda: ...,
    "a function": lambda: len,
    "a class": lambda: Decimal,
    "a date": lambda: np.datetime64("2020-01-01"),
    "a dictionary": lambda: {0: 1, "a": 2},
    "an empty dictionary": dict,
    "a set": lambda: {1, 2},
    "an empty list": list,
    "an empty tuple": tuple,
    "an empty row": lambda: [[]],
    "0 x 0": lambda: np.zeros((0, 0)),
    "a pair": lambda: (1, 2),
    "a range": lambda: range(3),
    "a generator": lambda: (i for i in [1, 2]),
    "an iterator": lambda: iter([[1, 2], [3, 4]]),
    "a long list": lambda: [0] * 1000,
    "negative numbers": lambda: [-1, -1],
    "huge numbers": lambda: [1e308] * 2,
    "truth values": lambda: [True, False],
    "a list of NaN": lambda: [nan],
    "a matrix of NaN": lambda: [[nan]],
    "a matrix of None": lambda: [[None]],
    "a list of None": lambda: [None],
    "a list of text": lambda: ["a", "b"],
    "a matrix of text": lambda: [["a"]],
    "a list of objects": lambda: [object()],
    "a list of fractions that are no doubles": lambda: [Fraction(10) ** 400],
    "ragged": lambda: [[1, 2], [3]],
    "ragged deeper": lambda: [1, [2]],
    "a list within itself": recursive,
    "a list that lies about its length": lambda: LyingLength([1, 2]),
    "infinite": lambda: [[inf, 1], [1, 0]],
    "a vector of 5": lambda: np.zeros(5),
    "3 x 3": lambda: np.eye(3),
    "7 x 7": lambda: np.eye(7),
    "three dimensions": lambda: np.zeros((2, 2, 2)),
    "no dimensions": lambda: np.array(1.0),
    "an object in an array": lambda: np.array(object()),
    "records": lambda: np.zeros(2, dtype=[("a", float)]),
    "masked": lambda: np.ma.array([[1.0, 2], [3, 4]], mask=[[True, False], [False, False]]),
    "a masked vector": lambda: np.ma.array([1.0, 2], mask=[True, False]),
    "sparse 5 x 5": lambda: sp.eye_array(5),
    "sparse NaN": lambda: sp.csr_array([[nan, 1.0], [1, 1]]),
    "sparse complex": lambda: sp.csr_array([[1j, 1.0], [1, 1]]),
    "sparse out of range": broken_sparse,
    "sparse lists": lambda: sp.lil_array((2, 2)),
    "sparse vector": lambda: sp.coo_array(np.ones(3)),
    "a cone with a line": lambda: kp.PolyhedralCone([[1, 0], [-1, 0], [0, 1]]),
    "a flat cone": lambda: kp.PolyhedralCone([[1, 0]]),
    "a cone in nine dimensions": lambda: kp.orthant(9),
    "a transfer function": lambda: ct.tf([1], [1, 1]),
    "an improper transfer function": lambda: ct.tf([1, 0, 0], [1, 1]),
    "a system": lambda: ct.ss([[-1]], [[1]], [[1]], 0),
    "a discrete system": lambda: ct.ss([[0.5]], [[1]], [[1]], 0, 0.1),
    "a system of NaN": lambda: ct.ss([[nan]], [[1]], [[1]], 0),
    "a system without states": lambda: ct.ss([], [], [], [[1]]),
    "a system with cones": lambda: kp.ConeStateSpace([[-1]], [[1]], [[1]], 0),
    "a list of systems": lambda: [kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)],
    "a frequency response": lambda: ct.frd([1, 2], [1, 2]),
    "a nonlinear system": lambda: ct.nlsys(lambda t, x, u, p: x, inputs=1, outputs=1, states=1),
    "a graph": lambda: nx.path_graph(3),
    "hostile": Hostile,
    "no array": NoArray,
}
