"""Positivity of a system with respect to polyhedral proper cones X, U, Y.

Theorem 1 (Kawano and Forni, Theorem `cone_inv`).  x' = A x + B u, y = C x + D u keeps x in X and y in
Y for all x(0) in X and u(t) in U if and only if

    h'A x_i >= 0   for every facet h and generator x_i of X with h'x_i = 0,
    B U in X,   C X in Y,   D U in Y,

each inclusion read on generators and facets.  In discrete time the first line is A X in X: h'A x_i >= 0
for every facet and generator.  D is not in the paper; a static system needs the last inclusion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arguments import flag
from .arrays import ExactMatrix, exact_matrix, require_shape, shown
from .certificates.encoding import register_record
from .certificates.exact import BilinearForms
from .certificates.proofs import Prover, violation
from .certificates.result import Certificate, Condition
from .cones import Cone, as_cone
from .errors import DataError

_STATE, _INPUT, _OUTPUT, _DIRECT = "h'A x >= 0", "h'B u >= 0", "h'C x >= 0", "h'D u >= 0"
_WEIGHTS = {"A": "P", "B": "N", "C": "L", "D": "K"}
_MEANING = {_STATE: "A X in X", _INPUT: "B U in X", _OUTPUT: "C X in Y", _DIRECT: "D U in Y"}


@register_record
@dataclass(frozen=True, eq=False)
class PositivityViolation:
    """A facet and a generator that break an inclusion.

    Attributes
    ----------
    condition : str
        "A X in X", "B U in X", "C X in Y" or "D U in Y"; for A in continuous time this stands for
        e^{At} X in X.
    facet, ray : int
        Row numbers in `facets` of the target cone and in `rays` of the source cone.
    normal, generator : ndarray
        These two rows.
    value : float
        normal' M generator < 0, in floating point (its sign is proven).
    """

    condition: str
    facet: int
    ray: int
    normal: NDArray[np.float64]
    generator: NDArray[np.float64]
    value: float

    def __str__(self) -> str:
        return (
            f"{self.condition} fails at facet {self.facet}, normal {shown(self.normal)}, and generator "
            f"{self.ray}, {shown(self.generator)}: the product is {self.value:.3g} < 0"
        )


class System(NamedTuple):
    """Matrices and cones of a system with inputs and outputs."""

    A: ExactMatrix
    B: ExactMatrix
    C: ExactMatrix
    D: ExactMatrix
    X: Cone
    U: Cone
    Y: Cone
    discrete: bool


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PositivityCertificate(Certificate):
    """Proof that a system is positive with respect to (X, U, Y), or a facet and generator that break it.

    Attributes
    ----------
    A, B, C, D : ExactMatrix, or None for a system without inputs or outputs
        The data the verdict is about.
    X, U, Y : Cone, or None
    discrete : bool
        True: A X in X; False: e^{At} X in X for all t >= 0.
    witness : PositivityViolation or None
        The proven violation of largest relative size.
    """

    claim: ClassVar[str] = "positive"

    A: ExactMatrix
    X: Cone
    B: ExactMatrix | None = None
    C: ExactMatrix | None = None
    D: ExactMatrix | None = None
    U: Cone | None = None
    Y: Cone | None = None
    discrete: bool = False

    def system(self) -> System:
        """The data; DataError if the certificate is about A alone."""
        if self.B is None or self.C is None or self.D is None or self.U is None or self.Y is None:
            raise DataError("B, C, D and the cones U and Y are needed here; give them all.")
        return System(self.A, self.B, self.C, self.D, self.X, self.U, self.Y, self.discrete)

    def conditions(self) -> Sequence[Condition]:
        """The inclusions of Theorem 1."""
        out = [invariance_condition(self.A, self.X, discrete=self.discrete)]
        maps = [(_INPUT, self.X, self.B, self.U), (_OUTPUT, self.Y, self.C, self.X), (_DIRECT, self.Y, self.D, self.U)]
        for name, target, matrix, source in maps:
            if matrix is not None and target is not None and source is not None:
                out.append(inclusion_condition(name, target, matrix, source))
        return out

    def refutation(self) -> Sequence[Condition] | None:
        """The inequality that the facet and generator of the witness break."""
        w = self.witness
        if not isinstance(w, PositivityViolation):
            return None
        condition = next((c for c in self.conditions() if _MEANING[c.name] == w.condition), None)
        if condition is None:
            return None
        normal = take_rows(condition.forms.left, np.array([w.facet]))
        generator = take_rows(condition.forms.right, np.array([w.ray]))
        product = BilinearForms(normal, condition.forms.middle, generator)
        out = [Condition(f"{w.condition}: z < 0", product, "<")]
        if w.condition == "A X in X" and not self.discrete:
            out.append(Condition("h'x = 0", BilinearForms(normal, None, generator), "=="))
        same = _parallel(w.normal, dense_row(normal)) and _parallel(w.generator, dense_row(generator))
        if not same or condition.forms.middle is None:
            return None
        own = BilinearForms(ExactMatrix(w.normal[None]), condition.forms.middle, ExactMatrix(w.generator[None]))
        rounding = 1e-11 * abs(w.value) + 1e-14 * own.magnitudes[0, 0]
        return out if abs(own.values[0, 0] - w.value) <= rounding else None

    def evidence(self) -> dict[str, Any]:
        """A X = X P, B U = X N, C X = Y L, D U = Y K with weights P, N, L, K; or the normal of the broken facet."""
        maps = {"A": (self.X, self.A, self.X), "B": (self.X, self.B, self.U), "C": (self.Y, self.C, self.X)}
        maps["D"] = (self.Y, self.D, self.U)
        if isinstance(self.witness, PositivityViolation):
            name = self.witness.condition[0]
            target = maps[name][0] or self.X
            return violation(name, target.exact_facets, self.witness.facet, self.witness.ray)
        prover, out = Prover(), {}
        for name, (target, matrix, source) in maps.items():
            if matrix is not None and target is not None and source is not None:
                invariance = name == "A" and not self.discrete
                out[_WEIGHTS[name]] = prover.inclusion(target, matrix, source, invariance=invariance)
        return out

    def explain(self) -> str:
        """Which inclusions hold, or where one breaks."""
        inclusion = "A X lies in X" if self.discrete else "e^{At} X stays in X"
        if self:
            more = "".join(
                f", {text}"
                for text, m in (("B U in X", self.B), ("C X in Y", self.C), ("D U in Y", self.D))
                if m is not None
            )
            edge = (
                " The margin is 0: some inequality holds with equality, so a small change of the data can break it."
                if self.margin == 0
                else ""
            )
            return f"Proved positive: {inclusion}{more}. Scale-free margin {self.margin:.3g}.{edge}"
        if self.witness is not None:
            return (
                f"Not positive: {self.witness}. Choose another cone, or a feedback that turns the field inwards "
                "on this facet."
            )
        return (
            "Undecided: some signs are out of reach of exact arithmetic at this size. Give the data with fewer digits."
        )


def invariance_condition(A: ExactMatrix, X: Cone, *, discrete: bool) -> Condition:
    """h'A x_i >= 0: for all pairs in discrete time, for pairs with h'x_i = 0 in continuous time."""
    forms = BilinearForms(X.exact_facets, A, X.exact_rays)
    where = None
    if not discrete:
        where = _incident_entries(forms, X) if forms.is_sparse else X.incidence
    return Condition(_STATE, forms, ">=", where)


def inclusion_condition(name: str, target: Cone, M: ExactMatrix, source: Cone) -> Condition:
    """M source in target, on facets of the target and generators of the source."""
    return Condition(name, BilinearForms(target.exact_facets, M, source.exact_rays), ">=")


def _incident_entries(forms: BilinearForms, X: Cone) -> NDArray[np.bool_]:
    """Entries of a sparse pattern where h'x_i = 0."""
    slack = BilinearForms(X.exact_facets, None, X.exact_rays).signs()
    slack.data = (slack.data != 0).astype(np.int8)
    slack.eliminate_zeros()
    shape = forms.pattern.shape
    keys = np.repeat(np.arange(shape[0]), np.diff(forms.pattern.indptr)) * shape[1] + forms.pattern.indices
    slack_keys = np.repeat(np.arange(shape[0]), np.diff(slack.indptr)) * shape[1] + slack.indices
    return ~np.isin(keys, slack_keys)


def state_positivity(
    A: ArrayLike | ExactMatrix | Any, X: Cone | ArrayLike, *, discrete: bool = False
) -> PositivityCertificate:
    """Decide whether x' = A x (or x[k+1] = A x[k]) keeps the cone X invariant.

    Parameters
    ----------
    A : array_like or sparse matrix, shape (n, n)
        Doubles, integers, fractions or decimal strings.
    X : Cone, or array_like of its generators, shape (p, n)
        Polyhedral proper cone in R^n.
    discrete : bool
        True for x[k+1] = A x[k].

    Returns
    -------
    PositivityCertificate
        PROVED, or REFUTED with the violated pair of facet and generator.  UNDECIDED only for data
        too large for exact arithmetic.

    Raises
    ------
    ShapeError, DataError, NotProperConeError
        A is not square of the size of X, or not finite and real; X is not pointed or not solid.

    Notes
    -----
    Costs the facets of X once, and one product of (r, n), (n, n) and (n, p) matrices.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> kp.state_positivity([[0, 1], [-22, -13]], X).status.name
    'PROVED'
    >>> print(kp.state_positivity([[0, 1], [-22, -12]], X).witness.condition)
    A X in X
    """
    return cone_positivity(A, None, None, None, X, discrete=discrete)


def cone_positivity(
    A: ArrayLike | ExactMatrix | Any,
    B: ArrayLike | ExactMatrix | Any | None,
    C: ArrayLike | ExactMatrix | Any | None,
    D: ArrayLike | ExactMatrix | Any | None,
    X: Cone | ArrayLike,
    U: Cone | ArrayLike | None = None,
    Y: Cone | ArrayLike | None = None,
    *,
    discrete: bool = False,
) -> PositivityCertificate:
    """Decide whether a system is positive with respect to the cones (X, U, Y): Theorem 1.

    Parameters
    ----------
    A, B, C, D : array_like or sparse matrix, shapes (n, n), (n, m), (q, n), (q, m)
        B, C, D may be None; the inclusion that needs it is then not claimed.
    X, U, Y : Cone, or array_like of its generators
        Polyhedral proper cones in R^n, R^m, R^q.
    discrete : bool
        True for x[k+1] = A x[k] + B u[k].

    Returns
    -------
    PositivityCertificate
        PROVED, or REFUTED with the violated pair of facet and generator.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Sizes that do not fit, numbers that are not finite and real, cones that are not proper.

    Examples
    --------
    >>> import control_kpos as kp
    >>> X = kp.PolyhedralCone([[0, 1], [1, -2]])
    >>> cert = kp.cone_positivity([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], [[0]],
    ...                           X, kp.orthant(1), kp.orthant(1))
    >>> bool(cert), cert.margin
    (True, 0.0)
    """
    X = as_cone(X, "X")
    U, Y = (None if cone is None else as_cone(cone, name) for cone, name in ((U, "U"), (Y, "Y")))
    A = square_matrix(A, X)
    n = X.dim
    data: dict[str, Any] = {}
    for name, matrix, target, source in (("B", B, X, U), ("C", C, Y, X), ("D", D, Y, U)):
        if matrix is None or target is None or source is None:
            continue
        exact = exact_matrix(matrix, name)
        if name == "D" and exact.shape == (1, 1) and not np.any(exact.values) and (target.dim, source.dim) != (1, 1):
            exact = ExactMatrix(np.zeros((target.dim, source.dim)))  # D = 0, as in control.ss
        data[name] = require_shape(exact, name, (target.dim, source.dim), _sizes(name, n))
    for name, cone in (("U", U), ("Y", Y)):
        if cone is not None:
            cone.require_proper(name)
            data[name] = cone
    return settle_positivity(A=A, X=X, discrete=flag(discrete, "discrete"), **data)


P = TypeVar("P", bound="ClaimOnPositivity")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClaimOnPositivity(Certificate):
    """A claim about a positive system, resting on the proof that it is positive.

    Attributes
    ----------
    positivity : PositivityCertificate
        The proof, with the data of the system.
    """

    positivity: PositivityCertificate

    def parts(self) -> Sequence[Certificate]:
        """The certificate of positivity."""
        return (self.positivity,)

    def contents(self) -> dict[str, Any]:
        """The data of `positivity` and the fields."""
        return {**self.positivity.contents(), **{k: x for k, x in self.data().items() if k != "positivity"}}

    @classmethod
    def restore(cls: type[P], contents: dict[str, Any]) -> P:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By field, those of the certificate of positivity among them.
        """
        own = {f.name: contents[f.name] for f in fields(cls) if f.name in contents}
        system = {key: value for key, value in contents.items() if key not in own}
        witness = contents.get("witness")
        violation = witness if isinstance(witness, PositivityViolation) else None
        return cls.settle(positivity=PositivityCertificate.settle(**system, witness=violation), **own)


def settle_positivity(**data: Any) -> PositivityCertificate:
    """The certificate for data already read, with the worst violation as witness if there is one."""
    draft = PositivityCertificate.settle(**data)
    if draft:
        return draft
    found: list[tuple[float, Condition, tuple[int, ...]]] = []
    for condition in draft.conditions():
        place = condition.worst_violation()
        if place is not None:
            found.append((condition.margin, condition, place))
    if not found:
        return draft
    _, condition, (facet, ray) = min(found, key=lambda item: item[0])
    normal = take_rows(condition.forms.left, np.array([facet]))
    generator = take_rows(condition.forms.right, np.array([ray]))
    value = float(BilinearForms(normal, condition.forms.middle, generator).values[0, 0])
    violation = PositivityViolation(
        _MEANING[condition.name], facet, ray, dense_row(normal), dense_row(generator), value
    )
    return PositivityCertificate.settle(**data, witness=violation)


def square_matrix(A: ArrayLike | ExactMatrix | Any, X: Cone, name: str = "A") -> ExactMatrix:
    """A as exact data, square and of the size of the proper cone X."""
    X.require_proper("X")
    exact = exact_matrix(A, name)
    return require_shape(exact, name, (X.dim, X.dim), f"the cone X has dimension {X.dim}")


def take_rows(m: ExactMatrix, index: NDArray[np.intp]) -> ExactMatrix:
    """Some rows of a two-dimensional exact matrix, dense."""
    values = m.values[index]
    values = values.toarray() if m.is_sparse else np.asarray(values)
    if m.is_double:
        return ExactMatrix(values)
    radius = None if m.radius is None else m.radius[index]
    return ExactMatrix(values, radius, integer_rows=_RowsOf(m, index))


@dataclass(frozen=True)
class _RowsOf:
    matrix: ExactMatrix
    index: NDArray[np.intp]

    def __call__(self, index: NDArray[np.intp]) -> Any:
        return self.matrix.rows_as_integers(self.index[index])


def dense_row(m: ExactMatrix) -> NDArray[np.float64]:
    """The single row of a dense 1 x n matrix."""
    return np.array(m.values[0], dtype=float)


def _parallel(a: Any, b: NDArray[np.float64]) -> bool:
    a = np.asarray(a, dtype=float)
    if a.shape != b.shape or not np.isfinite(a).all():
        return False
    top_a, top_b = np.abs(a).max(initial=0.0), np.abs(b).max(initial=0.0)
    return bool(top_a > 0 and top_b > 0 and np.abs(a / top_a - b / top_b).max() < 1e-12)


def _sizes(name: str, n: int) -> str:
    return {
        "B": f"n = {n} rows, one column per dimension of U",
        "C": f"one row per dimension of Y, n = {n} columns",
    }.get(name, "one row per dimension of Y, one column per dimension of U")
