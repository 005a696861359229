"""The closed loop of a network as sparse matrices and as an operator, and in exact arithmetic up to moderate size.

x' = (A + B L C) x + B R w,   y = (C + D L C) x + D R w,   R = (I - W D)^{-1},  L = R W.

Exactly, R is the finite sum of powers of W D where no feedthrough closes a loop, and otherwise the solution of a small
system of equations.
"""

from __future__ import annotations

from functools import cached_property
from math import gcd
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ..errors import TooLargeError
from ..exact.linalg import solve_exactly
from ..exact.matrix import Matrix
from ..exact.sparse_integers import SparseIntegers
from ..theorems.generator_coordinates import sparse_integers
from .blocks import Floats, Index, converging, read_only
from .integers import blocks, scales
from .model import NetworkModel
from .well_posed import require_well_posed

# Inputs above which (I - W D)^{-1} is not formed if the feedthrough terms close loops.
LOOP_LIMIT = 5_000
# Entries of rows of R up to which some outputs of larger networks are computed all the same.
_MOST_SOLVED = 10**8
# States up to which a closed loop is multiplied out exactly; above, its doubles are what there is.
EXACT_STATES = 300
# Products of entries up to which this is done, and inputs if feedthrough terms close a loop.
_MOST_PRODUCTS = 500_000
_MOST_LOOPING = 40


class ClosedLoop:
    """The closed loop from all external inputs to all outputs; DataError if I - W D is singular."""

    def __init__(self, model: NetworkModel) -> None:
        self.model = model
        require_well_posed(model)

    @cached_property
    def _multiplied(self) -> tuple[Matrix, Matrix, Matrix, Matrix] | None:
        return exact_loop(self.model)

    @property
    def is_exact(self) -> bool:
        """True if `matrices` are the closed loop itself; False if they are its doubles."""
        return self._multiplied is not None

    @property
    def matrices(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """A, B, C, D as what verdicts are about: exact up to `EXACT_STATES` states, above that sparse doubles."""
        return self._multiplied or (Matrix(self.A), Matrix(self.B), Matrix(self.C), Matrix(self.D))

    @property
    def A(self) -> sp.csr_array:
        """A + B L C, shape (sum n_j, sum n_j)."""
        return self._sparse[0]

    @property
    def B(self) -> sp.csr_array:
        """B R, from all external inputs."""
        return self._sparse[1]

    @property
    def C(self) -> sp.csr_array:
        """C + D L C, to all outputs."""
        return self._sparse[2]

    @property
    def D(self) -> sp.csr_array:
        """D R."""
        return self._sparse[3]

    @cached_property
    def _sparse(self) -> tuple[sp.csr_array, ...]:
        if self._multiplied is not None:
            return tuple(read_only(sp.csr_array(m.values)) for m in self._multiplied)
        a, b, c, d = self.model.block_matrices
        heard = self.model.W @ c
        loop = a + b @ heard, b, c, d
        if self.model.has_feedthrough:
            R = self._resolve
            loop = a + b @ (R @ heard), b @ R, c + d @ (R @ heard), d @ R
        return tuple(read_only(sp.csr_array(m)) for m in loop)

    @cached_property
    def _resolve(self) -> Any:
        """R = (I - W D)^{-1}, sparse."""
        size = self.model.totals[1]
        eye = sp.eye_array(size, format="csr")
        if not self.model.has_feedthrough:
            return eye
        loop = sp.csr_array(self.model.W @ self.model.block_matrices[3])
        loop.eliminate_zeros()
        out = term = eye
        for _ in range(60):  # ends by itself if no feedthrough closes a loop
            term = sp.csr_array(term @ loop)
            term.eliminate_zeros()
            if not term.nnz:
                return out
            out = out + term
            if out.nnz > 50 * size + 10**6:
                break
        if size > LOOP_LIMIT:
            raise TooLargeError(
                f"the feedthrough terms close loops over {size} inputs, so the closed-loop matrices are dense; "
                f"they are formed up to {LOOP_LIMIT} inputs. Use the responses and certificates, which do not "
                "need them."
            )
        with converging("the closed loop"):
            return sp.csr_array(np.linalg.inv((eye - loop).toarray()))

    @cached_property
    def _factors(self) -> Any:
        return spla.splu(sp.csc_array(sp.eye_array(self.model.totals[1]) - self.model.W @ self.model.block_matrices[3]))

    @cached_property
    def matrix(self) -> Any:
        """A as something with `@`: the sparse matrix, or the operator where it would fill in."""
        try:
            return self.A
        except TooLargeError:
            n = self.model.totals[0]
            return spla.LinearOperator((n, n), matvec=self.drift, dtype=float)

    def drift(self, x: Floats, w: Floats | None = None) -> Floats:
        """A x + B w without forming A."""
        a, b, c, _ = self.model.block_matrices
        u = self.model.W @ (c @ x)
        if w is not None:
            u = u + w
        if self.model.has_feedthrough:
            u = self._factors.solve(u)
        return a @ x + b @ u

    def output_matrices(self, rows: Index) -> tuple[sp.csr_array, sp.csr_array]:
        """The rows of C and D that give some outputs; where R is dense, by a solve for each of them."""
        try:
            return sp.csr_array(self.C[rows]), sp.csr_array(self.D[rows])
        except TooLargeError:
            if len(rows) * self.model.totals[1] > _MOST_SOLVED:
                raise
        _, _, c, d = self.model.block_matrices
        sent = sp.csr_array(self._factors.solve(d[rows].toarray().T, "T").T)
        return sp.csr_array(c[rows] + sent @ (self.model.W @ c)), sent


# -- in exact arithmetic


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
