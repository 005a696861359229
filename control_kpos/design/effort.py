"""When a design ends: after a fixed number of operations, or after the seconds that the user gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ..exact.budget import OutOfBudgetError, budget, ended_by, reason
from ..proof.certificate import Status
from .result import DesignResult

# Operations after which a search gives up, where no time limit is given: a nanosecond each, about.  The answer is then
# the same on every machine.
EFFORT = {
    "one system": 6e10,
    "trade-off": 6e11,
    "network": 6e11,
    "a node of a network alone": 1e10,
    "refusal of a whole network": 3e10,
}


def operations(what: str, time_limit: float | None) -> float:
    """Operations for a search of this kind; no bound but the clock if a time limit is given.

    >>> operations("network", None), operations("network", 5.0)
    (600000000000.0, inf)
    """
    return EFFORT[what] if time_limit is None else float("inf")


def within(time_limit: float | None, design: Callable[[], DesignResult], what: str = "one system") -> DesignResult:
    """The design; UNDECIDED, with a word about the limit, if that is what ends it.

    Parameters
    ----------
    time_limit : float or None
        Seconds.  None: as many operations as `EFFORT` says.
    design : callable
        May raise OutOfBudgetError.
    what : str
        Key of `EFFORT`.
    """
    with budget(operations(what, time_limit), time_limit=time_limit):
        try:
            result = design()
        except OutOfBudgetError:
            message = f"{reason()} ended the design, or does not allow its next step."
            return DesignResult(status=Status.UNDECIDED, message=message)
        limit = ended_by()
        if result.status is Status.UNDECIDED and limit and limit not in result.message:
            return replace(result, message=f"{result.message.rstrip('.')}; {limit} ended the design.")
        return result
