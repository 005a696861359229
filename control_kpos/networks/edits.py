"""Plug and play: links, and nodes added, replaced or removed, with the certificate of the network before.

Let v, r, q prove a network by Theorem 4 with sigma = 1.  Weaker links and a node taken away leave every sum of
(III') as it was or smaller, so that the same vectors prove the rest.  A new node i on links W_ik in and W_ji out gets

    v_i = -A_i^{-T} (C_i'h + e c),    h' = sum_j r_j'W_ji,    c in int X_i*,    e > 0 small,

(I - A_i for -A_i in discrete time), and all other nodes keep their v.  What the sources k of the new node have to
cover grows by r_i'W_ik, r_i' = v_i'B_i; no other condition changes.  No equation is solved for the whole network, but
all conditions of Theorem 4 are proven on it, so an inherited certificate is one like any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..cones import Cone
from ..errors import ConeMismatchError, DataError, ShapeError, TimebaseError
from ..exact.condition import all_hold
from ..exact.distinct import distinct
from ..exact.intake import exact_matrix, found, items, whole_number
from ..exact.matrix import Matrix
from ..proof.certificate import Status, exactly
from . import conditions as on
from .blocks import Floats, Index, apply, inverse, take_blocks
from .certificate import NetworkCertificate, node_vectors, rates_of
from .certify import loop_weights, provable_rate, settle, supply_rates
from .coupling import entries_of, from_entries
from .model import NetworkModel, gather, same_timebase
from .nodes import NodeStack
from .own_links import own_links_closed

# Sizes of e c beside C_i'h tried in turn: as much decay as the sources of the new node can afford.
_SIZES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)


# -- reading an edit


def single_node(system: Any, dt: Any) -> NodeStack:
    """One node for a network of this timebase, as a stack of one."""
    stacks, _, _ = gather(system, "system")
    if len(stacks) != 1 or len(stacks[0]) != 1:
        raise ShapeError("give one node; add several one after the other.")
    if not stacks[0].sizes[0]:
        raise ShapeError("system has no states; a node needs at least one.")
    if not same_timebase(stacks[0].dt, dt):
        raise TimebaseError(
            f"system: the node has dt = {stacks[0].dt}, but the network has dt = {dt}; bring it to the same sampling "
            "time."
        )
    return stacks[0]


def node_number(model: NetworkModel, node: Any, name: str = "node") -> int:
    """The number of a node, counted from the end if it is negative."""
    number = whole_number(node, name, least=None)
    if not -model.n_nodes <= number < model.n_nodes:
        raise ShapeError(f"node {number} does not exist; the nodes are numbered 0 to {model.n_nodes - 1}.")
    return number % model.n_nodes


def weights_by_node(model: NetworkModel, links: Mapping[int, Any] | None, name: str) -> dict[int, Any]:
    """Weights of links by the number of the node at their other end."""
    if not (links is None or isinstance(links, Mapping)):
        raise DataError(f"{name} is {found(links)}; give a dictionary of weights by the number of the node.")
    return {node_number(model, k, f"{name}: a node"): w for k, w in (links or {}).items()}


def _link(weight: Any, rows: int, columns: int, name: str) -> Matrix:
    """A link as an exact block, refused by name if it has another shape."""
    exact = weight if isinstance(weight, Matrix) else exact_matrix(weight, name)
    if exact.shape != (rows, columns):
        raise ConeMismatchError(
            f"{name} is {exact.shape[0]} x {exact.shape[1]}, but must be {rows} x {columns}: inputs of its target by "
            "outputs of its source."
        )
    return exact


# -- the changed network


def placed(
    model: NetworkModel,
    node: int,
    stack: NodeStack,
    incoming: Mapping[int, Any] | None,
    outgoing: Mapping[int, Any] | None,
) -> NetworkModel:
    """The network with a node under this number, new or not; links that are None stay as they are."""
    keep = np.arange(model.n_nodes) != node
    stacks, members = model.kept(keep, np.arange(model.n_nodes))
    nothing = Matrix(sp.csr_array((0, 0)))
    new = NetworkModel((*stacks, stack), (*members, np.array([node])), nothing, model.dt)
    inputs, outputs = np.diff(new.offsets[1]), np.diff(new.offsets[2])
    into = _links(model, node, True) if incoming is None else incoming
    out_of = _links(model, node, False) if outgoing is None else outgoing
    blocks = {(node, k): w for k, w in into.items()}
    blocks.update({(j, node): w for j, w in out_of.items() if j != node or node not in into})
    exact = {
        (j, k): _link(w, inputs[j], outputs[k], f"the link from node {k} to node {j}") for (j, k), w in blocks.items()
    }
    return new.with_coupling(_rewired(model, new, node, exact))


def _links(model: NetworkModel, node: int, incoming: bool) -> dict[int, Matrix]:
    """Blocks of the links into (or out of) a node, by the number of the other end."""
    matrix, own, other = (model.W, 1, 2) if incoming else (model.WT, 2, 1)
    rows = _places(model, node, own)
    ends = distinct(np.searchsorted(model.offsets[other], matrix[rows].indices, side="right") - 1)
    out = {}
    for end in ends.tolist():
        columns = _places(model, end, other)
        at = (rows, columns) if incoming else (columns, rows)
        out[end] = take_blocks(model.coupling, at[0][None], at[1][None])[0]
    return out


def _places(model: NetworkModel, node: int, kind: int) -> Index:
    """Places of the states (kind 0), inputs (1) or outputs (2) of a node."""
    return np.arange(int(model.offsets[kind][node]), int(model.offsets[kind][node + 1]))


def _rewired(model: NetworkModel, new: NetworkModel, node: int, blocks: Mapping[tuple[int, int], Matrix]) -> Matrix:
    """The old coupling without the links of a node, and these blocks."""
    rows, columns, values = entries_of(model.coupling)
    j, k = model.owners(1)[rows], model.owners(2)[columns]
    same = np.flatnonzero((j != node) & (k != node))
    j, k = j[same], k[same]
    at_rows = [new.offsets[1][j] + rows[same] - model.offsets[1][j]]
    at_columns = [new.offsets[2][k] + columns[same] - model.offsets[2][k]]
    parts = [values[same]]
    for (target, source), block in blocks.items():
        a, b, entries = entries_of(block)
        at_rows.append(new.offsets[1][target] + a)
        at_columns.append(new.offsets[2][source] + b)
        parts.append(entries)
    return from_entries(at_rows, at_columns, parts, new.totals[1:])


# -- its certificate


@np.errstate(all="ignore")
def inherited(certificate: NetworkCertificate, model: NetworkModel, origin: Index) -> NetworkCertificate | None:
    """A certificate of the changed network from one of the network before, or None if that proves nothing there.

    `origin` holds the numbers that the nodes, in their old order, had before; -1 for one that is new.
    """
    if certificate.status is not Status.PROVED or certificate.v is None or certificate.sigma is None:
        return None
    if certificate.model.origin is not None:
        model = own_links_closed(model) or model
    if (origin >= 0).all():
        rates = rates_of(certificate)
        for tried in (rates, {**rates, "required_rate": None}):
            same = _restricted(certificate, model, origin, tried)
            if same.status is Status.PROVED:
                return same
    loop = loop_weights(model)
    if model.has_feedthrough and loop is None:
        return None
    old = certificate.model
    weighted = _weighted(certificate, 0)
    v = np.zeros(model.totals[0])
    v[origin[model.owners(0)] >= 0] = weighted[np.isin(old.owners(0), origin)]
    with np.errstate(all="ignore"):
        for candidate in _storages(model, v, np.flatnonzero(origin < 0)):
            data = supply_rates(model, candidate)
            falls = provable_rate(model, Matrix(candidate), Matrix(data[2]), discrete=model.discrete) > 0
            if falls and np.isfinite(candidate).all():
                draft = settle(model, data, loop)
                return draft if draft.status is Status.PROVED else None
    return None


def _restricted(
    certificate: NetworkCertificate, model: NetworkModel, origin: Index, rates: dict[str, Any]
) -> NetworkCertificate:
    """The same vectors for those nodes that are left."""
    old = certificate.model
    left = [np.isin(old.owners(kind), origin) for kind in range(3)]
    v, r, q = (part[keep] for part, keep in zip(node_vectors(certificate), left, strict=True))
    loop = None
    if certificate.loop_weights is not None:
        p, t = exactly(certificate, "loop_weights")
        loop = p[left[2]], t[left[1]]
    sigma = np.asarray(certificate.sigma)[origin]
    return NetworkCertificate.settle(model=model, v=v, r=r, q=q, sigma=sigma, loop_weights=loop, **rates)


def _storages(model: NetworkModel, v: Floats, new: Index) -> Any:
    """v with the storage of the new node filled in, in several sizes of e c; v itself if there is none."""
    if not new.size:
        yield v
        return
    node = int(new[0])
    g, place = model.locate(node)
    s = model.stacks[g].take(place)
    own = [_places(model, node, kind) for kind in range(3)]
    h = (model.WT @ supply_rates(model, v)[1])[own[2]]
    K = inverse(float(model.discrete) * np.eye(s.sizes[0]) - s.A.values)
    heard = apply(K, apply(s.C.values, h[None], transposed=True), transposed=True)[0]
    little = apply(K, np.asarray(s.X.dual.interior_point)[None], transposed=True)[0]
    scale = max(float(np.abs(heard).max()), 1e-3) / max(float(np.abs(little).max()), 1e-300)
    for size in _SIZES:
        out = v.copy()
        out[own[0]] = heard + size * scale * little
        yield out


# -- permissible link weights


@np.errstate(all="ignore")
def permissible_weight(
    certificate: NetworkCertificate,
    stack: NodeStack,
    sources: Sequence[int] | Mapping[int, Any],
    targets: Sequence[int] | Mapping[int, Any],
) -> float:
    """The largest product a b of weights for which a new node on links a L_k in and b L_j out is covered.

    With h' = b sum_j r_j'L_j for the targets j and G = C (-A)^{-1} B (C (I - A)^{-1} B in discrete time), a source k
    has to cover a h'G L_k y more, at every generator of X_k, out of what its storage decreases by: -(v'A - q'C) x.
    See `ConeNetwork.room_for`.
    """
    model = certificate.model
    m, q = stack.sizes[1:]
    into, out_of = (_shapes(model, given, name) for given, name in ((sources, "sources"), (targets, "targets")))
    nodes = {k: model.stacks[model.locate(k)[0]] for k in (*into, *out_of)}
    links_in = {k: _link(w, m, nodes[k].sizes[2], f"sources[{k}]") for k, w in into.items()}
    links_out = {j: _link(w, nodes[j].sizes[1], q, f"targets[{j}]") for j, w in out_of.items()}
    with_feedthrough = [f"node {k}" for k in into if not nodes[k].take(model.locate(k)[1]).D.is_zero]
    if with_feedthrough or not stack.D.is_zero:
        raise ConeMismatchError(
            f"{', '.join(with_feedthrough) or 'system'} has feedthrough D, so that charges pass on to further nodes at "
            "once; room_for covers D = 0. Try with_node instead."
        )
    alone = NetworkModel((stack,), (np.array([0]),), Matrix(sp.csr_array((m, q))), stack.dt)
    K = inverse(float(model.discrete) * np.eye(stack.sizes[0]) - stack.A.values)[0]
    stable = bool((stack.X.rays @ (np.asarray(stack.X.dual.interior_point) @ K) > 0).all())
    fits = all(_maps(w, nodes[k].Y, stack.U) for k, w in links_in.items()) and all(
        _maps(w, stack.Y, nodes[j].U) for j, w in links_out.items()
    )
    if not (certificate.status is Status.PROVED and stable and fits and all_hold(on.positivity(alone, 0))):
        return 0.0
    v, r, q_all = (_weighted(certificate, kind) for kind in range(3))
    asked = sum((r[_places(model, j, 1)] @ w.values for j, w in links_out.items()), np.zeros(q))
    price = asked @ stack.C.values[0] @ K @ stack.B.values[0]
    most = np.inf
    for k, w in links_in.items():
        s = nodes[k].take(model.locate(k)[1])
        own = Matrix(v[_places(model, k, 0)][None]), Matrix(q_all[_places(model, k, 2)][None])
        spare = -on.decrease_forms(s, *own, 0.0, model.discrete).values[0, 0]
        charged = s.X.rays @ (price @ w.values @ s.C.values[0])
        with np.errstate(divide="ignore"):
            most = min(most, float(np.where(charged > 0, spare / charged, np.inf).min()))
    return 0.999 * most


def _shapes(model: NetworkModel, given: Any, name: str) -> dict[int, Any]:
    """L by the number of the node; 1 where only numbers are given."""
    if isinstance(given, Mapping):
        return weights_by_node(model, given, name)
    return {node_number(model, k, f"{name}: a node"): 1.0 for k in items(given, name)}


def _weighted(certificate: NetworkCertificate, kind: int) -> Floats:
    """v, r or q times sigma."""
    return np.asarray(certificate.sigma)[certificate.model.owners(kind)] * node_vectors(certificate)[kind].values


def _maps(link: Matrix, source: Cone, target: Cone) -> bool:
    return bool((target.facets @ link.values @ source.rays.T >= 0).all())
