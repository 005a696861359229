"""Proof that a proper polyhedral cone is invariant, from generators alone.

    A R = R P,  P off-diagonal >= 0  (discrete time: P >= 0),
    w'R > 0                          (the cone is pointed),
    R Y = I for some Y               (the cone is solid)

prove e^{At} X inside X (A X inside X) for X = cone of the columns of R, without a facet: in dimension
30 a cone with 45 generators has far too many of them.  The sign conditions are proven in floating
point with rounding bounds; see `exact.enclosure`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cones import orthant
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.enclosure import Generators
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate
from ..proof.generators_in_files import generator_proof
from ..proof.portable_cones import encode_generators, given_generators
from ..proof.weights import ProofOmittedError, Prover
from .impossible.port_obstruction import Between


@runtime_checkable
class Obstruction(Protocol):
    """Why no invariant cone exists: a witness that can be checked against the matrices."""

    def conditions(self, matrices: Matrix, *, discrete: bool) -> Sequence[Condition] | None:
        """What has to hold for the obstruction to be real; None if the data do not fit."""
        ...

    def evidence(self, matrices: Matrix, *, discrete: bool) -> dict[str, Any]:
        """What a checker without this package needs besides."""
        ...

    def restated(self, matrices: Matrix, *, discrete: bool) -> Obstruction:
        """The obstruction with what files leave out: numbers for texts, computed from the matrices."""
        ...


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ConeCertificate(Certificate):
    """Proof that one proper polyhedral cone is invariant under every A_s, or that none exists.

    Attributes
    ----------
    matrices : Matrix, shape (M, n, n)
        A_1..A_M.
    discrete : bool
        True: A_s X in X; False: e^{A_s t} X in X.
    rays : Matrix, shape (N, n), or None
        Generators, one a row: R transposed.
    multipliers : Matrix, shape (M, N, N), or sparse, shape (N, N)
        P_s with A_s R = R P_s up to an error that the proof takes up.  Sparse for one matrix and very many
        generators.
    pointing : ndarray, shape (n,)
        w with w'x > 0 for every generator.
    right_inverse : ndarray, shape (N, n)
        Y with R Y close to the identity.
    contains : Matrix, shape (k, n), or None
        Vectors that lie in the cone, such as the columns of B.
    shares : Matrix, shape (k, N), or None
        Each of them (`by_facets`: each row of `within`) as a combination of the generators.
    within : Matrix, shape (r, n), or None
        Normals of half-spaces that hold the cone, such as the rows of C.
    by_facets : bool
        True: `rays` holds the facet normals of the cone instead, and the proof is about the dual cone
        and the transposed matrices, which is the same claim.
    v : ndarray, shape (n,), or None
        Common Lyapunov vector: v'x > 0, v'A_s x < 0 (discrete: v'A_s x < v'x) on the cone.
    witness : Obstruction or None
        Why no such cone exists.
    """

    claim: ClassVar[str] = "invariant-cone"

    matrices: Matrix
    discrete: bool = False
    rays: Matrix | None = None
    multipliers: Matrix | None = None
    pointing: NDArray[np.float64] | None = None
    right_inverse: NDArray[np.float64] | None = None
    contains: Matrix | None = None
    shares: Matrix | None = None
    within: Matrix | None = None
    by_facets: bool = False
    v: NDArray[np.float64] | None = None

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        if self.rays is None or self.multipliers is None or self.pointing is None or self.right_inverse is None:
            return [Condition("no cone", _forms(Matrix(np.ones((1, 1))), Matrix(np.ones((1, 1)))), "<")]
        rays = self.rays
        matrices = self.matrices.T if self.by_facets else self.matrices
        contains, within = (self.within, self.contains) if self.by_facets else (self.contains, self.within)
        basis = Generators(rays, self.right_inverse)
        out: list[Condition] = [basis.pointed(self.pointing), basis.solid()]
        if self.multipliers.is_sparse and self.matrices.shape[0] != 1:
            raise DataError("sparse multipliers are for one matrix; a family has a stack of dense ones.")
        for s in range(self.matrices.shape[0]):
            P = self.multipliers if self.multipliers.is_sparse else self.multipliers[s]
            out.append(basis.images(f"A{s} R = R P{s}", matrices[s], rays, P, diagonal=self.discrete))
        if contains is not None:
            if self.shares is None:
                raise ValueError("vectors to contain come without their combinations")
            out.append(basis.images("b = R q", Matrix.identity(rays.shape[1]), contains, self.shares.T))
        if within is not None:
            out.append(Condition("c'x >= 0", _forms(within, rays), ">="))
        if self.v is not None:
            if self.by_facets or np.shape(self.v) != (rays.shape[1],):
                raise DataError("a Lyapunov vector is proven on generators, and fits them; by_facets has none.")
            out.append(Condition("v'x > 0", _forms(_row(self.v), rays), ">"))
            out += [self._decrease(s, self.v, rays) for s in range(self.matrices.shape[0])]
        return out

    def _decrease(self, s: int, v: NDArray[np.float64], rays: Matrix) -> Condition:
        A = self.matrices[s]
        if not self.discrete:
            return Condition(f"v'A{s} x < 0", BilinearForms(_row(v), A, rays), "<")
        from_identity = Matrix.from_fractions(A.fractions() - np.eye(A.shape[0], dtype=int).astype(object))
        return Condition(f"v'(A{s} - I) x < 0", BilinearForms(_row(v), from_identity, rays), "<")

    def refutation(self) -> Sequence[Condition] | None:
        """The conditions on the obstruction."""
        if not isinstance(self.witness, Obstruction):
            return None
        return self.witness.conditions(self.matrices, discrete=self.discrete)

    def contents(self) -> dict[str, Any]:
        """The cone as X, the matrices as A, what it contains and lies in as B and C; dual if `by_facets`."""
        out = self.data()
        if self.rays is None or self.pointing is None:
            return out
        matrices, inner, outer = self._sides()
        for name in ("matrices", "rays", "contains", "within"):
            del out[name]
        out["A"] = tuple(matrices[s] for s in range(matrices.shape[0]))
        out["X"] = encode_generators(self.rays, self.pointing)
        if inner is not None:
            out.update(B=inner.T, U=orthant(inner.shape[0]))
        if outer is not None:
            out.update(C=outer, Y=orthant(outer.shape[0]))
        return out

    @classmethod
    def _completed(cls, contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any]) -> dict[str, Any]:
        """The contents with the weights that prove a cone."""
        if "X" not in contents:
            return contents
        found = generator_proof(contents, data, proof)
        shares = None if found.shares is None else found.shares.T
        numbers = {"multipliers": found.multipliers, "pointing": found.pointing, "right_inverse": found.right_inverse}
        return {**contents, **numbers, "shares": shares}

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> ConeCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        if "X" not in contents:
            return cls._refuted(**contents)
        rest = {key: value for key, value in contents.items() if key not in "ABCXUY"}
        if not contents["A"]:
            raise DataError("there is no matrix.")
        matrices = Matrix.stack([A.dense() for A in contents["A"]])
        inner, outer = contents.get("B"), contents.get("C")
        for M, k, name in ((inner, 1, "U"), (outer, 0, "Y")):
            if M is not None and contents.get(name) != orthant(M.shape[k]):
                raise DataError(f"{name} must be an orthant.")
        inner = None if inner is None else inner.T
        if rest.get("by_facets"):
            matrices, inner, outer = matrices.T, outer, inner
        rays = given_generators(contents["X"])
        return cls.settle(matrices=matrices, rays=rays, contains=inner, within=outer, **rest)

    @classmethod
    def _refuted(cls, *, witness: Any, **contents: Any) -> ConeCertificate:
        """A certificate that there is no cone, from the contents of a file."""
        if isinstance(witness, Obstruction):
            question = cls(**contents)
            if isinstance(witness, Between) and not witness.concerns(question.contains, question.within):
                raise DataError("the obstruction is about ports that the question does not have.")
            witness = witness.restated(question.matrices, discrete=question.discrete)
        return cls.settle(**contents, witness=witness)

    def _sides(self) -> tuple[Matrix, Matrix | None, Matrix | None]:
        """The matrices, vectors in the cone and normals on it, of the cone that `rays` generates."""
        if self.by_facets:
            return self.matrices.T, self.within, self.contains
        return self.matrices, self.contains, self.within

    def evidence(self) -> dict[str, Any]:
        """The multipliers, and the weights of vectors that the cone contains, without their rounding errors."""
        if self.witness is not None:
            return self.witness.evidence(self.matrices, discrete=self.discrete)
        if self.rays is None or self.multipliers is None:
            raise ProofOmittedError("no cone is claimed, and none excluded")
        prover, rays, (matrices, inner, _) = Prover(), self.rays, self._sides()
        each, free = [matrices[s] for s in range(matrices.shape[0])], not self.discrete
        if self.multipliers.is_sparse and self.right_inverse is not None:
            support = np.flatnonzero((self.right_inverse != 0).any(axis=1))
            P = sp.csr_array(self.multipliers.values)
            out = {"P": [prover.repaired_map(rays, A, P, support, invariance=free) for A in each]}
        else:
            images = [A.fractions() @ rays.fractions().T for A in each]
            guesses = [self.multipliers[s] for s in range(len(each))]
            out = {"P": [prover.repaired(rays, y, P, invariance=free) for y, P in zip(images, guesses, strict=True)]}
        if inner is not None and self.shares is not None:
            out["N"] = prover.repaired(rays, inner.fractions().T, self.shares.T)
        return out

    def explain(self) -> str:
        """A few sentences a person can act on."""
        if self.refuted_by is not None:
            return f"No invariant proper polyhedral cone {self._scope()}: {self.witness}."
        if not self:
            return "Undecided: no cone was proven, and none was excluded."
        kind = "facets" if self.by_facets else "generators"
        n_rays, n = self.rays.shape if self.rays is not None else (0, 0)
        family = "A" if self.matrices.shape[0] == 1 else f"each of the {self.matrices.shape[0]} matrices"
        more = "" if self.contains is None else ", holds the vectors asked for"
        more += "" if self.within is None else ", lies in the half-spaces asked for"
        more += "" if self.v is None else "; v'x is a common Lyapunov function on it"
        return (
            f"Proved: the cone of {n_rays} {kind} in dimension {n} is pointed, solid and invariant under "
            f"{family}{more}. "
            f"Scale-free margin {self.margin:.3g}."
        )

    def _scope(self) -> str:
        """What it is that no cone does."""
        if isinstance(self.witness, Between):
            return "holds the vectors and lies in the half-spaces asked for"
        return "exists" if self.matrices.shape[0] == 1 else f"is common to the {self.matrices.shape[0]} matrices"


def _forms(left: Matrix, right: Matrix) -> BilinearForms:
    return BilinearForms(left, None, right)


def _row(v: NDArray[np.float64]) -> Matrix:
    return Matrix(np.asarray(v, dtype=float)[None, :])
