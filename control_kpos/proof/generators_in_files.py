"""Proofs from generators in files: `proof` has their weights exactly, and the cone what shows it to be proper.

A R = R P, B U = R N with P, N from `proof`, w'R > 0 and R Z = I with w and Z from the cone X.  If R is square, nothing
of this stands in the file: Z is its inverse, w the sum of the rows of Z, P = Z A R and N = Z B U.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import DataError
from ..exact.matrix import Matrix
from .encoding import exact_rows
from .inclusion import GeneratorProof
from .numerals import number
from .portable_cones import Rationals, portable, spanning_inverse

# Entries of weights in files above which they are rounded and sparse.
_DENSE = 10**6


@dataclass(frozen=True)
class _Shown:
    """The generators of a cone, one a row, w and Z; `follow`: weights are Z times what they make."""

    rays: Matrix
    w: Rationals
    Z: Rationals
    follow: bool

    @classmethod
    def read(cls, cone: Sequence[Any]) -> _Shown:
        """A cone of one factor, as it stands in a file."""
        ((count, factor),) = cone
        if count != 1:
            raise DataError("a proof from generators is about one cone, and about no product.")
        rays = exact_rows(factor["rays"])
        if rays.shape[0] != rays.shape[1]:
            return cls(rays, exact_rows([factor["w"]]).fractions()[0], exact_rows(factor["Z"]).fractions(), False)
        Z = spanning_inverse(rays, rays.fractions())
        if Z is None:
            raise DataError("the generators do not span the space.")
        return cls(rays, Z.sum(axis=0), Z, True)

    def beside(self, P: Matrix) -> Rationals:
        """Z with rows only where P has no zeros, which take up its rounding; as it is if they are too few."""
        full = np.flatnonzero(np.diff(sp.csr_array(P.values).indptr) >= P.shape[1] - 1)
        short = spanning_inverse(self.rays[full], self.rays[full].fractions()) if full.size else None
        if short is None:
            return self.Z
        out = np.full(self.Z.shape, Fraction(0), dtype=object)
        out[full] = short
        return out

    def weights(self, M: Matrix, vectors: Matrix, given: Any) -> Matrix | None:
        """W with M x = sum_k W_k r_k for these vectors x; None if the file has none."""
        if self.follow:
            return Matrix.from_fractions(self.Z @ M.plain().fractions() @ vectors.fractions().T)
        return None if given is None else _exact_weights(given)


def generator_proof(contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any]) -> GeneratorProof:
    """The proof that a file has for A, B and X; for a family of A all P are in a stack.

    Parameters
    ----------
    contents : dict
        What has been read from `data`.
    data, proof : dict
        As they stand in the file.
    """
    cone, A, B = _Shown.read(data["X"]["cone"]), contents["A"], contents.get("B")
    if isinstance(A, tuple):
        given = proof.get("P") or [None] * len(A)
        P = _stacked([cone.weights(M, cone.rays, W) for M, W in zip(A, given, strict=True)])
    else:
        P = cone.weights(A, cone.rays, proof.get("P"))
    N = None if B is None else cone.weights(B, portable(contents["U"].exact_rays), proof.get("N"))
    Z = cone.Z if P is None or not P.is_sparse else cone.beside(P)
    return GeneratorProof(_doubles(cone.w), _doubles(Z), P, N)


def growth_weights(contents: dict[str, Any], data: dict[str, Any], proof: dict[str, Any], x: Matrix) -> Matrix | None:
    """The weights that a file has for x and A x (in discrete time A x - x), in two rows; None if they are not there.

    Parameters
    ----------
    contents, data, proof : dict
        As for `generator_proof`.
    x : Matrix, shape (n,)
    """
    cone, eye = _Shown.read(data["X"]["cone"]), Matrix.identity(len(x.values))
    moved = Matrix.from_fractions(contents["A"].plain().fractions() - int(contents["discrete"]) * eye.fractions())
    each = [cone.weights(M, x[None], proof.get(name)) for M, name in ((eye, "wx"), (moved, "wz"))]
    return None if None in each else Matrix.join([W.T for W in each if W is not None], -2)


def _stacked(each: list[Matrix | None]) -> Matrix | None:
    """All in one stack, as dense matrices; one that is sparse alone."""
    known = [P for P in each if P is not None]
    return known[0] if len(known) == 1 and known[0].is_sparse else Matrix.stack([P.dense() for P in known])


def _doubles(values: Rationals) -> Any:
    return np.asarray(Matrix.from_fractions(values).values)


def _exact_weights(o: dict[str, Any]) -> Matrix:
    """A matrix of a proof; rounded, and sparse, if it is very large and has few entries."""
    if "matrix" in o:
        return exact_rows(o["matrix"])
    i, j, x = (list(part) for part in zip(*o["sparse"], strict=True)) if o["sparse"] else ([], [], [])
    m, n = o["shape"]
    if m * n > _DENSE:
        return Matrix(sp.csr_array((np.array([float(number(a)) for a in x]), (i, j)), shape=(m, n)))
    out = np.full((m, n), Fraction(0), dtype=object)
    out[i, j] = [number(a) for a in x]
    return Matrix.from_fractions(out)
