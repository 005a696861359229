"""Deciding networks that are known within sets: by common v, by common e, or by a member that fails."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...proof.certificate import Status
from ..blocks import Index
from ..certificate import NetworkCertificate
from ..certify import certify_as_given, violation
from ..model import NetworkModel
from ..witnesses import AlgebraicLoop, CouplingViolation, NetworkInstability, NodeViolation
from .certificate import UncertainNetworkCertificate
from .halves import Half, by_bounds, by_storage
from .members import Vertices, member
from .mixtures import Worst
from .signed import bounds_of, largest_signs, turned_signs
from .witnesses import FailingEnd, FailingMember, NoCommonVectors


@np.errstate(all="ignore")
def certify_all(models: Vertices, lower: NetworkModel | None = None) -> UncertainNetworkCertificate:
    """Prove the network for all vertices by one v, r, q, or by one e, u, y; or find what stands against it.

    A handful of sparse solves and the proof at every vertex; linear in the data.  If cones of a node with several
    vertices are not simplicial, a linear program takes the place of the solves.  If ranges leave the cones, only e is
    tried, for their bounds.  REFUTED with the first of: a vertex that is not positive, a link that leaves the cones, a
    choice that is unstable, or what excludes both v and e.
    """
    storage = by_storage(models, lower)
    for found in storage.proofs():
        if found:
            return found
        if (early := _not_positive(models, storage.given)) is not None:
            return _with_signs(models, lower, early)
    if (early := _not_positive(models, storage.given)) is not None:
        return _with_signs(models, lower, early)
    for found in _members(storage):
        if found.status is Status.REFUTED:
            return found
    bound = by_bounds(models, lower)
    return next(filter(bool, bound.proofs()), None) or _excluded(storage, bound)


def _with_signs(
    models: Vertices, lower: NetworkModel | None, broken: UncertainNetworkCertificate
) -> UncertainNetworkCertificate:
    """A proof by e or an unstable member, where ranges change sign; else what is broken."""
    if lower is None:
        return broken
    bound = by_bounds(bounds_of(models, lower), lower, models[0])
    if bound.loop is None and bound.loops:
        return broken
    found = next(filter(bool, bound.proofs()), None)
    signs = None if found else largest_signs(models[0], lower)
    if found or signs is None:
        return found or broken
    unstable = certify_as_given(turned_signs(models[0], lower, signs))
    if not isinstance(unstable.witness, NetworkInstability | AlgebraicLoop):
        return broken
    given = {"model": models[0], "vertices": models[1:], "lower": lower, "loop_weights": unstable.loop}
    w = FailingMember(np.zeros(models[0].n_nodes), unstable.witness, signs)
    found = UncertainNetworkCertificate.settle(**given, witness=w)
    return found if found.status is Status.REFUTED else broken


def _excluded(storage: Half, bound: Half) -> UncertainNetworkCertificate:
    """REFUTED with what excludes v and e; UNDECIDED with what excludes v, or with nothing."""
    settle = UncertainNetworkCertificate.settle
    for w in storage.motions():
        for z in bound.motions():
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
