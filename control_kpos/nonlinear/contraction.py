"""Certificates of nonlinear networks: differential positivity and contraction, from ends of all Jacobians.

In coordinates z by generators let the Jacobians of the nodes and the slopes of links lie between ends, marked - and +,
entry by entry; s_il are the slopes of links of differences, phi(y_l - y_own(i)).  If

    B-, C-, W-, S- >= 0   and   A- - B+ (sum_l s+_il) C+_own(i) >= 0 off the diagonal,

the flow keeps the order of the cones while it stays in the region.  Two solutions differ by a d with d' = J(t) d, where
the parts of J(t), being means over the segment between both, lie between the same ends.  So with e > 0, c > 0 and

    y >= C+ e,   y- <= C- e,   u_i >= sum_l w+_il y_l + sum_l max over s in [s-, s+] of s_il (y_l - y-_own(i)),
    A+ e + B+ max(u, 0) + B- min(u, 0) + c e <= 0,

|d|_e = max |d_i| / e_i falls like e^{-c t}: where |d_i| / e_i is largest, d_i is at most e_i and at least -e_i, and all
other parts are no larger.  Without links of differences the sum V(d) = v'|d| falls as fast if v > 0 and

    r >= B+'v,   p >= W+'r,   A+'v + C+'p + c v <= 0.

The region is invariant, for a monotone flow, if z' >= 0 at its lower corner and z' <= 0 at the upper one, whatever
external inputs are within their box.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cards import about, floored, shown
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.rounding import HALF_ULP
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Status
from ..proof.encoding import register_record

Array = NDArray[np.float64]

NAMES = ("A", "B", "C", "W", "S")


@register_record
@dataclass(frozen=True, eq=False)
class OrderViolation:
    """An entry of the Jacobian at a state of the network that is negative where the order asks for a nonnegative one.

    Attributes
    ----------
    block : int
        0: A with the own share of differences, 1: B, 2: C, 3: slopes of links, 4: slopes of differences.
    row, column : int
        Of the whole network, in coordinates by generators.
    value : float
        At the state and inputs the entry is at most this, and this is negative.
    x : ndarray, shape (sum n_j,), or None
        The state; None for a link that may have this weight at any state.
    """

    block: int
    row: int
    column: int
    value: float
    x: Array | None = None

    def __str__(self) -> str:
        sides = (("state", "state"), ("state", "input"), ("output", "state"), ("input", "output"), ("input", "output"))
        of, by = sides[self.block]
        return f"more of {by} {self.column} lowers {of} {self.row}: the slope is {about(self.value, digits=3)} or less"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DifferentialNetworkCertificate(Certificate):
    """Proof that a nonlinear network keeps the order of its cones on a region, and whether it contracts; or why not.

    Everything is in coordinates by generators of the cones, on nonnegative orthants those of the states.

    Attributes
    ----------
    upper, lower : tuple of Matrix
        Ends of the Jacobians A, B, C of all nodes, block diagonal, and of the slopes W of links and S of links of
        differences; sparse.
    own : ndarray, shape (sum m_j,)
        For inputs that receive differences, the number of the own output.
    e, y, y_lower, u : ndarray or None
        Contraction in |d|_e = max |d_i| / e_i.
    v, r, p : ndarray or None
        Contraction in the sum v'|d|.
    decay_rate : float
        Proven for both: distances fall at least like exp(-decay_rate t), while solutions stay in the region.
    rates_at_lower, rates_at_upper : ndarray, shape (sum n_j,), or None
        Lower bounds of the rates at the lower corner of the region and upper bounds of those at the upper one.
    witness : OrderViolation or None
        For REFUTED.
    """

    claim: ClassVar[str] = "differentially-positive network"
    upper: tuple[Matrix, ...]
    lower: tuple[Matrix, ...]
    own: Array
    e: Array | None = None
    y: Array | None = None
    y_lower: Array | None = None
    u: Array | None = None
    v: Array | None = None
    r: Array | None = None
    p: Array | None = None
    decay_rate: float = 0.0
    rates_at_lower: Array | None = None
    rates_at_upper: Array | None = None

    # -- what is claimed

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        self._require_sizes()
        out = [*self._ordered(), *self._positive()]
        if self.e is not None:
            out += self._by_e()
        if self.v is not None:
            out += self._by_v()
        if self.rates_at_lower is not None:
            out.append(_entries("rates at the lower corner >= 0", self.rates_at_lower))
            out.append(_entries("rates at the upper corner <= 0", -np.asarray(self.rates_at_upper)))
        return out

    @property
    def _sizes(self) -> tuple[int, int, int]:
        """All states, inputs and outputs."""
        A, B, C = self.upper[:3]
        return A.shape[0], B.shape[1], C.shape[0]

    def _require_sizes(self) -> None:
        if len(self.upper) != len(NAMES) or len(self.lower) != len(NAMES):
            raise DataError("there are five matrices at both ends.")
        n, m, q = self._sizes
        shapes = ((n, n), (n, m), (q, n), (m, q), (m, q))
        for pair in zip(self.upper, self.lower, shapes, strict=True):
            if pair[0].shape != pair[2] or pair[1].shape != pair[2]:
                raise DataError("the ends of a matrix do not fit the network.")
            if not all(end.is_double and end.is_sparse for end in pair[:2]):
                raise DataError("ends are sparse matrices of doubles.")
        if self.own.shape != (m,) or (self.own != np.floor(self.own)).any():
            raise DataError("own has a whole number for every input.")
        used = self.own[self._differences[0]]
        if used.size and (used.min() < 0 or used.max() >= q):
            raise DataError("own names an output that does not exist.")
        pairs = ((self.e, (n,)), (self.y, (q,)), (self.y_lower, (q,)), (self.u, (m,)), (self.v, (n,)), (self.r, (m,)))
        pairs += ((self.p, (q,)), (self.rates_at_lower, (n,)), (self.rates_at_upper, (n,)))
        if any(x is not None and np.shape(x) != shape for x, shape in pairs):
            raise DataError("a vector does not fit the network.")
        for group in ((self.e, self.y, self.y_lower, self.u), (self.v, self.r, self.p)):
            if len({x is None for x in group}) > 1:
                raise DataError("vectors that prove contraction are missing.")
        if (self.rates_at_lower is None) != (self.rates_at_upper is None):
            raise DataError("rates are known at both corners, or at none.")
        contracts = self.e is not None or self.v is not None
        if not (0 < self.decay_rate < np.inf if contracts else self.decay_rate == 0):
            raise DataError("decay_rate is positive if there are vectors that prove contraction, and else 0.")

    def _ordered(self) -> Iterator[Condition]:
        """The lower ends are below the upper ones."""
        for name, high, low in zip(NAMES, self.upper, self.lower, strict=True):
            apart = sp.csr_array(high.values - low.values)  # differences of doubles have the right sign
            yield _entries(f"{name}- <= {name}+", apart.data)

    def _positive(self) -> Iterator[Condition]:
        """The order is kept at the lower ends."""
        for name, low in zip(NAMES[1:], self.lower[1:], strict=True):
            yield _entries(f"{name}- >= 0", low.values.data)
        yield self._cross_positive

    @cached_property
    def _cross_positive(self) -> Condition:
        """A- - B+ s+ C+ >= 0 off the diagonal."""
        n = self._sizes[0]
        left = sp.csr_array(sp.hstack([self.lower[0].values, -self.upper[1].values], format="csr"))
        middle = sp.csr_array(sp.vstack([sp.eye_array(n, format="csr"), self._own_share()], format="csr"))
        forms = BilinearForms(Matrix(left), Matrix(middle), Matrix.identity(n, sparse=True))
        rows = np.repeat(np.arange(n), np.diff(forms.pattern.indptr))
        return Condition("A- - B+ s+ C+ >= 0 off the diagonal", forms, ">=", rows != forms.pattern.indices)

    def _own_share(self) -> sp.csr_array:
        """Upper bounds of s_i C_own(i) for every input i that receives differences."""
        S, C = self.upper[4].values, self.upper[2].values
        count = np.bincount(self._differences[0], minlength=S.shape[0])
        total = np.asarray(S.sum(axis=1)).ravel()
        total = np.where(count > 1, np.nextafter(total * (1 + 2.0 * (count + 2) * HALF_ULP), np.inf), total)
        chosen = np.where(count > 0, self.own, 0).astype(np.intp)
        out = sp.csr_array(C[chosen]) if C.shape[0] else sp.csr_array((len(chosen), C.shape[1]))
        factor = np.repeat(total, np.diff(out.indptr))
        product = out.data * factor
        exact = (factor == 0) | (out.data == 0) | (np.abs(np.frexp(out.data)[0]) == 0.5) & (product > 1e-300)
        return sp.csr_array(
            (np.where(exact, product, np.nextafter(product, np.inf)), out.indices, out.indptr), out.shape
        )

    @cached_property
    def _differences(self) -> tuple[Any, Any, Array, Array]:
        """Targets, sources, lower and upper slopes of links of differences."""
        S = sp.coo_array(self.upper[4].values)
        S.eliminate_zeros()
        rows, columns = (index.astype(np.intp) for index in S.coords)
        low = np.asarray(self.lower[4].values[rows, columns]).ravel() if len(rows) else np.zeros(0)
        return rows, columns, low, S.data

    def _by_e(self) -> Iterator[Condition]:
        A, B, C, W, _ = (M.values for M in self.upper)
        n, m, q = self._sizes
        e, y, y_lower, u = (np.asarray(x, dtype=float) for x in (self.e, self.y, self.y_lower, self.u))
        yield _entries("e > 0", e, ">")
        yield _total("y - C+ e >= 0", (sp.eye_array(q), y), (-C, e))
        yield _total("C- e - y- >= 0", (self.lower[2].values, e), (-sp.eye_array(q), y_lower))
        rows, columns, low, high = self._differences
        d = np.nextafter(y[columns] - y_lower[self.own[rows].astype(np.intp)], np.inf)
        worst = sp.csr_array((np.where(d > 0, high, low), (rows, np.arange(len(rows)))), shape=(m, len(rows)))
        yield _total("u - W+ y - S d >= 0", (sp.eye_array(m), u), (-W, y), (-worst, d))
        rate = float(self.decay_rate) * sp.eye_array(n)
        parts = (-A, e), (-B, np.maximum(u, 0.0)), (-self.lower[1].values, np.minimum(u, 0.0)), (-rate, e)
        yield _total("A e + B u + c e <= 0", *parts)

    def _by_v(self) -> Iterator[Condition]:
        A, B, C, W, _ = (M.values for M in self.upper)
        n, m, q = self._sizes
        v, r, p = (np.asarray(x, dtype=float) for x in (self.v, self.r, self.p))
        if self._differences[0].size:
            raise DataError("v is for networks without links of differences.")
        yield _entries("v > 0", v, ">")
        yield _total("r - B+'v >= 0", (sp.eye_array(m), r), (-B.T, v))
        yield _total("p - W+'r >= 0", (sp.eye_array(q), p), (-W.T, r))
        rate = float(self.decay_rate) * sp.eye_array(n)
        yield _total("A'v + C'p + c v <= 0", (-A.T, v), (-C.T, p), (-rate, v))

    # -- what refutes it

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        self._require_sizes()
        n, m, q = self._sizes
        shapes = ((n, n), (n, m), (q, n), (m, q), (m, q))
        if not isinstance(w, OrderViolation):
            return None
        rows, columns = shapes[w.block] if 0 <= w.block < len(NAMES) else (0, 0)
        if not (0 <= w.row < rows and 0 <= w.column < columns) or (w.block == 0 and w.row == w.column):
            raise DataError("a violation is about an entry that does not exist, or about one of the diagonal.")
        if w.x is not None and np.shape(w.x) != (n,):
            raise DataError("the state of a violation does not fit the network.")
        if w.block == 0:
            least = self._cross_positive.forms
            at = slice(least.pattern.indptr[w.row], least.pattern.indptr[w.row + 1])
            found = least.values.data[at][least.pattern.indices[at] == w.column]
            known = float(found[0]) if found.size else 0.0
        else:
            known = float(self.lower[w.block].values[w.row, w.column])
        value = np.array([w.value])
        return [
            *self._ordered(),
            _entries("the slope < 0", -value, ">"),
            _entries("the slope is within the ends", np.array([w.value - known])),
        ]

    @property
    def margin(self) -> float:  # type: ignore[override]
        """Scale-free distance of the order to the boundary, computed; for REFUTED minus that of the witness.

        Where entries are zero throughout the region, nothing is counted; 0 where one touches zero.
        """
        if self.witness is not None:
            return -1.0 if self.status is Status.REFUTED else 0.0
        names = [*(f"{name}- >= 0" for name in NAMES), "A- - B+ s+ C+ >= 0 off the diagonal"]
        kept = [c for c in self._own_conditions if c.name in names]
        return min((c.margin for c in kept), default=0.0)

    # -- in words

    @property
    def contracts(self) -> bool:
        """True if contraction is proven."""
        return bool(self) and (self.e is not None or self.v is not None)

    @property
    def invariant(self) -> bool | None:
        """True if the region is proven to be invariant; None if that is not known."""
        return True if self and self.rates_at_lower is not None else None

    @property
    def norm(self) -> str | None:
        """The norm of differences d, in coordinates by generators, that falls; None if none is proven to."""
        if not self.contracts:
            return None
        names = [text for x, text in ((self.e, "max |d_i| / e_i"), (self.v, "sum v_i |d_i|")) if x is not None]
        return " and ".join(names)

    @property
    def _has_differences(self) -> bool:
        """True if there are links of differences."""
        return bool(self._differences[0].size)

    def contents(self) -> dict[str, Any]:
        """The ends, and the vectors."""
        return self.data()

    def evidence(self) -> dict[str, Any]:
        """Nothing besides the data: all inequalities are entry by entry."""
        return {}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> DifferentialNetworkCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        return cls.settle(**contents)

    def explain(self) -> str:
        """What follows, and under which conditions."""
        n = self._sizes[0]
        what = f"the nonlinear network of {n} states"
        if self.refuted_by is not None:
            where = "" if self.witness.x is None else f" at x = {shown(self.witness.x)}"
            return (
                f"Not differentially positive: in {what} a node or link does not keep the order of its cones{where}. "
                f"In coordinates by generators {self.witness}. Nodes and links are judged one by one: what signs that "
                "cancel each other would do together is not seen. Turn the signs of signals, or choose other cones."
            )
        if not self:
            return (
                f"Undecided: the enclosed Jacobians of {what} are too wide for its cones. Try a smaller region, or "
                "write functions with fewer occurrences of each quantity."
            )
        stays = " The region is invariant: no solution leaves it." if self.invariant else ""
        return (
            f"Proved: {what} keeps the order of its cones: solutions that start ordered stay ordered, while they "
            f"remain in the region.{stays} {self._contraction}"
        )

    @property
    def _contraction(self) -> str:
        if not self.contracts:
            return (
                "Contraction is not proven, which says nothing against it: the slopes are taken anywhere between their "
                "ends, each on its own. A smaller region brings the ends together."
            )
        rate = floored(self.decay_rate, 4)
        text = (
            f"It contracts: any two solutions under the same inputs and links approach each other at least like "
            f"exp(-{rate} t) in the norm {self.norm} of their difference in coordinates by generators, while they "
            "remain in the region."
        )
        if self.invariant:
            text += (
                " So for constant external inputs within their box, and links that do not change in time, there is one "
                "equilibrium in the region, and all solutions in it converge to it; under periodic ones all converge "
                "to one solution of the same period."
            )
        if not self._has_differences:
            text += (
                " Constant delays of the links change neither that two solutions in the region approach each other, "
                "nor the equilibrium; only the rate."
            )
        return text


def _entries(name: str, values: Array, relation: Any = ">=") -> Condition:
    """Signs of numbers."""
    forms = BilinearForms(Matrix(np.ones((1, 1))), None, Matrix(np.asarray(values, dtype=float)[:, None]))
    return Condition(name, forms, relation)


def _total(name: str, *terms: tuple[Any, Array]) -> Condition:
    """The sum of products M x is nowhere negative."""
    middle = Matrix(sp.csr_array(sp.hstack([sp.csr_array(M) for M, _ in terms], format="csr"))).T
    row = Matrix(np.concatenate([x for _, x in terms])[None])
    count = terms[0][0].shape[0]
    return Condition(name, BilinearForms(row, middle, Matrix.identity(count, sparse=True)), ">=")
