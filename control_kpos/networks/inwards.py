"""Vectors moved into their cones by a few units in the last place, so that inequalities hold in spite of rounding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..cones import Cone, Orthant
from ..exact.rounding import HALF_ULP
from . import conditions as on
from .blocks import Floats
from .model import NetworkModel


def lower_outputs(model: NetworkModel, r: Floats) -> Floats:
    """-W'r, less a few units in the last place in the order of Y*."""
    longest = int(np.diff(model.WT.indptr).max(initial=0)) + max(s.sizes[2] for s in model.stacks)
    value, positive = model.WT @ r, model.WT.data.min(initial=0.0) >= 0 and r.min(initial=0.0) >= 0
    size = value if positive else abs(model.WT) @ np.abs(r)
    return -inwards(model, "Y", value, size, longest, dual=True)


def moved(model: NetworkModel, name: str, terms: Sequence[tuple[str, Floats]], *, dual: bool) -> Floats:
    """The sum of products M'x of all nodes (of M x if not `dual`), raised in the order of the dual cones (lowered)."""
    value = sum(model.times(matrix, x, transposed=dual) for matrix, x in terms)
    size = sum(model.times(matrix, np.abs(x), transposed=dual, absolute=True) for matrix, x in terms)
    return inwards(model, name, value, size, max(sum(s.sizes) for s in model.stacks), dual=dual)


def inwards(model: NetworkModel, name: str, value: Any, size: Any, count: int, *, dual: bool) -> Floats:
    """Sums of `count` products, raised in the order of the dual cones U* or Y* of the nodes, or lowered in U or Y.

    What is added is interior to the cones and outweighs the roundings of numbers of that size.
    """
    kind = "XUY".index(name)
    split = zip(model.stacks, model.split(value, kind), model.split(size, kind), strict=True)
    return model.join([shifted(getattr(s, name), x, z, count, dual=dual) for s, x, z in split], kind)


def shifted(cone: Cone, value: Floats, size: Floats, count: int, *, dual: bool) -> Floats:
    """Rows raised in the order of the dual of a cone, or lowered in that of the cone; see `inwards`."""
    units = 8 * (2 * count + 24) * HALF_ULP * (1 if dual else -1)
    if not isinstance(cone, Orthant):
        rows = (cone.exact_rays.dense() if dual else on.facets(cone)).values
        point = np.asarray((cone.dual if dual else cone).interior_point)
        point = point * (np.abs(rows).sum(axis=1) / (rows @ point)).max()
        size = size.max(axis=1, keepdims=True, initial=0.0) * point
    return value + units * size


def lower_received(model: NetworkModel, y: Floats) -> Floats:
    """W y, less a few units in the last place in the order of U."""
    longest = int(np.diff(model.W.indptr).max(initial=0))
    return inwards(model, "U", model.W @ y, abs(model.W) @ np.abs(y), longest, dual=False)
