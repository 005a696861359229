"""Inclusions M S in T of cones: Theorem 1, its proof on facets or from generators, and what breaks it.

Theorem 1 (Kawano and Forni, Theorem `cone_inv`).  x' = A x + B u, y = C x + D u keeps x in X and y in
Y for all x(0) in X and u(t) in U if and only if

    h'A x_i >= 0   for every facet h and generator x_i of X with h'x_i = 0,
    B U in X,   C X in Y,   D U in Y.

In discrete time the first line is A X in X.  M S lies in T if and only if h'M x_i >= 0 for every facet h of T and
every generator x_i of S.  D is not in the paper; a static system needs the last inclusion.

From generators alone, the columns of R, of a cone with too many facets to list:

    A R = R P,  P off-diagonal >= 0  (discrete time: P >= 0),      B u_i = R n_i,  n_i >= 0,
    w'R > 0                          (the cone is pointed),
    R Y = I for some Y               (the cone is solid).

For polyhedral cones this is necessary too.  A column of P that does not exist has a reason, by Farkas' lemma: a vector
h with h'x >= 0 on all generators, h'x_j = 0 and h'A x_j < 0, a supporting hyperplane that the field crosses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cards import about, shown
from ..cones import Cone
from ..errors import DataError, ShapeError
from ..exact.condition import Condition
from ..exact.enclosure import Generators
from ..exact.intake import require_shape
from ..exact.matrix import Matrix
from ..exact.products import exact_product
from ..exact.signs import BilinearForms
from .encoding import LATER, register_record
from .portable_cones import own_generators, portable
from .weights import Prover

# What is required of each matrix of a system, h being a facet of the cone it maps into, and what that means.
NAMES = {"A": "h'A x >= 0", "B": "h'B u >= 0", "C": "h'C x >= 0", "D": "h'D u >= 0"}
MEANING = {"A": "A X in X", "B": "B U in X", "C": "C X in Y", "D": "D U in Y"}
_STATE, _INPUT, _SUPPORTING = "A R = R P", "B U = R N", "h'x >= 0 on X"
# Conditions that say nothing about how far the system is from losing positivity, or a violation from being none.
NO_MARGIN = frozenset({"w'x > 0", "R Y = I", _SUPPORTING})


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
        normal' M generator < 0, correctly rounded (its sign is proven for the exact rows).
    """

    computed: ClassVar[tuple[str, ...]] = ("facet", "normal", "generator", "value")

    condition: str
    facet: int = LATER
    ray: int = LATER
    normal: NDArray[np.float64] = LATER
    generator: NDArray[np.float64] = LATER
    value: float = LATER

    def __str__(self) -> str:
        return (
            f"{self.condition} fails at facet {self.facet}, normal {shown(self.normal)}, and generator "
            f"{self.ray}, {shown(self.generator)}: the product is {about(self.value, digits=3)} < 0"
        )


@register_record
@dataclass(frozen=True, eq=False)
class PlaneViolation(PositivityViolation):
    """A supporting hyperplane and a generator that break an inclusion, found without facets.

    Attributes
    ----------
    facet : int
        -1: facets have not been enumerated.
    ray : int
        Row number among the generators of the source cone as they were given.
    normal : ndarray
        Rounded; no generator of the target cone is on its negative side.
    normal_exact : tuple of Fraction
        The exact normal.
    """

    normal_exact: tuple[Fraction, ...] = ()

    def __str__(self) -> str:
        return (
            f"{self.condition} fails at the supporting plane with normal {shown(self.normal)} and generator "
            f"{self.ray}, {shown(self.generator)}: the product is {about(self.value, digits=3)} < 0"
        )

    def exact_normal(self) -> Matrix:
        """The normal as a 1 x n matrix."""
        return _row_of(self.normal_exact)


@dataclass(frozen=True, eq=False)
class Inclusion:
    """The claim that M maps one cone into another, or that e^{Mt} keeps a cone for t >= 0.

    Attributes
    ----------
    name : str
        What the matrix is called: "A", "B", "C" or "D".
    target : Cone
    M : Matrix, shape (target.dim, source.dim)
    source : Cone
    flow : bool
        True: the claim is that e^{Mt} keeps the source for t >= 0; the target is then the same cone.
    generators : Matrix or None
        Of the source, where its extreme ones are not known; None: `source.exact_rays`.
    """

    name: str
    target: Cone
    M: Matrix
    source: Cone
    flow: bool = False
    generators: Matrix | None = None

    def condition(self) -> Condition:
        """h'M x_i >= 0 for all pairs, or for a flow those with h'x_i = 0."""
        forms = BilinearForms(self.target.exact_facets, self.M, self._rays())
        where = None
        if self.flow:
            where = _incident_entries(forms, self.source) if forms.is_sparse else self.source.incidence
        return Condition(NAMES[self.name], forms, ">=", where)

    def violation(self, facet: int, ray: int) -> PositivityViolation:
        """What to show of a facet of the target and a generator of the source."""
        h, x = _vector(self.target.exact_facets, facet), _vector(self._rays(), ray)
        return PositivityViolation(MEANING[self.name], facet, ray, h, x, self._product(h, x))

    def crossing(self, normal: Sequence[Fraction] | NDArray[np.object_], ray: int) -> PlaneViolation:
        """What to show of a supporting hyperplane of the target and a generator as it was given.

        Parameters
        ----------
        normal : sequence of Fraction
            Of any length.
        ray : int
        """
        top = max(abs(Fraction(x)) for x in normal)
        power = Fraction(2) ** (top.numerator.bit_length() - top.denominator.bit_length())
        exact = tuple(Fraction(x) / power for x in normal)
        h, x = _vector(_row_of(exact), 0), _vector(self._given_rays(), ray)
        return PlaneViolation(MEANING[self.name], -1, ray, h, x, self._product(h, x), exact)

    def restated(self, w: PositivityViolation) -> PositivityViolation:
        """The violation with normal, generator and value, which files leave out, that belong to its numbers.

        Raises
        ------
        IndexError, DataError, ShapeError
            There are no such facet, generator or normal.
        """
        if not isinstance(w, PlaneViolation):
            facet = w.facet if w.facet is not None else self._worst_facet(w.ray)
            return self.violation(facet, w.ray)
        normal = w.exact_normal()
        require_shape(normal, "the normal", (1, self.target.dim))
        h, x = _vector(normal, 0), _vector(self._given_rays(), w.ray)
        return replace(w, normal=h, generator=x, value=self._product(h, x))

    def broken_by(self, w: PositivityViolation) -> list[Condition] | None:
        """The inequalities that a violation breaks; None if it is about other vectors than it shows."""
        try:
            same = _shows_the_same(w, self.restated(w))
        except (IndexError, DataError, ShapeError):
            return None
        if not same:
            return None
        plane = isinstance(w, PlaneViolation)
        normal = w.exact_normal() if plane else self.target.exact_facets[np.array([w.facet])].dense()
        generator = (self._given_rays() if plane else self._rays())[np.array([w.ray])].dense()
        out = [Condition(f"{w.condition}: z < 0", BilinearForms(normal, self.M, generator), "<")]
        if plane:
            supporting = BilinearForms(normal, None, own_generators(self.target))
            out.append(Condition(_SUPPORTING, supporting, ">="))
        if self.flow:
            out.append(Condition("h'x = 0", BilinearForms(normal, None, generator), "=="))
        return out

    def evidence(self, prover: Prover, guess: Matrix | None = None) -> Any:
        """Weights of M x_i in terms of the generators of the target, as JSON data.

        Parameters
        ----------
        prover : Prover
        guess : Matrix, shape (N, number of generators of the source), or None
            The weights up to rounding, where the target is known by its generators only.
        """
        if guess is None:
            return prover.inclusion(self.target, self.M, self.source, invariance=self.flow, source_rays=self.generators)
        vectors = portable(self.source.exact_rays) if self.generators is None else self.generators
        images = self.M.plain().fractions() @ vectors.fractions().T
        return prover.repaired(own_generators(self.target), images, guess, invariance=self.flow)

    def _worst_facet(self, ray: int) -> int:
        return worst_facet(row_of(self._rays(), ray), self.M, self.target.exact_facets, flow=self.flow)

    def _rays(self) -> Matrix:
        return self.source.exact_rays if self.generators is None else self.generators

    def _given_rays(self) -> Matrix:
        own = self.flow or self.source is self.target
        return own_generators(self.source) if own else portable(self.source.exact_rays)

    def _product(self, h: NDArray[np.float64], x: NDArray[np.float64]) -> float:
        """h'M x for doubles h and x, correctly rounded."""
        rows, columns = np.flatnonzero(h), np.flatnonzero(x)
        if not rows.size or not columns.size:
            return 0.0
        block = self.M[rows].T[columns].T.dense()
        image = exact_product(block, Matrix(x[None, columns]))
        return float(exact_product(Matrix(h[None, rows]), image.T).values[0, 0])


@register_record
@dataclass(frozen=True, eq=False)
class GeneratorProof:
    """Positivity without facets: A R = R P and B U = R N with nonnegative weights.

    Attributes
    ----------
    pointing : ndarray, shape (n,)
        w with w'x > 0 for every generator.
    right_inverse : ndarray, shape (N, n)
        Y with R Y close to the identity.
    multipliers : Matrix, shape (N, N), or None
        P with A R = R P up to an error that the proof takes up; None beside a violation.
    shares : Matrix, shape (N, k), or None
        B u_i = R n_i likewise, for the generators u_i of U.
    """

    pointing: NDArray[np.float64] = LATER
    right_inverse: NDArray[np.float64] = LATER
    multipliers: Matrix | None = None
    shares: Matrix | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                view = value.view()
                view.flags.writeable = False
                object.__setattr__(self, field.name, view)

    def conditions(self, A: Matrix, X: Cone, B: Matrix | None, U: Cone | None, *, discrete: bool) -> list[Condition]:
        """The inequalities and equations above, proven from the data and nothing else."""
        rays = own_generators(X)
        basis = Generators(rays, self.right_inverse)
        out: list[Condition] = [basis.pointed(self.pointing), basis.solid()]
        if self.multipliers is None:
            raise DataError("the multipliers are missing.")
        out.append(basis.images(_STATE, A.plain(), rays, self.multipliers, diagonal=discrete))
        if B is not None and U is not None:
            if self.shares is None:
                raise DataError("the weights of the inputs are missing.")
            out.append(basis.images(_INPUT, B.plain(), portable(U.exact_rays), self.shares))
        return out


def _shows_the_same(w: PositivityViolation, other: PositivityViolation) -> bool:
    return (
        np.array_equal(w.normal, other.normal)
        and np.array_equal(w.generator, other.generator)
        and w.value == other.value
    )


def worst_facet(x: Matrix, M: Matrix, facets: Matrix, *, flow: bool) -> int:
    """The number of the facet through which M takes a generator x farthest; for a flow, of those that x lies on.

    Raises
    ------
    DataError
        There is none.
    """
    where = BilinearForms(x, None, facets).signs() == 0 if flow else None
    place = Condition("", BilinearForms(x, M.T, facets), ">=", where).worst_violation()
    if place is None:
        raise DataError("the generator of the witness leaves through no facet.")
    return place[1]


def row_of(rows: Matrix, index: int) -> Matrix:
    """One row, 1 x n; IndexError if there is none."""
    if not 0 <= index < rows.shape[0]:
        raise IndexError(index)
    return rows[np.array([index])].dense()


def _vector(rows: Matrix, index: int) -> NDArray[np.float64]:
    """One row as doubles; IndexError if there is none."""
    return row_of(rows, index).values[0].copy()


def _row_of(numbers: tuple[Fraction, ...]) -> Matrix:
    row = np.empty((1, len(numbers)), dtype=object)
    row[0] = numbers
    return Matrix.from_fractions(row)


def _incident_entries(forms: BilinearForms, X: Cone) -> NDArray[np.bool_]:
    """Entries of a sparse pattern where h'x_i = 0."""
    apart = BilinearForms(X.exact_facets, None, X.exact_rays).signs()
    apart.data = (apart.data != 0).astype(np.int8)
    apart.eliminate_zeros()
    shape = forms.pattern.shape
    keys = np.repeat(np.arange(shape[0]), np.diff(forms.pattern.indptr)) * shape[1] + forms.pattern.indices
    apart_keys = np.repeat(np.arange(shape[0]), np.diff(apart.indptr)) * shape[1] + apart.indices
    return ~np.isin(keys, apart_keys)
