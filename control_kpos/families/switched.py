"""`switched`: is a family of systems stable, whatever the order in which its members follow each other?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..cards import floored, raised
from ..cones import Cone
from ..cones.polyhedral import has_open_facets
from ..errors import DataError
from ..exact.budget import OutOfBudgetError, budget, ended_by, reason
from ..exact.intake import exact_number, seconds
from ..exact.matrix import Matrix
from ..proof.answer import Answer, first_proven
from ..proof.certificate import Status
from ..theorems.positivity import PositivityCertificate, state_positivity
from .arguments import Family, read_family
from .candidates import common_candidates, no_common
from .common_vector import CommonVectorCertificate, Floats
from .dwelling import dwell_bounds, dwell_times
from .growth import cycles, directions, factor_of, growing, mixtures, next_mode_vectors
from .jumping import Jumping, mean_stability, read_chain
from .stabilising import StabilisingCertificate, stabilising
from .switching import CycleOfGrowth, NextModeCertificate, SwitchingCertificate, UnstableMixture

# Operations after which the search gives up, where no time limit is given.
_EFFORT = 3e10
# Relative enlargements of the growth until it is proven; factors are rounded down to so many binary digits.
_MORE, _DIGITS = (0.0, 1e-15, 1e-14, 1e-13, 1e-12, 1e-10, 1e-8), 80
# A factor from which a cycle is tried in exact arithmetic.
_NEARLY = 1 - 1e-9
_NO_V = "No common v exists for these members (v'x falls in every one of them): that is proven, see `others`."
_NO_E = "No common e exists for these members (the gauge norm of e falls in every one): that is proven, see `others`."
_SLOW = "Undecided: stability is proven, see `others`, but not at the rate that was asked for."
_OPEN = (
    "Neither a common v or e, nor a cycle or mixture of members that prevents stability, was proven. A larger "
    "`time_limit` allows longer cycles; dwell times or a smaller family may do."
)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Switching(Answer):
    """Outcome of `switched`.  `bool(answer)` is True only for PROVED.

    Attributes
    ----------
    v : ndarray, shape (n,), or None
        Proven: v'x > 0 on X without 0, and it falls in every member.
    e : ndarray, shape (n,), or None
        Proven: e inside X, and the gauge norm |x|_e falls in every member.
    decay_rate : float
        Proven for every order: of v'x or |x|_e, whichever is faster; in discrete time they fall at least like
        (1 - decay_rate)^k.  With a chain: of the mean of |x|.  NaN without v, e and a chain.
    vs : ndarray, shape (S, n), or None
        Discrete time: the v_s that prove `growth`.  With a chain: the v_s that prove mean stability.
    growth : float
        Discrete time: proven upper bound on the growth per step for every order; NaN without one.
    growth_bounds : (float, float)
        Discrete time: some order grows at least like lower^k, none faster than upper^k; (0, inf) without proof.
    dwell_time : float
        Proven upper bound on the least T for which every order that stays in each member for T or longer is stable, in
        discrete time for T steps; 0 if every order is, inf if a member alone is not stable, NaN if nothing was found.
    dwell_bounds : (float, float)
        Before it a T for which some such order is not stable, proven; 0 where none was found.
    stabilising : StabilisingCertificate or None
        If not every order is proven stable: a rule that chooses the member by the state and makes v'x fall, with `v`,
        `weights`, `decay_rate` and `rule(x)`; None where none was found.
    others : tuple of Certificate
        What else is proven: the other one of v and e, or that it does not exist; the growth; the dwell times; the rule.
    """

    v: Floats | None = None
    e: Floats | None = None
    decay_rate: float = float("nan")
    vs: Floats | None = None
    growth: float = float("nan")
    growth_bounds: tuple[float, float] = (0.0, float("inf"))
    dwell_time: float = float("nan")
    dwell_bounds: tuple[float, float] = (0.0, float("nan"))
    stabilising: StabilisingCertificate | None = None
    others: tuple[Any, ...] = ()

    def explain(self) -> str:
        """The verdict, why it holds, and what to do next, for a person.

        Returns
        -------
        str
        """
        proof = self.certificate
        by_v = self.v is not None and isinstance(proof, CommonVectorCertificate) and proof.x is self.v
        said = proof.told_of_v() if by_v and isinstance(proof, CommonVectorCertificate) else super().explain()
        return f"{self.message} {said}".strip() if by_v else said

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        (low, high), (least, enough) = self.growth_bounds, self.dwell_bounds
        out = [("growth per step", f"{floored(low, 9)} to {raised(high, 9)}")] if np.isfinite(high) else []
        return out + ([("least dwell time", f"{floored(least)} to {raised(enough)}")] if 0 < enough < np.inf else [])


def switched(
    family: Any,
    *,
    X: Cone | ArrayLike | None = None,
    discrete: bool | None = None,
    chain: ArrayLike | None = None,
    jumps: Any = None,
    rate: Literal["max"] | float | Fraction | str | None = None,
    time_limit: float | None = None,
) -> Switching:
    """Decide whether x' = A_s(t) x is exponentially stable for every s(t), or in the mean if s(t) is a Markov chain.

    Parameters
    ----------
    family : list of array_like (n, n), sparse matrices or systems
        The members A_0, .., A_S-1, as doubles, fractions or decimal strings; of systems and networks the A.
    X : Cone or array_like of rays, optional
        Kept by every member.  Default: the cone of the systems; the orthant for matrices.
    discrete : bool, optional
        True for x[k+1] = A_s(k) x[k].  Default: the time of the systems; continuous for matrices.
    chain : array_like, shape (S, S), optional
        The members follow each other at random: chain[i, j] is the rate from i to j, and rows have the sum 0; in
        discrete time it is the probability, and rows have the sum 1.  Rows that have it up to rounding are understood
        so: chain[i, i] is minus the exact sum of the others; probabilities are divided by their exact sum.
    jumps : dict of (i, j): array_like (n, n), or array_like (S, S, n, n), optional
        At the change from i to j x becomes jumps[i, j] x; in discrete time x[k+1] = jumps[i, j] A_i x[k].  They map X
        into X.  Default: x does not jump.
    rate : "max", number or None
        A positive number, per unit of time: also |x(t)| <= K exp(-rate t) |x(0)|, in discrete time (1 - rate)^k, is to
        be proven, of every order, or of the mean.  Numbers may be fractions or text.  "max", with a chain only: nearly
        the largest rate.
    time_limit : float, optional
        Seconds; what is not settled by then is UNDECIDED.

    Returns
    -------
    Switching
        PROVED by a common v, a common e, or in discrete time by vectors with a growth below 1.  REFUTED, with proof: a
        member does not keep X; a cycle of members, or a mixture of them, does not let some x go to 0.
        With a chain PROVED by v_s, `vs`, that fall in the mean; REFUTED by means that do not go to 0.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, NotProperConeError, TimebaseError
        No members, members of different sizes, cones or times, or what is no matrix; a chain with another size, with
        rows of another sum or with negative rates.

    Notes
    -----
    A chain is decided by Theorem 2 on X^S, in fractions up to 120 states of all members, in sparse doubles with a proof
    beyond: one sparse solve; "max" then comes within about 1e-3 of the largest rate.
    v and e take a few sparse solves on simplicial cones (worst mixtures), a linear program on others.  Cycles, mixtures
    and proofs that there is no v or e are sought up to 60 states; dwell times up to 20 states and 6 members; growth on
    simplicial cones other than orthants, and on cones that are not simplicial, up to 400.

    Examples
    --------
    >>> import control_kpos as kp
    >>> s = kp.switched([[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]])
    >>> s.status.name, s.v is None, s.e is None
    ('PROVED', True, False)
    >>> s = kp.switched([[[1, 1], [0, 1]], [[1, 0], [1, 1]]], discrete=True)
    >>> s.status.name, round(s.growth, 6), s.witness.weights
    ('REFUTED', 1.618034, (Fraction(1, 1), Fraction(0, 1)))
    >>> kp.switched([[[-3]], [["1.4"]]], chain=[[-1, 1], [2, -2]]).status.name
    'PROVED'
    """
    read = read_family(family, X, discrete)
    jumping = None if chain is None else read_chain(read, chain, jumps)
    asked = _asked(rate, jumping, jumps, read.discrete)
    time_limit = seconds(time_limit)
    effort = _EFFORT if time_limit is None else float("inf")
    with budget(effort, time_limit=time_limit), np.errstate(all="ignore"):
        try:
            answer = _found(read, asked) if jumping is None else _in_the_mean(jumping, asked)
        except OutOfBudgetError:
            return Switching(status=Status.UNDECIDED, message=f"{reason()} ended the search.")
        limit = ended_by()
        if answer.status is Status.UNDECIDED and limit:
            return replace(answer, message=f"{answer.message.rstrip('.')}; {limit} ended the search.")
        return answer


def _asked(rate: Any, jumping: Jumping | None, jumps: Any, discrete: bool) -> Any:
    """The rate that is asked for: None, "max" or a fraction."""
    if jumps is not None and jumping is None:
        raise DataError("jumps belong to a chain; give the rates between the members with chain=.")
    if rate is None or (isinstance(rate, str) and rate == "max" and jumping is not None):
        return rate
    if isinstance(rate, str) and rate == "max":
        raise DataError(
            'rate="max" belongs to a chain; for every order decay_rate is the best that the vectors found prove. Leave '
            "it out, or give a number."
        )
    asked = exact_number(rate, "rate", positive=True)
    if discrete and asked >= 1:
        raise DataError(f"rate is {float(asked):g}; in discrete time x falls like (1 - rate)^k, so rate is below 1.")
    return asked


def _kept(family: Family) -> tuple[PositivityCertificate, ...] | Switching:
    """The proofs that the members keep X, or the answer that one does not."""
    loops = tuple(state_positivity(A, family.X, discrete=family.discrete) for A in family.matrices)
    for s, loop in enumerate(loops):
        if not loop:
            message = f"Member {s} does not keep X." * (loop.status is Status.REFUTED)
            return Switching(status=loop.status, certificate=loop, message=message)
    return loops


def _in_the_mean(given: Jumping, asked: Any) -> Switching:
    """The answer for a chain."""
    loops = _kept(given.family)
    if isinstance(loops, Switching):
        return loops
    proof, message = mean_stability(given, loops, asked)
    if isinstance(proof, PositivityCertificate):
        return Switching(status=proof.status, certificate=proof, message=message)
    slow = bool(proof) and isinstance(asked, Fraction) and proof.required_rate is None
    return Switching(
        status=Status.UNDECIDED if slow else proof.status,
        certificate=None if slow else proof,
        message=_SLOW if slow else "",
        vs=None if proof.vs is None else proof.vs.values,
        decay_rate=proof.decay_rate if proof else float("nan"),
        others=(proof,) * slow,
    )


def _found(family: Family, asked: Fraction | None) -> Switching:
    loops = _kept(family)
    if isinstance(loops, Switching):
        return loops
    v, e = (_common(family, loops, asked, dual=dual) for dual in (True, False))
    growth = _growth(family, loops) if family.discrete else None
    proven: list[Any] = sorted((p for p in (v, e) if p is not None and p), key=lambda p: -p.decay_rate)
    if growth is not None and growth.growth < 1:
        proven.append(growth)
    refuted = None if proven else _refuted(family, loops)
    enough, short = (None, None) if proven else dwell_times(family, loops)
    certificate = proven[0] if proven else refuted if refuted is not None else short
    rule = None if proven else stabilising(family, loops)
    others = tuple(p for p in (v, e, growth, enough, short, rule) if p is not None and p is not certificate)
    status = Status.UNDECIDED if certificate is None else certificate.status
    found = _answer(status, certificate, v, e, growth, others)
    times = dwell_bounds(bool(proven), refuted, enough, short)
    found = replace(found, dwell_time=times[1], dwell_bounds=times, stabilising=rule)
    return found if asked is None else _at_rate(found, certificate, asked)


def _at_rate(found: Switching, proof: Any, asked: Fraction) -> Switching:
    """The answer about a decay rate: stability alone is not enough."""
    rate = proof.required_rate or proof.decay_rate if isinstance(proof, CommonVectorCertificate) else None
    if isinstance(proof, NextModeCertificate):
        rate = 1 - Fraction(proof.growth)
    if found.status is not Status.PROVED or (rate is not None and Fraction(rate) >= asked):
        return found
    others = (proof, *found.others)
    return replace(found, status=Status.UNDECIDED, certificate=None, message=_SLOW, others=others)


def _answer(status: Status, certificate: Any, v: Any, e: Any, growth: Any, others: tuple[Any, ...]) -> Switching:
    notes = [text for text, p in ((_NO_V, v), (_NO_E, e)) if p is not None and p.status is Status.REFUTED]
    has = [p for p in (v, e) if p is not None and p]
    bounds = (0.0, float("inf")) if growth is None else (growth.least, growth.growth)
    return Switching(
        status=status,
        certificate=certificate,
        message=" ".join({"PROVED": notes, "REFUTED": []}.get(status.name, [_OPEN, *notes])),
        v=v.x if v else None,
        e=e.x if e else None,
        decay_rate=max((p.decay_rate for p in has), default=float("nan")),
        vs=None if growth is None else growth.vs.values,
        growth=bounds[1] if growth is not None else float("nan"),
        growth_bounds=bounds,
        others=others,
    )


def _common(
    family: Family, loops: tuple[PositivityCertificate, ...], asked: Fraction | None, *, dual: bool
) -> CommonVectorCertificate | None:
    """A common e, or v with `dual`; or the proof that there is none; None if neither is found."""
    X, matrices = (family.X.dual if dual else family.X), family.matrices
    if dual:
        matrices = tuple(A.T for A in matrices)
        loops = tuple(PositivityCertificate.settle(A=A, X=X, discrete=family.discrete) for A in matrices)
    for rate in (Fraction(0),) if asked is None else (asked, Fraction(0)):
        found = first_proven(
            common_candidates(X, matrices, discrete=family.discrete, rate=float(rate)),
            lambda x, rate=rate: CommonVectorCertificate.of(loops, x, rate) or None,
        )
        if found is not None:
            return found
    witness = no_common(X, matrices, discrete=family.discrete)
    none = None if witness is None else CommonVectorCertificate.settle(loops=loops, witness=witness)
    return none if none is not None and none.status is Status.REFUTED else None


# -- growth


def _growth(family: Family, loops: tuple[PositivityCertificate, ...]) -> NextModeCertificate | None:
    """The least growth that vectors prove, with a cycle that comes close to it."""
    below = _fastest_cycle(family)
    for vs, gamma in next_mode_vectors(family.X, family.matrices):
        for more in _MORE:
            growth = float(np.nextafter(gamma * (1 + more), np.inf))
            proof = NextModeCertificate.settle(loops=loops, vs=Matrix(vs), growth=growth, **below)
            if proof:
                return proof
    return None


def _fastest_cycle(family: Family) -> dict[str, Any]:
    """The cycle of the largest proven factor per step, and that number; nothing where none is found."""
    best: dict[str, Any] = {"least": 0.0}
    if has_open_facets(family.X):
        return best
    for modes, P in cycles(family.X, family.matrices):
        for x in directions(family.X, P):
            factor = factor_of(family.X, family.matrices, modes, x)
            factor = None if factor is None else Fraction(int(factor * 2**_DIGITS), 2**_DIGITS)
            if factor and factor > best.get("cycle", CycleOfGrowth(x, factor=Fraction(0))).factor:
                best = {"cycle": CycleOfGrowth(x, modes, factor), "least": _root(factor, len(modes))}
    return best


def _root(factor: Fraction, length: int) -> float:
    """A double whose power is at most the factor, next to its root."""
    root = float(factor) ** (1 / length)
    while Fraction(root) ** length > factor:
        root = float(np.nextafter(root, 0))
    return root


# -- refutations


def _refuted(family: Family, loops: tuple[PositivityCertificate, ...]) -> SwitchingCertificate | None:
    """The proof that the family is not stable, or None."""
    proofs = (SwitchingCertificate.settle(loops=loops, witness=w) for w in _against(family))
    return next((proof for proof in proofs if proof.status is Status.REFUTED), None)


def _against(family: Family) -> Iterator[UnstableMixture | CycleOfGrowth]:
    X, matrices = family.X, family.matrices
    for weights, x in mixtures(X, matrices, discrete=family.discrete):
        yield UnstableMixture(x, weights)
    if not family.discrete or has_open_facets(X):
        return
    for modes, P in cycles(X, matrices):
        for x in directions(X, P):
            factor = factor_of(X, matrices, modes, x)
            if factor is not None and factor >= 1:
                yield CycleOfGrowth(x, modes, Fraction(int(factor * 2**_DIGITS), 2**_DIGITS))
        if np.abs(np.linalg.eigvals(P)).max() >= _NEARLY:
            x = growing(X, matrices, modes)
            if x is not None:
                yield CycleOfGrowth(x, modes, Fraction(1))
