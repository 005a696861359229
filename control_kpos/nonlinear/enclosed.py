"""Jacobians of all nodes and links of a network on a box, enclosed array-wise, in coordinates by generators.

Let T_j have the generators of X_j as columns and x_j = T_j z_j: then X_j is the orthant of z_j, and the order interval
{x : a <= x <= b in the order of X_j} a box.  With A = df/dx, B = df/du, C = dg/dx the Jacobian of the closed loop is
that of the network

    T^{-1} A T,    T^{-1} B,    C T,    W + S,    with B_i s_i C_own(i) taken off T^{-1} A T for links of differences,

s_i being the sum of the slopes S of these links at input i.  All ends are rounded outwards; what is typed stays exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import DataError, ShapeError
from ..exact.intake import exact_matrix
from ..exact.interval_arithmetic import difference, product, sum_of
from ..exact.jacobians import on_pieces, values_and_blocks
from ..exact.matrix import Matrix
from ..exact.rounding import HALF_ULP
from ..exact.unreadable import UnboundedError, UnsupportedError
from ..networks.blocks import Index, block_diagonal
from ..networks.model import NetworkModel
from ..networks.network import ConeNetwork
from ..networks.nodes import NodeStack
from ..networks.ranges import Interval
from .nodes import Links, NonlinearNodes, is_orthant

if TYPE_CHECKING:
    from .network import NonlinearNetwork

Array = NDArray[np.float64]
Ends = tuple[Any, Any]


@dataclass(frozen=True)
class Coordinates:
    """T and its inverse, each between two ends; None for an orthant.

    Attributes
    ----------
    T, inverse : tuple of ndarray, shapes (n, n)
    """

    T: Ends
    inverse: Ends

    @classmethod
    def of(cls, kind: NonlinearNodes) -> Coordinates | None:
        """Those of the cone of a kind of nodes."""
        if is_orthant(kind.X):
            return None
        rays, facets = (M.plain().fractions() for M in (kind.X.exact_rays, kind.X.exact_facets))
        products = facets @ rays.T
        order = [int(np.flatnonzero(products[:, k])[0]) for k in range(len(rays))]
        inverse = np.array([facets[h] / products[h, k] for k, h in enumerate(order)], dtype=object)
        T, back = Matrix.from_fractions(rays.T), Matrix.from_fractions(inverse)
        return cls(both(lambda side: T.rounded(up=bool(side))), both(lambda side: back.rounded(up=bool(side))))


def both(make: Callable[[int], Any]) -> Ends:
    """What is made for the lower side (0) and for the upper one (1)."""
    return make(0), make(1)


def mixed(M: Ends, x: Ends) -> Ends:
    """M x for a matrix between ends and a stack (N, n, k) of them; loops over the entries of M only."""
    rows = []
    for i in range(len(M[0])):
        total: Ends | None = None
        for j in range(M[0].shape[1]):
            if M[0][i, j] or M[1][i, j]:
                part = product((M[0][i, j], M[1][i, j]), (x[0][:, j], x[1][:, j]))
                total = part if total is None else sum_of(total, part)
        rows.append((0 * x[0][:, 0], 0 * x[0][:, 0]) if total is None else total)
    return np.stack([low for low, _ in rows], axis=1), np.stack([high for _, high in rows], axis=1)


def _turned(x: Ends) -> Ends:
    return np.swapaxes(x[0], -1, -2), np.swapaxes(x[1], -1, -2)


def vectors(M: Ends, x: Ends) -> Ends:
    """M x for vectors (N, n)."""
    low, high = mixed(M, (x[0][:, :, None], x[1][:, :, None]))
    return low[:, :, 0], high[:, :, 0]


@dataclass(frozen=True)
class Blocks:
    """Ends of the Jacobians of a network in coordinates by generators, and of its values.

    Attributes
    ----------
    A, B, C : list of (ndarray, ndarray)
        For every kind, shapes (N, n, n), (N, n, m), (N, q, n).
    W, S : (csr_array, csr_array)
        Slopes of plain links, and of links of differences.
    rates : list of (ndarray, ndarray)
        x' of every kind, shape (N, n), in coordinates by generators.
    """

    A: list[Ends]
    B: list[Ends]
    C: list[Ends]
    W: Ends
    S: Ends
    rates: list[Ends]


class Care(NamedTuple):
    """What is done for narrow enclosures.

    Attributes
    ----------
    pieces : int
        Boxes that the box of every node is cut into, at most.
    growth : bool
        Relative growth is used too, in three times the time.
    """

    pieces: int = 1
    growth: bool = False

    @property
    def more(self) -> str:
        """In the words of `values_and_blocks`."""
        return "growth" if self.growth else ""


QUICK = Care()


def boxes(net: NonlinearNetwork, low: Array, high: Array) -> list[Ends]:
    """For every kind the smallest box (N, n) of states that holds the order interval between two vectors."""
    out = []
    parts = zip(net.kinds, net.model.split(low, 0), net.model.split(high, 0), net.model.members, strict=True)
    for kind, a, b, members in parts:
        T = Coordinates.of(kind)
        if T is None:
            eye = np.eye(a.shape[1])
            T = Coordinates((eye, eye), (eye, eye))
        z_a, z_b = (vectors(T.inverse, (end, end)) for end in (a, b))
        below = z_b[1] < z_a[0]
        if below.any():
            node = int(members[int(np.argmax(below.any(axis=1)))])
            raise DataError(
                f"region: the lower end of {net.model.name_of(node)} exceeds the upper one, or is not below it in the "
                "order of its cone: a region is all that lies between two states in this order."
            )
        out.append(vectors(T.T, (z_a[0], z_b[1])))
    return out


def between(net: NonlinearNetwork, low: Array, high: Array, part: Array) -> Array:
    """The state whose coordinates by generators are at these parts of the way from one end to the other."""
    out = []
    for kind, a, b, t in zip(net.kinds, *(net.model.split(x, 0) for x in (low, high, part)), strict=True):
        T = Coordinates.of(kind)
        if T is None:
            out.append(np.clip((1 - t) * a + t * b, a, b))
        else:
            out.append(a + (t * ((b - a) @ T.inverse[0].T)) @ T.T[0].T)
    return net.model.join(out, 0)


def enclose(
    net: NonlinearNetwork, states: list[Ends], external: Ends, *, slopes: bool = True, care: Care = QUICK
) -> Blocks:
    """Ends of all Jacobians and rates while states and external inputs are in their boxes; or of the rates alone.

    Costs one call of every f and g for each piece that boxes of nodes are cut into, and one of every link function; for
    each of their operations a few passes over arrays.
    """
    y_parts, C = [], []
    turns = [_Turn.of(kind, slopes=slopes) for kind in net.kinds]
    for k, (kind, box) in enumerate(zip(net.kinds, states, strict=True)):
        n, _, q = kind.sizes
        outputs: Any = lambda z, p, kind=kind: kind.outputs(z, p)  # noqa: E731
        found = _called(net, k, outputs, box, (n * slopes, q), "g", care, turns[k].of_outputs)
        y_parts.append(found[:2])
        C.append(found[2:])
    y = both(lambda side: net.model.join([part[side] for part in y_parts], 2))
    u, W, S = _received(net, y, external, slopes, care)
    inputs = [net.model.split(u[side], 1) for side in (0, 1)]
    A, B, rates = [], [], []
    for k, (kind, box) in enumerate(zip(net.kinds, states, strict=True)):
        n, m, _ = kind.sizes
        whole = both(lambda side, k=k, box=box: np.concatenate([box[side], inputs[side][k]], axis=1))
        rhs: Any = lambda z, p, kind=kind, n=n: kind.f(z[:n], z[n:], p)  # noqa: E731
        found = _called(net, k, rhs, whole, ((n + m) * slopes, n), "f", care, turns[k].of_rates)
        A.append(both(lambda side, J=found[2:], n=n: J[side][:, :, :n]))
        B.append(both(lambda side, J=found[2:], n=n: J[side][:, :, n:]))
        rates.append(found[:2])
    return Blocks(A, B, C, W, S, rates)


@dataclass(frozen=True)
class _Turn:
    """From the coordinates of a kind of nodes to those by generators; the same for an orthant."""

    T: Coordinates | None
    slopes: bool

    @classmethod
    def of(cls, kind: NonlinearNodes, *, slopes: bool) -> _Turn:
        return cls(Coordinates.of(kind), slopes)

    def of_outputs(self, low: Array, high: Array, below: Array, above: Array) -> tuple[Array, Array, Array, Array]:
        """C T."""
        if self.T is None or not self.slopes:
            return low, high, below, above
        return low, high, *_turned(mixed(_turned(self.T.T), _turned((below, above))))

    def of_rates(self, low: Array, high: Array, below: Array, above: Array) -> tuple[Array, Array, Array, Array]:
        """T^{-1} f and T^{-1} [A T, B]."""
        T = self.T
        if T is None:
            return low, high, below, above
        values = vectors(T.inverse, (low, high))
        if not self.slopes:
            return *values, below, above
        n, J = len(T.T[0]), mixed(T.inverse, (below, above))
        A = _turned(mixed(_turned(T.T), _turned((J[0][:, :, :n], J[1][:, :, :n]))))
        return *values, *both(lambda side: np.concatenate([A[side], J[side][:, :, n:]], axis=2))


def _called(
    net: NonlinearNetwork,
    k: int,
    function: Callable[..., Any],
    box: Ends,
    shape: tuple[int, int],
    name: str,
    care: Care,
    turned: Callable[..., Any],
) -> tuple[Array, Array, Array, Array]:
    """Values and slopes of f or g of a kind of nodes, by coordinates of generators, or an error that names the node."""
    n, rows = shape
    kind = net.kinds[k]
    where = f"{name} of nodes {net.model.members[k][0]} to {net.model.members[k][-1]}"

    def checked(*found: Array) -> Any:
        if found[0].shape[1] != rows:
            raise ShapeError(f"{where} returned {found[0].shape[1]} rows; the nodes need {rows}.")
        return turned(*found)

    try:
        return on_pieces(lambda z: function(z, kind.params), box[0].T, box[1].T, n, care.pieces, checked, care.more)
    except UnsupportedError as error:
        raise DataError(
            f"{where} cannot be enclosed: {error}. Write it as f(x, u, p), or g(x, p), with arithmetic and functions "
            "of numpy that act entry by entry on rows such as x[0], and with numbers from p."
        ) from None
    except UnboundedError as error:
        j = int(net.model.members[k][_first_unbounded(kind, function, box, n)])
        raise DataError(
            f"{where}: the enclosed Jacobian of {net.model.name_of(j)} is unbounded on its region: {error}; choose a "
            "smaller region."
        ) from None


def _first_unbounded(kind: NonlinearNodes, function: Callable[..., Any], box: Ends, n: int) -> int:
    """A node whose Jacobian alone is unbounded, by halving."""
    first, last = 0, kind.count
    while last - first > 1:
        middle = (first + last) // 2
        part = slice(first, middle)
        try:
            p = kind.part(part)
            values_and_blocks(lambda z, p=p: function(z, p), box[0][part].T, box[1][part].T, n)
            first = middle
        except UnboundedError:
            last = middle
        except UnsupportedError:  # arrays that are not in params
            return first
    return first


def _received(net: NonlinearNetwork, y: Ends, external: Ends, with_slopes: bool, care: Care) -> tuple[Ends, Ends, Ends]:
    """Inputs that links bring and external ones, and the slopes of both kinds of links."""
    m, q = net.totals[1:]
    joint = sp.coo_array(abs(net.lower) + abs(net.upper))
    rows, columns = (index.astype(np.intp) for index in joint.coords)
    low = _at(net.lower, rows, columns)
    w = low, low if net.lower is net.upper else _at(net.upper, rows, columns)
    arriving = [(rows, product(w, (y[0][columns], y[1][columns])))]
    plain, differences = [(rows, columns, w)], []
    for each, own in zip(net.links, net.own, strict=True):
        d = y[0][each.sources], y[1][each.sources]
        if own is not None:
            d = difference(d, (y[0][own], y[1][own]))
        values, slopes = _sent(each, d, care.more)
        arriving.append((each.targets, values))
        (plain if own is None else differences).append((each.targets, each.sources, slopes))
    u = _summed(arriving, external, m)
    if not with_slopes:
        plain, differences = [], []
    return u, _collected(plain, (m, q)), _collected(differences, (m, q))


def _at(M: sp.csr_array, rows: Index, columns: Index) -> Array:
    return np.asarray(M[rows, columns]).ravel() if len(rows) else np.zeros(0)


def _sent(each: Links, d: Ends, more: str) -> tuple[Ends, Ends]:
    """Values and slopes of links for arguments between ends."""
    weights = each.weights, each.weights
    if isinstance(each.function, Interval):
        ends = (_end(each.function.lower, up=False), _end(each.function.upper, up=True))
        slopes = product(weights, (np.full(len(d[0]), ends[0]), np.full(len(d[0]), ends[1])))
        return product(slopes, d), slopes
    phi = each.function
    try:
        low, high, below, above = values_and_blocks(lambda z: [phi(z[0])], d[0][None], d[1][None], 1, more)
    except UnsupportedError as error:
        raise DataError(
            f"the function of links cannot be enclosed: {error}. Write it with arithmetic and functions of numpy that "
            "act entry by entry."
        ) from None
    except UnboundedError as error:
        raise DataError(
            f"the enclosed slope of links is unbounded on the region: {error}; choose a smaller region."
        ) from None
    if low.shape[1] != 1:
        raise ShapeError(
            f"the function of links returned {low.shape[1]} values for each argument; it has to return one."
        )
    return product(weights, (low[:, 0], high[:, 0])), product(weights, (below[:, 0, 0], above[:, 0, 0]))


def _end(number: Any, *, up: bool) -> float:
    """An end of a range as a double, rounded outwards."""
    return float(exact_matrix(number, "function", ndim=1).rounded(up=up)[0])


def least_in_ranges(net: NonlinearNetwork) -> tuple[sp.csr_array, sp.csr_array]:
    """Lower ends of the links that are known by ranges only: plain ones, and those of differences."""
    shape = net.totals[1:]
    out = [net.lower if net.has_ranges else sp.csr_array(shape), sp.csr_array(shape)]
    for each in net.links:
        if isinstance(each.function, Interval):
            low = _end(each.function.lower, up=False) * each.weights
            out[each.difference] = out[each.difference] + sp.csr_array((low, (each.targets, each.sources)), shape=shape)
    return out[0], out[1]


def _summed(parts: list[tuple[Index, Ends]], start: Ends, size: int) -> Ends:
    """Sums of intervals by their place, rounded outwards; those of single numbers are exact."""
    place = np.concatenate([np.arange(size), *(index for index, _ in parts)])
    low, high = (np.concatenate([start[side], *(ends[side] for _, ends in parts)]) for side in (0, 1))
    out = []
    for values, sign in ((low, -1.0), (high, 1.0)):
        total = np.bincount(place, weights=values, minlength=size)
        gross = np.bincount(place, weights=np.abs(values), minlength=size)
        count = np.bincount(place, weights=values != 0, minlength=size)
        room = np.where(count > 1, 2.0 * (count + 2) * HALF_ULP * gross, 0.0)
        out.append(np.where(room > 0, np.nextafter(total + sign * room, sign * np.inf), total))
    return out[0], out[1]


def _collected(parts: list[tuple[Index, Index, Ends]], shape: tuple[int, int]) -> Ends:
    """Slopes as sparse matrices; those of links in the same place are added, and rounded outwards."""
    if not parts:
        return sp.csr_array(shape), sp.csr_array(shape)
    rows, columns = (np.concatenate([part[side] for part in parts]).astype(np.int64) for side in (0, 1))
    low, high = (np.concatenate([part[2][side] for part in parts]) for side in (0, 1))
    key, place = np.unique(rows * shape[1] + columns, return_inverse=True)
    zero = np.zeros(len(key))
    ends = _summed([(place, (low, high))], (zero, zero), len(key))
    return both(lambda side: sp.csr_array((ends[side], (key // shape[1], key % shape[1])), shape=shape))


def block_matrix(model: NetworkModel, parts: list[Ends], side: int, rows: int, columns: int) -> sp.csr_array:
    """One end of the blocks of all nodes as a block diagonal matrix without zeros."""
    places = [(np.array(b[side]), p[rows], p[columns]) for b, p in zip(parts, model.places, strict=True)]
    out = block_diagonal(places, (model.totals[rows], model.totals[columns]))
    out.data = np.array(out.data)
    out.eliminate_zeros()
    return out


def at_point(net: NonlinearNetwork, x: Array, w: Array | None) -> ConeNetwork:
    """The linear network of displacements at a point, in the coordinates of the nodes."""
    external = np.zeros(net.totals[1]) if w is None else w
    states = [(part, part) for part in net.model.split(x, 0)]
    blocks = enclose(net, states, (external, external))
    stacks = []
    own = own_shares(net, blocks.S[1])
    for g, (kind, s) in enumerate(zip(net.kinds, net.model.stacks, strict=True)):
        A, B, C = (0.5 * part[g][0] + 0.5 * part[g][1] for part in (blocks.A, blocks.B, blocks.C))
        A = taken_off(A, B, C, own[g])
        T = Coordinates.of(kind)
        if T is not None:
            A, B, C = T.T[0] @ A @ T.inverse[0], T.T[0] @ B, C @ T.inverse[0]
        stacks.append(NodeStack(Matrix(A), Matrix(B), Matrix(C), s.D, s.X, s.U, s.Y, 0, s.names))
    W = sp.csr_array(0.5 * (blocks.W[0] + blocks.W[1]) + 0.5 * (blocks.S[0] + blocks.S[1]))
    return ConeNetwork(NetworkModel(tuple(stacks), net.model.members, Matrix(W), 0))


def own_shares(net: NonlinearNetwork, S: sp.csr_array) -> list[Array]:
    """Sums of the slopes of differences at every input, (N, m) for each kind."""
    return net.model.split(np.asarray(S.sum(axis=1)).ravel(), 1)


def taken_off(A: Array, B: Array, C: Array, share: Array) -> Array:
    """A less B_i s_i C_i for every input i that receives differences, output i being its own."""
    out = np.array(A)
    for i in range(min(B.shape[2], C.shape[1])):
        if share[:, i].any():
            out -= share[:, i, None, None] * B[:, :, i, None] * C[:, i, None, :]
    return out
