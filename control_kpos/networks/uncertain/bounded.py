"""Networks bounded by vectors e inside X, u and y: the proof by e, for nodes and links known within sets.

Let node j be some mixture of its vertices at every time, all of them positive, W map Y into U, algebraic loops
contract, and e_j in int X_j, u in U, y satisfy at every vertex

    -(A e + B u) in int X,    y - C e - D u in Y,    and once    u - W y in U      (discrete time: A - I for A).

Then -e <= x <= e in the order of X implies -y <= C x + D u' <= y for the inputs -u <= u' <= u, and W(t) returns such
inputs if (W +- W(t)) Y is in U.  At the boundary of this interval the motion points inwards, so that the gauge norm

    |x|_e = max_k |h_k'x| / h_k'e        (h_k the facets of X)

falls, also if nodes and links change, and if links have bounded delays that change.  As all of this is Theorem 4 for
the transposed network (A', C', B', D')_j, W' on X*, Y*, U*, with v = e, r = y and q = -u, a family of vertices may have
e without having v, and v without having e.

Nodes and links that change sign, on any cones: the same for bounds M of A, B, C, D and W with

    (M - L), (M + L), (M - H), (M + H) nonnegative maps for the ends L and H of the range  (M + L, M + H for A in
    continuous time: h'(M + L) x >= 0 for generators x on the facet h)

as -e <= x <= e gives h'A x = h'(A (e + x) - A (e - x)) / 2 <= h'M e where h'x = h'e.  Only the bounds are positive.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ...cards import floored
from ...errors import DataError
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from .. import conditions as on
from .. import files
from ..model import BLOCKS, NetworkModel
from .certificate import UncertainNetworkCertificate
from .members import transposed


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BoundedNetworkCertificate(UncertainNetworkCertificate):
    """Proof that |x|_e decays for every choice of nodes and links of a network, by e inside X.

    Attributes
    ----------
    model, vertices : NetworkModel, tuple of NetworkModel
        The transposed networks of all vertices: A', C', B', D', W' on the dual cones.  See `network`.
    v, r, q
        e, y and -u, as Theorem 4 has them for the transposed network.
    e, u, y : ndarray, shapes (N, n), (N, m), (N, q), or tuples of ndarrays
        Inside X_j, in U_j and in Y_j.
    lower, upper : NetworkModel or None
        With ranges: the transposed networks of their ends.  `upper` only if some of them change sign: then `model`
        has bounds of both ends.
    decay_rate : float
        Proven for every choice, also one that changes, and for every W(t) with (W +- W(t)) Y in U:
        |x(t)|_e <= exp(-decay_rate t) |x(0)|_e; in discrete time |x[k]|_e <= (1 - decay_rate)^k |x[0]|_e.
    """

    claim: ClassVar[str] = "bounded network"

    upper: NetworkModel | None = None

    def conditions(self) -> Sequence[Condition]:
        """Theorem 4 at every vertex of the transposed network, and what is said of ranges."""
        if self.upper is not None and self.lower is None:
            raise DataError("upper ends of ranges have lower ends beside them.")
        return super().conditions()

    @property
    def network(self) -> NetworkModel:
        """The network of the first vertices, with bounds where ranges change sign, and not transposed."""
        return transposed([self.model])[0]

    @property
    def e(self) -> Any:
        """The vector inside X, per node."""
        return self.v

    @property
    def y(self) -> Any:
        """What bounds the outputs where e bounds the state, per node."""
        return self.r

    @property
    def u(self) -> Any:
        """What bounds the inputs where e bounds the state, per node."""
        q = self.q
        return tuple(0.0 - part for part in q) if isinstance(q, tuple) else None if q is None else 0.0 - q

    def _within(self, low: NetworkModel, q: Matrix) -> Iterator[Condition]:
        """As for a proof by v; or, if ranges change sign, their ends are at most the bounds of both signs."""
        if self.upper is None:
            yield from super()._within(low, q)
            return
        for end, name in ((low, "lower"), (self.upper, "upper")):
            for sum_of in (False, True):
                found = on.coupling_within(end, self.model, sum_of=sum_of)
                for g in range(len(end.stacks)):
                    found += on.nodes_within(end, self.model, g, sum_of=sum_of)
                yield from (replace(c, name=f"{c.name} [{name}]") for c in found)

    def refutation(self) -> Sequence[Condition] | None:
        """None: what there is not is a matter of `UncertainNetworkCertificate`."""
        return None

    def contents(self) -> dict[str, Any]:
        """As of the transposed network."""
        out = super().contents()
        if self.upper is not None:
            out["upper"] = tuple(files.describe(self.upper)[name] for name in (*BLOCKS, "W"))
        return out

    def explain(self) -> str:
        model = self.model
        what = f"the network of {model.n_nodes} nodes ({model.totals[0]} states) {self._known}"
        if not self:
            return f"Undecided: for {what} vectors e, u, y that bound it are not proven."
        unit = "step" if model.discrete else "unit of time"
        signed = self.upper is not None
        positive = (
            "Some ranges leave the cones: nothing is said of positivity." if signed else "Every choice is positive."
        )
        return (
            f"Proved: {what} is exponentially stable for every choice: {self._choices}, and all may change at any "
            "time, independently of each other. The proof is a vector e inside X: its gauge norm, the largest "
            "abs(h'x) / h'e over the facets h of X, falls along every motion, with decay rate at least "
            f"{floored(self.decay_rate, 4)} per "
            f"{unit}. {positive} {self._costly} The network stays stable when links have bounded delays, also if these "
            "change, and when links change over time to any W(t) for which M + W(t) and M - W(t) map Y into U, where M "
            f"is {'the bound' if signed else 'the upper end'} of W in this certificate."
        )
