"""Order intervals of a network, proven node by node; X, U and Y are the products of the cones of the nodes.

Let (I) hold, all nodes be positive and algebraic loops contract.  A x + B u + w is at most 0 in the order of X for the
input u that belongs to x = x_max and w = w_max, and [0, x_max] is invariant (see `certificate`), if some u, y have

    A_j x_j + B_j u_j + w_j in -X_j,    C_j x_j + D_j u_j - y_j in -Y_j,    W y - u in -U    (discrete: A_j - I):

then u is at least the input that belongs to x, because loops contract.  All of them turned around for x_min, u, y make
A x_min + w_max lie in X.  Nothing is multiplied out, so that this is about the nodes and links as they were given.

No x_max exists if some d in X* has d'w_max > 0, and r, q with

    (d'A - q'C) x >= 0 on X,    (d'B - r' - q'D) u >= 0 on U,    q'y + r'W y >= 0 on Y.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import scipy.sparse as sp

from ...cards import raised
from ...cones import Cone, Orthant
from ...errors import DataError
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...exact.rounding import HALF_ULP
from ...exact.signs import BilinearForms
from ...networks import conditions as on
from ...networks import files
from ...networks.certificate import ClaimOnNetwork, dissipation, node_vectors
from ...networks.model import NetworkModel
from ...networks.witnesses import positive_parts
from ...proof.certificate import Fractions, Status, Vector, exactly
from ...proof.weights import Prover
from .certificate import BoundExceeded, NoInterval, ToldAsInterval

Triple = tuple[Matrix, Matrix, Matrix]
# The names of the vectors of the two ends of an interval.
_UPPER, _LOWER = ("x_max", "u_max", "y_max"), ("x_min", "u_min", "y_min")
_W, _COVER, _ABOVE, _BOUND = "h'w_max >= 0", "g'x >= 0", "(g - f)'x >= 0", "g'x_max - b <= 0"
_INSIDE = "h'x_max >= 0"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NetworkIntervalCertificate(ToldAsInterval, ClaimOnNetwork):
    """Proof that a network never leaves [0, x_max], and that bounds hold on it; or that there is no such interval.

    Attributes
    ----------
    model : NetworkModel
    v, r, q, loop_weights, exact
        As in `NetworkCertificate`, with sigma = 1: the network is stable.  For `NoInterval` only r and q, of d.
    w_max : ndarray, shape (n,)
        Disturbances of all states: w and w_max - w in X.
    x_max, u_max, y_max : ndarray, shapes (n,), (sum m_j,), (sum q_k,), or None
        The interval; u in [0, u_max] and y in [0, y_max] on it.
    x_min, u_min, y_min : likewise, or None
        Every invariant [0, x] has x - x_min in X.
    rows, bounds : Matrix, sparse, shape (k, n), and ndarray, shape (k,), or None
        f'x <= b on the interval.
    covers : Matrix, sparse, shape (k, n), or None
        The g that prove these bounds, row by row.
    w_max_exact, bounds_exact : tuple of Fraction, or None
        Where doubles do not suffice.
    witness : NoInterval, BoundExceeded or None
    """

    claim: ClassVar[str] = "network interval"
    beside_witness: ClassVar[frozenset[str]] = frozenset("v")

    w_max: Vector = Vector(required=True)
    x_max: Vector = Vector()
    u_max: Vector = Vector()
    y_max: Vector = Vector()
    x_min: Vector = Vector()
    u_min: Vector = Vector()
    y_min: Vector = Vector()
    rows: Matrix | None = None
    bounds: Vector = Vector()
    covers: Matrix | None = None
    w_max_exact: Fractions = Fractions("w_max")
    bounds_exact: Fractions = Fractions("bounds")

    @cached_property
    def X(self) -> Cone:
        """The product of the cones of the states of all nodes."""
        return files.product_cone(self.model, 0)

    def conditions(self) -> Sequence[Condition]:
        """The inequalities above, as far as they are claimed."""
        x = self._triple(_UPPER)
        out = [*self._alike(), *self._smallest_end(), Condition(_INSIDE, self._seen(x[0]), ">=")]
        out += moved(self.model, x, _of_states(self, self, "w_max"), "<=")
        return [*out, *self._bounded(x[0])] if self.rows is not None else out

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        if self._has(*_UPPER, "covers"):
            return None
        if isinstance(w, NoInterval):
            if self._has("v", *_LOWER, "rows", "bounds"):
                return None
            return [*self._alike(), *self._growing(_of_states(self, w, "d"))]
        if not isinstance(w, BoundExceeded) or self.x_min is None or self.rows is None:
            return None
        if type(w.row) is not int or w.row < 0:
            raise DataError("the number of a row is not negative.")
        (rows, bounds), x, least = self._limits(), _of_states(self, w, "x"), self._triple(_LOWER)[0]
        if w.row >= rows.shape[0]:
            return None
        at = np.array([w.row])
        apart = Matrix.join([x, -least], -1)[None]
        return [
            *self._alike(),
            *self._smallest_end(),
            Condition("h'x >= 0", self._seen(x), ">="),
            Condition("h'(x - x_min) <= 0", BilinearForms(self._facets, _sums(self.X.dim).T, apart), "<="),
            Condition("f'x - b > 0", _beyond(rows[at], x, bounds[at]), ">"),
        ]

    def _has(self, *names: str) -> bool:
        """True if one of these fields is there."""
        return any(vars(self)[name] is not None for name in names)

    @property
    def _facets(self) -> Matrix:
        return self.X.exact_facets

    def _seen(self, x: Matrix) -> BilinearForms:
        """h'x."""
        return BilinearForms(self._facets, None, x[None])

    def _triple(self, names: tuple[str, str, str]) -> Triple:
        x, u, y = (exactly(self, name) for name in names)
        if any(part.shape != (total,) for part, total in zip((x, u, y), self.model.totals, strict=True)):
            raise DataError("a vector has not the entries of all nodes.")
        return x, u, y

    def _alike(self) -> list[Condition]:
        """All nodes positive, (I), loops that contract; and the disturbances."""
        out = positive_parts(self.model)
        if self.model.has_feedthrough:
            if self.loop is None:
                raise DataError("loop_weights are missing although some D is not zero.")
            out += on.loop_gain(self.model, *self.loop)
        return [*out, Condition(_W, self._seen(_of_states(self, self, "w_max")), ">=")]

    def _smallest_end(self) -> list[Condition]:
        """The network is stable, and every interval contains [0, x_min]."""
        model, (v, r, q) = self.model, node_vectors(self)
        stable = dissipation(model, v, r, q, 0.0, discrete=model.discrete)
        return [
            *stable,
            on.balance(model, q, r, None),
            *moved(model, self._triple(_LOWER), _of_states(self, self, "w_max"), ">="),
        ]

    def _growing(self, d: Matrix) -> Iterator[Condition]:
        """d'x grows under w_max."""
        model, (r, q) = self.model, (exactly(self, name) for name in "rq")
        yield Condition("d'x >= 0", BilinearForms(d[None], None, self.X.exact_rays), ">=")
        parts = zip(*(model.split(part, kind) for kind, part in enumerate((d, r, q))), strict=True)
        for g, (d_g, r_g, q_g) in enumerate(parts):
            forms = on.decrease_forms(model.stacks[g], d_g, q_g, 0.0, model.discrete)
            yield Condition(on.titled("(d'A - q'C) x >= 0", model, g), forms, ">=")
            if model.stacks[g].sizes[1]:
                forms = on.supply(model, g, d_g, q_g, r_g).forms
                yield Condition(on.titled("(d'B - r' - q'D) u >= 0", model, g), forms, ">=")
        yield Condition("q'y + r'W y >= 0", on.balance_forms(model, q, r, None), ">=")
        yield Condition("d'w_max > 0", BilinearForms(d[None], None, _of_states(self, self, "w_max")[None]), ">")

    def _limits(self) -> tuple[Matrix, Matrix]:
        """The rows f and the numbers b of f'x <= b."""
        rows, bounds = self.rows, exactly(self, "bounds")
        if rows is None or rows.shape != (bounds.shape[0], self.X.dim) or not (rows.is_sparse and rows.is_double):
            raise DataError("every bound needs a row of the size of the states, in a sparse matrix.")
        return rows, bounds

    def _bounded(self, x: Matrix) -> list[Condition]:
        (f, b), g, rays = self._limits(), self.covers, self.X.exact_rays
        if g is None or f.shape != g.shape or not (g.is_sparse and g.is_double):
            raise DataError("every bound needs a row g of the size of the states, in a sparse matrix.")
        apart = BilinearForms(Matrix.join([g, -f], -1), _sums(self.X.dim), rays)
        return [
            Condition(_COVER, BilinearForms(g, None, rays), ">="),
            Condition(_ABOVE, apart, ">="),
            Condition(_BOUND, _beyond(g, x, b), "<="),
        ]

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.x_max is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    @cached_property
    def margin(self) -> float:  # type: ignore[override]
        """0: intervals that are as small as possible leave nothing to spare."""
        return 0.0

    def evidence(self) -> dict[str, Any]:
        """Weights for positivity and the coupling, and of the vectors that lie in X, U and Y."""
        out, prover = files.evidence(self.model, None), Prover()
        cones = {name: files.product_cone(self.model, kind) for kind, name in enumerate("XUY")}
        if all(isinstance(cone, Orthant) for cone in cones.values()):
            return out
        for name, (place, vector) in self._placed().items():
            out[name] = prover.vector(cones[place], vector)
        return out

    def _placed(self) -> dict[str, tuple[str, Any]]:
        """Names of weights, with the cone and the vector that they are about."""
        w = exactly(self, "w_max").fractions()
        out: dict[str, tuple[str, Any]] = {"wu": ("X", w)}
        if self.x_max is not None:
            x, u, y = _fractions(self, _UPPER)
            ahead, sent, heard = files.moved(self.model, x, u, y, w)
            out |= {"wx": ("X", x), "wz": ("X", -ahead), "wC": ("Y", -sent), "wW": ("U", -heard)}
        if self.x_min is not None:
            least, u, y = _fractions(self, _LOWER)
            ahead, sent, heard = files.moved(self.model, least, u, y, w)
            out |= {"wy": ("X", ahead), "wc": ("Y", sent), "wm": ("U", heard)}
            if isinstance(self.witness, BoundExceeded):
                x = exactly(self.witness, "x").fractions()
                out |= {"ws": ("X", x), "wb": ("X", least - x)}
        return out

    def reached(self) -> Any:
        """Bounds of f'x on the interval, g'x_max rounded up; None without rows."""
        if self.covers is None:
            return None
        G, x = self.covers.values, self.x_max
        terms = np.diff(G.indptr) + 2
        return G @ x + 2 * HALF_ULP * terms * (abs(G) @ np.abs(x))

    @property
    def gap(self) -> float:
        """No less than the largest h'(x_max - x_min) / h'x_max over the facets h; NaN without both, inf beside 0."""
        if self.x_max is None or self.x_min is None:
            return float("nan")
        high, size = _heights(self.model, self.x_max)
        low, more = _heights(self.model, self.x_min)
        error = HALF_ULP * 8 * (size + more)
        apart, least = np.maximum(high - low + error, 0.0), high - error
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = np.where(apart > 0, np.where(least > 0, apart / least, np.inf), 0.0)
        return float(raised(float(parts.max(initial=0.0)) * (1 + 8 * HALF_ULP), 9))


def moved(model: NetworkModel, end: Triple, w: Matrix, relation: Literal["<=", ">="]) -> Iterator[Condition]:
    """A x + B u + w, C x + D u - y and W y - u on one side of 0 in the orders of X, Y and U."""
    x, u, y = end
    parts = zip(model.stacks, *(model.split(z, k) for z, k in ((x, 0), (u, 1), (y, 2), (w, 0))), strict=True)
    for g, (s, x_g, u_g, y_g, w_g) in enumerate(parts):
        eye, row, middle = Matrix(np.eye(s.sizes[0])[None]), [x_g, u_g, w_g], [s.A, s.B]
        middle.append(eye)
        if model.discrete:
            row, middle = [*row, x_g], [*middle, -eye]
        forms = on.stacked(on.facets(s.X), Matrix.join(middle, -1), on.beside(*row))
        yield Condition(on.titled(f"h'(A x + B u + w) {relation} 0", model, g), forms, relation)
        if s.sizes[2]:
            middle = Matrix.join([s.C, s.D, Matrix(-np.eye(s.sizes[2])[None])], -1)
            forms = on.stacked(on.facets(s.Y), middle, on.beside(x_g, u_g, y_g))
            yield Condition(on.titled(f"h'(C x + D u - y) {relation} 0", model, g), forms, relation)
    yield Condition(f"h'(W y - u) {relation} 0", on.received(model, u, y).forms, relation)


def _heights(model: NetworkModel, x: Any) -> tuple[Any, Any]:
    """h'x for the facets h of all nodes, and bounds of what rounding adds to it, in units of the last place."""
    high, size = [], []
    for s, part in zip(model.stacks, model.split(x, 0), strict=True):
        H = np.asarray(s.X.facets)
        high.append((part @ H.T).ravel())
        size.append((np.abs(part) @ np.abs(H.T)).ravel() * (H.shape[1] + 1 if H.shape[1] > 1 else 0))
    return np.concatenate(high), np.concatenate(size)


def _of_states(certificate: Any, record: Any, name: str) -> Matrix:
    """A vector of a record with one entry for every state of the network of the certificate."""
    x = exactly(record, name)
    if x.shape != (certificate.X.dim,):
        raise DataError(f"{name} has not one entry for every state.")
    return x


def _fractions(certificate: Any, names: tuple[str, str, str]) -> list[Any]:
    return [exactly(certificate, name).fractions() for name in names]


def _sums(n: int) -> Matrix:
    """[I; I], sparse."""
    eye = Matrix.identity(n, sparse=True)
    return Matrix.join([eye, eye], -2)


def _beyond(rows: Matrix, x: Matrix, b: Matrix) -> BilinearForms:
    """f_i'x - b_i for every row, as [f_i', e_i'] [x; -b]."""
    eye = Matrix(sp.eye_array(rows.shape[0], format="csr"))
    return BilinearForms(Matrix.join([rows, eye], -1), None, Matrix.join([x, -b], -1)[None])
