"""How far uncertainty may grow: the largest factor with a proof, and a factor at which something stands against it.

At the factor t a range [L, H] becomes [c - t d, c + t d], with its middle c = (L + H) / 2 and d = (H - L) / 2, and a
vertex of a node becomes first + t (vertex - first).  These sets grow with t: a proof at t is one for all smaller
factors, and what refutes at t refutes at all larger ones.  Links of large networks are doubles: for proofs the ends of
their ranges are rounded outwards, for refutations inwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from math import frexp, inf, ldexp
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...cards import floored, raised
from ...errors import DataError
from ...exact.budget import OutOfBudgetError, budget, ended_by, seconds_left
from ...exact.intake import found as found_argument
from ...exact.intake import seconds
from ...exact.matrix import Matrix
from ...proof.certificate import Status
from ..conditions import same_numbers
from ..model import BLOCKS, NetworkModel
from ..nodes import NodeStack
from ..witnesses import NodeViolation
from .certificate import UncertainNetworkCertificate
from .certify import Searches, certify_all
from .members import Vertices
from .network import UncertainNetwork
from .signed import bounds_of
from .witnesses import FailingMember, NoCommonVectors

# Relative width of the bracket, and binary digits of the factors in it.
_WIDTH, _DIGITS = 1e-6, 30
# Factors above this power of two are not tried.
_LARGEST = 60
# Part of the time for the bracket; the rest is for its proofs.
_FOR_BRACKET = 0.6
# Steps beside the bracket at which proofs and refutations in exact numbers are tried, relative to the factor.
_BESIDE = (0.0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)


class LargestUncertainty(tuple[float, float]):
    """The pair (lower, upper) of factors by which the uncertainty of a network may grow.

    Attributes
    ----------
    lower, upper : float
        Everything is proven up to the factor `lower`; something is refuted from `upper` on, see `scope`.
    certificate : UncertainNetworkCertificate or None
        The proof at `lower`; None if that is 0.
    refutation : UncertainNetworkCertificate or None
        What stands against it at `upper`; None if that is inf.
    scope : str
        What is refuted: "network", "positivity", "common vectors" (neither v nor e exist), "bounds" (the network of the
        bounds of ranges that change sign), or "" for nothing.
    ended : str
        The limit that ended the search, in words; "" if none did.
    """

    lower: float
    upper: float
    certificate: UncertainNetworkCertificate | None
    refutation: UncertainNetworkCertificate | None
    scope: str
    ended: str

    def __new__(
        cls,
        bounds: tuple[float, float],
        certificate: UncertainNetworkCertificate | None,
        refutation: UncertainNetworkCertificate | None,
        scope: str,
    ) -> LargestUncertainty:
        self = super().__new__(cls, bounds)
        self.lower, self.upper = bounds
        self.certificate, self.refutation, self.scope = certificate, refutation, scope
        self.ended = ""
        return self

    def __getnewargs__(self) -> tuple[Any, ...]:
        return tuple(self), self.certificate, self.refutation, self.scope

    def check(self) -> bool:
        """Recompute both verdicts from their data, without any solver.

        Returns
        -------
        bool
        """
        pairs = (self.certificate, Status.PROVED), (self.refutation, Status.REFUTED)
        return all(part is None or (part.status is status and part.check()) for part, status in pairs)

    def explain(self) -> str:
        """What is proven of smaller factors, and what is refuted of larger ones.

        Returns
        -------
        str
        """
        below = (
            "Nothing is proven, not even without uncertainty"
            if self.certificate is None
            else f"Proved up to the factor {floored(self.lower, 9)}"
        )
        above = {
            "network": "the network itself is refuted: one of its members does not decay",
            "positivity": "a node or link is not positive on its cones, which says nothing of stability",
            "common vectors": "no v and no e exist for all choices, which says nothing of any single one",
            "bounds": "the bounds of ranges that change sign fail, which says nothing of what is in the ranges",
            "": "nothing is refuted",
        }[self.scope]
        where = f"From the factor {raised(self.upper, 9)} on" if self.upper < inf else "At larger ones"
        late = f" The search was ended by {self.ended}; more may help." if self.ended else ""
        return f"{below}: ranges grow around their middles, vertices away from the first one. {where} {above}.{late}"


@np.errstate(all="ignore")
def largest_uncertainty(net: UncertainNetwork, *, time_limit: float | None = None) -> LargestUncertainty:
    """By which factor the uncertainty of a network may grow: proven from below, refuted from above.

    Parameters
    ----------
    net : UncertainNetwork
        As `feedback_interconnect` makes it of nodes with vertices, or with ranges.  At the factor 1 it is as it was
        given; at t ranges are t times as wide around their middles, and vertices t times as far from the first of their
        node, the nominal one.
    time_limit : float, optional
        Seconds; the pair is as close as it was proven by then.  Default: that of the network.

    Returns
    -------
    LargestUncertainty
        Reads as ``lower, upper = largest_uncertainty(net)``, and has a `certificate` for `lower` and a `refutation` for
        `upper`, whose `scope` says what is refuted.  (0, 0) if already the network without uncertainty is refuted;
        inf where nothing is refuted; factors up to 2^60 are tried.

    Raises
    ------
    DataError
        `net` has neither vertices nor ranges.

    Notes
    -----
    Some 25 proofs as for `net.certificate`, which end when the bracket is 1e-6 of the factor wide, and one proof and
    one refutation in exact numbers at its ends.

    Examples
    --------
    >>> import control_kpos as kp
    >>> weight = kp.interval("0.4", "0.6")
    >>> lag = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)
    >>> found = kp.largest_uncertainty(kp.feedback_interconnect([lag, lag], [[0, weight], [weight, 0]]))
    >>> lower, upper = found
    >>> round(lower, 5), round(upper, 5), found.scope
    (5.0, 5.0, 'network')
    """
    if not isinstance(net, UncertainNetwork):
        raise DataError(
            f"net is {found_argument(net)}; give a network with vertices or ranges, as feedback_interconnect makes it "
            "of kp.stack(A=[A1, A2, ...]) or kp.interval(lower, upper)."
        )
    with budget(time_limit=seconds(net.time_limit if time_limit is None else time_limit)) as limited:
        found, whole = _found(net)
        found.ended = ended_by() or limited.clock() * (not whole)
    return found


def _found(net: UncertainNetwork) -> tuple[LargestUncertainty, bool]:
    """Both sides, as far as the budget allows, and whether the bracket was found to its end."""
    low, high, whole = 0.0, inf, False
    proof: tuple[float, UncertainNetworkCertificate | None] = 0.0, None
    with suppress(OutOfBudgetError):
        closed = Searches(net.models, net.lower).closed
        alike = closed is not None and len(closed[0]) == len(net.models)
        family = _Family(*(closed if closed is not None and alike else (net.models, net.lower)))
        with suppress(OutOfBudgetError), budget(time_limit=_FOR_BRACKET * seconds_left()):
            for ends in _brackets(lambda t: any(tried.seems_proven() for tried in _searches(family, t, 0))):
                low, high = ends
            whole = True
        proof = next(((t, c) for t, c in _proofs(family, low) if c is not None), proof)
        for t in _beside(high, up=True) if high < inf else ():
            refuted, scope = _refutation(family, t, proof[0] if proof[1] else None)
            if refuted is not None:
                return LargestUncertainty((proof[0], t), proof[1], refuted, scope), whole
    return LargestUncertainty((proof[0], inf), proof[1], None, ""), whole


def _brackets(holds: Callable[[float], bool]) -> Iterator[tuple[float, float]]:
    """Factors with and without a proof, closer and closer; in the end (0, 0) if there is none, inf if always one."""
    if holds(1.0):
        low = 1.0
        yield low, inf
        while holds(2 * low):
            low *= 2
            yield low, inf
            if low > 2.0**_LARGEST:
                return
        high = 2 * low
    else:
        low, high = 0.5, 1.0
        yield 0.0, high
        while not holds(low):
            low, high = low / 2, low
            yield 0.0, high
            if low < 2.0**-_LARGEST:
                yield 0.0, high if holds(0.0) else 0.0
                return
    yield low, high
    while high - low > 0.25 * _WIDTH * high:
        middle = _short(0.5 * (low + high))
        low, high = (middle, high) if holds(middle) else (low, middle)
        yield low, high


def _short(t: float) -> float:
    """A number of a few binary digits close to t: products with it are short."""
    mantissa, exponent = frexp(t)
    return ldexp(round(ldexp(mantissa, _DIGITS)), exponent - _DIGITS)


def _beside(t: float, *, up: bool) -> Iterator[float]:
    """Factors a little above, or below."""
    for step in _BESIDE:
        yield _short(t * (1 + step if up else 1 - step))


def _proofs(family: _Family, low: float) -> Iterator[tuple[float, UncertainNetworkCertificate | None]]:
    """Proofs in exact numbers, at the largest factors first."""
    for t in (*_beside(low, up=False), 0.0):
        yield t, next(filter(None, (tried.proof() for tried in _searches(family, t, 1))), None)


def _searches(family: _Family, t: float, rounded: int) -> Iterator[Searches]:
    """The searches for a proof at a factor: as it is, and with links of nodes to themselves closed at all pairs."""
    tried = Searches(*family.at(t, rounded=rounded))
    yield tried
    if tried.closed is not None:
        yield Searches(*tried.closed)


def _refutation(family: _Family, t: float, proven: float | None) -> tuple[UncertainNetworkCertificate | None, str]:
    """What stands against a factor in exact numbers, and what that refutes; there is a proof at `proven`."""
    models, lower = family.at(t, rounded=-1)
    found = certify_all(models, lower)
    if _is_about_decay(found.refuted_by):
        return found, "common vectors" if isinstance(found.refuted_by, NoCommonVectors) else "network"
    if found:
        return None, ""
    if lower is not None:
        bound = certify_all(bounds_of(models, lower))
        if _is_about_decay(bound.refuted_by):
            return bound, "bounds"
    if (
        proven is not None and Searches(*family.at(proven, rounded=1)).broken is not None
    ):  # what leaves the cones does not stop a proof
        return None, ""
    return (found, "positivity") if found.refuted_by is not None else (None, "")


def _is_about_decay(w: Any) -> bool:
    """True for witnesses against stability or against common vectors."""
    return isinstance(w, NoCommonVectors) or (isinstance(w, FailingMember) and not isinstance(w.witness, NodeViolation))


class _Family:
    """The networks of all factors."""

    def __init__(self, models: Vertices, lower: NetworkModel | None) -> None:
        self.models, self.lower = models, lower

    def at(self, factor: float, *, rounded: int) -> tuple[Vertices, NetworkModel | None]:
        """The networks of the vertices and of the lower ends; `rounded`: outwards (1), inwards (-1), in doubles (0)."""
        first, t = self.models[0], Fraction(factor)
        mixed = _in_doubles if rounded == 0 else _exactly
        known = dict[int, NodeStack]()

        def at_vertex(g: int, s: NodeStack, lower: bool = False) -> NodeStack:
            key = id(s) if not lower else -1 - g
            if key not in known:
                data = {}
                for name in BLOCKS:
                    high, own = getattr(first.stacks[g], name), getattr(s, name)
                    end = high if self.lower is None else getattr(self.lower.stacks[g], name)
                    if not same_numbers(high, end):
                        data[name] = mixed(end, high, (1 - t) / 2 if lower else (1 + t) / 2)
                    elif own is not high:
                        data[name] = mixed(high, own, t)
                known[key] = replace(s, **data) if data else s
            return known[key]

        W, least = self._links(t, rounded)
        out = []
        for m in self.models:
            stacks = tuple(at_vertex(g, s) for g, s in enumerate(m.stacks))
            out.append(NetworkModel(stacks, m.members, W, m.dt))
        if self.lower is None:
            return tuple(out), None
        stacks = tuple(
            out[0].stacks[g] if s is first.stacks[g] else at_vertex(g, s, True) for g, s in enumerate(self.lower.stacks)
        )
        return tuple(out), NetworkModel(stacks, first.members, least, first.dt)

    def _links(self, t: Fraction, rounded: int) -> tuple[Matrix, Matrix]:
        """The upper and lower ends of W."""
        high = self.models[0].coupling
        low = high if self.lower is None else self.lower.coupling
        if same_numbers(high, low):
            return high, high
        parts = (1 + t) / 2, (1 - t) / 2
        if not (high.is_sparse and low.is_sparse):
            mixed = _in_doubles if rounded == 0 else _exactly
            return mixed(low, high, parts[0]), mixed(low, high, parts[1])
        pattern = sp.coo_array(abs(high.values) + abs(low.values))
        ends = [Matrix(np.asarray(sp.csr_array(M.values)[pattern.coords]).ravel()) for M in (low, high)]
        out = []
        for part, up in zip(parts, (True, False), strict=True):
            mixed = (_exactly if rounded else _in_doubles)(ends[0], ends[1], part)
            data = mixed.values
            if mixed.radius is not None:  # the nearest double, to the one side or the other
                outer = np.nextafter(data, np.inf if up == (rounded > 0) else -np.inf)
                data = np.where(mixed.radius > 0, outer, data)
            out.append(Matrix(sp.csr_array((data, pattern.coords), shape=high.shape)))
        return out[0], out[1]


def _exactly(a: Matrix, b: Matrix, t: Fraction) -> Matrix:
    """(1 - t) a + t b."""
    parts = [M.as_integers() for M in (a, b)]
    weights = [Fraction(scale) * part for (_, scale), part in zip(parts, (1 - t, t), strict=True)]
    (m, x), (n, y) = zip((x for x, _ in parts), weights, strict=True)
    numerators = m * (x.numerator * y.denominator) + n * (y.numerator * x.denominator)
    return Matrix.over(numerators, x.denominator * y.denominator)


def _in_doubles(a: Matrix, b: Matrix, t: Fraction) -> Matrix:
    """The same, about."""
    return Matrix(a.values + float(t) * (b.values - a.values))
