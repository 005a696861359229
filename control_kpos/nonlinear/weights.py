"""Vectors that may prove contraction of a nonlinear network; proposals that the certificate checks.

e solves max over slopes of M e = -d, where M is the closed loop of the upper ends and the maximum is taken for every
link of differences by itself: policy iteration, one linear network each, whose e grow until no slope changes.  Then d
is replaced by e itself, as in inverse iteration, which brings the rate near to the best one.  v is the same for M'.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cones import orthant
from ..exact.matrix import Matrix
from ..networks.certify import supply_rates
from ..networks.model import NetworkModel
from ..networks.nodes import NodeStack
from ..networks.spectrum.port_solves import PortSystem
from .enclosed import Blocks, own_shares, taken_off
from .network import NonlinearNetwork

Array = NDArray[np.float64]
Vectors = dict[str, Any]

# Roundings of sums and products are far below this, relative to their terms.
ROOM = 1e-13
# Parts of the rate that is seen which are tried, the largest first.
_RATES = (1 - 1e-9, 1 - 1e-4, 0.5)
# Changes of the slopes of differences after which the search ends; it takes a handful.
_CHANGES = 40
# Rounds of inverse iteration, which end when the rate grows by less than this part; accuracy of their solves.
_ROUNDS, _GAIN, _TOLERANCE = 4, 0.05, 1e-10
# What is added to vectors before they take the place of d.
_FLOOR = 1e-6


def contractions(net: NonlinearNetwork, blocks: Blocks, data: Vectors) -> Iterator[Vectors]:
    """Vectors e and v with the rate that both prove; then e alone."""
    e = _improved(lambda d, last: _upper(net, blocks, d, last), lambda x: _rate_of_e(data, x), net.totals[0])
    if e is None:
        return
    v = None
    if not blocks.S[1].nnz:
        A, B, C = _ends(blocks)
        solver = PortSystem(_model(net, A, B, C, blocks.W[1], transposed=False), 0.0)
        v = _improved(lambda d, _: _lower(solver, d), lambda x: _rate_of_v(data, x), net.totals[0])
    for part in _RATES:
        if v:
            yield {**e, **v, "decay_rate": part * min(_rate_of_e(data, e), _rate_of_v(data, v))}
        yield {**e, "decay_rate": part * _rate_of_e(data, e)}


def _improved(
    solve: Callable[[Array, Vectors | None], Vectors | None], rate: Callable[[Vectors], float], n: int
) -> Vectors | None:
    """The vectors of the best rate that a few rounds of inverse iteration find; None if none is positive."""
    best, fastest, d = None, 0.0, np.ones(n)
    found = None
    for _ in range(_ROUNDS):
        found = solve(d, found)
        if found is None:
            return best
        now = rate(found)
        if not now > fastest:
            return best
        enough = now < fastest * (1 + _GAIN)
        best, fastest = found, now
        if enough:
            break
        x = found["e"] if "e" in found else found["v"]
        d = x / np.abs(x).max() + _FLOOR
    return best


def _ends(blocks: Blocks) -> tuple[list[Array], ...]:
    return tuple([part[1] for part in getattr(blocks, name)] for name in "ABC")


def _model(net: NonlinearNetwork, A: Any, B: Any, C: Any, W: Any, *, transposed: bool) -> NetworkModel:
    """A linear network on nonnegative orthants; the v of the transposed one are the e of the network."""
    stacks = []
    for parts in zip(A, B, C, strict=True):
        A_j, B_j, C_j = map(Matrix, parts)
        (count, n, m), q = B_j.shape, C_j.shape[1]
        D_j = Matrix(np.zeros((count, q, m)))
        stack = NodeStack(A_j, B_j, C_j, D_j, orthant(n), orthant(m), orthant(q))
        stacks.append(stack.transposed if transposed else stack)
    coupling = sp.csr_array(W.T if transposed else W, copy=True)
    coupling.sort_indices()
    return NetworkModel(tuple(stacks), net.model.members, Matrix(coupling), 0)


def _lower(system: PortSystem, d: Array) -> Vectors | None:
    """v, r and p with M'v = -d; None if v is not positive."""
    v = system.dual(d, _TOLERANCE)[0] if system.is_finite else np.full(len(d), np.nan)
    if not (np.isfinite(v).all() and v.min() > 0):
        return None
    _, r, q = supply_rates(system.model, v)
    return {"v": v, "r": r, "p": -q}


def _upper(net: NonlinearNetwork, blocks: Blocks, d: Array, last: Vectors | None) -> Vectors | None:
    """e with bounds of outputs and inputs, for the slopes of differences that are worst at e."""
    A, B, C = _ends(blocks)
    S, out = blocks.S[1] if last is None else _worst(net, blocks, last), None
    for _ in range(_CHANGES):
        nodes = [taken_off(*parts) for parts in zip(A, B, C, own_shares(net, S), strict=True)]
        system = PortSystem(_model(net, nodes, B, C, blocks.W[1] + S, transposed=True), 0.0)
        e = system.dual(d, _TOLERANCE)[0] if system.is_finite else np.full(len(d), np.nan)
        if not (np.isfinite(e).all() and e.min() > 0):
            return None
        out = _bounds(net, blocks, e)
        before, S = S, _worst(net, blocks, out)
        if not S.nnz or (before != S).nnz == 0:
            return out
    return out


def own_output(net: NonlinearNetwork) -> NDArray[np.intp]:
    """The own output of every input that receives differences, and 0 for the others."""
    own = np.zeros(net.totals[1], dtype=np.intp)
    for each, outputs in zip(net.links, net.own, strict=True):
        if outputs is not None:
            own[each.targets] = outputs
    return own


def _worst(net: NonlinearNetwork, blocks: Blocks, e: Vectors) -> sp.csr_array:
    """The slopes of differences that push most."""
    rows, columns, low, high = _slopes(blocks)
    ahead = e["y"][columns] > e["y_lower"][own_output(net)[rows]]
    return sp.csr_array((np.where(ahead, high, low), (rows, columns)), shape=blocks.S[1].shape)


def _slopes(blocks: Blocks) -> tuple[Any, Any, Array, Array]:
    """Places and both ends of the slopes of differences."""
    coo = sp.coo_array(blocks.S[1])
    rows, columns = coo.coords
    low = np.asarray(blocks.S[0][rows, columns]).ravel() if len(rows) else np.zeros(0)
    return rows, columns, low, coo.data


def _bounds(net: NonlinearNetwork, blocks: Blocks, e: Array) -> Vectors:
    """y, y_lower and u for e, with room for rounding."""
    parts = net.model.split(e, 0)
    y, y_lower = (
        net.model.join([np.einsum("jqn,jn->jq", c[side], x) for c, x in zip(blocks.C, parts, strict=True)], 2)
        for side in (1, 0)
    )
    y, y_lower = y + ROOM * np.abs(y), y_lower - ROOM * np.abs(y_lower)
    W = blocks.W[1]
    u, size = W @ y, abs(W) @ np.abs(y)
    rows, columns, low, high = _slopes(blocks)
    d = y[columns] - y_lower[own_output(net)[rows]]
    np.add.at(u, rows, np.maximum(low * d, high * d))
    np.add.at(size, rows, high * (np.abs(y[columns]) + np.abs(y_lower[own_output(net)[rows]])))
    return {"e": e, "y": y, "y_lower": y_lower, "u": u + 4 * ROOM * size}


def _rate_of_e(data: Vectors, e: Vectors) -> float:
    A, B, lower, u = data["upper"][0].values, data["upper"][1].values, data["lower"][1].values, e["u"]
    push = A @ e["e"] + B @ np.maximum(u, 0.0) + lower @ np.minimum(u, 0.0)
    return float((-push / e["e"]).min(initial=np.inf))


def _rate_of_v(data: Vectors, v: Vectors) -> float:
    A, C = data["upper"][0].values, data["upper"][2].values
    return float((-(A.T @ v["v"] + C.T @ v["p"]) / v["v"]).min(initial=np.inf))
