"""Compartments: stability from flows and outflows, proven by a walk through the graph; nothing is subtracted.

Material flows from compartment j to i at the rate f_ij >= 0 and leaves from i at the rate o_i >= 0:

    x' = A x,    A = F - diag(F'1 + o),    (F)_ij = f_ij for i != j.

Then x >= 0 is kept, and the total 1'x falls at the rate o'x (mass balance).  A is Hurwitz if and only if every
compartment reaches an outflow.  *Proof* by levels, any real numbers l with

    o_i + sum_{j: l_j < l_i} f_ji > 0    for every compartment i:

from each compartment material leaves, or goes down to one of the finitely many lower levels, and so ends at an outflow.
(With e small enough v_i = 1 - e^(1 + the place of l_i among the levels) has v'A < 0.)  *Refutation* by a trap, a set S
of compartments, not empty, with o_i = 0 and f_ji = 0 for i in S, j not in S: the total of S never falls.

Both are signs of sums of nonnegative numbers.  The diagonal of A, which is rounded where it is stored, is not used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Status, Vector, exactly
from ..proof.encoding import register_record

Floats = NDArray[np.float64]
_FLOWS, _OUTFLOWS = "flows >= 0", "outflows >= 0"
# Compartments that a text names.
NAMED = 8


@register_record
@dataclass(frozen=True, eq=False)
class Trap:
    """Compartments that material enters and never leaves.

    Attributes
    ----------
    members : ndarray, shape (k,)
        Their numbers.
    """

    members: Vector = Vector(required=True)

    def __str__(self) -> str:
        numbers = [str(int(i)) for i in self.members]
        few = ", ".join(numbers[:NAMED]) + ", ..." * (len(numbers) > NAMED)
        return f"compartment {few}" if len(numbers) == 1 else f"compartments {few}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CompartmentalCertificate(Certificate):
    """Proof that compartments drain, x' = (F - diag(F'1 + o)) x being positive and exponentially stable, or a trap.

    Attributes
    ----------
    flows : Matrix, shape (n, n)
        F: the rate from compartment j to i in row i, column j; its diagonal says nothing.
    outflows : Matrix, shape (1, n)
        o, the rates at which compartments lose material to the outside.
    levels : ndarray, shape (n,), or None
        From every compartment material leaves or goes to a lower level.
    witness : Trap or None
        For REFUTED.
    """

    claim: ClassVar[str] = "compartmental"
    no_margin: ClassVar[frozenset[str]] = frozenset({_FLOWS, _OUTFLOWS})

    flows: Matrix
    outflows: Matrix
    levels: Vector = Vector()

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        n = self.flows.shape[0]
        if self.flows.shape != (n, n) or self.outflows.shape != (1, n) or not n:
            raise DataError("there is a flow for every pair of compartments, and an outflow for each.")
        if (self.witness is None) == (self.levels is None):
            return Status.UNDECIDED, ()
        return super()._evaluate()

    def _rates(self) -> list[Condition]:
        eye = Matrix.identity(self.flows.shape[0], sparse=True)
        return [
            Condition(_FLOWS, BilinearForms(eye, self.flows, eye), ">="),
            Condition(_OUTFLOWS, BilinearForms(self.outflows, None, eye), ">="),
        ]

    def conditions(self) -> list[Condition]:
        """Nonnegative rates; what leaves each compartment, or goes down."""
        n = self.flows.shape[0]
        levels = exactly(self, "levels").values
        if levels.shape != (n,):
            raise DataError("every compartment has a level.")
        down = Matrix.join([_descending(self.flows, levels), self.outflows], -2)
        forms = BilinearForms(Matrix(np.ones((1, n + 1))), down, Matrix.identity(n, sparse=True))
        return [*self._rates(), Condition("leaves or goes down > 0", forms, ">")]

    def refutation(self) -> list[Condition] | None:
        """Nonnegative rates; nothing leaves the trap."""
        n = self.flows.shape[0]
        if not isinstance(self.witness, Trap) or self.levels is not None:
            return None
        held = exactly(self.witness, "members").values
        members = held.astype(np.int64)
        known = members.size and (members == held).all() and (members >= 0).all() and (members < n).all()
        if not known or (np.diff(members) <= 0).any():
            return None
        inside = np.zeros((1, n))
        inside[0, members] = 1
        outside = Matrix(np.append(1 - inside, [[1.0]], axis=1))
        forms = BilinearForms(outside, Matrix.join([self.flows, self.outflows], -2), Matrix(inside))
        return [*self._rates(), Condition("nothing leaves the trap", forms, "==")]

    def evidence(self) -> dict[str, Any]:
        """Nothing: the data suffice."""
        return {}

    def explain(self) -> str:
        """Whether the compartments drain, and why."""
        n = self.flows.shape[0]
        if self.refuted_by is not None:
            return (
                f"Refuted: what enters {self.refuted_by} never leaves: there is no outflow, and no flow from there to "
                "the rest. The total there never falls, so that the system is positive but not exponentially stable. "
                "Every compartment needs a way to an outflow."
            )
        if self:
            return (
                f"Proved: every one of the {n} compartments reaches an outflow, so that the system is positive and "
                "exponentially stable. Mass balance: without inflow the total content falls exactly at the rate of the "
                "outflows; in a steady state the outflows carry what flows in."
            )
        return "Undecided: neither levels that lead to outflows nor a trap could be proven."


def _descending(flows: Matrix, levels: Floats) -> Matrix:
    """The flows to a lower level; zeros elsewhere."""
    if flows.is_sparse:
        csr = flows.values
        rows = np.repeat(np.arange(csr.shape[0]), np.diff(csr.indptr))
        kept = levels[rows] < levels[csr.indices]
        return Matrix(sp.csr_array((csr.data[kept], (rows[kept], csr.indices[kept])), shape=csr.shape))
    kept = levels[:, None] < levels[None, :]
    if flows.numerators is None:
        return Matrix(np.where(kept, flows.values, 0.0))
    return Matrix.over(np.where(kept, flows.numerators, 0), flows.denominator)


def signs(M: Matrix) -> sp.coo_array:
    """-1 and 1 where an entry is not 0, be it below the range of doubles."""
    entries = sp.coo_array(M.values if M.numerators is None else np.sign(M.numerators).astype(float))
    entries.data = np.sign(entries.data)
    entries.eliminate_zeros()
    return entries


def drains(flows: Matrix, outflows: Matrix) -> CompartmentalCertificate:
    """Decide whether every compartment reaches an outflow: one search through the graph, linear in its edges.

    Parameters
    ----------
    flows : Matrix, shape (n, n)
        Nonnegative; the rate from j to i in row i, column j.
    outflows : Matrix, shape (1, n)
        Nonnegative.
    """
    levels = distances(flows, outflows)
    data = {"flows": flows, "outflows": outflows}
    if np.isfinite(levels).all():
        return CompartmentalCertificate.settle(**data, levels=levels)
    members = np.flatnonzero(~np.isfinite(levels)).astype(float)
    return CompartmentalCertificate.settle(**data, witness=Trap(members))


def distances(flows: Matrix, outflows: Matrix) -> Floats:
    """The least number of flows from every compartment to one that has an outflow; inf where there is no way."""
    n = flows.shape[0]
    # Backwards from the outside, node n.
    to, of = signs(flows).coords
    draining = signs(outflows).coords[1]
    tails, heads = np.append(to, np.full(draining.size, n)), np.append(of, draining)
    graph = sp.csr_array((np.ones(tails.size), (tails, heads)), shape=(n + 1, n + 1))
    return np.asarray(dijkstra(graph, indices=n, unweighted=True))[:n]
