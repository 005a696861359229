"""The two proofs for all vertices, by v and by e: candidates for each of them, and for what excludes it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...cones import Cone, Orthant
from ...exact.condition import all_hold
from ...exact.matrix import Matrix
from .. import conditions as on
from ..blocks import Floats
from ..certify import Data, algebraic_witness, candidates, certify_as_given, provable_rate
from ..model import NetworkModel
from ..witnesses import LoopWeights, NetworkInstability
from .bounded import BoundedNetworkCertificate
from .certificate import UncertainNetworkCertificate
from .members import Mixture, Vertices, transposed
from .mixtures import Worst, has_mixtures, loop_weights_of_all, rates_of_all, worst_mixture
from .program import common_vectors, growing_motion, loops_of
from .witnesses import NoCommonStorage

# Powers of algebraic loops, what is a whole number in their vectors, and the largest least of these numbers.
_POWERS, _WHOLE, _MOST_WHOLE = 300, 1e-6, 50
# In cones other than orthants: what inputs and outputs of a mixture are shortened by, and what lifts vectors into them.
_SHORTER, _LIFT = 1e-7, 1e-9


@dataclass(frozen=True, eq=False)
class Half:
    """Common vectors of Theorem 4 for the vertices of a network, or of the transposed one.

    Attributes
    ----------
    models : tuple of NetworkModel
    kind : type
        Of the certificate.
    ends : dict
        Its fields about ranges.
    """

    models: Vertices
    kind: type[UncertainNetworkCertificate]
    ends: dict[str, NetworkModel | None]

    @property
    def given(self) -> dict[str, Any]:
        """What the certificate is about."""
        return {"model": self.models[0], "vertices": self.models[1:], **self.ends}

    @cached_property
    def mixes(self) -> bool:
        """True if mixtures decide."""
        return has_mixtures(self.models)

    @cached_property
    def loops(self) -> bool:
        """True if there is feedthrough."""
        return any(m.has_feedthrough for m in self.models)

    @cached_property
    def program(self) -> Data | None:
        """Vectors from the linear program, where mixtures do not decide."""
        return None if self.mixes else common_vectors(self.models)

    @cached_property
    def loop(self) -> LoopWeights:
        """p and t that prove that the algebraic loops of all choices contract, or None."""
        if not self.loops or not (self.mixes or self.program is not None):
            return None
        p, t = loop_weights_of_all(self.models)[:2] if self.program is None else loops_of(self.models, self.program[1])
        if not (np.isfinite(p).all() and np.isfinite(t).all()):
            return None
        weights = Matrix(p), Matrix(t)
        return weights if all(all_hold(list(on.loop_gain(m, *weights))) for m in self.models) else None

    @cached_property
    def worst(self) -> Worst | None:
        """The worst mixture."""
        return worst_mixture(self.models) if self.mixes and (self.loop is not None or not self.loops) else None

    @property
    def has_vectors(self) -> bool:
        """True if candidates for common vectors were found."""
        if self.loops and self.loop is None:
            return False
        return self.program is not None or (self.worst is not None and self.worst.solved)

    def proofs(self) -> Iterator[UncertainNetworkCertificate]:
        """Certificates, which may be proven, in order of cost."""
        for data in self._vectors():
            rate = min(provable_rate(m, Matrix(data[0]), Matrix(data[2]), discrete=m.discrete) for m in self.models)
            parts = dict(zip("vrq", map(Matrix, data), strict=True))
            yield self.kind.settle(**self.given, loop_weights=self.loop, **parts, decay_rate=max(rate, 0.0))

    def _vectors(self) -> Iterator[Data]:
        """Vectors of the worst mixture, then more exact ones; or those of the linear program."""
        if self.program is not None:
            yield self.program
        worst = self.worst
        if worst is not None and worst.vectors is not None:
            yield rates_of_all(self.models, *worst.vectors)
            for v, r, _ in candidates(worst.network, float(worst.network.discrete)):
                yield rates_of_all(self.models, v, r)

    def motions(self) -> Iterator[NoCommonStorage]:
        """What may exclude common vectors."""
        if self.loop is None and self.loops and self.mixes:
            mixture = loop_weights_of_all(self.models)[2]
            network = mixture.network(self.models)
            w = algebraic_witness(network)
            for u, y in _whole_loops(network) if w is None else [(w.u, w.y)]:
                still = NetworkInstability(np.zeros(network.totals[0]), u, y)
                yield _parted(Worst(mixture, network, None), still, len(self.models))
        if not self.mixes:
            w = growing_motion(self.models)
            if w is not None:
                yield w
        if self.worst is not None:
            w = certify_as_given(self.worst.network).witness
            if isinstance(w, NetworkInstability):
                yield _parted(self.worst, w, len(self.models))


def by_storage(models: Vertices, lower: NetworkModel | None) -> Half:
    """Common v, r, q."""
    return Half(models, UncertainNetworkCertificate, {"lower": lower})


def by_bounds(models: Vertices, lower: NetworkModel | None, upper: NetworkModel | None = None) -> Half:
    """Common e, u, y; with `upper`, models are bounds of both ends of ranges."""
    ends = {"lower": lower, "upper": upper}
    turned = {name: None if end is None else transposed([end])[0] for name, end in ends.items()}
    return Half(transposed(models), BoundedNetworkCertificate, turned)


def _whole_loops(network: NetworkModel) -> Iterator[tuple[Floats, Floats]]:
    """u = W y and y in small whole numbers that may be those of an algebraic loop of gain 1, on orthants."""
    D, y = network.block_matrices[3], np.ones(network.totals[2])
    if not all(isinstance(cone, Orthant) for s in network.stacks for cone in (s.U, s.Y)):
        return
    for _ in range(_POWERS):
        y = D @ (network.W @ y) + y  # a shift, as loops may be periodic
        y /= max(float(y.max(initial=0.0)), 1e-300)
    y = np.where(y > _WHOLE, y, 0.0)
    for size in range(1, _MOST_WHOLE if y.any() else 0):
        whole = y / y[y > 0].min() * size
        if (np.abs(whole - np.round(whole)) < _WHOLE * whole.max()).all():
            yield network.W @ np.round(whole), np.round(whole)
            return


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
