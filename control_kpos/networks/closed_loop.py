"""The closed loop of a network as sparse matrices and as an operator.

x' = (A + B L C) x + B R w,   y = S C x + S D w,   R = (I - W D)^{-1},  L = R W,  S = (I - D W)^{-1}.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ..errors import DataError, TooLargeError
from ..exact.matrix import Matrix
from .blocks import Floats, Index
from .exact_loop import exact_loop
from .model import NetworkModel
from .witnesses import list_nodes

# Inputs above which (I - W D)^{-1} is not formed if the feedthrough terms close loops.
LOOP_LIMIT = 5_000


class ClosedLoop:
    """The closed loop from all external inputs to all outputs.

    Parameters
    ----------
    model : NetworkModel

    Raises
    ------
    DataError
        I - W D is singular; the message names the nodes of the algebraic loop.
    """

    def __init__(self, model: NetworkModel) -> None:
        self.model = model
        if model.has_feedthrough:
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

    @cached_property
    def A(self) -> sp.csr_array:
        """A + B L C, shape (sum n_j, sum n_j)."""
        if self._multiplied is not None:
            return _sparse(self._multiplied[0])
        a, b, c, _ = self.model.block_matrices
        return read_only(sp.csr_array(a + b @ (self._resolve @ (self.model.W @ c))))

    @cached_property
    def B(self) -> sp.csr_array:
        """B R, from all external inputs."""
        if self._multiplied is not None:
            return _sparse(self._multiplied[1])
        return read_only(sp.csr_array(self.model.block_matrices[1] @ self._resolve))

    @cached_property
    def C(self) -> sp.csr_array:
        """S C = C + D L C, to all outputs."""
        if self._multiplied is not None:
            return _sparse(self._multiplied[2])
        _, _, c, d = self.model.block_matrices
        if not self.model.has_feedthrough:
            return read_only(c)
        return read_only(sp.csr_array(c + d @ (self._resolve @ (self.model.W @ c))))

    @cached_property
    def D(self) -> sp.csr_array:
        """S D = D R."""
        if self._multiplied is not None:
            return _sparse(self._multiplied[3])
        return read_only(sp.csr_array(self.model.block_matrices[3] @ self._resolve))

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
        """The rows of C and D that give some outputs."""
        return sp.csr_array(self.C[rows]), sp.csr_array(self.D[rows])


def _sparse(m: Matrix) -> sp.csr_array:
    return read_only(sp.csr_array(m.values))


def read_only(M: sp.csr_array) -> sp.csr_array:
    """The same matrix, in which nothing can be assigned any more."""
    M.sort_indices()
    for part in (M.data, M.indices, M.indptr):
        part.flags.writeable = False
    return M


def require_well_posed(model: NetworkModel) -> None:
    """Raise if I - W D is singular, naming the algebraic loop."""
    loop = sp.csr_array(model.W @ model.block_matrices[3])
    loop.eliminate_zeros()
    size = loop.shape[0]
    count, component = connected_components(loop, directed=True, connection="strong")
    members = np.bincount(component, minlength=count)
    looping = (members > 1)[component] | (loop.diagonal() != 0)
    if not looping.any():
        return
    owner = model.owners(1)
    for c in np.unique(component[looping])[:1000]:
        index = np.flatnonzero(component == c)
        part = sp.csc_array(sp.eye_array(len(index)) - loop[index][:, index])
        if _is_singular(part):
            nodes = np.unique(owner[index])
            raise DataError(
                "the network is not well posed: I - W D is singular on the algebraic loop through "
                f"{list_nodes(nodes)}. "
                "Change a feedthrough term D or a link of this loop, or put dynamics into it."
            )
    if size and count > 1000 and _is_singular(sp.csc_array(sp.eye_array(size) - loop)):
        raise DataError(
            "the network is not well posed: I - W D is singular on one of its algebraic loops; change D or W there."
        )


def _is_singular(matrix: sp.csc_array) -> bool:
    if matrix.shape[0] <= 500:
        with suppress(np.linalg.LinAlgError):  # no convergence
            values = np.linalg.svd(matrix.toarray(), compute_uv=False)
            return bool(values[-1] <= 4 * matrix.shape[0] * np.finfo(float).eps * values[0])
    try:
        pivots = np.abs(spla.splu(matrix).U.diagonal())
    except RuntimeError:
        return True
    return bool(pivots.min() <= 1e-14 * pivots.max())
