"""The worst mixture of an uncertain network by policy iteration, and vectors of Theorem 4 for all vertices at once.

Let v be the solution of (v'A - q'C) x_i = -c'x_i, r'u_i = (v'B - q'D) u_i, q = -W'r for a mixture.  Every generator
changes to the vertex at which (v'A^s - q'C^s) x_i, or (v'B^s - q'D^s) u_i, is largest, and keeps its own in ties.  Then
v grows in the order of X* and the mixtures are finitely many: either some mixture has no v in int X*, so that it is
unstable, or no generator wants to change, and v, r, q satisfy Theorem 4 at all vertices.  A handful of sparse solves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...cones import Cone, Orthant
from ...exact.rounding import HALF_ULP
from ..blocks import Floats, Index, apply
from ..certify import Data
from ..inwards import inwards, lower_outputs, moved
from ..model import NetworkModel
from ..spectrum.descent import interior, is_inside
from ..spectrum.port_solves import PortSystem, direct_loop
from .members import Mixture, Vertices, counts

# Solves of policy iteration, and passes over algebraic loops.
_STEPS, _PASSES = 50, 200
# Solves are this exact; gains below this part of what is compared are ties.
_TOLERANCE, _TIE = 1e-9, 1e-7


@dataclass(frozen=True, eq=False)
class Worst:
    """Where policy iteration has ended.

    Attributes
    ----------
    mixture : Mixture
    network : NetworkModel
        The network of the mixture.
    vectors : tuple of two ndarrays, or None
        v and r of the mixture; None if it has no v in int X*.
    solved : bool
        They solve their equations closely enough to be vectors of a stable mixture.
    """

    mixture: Mixture
    network: NetworkModel
    vectors: tuple[Floats, Floats] | None
    solved: bool = False


def has_mixtures(models: Vertices) -> bool:
    """True if X and U of all nodes with several vertices are simplicial: there mixtures decide."""
    first = zip(models[0].stacks, counts(models), strict=True)
    return all(s.X.is_simplicial and s.U.is_simplicial for s, count in first if count > 1)


@np.errstate(all="ignore")
def worst_mixture(models: Vertices) -> Worst:
    """Policy iteration from the first vertices."""
    mixture, network = Mixture.of_vertex(models[0]), models[0]
    c, vectors, solved = interior(network, dual=True), None, False
    for _ in range(_STEPS):
        system = PortSystem(network, float(network.discrete))
        v, r, reached = system.dual(c, _TOLERANCE)
        if not (np.isfinite(v).all() and is_inside(network, v, dual=True)):
            return Worst(mixture, network, None)
        vectors, solved = (v, r), is_inside(network, reached, dual=True)
        better = _improved(models, mixture, v, r)
        if better is None:
            break
        mixture, network = better, better.network(models)
    return Worst(mixture, network, vectors, solved)


def _improved(models: Vertices, mixture: Mixture, v: Floats, r: Floats) -> Mixture | None:
    """The mixture that is worst for these vectors, or None if it is the one they are from."""
    first, several = models[0], counts(models)
    q = -(first.WT @ r)
    states, inputs, changed = list(mixture.states), list(mixture.inputs), False
    parts = zip(first.split(v, 0), first.split(q, 2), strict=True)
    for g, (v_g, q_g) in enumerate(parts):
        for chosen, names, kind in ((states, "AC", 0), (inputs, "BD", 1)):
            if several[g] == 1 or not chosen[g].size:
                continue
            values = np.array([_priced(m, g, names, kind, v_g, q_g) for m in models[: several[g]]])
            own = np.take_along_axis(values, chosen[g][None], 0)[0]
            gain = values.max(axis=0) - own
            switched = gain > _TIE * np.abs(own) + _TOLERANCE * np.abs(own).max()
            if switched.any():
                chosen[g], changed = np.where(switched, values.argmax(axis=0), chosen[g]), True
    return Mixture(states, inputs) if changed else None


def _priced(model: NetworkModel, g: int, names: str, kind: int, v: Floats, q: Floats) -> Floats:
    """(v'A - q'C) x or (v'B - q'D) u for the generators of every node of a stack."""
    s = model.stacks[g]
    first, second = (getattr(s, name).values for name in names)
    row = apply(first, v, transposed=True) - apply(second, q, transposed=True)
    cone = (s.X, s.U)[kind]
    return row if isinstance(cone, Orthant) else row @ np.asarray(cone.rays).T


def rates_of_all(models: Vertices, v: Floats, r: Floats) -> Data:
    """v, r >= B'v - D'q at all vertices and q <= -W'r in the orders of U* and Y*, by a few units in the last place."""
    first = models[0]
    if not any(m.has_feedthrough for m in models):
        r = _largest(first, [moved(m, "U", [("B", v)], dual=True) for m in models])
        return v, r, lower_outputs(first, r)
    q = lower_outputs(first, r)
    for _ in range(_PASSES):
        before, q = r, lower_outputs(first, r)
        r = _largest(first, [moved(m, "U", [("B", v), ("D", -q)], dual=True) for m in models])
        if (np.abs(r - before) <= 4 * HALF_ULP * np.abs(r)).all():
            break
    return v, r, q


def _largest(model: NetworkModel, rows: list[Floats]) -> Floats:
    """An upper bound of vectors over the inputs of all nodes in the order of U*; the least one if U is simplicial."""
    if len(rows) == 1 or all(isinstance(s.U, Orthant) for s in model.stacks):
        return np.max(rows, axis=0)
    split = [model.split(row, 1) for row in rows]
    out = model.join([_upper(s.U, [part[g] for part in split]) for g, s in enumerate(model.stacks)], 1)
    return inwards(model, "U", out, np.max(np.abs(rows), axis=0), max(s.sizes[1] for s in model.stacks), dual=True)


def _upper(cone: Cone, rows: list[Floats]) -> Floats:
    if isinstance(cone, Orthant):
        return np.max(rows, axis=0)
    rays = np.asarray(cone.rays)
    values = np.array([row @ rays.T for row in rows])
    if cone.is_simplicial:
        return values.max(axis=0) @ np.linalg.inv(rays.T)
    inner = np.asarray(cone.dual.interior_point)
    above = (values.max(axis=0) - values[0]) / (rays @ inner)
    return rows[0] + above.max(axis=1, initial=0.0)[:, None] * inner


def loop_weights_of_all(models: Vertices) -> tuple[Floats, Floats, Mixture]:
    """Candidates for p and t with p'D u <= t'u at all vertices and t'W y < p'y, by policy iteration; its mixture."""
    first, several = models[0], counts(models)
    mixture = Mixture.of_vertex(first)
    e = first.at_all([s.Y.dual.interior_point for s in first.stacks], 2)
    zero = np.zeros(first.totals[0])
    p, t = np.zeros(first.totals[2]), np.zeros(first.totals[1])
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            network = mixture.network(models)
            around = direct_loop(network).solve(network.times("D", e, transposed=True), True, 1e-13)
            p = e + network.WT @ around
            if not _inside(network, p):
                break
            t = _largest(first, [moved(m, "U", [("D", p)], dual=True) for m in models])
            chosen = _worst_inputs(models, several, first.split(p, 2), first.split(zero, 0))
            if all(np.array_equal(a, b) for a, b in zip(chosen, mixture.inputs, strict=True)):
                break
            mixture = Mixture(mixture.states, chosen)
    return p, t, mixture


def _inside(model: NetworkModel, p: Floats) -> bool:
    """True if p is in int Y*: else the algebraic loop of this mixture does not contract."""
    parts = zip(model.stacks, model.split(p, 2), strict=True)
    return bool(np.isfinite(p).all()) and all((part @ np.asarray(s.Y.rays).T > 0).all() for s, part in parts)


def _worst_inputs(models: Vertices, several: list[int], p: list[Floats], zero: list[Floats]) -> list[Index]:
    """The vertices at which p'D u is largest."""
    return [
        np.argmax([_priced(m, g, "BD", 1, zero[g], -p[g]) for m in models[: several[g]]], axis=0)
        for g in range(len(several))
    ]
