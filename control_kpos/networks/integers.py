"""The matrices of all nodes as sparse integers, block diagonal."""

from __future__ import annotations

from fractions import Fraction
from math import lcm

import numpy as np

from ..exact.matrix import Integers, Matrix
from ..exact.sparse_integers import SparseIntegers
from ..theorems.generator_coordinates import block_diagonal, sparse_integers
from .blocks import shared
from .model import BLOCKS, NetworkModel


def scales(model: NetworkModel) -> tuple[int, int]:
    """What A and B of all nodes, and C and D, are multiplied by to be integers."""
    state, output = (
        lcm(*(_integers(getattr(s, name))[1].denominator for s in model.stacks for name in names))
        for names in ("AB", "CD")
    )
    return state, output


def blocks(model: NetworkModel, name: str, scale: int, *, beside: bool = False) -> SparseIntegers:
    """A, B, C or D of all nodes times the scale; with `beside`, as part of [A, B] or [C, D]."""
    (i, j), (n, m, _) = BLOCKS[name], model.totals
    first, width = (j * n, n + m) if beside else (0, model.totals[j])
    own = []
    for s, places in zip(model.stacks, model.places, strict=True):
        ints, factor = _integers(getattr(s, name))
        own.append((places[i], places[j] + first, ints * int(factor * scale)))
    return block_diagonal(own, (model.totals[i], width))


def direct_loop_of(model: NetworkModel) -> tuple[SparseIntegers, int]:
    """W D as integers, and what they are to be divided by."""
    (W, factor), output = sparse_integers(model.coupling), scales(model)[1]
    loop = W.times(factor.numerator) @ blocks(model, "D", output)
    return loop.without_zeros(), output * factor.denominator


def _integers(stack: Matrix) -> tuple[Integers, Fraction]:
    """A stack as integers times a factor; one matrix of it if all are one."""
    numerators, factor = shared(stack).as_integers()
    return np.asarray(numerators, dtype=object), Fraction(factor)
