"""The effort of a search: operations are counted, and the clock is read only if a time limit was given.

Without a time limit an answer is the same on every machine: a search counts its operations and ends when a
stated number of them is spent.  With a limit the clock is read too, and the answer says if the limit ended the
search.  A search opens a `budget`; a step that may take long, many calls further down, calls `spend` first.
The budget is kept by context, so that exact arithmetic needs no argument for it.

One operation is about a nanosecond of one core: a multiplication of doubles, a tenth of one of small integers.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

# Operations that a core does in a second.  It converts what is left of a time limit, and decides nothing without one.
SPEED = 1e9
# A proof that would settle the question may begin when it needs this many operations more than the limit leaves.
OVERTIME = 3e8


class OutOfBudgetError(Exception):
    """The effort or the time limit is spent, or the next step needs more than is left.

    The text says which limit it was.  Searches turn it into UNDECIDED.
    """


@dataclass
class Budget:
    """What a search may still spend.

    Attributes
    ----------
    operations : float
        Left to spend; infinite for none counted.
    deadline : float
        On the clock of `time.monotonic`; infinite without a time limit.
    time_limit : float
        Seconds that were given, for messages.
    outer : Budget or None
        The budget of the search around this one: what is spent here is spent there too.
    refused_by : str
        The limit that refused a step, as words for a message; empty if none was refused.
    """

    operations: float
    deadline: float = float("inf")
    time_limit: float = float("inf")
    outer: Budget | None = None
    refused_by: str = ""

    def left(self) -> float:
        """Operations left, by count and by clock; negative after the limit."""
        return min(self.operations, self.left_by_clock())

    def left_by_clock(self) -> float:
        """Operations that the clock leaves; infinite without a time limit."""
        return (self.deadline - time.monotonic()) * SPEED if self.deadline < float("inf") else float("inf")

    def reason(self) -> str:
        """Which limit ends the search, as words for a message."""
        return self.clock() if self.left_by_clock() < self.operations else "the effort set for this search"

    def clock(self) -> str:
        """The time limit, as words for a message."""
        return f"the time limit of {self.time_limit:g} s"

    def count(self, operations: float) -> None:
        """Count operations as spent, here and in every budget around this one."""
        self.operations -= operations
        if self.outer is not None:
            self.outer.count(operations)

    def refuse(self, operations: float) -> None:
        """Remember that a step of so many operations was refused, in every budget that does not allow it."""
        if not self.left() > operations:
            self.refused_by = self.refused_by or self.reason()
        if self.outer is not None:
            self.outer.refuse(operations)


_BUDGET: ContextVar[Budget | None] = ContextVar("budget of the search that is running", default=None)


@contextmanager
def budget(operations: float = float("inf"), *, time_limit: float | None = None) -> Iterator[Budget]:
    """Open a budget for the code inside; it can never spend more than the budget around it has left.

    Parameters
    ----------
    operations : float
        Effort that ends the search.
    time_limit : float, optional
        Seconds.  None: the clock is not read.

    Examples
    --------
    >>> with budget(1e9) as outer:
    ...     with budget(1e12) as inner:
    ...         spend(4e8)
    ...     outer.operations == 6e8, inner.left() == 6e8
    (True, True)
    """
    outer = _BUDGET.get()
    seconds = float("inf") if time_limit is None else float(time_limit)
    deadline = time.monotonic() + seconds
    if outer is not None:
        operations = min(operations, outer.operations)
        if outer.deadline <= deadline:
            deadline, seconds = outer.deadline, outer.time_limit
    opened = Budget(operations, deadline, seconds, outer)
    token = _BUDGET.set(opened)
    try:
        yield opened
    finally:
        _BUDGET.reset(token)


def operations_left() -> float:
    """Operations until a limit; infinite without one, negative after it.

    >>> operations_left()
    inf
    """
    current = _BUDGET.get()
    return float("inf") if current is None else current.left()


def affords(operations: float = 0.0) -> bool:
    """True if a step of so many operations may begin.

    >>> with budget(100):
    ...     affords(99), affords(101)
    (True, False)
    """
    return operations_left() > operations


def spend(operations: float = 0.0) -> None:
    """Count operations about to be done; raise OutOfBudgetError instead if that many are not left.

    >>> with budget(100):
    ...     spend(101)
    Traceback (most recent call last):
        ...
    control_kpos.exact.budget.OutOfBudgetError: the effort set for this search does not allow the next step
    """
    current = _BUDGET.get()
    if current is None:
        return
    if not current.left() > operations:
        current.refuse(operations)
        raise OutOfBudgetError(f"{current.reason()} does not allow the next step")
    current.count(operations)


def begin(operations: float) -> bool:
    """Count the operations of a step that may begin while any are left, even if it needs more; False if none are.

    >>> with budget(100):
    ...     begin(101), begin(1)
    (True, False)
    """
    current = _BUDGET.get()
    if current is None:
        return True
    if not current.left() > 0:
        return False
    current.count(operations)
    return True


def require_time(operations: float = 0.0) -> None:
    """Raise OutOfBudgetError if a time limit has passed, or does not leave time for so many operations.

    Counts nothing, so that without a time limit nothing changes: for steps of solves that a count does not end.

    >>> with budget(100, time_limit=float("inf")):
    ...     require_time(1e6)
    """
    current = _BUDGET.get()
    if current is not None and not current.left_by_clock() > operations:
        current.refused_by = current.refused_by or current.clock()
        raise OutOfBudgetError(f"{current.clock()} does not allow the next step")


def seconds_left() -> float:
    """Seconds that a solver may take: infinite unless a time limit was given, negative after it."""
    current = _BUDGET.get()
    return float("inf") if current is None else current.deadline - time.monotonic()


def reason() -> str:
    """Which limit ends the search that is running, as words for a message."""
    current = _BUDGET.get()
    return "no limit" if current is None else current.reason()


def ended_by() -> str:
    """The limit that ended the search that is running, or refused one of its steps; empty if none did.

    A search that goes on to cheaper candidates after a refusal asks this at its end: without the limit it might have
    found more.

    >>> with budget(100):
    ...     try:
    ...         spend(101)
    ...     except OutOfBudgetError:
    ...         affords(99), ended_by()
    (True, 'the effort set for this search')
    """
    current = _BUDGET.get()
    if current is None:
        return ""
    return current.refused_by or ("" if current.left() > 0 else current.reason())
