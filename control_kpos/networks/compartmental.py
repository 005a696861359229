"""`compartmental`: compartments, Markov generators and Laplacians with leaks, from the rates that are known.

The diagonal of A = F - diag(F'1 + o) is a sum that doubles round, and of a system that drains slowly the rounding may
be all that is left.  So stability is decided on F and o (see `theorems.compartments`), and residence times and DC gains
are found without subtraction (see `theorems.subtraction_free`), with a proven relative error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import DataError, KposError, ShapeError, TooLargeError, UndecidedError
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix, dense
from ..exact.rounding import SMALLEST_NORMAL
from ..proof.answer import Answer
from ..systems.statespace import ConeStateSpace
from ..theorems.compartments import NAMED, CompartmentalCertificate, Trap, drains, signs
from ..theorems.subtraction_free import Elimination, product, relative_error, within_range
from .coupling import from_entries
from .ranges import is_graph

Floats = NDArray[np.float64]
# Compartments whose matrix is formed in fractions.
_EXACT = 1000
# Numbers in the solutions for a gain.
_NUMBERS = 50_000_000


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
        Labels of the compartments, those of a graph; those of the states of `system`, unless one has a dot, which
        python-control refuses.
    inputs, outputs : tuple of str
        The same, where B or C was left out.
    """

    B: Matrix
    C: Matrix
    names: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

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
        # python-control takes no dots
        signals = {"states": self.names, "inputs": self.inputs, "outputs": self.outputs}
        labels = {kind: list(names) for kind, names in signals.items() if names and "." not in "".join(names)}
        data = (Matrix.from_fractions(A), self.B.dense(), self.C.dense(), np.zeros((q, m)))
        return ConeStateSpace(*data, **labels)

    @property
    def relative_error(self) -> float:
        """A proven bound of the relative error of every entry of `residence_times` and `gain`; inf above 1 %.

        Raises
        ------
        KposError, TooLargeError, UndecidedError
            As `residence_times`.
        """
        return relative_error(self._factors.roundings + self.B.shape[0] + 3)

    @cached_property
    def residence_times(self) -> Floats:
        """-A^-T 1, shape (n,): how long what is in a compartment stays in all of them, on average.

        A Lyapunov vector v with v'A = -1.

        Raises
        ------
        KposError
            Some compartment never drains.
        TooLargeError
            More than 2000 compartments, of which not enough can be eliminated as sparse ones.
        UndecidedError
            A number leaves the range of doubles.
        """
        return self._factors.solve(np.ones((self.B.shape[0], 1)))[:, 0]

    @cached_property
    def gain(self) -> Floats:
        """The DC gain C (-A)^-1 B, shape (q, m): the steady output for one unit of steady input.

        Raises
        ------
        KposError, TooLargeError, UndecidedError
            As `residence_times`; also TooLargeError if n (q + m) is above 5e7.
        """
        (n, m), q = self.B.shape, self.C.shape[0]
        if n * (q + m) > _NUMBERS:
            raise TooLargeError(
                f"the gain between {m} inputs and {q} outputs takes {n} x {q + m} numbers; the limit is {_NUMBERS}. "
                "Give B and C with the few inputs and outputs that matter."
            )
        X, B = self._factors.solve(np.array(dense(self.C.values)).T), np.array(dense(self.B.values))
        with within_range():
            return product(np.ascontiguousarray(X.T), B)

    @cached_property
    def _factors(self) -> Elimination:
        """Of M = -A'."""
        cert = self.certificate
        if not isinstance(cert, CompartmentalCertificate) or not cert:
            raise KposError(f"there are residence times and gains only if all compartments drain. {self.explain()}")
        if not all(map(_has_all_digits, (cert.flows, cert.outflows, self.B, self.C))):
            raise UndecidedError("a rate or a weight is below the range of doubles; scale the time, or the signals.")
        return Elimination(cert.flows.values.T, cert.outflows.values[0])

    def explain(self) -> str:
        """The verdict and why, then the names of compartments that never drain."""
        verdict = "" if self.certificate is None else self.certificate.explain()
        return " ".join(part for part in (verdict, self.message) if part)

    def facts(self) -> list[tuple[str, str]]:
        """How many compartments there are."""
        return [("compartments", str(self.B.shape[0]))]


def compartmental(
    flows: Any, outflows: ArrayLike | Mapping[Any, Any], B: ArrayLike | None = None, C: ArrayLike | None = None
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
    outflows : array_like, shape (n,), or dict
        Rates >= 0 to the outside, in the order of the compartments (of a graph: of its nodes); or those that are not 0
        by the node of the graph, or the number of the compartment.
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
    residence times and gains an elimination without subtraction, whose entries have nearly all digits even if the
    outflows are 1e-200 of the flows: up to 2000 compartments in any case, and 1e5 where few flows are between them, as
    in chains and trees (less than a second).

    Examples
    --------
    >>> import control_kpos as kp
    >>> tanks = kp.compartmental([[0, 1], [2, 0]], [0, 1e-20])
    >>> tanks.status.name, tanks.residence_times.round(3).tolist() == [1.5e20, 1.5e20]
    ('PROVED', True)
    >>> kp.compartmental([[0, 1], [2, 0]], [0, 0]).status.name
    'REFUTED'
    """
    F, labels = _flows(flows)
    n = F.shape[0]
    if not n:
        raise ShapeError("flows has no compartments; give at least one.")
    require_shape(F, "flows", (n, n), "a rate for every pair of compartments")
    rates = _in_order(outflows, labels) if isinstance(outflows, Mapping) else outflows
    o = require_shape(exact_matrix(rates, "outflows", ndim=1), "outflows", (n,), f"flows has {n} compartments")[None]
    _require_nonnegative(F, "flows")
    _require_nonnegative(o, "outflows", "outflows[{1}]")
    to, of = signs(F).coords
    own = to[to == of]
    if own.size:
        i = int(own[0])
        raise DataError(
            f"flows[{i}, {i}] is {_shown(F, i, i)}, a flow from a compartment to itself; put 0 there: the "
            "diagonal of A follows from the other rates."
        )
    eye = Matrix.identity(n, sparse=True)
    ins = eye if B is None else require_shape(exact_matrix(B, "B"), "B", (n, None), f"flows has {n} compartments")
    outs = eye if C is None else require_shape(exact_matrix(C, "C"), "C", (None, n), f"flows has {n} compartments")
    for M, name in ((ins, "B"), (outs, "C")):
        _require_nonnegative(M, name)
    cert = drains(F, o)
    texts = tuple(map(str, labels)) if is_graph(flows) else ()
    names = texts if len(set(texts)) == len(texts) else ()
    return Compartments(
        status=cert.status,
        certificate=cert,
        message=_named(cert.witness.members, names) if isinstance(cert.witness, Trap) and names else "",
        B=ins,
        C=outs,
        names=names,
        inputs=names if B is None else (),
        outputs=names if C is None else (),
    )


def _named(members: Floats, names: tuple[str, ...]) -> str:
    """The compartments of a trap by their names."""
    few = ", ".join(names[int(i)] for i in members[:NAMED])
    return f"Never drained: {few}{', ...' * (len(members) > NAMED)}."


def _flows(given: Any) -> tuple[Matrix, Sequence[Any]]:
    """The matrix of flows, and the nodes of the graph, or else numbers."""
    if not is_graph(given):
        F = exact_matrix(given, "flows")
        return F, range(F.shape[0])
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
    return from_entries([to], [of], [rates], (len(labels), len(labels)), "flows"), labels


def _in_order(outflows: Mapping[Any, Any], labels: Sequence[Any]) -> list[Any]:
    """The outflows of all compartments."""
    known = set(labels)
    for label in outflows:
        if label not in known:
            few = ", ".join(map(repr, labels[:NAMED]))
            raise DataError(
                f"outflows has a rate for {label!r}, which is no compartment; the compartments are {few}"
                f"{', ...' * (len(labels) > NAMED)}."
            )
    return [outflows.get(label, 0) for label in labels]


def _require_nonnegative(M: Matrix, name: str, where: str = "") -> None:
    """Raise `DataError` at the first negative entry."""
    entries = signs(M)
    below = np.flatnonzero(entries.data < 0)
    if below.size:
        i, j = (int(axis[below[0]]) for axis in entries.coords)
        remedy = "rates and weights are nonnegative" + "; leave out the diagonal" * (name == "flows" and i == j)
        raise DataError(f"{where.format(i, j) or f'{name}[{i}, {j}]'} is {_shown(M, i, j)}; {remedy}.")


def _shown(M: Matrix, i: int, j: int) -> str:
    """An entry that is not 0, in a text."""
    if M.values[i, j] or M.numerators is None:
        return f"{M.values[i, j]:g}"
    return "above 0" if M.numerators[i, j] > 0 else "below 0"


def _has_all_digits(M: Matrix) -> bool:
    """True if every entry is a double, or rounded to a normal one."""
    return M.numerators is None or bool((abs(M.values[M.numerators != 0]) >= SMALLEST_NORMAL).all())
