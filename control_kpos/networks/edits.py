"""Plug and play: add, replace or remove a node of a certified network and prove only what changed.

Let v, r, q (sigma = 1) prove a network.  A node on links W_new,k and W_j,new asks for

    h' = sum_j r_j' W_j,new,   v' = h'C (-A)^{-1} + a little,   r' = v'B + h'D,   q = -h,

which touches only its own listeners, and its sources k pay for it: q_k falls by r'W_new,k, which the slack
of their decrease (v_k'A_k - q_k'C_k) x < 0 covers or not.  Nobody else notices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..errors import (
    ConeMismatchError,
    DataError,
    ShapeError,
    TimebaseError,
)
from ..exact.condition import all_hold
from ..exact.intake import exact_matrix, found
from ..exact.matrix import Matrix
from ..proof.certificate import Status
from . import conditions as on
from .blocks import Floats, apply, inverse
from .certificate import NetworkCertificate, flat, per_node
from .certify import nudge, provable_rate, supply_rates
from .model import NetworkModel, NodeStack, same_timebase

Blocks: TypeAlias = "dict[int, Floats]"
_SHARES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)


@dataclass(frozen=True, eq=False)
class LocalNode:
    """One node with its part of a certificate: a stack of one, and v, r, q."""

    stack: NodeStack
    v: Floats
    r: Floats
    q: Floats


@dataclass(frozen=True, eq=False)
class Overlay:
    """A certified network and what has changed since; looking at a node costs its degree.

    Nodes keep an identity for life: 0, ..., N-1 in the base, N, N+1, ... for new ones.  Positions close up
    when a node is removed.

    Attributes
    ----------
    base : NetworkCertificate
    nodes : dict
        New or changed nodes by identity.
    removed : tuple of int
        Identities, sorted.
    sources, targets : dict of dict
        Links of nodes whose links changed: identity -> {other identity: block}.
    count : int
        Identities given out so far.
    decay_rate : float
        Proven for the changed network.
    covered : bool
        False once a change was not covered by the certificate.
    """

    base: NetworkCertificate
    nodes: dict[int, LocalNode] = field(default_factory=dict)
    removed: tuple[int, ...] = ()
    sources: dict[int, Blocks] = field(default_factory=dict)
    targets: dict[int, Blocks] = field(default_factory=dict)
    count: int = 0
    decay_rate: float = 0.0
    covered: bool = True

    @classmethod
    def of(cls, certificate: NetworkCertificate) -> Overlay:
        """Nothing changed yet."""
        plain = certificate.exact is None and bool(np.all(certificate.sigma == 1))
        sound = certificate.status is Status.PROVED and plain
        return cls(certificate, count=certificate.model.n_nodes, decay_rate=certificate.decay_rate, covered=sound)

    @property
    def n_nodes(self) -> int:
        """Nodes there are now."""
        return self.count - len(self.removed)

    def identity(self, position: int) -> int:
        """Identity of the node at a position."""
        if isinstance(position, (bool, np.bool_)) or not isinstance(position, (int, np.integer)):
            raise DataError(f"node is {found(position)}; give the number of a node.")
        if not -self.n_nodes <= position < self.n_nodes:
            raise ShapeError(f"node {position} does not exist; the nodes are numbered 0 to {self.n_nodes - 1}.")
        out = position % self.n_nodes
        for gone in self.removed:
            out += gone <= out
        return out

    # -- looking at single nodes

    @cached_property
    def _flat(self) -> tuple[Floats, Floats, Floats]:
        cached: Any = vars(self.base).get("_flat")
        if cached is None:
            model = self.base.model
            values = (self.base.v, self.base.r, self.base.q)
            cached = tuple(np.zeros(model.totals[k]) if x is None else flat(x, model, k) for k, x in enumerate(values))
            vars(self.base)["_flat"] = cached
        return cached

    def node(self, identity: int) -> LocalNode:
        """A node and its part of the certificate."""
        if identity in self.nodes:
            return self.nodes[identity]
        model = self.base.model
        g, place = model.find(identity)
        at = [slice(int(o[identity]), int(o[identity + 1])) for o in model.offsets]
        v, r, q = (part[a] for part, a in zip(self._flat, at, strict=True))
        return LocalNode(model.stacks[g].take(place), v, r, q)

    def links(self, identity: int, incoming: bool) -> Blocks:
        """Blocks of the links into (or out of) a node, by the identity of the other end."""
        changed = self.sources if incoming else self.targets
        if identity in changed:
            return changed[identity]
        return model_links(self.base.model, identity, incoming)

    # -- changes

    def place(
        self, identity: int, stack: NodeStack, incoming: Mapping[int, Any], outgoing: Mapping[int, Any]
    ) -> Overlay:
        """Put a node at an identity, new or not, with these links; certified if the certificate covers it."""
        ports = stack.sizes[1:]
        into = {
            k: shaped_link(w, ports[0], self._sizes(k, identity, ports)[1], _called(k, identity))
            for k, w in incoming.items()
        }
        out_of = {
            j: shaped_link(w, self._sizes(j, identity, ports)[0], ports[1], _called(identity, j))
            for j, w in outgoing.items()
        }
        if identity in into or identity in out_of:
            own = into.get(identity, out_of.get(identity))
            into[identity] = out_of[identity] = own  # type: ignore[assignment]
        sources, targets = dict(self.sources), dict(self.targets)
        for k in set(self.links(identity, True) if identity < self.count else ()) | set(into):
            if k != identity:
                targets[k] = (
                    {**self.links(k, False), identity: into[k]}
                    if k in into
                    else _without(self.links(k, False), identity)
                )
        for j in set(self.links(identity, False) if identity < self.count else ()) | set(out_of):
            if j != identity:
                sources[j] = (
                    {**self.links(j, True), identity: out_of[j]}
                    if j in out_of
                    else _without(self.links(j, True), identity)
                )
        sources[identity], targets[identity] = into, out_of
        empty = LocalNode(stack, np.zeros(stack.sizes[0]), np.zeros(ports[0]), np.zeros(ports[1]))
        changed = replace(
            self,
            nodes={**self.nodes, identity: empty},
            sources=sources,
            targets=targets,
            count=max(self.count, identity + 1),
        )
        return changed._recertify(identity)

    def _sizes(self, other: int, identity: int, ports: tuple[int, int]) -> tuple[int, int]:
        return ports if other == identity else self.node(other).stack.sizes[1:]

    def remove(self, identity: int) -> Overlay:
        """Take a node and its links away: (III') only gets easier, so nothing has to be found."""
        sources, targets = dict(self.sources), dict(self.targets)
        for k in self.links(identity, True):
            targets[k] = _without(self.links(k, False), identity)
        for j in self.links(identity, False):
            sources[j] = _without(self.links(j, True), identity)
        for links in (sources, targets):
            links.pop(identity, None)
        nodes = _without(self.nodes, identity)
        removed = tuple(sorted((*self.removed, identity)))
        return replace(self, nodes=nodes, removed=removed, sources=sources, targets=targets)

    def _recertify(self, identity: int) -> Overlay:
        """Prove the changed node, its links, and its sources; `covered` says whether that worked."""
        failed = replace(self, covered=False)
        into, out_of = self.links(identity, True), self.links(identity, False)
        stack = self.node(identity).stack
        if not self.covered or identity in into or not stack.D.is_zero:
            return failed
        if any(not self.node(k).stack.D.is_zero for k in into):
            return failed
        h = sum((block.T @ self.node(j).r for j, block in out_of.items()), np.zeros(stack.sizes[2]))
        least = 1.0 if self.base.model.discrete else 0.0
        K = inverse(least * np.eye(stack.sizes[0]) - stack.A.values)
        c = np.asarray(stack.X.dual.interior_point)[None]
        heard = apply(K, apply(stack.C.values, h[None], transposed=True), transposed=True)
        little = apply(K, c, transposed=True)
        scale = max(float(np.abs(heard).max()), 1e-3) / max(float(np.abs(little).max()), 1e-300)
        for share in _SHARES:
            trial = self._with_prices(identity, heard + share * scale * little)
            if trial is not None and trial._proven(identity, list(into)):
                return trial
        return failed

    def _with_prices(self, identity: int, v: Floats) -> Overlay | None:
        if not np.isfinite(v).all():
            return None
        stack = self.node(identity).stack
        alone = NetworkModel((stack,), (np.array([0]),), Matrix(sp.csr_array((stack.sizes[1], stack.sizes[2]))))
        _, r, _ = supply_rates(alone, v.ravel())
        nodes = {**self.nodes, identity: LocalNode(stack, v.ravel(), r, np.zeros(stack.sizes[2]))}
        trial = replace(self, nodes=nodes)
        for k in (identity, *self.links(identity, True)):
            local = trial.node(k)
            heard, size = np.zeros(local.stack.sizes[2]), np.zeros(local.stack.sizes[2])
            for j, block in trial.links(k, False).items():
                heard += block.T @ trial.node(j).r
                size += np.abs(block).T @ np.abs(trial.node(j).r)
            units = 8 * (2 * len(trial.links(k, False)) * 4 + 32)
            nodes[k] = replace(local, q=-(heard + nudge(local.stack.Y, size[None], units, dual=True)[0]))
        rates = []
        for k in (identity, *self.links(identity, True)):
            local = nodes[k]
            model = NetworkModel((local.stack,), (np.array([0]),), Matrix(sp.csr_array(local.stack.sizes[1:])))
            rates.append(provable_rate(model, local.v, local.q, discrete=self.base.model.discrete))
        rate = min(*rates, self.decay_rate) if rates else self.decay_rate
        return replace(trial, decay_rate=rate) if rate > 0 else None

    def _proven(self, identity: int, sources: list[int]) -> bool:
        """The inequalities of Theorem 4 that involve the node or q of its sources, on a network of the nodes around."""
        touched = [identity, *sources]
        around = list(dict.fromkeys([*touched, *(j for k in touched for j in self.links(k, False))]))
        rank = {k: i for i, k in enumerate(around)}
        local = [self.node(k) for k in around]
        model = assemble(
            local, [(rank[j], rank[k], b) for k in touched for j, b in self.links(k, False).items()], self.base.model.dt
        )
        new = rank[identity]
        inside = on.positivity(model, new)
        for i in range(len(touched)):
            inside += [
                on.storage(model, i, local[i].v[None]),
                on.decrease(model, i, local[i].v[None], local[i].q[None], self.decay_rate, discrete=model.discrete),
                on.supply(model, i, local[i].v[None], local[i].q[None], local[i].r[None]),
            ]
        # the other nodes around only lend their r: q = -W'r - ... makes their rows of (III') void
        q = np.concatenate([n.q if i < len(touched) else np.zeros(n.q.size) for i, n in enumerate(local)])
        r = np.concatenate([n.r for n in local])
        return all_hold([*inside, *on.coupling(model), on.balance(model, q, r, None)])

    # -- the whole network

    def build(self) -> NetworkModel:
        """All nodes and links of the changed network; linear in its size."""
        model = self.base.model
        keep = np.ones(model.n_nodes, dtype=bool)
        for k in (*self.removed, *self.nodes):
            if k < model.n_nodes:
                keep[k] = False
        alive = np.ones(self.count, dtype=bool)
        alive[list(self.removed)] = False
        position = np.cumsum(alive) - 1
        stacks, members = model.kept(keep, position)
        for k, local in self.nodes.items():
            stacks.append(local.stack)
            members.append(position[[k]])
        empty = NetworkModel(tuple(stacks), tuple(members), Matrix(sp.csr_array((0, 0))), model.dt)
        return empty.with_coupling(Matrix(self._whole_coupling(empty, position)))

    def _whole_coupling(self, new: NetworkModel, position: Any) -> sp.csr_array:
        model = self.base.model
        coo = sp.coo_array(model.W)
        j, k = model.owners(1)[coo.coords[0]], model.owners(2)[coo.coords[1]]
        changed = np.zeros(self.count, dtype=bool)
        changed[[*self.sources, *self.removed]] = True
        lost = np.zeros(self.count, dtype=bool)
        lost[list(self.removed)] = True
        same = ~(changed[j] | lost[k])
        u0, y0 = new.offsets[1], new.offsets[2]
        rows = [u0[position[j[same]]] + coo.coords[0][same] - model.offsets[1][j[same]]]
        columns = [y0[position[k[same]]] + coo.coords[1][same] - model.offsets[2][k[same]]]
        data = [coo.data[same]]
        for target, links in self.sources.items():
            for source, block in links.items():
                a, b = np.nonzero(block)
                rows.append(u0[position[target]] + a)
                columns.append(y0[position[source]] + b)
                data.append(block[a, b])
        at = np.concatenate(rows), np.concatenate(columns)
        return sp.csr_array((np.concatenate(data), at), shape=(new.totals[1], new.totals[2]))

    def certificate(self, model: NetworkModel) -> NetworkCertificate:
        """The certificate of the whole changed network, proven afresh; linear in its size."""
        old = self.base.model
        alive = np.ones(self.count, dtype=bool)
        alive[list(self.removed)] = False
        values = []
        for kind in range(3):
            parts = (
                np.split(self._flat[kind], old.offsets[kind][1:-1])
                if self.nodes or self.removed
                else [self._flat[kind]]
            )
            if self.nodes or self.removed:
                parts += [np.zeros(0)] * (self.count - old.n_nodes)
                for k, local in self.nodes.items():
                    parts[k] = (local.v, local.r, local.q)[kind]
                parts = [p for p, here in zip(parts, alive, strict=True) if here]
            values.append(per_node(np.concatenate(parts), model, kind))
        return NetworkCertificate.settle(
            model=model,
            v=values[0],
            r=values[1],
            q=values[2],
            sigma=np.ones(model.n_nodes),
            decay_rate=self.decay_rate,
        )


def assemble(nodes: list[LocalNode], links: list[tuple[int, int, Floats]], dt: Any) -> NetworkModel:
    """A small network with one stack per node."""
    stacks = tuple(n.stack for n in nodes)
    members = tuple(np.array([i]) for i in range(len(nodes)))
    empty = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), dt)
    W = np.zeros(empty.totals[1:])
    for j, k, block in links:
        W[empty.offsets[1][j] : empty.offsets[1][j + 1], empty.offsets[2][k] : empty.offsets[2][k + 1]] = block
    return empty.with_coupling(Matrix(sp.csr_array(W)))


def model_links(model: NetworkModel, node: int, incoming: bool) -> Blocks:
    """Blocks of the links into or out of a node."""
    matrix, own, other = (model.W, 1, 2) if incoming else (model.WT, 2, 1)
    offsets = model.offsets
    rows = range(int(offsets[own][node]), int(offsets[own][node + 1]))
    out: Blocks = {}
    for i, row in enumerate(rows):
        for p in range(int(matrix.indptr[row]), int(matrix.indptr[row + 1])):
            column = int(matrix.indices[p])
            end = int(np.searchsorted(offsets[other], column, side="right")) - 1
            width = int(offsets[other][end + 1] - offsets[other][end])
            block = out.setdefault(end, np.zeros((len(rows), width)))
            block[i, column - int(offsets[other][end])] += matrix.data[p]
    return out if incoming else {k: b.T for k, b in out.items()}


def shaped_link(weight: Any, rows: int, columns: int, name: str) -> Floats:
    """A link as a block of doubles, refused by name if it has another shape."""
    exact = exact_matrix(weight, name)
    if exact.shape != (rows, columns):
        raise ConeMismatchError(
            f"{name} is {exact.shape[0]} x {exact.shape[1]}, but must be {rows} x {columns}: inputs of its target by "
            "outputs of its source."
        )
    return np.array(exact.values, dtype=float)


def _called(source: int, target: int) -> str:
    return f"the link from node {source} to node {target}"


def _without(items: Mapping[int, Any], key: int) -> dict[int, Any]:
    return {k: value for k, value in items.items() if k != key}


def check_timebase(stack: NodeStack, dt: Any) -> None:
    """Raise `TimebaseError` unless the node fits a network of this timebase."""
    if not same_timebase(stack.dt, dt):
        raise TimebaseError(
            f"the node has dt = {stack.dt}, but the network has dt = {dt}; bring it to the same sampling time."
        )
