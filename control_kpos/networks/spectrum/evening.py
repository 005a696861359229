"""Lyapunov vectors of a more even decay, for larger proven rates near the margin; proposals that the caller proves.

The rate that v proves is the least quotient of -(v'A_cl)x and v'x over all nodes.  The first v answers a uniform
right-hand side, or, where a Krylov method was stopped, not even that.  With v in the place of the right-hand side,
again and again, the quotients approach each other and the abscissa (inverse iteration); the first such step gains
most, and a rough solve does.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...exact.budget import seconds_left
from ..blocks import Floats
from ..model import NetworkModel
from .descent import is_inside, mix
from .port_solves import PortSystem, direct_loop

# Steps; how exact their solves are; and the part of an estimate of the abscissa from which on a rate needs none.
_STEPS, _TOLERANCE, _ENOUGH = 4, 1e-3, 0.9
# Krylov iterations for all steps: without a time limit, and with one.
_ITERATIONS = 400, 10_000


@np.errstate(all="ignore")
def evener(system: PortSystem, v: Floats, rate: float) -> Iterator[Floats]:
    """Vectors whose decay is more and more even; none if solves were fast, the margin far, or the rate good.

    Parameters
    ----------
    system : PortSystem
        What v was found with.
    v : ndarray
        In int X*, falling at `rate`.
    rate : float
    """
    model, loop = system.model, system.loop
    if not (loop.iterations or {"factors", "flat_factors"} & vars(loop).keys()):
        return
    loop.iterations, loop.iteration_limit = 0, _ITERATIONS[seconds_left() < np.inf]
    for _ in range(_STEPS):
        falls = system.shift * v - _after(model, v)
        distance = float(np.einsum("i,i->", falls, v) / np.einsum("i,i->", v, v))
        if not rate < _ENOUGH * distance:
            return
        c = mix(model, v, 1e-5, dual=True)
        v, _, reached = system.dual(c, _TOLERANCE, guess=c / distance, near=True)
        if not (is_inside(model, v, dual=True) and is_inside(model, reached, dual=True)):
            return
        yield v


def _after(model: NetworkModel, v: Floats) -> Floats:
    """A_cl'v."""
    r = model.times("B", v, transposed=True)
    if model.has_feedthrough:
        r = direct_loop(model).solve(r, True, 1e-12)
    return model.times("A", v, transposed=True) + model.times("C", model.WT @ r, transposed=True)
