"""Order intervals of networks: candidates from sparse solves, which `network_certificate` proves.

-A^{-1} w, A the closed loop, is found through the ports (`networks.spectrum.port_solves`).  It is moved up and down
by small parts of -A^{-1} z, z in X of the size of what is added up at every node, so that no rounding is in the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from ...cones import Orthant
from ...exact.budget import spend
from ...exact.matrix import Matrix
from ...networks.certificate import NetworkCertificate, node_vectors
from ...networks.certify import loop_weights, proven_by_parts, supply_rates
from ...networks.inwards import lower_received
from ...networks.inwards import moved as lowered
from ...networks.model import NetworkModel
from ...networks.network import ConeNetwork
from ...networks.spectrum.descent import Approach, descend, rate_scale
from ...networks.spectrum.port_solves import PortSystem
from ...networks.witnesses import NetworkInstability, kept_parts
from ...proof.certificate import Status
from ..plant import Floats
from ..running import Programs
from .certificate import BoundExceeded, NoInterval
from .network_certificate import NetworkIntervalCertificate
from .network_covers import largest_states, network_covers

# How far apart x_max and x_min are, relatively, tried in turn; and what is added to z, as a part of its largest entry.
_APART = (1e-12, 1e-11, 1e-9, 1e-7, 1e-5)
_FLOORS = (0.0, 1e-6)
# Errors of the solves, and how often they are refined.
_TOLERANCE, _REFINED = 1e-13, 3
# Distance below the margin, relative to the rates of the nodes, at which nothing grows.
_CLEARLY = 1e-9
# Operations of a proof, for each state, input, output and link.
_PROOF = 2e3
# Steps after which ports that feed back on each other are not raised or lowered any more.
_TURNS = 60


class NetworkBounds(NamedTuple):
    """Disturbances of a network, and f x <= b."""

    w: Matrix
    rows: Matrix | None
    bounds: Matrix | None


def network_intervals(net: ConeNetwork, given: NetworkBounds, lp: Programs) -> Iterator[NetworkIntervalCertificate]:
    """Certificates of ever wider intervals, with the constraints if these could be covered; those that refute them."""
    stable = net.certificate
    model = stable.model
    spend(_PROOF * (sum(model.totals) + model.coupling.values.size))
    with kept_parts(model):
        if stable:
            yield from _around(stable, given, lp)
        elif isinstance(stable.witness, NetworkInstability) and proven_by_parts(model):
            yield from _excluded(model, given)


def _around(stable: NetworkCertificate, given: NetworkBounds, lp: Programs) -> Iterator[NetworkIntervalCertificate]:
    model, (v, r, q) = stable.model, node_vectors(stable)
    # r and q are those of sigma = 1 where sigma is not
    if stable.sigma is not None and (stable.sigma != 1).any():
        v, r, q = (Matrix(part) for part in supply_rates(model, stable.sigma[model.owners(0)] * v.values))
    settle = partial(
        NetworkIntervalCertificate.settle,
        model=model,
        v=v,
        r=r,
        q=q,
        loop_weights=stable.loop,
        w_max=given.w,
    )
    for above, below in _ends(model, np.asarray(given.w.values)):
        upper, lower = _end(model, *above, sign=-1), _end(model, *below, sign=1)
        ends = dict(zip(("x_max", "u_max", "y_max"), upper, strict=True))
        least = dict(zip(("x_min", "u_min", "y_min"), lower, strict=True))
        if given.rows is None or given.bounds is None:
            yield settle(**ends, **least)
            continue
        limits, most = {"rows": given.rows, "bounds": given.bounds}, np.asarray(given.bounds.values)
        covers = network_covers(model, given.rows, upper[0], lp)
        if covers is not None and not (covers.values @ upper[0] > most).any():
            yield settle(**ends, **least, **limits, covers=covers)
        for row, x in largest_states(model, given.rows, most, lower[0], lp):
            yield settle(**least, **limits, witness=BoundExceeded(x, row))


def _ends(model: NetworkModel, w: Floats) -> Iterator[tuple[tuple[Floats, Floats], tuple[Floats, Floats]]]:
    """(x, u) of x_max, and of x_min."""
    system = PortSystem(model, float(model.discrete))
    if not system.is_finite:
        return
    x, u = _solved(system, w)
    size = model.times("A", np.abs(x), absolute=True) + model.times("B", np.abs(u), absolute=True) + np.abs(w)
    for floor in _FLOORS:
        more, push = _solved(system, _inside(model, size + model.discrete * np.abs(x) + floor * size.max(initial=0.0)))
        for part in _APART:
            yield (x + part * more, u + part * push), (x - part * more, u - part * push)


def _solved(system: PortSystem, d: Floats) -> tuple[Floats, Floats]:
    """x and u with (mu I - A) x = d, refined."""
    model, (x, u) = system.model, system.primal(d, _TOLERANCE)
    for _ in range(_REFINED):
        u = model.W @ (model.times("C", x) + model.times("D", u))
        missed = d + model.times("A", x) + model.times("B", u) - system.shift * x
        if not np.isfinite(missed).all() or not missed.any():
            break
        more, _ = system.primal(missed, 1e-3)
        x = x + more
    return x, model.W @ (model.times("C", x) + model.times("D", u))


def _inside(model: NetworkModel, size: Floats) -> Floats:
    """A vector inside the cone of every node, of this size."""
    parts = []
    for s, z in zip(model.stacks, model.split(size, 0), strict=True):
        if not isinstance(s.X, Orthant):
            point = np.asarray(s.X.interior_point)
            z = z.max(axis=1, keepdims=True, initial=0.0) * point / np.abs(point).max()
        parts.append(z)
    return model.join(parts, 0)


def _end(model: NetworkModel, x: Floats, u: Floats, *, sign: int) -> tuple[Floats, Floats, Floats]:
    """x with u and y of which the ports prove sign (W y - u) >= 0 and sign (C x + D u - y) >= 0."""
    y = np.zeros(0)
    for _ in range(_TURNS if model.has_feedthrough else 1):
        y = sign * lowered(model, "Y", [("C", sign * x), ("D", sign * u)], dual=False)
        before, u = u, sign * lower_received(model, sign * y)
        if np.array_equal(before, u):
            break
    return x, u, y


def _cut(model: NetworkModel, d: Floats) -> tuple[Floats, Floats, Floats] | None:
    """d, r and q on the nodes where (d'A - q'C) x >= 0; None if nothing is left.

    Without a node the others see less of d, so that nodes go until none has to.
    """
    while d.any():
        below, r, q = supply_rates(model, -d)
        ahead = model.times("A", -below, transposed=True) + model.times("C", q, transposed=True) - model.discrete * d
        bad = np.zeros(model.n_nodes, dtype=bool)
        for s, index, z, part in zip(
            model.stacks, model.members, model.split(ahead, 0), model.split(d, 0), strict=True
        ):
            bad[index] = (z @ np.asarray(s.X.rays).T < 0).any(axis=1) & part.any(axis=1)
        if not bad.any():
            return d, -r, -q
        d = np.where(bad[model.owners(0)], 0.0, d)
    return None


def _excluded(model: NetworkModel, given: NetworkBounds) -> Iterator[NetworkIntervalCertificate]:
    """What excludes every interval: a left vector of growth that the disturbances reach."""
    loop, found, pushed = loop_weights(model), list[NetworkIntervalCertificate](), np.asarray(given.w.values)

    def stop(at: Approach) -> bool:
        kept = _cut(model, at.v / np.abs(at.v).max()) if at.theta > float(model.discrete) else None
        if kept is not None and kept[0] @ pushed > 0:
            d, r, q = kept
            proof = NetworkIntervalCertificate.settle(
                model=model, r=r, q=q, loop_weights=loop, w_max=given.w, witness=NoInterval(d)
            )
            found.extend([proof] if proof.status is Status.REFUTED else [])
        return bool(found) or at.shift < float(model.discrete) - _CLEARLY * rate_scale(model)

    descend(model, float(model.discrete), relative=1e-10, stop=stop)
    yield from found
