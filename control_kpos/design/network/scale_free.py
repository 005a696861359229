"""One gain for any number of nodes on any graph: scale-free design (section V.B of the paper, where w = 1).

Nodes x' = A x + B(F x + u), y = C x with one input and one output, u_j = sum_k W_jk y_k, W >= 0.  If A + B F keeps X
invariant, B is in X, C in X* and A + B F + w B C is stable, the network is positive and stable for every number
of nodes and every W whose column sums (or row sums) are at most w: with v'(A + B F + w B C)x < 0 on X, the sum of
v'x_j decreases, as sum_j W_jk v'B C x_k <= w v'B C x_k; row sums go through a vector in X instead.  For
different nodes (A_s, B_s, C_s) on one cone, a common x in X with (A_s + B_s F)x + w B_s c < 0 for c = max_s C_s x
covers row sums at most w.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any, Literal

from numpy.typing import ArrayLike

from ...cones import Cone, orthant
from ...errors import DataError, ShapeError
from ...exact.intake import exact_number
from ...exact.matrix import Matrix
from ...networks.any_size import out_weight_certificate
from ...progress import Target
from ...systems.statespace import ConeStateSpace
from ...theorems.stability import LyapunovCertificate
from ..accept import beyond_feedback, proven_rate, undecided
from ..feedback import read_rate
from ..plant import Plant, read_plant, require_simplicial
from ..result import LARGEST_RATE, DesignResult, changed
from ..running import Programs, SolverChoice, within
from ..simplicial.search import design_on_simplicial


def scale_free_feedback(
    sys: Any,
    weight: float = 1.0,
    *,
    X: Cone | ArrayLike | None = None,
    rate: float | Literal["max"] = 0.0,
    gain_bound: ArrayLike | None = None,
    structure: ArrayLike | None = None,
    solver: SolverChoice = None,
    time_limit: float | None = None,
    progress: Target = None,
) -> DesignResult:
    """Find one F that certifies every network of such nodes with link weights summing to at most `weight`.

    Parameters
    ----------
    sys : ConeStateSpace or control.StateSpace
        The node: one input, one output, D = 0, B in X and C in X*, X simplicial.
    weight : float
        Bound on the sum of the weights of the links out of each node (or into each node).
    X, rate, gain_bound, structure, solver, time_limit, progress
        As in `state_feedback`; `rate` is that of the whole network, whatever its size.

    Returns
    -------
    DesignResult
        `closed_loop` is the node A + B F; `certificate` an `OutWeightCertificate`.  REFUTED means that no F does this
        for every such network: for links of total weight `weight`, A + B F + weight * B C must be stable.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError, SolverError
        As in `state_feedback`; a node with several inputs or outputs, or with feedthrough.

    Notes
    -----
    The cost is that of one node.  By the sum of v'x_j for out-weights, by a common vector in X for in-weights.

    Examples
    --------
    >>> import control_kpos as kp, numpy as np
    >>> node = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])
    >>> d = kp.scale_free_feedback(node, weight=1)
    >>> ring = kp.feedback_interconnect([d.closed_loop] * 100, np.roll(np.eye(100), 1, axis=1))
    >>> bool(d), bool(ring.certificate)
    (True, True)
    """
    target, value = read_rate(rate), exact_number(weight, "weight", nonnegative=True)

    def design(lp: Programs) -> DesignResult:
        return _design(read_plant(sys, X, gain_bound=gain_bound, structure=structure), value, target, lp)

    return within(time_limit, design, solver=solver, progress=progress)


def _design(plant: Plant, weight: Fraction, target: Any, lp: Programs) -> DesignResult:
    system = plant.system
    _, m, q = system.sizes
    if (m, q) != (1, 1):
        raise ShapeError(f"scale-free design takes one input and one output; the node has {m} and {q}.")
    if not system.D.is_zero:
        raise DataError("scale-free design needs D = 0.")
    require_simplicial(plant.X, "scale-free design")
    message = "B must lie in X and C in X*, which no feedback changes; choose another cone."
    blocked = beyond_feedback(plant, message, C=system.C, D=system.D, U=orthant(1), Y=orthant(1))
    if blocked is not None:
        return blocked
    product = weight * (system.B.fractions() @ system.C.fractions())
    plant = replace(plant, coupling=Matrix.from_fractions(product))
    result = design_on_simplicial(plant, target, lp)
    if not result:
        return result
    proof = result.certificate
    coupled = [c for c in (proof.parts() if proof is not None else ()) if isinstance(c, LyapunovCertificate)][-1]
    closed = ConeStateSpace(result.closed_loop, X=plant.X, U=orthant(1), Y=orthant(1))
    certificate = out_weight_certificate(closed, weight, coupled)
    if not certificate:
        return undecided("a gain was found, but the scale-free claim could not be proven.")
    rate = proven_rate(certificate, result.weakened_rate)  # not that of the node alone
    value = rate if result.objective == LARGEST_RATE else result.value
    return changed(result, certificate=certificate, decay_rate=rate, value=value)
