"""The time limit of a search, for everything that runs inside it.

A search sets it once; what may take long asks, before it begins, whether there is time left.  Kept by context, so that
exact arithmetic, many calls further down, needs no argument for it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

# Seconds by which a proof that would settle the question may end after the limit.
OVERTIME = 0.3

_END: ContextVar[float] = ContextVar("end of the search on the clock of time.monotonic", default=float("inf"))


class OutOfTimeError(Exception):
    """The time limit has passed, or will pass before the next step ends.  Searches turn it into UNDECIDED."""


@contextmanager
def limited_to(seconds: float) -> Iterator[None]:
    """Set the limit for what runs inside; a limit around it that ends earlier stays.

    >>> with limited_to(60):
    ...     with limited_to(3600):
    ...         seconds_left() <= 60
    True
    """
    token = _END.set(min(_END.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _END.reset(token)


def seconds_left() -> float:
    """Seconds until the limit; infinite without one, negative after it.

    >>> seconds_left()
    inf
    """
    return _END.get() - time.monotonic()


def require_seconds(needed: float = 0.0) -> None:
    """Raise OutOfTimeError unless so many seconds are left.

    Parameters
    ----------
    needed : float
        Estimated time of the step that follows.
    """
    if not seconds_left() > needed:
        raise OutOfTimeError(f"{needed:.2g} s more would be needed")
