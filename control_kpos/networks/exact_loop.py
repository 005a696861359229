"""The closed loop of a network in exact arithmetic, for networks of moderate size.

    A + B L C,    B R,    C + D L C,    D R,    with R = (I - W D)^{-1} and L = R W,

multiplied out in integers on the entries that are not zero.  R is the finite sum of powers of W D where no
feedthrough closes a loop, and otherwise the solution of a small system of equations.
"""

from __future__ import annotations

from fractions import Fraction
from math import gcd, lcm

import numpy as np
from scipy.sparse.csgraph import connected_components

from ..exact.linalg import solve_exactly
from ..exact.matrix import Integers, Matrix
from ..exact.sparse_integers import SparseIntegers
from ..theorems.generator_coordinates import block_diagonal, sparse_integers
from .model import BLOCKS, NetworkModel

# States up to which a closed loop is multiplied out exactly; above, its doubles are what there is.
EXACT_STATES = 300
# Products of entries up to which this is done, and inputs if feedthrough terms close a loop.
_MOST_PRODUCTS = 500_000
_MOST_LOOPING = 40


class TooManyProductsError(Exception):
    """The exact closed loop would take too long."""


def exact_loop(model: NetworkModel) -> tuple[Matrix, Matrix, Matrix, Matrix] | None:
    """A, B, C, D of the closed loop from all external inputs to all outputs, or None where it takes too long."""
    if model.totals[0] > EXACT_STATES:
        return None
    (W, factor), (state, output) = sparse_integers(model.coupling), scales(model)
    a, b = (blocks(model, name, state) for name in "AB")
    c, d = (blocks(model, name, output) for name in "CD")
    w, port = W.times(factor.numerator), output * factor.denominator
    try:
        R, whole = _resolvent(_product(w, d), port)
        heard, size = _product(R, _product(w, c)), whole * port
        return (
            _matrix(a.times(size) + _product(b, heard), state * size),
            _matrix(_product(b, R), state * whole),
            _matrix(c.times(size) + _product(d, heard), output * size),
            _matrix(_product(d, R), output * whole),
        )
    except TooManyProductsError:
        return None


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


def _integers(stack: Matrix) -> tuple[Integers, Fraction]:
    """A stack as integers times a factor; one matrix of it if all are one."""
    if stack.is_double and len(stack.values) > 1 and not stack.values.strides[0]:
        stack = Matrix(stack.values[:1])
    numerators, factor = stack.as_integers()
    return np.asarray(numerators, dtype=object), Fraction(factor)


def _product(left: SparseIntegers, right: SparseIntegers) -> SparseIntegers:
    if np.diff(right.indptr)[left.indices].sum() > _MOST_PRODUCTS:
        raise TooManyProductsError
    return (left @ right).without_zeros()


def _resolvent(loop: SparseIntegers, port: int) -> tuple[SparseIntegers, int]:
    """R = (I - loop / port)^{-1} as integers, and what they are to be divided by."""
    size = loop.height
    unit, pattern = SparseIntegers.diagonal(np.ones(size, dtype=object)), loop.pattern()
    parts, _ = connected_components(pattern, directed=True, connection="strong")
    if parts == size and not pattern.diagonal().any():  # no loops: a power of W D vanishes
        out, term, whole = unit, unit, 1
        while len(term.data):
            term = _product(term, loop)
            out, whole = out.times(port) + term, whole * port
        return out, whole
    if size > _MOST_LOOPING:
        raise TooManyProductsError
    eye = unit.times(port).toarray()
    solution = solve_exactly(eye - loop.toarray(), eye)
    if solution is None:  # so close to singular that the test in doubles did not notice
        raise TooManyProductsError
    sign = -1 if solution[1] < 0 else 1
    return SparseIntegers.dense(solution[0] * sign), solution[1] * sign


def _matrix(integers: SparseIntegers, denominator: int) -> Matrix:
    """As a dense matrix, divided."""
    content = gcd(denominator, *integers.data.tolist())
    return Matrix.over(integers.toarray() // content, denominator // content)
