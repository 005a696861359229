"""Finding the data of Theorem 4, or what breaks it.

One solve gives v = -A_cl^{-T} c, r = B'v - D'q, q = -W'r and sigma = 1, which satisfy Theorem 4 with
equality everywhere but in the decrease v'A x - q'C x = -c'x < 0.  A few units in the last place of that
decrease are moved to r and q, so that every inequality can be proven in floating point on the given data.
For positive nodes and W Y in U the theorem is necessary too: if v is not in int X*, a state x in X with
A_cl x in X exists and is found at a shift just above the abscissa.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..exact.budget import OutOfBudgetError, require_time
from ..exact.condition import Condition, all_hold
from ..exact.matrix import Matrix
from ..exact.rounding import HALF_ULP
from ..proof.certificate import Status
from ..theorems.positivity import settle_positivity
from . import conditions as on
from .blocks import Floats, Index
from .certificate import NetworkCertificate
from .inwards import lower_outputs, lower_received, moved
from .model import NetworkModel
from .own_links import has_own_links, own_links, own_links_closed
from .spectrum.descent import (
    Approach,
    Hidden,
    Progress,
    descend,
    growing_part,
    interior,
    is_inside,
    mix,
    rate_scale,
    slow_state,
)
from .spectrum.evening import evener
from .spectrum.port_solves import PortSystem, direct_loop
from .spectrum.rational import certify_exactly
from .spectrum.strong_parts import strong_parts
from .witnesses import (
    AlgebraicLoop,
    CouplingViolation,
    LoopWeights,
    NetworkInstability,
    NodeViolation,
    below_abscissa,
    coupling_violation,
    kept_parts,
    nodes_in_loop,
    positive_parts,
)

# Distance to the margin, relative to the rates of the nodes, from which on refinement decides better than shifts.
_CLOSE = 1e-9

# A larger rate is sought while it grows by this factor.
_GAIN = 1.1

# Approaches whose slow states are not proven before the search for growth is left to integers.
_MISSES = 2

Data: TypeAlias = "tuple[Floats, Floats, Floats]"


@np.errstate(all="ignore")
def certify(model: NetworkModel, progress: Progress | None = None) -> NetworkCertificate:
    """Decide Theorem 4 for a network; with W_jj as a part of node j, if that is what breaks it as it was given."""
    found = None if broken_by_own_link(model) else certify_as_given(model, progress)
    closed = own_links_closed(model) if found is None or at_own_link(model, found.witness) else None
    if closed is not None:
        return certify_as_given(closed, progress)
    return certify_as_given(model, progress) if found is None else found


def broken_by_own_link(model: NetworkModel) -> bool:
    """True if a link of a node to itself leaves the cones."""
    return has_own_links(model) and at_own_link(model, broken_link(model, {}))


def at_own_link(model: NetworkModel, witness: Any) -> bool:
    """True if a link of a node to itself, or a node that has one, is what breaks the network."""
    if isinstance(witness, CouplingViolation):
        return witness.target == witness.source
    return isinstance(witness, NodeViolation) and witness.node in own_links(model)[0]


def positive_form(model: NetworkModel) -> NetworkModel | None:
    """The network, or the one with links of nodes to themselves closed, if it is proven positive part by part.

    That is to say (I), positive nodes and contracting algebraic loops; None if neither is.
    """
    if proven_by_parts(model):
        return model
    closed = own_links_closed(model)
    return closed if closed is not None and proven_by_parts(closed) else None


def proven_by_parts(model: NetworkModel) -> bool:
    """True if (I), positive nodes and contracting algebraic loops are proven."""
    return all_hold(positive_parts(model)) and (not model.has_feedthrough or loop_weights(model) is not None)


def certify_as_given(model: NetworkModel, progress: Progress | None = None) -> NetworkCertificate:
    """Decide Theorem 4 for a network.

    REFUTED with the first of: a node that is not positive, a link that leaves the cones, an algebraic loop of gain 1
    or more, a direction of growth.  UNDECIDED is rare: see `certify_exactly`.  A stable network costs one solve in
    the unknowns r (a few sparse products; see `port_solves`) and the proof, which is linear in the data.
    """
    with kept_parts(model):
        return _certified(model, progress)


class _CloseBy(Hidden):
    """At a distance that rounding hides, by the rates of the nodes, which are looked at only if that matters."""

    def __init__(self, model: NetworkModel, least: float) -> None:
        self.model, self.least, self.relative = model, least, 1.0
        self.ended, self._before = False, np.inf

    @cached_property
    def unit(self) -> float:  # type: ignore[override]
        return _CLOSE * rate_scale(self.model)


def _certified(model: NetworkModel, progress: Progress | None) -> NetworkCertificate:
    loop, exact = loop_weights(model), None
    least = 1.0 if model.discrete else 0.0
    close_by = _CloseBy(model, least)
    if not model.has_feedthrough or loop is not None:
        system = PortSystem(model, least)
        for data in candidates(model, least, close_by, system):
            certificate = settle(model, data, loop)
            if certificate.status is Status.PROVED:
                return _faster(certificate, data[0], system)
            found = violation(model)
            if found is not None:
                return found
            if exact is None and certificate.decay_rate < close_by.unit:  # rounding hides the margin
                exact = certify_exactly(model, loop)
                if exact.status is not Status.UNDECIDED:
                    return exact
    found = violation(model)
    if found is not None:
        return found
    if model.has_feedthrough and loop is None:
        found = NetworkCertificate.settle(model=model, witness=algebraic_witness(model))
    else:
        with np.errstate(all="ignore"):  # candidates that overflow are not proven
            return _close_or_unstable(model, least, loop, progress, exact, close_by)
    return found if found.status is not Status.UNDECIDED else certify_exactly(model, loop)


def _close_or_unstable(
    model: NetworkModel,
    least: float,
    loop: LoopWeights,
    progress: Progress | None,
    exact: NetworkCertificate | None,
    close_by: Hidden,
) -> NetworkCertificate:
    """A growing direction, in integers as soon as the margin is seen to be near; `exact` if they have been tried."""
    if exact is not None or not close_by.ended:
        found = unstable(model, least, loop, progress, close_by if exact is None else None)
        if found.status is not Status.UNDECIDED or exact is not None:
            return found if exact is None or found.status is not Status.UNDECIDED else exact
    found = certify_exactly(model, loop, growing=True)
    if found.status is Status.UNDECIDED and close_by.ended:
        return unstable(model, least, loop, progress)
    return found


def _faster(found: NetworkCertificate, v: Floats, system: PortSystem) -> NetworkCertificate:
    """The certificate, or one of a larger rate where the margin is near: the best if a time limit ends the search."""
    model = found.model
    with suppress(OutOfBudgetError):
        for ahead in evener(system, v, found.decay_rate):
            data = supply_rates(model, ahead)
            rate = provable_rate(model, Matrix(ahead), Matrix(data[2]), discrete=model.discrete)
            before = found.decay_rate
            if rate > before:
                found = settle(model, data, found.loop) or found
            if not found.decay_rate > _GAIN * before:
                break
    return found


@np.errstate(all="ignore")
def at_rate(found: NetworkCertificate, rate: Fraction) -> NetworkCertificate:
    """The certificate of a network that is proven, claiming this decay rate too; UNDECIDED if that is not proven."""
    model = found.model
    faster = candidates(model, float(model.discrete - rate))
    drafts = (settle(model, data, found.loop, rate) for data in faster)
    same = NetworkCertificate.settle(**found.data() | {"required_rate": rate})
    return same or next(filter(bool, drafts), None) or certify_exactly(model, found.loop, rate)


def settle(model: NetworkModel, data: Data, loop: LoopWeights, required: Fraction | None = None) -> NetworkCertificate:
    """The certificate for v, r, q with the decay rate they prove, and one that is required, and sigma = 1."""
    v, r, q = map(Matrix, data)
    rate, sigma = max(provable_rate(model, v, q, discrete=model.discrete), 0.0), np.ones(model.n_nodes)
    rates = {"decay_rate": rate, "required_rate": required}
    return NetworkCertificate.settle(model=model, v=v, r=r, q=q, sigma=sigma, loop_weights=loop, **rates)


def candidates(
    model: NetworkModel, shift: float, close_by: Hidden | None = None, system: PortSystem | None = None
) -> Iterator[Data]:
    """Theorem-4 data from solves at the shift: first with uniform c, then with c close to v itself.

    They end where `close_by` sees the margin.  `system` is the one to solve, if there is one already.
    """
    system = PortSystem(model, shift) if system is None else system
    if not system.is_finite:
        return
    c = interior(model, dual=True)
    for tolerance in (1e-7, 1e-11, 1e-13):
        v, _, reached = system.dual(c, tolerance)
        inside = np.isfinite(v).all() and is_inside(model, v, dual=True)
        if inside and is_inside(model, reached, dual=True):
            yield supply_rates(model, v)
        elif (close_by is not None and close_by.bounded(model, v, reached)) or not inside:
            return
        # inverse iteration evens out the relative margins where v spans many orders of magnitude
        c = mix(model, v, 0.0, dual=True)


def supply_rates(model: NetworkModel, v: Floats) -> Data:
    """v, r >= B'v - D'q and q <= -W'r in the orders of U* and Y*, by a few units in the last place."""
    r = moved(model, "U", [("B", v)], dual=True)
    if not model.has_feedthrough:
        return v, r, lower_outputs(model, r)
    r, q = direct_loop(model).solve(r, True, 1e-15), np.zeros(0)
    for _ in range(60):
        before, q = r, lower_outputs(model, r)
        r = moved(model, "U", [("B", v), ("D", -q)], dual=True)
        if (np.abs(r - before) <= 4 * HALF_ULP * np.abs(r)).all():
            break
    return v, r, q


@np.errstate(all="ignore")
def provable_rate(model: NetworkModel, v: Matrix, q: Matrix, *, discrete: bool) -> float:
    """min over nodes and generators of -(v'A - q'C)x / v'x, less the error bound of the kernel; may be negative."""
    rate = np.inf
    for s, v_g, q_g in zip(model.stacks, model.split(v, 0), model.split(q, 2), strict=True):
        room, rays = 16 * (2 * (s.sizes[0] + s.sizes[2]) + 24) * HALF_ULP, s.rays[0].values
        for part, forms in on.decrease_forms(s, v_g, q_g, 0.0, discrete).pieces():
            value, gross = (f(v_g.values[part]) @ f(rays).T for f in (np.asarray, np.abs))
            first = (-forms.values - room * forms.magnitudes)[:, 0] / value
            # the rate term adds rate * |v|'|x| to the size of the numbers
            rate = min(rate, float((first - room * np.abs(first) * gross / value).min(initial=np.inf)))
    return rate if np.isfinite(rate) else 0.0


def violation(model: NetworkModel) -> NetworkCertificate | None:
    """The certificate refuted by a node that is not positive or a link that leaves the cones, if there is one."""
    known = {condition.name: condition for condition in positive_parts(model)}
    for g in range(len(model.stacks)):
        for condition in on.positivity(model, g):
            place = known[condition.name].worst_violation()
            if place is not None:
                return refuted_node(model, int(model.members[g][place[0]]))
    link = broken_link(model, known)
    return None if link is None else NetworkCertificate.settle(model=model, witness=link)


def broken_link(model: NetworkModel, known: Mapping[str, Condition]) -> CouplingViolation | None:
    """A link that leaves the cones; conditions that are known by name are not evaluated again."""
    for condition, pair in on.coupling_by_pairs(model):
        place = known.get(condition.name, condition).worst_violation()
        if place is not None:
            return _coupling_witness(model, pair, place)
    return None


def refuted_node(model: NetworkModel, node: int) -> NetworkCertificate:
    """The certificate refuted by the worst violation inside a node."""
    part = settle_positivity(**model.data_of(node))
    return NetworkCertificate.settle(model=model, witness=NodeViolation(node, part.witness))


def _coupling_witness(
    model: NetworkModel, pair: tuple[Index, Index] | None, place: tuple[int, ...]
) -> CouplingViolation:
    if pair is None:  # an entry of W
        entry = place[0]
        row = int(np.searchsorted(model.W.indptr, entry, side="right")) - 1
        column = int(model.W.indices[entry])
        j, k = int(model.receivers.owners[row]), int(model.owners(2)[column])
        return coupling_violation(model, j, k, row - int(model.receivers.starts[j]), column - int(model.offsets[2][k]))
    j, k = int(pair[0][place[0]]), int(pair[1][place[0]])
    return coupling_violation(model, j, k, place[1], place[2])


def loop_weights(model: NetworkModel) -> LoopWeights:
    """p and t that prove rho(W D) < 1, or None (also if there is no feedthrough)."""
    if not model.has_feedthrough:
        return None
    e = model.at_all([s.Y.dual.interior_point for s in model.stacks], 2)
    with np.errstate(all="ignore"):
        p = e + model.WT @ direct_loop(model).solve(model.times("D", e, transposed=True), True, 1e-13)
        t = moved(model, "U", [("D", p)], dual=True)
    if not (np.isfinite(p).all() and np.isfinite(t).all()):
        return None
    weights = Matrix(p), Matrix(t)
    return weights if all(c.verdict() is True for c in on.loop_gain(model, *weights)) else None


def algebraic_witness(model: NetworkModel) -> AlgebraicLoop | None:
    """y in Y with D W y - y in Y, by power iteration on the feedthrough loop."""
    y = model.at_all([s.Y.interior_point for s in model.stacks], 2)
    D = model.block_matrices[3]
    shift = 1e-3
    for step in range(2000):
        require_time()
        ahead = D @ (model.W @ y)
        size = float(np.abs(ahead).max())
        if not np.isfinite(size) or size == 0:
            return None
        if step % 20 == 19:
            kept = _growing_outputs(model, D, y)
            if kept is not None:
                u = lower_received(model, kept)
                return AlgebraicLoop(kept, u, nodes_in_loop(model, Matrix(kept)))
        y = (ahead / size + shift * y) if step < 1500 else ahead / size
        y /= np.abs(y).max()
    return None


def _growing_outputs(model: NetworkModel, D: sp.csr_array, y: Floats) -> Floats | None:
    y = np.where(np.abs(y) > 1e-12, y, 0.0)
    for _ in range(100):
        if not np.any(y):
            return None
        ahead = D @ lower_received(model, y) - y
        good = np.ones(model.n_nodes, dtype=bool)
        for s, index, z, part in zip(
            model.stacks, model.members, model.split(ahead, 2), model.split(y, 2), strict=True
        ):
            good[index] = (z @ s.Y.facets.T >= 0).all(axis=1) | ~part.any(axis=1)
        if good.all():
            return y
        y = np.where(good[model.owners(2)], y, 0.0)
    return None


def growth_witness(model: NetworkModel, x: Floats, rate: float) -> NetworkInstability:
    """x with lower bounds on its inputs and outputs."""
    u = y = np.zeros(model.totals[1])
    for _ in range(60 if model.has_feedthrough else 1):
        y = moved(model, "Y", [("C", x), ("D", u)], dual=False)
        u = lower_received(model, y)
    return NetworkInstability(x, u, y, rate)


def unstable(
    model: NetworkModel, least: float, loop: LoopWeights, progress: Progress | None, close_by: Hidden | None = None
) -> NetworkCertificate:
    """The certificate refuted by a growing direction, or UNDECIDED; PROVED if the descent ends below the margin.

    `close_by` ends the descent early.
    """
    parts = strong_parts(model)
    inner = model if parts is None else parts.inner

    close = _CLOSE * rate_scale(model)

    missed: list[float] = []

    def attempt(a: Approach) -> NetworkInstability | None:
        if not a.theta > least:
            return None
        near = a.shift - a.theta < 0.5 * (a.theta - least)
        tries = [
            (growing_part(inner, a.x / np.abs(a.x).max(), rate, 20), rate) for rate in (0.5 * (a.theta + least), least)
        ]
        slow = None
        if near and tries[-1][0] is None:
            missed.append(a.theta)
            relative = 0.1 * (a.theta - least) / abs(a.theta)
            slow = slow_state(model, a, relative) if parts is None else parts.slow_state(a, relative)
        for x, rate in tries if slow is None else [slow]:
            if x is not None and rate >= least:
                w = growth_witness(model, x, rate)
                found = below_abscissa(model, w, loop)
                if found is not None and all(c.verdict() is True for c in found):
                    return w
        return None

    done: list[NetworkInstability] = []

    def stop(a: Approach) -> bool:
        w = attempt(a)
        done.extend([] if w is None else [w])
        return bool(done) or a.shift < least + close or len(missed) > _MISSES or (close_by is not None and close_by(a))

    final = descend(inner, least, relative=1e-10, stop=stop, progress=progress)
    if final is not None and final.shift < least:
        v = final.v if parts is None else parts.joined(final.v, final.c)
        certificate = None if v is None else settle(model, supply_rates(model, v), loop)
        if certificate is not None and certificate.status is Status.PROVED:
            return certificate
    witness = done[0] if done else None
    return NetworkCertificate.settle(model=model, loop_weights=loop, witness=witness)
