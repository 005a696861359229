"""Cones in certificate files: generators, and the numbers that prove them pointed and solid.

A cone is written as the product of factors, each a number of times.  A factor has its generators x_i as rows of
`rays`; unless they are as many as the dimensions, a vector w with w'x_i > 0 (pointed), and a matrix Z with
sum_i x_i Z_ij = e_j (solid).  The orthant in R^n is n times the half-line.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from ..cones import (
    Cone,
    Orthant,
    PolyhedralCone,
    ProductCone,
    orthant,
    product,
)
from ..cones.orthant import nonnegative
from ..errors import CertificateFileError, KposError
from ..exact.condition import Condition
from ..exact.linalg import echelon, solve_exactly
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from .encoding import Written, exact_rows
from .numerals import nested_text

Rationals = NDArray[np.object_]
# Above this dimension exact inverses are longer than a file should be.
LARGE = 64
# Where no cone is.
_NUMBERS = ("array", "fractions", "matrix", "sparse")
_HALF_LINE = {"rays": [[1]]}


def encode_cone(cone: Cone) -> list[Any]:
    """A cone as pairs [count, factor]."""
    if isinstance(cone, Orthant):
        return [[cone.dim, _HALF_LINE]] if cone.dim else []
    if not isinstance(cone, ProductCone):
        return [[1, _encode_factor(cone)]]
    written = {id(factor): factor for factor in cone.factors}
    parts = {key: encode_cone(factor) for key, factor in written.items()}
    runs = zip(cone.factors, cone.counts, strict=True)
    return [[count * inner, part] for factor, count in runs for inner, part in parts[id(factor)]]


def _encode_factor(cone: Cone) -> dict[str, Any]:
    rays = portable_rows(cone.exact_rays)
    out: dict[str, Any] = {"rays": nested_text(rays.tolist())}
    if len(rays) == cone.dim:
        return out
    try:
        w, Z = np.asarray(cone.dual.interior_point), spanning_inverse(cone.exact_rays, rays)
    except KposError:  # too thin for doubles: the file is for this package alone
        return out
    return out if Z is None else {**out, "w": nested_text(w.tolist()), "Z": nested_text(Z.tolist())}


def encode_generators(rays: Matrix, w: NDArray[np.float64]) -> Written:
    """The cone of given generators, of which w is positive on all, without its facets."""
    rows = portable_rows(rays)
    out = {"rays": nested_text(rows.tolist())}
    if rows.shape[0] != rows.shape[1]:
        out["w"], Z = nested_text((w + 0.0).tolist()), spanning_inverse(rays, rows)
        out |= {} if Z is None else {"Z": nested_text(Z.tolist())}
    return Written({"cone": [[1, out]]})


def factors_in(data: Any) -> Iterator[dict[str, Any]]:
    """The factors of all cones in data of a file."""
    if isinstance(data, dict) and isinstance(data.get("rays"), list):
        yield data
    elif isinstance(data, (dict, list)):
        items = data if isinstance(data, list) else (x for key, x in data.items() if key not in _NUMBERS)
        for item in items:
            yield from factors_in(item)


def is_portable(factor: dict[str, Any]) -> bool:
    """True if a factor of a cone can be proven pointed and solid from what a file has of it."""
    n = len(factor["rays"][0])
    return "Z" in factor or (len(factor["rays"]) == n <= LARGE)


def given_generators(cone: Cone) -> Matrix:
    """The generators that stand in a file, in the order in which they stand there."""
    if isinstance(cone, PolyhedralCone):
        return cone._conversion.generators
    return Matrix(cone.exact_rays.values.toarray()) if cone.exact_rays.is_sparse else cone.exact_rays


def own_generators(X: Cone) -> Matrix:
    """The generators of X as they were given, with lengths that files keep."""
    return portable(given_generators(X))


def portable(rows: Matrix) -> Matrix:
    """Dense rows with one common factor, of the lengths that they have in files."""
    return rows.plain() if rows.integer_rows is None else Matrix.from_fractions(portable_rows(rows))


def portable_rows(m: Matrix) -> Rationals:
    """Rows as fractions: exactly, with lengths that are those of the doubles up to a power of two."""
    values = np.asarray(m.values.toarray() if m.is_sparse else m.values)
    if m.integer_rows is None:
        return Matrix(values, m.radius, m.numerators, m.denominator).fractions()
    ints = m.rows_as_integers(np.arange(m.shape[0]))
    out = np.empty(ints.shape, dtype=object)
    for k, (row, approx) in enumerate(zip(ints, values, strict=True)):
        top = int(np.argmax(np.abs(approx)))
        exponent = int(abs(int(row[top]))).bit_length() - int(np.frexp(approx[top])[1])
        out[k] = [Fraction(int(x)) / Fraction(2) ** exponent for x in row]
    return out


def opposite_facets(cone: Cone, rays: Rationals) -> tuple[Rationals, Rationals]:
    """For a simplicial cone: facet k is the one that generator k does not lie on, and h_k'x_k."""
    H = cone.exact_facets.rows_as_integers(np.arange(cone.dim))[np.argmin(cone.incidence, axis=0)]
    return H, np.array([Fraction(x) for x in (H * rays).sum(axis=1)], dtype=object)


def right_inverse(cone: Cone, rays: Rationals) -> Rationals | None:
    """Z with rays' Z = I, or None above the dimension where it would be too long."""
    if len(rays) != cone.dim or cone.dim > LARGE:
        return spanning_inverse(cone.exact_rays, rays)
    H, height = opposite_facets(cone, rays)
    return H / height[:, None]


def spanning_inverse(exact_rays: Matrix, rays: Rationals) -> Rationals | None:
    """Z with rays' Z = I from n independent generators, or None where there is none that is short enough.

    The generators are far apart where floating point finds such, so that Z makes small errors no larger.
    """
    n = rays.shape[1]
    if n > LARGE:
        return None
    ints = exact_rays.rows_as_integers(np.arange(len(rays)))
    chosen = independent(exact_rays, ints)
    if len(chosen) < n:
        return None
    found = solve_exactly(ints[chosen].T, np.eye(n, dtype=int).astype(object))
    if found is None:
        return None
    numerators, denominator = found
    Z = np.full(rays.shape, Fraction(0), dtype=object)
    for k, row in zip(chosen, numerators, strict=True):
        top = next(j for j in range(n) if ints[k, j])
        Z[k] = [Fraction(int(x), denominator) * int(ints[k, top]) / rays[k, top] for x in row]
    return Z


def independent(exact_rays: Matrix, ints: NDArray[np.object_]) -> NDArray[np.intp]:
    """The largest number of independent generators, far from each other where floating point finds such.

    Parameters
    ----------
    exact_rays : Matrix, shape (N, n)
    ints : ndarray of int, shape (N, n)
        The same as integers, each row up to a positive factor.
    """
    values = np.asarray(exact_rays.values)
    unit = values / np.linalg.norm(values, axis=1, keepdims=True)
    order = qr(unit.T, mode="r", pivoting=True)[1] if np.isfinite(unit).all() else np.arange(len(values))
    return order[echelon(ints[order]).rows]


def decode_cone(runs: Any, limit: int) -> Cone:
    """The inverse of `encode_cone`; w shows that a cone is pointed, so that it need not be converted.

    Raises
    ------
    NotProperConeError
        A cone is not pointed or not solid: what holds on proper cones says nothing about it.
    """
    factors: list[Cone] = []
    known: dict[str, Cone] = {}
    dim = 0
    for count, part in runs:
        n = len(part["rays"][0])
        if set(part) - {"rays", "w", "Z"}:
            raise CertificateFileError("a cone has rays, w and Z, and nothing else.")
        if type(count) is not int or not 0 < count * n <= limit - dim:
            raise CertificateFileError(f"{str(count)[:60]} cones in dimension {n} are absurd for a file of this size.")
        dim += count * n
        if part["rays"] == [[1]] and type(part["rays"][0][0]) is int:
            factors.append(orthant(count))
            continue
        key = str(part["rays"])
        if key not in known:
            known[key] = PolyhedralCone(exact_rows(part["rays"]))
            if not _is_shown_proper(known[key], part):
                known[key].require_proper("a cone")
        factors += [known[key]] * count
    return product(factors) if factors else nonnegative(0)


def _is_shown_proper(cone: Cone, part: dict[str, Any]) -> bool:
    """Whether w'x > 0 on all generators, which span the space; False if the file has no such w."""
    rays = given_generators(cone)
    if rays.shape[0] == cone.dim or "w" not in part or len(part["w"]) != cone.dim:
        return False
    pointed = Condition("w'x > 0", BilinearForms(exact_rows([part["w"]]), None, rays), ">")
    spanning = independent(rays, rays.rows_as_integers(np.arange(rays.shape[0])))
    return pointed.verdict() is True and len(spanning) == cone.dim
