"""Local feedback for the nodes of a network, so that the whole network is certified (section V.B of the paper)."""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ...cards import floored
from ...errors import (
    ActuatorLossWarning,
    DataError,
    NotProperConeError,
    ShapeError,
)
from ...exact.budget import OutOfBudgetError, affords, reason, spend
from ...exact.intake import flag, items, real_number
from ...exact.matrix import Matrix
from ...exact.rounding import HALF_ULP
from ...networks.certificate import NetworkCertificate, node_vectors
from ...networks.certify import at_rate
from ...networks.conditions import decrease_forms
from ...networks.coupling import read_coupling
from ...networks.model import NetworkModel, gather
from ...networks.network import ConeNetwork
from ...networks.nodes import NodeStack
from ...networks.own_links import own_links_closed
from ...progress import Target
from ...proof.answer import first_proven
from ...proof.certificate import Status
from ...systems.statespace import ConeStateSpace
from ...theorems.decay_rates import Rate
from ..accept import proven_rate, undecided
from ..actuator_loss import Demand, least_fractions, lifted
from ..feedback import read_rate
from ..limits import REACHED
from ..plant import closed_loop, read_bound
from ..result import ONE_GAIN, DesignResult, percent
from ..running import Programs, SolverChoice, within
from ..simplicial.program import Failure
from .lower_limit import network_limit
from .program import MARGINS, Geometry, NetworkProgram, Task
from .refusal import beyond_gains, explain_failure

Floats = NDArray[np.float64]

NETWORK_GAIN = "smallest gain max |F_j x_k| over all nodes and generators (leading entries 1)"
_NO_POINT = "the linear program has no solution."
BOUNDED = "largest |F_j x_k| relative to its bound"
# Entries of the closed loop up to which A + B F is formed in rational arithmetic.
_EXACT_ENTRIES = 20_000
_DIGITS = (4, 6, 9, 12)
# Operations of a proof, for each entry of A.
_EFFORT_PER_ENTRY = 2e3
# Margins that are tried at a gain within the gap, relative to the nodes and to the gap.
_WIDE = (2.0, 0.6, 0.2, 0.02)
# Bounds on gains are numbers of a linear program.
_LARGEST_BOUND = 1e100


def network_feedback(
    systems: Any,
    coupling: Any,
    *,
    uniform: bool = False,
    rate: float = 0.0,
    gain_bound: ArrayLike | None = None,
    gap: float = 1e-3,
    solver: SolverChoice = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> DesignResult:
    """Find local gains u_j = F_j x_j + sum_k W_jk y_k + w_j for which the network is positive and stable.

    Parameters
    ----------
    systems : sequence of ConeStateSpace, or result of `stack`
        Nodes with simplicial state cones, B_j U_j inside X_j, C_j X_j inside Y_j and D_j = 0.
    coupling : as in `feedback_interconnect`
    uniform : bool
        True: one F for all nodes, which must have equal sizes and one cone.  Found with one vector for all nodes,
        a sufficient condition.
    rate : float
        Decay rate of the network.  A rate such as "1/3" is proven as it is written; equality will do.
    gain_bound : float, array_like, shape (sum m_j,), optional
        |F_j x_k| <= gain_bound at every generator of X_j, its leading entry scaled to 1 as in `state_feedback`.  0 at
        inputs that no local gain is to use.
        With a bound one program is solved, for gains that are small beside it; without, several, for the smallest bound
        that is possible.
    gap : float
        Without a bound: the largest |F_j x_k| may exceed the smallest one that is possible by this part of it; what is
        won goes into margins.
    solver, time_limit, progress
        As in `state_feedback`.

    Returns
    -------
    DesignResult
        `F` of shape (N, m, n) (a tuple of arrays if nodes differ in size; shape (m, n) if uniform), `closed_loop` a
        network as from `feedback_interconnect`, `certificate` its Theorem-4 certificate, `certified_fraction` of
        shape (N,) for all nodes weakened at once.  REFUTED, with a certificate, if a node alone cannot meet the
        demands, or if a network of up to 60 states cannot.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError, TimebaseError, SolverError
        Arguments that do not fit together; a node with feedthrough or a state cone that is not simplicial.

    Warns
    -----
    ActuatorLossWarning
        If weakening a local gain breaks invariance of its node, so that a failing actuator takes the guarantees of the
        whole network with it; with the smallest fraction of the gain that is still certified, and the node.

    Notes
    -----
    One sparse program with n + n m variables and about n^2 + n m rows per node.  Up to 5000 nodes or so A + B F
    is formed exactly; beyond, the certificate is about the doubles of A + B F, and a note says whether the margins
    also cover the rounding of that sum.

    `limit` is proven for networks of any size, by duality: a vector d in X* and weights of facets at every generator
    say that no local gains within it are fast enough.  They are found by policy iteration when `limit` is first read,
    and checked by the kernel: in a tenth to a fifth of the time of the design at 100 nodes of two states, in 5 % or
    less from 1000 on and 2 % or less at 10 000.
    With `uniform` it is about gains with one vector x for all nodes.  With `gain_bound` nothing is minimised, and
    `limit` is NaN.

    Examples
    --------
    >>> import control_kpos as kp, numpy as np
    >>> tanks = kp.ConeStateSpace([[-1, 1], [1, -1]], [[0], [1]], [[1, 0]], 0)
    >>> ring = np.roll(np.eye(5), 1, axis=1)
    >>> d = kp.network_feedback([tanks] * 5, ring, rate=0.5)
    >>> bool(d), d.F.shape, d.decay_rate >= 0.5
    (True, (5, 1, 2), True)
    """
    uniform = flag(uniform, "uniform")
    target = read_rate(rate)
    if target == "max":
        raise DataError('rate must be a number for a network; "max" is for single systems.')

    spare = real_number(gap, "gap", positive=True)

    def design(lp: Programs) -> DesignResult:
        single = isinstance(systems, (NodeStack, ConeStateSpace))
        given = [systems] if single else items(systems, "systems")
        stacks, members, dt = gather(given)
        empty = NetworkModel(stacks, members, Matrix(sp.csr_array((0, 0))), 0 if dt is None else dt)
        model = empty.with_coupling(read_coupling(coupling, empty))
        _require_nodes(model, uniform)
        model = own_links_closed(model) or model  # A + B F + B W_jj C is what gains act on
        return _designed(Task(model, _read_bound(gain_bound, model), uniform, target, lp, spare))

    result = within(time_limit, design, "network", solver=solver, progress=progress)
    if result.alarm:
        warnings.warn(result.alarm, ActuatorLossWarning, stacklevel=2)
    return result


def _designed(task: Task) -> DesignResult:
    task.lp.stage(f"{task.model.n_nodes} nodes")
    # the wider the margins of invariance, the weaker the actuators may become; without a bound the gain comes first
    margins = MARGINS if task.bound is not None else MARGINS[:0:-1]
    result = undecided(f"{reason()} was reached before gains were found.")
    # last, gains for a rate that no gain exceeds: without margins, from a program that asks for a little less
    edge = (0.0,) if task.rate > 0 else ()
    for result in (_design(task, NetworkProgram(task, margin)) for margin in (*margins, *edge) if affords()):
        if result:
            return result
    refused = beyond_gains(task.model) if affords(_effort(task.model)) else None
    if refused is not None or result.message != _NO_POINT:
        return result if refused is None else refused
    return explain_failure(task, NetworkProgram(task))


def _effort(model: NetworkModel) -> float:
    """Operations that one proof takes, about."""
    return sum(s.A.values.size * (1 + s.sizes[1] / 10) for s in model.stacks) * _EFFORT_PER_ENTRY


def _require_nodes(model: NetworkModel, uniform: bool) -> None:
    if model.has_feedthrough:
        raise DataError("some D is not zero; network feedback needs nodes without feedthrough.")
    for s, index in zip(model.stacks, model.members, strict=True):
        if s.sizes[1] == 0:
            raise ShapeError(f"{model.name_of(int(index[0]))} has no inputs.")
        if not s.X.is_simplicial:
            raise NotProperConeError(
                f"{model.name_of(int(index[0]))}: the state cone has {s.X.n_rays} generators in dimension {s.X.dim}; "
                "network feedback needs simplicial cones."
            )
    first = model.stacks[0]
    if uniform and any(s.sizes[:2] != first.sizes[:2] or s.X != first.X for s in model.stacks[1:]):
        raise ShapeError("uniform=True needs nodes with equal numbers of states and inputs, and one state cone.")


def _read_bound(bound: ArrayLike | None, model: NetworkModel) -> Floats | None:
    values = read_bound(bound, model.totals[1])
    if values is not None and (values > _LARGEST_BOUND).any():
        raise DataError(
            f"gain_bound is {values.max():g}, which is no bound; leave it out, or take at most {_LARGEST_BOUND:g}."
        )
    return values


def _design(task: Task, program: NetworkProgram) -> DesignResult:
    """Gains from one program, proven; UNDECIDED with the message _NO_POINT if the program has no solution."""
    points, limit = _points(task, program)
    if not points:
        return undecided(_NO_POINT)

    def prove(candidate: tuple[Floats, int]) -> DesignResult | None:
        x, digits = candidate
        spend(_effort(task.model))
        task.lp.stage(f"{task.model.n_nodes} nodes: proof with gains of {digits} digits")
        most = limit * (1 + REACHED * task.gap) if limit > 0 and digits < _DIGITS[-1] else np.inf
        return _certified(task, program, [round_to(F, digits) for F in program.gains(x)], limit, most)

    with suppress(OutOfBudgetError):
        found = first_proven(((x, digits) for x in points for digits in _DIGITS), prove)
        if found is not None:
            return found
    return undecided("gains were found, but the network they make could not be proven.")


def _points(task: Task, program: NetworkProgram) -> tuple[list[Floats], float]:
    """Points to be proven, and the smallest gain if it is asked for; without margins, those for an exact rate."""
    if not program.margin:
        return program.at_the_edge(task.rate, task.gap if task.bound is None else None)
    start = program.start(task.rate)
    if isinstance(start, Failure):
        return [], float("nan")
    if task.bound is not None:
        return [start], float("nan")
    slim, limit = program.smallest_gain(task.rate, start)
    return [p for p in (_roomy(task, limit), slim, start) if p is not None], limit


def _roomy(task: Task, limit: float) -> Floats | None:
    """A point with a little more gain than the smallest, and as wide margins as that allows."""
    with suppress(OutOfBudgetError):
        for part in _WIDE if limit > 0 else ():
            point = NetworkProgram(task, part * task.gap).start(task.rate, limit * (1 + task.gap / 2))
            if not isinstance(point, Failure):
                return point
    return None


def _certified(
    task: Task, program: NetworkProgram, gains: list[Floats], limit: float, most: float = np.inf
) -> DesignResult | None:
    model, parts = task.model, program.parts
    if task.uniform:
        gains = [np.broadcast_to(gains[0][:1], F.shape) for F in gains]
    used = [np.abs(F @ (g.rays / g.sizes[:, None]).T) for F, g in zip(gains, parts, strict=True)]
    if task.bound is not None:
        bounds = [b[:, :, None] for b in model.split(task.bound, 1)]
        if not all((u + _rounding(F, g) <= b).all() for u, F, g, b in zip(used, gains, parts, bounds, strict=True)):
            return None
        used = [np.divide(u, b, out=np.zeros_like(u), where=u > 0) for u, b in zip(used, bounds, strict=True)]
    value = max(float(u.max(initial=0.0)) for u in used)
    if value > most:
        return None
    given = model.origin or model
    closed, exact = _closed(given, gains)
    network = ConeNetwork(closed)
    certificate = network.certificate
    if not certificate:
        return None
    if certificate.decay_rate < task.rate:
        certificate = at_rate(certificate, Fraction(task.rate))
        if not certificate:
            return None
        network = ConeNetwork(closed, certificate=certificate)
    proven = given if certificate.model.origin is None else model
    fraction, fragile = node_fractions(proven, gains, certificate, task.rate)
    notes = [] if exact else [_rounding_note(program, gains, closed)]
    notes += _weakening(model, fraction, task.rate)
    return DesignResult(
        status=Status.PROVED,
        F=np.array(gains[0][0]) if task.uniform else by_node(model, gains),
        closed_loop=network,
        certificate=certificate,
        objective=BOUNDED if task.bound is not None else ONE_GAIN if task.uniform else NETWORK_GAIN,
        value=value,
        limit=network_limit(task, limit),
        decay_rate=proven_rate(certificate, task.rate),
        certified_fraction=fraction,
        weakened_rate=task.rate,
        notes=tuple(notes),
        alarm=loss_of_positivity(model, fraction, fragile),
    )


def _rounding(F: Floats, g: Geometry) -> Floats:
    """Bound on the rounding of |F x_k|, that of the generators included; none where x_k is a unit vector."""
    longest = np.abs(g.rays).max(axis=1) / g.sizes * (np.count_nonzero(g.rays, axis=1) > 1)
    return 4 * (F.shape[-1] + 8) * HALF_ULP * np.abs(F).sum(axis=-1)[..., None] * longest


def round_to(F: Floats, digits: int) -> Floats:
    """Each entry to so many significant decimal digits."""
    place = digits - 1 - np.floor(np.log10(np.abs(F)))
    place = np.clip(np.where(np.isfinite(place), place, 0), -300, 300)
    unit = 10.0 ** np.abs(place)
    return np.where(place >= 0, np.rint(F * unit) / unit, np.rint(F / unit) * unit)


def _closed(model: NetworkModel, gains: list[Floats]) -> tuple[NetworkModel, bool]:
    """The network of A + B F, exactly if it is not too large."""
    exact = sum(s.A.values.size for s in model.stacks) <= _EXACT_ENTRIES
    stacks = []
    for s, F in zip(model.stacks, gains, strict=True):
        if exact:
            loop = closed_loop(s.A, s.B, Matrix(np.ascontiguousarray(F)))
        else:
            loop = Matrix(np.asarray(s.A.values) + np.asarray(s.B.values) @ F)
        stacks.append(replace(s, A=loop))
    return replace(model, stacks=tuple(stacks)), exact


def _rounding_note(program: NetworkProgram, gains: list[Floats], closed: NetworkModel) -> str:
    """Whether the margins of invariance exceed what rounding A + B F can change."""
    safe = True
    for g, F, s in zip(program.parts, gains, closed.stacks, strict=True):
        A, B = np.abs(g.A), np.abs(g.B)
        moved = B.max(axis=2) > 0
        error = 4 * (F.shape[1] + 2) * HALF_ULP * (A + B @ np.abs(F)) * moved[:, :, None]
        change, M = np.abs(g.facets) @ error @ np.abs(g.rays.T), g.facets @ np.asarray(s.A.values) @ g.rays.T
        where = np.ones(M.shape[1:], dtype=bool) if closed.discrete else ~np.eye(M.shape[1], dtype=bool)
        safe &= bool((2 * change <= M)[:, where].all() or (change[:, where] == 0).all())
    return (
        "The certificate is about the doubles of A + B F; the margins of invariance cover the rounding of that sum."
        if safe
        else "The certificate is about the doubles of A + B F, which differ from the exact sum in the last place."
    )


def by_node(model: NetworkModel, gains: list[Floats]) -> Any:
    """The gains of all stacks as (N, m, n), or a tuple in the order of the nodes if these differ in size."""
    if len({F.shape[1:] for F in gains}) == 1:
        out = np.empty((model.n_nodes, *gains[0].shape[1:]))
        for index, F in zip(model.members, gains, strict=True):
            out[index] = F
        return out
    slots: list[Any] = [None] * model.n_nodes
    for index, F in zip(model.members, gains, strict=True):
        for j, f in zip(index.tolist(), F, strict=True):
            slots[j] = f
    return tuple(slots)


def node_fractions(
    model: NetworkModel, gains: list[Floats], certificate: NetworkCertificate, rate: Rate
) -> tuple[Floats, NDArray[np.bool_]]:
    """The fractions of the local gains that keep the network certified with this decay rate, proven for every node.

    All nodes may be weakened at once, every input on its own.  Second: nodes that leave their state cone for some
    weaker gain, which is proven as well.
    """
    v, _, q = node_vectors(certificate)
    certified, fragile = np.zeros(model.n_nodes), np.zeros(model.n_nodes, dtype=bool)
    for s, index, F, v_j, q_j in zip(
        model.stacks, model.members, gains, model.split(v, 0), model.split(q, 2), strict=True
    ):
        seen = lifted(s.rays[0].plain(), Matrix(np.array(F)).T)
        stays = Demand(s.X.exact_facets.plain(), s.A, s.B, seen, where=None if model.discrete else s.X.incidence)
        fall = decrease_forms(s, v_j, q_j, rate, model.discrete)
        pushed = Matrix.join([s.B, Matrix.zeros(1, fall.left.shape[-1] - s.sizes[0], s.sizes[1])], -2)
        falls = Demand(-fall.left, fall.middle, pushed, seen, strict=not rate)  # type: ignore[arg-type]
        shape = (len(index),)
        invariant, fragile[index] = least_fractions([stays], shape)
        certified[index] = np.maximum(invariant, least_fractions([falls], shape)[0])
    return certified, fragile


def _weakening(model: NetworkModel, fraction: Floats, rate: Rate) -> list[str]:
    """What is proven of local actuators that lose effect."""
    weakest = int(np.argmax(fraction))
    least, name = float(fraction[weakest]), model.name_of(weakest)
    slower = f"with a decay rate of at least {floored(rate)}" if rate else "with some decay rate"
    if least >= 1:
        return [f"Nothing is proven if actuators of {name} lose effect; see certified_fraction for each node."]
    if least <= 0:
        return [f"The network stays certified, {slower}, if local actuators lose any part of their effect, even all."]
    return [
        f"The network stays certified, {slower}, for local actuators at {percent(least)} % to 100 % of their effect, "
        f"each on its own; the most sensitive node is {name}, see certified_fraction for each."
    ]


def loss_of_positivity(model: NetworkModel, fraction: Floats, fragile: NDArray[np.bool_]) -> str:
    """What to warn of: of the nodes that leave their state cone with a weaker gain, the one that needs most of it."""
    if not fragile.any():
        return ""
    first = int(np.argmax(np.where(fragile, fraction, -1.0)))
    return (
        f"below {percent(fraction[first])} % of its local gain, {model.name_of(first)} is no longer certified to stay "
        "in its state cone, and then nothing is certified about the network; weakened gains break positivity at "
        f"{np.count_nonzero(fragile)} of {model.n_nodes} nodes (certified_fraction holds the limit of each)."
    )
