"""The inequalities of a design in integers and fractions, for proofs that there is no gain."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from ..cones import Cone
from ..exact.matrix import Integers, Matrix
from .plant import Plant, leading_sizes
from .simplicial.inequalities import Inequalities, feedback_inequalities, gain_rows, output_rows

Rationals = NDArray[np.object_]

# Bits of the integers in exact generators and facets; beyond, powers of two are divided out.
_LONGEST = 200


def homogeneous_rows(
    q: Inequalities, rate: float, discrete: bool, free: NDArray[np.bool_]
) -> tuple[Rationals, NDArray[np.intp]]:
    """Rows closed, -drift and xi over xi and the z that may differ from zero, and the columns kept."""
    theta = int(discrete) - Fraction(rate)
    kept = np.concatenate([np.arange(q.n), q.n + np.flatnonzero(free.ravel())])
    positive = np.zeros((q.n, q.size), dtype=object)
    positive[np.arange(q.n), np.arange(q.n)] = 1
    rows = np.concatenate([q.closed, -q.decreasing(theta), positive])
    return rows[:, kept], kept


def exact_inequalities(plant: Plant, *, as_given: bool = False) -> Inequalities:
    """The inequalities of a design in integers and fractions.

    Parameters
    ----------
    plant : Plant
    as_given : bool
        True: gains are bounded at generators of the lengths in `X.rays`, as in files of version 0.1.
    """
    facets, rays = exact_geometry(plant)
    pairs = [(A.fractions(), B.fractions()) for A, B in plant.vertices]
    drift = None
    if plant.coupling is not None:
        drift = [(A + plant.coupling.fractions(), B) for A, B in pairs]
    q = feedback_inequalities(facets, rays, pairs, discrete=plant.discrete, drift_plants=drift)
    if plant.gain_bound is not None:
        tolerance = 1 + Fraction(1, 10**9)
        bound = np.array([Fraction(b) * tolerance for b in plant.gain_bound.tolist()], dtype=object)
        sizes = lengths(plant.X, rays) if as_given else leading_sizes(rays)
        q = q.with_closed(*gain_rows(q.n, q.m, sizes, bound))
    if plant.ports:
        C, D = (M.fractions() for M in plant.system.matrices[2:])
        q = q.with_closed(*output_rows(C, D, outer_facets(plant.system.Y), rays))
    return q


def outer_facets(Y: Cone) -> Rationals:
    """Facets of the cone of outputs, in integers, each up to a positive factor."""
    return Y.exact_facets.rows_as_integers(np.arange(Y.n_facets))


def lengths(X: Cone, exact_rays: Rationals) -> Rationals:
    """Exact ray k = lengths[k] * rays[k], up to the rounding of rays[k]: a bound on F x_k, for the exact ray."""
    rays = np.asarray(X.rays, dtype=float)
    largest = np.argmax(np.abs(rays), axis=1)
    return np.array([Fraction(exact_rays[k, j]) / Fraction(rays[k, j]) for k, j in enumerate(largest)], dtype=object)


def exact_geometry(plant: Plant) -> tuple[Integers, Integers]:
    """Exact facets, in the order of `Plant.facets`, and rays, each row up to a positive factor."""
    return short_rows(plant.X.exact_facets, plant.facet_order), short_rows(plant.X.exact_rays)


def short_rows(M: Matrix, order: NDArray[np.intp] | None = None) -> Integers:
    """Rows in integers; long ones divided by a power of two: facets of many generators have thousands of bits."""
    out = np.array(M.rows_as_integers(np.arange(M.shape[0]) if order is None else order), dtype=object)
    for i, row in enumerate(out):
        length = max(int(x).bit_length() for x in row)
        if length > _LONGEST:
            out[i] = [Fraction(int(x), 2**length) for x in row]
    return out
