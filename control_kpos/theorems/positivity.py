"""Positivity of a system with respect to polyhedral proper cones X, U, Y.

Theorem 1 (Kawano and Forni, Theorem `cone_inv`).  x' = A x + B u, y = C x + D u keeps x in X and y in
Y for all x(0) in X and u(t) in U if and only if

    h'A x_i >= 0   for every facet h and generator x_i of X with h'x_i = 0,
    B U in X,   C X in Y,   D U in Y,

each inclusion read on generators and facets.  In discrete time the first line is A X in X: h'A x_i >= 0
for every facet and generator.  The inequalities, and the proof from generators where X has too many facets to list,
are in `proof.inclusion`.
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
from ..proof.certificate import Certificate, Status
from ..proof.encoding import require_kinds
from ..proof.generators_in_files import generator_proof
from ..proof.in_time import unfinished
from ..proof.inclusion import MEANING, NAMES, NO_MARGIN, GeneratorProof, Inclusion, PlaneViolation, PositivityViolation
from ..proof.portable_cones import encode_generators, own_generators
from ..proof.proposed_weights import prove
from ..proof.weights import Prover, crossed_facet
from ..systems.system import System

_WEIGHTS = {"A": "P", "B": "N", "C": "L", "D": "K"}


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

    def inclusions(self) -> list[Inclusion]:
        """The inclusions that are claimed."""
        own = None if self.generator_proof is None else own_generators(self.X)
        maps = [
            ("A", self.X, self.A, self.X, not self.discrete, own),
            ("B", self.X, self.B, self.U, False, None),
            ("C", self.Y, self.C, self.X, False, own),
            ("D", self.Y, self.D, self.U, False, None),
        ]
        return [
            Inclusion(name, target, M, source, flow, generators)
            for name, target, M, source, flow, generators in maps
            if target is not None and M is not None and source is not None
        ]

    def conditions(self) -> Sequence[Condition]:
        """The inclusions of Theorem 1, those into X by facets or from generators."""
        if self.A is None and self.X.dim:
            raise DataError("A is missing: this is about x' = A x.")
        proof, inclusions = self.generator_proof, self.inclusions()
        if proof is None:
            return [inclusion.condition() for inclusion in inclusions]
        into_X = proof.conditions(self.A, self.X, self.B, self.U, discrete=self.discrete)
        return [*into_X, *(inclusion.condition() for inclusion in inclusions if inclusion.name in "CD")]

    def refutation(self) -> Sequence[Condition] | None:
        """The inequality that the facet and generator of the witness break."""
        w = self.witness
        if not isinstance(w, PositivityViolation):
            return None
        broken = self._broken(w)
        if broken is None:
            return None
        by_facet = not isinstance(w, PlaneViolation)
        if by_facet and self.generator_proof is not None and broken.name in "AB":
            return None  # the facets of X are too many to list
        return broken.broken_by(w)

    def _broken(self, w: PositivityViolation) -> Inclusion | None:
        return next((inclusion for inclusion in self.inclusions() if MEANING[inclusion.name] == w.condition), None)

    @classmethod
    def _completed(cls, contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any]) -> dict[str, Any]:
        """The contents with the proof from generators, if it is one."""
        return _with_generators(contents, data, proof)

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> PositivityCertificate:
        """The inverse of `contents`; what a violation shows is computed afresh.

        Parameters
        ----------
        contents : dict
            By field.
        """
        require_kinds(cls, contents)
        draft = cls(**contents)
        draft._require_fit()
        return cls.settle(**{**contents, "witness": draft.restated()})

    def _require_fit(self) -> None:
        """Raise DataError unless all matrices are there that the cones ask for, and only they, in their sizes."""
        n, m, q = (0 if cone is None else cone.dim for cone in (self.X, self.U, self.Y))
        for M, shape in ((self.A, (n, n)), (self.B, (n, m)), (self.C, (q, n)), (self.D, (q, m))):
            if (M is None) != (0 in shape) or (M is not None and M.shape != shape):
                raise DataError(f"a matrix is not {shape[0]} x {shape[1]}, as the cones have it.")

    def restated(self) -> Any:
        """The witness, with the normal, generator and value that belong to its numbers if these fit."""
        w = self.witness
        broken = self._broken(w) if isinstance(w, PositivityViolation) else None
        try:
            return w if broken is None else broken.restated(w)
        except (ValueError, IndexError):
            return w

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
        proof, w = self.generator_proof, self.witness
        if isinstance(w, PlaneViolation):
            return {}
        if isinstance(w, PositivityViolation):
            broken = self._broken(w)
            if broken is None:
                raise DataError(f"{w.condition} is not claimed.")
            return crossed_facet(broken.target, w.facet)
        prover = Prover()
        guesses = {} if proof is None else {"A": proof.multipliers, "B": proof.shares}
        return {
            _WEIGHTS[inclusion.name]: inclusion.evidence(prover, guesses.get(inclusion.name))
            for inclusion in self.inclusions()
        }

    def _by_name(self) -> str:
        """Who the facet and the generator of the witness are."""
        kinds = {"A": ("states", "states"), "B": ("states", "inputs"), "C": ("outputs", "states")}
        letter = getattr(self.witness, "condition", "A")[0]
        return self._signals.legend(str(self.witness), *kinds.get(letter, ("outputs", "inputs")))

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
        if self.refuted_by is not None:
            where = f"{self.witness}.{self._by_name()}"
            return (
                f"Not positive: {where} Choose another cone, or a feedback that turns the field inwards on this facet."
            )
        if unfinished(self):
            return unfinished(self)
        return "Undecided: some signs could not be proven at this size. Give the data with fewer digits."


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
        exact, shape = exact_matrix(matrix, name), (target.dim, source.dim)
        if name == "D" and exact.shape == (1, 1) and not np.any(exact.values) and shape != (1, 1):
            exact = Matrix.zeros(*shape)  # D = 0, as in control.ss
        data[name] = require_shape(exact, name, shape, _sizes(name, n))
    for name, cone in (("U", U), ("Y", Y)):
        if cone is not None:
            cone.require_proper(name)
            data[name] = cone
    return _decided(**data, A=A, X=X, discrete=flag(discrete, "discrete"))


def positivity_of(s: System) -> PositivityCertificate:
    """Theorem 1 for a system that has been read, on proper cones; a system without states gets an idle one."""
    s = s.moving()
    A, B, C, D = s.matrices
    return _decided(A=A, B=B, C=C, D=D, X=s.X, U=s.U, Y=s.Y, discrete=s.discrete)


@np.errstate(all="ignore")
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
    def _completed(cls, contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any]) -> dict[str, Any]:
        """The contents with the proof from generators, if it is one."""
        return _with_generators(contents, data, proof)

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
        positivity = PositivityCertificate.restore({**system, "witness": violation})
        if violation is not None:
            own["witness"] = positivity.witness
        return cls.settle(positivity=positivity, **own)


def _with_generators(contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(contents.get("generator_proof"), GeneratorProof):
        return contents
    return {**contents, "generator_proof": generator_proof(contents, data, proof)}


@np.errstate(all="ignore")
def positivity_from_generators(**data: Any) -> PositivityCertificate | None:
    """The certificate for data already read, without a facet of X; None if generators alone do not decide."""
    s = PositivityCertificate(**data)
    found = prove(s.A, s.X, s.B, s.U, discrete=s.discrete)
    if found is None:
        return None
    proof, crossing = found
    if crossing is None:
        settled = PositivityCertificate.settle(**data, generator_proof=proof)
        witness = None if settled else _worst(settled)
    else:
        settled, broken = s, next(inclusion for inclusion in s.inclusions() if inclusion.name == crossing.matrix)
        witness = broken.crossing(crossing.normal, crossing.ray)
    if witness is not None:
        settled = PositivityCertificate.settle(**data, generator_proof=proof, witness=witness)
    return None if settled.status is Status.UNDECIDED else settled


@np.errstate(all="ignore")
def settle_positivity(**data: Any) -> PositivityCertificate:
    """The certificate for data already read, with the worst violation as witness if there is one."""
    draft = PositivityCertificate.settle(**data)
    if draft:
        return draft
    witness = _worst(draft)
    return draft if witness is None else PositivityCertificate.settle(**data, witness=witness)


def _worst(draft: PositivityCertificate) -> PositivityViolation | None:
    """The proven violation of largest relative size."""
    conditions = {condition.name: condition for condition in draft._own_conditions}
    found: list[tuple[float, Inclusion, tuple[int, ...]]] = []
    for inclusion in draft.inclusions():
        condition = conditions.get(NAMES[inclusion.name])
        place = None if condition is None else condition.worst_violation()
        if condition is not None and place is not None:
            found.append((condition.margin, inclusion, place))
    if not found:
        return None
    _, inclusion, (facet, ray) = min(found, key=lambda item: item[0])
    return inclusion.violation(facet, ray)


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
