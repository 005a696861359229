"""Actuators that lose effect: A + B diag(s) F in place of A + B F, for every s with all s_j in [f, 1].

What is certified of A + B F reads l'(M + N diag(s) F) x >= 0 (or > 0) then, which is linear in s.  With p = N'l and
q = F x its least value over all these s is

    l'M x + f (p+'q+ + p-'q-) - p+'q- - p-'q+,

p+ and p- being the positive and negative parts of p: a bilinear form in [l, p+, p-] and [x, q+, q-].  Where the kernel
proves the sign of all of them, everything in the certificate is proven for all these s.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..exact.intake import exact_matrix
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..families.common_vector import CommonVectorCertificate
from ..proof.certificate import Certificate, exactly
from ..theorems.stability import LyapunovCertificate
from .bounded.certificate import OrderIntervalCertificate
from .certificates import DisturbanceCertificate
from .exact_rows import exact_geometry
from .plant import Floats, Plant, closed_loop, shifted

Signs = NDArray[np.int8]

# Decimal digits of the fractions tried, and units of the last digit that are added where the one found is not proven.
_GRID = ((4, 0), (4, 1), (6, 0), (6, 1))
# Units of the last digit that rounding up forgives, because fractions are found in floating point.
_NOISE = 1e-3
# The least fraction where 0 is not proven to do.
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Demand:
    """l'(M + N diag(s) F) x >= 0 for all rows l of `left` and x of `right`; every matrix may be a stack, one per node.

    Attributes
    ----------
    left : Matrix, shape (..., k, a)
    M, N : Matrix, shapes (..., a, b), (..., a, m)
    right : Matrix, shape (..., p, b + 2 m)
        [x, q+, q-] for q = F x, from `lifted`.
    strict : bool
        True: > 0.
    where : ndarray of bool, shape (k, p), or None
        The pairs of which this is demanded; None: all.
    """

    left: Matrix
    M: Matrix
    N: Matrix
    right: Matrix
    strict: bool = False
    where: NDArray[np.bool_] | None = None

    @cached_property
    def _left(self) -> Matrix:
        return lifted(self.left, self.N)

    def forms(self, f: Floats) -> BilinearForms:
        """Their least values over all s in [f, 1], f of shape () or (N,)."""
        (a, b), m = self.M.shape[-2:], self.N.shape[-1]
        same, other = np.eye(2 * m), np.roll(np.eye(2 * m), m, axis=1)
        above = Matrix.join([self.M, Matrix.zeros(a, 2 * m)], -1)
        below = Matrix.join([Matrix.zeros(2 * m, b), Matrix(f[..., None, None] * same - other)], -1)
        return BilinearForms(self._left, Matrix.join([above, below], -2), self.right)

    def signs(self, forms: BilinearForms) -> Signs:
        """The proven signs, 1 where nothing is demanded."""
        if self.where is None:
            return forms.signs()
        where = np.broadcast_to(self.where, forms.values.shape)
        return np.where(where, forms.signs(where), 1)

    def start(self, shape: tuple[int, ...]) -> tuple[Floats, NDArray[np.bool_]]:
        """For every node the least f, in floating point, and whether the demand is proven to fail for some s in [0, 1].

        0 is returned only where it is proven.

        Parameters
        ----------
        shape : () or (N,)
        """
        none = self.forms(np.zeros(shape))
        signs = self.signs(none)
        if self._met(signs).all():
            return np.zeros(shape), np.zeros(shape, dtype=bool)
        with np.errstate(all="ignore"):
            ends = none.values / (none.values - self.forms(np.ones(shape)).values)
        ends = np.clip(np.nan_to_num(ends, nan=1.0, posinf=1.0, neginf=1.0), _TINY, 1.0)
        return np.where(self._met(signs), 0.0, ends).max(axis=(-2, -1)), (signs == -1).any(axis=(-2, -1))

    def holds(self, f: Floats) -> NDArray[np.bool_]:
        """For every node, whether the demand is proven for all s in [f, 1]."""
        return self._met(self.signs(self.forms(f))).all(axis=(-2, -1))

    def _met(self, signs: Signs) -> Any:
        return np.isin(signs, (1,) if self.strict else (0, 1))


def lifted(rows: Matrix, by: Matrix) -> Matrix:
    """Rows [l, p+, p-] with the positive and the negative parts of p' = l' by."""
    (left, unit), (right, other) = rows.as_integers(), by.as_integers()
    factor, p = Fraction(unit) * other, left @ right
    parts = np.concatenate([np.maximum(p, 0), np.maximum(-p, 0)], axis=-1)
    return Matrix.join([rows, Matrix.over(parts * factor.numerator, factor.denominator)], -1)


def least_fractions(demands: Iterable[Demand], shape: tuple[int, ...] = ()) -> tuple[Floats, NDArray[np.bool_]]:
    """For every node a fraction f for which all demands are proven for all s in [f, 1], and whether some fail below.

    Parameters
    ----------
    demands : iterable of Demand
    shape : () for one system, (N,) for stacks of N nodes

    Returns
    -------
    f : ndarray
        1 where nothing less is proven: what is certified of F itself.
    fragile : ndarray of bool
        Proven: some demand fails for an s with entries in [0, 1].
    """
    demands = list(demands)
    ends, broken = zip(*(demand.start(shape) for demand in demands), strict=True)
    end, fragile = np.max(ends, axis=0), np.any(broken, axis=0)
    f = np.where(end > 0, 1.0, 0.0)
    for digits, more in _GRID:
        if not (f == 1).any():
            break
        tried = np.where(f == 1, np.minimum(_rounded_up(end, digits, more), 1.0), f)
        proven = np.all([demand.holds(tried) for demand in demands], axis=0)
        f = np.where(proven, tried, f)
    return f, fragile


def _rounded_up(end: Floats, digits: int, more: int) -> Floats:
    """The next number of so many decimal digits, which the double does not exceed: it is printed rounded up."""
    units = np.ceil(np.atleast_1d(end) * 10**digits - _NOISE).astype(np.int64) + more
    values = units / 10**digits
    ratios = zip(map(float.as_integer_ratio, values.tolist()), units.tolist(), strict=True)
    above = [top * 10**digits > unit * bottom for (top, bottom), unit in ratios]
    return np.where(above, np.nextafter(values, 0.0), values).reshape(end.shape)


# -- a single system


def certified_fraction(plant: Plant, F: Matrix, certificate: Certificate, rate: float | Fraction) -> float:
    """The f for which all of the certificate, with this decay rate, is proven for A + B diag(s) F, all s_j in [f, 1].

    Parameters
    ----------
    plant : Plant
    F : Matrix, shape (m, n)
        From states to inputs.
    certificate : Certificate
        Of A + B F, as `accept` proves it.  A bound on |F x| holds for all s in [0, 1], as it does for F.
    rate : float or Fraction
        Decay rate that v proves.
    """
    return float(least_fractions(_demands(plant, F, certificate, rate))[0])


def _demands(plant: Plant, F: Matrix, certificate: Any, rate: float | Fraction) -> Iterator[Demand]:
    facets, rays = (Matrix.from_fractions(rows) for rows in exact_geometry(plant))
    loops, others = getattr(certificate, "loops", (certificate,)), getattr(certificate, "others", ())
    coupled = [c for c in others if isinstance(c, LyapunovCertificate)]
    drifts, seen = [shifted(A, -int(plant.discrete)) for A, _ in plant.vertices], lifted(rays, F.T)
    for (A, B), drift, loop in zip(plant.vertices, drifts, coupled or loops, strict=True):
        yield Demand(facets, A, B, seen, where=plant.incidence)
        falls = -exactly(loop, "v")[None]
        M = drift if plant.coupling is None else closed_loop(drift, plant.coupling, Matrix.identity(plant.n))
        yield Demand(falls, M, B, seen, strict=True)
        if rate:
            yield Demand(falls, shifted(M, rate), B, seen)
    bounds = (part for part in others if isinstance(part, DisturbanceCertificate))
    for part, drift, (_, B) in zip(bounds, drifts, plant.vertices, strict=False):
        yield from _bounded_gain(plant, F, part, facets, seen, (drift, B))
    if plant.ports:
        _, _, C, D = plant.system.matrices
        yield Demand(plant.system.Y.exact_facets.plain(), C, D, seen)
    for part in others:
        if isinstance(part, CommonVectorCertificate):
            vector = exact_matrix(part.x, "x")
            left, right = (-vector, seen) if part.is_dual(loops) else (-facets, lifted(vector, F.T))
            for M, (_, B) in zip(drifts, plant.vertices, strict=True):
                yield Demand(left, M, B, right, strict=True)
                if rate:
                    yield Demand(left, shifted(M, rate), B, right)
        if isinstance(part, OrderIntervalCertificate):
            yield from _kept_interval(plant, F, part, facets, drifts)


def _kept_interval(
    plant: Plant, F: Matrix, kept: OrderIntervalCertificate, facets: Matrix, drifts: list[Matrix]
) -> Iterator[Demand]:
    """(A + B diag(s) F) x_max + w_max in -X for every vertex; |diag(s) F x| is at most |F x|."""
    w, one = exactly(kept, "w_max")[None].T, Matrix.join([exactly(kept, "x_max")[None], Matrix.identity(1)], -1)
    inside = lifted(one, Matrix.join([F, Matrix.zeros(plant.m, 1)], -1).T)
    for drift, (_, B) in zip(drifts, plant.vertices, strict=True):
        yield Demand(-facets, Matrix.join([drift, w], -1), B, inside)


def _bounded_gain(
    plant: Plant, F: Matrix, bound: DisturbanceCertificate, facets: Matrix, seen: Matrix, pair: tuple[Matrix, Matrix]
) -> Iterator[Demand]:
    """(G + H diag(s) F) X in the orthant, (A + B diag(s) F) x + E 1 < 0 and (G + H diag(s) F) x + D 1 < gamma 1."""
    (E, G, H, D), (drift, B) = plant.disturbance, pair  # type: ignore[misc]
    outer = Matrix.identity(G.shape[0])
    yield Demand(outer, G, H, seen)
    one = Matrix.join([exact_matrix(bound.x, "x"), Matrix.identity(1)], -1)
    inside = lifted(one, Matrix.join([F, Matrix.zeros(plant.m, 1)], -1).T)
    pushed, through = (
        Matrix.from_fractions(M.fractions().sum(axis=1, keepdims=True) - level)
        for M, level in ((E, 0), (D, Fraction(bound.gamma)))
    )
    yield Demand(-facets, Matrix.join([drift, pushed], -1), B, inside, strict=True)
    yield Demand(-outer, Matrix.join([G, through], -1), H, inside, strict=True)
