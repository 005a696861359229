"""Linear programs over all plants that agree with the data: proposals in doubles, which nobody believes.

For a vector z the lower bound of row i is  max X1_i l - noise_i'|l|  over  Z l = z, with l = p - q, p and q >= 0; its
multipliers of Z l = z are a row of the plant where it is attained.  One program holds the l of all bounds, and what z
depends on: the gain, the vector e, or both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..exact.program import Block, Program
from ..exact.programs import Solution
from .certificate import Place

Floats = NDArray[np.float64]
Solver = Any

# Reward of margins ends here, relative to the size of the data: beyond, small gains count.
_ENOUGH = 0.05
# Price of the gain, against margins.
_PRICE = 1e-5
# How far inside X is e, as a part of the margin of decay over the size of A.
_INSIDE = 0.01
# Bounds with smaller multipliers, relative to the largest, do not matter.
_UNUSED = 1e-9


@dataclass(frozen=True)
class Samples:
    """The data in doubles.

    Attributes
    ----------
    Z : ndarray, shape (k, T)
    X1, noise : ndarray, shape (n, T)
    """

    Z: Floats
    X1: Floats
    noise: Floats

    @property
    def rate(self) -> float:
        """How large A is, about."""
        return float(np.abs(self.X1).max(initial=0.0) / max(np.abs(self.Z).max(initial=0.0), 1e-300)) or 1.0

    def coefficients(self, i: int, side: int) -> tuple[Floats, Floats]:
        """What p and q count in a bound of row i: from below (side 0) or above (1)."""
        low, high = self.X1[i] - self.noise[i], self.X1[i] + self.noise[i]
        return (high, -low) if side else (low, -high)


def extreme(
    samples: Samples, i: int, side: int, z: Floats, lp: Solver
) -> tuple[Solution, Floats | None, Floats | None]:
    """The best bound of row i at z: the outcome, l, and the row of the plant that attains it."""
    sign = 1.0 if side else -1.0
    cost = sign * np.concatenate(samples.coefficients(i, side))
    found = lp(cost, None, None, np.hstack([samples.Z, -samples.Z]), z)
    if not found:
        return found, None, None
    T = samples.Z.shape[1]
    duals = None if found.duals is None else sign * found.duals
    return found, found.x[:T] - found.x[T:], duals


def middle(samples: Samples, i: int, lp: Solver) -> tuple[Floats | None, float, Floats | None]:
    """Row i of a plant as far inside the noise as possible, how far, and multipliers of the samples.

    The program is about what least squares leave, in units of that, so that small noise does not drown in tolerances.
    """
    Z, k = samples.Z.T, samples.Z.shape[0]
    start = np.linalg.lstsq(Z, samples.X1[i], rcond=None)[0]
    rest, noise = samples.X1[i] - Z @ start, samples.noise[i]
    unit = max(np.abs(rest).max(initial=0.0), noise.max(initial=0.0)) or 1.0
    program = Program(w=Block(k, -np.inf, np.inf), inside=Block(1, -np.inf, np.inf, -1.0))
    ones = np.ones(len(Z))
    program.above((rest - noise) / unit, ones, name="inside", w=Z)
    program.above((-rest - noise) / unit, ones, name="inside", w=-Z)
    found = program.solve(lp)
    if not found:
        return None, -np.inf, None
    duals = found.duals
    l = None if duals is None else duals[len(Z) :] - duals[: len(Z)]
    return start + unit * found["w"], unit * float(found["inside"][0]), l


@dataclass(frozen=True)
class Unknowns:
    """What the vectors z depend on: z_k = fixed[k] + moved[k] theta.

    Attributes
    ----------
    fixed : ndarray, shape (V, k)
    moved : ndarray, shape (V, k, q)
    low, high : ndarray, shape (q,)
    price : ndarray, shape (q,)
        Of the size of theta.
    """

    fixed: Floats
    moved: Floats
    low: Floats
    high: Floats
    price: Floats


@dataclass(frozen=True)
class Found:
    """A point of a program.

    Attributes
    ----------
    theta : ndarray, shape (q,)
    l : ndarray, shape (K, T)
    margin : float
        Of the decay of e, and of pairs where they have `room`; NaN where the program has none.
    rows : ndarray, shape (K, k), or None
        For every bound the row of a plant that attains it, NaN where the program has no use for the bound.
    open : ndarray
        By how much every inequality is missed, where that is minimised: pairs of facet and generator, then facets.
    """

    theta: Floats
    l: Floats
    margin: float
    rows: Floats | None = None
    open: Floats | None = None


def joint(
    samples: Samples,
    named: list[Place],
    unknowns: Unknowns,
    facets: Floats,
    pairs: list[tuple[int, int]],
    at_e: int | None,
    discrete: bool,
    lp: Solver,
    *,
    room: float = 0.0,
    least: float | None = None,
    elastic: bool = False,
) -> Found | None:
    """h'(A + BF) x >= 0 for pairs of facet and vector, h'(A + BF) e < 0 (h'e) for all facets, over all plants at once.

    `room`: the products of pairs are at least this part of the margin of decay.  `least`: a margin that is kept, and as
    many of these products as possible are positive.  `elastic`: the sum of what is missing is as small as possible, for
    advice.
    """
    (n, T), K, q = samples.X1.shape, len(named), len(unknowns.low)
    k, cap = samples.Z.shape[0], _ENOUGH * (1.0 if discrete else samples.rate)
    program = Program(
        p=Block(K * T, 0.0), q=Block(K * T, 0.0), bound=Block(K, -np.inf, np.inf),
        theta=Block(q, unknowns.low, unknowns.high), size=Block(q, 0.0, np.inf, _PRICE * unknowns.price),
    )  # fmt: skip
    sampled = sp.kron(sp.eye_array(K), sp.csr_array(samples.Z), format="csr")
    of = [place[0] for place in named]
    program.equal(
        unknowns.fixed[of].ravel(), p=sampled, q=-sampled, theta=sp.csr_array(-unknowns.moved[of].reshape(K * k, q))
    )
    rows = [samples.coefficients(i, side) for _, i, side in named]
    program.equal(0.0, p=_diagonal([r[0] for r in rows]), q=_diagonal([r[1] for r in rows]), bound=-np.eye(K))
    program.below(0.0, theta=np.eye(q), size=-np.eye(q))
    program.below(0.0, theta=-np.eye(q), size=-np.eye(q))
    place = {name: r for r, name in enumerate(named)}
    images = _images(facets, pairs, place, 1, K)
    count = len(pairs) + (0 if at_e is None else len(facets))
    if elastic:
        program.add(miss=Block(count, 0.0, np.inf, 1.0))
    else:
        program.add(margin=Block(1, -np.inf if least is None else least, cap, -1.0))
    if pairs and elastic:
        program.above(0.0, bound=images, miss=np.eye(len(pairs), count))
    elif pairs and least is not None:
        program.spread(0.0, np.full(len(pairs), cap), bound=images)
    elif pairs:
        program.above(0.0, room * np.ones(len(pairs)), bound=images)
    if at_e is not None:
        worst = _images(facets, [(h, at_e) for h in range(len(facets))], place, -1, K)
        inside = facets if discrete else np.zeros_like(facets)
        parts: dict[str, Any] = {"bound": -worst, "theta": inside @ unknowns.moved[at_e, :n]}
        right = -(inside @ unknowns.fixed[at_e, :n])
        if elastic:
            program.above(right + cap, miss=np.eye(len(facets), count, len(pairs)), **parts)
        else:
            program.above(right, np.ones(len(facets)), **parts)
            if not discrete:  # in steps h'e > h'(A + BF) e >= 0 anyway
                depth = np.full(len(facets), _INSIDE / samples.rate)
                parts = {"theta": facets @ unknowns.moved[at_e, :n]}
                program.above(-(facets @ unknowns.fixed[at_e, :n]), depth, **parts)
    found = program.solve(lp, presolve=False)  # its rows hold nothing to be simplified
    if not found:
        return None
    l = (found["p"] - found["q"]).reshape(K, T)
    if elastic:
        return Found(found["theta"], l, float("nan"), open=found["miss"])
    rows_of_plants = None if found.duals is None else _attained(found.duals, K, k)
    return Found(found["theta"], l, float(found["margin"][0]), rows_of_plants)


def _attained(duals: Floats, K: int, k: int) -> Floats:
    """Multipliers of Z l = z, divided by those of the bounds."""
    of_vectors, of_bounds = duals[-K * (k + 1) : -K].reshape(K, k), duals[-K:]
    used = np.abs(of_bounds) > _UNUSED * np.abs(of_bounds).max(initial=0.0)
    return np.where(used[:, None], -of_vectors / np.where(used, of_bounds, 1.0)[:, None], np.nan)


def _images(facets: Floats, pairs: list[tuple[int, int]], place: Any, sign: int, K: int) -> Floats:
    """h'z of the worst bounds: the smallest (sign 1) or the largest (-1)."""
    out = np.zeros((len(pairs), K))
    for row, (h, v) in enumerate(pairs):
        for i in np.flatnonzero(facets[h]):
            out[row, place[v, int(i), int(sign * facets[h, i] < 0)]] += facets[h, i]
    return out


def _diagonal(rows: list[Floats]) -> Any:
    """Rows along the diagonal."""
    data = np.concatenate(rows)
    T = len(rows[0])
    return sp.csr_array((data, np.arange(len(data)), np.arange(len(rows) + 1) * T), shape=(len(rows), len(data)))
