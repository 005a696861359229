"""Modes of a switched system, each with a gain of its own that the controller switches with the mode.

The modes x' = A_s x + B_s u with u = F_s x are the vertices (A_s, [0 .. B_s .. 0]) of one plant with as many groups of
inputs as modes, and one gain for it, [F_1; F_2; ...]: whatever is proven of that is proven of the modes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..cards import Signals
from ..cones import product
from ..errors import DataError
from ..exact.matrix import Matrix
from ..systems.system import System
from .accept import loop_of
from .plant import Plant
from .result import DesignResult, changed

# The law of such gains; s is the mode.
BY_MODE = "u = F_s x"


def by_mode(plant: Plant) -> Plant:
    """The plant with a group of inputs for every vertex, which none of the others has."""
    count, m = len(plant.vertices), plant.m
    if count == 1:
        raise DataError("per_mode needs vertices: give (A_s, B_s) of every mode.")
    sys, bounds = plant.system, plant.interval
    if plant.ports and not sys.D.is_zero:
        raise DataError("per_mode with ports needs D = 0: the outputs of all modes are C x.")
    if bounds is not None and bounds.u_max is not None:
        bounds = replace(bounds, u_max=Matrix.join([bounds.u_max] * count, 0))

    def beside(M: Matrix, s: int) -> Matrix:
        rows = M.shape[0]
        return Matrix.join([Matrix.zeros(rows, s * m), M, Matrix.zeros(rows, (count - 1 - s) * m)], -1)

    vertices = tuple((A, beside(B, s)) for s, (A, B) in enumerate(plant.vertices))
    U = product([sys.U] * count)
    system = System.read((sys.A, vertices[0][1], sys.C, beside(sys.D, 0)), X=sys.X, U=U, Y=sys.Y, dt=sys.dt)
    return replace(
        plant,
        system=system,
        vertices=vertices,
        gain_bound=None if plant.gain_bound is None else np.tile(plant.gain_bound, count),
        interval=bounds,
        pattern=None if plant.pattern is None else np.tile(plant.pattern, (count, 1)),
        names={},
    )


def signals_by_mode(signals: Signals, plant: Plant) -> Signals:
    """Names for the inputs of `by_mode`, which nobody else numbers like this."""
    own = signals.inputs or tuple(f"input {i}" for i in range(plant.m))
    names = tuple(f"{name} of mode {s}" for s in range(len(plant.vertices)) for name in own)
    return replace(signals, inputs=names)


def taken_apart(result: DesignResult, plant: Plant) -> DesignResult:
    """The result with F of shape (S, m, n) and one closed loop for each mode of the plant, as it was before."""
    if not result:
        return changed(result, law=BY_MODE)
    gains = np.asarray(result.F).reshape(len(plant.vertices), plant.m, plant.n)
    closed = [loop.A for loop in result.certificate.loops]  # type: ignore[union-attr]
    loops = tuple(loop_of(plant, M, B, Matrix(F)) for M, (_, B), F in zip(closed, plant.vertices, gains, strict=True))
    return changed(result, F=gains, closed_loop=loops, law=BY_MODE)
