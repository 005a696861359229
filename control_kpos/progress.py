"""Progress of long work, on a terminal, in a notebook or to a callable."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from .errors import DataError
from .exact.intake import found

Target: TypeAlias = "Callable[[str], None] | bool | None"

# Seconds of silence: short work says nothing.
_PATIENCE = 2.0


class Reporter:
    """Lines about long work: to a callable, or to a terminal or notebook once it has taken two seconds.

    Parameters
    ----------
    target : callable or bool, optional
        A callable is called with every line.  Otherwise one line on standard error is overwritten: always for True,
        never for False, and by default only in a terminal or a notebook.

    Examples
    --------
    >>> lines = []
    >>> with Reporter(lines.append) as report:
    ...     report("step 1 of 2")
    >>> lines
    ['step 1 of 2']
    """

    def __init__(self, target: Target) -> None:
        if not (target is None or callable(target) or isinstance(target, (bool, np.bool_))):
            raise DataError(f"progress is {found(target)}; give a function, True or False.")
        self._target, self._begun, self._shown, self._last = target, time.monotonic(), False, ""
        self._timer: threading.Timer | None = None

    def __enter__(self) -> Callable[[str], None]:
        return self._say

    def _say(self, line: str) -> None:
        if callable(self._target):
            self._target(line)
        elif self._target or (self._target is None and _is_watched()):
            self._last = line
            wait = self._begun + _PATIENCE - time.monotonic()
            if wait <= 0:
                self._show()
            elif self._timer is None:  # what is said early may be the last word for a long time
                self._timer = threading.Timer(wait, self._show)
                self._timer.daemon = True
                self._timer.start()

    def _show(self) -> None:
        sys.stderr.write(f"\r{self._last:<78}")
        sys.stderr.flush()
        self._shown = True

    def __exit__(self, *_: object) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()
        if self._shown:
            sys.stderr.write("\n")


def _is_watched() -> bool:
    """True if standard error is a terminal or a cell of a notebook, where a line can be overwritten."""
    return sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
