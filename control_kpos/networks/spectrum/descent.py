"""Two-sided estimates of the spectral abscissa of a network, approached from above.

The closed loop of a K-positive network has a real rightmost eigenvalue lambda with eigenvectors x in X
and v in X*.  At a shift mu > lambda both (mu I - A_cl)^{-1} c and its dual stay in the cones, which the
solve itself confirms, and two-sided inverse iteration with

    theta = mu - c'x / v'x

lets mu fall towards lambda from above, where Krylov methods work and where every iterate is a
candidate for a proof: v for lambda < mu, x cut down to the nodes where it grows for lambda >= theta - delta.
Plain inverse iteration at a fixed shift stalls on large networks: their spectra are clustered and the
eigenvectors live on few nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...cones import Orthant
from ...exact.budget import require_time
from ..blocks import Floats, Index
from ..model import NetworkModel
from ..nodes import NodeStack
from .port_solves import PortSystem, banded_order, direct_loop

Progress: TypeAlias = Callable[[str], None]
# Where solutions miss a cone by their error, they are sought with these parts of the tolerance.
_CLOSER = (1.0, 1e-3, 1e-6)
# Bounds on the distance to the margin, by vectors that are not iterated on, may be this many times larger than it.
_BOUNDED = 16.0


@dataclass
class Approach:
    """Where the descent stands: theta, an estimate of the abscissa, and `shift`, the mu > theta of the last solve.

    v and x are dual and primal iterates at the shift, in the interiors of X* and X, c and d their right-hand sides,
    `iterations` the Krylov iterations of the slower of the two solves.
    """

    theta: float
    shift: float
    v: Floats
    x: Floats
    c: Floats
    d: Floats
    iterations: int = 0


def cone_coordinates(model: NetworkModel, vector: Floats, *, dual: bool) -> list[Floats]:
    """Values on the generators (dual vectors) or facets (states) of every node's X, (N, k) per stack."""
    return [
        np.einsum("jn,kn->jk", part, s.X.rays if dual else s.X.facets)
        for part, s in zip(model.split(vector, 0), model.stacks, strict=True)
    ]


def is_inside(model: NetworkModel, vector: Floats, *, dual: bool, strict: bool = True) -> bool:
    """True if the vector lies in the (interior of the) product of the X_j, or of their duals, in floating point."""
    with np.errstate(invalid="ignore"):
        return all(
            bool((z > 0).all() if strict else (z >= 0).all()) for z in cone_coordinates(model, vector, dual=dual)
        )


def interior(model: NetworkModel, *, dual: bool) -> Floats:
    """An interior point of the product of the X_j, or of their duals, of entries about 1."""
    points = [(s.X.dual if dual else s.X).interior_point for s in model.stacks]
    return model.at_all([point / np.abs(point).max(initial=0.0) for point in points], 0)


def mix(model: NetworkModel, vector: Floats, floor: float, *, dual: bool) -> Floats:
    """vector / max|vector| plus a little interior point in every node, so that it is an interior point."""
    scaled = vector / np.abs(vector).max()
    parts = []
    base = model.split(interior(model, dual=dual), 0)
    for part, inner in zip(model.split(scaled, 0), base, strict=True):
        size = np.abs(part).max(axis=1, keepdims=True, initial=0.0)
        parts.append(part + inner * (1e-6 * size + floor))
    return model.join(parts, 0)


def descend(
    model: NetworkModel,
    start: float,
    *,
    relative: float = 1e-6,
    stop: Callable[[Approach], bool] | None = None,
    progress: Progress | None = None,
    limit: int = 60,
) -> Approach | None:
    """Approach the abscissa from a shift above it; None if no such shift was found.

    The first guess `start` is raised until it is one.  Ends when `stop` returns True, or when shift - theta is below
    0.45 relative |theta|, which leaves as much for the proof from below.
    """
    bold = 0.5 if banded_order(model) is None else 0.2  # a shift below the abscissa costs Krylov methods most
    scale = rate_scale(model)
    c, d = interior(model, dual=True), interior(model, dual=False)
    mu, below, best = start, -np.inf, None
    rise = scale * 2.0**-6
    for step in range(limit):
        require_time()
        try_at = _solve_at(model, mu, c, d, best)
        if try_at is None:
            if best is None:  # no evidence that mu is too low: only that sweeps do not converge
                mu, rise = mu + rise, 4 * rise
                if rise > 1e6 * scale:
                    return None
                continue
            below = max(below, mu)
            mu = 0.5 * (max(mu, best.theta) + best.shift)
            if best.shift - mu <= 1e-15 * abs(best.shift) + 1e-300:
                return best
            continue
        jump = np.inf if best is None else abs(try_at.theta - best.theta)
        best = try_at
        if progress is not None:
            progress(f"step {step + 1}: spectral abscissa about {best.theta:.9g}, from the shift {best.shift:.9g}")
        gap = best.shift - best.theta
        goal = 0.45 * relative * abs(best.theta)
        if gap <= goal or (stop is not None and stop(best)):
            return best
        c = mix(model, best.v, 1e-3 if jump > 1e-3 * abs(best.theta) else 1e-5, dual=True)
        d = mix(model, best.x, 1e-3 if jump > 1e-3 * abs(best.theta) else 1e-9, dual=False)
        proposal = best.theta + max(min(bold * gap, 4 * jump), 0.8 * goal)
        if proposal <= below:
            proposal = 0.5 * (below + best.shift)
            if best.shift - below <= goal:
                return best
        mu = proposal
    return best


def _solve_at(model: NetworkModel, mu: float, c: Floats, d: Floats, best: Approach | None) -> Approach | None:
    system = PortSystem(model, mu)
    if not system.is_finite:
        return None
    guess_v = guess_x = None
    tolerance = 1e-6
    if best is not None:
        distance = max(mu - best.theta, 1e-300)
        guess_v, guess_x = c / distance, d / distance
        tolerance = 1e-3 if distance > 1e-3 * abs(best.theta) else 1e-6
        system.loop.iteration_limit = min(20 + 3 * best.iterations, 400)
    else:
        # without iterates to start from, stay where sweeps converge, as they do for large mu without feedthrough
        system.loop.sweeps_only = not model.has_feedthrough
    closest = _CLOSER if best is None or system.loop.factors is None else _CLOSER[:1]  # factors know no tolerance
    for closer in closest:
        v, _, reached = system.dual(c, tolerance * closer, guess=guess_v, near=best is not None)
        if is_inside(model, v, dual=True) and is_inside(model, reached, dual=True):
            break
        guess_v = v if best is not None else None
    else:
        return None
    c, used = reached, system.loop.iterations
    for closer in closest:  # v shows that the shift is above the abscissa
        system.loop.iterations = 0
        x, _ = system.primal(d, tolerance * closer, guess=guess_x, near=best is not None)
        if is_inside(model, x, dual=False):
            break
    else:
        return None
    with np.errstate(all="ignore"):
        theta = mu - float(np.divide(np.einsum("i,i->", c, x), np.einsum("i,i->", v, x)))
    if not np.isfinite(theta):
        return None
    return Approach(theta, mu, v, x, c, d, max(used, system.loop.iterations))


class Hidden:
    """A `stop` of `descend` at a settled theta so close to `least` that rounding hides a part of the distance.

    Parameters
    ----------
    unit : float
        What rounding hides.
    least, relative : float
        The part is `relative` |theta - least|.

    Attributes
    ----------
    ended : bool
        True if it ended a descent, or saved one.
    """

    def __init__(self, unit: float, least: float = 0.0, relative: float = 1.0) -> None:
        self.unit, self.least, self.relative = unit, least, relative
        self.ended, self._before = False, np.inf

    def __call__(self, at: Approach) -> bool:
        jump, self._before = abs(at.theta - self._before), at.theta
        self.ended = max(jump, self.relative * abs(at.theta - self.least)) < self.unit
        return self.ended

    def bounded(self, model: NetworkModel, v: Floats, c: Floats) -> bool:
        """Whether v with (least I - A_cl)'v = c bounds the distance, by Collatz and Wielandt."""
        if not is_inside(model, v, dual=True):
            v, c = -v, -c
        own, ahead = (cone_coordinates(model, z, dual=True) for z in (v, c))
        self.ended = all((np.abs(b) < _BOUNDED * self.unit * a).all() for a, b in zip(own, ahead, strict=True))
        return self.ended


def rate_scale(model: NetworkModel) -> float:
    """A typical rate of the nodes, per unit of time: the largest median of |A_j| over the stacks."""
    return max(1e-300, *(float(np.median(np.abs(s.A.values).max(axis=(1, 2), initial=0.0))) for s in model.stacks))


def apply_loop(model: NetworkModel, x: Floats) -> Floats:
    """A_cl x, through the ports; with feedthrough by fixed-point iteration on u = W (C x + D u)."""
    u = model.W @ model.times("C", x)
    if model.has_feedthrough:
        u = direct_loop(model).solve(u, False, 1e-15)
    return model.times("A", x) + model.times("B", u)


def growing_part(model: NetworkModel, x: Floats, rate: float, rounds: int = 400) -> Floats | None:
    """x cut down to where A_cl x - rate x stays in X, or None if nothing is left.

    Cutting a part away lowers what the others receive, so parts are removed until none has to be: single
    generators of simplicial cones, whole nodes of others.
    """
    ahead = apply_loop(model, x) - rate * x
    if all(is_inside(model, part, dual=False, strict=False) for part in (x, ahead)):
        return x  # rounding to weights would cost digits
    weights = weigh(model, x)
    for _ in range(rounds):
        require_time()
        x = combined(model, weights)
        if not np.any(x):
            return None
        if not cut_down(model, weights, apply_loop(model, x) - rate * x):
            return x
    return None


def weigh(model: NetworkModel, x: Floats) -> list[Floats]:
    """x of every stack by what `cut_down` takes away: coefficients on generators, or the states of whole nodes."""
    return [_weights(s, part) for s, part in zip(model.stacks, model.split(x, 0), strict=True)]


def combined(model: NetworkModel, weights: list[Floats]) -> Floats:
    """The inverse of `weigh`."""
    return model.join([_combined(s, part) for s, part in zip(model.stacks, weights, strict=True)], 0)


def cut_down(model: NetworkModel, weights: list[Floats], ahead: Floats) -> bool:
    """Take away, in place, the parts of x where what is to stay in X leaves it; True if there are any."""
    changed = False
    for g, (s, z) in enumerate(zip(model.stacks, model.split(ahead, 0), strict=True)):
        bad = ~(np.einsum("jn,kn->jk", z, s.X.facets) >= 0)
        if s.X.is_simplicial:
            bad = bad[:, _opposite(s)] & (weights[g] > 0)
        else:
            bad = bad.any(axis=1, keepdims=True) & weights[g].any(axis=1, keepdims=True)
        if bad.any():
            weights[g] = np.where(bad, 0.0, weights[g])
            changed = True
    return changed


def slow_state(model: NetworkModel, found: Approach, relative: float) -> tuple[Floats, float] | None:
    """x in X and the largest rate found with A_cl x - rate x in X.

    An eigenvector that lives on few nodes is computed anew on these alone: without their surroundings the
    abscissa is lower by the square of what x is at their boundary, while x cut off there would not do.
    """
    x = found.x / np.abs(found.x).max()
    core = model.peaks(x) > 1e-7
    here, part = found, model
    if not core.all():
        nearer = descend(model.restrict(core), found.shift, relative=0.5 * relative)
        if nearer is not None:
            here, part = nearer, model.restrict(core)
            x = here.x / np.abs(here.x).max()
    unit = relative * max(abs(found.theta), 1e-300)
    for state, distances in _sharper(part, here, x):
        for distance in distances:
            rate = here.theta - distance * unit
            kept = growing_part(part, state, rate)
            if kept is not None:
                return kept if part is model else model.lifted(core, kept), rate
    return None


def _sharper(model: NetworkModel, here: Approach, x: Floats) -> Iterator[tuple[Floats, tuple[float, ...]]]:
    """x, then iterates without the interior point that `descend` mixes in, whose small entries are closer to those of
    the eigenvector; each with the distances to try, in widths.
    """
    yield x, (0.1, 0.5)
    best = x
    for _ in range(3):
        system = PortSystem(model, here.shift)
        after, _ = system.primal(best, 1e-14, guess=best / max(here.shift - here.theta, 1e-300), near=True)
        if not is_inside(model, after, dual=False):
            break
        best = after / np.abs(after).max()
        yield best, (0.1, 0.5)
    for last in (best, x):
        yield last, (1.0, 10.0, 1e3, 1e5)


def _opposite(s: NodeStack) -> Index:
    """For each generator of a simplicial cone, the facet it does not lie on."""
    return np.argmin(s.X.incidence, axis=0) if s.X.dim else np.zeros(0, dtype=np.intp)


def _weights(s: NodeStack, x: Floats) -> Floats:
    """Coefficients on the generators of a simplicial cone, rounded to 26 bits so that a part of x has no rounding
    errors on its face; x itself for other cones.
    """
    if not s.X.is_simplicial:
        return x
    k = _opposite(s)
    scale = np.einsum("kn,kn->k", s.X.facets[k], s.X.rays)
    weight = np.maximum(np.einsum("jn,kn->jk", x, s.X.facets[k]) / scale, 0.0)
    if isinstance(s.X, Orthant):
        return weight
    size = weight.max(axis=1, keepdims=True, initial=0.0)
    unit = np.ldexp(1.0, np.frexp(size)[1] - 26)
    return np.floor(weight / unit) * unit


def _combined(s: NodeStack, weights: Floats) -> Floats:
    return np.einsum("jk,kn->jn", weights, s.X.rays) if s.X.is_simplicial else weights
