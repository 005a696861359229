"""Deciding networks that are known within sets: by common v, by common e, or by a member that fails."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...exact.matrix import Matrix
from ...proof.certificate import Status
from ..blocks import Index
from ..certificate import NetworkCertificate
from ..certify import at_own_link, certify_as_given, violation
from ..model import NetworkModel
from ..nodes import NodeStack
from ..witnesses import AlgebraicLoop, CouplingViolation, NetworkInstability, NodeViolation
from .certificate import UncertainNetworkCertificate
from .halves import Half, by_bounds, by_storage
from .members import Vertices, member
from .mixtures import Worst
from .own_links import closed_at_all
from .signed import bounds_of, largest_signs, turned_signs
from .witnesses import FailingEnd, FailingMember, NoCommonVectors


@dataclass(frozen=True, eq=False)
class Searches:
    """The searches for a proof of a network: v, then e; if ranges leave the cones, e for their bounds only.

    Attributes
    ----------
    models, lower
        As for `certify_all`.
    """

    models: Vertices
    lower: NetworkModel | None

    @cached_property
    def storage(self) -> Half:
        """The search for v."""
        return by_storage(self.models, self.lower)

    @cached_property
    def broken(self) -> UncertainNetworkCertificate | None:
        """What leaves its cones."""
        return _not_positive(self.models, self.storage.given)

    @cached_property
    def bound(self) -> Half | None:
        """The search for e; None if something leaves its cones that is in no range."""
        if self.broken is None:
            return by_bounds(self.models, self.lower)
        if self.lower is None:
            return None
        bounds = bounds_of(self.models, self.lower)
        if _not_positive(bounds, {"model": bounds[0], "vertices": bounds[1:], "lower": None}) is not None:
            return None
        return by_bounds(bounds, self.lower, self.models[0])

    @property
    def closed(self) -> tuple[Vertices, NetworkModel | None] | None:
        """The networks with links of nodes to themselves closed, if one of these is what leaves its cones."""
        return closed_at_all(self.models, self.lower) if _at_own_link(self.models[0], self.broken) else None

    def proof(self) -> UncertainNetworkCertificate | None:
        """The first proof."""
        for found in self.storage.proofs():
            if found:
                return found
            if self.broken is not None:
                break
        return None if self.bound is None else next(filter(bool, self.bound.proofs()), None)

    def seems_proven(self) -> bool:
        """True if vectors were found, which are not proven: the solves alone."""
        if self.broken is None and self.storage.has_vectors:
            return True
        return self.bound is not None and self.bound.has_vectors


@np.errstate(all="ignore")
def certify_all(models: Vertices, lower: NetworkModel | None = None) -> UncertainNetworkCertificate:
    """Prove the network for all vertices by one v, r, q, or by one e, u, y; or find what stands against it.

    A handful of sparse solves and the proof at every vertex; linear in the data.  If cones of a node with several
    vertices are not simplicial, a linear program takes the place of the solves.  If ranges leave the cones, only e is
    tried, for their bounds.  REFUTED with the first of: a vertex that is not positive, a link that leaves the cones, a
    choice that is unstable, or what excludes both v and e.  If a link of a node to itself is what leaves the cones,
    such links are closed at every vertex, as parts of the nodes of the certificate.
    """
    tried = Searches(models, lower)
    proof = tried.proof()
    if proof is not None:
        return proof
    closed = tried.closed
    if closed is not None:
        found = certify_all(*closed)
        if found or len(closed[0]) == len(models):  # pairs of vertices are no members
            return found
    if tried.broken is not None:
        turned = None if lower is None else _with_signs(models, lower)
        return tried.broken if turned is None else turned
    for found in _members(tried.storage):
        if found.status is Status.REFUTED:
            return next(_alone(tried.storage, found), found)
    return _excluded(tried.storage, tried.bound)


def _at_own_link(model: NetworkModel, broken: UncertainNetworkCertificate | None) -> bool:
    """True if a link of a node to itself, or a node that has one, is what leaves the cones."""
    w = None if broken is None else broken.witness
    return at_own_link(model, w.witness if isinstance(w, FailingMember | FailingEnd) else w)


def _with_signs(models: Vertices, lower: NetworkModel) -> UncertainNetworkCertificate | None:
    """An unstable member of ranges that change sign, with the signs of some nodes turned."""
    signs = largest_signs(models[0], lower)
    if signs is None:
        return None
    unstable = certify_as_given(turned_signs(models[0], lower, signs))
    if not isinstance(unstable.witness, NetworkInstability | AlgebraicLoop):
        return None
    given = {"model": models[0], "vertices": models[1:], "lower": lower, "loop_weights": unstable.loop}
    w = FailingMember(np.zeros(models[0].n_nodes), unstable.witness, signs)
    found = UncertainNetworkCertificate.settle(**given, witness=w)
    return found if found.status is Status.REFUTED else None


def _excluded(storage: Half, bound: Half | None) -> UncertainNetworkCertificate:
    """REFUTED with what excludes v and e; UNDECIDED with what excludes v, or with nothing."""
    settle = UncertainNetworkCertificate.settle
    for w in storage.motions():
        for z in () if bound is None else bound.motions():
            found = settle(**storage.given, witness=NoCommonVectors(w, z))
            if found.status is Status.REFUTED:
                return found
        return settle(**storage.given, loop_weights=storage.loop, witness=w)
    return settle(**storage.given, loop_weights=storage.loop)


def _members(half: Half) -> Iterator[UncertainNetworkCertificate]:
    """Certificates with members that may be unstable."""
    for choice in _choices(half.models, half.worst):
        found = certify_as_given(member(half.models, choice))
        if isinstance(found.witness, NetworkInstability | AlgebraicLoop):
            yield _member(half.given, choice, found)


def _choices(models: Vertices, worst: Worst | None) -> Iterator[Index]:
    """Members that may be unstable: what most generators of each node take, then every vertex alone."""
    if worst is not None:
        yield worst.mixture.majority(models[0], len(models))
    for s in range(len(models)):
        yield np.full(models[0].n_nodes, s)


def _alone(half: Half, found: UncertainNetworkCertificate) -> Iterator[UncertainNetworkCertificate]:
    """The same refusal by one node at one vertex that is unstable without links, if there is one: it names both."""
    for s, model in enumerate(half.models):
        if any(_may_grow(stack, model.discrete) for stack in model.stacks):
            bare = replace(model, coupling=Matrix(sp.csr_array(model.coupling.shape)))
            alone = certify_as_given(bare).witness
            if isinstance(alone, NetworkInstability):
                w = FailingMember(np.full(model.n_nodes, float(s)), alone)
                named = UncertainNetworkCertificate.settle(**half.given, loop_weights=found.loop_weights, witness=w)
                if named.status is Status.REFUTED:
                    yield named


def _may_grow(stack: NodeStack, discrete: bool) -> bool:
    """Whether computed eigenvalues of a node are unstable, or nearly."""
    if not stack.sizes[0]:
        return False
    values = np.linalg.eigvals(stack.A.values)
    return bool((abs(values) >= 1 - 1e-9).any() if discrete else (values.real >= -1e-9 * abs(values)).any())


def _not_positive(models: Vertices, given: Any) -> UncertainNetworkCertificate | None:
    """The certificate refuted by a vertex that is not positive or a link that leaves the cones, if there is one."""
    for s, model in enumerate(models):
        found = violation(model)
        if found is not None and isinstance(found.witness, CouplingViolation):
            return UncertainNetworkCertificate.settle(**given, witness=found.witness)
        if found is not None and isinstance(found.witness, NodeViolation):
            choice = np.zeros(model.n_nodes, dtype=np.intp)
            choice[found.witness.node] = s
            return _member(given, choice, found)
    found = None if given["lower"] is None else violation(given["lower"])
    if found is None:
        return None
    return UncertainNetworkCertificate.settle(**given, witness=FailingEnd(found.witness))


def _member(given: Any, choice: Index, found: NetworkCertificate) -> UncertainNetworkCertificate:
    w = FailingMember(choice.astype(float), found.witness)
    return UncertainNetworkCertificate.settle(**given, loop_weights=found.loop, witness=w)
