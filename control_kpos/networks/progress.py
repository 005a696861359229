"""Progress of long work, on a terminal or to a callable."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TypeAlias

Target: TypeAlias = "Callable[[str], None] | bool | None"


class Reporter:
    """Lines about long work: to a callable, or to a terminal or notebook once it has taken two seconds."""

    def __init__(self, target: Target) -> None:
        self._target, self._begun, self._shown = target, time.monotonic(), False

    def __enter__(self) -> Callable[[str], None]:
        return self._say

    def _say(self, line: str) -> None:
        if callable(self._target):
            self._target(line)
        elif self._target is not False and (self._target or _is_watched()) and time.monotonic() - self._begun > 2:
            sys.stderr.write(f"\r{line:<78}")
            sys.stderr.flush()
            self._shown = True

    def __exit__(self, *_: object) -> None:
        if self._shown:
            sys.stderr.write("\n")


def _is_watched() -> bool:
    """True if standard error is a terminal or a cell of a notebook, where a line can be overwritten."""
    return sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
