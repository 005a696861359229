"""`OptimalFeedback`: what `optimal_feedback` returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...networks.network import ConeNetwork
from ...proof.answer import Answer
from ...systems.statespace import ConeStateSpace
from .problem import Floats


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalFeedback(Answer):
    """Outcome of `optimal_feedback`.  `bool(answer)` is True only for PROVED.

    Attributes
    ----------
    F : ndarray or csr_array, shape (m, n), or None
        u = F x: a row is minus or plus its limit, or 0.  With `controls` mu = F x, and u = controls mu.  Sparse for
        networks with sparse limits, or of more than 300 states.  With `horizon` one gain for every step: an array of
        shape (N, m, n), or a tuple of sparse ones.
    cost : ndarray, shape (n,), or None
        p of the optimal cost p'x, as computed; `cost_bounds` has what is proven.  With `horizon` that of all N steps;
        `certificate` has those of the steps from every k on.
    cost_bounds : tuple of ndarray, shapes (n,), or None
        Proven: lower'x <= optimal cost from x <= cost of F <= upper'x, for every x in X.
    closed_loop : ConeStateSpace or ConeNetwork or None
        From further inputs to y, with A + B F exact.  If F is sparse, a network again: the same nodes, every state an
        input and an output, the links of A + B F, in doubles.  With `horizon` F is the first gain: what a receding
        horizon applies in every step.
    iterations : int
        Linear systems solved; none with `horizon`.
    """

    F: Any = None
    cost: Floats | None = None
    cost_bounds: tuple[Floats, Floats] | None = None
    closed_loop: ConeStateSpace | ConeNetwork | None = None
    iterations: int = 0

    @property
    def K(self) -> Any:
        """-F, for u = -K x as python-control writes it."""
        if isinstance(self.F, tuple):
            return tuple(-F for F in self.F)
        return None if self.F is None else -self.F

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        return [("policies tried", str(self.iterations))] if self.iterations else []
