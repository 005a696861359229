"""`compartmental`: compartments, Markov generators and Laplacians with leaks, from the rates that are known.

The diagonal of A = F - diag(F'1 + o) is a sum that doubles round, and of a system that drains slowly the rounding may
be all that is left.  So stability is decided on F and o (see `theorems.compartments`), and residence times and DC gains
are found without subtraction (see `theorems.subtraction_free`), with a proven relative error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..cards import raised
from ..errors import DataError, KposError, ShapeError, TooLargeError, UndecidedError
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix, dense
from ..exact.rounding import SMALLEST_NORMAL
from ..proof.answer import Answer
from ..systems.statespace import ConeStateSpace
from ..theorems.compartments import CompartmentalCertificate, drains
from ..theorems.subtraction_free import LARGEST, relative_error, solve_without_subtraction
from .coupling import from_entries
from .ranges import is_graph

Floats = NDArray[np.float64]
# Compartments whose matrix is formed in fractions.
_EXACT = 1000


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Compartments(Answer):
    """Compartments with flows between them: x' = A x + B u, y = C x, A = F - diag(F'1 + o).

    Attributes
    ----------
    certificate : CompartmentalCertificate
        PROVED: every compartment reaches an outflow, which is when A is Hurwitz.  REFUTED: some never drain.
    B, C : Matrix
        Nonnegative inputs and outputs.
    names : tuple of str
        Labels of the compartments, those of a graph.
    """

    B: Matrix
    C: Matrix
    names: tuple[str, ...] = ()

    @cached_property
    def system(self) -> ConeStateSpace:
        """The system on nonnegative orthants; its diagonal is exact, whatever doubles hold.

        Raises
        ------
        TooLargeError
            More than 1000 compartments.
        """
        cert, n = self.certificate, self.B.shape[0]
        if n > _EXACT:
            raise TooLargeError(
                f"the diagonal of a system of {n} compartments takes dense fractions; the limit is {_EXACT}. "
                "Stability, residence times and gains need no system."
            )
        if not isinstance(cert, CompartmentalCertificate):
            raise DataError("there are no compartments without their certificate.")
        A = np.array(cert.flows.fractions())
        A[np.diag_indices(n)] = -(A.sum(axis=0) + cert.outflows.fractions()[0])
        q, m = self.C.shape[0], self.B.shape[1]
        labels = {"states": list(self.names)} if self.names else {}
        data = (Matrix.from_fractions(A), self.B.dense(), self.C.dense(), np.zeros((q, m)))
        return ConeStateSpace(*data, **labels)

    @property
    def relative_error(self) -> float:
        """A proven bound of the relative error of every entry of `residence_times` and `gain`."""
        n = self.B.shape[0]
        return relative_error(n, n + 3)

    @cached_property
    def residence_times(self) -> Floats:
        """-A^-T 1, shape (n,): how long what is in a compartment stays in all of them, on average.

        A Lyapunov vector v with v'A = -1.

        Raises
        ------
        KposError
            Some compartment never drains.
        TooLargeError, UndecidedError
            More than 2000 compartments, or numbers outside the range of doubles.
        """
        return self._solved(Matrix(np.ones((1, self.B.shape[0]))))[:, 0]

    @cached_property
    def gain(self) -> Floats:
        """The DC gain C (-A)^-1 B, shape (q, m): the steady output for one unit of steady input.

        Raises
        ------
        KposError, TooLargeError, UndecidedError
            As `residence_times`.
        """
        X = self._solved(self.C)
        B = dense(self.B.values)
        out = np.empty((X.shape[1], B.shape[1]))
        for j in range(B.shape[1]):
            out[:, j] = (X * B[:, [j]]).sum(axis=0)
        return out

    def _solved(self, right: Matrix) -> Floats:
        """M^-1 r for every row r, in doubles, as columns; M = -A'."""
        cert, n = self.certificate, self.B.shape[0]
        if not isinstance(cert, CompartmentalCertificate) or not cert:
            raise KposError(f"there are residence times and gains only if all compartments drain. {self.explain()}")
        if n > LARGEST:
            raise TooLargeError(f"{n} compartments are eliminated as a dense matrix; the limit is {LARGEST}.")
        if not all(map(_has_all_digits, (cert.flows, cert.outflows, self.B, self.C))):
            raise UndecidedError("a rate or a weight is below the range of doubles; scale the time, or the signals.")
        rates = np.array(dense(cert.flows.values)).T
        return solve_without_subtraction(rates, cert.outflows.values[0], np.array(dense(right.values)).T)

    def facts(self) -> list[tuple[str, str]]:
        """How many compartments, and how accurate their gains are."""
        n = self.B.shape[0]
        return [("compartments", str(n)), ("relative error of gains", raised(self.relative_error))][
            : 1 + (n <= LARGEST)
        ]


def compartmental(
    flows: Any, outflows: ArrayLike, B: ArrayLike | None = None, C: ArrayLike | None = None
) -> Compartments:
    """Compartments from their flows and outflows: is everything drained, how long does it take, with what gains?

    x' = A x + B u, y = C x with A = F - diag(F'1 + o): flows F from compartment to compartment, outflows o to the
    outside.  Also Markov generators with exits, and Laplacians with leaks.

    Parameters
    ----------
    flows : array_like or sparse matrix, shape (n, n), or networkx graph
        flows[i, j] >= 0 is the rate from j to i, for i != j; the diagonal must be 0, because it follows.  Of a graph
        the edge j -> k carries the rate "weight" from j to k (1 if there is none), in both directions if the graph has
        none.
    outflows : array_like, shape (n,)
        Rates >= 0 to the outside, in the order of the compartments (of a graph: of its nodes).
    B : array_like, shape (n, m), optional
        Nonnegative inputs.  Default: an input into every compartment.
    C : array_like, shape (q, n), optional
        Nonnegative outputs.  Default: the content of every compartment.

    Returns
    -------
    Compartments
        PROVED: every compartment reaches an outflow, and so the system is positive and exponentially stable; with
        `.system`, `.residence_times`, `.gain` and their `.relative_error`.  REFUTED with the compartments that never
        drain.

    Raises
    ------
    DataError
        A rate is negative or not finite, the diagonal of `flows` is not 0, or B or C has negative entries.
    ShapeError
        Sizes that do not fit.

    Notes
    -----
    Rates may be fractions or text, and are exact.  The verdict takes one search through the graph, at any size;
    residence times and gains a dense elimination without subtraction, up to 2000 compartments, whose entries have
    nearly all digits even if the outflows are 1e-200 of the flows.

    Examples
    --------
    >>> import control_kpos as kp
    >>> tanks = kp.compartmental([[0, 1], [2, 0]], [0, 1e-20])
    >>> tanks.status.name, tanks.residence_times.round(3).tolist() == [1.5e20, 1.5e20]
    ('PROVED', True)
    >>> kp.compartmental([[0, 1], [2, 0]], [0, 0]).status.name
    'REFUTED'
    """
    F, names = _flows(flows)
    n = F.shape[0]
    if not n:
        raise ShapeError("flows has no compartments; give at least one.")
    require_shape(F, "flows", (n, n), "a rate for every pair of compartments")
    o = require_shape(exact_matrix(outflows, "outflows", ndim=1), "outflows", (n,), f"flows has {n} compartments")[None]
    _require_nonnegative(F, "flows")
    _require_nonnegative(o, "outflows", "outflows[{1}]")
    own = np.flatnonzero(F.values.diagonal())
    if own.size:
        i = int(own[0])
        raise DataError(
            f"flows[{i}, {i}] is {F.values.diagonal()[i]:g}, a flow from a compartment to itself; put 0 there: the "
            "diagonal of A follows from the other rates."
        )
    eye = Matrix.identity(n, sparse=True)
    ins = eye if B is None else require_shape(exact_matrix(B, "B"), "B", (n, None), f"flows has {n} compartments")
    outs = eye if C is None else require_shape(exact_matrix(C, "C"), "C", (None, n), f"flows has {n} compartments")
    for M, name in ((ins, "B"), (outs, "C")):
        _require_nonnegative(M, name)
    cert = drains(F, o)
    return Compartments(status=cert.status, certificate=cert, B=ins, C=outs, names=names)


def _flows(given: Any) -> tuple[Matrix, tuple[str, ...]]:
    """The matrix of flows, and the labels of a graph."""
    if not is_graph(given):
        return exact_matrix(given, "flows"), ()
    if given.is_multigraph():
        raise DataError(
            "flows is a multigraph; parallel edges have no single rate. Add their rates up in a Graph or DiGraph."
        )
    labels = list(given.nodes)
    number = {label: j for j, label in enumerate(labels)}
    edges = list(given.edges(data="weight", default=1))
    if not given.is_directed():
        edges += [(b, a, rate) for a, b, rate in edges if a != b]
    rates = exact_matrix([rate for *_, rate in edges], "the weights of flows", ndim=1)
    to, of = (np.array([number[edge[k]] for edge in edges], dtype=np.intp) for k in (1, 0))
    names = tuple(map(str, labels))
    return from_entries([to], [of], [rates], (len(labels), len(labels))), names if len(set(names)) == len(names) else ()


def _require_nonnegative(M: Matrix, name: str, where: str = "") -> None:
    """Raise `DataError` at the first negative entry."""
    entries = sp.coo_array(M.values if M.numerators is None else np.sign(M.numerators).astype(float) * abs(M.values))
    below = np.flatnonzero(entries.data < 0)
    if below.size:
        i, j = (int(axis[below[0]]) for axis in entries.coords)
        remedy = "rates and weights are nonnegative" + "; leave out the diagonal" * (name == "flows" and i == j)
        raise DataError(f"{where.format(i, j) or f'{name}[{i}, {j}]'} is {entries.data[below[0]]:g}; {remedy}.")


def _has_all_digits(M: Matrix) -> bool:
    """True if every entry is a double, or rounded to a normal one."""
    return M.numerators is None or bool((abs(M.values[M.numerators != 0]) >= SMALLEST_NORMAL).all())
