"""L2 gains and stability margins of positive systems: the bounds of `structured_gain`, found and proven.

Let mu be the structured gain.  The loop of the system with u_b = Delta_b y_b, one causal uncertainty for each block,
is stable whenever their L2 gains are below 1 / mu, because of the small-gain theorem with the scalings d; and some
constant Delta >= 0 with gains of 1 / mu makes it unstable, or not well posed: Delta_b = a_b y_b' / |y_b|^2 has
Delta G(0) a >= a.  If every block has one input and one output, the same holds for L_p gains with any common p
in [1, inf], with delays that change in time for p = inf.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from control import StateSpace
from numpy.typing import NDArray

from ..cards import floored, raised
from ..errors import DataError, KposError, TooLargeError
from ..exact.condition import all_hold
from ..exact.intake import found
from ..proof.answer import Answer
from ..proof.certificate import Status
from ..proof.in_time import in_time, unfinished
from ..systems.system import System
from .blocks import Blocks
from .gain_candidates import DensePlant, Fields, from_above, from_below
from .positivity import PositivityCertificate, positivity_of
from .stability import lyapunov_on
from .structured_gain import StructuredGainCertificate, require_orthants
from .zero_gain import found_levels

Floats = NDArray[np.float64]
# States, inputs and outputs of systems whose matrices are dense.
_LARGEST = 5000


def structured_gain(sys: Any, structure: Any = "full", *, time_limit: float | None = None) -> StructuredGainCertificate:
    """Bound the L2 gain of a positive system, or its gain for blocks of uncertainty, from both sides with proof.

    Parameters
    ----------
    sys : ConeStateSpace, ConeNetwork or other control.StateSpace
        K-positive; its inputs and outputs lie in nonnegative orthants, its states in any polyhedral proper cone.
    structure : "full", "diagonal", list of int, or list of (inputs, outputs)
        "full": one block, so that the gain is the L2 gain, sigma_max(G(0)) (in discrete time G(1)).  Others: see
        `robust_margin`.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    StructuredGainCertificate
        PROVED with `lower` and `upper`; REFUTED with a witness if the system is not positive or not stable.

    Raises
    ------
    ConeMismatchError
        U or Y is no nonnegative orthant: the formula does not hold then.
    ShapeError, DataError
        There are no inputs or outputs, or `structure` does not describe blocks of them.
    TooLargeError
        More than 5000 states, inputs or outputs, and no network with "full" or "diagonal"; or a cone X with too many
        facets.

    Notes
    -----
    Costs a few factorisations of A and singular value decompositions of the dense G(0); up to 30 states equations are
    solved exactly.  With blocks also a convex minimisation with a variable for each block.  Networks of more than 300
    states are not made dense for "full" and "diagonal": some 10 sparse solves, a few seconds for 10^5 nodes on a ring.
    The bounds are then about the matrices of the closed loop in doubles, as those of `ConeNetwork.linear_lyapunov`.

    Examples
    --------
    >>> import control_kpos as kp
    >>> cert = kp.structured_gain(kp.ConeStateSpace([[-2, 1], [1, -3]], [[1, 0], [0, 1]], [[1, 0], [0, 1]], 0))
    >>> cert.status.name, round(cert.lower, 9), round((5 + 5**0.5) / 10, 9)
    ('PROVED', 0.723606798, 0.723606798)
    """
    if not isinstance(sys, (StateSpace, System)):
        raise DataError(f"sys is {found(sys)}; give a ConeStateSpace, or another control.StateSpace.")
    own = getattr(sys, "time_limit", None)  # of networks
    return in_time(
        own if time_limit is None else time_limit, lambda: _found(sys, structure), lambda: _nothing(sys, structure)
    )


def _found(sys: Any, structure: Any) -> StructuredGainCertificate:
    at_scale = getattr(sys, "_gain_at_scale", None)  # of networks
    found_at_scale = None if at_scale is None else at_scale(structure)
    if found_at_scale is not None:
        return found_at_scale
    system = System.read(sys)
    _require_moderate(system)
    return structured_gain_of(positivity_of(system), Blocks.read(structure, *system.sizes[1:]))


def _nothing(sys: Any, structure: Any) -> StructuredGainCertificate:
    """No bounds."""
    system = System.read(sys)
    return StructuredGainCertificate.settle(**_asked(positivity_of(system), Blocks.read(structure, *system.sizes[1:])))


def _asked(positivity: PositivityCertificate, blocks: Blocks) -> Fields:
    """What a certificate is about."""
    ins, outs = (tuple(members.tolist()) for members in (blocks.inputs, blocks.outputs))
    return {"positivity": positivity, "input_blocks": ins, "output_blocks": outs}


def _require_moderate(system: System) -> None:
    """Refuse what would take too large dense matrices."""
    if max(system.sizes) > _LARGEST:
        n, m, q = system.sizes
        raise TooLargeError(
            f"the gain of a system with {n} states, {m} inputs and {q} outputs takes dense matrices; the limit is "
            f"{_LARGEST} of each."
        )


@np.errstate(all="ignore")
def structured_gain_of(positivity: PositivityCertificate, blocks: Blocks) -> StructuredGainCertificate:
    """The bounds once positivity has been decided; see `structured_gain`."""
    p = positivity.system()
    require_orthants(p.U, p.Y)
    data = _asked(positivity, blocks)
    stable = lyapunov_on(positivity)
    if not stable:
        return StructuredGainCertificate.settle(**data, witness=stable.witness)
    nothing = without_gain(data, p, blocks, stable.v)
    if nothing is not None:
        return nothing
    plant = DensePlant.of(p, blocks)
    return between(data, p, from_above(plant), from_below(plant, plant.scaling.inputs))


def without_gain(data: Fields, p: System, blocks: Blocks, v: Floats) -> StructuredGainCertificate | None:
    """The certificate for a gain of exactly 0, or None.

    Parameters
    ----------
    data : dict
        Positivity and the blocks.
    p : System
    blocks : Blocks
    v : ndarray, shape (n,)
        A Lyapunov vector.
    """
    levels = found_levels(p, blocks)
    if levels is None:
        return None
    return StructuredGainCertificate.settle(**data, lower=0.0, upper=0.0, p=v, **levels) or None


def between(data: Fields, p: System, above: Any, below: Any) -> StructuredGainCertificate:
    """The certificate with the first bounds from above and from below that are proven.

    Parameters
    ----------
    data : dict
        Positivity and the blocks.
    p : System
    above, below : iterable of dict
        Fields of proofs, the best first.
    """
    upper = _first(data, above, p, "_from_above")
    if upper is None:
        return StructuredGainCertificate.settle(**data)
    lower = _first(data, below, p, "_from_below") or {"lower": 0.0}
    return StructuredGainCertificate.settle(**data, **upper, **lower)


def _first(data: Fields, candidates: Any, p: System, side: str) -> Fields | None:
    """The first fields whose conditions hold."""
    for fields in candidates:
        if not all(np.isfinite(value).all() for value in fields.values()):
            continue
        draft = StructuredGainCertificate(**data, **fields)
        if all_hold(getattr(draft, side)(p)):
            return fields
    return None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RobustMargin(Answer):
    """The stability margin of a positive system against uncertainties in blocks, u_b = Delta_b y_b.

    Attributes
    ----------
    lower : float
        Proven: the loop is stable for all causal Delta whose blocks have gains below `lower`, if it is well posed.
        inf: for all of finite gain, because the gain of the system is 0.
    upper : float
        Proven: some constant Delta >= 0 whose blocks have gains of at most `upper` makes the loop unstable, or not well
        posed.  inf: none is known.
    scaling : ndarray, shape (blocks,), or None
        Weights d of the blocks in the proof of `lower`.
    delta : ndarray, shape (m, q), or None
        Such a worst Delta, rounded; None if `upper` is inf, and for more than 5000 x 5000 signals, where its blocks are
        a_b y_b' / |y_b|^2 for the a and y of the certificate.
    certificate : StructuredGainCertificate
        `lower` is 1 / certificate.upper, rounded down, and `upper` 1 / certificate.lower, rounded up.
    """

    lower: float = 0.0
    upper: float = float("inf")
    scaling: Floats | None = None
    delta: Floats | None = None

    def facts(self) -> list[tuple[str, str]]:
        """The bounds of the margin."""
        return [("margin at least", floored(self.lower)), ("margin at most", raised(self.upper))]


def robust_margin(sys: Any, structure: Any = None, *, time_limit: float | None = None) -> RobustMargin:
    """The largest gain of uncertainties in feedback, u = Delta y, that a positive system tolerates.

    Blocks Delta_b map the outputs of a block to its inputs; they are causal and may be nonlinear and change in time.
    The system is K-positive with inputs and outputs in nonnegative orthants.

    Parameters
    ----------
    sys : ConeStateSpace, ConeNetwork or other control.StateSpace
    structure : None, "diagonal", "full", list of int, or list of (inputs, outputs)
        None or "diagonal": Delta is diagonal; the system has as many inputs as outputs, and the margin 1 / rho(G(0))
        holds for L_p gains with one p in [1, inf] for all.  "full": Delta is one block, and the margin of its L2 gain
        is 1 / sigma_max(G(0)).  [2, 1]: a block of the first two inputs and outputs, and one of the third.
        [([0, 1], [2]), ([2], [0, 1])]: the places of the inputs and outputs of every block, each in one.  The margin
        of blocks is that of their L2 gains.  In discrete time G(1) stands for G(0).
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    RobustMargin
        PROVED with `lower` <= margin <= `upper`, the scaling and the worst Delta.  REFUTED, with both 0, if the system
        itself is not stable.

    Raises
    ------
    KposError
        The system is not positive: the formula does not hold then.
    ConeMismatchError, ShapeError, DataError, TooLargeError
        As `structured_gain`.

    Notes
    -----
    Costs as `structured_gain`, of which it is the reciprocal.

    Examples
    --------
    >>> import control_kpos as kp
    >>> system = kp.ConeStateSpace([[-2, 1], [1, -3]], [[1, 0], [0, 1]], [[1, 0], [0, 1]], 0)
    >>> found = kp.robust_margin(system, "full")
    >>> found.status.name, round(found.lower, 6), round(found.upper, 6)
    ('PROVED', 1.381966, 1.381966)
    """
    return robust_margin_of(structured_gain(sys, "diagonal" if structure is None else structure, time_limit=time_limit))


def _in_words(lower: float, upper: float) -> str:
    """What both bounds of the margin say."""
    gains = f"L2 gains below {floored(lower)}" if np.isfinite(lower) else "finite L2 gains"
    text = f"Proved: loops u = Delta y that are well posed are stable for all causal Delta whose blocks have {gains}"
    some = f"; some Delta of gains up to {raised(upper)} makes the loop unstable or not well posed"
    return f"{text}{some * bool(np.isfinite(upper))}."


def robust_margin_of(cert: StructuredGainCertificate) -> RobustMargin:
    """The margin that bounds of the structured gain prove."""
    if cert.positivity.witness is not None:
        raise KposError(f"the margin is known for positive systems only. {cert.positivity.explain()}")
    if cert.status is Status.REFUTED:
        return RobustMargin(status=cert.status, certificate=cert, upper=0.0)
    if not cert:
        return RobustMargin(status=cert.status, certificate=cert, message=unfinished(cert) or "No margin is proven.")
    blocks = Blocks(np.array(cert.input_blocks), np.array(cert.output_blocks))
    moderate = len(cert.input_blocks) * len(cert.output_blocks) <= _LARGEST**2
    lower = float(np.nextafter(1 / cert.upper, 0)) if cert.upper else float("inf")
    upper = float(np.nextafter(1 / cert.lower, np.inf)) if cert.lower else float("inf")
    return RobustMargin(
        status=cert.status,
        certificate=cert,
        message=_in_words(lower, upper),
        lower=lower,
        upper=upper,
        scaling=cert.d,
        delta=blocks.worst(cert.y, cert.a) if cert.lower and moderate else None,
    )
