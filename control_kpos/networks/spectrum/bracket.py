"""A bracket of the spectral abscissa with both sides proven.

lambda <= mu if some v_j in int X_j*, r, q satisfy (v'A - mu v' - q'C)x <= 0, v'B - r' - q'D <= 0 on U and
q'y + r'W y <= 0 on Y; lambda >= mu if some x in X, x != 0, has A_cl x - mu x in X.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from ...cards import floored, raised
from ...errors import DataError, FalseClaimError
from ...exact.budget import OutOfBudgetError
from ...exact.condition import Condition
from ...exact.matrix import Matrix
from ...proof.certificate import Status
from ...proof.in_time import unfinished
from ...proof.weights import ProofOmittedError
from .. import conditions as on
from .. import files
from ..blocks import Floats
from ..certificate import ClaimOnNetwork, dissipation, node_vectors
from ..certify import (
    growth_witness,
    loop_weights,
    provable_rate,
    proven_by_parts,
    supply_rates,
)
from ..model import NetworkModel
from ..own_links import own_links_closed
from ..witnesses import (
    LoopWeights,
    NetworkInstability,
    below_abscissa,
    kept_parts,
)
from .descent import Hidden, Progress, apply_loop, descend, rate_scale, slow_state
from .leading_nodes import localised_peak
from .rational import bracket_exactly, sought
from .strong_parts import strong_parts

# States and inputs up to which refined Perron vectors are tried before shifts that fall to the abscissa.
_REFINED_FIRST = 6000
# What rounding may hide of a rate, as a part of those of the nodes.
_ROUNDING = 2.0**-50
# Widths by which the lower side is lowered where rounding blocks its proof.
_RETREATS = (0.0, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AbscissaCertificate(ClaimOnNetwork):
    """Proof that the spectral abscissa (discrete time: radius) of a positive network lies in [lower, upper].

    Attributes
    ----------
    model : NetworkModel
    lower, upper : float
    v, r, q : ndarray or tuple of ndarray, per node
        Prove the upper side.
    below : NetworkInstability
        x, u, y prove the lower side.
    loop_weights : tuple of two ndarrays, or None
    exact : tuple of three tuples of Fraction, or None
        Both as in `NetworkCertificate`.
    """

    claim: ClassVar[str] = "network abscissa"

    lower: float = -np.inf
    upper: float = np.inf
    below: NetworkInstability | None = None

    def conditions(self) -> Sequence[Condition]:
        if self.below is None:
            raise DataError("one side of the bracket is missing.")
        if self.below.rate != self.lower or not np.any(self.below.x):
            raise DataError("below does not belong to the lower end.")
        model = self.model
        v, r, q = node_vectors(self)
        lower = below_abscissa(model, self.below, self.loop)
        if lower is None:
            raise DataError("loop_weights are missing although some D is not zero.")
        upper = dissipation(model, v, r, q, -self.upper, discrete=False)
        return [*lower, *upper, on.balance(model, q, r, None)]

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> AbscissaCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        restored = super().restore(contents)
        if not restored and (restored.lower, restored.upper) != (-np.inf, np.inf):
            raise FalseClaimError("the ends of a bracket are stated without a proof.")
        return restored

    def evidence(self) -> dict[str, Any]:
        """Weights for positivity and the coupling, and those of the motion for the lower end."""
        if self.v is None or self.r is None or self.q is None:
            raise ProofOmittedError("no bracket is claimed")
        return files.evidence(self.model, self.below)

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and (self.v is None or self.below is None):
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def refutation(self) -> Sequence[Condition] | None:
        return None

    def explain(self) -> str:
        what = "radius" if self.model.discrete else "abscissa"
        if self:
            return f"Proved: the spectral {what} lies in [{floored(self.lower, 12)}, {raised(self.upper, 12)}]."
        if unfinished(self):
            return unfinished(self)
        return (
            f"Undecided: no bracket of the spectral {what} could be proven. If the network is not positive, its "
            "certificate says what breaks it; otherwise the bracket may be too narrow for rounding, and a larger width "
            "may help."
        )


@np.errstate(all="ignore")
def bracket(model: NetworkModel, relative: float = 1e-6, progress: Progress | None = None) -> AbscissaCertificate:
    """Find and prove a bracket of the spectral abscissa; see `ConeNetwork.spectral_abscissa`."""
    with kept_parts(model):
        if proven_by_parts(model):
            return _of_positive(model, relative, progress)
    closed = own_links_closed(model)
    if closed is not None:
        with kept_parts(closed):
            if proven_by_parts(closed):
                return _of_positive(closed, relative, progress)
    return AbscissaCertificate.settle(model=model)


def _of_positive(model: NetworkModel, relative: float, progress: Progress | None) -> AbscissaCertificate:
    """`bracket` for a network that is proven positive."""
    loop = loop_weights(model)
    small = sum(model.totals[:2]) <= _REFINED_FIRST
    best, about = AbscissaCertificate.settle(model=model), None
    for step in (_refined, _proven) if small else (_proven, _refined):
        try:
            found, about = step(model, relative, progress, loop, about)
        except OutOfBudgetError:
            if not best:
                raise
            break
        if found and not (best and best.upper - best.lower <= found.upper - found.lower):
            best = found
        if best and best.upper - best.lower <= 2 * sought(model, relative, best.upper):
            break
    return best


Found: TypeAlias = tuple[AbscissaCertificate, Callable[[], float] | None]


def _refined(
    model: NetworkModel,
    relative: float,
    progress: Progress | None,
    loop: LoopWeights,
    about: Callable[[], float] | None,
) -> Found:
    """Both sides from Perron vectors refined at the ends of the bracket."""
    exact = bracket_exactly(model, relative, loop, None if about is None else about())
    return AbscissaCertificate.settle(model=model, **(exact or {})), about


def _proven(model: NetworkModel, relative: float, progress: Progress | None, loop: LoopWeights, _: Any) -> Found:
    """What the descent finds, the lower side lowered until rounding leaves room for its proof, and an estimate."""
    with np.errstate(all="ignore"):  # candidates that overflow are not proven
        theta, sides = _both_sides(model, relative, progress, Hidden(_ROUNDING * rate_scale(model), relative=relative))
        if theta is not None:  # rounding leaves no room at all
            found, _ = _refined(model, relative, progress, loop, lambda: theta)
            if found:
                return found, None
            _, sides = _both_sides(model, relative, progress, None)
    found = AbscissaCertificate.settle(model=model)
    if sides is None:
        return found, None
    data, x, rate = sides
    v, r, q = map(Matrix, data)
    upper = -provable_rate(model, v, q, discrete=False)
    for retreat in _RETREATS:
        lower = rate - retreat * relative * abs(rate)
        found = AbscissaCertificate.settle(
            model=model,
            lower=lower,
            upper=upper,
            v=v,
            r=r,
            q=q,
            below=growth_witness(model, x, lower),
            loop_weights=loop,
        )
        if found:
            break
    # the quotient of both vectors is closer than the ends
    return found, lambda: float(v.values @ apply_loop(model, x)) / float(v.values @ x)


def _both_sides(
    model: NetworkModel, relative: float, progress: Progress | None, stop: Hidden | None
) -> tuple[float | None, tuple[tuple[Floats, Floats, Floats], Floats, float] | None]:
    """An estimate if `stop` ended the descent; else supply rates for the upper side, a state and rate for the lower."""
    start = 1.0 if model.discrete else 0.0
    parts = strong_parts(model)
    inner = model if parts is None else parts.inner
    peak = localised_peak(inner, start, relative, progress) if parts is None else None
    if peak is not None:
        return None, (supply_rates(model, peak.v), peak.x, peak.rate)
    found = descend(inner, start, relative=relative, stop=stop, progress=progress)
    if found is None:
        return None, None
    if stop is not None and stop.ended:
        return found.theta, None
    slow = slow_state(model, found, relative) if parts is None else parts.slow_state(found, relative)
    if slow is None:
        return None, None
    v = found.v if parts is None else parts.joined(found.v, found.c)
    return None, None if v is None else (supply_rates(model, v), *slow)
