"""The least dwell time of a family, between a signal that is not stable and vectors that prove stability."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from typing import Any

import numpy as np

from ..cones.polyhedral import has_open_facets
from ..exact.matrix import Matrix
from ..exact.rounding import double_below
from ..proof.answer import first_proven
from ..proof.certificate import Status
from ..theorems.positivity import PositivityCertificate
from .arguments import Family
from .dwell import DwellCertificate, DwellCycle
from .dwell_candidates import (
    least_dwell_times,
    least_steps,
    shift_of,
    short,
    terms_for,
    transition,
    unstable_cycles,
    unstable_step_cycles,
)
from .growth import directions, growing
from .switching import SwitchingCertificate, UnstableMixture

# States and members up to which dwell times are sought.
_STATES, _MEMBERS = 20, 6
# Time constants of the slowest member up to which cycles are sought where no dwell time is proven.
_REACH = 10.0
# In discrete time: steps up to which cycles are sought where no dwell time is proven, cycles tried, and steps up to
# which their products are formed exactly.
_STEPS, _TRIED, _SHORT = 20, 20, 40


def dwell_times(
    family: Family, loops: tuple[PositivityCertificate, ...]
) -> tuple[DwellCertificate | None, DwellCertificate | None]:
    """A dwell time that is proven to be enough, and one that is proven to be too short; None where nothing is found.

    Parameters
    ----------
    family : Family
    loops : tuple of PositivityCertificate
    """
    X, small = family.X, family.X.dim <= _STATES and 1 < len(family.matrices) <= _MEMBERS
    if not small or has_open_facets(X):
        return None, None
    dense = [A.values.toarray() if A.is_sparse else np.asarray(A.values) for A in family.matrices]
    slowest = min(int(family.discrete) - np.linalg.eigvals(A).real.max() for A in dense)
    if not slowest > 0:
        return None, None
    if family.discrete:
        return _in_steps(family, loops, dense)
    shifts = tuple(shift_of(X, A) for A in family.matrices)
    enough = first_proven(least_dwell_times(X, dense), lambda pair: _enough(loops, shifts, *pair))
    most = float(enough.dwell_time) if enough is not None else _REACH / slowest
    proofs = (
        DwellCertificate.settle(loops=loops, dwell_time=min(w.times), witness=w)
        for w in _cycles(family, dense, shifts, most)
    )
    return enough, next((proof for proof in proofs if proof.status is Status.REFUTED), None)


def _in_steps(family: Family, loops: Any, dense: list[Any]) -> tuple[DwellCertificate | None, DwellCertificate | None]:
    """The same in discrete time, where powers are exact."""
    enough = first_proven(
        least_steps(family.X, dense),
        lambda pair: DwellCertificate.settle(loops=loops, dwell_time=pair[0], vs=Matrix(pair[1])) or None,
    )
    most = _STEPS if enough is None else int(enough.dwell_time) - 1
    for modes, times in islice(unstable_step_cycles(dense, most), _TRIED):
        for x in _starts(family, dense, modes, times):
            w = DwellCycle(x, modes, tuple(map(Fraction, times)))
            proof = DwellCertificate.settle(loops=loops, dwell_time=min(w.times), witness=w)
            if proof.status is Status.REFUTED:
                return enough, proof
    return enough, None


def _starts(family: Family, dense: list[Any], modes: tuple[int, ...], times: tuple[int, ...]) -> Iterator[Matrix]:
    """Vectors that a cycle may not shrink: in floating point, and exactly if the cycle is short."""
    yield from directions(family.X, transition(dense, modes, times, True))
    word = [s for s, t in zip(modes, times, strict=True) for _ in range(t)]
    x = growing(family.X, family.matrices, word) if len(word) <= _SHORT else None
    if x is not None:
        yield x


def _enough(loops: Any, shifts: Any, T: Any, vs: Any) -> DwellCertificate | None:
    terms = tuple(terms_for(float(a * T)) for a in shifts)
    if None in terms:
        return None
    return DwellCertificate.settle(loops=loops, dwell_time=T, vs=Matrix(vs), shifts=shifts, terms=terms) or None


def _cycles(family: Family, dense: list[Any], shifts: Any, most: float) -> Iterator[DwellCycle]:
    for modes, times in unstable_cycles(dense, most):
        exact = tuple(short(t, up=False) for t in times)
        terms = terms_for(max(float(shifts[s] * t) for s, t in zip(modes, exact, strict=True)))
        if terms is not None:
            for x in directions(family.X, transition(dense, modes, exact)):
                yield DwellCycle(x, modes, exact, shifts, terms)


def dwell_bounds(
    always: bool, refuted: SwitchingCertificate | None, enough: DwellCertificate | None, short: DwellCertificate | None
) -> tuple[float, float]:
    """(lower, upper) of the least dwell time, rounded to the side that is proven; NaN for an upper one that is not.

    Parameters
    ----------
    always : bool
        Every order is stable.
    refuted : SwitchingCertificate or None
        A member alone is not stable: then no time is enough.
    enough, short : DwellCertificate or None
        What is proven.
    """
    if always:
        return 0.0, 0.0
    w = None if refuted is None else refuted.witness
    if isinstance(w, UnstableMixture) and sum(a != 0 for a in w.weights) == 1:
        return np.inf, np.inf
    lower = 0.0 if short is None else double_below(short.dwell_time)
    if enough is None:
        return lower, np.nan
    return lower, float(Matrix.from_fractions(np.array([enough.dwell_time])).rounded(up=True)[0])
