"""find_cone: the one entrance to all searches for a cone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from control import StateSpace

from ..arrays import ExactMatrix, exact_matrix
from ..cones import Cone
from ..errors import DataError, ShapeError
from .certificate import ConeCertificate
from .existence import spectral_obstruction, transposed
from .explicit import fewest_rays
from .generated import proper_cone
from .modes import dominant_index
from .result import FoundCone
from .single import as_stack, find_single


def find_cone(
    A: Any,
    contains: Any = None,
    within: Any = None,
    max_rays: int | None = None,
    *,
    discrete: bool | None = None,
    few: Literal["rays", "facets"] = "rays",
) -> FoundCone:
    """Find a proper polyhedral cone X that A leaves invariant, or prove that there is none.

    Continuous time: e^{At} X inside X for all t >= 0; discrete time: A X inside X.

    Examples
    --------
    >>> found = find_cone([[-1, 4, 0], [-4, -1, 0], [0, 0, 1]])
    >>> found.status.name, found.n_rays, found.fewest_rays
    ('PROVED', 7, 7)
    >>> find_cone([[0, 1], [-1, 0]]).status.name
    'REFUTED'
    """
    matrix = square(A, "A")
    return _one(matrix, max_rays, bool(discrete), few)


def square(data: Any, name: str) -> ExactMatrix:
    """Read a square matrix."""
    matrix = exact_matrix(data, name)
    if matrix.shape[0] != matrix.shape[1] or not matrix.shape[0]:
        raise ShapeError(f"{name} is {matrix.shape[0]} x {matrix.shape[1]}; it must be square and not empty.")
    return ExactMatrix(matrix.values.toarray()) if matrix.is_sparse else matrix


def _one(A: ExactMatrix, max_rays: int | None, discrete: bool, few: str) -> FoundCone:
    bound = lower_bound(A, discrete=discrete)
    by_facets = few == "facets"
    searched = transposed(A) if by_facets else A
    if max_rays is not None and max_rays < bound:
        certificate, separators, conditioning = None, None, np.inf
    else:
        certificate, separators, conditioning = find_single(searched, discrete=discrete, max_rays=max_rays)
    if certificate is None or not certificate:
        obstruction = spectral_obstruction(A, discrete=discrete)
        if obstruction is not None:
            refuted = ConeCertificate.settle(matrices=as_stack([A]), discrete=discrete, witness=obstruction)
            return FoundCone(refuted, None, bound, np.inf)
    if certificate is None:
        raise DataError(
            f"max_rays is {max_rays}, but every invariant polyhedral cone of this matrix has at least {bound} rays "
            f"(and as many facets); ask for max_rays >= {bound}."
        )
    if not certificate or certificate.rays is None or certificate.right_inverse is None:
        return FoundCone(certificate, None, bound, np.inf, f"Any such cone needs at least {bound} rays.")
    cone: Cone = proper_cone(certificate.rays, separators, certificate.right_inverse)
    if by_facets:
        cone = cone.dual
        data = {**certificate.data(), "matrices": as_stack([A]), "by_facets": True}
        certificate = ConeCertificate.settle(**data)
    return FoundCone(certificate, cone, bound, conditioning)


def lower_bound(A: ExactMatrix, *, discrete: bool) -> int:
    """Least number of rays (and of facets) of an invariant polyhedral cone, from the spectrum."""
    values = np.linalg.eigvals(A.values).astype(complex)
    first = dominant_index(values, discrete=discrete)
    rest = np.delete(values, first)
    size = float(abs(values[first])) if discrete else float(values[first].real)
    return fewest_rays(rest[rest.imag > 0], size, len(values))
