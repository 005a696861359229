"""The linear program of a whole network with local feedback, assembled on stacked arrays.

Nodes x_j' = A_j x_j + B_j u_j, y_j = C_j x_j on simplicial cones with generators t_k, u_j = F_j x_j + sum_l W_jl y_l.
With xi_j > 0 and z_jk = xi_jk F_j t_k, invariance of every node and a decay rate of the network read

    h_i'(A_j t_k xi_jk + B_j z_jk) >= 0  (i != k),
    sum_k h_i'(A_j t_k xi_jk + B_j z_jk) + sum_l h_i'B_j W_jl C_l x_l < -rate d_i xi_ji,   x_l = sum_k xi_lk t_k:

linear, with a handful of entries per row, and necessary and sufficient.  With one F for all nodes, one xi
serves all of them, which is sufficient only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ...exact.budget import spend
from ...networks.model import NetworkModel
from ...networks.nodes import NodeStack
from ...theorems.decay_rates import Rate
from ..plant import coordinates
from ..running import Programs
from ..simplicial.program import RatioProgram, stacked

Floats = NDArray[np.float64]
Index = NDArray[np.intp]

# Margins of invariance relative to the size of the nodes, widest first.
MARGINS = (1e-1, 1e-3, 1e-6)
# Inputs with smaller bounds are not used.
_LEAST_BOUND = 1e-100
# Range of magnitudes, in powers of two, below which units are left alone.
_MODERATE = 16
# From this many variables on, the interior point method without crossover is faster than the simplex method.
_LARGE = 4000
# Operations to set up and scale a program, for each entry of its rows; with one gain for all, where few rows differ.
_EFFORT_PER_ENTRY = 1e3, 300.0


@dataclass(frozen=True, eq=False)
class Task:
    """Local gains that are asked for a network.

    Attributes
    ----------
    model : NetworkModel
        Simplicial state cones, D = 0.
    bound : ndarray, shape (sum m_j,), or None
        |F_j t_k| <= bound, input by input.
    uniform : bool
        One F and one xi for all nodes (one stack).
    rate : float or Fraction
    lp : callable
    gap : float
        Part by which the gain may exceed the smallest one, where no bound is given.
    """

    model: NetworkModel
    bound: Floats | None
    uniform: bool
    rate: Rate
    lp: Programs
    gap: float = 1e-3


class Geometry:
    """Generators and matching facets of a stack's cone, and its matrices in these coordinates.

    Attributes
    ----------
    HAT, HB, CT : ndarray, shapes (N, n, n), (N, n, m), (N, q, n)
        A, B and C, with states in their units.
    HZ : ndarray, shape (N, n, m)
        B with inputs in their units as well.
    sizes : ndarray, shape (n,)
        Of the leading entries of the generators: gains are measured at the generators divided by these.
    """

    def __init__(self, stack: NodeStack) -> None:
        X = stack.X
        order = np.argmin(np.asarray(X.incidence), axis=0)
        facets = np.asarray(X.facets, dtype=float)[order]
        self.rays, self.sizes = coordinates(X, facets, [np.asarray(stack.A.values)])
        self.facets = facets / np.einsum("ij,ij->i", facets, self.rays)[:, None]
        self.A, self.B, self.C = (np.asarray(M.values) for M in (stack.A, stack.B, stack.C))
        self.HAT = self.facets @ self.A @ self.rays.T
        self.HB, self.CT = self.facets @ self.B, self.C @ self.rays.T
        self.units, self.input_units = np.ones(self.HAT.shape[:2]), np.ones(self.HB.shape[::2])
        self.HZ = self.HB

    def use(self, units: Floats) -> None:
        """Change to other units of the states, and to suitable ones of the inputs."""
        self.units = units
        self.HAT = self.HAT * units[:, None, :] / units[:, :, None]
        self.HB, self.CT = self.HB / units[:, :, None], self.CT * units[:, None, :]
        self.input_units = input_units(self.HAT, self.HB)
        self.HZ = self.HB * self.input_units[:, None, :]

    def measure(self) -> Floats:
        """|F t_k| / sizes_k per unit of z / xi, shape (N, n, m)."""
        return self.input_units[:, None, :] / (self.units * self.sizes)[:, :, None]


class NetworkProgram(RatioProgram):
    """Rows over (xi, z) of all nodes.

    Parameters
    ----------
    task : Task
    margin : float
        Demanded of invariance, relative to the size of each row.
    bounded : bool
        False: without the bound on the gain.
    """

    tolerance = 1e-3

    def __init__(self, task: Task, margin: float = MARGINS[-1], *, bounded: bool = True) -> None:
        model, lp, self.uniform, self.margin = task.model, task.lp, task.uniform, margin
        super().__init__(lp, model.discrete)
        self.tolerance = min(self.tolerance, task.gap / 8)
        entries = sum(s.A.values.size * (1 + s.sizes[1]) for s in model.stacks)
        spend(entries * _EFFORT_PER_ENTRY[self.uniform])
        self.model = model
        self.parts = [Geometry(s) for s in model.stacks]
        self.xi, self.z, self.size = self._variables()
        self.owner = np.zeros(self.size, dtype=np.intp)
        for xi, z in zip(self.xi, self.z, strict=True):
            self.owner[xi], self.owner[z] = xi, xi[:, :, None]
        self.lp = lp if self.size < _LARGE else lambda *data, **more: lp(*data, **more, method="ipm")
        self.bound = None if task.bound is None or not bounded else model.split(task.bound, 1)
        if not self.uniform:
            for g, units in zip(self.parts, state_units([g.HAT for g in self.parts], self._links()), strict=True):
                g.use(units)
        for g, used in zip(self.parts, self.used, strict=True):
            g.HZ = g.HZ * used[:, None, :]
        self.scale = max(float(max(np.abs(g.HAT).max(), np.abs(g.HZ).max(initial=0.0))) for g in self.parts)

    @cached_property
    def used(self) -> list[NDArray[np.bool_]]:
        """Inputs (N, m) of every stack whose bound is not 0, or next to it; with one gain, at all nodes."""
        if self.bound is None:
            return [np.ones(g.HZ.shape[::2], dtype=bool) for g in self.parts]
        used = [b > _LEAST_BOUND for b in self.bound]
        return [np.broadcast_to(u.all(axis=0), u.shape) for u in used] if self.uniform else used

    def _variables(self) -> tuple[list[Index], list[Index], int]:
        """Columns of xi (N, n) and z (N, n, m) per stack; all xi come first."""
        shapes = [(len(s), *s.sizes[:2]) for s in self.model.stacks]
        if self.uniform:
            n, m = shapes[0][1:]
            one = n + np.arange(n * m).reshape(n, m)
            xi = [np.tile(np.arange(n), (count, 1)) for count, *_ in shapes]
            return xi, [np.tile(one, (count, 1, 1)) for count, *_ in shapes], n * (1 + m)
        xi = _numbered([shape[:2] for shape in shapes])
        z = _numbered(shapes, sum(each.size for each in xi))
        return xi, z, sum(each.size for each in (*xi, *z))

    @cached_property
    def closed(self) -> sp.csr_array:
        """Invariance with its margin: rows that must not be negative."""
        parts = []
        for g, xi, z in zip(self.parts, self.xi, self.z, strict=True):
            n, m = g.HAT.shape[1], g.HZ.shape[2]
            where = np.ones((n, n), dtype=bool) if self.model.discrete else ~np.eye(n, dtype=bool)
            i, k = np.nonzero(where)
            movable = np.abs(g.HZ[:, i]).max(axis=2, initial=0.0)
            size = np.abs(g.HAT[:, i, k]) + movable
            data = [(g.HAT[:, i, k] - self.margin * np.where(movable > 0, size, 0.0))[..., None], g.HZ[:, i]]
            columns = [xi[:, k][..., None], z[:, k]]
            parts.append(_rows(np.concatenate(data, axis=2), np.concatenate(columns, axis=2), 1 + m, self.size))
        return _distinct(stacked(*parts)) if self.uniform else stacked(*parts)

    @cached_property
    def drift(self) -> sp.csr_array:
        """A_cl applied to xi, facet by facet, in the order of stacks."""
        local = []
        for g, xi, z in zip(self.parts, self.xi, self.z, strict=True):
            count, n, _ = g.HAT.shape
            m = g.HZ.shape[2]
            data = np.concatenate(
                [g.HAT, np.broadcast_to(g.HZ[:, :, None, :], (count, n, n, m)).reshape(count, n, n * m)], axis=2
            )
            columns = np.concatenate([xi, z.reshape(count, n * m)], axis=1)
            local.append(_rows(data, np.broadcast_to(columns[:, None, :], data.shape), n * (1 + m), self.size))
        return sp.csr_array(stacked(*local) + self._links() @ self.weights)

    def _links(self) -> sp.csr_array:
        """h_i'B_j W_jl C_l t_k, in the order of stacks."""
        model = self.model
        total = sum(g.HB.shape[0] * g.HB.shape[1] for g in self.parts)
        if not model.W.nnz:
            return sp.csr_array((total, total))
        pushed, seen = [], []
        for g, rows, places in zip(
            self.parts, _numbered([g.HB.shape[:2] for g in self.parts]), model.places, strict=True
        ):
            pushed.append(_coo(g.HB, rows, places[1]))
            seen.append(_coo(g.CT, places[2], rows))
        inputs, outputs = model.totals[1], model.totals[2]
        return sp.csr_array(_sum(pushed, (total, inputs)) @ model.W @ _sum(seen, (outputs, total)))

    @cached_property
    def weights(self) -> sp.csr_array:
        """xi, row by row of `drift`."""
        columns = np.concatenate([xi.ravel() for xi in self.xi])
        return _picked(columns, np.ones(len(columns)), self.size)

    @cached_property
    def slope(self) -> sp.csr_array:
        """z and -z, input by input, divided by the bound if there is one."""
        measures = [g.measure() for g in self.parts]
        if self.bound is not None:
            bounds = [np.where(used, b, 1.0) for used, b in zip(self.used, self.bound, strict=True)]
            measures = [each / b[:, None, :] for each, b in zip(measures, bounds, strict=True)]
        columns, place = np.unique(np.concatenate([z.ravel() for z in self.z]), return_inverse=True)
        factors = np.zeros(len(columns))
        np.maximum.at(factors, place, np.concatenate([each.ravel() for each in measures]))
        half = _picked(columns, factors, self.size)
        return stacked(half, -half)

    @cached_property
    def level(self) -> sp.csr_array:
        """xi, row by row of `slope`."""
        owners = self.owner[self.slope.indices]
        return _picked(owners, np.ones(len(owners)), self.size)

    @cached_property
    def bounds(self) -> sp.csr_array:
        """Rows of the gain bound, which may be reached but for rounding: must not be positive."""
        if self.bound is None:
            return sp.csr_array((0, self.size))
        return sp.csr_array(self.slope - (1 - 1e-9) * self.level)

    def decreasing(self, rate: Rate) -> sp.csr_array:
        """Rows that must be negative for the decay rate."""
        rows = sp.csr_array(super().decreasing(rate))
        return _distinct(rows) if self.uniform else rows

    def gains(self, x: Floats) -> list[Floats]:
        """F per stack, shape (N, m, n)."""
        out = []
        for g, xi, z, used in zip(self.parts, self.xi, self.z, self.used, strict=True):
            columns = x[z] / (x[xi] * g.units)[:, :, None] * (g.input_units * used)[:, None, :]
            out.append(np.swapaxes(np.linalg.inv(g.rays) @ columns, 1, 2))
        return out


def _rows(data: Floats, columns: Index, width: int, size: int) -> sp.csr_array:
    count = data.size // width
    indptr = np.arange(0, data.size + 1, width)
    return sp.csr_array((data.ravel(), np.ascontiguousarray(columns).ravel(), indptr), shape=(count, size))


def _numbered(shapes: Sequence[tuple[int, ...]], at: int = 0) -> list[Index]:
    """Consecutive numbers in arrays of these shapes."""
    ends = at + np.cumsum([np.prod(shape, dtype=int) for shape in shapes])
    return [np.arange(end - np.prod(shape), end).reshape(shape) for shape, end in zip(shapes, ends, strict=True)]


def _picked(columns: Index, factors: Floats, size: int) -> sp.csr_array:
    """Rows of one entry each."""
    return sp.csr_array((factors, (np.arange(len(columns)), columns)), shape=(len(columns), size))


def _coo(blocks: Floats, rows: Index, columns: Index) -> tuple[Floats, Index, Index]:
    shape = blocks.shape
    return (
        blocks.ravel(),
        np.broadcast_to(rows[:, :, None], shape).ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )


def _sum(parts: list[tuple[Floats, Index, Index]], shape: tuple[int, int]) -> sp.csr_array:
    data, rows, columns = (np.concatenate(group) for group in zip(*parts, strict=True))
    return sp.csr_array((data, (rows, columns)), shape=shape)


def _distinct(rows: sp.csr_array) -> sp.csr_array:
    """Each row once; rows over few shared variables repeat for alike nodes."""
    # two random products tell rows apart, and a program that lost one would only propose a worse point
    keys = rows @ np.random.default_rng(0).standard_normal((rows.shape[1], 2))
    first = np.unique(keys[:, 0] + 1j * keys[:, 1], return_index=True)[1]
    return sp.csr_array(rows[np.sort(first)])


# -- units of states and inputs, chosen by powers of two
#
# A grid in SI units has states of 1e-6 and 1e6 side by side; in units d, A becomes D^{-1} A D.  The units sought make
# the entries of A, and of the links, about as large as their mirror images: with a_ik the logarithms of the entries, d
# minimises sum (a_ik + d_k - d_i)^2, a Laplacian system.  Data of moderate range are left as they are.


def state_units(local: list[Floats], links: sp.csr_array) -> list[Floats]:
    """Powers of two for the states of every node, shape (N, n) for each stack.

    Parameters
    ----------
    local : list of ndarray, shape (N, n, n)
        A of the nodes in the coordinates of their generators.
    links : csr_array, shape (sum n, sum n)
        B W C in these coordinates, in the order of the stacks.
    """
    plain = [np.ones(M.shape[:2]) for M in local]
    sizes = [np.abs(values[values != 0]) for values in (*local, links.data)]
    if _spread(np.concatenate(sizes)) <= _MODERATE:
        return plain
    numbers = _numbered([M.shape[:2] for M in local])
    own = _sum([_coo(M, number, number) for M, number in zip(local, numbers, strict=True)], links.shape)
    whole = sp.csr_array(own + links).tocoo()
    off = (whole.row != whole.col) & (whole.data != 0)
    i, k, size = whole.row[off], whole.col[off], np.frexp(whole.data[off])[1].astype(float)
    # rows of d_i - d_k = size
    ones, at = np.ones(len(size)), links.shape[0]
    incidence = _picked(i, ones, at) - _picked(k, ones, at)
    found = spla.lsqr(incidence, size, atol=1e-3, btol=1e-3, iter_lim=200)[0]
    if np.ptp(found) <= _MODERATE:  # a few small links, not other units
        return plain
    units = np.exp2(np.clip(np.rint(found), -500, 500))
    return [units[number] for number in numbers]


def input_units(A: Floats, B: Floats) -> Floats:
    """Powers of two for the inputs of every node, shape (N, m), that bring the columns of B to the size of A.

    Parameters
    ----------
    A, B : ndarray, shapes (N, n, n), (N, n, m)
    """
    pushes, size = np.abs(B).max(axis=1, initial=0.0), np.abs(A).max(axis=(1, 2), initial=0.0)
    target = np.frexp(np.where(size > 0, size, 1.0))[1][:, None]
    exponent = np.where(pushes > 0, target - np.frexp(pushes)[1], 0)
    return np.where(np.abs(exponent) > _MODERATE, np.exp2(exponent.astype(float)), 1.0)


def _spread(sizes: Floats) -> int:
    exponents = np.frexp(sizes)[1]
    return int(exponents.max() - exponents.min()) if sizes.size else 0
