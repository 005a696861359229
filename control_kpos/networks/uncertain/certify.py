"""Finding common vectors of Theorem 4 for all vertices, or what excludes them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...cones import Cone, Orthant
from ...exact.condition import all_hold
from ...exact.matrix import Matrix
from ...proof.certificate import Status
from .. import conditions as on
from ..blocks import Floats, Index
from ..certificate import NetworkCertificate
from ..certify import Data, algebraic_witness, candidates, certify_as_given, provable_rate, violation
from ..model import NetworkModel
from ..witnesses import AlgebraicLoop, CouplingViolation, LoopWeights, NetworkInstability, NodeViolation
from .certificate import UncertainNetworkCertificate
from .members import Mixture, Vertices, member
from .mixtures import Worst, has_mixtures, loop_weights_of_all, rates_of_all, worst_mixture
from .program import common_vectors, growing_motion, loops_of
from .witnesses import FailingEnd, FailingMember, NoCommonStorage

# In cones other than orthants: what inputs and outputs of a mixture are shortened by, and what lifts vectors into them.
_SHORTER, _LIFT = 1e-7, 1e-9


@np.errstate(all="ignore")
def certify_all(models: Vertices, lower: NetworkModel | None = None) -> UncertainNetworkCertificate:
    """Decide Theorem 4 with one v, r, q for all vertices.

    A handful of sparse solves and the proof at every vertex; linear in the data.  If X or U of a node with several
    vertices is not simplicial, a linear program takes the place of the solves.  REFUTED with the first of: a vertex
    that is not positive, a link that leaves the cones, a choice of vertices that is unstable, a mixture.
    """
    program = None if has_mixtures(models) else common_vectors(models)
    loop = _loop(models, program)
    given: dict[str, Any] = {"model": models[0], "vertices": models[1:], "lower": lower}
    common = {**given, "loop_weights": loop}
    contracts = loop is not None or not any(m.has_feedthrough for m in models)
    worst = worst_mixture(models) if has_mixtures(models) and contracts else None
    for data in _vectors(models, worst, program):
        rate = min(provable_rate(m, Matrix(data[0]), Matrix(data[2]), discrete=m.discrete) for m in models)
        parts = dict(zip("vrq", map(Matrix, data), strict=True))
        found = UncertainNetworkCertificate.settle(**common, **parts, decay_rate=max(rate, 0.0))
        if found:
            return found
        if (early := _not_positive(models, given)) is not None:
            return early
    for found in _refuted(models, worst, common):
        if found.status is Status.REFUTED:
            return found
    return UncertainNetworkCertificate.settle(**common)


def _vectors(models: Vertices, worst: Worst | None, program: Data | None) -> Iterator[Data]:
    """Vectors of the worst mixture, then more exact ones; or those of the linear program."""
    if program is not None:
        yield program
    if worst is not None and worst.vectors is not None:
        yield rates_of_all(models, *worst.vectors)
        for v, r, _ in candidates(worst.network, float(worst.network.discrete)):
            yield rates_of_all(models, v, r)


def _loop(models: Vertices, program: Data | None) -> LoopWeights:
    """p and t that prove that the algebraic loops of all choices contract, or None."""
    if not any(m.has_feedthrough for m in models) or not (has_mixtures(models) or program is not None):
        return None
    p, t = loop_weights_of_all(models)[:2] if program is None else loops_of(models, program[1])
    if not (np.isfinite(p).all() and np.isfinite(t).all()):
        return None
    weights = Matrix(p), Matrix(t)
    return weights if all(all_hold(list(on.loop_gain(m, *weights))) for m in models) else None


def _refuted(models: Vertices, worst: Worst | None, common: Any) -> Iterator[UncertainNetworkCertificate]:
    """Witnesses, those against the network itself first."""
    given = {name: x for name, x in common.items() if name != "loop_weights"}
    early = _not_positive(models, given)
    if early is not None:
        yield early
    for choice in _choices(models, worst):
        found = certify_as_given(member(models, choice))
        if isinstance(found.witness, NetworkInstability | AlgebraicLoop):
            yield _member(given, choice, found)
    if common["loop_weights"] is None and any(m.has_feedthrough for m in models) and has_mixtures(models):
        mixture = loop_weights_of_all(models)[2]
        network = mixture.network(models)
        w = algebraic_witness(network)
        if w is not None:
            still = NetworkInstability(np.zeros(network.totals[0]), w.u, w.y)
            mixed = _parted(Worst(mixture, network, None), still, len(models))
            yield UncertainNetworkCertificate.settle(**common, witness=mixed)
    if not has_mixtures(models) and not any(m.has_feedthrough for m in models):
        w = growing_motion(models)
        if w is not None:
            yield UncertainNetworkCertificate.settle(**common, witness=w)
    if worst is not None:
        found = certify_as_given(worst.network)
        if isinstance(found.witness, NetworkInstability):
            w = _parted(worst, found.witness, len(models))
            yield UncertainNetworkCertificate.settle(**common, witness=w)


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


def _parted(worst: Worst, w: NetworkInstability, count: int) -> NoCommonStorage:
    """The motion of a mixture, by vertices."""
    model, mixture = worst.network, worst.mixture
    x = _by_vertex(model, "X", np.asarray(w.x), mixture, count)
    u = _by_vertex(model, "U", np.asarray(w.u), mixture, count)
    y = np.asarray(w.y)
    if all(isinstance(cone, Orthant) for s in model.stacks for cone in (s.X, s.U, s.Y)):
        return NoCommonStorage(x, u, np.maximum(y, 0.0))
    return NoCommonStorage(x, u, y * (1 - _SHORTER))


def _by_vertex(model: NetworkModel, name: str, vector: Floats, mixture: Mixture, count: int) -> Floats:
    """A vector in X or U as a sum of one for each vertex, after each other; shortened, and lifted into the cones."""
    kind, out = "XU".index(name), []
    plain = all(isinstance(cone, Orthant) for s in model.stacks for cone in (s.X, s.U, s.Y))
    kept = 1 - 2 * _SHORTER * (name == "U" and not plain)
    for s in range(count):
        parts = zip(model.stacks, model.split(vector, kind), (mixture.states, mixture.inputs)[kind], strict=True)
        out.append(model.join([_share(getattr(k, name), part, chosen == s, kept) for k, part, chosen in parts], kind))
    return np.concatenate(out)


def _share(cone: Cone, part: Floats, own: Any, kept: float) -> Floats:
    """What generators have of vectors, times a number; in the cone."""
    if isinstance(cone, Orthant):
        return np.where(own, np.maximum(part, 0.0), 0.0) * kept
    if not cone.is_simplicial:  # one vertex only
        return np.where(own[:, :1], part, 0.0) * kept
    rays = np.asarray(cone.rays)
    weights = np.maximum(part @ np.linalg.inv(rays), 0.0)
    inner = np.asarray(cone.interior_point)
    small = _LIFT * np.abs(part).max(axis=1, keepdims=True, initial=0.0) * inner / np.abs(inner).max()
    return np.where(own, weights * kept, 0.0) @ rays + small
