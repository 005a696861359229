"""Why a network has no local gains: a node that no gain helps, or a proof about the whole network.

The network is one system on the product of the cones, with B W C as coupling and a block diagonal F.  That product is
simplicial, so the linear program is necessary as well as sufficient, and `obstruction` proves in rational arithmetic
that it has no solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cards import raised
from ...cones import product
from ...exact.budget import OutOfBudgetError, affords, budget
from ...exact.matrix import Matrix, dense
from ...networks.certificate import NetworkCertificate
from ...networks.certify import violation
from ...networks.model import NetworkModel
from ...proof.certificate import Status
from ...systems.system import System
from ...theorems.decay_rates import Rate
from ..accept import undecided
from ..contradiction import NoFeedback
from ..plant import Plant, read_plant
from ..refusal import decide
from ..result import DesignResult, Nearest
from ..running import EFFORT, Programs
from ..simplicial.program import Failure
from ..simplicial.search import BELOW, design_on_simplicial
from .program import NetworkProgram, Task

Floats = NDArray[np.float64]

_NODES_TRIED = 50
# States up to which the whole network is refuted in rational arithmetic.
_STATES = 60
_ALONE = "even without links to other nodes"


def explain_failure(task: Task, program: NetworkProgram) -> DesignResult:
    """REFUTED with a proof, or UNDECIDED; with what is possible instead, as far as that is found."""
    blocked = _blocking_node(task)
    if blocked is not None and blocked.certificate.rate == 0:  # type: ignore[union-attr]
        return blocked
    nearest = _nearest(task, program)
    if blocked is not None:
        return replace(blocked, nearest=nearest)
    proof = _no_local_gains(task)
    if proof is not None:
        message = "the demands on the network as a whole exclude each other."
        return DesignResult(status=Status.REFUTED, certificate=proof, message=message, nearest=nearest)
    lead = "no common gain was found" if task.uniform else "the linear program has no solution"
    failure = program.start(task.rate)
    reason = failure.reason if isinstance(failure, Failure) else "but for other margins"
    return undecided(f"{lead} ({reason}).", nearest=nearest)


def beyond_gains(model: NetworkModel) -> DesignResult | None:
    """REFUTED if a link, or an input or output of a node, leaves the cones: no local gain changes those."""
    still = [replace(s, A=Matrix(-np.broadcast_to(np.eye(s.sizes[0]), s.A.shape))) for s in model.stacks]
    if model.discrete:
        still = [replace(s, A=Matrix(np.zeros(s.A.shape))) for s in model.stacks]
    found = violation(replace(model, stacks=tuple(still)))
    if found is None:
        return None
    proof = NetworkCertificate.settle(model=model, witness=found.witness)
    message = "local gains change neither the links nor the input and output matrices of nodes."
    return DesignResult(status=proof.status, certificate=proof, message=message)


def _nearest(task: Task, program: NetworkProgram) -> Nearest | None:
    with suppress(OutOfBudgetError):
        if task.rate > 0:
            start = program.start(0.0)
            if not isinstance(start, Failure):
                return Nearest(decay_rate=program.largest_rate(start)[1])
        if task.bound is not None:
            free = NetworkProgram(task, bounded=False)
            start = free.start(task.rate)
            if not isinstance(start, Failure):
                return Nearest(gain_bound=free.smallest_gain(task.rate, start)[1])
    return None


def _blocking_node(task: Task) -> DesignResult | None:
    """A node that cannot be made positive and stable, or as fast, without links to others: then no network with it can.

    Links between nodes only add to A + B F, in the order of X, and so never speed up the decay.
    """
    model, rate, lp = task.model, task.rate, task.lp
    within = " within its gain_bound" if task.bound is not None else ""
    seen: set[tuple[Any, Any, int]] = set()
    bounds = None if task.bound is None else model.split(task.bound, 1)
    for g, (s, index) in enumerate(zip(model.stacks, model.members, strict=True)):
        for place, j in enumerate(index.tolist()):
            if not affords():
                return None
            key = (_numbers(s.A[place]), _numbers(s.B[place]), id(s.X))
            if key in seen:
                continue
            seen.add(key)
            if len(seen) > _NODES_TRIED:
                return None
            lp.stage(f"{model.name_of(j)} alone")
            node = System(s.A[place], s.B[place], s.C[place], s.D[place], s.X, s.U, s.Y, s.dt)
            plant = read_plant(node, None, gain_bound=None if bounds is None else bounds[g][place])
            result = _alone(plant, rate, lp)
            if result is None:
                continue
            slow, name = _alone(plant, 0.0, lp) if rate > 0 else result, model.name_of(j)
            if slow is not None:
                return replace(slow, message=f"{name} cannot be made positive and stable{within}, {_ALONE}.")
            return replace(result, message=f"{name} cannot have a decay rate of {raised(rate)}{within}, {_ALONE}.")
    return None


def _numbers(M: Matrix) -> Any:
    """What two equal matrices have in common."""
    return np.asarray(M.values).tobytes() if M.is_double else str(M.fractions().tolist())


def _alone(plant: Plant, rate: Rate, lp: Programs) -> DesignResult | None:
    """The proof that there is no gain, if it takes little effort."""
    with suppress(OutOfBudgetError), budget(EFFORT["a node of a network alone"]):
        result = design_on_simplicial(plant, rate, lp.on_highs())
        return result if result.status is Status.REFUTED else None
    return None


def _no_local_gains(task: Task) -> NoFeedback | None:
    """The proof, if the network is small and effort is left; also for one gain for all, which is a special case."""
    if task.model.totals[0] > _STATES or not affords():
        return None
    task.lp.stage("deciding in exact arithmetic")
    plant = whole_network(task)
    with suppress(OutOfBudgetError), budget(EFFORT["refusal of a whole network"]):
        return decide(plant, task.rate * BELOW)[0]
    return None


def whole_network(task: Task) -> Plant:
    """The network as one plant: A and B block diagonal, B W C as coupling, a block diagonal pattern for F."""
    model = task.model
    factors: list[Any] = [None] * model.n_nodes
    blocks: list[Any] = [None] * model.n_nodes
    for s, index in zip(model.stacks, model.members, strict=True):
        data = [M.fractions() for M in (s.A, s.B, s.C)]
        for place, j in enumerate(index.tolist()):
            factors[j], blocks[j] = s.X, [M[place] for M in data]
    A, B, C = (_block_diagonal(parts) for parts in zip(*blocks, strict=True))
    W = model.coupling
    links = (Matrix(dense(W.values)) if W.is_double else W).fractions()
    pair = Matrix.from_fractions(A), Matrix.from_fractions(B)
    return Plant(
        System.read(pair, X=product(factors), dt=model.discrete),
        (pair,),
        gain_bound=task.bound,
        pattern=_block_diagonal([np.ones(b.T.shape, dtype=int) for _, b, _ in blocks]).astype(bool),
        coupling=Matrix.from_fractions(B @ links @ C),
    )


def _block_diagonal(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The blocks along the diagonal, zeros elsewhere, in any kind of numbers."""
    rows, columns = (np.cumsum([0, *(part.shape[axis] for part in parts)]) for axis in (0, 1))
    out = np.full((rows[-1], columns[-1]), 0, dtype=object)
    for part, i, k in zip(parts, rows, columns, strict=False):
        out[i : i + part.shape[0], k : k + part.shape[1]] = part
    return out
