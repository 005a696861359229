"""One time limit for a whole design, from the reading of its arguments to the proof."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ..exact.budget import OutOfTimeError, limited_to, seconds_left
from ..proof.certificate import Status
from .result import DesignResult

_REACHED = "the time limit was reached"


def within(seconds: float, design: Callable[[], DesignResult]) -> DesignResult:
    """The design; UNDECIDED, with a word about the limit, if that is what ends it.

    Parameters
    ----------
    seconds : float
    design : callable
        May raise OutOfTimeError.
    """
    with limited_to(seconds):
        try:
            result = design()
        except OutOfTimeError as error:
            return out_of_time(error)
        if result.status is Status.UNDECIDED and seconds_left() <= 0 and "time limit" not in result.message:
            return replace(result, message=f"{result.message.rstrip('.')}; {_REACHED}.")
        return result


def out_of_time(error: OutOfTimeError) -> DesignResult:
    """UNDECIDED for a design that the limit ended."""
    return DesignResult(
        Status.UNDECIDED, message=f"{_REACHED}, or the next step would not have ended by then ({error})."
    )
