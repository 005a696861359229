"""Local observers of networks: their gains, their proof, and their simulation in sparse matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..cones import Cone, orthant, product
from ..design.bounded.covers import covered
from ..design.bounded.network_certificate import NetworkIntervalCertificate
from ..design.bounded.network_interval import NetworkBounds, network_intervals
from ..design.network.search import network_feedback
from ..design.plant import Floats
from ..design.result import DesignResult
from ..design.running import Programs
from ..errors import DataError, NotProperConeError, ShapeError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.rounding import HALF_ULP
from ..networks.blocks import Index
from ..networks.model import NetworkModel
from ..networks.network import ConeNetwork
from ..networks.own_links import own_links_closed
from ..proof.certificate import Status, exactly
from ..proof.portable_cones import portable_rows
from .bounds import ANY, INWARDS
from .network_certificate import NetworkObserverCertificate, apart, blocks_of, observed, pushed_forms
from .network_program import MeasuredNetwork, local_gains
from .program import KEPT, least_noise

Bounds = tuple[Matrix, Matrix, Matrix]


def read_network(net: ConeNetwork) -> NetworkModel:
    """The network with links of nodes to themselves closed, if local observers can be designed for it.

    Raises
    ------
    DataError, ShapeError, NotProperConeError
        It is known within sets; has feedthrough, no outputs, or state cones that are not simplicial.
    """
    net.require_certain()
    model = own_links_closed(net.model) or net.model
    if model.has_feedthrough:
        raise DataError("sys has nodes with feedthrough; local observers are for nodes with D = 0.")
    if not net.noutputs:
        raise ShapeError("sys has no outputs; an observer needs a measurement.")
    for s, index in zip(model.stacks, model.members, strict=True):
        if not s.X.is_simplicial:
            raise NotProperConeError(
                f"sys: {model.name_of(int(index[0]))} has a state cone with {s.X.n_rays} generators in dimension "
                f"{s.X.dim}; local observers need simplicial cones."
            )
    return model


def spread_noise(net: ConeNetwork, noise: Matrix) -> Matrix:
    """Bounds on the noise of the outputs of `net`, for all outputs of its nodes."""
    total, measured = net.model.totals[2], net.external[1]
    if noise.is_double:
        out = np.zeros(total)
        out[measured] = noise.values
        return Matrix(out)
    exact = np.zeros(total, dtype=int).astype(object)
    exact[measured] = noise.fractions()
    return Matrix.from_fractions(exact)


def proven_local(plant: NetworkModel, measured: Index, box: Bounds, lp: Programs) -> NetworkObserverCertificate | None:
    """The certificate of local observers with small final widths; None where none were found or proven.

    Parameters
    ----------
    plant : NetworkModel
        From `read_network`.
    measured : ndarray of int
        The outputs that are measured, among those of all nodes.
    box : tuple of Matrix, shapes (n,), (n,), (sum q_k,)
    lp : Programs
    """
    w_lo, w_hi, noise = (np.asarray(part.values, dtype=float) for part in box)
    mask = np.isin(np.arange(plant.totals[2]), measured)
    program = MeasuredNetwork(plant, w_hi - w_lo, least_noise(w_hi - w_lo, noise), mask)
    for kept in KEPT:
        gains = local_gains(program, kept, lp)
        proof = None if gains is None else _proven(plant, box, gains, lp)
        if proof is not None:
            return proof
    return None


def refused(plant: NetworkModel, measured: Index) -> DesignResult | None:
    """The proof that no local gains do it, about the transposed network; None where there is none."""
    if not plant.is_ordered or len(measured) < plant.totals[2]:
        return None
    found = network_feedback(plant.stacks[0].transposed, plant.coupling.T)
    return found if found.status is Status.REFUTED else None


def _proven(plant: NetworkModel, box: Bounds, gains: list[Floats], lp: Programs) -> NetworkObserverCertificate | None:
    gain = Matrix(plant.blocks(gains, 0, 2))
    model = observed(plant, gain)
    net = ConeNetwork(model, progress=False)
    if not net.certificate:
        return None
    boxes = list(zip(*(plant.split(part, kind) for part, kind in zip(box, (0, 0, 2), strict=True)), strict=True))
    upper = above_all(plant, boxes, [Matrix(L) for L in gains], 1)
    lower = above_all(plant, boxes, [Matrix(L) for L in gains], -1)
    if upper is None or lower is None:
        return None
    between = NetworkBounds(apart(Matrix(upper), Matrix(lower)), None, None)
    interval = next((proof for proof in network_intervals(net, between, lp) if proof), None)
    return None if interval is None else _settled(plant, gain, box, (upper, lower), interval)


def _settled(
    plant: NetworkModel,
    gain: Matrix,
    box: Bounds,
    constants: tuple[Floats, Floats],
    interval: NetworkIntervalCertificate,
) -> NetworkObserverCertificate | None:
    ends = {name: exactly(interval, name) for name in ("x_max", "u_max", "y_max", *"vrq")}
    x = plant.split(ends["x_max"], 0)
    rows = [_cover(s.X, part) for s, part in zip(plant.stacks, x, strict=True)]
    blocks = [np.tile(a, (len(s), 1, 1)) for a, s in zip(rows, plant.stacks, strict=True)]
    each = [_widths(a, np.asarray(part.values, dtype=float)) for a, part in zip(rows, x, strict=True)]
    return (
        NetworkObserverCertificate.settle(
            plant=plant,
            model=interval.model,
            gain=gain,
            **dict(zip(("w_lo", "w_hi", "noise"), box, strict=True)),
            upper=constants[0],
            lower=constants[1],
            **ends,
            covers=Matrix(plant.blocks(blocks, 0, 0)),
            width=plant.join(each, 0),
        )
        or None
    )


def _cover(X: Cone, x: Matrix) -> Floats:
    """Rows a_i with a_i and a_i - e_i in X*, the same for all nodes, in doubles."""
    n = X.dim
    best = covered(
        X, Matrix.identity(n), Matrix(np.full(n, ANY)), Matrix(np.asarray(x.values, dtype=float).max(axis=0))
    )
    a = np.concatenate([np.asarray(g.values, dtype=float) for g, _ in best if g is not None])
    rays, inside = X.exact_rays.plain().fractions(), np.asarray(X.dual.interior_point, dtype=float)
    for part in INWARDS:  # rounding may have moved rows out of X*
        moved = a + part * np.abs(a).max() / np.abs(inside).max() * inside
        heights = Matrix(moved).fractions() @ rays.T
        if (heights >= 0).all() and (heights >= rays.T).all():
            return moved
    return a


def _widths(a: Floats, x: Floats) -> Floats:
    """No less than (2 a_i - e_i)'x of every node, shape (N, n); x itself on orthants."""
    rows = 2 * a - np.eye(len(a))
    if (rows == np.eye(len(a))).all():
        return x
    return x @ rows.T + 4 * (len(a) + 2) * HALF_ULP * (np.abs(x) @ (2 * np.abs(a) + np.eye(len(a))).T)


def above_all(
    model: NetworkModel, boxes: Sequence[Sequence[Matrix]], gains: Sequence[Matrix | None], sign: int
) -> Floats | None:
    """Small d, in doubles, with h'd >= max h'(w + L n) for all facets h and nodes; for -1 large, with min and <=.

    Parameters
    ----------
    model : NetworkModel
    boxes : sequence of (w_lo, w_hi, noise)
        By stack, shapes (N, n), (N, n), (N, q).
    gains : sequence of Matrix, shape (N, n, q), or None for no noise
    sign : 1 or -1
    """
    parts = []
    for s, box, gain in zip(model.stacks, boxes, gains, strict=True):
        found = _above(s.X, box, gain, sign)
        if found is None:
            return None
        parts.append(found)
    return model.join(parts, 0)


def _above(X: Cone, box: Sequence[Matrix], gain: Matrix | None, sign: int) -> Floats | None:
    """The same for the nodes of a stack; None if rounding hides it."""
    H, inside = np.array(portable_rows(X.exact_facets), dtype=float), np.asarray(X.interior_point, dtype=float)
    zero = Matrix(np.zeros((box[0].shape[0], X.dim)))
    needed = -np.asarray(pushed_forms(X, zero, box, gain, sign).values, dtype=float)[..., 0]
    guess = np.linalg.solve(H, needed.T).T
    sizes = np.abs(guess).max(axis=1, keepdims=True) / np.abs(inside).max()
    for part in INWARDS:
        d = sign * (guess + part * sizes * inside)
        if not np.isfinite(d).all():
            return None
        if Condition("h'd is large enough", pushed_forms(X, Matrix(d), box, gain, sign), ">=").verdict() is True:
            return d
    return None


# -- simulation


def copy_of(proof: NetworkObserverCertificate, net: ConeNetwork) -> ConeNetwork:
    """One copy of the observer, from (u, -y, constant) of every node to its outputs; the coupling is that of `net`."""
    model = proof.model
    gains, stacks = blocks_of(model, proof.gain, 0, 2), []
    for s, L in zip(model.stacks, gains, strict=True):
        n, m, q = s.sizes
        B = np.concatenate([np.asarray(s.B.values), -np.asarray(L.values), np.tile(np.eye(n), (len(s), 1, 1))], axis=2)
        D = Matrix.zeros(len(s), q, m + q + n)
        U = product([s.U, orthant(q + n)])
        stacks.append(replace(s, B=Matrix(B), D=D, U=U, labels=()))
    empty = NetworkModel(tuple(stacks), model.members, Matrix(sp.csr_array((0, 0))), model.dt)
    entries = sp.coo_array(model.W)
    rows = copy_inputs(empty, model, 0)[entries.coords[0]]
    W = sp.csr_array((entries.data, (rows, entries.coords[1])), shape=empty.totals[1:])
    return ConeNetwork(empty.with_coupling(Matrix(W)), name=f"{net.name}$observer", progress=False)


def copy_inputs(copy: NetworkModel, model: NetworkModel, kind: int) -> Index:
    """Places of u (kind 0), y (1) or the constants (2) among the inputs of a copy, in the order of the network."""
    owned = (1, 2, 0)[kind]
    out = np.empty(model.totals[owned], dtype=np.intp)
    for s, own, (_, inputs, _) in zip(model.stacks, model.places, copy.places, strict=True):
        n, m, q = s.sizes
        first = (0, m, m + q)[kind]
        out[own[owned]] = inputs[:, first : first + (m, q, n)[kind]]
    return out


def simulated(
    proof: NetworkObserverCertificate,
    copy: ConeNetwork,
    external: tuple[Index, Index],
    times: Floats,
    signals: tuple[Floats, Floats],
    start: tuple[Matrix, Matrix],
) -> tuple[Floats, Floats]:
    """Bounds on the states, entry by entry; see `IntervalObserver.simulate`."""
    model, (y, u), (inputs, outputs) = proof.model, signals, external
    ends = []
    for sign, constant in ((1, proof.upper), (-1, proof.lower)):
        U = np.zeros((copy.ninputs, len(times)))
        U[copy_inputs(copy.model, model, 0)[inputs]] = u
        U[copy_inputs(copy.model, model, 1)[outputs]] = y
        U[copy_inputs(copy.model, model, 2)] = constant[:, None]
        response = copy.forced_response(times, U, _first(model, start, sign), outputs=[], states=True)
        ends.append(np.asarray(response.states).reshape(model.totals[0], -1))
    a = sp.csr_array(proof.covers.values)
    b = sp.csr_array(a - sp.eye_array(a.shape[0]))
    return a @ ends[1] - b @ ends[0], a @ ends[0] - b @ ends[1]


def _first(model: NetworkModel, start: tuple[Matrix, Matrix], sign: int) -> Floats:
    """States above all of [lo, hi] in the order of X; below them for the other sign."""
    boxes = list(zip(*(model.split(part, 0) for part in start), strict=True))
    found = above_all(model, boxes, [None] * len(boxes), sign)
    if found is None:
        raise DataError("x0 could not be enclosed in the order of the cones; scale the states.")
    return found
