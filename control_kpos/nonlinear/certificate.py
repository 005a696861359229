"""Certificates of differential positivity (Forni and Sepulchre, 2016): inequalities over interval matrices.

h'J x >= 0 holds for all J with |J - C| <= R, entry by entry, if and only if h'C x - |h|'R |x| >= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cards import about, shown
from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate
from ..proof.encoding import LATER, register_record
from ..proof.inclusion import row_of
from ..proof.weights import ProofOmittedError, Prover, crossed_facet

_SOURCES = ("vertices", "enclosed", "sampled")

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DifferentialViolation:
    """A Jacobian that turns a displacement on the boundary outwards.

    Attributes
    ----------
    centre, radius : ndarray, shape (n, n)
        Encloses the Jacobian at `point`.
    facet, ray : int
        Row numbers in `facets` and `rays` of X.
    value : float
        h'J x < 0, in floating point.
    point : ndarray, shape (n,), or None
        Where; None for a Jacobian that was given as a matrix.
    """

    computed: ClassVar[tuple[str, ...]] = ("facet", "value")

    centre: Array
    radius: Array
    facet: int = LATER
    ray: int = LATER
    value: float = LATER
    point: Array | None = None

    def __str__(self) -> str:
        where = "" if self.point is None else f" at x = {shown(self.point)}"
        product = f"h'J x = {about(self.value, digits=3)} < 0"
        return f"the Jacobian{where} turns generator {self.ray} out through facet {self.facet} ({product})"


register_record(DifferentialViolation)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DifferentialCertificate(Certificate):
    """Proof that a set of Jacobians is K-positive, or one that is not.

    Attributes
    ----------
    centres : Matrix, shape (M, n, n)
        Jacobians, or midpoints of enclosures.
    radii : ndarray, shape (M, n, n)
        All J with |J - centre| <= radius for some piece are meant.
    X : Cone
    discrete : bool
        x[k+1] = f(x[k]): J X inside X.
    source : {"vertices", "enclosed", "sampled"}
        "vertices": about the matrices given and their convex hull.  "enclosed": about every Jacobian on the
        region, by interval arithmetic.  "sampled": seen at points only, which proves nothing about the
        others; the status is never PROVED then.
    v : ndarray, shape (n,), or None
        Common Lyapunov vector: the flow contracts.
    witness : DifferentialViolation or None
    """

    claim: ClassVar[str] = "differentially-positive"

    centres: Matrix
    radii: Array
    X: Cone
    discrete: bool = False
    source: str = "vertices"
    v: Array | None = None

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        if self.radii.shape != self.centres.shape or not (self.radii >= 0).all():
            raise DataError("every Jacobian needs a radius, and radii are not negative.")
        if self.v is not None and np.shape(self.v) != (self.X.dim,):
            raise DataError("v does not fit the cone.")
        out = [invariance(self, s) for s in range(self.centres.shape[0])]
        if self.v is not None:
            v = Matrix(self.v[None, :])
            out.append(Condition("v'x > 0", BilinearForms(v, None, _dense_rays(self.X)), ">"))
            out += [self._decrease(s) for s in range(self.centres.shape[0])]
        if self.source == "sampled":
            one = Matrix(np.ones((1, 1)))
            out.append(Condition("all Jacobians on the region are known", BilinearForms(one, None, one), "<"))
        return out

    def _decrease(self, s: int) -> Condition:
        v = Matrix(np.asarray(self.v, dtype=float)[None, :])
        A = self.centres[s]
        if self.discrete:
            A = Matrix.from_fractions(A.fractions() - np.eye(A.shape[0], dtype=int).astype(object))
        return Condition(f"v'J{s} x < 0", _worst(v, A, self.radii[s], _dense_rays(self.X), 1), "<")

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities that prove the violation."""
        w = self.witness
        forms = self._crossing(w) if isinstance(w, DifferentialViolation) else None
        if forms is None:
            return None
        out = [Condition("h'J x < 0", forms, "<")]
        if not self.discrete:
            h, x = _dense_facets(self.X)[[w.facet]], _dense_rays(self.X)[[w.ray]]
            out.append(Condition("h'x = 0", BilinearForms(h, None, x), "=="))
        return out

    def _crossing(self, w: DifferentialViolation) -> BilinearForms | None:
        """The largest h'J x over the Jacobians of a violation; None if there are no such Jacobians or numbers."""
        X, n = self.X, self.X.dim
        if w.centre.shape != (n, n) or w.radius.shape != (n, n) or not (w.radius >= 0).all():
            raise DataError("centre and radius of a violation do not fit the cone, or a radius is negative.")
        if w.point is not None and np.shape(w.point) != (n,):
            raise DataError("the point of a violation does not fit the cone.")
        member = self._member(w)
        if (member is None and w.point is None) or not 0 <= w.ray < X.n_rays:
            return None
        J = Matrix(w.centre) if member is None else self.centres[member]
        facets = _dense_facets(X) if w.facet is None else row_of(_dense_facets(X), w.facet)
        return _worst(facets, J, w.radius, _dense_rays(X)[[w.ray]], 1)

    def _member(self, w: DifferentialViolation) -> int | None:
        """Which Jacobian was given as a matrix that rounds to the centre; None for one at a point."""
        pairs = enumerate(zip(self.centres.values, self.radii, strict=True))
        same = (s for s, (J, r) in pairs if np.array_equal(w.centre, J) and not r.any())
        return next(same, None) if w.point is None and not w.radius.any() else None

    def contents(self) -> dict[str, Any]:
        """Jacobians are named A, one matrix each; `radii`, if there are any, are the bounds around them."""
        out = self.data()
        if self.source == "sampled":
            return out
        del out["centres"], out["radii"]
        bounds = {"radii": tuple(self.radii)} if np.any(self.radii) else {}
        return {"A": tuple(self.centres[s] for s in range(self.centres.shape[0])), **bounds, **out}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> DifferentialCertificate:
        """The inverse of `contents`; also reads files of version 0.1, with all Jacobians in one stack.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        rest = dict(contents)
        if rest.get("source", "vertices") not in _SOURCES:
            raise DataError(f"source is {rest['source']!r}; it must be one of {', '.join(_SOURCES)}.")
        if "A" in rest:
            rest["centres"] = Matrix.stack([A.dense() for A in rest.pop("A")])
            rest["radii"] = np.array(rest["radii"]) if "radii" in rest else np.zeros(rest["centres"].shape)
        shape = rest["centres"].shape
        if not shape[0] or rest["radii"].shape != shape or not (rest["radii"] >= 0).all():
            raise DataError("every Jacobian needs a radius, and radii are not negative.")
        draft = cls(**rest)
        return cls.settle(**{**rest, "witness": draft._restated()})

    def _restated(self) -> Any:
        """The witness with the worst facet, and the value there, which files leave out."""
        w, X = self.witness, self.X
        forms = self._crossing(w) if isinstance(w, DifferentialViolation) else None
        if forms is None:
            return w
        where = None if self.discrete else np.asarray(X.incidence)[:, [w.ray]]
        found = Condition("h'J x >= 0", forms, ">=", where).worst_violation()
        facet = 0 if found is None else found[0]
        return replace(w, facet=facet, value=float(forms.values[facet, 0]))

    def evidence(self) -> dict[str, Any]:
        """Weights of A x_i for every Jacobian A, within its bounds; or the facet that one of them crosses."""
        w, prover, count = self.witness, Prover(), self.centres.shape[0]
        if w is None and self.source == "sampled":
            raise ProofOmittedError("Jacobians seen at points prove nothing about the others")
        if w is None:
            layers = ((self.centres[s], self.radii[s]) for s in range(count))
            return {"P": [prover.within_bounds(self.X, A, R, invariance=not self.discrete) for A, R in layers]}
        return crossed_facet(self.X, w.facet)

    @property
    def is_strict(self) -> bool:
        """True if all inequalities hold strictly: the order is strongly preserved."""
        if not self and self.source != "sampled":
            return False
        conditions = [invariance(self, s) for s in range(self.centres.shape[0])]
        return all(Condition(c.name, c.forms, ">", c.where).verdict() is True for c in conditions)

    def explain(self) -> str:
        """A few sentences a person can act on."""
        if self.refuted_by is not None:
            return f"Not differentially positive on X: {self.witness}."
        if self.source == "sampled":
            good = sum(invariance(self, s).verdict() is True for s in range(self.centres.shape[0]))
            return (
                f"Not proven: {good} of {self.centres.shape[0]} sampled Jacobians are K-positive on X, up to the error "
                "of finite differences, and nothing is known between them. The system's function was not enclosed, "
                "because it looks at its arguments (comparisons, float(), isinstance, functions of math and the like), "
                "its code could tell numbers from intervals (type, is, try, getattr, dtype and the like) "
                "or does something with them that intervals do not know. Write it with numpy functions and arithmetic "
                "only, np.minimum, np.maximum, np.clip and abs included, and np.where if its branches meet."
            )
        if not self:
            return (
                "Undecided: the enclosed Jacobians are too wide for this cone, or the time limit was reached before "
                "all of them were decided. Try a smaller region, more pieces, or more time."
            )
        order = (
            f"The {'map' if self.discrete else 'flow'} is monotone in the order of X: solutions that start ordered "
            "stay ordered, while they remain in the region."
        )
        if self.v is not None:
            return (
                f"Proved. {order} It contracts: v'd decreases along every displacement d in X, so solutions converge "
                "to each other, while they remain in the region."
            )
        if self.is_strict:
            # Hirsch for flows; Polacik and Terescak for maps, which may have cycles of several points.
            goal = "approaches a cycle, of one or more points" if self.discrete else "converges to an equilibrium"
            return (
                f"Proved. {order} It is strictly differentially positive: almost every bounded trajectory that stays "
                f"in the region, under constant inputs, {goal}."
            )
        return f"Proved. {order}"


def invariance(certificate: DifferentialCertificate, s: int) -> Condition:
    """h'J x >= 0 for all J of piece s, on the facets that matter."""
    where = None if certificate.discrete else np.asarray(certificate.X.incidence)
    return Condition(f"h'J{s} x >= 0", extreme_products(certificate, s, -1), ">=", where)


def extreme_products(certificate: DifferentialCertificate, s: int, side: int) -> BilinearForms:
    """The largest (side 1) or smallest (side -1) h'J x over all J of piece s, for facets h and generators x."""
    X = certificate.X
    return _worst(_dense_facets(X), certificate.centres[s], certificate.radii[s], _dense_rays(X), side)


def _worst(left: Matrix, M: Matrix, radius: Array, right: Matrix, side: int) -> BilinearForms:
    """l'M x + side |l|'radius |x|: the largest (side 1) or smallest (side -1) value over the interval matrix."""
    if not radius.any():
        return BilinearForms(left, M, right)
    n = M.shape[0]
    zero = np.zeros((n, n))
    if M.is_double:
        middle = Matrix(np.block([[np.asarray(M.values), zero], [zero, side * radius]]))
    else:
        extra = Matrix(side * radius).fractions()
        blank = np.zeros((n, n), dtype=int).astype(object)
        middle = Matrix.from_fractions(np.block([[M.fractions(), blank], [blank, extra]]))
    return BilinearForms(_with_sizes(left), middle, _with_sizes(right))


def _with_sizes(rows: Matrix) -> Matrix:
    """[x, |x|] for every row, exactly."""
    if rows.is_double and rows.integer_rows is None:
        return Matrix(np.concatenate([rows.values, np.abs(rows.values)], axis=1))
    integers = rows.rows_as_integers(np.arange(rows.shape[0]))
    return Matrix.from_fractions(np.concatenate([integers, np.abs(integers)], axis=1))


def _dense_rays(X: Cone) -> Matrix:
    return X.exact_rays.plain()


def _dense_facets(X: Cone) -> Matrix:
    return X.exact_facets.plain()
