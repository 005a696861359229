"""Positivity of a system with respect to polyhedral proper cones X, U, Y.

Theorem 1 (Kawano and Forni, Theorem `cone_inv`).  x' = A x + B u, y = C x + D u keeps x in X and y in
Y for all x(0) in X and u(t) in U if and only if

    h'A x_i >= 0   for every facet h and generator x_i of X with h'x_i = 0,
    B U in X,   C X in Y,   D U in Y,

each inclusion read on generators and facets.  In discrete time the first line is A X in X: h'A x_i >= 0
for every facet and generator.  D is not in the paper; a static system needs the last inclusion.

Where X has too many facets to list, its generators prove the same: see `generators.inclusion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..cones import Cone, as_cone
from ..cones.polyhedral import has_open_facets
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.intake import exact_matrix, flag, require_shape
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Status
from ..proof.generators import (
    NO_MARGIN,
    GeneratorProof,
    own_generators,
    portable,
    prove,
)
from ..proof.inclusion import NAMES, invariance_condition
from ..proof.portable_cones import encode_generators
from ..proof.violations import PlaneViolation as PlaneViolation
from ..proof.violations import PositivityViolation as PositivityViolation
from ..proof.violations import parallel, plane_violation
from ..proof.weights import Prover, violation
from ..systems.system import System

_WEIGHTS = {"A": "P", "B": "N", "C": "L", "D": "K"}
_MEANING = {NAMES["A"]: "A X in X", NAMES["B"]: "B U in X", NAMES["C"]: "C X in Y", NAMES["D"]: "D U in Y"}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PositivityCertificate(Certificate):
    """Proof that a system is positive with respect to (X, U, Y), or a facet and generator that break it.

    Attributes
    ----------
    A, B, C, D : Matrix, or None for a system without inputs or outputs
        The data the verdict is about.
    X, U, Y : Cone, or None
    discrete : bool
        True: A X in X; False: e^{At} X in X for all t >= 0.
    generator_proof : GeneratorProof or None
        For a cone X with too many facets: the proof from its generators.  None: the proof is by facets.
    witness : PositivityViolation or None
        The proven violation of largest relative size; where facets have not been listed, a `PlaneViolation`.
    """

    claim: ClassVar[str] = "positive"
    no_margin: ClassVar[frozenset[str]] = NO_MARGIN

    A: Matrix
    X: Cone
    B: Matrix | None = None
    C: Matrix | None = None
    D: Matrix | None = None
    U: Cone | None = None
    Y: Cone | None = None
    discrete: bool = False
    generator_proof: GeneratorProof | None = None

    def system(self) -> System:
        """The data; DataError if the certificate is about A alone."""
        if self.B is None or self.C is None or self.D is None or self.U is None or self.Y is None:
            raise DataError("B, C, D and the cones U and Y are needed here; give them all.")
        return System(self.A, self.B, self.C, self.D, self.X, self.U, self.Y, dt=self.discrete)

    def conditions(self) -> Sequence[Condition]:
        """The inclusions of Theorem 1."""
        proof, rays = self.generator_proof, None
        if proof is None:
            out = [invariance_condition(self.A, self.X, discrete=self.discrete)]
        else:
            out = proof.conditions(self.A, self.X, self.B, self.U, discrete=self.discrete)
            rays = own_generators(self.X)
        for name, (target, matrix, source) in self.maps().items():
            if name == "A" or (name == "B" and proof is not None):
                continue
            generators = rays if name == "C" and rays is not None else source.exact_rays
            out.append(Condition(NAMES[name], BilinearForms(target.exact_facets, matrix, generators), ">="))
        return out

    def maps(self) -> dict[str, tuple[Cone, Matrix, Cone]]:
        """The inclusions claimed: target, matrix and source by the name of the matrix."""
        maps = {"A": (self.X, self.A, self.X), "B": (self.X, self.B, self.U), "C": (self.Y, self.C, self.X)}
        maps["D"] = (self.Y, self.D, self.U)
        return {k: (T, M, S) for k, (T, M, S) in maps.items() if M is not None and T is not None and S is not None}

    def refutation(self) -> Sequence[Condition] | None:
        """The inequality that the facet and generator of the witness break."""
        w = self.witness
        if not isinstance(w, PositivityViolation):
            return None
        if isinstance(w, PlaneViolation):
            name = w.condition[:1]
            if name not in self.maps():
                return None
            return w.conditions(*self.maps()[name], invariance=name == "A" and not self.discrete)
        condition = next((c for c in self.conditions() if _MEANING.get(c.name) == w.condition), None)
        if condition is None:
            return None
        normal = condition.forms.left[np.array([w.facet])].dense()
        generator = condition.forms.right[np.array([w.ray])].dense()
        product = BilinearForms(normal, condition.forms.middle, generator)
        out = [Condition(f"{w.condition}: z < 0", product, "<")]
        if w.condition == "A X in X" and not self.discrete:
            out.append(Condition("h'x = 0", BilinearForms(normal, None, generator), "=="))
        same = parallel(w.normal, normal.values[0].copy()) and parallel(w.generator, generator.values[0].copy())
        if not same or condition.forms.middle is None:
            return None
        own = BilinearForms(Matrix(w.normal[None]), condition.forms.middle, Matrix(w.generator[None]))
        rounding = 1e-11 * abs(w.value) + 1e-14 * own.magnitudes[0, 0]
        return out if abs(own.values[0, 0] - w.value) <= rounding else None

    def contents(self) -> dict[str, Any]:
        """The fields; X by its generators alone if the proof is."""
        out = self.data()
        if self.generator_proof is None:
            del out["generator_proof"]  # as files were before there were such proofs
        else:
            out["X"] = encode_generators(own_generators(self.X), self.generator_proof.pointing)
        return out

    def evidence(self) -> dict[str, Any]:
        """A X = X P, B U = X N, C X = Y L, D U = Y K with weights P, N, L, K; or the normal of the broken facet."""
        maps, proof, w = self.maps(), self.generator_proof, self.witness
        if isinstance(w, PlaneViolation):
            return violation(w.condition[0], w.exact_normal(), 0, w.ray)
        if isinstance(w, PositivityViolation):
            name = w.condition[0]
            return violation(name, maps[name][0].exact_facets, w.facet, w.ray)
        prover, out = Prover(), {}
        for name, (target, matrix, source) in maps.items():
            free = name == "A" and not self.discrete
            guess = None if proof is None else {"A": proof.multipliers, "B": proof.shares}.get(name)
            rays = own_generators(source) if proof is not None and name in "AC" else None
            if guess is None:
                weights = prover.inclusion(target, matrix, source, invariance=free, source_rays=rays)
            else:
                vectors = portable(source.exact_rays) if rays is None else rays
                images = matrix.plain().fractions() @ vectors.fractions().T
                weights = prover.repaired(own_generators(target), images, guess, invariance=free)
            out[_WEIGHTS[name]] = weights
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
            way = "" if self.generator_proof is None else ", from generators alone"
            return f"Proved positive: {inclusion}{more}{way}. Scale-free margin {self.margin:.3g}.{edge}"
        if self.witness is not None:
            return (
                f"Not positive: {self.witness}. Choose another cone, or a feedback that turns the field inwards "
                "on this facet."
            )
        return (
            "Undecided: some signs are out of reach of exact arithmetic at this size. Give the data with fewer digits."
        )


def state_positivity(
    A: ArrayLike | Matrix | Any, X: Cone | ArrayLike, *, discrete: bool = False
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
    Costs the facets of X once, and one product of (r, n), (n, n) and (n, p) matrices.  Where X may have
    too many facets (a cone by generators, n >= 5), p linear programs of n rows instead: 0.2 s for p = 67, n = 12.

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
    A: ArrayLike | Matrix | Any,
    B: ArrayLike | Matrix | Any | None,
    C: ArrayLike | Matrix | Any | None,
    D: ArrayLike | Matrix | Any | None,
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
            exact = Matrix.zeros(target.dim, source.dim)  # D = 0, as in control.ss
        data[name] = require_shape(exact, name, (target.dim, source.dim), _sizes(name, n))
    for name, cone in (("U", U), ("Y", Y)):
        if cone is not None:
            cone.require_proper(name)
            data[name] = cone
    return _decided(**data, A=A, X=X, discrete=flag(discrete, "discrete"))


def positivity_of(s: System) -> PositivityCertificate:
    """Theorem 1 for a system that has been read, on proper cones."""
    A, B, C, D = s.matrices
    return _decided(A=A, B=B, C=C, D=D, X=s.X, U=s.U, Y=s.Y, discrete=s.discrete)


def _decided(**data: Any) -> PositivityCertificate:
    certificate = positivity_from_generators(**data) if has_open_facets(data["X"]) else None
    return settle_positivity(**data) if certificate is None else certificate


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


def positivity_from_generators(**data: Any) -> PositivityCertificate | None:
    """The certificate for data already read, without a facet of X; None if generators alone do not decide."""
    s = PositivityCertificate(**data)
    found = prove(s.A, s.X, s.B, s.U, discrete=s.discrete)
    if found is None:
        return None
    proof, crossing = found
    if crossing is None:
        settled = PositivityCertificate.settle(**data, generator_proof=proof)
        witness = None if settled else _worst(settled.conditions())
    else:
        _, matrix, source = s.maps()[crossing.matrix]
        vectors = own_generators(s.X) if crossing.matrix == "A" else portable(source.exact_rays)
        condition = _MEANING[NAMES[crossing.matrix]]
        settled, witness = s, plane_violation(condition, crossing.normal, crossing.ray, matrix.plain(), vectors)
    if witness is not None:
        settled = PositivityCertificate.settle(**data, generator_proof=proof, witness=witness)
    return None if settled.status is Status.UNDECIDED else settled


def settle_positivity(**data: Any) -> PositivityCertificate:
    """The certificate for data already read, with the worst violation as witness if there is one."""
    draft = PositivityCertificate.settle(**data)
    if draft:
        return draft
    witness = _worst(draft.conditions())
    return draft if witness is None else PositivityCertificate.settle(**data, witness=witness)


def _worst(conditions: Sequence[Condition]) -> PositivityViolation | None:
    """The proven violation of largest relative size."""
    found: list[tuple[float, Condition, tuple[int, ...]]] = []
    for condition in conditions:
        place = condition.worst_violation() if condition.name in _MEANING else None
        if place is not None:
            found.append((condition.margin, condition, place))
    if not found:
        return None
    _, condition, (facet, ray) = min(found, key=lambda item: item[0])
    normal = condition.forms.left[np.array([facet])].dense()
    generator = condition.forms.right[np.array([ray])].dense()
    value = float(BilinearForms(normal, condition.forms.middle, generator).values[0, 0])
    return PositivityViolation(
        _MEANING[condition.name], facet, ray, normal.values[0].copy(), generator.values[0].copy(), value
    )


def square_matrix(A: ArrayLike | Matrix | Any, X: Cone, name: str = "A") -> Matrix:
    """A as exact data, square and of the size of the proper cone X."""
    X.require_proper("X")
    exact = exact_matrix(A, name)
    return require_shape(exact, name, (X.dim, X.dim), f"the cone X has dimension {X.dim}")


def _sizes(name: str, n: int) -> str:
    return {
        "B": f"n = {n} rows, one column per dimension of U",
        "C": f"one row per dimension of Y, n = {n} columns",
    }.get(name, "one row per dimension of Y, one column per dimension of U")
