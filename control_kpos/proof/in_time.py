"""Certificates within a time limit: UNDECIDED, with the reason, if it ends the search."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from ..exact.budget import OutOfBudgetError, budget, ended_by
from ..exact.intake import seconds
from .certificate import Status

C = TypeVar("C")


def in_time(time_limit: Any, find: Callable[[], C], nothing: Callable[[], C]) -> C:
    """What is found within some seconds; else what proves nothing, with the limit as its reason.

    Parameters
    ----------
    time_limit : float or None
        Seconds, as the user gave them.  None: no limit but those around; what these end is not caught here.
    find : callable
        Returns a certificate or an answer; may raise OutOfBudgetError.
    nothing : callable
        Returns the same without a proof, in no time.
    """
    limit = seconds(time_limit)
    if limit is None:
        return find()
    with budget(time_limit=limit) as own:
        try:
            found, ended = find(), ended_by()
        except OutOfBudgetError:
            found, ended = None, ended_by()
    if own.outer is not None and own.deadline == own.outer.deadline:  # the limit around this one was the shorter
        own.outer.refused_by = own.outer.refused_by or ended
    found = nothing() if found is None else found
    if ended and getattr(found, "status", None) is Status.UNDECIDED:
        vars(found)["_ended"] = ended  # no part of the claim, of comparisons, or of files
    return found


def kept(owner: Any, name: str, find: Callable[[], C]) -> C:
    """What an object holds by this name, or what is found for it; it keeps that unless a limit around ended the search.

    A question with a short limit of its own must not leave its UNDECIDED to those that follow.
    """
    known = vars(owner)
    if name in known:
        return known[name]
    found = find()
    if getattr(found, "status", None) is not Status.UNDECIDED or not ended_by():
        known[name] = found
    return found


def unfinished(found: Any) -> str:
    """Which limit ended the search for a certificate, as a text in place of other reasons; empty if none did."""
    limit = vars(found).get("_ended", "")
    return f"Undecided: {limit} ended the search, or does not allow its next step; more may help." if limit else ""
